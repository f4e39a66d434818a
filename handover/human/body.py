"""A person's body as closed, labelled capsules from the places of its joints."""

import math
from collections.abc import Collection
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np

from handover.human import anthropometry
from handover.human._human_arm import body_rods
from handover.human.anthropometry import RADII, check_height, check_thickness
from roadmap.arrays import frozen, writable
from roadmap.errors import BadInput


class Part(IntEnum):
    """What a capsule stands for; the value is its label."""

    LEFT_HAND = 0
    LEFT_FOREARM = 1
    LEFT_UPPER_ARM = 2
    RIGHT_HAND = 3
    RIGHT_FOREARM = 4
    RIGHT_UPPER_ARM = 5
    TORSO = 6
    HEAD = 7
    LEFT_LEG = 8
    RIGHT_LEG = 9

    @property
    def words(self) -> str:
        """The part as a person says it: 'left upper arm'."""
        return self.name.lower().replace("_", " ")


SIDES = ("left", "right")
ARM = ("shoulder", "elbow", "hand")  # the joints an arm cannot do without
JOINTS = (  # `hand` is the wrist, or a marker on the back of the hand
    "hip",
    "neck",
    "head",
    *(f"{side}_{joint}" for side in SIDES for joint in (*ARM, "tip")),
)
COLUMN = {name: i for i, name in enumerate(JOINTS)}
_NO_LEGS, _HERE = np.zeros((0, 7)), np.eye(4)
ARM_LABELS = {  # hand, forearm, upper arm
    "right": (Part.RIGHT_HAND, Part.RIGHT_FOREARM, Part.RIGHT_UPPER_ARM),
    "left": (Part.LEFT_HAND, Part.LEFT_FOREARM, Part.LEFT_UPPER_ARM),
}
LEG_LABELS = frozen(np.repeat([Part.LEFT_LEG, Part.RIGHT_LEG], 3), np.int64)


@dataclass(frozen=True)
class BodySizes:
    """Thickness of the parts, and the lengths that joints alone do not tell."""

    # radii [m]
    hand: float
    forearm: float
    upper_arm: float
    torso: float
    shoulders: float
    head: float
    hand_length: float  # wrist to finger tips of a straight hand [m]
    crown: float  # base of the neck to the top of the head [m]
    trunk: float  # hip to base of the neck [m], used where no hip is known
    # radii [m]
    thigh: float = RADII["conservative"][6]
    shank: float = RADII["conservative"][7]
    foot: float = RADII["conservative"][8]

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 < value < 1:
                raise BadInput(
                    f"{name} of a body is {value} m; give a size between 0 and 1 m"
                )

    @classmethod
    def sized(
        cls, height: float = 1.75, thickness: str = "conservative"
    ) -> "BodySizes":
        """Return the sizes of an adult; lengths are fractions of `height` [m].

        The fractions are those of `handover.human.anthropometry`. Thickness hardly
        depends on height.

        Args:
            height: Body height [m], 1.2 to 2.2.
            thickness: "conservative" (thick man, clothed) or "mean".

        Raises:
            BadInput: The height is out of range or the thickness unknown.
        """
        check_height(height, "give BodySizes with your own numbers instead")
        radii = RADII[check_thickness(thickness)]
        shares = anthropometry.HAND, anthropometry.NECK_TO_CROWN, anthropometry.TRUNK
        lengths = [share * height for share in shares]
        return cls(*radii[:6], *lengths, *radii[6:])


