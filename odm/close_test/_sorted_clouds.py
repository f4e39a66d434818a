"""Points laid out for the close test, also those outside the grid."""

from numba import njit

from odm.obstacles._cloud import (
    IS_SORTED,
    N_BAD,
    N_GIVEN,
    N_INSIDE,
    N_LISTED,
    N_OCCUPIED,
)
from odm.obstacles._occupancy import clear, sort_points
from roadmap.jit_options import LEAN


@njit(**LEAN)
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
    cloud.counts[N_OCCUPIED] = cloud.counts[N_LISTED] = n_occupied
    cloud.counts[N_GIVEN] = points.shape[0]
    cloud.counts[N_INSIDE] = points.shape[0] - bad
    cloud.counts[N_BAD] = bad
    sort_points(points, cloud)
    cloud.counts[IS_SORTED] = 1
    return bad
