"""Recordings that show what no person does, as a whole: to be refused."""

import numpy as np

from handover.human.anthropometry import FOREARM, HAND, HEIGHTS, UPPER_ARM
from handover.human.body import ARM, SIDES
from sim.people.mocap.faults import Faults
from sim.people.mocap.placing import forward
from sim.people.mocap.skeletons import FEET, TOES

LEAN_BACK = 35.0  # [degrees] nobody standing leans back further; trackers sit 15 off
LEAN_SHARE = 0.05  # of the frames
SWINGS = 2  # times a hand flies: is impossibly fast over three or more steps ...
SWINGS_PER_S = 0.05  # ... and this often [1/s]
BEHIND = 0.05  # [m] hands hang, and markers sit, less than this behind the shoulders
TOE = 0.05  # [m] a foot shorter than this, seen from above, does not tell
BACKWARDS = 0.8  # share of the frames; with hands at work 0.4 at most were measured

CHILD = 1.05  # [m] a small child of six: 3rd percentile of girls, by memory of WHO 2007
OFF_JOINT = 0.05  # [m] a marker sits beside its joint; measured in recordings at hand
# the hand may be a marker on its back, half of its length from the wrist
SEGMENTS = {  # part of the arm -> shortest and longest of any person [m]
    "upper arm": (UPPER_ARM * CHILD - OFF_JOINT, UPPER_ARM * HEIGHTS[1] + OFF_JOINT),
    "forearm": (
        FOREARM * CHILD - OFF_JOINT,
        (FOREARM + HAND / 2) * HEIGHTS[1] + OFF_JOINT,
    ),
}


def odd_lengths(joints: dict[str, np.ndarray]) -> list[str]:
    """Return which parts of the arms are of no person's length, a clause each.

    The median over the frames counts; `joints` are (F, 3) places [m], NaN: not seen.
    """
    found = []
    for side in SIDES:
        arm = [joints.get(f"{side}_{joint}") for joint in ARM]
        for (part, (low, high)), a, b in zip(SEGMENTS.items(), arm, arm[1:]):
            if a is None or b is None:
                continue
            lengths = np.linalg.norm(b - a, axis=1)
            lengths = lengths[np.isfinite(lengths)]
            if len(lengths) and not low <= np.median(lengths) <= high:
                found.append(
                    f"the {side} {part} is {np.median(lengths):.2f} m long, where "
                    f"people have {low:.2f} to {high:.2f} m"
                )
    return found


def defects(
    joints: dict[str, np.ndarray], faults: dict[str, Faults], duration_s: float
) -> tuple[str, ...]:
    """Return what is wrong, a clause each; none for a recording of a person.

    A single jump is a sensor fault and is survived. A trunk bent the wrong way, hands
    that keep flying, or jumps in every few frames come from a skeleton that was solved
    or named wrongly, and nothing in the file can be trusted. So does a person whose
    chest, by left and right shoulder, is where the back is.

    Args:
        joints: Joint -> (F, 3) places, z up [m], NaN: not seen.
        faults: Joint -> its jumps, already taken out of `joints`.
        duration_s: Length of the clip [s].
    """
    return (
        *_leaning(joints),
        *_mirrored(joints),
        *_flying(faults, duration_s),
        *_noisy(faults),
    )


def _leaning(joints: dict[str, np.ndarray]) -> list[str]:
    ahead = forward(joints)
    if ahead is None or "hip" not in joints:
        return []
    shoulders = (joints["left_shoulder"] + joints["right_shoulder"]) / 2
    trunk = joints.get("neck", shoulders) - joints["hip"]
    back = -np.degrees(np.arctan2((trunk * ahead).sum(axis=1), trunk[:, 2]))
    seen = back[np.isfinite(back)]
    far = seen > LEAN_BACK
    if not len(seen) or far.mean() <= LEAN_SHARE:
        return []
    return [
        f"the trunk leans back by more than {LEAN_BACK:g} degrees in {far.sum()} of "
        f"{len(seen)} frames, by {seen.max():.0f} at most"
    ]


def _mirrored(joints: dict[str, np.ndarray]) -> list[str]:
    """Tell left and right swapped: by the toes or, where there are none, the hands."""
    ahead = forward(joints)
    if ahead is None:
        return []
    toes = _ahead_of_feet(joints, ahead)
    what, least, behind = "the toes point", 0.0, toes
    if not len(toes):
        if not all(f"{side}_hand" in joints for side in SIDES):
            return []
        chest = (joints["left_shoulder"] + joints["right_shoulder"]) / 2
        hands = [joints[f"{side}_hand"] - chest for side in SIDES]
        behind = np.max([(hand * ahead).sum(axis=1) for hand in hands], axis=0)
        behind = behind[np.isfinite(behind)]
        what, least = "both hands are", BEHIND
    wrong = behind < -least
    if not len(behind) or wrong.mean() <= BACKWARDS:
        return []
    return [
        f"{what} behind the chest in {wrong.sum()} of {len(behind)} frames, as where "
        "left and right are swapped or an axis is mirrored: swap the names of both "
        "sides in a mapping (--mapping FILE)"
    ]


def _ahead_of_feet(joints: dict[str, np.ndarray], ahead: np.ndarray) -> np.ndarray:
    """Return (n,) how far toes are before the feet, of frames that tell [m]."""
    found = []
    for foot, toe in zip(FEET, TOES, strict=True):
        if foot in joints and toe in joints:
            along = joints[toe] - joints[foot]
            told = np.linalg.norm(along[:, :2], axis=1) > TOE
            found.append(np.where(told, (along * ahead).sum(axis=1), np.nan))
    if not found:
        return np.zeros(0)
    both = np.mean(found, axis=0)
    return both[np.isfinite(both)]


def _flying(faults: dict[str, Faults], duration_s: float) -> list[str]:
    hands = {s: faults[f"{s}_hand"] for s in SIDES if f"{s}_hand" in faults}
    swings = sum(hand.swings for hand in hands.values())
    if swings < max(SWINGS, SWINGS_PER_S * duration_s):
        return []
    return [
        f"the {side} hand flies at up to {hand.peak:.0f} m/s, with {hand.jumps} steps "
        "that no hand makes"
        for side, hand in hands.items()
        if hand.swings
    ]


def _noisy(faults: dict[str, Faults]) -> list[str]:
    return [
        f"the {joint.replace('_', ' ')} jumps in {fault.jumps} of {fault.steps} steps"
        for joint, fault in faults.items()
        if fault.noisy
    ]
