"""Scenery of a recipe: held exactly but for meshes that are not convex, or large."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from odm.obstacles.mesh_surface import is_small_hull
from odm.obstacles.obstacles import hull_of
from odm.obstacles.scene_files import read_scene
from odm.obstacles.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from odm.obstacles.surfaces import surface_of
from roadmap.arrays import freeze
from roadmap.errors import BadInput, BadRecipe
from roadmap.ranges import check_rpy, is_between
from roadmap.transforms import moved_points, pose_of, pose_with

FARTHEST = 100.0  # [m] beyond it a pose is taken for one in another unit
# first number of a row; see `solid_distance` in odm/close_test/_static.py
PLANE, BOX, ROD, CYLINDER, HULL = 0.0, 1.0, 2.0, 3.0, 4.0
_ROUND = {"type", "name", "radius", "position", "covering_radius"}
_KEYS = {
    "plane": {"type", "name", "normal", "offset"},
    "box": {"type", "name", "size", "position", "rpy"},
    "mesh": {"type", "name", "file", "scale", "position", "rpy", "covering_radius"},
    "sphere": _ROUND,
    "capsule": _ROUND | {"length", "rpy"},
    "cylinder": _ROUND | {"length", "rpy"},
    "file": {"type", "name", "file", "position", "rpy", "covering_radius"},
}
_OF_SHAPES = {k: v - {"covering_radius"} for k, v in _KEYS.items() if k != "plane"}


@dataclass(frozen=True, eq=False)
class Scenery:
    """What stands still around the robot, in the base frame.

    Attributes:
        solids: (n, 16) exact solids; see `odm/close_test/_static.py`.
        points: (k, 3) surface points of meshes that are not among them [m].
        covering_radius: Of those points [m].
        names: Name of each solid.
        dropped: (link, solid) pairs that always touch and are not tested.
        faces: (f, 13) of the convex meshes among the solids [m].
        loose: (m, 3, 3) corners of each mesh that counts by points [m]; no map keeps
            them, since what is inside has become points by then.
    """

    solids: np.ndarray = field(default_factory=lambda: np.zeros((0, 16)))
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    covering_radius: float = 0.0
    names: tuple[str, ...] = ()
    dropped: tuple[tuple[str, str], ...] = ()
    faces: np.ndarray = field(default_factory=lambda: np.zeros((0, 13)))
    loose: tuple[np.ndarray, ...] = ()

    def __post_init__(self) -> None:
        """Freeze the arrays; refuse numbers that are not finite: they block nothing."""
        freeze(self, solids=float, points=float, faces=float)
        if self.solids.shape[1:] != (16,) or self.points.shape[1:] != (3,):
            raise BadRecipe(
                f"scenery has solids {self.solids.shape} and points "
                f"{self.points.shape}; give (n, 16) and (k, 3)"
            )
        for name in ("solids", "points", "covering_radius", "faces"):
            if not np.isfinite(getattr(self, name)).all():
                raise BadRecipe(
                    f"the {name} of scenery hold NaN or infinity, which would block "
                    "nothing; give finite numbers"
                )

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays by name, for the store."""
        arrays = {"solids": self.solids, "points": self.points}
        return arrays | ({"faces": self.faces} if len(self.faces) else {})

    def meta(self) -> dict:
        """Return the rest as plain data."""
        return {
            "covering_radius": self.covering_radius,
            "names": list(self.names),
            "dropped": [list(pair) for pair in self.dropped],
        }

    @classmethod
    def of_boxes(cls, boxes: Sequence[tuple[str, Box]]) -> "Scenery":
        """Return scenery of (name, box), base frame."""
        rows = np.array([_box_row(box) for _, box in boxes]).reshape(-1, 16)
        return cls(rows, names=tuple(name for name, _ in boxes))

    def shapes(self) -> list[tuple[str, Shape]]:
        """Return (name, shape) of the exact solids, for a picture; no half-spaces."""
        rows = zip(self.names, self.solids, strict=True)
        found = ((name, shape_of_row(row, self.faces)) for name, row in rows)
        return [(name, shape) for name, shape in found if shape is not None]

    @classmethod
    def from_store(cls, meta: dict, arrays: dict[str, np.ndarray]) -> "Scenery":
        """Make scenery again from `meta()` and `arrays()`."""
        dropped = tuple((a, b) for a, b in meta["dropped"])
        return cls(
            arrays["solids"],
            arrays["points"],
            meta["covering_radius"],
            tuple(meta["names"]),
            dropped,
            arrays.get("faces", np.zeros((0, 13))),
        )


def shape_of_row(row: np.ndarray, faces: np.ndarray) -> Shape | None:
    """Return the shape of a row of `Scenery.solids`; None: it is a half-space."""
    kind, middle = row[0], row[1:4]
    if kind == BOX:
        return Box(2.0 * row[13:16], pose_with(row[4:13].reshape(3, 3), middle))
    if kind == ROD:
        return Capsule.between(middle, middle + row[4:7], row[7])
    if kind == CYLINDER:
        half = row[8] * row[4:7]
        return Cylinder.between(middle - half, middle + half, row[7])
    if kind == HULL:
        corners = faces[int(row[5]) : int(row[6]), 4:13].reshape(-1, 3)
        return Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
    return None


