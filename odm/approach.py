"""The last centimetres: a straight tool motion to a pose, proved by the close test.

A candidate is a configuration that has the tool at the pose; the line is followed
from it back to where the approach begins (`odm.tool_line`). Every leg must pass what
`is_free` asks: limits, self-collision, scenery and the frame's points, with the bound
of motion over its whole length. Where the map's cover says no, the finer cover of
`odm.fine_cover` decides. Work is counted, not timed: the same input gives the same
bytes.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from odm._kernels import close
from odm._kernels.types import Work
from odm.answer import Freedom
from odm.checks import check_configuration, outside_limits
from odm.clouds import SortedCloud
from odm.explain import link_of
from odm.fine_cover import FineTest
from odm.grid import WorkspaceGrid
from odm.static import StaticTest
from odm.tool_line import Follow, Line, ToolKinematics, follow, pose_gaps
from roadmap.errors import BadInput
from roadmap.ik import checked_pose
from roadmap.kinematics import difference, tool_pose

if TYPE_CHECKING:
    from odm.planner import ReactivePlanner

_SAME = 0.1  # [rad or m] solutions nearer than this count as one
_CLASS = 0.01  # [m] clearances within this are equal: the better posture goes first
_FAR = 0.06  # [m] more clearance than this is no better


@dataclass(frozen=True)
class ApproachSettings:
    """What a user may turn.

    Attributes:
        step_m: Legs start with this length of the tool's way [m]; halved where needed.
        line_m, line_rad: Largest deviation of the tool from the line [m], [rad].
        seeds: Descents that look for solutions of the pose, in rounds.
        rounds: Rounds at most; the next one only when no solution was proved.
        motions: Motions that are tested at most.
        fine: Let a finer cover of the tool's links decide where the map's says no.
            Braking tests and `is_free` of the planner go on with the map's cover.
    """

    step_m: float = 0.03
    line_m: float = 0.001
    line_rad: float = 0.01
    seeds: int = 12
    rounds: int = 3
    motions: int = 200
    fine: bool = True


@dataclass(frozen=True)
class Obstruction:
    """What is in the way of a leg.

    Attributes:
        leg: Number of the leg, counted from the start of the approach; -1 where the
            start itself is not free.
        legs: Number of legs.
        failed: "limits", "self-collision", "scenery" or "frame".
        link: Link of the arm, None where that is not known.
        point: Index of the frame's point, -1 where it is none.
        missing_m: How much farther away the point should be [m].
    """

    leg: int
    legs: int
    failed: str
    link: str | None = None
    point: int = -1
    missing_m: float = 0.0


@dataclass(frozen=True, eq=False)
class Approach:
    """A proved straight tool motion, or why there is none.

    Attributes:
        path: (k, dof) corners from the pre-pose to the pose [rad or m]; (0, dof)
            where none was proved. Backwards it is proved, too.
        error_m, error_rad: Largest deviation of the tool from the straight line [m],
            [rad]: a bound over the whole motion, not a sample.
        reason: One sentence where none was proved: what blocks, and what would help.
        blocker: The same as data; None where no leg was blocked.
        fine: True where a leg needed the finer cover; the planner's own `is_free`,
            which uses the map's cover, refuses such a leg.
        descents, motions: Counted work: descents of inverse kinematics, motions tested.
    """

    path: np.ndarray
    error_m: float = 0.0
    error_rad: float = 0.0
    reason: str | None = None
    blocker: Obstruction | None = None
    fine: bool = False
    descents: int = 0
    motions: int = 0

    def __bool__(self) -> bool:
        """Return True where a motion was proved."""
        return self.reason is None

    @property
    def q_pre(self) -> np.ndarray | None:
        """(dof,) where the approach begins: a goal for `planner.set_goals`."""
        return self.path[0].copy() if len(self.path) else None

    @property
    def q_end(self) -> np.ndarray | None:
        """(dof,) where it ends: the tool is at the pose."""
        return self.path[-1].copy() if len(self.path) else None


@dataclass
class _Search:
    """The work of one call, and the failure that came nearest to an approach."""

    left: int
    motions: int = 0
    best: tuple = ((-1.0, 0.0), "", None)

    def failed(self, share: float, text: str, what: Obstruction | None = None) -> None:
        key = (share, -what.missing_m if what else 0.0)
        if key > self.best[0]:
            self.best = (key, text, what)


@dataclass(frozen=True)
class _Tested:
    """What a motion's test found; see Obstruction."""

    failed: str = ""
    text: str = ""
    link: str | None = None
    point: int = -1
    missing_m: float = 0.0
    fine: bool = False


