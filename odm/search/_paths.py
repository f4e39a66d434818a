"""Paths: written from a search, shortened, and the place of a robot on them."""

import math

from numba import njit

from odm.search._items import pool_free
from odm.search._off_path import locate_off_path, motion_deviation, nearest_share
from odm.search._recent import ref_in_avoided
from odm.search._state import IS_GOAL, NO_ITEM, view
from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import INNER, LEAN

SAME_PLACE = 1e-9  # [m]
ON = 1e-7  # [m] a tenth of what every swept radius is larger than it must be


@njit(**LEAN)
def locate_on_path(state, path, first, q, out):
    """Find q on a path, from segment `first` on, within tracking and blending.

    A point of the robot differs by at most sum_j |dq_j| motion_bound_j between q and
    the nearest point of the segment; where that is too much, the spheres themselves are
    compared. Writes the share of the segment to out[0]; returns the segment, or -1.
    """
    robot = view(state, "robot_state")
    best = -1
    best_off = view(state, "terms").path_tolerance[0]
    for k in range(first, path.count[0] - 1):
        a, b = path.q[k], path.q[k + 1]
        t = nearest_share(a, b, q)
        off = motion_deviation(a, b, t, q, robot.motion_bound)
        # of two segments over the same place the later one is nearer to the goal
        if off <= best_off + SAME_PLACE:
            best_off = min(off, best_off)
            best = k
            out[0] = t
    if best < 0:
        return locate_off_path(state, path, first, q, out)
    return best


@njit(**INNER)
def is_on(certificates, k, q):
    """Return True if q is on the certified motion of segment k, but for rounding.

    Only then what was certified of that motion holds for the one from q to an end of
    the segment: it is a part of it. Off it, that is a motion of its own.
    """
    a, b = certificates.begin[k], certificates.end[k]
    share = nearest_share(a, b, q)
    return motion_deviation(a, b, share, q, certificates.motion_bound) <= ON


@njit(**INNER)
def turns_back(path, k, q, continuous):
    """Return True if a continuous joint has more than half a turn to go to the end.

    Near the begin of a segment of almost half a turn the shorter rotation to its end
    may go the opposite direction.
    """
    for j in range(q.shape[0]):
        if continuous[j] and abs(path.q[k + 1, j] - q[j]) > math.pi:
            return True
        if continuous[j] and abs(path.q[k, j] - q[j]) > math.pi:
            return True
    return False


@njit(**LEAN)
def certify_whole(path, first, certificates):
    """Record each segment from `first` on as a certified motion of its own."""
    for k in range(first, path.count[0] - 1):
        for j in range(path.q.shape[1]):
            certificates.begin[k, j] = path.q[k, j]
            certificates.end[k, j] = path.q[k + 1, j]


@njit(**INNER)
def copy_path(source, target):
    """Let `target` be the same way as `source`."""
    n = source.count[0]
    for k in range(n):
        target.vertex[k] = source.vertex[k]
        target.ref[k] = source.ref[k]
        copy_row(source.q[k], target.q[k])
    target.count[0] = n
    target.count[1] = source.count[1]


@njit(**INNER)
def copy_certificates(source, target, n):
    """Let `target` hold the proof of the first `n` segments of `source`."""
    for k in range(n):
        copy_row(source.begin[k], target.begin[k])
        copy_row(source.end[k], target.end[k])


@njit(**LEAN)
def unwrap(q, n, continuous):
    """Let continuous joints take the shorter rotation between corners of q[:n]."""
    for k in range(1, n):
        for j in range(continuous.shape[0]):
            if continuous[j]:
                d = q[k, j] - q[k - 1, j]
                q[k, j] -= 2.0 * math.pi * round(d / (2.0 * math.pi))


