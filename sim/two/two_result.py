"""What happened when two robots ran: every frame, and the figures drawn from them."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from roadmap.arrays import freeze, frozen
from sim.loop.run_result import MOVING, STATUS, percentiles, touches


@dataclass(frozen=True, eq=False)
class TwoResult:
    """One run of two robots; frame i is time `i / rate_hz`."""

    other: str  # "planned" or "scripted": what the second robot was
    rate_hz: float  # frames per second
    trips: tuple[int, int]  # times each robot arrived at a work place
    T_world_base: np.ndarray  # (4, 4) base of the second in the base frame of the first
    # (F,) exact distance of the robots [m]; 0 or less in contact
    separation: np.ndarray
    # (F, dof) configurations of the first and of the second
    q: tuple[np.ndarray, np.ndarray]
    place: np.ndarray  # (F, 2) the work place each is on its way to
    status: np.ndarray  # (F, 2) index into `STATUS`
    wall_s: np.ndarray  # (F, 2) time of each planner's step [s]
    places: tuple[np.ndarray, np.ndarray]  # (n, dof) work places of each
    # for each, the first reason of every kind of hold -> frames
    reasons: tuple[dict, dict]

    def __post_init__(self) -> None:
        freeze(self, T_world_base=float, separation=float, wall_s=float)
        freeze(self, place=np.int32, status=np.uint8)
        q = tuple(frozen(a, np.float64) for a in self.q)
        object.__setattr__(self, "q", q)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.separation)

    def moving(self, k: int) -> np.ndarray:
        """(F,) whether robot k moved into this frame."""
        step = np.abs(np.diff(self.q[k], axis=0, prepend=self.q[k][:1])).max(axis=1)
        return step * self.rate_hz > MOVING

    @property
    def contacts(self) -> int:
        """Number of touches in which a robot that plans moved in a frame at least."""
        planned = self.moving(0)
        if self.other == "planned":
            planned = planned | self.moving(1)
        return touches(self.separation, planned)

    def summary(self) -> dict:
        """Return the figures as plain data; only "latency_us" depends on the clock."""
        near = int(self.separation.argmin())
        seconds = self.frames / self.rate_hz
        held = (self.status == STATUS.index("holding")).sum(axis=0) / self.rate_hz
        either = self.moving(0) & self.moving(1)
        planned = 2 if self.other == "planned" else 1
        return {
            "other": self.other,
            "duration_s": seconds,
            "rate_hz": self.rate_hz,
            "base_m": self.T_world_base[:3, 3].tolist(),
            "contacts": self.contacts,
            "touches": int((self.separation <= 0.0).any()),
            "separation_m": {
                "least": float(self.separation[near]),
                "at_s": near / self.rate_hz,
                "p50": float(np.median(self.separation)),
            },
            "trips": list(self.trips),
            "trips_per_minute": [60.0 * n / seconds for n in self.trips],
            "moving_s": [float(self.moving(k).sum() / self.rate_hz) for k in (0, 1)],
            "both_moving_s": float(either.sum() / self.rate_hz),
            "held_s": held.tolist(),
            "hold_reasons": [
                [list(row) for row in Counter(r).most_common(3)] for r in self.reasons
            ],
            "latency_us": [percentiles(1e6 * w) for w in self.wall_s.T[:planned]],
        }
