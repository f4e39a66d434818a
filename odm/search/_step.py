"""The frame's decision: go on, take a new way, or hold.

`respond` is the one call of a frame whose points were taken. It tests the candidate
that waits, else the way in use, and searches only where neither is free. A hand that
trembles comes and goes over the same place, so a search heeds where the obstacles have
lately been (`_recent.py`). That only ranks ways: what is free, and what blocks the way
in use, is decided by the frame's own points alone.
"""

import math

from numba import njit

from odm.close_test._close import displacement
from odm.search._frame import plan
from odm.search._judge import rest_free, stands_free
from odm.search._paths import (
    certify_whole,
    copy_proof,
    copy_way,
    is_on,
    locate_on_way,
    turns_back,
    way_length,
)
from odm.search._recent import lay_out_recent, remember, way_bare, way_wary
from odm.search._state import (
    BARE_WAY,
    BETTER_WAY,
    EDITED,
    NO_ITEM,
    NO_WAY,
    TO_BEGIN,
    TO_END,
    view,
)

FOLLOWING, PLANNED, NO_PATH, NOT_ATTACHED = 0, 1, 2, 3
NOT_FINITE, OUT_OF_LIMITS = 4, 5
LOOK, BESIDE, BETTER = 6, 7, 8
HAS_NO_PATH = (NO_PATH, NOT_ATTACHED)  # the roadmap has none; there may be one
LIMIT_TOLERANCE = 1e-3  # [rad or m] a start this far outside its limits is tolerated
WORTH_A_LOOK = 1.1  # times the straight distance
BETTER_EVERY = 8  # frames between two looks for a better goal
# an answer is code + SEGMENT * segment + COUNT * corners + GOAL * (goal + 1)
SEGMENT, COUNT, GOAL = 16, 1 << 16, 1 << 28


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
def note_move(state, q):
    """Note that a frame asks from q: whether the robot moved since the one before."""
    own, numbers = view(state, "own"), view(state, "numbers")
    stood = True
    for j in range(q.shape[0]):
        own.before[j] = own.q[j]
        stood = stood and own.q[j] == q[j]
    numbers.stood[0] = numbers.stood[0] + 1 if stood else 0


@njit(cache=True, nogil=True)
def judge(state, points, q):
    """Judge the way in use: FOLLOWING, a trouble's code, or LOOK for a new way.

    With LOOK numbers.where is the segment that q is on, -1 for none. With BESIDE it is
    not on that segment but beside it, and the group Beside is to be filled first: for
    the candidate if one waits, else for the way in use.
    """
    own, numbers, way = view(state, "own"), view(state, "numbers"), view(state, "way")
    trouble = take_configuration(state, q)
    if trouble != FOLLOWING:
        return trouble
    q = own.q
    always = view(state, "rules").always[0] == 1
    if numbers.candidate[0] != 0 and not always:
        kind = numbers.candidate[0]
        if take_candidate(state, points, q):
            return FOLLOWING if kind == EDITED else PLANNED
        if numbers.candidate[0] != 0:
            return BESIDE
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
    return FOLLOWING


@njit(cache=True, nogil=True)
def drop_candidate(state):
    """Forget the candidate: no item is kept for it."""
    view(state, "numbers").candidate[0] = 0
    view(state, "better").count[0] = 0


@njit(cache=True, nogil=True)
def take_candidate(state, points, q):
    """Let the candidate be the way in use where q is on it and it is free; True if so.

    It has one chance. Only where q is beside its segment numbers.where it still waits:
    the group Beside is to be filled for that first.
    """
    numbers, own, better = (
        view(state, "numbers"),
        view(state, "own"),
        view(state, "better"),
    )
    proof, kind = view(state, "better_proof"), numbers.candidate[0]
    numbers.candidate[0] = 0
    where = -1
    if better.count[0] >= 2 and better.count[1] >= 0:
        where = locate_on_way(state, better, 0, q, own.out)
    if where < 0 or turns_back(better, where, q, own.continuous):
        drop_candidate(state)
        return False
    numbers.beside[0] = 0
    if not is_on(proof, where, q):
        numbers.beside[0] = 1
        if not is_known_beside(view(state, "beside"), better, where, q):
            numbers.candidate[0], numbers.where[0] = kind, where
            return False
    if rest_free(state, points, better, where, q) >= 0:
        drop_candidate(state)
        return False
    copy_way(better, view(state, "way"))
    copy_proof(proof, view(state, "proof"), better.count[0] - 1)
    drop_candidate(state)
    numbers.where[0] = numbers.segment[0] = where
    numbers.rest[0] = 1
    numbers.same[0] = numbers.better[0] = 0
    if kind != EDITED:
        numbers.bare[0] = 1 if kind == BARE_WAY else 0
    return True


