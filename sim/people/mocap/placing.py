"""Where the recorded person stands: from the recording to the robot's base frame."""

from collections.abc import Mapping

import numpy as np

from handover.human.body import SIDES
from roadmap.transforms import pose_of

MEET = 0.50  # x of the place where the person reaches, straight before the robot [m]
STAND = 0.85  # nearest x of the place where the person stands, as they reach [m]
NEVER_NEARER = 0.75  # nearest x of the hip at any time [m]
WORKING = 0.3  # the person works while the hip is this near to its median place [m]
REACHING = 0.2  # share of these frames that count as reaching: those reaching furthest

Joints = dict[str, np.ndarray]


def forward(joints: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return (F, 3) where the chest faces, level, z up; None without both shoulders."""
    if not all(f"{s}_shoulder" in joints for s in SIDES):
        return None
    right = joints["right_shoulder"] - joints["left_shoulder"]
    ahead = np.stack([-right[:, 1], right[:, 0], 0 * right[:, 0]], axis=1)
    length = np.linalg.norm(ahead, axis=1, keepdims=True)
    return ahead / np.where(length > 0, length, np.nan)  # NaN: one above the other


def base_from_recording(
    joints: Joints,
    stand: tuple[float, float, float] | None,
    floor: float,
    base_height: float,
) -> np.ndarray:
    """Return T_base_recording, (4, 4): the person set before the robot.

    The person stands where they spend their time and reach furthest from, and faces
    between where the chest then points and where the hand is. By default that hand is
    met at (0.5, 0) and the person faces -x, but never stands nearer than 0.85 m, nor
    comes nearer than 0.75 m; else they `stand` at (x, y) [m] with a yaw [rad], base
    frame. `floor` is its z in the recording, `base_height` that of the robot's base
    above it [m].
    """
    feet, hand, facing = _reaching(joints)
    yaw = np.pi if stand is None else stand[2]
    T = pose_of((0, 0, 0), (0, 0, yaw - np.arctan2(facing[1], facing[0])))
    turned = T[:2, :2]
    if stand is not None:
        shift = np.array(stand[:2]) - turned @ feet
    else:
        shift = np.array([MEET, 0.0]) - turned @ hand
        trunk = _trunk(joints)
        nearest = np.nanmin((trunk[:, :2] @ turned.T)[:, 0])
        stands = (turned @ feet)[0] + shift[0]
        nearest += shift[0]
        shift[0] += max(STAND - stands, NEVER_NEARER - nearest, 0.0)
    T[:2, 3], T[2, 3] = shift, -floor - base_height
    return T


def _trunk(joints: Joints) -> np.ndarray:
    """Return the (F, 3) hip, or the best there is instead."""
    for name in ("hip", "neck", "right_shoulder", "left_shoulder"):
        if name in joints:
            return joints[name]
    raise AssertionError("an arm has a shoulder")


def _reaching(joints: Joints) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (2,) where the person stands, where the hand is, and where they face."""
    trunk = _trunk(joints)
    hands = [joints[f"{s}_hand"] for s in SIDES if f"{s}_hand" in joints]
    home = np.nanmedian(trunk[:, :2], axis=0)
    # they walk up, or show a T-pose first: that is not where they work
    away = ~(np.linalg.norm(trunk[:, :2] - home, axis=1) <= WORKING)
    out = np.stack([np.linalg.norm((h - trunk)[:, :2], axis=1) for h in hands])
    out = np.where(np.isfinite(out) & ~away, out, -1.0)
    furthest, which = out.max(axis=0), out.argmax(axis=0)
    if not (furthest >= 0).any():  # trunk and hand never seen in one frame
        seen = [h[np.isfinite(h[:, 0]), :2] for h in hands]
        hand = np.median(np.concatenate(seen), axis=0)
        return home, hand, _direction(hand - home, None)
    bound = np.quantile(furthest[furthest >= 0], 1 - REACHING)
    frames = np.flatnonzero(furthest >= bound)
    feet = np.median(trunk[frames, :2], axis=0)
    reach = np.stack(hands)[which[frames], frames, :2] - trunk[frames, :2]
    reach = _most_central(reach)
    chest = forward(joints)
    chest = None if chest is None else chest[frames, :2]
    return feet, feet + reach, _direction(reach, chest)


def _most_central(points: np.ndarray) -> np.ndarray:
    """Return the (2,) point with the least distance to all; a real one, no mean."""
    some = points[:: max(len(points) // 300, 1)]
    distance = np.linalg.norm(some[:, None] - some[None], axis=2)
    return some[distance.sum(axis=1).argmin()]


def _direction(reach: np.ndarray, chest: np.ndarray | None) -> np.ndarray:
    """Return (2,) the middle of where the hand is and where the chest points."""
    length = np.linalg.norm(reach)
    total = reach / length if length > 1e-6 else np.zeros(2)
    if chest is not None and np.isfinite(chest).all(axis=1).any():
        mean = np.nanmean(chest, axis=0)
        total = total + mean / max(np.linalg.norm(mean), 1e-9)
    return total if np.linalg.norm(total) > 1e-6 else np.array([1.0, 0.0])
