"""The robot and its graph: URDF, kinematics, sphere cover, self-collision, roadmap."""

import roadmap.kept_code  # noqa: F401 (Ctrl-C waits for the compiler)
import roadmap.kernel_cache  # noqa: F401 (drops stale machine code)
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
