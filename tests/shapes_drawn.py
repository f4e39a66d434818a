"""Shapes drawn at random, and slow distances from them: shared by tests of solids."""

import numpy as np
from scipy.spatial.transform import Rotation

import odm
from odm._groups import new
from odm.audit._exact import core_distance
from odm.audit.exact import flat_frames, gather, obstacles_of
from odm.obstacles._solid_samples import FINE, Patterns, take_solids
from odm.obstacles._solids import Solids
from odm.obstacles.obstacles import room_for, write_meshes

KINDS = ("sphere", "capsule", "cylinder", "box", "mesh")
_POINT = gather([(np.zeros((1, 3)), 0.0, 0.0, 0.0)], np.zeros(1))


def draw_pose(rng, middle=(0.0, 0.0, 0.5), spread=0.5):
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=rng.integers(1 << 30)).as_matrix()
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


def solids_of(shapes, T=None, rho=0.03):
    """Return shapes as the close test takes them, in the order of `Obstacles`."""
    obstacles = shapes
    if not isinstance(shapes, odm.Obstacles):
        obstacles = odm.Obstacles.of(shapes)
    sizes = {"shapes": 0, "faces": 0, "patterns": 0, "samples": 0}
    groups = new(Solids, sizes), new(Patterns, sizes)
    groups[1].rho[0] = rho
    groups = room_for(obstacles, *groups) or groups
    write_meshes(obstacles, *groups)
    T = np.eye(4) if T is None else T
    assert take_solids(obstacles.data, obstacles.counts, T, *groups) == FINE
    return groups[0]


def exact_distance(shape, points):
    """Return the distance of points (n, 3) from a solid, 0 inside, by another way."""
    around = obstacles_of([shape])
    margin, found = around.convexes.margin[0], np.empty(len(points))
    for k, point in enumerate(points):
        T = np.eye(4)
        T[:3, 3] = point
        frame = flat_frames(T[None])[0]
        low, _ = core_distance(
            _POINT, 0, frame, around.convexes, 0, around.frames[0], np.inf
        )
        found[k] = max(0.0, low - margin)
    return found


def smallest_solid_gap(cell_map, q, dq, shapes, n=200):
    """Return the least of distance - radius over dense samples of a motion [m]."""
    from naive_cells import centers

    best = np.inf
    for t in np.linspace(0.0, 1.0, n):
        c = centers(cell_map.arm, cell_map.robot, q + t * dq)
        for shape in shapes:
            gaps = exact_distance(shape, c) - cell_map.arm.spheres[:, 3]
            best = min(best, float(gaps.min()))
    return best