@njit(cache=True, nogil=True)
def better_goal_stands_clear(state, points):
    """Return True if a goal of better rank keeps its distance from the points."""
    goals = view(state, "goals")
    if view(state, "numbers").joint_costs[0] == 1:  # then none is better by its rank
        return False
    for g in range(view(state, "way").count[1]):
        if stands_free(state, points, goals.q[g]):
            return True
    return False


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
def search_way(state, points, last):
    """Search a way from own.q to goals 0 to last - 1; True: it is the group `spare`."""
    goals, own = view(state, "goals"), view(state, "own")
    numbers, way = view(state, "numbers"), view(state, "way")
    start_vertex = goals.count[1]
    starts = view(state, "fresh")
    if is_fresh(own):
        for g in range(goals.count[0]):
            goals.direct_ref[g] = goals.fresh_ref[g]
    else:
        starts = view(state, "along")
        along_way(state, way, numbers.where[0], own.q, starts)
        start_vertex = goals.count[2]
    for g in range(goals.count[0]):
        goals.direct_length[g] = weighted(own.q, goals.q[g], state)
    budget = 2 * view(state, "rules").close_tests[0]
    numbers.heed[0] = 1 if is_calm(state) else 0
    if numbers.heed[0] == 1:
        lay_out_recent(state)
    found = plan(state, points, starts, start_vertex, budget, last)
    numbers.heed[0] = 0
    return found


@njit(cache=True, nogil=True)
def is_calm(state):
    """Return True if new ways keep clear of where the obstacles have lately been."""
    rules = view(state, "rules")
    return rules.always[0] == 0 and rules.memory[0] > 0.0


@njit(cache=True, nogil=True)
def replan(state, points):
    """Take a new way after `judge` said LOOK: PLANNED or NO_PATH.

    Where the last way that was only just free was blocked, the next one must be there
    for `patience` frames in a row: what opens and closes as a hand trembles is not
    taken.
    """
    numbers, spare = view(state, "numbers"), view(state, "spare")
    found = search_way(state, points, view(state, "goals").count[0])
    if not is_calm(state):
        if found:
            adopt(state)
        return PLANNED if found else NO_PATH
    patience = view(state, "rules").patience[0]
    bare = not found or way_bare(state, spare)
    if bare and numbers.bare[0] == 1:
        numbers.bare[0], numbers.waits[0] = 0, patience
    if not found:
        numbers.waits[0] = patience if numbers.waits[0] > 0 else 0
        return NO_PATH
    if bare:
        numbers.waits[0] = max(0, numbers.waits[0] - 1)
        if numbers.waits[0] > 0:
            return NO_PATH
    else:
        numbers.waits[0] = 0
    numbers.bare[0] = 1 if bare else 0
    adopt(state)
    return PLANNED


@njit(cache=True, nogil=True)
def better_found(state, points, q):
    """Look for a better way than the free one in use; True: `spare` is to be taken.

    To a goal of better rank; or to the same, shorter by `margin` and clear of where the
    obstacles have lately been. `looks` in a row must find one. A goal beside a hand is
    near where that has lately been, always: a way to it may be only just free.
    """
    numbers, own, goals = (
        view(state, "numbers"),
        view(state, "own"),
        view(state, "goals"),
    )
    way, spare, rules = view(state, "way"), view(state, "spare"), view(state, "rules")
    rank, where = way.count[1], numbers.segment[0]
    if rank < 0 or way.count[0] < 2:
        return False
    found = search_way(state, points, rank + 1)
    joint = numbers.joint_costs[0] == 1
    if found and (joint or spare.count[1] == rank):
        now = rest_length(state, way, where, q)
        new = way_length(spare, own.weights)
        if joint:
            new += goals.cost[spare.count[1]] - goals.cost[rank]
        found = new <= (1.0 - rules.margin[0]) * now
        found = found and not (is_calm(state) and way_wary(state, spare))
    numbers.better[0] = numbers.better[0] + 1 if found else 0
    return numbers.better[0] >= rules.looks[0]


