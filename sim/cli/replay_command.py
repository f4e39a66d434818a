"""`odm replay`: a recorded run again, a hand-over plan, or obstacle frames."""

import re
import sys
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import typer

from sim.run.folders import MAPS, check_map_folder, folder_of_map
from sim.terminal.checks import FILM, FOLDER, RECORDING, Limits, Refused, Writes
from sim.terminal.flags import (
    Json,
    argument,
    from_request,
    of_panels,
    optional,
    refuse_beside,
    switch,
)
from sim.terminal.output import report, write_text
from sim.terminal.progress import Bars

if TYPE_CHECKING:
    from handover import ReachMap
    from odm import CellMap
    from sim.record import Difference, RunRecord

_RUN = "A recorded run"
_FRAMES = "Recorded obstacle frames"
_PLAN = "A hand-over plan"
_APART_S = 0.25  # stretches of one reason that are hardly apart [s]
_PACES = {"slowed": "pace", "braked": "pace"}  # take turns for the same reason


@dataclass(frozen=True)
class ReplayRequest:
    """What `odm replay` is asked for."""

    file: Path | None = argument(
        None,
        "A recording of `odm run --record`, or a plan of `odm handover plan`.",
        metavar="FILE",
    )
    map_dir: Path | None = optional(
        "A map's folder; default: the one in maps/built that holds the map.",
        "--map",
        metavar="MAP",
    )
    reach: Path | None = optional(
        "Its reach map, of a hand-over or a run to targets; default: "
        "maps/built/reach/ROBOT.",
        metavar="DIR",
    )
    json: Json = None
    holds: bool = switch("Only list the recorded holds with their reasons.", panel=_RUN)
    record: Path | None = optional(
        "Record the replay: the same bytes, where it is the same.",
        panel=_RUN,
        writes=RECORDING,
    )
    recipe_out: Path | None = optional(
        "Only write the recipe of the recorded map.",
        panel=_RUN,
        writes=Writes((".toml",), "recipe"),
    )
    build: Path | None = optional(
        "Only build the recorded map, for which no URDF is needed.",
        panel=_RUN,
        writes=FOLDER,
    )
    animation: Path | None = optional("Write a film of it.", panel=_PLAN, writes=FILM)
    frames: Path | None = optional("The frames; or FILE.", metavar="NPZ", panel=_FRAMES)
    always_replan: bool = switch("Search anew in every frame.", panel=_FRAMES)
    spacing: float | None = optional(
        "Covering radius of samples on capsules, in m; default: 0.03 or the map's rho.",
        limits=Limits(0.0, 0.5, "m", above=True, hint="3 cm are 0.03"),
        panel=_FRAMES,
    )
    paths: bool = switch("Keep each frame's path in the JSON.", panel=_FRAMES)


@from_request(ReplayRequest)
def replay(request: ReplayRequest) -> None:
    """Repeat a recorded run and tell whether every byte of it is the same.

    Exit code 0: the same; 1: not, with the first frame that differs. The figures of
    --json hold no times of a clock.

    A hand-over plan (.json) is told motion by motion, and drawn with --animation: its
    file and the URDFs that it names are enough.

    Recorded obstacle frames are played through the planner instead: a file of
    `capsules` (F, K, 7), or `points` (sum, 3) and `offsets` (F + 1,), with `q_start`,
    `q_goal` (dof,) and `rate_hz`. Between frames the robot moves along the answer's
    path at its joints' speed limits; while the planner holds, it stands still and
    does not retreat.
    """
    if (request.file is None) == (request.frames is None):
        raise Refused("give one file to replay, such as run.npz of `odm run --record`")
    from sim.record import is_record

    path = request.frames or request.file
    if request.file is not None and path.suffix.lower() == ".json":
        what = f"a recording, but {path} is a hand-over plan"
        names = [*of_panels(request, _RUN, _FRAMES), "map_dir", "reach"]
        refuse_beside(request, names, what)
        _play_plan(path, request)
        return
    what = f"a hand-over plan, which {path} is not"
    refuse_beside(request, of_panels(request, _PLAN), what)
    _check_archive(path)
    if is_record(path):
        what = f"recorded obstacle frames, but {path} is a recorded run"
        refuse_beside(request, of_panels(request, _FRAMES), what)
        _replay(path, request)
        return
    what = f"a recorded run, which {path} is not"
    refuse_beside(request, [*of_panels(request, _RUN), "reach"], what)
    if request.map_dir is None:
        raise Refused(
            f"{path} holds recorded obstacle frames, which need a map: add --map MAP"
        )
    _play(path, request)


