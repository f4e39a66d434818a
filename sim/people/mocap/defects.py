"""Recordings that show what no person does, as a whole: to be refused."""

import numpy as np

from handover.human.body import SIDES
from sim.people.mocap.faults import Faults
from sim.people.mocap.placing import forward

LEAN_BACK = 35.0  # [degrees] nobody standing leans back further; trackers sit 15 off
LEAN_SHARE = 0.05  # of the frames
SWINGS = 2  # times a hand flies: is impossibly fast over three or more steps ...
SWINGS_PER_S = 0.05  # ... and this often [1/s]


def defects(
    joints: dict[str, np.ndarray], faults: dict[str, Faults], duration_s: float
) -> tuple[str, ...]:
    """Return what is wrong, a clause each; none for a recording of a person.

    A single jump is a sensor fault and is survived. A trunk bent the wrong way, hands
    that keep flying, or jumps in every few frames come from a skeleton that was solved
    or named wrongly, and nothing in the file can be trusted.

    Args:
        joints: Joint -> (F, 3) places, z up [m], NaN: not seen.
        faults: Joint -> its jumps, already taken out of `joints`.
        duration_s: Length of the clip [s].
    """
    return (*_leaning(joints), *_flying(faults, duration_s), *_noisy(faults))


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
