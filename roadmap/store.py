"""Map folders: a manifest and flat .npy arrays; written whole or not at all."""

import hashlib
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from roadmap.errors import BadMap
from roadmap.unfinished import beside, put

FORMAT = 1
_MANIFEST = "manifest.json"


def write_folder(path: str | Path, manifest: dict, arrays: dict) -> Path:
    """Write arrays and manifest to a folder, atomically; an old one is replaced.

    Everything is written to a temporary folder beside it and renamed, so a killed
    build leaves the old folder or the new one, never half of one.

    Args:
        path: The folder.
        manifest: Plain JSON data; format version and array table are added.
        arrays: Arrays by name.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and not (path / _MANIFEST).is_file():
        raise BadMap(
            f"{path} exists and is not a map folder, so it is left alone; choose "
            "another --out or remove it yourself"
        )
    with beside(path) as made:
        made.mkdir(0o700)
        table = {name: _write_array(made, name, a) for name, a in arrays.items()}
        whole = {"format": FORMAT, **manifest, "arrays": table}
        whole["hash"] = _manifest_hash(whole)
        (made / _MANIFEST).write_text(json.dumps(whole, indent=1, sort_keys=True))
        put(made, path)
    return path


def read_folder(path: str | Path, verify: bool = True) -> tuple[dict, dict]:
    """Return manifest and memory-mapped arrays of a map folder.

    Args:
        path: The folder.
        verify: Compare every array with its SHA-256.

    Raises:
        BadMap: No map there, a foreign version, a truncated or altered array.
    """
    path = Path(path)
    manifest = _read_manifest(path)
    arrays = {}
    for name, row in manifest["arrays"].items():
        arrays[name] = _read_array(path, name, row)
    if verify:
        with ThreadPoolExecutor() as pool:
            rows = list(manifest["arrays"].items())
            for (name, row), digest in zip(
                rows, pool.map(lambda r: _digest(path / f"{r[0]}.npy"), rows),
                strict=True,
            ):
                if digest != row["sha256"]:
                    raise BadMap(
                        f"array {name} of map {path} was altered (its SHA-256 does "
                        "not match the manifest); build the map again"
                    )
    return manifest, arrays


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
        raise BadMap(
            f"{path} holds no map (no {_MANIFEST}); build one with "
            "`odm build RECIPE --out DIR`"
        )
    try:
        manifest = json.loads(file.read_text())
        version = manifest["format"]
    except (ValueError, KeyError, TypeError) as error:
        raise BadMap(
            f"the manifest of map {path} cannot be read ({error}); build the map again"
        ) from error
    if version != FORMAT:
        raise BadMap(
            f"map {path} has format version {version}, but this program reads version "
            f"{FORMAT}; build the map again"
        )
    if manifest.get("hash") != _manifest_hash(manifest):
        raise BadMap(
            f"the manifest of map {path} was altered (its hash does not match); "
            "build the map again"
        )
    return manifest


def _read_array(path: Path, name: str, row: dict) -> np.ndarray:
    try:
        mode = None if 0 in row["shape"] else "r"  # nothing cannot be mapped
        array = np.load(path / f"{name}.npy", mmap_mode=mode, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise BadMap(
            f"array {name} of map {path} is missing or truncated ({error}); build the "
            "map again"
        ) from error
    if array.dtype.str != row["dtype"] or list(array.shape) != row["shape"]:
        raise BadMap(
            f"array {name} of map {path} is {array.dtype.str} {list(array.shape)}, "
            f"but its manifest says {row['dtype']} {row['shape']}; build the map again"
        )
    return array
