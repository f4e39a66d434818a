"""A small arm that may carry something, and what it carries."""

from dataclasses import replace

import numpy as np
from small import draw_arm, small_recipe

import odm
from odm.cell_map.recipe import PayloadRecipe
from odm.exact.distances import ExactRobot
from roadmap.kinematics.forward import difference

CENTER, RADIUS = np.array([0.1, 0.0, 0.02]), 0.12  # the map's envelope
BALLS = np.array([[0.1, 0.0, 0.02, 0.06], [0.16, 0.0, 0.0, 0.04]])
BRICK = odm.Box([0.1, 0.06, 0.12])
# the small arm may stand so with BALLS in its hand: nearer to the floor it may not
HIGH, OVER = np.array([0.7, 0.4, 0.0]), np.array([-0.7, -0.4, 0.0])
SHIFT = np.block([[np.eye(3), CENTER[:, None]], [np.zeros((1, 3)), 1.0]])


def build_carrying_map(folder):
    """Build, store and load the quick map of the small arm with an envelope."""
    envelope = PayloadRecipe(radius=RADIUS, position=tuple(CENTER))
    odm.build_map(replace(small_recipe(), payload=envelope)).save(folder)
    return odm.load_map(folder)


def arm_points(rng):
    """Draw a human arm, and its points."""
    arm = draw_arm(rng)
    return arm, odm.sample_capsules(arm, 0.03)


def capsules(arm):
    """Return its capsules as shapes."""
    return [odm.Capsule.between(row[:3], row[3:6], row[6]) for row in arm]


def exact_gap(robot, shapes, q_a, q_b, n=9):
    """Return the least exact distance at n places of a motion [m]."""
    exact = ExactRobot(robot)
    dq = difference(robot, q_a, q_b)
    places = [q_a + t * dq for t in np.linspace(0.0, 1.0, n)]
    return min(exact.distance(q, shapes).distance for q in places)
