"""A hand-over recorded and played again: what was seen and felt, and what it did."""

import hashlib
from dataclasses import asdict, replace

import numpy as np

from handover.human.human import Human
from handover.meet.held_object import HeldObject
from roadmap.errors import BadInput
from roadmap.geometry.gaps import moved_rods
from sim.loop.run_result import STATUS, holds_of
from sim.record.people import (
    body_told,
    held_of,
    held_told,
    people_arrays,
    person_at,
    person_of,
)
from sim.record.record_check import BadRecord
from sim.record.recorder import PACES, common_head, sealed
from sim.record.run_record import STORY, RunRecord
from sim.story.cases import StorySetup
from sim.story.frame import StoryFrame
from sim.story.handover import Handover
from sim.story.machine import TABLES
from sim.story.play import RATE, StoryMoment, StoryPlay
from sim.story.settings import StorySettings

_NO_COMFORT = {"hand_near": 0.0, "hand_jerk": np.inf, "body_near": 0.0}  # of speeds
_OF_IT = "story."  # what the arrays of a hand-over begin with
_FAR = np.array([0.0, 0.0, -5.0, 0.0, 0.0, -5.0, 1e-3])  # an object that is gone


class StoryRecorder:
    """Takes the moments of a run that was not begun."""

    def __init__(self, run: StoryPlay) -> None:
        self.run, self.moments = run, []

    @property
    def frames(self) -> int:
        """How many moments it took."""
        return len(self.moments)

    def add(self, moment: StoryMoment) -> None:
        """Take a moment."""
        self.moments.append(moment)

    def record(self) -> RunRecord:
        """Return the recording, as `sim.record` writes it and `odm view` shows it."""
        if not self.moments:
            raise BadInput("no frame was run, so there is nothing to record")
        run, setup = self.run, self.run.setup
        arrays = self._arrays()
        head = self._head() | {"outcome": self._outcome(arrays)}
        made = sealed(head, arrays, setup.cell_map.robot)
        head["outcome"]["story_sha256"] = fingerprint(
            arrays["q"], arrays["story.state"]
        )
        head["outcome"]["story"] = [asdict(e) for e in run.story.events]
        return made

    def _arrays(self) -> dict[str, np.ndarray]:
        moments, obj = self.moments, self.run.setup.obj
        n, names = len(moments), _states(self.run.case.direction)
        rows = []
        for m in moments:
            thing = np.tile(_FAR, (len(obj.capsules), 1))
            if m.T_object is not None:
                thing = moved_rods(obj.capsules, m.T_object)
            rows.append(np.vstack([m.capsules, thing]))
        humans = [m.frame.human for m in moments]
        nowhere = np.full((4, 4), np.nan)
        places = [m.frame.T_base_object for m in moments]
        q = np.array([m.q for m in moments])
        dq = np.array([m.dq for m in moments])
        return {
            "time_s": np.arange(n) / RATE,
            "places": np.array([self.run.setup.rest] * 2),
            "capsules": np.array(rows),
            "status": np.array([STATUS.index(m.status) for m in moments], np.uint8),
            "place": np.zeros(n, np.int32),
            "pace": np.array([PACES.index(m.pace) for m in moments], np.uint8),
            "escape": np.zeros(n, np.uint8),
            "q": q,
            "dq": dq,
            "ddq": np.array([m.ddq for m in moments]),
            "separation": np.array([m.separation for m in moments]),
            "joint_speed": np.abs(dq).max(axis=1),
            "point_speed": np.zeros(n),
            "story.state": np.array([names.index(m.state) for m in moments], np.uint8),
            "story.fingers": np.array([m.fingers for m in moments]),
            "story.holding": np.array([m.holding for m in moments], np.uint8),
            "story.wrench": np.array([m.frame.wrench for m in moments]),
            "story.sensed": np.array(
                [[m.frame.opened, m.frame.holds] for m in moments], np.uint8
            ),
            "story.object": np.array([nowhere if T is None else T for T in places]),
            **people_arrays(humans, _OF_IT),
            **_tracked([m.frame for m in moments]),
        }

    def _head(self) -> dict:
        run, setup = self.run, self.run.setup
        case, story = run.case, run.story
        human = self.moments[0].frame.human
        executor = story.executor.settings
        told = {
            "direction": case.direction,
            "fetch": story.fetches,
            "states": _states(case.direction),
            "reach": setup.reach.hash,
            "settings": asdict(story.settings),
            "others": setup.T_others.tolist(),
            "object": setup.obj.name,
            "held": held_told(setup.obj),
            "person": body_told(human) | {"side": setup.side},
        }
        return {
            "kind": "odm demo handover",
            "format": STORY,
            "frames": len(self.moments),
            "motion": {"name": f"hand-over, {case.direction}", "notes": []}
            | {"max_speed": case.traits.hand_speed},
            "settings": {"rate_hz": RATE, "seed": case.seed}
            | {"speed_scale": executor.speed_scale},
            "planner": {"settings": asdict(run.planner.settings)},
            "story": told,
            **common_head(setup.cell_map, PACES),
        }

    def _outcome(self, arrays: dict[str, np.ndarray]) -> dict:
        told = [f"{m.state}: {m.reason}" for m in self.moments]
        holds = holds_of(
            arrays["status"], arrays["joint_speed"], told.__getitem__, RATE
        )
        return {
            "trips": int(self.run.result.handed_over),
            "path_changes": self.run.result.path_changes,
            "holds": [asdict(h) | {"later": []} for h in holds],
            "slow": [],
        }


