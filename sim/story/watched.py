"""A hand-over shown: on a page while it is played, as a film when it was recorded."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from handover.human.body import ARM_LABELS, Part
from handover.human.human import Human
from roadmap.builds.chunks import Progress
from roadmap.geometry.gaps import beads, moved_rods
from roadmap.kinematics.forward import cover_balls
from roadmap.robot.robot import Robot
from sim.draw.film import Canvas, FilmSettings, painted, write_gif
from sim.draw.style import AMBER, BLUE, FAINT, INK, PURPLE, RED, TEAL
from sim.draw.viewpoint import Camera, clearest, framed
from sim.loop.target_rows import TARGETS_EVERY, target_rows
from sim.record.run_record import RunRecord
from sim.story.play import RATE, StoryMoment, StoryPlay
from sim.view.running import LivePage

_COLOURS = {
    "fetch": FAINT,
    "approach": TEAL,
    "present": TEAL,
    "wait": AMBER,
    "release": AMBER,
    "close": AMBER,
    "retreat": PURPLE,
    "put_down": BLUE,
}
_WORDS = 0.17  # share of half the picture's height by which it is above the words
_THING = -1  # the label of what is handed over
_STEPS, _STEP_BACK = 12, 1.05  # of the camera, until all heads are in the picture
_BEADS = 12  # along a capsule
_LONGEST = 240  # pictures; a longer story is shown in fewer a second


class StoryPage(LivePage):
    """The page beside `odm demo handover`: each moment, at the clock's pace.

    `hear` waits for the clock where it is `paced`; else somebody else does.
    """

    def __init__(
        self,
        run: StoryPlay,
        port: int | None = None,
        host: str | None = None,
        token: str | None = None,
        paced: bool = True,
    ) -> None:
        self.run, self._paced = run, paced
        cell_map, where = run.setup.cell_map, (port, host, token)
        label = f"{cell_map.robot.name}: {run.case.direction}"
        super().__init__(cell_map, run.planner, where, rate_hz=RATE, label=label)
        self._rows = np.zeros((0, 5))
        self._n_told = 0  # events

    def hear(self, moment: StoryMoment) -> None:
        """Show a moment, and wait until the clock has come as far."""
        rows, story = moment.capsules, self.run.story
        if moment.T_object is not None:
            thing = moved_rods(self.run.setup.obj.capsules, moment.T_object)
            rows = np.vstack([rows, thing])
        answer = story.answer
        if isinstance(answer, SimpleNamespace) and not answer.reason:
            if answer.status == "holding":  # it waits, or its fingers move
                answer = SimpleNamespace(status="standing", path=None)
        frame = SimpleNamespace(
            q=moment.q,
            answer=answer,
            capsules=rows,
            things=len(rows) - len(moment.capsules),
            separation=moment.separation,
            pace=moment.pace,
            brake=story.executor.reason,
            wall_s=moment.cpu_s,
        )
        told = [f"{e.state}: {e.reason}" for e in story.events[self._n_told :]]
        self._n_told = len(story.events)
        state = f"{moment.state}: {story.reason}" if story.reason else moment.state
        targets = self._targets(round(moment.now * RATE))
        happened = {"targets": targets, "time_s": moment.now}
        self.viewer.show(frame, **happened, told=told, doing=state)
        if self._paced:
            self._pace.wait(moment.now)

    def _targets(self, index: int) -> np.ndarray:
        if index % TARGETS_EVERY == 0:
            self._rows = target_rows(self.run.story.targets)
        return self._rows


def write_story_film(
    record: RunRecord,
    robot: Robot,
    world: object,
    path: str | Path,
    settings: FilmSettings | None = None,
    tell: Progress | None = None,
) -> Path:
    """Write a recorded hand-over as an animated GIF, whole; return its path.

    `world` is a `sim.draw.world.World` or `sim.draw.cover_world.CoverWorld`. `tell` is
    called with the stage, pictures painted and of how many, before each.
    """
    settings = settings or FilmSettings(width=560, height=420, fps=8.0, fov_deg=40.0)
    step = max(1, round(record.rate_hz / settings.fps), record.frames // _LONGEST)
    shown = range(0, record.frames, step)
    moments = [shown[k * (len(shown) - 1) // 12] for k in range(13)]
    canvas = Canvas(_camera(record, robot, moments, settings))
    pictures = painted(lambda i: _paint(record, robot, world, canvas, i), shown, tell)
    return write_gif(pictures, path, settings)


def _camera(
    record: RunRecord, robot: Robot, moments: list[int], settings: FilmSettings
) -> Camera:
    """Return from where the robot and the arm that takes part are seen, and whole."""
    labels = np.full(record.arrays["capsules"].shape[1], _THING)
    known = Human().labels
    labels[: len(known)] = known
    arm = np.isin(labels, [_THING, *ARM_LABELS[record.head["story"]["person"]["side"]]])
    above = ~arm & ~np.isin(labels, [Part.LEFT_LEG, Part.RIGHT_LEG])
    robots, arms, rest = [], [], []
    for i in moments:
        rows = record.arrays["capsules"][i]
        robots.append(_bodies(record, robot, i)[0])
        arms.append(beads(_near(rows[arm]), _BEADS))
        rest.append(beads(_near(rows[above]), _BEADS))
    whole = settings.camera()
    tan = (1.0 - _WORDS) * np.tan(0.5 * np.radians(whole.fov_deg))
    above_words = replace(whole, fov_deg=float(np.degrees(2.0 * np.arctan(tan))))
    everything = np.vstack(robots + arms + rest)
    camera = framed(above_words, everything, cut=0.0)
    camera = clearest(camera, list(zip(robots, arms, strict=True)), rest[0])
    camera = framed(camera, everything, cut=0.0)  # from there some of it may be nearer
    camera = replace(camera, fov_deg=whole.fov_deg)
    lifted = _lifted(camera)
    for _ in range(_STEPS):
        pixels, distance = lifted.project(everything[:, :3])
        size = everything[:, 3] * lifted.pixels_per_metre(distance)
        if (pixels[:, 1] >= size).all():
            break
        away = np.subtract(camera.eye, camera.target)
        eye = np.add(camera.target, _STEP_BACK * away)
        camera = replace(camera, eye=tuple(eye.tolist()))
        lifted = _lifted(camera)
    return lifted


def _lifted(camera: Camera) -> Camera:
    """Return the camera lower down, so that what it looks at is above the words."""
    away = float(np.linalg.norm(np.subtract(camera.eye, camera.target)))
    down = _WORDS * away * np.tan(0.5 * np.radians(camera.fov_deg))
    eye, target = (np.subtract(at, (0, 0, down)) for at in (camera.eye, camera.target))
    return replace(camera, eye=tuple(eye.tolist()), target=tuple(target.tolist()))


def _paint(record, robot, world, canvas, i: int) -> object:
    arrays, told = record.arrays, record.head["story"]
    rows = arrays["capsules"][i]
    things = len(_near(rows[len(Human().labels) :]))
    world.place(arrays["q"][i], _near(rows), things)
    colour, depth, ground = world.picture(canvas.camera)
    floor = canvas.floor(np.vstack(_bodies(record, robot, i)))
    image = canvas.begin(np.where(ground[..., None], floor, colour), depth, lines=2)
    state = told["states"][arrays["story.state"][i]]
    canvas.pill(16, 104, state.replace("_", " "), _COLOURS.get(state, INK))
    gap = arrays["separation"][i]
    text = f"{100 * gap:.0f} cm" if gap > 0 else "contact"
    canvas.text(134, "separation", FAINT)
    canvas.text(220, text, INK if gap > 0 else RED, bold=True)
    force = np.linalg.norm(arrays["story.wrench"][i][:3])
    canvas.text(290, "at the wrist", FAINT)
    canvas.text(380, f"{force:.0f} N", INK, bold=True)
    canvas.text(-16, f"{i / record.rate_hz:4.1f} s", FAINT, anchor="rm")
    reason = _reason(record, i)
    if reason:
        canvas.text(16, reason, INK, line=1)
    return image


def _reason(record: RunRecord, i: int) -> str:
    """Return what happened last, as the story says it."""
    now, told = i / record.rate_hz, ""
    for event in record.head["outcome"]["story"]:
        if event["time_s"] <= now:
            told = event["reason"]
    return told


def _near(capsules: np.ndarray) -> np.ndarray:
    """Return capsules without what lies on the floor far below."""
    return capsules[capsules[:, 2] > -4.0] if len(capsules) else capsules


def _bodies(record: RunRecord, robot: Robot, i: int) -> tuple[np.ndarray, np.ndarray]:
    balls = cover_balls(robot, record.arrays["q"][i])
    return balls, beads(_near(record.arrays["capsules"][i]), _BEADS)
