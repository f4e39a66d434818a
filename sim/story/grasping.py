"""Where the robot grasps an object that somebody holds out, found a little a frame."""

import math
from dataclasses import dataclass

import numpy as np

from handover.targets.allowance import Allowance
from handover.targets.node_index import NodeIndex
from odm.checks import OBJECT
from odm.close_test.static import StaticTest
from odm.obstacles.obstacles import Obstacles
from odm.planner.planner import ReactivePlanner
from roadmap.geometry.gaps import ball_gaps, moved_rods
from roadmap.kinematics.forward import cover_balls, difference
from sim.story.frame import Seen
from sim.story.phase import PhasePlanner
from sim.story.robot_hand import is_valid
from sim.story.settings import ConductSettings, GraspingSettings, StorySettings

_GRASPING = GraspingSettings()


@dataclass(frozen=True, eq=False)
class Reach:
    """A configuration at an object, and one straight before it."""

    q: np.ndarray  # (dof,) at the object [rad or m]
    q_before: np.ndarray  # (dof,) `back` or more before it, along the tool's z
    T_tool_object: np.ndarray  # (4, 4) how the object is held there
    grasp: int = 0  # which of the grasps that is
    # how much more than the clearance the cover keeps from the object at `q_before` [m]
    room: float = np.inf


def straight_back(
    planner: ReactivePlanner,
    T_base_tool: np.ndarray,
    q: np.ndarray,
    back: float,
    settings: GraspingSettings = _GRASPING,
) -> np.ndarray | None:
    """Return (dof,) with the tool `back` [m] behind a pose, near q; None: none."""
    T = np.array(T_base_tool)
    T[:3, 3] -= back * T[:3, 2]
    for found in _ik(planner, T, q, settings):
        if np.abs(planner.frame.difference(q, found)).max() <= settings.straight:
            if is_valid(planner, found):
                return found
    return None


