"""The frame's decision: go on, take a new way, or hold."""

import math

from numba import njit

from odm.close_test._close import displacement
from odm.search._frame import plan
from odm.search._judge import rest_free
from odm.search._paths import (
    certify_whole,
    is_on,
    locate_on_way,
    turns_back,
    way_length,
)
from odm.search._state import NO_ITEM, NO_WAY, TO_BEGIN, TO_END, view

FOLLOWING, PLANNED, NO_PATH, NOT_ATTACHED = 0, 1, 2, 3
NOT_FINITE, OUT_OF_LIMITS = 4, 5
LOOK, BESIDE = 6, 7
HAS_NO_PATH = (NO_PATH, NOT_ATTACHED)  # the roadmap has none; there may be one
LIMIT_TOLERANCE = 1e-3  # [rad or m] a start this far outside its limits is tolerated
IMPROVE_EVERY = 8  # frames between two looks for a better way than a free one
WORTH_A_LOOK = 1.1  # times the straight distance


@njit(cache=True, nogil=True)
def weighted(q_from, q_to, state):
    """Return the weighted length of the straight motion between configurations."""
    own = view(state, "own")
    displacement(q_from, q_to, own.continuous, own.dq)
    total = 0.0
    for j in range(q_from.shape[0]):
        d = own.weights[j] * own.dq[j]
        total += d * d
    return math.sqrt(total)


@njit(cache=True, nogil=True)
def along_way(state, way, segment, q, along):
    """Let the two ends of the way's present segment be what q is attached to.

    On the segment those motions are parts of the one that was certified. Beside it
    they are new: no cells are known of them, and `beside` says whether they are free of
    what stands still.
    """
    graph, goals, free = (
        view(state, "graph"),
        view(state, "goals"),
        view(state, "beside").free,
    )
    n = graph.adj_ptr.shape[0] - 1
    count = 0
    beside = view(state, "numbers").beside[0] == 1
    ref = NO_ITEM if beside else way.ref[segment]
    for g in range(goals.count[0]):
        goals.direct_ref[g] = NO_WAY
    for k in (TO_END, TO_BEGIN):
        if beside and free[k] != 1:
            continue
        v = way.vertex[segment + 1 - k]
        if v < n:
            along.node[count] = v
            along.length[count] = weighted(q, graph.nodes[v], state)
            along.ref[count] = ref
            along.static[count] = 1
            along.memo[count] = 0
            along.stuck[count] = -1.0
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
    """Return True if `new` leads over the very vertices that are ahead on `way`."""
    if where < 0 or new.count[0] < 2:
        return False
    shift = way.count[0] - new.count[0]
    if shift != where:
        return False
    for k in range(1, new.count[0]):
        if new.vertex[k] != way.vertex[k + shift]:
            return False
    return True


@njit(cache=True, nogil=True)
def take_configuration(state, q):
    """Keep q; return the code of what is wrong with it, or FOLLOWING."""
    own = view(state, "own")
    for j in range(q.shape[0]):
        own.q[j] = q[j]
    for j in range(q.shape[0]):
        if not math.isfinite(q[j]):
            return NOT_FINITE
        over = max(own.lower[j] - q[j], q[j] - own.upper[j])
        if not own.continuous[j] and over > LIMIT_TOLERANCE:
            view(state, "numbers").joint[0] = j
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
def judge(state, points, q, always):
    """Judge the way in use: FOLLOWING, a trouble's code, or LOOK for a new way.

    With LOOK numbers.where is the segment that q is on, -1 for none, and
    numbers.rest tells whether the rest of the way is free. With BESIDE it is
    not on that segment but beside it, and the group Beside is to be filled first.
    """
    own, numbers, way = view(state, "own"), view(state, "numbers"), view(state, "way")
    trouble = take_configuration(state, q)
    if trouble != FOLLOWING:
        return trouble
    q = own.q
    numbers.rest[0] = 0
    where = -1
    if way.count[0] >= 2:
        where = locate_on_way(state, way, 0, q, own.out)  # it may have slowed down
    if where >= 0 and turns_back(way, where, q, own.continuous):
        where = -1
    numbers.where[0] = where
    numbers.beside[0] = 0
    if where < 0 and not is_fresh(own):
        return NOT_ATTACHED
    if where >= 0 and not is_on(view(state, "proof"), where, q):
        numbers.beside[0] = 1
        if not is_known_beside(view(state, "beside"), way, where, q):
            return BESIDE
    if where < 0 or always or way.count[1] < 0:
        return LOOK
    if rest_free(state, points, way, where, q) >= 0:
        return LOOK
    numbers.rest[0] = 1
    numbers.segment[0] = where
    look = numbers.step[0] % IMPROVE_EVERY == 0 or numbers.look[0] == 1
    numbers.look[0] = 0
    if not look:
        return FOLLOWING
    straight = weighted(q, way.q[way.count[0] - 1], state)
    # nothing is shorter than straight on, but a goal of a better rank may be free now
    first = way.count[1] == 0
    if first and rest_length(state, way, where, q) <= WORTH_A_LOOK * straight:
        numbers.better[0] = 0
        return FOLLOWING
    return LOOK


