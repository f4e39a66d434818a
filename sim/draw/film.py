"""Frames of a film: a rendered picture of robots on a table, with marks; GIF files."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from roadmap.builds.chunks import Progress
from sim.draw.style import AMBER, FAINT, INK, PURPLE, RED, TEAL, rgb
from sim.draw.viewpoint import Camera

BACKDROP, TABLE, GRID, WHITE = "#dee4ea", "#f3f4f3", "#e5e8e9", "#ffffff"
STATES = {  # what is said of a robot, and on which colour
    "following": ("following", TEAL),
    "replanned": ("new path", AMBER),
    "holding": ("holding", RED),
    "backing off": ("backing off", PURPLE),
    "escaping": ("escaping", "#a02878"),
}
TABLE_X, TABLE_Y = (-0.35, 1.05), (-0.8, 0.8)  # [m]
FINE = 1.5  # the film is drawn larger and scaled down: smooth edges
BAND = 200  # of 255: how much of the picture the ground of words hides
SHADOW = 0.17  # share of the light that a shadow takes away


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

    def camera(self) -> Camera:
        """Return a camera for frames `FINE` times as large as the film."""
        width, height = round(self.width * FINE), round(self.height * FINE)
        return Camera(fov_deg=self.fov_deg, width=width, height=height)

    def shown(self, score: np.ndarray, rate_hz: float) -> range:
        """Return the frames of a run to show: from `begin_s` or with the best score."""
        step = max(1, round(rate_hz / self.fps))
        first = best_stretch(score, step * self.frames)
        if self.begin_s is not None:
            first = min(round(self.begin_s * rate_hz), len(score) - 1)
        return range(first, min(first + step * self.frames, len(score)), step)


def best_stretch(score: np.ndarray, length: int) -> int:
    """Return the first of the `length` frames in a row whose score (F,) is largest."""
    if len(score) <= length:
        return 0
    total = np.r_[0.0, np.cumsum(score)]
    return int(np.argmax(total[length:] - total[:-length]))


class Canvas:
    """Draws signs over the picture of a frame.

    Args:
        camera: What the frames are seen from.
        along, across: Extent of the table in x and y [m].
        height: Of the table's top, or the floor [m].

    Attributes:
        unit: Pixels of a small film's pixel: lines and letters scale with it.
    """

    def __init__(
        self,
        camera: Camera,
        along: tuple[float, float] = TABLE_X,
        across: tuple[float, float] = TABLE_Y,
        height: float = 0.0,
    ) -> None:
        from matplotlib import get_data_path
        from PIL import ImageFont

        self.camera, self.unit = camera, camera.height / 480
        self._height = height
        self._ground = _draw_ground(camera, along, across, height)
        folder, size = Path(get_data_path()) / "fonts" / "ttf", round(14.5 * self.unit)
        self._fonts = [
            ImageFont.truetype(str(folder / name), size)
            for name in ("DejaVuSans.ttf", "DejaVuSans-Bold.ttf")
        ]

    def floor(self, balls: np.ndarray) -> np.ndarray:
        """Return (h, w, 3) the table in the shadow of balls (n, 4) [m]."""
        from PIL import Image, ImageDraw, ImageFilter

        shrink = 3
        size = (self.camera.width // shrink, self.camera.height // shrink)
        mask = Image.new("L", size, 0)
        draw = ImageDraw.Draw(mask)
        x, y, z, radius = balls.T[:, :, None]
        z = z - self._height
        turn = np.linspace(0, 2 * np.pi, 20, endpoint=False)
        x = x - 0.12 * z + radius * np.cos(turn)  # the light falls slightly aslant
        y = y + 0.10 * z + radius * np.sin(turn)
        rims = np.stack([x, y, np.full_like(x, self._height)], axis=2)
        for rim in self.camera.project(rims)[0].reshape(*x.shape, 2) / shrink:
            draw.polygon(rim.ravel().tolist(), fill=255)
        mask = mask.filter(ImageFilter.GaussianBlur(4 * self.unit / 1.5))
        mask = mask.resize((self.camera.width, self.camera.height), Image.BILINEAR)
        light = 1.0 - SHADOW * np.asarray(mask, np.float32) / 255.0
        return self._ground * light[..., None]

    def begin(self, picture: np.ndarray, depth: np.ndarray, lines: int = 1) -> object:
        """Begin a frame: colours (h, w, 3), distances along the view (h, w) [m].

        Behind `lines` lines of words at the bottom the picture is paler.

        Returns:
            The PIL image that everything else is drawn to.
        """
        from PIL import Image, ImageDraw

        image = Image.fromarray(np.clip(picture, 0, 255).astype(np.uint8))
        self._draw, self._depth = ImageDraw.Draw(image, "RGBA"), depth
        top = self.camera.height - (24 + 28 * lines) * self.unit
        box = (0, top, self.camera.width, self.camera.height)
        self._draw.rectangle(box, (*rgb(WHITE), BAND))
        return image

    def ring(self, place: np.ndarray, colour: str, chosen: bool) -> None:
        """Draw a ring round a place (3,) of a tool, with a dot where it goes [m]."""
        seen = self._seen(place[None])[0]
        (u, v), far = (a[0] for a in self.camera.project(place[None]))
        radius, paint = 0.032 * self.camera.pixels_per_metre(far), rgb(colour)
        line, fill = (*paint, 255 if seen else 110), (*paint, 60 if chosen else 25)
        box = (u - radius, v - radius, u + radius, v + radius)
        self._draw.ellipse(box, fill, line, round(2.2 * self.unit))
        r = 0.28 * radius
        if chosen:
            self._draw.ellipse((u - r, v - r, u + r, v + r), line)

    def line(self, points: np.ndarray, colour: str) -> None:
        """Draw a line through points (n, 3), faint where it is hidden [m]."""
        pixels = [tuple(p) for p in self.camera.project(points)[0]]
        seen, width = self._seen(points), round(3.2 * self.unit)
        cuts = [0, *(1 + np.flatnonzero(seen[1:] != seen[:-1])), len(points)]
        for a, b in zip(cuts[:-1], cuts[1:], strict=True):
            paint = (*rgb(colour), 255 if seen[a] else 70)
            self._draw.line(pixels[max(a - 1, 0) : b], paint, width, joint="curve")

    def pill(self, x: float, width: float, text: str, colour: str) -> None:
        """Write on a coloured ground in the bottom line; x and width in units."""
        unit, y = self.unit, self.camera.height - 30 * self.unit
        box = (x * unit, y - 14 * unit, (x + width) * unit, y + 14 * unit)
        self._draw.rounded_rectangle(box, 14 * unit, (*rgb(colour), 255))
        self.text(x + width / 2, text, WHITE, bold=True, anchor="mm")

    def text(
        self,
        x: float,
        text: str,
        colour: str,
        bold: bool = False,
        anchor: str = "lm",
        line: int = 0,
    ) -> None:
        """Write at x units, from the right edge if negative; `line` from the bottom."""
        u = x * self.unit if x >= 0 else self.camera.width + x * self.unit
        place = (u, self.camera.height - (30 + 28 * line) * self.unit)
        self._draw.text(place, text, rgb(colour), self._fonts[bold], anchor=anchor)

    def _seen(self, points: np.ndarray) -> np.ndarray:
        """Return (n,) whether nothing stands in front of the points."""
        pixels, far = self.camera.project(points)
        u = np.clip(pixels[:, 0].astype(int), 0, self.camera.width - 1)
        v = np.clip(pixels[:, 1].astype(int), 0, self.camera.height - 1)
        return far < self._depth[v, u] + 0.02


def _draw_ground(
    camera: Camera, along: tuple, across: tuple, height: float
) -> np.ndarray:
    """Return (h, w, 3) the empty scene: a table with a grid of 0.2 m."""
    from PIL import Image, ImageDraw

    size = (2 * camera.width, 2 * camera.height)
    image = Image.new("RGB", size, BACKDROP)
    draw = ImageDraw.Draw(image)

    def pixels(*points: tuple) -> list[tuple]:
        flat = np.array([(x, y, height) for x, y in points])
        return [tuple(2 * p) for p in camera.project(flat)[0]]

    (x0, x1), (y0, y1) = along, across
    draw.polygon(pixels((x0, y0), (x1, y0), (x1, y1), (x0, y1)), TABLE)
    for x in np.arange(x0 + 0.15, x1, 0.2):
        draw.line(pixels((x, y0), (x, y1)), GRID, 3)
    for y in np.arange(y0 + 0.2, y1, 0.2):
        draw.line(pixels((x0, y), (x1, y)), GRID, 3)
    small = image.resize((camera.width, camera.height), Image.LANCZOS)
    return np.asarray(small, np.float32)


def painted(
    paint: Callable[[int], object], frames: Sequence[int], tell: Progress | None
) -> list:
    """Return the picture (PIL) of each frame.

    `tell` is called before each, and before what follows: to pack them takes seconds.
    """
    pictures = []
    for k, frame in enumerate(frames):
        if tell is not None:
            tell("writing the film", k, len(frames))
        pictures.append(paint(frame))
    if tell is not None:
        tell("packing the film", 0, 1)
    return pictures


def write_gif(pictures: list, path: str | Path, settings: FilmSettings) -> Path:
    """Write pictures (PIL) as an animated GIF no larger than the settings say.

    The file is there whole or not at all.
    """
    from PIL import Image

    from sim.terminal.output import write_whole

    size = (settings.width, settings.height)
    small = [picture.resize(size, Image.LANCZOS) for picture in pictures]

    def write(stream: object) -> None:
        colours = settings.colours
        _save_gif(small, stream, colours, settings.fps)
        while stream.tell() > settings.max_bytes and colours > 16:
            colours = colours * 2 // 3
            stream.seek(0)
            stream.truncate()
            _save_gif(small, stream, colours, settings.fps)

    return write_whole(path, write)


def _save_gif(pictures: list, stream: object, colours: int, fps: float) -> None:
    """Write pictures with one palette for all: from four of them, and the signs."""
    from PIL import Image

    width, height = pictures[0].size
    signs = [colour for _, colour in STATES.values()] + [INK, WHITE, FAINT]
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
    flat[0].save(stream, format="GIF", save_all=True, append_images=flat[1:], **options)