class Reaches:
    """Looks for configurations at an object, one start of the search a call.

    Args:
        planner: The planner; its scenery counts.
        index: Nodes of its roadmap by pose of the tool.
        grasps: (n, 4, 4) T_tool_object of the grasps that may be used.
        back: Distance before the object [m].
        thing: The object, made by `odm.carried_object`, if it is taken away from there:
            robot and scenery must leave room for it; None: it stays.
        rods: (k, 7) the object's capsules, object frame [m]; None: none to keep from.
        room: Distance beyond the clearance that the cover keeps from those before the
            object [m], since nearer to it the robot creeps. The way back is made longer
            for it; configurations without that room come last.
        on: Solid of the scenery that the object stands on, which it may touch on the
            straight way; None: nothing. It counts where there is a `thing`.
        settings: How hard.
        first: How many of the grasps come first; the others are tried where these lead
            nowhere. None: all.

    Attributes:
        found: What is known at the present pose.
    """

    def __init__(
        self,
        planner: ReactivePlanner,
        index: NodeIndex,
        grasps: np.ndarray,
        back: float,
        thing: object = None,
        rods: np.ndarray | None = None,
        room: float = 0.0,
        on: int | None = None,
        settings: GraspingSettings = _GRASPING,
        first: int | None = None,
    ) -> None:
        self.settings = settings
        self._first = len(grasps) if first is None else first
        self.planner, self.index, self.back = planner, index, back
        self._rods, self._room = rods, room
        self.T_tool_object = np.array(grasps)
        self._held: list[StaticTest] = []  # the robot with it, for each grasp
        if thing is not None and planner.attached is not None:
            self._held = [planner.static] * len(self.T_tool_object)
        elif thing is not None:
            made = planner.carrier.test_with
            self._held = [made(thing, grasp) for grasp in self.T_tool_object]
        self._on = on
        if on is not None:
            self._held = [test.beside(on) for test in self._held]
        self._T_object_tool = np.linalg.inv(self.T_tool_object)
        self.found: list[Reach] = []
        self._tight: list[Reach] = []  # those that lack room
        self._passed: list[Reach] = []  # those that somebody is in the way of
        self._queue: list[tuple[int, int | np.ndarray]] = []  # grasp; seed, or which
        self._starts = list(self._queue)  # all of them, for a shorter way back
        self._later = list(self._queue)  # of the grasps that come last
        self._share = 0  # which of the shares of the way back
        self._seeds = settings.seeds  # near nodes of each grasp, so far
        self._nodes: dict[int, np.ndarray] = {}
        self._T: np.ndarray | None = None

    @property
    def at(self) -> np.ndarray | None:
        """(3,) the object's place that `found` is for [m]."""
        return None if self._T is None else self._T[:3, 3]

    def begin(self, T_base_object: np.ndarray, q: np.ndarray) -> None:
        """Begin anew for an object that is elsewhere now; do one start.

        What was found may only have to be moved, so its configurations come first; then
        q (dof,), then near nodes.
        """
        near = [(r.grasp, r.q) for r in self.found[:2]]
        self._T, self.found, self._nodes = np.array(T_base_object), [], {}
        self._tight, self._passed = [], []
        all_, first = len(self._T_object_tool), self._first
        self._queue = self._starts_of(range(first), near, q)
        self._later = self._starts_of(range(first, all_), near, q)
        self._starts, self._share = list(self._queue), 0
        self._seeds = self.settings.seeds
        self.work()

    def outdate(self) -> None:
        """Let all be looked for anew: the object has left what they were found for."""
        self._T = None

    def first(self, T_base_object: np.ndarray, q: np.ndarray) -> list[Reach]:
        """Begin anew, and look until something is found or nothing is left."""
        self.begin(T_base_object, q)
        while not self.over and not self.found:
            self.work()
        return self.found

    def _starts_of(
        self, grasps: range, near: list[tuple[int, np.ndarray]], q: np.ndarray
    ) -> list[tuple[int, int | np.ndarray]]:
        """Return the starts for some grasps: found before, q (dof,), near nodes."""
        seeds = [(known, seed) for known, seed in near if known in grasps]
        seeds += [(g, seed) for known, seed in near for g in grasps if g != known]
        seeds += [(g, np.array(q)) for g in grasps]
        nodes = ((g, k) for k in range(self.settings.seeds) for g in grasps)
        return [*seeds, *nodes]

    def work(self) -> bool:
        """Do one start; return whether something new was found."""
        if self._T is None or self.over:
            return False
        g, k = self._queue.pop(0)
        found = self._start(g, k) or self._take_tight() or self._take_passed()
        if not self._queue and not self.found:
            self._go_on()
        return found

    def _go_on(self) -> None:
        """Queue what is left to try where nothing was found, if there is anything.

        A shorter way back, then the grasps that come last, then twice as many nodes.
        """
        if self._share + 1 < len(self.settings.shares):
            self._queue, self._share = list(self._starts), self._share + 1
        elif self._later:
            self._queue, self._later = self._later, []
        elif self._seeds < self.settings.most_seeds:
            before, most = self._seeds, self.settings.most_seeds
            self._seeds, self._nodes = min(2 * before, most), {}
            n = range(len(self._T_object_tool))
            self._queue = [(g, k) for k in range(before, self._seeds) for g in n]

    def _take_tight(self) -> bool:
        """Take those that lack room, once there are no others and will be none."""
        if self._queue or self.found or not self._tight:
            return False
        self._tight.sort(key=lambda reach: -reach.room)
        self.found, self._tight = self._tight[: self.settings.kept], []
        return True

    def pass_by(self) -> bool:
        """Look for others than those found: all are blocked; False: none are left.

        Once there are none, those found are what there is, again.
        """
        if not self._queue:
            return False
        self._passed, self.found = self._passed + self.found, []
        return True

    def _take_passed(self) -> bool:
        """Take those passed by again, once there are no others and will be none."""
        if self._queue or self.found or not self._passed:
            return False
        self.found, self._passed = self._passed, []
        return True

    def _start(self, g: int, k: int | np.ndarray) -> bool:
        """Begin at a configuration, or at the k-th of the nodes near a grasp."""
        if isinstance(k, np.ndarray):
            found = self._try(g, k)
            if found:  # the others would mostly find it again
                self._queue = [one for one in self._queue if isinstance(one[1], int)]
            return found
        if g not in self._nodes:
            T = self._T @ self._T_object_tool[g]
            self._nodes[g] = self.index.nearest(T, self._seeds)
        nodes = self._nodes[g]
        return k < len(nodes) and self._try(g, self.index.nodes[nodes[k]])

    @property
    def over(self) -> bool:
        """Whether all has been tried."""
        return not self._queue or len(self.found) >= self.settings.kept

    def is_ready(self, goal: np.ndarray) -> bool:
        """Whether setting a goal is cheap now, or preparing it would not help."""
        few = self.planner.settings.cached_goals < 2 * self.settings.kept
        return few or self.planner.is_prepared(goal)

    def drop(self, reach: Reach) -> None:
        """Leave one out: it is blocked."""
        self.found = [r for r in self.found if r is not reach]
        self._take_tight()
        if not (self._queue or self.found):
            self._go_on()

    def moved_to(self, reach: Reach, T_base_object: np.ndarray) -> np.ndarray | None:
        """Return (dof,) with the same grasp where the object is now, near the old."""
        T = T_base_object @ np.linalg.inv(reach.T_tool_object)
        for q in _ik(self.planner, T, reach.q, self.settings):
            if np.abs(self.planner.frame.difference(reach.q, q)).max() < 0.3:
                return q
        return None

    def _try(self, grasp: int, seed: np.ndarray) -> bool:
        planner = self.planner
        T = self._T @ self._T_object_tool[grasp]
        for q in _ik(planner, T, seed, self.settings):
            others = self.found + self._tight + self._passed
            known = [np.abs(planner.frame.difference(q, r.q)).max() for r in others]
            if min(known, default=1.0) < 0.1 or not is_valid(planner, q, bare=True):
                continue
            before, room = self._before(T, q)
            if before is None or not self._can_come(q, before):
                continue
            if self._can_leave(grasp, q, before):
                reach = Reach(q, before, self.T_tool_object[grasp], grasp, room)
                tight = room < self._room
                (self._tight if tight else self.found).append(reach)
                return not tight
        return False

    def _before(self, T: np.ndarray, q: np.ndarray) -> tuple[np.ndarray | None, float]:
        """Return (dof,) before a grasp at T (4, 4), and what room it has there [m].

        As far as it needs for its room; where no way is so long, with the most of it.
        """
        best, most = None, -np.inf
        far = self.back * self.settings.shares[self._share]
        for _ in range(self.settings.lengths):
            before = straight_back(self.planner, T, q, far, self.settings)
            if before is None:
                break
            room = self._room_at(before)
            if room > most:
                best, most = before, room
            if room >= self._room:
                break
            far += self._room - room + self.settings.more
        return best, most

    def _room_at(self, q: np.ndarray) -> float:
        """Return what the cover keeps from the object besides the clearance [m]."""
        if self._rods is None:
            return np.inf
        robot = self.planner.robot
        balls = cover_balls(robot, q)[robot.moving]
        gaps = ball_gaps(balls, moved_rods(self._rods, self._T))
        return float(gaps.min()) - self.planner.keep

    def _can_come(self, q: np.ndarray, before: np.ndarray) -> bool:
        """Whether the straight way to the object is free beside the object itself.

        By the rules of the last phase: pads may touch it, the rest of the hand keeps 1
        cm and the arm its clearance.
        """
        planner = self.planner
        if self._rods is None or planner.attached is not None:
            return True
        there = Obstacles(capsules=moved_rods(self._rods, self._T))
        there.shape_classes[:] = OBJECT
        way = np.array([before, before + planner.frame.difference(before, q)])
        return planner.blocked_leg(way, 0.0, there, "receive") is None

    def _can_leave(self, grasp: int, q: np.ndarray, before: np.ndarray) -> bool:
        """Whether the straight way back is free with the object in the hand."""
        if not self._held:
            return True
        planner, test = self.planner, self._held[grasp]
        bare, dq = planner.carrier.bare, planner.frame.difference(q, before)
        test.share_place(bare)
        # the hand is of one body with what it holds, and that may touch a solid
        if self._on is not None and not bare.motion_free(q, dq):
            return False
        return test.motion_free(q, dq)


