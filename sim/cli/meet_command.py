"""`odm workspace meet`: where a robot can hand something to a person."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sim.cli.hand_command import place_text
from sim.run.folders import REACH_MAPS
from sim.run.request import held_object
from sim.terminal.checks import HEIGHT, PICTURE, ROTATIONS, Limits
from sim.terminal.flags import Json, Lock, Posture, Side, flag, from_request, optional
from sim.terminal.output import report
from sim.terminal.progress import Bars

if TYPE_CHECKING:
    from handover import Human, MeetSettings, ReachMap, Target
    from roadmap import Robot
    from sim.draw.meet_cut import Meeting


@dataclass(frozen=True)
class MeetRequest:
    """What `odm workspace meet` is asked for."""

    robot: str = flag(..., "Its name, or its URDF.", metavar="NAME")
    tip: str | None = optional("Link of the tool, as of its reach map.", metavar="LINK")
    lock: Lock = None
    height: float = flag(
        1.75, "Body height of the person in m, 1.2 to 2.2.", limits=HEIGHT
    )
    distance: list[float] | None = optional(
        "From the robot's base to the person's pelvis along the base's x, m; "
        "0.9 if left; again for more.",
        limits=Limits(-5.0, 5.0, "m", hint="90 cm are 0.9"),
    )
    aside: float = flag(
        0.0, "Place of the pelvis along the base's y, m.", limits=Limits(-5.0, 5.0, "m")
    )
    turn: float = flag(
        0.0,
        "Turn of the person to the left, deg; at 0 they face the robot.",
        limits=Limits(-360.0, 360.0, "deg"),
    )
    posture: Posture = "standing"
    side: Side = "right"
    object_name: str = flag(
        "wrench", "The object that is handed over.", "--object", metavar="wrench|mallet"
    )
    k: int = flag(10, "How many targets are listed.", "--k", min=1, max=100_000)
    cell: float = flag(
        0.15,
        "Side of a position cell, m.",
        limits=Limits(0.005, 0.5, "m", hint="15 cm are 0.15"),
    )
    rotations: int = flag(
        72, "Cells of rotation: 72 (60 deg), 576 (30 deg)...", limits=ROTATIONS
    )
    base_height: float | None = optional(
        "Of the robot's base above the floor, m; left: 0 for a robot whose "
        "own base is taller than 0.5 m, else 0.75.",
        limits=Limits(-5.0, 5.0, "m"),
    )
    reach: Path | None = optional(
        "Reach map; maps/built/reach/NAME if left.", metavar="DIR"
    )
    human_reach: Path | None = optional(
        "Reach map of a person's arm, for the dexterity; left: "
        "maps/built/reach/human where it is, else a coarse one made on the spot.",
        metavar="DIR",
    )
    plot: Path | None = optional("Draw cuts, robot, person and target.", writes=PICTURE)
    json: Json = None


@from_request(MeetRequest)
def meet_command(request: MeetRequest) -> None:
    """Tell where a robot can hand an object to a person, best targets first.

    Exit code 0, also where nothing is shared: then no target is listed, and how much
    nearer the person would have to come is told.

    odm workspace meet --robot panda --height 1.75 --distance 0.9 --plot cut.png
    """
    from handover import Human, InteractionWorkspace
    from sim.draw.meet_cut import find_meeting

    distances = request.distance or [0.9]
    obj = held_object(request.object_name)
    person, turned = Human(request.height, request.posture), math.radians(request.turn)
    people = [person.placed(d, request.aside, math.pi + turned) for d in distances]
    with Bars() as tell:
        robot, reach, arm_map = _loaded(request, tell)
        settings, meetings = _settings(robot, request), []
        for who in people:
            _check_place(robot, settings, who)
        for distance, who in zip(distances, people, strict=True):
            tell("meeting", len(meetings), len(people))
            meet = InteractionWorkspace(reach, who, obj, None, settings, arm_map)
            found = find_meeting(meet, robot, distance, request.k, arm_map)
            meetings.append(found)
        tell("meeting", len(people), len(people))
        facts = meet_facts(meetings, request.k)
        if request.plot is not None:
            from sim.draw.meet_picture import write_meet_picture

            rest = 0.5 * (robot.lower + robot.upper)
            picture = write_meet_picture(meetings, robot, rest, request.plot, tell)
            facts["plot"] = str(picture)
    report(facts, request.json, _show_meet)


def _check_place(robot: "Robot", settings: "MeetSettings", who: "Human") -> None:
    """Refuse a person who would stand in the robot's base."""
    import numpy as np

    from roadmap.errors import BadInput
    from roadmap.geometry.gaps import ball_gaps, moved_rods
    from roadmap.kinematics.forward import sphere_centers

    rods = moved_rods(who.capsules(), np.linalg.inv(settings.T_world_base))
    middle = sphere_centers(robot, 0.5 * (robot.lower + robot.upper))
    balls = np.column_stack([middle, robot.spheres[:, 3]])[~robot.moving]
    deepest = -ball_gaps(balls, rods).min(initial=0.0)
    if deepest > 0.0:
        x, y = who.T_world_pelvis[:2, 3]
        raise BadInput(
            f"the person at {x:.2f}, {y:.2f} m would stand {100 * deepest:.0f} cm deep "
            "in the robot's base; give a larger --distance, or --aside"
        )


