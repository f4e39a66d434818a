"""One frame from scratch: points to occupancy, then a way to the first goal."""

from numba import njit

from odm.obstacles._cloud import N_BAD, N_INSIDE, N_OUTSIDE
from odm.obstacles._occupancy import clear, mark_points
from odm.obstacles._world_frame import dilate_points
from odm.search._astar import a_star
from odm.search._judge import (
    can_leave,
    judge_direct,
    judge_goal,
    judge_starts,
    offer_starts,
    open_goal,
    stands_free,
)
from odm.search._paths import take_shortcuts, unwind, write_way
from odm.search._signature import sign_frame
from odm.search._state import N_EXTRA, cloud_of, goals_of, graph_of, own_of, search_of
from odm.search._types import N_FRAME, N_JOINT_COSTS, N_RUN, N_RUNS, N_STEP


@njit(cache=True, nogil=True)
def take_points(state, points):
    """Begin a frame: forget the old points, mark the new; return how many are bad."""
    cloud = cloud_of(state)
    search = search_of(state)
    own = own_of(state)
    clear(cloud)
    mark_points(points, cloud)
    if own.terms[N_EXTRA] > 0.0:
        dilate_points(points, own.terms[N_EXTRA], cloud)
    sign_frame(cloud, graph_of(state).region, search.sign)
    own.numbers[N_FRAME] += 1
    search.stats[:] = 0
    return cloud.counts[N_BAD]


@njit(cache=True, nogil=True)
def begin_step(state, given, points):
    """Begin a step of the planner with its frame's points, copied to `points`.

    Returns True where some are not finite or most lie outside the grid.
    """
    own_of(state).numbers[N_STEP] += 1
    for i in range(points.shape[0]):
        points[i, 0], points[i, 1] = given[i, 0], given[i, 1]
        points[i, 2] = given[i, 2]
    bad = take_points(state, points)
    counts = cloud_of(state).counts
    return bad > 0 or counts[N_OUTSIDE] > counts[N_INSIDE]


@njit(cache=True, nogil=True)
def search_goals(state, points, starts, q, only, frame):
    """Run A* once; return the entry found or -1."""
    own = own_of(state)
    own.numbers[N_RUN] += 1
    search_of(state).stats[N_RUNS] += 1
    return a_star(state, points, starts, q, only, frame, own.numbers[N_RUN])


@njit(cache=True, nogil=True)
def plan(state, points, q, starts, start_vertex, low, high, budget, way):
    """Plan from scratch to goals low..high-1 in rank order; with costs when all.

    Returns True and writes `way` when a path was found.
    """
    cloud = cloud_of(state)
    goals = goals_of(state)
    own = own_of(state)
    frame = own.numbers[N_FRAME]
    joint = own.numbers[N_JOINT_COSTS] == 1
    most = 2 * budget
    judged = False
    any_start = False
    leaves = True  # the start may be left by one of its motions
    for g in range(low, high):
        if judge_direct(state, points, q, g, frame) and not joint:
            way.count[0] = 2
            way.count[1] = g
            way.vertex[0] = start_vertex
            way.vertex[1] = goals.vertex[g]
            way.ref[0] = goals.direct_ref[g]
            way.q[0] = q
            way.q[1] = goals.q[g]
            unwind(way, own.continuous)
            return True
        if not leaves:
            continue
        if not judged:
            any_start = judge_starts(state, starts, cloud.words, frame)
            judged = True
        enterable = judge_goal(state, g, frame)
        if joint:
            continue
        entry = -1
        if any_start and enterable:
            entry = search_goals(state, points, starts, q, g, frame)
        if entry < 0:
            opened = False
            if not any_start and not stands_free(state, points, q):
                return False
            if not enterable:
                if not stands_free(state, points, goals.q[g]):
                    continue
                opened = open_goal(state, points, g, frame, most)
                if not opened:
                    continue
            if not any_start:
                if offer_starts(state, starts, frame, most) == 0:
                    leaves = False
                    continue
                any_start = opened = True
            elif not opened:
                opened = open_goal(state, points, g, frame, most)
                opened = offer_starts(state, starts, frame, most) > 0 or opened
            if opened:
                entry = search_goals(state, points, starts, q, g, frame)
            leaves = entry >= 0 or can_leave(starts, frame)
        if entry >= 0 and write_way(state, starts, q, entry, start_vertex, way):
            take_shortcuts(state, way, own.weights)
            return True
    if not joint:
        return False
    if not any_start:
        offer_starts(state, starts, frame, most)
    entry = search_goals(state, points, starts, q, -1, frame)
    if entry >= 0 and write_way(state, starts, q, entry, start_vertex, way):
        take_shortcuts(state, way, own.weights)
        return True
    return False
