"""Recipes: everything a map is built from, as TOML, checked before any work."""

import difflib
import sys
import tomllib
from dataclasses import dataclass, field, fields
from importlib import resources
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np

from odm.close_test.safety import TERMS, Safety, between
from odm.obstacles.scenery import parse_scenery
from roadmap.errors import BadInput, BadRecipe
from roadmap.graph.connecting import RoadmapSettings
from roadmap.ranges import check_path, is_between

_TABLES = ("name", "robot", "roadmap", "safety", "scenery", "payload")
AUTO = "auto"  # as a recipe says it: the fingers travel, as far as that can be done
_LEAST_RHO = 0.0005  # [m] of a recipe; the audit tests maps that have none


@dataclass(frozen=True)
class RobotRecipe:
    """Which robot: see `roadmap.load_robot`.

    Attributes:
        source: A known name, or the path of a URDF; as `srdf`, a relative one starts
            at the folder of the recipe.
        tip, locked, srdf, cover_excess, velocity, acceleration, jerk, travel: See
            there. The fingers of a gripper may stand anywhere but where they are
            locked; `travel` names others, or fewer.
    """

    source: str = "panda"
    tip: str | None = None
    locked: dict[str, float] = field(default_factory=dict)
    srdf: str | None = None
    cover_excess: float = 0.015
    velocity: dict[str, float] = field(default_factory=dict)
    acceleration: dict[str, float] = field(default_factory=dict)
    jerk: dict[str, float] = field(default_factory=dict)
    travel: tuple[str, ...] | None = None


@dataclass(frozen=True)
class PayloadRecipe:
    """The envelope of all that may be carried: a sphere or a box in the tool frame.

    Attributes:
        radius: Of the sphere [m]; or
        size: (3,) full edge lengths of the box [m].
        position: (3,) its centre, tool frame [m].
        rpy: (3,) its roll, pitch, yaw in the tool frame [rad].
    """

    radius: float | None = None
    size: tuple[float, ...] | None = None
    position: tuple[float, ...] = (0.0, 0.0, 0.0)
    rpy: tuple[float, ...] = (0.0, 0.0, 0.0)

    def as_dict(self) -> dict[str, Any]:
        """Return what is set, as plain data."""
        plain = {f.name: getattr(self, f.name) for f in fields(self)}
        given = {k: v for k, v in plain.items() if v is not None}
        return {k: v if isinstance(v, float) else list(v) for k, v in given.items()}


@dataclass(frozen=True)
class Recipe:
    """A whole recipe: robot, roadmap, safety terms, scenery, payload.

    Attributes:
        name: Name of the map, and of its folder.
        robot, roadmap, safety: See there.
        scenery: Tables of the recipe; see `odm.obstacles.scenery`.
        payload: Envelope of what may be carried; None: nothing can be attached.
        folder: Where the relative paths of the recipe start; None: the current folder.
            It is not part of what is built: no map knows it.
    """

    name: str
    robot: RobotRecipe = RobotRecipe()
    roadmap: RoadmapSettings = RoadmapSettings()
    safety: Safety = Safety()
    scenery: tuple[dict, ...] = ()
    payload: PayloadRecipe | None = None
    folder: Path | None = field(default=None, compare=False)

    def path_of(self, file: str) -> Path:
        """Return where a file lies that the recipe names."""
        return Path(file) if self.folder is None else self.folder / file

    def as_dict(self) -> dict[str, Any]:
        """Return the recipe as plain data, every default spelled out."""
        plain = {f.name: getattr(self.robot, f.name) for f in fields(self.robot)}
        travel = self.robot.travel
        plain["travel"] = AUTO if travel is None else list(travel)
        roadmap = {f.name: getattr(self.roadmap, f.name) for f in fields(self.roadmap)}
        whole = {
            "name": self.name,
            "robot": plain,
            "roadmap": roadmap,
            "safety": self.safety.as_dict(),
            "scenery": list(self.scenery),
        }
        if self.payload is not None:  # maps without one are as they were before
            whole["payload"] = self.payload.as_dict()
        return whole

    def for_map(self) -> dict[str, Any]:
        """Return what maps and recordings keep; `recipe_of_map` reads it.

        Where no finger travels nothing is said of it: so were maps before fingers
        could, and they keep their meaning and their hash.
        """
        whole = self.as_dict()
        if not whole["robot"]["travel"]:
            del whole["robot"]["travel"]
        return whole


