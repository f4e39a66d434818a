"""Work in chunks: pure functions of arrays, done by threads, kept in a folder.

A build is cut into chunks of a few hundred items. What comes of a chunk depends on its
arrays and on nothing else, so it does not matter who does it, how often, or when: the
same bytes come out. A chunk's name is the SHA-256 of all that it depends on; what was
stored under that name by a build that was killed is taken instead of done again.
"""

import errno
import hashlib
import io
import os
import platform
import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from roadmap.builds.unfinished import put_file
from roadmap.errors import BuildRefused

Arrays = tuple[np.ndarray, ...]
Progress = Callable[[str, int, int], None]  # called with stage, done, total
_PACKAGES = ("roadmap", "odm", "handover")  # whose text decides what chunks hold
_DIGEST = 32  # bytes before what is stored
_AHEAD = 4  # chunks handed out, for each worker, before the first is taken back
_MADE: OrderedDict[str, Any] = OrderedDict()  # what jobs work with, the latest ones
_MOST_MADE = 4


@dataclass(frozen=True, eq=False)
class Job:
    """What is done to every chunk of a stage.

    Attributes:
        function: "module:name" of a function of (made, *arrays) -> tuple of arrays.
        maker: "module:name" of a function of `spec` -> `made`; done once a process.
        spec: What `made` is made of: plain values, arrays, dataclasses of them.
        stage: What an item is called, such as "edge".
        per_item: So many of the first arrays have one row for each item.
    """

    function: str
    maker: str
    spec: Any
    stage: str
    per_item: int

    def key(self) -> str:
        """Return a SHA-256 of the job and of the program that does it."""
        digest = hashlib.sha256()
        parts = self.function, self.maker, self.per_item, about(), self.spec
        _absorb(digest, parts)
        return digest.hexdigest()


@dataclass(frozen=True, eq=False)
class Chunk:
    """Some items of a stage.

    Attributes:
        first: Number of its first item.
        arrays: What the function takes.
    """

    first: int
    arrays: Arrays


class ChunkFailed(BuildRefused):
    """An item of a chunk raised an error."""


class ForeignWorker(BuildRefused):
    """A worker runs another version of the program."""


class Workers(Protocol):
    """Who does chunks: threads of this process, or a cluster."""

    def map(self, job: Job, parts: Iterable[Chunk]) -> Iterator[Arrays]:
        """Yield what comes of each chunk, in order."""
        ...


class ChunkStore:
    """Finished chunks in a folder, each whole or not there.

    Args:
        folder: Where; made when the first chunk is stored.

    Attributes:
        found: How many chunks were taken from here instead of done.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.found = folder, 0
        self._over, self._lock = False, threading.Lock()

    def get(self, name: str) -> Arrays | None:
        """Return a stored chunk; None where there is none, or a damaged one."""
        try:
            data = (self.folder / name).read_bytes()
        except OSError:
            return None
        if hashlib.sha256(data[_DIGEST:]).digest() != data[:_DIGEST]:
            return None
        self.found += 1
        return unpacked(data[_DIGEST:])

    def put(self, name: str, arrays: Arrays) -> None:
        """Store a chunk; BuildRefused where the disk is full or may not be written."""
        data = packed(arrays)
        try:
            with self._lock:
                if self._over:
                    return
                put_file(self.folder / name, hashlib.sha256(data).digest() + data)
        except OSError as error:
            raise _unwritten(self.folder, error) from error

    def remove(self, name: str) -> None:
        """Remove a stored chunk, if it is there."""
        (self.folder / name).unlink(missing_ok=True)

    def discard(self) -> None:
        """Remove what is stored, and store nothing more."""
        with self._lock:
            self._over = True
        self.clear()

    def clear(self) -> None:
        """Remove what is stored; the map is there."""
        with suppress(OSError):
            for file in self.folder.iterdir():
                file.unlink()
            self.folder.rmdir()


def _unwritten(folder: Path, error: OSError) -> BuildRefused:
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    why = "the disk is full" if full else str(error)
    remedy = "make room" if full else "choose another folder or mend that"
    return BuildRefused(
        f"a finished part of the build cannot be stored in {folder}: {why}; {remedy}, "
        "and give the same command again: it goes on where it was"
    )


def packed(arrays: Arrays) -> bytes:
    """Return arrays as bytes."""
    stream = io.BytesIO()
    for array in arrays:
        np.save(stream, np.ascontiguousarray(array), allow_pickle=False)
    return stream.getvalue()


def unpacked(data: bytes) -> Arrays:
    """Return arrays that `packed` made bytes of."""
    stream, found = io.BytesIO(data), []
    while stream.tell() < len(data):
        found.append(np.load(stream, allow_pickle=False))
    return tuple(found)


@cache
def about() -> dict[str, str]:
    """Return all of this program that decides what a chunk's bytes are."""
    import numba
    import scipy

    text = hashlib.sha256()
    for package in _PACKAGES:
        found = find_spec(package)
        if found is None or found.origin is None:
            continue
        folder = Path(found.origin).parent
        for file in sorted(folder.rglob("*.py")):
            text.update(str(file.relative_to(folder)).encode() + file.read_bytes())
    return {
        "program": text.hexdigest()[:16],
        "python": platform.python_version(),
        "numpy": np.__version__,
        "numba": numba.__version__,
        "scipy": scipy.__version__,
        "machine": platform.machine(),
    }


