"""A robot as an obstacle of another one: the spheres of its cover, moved by its joints.

The cover holds every solid of the links, so spheres that keep clear keep the links
clear. A sphere is moved with its link as a rigid body, and so holds the same part of it
in every configuration: how far its centre gets is all that its motion can add.
"""

import numpy as np

from odm.checks import check_configuration
from odm.obstacles.obstacles import Obstacles
from roadmap.arrays import as_floats, frozen
from roadmap.errors import BadInput
from roadmap.kinematics.forward import motion_per_point, sphere_centers
from roadmap.ranges import check_kind
from roadmap.robot.robot import Robot
from roadmap.transforms import check_pose, moved_points


class RobotSpheres:
    """The moving links of a robot as spheres.

    Args:
        robot: The robot that is in the way of another one. While it holds something
            give its planner's `static.robot`, which has the spheres of that, too.

    Attributes:
        radii: (n,) radii of the spheres [m].
        motion_bounds: (n, dof) bound on how far a centre moves per unit of each joint,
            over all configurations [m per rad or m].
    """

    def __init__(self, robot: Robot) -> None:
        """Take the spheres of the links that joints move."""
        remedy = "give what load_robot returns, or the robot of a map"
        check_kind("robot", robot, Robot, remedy)
        self.robot, self._chosen = robot, np.flatnonzero(robot.moving)
        self.radii = frozen(robot.spheres[self._chosen, 3], np.float64)
        reach = np.asarray(robot.sphere_reach)[self._chosen]
        links = (robot.link_names[k] for k in robot.sphere_link[self._chosen])
        self._labels = {"spheres": tuple(f"{k} of the other robot" for k in links)}
        bounds = motion_per_point(robot.tree_i, robot.tree_f, reach, robot.dof)
        self.motion_bounds = frozen(bounds, np.float64)

    def __len__(self) -> int:
        return len(self.radii)

    def at(self, q: np.ndarray, T_world_base: np.ndarray | None = None) -> np.ndarray:
        """Return (n, 4) centres and radii at a configuration [m].

        Args:
            q: (dof,) configuration of the robot [rad or m].
            T_world_base: (4, 4) its base in the frame wanted; None: its own base.

        Raises:
            BadInput: `q` has the wrong length or is not finite, or the pose is not
                a rigid (4, 4) matrix.
        """
        q = check_configuration(self.robot, q, None)
        if not np.isfinite(q).all():
            raise BadInput(
                f"q of the other robot is {q}: its links are nowhere; hold until its "
                "joints are known again"
            )
        rows = np.empty((len(self), 4))
        rows[:, :3] = sphere_centers(self.robot, q)[self._chosen]
        rows[:, 3] = self.radii
        if T_world_base is not None:
            T = check_pose(T_world_base, "T_world_base")
            rows[:, :3] = moved_points(rows[:, :3], T)
        return rows

    def obstacles(self, q: np.ndarray, T_world_base: np.ndarray) -> Obstacles:
        """Return the robot at a configuration as `planner.step` takes it; see `at`."""
        found = Obstacles(spheres=self.at(q, T_world_base))
        found.labels = self._labels
        return found

    def moved(self, dq: np.ndarray) -> np.ndarray:
        """Return (n,) how far a centre gets where joint j moves by dq[j], at most [m].

        Args:
            dq: (dof,) [rad or m]; by seconds, it is how fast [m/s].

        Raises:
            BadInput: It is no (dof,) array of numbers.
        """
        dq = as_floats("dq", dq)
        if dq.shape != (self.robot.dof,):
            raise BadInput(
                f"dq has shape {dq.shape}; give ({self.robot.dof},), one for each joint"
            )
        return self.motion_bounds @ np.abs(dq)