def play_again(record: RunRecord, setup: StorySetup) -> tuple[np.ndarray, list[str]]:
    """Let a new story see and feel what was recorded; return q (F, dof) and states.

    BadRecord where the setup's map or reach map is another one.
    """
    told, arrays = record.head["story"], record.arrays
    for what, ours, its in (
        ("map", setup.cell_map.hash, record.head["map"]["hash"]),
        ("reach map", setup.reach.hash, told["reach"]),
    ):
        if ours != its:
            raise BadRecord(
                f"the hand-over was recorded with the {what} {its[:12]}, but this is "
                f"{ours[:12]}; give the one it was recorded with"
            )
    person = person_of(told["person"])
    story = story_of(setup, told, person_at(person, arrays, _OF_IT, 0))
    rows, states, names = [], [], told["states"]
    for i in range(record.frames):
        rows.append(np.array(story.executor.set_point.q))
        T = arrays["story.object"][i]
        opened, holds = arrays["story.sensed"][i].astype(bool).tolist()
        story.update(
            StoryFrame(
                float(arrays["time_s"][i]),
                person_at(person, arrays, _OF_IT, i),
                arrays["story.wrench"][i],
                opened,
                holds,
                None if np.isnan(T).any() else T,
                **_seen(arrays, i),
            )
        )
        states.append(story.state)
    assert set(states) <= set(names)
    return np.array(rows), states


def story_of(setup: StorySetup, told: dict, human: Human) -> Handover:
    """Return the story of a recording, before its first frame."""
    from odm.execution.speed_limit import SpeedSettings
    from odm.execution.threat import ThreatSettings
    from sim.story.play import new_story
    from sim.story.pull import PullSettings
    from sim.story.settings import ComfortSettings

    known = dict(told["settings"])
    known.setdefault("comes", 0.0)  # in older recordings any hand that near counts
    known.setdefault("put_down_s", known["fetch_s"])
    known.setdefault("place_s", 3600.0)  # they waited at the one place there was
    others = np.array(told.get("others", [])).reshape(-1, 4, 4)
    setup = replace(setup, T_others=others)
    known["pull"] = PullSettings(**known["pull"])
    # recordings from before there was such a thing knew no comfort
    known["speed"] = SpeedSettings(**{**_NO_COMFORT, **known["speed"]})
    none = {"face_to_hand": 0.0, "unseen": 0.0}
    known["comfort"] = ComfortSettings(**known.get("comfort", none))
    before = {"jerk": 0.0}  # of recordings that have no choice
    known["threat"] = ThreatSettings(**before | known.get("threat", {}))
    return new_story(setup, StorySettings(**known), human, told["fetch"])


def object_of(head: dict) -> HeldObject | None:
    """Return what was handed over, of a recording's head; None: it does not say."""
    told = head["story"].get("held")
    return None if told is None else held_of(told)


def same(record: RunRecord, q: np.ndarray, states: list[str]) -> bool:
    """Whether a replay is the recorded run, byte by byte."""
    names = record.head["story"]["states"]
    codes = np.array([names.index(s) for s in states], np.uint8)
    return fingerprint(q, codes) == record.head["outcome"]["story_sha256"]


def fingerprint(q: np.ndarray, states: np.ndarray) -> str:
    """Return a SHA-256 over what the robot did and which states it was in."""
    digest = hashlib.sha256(np.ascontiguousarray(q, np.float64).tobytes())
    digest.update(np.ascontiguousarray(states, np.uint8).tobytes())
    return digest.hexdigest()


def _states(direction: str) -> list[str]:
    rows = TABLES[direction]
    return list(dict.fromkeys([r.state for r in rows] + [r.then for r in rows]))


def _tracked(frames: list[StoryFrame]) -> dict[str, np.ndarray]:
    """Return the person as a tracker knew them, where that is not where they were."""
    found = {}
    if frames[0].capsules is not None:
        found["story.tracked"] = np.array([f.capsules for f in frames])
        found["story.labels"] = np.array([f.labels for f in frames], np.int64)
    if frames[0].stamp is not None:
        found["story.stamp"] = np.array([f.seen_at for f in frames])
    return found


def _seen(arrays: dict[str, np.ndarray], i: int) -> dict[str, np.ndarray]:
    names = {"capsules": "tracked", "labels": "labels", "stamp": "stamp"}
    told = {field: f"{_OF_IT}{name}" for field, name in names.items()}
    return {field: arrays[name][i] for field, name in told.items() if name in arrays}
