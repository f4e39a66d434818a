"""Cuts through a reach map, as in figure 3 of the interaction workspace paper."""

from pathlib import Path

import numpy as np

from handover import ReachMap
from sim.draw.style import (
    AXES,
    INK,
    QUALITY,
    VIEWS,
    colour_bar,
    draw_cut,
    new_figure,
    save,
    set_title,
    space_axes,
)


def write_reach_plot(reach: ReachMap, path: str | Path) -> Path:
    """Draw two cuts through a map as a PNG: best quality, and share of rotations.

    Each cut goes through the layer of cells where most is reached.
    """
    fields = zip(
        ("best quality over all rotations", "rotations reached"),
        by_position(reach), (QUALITY, "viridis"), strict=True,
    )  # fmt: skip
    chain, grid = reach.chain, reach.grid
    figure = new_figure(
        10.5,
        9.0,
        f"{chain.name}: {reach.n_marked:,} cells of {grid.cell:g} {chain.unit} and "
        f"{grid.rotations.n_cells} rotations",
    )
    axes = figure.subplots(2, 2)
    share = by_position(reach)[1]
    for column, (name, values, colours) in enumerate(fields):
        for axis, normal in zip(axes[:, column], (1, 2), strict=True):
            plane, layer = VIEWS[normal][0], fullest_layer(share, normal)
            cut = np.take(values, layer, axis=normal).T
            span = 0.0, max(float(cut.max()), 1e-9)
            cut = np.where(cut > 0.0, cut, np.nan)
            corner = grid.origin[list(plane)]
            image = draw_cut(axis, corner, grid.cell, cut, span, colours)
            axis.plot(0.0, 0.0, "+", color="white", markersize=11, markeredgewidth=3)
            axis.plot(0.0, 0.0, "+", color=INK, markersize=9)
            frame = {"textcoords": "offset points", "color": INK, "size": 8}
            frame["bbox"] = {"facecolor": "white", "alpha": 0.8, "lw": 0.0, "pad": 1.5}
            axis.annotate(chain.frame, (0.0, 0.0), (5, 5), **frame)
            space_axes(axis, normal, chain.unit)
            at = grid.origin[normal] + (layer + 0.5) * grid.cell
            set_title(axis, f"{name}, cut at {AXES[normal]} = {at:.2f}")
            colour_bar(figure, image, ax=axis, location="right", shrink=0.85)
    return save(figure, path, dpi=110)


def by_position(reach: ReachMap) -> tuple[np.ndarray, np.ndarray]:
    """Return (nx, ny, nz) best quality and share of rotations reached, in [0, 1]."""
    best = np.zeros(reach.grid.n_positions)
    share = np.zeros(reach.grid.n_positions)
    rows, first = np.flatnonzero(reach.packed.row_of >= 0), reach.packed.first
    best[rows] = np.maximum.reduceat(reach.packed.quality, first[:-1]) / 255
    share[rows] = np.diff(first) / reach.grid.rotations.n_cells
    return best.reshape(reach.grid.shape), share.reshape(reach.grid.shape)


def fullest_layer(share: np.ndarray, normal: int) -> int:
    """Return the layer across an axis in which most cells are reached."""
    others = tuple(k for k in range(3) if k != normal)
    return int(share.sum(axis=others).argmax())
