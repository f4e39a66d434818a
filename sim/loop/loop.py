"""The loop: person, planner, robot and exact audit, frame by frame."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from odm.execution.executor import BRAKED, RETREATING, SLOWED, Executor
from odm.execution.kinematic import KinematicMover
from odm.execution.settings import ExecutionSettings
from odm.execution.speed_limit import NOBODY
from odm.execution.threat import Threat, Watcher
from odm.obstacles.obstacles import Obstacles
from roadmap.arrays import as_floats, frozen
from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference, sphere_centers
from roadmap.kinematics.joint_tree import check_robot
from roadmap.ranges import CheckedSettings, check_kind, setting, settings_of, told
from roadmap.robot.robot import Robot
from sim.loop.garbage import NotCollected
from sim.loop.run_result import RETREATS, STATUS, RunResult, holds_of, new_paths
from sim.people.human_motion import HumanMotion

ARRIVED = 1e-6  # largest joint difference at which a work place is reached

MOVERS = {"kinematic": KinematicMover, "timed": Executor}

Audit = Callable[[np.ndarray, np.ndarray], float]


@dataclass(frozen=True)
class LoopSettings(CheckedSettings):
    """How long and how fast the loop runs.

    Attributes:
        rate_hz: Frames per second.
        duration_s: Simulated time [s].
        seed: Seed of the human motion, noted in the result.
        speed_scale: Share of the joints' speed limits the robot uses.
        retreat_scale: Share of the limits when it retreats.
        min_retreat_separation: No retreat where the separation, extrapolated by two
            frames, is below this [m]: to be touched at rest is the lesser evil.
        keep_paths: Keep the planned path of every n-th frame for pictures; 0: none.
        improve: Motions the planner may test between two frames to shorten its path;
            eight times as many in a frame that found a new one and in the next two:
            its beginning is soon behind the robot.
        execution: "kinematic": at speed limits, stopping at once; "timed": within
            limits of acceleration and jerk, with a braking test in every frame.
        yields: Whether a timed robot gets out of the way of who comes at it.
        once: Stay at the last work place, which ends the trip; else go round.
    """

    rate_hz: float = setting(100.0, 1e-9, 1e9)
    duration_s: float = setting(20.0, 1e-9, 1e9)
    seed: int = setting(0, 0, 2**63)
    speed_scale: float = setting(0.5, 1e-6, 1.0)
    retreat_scale: float = setting(0.25, 1e-6, 1.0)
    min_retreat_separation: float = setting(0.005, 0.0, np.inf, "m")
    keep_paths: int = setting(0, 0, 2**63)
    improve: int = setting(4, 0, 2**63)
    execution: str = "kinematic"
    yields: bool = True
    once: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.execution, str) and self.execution in MOVERS):
            raise BadInput(
                f"execution is {told(self.execution)}; choose one of "
                f"{', '.join(MOVERS)}"
            )


@dataclass(frozen=True)
class NewPathSettings(CheckedSettings):
    """What the loop does for new paths, which `LoopSettings` says nothing of.

    Attributes:
        frames: How many frames a path counts as new.
        times: Factor on `LoopSettings.improve` while the path is new: its beginning is
            soon behind the robot, so it is shortened first.
        expected: New paths keep clear of where the person will be at these times [s].
    """

    frames: int = setting(3, 1, 1000)
    times: int = setting(8, 1, 1000)
    expected: tuple[float, ...] = setting((0.1, 0.2, 0.3, 0.4), 0.0, 10.0, "s")


_NEW_PATHS = NewPathSettings()


@dataclass(frozen=True, eq=False)
class Frame:
    """One turn of the loop, as the robot and the person stood when it began."""

    index: int  # number of the frame
    # (dof,) configuration [rad or m]; of a pushed robot, where it truly is
    q: np.ndarray
    capsules: np.ndarray  # (k, 7) person [m]
    answer: object  # what the planner said
    place: int  # index of the work place the robot is on its way to
    separation: float  # exact distance of robot and person [m]
    # fastest joint [rad/s or m/s] and fastest point of the robot [m/s] since the frame
    # before; the joint is the set-point's, the point the robot's: a push alone is no
    # movement of its own
    joint_speed: float
    point_speed: float
    # time of the planner's step, timing and braking test [s]
    wall_s: float
    cpu_s: float
    # time of its improving after the answer [s]
    improve_s: float
    improve_cpu_s: float = 0.0
    # (dof,) velocity and acceleration of the set-point
    dq: np.ndarray | None = None
    ddq: np.ndarray | None = None
    pace: str = ""  # what the executor does: "moving", "slowed", "braked", ...
    brake: str = ""  # why it is slowed or braked
    # whether it retreats, and in this hold began to within the clearance
    escape: bool = False
    # (k, 7) where the person is [m]; None where `capsules` say it
    guess: np.ndarray | None = None


class Loop:
    """The world's state between frames; the robot goes round the work places.

    Args:
        planner: Any object with `set_goals` and `step` of `odm.ReactivePlanner`.
        robot: The planner's robot.
        places: (n, dof) at least two configurations; the robot starts at the first.
        motion: The person; None runs without one.
        settings: Rate and speeds.
        encoder_error: No point of the robot is farther from where it is measured [m].
    """

    def __init__(
        self,
        planner: object,
        robot: Robot,
        places: np.ndarray,
        motion: HumanMotion | None,
        settings: LoopSettings | None = None,
        encoder_error: float = 0.0,
    ) -> None:
        self.settings = settings_of(settings, LoopSettings)
        if not (hasattr(planner, "step") and hasattr(planner, "set_goals")):
            check_kind("planner", planner, (), "give an odm.ReactivePlanner")
        self.robot, self.planner, self.motion = robot, planner, motion
        self.places = _checked_places(robot, places)
        self.trips, self.index, self.place = 0, 0, 1
        self._audit = exact_audit(robot)
        s = self.settings
        shares = ExecutionSettings(
            s.speed_scale,
            s.retreat_scale,
            s.yields,
            min_retreat_separation=s.min_retreat_separation,
            encoder_error=encoder_error,
        )
        self.executor = MOVERS[s.execution](
            robot, planner, self.places[0].copy(), 1.0 / s.rate_hz, shares
        )
        self._watcher = Watcher()
        self._shapes = Obstacles()
        self._retreats = self._escape = False
        self._new_path_for = 0  # frames in which the path in use counts as new
        self._q, self._moved = self.places[0].copy(), np.zeros(robot.dof)
        self._centers = sphere_centers(robot, self._q)
        _optional(planner, "reset")
        planner.set_goals([self.places[1]])

    def frame(self) -> Frame:
        """Let the planner answer, audit the moment, and move on by one period."""
        now = self.index / self.settings.rate_hz
        capsules = NOBODY if self.motion is None else self.motion.capsules(now)
        guess = self._guess(now)
        point = self.executor.set_point
        with NotCollected():
            wall, cpu = time.perf_counter(), time.thread_time()
            commit = self.executor.commit()
            threat = self._threat(capsules, now)
            answer = self.planner.step(
                self._shapes_of(capsules), q=commit.q, dq=point.dq, stamp=now, now=now
            )
            self.executor.update(answer, commit, threat)
            cpu, wall = time.thread_time() - cpu, time.perf_counter() - wall
        separation = self._separation(capsules if guess is None else guess)
        escape = self._escapes(answer.status == "holding")
        new = answer.status == "replanned"
        self._new_path_for = _NEW_PATHS.frames if new else self._new_path_for - 1
        improve_s, improve_cpu_s = self._improve()
        frame = Frame(
            index=self.index,
            q=self._q,
            capsules=capsules,
            answer=answer,
            place=self._goes_to(),
            separation=separation,
            joint_speed=float(np.abs(self._moved).max()),
            point_speed=self._point_speed(),
            wall_s=wall,
            cpu_s=cpu,
            improve_s=improve_s,
            improve_cpu_s=improve_cpu_s,
            dq=point.dq,
            ddq=point.ddq,
            pace=self.executor.state,
            brake=self.executor.reason,
            escape=escape,
            guess=guess,
        )
        self._move()
        return frame

    def _goes_to(self) -> int:
        """Return the number of the work place that the answer leads to."""
        return self.place

    def _move(self) -> None:
        self._advance()
        executor = self.executor
        off = difference(self.robot, executor.set_point.q, self.places[self.place])
        if executor.at_rest and np.abs(off).max() <= ARRIVED:
            if self.settings.once and self.place == len(self.places) - 1:
                self.trips = 1
                return
            self.trips += 1
            self.place = (self.place + 1) % len(self.places)
            self.planner.set_goals([self.places[self.place]])
            executor.new_goal()

    def _advance(self) -> None:
        """Let one period pass."""
        before = self._q
        self.executor.advance()
        self._q = self.executor.set_point.q
        self._moved = difference(self.robot, before, self._q) * self.settings.rate_hz
        self.index += 1

    def _threat(self, capsules: np.ndarray, now: float) -> Threat | None:
        """Look where the person can be, and tell the planner where they will be."""
        if not (len(capsules) and self.executor.brakes):
            return None
        threat = self._watcher.look(capsules, now)
        likely = threat.likely(*_NEW_PATHS.expected)
        if likely is not None:
            _optional(self.planner, "expect", likely)
        return threat

    def _shapes_of(self, capsules: np.ndarray) -> Obstacles:
        """Return the person's capsules as the planner takes them."""
        if len(capsules) != len(self._shapes):
            self._shapes = Obstacles(capsules=len(capsules))
        self._shapes.capsules = capsules
        return self._shapes

    def _guess(self, now: float) -> np.ndarray | None:
        """Return where the person is, not only might be, for motions that know it."""
        guess = getattr(self.motion, "guess", None)  # of parts that were not seen
        return None if guess is None else guess(now)

    def _separation(self, capsules: np.ndarray) -> float:
        """Return the exact distance of the robot and the person [m]."""
        return self._audit(self._q, capsules) if len(capsules) else np.inf

    def _escapes(self, holding: bool) -> bool:
        """Return whether it retreats, in this hold, from points within clearance."""
        before, self._retreats = self._retreats, self.executor.state == RETREATING
        if not holding:
            self._escape = False
        elif self._retreats and not before:
            keep = getattr(self.planner, "keep", 0.0)
            self._escape |= bool(self.planner.separation(self._q) < keep)
        return self._retreats and self._escape

    def _improve(self) -> tuple[float, float]:
        """Return the time it took: passed, and computed [s]."""
        begun, busy = time.perf_counter(), time.thread_time()
        if self.settings.improve:
            ahead = self.executor.next_commit()
            times = _NEW_PATHS.times if self._new_path_for > 0 else 1
            most = times * self.settings.improve
            _optional(self.planner, "improve", most, ahead)
        return time.perf_counter() - begun, time.thread_time() - busy

    def _point_speed(self) -> float:
        before, self._centers = self._centers, sphere_centers(self.robot, self._q)
        step = np.linalg.norm(self._centers - before, axis=1).max(initial=0.0)
        return float(step * self.settings.rate_hz)


