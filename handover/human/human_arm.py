"""A human arm of seven hinges: poses forward, and all joints that reach a pose.

Joints and signs, alike for both sides; all zero: the arm hangs, the palm faces the
thigh. Shoulder flexion (arm forward, about -y), abduction (arm out to the side),
internal rotation (about the upper arm, forearm to the body's middle); elbow flexion;
pronation; wrist radial deviation (to the thumb), wrist flexion (to the palm). Shoulder
axes meet in the shoulder, wrist axes in the wrist.

Frames: the shoulder frame is the trunk's, x to the front, y to the left, z up the
trunk, in the shoulder's centre. The hand frame is in the grip, the middle of the closed
hand: x out of the palm, z towards the fingers, so y is towards the thumb of a right
hand and away from it of a left one. A left arm is the mirror image of a right one.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from handover.chain import Chain
from handover.human._arm_ik import MAX_SPANS, SPANS, WORK_ROWS
from handover.human._arm_solve import solvable_poses, solve_arm
from handover.human._human_arm import arm_axes, arm_jacobian, arm_pose
from handover.human.anthropometry import ARM_JOINTS, ARM_RANGES
from handover.human.body import SIDES
from roadmap.arrays import as_floats, freeze, frozen
from roadmap.errors import BadInput
from roadmap.ranges import is_between, told
from roadmap.transforms import check_pose, flat_pose, pose_of_flat

STEP = math.radians(15.0)  # [rad] between representatives, unless another is asked for
# [deg] what a range may span, for the closed form to hold
_ROOM_DEG = (
    (-180.0, 360.0),
    (-90.0, 180.0),
    (-180.0, 180.0),
    (0.0, 179.9),
    (-180.0, 180.0),
    (-90.0, 90.0),
    (-180.0, 180.0),
)
# axes of the hinges and the hand's rotation, all joints zero, canonical shoulder frame
_AXES = (
    (0, -1, 0),
    (-1, 0, 0),
    (0, 0, 1),
    (0, -1, 0),
    (0, 0, 1),
    (0, -1, 0),
    (1, 0, 0),
)
_HAND = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
MIRROR = frozen(np.diag([1.0, -1.0, 1.0]), np.float64)


@dataclass(frozen=True, eq=False)
class ArmSolutions:
    """All joints that put the hand at a pose, with all of them inside their ranges.

    With the hand held, only the elbow can move: round the line from shoulder to wrist,
    by the swivel angle. The solutions are exactly those of all swivel angles in the
    closed intervals `spans`; an interval may be a single angle. `q` holds
    representatives: both ends of each interval and evenly spaced ones between.

    Attributes:
        q: (n, 7) joints [rad].
        swivel: (n,) swivel angle of each [rad]; 0 with the elbow straight below the
            line (behind it where the line is upright), growing clockwise seen from the
            shoulder for a right arm, and mirrored for a left one.
        span: (n,) index of the interval each belongs to.
        spans: (k, 2) ends of the intervals [rad], the first in (-pi, pi].
    """

    q: np.ndarray
    swivel: np.ndarray
    span: np.ndarray
    spans: np.ndarray

    def __post_init__(self) -> None:
        freeze(self, q=float, swivel=float, spans=float, span=np.int64)

    def __len__(self) -> int:
        return len(self.q)


@dataclass(frozen=True, eq=False)
class Arm:
    """One arm of a person.

    Attributes:
        side: "left" or "right".
        lengths: (3,) shoulder to elbow, elbow to wrist, wrist to grip [m].
        ranges: (7, 2) lower and upper end of each joint [rad], in the order of
            `handover.human.anthropometry.ARM_JOINTS`.
        packed: The arm as the kernels want it [m]; see `handover/human/_human_arm.py`.
    """

    side: str
    lengths: np.ndarray
    ranges: np.ndarray = field(default_factory=lambda: ARM_RANGES)
    packed: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        check_side(self.side)
        lengths = frozen(self.lengths, np.float64)
        if lengths.shape != (3,) or not (np.isfinite(lengths) & (lengths > 0)).all():
            raise BadInput(
                f"lengths of an arm are {lengths.tolist()}; give three positive "
                "numbers in metres: shoulder to elbow, elbow to wrist, wrist to grip"
            )
        object.__setattr__(self, "lengths", lengths)
        ranges = _checked_ranges(self.ranges)
        object.__setattr__(self, "ranges", ranges)
        packed = packed_arm(lengths, ranges)
        object.__setattr__(self, "packed", frozen(packed, np.float64))

    @property
    def length(self) -> float:
        """Shoulder to grip of the straight arm [m], the unit of reachability maps."""
        return float(self.lengths.sum())

    @property
    def lower(self) -> np.ndarray:
        """(7,) lower ends of the ranges [rad]."""
        return self.ranges[:, 0]

    @property
    def upper(self) -> np.ndarray:
        """(7,) upper ends of the ranges [rad]."""
        return self.ranges[:, 1]

    def fk(self, q: np.ndarray) -> np.ndarray:
        """Return T_shoulder_hand, (4, 4), of the joints q (7,) [rad]."""
        pose = np.empty(12)
        arm_pose(self.packed, check_joints(q), pose)
        return self.mirrored(pose_of_flat(pose))

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return (6, 7): the grip's velocity [m/rad], then spin, shoulder frame."""
        jacobian = np.empty((6, 7))
        arm_jacobian(self.packed, check_joints(q), jacobian)
        if self.side == "left":
            jacobian[1] *= -1.0
            jacobian[[3, 5]] *= -1.0  # a spin is a pseudo-vector
        return jacobian

    def places(self, q: np.ndarray) -> np.ndarray:
        """Return (3, 3) elbow, wrist and grip in the shoulder frame [m]."""
        u, _, v, _, _, h, _ = arm_axes(check_joints(q))
        places = self.lengths[:, None] * np.array((u, v, h))
        places[1] += places[0]
        places[2] += places[1]
        if self.side == "left":
            places[:, 1] *= -1.0
        return places

    def ik(self, T_shoulder_hand: np.ndarray, step: float = STEP) -> ArmSolutions:
        """Return all solutions for a hand pose; none is no error.

        Args:
            T_shoulder_hand: (4, 4) pose of the hand in the shoulder frame [m].
            step: Largest swivel between neighbouring representatives [rad].

        Returns:
            The solutions; poses of their `q` agree to 1e-10 m and rad.

        Raises:
            BadInput: The pose is not rigid or not finite, or the step is not positive.
        """
        T = self.mirrored(check_pose(T_shoulder_hand, "T_shoulder_hand"))
        if not is_between(step, 1e-3, 1e6):
            raise BadInput(
                f"a swivel step of {step} rad is none; give 0.001 rad or more"
            )
        room = 2 * MAX_SPANS + int(2.0 * math.pi / step) + 1
        work, q, at = np.empty((WORK_ROWS, 3)), np.empty((room, 7)), np.empty((room, 2))
        n, k = solve_arm(self.packed, flat_pose(T), float(step), work, q, at)
        spans = work[SPANS : SPANS + k, :2].copy()
        return ArmSolutions(q[:n].copy(), at[:n, 0], at[:n, 1].astype(int), spans)

    def solvable(self, T_shoulder_hand: np.ndarray) -> np.ndarray:
        """Return (n,) bool: whether each of the poses (n, 4, 4) has a solution."""
        poses = np.asarray(T_shoulder_hand, float)
        if poses.ndim != 3 or poses.shape[1:] != (4, 4):
            raise BadInput(f"poses have shape {poses.shape}; give (n, 4, 4)")
        if not np.isfinite(poses).all():
            raise BadInput("poses hold NaN or infinity; give finite numbers")
        flat = flat_pose(self.mirrored(poses))
        answer = np.empty(len(poses), np.bool_)
        work, q = np.empty((WORK_ROWS, 3)), np.empty(7)
        solvable_poses(self.packed, flat, work, q, answer)
        return answer

    def fixed_frames(self) -> np.ndarray:
        """Return the arm as a chain of hinges about their own z axes, (8, 12).

        In the canonical shoulder frame and units of `length`. Row k leads from the
        frame of hinge k - 1 (the first from the shoulder), turned by its joint, to that
        of hinge k; the last row leads to the hand. Each is a rotation (9, by rows) and
        an origin (3).
        """
        upper, fore, grip = self.lengths / self.length
        drops = (0.0, 0.0, 0.0, upper, fore, 0.0, 0.0, grip)
        turns = [_z_along(axis) for axis in _AXES] + [_HAND]
        rows, before = [], np.eye(3)
        for drop, turn in zip(drops, turns, strict=True):
            origin = before.T @ [0.0, 0.0, -drop]
            rows.append(np.concatenate([(before.T @ turn).ravel(), origin]))
            before = turn
        return np.array(rows)

    def chain(self) -> Chain:
        """Return the arm for `build_reach_map`: one map serves people of any size.

        In units of `length` and the canonical shoulder frame, which a left arm mirrors.
        """
        return Chain(
            name="person",
            joint_names=tuple(ARM_JOINTS),
            fixed=self.fixed_frames(),
            kind=np.array([(1, k) for k in range(7)]),
            scale=np.tile([1.0, 0.0], (7, 1)),
            limits=self.ranges,
            endless=np.zeros(7),
            unit="arm length",
            frame="shoulder",
        )

    def mirrored(self, T: np.ndarray) -> np.ndarray:
        """Return poses (..., 4, 4) in the canonical shoulder frame, or back from it.

        A right arm's are the same; a left arm's are mirrored at the plane y = 0.
        """
        if self.side == "right":
            return T
        mirror = np.diag([1.0, -1.0, 1.0, 1.0])
        return mirror @ T @ mirror


