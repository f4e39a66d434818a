"""People, robots and objects seen along an axis: one outline each, exactly joined."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from roadmap.kinematics.forward import body_frames, cover_balls
from roadmap.robot.robot import Robot
from roadmap.transforms import moved_points
from sim.draw.style import INK, PALE

_STEP = 0.006  # [m] between the places that an outline is drawn from


class Silhouette:
    """A solid as seen along the axis that is not in `plane`.

    Args:
        capsules: (k, 7) ends a, b and radius, world frame [m].
        polytopes: (n, 3) vertices of a convex solid each, world frame [m].
    """

    def __init__(
        self, capsules: np.ndarray = (), polytopes: list[np.ndarray] = ()
    ) -> None:
        self.capsules = np.asarray(capsules, float).reshape(-1, 7)
        self.polytopes = list(polytopes)

    def points(self) -> np.ndarray:
        """Return (m, 3) corners of boxes around the parts [m]."""
        ends, r = self.capsules[:, :6].reshape(-1, 3), self.capsules[:, 6:]
        r = np.repeat(r, 2, axis=0)
        return np.concatenate([ends - r, ends + r, *self.polytopes])

    def distance(self, plane: tuple[int, int], x: np.ndarray, y: np.ndarray):
        """Return how far places are outside of the outline (negative: inside) [m].

        `x` and `y` are their coordinates across and up, of one shape [m].
        """
        at = np.stack([x, y], axis=-1)
        nearest = np.full(at.shape[:-1], np.inf)
        for rod in self.capsules:
            a, b = rod[list(plane)], rod[[3 + k for k in plane]]
            along = b - a
            t = (at - a) @ along / max(float(along @ along), 1e-12)
            off = at - a - np.clip(t, 0.0, 1.0)[..., None] * along
            gap = np.hypot(off[..., 0], off[..., 1]) - rod[6]
            np.minimum(nearest, gap, out=nearest)
        for solid in self.polytopes:
            np.minimum(nearest, _outside(solid[:, list(plane)], at), out=nearest)
        return nearest

    def draw(
        self,
        axis: object,
        plane: tuple[int, int],
        fill: str = PALE,
        line: str = INK,
        layers: tuple[int, int] = (3, 4),
        **style: object,
    ) -> None:
        """Fill the outline with a colour and draw it as a line.

        `plane` are the two axes seen, across and up; `layers` those of filling and
        line. `style` is of the filling, such as `alpha`; `linewidths` is the line's.
        """
        width = {"linewidths": style.pop("linewidths", 1.1)}
        seen = self.points()[:, list(plane)]
        low, high = seen.min(axis=0) - 0.03, seen.max(axis=0) + 0.03
        sides = [np.arange(a, b + _STEP, _STEP) for a, b in zip(low, high)]
        x, y = np.meshgrid(*sides)
        field = self.distance(plane, x, y)
        style |= {"levels": [-10.0, 0.0], "colors": [fill], "zorder": layers[0]}
        axis.contourf(x, y, field, **style)
        width |= {"levels": [0.0], "colors": [line], "zorder": layers[1]}
        axis.contour(x, y, field, linestyles="solid", **width)


def robot_silhouette(robot: Robot, q: np.ndarray, T_world_base: np.ndarray):
    """Return the Silhouette of a robot, its base too."""
    frames, solids = body_frames(robot, np.asarray(q, float)), []
    for i, link in enumerate(robot.shell_link):
        rows = slice(robot.shell_ptr[i], robot.shell_ptr[i + 1])
        T = T_world_base @ frames[robot.link_body[link]]
        solids.append(moved_points(robot.shell_points[rows], T))
    return Silhouette(polytopes=solids)


def cover_silhouette(robot: Robot, q: np.ndarray) -> Silhouette:
    """Return the Silhouette of a robot's sphere cover, its base at the origin."""
    balls = cover_balls(robot, q)
    return Silhouette(np.hstack([balls[:, :3], balls]))


def _outside(points: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return how far places are beyond the nearest side of a convex hull."""
    try:
        sides = ConvexHull(points).equations
    except QhullError:  # seen edge-on: no area
        return np.full(at.shape[:-1], np.inf)
    return (at @ sides[:, :2].T + sides[:, 2]).max(axis=-1)
