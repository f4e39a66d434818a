"""A person as an agent: the URDF of a `Human`, with a hand that can grasp.

`python tests/person_agent.py` writes `maps/person.urdf`, of 1.75 m. The seven joints of
each arm are those of `handover.human.human_arm`, so `Human` and agent agree in every
angle; a test says so. The body is that of mean thickness: a hand that takes something
cannot be the conservative capsule around it.
"""

from pathlib import Path

import numpy as np

from handover.human.anthropometry import ARM_JOINTS, ARM_RANGES
from handover.human.body import SIDES, Part
from handover.human.human import Human

HEIGHT = 1.75  # [m] of maps/person.urdf
# axes of the arm's hinges at zero, right arm, shoulder frame; a left arm mirrors them
_AXES = (
    (0, -1, 0), (-1, 0, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, -1, 0), (1, 0, 0),
)  # fmt: skip
_SPEED = (
    3.0,
    3.0,
    3.0,
    4.0,
    4.0,
    4.0,
    4.0,
)  # [rad/s] brisk, not the fastest: estimates
_LEG_LIMITS = {"hip": (-0.3, 2.1), "knee": (-2.4, 0.0), "ankle": (-1.5, 1.0)}
# palm and fingers, hand frame: x out of the palm, z to the fingers, from the wrist.
# Estimates from a breadth of 0.085 m and a hand of 0.19 m; fingers are three, thick as
# 18 mm, their two last bones one.
_PALM, _PALM_AT = (0.028, 0.085, 0.085), (0.0, 0.0, 0.0525)
_FINGERS = ((0.002, 0.030, 0.104), (0.002, 0.0, 0.107), (0.002, -0.030, 0.104))
_BONES, _THUMB_BONES, _RADIUS = (0.045, 0.035), (0.045, 0.028), 0.009
_THUMB = (0.014, 0.030, 0.030)
_FACE = 0.014  # [m] of the palm before the hand's axis


def arm_joint(side: str, name: str) -> str:
    """Return what a joint of `ARM_JOINTS` is called in the URDF."""
    return f"{side}_{name.replace(' ', '_')}"


def person_urdf(height: float = HEIGHT) -> str:
    """Return the URDF of a person of a body height [m].

    Base: the pelvis frame of `Human`. All joints at 0: upright, arms hanging, palms to
    the thighs, legs straight.
    """
    arms = {side: np.zeros(7) for side in SIDES}
    pelvis = np.eye(4)
    human = Human(height, arms=arms, thickness="mean", T_world_pelvis=pelvis)
    lines = ['<?xml version="1.0"?>', "<!-- Written by tests/person_agent.py. -->"]
    lines += ['<robot name="person">']
    trunk = [
        rod
        for rod, label in zip(human.capsules(), human.labels, strict=True)
        if label in (Part.TORSO, Part.HEAD)
    ]
    lines += _link("pelvis", [_rod(rod[:3], rod[3:6], rod[6]) for rod in trunk])
    for k, side in enumerate(SIDES):
        lines += _leg(human, k, side)
        lines += _arm(human, k, side)
    return "\n".join([*lines, "</robot>", ""])


def _leg(human: Human, k: int, side: str) -> list[str]:
    """Return hip, knee and ankle; forward is negative about y, as the axis says."""
    thigh, shank, ankle, foot = human.skeleton.legs
    sizes, down = human.sizes, np.array([0.0, 0.0, -1.0])
    middle = 0.4 * ankle * down
    # thighs do not overlap, soles are as far below the ankle as the skeleton says
    round_thigh = min(sizes.thigh, abs(human.skeleton.hips[k, 1]) - 0.001)
    round_foot = min(sizes.foot, 0.6 * ankle)
    ahead = np.array([1.0, 0.0, 0.0])
    heel = middle + (round_foot - 0.25 * foot) * ahead
    toes = middle + (0.75 * foot - round_foot) * ahead
    rods = (
        ("hip", "thigh", human.skeleton.hips[k], (0 * down, thigh * down), round_thigh),
        ("knee", "shank", thigh * down, (0 * down, shank * down), sizes.shank),
        ("ankle", "foot", shank * down, (heel, toes), round_foot),
    )
    lines, parent = [], "pelvis"
    for joint, link, at, ends, radius in rods:
        name = f"{side}_{link}"
        lines += _link(name, [_rod(*ends, radius)])
        limits = _LEG_LIMITS[joint]
        lines += _hinge(f"{side}_{joint}", parent, name, at, (0, -1, 0), limits, 1.0)
        parent = name
    return lines


def _arm(human: Human, k: int, side: str) -> list[str]:
    upper, fore, _ = human.skeleton.arms[k]
    sizes, down, none = human.sizes, np.array([0.0, 0.0, -1.0]), np.zeros(3)
    mirror = np.array([-1.0, 1.0, -1.0]) if side == "left" else np.ones(3)
    shoulder = human.skeleton.shoulders[k] + [0.0, 0.0, human.skeleton.trunk]
    # the capsule of the forearm ends before the wrist, where the palm begins
    solid = {
        3: ("upper_arm", [_rod(none, upper * down, sizes.upper_arm)]),
        5: ("forearm", [_rod(none, (fore - 0.049) * down, sizes.forearm)]),
        7: ("hand", _hand(side)),
    }
    places = {1: shoulder, 4: upper * down, 6: fore * down}
    lines, parent = [], "pelvis"
    for j, (axis, speed) in enumerate(zip(_AXES, _SPEED, strict=True), 1):
        link, shapes = solid.get(j, (f"arm_{j}", []))
        name = f"{side}_{link}"
        lines += _link(name, shapes)
        lines += _hinge(
            arm_joint(side, ARM_JOINTS[j - 1]),
            parent,
            name,
            places.get(j, none),
            mirror * axis,
            tuple(ARM_RANGES[j - 1]),
            speed,
        )
        parent = name
    return [*lines, *_palm(side), *_fingers(side)]


