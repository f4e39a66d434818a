"""Obstacle surfaces as points with a proved covering radius, caps and corners included.

The covering radius is the largest distance from any point of the closed surface to its
nearest sample. It is what the safety argument (design step 4) needs: a map built for
`rho` avoids every closed obstacle whose covering radius is at most `rho`.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from odm.obstacles import shapes as solid
from odm.obstacles._surfaces import SHRINK, sample_rods
from roadmap.arrays import as_floats, frozen, writable
from roadmap.errors import BadInput
from roadmap.ranges import check_kind, is_between, told
from roadmap.transforms import check_pose, moved_points

MOST_POINTS = 20_000_000  # of one shape
_SIDES = (-0.5, 0.5)


@dataclass(frozen=True, eq=False)
class Surface:
    """Points that stand for one obstacle.

    Attributes:
        points: (n, 3) samples [m].
        covering_radius: Largest distance from the surface to its nearest sample [m]:
            proved where `surface_of` made it, declared by the caller otherwise.
        label: Name of the obstacle.
        closed: True if the whole surface of a closed solid is covered; raw points of
            a sensor are not.
    """

    points: np.ndarray
    covering_radius: float
    label: str = ""
    closed: bool = False

    def __post_init__(self) -> None:
        points = as_floats("points", self.points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise BadInput(f"points have shape {points.shape}: give them as (n, 3) [m]")
        bad = len(points) - int(np.isfinite(points).all(axis=1).sum())
        if bad:
            raise BadInput(
                f"{bad} points of {self.label or 'a surface'} are NaN or infinite: "
                "remove them"
            )
        radius = self.covering_radius
        if not is_between(radius, 0.0, 1e3):
            raise BadInput(
                f"covering radius {radius} m must be at least 0: declare the largest "
                "distance from the surface to its nearest point"
            )
        radius = float(radius)
        object.__setattr__(self, "points", frozen(points, np.float64))
        object.__setattr__(self, "covering_radius", radius)

    def moved(self, T: np.ndarray) -> "Surface":
        """Return the surface moved by a rigid `T` (4, 4); the radius stays."""
        T = check_pose(T, "T")
        return replace(self, points=moved_points(self.points, T))


def surface_of(shape: solid.Shape, spacing: float = 0.03, label: str = "") -> Surface:
    """Sample the whole surface of a closed shape.

    Args:
        shape: A solid with its pose.
        spacing: Bound on the covering radius [m].
        label: Name of the obstacle; the shape's type when empty.

    Returns:
        Points and covering radius: `spacing`, or for a mesh the smaller value that was
        computed.
    """
    if not isinstance(shape, solid.Shape):
        raise BadInput(
            f"a {type(shape).__name__} is no shape: give a Sphere, Capsule, Cylinder, "
            "Box or Mesh"
        )
    T = shape.T_base_shape
    check_kind("label", label, str, "give a name")
    radius = spacing = check_spacing(spacing)
    _check_area(shape, spacing)
    if isinstance(shape, solid.Sphere):
        row = np.concatenate([T[:3, 3], T[:3, 3], [shape.radius]])
        points = sample_capsules(row[None], spacing)
    elif isinstance(shape, solid.Capsule):
        points = sample_capsules(_rod_row(shape), spacing)
    elif isinstance(shape, solid.Cylinder):
        points = sample_cylinders(_rod_row(shape), spacing)
    elif isinstance(shape, solid.Box):
        points = moved_points(_box_points(shape.size, spacing * SHRINK), T)
    else:
        from odm.obstacles.mesh_surface import sample_closed_mesh

        points, radius = sample_closed_mesh(shape.vertices, shape.faces, spacing)
        points = moved_points(points, T)
    return Surface(points, radius, label or type(shape).__name__.lower(), closed=True)


def box_faces(box: solid.Box, spacing: float = 0.01) -> Surface:
    """Sample a box so that points on each face, edge and corner cover it by themselves.

    No place is farther than `spacing` [m] from one. Such samples need far less than
    their covering radius. Let c be the centre of a ball at distance D from a convex
    polytope, x the nearest point and F the face, edge or corner that x lies inside of.
    c - x is at right angles to F, and some sample p of F has |p - x| <= rho, so

        |p - c|^2 = D^2 + |p - x|^2 <= D^2 + rho^2.

    This is `rounded_covering` with an infinite rounding: pass `rounding=np.inf` to
    `step` where all obstacles are sampled like this.
    """
    if not isinstance(box, solid.Box):
        raise BadInput(f"{box!r} is no Box; sample other shapes with surface_of")
    spacing = check_spacing(spacing)
    rho, size = spacing * SHRINK, box.size
    lines = [_edge(length, rho) for length in size]
    parts = [_box_points(size, rho)]
    for axis, side, other in product(range(3), _SIDES, _SIDES):
        # the edge along v, where two faces meet; its ends are the corners
        u, v = (axis + 1) % 3, (axis + 2) % 3
        edge = np.empty((len(lines[v]), 3))
        edge[:, axis], edge[:, u] = side * size[axis], other * size[u]
        edge[:, v] = lines[v]
        parts.append(edge)
    points = moved_points(np.concatenate(parts), box.T_base_shape)
    return Surface(points, spacing, "box", closed=True)


def require_covering(surface: Surface, rho: float) -> None:
    """Refuse a surface whose covering radius is larger than the map's `rho` [m]."""
    radius = surface.covering_radius
    if not radius <= rho:
        raise BadInput(
            f"the covering radius {radius:.4g} m of '{surface.label or 'points'}' is "
            f"larger than the map's rho {rho:.4g} m: sample it more densely or build a "
            "map with a larger rho"
        )


