"""Which motions are free in this frame: by their cells, then by the close test."""

import numpy as np
from numba import njit

from odm.cell_map._packed import ON, word_of
from odm.close_test._close import FIRST_SOLID, displacement, place_clear, set_point
from odm.close_test._sorted_clouds import pick_near, pick_reached
from odm.obstacles._cloud import (
    ARE_REACHED,
    LAYOUT,
    N_LISTED,
    N_LOOKED,
    N_OCCUPIED,
    SORTED,
)
from odm.obstacles._occupancy import clear, pick_points, sort_points
from odm.obstacles._solids import inner_radius, solid_distance
from odm.search._items import (
    BLOCKED,
    FREE,
    MAYBE,
    REFUSED,
    edge_free,
    goal_motion_free,
    item_free,
    pool_free,
)
from odm.search._measured import clearance_of, near_free, near_free_again
from odm.search._state import EDGE_BASE, NO_ITEM, NO_MOTION, TO_END, view
from roadmap.compiling._rows import copy_row, same_row
from roadmap.compiling.jit_options import INNER, LEAN
from roadmap.kinematics._forward import body_frames, place_of

FEW = 4  # places of a frame whose points are looked up; to lay out all takes as long


@njit(**INNER)
def points_near(state, q, dq):
    """Return all of the frame's points that may be in the way of a motion.

    For the first few places of a frame these are looked up. A motion, which may come
    near to most of them, and what is asked later, gets all that the robot can reach.
    """
    cloud, points = view(state, "cloud"), view(state, "seen").points
    if cloud.counts[N_LISTED] == 0 or cloud.counts[LAYOUT] == SORTED:
        return cloud
    if cloud.counts[ARE_REACHED] != 0:
        return view(state, "reached")
    clearance = clearance_of(state)
    # with extra clearance points count that lie beside the block that they are in
    if not view(state, "terms").extra[0] > 0.0:
        if cloud.counts[N_LOOKED] < FEW and rests(dq):
            cloud.counts[N_LOOKED] += 1
            picked = view(state, "picked")
            if pick_near(clearance, q, dq, cloud, picked, points):
                return picked
        reached = view(state, "reached")
        if pick_reached(clearance, view(state, "reach"), cloud, reached, points):
            cloud.counts[ARE_REACHED] = 1
            return reached
    sort_points(points, cloud)
    return cloud


@njit(**INNER)
def rests(dq):
    """Return True if a displacement is none."""
    for j in range(dq.shape[0]):
        if dq[j] != 0.0:
            return False
    return True


@njit(**INNER)
def place_free(state, cloud, q):
    """Return True if a configuration keeps its distance from points and shapes.

    What a shape was too near to in an earlier frame is looked at first.
    """
    view(state, "stats").close[0] += 1
    kept, row = view(state, "blocked_places"), kept_row(state, q)
    if row >= 0 and is_blocked_again(state, row):
        return False
    solids, work = view(state, "solids"), view(state, "work")
    if place_clear(clearance_of(state), q, cloud, solids):
        return True
    i = work.found[0]
    if work.found[1] <= FIRST_SOLID:  # by a shape
        arm = view(state, "arm")
        if row < 0:
            row = kept.next[0]
            kept.next[0] = (row + 1) % kept.sphere.shape[0]
            copy_row(q, kept.q[row])
        frame = work.frames[0, arm.body[i]]
        x, y, z = place_of(frame, arm.spheres[i])
        kept.sphere[row] = i
        kept.center[row, 0], kept.center[row, 1], kept.center[row, 2] = x, y, z
    return False


@njit(**INNER)
def kept_row(state, q):
    """Return the row of `BlockedPlaces` that has this very configuration, or -1."""
    kept = view(state, "blocked_places").q
    for k in range(kept.shape[0]):
        if same_row(kept[k], q):
            return k
    return -1


@njit(**INNER)
def is_blocked_again(state, row):
    """Return True if a shape is too near to the sphere that was blocked before."""
    kept, work = view(state, "blocked_places"), view(state, "work")
    solids, i = view(state, "solids"), kept.sphere[row]
    keep = view(state, "robot_state").bare[i]
    x, y, z = kept.center[row, 0], kept.center[row, 1], kept.center[row, 2]
    for k in range(solids.count[0]):
        d = solid_distance(solids, k, x, y, z, keep)
        if d < keep:
            work.found[0], work.found[1] = i, FIRST_SOLID - k
            work.value[0], work.value[1] = 0.0, d
            return True
    return False


