"""Results of a run to hand-over targets: figures and their table."""

from collections import Counter

import numpy as np

from handover.targets.live_targets import BLOCKED, NOBODY
from sim.loop.run_result import RunResult, percentiles
from sim.run.meet_loop import MeetLoop
from sim.tables.fitted import table_of


def target_figures(loop: MeetLoop, result: RunResult) -> dict:
    """Return what became of the targets, as plain data."""
    pursuits, n = loop.pursuits, max(1, len(loop.pursuits))
    states = Counter(p.state for p in pursuits)
    kinds = Counter(p.kind for p in pursuits if p.key is not None)
    minutes = n / loop.settings.rate_hz / 60.0
    busy = result.wall_s, result.cpu_s
    counts = loop.live.counts
    touched = sum(p.touched and p.state == BLOCKED for p in pursuits)
    missing = min((p.missing_m for p in pursuits if p.state == NOBODY), default=0.0)
    lost = [p.best - p.quality for p in pursuits if p.key is not None]
    return {
        "share_of_time": {k: round(v / n, 4) for k, v in sorted(states.items())},
        "blocked_within_clearance": round(touched / n, 4),
        "goals_by_kind": {k: round(v / n, 4) for k, v in sorted(kinds.items())},
        "target_changes_per_minute": round(counts["changes"] / minutes, 2),
        "set_goals_per_minute": round(counts["set_goals"] / minutes, 2),
        "attached_per_minute": round(counts["attached"] / minutes, 2),
        "arrivals": result.trips,
        "dwell_s": loop.dwell_s,
        "handovers": loop.handovers,
        "removed_targets": len(loop.live.finder.failed),
        "quality_below_best": percentiles(np.array(lost)),
        "loop_wall_s": percentiles(busy[0]),
        "loop_cpu_s": percentiles(busy[1]),
        "contacts": result.contacts,
        "missing_m": round(float(missing), 4) if np.isfinite(missing) else None,
    }


def print_targets(told: dict) -> None:
    """Print what became of the targets."""
    margin = told["margin"]
    from rich.console import Console

    rows: list[tuple[str, str]] = []
    for state, share in told["share_of_time"].items():
        rows.append((f"time: {state}", _percent(share)))
        if state == BLOCKED:
            close = _percent(told["blocked_within_clearance"])
            rows.append(("  of it, with the person within the clearance", close))
    if told["missing_m"]:
        near = f"{100 * told['missing_m']:.0f} cm"
        rows.append(("  of no target: the person would have to come nearer by", near))
    audit = told["audit"]
    if audit["judged"]:
        rows.append(("frames audited", str(audit["judged"])))
        rows.append(("  no target can be reached", str(audit["out_of_reach"])))
        rows.append(("  of the others, at or on the way to", ""))
        rows.append(("    the top-ranked reachable target", _percent(audit["top"])))
        near = _percent(audit["within_margin"])
        rows.append((f"    it or one within {margin:g} of its quality", near))
        rows.append(("    a worse one", _percent(audit["worse"])))
        rows.append(("    none", _percent(audit["none"])))
    rows.append(("target changes per minute", f"{told['target_changes_per_minute']:g}"))
    rows.append(("goals set per minute", f"{told['set_goals_per_minute']:g}"))
    rows.append(("arrivals at a target", str(told["arrivals"])))
    if told["dwell_s"] is not None:
        name = f"  stayed for {told['dwell_s']:g} s, and went back"
        rows.append((name, str(told["handovers"])))
    for name in ("wall", "cpu"):
        ms = {k: 1e3 * v for k, v in told[f"loop_{name}_s"].items()}
        values = " / ".join(f"{ms[k]:.2f}" for k in ("p50", "p99", "max"))
        rows.append((f"loop with targets, {name}: p50 / p99 / max", f"{values} ms"))
    title = "Targets of the interaction workspace"
    Console().print(table_of(title, ("what", "measured"), rows))


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"
