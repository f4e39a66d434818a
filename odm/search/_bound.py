"""What earlier searches found and showed, for the next one.

Paths that earlier long searches found give an upper bound: where one of them is free in
this frame, no path longer than it is of interest: A* need not keep entries beyond it,
and returns what it would have returned anyway.

The last search gives more. Whatever is shorter than its path leads over something that
was blocked then, for it looked at all that is shorter. While all of that is blocked and
the path is free, it is still the shortest, without a search; what came free and cannot
shorten it by a thousandth is let be. In the same way there is no path yet where there
was none.
"""

import math

import numpy as np
from numba import njit

from odm.search._invalidation import refresh, tests_worth_refreshing
from odm.search._items import (
    BLOCKED,
    FREE,
    MAYBE,
    REFUSED,
    goal_motion_free,
    is_hit,
    item_free,
    item_free_now,
)
from odm.search._judge import goal_motion_clear, start_clear
from odm.search._paths import take_shortcuts, unwrap
from odm.search._recent import TOLL, item_in_avoided, ref_in_avoided
from odm.search._state import EDGE_BASE, IS_GOAL, view
from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import INNER

ROUNDING = 1.0 + 1e-9
# what holds of the last search: nothing that is known; its path is free and the
# shortest; there is no path
UNKNOWN, SHORTEST, NO_WAY = 0, 1, 2
NEARLY = 1.001  # times the length of the shortest path counts as short as that
BY_CELLS, BY_CLOSE_TEST = 1, 2  # by which a motion was blocked
N_ITEMS, N_NODES, RUN, SIDE, SOUGHT = 0, 1, 2, 3, 4  # of `Proof.count`
# of a search without a path: `done`, or `flood`, tells all that is reached from there;
# or there was none, since no motion leaves the start
START_SIDE, GOAL_SIDE, NO_EXIT_SIDE = 1, 2, 3
OVER = -2  # instead of the tail of the flood's queue: it met the search
MOST_SOUGHT = 100  # nodes that are looked at for what is shorter, beside a search


@njit(**INNER)
def path_bound(state, starts, r, g, best):
    """Return the length of earlier path r to goal g if free and below `best`, or that.

    A path counts from any vertex that the start is joined to. Tolls may be counted
    twice: a bound that is too large cuts off too little, nothing else.
    """
    earlier, goals = view(state, "earlier_paths"), view(state, "goals")
    if earlier.vertex[r] != goals.vertex[g]:
        return best
    n = view(state, "graph").adj_ptr.shape[0] - 1
    free = 4 * view(state, "numbers").frame[0] + FREE
    avoid_history = view(state, "numbers").avoid_history[0] == 1
    length = goals.cost[g]
    for i in range(earlier.count[r]):
        v, via = np.int64(earlier.node[r, i]), np.int64(earlier.via[r, i])
        length += earlier.length[r, i]
        if avoid_history:
            ref = goals.ref[g, via] if i == 0 else EDGE_BASE - via
            if item_in_avoided(state, v) or ref_in_avoided(state, ref):
                length += TOLL * earlier.length[r, i]
        if length >= best:
            break
        if i == 0:
            if not goal_motion_free(state, g, via):
                break
        elif not item_free(state, n + via):
            break
        if not item_free(state, v):
            break
        for k in range(starts.count[0]):
            if starts.node[k] == v and starts.memo[k] == free:
                first = starts.length[k]
                if avoid_history and (
                    item_in_avoided(state, v) or ref_in_avoided(state, starts.ref[k])
                ):
                    first += TOLL * first
                best = min(best, length + first)
    return best


@njit(**INNER)
def recent_bound(state, starts, g):
    """Return the length of the path found last if it leads to g and is free, or inf."""
    earlier = view(state, "earlier_paths")
    r = earlier.count[earlier.vertex.shape[0] + 1]
    return ROUNDING * path_bound(state, starts, r, g, math.inf)