def _check_archive(path: Path) -> None:
    """Refuse what is neither a recording nor frames, before anything is asked for."""
    if not path.exists():
        raise Refused(
            f"there is no file {path}; give a recording of `odm run --record`"
        )
    if path.is_dir():
        raise Refused(f"{path} is a folder; give a recording of `odm run --record`")
    with path.open("rb") as stream:
        start = stream.read(4)
    if not start.startswith(b"PK"):
        what = "is empty" if not start else "is no .npz archive"
        raise Refused(
            f"{path} {what}; give a recording of `odm run --record`, a plan (.json), "
            "or frames that numpy.savez wrote"
        )


def _play_plan(path: Path, request: ReplayRequest) -> None:
    """Tell what a hand-over plan does, and draw it."""
    from sim.run.played_plan import read_played, show_played

    played = read_played(path)
    facts = played.facts()
    if request.animation is not None:
        from sim.run.handover_film import write_handover_film

        film = write_handover_film(played, played.record, request.animation)
        facts["animation"] = str(film)
    report(facts, request.json, show_played)


def _play(path: Path, request: ReplayRequest) -> None:
    """Play obstacle frames."""
    from odm import load_map
    from sim.loop import replay as player
    from sim.loop.recording import read_recording

    cell_map = load_map(request.map_dir)
    recording = read_recording(path, cell_map, request.spacing)
    with Bars() as tell:
        found = player.play(
            cell_map, recording, request.always_replan, request.paths, tell
        )
    report(found, request.json, player.show)


def _write_recipe(found: "RunRecord", path: Path) -> None:
    """Write the recipe of the recorded map; tell which files it does not find there."""
    from sim.record.again import recipe_of
    from sim.record.recipe_toml import lost_files, recipe_text

    recipe = recipe_of(found)
    print(write_text(path, recipe_text(recipe)))
    if lost := lost_files(recipe, path.absolute().parent):
        print(
            f"its relative paths start at its folder, where {', '.join(lost)} is not: "
            "put the recipe where they do, or use --build, which needs no "
            "such file",
            file=sys.stderr,
        )


def _replay(path: Path, request: ReplayRequest) -> None:
    """Repeat a recorded run, or take out of it what was asked for."""
    from sim.record import read_record

    _check_only(request)
    found = read_record(path)
    if request.recipe_out is not None:
        _write_recipe(found, request.recipe_out)
    if request.build is not None:
        _build(found, request.build)
    if request.holds:
        report(holds_facts(found), request.json, show_holds)
    if request.holds or request.recipe_out or request.build:
        return
    if not {"story", "targets"} & set(found.head):
        what = f"a hand-over or a run to targets, which {path} is not"
        refuse_beside(request, ("reach",), what)
    cell_map = _map_of(found, path, request.map_dir)
    if "story" in found.head:
        _repeat_story(found, path, cell_map, request)
        return
    with Bars() as tell:
        again = _again(found, cell_map, request, tell)
    _compare(found, again, path, request)


def _check_only(request: ReplayRequest) -> None:
    """Refuse what goes with a replay where something is only taken out of the file."""
    files = {"--recipe-out": request.recipe_out, "--build": request.build}
    taken = [word for word, value in files.items() if value is not None]
    if taken and request.json is not None:
        raise Refused(
            f"--json goes with a replay or --holds, not with {taken[0]}; leave it out"
        )
    only = ["--holds", *taken] if request.holds else taken
    if only:
        names = ("record", "map_dir", "reach")
        refuse_beside(request, names, f"a replay, not with {only[0]}")


