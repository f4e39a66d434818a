"""Files and folders that are being written: gone unless they were finished.

What is written here has a name of its own beside its target and is renamed in the
end. Whoever ends the process from another thread removes the rest, see `remove_all`;
from then on no thread gets a name or puts a file here: it waits for the end.
"""

import errno
import os
import secrets
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_PATHS: set[Path] = set()  # a path is entered before anything is there
_PUTTING = threading.Lock()  # for a moment the old folder has no other name
_ENDED = threading.Event()  # the process is about to be ended: nothing more is made


def is_special(path: Path) -> bool:
    """Return whether there is something that is neither a file nor a folder."""
    return path.exists() and not path.is_file() and not path.is_dir()


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """Yield a free name beside `path`; what is still there at the end is removed.

    OSError for a device or a pipe, which a file renamed to it would replace. One that
    says of no file that it could not be written, as of a full disk, is told of `path`.
    """
    if is_special(path):
        raise OSError(errno.EINVAL, "is a device or a pipe; name a file", str(path))
    made = path.parent / f".{path.name}.{secrets.token_hex(6)}"
    _PATHS.add(made)
    _wait_where_ended()
    try:
        yield made
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = str(path)
        raise
    finally:
        _remove(made)
        _PATHS.discard(made)


@contextmanager
def kept_unless_ended(path: Path) -> Iterator[None]:
    """Let a folder be removed where the process is ended by hand; else it stays.

    What ended with an error stays, too, unless the process is ended by hand after all:
    Ctrl-C may reach us as another error, and a moment later than that.
    """
    _PATHS.add(path)
    _wait_where_ended()
    yield
    _PATHS.discard(path)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Yield an empty folder in the system's place for such, removed at the end."""
    with beside(Path(tempfile.gettempdir(), "odm")) as made:
        made.mkdir(0o700)
        yield made


def put(made: Path, path: Path) -> None:
    """Rename a finished folder to `path`; an old one there goes, but not before."""
    with beside(path) as old, _PUTTING:
        try:
            if path.exists():
                os.rename(path, old)
            os.rename(made, path)
        except BaseException:
            if old.exists() and not path.exists():
                os.rename(old, path)
            raise


def put_file(path: Path, data: bytes) -> None:
    """Write a small file whole or not at all; an old one there is replaced.

    Its folder is made where there is none, but not behind `remove_all`.
    """
    with _PUTTING, beside(path) as made:
        path.parent.mkdir(parents=True, exist_ok=True)
        made.write_bytes(data)
        os.replace(made, path)


def remove_all() -> None:
    """Remove what is unfinished, as the last thing before the process is ended.

    Other threads may still write it, but they can put nothing in its place any more,
    nor begin anything. What one of them was about to make under a name that it had, a
    second call removes: the last line before the end.
    """
    is_first = not _ENDED.is_set()
    _ENDED.set()
    if is_first:
        _PUTTING.acquire(timeout=1.0)
    for path in list(_PATHS):
        _remove(path)


def _wait_where_ended() -> None:
    while _ENDED.is_set():  # another thread ends the process
        time.sleep(1.0)


def _remove(path: Path) -> None:
    """Remove a path, and what is left of it where Ctrl-C cut that in two before."""
    gone = path.with_name(f"{path.name}.gone")
    _delete(gone)
    with suppress(OSError):  # by another name nothing new is written into it
        os.rename(path, gone)
    _delete(gone)


def _delete(path: Path) -> None:
    with suppress(OSError):
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()
