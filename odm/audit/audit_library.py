"""Obstacles that try to slip through a map: sharp, thin, small, and badly sampled.

Every sampling here is legal: its covering radius is at most the map's rho. Many are as
bad as legal allows: a hole of that size lies where the obstacle meets the robot. The
samples by which a frame marks the cells of shapes are attacked as well.
"""

from dataclasses import dataclass, replace

import numpy as np

from odm.audit._audit import Library
from odm.cell_map.cell_map import CellMap
from odm.exact.distances import gather, shape_parts
from odm.obstacles import shapes as solid
from odm.obstacles.mesh_surface import cover_densely
from odm.obstacles.obstacles import Obstacles
from odm.obstacles.surfaces import sample_capsules, surface_of
from odm.planner.planner import ReactivePlanner
from roadmap.transforms import moved_points

FAMILIES = (
    "arm", "needle", "rod", "plate", "box", "cylinder", "ball", "small ball", "mesh",
)  # fmt: skip
SHARP = ("needle", "small ball")  # a sample lies rho behind the point that meets

_MESH_RHO = 0.006  # [m] where rho is less, meshes are smaller: large ones are refused


@dataclass(frozen=True, eq=False)
class Specimen:
    """One obstacle: shapes in its own frame, samples, and points to meet the robot.

    Attributes:
        family: One of FAMILIES.
        shapes: Closed solids.
        points: (n, 3) samples of all of them, covering radius <= rho.
        aims: (a, 6) surface points and outward directions.
    """

    family: str
    shapes: tuple[solid.Shape, ...]
    points: np.ndarray
    aims: np.ndarray


def draw_specimens(
    n: int, rho: float, rng: np.random.Generator
) -> tuple[Specimen, ...]:
    """Return `n` obstacles, the families in turn, sampled for covering radius rho."""
    makers = (
        _arm, _needle, _rod, _plate, _box, _cylinder, _ball, _small_ball, _mesh,
    )  # fmt: skip
    return tuple(makers[k % len(makers)](rho, rng) for k in range(n))


def draw_arms(n: int, rho: float, rng: np.random.Generator) -> tuple[Specimen, ...]:
    """Return `n` two-capsule arms, sampled for covering radius rho."""
    return tuple(_arm(rho, rng) for _ in range(n))


def as_frames_sample(
    specimens: tuple[Specimen, ...], cell_map: CellMap
) -> tuple[Specimen, ...]:
    """Return obstacles with the samples by which a frame marks their shapes' cells."""
    planner, found = ReactivePlanner(cell_map), []
    planner.memory.patterns.near[3] = np.inf  # all of them, wherever the grid ends
    for one in specimens:
        planner.step(Obstacles.of(one.shapes), q=cell_map.roadmap.nodes[0])
        found.append(replace(one, points=planner.points.copy()))
    return tuple(found)


def library_of(specimens: tuple[Specimen, ...]) -> Library:
    """Lay specimens out for the compiled loop."""
    parts, part_ptr, hollow = [], [0], []
    for one in specimens:
        made = [shape_parts(shape) for shape in one.shapes]
        for shape, (new, _) in zip(one.shapes, made, strict=True):
            parts += [_placed(part, shape.T_base_shape) for part in new]
        hollow.append(any(len(triangles) for _, triangles in made))
        part_ptr.append(len(parts))
    clouds, aims = [s.points for s in specimens], [s.aims for s in specimens]
    return Library(
        parts=gather(parts, np.zeros(len(parts))),
        part_ptr=np.array(part_ptr),
        hollow=np.array(hollow),
        points=np.ascontiguousarray(np.concatenate(clouds)),
        point_ptr=np.concatenate([[0], np.cumsum([len(c) for c in clouds])]),
        aims=np.ascontiguousarray(np.concatenate(aims)),
        aim_ptr=np.concatenate([[0], np.cumsum([len(a) for a in aims])]),
    )


def _placed(part, T):
    points = part[0]
    if len(points) == 0:  # a cylinder stays in the specimen's own frame
        if not np.array_equal(T, np.eye(4)):
            raise AssertionError("cylinders of the audit stand alone in their frame")
        return part
    return (moved_points(points, T), *part[1:])


def _between(rng, low, high, size=None):
    return low * (high / low) ** rng.random(size)


