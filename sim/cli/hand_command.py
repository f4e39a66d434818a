"""`odm workspace human`: dexterity and effort over the places of a hand."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sim.terminal.checks import HEIGHT, PICTURE, ROTATIONS, Limits
from sim.terminal.flags import Json, Posture, Side, flag, from_request, optional
from sim.terminal.output import report
from sim.terminal.progress import Bars

if TYPE_CHECKING:
    from sim.draw.arm_cut import Cut

BELOW_SHOULDER = 0.25  # [m] the level cut lies this far below it


@dataclass(frozen=True)
class HandRequest:
    """What `odm workspace human` is asked for."""

    height: float = flag(1.75, "Body height in m, 1.2 to 2.2.", limits=HEIGHT)
    posture: Posture = "standing"
    side: Side = "right"
    spacing: float = flag(
        0.02,
        "Distance between the places, m.",
        limits=Limits(0.005, 0.2, "m", hint="2 cm are 0.02"),
    )
    rotations: int = flag(
        1944,
        "Rotations of the hand tried at each place: 72, 576, 1944...",
        limits=ROTATIONS,
    )
    plot: Path | None = optional("Draw the cuts.", writes=PICTURE)
    json: Json = None


@from_request(HandRequest)
def human_reach(request: HandRequest) -> None:
    """Show dexterity and effort over the places of a hand, in two planes.

    An upright plane through the shoulder and a level one 25 cm below it (above it for
    a person who lies). No map is needed.

    odm workspace human --side left --plot dexterity.png
    """
    from handover import Human
    from sim.draw.arm_cut import arm_cut

    human, side = Human(request.height, request.posture), request.side
    spacing, rotations = request.spacing, request.rotations
    shoulder = human.T_world_shoulder(side)[:3, 3]
    low = shoulder[2] - BELOW_SHOULDER
    level = low if low > 0.1 else shoulder[2] + BELOW_SHOULDER
    with Bars() as tell:
        cuts = [
            arm_cut(human, side, normal, at, spacing, rotations=rotations, tell=tell)
            for normal, at in ((1, shoulder[1]), (2, level))
        ]
    facts = _arm_facts(request, cuts)
    if request.plot is not None:
        from sim.draw.arm_cut import write_arm_picture

        facts["plot"] = str(write_arm_picture(human, side, cuts, request.plot))
    report(facts, request.json, _show_arm)


def _arm_facts(request: HandRequest, cuts: list["Cut"]) -> dict:
    """Return what `odm workspace human` says, as plain JSON data."""
    import numpy as np

    from sim.draw.arm_cut import FIELDS
    from sim.draw.style import AXES

    planes = []
    for cut in cuts:
        reached = np.isfinite(cut.fields["combined"])
        row = {
            "plane": AXES[cut.normal],
            "at_m": round(cut.at, 4),
            "places": int(reached.sum()),
            "area_m2": round(float(reached.sum()) * request.spacing**2, 4),
        }
        for name in FIELDS:
            value, place = cut.best(name)
            row[name] = {"best": round(value, 4), "place_m": place.round(4).tolist()}
        planes.append(row)
    return {
        "height_m": request.height,
        "posture": request.posture,
        "side": request.side,
        "spacing_m": request.spacing,
        "rotations": request.rotations,
        "planes": planes,
    }


def _show_arm(facts: dict) -> None:
    from rich.console import Console

    from sim.tables.fitted import table_of

    title = f"The {facts['side']} hand of a person of {facts['height_m']:.2f} m, "
    heads = ("plane", "reached", "most dextrous", "easiest", "best of both")
    rows = []
    for row in facts["planes"]:
        best = [row[name] for name in ("dexterity", "effort", "combined")]
        at = f"{row['plane']} = {row['at_m']:.2f} m"
        area = f"{row['area_m2']:.2f} m\N{SUPERSCRIPT TWO}"
        told = (f"{b['best']:.2f} at {place_text(b['place_m'])}" for b in best)
        rows.append((at, area, *told))
    console = Console(highlight=False)
    console.print(table_of(title + facts["posture"], heads, rows))
    if "plot" in facts:
        console.print(f"plot: {facts['plot']}", soft_wrap=True)


def place_text(place: list[float]) -> str:
    """Return a place as people write it."""
    return "(" + ", ".join(f"{x:.2f}" for x in place) + ")"
