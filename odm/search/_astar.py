"""Lazy A* over the masks: an edge is tested when it is about to be used, once a frame.

The open list holds unverified entries: several for one vertex, one for each motion
into it. An entry is verified when it comes out first; so the first verified entry of a
vertex is its shortest free path, as in lazy A* (Cohen, Phillips, Likhachev 2014).
Where a search heeds where obstacles have lately been, an entry whose motion enters such
cells pays a toll when it comes out, and waits anew; so the first that is paid and free
is the shortest, tolls included, in one search.
In a large map a long search is content with a path that is not much longer.
From the goal's side a flood runs along once the search takes longer than usual: a
goal (or a start) that is walled in is known when the smaller side is exhausted. The
cost to go knows nothing of what blocks a goal: where the cells block all motions into
it, `search_to` searches from its side, too, where the way out is short.
"""

import math

import numpy as np
from numba import njit

from odm.search._bound import (
    GOAL_SIDE,
    OVER,
    START_SIDE,
    begin_flood,
    flood_step,
    free_bound,
    meets_start,
    note_edge,
    recent_bound,
    remember_path,
)
from odm.search._invalidation import refresh, tests_worth_refreshing
from odm.search._items import BLOCKED, FREE, MAYBE, goal_motion_free, is_hit, item_free
from odm.search._judge import can_enter, goal_motion_clear, start_clear
from odm.search._paths import apart2
from odm.search._recent import TOLL, TOLLED, item_in_avoided, ref_in_avoided
from odm.search._state import EDGE_BASE, view
from roadmap.compiling._rows import same_row
from roadmap.compiling.jit_options import INNER

BOUND_BY_LAST_AFTER = 8  # vertices closed before the last path is tried as a bound,
BOUND_BY_ALL_AFTER = 12  # and all earlier paths, where that one is blocked
FLOODS = 32  # nodes that it takes for each that the search closes, all items settled
FLOOD_AFTER = 96  # vertices closed before the flood from the goal starts
# vertices that a search to a goal that the cells block closes, by turns: from the goal,
# from the robot, and from the goal again, content with a path that is not much longer:
# what is left counts GREED times its straight length, and more after every so many
GLANCE, FROM_ROBOT, FROM_GOAL, GREEDIER_EVERY = 4, 160, 384, 128
LONG_GLANCE = 32  # where the cost to go knows nothing of what leads into the goal
ALL = 1 << 40  # vertices: no limit
# in maps of more items than LARGE, a search that has closed so many vertices counts
# what is left GREED times: its path is so much longer than the shortest, at most
GREEDY_AFTER, LARGE, GREED = 100, 200_000, 1.5
HOPELESS = -1  # verdict of an entry: nothing else is left to be found
NOT_BEGUN = -1  # instead of the tail of the flood's queue
NONE, UNDECIDED = -1, -2  # instead of an entry: no path; none yet, and it may go on


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
    """Order the open list anew: what is left of each path counts GREED times more."""
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
def flood(state, starts, low, high):
    """Let the flood go on a little; True where it proves that no path is left."""
    search, counted = view(state, "search"), view(state, "stats").counted[0] != 0
    if search.tail[0] == NOT_BEGUN:
        begin_flood(state, low, high)
    for _ in range(FLOODS if counted else 2):
        if search.tail[0] == OVER:
            return False
        if search.head[0] < search.tail[0]:
            flood_step(state)
            continue
        search.tail[0] = OVER
        return not meets_start(state, starts, low, high)
    return False


