"""A person with reach and joint ranges, and a strip of a recorded clip, as PNGs."""

from pathlib import Path

import numpy as np
from scipy.ndimage import binary_closing, gaussian_filter

from handover import POSTURES, Human, Part
from handover.human.anthropometry import ARM_JOINTS
from roadmap.errors import BadInput
from roadmap.transforms import moved_points
from sim.draw import style
from sim.draw.silhouette import Silhouette
from sim.people.grips import grip_points
from sim.people.mocap.mocap_motion import MocapMotion

_COLOURS = {Part.TORSO: "#b9c0c8", Part.HEAD: style.GREY}
BIN = 0.025  # side of a square of the cut [m]
_SLAB = 0.03  # [m] half the thickness of a cut
WORK_PLACE = ((0.3, 0.7), (-0.4, 0.4), (0.1, 0.7))  # x, y, z before an arm [m]
_BEFORE = 0.30  # [m] the cut from the front lies this far before the shoulder


def write_human_picture(human: Human, path: str | Path) -> Path:
    """Draw the capsules, cuts through the right hand's reach, ranges: a PNG."""
    figure = style.new_figure(
        13.0,
        6.4,
        f"{human.posture}, {human.height:.2f} m, {human.thickness} thickness; shaded: "
        "where the right grip can be, in the plane of the shoulder and "
        f"{100 * _BEFORE:.0f} cm in front of it",
    )
    ratios = {"width_ratios": (1.15, 1.0, 0.95)}
    side, front, ranges = figure.subplots(1, 3, gridspec_kw=ratios)
    shoulder = human.T_world_shoulder("right")
    points = moved_points(grip_points(human, 600_000), shoulder)
    points = points[points[:, 2] > 0.0]  # nobody reaches into the floor
    _draw_view(side, human, points, 1, shoulder[1, 3])
    style.set_title(side, "from the right")
    before = shoulder[0, 3] + _BEFORE * shoulder[0, 0]
    _draw_view(front, human, points, 0, before)
    style.set_title(front, "from the front")
    _draw_ranges(ranges, human)
    return style.save(figure, path, dpi=110)


def _draw_view(
    axis: object, human: Human, points: np.ndarray, along: int, cut: float
) -> None:
    i, j = plane = style.VIEWS[along][0]
    rods = human.capsules()
    near = np.abs(points[:, along] - cut) < _SLAB
    _draw_reach(axis, points[near][:, [i, j]])
    depth = rods[:, [along, 3 + along]].mean(axis=1)
    # seen from the right side (-y) and from the front (+x): what is nearer covers
    order = np.argsort(depth if along == 0 else -depth)
    for k in order:
        colour = part_colour(Part(int(human.labels[k])))
        patch = outline(rods[k], plane, fc=colour, ec="white", lw=0.6, alpha=0.95)
        axis.add_patch(patch)
    if human.gaze is not None:
        eyes = human.p_world_eyes
        ends = np.array([eyes, eyes + 0.3 * human.gaze])[:, [i, j]]
        arrow = {"arrowstyle": "->", "color": style.INK}
        axis.annotate("", ends[1], ends[0], arrowprops=arrow)
    _draw_steps(axis, human, i)
    style.draw_floor(axis)
    shown = np.concatenate([Silhouette(rods).points(), points[near]])
    low, high = shown.min(axis=0) - 0.08, shown.max(axis=0) + 0.08
    # from the front, the person's left is on our right
    axis.set(xlim=(low[i], high[i]), ylim=(min(low[j], -0.05), high[j]))
    style.space_axes(axis, along, view="height ")


def _draw_reach(axis: object, points: np.ndarray) -> None:
    """Fill the squares of the cut that a sample of the grip lies in."""
    if not len(points):
        return
    low = np.floor(points.min(axis=0) / BIN).astype(int) - 4
    counts = np.floor(points / BIN).astype(int) - low
    filled = np.zeros(counts.max(axis=0) + 5, bool)
    filled[counts[:, 0], counts[:, 1]] = True
    # samples leave holes of single squares
    filled = binary_closing(filled, iterations=3)
    x, y = ((low[k] + 0.5 + np.arange(filled.shape[k])) * BIN for k in (0, 1))
    cut = gaussian_filter(filled.T.astype(float), 0.8)
    axis.contourf(x, y, cut, levels=[0.5, 1.5], colors=[style.TEAL], alpha=0.16)
    axis.contour(x, y, cut, levels=[0.5], colors=[style.TEAL], linewidths=0.9)


def _draw_steps(axis: object, human: Human, i: int) -> None:
    """Draw the step under each foot of a person on a ladder."""
    if POSTURES[human.posture].step == 0.0:
        return
    rods = human.capsules()
    for leg in (Part.LEFT_LEG, Part.RIGHT_LEG):
        foot = rods[human.labels == leg][2]
        low, high = sorted((foot[i], foot[3 + i]))
        z = min(foot[2], foot[5]) - foot[6]
        axis.plot((low - 0.12, high + 0.12), (z, z), color=style.INK, lw=2.0)


