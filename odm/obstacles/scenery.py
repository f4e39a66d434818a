"""Scenery of a recipe: planes and boxes held exactly, all else as surface points."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from roadmap.arrays import frozen
from roadmap.errors import BadRecipe
from roadmap.ranges import is_between
from roadmap.transforms import pose_of

_ROUND = {"type", "name", "radius", "position", "covering_radius"}
_KEYS = {
    "plane": {"type", "name", "normal", "offset"},
    "box": {"type", "name", "size", "position", "rpy"},
    "mesh": {"type", "name", "file", "scale", "position", "rpy", "covering_radius"},
    "sphere": _ROUND,
    "capsule": _ROUND | {"length", "rpy"},
    "cylinder": _ROUND | {"length", "rpy"},
}


@dataclass(frozen=True, eq=False)
class Scenery:
    """What stands still around the robot, in the base frame.

    Attributes:
        solids: (n, 16) half-spaces and boxes; see `odm/close_test/_static.py`.
        points: (k, 3) surface points of what is neither plane nor box [m].
        covering_radius: Of those points [m].
        names: Name of each solid.
        dropped: (link, solid) pairs that always touch and are not tested.
    """

    solids: np.ndarray = field(default_factory=lambda: np.zeros((0, 16)))
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    covering_radius: float = 0.0
    names: tuple[str, ...] = ()
    dropped: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        """Freeze the arrays; refuse numbers that block nothing.

        Raises:
            BadRecipe: A number that is not finite, or arrays of the wrong shape.
        """
        object.__setattr__(self, "solids", frozen(self.solids, np.float64))
        object.__setattr__(self, "points", frozen(self.points, np.float64))
        if self.solids.shape[1:] != (16,) or self.points.shape[1:] != (3,):
            raise BadRecipe(
                f"scenery has solids {self.solids.shape} and points "
                f"{self.points.shape}; give (n, 16) and (k, 3)"
            )
        for name in ("solids", "points", "covering_radius"):
            if not np.isfinite(getattr(self, name)).all():
                raise BadRecipe(
                    f"the {name} of scenery hold NaN or infinity, which would block "
                    "nothing; give finite numbers"
                )

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the arrays by name, for the store."""
        return {"solids": self.solids, "points": self.points}

    def meta(self) -> dict:
        """Return the rest as plain data."""
        dropped = [list(pair) for pair in self.dropped]
        return {
            "covering_radius": self.covering_radius,
            "names": list(self.names),
            "dropped": dropped,
        }

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
        )


def parse_scenery(
    tables: tuple[dict, ...], folder: Path | None = None, *, meshes: bool = True
) -> Scenery:
    """Make scenery from the [[scenery]] tables of a recipe.

    Args:
        tables: As in the TOML file.
        folder: Where relative paths of mesh files start; None: the current folder.
        meshes: Whether mesh files are read and sampled, or only looked for; round
            shapes are sampled, or only checked.

    Raises:
        BadRecipe: An unknown type or key, or a value that makes no solid.
    """
    solids, points, names, rho = [], [np.zeros((0, 3))], [], 0.0
    for k, table in enumerate(tables):
        if not isinstance(table, dict):
            raise BadRecipe(f"scenery {k} is {table!r}; write a table [[scenery]]")
        kind = table.get("type")
        if not isinstance(kind, str) or kind not in _KEYS:
            raise BadRecipe(
                f"scenery {k} has type {kind!r}; choose one of {', '.join(_KEYS)}"
            )
        unknown = set(table) - _KEYS[kind]
        if unknown:
            raise BadRecipe(
                f"scenery {k} ({kind}) has no key {sorted(unknown)[0]!r}; known keys: "
                f"{', '.join(sorted(_KEYS[kind]))}"
            )
        if kind not in ("plane", "box"):
            if kind != "mesh":
                found, radius = _round_points(table, k, kind, meshes)
            elif meshes:
                found, radius = _mesh_points(table, k, folder)
            else:
                found, radius = _mesh_found(table, k, folder)
            points.append(found)
            rho = max(rho, radius)
            continue
        solids.append(_plane_row(table, k) if kind == "plane" else _box_row(table, k))
        names.append(str(table.get("name", f"{kind} {k}")))
    rows = np.array(solids) if solids else np.zeros((0, 16))
    return Scenery(rows, np.concatenate(points), rho, tuple(names))


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


