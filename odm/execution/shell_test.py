"""A stop tested by the shells of the links, where the cover is too thick for it.

Who comes so near to a robot that stands that they are within its cover would pin it: no
motion, not even one that leaves, passes the braking test by the cover. The shells
(`odm.close_test.shells`) stick out of the links by a millimetre. The person is held
meanwhile by capsules (`odm.execution.threat`); a piece of the stop is free where what
the links sweep keeps from them the margin that was asked for.

Rounded corners are no straight pieces: a motion that has one before its stop fails.
"""

import math
from itertools import pairwise
from typing import Any

import numpy as np

from odm.close_test.shells import Hulls, Shells
from odm.execution.settings import StopTestSettings
from odm.execution.threat import Threat
from roadmap.geometry.gaps import moved_rods
from roadmap.motion.motion import Motion


class ShellTest:
    """Tests the stops of a retreat against a person who is within the cover.

    Args:
        planner: Of this package; its frame has what stands still.
        latency_s: The robot is where its set-point was up to so long ago [s].
    """

    def __init__(self, planner: Any, latency_s: float = 0.0) -> None:  # noqa: ANN401
        self.planner, self.settings = planner, StopTestSettings()
        self.latency_s = latency_s
        self._shells: Shells | None = None

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
            shells = self._shells = Shells(robot)
        if not shells.complete:
            return False  # a link without a shell is its cover
        before = max(begin - t, 0.0)
        parts = ((motion, t, t + before, 0.0), (stop, 0.0, stop.duration, before))
        return all(self._clear(shells, *part, threat, least) for part in parts)

    def _clear(
        self,
        shells: Shells,
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
        shells: Shells,
        motion: Motion,
        later: float,
        threat: Threat,
        least: float,
    ) -> bool:
        """Test a motion from time to time; they are so much `later` from now on."""
        T = self.planner.frame.base_world
        for a, b in pairwise(times):
            there, more = threat.between(later + a, later + b + self.latency_s)
            if not math.isfinite(more) or not len(there):
                return False
            rows = moved_rods(there.capsules, T)
            rows[:, 6] += more
            shells.show(Hulls.of_rods(rows))
            corners = motion.path_from(a, motion.place(b))
            legs = list(zip(corners[:-1], corners[1:], strict=True))
            for q0, q1 in legs or [(corners[0], corners[0])]:
                if not (shells.sweep(q0, q1) and shells.apart(least)):
                    return False
        return True


def _is_straight(motion: Motion, begin: float, end: float) -> bool:
    """Whether a motion rounds no corner between two times."""
    a, b = motion.place(begin), motion.place(end)
    pieces = motion.path.pieces
    return not any(p.d > 0.0 and p.end > a and p.begin < b for p in pieces)
