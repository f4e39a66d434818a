"""Lazy A* over the masks: an edge is tested when it is about to be used, once a frame.

The open list holds unverified entries: several for one vertex, one for each motion
into it. An entry is verified when it comes out first; so the first verified entry of a
vertex is its shortest free path, as in lazy A* (Cohen, Phillips, Likhachev 2014).
Where a search heeds where obstacles have lately been, an entry whose motion enters such
cells pays a toll when it comes out, and waits anew; so the first that is paid and free
is the shortest, tolls included, in one search.
In a large map a long search is content with a path that is not much longer.
From the goal's side a flood runs along once the search takes longer than usual: a
goal (or a start) that is walled in is known when the smaller side is exhausted. To a
goal that the cells block, which the cost to go knows nothing of, a long search takes
the path over where both sides met.
"""

import math

import numpy as np
from numba import njit

from odm.search._bound import (
    GOAL_SIDE,
    START_SIDE,
    free_bound,
    recent_bound,
    remember_path,
)
from odm.search._invalidation import refresh, tests_worth_refreshing
from odm.search._items import BLOCKED, FREE, MAYBE, goal_motion_free, is_hit, item_free
from odm.search._judge import can_enter, goal_motion_clear, start_clear
from odm.search._recent import TOLL, TOLLED, item_in_avoided, ref_in_avoided
from odm.search._state import EDGE_BASE, view
from roadmap.compiling.jit_options import INNER

BOUND_BY_LAST_AFTER = 8  # vertices closed before the last path is tried as a bound,
BOUND_BY_ALL_AFTER = 12  # and all earlier paths, where that one is blocked
FLOOD_AFTER = 96  # vertices closed before the flood from the goal starts
GLANCE_AFTER = 4  # and before it takes a first look, where cells block the goal
MET_AFTER = 256  # ... and before a path to it, over where both sides met, is taken
# in maps of more items than LARGE, a search that has closed so many vertices counts
# what is left GREED times: its path is so much longer than the shortest, at most
GREEDY_AFTER, LARGE, GREED = 100, 200_000, 1.5
HOPELESS = -1  # verdict of an entry: nothing else is left to be found
NOT_BEGUN, OVER = -1, -2  # instead of the tail of the flood's queue


@njit(**INNER)
def push(search, size, f, entry):
    """Add an entry to the heap of `size`; smaller f first, then older entries."""
    k = size
    while k > 0:
        up = (k - 1) >> 1
        if search.heap_f[up] <= f:
            break
        search.heap_f[k] = search.heap_f[up]
        search.heap_e[k] = search.heap_e[up]
        k = up
    search.heap_f[k] = f
    search.heap_e[k] = entry


@njit(**INNER)
def pop(search, size):
    """Take the first entry off the heap of `size`."""
    first = search.heap_e[0]
    size -= 1
    f, e = search.heap_f[size], search.heap_e[size]
    k = 0
    while True:
        low = 2 * k + 1
        if low >= size:
            break
        other = low + 1
        if other < size:
            fl, fo = search.heap_f[low], search.heap_f[other]
            if fo < fl or (fo == fl and search.heap_e[other] < search.heap_e[low]):
                low = other
        fl = search.heap_f[low]
        if f < fl or (f == fl and e < search.heap_e[low]):
            break
        search.heap_f[k] = fl
        search.heap_e[k] = search.heap_e[low]
        k = low
    search.heap_f[k] = f
    search.heap_e[k] = e
    return first


@njit(**INNER)
def add_entry(search, node, ref, parent, g, f):
    """Put a motion on the open list: over `ref` from entry `parent` to `node`."""
    entry = search.made[0]
    search.e_node[entry] = node
    search.e_ref[entry] = ref
    search.e_from[entry] = parent
    search.e_g[entry] = g
    search.e_paid[entry] = 0
    push(search, search.waiting[0], f, entry)
    search.made[0] = entry + 1
    search.waiting[0] += 1


@njit(**INNER)
def grow_greedy(search):
    """Order the open list anew, with what is left of each path counted GREED times."""
    for i in range(search.waiting[0]):
        f, entry = search.heap_f[i], search.heap_e[i]
        g = search.e_g[entry]
        push(search, i, g + GREED * (f - g), entry)


