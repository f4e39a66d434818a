"""Maps as pictures: what a cell takes away of the roadmap; cuts through a reach map."""

from pathlib import Path

import numpy as np

from handover import ReachMap
from odm.cell_map.cell_map import CellMap
from sim.draw import style
from sim.draw.silhouette import cover_silhouette


def plot_map(cell_map: CellMap, path: str | Path) -> Path:
    """Draw what a map covers, over the robot in the middle of its limits, as a PNG.

    From three sides: how many nodes a cell takes away, the most along each line of
    sight.
    """
    from matplotlib.colors import LogNorm

    grid, robot = cell_map.grid, cell_map.robot
    counts = node_counts(cell_map)
    swept = [
        np.flatnonzero(counts.any(axis=others)) for others in ((1, 2), (0, 2), (0, 1))
    ]
    origin = grid.origin + grid.h * np.array([cells[0] for cells in swept])
    counts = counts[tuple(np.s_[cells[0] : cells[-1] + 1] for cells in swept)]
    nx, ny, nz = counts.shape
    widest = max(nx, ny, nz)
    name, nodes = cell_map.recipe.name, cell_map.roadmap.n_nodes
    title = f"map {name} of {robot.name}: how many of its {nodes:,} nodes "
    title += "an obstacle there blocks"
    figure = style.new_figure(13, 4.8, title)
    widths = [nx, nx, max(ny, widest / 4), widest / 25]
    axes = figure.subplots(1, 4, gridspec_kw={"width_ratios": widths})
    norm = LogNorm(1, max(2, int(counts.max())))
    outline = cover_silhouette(robot, (robot.lower + robot.upper) / 2)
    for axis, normal in zip(axes, (2, 1, 0), strict=False):
        most = counts.max(axis=normal).T.astype(float)
        most[most == 0] = np.nan
        (u, v), view = style.VIEWS[normal]
        look = {"colours": "YlGnBu", "norm": norm}
        shown = style.draw_cut(axis, origin[[u, v]], grid.h, most, **look)
        outline.draw(axis, (u, v))
        style.space_axes(axis, normal)
        axis.locator_params(nbins=5)
        style.set_title(axis, view)
    label = "nodes that a cell blocks, the most along the line of sight"
    style.colour_bar(figure, shown, label, cax=axes[3])
    return style.save(figure, path, dpi=110)


def node_counts(cell_map: CellMap) -> np.ndarray:
    """Return (nx, ny, nz) how many nodes a point in each cell invalidates."""
    cells, blocks = cell_map.arm_cells.by_block, cell_map.grid.blocks
    is_node = np.asarray(cells.t_item) < cell_map.roadmap.n_nodes
    block = np.repeat(np.arange(len(cells.t_ptr) - 1), np.diff(cells.t_ptr))[is_node]
    mask = np.asarray(cells.t_mask)[is_node]
    counts = np.zeros((cell_map.grid.n_blocks, 64), np.int64)
    for bit in range(64):  # x, y, z of a cell in its block: two bits each
        swept = (mask >> np.uint64(bit)) & np.uint64(1) > 0
        counts[:, bit] = np.bincount(block[swept], minlength=len(counts))
    counts = counts.reshape(*blocks, 4, 4, 4).transpose(0, 3, 1, 4, 2, 5)
    return np.ascontiguousarray(counts).reshape(4 * np.asarray(blocks))


def write_reach_plot(reach: ReachMap, path: str | Path) -> Path:
    """Draw two cuts through a map as a PNG: best quality, and share of rotations.

    As in figure 3 of [Vahrenkamp2016]. Each cut goes through the layer of cells where
    most is reached.
    """
    best, share = by_position(reach)
    fields = (
        ("best quality", "quality, the best of all rotations", best),
        ("rotations reached", "share of all rotations", share),
    )
    chain, grid = reach.chain, reach.grid
    figure = style.new_figure(
        10.5,
        9.0,
        f"{chain.name}: {reach.n_marked:,} cells of {grid.cell:g} {chain.unit} and "
        f"{grid.rotations.n_cells} rotations",
    )
    axes = figure.subplots(2, 2)
    for column, (name, told, values) in enumerate(fields):
        for axis, normal in zip(axes[:, column], (1, 2), strict=True):
            plane, layer = style.VIEWS[normal][0], fullest_layer(share, normal)
            cut = np.take(values, layer, axis=normal).T
            span = 0.0, max(float(cut.max()), 1e-9)
            cut = np.where(cut > 0.0, cut, np.nan)
            corner = grid.origin[list(plane)]
            image = style.draw_cut(axis, corner, grid.cell, cut, span)
            axis.plot(0.0, 0.0, "+", color="white", markersize=11, markeredgewidth=3)
            axis.plot(0.0, 0.0, "+", color=style.INK, markersize=9)
            frame = {"textcoords": "offset points", "color": style.INK, "size": 8}
            frame["bbox"] = {"facecolor": "white", "alpha": 0.8, "lw": 0.0, "pad": 1.5}
            axis.annotate(chain.frame, (0.0, 0.0), (5, 5), **frame)
            style.space_axes(axis, normal, chain.unit)
            at = grid.origin[normal] + (layer + 0.5) * grid.cell
            where = f"{style.AXES[normal]} = {at:.2f} {chain.unit}"
            style.set_title(axis, f"{name}, cut at {where}")
            place = {"ax": axis, "location": "right", "shrink": 0.85}
            style.colour_bar(figure, image, told, **place)
    return style.save(figure, path, dpi=110)


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
