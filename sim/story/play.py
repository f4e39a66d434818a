"""A hand-over played: partner, fingers, wrist and exact audit, frame by frame."""

import gc
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from handover.human.body import ARM_LABELS
from handover.human.human import Human
from odm.cell_map.payload import carried_object
from odm.checks import AVOID
from odm.execution.executor import Executor
from odm.execution.threat import ThreatSettings
from odm.frame.last_phase import TOUCHED
from odm.obstacles.obstacles import Obstacles
from roadmap.geometry.gaps import ball_gaps, least_gap, moved_rods
from roadmap.kinematics.forward import cover_balls, sphere_centers, tool_pose
from sim.loop.garbage import NotCollected
from sim.loop.loop import exact_audit
from sim.loop.warmup import exercise
from sim.people.partner import Partner
from sim.run.meet import exercise_choice
from sim.story import machine as table
from sim.story.cases import EXECUTION, RATE, StoryCase, StorySetup, in_reach
from sim.story.frame import StoryFrame
from sim.story.handover import Command, Handover
from sim.story.machine import DIRECTIONS, StoryEvent
from sim.story.phase import PhasePlanner
from sim.story.robot_hand import CLOSED, box_of
from sim.story.settings import PARTNER, GripperSettings, StorySettings
from sim.story.wrist import PlainWrist, Wrist, person_force

STANDS = 1e-3  # [m/s] slower than this it stands
_ROUNDING = 1e-6  # of a share
_SECONDS = 1.0  # that are played in each direction
_EXACT = 0.04  # [m] nearer than this by the cover, the exact distance is asked for


@dataclass(frozen=True, eq=False)
class StoryMoment:
    """One frame of a run."""

    now: float  # time [s]
    # (dof,) the set-point
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    capsules: np.ndarray  # (k, 7) the person [m]
    # of the story
    state: str
    reason: str
    fingers: float  # how far they are open, 0 to 1
    holding: bool  # whether the robot counts the object as its own
    T_object: np.ndarray | None  # (4, 4) where it is; None: it has fallen
    separation: float  # of robot and person, without the object [m]
    pace: str  # what the executor does
    status: str  # of the planner's answer
    cpu_s: float  # computing time of the frame [s]
    force: float  # what the pull detector feels [N]
    frame: StoryFrame  # what the story was given


@dataclass
class StoryResult:
    """What came of a run."""

    case: StoryCase  # who stood where
    in_reach: bool  # whether the hand-over was in reach, as told before
    # how it ended
    state: str = ""
    outcome: str = ""
    reason: str = ""
    events: list[StoryEvent] = field(default_factory=list)  # all that happened
    handed_s: float | None = None  # when the object changed hands [s]; None: it did not
    ended_s: float | None = None  # when it was over [s]; None: the time was up
    # frames in which a robot that moved touched the person, the object apart
    contacts: int = 0
    standing_contacts: int = 0  # the same of a robot that stood: the person came to it
    # frames in which the object in the robot's hand touched something else than the arm
    # that takes part
    object_contacts: int = 0
    closest: float = np.inf  # smallest separation [m]
    # how often
    stops: int = 0
    path_changes: int = 0
    # fastest point of the robot within 0.3 m of the person [m/s]
    fastest_near: float = 0.0
    # the largest share of a joint's limit that was used, through every replan and
    # release; the jerk is the mean of a frame
    acceleration: float = 0.0
    jerk: float = 0.0
    beyond: int = 0  # frames in which one of them was more than its limit
    cpu_s: list[float] = field(default_factory=list)  # of each frame [s]

    @property
    def handed_over(self) -> bool:
        """Whether the object is where it was to go, in time."""
        return self.handed_s is not None


