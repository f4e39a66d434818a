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

import numpy as np

from roadmap.arrays import writable
from roadmap.kinematics import _forward as kernels
from roadmap.kinematics.axis_reach import joint_span, point_reach
from roadmap.kinematics.forward import difference
from roadmap.kinematics.joint_tree import REVOLUTE
from roadmap.kinematics.tool_chain import ToolDescent
from roadmap.robot.robot import Robot

SAMPLES = 4  # parts of a leg between which the deviation is bounded
_PARTS = np.linspace(0.0, 1.0, SAMPLES + 1)[:, None]
_STEPS = 60  # of one descent
GOAL = 2e-7  # [m or rad] what a descent aims at
_NEAR = 1e-5  # [m or rad] what counts as reached
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

    def poses(self, s: np.ndarray) -> np.ndarray:
        """Return the poses at shares s (k,) of the line as rows (k, 12)."""
        s = np.atleast_1d(s)
        rows = np.empty((len(s), 12))
        start, end = self.T_from, self.T_to
        rows[:, 9:] = start[:3, 3] + s[:, None] * (end[:3, 3] - start[:3, 3])
        if self.angle == 0.0:
            rows[:, :9] = end[:3, :3].ravel()
            return rows
        from scipy.spatial.transform import Rotation

        turned = Rotation.from_rotvec(s[:, None] * self.turn).as_matrix()
        rows[:, :9] = (turned @ start[:3, :3]).reshape(-1, 9)
        return rows


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
        self._reach = point_reach(robot.tree_i, robot.tree_f, span, body, tip)
        self._reach.setflags(write=False)
        self._turns, chain = np.zeros(robot.dof), self._descent.chain
        for (kind, j), (factor, _) in zip(chain.kind, chain.scale, strict=True):
            self._turns[self._descent.rows[j]] += abs(factor) * (kind == REVOLUTE)
        n = len(robot.tree_i)
        self._frames, self._rates = np.empty((n, 12)), np.empty((2, n))
        self._first, self._second = np.empty(1), np.empty(1)
        self.descents = 0

    def tools(self, qs: np.ndarray) -> np.ndarray:
        """Return the tool's poses at qs (k, dof), rows (k, 12)."""
        robot, rows, qs = self.robot, np.empty((len(qs), 12)), writable(qs)
        for k in range(len(qs)):
            kernels.body_frames(robot.tree_i, robot.tree_f, qs[k], self._frames)
            rows[k] = self._frames[robot.tip_body]
        R = rows[:, :9].reshape(-1, 3, 3)
        result = np.empty_like(rows)
        result[:, :9] = (R @ self.robot.T_body_tip[:3, :3]).reshape(-1, 9)
        result[:, 9:] = R @ self.robot.T_body_tip[:3, 3] + rows[:, 9:]
        return result

    def manipulability(self, q: np.ndarray) -> float:
        """Return sqrt(det(J J^T)) of the tool at q [Yoshikawa1985]; 0 where singular.

        For fewer than six joints: of J^T J.
        """
        J = self._descent.jacobian(q)
        square = J @ J.T if self.robot.dof >= 6 else J.T @ J
        return math.sqrt(max(0.0, float(np.linalg.det(square))))

    def reach(self, pose: np.ndarray, q: np.ndarray) -> tuple[bool, float, float]:
        """Bring `q` in place to a pose (12,); return (reached, [m], [rad])."""
        self.descents += 1
        np.clip(q, self.limits[:, 0], self.limits[:, 1], out=q)
        errors = self._descent.run(pose, q)
        return max(errors) <= _NEAR, *errors

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
        robot = self.robot
        dq = difference(robot, q_a, q_b)
        rows = self.tools(q_a + _PARTS * dq)
        rows -= line.poses(s_a + _PARTS[:, 0] * (s_b - s_a))
        kernels.motion_bounds(
            robot.tree_i,
            robot.tree_f,
            self._reach,
            dq,
            self._rates,
            self._first,
            self._second,
        )
        share = 1.0 / (8 * SAMPLES**2)
        squares = rows * rows
        off = math.sqrt(squares[:, 9:].sum(axis=1).max())
        turned = math.sqrt(squares[:, :9].sum(axis=1).max())
        w = float(self._turns @ np.abs(dq))
        turn = abs(s_b - s_a) * line.angle
        turned += share * (math.sqrt(3.0) * 1.5 * w * w + math.sqrt(2.0) * turn * turn)
        angle = 2.0 * math.asin(min(1.0, turned / math.sqrt(8.0)))
        return off + share * float(self._second[0]), angle


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
        near = np.argpartition(gaps, min(n, len(gaps)) - 1)[:n]
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


def follow(
    tool: ToolKinematics,
    line: Line,
    q: np.ndarray,
    s_from: float,
    s_to: float,
    step_m: float,
    limits: tuple[float, float],
) -> Follow:
    """Follow the line from share s_from, where q has the tool, to s_to.

    Args:
        tool: Kinematics.
        line: The line.
        q: (dof,) start.
        s_from: Share of the line, 0 to 1, where q is.
        s_to: Share at the other end.
        step_m: Largest leg to begin with [m]; 0.3 rad of turn count as 0.1 m.
        limits: Largest deviation of the tool from the line [m], [rad]; a leg that has
            more is halved up to four times, then the path stops.
    """
    parts = abs(s_to - s_from) * max(line.length, line.angle / 3.0) / step_m
    n = max(1, int(np.ceil(parts - 1e-9)))
    goals = list(s_from + (s_to - s_from) * np.arange(n, 0, -1) / n)
    smallest = abs(s_to - s_from) / n / 16.0
    qs, ss, worst = [q.copy()], [s_from], [0.0, 0.0]
    ahead = np.zeros_like(q)  # joint change per share, of the last leg
    fits = 2.0  # share of the line; what was halved is not tried at full length again
    while goals:
        while abs(goals[-1] - ss[-1]) > 1.5 * fits:
            goals.append(0.5 * (goals[-1] + ss[-1]))
        s = goals[-1]
        new = qs[-1] + ahead * (s - ss[-1])
        reached, off, turned = tool.reach(line.poses(s)[0], new)
        error = (np.inf, np.inf)
        if reached:
            error = tool.leg_error(line, ss[-1], s, qs[-1], new)
        if error[0] > limits[0] or error[1] > limits[1]:
            if abs(s - ss[-1]) > smallest * 1.5:
                fits = 0.5 * abs(s - ss[-1])
                continue
            stopped = _stop(tool, line, ss[-1], new, reached, off, turned)
            return Follow(np.array(qs), np.array(ss), *worst, stopped)
        worst = [max(w, e) for w, e in zip(worst, error, strict=True)]
        ahead = difference(tool.robot, qs[-1], new) / (s - ss[-1])
        qs.append(new)
        ss.append(s)
        goals.pop()
    return Follow(np.array(qs), np.array(ss), *worst)


def _stop(tool, line, s_last, q, reached, off, turned) -> str:
    place = f"{100 * (1.0 - s_last) * line.length:.1f} cm before its end"
    if reached:
        return (
            f"the arm would have to change its posture {place}; move the pose, or "
            "start from another configuration"
        )
    joints = tool.at_limits(q)
    why = f"{' and '.join(joints)} at the limit" if joints else "the arm is stretched"
    return (
        f"the arm cannot follow the line {place}: {why}, "
        f"{1e3 * off:.1f} mm and {np.degrees(turned):.1f} deg are left; make the "
        "motion shorter, or move the pose"
    )