def rounded_covering(covering_radius: float, rounding: float, ball: float) -> float:
    """Return the smaller covering radius that a rounded obstacle needs against balls.

    A convex solid that is a union of balls of radius `rounding` (a capsule or sphere:
    its own radius) is sampled with covering radius rho. Let a point c lie D <= `ball`
    from it, x be the nearest surface point and n its normal, c = x + D n. The sample
    p nearest to x is below the tangent plane, but outside the ball of radius a that
    touches x from inside, so its depth is at most |p - x|^2 / (2 a), and

        |p - c|^2 = |p - x|^2 + D^2 - 2 D n.(p - x) <= D^2 + rho^2 (1 + D / a).

    Hence some sample is within `ball` + result of c; the result falls as `ball` grows,
    so the smallest ball counts.

    Args:
        covering_radius: rho of the samples [m].
        rounding: Radius a [m].
        ball: Smallest radius asked about: least cover sphere plus clearance m [m].

    Returns:
        A radius that takes the place of rho in the tests of spheres this large [m].
    """
    rho = covering_radius
    if not (rounding > 0.0 and ball > 0.0) or rho >= 2.0 * rounding:
        return rho
    return min(rho, np.sqrt(ball**2 + rho**2 * (1.0 + ball / rounding)) - ball)


def sample_capsules(capsules: np.ndarray, spacing: float = 0.03) -> np.ndarray:
    """Sample the whole surfaces of capsules, both end caps included.

    Args:
        capsules: (k, 7) ends a and b and radius [m]; a zero length is a sphere.
        spacing: Bound on the covering radius [m]; the pattern is the sparsest of its
            kind that is proved to keep it (`odm.obstacles._surfaces`).

    Returns:
        (n, 3) points [m], capsule by capsule.

    Raises:
        BadInput: Wrong shape, a value that is not finite, or a radius <= 0.
    """
    check_spacing(spacing)
    rods = checked_rods(capsules, "capsule")
    return sample_rods(False, writable(rods), float(spacing))


def sample_cylinders(cylinders: np.ndarray, spacing: float = 0.03) -> np.ndarray:
    """Sample cylinders (k, 7) [a, b, radius] with their end discs, (n, 3) [m]."""
    check_spacing(spacing)
    rods = checked_rods(cylinders, "cylinder")
    length = np.linalg.norm(rods[:, 3:6] - rods[:, :3], axis=1)
    if (length <= 1e-9).any():
        i = int(length.argmin())
        raise BadInput(
            f"cylinder {i} has length {length[i]} m and so no direction: give it two "
            "different ends, or use a sphere"
        )
    return sample_rods(True, writable(rods), float(spacing))


def _edge(length, rho):
    n = max(1, int(np.ceil(length / (2.0 * rho))))
    return np.linspace(-0.5, 0.5, n + 1) * length


def _rod_row(rod):
    a, b = rod.ends()
    return np.concatenate([a, b, [rod.radius]])[None]


