"""Algorithm 1 of [Huaman2014]: which grasps an arm can execute, and how."""

from dataclasses import dataclass

import numpy as np

from handover.grasps.grasp_set import GraspSet
from handover.plans import _space as kernels
from handover.plans.mover import Mover
from roadmap.kinematics._inverse import descend
from roadmap.kinematics.tool_chain import descent_of

_WHY = {
    kernels.OUT_OF_REACH: "out of reach",
    kernels.HAND_TOUCHES: "the hand would touch something",
    kernels.ARM_TOUCHES: "the arm would touch something",
}
_SCALE = np.array([0.1, 0.1])  # [m or rad] that counts as 1 in a descent
_ERROR = 1e-5  # of that: 1 um
_RESTARTS, _MOST_STEPS = 12, 60


@dataclass(frozen=True, eq=False)
class Executed:
    """The grasps of a set that an arm can execute, the most dexterous first.

    Attributes:
        grasp: (m,) which.
        q: (m, dof) joints of arm and closed hand [rad or m].
        dexterity: (m,) of the arm there.
        refused: Why the others cannot -> how many.
    """

    grasp: np.ndarray
    q: np.ndarray
    dexterity: np.ndarray
    refused: dict[str, int]

    def __len__(self) -> int:
        return len(self.grasp)


def prune_grasps(
    mover: Mover,
    grasps: GraspSet,
    T_world_object: np.ndarray,
    use: np.ndarray | None = None,
) -> Executed:
    """Keep the grasps that an arm can execute on an object where it stands.

    Args:
        mover: The arm; it looks at the object as it was put (`put_object`, `hold`).
        grasps: The set.
        T_world_object: (4, 4) where the object is [m].
        use: (k,) which grasps to look at; all if left.

    Returns:
        Those that are within limits and free with open and closed hand; of the joints
        that reach a grasp, the most dexterous free ones over a grid of the free angle.
    """
    use = np.arange(len(grasps)) if use is None else np.asarray(use, np.int64)
    n, limb = len(grasps), mover.limb
    targets = np.zeros((n, 12))
    targets[use] = mover.target(T_world_object @ grasps.T_object_palm[use])
    answers = np.zeros((n, limb.dof)), np.zeros(n), np.full(n, -1)
    if mover.prune is None:
        _numerically(mover, grasps, targets, use, answers)
    else:
        hands = grasps.values, grasps.preshape
        kernels.execute_all(
            mover.space, mover.prune, targets, hands, use, answers, mover.scratch
        )
    q, dexterity, verdict = answers
    free = use[verdict[use] == kernels.FREE]
    order = free[np.argsort(-dexterity[free], kind="stable")]
    refused = {
        text: int((verdict[use] == code).sum())
        for code, text in _WHY.items()
        if (verdict[use] == code).any()
    }
    return Executed(order, q[order].copy(), dexterity[order].copy(), refused)


def _numerically(mover: Mover, grasps: GraspSet, targets, use, answers) -> None:
    """Execute grasps where the arm has no closed form: descents from fixed starts."""
    limb, n = mover.limb, mover.limb.n_arm
    rng = np.random.default_rng(0)
    low, high = limb.lower[:n], limb.upper[:n]
    starts = np.vstack([0.5 * (low + high), rng.uniform(low, high, (_RESTARTS, n))])
    prune = kernels.Pruning(
        seven=(), chain=limb.chain.arrays, free=np.zeros(1), room=(),
        found=np.zeros((len(starts), n)), value=np.zeros(len(starts)),
        frames=np.zeros((n + 1, 12)), jac=np.zeros((6, n)),
        weighted=np.zeros((n, 7)), gram=np.zeros((6, 6)),
    )  # fmt: skip
    work, trial = descent_of(limb.chain.arrays), np.zeros(n)
    for k in use:
        count = 0
        for start in starts:
            work.q[:] = start
            goal = _ERROR, float(_MOST_STEPS)
            arrays = limb.chain.arrays
            if descend(arrays, targets[k], _SCALE, goal, work, trial):
                prune.found[count] = work.q
                count += 1
        answers[2][k], answers[1][k] = kernels.best_of(
            mover.space, prune, count, grasps.values[k], grasps.preshape[k],
            answers[0][k], mover.scratch,
        )  # fmt: skip