@njit(**INNER)
def add_starts(state, starts, h, low, high):
    """Begin the open list with the start motions, and those straight to a goal."""
    search, goals = view(state, "search"), view(state, "goals")
    frame = view(state, "numbers").frame[0]
    n = view(state, "graph").adj_ptr.shape[0] - 1
    search.made[0] = search.waiting[0] = 0
    for k in range(starts.count[0]):
        if starts.memo[k] == 4 * frame + FREE or starts.memo[k] == 4 * frame + MAYBE:
            v, length = starts.node[k], starts.length[k]
            add_entry(search, v, -2 - k, -1, length, length + h[v])
    for g in range(low, high):
        if goals.direct_memo[g] == 4 * frame + FREE:
            length = goals.direct_length[g] + goals.cost[g]
            add_entry(search, n + g, -2, -1, length, length)


@njit(**INNER)
def verify(state, starts, entry, only):
    """Return FREE where the motion of an entry and its vertex are; BLOCKED, HOPELESS.

    The node is asked first: its verdict settles all the entries that lead into it.
    """
    search, goals = view(state, "search"), view(state, "goals")
    frame = view(state, "numbers").frame[0]
    n = view(state, "graph").adj_ptr.shape[0] - 1
    v, ref = search.e_node[entry], search.e_ref[entry]
    if v < n and not item_free(state, v):
        search.done[v], search.g[v] = view(state, "numbers").run[0], math.inf
        return BLOCKED
    if v >= n:
        g, a = v - n, -2 - ref
        if search.e_from[entry] < 0 or goals.memo[g, a] != 4 * frame + MAYBE:
            return FREE
        if goal_motion_clear(state, g, a):
            return FREE
        return BLOCKED if can_enter(state, g) or only < 0 else HOPELESS
    if ref <= EDGE_BASE:
        return FREE if item_free(state, n + EDGE_BASE - ref) else BLOCKED
    k = -2 - ref
    if starts.memo[k] == 4 * frame + MAYBE:
        start_clear(state, starts, k)
    return FREE if starts.memo[k] == 4 * frame + FREE else BLOCKED


@njit(**INNER)
def toll(state, starts, entry):
    """Return what an entry's motion counts more for the wary cells that it enters."""
    search, goals = view(state, "search"), view(state, "goals")
    n = view(state, "graph").adj_ptr.shape[0] - 1
    v, ref, parent = search.e_node[entry], search.e_ref[entry], search.e_from[entry]
    before = search.e_g[parent] if parent >= 0 else 0.0
    if v >= n:
        g = v - n
        before += goals.cost[g]
        item = goals.direct_ref[g] if parent < 0 else goals.ref[g, -2 - ref]
        wary = ref_in_avoided(state, item)
    elif ref <= EDGE_BASE:
        wary = item_in_avoided(state, np.int64(v))
        wary = wary or item_in_avoided(state, np.int64(n + EDGE_BASE - ref))
    else:
        wary = item_in_avoided(state, np.int64(v))
        wary = wary or ref_in_avoided(state, starts.ref[-2 - ref])
    return TOLL * (search.e_g[entry] - before) if wary else 0.0


@njit(**INNER)
def enter_goals(state, entry, low, high, bound):
    """Add the motions from a vertex into goals low to high - 1."""
    search, goals = view(state, "search"), view(state, "goals")
    maybe = 4 * view(state, "numbers").frame[0] + MAYBE
    n = view(state, "graph").adj_ptr.shape[0] - 1
    for g in range(low, high):
        a = goals.at[g, search.e_node[entry]]
        if a < 0 or search.made[0] >= search.e_node.shape[0]:
            continue
        length = search.e_g[entry] + goals.length[g, a] + goals.cost[g]
        if length > bound:
            continue
        if goal_motion_free(state, g, a) or goals.memo[g, a] == maybe:
            add_entry(search, n + g, -2 - a, entry, length, length)


@njit(**INNER)
def note_edge(state, w, item):
    """Note what is hit where an edge to node w, or its list, is: once a frame."""
    if item_free(state, w):
        item_free(state, item)


