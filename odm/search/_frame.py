"""One frame from scratch: points to occupancy, then a path to the first goal."""

from numba import njit

from odm.obstacles._cloud import (
    N_BAD,
    N_HEEDED,
    N_INSIDE,
    N_LISTED,
    N_OCCUPIED,
    N_OUTSIDE,
)
from odm.obstacles._occupancy import clear, mark_more
from odm.obstacles._solid_samples import (
    FINE,
    lay_patterns,
    take_solids,
    write_samples,
)
from odm.obstacles._world_frame import dilate_points
from odm.search._astar import a_star
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
from odm.search._paths import take_shortcuts, unwind, write_way
from odm.search._state import view

# What the close test may add where cells block all motions: HOPELESS: the start is in
# contact; NO_ENTRY, NO_EXIT: no motion into the goal, or from the start; NOTHING: none
# that was not known; SEARCH: some, which a search may use
HOPELESS, NO_ENTRY, NO_EXIT, NOTHING, SEARCH = range(5)


# what a frame's shapes may come to, beside how they were taken
MORE_POINTS, MORE_PATTERNS, WRONG = -1, -2, -3


@njit(cache=True, nogil=True)
def take_points(state, points, heeded):
    """Begin a frame: forget the old points, mark the new; return how many are bad.

    The close test heeds the first `heeded` of them; the others are samples of shapes,
    which it knows as they are.
    """
    cloud, extra = view(state, "cloud"), view(state, "terms").extra[0]
    clear(cloud)
    mark_more(points, 0, heeded, cloud)
    cloud.counts[N_HEEDED] = heeded
    cloud.counts[N_LISTED] = cloud.counts[N_OCCUPIED]
    mark_more(points, heeded, points.shape[0], cloud)
    if extra > 0.0:
        dilate_points(points, extra, cloud)
    sign_frame(cloud, view(state, "graph").region, view(state, "search").sign)
    view(state, "numbers").frame[0] += 1
    for count in view(state, "stats"):
        count[0] = 0
    return cloud.counts[N_BAD]


@njit(cache=True, nogil=True)
def begin_step(state, given, points):
    """Begin a step of the planner with its frame's points, copied to `points`.

    Returns True where some are not finite or most lie outside the grid.
    """
    view(state, "numbers").step[0] += 1
    view(state, "solids").count[0] = 0
    for i in range(points.shape[0]):
        points[i, 0], points[i, 1] = given[i, 0], given[i, 1]
        points[i, 2] = given[i, 2]
    bad = take_points(state, points, points.shape[0])
    counts = view(state, "cloud").counts
    return bad > 0 or counts[N_OUTSIDE] > counts[N_INSIDE]


@njit(cache=True, nogil=True)
def begin_shapes(state, given, shapes, T, room, reach):
    """Begin a step with points and shapes; return how many points there are in all.

    The points (n, 3) are copied to `room`, and the samples of the shapes follow them.

    Args:
        state: The table.
        given: (n, 3) points that the close test heeds.
        shapes: Their rows, and how many there are of each kind; see `take_solids`.
        T: (4, 4) pose of the frame of the shapes in the base frame.
        room: (m, 3) where all points go.
        reach: Centre of the grid and how far samples count (4,).

    Returns:
        Points in all, or MORE_POINTS or MORE_PATTERNS: what there was no room for,
        nothing was begun; or WRONG - what is wrong with a shape.
    """
    data, counts = shapes
    solids, patterns = view(state, "solids"), view(state, "patterns")
    code = take_solids(data, counts, T, solids, patterns)
    n = given.shape[0]
    if code == FINE:
        if lay_patterns(solids, patterns) != FINE:
            return MORE_PATTERNS
        n = write_samples(solids, patterns, reach, room, n)
    if n > room.shape[0]:
        patterns.wrong[0] = n
        return MORE_POINTS
    view(state, "numbers").step[0] += 1
    for i in range(given.shape[0]):
        room[i, 0], room[i, 1], room[i, 2] = given[i, 0], given[i, 1], given[i, 2]
    take_points(state, room[:n], given.shape[0])
    return n if code == FINE else WRONG - code


@njit(cache=True, nogil=True)
def plan(state, points, starts, start_vertex, most):
    """Plan from scratch from own.q to the goals in rank order; with costs to all.

    Of motions whose cells are occupied the close test is asked about `most` at either
    end. Returns True and writes the path `spare` when one was found.
    """
    goals, joint = view(state, "goals"), view(state, "numbers").joint_costs[0] == 1
    judged = False
    any_start = False
    leaves = True  # the start may be left by one of its motions
    for g in range(goals.count[0]):
        if judge_direct(state, points, g) and not joint:
            go_straight(state, start_vertex, g)
            return True
        if not leaves:
            continue
        if not judged:
            any_start = judge_starts(state, starts)
            judged = True
        can_enter = judge_goal(state, g)
        if joint:
            continue
        entry = -1
        if any_start and can_enter:
            entry = a_star(state, points, starts, g)
        if entry < 0:
            offered = offer(state, points, starts, g, any_start, can_enter, most)
            if offered == HOPELESS:
                return False
            if offered == NO_ENTRY:
                continue
            if offered == NO_EXIT:
                leaves = False
                continue
            any_start = True
            if offered == SEARCH:
                entry = a_star(state, points, starts, g)
            leaves = entry >= 0 or can_leave(state, starts)
        if entry >= 0 and write_way(state, starts, entry, start_vertex):
            take_shortcuts(state)
            return True
    if not joint:
        return False
    if not any_start:
        offer_starts(state, starts, most)
    entry = a_star(state, points, starts, -1)
    if entry >= 0 and write_way(state, starts, entry, start_vertex):
        take_shortcuts(state)
        return True
    return False


@njit(cache=True, nogil=True)
def offer(state, points, starts, g, any_start, can_enter, most):
    """Offer motions whose cells are occupied to the search; see SEARCH and its like.

    `any_start`, `can_enter`: there is a motion from the start, or into goal g, whose
    cells are free.
    """
    if not any_start and not stands_free(state, points, view(state, "own").q):
        return HOPELESS
    if not can_enter:
        if not stands_free(state, points, view(state, "goals").q[g]):
            return NO_ENTRY
        if not open_goal(state, points, g, most):
            return NO_ENTRY
    if not any_start:
        return SEARCH if offer_starts(state, starts, most) > 0 else NO_EXIT
    if not can_enter:
        return SEARCH
    opened = open_goal(state, points, g, most)
    opened = offer_starts(state, starts, most) > 0 or opened
    return SEARCH if opened else NOTHING


@njit(cache=True, nogil=True)
def go_straight(state, start_vertex, g):
    """Let the path `spare` be the straight motion to goal g."""
    way, goals, own = view(state, "spare"), view(state, "goals"), view(state, "own")
    way.count[0] = 2
    way.count[1] = g
    way.vertex[0] = start_vertex
    way.vertex[1] = goals.vertex[g]
    way.ref[0] = goals.direct_ref[g]
    way.q[0] = own.q
    way.q[1] = goals.q[g]
    unwind(way, own.continuous)