@njit(**INNER)
def free_bound(state, starts, g):
    """Return the length of the shortest earlier path to g that is free, or inf."""
    best = math.inf
    for r in range(view(state, "earlier_paths").vertex.shape[0]):
        best = path_bound(state, starts, r, g, best)
    return best * ROUNDING


@njit(**INNER)
def remember_path(state, entry, g):
    """Keep the path that ends in heap entry `entry` at goal g."""
    earlier, search = view(state, "earlier_paths"), view(state, "search")
    goals = view(state, "goals")
    rows = earlier.vertex.shape[0]
    r = earlier.count[rows]
    via = -2 - search.e_ref[entry]
    e = search.e_from[entry]
    count = 0
    after = search.e_g[entry]
    earlier.vertex[r] = -1
    while e >= 0:
        if count >= earlier.node.shape[1]:
            return
        earlier.node[r, count] = search.e_node[e]
        earlier.via[r, count] = via
        earlier.length[r, count] = after - search.e_g[e]
        after = search.e_g[e]
        via = EDGE_BASE - search.e_ref[e]
        e = search.e_from[e]
        count += 1
    if count == 0:
        return
    earlier.length[r, 0] -= goals.cost[g]
    earlier.count[r] = count
    earlier.vertex[r] = goals.vertex[g]
    same = row_with(earlier, r)
    if same >= 0:
        earlier.vertex[r] = -1
        earlier.count[rows + 1] = same
    else:
        earlier.count[rows] = (r + 1) % rows
        earlier.count[rows + 1] = r


@njit(**INNER)
def row_with(earlier, r):
    """Return another row whose path ends with all of path r; -1: there is none."""
    count = earlier.count[r]
    for s in range(earlier.vertex.shape[0]):
        if s == r or earlier.vertex[s] != earlier.vertex[r] or earlier.count[s] < count:
            continue
        same = earlier.via[s, 0] == earlier.via[r, 0]
        for i in range(count):
            same = same and earlier.node[s, i] == earlier.node[r, i]
        if same:
            return s
    return -1


@njit(**INNER)
def forget_proof(state):
    """Let nothing be known of the last search."""
    view(state, "proof").of[0] = -1


@njit(**INNER)
def blocked_by(memo, frame):
    """Return by what a motion was found blocked in this frame; 0: it was not."""
    if memo == 4 * frame + BLOCKED:
        return BY_CELLS
    return BY_CLOSE_TEST if memo == 4 * frame + REFUSED else 0


@njit(**INNER)
def keep_hits(state):
    """Let the proof's items be those that were found hit in this frame; they fit."""
    proof, search = view(state, "proof"), view(state, "search")
    for i in range(search.hits[0]):
        proof.item[i] = search.hit[i]
    proof.count[N_ITEMS] = search.hits[0]


@njit(**INNER)
def keep_proof(state, starts, start_vertex, g, entry):
    """Keep what the last search showed, to goal g, whose heap entry is `entry`.

    -1: there is no path. Nothing is kept of a start that is on its way, or where more
    was blocked than there is room for.
    """
    proof, search = view(state, "proof"), view(state, "search")
    goals = view(state, "goals")
    numbers = view(state, "numbers")
    frame, items, count = numbers.frame[0], search.hits[0], 0
    proof.of[0] = -1
    if start_vertex != goals.count[1] or items > search.hit.shape[0]:
        return
    proof.length[0] = math.inf
    if entry >= 0:
        first = search.e_from[entry]
        e = first
        while e >= 0:
            e = search.e_from[e]
            count += 1
        if count == 0 or count + 2 > view(state, "found_path").vertex.shape[0]:
            return
        proof.length[0], proof.by[1] = search.e_g[entry], -2 - search.e_ref[entry]
        e = first
        for k in range(count - 1, -1, -1):
            proof.node[k] = search.e_node[e]
            if k > 0:
                proof.edge[k - 1] = EDGE_BASE - search.e_ref[e]
            else:
                proof.by[0] = -2 - search.e_ref[e]
            e = search.e_from[e]
    for k in range(starts.count[0]):
        proof.start_out[k] = blocked_by(starts.memo[k], frame)
    for a in range(goals.number[g]):
        proof.goal_out[a] = blocked_by(goals.memo[g, a], frame)
    keep_hits(state)
    proof.count[N_NODES] = count
    proof.count[RUN], proof.count[SIDE] = numbers.run[0], numbers.exhausted[0]
    if entry >= 0 and search.hasty[0] == 1:
        proof.count[RUN] = -1  # what it closed is no bound
    proof.of[0], proof.of[1] = start_vertex, goals.vertex[g]
    proof.of[2], proof.of[3] = starts.count[0], goals.number[g]


