"""What happened in a run: every frame as arrays, and the figures drawn from them."""

import hashlib
import json
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field

import numpy as np

from roadmap.arrays import freeze, frozen

STATUS = ("following", "replanned", "holding")  # codes of RunResult.status
RETREATS = ("", "backing off", "escaping")  # codes of RunResult.retreat
MOVING = 0.01  # a joint faster than this moves [rad/s or m/s]


@dataclass(frozen=True)
class Hold:
    """A stretch of frames without a path."""

    # when it began and ended [s]
    start_s: float
    end_s: float
    reason: str  # the planner's sentence in its first frame
    retreating: bool  # whether the robot moved out of the way meanwhile


@dataclass(frozen=True, eq=False)
class RunResult:
    """One run of the loop. Frame i is time `i / rate_hz`; all arrays have F rows."""

    motion: str  # name of the human motion, "none" without a person
    seed: int  # seed of the motion
    rate_hz: float  # frames per second
    trips: int  # times the robot arrived at a work place
    path_changes: int  # new paths on the way, those for a new work place not counted
    holds: tuple[Hold, ...]  # when and why the robot held
    q: np.ndarray  # (F, dof) configuration [rad or m]
    capsules: np.ndarray  # (F, k, 7) person [m]
    # (F,) exact distance of robot and person [m]; inf without a person, 0 or less in
    # contact
    separation: np.ndarray
    joint_speed: np.ndarray  # (F,) fastest joint while it moved to `q` [rad/s or m/s]
    point_speed: np.ndarray  # (F,) fastest point of the robot on the way to `q` [m/s]
    status: np.ndarray  # (F,) index into `STATUS`
    place: np.ndarray  # (F,) the work place the robot is on its way to
    # (F,) time of the planner's step: passed, and computed [s]
    wall_s: np.ndarray
    cpu_s: np.ndarray
    improve_s: np.ndarray  # (F,) time of its improving after the answer [s]
    stages: dict[str, np.ndarray]  # the planner's own times by stage, (F,) each [s]
    # frame -> (k, dof) planned path, where they were kept
    paths: dict[int, np.ndarray] = field(default_factory=dict)
    # (F,) computing time of the improving [s]; None: as `improve_s`
    improve_cpu_s: np.ndarray | None = None
    # (F,) index into `RETREATS`: whether the robot got out of the way
    retreat: np.ndarray | None = None
    # what happened to a robot that was pushed, see `PushedRobot.figures`; then `q`,
    # `separation` and `point_speed` are the true robot's, and `joint_speed` its
    # set-point's: it moves where it is told to move
    pushed: dict | None = None
    # how long it had a path and was slowed or braked for the person [s]; None: it
    # brakes for nobody
    slowed_s: float | None = None

    def __post_init__(self) -> None:
        freeze(self, q=float, capsules=float, separation=float, joint_speed=float)
        freeze(self, point_speed=float, status=np.uint8, place=np.int32)
        freeze(self, wall_s=float, cpu_s=float, improve_s=float)
        retreat = np.zeros(len(self.q)) if self.retreat is None else self.retreat
        object.__setattr__(self, "retreat", frozen(retreat, np.uint8))
        improve = self.improve_s if self.improve_cpu_s is None else self.improve_cpu_s
        object.__setattr__(self, "improve_cpu_s", frozen(improve, np.float64))
        stages = {k: frozen(v, np.float64) for k, v in self.stages.items()}
        object.__setattr__(self, "stages", stages)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.q)

    @property
    def duration_s(self) -> float:
        """Simulated time [s]."""
        return self.frames / self.rate_hz

    @property
    def moving(self) -> np.ndarray:
        """(F,) whether any joint moved faster than 0.01 rad/s into this frame."""
        return self.joint_speed > MOVING

    @property
    def contacts(self) -> int:
        """Number of touches in which the robot moved in at least one frame."""
        return touches(self.separation, self.moving)

    @property
    def standing_contacts(self) -> int:
        """Number of touches while the robot stood: the person came to it."""
        return len(stretches(self.separation <= 0.0)) - self.contacts

    def closest(self, while_moving: bool = False) -> int | None:
        """Return the frame of smallest separation, None if there is no such frame."""
        d = np.where(self.moving | (not while_moving), self.separation, np.inf)
        return int(d.argmin()) if len(d) and np.isfinite(d.min()) else None

    def misses(self, clock: str = "wall") -> np.ndarray:
        """Return the frames whose step and improving took longer than the period.

        By the "wall" or the "cpu" clock.
        """
        return np.flatnonzero(self._busy(clock) > 1.0 / self.rate_hz)

    def hold_reasons(self, most: int = 3) -> list[tuple[str, int, float]]:
        """Return (reason, how often, total [s]), longest first.

        Reasons that differ in numbers and names only are one, told by its first.
        """
        first, count, total = {}, Counter(), Counter()
        for hold in self.holds:
            key = kind_of(hold.reason)
            first.setdefault(key, hold.reason)
            count[key] += 1
            total[key] += hold.end_s - hold.start_s
        return [(first[key], count[key], time) for key, time in total.most_common(most)]

    def summary(self) -> dict:
        """Return the figures that do not depend on the clock, as plain data."""
        held = float(np.sum(self.status == STATUS.index("holding"))) / self.rate_hz
        return {
            "motion": self.motion,
            "seed": self.seed,
            "rate_hz": self.rate_hz,
            "duration_s": self.duration_s,
            "frames": self.frames,
            "trips": self.trips,
            "contacts": self.contacts,
            "standing_contacts": self.standing_contacts,
            "contact_frames": int(np.sum(self.moving & (self.separation <= 0.0))),
            "closest": self._moment(self.closest()),
            "closest_while_moving": self._moment(self.closest(while_moving=True)),
            "path_changes": self.path_changes,
            "held_s": held,
            "backing_off_s": self._retreat_s("backing off"),
            "escaping_s": self._retreat_s("escaping"),
            "hold_reasons": self.hold_reasons(most=10),
            "trajectory_sha256": self.fingerprint(),
            **({"pushed": self.pushed} if self.pushed else {}),
            **({} if self.slowed_s is None else {"slowed_s": self.slowed_s}),
        }

    def timing(self) -> dict:
        """Return the figures of the clock, as plain data [s]."""
        clocks = {"wall": self.wall_s, "cpu": self.cpu_s, "improve": self.improve_s}
        clocks |= self.stages
        return {
            "period_s": 1.0 / self.rate_hz,
            "latency_s": {name: percentiles(a) for name, a in clocks.items()},
            "missed_by_wall": self._late("wall"),
            "missed_by_cpu": self._late("cpu"),
        }

    def to_json(self, timing: bool = True) -> str:
        """Return summary, holds and, unless `timing` is off, the clock's figures.

        Without the timing the same input gives the same bytes.
        """
        data = {**self.summary(), "holds": [asdict(hold) for hold in self.holds]}
        if timing:
            data["timing"] = self.timing()
        return json.dumps(data, indent=1, allow_nan=False)

    def fingerprint(self) -> str:
        """Return a SHA-256 over motion, robot and status of every frame."""
        digest = hashlib.sha256()
        for array in (self.q, self.capsules, self.separation, self.status, self.place):
            digest.update(str(array.shape).encode() + array.tobytes())
        return digest.hexdigest()

    def _retreat_s(self, name: str) -> float:
        return float(np.sum(self.retreat == RETREATS.index(name))) / self.rate_hz

    def _moment(self, frame: int | None) -> dict | None:
        if frame is None:
            return None
        return {
            "time_s": frame / self.rate_hz,
            "separation_m": float(self.separation[frame]),
            "joint_speed": float(self.joint_speed[frame]),
            "point_speed_m_s": float(self.point_speed[frame]),
            "status": STATUS[self.status[frame]],
        }

    def _busy(self, clock: str) -> np.ndarray:
        if clock == "cpu":
            return self.cpu_s + self.improve_cpu_s
        return self.wall_s + self.improve_s

    def _late(self, clock: str) -> list[dict]:
        times, frames = self._busy(clock), self.misses(clock)
        return [{"frame": int(i), "step_s": float(times[i])} for i in frames]