@njit(**LEAN)
def close_free(state, q, dq):
    """Run the close test of a motion against all of the frame's points."""
    return near_free(state, points_near(state, q, dq), q, dq)


@njit(**INNER)
def pick_cells(pick, words, block, mask, begin, end):
    """Add the occupied cells of the list block, mask [begin:end]."""
    for k in range(begin, end):
        word = words[block[k]]
        if word != 0:
            pick_word(pick, block[k], word & mask[k])


@njit(**INNER)
def pick_word(pick, b, word):
    """Add cells of a block; none of them is left out for being there already."""
    if word == 0:
        return
    if pick.words[b] == 0:
        count = pick.counts[N_OCCUPIED]
        pick.occupied[count] = b
        pick.slot[b] = count
        pick.counts[N_OCCUPIED] = count + 1
    pick.words[b] |= word


@njit(**INNER)
def pick_item(picked, words, graph, item):
    """Add the occupied cells of a roadmap item."""
    after, at = np.uint64(0), np.uint64(graph.start[item, 1])
    for k in range(graph.start[item, 0], graph.start[item + 1, 0]):
        after += np.uint64(graph.step[k])
        if graph.step[k] == ON:
            continue
        b, own, at = after - np.uint64(1), graph.code[at], at + np.uint64(1)
        if words[b] != 0:
            cells = word_of(own, graph.half, graph.full)
            pick_word(picked, b, words[b] & cells)


@njit(**INNER)
def pick_ref(state, ref, q, dq):
    """Return the points inside the cells of a motion's item: all that can block it.

    The cells of a motion hold every point that comes within radius + rho + m of a cover
    sphere along it, so points in other cells cannot be in its way. An edge's cells are
    those of its list and of its two nodes. Without an item it is the points near the
    motion, and where extra clearance is kept: then points of other cells count too.
    """
    cloud = view(state, "cloud")
    if cloud.counts[N_LISTED] == 0:
        return cloud  # shapes alone
    if (ref < 0 and ref > EDGE_BASE) or view(state, "terms").extra[0] > 0.0:
        return points_near(state, q, dq)
    picked = view(state, "picked")
    clear(picked)
    if ref >= 0:
        pool = view(state, "pool")
        begin, end = pool.begin[ref], pool.end[ref]
        pick_cells(picked, cloud.words, pool.block, pool.mask, begin, end)
    else:
        graph = view(state, "graph")
        edge = EDGE_BASE - ref
        n = graph.adj_ptr.shape[0] - 1
        a, b = np.int64(graph.edges[edge, 0]), np.int64(graph.edges[edge, 1])
        for item in (n + edge, a, b):
            pick_item(picked, cloud.words, graph, item)
    pick_points(picked, cloud, view(state, "seen").points)
    return picked


@njit(**INNER)
def where_blocked(state, ref, q, q_to, blocked_at):
    """Return the share of a motion at which the close test finds it blocked, or -1.

    It is that of item `ref`, from q to q_to. It is most likely blocked where it was the
    last time, at the share `blocked_at` (-1: it was not), which is tested first.
    """
    robot = view(state, "robot_state")
    displacement(q, q_to, robot.continuous, robot.dq)
    near = pick_ref(state, ref, q, robot.dq)
    if blocked_at >= 0.0:
        set_point(q, robot.dq, blocked_at, robot.scratch_q)
        if not place_free(state, near, robot.scratch_q):
            return blocked_at
    if near_free_again(state, near, q, robot.dq):
        return -1.0
    return view(state, "work").value[0]


@njit(**INNER)
def part_free(state, ref, q, dq):
    """Run the close test of a motion that is a part of item `ref`."""
    return near_free_again(state, pick_ref(state, ref, q, dq), q, dq)


@njit(**INNER)
def ref_free(state, ref):
    """Return True if the cells of a path's segment are free; no item is never free."""
    if ref <= EDGE_BASE:
        return edge_free(state, EDGE_BASE - ref)
    if ref >= 0:
        return pool_free(state, ref)
    return False


