"""A short film of a run: robot, person, planned way of the tool, status."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadmap.kinematics.forward import difference, sphere_centers, tool_pose
from roadmap.robot.robot import Robot
from sim.draw.viewpoint import Camera
from sim.loop.run_result import RETREATS, STATUS, RunResult

BACKDROP, TABLE, GRID = (222, 228, 234), (243, 244, 243), (229, 232, 233)
INK, FAINT, WHITE = (44, 52, 62), (140, 150, 160), (255, 255, 255)
ROUTE, IDLE = (0, 133, 124), (150, 160, 168)
STATES = {
    "following": ("following", (0, 133, 124)),
    "replanned": ("new path", (214, 137, 16)),
    "holding": ("holding", (196, 62, 62)),
    "backing off": ("backing off", (112, 80, 176)),
    "escaping": ("escaping", (160, 40, 120)),
}
TABLE_X, TABLE_Y = (-0.35, 1.05), (-0.8, 0.8)  # [m]
FINE = 1.5  # the film is drawn larger and scaled down: smooth edges
STICKY_S = 0.3  # a new path is announced at least so long [s]


@dataclass(frozen=True)
class FilmSettings:
    """Size and length of the film.

    Attributes:
        width, height: Size [pixels].
        frames: Number of pictures.
        fps: Pictures per second; the film runs in real time.
        begin_s: Where in the run it begins [s]; None: where most happens.
        fov_deg: Vertical opening of the camera [deg].
        colours: Size of the palette; smaller ones are tried for a file too large.
        max_bytes: Largest file.
    """

    width: int = 640
    height: int = 480
    frames: int = 75
    fps: float = 12.5
    begin_s: float | None = None
    fov_deg: float = 30.0
    colours: int = 128
    max_bytes: int = 3_000_000


def write_animation(
    result: RunResult,
    robot: Robot,
    places: np.ndarray,
    world: object,
    path: str | Path,
    settings: FilmSettings | None = None,
) -> Path:
    """Write some seconds of a run, the liveliest if not told, as an animated GIF.

    Args:
        result: The run, with `keep_paths` on.
        robot: The robot.
        places: (n, dof) work places of the run.
        world: A `sim.draw.world.World` or `sim.draw.cover_world.CoverWorld`.
        path: File to write.
        settings: Size and length.

    Returns:
        The path written.
    """
    settings = settings or FilmSettings()
    camera = Camera(
        fov_deg=settings.fov_deg,
        width=round(settings.width * FINE),
        height=round(settings.height * FINE),
    )
    painter = _Painter(robot, places, world, camera)
    step = max(1, round(result.rate_hz / settings.fps))
    if settings.begin_s is None:
        first = liveliest(result, step * settings.frames)
    else:
        first = min(round(settings.begin_s * result.rate_hz), result.frames - 1)
    shown = range(first, min(first + step * settings.frames, result.frames), step)
    pictures = [painter.paint(result, i) for i in shown]
    return write_gif(pictures, Path(path), settings)


def paint_frame(
    result: RunResult,
    robot: Robot,
    places: np.ndarray,
    world: object,
    frame: int,
    camera: Camera | None = None,
) -> object:
    """Return one frame of a run as a PIL image; arguments as `write_animation`."""
    camera = camera or Camera(width=960, height=720)
    return _Painter(robot, places, world, camera).paint(result, frame)


def liveliest(result: RunResult, length: int) -> int:
    """Return the first frame of the `length` frames with most to see.

    Much motion, paths that change, a person nearby, few holds.
    """
    if result.frames <= length:
        return 0
    moving = np.clip(result.joint_speed / max(result.joint_speed.max(), 1e-9), 0, 1)
    near = np.exp(-np.clip(result.separation, 0.0, 10.0) / 0.1)
    replanned = result.status == STATUS.index("replanned")
    held = result.status == STATUS.index("holding")
    score = moving * (0.2 + 3.0 * near) + 30.0 * replanned * near - 0.5 * held
    total = np.r_[0.0, np.cumsum(score)]
    return int(np.argmax(total[length:] - total[:-length]))


class _Painter:
    def __init__(self, robot, places, world, camera):
        from PIL import ImageFont

        self.robot, self.world, self.camera = robot, world, camera
        self.goals = np.array([tool_pose(robot, q)[:3, 3] for q in places])
        self.unit = camera.height / 480  # line widths and letters scale with it
        size = round(14.5 * self.unit)
        self.font = ImageFont.truetype(font_file("DejaVuSans.ttf"), size)
        self.bold = ImageFont.truetype(font_file("DejaVuSans-Bold.ttf"), size)
        self.ground = draw_ground(camera)

    def paint(self, result: RunResult, frame: int) -> object:
        from PIL import Image, ImageDraw

        q, capsules = result.q[frame], result.capsules[frame]
        self.world.place(q, capsules)
        colour, depth, ground = self.world.picture(self.camera)
        floor = self.ground * self._shadow(q, capsules)[..., None]
        picture = np.where(ground[..., None], floor.astype(np.uint8), colour)
        image = Image.fromarray(picture)
        draw = ImageDraw.Draw(image, "RGBA")
        self._draw_goals(draw, depth, int(result.place[frame]))
        self._draw_route(draw, depth, _path_at(result, frame))
        self._draw_caption(draw, result, frame)
        return image

    def _shadow(self, q: np.ndarray, capsules: np.ndarray) -> np.ndarray:
        """Return (h, w) the light on the table, 1 where nothing is above."""
        from PIL import Image, ImageDraw, ImageFilter

        shrink = 3
        size = (self.camera.width // shrink, self.camera.height // shrink)
        mask = Image.new("L", size, 0)
        draw = ImageDraw.Draw(mask)
        x, y, z, radius = self._balls(q, capsules).T[:, :, None]
        turn = np.linspace(0, 2 * np.pi, 20, endpoint=False)
        x = x - 0.12 * z + radius * np.cos(turn)  # the light falls slightly aslant
        y = y + 0.10 * z + radius * np.sin(turn)
        rims = np.stack([x, y, np.zeros_like(x)], axis=2)
        pixels = self.camera.project(rims)[0].reshape(*x.shape, 2) / shrink
        for rim in pixels:
            draw.polygon(rim.ravel().tolist(), fill=255)
        mask = mask.filter(ImageFilter.GaussianBlur(4 * self.unit / 1.5))
        mask = mask.resize((self.camera.width, self.camera.height), Image.BILINEAR)
        return 1.0 - 0.17 * np.asarray(mask, np.float32) / 255.0

    def _balls(self, q: np.ndarray, capsules: np.ndarray) -> np.ndarray:
        centers = sphere_centers(self.robot, q)
        balls = [np.column_stack([centers, self.robot.spheres[:, 3]])]
        for row in capsules:
            s = np.linspace(0.0, 1.0, 16)[:, None]
            beads = row[:3] + s * (row[3:6] - row[:3])
            balls.append(np.column_stack([beads, np.full(16, row[6])]))
        return np.vstack(balls)

    def _draw_goals(self, draw: object, depth: np.ndarray, place: int) -> None:
        for index, goal in enumerate(self.goals):
            seen = self._seen(goal[None], depth)[0]
            (u, v), far = (a[0] for a in self.camera.project(goal[None]))
            radius = 0.032 * self.camera.pixels_per_metre(far)
            colour = ROUTE if index == place else IDLE
            alpha = 255 if seen else 110
            box = (u - radius, v - radius, u + radius, v + radius)
            fill = (*colour, 60 if index == place else 25)
            draw.ellipse(box, fill, (*colour, alpha), round(2.2 * self.unit))
            r = 0.28 * radius
            if index == place:
                draw.ellipse((u - r, v - r, u + r, v + r), (*colour, alpha))

    def _draw_route(self, draw: object, depth: np.ndarray, path: np.ndarray) -> None:
        if len(path) < 2:
            return
        points = _tool_line(self.robot, path)
        pixels = [tuple(p) for p in self.camera.project(points)[0]]
        seen = self._seen(points, depth)
        width = round(3.2 * self.unit)
        cuts = [0, *(1 + np.flatnonzero(seen[1:] != seen[:-1])), len(points)]
        for a, b in zip(cuts[:-1], cuts[1:], strict=True):
            colour = (*ROUTE, 255 if seen[a] else 70)
            draw.line(pixels[max(a - 1, 0) : b], colour, width, joint="curve")

    def _seen(self, points: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Return (n,) whether nothing stands in front of the points."""
        pixels, far = self.camera.project(points)
        u = np.clip(pixels[:, 0].astype(int), 0, self.camera.width - 1)
        v = np.clip(pixels[:, 1].astype(int), 0, self.camera.height - 1)
        return far < depth[v, u] + 0.02

    def _draw_caption(self, draw: object, result: RunResult, frame: int) -> None:
        unit, height = self.unit, self.camera.height
        label, colour = STATES[_shown_status(result, frame)]
        top, left = height - 44 * unit, 16 * unit
        pill = (left, top, left + 104 * unit, top + 28 * unit)
        draw.rounded_rectangle(pill, 14 * unit, (*colour, 255))
        middle = ((pill[0] + pill[2]) / 2, (pill[1] + pill[3]) / 2)
        draw.text(middle, label, WHITE, self.bold, anchor="mm")
        y, x = middle[1], pill[2] + 14 * unit
        separation = result.separation[frame]
        if np.isfinite(separation):
            text = f"{100 * separation:.0f} cm" if separation > 0 else "contact"
            draw.text((x, y), "separation", FAINT, self.font, anchor="lm")
            draw.text((x + 86 * unit, y), text, INK, self.bold, anchor="lm")
        recent = result.wall_s[max(0, frame - int(result.rate_hz / 2)) : frame + 1]
        text = f"{1e6 * np.median(recent):.0f} \N{MICRO SIGN}s"
        draw.text((x + 160 * unit, y), "planned in", FAINT, self.font, anchor="lm")
        draw.text((x + 246 * unit, y), text, INK, self.bold, anchor="lm")
        right = self.camera.width - 16 * unit
        text = f"{frame / result.rate_hz:4.1f} s"
        draw.text((right, y), text, FAINT, self.font, anchor="rm")


