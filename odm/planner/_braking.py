"""A path against points that may have come nearer meanwhile: the test of braking."""

from numba import njit

from odm.close_test._close import motion_clear


@njit(cache=True, nogil=True)
def first_blocked(arm, radii, extra, path, tolerance, cloud, work, grown, leg):
    """Return the first leg of a path (k, dof) that comes too near, -1 for none.

    `radii` (n,) hold radius, covering radius and clearance; grown (n,) and leg (dof,)
    are scratch. A single corner is a robot at rest. Points must be laid out.
    """
    for i in range(radii.shape[0]):
        grown[i] = radii[i] + extra
    for k in range(max(1, path.shape[0] - 1)):
        for j in range(path.shape[1]):
            leg[j] = path[min(k + 1, path.shape[0] - 1), j] - path[k, j]
        if not motion_clear(arm, grown, path[k], leg, tolerance, cloud, False, work):
            return k
    return -1
