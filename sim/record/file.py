"""Recordings on disk: an .npz whose bytes follow from what it holds and nothing else.

The first member is `recording.json`, then come the arrays. Nothing is compressed and
all times in the archive are fixed, so that the same run gives the same bytes.
"""

import hashlib
import io
import json
import zipfile
from pathlib import Path
from typing import BinaryIO

import numpy as np

from roadmap.ranges import check_path
from sim.record.record_check import BadRecord, check_arrays
from sim.record.run_record import FORMAT, INPUTS, TARGETS, RunRecord
from sim.terminal.npz import TooLarge, array_of, read_members
from sim.terminal.output import write_whole

HEAD = "recording.json"
_START = (1980, 1, 1, 0, 0, 0)  # the earliest time an archive can name


def write_record(record: RunRecord, path: str | Path) -> Path:
    """Write a recording whole or not at all; an old file is replaced."""
    try:
        return write_whole(path, lambda stream: _write(record, stream))
    except OSError as error:
        raise BadRecord(
            f"the recording {path} cannot be written ({error.strerror or error}); "
            "choose another folder"
        ) from error


def is_record(path: str | Path) -> bool:
    """Return whether a file is, or begins as, a recording of a run."""
    try:
        with open(path, "rb") as stream:
            start = stream.read(64)
        if start.startswith(b"PK\x03\x04") and start[30:].startswith(HEAD.encode()):
            return True
        with zipfile.ZipFile(path) as archive:
            return HEAD in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def read_record(path: str | Path) -> RunRecord:
    """Read a recording and check it.

    Raises:
        BadRecord: It is truncated, of another version, or its content contradicts
            itself; what was altered of the outcome only is told in the record.
    """
    members = _members(check_path("a recording", path))
    if HEAD not in members:
        raise BadRecord(f"{path} holds no {HEAD}; give a recording of `odm run`")
    head = _head(path, members.pop(HEAD))
    try:
        table = head.pop("arrays")
        arrays = {name: _array(path, members, name) for name in table}
        altered = [name for name, a in arrays.items() if _digest(a) != table[name]]
        check_arrays(path, head, arrays)
    except (KeyError, TypeError, AttributeError, IndexError) as error:
        raise BadRecord(
            f"{path} lacks {error} or holds it in a wrong form; record the run again"
        ) from error
    given = ("robot.", "story.", "person.")
    spoiled = [n for n in altered if n in INPUTS or n.startswith(given)]
    if spoiled:
        raise BadRecord(
            f"the array {spoiled[0]} of {path} was altered (its SHA-256 is not the one "
            "written with it), so the run cannot be repeated; copy the file again"
        )
    return RunRecord(head, arrays, tuple(altered))


def _write(record: RunRecord, stream: BinaryIO) -> None:
    table = {name: _digest(array) for name, array in record.arrays.items()}
    head = {**record.head, "arrays": table}
    head["sha256"] = _body_hash(head)
    text = json.dumps(head, indent=1, sort_keys=True) + "\n"
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        _add(archive, HEAD, text.encode())
        for name in sorted(record.arrays):
            data = io.BytesIO()
            array = np.ascontiguousarray(record.arrays[name])
            np.lib.format.write_array(data, array, (1, 0), allow_pickle=False)
            _add(archive, f"{name}.npy", data.getvalue())


def _add(archive: zipfile.ZipFile, name: str, data: bytes) -> None:
    info = zipfile.ZipInfo(name, _START)
    info.create_system, info.external_attr = 3, 0o644 << 16
    archive.writestr(info, data)


def _digest(array: np.ndarray) -> str:
    digest = hashlib.sha256(f"{array.dtype.str} {array.shape}".encode())
    digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _body_hash(head: dict) -> str:
    body = {k: v for k, v in head.items() if k != "sha256"}
    return hashlib.sha256(json.dumps(body, sort_keys=True).encode()).hexdigest()


def _members(path: Path) -> dict[str, bytes]:
    try:
        return read_members(path)
    except FileNotFoundError as error:
        raise BadRecord(f"there is no file {path}; give a recording") from error
    except IsADirectoryError as error:
        raise BadRecord(
            f"{path} is a folder, not a recording; of a map say --map {path}"
        ) from error
    except TooLarge as error:
        raise BadRecord(str(error)) from error
    except ValueError as error:
        raise BadRecord(
            f"the recording {path} is truncated or damaged ({error}); copy it again"
        ) from error


def _head(path: str | Path, text: bytes) -> dict:
    try:
        head = json.loads(text)
        version, written = head["format"], head.pop("sha256")
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise BadRecord(
            f"the {HEAD} of {path} cannot be read ({error}); record the run again"
        ) from error
    if version not in range(FORMAT, TARGETS + 1):
        remedy = "record the run again"
        if isinstance(version, int) and version > TARGETS:
            remedy = "update odm-planner"
        raise BadRecord(
            f"{path} has the recording format {version}, but this program reads "
            f"{FORMAT} to {TARGETS}; {remedy}"
        )
    if written != _body_hash(head):
        raise BadRecord(
            f"the {HEAD} of {path} was altered (its hash does not match); copy the "
            "file again"
        )
    return head


def _array(path: str | Path, members: dict[str, bytes], name: str) -> np.ndarray:
    file = f"{name}.npy"
    if file not in members:
        raise BadRecord(f"the array {name} of {path} is missing; copy the file again")
    try:
        return array_of(members[file])
    except ValueError as error:
        raise BadRecord(
            f"the array {name} of {path} is truncated or damaged ({error}); copy the "
            "file again"
        ) from error
