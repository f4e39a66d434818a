"""Distances of capsules, of balls and capsules, of capsules and boxes; balls moved."""

import numpy as np

from roadmap.arrays import writable
from roadmap.geometry import _gaps as kernels


def least_gap(rods: np.ndarray, others: np.ndarray) -> float:
    """Return the least distance of some capsules from others, both (k, 7) [m].

    Between their surfaces, below 0 inside; infinite where there are none, and NaN where
    one is not finite.
    """
    return kernels.least_gap(writable(rods), writable(others))


def ball_gaps(balls: np.ndarray, capsules: np.ndarray) -> np.ndarray:
    """Return (n, k) gaps between balls (n, 4) and capsules (k, 7) [m]."""
    gaps = np.empty((len(balls), len(capsules)))
    kernels.ball_gaps(writable(balls), writable(capsules), gaps)
    return gaps


def moved_rods(capsules: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return capsules (k, 7) of an object that is at T (4, 4) [m]."""
    rows, R, origin = np.array(capsules), T[:3, :3].T, T[:3, 3]
    rows[:, :3] = rows[:, :3] @ R + origin
    rows[:, 3:6] = rows[:, 3:6] @ R + origin
    return rows


def beads(rods: np.ndarray, n: int) -> np.ndarray:
    """Return n balls along each of some capsules (k, 7), as (n * k, 4) [m]."""
    s = np.linspace(0.0, 1.0, n)[:, None, None]
    middles = rods[:, :3] + s * (rods[:, 3:6] - rods[:, :3])
    radii = np.tile(rods[:, 6], n)[:, None]
    return np.hstack([middles.reshape(-1, 3), radii])


def meet_box(
    rods: np.ndarray, middle: np.ndarray, turn: np.ndarray, half: np.ndarray
) -> np.ndarray:
    """Return (n,) bool: which capsules (n, 7) touch a box, or are in it.

    `middle` (3,) [m] and `turn` (3, 3), whose columns are its axes, place the box, and
    `half` (3,) are its half sides [m]. The whole length of a capsule is asked.
    """
    a, b = (rods[:, :3] - middle) @ turn, (rods[:, 3:6] - middle) @ turn
    wide = half + rods[:, 6:7]
    near = ((np.minimum(a, b) <= wide) & (np.maximum(a, b) >= -wide)).all(axis=1)
    meets = np.zeros(len(rods), bool)
    gaps = _box_distances(a[near], b[near] - a[near], half)
    meets[near] = gaps <= rods[near, 6]
    return meets


def _box_distances(a: np.ndarray, d: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Return (n,) distances of segments a + [0, 1] d, (n, 3) each, from a box [m].

    Half the slope of the squared distance along a segment is linear between the places
    where it passes the plane of a face, and never falls: it is least where that is 0.
    """
    n, slanted = len(a), np.where(d == 0.0, 1.0, d)
    passes = [np.where(d == 0.0, 0.0, (face - a) / slanted) for face in (half, -half)]
    t = np.clip(np.hstack([*passes, np.zeros((n, 1)), np.ones((n, 1))]), 0.0, 1.0)
    t.sort(axis=1)
    p = a[:, None] + t[..., None] * d[:, None]
    slope = ((p - np.clip(p, -half, half)) * d[:, None]).sum(axis=2)
    rises, rows = (slope < 0.0).sum(axis=1), np.arange(n)
    low, high = np.maximum(rises - 1, 0), np.minimum(rises, t.shape[1] - 1)
    falls, grows = slope[rows, low], slope[rows, high]
    steep = grows > falls
    share = np.where(steep, -falls / np.where(steep, grows - falls, 1.0), 0.0)
    share = np.clip(share, 0.0, 1.0)
    least = t[rows, low] + share * (t[rows, high] - t[rows, low])
    nearest = a + least[:, None] * d
    return np.linalg.norm(nearest - np.clip(nearest, -half, half), axis=1)
