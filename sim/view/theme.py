"""Colours of the page, the place of its camera, and small geometry for drawing."""

import numpy as np

from sim.draw import style
from sim.draw.style import AMBER, FAINT, PURPLE, RED, SLATE, TEAL, rgb
from sim.view import moment as m

_STANDS = 0.1  # nobody's lowest part is thicker [m]
_PUT_AWAY = -4.0  # nobody stands so far below the robot's base [m]
WINDOW = (1440, 900)  # where a window is not known: width and height [px]
PANEL = 350  # width of the panel at the right, with its margin, of a plain screen [px]
_NARROW = 576  # where a window is no wider, the panel is at its foot [px]
# A browser tells its window in the pixels of its screen, not how many of them the page
# takes for one (2 on a telephone, 1 to 2 elsewhere), and the panel grows with that. So
# a window as tall and narrow as a telephone's is one, and a wide one may be no wider to
# the page than this [px].
_TELEPHONE = 1000, 0.65  # no wider [px], and no wider for its height
_PLAIN = 1440
FOV = np.radians(38.0)  # vertical opening of the camera [rad]
STATE_COLOURS = {
    m.STILL: FAINT,
    m.ON_THE_WAY: TEAL,
    m.NEW_PATH: "#2a6fbb",
    m.SLOW: "#e0a63a",
    m.BRAKING: AMBER,
    m.AWAY: PURPLE,
    m.HOLDING: RED,
    m.CONTACT: "#7a0000",
}
ROBOT, BASE = (222, 225, 229), (176, 184, 192)
SLEEVE, SKIN, LOAD, FURNITURE = (
    tuple(round(255 * part) for part in colour)
    for colour in (style.SLEEVE, style.SKIN, style.LOAD, style.FURNITURE)
)
CELL, POINT = (214, 120, 40), (120, 90, 60)
SKY, GROUND = (255, 255, 255), (196, 200, 206)
FREE_EDGE, BLOCKED_EDGE = (150, 188, 186), (196, 62, 62)
PATH, BEFORE = rgb(TEAL), (160, 168, 178)
GOAL = rgb(SLATE)


def quality_colours(quality: np.ndarray) -> np.ndarray:
    """Return (n, 3) uint8 colours of qualities in [0, 1]; slate where there is none."""
    from trimesh.visual.color import interpolate

    quality = np.asarray(quality, float)
    ends = np.append(np.nan_to_num(quality), (0.0, 1.0))  # it spreads what it is given
    colours = interpolate(ends, "viridis")[:-2, :3]
    colours[np.isnan(quality)] = GOAL
    return colours


def hex_of(colour: tuple) -> str:
    """Return '#rrggbb' of three numbers from 0 to 255."""
    return "#{:02x}{:02x}{:02x}".format(*(int(c) for c in colour))


def as_segments(line: np.ndarray) -> np.ndarray:
    """Return (n - 1, 2, 3) segments of a line (n, 3)."""
    return np.stack([line[:-1], line[1:]], axis=1).astype(np.float32)


def lowest_of(capsules: np.ndarray) -> float:
    """Return how low people (n, 7) come [m], at most 0: the floor they stand on.

    Where a part is not seen it is grown, which is no reason for a lower floor; and who
    is far below has only been put away.
    """
    low = np.minimum(capsules[:, 2], capsules[:, 5]) - np.minimum(
        capsules[:, 6], _STANDS
    )
    return float(np.min(low[low > _PUT_AWAY], initial=0.0))


def panel_width(size: tuple[int, int]) -> float:
    """Return how much of a window's width the panel takes at most; 0: it is below.

    `size` and the answer are in pixels of the screen, see `_TELEPHONE`.
    """
    width, height = size
    widest, share = _TELEPHONE
    if width <= _NARROW or (width <= widest and width <= share * height):
        return 0.0
    return PANEL * max(1.0, width / _PLAIN)


def eye_on(
    robot_points: np.ndarray,
    person_points: np.ndarray,
    size: tuple[int, int] = WINDOW,
    side: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return where a camera stands, and what it looks at, to see robot and person.

    It looks across the line from the robot to the person, a little from above and
    from behind the robot's side, so that neither hides the other.

    Args:
        robot_points: (n, 3) of the robot [m].
        person_points: (k, 3) of the person [m]; none: the robot alone.
        size: Width and height of the window, in pixels of the screen.
        side: 1: from the right of the line from robot to person; -1: from its left,
            where the right hand of somebody is who faces the robot.
    """
    whole = np.vstack([robot_points, person_points])
    low, high = whole.min(axis=0), whole.max(axis=0)
    target = 0.5 * (low + high)
    toward = np.array([1.0, 0.0, 0.0])
    if len(person_points):
        toward = person_points.mean(axis=0) - robot_points.mean(axis=0)
        toward[2] = 0.0
    length = np.linalg.norm(toward)
    toward = toward / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    across = side * np.array([toward[1], -toward[0], 0.0])
    radius = 0.5 * float(np.linalg.norm(high - low)) + 0.1
    width, height = size
    taken = panel_width(size)
    fits = (width - taken) / max(height, 1)
    distance = 1.05 * radius / np.sin(FOV / 2) / min(1.0, max(fits, 0.3))
    back = 1.0 * across + 0.15 * toward + np.array([0.0, 0.0, 0.45])
    back /= np.linalg.norm(back)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    half = distance * np.tan(FOV / 2)
    if taken:
        target = target + half * taken / max(height, 1) * right
    elif fits < 0.8:  # the panel is at the foot
        target = target - 0.45 * half * np.cross(back, right)
    return target + distance * back, target