def _arm(rho, rng):
    """An upper arm and a forearm with a bent elbow."""
    bend = rng.uniform(0.0, 2.6)
    elbow = np.array([0.0, 0.0, 0.28])
    hand = elbow + 0.27 * np.array([np.sin(bend), 0.0, np.cos(bend)])
    upper = solid.Capsule.between(np.zeros(3), elbow, rng.uniform(0.04, 0.07))
    fore = solid.Capsule.between(elbow, hand, rng.uniform(0.03, 0.05))
    points = np.concatenate([surface_of(s, rho).points for s in (upper, fore)])
    aims = np.concatenate([_rod_aims(upper, rng), _rod_aims(fore, rng)])
    tip = (hand - elbow) / np.linalg.norm(hand - elbow)
    aims = np.vstack([aims, np.concatenate([hand + fore.radius * tip, tip])])
    return Specimen("arm", (upper, fore), points, aims)


def _needle(rho, rng):
    """A thin capsule whose tip is exactly rho away from its nearest sample.

    The first ring of samples lies z0 below the end of the axis. The pole is at
    sqrt(r^2 + (z0 + r)^2) = rho from it, and every other point of the tip is nearer.
    """
    radius = _between(rng, 0.001, min(0.004, 0.2 * rho))
    length = _between(rng, 0.1, 0.6)
    bare = np.sqrt((rho * (1 - 1e-9)) ** 2 - radius**2) - radius
    shape = solid.Capsule(radius, length)
    a, b = shape.ends()
    rest = b - [0.0, 0.0, bare]
    angle = 2 * np.pi * np.arange(6) / 6
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle])
    below = sample_capsules(np.concatenate([a, rest, [radius]])[None], rho)
    # the shorter rod's cap lies inside the needle: the ring at its end replaces it
    points = np.concatenate([below[below[:, 2] < rest[2] - 1e-9], ring + rest])
    aim = np.concatenate([b + [0.0, 0.0, radius], [0.0, 0.0, 1.0]])
    return Specimen("needle", (shape,), points, aim[None])


def _rod(rho, rng):
    kind = (solid.Capsule, solid.Cylinder)[rng.integers(2)]
    shape = kind(_between(rng, 0.002, 0.008), _between(rng, 0.1, 0.8))
    return _regular("rod", shape, rho, _rod_aims(shape, rng))


def _cylinder(rho, rng):
    shape = solid.Cylinder(_between(rng, 0.02, 0.12), _between(rng, 0.03, 0.4))
    if rng.random() < 0.5:
        return _holed("cylinder", shape, rho, rng)
    return _regular("cylinder", shape, rho, _rod_aims(shape, rng))


def _plate(rho, rng):
    size = np.append(_between(rng, 0.05, 0.5, 2), _between(rng, 0.001, 0.006))
    return _box_specimen("plate", size, rho, rng)


def _box(rho, rng):
    return _box_specimen("box", _between(rng, 0.02, 0.4, 3), rho, rng)


def _box_specimen(family, size, rho, rng):
    shape = solid.Box(size)
    if rng.random() < 0.5:
        return _holed(family, shape, rho, rng)
    signs = rng.choice([-1.0, 0.0, 1.0], (8, 3))
    signs[:3] = rng.choice([-1.0, 1.0], (3, 3))
    signs[(signs == 0).all(axis=1)] = (0.0, 0.0, 1.0)
    at = np.where(signs == 0.0, rng.uniform(-1, 1, (8, 3)), signs) * size / 2
    return _regular(family, shape, rho, np.hstack([at, signs]))


def _ball(rho, rng):
    shape = solid.Sphere(_between(rng, 0.01, 0.15))
    out = rng.normal(size=(6, 3))
    out /= np.linalg.norm(out, axis=1)[:, None]
    return _regular("ball", shape, rho, np.hstack([shape.radius * out, out]))


def _small_ball(rho, rng):
    """A ball seen by one sample, on the side away from the robot."""
    radius = 0.005 if rng.random() < 0.5 else 0.5 * rho * (1 - 1e-9)
    shape = solid.Sphere(min(radius, 0.5 * rho * (1 - 1e-9)))
    point = np.array([[0.0, 0.0, -shape.radius]])
    aim = np.array([[0.0, 0.0, shape.radius, 0.0, 0.0, 1.0]])
    return Specimen("small ball", (shape,), point, aim)


