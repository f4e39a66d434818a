"""All four tests of a motion, by the map's cover and by a finer one."""

from dataclasses import dataclass

import numpy as np

from odm.approach.fine_cover import FineTest
from odm.checks import outside_limits
from odm.close_test.sorted_clouds import SortedCloud
from odm.close_test.static import StaticTest
from odm.frame.frame import Frame
from odm.frame.last_phase import LastPhase
from odm.obstacles.grid import LARGEST_GRID, WorkspaceGrid


@dataclass(frozen=True)
class Tested:
    """What a motion's test found; see Obstruction."""

    failed: str = ""
    text: str = ""
    link: str | None = None
    point: int = -1
    missing_m: float = 0.0
    fine: bool = False


class LegTest:
    """Tests motions against limits, the robot itself, scenery and the frame's points.

    With `use_fine` the finer cover decides where the map's says no.

    Attributes:
        motions: Number of motions tested so far.
        cloud: The points of the frame that `look` took.
    """

    def __init__(self, frame: Frame, use_fine: bool) -> None:
        self.frame, self.use_fine, self.motions = frame, use_fine, 0
        grid = frame.cell_map.grid
        # smaller blocks than the map's: dense points of a bin are told apart sooner
        halved = grid
        if 8 * grid.n_blocks <= LARGEST_GRID:
            halved = WorkspaceGrid(grid.origin, grid.h / 2, 2 * grid.blocks)
        self._sorted = SortedCloud(halved)
        self.cloud = self._sorted.of(frame.points[: frame.n_given])
        self._fine: FineTest | None = None
        self._last_phase = LastPhase(frame, halved)
        self.phase: str | None = None

    @property
    def fine(self) -> FineTest:
        """The finer cover; made at the first use, which takes seconds."""
        if self._fine is None:
            self._fine = FineTest(self.frame)
        return self._fine

    def forget_fine(self) -> None:
        """Make the finer cover anew when it is next needed: the hand has changed."""
        self._fine = None

    def look(self, phase: str | None = None) -> None:
        """Take the frame's points, scenery and sampling as they are now.

        With a phase, what may touch what is as `odm.frame.last_phase` says.
        """
        frame, self.phase = self.frame, phase
        points = frame.points[: frame.n_given]
        self.cloud = self._sorted.of(points)
        if phase is not None:
            self._last_phase.look(
                phase, points, frame.classes, frame.solids, frame.solid_classes
            )
        if self.use_fine:
            self.fine.follow()

    def gap(self, q: np.ndarray, most: float) -> float:
        """Return how far the map's cover is from all obstacles, at most `most` [m]."""
        frame = self.frame
        return frame.close_test.separation(q, self.cloud, most, frame.solids)

    def test(self, q: np.ndarray, dq: np.ndarray, fine_first: bool = False) -> Tested:
        """Test a motion: by the map's cover, and where that says no by the fine one.

        With `fine_first`, where the leg before needed it, in the other order.
        """
        self.motions += 1
        for end in (q, q + dq):
            trouble = outside_limits(self.frame.robot, end, 0.0)
            if trouble is not None:
                return Tested("limits", trouble)
        if not self.use_fine:
            return self.by_map(q, dq)
        tests = (self.by_map, self.by_fine)
        for test in tests[::-1] if fine_first else tests:
            tested = test(q, dq)
            if not tested.failed:
                return tested
        return self.by_fine(q, dq) if fine_first else tested

    def by_map(self, q: np.ndarray, dq: np.ndarray) -> Tested:
        """Test q + t dq, within limits, by the cover of the map."""
        return self._by(self.frame, q, dq)

    def by_fine(self, q: np.ndarray, dq: np.ndarray) -> Tested:
        """Test q + t dq, within limits, by the finer cover."""
        tested = self._by(self.fine, q, dq)
        return tested if tested.failed else Tested(fine=True)

    def _by(self, covered: Frame | FineTest, q: np.ndarray, dq: np.ndarray) -> Tested:
        """Test q + t dq, within limits, by the cover of a frame or a finer one."""
        static = covered.static
        if not static.motion_free(q, dq):
            return _scenery(static, q, dq)
        if self.phase is not None:
            hit = self._last_phase.hit(covered.cover(), q, dq)
            if hit is None:
                return Tested()
            sphere, point, missing = hit
        else:
            test = covered.close_test
            if test.clear(q, dq, self.cloud, solids=self.frame.solids):
                return Tested()
            (sphere, point), missing = test.blocked_by, test.missing
        link, what = static.link_of(sphere), self.frame.name_of(point)
        text = f"{link} would come {1e3 * missing:.1f} mm too near to {what}"
        return Tested("frame", text, link, max(point, -1), missing)


def _scenery(static: StaticTest, q: np.ndarray, dq: np.ndarray) -> Tested:
    text = static.why(q, dq) or "the motion is not free"
    itself = static.touches_itself(q, dq) is not None
    link = text.split(" would touch ")[0]
    return Tested("self-collision" if itself else "scenery", text, link)
