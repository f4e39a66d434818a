"""Who is met in a recording, and what they are handed, as arrays and plain data."""

from dataclasses import fields, replace

import numpy as np

from handover.human.body import SIDES
from handover.human.human import Human
from handover.human.skeleton import Skeleton
from handover.meet.held_object import HeldObject

_NO_GAZE = np.full(3, np.nan)  # nobody knows where they look
_LENGTHS = tuple(f.name for f in fields(Skeleton))
_ARRAYS = ("capsules", "T_tool_object", "hand_grasps")  # of a HeldObject


def body_told(human: Human) -> dict:
    """Return what of a person is the same in all frames."""
    names = ("height", "posture", "mass", "thickness")
    return {name: getattr(human, name) for name in names}


def person_of(told: dict) -> Human:
    """Return the person of `body_told`, who stands at no place yet."""
    height = told["height"]
    return Human(
        height,
        told["posture"],
        mass=told["mass"],
        thickness=told["thickness"],
        skeleton=Skeleton.of_height(height),
    )


def people_arrays(humans: list[Human], prefix: str) -> dict[str, np.ndarray]:
    """Return a person of every frame as arrays whose names begin with `prefix`.

    Their body has arrays of its own where it is measured anew in each frame.
    """
    found = {
        "pelvis": [h.T_world_pelvis for h in humans],
        "bend": [h.bend for h in humans],
        "arms": [[h.arms[side] for side in SIDES] for h in humans],
        "gaze": [_NO_GAZE if h.gaze is None else h.gaze for h in humans],
    }
    if any(h.skeleton is not humans[0].skeleton for h in humans):
        for name in _LENGTHS:
            found[f"body.{name}"] = [getattr(h.skeleton, name) for h in humans]
        found["body.height"] = [h.height for h in humans]
        found["body.mass"] = [h.mass for h in humans]
    return {prefix + name: np.array(rows, float) for name, rows in found.items()}


def person_at(
    person: Human, arrays: dict[str, np.ndarray], prefix: str, i: int
) -> Human:
    """Return the person of frame i, from `person_of` and `people_arrays`."""
    own = {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}
    gaze, body = own["gaze"][i], {}
    if "body.height" in own:
        lengths = {name: own[f"body.{name}"][i] for name in _LENGTHS}
        body = {"height": float(own["body.height"][i])}
        body["skeleton"] = Skeleton(**lengths)
        if "body.mass" in own:
            body["mass"] = float(own["body.mass"][i])
    return replace(
        person,
        T_world_pelvis=own["pelvis"][i],
        bend=own["bend"][i],
        arms=dict(zip(SIDES, own["arms"][i], strict=True)),
        gaze=None if np.isnan(gaze).any() else gaze,
        **body,
    )


def held_told(obj: HeldObject) -> dict:
    """Return what is handed over as plain data."""
    rows = {k: np.asarray(getattr(obj, k)).tolist() for k in _ARRAYS}
    return {"name": obj.name, "mass_kg": obj.mass_kg, "turns": obj.turns, **rows}


def held_of(told: dict) -> HeldObject:
    """Return what was handed over, of `held_told`."""
    return HeldObject(
        **{k: np.array(v) if k in _ARRAYS else v for k, v in told.items()}
    )
