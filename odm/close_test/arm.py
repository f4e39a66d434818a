"""A robot's moving spheres as the compiled loops take them."""

import numpy as np

from odm.close_test._arm import Arm
from roadmap.robot.robot import Robot


def arm_of(robot: Robot) -> Arm:
    """Return a robot's moving spheres, sorted by body, with bounding balls.

    The arrays are copies that can be written: to numba a read-only array is another
    type, and the close test would be compiled twice.
    """
    order = moving_order(robot)
    spheres = robot.spheres[order]
    body = robot.sphere_body[order]
    n_bodies = len(robot.tree_i)
    ptr = np.searchsorted(body, np.arange(n_bodies + 1)).astype(np.int64)
    bound = np.zeros((n_bodies, 4))
    for b in range(n_bodies):
        own = spheres[ptr[b] : ptr[b + 1], :3]
        if len(own):
            center = 0.5 * (own.min(axis=0) + own.max(axis=0))
            far = np.linalg.norm(own - center, axis=1).max() * (1 + 1e-12) + 1e-12
            bound[b, :3], bound[b, 3] = center, far
    return Arm(
        np.array(robot.tree_i),
        np.array(robot.tree_f),
        np.array(spheres, float),
        np.array(body, np.int32),
        np.array(robot.sphere_reach[order], float),
        ptr,
        bound,
    )


def moving_order(robot: Robot) -> np.ndarray:
    """Return the (n,) indices in `robot.spheres` of those that move, by body."""
    moving = np.flatnonzero(robot.sphere_body > 0)
    return moving[np.argsort(robot.sphere_body[moving], kind="stable")]