@njit(**INNER)
def start_open(state, starts, k, asks):
    """Return True if start motion k is free: by cells, or the close test if `asks`.

    That is asked in any case where the cells do not tell.
    """
    verdict = starts.memo[k] - 4 * view(state, "numbers").frame[0]
    if verdict == MAYBE or (verdict == BLOCKED and asks and starts.static[k] == 1):
        return start_clear(state, starts, k)
    return verdict == FREE


@njit(**INNER)
def entry_open(state, g, a, asks):
    """Return True if attachment a of goal g is free; see `start_open`."""
    goals = view(state, "goals")
    if goal_motion_free(state, g, a):
        return True
    verdict = goals.memo[g, a] - 4 * view(state, "numbers").frame[0]
    if verdict == MAYBE or (verdict == BLOCKED and asks):
        return goal_motion_clear(state, g, a)
    return False


@njit(**INNER)
def seek_from(state, v, length, h):
    """Queue node v, reached by `length`, if that may lead to what is shorter."""
    search, proof = view(state, "search"), view(state, "proof")
    if not NEARLY * (length + h[v]) < proof.length[0]:
        return
    if search.done[v] == proof.count[RUN] and search.g[v] <= length:
        return
    stamp = -proof.count[SOUGHT]
    if search.near_run[v] == stamp and search.near_g[v] <= length:
        return
    if search.made[0] < search.e_node.shape[0]:
        search.near_run[v], search.near_g[v] = stamp, length
        search.e_node[search.made[0]], search.e_g[search.made[0]] = v, length
    search.made[0] += 1


@njit(**INNER)
def seek_over(state, starts, item, h):
    """Queue the nodes that are reached over an item that has come free."""
    search, graph = view(state, "search"), view(state, "graph")
    proof, n = view(state, "proof"), graph.adj_ptr.shape[0] - 1
    run = proof.count[RUN]
    first, last = item, item
    if item >= n:
        first = np.int64(graph.edges[item - n, 0])
        last = np.int64(graph.edges[item - n, 1])
    for v in (first, last):
        if not item_free(state, v):
            continue
        best = math.inf
        for k in range(graph.adj_ptr[v], graph.adj_ptr[v + 1]):
            u = graph.adj_node[k]
            if search.done[u] == run and search.g[u] + graph.adj_length[k] < best:
                if item_free(state, n + graph.adj_edge[k]):
                    best = search.g[u] + graph.adj_length[k]
        for k in range(starts.count[0]):
            if starts.node[k] == v and proof.start_out[k] == 0:
                best = min(best, starts.length[k])
        seek_from(state, v, best, h)