class Fingers:
    """A gripper of two fingers, simulated.

    Args:
        share: How far they are open, 0 to 1; None: as they close on an object.
        T_tool_object: (4, 4) how they hold an object; None: they hold nothing.
        settings: How quick they are, and what they hold.

    Attributes:
        share: How far they are open, 0 to 1.
        T_tool_object: (4, 4) how they hold an object; None: they hold nothing.
    """

    def __init__(
        self,
        share: float | None,
        T_tool_object: np.ndarray | None,
        settings: GripperSettings = GripperSettings(),
    ) -> None:
        self.settings, self.T_tool_object = settings, T_tool_object
        self.share = settings.held if share is None else share

    def step(self, asked: str, dt: float, T_tool_object: np.ndarray | None, grasps):
        """Move; grasp what is between them, or let go.

        Args:
            asked: "open" or "closed".
            dt: Time that passes [s].
            T_tool_object: (4, 4) where the object is, seen from the tool; None: gone.
            grasps: (n, 4, 4) where it would have to be, to be held.
        """
        s = self.settings
        step = dt / s.closing_s
        if asked == CLOSED:
            least = s.held if self.T_tool_object is not None else 0.0
            self.share = max(least, self.share - step)
            if self.T_tool_object is None and self.share <= s.held < self.share + step:
                self.T_tool_object = _between(T_tool_object, grasps, s.between)
        else:
            self.share = min(1.0, self.share + step)
            if self.share > s.loose:
                self.T_tool_object = None


def _between(
    T: np.ndarray | None, grasps: np.ndarray, near: float
) -> np.ndarray | None:
    """Return how an object is held that is about where a grasp wants it, or None."""
    if T is None:
        return None
    far = np.linalg.norm(grasps[:, :3, 3] - T[:3, 3], axis=1)
    return np.array(T) if far.min() < near else None


