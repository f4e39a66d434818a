"""Joint paths that keep the tool on a straight line, with a proved deviation.

A leg is straight in joint space, so the tool leaves the line between its ends. At n + 1
samples of the leg the tool's pose is computed; between two of them the error e(t), the
tool's position minus the line's, bends by |e''| <= `bend` (the close test's bound of
motion, `motion_bounds`), so that it is at most the larger of the two plus
bend / (8 n^2). The same holds for the rotation matrices: with W the sum of the joint
displacements that turn the tool, a column moves by |u''| <= 3/2 W^2.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from odm.approach import _tool_line as kernels
from odm.approach._tool_line import LineRows
from roadmap.arrays import writable
from roadmap.kinematics.axis_reach import joint_span, point_reach
from roadmap.kinematics.joint_tree import REVOLUTE
from roadmap.kinematics.tool_chain import ToolDescent
from roadmap.robot.robot import Robot
from roadmap.transforms import flat_pose

_SAMPLED = 16  # every so-manieth pose tells how near the nearest may be
# of one leg that is asked for come at most so many: what must fit is longer than
# 0.75 / 16 of it, and what is halved to fit is longer than 0.75 of that
_LEGS = 32
_WAITING = 16  # shares that halving adds at most
_STEPS = 60  # of one descent
GOAL = 2e-7  # [m or rad] what a descent aims at
LENGTH = 0.3  # [m] that one radian counts as where poses are compared


@dataclass(frozen=True, eq=False)
class Line:
    """A straight tool motion: position and rotation at constant rates.

    Attributes:
        T_from, T_to: (4, 4) poses of the tool in the base frame [m].
        turn: (3,) rotation vector from the one to the other, base frame [rad].
        length: Distance that the tool moves [m].
        angle: Turn of the tool [rad].
    """

    T_from: np.ndarray
    T_to: np.ndarray
    turn: np.ndarray
    length: float
    angle: float

    @classmethod
    def between(cls, T_from: np.ndarray, T_to: np.ndarray) -> "Line":
        """Return the line from one pose to another, turning the short way."""
        from scipy.spatial.transform import Rotation

        R = T_to[:3, :3] @ T_from[:3, :3].T
        angle = np.arccos(np.clip(0.5 * (np.trace(R) - 1.0), -1.0, 1.0))
        turn = np.zeros(3) if angle < 1e-7 else Rotation.from_matrix(R).as_rotvec()
        length = float(np.linalg.norm(T_to[:3, 3] - T_from[:3, 3]))
        return cls(T_from, T_to, turn, length, float(np.linalg.norm(turn)))

    @cached_property
    def rows(self) -> LineRows:
        """The line as compiled loops take it."""
        return LineRows(flat_pose(self.T_from), flat_pose(self.T_to), self.turn)

    def pose(self, s: float) -> np.ndarray:
        """Return the pose at share s of the line as a row (12,)."""
        row = np.empty(12)
        kernels.line_pose(self.rows, float(s), row)
        return row


class ToolKinematics:
    """Descents and bounds for one robot's tool, in memory of its own."""

    def __init__(self, robot: Robot) -> None:
        """Bound what each joint can do to the tool."""
        self.robot = robot
        self._descent = ToolDescent(robot, GOAL, GOAL, _STEPS)
        limits = np.stack([robot.lower, robot.upper], axis=1)
        limits[robot.continuous] = -np.inf, np.inf
        self.limits = limits
        span = joint_span(robot.tree_i, robot.tree_f, robot.lower, robot.upper)
        tip = robot.T_body_tip[None, :3, 3]
        body = np.array([robot.tip_body], np.int32)
        reach = point_reach(robot.tree_i, robot.tree_f, span, body, tip)
        turns, chain = np.zeros(robot.dof), self._descent.chain
        for (kind, j), (factor, _) in zip(chain.kind, chain.scale, strict=True):
            turns[self._descent.rows[j]] += abs(factor) * (kind == REVOLUTE)
        n, descent = len(robot.tree_i), self._descent
        self._tool = kernels.Tool(
            descent.chain, np.array(descent.rows), limits, robot.continuous,
            robot.tree_i, robot.tree_f, reach, turns, descent.scale, descent.goal,
            descent.work, descent.trial, np.empty((2, n)), np.empty(1), np.empty(1),
            np.empty(12), np.empty(robot.dof), np.empty(robot.dof),
        )  # fmt: skip
        self._left = np.empty(2)
        self.descents = 0

    def tools(self, qs: np.ndarray) -> np.ndarray:
        """Return the tool's poses at qs (k, dof), rows (k, 12)."""
        rows, qs = np.empty((len(qs), 12)), writable(qs)
        kernels.tool_poses(self._tool, qs, rows)
        return rows

    def manipulability(self, q: np.ndarray) -> float:
        """Return sqrt(det(J J^T)) of the tool at q [Yoshikawa1985]; 0 where singular.

        For fewer than six joints: of J^T J.
        """
        if len(self._descent.rows) >= 6:
            return kernels.manipulability(self._tool, q)
        J = self._descent.jacobian(q)
        square = J.T @ J
        return math.sqrt(max(0.0, float(np.linalg.det(square))))

    def reach(self, pose: np.ndarray, q: np.ndarray) -> tuple[bool, float, float]:
        """Bring `q` in place to a pose (12,); return (reached, [m], [rad])."""
        self.descents += 1
        reached = kernels.reach_pose(self._tool, pose, q, self._left)
        return reached, *self._left.tolist()

    def at_limits(self, q: np.ndarray) -> list[str]:
        """Return the joints that stand at a limit."""
        edge = np.minimum(q - self.limits[:, 0], self.limits[:, 1] - q) < 1e-6
        return [self.robot.joint_names[j] for j in np.flatnonzero(edge)]

    def leg_error(
        self, line: Line, s_a: float, s_b: float, q_a: np.ndarray, q_b: np.ndarray
    ) -> tuple[float, float]:
        """Bound how far the tool gets from the line on the straight joint motion.

        Args:
            line: The tool's line.
            s_a: Share of it where the leg begins.
            s_b: The same where it ends.
            q_a: (dof,) where the leg begins [rad or m].
            q_b: (dof,) where it ends [rad or m].

        Returns:
            Largest distance [m] and angle [rad] between the tool and the line's pose
            at the same share of the leg: proved, not sampled.
        """
        return kernels.leg_error(self._tool, line.rows, s_a, s_b, q_a, q_b)

    def follow(
        self,
        line: Line,
        q: np.ndarray,
        shares: tuple[float, float],
        step_m: float,
        limits: tuple[float, float],
    ) -> "Follow":
        """Follow a line.

        Args:
            line: The line.
            q: (dof,) start, which has the tool at the first share [rad or m].
            shares: Shares of the line, 0 to 1: where q is, and at the other end.
            step_m: Largest leg to begin with [m]; 0.3 rad of turn count as 0.1 m.
            limits: Largest deviation of the tool from the line [m], [rad]; a leg that
                has more is halved up to four times, then the path stops.
        """
        s_from, s_to = shares
        parts = abs(s_to - s_from) * max(line.length, line.angle / 3.0) / step_m
        n = max(1, int(np.ceil(parts - 1e-9)))
        room = _LEGS * n + 2
        found = kernels.Followed(
            np.empty((room, len(q))), np.empty(room), np.empty(n + _WAITING),
            np.empty(2), np.empty(2), np.zeros(1, np.int64),
        )  # fmt: skip
        found.q[0] = q
        asked = kernels.Asked(float(s_from), float(s_to), n, *map(float, limits))
        count = kernels.follow(self._tool, line.rows, asked, found)
        self.descents += int(found.tried[0])
        corners, stopped = abs(count), ""
        if count < 0:
            stopped = self._stop(line, found, corners)
        qs, s = found.q[:corners].copy(), found.s[:corners].copy()
        return Follow(qs, s, *found.worst.tolist(), stopped)

    def _stop(self, line: Line, found: kernels.Followed, corners: int) -> str:
        """Say why a line is left behind its last corner."""
        left = (1.0 - found.s[corners - 1]) * line.length
        place = f"{100 * left:.1f} cm before its end"
        off, turned = found.left.tolist()
        if max(off, turned) <= kernels.NEAR:
            return (
                f"the arm would have to change its posture {place}; move the pose, or "
                "start from another configuration"
            )
        joints = self.at_limits(found.q[corners])
        why = (
            f"{' and '.join(joints)} at the limit" if joints else "the arm is stretched"
        )
        return (
            f"the arm cannot follow the line {place}: {why}, "
            f"{1e3 * off:.1f} mm and {np.degrees(turned):.1f} deg are left; make the "
            "motion shorter, or move the pose"
        )