@njit(**INNER)
def nothing_shorter(state, g, h, asks):
    """Return whether what has come free leads to no shorter path to goal g.

    From the nodes that are queued; only nodes count that the last search did not close,
    or by a longer path. False, too, where that cannot be told by a few nodes. `asks`:
    the close test is asked of a motion into the goal whose cells are occupied.
    """
    search, graph = view(state, "search"), view(state, "graph")
    goals = view(state, "goals")
    proof, frame = view(state, "proof"), view(state, "numbers").frame[0]
    n, head = graph.adj_ptr.shape[0] - 1, 0
    while head < search.made[0]:
        if head == MOST_SOUGHT or search.made[0] > search.e_node.shape[0]:
            return False
        v, length = search.e_node[head], search.e_g[head]
        head += 1
        if search.near_g[v] < length or not item_free(state, np.int64(v)):
            continue
        search.done[v], search.g[v] = proof.count[RUN], length
        a = goals.at[g, v]
        if a >= 0:
            whole = length + goals.length[g, a] + goals.cost[g]
            if NEARLY * whole < proof.length[0]:
                if entry_open(state, g, a, asks):
                    return False
                proof.goal_out[a] = blocked_by(goals.memo[g, a], frame)
        for k in range(graph.adj_ptr[v], graph.adj_ptr[v + 1]):
            w, more = np.int64(graph.adj_node[k]), length + graph.adj_length[k]
            if not NEARLY * (more + h[w]) < proof.length[0]:
                continue
            if search.done[w] == proof.count[RUN] and search.g[w] <= more:
                continue
            if item_free(state, w) and item_free(state, n + graph.adj_edge[k]):
                seek_from(state, w, more, h)
    return True


@njit(**INNER)
def is_by_close_test(state, starts, g):
    """Return True where the path's motions at its ends are blocked by their cells.

    So it is where there is no path.
    """
    proof, goals = view(state, "proof"), view(state, "goals")
    blocked = 4 * view(state, "numbers").frame[0] + BLOCKED
    if proof.count[N_NODES] == 0 or starts.memo[proof.by[0]] == blocked:
        return True
    a = proof.by[1]
    return not goal_motion_free(state, g, a) and goals.memo[g, a] == blocked


@njit(**INNER)
def nothing_opened(state, starts, g, h):
    """Return whether what has come free since leads to no shorter path to goal g."""
    proof, search = view(state, "proof"), view(state, "search")
    goals = view(state, "goals")
    # what was closed then tells where to go on from what has come free
    seeks = proof.count[RUN] == view(state, "numbers").run[0]
    asks = view(state, "rules").close_test_connections[0] > 0
    # where cells leave no path, a search asks the close test of all motions; a path
    # that need not be the shortest stays
    asks_all = asks and proof.count[RUN] >= 0 and is_by_close_test(state, starts, g)
    refresh_for(state, proof.count[N_ITEMS])
    proof.count[SOUGHT] += 1
    search.made[0] = 0
    opened = False
    for i in range(proof.count[N_ITEMS]):
        if item_free_now(state, np.int64(proof.item[i])):
            if not seeks:
                return False
            opened = True
            seek_over(state, starts, np.int64(proof.item[i]), h)
    for k in range(starts.count[0]):
        out, v = proof.start_out[k], starts.node[k]
        if out == 0 or NEARLY * (starts.length[k] + h[v]) >= proof.length[0]:
            continue
        again = asks_all or (asks and out == BY_CLOSE_TEST)
        if item_free(state, v) and start_open(state, starts, k, again):
            if not seeks:
                return False
            opened = True
            proof.start_out[k] = 0
            seek_from(state, v, starts.length[k], h)
    for a in range(goals.number[g]):
        out, v = proof.goal_out[a], goals.node[g, a]
        again = asks_all or (asks and out == BY_CLOSE_TEST)
        if out != 0 and item_free(state, v) and entry_open(state, g, a, again):
            return False
    if not opened:
        return True
    if not nothing_shorter(state, g, h, asks) or search.hits[0] > search.hit.shape[0]:
        return False
    keep_hits(state)  # all that is in the way now was looked at in this frame
    return True


@njit(**INNER)
def note_edge(state, w, item):
    """Note what is hit where an edge to node w, or its list, is: once a frame."""
    if item_free(state, w):
        item_free(state, item)


@njit(**INNER)
def begin_flood(state, low, high):
    """Queue the nodes next to goals low to high - 1, where the flood begins.

    The close test is asked of motions into a goal that the cells do not free: else the
    flood would hold nodes that lead nowhere.
    """
    search, goals = view(state, "search"), view(state, "goals")
    numbers = view(state, "numbers")
    maybe, run = 4 * numbers.frame[0] + MAYBE, numbers.run[0]
    search.head[0] = search.tail[0] = 0
    for g in range(low, high):
        for a in range(goals.number[g]):
            w = goals.node[g, a]
            if search.flood[w] == run or not item_free(state, w):
                continue
            if not goal_motion_free(state, g, a):
                if goals.memo[g, a] != maybe or not goal_motion_clear(state, g, a):
                    continue
            if reach(state, w):
                return


