"""A scene of one's own, read from TOML: agents, object, start, goal and furniture."""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np

from handover.grasps.agents import Agent, AgentArm, Posture, load_agent
from handover.grasps.hands import HandSpec, hand_spec
from handover.grasps.objects import GraspObject, load_object
from handover.scenes.own_hand import KEYS, check_hand, own_hand
from handover.scenes.scene import Fixture, PlacedAgent, Scene, stand
from odm.obstacles.scenery import shapes_of_tables
from roadmap.errors import BadInput
from roadmap.ranges import check_rpy, is_between
from roadmap.transforms import pose_of

_PARTS = {"giver", "receiver", "object", "start", "goal"}
_KEYS = {
    "the file": _PARTS | {"name", "scenery"},
    "an agent": {
        *("agent", "urdf", "arms", "posture", "position", "rpy", "joints", "use")
    },
    "an arm": {"tip", "hand"},
    "a hand": KEYS,
    "[object]": {"name", "file", "mass_kg", "scale"},
    "[start]": {"position", "rpy"},
    "[goal]": {"position", "rpy", "held"},
}


def read_scene(path: Path, seed: int = 0) -> Scene:
    """Read a scene from a TOML file; see `docs/plans.md` for its parts.

    Args:
        path: The file; paths in it start from its folder.
        seed: Kept with the scene; nothing is random in a file.

    Raises:
        BadInput: No such file, no TOML, a part that is missing or unknown.
    """
    if not path.is_file():
        raise BadInput(f"there is no scene file {path}; correct its path")
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"{path} is no TOML file ({error}); correct it") from error
    _known(table, "the file", path)
    for part in sorted(_PARTS - set(table)):
        raise BadInput(f"{path} has no part [{part}]; add it")
    parts = {name: _table(table[name], f"[{name}]", path) for name in _PARTS}
    goal = _known(parts["goal"], "[goal]", path)
    held = goal.get("held", False)
    if not isinstance(held, bool):
        raise BadInput(f"{path}: held of [goal] is {held!r}; give true or false")
    name = table.get("name", path.stem)
    if not isinstance(name, str) or not name.isprintable() or not name.strip():
        raise BadInput(f"{path}: the scene's name is {name!r}; give a text of one line")
    return Scene(
        name,
        seed,
        _placed(parts["giver"], "[giver]", path),
        _placed(parts["receiver"], "[receiver]", path),
        _object(_known(parts["object"], "[object]", path), path),
        _pose(_known(parts["start"], "[start]", path), "[start]", path, needed=True),
        _pose(goal, "[goal]", path, needed=True),
        _scenery(table.get("scenery", []), path),
        held,
    )


def _known(table: dict, what: str, path: Path) -> dict:
    unknown = sorted(set(table) - _KEYS[what])
    if unknown:
        raise BadInput(
            f"{path}: {what} has no key {unknown[0]!r}; known keys: "
            f"{', '.join(sorted(_KEYS[what]))}"
        )
    return table


def _table(value: object, what: str, path: Path) -> dict:
    if not isinstance(value, dict):
        raise BadInput(f"{path}: {what} is {value!r}; write a table")
    return value


def _pose(table: Mapping, what: str, path: Path, needed: bool = False) -> np.ndarray:
    if needed and "position" not in table:
        raise BadInput(f"{path}: {what} has no position; give three metres")
    found = []
    for key, unit, most in (("position", "metres", 100.0), ("rpy", "radians", 1e3)):
        value = table.get(key, (0.0, 0.0, 0.0))
        listed = isinstance(value, list | tuple) and len(value) == 3
        if not listed or not all(is_between(v, -most, most) for v in value):
            raise BadInput(
                f"{path}: {key} of {what} is {value!r}; give three {unit}, none beyond "
                f"{most:g} either way"
            )
        if key == "rpy":
            check_rpy(f"{path}: rpy of {what}", value)
        found.append(value)
    return pose_of(*found)


def _placed(table: dict, what: str, path: Path) -> PlacedAgent:
    _known(table, "an agent", path)
    if ("agent" in table) == ("urdf" in table):
        raise BadInput(f"{path}: {what} needs either agent or urdf; give one of both")
    agent = load_agent(table["agent"]) if "agent" in table else _own(table, what, path)
    posture = table.get("posture", next(iter(agent.postures)))
    joints = _numbers(table.get("joints", {}), f"joints of {what}", path)
    arms = table.get("use", list(agent.arms))
    listed = isinstance(arms, list) and len(arms) == len(set(map(str, arms))) > 0
    if not listed or not all(isinstance(side, str) for side in arms):
        raise BadInput(
            f"{path}: use of {what} is {arms!r}; write a list of arms, each once, such "
            'as ["right"]'
        )
    return stand(agent, _pose(table, what, path), posture, joints, tuple(arms))


