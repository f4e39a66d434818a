"""The targets of a person as rows of numbers, to be drawn or recorded."""

import numpy as np

from handover.targets.live_targets import LiveTargets

TARGETS_EVERY = 10  # frames: they change no faster
_TARGETS = 10  # that are drawn


def target_rows(live: LiveTargets) -> np.ndarray:
    """Return (k, 5) of the best targets: place [m], quality, whether it is pursued."""
    key = live.pursuit.key
    best = live.targets[:_TARGETS]
    rows = [[*t.T_world_tool[:3, 3], t.quality, t.key == key] for t in best]
    return np.array(rows, float).reshape(-1, 5)
