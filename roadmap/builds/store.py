"""Map folders: a manifest and flat .npy arrays; written whole or not at all."""

import hashlib
import io
import json
import math
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path

import numpy as np

from roadmap.builds.unfinished import beside, put
from roadmap.errors import BadMap, PlanningError
from roadmap.ranges import check_path

FORMAT = 1
_NUMBERS = "biuf"  # kinds of arrays that maps hold
_MANIFEST = "manifest.json"


def write_folder(path: str | Path, manifest: dict, arrays: dict) -> Path:
    """Write arrays by name and a manifest of plain JSON data to a folder, atomically.

    Everything is written to a temporary folder beside it and renamed, so a killed build
    leaves the old folder or the new one, never half of one. Format version and array
    table are added to the manifest.
    """
    path = check_path("the folder of a map", path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadMap(
            f"{path} cannot be written: {error.strerror}; give another folder"
        ) from error
    if path.exists() and not (path / _MANIFEST).is_file():
        raise BadMap(
            f"{path} exists and is not a map folder, so it is left alone; choose "
            "another --out or remove it yourself"
        )
    with beside(path) as made:
        made.mkdir()
        table = {name: _write_array(made, name, a) for name, a in arrays.items()}
        whole = {"format": FORMAT, **manifest, "arrays": table}
        whole["hash"] = _manifest_hash(whole)
        (made / _MANIFEST).write_text(json.dumps(whole, indent=1, sort_keys=True))
        put(made, path)
    return path


def read_folder(path: str | Path, verify: bool = True) -> tuple[dict, dict]:
    """Return manifest and read-only arrays of a map folder.

    Args:
        path: The folder.
        verify: Read every array into memory of its own and compare these very bytes
            with their SHA-256: nothing that happens to the files later changes them.
            False maps the files instead: as long as an array lives nobody may write
            into its file. Whoever does changes the array, whoever shortens it ends
            the program (SIGBUS). `write_folder` does neither: it puts new files in
            the place of old ones, which live on while they are mapped.

    Raises:
        BadMap: No map there, a foreign version, a truncated or altered array.
    """
    path = check_path("the folder of a map", path)
    manifest = _read_manifest(path)
    rows = list(manifest["arrays"].items())
    if not verify:
        return manifest, {name: _mapped(path, name, row) for name, row in rows}
    with ThreadPoolExecutor() as pool:
        arrays = pool.map(lambda row: _verified(path, *row), rows)
        return manifest, dict(zip(dict(rows), arrays, strict=True))


@contextmanager
def made_of(path: str | Path) -> Iterator[None]:
    """Make one sentence of what goes wrong when a manifest becomes a map."""
    try:
        yield
    except PlanningError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise BadMap(
            f"the manifest of map {path} lacks {error} or holds it in a wrong form; "
            "build the map again"
        ) from error


def _write_array(folder: Path, name: str, array: np.ndarray) -> dict:
    file = folder / f"{name}.npy"
    np.save(file, np.ascontiguousarray(array), allow_pickle=False)
    shape, dtype = list(array.shape), array.dtype.str
    return {"dtype": dtype, "shape": shape, "sha256": _digest(file)}


def _digest(file: Path) -> str:
    with open(file, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _manifest_hash(manifest: dict) -> str:
    """Hash what the map is: everything but when and where it was built."""
    body = {k: v for k, v in manifest.items() if k not in ("hash", "built")}
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def _read_manifest(path: Path) -> dict:
    file = path / _MANIFEST
    if not file.is_file():
        raise BadMap(f"{path} {_what_instead(path)}")
    try:
        manifest = json.loads(file.read_text(encoding="utf-8"))
        version = manifest["format"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise BadMap(
            f"the manifest of map {path} cannot be read ({error}); build the map again"
        ) from error
    if type(version) is not int or version != FORMAT:
        raise BadMap(
            f"map {path} has format version {version}, but this program reads version "
            f"{FORMAT}; build the map again"
        )
    if manifest.get("hash") != _manifest_hash(manifest):
        raise BadMap(
            f"the manifest of map {path} was altered (its hash does not match); "
            "build the map again"
        )
    with made_of(path):
        for name, row in manifest["arrays"].items():
            _check_row(path, name, row)
    return manifest


def _what_instead(path: Path) -> str:
    """Say what lies where no map does, and what to give."""
    if (path.parent / _MANIFEST).is_file() and path.is_file():
        return f"is a file of a map; give the map, its folder {path.parent}"
    if path.is_file():
        return "is a file and holds no map; give the folder that `odm build` wrote"
    if inside := sorted(file.parent.name for file in path.glob(f"*/{_MANIFEST}")):
        return f"holds no map itself but {', '.join(inside[:4])}; give one of these"
    return f"holds no map (no {_MANIFEST}); build one with `odm build RECIPE --out DIR`"


def _check_row(path: Path, name: str, row: dict) -> None:
    """Refuse an array that is no plain numbers, or lies elsewhere."""
    shape = row["shape"]
    sound = isinstance(shape, list) and all(type(n) is int and n >= 0 for n in shape)
    sound = sound and np.dtype(row["dtype"]).kind in _NUMBERS
    if not sound or Path(name).name != name or not isinstance(row["sha256"], str):
        raise BadMap(
            f"the manifest of map {path} tells of an array {name!r} that no map holds "
            f"({row}); build the map again"
        )


def _verified(path: Path, name: str, row: dict) -> np.ndarray:
    """Read an array's file once; return what was read, if its digest is right."""
    with _opened(path, name) as stream:
        size = os.fstat(stream.fileno()).st_size
        begin = _check_header(stream, path, name, row, size)
        data = np.empty(size, np.uint8)
        stream.seek(0)
        if stream.readinto(data.data) != size:
            raise _damaged(path, name, "it was shortened while it was read")
    if hashlib.sha256(data.data).hexdigest() != row["sha256"]:
        raise BadMap(
            f"array {name} of map {path} was altered (its SHA-256 does not match the "
            "manifest); build the map again"
        )
    data.flags.writeable = False
    array = data[begin:].view(row["dtype"]).reshape(row["shape"])
    return array if array.flags.aligned else array.copy()


def _mapped(path: Path, name: str, row: dict) -> np.ndarray:
    """Map an array's file into memory."""
    with _opened(path, name) as stream:
        size = os.fstat(stream.fileno()).st_size
        begin = _check_header(stream, path, name, row, size)
        kind, shape = np.dtype(row["dtype"]), tuple(row["shape"])
        if 0 in shape:  # nothing cannot be mapped
            return np.empty(shape, kind)
        return np.memmap(stream, kind, "r", begin, shape)


@contextmanager
def _opened(path: Path, name: str) -> Iterator[BufferedReader]:
    try:
        with open(path / f"{name}.npy", "rb") as stream:
            yield stream
    except OSError as error:
        raise _damaged(path, name, error) from error


def _check_header(
    stream: BufferedReader, path: Path, name: str, row: dict, size: int
) -> int:
    """Return where the numbers begin in a .npy file that is what its row says.

    The header is compared with what `numpy.save` writes, never read: it is Python.
    """
    kind, shape = row["dtype"], tuple(row["shape"])
    wanted, told = io.BytesIO(), {"descr": kind, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(wanted, told)
    if stream.read(wanted.tell()) != wanted.getvalue():
        raise _damaged(path, name, f"its header is not that of {told}")
    long = stream.tell() + math.prod(shape) * np.dtype(kind).itemsize
    if size != long:
        raise _damaged(path, name, f"it has {size} bytes, not {long}")
    return stream.tell()


def _damaged(path: Path, name: str, error: object) -> BadMap:
    return BadMap(
        f"array {name} of map {path} is missing, truncated or damaged ({error}); build "
        "the map again"
    )
