"""A `Human` from measured joints: where a tracker or a recording saw them."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from handover.human import anthropometry as body
from handover.human.anthropometry import ARM_RANGES
from handover.human.body import ARM, JOINTS, SIDES, BodySizes
from handover.human.human import Human
from handover.human.human_arm import MIRROR, check_side
from handover.human.skeleton import Skeleton
from roadmap.arrays import as_floats
from roadmap.errors import BadInput
from roadmap.ranges import check_kind
from roadmap.transforms import check_pose, pose_with, rotation_rpy

# What a degree outside the range counts, of the first four joints: an elbow that bends
# back is far less likely than a rotation beyond the textbook's, which a few centimetres
# of a marker make.
_BEYOND = np.array([1.0, 1.0, 1.0, 5.0])
_FLEXION_SEAM = ARM_RANGES[0].mean() - np.pi  # [rad] angles are counted from here on


def human_from_joints(
    places: np.ndarray | Mapping[str, np.ndarray],
    height: float | None = None,
    *,
    hands: Mapping[str, np.ndarray] | None = None,
    posture: str = "standing",
    gaze: np.ndarray | None = None,
    thickness: str = "conservative",
) -> Human:
    """Return a person whose joints are where they were measured.

    The lengths are the measured ones, and the joints of the arms follow in closed form
    from shoulder, elbow and wrist; measured joints come back exactly in
    `Human.places`. The hand is turned as in `hands`, else in line with a
    finger tip, else in line with the forearm; without `hands` the forearm is taken
    midway between pronation and supination. What is not seen has the proportions of
    the height and rests as in the posture.

    Args:
        places: (11, 3) places of `handover.human.body.JOINTS` in a frame with z up [m],
            NaN where not known, or joint name -> (3,). One whole arm, and the neck or
            both shoulders, must be known.
        height: Of the body [m]; None: estimated by the trunk's and arms' lengths, and
            kept within 1.2 to 2.2 m. It only tells what was not measured.
        hands: Side -> (3, 3) rotation of the hand frame, see
            `handover/human/human_arm.py`.
        posture: Of the legs only, and of an arm that is not known.
        gaze: Direction (3,), if known.
        thickness: As of `Human`.

    Raises:
        BadInput: Too few joints, places on one spot, no person's proportions.
    """
    at = _named(places)
    sides = [s for s in SIDES if all(f"{s}_{j}" in at for j in ARM)]
    both = all(f"{s}_shoulder" in at for s in SIDES)
    if not sides or not (both or "neck" in at):
        raise BadInput(
            f"known joints are {', '.join(at) or 'none'}; a person needs shoulder, "
            "elbow and hand of one side, and the neck or both shoulders"
        )
    if height is None:
        height = _height(at, sides)
    body.check_height(height, "leave it out to have it estimated")
    R, neck, hip = _trunk(at, height)
    palm = BodySizes.sized(height, thickness).hand
    skeleton = _skeleton(at, sides, height, palm, (R, neck, hip))
    check_kind("hands", hands or {}, Mapping, "give side -> (3, 3) rotation")
    hands = {check_side(side): turn for side, turn in (hands or {}).items()}
    joints = {s: _arm_joints(s, at, R, hands.get(s)) for s in sides}
    T = pose_with(R, hip - R @ skeleton.hips.mean(axis=0))
    straight = np.zeros(3)  # the bend of the trunk is in R already
    return Human(
        height, posture, T, joints, gaze, skeleton, thickness=thickness, bend=straight
    )


def arm_joints(
    u: np.ndarray,
    v: np.ndarray,
    fingers: np.ndarray | None = None,
    R_hand: np.ndarray | None = None,
) -> np.ndarray:
    """Return the joints of an arm from its directions, canonical shoulder frame.

    Args:
        u: (3,) unit, shoulder to elbow.
        v: (3,) unit, elbow to wrist.
        fingers: (3,) unit, wrist to finger tips; None: as `v`.
        R_hand: (3, 3) rotation of the hand; then `fingers` is not looked at.

    Returns:
        (7,) joints [rad], of all readings those nearest to their ranges; not clipped,
        since a measured arm may be outside them (an elbow bent back). The nearer the
        elbow is to straight, the less it tells of the rotation of the upper arm.
    """
    best, least = None, np.inf
    for over_shoulder, back_elbow in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        q = _reading(u, v, over_shoulder, back_elbow)
        off = np.maximum(ARM_RANGES[:4, 0] - q[:4], q[:4] - ARM_RANGES[:4, 1])
        off = np.maximum(off, 0.0) @ _BEYOND
        if off < least:
            best, least = q, off
    f, a, r, e = best[:4]
    turned = rotation_rpy(-a, 0.0, 0.0) @ rotation_rpy(0.0, 0.0, r)
    R = rotation_rpy(0.0, -f, 0.0) @ turned @ rotation_rpy(0.0, -e, 0.0)
    if R_hand is None:
        x, y, z = R.T @ (v if fingers is None else fingers)
        best[5:] = np.arctan2(x, -z), np.arctan2(y, np.hypot(x, z))
    else:
        W = R.T @ np.column_stack([R_hand[:, 1], R_hand[:, 0], -R_hand[:, 2]])
        best[4] = np.arctan2(W[1, 0], W[0, 0])
        best[5] = np.arctan2(W[2, 0], np.hypot(W[0, 0], W[1, 0]))
        best[6] = np.arctan2(W[2, 1], W[2, 2])
    return best


def _reading(u: np.ndarray, v: np.ndarray, shoulder: int, elbow: int) -> np.ndarray:
    """Return the joints with one of two readings each of shoulder and elbow."""
    lateral = math.hypot(u[0], u[2])
    f = math.atan2(shoulder * u[0], -shoulder * u[2]) if lateral > 1e-9 else 0.0
    if f < _FLEXION_SEAM:
        f += 2.0 * math.pi
    a = math.atan2(-u[1], shoulder * lateral)
    # v in the frame Ry(-f) Rx(-a): what is left is Rz(r) and the elbow
    cf, sf, ca, sa = math.cos(f), math.sin(f), math.cos(a), math.sin(a)
    x, z = cf * v[0] + sf * v[2], cf * v[2] - sf * v[0]
    y, z = ca * v[1] - sa * z, sa * v[1] + ca * z
    bent = math.hypot(x, y)
    r = math.atan2(elbow * y, elbow * x) if bent > 1e-9 else 0.0
    return np.array([f, a, r, math.atan2(elbow * bent, -z), 0.0, 0.0, 0.0])


def _named(places: np.ndarray | Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return joint -> place of those that are known."""
    if not isinstance(places, Mapping):
        places = as_floats("places", places)
        if places.shape != (len(JOINTS), 3):
            raise BadInput(
                f"places have shape {places.shape}; give ({len(JOINTS)}, 3), one row "
                f"for each of {', '.join(JOINTS)}"
            )
        places = dict(zip(JOINTS, places, strict=True))
    unknown = sorted(set(places) - set(JOINTS))
    if unknown:
        raise BadInput(
            f"a body has no joint {', '.join(unknown)}; choose from {', '.join(JOINTS)}"
        )
    at = {name: as_floats(name, place) for name, place in places.items()}
    wrong = [name for name, place in at.items() if place.shape != (3,)]
    if wrong:
        raise BadInput(f"the place of {wrong[0]} is no (3,) point in metres")
    return {n: at[n] for n in JOINTS if n in at and np.isfinite(at[n]).all()}


