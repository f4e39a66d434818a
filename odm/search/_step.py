"""The frame's decision: go on, take a new path, or hold.

`respond` is the one call of a frame whose points were taken. It tests the candidate
that waits, else the path in use, and searches only where neither is free. A hand that
trembles comes and goes over the same place, so a search avoids where the obstacles have
lately been (`_recent.py`). That only ranks ways: what is free, and what blocks the way
in use, is decided by the frame's own points alone.
"""

import math

from numba import njit

from odm.close_test._close import displacement
from odm.search._frame import begin_shapes, begin_step, plan
from odm.search._judge import is_swallowed, rest_free, stands_free
from odm.search._paths import (
    certify_whole,
    copy_certificates,
    copy_path,
    is_on,
    locate_on_path,
    path_length,
    turns_back,
)
from odm.search._recent import (
    lay_out_recent,
    path_crosses_history,
    path_in_avoided,
    remember,
)
from odm.search._state import (
    BETTER_PATH,
    EDITED,
    NO_ITEM,
    NO_MOTION,
    PRESENT_ONLY_PATH,
    ROUNDED,
    TO_BEGIN,
    TO_END,
    WHOLE,
    show,
    view,
)
from roadmap.compiling._rows import copy_row, same_row
from roadmap.compiling.jit_options import BRIEF, INNER, LEAN
from roadmap.kinematics._limits import LIMIT_TOLERANCE, MOST_TURNED

FOLLOWING, PLANNED, NO_PATH, NOT_ATTACHED = 0, 1, 2, 3
NOT_FINITE, OUT_OF_LIMITS = 4, 5
REPLAN, OFF_PATH, BETTER = 6, 7, 8
SWALLOWED = 9  # a shape may hold the whole robot
NOT_ASKED = -1  # the frame was taken, and not answered
HAS_NO_PATH = (NO_PATH, NOT_ATTACHED)  # the roadmap has none; there may be one
DETOUR_WORTH_SEARCHING = 1.1  # times the straight distance
BETTER_EVERY = 8  # frames between two looks for a better goal
# an answer is code + SEGMENT * segment + COUNT * corners + GOAL * (goal + 1) + SAME,
# the last where the path that was taken leads on as the one before did
SEGMENT, COUNT, GOAL, SAME = 16, 1 << 16, 1 << 28, 1 << 40


@njit(**INNER)
def weighted(q_from, q_to, state):
    """Return the weighted length of the straight motion between configurations."""
    robot = view(state, "robot_state")
    displacement(q_from, q_to, robot.continuous, robot.dq)
    total = 0.0
    for j in range(q_from.shape[0]):
        d = robot.weights[j] * robot.dq[j]
        total += d * d
    return math.sqrt(total)


@njit(**INNER)
def connect_along_path(state, path, segment, q, path_ends):
    """Connect q to the two ends of the segment that it is on.

    On the segment those motions are parts of the one that was certified. Off it they
    are new: no cells are known of them, and the group `off_path` says whether they are
    free of what stands still. One that lacks the share of rounding would be in another
    path, which is rounded again (decision 0102).
    """
    graph, goals = view(state, "graph"), view(state, "goals")
    free = view(state, "off_path").free
    n = graph.adj_ptr.shape[0] - 1
    count = 0
    off_path = view(state, "numbers").off_path[0] == 1
    ref = NO_ITEM if off_path else path.ref[segment]
    for g in range(goals.count[0]):
        goals.direct_ref[g] = NO_MOTION
    for k in (TO_END, TO_BEGIN):
        if off_path and free[k] != WHOLE:
            continue
        v = path.vertex[segment + 1 - k]
        if v < n:
            path_ends.node[count] = v
            path_ends.length[count] = weighted(q, graph.nodes[v], state)
            path_ends.ref[count] = ref
            path_ends.static[count] = 1
            path_ends.memo[count] = 0
            path_ends.blocked_at[count] = -1.0
            count += 1
            continue
        for g in range(goals.count[0]):
            if goals.vertex[g] == v:
                goals.direct_ref[g] = ref
    path_ends.count[0] = count


@njit(**INNER)
def same_rest(path, where, new):
    """Return True if `new` leads over the very vertices that are ahead on `path`."""
    if where < 0 or new.count[0] < 2:
        return False
    shift = path.count[0] - new.count[0]
    if shift != where:
        return False
    for k in range(1, new.count[0]):
        if new.vertex[k] != path.vertex[k + shift]:
            return False
    return True


