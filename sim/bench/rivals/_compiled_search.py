"""A compiled competitor: lazy A* with sphere-capsule checks on the same cover.

It gets everything the planner has but the map: the same roadmap and attachments, the
same cost-to-go, the same sphere cover with its bounding balls, a verdict of every node
and edge remembered within the frame, and the number of samples of every motion worked
out ahead (from its true sweep). A motion is sampled in bisection order, so that a hit
is found early, and no sphere centre moves by more than mu between two samples.
"""

import math

import numpy as np
from numba import njit

from odm.search._astar import pop, push
from roadmap.compiling.jit_options import FULL, INNER, LEAN
from roadmap.kinematics._forward import body_frames, place_points


@njit(**INNER)
def segment_distance2(px, py, pz, rod):
    """Return the squared distance of a point from the axis of a capsule (7,)."""
    ux, uy, uz = rod[3] - rod[0], rod[4] - rod[1], rod[5] - rod[2]
    wx, wy, wz = px - rod[0], py - rod[1], pz - rod[2]
    length2 = ux * ux + uy * uy + uz * uz
    s = 0.0
    if length2 > 0.0:
        s = min(1.0, max(0.0, (wx * ux + wy * uy + wz * uz) / length2))
    dx, dy, dz = wx - s * ux, wy - s * uy, wz - s * uz
    return dx * dx + dy * dy + dz * dz


@njit(**INNER)
def configuration_free(arm, widest, q, rods, margin, frames):
    """Return True if no moving sphere comes within `margin` of a capsule at q."""
    body_frames(arm.tree_i, arm.tree_f, q, frames)
    for b in range(1, arm.tree_i.shape[0]):
        if arm.body_ptr[b + 1] == arm.body_ptr[b]:
            continue
        f = frames[b]
        x, y, z, near = arm.bound[b]
        bx = f[0] * x + f[1] * y + f[2] * z + f[9]
        by = f[3] * x + f[4] * y + f[5] * z + f[10]
        bz = f[6] * x + f[7] * y + f[8] * z + f[11]
        for k in range(rods.shape[0]):
            far = near + widest[b] + rods[k, 6] + margin
            if segment_distance2(bx, by, bz, rods[k]) >= far * far:
                continue
            for i in range(arm.body_ptr[b], arm.body_ptr[b + 1]):
                x, y, z, r = arm.spheres[i]
                cx = f[0] * x + f[1] * y + f[2] * z + f[9]
                cy = f[3] * x + f[4] * y + f[5] * z + f[10]
                cz = f[6] * x + f[7] * y + f[8] * z + f[11]
                keep = r + rods[k, 6] + margin
                if segment_distance2(cx, cy, cz, rods[k]) < keep * keep:
                    return False
    return True


@njit(**INNER)
def motion_free(arm, widest, q, dq, pieces, rods, margin, frames, point):
    """Test q + t dq at t = k / pieces, 0 < k < pieces, coarse steps first."""
    step = 1
    while step < pieces:
        step *= 2
    while step > 1:
        half = step >> 1
        for k in range(half, pieces, step):
            for j in range(q.shape[0]):
                point[j] = q[j] + dq[j] * k / pieces
            if not configuration_free(arm, widest, point, rods, margin, frames):
                return False
        step = half
    return True


@njit(**FULL)
def count_pieces(arm, q, dq, mu, frames, centers, out):
    """Write how many pieces motions q[k] + t dq[k] need.

    The sweep of every sphere centre is measured in `len(centers) - 1` chords; no
    centre moves by more than `mu` within a piece.
    """
    chords = centers.shape[0] - 1
    point = np.empty(q.shape[1])
    for m in range(q.shape[0]):
        longest = 0.0
        for k in range(chords + 1):
            for j in range(q.shape[1]):
                point[j] = q[m, j] + dq[m, j] * k / chords
            body_frames(arm.tree_i, arm.tree_f, point, frames)
            place_points(frames, arm.body, arm.spheres, centers[k])
            if k == 0:
                continue
            for i in range(centers.shape[1]):
                d2 = 0.0
                for a in range(3):
                    d = centers[k, i, a] - centers[k - 1, i, a]
                    d2 += d * d
                longest = max(longest, d2)
        out[m] = max(1, math.ceil(chords * math.sqrt(longest) / mu))


