"""One row of `odm bench odm-paper`: what a map of one size and one cell does."""

import time
from dataclasses import dataclass, field

import numpy as np

from odm import ReactivePlanner
from odm.cell_map.cell_map import CellMap
from odm.exact.distances import ExactRobot, obstacles_of
from roadmap.kinematics.forward import difference
from sim.bench.clock import Clock
from sim.bench.paper.paper_arm import (
    Contacts,
    CylinderPair,
    Region,
    cells_of,
    centers_of,
    cylinders,
    paper_points,
)
from sim.bench.rivals.fcl_search import FclPair, FclSearch
from sim.bench.rivals.query import query_of

ALONG = 5  # configurations on an edge that are asked for contact
WARM = 5  # frames before those that are timed


@dataclass(frozen=True)
class Sizes:
    """How much of everything a row takes.

    Attributes:
        pairs, frames: Queries that are timed, and frames of each.
        fcl_frames: Frames that A* with python-fcl has.
        audit_frames: Frames in which exact contacts are looked for.
        audit_edges: Edges that are asked in each of them.
        rule_edges: Edges on which the paper's rule is tried.
    """

    pairs: int = 12
    frames: int = 40
    fcl_frames: int = 24
    audit_frames: int = 24
    audit_edges: int = 2000
    rule_edges: int = 300


SHORT = Sizes(2, 6, 2, 2, 60, 10)


@dataclass
class Audit:
    """Exact contacts, and how many of them each way of mapping the arm misses.

    Attributes:
        asked: Configurations compared with the arm.
        contacts, missed: Those in contact, and of these the ones called free.
        near, near_missed: The same within the clearance m.
        whole, surface, dense: Numbers of cells by frame: of the whole arm, of its
            points with covering radius rho, and of points a cell apart.
        nodes, edges: By frame, invalid by (whole, surface, dense).
        uninflated: Distance of points [m] -> contacts the paper's comparison misses.
        on_nodes: Contacts of nodes, by which `uninflated` counts.
    """

    asked: int = 0
    contacts: int = 0
    missed: int = 0
    near: int = 0
    near_missed: int = 0
    on_nodes: int = 0
    whole: list = field(default_factory=list)
    surface: list = field(default_factory=list)
    dense: list = field(default_factory=list)
    nodes: list = field(default_factory=list)
    edges: list = field(default_factory=list)
    uninflated: dict = field(default_factory=dict)


def audit(
    cell_map: CellMap,
    rods: np.ndarray,
    spacings: tuple[float, ...],
    n_edges: int,
    seed: int,
) -> Audit:
    """Compare cells and exact contacts in some frames.

    Args:
        cell_map: The map.
        rods: (f, 2, 7) the arm in each frame.
        spacings: Distances of neighbouring points for the paper's comparison [m].
        n_edges: Edges drawn in each frame.
        seed: Of edges and places on them.
    """
    found = Audit(uninflated=dict.fromkeys(spacings, 0))
    planner, region = ReactivePlanner(cell_map), Region(cell_map.grid)
    contacts = Contacts(ExactRobot(cell_map.robot))
    rng, grid = np.random.default_rng(seed), cell_map.grid
    for arm in rods:
        job = region.prepare(arm)
        region.expand(job)
        whole = region.centers(job)
        surface = CylinderPair.of(_still(arm), cell_map.safety.rho).points()[0]
        dense = paper_points(arm, grid.h)
        counts = (len(whole), len(cells_of(surface, grid)), len(cells_of(dense, grid)))
        for name, n in zip(("whole", "surface", "dense"), counts, strict=True):
            getattr(found, name).append(n)
        ways = [_invalid(planner, points) for points in (whole, surface, dense)]
        found.nodes.append([len(nodes) for nodes, _ in ways])
        found.edges.append([len(edges) for _, edges in ways])
        solid = obstacles_of(cylinders(arm))
        in_touch = _count(found, cell_map, contacts, solid, ways[1], n_edges, rng)
        found.on_nodes += len(in_touch)
        for apart in spacings:
            centers = centers_of(cells_of(paper_points(arm, apart), grid), grid)
            seen = contacts.meet_cells(in_touch, region, centers)
            found.uninflated[apart] += int((~seen).sum())
    return found


def _still(arm: np.ndarray) -> CylinderPair:
    nothing = np.zeros(1)
    return CylinderPair(nothing, nothing, arm[None], "still")


def _invalid(planner: ReactivePlanner, points: np.ndarray) -> tuple:
    q = planner.cell_map.roadmap.nodes[0].copy()
    planner.step(np.ascontiguousarray(points), q=q)
    return planner.invalid_nodes(), planner.invalid_edges()


