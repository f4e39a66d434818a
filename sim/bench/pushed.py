"""A robot that is pushed: it is not where its set-point is, nor where it is measured.

Three things happen to it, several times a minute and the same for the same seed:

- a *push*: somebody leans on it. Its joints give way along a smooth curve, stay, and
  come back when they are released;
- a *bump*: the same within one to three frames;
- a *slip*: a bump after which it stays where it is, until its controller takes that for
  its set-point (or for some seconds).

The controller brings what its encoders say to the set-point. So a steady error of the
encoders cannot be seen: the true robot is beside the set-point by that error.

Where the set-point is set anew to where the robot was measured (`Executor.locate`), the
robot does not jump: its distance from the set-point fades within a fifth of a second or
so. A robot that is held down while its set-point is set anew gives way farther.

No push moves a joint past its limits, or the robot into itself or its scenery: a real
robot has mechanical stops. Nor does a push bring the robot nearer to the person than
`keep_off`. When a push ends, the controller takes the robot back to the set-point; that
motion is not tested against the person.

A contact counts only while the set-point moves, for then the robot moves by itself.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from roadmap.kinematics.forward import difference, sphere_centers, wrapped
from roadmap.motion.blending import joint_motion_bounds
from roadmap.ranges import CheckedSettings, setting
from roadmap.robot.robot import Robot
from sim.loop.loop import Frame, Loop, LoopSettings, run_frames
from sim.loop.run_result import RunResult
from sim.people.human_motion import HumanMotion

PUSH, BUMP, SLIP = KINDS = ("push", "bump", "slip")
_OFTEN = (0.5, 0.3, 0.2)  # share of each kind
_PARTS = (1.0, 0.5, 0.25, 0.0)  # shares of a movement that are tried
_ROUNDING = 1e-9  # [rad or m]
_JUMPED = 1e-6  # a set-point that moves by more between two frames was set anew


@dataclass(frozen=True)
class PushSettings(CheckedSettings):
    """How a robot is pushed.

    Attributes:
        pause: Mean time between two pushes [s].
        push, bump: No point of the robot is pushed or bumped farther than this [m].
        encoder: Nor is one farther than this from where the encoders say [m]. The
            executor must be told, and it must be less than the tracking share of m.
        keep_off: No push brings the robot nearer to the person than this [m].
        jump_fades_s: Time in which what a jump of the set-point left fades [s].
        slipped_s: A slip that is not taken for the set-point ends after this [s].
        lever: A joint that moves no point by more is not pushed [m by rad or m].
    """

    pause: float = setting(5.0, 0.1, 1e6, "s")
    push: float = setting(0.06, 0.0, 1.0, "m")
    bump: float = setting(0.04, 0.0, 1.0, "m")
    encoder: float = setting(0.001, 0.0, 0.1, "m")
    keep_off: float = setting(0.02, 0.0, 10.0, "m")
    jump_fades_s: float = setting(0.2, 0.001, 60.0, "s")
    slipped_s: float = setting(4.0, 0.001, 3600.0, "s")
    lever: float = setting(0.02, 0.0, 10.0, "m")


@dataclass(frozen=True, eq=False)
class Push:
    """One push: its size over time is a trapezoid with rounded corners.

    Attributes:
        kind: One of `KINDS`.
        begin: When it begins [s].
        rise, hold, fall: How long it grows, stays and fades [s].
        dq: (dof,) how far the joints give way [rad or m].
    """

    kind: str
    begin: float
    rise: float
    hold: float
    fall: float
    dq: np.ndarray

    @property
    def end(self) -> float:
        """When it is over [s]."""
        return self.begin + self.rise + self.hold + self.fall

    def at(self, t: float) -> np.ndarray:
        """Return (dof,) how far the joints give way at a time [s]."""
        return self._share(t) * self.dq

    def _share(self, t: float) -> float:
        grown = (t - self.begin) / self.rise
        left = (self.end - t) / self.fall
        x = min(max(min(grown, left), 0.0), 1.0)
        return x * x * (3.0 - 2.0 * x)


class Pushes:
    """The pushes of a seed, one after the other, whatever the robot does.

    Args:
        robot: The robot.
        period: Time between frames [s].
        seed: Anything that seeds `numpy.random.default_rng`.
        settings: See PushSettings.
    """

    def __init__(
        self, robot: Robot, period: float, seed: object, settings: PushSettings
    ) -> None:
        self.settings, self.period = settings, period
        self._rng = np.random.default_rng(seed)
        self._motion_bound = joint_motion_bounds(robot)
        self.error = self._drawn(settings.encoder, len(self._motion_bound))
        self.now = self._next(0.0)

    def at(self, t: float) -> Push:
        """Return the push of a time [s], which never goes back."""
        while t >= self.now.end:
            self.now = self._next(self.now.end)
        return self.now

    def _next(self, t: float) -> Push:
        rng, s = self._rng, self.settings
        begin = t + s.pause * rng.uniform(0.4, 1.6)
        kind = str(rng.choice(KINDS, p=_OFTEN))
        sudden = self.period * int(rng.integers(1, 4))
        slow = rng.uniform(0.15, 0.4)
        hold, fall = rng.uniform(0.0, 1.5), rng.uniform(0.2, 0.6)
        most = s.push if kind == PUSH else s.bump
        dq = self._drawn(most * rng.uniform(0.3, 1.0), int(rng.integers(1, 4)))
        rise = slow if kind == PUSH else sudden
        hold = {PUSH: hold, BUMP: 0.1 * hold, SLIP: s.slipped_s}[kind]
        return Push(kind, begin, rise, hold, fall, dq)

    def _drawn(self, size: float, joints: int) -> np.ndarray:
        """Return (dof,) a movement of some joints, of any point by `size` at most."""
        rng, bound = self._rng, self._motion_bound
        chosen = rng.permutation(np.flatnonzero(bound > self.settings.lever))[:joints]
        dq = np.zeros(len(bound))
        shares = rng.dirichlet(np.ones(len(chosen))) * rng.choice((-1, 1), len(chosen))
        dq[chosen] = size * shares / bound[chosen]
        return dq


class PushedRobot:
    """Where a robot is that is pushed while its set-point goes its way.

    Args:
        robot: The robot.
        q: (dof,) its set-point [rad or m].
        pushes: What happens to it.
        may_be: q -> whether a mechanical stop lets the robot be there.

    Attributes:
        q: (dof,) where it is [rad or m].
        count: Pushes so far by kind.
        seats: Times its set-point was set anew.
        farthest: The farthest any point of it was from the set-point's [m].
    """

    def __init__(
        self,
        robot: Robot,
        q: np.ndarray,
        pushes: Pushes,
        may_be: Callable[[np.ndarray], bool],
    ) -> None:
        self.robot, self.pushes, self._may_be = robot, pushes, may_be
        self._point, self._t = np.array(q, float), 0.0
        self.q = self._point - pushes.error
        self.count, self.seats, self.farthest = dict.fromkeys(KINDS, 0), 0, 0.0
        self._seen = self._over = None  # the push counted last; the slip that is over

    @property
    def measured(self) -> np.ndarray:
        """(dof,) what the encoders say [rad or m]."""
        return wrapped(self.robot, self.q + self.pushes.error)

    def follow(
        self,
        before: np.ndarray,
        after: np.ndarray,
        gap: Callable[[np.ndarray], float] | None = None,
    ) -> None:
        """Let one period pass.

        Args:
            before: (dof,) the set-point at its begin; set anew if it is not the one of
                the last period's end.
            after: (dof,) the set-point at its end.
            gap: q -> distance of the robot there and the person [m]; None: nobody.
        """
        t, self._t = self._t, self._t + self.pushes.period
        push = self.pushes.at(t)
        if np.abs(difference(self.robot, self._point, before)).max() > _JUMPED:
            self.seats += 1
            self._over = push if push.kind == SLIP and t > push.begin else self._over
        offset = difference(self.robot, before, self.q)
        left = offset - self._pulled(push, t)  # fades; most of the time it is none
        fades = math.exp(-self.pushes.period / self.pushes.settings.jump_fades_s)
        target = self._pulled(push, self._t) + fades * left
        away = (np.abs(target) > np.abs(offset) + _ROUNDING).any()
        self._note(push)
        self._point = np.array(after, float)
        offset = self._stopped(after, offset, target, gap if away else None)
        self.q = wrapped(self.robot, after + offset)
        off = sphere_centers(self.robot, after) - sphere_centers(self.robot, self.q)
        most = np.linalg.norm(off, axis=1).max(initial=0.0)
        self.farthest = max(self.farthest, float(most))

    def figures(self) -> dict:
        """Return what happened to it, as plain data."""
        return {
            **self.count,
            "farthest_m": self.farthest,
            "seats": self.seats,
            "encoder_m": self.pushes.settings.encoder,
        }

    def _pulled(self, push: Push, t: float) -> np.ndarray:
        """Return how far beside the set-point the robot settles [rad or m]."""
        if push is self._over:
            return -self.pushes.error
        return push.at(t) - self.pushes.error

    def _stopped(
        self,
        point: np.ndarray,
        offset: np.ndarray,
        target: np.ndarray,
        gap: Callable[[np.ndarray], float] | None,
    ) -> np.ndarray:
        """Return how far from `offset` to `target` it gets; back if it cannot be."""
        least = 0.0
        if gap is not None:
            least = min(self.pushes.settings.keep_off, gap(point + offset))
        for part in _PARTS:
            there = offset + part * (target - offset)
            near = gap is not None and part > 0.0 and gap(point + there) < least
            if not near and self._may_be(wrapped(self.robot, point + there)):
                return there
        for part in (0.75, 0.5, 0.25):
            if self._may_be(wrapped(self.robot, point + part * offset)):
                return part * offset
        return 0.0 * offset

    def _note(self, push: Push) -> None:
        if push is not self._seen and self._t > push.begin:
            self._seen = push
            self.count[push.kind] += 1


def mechanical_stop(planner: object, robot: Robot) -> Callable[[np.ndarray], bool]:
    """Return whether the robot can be at a q: its limits, itself and its scenery.

    The planner's own static test, which keeps m from scenery; for planners without
    one, the limits alone.
    """
    static = getattr(planner, "static", None)
    still = np.zeros(robot.dof)

    def may_be(q: np.ndarray) -> bool:
        within = (q >= robot.lower) & (q <= robot.upper) | robot.continuous
        return bool(within.all()) and (static is None or static.motion_free(q, still))

    return may_be


class PushedLoop(Loop):
    """A loop whose robot is pushed, by the seed and the motion's name.

    The arguments are those of `Loop`, and how it is pushed.

    Attributes:
        body: Where the robot truly is.
    """

    def __init__(
        self,
        planner: object,
        robot: Robot,
        places: np.ndarray,
        motion: HumanMotion | None,
        settings: LoopSettings,
        pushed: PushSettings,
    ) -> None:
        super().__init__(planner, robot, places, motion, settings, pushed.encoder)
        name = "none" if motion is None else motion.name
        seed = [settings.seed, *name.encode()]
        pushes = Pushes(robot, 1.0 / settings.rate_hz, seed, pushed)
        stop = mechanical_stop(planner, robot)
        self.body = PushedRobot(robot, self.places[0], pushes, stop)
        self._q = self.body.q
        self._centers = sphere_centers(robot, self._q)

    def frame(self) -> Frame:
        """Measure where the robot is, then go on as any loop."""
        self.executor.locate(self.body.measured)
        return super().frame()

    def _advance(self) -> None:
        before, now = self.executor.set_point.q, self.index / self.settings.rate_hz
        near = () if self.motion is None else self.motion.capsules(now)
        self._q = before
        super()._advance()
        gap = (lambda q: self._audit(q, near)) if len(near) else None
        self.body.follow(before, self.executor.set_point.q, gap)
        self._q = self.body.q


def run_pushed(
    loop: PushedLoop, on_frame: Callable[[Frame], None] | None = None
) -> RunResult:
    """Run a loop that was not begun for its whole duration, see `run_frames`."""
    return replace(run_frames(loop, on_frame), pushed=loop.body.figures())
