"""The pictures of docs/how_it_works.md: `python docs/site/pictures.py [MAP]`."""

import sys
from pathlib import Path

import numpy as np

import odm
from roadmap import tool_pose
from sim.draw.silhouette import cover_silhouette
from sim.draw.style import (
    AMBER,
    BODY,
    BODY_EDGE,
    INK,
    LINE,
    RED,
    TEAL,
    new_figure,
    save,
    set_title,
    space_axes,
)

DOCS = Path(__file__).resolve().parents[1]
SIDE, PLANE = 1, (0, 2)  # seen along y
ARM = np.array([[0.95, -0.1, 0.7, 0.6, 0.0, 0.55, 0.05]])  # a forearm [m]


def cells_of(cell_map: odm.CellMap, item: int) -> np.ndarray:
    """Return (k, 3) the indices of the cells of a node, or of an edge + n_nodes."""
    lists = cell_map.arm_cells.by_item
    rows = range(int(lists.ptr[item]), int(lists.ptr[item + 1]))
    return np.vstack([unpacked(cell_map, lists.block[i], lists.mask[i]) for i in rows])


def unpacked(cell_map: odm.CellMap, block: int, mask: int) -> np.ndarray:
    """Return (k, 3) the indices of the cells of one word."""
    _, ny, nz = (int(n) for n in cell_map.grid.blocks)
    corner = 4 * np.array([block // (ny * nz), block // nz % ny, block % nz])
    bits = [k for k in range(64) if int(mask) >> k & 1]
    return np.array([corner + (k >> 4, k >> 2 & 3, k & 3) for k in bits])


def draw_cells(axis: object, cell_map: odm.CellMap, cells: np.ndarray, colour: str):
    """Draw cells as squares, darker where more of them lie behind each other."""
    from matplotlib.patches import Rectangle

    grid, seen = cell_map.grid, cells[:, [0, 2]]
    places, count = np.unique(seen, axis=0, return_counts=True)
    for place, n in zip(places, count, strict=True):
        corner = grid.origin[[0, 2]] + grid.h * place
        shade = 0.15 + 0.5 * n / count.max()
        axis.add_patch(
            Rectangle(corner, grid.h, grid.h, color=colour, alpha=shade, lw=0)
        )


def draw_robot(axis: object, cell_map: odm.CellMap, q: np.ndarray) -> None:
    """Draw the outline of the robot's cover."""
    robot = cell_map.robot
    cover_silhouette(robot, q).draw(axis, PLANE)


def draw_edges(axis: object, cell_map: odm.CellMap, edges: object, **style: object):
    """Draw the way of the tool along edges."""
    from matplotlib.collections import LineCollection

    nodes, ends = cell_map.roadmap.nodes, cell_map.roadmap.edges
    tools = np.array([tool_pose(cell_map.robot, q)[:3, 3] for q in nodes])[:, [0, 2]]
    axis.add_collection(LineCollection(tools[ends[np.asarray(edges)]], **style))


def begin(axis: object, cell_map: odm.CellMap, title: str) -> None:
    """Set up one view from the side."""
    space_axes(axis, SIDE)
    axis.set(xlim=(-0.75, 1.15), ylim=(-0.15, 1.3))
    axis.axhline(0.0, color=LINE, lw=1.0)
    set_title(axis, title)


def two_views(cell_map: odm.CellMap, path: Path) -> Path:
    """Draw one edge's cells, and one cell's edges."""
    figure = new_figure(11.0, 4.6)
    left, right = figure.subplots(1, 2)
    roadmap, n = cell_map.roadmap, cell_map.roadmap.n_nodes
    edge = int(np.argsort(roadmap.lengths)[int(0.9 * roadmap.n_edges)])
    cells = cells_of(cell_map, n + edge)
    begin(left, cell_map, f"one motion: {len(cells):,} cells it sweeps")
    draw_cells(left, cell_map, cells, TEAL)
    for end in roadmap.edges[edge]:
        draw_robot(left, cell_map, roadmap.nodes[end])
    draw_edges(left, cell_map, [edge], colors=INK, lw=2.0)

    tool = tool_pose(cell_map.robot, roadmap.nodes[roadmap.edges[edge][0]])[:3, 3]
    planner = odm.ReactivePlanner(cell_map)
    planner.set_goals([roadmap.nodes[0]])
    planner.step(tool[None], q=roadmap.nodes[0])
    blocked = np.asarray(planner.invalid_edges())
    begin(right, cell_map, f"one cell: {len(blocked):,} motions it blocks")
    every = np.arange(0, roadmap.n_edges, 1 + roadmap.n_edges // 4000)
    draw_edges(right, cell_map, every, colors=LINE, lw=0.4)
    draw_edges(right, cell_map, blocked, colors=RED, lw=0.5, alpha=0.6)
    cell = np.floor((tool - cell_map.grid.origin) / cell_map.grid.h).astype(int)
    draw_cells(right, cell_map, cell[None], INK)
    return save(figure, path, dpi=110)


def one_frame(cell_map: odm.CellMap, path: Path) -> Path:
    """Draw a person's arm, its cells, what they block, and the answer."""
    from matplotlib.lines import Line2D

    figure = new_figure(6.6, 4.9)
    axis = figure.subplots()
    roadmap, robot = cell_map.roadmap, cell_map.robot
    planner = odm.ReactivePlanner(cell_map)
    tools = np.array([tool_pose(robot, q)[:3, 3] for q in roadmap.nodes])
    low = np.linalg.norm(tools - [0.45, 0.0, 0.25], axis=1).argsort()[:12]
    high = np.linalg.norm(tools - [0.45, 0.0, 0.85], axis=1).argsort()[:12]
    person = odm.Obstacles(capsules=ARM)
    answers = []
    for a, b in zip(low, high, strict=True):
        planner.set_goals([roadmap.nodes[b]])
        answers.append(planner.step(person, q=roadmap.nodes[a]))
    # the shortest that is not the straight one
    bent = [a for a in answers if len(a.path) > 2]
    answer = min(bent, key=lambda a: np.abs(np.diff(a.path, axis=0)).sum())
    begin(axis, cell_map, f"one frame: {answer.status}")
    points = odm.sample_capsules(ARM, 0.01)
    cells = np.floor((points - cell_map.grid.origin) / cell_map.grid.h).astype(int)
    draw_edges(axis, cell_map, planner.invalid_edges(), colors=RED, lw=0.3, alpha=0.2)
    draw_cells(axis, cell_map, np.unique(cells, axis=0), AMBER)
    ends = ARM[0, [0, 2, 3, 5]]
    axis.plot(ends[::2], ends[1::2], color=BODY_EDGE, lw=9, solid_capstyle="round")
    axis.plot(ends[::2], ends[1::2], color=BODY, lw=7, solid_capstyle="round")
    draw_robot(axis, cell_map, answer.path[0])
    steps = np.linspace(0.0, 1.0, 20)[:, None]
    legs = zip(answer.path[:-1], answer.path[1:], strict=True)
    way = np.vstack([a + steps * (b - a) for a, b in legs])
    places = np.array([tool_pose(robot, q)[:3, 3] for q in way])
    axis.plot(places[:, 0], places[:, 2], color=TEAL, lw=2.5)
    axis.plot(*places[-1, [0, 2]], "o", color=TEAL, ms=8)
    told = {"path": TEAL, "the arm's cells": AMBER, "motions they block": RED}
    lines = [Line2D([], [], color=c, lw=3, label=name) for name, c in told.items()]
    axis.legend(handles=lines, frameon=False, fontsize=9, loc="upper left")
    return save(figure, path, dpi=110)


if __name__ == "__main__":
    given = sys.argv[1] if len(sys.argv) > 1 else None
    recipe = DOCS / "examples" / "small_arm.toml"
    found = odm.load_map(given) if given else odm.build_map(odm.load_recipe(recipe))
    print(two_views(found, DOCS / "two_views.png"))
    print(one_frame(found, DOCS / "one_frame.png"))
