"""A robot as an obstacle of another one: its links' solids, and points on them."""

from collections.abc import Sequence

import numpy as np

from odm.checks import check_numbers
from odm.obstacles import shapes as solid
from odm.obstacles.surfaces import Surface, surface_of
from roadmap.kinematics.forward import body_frames
from roadmap.kinematics.joint_tree import check_robot
from roadmap.robot.robot import Robot
from roadmap.transforms import check_pose


def robot_surface(
    robot: Robot,
    q: np.ndarray,
    T_world_base: np.ndarray | None = None,
    spacing: float = 0.03,
) -> tuple[Surface, ...]:
    """Return a robot at `q` as closed parts, labelled with their links.

    The parts are the collision solids of all links, as the exact audit has them; each
    is sampled whole, with its caps and inner faces.

    Args:
        robot: The robot that is in the way of another one.
        q: (dof,) its configuration [rad or m].
        T_world_base: (4, 4) its base in the frame wanted; None: its own base.
        spacing: Bound on the covering radius [m].

    Raises:
        BadInput: `q` has the wrong length or is not finite, the pose is not a rigid
            (4, 4) matrix, or `spacing` is not above 0.
    """
    check_robot(robot, "solid_link")
    frames = body_frames(robot, check_numbers(robot, q, "q of the other robot"))
    if T_world_base is not None:
        frames = check_pose(T_world_base, "T_world_base") @ frames
    parts = []
    for shape, link in zip(solids_of(robot), robot.solid_link, strict=True):
        # sampled in the body's frame, where a mesh is the same at every q
        part = surface_of(shape, spacing, robot.link_names[link])
        parts.append(part.moved(frames[robot.link_body[link]]))
    return tuple(parts)


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


def _shape_of_solid(robot: Robot, i: int) -> solid.Shape:
    points = robot.solid_points[robot.solid_ptr[i] : robot.solid_ptr[i + 1]]
    T = robot.solid_pose[i]
    return solid.shape_of(robot.solid_kind[i], robot.solid_size[i], points, T)
