"""The plan of a hand-over as plain JSON, to be played or checked without this project.

What each entry means is written in `docs/plans.md`, "The plan as a file".
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np

from handover.scenes.plan_form import check_form
from handover.scenes.scene import PlacedAgent, Scene
from odm.obstacles.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from roadmap.arrays import as_floats
from roadmap.builds.unfinished import put_file
from roadmap.errors import BadInput

_SHAPES = {
    kind.__name__.lower(): kind for kind in (Box, Capsule, Cylinder, Mesh, Sphere)
}
FORMAT, VERSION = "odm hand-over plan", 1
WHO = ("giver", "receiver")


@dataclass(frozen=True, eq=False)
class TimedMotion:
    """A motion of one agent, in points that are joined by straight lines."""

    name: str  # reach, pick, carry, offer, take, release, ...
    who: str  # "giver" or "receiver"
    joints: Sequence[str]  # (k,) names of the joints that it moves
    times: np.ndarray  # (n,) growing, on the plan's clock [s]
    positions: np.ndarray  # (n, k) [rad or m]


@dataclass(frozen=True, eq=False)
class Hold:
    """The object is fixed to a link for a time."""

    who: str  # "giver", "receiver" or "world"; the world's link is ""
    link: str  # the link
    T_link_object: np.ndarray  # (4, 4); of the world T_world_object [m]
    # on the plan's clock [s]; an end of None: to the end
    begin: float
    end: float | None = None
    # links of `who` that may touch the object meanwhile: the hand's
    touching: Sequence[str] = field(default_factory=tuple)


def hand_links(placed: PlacedAgent, side: str) -> tuple[str, ...]:
    """Return the links of the hand of an arm: its root and all beyond."""
    root = placed.agent.arms[side].spec.root
    return root, *(joint.child for joint in placed.body.description.below(root))


def plan_record(
    scene: Scene, motions: Sequence[TimedMotion], holds: Sequence[Hold], **more: object
) -> dict:
    """Return a plan as plain data.

    Args:
        scene: What was planned.
        motions: In order of time; those of one agent do not overlap.
        holds: In order of time; they leave no gap. Where two overlap, both hold.
        more: Further entries as plain data: report, alternatives, ...

    Raises:
        BadInput: Motions or holds that contradict each other; says which.
    """
    record = {
        "format": FORMAT,
        "version": VERSION,
        "units": "m, rad, s, kg",
        "scene": {"name": scene.name, "seed": scene.seed},
        "giver": _agent(scene.giver),
        "receiver": _agent(scene.receiver),
        "object": {
            "name": scene.obj.name,
            "mass_kg": scene.obj.mass_kg,
            "parts": [_shape(part) for part in scene.obj.parts],
            "T_world_start": scene.T_world_start.tolist(),
            "T_world_goal": scene.T_world_goal.tolist(),
        },
        "scenery": [{"name": f.name, **_shape(f.shape)} for f in scene.scenery],
        "motions": [_motion(motion) for motion in motions],
        "holds": [_hold(hold) for hold in holds],
        **more,
    }
    check_record(record)
    return record


def write_plan(path: str | Path, record: Mapping) -> Path:
    """Write a plan as JSON, whole or not at all; `record` is `plan_record`'s."""
    check_record(record)
    put_file(Path(path), json.dumps(record, allow_nan=False).encode())
    return Path(path)


def read_plan(path: str | Path) -> dict:
    """Return the checked record of a plan from its JSON file."""
    path = Path(path)
    if not path.is_file():
        raise BadInput(f"there is no plan {path}; make one with `odm handover plan`")
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"{path} is no JSON file ({error}); make it again") from error
    try:
        check_record(record)
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from error
    return record


def check_record(record: Mapping) -> None:
    """Refuse another format, a wrong order of times, overlaps and jumps."""
    told = isinstance(record, Mapping) and (record.get("format"), record.get("version"))
    if told != (FORMAT, VERSION):
        what = f"it says {told[0]!r}, {told[1]!r}" if told and told[0] else "other JSON"
        raise BadInput(
            f"this is no {FORMAT} of version {VERSION} ({what}); make one with "
            "`odm handover plan SCENE --out plan.json`"
        )
    check_form(record)
    end = 0.0
    for who in WHO:
        end = max(end, _check_motions(record, who))
    reached = 0.0
    for hold in record["holds"]:
        if hold["begin"] > reached + 1e-9:
            raise BadInput(
                f"nothing holds the object from {reached:g} to {hold['begin']:g} s; "
                "let the holds of the plan meet"
            )
        until = np.inf if hold["end"] is None else hold["end"]
        reached = max(reached, until)
    if reached < end - 1e-9:
        raise BadInput(
            f"nothing holds the object after {reached:g} s, but the plan ends at "
            f"{end:g} s; let the last hold end with it"
        )


def duration(record: Mapping) -> float:
    """Return when the last motion of a plan ends [s]."""
    return max((m["times"][-1] for m in record["motions"]), default=0.0)


