"""What all commands share: errors as one sentence, whole files."""

import contextlib
import errno
import functools
import json
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import typer
from rich.filesize import decimal as bytes_text  # noqa: F401 (of 12.3 MB)

from sim.terminal import interrupt
from sim.terminal.checks import EXTRAS, Refused
from sim.terminal.progress import Bars as Bars  # where commands look for it
from sim.terminal.progress import pulse

_REMEDIES = (  # of Python, and of the command line
    (r"; change it in \w+Settings$", "; choose another value, see --help"),
    (r"in PlannerSettings\(finger_pads=\.\.\.\)$", "with --pads LINK"),
    (r"check its pose T_base_camera$", "check --eye, or --pose"),
    (
        r"give it as source of the \[robot\] of a recipe$",
        "give it with --robot, and the link of its tool with --tip",
    ),
)
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_PLACES = {  # what to do about a file, by what the system says
    **dict.fromkeys(_FULL, "free some room, or choose another place"),
    errno.ENOENT: "check the path",
    errno.EISDIR: "name a file in it",
    errno.EACCES: "change its permissions, or choose another place",
}
FINDING, MISTAKE = 1, 2  # exit codes: something was found; it could not be done


def guarded(command: Callable) -> Callable:
    """Return the command with its errors as one sentence and an exit code.

    2: what was asked cannot be done: the planner's own errors, a missing extra, a file
    that cannot be read or written; 130: Ctrl-C; 143: SIGTERM; 129: SIGHUP. A command
    leaves with 1 itself, where it found something. Anything else is a fault of ours and
    keeps its traceback.
    """

    @functools.wraps(command)
    def run(*args: object, **kwargs: object) -> object:
        try:
            with pulse(command.__name__):
                return command(*args, **kwargs)
        except KeyboardInterrupt:
            _stop()
        except BrokenPipeError:
            # whoever read our output has seen enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        except Exception as error:
            if interrupt.noted():  # a library that was just imported swallowed it
                _stop()
            told = _sentence(error)
            if told is None:
                raise
            leave(told, MISTAKE)

    return run


def _sentence(error: Exception) -> str | None:
    """Return what a user should read, None for what is no user's business."""
    if isinstance(error, Refused):
        return str(error)
    if isinstance(error, ModuleNotFoundError):
        root = (error.name or "").split(".")[0]
        extra = EXTRAS.get(root)
        return extra and (
            f"this needs {root}, which is not installed; "
            f"run: pip install 'odm-planner[{extra}]'"
        )
    if isinstance(error, OSError) and error.filename is not None:
        remedy = _PLACES.get(error.errno or 0, "choose another place")
        return f"{error.filename}: {error.strerror}; {remedy}"
    if isinstance(error, MemoryError):
        return "there is not enough memory; take larger cells or fewer nodes"
    # not imported above: it brings numba along, and --help should be quick
    errors = sys.modules.get("roadmap.errors")
    if errors is not None and isinstance(error, errors.PlanningError):
        text = str(error)
        for python, typed in _REMEDIES:
            text = re.sub(python, typed, text)
        return text
    return None


def no_room(error: Exception) -> str | None:
    """Return what to read where standard output could not be written, else None."""
    full = isinstance(error, OSError) and error.filename is None
    if not full or error.errno not in _FULL:
        return None
    with contextlib.suppress(OSError):  # what is still to be written has no room, too
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return (
        f"odm: standard output could not be written: {error.strerror}; free some "
        "room, or send it elsewhere"
    )


def _stop() -> None:
    if not interrupt.noted():  # where it was, the end of the command tells
        print(interrupt.SENTENCE, file=sys.stderr)
    raise typer.Exit(interrupt.exit_code())


def leave(sentence: str, code: int) -> None:
    """End a command with one sentence on stderr and an exit code."""
    print(f"odm: {' '.join(sentence.split())}", file=sys.stderr)
    raise typer.Exit(code)


def show_json(data: object, target: str) -> None:
    """Write plain data as JSON to the file `target`, or print it for '-'."""
    text = json.dumps(data, indent=1, allow_nan=False) + "\n"
    if target == "-":
        sys.stdout.write(text)
    else:
        write_text(target, text)


def report(facts: dict, json: str | None, show: Callable[[dict], object]) -> None:
    """Write facts as JSON where that is asked for, and show them unless it is shown."""
    if json is not None:
        show_json(facts, json)
    if json != "-":
        show(facts)


def write_text(path: str | Path, text: str) -> Path:
    """Write a file whole or not at all; missing folders are made."""
    return write_whole(path, lambda stream: stream.write(text.encode("utf-8")))


def write_whole(path: str | Path, write: Callable[[BinaryIO], object]) -> Path:
    """Let `write` fill a file that is there whole or not at all; makes its folder.

    A device or a pipe, such as /dev/stdout, is written to; of a link, what it names.
    Returns the path as it was given, which is how a user knows it.
    """
    from roadmap.builds.unfinished import beside, is_special  # --help is quick

    path = Path(path)
    if is_special(path):
        try:
            with open(path, "wb") as stream:
                write(stream)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(path)) from error
        return path
    target = path.resolve()
    target.parent.mkdir(parents=True, exist_ok=True)
    with beside(target) as made:
        with open(made, "xb") as stream:
            write(stream)
        os.replace(made, target)
    return path


def counted(n: int, what: str) -> str:
    """Return a count for people: "1 edge", "12,345 edges"."""
    return f"{n:,} {what}{'' if n == 1 else 's'}"
