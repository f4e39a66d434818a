"""Which parts of a person go on as they were expected to, and where they can be."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import INNER, LEAN

_ROUNDING = 1e-9  # [m]


class Tracks(NamedTuple):
    """What is known of the parts of a person from the frame before."""

    ends: np.ndarray  # (k, 2, 3) ends of the capsules [m]
    rate: np.ndarray  # (k, 2, 3) their velocities, 0 where they are not known [m/s]
    slack: np.ndarray  # (k,) bound on the errors of `rate` [m/s]
    frames: np.ndarray  # (k,) that each part has been followed for


class Ability(NamedTuple):
    """What the parts of a person are able to do from now on."""

    capsules: np.ndarray  # (k, 7) where they are [m]
    velocity: np.ndarray  # (k, 2, 3) of the ends, which counts where it is known [m/s]
    # (k,) bound on the error of that velocity; infinite where it is not known [m/s]
    error: np.ndarray
    most: np.ndarray  # (k,) largest acceleration now [m/s2]
    widening: np.ndarray  # (k,) how fast the radius grows [m/s]
    untouched: np.ndarray  # (k,) for how long nothing accelerates it [s]


@njit(**INNER)
def off(ends, k, before, j, passed, turned):
    """Return how far part k is from where part j was expected [m]."""
    most = 0.0
    for side in range(2):
        other = 1 - side if turned else side
        total = 0.0
        for a in range(3):
            there = before.ends[j, other, a] + passed * before.rate[j, other, a]
            total += (ends[k, side, a] - there) ** 2
        if not total <= most:  # a NaN stays one
            most = total
    return math.sqrt(most)


@njit(**INNER)
def is_within(ends, k, before, j, passed, reach):
    """Return whether part k is within `reach` of where part j was expected [m].

    With its ends in either order: their middle is as near then, mostly that says no.
    """
    for a in range(3):
        there = before.ends[j, 0, a] + passed * before.rate[j, 0, a]
        there += before.ends[j, 1, a] + passed * before.rate[j, 1, a]
        if abs(ends[k, 0, a] + ends[k, 1, a] - there) > 2.0 * (reach + _ROUNDING):
            return False
    if off(ends, k, before, j, passed, False) <= reach:
        return True
    return off(ends, k, before, j, passed, True) <= reach


@njit(**LEAN)
def follow(ends, before, passed, limits, after):
    """Write to after (k,) for how many frames each part was followed, this one too.

    1: it is another part that has taken the name, or may be: it is too far from where
    it was, or where another part of the frame before was expected, as are two that
    exchange their names. 2: it does not go on as it did, so the velocity of last time
    belonged to another, or it was pushed; the next frame tells whether this one is.

    Args:
        ends: (k, 2, 3) ends of the capsules now [m].
        before: The same parts `passed` ago.
        passed: Time between the frames [s].
        limits: (4,) noise [m], acceleration, its largest plausible value [m/s2], and
            the largest plausible speed [m/s].
        after: (k,) result.
    """
    noise, most, jump, top = limits[0], limits[1], limits[2], limits[3]
    slack, count = before.slack, before.frames
    n = ends.shape[0]
    room = 2.0 * noise + 0.5 * most * passed * passed + _ROUNDING
    for k in range(n):
        moved = 0.0
        for side in range(2):
            total = 0.0
            for a in range(3):
                total += (ends[k, side, a] - before.ends[k, side, a]) ** 2
            if not total <= moved:
                moved = total
        fits = math.sqrt(moved) <= 2.0 * noise + top * passed + _ROUNDING
        agrees = True
        if count[k] >= 2:
            error = off(ends, k, before, k, passed, False)
            allowed = room + slack[k] * passed
            if not error <= allowed:
                turned = off(ends, k, before, k, passed, True)
                fits = fits and not turned <= allowed
            if count[k] >= 3:  # its velocity was confirmed
                allowed += max(0.0, jump - most) * passed * passed
            agrees = error <= allowed
        for j in range(n):
            if fits and j != k and count[j] >= 2:
                reach = room + slack[j] * passed
                fits = not is_within(ends, k, before, j, passed, reach)
        after[k] = (count[k] + 1 if agrees else 2) if fits else 1


@njit(**INNER)
def is_known(parts, k):
    """Return whether the velocity of part k is known."""
    return abs(parts.error[k]) < math.inf


@njit(**INNER)
def speed_of(velocity, k):
    """Return the speed of part k's faster end [m/s]; NaN where one is not known."""
    most = 0.0
    for side in range(2):
        x, y, z = velocity[k, side, 0], velocity[k, side, 1], velocity[k, side, 2]
        total = x * x + z * z + y * y  # as numpy adds, for the same bytes as ever
        if most == most and not total <= most:  # a NaN stays one, of whichever end
            most = total
    return math.sqrt(most)