class StoryPlay:
    """One run that goes on frame by frame.

    Args:
        setup: What all runs share.
        case: Who stands where.
        settings: Of the story; its direction is the case's.
        wrist: The sensor; None: the forces added up.
        partner: Who hands over; None: the scripted one.
        fetch: Whether a giver first takes the object from its place.
    """

    def __init__(
        self,
        setup: StorySetup,
        case: StoryCase,
        settings: StorySettings | None = None,
        wrist: Wrist | None = None,
        partner: Partner | None = None,
        fetch: bool = False,
    ) -> None:
        self.setup, self.case = setup, case
        give = case.direction == "give"
        if settings is None:
            robot = setup.cell_map.robot
            # of recorded or driven people nobody knows that they are calm
            threat = PARTNER if partner is None else ThreatSettings()
            told = {"direction": case.direction, "threat": threat}
            settings = StorySettings.for_robot(robot, **told)
        self.known = in_reach(setup, case) if partner is None else None
        self.partner = partner or _partner(setup, case, self.known)
        holds = give and not fetch
        T = np.array(setup.obj.T_tool_object) if holds else None
        self.fingers = Fingers(None if holds else 1.0, T)
        self.story = new_story(setup, settings, self.partner.human, fetch)
        planner = self.planner = self.story.planner
        self.wrist = wrist or PlainWrist(setup.obj)
        self._rng = np.random.default_rng([case.seed, 77])
        self._T_object = np.array(setup.T_place) if fetch else None
        self._audit = exact_audit(setup.cell_map.robot)
        self.speed = 0.0  # of the fastest point [m/s]
        self.index, self.result = 0, StoryResult(case, self.known is not None)
        self._centers = sphere_centers(planner.robot, setup.rest)
        self._stood, self._fell = True, False
        self._dq = self._ddq = np.zeros(planner.robot.dof)

    def step(self) -> StoryMoment:
        """Go on by one frame."""
        now, story = self.index / RATE, self.story
        partner, fingers = self.partner, self.fingers
        q = np.array(story.executor.set_point.q)
        T_tool = tool_pose(self.planner.robot, q)
        T_object = self._object(T_tool)
        offered = story.state in (table.PRESENT, table.WAIT, table.RELEASE)
        held = fingers.T_tool_object is not None
        seen = T_object if T_object is not None else T_tool
        balls = self.planner.robot.spheres[:, 3]
        partner.balls = np.column_stack([self._centers, balls])
        human = partner.step(now, seen, offered and held, story.fingers, held)
        T_object = self._object(T_tool)
        frame = self._frame(now, T_tool, T_object, human)
        with NotCollected():
            busy = time.thread_time()
            command = story.update(frame)
            cpu = time.thread_time() - busy
        T_tool_object = None if T_object is None else np.linalg.inv(T_tool) @ T_object
        self._move_fingers(command, now, T_tool_object)
        moment = self._moment(now, q, T_object, frame, cpu)
        self._note(moment)
        self.index += 1
        return moment

    def _frame(self, now, T_tool, T_object, human) -> StoryFrame:
        """Return what the story is told: what its sensors would say."""
        case, partner, fingers = self.case, self.partner, self.fingers
        held = fingers.T_tool_object is not None
        force = np.zeros(3)
        if held and partner.holds:
            t, since = case.traits, now - partner.bump_at
            force = person_force(T_tool, partner.pull, since, t.bump)
        mass = self.setup.obj.mass_kg if held else 0.0
        wrench = self.wrist.wrench(T_tool, mass, force)
        wrench = wrench + self._rng.normal(0.0, case.traits.noise, 6)
        opened = fingers.share >= 1.0 - 1e-9
        capsules, labels = partner.tracked(now)
        felt = wrench, opened, held, T_object
        return StoryFrame(now, human, *felt, capsules=capsules, labels=labels)

    def _object(self, T_tool: np.ndarray) -> np.ndarray | None:
        """Return where the object is; None: it lies on the floor."""
        fingers, partner = self.fingers, self.partner
        if fingers.T_tool_object is not None:
            return T_tool @ fingers.T_tool_object
        if partner.holds:
            return partner.T_world_object
        return self._T_object

    def _move_fingers(self, command: Command, now: float, T_tool_object) -> None:
        """Move them; what nobody holds any more falls, or stands in its place."""
        fingers, partner, setup = self.fingers, self.partner, self.setup
        held = fingers.T_tool_object is not None
        grasps = self.story.grasps
        fingers.step(command.fingers, 1.0 / RATE, T_tool_object, grasps)
        if held and now >= self.case.traits.drops_s and not self._fell:
            fingers.T_tool_object, self._fell = None, True
            partner.holds = False
        if fingers.T_tool_object is None and held and not partner.holds:
            self._T_object = None
            places = setup.places()
            if places is not None and T_tool_object is not None and not self._fell:
                q = self.story.executor.set_point.q
                at = tool_pose(self.planner.robot, q) @ T_tool_object
                off = np.linalg.norm(places[:, :3, 3] - at[:3, 3], axis=1)
                if off.min() < 0.02:
                    self._T_object = np.array(places[off.argmin()])
        elif fingers.T_tool_object is not None:
            self._T_object = None

    def _moment(self, now, q, T_object, frame, cpu) -> StoryMoment:
        story, executor = self.story, self.story.executor
        capsules = frame.human.capsules()
        return StoryMoment(
            now=now,
            q=q,
            dq=np.array(executor.set_point.dq),
            ddq=np.array(executor.set_point.ddq),
            capsules=capsules,
            state=story.state,
            reason=story.reason if story.answer.status == "holding" else "",
            fingers=self.fingers.share,
            holding=story.holding,
            T_object=T_object,
            separation=self._separation(q, capsules),
            pace=executor.state,
            status=story.answer.status,
            cpu_s=cpu,
            force=story.force,
            frame=frame,
        )

    def _separation(self, q: np.ndarray, capsules: np.ndarray) -> float:
        """Return the distance of robot and person: exact where they are near [m]."""
        robot = self.planner.robot
        gap = float(ball_gaps(cover_balls(robot, q)[robot.moving], capsules).min())
        return self._audit(q, capsules) if gap < _EXACT else gap

    def _note(self, moment: StoryMoment) -> None:
        """Add a frame to the result."""
        result, story = self.result, self.story
        result.cpu_s.append(moment.cpu_s)
        result.closest = min(result.closest, moment.separation)
        if moment.holding and moment.T_object is not None:
            result.object_contacts += self._object_touches(moment)
        centers = sphere_centers(self.planner.robot, moment.q)
        speed = np.linalg.norm(centers - self._centers, axis=1).max() * RATE
        self._centers, self.speed = centers, float(speed)
        if moment.separation <= 0.0:
            result.contacts += speed > STANDS
            result.standing_contacts += speed <= STANDS
        if moment.separation < 0.3:
            result.fastest_near = max(result.fastest_near, float(speed))
        stands = moment.pace == "braked"
        result.stops += stands and not self._stood
        self._stood = stands
        result.path_changes += moment.status == "replanned"
        self._note_limits(moment)
        if result.handed_s is None and self.index:
            last = story.events[-1] if story.events else None
            passed = last is not None and last.state == table.RETREAT
            if passed and last.signal in ("open", "free"):
                result.handed_s = last.time_s
        if story.ended and result.ended_s is None:
            result.ended_s = moment.now
        result.state, result.outcome = story.state, story.outcome
        result.reason, result.events = story.reason, story.events

    def _note_limits(self, moment: StoryMoment) -> None:
        """Note how much of the joints' limits a frame used."""
        robot, result = self.planner.robot, self.result
        rate, mean = RATE * (moment.ddq - self._ddq), RATE * (moment.dq - self._dq)
        self._dq, self._ddq = moment.dq, moment.ddq
        # a step of the velocity within a frame is in no acceleration that is told
        most = np.maximum(np.abs(moment.ddq), np.abs(mean))
        used = float((most / robot.max_acceleration).max())
        jerk = float(np.abs(rate / robot.max_jerk).max())
        result.acceleration = max(result.acceleration, used)
        result.jerk = max(result.jerk, jerk)
        result.beyond += max(used, jerk) > 1.0 + _ROUNDING

    def _object_touches(self, moment: StoryMoment) -> bool:
        hand_and_forearm = ARM_LABELS[self.story.sight.side][:2]
        others = ~np.isin(moment.frame.human.labels, hand_and_forearm)
        rods = moved_rods(self.setup.obj.capsules, moment.T_object)
        return least_gap(rods, moment.capsules[others]) <= 0.0


