"""Distances of many points from many others, in a moment: by scipy, not by our code."""

from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist


def to_nearest(points, others):
    """Return how far each of the points (n, 3) is from the nearest of others [m]."""
    return cKDTree(others).query(points)[0]


def out_of_spheres(points, spheres):
    """Return how far each point is outside of a union of spheres (m, 4) [m].

    Inside it is the depth in one of them, negative.
    """
    return (cdist(points, spheres[:, :3]) - spheres[:, 3]).min(axis=1)
