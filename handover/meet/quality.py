"""How comfortable, visible and safe an arm posture is [Vahrenkamp2016, III-B].

Five costs, eq. (1), (2) and the text below them, become five qualities in [0, 1] by
eq. (3) and one, q_online, by eq. (4). The kernel `handover.meet._quality.quality_of`
does the work for single candidates; here are its settings and what is public.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from handover.human import anthropometry as body
from handover.human.body import ARM_LABELS
from handover.human.human import Human
from handover.human.human_arm import MIRROR, check_joints
from handover.meet import _quality as kernel
from handover.meet.settings import PARTS, QualitySettings
from roadmap.arrays import as_floats, freeze
from roadmap.errors import BadInput
from roadmap.ranges import check_kind, is_real


@dataclass(frozen=True, eq=False)
class ArmState:
    """One arm of a person at one moment, packed for `quality_of`.

    Attributes:
        side: "left" or "right".
        state: (68,) see `handover/meet/_quality.py`.
        obstacles: (m, 7) capsules of the own body and the surroundings [m].
        settings: (19,) packed `QualitySettings`.
    """

    side: str
    state: np.ndarray
    obstacles: np.ndarray
    settings: np.ndarray

    def __post_init__(self) -> None:
        freeze(self, state=float, obstacles=float, settings=float)

    @classmethod
    def of(
        cls,
        human: Human,
        side: str,
        settings: QualitySettings,
        obstacles: np.ndarray | None = None,
    ) -> "ArmState":
        """Pack what does not change between the candidates of one moment.

        The own body is torso, head, legs and the other arm, at mean thickness: the
        conservative radii are for a robot that keeps away.

        Args:
            human: The person; the present joints are those of `human.arms`.
            side: Which arm.
            settings: What counts.
            obstacles: (k, 7) capsules a, b, radius of the surroundings, world frame
                [m]; radius 0 and a = b is a point.

        Raises:
            BadInput: An unknown side, obstacles of a wrong shape or not finite.
        """
        check_kind("human", human, Human, "give a handover.Human")
        check_kind("settings", settings, QualitySettings, "give QualitySettings(...)")
        arm, T = human.arm(side), human.T_world_shoulder(side)
        flip = MIRROR if side == "left" else np.eye(3)
        into = flip @ T[:3, :3].T  # from world directions to the canonical shoulder
        body = _own_body(human, side)
        rods = np.vstack([body, _checked(obstacles)])
        local = rods.copy()
        for at in (slice(0, 3), slice(3, 6)):
            local[:, at] = (rods[:, at] - T[:3, 3]) @ into.T
        gaze, known = human.gaze, 1.0
        if gaze is None:
            gaze = human.T_world_chest[:3, 0]
            known = 1.0 if settings.absent_gaze == "torso" else 0.0
        q, moments = human.arms[side], first_moments(human, side)
        state = np.concatenate(
            [
                arm.packed,
                q,
                flip @ arm.fk(q)[:3, 3],
                into @ (human.p_world_eyes - T[:3, 3]),
                into @ gaze,
                [known],
                moments / moments.sum(),
                into @ [0.0, 0.0, -1.0],
            ]
        )
        return cls(side, state, local, settings.packed())


@dataclass(frozen=True)
class Quality:
    """What one arm posture is worth.

    Attributes:
        parts: Name -> quality in [0, 1]; visibility is NaN where it is left out.
        online: q_online of eq. (4), in [0, 1].
    """

    parts: dict[str, float]
    online: float


def posture_quality(state: ArmState, q: np.ndarray) -> Quality:
    """Return the qualities of the joints q (7,) [rad] for a person as in `state`."""
    check_kind("state", state, ArmState, "give what ArmState.of returns")
    parts = np.empty(5)
    args = state.state, state.obstacles, state.settings, check_joints(q), parts
    online = kernel.quality_of(*args)
    return Quality(dict(zip(PARTS, parts.tolist(), strict=True)), float(online))


def total_quality(
    online: float | np.ndarray, dexterity: float | np.ndarray, settings: QualitySettings
) -> float | np.ndarray:
    """Return q_total: q_online and the offline dexterity by `online_weight`.

    Raises:
        BadInput: Another kind of settings, or what is no number nor an array of some.
    """
    check_kind("settings", settings, QualitySettings, "give QualitySettings(...)")
    if not (is_real(online) and is_real(dexterity)):
        online = as_floats("online", online)
        dexterity = as_floats("dexterity", dexterity)
    share = settings.online_weight
    return share * online + (1.0 - share) * dexterity


def first_moments(human: Human, side: str) -> np.ndarray:
    """Return (3,) first moments of upper arm, forearm and hand of an arm [m].

    Each about its own near joint with all that hangs on it, per kilogram of the body.
    """
    lengths = human.arm(side).lengths
    upper, fore, hand = body.SEGMENT_MASSES.values()
    at_upper, at_fore, at_hand = body.SEGMENT_CENTRES.values()
    length = human.skeleton.hands[0 if side == "left" else 1]
    return np.array(
        [
            lengths[0] * (upper * at_upper + fore + hand),
            lengths[1] * (fore * at_fore + hand),
            length * hand * at_hand,
        ]
    )


def _own_body(human: Human, side: str) -> np.ndarray:
    """Return the capsules of the own body without the arm itself, mean thickness."""
    rods = human.capsules_of("mean")
    return rods[_not_of_arm(human.labels.tobytes(), side)]


@lru_cache(maxsize=8)
def _not_of_arm(labels: bytes, side: str) -> np.ndarray:
    """Return which of the labelled capsules are not of an arm; asked every frame."""
    return ~np.isin(np.frombuffer(labels, np.int64), ARM_LABELS[side])


def _checked(obstacles: Sequence | np.ndarray | None) -> np.ndarray:
    if obstacles is None:
        return np.empty((0, 7))
    obstacles = as_floats("obstacles", obstacles)
    if obstacles.ndim != 2 or obstacles.shape[1] != 7:
        raise BadInput(f"obstacles have shape {obstacles.shape}; give capsules (k, 7)")
    if not np.isfinite(obstacles).all() or (obstacles[:, 6] < 0).any():
        raise BadInput(
            "obstacles hold NaN, infinity or a negative radius; give capsules a, b, "
            "radius in metres"
        )
    return obstacles
