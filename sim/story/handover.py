"""Handover: gives an object to a person who moves, or takes one from them.

One object with one `update(frame)`, which a simulation calls as a real robot would.
What state follows is `machine`'s table; this module finds out which signals hold and
does in each state what belongs to it, as a list of steps: go to goals by the planner,
follow a straight certified motion, close the fingers, take the object into the map.
"""

import math
from contextlib import suppress
from functools import partial
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from handover.human.body import ARM_LABELS
from handover.targets.allowance import Allowance
from handover.targets.live_targets import BLOCKED as OCCUPIED
from handover.targets.live_targets import THERE, LiveTargets
from handover.targets.put_down import BESET, BLOCKED
from odm.checks import AVOID, CONTACT, OBJECT
from odm.execution.executor import BRAKED, RETREATING, SLOWED, STANDING, Executor
from odm.execution.speed_limit import SpeedLimit
from odm.execution.threat import Threat
from odm.obstacles.obstacles import Obstacles
from odm.obstacles.shapes import Shape
from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadConfiguration, BadInput
from roadmap.geometry.gaps import ball_gaps, least_gap
from roadmap.kinematics.forward import cover_balls, difference
from roadmap.motion.motion import SetPoint
from roadmap.ranges import check_kind, settings_of
from roadmap.transforms import inverse_pose
from sim.story import machine as table
from sim.story.comfort import UP, Berth, comfort_rods
from sim.story.frame import OTHER_SIDE, Seen, Sight, StoryFrame, are_sound
from sim.story.grasping import Offer, Reaches, straight_back
from sim.story.machine import Machine, Step, StoryEvent
from sim.story.object_places import Placing, Progress, checked_places
from sim.story.phase import PhasePlanner
from sim.story.pull import PullDetector, carried_force
from sim.story.robot_hand import CLOSED, OPEN, Hand, check_grasps, with_room
from sim.story.settings import ConductSettings, StorySettings

_HANDS = [labels[0] for labels in ARM_LABELS.values()]


class Command(NamedTuple):
    """What the robot is to do until the next frame."""

    q: np.ndarray  # (dof,) set-point [rad or m]
    dq: np.ndarray  # (dof,) its velocity
    fingers: str  # "open" or "closed"


