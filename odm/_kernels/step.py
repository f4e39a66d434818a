"""The frame's decision: go on, take a new way, or hold."""

import math

from numba import njit

from odm._kernels.close import displacement
from odm._kernels.frame import plan
from odm._kernels.judge import rest_free
from odm._kernels.state import (
    ALONG,
    FRESH,
    SPARE,
    WAY,
    goals_of,
    graph_of,
    own_of,
    starts_at,
    way_at,
)
from odm._kernels.types import (
    N_FRAME,
    N_JOINT,
    N_LOOK,
    N_SAME,
    N_SEGMENT,
    NO_WAY,
)
from odm._kernels.ways import locate_on_way, way_length

FOLLOWING, PLANNED, NO_PATH, NOT_ATTACHED = 0, 1, 2, 3
NOT_FINITE, OUT_OF_LIMITS = 4, 5
LIMIT_TOLERANCE = 1e-3  # [rad or m] a start this far outside its limits is tolerated
IMPROVE_EVERY = 8  # frames between two looks for a better way than a free one
WORTH_A_LOOK = 1.1  # times the straight distance


@njit(cache=True, nogil=True)
def weighted(q_from, q_to, state):
    """Return the weighted length of the straight motion between configurations."""
    own = own_of(state)
    displacement(q_from, q_to, own.continuous, own.dq)
    total = 0.0
    for j in range(q_from.shape[0]):
        d = own.weights[j] * own.dq[j]
        total += d * d
    return math.sqrt(total)


@njit(cache=True, nogil=True)
def along_way(state, way, segment, q, along):
    """Let the two ends of the way's present segment be what q is attached to."""
    graph = graph_of(state)
    goals = goals_of(state)
    n = graph.adj_ptr.shape[0] - 1
    count = 0
    ref = way.ref[segment]
    for g in range(goals.count[0]):
        goals.direct_ref[g] = NO_WAY
    for end in (segment + 1, segment):
        v = way.vertex[end]
        if v < n:
            along.node[count] = v
            along.length[count] = weighted(q, graph.nodes[v], state)
            along.ref[count] = ref
            along.static[count] = 1
            along.memo[count] = 0
            count += 1
            continue
        for g in range(goals.count[0]):
            if goals.vertex[g] == v:
                goals.direct_ref[g] = ref
    along.count[0] = count


@njit(cache=True, nogil=True)
def copy_way(source, target):
    """Let `target` be the same way as `source`."""
    n = source.count[0]
    for k in range(n):
        target.vertex[k] = source.vertex[k]
        target.ref[k] = source.ref[k]
        target.q[k] = source.q[k]
    target.count[0] = n
    target.count[1] = source.count[1]


@njit(cache=True, nogil=True)
def same_rest(way, where, new):
    """Return True if `new` leads over vertices that were still ahead on `way`."""
    if where < 0 or new.count[0] < 2:
        return False
    shift = way.count[0] - new.count[0]
    if shift < where:
        return False
    for k in range(1, new.count[0]):
        if new.vertex[k] != way.vertex[k + shift]:
            return False
    return True


@njit(cache=True, nogil=True)
def take_configuration(own, q):
    """Keep q; return the code of what is wrong with it, or FOLLOWING."""
    for j in range(q.shape[0]):
        own.q[j] = q[j]
    for j in range(q.shape[0]):
        if not math.isfinite(q[j]):
            return NOT_FINITE
        over = max(own.lower[j] - q[j], q[j] - own.upper[j])
        if not own.continuous[j] and over > LIMIT_TOLERANCE:
            own.numbers[N_JOINT] = j
            return OUT_OF_LIMITS
    return FOLLOWING


@njit(cache=True, nogil=True)
def rest_length(state, way, where, q):
    """Return the weighted length of a way from q on its segment `where`."""
    rest = weighted(q, way.q[where + 1], state)
    for k in range(where + 1, way.count[0] - 1):
        rest += weighted(way.q[k], way.q[k + 1], state)
    return rest


@njit(cache=True, nogil=True)
def step(state, points, q, always, margin, budget):
    """Answer one frame whose points were taken; see the codes above.

    The answer's way stands at row WAY; own.numbers[N_SEGMENT] is the segment that q
    is on and own.numbers[N_SAME] tells that a new search found the old way again.
    """
    goals = goals_of(state)
    own = own_of(state)
    way, spare = way_at(state, WAY), way_at(state, SPARE)
    fresh = starts_at(state, FRESH)
    trouble = take_configuration(own, q)
    if trouble != FOLLOWING:
        return trouble
    q = own.q
    use_fresh = True
    for j in range(q.shape[0]):
        use_fresh = use_fresh and q[j] == own.q_fresh[j]
    where = -1
    if way.count[0] >= 2:
        where = locate_on_way(state, way, own.numbers[N_SEGMENT], q, own.out)
    if where < 0 and not use_fresh:
        return NOT_ATTACHED
    rest_is_free = False
    rest = 0.0
    if where >= 0 and not always and way.count[1] >= 0:
        frame = own.numbers[N_FRAME]
        rest_is_free = rest_free(state, points, way, where, q, frame) < 0
        if rest_is_free:
            own.numbers[N_SEGMENT] = where
            rest = rest_length(state, way, where, q)
            straight = weighted(q, way.q[way.count[0] - 1], state)
            look = frame % IMPROVE_EVERY == 0 or own.numbers[N_LOOK] == 1
            own.numbers[N_LOOK] = 0
            if not look or rest <= WORTH_A_LOOK * straight:
                return FOLLOWING
    start_vertex = goals.count[1]
    starts = fresh
    if use_fresh:
        for g in range(goals.count[0]):
            goals.direct_ref[g] = goals.fresh_ref[g]
    else:
        starts = starts_at(state, ALONG)
        along_way(state, way, where, q, starts)
        start_vertex = goals.count[2]
    for g in range(goals.count[0]):
        goals.direct_length[g] = weighted(q, goals.q[g], state)
    n_goals = goals.count[0]
    found = plan(state, points, q, starts, start_vertex, 0, n_goals, budget, spare)
    if rest_is_free:
        rank = way.count[1]
        if not found or spare.count[1] > rank:
            return FOLLOWING
        same = spare.count[1] == rank
        if same and way_length(spare, own.weights) > (1.0 - margin) * rest:
            return FOLLOWING
    if not found:
        return NO_PATH
    own.numbers[N_SAME] = 1 if same_rest(way, where, spare) else 0
    copy_way(spare, way)
    own.numbers[N_SEGMENT] = 0
    return PLANNED