def _tool_line(robot: Robot, path: np.ndarray, step: float = 0.06) -> np.ndarray:
    """Return (n, 3) places of the tool along a path [m]."""
    parts = []
    for start, stop in zip(path[:-1], path[1:], strict=True):
        way = difference(robot, start, stop)
        count = 1 + int(np.abs(way).max() / step)
        parts += [start + s * way for s in np.arange(count) / count]
    parts.append(path[-1])
    return np.array([tool_pose(robot, q)[:3, 3] for q in parts])


def _path_at(result: RunResult, frame: int) -> np.ndarray:
    """Return the path kept last before a frame, while it leads to the same place."""
    known = [i for i in result.paths if i <= frame]
    if not known or result.place[max(known)] != result.place[frame]:
        return np.zeros((0, 0))
    return result.paths[max(known)]


def _shown_status(result: RunResult, frame: int) -> str:
    """Return the status or retreat, a new path for long enough to be read."""
    now = STATUS[result.status[frame]]
    if now == "holding" and result.retreat[frame]:
        return RETREATS[result.retreat[frame]]
    since = max(0, frame - round(STICKY_S * result.rate_hz))
    recent = result.status[since : frame + 1]
    new = now == "following" and (recent == STATUS.index("replanned")).any()
    return "replanned" if new else now


