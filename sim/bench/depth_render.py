"""Depth images of exact geometry: what a perfect camera would see, ray by ray."""

import numpy as np

from odm.cameras import DepthCamera
from roadmap.kinematics.forward import body_frames
from roadmap.robot.robot import BOX, CYLINDER, HULL, Robot


class DepthScene:
    """Solids seen by a camera; the nearest one wins, pixel by pixel.

    Args:
        camera: Its rays through the pixels' centres are cast.
    """

    def __init__(self, camera: DepthCamera) -> None:
        """See nothing yet."""
        self.camera = camera
        self.depth_m = np.full((camera.height, camera.width), np.inf)
        self._T = np.linalg.inv(camera.T_base_camera)

    def image(self) -> np.ndarray:
        """Return the (height, width) uint16 image; 0 where no ray meets anything.

        Depths are rounded down; those beyond the largest pixel are left out.
        """
        return self.camera.from_metres(self.depth_m)

    def add_capsules(self, capsules: np.ndarray) -> "DepthScene":
        """Add capsules (k, 7): ends and radius in the base frame [m]."""
        for row in np.asarray(capsules, float).reshape(-1, 7):
            a, b, radius = self._in_camera(row[:3]), self._in_camera(row[3:6]), row[6]
            middle = 0.5 * (a + b)
            rect = self._rect(middle, 0.5 * np.linalg.norm(b - a) + radius)
            if rect is None:
                continue
            rays = self._rays(rect)
            depth = np.minimum(
                _enter_ball(rays, a, radius), _enter_ball(rays, b, radius)
            )
            if np.linalg.norm(b - a) > 1e-12:
                depth = np.minimum(depth, _enter_tube(rays, a, b, radius))
            self._keep(rect, depth)
        return self

    def add_boxes(self, T_base_box: np.ndarray, size: np.ndarray) -> "DepthScene":
        """Add boxes: poses (k, 4, 4) of their centres and edge lengths (k, 3) [m]."""
        for T, edges in zip(T_base_box, np.asarray(size, float), strict=True):
            self._add_box(np.asarray(T, float), 0.5 * edges)
        return self

    def add_robot(self, robot: Robot, q: np.ndarray) -> "DepthScene":
        """Add all solids of a robot, its base included, at q (dof,)."""
        poses = body_frames(robot, q)[robot.link_body[robot.solid_link]]
        for i, T in enumerate(poses @ robot.solid_pose):
            kind, size = robot.solid_kind[i], robot.solid_size[i]
            if kind == HULL:
                part = slice(int(robot.solid_ptr[i]), int(robot.solid_ptr[i + 1]))
                self._add_hull(T, robot.solid_points[part])
            elif kind == BOX:
                self._add_box(T, 0.5 * size)
            elif kind == CYLINDER:
                self._add_cylinder(T, size[0], size[1])
            else:
                self.add_capsules(np.r_[T[:3, 3], T[:3, 3], size[0]])
        return self

    # --- inside ----------------------------------------------------------------

    def _in_camera(self, p: np.ndarray) -> np.ndarray:
        return self._T[:3, :3] @ p + self._T[:3, 3]

    def _rect(self, center: np.ndarray, radius: float) -> tuple[slice, slice] | None:
        """Return rows and columns that a ball may cover, or None; camera frame."""
        camera = self.camera
        if center[2] + radius <= 0.0:
            return None
        if center[2] <= 1.05 * radius:
            return slice(0, camera.height), slice(0, camera.width)
        near = center[2] - radius
        found = []
        for axis, focal, middle, size in (
            (1, camera.fy, camera.cy, camera.height),
            (0, camera.fx, camera.cx, camera.width),
        ):
            ends = np.array([center[axis] - radius, center[axis] + radius])
            slopes = np.concatenate([ends / near, ends / (center[2] + radius)])
            low, high = focal * slopes.min() + middle, focal * slopes.max() + middle
            begin, end = max(0, int(low) - 1), min(size, int(high) + 3)
            if begin >= end:
                return None
            found.append(slice(begin, end))
        return found[0], found[1]

    def _rays(self, rect: tuple[slice, slice]) -> np.ndarray:
        """Return (n, 3) directions with z = 1, so that lengths are depths."""
        camera = self.camera
        v, u = np.mgrid[rect[0], rect[1]]
        x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
        return np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)

    def _keep(self, rect: tuple[slice, slice], depth: np.ndarray) -> None:
        part = self.depth_m[rect]
        np.minimum(part, depth.reshape(part.shape), out=part)

    def _add_box(self, T: np.ndarray, half: np.ndarray) -> None:
        normals = np.vstack([np.eye(3), -np.eye(3)])
        self._add_planes(T, normals, np.tile(half, 2), np.linalg.norm(half))

    def _add_hull(self, T: np.ndarray, points: np.ndarray) -> None:
        from scipy.spatial import ConvexHull

        planes = np.unique(ConvexHull(points).equations.round(9), axis=0)
        # about the middle of the points, so that the ball round them is small
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        pose = T.copy()
        pose[:3, 3] += T[:3, :3] @ middle
        offsets = -planes[:, 3] - planes[:, :3] @ middle
        radius = np.linalg.norm(points - middle, axis=1).max()
        self._add_planes(pose, planes[:, :3], offsets, radius)

    def _add_planes(
        self, T: np.ndarray, normals: np.ndarray, offsets: np.ndarray, radius: float
    ) -> None:
        """Add the convex solid normals . p <= offsets of the frame T (4, 4)."""
        pose = self._T @ T
        rect = self._rect(pose[:3, 3], radius)
        if rect is None:
            return
        rays = self._rays(rect)
        turned = normals @ pose[:3, :3].T
        self._keep(rect, _enter_planes(rays, turned, offsets + turned @ pose[:3, 3]))

    def _add_cylinder(self, T: np.ndarray, radius: float, length: float) -> None:
        pose = self._T @ T
        rect = self._rect(pose[:3, 3], float(np.hypot(radius, 0.5 * length)))
        if rect is None:
            return
        half = 0.5 * length * pose[:3, 2]
        a, b = pose[:3, 3] - half, pose[:3, 3] + half
        self._keep(rect, _enter_tube(self._rays(rect), a, b, radius))


