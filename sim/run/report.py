"""Tables of a run for the terminal: latency, safety, holds, and the machine."""

import platform

from rich.console import Console, Group
from rich.markup import escape

from sim.loop.run_result import RunResult, percentiles
from sim.tables.fitted import Fitted, table_of
from sim.tables.header import processor
from sim.tables.versions import version

PACKAGES = ("numpy", "numba", "python-fcl", "pybullet")
_PLAIN = {"box": None, "padding": (0, 2, 0, 0), "pad_edge": False}


def print_report(
    result: RunResult,
    alone: RunResult | None = None,
    map_hash: str = "",
    console: Console | None = None,
) -> None:
    """Print all tables; `alone` is a run without a person, to compare trips."""
    shown: list = [safety_table(result, alone)]
    if result.holds:
        shown.append(hold_table(result))
    if result.frames and result.separation[0] <= 0:
        shown.append(begun_inside(result))
    shown.append(latency_table(result))
    spaced = [part for each in shown for part in (each, "")]
    (console or Console()).print(Group(*spaced, setting_line(map_hash)))


def safety_table(result: RunResult, alone: RunResult | None) -> Fitted:
    """Return contacts, separation, trips and path changes."""
    columns = {result.motion: _safety_column(result, alone)}
    if alone is not None:
        columns["nobody"] = _safety_column(alone, None)
    names = columns[result.motion]
    rows = [(name, *(column[name] for column in columns.values())) for name in names]
    title = "Safety, by the exact audit of every frame"
    return table_of(title, ("", *map(escape, columns)), rows, **_PLAIN)


def hold_table(result: RunResult) -> Fitted:
    """Return the reasons of the longest holds."""
    heads = ("motion", "times", "seconds", "reason, the first of its kind")
    rows = [
        (escape(result.motion), str(count), f"{seconds:.1f}", escape(reason))
        for reason, count, seconds in result.hold_reasons()
    ]
    return table_of("Why the robot held", heads, rows, left=(0, 3), **_PLAIN)


def begun_inside(result: RunResult) -> str:
    """Say that robot and person began within each other: a run of no worth."""
    return (
        f"Person and robot begin {abs(100 * result.separation[0]):.1f} cm inside each "
        f"other, so {result.motion} shows little of this robot; a recorded person can "
        "stand elsewhere (--motion mocap --stand)"
    )


def latency_table(result: RunResult) -> Fitted:
    """Return p50, p99 and max of every stage, and the missed deadlines."""
    period = 1.0 / result.rate_hz
    heads = ("stage", *(f"{share} \\[µs]" for share in ("p50", "p99", "max")))
    rows = []
    whole = {
        "step, wall clock": result.wall_s,
        "step, CPU": result.cpu_s,
        "improving afterwards": result.improve_s,
    }
    for name, seconds in {**result.stages, **whole}.items():
        shown = percentiles(1e6 * seconds)
        cells = [f"{shown[key]:,.1f}" for key in ("p50", "p99", "max")]
        rows.append((name, *cells, str(int((seconds > period).sum()))))
    frames = f"{result.frames:,} frame{'s' if result.frames != 1 else ''}"
    title = f"Latency of {frames}, motion {result.motion}"
    return table_of(title, (*heads, f"over {1000 * period:.0f} ms"), rows, **_PLAIN)


def setting_line(map_hash: str = "") -> str:
    """Return processor, Python, package versions and map hash in one line."""
    cpu, python, *versions = setting().values()
    named = [f"{name} {v}" for name, v in zip(PACKAGES, versions, strict=True)]
    parts = [cpu, f"Python {python}", *named]
    if map_hash:
        parts.append(f"map {map_hash[:12]}")
    return " · ".join(parts)


def setting() -> dict[str, str]:
    """Return processor and versions by name, for a JSON report."""
    versions = {name: version(name) or "absent" for name in PACKAGES}
    return {"cpu": processor(), "python": platform.python_version(), **versions}


def _safety_column(result: RunResult, alone: RunResult | None) -> dict[str, str]:
    nearest, moving = result.closest(), result.closest(while_moving=True)
    held = result.summary()["held_s"] / result.duration_s
    minutes = result.duration_s / 60
    return {
        "simulated": f"{result.duration_s:g} s",
        "contacts while moving": str(result.contacts),
        "  the person came to it standing": str(result.standing_contacts),
        "smallest separation": _cm(result, nearest),
        "  speed at it": _speed(result, nearest),
        "smallest while moving": _cm(result, moving),
        "  speed at it ": _speed(result, moving),
        "trips": str(result.trips),
        "  of those with nobody": _share(result, alone),
        "path changes per minute": f"{result.path_changes / minutes:.1f}",
        "holding": f"{100 * held:.0f} %",
        "slowed or braked on its way": _slowed(result),
    }


def _slowed(result: RunResult) -> str:
    """Return the share of the time in which the person slowed it, where it brakes."""
    if result.slowed_s is None:
        return "-"
    return f"{100 * result.slowed_s / result.duration_s:.0f} %"


def _share(result: RunResult, alone: RunResult | None) -> str:
    """Return the trips per minute as a share of those without a person."""
    if alone is None or not alone.trips:
        return "-"
    share = result.trips / result.duration_s * alone.duration_s / alone.trips
    return f"{100 * share:.0f} %"


def _cm(result: RunResult, frame: int | None) -> str:
    return "-" if frame is None else f"{100 * result.separation[frame]:.1f} cm"


def _speed(result: RunResult, frame: int | None) -> str:
    return "-" if frame is None else f"{result.point_speed[frame]:.2f} m/s"
