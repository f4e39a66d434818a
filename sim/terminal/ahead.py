"""Loops compiled ahead of a command, by as many processes as there are free cores.

Numba compiles a loop when it is first called, one after the other. What it will be
asked for is known: `compile_jobs.json` holds the types that each command calls each
loop with (see `sim/bench/compile_jobs.py`). So processes take loops from that list,
those first that call no other, and each loads from numba's cache what another one has
finished. A row that no longer fits is passed over: the table decides how long the
wait is, never what is compiled in the end.
"""

import dis
import gc
import importlib
import json
import multiprocessing
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from roadmap.builds.unfinished import temporary_folder
from sim.terminal.compiling import Compiling

TABLE = Path(__file__).with_name("compile_jobs.json")
WORTH_S = 10.0  # of the table's seconds; less is compiled sooner than processes begin
MOST_PROCESSES = 4  # each takes half a gigabyte
_WAIT_S = 0.02


def compile_ahead(command: str) -> int:
    """Compile what a command needs, if much is missing and there are two cores.

    Returns how many loops were compiled, each for some types, those already there
    included.
    """
    processes = min(MOST_PROCESSES, len(os.sched_getaffinity(0)))
    if processes < 2 or sum(Compiling(command).missing().values()) < WORTH_S:
        return 0
    with temporary_folder() as folder:
        with _beside(processes - 1, folder, command) as others:
            _work(folder, command, others)
        return sum(name.endswith(".done") for name in os.listdir(folder))


def compile_for(command: str) -> int:
    """Compile what a command needs, on one core, too; return how many were missing."""
    missing = len(Compiling(command).missing())
    if missing and not compile_ahead(command):
        with temporary_folder() as folder:
            compile_all(command, folder)
    return missing


def compile_all(command: str, folder: Path) -> list:
    """Compile what a command needs in this process alone; return its loops.

    In the empty `folder` there are notes of what is done.
    """
    _work(folder, command, [])
    return [loop for loop, *_ in _jobs(command)]


@contextmanager
def _beside(number: int, folder: Path, command: str) -> Iterator[list]:
    """Yield processes that do the same; none is left afterwards."""
    # not above: a bar needs no planner
    from odm.processes import end_processes, ignoring_interrupts

    context = multiprocessing.get_context("spawn")
    given = (folder, command, gc.get_threshold(), os.getpid())
    others = [context.Process(target=_child, args=given) for _ in range(number)]
    try:
        for other in others:
            with ignoring_interrupts():
                other.start()
        yield others
    finally:
        end_processes(others)


def _child(
    folder: Path, command: str, collect: tuple[int, int, int], parent: int
) -> None:
    gc.set_threshold(*collect)
    with suppress(FileNotFoundError):  # the folder is gone: so is the need for us
        _work(folder, command, [], parent)


def _work(folder: Path, command: str, others: list, parent: int | None = None) -> None:
    """Compile until nothing is left; return when a process that has a loop is gone."""
    jobs = _jobs(command)
    left = list(range(len(jobs)))
    while left:
        if parent is not None and os.getppid() != parent:
            return
        there = set(os.listdir(folder))
        left = [k for k in left if f"{k}.taken" not in there]
        ready = [k for k in left if all(f"{n}.done" in there for n in jobs[k][2])]
        if any(_take(folder, k, jobs[k]) for k in ready):
            continue
        under_way = sum(n.endswith(".taken") for n in there)
        if not ready and under_way == sum(n.endswith(".done") for n in there):
            return  # they wait for each other
        if others and not all(other.is_alive() for other in others):
            return
        time.sleep(_WAIT_S)
    while others and all(other.is_alive() for other in others):
        time.sleep(_WAIT_S)  # the last ones


def _take(folder: Path, k: int, job: tuple) -> bool:
    """Compile a loop that nobody has begun; False if somebody has."""
    try:
        (folder / f"{k}.taken").touch(exist_ok=False)
    except FileExistsError:
        return False
    loop, types, _ = job
    with suppress(Exception):  # whoever needs it will tell
        loop.compile(types)
    (folder / f"{k}.done").touch()
    return True


def _jobs(command: str) -> list[tuple]:
    """Return (loop, types, jobs that come before it) of a command."""
    from numba.core.dispatcher import Dispatcher

    table = json.loads(TABLE.read_text(encoding="utf-8"))
    types = decoded(table["types"])
    found = []
    for module, name, given, commands in table["jobs"]:
        with suppress(ImportError):
            loop = getattr(importlib.import_module(module), name, None)
            needed = command in commands.split()
            if needed and isinstance(loop, Dispatcher):
                found.append((loop, tuple(types[i] for i in given)))
    of_loop: dict[object, list[int]] = {}
    for k, (loop, _) in enumerate(found):
        of_loop.setdefault(loop, []).append(k)
    jobs = []
    for loop, given in found:
        scope, code = loop.py_func.__globals__, dis.get_instructions(loop.py_func)
        names = {step.argval for step in code if step.opname == "LOAD_GLOBAL"}
        called = {id(v): v for n in names if isinstance(v := scope.get(n), Dispatcher)}
        before = [k for other in called.values() for k in of_loop.get(other, ())]
        jobs.append((loop, given, tuple(before)))
    return jobs


def decoded(rows: list) -> list:
    """Return numba's types of the table's rows; None where one is not known here."""
    from numba import types

    found: list = []
    for kind, *row in rows:
        one = None
        with suppress(AttributeError, ImportError):
            if kind == "array":
                dtype, rank, layout, readonly, aligned = row
                one = types.Array(found[dtype], rank, layout, readonly, aligned=aligned)
            elif kind == "tuple":
                module, name, members = row
                plain = None if module is None else importlib.import_module(module)
                given = plain and getattr(plain, name)
                one = types.BaseTuple.from_types([found[i] for i in members], given)
            elif kind == "literal":
                one = types.literal(row[0])
            else:
                one = getattr(types, row[0])
        found.append(one)
    return found
