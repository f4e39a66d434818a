"""`odm run --targets meet`: to the best reachable hand-over target, frame by frame."""

import gc
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from handover import Human, ReachMap, build_reach_map, chain_of, load_reach_map
from handover.meet.find import check_same_robot
from handover.meet.held_object import HeldObject, mallet, wrench
from handover.meet.settings import MeetSettings
from handover.meet.workspace import InteractionWorkspace
from handover.targets.live_targets import LiveTargets
from handover.targets.node_index import NodeIndex
from odm import CellMap, PlannerSettings, ReactivePlanner, load_map
from odm.obstacles.surfaces import sample_capsules
from roadmap.errors import BadInput
from roadmap.robot.robot import Robot
from sim.cli.workspace_command import REACH_MAPS, check_target
from sim.loop.loop import Frame, LoopSettings, light, result_of
from sim.loop.meet_audit import TargetAudit, Verdict, shares
from sim.loop.meet_loop import MeetLoop
from sim.loop.run_result import RunResult
from sim.people.mocap import MocapMotion
from sim.people.whole_person import FAR, NEAR, RecordedPerson, scripted_person
from sim.run.demo import DEMO, find_places
from sim.run.demo import warm_up as warm_planner
from sim.run.meet_report import print_targets, target_figures
from sim.run.report import print_report, setting
from sim.terminal.output import Bars, write_text

OBJECTS = {"wrench": wrench, "mallet": mallet}
GRASPS = 8  # of the person, at most
AUDIT_S = 1.0  # from audit to audit [s]
# Fewer motions to a goal than usual: a frame pays for them when the target changes.
# One look is enough to go to a better target: the margin of quality keeps it calm. No
# memory of where the person was: with it the planner stays with a worse, calm target.
PLANNER = PlannerSettings(
    attachments=4, start_attachments=4, looks=1, memory_s=0.0, kept_goals=32
)


@dataclass(frozen=True)
class MeetOptions:
    """What a run with targets is asked for.

    Attributes:
        reach: Folder of the robot's reach map; None: maps/built/reach/NAME, built if
            it is not there.
        distances: Between which a scripted person walks to and fro [m].
        obj: Name of what the robot holds.
        side: Hand the person takes it with; None: the right one, or the one that a
            recording shows.
        audit_s: Time from audit to audit of the target pursued [s]; 0: none.
    """

    reach: Path | None = None
    distances: tuple[float, float] = (NEAR, FAR)
    obj: str = "wrench"
    side: str | None = None
    audit_s: float = AUDIT_S

    def __post_init__(self) -> None:
        """Refuse what is no option."""
        if self.obj not in OBJECTS:
            raise BadInput(
                f"no object {self.obj!r}; choose one of {', '.join(OBJECTS)}"
            )
        if self.side not in (None, "left", "right"):
            raise BadInput(f"no hand {self.side!r}; choose left or right")
        if not 0 <= self.audit_s < np.inf:
            raise BadInput(f"audit_s is {self.audit_s} s; give 0 or more")


@dataclass(frozen=True, eq=False)
class Table:
    """What a run needs besides the person: map, reach map, object, nodes by pose."""

    cell_map: CellMap
    reach: ReachMap
    obj: HeldObject
    index: NodeIndex
    rest: np.ndarray

    def live(self, human: Human, side: str) -> LiveTargets:
        """Return a live thread that knows nothing yet."""
        planner = ReactivePlanner(self.cell_map, settings=PLANNER)
        return LiveTargets(planner, self.meet(human, side), self.rest, self.index)

    def meet(self, human: Human, side: str) -> InteractionWorkspace:
        """Return a workspace of its own."""
        settings = MeetSettings(side=side)
        return InteractionWorkspace(self.reach, human, self.obj, GRASPS, settings)


def person_of(
    motion: str, seed: int, recorded: MocapMotion | None, options: MeetOptions
) -> tuple[object, str]:
    """Return the whole person of a run, and the side of the hand that takes."""
    if recorded is None:
        person = scripted_person(motion, seed, options.distances)
        if options.side == "left":
            raise BadInput(
                "a scripted person moves the right arm only; leave --hand out, or play "
                "a recording with --motion mocap"
            )
        return person, "right"
    person = RecordedPerson(recorded)
    side = options.side or person.sides[0]
    if side not in person.sides:
        raise BadInput(
            f"the {side} arm is not in {recorded.name}; choose {person.sides[0]}"
        )
    return person, side


def open_table(map_dir: Path, options: MeetOptions, tell: Callable) -> Table:
    """Load what a run needs; build the reach map if there is none and none was named.

    Raises:
        BadMap: A named reach map that is none, or another robot's.
    """
    cell_map = load_map(map_dir)
    robot = cell_map.robot
    reach = reach_of(robot, options.reach, tell)
    rest = find_places(ReactivePlanner(cell_map))[0]
    tell("nodes by pose of the tool", 0, 1)
    index = NodeIndex(robot, cell_map.roadmap.nodes)
    tell("nodes by pose of the tool", 1, 1)
    return Table(cell_map, reach, OBJECTS[options.obj](), index, rest)


def reach_of(robot: Robot, folder: Path | None, tell: Callable) -> ReachMap:
    """Return the robot's reach map; one that was not named is built where missing."""
    if folder is None:
        folder = REACH_MAPS / robot.name
        check_target(folder)
        if not folder.exists():
            print(f"no reach map of {robot.name} yet: building it into {folder}")
            build_reach_map(chain_of(robot), progress=tell).save(folder)
    reach = load_reach_map(folder)
    check_same_robot(reach, robot)
    return reach


