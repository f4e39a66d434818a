"""Certified RRT-Connect: two trees of tested motions, from the start and the goals.

A branch is a configuration and the motion to it from its parent. It was free of limits,
of the robot itself and of what stands still when it was made, which stays true; and of
the frame's obstacles in the frame that `seen` names. In a later frame it is tested
again before it is built upon, and before a path over it is answered.

J. Kuffner and S. LaValle, RRT-Connect (2000); samples are a Halton sequence; a branch
whose motions keep failing is sampled from nearby only (A. Yershova and others,
Dynamic-Domain RRTs, 2005).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from odm.close_test._close import displacement
from odm.close_test._static import Still, motion_free
from odm.search._judge import close_free, part_free, ref_free, stands_free
from odm.search._paths import apart2
from odm.search._state import view
from roadmap.compiling._rows import copy_row
from roadmap.compiling.jit_options import INNER, LEAN

SPENT, MET, FULL, CUT_OFF, IN_CONTACT, REFUSED = 0, 1, 2, 3, 4, 5
WORK = 8  # of what `search_beyond` returns: how it ended, and so many times its work
ROOT = -1  # parent of the start; of goal g: ROOT - g
DEAD = -1000
STRIDE = 1.4  # [rad or m, weighted] longest motion between two branches
NEARBY = 4  # every so many-th sample is drawn near a branch,
SPREAD = 0.7  # [rad or m] this far from it, twice or four times as far
# [rad] most that a continuous joint turns in a motion: the short way is sure
TURN = 2.5
STATIC_COST = 8  # evaluations that a test against what stands still counts for
LOOK_COST = 256  # branches looked at for one evaluation
MOST_FAILED = 60  # draws in a row without a cut, after which shortening ends
WORTH = 0.98  # of what it replaces a cut must be shorter than
SAME_SHARE = 1e-9  # of a leg: that is a corner
PRIMES = np.array([2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53])


class Problem(NamedTuple):
    """What motions are tested against."""

    state: np.ndarray  # the planner's table
    still: Still
    scratch: tuple  # of the self-collision


@njit(**INNER)
def halton(index, base):
    """Return element `index` of the van der Corput sequence in a base, in [0, 1)."""
    value, share = 0.0, 1.0
    while index > 0:
        share /= base
        value += share * (index % base)
        index //= base
    return value


@njit(**INNER)
def draw(trees, robot, side):
    """Write the next sample to trees.sample; some are drawn near a branch."""
    trees.drawn[0] += 1
    number = trees.drawn[0]
    i = np.int64(halton(number, 61) * trees.count[side])
    spread = 0.0
    if number % NEARBY == 0:
        spread = SPREAD * (1 << (number // NEARBY) % 3)
    for j in range(robot.lower.shape[0]):
        u = halton(trees.drawn[0], PRIMES[j % PRIMES.shape[0]])
        low, high = robot.lower[j], robot.upper[j]
        if robot.continuous[j]:
            low, high = -math.pi, math.pi
        if spread > 0.0:
            at = trees.q[side, i, j]
            u = 2.0 * u - 1.0
            trees.sample[j] = at + spread * u
            if not robot.continuous[j]:
                trees.sample[j] = min(high, max(low, trees.sample[j]))
        else:
            trees.sample[j] = low + u * (high - low)


@njit(**INNER)
def nearest(problem, side, q):
    """Return the branch of a tree that is nearest to q, and how far it is."""
    trees, robot = view(problem.state, "trees"), view(problem.state, "robot_state")
    best, at = math.inf, -1
    for i in range(trees.count[side]):
        far = apart2(trees.q[side, i], q, robot)
        if far < best:
            best, at = far, i
    trees.looked[0] += trees.count[side]
    return at, math.sqrt(best)


@njit(**INNER)
def begin_work(problem):
    """Begin to count; what was counted before must not decide where a search ends."""
    trees = view(problem.state, "trees")
    trees.static[0], trees.looked[0] = 0, 0
    trees.tests[0] = view(problem.state, "work").found[3]


@njit(**INNER)
def work_done(problem):
    """Return the work since `begin_work`, in configurations that are looked at."""
    trees = view(problem.state, "trees")
    tests = view(problem.state, "work").found[3] - trees.tests[0]
    return tests + STATIC_COST * trees.static[0] + trees.looked[0] // LOOK_COST


@njit(**INNER)
def passes(problem, q, dq):
    """Return whether a motion within the limits passes all other tests."""
    if not close_free(problem.state, q, dq):
        return False
    view(problem.state, "trees").static[0] += 1
    return motion_free(problem.still, q, dq, problem.scratch)


@njit(**INNER)
def certify(problem, q, dq, q_to):
    """Return whether the motion q + dq, which ends at q_to, passes all tests.

    Both ends are within limits, so all of it is. The end is looked at first: most
    motions of a search that are blocked are blocked there.
    """
    return stands_free(problem.state, q_to) and passes(problem, q, dq)


@njit(**INNER)
def grow(problem, side, near, q, far):
    """Add a branch from `near` towards q, at distance `far`; return it, or -1.

    At most STRIDE long; trees.reached tells whether it ends at q.
    """
    trees, robot = view(problem.state, "trees"), view(problem.state, "robot_state")
    if trees.count[side] == trees.parent.shape[1]:
        return -1
    begin = trees.q[side, near]
    displacement(begin, q, robot.continuous, trees.dq)
    share = min(1.0, STRIDE / far) if far > 0.0 else 1.0
    for j in range(q.shape[0]):
        if robot.continuous[j] and share * abs(trees.dq[j]) > TURN:
            share = TURN / abs(trees.dq[j])
    new = trees.count[side]
    end = trees.q[side, new]
    for j in range(q.shape[0]):
        end[j] = q[j] if share == 1.0 else begin[j] + share * trees.dq[j]
    displacement(begin, end, robot.continuous, trees.dq)
    if not certify(problem, begin, trees.dq, end):
        return -1
    trees.parent[side, new] = near
    trees.seen[side, new] = view(problem.state, "numbers").frame[0]
    trees.count[side] = new + 1
    trees.reached[0] = share == 1.0
    return new


@njit(**INNER)
def drop(trees, side, branch):
    """Remove a branch and all that grew from it; the others keep their order."""
    n, kept = trees.count[side], branch
    trees.moved[branch] = DEAD
    for i in range(branch):
        trees.moved[i] = i
    for i in range(branch + 1, n):
        parent = trees.parent[side, i]
        if parent >= 0 and trees.moved[parent] == DEAD:
            trees.moved[i] = DEAD
            continue
        trees.moved[i] = kept
        trees.parent[side, kept] = trees.moved[parent] if parent >= 0 else parent
        trees.seen[side, kept] = trees.seen[side, i]
        for j in range(trees.q.shape[2]):
            trees.q[side, kept, j] = trees.q[side, i, j]
        kept += 1
    trees.count[side] = kept


@njit(**INNER)
def is_still_free(problem, side, branch):
    """Test the motion to a branch against this frame, once; drop it where blocked."""
    trees, robot = view(problem.state, "trees"), view(problem.state, "robot_state")
    now = view(problem.state, "numbers").frame[0]
    parent = trees.parent[side, branch]
    if trees.seen[side, branch] == now:
        return True
    end = trees.q[side, branch]
    free = stands_free(problem.state, end)
    if free and parent >= 0:
        begin = trees.q[side, parent]
        displacement(begin, end, robot.continuous, trees.dq)
        free = close_free(problem.state, begin, trees.dq)
    if free:
        trees.seen[side, branch] = now
    else:
        drop(trees, side, branch)
    return free


@njit(**INNER)
def chain_free(problem, side, branch):
    """Test all motions from the root to a branch against this frame."""
    trees = view(problem.state, "trees")
    i = np.int64(branch)
    while i >= 0:
        if not is_still_free(problem, side, i):
            return False
        i = np.int64(trees.parent[side, i])
    return True


@njit(**INNER)
def add_root(problem, side, q, parent):
    """Add a root to a tree, unless it is there or the robot cannot stand there."""
    trees = view(problem.state, "trees")
    for i in range(trees.count[side]):
        if trees.parent[side, i] == parent:
            return is_still_free(problem, side, i)
    new = trees.count[side]
    if new == trees.parent.shape[1]:
        return False
    if not stands_free(problem.state, q):
        return False
    copy_row(q, trees.q[side, new])
    trees.parent[side, new] = parent
    trees.seen[side, new] = view(problem.state, "numbers").frame[0]
    trees.count[side] = new + 1
    return True


@njit(**LEAN)
def search_beyond(problem, is_new, budget, shortening):
    """Grow both trees, and shorten the path over them where they meet.

    `is_new`: what stands still was not asked about the robot's place yet; REFUSED: it
    is in the way. IN_CONTACT: in this frame the robot cannot stand there, or at none of
    the goals. Returns how it ended, and WORK times higher what was spent of `budget`.
    """
    robot = view(problem.state, "robot_state")
    if is_new and not motion_free(problem.still, robot.q, robot.still, problem.scratch):
        return REFUSED
    if not plant(problem):
        return IN_CONTACT
    code = connect(problem, budget)
    spent = work_done(problem)
    if code == MET:
        shorten(problem, shortening)
    return code + WORK * spent


@njit(**INNER)
def plant(problem):
    """Let the trees begin at the robot and at the goals; False: one is in contact."""
    state = problem.state
    goals, trees = view(state, "goals"), view(state, "trees")
    full = trees.parent.shape[1]
    if trees.count[0] == full or trees.count[1] == full:
        trees.count[:] = 0
    if not add_root(problem, 0, view(state, "robot_state").q, ROOT):
        return False
    for g in range(goals.count[0]):
        add_root(problem, 1, goals.q[g], ROOT - g)
    return trees.count[1] > 0


@njit(**INNER)
def connect(problem, budget):
    """Grow both trees until they meet, or the budget is spent.

    The budget is counted in configurations at which the close test looks; a test of
    what stands still counts for STATIC_COST of them, and so on. With MET the path is
    written to trees.route, trees.corners many.
    """
    state = problem.state
    trees, robot = view(state, "trees"), view(state, "robot_state")
    begin_work(problem)
    full = trees.parent.shape[1]
    while work_done(problem) < budget:
        if trees.count[0] == 0 or trees.count[1] == 0:
            return CUT_OFF
        if trees.count[0] == full or trees.count[1] == full:
            return FULL
        a = 0 if trees.count[0] <= trees.count[1] else 1
        b = 1 - a
        draw(trees, robot, a)
        near, far = nearest(problem, a, trees.sample)
        if not is_still_free(problem, a, near):
            continue
        new = grow(problem, a, near, trees.sample, far)
        if new < 0:
            continue
        other, far = nearest(problem, b, trees.q[a, new])
        if not is_still_free(problem, b, other):
            continue
        trees.reached[0] = False
        while other >= 0 and not trees.reached[0]:
            far = math.sqrt(apart2(trees.q[b, other], trees.q[a, new], robot))
            last = other
            other = grow(problem, b, last, trees.q[a, new], far)
        if other < 0:
            continue
        if not chain_free(problem, a, new) or not chain_free(problem, b, other):
            continue
        if write_route(problem, a, new, other):
            return MET
    return SPENT


@njit(**INNER)
def write_route(problem, a, new, other):
    """Write the path over a branch of tree `a` and one of the other, the same place."""
    trees = view(problem.state, "trees")
    ends = (new, other) if a == 0 else (other, new)
    n = 0
    i = np.int64(ends[0])
    while i >= 0:
        i = np.int64(trees.parent[0, i])
        n += 1
    m, i = 0, np.int64(ends[1])
    while i >= 0:
        i = np.int64(trees.parent[1, i])
        m += 1
    total = n + m - 1
    if total > trees.route.shape[0]:
        return False
    k, i = n - 1, np.int64(ends[0])
    while i >= 0:
        copy_row(trees.q[0, i], trees.route[k])
        i = np.int64(trees.parent[0, i])
        k -= 1
    k, i = n - 1, np.int64(ends[1])
    while i >= 0:
        copy_row(trees.q[1, i], trees.route[k])
        trees.goal[0] = ROOT - trees.parent[1, i]
        i = np.int64(trees.parent[1, i])
        k += 1
    trees.corners[0] = total
    return True


@njit(**INNER)
def point_on(trees, continuous, u, out):
    """Write the point at share u of the route's length to `out`; return its leg."""
    last = trees.corners[0] - 2
    path_ends = u * trees.until[last + 1]
    k = 0
    while k < last and trees.until[k + 1] <= path_ends:
        k += 1
    length = trees.until[k + 1] - trees.until[k]
    s = (path_ends - trees.until[k]) / length if length > 0.0 else 0.0
    displacement(trees.route[k], trees.route[k + 1], continuous, trees.dq)
    for j in range(out.shape[0]):
        out[j] = trees.route[k, j] + s * trees.dq[j]
    if s < SAME_SHARE:
        copy_row(trees.route[k], out)
    elif s > 1.0 - SAME_SHARE:
        copy_row(trees.route[k + 1], out)
    return k


