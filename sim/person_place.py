"""Where a scripted person stands: before the robot's work places, wherever they are."""

from dataclasses import dataclass

import numpy as np

from roadmap.arrays import frozen
from roadmap.kinematics import tool_pose
from roadmap.robot import Robot
from sim.human_motion import HumanMotion, motion_names
from sim.scenes import Scene

# the scripts are written for work places on both sides of here, base frame [m]
SCRIPTED_FOR = (0.42, 0.0, 0.23)
NEAR = 0.10  # what lies nearer to it than this leaves the person where it is [m]


@dataclass(frozen=True, eq=False)
class Moved:
    """A motion of a person who stands elsewhere.

    Attributes:
        motion: The motion as it was written.
        offset: (3,) how far away from there the person stands [m].
    """

    motion: HumanMotion
    offset: np.ndarray

    def __post_init__(self) -> None:
        """Freeze the offset."""
        object.__setattr__(self, "offset", frozen(self.offset, np.float64))

    @property
    def name(self) -> str:
        """Name of the motion."""
        return self.motion.name

    @property
    def max_speed(self) -> float:
        """No point of the surface advances faster than this [m/s]."""
        return self.motion.max_speed

    def capsules(self, t: float) -> np.ndarray:
        """Return the person at time `t` [s] as (k, 7) capsules a, b, radius [m]."""
        capsules = np.array(self.motion.capsules(t))
        capsules[:, :3] += self.offset
        capsules[:, 3:6] += self.offset
        return capsules


def before_work_places(
    motion: HumanMotion, robot: Robot, places: np.ndarray
) -> HumanMotion:
    """Return a scripted motion with the person moved along with the work places.

    A scene (`sim.scenes`) is staged before them. Other motions (recorded ones, keys)
    stand where they were told to.

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
    return motion if np.linalg.norm(offset) < NEAR else Moved(motion, offset)
