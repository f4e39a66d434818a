"""A stop tested by the shells of the links, where the cover is too thick for it.

The spheres of the cover stick out of the links by one or two centimetres. Who comes so
near to a robot that stands would pin it: no motion, not even one that leaves, passes
the braking test by its cover. The shells (`Robot.shell_points`) are convex, contain
the links, and stick out of them by a millimetre.

What a link sweeps while q goes straight from q0 to q1: a vertex goes from p0 to p1, and
is never farther from the straight line between the two than |p''| / 8, with p'' bounded
over the whole piece (`motion_bounds`). So the link is within that of the convex hull of
its vertices at q0 and at q1. The person is held meanwhile by capsules
(`odm.execution.threat`). The distance of the hull from a capsule's axis is bounded from
below by GJK; the piece is free where that is at least the capsule's radius, what the
vertices bend, and the margin that was asked for.

Rounded corners are no straight pieces: a motion that has one before its stop fails.
"""

import math
from itertools import pairwise
from typing import Any

import numpy as np

from odm.execution._shell_test import hulls_apart
from odm.execution.settings import StopTestSettings
from odm.execution.threat import Threat
from roadmap.arrays import frozen, writable
from roadmap.geometry.gaps import moved_rods
from roadmap.kinematics import _forward as kernels
from roadmap.motion.motion import Motion
from roadmap.robot.robot import Robot

_BASE = np.array([1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0, 0, 0, 0])


class _Shells:
    """The shells of a robot's moving links, and room for what they sweep."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        sizes = np.diff(robot.shell_ptr)
        body = robot.link_body[robot.shell_link]
        these = np.flatnonzero(body > 0)  # the base does not move
        rows = [np.arange(*robot.shell_ptr[k : k + 2]) for k in these]
        which = np.concatenate([*rows, np.zeros(0, int)])
        self.points = frozen(robot.shell_points[which], np.float64)
        self.body = frozen(np.repeat(body, sizes)[which], np.int32)
        # of one type with those of the close test, so that no loop is compiled twice
        self.tree = writable(robot.tree_i), writable(robot.tree_f)
        self.reach = writable(robot.shell_reach[these])
        # of each hull: its vertices at q0, then at q1
        self.ptr = 2 * np.r_[0, np.cumsum(sizes[these])].astype(np.int64)
        n = len(which)
        shifts = np.repeat(self.ptr[:-1] // 2, sizes[these])
        self._at_0 = np.arange(n) + shifts
        self._at_1 = self._at_0 + np.repeat(sizes[these], sizes[these])
        self.swept = np.zeros((2 * n + 2, 3))
        self._placed = np.zeros((n, 3))
        self._frames = np.zeros((len(robot.tree_i), 12))
        self._rates = np.zeros((2, len(robot.tree_i)))
        self.first, self.second = np.zeros(len(these)), np.zeros(len(these))
        self.room = np.zeros((19, 3))

    def sweep(self, q0: np.ndarray, q1: np.ndarray) -> bool:
        """Place all vertices at both ends of a piece; return whether they are known."""
        for q, rows in ((q0, self._at_0), (q1, self._at_1)):
            kernels.body_frames(*self.tree, writable(q), self._frames)
            kernels.place_points(self._frames, self.body, self.points, self._placed)
            self.swept[rows] = self._placed
        tree = *self.tree, self.reach
        dq = np.ascontiguousarray(q1 - q0)
        kernels.motion_bounds(*tree, dq, self._rates, self.first, self.second)
        return bool(np.isfinite(self.swept).all() and np.isfinite(self.second).all())

    def apart(self, capsules: np.ndarray, least: float) -> bool:
        """Whether what was swept keeps a distance from capsules (j, 7) [m]."""
        rows = np.ascontiguousarray(capsules)
        if not np.isfinite(rows).all():
            return False
        shells = (self.swept, self.ptr, self.second / 8.0, rows, least)
        return bool(hulls_apart(*shells, _BASE, self.room))


class ShellTest:
    """Tests the stops of a retreat against a person who is within the cover."""

    def __init__(self, planner: Any) -> None:  # noqa: ANN401
        self.planner, self.settings = planner, StopTestSettings()
        self._shells: _Shells | None = None

    def passes(
        self,
        motion: Motion,
        t: float,
        begin: float,
        stop: Motion,
        threat: Threat,
        least: float,
    ) -> bool:
        """Whether the links keep `least` [m] from the person to the end of a stop.

        The arguments are those of `BrakingTest.passes`.
        """
        robot = self.planner.static.robot
        shells = self._shells
        if shells is None or shells.robot is not robot:
            shells = self._shells = _Shells(robot)
        if not len(shells.points):
            return False  # a robot without solids is its cover
        before = max(begin - t, 0.0)
        parts = ((motion, t, t + before, 0.0), (stop, 0.0, stop.duration, before))
        return all(self._clear(shells, *part, threat, least) for part in parts)

    def _clear(
        self,
        shells: _Shells,
        motion: Motion,
        begin: float,
        end: float,
        later: float,
        threat: Threat,
        least: float,
    ) -> bool:
        """Test a motion from `begin` to `end`, which is at `later` from now on."""
        if not _is_straight(motion, begin, end):
            return False
        at_once = self.settings.at_once
        n = max(1, math.ceil((end - begin) / self.settings.shell_slice_s - 1e-6))
        times = (begin + (end - begin) * np.arange(n + 1) / n).tolist()
        asked = shells, motion, later - begin, threat, least
        for k in range(0, n, at_once):
            piece = times[k : k + at_once + 1]
            # mostly nobody is so near that several at once are not free
            if self._pieces_free([piece[0], piece[-1]], *asked):
                continue
            if not self._pieces_free(piece, *asked):
                return False
        return True

    def _pieces_free(
        self,
        times: list[float],
        shells: _Shells,
        motion: Motion,
        later: float,
        threat: Threat,
        least: float,
    ) -> bool:
        """Test a motion from time to time; they are so much `later` from now on."""
        T = self.planner.frame.base_world
        for a, b in pairwise(times):
            there, more = threat.between(later + a, later + b)
            if not math.isfinite(more) or not len(there):
                return False
            rows = moved_rods(there.capsules, T)
            rows[:, 6] += more
            corners = motion.path_from(a, motion.place(b))
            legs = list(zip(corners[:-1], corners[1:], strict=True))
            for q0, q1 in legs or [(corners[0], corners[0])]:
                if not (shells.sweep(q0, q1) and shells.apart(rows, least)):
                    return False
        return True


def _is_straight(motion: Motion, begin: float, end: float) -> bool:
    """Whether a motion rounds no corner between two times."""
    a, b = motion.place(begin), motion.place(end)
    pieces = motion.path.pieces
    return not any(p.d > 0.0 and p.end > a and p.begin < b for p in pieces)
