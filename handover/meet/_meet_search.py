"""Best-first search in the interaction workspace [Vahrenkamp2016, Algorithm 2, line 4].

A bound below the k-th best known quality ends the matter; equal ones go on, so that
ties are decided by the key as in the full grid.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from handover.meet._meet import Candidate, Scene, Scratch, hand_value
from handover.meet._meet_bounds import (
    LOOSE_BYTE,
    Bounds,
    byte_passes,
    fill_spins,
    grip_bound,
    now_turn,
    position_bounds,
)
from handover.meet._meet_pose import UNREACHED
from roadmap.compiling.jit_options import BARE_INNER, FULL

# what is counted: positions opened, bytes compared, grips bounded, hand poses solved
POSITIONS, BYTES, GRIPS, SOLVED = range(4)
GRIP_WORK, SOLVED_WORK = 0.1, 0.9  # in hundreds of compared bytes


class Entries(NamedTuple):
    """Numbers (n,) of the robot's cells, which are out, and scratch, all False."""

    keys: np.ndarray
    removed: np.ndarray
    seen: np.ndarray


class Top(NamedTuple):
    """The best k so far: (k,) quality, key, entry and grasp, best first."""

    value: np.ndarray
    key: np.ndarray
    entry: np.ndarray
    grasp: np.ndarray


class Search(NamedTuple):
    """What a search needs."""

    scene: Scene  # person, hands and cells
    entries: Entries  # keys, and which are removed; nothing is seen before and after
    bounds: Bounds  # the bounds by place are filled in, the rest is working memory
    top: Top  # written; its size is k
    scratch: Scratch  # working memory; its counts grow


@njit(**BARE_INNER)
def put(top, key, e, g, value, n):
    """Insert an entry into the best n so far, ordered by value, then by key."""
    k = top.value.shape[0]
    at = n
    while at > 0 and (
        value > top.value[at - 1]
        or (value == top.value[at - 1] and key < top.key[at - 1])
    ):
        at -= 1
    if at >= k:
        return n
    last = min(n, k - 1)
    for i in range(last, at, -1):
        top.value[i], top.key[i] = top.value[i - 1], top.key[i - 1]
        top.entry[i], top.grasp[i] = top.entry[i - 1], top.grasp[i - 1]
    top.value[at], top.key[at], top.entry[at], top.grasp[at] = value, key, e, g
    return min(n + 1, k)


@njit(**FULL)
def begin(task, warm, order):
    """Look at the entries of `warm` (m,), then order the positions by their bounds.

    `warm` are the last best; they are `seen` from now on. `order` gets the positions
    that may count, the best bound first. Returns the entries in `top`, and the
    positions in order.
    """
    person, hands, cells = task.scene
    bounds, top = task.bounds, task.top
    removed, seen = task.entries.removed, task.entries.seen
    n = 0
    k = top.value.shape[0]
    now_turn(person, bounds.now)
    fill_spins(person, hands.pose, bounds)
    for i in range(warm.shape[0]):
        e = warm[i]
        if removed[e] or seen[e]:
            continue
        p = np.searchsorted(cells.first, e, side="right") - 1
        n = _look(task, p, e, 0, n)
        seen[e] = True
    whole = bounds.whole
    position_bounds(person, hands, cells, bounds)
    n_open = 0
    floor = top.value[k - 1] if n == k else 0.0
    for p in range(whole.shape[0]):
        if whole[p] >= floor:
            order[n_open] = p
            n_open += 1
    bound = np.empty(n_open)
    places = np.empty(n_open, np.int64)
    for i in range(n_open):
        places[i], bound[i] = order[i], -whole[order[i]]
    ranked = np.argsort(bound)
    for i in range(n_open):
        order[i] = places[ranked[i]]
    return n, n_open


@njit(**FULL)
def go_on(task, order, at, n, budget):
    """Open the next positions, until the work counted passes the budget.

    `at` is the next one of `order` (m,), n the entries in `top`; no less than a
    position is opened, see `done_of`. Returns both anew, m where the search is over.
    """
    top, whole, counts = task.top, task.bounds.whole, task.scratch.counts
    k, m = top.value.shape[0], order.shape[0]
    most = done_of(counts) + budget
    while at < m:
        floor = top.value[k - 1] if n == k else 0.0
        if whole[order[at]] < floor:
            return m, n
        n = _open(task, order[at], n)
        at += 1
        if done_of(counts) >= most:
            break
    return at, n


