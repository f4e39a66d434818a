"""Chunks of a build on a Dask cluster: the user's scheduler, or one made here.

A chunk is a task that may be done anywhere and any number of times. Where a worker
dies, its chunks are done by another; where the scheduler goes away, what was finished
is stored here, and the rest is handed to the scheduler that comes back. Before any work
every worker says which program it runs: another one is refused.

Workers made here are forked from a process that loads the program once. They start
while this process makes ready what they will be given.
"""

import logging
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any

from roadmap.builds import chunks
from roadmap.builds.chunks import (
    Arrays,
    Chunk,
    ChunkStore,
    ForeignWorker,
    Job,
    about,
    chunk_name,
    do_chunk,
    packed,
    unpacked,
)
from roadmap.errors import BadInput, BuildRefused

_AHEAD = 6  # chunks handed out for each thread of the workers
_MOST_LOST = 20  # times that a chunk is handed out again
_LOOK_S = 0.5  # between two looks at the workers while nothing is done
_PAUSE_S = 0.05  # after a cluster lost what was waited for
_GIVEN = ".given"  # ending of the file with what a chunk takes
_CLOSE_S = 10.0  # for the workers of a cluster that was made here
_CONNECT_S = 10.0  # one try to reach a scheduler
_FIRST_S = 10.0  # a scheduler that was never there is not waited for longer
_LOST = CancelledError, OSError  # the cluster lost it: ask again; timeouts, too
PATIENCE_S = 60.0  # a scheduler that went away may come back within


class Cluster(AbstractContextManager):
    """Does chunks on a Dask cluster.

    Args:
        workers: Make a cluster on this machine with so many processes.
        scheduler: Address of one that runs, such as "tcp://host:8786".
        store: Where finished chunks are kept here; found again by the next build.
        shared: Folder that all workers see too: what chunks take and what comes of
            them lies there, so that nothing goes through the scheduler but names.
            None: it goes over the network.
        patience: How long a scheduler may be away [s].
        loads: Module that jobs will need; workers load it while this process still
            makes ready what they will be given. None: with the first chunk.

    Workers made here start in the background; `ready` waits for them, as `map` does.

    Raises:
        BadInput: The address is none.
        BuildRefused: `distributed` is not installed, or no scheduler answers.
        ForeignWorker: A worker runs another version.
    """

    def __init__(
        self,
        workers: int = 0,
        scheduler: str | None = None,
        store: ChunkStore | None = None,
        shared: Path | None = None,
        patience: float = PATIENCE_S,
        loads: str | None = None,
    ) -> None:
        if (scheduler is None) == (workers == 0):
            raise BadInput("give either a number of workers or the scheduler's address")
        self.dask = _distributed()
        # what goes wrong is told in one sentence, not by their log
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        self.store, self.shared, self.patience = store, shared, patience
        if shared is not None and store is None:
            self.store = ChunkStore(shared)
        self.address, self.threads = scheduler or "", 0
        self.client: Any = None
        self._local: Any = None
        self._settings: Any = None
        self._starting: Future | None = None
        if scheduler is None:
            starter = ThreadPoolExecutor(1, "start of workers")
            self._starting = starter.submit(self._start, workers, loads)
            starter.shutdown(wait=False)
        else:
            self._connect(time.monotonic() + min(patience, _FIRST_S))
            self._loading = [] if loads is None else self._load(loads)

    def _start(self, workers: int, loads: str | None) -> None:
        """Make a cluster here, and look at its workers."""
        self._settings = _quiet_settings()
        self._local = self.dask.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            dashboard_address=":0",
            silence_logs=40,
        )
        self.address = self._local.scheduler_address
        self._connect(time.monotonic() + min(self.patience, _FIRST_S), workers)
        self._loading = [] if loads is None else self._load(loads)

    def ready(self) -> "Cluster":
        """Wait until workers are there.

        Raises:
            BuildRefused: None came.
            ForeignWorker: A worker runs another version.
        """
        if self._starting is not None:
            self._starting.result()
            self._starting = None
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the user's cluster as it is; end one that was made here."""
        with suppress(Exception):
            self.ready()
        with suppress(Exception):
            self.client.close(timeout=2)
        if self._local is not None:
            with suppress(Exception):  # one that just starts is slow to end
                self._local.close(timeout=_CLOSE_S)
        if self._settings is not None:
            self._settings.__exit__(None, None, None)

    def tell_dashboard(self, tell: Callable[[str], None]) -> None:
        """Tell the address of the page that shows progress, once workers are there.

        Nothing is told where there is no page: `bokeh` is not installed.
        """

        def show(started: Future | None) -> None:
            if find_spec("bokeh") and not (started and started.exception()):
                tell(str(self.client.dashboard_link))

        if self._starting is None:
            show(None)
        else:
            self._starting.add_done_callback(show)

    def map(self, job: Job, parts: Iterable[Chunk]) -> Iterator[Arrays]:
        """Yield what comes of each chunk, in order.

        Raises ChunkFailed for an item, ForeignWorker for one that came later,
        BuildRefused where scheduler or disk fails or a chunk ends every worker that
        tries it.
        """
        hand = _Hand(self.ready(), job)
        source = iter(parts)
        waiting: deque[_Sent] = deque()
        try:
            while True:
                room = _AHEAD * max(1, self.threads) - len(waiting)
                waiting.extend(hand.send(chunk) for chunk in islice(source, room))
                if not waiting:
                    return
                yield hand.take(waiting)
        finally:
            hand.drop(waiting)

    def _connect(self, until: float, workers: int = 1) -> None:
        """Reach the scheduler and look at its workers until a time, or refuse."""
        _check_address(self.address)
        while True:
            left = min(_CONNECT_S, max(0.5, until - time.monotonic()))
            try:
                self.client = self.dask.Client(
                    self.address, timeout=left, set_as_default=False
                )
                self.client.wait_for_workers(workers, timeout=left)
                break
            except OSError as error:
                with suppress(Exception):
                    self.client.close(timeout=1)
                if time.monotonic() > until:
                    raise BuildRefused(
                        f"no scheduler with workers answers at {self.address} "
                        f"({type(error).__name__}); start both and give the same "
                        "command again: finished chunks are kept"
                    ) from error
                time.sleep(0.2)
        refuse_foreign(self.client.run(chunks.about, on_error="return"))
        self.threads = sum(self.client.nthreads().values())

    def _load(self, module: str) -> list[Any]:
        """Let every worker load a module; nobody waits for it, and it may fail."""
        return [
            self.client.submit(_loaded, module, workers=[address], pure=False)
            for address in self.client.nthreads()
        ]

    def again(self) -> None:
        """Reach the scheduler again, which went away."""
        with suppress(Exception):
            self.client.close(timeout=1)
        self._connect(time.monotonic() + self.patience)