def _again(
    found: "RunRecord", cell_map: "CellMap", request: ReplayRequest, tell: Bars
) -> "RunRecord":
    """Run between work places, or to the targets of the recorded person, again."""
    if "targets" not in found.head:
        from sim.record import run_again

        return run_again(found, cell_map, tell)
    from sim.run.meet import reach_map_of
    from sim.run.meet_record import targets_again

    reach = reach_map_of(cell_map.robot, request.reach, tell)
    return targets_again(found, cell_map, reach, tell)


def _repeat_story(
    found: "RunRecord", path: Path, cell_map: "CellMap", request: ReplayRequest
) -> None:
    """Let a hand-over see and feel the same again; does it do the same?"""
    from sim.run.meet import reach_map_of
    from sim.story.cases import setup_of
    from sim.story.record import object_of, play_again, same

    if request.record is not None or request.json is not None:
        raise Refused(
            f"{path} is a hand-over: a replay tells whether it is the same, and writes "
            "nothing; leave --record and --json out"
        )
    with Bars() as tell:
        reach = reach_map_of(cell_map.robot, request.reach, tell)
    if "parts" in found.head:
        _repeat_cycle(found, path, cell_map, reach)
        return
    obj, pads = object_of(found.head), _pads_of(found.head)
    q, states = play_again(found, setup_of(cell_map, reach, obj, pads=pads))
    if not same(found, q, states):
        was = found.arrays["q"]
        off = (q != was).any(axis=1)
        frame = int(off.argmax()) if off.any() else 0
        print(
            f"odm: the replay of {path} differs from frame {frame} on", file=sys.stderr
        )
        raise typer.Exit(1)
    print(f"same: {found.frames:,} frames of {found.head['motion']['name']}")
    print(f"story_sha256 {found.head['outcome']['story_sha256']}")


def _pads_of(head: dict) -> list[str]:
    """Return the links that could touch the object of a recorded hand-over."""
    return head["planner"]["settings"]["finger_pads"]


def _repeat_cycle(
    found: "RunRecord", path: Path, cell_map: "CellMap", reach: "ReachMap"
) -> None:
    """Do the same with each hand-over of a maintenance cycle."""
    from sim.maintenance.cases import tools_of
    from sim.maintenance.record import is_same_again, work_place_of

    args = _pads_of(found.head["parts"][0]), work_place_of(found)
    if not is_same_again(found, tools_of(cell_map, reach, *args)):
        print(f"odm: the replay of {path} differs", file=sys.stderr)
        raise typer.Exit(1)
    print(f"same: {found.frames:,} frames of {found.head['motion']['name']}")


def _compare(
    found: "RunRecord", again: "RunRecord", path: Path, request: ReplayRequest
) -> None:
    """Tell whether a replay is the recorded run; write what was asked for."""
    from sim.record import first_difference, write_record

    if request.record is not None:
        write_record(again, request.record)
    quiet = request.json == "-"
    if request.json is not None:
        text = again.result().to_json(timing=False) + "\n"
        sys.stdout.write(text) if quiet else write_text(request.json, text)
    difference = first_difference(found, again)
    if difference is not None:
        print(f"odm: {what_differs(found, again, difference, path)}", file=sys.stderr)
        raise typer.Exit(1)
    if not quiet:
        show_same(again)
        if request.record is not None:
            print(request.record)


def _map_of(found: "RunRecord", path: Path, map_dir: Path | None) -> "CellMap":
    from odm import load_map
    from roadmap.errors import BadInput
    from sim.record.again import check_map

    wanted = found.head["map"]
    usual = MAPS / wanted["name"]
    folder = map_dir or folder_of_map(wanted["name"], wanted["hash"]) or usual
    if map_dir is None and not folder.exists():
        raise BadInput(
            f"the map {wanted['name']} {wanted['hash'][:12]} of the recording is in no "
            f"folder of {MAPS}; give its folder with --map, or build it with "
            f"`odm replay {quote(str(path))} --build {quote(str(folder))}`"
        )
    cell_map = load_map(folder)
    check_map(found, cell_map, path, folder)
    return cell_map


