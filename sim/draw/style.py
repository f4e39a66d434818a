"""The look of every picture: colours, figures, axes, cuts through cells, files."""

from pathlib import Path

import numpy as np

from sim.terminal.output import write_whole

INK, FAINT, LINE, PALE = "#2c343e", "#616c77", "#d9dfe5", "#eef1f4"
TEAL, AMBER, RED, BLUE, SLATE = "#00857c", "#c97b12", "#c43e3e", "#4a7fb5", "#5b6b7a"
PURPLE, WOOD, GREY = "#7050b0", "#d8cdbd", "#8c96a0"  # grey: of solids, not of words
ROBOT, ROBOT_EDGE = "#bfe0dc", "#00675f"
BODY, BODY_EDGE = "#dfe4e9", "#7c8894"
# of a person and what is carried or stands around, each 0 to 1; see `person_colours`
SLEEVE, SKIN = (0.36, 0.52, 0.74), (0.93, 0.72, 0.60)
LOAD, FURNITURE = (0.85, 0.62, 0.16), (0.85, 0.80, 0.74)
QUALITY = "viridis"  # colours from bad to good, equal steps to the eye

# which capsules of a person are clothed (c) or bare (b), by their number: those of
# `handover.human.body` come hand, forearm, upper arm, then trunk, shoulders and head,
# then legs; those of `sim.people.arm` upper arm, then forearm with hand
_ARM, _WHOLE = "bbc", "bbcbbcccb"
_STANDING = f"{_WHOLE}cccccc"
_CLOTHES = {
    len(parts): parts
    for parts in (
        *("cb", "cbcb"),  # an arm, two arms
        *(_ARM, f"{_ARM}cb", f"{_ARM}ccb"),  # one is tracked, without or with a trunk
        _WHOLE,
    )
}

AXES = "xyz"
VIEWS = {  # axis looked along: axes across and up, and the name of the view
    0: ((1, 2), "from the front"),
    1: ((0, 2), "from the side"),
    2: ((0, 1), "from above"),
}


def rgb(colour: str) -> tuple[int, int, int]:
    """Return '#rrggbb' as three numbers from 0 to 255, for PIL."""
    return tuple(bytes.fromhex(colour[1:]))


def person_colours(n: int) -> np.ndarray:
    """Return the colours of n capsules of a person or several, (n, 3) from 0 to 1.

    Hands, forearms and head are skin, all else is clothed, as capsules are that come in
    another number than those of a person whom we know.
    """
    people, rest = divmod(n, len(_STANDING))
    parts = people * _STANDING if rest == 0 else _CLOTHES.get(n, n * "c")
    return np.array([SKIN if part == "b" else SLEEVE for part in parts]).reshape(-1, 3)


def new_figure(width: float, height: float, title: str = "") -> object:
    """Return an empty matplotlib figure [inches], its title at the upper left."""
    from matplotlib.figure import Figure

    figure = Figure((width, height), layout="constrained", facecolor="white")
    if title:
        figure.suptitle(title, color=INK, x=0.01, ha="left")
    return figure


def save(figure: object, path: str | Path, dpi: int = 100) -> Path:
    """Write a figure as a PNG that is there whole or not at all; makes its folder."""
    return write_whole(
        path, lambda stream: figure.savefig(stream, dpi=dpi, format="png")
    )


def tidy(axis: object) -> None:
    """Give a matplotlib axis the quiet look of our plots."""
    axis.spines[["top", "right"]].set_visible(False)
    axis.spines[["left", "bottom"]].set_color(LINE)
    axis.tick_params(which="both", colors=FAINT, labelsize=9)
    axis.xaxis.label.set_color(FAINT)
    axis.yaxis.label.set_color(FAINT)


def set_title(axis: object, text: str) -> None:
    """Write a title over the left end of an axis."""
    axis.set_title(text, loc="left", color=INK, size=11)


def legend(axis: object, **options: object) -> None:
    """Add a legend without a frame."""
    axis.legend(**{"frameon": False, "fontsize": 9, "labelcolor": INK} | options)


def space_axes(axis: object, normal: int, unit: str = "m", view: str = "") -> None:
    """Set up an axis that shows space to scale, seen along the axis `normal`.

    Args:
        axis: Of matplotlib.
        normal: 0, 1 or 2, see `VIEWS`.
        unit: Of its numbers.
        view: Said before the name of the axis that points up.
    """
    across, up = VIEWS[normal][0]
    axis.set(xlabel=f"{AXES[across]} [{unit}]", ylabel=f"{view}{AXES[up]} [{unit}]")
    axis.locator_params(nbins=6)  # labels side by side need room
    axis.set_aspect("equal")
    tidy(axis)


def draw_floor(axis: object) -> None:
    """Draw the floor of a view from the side."""
    axis.axhline(0.0, color=LINE, lw=1.0, zorder=0)


def draw_cut(
    axis: object,
    corner: tuple[float, float],
    cell: float,
    values: np.ndarray,
    span: tuple[float, float] | None = None,
    colours: str = QUALITY,
    **style: object,
) -> object:
    """Draw one layer of square cells; return the image.

    `values` (rows up, columns across) begin at the lower left `corner`; NaN is left
    free, a further axis of four holds the cells' own colours. `span` has the values
    with the first and the last of the colours, `style` further options of `imshow`.
    """
    rows, columns = values.shape[:2]
    (x, y), (low, high) = corner, span or (None, None)
    extent = (x, x + columns * cell, y, y + rows * cell)
    scale = {} if "norm" in style else {"vmin": low, "vmax": high}
    return axis.imshow(
        np.ma.masked_invalid(values), cmap=colours, extent=extent, origin="lower",
        interpolation="nearest", **scale, **style,
    )  # fmt: skip


def colour_bar(
    figure: object, image: object, label: str = "", **place: object
) -> object:
    """Add a bar of an image's colours; `place` says where, as `figure.colorbar`.

    With `ax` and no more it lies below those axes.
    """
    if "cax" not in place and "location" not in place:
        place = {"location": "bottom", "shrink": 0.8, "aspect": 30, "pad": 0.02} | place
    bar = figure.colorbar(image, **place)
    bar.outline.set_visible(False)
    bar.ax.tick_params(which="both", colors=FAINT, labelsize=9)
    bar.set_label(label, color=FAINT)
    return bar