def run_loop(
    planner: object,
    robot: Robot,
    places: np.ndarray,
    motion: HumanMotion | None,
    settings: LoopSettings | None = None,
    on_frame: Callable[[Frame], None] | None = None,
) -> RunResult:
    """Run the loop for its whole duration, with the arguments of `Loop`; return all.

    `on_frame` is called after every frame, for a picture or a progress bar. The same
    input gives the same result but for the clock's figures.
    """
    return run_frames(Loop(planner, robot, places, motion, settings), on_frame)


def run_frames(
    loop: Loop, on_frame: Callable[[Frame], None] | None = None
) -> RunResult:
    """Run a loop that was not begun for its whole duration; see `run_loop`."""
    frames = []
    paths = {}
    keep = loop.settings.keep_paths
    for index in range(max(1, round(loop.settings.duration_s * loop.settings.rate_hz))):
        frame = loop.frame()
        if keep and index % keep == 0:
            paths[index] = np.array(frame.answer.path, np.float64)
        frames.append(replace(frame, answer=light(frame.answer, frames)))
        if on_frame is not None:
            on_frame(frame)
    return result_of(loop, frames, paths)


def exact_audit(robot: Robot) -> Audit:
    """Return the exact distance of the robot's moving solids to capsules."""
    from odm.exact.distances import ExactRobot, capsule_obstacles

    exact = ExactRobot(robot)

    def distance(q: np.ndarray, capsules: np.ndarray) -> float:
        return exact.distance(q, capsule_obstacles(capsules)).distance

    return distance


