"""The slow twin of the speed limit: each pair, straight from the standard's formula."""

import numpy as np


def naive_share(centers, moved, radii, capsules, rates, rule):
    """Return the share of speed that is allowed, by the definition."""
    reaction, stopping, lost, least, unknown = rule
    shares = [1.0]
    for c, v, r in zip(centers, moved, radii, strict=True):
        for row, rate in zip(capsules, rates, strict=True):
            s = np.linspace(0.0, 1.0, 4001)
            axis = row[:3] + s[:, None] * (row[3:6] - row[:3])
            k = int(np.linalg.norm(axis - c, axis=1).argmin())
            off = axis[k] - c
            far = np.linalg.norm(off)
            n = off / far
            person = rate[:3] + s[k] * (rate[3:] - rate[:3])
            coming = unknown if np.isnan(person).any() else max(-person @ n, 0.0)
            toward = v @ n
            if toward <= least or np.linalg.norm(v) <= least:
                continue
            gap = far - row[6] - r
            may = gap - coming * (reaction + stopping) - lost
            may = max(may / (reaction + stopping / 2), least)
            shares.append(may / toward)
    return min(shares)