def _build(found: "RunRecord", target: Path) -> None:
    """Build the recorded map into a folder, and see that it is the one."""
    from odm import load_map
    from sim.record.again import build_again, check_built, recipe_of

    check_map_folder(target, recipe_of(found), force=False)
    with Bars() as tell:
        build_again(found, progress=tell).save(target)
    cell_map = load_map(target)
    check_built(found, cell_map, target)
    print(f"map {cell_map.hash[:12]} in {target}")


def holds_facts(record: "RunRecord") -> dict:
    """Return every hold and every slow stretch of a recording as plain data."""
    result, told = record.result(), record.head["map"]
    keys = ("start_s", "end_s", "what", "reason")
    return {
        "motion": result.motion,
        "duration_s": round(result.duration_s, 6),
        "map": told["name"],
        "map_hash": told["hash"],
        "holds": len(record.holds),
        "slow": len(record.slow),
        "rows": [dict(zip(keys, row, strict=True)) for row in _rows(record)],
    }


def show_holds(facts: dict) -> None:
    """Print what `holds_facts` returned."""
    print(
        f"{facts['motion']}: {facts['duration_s']:.2f} s on map {facts['map']} "
        f"{facts['map_hash'][:12]}, {facts['holds']} holds, {facts['slow']} times "
        "slowed or braked"
    )
    for row, times in merged(facts["rows"]):
        what = f"  {row['what']}" if row["what"] == "later" else row["what"]
        often = f"{times} times, first: " if times > 1 else ""
        print(
            f"{row['start_s']:9.3f} s to {row['end_s']:9.3f} s  {what:<10}  "
            f"{often}{row['reason'] or 'it goes on slowly after a stop'}"
        )


def merged(rows: list[dict]) -> list[tuple[dict, int]]:
    """Return rows with how many each stands for.

    Those that are hardly apart, for the same reason but for its numbers, become one: of
    the first's reason, "braked" where any of them was.
    """
    found: list[tuple[dict, int]] = []
    for row in rows:
        last, times = found[-1] if found else (None, 0)
        if last is None or not _goes_on(last, row):
            found.append((row, 1))
            continue
        end, what = max(last["end_s"], row["end_s"]), min(last["what"], row["what"])
        found[-1] = {**last, "end_s": end, "what": what}, times + 1
    return found


def _goes_on(last: dict, row: dict) -> bool:
    """Say whether a row is more of the one before."""
    kinds = {_PACES.get(one["what"], one["what"]) for one in (last, row)}
    reasons = {re.sub(r"[\d.]+", "", one["reason"]) for one in (last, row)}
    near = row["start_s"] <= last["end_s"] + _APART_S
    return near and len(kinds) == len(reasons) == 1


def _rows(record: "RunRecord") -> list[tuple[float, float, str, str]]:
    rows = []
    for hold in record.holds:
        what = "retreating" if hold["retreating"] else "holding"
        rows.append((hold["start_s"], hold["end_s"], what, hold["reason"]))
        for time, reason in hold["later"]:
            rows.append((time, hold["end_s"], "later", reason))
    for slow in record.slow:
        rows.append((slow["start_s"], slow["end_s"], slow["pace"], slow["reason"]))
    return sorted(rows, key=lambda row: row[0])


def show_same(record: "RunRecord") -> None:
    """Print that a replay is the run, and what the run was."""
    result = record.result()
    print(
        f"same: {result.frames:,} frames of {result.motion}, {result.trips} trips, "
        f"{result.contacts} contacts, {len(result.holds)} holds"
    )
    print(f"trajectory_sha256 {result.fingerprint()}")


def what_differs(
    was: "RunRecord", now: "RunRecord", difference: "Difference", path: Path
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
