"""`odm bench golden`: whether two checkouts decide the same in everything golden.

A net for changes that shall change nothing. The same work is done in another checkout
and in this one, each in a process of its own that knows the checkout by its public
names alone (`golden_work.py`): maps, motions, frames with their answers and questions,
runs with every frame recorded, sentences and help. All bytes that do not come from a
clock are compared.

    odm bench golden --against DIR               # another checkout and this one
    odm bench golden --against DIR --short       # most runs left out
    odm bench golden --against DIR --only frames --only "bad calls"
    odm bench golden --write FILE.json           # keep what this one does
    odm bench golden --read FILE.json            # and compare with it later
    odm bench golden --against DIR --latency     # frames timed in turn, old and new

What was kept is of use on the same machine only, with the same packages: the last bits
of floats depend on the processor. A checkout whose kernels were not compiled yet
compiles them first, for minutes. Not compared: what keys do (`--motion keyboard` goes
by the clock), latency figures and plots of them, and `odm demo`.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

import roadmap
from roadmap.errors import BadInput
from sim.tables.header import header

WORK = Path(__file__).with_name("golden_work.py")
HERE = Path(roadmap.__file__).resolve().parents[1]
SHORT = "short"  # the script's word for the items that take little time
SAME, DIFFERENT, FAILED, WRITTEN = "same", "DIFFERENT", "FAILED", "written"
_MOST = 160  # letters of a line that is shown


def run(
    against: str | Path | None = None,
    write: str | Path | None = None,
    read: str | Path | None = None,
    only: Sequence[str] = (),
    latency: bool = False,
    short: bool = False,
    processes: int = 1,
    rounds: int = 7,
    tell: Callable[[str], None] | None = None,
) -> dict:
    """Compare what two checkouts do, or keep what this one does.

    Args:
        against: Folder of the other checkout.
        write: File for what came of this one.
        read: File that was written before, instead of `against`.
        only: Names of items; none: all.
        latency: Time frames instead, in both checkouts in turn.
        short: Leave out most runs: a third of the time.
        processes: 2: both checkouts at the same time.
        rounds: Of the timed frames.
        tell: Called with what is about to be done.

    Returns:
        Plain data for JSON: "header", "setup", "rows", "tables", and "exit_code", which
        is 1 where anything differs.

    Raises:
        BadInput: Nothing to compare with, or to write; no such item, file or checkout.
    """
    tell = tell or (lambda text: None)
    other = None if against is None else _checkout(Path(against))
    if latency:
        if other is None:
            raise BadInput("--latency compares two checkouts; add --against DIR")
        return _timed(other, rounds, tell)
    if other is None and write is None and read is None:
        raise BadInput("nothing to compare with; give --against, --read or --write")
    if other is not None and read is not None:
        raise BadInput("--against and --read are two others; leave one out")
    kept = None if read is None else _kept(Path(read), only)
    named = list(only) or ([SHORT] if short else list(kept or ()))
    with tempfile.TemporaryDirectory(prefix="golden") as folder:
        asked = [("new", HERE)] if other is None else [("old", other), ("new", HERE)]
        found = _worked(asked, named, Path(folder), processes, tell)
    if write is not None:
        text = json.dumps(found["new"])
        Path(write).write_text(text, encoding="utf-8")
    old = found.get("old") if kept is None else kept
    return _result(old, found["new"], str(against or read or write))


# --- the work -------------------------------------------------------------------------


def _checkout(folder: Path) -> Path:
    if not (folder / "roadmap" / "__init__.py").is_file():
        raise BadInput(f"{folder} is no checkout of odm: it has no package roadmap")
    return folder.resolve()


def _kept(file: Path, only: Sequence[str]) -> dict:
    try:
        kept = json.loads(file.read_text(encoding="utf-8"))
        for item in kept.values():
            item["lines"], item["failed"]
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise BadInput(
            f"{file} was not written by `odm bench golden --write`; write it again"
        ) from error
    for name in only:
        if name not in kept:
            raise BadInput(f"{file} holds no item {name!r}; it has {', '.join(kept)}")
    return {name: kept[name] for name in only or kept}


def _started(
    checkout: Path, words: Sequence[str], **options: object
) -> subprocess.Popen:
    """Start the script with a checkout's packages, far from any other's."""
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    command = [sys.executable, "-P", str(WORK), str(checkout), *words]
    return subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, text=True, **options
    )


def _worked(
    asked: list[tuple[str, Path]],
    items: Sequence[str],
    folder: Path,
    processes: int,
    tell: Callable[[str], None],
) -> dict[str, dict]:
    """Return what came of the items in each checkout, by its name."""
    running, found = [], {}
    with ExitStack() as stack:
        for name, checkout in asked:
            place = folder / name
            place.mkdir()
            noise = stack.enter_context(open(place / "noise.txt", "w+"))
            words = (str(place / "shop"), str(place / "out.json"), *items)
            options = {"stderr": noise, "cwd": place}
            work = stack.enter_context(_started(checkout, words, **options))
            stack.callback(work.kill)
            running.append((name, place, work, noise))
            if processes < 2:
                _finish(*running.pop(), found, tell)
        for one in running:
            _finish(*one, found, tell)
    return found


def _finish(
    name: str,
    place: Path,
    work: subprocess.Popen,
    noise: object,
    found: dict,
    tell: Callable[[str], None],
) -> None:
    """Wait for one checkout's work and take its result."""
    for line in work.stdout:
        tell(f"{name}: {line.strip()}")
    if work.wait() != 0:
        noise.seek(0)
        last = [line for line in noise.read().splitlines() if line.strip()][-1:]
        raise BadInput(f"the golden work ended in the {name} checkout: {''.join(last)}")
    found[name] = json.loads((place / "out.json").read_text(encoding="utf-8"))


