"""Compiled loops over many poses and postures of an arm, so that one is measured."""

from numba import njit

from handover.human._arm_solve import solve_arm
from handover.meet._quality import quality_of
from roadmap.compiling.jit_options import BARE


@njit(**BARE)
def solve_poses(arm, poses, step, work, q, swivels, counts):
    """Solve every row of poses (n, 12); counts (n, 2) as `solve_arm` returns them."""
    for i in range(poses.shape[0]):
        counts[i, 0], counts[i, 1] = solve_arm(arm, poses[i], step, work, q, swivels)


@njit(**BARE)
def qualities_of(state, obstacles, settings, joints, parts, online):
    """Write `quality_of` of every row of joints (n, 7) to parts (n, 5), online (n,)."""
    for i in range(joints.shape[0]):
        online[i] = quality_of(state, obstacles, settings, joints[i], parts[i])
