"""Paths to time, and whether a timed one keeps its limits."""

import numpy as np

DT = 1e-3


def draw_path(robot, rng, corners, size=1.0):
    lower, upper = np.maximum(robot.lower, -2.5), np.minimum(robot.upper, 2.5)
    middle, half = 0.5 * (lower + upper), 0.5 * size * (upper - lower)
    return middle + half * rng.uniform(-1, 1, (corners, robot.dof))


def check_limits(robot, points, dt=DT):
    """Values by name and by difference stay within the limits."""
    q, dq, ddq = points
    slack = 1.0 + 1e-6
    assert (np.abs(dq) <= slack * robot.max_velocity).all()
    assert (np.abs(ddq) <= slack * robot.max_acceleration).all()
    jerk = np.diff(ddq, axis=0) / dt
    assert (np.abs(jerk) <= 1.001 * robot.max_jerk + 1e-6).all()
    # what is said of velocity and acceleration is what happens
    assert np.allclose(np.diff(q, axis=0) / dt, 0.5 * (dq[1:] + dq[:-1]), atol=2e-3)
    within = max(0.5, 0.3 * dt * robot.max_jerk.max())  # the jerk may jump meanwhile
    means = 0.5 * (ddq[1:] + ddq[:-1])
    assert np.allclose(np.diff(dq, axis=0) / dt, means, atol=within)
