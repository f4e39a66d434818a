"""Ways: written from a search, shortened, and found again by a robot on them."""

import math

from numba import njit

from odm.search._beside import locate_beside, off_motion
from odm.search._items import pool_free
from odm.search._recent import ref_wary
from odm.search._state import IS_GOAL, NO_ITEM, view
from roadmap.geometry._segments import nearest_share

SAME_PLACE = 1e-9  # [m]
ON = 1e-7  # [m] a tenth of what every swept radius is larger than it must be


@njit(cache=True, nogil=True)
def locate_on_way(state, way, first, q, out):
    """Find q on a way, from segment `first` on, within tracking and blending.

    A point of the robot differs by at most sum_j |dq_j| sway_j between q and the
    nearest point of the segment; where that is too much, the spheres are asked. Writes
    the share of the segment to out[0]; returns the segment, or -1.
    """
    own = view(state, "own")
    best = -1
    best_off = view(state, "terms").beside[0]
    for k in range(first, way.count[0] - 1):
        a, b = way.q[k], way.q[k + 1]
        t = nearest_share(a, b, q)
        off = off_motion(a, b, t, q, own.sway)
        # of two segments over the same place the later one is nearer to the goal
        if off <= best_off + SAME_PLACE:
            best_off = min(off, best_off)
            best = k
            out[0] = t
    if best < 0:
        return locate_beside(state, way, first, q, out)
    return best


@njit(cache=True, nogil=True)
def is_on(proof, k, q):
    """Return True if q is on the certified motion of segment k, but for rounding.

    Only then what was certified of that motion holds for the one from q to an end of
    the segment: it is a part of it. Beside it, that is a motion of its own.
    """
    a, b = proof.begin[k], proof.end[k]
    return off_motion(a, b, nearest_share(a, b, q), q, proof.motion) <= ON


@njit(cache=True, nogil=True)
def turns_back(way, k, q, continuous):
    """Return True if a continuous joint has more than half a turn to go to the end.

    Beside the begin of a segment of almost half a turn: the short way there is the
    other way round.
    """
    for j in range(q.shape[0]):
        if continuous[j] and abs(way.q[k + 1, j] - q[j]) > math.pi:
            return True
        if continuous[j] and abs(way.q[k, j] - q[j]) > math.pi:
            return True
    return False


@njit(cache=True, nogil=True)
def certify_whole(way, first, proof):
    """Say that each segment from `first` on is the whole motion that was certified."""
    for k in range(first, way.count[0] - 1):
        for j in range(way.q.shape[1]):
            proof.begin[k, j] = way.q[k, j]
            proof.end[k, j] = way.q[k + 1, j]


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
def copy_proof(source, target, n):
    """Let `target` hold the proof of the first `n` segments of `source`."""
    for k in range(n):
        target.begin[k] = source.begin[k]
        target.end[k] = source.end[k]


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
def write_way(state, starts, entry, start_vertex):
    """Write the path from own.q that ends in heap entry `entry` to `spare`."""
    graph, goals, way = view(state, "graph"), view(state, "goals"), view(state, "spare")
    search, own = view(state, "search"), view(state, "own")
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
    way.q[0] = own.q
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
def take_shortcuts(state):
    """Shorten the path `spare` by the remembered motions that are free now."""
    short, own, way = view(state, "short"), view(state, "own"), view(state, "spare")
    weights, n = own.weights, way.count[0]
    heed = view(state, "numbers").heed[0] == 1
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
                if item < 0 or not pool_free(state, item):
                    continue
                if heed and ref_wary(state, item):
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