@njit(**INNER)
def measure(trees, robot):
    """Write the length of the route up to each of its corners to trees.until."""
    trees.until[0] = 0.0
    for k in range(1, trees.corners[0]):
        leg = math.sqrt(apart2(trees.route[k - 1], trees.route[k], robot))
        trees.until[k] = trees.until[k - 1] + leg


@njit(**INNER)
def leg_passes(problem, q_from, q_to):
    """Return whether the motion between two places within limits passes all tests.

    One that turns a continuous joint so far that the short way is unsure does not.
    """
    trees, robot = view(problem.state, "trees"), view(problem.state, "robot_state")
    displacement(q_from, q_to, robot.continuous, trees.dq)
    moves = False
    for j in range(q_from.shape[0]):
        moves = moves or trees.dq[j] != 0.0
        if robot.continuous[j] and abs(trees.dq[j]) > TURN:
            return False
    return not moves or passes(problem, q_from, trees.dq)


@njit(**INNER)
def lay_out(trees, i, j, a, b):
    """Let the route lead from corner i over `a` and `b` to corner j + 1."""
    route, n = trees.route, trees.corners[0]
    shift = i + 3 - (j + 1)
    order = range(n - 1, j, -1) if shift > 0 else range(j + 1, n)
    for k in order:
        for d in range(a.shape[0]):
            route[k + shift, d] = route[k, d]
    copy_row(a, route[i + 1])
    copy_row(b, route[i + 2])
    trees.corners[0] = n + shift