def _box_row(table: dict, k: int) -> np.ndarray:
    size = _numbers(table, k, "size", None, "lengths above 0")
    if not (size > 0).all():
        raise BadRecipe(
            f"scenery {k}: size {size.tolist()} must be 3 lengths above 0 [m]; "
            "correct it in the recipe"
        )
    pose = _pose(table, k)
    row = np.zeros(16)
    row[0] = 1.0
    row[1:4] = pose[:3, 3]
    row[4:13] = pose[:3, :3].ravel()
    row[13:16] = size / 2
    return row


def _pose(table: dict, k: int) -> np.ndarray:
    zeros = (0.0, 0.0, 0.0)
    position = _numbers(table, k, "position", zeros)
    return pose_of(position, _numbers(table, k, "rpy", zeros))


def _numbers(
    table: dict, k: int, key: str, default: object, what: str = "numbers"
) -> np.ndarray:
    """Return three numbers of a table, from -1000 to 1000."""
    value = table.get(key, default)
    listed = isinstance(value, list | tuple | np.ndarray) and len(value) == 3
    if not listed or not all(is_between(v, -1e3, 1e3) for v in value):
        raise BadRecipe(
            f"scenery {k}: {key} is {value!r}, but must be 3 {what}, none beyond "
            "1000 either way; correct it in the recipe"
        )
    return np.array(value, float)


def _number(
    table: dict, k: int, key: str, default: float | None, low: float, high: float
) -> float:
    value = table.get(key, default)
    if not is_between(value, low, high):
        raise BadRecipe(
            f"scenery {k}: {key} is {value!r}, but must be a number from {low:g} to "
            f"{high:g}; correct it in the recipe"
        )
    return float(value)


def _mesh_found(table: dict, k: int, folder: Path | None) -> tuple[np.ndarray, float]:
    """Return no points, where the file is there."""
    name = table.get("file")
    if not isinstance(name, str):
        raise BadRecipe(f"scenery {k}: a mesh needs a file, not {name!r}; name it")
    file = Path(folder or "", name)
    if not file.is_file():
        raise BadRecipe(f"scenery {k}: there is no mesh {file}; correct its file")
    return np.zeros((0, 3)), 0.0


def _round_points(
    table: dict, k: int, kind: str, sampled: bool
) -> tuple[np.ndarray, float]:
    """Return the samples of a sphere, capsule or cylinder; none if only checked."""
    from odm.obstacles.shapes import Capsule, Cylinder, Sphere
    from odm.obstacles.surfaces import surface_of

    spacing = _number(table, k, "covering_radius", 0.01, 1e-4, 0.5)
    sizes = [_number(table, k, "radius", None, 1e-6, 100.0)]
    if kind != "sphere":
        least = 0.0 if kind == "capsule" else 1e-6
        sizes.append(_number(table, k, "length", None, least, 1e3))
    pose = _pose(table, k)
    make = {"sphere": Sphere, "capsule": Capsule, "cylinder": Cylinder}[kind]
    if not sampled:
        return np.zeros((0, 3)), 0.0
    surface = surface_of(make(*sizes, pose), spacing)
    return surface.points, surface.covering_radius


def _mesh_points(table: dict, k: int, folder: Path | None) -> tuple[np.ndarray, float]:
    from odm.obstacles.shapes import Mesh
    from odm.obstacles.surfaces import surface_of

    if "file" not in table:
        raise BadRecipe(f"scenery {k}: a mesh needs a file")
    spacing = _number(table, k, "covering_radius", 0.01, 1e-4, 0.5)
    if isinstance(table.get("scale"), list | tuple):
        scale = _numbers(table, k, "scale", None)
    else:
        scale = _number(table, k, "scale", 1.0, 1e-9, 1e6)
    if not np.all(scale):
        raise BadRecipe(f"scenery {k}: scale {scale} holds 0; correct it in the recipe")
    pose = _pose(table, k)
    file = Path(folder or "", str(table["file"]))
    surface = surface_of(Mesh.from_file(file, scale=scale), spacing).moved(pose)
    return surface.points, surface.covering_radius
