"""Shapes drawn at random, and slow distances from them: shared by tests of solids."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

import odm
from odm.exact._distances import POINTS, Convexes, core_distance, nearest_pair
from odm.exact.distances import ExactObstacles, gather, obstacles_of
from odm.obstacles.obstacles import SolidRoom
from roadmap.transforms import flat_pose

KINDS = ("sphere", "capsule", "cylinder", "box", "mesh")
_TURNS = np.random.RandomState()  # seeded anew in a tenth of the time of a new one
_POINT = gather([(np.zeros((1, 3)), 0.0, 0.0, 0.0)], np.zeros(1))


def draw_pose(rng, middle=(0.0, 0.0, 0.5), spread=0.5):
    T = np.eye(4)
    _TURNS.seed(rng.integers(1 << 30))
    T[:3, :3] = Rotation.random(random_state=_TURNS).as_matrix()
    T[:3, 3] = np.asarray(middle) + rng.uniform(-spread, spread, 3)
    return T


def draw_shape(kind, rng, **where):
    """Draw a shape of a few centimetres to decimetres."""
    T = draw_pose(rng, **where)
    if kind == "sphere":
        return odm.Sphere(rng.uniform(0.01, 0.15), T)
    if kind == "capsule":
        length = 0.0 if rng.random() < 0.1 else rng.uniform(0.01, 0.5)
        return odm.Capsule(rng.uniform(0.01, 0.1), length, T)
    if kind == "cylinder":
        return odm.Cylinder(rng.uniform(0.01, 0.1), rng.uniform(0.01, 0.5), T)
    if kind == "box":
        return odm.Box(rng.uniform(0.01, 0.4, 3), T)
    from scipy.spatial import ConvexHull

    points = rng.normal(size=(rng.integers(5, 20), 3)) * rng.uniform(0.03, 0.12, 3)
    hull = ConvexHull(points)
    a, b, c = (points[hull.simplices[:, i]] for i in range(3))
    faces = hull.simplices.copy()
    out = hull.equations[:, :3]
    turned = np.einsum("fi,fi->f", np.cross(b - a, c - a), out) < 0.0
    faces[turned] = faces[turned][:, ::-1]
    used = np.unique(faces)
    return odm.Mesh(points[used], np.searchsorted(used, faces), T)


def draw_shapes(rng, n=1, **where):
    return [draw_shape(str(rng.choice(KINDS)), rng, **where) for _ in range(n)]


def solids_of(shapes, T=None):
    """Return shapes as the close test takes them, in the order of `Obstacles`."""
    obstacles = shapes
    if not isinstance(shapes, odm.Obstacles):
        obstacles = odm.Obstacles.of(shapes)
    solids = SolidRoom().of(obstacles, np.eye(4) if T is None else T)
    assert solids is not None
    return solids


def exact_distance(shape, points):
    """Return the distance of points (n, 3) from a solid, 0 inside, by another way."""
    around = obstacles_of([shape])
    convexes, there, found = around.convexes, around.frames[0], np.empty(len(points))
    for k, frame in enumerate(_upright(points)):
        low, _ = core_distance(_POINT, 0, frame, convexes, 0, there, np.inf)
        found[k] = max(0.0, low - convexes.margin[0])
    return found


def _upright(points):
    """Return the frames (n, 12) of points, as the audit's loops take them."""
    poses = np.tile(np.eye(4), (len(points), 1, 1))
    poses[:, :3, 3] = points
    return flat_pose(poses)


def smallest_solid_gap(cell_map, q, dq, shapes, n=200):
    """Return the least of distance - radius over dense samples of a motion [m]."""
    from naive_cells import centers

    arm, around = cell_map.arm, obstacles_of(shapes)
    at = [centers(arm, cell_map.robot, q + t * dq) for t in np.linspace(0.0, 1.0, n)]
    balls, frames = _balls(np.tile(arm.spheres[:, 3], n)), _upright(np.concatenate(at))
    use, found = np.ones(len(frames), bool), np.empty(2, np.int64)
    best, _ = nearest_pair(
        balls, use, frames, around.convexes, around.frames, np.inf, found
    )
    return best


def _balls(radii):
    """Return balls as the audit's convex solids: points grown by their radii."""
    n = len(radii)
    ball = np.zeros((n, 4))
    ball[:, 3] = radii + 1e-12
    return Convexes(
        kind=np.full(n, POINTS),
        ptr=np.arange(n + 1),
        points=np.zeros((n, 3)),
        size=np.zeros((n, 2)),
        margin=radii,
        ball=ball,
        owner=np.zeros(n, np.int64),
    )


def near_a_link(exact, q, kind, rng, gaps=(3e-4, 4e-3)):
    """Return a shape that is as far from the robot at q, and how far it is; or None."""
    shape, want = draw_shape(kind, rng, spread=0.0), rng.uniform(*gaps)
    tip = exact.frames(q)[rng.integers(1, len(exact.body)), 9:12]
    side = rng.normal(size=3)
    side /= np.linalg.norm(side)
    T, low, high = np.eye(4), 0.0, 1.0
    around = obstacles_of([shape])
    assert not around.hollow  # whose triangles would have to go with it
    for _ in range(16):
        T[:3, 3] = tip - shape.T_base_shape[:3, 3] + 0.5 * (low + high) * side
        frames = flat_pose((T @ shape.T_base_shape)[None])
        there = replace(around, frames=np.repeat(frames, len(around.frames), axis=0))
        near = exact.distance(q, there, cap=0.1).distance < want
        low, high = (0.5 * (low + high), high) if near else (low, 0.5 * (low + high))
    T[:3, 3] = tip - shape.T_base_shape[:3, 3] + high * side
    shape = shape.moved(T)
    now = exact.distance(q, [shape], cap=0.1).distance
    return (shape, now) if 0.0 < now < 1.5 * gaps[1] else None


def least_on(exact, q, dq, around):
    """Return the least exact distance along a motion [m]."""
    if not isinstance(around, ExactObstacles):
        around = obstacles_of(around)
    places = np.linspace(0.0, 1.0, 80)
    return min(exact.distance(q + t * dq, around, cap=0.05).distance for t in places)