@dataclass(eq=False)
class _Sent:
    """A chunk that was handed out: its future, or what was stored before."""

    chunk: Chunk
    name: str
    found: Arrays | None = None
    future: Any = None


class _Hand:
    """Hands the chunks of one job to a cluster and takes them back."""

    def __init__(self, cluster: Cluster, job: Job) -> None:
        self.cluster, self.job, self.key = cluster, job, job.key()
        self._job_there: Any = None
        # what workers are given lies there, too: only names go through the scheduler
        shared = cluster.shared
        self._given = None if shared is None else ChunkStore(shared)

    def send(self, chunk: Chunk) -> _Sent:
        """Hand a chunk out, unless it is stored."""
        sent = _Sent(chunk, chunk_name(self.key, chunk))
        store = self.cluster.store
        if store is not None:
            sent.found = store.get(sent.name)
        if sent.found is None:
            self._submit(sent)
        return sent

    def take(self, waiting: deque[_Sent]) -> Arrays:
        """Wait for the first chunk, and return what came of it."""
        lost, seen = 0, time.monotonic()
        while (sent := waiting[0]).found is None:
            try:
                error = sent.future.exception(timeout=_LOOK_S)
            except TimeoutError as late:
                if not self._is_away():
                    seen = self._last_seen(seen)
                    continue
                error = late
            except Exception:  # it was not handed out, or lost, or the scheduler was
                time.sleep(_PAUSE_S)
                error = CancelledError()
            if error is None:
                with suppress(*_LOST):
                    self._store(sent)
                    continue
            elif not isinstance(error, _LOST):
                raise self._explained(sent, error) from error
            lost += 1
            if lost > _MOST_LOST:
                raise BuildRefused(
                    f"{self._named(sent)} was lost {lost} times; look at the "
                    "workers' logs and give the same command again"
                )
            self._recover(waiting)
        return waiting.popleft().found or ()

    def _last_seen(self, seen: float) -> float:
        """Return when workers were last there; BuildRefused if that is too long ago.

        It asks the scheduler over the network: not while chunks are done.
        """
        if self.cluster.client.scheduler_info()["workers"]:
            return time.monotonic()
        if time.monotonic() - seen > self.cluster.patience:
            raise BuildRefused(
                f"all workers of {self.cluster.address} have gone; start some and "
                "give the same command again: finished chunks are kept"
            )
        return seen

    def drop(self, waiting: deque[_Sent]) -> None:
        """Cancel what is no longer wanted."""
        with suppress(Exception):
            self.cluster.client.cancel([s.future for s in waiting if s.future])

    def _submit(self, sent: _Sent) -> None:
        client, sent.future = self.cluster.client, None
        with suppress(*_LOST):
            if self._job_there is None:
                self._job_there = client.scatter(self.job, broadcast=True, hash=False)
            chunk, shared = sent.chunk, self.cluster.shared
            if self._given is not None:
                self._given.put(sent.name + _GIVEN, chunk.arrays)
                chunk = replace(chunk, arrays=())
            key = f"{self.job.stage.replace(' ', '_')}-{sent.name[:16]}"
            arguments = (self._job_there, self.key, chunk, sent.name, about(), shared)
            sent.future = client.submit(work, *arguments, key=key, pure=False)

    def _store(self, sent: _Sent) -> None:
        """Take what came of a chunk, and keep it here."""
        store = self.cluster.store
        if self._given is not None:
            sent.found = store.get(sent.name) if store else None
            if store and sent.found:
                store.found -= 1  # it was done just now
            self._given.remove(sent.name + _GIVEN)
            if sent.found is None:
                raise BuildRefused(
                    f"{self._named(sent)} is done, but its file is not in "
                    f"{self.cluster.shared} here; give a folder that this machine "
                    "and all workers share"
                )
            sent.future.release()
            return
        sent.found = unpacked(sent.future.result())
        if store is not None:
            store.put(sent.name, sent.found)
        sent.future.release()

    def _explained(self, sent: _Sent, error: Exception) -> Exception:
        """Return what is told of an error that a chunk raised."""
        if isinstance(error, BuildRefused):
            return error
        why = f"failed on a worker: {type(error).__name__} ({error})"
        remedy = "give the same command again once that is mended"
        if isinstance(error, self.cluster.dask.scheduler.KilledWorker):
            why = f"ended {error.allowed_failures + 1} workers, one after the other"
            remedy = "give them more memory and give the same command again"
        return BuildRefused(f"{self._named(sent)} {why}; {remedy}")

    def _recover(self, waiting: deque[_Sent]) -> None:
        """Keep what is finished, then hand the rest out again."""
        for sent in waiting:
            done = sent.future is not None and sent.future.status == "finished"
            if sent.found is None and done:
                with suppress(*_LOST):
                    self._store(sent)
        if self._is_away():
            self.cluster.again()
        self._job_there = None
        for sent in waiting:
            if sent.found is None:
                self._submit(sent)

    def _is_away(self) -> bool:
        return self.cluster.client.status != "running"

    def _named(self, sent: _Sent) -> str:
        first = sent.chunk.first
        last = first + len(sent.chunk.arrays[0]) - 1
        return f"the chunk of {self.job.stage}s {first} to {last}"


