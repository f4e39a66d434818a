"""Recording a run: every frame as it comes, one file at the end, however it ends."""

import platform
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from odm.cell_map.cell_map import CellMap
from odm.execution.executor import BRAKED, MOVING, RETREATING, SLOWED, STANDING
from roadmap.errors import BadInput
from roadmap.ranges import plain
from roadmap.robot.robot import Robot
from sim.loop.loop import Frame, Loop
from sim.loop.run_result import STATUS, holds_of, kind_of, new_paths
from sim.record.file import write_record
from sim.record.run_record import (
    CARRYING,
    FORMAT,
    NOBODY,
    OUTCOME,
    STANDING_AROUND,
    RunRecord,
)
from sim.record.standing import scene_rows
from sim.tables.versions import version
from sim.terminal import interrupt

PACES = (MOVING, SLOWED, BRAKED, RETREATING, STANDING)  # first codes of "pace"
PACKAGES = ("odm-planner", "numpy", "numba", "scipy", "ruckig", "python-fcl")
_WRITING = 30.0  # after Ctrl-C a recording may take so long to be written [s]
_ASK_AGAIN = 0.5  # a long hold is asked for its reason so often [s]
_ROWS = 512  # of one block


class Column:
    """One value of every frame, as arrays of one type."""

    def __init__(self, dtype: type) -> None:
        self._dtype = dtype
        self._full: list[np.ndarray] = []
        self._block: np.ndarray | None = None
        self._used = 0

    def add(self, value: object) -> None:
        """Add the value of one frame; its shape may change from frame to frame."""
        value = np.asarray(value, self._dtype)
        block = self._block
        if block is None or block.shape[1:] != value.shape or self._used == len(block):
            if block is not None:
                whole = self._used == len(block)
                self._full.append(block if whole else block[: self._used].copy())
            block = self._block = np.empty((_ROWS, *value.shape), self._dtype)
            self._used = 0
        block[self._used] = value
        self._used += 1

    def blocks(self, n: int) -> list[np.ndarray]:
        """Return arrays that hold the first `n` frames in order."""
        blocks, left = [], n
        last = [] if self._block is None else [self._block[: self._used]]
        for block in [*self._full, *last]:
            if left > 0:
                blocks.append(block[:left])
                left -= len(block)
        return blocks

    def rows(self, n: int) -> np.ndarray:
        """Return the first `n` frames, (n, ...); their values have one shape."""
        return np.concatenate(self.blocks(n))

    def shapes(self, n: int, width: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Return the first `n` frames of (k, width) values whose k may change.

        Returns:
            (n, k, width) and None where k is the same in all frames, else
            (sum of k, width) and (n + 1,) offsets: frame i owns the rows from
            offsets[i] to offsets[i + 1].
        """
        blocks = self.blocks(n)
        counts = np.concatenate([np.full(len(b), b.shape[1]) for b in blocks])
        if (counts == counts[0]).all():
            return np.concatenate(blocks), None
        offsets = np.r_[0, np.cumsum(counts)].astype(np.int64)
        return np.concatenate([b.reshape(-1, width) for b in blocks]), offsets


class Recorder:
    """Takes the frames of a loop; about 300 bytes each and 56 for every capsule.

    Args:
        loop: The loop; not begun.
        cell_map: The planner's map.
        beside: What else is recorded, such as `sim.run.meet_record.TargetColumns`;
            None: nothing.
    """

    def __init__(
        self, loop: Loop, cell_map: CellMap, beside: object | None = None
    ) -> None:
        self.loop, self.cell_map, self._beside = loop, cell_map, beside
        self.frames = 0
        self._payload = getattr(loop.planner, "attached", None)
        self._scene = scene_rows(loop.planner)
        self._columns = {name: Column(kind) for name, kind in OUTCOME.items()}
        self._capsules, self._guess = Column(np.float64), Column(np.float64)
        self._paces = list(PACES)
        self._reasons: dict[int, str] = {}  # by frame
        self._brakes: dict[int, str] = {}
        self._held = 0  # frames of the hold that lasts
        self._every = max(1, round(_ASK_AGAIN * loop.settings.rate_hz))

    def add(self, frame: Frame) -> None:
        """Take one frame; one that is interrupted half-way is left out."""
        if frame.pace not in self._paces:
            self._paces.append(frame.pace)
        values = {
            "status": STATUS.index(frame.answer.status),
            "pace": self._paces.index(frame.pace),
        }
        for name, column in self._columns.items():
            column.add(values[name] if name in values else getattr(frame, name))
        self._capsules.add(frame.capsules)
        if frame.guess is not None:
            self._guess.add(frame.guess)
        if self._beside is not None:
            self._beside.add(frame)
        self._ask(frame)
        self.frames += 1

    def _ask(self, frame: Frame) -> None:
        if frame.pace in (SLOWED, BRAKED) and frame.brake:
            self._brakes[self.frames] = frame.brake
        if frame.answer.status != "holding":
            self._held = 0
            return
        if self._held % self._every == 0:
            reason = frame.answer.reason or "no reason was given"
            self._reasons[self.frames] = reason
        self._held += 1

    def record(self) -> RunRecord:
        """Return what was taken so far, at least one frame."""
        n, loop = self.frames, self.loop
        if n == 0:
            raise BadInput("no frame was run, so there is nothing to record")
        arrays = {"time_s": np.arange(n) / loop.settings.rate_hz}
        arrays["places"] = np.array(loop.places)
        if self._payload is not None:
            arrays["payload"] = np.array(self._payload, float)
        for name, column in (("capsules", self._capsules), ("guess", self._guess)):
            if column.blocks(n):
                rows, offsets = column.shapes(n, 7)
                arrays[name] = rows
                arrays |= {} if offsets is None else {f"{name}_at": offsets}
        arrays |= {name: c.rows(n) for name, c in self._columns.items()}
        head = self._head() | {"outcome": self._outcome(arrays)}
        if self._beside is not None:
            arrays |= self._beside.arrays(n)
            head |= self._beside.head()
        if self._scene:
            head["scene"] = self._scene
        return sealed(head, arrays, self.cell_map.robot)

    def _head(self) -> dict:
        loop, motion, planner = self.loop, self.loop.motion, self.loop.planner
        return {
            "kind": "odm run",
            "format": self._format(),
            "frames": self.frames,
            "motion": {
                "name": NOBODY if motion is None else motion.name,
                "max_speed": plain(getattr(motion, "max_speed", None)),
                "notes": list(getattr(motion, "notes", ())),
            },
            "settings": asdict(loop.settings),
            "planner": {
                "always_replan": planner.always_replan,
                "settings": asdict(planner.settings),
            },
            **common_head(self.cell_map, self._paces),
        }

    def _format(self) -> int:
        """Return the oldest format that holds all of it."""
        if self._beside is not None:
            return self._beside.format
        if self._scene:
            return STANDING_AROUND
        return FORMAT if self._payload is None else CARRYING

    def _outcome(self, arrays: dict[str, np.ndarray]) -> dict:
        rate, status = self.loop.settings.rate_hz, arrays["status"]
        speed = arrays["joint_speed"]
        holds = holds_of(status, speed, lambda i: self._reasons.get(i, ""), rate)
        return {
            "trips": self.loop.trips,
            "path_changes": new_paths(status, arrays["place"]),
            "holds": [asdict(h) | {"later": self._later(h, rate)} for h in holds],
            "slow": self._slow(arrays["pace"], rate),
        }

    def _later(self, hold: object, rate: float) -> list[list]:
        """Return [time [s], reason] where the kind of a hold's reason changed."""
        first, end = round(hold.start_s * rate), round(hold.end_s * rate)
        told, kind = [], kind_of(hold.reason)
        for i in range(first + self._every, end, self._every):
            reason = self._reasons.get(i, "")
            if reason and kind_of(reason) != kind:
                told.append([i / rate, reason])
                kind = kind_of(reason)
        return told

    def _slow(self, pace: np.ndarray, rate: float) -> list[dict]:
        """Return the stretches in which it was slowed or braked, with the reason."""
        changes = np.flatnonzero(np.r_[True, pace[1:] != pace[:-1]])
        ends = np.r_[changes[1:], len(pace)]
        rows = []
        for a, b in zip(changes.tolist(), ends.tolist(), strict=True):
            name = self._paces[pace[a]]
            if name in (SLOWED, BRAKED):
                told = [self._brakes[i] for i in range(a, b) if i in self._brakes]
                row = {"start_s": a / rate, "end_s": b / rate, "pace": name}
                rows.append(row | {"reason": told[0] if told else ""})
        return rows


def common_head(cell_map: CellMap, paces: Sequence[str]) -> dict:
    """Return what the head of every recording tells of the map, codes and versions.

    Args:
        cell_map: The map of the robot.
        paces: What the codes of "pace" stand for, in order.
    """
    return {
        "map": {
            "name": cell_map.recipe.name,
            "hash": cell_map.hash,
            "recipe": cell_map.recipe.for_map(),
        },
        "robot": cell_map.robot.meta(),
        "status_names": list(STATUS),
        "pace_names": list(paces),
        "versions": versions(),
    }


def sealed(head: dict, arrays: dict[str, np.ndarray], robot: Robot) -> RunRecord:
    """Return a recording with the robot's arrays and its fingerprint.

    The latter is written to "outcome" of the head.
    """
    arrays |= {f"robot.{k}": np.array(a) for k, a in robot.arrays().items()}
    made = RunRecord(head, arrays)
    head["outcome"]["trajectory_sha256"] = made.result().fingerprint()
    return made


def versions() -> dict[str, str]:
    """Return Python, machine and the packages that make the numbers, by name."""
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for name in PACKAGES:
        found[name] = version(name) or "not installed"
    return found


@contextmanager
def recording(
    path: Path | None, loop: Loop, cell_map: CellMap, beside: object | None = None
) -> Iterator[Recorder | None]:
    """Yield a recorder; what it took is written at the end, Ctrl-C or an error too.

    Where it went is told on stderr, for one who interrupts reads no summary. Without a
    path it yields None. The loop was not begun; `beside` is what else is recorded.
    """
    if path is None:
        yield None
        return
    recorder = Recorder(loop, cell_map, beside)
    with saved(recorder, path):
        yield recorder


@contextmanager
def saved(recorder: Any, path: Path | None, at_end: bool = True) -> Iterator[None]:
    """Write what a recorder takes in here to a file, also on Ctrl-C or an error.

    Args:
        recorder: Has `frames`, how many it took, and `record()`.
        path: The file, which is told on stderr; None: nothing is written.
        at_end: Without it nothing is written where all went well: somebody else does.
    """
    if path is None:
        yield
        return
    writes = True
    with interrupt.patience(_WRITING):
        try:
            yield
            writes = at_end
        finally:
            if writes and recorder.frames:
                write_record(recorder.record(), path)
                with suppress(OSError):  # of a terminal that is gone
                    print(f"{recorder.frames:,} frames in {path}", file=sys.stderr)