def _z_along(axis: tuple[float, ...]) -> np.ndarray:
    """Return a rotation whose z axis is the axis of coordinates `axis`."""
    z = np.asarray(axis, float)
    x = np.array([0.0, 0.0, 1.0]) if z[2] == 0.0 else np.array([1.0, 0.0, 0.0])
    return np.column_stack([x, np.cross(z, x), z])


def packed_arm(lengths: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Return (45,) lengths, ends of the ranges and their sines and cosines."""
    lower, upper = np.asarray(ranges).T
    trig = [np.sin(lower), np.cos(lower), np.sin(upper), np.cos(upper)]
    return np.concatenate([lengths, lower, upper, *trig])


def check_side(side: str) -> str:
    """Return the side, or refuse what is neither "left" nor "right"."""
    if not isinstance(side, str) or side not in SIDES:
        raise BadInput(f"a person has no {told(side)} arm; choose left or right")
    return side


def check_joints(q: np.ndarray) -> np.ndarray:
    """Return q as (7,) float, or refuse another shape, NaN and infinity."""
    # a copy: to numba a frozen array is another type
    q = np.array(as_floats("joints of an arm", q))
    if q.shape != (7,) or not all(map(math.isfinite, q.tolist())):
        raise BadInput(
            f"joints of an arm have shape {q.shape} and values {q.tolist()}; give "
            f"seven finite angles in rad: {', '.join(ARM_JOINTS)}"
        )
    if max(map(abs, q.tolist())) > 4 * math.pi:
        raise BadInput(
            f"joints of an arm are {q.tolist()}, beyond two whole turns; this looks "
            "like degrees, give rad"
        )
    return q


def _checked_ranges(ranges: np.ndarray) -> np.ndarray:
    """Return the ranges, or refuse those whose swivels have no closed form here."""
    ranges = frozen(ranges, np.float64)
    if ranges.shape != (7, 2) or not np.isfinite(ranges).all():
        raise BadInput(f"joint ranges of shape {ranges.shape}: give finite (7, 2) rad")
    rows = zip(ARM_JOINTS, ranges, np.radians(_ROOM_DEG), strict=True)
    for name, (lower, upper), (low, high) in rows:
        if not low - 1e-12 <= lower <= upper <= high + 1e-12:
            raise BadInput(
                f"the range of {name} is {math.degrees(lower):.1f} to "
                f"{math.degrees(upper):.1f} deg; it must rise and lie within "
                f"{math.degrees(low):.1f} to {math.degrees(high):.1f}"
            )
    return ranges