@njit(**INNER)
def take_configuration(state, q):
    """Keep q; return the code of what is wrong with it, or FOLLOWING."""
    robot = view(state, "robot_state")
    copy_row(q, robot.q)
    for j in range(q.shape[0]):
        if not math.isfinite(q[j]):
            return NOT_FINITE
        over = max(robot.lower[j] - q[j], q[j] - robot.upper[j])
        if robot.continuous[j]:
            over = abs(q[j]) - MOST_TURNED
        if over > LIMIT_TOLERANCE:
            view(state, "numbers").joint[0] = j
            return OUT_OF_LIMITS
    return FOLLOWING


@njit(**LEAN)
def rest_length(state, path, where, q):
    """Return the weighted length of a path from q on its segment `where`."""
    rest = weighted(q, path.q[where + 1], state)
    for k in range(where + 1, path.count[0] - 1):
        rest += weighted(path.q[k], path.q[k + 1], state)
    return rest


@njit(**INNER)
def note_move(state, q):
    """Note that a frame asks from q: whether the robot moved since the one before."""
    robot, numbers = view(state, "robot_state"), view(state, "numbers")
    copy_row(robot.q, robot.before)
    numbers.stood[0] = numbers.stood[0] + 1 if same_row(robot.q, q) else 0


@njit(**INNER)
def judge(state, q):
    """Judge the path in use: FOLLOWING, a trouble's code, or REPLAN: it needs another.

    With REPLAN numbers.where is the segment that q is on, -1 for none. With OFF_PATH q
    is off that segment, and the group `off_path` is to be filled first: for the
    candidate if one waits, else for the path in use.
    """
    robot, numbers = view(state, "robot_state"), view(state, "numbers")
    path = view(state, "path")
    trouble = take_configuration(state, q)
    if trouble != FOLLOWING:
        return trouble
    q = robot.q
    if is_swallowed(state, q):
        return SWALLOWED
    always = view(state, "rules").always[0] == 1
    if numbers.candidate[0] != 0 and not always:
        kind = numbers.candidate[0]
        if take_candidate(state, q):
            return FOLLOWING if kind == EDITED else PLANNED
        if numbers.candidate[0] != 0:
            return OFF_PATH
    numbers.rest[0] = 0
    where = -1
    if path.count[0] >= 2:
        # it may have slowed down
        where = locate_on_path(state, path, 0, q, robot.fraction)
    if where >= 0 and turns_back(path, where, q, robot.continuous):
        where = -1
    numbers.where[0] = where
    numbers.off_path[0] = 0
    if where < 0 and not is_attached(robot):
        return NOT_ATTACHED
    if where >= 0 and not is_on(view(state, "certificates"), where, q):
        numbers.off_path[0] = 1
        off_path = view(state, "off_path")
        if not is_off_path_known(off_path, path, where, q):
            return OFF_PATH
        # what rounds a corner has no other path: it goes on where that is free
        always = always and off_path.free[TO_END] != ROUNDED
    if where < 0 or always or path.count[1] < 0:
        return REPLAN
    if rest_free(state, path, where, q) >= 0:
        return REPLAN
    numbers.rest[0] = 1
    numbers.segment[0] = where
    return FOLLOWING


@njit(**LEAN)
def drop_candidate(state):
    """Forget the candidate: no item is kept for it."""
    view(state, "numbers").candidate[0] = 0
    view(state, "better").count[0] = 0


@njit(**INNER)
def take_candidate(state, q):
    """Let the candidate be the path in use where q is on it and it is free; True if so.

    It has one chance. Only where q is off its segment numbers.where it still waits: the
    group `off_path` is to be filled for that first.
    """
    numbers, robot = view(state, "numbers"), view(state, "robot_state")
    better = view(state, "better")
    certificates, kind = view(state, "candidate_certificates"), numbers.candidate[0]
    numbers.candidate[0] = 0
    where = -1
    if better.count[0] >= 2 and better.count[1] >= 0:
        where = locate_on_path(state, better, 0, q, robot.fraction)
    if where < 0 or turns_back(better, where, q, robot.continuous):
        drop_candidate(state)
        return False
    numbers.off_path[0] = 0
    if not is_on(certificates, where, q):
        numbers.off_path[0] = 1
        if not is_off_path_known(view(state, "off_path"), better, where, q):
            numbers.candidate[0], numbers.where[0] = kind, where
            return False
    if rest_free(state, better, where, q) >= 0:
        drop_candidate(state)
        return False
    copy_path(better, view(state, "path"))
    copy_certificates(certificates, view(state, "certificates"), better.count[0] - 1)
    drop_candidate(state)
    numbers.where[0] = numbers.segment[0] = where
    numbers.rest[0] = 1
    numbers.same[0] = numbers.better[0] = 0
    if kind != EDITED:
        numbers.present_only[0] = kind == PRESENT_ONLY_PATH
    return True


