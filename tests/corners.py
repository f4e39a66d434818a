"""Corners of joint paths, and the limits of motions over them."""

import moving
import numpy as np
from moving import DT

from roadmap.kinematics.forward import sphere_centers

ROBOTS = ("panda", "gantry", "crane")  # of tests/roadmap/conftest.py


def draw_corner(robot, rng, sharp):
    """Return a corner and unit directions before and behind it."""
    q = robot.lower + rng.random(robot.dof) * (robot.upper - robot.lower)
    u = rng.normal(size=robot.dof)
    w = rng.normal(size=robot.dof) if sharp else u + 0.1 * rng.normal(size=robot.dof)
    if rng.random() < 0.3:  # some joints stand still
        u[rng.integers(robot.dof)] = w[rng.integers(robot.dof)] = 0.0
    return q, u / np.linalg.norm(u), w / np.linalg.norm(w)


def cancelling(robot, q, size=1e-6):
    """Return the unit direction in which joints at q move all centres least."""
    steps = size * np.eye(robot.dof)
    ways = [sphere_centers(robot, q + d) - sphere_centers(robot, q - d) for d in steps]
    return np.linalg.svd(np.array([way.ravel() for way in ways]).T)[2][-1]


def draw_tricky(robot, rng):
    """Return a corner whose turn cancels in the corner itself, but not beside it."""
    q = robot.lower + rng.random(robot.dof) * (robot.upper - robot.lower)
    n, along = cancelling(robot, q), rng.normal(size=robot.dof)
    along -= (along @ n) * n
    along, angle = along / np.linalg.norm(along), rng.uniform(0.1, 1.3)
    u, w = (along * np.cos(angle) + n * np.sin(s) for s in (-angle, angle))
    return q, u, w


def legs_at(q, u, w, size=3.0):
    return np.array([q - size * u, q, q + size * w])


def check_limits(robot, motion, dt=DT):
    """The motion keeps its limits from its beginning to its end."""
    times = np.arange(0.0, motion.duration + 2 * dt, dt)
    moving.check_limits(robot, motion.sample(times), dt)
