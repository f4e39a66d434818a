"""Where a scripted person stands: before the robot's work places, wherever they are."""

import numpy as np

from roadmap.kinematics.forward import tool_pose
from roadmap.robot.robot import Robot
from sim.people.human_motion import HumanMotion, motion_names
from sim.people.placed import Placed
from sim.people.scenes import Scene

# the scripts are written for work places on both sides of here, base frame [m]
SCRIPTED_FOR = (0.42, 0.0, 0.23)
NEAR = 0.10  # what lies nearer to it than this leaves the person where it is [m]


def before_work_places(
    motion: HumanMotion, robot: Robot, places: np.ndarray
) -> HumanMotion:
    """Return a scripted motion with the person moved along with the work places.

    A scene (`sim.people.scenes`) is staged before them. Other motions (recorded ones,
    keys) stand where they were told to.

    Args:
        motion: The person.
        robot: The robot.
        places: (n, dof) its work places.
    """
    if isinstance(motion, Scene):
        return motion.before(robot, places)
    if motion.name not in motion_names():
        return motion
    tools = [tool_pose(robot, q)[:3, 3] for q in places]
    offset = np.mean(tools, axis=0) - SCRIPTED_FOR
    return motion if np.linalg.norm(offset) < NEAR else Placed(motion, offset=offset)
