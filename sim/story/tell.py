"""`odm demo handover`: plays one hand-over, tells what happened, writes it down."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from handover import ReachMap, load_object
from handover.grasps.objects import GraspObject
from odm import CellMap
from roadmap.loading.body_tree import FASTER
from sim.draw.cover_world import open_world
from sim.draw.film import FilmSettings
from sim.draw.surroundings import all_triangles
from sim.draw.world import SimulatorMissing
from sim.loop.run_result import percentiles
from sim.people.mocap import MocapSettings, load_mocap
from sim.people.partner import PartnerTraits, RecordedPartner
from sim.people.whole_person import RecordedPerson
from sim.record import RunRecord, saved, write_record
from sim.story.cases import (
    PLACE_XY,
    StoryCase,
    StorySetup,
    own_object,
    setup_of,
    slow_to_stop,
)
from sim.story.machine import StoryEvent
from sim.story.play import StoryMoment, StoryPlay, StoryResult, play, rehearse
from sim.story.record import StoryRecorder
from sim.story.request import KEYBOARD, MOCAP, DemoRequest
from sim.story.settings import patience_with
from sim.story.watched import StoryPage, write_story_film
from sim.story.wrist import PlainWrist, SimulatedWrist, Wrist
from sim.tables.header import header
from sim.terminal.progress import Bars

FILM = "handover.gif"


def tell_story(
    request: DemoRequest,
    cell_map: CellMap,
    reach: ReachMap,
    live: object | None = None,
    person: RecordedPerson | None = None,
    thing: GraspObject | None = None,
) -> dict:
    """Play a hand-over, print what happened, and write what was asked for.

    `live`, a `sim.keyboard.story.KeyboardStory`, moves the person of `--human
    keyboard`; `person` was recorded, of `--human mocap`; `thing` is the user's object,
    see `object_of`. Returns plain data: what came of it, times, figures, files.
    """
    say: Callable[[str], None] = (lambda _: None) if request.json == "-" else print
    pads = request.pads or ()
    with Bars("placing robot, object and person"):
        obj = None if thing is None else own_object(cell_map, pads, thing)
        setup = setup_of(cell_map, reach, obj, pads=pads)
        if person is not None and setup.side not in person.sides:
            setup = replace(setup, side=person.sides[0])
        wrist, note = wrist_of(setup)
        run = _run_of(request, setup, wrist, live.person if live else person)
    lasts = request.lasts(patience_with(cell_map.robot))
    say(said_before(setup, run, note, lasts))
    recorder = StoryRecorder(run)
    with Bars("playing the hand-over"):
        rehearse(setup)
    result = _played(request, recorder, lasts, live, say)
    wrist.close()
    record = recorder.record()
    # who moved the person has seen it
    film = request.film or (None if live else request.out / FILM)
    files = written(record, cell_map, request.record, film)
    found = figures_of(result) | {"files": [str(f) for f in files]}
    found["header"] = header(cell_map)
    found["story_sha256"] = record.head["outcome"]["story_sha256"]
    say("\n".join((summary_of(result), *map(str, files))))
    return found


def _played(
    request: DemoRequest,
    recorder: StoryRecorder,
    lasts: float,
    live: object | None,
    say: Callable[[str], None],
) -> StoryResult:
    """Play the recorder's run; say what happens, or at the end where keys play."""
    run, told = recorder.run, 0

    def tell(now: bool) -> None:
        nonlocal told
        for event in run.story.events[told:] if now else ():
            say(line_of(event))
            told += 1

    told_to = request.port, request.host, request.token, live is None
    with (
        saved(recorder, request.record, at_end=False),
        StoryPage(run, *told_to) if request.view else nullcontext() as page,
    ):

        def hear(moment: StoryMoment) -> None:
            recorder.add(moment)
            tell(live is None)  # the screen is the keys' picture
            if page is not None:
                page.hear(moment)

        if live is None:
            result = play(run, lasts, hear)
        else:
            result = live.play(run, hear)
    tell(True)
    return result


def object_of(request: DemoRequest) -> GraspObject | None:
    """Return the object of the user's, read before any map is made; None: none is."""
    if request.object is None:
        return None
    return load_object(request.object, request.mass, request.scale or 1.0)


def said_before(setup: StorySetup, run: StoryPlay, note: str, lasts: float) -> str:
    """Return what is to be known before the first frame, a line each.

    `note` is about the wrist; `lasts` is how long it is played at most [s].
    """
    robot = setup.cell_map.robot
    told = [f"{robot.name}, {run.case.direction}: {note}"]
    person = getattr(run.partner, "person", None)  # recorded, or moved by keys
    told += getattr(person, "notes", ())
    told.append(getattr(person, "ending", lambda lasts: None)(lasts))
    slow = slow_to_stop(robot, run.story.settings.threat)
    quick = [note for note in robot.notes if FASTER in note]
    more = f" (and {len(quick) - 1} joints more)" if len(quick) > 1 else ""
    quick = [f"{robot.name}'s joint {quick[0]}{more}"] if quick else []
    times, longer = patience_with(robot), ""
    if times > 1.0:
        longer = (
            f"{robot.name}'s joints are slow: it may take {times:.1f} times as long as "
            "a quick robot"
        )
    about = _about_place(setup, run), _about_envelope(setup)
    return "\n".join(filter(None, (*told, *about, slow, *quick, longer)))


def _about_place(setup: StorySetup, run: StoryPlay) -> str:
    """Return a sentence where the object has no place on the table, or another one."""
    if setup.T_place is None:
        begins = "is in its hand from the beginning"
        if run.case.direction != "give":
            begins = "stays in its hand in the end"
        return (
            f"{setup.cell_map.robot.name} reaches no place on the table before its "
            f"base, so the object {begins}"
        )
    x, y = setup.T_place[:2, 3]
    if np.allclose((x, y), PLACE_XY):
        return ""
    return f"the object's place on the table is at ({x:.2f}, {y:.2f}) m, within reach"


