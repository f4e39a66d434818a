"""Units, up axis and floor of a recording: told by the file, or guessed and said."""

from collections.abc import Iterator, Sequence

import numpy as np

from handover.human.body import ARM, SIDES
from sim.people.mocap.skeletons import FEET
from sim.people.mocap.tracks import UNITS, BadMocap, Tracks

ARM_LENGTH = (0.30, 0.85)  # shoulder over elbow to wrist, from a child of six on [m]
DECISIVE = 0.85  # a trunk this much along an axis says which one is up
SHOULDER_HEIGHT = 0.818  # of body height [Winter; MMM; ANSUR II]
ANKLE_HEIGHT = 0.039  # of body height [MMM]
TALL = 95  # percentile of the shoulders' height that counts as standing

SHOULDERS = tuple(f"{side}_shoulder" for side in SIDES)
_TURNED = {  # up -> where x, y and z with z up come from, and their signs
    "x": ([1, 2, 0], (1.0, 1.0, 1.0)),
    "y": ([0, 2, 1], (1.0, -1.0, 1.0)),
    "z": ([0, 1, 2], (1.0, 1.0, 1.0)),
    "-x": ([2, 1, 0], (1.0, 1.0, -1.0)),
    "-y": ([0, 2, 1], (1.0, 1.0, -1.0)),
    "-z": ([0, 1, 2], (1.0, -1.0, -1.0)),
}
UPS = tuple(_TURNED)

Joints = dict[str, np.ndarray]


def metres_per_unit(
    tracks: Tracks, joints: Joints, unit: str | float | None, said_by: str = ""
) -> tuple[float, str]:
    """Return the length of the file's unit [m], and a sentence where it was guessed.

    `unit` is a name or metres, by whoever is named in `said_by`; None: what the file
    says, else a guess from the joints' places. BadMocap where it gives nobody's arm.
    """
    lengths = [_arm_length(joints, side) for side in SIDES]
    length = float(np.median([n for n in lengths if n is not None] or [np.nan]))
    told = tracks.metres_per_unit if unit is None else _stated(unit)
    if told is not None:
        _check_arm(tracks.source, length, told, said_by or f"{tracks.source} says so")
        return told, ""
    if np.isnan(length):
        raise BadMocap(
            f"no arm is ever seen in {tracks.source}: shoulder, elbow and hand are in "
            "no frame together; check the tracker, or map other bodies"
        )
    fitting = _fitting(length)
    if fitting is None:
        raise BadMocap(
            f"the arm in {tracks.source} is {length:.4g} units long, which is no "
            f"person's in {', '.join(UNITS)}; give the metres of a unit, as "
            "unit = 0.05, in the mapping (--mapping FILE)"
        )
    metres = UNITS[fitting]
    return metres, (
        f"taken as {fitting}: the arm is then {length * metres:.2f} m long; a unit in "
        "the mapping (--mapping FILE) says otherwise"
    )


def _fitting(length: float) -> str | None:
    """Return the unit in which an arm is that of a person; None: in none."""
    low, high = ARM_LENGTH
    found = (name for name, one in UNITS.items() if low <= length * one <= high)
    return next(found, None)


def _check_arm(source: str, length: float, metres: float, said_by: str) -> None:
    """Refuse a unit in which the arm, so many units long, is nobody's."""
    low, high = ARM_LENGTH
    # what was stated is doubted only where it is far off
    if np.isnan(length) or 0.5 * low <= length * metres <= 2.0 * high:
        return
    names = {one: name for name, one in UNITS.items()}
    stated = names.get(metres, f"{metres:g} m")
    fitting = _fitting(length)
    remedy = f'it looks like {fitting}: give unit = "{fitting}"'
    if fitting is None:
        remedy = "give the metres of a unit, as unit = 0.05,"
    raise BadMocap(
        f"the arm in {source} is {length * metres:.3g} m long in the unit {stated} "
        f"({said_by}), which is no person's; {remedy} in the mapping (--mapping FILE)"
    )


def _stated(unit: str | float) -> float:
    if isinstance(unit, str):
        if unit not in UNITS:
            raise BadMocap(
                f"no unit {unit!r}; choose one of {', '.join(UNITS)}, or give a "
                "number of metres"
            )
        return UNITS[unit]
    if not 0 < unit < np.inf:
        raise BadMocap(f"a unit of {unit} m is not positive; give metres per unit")
    return float(unit)


