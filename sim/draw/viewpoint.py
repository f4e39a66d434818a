"""A pinhole camera in OpenGL's convention: what pybullet draws with, and where."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from roadmap.transforms import moved_points, pose_with


@dataclass(frozen=True)
class Camera:
    """Where the picture is taken from."""

    # places of the camera and of what it looks at, base frame [m]
    eye: tuple[float, float, float] = (0.95, -1.75, 1.50)
    target: tuple[float, float, float] = (0.43, 0.02, 0.25)
    fov_deg: float = 30.0  # vertical opening [deg]
    # size of the picture [pixels]
    width: int = 640
    height: int = 480
    # nearest and farthest distance drawn [m]
    near: float = 0.2
    far: float = 6.0

    def view(self) -> np.ndarray:
        """Return the (4, 4) matrix from the base frame to the camera's."""
        eye, target = np.array(self.eye), np.array(self.target)
        back = (eye - target) / np.linalg.norm(eye - target)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        R = np.array([right, np.cross(back, right), back])
        return pose_with(R, -R @ eye)

    def projection(self) -> np.ndarray:
        """Return the (4, 4) matrix from the camera's frame to clip space."""
        f = 1.0 / np.tan(np.radians(self.fov_deg) / 2)
        near, far = self.near, self.far
        P = np.zeros((4, 4))
        P[0, 0], P[1, 1] = f * self.height / self.width, f
        P[2, 2], P[2, 3] = (far + near) / (near - far), 2 * far * near / (near - far)
        P[3, 2] = -1.0
        return P

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return (n, 2) pixels and (n,) distances along the view [m] of points."""
        points = np.asarray(points, float).reshape(-1, 3)
        T = self.view()
        eye = moved_points(points, T)
        distance = -eye[:, 2]
        P = self.projection()
        x = P[0, 0] * eye[:, 0] / distance
        y = P[1, 1] * eye[:, 1] / distance
        pixels = np.column_stack([(x + 1) * self.width / 2, (1 - y) * self.height / 2])
        return pixels, distance

    def pixels_per_metre(self, distance: np.ndarray) -> np.ndarray:
        """Return how large a metre looks at a distance along the view [m]."""
        return self.projection()[1, 1] * self.height / 2 / distance

    def metres(self, buffer: np.ndarray) -> np.ndarray:
        """Return distances along the view [m] from an OpenGL depth buffer in [0, 1]."""
        return self.far * self.near / (self.far - (self.far - self.near) * buffer)


FAR_PLANE, STEP_BACK, MOST_STEPS = 3.0, 1.1, 12
CUT, SPILL = 0.25, 0.05  # shares of a body outside: too large; allowed then, if less
TURNS = np.radians([0, -30, 30, -60, 60, -90, 90, -120, 120, -150, 150, 180])
FAR_TURN = 0.04  # a turn by half a circle must show so much more to be worth it


def clearest(
    camera: Camera,
    scenes: Sequence[tuple[np.ndarray, np.ndarray]],
    still: np.ndarray | None = None,
) -> Camera:
    """Return the camera, turned about its target to where both bodies are seen.

    Args:
        camera: Where it stands by choice; kept where no other place is clearly better.
        scenes: Two bodies as balls (n, 4) each, at some moments [m].
        still: (n, 4) balls of what stands around and may hide them [m].

    Returns:
        The one from which the worse seen of the two is seen best: shares of balls
        within the picture that no ball of the other body, and nothing else, stands
        before.
    """
    scenes = [scene for scene in scenes if all(map(len, scene))]
    if not scenes:
        return camera
    still, found = np.zeros((0, 4)) if still is None else still, []
    for turn in TURNS:
        turned = _turned(camera, turn)
        seen = [
            min(
                _seen(turned, a, np.vstack([b, still])),
                _seen(turned, b, np.vstack([a, still])),
            )
            for a, b in scenes
        ]
        found.append(np.mean(seen) - FAR_TURN * abs(turn) / np.pi)
    return _turned(camera, TURNS[int(np.argmax(found))])


def framed(
    camera: Camera, balls: np.ndarray, cut: float = CUT, tool: np.ndarray | None = None
) -> Camera:
    """Return the camera, farther away where a body is too large for the picture.

    Args:
        camera: Where it stands by choice; kept where the body fits.
        balls: (n, 4) the body, at some moments [m].
        cut: Share of it that may be outside before the camera moves.
        tool: (n, 4) those of them that matter most, whose share counts, too [m].
    """
    parts = [balls] if tool is None else [balls, tool]
    if all(not len(part) or _outside(camera, part) <= cut for part in parts):
        return camera
    low, high = balls[:, :3].min(axis=0), balls[:, :3].max(axis=0)
    middle = 0.5 * (low + high)
    step = np.subtract(camera.eye, camera.target)
    for _ in range(MOST_STEPS):
        found = _looking(camera, middle, step)
        if _outside(found, balls) <= min(SPILL, cut):
            break
        step = STEP_BACK * step
    return found


def above_words(camera: Camera, balls: np.ndarray, words: float) -> Camera:
    """Return the camera, lower and farther away where words hide what they must not.

    Args:
        camera: Where it stands by choice; kept where most is to be seen.
        balls: (n, 4) what is to be seen above them, at some moments [m].
        words: Share of the picture's height that they take at the bottom.
    """
    for _ in range(MOST_STEPS if len(balls) else 0):
        pixels, _ = camera.project(balls[:, :3])
        if np.mean(pixels[:, 1] > (1.0 - words) * camera.height) <= CUT:
            break
        eye, target = np.array(camera.eye), np.array(camera.target)
        away = STEP_BACK * (eye - target)
        far, half = float(np.linalg.norm(away)), np.radians(camera.fov_deg) / 2
        target[2] -= 0.1 * far * np.tan(half)
        camera = _looking(camera, target, away)
    return camera


def _looking(camera: Camera, target: np.ndarray, away: np.ndarray) -> Camera:
    eye, far = target + away, float(np.linalg.norm(away)) + FAR_PLANE
    places = {"eye": tuple(eye.tolist()), "target": tuple(target.tolist())}
    return replace(camera, **places, far=max(camera.far, far))


def _outside(camera: Camera, balls: np.ndarray) -> float:
    """Return which share of balls (n, 4) reaches out of the picture."""
    pixels, distance = camera.project(balls[:, :3])
    r = balls[:, 3] * camera.pixels_per_metre(distance)
    size = np.array([camera.width, camera.height])
    inside = ((pixels >= r[:, None]) & (pixels <= size - r[:, None])).all(axis=1)
    return float(np.mean(~inside))


def _turned(camera: Camera, turn: float) -> Camera:
    c, s = np.cos(turn), np.sin(turn)
    x, y, z = np.subtract(camera.eye, camera.target)
    eye = np.add(camera.target, (c * x - s * y, s * x + c * y, z))
    return replace(camera, eye=tuple(float(v) for v in eye))


def _seen(camera: Camera, balls: np.ndarray, others: np.ndarray) -> float:
    """Return the share of balls within the picture that no other one hides."""
    eye, places = np.array(camera.eye), balls[:, :3]
    pixels, far = camera.project(places)
    inside = (far > 0) & (pixels > 0).all(axis=1)
    inside &= (pixels < [camera.width, camera.height]).all(axis=1)
    rays = places - eye
    along = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    others = _between(eye, rays, others)
    to = others[None, :, :3] - eye
    depth = np.einsum("nk,mjk->nj", along, to)
    off = np.linalg.norm(to - depth[..., None] * along[:, None], axis=2)
    nearer = depth < np.linalg.norm(rays, axis=1)[:, None] - others[:, 3]
    hidden = ((off < others[:, 3]) & nearer & (depth > 0)).any(axis=1)
    return float(np.mean(inside & ~hidden))


def _between(eye: np.ndarray, rays: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return those balls of `others` (m, 4) that reach into the cone of rays (n, 3).

    Most of a large floor does not, and what a ball hides is asked of each pair.
    """
    far = np.linalg.norm(rays, axis=1)
    along = rays / far[:, None]
    axis = along.mean(axis=0)
    axis = axis / max(float(np.linalg.norm(axis)), 1e-9)
    widest = np.arccos(np.clip((along @ axis).min(), -1.0, 1.0))
    to = others[:, :3] - eye
    distance = np.maximum(np.linalg.norm(to, axis=1), 1e-9)
    angle = np.arccos(np.clip(to @ axis / distance, -1.0, 1.0))
    size = np.arcsin(np.minimum(others[:, 3] / distance, 1.0))
    near = distance - others[:, 3] <= far.max()
    return others[near & (angle - size <= widest)]
