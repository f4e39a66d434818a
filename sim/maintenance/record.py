"""A cycle recorded as one run, and played again hand-over by hand-over."""

from dataclasses import asdict

import numpy as np

from roadmap.errors import BadInput
from roadmap.geometry.gaps import moved_rods
from sim.maintenance.cases import BESIDE_PANDA, ToolSetup, WorkPlace
from sim.record.run_record import RunRecord
from sim.story.machine import DIRECTIONS
from sim.story.play import RATE, StoryMoment, StoryPlay
from sim.story.record import StoryRecorder, play_again, same

PARTS = "parts"  # of a recording's head: each hand-over's own head
WORK_PLACE = "work_place"  # ... and where they were
KIND = "odm demo maintenance"
_NOTHING = np.zeros((0, 7))


class CycleRecorder:
    """Takes the moments of a cycle; see `sim.maintenance.play.play_cycle`."""

    def __init__(self, at: WorkPlace = BESIDE_PANDA) -> None:
        self._at = at
        self._parts: list[StoryRecorder] = []

    @property
    def frames(self) -> int:
        """How many moments it took."""
        return sum(part.frames for part in self._parts)

    def add(self, run: StoryPlay, moment: StoryMoment) -> None:
        """Take a moment of a hand-over."""
        if not self._parts or self._parts[-1].run is not run:
            self._parts.append(StoryRecorder(run))
        self._parts[-1].add(moment)

    def record(self) -> RunRecord:
        """Return the recording of all hand-overs, one after the other."""
        if not self._parts:
            raise BadInput("no frame was run, so there is nothing to record")
        parts = [part.record() for part in self._parts]
        standing = [_standing(part.run.setup) for part in self._parts]
        made = _joined(parts, standing)
        made.head[WORK_PLACE] = asdict(self._at)
        return made


def work_place_of(record: RunRecord) -> WorkPlace:
    """Return where the table and the ladder stood; older recordings are the Panda's."""
    kept = record.head.get(WORK_PLACE)
    return BESIDE_PANDA if kept is None else WorkPlace.told(kept)


def parts_of(record: RunRecord) -> list[RunRecord]:
    """Return the hand-overs of a recorded cycle, each as it was recorded."""
    states = record.head["story"]["states"]
    parts, begin = [], 0
    for head in record.head[PARTS]:
        end = begin + head["frames"]
        arrays = {
            name: array if _is_shared(name) else array[begin:end]
            for name, array in record.arrays.items()
        }
        own = [head["story"]["states"].index(states[k]) for k in arrays["story.state"]]
        arrays["story.state"] = np.array(own, np.uint8)
        arrays["time_s"] = np.arange(head["frames"]) / RATE
        parts.append(RunRecord(head, arrays))
        begin = end
    return parts


def is_same_again(record: RunRecord, setups: tuple[ToolSetup, ...]) -> bool:
    """Play a recorded cycle again; return whether it is the same, byte by byte."""
    for k, part in enumerate(parts_of(record)):
        if not same(part, *play_again(part, setups[k // len(DIRECTIONS)])):
            return False
    return True


def _joined(parts: list[RunRecord], standing: list[np.ndarray]) -> RunRecord:
    states = list(dict.fromkeys(s for p in parts for s in p.head["story"]["states"]))
    begun = np.cumsum([0, *(part.frames for part in parts)])
    arrays = {}
    for name in parts[0].arrays:
        rows = [part.arrays[name] for part in parts]
        arrays[name] = rows[0] if _is_shared(name) else np.concatenate(rows)
    arrays["time_s"] = np.arange(begun[-1]) / RATE
    arrays["story.state"] = np.concatenate(
        [
            np.array([states.index(s) for s in p.head["story"]["states"]], np.uint8)[
                p.arrays["story.state"]
            ]
            for p in parts
        ]
    )
    arrays["capsules"] = np.concatenate(
        [
            np.concatenate([p.arrays["capsules"], np.tile(rows, (p.frames, 1, 1))], 1)
            for p, rows in zip(parts, standing, strict=True)
        ]
    )
    head = parts[0].head | {"kind": KIND, "frames": int(begun[-1])}
    head |= {PARTS: [part.head for part in parts]}
    head["motion"] = head["motion"] | {"name": "maintenance"}
    head["story"] = head["story"] | {"states": states}
    events, holds = [], []
    for part, frames in zip(parts, begun, strict=False):
        later = float(frames / RATE)
        told = part.head["outcome"]
        events += [e | {"time_s": e["time_s"] + later} for e in told["story"]]
        holds += [
            h | {"start_s": h["start_s"] + later, "end_s": h["end_s"] + later}
            for h in told["holds"]
        ]
    head["outcome"] = head["outcome"] | {
        "trips": sum(part.head["outcome"]["trips"] for part in parts),
        "path_changes": sum(part.head["outcome"]["path_changes"] for part in parts),
        "holds": holds,
        "story": events,
    }
    made = RunRecord(head, arrays)
    head["outcome"]["trajectory_sha256"] = made.result().fingerprint()
    return made


def _standing(setup: ToolSetup) -> np.ndarray:
    """Return the tools in their places as capsules (k, 7), base frame [m]."""
    return np.vstack(
        [moved_rods(tool.capsules, T) for tool, T in setup.others] or [_NOTHING]
    )


def _is_shared(name: str) -> bool:
    """Whether an array is the same for the whole run, and not one row a frame."""
    return name == "places" or name.startswith("robot.")
