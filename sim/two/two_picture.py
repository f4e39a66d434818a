"""Pictures of a run of two robots: both, with their work places, and what they do."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from odm.cell_map.cell_map import CellMap
from roadmap.kinematics.forward import sphere_centers, tool_pose
from roadmap.unfinished import temporary_folder
from sim.draw.animation import (
    FAINT,
    INK,
    STATES,
    WHITE,
    FilmSettings,
    draw_ground,
    font_file,
    write_gif,
)
from sim.draw.viewpoint import Camera
from sim.loop.run_result import STATUS
from sim.run.demo import open_world
from sim.terminal.output import stdout_to_stderr, write_whole
from sim.two.two_result import TwoResult

COLOURS = ((0, 133, 124), (201, 123, 18))  # of the first and of the second robot
TINT = 0.28  # share of its colour that a robot is drawn with
FILM = FilmSettings()


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
    settings: FilmSettings = FILM,
) -> Path:
    """Write the liveliest seconds of a run as an animated GIF."""
    step = max(1, round(result.rate_hz / settings.fps))
    length = step * settings.frames
    first = _liveliest(result, length)
    shown = range(first, min(first + length, result.frames), step)
    camera = Camera(width=round(1.5 * settings.width), height=round(1.5 * 400))
    settings = replace(settings, height=400)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with _Stage(maps, result, camera) as stage:
        pictures = [stage.paint(i) for i in shown]
    with temporary_folder(path.parent) as folder:
        write_gif(pictures, folder / path.name, settings).replace(path)
    return path


def _liveliest(result: TwoResult, length: int) -> int:
    """Return the first of the `length` frames in which both move near each other."""
    both = result.moving(0) & result.moving(1)
    score = both * np.exp(-np.clip(result.separation, 0.0, 1.0) / 0.1)
    if len(score) <= length:
        return 0
    total = np.r_[0.0, np.cumsum(score)]
    return int(np.argmax(total[length:] - total[:-length]))


class _Stage:
    """Two worlds, one for each robot, seen from the same place and laid together."""

    def __init__(
        self, maps: tuple[CellMap, CellMap], result: TwoResult, camera: Camera
    ) -> None:
        from PIL import ImageFont

        self.result, self.robots = result, [m.robot for m in maps]
        self.T = (np.eye(4), np.asarray(result.T_world_base))
        with stdout_to_stderr():  # pybullet greets and warns on stdout
            self.worlds = [open_world(m)[0] for m in maps]
        self.tools = [self._tools(k, places) for k, places in enumerate(result.places)]
        tools = np.vstack(self.tools)
        self.camera, extent = _framed(camera, self.T[1][:3, 3], tools)
        self.ground = draw_ground(self.camera, *extent)
        self.unit = camera.height / 480
        size = round(14.5 * self.unit)
        self.font = ImageFont.truetype(font_file("DejaVuSans.ttf"), size)
        self.bold = ImageFont.truetype(font_file("DejaVuSans-Bold.ttf"), size)

    def __enter__(self) -> "_Stage":
        return self

    def __exit__(self, *_: object) -> None:
        for world in self.worlds:
            world.__exit__(None, None, None)

    def _tools(self, k: int, places: np.ndarray) -> np.ndarray:
        tools = [tool_pose(self.robots[k], q)[:3, 3] for q in places]
        return _moved(self.T[k], np.array(tools))

    def paint(self, frame: int) -> object:
        from PIL import Image, ImageDraw

        colour = self.ground * self._shadow(frame)[..., None]
        nearest = np.full(colour.shape[:2], np.inf)
        for k, world in enumerate(self.worlds):
            world.place(self.result.q[k][frame], np.zeros((0, 7)))
            drawn, depth, empty = world.picture(_seen_from(self.camera, self.T[k]))
            front = ~empty & (depth < nearest)
            tinted = (1 - TINT) * drawn + TINT * np.array(COLOURS[k])
            colour[front] = tinted[front]
            nearest[front] = depth[front]
        image = Image.fromarray(np.clip(colour, 0, 255).astype(np.uint8))
        draw = ImageDraw.Draw(image, "RGBA")
        for k in range(2):
            self._draw_places(draw, nearest, k, int(self.result.place[frame, k]))
        self._draw_caption(draw, frame)
        return image

    def _shadow(self, frame: int) -> np.ndarray:
        """Return (h, w) the light on the table, 1 where nothing is above."""
        from PIL import Image, ImageDraw, ImageFilter

        size = (self.camera.width // 3, self.camera.height // 3)
        mask = Image.new("L", size, 0)
        draw = ImageDraw.Draw(mask)
        turn = np.linspace(0, 2 * np.pi, 20, endpoint=False)
        for k, robot in enumerate(self.robots):
            centers = sphere_centers(robot, self.result.q[k][frame])
            x, y, z = _moved(self.T[k], centers).T[:, :, None]
            radius = robot.spheres[:, 3:4]
            x = x - 0.12 * z + radius * np.cos(turn)
            y = y + 0.10 * z + radius * np.sin(turn)
            rims = np.stack([x, y, np.zeros_like(x)], axis=2)
            for rim in self.camera.project(rims)[0].reshape(*x.shape, 2) / 3:
                draw.polygon(rim.ravel().tolist(), fill=255)
        mask = mask.filter(ImageFilter.GaussianBlur(4 * self.unit / 1.5))
        mask = mask.resize((self.camera.width, self.camera.height), Image.BILINEAR)
        return 1.0 - 0.17 * np.asarray(mask, np.float32) / 255.0

    def _draw_places(
        self, draw: object, depth: np.ndarray, k: int, wanted: int
    ) -> None:
        pixels, far = self.camera.project(self.tools[k])
        radii = 0.03 * self.camera.pixels_per_metre(far)
        for index, ((u, v), z, r) in enumerate(zip(pixels, far, radii, strict=True)):
            row = int(np.clip(v, 0, self.camera.height - 1))
            column = int(np.clip(u, 0, self.camera.width - 1))
            alpha = 255 if z < depth[row, column] + 0.02 else 110
            fill = (*COLOURS[k], 70 if index == wanted else 0)
            box = (u - r, v - r, u + r, v + r)
            draw.ellipse(box, fill, (*COLOURS[k], alpha), round(2.4 * self.unit))

    def _draw_caption(self, draw: object, frame: int) -> None:
        unit, result = self.unit, self.result
        y, x = self.camera.height - 30 * unit, 16 * unit
        for k, name in enumerate(("first", "second")):
            word, colour = self._doing(k, frame)
            draw.ellipse((x, y - 6 * unit, x + 12 * unit, y + 6 * unit), COLOURS[k])
            draw.text((x + 18 * unit, y), name, FAINT, self.font, anchor="lm")
            pill = (x + 80 * unit, y - 14 * unit, x + 172 * unit, y + 14 * unit)
            draw.rounded_rectangle(pill, 14 * unit, (*colour, 255))
            middle = ((pill[0] + pill[2]) / 2, y)
            draw.text(middle, word, WHITE, self.bold, anchor="mm")
            x += 196 * unit
        gap = result.separation[frame]
        text = f"{100 * gap:.0f} cm apart" if gap > 0 else "contact"
        draw.text((x + 4 * unit, y), text, INK, self.bold, anchor="lm")
        right = self.camera.width - 16 * unit
        text = f"{frame / result.rate_hz:.1f} s"
        draw.text((right, y), text, FAINT, self.font, anchor="rm")

    def _doing(self, k: int, frame: int) -> tuple[str, tuple[int, int, int]]:
        if k == 1 and self.result.other == "scripted":
            return "scripted", (91, 107, 122)
        status = STATUS[self.result.status[frame, k]]
        if status != "holding" and not self.result.moving(k)[frame]:
            return "at rest", (140, 150, 160)
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
    eye, target = _moved(np.linalg.inv(T_world_base), points)
    return replace(camera, eye=tuple(eye), target=tuple(target))


def _moved(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ T[:3, :3].T + T[:3, 3]
