"""Kernels of braking and escape: a path against points to come, and an anchor."""

from numba import njit

from odm.close_test._close import motion_clear
from roadmap.kinematics._forward import body_frames, place_points


@njit(cache=True, nogil=True)
def first_blocked(arm, radii, path, tolerance, cloud, work, leg):
    """Return the first leg of a path (k, dof) that comes too near, -1 for none.

    `radii` (n,) hold radius, covering radius and all that is to be kept; leg (dof,) is
    scratch. A single corner is a robot at rest. Points must be laid out.
    """
    for k in range(max(1, path.shape[0] - 1)):
        for j in range(path.shape[1]):
            leg[j] = path[min(k + 1, path.shape[0] - 1), j] - path[k, j]
        if not motion_clear(arm, radii, path[k], leg, tolerance, cloud, False, work):
            return k
    return -1


@njit(cache=True, nogil=True)
def place_anchor(arm, q, work):
    """Write the sphere centres at q to work.anchor, which an escape starts from."""
    body_frames(arm.tree_i, arm.tree_f, q, work.frames[0])
    place_points(work.frames[0], arm.body, arm.spheres, work.anchor)