class Offer:
    """What somebody holds out: the grasps that are known, and the one that is gone to.

    Args:
        view: The planner, by the rules of the phase.
        reaches: Looks for grasps of it.
        settings, conduct: See `sim.story.settings`.
        allowance: What a frame may yet do.

    Attributes:
        taken: How it is grasped, or was; None: that is not known.
        tried: How often no motion to it was free, in a row.
    """

    def __init__(
        self,
        view: PhasePlanner,
        reaches: Reaches,
        settings: StorySettings,
        conduct: ConductSettings,
        allowance: Allowance,
    ) -> None:
        self.view, self.reaches, self.allowance = view, reaches, allowance
        self.settings, self.conduct = settings, conduct
        self.taken: Reach | None = None
        self.tried = 0
        self._free_lines: list[tuple[Reach, bool]] = []  # looked at last comes last
        self._out_of_line = False  # the straight motion does not lead to it any more
        self._line: tuple[np.ndarray, np.ndarray] | None = None  # (3,) where to, (dof,)
        self._braked = 0  # frames for which it has been braked on its way
        self._due = True  # whether grasps are looked for again, once there is time

    def forget(self, blocked: bool) -> None:
        """Choose anew how it is grasped; `blocked`: no motion to it was free."""
        self.tried = self.tried + 1 if blocked else 0
        if blocked and self._out_of_line:
            self.reaches.outdate()  # it has turned, or moved a little: anew for there
        elif blocked and self.taken is not None:
            self.reaches.drop(self.taken)
        self.taken, self._out_of_line = None, False

    def moved(self, T: np.ndarray | None) -> bool:
        """Whether it is at T (4, 4), away from where its grasps were found for.

        Or, where none was, a little off: at the end of the robot's reach that decides.
        """
        reaches, at, least = self.reaches, self.reaches.at, self.settings.follow
        if T is None or at is None:
            return T is not None and at is None
        if reaches.over and not reaches.found:
            least = min(least, self.conduct.tracked)
        off = T[:3, 3] - at
        return math.sqrt(off @ off) > least

    def follow(self, T: np.ndarray, q: np.ndarray) -> None:
        """Look anew for grasps of it at T (4, 4), for a robot at q (dof,)."""
        self.allowance.spend(self.allowance.takes.reach)
        self.reaches.begin(T, q)
        self.taken = None

    def in_order(self, seen: Seen, q: np.ndarray, looks: bool) -> list[Reach]:
        """Return the grasps that may be gone to from q (dof,), the best first.

        `looks`: whether there is time to test a straight motion.
        """
        reaches = self.reaches
        found = [r for r in reaches.found if reaches.is_ready(r.q_before)]
        if looks:
            self.look_along(seen, found)
        found.sort(key=lambda r: (not self._leads_on(r), self._far(q, r.q_before)))
        return found

    def look_along(self, seen: Seen, found: list[Reach]) -> None:
        """Test the straight motion of one grasp, of that looked at longest ago."""
        known = {id(reach): k for k, (reach, _) in enumerate(self._free_lines)}
        reach = min(found, key=lambda r: known.get(id(r), -1), default=None)
        if reach is None:
            self._free_lines = []
            return
        classes = np.array(self.view.classes)
        classes[seen.people :] = OBJECT
        with self.view.receiving(classes):
            free = self.view.line_free(reach.q_before, reach.q, seen.there)
        others = [one for one in self._free_lines if one[0] is not reach]
        kept = [one for one in others if any(one[0] is r for r in found)]
        self._free_lines = [*kept, (reach, free)]

    def _leads_on(self, reach: Reach) -> bool:
        """Whether the straight motion to the object was free when it was looked at."""
        return any(free for one, free in self._free_lines if one is reach)

    def _far(self, q: np.ndarray, other: np.ndarray) -> float:
        """Return how far a configuration is, in steps: small changes do not count."""
        off = np.abs(difference(self.view.planner.robot, q, other)).max()
        return round(2.0 * float(off)) / 2.0

    def prepare(self, braked: bool, waits: bool) -> None:
        """Do what takes long, as far as the frame has time; `waits`: not in this one.

        A robot that is braked for some frames looks for other grasps.
        """
        self._braked = self._braked + 1 if braked else 0
        self._due = self._due or self._braked % self.conduct.braked_every == 0
        for _ in range(self.allowance.frames):
            if self._due and not waits:
                self._due = not self._prepare()

    def _prepare(self) -> bool:
        """Do one costly thing: join a goal to the roadmap, else look for another.

        Returns:
            False where that waits for another frame.
        """
        reaches, takes = self.reaches, self.allowance.takes
        waiting = (r.q_before for r in reaches.found)
        goal = next((g for g in waiting if not reaches.is_ready(g)), None)
        if goal is None and reaches.over:
            return True
        if not self.allowance.grants(takes.reach if goal is None else takes.prepare):
            return False
        if goal is not None:
            self.view.planner.prepare_goal(goal)
        else:
            reaches.work()
        return True

    def begin_closing(self) -> None:
        """Aim the straight motion anew."""
        self._line = None

    def end_of_line(self, T: np.ndarray) -> np.ndarray | None:
        """Return (dof,) where the straight motion leads, the object at T (4, 4).

        None: it is out of its reach.
        """
        line = self._line
        if line is None or np.linalg.norm(T[:3, 3] - line[0]) > self.conduct.tracked:
            q_end = self.reaches.moved_to(self.taken, T)
            self._out_of_line = q_end is None
            self._line = None if q_end is None else (T[:3, 3].copy(), q_end)
        return None if self._line is None else self._line[1]


def _ik(
    planner: ReactivePlanner,
    T: np.ndarray,
    seed: np.ndarray,
    settings: GraspingSettings,
) -> list[np.ndarray]:
    robot = planner.robot
    seed = np.clip(seed, robot.lower, robot.upper)
    found = robot.ik(
        T,
        seed,
        attempts=1,
        steps=settings.steps,
        position_tolerance=settings.tolerance,
        rotation_tolerance=settings.tolerance,
    )
    return [np.array(one.q) for one in found]