@njit(**LEAN)
def better_goal_stands_clear(state):
    """Return True if a goal of better rank keeps its distance from the points."""
    goals = view(state, "goals")
    if view(state, "numbers").joint_costs[0] == 1:  # then none is better by its rank
        return False
    for g in range(view(state, "path").count[1]):
        if stands_free(state, goals.q[g]):
            return True
    return False


@njit(**INNER)
def is_off_path_known(off_path, path, segment, q):
    """Return True if `off_path` was filled for this very q and segment."""
    known, end, begin = off_path.q, path.q[segment + 1], path.q[segment]
    if not (same_row(known[0], q) and same_row(known[1], end)):
        return False
    return same_row(known[2], begin)


@njit(**INNER)
def is_attached(robot):
    """Return True if q is the configuration that was connected last."""
    return same_row(robot.q, robot.q_attached)


@njit(**INNER)
def search_path(state, last):
    """Search a path from the robot to goals 0 to last - 1; True: in `found_path`."""
    goals, robot = view(state, "goals"), view(state, "robot_state")
    numbers, path = view(state, "numbers"), view(state, "path")
    start_vertex = goals.count[1]
    starts = view(state, "start_connections")
    if is_attached(robot):
        for g in range(goals.count[0]):
            goals.direct_ref[g] = goals.attached_ref[g]
    else:
        starts = view(state, "path_ends")
        connect_along_path(state, path, numbers.where[0], robot.q, starts)
        start_vertex = goals.count[2]
    for g in range(goals.count[0]):
        goals.direct_length[g] = weighted(robot.q, goals.q[g], state)
    budget = 2 * view(state, "rules").close_test_connections[0]
    numbers.avoid_history[0] = 1 if keeps_history(state) else 0
    if numbers.avoid_history[0] == 1:
        lay_out_recent(state)
    found = plan(state, starts, start_vertex, budget, last)
    numbers.avoid_history[0] = 0
    return found


@njit(**INNER)
def keeps_history(state):
    """Return True if new paths keep clear of where the obstacles have lately been."""
    rules = view(state, "rules")
    return rules.always[0] == 0 and rules.history_s[0] > 0.0


@njit(**INNER)
def replan(state):
    """Take a new path after `judge` said REPLAN: PLANNED or NO_PATH.

    Where the last path that was free only now was blocked, the next one must be there
    for `persistence_frames` frames in a row: what opens and closes as a hand trembles
    is not taken.
    """
    numbers, found_path = view(state, "numbers"), view(state, "found_path")
    found = search_path(state, view(state, "goals").count[0])
    if not keeps_history(state):
        if found:
            adopt(state)
        return PLANNED if found else NO_PATH
    persistence_frames = view(state, "rules").persistence_frames[0]
    present_only = not found or path_crosses_history(state, found_path)
    if present_only and numbers.present_only[0] == 1:
        numbers.present_only[0], numbers.frames_to_persist[0] = 0, persistence_frames
    if not found:
        numbers.frames_to_persist[0] = (
            persistence_frames if numbers.frames_to_persist[0] > 0 else 0
        )
        return NO_PATH
    if present_only:
        numbers.frames_to_persist[0] = max(0, numbers.frames_to_persist[0] - 1)
        if numbers.frames_to_persist[0] > 0:
            return NO_PATH
    else:
        numbers.frames_to_persist[0] = 0
    numbers.present_only[0] = 1 if present_only else 0
    adopt(state)
    return PLANNED