@njit(cache=True, nogil=True)
def is_known_beside(beside, way, segment, q):
    """Return True if `beside` tells of this very q and segment."""
    for j in range(q.shape[0]):
        if beside.q[0, j] != q[j]:
            return False
        if beside.q[1, j] != way.q[segment + 1, j]:
            return False
        if beside.q[2, j] != way.q[segment, j]:
            return False
    return True


@njit(cache=True, nogil=True)
def is_fresh(own):
    """Return True if the start motions of this very q are known."""
    for j in range(own.q.shape[0]):
        if own.q[j] != own.q_fresh[j]:
            return False
    return True


@njit(cache=True, nogil=True)
def look(state, points, margin, budget, looks):
    """Look for a new way after `judge` said LOOK; PLANNED: `adopt` may take it.

    A free way is kept until `looks` in a row found a better one.
    """
    goals, own, numbers = (
        view(state, "goals"),
        view(state, "own"),
        view(state, "numbers"),
    )
    way, spare = view(state, "way"), view(state, "spare")
    q = own.q
    where = numbers.where[0]
    start_vertex = goals.count[1]
    starts = view(state, "fresh")
    if is_fresh(own):
        for g in range(goals.count[0]):
            goals.direct_ref[g] = goals.fresh_ref[g]
    else:
        starts = view(state, "along")
        along_way(state, way, where, q, starts)
        start_vertex = goals.count[2]
    for g in range(goals.count[0]):
        goals.direct_length[g] = weighted(q, goals.q[g], state)
    found = plan(state, points, starts, start_vertex, 2 * budget)
    if numbers.rest[0] == 1:
        rank = way.count[1]
        better = found and spare.count[1] <= rank
        if better and spare.count[1] == rank:
            rest = rest_length(state, way, where, q)
            better = way_length(spare, own.weights) <= (1.0 - margin) * rest
        numbers.better[0] = numbers.better[0] + 1 if better else 0
        if numbers.better[0] < looks:
            return FOLLOWING
    if not found:
        return NO_PATH
    return PLANNED


@njit(cache=True, nogil=True)
def adopt(state):
    """Take the way that `look` found; numbers.same tells that it is the old."""
    own, numbers = view(state, "own"), view(state, "numbers")
    way, spare = view(state, "way"), view(state, "spare")
    numbers.better[0] = 0
    numbers.same[0] = 1 if same_rest(way, numbers.where[0], spare) else 0
    copy_way(spare, way)
    numbers.segment[0] = 0
    first, where, proof = 0, numbers.where[0], view(state, "proof")
    if where >= 0 and numbers.beside[0] == 0 and not is_fresh(own):
        # its first segment is another part of the motion that q is on
        first = 1
        for j in range(own.q.shape[0]):
            proof.begin[0, j] = proof.begin[where, j]
            proof.end[0, j] = proof.end[where, j]
    certify_whole(way, first, proof)


@njit(cache=True, nogil=True)
def step(state, points, q, always, margin, budget, looks):
    """Answer one frame whose points were taken; see the codes above.

    The answer's path is the group `way`; numbers.segment is its segment that q is on.
    """
    code = judge(state, points, q, always)
    if code != LOOK:
        return code
    code = look(state, points, margin, budget, looks)
    if code == PLANNED:
        adopt(state)
    return code
