"""A hand-over scene as a picture: both agents, furniture, object at start and goal."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from handover import Scene
from handover.scenes.plan_file import WHO, change_time, joints_at, object_at
from handover.scenes.scene import PlacedAgent
from sim.draw.style import AMBER, BLUE, FAINT, INK, RED, TEAL, WOOD, new_figure, save
from sim.draw.surroundings import add_shaded, all_triangles, show_box

_GIVER, _RECEIVER, _FURNITURE = TEAL, BLUE, WOOD
_START, _GOAL, _HANDOVER = AMBER, RED, "#7b4fa3"
_VIEWS = ((22.0, -62.0), (4.0, -90.0), (89.0, -90.0))  # elevation, azimuth [deg]
_FILLS = 1.5  # zoom at which the longest side fills a view
_NAMES = ("from the right and above", "from the side", "from above")


def draw_scene(scene: Scene, path: str | Path, plan: Mapping | None = None) -> Path:
    """Draw a scene from three sides as a PNG.

    With the record of a plan of it, see `handover.scenes.plan_file`, both agents are
    drawn as they hand over, and the object where it changes hands.
    """
    title = f"{scene.name}, seed {scene.seed}: giver green, receiver blue; "
    title += f"{scene.obj.name} amber at its start, red at its goal"
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
    points = np.concatenate([corners.reshape(-1, 3) for corners, _ in parts])
    low, high = points.min(axis=0), points.max(axis=0)
    low[2] = 0.0
    add_shaded(axis, parts, _FILLS / _reach(high - low, view))
    show_box(axis, low, high)
    ring = np.array([[low[0], low[1]], [high[0], low[1]], high[:2], [low[0], high[1]]])
    ring = np.concatenate([ring, ring[:1]])
    axis.plot(ring[:, 0], ring[:, 1], 0.0, color=FAINT, lw=0.8)
    axis.view_init(*view)


def _reach(size: np.ndarray, view: tuple[float, float]) -> float:
    """Return how far a box (3,) reaches across or up the view, in half sides."""
    rise, turn = np.deg2rad(view)
    x, y, z = size / size.max()
    across = abs(np.sin(turn)) * x + abs(np.cos(turn)) * y
    along = abs(np.cos(turn)) * x + abs(np.sin(turn)) * y
    return max(across, np.cos(rise) * z + np.sin(rise) * along)