def _draw_ranges(axis: object, human: Human) -> None:
    arm = human.arm("right")
    lower, upper = np.degrees(arm.ranges).T
    rows = np.arange(len(ARM_JOINTS))
    axis.barh(rows, upper - lower, left=lower, height=0.5, color=style.LINE)
    look = {"ls": "", "ms": 9, "mec": "white"}
    for name, colour, shift in (
        ("left", style.BLUE, -0.12),
        ("right", style.AMBER, 0.12),
    ):
        now = np.degrees(human.arms[name])
        axis.plot(now, rows + shift, "o", color=colour, label=f"{name} now", **look)
    for row, low, high in zip(rows, lower, upper, strict=True):
        text = {"color": style.FAINT, "size": 8.5, "va": "center"}
        axis.text(low - 5, row, f"{low:.0f}", ha="right", **text)
        axis.text(high + 5, row, f"{high:.0f}", ha="left", **text)
        axis.text(
            -95, row - 0.38, ARM_JOINTS[row], color=style.INK, size=9.5, ha="left"
        )
    axis.axvline(0, color=style.FAINT, lw=0.7, zorder=0)
    axis.set(yticks=[], xlim=(-125, 215), ylim=(len(rows) + 0.1, -0.8))
    axis.set_xlabel("joint angle [deg]")
    style.legend(axis, loc="lower right", ncols=2)
    style.set_title(axis, "ranges of motion of an arm")
    style.tidy(axis)
    axis.spines["left"].set_visible(False)


def part_colour(part: Part) -> str:
    """Return the colour of a part of the body in our pictures."""
    return _COLOURS.get(
        part, style.BLUE if part.name.startswith("LEFT") else style.AMBER
    )


def outline(capsule: np.ndarray, plane: tuple, **look: object) -> object:
    """Return a capsule seen along the third axis: two half circles and their sides."""
    from matplotlib.patches import Polygon

    a, b = capsule[list(plane)], capsule[[3 + k for k in plane]]
    along = np.arctan2(*(b - a)[::-1])
    turn = np.linspace(-np.pi / 2, np.pi / 2, 17)
    caps = [b + capsule[6] * _circle(along + turn)]
    caps.append(a + capsule[6] * _circle(along + np.pi + turn))
    return Polygon(np.concatenate(caps), **look)


def _circle(angles: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def write_strip(
    motion: MocapMotion,
    path: str | Path,
    times: list[float] | None = None,
    box: tuple = WORK_PLACE,
) -> Path:
    """Draw the person at some moments, with the work place and the robot's base: a PNG.

    Filled is the person as guessed, a red outline what is remembered and grown. By
    default eight times [s], evenly over the clip; `box` holds the ends of the work
    place along x, y and z, base frame [m].
    """
    if times is None:
        times = list(np.linspace(0.0, motion.duration_s, 8))
    if not len(times):
        raise BadInput("a strip of no moments is empty; give at least one time")
    limits = _limits(motion, times)
    wide, tall, deep = (high - low for low, high in limits)
    scale = 2.4 / max(wide, 1.0)  # inches per metre
    size = (2.6 * len(times) + 0.6, scale * (tall + deep) + 1.4)
    figure = style.new_figure(*size, motion.name)
    ratios = {"height_ratios": (deep, tall)}
    axes = figure.subplots(
        2, len(times), sharex=True, sharey="row", squeeze=False, gridspec_kw=ratios
    )
    for row, normal in zip(axes, (1, 2), strict=True):
        plane, view = style.VIEWS[normal]
        for axis, t in zip(row, times, strict=True):
            _draw_moment(axis, motion, t, plane, box)
            style.space_axes(axis, normal, view=f"{view}: ")
            axis.set(xlim=limits[0], ylim=limits[plane[1]])
            axis.label_outer()
            if normal == 1:
                style.set_title(axis, f"{t:.2f} s")
    return style.save(figure, path)


def _limits(motion: MocapMotion, times: list[float]) -> list[tuple[float, float]]:
    """Return (low, high) of x, y and z that show the robot and the person [m]."""
    people = np.concatenate([motion.guess(t) for t in times])
    shown = Silhouette(people).points()
    low = np.minimum(shown.min(axis=0), [-0.15, -0.5, -0.1]) - 0.05
    high = np.maximum(shown.max(axis=0), [0.75, 0.5, 0.75]) + 0.05
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
            axis.add_patch(outline(known[k], plane, fc="none", ec=style.RED, lw=0.9))
    corner, sides = (box[i][0], box[j][0]), (np.ptp(box[i]), np.ptp(box[j]))
    axis.add_patch(Rectangle(corner, *sides, fc="none", ec=style.INK, ls="--", lw=0.9))
    axis.add_patch(Circle((0, 0), 0.08, fc=style.INK, ec="none"))
    style.draw_floor(axis)
