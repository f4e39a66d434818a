"""Attaching configurations: near nodes, cells of motions, cost to go."""

import math

import numpy as np
from numba import njit

from odm.cell_map._sweep import sweep_motion
from odm.close_test._close import displacement, set_point
from odm.search._bound import GOAL_SIDE, NO_EXIT_SIDE, START_SIDE
from odm.search._cost_to_go import ROUNDING
from odm.search._items import item_free
from odm.search._judge import close_free, stands_free
from odm.search._state import view
from roadmap.compiling.jit_options import BARE, INNER, LEAN, WITHIN_INNER

# of what `free_first` returns: how many nodes are free, and how many it looked at
FREE_NODES, LOOKED_AT = 0xFFFF, 16
WAITS, IS_FREE, IS_BLOCKED = 0, 1, 2  # what it finds of a node
AT_ONCE = np.uint64(512)  # nodes whose numbers stay in the cache


@njit(**WITHIN_INNER)
def distance(nodes, i, q, weights, continuous):
    """Return the weighted distance of node i from q."""
    total = 0.0
    for j in range(q.shape[0]):
        d = nodes[i, j] - q[j]
        if continuous[j]:
            d -= 2.0 * math.pi * round(d / (2.0 * math.pi))
        d *= weights[j]
        total += d * d
    return math.sqrt(total)


@njit(**BARE)
def distances(joints, q, weights, continuous, out):
    """Write the weighted distance of every node from q to `out` (n,).

    `joints` (dof, n) are the nodes joint by joint: vector code takes several at a time,
    so many at once as stay in the cache. The same numbers as `distance`.
    """
    n = np.uint64(out.shape[0])
    for first in range(np.uint64(0), n, AT_ONCE):
        last = min(n, first + AT_ONCE)
        for i in range(first, last):
            out[i] = 0.0
        for j in range(np.uint64(q.shape[0])):
            row, at, weight = joints[j], q[j], weights[j]
            for i in range(first, last):
                d = row[i] - at
                if continuous[j]:
                    d -= 2.0 * math.pi * np.rint(d / (2.0 * math.pi))
                d *= weight
                out[i] += d * d
        for i in range(first, last):
            out[i] = math.sqrt(out[i])


@njit(**LEAN)
def lengths_to(nodes, ids, q, weights, continuous, out):
    """Write the weighted distance of the nodes `ids` (k,) from q to `out` (k,)."""
    for k in range(ids.shape[0]):
        out[k] = distance(nodes, ids[k], q, weights, continuous)


@njit(**LEAN)
def least(cost, out):
    """Write to `out` (k,) where `cost` (n,) is least, ascending, ties by number.

    k is at most n, and small: each that is found is put in its place.
    """
    n, most = 0, out.shape[0]
    for i in range(cost.shape[0]):
        if n == most:
            if n == 0 or not cost[i] < cost[out[n - 1]]:
                continue
            n -= 1
        at = n
        while at > 0 and cost[i] < cost[out[at - 1]]:
            out[at] = out[at - 1]
            at -= 1
        out[at] = i
        n += 1


@njit(**LEAN)
def cost_through(near, beyond, dearer, far, out):
    """Write to `out` (n,) what a path costs that leaves to each node, and on from it.

    The motion to the node counts `dearer` times its length `near` (n,), what lies
    `beyond` it (n,) at most `far`.
    """
    for i in range(near.shape[0]):
        out[i] = dearer * near[i] + min(beyond[i], far)