@njit(**INNER)
def a_star(state, starts, only, most):
    """Search from the robot by its start motions to goal `only` (-1: any, with costs).

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
    search.tail[0], search.hasty[0] = NOT_BEGUN, 0
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
        if popped >= FLOOD_AFTER and bound == math.inf and search.tail[0] != OVER:
            if popped == FLOOD_AFTER:
                many //= 2  # a long search, and the flood, will look at many more
            if flood(state, starts, low, high):
                numbers.exhausted[0] = GOAL_SIDE
                break
        if popped == most:
            stats.popped[0] += popped
            return UNDECIDED
    stats.popped[0] += popped
    return NONE


@njit(**INNER)
def straight_to_robot(state, v, known):
    """Return the weighted length of the straight motion from node v to the robot.

    `known`: the robot is where it was attached last.
    """
    robot = view(state, "robot_state")
    if known:
        return robot.from_attached[v]
    return math.sqrt(apart2(view(state, "graph").nodes[v], robot.q, robot))


@njit(**INNER)
def add_ends(state, g, weight, known):
    """Begin the open list with the motions into goal g, what is left `weight` times.

    `known` as of `straight_to_robot`.
    """
    search, goals = view(state, "search"), view(state, "goals")
    maybe = 4 * view(state, "numbers").frame[0] + MAYBE
    search.made[0] = search.waiting[0] = 0
    for a in range(goals.number[g]):
        if goal_motion_free(state, g, a) or goals.memo[g, a] == maybe:
            v, length = np.int64(goals.node[g, a]), goals.length[g, a]
            f = length + weight * straight_to_robot(state, v, known)
            add_entry(search, v, -2 - a, -1, length, f)


@njit(**INNER)
def verify_back(state, starts, g, entry):
    """Return True where the motion of an entry from the goal's side is free."""
    search, goals = view(state, "search"), view(state, "goals")
    frame = view(state, "numbers").frame[0]
    n = view(state, "graph").adj_ptr.shape[0] - 1
    v, ref = search.e_node[entry], search.e_ref[entry]
    if v == n:
        k = -2 - ref
        if starts.memo[k] == 4 * frame + MAYBE:
            return start_clear(state, starts, k)
        return starts.memo[k] == 4 * frame + FREE
    if not item_free(state, np.int64(v)):
        return False
    if ref <= EDGE_BASE:
        return item_free(state, n + EDGE_BASE - ref)
    a = -2 - ref
    if goal_motion_free(state, g, a):
        return True
    return goals.memo[g, a] == 4 * frame + MAYBE and goal_motion_clear(state, g, a)


@njit(**INNER)
def toll_back(state, starts, g, entry):
    """Return what an entry's motion counts more for wary cells; see `toll`."""
    search = view(state, "search")
    n = view(state, "graph").adj_ptr.shape[0] - 1
    v, ref, parent = search.e_node[entry], search.e_ref[entry], search.e_from[entry]
    if parent < 0:
        wary = ref_in_avoided(state, view(state, "goals").ref[g, -2 - ref])
        return TOLL * search.e_g[entry] if wary else 0.0
    wary = item_in_avoided(state, np.int64(search.e_node[parent]))
    item = starts.ref[-2 - ref] if v == n else np.int64(ref)
    wary = wary or ref_in_avoided(state, item)
    return TOLL * (search.e_g[entry] - search.e_g[parent]) if wary else 0.0


@njit(**INNER)
def expand_back(state, starts, entry, weight, known):
    """Add the edges that lead to a vertex, and the robot's motions to it.

    False where there is no room for them. `known` as of `straight_to_robot`.
    """
    graph, search = view(state, "graph"), view(state, "search")
    frame, run = view(state, "numbers").frame[0], view(state, "numbers").run[0]
    n = graph.adj_ptr.shape[0] - 1
    v, g_v = search.e_node[entry], search.e_g[entry]
    begin, end = graph.adj_ptr[v], graph.adj_ptr[v + 1]
    if search.made[0] + end - begin + starts.count[0] > search.e_node.shape[0]:
        return False
    for k in range(starts.count[0]):
        verdict = starts.memo[k] - 4 * frame
        if starts.node[k] == v and (verdict == FREE or verdict == MAYBE):
            length = g_v + starts.length[k]
            add_entry(search, n, -2 - k, entry, length, length)
    for k in range(begin, end):
        w = np.int64(graph.adj_node[k])
        if search.flood[w] == run or search.memo[w] == 2 * frame + 1:
            continue
        length = g_v + graph.adj_length[k]
        f = length + weight * straight_to_robot(state, w, known)
        add_entry(search, w, EDGE_BASE - graph.adj_edge[k], entry, length, f)
    return True