def _to_link(side: str, p: tuple) -> np.ndarray:
    """Return a place of the hand frame (from the wrist) in the hand link's frame.

    The link's axes are the shoulder's at zero: the hand frame's x points to the body.
    """
    x, y, z = p
    return np.array([y, x if side == "right" else -x, -z])


def _hand(side: str) -> list[str]:
    x, y, z = _PALM
    at = _to_link(side, _PALM_AT)
    wrist = _rod(np.zeros(3), _to_link(side, (0.0, 0.0, 0.02)), 0.026)
    return [_shape(at, f'<box size="{y:g} {x:g} {z:g}"/>'), wrist]


def _palm(side: str) -> list[str]:
    """Return the palm frame: z out of the palm, x to the fingers."""
    at = _to_link(side, (_FACE, 0.0, 0.062))
    # z is the link's y (right hand) or -y (left); x is down
    rpy = (-0.5 * np.pi, 0.5 * np.pi, 0.0) if side == "right" else (
        0.5 * np.pi, 0.5 * np.pi, 0.0)  # fmt: skip
    return [
        *_link(f"{side}_palm", []),
        f'  <joint name="{side}_palm_fixed" type="fixed">'
        f'<parent link="{side}_hand"/><child link="{side}_palm"/>'
        f'<origin xyz="{_text(at)}" rpy="{_text(rpy)}"/></joint>',
    ]


def _fingers(side: str) -> list[str]:
    """Return three fingers that point down at 0, and a thumb that points from the palm.

    Positive values close: fingers to the palm, the thumb to the fingers.
    """
    inward = 1.0 if side == "right" else -1.0  # the palm faces the link's +y or -y
    closes = np.array([inward, 0.0, 0.0])  # turns down to inward
    lines: list[str] = []
    for k, place in enumerate(_FINGERS, 1):
        way = np.array([0.0, 0.0, -1.0])
        names = (f"{side}_finger_{k}_flexion", f"{side}_finger_{k}_bend")
        limits = ((-0.3, 1.57), (0.0, 1.8))
        lines += _finger(side, names, place, way, closes, _BONES, limits)
    way = np.array([0.0, inward, 0.0])
    names = (f"{side}_thumb_flexion", f"{side}_thumb_bend")
    limits = ((-1.0, 1.2), (0.0, 1.4))
    lines += _finger(side, names, _THUMB, way, -closes, _THUMB_BONES, limits)
    return lines


def _finger(side, names, place, way, axis, bones, limits) -> list[str]:
    lines, parent, at = [], f"{side}_hand", _to_link(side, place)
    for name, bone, limit in zip(names, bones, limits, strict=True):
        link = f"{name}_bone"
        lines += _link(link, [_rod(np.zeros(3), bone * way, _RADIUS)])
        lines += _hinge(name, parent, link, at, axis, limit, 3.0)
        parent, at = link, bone * way
    return lines


def _rod(a: np.ndarray, b: np.ndarray, radius: float) -> str:
    """Return a capsule as a cylinder between two spheres; URDF has none."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    length, d = float(np.linalg.norm(b - a)), b - a
    turn = (0.0, float(np.arctan2(np.hypot(d[0], d[1]), d[2])),
            float(np.arctan2(d[1], d[0])))  # fmt: skip
    ball = f'<sphere radius="{radius:.6g}"/>'
    body = f'<cylinder radius="{radius:.6g}" length="{length:.6g}"/>'
    shapes = [_shape(a, ball), _shape(b, ball)]
    if length > 1e-9:
        shapes.append(_shape(0.5 * (a + b), body, turn))
    return "\n".join(shapes)


def _shape(at: np.ndarray, geometry: str, rpy: tuple = (0.0, 0.0, 0.0)) -> str:
    return (
        f'    <collision><origin xyz="{_text(at)}" rpy="{_text(rpy)}"/>'
        f"<geometry>{geometry}</geometry></collision>"
    )


def _link(name: str, shapes: list[str]) -> list[str]:
    if not shapes:
        return [f'  <link name="{name}"/>']
    return [f'  <link name="{name}">', *shapes, "  </link>"]


def _hinge(name, parent, child, at, axis, limits, speed) -> list[str]:
    low, high = limits
    return [
        f'  <joint name="{name}" type="revolute"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="{_text(at)}"/>',
        f'    <axis xyz="{_text(axis)}"/><limit lower="{low:.9g}" upper="{high:.9g}" '
        f'velocity="{speed:g}" effort="100"/></joint>',
    ]


def _text(numbers: object) -> str:
    return " ".join(f"{float(x) + 0.0:.9g}" for x in numbers)


if __name__ == "__main__":
    file = Path(__file__).parent.parent / "maps" / "person.urdf"
    file.write_text(person_urdf(), encoding="utf-8")
