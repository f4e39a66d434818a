"""Machine code of compiled loops: loaded before a call, made undisturbed, listed.

Ctrl-C in the middle of the compiler leaves what numba and LLVM have noted half noted:
in a notebook no loop is compiled any more, or the process crashes. So it is raised when
a loop is done; a second one is raised at once. (A command has a handler of its own.)

Numba keeps a list beside each loop: types, and the file that holds their machine code.
It reads the list, takes the next free number, writes the list, then the file, and locks
nothing. Two processes that compile the loop for other types at the same moment take the
same number, and the list then names the machine code of other types. Ours compile ahead
with all cores, so they take turns.

Nor does numba look whether a file is whole. After a power cut it may hold half of what
was written, or pages of zeros: no command starts any more, or damaged machine code is
run. So each file ends with a checksum, and what is damaged counts as not kept.
"""

import io
import os
import pickle
import signal
import struct
import threading
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from numba.core import caching
from numba.core.dispatcher import Dispatcher

from roadmap.errors import PlanningError

_LOCK = "numba.lock"  # beside the machine code; empty
_SEAL = b"crc32 of the above:"  # at the end of a file, then the checksum's four bytes
_ENDING = (signal.SIGTERM, signal.SIGHUP)
# what unpickling half a file raises
_HALF = (pickle.UnpicklingError, ArithmeticError, AttributeError, EOFError, ImportError)
_HALF += (LookupError, TypeError, ValueError)


class GuardedFile(caching.IndexDataCacheFile):
    """Numba's files of one loop, listed by one process at a time, and looked at.

    A file without a checksum, which a program without us made, is loaded as long as it
    can be read.
    """

    def save(self, key: object, data: object) -> None:
        """Keep machine code; where the disk is full, PlanningError names the folder."""
        with _turn(Path(self._cache_path)), _not_ended():
            try:
                super().save(key, data)
            except OSError as error:
                raise PlanningError(
                    f"compiled loops cannot be kept in {self._cache_path}: "
                    f"{error.strerror}; free some room, or set NUMBA_CACHE_DIR to a "
                    "folder of your own that stays"
                ) from error

    @contextmanager
    def _open_for_write(self, path: str) -> Iterator[io.BytesIO]:
        written = io.BytesIO()
        yield written
        with super()._open_for_write(path) as file:
            file.write(written.getvalue() + _seal(written.getvalue()))

    def _load_index(self) -> dict:
        """Return what is kept; nothing where the list is damaged."""
        if _is_whole(self._index_path):
            with suppress(*_HALF):
                return super()._load_index()
        return {}

    def _load_data(self, name: str) -> object:
        """Return machine code; numba takes an OSError for a file that is gone."""
        path = self._data_path(name)
        if _is_whole(path):
            with suppress(*_HALF):
                return super()._load_data(name)
        raise FileNotFoundError(f"{path} is damaged")


class KeptTypes(GuardedFile):
    """The types of arguments for which code of a compiled loop is kept."""

    def __init__(self, loop: Dispatcher) -> None:
        kept = caching.CompileResultCacheImpl(loop.py_func)
        place = kept.locator
        super().__init__(
            place.get_cache_path(), kept.filename_base, place.get_source_stamp()
        )

    def on(self, machine: tuple) -> list[tuple]:
        """Return the types of code that was made for this kind of processor."""
        return [types for types, kind, _ in self._load_index() if kind == machine]


@contextmanager
def undisturbed() -> Iterator[None]:
    """Raise behind this what Python's own handler would raise in it, in any case once.

    Other threads than the main one hear no signal.
    """
    own = signal.default_int_handler
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or signal.getsignal(signal.SIGINT) is not own:
        yield
        return
    heard: list[int] = []

    def note(number: int, frame: object) -> None:
        heard.append(number)
        if len(heard) > 1:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, own)
        if heard:
            raise KeyboardInterrupt


@contextmanager
def _not_ended() -> Iterator[None]:
    """End behind this what would end the process in it, and leave half a file.

    Signals that somebody hears are left to him, and so are other threads' files.
    """
    heard: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ending = [n for n in _ENDING if signal.getsignal(n) is signal.SIG_DFL]
    for number in ending:
        signal.signal(number, lambda number, frame: heard.append(number))
    try:
        yield
    finally:
        for number in ending:
            signal.signal(number, signal.SIG_DFL)
        if heard:
            os.kill(os.getpid(), heard[0])


def load_kept(loops: Iterable[Dispatcher]) -> int:
    """Load what is kept of compiled loops; return for how many types of arguments.

    A start ahead and no more: what cannot be loaded is left to the first call.
    """
    loaded = 0
    for loop in loops:
        with suppress(Exception):  # other versions of numba keep it in another way
            machine = loop.targetctx.codegen().magic_tuple()
            for types in KeptTypes(loop).on(machine):
                loop.compile(types)
                loaded += 1
    return loaded


def guard_kept_code() -> None:
    """Have numba keep the machine code of all loops in files that are guarded."""
    caching.IndexDataCacheFile = GuardedFile


def _is_whole(path: str) -> bool:
    """Return whether a file holds what its checksum says; else it has none yet."""
    data = Path(path).read_bytes() if os.path.exists(path) else b""
    above, seal, _ = data.rpartition(_SEAL)
    return not seal or data[len(above) :] == _seal(above)


def _seal(data: bytes) -> bytes:
    return _SEAL + struct.pack("<I", zlib.crc32(data))


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