@njit(cache=True, nogil=True)
def offer_better(state, points):
    """Look for a better way between frames; True: it is the candidate.

    It begins with all of the segment that the robot is on, so the next frame may ask
    from any place on it.
    """
    numbers, own, goals = (
        view(state, "numbers"),
        view(state, "own"),
        view(state, "goals"),
    )
    if numbers.rest[0] == 0 or numbers.beside[0] == 1:
        return False
    way, spare, better = view(state, "way"), view(state, "spare"), view(state, "better")
    proof, where = view(state, "better_proof"), numbers.segment[0]
    if way.count[0] < 2:
        return False
    numbers.where[0] = where
    if way.count[1] == 0 or numbers.joint_costs[0] == 1:
        straight = weighted(own.q, way.q[way.count[0] - 1], state)
        if rest_length(state, way, where, own.q) <= WORTH_A_LOOK * straight:
            numbers.better[0] = 0
            return False
    if not better_found(state, points, own.q):
        return False
    numbers.better[0] = 0
    bare = is_calm(state) and way_bare(state, spare)
    copy_way(spare, better)
    first = 0
    if spare.vertex[0] == goals.count[2] and not is_fresh(own):
        # on its segment towards one end: begin at the other
        ends = view(state, "proof")
        towards = spare.vertex[1] == way.vertex[where + 1]
        other = where if towards else where + 1
        for j in range(own.q.shape[0]):
            better.q[0, j] = way.q[other, j]
            proof.begin[0, j] = ends.begin[where, j]
            proof.end[0, j] = ends.end[where, j]
        better.vertex[0] = way.vertex[other]
        first = 1
    certify_whole(better, first, proof)
    numbers.start[0] = 0
    numbers.candidate[0] = BARE_WAY if bare else BETTER_WAY
    return True


@njit(cache=True, nogil=True)
def take_better(state, points, q):
    """Look for a way to a better goal within the frame; PLANNED or FOLLOWING."""
    numbers, spare = view(state, "numbers"), view(state, "spare")
    if not better_found(state, points, q):
        return FOLLOWING
    numbers.bare[0] = 1 if is_calm(state) and way_bare(state, spare) else 0
    adopt(state)
    return PLANNED


@njit(cache=True, nogil=True)
def begin_candidate(state):
    """Let the candidate be the way in use, to be changed; one that waits stays."""
    numbers, way, better = (
        view(state, "numbers"),
        view(state, "way"),
        view(state, "better"),
    )
    if numbers.candidate[0] != 0:
        return
    copy_way(way, better)
    copy_proof(view(state, "proof"), view(state, "better_proof"), way.count[0] - 1)
    numbers.start[0] = numbers.segment[0]


@njit(cache=True, nogil=True)
def adopt(state):
    """Take the way that a search found; numbers.same tells that it is the old."""
    own, numbers = view(state, "own"), view(state, "numbers")
    way, spare = view(state, "way"), view(state, "spare")
    numbers.better[0] = 0
    drop_candidate(state)
    numbers.same[0] = 1 if same_rest(way, numbers.where[0], spare) else 0
    copy_way(spare, way)
    numbers.segment[0] = 0
    numbers.rest[0] = 1
    first, where, proof = 0, numbers.where[0], view(state, "proof")
    if where >= 0 and numbers.beside[0] == 0 and not is_fresh(own):
        # its first segment is another part of the motion that q is on
        first = 1
        for j in range(own.q.shape[0]):
            proof.begin[0, j] = proof.begin[where, j]
            proof.end[0, j] = proof.end[where, j]
    certify_whole(way, first, proof)
    numbers.beside[0] = 0


@njit(cache=True, nogil=True)
def packed(state, code):
    """Return a code with the numbers of the way in use: one number says all."""
    numbers, way = view(state, "numbers"), view(state, "way")
    said = code + SEGMENT * numbers.segment[0] + COUNT * way.count[0]
    return said + GOAL * (way.count[1] + 1)


@njit(cache=True, nogil=True)
def respond(state, points, q, now):
    """Answer one frame whose points were taken; a code, packed with the way's numbers.

    The answer's path is the group `way`; numbers.segment is its segment that q is on.
    Asked again in the same frame, after q was joined to something, it goes on.
    `now` [s] is NaN where no time is given.
    """
    numbers, way = view(state, "numbers"), view(state, "way")
    if numbers.seen[0] != numbers.step[0]:
        numbers.seen[0] = numbers.step[0]
        note_move(state, q)
        if is_calm(state):
            remember(state, now)
    code = judge(state, points, q)
    if code == LOOK:
        code = replan(state, points)
    elif code == FOLLOWING and way.count[1] > 0:
        if numbers.wish[0] == 1:
            code = take_better(state, points, q)
        elif numbers.step[0] % BETTER_EVERY == 0:
            if better_goal_stands_clear(state, points):
                code = BETTER
    numbers.wish[0] = 0
    return packed(state, code)
