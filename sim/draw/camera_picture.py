"""The picture of `odm camera`: the depth image, and the cells it shows."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from odm.cameras.space import CELL_NAMES
from roadmap.kinematics.forward import sphere_centers
from sim.draw.coverage import draw_silhouette
from sim.draw.pictures import FAINT, INK, LINE, set_title, tidy

if TYPE_CHECKING:
    from odm import SeenSpace

OCCUPIED = CELL_NAMES.index("occupied")
COLOURS = {
    "free": "#bfe3cf",
    "shadow": "#b9c0c8",
    "occupied": "#c43e3e",
    "remembered": "#e0a14a",
    "unknown": "#d9cbe6",
}
_VIEW = "#00857c"


def plot_cells(
    space: "SeenSpace", image: np.ndarray, q: np.ndarray, path: str | Path
) -> Path:
    """Draw the image, a slice from the side and one from above through the cells.

    Args:
        space: After a frame; its first camera is drawn.
        image: (height, width) uint16 of that camera.
        q: (dof,) the robot's configuration.
        path: PNG file to write.

    Returns:
        The path written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14.5, 4.7), layout="constrained", facecolor="white")
    axes = figure.subplots(1, 3, gridspec_kw={"width_ratios": [1.3, 1, 1]})
    _draw_image(figure, axes[0], space.cameras[0], image)
    cells = space.cells()
    _draw_slice(axes[1], space, cells, q, 1)
    _draw_slice(axes[2], space, cells, q, 2)
    _legend(axes[1], cells)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    return path


def _draw_image(
    figure: object, axis: object, camera: object, image: np.ndarray
) -> None:
    depth = np.ma.masked_equal(np.where(image == 65535, 0, image), 0) * camera.scale
    axis.set_facecolor("#f3f5f7")
    low, high = np.percentile(depth.compressed(), [1, 99])
    shown = axis.imshow(depth, cmap="viridis_r", vmin=low, vmax=high)
    axis.set_xticks([])
    axis.set_yticks([])
    for spine in axis.spines.values():
        spine.set_color(LINE)
    place = axis.inset_axes([0.15, -0.09, 0.7, 0.045])
    bar = figure.colorbar(shown, cax=place, orientation="horizontal")
    bar.set_label("depth [m]; no reading where blank", color=FAINT)
    bar.ax.tick_params(colors=FAINT, labelsize=9)
    bar.outline.set_visible(False)
    set_title(axis, f"{camera.name}, {camera.width} x {camera.height}")


def _draw_slice(
    axis: object, space: "SeenSpace", cells: np.ndarray, q: np.ndarray, across: int
) -> None:
    """Draw the layer of cells with the most occupied ones, looking along an axis."""
    from matplotlib.colors import to_rgba

    grid = space.cell_map.grid
    others = tuple(a for a in range(3) if a != across)
    layer = int((cells == OCCUPIED).sum(axis=others).argmax())
    codes = np.take(cells, layer, axis=across)
    colours = np.ones((len(CELL_NAMES), 4))
    for name, colour in COLOURS.items():
        colours[CELL_NAMES.index(name)] = to_rgba(colour)
    u, v = others
    extent = (grid.origin[u], grid.upper[u], grid.origin[v], grid.upper[v])
    axis.imshow(
        colours[codes].transpose(1, 0, 2), origin="lower", extent=extent, zorder=0
    )
    robot = space.robot
    places = sphere_centers(robot, q)[:, [u, v]]
    draw_silhouette(axis, places, robot.spheres[:, 3])
    _draw_camera(axis, space.cameras[0], u, v)
    tidy(axis)
    axis.set(xlabel=f"{'xyz'[u]} [m]", ylabel=f"{'xyz'[v]} [m]")
    _frame(axis, space, codes, extent, u, v)
    at = grid.origin[across] + grid.h * (layer + 0.5)
    side = ("from the front", "from the side", "from above")[across]
    set_title(axis, f"{side}: the cells at {'xyz'[across]} = {at:.2f} m")


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
    axis.add_patch(Polygon(outline, fill=False, edgecolor=_VIEW, alpha=0.5, lw=0.7))
    axis.plot(eye[u], eye[v], "o", color=_VIEW, ms=5)
    axis.annotate(
        "camera", (eye[u], eye[v]), (-6, 5), textcoords="offset points", color=_VIEW,
        size=9, ha="right",
    )  # fmt: skip


def _frame(
    axis: object, space: "SeenSpace", codes: np.ndarray, extent: tuple, u: int, v: int
) -> None:
    """Show what is in reach and the camera, not the empty corners of the grid."""
    beyond = CELL_NAMES.index("out of reach")
    h, eye = space.cell_map.grid.h, space.cameras[0].T_base_camera[:3, 3]
    for k, (line, set_limits) in enumerate(((u, axis.set_xlim), (v, axis.set_ylim))):
        held = np.flatnonzero((codes != beyond).any(axis=1 - k))
        low, high = extent[2 * k] + h * held[0], extent[2 * k] + h * (held[-1] + 1)
        set_limits(min(low, eye[line] - 0.1), max(high, eye[line] + 0.1))
    axis.set_aspect("equal")


def _legend(axis: object, cells: np.ndarray) -> None:
    from matplotlib.patches import Patch

    present = [n for n in COLOURS if (cells == CELL_NAMES.index(n)).any()]
    handles = [Patch(color=COLOURS[n], label=n) for n in present]
    handles.append(Patch(facecolor="white", edgecolor=LINE, label="not seen"))
    axis.figure.legend(
        handles=handles, loc="outside lower right", ncols=len(handles), frameon=False,
        labelcolor=INK, fontsize=9,
    )  # fmt: skip
