"""`odm grasps`: sets of grasps of an object by a hand, stored, told and drawn."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sim.run.folders import GRASPS, check_kind_of
from sim.terminal.checks import FOLDER, MOST_SEED, PICTURE, Limits
from sim.terminal.flags import Json, Threads, argument, flag, from_request, optional
from sim.terminal.output import bytes_text, report
from sim.terminal.progress import Bars

if TYPE_CHECKING:
    from handover import GraspSet


@dataclass(frozen=True)
class GraspsRequest:
    """What `odm grasps build` is asked for."""

    object: str = flag(
        ..., "cup, hammer, food_jar, wrench, mallet, box or a mesh file."
    )
    hand: str = flag(..., "sdh, hubo_left, hubo_right or panda.")
    out: Path | None = optional(
        "The folder; maps/built/grasps/OBJECT-HAND if left.", writes=FOLDER
    )
    mass: float | None = optional(
        "Mass of the object of a mesh file, kg.",
        limits=Limits(0.0, 100.0, "kg", above=True, hint="such as 0.3"),
    )
    scale: float = flag(
        1.0,
        "Unit of a mesh file in m: 0.001 for millimetres.",
        limits=Limits(0.0, 1000.0, "m", above=True, hint="such as 0.001"),
    )
    samples: int = flag(90, "Points on the surface.", limits=Limits(1, 5000))
    rolls: int = flag(
        8, "How many turns about the normal above each.", limits=Limits(1, 72)
    )
    friction: float = flag(
        0.5, "Coefficient of friction, no unit.", limits=Limits(0.01, 2.0)
    )
    seed: int = flag(1, "Same seed, same set.", limits=Limits(0, MOST_SEED))
    threads: Threads = 0
    plot: Path | None = optional("Draw the object and its grasps.", writes=PICTURE)
    json: Json = None


@from_request(GraspsRequest)
def grasps_build(request: GraspsRequest) -> None:
    """Make the grasps of an object by a hand: palms above its surface, fingers closed.

    odm grasps build --object hammer --hand sdh --plot hammer.png
    """
    from handover import GraspSettings, build_grasps, load_grasps, load_object
    from handover.grasps.hands import hand_spec

    name = f"{Path(request.object).stem}-{hand_spec(request.hand).name}"
    target = request.out or GRASPS / name
    check_kind_of(target, "grasp set")
    names = ("samples", "rolls", "friction", "seed")
    settings = GraspSettings(**{name: getattr(request, name) for name in names})
    thing = load_object(request.object, request.mass, request.scale)
    with Bars() as tell:
        found = build_grasps(thing, request.hand, settings, request.threads, tell)
        found.save(target)
    _report(load_grasps(target), target, request.plot, request.json)


@dataclass(frozen=True)
class GraspsInfoRequest:
    """What `odm grasps info` is asked for."""

    folder: Path = argument(..., "Folder of a grasp set.", metavar="GRASPS")
    plot: Path | None = optional("Draw the object and its grasps.", writes=PICTURE)
    json: Json = None


@from_request(GraspsInfoRequest)
def grasps_info(request: GraspsInfoRequest) -> None:
    """Tell what a grasp set holds, after comparing every byte with its SHA-256."""
    from handover import load_grasps

    _report(load_grasps(request.folder), request.folder, request.plot, request.json)


def grasp_facts(grasps: "GraspSet", folder: Path) -> dict:
    """Return what a grasp set holds, as plain data."""
    import numpy as np

    thing, quality = grasps.thing, grasps.quality
    spread = np.percentile(quality, [0, 50, 100])
    names = ("least", "median", "most")
    return {
        "set": str(folder),
        "object": thing.name,
        "mass_kg": round(thing.mass_kg, 6),
        "hand": grasps.hand,
        "joints": list(grasps.joints),
        "grasps": len(grasps),
        "samples_with_a_grasp": len(np.unique(grasps.sample)),
        "quality": {n: round(float(q), 5) for n, q in zip(names, spread, strict=True)},
        "contacts_per_grasp": round(len(grasps.contact_link) / len(grasps), 2),
        "built": grasps.built,
        "folder_bytes": sum(f.stat().st_size for f in folder.iterdir()),
        "hash": grasps.hash,
    }


def _report(
    grasps: "GraspSet", folder: Path, plot: Path | None, json: str | None
) -> None:
    facts = grasp_facts(grasps, folder)
    if plot is not None:
        from sim.draw.grasp_picture import write_grasp_plot

        facts["plot"] = str(write_grasp_plot(grasps, plot))
    report(facts, json, _show)


def _show(facts: dict) -> None:
    built, quality = facts["built"], facts["quality"]
    print(
        f"{facts['object']} ({facts['mass_kg']:g} kg) by {facts['hand']}: "
        f"{facts['grasps']} grasps of {built['tried']} tried, above "
        f"{facts['samples_with_a_grasp']} of {built['settings']['samples']} points"
    )
    for why, count in built["refused"].items():
        print(f"  {count} refused: {why}")
    print(
        f"quality {quality['least']:g} to {quality['most']:g}, median "
        f"{quality['median']:g}; {facts['contacts_per_grasp']:g} contacts a grasp; "
        f"friction {built['settings']['friction']:g}"
    )
    size = bytes_text(facts["folder_bytes"])
    print(
        f"grasp set {facts['hash'][:12]}, {size}, made in {built['seconds']:g} s, in "
        f"{facts['set']}"
    )