class Approacher:
    """Looks for approaches with one planner; see `ReactivePlanner.approach`.

    Args:
        planner: Its map, scenery and last frame count.
        settings: See ApproachSettings.
    """

    def __init__(
        self, planner: "ReactivePlanner", settings: ApproachSettings | None = None
    ) -> None:
        """Compute the tool's pose at every node of the roadmap."""
        self.planner = planner
        self.settings = settings or ApproachSettings()
        self.tool = ToolKinematics(planner.robot)
        self._nodes = planner.cell_map.roadmap.nodes
        self._poses = self.tool.tools(self._nodes)
        self._fine: FineTest | None = None
        grid = planner.cell_map.grid
        # smaller blocks than the map's: dense points of a bin are told apart sooner
        halved = WorkspaceGrid(grid.origin, grid.h / 2, 2 * grid.blocks)
        self._sorted = SortedCloud(halved)
        self._cloud = self._sorted.of(planner.points)

    @property
    def fine(self) -> FineTest:
        """The finer cover; made at the first use, which takes seconds."""
        if self._fine is None:
            self._fine = FineTest(self.planner)
        return self._fine

    def _look(self) -> None:
        """Take the planner's points, scenery and sampling as they are now."""
        self._cloud = self._sorted.of(self.planner.points)
        if self.settings.fine:
            self.fine.follow()

    def run(
        self,
        T_base_tool: np.ndarray,
        q: np.ndarray | None = None,
        distance: float = 0.15,
        direction: np.ndarray | None = None,
    ) -> Approach:
        """Find a proved straight motion; see `ReactivePlanner.approach`."""
        planner = self.planner
        T = checked_pose(T_base_tool)
        line = self._line(T, q, distance, direction)
        self._look()
        search, before = _Search(self.settings.motions), self.tool.descents
        if q is not None:
            q = np.ascontiguousarray(check_configuration(planner.robot, q, None))
            found = self._from_start(line, q.copy(), search)
        else:
            found = self._from_end(line, search)
        work = {"descents": self.tool.descents - before, "motions": search.motions}
        if found is None:
            nothing = np.empty((0, planner.robot.dof))
            _, text, what = search.best
            return Approach(nothing, reason=text, blocker=what, **work)
        way, fine = found
        return Approach(way.q, way.error_m, way.error_rad, fine=fine, **work)

    def leg_free(self, q_a: np.ndarray, q_b: np.ndarray) -> Freedom:
        """Test a straight joint motion as approaches are tested.

        As `ReactivePlanner.is_free`, but where the map's cover says no the finer one
        decides, if the settings allow that.
        """
        planner = self.planner
        free = planner.is_free(q_a, q_b)
        if free or free.failed not in ("scenery", "frame") or not self.settings.fine:
            return free
        self._look()
        q_a = np.array(q_a, float)
        tested = self._by_fine(q_a, planner._difference(q_a, q_b))
        return Freedom(not tested.failed, tested.failed or None, tested.text)

    # --- inside ----------------------------------------------------------------

    def _line(self, T, q, distance, direction) -> Line:
        robot = self.planner.robot
        if q is not None:
            if direction is not None:
                raise BadInput(
                    "q and direction were both given; the line runs from q's tool "
                    "pose: leave direction out"
                )
            q = check_configuration(robot, q, None)
            if not np.isfinite(q).all():
                raise BadInput(f"q holds NaN or infinity: {q}; give numbers")
            return Line.between(tool_pose(robot, q), T)
        if not (np.isfinite(distance) and 0.0 < distance <= 2.0):
            raise BadInput(
                f"a distance of {distance} m is not above 0 and at most 2 m; 0.15 m "
                "suits most approaches"
            )
        along = T[:3, 2] if direction is None else np.asarray(direction, float)
        length = np.linalg.norm(along) if along.shape == (3,) else 0.0
        if not (np.isfinite(length) and length > 1e-9):
            raise BadInput(
                f"the direction {direction} is no (3,) vector with a length; give the "
                "way of the tool in the base frame"
            )
        start = T.copy()
        start[:3, 3] -= distance * along / length
        return Line.between(start, T)

    def _from_start(self, line: Line, q: np.ndarray, search: _Search):
        way = self._follow(line, q, 0.0, 1.0)
        if way.stopped:
            search.failed(float(way.s[-1]), way.stopped)
            return None
        return self._prove(way, line, search)

    def _from_end(self, line: Line, search: _Search):
        """Try solutions of the pose, best first; return (way, fine cover needed)."""
        target, tried = line.poses(1.0)[0], []
        nearest = (np.inf, np.inf)
        for seeds in self._seeds(target):
            new, nearest = self._solutions(target, seeds, tried, nearest)
            for q in self._ranked(new):
                if not self._free_at_end(q, search):
                    continue
                way = self._follow(line, q, 1.0, 0.0)
                if way.stopped:
                    search.failed(0.0, way.stopped)
                    continue
                way = Follow(way.q[::-1], way.s[::-1], way.error_m, way.error_rad)
                if not self._starts_free(way.q[0].copy(), search):
                    continue
                found = self._prove(way, line, search)
                if found is not None or search.motions >= search.left:
                    return found
        if not tried:
            off, turned = nearest
            text = (
                "no configuration within limits has the tool at the pose: the nearest "
                f"found is {100 * off:.1f} cm and {np.degrees(turned):.0f} deg away; "
                "move the pose nearer or turn it"
            )
            search.failed(0.0, text)
        return None

    def _starts_free(self, q: np.ndarray, search: _Search) -> bool:
        """Test the pre-pose by the map's cover: the planner must get there by it."""
        free = self.planner.is_free(q, q)
        search.motions += 1
        if not free:
            text = (
                f"the start of the approach is not free: {free.reason}; give a longer "
                "distance or another direction"
            )
            search.failed(0.0, text, Obstruction(-1, 0, free.failed))
        return bool(free)

    def _follow(self, line: Line, q: np.ndarray, s_from: float, s_to: float) -> Follow:
        s = self.settings
        limits = (s.line_m, s.line_rad)
        return follow(self.tool, line, q, s_from, s_to, s.step_m, limits)

    def _seeds(self, target: np.ndarray) -> list[list[np.ndarray]]:
        """Return seeds round by round: here, then nodes whose tool is near the pose.

        A round takes every so-manieth of the near ones, so that postures differ.
        """
        n, rounds = self.settings.seeds, self.settings.rounds
        gaps = pose_gaps(self._poses, target)
        near = np.argpartition(gaps, min(4 * n * rounds, len(gaps) - 1))
        near = near[: 4 * n * rounds]
        near = near[np.lexsort((near, gaps[near]))]
        here = self.planner._q
        first = [here] if np.isfinite(here).all() else []
        chosen = [
            [self._nodes[k] for k in near[r :: 4 * rounds]] for r in range(rounds)
        ]
        chosen[0] = [*first, *chosen[0]]
        return [seeds[:n] for seeds in chosen]

    def _solutions(self, target, seeds, tried, nearest):
        new = []
        for seed in seeds:
            q = np.array(seed, float)
            reached, off, turned = self.tool.reach(target, q)
            if not reached:
                nearest = min(nearest, (off, turned), key=lambda e: e[0] + 0.3 * e[1])
                continue
            robot = self.planner.robot
            if any(np.abs(difference(robot, s, q)).max() < _SAME for s in tried):
                continue
            tried.append(q)
            new.append(q)
        return new, nearest

    def _ranked(self, solutions: list[np.ndarray]) -> list[np.ndarray]:
        """Return the clear first, by whole centimetres, then the most manipulable."""
        m, rows = self.planner.memory, []
        for k, q in enumerate(solutions):
            gap = close.separation(m.arm, q, self._cloud, _FAR, m.work)
            rows.append((-np.floor(gap / _CLASS), -self.tool.manipulability(q), k))
        return [solutions[k] for *_, k in sorted(rows)]

    def _free_at_end(self, q: np.ndarray, search: _Search) -> bool:
        tested = self._test(q, np.zeros_like(q), search)
        if tested.failed:
            self._tell(tested, -1, 0, "the pose itself is not free", 0.0, search)
        return not tested.failed

    def _prove(self, way: Follow, line: Line, search: _Search):
        """Test every leg; return (way, whether the fine cover was needed) or None."""
        legs, fine = len(way.q) - 1, False
        for k in range(legs):
            if search.motions >= search.left:
                text = (
                    f"the budget of {search.left} motions was spent before a line was "
                    "proved; allow more motions, or give a start q"
                )
                search.failed(float(way.s[k]), text)
                return None
            dq = np.ascontiguousarray(
                difference(self.planner.robot, way.q[k], way.q[k + 1])
            )
            tested = self._test(way.q[k].copy(), dq, search, fine)
            if tested.failed:
                left = 100 * (1.0 - way.s[k]) * line.length
                place = f"leg {k} of {legs} is blocked, {left:.1f} cm before the end"
                self._tell(tested, k, legs, place, float(way.s[k]), search)
                return None
            fine |= tested.fine
        return way, fine

    def _tell(self, tested, leg, legs, place, share, search) -> None:
        text = f"{place}: {tested.text}"
        if tested.failed == "frame":
            text += f"; move it at least {1e3 * tested.missing_m + 0.1:.1f} mm away"
        text += ", or give another pose or direction"
        what = Obstruction(
            leg, legs, tested.failed, tested.link, tested.point, tested.missing_m
        )
        search.failed(share, text, what)

    def _test(
        self, q: np.ndarray, dq: np.ndarray, search: _Search, fine_first: bool = False
    ) -> _Tested:
        """Test a motion: by the map's cover, and where that says no by the fine one.

        With `fine_first`, where the leg before needed it, the other way round.
        """
        robot = self.planner.robot
        search.motions += 1
        for end in (q, q + dq):
            trouble = outside_limits(robot, end, 0.0)
            if trouble is not None:
                return _Tested("limits", trouble)
        if not self.settings.fine:
            return self._by_map(q, dq)
        ways = (self._by_map, self._by_fine)
        for test in ways[::-1] if fine_first else ways:
            tested = test(q, dq)
            if not tested.failed:
                return tested
        return self._by_fine(q, dq) if fine_first else tested

    def _by_map(self, q: np.ndarray, dq: np.ndarray) -> _Tested:
        planner, m = self.planner, self.planner.memory
        if not planner.static.motion_free(q, dq):
            return _scenery(planner.static, q, dq)
        tolerance = planner.cell_map.motion_tolerance
        if close.motion_clear(
            m.arm, planner.radii, q, dq, tolerance, self._cloud, False, m.work
        ):
            return _Tested()
        sphere, point = m.work.found[:2].tolist()
        return _frame(link_of(planner, sphere), point, planner.radii[sphere], m.work)

    def _by_fine(self, q: np.ndarray, dq: np.ndarray) -> _Tested:
        fine = self.fine
        if not fine.static.motion_free(q, dq):
            return _scenery(fine.static, q, dq)
        if fine.frame_free(q, dq, self._cloud):
            return _Tested(fine=True)
        sphere, point = fine.work.found[:2].tolist()
        link = self.planner.robot.link_names[fine.link[sphere]]
        return _frame(link, point, fine.radii[sphere], fine.work)


def _scenery(static: StaticTest, q: np.ndarray, dq: np.ndarray) -> _Tested:
    text = static.why(q, dq) or "the motion is not free"
    itself = static.touches_itself(q, dq) is not None
    link = text.split(" would touch ")[0]
    return _Tested("self-collision" if itself else "scenery", text, link)


def _frame(link: str, point: int, radius: float, work: Work) -> _Tested:
    missing = float(radius - work.value[1])
    text = f"{link} would come {1e3 * missing:.1f} mm too near to point {point}"
    return _Tested("frame", text, link, point, missing)
