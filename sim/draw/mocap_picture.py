"""A strip of a recorded clip, from the side and from above, as a PNG."""

from pathlib import Path

import numpy as np

from handover import Part
from roadmap.errors import BadInput
from sim.draw.human_picture import outline, part_colour
from sim.draw.style import (
    INK,
    RED,
    VIEWS,
    draw_floor,
    new_figure,
    save,
    set_title,
    space_axes,
)
from sim.people.mocap.motion import MocapMotion

WORK_PLACE = ((0.3, 0.7), (-0.4, 0.4), (0.1, 0.7))  # x, y, z before an arm [m]


def write_strip(
    motion: MocapMotion,
    path: str | Path,
    times: list[float] | None = None,
    box: tuple = WORK_PLACE,
) -> Path:
    """Draw the person at some moments, with the work place and the robot's base.

    Filled is the person as guessed, a red outline what is remembered and grown.

    Args:
        motion: The clip.
        path: PNG file to write.
        times: Moments [s]; None: eight, evenly over the clip.
        box: ((x, x), (y, y), (z, z)) ends of the work place, base frame [m].

    Returns:
        The path written.
    """
    if times is None:
        times = list(np.linspace(0.0, motion.duration_s, 8))
    if not len(times):
        raise BadInput("a strip of no moments is empty; give at least one time")
    limits = _limits(motion, times)
    wide, tall, deep = (high - low for low, high in limits)
    scale = 2.4 / max(wide, 1.0)  # inches per metre
    size = (2.6 * len(times) + 0.6, scale * (tall + deep) + 1.4)
    figure = new_figure(*size, motion.name)
    ratios = {"height_ratios": (deep, tall)}
    axes = figure.subplots(
        2, len(times), sharex=True, sharey="row", squeeze=False, gridspec_kw=ratios
    )
    for row, normal in zip(axes, (1, 2), strict=True):
        plane, view = VIEWS[normal]
        for axis, t in zip(row, times, strict=True):
            _draw_moment(axis, motion, t, plane, box)
            space_axes(axis, normal, view=f"{view}: ")
            axis.set(xlim=limits[0], ylim=limits[plane[1]])
            axis.label_outer()
            if normal == 1:
                set_title(axis, f"{t:.2f} s")
    return save(figure, path)


def _limits(motion: MocapMotion, times: list[float]) -> list[tuple[float, float]]:
    """Return (low, high) of x, y and z that show the robot and the person [m]."""
    people = np.concatenate([motion.guess(t) for t in times])
    ends, radii = people[:, :6].reshape(-1, 3), np.repeat(people[:, 6:], 2, axis=0)
    low = np.minimum((ends - radii).min(axis=0), [-0.15, -0.5, -0.1]) - 0.05
    high = np.maximum((ends + radii).max(axis=0), [0.75, 0.5, 0.75]) + 0.05
    return [(float(a), float(b)) for a, b in zip(low, high, strict=True)]


def _draw_moment(
    axis: object, motion: MocapMotion, t: float, plane: tuple, box: tuple
) -> None:
    from matplotlib.patches import Circle, Rectangle

    i, j = plane
    guess, known = motion.guess(t), motion.capsules(t)
    order = np.argsort(guess[:, [3 - i - j, 6 - i - j]].mean(axis=1))
    for k in order if j == 1 else order[::-1]:  # what is nearer covers
        colour = part_colour(Part(int(motion.labels[k])))
        axis.add_patch(outline(guess[k], plane, fc=colour, ec="white", lw=0.6))
        if known[k, 6] > guess[k, 6] + 1e-6:
            axis.add_patch(outline(known[k], plane, fc="none", ec=RED, lw=0.9))
    corner, sides = (box[i][0], box[j][0]), (np.ptp(box[i]), np.ptp(box[j]))
    axis.add_patch(Rectangle(corner, *sides, fc="none", ec=INK, ls="--", lw=0.9))
    axis.add_patch(Circle((0, 0), 0.08, fc=INK, ec="none"))
    draw_floor(axis)
