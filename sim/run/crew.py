"""Who does the chunks of a build: threads here, processes here, or a user's cluster."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from roadmap.chunks import Workers


@dataclass(frozen=True)
class Place:
    """Where chunks are done.

    Attributes:
        workers: Processes of a cluster that is made here; 0: none.
        scheduler: Address of a cluster that runs; None: none.
        shared: Folder that its workers see, too; None: results come over the network.
    """

    workers: int = 0
    scheduler: str | None = None
    shared: Path | None = None


HERE = Place()


def chunk_folder(target: Path, shared: Path | None = None) -> Path:
    """Return where the finished chunks of what is built to `target` are kept."""
    return (shared or target.parent) / f".{target.name}.chunks"


@contextmanager
def crew(
    target: Path, threads: int, place: Place, loads: str | None = None
) -> Iterator["Workers"]:
    """Yield who does the chunks; they are kept beside `target` until it is there.

    Those of threads go, too, where somebody presses Ctrl-C.

    Args:
        target: What is built.
        threads: Of this process, where there is no cluster; 0: one per core.
        place: Where they are done.
        loads: Module that the chunks need; processes load it ahead.

    Raises:
        BadInput: Two clusters are asked for, or a shared folder without one.
        BuildRefused: There is no cluster, or one of other versions.
    """
    from roadmap.chunks import ChunkStore, Threads
    from roadmap.errors import BadInput
    from roadmap.unfinished import kept_unless_ended

    if place.workers and place.scheduler:
        raise BadInput(
            "--workers makes a cluster and --scheduler takes one that runs; leave one "
            "of them out"
        )
    is_cluster = bool(place.workers or place.scheduler)
    if place.shared is not None and not is_cluster:
        raise BadInput("--shared is for clusters; give --workers or --scheduler, too")
    store = ChunkStore(chunk_folder(target, place.shared))
    if not is_cluster:
        with kept_unless_ended(store.folder):
            try:
                yield Threads(threads, store)
            except KeyboardInterrupt:  # who ends it by hand wants nothing left
                store.discard()
                raise
    else:
        from roadmap.cluster import Cluster

        # processes here see the folder, so that nothing goes through the scheduler
        sees = place.shared is not None or place.workers > 0
        with Cluster(
            place.workers,
            place.scheduler,
            store,
            shared=store.folder.absolute() if sees else None,
            loads=loads,
        ) as cluster:
            if cluster.dashboard:
                print(f"progress is on {cluster.dashboard}", file=sys.stderr)
            yield cluster
    if store.found:
        print(f"went on from {store.found} stored chunks", file=sys.stderr)
    store.clear()
