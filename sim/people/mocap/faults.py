"""Jumps of a track that no person made: sensor faults, taken out before anyone looks.

A step between two frames is a jump when the joint would be faster than `FASTEST`, or
when its speed stands out from the steps around it by more than a person can change it
in one frame. Jumps cut a track into pieces; the pieces that one motion can join are
kept, so that a swapped marker that comes back is dropped as a whole.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

# A joint of a person at work moves slower [m/s]: measured hands peak at 3 m/s
FASTEST = {"hand": 8.0, "tip": 8.0, "elbow": 6.0}
FASTEST_TRUNK = 4.0  # shoulders, neck, head, hip
SPIKE = 2.0  # [m/s] a single step may stand out from its neighbours ...
SPIKE_ACCELERATION = 100.0  # ... and this times the frame time more [m/s^2]
AROUND_S = 0.03  # on either side [s] are a step's neighbours
LINK_COST_S = 0.25  # a jump is believed if what follows lasts longer than this [s]
LINK_SPEED = 2.0  # believed jumps are crossed at this speed [m/s]
START_S = 0.25  # jumps this early are a T-pose or a tracker finding its person [s]
SKIPPED_S = 0.05  # skipped after such a jump [s]
LOOK_BACK = 60  # pieces a piece may be joined to
NOISE = 0.2  # with more jumps than this share of steps, no frame is better than others
NOISY_JUMPS = 20  # fewer jumps than this are survived, in however short a clip


def fastest(joint: str) -> float:
    """Return the speed above which a step of `joint` is a sensor fault [m/s]."""
    return FASTEST.get(joint.rsplit("_", 1)[-1], FASTEST_TRUNK)


@dataclass(frozen=True)
class Faults:
    """What was wrong with one track."""

    bad: np.ndarray  # (F,) frames not to be believed
    jumps: int  # steps no person made,
    steps: int  # of so many between seen frames
    swings: int  # times that three or more such steps led on and on, not back
    peak: float  # speed of the fastest of them [m/s], 0 without

    @property
    def noisy(self) -> bool:
        """Whether the track is nothing but noise."""
        return self.jumps > max(NOISE * self.steps, NOISY_JUMPS)


def first_frame(joints: dict[str, np.ndarray], rate_hz: float) -> int:
    """Return the first frame after a T-pose or other jump at the very start.

    Args:
        joints: Joint -> (F, 3) place [m].
        rate_hz: Frames per second.
    """
    early, start = int(np.ceil(START_S * rate_hz)), 0
    for joint, place in joints.items():
        speed = np.linalg.norm(np.diff(place[: early + 1], axis=0), axis=1) * rate_hz
        jumps = np.flatnonzero(speed > fastest(joint))
        if len(jumps):
            skipped = int(np.ceil(SKIPPED_S * rate_hz - 1e-6))
            start = max(start, int(jumps[-1]) + 1 + skipped)
    return start


def find_faults(place: np.ndarray, rate_hz: float, limit: float) -> Faults:
    """Return which frames of a track (F, 3) not to believe; gaps, NaN, are no faults.

    A step faster than `limit` [m/s] is a jump.
    """
    bad = np.zeros(len(place), bool)
    seen = np.flatnonzero(np.isfinite(place).all(axis=1))
    if len(seen) < 2:
        return Faults(bad, 0, 0, 0, 0.0)
    track = _Track(place[seen], seen, rate_hz, limit)
    jump, speed = track.jumps(), np.linalg.norm(track.v, axis=1)
    onward = np.r_[True, (track.v[1:] * track.v[:-1]).sum(axis=1) > 0]
    swings = _runs(speed > limit, onward, 3)
    peak = float(speed[jump].max(initial=0.0))
    faults = Faults(bad, int(jump.sum()), len(jump), swings, peak)
    if faults.jumps and not faults.noisy:
        bad[seen[~_believed(track, jump)]] = True
    return faults


@dataclass(frozen=True, eq=False)
class _Track:
    """The frames of a track in which it was seen: places, frame numbers, limits."""

    p: np.ndarray
    frames: np.ndarray
    rate_hz: float
    limit: float

    @cached_property
    def t(self) -> np.ndarray:
        return self.frames / self.rate_hz

    @cached_property
    def v(self) -> np.ndarray:
        """Return (n - 1, 3) velocities of the steps [m/s]."""
        return np.diff(self.p, axis=0) / np.diff(self.t)[:, None]

    @property
    def around(self) -> int:
        """Number of steps on either side that count as neighbours."""
        return max(int(round(AROUND_S * self.rate_hz)), 1)

    @property
    def spike(self) -> float:
        """How far a step may stand out from its neighbours [m/s]."""
        return SPIKE + SPIKE_ACCELERATION / self.rate_hz

    def jumps(self) -> np.ndarray:
        """Return (n - 1,) which steps no person made."""
        jump = np.linalg.norm(self.v, axis=1) > self.limit
        n = self.around
        if len(self.v) > 2 * n:
            padded = np.pad(self.v, ((n, n), (0, 0)), mode="edge")
            others = [k for k in range(2 * n + 1) if k != n]
            windows = np.stack([padded[k : k + len(self.v)] for k in others])
            off = np.linalg.norm(self.v - np.median(windows, axis=0), axis=1)
            jump |= off > self.spike
        return jump

    def apart(self, a: np.ndarray, b: np.ndarray) -> float:
        """Return the distance from the end of piece a to the start of piece b [m]."""
        return float(np.linalg.norm(self.p[b[0]] - self.p[a[-1]]))

    def joins(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Tell whether a person can have moved from the end of a to the start of b."""
        link = (self.p[b[0]] - self.p[a[-1]]) / (self.t[b[0]] - self.t[a[-1]])
        if np.linalg.norm(link) > self.limit:
            return False
        n = self.around
        steps = np.concatenate([self.v[a[:-1]][-n:], self.v[b[:-1]][:n]])
        usual = np.median(steps, axis=0) if len(steps) else np.zeros(3)
        return bool(np.linalg.norm(link - usual) <= self.spike)


