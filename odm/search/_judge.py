"""Which motions are free in this frame: by their cells, then by the close test."""

import numpy as np
from numba import njit

from odm.close_test._close import displacement, motion_clear, set_point
from odm.close_test._pick import forget_cells, pick_cells, pick_points
from odm.obstacles._cloud import IS_SORTED
from odm.obstacles._occupancy import sort_points
from odm.search._items import (
    BLOCKED,
    FREE,
    MAYBE,
    REFUSED,
    edge_free,
    item_free,
    pool_free,
    way_in_free,
)
from odm.search._state import (
    N_EXTRA,
    N_TOLERANCE,
    PICK,
    arm_of,
    beside_of,
    cloud_at,
    cloud_of,
    goals_of,
    graph_of,
    own_of,
    pool_of,
    search_of,
    work_of,
)
from odm.search._types import EDGE_BASE, N_BESIDE, N_CLOSE, NO_ITEM, NO_WAY, TO_END


@njit(cache=True, nogil=True)
def near_free(state, cloud, q, dq):
    """Run the close test of a motion against the points of a cloud."""
    arm = arm_of(state)
    own = own_of(state)
    search_of(state).stats[N_CLOSE] += 1
    return motion_clear(
        arm, own.radii, q, dq, own.terms[N_TOLERANCE], cloud, False, work_of(state)
    )


@njit(cache=True, nogil=True)
def close_free(state, points, q, dq):
    """Run the close test of a motion against all of the frame's points."""
    cloud = cloud_of(state)
    if cloud.counts[IS_SORTED] == 0:
        sort_points(points, cloud)
    return near_free(state, cloud, q, dq)


@njit(cache=True, nogil=True)
def pick_ref(state, points, ref):
    """Return the points inside the cells of a way's item: all that can be in its way.

    An edge's cells are those of its list and of its two nodes. Without an item, all
    points are returned, and where extra clearance is kept: then points of other cells
    count too.
    """
    cloud = cloud_of(state)
    if (ref < 0 and ref > EDGE_BASE) or own_of(state).terms[N_EXTRA] > 0.0:
        if cloud.counts[IS_SORTED] == 0:
            sort_points(points, cloud)
        return cloud
    pick = cloud_at(state, PICK)
    forget_cells(pick)
    if ref >= 0:
        pool = pool_of(state)
        begin, end = pool.begin[ref], pool.end[ref]
        pick_cells(pick, cloud.words, pool.block, pool.mask, begin, end)
    else:
        graph = graph_of(state)
        edge = EDGE_BASE - ref
        n = graph.adj_ptr.shape[0] - 1
        a, b = np.int64(graph.edges[edge, 0]), np.int64(graph.edges[edge, 1])
        for item in (n + edge, a, b):
            begin, end = graph.ptr[item], graph.ptr[item + 1]
            pick_cells(pick, cloud.words, graph.block, graph.mask, begin, end)
    pick_points(pick, cloud, points)
    return pick


@njit(cache=True, nogil=True)
def where_blocked(state, near, q, dq, stuck):
    """Return the share of a motion at which the close test finds it blocked, or -1.

    It is most likely blocked where it was the last time, at the share `stuck` (-1: it
    was not): there is where it is looked at first.
    """
    own = own_of(state)
    if stuck >= 0.0:
        set_point(q, dq, stuck, own.spot)
        for j in range(q.shape[0]):
            own.still[j] = 0.0
        if not near_free(state, near, own.spot, own.still):
            return stuck
    if near_free(state, near, q, dq):
        return -1.0
    return work_of(state).value[0]


@njit(cache=True, nogil=True)
def part_free(state, points, ref, q, dq):
    """Run the close test of a motion that is a part of item `ref`."""
    return near_free(state, pick_ref(state, points, ref), q, dq)


@njit(cache=True, nogil=True)
def ref_free(state, ref, frame):
    """Return True if the cells of a way's segment are free; no item is never free."""
    cloud = cloud_of(state)
    graph = graph_of(state)
    pool = pool_of(state)
    search = search_of(state)
    if ref <= EDGE_BASE:
        return edge_free(graph, cloud.words, search, frame, EDGE_BASE - ref)
    if ref >= 0:
        return pool_free(pool, cloud.words, search.sign, ref)
    return False


@njit(cache=True, nogil=True)
def rest_free(state, points, way, segment, q, frame):
    """Test what is left of a way from q on its `segment`; return the bad one or -1.

    From beside the segment the motion to its end is no part of what was certified: no
    cells are known of it, so the close test takes all points.
    """
    own = own_of(state)
    for k in range(segment, way.count[0] - 1):
        beside = k == segment and own.numbers[N_BESIDE] == 1
        ref = NO_ITEM if beside else way.ref[k]
        if ref_free(state, ref, frame):
            continue
        if beside and beside_of(state).free[TO_END] != 1:
            return k
        begin = q if k == segment else way.q[k]
        for j in range(q.shape[0]):
            own.dq[j] = way.q[k + 1, j] - begin[j]
        if not part_free(state, points, ref, begin, own.dq):
            return k
    return -1


