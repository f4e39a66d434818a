"""A robot as an obstacle of another one: its links' surfaces, moved by its joints."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from odm.checks import check_configuration
from odm.obstacles import shapes as solid
from odm.obstacles.surfaces import Surface, surface_of
from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.kinematics import _forward as kernels
from roadmap.kinematics.axis_reach import joint_span, point_reach
from roadmap.kinematics.forward import body_frames, motion_per_point
from roadmap.robot.robot import Robot

PARTS = ("all", "moving", "standing")


class RobotSurface:
    """Points that stand for a robot, whatever its configuration.

    Every collision solid of every link is closed and sampled once, in the frame of its
    body, with its caps and inner faces; joints move the samples rigidly, so that the
    covering radius stays. In a frame only poses and points are computed, in memory of
    its own. The solids are those of the exact audit: hulls of meshes, boxes, cylinders,
    spheres (`Robot.solid_*`).

    Args:
        robot: The robot that is in the way of another one.
        spacing: Bound on the covering radius [m].
        parts: "all", only links that "moving" joints carry, or only "standing" ones.

    Attributes:
        covering_radius: Proved for the samples of every solid [m].
        labels: (n,) number of the closed part that each point is of.
        names: Link of each part.
        motion_bounds: (n, dof) bound on how far a point moves per unit of each joint,
            over all configurations [m per rad or m].

    Raises:
        BadInput: `spacing` is not above 0, or `parts` is unknown.
    """

    def __init__(self, robot: Robot, spacing: float = 0.03, parts: str = "all") -> None:
        if parts not in PARTS:
            raise BadInput(
                f"parts is {parts!r}; choose one of {', '.join(PARTS)} links"
            )
        self.robot = robot
        self.label = robot.name
        moves = robot.link_body[robot.solid_link] > 0
        chosen = {"all": moves | True, "moving": moves, "standing": ~moves}[parts]
        solids = np.flatnonzero(chosen)
        surfaces = [_surface_of_solid(robot, int(i), spacing) for i in solids]
        links = robot.solid_link[solids]
        counts = [len(s.points) for s in surfaces]
        self.names = tuple(robot.link_names[k] for k in links)
        self.labels = frozen(np.repeat(np.arange(len(solids)), counts), np.int64)
        self.covering_radius = max((s.covering_radius for s in surfaces), default=0.0)
        self._body = frozen(np.repeat(robot.link_body[links], counts), np.int32)
        points = [np.zeros((0, 3)), *(s.points for s in surfaces)]
        self._points = frozen(np.concatenate(points), np.float64)
        self.motion_bounds = frozen(self._motion_bounds(), np.float64)
        self._frames = np.empty((len(robot.tree_i), 12))
        self._placed = np.empty_like(self._points)
        self._turned = np.empty_like(self._points)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self._points)

    def at(self, q: np.ndarray, T_world_base: np.ndarray | None = None) -> np.ndarray:
        """Return the points at a configuration.

        Args:
            q: (dof,) configuration of the robot [rad or m].
            T_world_base: (4, 4) its base in the frame wanted; None: its own base.

        Returns:
            (n, 3) points [m]: own memory, which the next call overwrites.

        Raises:
            BadInput: `q` has the wrong length or is not finite, or the pose is not
                a rigid (4, 4) matrix.
        """
        robot = self.robot
        q = check_configuration(robot, q, None)
        if not np.isfinite(q).all():
            raise BadInput(
                f"q of the other robot is {q}: its points are nowhere; hold until its "
                "joints are known again"
            )
        kernels.body_frames(robot.tree_i, robot.tree_f, q, self._frames)
        kernels.place_points(self._frames, self._body, self._points, self._placed)
        if T_world_base is None:
            return self._placed
        T = solid.check_pose(T_world_base)
        np.dot(self._placed, np.ascontiguousarray(T[:3, :3].T), out=self._turned)
        for k in range(3):  # a row added to all points at once allocates them again
            self._turned[:, k] += T[k, 3]
        return self._turned

    def parts(
        self, q: np.ndarray, T_world_base: np.ndarray | None = None
    ) -> tuple[Surface, ...]:
        """Return the closed parts one by one, labelled with their links.

        The points are copies; arguments and errors as `at`.
        """
        points = self.at(q, T_world_base)
        return tuple(
            Surface(points[self.labels == k], self.covering_radius, name, closed=True)
            for k, name in enumerate(self.names)
        )

    def _motion_bounds(self) -> np.ndarray:
        robot = self.robot
        span = joint_span(robot.tree_i, robot.tree_f, robot.lower, robot.upper)
        reach = point_reach(robot.tree_i, robot.tree_f, span, self._body, self._points)
        return motion_per_point(robot.tree_i, robot.tree_f, reach, robot.dof)


def robot_surface(
    robot: Robot,
    q: np.ndarray,
    T_world_base: np.ndarray | None = None,
    spacing: float = 0.03,
) -> tuple[Surface, ...]:
    """Return a robot at `q` as labelled closed parts; for many frames `RobotSurface`.

    Args:
        robot: The robot that is in the way of another one.
        q: (dof,) its configuration [rad or m].
        T_world_base: (4, 4) its base in the frame wanted; None: its own base.
        spacing: Bound on the covering radius [m].

    Raises:
        BadInput: See `RobotSurface`.
    """
    return RobotSurface(robot, spacing).parts(q, T_world_base)


def solids_of(robot: Robot, links: Sequence[int] | None = None) -> list[solid.Shape]:
    """Return the collision solids of `links` (all when None) in their body frames."""
    return [
        _shape_of_solid(robot, i)
        for i, link in enumerate(robot.solid_link)
        if links is None or link in links
    ]


def standing_shapes(robot: Robot, T_world_base: np.ndarray) -> list[solid.Shape]:
    """Return the solids of the links that never move, where the base stands."""
    still = np.flatnonzero(robot.link_body == 0)
    base = body_frames(robot, np.zeros(robot.dof))[0]
    return [s.moved(T_world_base @ base) for s in solids_of(robot, still.tolist())]


def _surface_of_solid(robot: Robot, i: int, spacing: float) -> Surface:
    name = robot.link_names[robot.solid_link[i]]
    return replace(surface_of(_shape_of_solid(robot, i), spacing), label=name)


def _shape_of_solid(robot: Robot, i: int) -> solid.Shape:
    points = robot.solid_points[robot.solid_ptr[i] : robot.solid_ptr[i + 1]]
    T = robot.solid_pose[i]
    return solid.shape_of(robot.solid_kind[i], robot.solid_size[i], points, T)
