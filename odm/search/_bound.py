"""What earlier searches found and showed, for the next one.

Paths that earlier long searches found give an upper bound: where one of them is free in
this frame, no path longer than it is of interest: A* need not keep entries beyond it,
and returns what it would have returned anyway.

The last search gives more. Whatever is shorter than its path leads over something that
was blocked then, for it looked at all that is shorter. While all of that is blocked and
the path is free, it is still the shortest, without a search; what came free and cannot
shorten it by a hundredth is let be. In the same way there is no path yet where there
was none.
"""

import math

import numpy as np
from numba import njit

from odm.search._items import (
    BLOCKED,
    FREE,
    MAYBE,
    REFUSED,
    goal_motion_free,
    item_free,
)
from odm.search._judge import goal_motion_clear, start_clear
from odm.search._paths import unwrap
from odm.search._recent import TOLL, item_in_avoided, ref_in_avoided
from odm.search._state import EDGE_BASE, IS_GOAL, view
from roadmap._rows import copy_row
from roadmap.jit_options import INNER

ROUNDING = 1.0 + 1e-9
# what holds of the last search: nothing that is known; its path is free and the
# shortest; there is no path
UNKNOWN, SHORTEST, NO_WAY = 0, 1, 2
NEARLY = 1.01  # times the length of the shortest path counts as short as that
BY_CELLS, BY_CLOSE_TEST = 1, 2  # by which a motion was blocked
N_ITEMS, N_NODES, RUN, SIDE = 0, 1, 2, 3  # of `Proof.count`


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
    earlier, search, goals = (
        view(state, "earlier_paths"),
        view(state, "search"),
        view(state, "goals"),
    )
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
def keep_proof(state, starts, start_vertex, g, entry):
    """Keep what the last search showed, to goal g, whose heap entry is `entry`.

    -1: there is no path. Nothing is kept of a start that is on its way, or where more
    was blocked than there is room for.
    """
    proof, search, goals = (
        view(state, "proof"),
        view(state, "search"),
        view(state, "goals"),
    )
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
    for i in range(items):
        proof.item[i], proof.item_f[i] = search.hit[i], search.hit_f[i]
    proof.count[N_ITEMS], proof.count[N_NODES] = items, count
    proof.count[RUN], proof.count[SIDE] = numbers.run[0], numbers.exhausted[0]
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
def what_holds(state, starts, start_vertex, g, h):
    """Return what the last search showed and holds in this frame, for goal g.

    Args:
        state: The table.
        starts: Motions from the start, judged by this frame.
        start_vertex: Of the start.
        g: Rank of the goal, whose motions are judged.
        h: (n,) cost to go to it.
    """
    proof, goals = view(state, "proof"), view(state, "goals")
    numbers = view(state, "numbers")
    if proof.of[0] != start_vertex or proof.of[1] != goals.vertex[g]:
        return UNKNOWN
    if proof.of[2] != starts.count[0] or proof.of[3] != goals.number[g]:
        return UNKNOWN
    nodes, n = proof.count[N_NODES], view(state, "graph").adj_ptr.shape[0] - 1
    if nodes == 0 and numbers.run[0] != proof.count[RUN]:
        return UNKNOWN
    for k in range(nodes):
        if not item_free(state, np.int64(proof.node[k])):
            return UNKNOWN
        if k > 0 and not item_free(state, n + np.int64(proof.edge[k - 1])):
            return UNKNOWN
    for i in range(proof.count[N_ITEMS]):
        shorter = NEARLY * proof.item_f[i] < proof.length[0]
        if shorter and item_free(state, np.int64(proof.item[i])):
            return UNKNOWN
    asks = view(state, "rules").close_test_connections[0] > 0
    for k in range(starts.count[0]):
        out, v = proof.start_out[k], starts.node[k]
        if out == 0 or NEARLY * (starts.length[k] + h[v]) >= proof.length[0]:
            continue
        again = asks and (out == BY_CLOSE_TEST or nodes == 0)
        if item_free(state, v) and start_open(state, starts, k, again):
            return UNKNOWN
    for a in range(goals.number[g]):
        out, v = proof.goal_out[a], goals.node[g, a]
        again = asks and (out == BY_CLOSE_TEST or nodes == 0)
        if out != 0 and item_free(state, v) and entry_open(state, g, a, again):
            return UNKNOWN
    if nodes == 0:
        numbers.exhausted[0] = proof.count[SIDE]
        return NO_WAY
    if not start_open(state, starts, proof.by[0], asks):
        return UNKNOWN
    return SHORTEST if entry_open(state, g, proof.by[1], asks) else UNKNOWN


@njit(**INNER)
def write_shortest(state, starts, start_vertex, g):
    """Write the path of the last search to `found_path`, as `write_path` did."""
    proof, goals, graph = (
        view(state, "proof"),
        view(state, "goals"),
        view(state, "graph"),
    )
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
    unwrap(path, robot.continuous)