@njit(**INNER)
def better_found(state, q):
    """Look for a better path than the free one in use; True: take `found_path`.

    To a goal of better rank; or to the same, shorter by `hysteresis` and clear of where
    the obstacles have lately been. `confirmations` in a row must find one. A goal
    beside a hand is near where that has lately been, always: a path to it may be free
    only now.
    """
    numbers, robot = view(state, "numbers"), view(state, "robot_state")
    goals = view(state, "goals")
    path, found_path = view(state, "path"), view(state, "found_path")
    rules = view(state, "rules")
    rank, where = path.count[1], numbers.segment[0]
    if rank < 0 or path.count[0] < 2:
        return False
    found = search_path(state, rank + 1)
    joint = numbers.joint_costs[0] == 1
    if found and (joint or found_path.count[1] == rank):
        now = rest_length(state, path, where, q)
        new = path_length(found_path, robot.weights)
        if joint:
            new += goals.cost[found_path.count[1]] - goals.cost[rank]
        found = new < (1.0 - rules.hysteresis[0]) * now  # at its goal both are 0
        found = found and not (
            keeps_history(state) and path_in_avoided(state, found_path)
        )
    numbers.better[0] = numbers.better[0] + 1 if found else 0
    return numbers.better[0] >= rules.confirmations[0]


@njit(**INNER)
def least_possible(state):
    """Return the weighted length that a path cannot be shorter than, below 0 too.

    Where goals compete by their costs, a path to another one counts by what its goal
    costs less than the goal of the path in use.
    """
    path, goals = view(state, "path"), view(state, "goals")
    q = view(state, "robot_state").q
    least = weighted(q, path.q[path.count[0] - 1], state)
    if view(state, "numbers").joint_costs[0] == 1:
        own = goals.cost[path.count[1]]
        for g in range(goals.count[0]):
            other = weighted(q, goals.q[g], state) + goals.cost[g] - own
            least = min(least, other)
    return least


@njit(**LEAN)
def offer_better(state):
    """Look for a better path between frames; True: it is the candidate.

    It begins with all of the segment that the robot is on, so the next frame may ask
    from any place on it.
    """
    numbers, robot = view(state, "numbers"), view(state, "robot_state")
    goals = view(state, "goals")
    if numbers.rest[0] == 0 or numbers.off_path[0] == 1:
        return False
    path, found_path = view(state, "path"), view(state, "found_path")
    better = view(state, "better")
    certificates, where = view(state, "candidate_certificates"), numbers.segment[0]
    if path.count[0] < 2:
        return False
    numbers.where[0] = where
    if path.count[1] == 0 or numbers.joint_costs[0] == 1:
        rest = rest_length(state, path, where, robot.q)
        if rest <= DETOUR_WORTH_SEARCHING * least_possible(state):
            numbers.better[0] = 0
            return False
    if not better_found(state, robot.q):
        return False
    numbers.better[0] = 0
    present_only = keeps_history(state) and path_crosses_history(state, found_path)
    copy_path(found_path, better)
    first = 0
    if found_path.vertex[0] == goals.count[2] and not is_attached(robot):
        # on its segment towards one end: begin at the other
        ends = view(state, "certificates")
        towards = found_path.vertex[1] == path.vertex[where + 1]
        other = where if towards else where + 1
        copy_row(path.q[other], better.q[0])
        copy_row(ends.begin[where], certificates.begin[0])
        copy_row(ends.end[where], certificates.end[0])
        better.vertex[0] = path.vertex[other]
        first = 1
    certify_whole(better, first, certificates)
    numbers.start[0] = 0
    numbers.candidate[0] = PRESENT_ONLY_PATH if present_only else BETTER_PATH
    return True


@njit(**INNER)
def take_better(state, q):
    """Look for a path to a better goal within the frame; PLANNED or FOLLOWING."""
    numbers, found_path = view(state, "numbers"), view(state, "found_path")
    if not better_found(state, q):
        return FOLLOWING
    numbers.present_only[0] = (
        1 if keeps_history(state) and path_crosses_history(state, found_path) else 0
    )
    adopt(state)
    return PLANNED


@njit(**LEAN)
def begin_candidate(state):
    """Let the candidate be the path in use, to be changed; one that waits stays."""
    numbers, path = view(state, "numbers"), view(state, "path")
    better = view(state, "better")
    if numbers.candidate[0] != 0:
        return
    copy_path(path, better)
    own, others = view(state, "certificates"), view(state, "candidate_certificates")
    copy_certificates(own, others, path.count[0] - 1)
    numbers.start[0] = numbers.segment[0]