def work(
    job: Job,
    key: str,
    chunk: Chunk,
    name: str,
    wanted: dict[str, str],
    shared: Path | None,
) -> bytes | None:
    """Do a chunk on a worker.

    Returns:
        Its arrays as bytes. None where there is a shared folder: what the chunk takes
        was read there, and what came of it was written.
    """
    if about() != wanted:
        raise ForeignWorker(_foreign("this worker", about(), wanted))
    if shared is None:
        return packed(do_chunk(job, key, chunk))
    folder = ChunkStore(shared)
    given = folder.get(name + _GIVEN)
    if given is None:
        raise BuildRefused(
            f"a worker does not see what it was given in {shared}; give a folder that "
            "this machine and all workers share, and give the same command again"
        )
    folder.put(name, do_chunk(job, key, replace(chunk, arrays=given)))
    return None


def _loaded(module: str) -> None:
    with suppress(Exception):  # the first chunk tells what is wrong
        import_module(module)


def refuse_foreign(workers: dict[str, Any]) -> None:
    """Refuse workers, by address, that run another program; say what differs."""
    for address, found in workers.items():
        if found != about():
            raise ForeignWorker(_foreign(f"worker {address}", found, about()))


def _foreign(who: str, found: object, wanted: dict[str, str]) -> str:
    if not isinstance(found, dict):
        what = f"cannot load this program ({found})"
    else:
        other = [
            f"{k} {found.get(k)} instead of {v}"
            for k, v in wanted.items()
            if found.get(k) != v
        ]
        what = f"has {', '.join(other)}"
    return (
        f"{who} {what}, so its chunks could hold other bytes; install the same "
        "versions there and here and give the same command again"
    )


def _check_address(address: str) -> None:
    """Refuse a name without a port, or another protocol, before a client begins.

    One that was begun with it would wait for 20 s at its end, and complain.
    """
    from distributed.comm.addressing import get_address_host_port

    if address.startswith("inproc://"):  # a scheduler of this process has no port
        return
    try:
        get_address_host_port(address)
    except ValueError as error:
        raise BadInput(
            f"the scheduler's address is {address!r} ({error}); give one such as "
            "tcp://host:8786"
        ) from error


def _distributed() -> Any:  # noqa: ANN401 (a module)
    try:
        import distributed
    except ImportError as error:
        raise BuildRefused(
            "the package `distributed` is not installed; install it with: "
            "pip install 'odm-planner[cluster]', or build with --threads instead"
        ) from error
    return distributed


def _quiet_settings() -> Any:  # noqa: ANN401 (a context of dask)
    """Set how workers made here start; they do not watch themselves at work."""
    import dask.config as config

    return config.set(
        {
            "distributed.worker.profile.enabled": False,
            "distributed.worker.multiprocessing-method": "forkserver",
            "distributed.admin.system-monitor.interval": "5s",
            "distributed.admin.tick.interval": "500ms",
            "distributed.worker.memory.monitor-interval": "1s",
        }
    )