def recipe_names() -> list[str]:
    """Return the names of the recipes that come with the package."""
    folder = resources.files("maps")
    return sorted(f.name[:-5] for f in folder.iterdir() if f.name.endswith(".toml"))


def load_recipe(source: str | Path) -> Recipe:
    """Read a recipe by name or path; its relative paths start at its own folder.

    Raises:
        BadRecipe: No such recipe, broken TOML, an unknown key (names the nearest
            known one) or a value out of range.
    """
    remedy = "give its name or path, or make one with odm.load_recipe"
    path = check_path("a recipe", source, remedy)
    if path.suffix == ".toml":
        if not path.is_file():
            raise BadRecipe(f"recipe file {path} does not exist; check the path")
        text, name, folder = _text_of(path), path.stem, path.absolute().parent
    else:
        folder = Path(str(resources.files("maps")))
        entry = folder / f"{source}.toml"
        if not entry.is_file():
            if path.suffix.lower() == ".urdf":
                raise BadRecipe(
                    f"{path} is a robot and no recipe; give it as source of the "
                    "[robot] of a recipe"
                )
            known = ", ".join(recipe_names())
            raise BadRecipe(
                f"recipe {str(source)!r} is unknown; choose one of {known}, or give "
                "the path of a .toml file"
            )
        text, name = entry.read_text(), str(source)
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise BadRecipe(f"recipe {source} is not valid TOML: {error}") from error
    if not table:
        raise BadRecipe(
            f"recipe {source} is empty; write at least [robot] with source = 'my.urdf'"
        )
    recipe = parse_recipe(table, name, folder)
    if "source" not in table.get("robot", {}):
        raise BadRecipe(
            f"recipe {source} names no robot; write [robot] with source = 'my.urdf', "
            "or with a known name such as 'panda'"
        )
    if not recipe.name.strip() or "/" in recipe.name or recipe.name in (".", ".."):
        raise BadRecipe(
            f"name is {recipe.name!r}, but must be a name without '/', for it becomes "
            "that of the map's folder; change it in the recipe"
        )
    return recipe


