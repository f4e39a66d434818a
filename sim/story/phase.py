"""The planner as the executor asks it in the last phase: who may touch what.

On the way nothing may touch anything. In the last phase of a give the payload may touch
the receiving hand, of a receive the finger pads the object (`odm.frame.last_phase`);
the arm keeps its whole clearance from both, always.

An object that somebody pushes against a waiting robot is no part of the person: a
retreat may begin within its clearance, even in touch with the cover, if nothing but the
pads comes nearer to it. From the person a retreat keeps what it always keeps. On its
way the robot keeps the whole clearance from where the object is, but only
`OBJECT_KEEPS` from where it can be by the end of a stop: else it would hardly move
beside it.

An object in its place touches what it stands on. So on a straight motion to the place
and back what is held, and nothing else, may touch the scenery; person, robot and object
are tested against each other as on any motion.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from odm.checks import OBJECT
from odm.execution.threat import Threat
from odm.obstacles.obstacles import Obstacles
from odm.planner.planner import ReactivePlanner
from roadmap.geometry.gaps import ball_gaps
from roadmap.kinematics.forward import cover_balls
from roadmap.ranges import check_kind

# Kept from wherever an object that is held out can be while the robot stops [m]. More:
# it stops earlier before one that moves.
OBJECT_KEEPS = 0.005


class PhasePlanner:
    """A planner whose tests of stops know the phase.

    Attributes:
        phase: "give", "receive" or None.
        classes: (k,) class of each shape of the frame.
        offered: How many shapes, the last ones, are what somebody holds out.
        person: (k, 7) the person's capsules in this frame [m].
        held_out: Tests stops against what somebody holds out alone.
        meant: (j,) shapes that are meant to come in a phase: the arm that takes part,
            and the object. They are not evaded then; all others are, as ever.
        hurries: Whether what is held out is too fast to be put between the pads: then
            it is evaded, too.
        looked: Whether an evasion was searched, which takes as long as a path, since
            this was set to False.
        at_place: Whether straight motions lead to the object's place or from it: what
            is held may touch the scenery on them.
    """

    def __init__(self, planner: ReactivePlanner) -> None:
        check_kind("planner", planner, ReactivePlanner, "give an odm.ReactivePlanner")
        self.planner = planner
        self.phase: str | None = None
        self.classes = np.zeros(0, np.int8)
        self.offered = 0
        self.person = np.zeros((0, 7))
        self.held_out = OfferedObject(self)
        self.meant = np.zeros(0, np.int64)
        self.at_place = False
        self.looked = False
        self.hurries = False

    def __getattr__(self, name: str) -> object:
        """Everything else is the planner's."""
        return getattr(self.planner, name)

    def blocked_leg(
        self, path: np.ndarray, extra: float = 0.0, points: Obstacles | None = None
    ) -> int | None:
        """Return the first blocked leg while the robot stops.

        See `ReactivePlanner.blocked_leg`; `points` hold who is there meanwhile.
        """
        if self.phase is None and self.offered and points is not None:
            if extra < -1e-9:
                return self._leg_of_retreat(path, extra, points)
            return self._leg_beside(path, extra, points)
        return self._leg(path, extra, points)

    def _leg(
        self, path: np.ndarray, extra: float, points: Obstacles | None
    ) -> int | None:
        """Return the first blocked leg by the rules of the phase."""
        if self.phase is None or points is None:
            return self.planner.blocked_leg(path, extra, points)
        times = len(points) // max(1, len(self.classes))  # several moments at once
        points.shape_classes = (
            self.classes if times == 1 else np.tile(self.classes, times)
        )
        return self.planner.blocked_leg(path, extra, points, phase=self.phase)

    def _leg_of_retreat(
        self, path: np.ndarray, extra: float, points: Obstacles
    ) -> int | None:
        """Return the first leg that is no way out: clearance was taken off."""
        people, there = self._parted(points)
        leg = self.planner.blocked_leg(path, extra, people)
        if leg is not None:
            return leg
        return self.leg_of_object(path, extra, there)

    def leg_of_object(
        self, path: np.ndarray, extra: float, there: Obstacles
    ) -> int | None:
        """Return the first leg that is no way out from what is held out alone."""
        there.shape_classes[:] = OBJECT
        args = (path, extra, there, "receive")
        return self.planner.blocked_leg(*args, escape=self.phase is None)

    def _leg_beside(
        self, path: np.ndarray, extra: float, points: Obstacles
    ) -> int | None:
        """Return the first leg on which it could be touched by what is held out.

        Or by which it comes nearer than m to where the person can be.
        """
        n = len(points) // max(1, len(self.classes))  # moments
        points.shape_classes.reshape(n, -1)[:, -self.offered :] = OBJECT
        closer = max(self.planner.cell_map.safety.m - OBJECT_KEEPS, 0.0)
        return self.planner.blocked_leg(path, extra, points, nearer=closer)

    def _parted(self, points: Obstacles) -> tuple[Obstacles, Obstacles]:
        """Return the person, and what is held out, at each moment that is told."""
        n = len(points) // max(1, len(self.classes))
        rows = points.capsules.reshape(n, -1, 7)
        parts = rows[:, : -self.offered], rows[:, -self.offered :]
        people, there = (Obstacles(capsules=part.reshape(-1, 7)) for part in parts)
        return people, there

    def evasion(
        self,
        q: np.ndarray,
        coming: Sequence[tuple[float, np.ndarray | Obstacles]],
        speed_scale: float,
    ) -> np.ndarray | None:
        """Return a motion that evades what comes; see `ReactivePlanner.evasion`."""
        self.looked = True
        if self.phase is not None:
            coming = [(t, self._others(there)) for t, there in coming]
        return self.planner.evasion(q, coming, speed_scale)

    def is_met(self, path: np.ndarray, extra: float, coming: Obstacles) -> bool:
        """Whether somebody who is not meant to come comes to a path; see `evasion`."""
        if self.phase is None and not self.hurries:
            return self.blocked_leg(path, extra, coming) is not None
        if self.phase is None:
            return self.planner.blocked_leg(path, extra, coming) is not None
        # of these, nothing may be touched: the phase makes no difference
        return self.planner.blocked_leg(path, extra, self._others(coming)) is not None

    def _others(self, coming: Obstacles) -> Obstacles:
        """Return who is not meant to come, at each moment that is told."""
        rest = np.ones(len(self.classes), bool)
        rest[self.meant] = False
        rows = coming.capsules.reshape(-1, len(self.classes), 7)
        return Obstacles(capsules=rows[:, rest].reshape(-1, 7))  # odm.AVOID, all

    def separation(self, q: np.ndarray) -> float:
        """Return the distance from the person, without what they hold out [m]."""
        if not self.offered:
            return self.planner.separation(q)
        robot = self.planner.static.robot
        if not len(self.person):
            return np.inf
        balls = cover_balls(robot, q)[robot.moving]
        return float(ball_gaps(balls, self.person).min())

    @contextmanager
    def receiving(self, classes: np.ndarray) -> Iterator[None]:
        """Test as in "receive" meanwhile, with these classes (k,) of the shapes."""
        before = self.phase, self.classes
        self.phase, self.classes = "receive", classes
        try:
            yield
        finally:
            self.phase, self.classes = before

    def line_free(self, q: np.ndarray, q_end: np.ndarray, there: Obstacles) -> bool:
        """Whether a straight motion passes all four tests, by the rules of the phase.

        It goes from q (dof,) to q_end, within the limits; `there` are all shapes, in
        the order of `classes`.
        """
        planner = self.planner
        robot = planner.robot
        within = (q_end >= robot.lower) & (q_end <= robot.upper) | robot.continuous
        if not within.all():
            return False
        dq = planner.frame.difference(q, q_end)
        still = planner.static
        if self.at_place:
            if still.touches_itself(q, dq) is not None:
                return False
            still = planner.carrier.bare
        if not still.motion_free(q, dq):
            return False
        return self._leg(np.array([q, q + dq]), 0.0, there) is None


class OfferedObject:
    """What somebody holds out, tested apart from the person while the robot stops.

    The executor's `odm.execution.stop_test.HeldOut`. The shells know neither pads nor a
    way out from what lies against a link already, so this is tested by the cover.
    """

    def __init__(self, view: PhasePlanner) -> None:
        self.view = view

    def parted(self, threat: Threat) -> tuple[Threat, Threat | None]:
        """Return where the person can be, and what they hold out; None: nothing."""
        n = len(threat.error) - self.view.offered
        if not self.view.offered:
            return threat, None
        return threat.of(slice(n)), threat.of(slice(n, None))

    def blocked_leg(
        self, path: np.ndarray, extra: float, points: Obstacles
    ) -> int | None:
        """Return the first blocked leg; `points` is what is held out alone."""
        return self.view.leg_of_object(path, extra, points)