def _absorb(digest: "hashlib._Hash", value: object) -> None:
    """Take a value into a digest: the same content, the same digest."""
    digest.update(type(value).__name__.encode())
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).data)
    elif isinstance(value, tuple | list):
        digest.update(str(len(value)).encode())
        for part in value:
            _absorb(digest, part)
    elif isinstance(value, dict):
        _absorb(digest, sorted(value.items()))
    elif is_dataclass(value) and not isinstance(value, type):
        for each in fields(value):
            _absorb(digest, (each.name, getattr(value, each.name)))
    elif value is None or isinstance(value, str | int | float | np.generic | Path):
        digest.update(f"{value!r};".encode())
    else:
        raise TypeError(f"a job's spec holds a {type(value).__name__}: {value!r}")


def chunk_name(key: str, chunk: Chunk) -> str:
    """Return the name of a chunk of the job with that key."""
    digest = hashlib.sha256(key.encode())
    _absorb(digest, chunk.arrays)
    return digest.hexdigest()


def do_chunk(job: Job, key: str, chunk: Chunk) -> Arrays:
    """Do a chunk here; ChunkFailed names the item that raised.

    What the job makes first is kept under its `key`.
    """
    made = _made(job, key)
    function = _named(job.function)
    try:
        return function(made, *chunk.arrays)
    except Exception as error:
        raise _blamed(job, made, chunk, error) from error


def _made(job: Job, key: str) -> Any:  # noqa: ANN401
    """Return what a job works with; of another thread's twin the first one stays."""
    if key not in _MADE:
        made = _named(job.maker)(job.spec)
        _MADE.setdefault(key, made)
        while len(_MADE) > _MOST_MADE:
            _MADE.popitem(last=False)
        return made
    return _MADE[key]


def _named(name: str) -> Callable:
    module, _, function = name.partition(":")
    return getattr(import_module(module), function)


def _blamed(job: Job, made: object, chunk: Chunk, error: Exception) -> BuildRefused:
    """Return an error that names the item; each is done alone to find it."""
    function, n = _named(job.function), job.per_item
    for k in range(len(chunk.arrays[0])):
        rows = (a[k : k + 1] for a in chunk.arrays[:n])
        try:
            function(made, *rows, *chunk.arrays[n:])
        except Exception as alone:
            text = f"{job.stage} {chunk.first + k} failed: {_sentence(alone)}"
            return ChunkFailed(
                f"{text}; the map was not built, and chunks that are done are kept; "
                "give the same command again once that is mended"
            )
    last = chunk.first + len(chunk.arrays[0]) - 1
    return ChunkFailed(
        f"{job.stage}s {chunk.first} to {last} failed together, though not one by one: "
        f"{_sentence(error)}; give the same command again"
    )


def _sentence(error: Exception) -> str:
    return f"{type(error).__name__} ({error})"


class Threads:
    """Does chunks in threads of this process.

    Args:
        threads: How many; 0 means one per core.
        store: Where finished chunks are kept, and found again; None: nowhere.
    """

    def __init__(self, threads: int = 0, store: ChunkStore | None = None) -> None:
        self.threads, self.store = threads or os.cpu_count() or 1, store

    def map(self, job: Job, parts: Iterable[Chunk]) -> Iterator[Arrays]:
        """Yield what comes of each chunk, in order; only a few are done ahead."""
        key = job.key()
        pool = ThreadPoolExecutor(self.threads)
        waiting: deque[Future] = deque()
        try:
            for chunk in parts:
                waiting.append(pool.submit(self._do, job, key, chunk))
                if len(waiting) >= _AHEAD * self.threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)

    def _do(self, job: Job, key: str, chunk: Chunk) -> Arrays:
        if self.store is None:
            return do_chunk(job, key, chunk)
        name = chunk_name(key, chunk)
        found = self.store.get(name)
        if found is None:
            found = do_chunk(job, key, chunk)
            self.store.put(name, found)
        return found