def _text_of(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadRecipe(
            f"recipe {path} is not in UTF-8 ({error.reason} at byte {error.start}); "
            "save it as UTF-8"
        ) from error


def parse_recipe(
    table: dict[str, Any],
    name: str,
    folder: Path | None = None,
    *,
    stored: bool = False,
) -> Recipe:
    """Make a Recipe from nested tables; all of it is checked before any work.

    Args:
        table: As in the TOML file.
        name: Of the map, where the table has none.
        folder: Where its relative paths start; None: the current folder.
        stored: It was built already: its scenery stands in the map, and the files of
            its meshes may be gone.

    Raises:
        BadRecipe: An unknown key, a value of another type or out of range, a mesh of
            the scenery that is not there.
    """
    _known(table, _TABLES, "the recipe")
    _check_types(table)
    robot = _section(RobotRecipe, _with_travel(table.get("robot", {})), "[robot]")
    settings = dict(table.get("roadmap", {}))
    for key in ("region", "weights"):
        settings[key] = _tuples(settings.get(key))
    roadmap = _section(RoadmapSettings, settings, "[roadmap]")
    terms = {k: v for k, v in table.get("safety", {}).items() if k != "m"}
    safety = _section(Safety, terms, "[safety]")
    between("safety.rho", safety.rho, _LEAST_RHO, TERMS["rho"][1])
    between("robot.cover_excess", robot.cover_excess, 0.002, 0.2)
    scenery = tuple(table.get("scenery", ()))
    if not stored:
        parse_scenery(scenery, folder, meshes=False)
    payload = None if "payload" not in table else _payload(table["payload"])
    name = table.get("name", name)
    return Recipe(name, robot, roadmap, safety, scenery, payload, folder)


def recipe_of_map(table: dict[str, Any]) -> Recipe:
    """Return the recipe that a map or a recording keeps, see `Recipe.for_map`."""
    robot = {"travel": [], **table.get("robot", {})}
    return parse_recipe({**table, "robot": robot}, table["name"], stored=True)


def _check_types(table: dict) -> None:
    """Refuse what is no table, and values of [robot] of another type."""
    for key in ("robot", "roadmap", "safety", "payload"):
        _is(dict, table.get(key, {}), key, f"a table [{key}]")
    _is(str, table.get("name", ""), "name", "a text")
    _is((list, tuple), table.get("scenery", ()), "scenery", "tables [[scenery]]")
    robot = table.get("robot", {})
    for key in ("source", "tip", "srdf"):
        _is((str, NoneType), robot.get(key), f"robot.{key}", "a text")
    for key in ("locked", "velocity", "acceleration", "jerk"):
        values = robot.get(key, {})
        _is(dict, values, f"robot.{key}", "a table of joints and numbers")
        for joint, value in values.items():
            if not is_between(value, -sys.float_info.max, sys.float_info.max):
                raise BadRecipe(
                    f"robot.{key}.{joint} is {value!r}, but must be a finite number; "
                    "change it in the recipe"
                )


def _is(kind: type | tuple[type, ...], value: object, key: str, words: str) -> None:
    if not isinstance(value, kind):
        raise BadRecipe(
            f"{key} is {value!r}, but must be {words}; change it in the recipe"
        )


def _with_travel(table: dict) -> dict:
    travel = table.get("travel", AUTO)
    if travel == AUTO:
        return {**table, "travel": None}
    listed = isinstance(travel, list | tuple)
    if not listed or not all(isinstance(t, str) for t in travel):
        raise BadRecipe(
            f"robot.travel is {travel!r}, but must be a list of the joints that may "
            f'stand anywhere, such as ["finger_joint1"], or "{AUTO}" for those of the '
            "gripper; change it in the recipe"
        )
    return {**table, "travel": tuple(travel)}


def _payload(table: dict) -> PayloadRecipe:
    payload = _section(PayloadRecipe, table, "[payload]")
    if (payload.radius is None) == (payload.size is None):
        raise BadRecipe(
            "[payload] needs either a radius (a sphere) or a size of 3 edge lengths (a "
            "box): give one of them"
        )
    values = {"radius": payload.radius, "size": payload.size}
    values |= {"position": payload.position, "rpy": payload.rpy}
    checked: dict[str, Any] = {}
    for key, value in values.items():
        if value is None:
            continue
        low, high = (0.002, 2.0) if key in ("radius", "size") else (-10.0, 10.0)
        shape = () if key == "radius" else (3,)
        try:
            array = np.asarray(value, float)
        except (TypeError, ValueError, OverflowError):
            array = np.full((0,), np.nan)
        good = array.shape == shape and ((low <= array) & (array <= high)).all()
        if not good:
            raise BadRecipe(
                f"payload.{key} is {value}, but must be "
                f"{'a number' if shape == () else '3 numbers'} between {low} and "
                f"{high}; change it in the recipe"
            )
        checked[key] = float(array) if shape == () else tuple(array.tolist())
    return PayloadRecipe(**checked)


def _section(kind: type, table: dict, where: str) -> Any:  # noqa: ANN401
    _known(table, tuple(f.name for f in fields(kind)), where)
    try:
        return kind(**table)
    except BadRecipe:
        raise
    except BadInput as error:
        raise BadRecipe(str(error)) from error


def _tuples(rows: object) -> object:
    """Return lists as tuples, all the way down."""
    return tuple(map(_tuples, rows)) if isinstance(rows, list | tuple) else rows


def _known(table: dict, names: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in names:
            near = difflib.get_close_matches(key, names, n=1, cutoff=0.0)
            if key == "urdf" and "source" in names:
                near = ["source"]
            raise BadRecipe(
                f"{where} has no key {key!r}; did you mean {near[0]!r}? "
                f"Known keys: {', '.join(names)}"
            )
