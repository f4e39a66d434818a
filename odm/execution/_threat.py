"""Which parts of a person go on as they were expected to."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.jit_options import INNER, LEAN

_ROUNDING = 1e-9  # [m]


class Tracks(NamedTuple):
    """What is known of the parts of a person from the frame before."""

    ends: np.ndarray  # (k, 2, 3) ends of the capsules [m]
    rate: np.ndarray  # (k, 2, 3) their velocities, 0 where they are not known [m/s]
    slack: np.ndarray  # (k,) bound on the errors of `rate` [m/s]
    frames: np.ndarray  # (k,) that each part has been followed for


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
                fits = not (
                    off(ends, k, before, j, passed, False) <= reach
                    or off(ends, k, before, j, passed, True) <= reach
                )
        after[k] = (count[k] + 1 if agrees else 2) if fits else 1
