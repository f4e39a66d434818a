"""A recorded hand-over: the real place among those our quality prefers, as a PNG."""

from pathlib import Path

import numpy as np

from sim.bench.handover.recorded_handover import HandoverRecording
from sim.draw.silhouette import Silhouette
from sim.draw.style import (
    BODY,
    BODY_EDGE,
    INK,
    RED,
    ROBOT,
    ROBOT_EDGE,
    VIEWS,
    colour_bar,
    draw_cut,
    draw_floor,
    legend,
    new_figure,
    save,
    set_title,
    space_axes,
)

SHOWN = {"online": "comfort, q_online", "total": "with dexterity, q_total"}


def write_handover_picture(
    recording: HandoverRecording, found: object, path: str | Path
) -> Path:
    """Draw giver and taker as they grip, and cuts through the places both reach.

    Args:
        recording: The hand-over.
        found: `Judged` of it.
        path: PNG file to write, whole or not at all.

    Returns:
        The path written.
    """
    people = {
        who: Silhouette(recording.person(who, recording.taken).capsules_of("mean"))
        for who in ("giver", "taker")
    }
    points = np.concatenate([p.points() for p in people.values()])
    low, high = points.min(axis=0) - 0.08, points.max(axis=0) + 0.08
    low[2] = min(low[2], -0.05)
    wide, deep, tall = high - low
    places = f"{len(found.places):,} places that both reach"
    figure = new_figure(
        12.0,
        1.9 + 5.2 * (deep + tall) / wide,
        f"{recording.name}: where the object was taken (x), and where the model would "
        f"hand it over (o); {places}",
    )
    ratios = {"height_ratios": (tall, deep)}
    axes = figure.subplots(2, 2, gridspec_kw=ratios)
    for column, (name, words) in enumerate(SHOWN.items()):
        values = found.quality.best[name][:-1]
        for row, normal in enumerate((1, 2)):
            axis = axes[row][column]
            image = _draw(axis, found, values, normal, people)
            plane = VIEWS[normal][0]
            axis.set(
                xlim=(low[plane[0]], high[plane[0]]),
                ylim=(low[plane[1]], high[plane[1]]),
            )
            _mark(axis, found, name, plane)
        share, off = found.percentile(name), found.off_cm(name)
        told = f"better than {share:.0f} %, our best {off:.0f} cm away"
        told = told if np.isfinite(share) else "out of the taker's reach"
        set_title(axes[0][column], f"{words}: {told}")
        set_title(axes[1][column], "from above")
        label = "best over all rotations of the taker's hand"
        colour_bar(figure, image, label, ax=axes[:, column])
    legend(axes[0][0], loc="lower center")
    return save(figure, path)


def _draw(axis: object, found: object, values: np.ndarray, normal: int, people: dict):
    """Draw the layer of places nearest to the real one, and both people."""
    plane = VIEWS[normal][0]
    layers = [np.unique(found.places[:, k].round(6)) for k in range(3)]
    at = layers[normal][np.abs(layers[normal] - found.real[normal]).argmin()]
    inside = np.abs(found.places[:, normal] - at) < 1e-4
    x, y = (_even(layers[k]) for k in plane)
    field = np.full((len(y), len(x)), np.nan)
    own = found.places[inside]
    i = np.abs(own[:, plane[0], None] - x).argmin(axis=1)
    j = np.abs(own[:, plane[1], None] - y).argmin(axis=1)
    field[j, i] = values[inside]
    cell = x[1] - x[0]
    span = float(values.min()), float(values.max())
    corner = x[0] - 0.5 * cell, y[0] - 0.5 * cell
    image = draw_cut(axis, corner, cell, field, span, zorder=4)
    colours = {"giver": (ROBOT, ROBOT_EDGE), "taker": (BODY, BODY_EDGE)}
    for k, (who, solid) in enumerate(people.items()):
        solid.draw(axis, plane, *colours[who], (2 + k, 5))
    if plane[1] == 2:
        draw_floor(axis)
        for who, solid in people.items():
            middle = float(solid.points()[:, plane[0]].mean())
            axis.text(middle, 0.25, who, ha="center", color=INK, zorder=6)
    space_axes(axis, normal)
    return image


def _mark(axis: object, found: object, name: str, plane: tuple[int, int]) -> None:
    real, best = found.real[list(plane)], found.best(name)[list(plane)]
    cross = {"color": "white", "ms": 11, "mew": 4.0, "zorder": 7}
    axis.plot(*real, "x", **cross)
    cross = {"color": INK, "ms": 10, "mew": 2.0, "zorder": 8}
    axis.plot(*real, "x", label="taken here", **cross)
    ring = {"mfc": "none", "mec": "white", "ms": 12, "mew": 3.6, "zorder": 7}
    axis.plot(*best, "o", **ring)
    ring |= {"mec": RED, "mew": 1.8, "zorder": 8}
    axis.plot(*best, "o", label="our best", **ring)


def _even(places: np.ndarray) -> np.ndarray:
    """Return evenly spaced places through all of those given, ascending."""
    step = np.diff(places).min(initial=1.0)
    return places[0] + step * np.arange(round((places[-1] - places[0]) / step) + 1)
