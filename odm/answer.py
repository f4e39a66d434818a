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
    def reason(self) -> str:
        """One sentence; empty when the robot does not hold."""

    @property
    def blockers(self) -> Blockers:
        """What stands behind the reason; as the reason, asked for in its frame."""

    @property
    def retreat(self) -> np.ndarray | None:
        """A (k, dof) motion out of the way, or None."""


class Explanation(NamedTuple):
    """Why the robot held and how it could get away; no planner is asked."""

    reason: str = ""
    blockers: Blockers = NOTHING
    retreat: np.ndarray | None = None


NOT_HOLDING = Explanation()


class Verdict(NamedTuple):
    """What an answer says in words; frames that say the same share one.

    Attributes are those of `Answer`, and `why` is asked when the reason or the retreat
    is.
    """

    status: str
    goal: int | None
    certified: str
    stage: str | None
    held: str | None
    why: Explains = NOT_HOLDING
    by_links: tuple[int, ...] = ()


@dataclass(slots=True, eq=False, repr=False)
class Answer:
    """The answer to one frame; read-only by convention, cheap to make.

    Attributes:
        path: (k, dof) from the robot's configuration to the goal; empty on holding.
    """

    path: np.ndarray
    _verdict: Verdict
    _begun: int  # [ns]
    _ended: int
    # `Stats` of `odm/search/_state.py` as bytes: what was counted is seldom looked at
    _counted: bytes

    @property
    def status(self) -> str:
        """What comes of the frame: "following", "replanned" or "holding"."""
        return self._verdict.status

    @property
    def goal(self) -> int | None:
        """Index of the goal the path leads to, None when holding."""
        return self._verdict.goal

    @property
    def certified(self) -> str:
        """What the answer holds for.

        "whole surface" where the caller said that the points cover closed shapes; else
        "visible surface": what was not sampled is unknown.
        """
        return self._verdict.certified

    @property
    def stage(self) -> str | None:
        """What found the path; None when holding.

        "path in use" (it is still free), "straight", "roadmap", or "search" beyond the
        roadmap.
        """
        return self._verdict.stage

    @property
    def held(self) -> str | None:
        """By what the object in the hand is kept clear; None with nothing there.

        "payload layer", or "close test" alone where the map has none (slower).
        """
        return self._verdict.held

    @property
    def by_links(self) -> tuple[int, ...]:
        """Legs that the cover refuses and the links' own hulls prove free.

        The first or the last of the path; `is_free(..., by_links=True)` says so, too,
        `blocked_leg` and `stands_clear` do not.
        """
        return self._verdict.by_links

    @property
    def frame(self) -> int:
        """Number of the frame, from 1 on; `step` counts every one that it takes."""
        return self._counts()[6]

    @property
    def latency_s(self) -> dict[str, float]:
        """Seconds by stage: "occupancy", "plan", "total"."""
        begun, ended, marked = self._begun, self._ended, self._counts()[7]
        return {
            "occupancy": 1e-9 * (marked - begun),
            "plan": 1e-9 * (ended - marked),
            "total": 1e-9 * (ended - begun),
        }

    @property
    def work(self) -> "Work":
        """Counted work of the frame: points, occupied blocks, edge tests..."""
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
        verdict = self._verdict
        return (verdict.why.reason or None) if self.status == HOLDING else None

    @property
    def blockers(self) -> Blockers:
        """Edges, cells, points and link behind the reason; asked for in its frame."""
        return self._verdict.why.blockers if self.status == HOLDING else NOTHING

    @property
    def retreat(self) -> np.ndarray | None:
        """(k, dof) motion offered while holding: back off or escape; or None.

        It leads away from the points, to be executed at reduced speed. Offered beside a
        path with legs `by_links`, too.
        """
        return self._verdict.why.retreat

    def __getstate__(self) -> tuple[None, dict]:
        """Return what copies and pickles hold: all that was told, not the planner.

        The reason and the retreat are asked for now, in the planner's own thread.
        """
        state = {name: getattr(self, name) for name in self.__slots__}
        why = self._verdict.why
        kept = Explanation(why.reason, why.blockers, why.retreat)
        return None, {**state, "_verdict": self._verdict._replace(why=kept)}

    def __repr__(self) -> str:
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
        return self.free
