"""What all commands share: errors as one sentence, progress bars, whole files."""

import contextlib
import functools
import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

import typer

from sim.terminal import interrupt

# modules that come with an extra of the package only
EXTRAS = {
    "pybullet": "sim",
    "pybullet_data": "sim",
    "matplotlib": "sim",
    "PIL": "sim",
    "viser": "view",
    "ompl": "bench",
    "pinocchio": "bench",
}


def guarded(command: Callable) -> Callable:
    """Return the command with its errors as one sentence and an exit code.

    1: the planner's own errors, a missing extra, a file that cannot be read or
    written; 130: Ctrl-C. Anything else is a fault of ours and keeps its traceback.
    """

    @functools.wraps(command)
    def run(*args: object, **kwargs: object) -> object:
        try:
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
            _leave(told, 1)

    return run


def _sentence(error: Exception) -> str | None:
    """Return what a user should read, None for what is no user's business."""
    if isinstance(error, ModuleNotFoundError):
        root = (error.name or "").split(".")[0]
        extra = EXTRAS.get(root)
        return extra and (
            f"this needs {root}, which is not installed; "
            f"run: pip install 'odm-planner[{extra}]'"
        )
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}"
    if isinstance(error, MemoryError):
        return "there is not enough memory; take larger cells or fewer nodes"
    # not imported above: it brings numba along, and --help should be quick
    errors = sys.modules.get("roadmap.errors")
    if errors is not None and isinstance(error, errors.PlanningError):
        return str(error)
    return None


def _stop() -> None:
    if not interrupt.noted():  # where it was, the end of the command tells
        print(interrupt.SENTENCE, file=sys.stderr)
    raise typer.Exit(interrupt.EXIT_CODE)


def _leave(sentence: str, code: int) -> None:
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
    """Let `write` fill a file that is there whole or not at all; makes its folder."""
    from roadmap.unfinished import beside  # not above: --help should be quick

    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with beside(path) as made:
        with open(made, "xb") as stream:
            write(stream)
        os.replace(made, path)
    return path


@contextlib.contextmanager
def stdout_to_stderr() -> Iterator[None]:
    """Send what compiled libraries print to stderr, so that stdout stays clean."""
    sys.stdout.flush()
    try:
        kept = os.dup(1)
    except OSError:  # there is no stdout
        yield
        return
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


class Bars:
    """Progress bars on stderr, one for each stage; use it as `with Bars() as tell:`.

    Args:
        waiting: Said until the first stage begins; the first run ever compiles then.
    """

    def __init__(self, waiting: str = "preparing (the first time compiles)") -> None:
        """Lay out the columns."""
        from rich import progress
        from rich.console import Console

        self._bars = progress.Progress(
            progress.TextColumn("{task.description:<22}"),
            progress.BarColumn(bar_width=28),
            progress.MofNCompleteColumn(),
            progress.TimeElapsedColumn(),
            progress.TextColumn("left"),
            progress.TimeRemainingColumn(),
            console=Console(stderr=True),
        )
        self._tasks: dict = {}
        self._waiting = waiting

    def __enter__(self) -> "Bars":
        """Show the bars."""
        self._bars.start()
        self._first = self._bars.add_task(self._waiting, total=None)
        return self

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Show how far a stage is; what every `progress=` argument wants."""
        if self._first is not None:
            self._bars.remove_task(self._first)
            self._first = None
        if stage not in self._tasks:
            self._tasks[stage] = self._bars.add_task(stage, total=total)
        self._bars.update(self._tasks[stage], completed=done, total=total)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the bars as they are."""
        if self._first is not None:
            self._bars.remove_task(self._first)
        self._bars.stop()


def bytes_text(size: float) -> str:
    """Return a size for people: 12.3 MB."""
    for unit in ("bytes", "kB", "MB", "GB"):
        if size < 1000 or unit == "GB":
            return f"{size:.3g} {unit}"
        size /= 1000
    raise AssertionError("unreachable")
