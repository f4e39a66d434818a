"""The live person of `odm run --motion keyboard`: keys, screen and wall clock."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace

from sim.keyboard.control import KeyEvent
from sim.keyboard.key_motion import KeyboardArm
from sim.keyboard.session import Session, Setting
from sim.keyboard.signals import ENDINGS
from sim.keyboard.terminal import open_terminal
from sim.loop.loop import Frame, Loop, light, result_of
from sim.loop.run_result import RunResult
from sim.people.arm_path import Person

KEPT_S = 600.0  # the tables are of the last ten minutes: memory stays bounded [s]


class KeyboardPerson:
    """A person whose arm is moved by keys; the `live` of `sim.run.runner.run`.

    Args:
        seconds: Simulated time [s]; None: until the user ends it.

    Attributes:
        result: The frames, at most the last `KEPT_S` seconds; None if there is none.
        ended: "q", "seconds", or the name of a signal.
        frames, late: Frames answered, and those that began late.
        slipped_s: How far the simulation fell behind the clock [s].
    """

    def __init__(self, seconds: float | None = None) -> None:
        self.seconds, self.result, self.ended = seconds, None, ""
        self.frames, self.late, self.slipped_s = 0, 0, 0.0

    def arm(self, person: Person) -> KeyboardArm:
        """Return the arm that is moved, of these sizes, at this place."""
        self._arm = KeyboardArm(person)
        return self._arm

    @property
    def events(self) -> tuple[KeyEvent, ...]:
        """All keys that moved the arm; `KeyboardArm(events=...)` repeats them."""
        return self._arm.events

    def open(self) -> None:
        """Take keys and screen of this process's terminal, or raise NoTerminal."""
        self._keys, self._screen = open_terminal()

    def play(self, loop: Loop, hear: Callable[[Frame], None]) -> RunResult | None:
        """Run until the time is over or the user ends it; `hear` gets every frame."""
        rate, planner = loop.settings.rate_hz, loop.planner
        kept = KeptFrames(max(1, round(KEPT_S * rate)))

        def on_frame(frame: Frame) -> None:
            kept.add(frame)
            hear(frame)

        setting = Setting(
            rate_hz=rate,
            seconds=self.seconds,
            title=planner.robot.name,
            edges=planner.cell_map.roadmap.n_edges,
            blocked=lambda: len(planner.invalid_edges()),
        )
        session = Session(loop, self._arm, setting, on_frame)
        self.ended = session.run(self._keys, self._screen)
        self.frames, self.late = session.stats.frames, session.pacer.late
        self.slipped_s = session.pacer.slipped_s
        self.result = kept.result(loop)
        return self.result

    @property
    def exit_code(self) -> int:
        """0 where it ended by itself or by q; 130 by Ctrl-C, as shells expect it."""
        return ENDINGS.get(self.ended, 0)

    def figures(self, result: RunResult | None) -> dict:
        """Return the figures and the keys as plain data."""
        run = None
        if result is not None:
            run = result.summary() | {"timing": result.timing()}
        return {
            "run": run,
            "ended": self.ended,
            "frames": self.frames,
            "late": self.late,
            "slipped_s": self.slipped_s,
            "keys": [[event.t, event.key] for event in self.events],
        }

    @property
    def sentence(self) -> str:
        """How it ended, and how well it kept up with the clock; "" after a hang-up."""
        if self.ended == "SIGHUP":  # nobody is there to read
            return ""
        how = {
            "q": "ended by q",
            "seconds": "the time is over",
            "SIGINT": "ended by Ctrl-C",
        }.get(self.ended, f"ended by {self.ended}")
        late = f"{self.late:,} of {self.frames:,} frames began late"
        kept = self.result.frames if self.result else 0
        told = f"{how}; {late}, {self.slipped_s:.2f} s behind the clock"
        if kept < self.frames:
            told += f"; the tables are of the last {KEPT_S / 60:.0f} minutes"
        return told


class KeptFrames:
    """Keeps the last frames of an endless run, without what is large in them."""

    def __init__(self, most: int) -> None:
        self._frames: deque[Frame] = deque(maxlen=most)

    def add(self, frame: Frame) -> None:
        """Keep a frame; every frame of a hold knows its reason."""
        kept = light(frame.answer, self._frames)
        before = self._frames[-1].answer if self._frames else kept
        if kept.status == before.status == "holding":
            kept = replace(kept, reason=kept.reason or before.reason)
        self._frames.append(replace(frame, answer=kept))

    def result(self, loop: Loop) -> RunResult | None:
        """Return the frames kept and their figures, None if there are none."""
        return result_of(loop, list(self._frames), {}) if self._frames else None