def _about_envelope(setup: StorySetup) -> str:
    """Return a sentence where the map has an envelope that the object is too large for.

    The setup goes without it then.
    """
    recipe = setup.cell_map.recipe
    if recipe.payload is None or setup.cell_map.payload is not None:
        return ""
    return (
        f"{setup.obj.name} is larger than the payload envelope of map {recipe.name}, "
        "so ways with it in the hand are searched beyond the roadmap"
    )


def written(
    record: RunRecord,
    cell_map: CellMap,
    recording: Path | None,
    film: Path | None,
    look: FilmSettings | None = None,
) -> list[Path]:
    """Write a story's recording and its film, where they are asked for."""
    files = []
    if recording is not None:
        files.append(write_record(record, recording))
    if film is not None:
        files.append(_filmed(record, cell_map, film, look))
    return files


def _filmed(
    record: RunRecord, cell_map: CellMap, path: Path, look: FilmSettings | None
) -> Path:
    """Write a recorded story as a film, with what stands around; return it."""
    still = all_triangles(shape for _, shape in cell_map.scenery.shapes())
    world, _ = open_world(cell_map)
    with world, Bars("writing the film") as tell:
        if len(still):
            world.stand(still)
        return write_story_film(record, cell_map.robot, world, path, look, tell)


def wrist_of(setup: StorySetup) -> tuple[Wrist, str]:
    """Return pybullet's wrist where there is one, and a sentence that says which."""
    try:
        return SimulatedWrist(setup.obj), "reaction forces of pybullet at the wrist"
    except SimulatorMissing:
        return PlainWrist(setup.obj), "forces at the wrist are added up (no pybullet)"


def _run_of(
    request: DemoRequest, setup: StorySetup, wrist: Wrist, person: object | None
) -> StoryPlay:
    direction = request.direction or "give"
    if request.human in (MOCAP, KEYBOARD):
        traits = PartnerTraits()
        case = StoryCase(direction, request.seed, traits=traits)
        partner = RecordedPartner(person, setup.side, setup.obj, traits)
        how = {"wrist": wrist, "partner": partner}
        return StoryPlay(setup, case, **how, fetch=setup.T_place is not None)
    case = StoryCase.drawn(direction, request.seed)
    case = replace(case, distance=0.95, bearing=0.2 * case.bearing)
    fetch = direction == "give" and setup.T_place is not None
    return StoryPlay(setup, case, wrist=wrist, fetch=fetch)


def recorded_person(request: DemoRequest) -> RecordedPerson:
    """Return the recorded person of a request."""
    settings = MocapSettings(accept_defects=request.accept_defects)
    motion = load_mocap(request.file, mapping=request.mapping, settings=settings)
    return RecordedPerson(motion)


def line_of(event: StoryEvent) -> str:
    """Return an event as a line to read."""
    mark = " (!)" if event.failure else ""
    return f"{event.time_s:7.2f} s  {event.state:<9} {event.reason}{mark}"


def summary_of(result: StoryResult) -> str:
    """Return what came of a run in three lines."""
    cpu = {k: f"{1e3 * v:.2f}" for k, v in percentiles(np.array(result.cpu_s)).items()}
    touched = ""
    if result.object_contacts:
        touched = (
            f", {result.object_contacts} of the object with others than the arm that "
            "takes part"
        )
    return (
        f"{_ending(result)}; {result.contacts} contacts, "
        f"{result.standing_contacts} while it stood{touched}, separation at least "
        f"{100 * result.closest:.1f} cm\n"
        f"stops {result.stops}, new paths {result.path_changes}, "
        f"within 30 cm of the person at most {result.fastest_near:.2f} m/s\n"
        f"a frame, CPU ms: " + ", ".join(f"{k} {v}" for k, v in cpu.items())
    )


def _ending(result: StoryResult) -> str:
    """Return what came of a run, and when; or where it was when the time was up."""
    when = "" if result.handed_s is None else f" after {result.handed_s:.1f} s"
    if result.outcome:
        return f"{result.outcome}{when}"
    told = f"it ends in {result.state}, before the story is over (--seconds: longer)"
    return f"handed over{when}, but {told}" if when else told


def figures_of(result: StoryResult) -> dict:
    """Return what came of a run as plain data."""
    case = result.case
    return {
        "direction": case.direction,
        "seed": case.seed,
        "distance_m": case.distance,
        "bearing_deg": float(np.degrees(case.bearing)),
        "height_m": case.height,
        "traits": {k: _plain(v) for k, v in asdict(case.traits).items()},
        "in_reach": result.in_reach,
        "handed_over": result.handed_over,
        "handed_s": result.handed_s,
        "ended_s": result.ended_s,
        "state": result.state,
        "outcome": result.outcome,
        "reason": result.reason,
        "events": [asdict(event) for event in result.events],
        "contacts": int(result.contacts),
        "standing_contacts": int(result.standing_contacts),
        "object_contacts": int(result.object_contacts),
        "closest_m": float(result.closest),
        "stops": int(result.stops),
        "path_changes": int(result.path_changes),
        "fastest_near_m_s": float(result.fastest_near),
        "acceleration": float(result.acceleration),
        "jerk": float(result.jerk),
        "beyond": int(result.beyond),
        "cpu_s": percentiles(np.array(result.cpu_s)),
    }


def _plain(value: object) -> object:
    return None if isinstance(value, float) and not np.isfinite(value) else value
