"""A path against points that may have come nearer meanwhile: the test of braking."""

from numba import njit

from odm._kernels.close import motion_clear
from odm._kernels.occupancy import clear, sort_points
from odm._kernels.types import IS_SORTED, N_BAD, N_INSIDE, N_OCCUPIED


@njit(cache=True, nogil=True)
def lay_out(points, cloud):
    """Lay points (n, 3) out for the close test, also those outside the grid.

    Those count to the nearest block, whose box holds them. Return how many are not
    finite; these are left out.
    """
    clear(cloud)
    inv = 0.25 / cloud.h
    words, occupied, where = cloud.words, cloud.occupied, cloud.where
    n_occupied = bad = 0
    for i in range(points.shape[0]):
        b = 0
        finite = True
        for a in range(3):
            x = (points[i, a] - cloud.origin[a]) * inv
            top = cloud.shape[a] - 1
            if not abs(x) < 1e15:
                finite = False
            elif x >= top:
                b = b * cloud.shape[a] + top
            elif x > 0.0:
                b = b * cloud.shape[a] + int(x)
            else:
                b = b * cloud.shape[a]
        if not finite:
            where[i] = -1
            bad += 1
            continue
        if words[b] == 0:
            occupied[n_occupied] = b
            cloud.slot[b] = n_occupied
            n_occupied += 1
            words[b] = 1
        where[i] = b << 6
    cloud.counts[N_OCCUPIED] = n_occupied
    cloud.counts[N_INSIDE] = points.shape[0] - bad
    cloud.counts[N_BAD] = bad
    sort_points(points, cloud)
    cloud.counts[IS_SORTED] = 1
    return bad


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
