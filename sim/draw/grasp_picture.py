"""A set of grasps as a picture: all palms about the object, and a few closed hands."""

from pathlib import Path

import numpy as np

from handover import GraspSet, hand_names, load_hand
from roadmap.errors import BadInput
from roadmap.transforms import moved_points, pose_of_flat
from sim.draw import style
from sim.draw.surroundings import capsule_mesh, show_box

_SHOWN = 5  # closed hands
_ARROW = 0.03  # [m] length of a palm's line
_SECTIONS = 12  # facets of a round link


def write_grasp_plot(grasps: GraspSet, path: str | Path) -> Path:
    """Draw where the palms are, by quality, and five closed hands: a PNG."""
    if grasps.hand not in hand_names():
        raise BadInput(
            f"the hand {grasps.hand!r} of this set is of a robot of one's own, which "
            "the set does not hold; draw a plan: odm handover plan SCENE --plot PNG"
        )
    figure = style.new_figure(
        13.0,
        8.6,
        f"{grasps.thing.name} by {grasps.hand}: {len(grasps)} grasps; contacts amber",
    )
    triangles = np.concatenate(grasps.thing.triangles())
    first = figure.add_subplot(2, 3, 1, projection="3d")
    _draw_palms(figure, first, grasps, triangles)
    ranked = np.argsort(-grasps.quality, kind="stable")
    places = np.linspace(0, len(grasps) - 1, _SHOWN).round().astype(int)
    for panel, row in enumerate(ranked[places], 2):
        axis = figure.add_subplot(2, 3, panel, projection="3d")
        _draw_grasp(axis, grasps, int(row), triangles)
    return style.save(figure, path, dpi=110)


def hand_triangles(grasps: GraspSet, row: int) -> np.ndarray:
    """Return triangles (n, 3, 3) of the closed hand of a grasp, object frame [m]."""
    import trimesh

    hand = load_hand(grasps.hand)
    state = hand.state(grasps.T_object_palm[row], grasps.values[row])
    solids, found = hand.arrays.solids, []
    for i, frame in enumerate(state.frames):
        points = solids.points[solids.ptr[i] : solids.ptr[i + 1]]
        radius, half = solids.size[i]
        margin, T = solids.margin[i], np.eye(4)
        if len(points) == 0:
            mesh = trimesh.creation.cylinder(radius, 2 * half, sections=_SECTIONS)
        elif len(points) > 2:
            mesh = trimesh.convex.convex_hull(points)
        else:
            length = float(np.linalg.norm(points[-1] - points[0]))
            mesh = capsule_mesh(length, margin, _SECTIONS // 2, _SECTIONS)
            T[:3, 3] = points.mean(axis=0)
        T = pose_of_flat(frame) @ T
        corners = np.asarray(mesh.triangles)
        found.append(moved_points(corners, T))
    return np.concatenate(found)


def _draw_palms(
    figure: object, axis: object, grasps: GraspSet, triangles: np.ndarray
) -> None:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    _draw_solid(axis, triangles, style.GREY, 0.25)
    T = grasps.T_object_palm
    lines = np.stack([T[:, :3, 3] - _ARROW * T[:, :3, 2], T[:, :3, 3]], axis=1)
    top = float(grasps.quality.max())
    colours = colormaps[style.QUALITY](grasps.quality / top)
    axis.add_collection3d(Line3DCollection(lines, colors=colours, linewidths=0.8))
    image = ScalarMappable(cmap=style.QUALITY)
    image.set_clim(0.0, top)
    style.colour_bar(figure, image, "quality", ax=axis)
    axis.set_title("palms, along their approach", color=style.INK, size=10)
    _frame(axis, np.concatenate([triangles.reshape(-1, 3), lines.reshape(-1, 3)]))


def _draw_grasp(
    axis: object, grasps: GraspSet, row: int, triangles: np.ndarray
) -> None:
    hand = hand_triangles(grasps, row)
    _draw_solid(axis, triangles, style.GREY, 0.5)
    _draw_solid(axis, hand, style.TEAL, 0.35)
    span = slice(*grasps.contact_ptr[row : row + 2])
    axis.scatter(
        *grasps.contact_point[span].T, color=style.AMBER, s=14, depthshade=False
    )
    axis.set_title(
        f"grasp {row}: quality {grasps.quality[row]:.3f}", color=style.INK, size=10
    )
    _frame(axis, np.concatenate([triangles, hand]).reshape(-1, 3))


def _draw_solid(axis: object, triangles: np.ndarray, colour: str, alpha: float) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axis.add_collection3d(
        Poly3DCollection(
            triangles, facecolors=colour, linewidths=0.0, alpha=alpha, shade=True
        )
    )


def _frame(axis: object, points: np.ndarray) -> None:
    """Show all points to scale, without a box around them."""
    show_box(axis, points.min(axis=0), points.max(axis=0))
    axis.set_box_aspect((1, 1, 1), zoom=1.3)
    axis.set_axis_off()