class NearPoses:
    """Ranks poses by nearness: squared metres, 0.3 m per radian (for small angles).

    The squared Frobenius norm of two rotations' difference is 2 angle^2 for small
    angles and grows with the angle up to half a turn.
    """

    def __init__(self, rows: np.ndarray) -> None:
        weights = np.array([0.5 * LENGTH**2] * 9 + [1.0] * 3)
        self._squares = (rows * rows) @ weights
        self._weighted = rows * (-2.0 * weights)

    def nearest(self, pose: np.ndarray, n: int) -> np.ndarray:
        """Return the indices of the n poses nearest to one (12,), nearest first."""
        gaps = self._squares + self._weighted @ pose
        near, n = np.arange(len(gaps)), min(n, len(gaps))
        some = gaps[::_SAMPLED]
        guess = 2 * n // _SAMPLED + 8  # twice as many as are asked for, and some more
        if guess < len(some):
            below = np.flatnonzero(gaps <= np.partition(some, guess)[guess])
            near = below if len(below) >= n else near  # else all are looked at
        near = near[np.argpartition(gaps[near], n - 1)[:n]]
        return near[np.lexsort((near, gaps[near]))]


@dataclass(frozen=True, eq=False)
class Follow:
    """A joint path along a line, or how far it came.

    Attributes:
        q: (k, dof) corners [rad or m].
        s: (k,) share of the line at each.
        error_m, error_rad: Largest deviation of the tool, proved.
        stopped: One sentence where the path does not reach the other end.
    """

    q: np.ndarray
    s: np.ndarray
    error_m: float
    error_rad: float
    stopped: str = ""
