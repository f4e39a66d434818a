"""Whether the robot can stand where it is, and at a goal: else no search helps."""

from numba import njit

from odm.search._judge import stands_free
from odm.search._state import view


@njit(cache=True, nogil=True)
def ends_free(state, points):
    """Return whether the robot can stand where it is, and at one of the goals."""
    goals = view(state, "goals")
    if not stands_free(state, points, view(state, "robot_state").q):
        return False
    for g in range(goals.count[0]):
        if stands_free(state, points, goals.q[g]):
            return True
    return False
