"""The extremes of a chain: the box that its tool reaches and its best dexterity."""

import numpy as np

from handover.chain import Chain
from handover.reach._reach_build import Work
from handover.reach._reach_ik import most_dexterous, stretch
from roadmap.kinematics._chain import draw_code, from_lattice
from roadmap.kinematics.tool_chain import descent_of

_STARTS = 12  # for each side of the box
_YARDSTICK = 20_000  # configurations drawn for the best dexterity
_CLIMB = 6_000  # steps up from the best of them


def work_of(chain: Chain) -> Work:
    """Return working memory for one thread."""
    code = np.zeros(chain.dof, np.uint16)
    return Work(*descent_of(chain.arrays), code=code, target=np.zeros(12))


def best_dexterity(chain: Chain, seed: int) -> float:
    """Return the dexterity that counts as quality 1.

    The best of a fixed set of configurations, then of small steps from there.
    """
    rng, span = np.random.default_rng(seed), np.ptp(chain.limits, axis=1)
    steps = rng.normal(size=(_CLIMB, chain.dof))
    steps *= np.geomspace(0.1, 0.002, _CLIMB)[:, None] * span
    given = chain.arrays, seed + 1, _YARDSTICK, steps
    most = most_dexterous(*given, work_of(chain), np.empty(chain.dof))
    return most if most > 0.0 else 1e-12


def reachable_box(chain: Chain) -> np.ndarray:
    """Return the (2, 3) lower and upper corner of the tool's places.

    Joint by joint to the best value in each direction, from several starts.
    """
    box = np.empty((2, 3))
    work = work_of(chain)
    for axis in range(3):
        for side, sign in enumerate((-1.0, 1.0)):
            direction = np.zeros(3)
            direction[axis] = sign
            far = -np.inf
            for k in range(_STARTS):
                draw_code(7, k, work.code)
                from_lattice(chain.arrays, work.code, work.q)
                far = max(far, stretch(chain.arrays, direction, work))
            box[side, axis] = sign * (far + 1e-6)
    return box
