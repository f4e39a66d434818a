"""The `odm` command: one door to everything; each command says more with --help.

Commands import what they need when they run, so that `odm --help` answers at once.
"""

import sys

import typer

from sim.cli import (
    bench_command,
    build_command,
    camera_command,
    human_command,
    map_command,
    meet_command,
    replay_command,
    run_command,
    two_command,
)
from sim.terminal import interrupt
from sim.terminal.output import guarded

app = typer.Typer(
    name="odm",
    help="Reactive motion planning beside a moving human, with precomputed maps.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS = {
    "build": build_command.build,
    "info": map_command.info,
    "audit": map_command.audit,
    "run": run_command.run,
    "demo": run_command.demo,
    "replay": replay_command.replay,
    "run-two": two_command.run_two,
    "camera": camera_command.camera,
    "bench": bench_command.bench,
    "warmup": build_command.warmup,
}
for name, command in COMMANDS.items():
    app.command(name)(guarded(command))
app.add_typer(human_command.app, name="human")
app.add_typer(meet_command.app, name="workspace")


def main() -> None:
    """Run the command line; the exit code is 0, 1 (a finding or error) or 2 (usage).

    130: Ctrl-C, see `sim.terminal.interrupt`.
    """
    with interrupt.interruptible():
        app(with_targets(sys.argv[1:]), prog_name="odm")


# options that may stand alone, and the ending of the file behind them
_TARGETS = {"--json": ".json", "--markdown": ".md"}


def with_targets(arguments: list[str]) -> list[str]:
    """Let `--json` stand alone: without a FILE.json behind it, it means '-'."""
    result, at = [], 0
    while at < len(arguments):
        word, at = arguments[at], at + 1
        if word in _TARGETS:
            after = arguments[at] if at < len(arguments) else ""
            if after == "-" or after.endswith(_TARGETS[word]):
                word, at = f"{word}={after}", at + 1
            else:
                word += "=-"
        result.append(word)
    return result


<<<<<<< HEAD
@app.command()
@guarded
def info(
    map_dir: MapArgument,
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw what the map covers.")
    ] = None,
    json: Json = None,
) -> None:
    """Tell what a map holds: robot, counts, bytes, safety terms, cover, scenery.

    The clearance tax (what the map gives away beyond its clearance m) is a quick look
    from a few approaches; `odm bench tax` measures it.
    """
    from odm import load_map
    from sim.cli import describe

    cell_map = load_map(map_dir)
    with Bars() as tell:
        facts = describe.facts(cell_map, tell)
    if plot is not None:
        from sim.draw.coverage import plot_map

        plot.parent.mkdir(parents=True, exist_ok=True)
        facts["plot"] = str(plot_map(cell_map, plot))
    if json is not None:
        show_json(facts, json)
    else:
        describe.show(facts)


@app.command()
@guarded
def audit(
    map_dir: MapArgument,
    pairs: Annotated[int, typer.Option(min=1, help="Pairs tested.")] = 100_000,
    seed: Seed = 0,
    close: Annotated[
        bool, typer.Option("--close", help="Ask the close test, not the cells.")
    ] = False,
    payload: Annotated[
        bool, typer.Option("--payload", help="With the payload envelope in the hand.")
    ] = False,
    sabotage: Annotated[
        str | None,
        typer.Option(
            metavar="rho|mu|sphere|certificate",
            help="Take this away: the audit must fail.",
        ),
    ] = None,
    sequences: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Attack what a planner remembers instead: N random frames in which "
            "the robot is pushed, goals change, sensors fail; each leg is judged anew.",
        ),
    ] = None,
    threads: Threads = 0,
    json: Json = None,
) -> None:
    """Try to falsify a map: exact geometry against what the map calls free.

    Exit code 0: nothing found; 1: something, with the nearest cases.
    """
    from odm import load_map
    from odm.audit.audit import audit as run_audit
    from odm.cell_map.payload import loaded_map
    from sim.cli import describe

    if sequences is not None or sabotage == "certificate":
        _audit_sequences(map_dir, sequences or pairs, seed, threads, sabotage, json)
        return
    cell_map = load_map(map_dir)
    asked = loaded_map(cell_map) if payload else cell_map
    options = {"seed": seed, "close": close, "sabotage": sabotage, "threads": threads}
    with interrupt.patience(REPORT_S):
        with Bars() as tell:
            report = run_audit(asked, pairs=pairs, progress=tell, **options)
        if json is not None:
            show_json(report.as_dict() | {"map_hash": cell_map.hash}, json)
        else:
            describe.show_audit(report, cell_map.hash)
    if not report.complete:
        raise KeyboardInterrupt
    if not report.passed:
        raise typer.Exit(1)


