"""Goals by tool pose: inverse kinematics, what is valid of it, ranked, and why not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from odm.approach.tool_line import GOAL, LENGTH, NearPoses, ToolKinematics
from odm.checks import MAX_GOALS
from odm.frame.frame import Frame
from odm.frame.freedom import check_valid
from odm.obstacles.grid import bounding_ball
from odm.planner.settings import PoseSettings
from roadmap.arrays import frozen
from roadmap.errors import BadConfiguration, BadInput
from roadmap.kinematics.forward import difference, turns, wrapped
from roadmap.kinematics.tool_chain import ToolDescent
from roadmap.ranges import check_number, is_between
from roadmap.transforms import check_pose

TOLERANCE = (0.001, 0.01)  # [m], [rad] where none is given
_LARGEST = (0.5, np.pi)
_MORE = 8  # times as many seeds where a pose is reached, but by nothing that is free


@dataclass(frozen=True, eq=False)
class Refused:
    """A goal, or a solution of a pose, that cannot be taken.

    Attributes:
        index: Of the goal, or of the pose, as they were given.
        reason: One sentence.
        q: (dof,) the configuration; None where a pose has no solution at all.
    """

    index: int
    reason: str
    q: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class GoalReport:
    """What became of the goals, or poses, that were given.

    Attributes:
        goals: (g, dof) the goals that are set, best first; `answer.goal` counts these.
        index: (g,) which of the given goals, or poses, each of them is.
        solutions: (k, dof) all valid configurations, best first; more than `goals`
            where a pose has many.
        solution_index: (k,) their poses.
        refused: What was not taken, and why.
    """

    goals: np.ndarray
    index: np.ndarray
    solutions: np.ndarray
    solution_index: np.ndarray
    refused: tuple[Refused, ...] = ()

    def __repr__(self) -> str:
        text = f"GoalReport({len(self.goals)} goals set"
        if self.refused:
            first = self.refused[0]
            text += f", {len(self.refused)} refused; {first.index}: {first.reason}"
        return text + ")"


class PoseGoals:
    """Turns tool poses into goals.

    Descents start from the roadmap nodes whose tools are nearest to the pose: such a
    node keeps clear of the robot itself and of the recipe's scenery, and a solution a
    few steps away mostly does, too. Where the frame's obstacles are known, solutions
    that stand clear of them come first; then those with the least way from the robot.
    """

    def __init__(self, frame: Frame, settings: PoseSettings = PoseSettings()) -> None:
        """Compute where the tool is at every node: milliseconds, once."""
        self.settings = settings
        self._frame, self._robot = frame, frame.robot
        self._nodes = np.asarray(frame.cell_map.roadmap.nodes)
        self._tool = ToolKinematics(frame.robot)
        self._quick = ToolDescent(frame.robot, GOAL, GOAL, self.settings.steps)
        self._near = NearPoses(self._tool.tools(self._nodes))
        self._turns = turns(frame.robot)

    def solve(
        self, poses: Sequence[np.ndarray], tolerance: object, most: int | None
    ) -> GoalReport:
        """Return valid configurations for poses; see `ReactivePlanner.set_goals`."""
        tolerance = _checked_tolerance(tolerance)
        if most is not None:
            most = int(check_number("most", most, 1, MAX_GOALS, whole=True))
        rows = _checked_poses(poses)
        world, refused = self._frame.world, []
        found: list[tuple[tuple, int, np.ndarray]] = []
        for k, T in enumerate(rows):
            T_base = np.asarray(world.pose(T))
            qs, why = self._solutions(T_base, tolerance)
            if why is not None:
                refused.append(Refused(k, why))
            free = self._free(qs)
            if len(qs) and not free.any():  # it is reached, and another may be free
                qs, _ = self._solutions(T_base, tolerance, _MORE)
                free = self._free(qs)
            ranks = iter(self._ranks(qs[free]))
            for q, is_free in zip(qs, free.tolist(), strict=True):
                if is_free:
                    found.append((next(ranks), k, q))
                else:
                    refused.append(self._refused(k, q))
        if not found:
            first = refused[0]
            raise BadConfiguration(
                f"none of {len(rows)} poses can be a goal; pose {first.index}: "
                f"{first.reason}"
            )
        found.sort(key=lambda one: (one[0], one[1], one[2].tobytes()))
        qs = np.array([q for *_, q in found])
        index = np.array([k for _, k, _ in found])
        # the best solution of each pose first, then what is best of the rest
        first = np.unique(index, return_index=True)[1]
        order = np.argsort(~np.isin(np.arange(len(qs)), first), kind="stable")
        order = order[: min(MAX_GOALS, most or len(rows))]
        chosen = np.sort(order)
        return GoalReport(
            frozen(qs[chosen], np.float64),
            frozen(index[chosen], np.int64),
            frozen(qs, np.float64),
            frozen(index, np.int64),
            tuple(refused),
        )

    def _solutions(
        self, T: np.ndarray, tolerance: tuple[float, float], times: int = 1
    ) -> tuple[np.ndarray, str | None]:
        """Return distinct (k, dof) within limits that reach a pose; or why not.

        From so many times the seeds of the settings, and as many times `enough`.
        """
        pose = np.concatenate([T[:3, :3].ravel(), T[:3, 3]])
        seeds, enough = times * self.settings.seeds, times * self.settings.max_solutions
        near = self._near.nearest(pose, min(seeds, len(self._nodes)))
        kept, n = np.empty((enough, self._robot.dof)), 0
        best, at = (np.inf, np.inf), self._nodes[near[0]]
        starts = self._nodes[near]
        if np.isfinite(self._frame.q).all():
            starts = np.vstack([self._frame.q, starts])
        # from there once more, if all were too short
        long = list(starts[: self.settings.long_descents])
        for k, start in enumerate([*starts, *long]):
            if n == enough or (n and k >= len(starts)):
                break
            q = np.array(start)
            if k < len(starts):
                off, turned = self._quick.run(pose, q)
            else:
                _, off, turned = self._tool.reach(pose, q)
            if off <= tolerance[0] and turned <= tolerance[1]:
                q = wrapped(self._robot, q)
                if self._is_inside(q) and not self._is_known(q, kept[:n]):
                    kept[n] = q
                    n += 1
            elif off + LENGTH * turned < sum(best):
                best, at = (off, LENGTH * turned), q
        return kept[:n], None if n else self._why(T, best, at)

    def _is_inside(self, q: np.ndarray) -> bool:
        robot = self._robot
        inside = (robot.lower <= q) & (q <= robot.upper)
        return bool((inside | robot.continuous).all())

    def _is_known(self, q: np.ndarray, others: np.ndarray) -> bool:
        """Return whether one of `others` (k, dof) is the same solution as q."""
        off = difference(self._robot, q, others) if self._turns else others - q
        return bool((np.abs(off).max(axis=1) < self.settings.same_within).any())

    def _why(self, T: np.ndarray, best: tuple[float, float], q: np.ndarray) -> str:
        """Say why a pose has no solution."""
        off, turned = best[0], best[1] / LENGTH
        middle, reach = bounding_ball(self._robot)
        far = float(np.linalg.norm(T[:3, 3] - middle))
        if far > reach:
            return (
                f"it lies {far:.2f} m from the robot, beyond the reach of {reach:.2f} "
                "m; move it nearer"
            )
        joints = self._tool.at_limits(q)
        why = f" ({' and '.join(joints)} at the limit)" if joints else ""
        return (
            f"the tool comes no nearer than {100 * off:.1f} cm and "
            f"{np.degrees(turned):.0f} deg{why}; move or turn it, or allow a larger "
            "tolerance"
        )

    def _free(self, qs: np.ndarray) -> np.ndarray:
        if not len(qs):
            return np.zeros(0, np.bool_)
        return self._frame.static.motions_free(qs, np.zeros_like(qs))

    def _refused(self, k: int, q: np.ndarray) -> Refused:
        try:
            check_valid(self._frame.static, q, "it")
        except BadConfiguration as error:
            return Refused(k, str(error), frozen(q, np.float64))
        return Refused(k, "it is not free, by less than can be told", q)

    def _ranks(self, qs: np.ndarray) -> list[tuple[bool, float]]:
        """Return whether the frame blocks each of qs (k, dof), and the way to it."""
        frame = self._frame
        known = frame.number > 0 and frame.trouble is None
        still = np.zeros(self._robot.dof)
        here = frame.q if np.isfinite(frame.q).all() else still
        off = difference(self._robot, here, qs) * frame.cell_map.roadmap.weights
        blocked = [known and not frame.motion_clear(q, still) for q in qs]
        return list(zip(blocked, np.linalg.norm(off, axis=1).tolist(), strict=True))


def _checked_tolerance(tolerance: object) -> tuple[float, float]:
    if tolerance is None:
        return TOLERANCE
    both = tolerance if isinstance(tolerance, tuple | list) else (tolerance, None)
    if len(both) == 2:
        position, turn = both
        turn = 10.0 * position if turn is None and is_between(position, 0, 1) else turn
        values = (position, turn)
        fits = zip(values, _LARGEST, strict=True)
        if all(is_between(v, 1e-5, most) for v, most in fits):
            return float(position), float(turn)  # type: ignore[arg-type]
    raise BadInput(
        f"tolerance is {tolerance!r}; give (position in m, angle in rad), from 0.00001 "
        f"to {_LARGEST[0]:g} and {_LARGEST[1]:.3g}, or a position alone"
    )


def _checked_poses(poses: Sequence[np.ndarray]) -> list[np.ndarray]:
    wanted = f"give 1 to {MAX_GOALS} poses (4, 4) of the tool in the world"
    try:
        rows = list(poses)
    except TypeError as error:
        raise BadInput(f"poses are a {type(poses).__name__}; {wanted}") from error
    if not rows:
        raise BadConfiguration(f"no poses were given; {wanted}")
    if len(rows) > MAX_GOALS:
        raise BadInput(f"{len(rows)} poses were given; {wanted}")
    if isinstance(poses, np.ndarray) and poses.ndim == 2:
        raise BadInput(f"poses have shape {poses.shape}; {wanted}, as a list")
    return [check_pose(T, f"pose {k}") for k, T in enumerate(rows)]
