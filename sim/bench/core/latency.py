"""`odm bench latency`: every figure that concerns frames, in one run."""

from collections.abc import Callable
from pathlib import Path

from odm import load_map
from sim.bench.core import frame_rows, map_rows, walled
from sim.bench.core.frame_rows import BLOCKED_SHARE
from sim.bench.frames import (
    CONDITIONS,
    LENGTHS,
    RADII,
    RATE_HZ,
    SPACING,
    TOP_SPEED,
    Pair,
    make_pairs,
)
from sim.bench.rivals import baselines, lengths
from sim.bench.rivals.beside_vamp import beside_vamp
from sim.tables.header import header

FRAMES = 600, 600  # that the competitors are run on: by python-fcl, compiled


def run(
    map_dir: str | Path,
    *,
    pairs: int = 60,
    frames: int = 200,
    seed: int = 1,
    condition: str = "every",
    short: bool = False,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Measure all rows.

    Args:
        map_dir: Folder of a built map.
        pairs: Start and goal pairs.
        frames: Frames of each.
        seed: Same seed, same frames.
        condition: See `make_pairs`.
        short: Few of everything: to see that the bench runs, not to measure.
        tell: Called with the name of each part before it is measured.

    Returns:
        Plain data for JSON: "header", "setup", "rows" and "baselines".
    """
    map_dir, tell = Path(map_dir), tell or (lambda text: None)
    pairs, frames = (min(pairs, 3), min(frames, 12)) if short else (pairs, frames)
    cell_map = load_map(map_dir, verify=False)
    head, rows = header(cell_map), []
    tell("frames")
    drawn = make_pairs(cell_map, pairs, frames, seed, condition)
    across = _across(cell_map, pairs, frames, seed, condition, short)
    _warm(cell_map, drawn[:2], seed)
    some, again, few = (drawn[:2], 1, 1) if short else (drawn[:20], 3, 24)
    parts = {
        "replanned": lambda: frame_rows.replanned(cell_map, drawn),
        "blocked": lambda: frame_rows.blocked(cell_map, across),
        "kept": lambda: frame_rows.kept(cell_map, drawn),
        "following": lambda: frame_rows.followed(cell_map, drawn),
        "first steps": lambda: frame_rows.first_steps(cell_map, drawn),
        "goals": lambda: frame_rows.goal_setting(cell_map, drawn, seed),
        "walled in": lambda: walled.walled_in(cell_map, some, seed),
        "direct map": lambda: map_rows.direct_map(cell_map, some),
        "camera": lambda: map_rows.cameras(cell_map, drawn, some, seed),
        "storage": lambda: map_rows.storage(map_dir, cell_map),
        "lengths": lambda: lengths.compared(cell_map, drawn[:few]),
        "new process": lambda: map_rows.first_answer(map_dir, drawn[0], again),
        "beside VAMP": lambda: beside_vamp(cell_map, drawn, across),
    }
    for name, measure in parts.items():
        tell(name)
        rows += measure()
    tell("competitors")
    against = baselines.compare(cell_map, drawn, *((2, 6) if short else FRAMES))
    return {
        "bench": "latency",
        "header": head,
        "setup": _setup(drawn, pairs, frames, seed, condition),
        "rows": rows + against.pop("rows"),
        "baselines": against,
    }


def _across(cell_map, pairs, frames, seed, condition, short) -> list[Pair]:  # noqa: ANN001
    """Return other pairs, in most of whose frames the straight motion is blocked."""
    if short:
        pairs, frames = 1, 4
    return make_pairs(cell_map, pairs, frames, seed, condition, blocked=BLOCKED_SHARE)


def _warm(cell_map, drawn, seed) -> None:  # noqa: ANN001
    """Run every kernel once, so that no row pays for compiling."""
    frame_rows.replanned(cell_map, drawn[:1])
    frame_rows.kept(cell_map, drawn[:1])
    frame_rows.followed(cell_map, drawn[:1])
    map_rows.direct_map(cell_map, drawn[:1], keep_every=50)
    frame_rows.goal_setting(cell_map, drawn, seed)


def _setup(drawn, pairs, frames, seed, condition) -> dict:  # noqa: ANN001
    return {
        "pairs": pairs,
        "frames": pairs * frames,
        "rate_hz": RATE_HZ,
        "seed": seed,
        "arm": {"lengths_m": LENGTHS, "radii_m": RADII, "top_speed_m_s": TOP_SPEED},
        "points_per_frame": len(drawn[0].points()[0]),
        "covering_radius_m": SPACING,
        "start and goal": CONDITIONS[condition],
    }
