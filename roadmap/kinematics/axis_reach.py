"""How far points of the robot can get from its joint axes, over all configurations.

A joint that turns by dq moves a point by at most dq times the point's distance from
the joint's axis. That distance depends on the joints between them; here it is bounded
over all of their values, full turns included (prismatic joints within their limits).

The set a point can fill is carried from its own joint towards the base. Turning about
an axis makes it a solid of revolution, known by its profile (height along the axis,
distance from it); the profile is kept as a convex polygon *around* the true one, its
corners are circles. Heights and distances are convex functions, so their maxima over
the carried set are taken on those circles.
"""

import numpy as np

from roadmap.kinematics._axis_reach import Directions, Joints, axis_reach

# An odd number of directions, so that the middle one is the distance from the axis.
_DIRECTIONS = 33
# For what the trigonometry may round [m].
_ROUNDING = 1e-9


def point_reach(
    tree_i: np.ndarray,
    tree_f: np.ndarray,
    span: np.ndarray,
    body: np.ndarray,
    points: np.ndarray,
) -> np.ndarray:
    """Bound the distance of each point from the axis of every joint that moves it.

    Of points (n, 3) in the frames of their `body` (n,) [m], on a tree as in `Robot`
    with the joint values `span` (n_bodies, 2), from `joint_span`. Returns (n, n_bodies)
    [m]; 1 for a prismatic joint, 0 where the joint does not move the point.
    """
    groups = [points[i : i + 1] for i in range(len(points))]
    return group_reach(tree_i, tree_f, span, body, groups)


def group_reach(tree_i, tree_f, span, body, groups) -> np.ndarray:
    """Return the same for groups of points: one bound for all points of a group."""
    angles = np.linspace(0.0, np.pi, _DIRECTIONS)
    cosines, sines = np.cos(angles), np.maximum(np.sin(angles), 0.0)
    sines[[0, -1]] = 0.0
    directions = Directions(cosines, sines)
    # one type, whether of a robot or of one that is being loaded
    joints = Joints(np.array(tree_i, np.int32), np.array(tree_f, float), span)
    result = np.zeros((len(groups), len(tree_i)))
    slides = int((tree_i[:, 2] == 2).sum())
    for i, points in enumerate(groups):
        n = len(points)
        rows = max(n, _DIRECTIONS) * 2**slides
        circles = np.zeros((rows, 7))
        circles[:n, :3] = points
        circles[:, 5] = 1.0
        axis_reach(joints, int(body[i]), circles, n, directions, result[i])
    turns = (tree_i[:, 2] == 1) & (result > 0)
    return np.where(turns, result + _ROUNDING, result)


def joint_span(
    tree_i: np.ndarray, tree_f: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """Return the (n_bodies, 2) smallest and largest value of each body's joint."""
    joint = np.maximum(tree_i[:, 1], 0)
    ends = np.stack([lower[joint], upper[joint]], axis=1)
    values = tree_f[:, 15:16] * ends + tree_f[:, 16:17]
    return np.sort(values, axis=1)
