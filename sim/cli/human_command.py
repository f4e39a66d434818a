"""`odm human info`: proportions, joint ranges and reach of a person, a picture."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sim.people.grips import grip_points
from sim.terminal.checks import HEIGHT, PICTURE, Limits
from sim.terminal.flags import Json, Posture, flag, from_request, optional
from sim.terminal.output import report

if TYPE_CHECKING:
    from handover import Human


@dataclass(frozen=True)
class HumanRequest:
    """What `odm human info` is asked for."""

    height: float = flag(1.75, "Body height in m, 1.2 to 2.2.", limits=HEIGHT)
    posture: Posture = "standing"
    mass: float | None = optional(
        "Body mass in kg; default: a body mass index of 24.",
        limits=Limits(0.0, 400.0, "kg", above=True),
    )
    thickness: str = flag(
        "conservative",
        "Of the body: thick and clothed, or mean.",
        metavar="conservative|mean",
    )
    plot: Path | None = optional(
        "Draw the person, the reach and the joint ranges.", writes=PICTURE
    )
    json: Json = None


@from_request(HumanRequest)
def human_info(request: HumanRequest) -> None:
    """Tell what the model of a person is: segments, joint ranges, reach of the arms."""
    from handover import Human

    human = Human(
        request.height, request.posture, mass=request.mass, thickness=request.thickness
    )
    facts = human_facts(human)
    if request.plot is not None:
        from sim.draw.human_picture import write_human_picture

        facts["plot"] = str(write_human_picture(human, request.plot))
    report(facts, request.json, _show)


def human_facts(human: "Human") -> dict:
    """Return everything `odm human info` says, as plain JSON data."""
    import numpy as np

    from handover.human import anthropometry as body

    arm = human.arm("right")
    degrees = np.degrees
    now = degrees(human.arms["right"])
    shoulder = human.T_world_shoulder("right")[:3, 3]
    return {
        "height_m": human.height,
        "mass_kg": round(human.mass, 2),
        "posture": human.posture,
        "thickness": human.thickness,
        "segments": _segments(human),
        "joints": [
            {
                "joint": name,
                "lower_deg": round(float(low), 2),
                "upper_deg": round(float(high), 2),
                "now_deg": round(float(at), 2),
            }
            for name, (low, high), at in zip(
                body.ARM_JOINTS, degrees(arm.ranges), now, strict=True
            )
        ],
        "reach": {
            "arm_length_m": round(arm.length, 4),
            "to_finger_tips_m": round(
                float(arm.lengths[:2].sum() + human.skeleton.hands[1]), 4
            ),
            "shoulder_height_m": round(float(shoulder[2]), 4),
            "eye_height_m": round(float(human.p_world_eyes[2]), 4),
            **{f"grip_{k}_m": round(v, 3) for k, v in grip_reach(human).items()},
        },
        "capsules": len(human.labels),
    }


def grip_reach(human: "Human", samples: int = 200_000) -> dict[str, float]:
    """Return how far the right grip gets from the shoulder along six directions [m].

    By samples, half of whose joints are at the ends of their ranges: up to a few
    millimetres short. Directions are the chest's; the hand may turn as it likes.
    """
    points = grip_points(human, samples)
    low, high = points.min(axis=0), points.max(axis=0)
    return {
        "forward": float(high[0]),
        "backward": float(-low[0]),
        "outward": float(-low[1]),
        "across": float(high[1]),
        "up": float(high[2]),
        "down": float(-low[2]),
    }


def _segments(human: "Human") -> list[dict]:
    """Return name, length, mass and capsule radius of each segment."""
    from handover.human import anthropometry as body

    lengths, sizes = human.skeleton.arms[1], human.sizes
    thigh, shank, ankle, foot = human.skeleton.legs
    rows = [
        ("upper arm", lengths[0], "upper arm", sizes.upper_arm),
        ("forearm", lengths[1], "forearm", sizes.forearm),
        ("wrist to grip", lengths[2], None, None),
        ("hand", human.skeleton.hands[1], "hand", sizes.hand),
        ("hip to neck", human.height * body.TRUNK, None, sizes.torso),
        ("neck to crown", sizes.crown, None, sizes.head),
        ("thigh", thigh, None, sizes.thigh),
        ("shank", shank, None, sizes.shank),
        ("ankle to sole", ankle, None, None),
        ("foot", foot, None, sizes.foot),
    ]
    return [
        {
            "segment": name,
            "length_m": round(float(length), 4),
            "of_height": round(float(length) / human.height, 4),
            "mass_kg": mass and round(human.mass * body.SEGMENT_MASSES[mass], 3),
            "radius_m": radius,
        }
        for name, length, mass, radius in rows
    ]


def _show(facts: dict) -> None:
    from rich.console import Console

    from sim.tables.fitted import table_of

    console = Console(highlight=False)
    reach = facts["reach"]
    console.print(
        f"[bold]A person of {facts['height_m']:.2f} m[/], {facts['mass_kg']:.0f} kg, "
        f"{facts['posture']}; {facts['capsules']} closed capsules, "
        f"{facts['thickness']} thickness"
    )
    heads = ("segment", "length \\[m]", "of height", "mass \\[kg]", "radius \\[m]")
    rows = []
    for row in facts["segments"]:
        length, share = f"{row['length_m']:.3f}", f"{row['of_height']:.3f}"
        mass = "" if row["mass_kg"] is None else f"{row['mass_kg']:.2f}"
        radius = "" if row["radius_m"] is None else f"{row['radius_m']:.3f}"
        rows.append((row["segment"], length, share, mass, radius))
    console.print(table_of("Segments", heads, rows))
    heads = ("joint", "lower \\[deg]", "upper \\[deg]", "in this posture")
    names = ("lower_deg", "upper_deg", "now_deg")
    rows = [(r["joint"], *(f"{r[n]:.0f}" for n in names)) for r in facts["joints"]]
    console.print(table_of("Joints of an arm", heads, rows))
    console.print(
        f"[bold]Reach[/] of the grip from the shoulder: {reach['arm_length_m']:.3f} m "
        f"(to the finger tips {reach['to_finger_tips_m']:.3f}); "
        + ", ".join(
            f"{name.removeprefix('grip_').removesuffix('_m')} {far:.2f}"
            for name, far in reach.items()
            if name.startswith("grip_")
        )
        + f" m; shoulder {reach['shoulder_height_m']:.2f} m and eyes "
        f"{reach['eye_height_m']:.2f} m above the floor",
        soft_wrap=True,
    )
    if "plot" in facts:
        console.print(f"plot: {facts['plot']}", soft_wrap=True)
