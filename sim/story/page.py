"""The page beside `odm demo handover`: each moment, at the clock's pace."""

import sys
from types import SimpleNamespace

import numpy as np

from roadmap.geometry.gaps import moved_rods
from sim.draw.surroundings import scene_of
from sim.loop.target_rows import TARGETS_EVERY, target_rows
from sim.story.play import RATE, StoryMoment, StoryPlay
from sim.view.gate import LOCAL, PORT
from sim.view.running import Pace
from sim.view.viewer import Viewer


class StoryPage:
    """A story that is watched; a context manager.

    Port, host and token as of `sim.Viewer`. `hear` waits for the clock where it is
    `paced`; else somebody else does.
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
        cell_map = run.setup.cell_map
        self.viewer = Viewer(
            cell_map,
            host=host or LOCAL,
            port=PORT if port is None else port,
            token=token,
            rate_hz=RATE,
            label=f"{cell_map.robot.name}: {run.case.direction}",
            standing=scene_of(run.planner),
        )
        self._rows = np.zeros((0, 5))
        self._told = 0  # events
        self._pace = Pace()
        print(f"watch at {self.viewer.address}", file=sys.stderr, flush=True)

    def __enter__(self) -> "StoryPage":
        return self

    def __exit__(self, *_: object) -> None:
        self.viewer.close()

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
        told = [f"{e.state}: {e.reason}" for e in story.events[self._told :]]
        self._told = len(story.events)
        state = f"{moment.state}: {story.reason}"
        targets = self._targets(round(moment.now * RATE))
        happened = {"targets": targets, "time_s": moment.now}
        self.viewer.show(frame, **happened, told=told, doing=state)
        if self._paced:
            self._pace.wait(moment.now)

    def _targets(self, index: int) -> np.ndarray:
        if index % TARGETS_EVERY == 0:
            self._rows = target_rows(self.run.story.targets)
        return self._rows