@dataclass(frozen=True, eq=False)
class UpperBody:
    """Capsules of a person of whom only some joints (`present`) are known.

    An arm needs shoulder, elbow and hand, else it is left out. Torso and head need
    the neck or both shoulders; what else is missing is placed by `sizes`, upright. A
    hand reaches straight on from the forearm, unless a finger tip is known.

    Attributes:
        present: Names out of `JOINTS`.
        sizes: Thickness and lengths.
        labels: (k,) `Part` of each capsule, int64.
        needs: (k, 11) joints that place each capsule, bool.
    """

    present: Collection[str]
    sizes: BodySizes

    def __post_init__(self) -> None:
        """Note the capsules, or refuse unknown joints and a body without arms."""
        unknown = sorted(set(self.present) - set(JOINTS))
        if unknown:
            raise BadInput(
                f"a body has no joint {', '.join(unknown)}; choose from "
                f"{', '.join(JOINTS)}"
            )
        object.__setattr__(self, "present", frozenset(self.present))
        if not self.sides:
            raise BadInput(
                f"no arm is complete among {', '.join(sorted(self.present)) or 'none'};"
                " give shoulder, elbow and hand of at least one side"
            )
        rods = self._rods(dict.fromkeys(self.present, np.zeros(3)))  # wherever it is
        labels = np.array([part for part, *_ in rods])
        needs = np.zeros((len(rods), len(JOINTS)), bool)
        for row, (_, joints, *_) in zip(needs, rods, strict=True):
            row[[COLUMN[name] for name in joints]] = True
        object.__setattr__(self, "labels", frozen(labels, np.int64))
        object.__setattr__(self, "needs", frozen(needs, np.bool_))

    @cached_property
    def sides(self) -> tuple[str, ...]:
        """The sides whose arm is complete."""
        complete = (all(f"{s}_{j}" in self.present for j in ARM) for s in SIDES)
        return tuple(s for s, whole in zip(SIDES, complete, strict=True) if whole)

    @cached_property
    def has_trunk(self) -> bool:
        """Whether torso and head can be placed."""
        return "neck" in self.present or len(self._shoulders) == 2

    @cached_property
    def _shoulders(self) -> tuple[str, ...]:
        return tuple(n for n in (f"{s}_shoulder" for s in SIDES) if n in self.present)

    @cached_property
    def _is_whole(self) -> bool:
        return set(self.present) == set(JOINTS)

    @cached_property
    def _limbs(self) -> np.ndarray:
        """(7, 2) joints at the ends of the rods of arms, and across the shoulders."""
        names = []
        for side in SIDES:
            shoulder, elbow, hand, tip = (f"{side}_{j}" for j in (*ARM, "tip"))
            names += [(hand, tip), (elbow, hand), (shoulder, elbow)]
        names.append(("left_shoulder", "right_shoulder"))
        return np.array([[COLUMN[name] for name in ends] for ends in names])

    @cached_property
    def _lengths(self) -> np.ndarray:
        """(2,) of the axes of torso and head, as `body_rods` takes them [m]."""
        sizes = self.sizes
        return np.array([sizes.torso - sizes.shoulders, sizes.crown - sizes.head])

    @cached_property
    def _radii(self) -> np.ndarray:
        """(9,) radii of the rods of a whole body [m]."""
        sizes = self.sizes
        arm = (sizes.hand, sizes.forearm, sizes.upper_arm)
        return np.array([*arm, *arm, sizes.torso, sizes.shoulders, sizes.head])

    def capsules(self, places: np.ndarray) -> np.ndarray:
        """Return the body as closed capsules.

        Args:
            places: (..., 11, 3) places of `JOINTS` in a frame whose z is up [m];
                those not `present` are not looked at.

        Returns:
            (..., k, 7) ends a, b and radius, labelled by `labels` [m].
        """
        if self._is_whole and places.ndim == 2:
            return self.with_legs(places, _NO_LEGS, _HERE)
        at = {name: places[..., COLUMN[name], :] for name in self.present}
        rods = self._rods(at)
        rows = np.empty((*places.shape[:-2], len(rods), 7))
        for k, (_, _, a, b, radius) in enumerate(rods):
            rows[..., k, :3], rows[..., k, 3:6], rows[..., k, 6] = a, b, radius
        return rows

    def with_legs(
        self, places: np.ndarray, legs: np.ndarray, T_pelvis: np.ndarray
    ) -> np.ndarray:
        """Return one body, all of whose joints are known, and its legs.

        Args:
            places: (11, 3) of `JOINTS` in a frame whose z is up [m].
            legs: (n, 7) capsules in the pelvis frame [m].
            T_pelvis: (4, 4) pose of the pelvis in the first frame [m].

        Returns:
            (9 + n, 7) as `capsules`, then the legs [m].
        """
        rows = np.empty((9 + len(legs), 7))
        rows[:9, 6], rows[9:, 6] = self._radii, legs[:, 6]
        given = (writable(x) for x in (legs, T_pelvis))
        body_rods(writable(places), self._limbs, self._lengths, *given, rows)
        return rows

    def _rods(self, at: dict[str, np.ndarray]) -> list[tuple]:
        """Return part, joints that place it, ends (..., 3) [m], radius of each rod."""
        rods = [rod for side in self.sides for rod in self._arm(at, side)]
        return rods + (self._trunk(at) if self.has_trunk else [])

    def _arm(self, at: dict[str, np.ndarray], side: str) -> list[tuple]:
        shoulder, elbow, hand, tip = (f"{side}_{j}" for j in (*ARM, "tip"))
        hand_part, fore, upper = ARM_LABELS[side]
        sizes, wrist = self.sizes, at[hand]
        if tip in at:
            fingers = at[tip]
        else:
            beyond = max(sizes.hand_length - sizes.hand, 0.0)
            fingers = wrist + beyond * _unit(wrist - at[elbow])
        along = hand, tip if tip in at else elbow
        return [
            (hand_part, along, wrist, fingers, sizes.hand),
            (fore, (elbow, hand), at[elbow], wrist, sizes.forearm),
            (upper, (shoulder, elbow), at[shoulder], at[elbow], sizes.upper_arm),
        ]

    def _trunk(self, at: dict[str, np.ndarray]) -> list[tuple]:
        sizes, above = self.sizes, ("neck",) if "neck" in at else self._shoulders
        shoulders = [at[name] for name in self._shoulders]
        neck = at["neck"] if "neck" in at else np.mean(shoulders, axis=0)
        hip = at.get("hip", neck - [0.0, 0.0, sizes.trunk])
        needs = [(*above, name) if name in at else above for name in ("hip", "head")]
        # a round end at the neck would bury the chin: it ends at the shoulders' height
        spine, length = _unit(neck - hip), _length(neck - hip)
        chest = neck - np.minimum(length, sizes.torso - sizes.shoulders) * spine
        rods = [(Part.TORSO, needs[0], hip, chest, sizes.torso)]
        if len(shoulders) == 2:
            rods.append((Part.TORSO, self._shoulders, *shoulders, sizes.shoulders))
        towards = at.get("head", neck + [0.0, 0.0, 1.0]) - neck
        # a head joint is the base of the skull or a marker on top: reach the crown
        crown = sizes.crown - sizes.head
        reach = np.maximum(_length(towards), crown) if "head" in at else crown
        crown = neck + reach * _unit(towards)
        return [*rods, (Part.HEAD, needs[1], neck, crown, sizes.head)]