@njit(**BARE_INNER)
def done_of(counts):
    """Return the work of a search so far, in hundreds of compared bytes, about."""
    compared = 0.01 * counts[BYTES] + 0.2 * counts[POSITIONS]
    return compared + GRIP_WORK * counts[GRIPS] + SOLVED_WORK * counts[SOLVED]


@njit(**BARE_INNER)
def _open(task, p, n):
    """Look at the entries of a position whose bound by the byte passes."""
    person, hands, cells = task.scene
    bounds, top, counts = task.bounds, task.top, task.scratch.counts
    online = bounds.online[p]
    place_online, place, lack = bounds.place_online, bounds.place, bounds.lack
    removed, seen = task.entries.removed, task.entries.seen
    counts[POSITIONS] += 1
    counts[BYTES] += (cells.first[p + 1] - cells.first[p]) * hands.pose.shape[1]
    k = top.value.shape[0]
    box, dexterity = person.box, person.dexterity
    pose, turned, rotation = hands.pose, hands.cell, cells.rotation
    same, at = hands.same, -1
    n_grasps, share = pose.shape[1], person.scales[0]
    inverse = box[7]
    x, y, z = cells.points[p, 0], cells.points[p, 1], cells.points[p, 2]
    nx, ny, nz = int(box[4]), int(box[5]), int(box[6])
    floor = top.value[k - 1] if n == k else 0.0
    far = (floor - online) * 255.0 / max(1.0 - share, 1e-9) - LOOSE_BYTE
    need, dead = 0.0, False
    single = same[1:].all()  # one place for all grasps, as of a fist turned about a rod
    scale = 255.0 / max(1.0 - share, 1e-9)
    for e in range(cells.first[p], cells.first[p + 1]):
        r = rotation[e]
        for g in range(n_grasps):
            if not same[g]:
                at = -1
                i = int(math.floor((x + pose[r, g, 9] - box[0]) * inverse))
                j = int(math.floor((y + pose[r, g, 10] - box[1]) * inverse))
                m = int(math.floor((z + pose[r, g, 11] - box[2]) * inverse))
                need, dead = far, far > 0.0
                if 0 <= i < nx and 0 <= j < ny and 0 <= m < nz:
                    at = (i * ny + j) * nz + m
                    dead = place[at] < floor
                    need = (floor - place_online[at]) * scale - LOOSE_BYTE
            if dead:
                if single:
                    break
                continue
            byte = 0
            if at >= 0:
                byte = dexterity[at, turned[r, g]]
            if byte >= need + lack[r, g]:
                if not removed[e] and not seen[e]:
                    n = _look(task, p, e, g, n)
                    floor = top.value[k - 1] if n == k else 0.0
                    far = (floor - online) * scale - LOOSE_BYTE
                break
    return n


@njit(**BARE_INNER)
def _look(task, p, e, first, n):
    """Bound the grasps of entry e from `first` on, solve those that may count."""
    person, hands, cells = task.scene
    bounds, top, scratch = task.bounds, task.top, task.scratch
    k, r = top.value.shape[0], cells.rotation[e]
    x, y, z = cells.points[p, 0], cells.points[p, 1], cells.points[p, 2]
    best, best_g = UNREACHED, -1
    floor = top.value[k - 1] if n == k else 0.0
    for g in range(first, hands.wrist.shape[1]):
        one = Candidate(r, g, x, y, z)
        if not byte_passes(person, hands, bounds, p, one, floor):
            continue
        scratch.counts[GRIPS] += 1
        if grip_bound(person, hands, bounds, one, floor, scratch.parts) < floor:
            continue
        scratch.counts[SOLVED] += 1
        found = hand_value(person, hands, one, floor, scratch)
        if found > best:
            best, best_g = found, g
            floor = max(floor, found)
    if best >= 0.0:
        n = put(top, task.entries.keys[e], e, best_g, best, n)
    return n
