"""Closed shapes an obstacle can have; every shape is a solid with a pose."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike

from roadmap.arrays import as_floats, frozen
from roadmap.errors import BadInput
from roadmap.geometry.solids import hull_facets
from roadmap.ranges import is_between
from roadmap.robot.robot import BOX, CYLINDER, SPHERE
from roadmap.transforms import check_pose, pose_with, rotation_to_z

LARGEST = 1000.0  # [m] size of a shape


def _check_size(kind: str, name: str, value: float, zero: bool = False) -> float:
    if not is_between(value, 0.0, LARGEST) or (value == 0.0 and not zero):
        limit = "at least 0" if zero else "above 0"
        raise BadInput(
            f"{name} {value} m of a {kind} must be {limit} and at most {LARGEST:g} m: "
            "correct it, or give metres"
        )
    return float(value)


class _Posed:
    T_base_shape: np.ndarray

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _check_pose(self) -> None:
        T = check_pose(self.T_base_shape, "the pose of a shape")
        self._set("T_base_shape", frozen(T, np.float64))

    def moved(self, T: np.ndarray) -> "Shape":
        """Return the shape moved by `T` (4, 4): its pose becomes T @ T_base_shape."""
        T = check_pose(T, "T") @ self.T_base_shape
        return replace(self, T_base_shape=T)  # type: ignore[type-var, return-value]


def _identity() -> np.ndarray:
    return np.eye(4)


@dataclass(frozen=True, eq=False)
class Sphere(_Posed):
    """A ball of `radius` [m] about the shape's origin."""

    radius: float
    T_base_shape: np.ndarray = field(default_factory=_identity)

    def __post_init__(self) -> None:
        self._set("radius", _check_size("sphere", "radius", self.radius))
        self._check_pose()


