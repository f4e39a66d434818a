"""The robot, its graph and its motions in time; knows nothing of obstacles."""

import roadmap.compiling.kernel_cache  # noqa: F401 (drops stale machine code)
from roadmap.kinematics.forward import tool_pose
from roadmap.loading.urdf import load_robot
from roadmap.motion.motion import Motion, SetPoint, time_path
from roadmap.robot.known import robot_names
from roadmap.robot.robot import Robot

__all__ = [
    "Motion",
    "Robot",
    "SetPoint",
    "load_robot",
    "robot_names",
    "time_path",
    "tool_pose",
]
