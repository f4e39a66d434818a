"""Cameras and scenes around the small arm, drawn at random."""

import numpy as np

import odm
from odm.cameras import look_at
from roadmap.transforms import pose_of
from sim.bench.depth_render import DepthScene

# a floor and four walls: boxes (pose, size) round the arm and all cameras
ROOM = [
    (pose_of([0, 0, -0.06]), (5.0, 5.0, 0.1)),
    (pose_of([2.5, 0, 1]), (0.1, 5.0, 5.0)),
    (pose_of([-2.5, 0, 1]), (0.1, 5.0, 5.0)),
    (pose_of([0, 2.5, 1]), (5.0, 0.1, 5.0)),
    (pose_of([0, -2.5, 1]), (5.0, 0.1, 5.0)),
]


def camera_at(eye, target=(0.0, 0.0, 0.4), size=(160, 120), focal=120.0, **others):
    """Return a small camera that looks at the arm."""
    width, height = size
    return odm.DepthCamera(
        width, height, focal, focal, (width - 1) / 2, (height - 1) / 2,
        look_at(eye, target), **{"scale": 0.0005, **others},
    )  # fmt: skip


def draw_camera(rng: np.random.Generator, **others) -> odm.DepthCamera:
    """Draw a camera that looks about at the middle of the grid."""
    angle, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 1.4)
    eye = np.array([np.cos(angle), np.sin(angle), 0.0]) * rng.uniform(0.9, 1.8)
    target = rng.uniform([-0.2, -0.2, 0.2], [0.2, 0.2, 0.7])
    return camera_at(eye + [0, 0, height], target, **others)


def draw_capsules(rng: np.random.Generator, n: int = 4) -> np.ndarray:
    """Draw n capsules (n, 7), some of them spheres, within the grid."""
    a = rng.uniform([-0.6, -0.6, 0.0], [0.6, 0.6, 1.0], (n, 3))
    b = a + rng.normal(scale=0.15, size=(n, 3)) * (rng.random((n, 1)) < 0.7)
    return np.column_stack([a, b, rng.uniform(0.015, 0.09, n)])


def picture(camera, capsules=(), robot=None, q=None, room=True) -> np.ndarray:
    """Return the image of a scene; the room fills what is left."""
    scene = DepthScene(camera).add_capsules(np.reshape(capsules, (-1, 7)))
    if room:
        scene.add_boxes(*zip(*ROOM, strict=True))
    if robot is not None:
        scene.add_robot(robot, q)
    return scene.image()


def draw_surface(
    rng: np.random.Generator, capsules: np.ndarray, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """Draw points (n, 3) on the sides of capsules, and their outward normals."""
    row = capsules[rng.integers(len(capsules), size=n)]
    axis = row[:, 3:6] - row[:, :3]
    length = np.linalg.norm(axis, axis=1, keepdims=True)
    unit = axis / np.maximum(length, 1e-12)
    normal = rng.normal(size=(n, 3))
    normal -= unit * (normal * unit).sum(axis=1, keepdims=True)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = rng.random((n, 1))
    return row[:, :3] + along * axis + row[:, 6:] * normal, normal


def draw_inside(rng: np.random.Generator, capsules: np.ndarray, n: int) -> np.ndarray:
    """Draw (n, 3) points in capsules, half of them on the surface."""
    row = capsules[rng.integers(len(capsules), size=n)]
    along = rng.random((n, 1))
    axis = row[:, :3] * (1 - along) + row[:, 3:6] * along
    way = rng.normal(size=(n, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    share = np.where(rng.random(n) < 0.5, 1.0, rng.random(n) ** (1 / 3))
    return axis + (row[:, 6] * share)[:, None] * way
