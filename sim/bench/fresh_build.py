"""A build in a process of its own, as a user starts it, and what it took of each core.

Nothing heavy is imported above: a build's own start counts, its imports included.
"""

import multiprocessing
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim.run.crew import Place, begin_ahead, crew

if TYPE_CHECKING:
    from roadmap.builds.chunks import Workers

_CODE = "odm.cell_map.chunk_code"
_LOOK_S = 5.0  # between two looks at processes that may have ended meanwhile


@dataclass(frozen=True)
class Took:
    """What a build took.

    Attributes:
        wall: From the start of its process to the loaded map [s].
        alone: CPU time of the process outside of the chunks: nobody helps there [s].
        ahead: CPU time of workers before the first chunk: they load meanwhile [s].
        chunks: CPU time of all processes while there are chunks [s].
        cpu: Of all processes, all in all [s].
        hash: Of the map.
    """

    wall: float
    alone: float
    ahead: float
    chunks: float
    cpu: float
    hash: str

    def on_free_cores(self, workers: int) -> float:
        """Return what the clock would show if each worker had a core of its own [s].

        Chunks are shared evenly; while this process is alone, one other core loads.
        """
        return max(self.alone, self.ahead) + self.chunks / workers


def fresh_build(recipe: str, nodes: int | None, workers: int, folder: Path) -> Took:
    """Build in a new process.

    Args:
        recipe: Name or path.
        nodes: Of its roadmap; None: as the recipe has it.
        workers: Processes of a cluster; 0: one process with one thread.
        folder: An empty one, for the map.
    """
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe(duplex=False)
    given = recipe, nodes, workers, folder, time.time(), there
    process = context.Process(target=_build, args=given)
    process.start()
    there.close()
    try:
        return here.recv()
    finally:
        process.join()


def _build(
    recipe: str,
    nodes: int | None,
    workers: int,
    folder: Path,
    begun: float,
    answer: Any,  # noqa: ANN401 (a connection)
) -> None:
    place = Place(workers=workers)
    begin_ahead(place, _CODE)
    from dataclasses import replace

    from odm import build_map, load_map, load_recipe

    asked = load_recipe(recipe)
    if nodes is not None:
        asked = replace(asked, roadmap=replace(asked.roadmap, nodes=nodes))
    with crew(folder / "map", 1, place, _CODE) as who:
        counted = _Counted(who)
        cell_map = build_map(asked, 0 if workers else 1, workers=counted)
        cell_map.save(folder / "map")
    made = load_map(folder / "map").hash
    own, others = time.process_time(), counted.others()
    chunks = counted.own + counted.of_others
    ahead = counted.ahead or 0.0
    took = time.time() - begun
    alone = own - counted.own
    answer.send(Took(took, alone, ahead, chunks, own + others, made))


class _Counted:
    """Hands chunks on to workers, and counts CPU time while there are any."""

    def __init__(self, who: "Workers") -> None:
        self.who, self.own, self.of_others = who, 0.0, 0.0
        self.ahead: float | None = None
        self._seen: dict[int, float] = {}
        self._looked = time.monotonic()

    def map(self, job: Any, parts: Any) -> Iterator:  # noqa: ANN401
        if hasattr(self.who, "ready"):
            self.who.ready()
        own, others = time.process_time(), self.others()
        if self.ahead is None:
            self.ahead = others
        for found in self.who.map(job, parts):
            if time.monotonic() > self._looked + _LOOK_S:
                self.others()
            yield found
        self.own += time.process_time() - own
        self.of_others += self.others() - others

    def others(self) -> float:
        """Return the CPU time of all that came of this process; what ended counts."""
        try:
            import psutil
        except ImportError:  # it comes with `distributed`
            return 0.0
        self._looked = time.monotonic()
        for process in psutil.Process().children(recursive=True):
            try:
                used = process.cpu_times()
            except psutil.Error:
                continue
            self._seen[process.pid] = used.user + used.system
        return sum(self._seen.values())
