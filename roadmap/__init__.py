"""The robot and its graph: URDF, kinematics, sphere cover, self-collision, roadmap."""

from roadmap.kinematics import tool_pose
from roadmap.known import robot_names
from roadmap.motion import Motion, SetPoint, time_path
from roadmap.robot import Robot
from roadmap.urdf import load_robot

__all__ = [
    "Motion",
    "Robot",
    "SetPoint",
    "load_robot",
    "robot_names",
    "time_path",
    "tool_pose",
]
