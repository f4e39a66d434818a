"""`odm run --motion keyboard`: from a map's folder to the summary."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sim.keyboard.control import KeyEvent
from sim.keyboard.kept import KeptFrames
from sim.keyboard.motion import KeyboardArm
from sim.keyboard.session import Session, Setting
from sim.keyboard.signals import ENDINGS
from sim.keyboard.terminal import open_terminal
from sim.loop.loop import Frame, Loop, LoopSettings
from sim.loop.run_result import RunResult
from sim.people.arm import HumanArm
from sim.people.arm_path import Person

if TYPE_CHECKING:
    from odm import CellMap, ReactivePlanner

KEPT_S = 600.0  # the tables are of the last ten minutes: memory stays bounded [s]


@dataclass(frozen=True, eq=False)
class KeyboardRun:
    """What a run with the keyboard leaves.

    Attributes:
        result: Its frames, at most the last `KEPT_S` seconds; None if there is none.
        events: All keys that moved the arm; `KeyboardArm(events=...)` repeats them.
        ended: "q", "seconds", or the name of a signal.
        frames, late: Frames answered, and those that began late.
        slipped_s: How far the simulation fell behind the clock [s].
        cell_map, places: The map, and the (n, dof) work places.
    """

    result: RunResult | None
    events: tuple[KeyEvent, ...]
    ended: str
    frames: int
    late: int
    slipped_s: float
    cell_map: "CellMap"
    places: np.ndarray

    @property
    def exit_code(self) -> int:
        """0 where it ended by itself or by q; 130 by Ctrl-C, as shells expect it."""
        return ENDINGS.get(self.ended, 0)

    def as_dict(self) -> dict:
        """Return the figures and the keys as plain data."""
        run = None
        if self.result is not None:
            run = self.result.summary() | {"timing": self.result.timing()}
        return {
            "run": run,
            "ended": self.ended,
            "frames": self.frames,
            "late": self.late,
            "slipped_s": self.slipped_s,
            "keys": [[event.t, event.key] for event in self.events],
            "map_hash": self.cell_map.hash,
        }

    @property
    def sentence(self) -> str:
        """How it ended, and how well it kept up with the clock."""
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


def run_keyboard(
    map_dir: Path | str,
    seconds: float | None = None,
    rate: float = 100.0,
    person: Person | None = None,
    quiet: bool = False,
    make_loop: Callable[..., Loop] = Loop,
    on_frame: Callable[[Frame], None] | None = None,
    execution: str = "kinematic",
    record: Path | None = None,
) -> KeyboardRun:
    """Run in real time while keys move the person's arm; then print the tables.

    Args:
        map_dir: Folder of a built map.
        seconds: Simulated time [s]; None: until the user ends it.
        rate: Frames per second.
        person: Sizes, place and speed limit of the person.
        quiet: Print no tables.
        make_loop: (planner, robot, places, motion, settings) -> loop.
        on_frame: Called with every frame.
        execution: "kinematic" or "timed"; see `sim.loop.loop.LoopSettings`.
        record: File for the whole run, to be replayed; written however it ends.

    Raises:
        NoTerminal: There is none to read keys from.
        BadInput: Rate, time or the person's speed limit is not positive, or the
            recording cannot be written.
    """
    from odm import ReactivePlanner, load_map
    from sim.record import check_target, recording
    from sim.run.demo import DEMO, find_places
    from sim.terminal.output import Bars

    if record is not None:
        check_target(record)
    keys, screen = open_terminal()
    asked = {} if seconds is None else {"duration_s": seconds}
    settings = replace(DEMO, rate_hz=rate, keep_paths=0, execution=execution, **asked)
    arm = KeyboardArm(person or Person(HumanArm.sized()))
    cell_map = load_map(map_dir)
    planner = ReactivePlanner(cell_map)
    with Bars():
        places = find_places(planner)
        _warm_up(planner, places, settings)
        planner = ReactivePlanner(cell_map)  # one that knows nothing of all that
        loop = make_loop(planner, planner.robot, places, arm, settings)
    kept = KeptFrames(max(1, round(KEPT_S * rate)))
    setting = Setting(
        rate_hz=rate,
        seconds=seconds,
        title=planner.robot.name,
        edges=cell_map.roadmap.n_edges,
        blocked=lambda: len(planner.invalid_edges()),
    )
    with recording(record, loop, cell_map) as recorder:
        heard = _all(kept.add, recorder and recorder.add, on_frame)
        session = Session(loop, arm, setting, heard)
        ended = session.run(keys, screen)
    run = KeyboardRun(
        result=kept.result(loop),
        events=arm.events,
        ended=ended,
        frames=session.tally.frames,
        late=session.pacer.late,
        slipped_s=session.pacer.slipped_s,
        cell_map=cell_map,
        places=places,
    )
    if not quiet and ended != "SIGHUP":  # after a hang-up nobody is there to read
        _report(run)
    return run


def _warm_up(
    planner: "ReactivePlanner", places: np.ndarray, settings: LoopSettings
) -> None:
    """Compile all that a frame or the screen will call."""
    from sim.run.demo import warm_up

    warm_up(planner, places, "reach", settings)
    planner.invalid_edges()


def _all(*listeners: Callable[[Frame], None] | None) -> Callable[[Frame], None]:
    asked = [listener for listener in listeners if listener is not None]

    def call(frame: Frame) -> None:
        for listener in asked:
            listener(frame)

    return call


def _report(run: KeyboardRun) -> None:
    from sim.run.report import print_report

    if run.result is not None:
        print_report([run.result], None, run.cell_map.hash)
    print(run.sentence)
