"""The scene in three dimensions: what of a moment has changed is sent, no more."""

from collections.abc import Callable

import numpy as np
import viser
from viser.transforms import SO3

from odm.cell_map.cell_map import CellMap
from roadmap.kinematics.forward import body_frames, tool_pose
from roadmap.robot.robot import Robot
from sim.draw.animation import tool_line
from sim.draw.style import person_colours
from sim.draw.surroundings import capsule_mesh
from sim.draw.world import turn_z_to
from sim.loop.carried import ball_rows
from sim.view import theme
from sim.view.blocked import (
    RoadmapPicture,
    cell_centers,
    line_file,
    occupied_cells,
    seen_points,
    thickness_of,
)
from sim.view.moment import NOBODY, Moment
from sim.view.robot_shapes import Part, lowest_of_robot

# name of a layer: what it says, whether it is shown at first
LAYERS = {
    "robot": ("Robot", True),
    "person": ("Person", True),
    "cells": ("Occupied cells", False),
    "points": ("Sensor points", True),
    "edges": ("Roadmap, all edges", False),
    "blocked": ("Roadmap, blocked edges", False),
    "targets": ("Targets", True),
    "path": ("Path", True),
    "before": ("Path before", True),
    "still": ("What stands around", True),
    "floor": ("Floor", True),
}
MOST_POINTS = 20_000
_FLOOR_AT = 0.3, 0.0, -0.002  # the middle of the floor, as long as nothing is lower [m]
_SINKS = 0.05  # what is so little below the floor does not stand on a lower one [m]
SKY = 1.6  # light from all around, so that no side is black
FEW_FACES = 1_000  # a mesh with fewer shows its edges
EDGE_OPACITY = 0.1  # of all edges: thousands lie before the robot
EDGES_EVERY_S = 0.2  # blocked edges are sent so often [s]
_CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_CUBE_FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip
_NONE = np.zeros((0, 3))


