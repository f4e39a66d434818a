"""Reading .npz files from elsewhere: nothing is unpacked before its size is known.

An archive of half a megabyte can unpack to a gigabyte and more, and an array of a
hundred bytes can claim any shape. Both are told in the file, and looked at first.
"""

import errno
import io
import math
import warnings
import zipfile
import zlib
from pathlib import Path

import numpy as np

MOST_BYTES = 1 << 28  # unpacked, or
MOST_TIMES = 20  # as many times the size of the file; real data shrink to a third
PLAIN = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # others unpack without a bound

Damage = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    ValueError,
    NotImplementedError,
    RuntimeError,
    OverflowError,
    MemoryError,
)


class TooLarge(ValueError):
    """A file would unpack to more than is read."""


def read_members(path: Path) -> dict[str, bytes]:
    """Return the members of an archive by name.

    Raises:
        OSError: The file cannot be read.
        TooLarge: It would unpack to more than `MOST_BYTES` and `MOST_TIMES` its size.
        ValueError: It is no sound .npz.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            rows = archive.infolist()
            _check_size(path, sum(row.file_size for row in rows))
            strange = [row.filename for row in rows if row.compress_type not in PLAIN]
            if strange:
                raise ValueError(f"{strange[0]} is packed in no way numpy does")
            return {row.filename: archive.read(row) for row in rows}
    except TooLarge:
        raise
    except (OSError, *Damage) as error:
        if isinstance(error, OSError) and error.errno != errno.EINVAL:
            raise  # that one is of a place before the file's beginning: bytes are gone
        # a damaged archive's names may be as long as its members
        raise ValueError(str(error)[:200] or type(error).__name__) from error


def array_of(data: bytes) -> np.ndarray:
    """Return the array of a .npy file's bytes; ValueError for what is damaged."""
    stream = io.BytesIO(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # damaged headers are read as Python
            version = np.lib.format.read_magic(stream)
            read = {
                (1, 0): np.lib.format.read_array_header_1_0,
                (2, 0): np.lib.format.read_array_header_2_0,
            }[version]
            shape, by_column, kind = read(stream)
    except Exception as error:  # the header is Python: it raises what it likes
        raise ValueError(f"its header cannot be read: {error}") from error
    begin = stream.tell()
    long = math.prod(shape) * kind.itemsize
    if kind.hasobject or min(shape, default=0) < 0 or long != len(data) - begin:
        raise ValueError(
            f"its header says {kind} {shape}, but {len(data) - begin} bytes follow"
        )
    if not long:
        return np.zeros(shape, kind)
    array = np.frombuffer(data, kind, offset=begin)
    return array.reshape(shape, order="F" if by_column else "C").copy()


def _check_size(path: Path, unpacked: int) -> None:
    most = max(MOST_BYTES, MOST_TIMES * path.stat().st_size)
    if unpacked > most:
        raise TooLarge(
            f"{path} unpacks to {unpacked / 1e6:.0f} MB, more than the "
            f"{most / 1e6:.0f} MB that are read of a file of its size; cut it into "
            "shorter ones"
        )
