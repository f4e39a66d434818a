"""Hands by name: where the palm is, which joints are fingers, how they stand open."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from roadmap.errors import BadInput, did_you_mean
from roadmap.transforms import pose_with


@dataclass(frozen=True, eq=False)
class HandSpec:
    """What must be known of a hand beyond its URDF.

    Attributes:
        name: Name of the hand.
        robot: Known name or URDF of a robot that carries it.
        root: Link that the fingers hang on; it and all beyond are the hand.
        palm: Link that `T_link_palm` is given in.
        T_link_palm: Palm frame, (4, 4) [m]: origin in the middle of the palm's face, z
            out of it, the direction of approach.
        fingers: For each finger its driving joints, base first: the order in which
            they close.
        closed: Joint -> value towards which it closes [rad or m].
        preshapes: Joint -> value of each open hand to begin from; joints that are not
            named stand at 0 [rad or m].
    """

    name: str
    robot: str
    root: str
    palm: str
    fingers: tuple[tuple[str, ...], ...]
    closed: Mapping[str, float]
    preshapes: tuple[Mapping[str, float], ...]
    T_link_palm: np.ndarray = field(default_factory=lambda: np.eye(4))

    @property
    def joints(self) -> tuple[str, ...]:
        """All joints that a grasp gives a value: the fingers', then others'."""
        names = [name for finger in self.fingers for name in finger]
        for shape in self.preshapes:
            names += [name for name in shape if name not in names]
        return tuple(names)


def _fingers(side: str, n: int) -> tuple[tuple[str, ...], ...]:
    joints = ("flexion", "bend")
    return tuple(
        tuple(f"{side}_finger_{k}_{joint}" for joint in joints) for k in range(1, n + 1)
    )


def _shape(
    side: str, n: int, flexion: float, bend: float, **more: float
) -> dict[str, float]:
    """Return an open hand: all fingers turned alike, outwards where negative."""
    values = {f"{side}_{name}": value for name, value in more.items()}
    for first, second in _fingers(side, n):
        values |= {first: flexion, second: bend}
    return values


def _hand(
    name: str, robot: str, side: str, n: int, ends: tuple[float, float], shapes: tuple
) -> HandSpec:
    """Return a hand whose fingers have two joints each, flexion and bend."""
    fingers = _fingers(side, n)
    closed = {
        joint: end for pair in fingers for joint, end in zip(pair, ends, strict=True)
    }
    return HandSpec(
        name, f"{robot}_{side}", f"{side}_hand", f"{side}_palm", fingers, closed, shapes
    )


def _sdh(side: str) -> HandSpec:
    # swivel 0: two fingers against the thumb; 60 degrees: a tripod; 90: a pinch
    shapes = tuple(
        _shape(side, 3, flexion, bend, knuckle=np.radians(swivel))
        for swivel in (0.0, 60.0)
        for flexion, bend in ((-0.6, 0.4), (0.0, 0.0))
    )
    name = f"sdh_{side}"
    return _hand(name, "crichton", side, 3, (1.5707, 1.5707), shapes)


def _hubo(side: str, n: int) -> HandSpec:
    shapes = tuple(_shape(side, n, f, b) for f, b in ((-0.7, 0.3), (-0.2, 0.0)))
    return _hand(f"hubo_{side}", "drchubo", side, n, (1.6, 1.7), shapes)


def _person(side: str) -> HandSpec:
    fingers = (*_fingers(side, 3), (f"{side}_thumb_flexion", f"{side}_thumb_bend"))
    shapes = tuple(
        {
            **_shape(side, 3, flexion, bend),
            f"{side}_thumb_flexion": thumb,
            f"{side}_thumb_bend": 0.0,
        }
        for flexion, bend, thumb in ((0.2, 0.1, -0.8), (0.7, 0.3, -0.3))
    )
    ends = (1.57, 1.8)
    closed = {j: e for f in fingers[:3] for j, e in zip(f, ends, strict=True)}
    closed |= dict(zip(fingers[3], (1.2, 1.4), strict=True))
    return HandSpec(
        f"person_{side}",
        f"person_{side}",
        f"{side}_hand",
        f"{side}_palm",
        fingers,
        closed,
        shapes,
    )


_PANDA = HandSpec(
    "panda",
    "panda",
    "panda_hand",
    "panda_hand",
    (("panda_finger_joint1",),),  # the other finger follows this one
    {"panda_finger_joint1": 0.0},
    ({"panda_finger_joint1": 0.04},),
    pose_with(np.eye(3), (0.0, 0.0, 0.066)),  # the hull of the hand's mesh ends there
)
_HANDS = {
    spec.name: spec
    for spec in (
        *(_sdh(side) for side in ("left", "right")),
        _hubo("left", 3),
        _hubo("right", 4),
        *(_person(side) for side in ("left", "right")),
        _PANDA,
    )
}
_ALSO = {"sdh": "sdh_left"}  # both SDHs are alike


def is_known(spec: HandSpec) -> bool:
    """Return whether a hand is one that `hand_spec` finds, and not the user's own."""
    return _HANDS.get(spec.name) is spec


def hand_names() -> list[str]:
    """Return the names that `hand_spec` knows."""
    return sorted({*_HANDS, *_ALSO})


def hand_spec(name: str) -> HandSpec:
    """Return what is known of a hand; BadInput lists the known names."""
    known = _ALSO.get(str(name), str(name))
    if known in _HANDS:
        return _HANDS[known]
    raise BadInput(
        f"there is no hand {name!r}; {did_you_mean(name, hand_names())} one of "
        f"{', '.join(hand_names())}"
    )
