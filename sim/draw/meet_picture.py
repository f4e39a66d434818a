"""The interaction workspace in cuts, with robot and person: figures 4-6 of the paper.

[Vahrenkamp2016]; colours tell the best quality over all rotations of a place of the
robot's tool.
"""

from pathlib import Path

import numpy as np

from handover import Human, InteractionWorkspace
from handover.meet.settings import PARTS
from roadmap.geometry.gaps import moved_rods
from roadmap.robot.robot import Robot
from sim.draw import style
from sim.draw.meet_cut import Meeting, fine_workspace, layer_at, quality_by_position
from sim.draw.silhouette import Silhouette, robot_silhouette

_ROOM = 0.12  # [m] left around what is shown


def write_meet_picture(
    meetings: list[Meeting],
    robot: Robot,
    q_rest: np.ndarray,
    path: str | Path,
    tell: object = None,
) -> Path:
    """Draw cuts through interaction workspaces, robot, person and best target: a PNG.

    The axes of the robot's base are taken to be the world's. One meeting is drawn from
    the side and from above, with the parts of its quality; several, of one robot and
    object, beside each other. The robot is at `q_rest` where no target can be drawn.
    """
    scenes = _scenes(meetings, robot, q_rest, tell)
    boxes = np.array([scene.box for scene in scenes])
    box = np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    figure = style.new_figure(12.0, 6.0, _words(meetings))
    if len(scenes) == 1:
        axes, bars = _one(figure, *(box[1] - box[0]))
        _draw_parts(bars, meetings[0])
    else:
        axes = _several(figure, len(scenes), *(box[1] - box[0]))
    views = [(scene, normal) for scene in scenes for normal in (1, 2)]
    span = _span(scenes)
    for axis, (scene, normal) in zip(axes, views, strict=True):
        image = scene.draw(axis, normal, span, box)
        style.set_title(axis, scene.title(normal, several=len(scenes) > 1))
    text = "best quality over all rotations of the tool there, cells of"
    cell = 100 * scenes[0].fine.grid.cell
    style.colour_bar(figure, image, f"{text} {cell:g} cm", ax=axes, aspect=60)
    return style.save(figure, path)


def _scenes(
    meetings: list[Meeting], robot: Robot, q_rest: np.ndarray, tell: object
) -> list["_Scene"]:
    """Solve each meeting in the cells of the reach map, for its cuts."""
    scenes = []
    for i, meeting in enumerate(meetings):
        if tell:
            tell("cut", i, len(meetings))
        fine = fine_workspace(meeting, meeting.meet.reach.grid.cell)
        scenes.append(_Scene(meeting, fine, robot, q_rest))
    if tell:
        tell("cut", len(meetings), len(meetings))
    return scenes


class _Scene:
    """What one meeting looks like."""

    def __init__(
        self,
        meeting: Meeting,
        fine: InteractionWorkspace,
        robot: Robot,
        q_rest: np.ndarray,
    ) -> None:
        self.meeting, self.fine = meeting, fine
        self.quality = quality_by_position(fine)
        settings = fine.settings
        human, q, self.held = meeting.human, q_rest, Silhouette()
        self.at = human.T_world_shoulder(settings.side)[:3, 3] - [0.0, 0.0, 0.2]
        if meeting.drawn is not None:
            target = meeting.best[meeting.drawn]
            human, q = meeting.taking, meeting.robot_q[meeting.drawn]
            rods = moved_rods(fine.obj.capsules, target.T_world_object)
            self.held, self.at = Silhouette(rods), target.T_world_tool[:3, 3]
        elif meeting.best:
            self.at = meeting.best[0].T_world_tool[:3, 3]
        self.human: Human = human
        self.person = Silhouette(human.capsules_of("mean"))
        self.robot = robot_silhouette(robot, q, settings.T_world_base)
        grid, filled = fine.grid, np.argwhere(np.isfinite(self.quality))
        cells = grid.origin + grid.cell * (filled + 0.5) + settings.T_world_base[:3, 3]
        points = [self.person.points(), self.robot.points(), cells]
        points = np.concatenate(points)
        self.box = np.stack([points.min(axis=0) - _ROOM, points.max(axis=0) + _ROOM])
        self.box[0, 2] = min(self.box[0, 2], -0.05)

    def layer(self, normal: int) -> tuple[int, float]:
        """Return the layer of cells that is cut and where its middle is [m]."""
        grid = self.fine.grid
        layer = layer_at(self.fine, normal, self.at[normal])
        middle = grid.origin[normal] + (layer + 0.5) * grid.cell
        return layer, middle + self.fine.settings.T_world_base[normal, 3]

    def cut(self, normal: int) -> np.ndarray:
        """Return the best quality in the layer, up by across."""
        return np.take(self.quality, self.layer(normal)[0], axis=normal).T

    def title(self, normal: int, several: bool) -> str:
        """Return what a view shows."""
        at = self.layer(normal)[1]
        view = f"{style.VIEWS[normal][1]}, cut at {style.AXES[normal]} = {at:.2f} m"
        if not several or normal == 2:
            return view
        targets = self.meeting.counts["targets"]
        return f"{100 * self.meeting.distance:.0f} cm: {targets:,} targets\n{view}"

    def draw(self, axis: object, normal: int, span: tuple, box: np.ndarray):
        """Draw one view and return its image."""
        plane = style.VIEWS[normal][0]
        grid, T = self.fine.grid, self.fine.settings.T_world_base
        corner = [T[k, 3] + grid.origin[k] for k in plane]
        image = style.draw_cut(
            axis, corner, grid.cell, self.cut(normal), span, zorder=2
        )
        if plane[1] == 2:
            style.draw_floor(axis)
            _draw_stand(axis, T)
        solids = [
            (self.robot, style.ROBOT, style.ROBOT_EDGE),
            (self.person, style.BODY, style.BODY_EDGE),
        ]
        if normal == 1 or self._height(self.person) < self._height(self.robot):
            solids.reverse()  # what is nearer covers
        for k, (solid, fill, line) in enumerate(solids):
            solid.draw(axis, plane, fill, line, (3 + k, 3 + k), alpha=0.65)
        if self.meeting.drawn is not None:
            self.held.draw(axis, plane, style.INK, style.INK, (6, 6), linewidths=0.8)
            ring = {"mfc": "none", "mec": style.RED, "ms": 11, "mew": 1.6, "zorder": 7}
            axis.plot(*self.at[list(plane)], "o", **ring)
        if not self.meeting.best and normal == 1:
            self._say_missing(axis)
        style.space_axes(axis, normal)
        axis.set(xlim=box[:, plane[0]], ylim=box[:, plane[1]])
        return image

    @staticmethod
    def _height(solid: Silhouette) -> float:
        return float(solid.points()[:, 2].max())

    def _say_missing(self, axis: object) -> None:
        missing = 100 * self.meeting.meet.missing_m
        why = "although the person is near enough"
        if missing > 0.0:
            why = f"the person is {missing:.0f} cm too far away"
        text = f"nothing is shared:\n{why}"
        axis.text(
            0.5,
            0.97,
            text,
            transform=axis.transAxes,
            ha="center",
            va="top",
            color=style.INK,
        )


