"""Times of a bench: by wall clock and by the thread's own CPU time."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

SHARES = {"p50": 50, "p90": 90, "p95": 95, "p99": 99, "max": 100}


class Clock:
    """Times calls, one by one.

    The CPU time of the thread leaves out what other processes took; it is the second
    figure of every row, since a bench seldom has a machine to itself.
    """

    def __init__(self) -> None:
        """Start with no calls."""
        self.wall: list[int] = []
        self.cpu: list[int] = []

    def __call__(self, function: Callable, *args: Any, **options: Any) -> Any:  # noqa: ANN401
        """Call and time `function`; return what it returns."""
        busy = time.thread_time_ns()
        begun = time.perf_counter_ns()
        result = function(*args, **options)
        ended = time.perf_counter_ns()
        self.cpu.append(time.thread_time_ns() - busy)
        self.wall.append(ended - begun)
        return result

    def row(
        self, name: str, note: str = "", keep: np.ndarray | None = None, **asked: float
    ) -> dict:
        """Return a row of the calls in `keep` (all when None).

        Args:
            name: What was measured.
            note: How.
            keep: (n,) bool, calls that count.
            asked: Limits by share, in microseconds: p50=20, p99=150.
        """
        wall, cpu = (1e-3 * np.array(t, float) for t in (self.wall, self.cpu))
        if keep is not None:
            wall, cpu = wall[keep], cpu[keep]
        return time_row(name, note, wall, cpu, **asked)


def time_row(
    name: str, note: str, wall: np.ndarray, cpu: np.ndarray | None, **asked: float
) -> dict:
    """Return a row of times [us]; `cpu` None where it cannot be told."""
    row = {"name": name, "note": note, "unit": "us", "n": len(wall), "asked": asked}
    row["wall"] = _shares(wall)
    row["cpu"] = None if cpu is None else _shares(cpu)
    row["met"] = _met(row["wall"], asked)
    row["met_cpu"] = None if cpu is None else _met(row["cpu"], asked)
    return row


def _shares(times: np.ndarray) -> dict[str, float] | None:
    if len(times) == 0:
        return None
    return {k: round(float(np.percentile(times, p)), 2) for k, p in SHARES.items()}


def _met(shares: dict[str, float] | None, asked: dict[str, float]) -> bool | None:
    if shares is None or not asked:
        return None
    return all(shares[k] <= limit for k, limit in asked.items())