@njit(**INNER)
def growth(parts, k, limits, begin, end):
    """Return how much larger part k is to be from `begin` to `end`, in s [m].

    That is round where its velocity leads it by the middle of these times.
    """
    if not is_known(parts, k):
        return limits[0] + max(limits[1], parts.widening[k]) * end
    speed = speed_of(parts.velocity, k)
    pushed = max(0.0, end - parts.untouched[k])
    near = limits[0] + parts.error[k] * end + 0.5 * parts.most[k] * pushed * pushed
    harder = limits[3] * pushed * pushed * pushed / 6.0
    # as fast as a part whose velocity is not known, the other way round
    fastest = limits[0] + (limits[1] + speed) * end
    grown = max(near, min(near + harder, fastest)) + parts.widening[k] * end
    return grown + 0.5 * (end - begin) * speed


@njit(**LEAN)
def write_between(parts, limits, begin, end, rows):
    """Write capsules that hold each part from `begin` to `end`, in s, to rows (k, 7).

    Returns whether none grows by more than is looked at; else nothing is written.

    Args:
        parts: What they are able to do.
        limits: (4,) noise [m], speed of a part whose velocity is not known [m/s], most
            that a radius grows by [m], and how fast `most` grows from now on [m/s3].
        begin: When that begins, after the capsules were measured [s].
        end: When it ends [s].
        rows: Result.
    """
    n = parts.capsules.shape[0]
    for k in range(n):
        if not growth(parts, k, limits, begin, end) <= limits[2]:
            return False
    middle = 0.5 * (begin + end)
    for k in range(n):
        known = is_known(parts, k)
        for a in range(6):
            rate = parts.velocity[k, a // 3, a % 3] if known else 0.0
            rows[k, a] = parts.capsules[k, a] + middle * rate
        more = growth(parts, k, limits, begin, end)
        rows[k, 6] = parts.capsules[k, 6] + more
    return True


@njit(**LEAN)
def fastest_of(velocity, error):
    """Return the highest speed of the parts whose velocity is known [m/s].

    And the largest error of these; 0 where there is none.

    Args:
        velocity: (k, 2, 3) velocities of the ends [m/s].
        error: (k,) bounds on their errors, infinite where they are not known [m/s].
    """
    speed, worst = 0.0, 0.0
    for k in range(len(error)):
        if abs(error[k]) < math.inf:
            own = speed_of(velocity, k)
            speed = own if own > speed else speed
            worst = max(worst, error[k])
    return speed, worst


@njit(**LEAN)
def write_rates(ends, before, first, passed, rates):
    """Write (2, k, 2, 3) the mean velocities of parts since two frames [m/s].

    Args:
        ends: (k, 2, 3) ends of the capsules now [m].
        before: The same in the later of these frames.
        first: ... and in the earlier one.
        passed: (2,) time since each [s].
        rates: Result: since `before`, then since `first`.
    """
    for k in range(ends.shape[0]):
        for side in range(2):
            for a in range(3):
                here = ends[k, side, a]
                rates[0, k, side, a] = (here - before[k, side, a]) / passed[0]
                rates[1, k, side, a] = (here - first[k, side, a]) / passed[1]


@njit(**LEAN)
def write_likely(capsules, drift, times, rows):
    """Write where capsules (k, 7) will be at some times (n,) to rows (n * k, 7).

    Their ends go on at `drift` (k, 2, 3) [m/s].
    """
    k = capsules.shape[0]
    for i in range(rows.shape[0]):
        here, rates = capsules[i % k], drift[i % k]
        for a in range(6):
            rows[i, a] = here[a] + times[i // k] * rates[a // 3, a % 3]
        rows[i, 6] = here[6]


@njit(**LEAN)
def write_sharpest(times, ends, span, noise, most):
    """Raise most (k,) to the largest acceleration of each part's ends [m/s2].

    Each is that of a time and the one at least `span` and two frames before: the
    change of the mean velocity between both halves, less what the noise can make of it.

    Args:
        times: (n,) ascending [s].
        ends: (n, k, 2, 3) of the capsules then [m].
        span: [s], 0 for two frames.
        noise: Bound on the error of an end [m].
        most: Result.
    """
    for last in range(2, times.shape[0]):
        first = 0
        while times[first] < times[last] - span - 1e-9:
            first += 1
        first = min(first, last - 2)
        middle = (first + last) // 2
        h0, h1 = times[middle] - times[first], times[last] - times[middle]
        if not (h0 > 0.0 and h1 > 0.0):  # nothing is known of them
            most[:] = math.inf
            continue
        lost = 2.0 * noise * (1.0 / h0 + 1.0 / h1)
        for k in range(ends.shape[1]):
            fastest = 0.0
            for side in range(2):
                total = 0.0
                for a in range(3):
                    at = ends[middle, k, side, a]
                    change = (ends[last, k, side, a] - at) / h1
                    change -= (at - ends[first, k, side, a]) / h0
                    total += change * change
                fastest = max(fastest, total)
            sharp = (math.sqrt(fastest) - lost) / (0.5 * (h0 + h1))
            most[k] = max(most[k], sharp)