@njit(**INNER)
def rest_free(state, path, segment, q):
    """Test what is left of a path from q on its `segment`; return the bad one or -1.

    From off the segment the motion to its end is no part of what was certified: no
    cells are known of it, so the close test takes all points.
    """
    robot = view(state, "robot_state")
    is_off_path = view(state, "numbers").off_path[0] == 1
    for k in range(segment, path.count[0] - 1):
        off_path = k == segment and is_off_path
        ref = NO_ITEM if off_path else path.ref[k]
        if ref_free(state, ref):
            continue
        if off_path and view(state, "off_path").free[TO_END] == 0:
            return k
        begin = q if k == segment else path.q[k]
        for j in range(q.shape[0]):
            robot.dq[j] = path.q[k + 1, j] - begin[j]
        if not part_free(state, ref, begin, robot.dq):
            return k
    return -1


@njit(**INNER)
def judge_starts(state, starts):
    """Write this frame's verdict by cells of each start motion; True if any is free.

    Beside shapes alone one without cells may be: the close test costs little there.
    """
    frame = view(state, "numbers").frame[0]
    shapes_alone = view(state, "cloud").counts[N_LISTED] == 0
    any_ = False
    for k in range(starts.count[0]):
        if starts.memo[k] >> 2 == frame:
            any_ = any_ or starts.memo[k] & 3 == FREE or starts.memo[k] & 3 == MAYBE
            continue
        ref = starts.ref[k]
        if shapes_alone and ref == NO_ITEM and starts.static[k] == 1:
            starts.memo[k] = 4 * frame + MAYBE
            any_ = True
            continue
        free = starts.static[k] == 1 and ref != NO_ITEM and ref_free(state, ref)
        starts.memo[k] = 4 * frame + (FREE if free else BLOCKED)
        any_ = any_ or free
    return any_


@njit(**INNER)
def offer_starts(state, starts, most):
    """Mark up to `most` blocked start motions as MAYBE; return how many.

    The search runs their close test when they come out first. Those to the nearest
    nodes that are free.
    """
    frame = view(state, "numbers").frame[0]
    offered = 0
    for k in range(starts.count[0]):
        if offered >= most:
            break
        if starts.memo[k] != 4 * frame + BLOCKED or starts.static[k] != 1:
            continue
        if item_free(state, starts.node[k]):
            starts.memo[k] = 4 * frame + MAYBE
            offered += 1
    return offered


@njit(**INNER)
def can_leave(state, starts):
    """Return True if a start motion is free, or may be by the close test."""
    frame = view(state, "numbers").frame[0]
    for k in range(starts.count[0]):
        if starts.memo[k] == 4 * frame + FREE or starts.memo[k] == 4 * frame + MAYBE:
            return True
    return False


@njit(**INNER)
def start_clear(state, starts, k):
    """Run the close test of start motion k; its verdict is remembered."""
    q, q_to = view(state, "robot_state").q, view(state, "graph").nodes[starts.node[k]]
    blocked_at = where_blocked(state, starts.ref[k], q, q_to, starts.blocked_at[k])
    starts.blocked_at[k] = blocked_at
    verdict = FREE if blocked_at < 0.0 else REFUSED
    starts.memo[k] = 4 * view(state, "numbers").frame[0] + verdict
    return blocked_at < 0.0


@njit(**LEAN)
def clear_nodes(state, q, ids, most, kept):
    """Write to `kept` the nodes of `ids` that q can go to in this frame, in order.

    For a robot that moves: at most `most` of them. A node counts where its cells are
    free and the close test finds the motion to it free. Returns how many.
    """
    nodes, robot = view(state, "graph").nodes, view(state, "robot_state")
    n = 0
    for k in range(ids.shape[0]):
        if n == most:
            break
        if not item_free(state, ids[k]):
            continue
        displacement(q, nodes[ids[k]], robot.continuous, robot.dq)
        if close_free(state, q, robot.dq):
            kept[n] = ids[k]
            n += 1
    return n


@njit(**INNER)
def judge_goal(state, g):
    """Return True if a motion into goal g and the node it comes from are free."""
    goals = view(state, "goals")
    for a in range(goals.number[g]):
        if goal_motion_free(state, g, a) and item_free(state, goals.node[g, a]):
            return True
    return False


