"""The page beside `odm demo handover`: each moment, at the clock's pace."""

from types import SimpleNamespace

import numpy as np

from roadmap.geometry.gaps import moved_rods
from sim.loop.target_rows import TARGETS_EVERY, target_rows
from sim.story.play import RATE, StoryMoment, StoryPlay
from sim.view.running import LivePage


class StoryPage(LivePage):
    """A story that is watched.

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
        self._told = 0  # events

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
