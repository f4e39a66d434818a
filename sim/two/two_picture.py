"""Pictures of a run of two robots: both, with their work places, and what they do."""

from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import numpy as np

from odm.cell_map.cell_map import CellMap
from roadmap.builds.chunks import Progress
from roadmap.kinematics.forward import cover_balls, tool_pose
from roadmap.transforms import moved_points
from sim.draw.cover_world import open_world
from sim.draw.film import STATES, Canvas, FilmSettings, painted, write_gif
from sim.draw.style import AMBER, FAINT, INK, SLATE, TEAL, rgb
from sim.draw.viewpoint import Camera
from sim.loop.run_result import STATUS
from sim.terminal.output import write_whole
from sim.two.two_result import TwoResult

COLOURS = (TEAL, AMBER)  # of the first and of the second robot
TINT = 0.28  # share of its colour that a robot is drawn with
FILM = FilmSettings(height=400)


def write_two_picture(
    result: TwoResult, maps: tuple[CellMap, CellMap], path: str | Path
) -> Path:
    """Draw the moment in which the moving robots were nearest to each other (PNG)."""
    moving = result.moving(0) & result.moving(1)
    near = np.where(moving, result.separation, np.inf)
    frame = int(near.argmin() if moving.any() else result.separation.argmin())
    with _Stage(maps, result, Camera(width=1280, height=800)) as stage:
        image = stage.paint(frame)
    return write_whole(path, lambda stream: image.save(stream, format="PNG"))


def write_two_animation(
    result: TwoResult,
    maps: tuple[CellMap, CellMap],
    path: str | Path,
    tell: Progress | None = None,
) -> Path:
    """Write the seconds in which both move nearest to each other as an animated GIF."""
    both = result.moving(0) & result.moving(1)
    score = both * np.exp(-np.clip(result.separation, 0.0, 1.0) / 0.1)
    shown = FILM.shown(score, result.rate_hz)
    with _Stage(maps, result, FILM.camera()) as stage:
        return write_gif(painted(stage.paint, shown, tell), path, FILM)


class _Stage(AbstractContextManager):
    """Two worlds, one for each robot, seen from the same place and laid together."""

    def __init__(
        self, maps: tuple[CellMap, CellMap], result: TwoResult, camera: Camera
    ) -> None:
        self.result, self.robots = result, [m.robot for m in maps]
        self.T = (np.eye(4), np.asarray(result.T_world_base))
        self.worlds = [open_world(m)[0] for m in maps]
        self.tools = []
        for robot, T, places in zip(self.robots, self.T, result.places, strict=True):
            tools = [tool_pose(robot, q)[:3, 3] for q in places]
            self.tools.append(moved_points(np.array(tools), T))
        tools = np.vstack(self.tools)
        camera, extent = _framed(camera, self.T[1][:3, 3], tools)
        self.canvas = Canvas(camera, *extent)

    def __exit__(self, *_: object) -> None:
        for world in self.worlds:
            world.__exit__(None, None, None)

    def paint(self, frame: int) -> object:
        camera = self.canvas.camera
        colour = self.canvas.floor(np.vstack([self._balls(k, frame) for k in (0, 1)]))
        nearest = np.full(colour.shape[:2], np.inf)
        for k, world in enumerate(self.worlds):
            world.place(self.result.q[k][frame], np.zeros((0, 7)))
            drawn, depth, empty = world.picture(_seen_from(camera, self.T[k]))
            front = ~empty & (depth < nearest)
            tinted = (1 - TINT) * drawn + TINT * np.array(rgb(COLOURS[k]))
            colour[front] = tinted[front]
            nearest[front] = depth[front]
        image = self.canvas.begin(colour, nearest)
        for k, tools in enumerate(self.tools):
            for index, place in enumerate(tools):
                chosen = index == int(self.result.place[frame, k])
                self.canvas.ring(place, COLOURS[k], chosen)
        self._draw_caption(frame)
        return image

    def _balls(self, k: int, frame: int) -> np.ndarray:
        balls = cover_balls(self.robots[k], self.result.q[k][frame])
        balls[:, :3] = moved_points(balls[:, :3], self.T[k])
        return balls

    def _draw_caption(self, frame: int) -> None:
        canvas, result = self.canvas, self.result
        for k, (x, name) in enumerate(((16, "first"), (232, "second"))):
            canvas.text(x, "\N{BLACK CIRCLE}", COLOURS[k], bold=True)
            canvas.text(x + 18, name, FAINT)
            canvas.pill(x + 80, 92, *self._doing(k, frame))
        gap = result.separation[frame]
        text = f"{100 * gap:.0f} cm apart" if gap > 0 else "contact"
        canvas.text(432, text, INK, bold=True)
        canvas.text(-16, f"{frame / result.rate_hz:.1f} s", FAINT, anchor="rm")

    def _doing(self, k: int, frame: int) -> tuple[str, str]:
        if k == 1 and self.result.other == "scripted":
            return "scripted", SLATE
        status = STATUS[self.result.status[frame, k]]
        if status != "holding" and not self.result.moving(k)[frame]:
            return "at rest", FAINT
        return ("moving", COLOURS[k]) if status != "holding" else STATES["holding"]


def _framed(
    camera: Camera, p_other: np.ndarray, tools: np.ndarray
) -> tuple[Camera, tuple]:
    """Return a camera that sees both robots, and the table's extent."""
    low = np.minimum(tools.min(axis=0), np.minimum(p_other, 0.0)) - 0.25
    high = np.maximum(tools.max(axis=0), np.maximum(p_other, 0.0)) + 0.25
    middle, span = 0.5 * (low + high), float(max(high[:2] - low[:2]))
    target = (middle[0], middle[1], 0.14 * span)
    eye = (middle[0] + 0.55 * span, middle[1] - 1.75 * span, 1.30 * span)
    far = 6.0 * span + 2.0
    extent = ((low[0], high[0]), (low[1], high[1]))
    return replace(camera, eye=eye, target=target, fov_deg=29.0, far=far), extent


def _seen_from(camera: Camera, T_world_base: np.ndarray) -> Camera:
    """Return the camera in the frame of a base that stands upright."""
    points = np.array([camera.eye, camera.target])
    eye, target = moved_points(points, np.linalg.inv(T_world_base))
    return replace(camera, eye=tuple(eye), target=tuple(target))
