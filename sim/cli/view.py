"""`odm view`: a recording or a map in the browser."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sim.run.folders import MAPS, folder_of_map
from sim.terminal import interrupt
from sim.terminal.checks import Limits
from sim.terminal.flags import argument, flag, from_request, optional, refuse_beside

if TYPE_CHECKING:
    from odm import CellMap
    from sim.record import RunRecord
    from sim.view.page import Show

_SAME_S = 0.005  # times that are told alike [s]
_FROM = Limits(0.0, 86_400.0, "s")
# what is often given in place of a recording, and which command shows it
_OTHERS = {
    ".json": ("a hand-over plan", "`odm replay {file}` tells and draws it"),
    **dict.fromkeys(
        (".png", ".gif"),
        ("a picture", "give the recording, which `odm run --record` writes"),
    ),
    ".scene": (
        "a scene of MoveIt",
        "`odm run --map MAP --scene {file} --view` shows a run in it",
    ),
    ".toml": (
        "a recipe or a scene",
        "`odm build` makes a recipe's map, which --map shows, and "
        "`odm handover plan --plot` draws a scene",
    ),
}


@dataclass(frozen=True)
class ViewRequest:
    """What `odm view` is asked for."""

    file: Path | None = argument(
        None,
        "A recording of `odm run --record` or `odm demo --record`.",
        metavar="FILE",
    )
    map_dir: Path | None = optional(
        "A map's folder: alone, or for the cells and edges of a recording.  "
        "[the one in maps/built that holds it]",
        "--map",
        metavar="MAP",
    )
    at: float = flag(0.0, "Where in the recording it begins, in s.", limits=_FROM)
    port: int = flag(8080, "Port of the page; 0: any that is free.")
    host: str = flag(
        "127.0.0.1",
        "Address it listens at. Others than this machine's own (0.0.0.0: all) ask who "
        "comes for a token, which is part of the address that is printed; it goes over "
        "the network unencrypted, so use an SSH tunnel where others listen.",
    )
    token: str | None = optional("The token; default: a new one where one is needed.")


@from_request(ViewRequest)
def view(request: ViewRequest) -> None:
    """Show a recorded run, or a map, on a page in the browser; Ctrl-C ends it.

    A recording can be played, scrubbed and searched for its events. It needs nothing
    but the file: the robot is in it; with its map, cells and roadmap are shown, too.
    A map alone shows its roadmap, and what an arm that you drag blocks of it.

    A running loop is shown by `odm run --view`.
    """
    from roadmap.errors import BadInput
    from sim.terminal.progress import silence
    from sim.view.gate import listening, token_for
    from sim.view.viewer import check_viewer

    if request.file is None and request.map_dir is None:
        raise BadInput("there is nothing to show; give a recording, or --map MAP")
    if request.file is not None:
        _check_kind(request.file)
    else:
        refuse_beside(request, ("at",), "a recording, a map alone has no times")
    check_viewer()
    token = token_for(request.host, request.token)
    shown = recorded_show(request) if request.file else _map_alone(request.map_dir)
    if request.file:
        end = shown.source.span()[1]
        if request.at > end + _SAME_S:
            raise BadInput(
                f"--at is {request.at:g} s, but {request.file} ends at {end:.2f} s; "
                "give a time before that"
            )
    listener = listening(request.host, request.port)
    from sim.view.page import Page

    page = Page(shown, listener, request.host, token)
    page.playback.seek(request.at)
    silence()  # what it does is seen
    print(f"watch at {page.gate.address}  (Ctrl-C ends)", flush=True)
    interrupt.ends_by_it()
    page.run()


def _check_kind(path: Path) -> None:
    """Refuse a file that another command shows, and say which."""
    from roadmap.errors import BadInput

    kind = path.suffix.lower()
    if kind not in _OTHERS or not path.is_file():
        return
    what, how = _OTHERS[kind]
    if kind == ".json" and not _is_plan(path):
        what, how = "a JSON file", "a recording of `odm run --record` is shown here"
    raise BadInput(f"{path} is {what}, no recording; {how.format(file=path)}")


def _is_plan(path: Path) -> bool:
    from handover.scenes.plan_file import read_plan
    from roadmap.errors import BadInput

    try:
        return bool(read_plan(path))
    except BadInput:
        return False


def recorded_show(request: ViewRequest) -> "Show":
    """Return a recording as what a page shows."""
    from sim.record import read_record
    from sim.view.page import Show
    from sim.view.robot_shapes import robot_parts
    from sim.view.sources import Recorded, standing_of_record

    record = read_record(request.file)
    source, head = Recorded(record), record.head["map"]
    asked = head["recipe"].get("robot", {})
    cell_map, lacking = _map_of(record, request)
    sentences = [
        "a recording holds no planned paths: the line is where the robot went",
        *lacking,
    ]
    label = f"{request.file.name}: {source.robot.name}, map {head['name']}"
    load = None if cell_map is None else (lambda: cell_map)
    return Show(
        source,
        source.robot,
        label,
        sentences,
        lambda: robot_parts(source.robot, asked.get("source", ""), asked.get("locked")),
        load,
        still=standing_of_record(record),
        lowest=source.lowest,
    )


def _map_of(
    record: "RunRecord", request: ViewRequest
) -> tuple["CellMap | None", list[str]]:
    """Return the map of a recording, or a sentence about what it would show."""
    from odm import load_map
    from roadmap.errors import BadMap
    from sim.record.again import check_map

    head = record.head["map"]
    if request.map_dir is not None:
        cell_map = load_map(request.map_dir)
        check_map(record, cell_map, request.file, request.map_dir)
        return cell_map, []
    folder = folder_of_map(head["name"], head["hash"])
    try:
        if folder is not None:
            return load_map(folder, verify=False), []
    except BadMap:
        pass
    told = (
        f"its map {head['name']} {head['hash'][:12]} is in no folder of {MAPS}, so "
        "occupied cells and the roadmap are not shown; give it with --map"
    )
    return None, [told]


def _map_alone(folder: Path) -> "Show":
    """Return a map with an arm that can be dragged through it as a show."""
    from odm import load_map
    from sim.draw.surroundings import all_triangles
    from sim.people.human_motion import make_motion
    from sim.view.beside import ArmBeside
    from sim.view.page import Show
    from sim.view.robot_shapes import robot_parts

    cell_map = load_map(folder)
    asked = cell_map.recipe.robot
    beside = ArmBeside(cell_map, make_motion("reach"))
    label = f"{cell_map.robot.name}, map {cell_map.recipe.name}"
    return Show(
        beside,
        cell_map.robot,
        label,
        [],
        lambda: robot_parts(cell_map.robot, asked.source, asked.locked),
        lambda: cell_map,
        beside.take,
        ("cells", "blocked"),
        all_triangles(shape for _, shape in cell_map.scenery.shapes()),
    )
