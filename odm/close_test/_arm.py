"""The moving robot and scratch of its close test, as compiled loops take them."""

from typing import NamedTuple

import numpy as np


class Arm(NamedTuple):
    """The moving robot, its spheres sorted by body."""

    tree_i: np.ndarray  # (n_bodies, 3)
    tree_f: np.ndarray  # (n_bodies, 17)
    spheres: np.ndarray  # (n, 4) centre in body frame, radius
    body: np.ndarray  # (n,)
    reach: np.ndarray  # (n, n_bodies)
    body_ptr: np.ndarray  # (n_bodies + 1,) spheres of a body
    bound: np.ndarray  # (n_bodies, 4) ball round the centres of a body's spheres


class Work(NamedTuple):
    """Scratch of the close test, one per planner."""

    frames: np.ndarray  # (3, n_bodies, 12)
    point: np.ndarray  # (dof,)
    speed: np.ndarray  # (n,)
    bend: np.ndarray  # (n,)
    rates: np.ndarray  # (2, n_bodies)
    body_speed: np.ndarray  # (n_bodies,)
    body_radius: np.ndarray  # (n_bodies,)
    bottom: np.ndarray  # (n_bodies,) level at which the chord test decides
    early: np.ndarray  # (n_bodies,) level from which it may free a body
    stack: np.ndarray  # (64, 2) level, index
    masks: np.ndarray  # (64, n_bodies) bodies still open
    anchor: np.ndarray  # (n, 3) centres at the start of an escape
    found: np.ndarray  # (4,) int64: sphere, point, tests, evaluations
    value: np.ndarray  # (2,) t and distance of what was found


def make_work(n_spheres: int, n_bodies: int, dof: int) -> Work:
    """Return scratch for a robot of this size."""
    return Work(
        frames=np.zeros((3, n_bodies, 12)),
        point=np.zeros(dof),
        speed=np.zeros(n_spheres),
        bend=np.zeros(n_spheres),
        rates=np.zeros((2, n_bodies)),
        body_speed=np.zeros(n_bodies),
        body_radius=np.zeros(n_bodies),
        bottom=np.zeros(n_bodies, np.int64),
        early=np.zeros(n_bodies, np.int64),
        stack=np.zeros((64, 2), np.int64),
        masks=np.zeros((64, n_bodies), np.bool_),
        anchor=np.zeros((n_spheres, 3)),
        found=np.zeros(4, np.int64),
        value=np.zeros(2),
    )
