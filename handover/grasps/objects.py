"""What is handed over as a solid: closed meshes, their mass, and six of our own.

All lengths of our own objects are estimates of common things; what decided them stands
beside each. An object may be of several closed parts that overlap a little, as a
hammer's head and handle: the solid is their union.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from odm.obstacles.mesh_surface import closed_triangles
from odm.obstacles.shapes import Mesh
from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.ranges import check_path
from roadmap.transforms import moved_points, pose_of

LARGEST, SMALLEST = 1.0, 0.005  # [m] longest edge of the box of what hands pass on
_SIDES = 24  # facets of a round part


@dataclass(frozen=True, eq=False)
class GraspObject:
    """An object that hands can grasp.

    Attributes:
        name: What people call it.
        parts: Closed meshes, object frame [m]; the solid is their union.
        masses: (k,) of each part [kg].
        center: (3,) centre of mass, object frame [m].
        radius: Distance of the farthest point from `center` [m].
    """

    name: str
    parts: tuple[Mesh, ...]
    masses: np.ndarray
    center: np.ndarray
    radius: float

    @property
    def mass_kg(self) -> float:
        """Mass of the whole [kg]."""
        return float(self.masses.sum())

    def triangles(self) -> list[np.ndarray]:
        """Return the corners (m, 3, 3) of each part, object frame [m]."""
        return [part_triangles(part) for part in self.parts]

    def fingerprint(self) -> str:
        """Return a SHA-256 over shape and mass, rounded to a nanometre."""
        digest = hashlib.sha256()
        for array in (*self.triangles(), self.masses):
            digest.update(str(array.shape).encode())
            digest.update((np.round(array, 9) + 0.0).tobytes())
        return digest.hexdigest()


def part_triangles(part: Mesh) -> np.ndarray:
    """Return the corners (m, 3, 3) of a mesh at its pose [m]."""
    return moved_points(part.vertices[part.faces], part.T_base_shape)


def make_object(
    name: str, parts: list[Mesh] | tuple[Mesh, ...], masses: list[float] | np.ndarray
) -> GraspObject:
    """Return an object, checked.

    Args:
        name: What people call it.
        parts: Closed meshes, object frame [m].
        masses: Mass of each [kg]; each is of one density.

    Raises:
        BadInput: A mesh that is open, without volume or in the wrong unit, or a mass
            out of range.
    """
    masses = np.asarray(masses, float)
    if not parts or masses.shape != (len(parts),):
        raise BadInput(
            f"{name} has {len(parts)} parts and masses of shape {masses.shape}; give "
            "at least one closed mesh, and a mass for each"
        )
    if not (np.isfinite(masses).all() and (masses > 0).all() and masses.sum() < 100):
        raise BadInput(
            f"{name} has a mass of {masses.tolist()} kg; give more than 0 and, in all, "
            "less than 100"
        )
    triangles = [_checked_part(name, part) for part in parts]
    points = np.concatenate(triangles).reshape(-1, 3)
    _check_size(name, float(np.ptp(points, axis=0).max()))
    centers = np.array([_center_of(corners) for corners in triangles])
    center = masses @ centers / masses.sum()
    radius = float(np.linalg.norm(points - center, axis=1).max())
    return GraspObject(
        name,
        tuple(parts),
        frozen(masses, np.float64),
        frozen(center, np.float64),
        radius,
    )


def load_object(
    source: str | Path, mass_kg: float | None = None, scale: float = 1.0
) -> GraspObject:
    """Return one of our objects by name, or a mesh file as an object.

    Args:
        source: One of `object_names()`, or the path of a closed mesh (STL, OBJ, ...).
        mass_kg: Mass of a mesh file [kg]; left out, 500 kg/m3 times its volume.
        scale: What turns the file's unit into metres.

    Raises:
        BadInput: No such name or file, or a mesh that `make_object` refuses.
    """
    path = check_path("an object", source, "give its name or the path of a mesh")
    if str(source) in _OBJECTS:
        if mass_kg is not None or scale != 1.0:
            raise BadInput(
                f"{source} is an object of ours with a mass and a size of its own; "
                "leave mass and scale out, or give a mesh file"
            )
        return _OBJECTS[str(source)]()
    if not path.is_file():
        raise BadInput(
            f"there is no object {str(source)!r} and no mesh file of that name; give "
            f"one of {', '.join(object_names())} or the path of a closed mesh"
        )
    mesh = Mesh.from_file(path, scale)
    _check_size(path.stem, float(np.ptp(mesh.vertices, axis=0).max()))
    mesh = _welded(mesh)
    if mass_kg is None:
        mass_kg = max(500.0 * _volume(_checked_part(path.stem, mesh)), 1e-6)
    return make_object(path.stem, [mesh], [mass_kg])


def object_names() -> list[str]:
    """Return the names that `load_object` takes in place of a file."""
    return sorted(_OBJECTS)


def _welded(mesh: Mesh) -> Mesh:
    """Return the mesh with corners at the same place made one (STL has none shared)."""
    import trimesh

    whole = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    return Mesh(whole.vertices, whole.faces) if len(whole.faces) else mesh


def _checked_part(name: str, part: Mesh) -> np.ndarray:
    """Return the triangles of a part, outside out; refuse what is no solid."""
    corners = part_triangles(part)
    try:
        closed_triangles(part.vertices, part.faces)
    except BadInput as error:
        raise BadInput(f"{name}: {error}") from error
    longest = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    if _volume(corners) <= 1e-9 * longest**3:
        raise BadInput(
            f"{name} has a volume of {_volume(corners):.3g} m3; give a closed mesh "
            "whose triangles turn counterclockwise seen from outside"
        )
    return corners


def _volume(corners: np.ndarray) -> float:
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return float(np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6.0)


def _center_of(corners: np.ndarray) -> np.ndarray:
    """Return the centroid of a solid: that of its cones to the origin, by volume."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    volumes = np.einsum("ni,ni->n", a, np.cross(b, c))
    return volumes @ (a + b + c) / (4.0 * volumes.sum())


