"""Who does the chunks of a build: threads here, processes here, or a user's cluster."""

import multiprocessing
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from multiprocessing.forkserver import ensure_running
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from roadmap.builds.chunks import ChunkStore, Workers

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Place:
    """Where chunks are done."""

    workers: int = 0  # processes of a cluster that is made here; 0: none
    scheduler: str | None = None  # address of a cluster that runs; None: none
    # folder that its workers see, too; None: results come over the network
    shared: Path | None = None


HERE = Place()


def chunk_folder(target: Path, shared: Path | None = None) -> Path:
    """Return where the finished chunks of what is built to `target` are kept."""
    return (shared or target.parent) / f".{target.name}.chunks"


def begin_ahead(place: Place, loads: str) -> None:
    """Start the process that workers made here are forked from.

    It loads the module `loads` that their chunks need while this process still loads
    its own, so call this first; it does nothing where no workers are made, and nothing
    a second time.
    """
    if not place.workers or find_spec("distributed") is None:
        return
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["distributed", loads])
    kept = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # who has threads cannot fork
    try:
        ensure_running()
    finally:
        for name, value in kept.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def crew(
    target: Path, threads: int, place: Place, loads: str | None = None
) -> Iterator["Workers"]:
    """Yield who does the chunks; they are kept beside `target` until it is there.

    Threads (0: one per core) where there is no cluster; their chunks go where somebody
    presses Ctrl-C. Where nothing is free all chunks go, which nobody would go on from.
    Processes load the module `loads` ahead.

    Raises:
        BadInput: Two clusters are asked for, or a shared folder without one.
        BuildRefused: There is no cluster, or one of other versions.
    """
    from roadmap.builds.chunks import ChunkStore, Threads
    from roadmap.builds.unfinished import kept_unless_ended
    from roadmap.errors import BadInput, NothingFree

    if place.workers and place.scheduler:
        raise BadInput(
            "--workers makes a cluster and --scheduler takes one that runs; leave one "
            "of them out"
        )
    is_cluster = bool(place.workers or place.scheduler)
    if place.shared is not None and not is_cluster:
        raise BadInput("--shared is for clusters; give --workers or --scheduler, too")
    store = ChunkStore(chunk_folder(target, place.shared))
    if loads is not None:
        begin_ahead(place, loads)
    if not is_cluster:
        with kept_unless_ended(store.folder):
            try:
                yield Threads(threads, store)
                _done_with(store)
            # who ends it by hand wants nothing left
            except (KeyboardInterrupt, NothingFree):
                store.discard()
                raise
    else:
        from roadmap.builds.cluster import Cluster

        # processes here see the folder, so that nothing goes through the scheduler
        sees = place.shared is not None or place.workers > 0
        with Cluster(
            place.workers,
            place.scheduler,
            store,
            shared=store.folder.absolute() if sees else None,
            loads=loads,
        ) as cluster:
            cluster.tell_dashboard(
                lambda page: print(f"progress is on {page}", file=sys.stderr)
            )
            try:
                yield cluster
            except NothingFree:
                store.discard()
                raise
        _done_with(store)


def _done_with(store: "ChunkStore") -> None:
    """Remove the chunks of what is there now, whole, even where Ctrl-C comes here."""
    from roadmap.builds.unfinished import kept_unless_ended

    with kept_unless_ended(store.folder):
        if store.found:
            print(f"went on from {store.found} stored chunks", file=sys.stderr)
        store.clear()
