"""Proved paths of one arm: straight lines of the palm, lifts, searches, postures."""

import time
from collections.abc import Iterator

import numpy as np

from handover.grasps.grasp_set import GraspSet
from handover.plans import _trees as kernels
from handover.plans._space import follow, postures
from handover.plans.grasps import BACK, line_clear
from handover.plans.mover import Mover, solver_of
from handover.plans.settings import SOLVE, PlanSettings
from roadmap.errors import PlanningError
from roadmap.kinematics.tool_chain import descent_of

_BRANCHES, _CORNERS = 4000, 400
# of straight lines: [m] and [rad] that count as 1 in a descent, error of that (0.1 um),
# steps of a descent, and [rad] that a joint turns in a piece at most
_GOAL = np.array([0.1, 0.1, 1e-6, 30.0, 0.35])
SAME = 1e-9  # [rad or m]
_TILTS = np.radians([0.0, 30.0, 60.0, 90.0])  # from the palm's normal
_SIDES = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))  # x and y of the palm
_SLANTED = tuple(
    dict.fromkeys(
        (float(np.sin(t)) * x, float(np.sin(t)) * y, -float(np.cos(t)))
        for t in _TILTS
        for x, y in _SIDES
    )
)


class Blocked(PlanningError):
    """A motion was not found; says which and what is in the way.

    Attributes:
        by_hand: No other posture of the arm changes it.
        searched: A search ended by its budget; a larger one may find it.
        more: Other postures of the arms were not tried yet.
    """

    def __init__(
        self, text: str, *, by_hand: bool = False, searched: bool = False
    ) -> None:
        super().__init__(text)
        self.by_hand, self.searched, self.more = by_hand, searched, False


class OutOfTime(PlanningError):
    """The time limit is over; says in which step."""


class Clock:
    """Ends a plan when its time is over; it decides nothing else."""

    def __init__(self, limit_s: float) -> None:
        self.begun, self.limit_s = time.perf_counter(), limit_s

    @property
    def over(self) -> bool:
        """Whether the time is over."""
        return self.spent >= self.limit_s

    @property
    def spent(self) -> float:
        """Time since it was made [s]."""
        return time.perf_counter() - self.begun


