"""One frame from scratch: points to occupancy, then a path to the first goal."""

import numpy as np
from numba import njit

from odm.obstacles._cloud import (
    N_BAD,
    N_GIVEN,
    N_INSIDE,
    N_LISTED,
    N_OCCUPIED,
    N_OUTSIDE,
)
from odm.obstacles._occupancy import clear, dilate_points, mark_more, place
from odm.obstacles._solid_samples import FINE, lay_patterns, take_solids, write_samples
from odm.search._astar import ALL, a_star, search_to
from odm.search._bound import (
    NO_EXIT_SIDE,
    NO_WAY,
    SHORTEST,
    forget_proof,
    goes_on_shut,
    keep_proof,
    what_holds,
    write_shortest,
)
from odm.search._items import sign_frame
from odm.search._judge import (
    can_leave,
    judge_direct,
    judge_goal,
    judge_starts,
    offer_starts,
    open_goal,
    stands_free,
)
from odm.search._paths import take_shortcuts, unwrap, write_path
from odm.search._recent import ref_in_avoided
from odm.search._state import clock_ns, show, view
from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import INNER, LEAN

# What the close test finds where the cells block all motions. HOPELESS: the start is in
# contact; NO_ENTRY, NO_EXIT: no motion into the goal, or from the start, is free;
# NOTHING: none that was not known before; SEARCH: some, which a search may use
HOPELESS, NO_ENTRY, NO_EXIT, NOTHING, SEARCH = range(5)


# what a frame's shapes may come to, beside how they were taken
MORE_POINTS, MORE_PATTERNS, WRONG = -1, -2, -3
ODD = 1 << 40  # added to the number of points where these cannot be used as they are


@njit(**LEAN)
def take_points(state, points, n_given):
    """Begin a frame: forget the old points, mark the new; return how many are bad.

    The close test counts the first `n_given` of them; the others are samples of shapes,
    whose exact distance it takes. All loops take the points from the group `seen`, so
    they must stay where they are until the next frame.
    """
    return take(state, points[:0], points, n_given)


@njit(**INNER)
def take(state, given, points, n_given):
    """As `take_points`; the given points are copied to `points` first, if any are."""
    cloud, extra = view(state, "cloud"), view(state, "terms").extra[0]
    show(state, "seen", 0, points)
    clear(cloud)
    mark_more(given, points, 0, n_given, cloud)
    cloud.counts[N_GIVEN] = n_given
    cloud.counts[N_LISTED] = cloud.counts[N_OCCUPIED]
    mark_more(points[:0], points, n_given, points.shape[0], cloud)
    if extra > 0.0:
        dilate_points(points, extra, cloud)
    search = view(state, "search")
    sign_frame(cloud, view(state, "graph").region, search.signature)
    search.hits[0] = 0
    view(state, "numbers").frame[0] += 1
    stats = view(state, "stats")
    for count in stats:
        count[0] = 0
    stats.step[0] = view(state, "numbers").step[0]
    stats.blocks[0], stats.bad[0] = cloud.counts[N_OCCUPIED], cloud.counts[N_BAD]
    stats.inside[0], stats.outside[0] = cloud.counts[N_INSIDE], cloud.counts[N_OUTSIDE]
    stats.marked[0] = clock_ns()
    return cloud.counts[N_BAD]


@njit(**INNER)
def take_given(state, T, given, points):
    """As `take_points`, of points (n, 3) in the world, T (4, 4) in the base frame.

    The first n of `points` hold them then, and the rest what it held. As they are
    where the base is at the world's origin: no sum with zeros alters them.
    """
    n = given.shape[0]
    for a in range(3):
        for b in range(4):
            if T[a, b] != (1.0 if a == b else 0.0):
                place(given, T, points)
                return take(state, given[:0], points, n)
    return take(state, given, points, n)


@njit(**LEAN)
def begin_step(state, given, points):
    """Begin a step of the planner with its frame's points, copied to `points`.

    Returns True where some are not finite or most lie outside the grid.
    """
    view(state, "numbers").step[0] += 1
    view(state, "solids").count[0] = 0
    bad = take_given(state, view(state, "patterns").base_world, given, points)
    counts = view(state, "cloud").counts
    return bad > 0 or counts[N_OUTSIDE] > counts[N_INSIDE]


@njit(**LEAN)
def begin_shapes(state, given, data, counts, room):
    """Begin a step with points and shapes; return how many points there are in all.

    The points are copied to `room` in the base frame, and the samples of the shapes
    follow them.

    `given` (n, 3) are points in the world that count in the close test, `data` and
    `counts` the shapes (see `take_solids`), `room` (m, 3) is where all points go.

    Returns:
        Points in all, and ODD where some are not finite or most lie outside the grid;
        or MORE_POINTS or MORE_PATTERNS: what there was no room for, nothing was begun;
        or WRONG - what is wrong with a shape.
    """
    solids, patterns = view(state, "solids"), view(state, "patterns")
    code = take_solids(data, counts, patterns.base_world, solids, patterns)
    n = given.shape[0]
    if code == FINE:
        if lay_patterns(solids, patterns) != FINE:
            return MORE_PATTERNS
        n = write_samples(solids, patterns, room, n)
    if n > room.shape[0]:
        patterns.wrong[0] = n
        return MORE_POINTS
    view(state, "numbers").step[0] += 1
    odd = take_given(state, patterns.base_world, given, room[:n])
    if code != FINE:
        return WRONG - code
    counts = view(state, "cloud").counts
    return n + ODD if odd > 0 or counts[N_OUTSIDE] > counts[N_INSIDE] else n


