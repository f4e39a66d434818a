"""ReactivePlanner: the loop's one stateful object."""

import time
from collections.abc import Sequence
from threading import get_ident
from typing import NoReturn

import numpy as np

from odm.answer import (
    FOLLOWING,
    HOLDING,
    REPLANNED,
    VISIBLE,
    WHOLE,
    Answer,
)
from odm.approach import approach
from odm.cell_map.cell_map import CellMap
from odm.checks import FLOAT, check_configuration, check_points, goals_of
from odm.close_test.close_test import CloseTest
from odm.close_test.sorted_clouds import SortedCloud, SortedClouds
from odm.close_test.static import StaticTest
from odm.obstacles import _occupancy as occupancy
from odm.obstacles._cloud import IS_SORTED
from odm.obstacles.world_frame import WorldFrame
from odm.owner import refuse_copy
from odm.planner import attaching as attach
from odm.planner import calm, explain, polish, smooth, straight
from odm.planner.braking import Braking
from odm.planner.carrying import Carrier
from odm.planner.doors import Doors
from odm.planner.goal_checks import check_goals
from odm.planner.last_phase import LastPhase, check_classes
from odm.planner.questions import Questions
from odm.planner.settings import PlannerSettings
from odm.planner.unfit import unfit
from odm.search import _frame as frame
from odm.search import _step as step
from odm.search.state import DirectMap, Memory, exchange, lay_out
from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference
from roadmap.ranges import check_number

_STAYS = 3  # frames at the same place,
_LINGERS = 12  # and with a path that it could follow
_PASSES = 0.2  # [rad or m] a robot is no farther from where it was a frame before


