"""`odm build --suggest`: what maps of several sizes cost and bring; nothing is built.

For each node count as many configurations are drawn as its build would draw, since the
number sets how long edges are. A few dozen of them are taken through every step of a
build by the real kernels, and bytes and times are scaled up.
"""

import time
from dataclasses import asdict, dataclass, replace

import numpy as np

from odm import CellMap, Recipe
from odm.audit.clearance import clearance_overhead
from odm.cell_map.build import robot_of
from odm.cell_map.chunk_work import StaticTestSpec, static_test
from odm.cell_map.estimate import free_memory
from odm.cell_map.sweep import sweep_roadmap
from odm.close_test.static import StaticTest, always_touching, with_insides
from odm.obstacles.grid import grid_for
from odm.obstacles.scenery import parse_scenery
from roadmap.builds.chunks import Threads
from roadmap.errors import BuildRefused
from roadmap.graph.connecting import RoadmapSettings, no_edges
from roadmap.graph.roadmap import N_LANDMARKS, Roadmap
from roadmap.graph.sampling import draw
from roadmap.kinematics.forward import difference
from roadmap.robot.robot import Robot
from sim.tables.fitted import numbers_of
from sim.tables.scale import NEAR, choice, gain_of
from sim.terminal.output import bytes_text, report
from sim.terminal.progress import Bars

NODES = (3_000, 10_000, 30_000)
CELLS = (0.03, 0.04, 0.05)
PROBED = 48  # nodes whose edges are looked at
SWEPT = 240  # edges that are swept
ASKED = 20, 100  # nodes and edges whose overhead is measured
# measured once on the reference map: what is not probed [s per node, edge, entry]
_PER_NODE, _PER_EDGE, _PER_ENTRY = 1.2e-4, 3e-5, 1.5e-7
_WHOLE = 1.0  # bytes of an entry for halves and words kept whole; Panda, 4 cm


@dataclass(frozen=True)
class Suggestion:
    """One row: a cell size and a node count, and what they would cost."""

    h: float  # cell size [m]
    # counts
    nodes: int
    edges: int
    bytes_per_edge: float  # of the edge-major view, nodes included
    map_bytes: int  # everything on disk
    memory_bytes: int  # in memory, with the block-major view
    seconds: float  # build, the robot's cover included, on `threads` threads [s]
    # mean extra distance at which an edge is given up, by cells and by the close test
    # [m]
    overhead_cells: float
    overhead_close: float


@dataclass(frozen=True, eq=False)
class Probe:
    """A few dozen nodes and edges that stand for a roadmap of `n_nodes` nodes."""

    roadmap: Roadmap  # the nodes and edges
    # of the whole roadmap
    n_nodes: int
    n_edges: int
    seconds: float  # to draw and test the whole roadmap, on one thread [s]


def suggest_sizes(recipe: Recipe, threads: int, json: str | None) -> None:
    """Print the table, or write it as JSON."""
    with Bars() as tell:
        rows, robot_s = suggestions(recipe, threads, tell)
    best = choice(rows, free_memory())
    data = {
        "recipe": recipe.as_dict(),
        "robot_seconds": robot_s,
        "rows": [
            asdict(row) | {"on_the_panda": asdict(gain_of(row.nodes, row.h))}
            for row in rows
        ],
        "free_memory": free_memory(),
        "choice": None if best is None else asdict(best),
    }
    report(data, json, lambda _: _show(rows, recipe, best))


def suggestions(
    recipe: Recipe, threads: int, tell: Bars
) -> tuple[list[Suggestion], float]:
    """Return the rows, and the seconds of reading the robot, which are part of each."""
    tell("robot and its cover", 0, 1)
    begun = time.perf_counter()
    robot = robot_of(recipe)
    robot_s = time.perf_counter() - begun
    tell("robot and its cover", 1, 1)
    node_counts = sorted({*NODES, recipe.roadmap.nodes})
    sizes = sorted({*CELLS, recipe.safety.h})
    rows, done = [], 0
    for n_nodes in node_counts:
        settings = replace(recipe.roadmap, nodes=n_nodes)
        probe = probe_roadmap(robot, replace(recipe, roadmap=settings))
        for h in sizes:
            asked = replace(recipe, safety=replace(recipe.safety, h=h))
            rows.append(_row(robot, asked, probe, threads, robot_s))
            done += 1
            tell("sizes", done, len(node_counts) * len(sizes))
    return sorted(rows, key=lambda row: (row.h, row.nodes)), robot_s


