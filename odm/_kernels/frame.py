"""One frame: points to occupancy, the rest of the path, a new path if need be."""

import math

from numba import njit

from odm._kernels.close import motion_clear, set_point
from odm._kernels.occupancy import clear, mark_points, sort_points
from odm._kernels.search import a_star, edge_free, item_free, pool_free
from odm._kernels.signature import sign_frame
from odm._kernels.state import (
    N_TOLERANCE,
    N_TRACK,
    arm_of,
    cloud_of,
    direct_of,
    goals_of,
    graph_of,
    own_of,
    pool_of,
    search_of,
    short_of,
    work_of,
)
from odm._kernels.types import (
    EDGE_BASE,
    IS_GOAL,
    IS_SORTED,
    N_BAD,
    N_CLOSE,
    N_FRAME,
    N_JOINT_COSTS,
    N_RUN,
    N_RUNS,
    NO_ITEM,
    NO_WAY,
)

FREE, BLOCKED = 1, 2
SAME_PLACE = 1e-9  # [m]


@njit(cache=True, nogil=True)
def take_points(state, points):
    """Begin a frame: forget the old points, mark the new; return how many are bad."""
    cloud = cloud_of(state)
    search = search_of(state)
    own = own_of(state)
    clear(cloud)
    mark_points(points, cloud)
    sign_frame(cloud, graph_of(state).region, search.sign)
    own.numbers[N_FRAME] += 1
    search.stats[:] = 0
    return cloud.counts[N_BAD]


@njit(cache=True, nogil=True)
def close_free(state, points, q, dq):
    """Run the close test of a motion against the frame's points."""
    arm = arm_of(state)
    cloud = cloud_of(state)
    work = work_of(state)
    search = search_of(state)
    own = own_of(state)
    if cloud.counts[IS_SORTED] == 0:
        sort_points(points, cloud)
    search.stats[N_CLOSE] += 1
    return motion_clear(
        arm, own.radii, q, dq, own.terms[N_TOLERANCE], cloud, False, work
    )


@njit(cache=True, nogil=True)
def displacement(q_from, q_to, continuous, dq):
    """Write q_to - q_from to `dq`, continuous joints the short way."""
    for j in range(dq.shape[0]):
        d = q_to[j] - q_from[j]
        if continuous[j]:
            d -= 2.0 * math.pi * round(d / (2.0 * math.pi))
        dq[j] = d


@njit(cache=True, nogil=True)
def locate_on_way(state, way, first, q, out):
    """Find q on a way, from segment `first` on, within the tracking share.

    A point of the robot differs by at most sum_j |dq_j| sway_j between q and the
    nearest point of the segment. Writes the share of the segment to out[0]; returns
    the segment, or -1.
    """
    own = own_of(state)
    best = -1
    best_off = own.terms[N_TRACK]
    for k in range(first, way.count[0] - 1):
        a, b = way.q[k], way.q[k + 1]
        along = 0.0
        length2 = 0.0
        for j in range(q.shape[0]):
            d = b[j] - a[j]
            along += (q[j] - a[j]) * d
            length2 += d * d
        t = 0.0
        if length2 > 0.0:
            t = min(1.0, max(0.0, along / length2))
        off = 0.0
        for j in range(q.shape[0]):
            off += abs(a[j] + t * (b[j] - a[j]) - q[j]) * own.sway[j]
        # of two segments over the same place the later one is nearer to the goal
        if off <= best_off + SAME_PLACE:
            best_off = min(off, best_off)
            best = k
            out[0] = t
    return best


@njit(cache=True, nogil=True)
def ref_free(state, ref, frame):
    """Return True if the cells of a way's segment are free; no item is never free."""
    cloud = cloud_of(state)
    graph = graph_of(state)
    pool = pool_of(state)
    search = search_of(state)
    if ref <= EDGE_BASE:
        return edge_free(
            graph, cloud.words, search, frame, EDGE_BASE - ref
        )
    if ref >= 0:
        return pool_free(pool, cloud.words, search.sign, ref)
    return False


@njit(cache=True, nogil=True)
def rest_free(state, points, way, segment, q, frame):
    """Test what is left of a way from q on its `segment`; return the bad one or -1."""
    own = own_of(state)
    for k in range(segment, way.count[0] - 1):
        if ref_free(state, way.ref[k], frame):
            continue
        begin = q if k == segment else way.q[k]
        for j in range(q.shape[0]):
            own.dq[j] = way.q[k + 1, j] - begin[j]
        if not close_free(state, points, begin, own.dq):
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
def close_starts(state, points, starts, q, frame, budget):
    """Give blocked start motions a close test, in order, until `budget` were free."""
    cloud = cloud_of(state)
    graph = graph_of(state)
    search = search_of(state)
    own = own_of(state)
    found = 0
    tried = 0
    for k in range(starts.count[0]):
        if found >= budget or tried >= 2 * budget:
            break
        if starts.memo[k] == 4 * frame + FREE or starts.static[k] != 1:
            continue
        v = starts.node[k]
        if not item_free(graph, cloud.words, search, frame, v):
            continue
        displacement(q, graph.nodes[v], own.continuous, own.dq)
        tried += 1
        if close_free(state, points, q, own.dq):
            starts.memo[k] = 4 * frame + FREE
            found += 1
    return found