# --- what differs ---------------------------------------------------------------------


def _result(old: dict | None, new: dict, other: str) -> dict:
    none = {"lines": [], "failed": None, "seconds": 0.0}
    before = {name: None if old is None else old.get(name, none) for name in new}
    rows = [_row(name, before[name], side) for name, side in new.items()]
    bad = sum(row[1] in (DIFFERENT, FAILED) for row in rows)
    told = WRITTEN if old is None else "all the same"
    title = f"golden: {told if not bad else f'{bad} of {len(rows)} items differ'}"
    head = ["item", "result", "lines", "CPU", "first difference"]
    return {
        "bench": "golden",
        "header": header(),
        "setup": {"with" if old is not None else "written to": other},
        "rows": [],
        "tables": [{"title": title, "head": head, "rows": rows}],
        "exit_code": int(bad > 0),
    }


def _row(name: str, old: dict | None, new: dict) -> list[str]:
    """Return name, verdict, number of lines, CPU time and the first difference."""
    verdict, told = SAME, ""
    failed = [side for side in (old, new) if side is not None and side["failed"]]
    if failed:
        both = old is not None and old["failed"] == new["failed"]
        where = "in both" if both else "old" if failed[0] is old else "new"
        verdict, told = FAILED, f"{where}: {failed[0]['failed']}"[:_MOST]
    elif old is None:
        verdict = WRITTEN
    elif difference := first_difference(old["lines"], new["lines"]):
        verdict, told = DIFFERENT, difference
    times = [f"{side['seconds']:.1f} s" for side in (old, new) if side is not None]
    return [name, verdict, str(len(new["lines"])), " / ".join(times), told]


def first_difference(old: Sequence[str], new: Sequence[str]) -> str:
    """Return in words where two lists of lines first differ, "" where they do not."""
    pairs = zip(old, new, strict=False)
    unlike = [k for k, (a, b) in enumerate(pairs) if a != b]
    if not unlike:
        if len(old) == len(new):
            return ""
        lines = old if len(old) > len(new) else new
        side = "gone" if lines is old else "new"
        first = _short(lines[min(len(old), len(new))])
        return f"{abs(len(old) - len(new))} lines are {side}, the first is: {first}"
    k = unlike[0]
    before, after = _apart(old[k], new[k])
    more = len(unlike) - 1 + abs(len(old) - len(new))
    rest = f"; {more} more lines differ" if more else ""
    return f"line {k + 1}, {before} became {after}{rest}"


def _apart(old: str, new: str) -> tuple[str, str]:
    """Return two lines, the second one from a little before where they part."""
    at = len(os.path.commonprefix([old, new]))
    at = old.rfind(" ", 0, at) + 1
    begin = old[:at] if at <= _MOST else f"{old[: _MOST // 2]}... {old[at - 40 : at]}"
    return f"{begin}{_short(old[at:])!r}", repr(_short(new[at:]))


def _short(text: str) -> str:
    return text if len(text) <= _MOST else text[: _MOST - 3] + "..."


# --- frames timed in turn -------------------------------------------------------------


def _timed(other: Path, rounds: int, tell: Callable[[str], None]) -> dict:
    """Let both checkouts time the same frames in turn; compare CPU times."""
    times: dict[str, list[dict]] = {"old": [], "new": []}
    with tempfile.TemporaryDirectory(prefix="golden") as folder, ExitStack() as stack:
        workers = {}
        for name, checkout in (("old", other), ("new", HERE)):
            place = Path(folder, name)
            place.mkdir()
            tell(f"{name}: map and first frames")
            options = {"stdin": subprocess.PIPE, "cwd": place}
            work = _started(checkout, (str(place / "shop"), "time"), **options)
            stack.enter_context(work)
            stack.callback(work.kill)
            workers[name] = work
            _answer(name, work)
        for k in range(rounds):
            tell(f"round {k + 1} of {rounds}")
            for name in ("old", "new") if k % 2 == 0 else ("new", "old"):
                workers[name].stdin.write("go\n")
                workers[name].stdin.flush()
                times[name].append(json.loads(_answer(name, workers[name])))
    rows = [row for kind in times["old"][0] for row in _time_rows(kind, times)]
    head = ["frames", "old", "new", "new / old", "in single rounds"]
    return {
        "bench": "golden",
        "header": header(),
        "setup": {"with": str(other), "rounds": rounds, "times": "CPU of the thread"},
        "rows": [],
        "tables": [{"title": "golden: latency", "head": head, "rows": rows}],
    }


def _answer(name: str, work: subprocess.Popen) -> str:
    line = work.stdout.readline()
    if not line:
        raise BadInput(f"the timed frames ended in the {name} checkout; see above")
    return line


def _time_rows(kind: str, times: dict[str, list[dict]]) -> Iterator[list[str]]:
    """Yield a row for the median and one for the slowest hundredth of the frames."""
    for share in (50, 99):
        old, new = (
            np.array([np.percentile(r[kind], share) for r in times[side]]) / 1000.0
            for side in ("old", "new")
        )
        ratio = new / old
        yield [
            f"{kind}, p{share}",
            f"{np.median(old):.1f} us",
            f"{np.median(new):.1f} us",
            f"{np.median(new) / np.median(old):.3f}",
            f"{ratio.min():.3f} to {ratio.max():.3f}",
        ]
