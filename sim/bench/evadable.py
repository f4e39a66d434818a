"""Could a robot that stands have got out of the way? An oracle that knows what comes.

A touch counts here if the robot stood all along: the person came to it. It could have
been evaded if some straight motion to a near node of the roadmap, begun up to a second
before the touch and timed within the joints' limits, is free of limits, of the robot
itself and of its scenery, and touches the person nowhere in that whole second. Their
distance is exact, and the person's shapes are those that truly came. So the oracle is
told what nobody can know, and what it does not find may still exist: it looks at near
nodes only.
"""

from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from odm import ReactivePlanner
from odm.exact.distances import ExactRobot, capsule_obstacles
from roadmap.kinematics.forward import difference
from roadmap.motion.motion import Motion
from sim.loop.loop import Frame
from sim.loop.run_result import MOVING
from sim.people.human_motion import HumanMotion

KNOWN_S = 1.0  # so much of what comes is known [s]
BEFORE_S = (0.75, 0.5, 0.25, 0.1)  # it may set off so long before the touch [s]
NODES = 64  # straight motions that are tried, to those reached soonest
_STEP = 0.01  # [s] the distance is looked at so often
_TOUCHED = 1e-4  # [m] nearer is a touch


@dataclass(frozen=True, eq=False)
class Moment:
    """What the robot did at a moment.

    Attributes:
        time_s: When it was [s].
        motion: The motion in use.
        t: The time on it [s].
    """

    time_s: float
    motion: Motion
    t: float


@dataclass(frozen=True, eq=False)
class Touch:
    """Somebody touched a robot that stood.

    Attributes:
        time_s: When it began [s].
        moments: What the robot did before, of the longest time first.
        stood: The first of the last second from which on it stood, until then.
    """

    time_s: float
    moments: tuple[Moment, ...]
    stood: Moment | None


class TouchWatch:
    """Remembers what a robot did before it was touched; a listener of a timed loop.

    Args:
        loop: Its executor's motion in use is looked at after every frame.

    Attributes:
        touches: Those in which the robot stood all along.
    """

    def __init__(self, loop: Any) -> None:  # noqa: ANN401 (a Loop, or what has one)
        """Nothing was touched."""
        self.loop, self.period = loop, 1.0 / loop.settings.rate_hz
        self.touches: list[Touch] = []
        most = round(max(BEFORE_S) / self.period) + 1
        self._past: deque[Moment] = deque(maxlen=most)
        self._now: Touch | None = None
        self._moved = False
        self._remember(0.0)

    def hear(self, frame: Frame) -> None:
        """Take a frame."""
        time_s = frame.index * self.period
        if frame.separation <= 0.0:
            if self._now is None:
                self._now, self._moved = self._touch(time_s), False
            self._moved |= frame.joint_speed > MOVING
        else:
            self.close()
        self._remember(time_s + self.period)

    def close(self) -> None:
        """End the touch that lasts, if there is one."""
        if self._now is not None and not self._moved:
            self.touches.append(self._now)
        self._now = None

    def _remember(self, time_s: float) -> None:
        executor = self.loop.executor
        self._past.append(Moment(time_s, executor.motion, executor.t))

    def _touch(self, time_s: float) -> Touch:
        asked = (round((time_s - before) / self.period) for before in BEFORE_S)
        past = {round(moment.time_s / self.period): moment for moment in self._past}
        stood = None
        for moment in reversed(self._past):
            if np.abs(moment.motion.at(moment.t).dq).max() > MOVING:
                break
            stood = moment
        return Touch(time_s, tuple(past[k] for k in asked if k in past), stood)


class Oracle:
    """Knows where the person will be within a second.

    Args:
        planner: Its robot, roadmap and scenery count; its frames do not.
        human: The person.
    """

    def __init__(self, planner: ReactivePlanner, human: HumanMotion) -> None:
        """Gather the exact solids."""
        self.planner, self.human = planner, human
        self._exact = ExactRobot(planner.robot)
        self._known: dict[int, Any] = {}

    def evades(self, touch: Touch, standing: bool = False) -> Motion | None:
        """Return a motion that would not have been touched, or None.

        Args:
            touch: What came.
            standing: Whether it may set off only from where it stood then.
        """
        self._known.clear()
        moments = touch.moments
        if standing:
            moments = () if touch.stood is None else (touch.stood,)
        for moment in moments:
            motion = self._evades_from(moment, touch.time_s)
            if motion is not None:
                return motion
        return None

    def _evades_from(self, moment: Moment, touched_s: float) -> Motion | None:
        robot = self.planner.robot
        commit = moment.motion.commit(moment.t)
        nodes = self.planner.cell_map.roadmap.nodes
        ways = np.array([difference(robot, commit.q, node) for node in nodes])
        needed = np.abs(ways / robot.max_velocity).max(axis=1)
        for k in np.argsort(needed, kind="stable")[:NODES]:
            path = np.stack([commit.q, commit.q + ways[k]])
            motion = moment.motion.join(
                moment.t, commit, path, blend=0.0, speed_scale=1.0
            )
            if self._is_free(motion, commit.q, moment.time_s, touched_s):
                return motion
        return None

    def _is_free(
        self, motion: Motion, q: np.ndarray, begin_s: float, touched_s: float
    ) -> bool:
        """Whether a second of a motion is free; q is where it becomes a new one."""
        count = round(KNOWN_S / _STEP)
        steps = np.arange(count + 1)
        first = np.abs(begin_s + _STEP * steps - touched_s).argsort(kind="stable")
        for k in first:  # most are touched about then
            at = motion.at(_STEP * k).q
            if self._exact.collides(at, self._person(begin_s + _STEP * k), _TOUCHED):
                return False
        dq = difference(self.planner.robot, q, motion.at(KNOWN_S).q)
        return bool(self.planner.static.motion_free(q, dq))

    def _person(self, time_s: float) -> Any:  # noqa: ANN401 (of the exact audit)
        key = round(time_s / _STEP)
        if key not in self._known:
            rows = self.human.capsules(time_s)
            self._known[key] = capsule_obstacles(rows)
        return self._known[key]