def probe_roadmap(robot: Robot, recipe: Recipe) -> Probe:
    """Sample as a build would; connect and test a part of it, and measure the time."""
    settings = recipe.roadmap
    scenery = parse_scenery(recipe.scenery, recipe.folder)
    scenery = with_insides(robot, scenery)
    scenery = always_touching(robot, scenery, recipe.safety)
    test = static_test(StaticTestSpec(robot, scenery, recipe.safety))
    chunks = draw(robot, settings.sampling, settings.seed, settings.nodes, None)
    q, share, node_s = _drawn(test, chunks, settings.nodes)
    rng = np.random.default_rng(0)
    a, b, weight, near_s = _near(robot, test, q, settings, rng)
    dq = difference(robot, a, b)
    test.motions_free(a[:8], dq[:8])
    begun = time.perf_counter()
    free = test.motions_free(a, dq)
    if not free.any():
        raise BuildRefused(no_edges(settings, len(a)))
    edge_s = (time.perf_counter() - begun) / len(a)
    # an edge found from both of its ends is one edge
    candidates = settings.nodes * min(settings.neighbors, settings.nodes - 1)
    candidates *= weight.mean()
    n_edges = candidates * np.average(free, weights=weight)
    keep = rng.permutation(np.flatnonzero(free))[:SWEPT]
    seconds = settings.nodes * (node_s / share + near_s + _PER_NODE)
    seconds += candidates * edge_s
    roadmap = _little(robot, a[keep], b[keep])
    return Probe(roadmap, settings.nodes, int(n_edges), seconds)


def _drawn(test: StaticTest, chunks: object, n_nodes: int):  # noqa: ANN202
    """Return all that would be drawn, the valid share, and the time to test one."""
    first = next(chunks)
    test.motions_free(first[:8], np.zeros_like(first[:8]))
    begun = time.perf_counter()
    valid = test.motions_free(first, np.zeros_like(first))
    each = (time.perf_counter() - begun) / len(first)
    share = max(float(valid.mean()), 1e-3)
    drawn = [first]
    while sum(map(len, drawn)) * share < n_nodes:
        drawn.append(next(chunks))
    return np.concatenate(drawn)[: int(n_nodes / share) + 1], share, each


