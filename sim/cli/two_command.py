"""`odm run-two`: two robots in one space, each in the way of the other."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sim.terminal.checks import FILM, PICTURE, PICTURES, PLACE, RATE, SECONDS, TURN
from sim.terminal.flags import Json, flag, from_request, optional
from sim.terminal.output import report, show_json
from sim.terminal.progress import Bars

if TYPE_CHECKING:
    from odm import CellMap
    from roadmap.builds.chunks import Progress
    from sim.two.two_result import TwoResult

ALONE_S = 20.0  # simulated, to see how many trips a robot makes alone
FAR = 15.0  # no robot of ours reaches so far, and points may be there [m]
# bases face each other at this share of the first one's reach, so that they share
# what lies in front of both
APART, ASIDE = 1.36, 0.10  # share, and [m] added


@dataclass(frozen=True)
class TwoRequest:
    """What `odm run-two` is asked for."""

    map_dir: Path = flag(..., "Map of the first robot.", "--map", metavar="MAP")
    other_map: Path | None = optional(
        "Map of the second; default: the same.", metavar="MAP"
    )
    base: tuple[float, float, float] | None = optional(
        "Base of the second in the first one's base frame: m, m, degrees; "
        "default: they face each other and share what lies between.",
        metavar="X Y YAW",
        limits=(PLACE, PLACE, TURN),
    )
    other: str = flag(
        "planned",
        "The second: plans and brakes, too; or goes to and fro blindly.",
        metavar="planned|scripted",
    )
    seconds: float = flag(120.0, "Simulated time in s.", limits=SECONDS)
    rate: float = flag(100.0, "Frames per second (Hz).", limits=RATE)
    plot: Path | None = optional("Draw the closest moment.", writes=PICTURE)
    animation: Path | None = optional("Write a short film.", writes=FILM)
    out: Path | None = optional("Write both and the figures.", writes=PICTURES)
    json: Json = None


@from_request(TwoRequest)
def run_two(request: TwoRequest) -> None:
    """Run two robots in one space, each the moving obstacle of the other.

    Exit code 1: the exact audit of every frame found a contact of a robot that plans.
    """
    from odm import load_map
    from sim.two.two_members import TwoSettings
    from sim.two.two_robots import run_two as run

    settings = TwoSettings(
        rate_hz=request.rate, duration_s=request.seconds, other=request.other
    )
    first = load_map(request.map_dir)
    maps = (first, first if request.other_map is None else load_map(request.other_map))
    T_world_base = base_pose(first, request.base)
    with Bars() as tell:
        result = run(
            maps, T_world_base, settings,
            lambda done, total: done % 20 or tell("frames", done, total),
        )  # fmt: skip
        alone = _alone(maps, settings)
        tell("frames", result.frames, result.frames)
    figures = result.summary() | {"alone_trips_per_minute": alone}
    figures |= {"map_hashes": [m.hash for m in maps]}
    with Bars("pictures") as tell:
        written = _write(result, maps, figures, request, tell)
    report(figures, request.json, lambda _: show(figures, maps, written))
    if result.contacts:
        raise typer.Exit(1)


def base_pose(cell_map: "CellMap", base: tuple[float, float, float] | None) -> "object":
    """Return T_world_base (4, 4) of the second robot, `base` or face to face."""
    import numpy as np

    from roadmap.errors import BadInput
    from roadmap.transforms import pose_of
    from sim.loop.work_places import reach_of

    if base is None:
        apart = APART * reach_of(cell_map.robot, cell_map.roadmap.nodes) + ASIDE
        base = (round(apart, 2), 0.0, 180.0)
    if not np.isfinite(base).all():
        raise BadInput(f"--base is {base}; give two lengths in m and degrees")
    x, y, yaw = base
    return pose_of((x, y, 0.0), (0.0, 0.0, math.radians(yaw)))


def _alone(maps: tuple, settings: object) -> list[float]:
    """Return trips a minute of each robot with the other one out of reach."""
    from dataclasses import replace

    from roadmap.transforms import pose_of
    from sim.two.two_robots import run_two as run

    brief = min(ALONE_S, settings.duration_s)
    apart = pose_of((FAR, 0.0, 0.0), (0.0, 0.0, 0.0))
    result = run(maps, apart, replace(settings, duration_s=brief))
    return result.summary()["trips_per_minute"]


def _write(
    result: "TwoResult",
    maps: tuple,
    figures: dict,
    request: TwoRequest,
    tell: "Progress",
) -> list[Path]:
    """Write what was asked for; return the paths."""
    picture, animation, out = request.plot, request.animation, request.out
    written = []
    if out is not None:
        picture = picture or out / "two_robots.png"
        animation = animation or out / "two_robots.gif"
    if picture is not None:
        from sim.two.two_picture import write_two_picture

        written.append(write_two_picture(result, maps, picture))
    if animation is not None:
        from sim.two.two_picture import write_two_animation

        written.append(write_two_animation(result, maps, animation, tell))
    if out is not None:
        show_json(figures, str(out / "two_robots.json"))
        written.append(out / "two_robots.json")
    return written


def show(figures: dict, maps: tuple, written: list[Path]) -> None:
    """Print the figures as tables, and which files were written."""
    from rich.console import Console

    from sim.run.report import setting_line
    from sim.tables.fitted import table_of

    second = "second" if figures["other"] == "planned" else "second, scripted"
    near = figures["separation_m"]
    x, y = figures["base_m"][:2]
    rows = [
        ("robot", *(m.robot.name for m in maps)),
        ("contacts while a planned robot moves", str(figures["contacts"]), ""),
        (
            "smallest distance, and when",
            f"{100 * near['least']:.1f} cm",
            f"{near['at_s']:.1f} s",
        ),
        ("median distance", f"{100 * near['p50']:.1f} cm", ""),
        ("trips", *map(str, figures["trips"])),
        *(_row(n, figures[k], unit) for n, k, unit in _SHOWN),
        ("both moving", f"{figures['both_moving_s']:.1f} s", ""),
        ("base of the second", f"{x:.2f}, {y:.2f} m", ""),
        *_times(figures["latency_us"]),
    ]
    console = Console()
    title = "Two robots, by the exact audit of every frame"
    console.print(table_of(title, ("", "first", second), rows))
    for k, reasons in enumerate(figures["hold_reasons"]):
        for reason, frames in reasons:
            seconds = frames / figures["rate_hz"]
            console.print(f"held {seconds:.1f} s, robot {k + 1}: {reason}")
    console.print(setting_line(figures["map_hashes"][0]), highlight=False)
    for path in written:
        print(path)


_SHOWN = (
    ("trips a minute", "trips_per_minute", ""),
    ("... with the other out of reach", "alone_trips_per_minute", ""),
    ("moving", "moving_s", "s"),
    ("holding", "held_s", "s"),
)


def _row(name: str, values: list[float], unit: str) -> tuple[str, ...]:
    return (name, *(f"{v:.1f} {unit}".strip() for v in values))


def _times(latency: list[dict]) -> list[tuple[str, ...]]:
    return [
        (f"planner's step, {share}", *(f"{t[share]:.0f} µs" for t in latency))
        for share in ("p50", "p99", "max")
    ]
