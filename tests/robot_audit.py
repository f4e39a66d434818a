"""Exact checks of what a map is built on: sphere cover, self-collision, scenery."""

from dataclasses import dataclass

import numpy as np
from nearest import out_of_spheres

from odm.cell_map.cell_map import CellMap
from odm.exact.distances import BOX_CORNERS, ExactRobot, obstacles_of
from odm.obstacles import shapes as solid
from roadmap.kinematics.forward import difference
from roadmap.robot.robot import BOX, CYLINDER, HULL, Robot

_FAR = 50.0  # [m] half-spaces become boxes of this size
ROUNDING = 1e-9  # [m]


@dataclass(frozen=True)
class RobotAudit:
    """What the exact checks found; distances in metres.

    Attributes:
        volume_points, outside, farthest: Points of the moving solids tried, those that
            no sphere of their body holds, and how far out the worst lies.
        configurations: Places on nodes and edges tried.
        self_contacts, self_smallest, self_pair: Places where tested links touch, the
            smallest distance between any, and whose it is.
        scenery_violations, scenery_smallest, scenery_pair: The same for the recipe's
            solids, counted below m.
        m: Clearance.
    """

    volume_points: int
    outside: int
    farthest: float
    configurations: int
    self_contacts: int
    self_smallest: float
    self_pair: tuple[str, str]
    scenery_violations: int
    scenery_smallest: float
    scenery_pair: tuple[str, str]
    m: float

    @property
    def passed(self) -> bool:
        """True if every point is covered and every place is free."""
        return self.outside + self.self_contacts + self.scenery_violations == 0

    def as_dict(self) -> dict:
        """Return everything as plain JSON data."""
        plain = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return plain | {"passed": self.passed}


def audit_robot(
    cell_map: CellMap, points: int = 200_000, configurations: int = 5000, seed: int = 0
) -> RobotAudit:
    """Check cover, self-collision and scenery of a map against exact geometry.

    Args:
        cell_map: The map.
        points: Points of the volume of the moving solids.
        configurations: Places on random edges, their ends included.
        seed: Of both.
    """
    rng = np.random.default_rng([seed, 5])
    farthest, outside, tried = _check_cover(cell_map.robot, points, rng)
    exact = ExactRobot(cell_map.robot, base=True)
    scenery = _scenery(cell_map, exact)
    nearest, near_scenery = (np.inf, ("", "")), (np.inf, ("", ""))
    contacts, violations, m = 0, 0, cell_map.safety.m
    for q in _places(cell_map, configurations, rng):
        found = exact.self_distance(q)
        contacts += found.distance <= 0.0
        pair = (found.link, str(found.other or ""))
        nearest = min(nearest, (found.distance, pair))
        low = _scenery_distance(exact, q, scenery)
        violations += low[0] < m - ROUNDING
        near_scenery = min(near_scenery, low)
    return RobotAudit(
        tried, outside, farthest, configurations, contacts, *nearest, violations,
        *near_scenery, m,
    )  # fmt: skip


def volume_points(robot: Robot, i: int, n: int, rng: np.random.Generator) -> np.ndarray:
    """Draw points of solid i, its corners and the inside alike, (n, 3) in its body."""
    kind, size, T = robot.solid_kind[i], robot.solid_size[i], robot.solid_pose[i]
    if kind in (HULL, BOX):
        rows = slice(robot.solid_ptr[i], robot.solid_ptr[i + 1])
        corners = BOX_CORNERS * size if kind == BOX else robot.solid_points[rows]
        few = rng.integers(0, len(corners), (n, 4))
        # mixtures of one to four corners: corners, edges and facets, inside
        share = rng.dirichlet(np.full(4, 0.5), n)
        share *= np.arange(4) < rng.integers(1, 5, n)[:, None]
        share /= share.sum(axis=1, keepdims=True)
        points = np.einsum("nk,nkj->nj", share, corners[few])
    else:
        out = rng.normal(size=(n, 3))
        if kind == CYLINDER:
            out[:, 2] = 0.0
        out /= np.linalg.norm(out, axis=1)[:, None]
        points = out * (size[0] * np.sqrt(rng.random(n)).round(1))[:, None]
        if kind == CYLINDER:
            points[:, 2] = size[1] * rng.uniform(-0.5, 0.5, n).round(1)
    return points @ T[:3, :3].T + T[:3, 3]


def _check_cover(robot, n, rng):
    moving = np.flatnonzero(robot.link_body[robot.solid_link] > 0)
    each, worst, outside = max(1, n // max(1, len(moving))), -np.inf, 0
    for i in moving:
        body = robot.link_body[robot.solid_link[i]]
        own = robot.spheres[robot.sphere_body == body]
        points = volume_points(robot, i, each, rng)
        far = out_of_spheres(points, own)
        outside += int((far > ROUNDING).sum())
        worst = max(worst, float(far.max()))
    return worst, outside, each * len(moving)


def _places(cell_map: CellMap, n: int, rng: np.random.Generator):
    roadmap = cell_map.roadmap
    edges = roadmap.edges[rng.integers(0, max(1, roadmap.n_edges), n)]
    ends = rng.integers(0, 2, n)
    t = np.where(rng.random(n) < 0.2, ends, rng.random(n))
    for (a, b), at in zip(edges, t, strict=True):
        q = roadmap.nodes[a]
        yield q + at * difference(cell_map.robot, q, roadmap.nodes[b])


def _scenery(cell_map: CellMap, exact: ExactRobot):
    """Return (name, obstacles, solids that count) of each solid of the recipe."""
    robot, scenery, found = cell_map.robot, cell_map.scenery, []
    for k, name in enumerate(scenery.names):
        shape = _scenery_shape(scenery.solids[k])
        skipped = {
            robot.link_body[robot.link_names.index(link)]
            for link, other in scenery.dropped
            if other == name
        }
        use = np.array([b > 0 and b not in skipped for b in exact.body])
        found.append((name, obstacles_of([shape]), use))
    return found


def _scenery_shape(row: np.ndarray) -> solid.Box:
    T = np.eye(4)
    if row[0] == 1.0:
        T[:3, :3], T[:3, 3] = row[4:13].reshape(3, 3), row[1:4]
        return solid.Box(2.0 * row[13:16], T)
    # a half-space: a box below the plane, so large that its sides do not matter
    rod = solid.Cylinder.between(np.zeros(3), row[1:4], 1.0)
    T[:3, :3] = rod.T_base_shape[:3, :3]
    T[:3, 3] = (row[4] - 0.5 * _FAR) * row[1:4]
    return solid.Box(np.full(3, _FAR), T)


def _scenery_distance(exact: ExactRobot, q: np.ndarray, scenery: list):
    best = (np.inf, ("", ""))
    for name, obstacles, use in scenery:
        near = exact.distance_of(use, q, obstacles)
        best = min(best, (near.distance, (near.link, name)))
    return best