def meet_facts(meetings: list["Meeting"], k: int) -> dict:
    """Return everything `odm workspace meet` says, as plain JSON data."""
    meet = meetings[0].meet
    human, settings = meet.human, meet.settings
    return {
        "robot": meet.reach.chain.name,
        "reach_map": meet.reach.hash,
        "base_height_m": float(settings.T_world_base[2, 3]),
        "human": {"height_m": human.height, "posture": human.posture},
        "side": settings.side,
        "object": meet.obj.name,
        "grasps": len(meet.grasps),
        "cell_m": settings.cell,
        "rotations": settings.rotations,
        "workspaces": [_workspace_facts(meeting, k) for meeting in meetings],
    }


def _workspace_facts(meeting: "Meeting", k: int) -> dict:
    pairs = zip(meeting.best[:k], meeting.robot_q[:k], strict=True)
    counts = meeting.counts
    missing = meeting.meet.missing_m if counts["targets"] == 0 else 0.0
    return {
        "distance_m": meeting.distance,
        "reached_cells": counts["reached"],
        "targets": counts["targets"],
        "positions": counts["positions"],
        "missing_m": round(float(missing), 4) if missing < 1e9 else None,
        "drawn": None if meeting.drawn is None else meeting.drawn + 1,
        "best": [_target_facts(i, *pair) for i, pair in enumerate(pairs, 1)],
    }


def _target_facts(rank: int, target: "Target", robot_q: object) -> dict:
    parts = {
        name: None if value != value else round(value, 4)
        for name, value in target.parts.parts.items()
    }
    return {
        "rank": rank,
        "quality": round(float(target.quality), 4),
        "online": round(float(target.parts.online), 4),
        "parts": parts,
        "dexterity": round(float(target.dexterity), 4),
        "T_world_tool": target.T_world_tool.round(6).tolist(),
        "T_world_hand": target.T_world_hand.round(6).tolist(),
        "arm_q": target.arm_q.round(6).tolist(),
        "robot_q": None if robot_q is None else robot_q.round(6).tolist(),
        "grasp": int(target.grasp),
        "key": int(target.key),
    }


def _loaded(
    request: MeetRequest, tell: Bars
) -> tuple["Robot", "ReachMap", "ReachMap | None"]:
    """Return the robot, its reach map, and that of a person's arm or None."""
    from handover import load_reach_map
    from roadmap import load_robot
    from sim.cli.build_command import parse_locked

    name, human_reach = request.robot, request.human_reach
    locked = parse_locked(request.lock)
    tell("robot", 0, 1)
    # the cover is not used here
    robot = load_robot(name, tip=request.tip, locked=locked, cover_excess=0.1)
    tell("robot", 1, 1)
    folder = request.reach or REACH_MAPS / Path(name).stem
    reach = load_reach_map(folder, robot=robot)
    if human_reach is None and (REACH_MAPS / "human" / "manifest.json").is_file():
        human_reach = REACH_MAPS / "human"
    return robot, reach, human_reach and load_reach_map(human_reach)


def _settings(robot: "Robot", request: MeetRequest) -> "MeetSettings":
    import numpy as np

    from handover import MeetSettings
    from sim.draw.meet_cut import base_height

    T, height = np.eye(4), request.base_height
    T[2, 3] = base_height(robot) if height is None else height
    cells = {"cell": request.cell, "rotations": request.rotations}
    return MeetSettings(side=request.side, T_world_base=T, **cells)


def _show_meet(facts: dict) -> None:
    from rich.console import Console

    from sim.tables.fitted import numbers_of

    console = Console(highlight=False)
    person = facts["human"]
    console.print(
        f"[bold]{facts['robot']}[/], its base {facts['base_height_m']:.2f} m above the "
        f"floor, hands a {facts['object']} to the {facts['side']} hand of a person of "
        f"{person['height_m']:.2f} m, {person['posture']}; cells of "
        f"{100 * facts['cell_m']:g} cm, {facts['rotations']} rotations, "
        f"{facts['grasps']} grasps",
        soft_wrap=True,
    )
    for row in facts["workspaces"]:
        console.print(_counted(row), soft_wrap=True)
        if not row["best"]:
            continue
        console.print(numbers_of("", _HEADS, map(_target_row, row["best"])))
        console.print(_EXPLAINED)
    if "plot" in facts:
        console.print(f"plot: {facts['plot']}", soft_wrap=True)


_HEADS = (
    "#", "total", "joint", "spatial", "visible", "safe", "effort", "dextrous",
    "tool \\[m]", "grasp", "IK",
)  # fmt: skip


_EXPLAINED = (
    "grasp: number of the person's grasp of the object. IK: whether inverse "
    "kinematics found joint values of the robot for the tool pose."
)


def _target_row(target: dict) -> list[str]:
    parts = ["" if v is None else f"{v:.2f}" for v in target["parts"].values()]
    tool = [row[3] for row in target["T_world_tool"][:3]]
    return [
        str(target["rank"]), f"{target['quality']:.3f}", *parts,
        f"{target['dexterity']:.2f}", place_text(tool), str(target["grasp"]),
        "no" if target["robot_q"] is None else "yes",
    ]  # fmt: skip


def _counted(row: dict) -> str:
    far = f"[bold]{100 * row['distance_m']:g} cm[/]"
    if row["targets"]:
        return (
            f"{far}: {row['targets']:,} of {row['reached_cells']:,} cells that the "
            f"robot reaches are targets, at {row['positions']} positions"
        )
    if row["missing_m"]:
        missing = f"{100 * row['missing_m']:.0f} cm"
        return f"{far}: nothing is shared; the person is {missing} too far away"
    return f"{far}: nothing is shared, although the person is near enough"