def _draw_stand(axis: object, T_world_base: np.ndarray) -> None:
    """Draw what the robot stands on."""
    from matplotlib.patches import Rectangle

    x, z = T_world_base[0, 3], T_world_base[2, 3]
    if z > 0.0:
        stand = Rectangle(
            (x - 0.16, 0.0), 0.32, z, fc="#f1f3f5", ec=style.LINE, zorder=1
        )
        axis.add_patch(stand)


def _one(figure: object, wide: float, deep: float, tall: float) -> tuple:
    """Lay out two views of the same scale and the bars of one meeting."""
    bars = max(tall - deep, 0.75)
    inches = 5.2 / wide  # of a metre
    figure.set_size_inches(12.0, 2.0 + inches * max(tall, deep + bars))
    grid = figure.add_gridspec(2, 2, height_ratios=(deep, bars))
    axes = [figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1])]
    return axes, figure.add_subplot(grid[1, 1])


def _several(
    figure: object, n: int, wide: float, deep: float, tall: float
) -> list[object]:
    """Lay out two views of the same scale for each of n meetings, column by column."""
    each = 13.0 / n
    figure.set_size_inches(13.0, 1.8 + (each - 0.7) * (deep + tall) / wide)
    ratios = {"height_ratios": (tall, deep)}
    rows = figure.subplots(2, n, squeeze=False, gridspec_kw=ratios)
    return list(rows.T.ravel())


def _draw_parts(axis: object, meeting: Meeting) -> None:
    """Draw what the drawn target's quality is made of."""
    axis.set_axis_off()
    if not meeting.best:
        return
    rank = 0 if meeting.drawn is None else meeting.drawn
    target = meeting.best[rank]
    names = [*PARTS, "online", "dexterity", "total"]
    values = [target.parts.parts[name] for name in PARTS]
    values += [target.parts.online, target.dexterity, target.quality]
    values = np.nan_to_num(values)
    rows = np.arange(len(names)) + np.array([0.0] * 5 + [0.4] * 2 + [0.8])
    strong = ["#8fb9b5"] * 5 + [style.TEAL] * 2 + [style.RED]
    axis.barh(rows, np.ones(len(rows)), height=0.5, color=style.PALE)
    axis.barh(rows, values, height=0.5, color=strong)
    text = {"color": style.INK, "size": 9.5, "va": "center"}
    for row, name, value in zip(rows, names, values, strict=True):
        axis.text(-0.02, row, name, ha="right", **text)
        axis.text(1.02, row, f"{value:.2f}", **text)
    axis.set(xlim=(-0.26, 1.14), ylim=(rows[-1] + 1.0, -0.8))
    said = f"target {rank + 1}: its quality"
    if meeting.drawn is None:
        said += "\n(the robot cannot be there exactly)"
    style.set_title(axis, said)


def _span(scenes: list[_Scene]) -> tuple[float, float]:
    seen = [scene.cut(normal).ravel() for scene in scenes for normal in (1, 2)]
    values = np.concatenate(seen)
    values = values[np.isfinite(values)]
    if not len(values):
        return 0.0, 1.0
    return float(values.min()), max(float(values.max()), float(values.min()) + 1e-3)


def _words(meetings: list[Meeting]) -> str:
    meet = meetings[0].meet
    human, side = meet.human, meet.settings.side
    far = ", ".join(f"{100 * m.distance:.0f}" for m in meetings)
    return (
        f"{meet.reach.chain.name} hands a {meet.obj.name} to the {side} hand of a "
        f"person of {human.height:.2f} m, {human.posture}, {far} cm away"
    )
