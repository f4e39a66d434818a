"""Handover: gives an object to a person who moves, or takes one from them.

One object with one `update(frame)`, which a simulation calls as a real robot would.
What state follows is `machine`'s table; this module finds out which signals hold and
does in each state what belongs to it, as a list of steps: go to goals by the planner,
follow a straight certified motion, close the fingers, take the object into the map.
"""

import math
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from handover.human.body import ARM_LABELS, Part
from handover.targets.allowance import Allowance
from handover.targets.live_targets import BLOCKED as OCCUPIED
from handover.targets.live_targets import THERE, LiveTargets
from handover.targets.put_down import BESET, BLOCKED, UNREACHED, Places, carries
from odm.cell_map.payload import carried_object
from odm.checks import AVOID, CONTACT, OBJECT
from odm.execution.executor import BRAKED, RETREATING, SLOWED, STANDING, Executor
from odm.execution.speed_limit import SpeedLimit
from odm.execution.threat import Threat, Watcher
from odm.frame.last_phase import gripper_links
from odm.obstacles.obstacles import Obstacles
from odm.obstacles.shapes import Shape
from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadConfiguration, BadInput
from roadmap.geometry.gaps import ball_gaps, beads, capsule_gap, moved_rods
from roadmap.kinematics.forward import cover_balls, difference, tool_pose
from roadmap.motion.motion import SetPoint
from roadmap.ranges import settings_of
from roadmap.transforms import check_pose, inverse_pose
from sim.story import machine as table
from sim.story.comfort import Berth, comfort_rods
from sim.story.frame import StoryFrame
from sim.story.grasping import (
    Reach,
    Reaches,
    box_of,
    check_grasps,
    has_room,
    is_valid,
    quarter_turns,
    straight_back,
    with_room,
)
from sim.story.machine import Machine, StoryEvent
from sim.story.phase import PhasePlanner
from sim.story.pull import PullDetector, carried_force
from sim.story.settings import (
    AT_PLACE,
    HELD_AT_PLACE,
    ConductSettings,
    StorySettings,
)

OPEN, CLOSED = "open", "closed"
_WORDS = {int(part): part.words for part in Part}
_ELSEWHERE = 0.03  # [m] covers of one object differ by less
_HANDS = [labels[0] for labels in ARM_LABELS.values()]


class Command(NamedTuple):
    """What the robot is to do until the next frame."""

    q: np.ndarray  # (dof,) set-point [rad or m]
    dq: np.ndarray  # (dof,) its velocity
    fingers: str  # "open" or "closed"


class Step(NamedTuple):
    """One thing to do in a state: "goal", "line", "grip", "take", "let" and others."""

    kind: str
    value: object = None


_STAND = Step("stand")


