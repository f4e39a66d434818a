"""What stands around a robot, as triangles and as balls, for pictures."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from odm import ReactivePlanner
from odm.obstacles import shapes
from odm.obstacles.surfaces import Surface
from roadmap.transforms import moved_points

if TYPE_CHECKING:
    import trimesh

_SECTIONS = 16  # facets of a round solid
_GRAIN = 0.03  # [m] between the balls of a triangle
_MOST_STEPS = 30  # between the corners of a triangle, however large it is
_LIGHT = np.array([0.35, -0.5, 0.8]) / np.linalg.norm([0.35, -0.5, 0.8])


def scene_of(planner: ReactivePlanner) -> list[shapes.Shape]:
    """Return the shapes of a planner's scene, world frame; no surfaces of points."""
    parts = [part for _, part in planner.scene.shapes()]
    return [part for part in parts if not isinstance(part, Surface)]


def standing_of(planner: ReactivePlanner) -> list[shapes.Shape]:
    """Return the shapes of a planner's map and scene, world frame; no half-spaces."""
    fixed = [shape for _, shape in planner.cell_map.scenery.shapes()]
    return fixed + scene_of(planner)


def all_triangles(found: Iterable[shapes.Shape]) -> np.ndarray:
    """Return the triangles (n, 3, 3) of all of some solids [m]."""
    return np.concatenate(
        [np.empty((0, 3, 3)), *(triangles_of(shape) for shape in found)]
    )


def triangles_of(shape: shapes.Shape) -> np.ndarray:
    """Return the triangles (n, 3, 3) of a solid at its pose [m]."""
    import trimesh

    if isinstance(shape, shapes.Mesh):
        corners = shape.vertices[shape.faces]
    else:
        if isinstance(shape, shapes.Sphere):
            mesh = trimesh.creation.icosphere(subdivisions=2, radius=shape.radius)
        elif isinstance(shape, shapes.Box):
            mesh = trimesh.creation.box(shape.size)
            mesh = mesh.subdivide_to_size(0.25)  # small facets hide each other better
        elif isinstance(shape, shapes.Capsule):
            mesh = capsule_mesh(shape.length, shape.radius, 16, 64)
        else:
            mesh = trimesh.creation.cylinder(
                shape.radius, shape.length, sections=_SECTIONS
            )
        corners = np.asarray(mesh.triangles)
    return moved_points(corners, shape.T_base_shape)


def capsule_mesh(
    length: float, radius: float, rings: int = 10, sides: int = 36
) -> "trimesh.Trimesh":
    """Return a capsule along z, its middle at the origin [m]; `rings` are of an end."""
    import trimesh

    mesh = trimesh.creation.capsule(length, radius, [2 * rings, sides])
    return mesh.apply_translation(-mesh.bounds.mean(axis=0))


def add_shaded(
    axis: object, parts: list[tuple[np.ndarray, str]], zoom: float
) -> np.ndarray:
    """Draw triangles as one collection, so that nearer ones hide farther ones.

    `parts` are (n, 3, 3) triangles [m] and their colour, all of which are returned. The
    three-dimensional axis is left without its box.
    """
    from matplotlib.colors import to_rgb
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    triangles = np.concatenate([corners for corners, _ in parts])
    colours = np.concatenate(
        [np.tile(to_rgb(colour), (len(corners), 1)) for corners, colour in parts]
    )
    shade = 0.62 + 0.38 * np.abs(normals_of(triangles) @ _LIGHT)
    axis.add_collection3d(
        Poly3DCollection(triangles, facecolors=colours * shade[:, None], linewidths=0.0)
    )
    axis.set_proj_type("ortho")
    axis.set_box_aspect((1, 1, 1), zoom=zoom)
    axis.set_axis_off()
    return triangles


def normals_of(triangles: np.ndarray) -> np.ndarray:
    """Return the unit normals (n, 3) of triangles (n, 3, 3)."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    return normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]


def show_box(axis: object, low: np.ndarray, high: np.ndarray) -> None:
    """Show the cube around a box, from `low` to `high` (3,) [m]."""
    half = 0.5 * float((high - low).max())
    for name, at in zip("xyz", 0.5 * (low + high), strict=True):
        getattr(axis, f"set_{name}lim")(at - half, at + half)


def balls_of(triangles: np.ndarray) -> np.ndarray:
    """Return triangles (n, 3, 3) as balls (m, 4) near each other [m]."""
    rows = [np.zeros((0, 4))]
    for a, b, c in triangles:
        sides = [np.linalg.norm(q - p) for p, q in ((a, b), (b, c), (c, a))]
        n = min(1 + int(max(sides) / _GRAIN), _MOST_STEPS)
        i, j = np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)]).T / n
        points = a + i[:, None] * (b - a) + j[:, None] * (c - a)
        radius = 0.6 * max(max(sides) / n, _GRAIN / 2)
        rows.append(np.column_stack([points, np.full(len(points), radius)]))
    return np.concatenate(rows)
