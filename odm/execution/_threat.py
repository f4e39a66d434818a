"""Which points of a person are near, which parts go on, and how each point moves."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.geometry._segments import nearest_share

_ROUNDING = 1e-9  # [m]


class Tracks(NamedTuple):
    """What is known of the parts of a person from the frame before."""

    ends: np.ndarray  # (k, 2, 3) ends of the capsules [m]
    rate: np.ndarray  # (k, 2, 3) their velocities, 0 where they are not known [m/s]
    slack: np.ndarray  # (k,) bound on the errors of `rate` [m/s]
    frames: np.ndarray  # (k,) that each part has been followed for


@njit(cache=True, nogil=True)
def near_points(points, centers, far, near):
    """Write the points (n, 3) near a robot to near (n, 3); return how many.

    Near is at most `far` outside the box around the centers (m, 3) of its spheres, or
    anywhere, if it is not a number.
    """
    low, high = np.empty(3), np.empty(3)
    for a in range(3):
        low[a], high[a] = math.inf, -math.inf
        for i in range(centers.shape[0]):
            low[a] = min(low[a], centers[i, a])
            high[a] = max(high[a], centers[i, a])
        low[a] -= far
        high[a] += far
    n = 0
    for i in range(points.shape[0]):
        inside = True
        for a in range(3):
            inside &= not (points[i, a] <= low[a] or points[i, a] >= high[a])
        if inside or not math.isfinite(points[i, 0] + points[i, 1] + points[i, 2]):
            near[n] = points[i]
            n += 1
    return n


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def velocities(points, ends, radii, rates, part, out):
    """Write the velocities of points (n, 3) on capsules to out (r, n, 3).

    The capsules' ends stand in ends (k, 2, 3) and move by each of rates (r, k, 2, 3);
    radii (k,). A point moves with the capsule whose surface it is nearest to, written
    to part (n,), as a rigid body: as the place of the axis that it stands above, and
    with the turning of the axis.
    """
    for i in range(points.shape[0]):
        p = points[i]
        nearest, share, least = 0, 0.0, math.inf
        for k in range(radii.shape[0]):
            a, b = ends[k, 0], ends[k, 1]
            t = nearest_share(a, b, p)
            dx = p[0] - a[0] - t * (b[0] - a[0])
            dy = p[1] - a[1] - t * (b[1] - a[1])
            dz = p[2] - a[2] - t * (b[2] - a[2])
            away = abs(math.sqrt(dx * dx + dy * dy + dz * dz) - radii[k])
            if away < least:
                nearest, share, least = k, t, away
        part[i] = nearest
        a, b = ends[nearest, 0], ends[nearest, 1]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        square = ux * ux + uy * uy + uz * uz
        dx = p[0] - a[0] - share * ux
        dy = p[1] - a[1] - share * uy
        dz = p[2] - a[2] - share * uz
        for r in range(rates.shape[0]):
            u, v = rates[r, nearest, 0], rates[r, nearest, 1]
            for c in range(3):
                out[r, i, c] = (1.0 - share) * u[c] + share * v[c]
            if square > 1e-12:
                # w = axis x (v - u) / |axis|^2; and w x d is added
                px, py, pz = v[0] - u[0], v[1] - u[1], v[2] - u[2]
                wx = (uy * pz - uz * py) / square
                wy = (uz * px - ux * pz) / square
                wz = (ux * py - uy * px) / square
                out[r, i, 0] += wy * dz - wz * dy
                out[r, i, 1] += wz * dx - wx * dz
                out[r, i, 2] += wx * dy - wy * dx
