"""A short film of a run: robot, person, planned path of the tool, status."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from roadmap.builds.chunks import Progress
from roadmap.geometry.gaps import beads
from roadmap.kinematics.forward import cover_balls, difference, tool_pose
from roadmap.ranges import settings_of
from roadmap.robot.robot import Robot
from sim.draw.film import STATES, Canvas, FilmSettings, painted, write_gif
from sim.draw.style import FAINT, INK, TEAL
from sim.draw.surroundings import balls_of
from sim.draw.viewpoint import above_words, clearest, framed
from sim.loop.run_result import RETREATS, STATUS, RunResult

CAME = "the person came to the standing robot"
LEGS = 0.3  # a base that reaches so far below its frame has legs [m]
WORDS = 0.11  # share of the picture's height that the line of words takes
STICKY_S = 0.3  # a new path is announced at least so long [s]


def write_animation(
    result: RunResult,
    robot: Robot,
    places: np.ndarray,
    world: object,
    path: str | Path,
    settings: FilmSettings | None = None,
    tools: Mapping[int, np.ndarray] | None = None,
    still: np.ndarray | None = None,
    tell: Progress | None = None,
) -> Path:
    """Write some seconds of a run, the liveliest if not told, as an animated GIF.

    It is seen from the side from which the person hides least of the robot.

    Args:
        result: The run, with `keep_paths` on.
        robot: The robot.
        places: (n, dof) work places of the run.
        world: A `sim.draw.world.World` or `sim.draw.cover_world.CoverWorld`.
        path: File to write.
        settings: Size and length.
        tools: Where the tool goes for each number of `result.place` [m], in place of
            the work places.
        still: (n, 3, 3) triangles of what stands around [m]; the world draws them, and
            the camera goes where they hide least.
        tell: Called with the stage, pictures painted and of how many, before each.
    """
    settings = settings_of(settings, FilmSettings)
    shown = settings.shown(_liveliness(result), result.rate_hz)
    moments = [shown[k * (len(shown) - 1) // 4] for k in range(5)]
    hiding = None if still is None else balls_of(still)
    bodies = [_bodies(result, robot, i) for i in moments]
    robots = [robot_balls for robot_balls, _ in bodies]
    moving = np.vstack([balls[robot.sphere_body > 0] for balls in robots])
    tool = np.vstack([balls[robot.sphere_body == robot.tip_body] for balls in robots])
    people = np.vstack([person for _, person in bodies])
    high = people[people[:, 2] >= np.median(people[:, 2])] if len(people) else people
    camera = framed(settings.camera(), moving, tool=tool)
    camera = clearest(above_words(camera, high, WORDS), bodies, hiding)
    painter = _Painter(robot, places, world, camera, tools)
    pictures = painted(lambda i: painter.paint(result, i), shown, tell)
    return write_gif(pictures, path, settings)


def _liveliness(result: RunResult) -> np.ndarray:
    moving = np.clip(result.joint_speed / max(result.joint_speed.max(), 1e-9), 0, 1)
    near = np.exp(-np.clip(result.separation, 0.0, 10.0) / 0.1)
    replanned = result.status == STATUS.index("replanned")
    held = result.status == STATUS.index("holding")
    return moving * (0.2 + 3.0 * near) + 30.0 * replanned * near - 0.5 * held


class _Painter:
    def __init__(self, robot, places, world, camera, tools=None):
        self.robot, self.world = robot, world
        self.canvas = Canvas(camera, height=floor_of(robot))
        self.lasting = tools is None  # places are shown always, targets while pursued
        if tools is None:
            tools = {k: tool_pose(robot, q)[:3, 3] for k, q in enumerate(places)}
        self.goals = tools

    def paint(self, result: RunResult, frame: int) -> object:
        q, capsules, canvas = result.q[frame], result.capsules[frame], self.canvas
        self.world.place(q, capsules)
        colour, depth, ground = self.world.picture(canvas.camera)
        floor = canvas.floor(np.vstack(_bodies(result, self.robot, frame)))
        image = canvas.begin(np.where(ground[..., None], floor, colour), depth)
        for index, goal in self.goals.items():
            chosen = index == int(result.place[frame])
            if chosen or self.lasting:
                canvas.ring(goal, TEAL if chosen else FAINT, chosen)
        path = _path_at(result, frame)
        if len(path) > 1:
            canvas.line(tool_line(self.robot, path), TEAL)
        self._draw_caption(result, frame)
        return image

    def _draw_caption(self, result: RunResult, frame: int) -> None:
        canvas = self.canvas
        canvas.pill(16, 104, *STATES[_shown_status(result, frame)])
        separation = result.separation[frame]
        if np.isfinite(separation):
            text = f"{100 * separation:.0f} cm" if separation > 0 else "contact"
            canvas.text(134, "separation", FAINT)
            canvas.text(220, text, INK, bold=True)
            if separation <= 0.0 and not result.moving[frame]:
                canvas.text(16, CAME, INK, line=1)
        recent = result.wall_s[max(0, frame - int(result.rate_hz / 2)) : frame + 1]
        canvas.text(294, "planned in", FAINT)
        took = f"{1e6 * np.median(recent):.0f} \N{MICRO SIGN}s"
        canvas.text(380, took, INK, bold=True)
        canvas.text(-16, f"{frame / result.rate_hz:4.1f} s", FAINT, anchor="rm")


def floor_of(robot: Robot) -> float:
    """Return where the robot stands [m]: its base, or the feet of one beneath it."""
    fixed = robot.sphere_body == 0
    if not fixed.any():
        return 0.0
    feet = float((robot.spheres[fixed, 2] - robot.spheres[fixed, 3]).min())
    return feet if feet < -LEGS else 0.0


def _bodies(
    result: RunResult, robot: Robot, frame: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return robot and person of a frame as balls (n, 4) [m]."""
    return cover_balls(robot, result.q[frame]), beads(result.capsules[frame], 16)


def tool_line(robot: Robot, path: np.ndarray) -> np.ndarray:
    """Return (n, 3) places of the tool along a path (k, dof) [m]; empty without legs.

    No joint moves by more than 0.06 rad between two places, of legs of up to 200.
    """
    if len(path) < 2:
        return np.zeros((0, 3))
    parts = []
    for start, stop in zip(path[:-1], path[1:], strict=True):
        leg = difference(robot, start, stop)
        count = min(1 + int(np.abs(leg).max() / 0.06), 200)
        parts += [start + s * leg for s in np.arange(count) / count]
    parts.append(path[-1])
    return np.array([tool_pose(robot, q)[:3, 3] for q in parts])


def _path_at(result: RunResult, frame: int) -> np.ndarray:
    """Return the path kept last before a frame, while it leads to the same place."""
    known = [i for i in result.paths if i <= frame]
    if not known or result.place[max(known)] != result.place[frame]:
        return np.zeros((0, 0))
    return result.paths[max(known)]


def _shown_status(result: RunResult, frame: int) -> str:
    """Return the status or retreat, a new path for long enough to be read."""
    now = STATUS[result.status[frame]]
    if now == "holding" and result.retreat[frame]:
        return RETREATS[result.retreat[frame]]
    since = max(0, frame - round(STICKY_S * result.rate_hz))
    recent = result.status[since : frame + 1]
    new = now == "following" and (recent == STATUS.index("replanned")).any()
    return "replanned" if new else now