_STAND = Step("stand")


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
        fetches: Whether it first takes the object from its place.
        hand: The robot's, and the object in it.
        offer: What somebody holds out, for who receives.
        placing: Where the object is fetched from, or put down.
        answer: The last answer of the planner, or what stood for one.

    Raises:
        BadInput: No finger pads, another robot's targets, a place that is no pose, an
            object heavier than a known robot carries, one in the hand that does not fit
            in where the robot stands, or one that the planner could not take into the
            map.
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
        for name, given, kind in (
            ("planner", planner, ReactivePlanner),
            ("targets", targets, LiveTargets),
            ("executor", executor, Executor),
            ("conduct", conduct, ConductSettings),
        ):
            check_kind(name, given, kind, f"give {kind.__name__}(...)")
        self.conduct = conduct
        _check_base(planner)
        self.planner, self.targets, self.executor = planner, targets, executor
        self.view = executor.planner
        if not isinstance(self.view, PhasePlanner):
            raise BadInput(
                "the executor was not made with a PhasePlanner, so it could not tell "
                "who may be touched; give it PhasePlanner(planner) for its planner"
            )
        executor.part_from(self.view.held_out)
        T_places = checked_places(T_base_place)
        self._give = s.direction == "give"
        fetches = self.fetches = self._give and len(T_places) > 0
        begin = table.FETCH if fetches else table.APPROACH
        self.machine = Machine(table.TABLES[s.direction], begin)
        obj, holds = targets.meet.obj, self._give and not fetches
        self.hand = Hand(planner, executor, obj, thing, s, holds)
        if fetches:
            self.hand.stands_at = T_places[0][:3, 3]
        self._lay_out(T_places)
        self._enter()

    def _lay_out(self, T_places: np.ndarray) -> None:
        """Make what is remembered between frames."""
        s, conduct, planner, hand = self.settings, self.conduct, self.planner, self.hand
        self._rest = np.array(self.executor.set_point.q)
        self._pull = PullDetector(s.pull)
        self._limit = SpeedLimit(planner.robot, s.speed) if s.slow else None
        self._berth = Berth(self.executor, s.threat, s.seen_every_s)
        self._allowance = Allowance.lasting(self.executor.period)
        index, capsules = self.targets.finder.index, hand.obj.capsules
        if not self._give or len(T_places):
            hand.grasps = with_room(planner, hand.carried, hand.grasps)
            # what is in the hand already may lie in it: nobody has to close on that
            check_grasps(planner, hand.grasps, capsules, index.nodes)
        meet = self.targets.meet.settings
        stands_there = (meet.T_world_base == np.eye(4)).all()
        T_base_world = None if stands_there else inverse_pose(meet.T_world_base)
        self.sight = Sight(hand, conduct, meet.side, T_base_world)
        how = conduct, self._allowance
        args = self.view, hand, index, self._rest, *how, T_places
        self.placing = Placing(*args, self._why_it_stands)
        thing = None if self._give else hand.carried
        args = planner, index, self.placing.grasps, s.back, thing
        beside = capsules, max(s.room, self._berth.room)
        reaches = Reaches(*args, *beside, first=self.placing.first)
        self.offer = Offer(self.view, reaches, s, *how)
        self._steps: list[Step] = []
        self._at = 0  # which step
        self._begun: float | None = None  # when the step began [s]
        self._farthest = 0.0  # that the hand was from the object, in this state [m]
        self._hindered_s = 0.0  # of this state, slowed or stopped for the person [s]
        self._kept_off_s = 0.0  # ... or without a free way where a step goes [s]
        self._goals: list[np.ndarray] = []
        self._last: Seen | None = None
        self._expected_at = -np.inf
        self._signalled: set[str] = set()  # what held in the last frame
        self._clock: dict[str, float] = {}  # for how long signals have held [s]
        self._now: float | None = None  # the last frame's time [s]
        self._no_time = ""  # why none passed
        self.answer: object = None

    @property
    def fingers(self) -> str:
        """The command to the gripper: "open" or "closed"."""
        return self.hand.fingers

    @property
    def holding(self) -> bool:
        """Whether the object counts as being in the hand."""
        return self.hand.holding

    @property
    def T_tool_object(self) -> np.ndarray:
        """(4, 4) how the object is held, or was or is to be held [m]."""
        return self.hand.T_tool_object

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
        why = self._why_held()
        if not (why and len(self.planner.goals)):  # the planner knows of goals alone
            why = self._why_nowhere() or why
        executor, state = self.executor, self.state
        stands = executor.reason if not why or executor.state == STANDING else ""
        kept = self.placing.why_kept if state == table.KEPT else ""
        weak = self._pull.why_weak if self._give and state == table.WAIT else ""
        told = [self.machine.reason, weak, self._too_rare(), kept, why]
        told += [stands, self._who_touches(), self._no_time]
        return "; ".join(t for t in told if t)

    def _why_held(self) -> str:
        """Return why the planner holds the robot, as it says it; empty: it does not."""
        held = getattr(self.answer, "status", "") == "holding"
        return getattr(self.answer, "reason", "") if held else ""

    def _why_nowhere(self) -> str:
        """Return why there is nowhere to give or take it; or empty."""
        kind, pursuit, offer = self._step.kind, self.targets.pursuit, self.offer
        if kind == "reach" and self._last is not None:
            T, reaches = self._last.T_object, offer.reaches
            if T is None:
                return "what is to be taken is not seen"
            if not reaches.found and not offer.moved(T):
                yet = "" if reaches.over else " yet"
                return f"no way to grasp what is held out, where it is, was found{yet}"
        if kind != "targets" or pursuit.key is not None or pursuit.touched:
            return ""
        if pursuit.state == OCCUPIED:
            told = "no way to a place within the person's reach is known to be free"
            return "; ".join(filter(None, (told, self.targets.finder.why_failed)))
        far = pursuit.missing_m
        nearer = f": they are {far:.2f} m too far away" if 0.0 < far < np.inf else ""
        return f"no place within reach of both is known{nearer}"

    def _why_it_stands(self) -> str:
        """Return why it does not move, as planner or executor say it."""
        return self._why_held() or self.executor.reason

    def _balls(self) -> np.ndarray:
        """Return (n, 4) the moving spheres of the cover, and of what is held [m]."""
        robot = self.planner.static.robot
        return cover_balls(robot, self.executor.set_point.q)[robot.moving]

    def _who_touches(self) -> str:
        """Return who is at a robot that waits for a hand, that arm apart; or empty."""
        last, executor = self._last, self.executor
        if last is None or self.view.phase is None or not executor.at_rest:
            return ""
        others = np.setdiff1d(np.arange(last.people), self.view.meant)
        rows = last.there.capsules[others]
        gaps = ball_gaps(self._balls(), rows).min(axis=0, initial=np.inf)
        if not (gaps < 0.0).any():
            return ""
        word = last.there.labels["capsules"][others[gaps.argmin()]] or "somebody"
        return f"{word} is at the robot: it stands until they are farther"

    def _too_rare(self) -> str:
        """Return what to do about frames too rare to close on an object; or empty."""
        told = {e.signal for e in self.events}
        vain = bool(told & {"blocked", "in_vain", "hindered"})
        if self._give or self.holding or "free" in told:
            return ""
        return self._berth.why_too_rare(self.conduct.too_rare, vain)

    @property
    def force(self) -> float:
        """What is felt of somebody's pull now [N]."""
        return self._pull.force

    @property
    def grasps(self) -> np.ndarray:
        """(n, 4, 4) T_tool_object of all ways to hold the object [m]."""
        return self.hand.grasps

    @property
    def outcome(self) -> str:
        """What came of it: "handed over", or what went wrong; empty before the end."""
        return self.machine.outcome("open" if self._give else "free")

    def update(self, frame: StoryFrame) -> Command:
        """Take a frame, decide, plan, and move on by one period of the executor.

        Raises:
            BadInput: No `StoryFrame`, or numbers in it of which the robot has more or
                fewer joints.
        """
        check_kind("frame", frame, StoryFrame, "give a StoryFrame(...)")
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
        return Command(point.q, point.dq, self.hand.fingers)

    def _go_gently(self, seen: Seen, threat: Threat, limit: SpeedLimit) -> None:
        """Let the executor be as slow, and as gentle, as it has to be near a person."""
        executor, share = self.executor, 1.0
        if not executor.at_rest:
            moves = executor.motion, executor.t, executor.settings.speed_scale
            share = limit.share(*moves, threat, seen.hands, seen.people)
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
            self.machine.begin(self._now)
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
            self._leap(passed)
        return 0.0

    def _leap(self, passed: float) -> None:
        """Let some time [s] not count for what began before."""
        self.machine.leap(passed)
        self._begun = None if self._begun is None else self._begun + passed

    def _look(self, frame: StoryFrame) -> Seen:
        """Lay out all shapes with their classes, and follow them."""
        if self.state == table.PRESENT:  # the hand may come to what is held out
            self.view.phase = "give" if self.executor.at_rest else None
        at_place = self.state in (table.FETCH, table.PUT_DOWN)
        stands = self._step.kind in ("goal", "place", "pause")
        self.view.at_place = at_place and not stands
        if at_place:  # the pads touch the object
            self.view.phase = "receive" if self.view.at_place else None
        passed = self._passed(frame.now)
        seen = self.sight.look(frame, passed)
        if not seen.dt:  # no time limit runs while nobody knows where the person is
            self._leap(passed)
        people, n = seen.people, len(seen.there)
        if self.state == table.RETREAT and self._step.kind == "goal" and seen.loose:
            if self.view.phase is not None and self._is_clear_of(seen.obj):
                self.view.phase = None  # paths keep off it again
        classes = np.full(n, AVOID, np.int8)
        if self.view.phase == "give":
            classes[seen.hand] = CONTACT
        if self.view.phase == "receive":
            classes[people:] = OBJECT
        self.view.classes, self.view.person = classes, seen.person
        self.view.meant = np.concatenate((seen.arm, np.arange(people, n)))
        gives = self._give and self.state != table.RETREAT
        self.view.offered = 0 if gives else n - people
        hurries = self.conduct.hurries * self.settings.still_speed
        self.view.hurries = seen.object_speed > hurries
        self._tell(seen, self.conduct.late_s)
        return seen

    def _is_clear_of(self, obj: np.ndarray) -> bool:
        """Whether the robot keeps its clearance from an object (k, 7)."""
        return bool(ball_gaps(self._balls(), obj).min() > self.planner.keep)

    def _tell(self, seen: Seen, every: float) -> None:
        """Tell the planner where the person will be, if that is `every` [s] old."""
        frame, allowance = seen.frame, self._allowance
        late = abs(self._now - self._expected_at)
        if late < every:
            return
        if late < self.conduct.late_s and not allowance.grants(allowance.takes.tell):
            return
        gaze = frame.human.gaze if frame.capsules is None else None
        parts = seen.person, seen.labels, seen.hand
        up, T = UP, self.sight.T_base_world
        if T is not None:
            up, gaze = T[:3, 2], None if gaze is None else T[:3, :3] @ gaze
        rods = comfort_rods(*parts, gaze, self.settings.comfort, up=up)
        self._expect(seen.threat, seen.arm, rods)
        self._expected_at = self._now

    def _expect(self, threat: Threat | None, arm: np.ndarray, rods: np.ndarray) -> None:
        """Tell the planner where the arm that takes part will be, while it plans."""
        if threat is None or self._step.kind in ("stand", "grip"):
            return
        likely = threat.of(arm).likely(*self.conduct.expected) if len(arm) else None
        rows = [rods] if likely is None else [likely.capsules, rods]
        expected = np.vstack(rows)
        if len(expected) and are_sound(expected):  # who is nowhere is expected nowhere
            self.planner.expect(Obstacles(capsules=expected))

    # --- which signals hold -----------------------------------------------------

    def _signals(self, seen: Seen, point: SetPoint) -> set[str]:
        """Return the names of what holds now, at a set-point; see `machine.SIGNALS`."""
        s, frame = self.settings, seen.frame
        moving = _most(point.dq) > self.conduct.stands
        self._feel(seen, point, moving)
        passed = self._now - self.machine.since
        slowed = self.executor.state in (SLOWED, BRAKED)
        held_up = self._is_blocked()
        self._hindered_s += seen.dt if slowed else 0.0
        self._kept_off_s += seen.dt if slowed or held_up else 0.0
        limits = {table.FETCH: s.fetch_s, table.PUT_DOWN: s.put_down_s}
        late = passed > limits.get(self.state, s.wait_s)
        hand, pulls, lasts = self.hand, self._pull.pulls, self._lasts
        gone_s, felt_s, dt = self.conduct.gone_s, self.conduct.felt_s, seen.dt
        away = seen.hand_gap > s.gone and not pulls
        checks = {
            "lost": lasts("lost", self._missing(frame), dt, felt_s),
            "found": lasts("found", hand.doubted and frame.holds, dt, felt_s),
            "pulled": self._pull.pulled and self._may_be_theirs(seen, moving),
            "slack": not pulls and frame.holds and not frame.opened,
            "near": self._hand_comes(seen.hand_gap),
            "gone": lasts("gone", away, dt, gone_s),
            "other_hand": lasts("other_hand", self._hand_instead(seen), dt, gone_s),
            "open": frame.opened,
            "blocked": lasts("blocked", held_up, dt, s.blocked_s),
        }
        checks["in_vain"] = checks["blocked"] and self.offer.tried + 1 >= s.tries
        checks |= self._signals_of_place(seen, point.q)
        over = self._at >= len(self._steps) and self.executor.at_rest
        sure = lasts("doubted", hand.doubted, dt, gone_s) or not hand.doubted
        gripped = hand.holding and frame.holds
        left = lasts("left_it", gripped and pulls and self._is_far(seen), dt, gone_s)
        unpulled = gripped and (left or not pulls)
        empty = hand.fingers == CLOSED and not frame.holds and not hand.holding
        checks |= {
            "held": over and gripped,
            "free": over and lasts("free", unpulled, dt, s.pull.hold_s),
            "missed": self._passed_grip() and empty,
            "away": over and sure,
            "away_holding": over and hand.holding,
        }
        checks |= self.placing.signals(over, over or late)
        if late:
            checks |= self._signals_when_late(seen, passed)
        self._signalled = {name for name, holds in checks.items() if holds}
        return self._signalled

    def _signals_when_late(self, seen: Seen, passed: float) -> dict[str, bool]:
        """Return what holds of a state that has lasted for longer than it may [s]."""
        return {
            "hindered": 2.0 * self._hindered_s > passed,
            "kept_off": 2.0 * self._kept_off_s > passed,
            "under_way": self._is_under_way(),
            "taken_up": self._is_taken_up(seen),
            "ungripped": self.hand.fingers == OPEN,
            "unfelt": not self._pull.felt,
            "weak_pull": self._pull.weak > 0.0,
            "occupied": self._is_occupied(seen),
            "late": True,
            "late_holding": self.hand.holding,
            "beset": self.hand.holding and self._is_beset(passed),
        }

    def _feel(self, seen: Seen, point: SetPoint, moving: bool) -> None:
        """Feel the force at the wrist, knowing what weighs in the hand."""
        frame, hand, own, taken = seen.frame, self.hand, None, None
        # what was taken has a weight; its giver may pull from the first moment on
        takes = self.state == table.CLOSE and (hand.holding or frame.holds)
        if takes or (self._give and hand.holding):
            T_world_base = self.targets.meet.settings.T_world_base
            args = point, hand.T_tool_object, hand.obj.mass_kg, T_world_base
            weighs = carried_force(self.planner.robot, *args)
            own, taken = (None, weighs) if takes else (weighs, None)
        self._pull.feel(frame.wrench, seen.dt, moving, taken, own)

    def _is_occupied(self, seen: Seen) -> bool:
        """Whether the person is within the clearance of the object in its place."""
        gaps = self.placing.gaps(seen)
        return bool(len(gaps)) and bool(gaps[0] < self.planner.keep)

    def _is_beset(self, passed: float) -> bool:
        """Whether the person blocked the places for most of `passed` [s]."""
        return self.placing.places.beset or 2.0 * self._hindered_s > passed

    def _is_taken_up(self, seen: Seen) -> bool:
        """Whether places in reach are known to give or take it, and none is free."""
        if not self._give:
            T = seen.T_object
            known = T is not None and bool(self.offer.reaches.found)
            return known and not self.offer.moved(T)
        pursuit = self.targets.pursuit
        return pursuit.state == OCCUPIED and pursuit.targets > 0

    def _is_under_way(self) -> bool:
        """Whether it is moving to where it can give or take the object."""
        if self.executor.at_rest:
            return False
        if self._give:
            return self.targets.pursuit.key is not None
        return self.offer.taken is not None

    def _may_be_theirs(self, seen: Seen, moving: bool) -> bool:
        """Whether a pull that lasted may be what the robot waits for, where it waits.

        Not while it still moves; and not where no hand of the person is about.
        """
        return self.state != table.WAIT or not (moving or self._is_far(seen))

    def _is_far(self, seen: Seen) -> bool:
        """Whether both hands are known to be so far from the object as to have gone."""
        obj = self.hand.capsules(seen.frame.T_base_object)  # where it is by now
        hands = np.isin(seen.labels, _HANDS)
        if obj is None or seen.threat is None or not hands.any():
            return False
        rods = seen.threat.capsules[: seen.people]  # the missing ones as wide as known
        return least_gap(rods[hands], obj) > self.settings.gone

    def _hand_comes(self, gap: float) -> bool:
        """Whether the hand, so far from the object [m], is there or on its way."""
        s = self.settings
        self._farthest = max(self._farthest, gap)
        return gap < s.near and (gap < s.comes or self._farthest - gap >= s.comes)

    def _hand_instead(self, seen: Seen) -> bool:
        """Whether it is the other hand that comes; the expected one is not there."""
        far = self.conduct.instead
        is_there = seen.hand_gap < far or self._pull.pulls
        return seen.instead > far and not is_there

    def _signals_of_place(self, seen: Seen, q: np.ndarray) -> dict[str, bool]:
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
        pre, T = self.offer.taken, seen.T_object
        off = np.inf
        if pre is not None:
            off = _most(difference(self.planner.robot, q, pre.q_before))
        moved = self.offer.moved(T)
        still = seen.object_speed < s.still_speed and not moved
        closing = self.state == table.CLOSE
        if closing:  # while the fingers close, it may give way a little
            moved = moved and not self.hand.holding and self.hand.fingers == OPEN
        steady = self._lasts("steady", still, seen.dt, s.steady_s)
        between = seen.object_speed < s.still_speed and self.hand.is_between(T)
        lasts = self._lasts("between", between, seen.dt, s.steady_s)
        stopped = closing and executor.state == BRAKED and steady  # it would creep on
        return {
            "arrived": off < self.conduct.arrived and executor.at_rest and not moved,
            "moved": moved,
            "left": self._lasts("left", T is None, seen.dt, s.leave_s),
            "steady": steady,
            "between": lasts or (between and stopped),
        }

    def _lasts(self, name: str, holds: bool, dt: float, least: float) -> bool:
        """Whether something holds, and has for so long [s]."""
        self._clock[name] = self._clock.get(name, 0.0) + dt if holds else 0.0
        return self._clock[name] > least

    def _missing(self, frame: StoryFrame) -> bool:
        hand = self.hand
        return hand.holding and hand.fingers == CLOSED and not frame.holds

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
        if signal == "other_hand":
            side = OTHER_SIDE[self.sight.side]
            self.sight.expect(side)
            self.targets.expect(side)
        self._berth.begin()
        self._hindered_s = self._kept_off_s = 0.0
        self._clock["blocked"] = self._clock["steady"] = self._clock["left"] = 0.0
        self.view.phase = None
        if signal == "found":
            self.hand.doubt(False)
        elif self.hand.doubted and self.ended:
            self.hand.let_go(puts_down=False)
        steps: list[Step] = []
        if state == table.FETCH:
            steps = self.placing.fetching(self.executor.set_point.q)
        elif state in (table.APPROACH, table.PRESENT) and self._give:
            steps = [Step("targets")]
        elif state in (table.APPROACH, table.WAIT) and not self._give:
            if state == table.APPROACH:
                self.offer.forget(signal == "blocked")
                self.hand.fingers = OPEN
            steps = [Step("reach")]
        elif state == table.WAIT:
            self._pull.restart()
            self.hand.fingers, self.view.phase = CLOSED, "give"
            steps = [_STAND, _STAND]
        elif state == table.RELEASE:
            self.hand.fingers, self.view.phase = OPEN, "give"
            steps = [_STAND, _STAND]
        elif state == table.CLOSE:
            self._pull.forget()
            self.offer.begin_closing()
            steps = [Step("close"), Step("grip", CLOSED), Step("take")]
            if signal == "between":
                steps, self.offer.taken = steps[1:], None
        elif state == table.RETREAT:
            steps = self._retreating(signal)
        elif state == table.PUT_DOWN:
            steps = self.placing.putting_down(self._last, self._progress())
        self._steps = steps
        self._goals = []

    def _progress(self) -> Progress:
        """Return how the state goes on."""
        return Progress(self._now or 0.0, self._hindered_s)

    def _give_up_place(self, seen: Seen) -> None:
        """Leave the place where no motion leads on, or the person is in the way."""
        placing, kind = self.placing, self._step.kind
        waits = placing.places.now is None and not placing.placeless
        blocked, progress = "blocked" in self._signalled, self._progress()
        if waits and kind == "goal" and blocked:
            self._next()  # the way to rest: it waits where it is
        reached = placing.places.now is None or not self.holding
        if reached or kind not in ("goal", "line"):
            return
        if placing.is_beset(progress):
            why = BESET
        elif blocked and not self._reach_otherwise():
            why = BESET if self.executor.state == BRAKED else BLOCKED
        else:
            return
        steps = placing.leave(seen, why, progress)
        if kind == "line":  # it stands low, beside what it stands on
            steps = [Step("up", self._steps[0].value[0]), *steps]
        self._begin_steps(steps)

    def _begin_steps(self, steps: list[Step] | None) -> None:
        """Go on with other steps; None: with those that there are."""
        if steps is not None:
            self._steps, self._at = steps, -1
            self._next()

    def _reach_otherwise(self) -> bool:
        """Go to the object's place with another grasp or arm: this one is blocked.

        Returns:
            False where all ways to put it down there have been tried.
        """
        steps = self.placing.otherwise(self._at, self.state == table.FETCH)
        if steps:
            self._begin_steps(steps)
        return steps is not None

    def _retreating(self, signal: str) -> list[Step]:
        """Back along the tool's axis from what was let go of or taken, then to rest."""
        rest = Step("goal", [self._rest])
        limits = "late", "occupied", "hindered", "under_way", "taken_up", "ungripped"
        late = signal in limits
        beside = late or signal in ("open", "free", "missed")
        if signal == "lost" and self.holding and self._is_alone():
            self.hand.doubt()
            self._pull.forget()
        elif signal in ("open", "lost") and self.holding:
            self._let_go()
        opens = late and self.holding  # it moves once they are open
        first = [Step("grip", OPEN), Step("let")] if opens else []
        if not self.holding and not self.hand.doubted:
            self.hand.fingers = OPEN
        if not beside:
            return [rest]
        self.view.phase = "give" if self.holding else "receive"
        q, taken, back = self.executor.set_point.q, self.offer.taken, None
        if taken is not None and not self._give:
            near = np.abs(difference(self.planner.robot, q, taken.q)).max()
            back = taken.q_before if near < 0.5 else None
        back = self._way_back(q) if back is None else back
        return [*first, rest] if back is None else [*first, Step("back", back), rest]

    def _is_alone(self) -> bool:
        """Whether nobody is near to the object in the hand, who could have taken it.

        Then fingers that are said to hold nothing stay closed: if that is wrong, they
        would drop what they hold; and beside somebody, drag them along.
        """
        last = self._last
        if last is None or last.obj is None:
            return False
        return least_gap(last.person, last.obj) > self.settings.gone

    def _way_back(self, q: np.ndarray) -> np.ndarray | None:
        """Return (dof,) straight back along the tool's axis from q; None: none."""
        T = self.hand.T_base_tool()
        return straight_back(self.planner, T, q, self.settings.back)

    def _plan(self, seen: Seen, q: np.ndarray) -> object:
        """Answer the frame, as the step asks for it."""
        step = self._step
        if self._driven_off(seen.frame):
            self.hand.fingers = OPEN  # to above the object, and down anew
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
            self._begin_steps(self.placing.find(seen, q, self._progress()))
        if step.kind == "pause":
            args = seen, step.value, self._now - self._begun, self._progress()
            self._begin_steps(self.placing.after_pause(*args))
        if step.kind in ("line", "up", "back"):
            return self._follow(seen, q, step.value)
        if step.kind == "close":
            return self._close_in(seen, q)
        if step.kind == "grip":
            if self.hand.fingers != step.value:  # what it holds changes how goals join
                self._set_goals([self._rest])
            self.hand.fingers = step.value
            sensed = seen.frame.holds if step.value == CLOSED else seen.frame.opened
            if sensed:
                self._next()
        return self._stand(seen, q)

    def _driven_off(self, frame: StoryFrame) -> bool:
        """Whether somebody made it leave what it was about to fetch, its hand empty."""
        leaves = self.executor.state == RETREATING and not self.executor.at_rest
        down = self.state == table.FETCH and self._step.kind in ("line", "grip")
        return leaves and down and not frame.holds

    def _back_off(self, seen: Seen) -> bool:
        """Begin to back out of where it touches the object; False: it is clear of it.

        A robot that was driven off while it came down to the object may stand against
        it, where no path of the planner's begins.
        """
        if seen.obj is None or self._is_clear_of(seen.obj):
            return False
        back = self._way_back(self.executor.set_point.q)
        if back is None:
            return False
        self._begin_steps([Step("back", back), *self._steps[self._at :]])
        self._signalled = self._signalled - {"blocked"}  # the step before was
        return True

    def _pursue(self, seen: Seen, q: np.ndarray) -> object:
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
        self.hand.let_go(puts_down=self.state == table.PUT_DOWN)
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
        hand, taken = self.hand, self.offer.taken
        T = hand.T_tool_object
        if taken is not None and not self._give:
            T = taken.T_tool_object
        elif self.state == table.CLOSE:
            T = hand.T_tool_between
        hand.take(T)
        if self.state != table.CLOSE:
            self._pull.forget()
        self.view.phase = "give" if self.state == table.CLOSE else None

    def _step_planner(self, seen: Seen, q: np.ndarray) -> object:
        """Let the planner see the frame, without what may be touched, and answer."""
        there = self._to_avoid(seen)
        if self.view.phase is None:
            there = self._with_berth(seen, there)
        return self.planner.step(there, q=q, stamp=seen.stamp, now=seen.frame.now)

    def _with_berth(self, seen: Seen, there: Obstacles) -> Obstacles:
        """Return the shapes as a robot on its way had better pass them."""
        berth = self._berth
        if not berth.room:
            return there
        held = getattr(self.answer, "status", "") == "holding"
        hindered = self.executor.state in (SLOWED, BRAKED, STANDING)
        offered = self.view.offered if self.state == table.APPROACH else 0
        args = self._balls(), held, hindered
        there = berth.around(there, seen.people + offered, *args)
        self.targets.told_larger = berth.told
        return there

    def _see(self, seen: Seen, q: np.ndarray) -> None:
        """Let the planner see the frame: where it goes by no path of the planner's."""
        there, now = self._to_avoid(seen), seen.frame.now
        self.planner.see(there, q=q, stamp=seen.stamp, now=now)

    def _to_avoid(self, seen: Seen) -> Obstacles:
        """Return the shapes that may not be touched by anything in this phase."""
        if self.view.phase is None or not (self.view.classes != AVOID).any():
            return seen.there
        avoided = self.view.classes == AVOID
        there = Obstacles(capsules=seen.there.capsules[avoided])
        words = zip(seen.there.labels["capsules"], avoided.tolist(), strict=True)
        there.labels = {"capsules": [word for word, kept in words if kept]}
        return there

    def _go(self, seen: Seen, q: np.ndarray, goals: list[np.ndarray]) -> object:
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

    def _follow(self, seen: Seen, q: np.ndarray, q_end: np.ndarray) -> object:
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

    def _stand(self, seen: Seen, q: np.ndarray) -> object:
        """Stand still; it may still get out of the way of the rest of the person."""
        self._see(seen, q)
        return _holding("")

    # --- to what is held out ------------------------------------------------------

    def _go_to_object(self, seen: Seen, q: np.ndarray) -> object:
        """Go before the object, or to rest while it is out of reach."""
        s, T = self.settings, seen.T_object
        executor, offer = self.executor, self.offer
        if T is None:
            return self._go(seen, q, [self._rest])
        if seen.object_speed < s.still_speed and self.hand.is_between(T):
            return self._stand(seen, q)  # it is put between the fingers: none leaves
        slow = seen.object_speed < 4.0 * s.still_speed
        moved = offer.moved(T) and slow and self.state == table.APPROACH
        if moved:
            offer.follow(T, q)
        # an evasion takes as long as to look at a straight motion
        found = offer.in_order(seen, q, looks=not executor.looks_out)
        goals = [r.q_before for r in found]
        if not found:  # until it is known where it can be grasped now, on to the old
            looks = not offer.reaches.over and self._goals
            goals = self._goals if looks else [self._rest]
        # else a path is looked for, or joined and braked anew
        waits = moved or not _are_same(goals, self._goals)
        offer.prepare(executor.state == BRAKED, waits)
        answer = self._go(seen, q, goals)
        goal = getattr(answer, "goal", None)
        if goal is not None and 0 <= goal < len(found):
            offer.taken = found[goal]
        return answer

    def _close_in(self, seen: Seen, q: np.ndarray) -> object:
        """Go straight to the object, where it is now; the pads may touch it."""
        self.view.phase = "receive"
        T = seen.T_object
        if T is None or self.offer.taken is None:
            return _holding("the object is not seen")
        q_end = self.offer.end_of_line(T)
        if q_end is None:
            return _holding("the object is out of reach of the straight motion")
        return self._follow(seen, q, q_end)


def _are_same(goals: list[np.ndarray], others: list[np.ndarray]) -> bool:
    return [id(q) for q in goals] == [id(q) for q in others]


def _holding(reason: str) -> SimpleNamespace:
    nowhere = np.zeros((0, 0))
    return SimpleNamespace(status="holding", path=nowhere, retreat=None, reason=reason)


def _most(values: np.ndarray) -> float:
    """Return the largest amount among a few numbers (n,)."""
    return max(map(abs, values.tolist()))


def _check_base(planner: ReactivePlanner) -> None:
    """Refuse a planner that takes what is told in the base's frame for the world's."""
    if (planner.world.T_world_base != np.eye(4)).any():
        raise BadInput(
            "planner.set_base was called, but a hand-over tells the planner all in the "
            "base's frame; call planner.set_base(np.eye(4)), and give the base's pose "
            "as MeetSettings(T_world_base=...)"
        )
