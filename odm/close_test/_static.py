"""Many motions against everything that stands still."""

from numba import njit

from odm.close_test._close import motion_clear
from odm.close_test._solids import motion_clear_of_solids
from roadmap.geometry._self_collision import motion_clear as keeps_apart


@njit(cache=True, nogil=True)
def motions_free(
    arm,
    q,
    dq,
    itself,
    apart,
    fine,
    scratch,
    solids,
    skip,
    margin,
    radii,
    cloud,
    place_radii,
    place,
    tolerance,
    work,
    result,
):
    """Write to `result` (k,) which motions q[k] + t dq[k] are free."""
    for k in range(q.shape[0]):
        result[k] = False
        if not motion_clear_of_solids(arm, margin, q[k], dq[k], solids, skip, work):
            continue
        pair, _ = keeps_apart(itself, q[k], dq[k], apart, fine, scratch)
        if pair >= 0:
            continue
        if not motion_clear(arm, radii, q[k], dq[k], tolerance, cloud, False, work):
            continue
        if not motion_clear(
            arm, place_radii, q[k], dq[k], tolerance, place, False, work
        ):
            continue
        result[k] = True