@njit(**INNER)
def shorten(problem, budget):
    """Cut corners of the route between drawn points."""
    trees, robot = view(problem.state, "trees"), view(problem.state, "robot_state")
    begin_work(problem)
    a, b = trees.ends[0], trees.ends[1]
    failed, k = 0, 0
    measure(trees, robot)
    while work_done(problem) < budget and trees.corners[0] > 2 and failed < MOST_FAILED:
        k += 1
        u, w = halton(k, 2), halton(k, 3)
        if k == 1:  # all of it at once
            u, w = 0.0, 1.0
        i = point_on(trees, robot.continuous, min(u, w), a)
        j = point_on(trees, robot.continuous, max(u, w), b)
        failed += 1
        if i == j or trees.corners[0] + 2 > trees.route.shape[0]:
            continue
        total = abs(w - u) * trees.until[trees.corners[0] - 1]
        if math.sqrt(apart2(a, b, robot)) > WORTH * total:
            continue
        if not leg_passes(problem, a, b):
            continue
        # parts of what was tested are motions of their own
        if not leg_passes(problem, trees.route[i], a):
            continue
        if not leg_passes(problem, b, trees.route[j + 1]):
            continue
        lay_out(trees, i, j, a, b)
        merge(problem)
        measure(trees, robot)
        failed = 0


@njit(**INNER)
def merge(problem):
    """Leave out corners of the route that another one is at the same place as."""
    trees, robot = view(problem.state, "trees"), view(problem.state, "robot_state")
    kept, n = 0, trees.corners[0]
    for k in range(1, n):
        other = apart2(trees.route[kept], trees.route[k], robot) > 0.0
        if other or (k == n - 1 and kept == 0):
            kept += 1
        if other or k == n - 1:  # the goal as it was given
            copy_row(trees.route[k], trees.route[kept])
    trees.corners[0] = kept + 1


@njit(**LEAN)
def free_from(state, k):
    """Return the corner from which found path k is free to its end; -1: from none.

    Where only its last corner is left, that is none.
    """
    found, robot = view(state, "found"), view(state, "robot_state")
    last = found.count[k] - 1
    first = last
    while first > 0:
        ref, begin = found.ref[k, first - 1], found.q[k, first - 1]
        for j in range(begin.shape[0]):
            robot.dq[j] = found.q[k, first, j] - begin[j]
        if not ref_free(state, ref) and not part_free(state, ref, begin, robot.dq):
            break
        first -= 1
    return first if first < last else -1