@njit(**INNER)
def adopt(state):
    """Take the way that a search found; numbers.same tells that it is the old one."""
    robot, numbers = view(state, "robot_state"), view(state, "numbers")
    path, found_path = view(state, "path"), view(state, "found_path")
    numbers.better[0] = 0
    drop_candidate(state)
    numbers.same[0] = 1 if same_rest(path, numbers.where[0], found_path) else 0
    copy_path(found_path, path)
    numbers.segment[0] = 0
    numbers.rest[0] = 1
    first, where, certificates = 0, numbers.where[0], view(state, "certificates")
    if where >= 0 and numbers.off_path[0] == 0 and not is_attached(robot):
        # its first segment is a part of the certified motion that q is on
        first = 1
        copy_row(certificates.begin[where], certificates.begin[0])
        copy_row(certificates.end[where], certificates.end[0])
    certify_whole(path, first, certificates)
    numbers.off_path[0] = 0


@njit(**INNER)
def packed(state, code):
    """Return a code with the numbers of the path in use: one number says all.

    What is left of the path is written to the group `ahead`, where that is the answer;
    with BETTER it may become so.
    """
    numbers, path = view(state, "numbers"), view(state, "path")
    if code == FOLLOWING or code == PLANNED or code == BETTER:
        ahead, segment = view(state, "ahead").q, numbers.segment[0]
        copy_row(view(state, "robot_state").q, ahead[0])
        for k in range(segment + 1, path.count[0]):
            copy_row(path.q[k], ahead[k - segment])
    said = code + SEGMENT * numbers.segment[0] + COUNT * path.count[0]
    return said + GOAL * (path.count[1] + 1) + SAME * numbers.same[0]


@njit(**LEAN)
def notice(state, q, now):
    """Remember what a frame showed, once, and how the robot moved [s, NaN: no time]."""
    numbers = view(state, "numbers")
    if numbers.seen[0] != numbers.step[0]:
        numbers.seen[0] = numbers.step[0]
        note_move(state, q)
        if keeps_history(state):
            remember(state, now)


@njit(**LEAN)
def respond(state, q, now):
    """Answer one frame whose points were taken; a code, packed with the path's numbers.

    The answer's path is the group `path`; numbers.segment is its segment that q is on.
    Asked again in the same frame, after q was joined to something, it goes on.
    `now` [s] is NaN where no time is given.
    """
    numbers, path = view(state, "numbers"), view(state, "path")
    notice(state, q, now)
    code = judge(state, q)
    if code == REPLAN:
        code = replan(state)
    elif code == FOLLOWING and path.count[1] > 0:
        if numbers.wish[0] == 1:
            code = take_better(state, q)
        elif numbers.step[0] % BETTER_EVERY == 0:
            if better_goal_stands_clear(state):
                code = BETTER
    numbers.wish[0] = 0
    return packed(state, code)


@njit(**BRIEF)
def step_points(state, given, points, q):
    """Take a frame's points and answer it, in one call; see `begin_step`, `respond`.

    NOT_ASKED where some points are not finite or most lie outside the grid.
    """
    if begin_step(state, given, points):
        return NOT_ASKED
    return respond(state, q, math.nan)


@njit(**BRIEF)
def step_shapes(state, given, data, counts, room, n_before, q):
    """Take a frame's points and shapes and answer it, in one call.

    NOT_ASKED where `begin_shapes` returned something else than `n_before`, the number
    of points that the frame before had; it is in numbers.taken.
    """
    show(state, "lent", 0, given)
    show(state, "lent", 1, data)
    show(state, "lent", 2, counts)
    show(state, "lent", 3, room)
    n = begin_shapes(state, given, data, counts, room)
    if n != n_before:
        view(state, "numbers").taken[0] = n
        return NOT_ASKED
    return respond(state, q, math.nan)


@njit(**BRIEF)
def step_again(state, q):
    """Take and answer a frame that comes by the very arrays of the last `step_shapes`.

    As that does; the arrays are in the table.
    """
    lent, n_before = view(state, "lent"), view(state, "seen").points.shape[0]
    n = begin_shapes(state, lent.given, lent.data, lent.counts, lent.room)
    if n != n_before:
        view(state, "numbers").taken[0] = n
        return NOT_ASKED
    return respond(state, q, math.nan)