class Stage:
    """Draws moments into a viser scene: a robot by the meshes of its parts."""

    def __init__(
        self, scene: "viser.SceneApi", robot: Robot, parts: list[Part]
    ) -> None:
        self.scene, self.robot = scene, robot
        self.cell_map: CellMap | None = None
        self.roadmap: RoadmapPicture | None = None
        self.n_blocked: int | None = None  # edges, as they were drawn last
        self.shown = {name: on for name, (_, on) in LAYERS.items()}
        self._drawn: dict[str, object] = {}  # what a layer shows now
        self._nodes: dict[str, object] = {}
        self._edges_at = -np.inf
        self._person: list = []
        self._sizes = np.zeros((0, 2))
        self._floor = 0.0  # how low it is [m]
        self._things = 0  # from which capsule on they are no person's
        self._add_light()
        self._meshes: list = []
        self._bodies: dict[int, object] = {}
        self._nodes["robot"] = scene.add_frame("/robot", show_axes=False)
        self.set_parts(parts)

    def _add_light(self) -> None:
        self.scene.set_up_direction("+z")
        self.scene.world_axes.visible = False
        # where the processor draws, the environment took a half of a picture's time
        # and shadows, which draw all meshes four times, a quarter
        self.scene.configure_environment_map(None)
        self.scene.configure_default_lights(True, cast_shadow=False)
        self.scene.add_light_hemisphere(
            "/sky", sky_color=theme.SKY, ground_color=theme.GROUND, intensity=SKY
        )
        self._nodes["floor"] = self.scene.add_grid(
            "/floor",
            3.0,
            3.0,
            cell_size=0.1,
            section_size=0.5,
            cell_color=(232, 236, 240),
            section_color=(205, 212, 219),
            plane_color=(248, 249, 250),
            plane_opacity=1.0,
            shadow_opacity=0.0,
            position=_FLOOR_AT,
        )

    def sink(self, lowest: float) -> None:
        """Let the floor be as low as something is that stands or reaches there [m]."""
        if lowest < self._floor - _SINKS:
            self._floor = lowest
            self._nodes["floor"].position = (*_FLOOR_AT[:2], lowest + _FLOOR_AT[2])

    def set_parts(self, parts: list[Part]) -> None:
        """Draw the robot of these meshes, in place of those before."""
        for mesh in self._meshes:
            mesh.remove()
        self._meshes, self._parts = [], parts
        for body in sorted({part.body for part in parts} - set(self._bodies)):
            name = f"/robot/body_{body}"
            self._bodies[body] = self.scene.add_frame(name, show_axes=False)
        for i, part in enumerate(parts):
            colour = part.colour or (theme.ROBOT if part.body else theme.BASE)
            mesh, few = part.mesh, len(part.mesh.faces) < FEW_FACES
            if len(mesh.faces) == 0:
                continue
            node = self.scene.add_mesh_simple(
                f"/robot/body_{part.body}/part_{len(parts)}_{i}",
                mesh.vertices,
                mesh.faces,
                color=colour,
                flat_shading=few,
            )
            self._meshes.append(node)
        self._drawn.pop("robot", None)

    def stand(self, triangles: np.ndarray) -> None:
        """Draw triangles (n, 3, 3) of what stands around, in place of those before."""
        self._remove("still")
        if len(triangles) == 0:
            return
        self.sink(float(triangles[..., 2].min()))
        self._nodes["still"] = self.scene.add_mesh_simple(
            "/still",
            triangles.reshape(-1, 3).astype(np.float32),
            np.arange(3 * len(triangles)).reshape(-1, 3),
            color=theme.FURNITURE,
            flat_shading=True,
            side="double",
            visible=self.shown["still"],
        )

    @property
    def stands(self) -> bool:
        """Whether anything stands around."""
        return "still" in self._nodes

    def set_map(self, cell_map: CellMap, roadmap: RoadmapPicture) -> None:
        """Take a map, which brings cells and edges."""
        self.cell_map, self.roadmap = cell_map, roadmap
        self._remove("edges")
        self._all_edges()

    def _all_edges(self) -> None:
        """Draw all edges where they are shown: megabytes that hidden ones are not."""
        if self.shown["edges"] and self.roadmap is not None:
            self._nodes["edges"] = self.scene.add_glb(
                "/edges",
                line_file(self.roadmap.segments, theme.FREE_EDGE, EDGE_OPACITY),
                cast_shadow=False,
                receive_shadow=False,
            )

    def show(self, layer: str, on: bool) -> None:
        """Show or hide a layer."""
        self.shown[layer] = bool(on)
        self._edges_at = -np.inf
        node = self._nodes.get(layer)
        if layer == "edges" and node is None:
            self._all_edges()
        elif node is not None:
            node.visible = self.shown[layer]
        if layer == "person":
            for mesh in self._person:
                mesh.visible = self.shown[layer]

    def draw(self, moment: Moment, clock: float) -> None:
        """Draw a moment; `clock` [s] says when edges are due again."""
        self._if_new("robot", moment.q, self._place_robot)
        capsules = moment.capsules
        if moment.payload is not None and len(moment.payload):
            balls = ball_rows(self.robot, moment.payload, moment.q)
            capsules = np.vstack([capsules if len(capsules) else NOBODY, balls])
        self._things = len(moment.capsules) - moment.things
        self.sink(theme.lowest_of(moment.capsules[: max(self._things, 0)]))
        self._if_new("person", capsules, self._place_person)
        self._if_new("path", moment.path, self._path)
        self._if_new("before", moment.before, self._before)
        self._if_new("targets", moment.targets, self._targets)
        self._if_new("points", moment.points, self._points)
        if self.cell_map is None:
            return
        if self.shown["cells"] or self.shown["blocked"]:
            self._draw_cells(moment, clock)

    def _if_new(
        self, layer: str, value: np.ndarray | None, draw: Callable[[np.ndarray], None]
    ) -> None:
        """Draw what is not drawn already; None is nothing."""
        value = _NONE if value is None else value
        if self._drawn.get(layer) is value or not self.shown.get(layer, True):
            return
        before = self._drawn.get(layer)
        self._drawn[layer] = value
        if before is None or not np.array_equal(before, value, equal_nan=True):
            draw(value)

    def _place_robot(self, q: np.ndarray) -> None:
        frames = body_frames(self.robot, q)
        for body, node in self._bodies.items():
            node.position = frames[body, :3, 3]
            node.wxyz = SO3.from_matrix(frames[body, :3, :3]).wxyz
        self.sink(lowest_of_robot(self.robot, self._parts, q[None]))

    def _place_person(self, capsules: np.ndarray) -> None:
        axes = capsules[:, 3:6] - capsules[:, :3]
        sizes = np.column_stack([np.linalg.norm(axes, axis=1), capsules[:, 6]])
        if sizes.shape != self._sizes.shape or not np.allclose(
            sizes, self._sizes, atol=1e-4
        ):
            self._make_person(sizes)
        for node, row, axis in zip(self._person, capsules, axes, strict=True):
            node.position = 0.5 * (row[:3] + row[3:6])
            node.wxyz = np.roll(turn_z_to(axis), 1)

    def _make_person(self, sizes: np.ndarray) -> None:
        for node in self._person:
            node.remove()
        self._sizes, self._person = sizes, []
        people = person_colours(min(self._things, len(sizes)))
        colours = [tuple(row) for row in np.round(255 * people).astype(int).tolist()]
        colours += [theme.LOAD] * (len(sizes) - len(colours))
        for i, (length, radius) in enumerate(sizes):
            mesh, colour = capsule_mesh(length, radius, 8, 24), colours[i]
            node = self.scene.add_mesh_simple(
                f"/person/part_{i}",
                mesh.vertices,
                mesh.faces,
                color=colour if length > 1e-9 else theme.LOAD,
                visible=self.shown["person"],
            )
            self._person.append(node)

    def _path(self, path: np.ndarray) -> None:
        line = tool_line(self.robot, path)
        self._lines("path", theme.as_segments(line), theme.PATH, 5.0)

    def _before(self, path: np.ndarray) -> None:
        line = tool_line(self.robot, path)
        self._lines("before", theme.as_segments(line), theme.BEFORE, 3.0)

    def _targets(self, targets: np.ndarray) -> None:
        self._remove("targets")
        if len(targets) == 0:
            return
        radius = np.where(targets[:, 4] > 0, 0.026, 0.013)
        self._nodes["targets"] = self.scene.add_batched_meshes_simple(
            "/targets",
            *_ball(),
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (len(targets), 1)),
            batched_positions=targets[:, :3],
            batched_scales=radius,
            batched_colors=theme.quality_colours(targets[:, 3]),
            lod="off",
            cast_shadow=False,
            visible=self.shown["targets"],
        )

    def _points(self, points: np.ndarray) -> None:
        self._remove("points")
        if len(points) == 0:
            return
        step = -(-len(points) // MOST_POINTS)
        self._nodes["points"] = self.scene.add_point_cloud(
            "/points",
            points[::step].astype(np.float32),
            theme.POINT,
            point_size=0.006,
            visible=self.shown["points"],
        )

    def _draw_cells(self, moment: Moment, clock: float) -> None:
        if clock - self._edges_at < EDGES_EVERY_S:
            return
        self._edges_at = clock
        points = seen_points(moment.capsules, moment.points)
        cells = occupied_cells(self.cell_map.grid, points)
        if self.shown["cells"]:
            self._if_new("cells", cells, self._cells)
        if self.shown["blocked"]:
            self._if_new("blocked", cells, self._blocked)

    def _cells(self, cells: np.ndarray) -> None:
        self._remove("cells")
        if len(cells) == 0:
            return
        grid = self.cell_map.grid
        self._nodes["cells"] = self.scene.add_batched_meshes_simple(
            "/cells",
            0.47 * grid.h * _CUBE,
            _CUBE_FACES,
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (len(cells), 1)),
            batched_positions=cell_centers(grid, cells),
            batched_colors=theme.CELL,
            opacity=0.35,
            flat_shading=True,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
            visible=self.shown["cells"],
        )

    def _blocked(self, cells: np.ndarray) -> None:
        blocked = self.roadmap.blocked(cells)
        segments = self.roadmap.segments[blocked]
        self.n_blocked = len(segments)
        pixels = thickness_of(self.n_blocked)
        self._lines("blocked", segments, theme.BLOCKED_EDGE, pixels)

    def _lines(
        self, layer: str, segments: np.ndarray, colour: tuple, pixels: float
    ) -> None:
        """Draw one object of line segments (n, 2, 3) in place of a layer's old one."""
        if len(segments) == 0:
            self._remove(layer)
            return
        self._nodes[layer] = self.scene.add_line_segments(
            f"/{layer}",
            segments,
            colour,
            thickness=pixels,
            thickness_units="screen",
            visible=self.shown[layer],
        )

    def _remove(self, layer: str) -> None:
        node = self._nodes.pop(layer, None)
        if node is not None:
            node.remove()

    def bounds(self, moment: Moment) -> tuple[np.ndarray, np.ndarray]:
        """Return (n, 3) points of the robot and of the person, for a camera [m]."""
        frames = body_frames(self.robot, moment.q)[:, :3, 3]
        tool = tool_pose(self.robot, moment.q)[None, :3, 3]
        ends = moment.capsules[:, :6].reshape(-1, 3)
        return np.vstack([frames, tool]), ends


def _ball() -> tuple[np.ndarray, np.ndarray]:
    import trimesh

    mesh = trimesh.creation.icosphere(2, 1.0)
    return mesh.vertices, mesh.faces