@njit(**LEAN)
def sample_again(state, room, n):
    """Write the samples of the frame's shapes behind row n of `room`, where these are.

    Returns how many points that makes; only as many as there is room for are written.
    """
    return write_samples(view(state, "solids"), view(state, "patterns"), room, n)


@njit(**INNER)
def plan(state, starts, start_vertex, most, last):
    """Plan from scratch from robot_state.q to goals 0 to last - 1 in rank order.

    With costs to all of them. Of motions whose cells are occupied the close test is
    asked about `most` at either end. Where numbers.avoid_history is 1, cells where the
    obstacles have lately been cost a toll. True where `found_path` is a path.
    """
    numbers, goals = view(state, "numbers"), view(state, "goals")
    joint = numbers.joint_costs[0] == 1
    judged = any_start = False
    numbers.exhausted[0] = 0
    leaves = True  # the start may be left by one of its motions
    avoid_history = numbers.avoid_history[0] == 1
    for g in range(goals.count[0] if joint else last):
        straight = judge_direct(state, g)
        # one that is to be wary of is but a path among others
        if straight and not joint:
            if not (
                avoid_history and leaves and ref_in_avoided(state, goals.direct_ref[g])
            ):
                go_straight(state, start_vertex, g)
                return True
        if not leaves:
            continue
        if not judged:
            any_start = judge_starts(state, starts)
            judged = True
        if joint:
            judge_goal(state, g)
            continue
        entry, run = -1, numbers.run[0]
        held = what_holds(state, starts, start_vertex, g, goals.h[g])
        if held == SHORTEST and not avoid_history:
            write_shortest(state, starts, start_vertex, g)
            return True
        any_start = judge_starts(state, starts)  # the close test was asked of some
        can_enter = judge_goal(state, g)
        if any_start and can_enter and held != NO_WAY:
            entry = search_to(state, starts, g, False)
        if entry < 0 and straight:
            go_straight(state, start_vertex, g)
            return True
        if held == NO_WAY:
            continue
        if entry < 0:
            offered = offer(state, starts, g, any_start, can_enter, most)
            if offered == HOPELESS:
                return False
            if offered == NO_EXIT:
                numbers.exhausted[0], leaves = NO_EXIT_SIDE, False
            if offered == NO_ENTRY or offered == NO_EXIT:
                continue
            any_start = True
            if offered == SEARCH and not goes_on_shut(state, starts, g, run):
                entry = search_to(state, starts, g, not can_enter and not straight)
            leaves = entry >= 0 or can_leave(state, starts)
        keep_run(state, starts, start_vertex, g, entry, run)
        if take_entry(state, starts, entry, start_vertex):
            return True
    return joint and plan_jointly(state, starts, start_vertex, any_start, most)


@njit(**INNER)
def plan_jointly(state, starts, start_vertex, any_start, most):
    """Search to all goals by their costs; True where `found_path` is a path."""
    if not any_start:
        offer_starts(state, starts, most)
    entry = a_star(state, starts, np.int64(-1), ALL)  # compiled once, as an int64
    return take_entry(state, starts, entry, start_vertex)


@njit(**INNER)
def take_entry(state, starts, entry, start_vertex):
    """Let `found_path` be that of a heap entry, shortened; False where it is none."""
    if entry < 0 or not write_path(state, starts, entry, start_vertex):
        return False
    take_shortcuts(state)
    return True


@njit(**INNER)
def keep_run(state, starts, start_vertex, g, entry, run):
    """Keep what the searches after number `run` showed of goal g, if they did.

    Where tolls were paid, that path is not the shortest.
    """
    numbers = view(state, "numbers")
    if numbers.run[0] == run:
        return
    if entry < 0 and numbers.exhausted[0] == 0:
        forget_proof(state)
    elif entry >= 0 and numbers.avoid_history[0] != 0:
        forget_proof(state)
    else:
        keep_proof(state, starts, start_vertex, g, entry)


@njit(**INNER)
def offer(state, starts, g, any_start, can_enter, most):
    """Offer motions whose cells are occupied to the search; see SEARCH and its like.

    `any_start`, `can_enter`: there is a motion from the start, or into goal g, whose
    cells are free.
    """
    if not any_start and not stands_free(state, view(state, "robot_state").q):
        return HOPELESS
    if not can_enter:
        if not stands_free(state, view(state, "goals").q[g]):
            return NO_ENTRY
        if not open_goal(state, g, most):
            return NO_ENTRY
    if not any_start:
        return SEARCH if offer_starts(state, starts, most) > 0 else NO_EXIT
    if not can_enter:
        return SEARCH
    opened = open_goal(state, g, most)
    opened = offer_starts(state, starts, most) > 0 or opened
    return SEARCH if opened else NOTHING


@njit(**INNER)
def go_straight(state, start_vertex, g):
    """Let `found_path` be the straight motion to goal g."""
    path, goals = view(state, "found_path"), view(state, "goals")
    robot = view(state, "robot_state")
    path.count[0] = 2
    path.count[1] = g
    path.vertex[0] = start_vertex
    path.vertex[1] = goals.vertex[g]
    path.ref[0] = goals.direct_ref[g]
    copy_row(robot.q, path.q[0])
    copy_row(goals.q[g], path.q[1])
    unwrap(path.q, path.count[0], robot.continuous)
