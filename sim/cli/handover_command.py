"""`odm handover`: whole hand-overs between two agents, planned, told and drawn."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sim.run.folders import GRASPS
from sim.terminal.checks import FILM, MOST_SEED, PICTURE, Limits, Writes
from sim.terminal.flags import Json, argument, flag, from_request, optional
from sim.terminal.output import Bars, bytes_text, counted, report

if TYPE_CHECKING:
    from handover.plans.planner import HandoverPlan

_REASONS = 6  # why tuples had no motions: as many are told


@dataclass(frozen=True)
class PlanRequest:
    """What `odm handover plan` is asked for."""

    scene: str = argument(
        ..., "butler, stool, kneeling or a TOML file.", metavar="SCENE"
    )
    seed: int = flag(
        0, "What the scene's random parts are drawn with.", limits=Limits(0, MOST_SEED)
    )
    time_limit: float = flag(
        60.0,
        "Give up after so many s.",
        limits=Limits(0.0, 86_400.0, "s", above=True, hint="such as 60"),
    )
    grasps: Path = flag(GRASPS, "Folder of the grasp sets.", metavar="DIR")
    out: Path | None = optional(
        "Write the plan to this file, for `odm replay` and others.",
        writes=Writes((".json",), "plan"),
    )
    animation: Path | None = optional("Write a film of it.", writes=FILM)
    plot: Path | None = optional("Draw the hand-over from three sides.", writes=PICTURE)
    json: Json = None


@from_request(PlanRequest)
def plan(request: PlanRequest) -> None:
    """Plan a hand-over: arm, grasps, pose, and the motions of giver and receiver.

    odm handover plan butler --seed 7 --plot out.png --json plan.json
    """
    from handover.plans.grasps import grasps_for
    from handover.plans.plan_record import report_facts
    from handover.plans.planner import plan_handover
    from handover.scenes.load import load_scene

    scene = load_scene(request.scene, request.seed)
    with Bars() as tell:
        for placed in (scene.giver, scene.receiver):
            for side in placed.arms:
                spec = placed.agent.arms[side].spec
                grasps_for(scene.obj, spec, request.grasps, progress=tell)
    found = plan_handover(scene, request.time_limit, folder=request.grasps)
    facts = {
        "scene": scene.name,
        "seed": scene.seed,
        "found": found.found,
        "reason": found.reason,
        "report": report_facts(found),
        "seconds": {k: round(v, 4) for k, v in found.report.seconds.items()},
    }
    if found:
        facts |= _chosen(found, request)
    report(facts, None if _is_plan_file(request, found) else request.json, _show)
    if not found:
        raise typer.Exit(1)


def _is_plan_file(request: PlanRequest, found: "HandoverPlan") -> bool:
    """Return whether --json names a file: it gets the plan, to be played."""
    return bool(found) and request.json not in (None, "-")


def _chosen(found: "HandoverPlan", request: PlanRequest) -> dict:
    """Return what was chosen as plain data; write files that were asked for."""
    from handover.plans.plan_record import record_of, tuple_facts
    from handover.scenes.plan_file import write_plan

    record = record_of(found)
    facts = {
        "chosen": tuple_facts(found.chosen),
        "alternatives": len(found.alternatives),
        "duration_s": round(found.duration, 3),
        "motions": [
            {"name": m.name, "who": m.who, "begin": round(m.begin, 3),
             "end": round(m.end, 3), "holds": m.holds}
            for m in found.motions
        ],
    }  # fmt: skip
    paths = [] if request.out is None else [request.out]
    if _is_plan_file(request, found):
        paths.append(Path(request.json))
    for path in paths:
        facts["plan"] = str(write_plan(path, record))
        facts["plan_bytes"] = path.stat().st_size
    if request.plot is not None:
        from sim.draw.scene_picture import draw_scene

        facts["plot"] = str(draw_scene(found.scene, request.plot, record))
    if request.animation is not None:
        from sim.run.handover_film import write_handover_film

        film = write_handover_film(found.scene, record, request.animation)
        facts["animation"] = str(film)
    return facts


def _show_failed(lines: list[str]) -> None:
    """Print why tuples had no motions, the most frequent reasons first."""
    reasons = Counter(line.partition(": ")[2] for line in lines).most_common()
    for reason, n in reasons[:_REASONS]:
        print(f"  {counted(n, 'tuple')} without motions: {reason}")
    rest = reasons[_REASONS:]
    if rest:
        told = counted(sum(n for _, n in rest), "tuple")
        others = counted(len(rest), "other reason")
        print(f"  {told} for {others}; --json lists them all")


def _show(facts: dict) -> None:
    told = facts["report"]
    print(f"{facts['scene']}, seed {facts['seed']}: {told['arm']}")
    for where, row in told["grasps"].items():
        why = ", ".join(f"{n} {text}" for text, n in row["refused"].items())
        print(f"  {where}: {row['left']} of {row['of']} grasps are left; {why}")
    poses = told["poses"]
    print(
        f"  {counted(poses['looked at'], 'hand-over pose')}; the receiver can take "
        f"{poses['receiver can take']:,}; {counted(told['tuples'], 'tuple')}"
    )
    _show_failed(told["failed"])
    if not facts["found"]:
        print(f"no plan: {facts['reason']}")
        return
    chosen = facts["chosen"]
    at = ", ".join(f"{row[3]:.3f}" for row in chosen["T_world_handover"][:3])
    print(
        f"{chosen['arm']} arm gives with grasp {chosen['grasp_giver']}, "
        f"{chosen['arm_receiver']} arm takes with grasp {chosen['grasp_receiver']}, at "
        f"({at}) m; found by {chosen['step']}"
    )
    for motion in facts["motions"]:
        holds = ", holds the object" if motion["holds"] else ""
        print(
            f"  {motion['begin']:7.2f} to {motion['end']:7.2f} s  {motion['who']:8} "
            f"{motion['name']}{holds}"
        )
    if "plan" in facts:
        print(f"plan in {facts['plan']}, {bytes_text(facts['plan_bytes'])}")
    for name in ("plot", "animation"):
        if name in facts:
            print(f"{name} in {facts[name]}")
