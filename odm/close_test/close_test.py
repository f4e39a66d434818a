"""The close test: whether motions keep their distance from obstacles, without cells."""

import numpy as np

from odm._groups import new
from odm.close_test import _close as close
from odm.close_test._arm import Arm, Clearance, Work
from odm.obstacles._cloud import Cloud
from odm.obstacles._solids import Solids

NO_SOLIDS = new(Solids, {"shapes": 0, "faces": 0})


class CloseTest:
    """A robot's spheres, the distance that each keeps, and what blocked them last.

    Args:
        arm: The robot.
        radii: (n,) sphere radius + covering radius + clearance, from points [m].
        tolerance: No piece of a motion is inflated by more [m].
        work: Scratch; two tests may share it, but not two threads.
        bare: (n,) sphere radius + clearance, kept from solids [m]; None: `radii`.
    """

    def __init__(
        self,
        arm: Arm,
        radii: np.ndarray,
        tolerance: float,
        work: Work,
        bare: np.ndarray | None = None,
    ) -> None:
        bare = radii if bare is None else bare
        self.group = Clearance(arm, radii, bare, tolerance, work)

    def anchor(self, q: np.ndarray) -> None:
        """Remember where the spheres are at q (dof,): an escape begins there."""
        close.place_anchor(self.group.arm, q, self.group.work)

    def clear(
        self,
        q: np.ndarray,
        dq: np.ndarray,
        cloud: Cloud,
        escape: bool = False,
        solids: Solids = NO_SOLIDS,
    ) -> bool:
        """Return whether q + t dq, t in [0, 1], keeps its distance.

        From sorted points and from solids. With `escape` what is nearer already only
        must not come nearer; see `_close.place_anchor`.
        """
        return close.motion_clear(self.group, q, dq, cloud, solids, escape)

    def first_blocked(
        self, path: np.ndarray, cloud: Cloud, solids: Solids = NO_SOLIDS
    ) -> int | None:
        """Return the first leg of a path (k, dof) that is not clear, or None."""
        leg = np.empty(path.shape[1])
        k = close.first_blocked(self.group, path, cloud, solids, leg)
        return None if k < 0 else k

    def separation(
        self,
        q: np.ndarray,
        cloud: Cloud,
        limit: float = np.inf,
        solids: Solids = NO_SOLIDS,
    ) -> float:
        """Return the least distance of the spheres from all, at most `limit` [m]."""
        arm, work = self.group.arm, self.group.work
        return close.separation(arm, q, cloud, solids, limit, work)

    @property
    def blocked_by(self) -> tuple[int, int]:
        """The sphere and the point of the last answer; -1 where there was none.

        Solid k is told as FIRST_SOLID - k instead of a point.
        """
        sphere, point = self.group.work.found[:2].tolist()
        return sphere, point

    @property
    def blocked_at(self) -> float:
        """Share of the motion at which the last one was blocked."""
        return float(self.group.work.value[0])

    @property
    def missing(self) -> float:
        """How much too near the last motion came [m]."""
        sphere, point = self.blocked_by
        kept = self.group.bare if point <= close.FIRST_SOLID else self.group.radii
        return float(kept[sphere] - self.group.work.value[1])
