"""Compiled loop behind the choice of an arm: many configurations at once."""

from numba import njit

from roadmap.compiling.jit_options import BARE
from roadmap.kinematics._chain import forward, jacobian


@njit(**BARE)
def tools_and_jacobians(chain, q, offset, frames, points, jacobians):
    """Write a tool's places (n, 3) and Jacobians (n, 6, dof) for `q` (n, dof).

    `offset` (3,) is the tool's centre point in the tool frame, `frames` (joints + 1,
    12) is working memory. Jacobians are those of the tool frame's origin.
    """
    last = frames.shape[0] - 1
    for k in range(q.shape[0]):
        forward(chain, q[k], frames)
        jacobian(chain, frames, jacobians[k])
        for r in range(3):
            total = frames[last, 9 + r]
            for c in range(3):
                total += frames[last, 3 * r + c] * offset[c]
            points[k, r] = total
