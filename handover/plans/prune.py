"""Algorithm 1 of [Huaman2014]: which grasps an arm can execute, and how.

A grasp is tested when its turn comes, the most dexterous first. So the best one costs
few tests, and a caller that asks for all gets the same as from testing all at once.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from handover.grasps.grasp_set import GraspSet
from handover.plans import _prune as kernels
from handover.plans.mover import Mover, solver_of
from handover.plans.settings import SOLVE
from roadmap.kinematics._inverse import descend
from roadmap.kinematics.tool_chain import descent_of
from roadmap.transforms import flat_pose

_WHY = {
    kernels.OUT_OF_REACH: "out of reach",
    kernels.HAND_TOUCHES: "the hand would touch something",
    kernels.ARM_TOUCHES: "the arm would touch something",
}
_SCALE = np.array([0.1, 0.1])  # [m or rad] that counts as 1 in a descent


@dataclass(frozen=True, eq=False)
class ExecutableGrasps:
    """The grasps of a set that an arm can execute, the most dexterous first."""

    grasp: np.ndarray  # (m,) which
    q: np.ndarray  # (m, dof) joints of arm and closed hand [rad or m]
    dexterity: np.ndarray  # (m,) of the arm there
    refused: dict[str, int]  # why the others cannot -> how many

    def __len__(self) -> int:
        return len(self.grasp)


class Grasper:
    """An arm that grasps an object by the grasps of a set, wherever the object is."""

    def __init__(self, mover: Mover, grasps: GraspSet) -> None:
        self.mover, self.grasps = mover, grasps
        limb, space = mover.limb, mover.space
        rows = np.arange(len(space.pairs))
        hand = rows < space.first
        fingers = mover.hand_group, mover.object_group  # the hand, and these alone
        both = (fingers[0] <= space.pairs) & (space.pairs < fingers[1])
        both = ~hand & both.any(axis=1)
        # links behind the last joint of the arm go where the palm goes
        bodies = [limb.parts[begin].body for _, begin, _ in limb.groups]
        fixed = [k for k, body in enumerate(bodies) if body == limb.palm]
        still = space.pairs[:, 1] >= mover.object_group
        hand |= np.isin(space.pairs[:, 0], fixed) & still
        n = limb.n_arm
        self.arm = kernels.Arm(
            solver=() if limb.seven is None else solver_of(limb),
            chain=limb.chain.arrays,
            frames=np.zeros((len(limb.chain.kind) + 1, 12)),
            jac=np.zeros((6, n)),
            weighted=np.zeros((n, 7)),
            gram=np.zeros((6, 6)),
            palm=limb.palm,
            base_palm=flat_pose(np.linalg.inv(limb.T_body_palm)),
            hand=rows[hand],
            alone=rows[~hand & ~both],
            both=rows[both],
            q=np.zeros(limb.dof),
            pose=np.zeros((3, 12)),
        )
        other_hand = mover.object_group + len(mover.other.groups)
        self.hands = (space.pairs == (mover.hand_group, other_hand)).all(axis=1)
        closed = len(self.arm.solver.found) if limb.seven else 0
        self.most = closed or SOLVE.restarts + 1
        self.T_object_palm = np.ascontiguousarray(grasps.T_object_palm)

    def look(
        self,
        T_world_object: np.ndarray,
        use: np.ndarray,
        stand: Callable[[], None],
        hands: bool = False,
        rated: bool = True,
    ) -> "LazyGrasps":
        """Look at the grasps `use` (k,) of the object at a pose (4, 4) [m].

        `stand` puts all things where they are then, for the mover. `hands` tests all
        hands at once: where most touch, it saves what follows. `rated` works out all
        dexterity at once, as the order needs; else in turn.
        """
        return LazyGrasps(self, T_world_object, use, stand, (hands, rated))


class LazyGrasps:
    """Grasps `use` (k,) at a pose, tested as they are asked for; see `Grasper.look`."""

    def __init__(self, grasper: Grasper, T_world_object, use, stand, now) -> None:
        mover, grasps, n = grasper.mover, grasper.grasps, len(use)
        self.use, self._grasper, self._stand = np.asarray(use, np.int64), grasper, stand
        rows, arm = n * grasper.most, grasper.arm
        self._listed = kernels.Listed(
            first=np.zeros(n + 1, np.int64),
            q=np.empty((rows, mover.limb.n_arm)),
            value=np.empty(rows),
            target=np.empty((n, 12)),
            rank=np.empty(n),
            verdict=np.empty(n, np.int64),
            handed=np.zeros(n, bool),
            blamed=np.empty(n, np.int64),
            shut=grasps.values[self.use],
            wide=grasps.preshape[self.use],
            answer=np.empty((n, mover.limb.dof)),
        )
        self._told = np.zeros(n, bool)
        targets = mover.target(T_world_object @ grasper.T_object_palm[self.use])
        self._stamp = -1
        self._stand_again()
        if arm.solver:
            kernels.solve(mover.space, arm, targets, self._listed, *now, mover.scratch)
        else:
            self._numerically(targets, now)

    def _stand_again(self) -> None:
        """Put all things where they are, unless they are there."""
        mover = self._grasper.mover
        if mover.stamp != self._stamp:
            self._stand()
            self._stamp = mover.stamp

    def __len__(self) -> int:
        return len(self.use)

    @property
    def verdicts(self) -> np.ndarray:
        """What is known of each grasp, (n,) codes of `_prune.py`."""
        return self._listed.verdict.copy()

    def __iter__(self) -> Iterator[tuple[int, np.ndarray, float]]:
        """Yield (grasp, joints (dof,), dexterity) of those that are free, best first.

        One iteration at a time: it goes on where the last one ended.
        """
        mover, listed = self._grasper.mover, self._listed
        while True:
            self._stand_again()
            i = kernels.next_free(
                mover.space, self._grasper.arm, listed, self._told, mover.scratch
            )
            if i < 0:
                return
            yield int(self.use[i]), listed.answer[i].copy(), float(listed.rank[i])

    def possible(self) -> np.ndarray:
        """Return which of the grasps are not known to fail, (n,) bool."""
        return self._listed.verdict <= kernels.FREE

    def clashing(self) -> np.ndarray:
        """Return the grasps at which the hand is known to meet the other hand, (m,)."""
        blamed = self._listed.blamed
        return self.use[(blamed >= 0) & self._grasper.hands[blamed]]

    def joints(self, grasp: int) -> np.ndarray | None:
        """Return the most dexterous free joints (dof,) of a grasp, None: none are."""
        listed, mover = self._listed, self._grasper.mover
        i = int(np.searchsorted(self.use, grasp))
        if listed.verdict[i] == kernels.UNKNOWN:
            self._stand_again()
            kernels.judge(mover.space, self._grasper.arm, listed, i, mover.scratch)
        return listed.answer[i].copy() if listed.verdict[i] == kernels.FREE else None

    def all(self) -> ExecutableGrasps:
        """Test what is left, and return all that are free, the most dexterous first."""
        listed, mover = self._listed, self._grasper.mover
        if (listed.verdict == kernels.UNKNOWN).any():
            self._stand_again()
            kernels.judge_all(mover.space, self._grasper.arm, listed, mover.scratch)
        verdict, rank = listed.verdict, listed.rank
        free = np.flatnonzero(verdict == kernels.FREE)
        order = free[np.argsort(-rank[free], kind="stable")]
        refused = {
            text: int((verdict == code).sum())
            for code, text in _WHY.items()
            if (verdict == code).any()
        }
        answer = listed.answer[order].copy()
        return ExecutableGrasps(self.use[order], answer, rank[order].copy(), refused)

    def _numerically(self, targets: np.ndarray, now: tuple[bool, bool]) -> None:
        """List joints where the arm has no closed form: descents from fixed starts."""
        mover, listed, arm = self._grasper.mover, self._listed, self._grasper.arm
        limb, n = mover.limb, mover.limb.n_arm
        rng = np.random.default_rng(0)
        low, high = limb.lower[:n], limb.upper[:n]
        drawn = rng.uniform(low, high, (SOLVE.restarts, n))
        starts = np.vstack([0.5 * (low + high), drawn])
        work, trial = descent_of(arm.chain), np.zeros(n)
        goal = SOLVE.error, float(SOLVE.steps)
        for i, target in enumerate(targets):
            kernels.begin(listed, i, target)
            if now[0]:
                kernels.test_hand(mover.space, arm, listed, i, mover.scratch)
            count, first = 0, listed.first[i]
            for start in starts if listed.verdict[i] == kernels.UNKNOWN else ():
                work.q[:] = start
                if descend(arm.chain, target, _SCALE, goal, work, trial):
                    listed.q[first + count] = work.q
                    count += 1
            kernels.end(arm, listed, i, count, now[1])