@dataclass
class _Seen:
    """The frame, worked out."""

    frame: StoryFrame
    there: Obstacles  # all shapes
    classes: np.ndarray  # of each
    threat: Threat | None
    people: int  # how many of its parts are the person's: they come first
    hands: np.ndarray  # (k, 7) capsules of the hand that takes part [m]
    hand_gap: float  # from the receiving hand to the object [m]
    object_speed: float  # [m/s]
    dt: float
    # threat, which parts are the arm, capsules, labels, which parts are the hand
    whole: tuple[Threat | None, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


class Handover:
    """The state machine of a hand-over, on top of planner, targets and executor.

    Args:
        planner: The planner; to take or let go of an object its settings name the
            `finger_pads`.
        targets: Where the person can take the object, and what it is: `targets.meet`.
        executor: Made with `PhasePlanner(planner)`.
        settings: See StorySettings.
        thing: The object's solid, object frame, a closed mesh of the user's or any
            shape of `odm`; None: a box around its capsules.
        T_base_place: (4, 4) the object in its place on a table, from where it is
            fetched and where it is put down [m]; or (n, 4, 4) with other places behind
            it, used when that one is not free; None: it is in the hand already, or is
            kept.
        conduct: How frames are read, and their time is shared out.

    Attributes:
        fingers: "open" or "closed": the command to the gripper.
        fetches: Whether it first takes the object from its place.
        holding: Whether the object counts as being in the hand.
        T_tool_object: (4, 4) how it is held, or was or is to be held [m].
        answer: The last answer of the planner, or what stood for one.

    Raises:
        BadInput: No finger pads, another robot's targets, a place that is no pose, an
            object in the hand that does not fit in where the robot stands, or one that
            the planner could not take into the map.
    """

    def __init__(
        self,
        planner: ReactivePlanner,
        targets: LiveTargets,
        executor: Executor,
        settings: StorySettings | None = None,
        thing: Shape | None = None,
        T_base_place: np.ndarray | None = None,
        conduct: ConductSettings = ConductSettings(),
    ) -> None:
        s = self.settings = settings_of(settings, StorySettings)
        self.conduct = conduct
        _check_pads(planner)
        _check_base(planner)
        self.planner, self.targets, self.executor = planner, targets, executor
        self.view = executor.planner
        if not isinstance(self.view, PhasePlanner):
            raise BadInput(
                "the executor was not made with a PhasePlanner, so it could not tell "
                "who may be touched; give it PhasePlanner(planner) for its planner"
            )
        executor.part_from(self.view.held_out)
        self._T_place, self._T_others = _checked_places(T_base_place)
        self._give = s.direction == "give"
        fetches = self.fetches = self._give and T_base_place is not None
        begin = table.FETCH if fetches else table.APPROACH
        self.machine = Machine(table.TABLES[s.direction], begin)
        self.fingers = CLOSED if self._give and not fetches else OPEN
        self.holding = self._give and not fetches
        _check_hand(planner, self.holding)
        self._lay_out(thing)
        if self.holding and planner.attached is None:
            planner.attach(self._carried, self.T_tool_object)
            _check_room(planner, self._rest)
        elif self.holding:
            _check_held(planner, self._carried.moved(self.T_tool_object).spheres)
        self._enter()

    def _lay_out(self, thing: Shape | None) -> None:
        """Make what is remembered between frames."""
        s, meet = self.settings, self.targets.meet
        self._obj, self._side = meet.obj, meet.settings.side
        # None where base and world are the same: rows stay as they are, to the bit
        T = meet.settings.T_world_base
        self._T_base_world = None if (T == np.eye(4)).all() else inverse_pose(T)
        self._carried = carried_object(box_of(meet.obj) if thing is None else thing)
        self.T_tool_object = np.array(meet.obj.T_tool_object)
        self._rest = np.array(self.executor.set_point.q)
        self._pull = PullDetector(s.pull)
        self._limit = SpeedLimit(self.planner.robot, s.speed) if s.slow else None
        self._watcher = Watcher(s.threat)
        self._berth = Berth(self.executor, s.threat)
        grasps = quarter_turns(meet.obj.T_tool_object, meet.obj.turns)
        index = self.targets.finder.index
        if not self._give or self._T_place is not None:
            grasps = with_room(self.planner, self._carried, grasps)
            # what is in the hand already may lie in it: nobody has to close on that
            check_grasps(self.planner, grasps, meet.obj.capsules, index.nodes)
        thing = None if self._give else self._carried
        beside = meet.obj.capsules, max(s.room, self._berth.room)
        self._grasps = grasps
        placeable = self._placeable(grasps)  # the others are taken where none reaches
        in_order = grasps[np.argsort(~placeable, kind="stable")]
        told = self.planner, index, in_order, s.back, thing
        first = int(placeable.sum()) or None
        self._reaches = Reaches(*told, *beside, first=first)
        self._taken: Reach | None = None
        self._free_lines: list[tuple[Reach, bool]] = []  # looked at last comes last
        self._tried = 0  # how often no motion to the object was free, in a row
        self._out_of_line = False  # the straight motion does not lead to it any more
        self._at_place: tuple[Reaches, int] | None = None  # of which it uses one
        self._places = Places(0)  # where it may be put down
        self._came: tuple[float, float] = 0.0, 0.0  # when to one, hindered by then [s]
        self._put = self.T_tool_object  # where it was put between the fingers
        self._line: tuple[np.ndarray, np.ndarray] | None = None  # (3,) where to, (dof,)
        self._steps: list[Step] = []
        self._at = 0  # which step
        self._begun: float | None = None  # when the step began [s]
        self._farthest = 0.0  # that the hand was from the object, in this state [m]
        self._hindered_s = 0.0  # of this state, slowed or stopped for the person [s]
        self._goals: list[np.ndarray] = []
        self._last: _Seen | None = None
        self._object_was: deque[tuple[float, np.ndarray]] = deque()  # when, where
        self._told_at = -np.inf
        self._braked = 0  # frames for which it has been braked on its way
        self._due = True  # whether grasps are looked for again, once there is time
        self._allowance = Allowance.lasting(self.executor.period)
        self._arms: tuple[bytes, np.ndarray, np.ndarray] | None = None
        self._words: list[str] = []  # what reasons call the person's parts, the object
        self._signalled: set[str] = set()  # what held in the last frame
        # (3,) where the object stands for itself; None: nowhere that is known
        self._stands_at = self._T_place[:3, 3] if self.fetches else None
        self._placeless = False  # there is no place to put the object down
        self._why_kept = ""  # what kept it from the last place it tried
        self._clock: dict[str, float] = {}  # for how long signals have held [s]
        self._now: float | None = None  # the last frame's time [s]
        self._no_time = ""  # why none passed
        self.answer: object = None

    @property
    def state(self) -> str:
        """Where the story is; see `sim.story.machine`."""
        return self.machine.state

    @property
    def events(self) -> list[StoryEvent]:
        """All that has happened."""
        return self.machine.events

    @property
    def ended(self) -> bool:
        """Whether it is over."""
        return self.machine.ended

    @property
    def reason(self) -> str:
        """Why it is where it is, or why it does not move, as a person says it."""
        held = getattr(self.answer, "status", "") == "holding"
        why = getattr(self.answer, "reason", "") if held else ""
        if why and self._step.kind == "targets" and not len(self.planner.goals):
            why = "no place within reach of both is known"
        executor = self.executor
        stands = executor.reason if not why or executor.state == STANDING else ""
        kept = self._why_kept if self.state == table.KEPT else ""
        told = [self.machine.reason, self._weak_pull(), self._too_rare(), kept, why]
        told += [stands, self._who_touches(), self._no_time]
        return "; ".join(t for t in told if t)

    def _weak_pull(self) -> str:
        """Return what to do about a pull that does not count; empty: there is none."""
        pull = self._pull
        if self.state != table.WAIT or not self._give or not pull.weak:
            return ""
        return (
            f"somebody pulls with {pull.weak:.1f} N, less than the "
            f"{pull.counts_from:.1f} N that count now: pull harder, or give a smaller "
            "force in StorySettings(pull=PullSettings(force=...)); where nobody pulls, "
            "tare the sensor, or tell what the object weighs (mass_kg)"
        )

    def _who_touches(self) -> str:
        """Return who is at a robot that waits for a hand, that arm apart; or empty."""
        last, executor = self._last, self.executor
        if last is None or self.view.phase is None or not executor.at_rest:
            return ""
        others = np.setdiff1d(np.arange(last.people), self.view.meant)
        robot, q = self.planner.static.robot, executor.set_point.q
        balls = cover_balls(robot, q)[robot.moving]
        gaps = ball_gaps(balls, last.there.capsules[others]).min(axis=0, initial=np.inf)
        if not (gaps < 0.0).any():
            return ""
        word = self._words[others[gaps.argmin()]] or "somebody"
        return f"{word} is at the robot: it stands until they are farther"

    def _too_rare(self) -> str:
        """Return what to do about frames too rare to close on an object; or empty."""
        most, berth = self.conduct.too_rare, self._berth
        told = {e.signal for e in self.events}
        vain = told & {"blocked", "in_vain", "hindered"} and "free" not in told
        if self._give or self.holding or not vain or berth.comes <= most:
            return ""
        return (
            f"with a frame every {1e3 * self.executor.period:.0f} ms it stands "
            f"{1e3 * berth.stop_s:.0f} ms after what it saw, and by then what is held "
            f"out may have come {100 * berth.comes:.1f} cm nearer (limit "
            f"{100 * most:.1f} cm): give frames more often, the robot's own limits of "
            "acceleration and jerk, or, for people who hold still, "
            "StorySettings(threat=ThreatSettings(acceleration=...)); or hold it still "
            "between the fingers"
        )

    @property
    def force(self) -> float:
        """What is felt of somebody's pull now [N]."""
        return self._pull.force

    @property
    def grasps(self) -> np.ndarray:
        """(n, 4, 4) T_tool_object of all ways to hold the object [m]."""
        return self._grasps

    @property
    def outcome(self) -> str:
        """What came of it: "handed over", or what went wrong; empty before the end."""
        if not self.ended:
            return ""
        passed = "open" if self._give else "free"
        if any(e.signal == passed and not e.failure for e in self.events):
            late = [e for e in self.events if e.signal == "lost"]
            return "handed over" if not late else late[-1].reason
        failures = [e.reason for e in self.events if e.failure]
        return failures[-1] if failures else self.machine.reason

    def update(self, frame: StoryFrame) -> Command:
        """Take a frame, decide, plan, and move on by one period of the executor."""
        executor = self.executor
        if frame.q is not None:
            executor.locate(frame.q)
        elif executor.off:
            executor.locate_nowhere()
        self._begin_frame()
        seen = self._look(frame)
        commit = executor.commit()
        self.answer = self._plan(seen, commit.q)
        if self._limit is not None and seen.threat is not None:
            self._go_gently(seen, seen.threat, self._limit)
        self.view.looked = False
        executor.update(self.answer, commit, seen.threat)
        self._spend_on(self.answer)
        self._tell(seen, self.conduct.tell_s)
        if not (self.view.looked or self.answer.status == "replanned"):
            c, allowance = self.conduct, self._allowance
            most = c.tests if executor.at_rest else c.tests_moving
            tests = min(most, allowance.left // allowance.takes.test)
            if tests > 0:
                self.planner.improve(tests, executor.next_commit())
        executor.advance()
        self._change_hands()
        point = executor.set_point
        row = self.machine.step(self._signals(seen, point), self._now)
        if row is not None:
            self._enter(row.signal)
        self._last = seen
        return Command(point.q, point.dq, self.fingers)

    def _go_gently(self, seen: _Seen, threat: Threat, limit: SpeedLimit) -> None:
        """Let the executor be as slow, and as gentle, as it has to be near a person."""
        executor, share = self.executor, 1.0
        if not executor.at_rest:
            moves = executor.motion, executor.t, executor.settings.speed_scale
            alone = seen.people == len(threat.error)
            person = threat if alone else threat.of(slice(seen.people))
            share = limit.share(*moves, person, seen.hands)
        executor.limit_speed(share)
        if self.settings.direction == "give":  # who is gentle comes late to take
            executor.limit_jerk(partial(limit.jerk_share, hands=seen.hands))

    def _begin_frame(self) -> None:
        """Take what the executor will do from what the frame may do."""
        executor, allowance = self.executor, self._allowance
        allowance.begin()
        if not executor.at_rest or executor.state == BRAKED:
            allowance.spend(allowance.takes.moves)
        if executor.looks_out:
            allowance.spend(allowance.takes.look_out)

    def _spend_on(self, answer: object) -> None:
        """Take what the answer took from what the frame may yet do."""
        allowance, asked = self._allowance, answer is self.planner.last
        if asked and self.planner.joined:
            allowance.spend(allowance.takes.join)
        if self.executor.timed_path:
            allowance.spend(allowance.takes.time_path)

    # --- what is seen -----------------------------------------------------------

    def _passed(self, now: float) -> float:
        """Return the time since the frame before [s], as far as it counts.

        A clock that was set counts as one that stood still, so nothing is late by that;
        and a late frame does not show that something lasted since the one before.
        """
        self._no_time = ""
        if self._now is None:
            self._now = now if math.isfinite(now) else 0.0
            self.machine.since = self._now
            return self.executor.period
        passed = now - self._now
        if 0.0 < passed <= self.conduct.leap_s:
            self._now = now
            return min(passed, self.conduct.periods * self.executor.period)
        self._no_time = (
            f"the clock went from {self._now:g} to {now:g} s, which does not count; "
            "give each frame its time in seconds"
        )
        if math.isfinite(now):
            self._now = now
            self.machine.since += passed
            self._begun = None if self._begun is None else self._begun + passed
        return 0.0

    def _look(self, frame: StoryFrame) -> _Seen:
        """Lay out all shapes with their classes, and follow them."""
        if self.state == table.PRESENT:  # the hand may come to what is held out
            self.view.phase = "give" if self.executor.at_rest else None
        at_place = self.state in (table.FETCH, table.PUT_DOWN)
        stands = self._step.kind in ("goal", "place", "pause")
        self.view.at_place = at_place and not stands
        if at_place:  # the pads touch the object
            self.view.phase = "receive" if self.view.at_place else None
        dt = self._passed(frame.now)
        rows, labels = frame.person(self._T_base_world)
        hand, arm = self._parts(labels)
        obj = self._object_rows(frame)
        # what the fingers hold moves with them, whether it counts as taken or not
        loose = obj is not None and not self.holding and not frame.holds
        if self.state == table.RETREAT and self._step.kind == "goal" and loose:
            if self.view.phase is not None and self._is_clear_of(obj):
                self.view.phase = None  # paths keep off it again
        classes = np.full(len(rows) + (len(obj) if loose else 0), AVOID, np.int8)
        if self.view.phase == "give":
            classes[hand] = CONTACT
        if self.view.phase == "receive":
            classes[len(rows) :] = OBJECT
        there = Obstacles(capsules=np.concatenate((rows, obj)) if loose else rows)
        there.labels = {"capsules": self._words[: len(classes)]}
        everything = there.capsules
        threat = self._watcher.look(everything, frame.now) if len(everything) else None
        speed = self._speed_of_object(frame)
        if loose:
            threat = self._as_it_stands(frame, threat, obj, speed, dt)
        whole = threat, arm, rows, labels, hand
        self.view.classes, people = classes, len(rows)
        self.view.person = everything[: len(rows)]
        offered = np.arange(len(rows), len(everything))
        self.view.meant = np.concatenate((arm, offered))
        gives = self._give and self.state != table.RETREAT
        self.view.offered = 0 if gives else len(everything) - len(rows)
        near = rows[hand]
        gap = _gap(near, obj) if obj is not None and len(hand) else np.inf
        hurries = self.conduct.hurries * self.settings.still_speed
        self.view.hurries = speed > hurries
        who = threat, people, near
        seen = _Seen(frame, there, classes, *who, gap, speed, dt, whole)
        self._tell(seen, self.conduct.late_s)
        return seen

    def _as_it_stands(
        self,
        frame: StoryFrame,
        threat: Threat,
        obj: np.ndarray,
        speed: float,
        dt: float,
    ) -> Threat:
        """Return the threat of all shapes, the object's (k, 7) last.

        An object that stands in its place, or where it was put down, is not expected to
        start off before somebody can have reached it: beside it the robot need not
        creep, least of all one that is slow to stop (decision 0099).
        """
        at, T, s = self._stands_at, frame.T_base_object, self.settings
        still = at is not None and _length(T[:3, 3] - at) < s.between
        still = still and speed < s.still_speed
        time, these = 0.0, slice(len(threat.error) - len(obj), None)
        if still:
            time = self._unreached_for(threat.of(slice(these.start)), obj)
        window = 0.0 if threat.window is None else float(threat.window[these].max())
        alone = self._lasts("alone", time >= dt and still, dt, window)
        return threat.left_alone(these, time) if alone else threat

    def _unreached_for(self, person: Threat, obj: np.ndarray) -> float:
        """Return how long nobody can get to an object (k, 7) from now on [s]."""
        balls, person = _covering_balls(obj), person.as_lately()
        for time in self.conduct.untouched:
            rows, more = person.between(0.0, time)
            if not more and (ball_gaps(balls, rows.capsules) > 0.0).all():
                return time
        return 0.0

    def _is_clear_of(self, obj: np.ndarray) -> bool:
        """Whether the robot keeps its clearance from an object (k, 7)."""
        robot, planner = self.planner.static.robot, self.planner
        balls = cover_balls(robot, self.executor.set_point.q)[robot.moving]
        return bool(ball_gaps(balls, obj).min() > planner.keep)

    def _parts(self, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return which capsules are the hand, and the arm, that takes part."""
        known = self._arms
        if known is None or known[0] != labels.tobytes():
            hand = np.flatnonzero(labels == ARM_LABELS[self._side][0])
            arm = np.flatnonzero(np.isin(labels, ARM_LABELS[self._side]))
            known = self._arms = labels.tobytes(), hand, arm
            words = [_WORDS.get(label, "") for label in labels.tolist()]
            self._words = [*words, *["the object"] * len(self._obj.capsules)]
        return known[1], known[2]

    def _tell(self, seen: _Seen, every: float) -> None:
        """Tell the planner where the person will be, if that is `every` [s] old."""
        frame, allowance = seen.frame, self._allowance
        late = abs(self._now - self._told_at)
        if late < every:
            return
        if late < self.conduct.late_s and not allowance.grants(allowance.takes.tell):
            return
        threat, arm, rows, labels, hand = seen.whole
        gaze = frame.human.gaze if frame.capsules is None else None
        told, T = {}, self._T_base_world
        if T is not None:
            told["up"], gaze = T[:3, 2], None if gaze is None else T[:3, :3] @ gaze
        rods = comfort_rods(rows, labels, hand, gaze, self.settings.comfort, **told)
        self._expect(threat, arm, rods)
        self._told_at = self._now

    def _expect(self, threat: Threat | None, arm: np.ndarray, rods: np.ndarray) -> None:
        """Tell the planner where the arm that takes part will be, while it plans."""
        if threat is None or self._step.kind in ("stand", "grip"):
            return
        likely = threat.of(arm).likely(*self.conduct.expected) if len(arm) else None
        rows = [rods] if likely is None else [likely.capsules, rods]
        expected = np.vstack(rows)
        sound = np.isfinite(expected).all() and (expected[:, 6] > 0.0).all()
        if len(expected) and sound:  # who is nowhere is not expected anywhere
            self.planner.expect(Obstacles(capsules=expected))

    def _object_rows(self, frame: StoryFrame) -> np.ndarray | None:
        """Return the capsules of the object where it is, base frame; None: unseen."""
        T = frame.T_base_object
        if self.holding:
            T = tool_pose(self.planner.robot, self.executor.set_point.q)
            T = T @ self.T_tool_object
        if T is None:
            return None
        return moved_rods(self._obj.capsules, T)

    def _speed_of_object(self, frame: StoryFrame) -> float:
        """Return how fast the object goes on [m/s]; a hand that trembles is still."""
        T, past, now = frame.T_base_object, self._object_was, frame.now
        if T is None or (past and not now >= past[-1][0]):  # or the clock went back
            past.clear()
        if T is None:
            return 0.0
        past.append((now, T[:3, 3].copy()))
        while past[0][0] < now - self.conduct.goes_on_s - 1e-6:
            past.popleft()
        (since, there), (now, here) = past[0], past[-1]
        return _length(here - there) / (now - since or 1.0)

    # --- which signals hold -----------------------------------------------------

    def _signals(self, seen: _Seen, point: SetPoint) -> set[str]:
        """Return the names of what holds now, at a set-point; see `machine.SIGNALS`."""
        s, frame = self.settings, seen.frame
        moving = _most(point.dq) > self.conduct.stands
        self._feel(seen, point, moving)
        passed = self._now - self.machine.since
        if self.executor.state in (SLOWED, BRAKED):
            self._hindered_s += seen.dt
        away = seen.hand_gap > s.gone
        limits = {table.FETCH: s.fetch_s, table.PUT_DOWN: s.put_down_s}
        limit = limits.get(self.state, s.wait_s)
        checks = {
            "lost": self._lasts("lost", self._missing(frame), seen.dt, 0.03),
            "pulled": self._pull.pulled and self._may_be_theirs(seen, moving),
            "slack": not self._pull.pulls and frame.holds and not frame.opened,
            "near": self._hand_comes(seen.hand_gap),
            "gone": self._lasts(
                "gone", away and not self._pull.pulls, seen.dt, self.conduct.gone_s
            ),
            "open": frame.opened,
            "hindered": passed > limit and 2.0 * self._hindered_s > passed,
            "under_way": passed > limit and self._is_under_way(),
            "taken_up": passed > limit and self._is_taken_up(frame),
            "unfelt": passed > limit and not self._pull.felt,
            "weak_pull": passed > limit and self._pull.weak > 0.0,
            "occupied": passed > limit and self._is_occupied(seen),
            "late": passed > limit,
            "late_holding": passed > limit and self.holding,
            "beset": passed > limit and self.holding and self._is_beset(passed),
            "blocked": self._lasts("blocked", self._is_blocked(), seen.dt, s.blocked_s),
        }
        checks["in_vain"] = checks["blocked"] and self._tried + 1 >= s.tries
        checks |= self._signals_of_place(seen, point.q)
        over = self._at >= len(self._steps) and self.executor.at_rest
        ended = over or passed > limit
        gripped = self.holding and frame.holds
        far = gripped and self._pull.pulls and self._is_far(seen)
        left = self._lasts("left_it", far, seen.dt, self.conduct.gone_s)
        unpulled = gripped and (left or not self._pull.pulls)
        empty = self.fingers == CLOSED and not frame.holds and not self.holding
        checks |= {
            "held": over and gripped,
            "free": over and self._lasts("free", unpulled, seen.dt, s.pull.hold_s),
            "missed": self._passed_grip() and empty,
            "away": over,
            "away_holding": over and self.holding,
            "placed": over and not self._placeless and not self._places.now,
            "placed_elsewhere": over and not self._placeless and self._places.now,
            "no_place": ended and self._placeless and self._T_place is None,
            "unreached": ended and self._placeless and self._T_place is not None,
        }
        self._signalled = {name for name, holds in checks.items() if holds}
        return self._signalled

    def _feel(self, seen: _Seen, point: SetPoint, moving: bool) -> None:
        """Feel the force at the wrist, knowing what weighs in the hand."""
        frame, own, taken = seen.frame, None, None
        # what was taken has a weight; its giver may pull from the first moment on
        takes = self.state == table.CLOSE and (self.holding or frame.holds)
        if takes or (self._give and self.holding):
            T_world_base = self.targets.meet.settings.T_world_base
            told = point, self.T_tool_object, self._obj.mass_kg, T_world_base
            weighs = carried_force(self.planner.robot, *told)
            own, taken = (None, weighs) if takes else (weighs, None)
        self._pull.feel(frame.wrench, seen.dt, moving, taken, own)

    def _is_occupied(self, seen: _Seen) -> bool:
        """Whether the person is within the clearance of the object in its place."""
        gaps = self._gaps_of_places(seen)
        return bool(len(gaps)) and bool(gaps[0] < self.planner.keep)

    def _is_beset(self, passed: float) -> bool:
        """Whether the person blocked the places for most of `passed` [s]."""
        return self._places.beset or 2.0 * self._hindered_s > passed

    def _is_taken_up(self, frame: StoryFrame) -> bool:
        """Whether places in reach are known to give or take it, and none is free."""
        if not self._give:
            T = frame.T_base_object
            known = T is not None and bool(self._reaches.found)
            return known and not self._object_moved(T)
        pursuit = self.targets.pursuit
        return pursuit.state == OCCUPIED and pursuit.targets > 0

    def _is_under_way(self) -> bool:
        """Whether it is moving to where it can give or take the object."""
        if self.executor.at_rest:
            return False
        if self._give:
            return self.targets.pursuit.key is not None
        return self._taken is not None

    def _may_be_theirs(self, seen: _Seen, moving: bool) -> bool:
        """Whether a pull that lasted may be what the robot waits for, where it waits.

        Not while it still moves; and not where no hand of the person is about.
        """
        return self.state != table.WAIT or not (moving or self._is_far(seen))

    def _is_far(self, seen: _Seen) -> bool:
        """Whether both hands are known to be so far from the object as to have gone."""
        rows, labels = seen.whole[2:4]
        obj, hands = self._object_rows(seen.frame), np.isin(labels, _HANDS)
        if obj is None or not hands.any():
            return False
        return bool(_gap(rows[hands], obj) > self.settings.gone)

    def _hand_comes(self, gap: float) -> bool:
        """Whether the hand, so far from the object [m], is there or on its way."""
        s = self.settings
        self._farthest = max(self._farthest, gap)
        return gap < s.near and (gap < s.comes or self._farthest - gap >= s.comes)

    def _signals_of_place(self, seen: _Seen, q: np.ndarray) -> dict[str, bool]:
        """Return what holds of where to go, for a robot at q (dof,)."""
        s, executor = self.settings, self.executor
        if self._give:
            pursuit = self.targets.pursuit
            there = pursuit.state == THERE
            nobody = pursuit.key is None and not pursuit.touched
            return {
                "arrived": there and executor.at_rest,
                "moved": not there and not nobody and not pursuit.touched,
                "left": self._lasts("left", nobody, seen.dt, s.leave_s),
            }
        pre, T = self._taken, seen.frame.T_base_object
        off = np.inf
        if pre is not None:
            off = _most(difference(self.planner.robot, q, pre.q_before))
        moved = self._object_moved(T)
        still = seen.object_speed < s.still_speed and not moved
        closing = self.state == table.CLOSE
        if closing:  # while the fingers close, it may give way a little
            moved = moved and not self.holding and self.fingers == OPEN
        return {
            "arrived": off < self.conduct.arrived and executor.at_rest and not moved,
            "moved": moved,
            "left": self._lasts("left", T is None, seen.dt, s.leave_s),
            "steady": self._lasts("steady", still, seen.dt, s.steady_s),
            "between": self._lasts(
                "between",
                seen.object_speed < s.still_speed and self._is_between(T),
                seen.dt,
                s.steady_s,
            ),
        }

    def _is_between(self, T: np.ndarray | None) -> bool:
        """Whether an object is where a grasp would have it, while the robot stands."""
        if T is None or self.holding or not self.executor.at_rest:
            return False
        T_tool = tool_pose(self.planner.robot, self.executor.set_point.q)
        T_tool_object = np.linalg.inv(T_tool) @ T
        s = self.settings
        for grasp in self.grasps:
            off = np.linalg.norm(grasp[:3, 3] - T_tool_object[:3, 3])
            if off < s.between and _turned(grasp, T_tool_object) < s.between_rad:
                # what could not be taken into the map, so held, is not closed on
                if not has_room(self.planner, self._carried, T_tool_object):
                    return False
                self._put = T_tool_object
                return True
        return False

    def _object_moved(self, T: np.ndarray | None) -> bool:
        """Whether the object has left the place that its grasps were found for."""
        at = self._reaches.at
        if T is None or at is None:
            return T is not None and at is None
        return _length(T[:3, 3] - at) > self.settings.follow

    def _lasts(self, name: str, holds: bool, dt: float, least: float) -> bool:
        """Whether something holds, and has for so long [s]."""
        self._clock[name] = self._clock.get(name, 0.0) + dt if holds else 0.0
        return self._clock[name] > least

    def _missing(self, frame: StoryFrame) -> bool:
        return self.holding and self.fingers == CLOSED and not frame.holds

    def _is_blocked(self) -> bool:
        """Whether a step that moves cannot go on."""
        kind, executor = self._step.kind, self.executor
        if not executor.at_rest:
            return False
        if kind in ("goal", "close") and executor.state == BRAKED:
            return True  # the path is free, but passes too near to somebody to be gone
        held = getattr(self.answer, "status", "") == "holding"
        return kind in ("goal", "line", "up", "back", "close") and held

    def _passed_grip(self) -> bool:
        step = self._step
        if step.kind != "grip" or step.value != CLOSED or self._begun is None:
            return False
        return self._now - self._begun > self.settings.grip_s

    # --- what is done -----------------------------------------------------------

    @property
    def _step(self) -> Step:
        return self._steps[self._at] if self._at < len(self._steps) else _STAND

    def _enter(self, signal: str = "") -> None:
        """Begin what belongs to the state."""
        state = self.state
        self._at, self._begun, self._farthest = 0, None, 0.0
        self._berth.begin()
        self._hindered_s = 0.0
        self._clock["blocked"] = self._clock["steady"] = self._clock["left"] = 0.0
        self.view.phase = None
        steps: list[Step] = []
        if state == table.FETCH:
            steps = self._fetching()
        elif state in (table.APPROACH, table.PRESENT) and self._give:
            steps = [Step("targets")]
        elif state in (table.APPROACH, table.WAIT) and not self._give:
            if state == table.APPROACH:
                self._forget_object(signal)
            steps = [Step("reach")]
        elif state == table.WAIT:
            self._pull.restart()
            self.fingers, self.view.phase = CLOSED, "give"
            steps = [_STAND, _STAND]
        elif state == table.RELEASE:
            self.fingers, self.view.phase = OPEN, "give"
            steps = [_STAND, _STAND]
        elif state == table.CLOSE:
            self._pull.forget()
            self._line = None
            steps = [Step("close"), Step("grip", CLOSED), Step("take")]
            if signal == "between":
                steps, self._taken = steps[1:], None
        elif state == table.RETREAT:
            steps = self._retreating(signal)
        elif state == table.PUT_DOWN:
            steps = self._putting_down()
        self._steps = steps
        self._goals = []

    def _forget_object(self, signal: str) -> None:
        self._tried = self._tried + 1 if signal == "blocked" else 0
        if signal == "blocked" and self._out_of_line:
            self._reaches.outdate()  # it has turned, or moved a little: anew for there
        elif signal == "blocked" and self._taken is not None:
            self._reaches.drop(self._taken)
        self.fingers, self._taken, self._out_of_line = OPEN, None, False

    def _fetching(self) -> list[Step]:
        reach = self._reach_at_place()
        if reach is None:
            raise BadInput(
                "the object's place is out of the robot's reach; give another "
                "T_base_place, or another grasp T_tool_object"
            )
        return self._fetching_by(reach)

    def _fetching_by(self, reach: Reach) -> list[Step]:
        self.T_tool_object = reach.T_tool_object
        above, at = Step("goal", [reach.q_before]), Step("line", reach.q)
        up = Step("line", reach.q_before)
        return [above, at, Step("grip", CLOSED), Step("take"), up]

    def _putting_down(self) -> list[Step]:
        """Return the steps that lead to a place, once it is known how."""
        self._placeless, self._at_place, self._why_kept = False, None, ""
        n = 0 if self._T_place is None else 1 + len(self._T_others)
        self._places = Places(n)
        if not n:
            return [Step("place")]
        return self._to_next_place(self._last)

    def _to_next_place(self, seen: _Seen | None) -> list[Step]:
        """Return the steps to the next place to try; to rest, where all were tried."""
        places = self._places
        gaps = self._gaps_of_places(seen)
        k = places.begin_next(gaps, self.planner.keep)
        self._came = self._now or 0.0, self._hindered_s
        if k is not None:
            self._at_place = self._looks_at_place(), 0
            return [Step("place")]
        self._at_place = None
        self._placeless = places.unreached
        rest = Step("goal", [self._rest])
        return [rest] if self._placeless else [rest, Step("pause", gaps)]

    def _gaps_of_places(self, seen: _Seen | None) -> np.ndarray:
        """Return (n,) how far the person is from the object in each place [m]."""
        T_places = self._all_places()
        if seen is None or not seen.people:
            return np.full(len(T_places), np.inf)
        person = seen.there.capsules[: seen.people]
        rods = [moved_rods(self._obj.capsules, T) for T in T_places]
        return np.array([ball_gaps(beads(row, 5), person).min() for row in rods])

    def _all_places(self) -> list[np.ndarray]:
        """Return the places (4, 4) where the object may be put down, its own first."""
        return [] if self._T_place is None else [self._T_place, *self._T_others]

    def _leave_place(self, seen: _Seen, why: str) -> None:
        """Go on to another place: this one cannot be come to now."""
        self._places.leave(why)
        self._why_kept = self._why_no_place(why)
        steps = self._to_next_place(seen)
        if self._step.kind == "line":  # it stands low, beside what it stands on
            steps = [Step("up", self._steps[0].value[0]), *steps]
        self._begin_steps(steps)

    def _why_no_place(self, why: str) -> str:
        """Return what keeps it from a place, as planner and executor say it."""
        held = getattr(self.answer, "status", "") == "holding"
        told = getattr(self.answer, "reason", "") if held else ""
        return told or self.executor.reason if why != UNREACHED else ""

    def _give_up_place(self, seen: _Seen) -> None:
        """Leave the place where no motion leads on, or the person is in the way."""
        places, kind = self._places, self._step.kind
        waits = places.now is None and not self._placeless
        if waits and kind == "goal" and "blocked" in self._signalled:
            self._next()  # the way to rest: it waits where it is
        if places.now is None or not self.holding or kind not in ("goal", "line"):
            return
        since, hindered = self._now - self._came[0], self._hindered_s - self._came[1]
        if since > self.settings.place_s and 2.0 * hindered > since:
            self._leave_place(seen, BESET)
        elif "blocked" in self._signalled and not self._reach_otherwise():
            braked = self.executor.state == BRAKED
            self._leave_place(seen, BESET if braked else BLOCKED)

    def _pause(self, seen: _Seen, q: np.ndarray, gaps: np.ndarray) -> object:
        """Stand until the person has moved off a place, or for a while; try anew."""
        now = self._gaps_of_places(seen)
        moved_off = (now > gaps + self.conduct.moved_off).any()
        if moved_off or self._now - self._begun > self.settings.again_s:
            self._places.forget()
            self._begin_steps(self._to_next_place(seen))
        return self._stand(seen, q)

    def _find_place(self, seen: _Seen, q: np.ndarray) -> object:
        """Look for a way to a place of the object, one costly thing a frame; stand."""
        look = None if self._at_place is None else self._at_place[0]
        grants, takes = self._allowance.grants, self._allowance.takes
        if look is None:  # it is kept
            self._placeless = True
            self._begin_steps([Step("goal", [self._rest])])
        elif look.at is None:
            if grants(takes.reach):
                look.begin(self._all_places()[self._places.now], q)
        elif not look.found and not look.over:
            if grants(takes.reach):
                look.work()
        elif not look.found:
            self._leave_place(seen, UNREACHED)
        elif not self._is_ready(look.found[self._at_place[1]].q_before):
            if grants(takes.prepare):
                self.planner.prepare_goal(look.found[self._at_place[1]].q_before)
        else:
            self._try_place(seen, look)
        return self._stand(seen, q)

    def _try_place(self, seen: _Seen, look: Reaches) -> None:
        """Set off to a place if its way down is free now; one is looked at a frame.

        The own place is waited for a little, the others are not.
        """
        k = self._at_place[1]
        reach, self.view.at_place = look.found[k], True
        with self.view.receiving(np.full(len(seen.classes), AVOID, np.int8)):
            free = self.view.line_free(reach.q_before, reach.q, seen.there)
        self.view.at_place = False
        waited = self.settings.blocked_s if self._places.now == 0 else 0.0
        if free:
            self._at_place = look, k
            self._begin_steps(self._putting_down_by(reach))
        elif k + 1 < len(look.found):
            self._at_place = look, k + 1
        elif not look.over:
            if self._allowance.grants(self._allowance.takes.reach):
                look.work()
        elif look.pass_by():
            self._at_place = look, 0
        elif self._now - self._came[0] >= waited:
            self._leave_place(seen, BESET)
        else:
            self._at_place = look, 0

    def _begin_steps(self, steps: list[Step]) -> None:
        """Go on with other steps."""
        self._steps, self._at = steps, -1
        self._next()

    def _putting_down_by(self, reach: Reach) -> list[Step]:
        return [
            Step("goal", [reach.q_before]),
            Step("line", reach.q),
            Step("grip", OPEN),
            Step("let"),
            Step("line", reach.q_before),
        ]

    def _reach_at_place(self) -> Reach | None:
        """Return how the object is grasped in its place: before the first frame."""
        self._at_place = None
        if self._T_place is None:
            return None
        look = self._looks_at_place()
        if not look.first(self._T_place, self.executor.set_point.q):
            return None
        self._at_place = look, 0
        return look.found[0]

    def _placeable(self, grasps: np.ndarray) -> np.ndarray:
        """Return with which grasps (k, 4, 4) what is taken can be put down again.

        Where there is no place all of them count.
        """
        if self._give or self._T_place is None:
            return np.ones(len(grasps), bool)
        index, s, found = self.targets.finder.index, self.settings, []
        beside = None, self._obj.capsules, s.room, None, HELD_AT_PLACE
        still = np.zeros_like(self._rest)
        for grasp in grasps:
            held = self.planner.carrier.test_with(self._carried, grasp)
            look = Reaches(self.planner, index, grasp[None], s.back, *beside)
            look.begin(self._T_place, self._rest)
            while not look.over:
                look.work()
            found.append(any(held.motion_free(r.q_before, still) for r in look.found))
        return np.array(found)

    def _looks_at_place(self) -> Reaches:
        """Return what looks for grasps in a place, with the grasp by which it is held.

        In a place that is not its own nothing may hold the object: robot and object
        come down to what it stands on, clear of all else.
        """
        held = self.T_tool_object if self.holding else None
        grasps = self._reaches.T_tool_object if held is None else held[None]
        index = self.targets.finder.index
        settings = AT_PLACE if held is None else HELD_AT_PLACE
        beside = self._obj.capsules, self.settings.room
        told = self.planner, index, grasps, self.settings.back
        if not self._places.now:
            return Reaches(*told, None, *beside, None, settings)
        T = self._all_places()[self._places.now]
        scenery = self.planner.cell_map.scenery
        on = carries(scenery, self._obj.capsules, T)
        return Reaches(*told, self._carried, *beside, on, settings)

    def _reach_otherwise(self) -> bool:
        """Go to the object's place with another grasp or arm: this one is blocked.

        One start of the search a frame; after the last one found comes the first.

        Returns:
            False where all ways to put it down there have been tried.
        """
        fetches = self.state == table.FETCH
        if self._at_place is None or (not fetches and self._at > 0):
            return False
        look, k = self._at_place
        if k + 1 == len(look.found) and not look.over:
            if self._allowance.grants(self._allowance.takes.reach):
                look.work()
            return True
        if k + 1 == len(look.found) and not fetches:
            return False
        if len(look.found) > 1:
            k = (k + 1) % len(look.found)
            self._at_place = look, k
            steps_by = self._fetching_by if fetches else self._putting_down_by
            self._begin_steps(steps_by(look.found[k]))
        return True

    def _retreating(self, signal: str) -> list[Step]:
        """Back along the tool's axis from what was let go of or taken, then to rest."""
        rest = Step("goal", [self._rest])
        late = signal in ("late", "occupied", "hindered", "under_way", "taken_up")
        beside = late or signal in ("open", "free", "missed")
        if signal in ("open", "lost") and self.holding:
            self._let_go()
        opens = late and self.holding  # it moves once they are open
        first = [Step("grip", OPEN), Step("let")] if opens else []
        if not self.holding:
            self.fingers = OPEN
        if not beside:
            return [rest]
        self.view.phase = "give" if self.holding else "receive"
        q = self.executor.set_point.q
        back = None
        if self._taken is not None and not self._give:
            near = np.abs(difference(self.planner.robot, q, self._taken.q)).max()
            back = self._taken.q_before if near < 0.5 else None
        if back is None:
            T = tool_pose(self.planner.robot, q)
            back = straight_back(self.planner, T, q, self.settings.back)
        return [*first, rest] if back is None else [*first, Step("back", back), rest]

    def _plan(self, seen: _Seen, q: np.ndarray) -> object:
        """Answer the frame, as the step asks for it."""
        step = self._step
        if self._driven_off(seen.frame):
            self.fingers = OPEN  # to above the object, and down anew
            self._begin_steps([s for s in self._steps if s.kind != "back"])
            step = self._step
        if self.state == table.PUT_DOWN:
            self._give_up_place(seen)
            step = self._step
        elif self.state == table.FETCH and step.kind == "goal":
            if "blocked" in self._signalled and not self._back_off(seen):
                self._reach_otherwise()
            step = self._step
        elif self.state == table.RETREAT and self._hindered_s > self.settings.stuck_s:
            self._berth.widen(self.settings.room)  # else it may creep, and never get by
        if self._begun is None:
            self._begun = self._now
        if step.kind == "targets":
            return self._pursue(seen, q)
        if step.kind == "reach":
            return self._go_to_object(seen, q)
        if step.kind == "goal":
            return self._go(seen, q, step.value)
        if step.kind == "place":
            return self._find_place(seen, q)
        if step.kind == "pause":
            return self._pause(seen, q, step.value)
        if step.kind in ("line", "up", "back"):
            return self._follow(seen, q, step.value)
        if step.kind == "close":
            return self._close_in(seen, q)
        if step.kind == "grip":
            if self.fingers != step.value:  # what is held makes goals be joined anew
                self._set_goals([self._rest])
            self.fingers = step.value
            sensed = seen.frame.holds if step.value == CLOSED else seen.frame.opened
            if sensed:
                self._next()
        return self._stand(seen, q)

    def _driven_off(self, frame: StoryFrame) -> bool:
        """Whether somebody made it leave what it was about to fetch, its hand empty."""
        leaves = self.executor.state == RETREATING and not self.executor.at_rest
        down = self.state == table.FETCH and self._step.kind in ("line", "grip")
        return leaves and down and not frame.holds

    def _back_off(self, seen: _Seen) -> bool:
        """Begin to back out of where it touches the object; False: it is clear of it.

        A robot that was driven off while it came down to the object may stand against
        it, where no path of the planner's begins.
        """
        obj = self._object_rows(seen.frame)
        if obj is None or self._is_clear_of(obj):
            return False
        q = self.executor.set_point.q
        T = tool_pose(self.planner.robot, q)
        back = straight_back(self.planner, T, q, self.settings.back)
        if back is None:
            return False
        self._begin_steps([Step("back", back), *self._steps[self._at :]])
        self._signalled = self._signalled - {"blocked"}  # the step before was
        return True

    def _pursue(self, seen: _Seen, q: np.ndarray) -> object:
        """Go to the best target."""
        targets = self.targets
        told, allowance = targets.counts["set_goals"], self._allowance
        for _ in range(allowance.frames):
            targets.look(seen.frame.human, q, allowance)
            if targets.counts["set_goals"] != told:
                break  # the next look has to know what the planner says to them
        answer = self._step_planner(seen, q)
        targets.note(answer, q)
        executor = self.executor
        stands = _most(executor.set_point.dq) < self.conduct.stands
        stuck = executor.state == BRAKED and stands
        if self._lasts("stuck", stuck, seen.dt, self.settings.stuck_s):
            targets.put_off()  # the person is in its way: another target first
            self._clock["stuck"] = 0.0
        return answer

    def _change_hands(self) -> None:
        """Take the object into the map or out of it, between two frames."""
        if self._step.kind == "take":
            self._take()
            self._next()
        elif self._step.kind == "let":
            self._let_go()
            self._next()

    def _let_go(self) -> None:
        if self.state == table.PUT_DOWN:
            T = tool_pose(self.planner.robot, self.executor.set_point.q)
            self._stands_at = (T @ self.T_tool_object)[:3, 3]
        self.planner.detach()
        self.holding = False
        if self.view.phase is not None:
            self.view.phase = "receive"  # the object may be left, and touched by pads
        self._pull.forget()

    def _next(self) -> None:
        """Begin the next step."""
        self._at, self._begun = self._at + 1, None
        self._goals = []
        self._clock["blocked"] = 0.0
        self.executor.new_goal()

    def _take(self) -> None:
        """Have the object in the hand, in the map, too."""
        if self._taken is not None and not self._give:
            self.T_tool_object = self._taken.T_tool_object
        elif self.state == table.CLOSE:
            self.T_tool_object = self._put
        self.planner.attach(self._carried, self.T_tool_object)
        self.holding, self._stands_at = True, None
        if self.state != table.CLOSE:
            self._pull.forget()
        self.view.phase = "give" if self.state == table.CLOSE else None

    def _step_planner(self, seen: _Seen, q: np.ndarray) -> object:
        """Let the planner see the frame, without what may be touched, and answer."""
        now, there = seen.frame.now, self._to_avoid(seen)
        if self.view.phase is None:
            there = self._with_berth(seen, there)
        return self.planner.step(there, q=q, stamp=now, now=now)

    def _with_berth(self, seen: _Seen, there: Obstacles) -> Obstacles:
        """Return the shapes as a robot on its way had better pass them."""
        berth = self._berth
        if not berth.room:
            return there
        robot = self.planner.static.robot
        balls = cover_balls(robot, self.executor.set_point.q)[robot.moving]
        held = getattr(self.answer, "status", "") == "holding"
        hindered = self.executor.state in (SLOWED, BRAKED, STANDING)
        offered = self.view.offered if self.state == table.APPROACH else 0
        told = balls, held, hindered
        there = berth.around(there, seen.people + offered, *told)
        self.targets.told_larger = berth.told
        return there

    def _see(self, seen: _Seen, q: np.ndarray) -> None:
        """Let the planner see the frame: where it goes by no path of the planner's."""
        now = seen.frame.now
        self.planner.see(self._to_avoid(seen), q=q, stamp=now, now=now)

    def _to_avoid(self, seen: _Seen) -> Obstacles:
        """Return the shapes that may not be touched by anything in this phase."""
        if self.view.phase is None or not (seen.classes != AVOID).any():
            return seen.there
        avoided = seen.classes == AVOID
        there = Obstacles(capsules=seen.there.capsules[avoided])
        words = zip(self._words, avoided.tolist(), strict=False)
        there.labels = {"capsules": [word for word, kept in words if kept]}
        return there

    def _go(self, seen: _Seen, q: np.ndarray, goals: list[np.ndarray]) -> object:
        """Go to the first goal that is free."""
        self._set_goals(goals)
        answer = self._step_planner(seen, q)
        if self.state not in (table.APPROACH, table.WAIT):
            here = self.executor.set_point.q
            off = [_most(difference(self.planner.robot, here, g)) for g in goals]
            if self.executor.at_rest and min(off) < self.conduct.arrived:
                self._next()
        return answer

    def _set_goals(self, goals: list[np.ndarray]) -> None:
        """Set the planner's goals where they are others now."""
        if not _are_same(goals, self._goals):
            self._allowance.spend(self._allowance.takes.set_goals)
            with suppress(BadConfiguration):  # none of them is valid
                self.planner.set_goals(goals)
            self._goals = list(goals)

    def _follow(self, seen: _Seen, q: np.ndarray, q_end: np.ndarray) -> object:
        """Go straight to q_end, if that is certified now by the rules of the phase."""
        self._see(seen, q)
        here = self.executor.set_point.q
        off = _most(difference(self.planner.robot, here, q_end))
        if self.executor.at_rest and off < self.conduct.arrived:
            if self._step.kind == "back":
                self.view.phase = None
            self._next()
            return _holding("")
        if not self.view.line_free(q, q_end, seen.there):
            if self._step.kind == "back" and "blocked" in self._signalled:
                self.view.phase = None  # another way: the planner's
                self._next()
            return _holding("the straight motion is not free now")
        return SimpleNamespace(status="following", path=np.array([q, q_end]), reason="")

    def _stand(self, seen: _Seen, q: np.ndarray) -> object:
        """Stand still; it may still get out of the way of the rest of the person."""
        self._see(seen, q)
        return _holding("")

    # --- to what is held out ------------------------------------------------------

    def _go_to_object(self, seen: _Seen, q: np.ndarray) -> object:
        """Go before the object, or to rest while it is out of reach."""
        s, T = self.settings, seen.frame.T_base_object
        reaches = self._reaches
        if T is None:
            return self._go(seen, q, [self._rest])
        if seen.object_speed < s.still_speed and self._is_between(T):
            return self._stand(seen, q)  # it is put between the fingers: none leaves
        slow = seen.object_speed < 4.0 * s.still_speed
        moved = self._object_moved(T) and slow and self.state == table.APPROACH
        if moved:
            self._allowance.spend(self._allowance.takes.reach)
            reaches.begin(T, q)
            self._taken = None
        found = [r for r in reaches.found if self._is_ready(r.q_before)]
        if not self.executor.looks_out:  # which takes as long
            self._look_along(seen, found)
        found.sort(key=lambda r: (not self._leads_on(r), self._far(q, r.q_before)))
        goals = [r.q_before for r in found]
        if not found:  # until it is known where it can be grasped now, on to the old
            looks = not reaches.over and self._goals
            goals = self._goals if looks else [self._rest]
        # else a path is looked for, or joined and braked anew
        self._braked = self._braked + 1 if self.executor.state == BRAKED else 0
        self._due = self._due or self._braked % self.conduct.braked_every == 0
        for _ in range(self._allowance.frames):
            if self._due and not moved and _are_same(goals, self._goals):
                self._due = not self._prepare()
        answer = self._go(seen, q, goals)
        goal = getattr(answer, "goal", None)
        if goal is not None and 0 <= goal < len(found):
            self._taken = found[goal]
        return answer

    def _look_along(self, seen: _Seen, found: list[Reach]) -> None:
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

    def _prepare(self) -> bool:
        """Do one costly thing: join a goal to the roadmap, else look for another.

        Returns:
            False where that waits for another frame.
        """
        waiting = (r.q_before for r in self._reaches.found)
        goal = next((g for g in waiting if not self._is_ready(g)), None)
        if goal is None and self._reaches.over:
            return True
        takes = self._allowance.takes
        if not self._allowance.grants(takes.reach if goal is None else takes.prepare):
            return False
        if goal is not None:
            self.planner.prepare_goal(goal)
        else:
            self._reaches.work()
        return True

    def _is_ready(self, goal: np.ndarray) -> bool:
        """Whether setting a goal is cheap now, or preparing it would not help."""
        few = self.planner.settings.cached_goals < 2 * self._reaches.settings.kept
        return few or self.planner.is_prepared(goal)

    def _far(self, q: np.ndarray, other: np.ndarray) -> float:
        """Return how far a configuration is, in steps: small changes do not count."""
        off = _most(difference(self.planner.robot, q, other))
        return round(2.0 * off) / 2.0

    def _close_in(self, seen: _Seen, q: np.ndarray) -> object:
        """Go straight to the object, where it is now; the pads may touch it."""
        self.view.phase = "receive"
        T, reach = seen.frame.T_base_object, self._taken
        if T is None or reach is None:
            return _holding("the object is not seen")
        line = self._line
        if line is None or np.linalg.norm(T[:3, 3] - line[0]) > self.conduct.tracked:
            q_end = self._reaches.moved_to(reach, T)
            self._out_of_line = q_end is None
            self._line = None if q_end is None else (T[:3, 3].copy(), q_end)
        if self._line is None:
            return _holding("the object is out of reach of the straight motion")
        return self._follow(seen, q, self._line[1])


def _are_same(goals: list[np.ndarray], others: list[np.ndarray]) -> bool:
    return [id(q) for q in goals] == [id(q) for q in others]


def _holding(reason: str) -> SimpleNamespace:
    nowhere = np.zeros((0, 0))
    return SimpleNamespace(status="holding", path=nowhere, retreat=None, reason=reason)


def _checked_places(
    T_base_place: np.ndarray | None,
) -> tuple[np.ndarray | None, np.ndarray]:
    """Return the object's place (4, 4), None: none, and (n, 4, 4) other places."""
    if T_base_place is None:
        return None, np.zeros((0, 4, 4))
    rows = np.asarray(T_base_place, float)
    if rows.ndim == 2:
        rows = rows[None]
    if rows.ndim != 3 or not len(rows):
        raise BadInput(
            f"T_base_place has shape {np.shape(T_base_place)}; give one pose (4, 4), "
            "or several (n, 4, 4), the object's own place first"
        )
    places = np.array([check_pose(T, "T_base_place") for T in rows])
    return places[0], places[1:]


def _check_pads(planner: ReactivePlanner) -> None:
    """Refuse a planner whose finger pads could not let go of anything."""
    pads, own = planner.settings.finger_pads, gripper_links(planner.robot)
    if not pads or not set(pads) <= own:
        raise BadInput(
            f"the planner's finger pads are {sorted(pads)}, but must be some of the "
            f"links that the tool carries: {', '.join(sorted(own))}; name those that "
            "touch an object in PlannerSettings(finger_pads=...)"
        )


def _check_base(planner: ReactivePlanner) -> None:
    """Refuse a planner that takes what is told in the base's frame for the world's."""
    if (planner.world.T_world_base != np.eye(4)).any():
        raise BadInput(
            "planner.set_base was called, but a hand-over tells the planner all in the "
            "base's frame; call planner.set_base(np.eye(4)), and give the base's pose "
            "as MeetSettings(T_world_base=...)"
        )


def _check_hand(planner: ReactivePlanner, holds: bool) -> None:
    """Refuse a planner that could not take the object once the fingers close on it."""
    if not holds and planner.attached is not None:
        raise BadInput(
            f"the planner holds {len(planner.attached)} spheres, but this hand-over "
            "begins with an empty hand; call planner.detach() before"
        )
    if planner.cell_map.payload is None and not planner.settings.search:
        raise BadInput(
            f"map {planner.cell_map.recipe.name} has no payload layer, and search is 0 "
            "in the planner's settings, so nothing could be held; set search to 1000, "
            "or add a [payload] table to the recipe and build it again"
        )


def _check_held(planner: ReactivePlanner, spheres: np.ndarray) -> None:
    """Refuse an object (n, 4) that the planner holds elsewhere."""
    rows = planner.attached, spheres
    ends = [(r[:, :3] - r[:, 3:]).min(0) + (r[:, :3] + r[:, 3:]).max(0) for r in rows]
    off = 0.5 * _length(ends[0] - ends[1])  # of the boxes around them
    if off > _ELSEWHERE:
        raise BadInput(
            f"the planner holds something {100 * off:.0f} cm from where T_tool_object "
            f"of the targets' object has it (limit {100 * _ELSEWHERE:.0f} cm); make "
            "them with obj.held_by(story.T_tool_object) of the story that took it, or "
            "call planner.detach() before"
        )


def _check_room(planner: ReactivePlanner, q: np.ndarray) -> None:
    """Refuse an object that cannot be held where the robot stands."""
    if not is_valid(planner, q, bare=True):
        return  # it is not the object's fault, and is told in each frame
    why = planner.static.why(q, np.zeros_like(q))
    if why is not None:
        planner.detach()
        raise BadInput(
            f"the object does not fit in where the robot stands: {why}; begin at "
            "another configuration, or give another grasp T_tool_object"
        )


def _turned(one: np.ndarray, other: np.ndarray) -> float:
    """Return the angle between two poses [rad]."""
    cosine = 0.5 * (np.trace(one[:3, :3].T @ other[:3, :3]) - 1.0)
    return float(np.arccos(min(1.0, max(-1.0, cosine))))


def _length(v: np.ndarray) -> float:
    """Return the length of a vector (3,), to the last bit that of np.linalg.norm."""
    return math.sqrt(v @ v)


def _covering_balls(rods: np.ndarray, n: int = 8) -> np.ndarray:
    """Return n balls for each of some capsules (k, 7) that hold it, as (k * n, 4)."""
    balls = beads(rods, n)
    half = 0.5 / (n - 1) * np.linalg.norm(rods[:, 3:6] - rods[:, :3], axis=1)
    balls[:, 3] = np.hypot(balls[:, 3], np.tile(half, n))
    return balls


def _most(values: np.ndarray) -> float:
    """Return the largest amount among a few numbers (n,)."""
    return max(map(abs, values.tolist()))


def _gap(hand: np.ndarray, obj: np.ndarray) -> float:
    """Return the distance of hand and object, both (k, 7) capsules [m]."""
    return min(capsule_gap(a, b) for a in hand for b in obj)
