"""The `odm` command: one entry to everything; each command says more with --help.

Commands import what they need when they run, so that `odm --help` answers at once.
"""

import inspect
import sys
from collections.abc import Callable
from functools import cache

import typer

from sim.cli import (
    bench_command,
    build_command,
    camera_command,
    doctor_command,
    grasps_command,
    hand_command,
    handover_command,
    human_command,
    map_command,
    meet_command,
    replay_command,
    run_command,
    two_command,
    view,
    workspace_command,
)
from sim.terminal import interrupt
from sim.terminal.output import MISTAKE, guarded, no_room
from sim.terminal.words import mistake, nothing_given, with_targets

app = typer.Typer(
    name="odm",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _tell_version(asked: bool) -> None:
    if asked:
        from sim.tables.versions import version

        print(f"odm-planner {version('odm-planner')}")
        raise typer.Exit


@app.callback()
def odm(
    version: bool = typer.Option(
        False,
        "--version",
        help="Tell the version; `odm doctor` tells those of all it uses.",
        callback=_tell_version,
        is_eager=True,
    ),
) -> None:
    """Reactive motion planning beside a moving human, with precomputed maps."""


# by name; those of a group with the help of the group
COMMANDS: dict[str, Callable | tuple[str, dict[str, Callable]]] = {
    "build": build_command.build,
    "info": map_command.info,
    "audit": map_command.audit,
    "run": run_command.run,
    "demo": run_command.demo,
    "replay": replay_command.replay,
    "view": view.view,
    "run-two": two_command.run_two,
    "camera": camera_command.camera,
    "bench": bench_command.bench,
    "warmup": build_command.warmup,
    "doctor": doctor_command.doctor,
    "human": (
        "The model of the person: proportions, joint ranges, reach.",
        {"info": human_command.human_info},
    ),
    "workspace": (
        "Where robot and person reach: maps of 6-D reachability.",
        {
            "build": workspace_command.build_reach,
            "info": workspace_command.reach_info,
            "human": hand_command.human_reach,
            "meet": meet_command.meet_command,
        },
    ),
    "grasps": (
        "How objects are grasped: sets of grasps by hand and object.",
        {"build": grasps_command.grasps_build, "info": grasps_command.grasps_info},
    ),
    "handover": (
        "Hand-overs: which arm, grasps and pose, and proved motions of both agents.",
        {"plan": handover_command.plan},
    ),
}


def _add_commands(group: typer.Typer, commands: dict) -> None:
    for name, command in commands.items():
        if callable(command):
            group.command(name)(guarded(command))
            continue
        text, inner = command
        made = typer.Typer(help=text, no_args_is_help=True)
        _add_commands(made, inner)
        group.add_typer(made, name=name)


_add_commands(app, COMMANDS)


@cache
def _group() -> "typer.core.TyperGroup":
    """Return the tree of all commands, made once a process."""
    group = typer.main.get_command(app)
    _fill_lines(group)
    return group


def _fill_lines(command: "typer.core.TyperCommand | typer.core.TyperGroup") -> None:
    """Join the lines of each paragraph of help, which a screen breaks itself."""
    parts = inspect.cleandoc(command.help or "").split("\n\n")
    command.help = "\n\n".join(" ".join(part.split()) for part in parts)
    for inner in getattr(command, "commands", {}).values():
        _fill_lines(inner)


def main() -> None:
    """Run the command line.

    The exit code is 0; 1, where a command found something (a contact, a false "free",
    a replay that differs); 2, where what was asked cannot be done, told in one
    sentence; 130: Ctrl-C, 143: SIGTERM, 129: SIGHUP, see `sim.terminal.interrupt`.
    """
    with interrupt.interruptible():
        group = _group()
        words = with_targets(sys.argv[1:], group)
        if told := nothing_given(words):
            print(told, file=sys.stderr)
            sys.exit(MISTAKE)
        try:
            code = group.main(words, prog_name="odm", standalone_mode=False)
            sys.stdout.flush()
        except Exception as error:
            told = no_room(error) or mistake(error, words, group)
            if told is None:
                raise
            if told:
                print(told, file=sys.stderr)
            code = MISTAKE
        sys.exit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()
