"""`odm run --carry`: a ball in the robot's hand, planned with, audited and drawn."""

from typing import TYPE_CHECKING

import numpy as np

from odm.cell_map.payload import required
from roadmap.kinematics.forward import tool_pose
from roadmap.loading.held_link import with_payload
from roadmap.robot.robot import Robot
from roadmap.transforms import moved_points

if TYPE_CHECKING:
    from odm import ReactivePlanner


def take_ball(planner: "ReactivePlanner", radius: float | None) -> Robot:
    """Attach a ball at the middle of the map's envelope; return the robot with it.

    Its radius is in metres; None: nothing is attached.
    """
    if radius is None:
        return planner.robot
    center = required(planner.cell_map).recipe.position
    planner.attach(np.array([[*center, radius]]))
    return with_payload(planner.robot, planner.attached)


def ball_rows(robot: Robot, spheres: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return spheres (n, 4) of the tool frame as (n, 7) capsules where they are [m]."""
    T = tool_pose(robot, q)
    centers = moved_points(spheres[:, :3], T)
    return np.hstack([centers, centers, spheres[:, 3:]])
