"""The `odm` command: one door to everything; each command says more with --help.

Commands import what they need when they run, so that `odm --help` answers at once.
"""

import sys

import typer

from sim.cli import (
    bench_command,
    build_command,
    camera_command,
    grasps_command,
    human_command,
    map_command,
    meet_command,
    replay_command,
    run_command,
    two_command,
    view,
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
    "view": view.view,
    "run-two": two_command.run_two,
    "camera": camera_command.camera,
    "bench": bench_command.bench,
    "warmup": build_command.warmup,
}
for name, command in COMMANDS.items():
    app.command(name)(guarded(command))
app.add_typer(human_command.app, name="human")
app.add_typer(meet_command.app, name="workspace")
app.add_typer(grasps_command.app, name="grasps")


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


if __name__ == "__main__":
    main()
