"""Inverse kinematics of a chain by damped least squares, one descent from one start.

Robots and people, configurations and reach maps: this is the one engine.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import BARE
from roadmap.kinematics._chain import forward, jacobian, limited_step, pose_error


class Descent(NamedTuple):
    """Working memory of descents along one chain, for one thread."""

    frames: np.ndarray  # (n + 1, 12) pose of each row, the tool's last
    jac: np.ndarray  # (6, dof)
    weighted: np.ndarray  # (dof, 7)
    gram: np.ndarray  # (6, 6)
    q: np.ndarray  # (dof,) start, then result [rad or m]
    dq: np.ndarray  # (dof,)
    error: np.ndarray  # (6,) that is left, divided by the scale


@njit(**BARE)
def descend(chain, target, scale, goal, work, trial):
    """Move work.q towards the pose `target` of the tool, within the chain's limits.

    Levenberg-Marquardt: the damping shrinks after a step that helped and grows after
    one that did not; joints at a limit that want to leave it rest.

    target: (12,) rotation (9) and origin (3). scale: (2,) length and angle [rad] that
    count as 1. goal: (2,) length of the scaled error to reach, and the most steps.
    work: `Descent`, or what has its fields. trial: (dof,) scratch.

    Returns:
        True if it arrives; work.error is what is left.
    """
    q, tool, square = work.q, work.frames[-1], goal[0] * goal[0]
    forward(chain, q, work.frames)
    cost = pose_error(tool, target, scale, work.error)
    damping = 1.0
    for _ in range(int(goal[1])):
        if cost < square:
            return True
        if damping > 1e8:
            return False
        jacobian(chain, work.frames, work.jac)
        copy_row(q, trial)
        limited_step(chain, q, scale, damping, work)
        forward(chain, q, work.frames)
        new = pose_error(tool, target, scale, work.error)
        if new < cost:
            cost = new
            damping = max(0.2 * damping, 1e-9)
        else:
            copy_row(trial, q)
            forward(chain, q, work.frames)
            pose_error(tool, target, scale, work.error)
            damping *= 5.0
    return cost < square