@njit(cache=True, nogil=True)
def judge_goal(state, points, g, frame):
    """Write the verdict of a goal's attachments; True if the goal can be entered."""
    cloud = cloud_of(state)
    graph = graph_of(state)
    pool = pool_of(state)
    goals = goals_of(state)
    search = search_of(state)
    any_ = False
    for a in range(goals.number[g]):
        ref = goals.ref[g, a]
        free = ref == IS_GOAL or pool_free(pool, cloud.words, search.sign, ref)
        v = goals.node[g, a]
        if free and not any_:
            any_ = item_free(graph, cloud.words, search, frame, v)
        goals.memo[g, a] = 4 * frame + (FREE if free else BLOCKED)
    return any_


@njit(cache=True, nogil=True)
def close_goal(state, points, g, frame, budget):
    """Give blocked goal motions a close test, until `budget` were free."""
    cloud = cloud_of(state)
    graph = graph_of(state)
    goals = goals_of(state)
    search = search_of(state)
    own = own_of(state)
    found = 0
    tried = 0
    for a in range(goals.number[g]):
        if found >= budget or tried >= 2 * budget:
            break
        if goals.memo[g, a] == 4 * frame + FREE:
            continue
        v = goals.node[g, a]
        if not item_free(graph, cloud.words, search, frame, v):
            continue
        displacement(graph.nodes[v], goals.q[g], own.continuous, own.dq)
        tried += 1
        if close_free(state, points, graph.nodes[v], own.dq):
            goals.memo[g, a] = 4 * frame + FREE
            found += 1
    return found


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
    work = work_of(state)
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
    # the motion is most likely blocked where it was in the last frame
    stuck = goals.direct_stuck[g]
    if stuck >= 0.0:
        set_point(q, own.dq, stuck, own.spot)
        if not stands_free(state, points, own.spot):
            return False
    if not close_free(state, points, q, own.dq):
        goals.direct_stuck[g] = work.value[0]
        return False
    goals.direct_stuck[g] = -1.0
    goals.direct_memo[g] = 4 * frame + FREE
    return True


@njit(cache=True, nogil=True)
def search_goals(state, starts, only, frame):
    """Run A* once; return the entry found or -1."""
    cloud = cloud_of(state)
    graph = graph_of(state)
    goals = goals_of(state)
    search = search_of(state)
    own = own_of(state)
    own.numbers[N_RUN] += 1
    search.stats[N_RUNS] += 1
    h = own.h_any if only < 0 else goals.h[only]
    return a_star(
        graph, direct_of(state), cloud, starts, goals, only, h, search, frame,
        own.numbers[N_RUN],
    )


@njit(cache=True, nogil=True)
def write_way(state, starts, q, entry, start_vertex, way):
    """Write the way that ends in heap entry `entry`."""
    graph = graph_of(state)
    goals = goals_of(state)
    search = search_of(state)
    own = own_of(state)
    n = graph.adj_ptr.shape[0] - 1
    count = 2
    e = entry
    while search.e_from[e] >= 0:
        e = search.e_from[e]
        count += 1
    if count > way.vertex.shape[0]:
        return False
    g = search.e_node[entry] - n
    way.count[0] = count
    way.count[1] = g
    way.vertex[0] = start_vertex
    way.q[0] = q
    k = count - 1
    e = entry
    while k > 0:
        v = search.e_node[e]
        parent = search.e_from[e]
        ref = search.e_ref[e]
        if v >= n:
            way.vertex[k] = goals.vertex[g]
            way.q[k] = goals.q[g]
            if parent >= 0:
                ref = goals.ref[g, -2 - ref]
            else:
                ref = goals.direct_ref[g]
        else:
            way.vertex[k] = v
            way.q[k] = graph.nodes[v]
            if parent < 0:
                ref = starts.ref[-2 - ref]
        way.ref[k - 1] = ref
        e = parent
        k -= 1
    # a goal that is a node is no further vertex
    if count > 1 and way.ref[count - 2] == IS_GOAL:
        way.count[0] = count - 1
        way.vertex[count - 2] = goals.vertex[g]
    unwind(way, own.continuous)
    return True


