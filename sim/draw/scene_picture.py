"""A hand-over scene as a picture: both agents, furniture, object at start and goal."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from handover import Scene
from handover.scenes.plan_file import WHO, change_time, joints_at, object_at
from handover.scenes.scene import PlacedAgent
from sim.draw.standing import all_triangles
from sim.draw.style import AMBER, FAINT, INK, TEAL, new_figure, save

_GIVER, _RECEIVER, _FURNITURE = TEAL, "#4a7fb5", "#d8cdbd"
_START, _GOAL, _HANDOVER = AMBER, "#c43e3e", "#7b4fa3"
_VIEWS = ((22.0, -62.0), (4.0, -90.0), (89.0, -90.0))  # elevation, azimuth [deg]
_NAMES = ("", "from the side", "from above")
_LIGHT = np.array([0.35, -0.5, 0.8]) / np.linalg.norm([0.35, -0.5, 0.8])


def draw_scene(scene: Scene, path: str | Path, plan: Mapping | None = None) -> Path:
    """Draw a scene from three sides.

    Args:
        scene: The scene.
        path: PNG file to write, whole or not at all.
        plan: Record of a plan of it, see `handover.scenes.plan_file`: both agents are
            drawn as they hand over, the object where it changes hands.

    Returns:
        The path written.
    """
    title = f"{scene.name}, seed {scene.seed}: {scene.obj.name} amber at its start, "
    title += "red at its goal"
    joints = ({}, {})
    poses = [(scene.T_world_start, _START), (scene.T_world_goal, _GOAL)]
    if plan is not None and (t := change_time(plan)) is not None:
        joints = tuple(joints_at(plan, who, t) for who in WHO)
        poses.append((object_at(plan, scene, t), _HANDOVER))
        title += ", violet where it changes hands"
    parts = [
        (agent_triangles(scene.giver, joints[0]), _GIVER),
        (agent_triangles(scene.receiver, joints[1]), _RECEIVER),
        (
            all_triangles(f.shape for f in scene.scenery if f.name != "floor"),
            _FURNITURE,
        ),
        *((all_triangles(scene.object_shapes(T)), colour) for T, colour in poses),
    ]
    figure = new_figure(15.0, 6.0, title)
    for k, (view, name) in enumerate(zip(_VIEWS, _NAMES, strict=True), 1):
        axis = figure.add_subplot(1, 3, k, projection="3d")
        _draw(axis, parts, view)
        axis.set_title(name, color=INK, size=10)
    return save(figure, path, dpi=110)


def agent_triangles(placed: PlacedAgent, joints: dict[str, float]) -> np.ndarray:
    """Return an agent's triangles (n, 3, 3), world frame [m]; see its `shapes`."""
    return all_triangles(shape for _, shape in placed.shapes(joints))


def _draw(
    axis: object, parts: list[tuple[np.ndarray, str]], view: tuple[float, float]
) -> None:
    """Draw all triangles as one collection, so that nearer ones hide farther ones."""
    from matplotlib.colors import to_rgb
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    triangles = np.concatenate([corners for corners, _ in parts])
    colours = np.concatenate(
        [np.tile(to_rgb(colour), (len(corners), 1)) for corners, colour in parts]
    )
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
    shade = 0.62 + 0.38 * np.abs(normal @ _LIGHT)
    axis.add_collection3d(
        Poly3DCollection(triangles, facecolors=colours * shade[:, None], linewidths=0.0)
    )
    low, high = (
        triangles.reshape(-1, 3).min(axis=0),
        triangles.reshape(-1, 3).max(axis=0),
    )
    low[2] = 0.0
    half = 0.5 * float((high - low).max())
    middle = 0.5 * (low + high)
    for name, at in zip("xyz", middle, strict=True):
        getattr(axis, f"set_{name}lim")(at - half, at + half)
    ring = np.array([[low[0], low[1]], [high[0], low[1]], high[:2], [low[0], high[1]]])
    ring = np.concatenate([ring, ring[:1]])
    axis.plot(ring[:, 0], ring[:, 1], 0.0, color=FAINT, lw=0.8)
    axis.view_init(*view)
    axis.set_proj_type("ortho")
    axis.set_box_aspect((1, 1, 1), zoom=1.45)
    axis.set_axis_off()