def draw_ground(
    camera: Camera,
    along: tuple[float, float] = TABLE_X,
    across: tuple[float, float] = TABLE_Y,
) -> np.ndarray:
    """Return (h, w, 3) the empty scene: a table with a grid of 0.2 m."""
    from PIL import Image, ImageDraw

    size = (2 * camera.width, 2 * camera.height)
    image = Image.new("RGB", size, BACKDROP)
    draw = ImageDraw.Draw(image)

    def pixels(*points: tuple) -> list[tuple]:
        flat = np.array([(x, y, 0.0) for x, y in points])
        return [tuple(2 * p) for p in camera.project(flat)[0]]

    (x0, x1), (y0, y1) = along, across
    draw.polygon(pixels((x0, y0), (x1, y0), (x1, y1), (x0, y1)), TABLE)
    for x in np.arange(x0 + 0.15, x1, 0.2):
        draw.line(pixels((x, y0), (x, y1)), GRID, 3)
    for y in np.arange(y0 + 0.2, y1, 0.2):
        draw.line(pixels((x0, y), (x1, y)), GRID, 3)
    small = image.resize((camera.width, camera.height), Image.LANCZOS)
    return np.asarray(small, np.float32)


def write_gif(pictures: list, path: Path, settings: FilmSettings) -> Path:
    """Write pictures (PIL) as an animated GIF no larger than the settings say."""
    from PIL import Image

    size = (settings.width, settings.height)
    small = [picture.resize(size, Image.LANCZOS) for picture in pictures]
    colours = settings.colours
    _save_gif(small, path, colours, settings.fps)
    while path.stat().st_size > settings.max_bytes and colours > 16:
        colours = colours * 2 // 3
        _save_gif(small, path, colours, settings.fps)
    return path


def _save_gif(pictures: list, path: Path, colours: int, fps: float) -> None:
    """Write pictures with one palette for all: from four of them, and the signs."""
    from PIL import Image

    width, height = pictures[0].size
    signs = [colour for _, colour in STATES.values()] + [INK, WHITE]
    sheet = Image.new("RGB", (width, 4 * height + 24 * len(signs)))
    for k in range(4):
        sheet.paste(pictures[k * (len(pictures) - 1) // 3], (0, k * height))
    for k, colour in enumerate(signs):
        top = 4 * height + 24 * k
        sheet.paste(colour, (0, top, width, top + 24))
    palette = sheet.quantize(colours, Image.MEDIANCUT)
    none = Image.Dither.NONE
    flat = [image.quantize(palette=palette, dither=none) for image in pictures]
    options = {"duration": round(1000 / fps), "loop": 0, "optimize": False}
    flat[0].save(path, save_all=True, append_images=flat[1:], **options)


def font_file(name: str) -> str:
    """Return the path of a font that comes with matplotlib."""
    from matplotlib import get_data_path

    return str(Path(get_data_path()) / "fonts" / "ttf" / name)
