"""Exact distances of the robot's solids from obstacle solids, with a certificate.

The audit's ground truth. It shares nothing with the maps but `body_frames`: no sphere,
cell or sample. python-fcl is the second opinion (`odm.exact.fcl_robot`): its contact
answers agree, its distances are up to 0.4 mm too large where a round solid is involved.
"""

import math
from dataclasses import dataclass

import numpy as np

from odm.exact import _distances as kernels
from odm.obstacles import shapes as solid
from roadmap.errors import BadInput
from roadmap.geometry._winding import winding
from roadmap.kinematics.forward import body_frames
from roadmap.robot.robot import BOX, CYLINDER, HULL, SPHERE, Robot
from roadmap.transforms import flat_pose, moved_points

_SIDES = (-0.5, 0.5)
BOX_CORNERS = np.array([[x, y, z] for x in _SIDES for y in _SIDES for z in _SIDES])
_NO_TRIANGLES = np.empty((0, 3, 3))


@dataclass(frozen=True)
class Nearest:
    """The smallest distance found.

    Attributes:
        distance: A lower bound [m]; at most 0 where solids touch or overlap.
        gap: The true distance is at most `distance + gap` [m].
        link: Name of the robot's link, empty where nothing is within the cap.
        other: Index of the shape, or name of the other link.
    """

    distance: float
    gap: float
    link: str
    other: int | str | None


@dataclass(frozen=True, eq=False)
class ExactObstacles:
    """Obstacle solids ready for the compiled loops; see `obstacles_of`.

    Attributes:
        convexes: Their convex parts; the facets of a mesh that is not convex.
        frames: (n, 12) poses of the parts: rotation (9, row-major), origin (3).
        hollow: (m, 3, 3) triangles of each mesh that is not convex.
        hollow_shape: Index of the shape each of them belongs to.
    """

    convexes: kernels.Convexes
    frames: np.ndarray
    hollow: tuple[np.ndarray, ...]
    hollow_shape: tuple[int, ...]


class ExactRobot:
    """The exact solids of a robot.

    Args:
        robot: The robot.
        base: Count the links that never move, too; the maps leave them out.
    """

    def __init__(self, robot: Robot, base: bool = False) -> None:
        self.robot = robot
        points = np.split(robot.solid_points, robot.solid_ptr[1:-1])
        solids = zip(robot.solid_kind, robot.solid_size, points, strict=False)
        parts = [solid_part(*each) for each in solids]
        self.convexes = gather(parts, robot.solid_link)
        self.body = robot.link_body[robot.solid_link]
        self._pose = robot.solid_pose
        self._use = np.ones(len(parts), bool) if base else self.body > 0

    def frames(self, q: np.ndarray) -> np.ndarray:
        """Return the poses of the solids at `q`, (n, 12)."""
        return flat_pose(body_frames(self.robot, q)[self.body] @ self._pose)

    def distance(
        self,
        q: np.ndarray,
        obstacles: "ExactObstacles | list[solid.Shape]",
        cap: float = np.inf,
    ) -> Nearest:
        """Return the smallest distance of the solids from obstacles at q (dof,) [m].

        ExactObstacles are shapes, or what `obstacles_of` made of them. Distances beyond
        `cap` are not resolved: the answer is `cap`.
        """
        if not isinstance(obstacles, ExactObstacles):
            obstacles = obstacles_of(obstacles)
        return self.distance_of(self._use, q, obstacles, cap)

    def distance_of(
        self,
        use: np.ndarray,
        q: np.ndarray,
        obstacles: ExactObstacles,
        cap: float = np.inf,
    ) -> Nearest:
        """Return the same for the solids chosen by `use` (n,) bool alone."""
        if not len(obstacles.frames):
            return Nearest(float(cap), 0.0, "", None)  # nothing there, wherever it is
        frames, found = self.frames(q), np.empty(2, np.int64)
        best, gap = kernels.nearest_pair(
            self.convexes, use, frames, obstacles.convexes, obstacles.frames,
            float(cap), found,
        )  # fmt: skip
        link, other = "", None
        if found[0] >= 0:
            link = self._link(found[0])
            other = int(obstacles.convexes.owner[found[1]])
        if best > 0.0:
            inside = self._swallowed(use, frames, obstacles)
            if inside is not None:
                return Nearest(0.0, 0.0, self._link(inside[0]), inside[1])
        return Nearest(best, gap, link, other)

    def collides(
        self,
        q: np.ndarray,
        obstacles: "ExactObstacles | list[solid.Shape]",
        m: float = 0.0,
    ) -> bool:
        """Return whether a solid comes within `m` [m] of an obstacle, or touches it."""
        return self.distance(q, obstacles, cap=m + 1e-3).distance <= m

    def self_distance(self, q: np.ndarray, pairs: np.ndarray | None = None) -> Nearest:
        """Return the smallest distance between pairs (n, 2) of links at q [m].

        By default those of `robot.self_pairs`.
        """
        frames, found = self.frames(q), np.empty(2, np.int64)
        pairs = self.robot.self_pairs if pairs is None else pairs
        best, gap, links = np.inf, 0.0, ("", None)
        for one, other in pairs:
            near, loose = kernels.nearest_between(
                self.convexes, frames, int(one), int(other), best, found
            )
            if near < best:
                best, gap = near, loose
                links = (self.robot.link_names[one], self.robot.link_names[other])
        return Nearest(best, gap, *links)

    def _link(self, convex: int) -> str:
        return self.robot.link_names[self.convexes.owner[convex]]

    def _swallowed(self, use, frames, obstacles):
        """Find a solid inside a mesh that is not convex: it touches no facet."""
        for triangles, shape in zip(
            obstacles.hollow, obstacles.hollow_shape, strict=True
        ):
            for i in np.flatnonzero(use):
                R, p = frames[i, :9].reshape(3, 3), frames[i, 9:]
                x, y, z = R @ self.convexes.ball[i, :3] + p
                if abs(winding(triangles, x, y, z)) > 0.5:
                    return i, shape
        return None