@njit(cache=True, nogil=True)
def unwind(way, continuous):
    """Let continuous joints go on the short way from vertex to vertex."""
    for k in range(1, way.count[0]):
        for j in range(continuous.shape[0]):
            if continuous[j]:
                d = way.q[k, j] - way.q[k - 1, j]
                turns = round(d / (2.0 * math.pi))
                way.q[k, j] -= 2.0 * math.pi * turns


@njit(cache=True, nogil=True)
def find_shortcut(short, a, b):
    """Return the pool item remembered for the motion from vertex a to b, or -1."""
    size = short.key.shape[0]
    key = (a << 31) | b
    k = ((a * 2654435761) ^ (b * 40503)) & (size - 1)
    while short.key[k] != -1:
        if short.key[k] == key:
            return short.item[k]
        k = (k + 1) & (size - 1)
    return NO_ITEM


@njit(cache=True, nogil=True)
def add_shortcut(short, a, b, item):
    """Remember a pool item (or NO_WAY) for the motion from a to b; False when full."""
    size = short.key.shape[0]
    if 2 * short.count[0] >= size:
        return False
    k = ((a * 2654435761) ^ (b * 40503)) & (size - 1)
    while short.key[k] != -1:
        k = (k + 1) & (size - 1)
    short.key[k] = (a << 31) | b
    short.item[k] = item
    short.count[0] += 1
    return True


@njit(cache=True, nogil=True)
def take_shortcuts(state, way, weights):
    """Shorten a way by the remembered motions that are free now."""
    search = search_of(state)
    cloud = cloud_of(state)
    pool = pool_of(state)
    short = short_of(state)
    own = own_of(state)
    n = way.count[0]
    if n < 3 or short.count[0] == 0:
        return
    best, back, ref = short.best, short.back, short.ref
    best[0] = 0.0
    for k in range(1, n):
        best[k] = math.inf
        for i in range(k - 1, -1, -1):
            length = 0.0
            for j in range(weights.shape[0]):
                d = weights[j] * (way.q[k, j] - way.q[i, j])
                length += d * d
            length = best[i] + math.sqrt(length)
            if length >= best[k] - 1e-9:
                continue
            item = way.ref[k - 1]
            if i < k - 1:
                item = find_shortcut(short, way.vertex[i], way.vertex[k])
                if item < 0 or not pool_free(pool, cloud.words, search.sign, item):
                    continue
            best[k] = length
            back[k] = i
            ref[k] = item
    # walk back, then lay the kept vertices out from the front
    count = 1
    k = n - 1
    while k > 0:
        back[n + count] = k
        count += 1
        k = back[k]
    for i in range(1, count):
        k = back[n + count - i]
        way.vertex[i] = way.vertex[k]
        way.ref[i - 1] = ref[k]
        way.q[i] = way.q[k]
    way.count[0] = count
    unwind(way, own.continuous)


@njit(cache=True, nogil=True)
def way_length(way, weights):
    """Return the weighted length of a way."""
    total = 0.0
    for k in range(1, way.count[0]):
        part = 0.0
        for j in range(weights.shape[0]):
            d = weights[j] * (way.q[k, j] - way.q[k - 1, j])
            part += d * d
        total += math.sqrt(part)
    return total


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
    judged = False
    any_start = False
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
        if not judged:
            any_start = judge_starts(state, starts, cloud.words, frame)
            judged = True
        enterable = judge_goal(state, points, g, frame)
        if joint:
            continue
        entry = -1
        if any_start and enterable:
            entry = search_goals(state, starts, g, frame)
        if entry < 0:
            opened = 0
            if not any_start and not stands_free(state, points, q):
                return False
            if not enterable:
                if not stands_free(state, points, goals.q[g]):
                    continue
                opened = close_goal(state, points, g, frame, budget)
                if opened == 0:
                    continue
            if not any_start:
                found = close_starts(state, points, starts, q, frame, budget)
                if found == 0:
                    return False
                any_start = True
                opened += found
            elif opened == 0:
                opened += close_starts(state, points, starts, q, frame, budget)
                opened += close_goal(state, points, g, frame, budget)
            if opened > 0:
                entry = search_goals(state, starts, g, frame)
        if entry >= 0 and write_way(state, starts, q, entry, start_vertex, way):
            take_shortcuts(state, way, own.weights)
            return True
    if not joint:
        return False
    if not any_start:
        close_starts(state, points, starts, q, frame, budget)
    entry = search_goals(state, starts, -1, frame)
    if entry >= 0 and write_way(state, starts, q, entry, start_vertex, way):
        take_shortcuts(state, way, own.weights)
        return True
    return False