def _own(table: dict, what: str, path: Path) -> Agent:
    """Return an agent of the user's, from a URDF."""
    # a plan names it, and is read from anywhere
    urdf = (path.parent / str(table["urdf"])).resolve()
    arms = {}
    for side, entry in _table(table.get("arms", {}), f"arms of {what}", path).items():
        named = f"the {side} arm of {what}"
        entry = _known(_table(entry, named, path), "an arm", path)
        for key in ("tip", "hand"):
            if key not in entry:
                raise BadInput(f"{path}: {named} has no {key}; name it")
        hand = entry["hand"]
        own = isinstance(hand, dict)
        # what the arm carries is the hand as its own URDF has it
        hand = (
            _hand(hand, str(urdf), named, path)
            if own
            else replace(hand_spec(hand), robot=str(urdf))
        )
        arms[side] = AgentArm(side, str(urdf), hand, str(entry["tip"]))
        check_hand(arms[side], own, named, path)
    if not arms:
        raise BadInput(
            f"{path}: {what} has a urdf and no arm; give [{what.strip('[]')}.arms."
            'right] with tip = "LINK" and hand = "NAME"'
        )
    return Agent(urdf.stem, arms, {"fixed": Posture()})


def _hand(table: dict, urdf: str, whose: str, path: Path) -> HandSpec:
    _known(table, "a hand", path)
    what = f"the hand of {whose}"
    for key, of, such in (
        ("fingers", list, '[["joint"]]'),
        ("preshapes", dict, "[{joint = 0.1}]"),
    ):
        if key in table:
            _lists(table[key], of, f"{key} of {what}", such, path)
    numbers = {
        "closed": lambda t, w: _numbers(t, w, path),
        "preshapes": lambda rows, w: [_numbers(row, w, path) for row in rows],
    }
    read = {k: numbers[k](table[k], f"{k} of {what}") for k in numbers if k in table}
    at = {key: table.get(f"palm_{key}", (0.0, 0.0, 0.0)) for key in ("position", "rpy")}
    T = _pose(at, f"the palm of {whose}", path)
    return own_hand({**table, **read}, urdf, T, whose, path)


def _lists(given: object, of: type, what: str, such_as: str, path: Path) -> None:
    """Refuse what is no list of lists, or of tables."""
    if not isinstance(given, list) or not all(isinstance(one, of) for one in given):
        raise BadInput(f"{path}: {what} is {given!r}; give a list such as {such_as}")


def _numbers(table: object, what: str, path: Path) -> dict[str, float]:
    for name, value in _table(table, what, path).items():
        if not is_between(value, -1e3, 1e3):
            raise BadInput(f"{path}: {what}: {name} is {value!r}; give rad or m")
    return {name: float(value) for name, value in table.items()}


def _object(table: dict, path: Path) -> GraspObject:
    if ("name" in table) == ("file" in table):
        raise BadInput(f"{path}: [object] needs either name or file; give one of both")
    mass, scale = table.get("mass_kg", 1.0), table.get("scale", 1.0)
    if not is_between(mass, 1e-6, 100.0):
        raise BadInput(
            f"{path}: mass_kg of [object] is {mass!r}; give kilograms, up to 100"
        )
    factors = scale if isinstance(scale, list) and len(scale) == 3 else [scale]
    if not all(is_between(factor, 1e-9, 1e9) for factor in factors):
        raise BadInput(
            f"{path}: scale of [object] is {scale!r}; give what turns the file's unit "
            "into metres, such as 0.001"
        )
    if "name" in table:
        return load_object(table["name"], table.get("mass_kg"), table.get("scale", 1.0))
    file = path.parent / str(table["file"])
    return load_object(file, table.get("mass_kg"), table.get("scale", 1.0))


def _scenery(tables: object, path: Path) -> tuple[Fixture, ...]:
    if not isinstance(tables, list):
        raise BadInput(f"{path}: scenery is {tables!r}; write tables [[scenery]]")
    try:
        named = shapes_of_tables(tables, path.parent)
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from error
    found: dict[str, Fixture] = {}
    for name, shape in named:
        # others look them up by name: a table's legs may all be called "table"
        unique = next(n for n in _counted(name) if n not in found)
        found[unique] = Fixture(unique, shape)
    return tuple(found.values())


def _counted(name: str) -> Iterator[str]:
    yield name
    yield from (f"{name} {n}" for n in count(2))
