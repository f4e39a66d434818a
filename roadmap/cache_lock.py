"""One process at a time lists a loop's machine code: numba itself locks nothing.

Numba keeps a list beside each loop: types, and the file that holds their machine code.
It reads the list, takes the next free number, writes the list, then the file. Two
processes that compile the loop for other types at the same moment take the same number,
and the list then names the machine code of other types. Ours compile ahead with all
cores, so they take turns.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path

from numba.core.caching import IndexDataCacheFile

_LOCK = "numba.lock"  # beside the machine code; empty


def save_in_turn() -> None:
    """Let whatever numba keeps from now on be listed by one process at a time."""
    plain = IndexDataCacheFile.save
    if getattr(plain, "is_in_turn", False):
        return

    @wraps(plain)
    def save(self: IndexDataCacheFile, key: object, data: object) -> None:
        with _turn(Path(self._cache_path)):
            plain(self, key, data)

    vars(save)["is_in_turn"] = True
    IndexDataCacheFile.save = save


@contextmanager
def _turn(folder: Path) -> Iterator[None]:
    """Wait until no other process or thread is in such a block for the folder.

    A process that ends, however it does, leaves it. Where the system has no such locks,
    or the folder cannot be written, nobody waits.
    """
    file = None
    with suppress(ImportError, OSError):
        import fcntl

        file = (folder / _LOCK).open("a")
        fcntl.flock(file, fcntl.LOCK_EX)
    try:
        yield
    finally:
        if file is not None:
            file.close()
