"""The person of `odm demo handover --human keyboard`: keys move the arm that takes."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

from sim.keyboard.key_motion import KeyboardArm
from sim.keyboard.live import KEPT_S
from sim.keyboard.session import Session, Setting
from sim.keyboard.terminal import open_terminal
from sim.loop.loop import Frame
from sim.people.whole_person import WholePerson, arm_at
from sim.story.play import RATE, StoryMoment, StoryPlay, StoryResult

DISTANCE = 0.95  # [m] where the person stands
_AFTER_S = 1.5  # [s] the screen stays when the story is over


class KeyboardStory:
    """Whose arm keys move; the `live` of `sim.story.tell.tell_story`.

    Args:
        seconds: Simulated time at most [s].

    Attributes:
        person: The whole person.
        ended: "seconds", "q", "over", or the name of a signal.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds, self.ended = min(seconds, KEPT_S), ""
        self.arm = KeyboardArm(arm_at(DISTANCE))
        self.person = WholePerson(self.arm)

    def open(self) -> None:
        """Take keys and screen of this process's terminal, or raise NoTerminal."""
        instead = "choose another person: --human scripted or mocap"
        self._keys, self._screen = open_terminal("--human keyboard", instead)

    def play(self, run: StoryPlay, hear: Callable[[StoryMoment], None]) -> StoryResult:
        """Play at the clock's pace until the story, the time or the user ends it."""
        cell_map = run.setup.cell_map
        left = _AFTER_S * RATE

        def after(frame: Frame) -> None:
            nonlocal left
            left -= run.story.ended
            if left < 0:
                session.ended = "over"

        setting = Setting(RATE, self.seconds, cell_map.robot.name)
        session = Session(_Frames(run, hear), self.arm, setting, after)
        self.ended = session.run(self._keys, self._screen)
        return run.result


class _Frames:
    """A story as the session asks for it, frame by frame."""

    def __init__(self, run: StoryPlay, hear: Callable[[StoryMoment], None]) -> None:
        self._run, self._hear = run, hear

    def frame(self) -> Frame:
        moment = self._run.step()
        self._hear(moment)
        story = self._run.story
        told = f"{moment.state}: {story.reason}"
        answer = SimpleNamespace(status=moment.status, reason=told)
        speed = float(np.abs(moment.dq).max())
        return Frame(
            index=self._run.index - 1,
            q=moment.q,
            capsules=moment.capsules,
            answer=answer,
            place=0,
            separation=moment.separation,
            joint_speed=speed,
            point_speed=self._run.speed,
            wall_s=moment.cpu_s,
            cpu_s=moment.cpu_s,
            improve_s=0.0,
            dq=moment.dq,
            pace=moment.pace,
        )