@njit(**INNER)
def reach(state, w):
    """Let the flood reach a free node over a free edge; True where the search was."""
    search, run = view(state, "search"), view(state, "numbers").run[0]
    search.flood[w] = run
    if search.done[w] == run and search.g[w] < math.inf:
        search.tail[0] = OVER
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
        if reach(state, np.int64(w)):
            return


@njit(**INNER)
def meets_start(state, starts, low, high):
    """Return True where the flood, now over, holds a node that the start may go to.

    So it is, too, where the straight motion to a goal is free.
    """
    search, goals = view(state, "search"), view(state, "goals")
    frame, run = view(state, "numbers").frame[0], view(state, "numbers").run[0]
    for k in range(starts.count[0]):
        verdict = starts.memo[k] - 4 * frame
        if verdict == FREE or verdict == MAYBE:
            if search.flood[starts.node[k]] == run:
                return True
    for g in range(low, high):
        if goals.direct_memo[g] == 4 * frame + FREE:
            return True
    return False


@njit(**INNER)
def flood_over(state, item):
    """Let the flood go over an item that has come free."""
    graph, search = view(state, "graph"), view(state, "search")
    run, n = view(state, "numbers").run[0], graph.adj_ptr.shape[0] - 1
    if item >= n:
        for k in range(2):
            u = np.int64(graph.edges[item - n, k])
            w = np.int64(graph.edges[item - n, 1 - k])
            if search.flood[u] == run and search.flood[w] != run:
                if item_free(state, w) and reach(state, w):
                    return
        return
    for k in range(graph.adj_ptr[item], graph.adj_ptr[item + 1]):
        if search.flood[item] == run:
            return
        if search.flood[graph.adj_node[k]] == run:
            if item_free(state, n + graph.adj_edge[k]) and reach(state, item):
                return


@njit(**INNER)
def stays_shut(state, starts, g, asks):
    """Return whether a flood that met no start meets none yet; it goes on.

    Into goal g by motions that have come free, or were joined since, and from the nodes
    in its queue. `asks`: the close test is asked of motions whose cells are occupied.
    """
    search, goals = view(state, "search"), view(state, "goals")
    run = view(state, "numbers").run[0]
    for a in range(goals.number[g]):
        w = np.int64(goals.node[g, a])
        if search.tail[0] != OVER and search.flood[w] != run and item_free(state, w):
            if entry_open(state, g, a, asks):
                reach(state, w)
    while search.tail[0] != OVER and search.head[0] < search.tail[0]:
        flood_step(state)
    if search.tail[0] == OVER:
        return False
    for k in range(starts.count[0]):
        v = np.int64(starts.node[k])
        if search.flood[v] == run and item_free(state, v):
            if start_open(state, starts, k, asks):
                return False
    return not meets_start(state, starts, g, g + 1)


@njit(**INNER)
def goes_on_shut(state, starts, g, run):
    """Return whether more motions, free or not, open no path to goal g.

    Only a flood from it can tell, that met no start in a search after number `run`.
    """
    search, numbers = view(state, "search"), view(state, "numbers")
    if numbers.run[0] == run or numbers.exhausted[0] != GOAL_SIDE:
        return False
    search.head[0] = search.tail[0] = 0
    return stays_shut(state, starts, g, False)


