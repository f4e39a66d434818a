"""The picture of `odm camera`: the depth image, and the cells it shows."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from odm.cameras.space import CELL_NAMES
from sim.draw import style
from sim.draw.silhouette import cover_silhouette

if TYPE_CHECKING:
    from odm import SeenSpace

OCCUPIED = CELL_NAMES.index("occupied")
BEYOND = CELL_NAMES.index("out of reach")
COLOURS = {
    "free": "#bfe3cf",
    "shadow": "#b9c0c8",
    "occupied": style.RED,
    "remembered": "#e0a14a",
    "unknown": "#d9cbe6",
}


def plot_cells(
    space: "SeenSpace", image: np.ndarray, q: np.ndarray, path: str | Path
) -> Path:
    """Draw the image, a slice from the side and one from above through the cells.

    `image` is of the first camera of `space` in the last frame.
    """
    figure = style.new_figure(14.5, 4.9)
    figure.get_layout_engine().set(h_pad=0.15)
    axes = figure.subplots(1, 3, gridspec_kw={"width_ratios": [1.3, 1, 1]})
    _draw_image(figure, axes[0], space.cameras[0], image)
    cells = space.cells()
    _draw_slice(axes[1], space, cells, q, 1)
    _draw_slice(axes[2], space, cells, q, 2)
    _legend(figure, cells)
    return style.save(figure, path, dpi=110)


def _draw_image(
    figure: object, axis: object, camera: object, image: np.ndarray
) -> None:
    depth = np.ma.masked_equal(np.where(image == 65535, 0, image), 0) * camera.scale
    axis.set_facecolor("#f3f5f7")
    valid = depth.compressed()
    low, high = np.percentile(valid, [1, 99]) if len(valid) else (0.0, 1.0)
    shown = axis.imshow(depth, cmap="viridis_r", vmin=low, vmax=high)
    axis.set_xticks([])
    axis.set_yticks([])
    axis.spines[:].set_color(style.LINE)
    label = "depth [m]; no reading where blank"
    style.colour_bar(figure, shown, label, ax=axis, shrink=0.7)
    style.set_title(axis, f"{camera.name}, {camera.width} x {camera.height}")


def _draw_slice(
    axis: object, space: "SeenSpace", cells: np.ndarray, q: np.ndarray, normal: int
) -> None:
    """Draw the layer of cells with the most occupied ones, looking along an axis.

    Where none is occupied, the layer with the most cells in reach.
    """
    from matplotlib.colors import to_rgba

    grid, (plane, view) = space.cell_map.grid, style.VIEWS[normal]
    chosen = cells == OCCUPIED if (cells == OCCUPIED).any() else cells != BEYOND
    layer = int(chosen.sum(axis=plane).argmax())
    codes = np.take(cells, layer, axis=normal).T
    colours = np.ones((len(CELL_NAMES), 4))
    for name, colour in COLOURS.items():
        colours[CELL_NAMES.index(name)] = to_rgba(colour)
    style.draw_cut(axis, grid.origin[list(plane)], grid.h, colours[codes], zorder=0)
    cover_silhouette(space.robot, q).draw(axis, plane)
    _draw_camera(axis, space.cameras[0], *plane)
    style.space_axes(axis, normal)
    _frame(axis, space, codes, plane)
    at = grid.origin[normal] + grid.h * (layer + 0.5)
    style.set_title(axis, f"{view}: the cells at {style.AXES[normal]} = {at:.2f} m")


def _draw_camera(axis: object, camera: object, u: int, v: int) -> None:
    """Draw the eye and what is in view up to a depth of one metre."""
    from matplotlib.patches import Polygon
    from scipy.spatial import ConvexHull

    T = camera.T_base_camera
    eye = T[:3, 3]
    right, low = camera.width - 1.0, camera.height - 1.0
    pixels = np.array([(0.0, 0.0), (right, 0.0), (right, low), (0.0, low)])
    slopes = (pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    ends = eye + np.column_stack([slopes, np.ones(4)]) @ T[:3, :3].T
    corners = np.vstack([eye, ends])[:, [u, v]]
    outline = corners[ConvexHull(corners).vertices]
    axis.add_patch(
        Polygon(outline, fill=False, edgecolor=style.TEAL, alpha=0.5, lw=0.7)
    )
    axis.plot(eye[u], eye[v], "o", color=style.TEAL, ms=5)
    axis.annotate(
        "camera", (eye[u], eye[v]), (-6, 5), textcoords="offset points", size=9,
        color=style.TEAL, ha="right",
    )  # fmt: skip


def _frame(
    axis: object, space: "SeenSpace", codes: np.ndarray, plane: tuple[int, int]
) -> None:
    """Show what is in reach and the camera, not the empty corners of the grid."""
    grid, eye = space.cell_map.grid, space.cameras[0].T_base_camera[:3, 3]
    shown = codes != BEYOND
    for k, (line, set_limits) in enumerate(
        zip(plane, (axis.set_xlim, axis.set_ylim), strict=True)
    ):
        held = np.flatnonzero(shown.any(axis=k))
        low, high = grid.origin[line] + grid.h * (held[[0, -1]] + [0, 1])
        set_limits(min(low, eye[line] - 0.1), max(high, eye[line] + 0.1))


def _legend(figure: object, cells: np.ndarray) -> None:
    from matplotlib.patches import Patch

    present = [n for n in COLOURS if (cells == CELL_NAMES.index(n)).any()]
    handles = [Patch(color=COLOURS[n], label=n) for n in present]
    handles.append(Patch(facecolor="white", edgecolor=style.LINE, label="not seen"))
    columns = {"loc": "outside lower right", "ncols": len(handles)}
    style.legend(figure, handles=handles, **columns)