def _check_area(shape, spacing):
    """Refuse a shape that would take more memory than there is."""
    if isinstance(shape, solid.Sphere):
        area = 4 * np.pi * shape.radius**2
    elif isinstance(shape, solid.Box):
        area = 2 * float(shape.size @ np.roll(shape.size, 1))
    elif isinstance(shape, solid.Mesh):
        return
    else:
        area = 2 * np.pi * shape.radius * (shape.length + 2 * shape.radius)
    if area > MOST_POINTS * spacing**2:
        raise BadInput(
            f"a {type(shape).__name__.lower()} of {area:.3g} m2 takes more than "
            f"{MOST_POINTS} points {spacing} m apart: give metres, or cut it"
        )


def check_spacing(spacing: float) -> float:
    """Return a spacing [m]; refuse what is no positive number, or no distance."""
    if not is_between(spacing, 1e-6, solid.LARGEST):
        raise BadInput(
            f"spacing {told(spacing)} m must be above 0 and at most {solid.LARGEST:g} "
            "m: 0.03 suits most maps"
        )
    return float(spacing)


def checked_rods(rods: np.ndarray, kind: str) -> np.ndarray:
    """Return capsules or cylinders (k, 7) as floats, or refuse what is none."""
    array = as_floats(f"{kind} rows", rods)
    if array.ndim != 2 or array.shape[1] != 7:
        raise BadInput(f"{kind} rows have shape {array.shape}: give (k, 7) [m]")
    if not np.isfinite(array).all():
        row, column = np.argwhere(~np.isfinite(array))[0]
        raise BadInput(
            f"{kind} {row} has {array[row, column]} in column {column}: leave it out "
            "until its values are finite"
        )
    radius = array[:, 6]
    if len(array) and radius.min() <= 0.0:
        i = int(radius.argmin())
        raise BadInput(
            f"{kind} {i} has radius {radius[i]} m, which must be above 0: give the "
            "true radius or leave it out"
        )
    return array


def _box_points(size, rho):
    parts = []
    for axis in range(3):
        others = [(axis + 1) % 3, (axis + 2) % 3]
        face = face_points(size[others[0]], size[others[1]], rho)
        points = np.empty((len(face), 3))
        points[:, others] = face - 0.5 * size[others]
        for side in _SIDES:
            points[:, axis] = side * size[axis]
            parts.append(points.copy())
    return np.concatenate(parts)


def face_points(width: float, height: float, rho: float) -> np.ndarray:
    """Return the fewest points that cover [0, width] x [0, height]."""
    upright = _staggered(height, width, rho)[:, ::-1]
    patterns = (_grid(width, height, rho), _staggered(width, height, rho), upright)
    return min(patterns, key=len)


def _grid(width, height, rho):
    # a point in the middle of each of n x m equal rectangles reaches their corners
    first = int(np.ceil(width / (2.0 * rho)))
    best = None
    for n in range(first, 2 * first + 3):
        slack = rho**2 - (0.5 * width / n) ** 2
        if slack > 0.0:
            m = int(np.ceil(height / (2.0 * np.sqrt(slack))))
            if best is None or n * m < best[0] * best[1]:
                best = (n, m)
    n, m = best
    x, y = (np.arange(n) + 0.5) * width / n, (np.arange(m) + 0.5) * height / m
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def _staggered(width, height, rho):
    """Rows of n + 1 and n points in turn; with s = width / n proved like the tube.

    In [0, s / 2] x [0, d] between a point (0, 0) and the next row's (s / 2, d) the
    farthest point is at (d + C / d) / 2, C = s^2 / 4; these rectangles tile the face.
    The first and the last row reach e = sqrt(rho^2 - C) outwards.
    """
    first = int(np.ceil(width / (2.0 * rho)))
    best = None
    for n in range(first, 2 * first + 3):
        slack = rho**2 - (0.5 * width / n) ** 2
        if slack <= 0.0:
            continue
        edge = np.sqrt(slack)
        inner = max(0.0, height - 2.0 * edge)
        rows = 1 + int(np.ceil(inner / (rho + edge)))
        total = rows * n + (rows + 1) // 2
        if best is None or total < best[0]:
            best = (total, n, rows, inner)
    _, n, rows, inner = best
    parts = []
    for row in range(rows):
        x = (np.arange(n + 1 - row % 2) + 0.5 * (row % 2)) * width / n
        y = 0.5 * (height - inner) + (inner * row / (rows - 1) if rows > 1 else 0.0)
        parts.append(np.column_stack([x, np.full(len(x), y)]))
    return np.concatenate(parts)