def _check_size(name: str, size: float) -> None:
    if SMALLEST <= size <= LARGEST:
        return
    scale, unit = (0.01, "centi") if size <= 100.0 * LARGEST else (0.001, "milli")
    hint = f"if it is drawn in {unit}metres, give a scale of {scale:g}"
    if size < 5.0 * LARGEST:  # in centimetres it would be a crumb
        hint = "longer things are not held at one end"
    if size < SMALLEST:
        hint = "give all lengths in metres, with a scale that makes them so"
    raise BadInput(
        f"{name} is {size:.4g} m long, but hands pass on things of {SMALLEST:g} to "
        f"{LARGEST:g} m; {hint}"
    )


def _turned(profile: list[tuple[float, float]]) -> Mesh:
    """Return a solid of revolution about z; `profile` (r, z) from axis to axis."""
    import trimesh

    solid = trimesh.creation.revolve(np.array(profile), sections=_SIDES)
    return Mesh(solid.vertices, solid.faces)


def _rod(radius: float, length: float, T: np.ndarray | None = None) -> Mesh:
    """Return a cylinder along z about the origin of `T`."""
    h = 0.5 * length
    mesh = _turned([(0.0, -h), (radius, -h), (radius, h), (0.0, h)])
    return _placed(mesh, T)


def _block(size: tuple[float, float, float], T: np.ndarray | None = None) -> Mesh:
    import trimesh

    solid = trimesh.creation.box(size)
    return _placed(Mesh(solid.vertices, solid.faces), T)


def _placed(mesh: Mesh, T: np.ndarray | None) -> Mesh:
    """Return the mesh with its vertices moved, so that its pose stays the identity."""
    if T is None:
        return mesh
    return Mesh(moved_points(mesh.vertices, T), mesh.faces)


_ALONG_X = pose_of((0.0, 0.0, 0.0), (0.0, 0.5 * np.pi, 0.0))


def _cup() -> GraspObject:
    """A plastic cup, open above: 95 mm high, 80 mm wide at the rim, walls of 4 mm.

    Origin in the middle of its bottom, z out of its opening. A common picnic cup; open,
    since upside down and upright differ in the butler scene.
    """
    outside = [(0.0, 0.0), (0.032, 0.0), (0.040, 0.095)]
    inside = [(0.036, 0.095), (0.0285, 0.006), (0.0, 0.006)]
    return make_object("cup", [_turned(outside + inside)], [0.12])


def _food_jar() -> GraspObject:
    """A full jar of dog food with its lid: 86 mm wide, 118 mm high, 0.45 kg.

    Origin in the middle of its bottom, z out of its lid. A common 500 ml jar.
    """
    profile = [(0.0, 0.0), (0.043, 0.0), (0.043, 0.1), (0.0445, 0.1), (0.0445, 0.118)]
    return make_object("food_jar", [_turned([*profile, (0.0, 0.118)])], [0.45])


def _hammer() -> GraspObject:
    """A hammer of 0.31 m: wooden handle of 0.20 kg, steel head of 0.45 kg.

    Origin in the middle of the handle, x along it to the head; the head lies along y,
    its face towards +y. A common 16 ounce hammer; the claw is a wedge.
    """
    along_y = pose_of((0.145, 0.045, 0.0), (0.5 * np.pi, 0.0, 0.0))
    parts = [
        _placed(_rod(0.0145, 0.28), _ALONG_X),
        _block((0.030, 0.060, 0.028), pose_of((0.150, 0.0, 0.0))),
        _rod(0.0145, 0.034, along_y),
        _block((0.024, 0.050, 0.016), pose_of((0.150, -0.054, 0.0))),
    ]
    return make_object("hammer", parts, [0.20, 0.28, 0.11, 0.06])


def _wrench() -> GraspObject:
    """An open-ended wrench of 0.25 m, 0.25 kg, as `handover.wrench`.

    Origin in the middle, x along the handle to the open jaw, z normal to its flat side.
    """
    parts = [
        _block((0.19, 0.022, 0.009)),
        _rod(0.021, 0.012, pose_of((-0.104, 0.0, 0.0))),
        _block((0.022, 0.044, 0.012), pose_of((0.101, 0.0, 0.0))),
        _block((0.020, 0.012, 0.012), pose_of((0.119, 0.0155, 0.0))),
        _block((0.020, 0.012, 0.012), pose_of((0.119, -0.0155, 0.0))),
    ]
    return make_object("wrench", parts, [0.10, 0.06, 0.05, 0.02, 0.02])


def _mallet() -> GraspObject:
    """A wooden mallet of 0.32 m, 0.6 kg, as `handover.mallet`.

    Origin in the head's middle, x along the handle to its end, z along the head.
    """
    handle = pose_of((0.15, 0.0, 0.0), (0.0, 0.5 * np.pi, 0.0))
    parts = [_rod(0.014, 0.30, handle), _rod(0.035, 0.13)]
    return make_object("mallet", parts, [0.15, 0.45])


def _box() -> GraspObject:
    """A full box of tea, 140 x 90 x 50 mm, 0.3 kg; origin in its middle.

    Its narrow side fits between all our hands' fingers, its wide ones do not.
    """
    return make_object("box", [_block((0.14, 0.09, 0.05))], [0.3])


_OBJECTS: dict[str, Callable[[], GraspObject]] = {
    "box": _box,
    "cup": _cup,
    "food_jar": _food_jar,
    "hammer": _hammer,
    "mallet": _mallet,
    "wrench": _wrench,
}
