"""The robot and its graph: URDF, kinematics, sphere cover, self-collision, roadmap."""

from roadmap.kinematics import tool_pose
from roadmap.robot import Robot
from roadmap.urdf import load_robot

__all__ = ["Robot", "load_robot", "tool_pose"]