def joints_at(record: Mapping, who: str, t: float) -> dict[str, float]:
    """Return all joints of an agent of a plan at a time [s]."""
    joints = dict(record[who]["joints"])
    for motion in record["motions"]:
        if motion["who"] != who or t < motion["times"][0]:
            continue
        rows = np.array(motion["positions"], float)
        for name, row in zip(motion["joints"], rows.T, strict=True):
            joints[name] = float(np.interp(t, motion["times"], row))
    return joints


def change_time(record: Mapping) -> float | None:
    """Return when the receiver begins to hold the object [s]; None: never."""
    begins = [h["begin"] for h in record["holds"] if h["who"] == "receiver"]
    return min(begins, default=None)


def object_at(record: Mapping, scene: Scene, t: float) -> np.ndarray:
    """Return T_world_object, (4, 4) [m], of a plan at a time [s]."""
    for hold in record["holds"]:
        if hold["begin"] - 1e-9 <= t and (hold["end"] is None or t <= hold["end"]):
            T = np.array(hold["T_link_object"])
            if hold["who"] == "world":
                return T
            placed = getattr(scene, hold["who"])
            joints = joints_at(record, hold["who"], t)
            return placed.link_pose(hold["link"], joints) @ T
    raise BadInput(f"nothing holds the object at {t:g} s; give a time within the plan")


def _check_motions(record: Mapping, who: str) -> float:
    end, joints = 0.0, dict(record[who]["joints"])
    for motion in record["motions"]:
        if motion["who"] not in WHO:
            raise BadInput(
                f"{motion['name']} is a motion of {motion['who']!r}; give giver or "
                "receiver"
            )
        if motion["who"] != who:
            continue
        name = motion["name"]
        times = as_floats(f"times of {name}", motion["times"])
        rows = as_floats(f"positions of {name}", motion["positions"])
        wanted = (*times.shape, len(motion["joints"]))
        if rows.shape != wanted or rows.ndim != 2 or not len(rows):
            raise BadInput(
                f"{name} has {len(times)} times and positions of shape {rows.shape} "
                f"for {len(motion['joints'])} joints; give a row for each time"
            )
        if not (np.isfinite(times).all() and np.isfinite(rows).all()):
            raise BadInput(f"{name} holds NaN or infinity; give finite numbers")
        if (np.diff(times) <= 0).any() or times[0] < end - 1e-9:
            raise BadInput(
                f"times of {name} do not grow, or begin at {times[0]:g} s before the "
                f"last motion of the {who} ends at {end:g} s; let them follow"
            )
        for joint, value in zip(motion["joints"], rows[0], strict=True):
            if joint not in joints:
                raise BadInput(f"{name} moves {joint!r}, which the {who} does not have")
            if abs(joints[joint] - value) > 1e-6:
                raise BadInput(
                    f"{name} begins with {joint} at {value:.6g}, where the {who} has "
                    f"it at {joints[joint]:.6g}; let each begin where the last ended"
                )
        joints |= dict(zip(motion["joints"], rows[-1].tolist(), strict=True))
        end = float(times[-1])
    return end


def _agent(placed: PlacedAgent) -> dict:
    return {
        "name": placed.agent.name,
        "urdf": str(placed.body.file),
        "T_world_base": placed.T_world_base.tolist(),
        "joints": dict(placed.joints),
        "arms": list(placed.arms),
    }


def _motion(motion: TimedMotion) -> dict:
    rows = {k: np.asarray(getattr(motion, k), float) for k in ("times", "positions")}
    joints = {"joints": list(motion.joints)}
    return vars(motion) | joints | {k: row.tolist() for k, row in rows.items()}


def _hold(hold: Hold) -> dict:
    return vars(hold) | {
        "T_link_object": np.asarray(hold.T_link_object, float).tolist(),
        "begin": float(hold.begin),
        "end": None if hold.end is None else float(hold.end),
        "touching": list(hold.touching),
    }


def _shape(shape: Shape) -> dict:
    """Return a shape at its pose as plain data."""
    values = {
        f.name: np.asarray(getattr(shape, f.name)).tolist() for f in fields(shape)
    }
    kind, pose = type(shape).__name__.lower(), values.pop("T_base_shape")
    return {"type": kind, **values, "pose": pose}


def read_shape(entry: Mapping) -> Shape:
    """Return a shape of a plan's record, at its pose.

    Raises:
        BadInput: No such type, a size that is missing or wrong.
    """
    kind = _SHAPES.get(entry["type"])
    if kind is None:
        raise BadInput(
            f"a plan has no shape of type {entry['type']!r}; give one of "
            f"{', '.join(_SHAPES)}"
        )
    *names, _ = (f.name for f in fields(kind))  # the last one is the pose
    for name in names:
        if name not in entry:
            raise BadInput(f"a {entry['type']} of the plan lacks {name!r}; add it")
    return kind(*(entry[name] for name in names), entry["pose"])
