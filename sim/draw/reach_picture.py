"""Cuts through a reach map, as in figure 3 of the interaction workspace paper."""

from pathlib import Path

import numpy as np

from handover import ReachMap
from sim.draw.pictures import FAINT, INK

_AXES = "xyz"


def write_reach_plot(reach: ReachMap, path: str | Path) -> Path:
    """Draw two cuts through a map: the best quality, and the share of rotations.

    Each cut goes through the layer of cells where most is reached.

    Args:
        reach: The map.
        path: PNG file to write.

    Returns:
        The path written.
    """
    from matplotlib.figure import Figure

    best, share = by_position(reach)
    figure = Figure(figsize=(10.5, 9.0), layout="constrained", facecolor="white")
    axes = figure.subplots(2, 2)
    for row, normal in enumerate((1, 2)):
        layer = fullest_layer(share, normal)
        for column, (values, name) in enumerate(
            ((best, "best quality over all rotations"), (share, "rotations reached"))
        ):
            ax = axes[row][column]
            cut = np.take(values, layer, axis=normal)
            image = _draw(ax, reach, cut, normal, "turbo" if column == 0 else "viridis")
            at = reach.grid.origin[normal] + (layer + 0.5) * reach.grid.cell
            ax.set_title(
                f"{name}, cut at {_AXES[normal]} = {at:.2f}", color=INK, fontsize=10
            )
            figure.colorbar(image, ax=ax, shrink=0.85)
    figure.suptitle(
        f"{reach.chain.name}: {reach.n_marked:,} cells of {reach.grid.cell:g} "
        f"{reach.chain.unit} and {reach.grid.rotations.n_cells} rotations",
        color=INK,
    )
    path = Path(path)
    figure.savefig(path, dpi=110)
    return path


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


def _draw(ax, reach: ReachMap, cut: np.ndarray, normal: int, colours: str):
    across, up = [k for k in range(3) if k != normal]
    low, high = reach.grid.box
    image = ax.imshow(
        np.ma.masked_less_equal(cut.T, 0.0),
        origin="lower",
        extent=(low[across], high[across], low[up], high[up]),
        cmap=colours,
        vmin=0.0,
        vmax=max(float(cut.max()), 1e-9),
        interpolation="nearest",
    )
    ax.set_facecolor("#f4f6f8")
    ax.plot(0.0, 0.0, "+", color=INK, markersize=9)
    ax.annotate(
        reach.chain.frame, (0.0, 0.0), (4, 4), textcoords="offset points",
        color=INK, fontsize=8,
    )  # fmt: skip
    ax.set_xlabel(f"{_AXES[across]} [{reach.chain.unit}]", color=FAINT)
    ax.set_ylabel(f"{_AXES[up]} [{reach.chain.unit}]", color=FAINT)
    return image