def _near(robot: Robot, test: StaticTest, q, settings: RoadmapSettings, rng):  # noqa: ANN001, ANN202
    """Return ends and weights of the edges tried at some valid nodes; time per node."""
    from scipy.spatial import cKDTree

    weights = settings.weights or np.ones(robot.dof)
    points = q * weights
    tree = cKDTree(points)
    k = min(settings.neighbors, len(q) - 1)
    wanted = min(4 * k + 1, len(q))
    begun = time.perf_counter()
    probed = rng.permutation(len(q))[: 4 * PROBED]
    tree.query(points[probed], k=k + 1)
    each = (time.perf_counter() - begun) / len(probed)
    valid = test.motions_free(q[probed], np.zeros((len(probed), robot.dof)))
    starts, ends, share = [], [], []
    for node in probed[valid][:PROBED]:
        far, near = tree.query(points[node], k=wanted)
        near, far = near[1:], far[1:]
        ok = np.flatnonzero(test.motions_free(q[near], np.zeros_like(q[near])))
        if not len(ok):
            continue
        chosen = near[ok[:k]]
        # how far the other end looks for its own neighbours, the invalid ones counted
        among = min(len(near), k * len(near) // len(ok))
        mutual = far[ok[:k]] <= tree.query(points[chosen], k=[among + 1])[0][:, 0]
        starts.append(np.repeat(q[[node]], len(chosen), axis=0))
        ends.append(q[chosen])
        share.append(np.where(mutual, 0.5, 1.0))
    if not starts:
        raise BuildRefused(
            f"none of {len(probed)} configurations that were tried is free; check the "
            "scenery, and what the locked joints are locked at"
        )
    return np.concatenate(starts), np.concatenate(ends), np.concatenate(share), each


def _little(robot: Robot, a: np.ndarray, b: np.ndarray) -> Roadmap:
    """Return a roadmap of the edges a[i] - b[i] alone."""
    nodes, index = np.unique(np.concatenate([a, b]), axis=0, return_inverse=True)
    edges = index.reshape(2, -1).T
    lengths = np.linalg.norm(difference(robot, a, b), axis=1)
    return Roadmap(nodes, edges, lengths, np.ones(robot.dof), np.zeros((len(nodes), 0)))


def _row(
    robot: Robot, recipe: Recipe, probe: Probe, threads: int, robot_s: float
) -> Suggestion:
    import os

    safety, little = recipe.safety, probe.roadmap
    grid = grid_for(robot, safety.h, safety.rho + safety.m + safety.mu + 1e-3)
    scenery = parse_scenery(recipe.scenery, recipe.folder)
    raw = CellMap(robot, little, grid, recipe, None, scenery)
    one = Threads(1)
    sweep_roadmap(robot, raw.arm, _head(little), grid, safety, one)
    begun = time.perf_counter()
    cells = sweep_roadmap(robot, raw.arm, little, grid, safety, one)
    swept_s = (time.perf_counter() - begun) / (little.n_nodes + little.n_edges)
    sizes = np.diff(cells.start[:, 1].astype(np.int64))
    n = little.n_nodes
    node_entries = probe.n_nodes * sizes[:n].mean()
    entries = node_entries + probe.n_edges * sizes[n:].mean()
    items = probe.n_nodes + probe.n_edges
    steps = len(cells.step) / max(1, cells.n_entries)
    edge_major = entries * (4 + steps + _WHOLE) + 8 * items
    block_major = entries * 12 + 8 * grid.n_blocks
    graph = probe.n_nodes * 8 * (robot.dof + N_LANDMARKS) + probe.n_edges * 16
    workers = min(threads or os.cpu_count() or 1, os.cpu_count() or 1)
    rest = probe.n_edges * _PER_EDGE + entries * _PER_ENTRY
    seconds = robot_s + rest + (probe.seconds + items * swept_s) / workers
    n_nodes, n_edges = ASKED
    measured = replace(raw, arm_cells=cells)
    overhead = clearance_overhead(measured, n_nodes, n_edges=n_edges)
    return Suggestion(
        h=safety.h,
        nodes=probe.n_nodes,
        edges=probe.n_edges,
        bytes_per_edge=edge_major / max(1, probe.n_edges),
        map_bytes=int(edge_major + graph),
        memory_bytes=int(edge_major + block_major + graph),
        seconds=seconds,
        overhead_cells=overhead.edge_by_cells[0],
        overhead_close=overhead.edge_by_close_test[0],
    )


def _head(roadmap: Roadmap) -> Roadmap:
    """Return a few edges of a roadmap, to warm up with."""
    edges, lengths = roadmap.edges[:4], roadmap.lengths[:4]
    return replace(roadmap, edges=edges, lengths=lengths)


def _show(rows: list[Suggestion], recipe: Recipe, best: Suggestion | None) -> None:
    from rich.console import Console

    title = f"{recipe.name}: estimated from a few dozen edges; nothing was built"
    heads = ("cell", "nodes", "edges", "per\nedge", "map", "build")
    heads += ("overhead", "overhead,\nclose")
    gains = [gain_of(row.nodes, row.h) for row in rows]
    solved = [(f"{gain.crossing:.0f} %", f"{gain.clutter:.0f} %") for gain in gains]
    alike = len(set(solved)) == 1  # two columns of one figure would tell nothing
    heads += () if alike else ("crossing", "clutter")
    cells = []
    for row, shares in zip(rows, solved, strict=True):
        told = (
            f"{100 * row.h:g} cm",
            f"{row.nodes:,}",
            f"{row.edges:,}",
            f"{row.bytes_per_edge:.0f} B",
            bytes_text(row.map_bytes),
            f"{row.seconds:.0f} s",
            f"{100 * row.overhead_cells:.1f} cm",
            f"{100 * row.overhead_close:.1f} cm",
            *(() if alike else shares),
        )
        cells.append([f"[bold]{cell}[/]" for cell in told] if row is best else told)
    console = Console(highlight=False)
    console.print(numbers_of(title, heads, cells))
    console.print(
        "Overhead: how much farther than the clearance m an arm is when an edge is "
        "given up, on average; close: by the close test, which asks points where cells "
        "block. More nodes: shorter ways round; smaller cells: nearer passes. "
        + _solved(solved[0] if alike else None)
    )
    console.print(_advice(recipe, best))


def _solved(alike: tuple[str, str] | None) -> str:
    """Return what the sizes solve on the Panda, or what the columns of it are."""
    if alike is None:
        return (
            "Crossing, clutter: frames and scenes with a path on a Panda with a map of "
            "about that size, by `odm bench scale`."
        )
    return (
        f"On a Panda all of these sizes find a path in {alike[0]} of the frames beside "
        f"a crossing arm and in {alike[1]} of cluttered scenes (`odm bench scale`)."
    )


def _advice(recipe: Recipe, best: Suggestion | None) -> str:
    """Return which size to take, in one sentence."""
    room = bytes_text(free_memory())
    if best is None:
        return f"None of these can be built in {room} of free memory; free some."
    same = (best.nodes, best.h) == (recipe.roadmap.nodes, recipe.safety.h)
    options = "" if same else f" --nodes {best.nodes} --h {best.h:g}"
    return (
        f"With {room} of free memory take {best.nodes:,} nodes and cells of "
        f"{100 * best.h:g} cm ({options.strip() or 'as the recipe has it'}): no other "
        f"that fits solved {NEAR:g} % more, or clutter much sooner."
    )