def new_story(
    setup: StorySetup, settings: StorySettings, human: Human, fetch: bool = False
) -> Handover:
    """Return a story whose robot stands at rest, with the person at the beginning.

    `fetch`: a giver first takes the object from its place.
    """
    planner, give = setup.planner(), settings.direction == "give"
    if give and not fetch:
        carried = carried_object(box_of(setup.obj))
        planner.attach(carried, setup.obj.T_tool_object)
    robot, view = planner.robot, PhasePlanner(planner)
    executor = Executor(robot, view, setup.rest, 1.0 / RATE, EXECUTION)
    targets = setup.targets(planner, human, settings.threat)
    places = setup.places() if fetch or not give else None
    return Handover(planner, targets, executor, settings, None, places)


def play(
    run: StoryPlay, seconds: float, hear: Callable[[StoryMoment], None] | None = None
) -> StoryResult:
    """Play a run to its end, or until its time is up."""
    while run.index < seconds * RATE and not run.story.ended:
        moment = run.step()
        if hear is not None:
            hear(moment)
    return run.result


def _partner(setup: StorySetup, case: StoryCase, known: object) -> Partner:
    """Return the scripted person; a giver holds out where it is in reach, if it is."""
    body, how = case.body(), {"clear": setup.clear}
    args = body, setup.side, setup.obj, case.traits
    if case.direction == "give":
        return Partner(*args, **how)
    best = [known.target] if known else setup.meet(body).best_takeable(1)
    if not best:
        return Partner(*args, gives=True, **how)
    grasp = setup.obj.hand_grasps[best[0].grasp]
    return Partner(*args, True, best[0].arm_q, grasp, **how)


def rehearse(setup: StorySetup) -> None:
    """Compile and load what the frames of a setup's runs may call.

    Loading compiled code takes 5 to 30 ms at its first call, compiling it seconds: in
    whatever frame first rates a target again, or finds no place to go to.
    """
    exercise(setup.cell_map)
    for direction in DIRECTIONS:
        run = StoryPlay(setup, StoryCase(direction))
        play(run, _SECONDS)
        exercise_choice(run.story.targets)
        _touch(run)
    gc.collect()
    gc.freeze()  # a collection of all that was loaded would be some frame's


def _touch(run: StoryPlay) -> None:
    """Test and evade by the rules of each phase, beside somebody at the hand."""
    view, planner, q = run.story.view, run.planner, run.setup.rest
    tool = tool_pose(planner.robot, q)[:3, 3]
    rows = np.array([[*tool, *tool, 0.05], [*tool + 0.3, *tool + 0.3, 0.05]])
    for phase in (None, run.case.direction):
        view.phase, view.person, view.offered = phase, rows[1:], 0
        view.classes = np.array([TOUCHED.get(phase, AVOID), AVOID], np.int8)
        view.meant = np.zeros(1, np.int64)
        answer = planner.step(Obstacles(capsules=rows), q=q)
        _ = answer.reason, answer.retreat
        view.line_free(q, q + 1e-3, Obstacles(capsules=rows))
        view.evasion(q, [(0.1, Obstacles(capsules=rows))], 0.5)
        view.separation(q)
    view.phase, view.offered = None, 1
    m = planner.cell_map.safety.m
    view.blocked_leg(np.array([q, q + 1e-3]), -m, Obstacles(capsules=rows))
    view.separation(q)
