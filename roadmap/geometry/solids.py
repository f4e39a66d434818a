"""The exact solids of a link: hulls of meshes, boxes, cylinders, spheres."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from roadmap.robot.description import Link, Shape
from roadmap.robot.meshes import find_mesh, read_vertices
from roadmap.robot.robot import BOX, CYLINDER, HULL, SPHERE
from roadmap.transforms import moved_points

# What is thinner than this is no solid: the points of a mesh become cubes of this edge,
# a primitive gets as thick [m].
MIN_THICKNESS = 1e-4
_TOLD = f"is flat; thickened to {MIN_THICKNESS * 1e3:g} mm"
_PRIMITIVES = {  # kind, and the least of each of its sizes
    "box": (BOX, (MIN_THICKNESS,) * 3),
    "cylinder": (CYLINDER, (MIN_THICKNESS / 2, MIN_THICKNESS)),
    "sphere": (SPHERE, (MIN_THICKNESS / 2,)),
}


@dataclass(frozen=True, eq=False)
class Solid:
    """A convex solid at `T_body_solid`; see `Robot.solid_kind` for kinds and sizes."""

    kind: int
    link: int
    T_body_solid: np.ndarray
    size: tuple[float, ...] = (0.0, 0.0, 0.0)
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))

    def body_points(self) -> np.ndarray:
        """Return the hull's vertices in the body frame, (n, 3) [m]."""
        return moved_points(self.points, self.T_body_solid)


def solid_of(
    shape: Shape, owner: Link, index: int, T_body_link: np.ndarray, lookup: tuple
) -> tuple[Solid, str]:
    """Return the solid of one shape, and a note where it had to be thickened.

    `owner` is its link, the `index`-th of those with geometry; `T_body_link` (4, 4)
    places it in the body [m]. Meshes are looked up by the path of the URDF.
    """
    pose = T_body_link @ shape.T_link_shape
    if shape.kind != "mesh":
        kind, least = _PRIMITIVES[shape.kind]
        size = tuple(map(max, shape.size, least))
        is_thin = size != shape.size
        note = f"{owner.name}: a {shape.kind} {_TOLD}" if is_thin else ""
        return Solid(kind, index, pose, (*size, 0.0, 0.0)[:3]), note
    urdf, package_dirs = lookup
    path = find_mesh(shape.filename, Path(urdf), package_dirs, owner.name)
    points = read_vertices(path, shape.size, owner.name)
    points, is_flat = _thickened(points)
    note = f"{owner.name}: the mesh {path.name} {_TOLD}" if is_flat else ""
    corners = hull_corners(np.unique(points, axis=0))
    return Solid(HULL, index, pose, points=corners), note


def _thickened(points: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the points, or cubes around them where they span no volume."""
    centred = points - points.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    thickness = np.ptp(centred @ axes.T, axis=0)
    if len(thickness) == 3 and thickness.min() >= MIN_THICKNESS:
        return points, False
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    corners *= MIN_THICKNESS / 2
    return (points[:, None, :] + corners).reshape(-1, 3), True


def hull_corners(points: np.ndarray) -> np.ndarray:
    """Return those of points (n, 3) that are corners of their hull, in their order."""
    from scipy.spatial import ConvexHull  # what needs no hull need not load it

    return points[ConvexHull(points).vertices]


def hull_facets(points: np.ndarray) -> np.ndarray:
    """Return the triangles (m, 3) int of the hull of points (n, 3), turned outwards.

    qhull, whose error it passes on where points lie in a plane, turns them either way.
    """
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    facets = hull.simplices.astype(np.int64)
    a, b, c = (points[facets[:, k]] for k in range(3))
    inward = np.einsum("ni,ni->n", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    facets[inward] = facets[inward][:, [0, 2, 1]]
    return facets
