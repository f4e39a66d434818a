"""`odm bench scale`: what more map costs, and what it buys, with fitted exponents.

One map for each number of nodes, built here or taken from `--out` where it lies; the
same starts, goals, people and scenes for all. A figure y over nodes n is fitted as
y = c n^k by least squares in logarithms. Times of frames are the thread's CPU time. The
largest map is then opened by a process whose memory is limited to half of the map.
"""

import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from odm import Obstacles, ReactivePlanner, load_map, load_recipe
from odm.answer import HOLDING
from odm.cell_map.build import build_map
from odm.cell_map.cell_map import CellMap
from odm.cell_map.recipe import Recipe
from roadmap.builds.chunks import ChunkStore, Threads
from roadmap.errors import BadInput, PlanningError
from sim.bench.clock import Clock
from sim.bench.core.clutter_scenes import NoScene, Scene, make_scenes
from sim.bench.frames import Pair, make_pairs
from sim.bench.rivals.ompl import length
from sim.bench.scale.limited import answered_within
from sim.run.crew import chunk_folder
from sim.tables.header import header
from sim.tables.table import value_row

LARGE, USUAL = 100_000, 10_000  # nodes that are asked of
MOST_MB, MOST_S, MOST_LOAD_MS, MOST_TIMES, MOST_SLOWER = 500.0, 900.0, 100.0, 2.0, 10.0
MOTIONS, MOST_CALLS = 8, 60  # of `improve` on a scene that holds
_FITTED = {
    "edges": "edges",
    "megabytes": "bytes",
    "build_cpu_s": "build, CPU",
    "load_ms": "load, unverified",
    "planner_ms": "a planner made",
    "frame_p50_us": "frame p50",
    "frame_p99_us": "frame p99",
}
_HEAD = ("nodes", "cell", "edges", "MB", "build", "load", "planner", "p50", "p99",
         "crossing", "rad", "clutter", "p50", "p95")  # fmt: skip


@dataclass(frozen=True)
class Size:
    """What one map cost, and what it did.

    Attributes:
        nodes, edges: Of its roadmap.
        h: Side of a cell [m].
        megabytes: Of its folder.
        both_views_mb: Of both views of the lists, in memory.
        bytes_per_edge: Of the folder.
        build_s, build_cpu_s: Of the build [s].
        load_ms: To load it unverified, median, CPU.
        planner_ms: To make a planner, the derived view included, CPU.
        frame_p50_us, frame_p99_us: Capsules to path, every frame replanned, CPU.
        crossing: Frames with a path [%].
        crossing_rad: Length of first answers, median.
        clutter: Scenes with a path after `improve` [%]; NaN: none were asked.
        clutter_rad: Their length, median.
        clutter_p50_ms, clutter_p95_ms: Until a scene has a path, CPU.
    """

    nodes: int
    edges: int
    h: float
    megabytes: float
    both_views_mb: float
    bytes_per_edge: float
    build_s: float
    build_cpu_s: float
    load_ms: float
    planner_ms: float
    frame_p50_us: float
    frame_p99_us: float
    crossing: float
    crossing_rad: float
    clutter: float
    clutter_rad: float
    clutter_p50_ms: float
    clutter_p95_ms: float