class Paths:
    """Looks for proved paths of an arm as it, the object and the other arm are put.

    Args:
        mover: The arm.
        home: (dof,) where it waits.
        settings: See PlanSettings.
        clock: Its `over` is asked before each search.
    """

    def __init__(
        self, mover: Mover, home: np.ndarray, settings: PlanSettings, clock: Clock
    ) -> None:
        self.mover, self.home, self.settings = mover, home, settings
        self.clock = clock
        self._trees = _trees(mover.limb.dof)
        self._arm = None if mover.limb.seven is None else solver_of(mover.limb)
        self._chain = mover.limb.chain.arrays
        self._descent, self._trial = descent_of(self._chain), np.zeros(mover.limb.n_arm)
        self._limits = np.stack([mover.limb.lower, mover.limb.upper], axis=1)

    def prove(self, path: np.ndarray, what: str) -> None:
        """Prove every leg of a path (n, dof), or raise Blocked."""
        pair, trouble, _ = self.mover.path_blocked(path)
        if trouble:
            raise Blocked(f"{what}: {trouble}", by_hand=self._by_hand(pair))

    def line_to(
        self,
        q_open: np.ndarray,
        what: str,
        held: tuple[GraspSet, int],
        slanted: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return where a straight line of the palm to q begins, and its corners.

        On the line hand and object are tested against each other by exact distances of
        the object's own mesh, where it begins and elsewhere by those of its hull.

        Args:
            q_open: (dof,) where it ends, the hand open.
            what: Its name for messages.
            held: The grasp there.
            slanted: Try lines that are not along the palm's normal, too: a hand may
                leave to the side where the arm cannot follow it back.

        Raises:
            Blocked: There is none.
        """
        T, trouble = self.mover.T_world_object, None
        for away in _SLANTED if slanted else (BACK,):
            try:
                return self._line_to(q_open, what, held, away)
            except Blocked as blocked:
                trouble = trouble or blocked
                trouble.by_hand &= blocked.by_hand
                self.mover.put_object(T)
        raise trouble

    def _line_to(
        self,
        q_open: np.ndarray,
        what: str,
        held: tuple[GraspSet, int],
        away: tuple[float, float, float],
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the line of `line_to` that goes `away`, a unit vector of the palm."""
        mover, T = self.mover, self.mover.T_world_object
        spec, back = mover.limb.spec, self.settings.back
        if not line_clear(spec, *held, back, away, mover.proof):
            raise Blocked(
                f"no straight line for {what}: the hand would cut the object",
                by_hand=True,
            )
        direction = mover.palm(q_open)[:3, :3] @ np.array(away)
        line = self._line(q_open, direction, self.settings.back)
        ends = self._ends(len(line), self.settings.back)
        if not ends:
            raise Blocked(f"no straight line for {what}: the arm cannot follow it")
        mover.let_touch()
        pair, trouble, leg = mover.path_blocked(line)
        by_hand = self._by_hand(pair)
        mover.put_object(T)
        for end in ends:
            if leg < end:
                continue
            pair, trouble = mover.why(line[end])
            if trouble is None:
                return line[end], line[end::-1]
            by_hand = self._by_hand(pair)
        by_hand = by_hand and leg < len(line) - 1
        raise Blocked(f"no straight line for {what}: {trouble}", by_hand=by_hand)

    def lift(self, q: np.ndarray) -> np.ndarray:
        """Return the corners of a lift straight up from q, or raise Blocked."""
        line = self._line(q, np.array([0.0, 0.0, 1.0]), self.settings.lift)
        pair, _, leg = self.mover.path_blocked(line)
        for end in self._ends(len(line), self.settings.lift):
            if leg >= end:
                return line[: end + 1]
        raise Blocked(
            "the object cannot be lifted from, or put on, what carries it",
            by_hand=self._by_hand(pair),
        )

    def _ends(self, corners: int, length: float) -> list[int]:
        """Return corners where a line may end, the farthest first."""
        whole = self._steps(length)
        ends = dict.fromkeys(int(np.ceil(share * whole)) for share in SOLVE.shorter)
        return [end for end in ends if end < corners]

    def _steps(self, length: float) -> int:
        return max(1, int(np.ceil(length / self.settings.line)))

    def reach(self, pre: np.ndarray, what: str, budget: int) -> tuple[np.ndarray, int]:
        """Return a path from where the arm waits to one of `pre` (k, dof), and which.

        First the hand, then the arm; all of `pre` with the same fingers. Raises
        Blocked.
        """
        home, n = self.home, self.mover.limb.n_arm
        ready = np.concatenate([home[:n], pre[0, n:]])
        path, _, k = self.between(ready[None], pre, what, budget)
        if np.abs(ready - home).max() > SAME:
            self.prove(np.array([home, ready]), what)
            path = np.vstack([home, path])
        return path, k

    def between(
        self, starts: np.ndarray, goals: np.ndarray, what: str, budget: int
    ) -> tuple[np.ndarray, int, int]:
        """Return a proved path from a start to a goal, and which ones it joins.

        Args:
            starts: (m, dof) where it may begin.
            goals: (k, dof) where it may end.
            what: The motion's name for messages.
            budget: Motions that the search tests.

        Raises:
            Blocked: All starts or all goals are not free, or the budget is spent.
            OutOfTime: The clock is over.
        """
        if self.clock.over:
            raise OutOfTime(what)
        mover, trees, n_arm = self.mover, self._trees, self.mover.limb.n_arm
        first, last = self._free(starts, what), self._free(goals, what)
        found = kernels.connect(
            mover.space, trees, starts[first], goals[last], self._limits, n_arm, budget,
            mover.proof.tolerance, mover.scratch,
        )  # fmt: skip
        if not found:
            raise Blocked(f"{what}: no path within {budget} motions", searched=True)
        kernels.shorten(
            mover.space,
            trees,
            self.settings.shorten,
            mover.proof.tolerance,
            mover.scratch,
        )
        path = trees.route[: trees.corners[0]].copy()
        path = path[np.r_[True, np.abs(np.diff(path, axis=0)).max(axis=1) > SAME]]
        if len(path) == 1:
            path = np.vstack([path, path])
        self.prove(path, what)
        return path, first[trees.ends[0]], last[trees.ends[1]]

    def _free(self, ends: np.ndarray, what: str) -> list[int]:
        """Return which of the ends (m, dof) of a motion are free."""
        free, first = [], (-1, None)
        for k, q in enumerate(ends):
            pair, trouble = self.mover.why(q)
            if trouble is None:
                free.append(k)
            elif not k:
                first = pair, trouble
        if not free:
            raise Blocked(
                f"{what}: an end of it is blocked, {first[1]}",
                by_hand=self._by_hand(first[0]),
            )
        return free

    def postures(self, q: np.ndarray, wide: np.ndarray) -> Iterator[np.ndarray]:
        """Yield q, then other free joints with the same pose of the palm.

        Args:
            q: (dof,) with the hand closed.
            wide: (k,) fingers of the open hand, which must be free, too. The others
                come in the order of how far they are from where the arm waits.
        """
        yield q
        n = self.mover.limb.n_arm
        found = self._postures(q, wide)
        far = np.abs(found[:, :n] - self.home[:n]).max(axis=1)
        found = found[np.argsort(far, kind="stable")]
        for other in found[: self.settings.postures]:
            if np.abs(other - q).max() > 1e-6:
                yield other

    def _postures(self, q: np.ndarray, wide: np.ndarray) -> np.ndarray:
        """Return free joints (n, dof) that keep the palm as at q; maybe none."""
        mover, n = self.mover, self.mover.limb.n_arm
        if self._arm is None:
            return np.zeros((0, mover.limb.dof))
        q = np.ascontiguousarray(q, float)
        found = np.zeros((len(self._arm.found), mover.limb.dof))
        count = postures(
            mover.space, self._arm, mover.target(mover.palm(q)), q[n:],
            np.ascontiguousarray(wide, float), found, mover.scratch,
        )  # fmt: skip
        return found[:count]

    def _by_hand(self, pair: int) -> bool:
        """Return whether a pair depends on the poses of both hands alone."""
        space, other = self.mover.space, len(self.mover.other.groups)
        if not 0 <= pair < space.first:
            return False
        group = space.pairs[pair, 1]
        return not space.thing < group < space.thing + other

    def _line(
        self, q: np.ndarray, direction: np.ndarray, distance: float
    ) -> np.ndarray:
        """Follow a straight line of the palm from q, as far as the arm can."""
        mover, steps = self.mover, self._steps(distance)
        corners = np.tile(np.asarray(q, float), (steps + 1, 1))
        step = mover.T_mount[:3, :3].T @ direction * (distance / steps)
        last = follow(
            self._chain, mover.target(mover.palm(q)), step, steps, _GOAL,
            self._descent, self._trial, corners,
        )  # fmt: skip
        return corners[: last + 1]


def _trees(dof: int) -> kernels.Trees:
    return kernels.Trees(
        q=np.zeros((2, _BRANCHES, dof)),
        parent=np.zeros((2, _BRANCHES), np.int64),
        count=np.zeros(2, np.int64),
        route=np.zeros((_CORNERS, dof)),
        corners=np.zeros(1, np.int64),
        ends=np.zeros(2, np.int64),
        tests=np.zeros(1, np.int64),
        sample=np.zeros((3, dof)),
    )