@njit(**LEAN)
def sweep_into_pool(swept, q, dq, region, pool, room):
    """Add the cells of motions q[k] + t dq[k]; returns the first item, -1 when full.

    A motion that leaves the grid (none within limits does) gives -2.
    """
    first, words = pool.used[0], room.words
    for k in range(q.shape[0]):
        item, end = pool.used[0], pool.used[1]
        if item >= pool.begin.shape[0]:
            return -1
        if not sweep_motion(swept, q[k], dq[k], room):
            words[:] = 0
            return -2
        pool.begin[item] = end
        for k4 in range(4 * item, 4 * item + 4):
            pool.signature[k4] = 0
        for b in range(words.shape[0]):
            if words[b] != 0:
                if end < pool.block.shape[0]:
                    pool.block[end] = b
                    pool.mask[end] = words[b]
                bit = region[b]
                pool.signature[4 * item + (bit >> 6)] |= np.uint64(1) << np.uint64(
                    bit & 63
                )
                end += 1
                words[b] = 0
        if end > pool.block.shape[0]:
            return -1
        pool.end[item] = end
        pool.used[0] = item + 1
        pool.used[1] = end
    return first


@njit(**BARE)
def raise_by_landmarks(landmarks, node, h):
    """Raise lower bounds `h` (n,) on the cost to go to a node by landmarks.

    `landmarks` (l, n) are the costs to go to each of them.
    """
    n = np.uint64(h.shape[0])
    for first in range(np.uint64(0), n, AT_ONCE):
        last = min(n, first + AT_ONCE)
        for k in range(np.uint64(landmarks.shape[0])):
            row, there = landmarks[k], landmarks[k, node]
            for i in range(first, last):
                least = abs(row[i] - there)
                if least > h[i]:
                    h[i] = least
        for i in range(first, last):
            h[i] *= ROUNDING


@njit(**INNER)
def leads_on(state, v, of_start):
    """Return True where a motion between node v and the start, or a goal, may help now.

    A search that has no path knows all that is reached from the start, or from the
    goal. A motion helps where it joins what the one reaches with what it does not.
    Where nothing leaves the start, only motions there can help.
    """
    numbers, search = view(state, "numbers"), view(state, "search")
    side, run = numbers.exhausted[0], numbers.run[0]
    if side == NO_EXIT_SIDE:
        return of_start
    if side == START_SIDE:
        return (search.done[v] == run) != of_start
    if side == GOAL_SIDE and view(state, "goals").count[0] == 1:
        return (search.flood[v] == run) == of_start
    return True


@njit(**INNER)
def free_again(state, q, vertex, v):
    """Return True if the close test frees the motion from a vertex at q to node v.

    It is most likely blocked where it was the last time: that is looked at first.
    """
    looks, robot = view(state, "looks"), view(state, "robot_state")
    displacement(q, view(state, "graph").nodes[v], robot.continuous, robot.dq)
    if looks.vertex[v] == vertex:
        set_point(q, robot.dq, looks.at[v], robot.scratch_q)
        if not stands_free(state, robot.scratch_q):
            return False
    if close_free(state, q, robot.dq):
        looks.vertex[v] = -1
        return True
    looks.vertex[v], looks.at[v] = vertex, view(state, "work").value[0]
    return False


@njit(**LEAN)
def free_first(state, q, waiting, vertex, looks, ordered, found):
    """Order nodes that wait to be joined: what q can go to in this frame comes first.

    Only nodes that may lead on are looked at, `looks` of them at most, by the close
    test of the motion to them. Those that are blocked come last; among themselves all
    stay in order. q is that of `vertex`, the start or a goal; `waiting` (k,) are the
    nodes, `ordered` (k,) gets them, `found` (k,) is scratch.

    Returns:
        How many are free, and LOOKED_AT bits higher how many were looked at.
    """
    free = looked = 0
    of_start = vertex == view(state, "goals").count[1]
    for k in range(waiting.shape[0]):
        found[k] = WAITS
        if looked == looks or not leads_on(state, waiting[k], of_start):
            continue
        looked += 1
        found[k] = IS_BLOCKED
        if not item_free(state, waiting[k]):
            continue
        if free_again(state, q, vertex, waiting[k]):
            found[k] = IS_FREE
            free += 1
    at = 0
    for kind in (IS_FREE, WAITS, IS_BLOCKED):
        for k in range(waiting.shape[0]):
            if found[k] == kind:
                ordered[at] = waiting[k]
                at += 1
    return free + (looked << LOOKED_AT)