def _audit_sequences(
    map_dir: Path,
    steps: int,
    seed: int,
    threads: int,
    sabotage: str | None,
    json: str | None,
) -> None:
    """Run the audit by sequences and show it."""
    from odm import load_map
    from odm.audit.sequence_audit import audit_sequences
    from sim.cli import describe

    map_hash = load_map(map_dir).hash
    options = {"seed": seed, "processes": threads, "sabotage": sabotage}
    with Bars() as tell:
        report = audit_sequences(map_dir, steps=steps, progress=tell, **options)
    if json is not None:
        show_json(report.as_dict() | {"map_hash": map_hash}, json)
    else:
        describe.show_sequences(report, map_hash)
    if not report.complete:
        raise KeyboardInterrupt
    if not report.passed:
        raise typer.Exit(1)


@app.command()
@guarded
def run(
    map_dir: MapOption,
    motion: Annotated[
        str,
        typer.Option(
            metavar="sweep|reach|jitter|hover|intrusion|tremble|crowding|hold|backoff"
            "|escape|mocap|keyboard",
            help="The person: scripted, recorded (--file) or moved by your keys; "
            "hold, backoff and escape are scenes in which the robot has to.",
        ),
    ] = "sweep",
    seconds: Annotated[
        float | None,
        typer.Option(help="Simulated time; default: 30, the clip's, or until q."),
    ] = None,
    seed: Seed = 0,
    rate: Annotated[float, typer.Option(help="Frames per second.")] = 100.0,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write all pictures there.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Write the latency plot.")
    ] = None,
    animation: Annotated[
        Path | None, typer.Option(metavar="GIF", help="Write a short film.")
    ] = None,
    file: Annotated[
        Path | None,
        typer.Option(metavar="CSV|BVH", help="Recorded motion, for mocap."),
    ] = None,
    mapping: Annotated[
        Path | None,
        typer.Option(metavar="TOML", help="Names of its joints; see docs/mocap.md."),
    ] = None,
    stand: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y YAW", help="Where the recorded person stands: m, m, degrees."
        ),
    ] = None,
    base_height: Annotated[
        float, typer.Option(help="Robot's base above the recorded floor, in m.")
    ] = 0.75,
    execution: Annotated[
        str, typer.Option(metavar="kinematic|timed", help="How the robot moves.")
    ] = "kinematic",
    targets: Annotated[
        str,
        typer.Option(
            metavar="places|meet",
            help="To and fro between work places, or to the best reachable hand-over "
            "target of the person.",
        ),
    ] = "places",
    reach: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Reach map of the robot (meet); built if left."
        ),
    ] = None,
    distance: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="NEAR FAR",
            help="The scripted person walks between these, m (meet).  [0.6 1.3]",
        ),
    ] = None,
    held: Annotated[
        str | None,
        typer.Option("--object", metavar="wrench|mallet", help="In its hand (meet)."),
    ] = None,
    hand: Annotated[
        str | None,
        typer.Option(metavar="right|left", help="Hand of the person (meet)."),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            metavar="NPZ",
            help="Write the whole run, however it ends; `odm replay` repeats it.",
        ),
    ] = None,
    carry: Annotated[
        float | None,
        typer.Option(
            metavar="R", help="Radius of a ball in its hand, in m; see docs/layers.md."
        ),
    ] = None,
    json: Json = None,
) -> None:
    """Move the robot between two work places while a person moves; audit each frame.

    With `--execution timed` it keeps its limits of acceleration and jerk, and slows
    down and stops for the person. With `--targets meet` it goes where the person can
    best take what it holds; see docs/handover.md.

    The keys of `--motion keyboard` stand on its screen; q ends it.
    """
    from sim.cli.run_command import (
        RunFiles,
        check_options,
        meet_options,
        person_of,
        run_motion,
    )
    from sim.loop.carried import check_carry

    check_options(
        motion, file, {"--out": out, "--plot": plot, "--animation": animation}
    )
    check_carry(carry, motion)
    quiet = json == "-"
    own = {"reach": reach, "distances": distance, "obj": held, "side": hand}
    meet = meet_options(targets, own)
    if meet is not None:
        from sim.cli.meet_run import run_targets

        given = {"animation": animation, "record": record, "out": out, "plot": plot}
        given |= {"file": file, "mapping": mapping, "stand": stand}
        options = {"execution": execution, "base_height": base_height}
        result = run_targets(
            map_dir, motion, seconds, seed, rate, meet, given, quiet, **options
        )
        if json is not None:
            show_json(result, json)
        if code := result.get("exit_code", 0):
            raise typer.Exit(code)
        return
    if motion == "keyboard":
        from sim.keyboard import run_keyboard

        options = {"quiet": quiet, "execution": execution, "record": record}
        ended = run_keyboard(map_dir, seconds, rate, **options)
        if json is not None:
            show_json(ended.as_dict(), json)
        raise typer.Exit(ended.exit_code)
    person = person_of(motion, seed, file, mapping, stand, base_height)
    files = RunFiles.chosen(out, motion, plot, animation, record)
    result = run_motion(
        map_dir, person, seconds, seed, rate, files, quiet, execution, carry
    )
    if json is not None:
        show_json(result, json)