def _count(
    found: Audit,
    cell_map: CellMap,
    contacts: Contacts,
    solid: object,
    invalid: tuple,
    n_edges: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """Ask all nodes and some edges; return the nodes in contact (n, dof)."""
    roadmap, m = cell_map.roadmap, cell_map.safety.m
    blocked = np.zeros(roadmap.n_nodes, bool)
    blocked[invalid[0]] = True
    distances = contacts.distances(roadmap.nodes, solid, m + 1e-3)
    _add(found, distances, blocked, m)
    edges = rng.choice(roadmap.n_edges, min(n_edges, roadmap.n_edges), replace=False)
    shut = np.zeros(roadmap.n_edges, bool)
    shut[invalid[1]] = True
    ends = roadmap.edges[edges]
    # an edge's own list leaves out what its nodes sweep: they block it, too
    shut_too = shut[edges] | blocked[ends].any(axis=1)
    q = np.repeat(roadmap.nodes[ends[:, 0]], ALONG, axis=0)
    dq = difference(cell_map.robot, q, np.repeat(roadmap.nodes[ends[:, 1]], ALONG, 0))
    q = q + rng.random((len(q), 1)) * dq
    along = contacts.distances(q, solid, m + 1e-3)
    _add(found, along, np.repeat(shut_too, ALONG), m)
    return roadmap.nodes[distances <= 0.0]


def _add(found: Audit, distances: np.ndarray, blocked: np.ndarray, m: float) -> None:
    touching, near = distances <= 0.0, distances <= m
    found.asked += len(distances)
    found.contacts += int(touching.sum())
    found.missed += int((touching & ~blocked).sum())
    found.near += int(near.sum())
    found.near_missed += int((near & ~blocked).sum())


def update_times(cell_map: CellMap, pairs: list[CylinderPair]) -> dict:
    """Time both ways from an obstacle to invalid nodes and edges, and their answer.

    Returns:
        Clocks by name: "expand", "whole" and "surface" from scratch, "changes".
    """
    planner = ReactivePlanner(cell_map)
    following, region = ReactivePlanner(cell_map), Region(cell_map.grid)
    clocks = {name: Clock() for name in ("expand", "whole", "surface", "changes")}
    q = cell_map.roadmap.nodes[0].copy()
    for pair in pairs:
        for rods, points in zip(pair.capsules, pair.points(), strict=True):
            job = region.prepare(rods)
            clocks["expand"](region.expand, job)
            whole = np.ascontiguousarray(region.centers(job))
            for name, cloud in (("whole", whole), ("surface", points)):
                planner.step(cloud, q=q)
                planner.direct.clear()
                clocks[name](_lists, planner)
            following.step(points, q=q)
            clocks["changes"](_lists, following)
    return clocks


def _lists(planner: ReactivePlanner) -> None:
    planner.direct.nodes()
    planner.direct.edges()


class PaperFcl(FclSearch):
    """Lazy A* with python-fcl, the arm as two cylinders."""

    what = FclSearch.what.replace("two capsules", "two cylinders")

    def __init__(self, cell_map: CellMap) -> None:
        """Make the collision objects."""
        super().__init__(cell_map)
        self.checker = _CylinderWorld(cell_map)


class _CylinderWorld(FclPair):
    def set_obstacles(self, rods: np.ndarray) -> None:
        super(FclPair, self).set_obstacles(cylinders(rods))


@dataclass(frozen=True, eq=False)
class Race:
    """Frames from points to path, and some of them by A* with python-fcl.

    Attributes:
        ours, theirs: Times; `same` those of ours in the frames that both had.
        vertices: (n,) corners of our answer's paths; 0 where there is none.
        found: (2, 2) frames by (we found a path, they found one).
        touching: Of our paths, those python-fcl finds in contact.
        stages: (n, 2) occupancy and search [s].
        work: (n, 4) edge tests, vertices closed, close tests, searches.
    """

    ours: Clock
    theirs: Clock
    same: Clock
    vertices: np.ndarray
    found: np.ndarray
    touching: int
    stages: np.ndarray
    work: np.ndarray


def race(cell_map: CellMap, pairs: list[CylinderPair], fcl_frames: int) -> Race:
    """Replan every frame from scratch; some also by A* with python-fcl checks."""
    planner = ReactivePlanner(cell_map, always_replan=True)
    attaching = ReactivePlanner(cell_map)
    fcl, each = PaperFcl(cell_map), max(1, fcl_frames // max(1, len(pairs)))
    ours, theirs, same = Clock(), Clock(), Clock()
    vertices, stages, work = [], [], []
    found, touching = np.zeros((2, 2), np.int64), 0
    for number, pair in enumerate(pairs):
        points = pair.points()
        planner.reset()
        planner.set_goals([pair.q_goal])
        planner.step(np.zeros((0, 3)), q=pair.q_start)
        fcl.set_query(query_of(attaching, pair))
        for p in points[:WARM]:
            planner.step(p, q=pair.q_start)
        answers = [ours(planner.step, p, q=pair.q_start) for p in points]
        vertices += [len(a.path) for a in answers]
        stages += [list(a.latency_s.values())[:2] for a in answers]
        work += [_work(a) for a in answers]
        if number * each >= fcl_frames:
            continue
        chosen = np.linspace(0, len(points) - 1, each + 2).astype(int)[1:-1]
        for k in chosen:
            path = theirs(fcl.search, pair.capsules[k])
            for clock in ("wall", "cpu"):
                getattr(same, clock).append(getattr(ours, clock)[k - len(points)])
            mine = answers[k].path
            found[int(len(mine) > 0), int(path is not None)] += 1
            if len(mine):
                touching += not fcl.path_free(mine, pair.capsules[k])
    return Race(
        ours, theirs, same, np.array(vertices), found, touching, np.array(stages),
        np.array(work),
    )  # fmt: skip


def _work(answer: object) -> tuple[int, int, int, int]:
    work = answer.work
    return work.edge_tests, work.popped, work.close_tests, work.searches


def seconds(function: object, *args: object) -> tuple[object, float]:
    """Return what a function returns, and the processes' CPU time it took [s]."""
    begun = time.process_time()
    result = function(*args)
    return result, time.process_time() - begun
