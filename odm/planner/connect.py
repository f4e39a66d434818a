"""Beyond the roadmap: a search by certified motions where it has no path.

A frame whose start and goal are free, but for which the roadmap has no path, grows two
trees of tested motions (`odm/search/_connect.py`), within a counted budget; what is
left is done in the next such frames, and between them. A path that was found is
remembered with the cells of its legs, and tried again, leg by leg, in every frame for
which the roadmap has none.
"""

from typing import NamedTuple

import numpy as np

from odm.checks import outside_limits
from odm.frame.frame import Frame
from odm.planner.attaching import Attacher
from odm.planner.path import PathInUse
from odm.planner.saved_memory import Remembering
from odm.planner.settings import ConnectSettings
from odm.search import _connect as kernels
from odm.search._state import NO_ITEM


class FoundPath(NamedTuple):
    """A path that is free now.

    Attributes:
        goal: Rank of the goal that it leads to.
        vertex: (n,) numbers of its corners.
        q: (n, dof) the corners [rad or m].
        item: Cells of its legs, as numbers of the pool.
    """

    goal: int
    vertex: np.ndarray
    q: np.ndarray
    item: list[int]


class Connector(Remembering):
    """Looks for paths beyond the roadmap, and remembers those that it found.

    A frame looks at `budget` configurations; 0: it never searches.

    Attributes:
        looked: Configurations looked at for this start and these goals.
        lacks_cells: Whether the path found last has legs without cells; see
            `sweep_cells`.
        frames_to_persist: Frames more that a path found here must be free to be taken;
            0: none.
        is_new: The last frame without a path was the first from there to these goals.
    """

    REMEMBERED = (
        "_root", "_goals", "_place", "_asked", "looked", "frames_to_persist",
        "lacks_cells",
    )  # fmt: skip

    def __init__(
        self, frame: Frame, path: PathInUse, attacher: Attacher, budget: int
    ) -> None:
        self.frame, self.path, self.attacher = frame, path, attacher
        self.budget, self.settings = budget, ConnectSettings()
        self.trees, self.found = frame.memory.trees, frame.memory.found
        self.reset()

    def reset(self) -> None:
        """Forget trees and paths: other things stand still, or another hand."""
        self.trees.count[:] = self.trees.drawn[:] = 0
        self.found.count[:] = self.found.next[:] = 0
        self._root, self._goals, self.lacks_cells = b"", b"", False
        self._place, self.is_new = b"", False
        self._vertices = set(self.found.vertex.ravel().tolist())  # of found paths
        self._asked = -1  # frame whose search goes on between frames
        self.looked = 0
        self.frames_to_persist = 0

    def remembered(self, q: np.ndarray, patience: int, waits: bool) -> FoundPath | None:
        """Begin a frame without a path on the roadmap: return one found before.

        q (dof,) is where the robot is, inside its limits. With `waits` a path that is
        free only now has to be found in `patience` more frames before it is taken.
        """
        place = q.tobytes() + self.attacher.goals.tobytes()
        self.is_new, self._place = place != self._place, place
        if not self._is_asked():
            return None
        self._asked = self.frame.number
        if self.path.followed and (waits or self._is_mine()):
            self.frames_to_persist = patience
        joins = self.is_new or self.frame.number % self.settings.join_every == 0
        return self._free_path(q, joins)

    def search(self, q: np.ndarray, moves: bool) -> FoundPath | None:
        """Grow the trees for a frame without a path from q (dof,), inside its limits.

        `moves`: the robot was a little elsewhere in the frame before.
        """
        left, s = self._left(), self.settings
        if not self._is_asked() or (
            left <= 0 and self.frame.number % s.search_every > 0
        ):
            return None
        part = 0 if moves else min(self.budget // s.frames_at_first, left)
        part = max(1, self.budget // s.later_divisor, part)
        found = self._search(part, min(part, self.budget // 4, s.shorten))
        return self._free_path(q, False) if found else None

    def take(self, path: FoundPath | None, patience: int) -> bool:
        """Use a path that is free now, once such a path was there for long enough.

        Where the path before was of this kind, or free only now, and was blocked, the
        next one must be there for `persistence_frames` frames in a row: what opens and
        closes as a hand trembles is not taken.
        """
        if path is None:
            self.frames_to_persist = patience if self.frames_to_persist else 0
            return False
        self.frames_to_persist = max(0, self.frames_to_persist - 1)
        if self.frames_to_persist:
            return False
        self.path.lead(*path)
        return True

    def _is_asked(self) -> bool:
        return self.budget > 0 and len(self.attacher.goals) > 0

    def _left(self) -> int:
        """Return the configurations that a search from here may look at yet."""
        return self.budget - (self.looked if self._is_known() else 0)

    def _is_known(self) -> bool:
        """Return whether a search from here to these goals was begun before."""
        q, goals = self.frame.q.tobytes(), self.attacher.goals.tobytes()
        return (q, goals) == (self._root, self._goals)

    def _is_mine(self) -> bool:
        """Return whether the path in use is one that was found here."""
        corners = self.path.vertex[: max(0, len(self.path) - 1)]
        return not self._vertices.isdisjoint(corners.tolist())

    def improve(self, budget: int) -> int:
        """Go on with the search of a frame that held; return whether it has a path.

        The next frame takes it, if it is free then. `budget` counts motions.
        """
        if self._asked != self.frame.number:
            return 0
        s, most = self.settings, self.budget // 4
        return int(self._search(s.per_test * budget, min(most, s.shorten)))

    def progress(self) -> str:
        """Return how far a search has come, for an explanation."""
        if not self.looked:
            return ""
        return (
            f"a search beyond the roadmap looked at {self.looked} configurations and "
            "has found none yet"
        )

    # --- searching --------------------------------------------------------------

    def _search(self, budget: int, shortening: int) -> bool:
        """Grow the trees; True where a path was found, and is remembered.

        Both count configurations; with the second a path that was found is shortened.
        """
        frame, attacher = self.frame, self.attacher
        q, goals = frame.q.tobytes(), attacher.goals.tobytes()
        if goals != self._goals:
            self._goals, self.looked = goals, 0
            self.trees.count[1] = 0
        if q != self._root:
            self._root, self.looked = b"", 0
            self.trees.count[0] = 0
        # before all that it takes to search: most frames that hold end here
        if not attacher.ends_free:
            self._asked = -1
            return False
        static = frame.static
        problem = kernels.Problem(frame.memory.table, static.still(), static.scratch())
        is_new = q != self._root
        said = kernels.search_beyond(problem, is_new, budget, shortening)
        code = said % kernels.WORK
        if code != kernels.REFUSED:
            self._root = q
        if code in (kernels.REFUSED, kernels.IN_CONTACT):
            self._asked = -1
            return False
        self.looked += said // kernels.WORK
        if code != kernels.MET:
            return False
        self._asked = -1
        return self._remember()

    def _remember(self) -> bool:
        """Remember the path that the trees made, with the cells of its legs."""
        trees, found, attacher = self.trees, self.found, self.attacher
        n = trees.corners.item()
        if n > found.vertex.shape[1]:
            return False
        k = found.next.item()
        found.count[k] = 0
        attacher.tidy()
        q = found.q[k, :n]
        q[0] = trees.route[0]
        for i in range(1, n):  # continuous joints go on the short way
            turns = np.round((trees.route[i] - q[i - 1]) / (2.0 * np.pi))
            q[i] = trees.route[i] - 2.0 * np.pi * turns * self.frame.robot.continuous
        found.ref[k, : n - 1] = NO_ITEM
        self.lacks_cells = attacher.can_wait_for_cells
        if not self.lacks_cells:
            first = attacher.sweep(q[:-1], np.diff(q, axis=0))
            found.ref[k, : n - 1] = NO_ITEM if first < 0 else first + np.arange(n - 1)
        found.vertex[k, : n - 1] = [attacher.new_vertex() for _ in range(n - 1)]
        goal = self.frame.memory.goals.vertex[trees.goal.item()]
        found.vertex[k, n - 1] = goal
        found.count[k] = n
        found.next[0] = (k + 1) % len(found.count)
        self._vertices = set(found.vertex.ravel().tolist())
        return True

    def sweep_cells(self, most: int) -> int:
        """Sweep the cells of up to `most` legs of the path found last; return how many.

        By them later frames, and the obstacles' history, judge a leg as an edge.
        """
        found = self.found
        k = (found.next.item() - 1) % len(found.count)
        legs = slice(0, max(0, found.count.item(k) - 1))
        bare = np.flatnonzero(found.ref[k, legs] == NO_ITEM)
        now = bare[:most]
        self.lacks_cells = len(bare) > len(now)
        if not len(now):
            return 0
        self.attacher.tidy()
        begin, end = found.q[k, now], found.q[k, now + 1]
        first = self.attacher.sweep(begin, end - begin)
        if first < 0:
            self.lacks_cells = False
            return len(now)
        for i, item in zip(now.tolist(), range(first, first + len(now)), strict=True):
            found.ref[k, i] = item
            self.path.take_cells(*found.vertex[k, i : i + 2].tolist(), item)
        return len(now)

    # --- paths that were found --------------------------------------------------

    def _free_path(self, q: np.ndarray, joins: bool) -> FoundPath | None:
        """Return a remembered path that is free from q on, the latest first.

        joins: q may be joined to a later corner, which takes milliseconds.
        """
        found, goals = self.found, self.frame.memory.goals
        ranks = goals.vertex[: goals.count.item(0)].tolist()
        for back in range(1, len(found.count) + 1):
            k = (found.next.item() - back) % len(found.count)
            n = found.count.item(k)
            if n and found.vertex.item(k, n - 1) in ranks:
                rank = ranks.index(found.vertex.item(k, n - 1))
                path = self._from(k, rank, q, joins)
                if path is not None:
                    return path
        return None

    def _from(self, k: int, rank: int, q: np.ndarray, joins: bool) -> FoundPath | None:
        """Return found path k, or the rest of it with a leg from q; None: not free."""
        frame, found, n = self.frame, self.found, self.found.count.item(k)
        first = kernels.free_from(frame.memory.table, k)
        if first < 0:
            return None
        vertex, corners = found.vertex[k, :n], found.q[k, :n]
        if first == 0 and (corners[0] == q).all():
            return FoundPath(rank, vertex, corners, found.ref[k, : n - 1].tolist())
        if not joins or n + 1 > len(self.path.vertex):
            return None
        legs = np.array([frame.difference(q, corner) for corner in corners[first:]])
        far = np.linalg.norm(legs * frame.cell_map.roadmap.weights, axis=1)
        for i in np.argsort(far, kind="stable")[: self.settings.joins].tolist():
            leg, c = legs[i], first + i
            if c == 0 and outside_limits(frame.robot, corners[0], 0.0) is not None:
                continue  # a robot began there that was a little outside
            if frame.motion_clear(q, leg) and frame.static.motion_free(q, leg):
                self.attacher.tidy()
                item = self.attacher.sweep(q[None], leg[None])
                return FoundPath(
                    rank,
                    np.r_[self.attacher.new_vertex(), vertex[c:]],
                    np.vstack([q, corners[c:]]),
                    [max(item, NO_ITEM), *found.ref[k, c : n - 1].tolist()],
                )
        return None

    # --- memory -----------------------------------------------------------------

    def load(self, saved: dict[str, np.ndarray]) -> None:
        """Take up trees and paths whose arrays were loaded."""
        super().load(saved)
        self.is_new, self._vertices = False, set(self.found.vertex.ravel().tolist())