def leg_capsules(places: np.ndarray, sizes: BodySizes) -> np.ndarray:
    """Return thigh, shank and foot of both legs, labelled by `LEG_LABELS`.

    Args:
        places: (2, 5, 3) hip, knee, ankle, heel and toes; left leg first [m].
        sizes: Their radii.

    Returns:
        (6, 7) ends a, b and radius [m]; the foot's round ends touch heel and toes from
        inside.
    """
    rows = np.empty((6, 7))
    legs = rows.reshape(2, 3, 7)
    legs[:, :2, :3], legs[:, :2, 3:6] = places[:, :2], places[:, 1:3]
    heels, toes = places[:, 3], places[:, 4]
    feet = toes - heels
    lengths = [max(math.sqrt(foot @ foot), 1e-9) for foot in feet]
    inset = [[min(sizes.foot / length, 0.5)] for length in lengths] * feet
    legs[:, 2, :3], legs[:, 2, 3:6] = heels + inset, toes - inset
    legs[:, :, 6] = sizes.thigh, sizes.shank, sizes.foot
    return rows


def joint_places(capsules: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return the places of the joints that made labelled capsules.

    The inverse of `UpperBody.capsules`, for a motion that tells capsules only: its
    places give the same capsules again. A head's end stands for the head joint.

    Args:
        capsules: (k, 7) ends a, b and radius, as `UpperBody.capsules` orders them [m].
        labels: (k,) `Part` of each.

    Returns:
        (11, 3) places of `JOINTS` [m]; NaN where no capsule tells.
    """
    rods = zip(labels[::-1], capsules[::-1], strict=True)
    first = {Part(label): rod for label, rod in rods}  # of several, the first
    places = np.full((len(JOINTS), 3), np.nan)
    ends = [(Part.TORSO, "hip", None), (Part.HEAD, "neck", "head")]
    for side in SIDES:
        hand, fore, upper = ARM_LABELS[side]
        ends += [
            (upper, f"{side}_shoulder", f"{side}_elbow"),
            (fore, None, f"{side}_hand"),
            (hand, None, f"{side}_tip"),
        ]
    for part, near, far in ends:
        if part in first:
            for name, end in ((near, first[part][:3]), (far, first[part][3:6])):
                if name is not None:
                    places[COLUMN[name]] = end
    return places


def _length(v: np.ndarray) -> np.ndarray:
    return np.sqrt(np.add.reduce(v * v, axis=-1, keepdims=True))


def _unit(v: np.ndarray) -> np.ndarray:
    """Return the direction; straight up where there is none."""
    length = _length(v)
    safe = np.where(length > 1e-9, v, [0.0, 0.0, 1.0])
    return safe / np.maximum(_length(safe), 1e-9)
