"""What a user reads of a recording and of its replay."""

from pathlib import Path

from sim.record.compare import Difference
from sim.record.run_record import RunRecord


def show_holds(record: RunRecord) -> None:
    """Print every hold and every slow stretch of a recording, with its reason."""
    result, rows = record.result(), _rows(record)
    told = record.head["map"]
    print(
        f"{result.motion}: {result.duration_s:.2f} s on map {told['name']} "
        f"{told['hash'][:12]}, {len(record.holds)} holds, {len(record.slow)} times "
        "slowed or braked"
    )
    for start, end, what, reason in rows:
        print(f"{start:9.3f} s to {end:9.3f} s  {what:<10}  {reason}")


def _rows(record: RunRecord) -> list[tuple[float, float, str, str]]:
    rows = []
    for hold in record.holds:
        what = "retreating" if hold["retreating"] else "holding"
        rows.append((hold["start_s"], hold["end_s"], what, hold["reason"]))
        for time, reason in hold["later"]:
            rows.append((time, hold["end_s"], "  later", reason))
    for slow in record.slow:
        rows.append((slow["start_s"], slow["end_s"], slow["pace"], slow["reason"]))
    return sorted(rows, key=lambda row: row[0])


def show_same(record: RunRecord) -> None:
    """Print that a replay is the run, and what the run was."""
    result = record.result()
    print(
        f"same: {result.frames:,} frames of {result.motion}, {result.trips} trips, "
        f"{result.contacts} contacts, {len(result.holds)} holds"
    )
    print(f"trajectory_sha256 {result.fingerprint()}")


def what_differs(
    was: RunRecord, now: RunRecord, difference: Difference, path: Path
) -> str:
    """Return one sentence: how a replay differs from its recording, and why perhaps."""
    told = f"the replay of {path} is not the same run: {difference.sentence}"
    if was.altered:
        told += f"; the file was altered after the run: {', '.join(was.altered)}"
    old, new = was.head["versions"], now.head["versions"]
    other = [
        f"{name} {old.get(name, 'none')}, not {new.get(name, 'none')}"
        for name in sorted(old.keys() | new.keys())
        if old.get(name) != new.get(name)
    ]
    return told + (f"; it was recorded with {'; '.join(other)}" if other else "")