@app.command()
@guarded
def demo(
    out: Annotated[Path, typer.Option(metavar="DIR", help="For pictures.")] = Path(
        "out"
    ),
    seconds: Annotated[float, typer.Option(help="Simulated time.")] = 30.0,
    threads: Threads = 0,
) -> None:
    """Build the demo map unless it is there, then a robot works beside an arm."""
    from sim.cli.run_command import run_demo_command

    run_demo_command(out, seconds, threads)


app.command("replay")(guarded(replay_command.replay))
app.command("run-two")(guarded(two_command.run_two))
app.command("camera")(guarded(camera_command.camera))


@app.command()
@guarded
def bench(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="latency, motions, memory, tax, build, ompl, odm-paper, camera, "
            "human, handover-recording, approach, attach, workspace, targets, "
            "interrupts or golden.",
        ),
    ],
    map_dir: Annotated[
        Path | None, typer.Option("--map", metavar="MAP", help="A map's folder.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Same seed, same frames.")] = None,
    short: Annotated[
        bool, typer.Option("--short", help="To see that it runs, not to measure.")
    ] = False,
    execution: Annotated[
        str | None,
        typer.Option(
            metavar="kinematic|timed", help="How the robot moves (motions, targets)."
        ),
    ] = None,
    pushed: Annotated[
        bool,
        typer.Option("--pushed", help="Push the robot meanwhile (motions)."),
    ] = False,
    seconds: Annotated[
        float | None,
        typer.Option(help="Simulated time of each run (motions, targets)."),
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(help="Runs of each motion (motions).")
    ] = None,
    processes: Annotated[
        int | None, typer.Option(min=1, help="Runs at a time (motions).")
    ] = None,
    motion: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Only these; again for more (motions)."),
    ] = None,
    reach: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Reach map (targets).")
    ] = None,
    distance: Annotated[
        list[float] | None,
        typer.Option(help="Of the person, in m; again for more (targets)."),
    ] = None,
    file: Annotated[
        list[Path] | None,
        typer.Option(metavar="F", help="A recording, too; again for more."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw the figures, if it can.")
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Another checkout to compare with (golden)."),
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="ITEM", help="Only these; again for more (golden)."),
    ] = None,
    write: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Keep what this checkout does (golden)."),
    ] = None,
    read: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Compare with what was kept (golden)."),
    ] = None,
    latency: Annotated[
        bool,
        typer.Option("--latency", help="Time frames of both, in turn (golden)."),
    ] = False,
    markdown: Annotated[
        str | None,
        typer.Option(
            "--markdown",
            metavar="FILE",
            help="Put the table between the markers in FILE.md; alone: print it.",
        ),
    ] = None,
    json: Json = None,
) -> None:
    """Measure: figures as tables or JSON, with processor, versions and map hash."""
    from sim.cli.bench_command import run_bench

    options = {"map_dir": map_dir, "seed": seed, "short": short or None}
    options |= {"execution": execution, "seconds": seconds, "seeds": seeds}
    options |= {"pushed": pushed or None, "processes": processes}
    options |= {"motions": motion or None, "files": file or None, "plot": plot}
    options |= {"reach": reach, "distances": distance or None}
    options |= {"against": against, "only": only or None, "latency": latency or None}
    options |= {"write": write, "read": read}
    if code := run_bench(name, options, json, markdown):
        raise typer.Exit(code)


@app.command()
@guarded
def warmup(
    fine: Annotated[
        bool,
        typer.Option("--fine", help="Also for grids of more than 65535 blocks."),
    ] = False,
) -> None:
    """Compile all kernels ahead, so that no frame ever pays for it."""
    from sim.loop.warmup import run_warmup

    with Bars("loading the compiler") as tell:
        seconds, compiled = run_warmup(tell, fine)
    what = f"{compiled} kernels compiled" if compiled else "everything was compiled"
    print(f"{what}, {seconds:.1f} s")


=======
>>>>>>> 76832575cc3a2c57505140ee34cc53b16f959c06
if __name__ == "__main__":
    main()