def _optional(planner: object, name: str, *args: object) -> None:
    """Call what the real planner has and a simpler one may lack."""
    if hasattr(planner, name):
        getattr(planner, name)(*args)


@dataclass(frozen=True)
class _Light:
    """What the result needs of an answer, without its arrays."""

    status: str
    reason: str
    stages: dict[str, float]


def light(answer: object, frames: list[Frame]) -> _Light:
    """Return what the result needs of an answer; a reason is kept once a hold."""
    held = frames[-1].answer.status == "holding" if frames else False
    new = answer.status == "holding" and not held  # to explain takes some time
    reason = answer.reason or "" if new else ""
    return _Light(answer.status, reason, dict(answer.latency_s))


def retreat_of(frame: Frame) -> str:
    """Return the name of what the robot does in a frame, one of `RETREATS`."""
    if frame.pace != RETREATING:
        return RETREATS[0]
    return RETREATS[2] if frame.escape else RETREATS[1]


def result_of(loop: Loop, frames: list[Frame], paths: dict) -> RunResult:
    """Return the frames of a loop as a result."""
    answers = [frame.answer for frame in frames]
    names = sorted({name for answer in answers for name in answer.stages})
    place = np.array([frame.place for frame in frames])
    status = np.array([STATUS.index(answer.status) for answer in answers])
    retreat = [RETREATS.index(retreat_of(frame)) for frame in frames]
    columns = ("q", "capsules", "separation", "joint_speed", "point_speed")
    rows = {name: [getattr(frame, name) for frame in frames] for name in columns}
    rate = loop.settings.rate_hz
    return RunResult(
        motion="none" if loop.motion is None else loop.motion.name,
        seed=loop.settings.seed,
        rate_hz=rate,
        trips=loop.trips,
        path_changes=new_paths(status, place),
        holds=holds_of(status, rows["joint_speed"], lambda i: answers[i].reason, rate),
        status=status,
        place=place,
        wall_s=[frame.wall_s for frame in frames],
        cpu_s=[frame.cpu_s for frame in frames],
        improve_s=[frame.improve_s for frame in frames],
        retreat=retreat,
        improve_cpu_s=[frame.improve_cpu_s for frame in frames],
        stages={n: [a.stages.get(n, 0.0) for a in answers] for n in names},
        paths=paths,
        slowed_s=slowed_of(frames) / rate if loop.executor.brakes else None,
        **rows,
    )


def slowed_of(frames: list[Frame]) -> int:
    """Return in how many frames it had a path and was slowed or braked for somebody."""
    led = (frame.pace for frame in frames if frame.answer.status != "holding")
    return sum(pace in (SLOWED, BRAKED) for pace in led)


def _checked_places(robot: Robot, places: np.ndarray) -> np.ndarray:
    check_robot(robot, "max_velocity")
    places = frozen(as_floats("work places", places), np.float64)
    if places.ndim != 2 or len(places) < 2 or places.shape[1] != robot.dof:
        raise BadInput(
            f"work places have the shape {places.shape}; give at least two "
            f"configurations of {robot.dof} joints, (n, {robot.dof})"
        )
    return places
