"""Motions timed in the frame before, for a robot that has to stand.

Who is braked where it stands asks in every frame for the same motion along the same
path, and for the same at a lower speed: milliseconds of timing. A motion never changes,
so neither do the answers.
"""

from functools import partial

import numpy as np

from roadmap.motion.motion import Commit, Motion
from roadmap.robot.robot import Robot


class TimedBefore:
    """Joins and rescales motions; what was asked last is answered as it was."""

    def __init__(self) -> None:
        self._joined: tuple[tuple, np.ndarray, Motion] | None = None
        self._rescaled: tuple[tuple, Motion] | None = None

    def join(
        self,
        motion: Motion,
        t: float,
        commit: Commit,
        path: np.ndarray,
        blend: float,
        speed_scale: float,
        robot: Robot | None = None,
    ) -> Motion:
        """Return `motion.join`: the one of before, of a motion that is over."""
        join = partial(motion.join, blend=blend, speed_scale=speed_scale, robot=robot)
        if t < motion.duration:
            return join(t, commit, path)
        of = (motion, commit.s, commit.begin, blend, speed_scale, robot)
        known = self._joined
        if known is None or not (_same(known[0], of) and _equal(known[1], path)):
            known = self._joined = of, np.array(path), join(t, commit, path)
        return known[2]

    def rescaled(self, motion: Motion, t: float, speed_scale: float) -> Motion:
        """Return `motion.rescaled`: the one of before, of the same time on it."""
        of, known = (motion, t, speed_scale), self._rescaled
        if known is None or not _same(known[0], of):
            known = self._rescaled = of, motion.rescaled(t, speed_scale)
        return known[1]


def _same(one: tuple, other: tuple) -> bool:
    """Whether motions are the same object, and numbers the same number."""
    return one[0] is other[0] and one[1:] == other[1:]


def _equal(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two paths have the same bytes."""
    return one.shape == other.shape and one.tobytes() == other.tobytes()