class ReactivePlanner(Doors, Questions, Braking):
    """Answers every frame: go on, go a new way, or hold and say why.

    One planner belongs to one thread, the one that made it or took it over; any other
    is refused. It cannot be copied or pickled: make another one on the same map.
    Nothing is allocated in a frame after warm-up but the answer itself.

    Args:
        cell_map: The map of the robot.
        always_replan: Search from scratch in every frame instead of going on along a
            path that is still free.
        settings: See PlannerSettings.
    """

    def __init__(
        self,
        cell_map: CellMap,
        always_replan: bool = False,
        settings: PlannerSettings | None = None,
    ) -> None:
        """Lay out all memory and compile nothing yet."""
        self.cell_map = cell_map
        self.robot = cell_map.robot
        self.always_replan = always_replan
        self.settings = settings or PlannerSettings()
        self.static = StaticTest(
            self.robot, cell_map.scenery, cell_map.safety, cell_map.grid
        )
        self._memory = lay_out(cell_map, self.settings.max_points)
        self.rho, self.extra = cell_map.safety.rho, 0.0
        self._set_radii(None, None)
        self.world, self._world_ahead = WorldFrame(np.eye(4)), WorldFrame(np.eye(4))
        self._p_world_place: np.ndarray | None = None
        self.carrier = Carrier(self)
        self.attacher = attach.Attacher(self)
        self._approacher: approach.Approacher | None = None
        self.polisher = polish.Polisher(self)
        self.smoother = smooth.Smoother(self)
        self.calm = calm.Calm(self)
        self.straightener = straight.Straightener(self)
        self._ahead = SortedCloud(cell_map.grid)
        self.coming = SortedClouds(cell_map.grid)
        self._last_phase: LastPhase | None = None
        n, m = cell_map.roadmap.n_nodes, cell_map.roadmap.n_edges
        self.direct = DirectMap(self.memory, n, m)
        self.goals = np.zeros((0, self.robot.dof))
        self.costs: np.ndarray | None = None
        # the frame's points, and those of the last frame with some inside the grid
        self._rooms = [np.empty((self.settings.max_points, 3)) for _ in range(2)]
        self._kept = [room[:0] for room in self._rooms]
        self._room = 0
        self.points = self._kept[0]
        self.seen_inside: tuple[float, np.ndarray] | None = None  # stamp and points
        self.trouble: str | None = None  # why the last frame could not be used
        self.classes: np.ndarray | None = None
        self.last: Answer | None = None
        self.heard: tuple[float, float] | None = None  # newest stamp, and when
        self._q = self.memory.own.q
        self._here = b""
        self._moving = False
        self._stood = 0  # frames without a move
        self._new_goals = self._rejoin = False
        self._nowhere = np.empty((0, self.robot.dof))
        self.attacher.forget_start()
        if self.settings.extra_clearance:
            self.set_extra_clearance(self.settings.extra_clearance)

    # --- whose it is -------------------------------------------------------------

    @property
    def memory(self) -> Memory:
        """The arrays of the compiled loops, and the table that points at them."""
        return self._memory

    @property
    def radii(self) -> np.ndarray:
        """(n,) radii of the close test [m]: spheres, covering radius, clearance."""
        return self._memory.own.radii

    @property
    def close_test(self) -> CloseTest:
        """The close test of motions, with what the hand carries."""
        m = self._memory
        return CloseTest(m.arm, m.own.radii, self.cell_map.motion_tolerance, m.work)

    def take_over(self) -> None:
        """Make the planner this thread's own, while no call of it runs elsewhere.

        From then on the thread that had it is refused, until it takes it over again.
        Whoever hands a planner on sees to it that its last call has ended: nothing
        here waits for that.
        """
        self._memory.owner.take_over()

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        """Refuse to be copied or pickled; say what to do instead."""
        refuse_copy()

    # --- what is asked for -----------------------------------------------------

    def set_goals(
        self, goals: Sequence[np.ndarray], costs: Sequence[float] | None = None
    ) -> None:
        """Set the goals, best first.

        Args:
            goals: (g, dof) valid configurations, g <= 32; not only roadmap nodes.
            costs: (g,) Where given, the goal with the least path length plus cost
                wins; otherwise the first reachable one in rank order.

        Raises:
            BadConfiguration: A goal has the wrong length, is not finite, out of
                limits, in self-collision or in contact with the scenery.
        """
        self._memory.owner.check()
        goals, costs = goals_of(self.robot, goals, costs)
        if np.array_equal(goals, self.goals) and _equal(costs, self.costs):
            return
        check_goals(self, goals)
        if self._rejoin:  # what is known of the goals was known of another hand
            self.goals, self._rejoin = self.goals[:0], False
        self.attacher.set_goals(goals, costs)
        self.goals, self.costs = goals, costs
        self.straightener.reset()
        self._new_goals = True

    # --- a frame ---------------------------------------------------------------

    def step(
        self,
        points: np.ndarray,
        q: np.ndarray,
        dq: np.ndarray | None = None,
        labels: np.ndarray | None = None,
        stamp: float | None = None,
        now: float | None = None,
        covering_radius: float | None = None,
        rounding: float | None = None,
        classes: np.ndarray | None = None,
        closed: bool = False,
    ) -> Answer:
        """Answer one frame.

        A frame that cannot be used (see `odm.planner.unfit`) holds, and every question
        after it is answered with no, until a frame comes that can.

        Args:
            points: (n, 3) float64 points on the obstacles' surfaces [m]; base frame,
                or the world's after `set_base`. They are copied.
            q: (dof,) present configuration [rad or m].
            dq: (dof,) present velocity; checked, and kept for callers' timing.
            labels: (n,) part of each point; where given, each part is closed.
            stamp: Time of the points [s]; older points than those of a frame before
                hold, unless `now` went back, too. A clock that was set back without
                a `now` needs `reset`.
            now: Present time [s], by the same clock.
            covering_radius: No point of a surface is farther from its nearest sample
                [m]; None: the map's rho. The close test uses it, so dense points
                cost less free space.
            rounding: Smallest radius of the sampled shapes where all are capsules or
                spheres [m]: proves that less than rho is needed (see
                `odm.obstacles.surfaces.rounded_covering`).
            classes: (n,) odm.AVOID, CONTACT or OBJECT of each point; the answer heeds
                all, a `phase` of other questions makes a difference.
            closed: The points cover the whole surfaces of closed solids, as those of
                `odm.sample_capsules` and `odm.surface_of` do; so does `labels`. Else
                only what was sampled is certified, "visible surface".

        Returns:
            The answer; "no path" is an answer, not an exception.

        Raises:
            BadInput: Wrong shape or dtype, or a covering radius above the map's rho.
        """
        begun = time.perf_counter_ns()
        memory = self._memory
        if get_ident() != memory.owner.thread:
            memory.owner.check()
        # mostly both are what the compiled frame takes, which is seen at once here
        if (
            type(points) is not np.ndarray
            or points.dtype is not FLOAT
            or points.ndim != 2
            or points.shape[1] != 3
            or not points.flags.carray
            or labels is not None
            or covering_radius is not None
        ):
            points = check_points(points, labels, covering_radius, self.rho)
        if (
            type(q) is not np.ndarray
            or q.dtype is not FLOAT
            or q.shape != self._q.shape
            or not q.flags.carray
            or dq is not None
        ):
            q = check_configuration(self.robot, q, dq)
        self.classes = None if classes is None else check_classes(classes, len(points))
        if not self.world.at_base:
            points = self.world.points(points)
        if self._rejoin:
            self.attacher.forget_all()
        if len(points) > len(memory.cloud.where):
            self._make_room(2 * len(points))
        given, points = points, self.points
        if self.seen_inside is not None or len(points) != len(given):
            points = self._room_for(len(given))
        if (covering_radius, rounding) != self._sampled:
            self._set_radii(covering_radius, rounding)
        closed = closed or labels is not None
        odd = frame.begin_step(memory.table, given, points)
        marked = time.perf_counter_ns()
        trouble = None
        if odd or stamp is not None or now is not None:
            trouble = unfit(self, stamp, now)
        self.trouble = trouble
        if not (trouble or self.always_replan):
            self.calm.recent.take(points, now)
        code = step.NO_PATH if trouble else self._decide(points, q)
        if code > step.PLANNED:
            return self._hold(begun, marked, closed, trouble, code)
        way, numbers = memory.way, memory.numbers
        if code == step.PLANNED and way.count.item(0) > 2:
            self.straightener.run()
        path = way.q[numbers.segment.item() : way.count.item(0)].copy()
        if code == step.FOLLOWING:  # a new path begins at q
            path[0] = q
        same = self._moving and numbers.same.item()
        following = code == step.FOLLOWING or same
        self._moving = True
        status = FOLLOWING if following else REPLANNED
        return self._answer(status, path, begun, marked, closed)

    def _decide(self, points: np.ndarray, q: np.ndarray) -> int:
        here, before = q.tobytes(), self._here  # compared much faster than arrays
        same, self._here = here == before, here
        attacher, first = self.attacher, self._new_goals
        self._new_goals = False
        self._stood = self._stood + 1 if same and not first else 0
        numbers = self._memory.numbers
        due = not self.always_replan and (numbers.step.item() % step.IMPROVE_EVERY == 0)
        found = numbers.better.item() if due else 0  # looks in a row
        stays = self._stood >= (_LINGERS if self._moving else _STAYS)
        look = same and (first or (attacher.quick and stays))
        if look and not attacher.is_fresh(q) and np.isfinite(q).all():
            # look around before it leaves, thoroughly where it stays for a while
            attacher.attach_start(q, quick=first)
        code = self._step(points, q)
        if code == step.NOT_ATTACHED:
            attacher.attach_start(q, quick=self._is_near(q, before))
            code = self._step(points, q)
        # on the way, but its segment is blocked at both ends: look around
        if code == step.NO_PATH and len(self.goals) and not attacher.is_fresh(q):
            passing = not same and self._is_near(q, before)
            if not (passing and attacher.is_at(q)):
                attacher.attach_start(q, quick=passing)
                code = self._step(points, q)
        looked = attacher.is_at(q) and not self.settings.memory_s
        if due and code == step.FOLLOWING and not looked and self._sees_better():
            if not attacher.is_at(q):
                attacher.attach_start(q, quick=not same)
            code = self.calm.better(points, q, found)
        return code

    def _sees_better(self) -> bool:
        """Return whether a better goal than the one it goes to keeps clear now.

        Then it is worth to join the robot to the roadmap anew: the ends of a straight
        way are no nodes, and from them no way to another goal is ever found.
        """
        if self.costs is not None:  # then no goal is better than another by its rank
            return False
        rank = int(self.memory.way.count[1])
        return any(self.stands_clear(self.goals[g]) for g in range(rank))

    def _is_near(self, q: np.ndarray, before: bytes) -> bool:
        """Whether the robot may have moved to q since the frame before."""
        if not before:
            return False
        return bool(np.abs(self._difference(np.frombuffer(before), q)).max() < _PASSES)

    def calm_cloud(self) -> object:
        """Return what new legs keep clear of: the points, and where they have been."""
        self._memory.owner.check()
        if self.always_replan or not self.settings.memory_s:
            self._sort()
            return self.memory.cloud
        return self.calm.recent.cloud()

    def _step(self, points: np.ndarray, q: np.ndarray) -> int:
        s = self.settings
        if not self.always_replan and s.memory_s:
            return self.calm.choose(points, q)
        code = step.step(
            self._memory.table,
            points,
            q,
            self.always_replan,
            s.margin,
            s.close_tests,
            s.looks,
        )
        if code != step.BESIDE:
            return code
        self.attacher.certify_beside(q)
        return self._step(points, q)

    def judge(self, points: np.ndarray, q: np.ndarray) -> int:
        """Judge the path in use by the frame's points; a code of `_step.py`."""
        code = step.judge(self._memory.table, points, q, False)
        if code == step.BESIDE:
            self.attacher.certify_beside(q)
            code = step.judge(self._memory.table, points, q, False)
        return code

    def polish(self, budget: int = 4, ahead: np.ndarray | None = None) -> int:
        """Shorten the path in use between two frames; return how many cuts were made.

        Call it after the answer was sent. At most `budget` motions are tested; what
        is found is remembered and used by later frames as long as it is free.

        Args:
            budget: Motions to test at most.
            ahead: (dof,) where the next frame will be asked from, if that is known:
                the path up to there stays. None leaves what the robot reaches soon.

        Raises:
            BadInput: The budget is no whole number from 0, or `ahead` has the wrong
                length.
        """
        self._memory.owner.check()
        budget = check_number("the budget of polish", budget, 0, 10**6, whole=True)
        if ahead is not None:
            ahead = check_configuration(self.robot, ahead, None)
        if self.trouble is not None:
            return 0
        if self.always_replan:
            return self.polisher.run(budget)[0]
        half = budget // 2
        found, left = self.polisher.run(half)
        return found + self.smoother.run(budget - half + left, ahead)

    def reset(self) -> None:
        """Forget the path in use and where the robot was; the goals stay."""
        self._memory.owner.check()
        self.memory.way.count[0] = 0
        self.attacher.forget_start()
        self._moving = False
        self.smoother.reset()
        self.straightener.reset()
        self.calm.reset()
        self.last = self.heard = self.seen_inside = None

    # --- inside ----------------------------------------------------------------

    def _make_room(self, room: int) -> None:
        """Let clouds hold that many points or more; the frame's stay marked."""
        grid, room = self.cell_map.grid, max(room, len(self.memory.cloud.where))
        cloud, pick = grid.new_cloud(room), grid.new_cloud(room)
        exchange(self._memory, {"cloud": cloud, "pick": pick})
        frame.take_points(self._memory.table, self.points)

    def _keep(self, points: np.ndarray) -> None:
        """Copy (n, 3) points of a frame: the caller may fill the array anew."""
        self._room_for(len(points))[...] = points

    def _room_for(self, n: int) -> np.ndarray:
        """Let `points` be an array (n, 3) of our own, and return it to be filled."""
        seen = self.seen_inside
        if seen is not None and seen[1] is self.points:
            self._room = 1 - self._room
        kept = self._kept[self._room]
        if len(kept) != n:
            if n > len(self._rooms[self._room]):
                self._rooms[self._room] = np.empty((2 * n, 3))
            kept = self._kept[self._room] = self._rooms[self._room][:n]
        self.points = kept
        return kept

    def _sort(self) -> None:
        if not self.memory.cloud.counts[IS_SORTED]:
            occupancy.sort_points(self.points, self.memory.cloud)

    def _difference(self, q_a: np.ndarray, q_b: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(difference(self.robot, q_a, q_b))

    def _hold(
        self,
        begun: int,
        marked: int,
        closed: bool,
        trouble: str | None,
        code: int,
    ) -> Answer:
        self._moving = False
        told = explain.Reasons(self, trouble or explain.start_trouble(self, code))
        path = self._nowhere
        return self._answer(HOLDING, path, begun, marked, closed, told)

    def _answer(
        self,
        status: str,
        path: np.ndarray,
        begun: int,
        marked: int,
        closed: bool,
        told: "explain.Reasons | None" = None,
    ) -> Answer:
        memory = self._memory
        goal = memory.way.count.item(1) if told is None else None
        counted = (memory.cloud.counts.tobytes(), memory.counted.tobytes())
        times = (begun, marked, time.perf_counter_ns())
        certified = WHOLE if closed else VISIBLE
        self.last = Answer(status, path, goal, certified, times, counted, told)
        return self.last


def _equal(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    if a is None or b is None:
        return a is b
    return np.array_equal(a, b)


__all__ = ["BadInput", "PlannerSettings", "ReactivePlanner"]
