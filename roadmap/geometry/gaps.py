"""Distances of capsules, and of balls and capsules."""

import numpy as np


def capsule_gap(one: np.ndarray, other: np.ndarray) -> float:
    """Return the distance of the surfaces of two capsules (7,), below 0 inside [m]."""
    a, b, c, d = one[:3], one[3:6], other[:3], other[3:6]
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = u @ u, u @ v, v @ v, u @ w, v @ w
    flat = uu * vv - uv * uv
    s = min(1.0, max(0.0, (uv * vw - vv * uw) / flat)) if flat > 1e-15 else 0.0
    t = (uv * s + vw) / vv if vv > 1e-15 else 0.0
    if not 0.0 <= t <= 1.0:
        t = min(1.0, max(0.0, t))
        s = min(1.0, max(0.0, (uv * t - uw) / uu)) if uu > 1e-15 else 0.0
    elif uu <= 1e-15:
        s = 0.0
    return float(np.linalg.norm(w + s * u - t * v)) - one[6] - other[6]


def ball_gaps(balls: np.ndarray, capsules: np.ndarray) -> np.ndarray:
    """Return (n, k) gaps between balls (n, 4) and capsules (k, 7) [m]."""
    a, b = capsules[:, :3], capsules[:, 3:6]
    u = b - a
    length = np.maximum(np.einsum("ki,ki->k", u, u), 1e-12)
    off = balls[:, None, :3] - a
    s = np.clip(np.einsum("nki,ki->nk", off, u) / length, 0.0, 1.0)
    far = np.linalg.norm(off - s[..., None] * u, axis=2)
    return far - capsules[:, 6] - balls[:, 3:]


def moved_rods(capsules: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Return capsules (k, 7) of an object that is at T (4, 4) [m]."""
    rows = np.array(capsules)
    for at in (slice(0, 3), slice(3, 6)):
        rows[:, at] = rows[:, at] @ T[:3, :3].T + T[:3, 3]
    return rows
