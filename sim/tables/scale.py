"""What more nodes and smaller cells bought on the Panda, and a choice from that.

The figures are the output of `odm bench scale --nodes ... --cells ... --json
sim/tables/scale.json`: success beside a crossing arm and in clutter, length and time of
first answers. They say how *much* a size helps; what it costs is probed on the user's
own robot.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

NEAR = 1.0  # [%] of success: less of a difference is none
SLOWER = 1.25  # times the time until a scene has a path: less of a difference is none
_BUILD = 3.0  # times the memory that a map takes is taken by its build
_SHARE = 0.5  # of the free memory that a build may take


@dataclass(frozen=True)
class Gain:
    """What a size did on the Panda."""

    # frames and scenes with a path [%]
    crossing: float
    clutter: float
    clutter_p95_ms: float  # CPU time until a scene has a path [ms]


@cache
def _measured() -> list[dict]:
    file = Path(__file__).with_suffix(".json")
    return json.loads(file.read_text(encoding="utf-8"))["sizes"]


def gain_of(nodes: int, h: float) -> Gain:
    """Return the figures of the measured size that is nearest, by ratios."""

    def far(size: dict) -> float:
        return abs(math.log(size["nodes"] / nodes)) + 6 * abs(math.log(size["h"] / h))

    best = min(_measured(), key=far)
    return Gain(best["crossing"], best["clutter"], best["clutter_p95_ms"])


def choice(rows: Sequence, memory: int) -> object | None:
    """Return the smallest map that does as well and as soon as the best that fits.

    Args:
        rows: Sizes and their costs, as `sim.cli.suggest.Suggestion` has them.
        memory: Free [bytes]; a build may take half of it.
    """
    fit = [row for row in rows if _BUILD * row.memory_bytes <= _SHARE * memory]
    if not fit:
        return None
    gains = [(row, gain_of(row.nodes, row.h)) for row in fit]
    best = max(gain.crossing + gain.clutter for _, gain in gains)
    good = [(r, g) for r, g in gains if g.crossing + g.clutter >= best - NEAR]
    quickest = min(gain.clutter_p95_ms for _, gain in good)
    soon = [row for row, gain in good if gain.clutter_p95_ms <= SLOWER * quickest]
    return min(soon, key=lambda row: row.map_bytes)
