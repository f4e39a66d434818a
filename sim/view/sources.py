"""Where moments come from: a recording, a live run's letters, or a map alone."""

import bisect
import pickle
from abc import ABC, abstractmethod
from collections import deque
from contextlib import suppress
from dataclasses import replace

import numpy as np

from odm.obstacles.scenery import parse_scenery
from roadmap.arrays import frozen
from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose
from roadmap.robot.robot import Robot
from sim.draw.surroundings import all_triangles
from sim.loop.run_result import STATUS
from sim.loop.target_rows import TARGETS_EVERY
from sim.record import RunRecord
from sim.record.again import robot_of
from sim.record.standing import shapes_of
from sim.view.mailbox import Mailbox
from sim.view.moment import (
    HOLDING,
    ON_THE_WAY,
    STILL,
    Event,
    Happenings,
    Moment,
    state_of,
)
from sim.view.robot_shapes import Part, lowest_of_robot
from sim.view.theme import lowest_of

KEPT = 18_000  # moments of a live run: ten minutes at 30 a second
KEPT_ROWS = 60_000  # its frames: ten minutes at 100 a second
KEPT_EVENTS = 2_000
_LOOKS = 100  # at so many frames of a recording the robot is looked at
NO_ROWS = frozen(np.zeros((0, 5)), float)


class Source(ABC):
    """Moments by time; one that never changes, unless a kind of source says more.

    Attributes:
        live: Whether more of them come.
        events: What happened, by time.
        knows_latency: Whether the rows tell how long frames took.
        lacks: Layers of the page that its moments never have.
    """

    live = knows_latency = False
    lacks: frozenset[str] = frozenset()
    events: list[Event] = []  # of one that never changes

    def poll(self) -> bool:
        """Take what came; return whether anything did."""
        return False

    def span(self) -> tuple[float, float]:
        """Return the first and the last moment that there is [s]."""
        return 0.0, 0.0

    @abstractmethod
    def at(self, time_s: float) -> Moment | None:
        """Return the last moment that is not later, None where there is none yet."""

    def rows(self) -> np.ndarray:
        """Return (n, 5) all frames, see `Moment.rows`."""
        return NO_ROWS


