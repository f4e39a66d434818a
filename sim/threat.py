"""How far a person can come toward the robot within a time: speed and separation.

ISO/TS 15066 counts the person's speed *toward the robot*, 1.6 m/s walking and 2 m/s for
an arm where it is not measured (ISO 13855). Here it is measured: each capsule's ends
are followed from frame to frame, and what the person can add in the time is bounded by
an acceleration. A person who moves away or rests slows the robot less.
"""

from dataclasses import dataclass

import numpy as np

SIDEWAYS = 0.25  # share of a speed across the line to the robot that counts as toward


@dataclass(frozen=True)
class ThreatSettings:
    """What a person is able to do.

    Attributes:
        speed: No part of a person comes nearer faster than this [m/s].
        acceleration: What a part adds to its measured speed at most. A reach of
            0.4 m in 0.8 s along a minimum-jerk curve takes 3.6 m/s2; a thrust with a
            peak of 2 m/s over 0.45 m takes 15, at which a robot hardly moves beside
            a person.
        far: Parts farther from the robot than this are no threat [m].
    """

    speed: float = 2.0
    acceleration: float = 4.0
    far: float = 1.2


@dataclass(frozen=True)
class Threat:
    """The speeds of a person's parts toward the robot in one frame.

    Attributes:
        toward: (k,) speed of each part that is near enough to matter [m/s].
        age: Age of the data [s].
        settings: What a person is able to do.
    """

    toward: np.ndarray
    age: float
    settings: ThreatSettings

    def reach(self, time: float) -> float:
        """Return how far any part can come toward the robot in `time` [s], in m."""
        if not len(self.toward):
            return 0.0
        s = self.settings
        gained = self.toward.max() * time + 0.5 * s.acceleration * time * time
        return float(min(s.speed * time, gained))


class Watcher:
    """Follows a person's capsules from frame to frame.

    Args:
        settings: What a person is able to do.
    """

    def __init__(self, settings: ThreatSettings | None = None) -> None:
        """Nobody has been seen."""
        self.settings = settings or ThreatSettings()
        self._ends: np.ndarray | None = None
        self._time = 0.0

    def look(
        self, capsules: np.ndarray, centers: np.ndarray, now: float, age: float = 0.0
    ) -> Threat:
        """Return the threat of a frame.

        Args:
            capsules: (k, 7) person: a, b, radius [m]; the same parts in every frame.
            centers: (n, 3) centres of the robot's moving spheres [m].
            now: Time of the capsules [s].
            age: Age of the capsules [s].
        """
        if not len(capsules):
            self._ends = None
            return Threat(np.zeros(0), age, self.settings)
        ends = capsules[:, :6].reshape(-1, 2, 3)
        before, passed = self._ends, now - self._time
        self._ends, self._time = ends.copy(), now
        away = centers[None, None] - ends[:, :, None]  # (k, 2, n, 3)
        far = np.linalg.norm(away, axis=3)
        near = _gap(ends, centers) < self.settings.far
        if before is None or before.shape != ends.shape or passed <= 0.0:
            unknown = np.full(int(near.sum()), self.settings.speed)
            return Threat(unknown, age, self.settings)
        velocity = (ends - before) / passed
        nearest = far.argmin(axis=2)
        rows, columns = np.indices(nearest.shape)
        line = away[rows, columns, nearest]
        line = line / np.maximum(far.min(axis=2), 1e-9)[:, :, None]
        along = (velocity * line).sum(axis=2)
        across = np.linalg.norm(velocity - along[:, :, None] * line, axis=2)
        toward = np.maximum(along + SIDEWAYS * across, 0.0).max(axis=1)
        return Threat(toward[near], age, self.settings)


def _gap(ends: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """Return the distance (k,) of segments from the nearest of some points."""
    a, b = ends[:, 0], ends[:, 1]
    along = b - a
    length2 = np.maximum((along * along).sum(axis=1), 1e-12)
    from_a = centers[None] - a[:, None]
    share = np.clip(np.einsum("knd,kd->kn", from_a, along) / length2[:, None], 0, 1)
    off = from_a - share[:, :, None] * along[:, None]
    return np.sqrt((off * off).sum(axis=2).min(axis=1))
