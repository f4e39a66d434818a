"""Draws robot and person from the sphere cover alone: pictures without pybullet."""

from contextlib import AbstractContextManager

import numpy as np

from odm import CellMap
from roadmap.errors import BadRobot
from roadmap.kinematics.forward import cover_balls
from roadmap.loading.held_link import with_payload
from roadmap.robot.robot import Robot
from sim.draw.style import FURNITURE, LOAD, person_colours
from sim.draw.surroundings import balls_of
from sim.draw.viewpoint import Camera
from sim.draw.world import SimulatorMissing, World

LINKS = (0.90, 0.90, 0.91), (0.78, 0.80, 0.83)
LIGHT = np.array([-0.25, 0.65, 0.72])  # towards the lamp, in the camera's frame
BEAD = 0.006  # distance of the balls a capsule is drawn with [m]


class CoverWorld(AbstractContextManager):
    """In place of `sim.draw.world.World` without pybullet: draws the cover."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        link = np.asarray(robot.sphere_link) % 2
        self._colours = np.array(LINKS)[link]
        self._balls = self._still = np.zeros((0, 7))

    def __exit__(self, *_: object) -> None:
        """Do nothing: nothing is open."""

    def place(self, q: np.ndarray, capsules: np.ndarray, things: int = 0) -> None:
        """Set the robot to `q` (dof,) and the person to (k, 7) capsules [m].

        The last `things` of them are an object, and are drawn as one.
        """
        balls = [self._still, np.hstack([cover_balls(self._robot, q), self._colours])]
        clad = person_colours(len(capsules) - things)
        for row, colour in zip(
            capsules, (*clad, *[np.array(LOAD)] * things), strict=True
        ):
            length = np.linalg.norm(row[3:6] - row[:3])
            s = np.linspace(0.0, 1.0, 2 + int(length / BEAD))[:, None]
            beads = row[:3] + s * (row[3:6] - row[:3])
            rest = np.tile(np.r_[row[6], colour], (len(s), 1))
            balls.append(np.hstack([beads, rest]))
        self._balls = np.vstack(balls)

    def stand(self, triangles: np.ndarray) -> None:
        """Draw triangles (n, 3, 3) of what stands around, too [m]."""
        balls = balls_of(triangles)
        colours = np.tile(FURNITURE, (len(balls), 1))
        self._still = np.vstack([self._still, np.hstack([balls, colours])])

    def picture(self, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Draw the world.

        Returns:
            (h, w, 3) uint8 colours, (h, w) distance along the view [m] and (h, w)
            bool, where nothing is seen.
        """
        shape = (camera.height, camera.width)
        colour = np.full((*shape, 3), 255, np.uint8)
        depth = np.full(shape, camera.far)
        pixels, distance = camera.project(self._balls[:, :3])
        radii = self._balls[:, 3] * camera.pixels_per_metre(distance)
        discs = np.column_stack([pixels, radii, distance]).tolist()
        # the nearest first: of most others nothing is seen then, and nothing is painted
        for k in np.argsort(distance - self._balls[:, 3], kind="stable"):
            _draw_ball(colour, depth, discs[k], self._balls[k])
        return colour, depth, depth >= camera.far


def _draw_ball(colour: np.ndarray, depth: np.ndarray, disc: list, ball: np.ndarray):
    u, v, radius, far = disc
    top, left = max(int(v - radius), 0), max(int(u - radius), 0)
    window = np.s_[top : int(v + radius) + 2, left : int(u + radius) + 2]
    behind = depth[window]
    height, width = behind.shape
    y = (v - np.arange(top, top + height)) / radius
    x = (np.arange(left, left + width) - u) / radius
    z2 = 1.0 - x * x - (y * y)[:, None]
    z = np.sqrt(np.maximum(z2, 0.0))
    at = far - ball[3] * z
    seen = (z2 > 0) & (at < behind)
    rows, columns = seen.nonzero()
    if not len(rows):
        return
    towards = x[columns] * LIGHT[0] + y[rows] * LIGHT[1] + z[seen] * LIGHT[2]
    shade = 0.66 + 0.36 * np.maximum(towards, 0)
    paint = np.minimum(255 * ball[4:7] * shade[:, None], 255)
    colour[window][seen] = paint.astype(np.uint8)
    behind[seen] = at[seen]


def open_world(
    cell_map: CellMap, held: np.ndarray | None = None
) -> tuple[World | CoverWorld, str]:
    """Return pybullet's world, or the plain one and a sentence that says why, else "".

    `held` (n, 4) are spheres in the robot's hand, tool frame [m].
    """
    robot, asked = cell_map.robot, cell_map.recipe.robot
    try:
        world = World(asked.source, robot, asked.locked)
        if held is not None:
            world.carry(held)
        return world, ""
    except (SimulatorMissing, BadRobot) as error:
        whole = robot if held is None else with_payload(robot, held)
        return CoverWorld(whole), f"drawn from the sphere cover: {error}"
