"""How people stand, bend, sit, kneel, lie and climb: angles of trunk, legs and arms."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from handover.human.body import BodySizes
from handover.human.skeleton import Skeleton
from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.transforms import pose_of, rotation_rpy

HANGING = (5.0, 8.0, 0.0, 20.0, 0.0, 0.0, 0.0)  # an arm at rest


@dataclass(frozen=True)
class Posture:
    """Angles of a posture [deg]; the lengths come from a `Skeleton`.

    Attributes:
        words: What it looks like.
        pelvis: Pitch of the pelvis against upright, forward positive.
        chest: Pitch of the chest against the pelvis, forward positive.
        left_leg, right_leg: Hip flexion, knee flexion, and angle of the foot against
            the shank (90: the sole is square to it).
        arm: Joints of both arms.
        support: What carries the person: "feet", "knees" or "back".
        step: Height of what carries them above the floor [m].
    """

    words: str
    pelvis: float = 0.0
    chest: float = 0.0
    left_leg: tuple[float, float, float] = (0.0, 0.0, 90.0)
    right_leg: tuple[float, float, float] = (0.0, 0.0, 90.0)
    arm: tuple[float, ...] = HANGING
    support: str = "feet"
    step: float = 0.0


POSTURES = {
    "standing": Posture("upright, arms at the sides"),
    "bending": Posture(
        "trunk bent forward by 60 degrees, arms hanging, legs straight",
        pelvis=30.0,
        chest=30.0,
        left_leg=(30.0, 0.0, 90.0),
        right_leg=(30.0, 0.0, 90.0),
        arm=(60.0, 8.0, 0.0, 15.0, 0.0, 0.0, 0.0),
    ),
    "sitting": Posture(
        "on a chair of knee height, hands on the thighs",
        left_leg=(90.0, 90.0, 90.0),
        right_leg=(90.0, 90.0, 90.0),
        arm=(15.0, 8.0, 10.0, 75.0, 30.0, 0.0, 0.0),
    ),
    "kneeling": Posture(
        "upright on both knees",
        left_leg=(0.0, 90.0, 10.0),
        right_leg=(0.0, 90.0, 10.0),
        support="knees",
    ),
    "lying": Posture(
        "on the back, head to -x of the place, face up", pelvis=-90.0, support="back"
    ),
    "ladder": Posture(
        "on the second step of a ladder (0.56 m), one foot a step higher",
        pelvis=5.0,
        left_leg=(5.0, 0.0, 90.0),
        right_leg=(72.6, 82.6, 105.0),
        arm=(60.0, 12.0, 10.0, 60.0, 0.0, 0.0, 0.0),
        step=0.56,
    ),
}


def posture_named(name: str) -> Posture:
    """Return a posture by name; BadInput lists the known names."""
    if name not in POSTURES:
        raise BadInput(f"no posture {name!r}; choose one of {', '.join(POSTURES)}")
    return POSTURES[name]


@lru_cache(maxsize=64)
def leg_places(skeleton: Skeleton, posture: Posture) -> np.ndarray:
    """Return (2, 5, 3): hip, knee, ankle, heel and toes of both legs, pelvis frame [m].

    Heel and toes lie in the middle of the foot, not on the sole. Kept for the next
    frame of the same person.
    """
    thigh, shank, ankle, foot = skeleton.legs
    places = []
    legs = (posture.left_leg, posture.right_leg)
    for hip, (flexion, knee, sole) in zip(skeleton.hips, legs, strict=True):
        at_knee = hip + thigh * _down(flexion)
        at_ankle = at_knee + shank * _down(flexion - knee)
        # a quarter of the foot is behind the ankle
        ahead = _down(flexion - knee + sole)
        middle = at_ankle + 0.4 * ankle * _down(flexion - knee + sole - 90.0)
        heel, toes = middle - 0.25 * foot * ahead, middle + 0.75 * foot * ahead
        places.append([hip, at_knee, at_ankle, heel, toes])
    return frozen(places, np.float64)


def floor_pose(
    skeleton: Skeleton,
    posture: Posture,
    sizes: BodySizes,
    place: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    """Return T_world_pelvis (4, 4) of a person who rests on the floor z = 0.

    `sizes` tell how thick kneeling legs and a lying torso are; `place` is x, y of the
    pelvis [m] and the yaw that the person faces [rad].
    """
    T = pose_of((0.0, 0.0, 0.0), (0.0, np.radians(posture.pelvis), 0.0))
    legs = leg_places(skeleton, posture) @ T[:3, :3].T
    if posture.support == "feet":
        lowest = (legs[:, 2, 2]).min() - skeleton.legs[2]
    elif posture.support == "knees":
        lowest = (legs[:, 1, 2]).min() - sizes.shank
    else:
        lowest = -sizes.torso
    T[:3, :3] = rotation_rpy(0.0, 0.0, place[2]) @ T[:3, :3]
    T[:3, 3] = place[0], place[1], posture.step - lowest
    return T


def _down(angle_deg: float) -> np.ndarray:
    """Return the direction `angle_deg` in front of straight down, pelvis frame."""
    angle = np.radians(angle_deg)
    return np.array([np.sin(angle), 0.0, -np.cos(angle)])