@njit(**INNER)
def node_free(race, arm, widest, rods, margin, frame, v):
    """Return True if node v is free in this frame; remembered."""
    known = race.memo[v]
    if known >> 1 == frame:
        return known & 1 == 0
    race.counts[0] += 1
    free = configuration_free(arm, widest, race.nodes[v], rods, margin, race.frames)
    race.memo[v] = 2 * frame + (0 if free else 1)
    return free


@njit(**INNER)
def edge_free(race, arm, widest, rods, margin, frame, e):
    """Return True if the inside of edge e is free in this frame; remembered."""
    n = race.nodes.shape[0]
    known = race.memo[n + e]
    if known >> 1 == frame:
        return known & 1 == 0
    race.counts[1] += 1
    a = race.nodes[race.edges[e, 0]]
    free = motion_free(
        arm,
        widest,
        a,
        race.edge_dq[e],
        race.edge_pieces[e],
        rods,
        margin,
        race.frames,
        race.point,
    )
    race.memo[n + e] = 2 * frame + (0 if free else 1)
    return free


@njit(**INNER)
def joint_free(race, arm, widest, rods, margin, k):
    """Test attachment k of the query: its whole motion but the two ends."""
    race.counts[2] += 1
    return motion_free(
        arm,
        widest,
        race.join_q[k],
        race.join_dq[k],
        race.join_pieces[k],
        rods,
        margin,
        race.frames,
        race.point,
    )


@njit(**LEAN)
def lazy_a_star(race, search, arm, widest, rods, margin, frame, n_starts, n_goals, h):
    """Search from the start's attachments to the goal's; return its entry or -1.

    Attachments 0..n_starts-1 leave the start, the next n_goals enter the goal, the
    last is the straight motion, which is tried first. Entry kinds in e_ref: -1 from
    the start, -2 - k into the goal by attachment k, e >= 0 by edge e.
    """
    n = race.nodes.shape[0]
    race.counts[:] = 0
    straight = n_starts + n_goals
    q_start, q_goal = race.ends[0], race.ends[1]
    if not configuration_free(arm, widest, q_start, rods, margin, race.frames):
        return -1
    if not configuration_free(arm, widest, q_goal, rods, margin, race.frames):
        return -1
    # no pieces: the straight motion is in self-collision
    allowed = race.join_pieces[straight] > 0
    if allowed and joint_free(race, arm, widest, rods, margin, straight):
        search.e_node[0] = n
        search.e_from[0] = -1
        search.e_g[0] = race.join_length[straight]
        return 0
    entries, size = 0, 0
    for k in range(n_starts):
        v = race.join_node[k]
        search.e_node[entries] = v
        search.e_ref[entries] = -2 - k
        search.e_from[entries] = -1
        search.e_g[entries] = race.join_length[k]
        push(search, size, race.join_length[k] + h[v], entries)
        entries += 1
        size += 1
    while size > 0:
        entry = pop(search, size)
        size -= 1
        v, ref = search.e_node[entry], search.e_ref[entry]
        if search.done[v] == frame:
            continue
        # nodes first: one test for all ways into a blocked one
        if v < n and not node_free(race, arm, widest, rods, margin, frame, v):
            search.done[v] = frame
            continue
        if ref >= 0:
            free = edge_free(race, arm, widest, rods, margin, frame, ref)
        else:
            free = joint_free(race, arm, widest, rods, margin, -2 - ref)
        if not free:
            continue
        search.done[v] = frame
        race.counts[3] += 1
        if v >= n:
            return entry
        g = search.e_g[entry]
        for k in range(n_starts, straight):
            if race.join_node[k] == v:
                search.e_node[entries] = n
                search.e_ref[entries] = -2 - k
                search.e_from[entries] = entry
                search.e_g[entries] = g + race.join_length[k]
                push(search, size, g + race.join_length[k], entries)
                entries += 1
                size += 1
        for k in range(race.adj_ptr[v], race.adj_ptr[v + 1]):
            w, e = race.adj_node[k], race.adj_edge[k]
            if search.done[w] == frame or race.memo[n + e] == 2 * frame + 1:
                continue
            if h[w] == math.inf:
                continue
            g_w = g + race.adj_length[k]
            search.e_node[entries] = w
            search.e_ref[entries] = e
            search.e_from[entries] = entry
            search.e_g[entries] = g_w
            push(search, size, g_w + h[w], entries)
            entries += 1
            size += 1
    return -1