@njit(**INNER)
def expand(state, entry, h, bound, greed):
    """Add the edges that leave a vertex; False where there is no room for them.

    What is left of a path beyond them is counted `greed` times.
    """
    graph, search = view(state, "graph"), view(state, "search")
    frame, run = view(state, "numbers").frame[0], view(state, "numbers").run[0]
    counted = view(state, "stats").counted[0] != 0
    avoid_history = view(state, "numbers").avoid_history[0] == 1
    n = graph.adj_ptr.shape[0] - 1
    v, g_v = search.e_node[entry], search.e_g[entry]
    begin, end = graph.adj_ptr[v], graph.adj_ptr[v + 1]
    if search.made[0] + end - begin > search.e_node.shape[0]:
        return False
    for k in range(begin, end):
        w = graph.adj_node[k]
        if search.done[w] == run:
            continue
        if counted:
            # an edge's count has its end nodes in it
            item = n + graph.adj_edge[k]
            if is_hit(graph, item) or graph.closed[item]:
                note_edge(state, np.int64(w), item)
                continue
        elif search.memo[w] == 2 * frame + 1:
            continue
        hw = h[w]
        if hw == math.inf:
            continue
        length = g_v + graph.adj_length[k]
        if length + hw > bound:
            continue
        edge = n + graph.adj_edge[k]
        if (
            counted
            and avoid_history
            and (item_in_avoided(state, np.int64(w)) or item_in_avoided(state, edge))
        ):
            length += TOLL * graph.adj_length[k]
        if counted:
            # all that is left can be used: only a shorter path to w is of interest
            if search.near_run[w] == run and search.near_g[w] <= length:
                continue
            search.near_run[w] = run
            search.near_g[w] = length
        ref = EDGE_BASE - graph.adj_edge[k]
        add_entry(search, w, ref, entry, length, length + greed * hw)
        search.e_paid[search.made[0] - 1] = counted
    return True


@njit(**INNER)
def begin_flood(state, low, high):
    """Queue the nodes next to goals low to high - 1, where the flood begins."""
    search, goals = view(state, "search"), view(state, "goals")
    numbers = view(state, "numbers")
    maybe, run = 4 * numbers.frame[0] + MAYBE, numbers.run[0]
    search.head[0] = search.tail[0] = 0
    for g in range(low, high):
        for a in range(goals.number[g]):
            w = goals.node[g, a]
            if search.flood[w] == run:
                continue
            if not goal_motion_free(state, g, a) and goals.memo[g, a] != maybe:
                continue
            if item_free(state, w) and reach(state, w, -1):
                return


@njit(**INNER)
def reach(state, w, edge):
    """Let the flood reach a free node over a free edge; True where the search was."""
    search, run = view(state, "search"), view(state, "numbers").run[0]
    search.flood[w], search.flood_edge[w] = run, edge
    if search.done[w] == run:
        search.met[0], search.tail[0] = w, OVER
        return True
    search.queue[search.tail[0]] = w
    search.tail[0] += 1
    return False


@njit(**INNER)
def flood_step(state):
    """Take one node off the goal side's queue; over where it meets the search."""
    graph, search = view(state, "graph"), view(state, "search")
    run, stats = view(state, "numbers").run[0], view(state, "stats")
    n = graph.adj_ptr.shape[0] - 1
    u = search.queue[search.head[0]]
    search.head[0] += 1
    stats.flooded[0] += 1
    for k in range(graph.adj_ptr[u], graph.adj_ptr[u + 1]):
        w, item = graph.adj_node[k], n + graph.adj_edge[k]
        if search.flood[w] == run:
            continue
        if stats.counted[0] != 0:
            if is_hit(graph, item) or graph.closed[item]:
                note_edge(state, np.int64(w), item)
                continue
        elif not item_free(state, w) or not item_free(state, item):
            continue
        if reach(state, np.int64(w), graph.adj_edge[k]):
            return


@njit(**INNER)
def take_met(state, g):
    """Return the heap entry of goal g by way of where both sides met, or -1.

    What the search closed and the flood reached is free; so is all of that path, if
    the motion into the goal is.
    """
    search, goals = view(state, "search"), view(state, "goals")
    graph = view(state, "graph")
    v, n = search.met[0], graph.adj_ptr.shape[0] - 1
    search.met[0] = -1
    entry = np.int64(search.entry[v])
    while search.flood_edge[v] >= 0:
        k = graph.adj_ptr[v]
        while graph.adj_edge[k] != search.flood_edge[v]:
            k += 1
        if search.made[0] + 2 > search.e_node.shape[0]:
            return -1
        v, ref = np.int64(graph.adj_node[k]), EDGE_BASE - graph.adj_edge[k]
        length = search.e_g[entry] + graph.adj_length[k]
        add_entry(search, v, ref, entry, length, math.inf)
        entry = search.made[0] - 1
    a = goals.at[g, v]
    if not goal_motion_free(state, g, a) and not goal_motion_clear(state, g, a):
        return -1
    length = search.e_g[entry] + goals.length[g, a] + goals.cost[g]
    add_entry(search, n + g, -2 - a, entry, length, math.inf)
    return search.made[0] - 1