@njit(**INNER)
def can_enter(state, g):
    """Return True if a motion into goal g is free, or may be by the close test."""
    goals, frame = view(state, "goals"), view(state, "numbers").frame[0]
    for a in range(goals.number[g]):
        if goal_motion_free(state, g, a) or goals.memo[g, a] == 4 * frame + MAYBE:
            return True
    return False


@njit(**INNER)
def goal_motion_clear(state, g, a):
    """Run the close test of attachment a of goal g; its verdict is remembered."""
    goals = view(state, "goals")
    ref, q = goals.ref[g, a], view(state, "graph").nodes[goals.node[g, a]]
    blocked_at = where_blocked(state, ref, q, goals.q[g], goals.blocked_at[g, a])
    goals.blocked_at[g, a] = blocked_at
    verdict = FREE if blocked_at < 0.0 else REFUSED
    goals.memo[g, a] = 4 * view(state, "numbers").frame[0] + verdict
    return blocked_at < 0.0


@njit(**INNER)
def open_goal(state, g, most):
    """Look for a blocked motion into g that the close test finds free; True if any.

    Up to `most` are tested until one is free, or MAYBE; those after it are marked
    MAYBE, and tested when the search comes to them. Where none is free no search
    begins: it would visit all nodes for a goal that cannot be reached.
    """
    goals, frame = view(state, "goals"), view(state, "numbers").frame[0]
    offered = 0
    any_ = False
    for a in range(goals.number[g]):
        if offered >= most:
            break
        if goal_motion_free(state, g, a) or goals.memo[g, a] != 4 * frame + BLOCKED:
            any_ = any_ or goals.memo[g, a] == 4 * frame + MAYBE
            continue
        if item_free(state, goals.node[g, a]):
            offered += 1
            if any_:
                goals.memo[g, a] = 4 * frame + MAYBE
            else:
                any_ = goal_motion_clear(state, g, a)
    return any_


@njit(**INNER)
def is_swallowed(state, q):
    """Return True if a shape of the frame holds a part of the robot, and may hold all.

    Samples of shapes stand on their surfaces, and only these occupy cells. Where none
    is near a link, the widest sphere's centre lies deeper in the shape than its radius:
    thinner shapes need not be looked at.
    """
    solids, arm, work = view(state, "solids"), view(state, "arm"), view(state, "work")
    thickest, widest = 0.0, 0
    for k in range(solids.count[0]):
        thickest = max(thickest, inner_radius(solids, k))
    if thickest <= view(state, "terms").widest[0]:
        return False
    for i in range(arm.spheres.shape[0]):
        if arm.spheres[i, 3] > arm.spheres[widest, 3]:
            widest = i
    body_frames(arm.tree_i, arm.tree_f, q, work.frames[0])
    x, y, z = place_of(work.frames[0, arm.body[widest]], arm.spheres[widest])
    for k in range(solids.count[0]):
        if solid_distance(solids, k, x, y, z, 0.0) < 0.0:
            return True
    return False


@njit(**INNER)
def stands_free(state, q):
    """Return True if a configuration itself keeps its distance from the points."""
    still = view(state, "robot_state").still
    return place_free(state, points_near(state, q, still), q)


@njit(**LEAN)
def ends_free(state):
    """Return whether the robot can stand where it is, and at one of the goals.

    Else no search helps.
    """
    goals = view(state, "goals")
    if not stands_free(state, view(state, "robot_state").q):
        return False
    for g in range(goals.count[0]):
        if stands_free(state, goals.q[g]):
            return True
    return False


@njit(**INNER)
def judge_direct(state, g):
    """Test the straight motion to goal g: its cells, then the close test."""
    goals, q = view(state, "goals"), view(state, "robot_state").q
    frame, ref = view(state, "numbers").frame[0], goals.direct_ref[g]
    goals.direct_memo[g] = 4 * frame + BLOCKED
    if ref == NO_MOTION:
        return False
    if ref >= 0 and pool_free(state, ref):
        goals.direct_memo[g] = 4 * frame + FREE
        return True
    blocked_at = where_blocked(state, ref, q, goals.q[g], goals.direct_blocked_at[g])
    goals.direct_blocked_at[g] = blocked_at
    if blocked_at >= 0.0:
        return False
    goals.direct_memo[g] = 4 * frame + FREE
    return True