def parse_scenery(
    tables: tuple[dict, ...], folder: Path | None = None, *, meshes: bool = True
) -> Scenery:
    """Make scenery from the [[scenery]] tables of a recipe.

    Args:
        tables: As in the TOML file.
        folder: Where relative paths of files start; None: the current folder.
        meshes: Whether files are read, and meshes sampled, or only looked for.

    Raises:
        BadRecipe: An unknown type or key, or a value that makes no solid.
    """
    made = _Made([], [], [np.zeros((0, 3))], [], [])
    rho = 0.0
    for k, table in enumerate(tables):
        kind, name = _kind_and_name(table, k, _KEYS)
        if kind == "plane":
            made.rows.append(_plane_row(table, k))
            made.names.append(name)
            continue
        spacing = _number(table, k, "covering_radius", 0.01, 1e-4, 0.5)
        for label, shape in _shapes_of(table, k, kind, name, folder, meshes):
            _check_place(k, label, shape)
            rho = max(rho, made.add(label, shape, spacing))
    rows = np.array(made.rows) if made.rows else np.zeros((0, 16))
    faces = np.concatenate([np.zeros((0, 13)), *made.faces])
    points = np.concatenate(made.points)
    names, loose = tuple(made.names), tuple(made.loose)
    return Scenery(rows, points, rho, names, faces=faces, loose=loose)


def shapes_of_tables(
    tables: Sequence[dict], folder: Path | None = None
) -> list[tuple[str, Shape]]:
    """Return (name, shape) of what [[scenery]] tables hold, but for half-spaces.

    Relative paths start at `folder`; None: the current one. A plane, a
    `covering_radius` and unknown types, keys and values are refused.
    """
    found = []
    for k, table in enumerate(tables):
        kind, name = _kind_and_name(table, k, _OF_SHAPES)
        found += _shapes_of(table, k, kind, name, folder, True)
    return found


def _kind_and_name(
    table: dict, k: int, known: Mapping[str, set[str]]
) -> tuple[str, str]:
    """Return the type of a table and its name, or refuse a type or key not known."""
    if not isinstance(table, dict):
        raise BadRecipe(f"scenery {k} is {table!r}; write a table [[scenery]]")
    kind = table.get("type")
    if not isinstance(kind, str) or kind not in known:
        raise BadRecipe(
            f"scenery {k} has type {kind!r}; choose one of {', '.join(known)}"
        )
    unknown = set(table) - known[kind]
    if unknown:
        raise BadRecipe(
            f"scenery {k} ({kind}) has no key {sorted(unknown)[0]!r}; known keys: "
            f"{', '.join(sorted(known[kind]))}"
        )
    return kind, str(table.get("name", f"{kind} {k}"))


@dataclass(frozen=True)
class _Made:
    """What the tables come to; see `Scenery`."""

    rows: list[np.ndarray]
    names: list[str]
    points: list[np.ndarray]
    faces: list[np.ndarray]
    loose: list[np.ndarray]

    def add(self, name: str, shape: Shape, spacing: float) -> float:
        """Add a shape; return the covering radius of its points, 0 for none."""
        row = np.zeros(16)
        T = shape.T_base_shape
        if isinstance(shape, Box):
            row = _box_row(shape)
        elif isinstance(shape, Sphere | Capsule):
            a, b = (T[:3, 3],) * 2 if isinstance(shape, Sphere) else shape.ends()
            row[0], row[1:4], row[4:7] = ROD, a, b - a
            row[7], row[8] = shape.radius, (b - a) @ (b - a)
        elif isinstance(shape, Cylinder):
            row[0], row[1:4], row[4:7] = CYLINDER, T[:3, 3], T[:3, 2]
            row[7], row[8] = shape.radius, 0.5 * shape.length
        elif is_small_hull(shape.vertices, shape.faces):
            first = sum(map(len, self.faces))
            vertices = moved_points(shape.vertices, T)
            hull = hull_of(Mesh(vertices, shape.faces))
            self.faces.append(hull.faces)
            row[0], row[1:5] = HULL, hull.ball
            row[5:7] = first, first + len(hull.faces)
        else:
            surface = surface_of(shape, spacing)
            self.points.append(surface.points)
            self.loose.append(moved_points(shape.vertices, T)[shape.faces])
            return surface.covering_radius
        self.rows.append(row)
        self.names.append(name)
        return 0.0


def _box_row(box: Box) -> np.ndarray:
    row, T = np.zeros(16), box.T_base_shape
    row[0], row[1:4] = BOX, T[:3, 3]
    row[4:13], row[13:16] = T[:3, :3].ravel(), np.asarray(box.size) / 2
    return row


