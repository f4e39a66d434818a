"""What a recording of a run holds."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from odm.execution.executor import BRAKED, RETREATING, SLOWED
from sim.loop.run_result import STATUS, Hold, RunResult

# formats: of a recording, of one with a payload, of one with a scene, of a hand-over,
# of a run to hand-over targets
FORMAT, CARRYING, STANDING_AROUND, STORY, TARGETS = 2, 3, 4, 5, 6
NOBODY = "none"  # name of the motion of a run without a person
INPUTS = ("time_s", "places", "payload", "capsules", "capsules_at", "guess", "guess_at")
OUTCOME = {  # by frame, in the order in which differences are told
    "status": np.uint8,
    "place": np.int32,
    "pace": np.uint8,
    "escape": np.uint8,
    "q": np.float64,
    "dq": np.float64,
    "ddq": np.float64,
    "separation": np.float64,
    "joint_speed": np.float64,
    "point_speed": np.float64,
}
TARGET_OUTCOME = {  # the same, of a run to hand-over targets
    "targets.state": np.uint8,
    "targets.quality": np.float64,
    "targets.best": np.float64,
}


@dataclass(frozen=True, eq=False)
class RunRecord:
    """One run: all inputs and results, but no measured times.

    Attributes:
        head: Plain data: "kind", "format", "frames", "motion", "settings", "planner",
            "map" (name, hash, recipe), "robot", "versions", "outcome" (fingerprint,
            trips, path changes, holds and slow stretches with their reasons); "scene"
            where things stood around, see `sim.record.standing`; "story" of a
            hand-over, "targets" of a run to its targets.
        arrays: By name, with F frames. "time_s" (F,) [s]; "places" (n, dof);
            "capsules" (F, k, 7) as the planner saw the person [m], or (sum, 7) with
            offsets "capsules_at" (F + 1,) where k changes; "guess", the same of
            where the person is, for motions that tell the two apart; "payload" (k, 4)
            spheres in the robot's hand, tool frame [m]; the names of `OUTCOME`; the
            robot's own, "robot.*"; of a run to targets, the names of `TARGET_OUTCOME`,
            the whole person, "person.*", and the best targets of every few frames.
        altered: Names of arrays of the outcome that are not as they were written.
    """

    head: dict[str, Any]
    arrays: dict[str, np.ndarray]
    altered: tuple[str, ...] = ()

    @property
    def frames(self) -> int:
        """Number of frames."""
        return self.head["frames"]

    @property
    def rate_hz(self) -> float:
        """Frames per second."""
        return self.head["settings"]["rate_hz"]

    @property
    def scene(self) -> list[dict]:
        """What stood around, see `sim.record.standing`; empty: nothing."""
        return self.head.get("scene", [])

    @property
    def holds(self) -> list[dict]:
        """All holds: "start_s", "end_s", "reason", "retreating", "later"."""
        return self.head["outcome"]["holds"]

    @property
    def slow(self) -> list[dict]:
        """Stretches in which it was slowed or braked: "start_s", "end_s", ..."""
        return self.head["outcome"]["slow"]

    def person(self, name: str, i: int) -> np.ndarray:
        """Return the (k, 7) "capsules" or "guess" of frame i [m]."""
        offsets = self.arrays.get(f"{name}_at")
        rows = self.arrays[name]
        return rows[i] if offsets is None else rows[offsets[i] : offsets[i + 1]]

    def result(self) -> RunResult:
        """Return the run's result; its clock's figures are all 0."""
        outcome, n = self.head["outcome"], self.frames
        known = ("start_s", "end_s", "reason", "retreating")
        columns = ("q", "separation", "joint_speed", "point_speed", "status", "place")
        return RunResult(
            motion=self.head["motion"]["name"],
            seed=self.head["settings"]["seed"],
            rate_hz=self.rate_hz,
            trips=outcome["trips"],
            path_changes=outcome["path_changes"],
            holds=tuple(Hold(**{k: h[k] for k in known}) for h in self.holds),
            capsules=self._padded(),
            **{name: self.arrays[name] for name in columns},
            **dict.fromkeys(("wall_s", "cpu_s", "improve_s"), np.zeros(n)),
            stages={},
            retreat=self._retreat(),
            slowed_s=self._slowed(),
        )

    def _slowed(self) -> float | None:
        """Return how long a person slowed it on its way; see `RunResult.slowed_s`."""
        if self.head["settings"].get("execution") != "timed":
            return None
        names = self.head["pace_names"]
        codes = [k for k, name in enumerate(names) if name in (SLOWED, BRAKED)]
        led = self.arrays["status"] != STATUS.index("holding")
        frames = int((np.isin(self.arrays["pace"], codes) & led).sum())
        return frames / self.rate_hz

    def _retreat(self) -> np.ndarray:
        """Return (F,) 1 where the robot backed off, 2 where it escaped."""
        names = self.head["pace_names"]
        code = names.index(RETREATING) if RETREATING in names else -1
        backs = self.arrays["pace"].astype(int) == code
        return backs * (1 + (self.arrays["escape"] > 0))

    def _padded(self) -> np.ndarray:
        """Return the capsules (F, k, 7), NaN where a frame has fewer than others."""
        offsets = self.arrays.get("capsules_at")
        if offsets is None:
            return self.arrays["capsules"]
        whole = np.full((self.frames, int(np.diff(offsets).max()), 7), np.nan)
        for i in range(self.frames):
            rows = self.person("capsules", i)
            whole[i, : len(rows)] = rows
        return whole