@dataclass(frozen=True, eq=False)
class _Rod(_Posed):
    radius: float
    length: float
    T_base_shape: np.ndarray = field(default_factory=_identity)

    def __post_init__(self) -> None:
        kind = type(self).__name__.lower()
        round_end = isinstance(self, Capsule)
        self._set("radius", _check_size(kind, "radius", self.radius))
        self._set("length", _check_size(kind, "length", self.length, round_end))
        self._check_pose()

    @classmethod
    def between(cls, a: np.ndarray, b: np.ndarray, radius: float) -> Self:
        """Return the rod whose axis runs from `a` to `b`, (3,) each [m]."""
        ends = as_floats("the ends of a rod", [a, b])
        if ends.shape != (2, 3):
            raise BadInput(
                f"the ends of a rod have shape {ends.shape[1:]}; give two places (3,)"
            )
        a, b = ends
        length = float(np.linalg.norm(b - a))
        flat = not 1e-12 <= length < np.inf  # what is not finite is refused elsewhere
        R = np.eye(3) if flat else rotation_to_z((b - a) / length)
        return cls(radius, length, pose_with(R, 0.5 * (a + b)))

    def ends(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the two ends of the axis, (3,) each, in the base frame [m]."""
        half = 0.5 * self.length * self.T_base_shape[:3, 2]
        middle = self.T_base_shape[:3, 3]
        return middle - half, middle + half


class Capsule(_Rod):
    """Points within `radius` of a segment of `length` along z, both [m].

    The segment is centred on the shape's origin; length 0 is a sphere.
    """


class Cylinder(_Rod):
    """A cylinder of `radius` and `length` along z about the shape's origin [m]."""


@dataclass(frozen=True, eq=False)
class Box(_Posed):
    """A box of full edge lengths `size` (3,) [m] about the shape's origin."""

    size: np.ndarray
    T_base_shape: np.ndarray = field(default_factory=_identity)

    if TYPE_CHECKING:

        def __init__(self, size: ArrayLike, T_base_shape: np.ndarray = ...) -> None:
            """Make it of anything that numpy takes for an array."""

    def __post_init__(self) -> None:
        size = as_floats("the size of a box", self.size)
        if size.shape != (3,):
            raise BadInput(f"a box has 3 edge lengths, not shape {size.shape}")
        for value in size.tolist():
            _check_size("box", "edge length", value)
        self._set("size", frozen(size, np.float64))
        self._check_pose()


@dataclass(frozen=True, eq=False)
class Mesh(_Posed):
    """A closed triangle mesh: `vertices` (n, 3) [m], `faces` (m, 3) indices.

    One that is not closed is refused. One that is inside out, as some drawing
    programs write them, has its faces turned round: they are kept counterclockwise
    seen from outside.
    """

    vertices: np.ndarray
    faces: np.ndarray
    T_base_shape: np.ndarray = field(default_factory=_identity)

    if TYPE_CHECKING:

        def __init__(
            self, vertices: ArrayLike, faces: ArrayLike, T_base_shape: np.ndarray = ...
        ) -> None:
            """Make it of anything that numpy takes for an array."""

    def __post_init__(self) -> None:
        """Check the arrays, and that the mesh is closed; turn it outside out."""
        from odm.obstacles.mesh_surface import require_solid, turned_alike, volume

        vertices = as_floats("the vertices of a mesh", self.vertices)
        faces = as_floats("the faces of a mesh", self.faces)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.shape[1:] != (3,):
            raise BadInput(
                f"a mesh needs vertices (n, 3) and faces (m, 3), not {vertices.shape} "
                f"and {faces.shape}: give it triangles"
            )
        if not np.isfinite(vertices).all():
            raise BadInput("a mesh has a vertex that is not finite: repair the mesh")
        named = (faces >= 0) & (faces < len(vertices)) & (faces == np.floor(faces))
        if len(faces) == 0 or not named.all():
            raise BadInput(
                f"a mesh of {len(vertices)} vertices has no faces, or one that names "
                "a missing vertex: repair the mesh"
            )
        size = float(np.ptp(vertices, axis=0).max())
        if not 0.0 < size <= LARGEST:
            raise BadInput(
                f"a mesh is {size:g} m long, but must be longer than 0 and at most "
                f"{LARGEST:g} m: correct its scale, or give metres"
            )
        faces = faces.astype(np.int64)
        require_solid(vertices, faces)
        faces = turned_alike(vertices, faces)
        if volume(vertices, faces) < 0.0:
            faces = faces[:, ::-1]
        self._set("vertices", frozen(vertices, np.float64))
        self._set("faces", frozen(faces, np.int64))
        self._check_pose()

    @classmethod
    def hull_of(cls, points: np.ndarray, T_base_shape: np.ndarray) -> "Mesh":
        """Return the convex hull of points (n, 3) [m] in the shape's frame.

        Raises:
            BadInput: The points are not (n, 3), lie in a plane, or are not finite.
        """
        from scipy.spatial import QhullError

        points = as_floats("the points of a hull", points)
        if points.ndim != 2 or points.shape[1] != 3:  # others end the process in qhull
            raise BadInput(
                f"the points of a hull have shape {points.shape}; give (n, 3) in metres"
            )
        try:
            faces = hull_facets(points)
        except (QhullError, ValueError) as error:
            raise BadInput(
                f"{len(points)} points have no convex hull: give four or more finite "
                "ones that do not lie in a plane"
            ) from error
        return cls(points, faces, T_base_shape)

    @classmethod
    def from_file(cls, path: str | Path, scale: float | np.ndarray = 1.0) -> "Mesh":
        """Read a mesh (STL, OBJ, PLY, ...); `scale` turns its unit into metres."""
        import trimesh

        if not Path(path).is_file():
            raise BadInput(f"mesh file {path} does not exist: check the path")
        factors = as_floats("the scale of a mesh", scale)
        if (
            factors.size not in (1, 3)
            or not np.isfinite(factors).all()
            or not all(factors.ravel())
        ):
            raise BadInput(
                f"the scale {scale} of {path} is no factor: give one number, or three, "
                "that turn its unit into metres, such as 0.001"
            )
        try:
            with np.errstate(all="ignore"):  # of corners too far off for its tables
                mesh = trimesh.load_mesh(path)
            vertices = np.asarray(mesh.vertices, float) * scale
            return cls(vertices, np.asarray(mesh.faces))
        except BadInput as error:
            raise BadInput(f"mesh file {path}: {error}") from error
        except Exception as error:  # trimesh's readers raise what they like
            raise BadInput(f"mesh file {path} cannot be read ({error})") from error


Shape = Sphere | Capsule | Cylinder | Box | Mesh


def shape_of(kind: int, size: np.ndarray, points: np.ndarray, T: np.ndarray) -> Shape:
    """Return a collision solid of a robot as a shape.

    Args:
        kind: HULL, BOX, CYLINDER or SPHERE of `roadmap.robot.robot`.
        size: (3,) edges of a box, radius and length of a cylinder, radius of a ball,
            the rest unused [m].
        points: (n, 3) points whose hull is meant, of HULL only [m].
        T: (4, 4) pose of the solid [m].

    Raises:
        BadInput: No rigid pose, no size, or points without a hull.
    """
    if kind == BOX:
        return Box(size, T)
    if kind == CYLINDER:
        return Cylinder(size[0], size[1], T)
    if kind == SPHERE:
        return Sphere(size[0], T)
    return Mesh.hull_of(points, T)
