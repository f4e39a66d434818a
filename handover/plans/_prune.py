"""Compiled loops of `prune.py`: joints of many grasps, and the first that is free.

Cheap tests come first: reach, then the hand at the grasp, which no elbow changes, then
the arm, its most dexterous joints first. What was too near last is looked at first.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from handover.plans._space import fill, pair_apart, place
from odm.exact._distances import compose
from roadmap.compiling.jit_options import BARE, BARE_INNER
from roadmap.kinematics._chain import dexterity, forward, jacobian
from roadmap.kinematics._seven import solve_all, within_reach

UNKNOWN, FREE, OUT_OF_REACH, HAND_TOUCHES, ARM_TOUCHES = -1, 0, 1, 2, 3


class Arm(NamedTuple):
    """An arm, and which pairs of the space its tests look at."""

    solver: tuple  # the arm in closed form, () for none
    chain: tuple  # the same arm, for its dexterity
    frames: np.ndarray  # (8, 12) of the chain
    jac: np.ndarray  # (6, 7)
    weighted: np.ndarray  # (7, 7)
    gram: np.ndarray  # (6, 6)
    palm: int  # body of the palm
    base_palm: np.ndarray  # (12,) pose of that body in the palm's frame
    hand: np.ndarray  # (a,) pairs that depend on the hand's pose alone
    alone: np.ndarray  # (b,) pairs of links of the arm that no finger changes
    both: np.ndarray  # (c,) pairs of the arm and its hand
    q: np.ndarray  # (dof,) working memory
    pose: np.ndarray  # (3, 12) the same


class Listed(NamedTuple):
    """Grasps of a set with all joints that reach them."""

    first: np.ndarray  # (n + 1,) rows of q that belong to a grasp
    q: np.ndarray  # (m, 7) joints of the arm
    value: np.ndarray  # (m,) their dexterity; -1: not known, -2: not free
    target: np.ndarray  # (n, 12) the palm, frame of the arm's mount
    rank: np.ndarray  # (n,) a bound on a grasp's dexterity; exact where it is free
    verdict: np.ndarray  # (n,)
    handed: np.ndarray  # (n,) bool: the hand was tested there
    blamed: np.ndarray  # (n,) pair that the hand was too near in, -1
    shut: np.ndarray  # (n, k) fingers of the closed hand
    wide: np.ndarray  # (n, k) and of the open one
    answer: np.ndarray  # (n, dof) joints of arm and closed hand, where it is free


@njit(**BARE_INNER)
def too_near(space, rows, scratch):
    """Say whether one of some pairs is too near; it moves to the front of `rows`."""
    for i in range(rows.shape[0]):
        p = rows[i]
        lower, _ = pair_apart(space, p, space.margin[p], scratch)
        if not lower >= space.margin[p]:
            for k in range(i, 0, -1):
                rows[k] = rows[k - 1]
            rows[0] = p
            return True
    return False


@njit(**BARE_INNER)
def hand_touches(space, arm, target, shut, wide, scratch):
    """Say whether the closed or the open hand is too near to something.

    target: (12,) palm in the frame of the arm's mount, which is body 0. Bodies between
    do not matter here and are left wherever they are.
    """
    parent, row, at = space.tree_i[arm.palm, 0], space.tree_f[arm.palm], arm.pose
    for k in range(12):
        at[2, k] = row[k]
    compose(target, arm.base_palm, at[0])
    compose(space.tree_f[0], at[0], at[1])
    space.tree_i[arm.palm, 0] = -1
    for k in range(12):
        row[k] = at[1, k]
    found = False
    for opened in range(2):
        fill(arm.q, arm.q[: arm.q.shape[0] - shut.shape[0]], wide if opened else shut)
        place(space, arm.q, scratch)
        if too_near(space, arm.hand, scratch):
            found = True
            break
    space.tree_i[arm.palm, 0] = parent
    for k in range(12):
        row[k] = at[2, k]
    return found


@njit(**BARE_INNER)
def arm_touches(space, arm, joints, shut, wide, scratch):
    """Say whether the arm is too near to something, its hand closed or open."""
    fill(arm.q, joints, shut)
    place(space, arm.q, scratch)
    if too_near(space, arm.alone, scratch) or too_near(space, arm.both, scratch):
        return True
    fill(arm.q, joints, wide)
    place(space, arm.q, scratch)
    return too_near(space, arm.both, scratch)


@njit(**BARE_INNER)
def rate(arm, listed, i):
    """Work out the dexterity of the joints that may take grasp i, and the best one."""
    best = 0.0
    for s in range(listed.first[i], listed.first[i + 1]):
        if listed.value[s] == -2.0:
            continue
        forward(arm.chain, listed.q[s], arm.frames)
        jacobian(arm.chain, arm.frames, arm.jac)
        value = dexterity(arm.chain, listed.q[s], arm.jac, arm.weighted, arm.gram)
        listed.value[s] = value
        best = max(best, value)
    listed.rank[i] = best


@njit(**BARE)
def solve(space, arm, targets, listed, hands, rated, scratch):
    """List the joints that reach each palm pose.

    targets: (n, 12) in the frame of the arm's mount. hands: whether the hand is tested
    here, and not later, when a grasp's turn comes. rated: the same of dexterity.
    """
    own = arm.solver
    listed.first[0] = 0
    for i in range(targets.shape[0]):
        begin(listed, i, targets[i])
        at = listed.first[i]
        n = 0
        if within_reach(own.seven, targets[i], own.room):
            if hands:
                test_hand(space, arm, listed, i, scratch)
            if listed.verdict[i] == UNKNOWN:
                q = listed.q[at:]
                n = solve_all(own.seven, targets[i], own.free, own.room, q)
        end(arm, listed, i, n, rated)


@njit(**BARE)
def begin(listed, i, target):
    """Begin the verdict on grasp i, whose palm is at a pose."""
    listed.verdict[i], listed.rank[i] = UNKNOWN, 1e300
    listed.handed[i], listed.blamed[i] = False, -1
    for k in range(12):
        listed.target[i, k] = target[k]


@njit(**BARE)
def end(arm, listed, i, n, rated):
    """Note that n joints which reach grasp i were written to its rows."""
    at = listed.first[i]
    listed.first[i + 1] = at + n
    if listed.verdict[i] != UNKNOWN:
        return
    if n == 0:
        listed.verdict[i], listed.rank[i] = OUT_OF_REACH, -1.0
        return
    for s in range(at, at + n):
        listed.value[s] = -1.0
    if rated:
        rate(arm, listed, i)


@njit(**BARE)
def test_hand(space, arm, listed, i, scratch):
    """Test the hand at grasp i."""
    target, shut, wide = listed.target[i], listed.shut[i], listed.wide[i]
    if hand_touches(space, arm, target, shut, wide, scratch):
        listed.verdict[i], listed.rank[i] = HAND_TOUCHES, -1.0
        listed.blamed[i] = arm.hand[0]
    listed.handed[i] = True


@njit(**BARE_INNER)
def is_open(space, arm, listed, i, scratch):
    """Say whether any joints reach grasp i and are free; if so, rate those that may.

    Where none are, which is often, no dexterity is worked out.
    """
    shut, wide = listed.shut[i], listed.wide[i]
    for s in range(listed.first[i], listed.first[i + 1]):
        if not arm_touches(space, arm, listed.q[s], shut, wide, scratch):
            rate(arm, listed, i)
            return True
        listed.value[s] = -2.0
    listed.verdict[i], listed.rank[i] = ARM_TOUCHES, -1.0
    return False


@njit(**BARE)
def judge(space, arm, listed, i, scratch):
    """Find out whether grasp i is free, and its most dexterous free joints."""
    if not listed.handed[i]:
        test_hand(space, arm, listed, i, scratch)
        if listed.verdict[i] != UNKNOWN:
            return
    begin, end = listed.first[i], listed.first[i + 1]
    if listed.rank[i] == 1e300 and not is_open(space, arm, listed, i, scratch):
        return
    for _ in range(begin, end):
        best = begin
        for s in range(begin, end):
            if listed.value[s] > listed.value[best]:
                best = s
        if not listed.value[best] > 0.0:
            break
        joints, shut, wide = listed.q[best], listed.shut[i], listed.wide[i]
        if not arm_touches(space, arm, joints, shut, wide, scratch):
            fill(listed.answer[i], joints, shut)
            listed.verdict[i], listed.rank[i] = FREE, listed.value[best]
            return
        listed.value[best] = -2.0
    listed.verdict[i], listed.rank[i] = ARM_TOUCHES, -1.0


@njit(**BARE)
def next_free(space, arm, listed, told, scratch):
    """Return the most dexterous free grasp that was not told yet, -1: there is none.

    told: (n,) bool: grasps that were told already; written.
    """
    n = listed.rank.shape[0]
    while True:
        best = np.int64(-1)
        for i in range(n):
            if told[i] or listed.rank[i] < 0.0:
                continue
            if best >= 0:
                if listed.rank[i] < listed.rank[best]:
                    continue
                # of equals those that may turn out worse first, then the lowest number
                if listed.rank[i] == listed.rank[best] and (
                    listed.verdict[i] == FREE or listed.verdict[best] == UNKNOWN
                ):
                    continue
            best = i
        if best < 0:
            return -1
        if listed.verdict[best] == FREE:
            told[best] = True
            return best
        if listed.rank[best] == 1e300 and listed.handed[best]:
            is_open(space, arm, listed, best, scratch)
            continue
        judge(space, arm, listed, best, scratch)


@njit(**BARE)
def judge_all(space, arm, listed, scratch):
    """Find out of every grasp whether it is free, where that is not known yet."""
    for i in range(listed.rank.shape[0]):
        if listed.verdict[i] == UNKNOWN:
            judge(space, arm, listed, i, scratch)