@njit(**INNER)
def turn_round(state, entry, g):
    """Return the heap entry of goal g for a path that was found from its side.

    `entry` is the last one, at the robot. UNDECIDED where there is no room.
    """
    search, n = view(state, "search"), view(state, "graph").adj_ptr.shape[0] - 1
    e, before, length = np.int64(entry), np.int64(-1), 0.0
    while e >= 0:
        ref, parent = search.e_ref[e], np.int64(search.e_from[e])
        length += search.e_g[e]
        if parent >= 0:
            length -= search.e_g[parent]
        v = search.e_node[parent] if parent >= 0 else n + g
        if search.made[0] == search.e_node.shape[0]:
            return UNDECIDED
        add_entry(search, v, ref, before, length, math.inf)
        e, before = parent, search.made[0] - 1
    return before


@njit(**INNER)
def from_goal(state, starts, g, most, weight):
    """Search from goal g to the robot; as `a_star` returns, after `most` vertices.

    What is left of a path counts `weight` times its straight length. Above 1 the path
    need not be the shortest, and the longer it takes the less so. A search that would
    settle all items is left to the other side.
    """
    numbers, stats = view(state, "numbers"), view(state, "stats")
    search = view(state, "search")
    numbers.run[0] += 1
    stats.runs[0] += 1
    n, run = view(state, "graph").adj_ptr.shape[0] - 1, numbers.run[0]
    robot = view(state, "robot_state")
    known = same_row(robot.q, robot.q_attached)
    add_ends(state, g, weight, known)
    opens, popped, many = search.waiting[0] > 0, 0, tests_worth_refreshing(state)
    search.hasty[0] = 1  # `done` knows nothing of it
    while search.waiting[0] > 0:
        late = stats.counted[0] == 0 and stats.edge_tests[0] > many
        if popped == most or late:
            return UNDECIDED
        f, entry = search.heap_f[0], pop(search, search.waiting[0])
        search.waiting[0] -= 1
        v = search.e_node[entry]
        if v < n and search.flood[v] == run:
            continue
        if not verify_back(state, starts, g, entry):
            continue
        if numbers.avoid_history[0] == 1 and search.e_paid[entry] == 0:
            search.e_paid[entry] = 1
            more = toll_back(state, starts, g, entry)
            if more > 0.0:
                search.e_g[entry] += more
                push(search, search.waiting[0], f + more, entry)
                search.waiting[0] += 1
                continue
        if v == n:
            numbers.exhausted[0] = 0
            goal = turn_round(state, entry, g)
            if goal >= 0:
                remember_path(state, goal, g)
            return goal
        search.flood[v] = run
        popped += 1
        stats.flooded[0] += 1
        if weight > 1.0 and popped % GREEDIER_EVERY == 0:
            grow_greedy(search)
            weight *= GREED
        if not expand_back(state, starts, entry, weight, known):
            return UNDECIDED
    numbers.exhausted[0] = GOAL_SIDE if opens else 0
    return NONE


@njit(**INNER)
def search_to(state, starts, g, shut):
    """Search to goal g; as `a_star` returns. `shut`: cells block all motions into it.

    Then from both ends by turns. Verdicts are remembered within a frame: to begin anew
    takes little.
    """
    entry = UNDECIDED
    if shut:
        goals = view(state, "goals")
        # the costs to go may know nothing yet of the motion that was joined last
        a = goals.number[g] - 1
        knows = goals.h[g, goals.node[g, a]] <= goals.length[g, a]
        glance = GLANCE if knows else LONG_GLANCE
        entry = from_goal(state, starts, g, glance, 1.0)
        if entry == UNDECIDED and knows:
            entry = a_star(state, starts, g, FROM_ROBOT)
        if entry == UNDECIDED:
            entry = from_goal(state, starts, g, FROM_GOAL, GREED)
    if entry == UNDECIDED:
        entry = a_star(state, starts, g, ALL)
    return entry