class Recorded(Source):
    """A recording, which needs nothing but its file."""

    lacks = frozenset({"points", "before"})  # no file holds them

    def __init__(self, record: RunRecord) -> None:
        self.record, self.robot = record, robot_of(record)
        self._place_q = record.arrays["places"]
        self._goals: dict[int, np.ndarray] = {}
        self._things, self._stands = _of_story(record)
        self._rows, self._reasons = self._read()
        told = record.arrays.get("story.state", record.arrays["place"])
        # of each frame the last one in which its place is still the goal
        last = np.flatnonzero(np.r_[told[1:] != told[:-1], True])
        self._ends = last[np.searchsorted(last, np.arange(len(told)))]
        self._driven: tuple[int, np.ndarray] = (-1, np.zeros((0, self.robot.dof)))

    def _read(self) -> tuple[np.ndarray, list[tuple[float, float, str]]]:
        record, arrays = self.record, self.record.arrays
        paces = record.head["pace_names"]
        gaps, place = arrays["separation"], arrays["place"]
        status, pace = arrays["status"], arrays["pace"]
        states = [
            state_of(STATUS[s], paces[p], g)
            for s, p, g in zip(status, pace, gaps.tolist(), strict=True)
        ]
        reasons = [(h["start_s"], h["end_s"], h["reason"]) for h in record.holds]
        reasons += [(s["start_s"], s["end_s"], s["reason"]) for s in record.slow]
        reasons.sort()
        for begin, end, told in reasons:
            if told in self._stands:
                for i in range(_frame(record, begin), _frame(record, end)):
                    states[i] = STILL if states[i] == HOLDING else states[i]
        why = [""] * len(states)
        for begin, end, told in reasons:
            first, last = _frame(record, begin), _frame(record, end)
            why[first:last] = [told] * (last - first)
        seen = Happenings()
        times = arrays["time_s"]
        new = STATUS.index("replanned")
        for i, state in enumerate(states):
            fresh = bool(i) and status[i] == new
            seen.take(float(times[i]), state, int(place[i]), why[i], fresh)
        story = record.head["outcome"].get("story", [])
        self.events = sorted(
            [*seen.events, *map(_told_by, story)],
            key=lambda event: event.time_s,
        )
        rows = np.column_stack([times, gaps, np.zeros(len(times)), states, place])
        return rows, reasons

    def lowest(self, parts: list[Part]) -> float:
        """Return how low people and a robot of such meshes come [m], at most 0."""
        arrays = self.record.arrays
        rows = arrays["capsules"]
        people = rows[..., : rows.shape[-2] - self._things, :].reshape(-1, 7)
        step = max(1, len(arrays["q"]) // _LOOKS)
        of_robot = lowest_of_robot(self.robot, parts, arrays["q"][::step])
        return min(lowest_of(people), of_robot)

    def span(self) -> tuple[float, float]:
        """Return the first and the last moment [s]."""
        return 0.0, float(self._rows[-1, 0])

    def rows(self) -> np.ndarray:
        """Return (n, 5) all frames."""
        return self._rows

    def at(self, time_s: float) -> Moment:
        """Return a frame; its path is where the robot went until its next goal."""
        record, arrays = self.record, self.record.arrays
        i = int(time_s * record.rate_hz + 1e-6)
        i = min(max(i, 0), record.frames - 1)
        state = int(self._rows[i, 3])
        return Moment(
            time_s=float(self._rows[i, 0]),
            q=arrays["q"][i],
            capsules=record.person("capsules", i),
            state=state,
            reason=self._reason(float(self._rows[i, 0]), state),
            separation=float(arrays["separation"][i]),
            path=self._path(i),
            targets=self._targets(i),
            payload=arrays.get("payload"),
            things=self._things,
        )

    def _reason(self, now: float, state: int) -> str:
        if state == ON_THE_WAY:
            return ""
        told = [why for a, b, why in self._reasons if a <= now + 1e-9 and now < b]
        return told[-1] if told else ""

    def _path(self, i: int) -> np.ndarray:
        """Return what the robot drives from frame i on to the end of this trip."""
        end = self._ends[i]
        rows = np.arange(i, end + 1, max(1, (end - i) // 60))
        return self.record.arrays["q"][np.append(rows, end)]

    def _targets(self, i: int) -> np.ndarray:
        arrays = self.record.arrays
        if "targets.shown" in arrays:
            ends = arrays["targets.shown_at"]
            k = min(i // TARGETS_EVERY, len(ends) - 2)
            return arrays["targets.shown"][ends[k] : ends[k + 1]]
        place = int(arrays["place"][i])
        if place not in self._goals:
            self._goals[place] = place_targets(self.robot, self._place_q, place)
        return self._goals[place]


def _frame(record: RunRecord, time_s: float) -> int:
    return min(max(round(time_s * record.rate_hz), 0), record.frames)


def _of_story(record: RunRecord) -> tuple[int, set[str]]:
    """Return how many capsules are the object, and the reasons to stand at will.

    A hold that says no more than how the story came to its state waits for somebody,
    or for the fingers.
    """
    told = record.head.get("story")
    if told is None:
        return 0, set()
    from handover.human.human import Human

    known = len(Human().labels)
    things = max(0, record.arrays["capsules"].shape[1] - known)
    events = record.head["outcome"].get("story", [])
    stands = {f"{e['state']}: {e['reason']}" for e in events}
    return things, stands | {f"{state}: " for state in told["states"]}


def _told_by(event: dict) -> Event:
    word = event["state"].replace("_", " ")
    return Event(event["time_s"], ON_THE_WAY, f"{word}: {event['reason']}")


def standing_of_record(record: RunRecord) -> np.ndarray:
    """Return the triangles (n, 3, 3) of what stood around a recorded run [m].

    Scenery that the recipe names by a file is left out where the file is not there.
    """
    found = []
    for table in record.head["map"]["recipe"].get("scenery", []):
        with suppress(BadInput):
            found += [shape for _, shape in parse_scenery((table,)).shapes()]
    for row in record.scene:
        _, shapes, pose = shapes_of(row)
        found += [shape.moved(pose) for shape in shapes]
    return all_triangles(found)


def place_targets(robot: Robot, places: np.ndarray, place: int) -> np.ndarray:
    """Return work places as targets without a quality, (n, 5)."""
    p = np.array([tool_pose(robot, q)[:3, 3] for q in places])
    pursued = np.arange(len(places)) == place
    return np.column_stack([p, np.full(len(p), np.nan), pursued])


class Letters(Source):
    """The moments of a live run, as they lie in a mailbox; some minutes are kept."""

    live = knows_latency = True

    def __init__(self, box: Mailbox) -> None:
        self._box = box
        self._moments: deque[Moment] = deque(maxlen=KEPT)
        self._times: deque[float] = deque(maxlen=KEPT)
        self._rows = np.zeros((2 * KEPT_ROWS, 5))
        self._used = 0
        self.events: list[Event] = []

    def poll(self) -> bool:
        """Take the newest letter."""
        letter = self._box.take()
        if letter is None:
            return False
        moment = pickle.loads(letter)
        if self._times and moment.time_s < self._times[-1]:
            self._moments.clear()  # another run has begun
            self._times.clear()
            self.events, self._used = [], 0
        self._note(moment)
        self._moments.append(replace(moment, rows=None, events=()))
        self._times.append(moment.time_s)
        return True

    def _note(self, moment: Moment) -> None:
        """Keep rows and events that were not known."""
        newest = self.events[-1].time_s if self.events else -np.inf
        same = [e for e in self.events[-8:] if e.time_s == newest]
        fresh = [
            e
            for e in moment.events
            if e.time_s > newest or (e.time_s == newest and e not in same)
        ]
        self.events = [*self.events, *fresh][-KEPT_EVENTS:]
        rows = NO_ROWS if moment.rows is None else moment.rows
        if self._used:
            rows = rows[rows[:, 0] > self._rows[self._used - 1, 0]]
        rows = rows[-KEPT_ROWS:]
        if self._used + len(rows) > len(self._rows):
            self._rows[:KEPT_ROWS] = self._rows[self._used - KEPT_ROWS : self._used]
            self._used = KEPT_ROWS
        self._rows[self._used : self._used + len(rows)] = rows
        self._used += len(rows)

    def span(self) -> tuple[float, float]:
        """Return the first and the last moment kept [s]."""
        return (self._times[0], self._times[-1]) if self._times else (0.0, 0.0)

    def rows(self) -> np.ndarray:
        """Return (n, 5) the frames of the moments kept."""
        return self._rows[: self._used]

    def at(self, time_s: float) -> Moment | None:
        """Return the last moment kept that is not later."""
        if not self._times:
            return None
        if time_s >= self._times[-1]:
            return self._moments[-1]
        return self._moments[max(bisect.bisect_right(self._times, time_s) - 1, 0)]