def _height(at: dict[str, np.ndarray], sides: list[str]) -> float:
    """Return the height that arms and trunk speak for, on average [m]."""
    guesses = []
    for s in sides:
        for a, b, share in (
            (f"{s}_shoulder", f"{s}_elbow", body.UPPER_ARM),
            (f"{s}_elbow", f"{s}_hand", body.FOREARM),
        ):
            guesses.append(np.linalg.norm(at[a] - at[b]) / share)
    if "neck" in at and "hip" in at:
        guesses.append(np.linalg.norm(at["neck"] - at["hip"]) / body.TRUNK)
    guess = float(np.mean(guesses))
    if not 0.6 * body.HEIGHTS[0] <= guess <= 1.5 * body.HEIGHTS[1]:
        raise BadInput(
            f"arms and trunk are those of a person of {guess:.3g} m; check the unit of "
            "the places, metres, or give the height"
        )
    return float(np.clip(guess, *body.HEIGHTS))


def _trunk(
    at: dict[str, np.ndarray], height: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the trunk's rotation, and the places of neck and hip."""
    shoulders = [at[f"{s}_shoulder"] for s in SIDES if f"{s}_shoulder" in at]
    neck = at["neck"] if "neck" in at else np.mean(shoulders, axis=0)
    hip = at.get("hip", neck - [0.0, 0.0, body.TRUNK * height])
    if len(shoulders) == 2:
        left = shoulders[0] - shoulders[1]
    else:
        side = next(s for s in SIDES if f"{s}_shoulder" in at)
        left = (at[f"{side}_shoulder"] - neck) * (1.0 if side == "left" else -1.0)
    up = neck - hip
    front = np.cross(left, up)
    if np.linalg.norm(front) < 1e-3 * max(np.linalg.norm(up), 1e-3):
        raise BadInput(
            "hip, neck and shoulders lie on one line, so that no front is known; check "
            "the places"
        )
    z, x = up / np.linalg.norm(up), front / np.linalg.norm(front)
    return np.column_stack([x, np.cross(z, x), z]), neck, hip


def _skeleton(
    at: dict[str, np.ndarray],
    sides: list[str],
    height: float,
    palm: float,
    trunk: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> Skeleton:
    """Return the lengths as measured, those of the height where nothing was.

    palm: radius of the hand, by which it reaches beyond a measured tip; trunk: what
    `_trunk` returned.
    """
    R, neck, hip = trunk
    usual = Skeleton.of_height(height)
    origin = hip + R @ (np.array([0.0, 0.0, usual.trunk]) - usual.hips.mean(axis=0))
    shoulders, arms = np.array(usual.shoulders), np.array(usual.arms)
    hands = np.array(usual.hands)
    for i, side in enumerate(SIDES):
        if f"{side}_shoulder" in at:
            shoulders[i] = R.T @ (at[f"{side}_shoulder"] - origin)
        if side in sides:
            shoulder, elbow, wrist = (at[f"{side}_{j}"] for j in ARM)
            arms[i, :2] = np.linalg.norm([elbow - shoulder, wrist - elbow], axis=1)
            if (arms[i, :2] < 0.02).any():
                raise BadInput(
                    f"shoulder, elbow and hand of the {side} arm are within 2 cm; "
                    "check the places"
                )
        if side in sides and f"{side}_tip" in at:
            hands[i] = palm + np.linalg.norm(at[f"{side}_tip"] - at[f"{side}_hand"])
    skull = R.T @ (at["head"] - neck) if "head" in at else usual.skull
    return replace(
        usual,
        shoulders=shoulders,
        neck=R.T @ (neck - origin),
        skull=skull,
        arms=arms,
        hands=hands,
    )


def _arm_joints(
    side: str, at: dict[str, np.ndarray], R: np.ndarray, R_hand: np.ndarray | None
) -> np.ndarray:
    """Return the joints of one measured arm."""
    flip = MIRROR if side == "left" else np.eye(3)
    shoulder, elbow, wrist = (at[f"{side}_{j}"] for j in ARM)
    u, v = (flip @ R.T @ _unit(b - a) for a, b in ((shoulder, elbow), (elbow, wrist)))
    fingers = None
    if f"{side}_tip" in at and np.linalg.norm(at[f"{side}_tip"] - wrist) > 1e-3:
        fingers = flip @ R.T @ _unit(at[f"{side}_tip"] - wrist)
    if R_hand is not None:
        name = f"the {side} hand's rotation"
        R_hand = as_floats(name, R_hand)
        if R_hand.shape != (3, 3):
            raise BadInput(f"{name} has shape {R_hand.shape}; give (3, 3)")
        given = check_pose(pose_with(R_hand), name)[:3, :3]
        R_hand = flip @ R.T @ given @ flip
    return arm_joints(u, v, fingers, R_hand)


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)
