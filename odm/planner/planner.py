"""ReactivePlanner: the loop's one stateful object; what it owns does the work."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from threading import get_ident
from time import perf_counter_ns
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from odm.answer import (
    CLOSE_TEST,
    FOLLOWING,
    HOLDING,
    IN_USE,
    LAYER,
    REPLANNED,
    ROADMAP,
    SEARCH,
    STRAIGHT,
    VISIBLE,
    WHOLE,
    Answer,
    Freedom,
    Verdict,
)
from odm.approach.approach import Approacher
from odm.approach.approach_answer import Approach
from odm.cell_map.cell_map import CellMap
from odm.checks import (
    check_configuration,
    check_distance,
    check_numbers,
    check_path,
    check_points,
    goals_of,
)
from odm.close_test.static import StaticTest
from odm.frame.carrying import Carrier
from odm.frame.frame import Cover, Frame
from odm.frame.freedom import check_valid, is_free
from odm.frame.last_phase import LastPhase
from odm.frame.path_test import PathTest
from odm.frame.place import place_points
from odm.frame.sensor_watch import SensorWatch, checked_times
from odm.obstacles.obstacles import Obstacles
from odm.obstacles.point_cloud import PointCloud
from odm.obstacles.surfaces import checked_rods
from odm.obstacles.world_frame import WorldFrame
from odm.owner import refuse_copy
from odm.planner.attaching import Attacher
from odm.planner.connect import Connector
from odm.planner.decision import MOVES, Decision
from odm.planner.explain import Reasons, start_trouble
from odm.planner.improve import Cutter, Improver
from odm.planner.path import CandidatePath, Candidates, PathInUse
from odm.planner.pose_goals import GoalReport, PoseGoals, Refused
from odm.planner.retreat import Retreat
from odm.planner.saved_memory import Remembers, StateArrays, pack, unpack
from odm.planner.scene import Scene
from odm.planner.settings import MOST_EXTRA, ImproveSettings, PlannerSettings
from odm.planner.smooth import Smoother
from odm.planner.tight_ends import TightEnds
from odm.search import _expected as expected
from odm.search import _recent as recent
from odm.search import _step as codes
from odm.search._astar import LARGE
from odm.search.state import Memory
from roadmap.arrays import as_floats, writable
from roadmap.errors import BadConfiguration, BadInput
from roadmap.ranges import (
    check_kind,
    check_number,
    check_yes,
    is_between,
    settings_of,
)
from roadmap.transforms import check_pose

# what a frame's answer is packed with, which every frame takes apart
_FOLLOWING, _PLANNED = codes.FOLLOWING, codes.PLANNED
_SEGMENT, _COUNT, _GOAL = codes.SEGMENT, codes.COUNT, codes.GOAL
_SAME = codes.SAME


class ReactivePlanner:
    """Answers every frame: follow the path in use, replan, or hold and say why.

    One planner belongs to one thread, the one that made it or took it over; any other
    is refused. It cannot be copied or pickled: make another one on the same map.
    Nothing is allocated in a frame after warm-up but the answer itself.

    Args:
        cell_map: The map of the robot.
        always_replan: Search from scratch in every frame instead of going on along a
            path that is still free.
        settings: See PlannerSettings.

    Attributes:
        frame: What is known now; all helpers read it.
        path, candidate, candidates, attacher: What is remembered between frames: the
            path in use, what was found to better it, motions to the roadmap.
        connector: What was found beyond the roadmap.
        decision: Decides what a frame comes to.
        direct: The nodes and edges that the frame invalidates.
        scene: What stands around, by name: `add`, `move`, `remove`, `load`.
        last: The last answer, None before the first.
    """

    def __init__(
        self,
        cell_map: CellMap,
        always_replan: bool = False,
        settings: PlannerSettings | None = None,
    ) -> None:
        check_kind("cell_map", cell_map, CellMap, "give what odm.load_map returns")
        self.cell_map, self.robot = cell_map, cell_map.robot
        s = self.settings = settings_of(settings, PlannerSettings)
        watch = SensorWatch(s.max_age_s, s.max_range_m)
        frame = self.frame = Frame(cell_map, s.point_capacity, s.finger_pads, watch)
        self._memory, self._numbers = frame.memory, frame.memory.numbers
        self._owner = frame.memory.owner
        self.carrier = Carrier(frame)
        self._last_phase = LastPhase(frame)
        self._path_test = PathTest(frame, self._last_phase)
        self._approacher: Approacher | None = None
        self._pose_goals: PoseGoals | None = None
        self.direct = frame.direct
        # what is remembered between frames
        self.path = path = PathInUse(frame)
        self.candidate = CandidatePath(frame)
        self.candidates = Candidates(frame)
        attacher = Attacher(frame, path, self.candidate, self.candidates, s)
        self.attacher = attacher
        # what works on it
        patience = s.persistence_frames if s.history_s else 0
        self.decision = Decision(frame, path, attacher, patience)
        self._shares = shares = ImproveSettings()
        self._improver = Improver(
            frame,
            path,
            self.candidate,
            Cutter(frame, path, self.candidates, attacher, shares),
            Smoother(frame, self.candidate, attacher, s),
            self.decision.join_between,
            shares,
        )
        self.connector = Connector(frame, path, attacher, s.search)
        changed = partial(_scene_changed, self.carrier, attacher, self.connector)
        self.scene = Scene(frame, self.carrier, changed)
        self._retreat = Retreat(frame, attacher)
        self._links = self._retreat.links
        self._tight = TightEnds(frame, path, attacher, self.decision, self._links)
        self._tight.used = s.tight_ends
        self.always_replan = always_replan
        self._set_rules()
        self.last: Answer | None = None
        # what `respond` said last, and whether of whole surfaces; the rows that it
        # stands for, and the verdict where the path in use was followed, or was not
        self._said, self._closed, self._ahead = None, False, path.q[:0]
        self._goes_on = self._begins = Verdict(FOLLOWING, None, VISIBLE, None, None)
        self._nowhere = np.empty((0, self.robot.dof))
        attacher.forget_start()
        if s.extra_clearance:
            self.set_extra_clearance(s.extra_clearance)

    # --- whose it is -------------------------------------------------------------

    @property
    def memory(self) -> Memory:
        """The arrays of the compiled loops, and the table that points at them."""
        return self._memory

    def take_over(self) -> None:
        """Let this thread use the planner, while no call of it runs in another thread.

        From then on the thread that used the planner before is refused, until that
        thread takes it over again. The caller must see to it that the last call there
        has ended: nothing here waits for it.
        """
        self._memory.owner.take_over()

    def __repr__(self) -> str:
        """Tell the map, and how many goals there are."""
        name, nodes = self.cell_map.recipe.name, len(self.cell_map.roadmap.nodes)
        return f"ReactivePlanner(map {name}, {nodes} nodes, {len(self.goals)} goals)"

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        """Refuse to be copied or pickled; say what to do instead."""
        refuse_copy()

    @property
    def always_replan(self) -> bool:
        """Whether every frame searches from scratch; it may be set."""
        return bool(self._memory.rules.always.item())

    @always_replan.setter
    def always_replan(self, always: bool) -> None:
        self._memory.rules.always[0] = check_yes("always_replan", always)

    @property
    def smoother(self) -> Smoother:
        """What shortens the time along the path between frames."""
        return self._improver.smoother

    @property
    def frame_number(self) -> int:
        """How many frames were asked for: the number of the last one, from 1 on."""
        return self.frame.number

    @property
    def joined(self) -> bool:
        """Whether the last `step` joined q to the roadmap, which takes milliseconds."""
        return self.decision.joined

    @property
    def goals(self) -> np.ndarray:
        """(g, dof) goals, best first [rad or m]."""
        return self._tight.goals

    @property
    def costs(self) -> np.ndarray | None:
        """(g,) costs of the goals; None where their order ranks them."""
        return self.attacher.costs

    @property
    def points(self) -> np.ndarray:
        """(n, 3) points of the last frame, base frame [m]."""
        return self.frame.points

    @property
    def trouble(self) -> str | None:
        """Why the last frame could not be used; None where it could."""
        return self.frame.trouble

    @property
    def static(self) -> StaticTest:
        """The test of what never moves, with what is in the hand."""
        return self.frame.static

    @property
    def world(self) -> WorldFrame:
        """Where the base stands in the world."""
        return self.frame.world

    @property
    def keep(self) -> float:
        """A point nearer than this to a sphere of the cover is too near [m]."""
        return self.frame.keep

    @property
    def rho(self) -> float:
        """The map's covering radius [m]."""
        return self.frame.rho

    @property
    def extra(self) -> float:
        """Distance kept beyond the map's clearance m [m]."""
        return self.frame.extra

    # --- what is asked for -----------------------------------------------------

    def set_goals(
        self,
        goals: ArrayLike | None = None,
        costs: ArrayLike | None = None,
        *,
        poses: Sequence[np.ndarray] | np.ndarray | None = None,
        tolerance: float | tuple[float, float] | None = None,
        most: int | None = None,
    ) -> GoalReport:
        """Set the goals, best first: configurations, or poses of the tool.

        A goal that can never be reached (out of limits, in collision with the robot
        itself or with what stands still) is left out and told, as long as another one
        is good.

        Args:
            goals: (g, dof) valid configurations, g <= 32; not only roadmap nodes.
            costs: (g,) Where given, the goal with the least path length plus cost
                wins, both in weighted joint space (`Roadmap.weights`); otherwise the
                first reachable one in rank order. They count in a search: a path in
                use that stays free is kept while its goal is one of these, whatever
                that costs now, unless `improve` finds a better one; it looks for one
                where the path makes a detour or another goal may cost less.
            poses: (4, 4) poses of the tool, base frame [m] (the world's after
                `set_base`), instead of goals: their inverse kinematics, those free in
                the last frame first, then the nearest to the robot.
            tolerance: Of poses: (position [m], angle [rad]), or a position alone, with
                10 rad a metre; None: 1 mm and 0.01 rad. Solutions are as near as 1e-5
                where that can be had.
            most: Of poses: configurations that become goals at most, the best of each
                pose first; None: as many as there are poses. Each takes milliseconds;
                where one of a pose is blocked, another may not be.

        Returns:
            What was set, what was refused, and why.

        Raises:
            BadConfiguration: No goal is left: each has the wrong length, is not finite,
                out of limits, in self-collision or in contact with the scenery; or no
                pose has a solution. The goals stay as they were.
        """
        self._memory.owner.check()
        if poses is None:
            if tolerance is not None or most is not None:
                raise BadInput("tolerance and most go with poses; give poses, too")
            report, goals, costs = self._valid_goals(goals, costs)
            at_once = self.attacher.settings.goal_at_once
        else:
            report = self._goals_at(goals, costs, poses, tolerance, most)
            goals, costs = np.array(report.goals), None
            at_once = self.attacher.settings.pose_at_once
        same = np.array_equal(costs, self.costs)  # or both are None
        if same and np.array_equal(goals, self.goals):
            return report
        self._tight.forget(goals_stay=False)
        self.attacher.set_goals(goals, costs, at_once)
        self.smoother.look_straight()
        self.decision.new_goals = True
        return report

    def _valid_goals(
        self, goals: Sequence[np.ndarray] | None, costs: Sequence[float] | None
    ) -> tuple[GoalReport, np.ndarray, np.ndarray | None]:
        """Return the goals that can be reached, and their costs."""
        goals, costs = goals_of(self.robot, goals, costs)
        index, refused = np.arange(len(goals)), []
        if not np.array_equal(goals, self.goals):
            for k, q in enumerate(goals):
                try:
                    check_valid(self.static, q, f"goal {k}")
                except BadConfiguration as error:
                    if len(refused) + 1 == len(goals):
                        raise
                    refused.append(Refused(k, str(error), q))
        if refused:
            index = np.delete(index, [one.index for one in refused])
            goals = goals[index]
            costs = None if costs is None else costs[index]
        return GoalReport(goals, index, goals, index, tuple(refused)), goals, costs

    def _goals_at(
        self,
        goals: object,
        costs: object,
        poses: Sequence[np.ndarray],
        tolerance: object,
        most: int | None,
    ) -> GoalReport:
        """Return goals for poses of the tool."""
        if goals is not None or costs is not None:
            raise BadInput(
                "goals or costs were given beside poses; give poses alone, or goals"
            )
        if self._pose_goals is None:
            self._pose_goals = PoseGoals(self.frame)
        return self._pose_goals.solve(poses, tolerance, most)

    def use_tight_ends(self, used: bool) -> None:
        """Let the links decide about ends that the cover refuses, from now on, or not.

        As `PlannerSettings.tight_ends` says at first. Not with an `Executor`: it tests
        stops by the cover, and would get stuck there.
        """
        self._memory.owner.check()
        self._tight.used = check_yes("used", used)
        if not self._tight.used:
            self._tight.forget()

    def prepare_goal(self, q: np.ndarray) -> bool:
        """Attach a goal ahead, in a frame that can afford it; True: it is kept.

        Attaching takes milliseconds, `set_goals` with a goal that is kept does not.
        `PlannerSettings.cached_goals` says how many are kept, those set before too.

        Args:
            q: (dof,) a valid configuration [rad or m].

        Raises:
            BadConfiguration: As of `set_goals`.
        """
        self.memory.owner.check()
        goals, _ = goals_of(self.robot, [q], None)
        if goals[0] in self.attacher.kept:
            return True
        check_valid(self.static, goals[0], "goal 0")
        return self.attacher.prepare(goals[0])

    def is_prepared(self, q: np.ndarray) -> bool:
        """Return whether a goal is kept attached, so that to set it costs little."""
        self.memory.owner.check()
        return check_configuration(self.robot, q, None) in self.attacher.kept

    # --- a frame ---------------------------------------------------------------

    def expect(self, what: np.ndarray | Obstacles) -> None:
        """Say where the obstacles are likely to be soon; call it before `step`.

        New paths keep clear of there where they can, as of where the obstacles have
        lately been. It decides nothing: a motion is free or blocked by `step` alone.

        Args:
            what: Points (n, 3) [m], or `odm.Obstacles`, whose capsules and points
                count. Where `step` has them: in the base frame, or the world's.

        Raises:
            BadInput: Points of another shape, or a capsule that is none.
        """
        self._memory.owner.check()
        rods = np.zeros((0, 7))
        if isinstance(what, Obstacles):
            what, rods = what.points, checked_rods(what.capsules, "capsule")
        points = check_points(what, None, None, np.inf)
        if self.settings.history_s:
            points = self.frame.world_ahead.points(points)
            kept_off = writable(points), writable(rods), self.frame.base_world
            expected.expect(self._memory.table, *kept_off, np.empty((3, 3)))

    def step(
        self,
        points: np.ndarray | Obstacles | PointCloud,
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

        A frame that cannot be used (see `odm.frame.sensor_watch`) holds, and every
        question after it is answered with no, until a frame comes that can.

        Args:
            points: (n, 3) points on the obstacles' surfaces [m]; base frame, or the
                world's after `set_base`. Or `odm.Obstacles`: shapes and points
                together; then what is told of points holds for its points. Or an
                `odm.PointCloud`, which brings its own covering radius.
                All are copied.
            q: (dof,) present configuration [rad or m].
            dq: (dof,) present velocity; checked, and kept for callers' timing.
            labels: (n,) part of each point; where given, each part is closed.
            stamp: Time of the points [s]. Older ones than before hold, unless `now`
                went back, too; a clock set back without a `now` needs `reset`.
            now: Present time [s], by the same clock.
            covering_radius: No point of a surface is farther from its nearest sample
                [m]; None: the map's rho. Dense points cost less free space.
            rounding: Smallest radius of the sampled shapes where all are capsules or
                spheres [m]: less than rho is needed (`surfaces.rounded_covering`).
            classes: (n,) odm.AVOID, CONTACT or OBJECT of each point; only the `phase`
                of a question tells them apart.
            closed: The points cover whole surfaces of closed solids, as those of
                `odm.surface_of` do, or with `labels`; else the answer certifies the
                "visible surface" alone. Shapes without points are whole.

        Returns:
            The answer; "no path" is one, no exception.

        Raises:
            BadInput: Wrong shape or dtype, a covering radius above the map's rho, a
                time that is no number, or a mesh that is too large to be sampled; the
                last frame stays. The first frame with a new mesh samples it, which
                takes 4 to 100 ms.
        """
        begun, frame = perf_counter_ns(), self.frame
        said = None
        if closed is not False:
            closed = check_yes("closed", closed)
        if (
            points is frame.again
            and dq is labels is stamp is now is None
            and covering_radius is rounding is classes is None
            and get_ident() == self._owner.thread
            and self.decision.begin()
        ):
            said = frame.take_again(points, q)
        if said is not None:
            q = frame.q_taken
        else:
            if type(points) is PointCloud:
                covering_radius = points.covering_radius
            stamp, now = checked_times(stamp, now)
            points, q = frame.checked(points, q, dq, labels, covering_radius, classes)
            at_once = q if self.decision.begin() else None
            said = frame.take(points, covering_radius, rounding, stamp, now, at_once)
        if not closed:
            shapes = frame.obstacles is not None and frame.n_given == 0
            closed = shapes or labels is not None
        # mostly it is what was said before, a path; else it may not be answered yet
        if said != self._said and said % _SEGMENT > _PLANNED:
            if frame.trouble is not None:
                return self._hold(begun, closed, frame.trouble)
            if self._tight.is_on:
                return self._by_links(q, begun, closed, now)
            said = self.decision.decide(q, now, said)
            if said % _SEGMENT > _PLANNED:
                return self._beyond(q, said, begun, closed, now)
        return self._say(said, begun, closed)

    def _by_links(
        self, q: np.ndarray, begun: int, closed: bool, now: float | None
    ) -> Answer:
        """Answer a frame whose search goes from or to places beside the very ends."""
        begin = self._tight.begin(q)
        at = q if begin is None else begin
        said = self.decision.decide(at, now, codes.NOT_ASKED)
        if said % _SEGMENT <= _PLANNED:
            answer = self._say(said, begun, closed)
        else:
            answer = self._beyond(at, said, begun, closed, now)
        if begin is None:
            return answer
        status, path, goal, legs = self._tight.whole(answer, q)
        self.path.followed = answer.status != HOLDING
        why, stage = self._reasons(None), answer.stage
        surface = answer.certified
        told = Verdict(status, goal, surface, stage, self.held_by, why, legs)
        return self._answer(path, told, begun)

    def _say(self, said: int, begun: int, closed: bool) -> Answer:
        """Answer with the rest of the path in use, which was found free."""
        if said != self._said or closed != self._closed:
            self._unpack(said, closed)  # mostly it is what the frame before said
        path = self.path
        told = self._goes_on if path.followed else self._begins
        path.followed = True
        return self._answer(self._ahead.copy(), told, begun)

    def see(
        self,
        points: np.ndarray | Obstacles | PointCloud,
        q: np.ndarray,
        stamp: float | None = None,
        now: float | None = None,
    ) -> str | None:
        """Take a frame without an answer, for a caller that follows its own motion.

        All that is asked afterwards (`blocked_leg`, `separation`, `approach`, `evasion`
        ...) is answered for this frame, as after `step`. Nothing is searched and q is
        not joined to the roadmap, which would take milliseconds at a new place. The
        path in use counts as not followed, and `improve` has nothing to do.

        Args:
            points: As in `step`.
            q: (dof,) present configuration [rad or m].
            stamp: Time of the points [s]; see `step`.
            now: Present time [s], by the same clock.

        Returns:
            Why the frame cannot be used, None where it can.

        Raises:
            BadInput: As `step` does.
        """
        frame, radius = self.frame, None
        if type(points) is PointCloud:
            radius = points.covering_radius
        stamp, now = checked_times(stamp, now)
        points, q = frame.checked(points, q, None, None, radius, None)
        frame.take(points, radius, None, stamp, now)
        self.path.followed = False
        if frame.trouble is None:
            self.decision.see(q, now)
        return frame.trouble

    def _unpack(self, said: int, closed: bool) -> None:
        """Take apart what `respond` said: a code, the corners ahead, and the goal."""
        begin, end = said % _COUNT // _SEGMENT, said % _GOAL // _COUNT
        self._said, self._ahead = said, self._memory.ahead.q[: end - begin]
        self._closed, stage = closed, stage_of(said % _SEGMENT, self._ahead)
        rest = said % _SAME // _GOAL - 1, _surface(closed), stage, self.held_by
        in_use, same = stage is IN_USE, said >= _SAME
        self._begins = Verdict(FOLLOWING if in_use else REPLANNED, *rest)
        self._goes_on = Verdict(FOLLOWING if in_use or same else REPLANNED, *rest)

    def _beyond(
        self, q: np.ndarray, said: int, begun: int, closed: bool, now: float | None
    ) -> Answer:
        """Answer a frame for which the roadmap has no path, or hold.

        A path that was found beyond the roadmap comes first, since it costs least. Then
        more nodes, or a search: but for the first frame of a place, one of the two.
        """
        decision, path, connector = self.decision, self.path, self.connector
        code, patience = said % _SEGMENT, decision.patience
        taken = False
        if code in codes.HAS_NO_PATH:
            found = connector.remembered(q, patience, decision.waits)
            if found is None:
                moves = decision.robot == MOVES
                first, joined = connector.is_new and not moves, False
                had = self.attacher.n_motions
                if code == codes.NO_PATH:
                    most = self._shares.nodes_at_first if first else 1
                    joined = decision.join_more(most)
                if self.attacher.n_motions > had:
                    more = decision.again(now)
                    if more % _SEGMENT <= _PLANNED:
                        return self._say(more, begun, closed)
                if first or not joined:
                    found = connector.search(q, moves)
            taken = connector.take(found, patience)
        if not taken:
            if code in codes.HAS_NO_PATH:
                self._tight.held_in = self.frame.number
            trouble = start_trouble(self.robot, self.frame.q, code)
            return self._hold(begun, closed, trouble)
        corners = path.q[: len(path)].copy()
        corners[0] = q
        following = path.followed and path.is_same
        path.followed = True
        status, surface = FOLLOWING if following else REPLANNED, _surface(closed)
        stage = stage_of(code, corners)
        told = Verdict(status, path.goal, surface, stage, self.held_by)
        return self._answer(corners, told, begun)

    def _hold(self, begun: int, closed: bool, trouble: str | None) -> Answer:
        self.path.followed = False
        why, surface = self._reasons(trouble), _surface(closed)
        told = Verdict(HOLDING, None, surface, None, self.held_by, why)
        return self._answer(self._nowhere, told, begun)

    def _reasons(self, trouble: str | None) -> Reasons:
        state = trouble, self.connector.progress, self._frames_to_wait
        return Reasons(self.frame, self.attacher, self._retreat, *state)

    def _frames_to_wait(self) -> int:
        return self.decision.frames_to_wait(self.connector.frames_to_persist)

    def _answer(self, path: np.ndarray, told: Verdict, begun: int) -> Answer:
        counted = self._memory.counted.tobytes()
        answer = self.last = Answer(path, told, begun, perf_counter_ns(), counted)
        return answer

    def improve(self, budget: int = 4, ahead: np.ndarray | None = None) -> int:
        """Better the path between two frames; return how many changes were found.

        Call it after the answer was sent. It looks for a better goal and a shorter
        path, and makes the path in use quicker. A path that was found is a candidate:
        the next frame takes that path if it is free then, and otherwise goes on as
        before. After a frame that held because there was no path, `improve` goes on
        with that search instead, and returns 1 where a path was found.

        Args:
            budget: Tests of motions and searches at most. Same frames and budgets, same
                answers: it counts work, no seconds.
            ahead: (dof,) where the next frame will be asked from, if that is known:
                the path up to there stays. None leaves what the robot reaches soon.

        Raises:
            BadInput: The budget is no whole number from 0, or `ahead` has the wrong
                length.
        """
        self._memory.owner.check()
        budget = check_number("the budget of improve", budget, 0, 10**6, whole=True)
        if ahead is not None:
            ahead = check_configuration(self.robot, ahead, None)
        if self.scene.waiting:
            self.scene.test_waiting(self._shares.items_per_test * budget)
        if self.frame.trouble is not None or self.decision.only_seen:
            return 0
        attacher, connector = self.attacher, self.connector
        waits = budget > 1 and (attacher.waits or connector.lacks_cells)
        later = attacher.after_path(budget) if waits else 0
        if not self.path.followed:
            found = int(self._tight.look(budget))
            found = found or connector.improve(budget - later)
            if not found:
                attacher.join_more(later)
            return found
        if self.always_replan:
            made = self._improver.cut(budget - later)
        else:
            if self.last is not None and self.last.status == REPLANNED:
                self._improver.note_search()
            made = self._improver.run(budget - later, ahead)
        if later and connector.lacks_cells:
            later -= connector.sweep_cells(later)
        attacher.join_more(later)
        return made

    def reset(self) -> None:
        """Forget the path in use and where the robot was; the goals stay."""
        self._memory.owner.check()
        self._tight.forget()
        self.path.reset()
        self.attacher.forget_start()
        self.connector.reset()
        self._improver.reset()
        recent.forget_recent(self._memory.recent)
        self._numbers.present_only[0] = self._numbers.frames_to_persist[0] = 0
        self.frame.watch.reset()
        self.last = None

    # --- what it remembers ------------------------------------------------------

    def save_memory(self) -> dict[str, np.ndarray]:
        """Return all that is remembered between frames, as arrays by name.

        `numpy.savez(file, **planner.save_memory())` writes it to a file. Loaded into
        a fresh planner on the same map, with the same settings, hand, base and place,
        it makes that one answer as this one will.
        """
        self._memory.owner.check()
        return pack(self._remembering(), self._setting())

    def load_memory(self, saved: Mapping[str, np.ndarray]) -> None:
        """Go on as the planner whose memory was saved; see `save_memory`.

        The last frame is that planner's, too, so questions can be asked at once; one
        with shapes no more where `set_base` or `set_extra_clearance` comes before the
        next frame: then they are answered with no.

        Args:
            saved: What `save_memory` returned, or what `numpy.load` made of it.

        Raises:
            BadInput: It is damaged, or was saved with another map, other settings,
                another hand, base, place or clearance; nothing is changed then.
        """
        self._memory.owner.check()
        unpack(saved, self._remembering(), self._setting())
        self.last = None

    def _set_rules(self) -> None:
        """Tell the compiled loops what the user set."""
        s, rules = self.settings, self._memory.rules
        rules.hysteresis[0], rules.history_s[0] = s.hysteresis, s.history_s
        rules.close_test_connections[0], rules.confirmations[0] = (
            s.close_test_connections,
            s.confirmations,
        )
        rules.rings[0] = math.ceil(s.history_clearance / self.cell_map.safety.h - 1e-9)
        rules.persistence_frames[0] = s.persistence_frames
        rules.large[0] = LARGE

    def _remembering(self) -> dict[str, Remembers]:
        """Return who owns what is remembered, by name; arrays first, frame last."""
        return {
            "state": StateArrays(self._memory),
            "attachments": self.attacher,
            "path": self.path,
            "decision": self.decision,
            "improving": self._improver,
            "search": self.connector,
            "tight": self._tight,
            "scene": self.carrier,
            "frame": self.frame,
        }

    def _setting(self) -> dict[str, bytes]:
        """Return what a memory is good for, by what it is called in messages."""
        rules = self.settings, self.always_replan, self._tight.used
        thing = self.frame.thing
        hand = () if thing is None else (thing.spheres, thing.shell)
        return {
            "map": _told_apart(self.cell_map),
            "settings": repr(rules).encode(),
            "base": self.world.T_world_base.tobytes(),
            "place": self.scene.identity(),
            "hand": b"".join(part.tobytes() for part in hand),
            "clearance": repr(self.extra).encode(),
        }

    # --- changes between frames -------------------------------------------------

    def attach(self, thing: object, T_tool_object: np.ndarray | None = None) -> None:
        """Take an object into the hand: from now on all motions are tested with it.

        Edges are judged by the cells of the map's payload envelope, all other motions
        by the spheres of the object. Without a payload layer no edge is used: only
        straight motions and the search beyond the roadmap, which is slower and just as
        proved; `held_by` and `answer.held` say which it is. The object may touch the
        links of the tool's body, no others, and no scenery. The path in use is dropped;
        the goals are joined anew in the next frame.

        Args:
            thing: (n, 4) spheres, centre and radius [m]; a shape of `odm`; or what
                `odm.carried_object` made of one, which saves the time for its cover.
            T_tool_object: (4, 4) where it is held, tool frame; None: at the tool.

        Raises:
            BadInput: Something is attached already, the object is larger than the map's
                envelope (both sizes are named), or there is neither a payload layer nor
                a search beyond the roadmap.
        """
        self.memory.owner.check()
        T = np.eye(4) if T_tool_object is None else T_tool_object
        if self.cell_map.payload is None and not self.settings.search:
            raise BadInput(
                f"map {self.cell_map.recipe.name} has no payload layer, and search is "
                "0 in the planner's settings, so no motion would be left; set search "
                "to 1000, or add a [payload] table to the recipe and build it again"
            )
        with self.memory.owner.changing("attach"):
            self.carrier.attach(thing, T)
            self._hand_changed()

    def detach(self) -> None:
        """Let go of what is attached; the path in use is dropped.

        Raises:
            BadInput: Nothing is attached.
        """
        with self.memory.owner.changing("detach"):
            self.carrier.detach()
            self._hand_changed()

    @property
    def attached(self) -> np.ndarray | None:
        """(n, 4) spheres of what is attached, tool frame [m]; None for nothing."""
        thing = self.frame.thing
        return None if thing is None else thing.spheres

    @property
    def held_by(self) -> str | None:
        """What tests the attached object: "payload layer", "close test", or None."""
        if self.frame.thing is None:
            return None
        return CLOSE_TEST if self.cell_map.payload is None else LAYER

    def _hand_changed(self) -> None:
        """Throw away what was planned and found with another hand."""
        self._said = None  # by what the hand is kept clear is part of what is told
        self.candidates.forget_all()
        self.attacher.hand_changed()
        if self._approacher is not None:
            self._approacher.legs.forget_fine()
        self.reset()

    def set_extra_clearance(self, extra: float) -> None:
        """Keep more distance from the frame's points and from `set_static`'s scenery.

        Cells are dilated and the close test's radii grow, so a larger value never
        frees anything. The recipe's own scenery keeps the map's clearance.

        Args:
            extra: Distance beyond the map's clearance m [m], 0 to 0.5.

        Raises:
            BadInput: Out of range.
        """
        self.memory.owner.check()
        if not is_between(extra, 0.0, MOST_EXTRA):
            raise BadInput(
                f"an extra clearance of {extra} m is not between 0 and {MOST_EXTRA} m; "
                "give metres"
            )
        with self.memory.owner.changing("set_extra_clearance"):
            self.frame.set_extra(extra)
            if self._approacher is not None:
                self._approacher.legs.forget_fine()
            self.carrier.set_extra(self.extra)
            self.scene.lay_out()

    def set_base(self, T_world_base: np.ndarray) -> None:
        """Say where the base stands: points and poses are given in the world from here.

        That holds for the points of `step` and `blocked_leg`, for `set_static` (also
        for what was set before: it stays where it is in the world) and the poses of
        `approach`. The recipe's own scenery moves with the base. Call it between runs;
        the path in use is dropped.

        Args:
            T_world_base: (4, 4) pose of the base in the world [m].

        Raises:
            BadInput: Not a rigid motion.
        """
        with self.memory.owner.changing("set_base"):
            self.frame.set_base(T_world_base)
            self.scene.lay_out()
            self.reset()

    def set_static(self, points_or_shapes: object) -> None:
        """Set the scenery of this place, once: (n, 3) points or closed shapes.

        Points must cover their surfaces within the map's rho. Nodes and edges that
        the scenery blocks are closed for good; call again to replace it. What comes and
        goes, or is to be told by name, belongs into `scene`, and so does what may be
        large enough to hold the whole robot: here only the surfaces of shapes count.
        """
        with self.memory.owner.changing("set_static"):
            self.scene.set_static(place_points(points_or_shapes, self.rho))

    # --- what it is asked between frames ---------------------------------------

    def is_free(
        self,
        q_a: np.ndarray,
        q_b: np.ndarray,
        phase: str | None = None,
        by_links: bool = False,
    ) -> Freedom:
        """Test the straight motion from q_a to q_b: all four tests, all the way.

        Limits, self-collision, scenery (the recipe's and set_static's) and the last
        frame's points, with the motion bound over the whole length.

        Args:
            q_a: (dof,) start [rad or m].
            q_b: (dof,) end.
            phase: "give" lets the payload touch CONTACT points, "receive" the finger
                pads OBJECT points; see `odm.frame.last_phase`.
            by_links: Let the links' own hulls decide where the frame is too near to
                their cover, as on the legs of `Answer.by_links`; not in a phase.

        Raises:
            BadInput: Wrong length or not finite, or a phase that cannot be.
        """
        self.memory.owner.check()
        by_links = check_yes("by_links", by_links)
        found = is_free(self.frame, q_a, q_b, phase, self._last_phase)
        if by_links and found.failed == "frame" and phase is None:
            q = check_numbers(self.robot, q_a)
            links = self._links.clear(q, self.frame.difference(q, q_b))
            return Freedom(True) if links and self.trouble is None else found
        return found

    def approach(
        self,
        T_base_tool: np.ndarray,
        q: np.ndarray | None = None,
        distance: float = 0.15,
        direction: np.ndarray | None = None,
        phase: str | None = None,
    ) -> Approach:
        """Find a straight tool motion to a pose, every leg proved free.

        Scenery and the last frame's points count. The first call prepares for seconds.

        Args:
            T_base_tool: (4, 4) where the tool ends, base frame [m] (the world's after
                `set_base`, as the direction).
            q: (dof,) where the motion starts; None finds the start, too: `distance`
                back from the pose.
            distance: Length of the motion where q is None [m].
            direction: (3,) which way the tool moves, base frame; None: along its z.
            phase: As in `is_free`; where q is None, the line starts where none
                of the points is touched.

        Raises:
            BadInput: The pose is not rigid, q, distance or direction is out of range.
        """
        self.memory.owner.check()
        if self._approacher is None:
            self._approacher = Approacher(self.frame)
        T = self.world.pose(check_pose(T_base_tool, "T_base_tool"))
        if direction is not None:
            direction = self.world.direction(as_floats("the direction", direction))
        return self._approacher.run(T, q, distance, direction, phase)

    def stands_clear(self, q: np.ndarray, extra: float = 0.0) -> bool:
        """Return whether the robot would keep clear of the last frame's points at q.

        The part of `is_free` that changes from frame to frame: limits, self-collision
        and scenery are not looked at. Points outside the grid count as well.

        Args:
            q: (dof,) [rad or m].
            extra: Distance to keep besides rho and m [m].

        Raises:
            BadInput: Wrong length or not finite; `extra` is negative or not finite.
        """
        self.memory.owner.check()
        q = check_numbers(self.robot, q)
        check_number("extra [m]", extra, 0.0, 10.0)
        if self.trouble is not None:
            return False
        return self.frame.motion_clear(q, np.zeros_like(q), more=extra)

    def separation(self, q: np.ndarray) -> float:
        """Return the smallest distance of the cover at q from the frame's points [m].

        And from its shapes; also from what is outside the grid. Infinity where there is
        nothing; minus infinity after a frame that could not be used: then the person
        may be anywhere.

        Raises:
            BadInput: Wrong length or not finite.
        """
        self.memory.owner.check()
        q = check_numbers(self.robot, q)
        return -np.inf if self.trouble is not None else self.frame.separation(q)

    def invalid_nodes(self) -> np.ndarray:
        """Return the ids of the nodes that the frame invalidates, ascending.

        By cells alone, those near its surfaces: a node wholly inside of a shape is not
        among them where its surface is far, but every motion that leads there is. All
        of them after a frame that could not be used, and while something is held of
        which no cells know: without a payload layer.
        """
        if self._cells_know_little:
            return np.arange(self.direct.n_nodes)
        return self.direct.nodes().copy()

    def invalid_edges(self) -> np.ndarray:
        """Return the ids of the edges that it invalidates, as `invalid_nodes` does."""
        if self._cells_know_little:
            return np.arange(self.direct.n_edges)
        return self.direct.edges().copy()

    @property
    def _cells_know_little(self) -> bool:
        return self.trouble is not None or self.held_by == CLOSE_TEST

    def blocked_leg(
        self,
        path: np.ndarray,
        extra: float = 0.0,
        points: np.ndarray | Obstacles | None = None,
        phase: str | None = None,
        classes: np.ndarray | None = None,
        escape: bool = False,
        nearer: float = 0.0,
    ) -> int | None:
        """Return the first leg of a path that points block, or None.

        The close test of braking: the whole path must keep `extra` [m] more than rho
        and m from every point, since the person moves while the robot stops. What is
        not known blocks: a path, an `extra` or a point that is not finite, and a last
        frame that could not be used where no points are given.

        Args:
            path: (k, dof) corners [rad or m]; a single one is a robot at rest.
            extra: Distance the points may have come nearer meanwhile [m]; down to -m
                for a robot that may come as near as touch.
            points: (n, 3) where they are then [m], also outside the grid; or
                `odm.Obstacles`. None: what is in the frame, where it is.
            phase: As in `is_free`.
            classes: (n,) of `points`, where they are given.
            escape: In a phase: what is too near where a leg begins only must not come
                nearer along it.
            nearer: In no phase: shapes of the class odm.OBJECT may be so much nearer
                [m], 0 or more, if `extra` less that is -m or more.

        Raises:
            BadInput: No path, points of another shape, an `extra` below -m, a phase
                that cannot be, `nearer` in one, or bad classes.
        """
        self.memory.owner.check()
        asked = path, extra, points, phase, classes, escape, nearer
        return self._path_test.blocked_leg(*asked)

    def evasion(
        self,
        q: np.ndarray,
        coming: Sequence[tuple[float, np.ndarray | Obstacles]],
        speed_scale: float,
    ) -> np.ndarray | None:
        """Return a (2, dof) motion from q that evades what comes, or None.

        See `odm.planner.retreat.Retreat.evasion`.
        """
        self.memory.owner.check()
        return self._retreat.evasion(q, coming, speed_scale)

    def clear_of_others(
        self, path: np.ndarray, extra: float, known: np.ndarray
    ) -> bool:
        """Return whether a path away is clear of what else the frame holds.

        For a retreat that is tested against who moves: what is seen beside them is not
        part of that test. What is too near where the path begins must only not come
        nearer. False after a frame that could not be used.

        Args:
            path: (k, dof) corners [rad or m]; a single one is a robot at rest.
            extra: Distance that is kept beyond rho and m [m]; down to -m.
            known: (k, 7) capsules [ax ay az bx by bz r], where `step` has its obstacles
                [m]: what is within one of them is not asked, such as a person whose
                motion is known. Within one that is not finite there is nothing.

        Raises:
            BadInput: A path or capsules of another shape, or an `extra` that is no
                number.
        """
        self.memory.owner.check()
        path = check_path(self.robot, path)
        check_distance(extra)
        known = as_floats("the capsules that are known", known)
        if known.ndim != 2 or known.shape[1] != 7:
            raise BadInput(
                f"the capsules that are known have shape {known.shape}; give (k, 7)"
            )
        return self._retreat.clear_of_others(path, extra, known)

    def cover(self) -> Cover:
        """Return the spheres of the map's cover, payload included.

        They are copies: who writes into them changes no test.
        """
        self.memory.owner.check()
        cover = self.frame.cover()
        arm = type(cover.arm)(*(part.copy() for part in cover.arm))
        return cover._replace(arm=arm, radii=cover.radii.copy(), bare=cover.bare.copy())


def _scene_changed(
    carrier: Carrier,
    attacher: Attacher,
    connector: Connector,
    new: str | None,
    anew: bool,
) -> None:
    """Let go of all motions that what is new in the scene blocks.

    Where something was taken away, goals are attached anew if motions to them had
    been refused; and in any case where all is placed `anew`. No method of the planner:
    who held one would hold the planner, whose memory is freed with its last user.
    """
    frame = attacher.frame
    if new is not None:
        items, static = carrier.items, frame.static
        attacher.keep_clear(lambda q, dq: items.motions_clear(new, q, dq, static))
    elif anew or attacher.lacks_motions:
        attacher.forget_all()
    attacher.forget_start()
    connector.reset()
    frame.mark()  # verdicts on items are void


def stage_of(code: int, path: np.ndarray) -> str:
    """Return what found a path, where a frame came to that code."""
    if code == _FOLLOWING:
        return IN_USE
    if code != _PLANNED:
        return SEARCH
    return STRAIGHT if len(path) == 2 else ROADMAP


def _surface(closed: bool) -> str:
    return WHOLE if closed else VISIBLE


def _told_apart(cell_map: CellMap) -> bytes:
    """Return what tells a map from others, stored or not."""
    roadmap = cell_map.roadmap
    arrays = roadmap.nodes, roadmap.edges, cell_map.arm_cells.start
    words = cell_map.robot.fingerprint(), repr(cell_map.recipe)
    return b"".join([*(w.encode() for w in words), *(a.tobytes() for a in arrays)])