@njit(**INNER)
def flood(state, starts, low, high):
    """Let the flood go on a little; True where it proves that no path is left.

    Where the goal's side is exhausted, that is so unless a start lies in it.
    """
    search, goals = view(state, "search"), view(state, "goals")
    frame, run = view(state, "numbers").frame[0], view(state, "numbers").run[0]
    if search.tail[0] == NOT_BEGUN:
        begin_flood(state, low, high)
    for _ in range(8 if view(state, "stats").counted[0] != 0 else 2):
        if search.tail[0] == OVER:
            return False
        if search.head[0] < search.tail[0]:
            flood_step(state)
            continue
        search.tail[0] = OVER
        for k in range(starts.count[0]):
            verdict = starts.memo[k] - 4 * frame
            if verdict == FREE or verdict == MAYBE:
                if search.flood[starts.node[k]] == run:
                    return False
        for g in range(low, high):
            if goals.direct_memo[g] == 4 * frame + FREE:
                return False
        return True
    return False


@njit(**INNER)
def a_star(state, starts, only, shut):
    """Search from the robot by its start motions to goal `only` (-1: any, with costs).

    `shut`: cells block all motions into it, so that its side may be a small one.
    starts.memo holds the frame's verdict of each start motion: free, or maybe, then
    the close test is asked when the motion comes out first; others are left out. So it
    is with the motions into a goal. Returns the heap entry of the goal, or -1.
    """
    numbers, stats = view(state, "numbers"), view(state, "stats")
    goals, search = view(state, "goals"), view(state, "search")
    numbers.run[0] += 1
    numbers.exhausted[0] = START_SIDE
    stats.runs[0] += 1
    run = numbers.run[0]
    n = view(state, "graph").adj_ptr.shape[0] - 1
    h = view(state, "robot_state").h_any if only < 0 else goals.h[only]
    low, high = (0, goals.count[0]) if only < 0 else (only, only + 1)
    avoid_history = numbers.avoid_history[0] != 0
    numbers.avoid_history[0] = 1 if avoid_history else 0
    add_starts(state, starts, h, low, high)
    search.tail[0], search.met[0], search.hasty[0] = NOT_BEGUN, -1, 0
    many = tests_worth_refreshing(state)
    bound = math.inf  # no longer path is of interest
    popped, greed, large = 0, 1.0, view(state, "rules").large[0]
    while search.waiting[0] > 0:
        if stats.edge_tests[0] > many and stats.counted[0] == 0:
            refresh(state)  # a long search pays for settling all items at once
            stats.counted[0] = 1
        f = search.heap_f[0]
        entry = pop(search, search.waiting[0])
        search.waiting[0] -= 1
        v = search.e_node[entry]
        if search.done[v] == run:
            continue
        verdict = verify(state, starts, entry, only)
        if verdict == HOPELESS:
            numbers.exhausted[0] = 0
            break
        if verdict != FREE:
            continue
        if avoid_history and search.e_paid[entry] == 0:
            search.e_paid[entry] = 1
            more = toll(state, starts, entry)
            if more > 0.0:
                search.e_g[entry] += more
                push(search, search.waiting[0], f + more, entry)
                search.waiting[0] += 1
                continue
        search.done[v] = run
        if v < n:
            search.g[v], search.entry[v] = search.e_g[entry], entry
        popped += 1
        if avoid_history and popped == TOLLED:
            avoid_history = False
            numbers.avoid_history[0] = 2
        if v >= n:
            numbers.exhausted[0] = 0
            stats.popped[0] += popped
            if popped > BOUND_BY_LAST_AFTER and only >= 0:
                remember_path(state, entry, only)
            return entry
        if popped == BOUND_BY_LAST_AFTER and only >= 0:
            bound = recent_bound(state, starts, only)
        elif popped == BOUND_BY_ALL_AFTER and only >= 0 and bound == math.inf:
            bound = free_bound(state, starts, only)
        enter_goals(state, entry, low, high, bound)
        if popped == GREEDY_AFTER and search.memo.shape[0] > large:
            grow_greedy(search)
            greed, search.hasty[0] = GREED, 1
        if not expand(state, entry, h, bound, greed):
            numbers.exhausted[0] = 0
            break
        floods = popped >= FLOOD_AFTER or (shut and popped == GLANCE_AFTER)
        if floods and bound == math.inf and search.tail[0] != OVER:
            if flood(state, starts, low, high):
                numbers.exhausted[0] = GOAL_SIDE
                break
        if shut and popped >= MET_AFTER and search.met[0] >= 0:
            met = take_met(state, only)
            if met >= 0:
                numbers.exhausted[0], search.hasty[0] = 0, 1
                stats.popped[0] += popped
                remember_path(state, met, only)
                return met
    stats.popped[0] += popped
    return -1