def run_meet(
    map_dir: Path,
    motion: str,
    recorded: MocapMotion | None,
    seconds: float | None,
    seed: int,
    rate: float,
    options: MeetOptions,
    execution: str = "kinematic",
    plot: Path | None = None,
    figures: Path | None = None,
    quiet: bool = False,
) -> dict:
    """Run the loop to the targets of a moving person; print the tables unless `quiet`.

    Args:
        map_dir: Folder of a built map.
        motion: Name of a scripted motion.
        recorded: The recording that is played instead, or None.
        seconds: Simulated time [s]; None: that of the recording, else 30 s.
        seed: Of the scripted motion and walk.
        rate: Frames per second.
        options: See MeetOptions.
        execution: As of `sim.loop.loop.LoopSettings`.
        plot: File for the latency plot, or None.
        figures: File for the figures as JSON, or None.
        quiet: Print nothing.

    Returns:
        The figures as plain data: "run", "targets", "setting", "map_hash".
    """
    person, side = person_of(motion, seed, recorded, options)
    if seconds is None:
        seconds = getattr(recorded, "duration_s", DEMO.duration_s)
    settings = replace(
        DEMO, duration_s=seconds, seed=seed, rate_hz=rate, execution=execution
    )
    settings = replace(settings, keep_paths=0)
    with Bars() as tell:
        table = open_table(map_dir, options, tell)
        what = f"{seconds:g} s of {person.name}"
        result, told = play(
            table, person, side, settings, options.audit_s, lambda k: tell(what, k, 100)
        )
    notes = [*getattr(recorded, "notes", ())]
    if not quiet:
        print_report([result], None, table.cell_map.hash)
        print_targets(told)
        for note in notes:
            print(note)
    for path in (plot, figures):
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
    if plot is not None:
        from sim.draw.latency_plot import write_latency_plot

        write_latency_plot(result, plot)
    data = {
        "run": result.summary() | {"timing": result.timing()},
        "targets": told,
        "notes": notes,
        "setting": setting(),
        "map_hash": table.cell_map.hash,
    }
    if figures is not None:
        import json

        write_text(figures, json.dumps(data, indent=1))
    return data


def play(
    table: Table,
    person: object,
    side: str,
    settings: LoopSettings,
    audit_s: float,
    told: Callable[[int], None],
) -> tuple[RunResult, dict]:
    """Warm up, then run and audit a loop; return its result and the targets' figures.

    Args:
        table: Map, reach map, object.
        person: As of `person_of`.
        side: Hand that takes.
        settings: Of the loop.
        audit_s: Time from audit to audit [s]; 0: none.
        told: Called with the per cent that are done.
    """
    warm_up(table, person, side, settings)
    gc.collect()
    gc.freeze()  # else a collection of all that was loaded takes 80 ms of a frame
    told(0)
    someone = person.human(0.0)
    loop = MeetLoop(table.live(someone, side), table.rest, person, settings)
    audit = TargetAudit(table.meet(someone, side), table.cell_map)
    result, verdicts = run(loop, audit, audit_s, told)
    margin = loop.live.settings.choice.margin
    figures = {"margin": margin, "audit": shares(verdicts, margin)}
    return result, target_figures(loop, result) | figures


def run(
    loop: MeetLoop, audit: TargetAudit, every_s: float, told: Callable[[int], None]
) -> tuple[RunResult, list[Verdict]]:
    """Run a loop for its whole duration; audit a frame from time to time."""
    rate = loop.settings.rate_hz
    n = max(1, round(loop.settings.duration_s * rate))
    every = max(1, round(every_s * rate)) if every_s else n + 1
    frames: list[Frame] = []
    verdicts = []
    for k in range(n):
        frame = loop.frame()
        frames.append(replace(frame, answer=light(frame.answer, frames)))
        if k and k % every == 0:
            verdicts.append(judge(loop, audit, frame))
        if k % max(1, n // 100) == 0:
            told(min(100, 100 * k // n))
    told(100)
    return result_of(loop, frames, {}), verdicts


def judge(loop: MeetLoop, audit: TargetAudit, frame: Frame) -> Verdict:
    """Audit the target that was pursued in a frame."""
    now = frame.index / loop.settings.rate_hz
    points = sample_capsules(frame.capsules, loop.settings.spacing)
    rounding = float(frame.capsules[:, 6].min())
    key = loop.pursuits[-1].key
    human = loop.motion.human(now)
    return audit.look(human, points, frame.q, key, now, rounding)


def warm_up(table: Table, person: object, side: str, settings: LoopSettings) -> None:
    """Run some seconds so that everything is compiled before time is measured."""
    planner = ReactivePlanner(table.cell_map, settings=PLANNER)
    places = np.array([table.rest, table.cell_map.roadmap.nodes[0]])
    warm_planner(planner, places, person, settings)
    brief = replace(settings, duration_s=3.0)
    live = table.live(person.human(0.0), side)
    loop = MeetLoop(live, table.rest, person, brief)
    audit = TargetAudit(table.meet(person.human(0.0), side), table.cell_map)
    run(loop, audit, 1.0, lambda k: None)
    target = next(iter(live.meet.best(1)), None)
    if target is not None:
        live.meet.rated([target.key])
        live.meet.reach.witness(target.T_world_tool)
        live.finder.near_node(target)