@njit(**INNER)
def write_path(state, starts, entry, start_vertex):
    """Write the path from q that ends in heap entry `entry` to `found_path`."""
    graph, goals = view(state, "graph"), view(state, "goals")
    path = view(state, "found_path")
    search, robot = view(state, "search"), view(state, "robot_state")
    n = graph.adj_ptr.shape[0] - 1
    count = 2
    e = entry
    while search.e_from[e] >= 0:
        e = search.e_from[e]
        count += 1
    if count > path.vertex.shape[0]:
        return False
    g = search.e_node[entry] - n
    path.count[0] = count
    path.count[1] = g
    path.vertex[0] = start_vertex
    copy_row(robot.q, path.q[0])
    k = count - 1
    e = entry
    while k > 0:
        v = search.e_node[e]
        parent = search.e_from[e]
        ref = search.e_ref[e]
        if v >= n:
            path.vertex[k] = goals.vertex[g]
            copy_row(goals.q[g], path.q[k])
            if parent >= 0:
                ref = goals.ref[g, -2 - ref]
            else:
                ref = goals.direct_ref[g]
        else:
            path.vertex[k] = v
            copy_row(graph.nodes[v], path.q[k])
            if parent < 0:
                ref = starts.ref[-2 - ref]
        path.ref[k - 1] = ref
        e = parent
        k -= 1
    # a goal that is a node is no further vertex
    if count > 1 and path.ref[count - 2] == IS_GOAL:
        path.count[0] = count - 1
        path.vertex[count - 2] = goals.vertex[g]
    unwrap(path.q, path.count[0], robot.continuous)
    return True


@njit(**INNER)
def apart2(a, b, robot):
    """Return the squared weighted length of the short motion from a to b."""
    total = 0.0
    for j in range(a.shape[0]):
        d = b[j] - a[j]
        if robot.continuous[j]:
            d -= 2.0 * math.pi * round(d / (2.0 * math.pi))
        d *= robot.weights[j]
        total += d * d
    return total


@njit(**INNER)
def leg_length(a, b, weights):
    """Return the weighted length of the straight leg between two configurations."""
    total = 0.0
    for j in range(weights.shape[0]):
        d = weights[j] * (b[j] - a[j])
        total += d * d
    return math.sqrt(total)


@njit(**INNER)
def path_length(path, weights):
    """Return the weighted length of a path."""
    total = 0.0
    for k in range(1, path.count[0]):
        total += leg_length(path.q[k - 1], path.q[k], weights)
    return total


@njit(**LEAN)
def find_shortcut(shortcuts, a, b):
    """Return the pool item remembered for the motion from vertex a to b, or -1."""
    size = shortcuts.key.shape[0]
    key = (a << 31) | b
    k = ((a * 2654435761) ^ (b * 40503)) & (size - 1)
    while shortcuts.key[k] != -1:
        if shortcuts.key[k] == key:
            return shortcuts.item[k]
        k = (k + 1) & (size - 1)
    return NO_ITEM


@njit(**LEAN)
def add_shortcut(shortcuts, a, b, item):
    """Remember the motion from a to b by a pool item or NO_MOTION; False: full."""
    size = shortcuts.key.shape[0]
    if 2 * shortcuts.count[0] >= size:
        return False
    k = ((a * 2654435761) ^ (b * 40503)) & (size - 1)
    while shortcuts.key[k] != -1:
        k = (k + 1) & (size - 1)
    shortcuts.key[k] = (a << 31) | b
    shortcuts.item[k] = item
    shortcuts.count[0] += 1
    return True


@njit(**INNER)
def take_shortcuts(state):
    """Shorten `found_path` by the remembered motions that are free now."""
    shortcuts, robot = view(state, "shortcuts"), view(state, "robot_state")
    path = view(state, "found_path")
    weights, n = robot.weights, path.count[0]
    avoid_history = view(state, "numbers").avoid_history[0] == 1
    if n < 3 or shortcuts.count[0] == 0:
        return
    best, back, ref = shortcuts.best, shortcuts.back, shortcuts.ref
    best[0] = 0.0
    for k in range(1, n):
        best[k] = math.inf
        for i in range(k - 1, -1, -1):
            length = best[i] + leg_length(path.q[i], path.q[k], weights)
            if length >= best[k] - 1e-9:
                continue
            item = path.ref[k - 1]
            if i < k - 1:
                item = find_shortcut(shortcuts, path.vertex[i], path.vertex[k])
                if item < 0 or not pool_free(state, item):
                    continue
                if avoid_history and ref_in_avoided(state, item):
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
        path.vertex[i] = path.vertex[k]
        path.ref[i - 1] = ref[k]
        copy_row(path.q[k], path.q[i])
    path.count[0] = count
    unwrap(path.q, path.count[0], robot.continuous)