def _shapes_of(
    table: dict, k: int, kind: str, name: str, folder: Path | None, meshes: bool
) -> list[tuple[str, Shape]]:
    """Return (name, shape) of what a table holds; none of files only looked for."""
    if kind == "box":
        size = _numbers(table, k, "size", None, "lengths above 0")
        if not (size > 0).all():
            raise BadRecipe(
                f"scenery {k}: size {size.tolist()} must be 3 lengths above 0 [m]; "
                "correct it"
            )
        return [(name, Box(size, _pose(table, k)))]
    if kind in ("mesh", "file"):
        pose, scale = _pose(table, k), _scale_of(table, k)
        file = _file_of(table, k, kind, folder)
        if kind == "mesh" and not meshes:
            return []
        if kind == "mesh":
            return [(name, Mesh.from_file(file, scale=scale).moved(pose))]
        try:
            objects = read_scene(file)
        except BadInput as error:
            raise BadRecipe(f"scenery {k}: {error}") from error
        if not any(shapes for _, shapes, _ in objects):
            raise BadRecipe(
                f"scenery {k}: {file} holds no shapes, so nothing would stand there; "
                "put some in, or leave it out"
            )
        return [
            (label, shape.moved(pose @ T))
            for label, shapes, T in objects
            for shape in shapes
        ]
    sizes = [_number(table, k, "radius", None, 1e-6, 100.0)]
    if kind != "sphere":
        least = 0.0 if kind == "capsule" else 1e-6
        sizes.append(_number(table, k, "length", None, least, 1e3))
    make = {"sphere": Sphere, "capsule": Capsule, "cylinder": Cylinder}[kind]
    return [(name, make(*sizes, _pose(table, k)))]


def _check_place(k: int, name: str, shape: Shape) -> None:
    """Refuse what stands so far away that its unit must be another one."""
    if isinstance(shape, Mesh):
        size = np.linalg.norm(shape.vertices, axis=1).max()
    elif isinstance(shape, Box):
        size = 0.5 * np.linalg.norm(shape.size)
    else:
        size = shape.radius + 0.5 * getattr(shape, "length", 0.0)
    nearest = np.linalg.norm(shape.T_base_shape[:3, 3]) - size
    if nearest > FARTHEST:
        raise BadRecipe(
            f"scenery {k}: {name!r} would stand {nearest:.0f} m from the robot's base, "
            f"more than {FARTHEST:g} m; give metres"
        )


def _plane_row(table: dict, k: int) -> np.ndarray:
    normal = _numbers(table, k, "normal", (0.0, 0.0, 1.0))
    largest = np.abs(normal).max()
    if largest == 0.0:
        raise BadRecipe(
            f"scenery {k}: normal {normal.tolist()} is no direction; give 3 numbers "
            "that are not all 0"
        )
    length = largest * np.linalg.norm(normal / largest)
    row = np.zeros(16)
    row[1:4] = normal / length
    row[4] = _number(table, k, "offset", 0.0, -1e3 * length, 1e3 * length) / length
    return row


def _pose(table: dict, k: int) -> np.ndarray:
    zeros = (0.0, 0.0, 0.0)
    position = _numbers(table, k, "position", zeros)
    rpy = _numbers(table, k, "rpy", zeros)
    check_rpy(f"scenery {k}: rpy", rpy, BadRecipe)
    return pose_of(position, rpy)


def _numbers(
    table: dict, k: int, key: str, default: object, what: str = "numbers"
) -> np.ndarray:
    """Return three numbers of a table, from -1000 to 1000."""
    value = table.get(key, default)
    listed = isinstance(value, list | tuple | np.ndarray) and len(value) == 3
    if not listed or not all(is_between(v, -1e3, 1e3) for v in value):
        raise BadRecipe(
            f"scenery {k}: {key} is {value!r}, but must be 3 {what}, none beyond "
            "1000 either way; correct it"
        )
    return np.array(value, float)


def _number(
    table: dict, k: int, key: str, default: float | None, low: float, high: float
) -> float:
    value: Any = table.get(key, default)
    if not is_between(value, low, high):
        raise BadRecipe(
            f"scenery {k}: {key} is {value!r}, but must be a number from {low:g} to "
            f"{high:g}; correct it"
        )
    return float(value)


def _file_of(table: dict, k: int, kind: str, folder: Path | None) -> Path:
    """Return the file that a table names, which is there."""
    name, what = table.get("file"), "a mesh" if kind == "mesh" else "a file"
    if not isinstance(name, str):
        raise BadRecipe(f"scenery {k}: {what} needs a file, not {name!r}; name it")
    file = Path(folder or "", name)
    if file.is_dir():
        raise BadRecipe(f"scenery {k}: {file} is a folder; name a {kind} in it")
    if not file.is_file():
        raise BadRecipe(f"scenery {k}: there is no {kind} {file}; correct its file")
    return file


def _scale_of(table: dict, k: int) -> float | np.ndarray:
    if isinstance(table.get("scale"), list | tuple):
        scale = _numbers(table, k, "scale", None)
    else:
        scale = _number(table, k, "scale", 1.0, 1e-9, 1e6)
    if not np.all(scale):
        raise BadRecipe(f"scenery {k}: scale {scale} holds 0; correct it")
    return scale