def obstacles_of(shapes: list[solid.Shape]) -> ExactObstacles:
    """Return shapes as convex parts with poses, for `ExactRobot.distance`."""
    parts, frames, owner, hollow, hollow_shape = [], [], [], [], []
    for k, shape in enumerate(shapes):
        new, triangles = shape_parts(shape)
        parts += new
        owner += [k] * len(new)
        frames += [shape.T_base_shape] * len(new)
        if len(triangles):
            hollow.append(moved_points(triangles, shape.T_base_shape))
            hollow_shape.append(k)
    poses = np.array(frames).reshape(-1, 4, 4)
    convexes = gather(parts, np.array(owner, np.int64))
    return ExactObstacles(
        convexes, flat_pose(poses), tuple(hollow), tuple(hollow_shape)
    )


def capsule_obstacles(rows: np.ndarray) -> ExactObstacles:
    """Return capsules (n, 7), ends a, b and radius [m], as `obstacles_of` does.

    The same bytes as of `Capsule.between` one by one, in a twentieth of its time: so
    many rows are audited in every frame of a run.
    """
    rows = np.asarray(rows, float)
    axis = rows[:, 3:6] - rows[:, :3]
    length = [math.sqrt(one.dot(one)) for one in axis]
    given = rows.tolist()  # plain floats: a third of the time, of so few numbers
    most = solid.LARGEST  # where a number is not finite one of these is not within it
    plain = [
        n <= most and 0.0 < r[6] <= most for n, r in zip(length, given, strict=True)
    ]
    if not given or not all(plain):
        shapes = [solid.Capsule.between(row[:3], row[3:6], row[6]) for row in rows]
        return obstacles_of(shapes)
    points, balls, frames = [], [], []
    for k, (ax, ay, az, bx, by, bz, radius) in enumerate(given):
        half = 0.5 * length[k]
        points += [0.0, 0.0, -half], [0.0, 0.0, half]
        balls.append([0.0, 0.0, 0.0, half + radius + 1e-12])
        middle = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
        frames.append([*_turned(axis[k], length[k]), *middle])
    n = len(given)
    convexes = kernels.Convexes(
        kind=np.array(n * [kernels.POINTS]),
        ptr=np.arange(0, 2 * n + 1, 2),
        points=np.array(points),
        size=np.zeros((n, 2)),
        margin=rows[:, 6].copy(),
        ball=np.array(balls),
        owner=np.arange(n),
    )
    return ExactObstacles(convexes, np.array(frames), (), ())