def _interval(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> tuple:
    """Return where a t^2 + 2 b t + c <= 0 begins and ends; empty: inf, -inf."""
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(b * b - a * c)
        first, last = (-b - root) / a, (-b + root) / a
    along = a < 1e-15  # the ray is parallel to the axis: inside or not at all
    first = np.where(along, np.where(c <= 0.0, -np.inf, np.inf), first)
    last = np.where(along, np.where(c <= 0.0, np.inf, -np.inf), last)
    none = ~along & ~(b * b >= a * c)
    return np.where(none, np.inf, first), np.where(none, -np.inf, last)


def _enter(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Return where rays enter; a camera inside a solid does not see it."""
    return np.where((first <= last) & (first > 0.0), first, np.inf)


def _enter_ball(rays: np.ndarray, center: np.ndarray, radius: float) -> np.ndarray:
    square = (rays * rays).sum(axis=1)
    return _enter(*_interval(square, -rays @ center, center @ center - radius**2))


def _enter_tube(
    rays: np.ndarray, a: np.ndarray, b: np.ndarray, radius: float
) -> np.ndarray:
    """Enter a cylinder with flat ends from a to b."""
    axis = (b - a) / np.linalg.norm(b - a)
    flat, origin = rays - np.outer(rays @ axis, axis), -a + (a @ axis) * axis
    square = (flat * flat).sum(axis=1)
    first, last = _interval(square, flat @ origin, origin @ origin - radius**2)
    normals, offsets = np.stack([axis, -axis]), np.array([axis @ b, -axis @ a])
    begin, end = _cut_planes(rays, normals, offsets)
    return _enter(np.maximum(first, begin), np.minimum(last, end))


def _enter_planes(
    rays: np.ndarray, normals: np.ndarray, offsets: np.ndarray
) -> np.ndarray:
    return _enter(*_cut_planes(rays, normals, offsets))


def _cut_planes(rays: np.ndarray, normals: np.ndarray, offsets: np.ndarray) -> tuple:
    """Return where t rays is inside all half-spaces normals . p <= offsets."""
    first, last = np.full(len(rays), -np.inf), np.full(len(rays), np.inf)
    for normal, offset in zip(normals, offsets, strict=True):
        speed = rays @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            t = offset / speed
        first = np.where(speed < -1e-15, np.maximum(first, t), first)
        last = np.where(speed > 1e-15, np.minimum(last, t), last)
        outside = (np.abs(speed) <= 1e-15) & (offset < 0.0)
        last = np.where(outside, -np.inf, last)
    return first, last
