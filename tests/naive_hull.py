"""The distance of a convex hull from a segment, by its definition."""

import numpy as np
from scipy.optimize import nnls

_HEAVY = 1e4  # weight of the condition that shares add up to one


def hull_distance(points, a, b):
    """Return the distance of the hull of points (n, 3) from the segment a b [m].

    The nearest point of the hull of all differences to the origin: shares of at least
    0 that add up to 1, by non-negative least squares.
    """
    differences = np.vstack([points - a, points - b]).T
    rows = np.vstack([differences, np.full(differences.shape[1], _HEAVY)])
    shares = nnls(rows, np.r_[np.zeros(3), _HEAVY])[0]
    return float(np.linalg.norm(differences @ (shares / shares.sum())))
