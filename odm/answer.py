"""What the planner says to a frame."""

from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

FOLLOWING, REPLANNED, HOLDING = "following", "replanned", "holding"
WHOLE, VISIBLE = "whole surface", "visible surface"
# how what is held is kept clear of obstacles
LAYER, CLOSE_TEST = "payload layer", "close test"
# what found a path
IN_USE, STRAIGHT, ROADMAP, SEARCH = "path in use", "straight", "roadmap", "search"


@dataclass(frozen=True)
class Blockers:
    """What stands behind the reason of a hold.

    Attributes:
        edges: Roadmap edges at the start or the goal that are blocked.
        cells: (k, 3) occupied cells in their way.
        points: Indices of the frame's points in their way.
        link: Link of the robot that is nearest to them, or None.
        goal: Index of the goal that was looked at first, or None.
    """

    edges: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    cells: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    points: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    link: str | None = None
    goal: int | None = None


NOTHING = Blockers()


class Explains(Protocol):
    """What knows why the robot holds and how it could get away."""

    @property
    def explained(self) -> tuple[str, Blockers]:
        """The reason and what stands behind it."""

    @property
    def retreat(self) -> np.ndarray | None:
        """A (k, dof) motion out of the way, or None."""


class Explanation(NamedTuple):
    """Why the robot held and how it could get away; no planner is asked."""

    explained: tuple[str, Blockers] = "", NOTHING
    retreat: np.ndarray | None = None


NOT_HOLDING = Explanation()


@dataclass(slots=True, eq=False, repr=False)
class Answer:
    """The answer to one frame; read-only by convention, cheap to make.

    Attributes:
        status: "following", "replanned" or "holding".
        path: (k, dof) from the robot's configuration to the goal; empty on holding.
        goal: Index of the goal the path leads to, None when holding.
        certified: "whole surface" where the caller said that the points cover closed
            shapes; else "visible surface": what was not sampled is unknown.
        frame: Number of the frame, from 1 on; `step` counts every one that it takes.
        stage: What found the path: "path in use" (it is still free), "straight",
            "roadmap", or "search" beyond the roadmap; None when holding.
        held: By what the object in the hand is kept clear: "payload layer", or "close
            test" alone where the map has none (slower); None with nothing there.
        by_links: Legs of the path, the first or the last, that the cover refuses and
            the links' own hulls prove free; `is_free(..., by_links=True)` says so, too,
            `blocked_leg` and `stands_clear` do not.
        latency_s: Seconds by stage: "occupancy", "plan", "total".
        work: Counted work: points, outside, occupied blocks, edge tests...
    """

    status: str
    path: np.ndarray
    goal: int | None
    certified: str
    _times: tuple[int, int]  # begin and end [ns]
    # `Stats` of `odm/search/_state.py` as bytes: what was counted is seldom looked at
    _counted: bytes
    _why: Explains = NOT_HOLDING  # asked when the reason or the retreat is
    stage: str | None = None
    held: str | None = None
    by_links: tuple[int, ...] = ()

    @property
    def frame(self) -> int:
        """Number of the frame."""
        return self._counts()[6]

    @property
    def latency_s(self) -> dict[str, float]:
        """Seconds by stage: "occupancy", "plan", "total"."""
        begun, ended = self._times
        marked = self._counts()[7]
        return {
            "occupancy": 1e-9 * (marked - begun),
            "plan": 1e-9 * (ended - marked),
            "total": 1e-9 * (ended - begun),
        }

    @property
    def work(self) -> "Work":
        """Counted work of the frame."""
        popped, tests, flooded, close, runs = self._counts()[:5]
        blocks, inside, outside, bad = self._counts()[8:]
        n_points = inside + outside + bad
        return Work(n_points, outside, blocks, tests, popped, flooded, close, runs)

    def _counts(self) -> list[int]:
        """Return the numbers of `Stats` in order: step is 6, marked 7."""
        return np.frombuffer(self._counted, np.int64).tolist()

    @property
    def reason(self) -> str | None:
        """One sentence when holding: what blocks what, and what would help."""
        return (self._why.explained[0] or None) if self.status == HOLDING else None

    @property
    def blockers(self) -> Blockers:
        """Edges, cells, points and link behind the reason."""
        return self._why.explained[1] if self.status == HOLDING else NOTHING

    @property
    def retreat(self) -> np.ndarray | None:
        """(k, dof) motion offered while holding: back off or escape; or None.

        It leads away from the points, to be executed at reduced speed. Offered beside a
        path with legs `by_links`, too.
        """
        return self._why.retreat

    def __getstate__(self) -> tuple[None, dict]:
        """Return what copies and pickles hold: all that was told, not the planner.

        The reason and the retreat are asked for now, in the planner's own thread.
        """
        state = {name: getattr(self, name) for name in self.__slots__}
        return None, {
            **state,
            "_why": Explanation(self._why.explained, self._why.retreat),
        }

    def __repr__(self) -> str:
        """Say the status and its core."""
        if self.status == HOLDING:
            return f"Answer(holding: {self.reason})"
        return f"Answer({self.status}, {len(self.path)} points, goal {self.goal})"


@dataclass(frozen=True, slots=True)
class Work:
    """Counted work of a frame.

    Attributes:
        points, outside: Points seen, and those outside the grid.
        blocks: Occupied blocks.
        edge_tests: Cell lists of nodes and edges compared with the occupancy.
        popped: Vertices the search closed.
        flooded: Nodes reached from the goal's side.
        close_tests: Close tests run.
        searches: Runs of A*.
    """

    points: int = 0
    outside: int = 0
    blocks: int = 0
    edge_tests: int = 0
    popped: int = 0
    flooded: int = 0
    close_tests: int = 0
    searches: int = 0


@dataclass(frozen=True)
class Freedom:
    """Whether a motion is free; true or false, and which test failed.

    Attributes:
        free: True when all tests passed over the whole motion.
        failed: "limits", "self-collision", "scenery" or "frame"; None when free.
        reason: One sentence; empty when free.
    """

    free: bool
    failed: str | None = None
    reason: str = ""

    def __bool__(self) -> bool:
        """Return `free`."""
        return self.free