def _mesh(rho, rng):
    import trimesh

    kind = rng.integers(4)
    if kind == 0:
        mesh = trimesh.creation.icosphere(1, 1.0)
        vertices = mesh.vertices * _between(rng, 0.01, 0.2, 3)
    elif kind == 1:
        sections = int(rng.integers(3, 9))
        mesh = trimesh.creation.cone(1.0, 1.0, sections=sections)
        size = (*[_between(rng, 0.005, 0.1)] * 2, _between(rng, 0.05, 0.4))
        vertices = mesh.vertices * size
    elif kind == 2:
        mesh = trimesh.creation.torus(1.0, 0.25, major_sections=10, minor_sections=5)
        vertices = mesh.vertices * _between(rng, 0.03, 0.2)
    else:
        mesh = trimesh.convex.convex_hull(rng.normal(size=(12, 3)))
        vertices = mesh.vertices * _between(rng, 0.01, 0.15, 3)
    vertices = vertices * min(1.0, rho / _MESH_RHO)
    shape = solid.Mesh(vertices, mesh.faces)
    aims = []
    for v in rng.integers(0, len(vertices), 8):
        out = vertices[v] - vertices.mean(axis=0)
        aims.append(np.concatenate([vertices[v], out / np.linalg.norm(out)]))
    if rng.random() < 0.5:
        return _holed("mesh", shape, rho, rng, np.array(aims[0]))
    return _regular("mesh", shape, rho, np.array(aims))


def _regular(family, shape, rho, aims):
    return Specimen(family, (shape,), surface_of(shape, rho).points, aims)


def _rod_aims(rod, rng):
    """Points of the side, both poles, and the rims of a cylinder."""
    r, half, n = rod.radius, 0.5 * rod.length, 6
    angle = rng.uniform(0, 2 * np.pi, n)
    side = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    at = side * r
    at[:, 2] = rng.uniform(-half, half, n)
    if isinstance(rod, solid.Cylinder):
        at[:3, 2] = np.where(rng.random(3) < 0.5, half, -half)
        side[:3, 2] = np.sign(at[:3, 2])
        pole = half
    else:
        pole = half + r
    ends = np.array([[0, 0, pole, 0, 0, 1.0], [0, 0, -pole, 0, 0, -1.0]])
    local = np.vstack([np.hstack([at, side]), ends])
    R, p = rod.T_base_shape[:3, :3], rod.T_base_shape[:3, 3]
    return np.hstack([local[:, :3] @ R.T + p, local[:, 3:] @ R.T])


def _holed(family, shape, rho, rng, aim=None):
    """Sample with a hole of almost rho around one protruding point.

    Dense samples (covering radius eps) stand for the surface: if each of them is
    within rho - eps of a sample that is kept, the covering radius is at most rho.
    """
    from scipy.spatial import cKDTree

    eps = rho / 12.0
    if aim is None:
        aims = _corner_aims if isinstance(shape, solid.Box) else _rod_aims
        aim = aims(shape, rng)[rng.integers(3)]
    # only the surroundings of the hole are dense; the rest is sampled as usual
    dense = _dense(shape, eps)
    usual = surface_of(shape, rho - eps).points
    far = np.linalg.norm(dense - aim[:3], axis=1)
    near = dense[far < 3.0 * rho]
    usual = usual[np.linalg.norm(usual - aim[:3], axis=1) > rho]
    hole = rho - eps
    while hole > 0.0:
        rim = np.linalg.norm(near - aim[:3], axis=1)
        rim = near[(rim >= hole - eps) & (rim < hole + 4 * eps)]
        kept = np.concatenate([usual, rim])
        kept = kept[np.linalg.norm(kept - aim[:3], axis=1) >= hole - eps]
        if len(kept) and cKDTree(kept).query(dense)[0].max() <= rho - eps:
            return Specimen(family, (shape,), kept, aim[None])
        hole -= eps
    return _regular(family, shape, rho, aim[None])


def _dense(shape, eps):
    if isinstance(shape, solid.Mesh):
        return cover_densely(shape.vertices, shape.faces, eps)
    return surface_of(shape, eps).points


def _corner_aims(box, rng):
    signs = rng.choice([-1.0, 1.0], (3, 3))
    signs[1, rng.integers(3)] = 0.0
    return np.hstack([signs * box.size / 2, signs])