@njit(cache=True, nogil=True)
def judge_starts(state, starts, words, frame):
    """Write this frame's verdict by cells of each start motion; True if any is free."""
    any_ = False
    for k in range(starts.count[0]):
        if starts.memo[k] >> 2 == frame:
            any_ = any_ or starts.memo[k] & 3 == FREE
            continue
        ref = starts.ref[k]
        free = starts.static[k] == 1 and ref != NO_ITEM and ref_free(state, ref, frame)
        starts.memo[k] = 4 * frame + (FREE if free else BLOCKED)
        any_ = any_ or free
    return any_


@njit(cache=True, nogil=True)
def offer_starts(state, starts, frame, most):
    """Let the search ask the close test about up to `most` blocked start motions.

    The nearest whose nodes are free; returns how many.
    """
    cloud = cloud_of(state)
    graph = graph_of(state)
    search = search_of(state)
    offered = 0
    for k in range(starts.count[0]):
        if offered >= most:
            break
        if starts.memo[k] != 4 * frame + BLOCKED or starts.static[k] != 1:
            continue
        if item_free(graph, cloud.words, search, frame, starts.node[k]):
            starts.memo[k] = 4 * frame + MAYBE
            offered += 1
    return offered


@njit(cache=True, nogil=True)
def can_leave(starts, frame):
    """Return True if a start motion is free, or may be by the close test."""
    for k in range(starts.count[0]):
        if starts.memo[k] == 4 * frame + FREE or starts.memo[k] == 4 * frame + MAYBE:
            return True
    return False


@njit(cache=True, nogil=True)
def start_clear(state, points, starts, q, frame, k):
    """Run the close test of start motion k; its verdict is remembered."""
    own = own_of(state)
    displacement(q, graph_of(state).nodes[starts.node[k]], own.continuous, own.dq)
    near = pick_ref(state, points, starts.ref[k])
    stuck = where_blocked(state, near, q, own.dq, starts.stuck[k])
    starts.stuck[k] = stuck
    starts.memo[k] = 4 * frame + (FREE if stuck < 0.0 else REFUSED)
    return stuck < 0.0


@njit(cache=True, nogil=True)
def judge_goal(state, g, frame):
    """Return True if a motion into goal g and the node it comes from are free."""
    words = cloud_of(state).words
    graph = graph_of(state)
    pool = pool_of(state)
    goals = goals_of(state)
    search = search_of(state)
    for a in range(goals.number[g]):
        if not way_in_free(goals, pool, words, search, frame, g, a):
            continue
        if item_free(graph, words, search, frame, goals.node[g, a]):
            return True
    return False


@njit(cache=True, nogil=True)
def way_in_clear(state, points, frame, g, a):
    """Run the close test of attachment a of goal g; its verdict is remembered."""
    goals = goals_of(state)
    own = own_of(state)
    q = graph_of(state).nodes[goals.node[g, a]]
    displacement(q, goals.q[g], own.continuous, own.dq)
    near = pick_ref(state, points, goals.ref[g, a])
    stuck = where_blocked(state, near, q, own.dq, goals.stuck[g, a])
    goals.stuck[g, a] = stuck
    goals.memo[g, a] = 4 * frame + (FREE if stuck < 0.0 else REFUSED)
    return stuck < 0.0


@njit(cache=True, nogil=True)
def open_goal(state, points, g, frame, most):
    """Look for a blocked motion into g that the close test finds free; True if any.

    Up to `most` are in question; those after the first that is free are left to the
    search, which asks when they come out first. Where none is free no search begins:
    it would look everywhere for a goal that cannot be entered.
    """
    words = cloud_of(state).words
    graph = graph_of(state)
    pool = pool_of(state)
    goals = goals_of(state)
    search = search_of(state)
    offered = 0
    any_ = False
    for a in range(goals.number[g]):
        if offered >= most:
            break
        if way_in_free(goals, pool, words, search, frame, g, a):
            continue
        if goals.memo[g, a] != 4 * frame + BLOCKED:
            continue
        if item_free(graph, words, search, frame, goals.node[g, a]):
            offered += 1
            if any_:
                goals.memo[g, a] = 4 * frame + MAYBE
            else:
                any_ = way_in_clear(state, points, frame, g, a)
    return any_


@njit(cache=True, nogil=True)
def stands_free(state, points, q):
    """Return True if a configuration itself keeps its distance from the points."""
    own = own_of(state)
    for j in range(q.shape[0]):
        own.still[j] = 0.0
    return close_free(state, points, q, own.still)


@njit(cache=True, nogil=True)
def judge_direct(state, points, q, g, frame):
    """Test the straight motion to goal g: cells, where it stuck before, closely."""
    search = search_of(state)
    cloud = cloud_of(state)
    pool = pool_of(state)
    goals = goals_of(state)
    own = own_of(state)
    ref = goals.direct_ref[g]
    goals.direct_memo[g] = 4 * frame + BLOCKED
    if ref == NO_WAY:
        return False
    if ref >= 0 and pool_free(pool, cloud.words, search.sign, ref):
        goals.direct_memo[g] = 4 * frame + FREE
        return True
    displacement(q, goals.q[g], own.continuous, own.dq)
    near = pick_ref(state, points, ref)
    stuck = where_blocked(state, near, q, own.dq, goals.direct_stuck[g])
    goals.direct_stuck[g] = stuck
    if stuck >= 0.0:
        return False
    goals.direct_memo[g] = 4 * frame + FREE
    return True