def run(
    *,
    recipe: str = "panda",
    node_counts: str = "1000,3000,10000",
    cells: str | None = None,
    out: str | Path | None = None,
    seed: int = 1,
    short: bool = False,
    plot: str | Path | None = None,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Build, load and ask maps of several sizes.

    Args:
        recipe: Name or path.
        node_counts: Nodes of the maps, with commas.
        cells: Sides of cells [m], with commas; the recipe's when None.
        out: Folder where maps are kept and found again; None: a temporary one.
        seed: Of pairs and scenes.
        short: Few frames: to see that it runs.
        plot: PNG of the curves.
        tell: Called with what is done.

    Returns:
        Plain data for JSON: "header", "setup", "rows", "tables", "sizes".

    Raises:
        BadInput: The numbers cannot be read.
    """
    tell = tell or (lambda text: None)
    wanted = load_recipe(recipe)
    counts = [int(n) for n in _numbers("--nodes", node_counts, 2, 5e6)]
    sides = [wanted.safety.h]
    if cells is not None:
        sides = _numbers("--cells", cells, 0.005, 0.5)
    with tempfile.TemporaryDirectory() as folder:
        maps = _Maps(wanted, Path(out or folder), seed, short, tell)
        sizes = [maps.size(n, h) for h in sides for n in counts]
        tell("memory limited to half of the largest map")
        last = maps.folder(counts[-1], sides[-1])
        slower = answered_within(last, maps.pairs[0], 0.5)
    usual = [s for s in sizes if s.h == sizes[0].h]
    found = {
        "bench": "scale",
        "header": header(maps.latest),
        "setup": _setup(wanted, maps.pairs, maps.scenes, seed),
        "rows": [*_rows(sizes, counts), *_limit_rows(slower)],
        "tables": [{"title": "maps", "head": _HEAD, "rows": list(map(_row, sizes))}],
        "sizes": [asdict(size) for size in sizes],
        "exponents": _exponents(usual),
    }
    if plot is not None:
        from sim.bench.scale.scale_plot import write_plot

        found["plot"] = str(write_plot(found, plot))
    return found


class _Maps:
    """Builds maps of a recipe, and asks all the same."""

    def __init__(
        self,
        recipe: Recipe,
        place: Path,
        seed: int,
        short: bool,
        tell: Callable[[str], None],
    ) -> None:
        self.recipe, self.place, self.tell = recipe, place, tell
        self.seed, self.short = seed, short
        self.pairs: list[Pair] = []
        self.scenes: list[Scene] = []
        self.latest: CellMap | None = None

    def folder(self, nodes: int, h: float) -> Path:
        return self.place / f"{self.recipe.name}-{nodes}-{100 * h:g}cm"

    def size(self, nodes: int, h: float) -> Size:
        path, what = self.folder(nodes, h), f"{nodes:,} nodes, cells of {100 * h:g} cm"
        self.tell(f"map of {what}")
        _build(_asked(self.recipe, nodes, h), path)
        self.latest = load_map(path, verify=False)
        if not self.pairs:
            self.pairs, self.scenes = _drawn(self.latest, self.seed, self.short)
        self.tell(f"frames on {what}")
        return _size(path, self.latest, self.pairs, self.scenes)


def _numbers(flag: str, text: str, low: float, high: float) -> list[float]:
    try:
        found = sorted({float(word) for word in text.split(",")})
    except ValueError:
        found = []
    if not found or not all(low <= x <= high for x in found):
        raise BadInput(
            f"{flag} is {text!r}: give numbers from {low:g} to {high:g} with commas"
        )
    return found


def _asked(recipe: Recipe, nodes: int, h: float) -> Recipe:
    return replace(
        recipe,
        roadmap=replace(recipe.roadmap, nodes=nodes),
        safety=replace(recipe.safety, h=h),
    )


def _build(recipe: Recipe, path: Path) -> None:
    """Build a map, unless the same one lies there; go on where a build was ended."""
    try:
        there = load_map(path, verify=False)
    except PlanningError:
        there = None
    if there is not None and there.recipe.as_dict() == recipe.as_dict():
        return
    store = ChunkStore(chunk_folder(path))
    build_map(recipe, workers=Threads(0, store)).save(path)
    store.clear()


def _drawn(cell_map: CellMap, seed: int, short: bool) -> tuple[list[Pair], list[Scene]]:
    pairs = make_pairs(cell_map, 3 if short else 24, 8 if short else 100, seed)
    try:
        return pairs, make_scenes(cell_map, 2 if short else 40, seed)
    except NoScene:
        return pairs, []


def _size(
    path: Path, cell_map: CellMap, pairs: list[Pair], scenes: list[Scene]
) -> Size:
    load, made, clock = Clock(), Clock(), Clock()
    for _ in range(5):
        load(load_map, path, verify=False)
    planner = made(ReactivePlanner, load_map(path, verify=False), always_replan=True)
    lengths, asked = [], 0
    for pair in pairs:
        frames = pair.asked()
        planner.reset()
        planner.set_goals([pair.q_goal])
        frames[0](planner, pair.q_start)
        for ask in frames:
            answer = clock(ask, planner, pair.q_start)
            asked += 1
            if answer.status != HOLDING:
                lengths.append(length(answer.path))
    for scene in scenes[:1]:
        _solve(planner, scene)  # so that no first call is counted
    tried = [_solve(planner, scene) for scene in scenes]
    solved = [path for path, _ in tried if path is not None]
    waited = [ms for path, ms in tried if path is not None] or [np.nan]
    folder = sum(f.stat().st_size for f in path.iterdir())
    cpu = 1e-3 * np.array(clock.cpu, float)
    roadmap, built = cell_map.roadmap, cell_map.built
    return Size(
        nodes=roadmap.n_nodes,
        edges=roadmap.n_edges,
        h=cell_map.safety.h,
        megabytes=1e-6 * folder,
        both_views_mb=1e-6 * sum(cell_map.arm_cells.bytes_by_view()),
        bytes_per_edge=folder / max(1, roadmap.n_edges),
        build_s=built["seconds"],
        build_cpu_s=built.get("cpu_seconds", np.nan),
        load_ms=1e-6 * float(np.median(load.cpu)),
        planner_ms=1e-6 * made.cpu[0],
        frame_p50_us=float(np.percentile(cpu, 50)),
        frame_p99_us=float(np.percentile(cpu, 99)),
        crossing=100.0 * len(lengths) / max(1, asked),
        crossing_rad=float(np.median(lengths)) if lengths else np.nan,
        clutter=100.0 * len(solved) / len(scenes) if scenes else np.nan,
        clutter_rad=float(np.median([length(p) for p in solved])) if solved else np.nan,
        clutter_p50_ms=float(np.percentile(waited, 50)),
        clutter_p95_ms=float(np.percentile(waited, 95)),
    )


def _solve(planner: ReactivePlanner, scene: Scene) -> tuple[np.ndarray | None, float]:
    """Return the path through a scene, or None, and the time until then [ms]."""
    obstacles, clock, calls = Obstacles.of(scene.boxes), Clock(), 0
    planner.reset()
    planner.set_goals([scene.q_goal])
    answer = clock(planner.step, obstacles, q=scene.q_start)
    while answer.status == HOLDING and calls < MOST_CALLS:
        calls += 1
        if clock(planner.improve, MOTIONS):
            answer = clock(planner.step, obstacles, q=scene.q_start)
    path = None if answer.status == HOLDING else answer.path
    return path, 1e-6 * sum(clock.cpu)


def _exponents(sizes: list[Size]) -> dict[str, float]:
    """Return k of y = c n^k by least squares in logarithms, of each figure."""
    if len({s.nodes for s in sizes}) < 2:
        return {}
    n = np.log([s.nodes for s in sizes])
    found = {}
    for name in _FITTED:
        y = np.array([getattr(s, name) for s in sizes], float)
        if np.isfinite(y).all() and (y > 0).all():
            found[name] = round(float(np.polyfit(n, np.log(y), 1)[0]), 3)
    return found


def _rows(sizes: list[Size], counts: list[int]) -> list[dict]:
    first = [s for s in sizes if s.h == sizes[0].h]
    exponents = _exponents(first)
    rows = [
        value_row(f"exponent of {name} over nodes", exponents[key], "")
        for key, name in _FITTED.items()
        if key in exponents
    ]
    by_count = dict(zip(counts, first, strict=True))
    large, usual = by_count.get(LARGE), by_count.get(USUAL)
    if large is None:
        return rows
    rows += [
        value_row(f"{LARGE:,} nodes: edges", large.edges, ""),
        value_row("... folder", large.megabytes, "MB", most=MOST_MB),
        value_row("... both views in memory", large.both_views_mb, "MB"),
        value_row("... build", large.build_s, "s", most=MOST_S),
        value_row("... build, CPU of all threads", large.build_cpu_s, "s",
                  most=2 * MOST_S),
        value_row("... load, unverified", large.load_ms, "ms", most=MOST_LOAD_MS),
    ]  # fmt: skip
    if usual is not None:
        p50 = large.frame_p50_us / usual.frame_p50_us
        p99 = large.frame_p99_us / usual.frame_p99_us
        what = f"frame p50 against {USUAL:,} nodes"
        rows.append(value_row(f"... {what}", p50, "times", most=MOST_TIMES))
        rows.append(value_row("... p99", p99, "times", most=MOST_TIMES))
    return rows


def _limit_rows(slower: dict) -> list[dict]:
    note = slower["note"]
    return [
        value_row("memory limited to half of the map: answers", slower["answers"], "",
                  note, least=1),
        value_row("... p99 against no limit", slower["times"], "times",
                  most=MOST_SLOWER),
    ]  # fmt: skip


def _row(s: Size) -> tuple[str, ...]:
    return (
        f"{s.nodes:,}", f"{100 * s.h:g} cm", f"{s.edges:,}", f"{s.megabytes:.0f}",
        f"{s.build_cpu_s:.0f} s", f"{s.load_ms:.0f} ms", f"{s.planner_ms:.0f} ms",
        f"{s.frame_p50_us:.0f} us", f"{s.frame_p99_us:.0f} us",
        f"{s.crossing:.0f} %", f"{s.crossing_rad:.2f}",
        *_clutter(s),
    )  # fmt: skip


def _clutter(s: Size) -> tuple[str, ...]:
    if np.isnan(s.clutter):
        return "-", "-", "-"
    return f"{s.clutter:.0f} %", f"{s.clutter_p50_ms:.0f}", f"{s.clutter_p95_ms:.0f} ms"


def _setup(recipe: Recipe, pairs: list[Pair], scenes: list[Scene], seed: int) -> dict:
    return {
        "recipe": recipe.name,
        "crossing": f"{len(pairs)} pairs of {len(pairs[0].capsules)} frames, replanned",
        "clutter": f"{len(scenes)} scenes, improve({MOTIONS}) up to {MOST_CALLS} times",
        "build": "CPU time of all threads; load, planner and frames: of the thread",
        "seed": seed,
    }