def _turned(axis: np.ndarray, length: float) -> list[float]:
    """Return the rotation (9,) that turns z to an axis, as `Capsule.between` has it."""
    if length < 1e-12:
        return [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    z = [v / length for v in axis.tolist()]
    x = _cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    along = np.array(x)
    size = math.sqrt(along.dot(along))
    x = [v / size for v in x]
    y = _cross(z, x)
    return [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]]


def _cross(a: list[float], b: list[float]) -> list[float]:
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def shape_parts(shape: solid.Shape) -> tuple[list[tuple], np.ndarray]:
    """Return a shape's convex parts, and its triangles if it is not convex.

    A part is (points (n, 3), margin, radius, half length) in the shape's frame; a
    part without points is a cylinder.
    """
    if isinstance(shape, solid.Sphere):
        return [(np.zeros((1, 3)), shape.radius, 0.0, 0.0)], _NO_TRIANGLES
    if isinstance(shape, solid.Capsule):
        ends = np.array([[0, 0, -0.5], [0, 0, 0.5]]) * shape.length
        return [(ends, shape.radius, 0.0, 0.0)], _NO_TRIANGLES
    if isinstance(shape, solid.Cylinder):
        half = 0.5 * shape.length
        return [(np.empty((0, 3)), 0.0, shape.radius, half)], _NO_TRIANGLES
    if isinstance(shape, solid.Box):
        return [(BOX_CORNERS * shape.size, 0.0, 0.0, 0.0)], _NO_TRIANGLES
    return _mesh_parts(shape)


def _mesh_parts(mesh: solid.Mesh):
    from scipy.spatial import ConvexHull

    from odm.obstacles.mesh_surface import closed_triangles

    triangles = closed_triangles(mesh.vertices, mesh.faces)
    hull = ConvexHull(mesh.vertices)
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    volume = abs(np.einsum("ni,ni->n", a, np.cross(b, c)).sum()) / 6.0
    if hull.volume - volume <= 1e-9 * hull.volume:
        points = np.ascontiguousarray(mesh.vertices[hull.vertices])
        return [(points, 0.0, 0.0, 0.0)], _NO_TRIANGLES
    facets = [(np.ascontiguousarray(t), 0.0, 0.0, 0.0) for t in triangles]
    return facets, np.ascontiguousarray(triangles)


def solid_part(kind: int, size: np.ndarray, points: np.ndarray) -> tuple:
    """Return a robot's solid, see `Solid`, as a part; see `shape_parts`."""
    if kind == HULL:
        return points, 0.0, 0.0, 0.0
    if kind == BOX:
        return BOX_CORNERS * size, 0.0, 0.0, 0.0
    if kind == CYLINDER:
        return np.empty((0, 3)), 0.0, size[0], 0.5 * size[1]
    if kind == SPHERE:
        return np.zeros((1, 3)), size[0], 0.0, 0.0
    raise BadInput(f"a solid is of unknown kind {kind}: load the robot again")


def gather(parts: list[tuple], owner: np.ndarray) -> kernels.Convexes:
    """Lay parts (see `shape_parts`) and their owners out for the compiled loops."""
    lengths = [len(p[0]) for p in parts]
    stacked = [p[0] for p in parts] + [np.empty((0, 3))]
    return kernels.Convexes(
        kind=np.array([kernels.ROUND if n == 0 else kernels.POINTS for n in lengths]),
        ptr=np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        points=np.ascontiguousarray(np.concatenate(stacked)),
        size=np.array([p[2:] for p in parts], float).reshape(-1, 2),
        margin=np.array([p[1] for p in parts], float),
        ball=_balls(parts, lengths),
        owner=np.array(owner, np.int64),
    )


def _balls(parts: list[tuple], lengths: list[int]) -> np.ndarray:
    """Return a ball around each part (n, 4): those of as many points at once."""
    balls = np.zeros((len(parts), 4))
    for n in set(lengths):
        same = [k for k, length in enumerate(lengths) if length == n]
        _, margin, radius, half = zip(*[parts[k] for k in same], strict=True)
        if n == 0:
            balls[same, 3] = np.hypot(radius, half) + 1e-12
            continue
        points = np.array([parts[k][0] for k in same])
        center = 0.5 * (points.min(axis=1) + points.max(axis=1))
        far = np.linalg.norm(points - center[:, None], axis=2).max(axis=1)
        balls[same, :3], balls[same, 3] = center, far + margin + 1e-12
    return balls
