"""The close test: whether motions keep their distance from points, without cells."""

import numpy as np

from odm.close_test import _close as close
from odm.close_test._arm import Arm, Clearance, Work
from odm.obstacles._cloud import Cloud


class CloseTest:
    """A robot's spheres, the distance that each keeps, and what blocked them last.

    Args:
        arm: The robot.
        radii: (n,) sphere radius + covering radius + clearance [m].
        tolerance: No piece of a motion is inflated by more [m].
        work: Scratch; two tests may share it, but not two threads.
    """

    def __init__(
        self, arm: Arm, radii: np.ndarray, tolerance: float, work: Work
    ) -> None:
        """Keep what compiled loops take."""
        self.group = Clearance(arm, radii, tolerance, work)

    def grown(self, extra: float) -> "CloseTest":
        """Return the same test with so much more distance [m]."""
        arm, radii, tolerance, work = self.group
        return CloseTest(arm, radii + extra, tolerance, work)

    def clear(
        self, q: np.ndarray, dq: np.ndarray, cloud: Cloud, escape: bool = False
    ) -> bool:
        """Return whether q + t dq, t in [0, 1], keeps its distance from sorted points.

        With `escape` points that are nearer already only must not come nearer; see
        `_close.place_anchor`.
        """
        return close.motion_clear(self.group, q, dq, cloud, escape)

    def first_blocked(self, path: np.ndarray, cloud: Cloud) -> int | None:
        """Return the first leg of a path (k, dof) that is not clear, or None."""
        leg = np.empty(path.shape[1])
        k = close.first_blocked(self.group, path, cloud, leg)
        return None if k < 0 else k

    def separation(self, q: np.ndarray, cloud: Cloud, limit: float = np.inf) -> float:
        """Return the least distance of the spheres from points, at most `limit` [m]."""
        return close.separation(self.group.arm, q, cloud, limit, self.group.work)

    @property
    def blocked_by(self) -> tuple[int, int]:
        """The sphere and the point of the last answer; -1 where there was none."""
        sphere, point = self.group.work.found[:2].tolist()
        return sphere, point

    @property
    def blocked_at(self) -> float:
        """Share of the motion at which the last one was blocked."""
        return float(self.group.work.value[0])

    @property
    def missing(self) -> float:
        """How much too near the last motion came [m]."""
        radius = self.group.radii[self.group.work.found[0]]
        return float(radius - self.group.work.value[1])
