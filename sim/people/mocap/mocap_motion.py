"""A recorded person over time: a `sim.people.human_motion.HumanMotion`."""

import sys
from dataclasses import dataclass

import numpy as np

from handover.human.body import JOINTS
from roadmap.arrays import freeze
from roadmap.errors import BadInput
from roadmap.ranges import is_between, told


@dataclass(frozen=True)
class Sight:
    """What the tracker does not see of the person at one moment.

    Attributes:
        unseen: Joint -> time since it was last seen [s]; short gaps are not in it.
        reason: A sentence about them, None while all is seen.
    """

    unseen: dict[str, float]
    reason: str | None


@dataclass(frozen=True, eq=False)
class MocapMotion:
    """The upper body of a recorded person, placed in the robot's base frame.

    Attributes:
        name: Name of the motion: the file's.
        max_speed: No point of the surface advances faster than this [m/s].
        rate_hz: Frames per second of the recording, as played.
        duration_s: Length of the clip [s].
        loops: It is played to and fro without end; else the person then stands still.
        frames: (F, k, 7) capsules a, b, radius as the tracker knows them: bridged over
            short gaps, remembered and grown in longer ones [m]. Of a loop, both ways.
        guesses: (F, k, 7) the same without growth, all gaps crossed straight [m].
        labels: (k,) `handover.human.body.Part` of each capsule.
        age_s: (F, 11) time since each of `handover.human.body.JOINTS` was last seen
            [s].
        jumped: (F, 11) it is not believed because it jumped, rather than not seen.
        notes: Sentences on what was guessed and mended.
    """

    name: str
    max_speed: float
    rate_hz: float
    duration_s: float
    loops: bool
    frames: np.ndarray
    guesses: np.ndarray
    labels: np.ndarray
    age_s: np.ndarray
    jumped: np.ndarray
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self, frames=float, guesses=float, age_s=float)
        freeze(self, labels=np.int64, jumped=np.bool_)

    def capsules(self, t: float) -> np.ndarray:
        """Return the person at time `t` [s] as (k, 7) capsules a, b, radius [m].

        What is not seen stays where it was, grown by its age times a speed bound.
        """
        return self._between(self.frames, t)

    def guess(self, t: float) -> np.ndarray:
        """Return the person as they probably were: (k, 7), gaps crossed, not grown."""
        return self._between(self.guesses, t)

    def state(self, t: float) -> Sight:
        """Return what the tracker does not see at time `t` [s], in words too."""
        i, share = self._frame(t)
        i = int(round(i + share)) % len(self.frames)
        joints = np.flatnonzero(self.age_s[i])
        unseen = {JOINTS[j]: float(self.age_s[i, j]) for j in joints}
        said = [
            f"{JOINTS[j].replace('_', ' ')} "
            f"{'jumped, not believed' if self.jumped[i, j] else 'not seen'} "
            f"for {self.age_s[i, j]:.2f} s"
            for j in joints
        ]
        return Sight(unseen, "; ".join(said) or None)

    def ending(self, run_s: float) -> str | None:
        """Return what happens when the clip is shorter than a run [s], None if not."""
        if run_s <= self.duration_s:
            return None
        then = "is played to and fro" if self.loops else "ends in its last pose"
        return (
            f"the clip {self.name} of {self.duration_s:.1f} s is shorter than the run "
            f"of {run_s:.1f} s and {then}"
        )

    def _between(self, frames: np.ndarray, t: float) -> np.ndarray:
        i, share = self._frame(t)
        after = frames[(i + 1) % len(frames)]
        return frames[i] + share * (after - frames[i])

    def _frame(self, t: float) -> tuple[int, float]:
        """Return the frame before time `t` and the share of the way to the next."""
        if not is_between(t, 0.0, sys.float_info.max):
            raise BadInput(
                f"the clip {self.name} was asked for t = {told(t)} s; give a time from "
                "0 on"
            )
        n = len(self.frames)
        at = t * self.rate_hz
        at = at % n if self.loops else min(at, n - 1.0)
        i = min(int(at), n - 1)
        return i, at - i