@njit(**INNER)
def is_shut(state, starts, g):
    """Return whether a search whose flood met no start would still find no path.

    What blocked the flood's way is asked again, and it goes over what has come free.
    Motions may have been joined since, at both ends.
    """
    proof, search = view(state, "proof"), view(state, "search")
    refresh_for(state, proof.count[N_ITEMS])
    search.head[0] = search.tail[0] = 0
    for i in range(proof.count[N_ITEMS]):
        if item_free_now(state, np.int64(proof.item[i])):
            flood_over(state, np.int64(proof.item[i]))
            if search.tail[0] == OVER:
                return False
    asks = view(state, "rules").close_test_connections[0] > 0
    if not stays_shut(state, starts, g, asks):
        return False
    if search.hits[0] > search.hit.shape[0]:
        return False
    keep_hits(state)  # all that is in the way now was looked at in this frame
    proof.of[2], proof.of[3] = starts.count[0], view(state, "goals").number[g]
    return True


@njit(**INNER)
def refresh_for(state, n_items):
    """Settle all items at once where so many are to be looked at."""
    stats = view(state, "stats")
    if stats.counted[0] == 0 and n_items > tests_worth_refreshing(state):
        refresh(state)
        stats.counted[0] = 1


@njit(**INNER)
def what_holds(state, starts, start_vertex, g, h):
    """Return what the last search showed and holds in this frame, for goal g.

    Its motions and those in `starts`, from the start, were judged by this frame; `h`
    (n,) is the cost to go to it.
    """
    proof, goals = view(state, "proof"), view(state, "goals")
    numbers = view(state, "numbers")
    if proof.of[0] != start_vertex or proof.of[1] != goals.vertex[g]:
        return UNKNOWN
    nodes, n = proof.count[N_NODES], view(state, "graph").adj_ptr.shape[0] - 1
    if nodes == 0 and numbers.run[0] != proof.count[RUN]:
        return UNKNOWN
    if nodes == 0 and proof.count[SIDE] == GOAL_SIDE:
        proof.of[0] = -1
        if not is_shut(state, starts, g):
            return UNKNOWN
        numbers.exhausted[0], proof.of[0] = GOAL_SIDE, start_vertex
        return NO_WAY
    if proof.of[2] != starts.count[0] or proof.of[3] != goals.number[g]:
        return UNKNOWN
    # what comes next changes what is known, and else a search does
    proof.of[0] = -1
    for k in range(nodes):
        if not item_free(state, np.int64(proof.node[k])):
            return UNKNOWN
        if k > 0 and not item_free(state, n + np.int64(proof.edge[k - 1])):
            return UNKNOWN
    if not nothing_opened(state, starts, g, h):
        return UNKNOWN
    if nodes == 0:
        numbers.exhausted[0] = proof.count[SIDE]
        proof.of[0] = start_vertex
        return NO_WAY
    asks = view(state, "rules").close_test_connections[0] > 0
    if not start_open(state, starts, proof.by[0], asks):
        return UNKNOWN
    if not entry_open(state, g, proof.by[1], asks):
        return UNKNOWN
    proof.of[0] = start_vertex
    return SHORTEST


@njit(**INNER)
def write_shortest(state, starts, start_vertex, g):
    """Write the path of the last search to `found_path`, as `write_path` did."""
    proof, goals = view(state, "proof"), view(state, "goals")
    graph = view(state, "graph")
    path, robot = view(state, "found_path"), view(state, "robot_state")
    nodes, a = proof.count[N_NODES], proof.by[1]
    path.vertex[0], path.ref[0] = start_vertex, starts.ref[proof.by[0]]
    copy_row(robot.q, path.q[0])
    for k in range(nodes):
        path.vertex[k + 1] = proof.node[k]
        copy_row(graph.nodes[proof.node[k]], path.q[k + 1])
        if k > 0:
            path.ref[k] = EDGE_BASE - np.int64(proof.edge[k - 1])
    last = nodes + 1
    if goals.ref[g, a] == IS_GOAL:  # it is no further vertex
        last = nodes
    else:
        path.ref[nodes] = goals.ref[g, a]
        copy_row(goals.q[g], path.q[last])
    path.vertex[last] = goals.vertex[g]
    path.count[0], path.count[1] = last + 1, g
    unwrap(path.q, path.count[0], robot.continuous)
    take_shortcuts(state)
