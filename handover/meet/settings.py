"""What a hand-over is asked for: comfort, grid and search, as frozen settings."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from numbers import Integral

import numpy as np

from handover.human.human_arm import check_side
from handover.meet import _quality as kernel
from handover.meet.constraints import Constraint
from handover.reach.rotations import SIZES
from roadmap.arrays import as_floats, frozen
from roadmap.errors import BadInput
from roadmap.ranges import CheckedSettings, check_kind, setting, told
from roadmap.transforms import check_pose

PARTS = ("joint", "spatial", "visibility", "safety", "effort")
_HALF = math.atanh(0.5)  # 1 - tanh of it is one half


@dataclass(frozen=True)
class QualitySettings(CheckedSettings):
    """What counts as comfortable, and how much.

    The paper gives the form of the costs and equal weights, not its betas. Ours are
    chosen so that each quality is one half at a cost that is easy to picture:
    beta = 0.549 / that cost. None is fitted to a recording.

    Attributes:
        joint_weights: alpha of eq. (1), one for each joint. All 1: we know no source
            that rates one joint's travel above another's.
        beta_joint: [1/rad^2] Half at 2.2 rad^2: a hanging arm that lifts shoulder and
            elbow by 60 degrees each.
        beta_spatial: [1/m] Half at 0.5 m: a reach from the side to the front.
        beta_visibility: [1/rad] Half at 45 degrees off the gaze, about where the eyes
            no longer turn alone and the head must.
        beta_safety: Half at a cost of 1, which is half of `safety_distance`.
        beta_effort: Half at 1, the shoulder torque of an arm held straight out.
        weights: omega of eq. (4), in the order of `PARTS`; not negative, sum 1. The
            paper's: 1/5 each.
        safety_distance: Distance between grip and obstacle or own body beyond which
            the cost is zero [m]. 0.2: two breadths of a hand, so that a grip before
            the chest is not ideal and one at arm's length is.
        forearm_counts: Whether the forearm's and hand's axis inside an obstacle or the
            own body makes the cost infinite, too. True: a posture through one's own
            chest is none. The paper's text speaks of the grip alone.
        absent_gaze: "torso": a person whose gaze is not known looks to the front of
            the chest; "omit": visibility is left out and the other weights are raised
            to sum to 1. The paper allows both; "torso" keeps people with and without
            a known gaze comparable.
        online_weight: Share of q_online in q_total, the rest is the arm's local
            dexterity (paper: "a weighted sum"). 5/6: dexterity counts as much as each
            of the five qualities of q_online (docs/decisions/0027).
    """

    joint_weights: tuple[float, ...] = (1.0,) * 7
    beta_joint: float = setting(_HALF / 2.2, 1e-9, 1e9)
    beta_spatial: float = setting(_HALF / 0.5, 1e-9, 1e9)
    beta_visibility: float = setting(_HALF / math.radians(45.0), 1e-9, 1e9)
    beta_safety: float = setting(_HALF, 1e-9, 1e9)
    beta_effort: float = setting(_HALF, 1e-9, 1e9)
    weights: tuple[float, ...] = (0.2,) * 5
    safety_distance: float = setting(0.2, 1e-9, 9.99, "m")
    forearm_counts: bool = True
    absent_gaze: str = "torso"
    online_weight: float = setting(5.0 / 6.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        alpha = as_floats("joint_weights", self.joint_weights)
        if alpha.shape != (7,) or not (np.isfinite(alpha) & (alpha >= 0)).all():
            raise BadInput(
                f"joint_weights are {self.joint_weights}; give seven that are not "
                "negative"
            )
        weights = as_floats("weights", self.weights)
        if weights.shape != (5,) or not (weights >= 0).all():
            raise BadInput(
                f"weights are {self.weights}; give five that are not negative, for "
                f"{', '.join(PARTS)}"
            )
        if abs(weights.sum() - 1.0) > 1e-9:
            raise BadInput(
                f"weights {self.weights} sum to {weights.sum():.6g}; they must sum to "
                "1: divide each by their sum"
            )
        gaze = self.absent_gaze
        if not isinstance(gaze, str) or gaze not in ("torso", "omit"):
            raise BadInput(
                f"no way {told(gaze)} to do without a gaze; choose torso or omit"
            )
        if self.absent_gaze == "omit" and weights[kernel.VISIBILITY] > 1.0 - 1e-9:
            raise BadInput(
                "all weight is on visibility, which is omitted without a gaze; choose "
                "absent_gaze torso or other weights"
            )

    @property
    def betas(self) -> tuple[float, ...]:
        """The five betas in the order of `PARTS`."""
        return tuple(getattr(self, f"beta_{part}") for part in PARTS)

    def packed(self) -> np.ndarray:
        """Return the settings as the kernel wants them, (19,)."""
        tail = [self.safety_distance, float(self.forearm_counts)]
        return np.array([*self.joint_weights, *self.betas, *self.weights, *tail], float)


@dataclass(frozen=True)
class FindSettings(CheckedSettings):
    """How hard a configuration for a target is looked for (`find.find_handover`).

    Attributes:
        position_tolerance: Largest distance of the tool from the target [m].
        rotation_tolerance: Largest angle between them [rad].
        attempts: Starts of the inverse kinematics: the reach map's witness, the middle
            of the limits, random ones. More: fewer targets are given up, each later.
        steps: Steps of each.
        batch: Targets asked for at a time.
    """

    position_tolerance: float = setting(1e-4, 1e-9, 1.0, "m")
    rotation_tolerance: float = setting(1e-3, 1e-9, np.pi, "rad")
    attempts: int = setting(5, 1, 10_000)
    steps: int = setting(60, 1, 10_000)
    batch: int = setting(10, 1, 10_000)


@dataclass(frozen=True, eq=False)
class MeetSettings(CheckedSettings):
    """Where, how finely and for what to look.

    Attributes:
        side: The person's arm, "right" or "left".
        T_world_base: (4, 4) pose of the robot's base [m]; None: it is the world's.
        cell: Side of a position cell [m]; not finer than the reach map's.
        rotations: Rotation cells: 72 (60 deg apart), 576 (30 deg)...; not more than
            the reach map has.
        marked_share: A cell of this grid holds many of the reach map's. It counts as
            reachable when more than this share of them is marked. 0: any of them, as
            in a map built on the coarse grid itself, like the paper's; 0.5: most, so
            that the robot fails less often at the centre.
        quality: What is comfortable, `online_weight` too.
        swivel_step: Largest swivel between the representatives of one hand pose [rad].
            30 degrees: the best of those was 0.0004 below that of 5 degrees in the
            mean, 0.015 at most.
        constraints: Predicates on T_world_object, see `handover.meet.constraints`.
        obstacles: (k, 7) capsules of the surroundings, world frame [m], for the
            person's safety; None: none.
    """

    side: str = "right"
    T_world_base: np.ndarray | None = None
    cell: float = setting(0.15, 0.01, 1.0, "m")
    rotations: int = 72
    marked_share: float = setting(0.0, 0.0, 1.0)
    quality: QualitySettings = field(default_factory=QualitySettings)
    swivel_step: float = setting(math.radians(30.0), math.radians(1.0), math.pi, "rad")
    constraints: Sequence[Constraint] = ()
    obstacles: np.ndarray | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_side(self.side)
        T = np.eye(4) if self.T_world_base is None else self.T_world_base
        T = frozen(check_pose(T, "T_world_base"), np.float64)
        object.__setattr__(self, "T_world_base", T)
        if not isinstance(self.rotations, Integral) or self.rotations not in SIZES:
            known = ", ".join(map(str, SIZES))
            raise BadInput(
                f"no grid has {told(self.rotations)} rotations; choose one of {known}"
            )
        if self.marked_share == 1.0:
            raise BadInput(
                f"marked_share is {self.marked_share}; give a share from 0 (any cell) "
                "to below 1"
            )
        several = "give a list of them, such as [Above(0.75)]"
        check_kind("constraints", self.constraints, Iterable, several)
        object.__setattr__(self, "constraints", tuple(self.constraints))
        for c in self.constraints:
            if not callable(getattr(c, "allows", None)):
                raise BadInput(
                    f"{c!r} is no constraint; give objects with "
                    "allows(T_world_object, obj), like Upright, Above, Inside"
                )