def _believed(track: _Track, jump: np.ndarray) -> np.ndarray:
    """Return (n,) which of the seen frames belong to one motion."""
    pieces = np.split(np.arange(len(track.p)), np.flatnonzero(jump) + 1)
    chain = _best_chain(track, pieces)
    believed = np.zeros(len(track.p), bool)
    for piece in chain:
        believed[piece] = True
    for a, b in zip(chain[:-1], chain[1:], strict=True):
        if not track.joins(a, b):  # believed all the same: leave time to cross it
            start, stop = track.t[a[-1]], track.t[b[0]]
            spare = max(track.apart(a, b) / LINK_SPEED - (stop - start), 0.0) / 2
            believed[a[track.t[a] > start - spare]] = False
            believed[b[track.t[b] < stop + spare]] = False
    return believed


def _best_chain(track: _Track, pieces: list[np.ndarray]) -> list[np.ndarray]:
    """Return the pieces in order that hold the most frames, less what jumps cost."""
    best = [float(len(piece)) for piece in pieces]
    before = [-1] * len(pieces)
    for j, b in enumerate(pieces):
        for i in range(max(j - LOOK_BACK, 0), j):
            cost = 0.0
            if not track.joins(pieces[i], b):
                time = LINK_COST_S + track.apart(pieces[i], b) / LINK_SPEED
                cost = time * track.rate_hz
            score = best[i] + len(b) - cost
            if score > best[j]:
                best[j], before[j] = score, i
    chain = [int(np.argmax(best))]
    while before[chain[-1]] >= 0:
        chain.append(before[chain[-1]])
    return [pieces[i] for i in reversed(chain)]


def _runs(mask: np.ndarray, onward: np.ndarray, length: int) -> int:
    """Return how many runs of True, each step onward from the last, are that long."""
    found = n = 0
    for here, on in zip(mask, onward, strict=True):
        n = (n + 1 if on else 1) if here else 0
        found += n == length
    return found