def stretches(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return (first, one past the last) frame of each run of True in mask (F,)."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def touches(separation: np.ndarray, moving: np.ndarray) -> int:
    """Count the touches (separation (F,) <= 0) with a frame in which `moving` (F,)."""
    return sum(bool(moving[a:b].any()) for a, b in stretches(separation <= 0.0))


def holds_of(
    status: np.ndarray,
    joint_speed: np.ndarray,
    reason: Callable[[int], str],
    rate_hz: float,
) -> tuple[Hold, ...]:
    """Return the stretches of frames without a path.

    `status` (F,) is an index into `STATUS`, `joint_speed` (F,) the fastest joint on the
    way to each frame [rad/s or m/s], `reason` gives the planner's sentence of a frame.
    """
    held = np.asarray(status) == STATUS.index("holding")
    moved = np.r_[np.asarray(joint_speed)[1:] > 0, False]
    return tuple(
        Hold(
            start_s=float(a / rate_hz),
            end_s=float(b / rate_hz),
            reason=reason(a),
            retreating=bool(moved[a:b].any()),
        )
        for a, b in stretches(held)
    )


def new_paths(status: np.ndarray, place: np.ndarray) -> int:
    """Count new paths; the first one to a new work place is none."""
    new_place = np.r_[True, place[1:] != place[:-1]]
    return int(np.sum((status == STATUS.index("replanned")) & ~new_place))


def percentiles(values: np.ndarray) -> dict[str, float]:
    """Return p50, p99 and max of `values` by name; zeros if there are none."""
    if not len(values):
        return {"p50": 0.0, "p99": 0.0, "max": 0.0}
    p50, p99 = np.percentile(values, [50, 99])
    return {"p50": float(p50), "p99": float(p99), "max": float(np.max(values))}


def kind_of(reason: str) -> str:
    """Return a reason without numbers and names, so that like ones group."""
    text = re.sub(r" \([^()]* of the other robot\)", "", reason)
    # too near is too near: inside of a cover or just outside
    inside = r"inside (the cover of .*?), not (\S+ cm) outside"
    text = re.sub(inside, r"from \1, closer than \2", text)
    return re.sub(r"\S*[\d_]\S*", "#", text)