def _arm_length(joints: Joints, side: str) -> float | None:
    arm = [joints.get(f"{side}_{joint}") for joint in ARM]
    if any(place is None for place in arm):
        return None
    upper, fore = (np.linalg.norm(b - a, axis=1) for a, b in zip(arm, arm[1:]))
    both = upper + fore
    return (
        float(np.median(both[np.isfinite(both)])) if np.isfinite(both).any() else None
    )


def up_axis(
    tracks: Tracks, joints: Joints, rest: Joints, up: str | None
) -> tuple[str, str]:
    """Return one of `UPS`, and a sentence where it was guessed.

    The body tells: the trunk, or what is above what where the hip is not known. Where
    the person stoops too much for that, the skeleton's rest pose does, and at last the
    custom of the format: BVH "y", Vicon's tracks "z". An axis along which the person
    lies or stands upside down is refused.
    """
    if up is not None:
        if up not in UPS:
            raise BadMocap(f"no up axis {up!r}; choose one of {', '.join(UPS)}")
        return up, ""
    for direction, what in _upright(joints, rest):
        if direction is None or not np.abs(direction).max() > DECISIVE:
            continue
        axis = int(np.abs(direction).argmax())
        found = f"{'-' if direction[axis] < 0 else ''}{'xyz'[axis]}"
        if found not in ("y", "z"):
            raise BadMocap(
                f"{what} in {tracks.source} points along {found}, and up is y or z as "
                f'a rule; give up = "{found}" in the mapping (--mapping FILE) where '
                "that is up, or turn the recording"
            )
        told = f"{found} is up, as {what} tells"
        if tracks.up is None:
            return found, told
        return found, "" if found == tracks.up else (
            f"{told}; of such a file it is {tracks.up} as a rule"
        )
    usual = tracks.up or "y"
    return usual, f"{usual} taken as up, as is usual: the body does not tell"


def _upright(joints: Joints, rest: Joints) -> Iterator[tuple[np.ndarray | None, str]]:
    """Yield directions that are up in a person who stands, (3,), best first."""
    poses = ((joints, ""), (rest, " at rest"))
    for places, of in poses:
        what = f"the trunk{of}" if places is joints else "the rest pose"
        yield _direction(places.get("hip"), _neck(places)), what
    for places, of in poses:
        feet = _mean(places, FEET)
        yield _direction(feet, _neck(places)), f"the body over the feet{of}"
    if _direction(joints.get("hip"), _neck(joints)) is not None:
        return  # they stoop, and so does the head
    for places, of in poses:
        head, low = places.get("head"), _mean(places, SHOULDERS)
        yield _direction(low, head), f"the head over the shoulders{of}"


def _direction(low: np.ndarray | None, high: np.ndarray | None) -> np.ndarray | None:
    """Return the median direction from one place to another, (3,)."""
    if low is None or high is None:
        return None
    way = high - low
    way = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    way = way[np.isfinite(way).all(axis=1)]
    return np.median(way, axis=0) if len(way) else None


def _mean(joints: Joints, names: Sequence[str]) -> np.ndarray | None:
    """Return the (F, 3) middle of those joints that are there."""
    there = [joints[name] for name in names if name in joints]
    return np.mean(there, axis=0) if there else None


def _neck(joints: Joints) -> np.ndarray | None:
    if "neck" in joints:
        return joints["neck"]
    return _mean(joints, SHOULDERS) if set(SHOULDERS) <= set(joints) else None


def z_up(place: np.ndarray, up: str) -> np.ndarray:
    """Return (F, 3) places with z up: turned by one of `UPS`, never mirrored."""
    columns, signs = _TURNED[up]
    return place if up == "z" else place[:, columns] * signs


def floor_height(joints: Joints, height: float) -> tuple[float, str]:
    """Return z of the floor in the recording [m], and how it was found.

    `height` is the body's [m], used where there are no feet.
    """
    feet = [joints[name] for name in FEET if name in joints]
    feet_z = np.concatenate([foot[:, 2] for foot in feet]) if feet else np.zeros(0)
    feet_z = feet_z[np.isfinite(feet_z)]
    if len(feet_z):  # a foot joint is the ankle
        ankle = float(np.percentile(feet_z, 1))
        return ankle - ANKLE_HEIGHT * height, "by the feet"
    shoulders = [p[:, 2] for name, p in joints.items() if name.endswith("_shoulder")]
    high = np.nanpercentile(np.concatenate(shoulders), TALL)
    return (
        float(high) - SHOULDER_HEIGHT * height,
        f"by the shoulders of a person of {height:.2f} m",
    )
