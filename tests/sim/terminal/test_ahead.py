"""What is compiled ahead: the table fits the loops, one process begins each of them."""

import importlib
import json
import os
import threading
from pathlib import Path

import numpy as np
import pytest
from numba import njit, types
from numba.core.dispatcher import Dispatcher

from odm import Obstacles, ReactivePlanner, sample_capsules
from roadmap.motion.motion import time_path
from sim.bench.compile_jobs import Types
from sim.terminal import ahead
from sim.terminal.compiling import Compiling


def test_types_come_back_as_they_were_written():
    from odm.close_test._arm import Arm

    array = types.Array(types.float64, 2, "C", readonly=True)
    named = types.BaseTuple.from_types([array, types.int32], None)
    arm = types.BaseTuple.from_types([array] * 7, Arm)
    given = [array, types.boolean, types.literal(-1), named, arm, types.uint64]
    table = Types([])
    at = [table.add(one) for one in given]
    there = ahead.decoded(json.loads(json.dumps(table.rows)))
    assert [there[k] for k in at] == given


@pytest.mark.parametrize("command", ["run", "story", "warmup"])
def test_the_table_names_loops_that_are_there(command):
    jobs = ahead._jobs(command)
    rows = json.loads(ahead.TABLE.read_text())["jobs"]
    named = sum(command in by.split() for *_, by in rows)
    remedy = f"python -m sim.bench.compile_jobs {command} FOLDER"
    assert len(jobs) > 0.95 * named > 0, remedy
    for k, (loop, given, before) in enumerate(jobs):
        assert isinstance(loop, Dispatcher)
        assert None not in given
        assert k not in before
    done: set[int] = set()
    while ready := [
        k for k, job in enumerate(jobs) if {*job[2]} <= done and k not in done
    ]:
        done.update(ready)
    assert len(done) == len(jobs), "some wait for each other"


def test_every_row_of_the_table_fits_the_loop_as_it_is():
    """Else that loop is compiled when it is called first, maybe in a frame."""
    table = json.loads(ahead.TABLE.read_text(encoding="utf-8"))

    def fits(k):
        kind, *row = table["types"][k]
        if kind != "tuple":
            return True
        module, name, members = row
        if name and len(getattr(importlib.import_module(module), name)._fields) != len(
            members
        ):
            return False
        return all(map(fits, members))

    for module, name, given, _ in table["jobs"]:
        loop = getattr(importlib.import_module(module), name, None)
        assert isinstance(loop, Dispatcher), name
        assert loop.py_func.__code__.co_argcount == len(given), name
        assert all(map(fits, given)), name


def read_only(array):
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    "laid_out",
    [read_only, np.asfortranarray, np.float32, lambda a: np.repeat(a, 2, 0)[::2]],
    ids=["read-only", "by columns", "float32", "strided"],
)
def test_arrays_laid_out_in_other_ways_ask_for_no_other_loop(small_map, laid_out):
    """It would be compiled in the frame that has them: 0.3 s, and more."""

    def compiled():
        return {
            (loop.py_func.__module__, loop.py_func.__name__, *map(str, given))
            for loop in all_loops
            for given in loop.signatures
        }

    table = json.loads(ahead.TABLE.read_text())
    loaded = map(importlib.import_module, sorted({name for name, *_ in table["jobs"]}))
    all_loops = [
        one for module in loaded for one in vars(module).values()
        if isinstance(one, Dispatcher)
    ]  # fmt: skip
    before = compiled()
    start, goal = np.float64(small_map.roadmap.nodes[[0, -1]])
    q, path = laid_out(start[None])[0], laid_out(np.stack([start, goal]))
    points = laid_out(np.random.default_rng(0).normal([0.6, 0.3, 0.5], 0.1, (99, 3)))
    rods = laid_out(np.array([[0.6, 0.2, 0.4, 0.6, 0.5, 0.6, 0.05]]))
    planner = ReactivePlanner(small_map)
    planner.set_goals([path[1]])
    for seen in points, sample_capsules(rods), Obstacles(capsules=rods, points=points):
        planner.step(seen, q=q, dq=np.zeros_like(q))
        planner.improve()
        planner.blocked_leg(path, 0.05, points)
        planner.separation(q)
        planner.evasion(q, [(0.1, points)], 0.5)
        planner.expect(points)
        planner.see(seen, q)
    planner.set_base(laid_out(np.eye(4)))
    planner.set_static(laid_out(np.full((3, 3), 5.0)))
    time_path(small_map.robot, path).at(0.1)
    types_of = ahead.decoded(table["types"])
    known = {
        (module, name, *(str(types_of[k]) for k in given))
        for module, name, given, _ in table["jobs"]
    }
    assert compiled() - before <= known


def test_each_loop_is_compiled_once_and_after_those_it_calls(tmp_path, monkeypatch):
    order = []

    class Loop:
        def __init__(self, name):
            self.name = name

        def compile(self, given):
            order.append(self.name)

    jobs = [(Loop("top"), (), (1, 2)), (Loop("a"), (), ()), (Loop("b"), (), (1,))]
    monkeypatch.setattr(ahead, "_jobs", lambda command: jobs)
    two = [
        threading.Thread(target=ahead._work, args=(tmp_path, "run", []))
        for _ in range(2)
    ]
    for one in two:
        one.start()
    for one in two:
        one.join()
    assert order == ["a", "b", "top"]


def test_loops_that_wait_for_each_other_keep_nobody_waiting(tmp_path, monkeypatch):
    monkeypatch.setattr(ahead, "_jobs", lambda command: [(None, (), (0,))])
    ahead._work(tmp_path, "run", [])
    assert list(tmp_path.iterdir()) == []


def test_a_loop_that_cannot_be_compiled_keeps_nobody_waiting(tmp_path):
    @njit
    def adds(a):
        return a + 1

    bad, good = types.Array(types.int64, 1, "C"), types.unicode_type
    assert ahead._take(tmp_path, 0, (adds, (good,), ()))
    assert not ahead._take(tmp_path, 0, (adds, (bad,), ()))
    assert (tmp_path / "0.done").exists()
    assert adds.signatures == []


def test_nothing_is_begun_on_one_core_or_where_all_is_compiled(monkeypatch):
    def refuse(*given):
        raise AssertionError("a process was begun")

    monkeypatch.setattr(ahead, "_beside", refuse)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0})
    assert ahead.compile_ahead("run") == 0
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1})
    monkeypatch.setattr(ahead, "Compiling", lambda command: _Nothing())
    assert ahead.compile_ahead("run") == 0


def test_on_one_core_it_is_compiled_in_this_process(monkeypatch):
    asked = []
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0})
    monkeypatch.setattr(ahead, "Compiling", lambda command: _Missing())
    monkeypatch.setattr(ahead, "_work", lambda folder, *given: asked.append(given))
    assert ahead.compile_for("run") == 2
    assert asked == [("run", [])]
    monkeypatch.setattr(ahead, "Compiling", lambda command: _Nothing())
    assert ahead.compile_for("run") == 0
    assert len(asked) == 1


class _Missing:
    def missing(self):
        return {"a": 20.0, "b": 20.0}


class _Nothing:
    def missing(self):
        return {}


def test_the_others_end_with_the_command(monkeypatch):
    with ahead._beside(1, Path("/nowhere"), "run") as others:
        assert others[0].is_alive()
    assert not others[0].is_alive()


@pytest.mark.parametrize("command", ["run", "story", "warmup"])
def test_what_is_compiled_ahead_is_what_is_told_to_be_missing(command):
    """Two tables: the types of the loops of a command, and what each loop costs."""
    rows = json.loads(ahead.TABLE.read_text())["jobs"]
    ours = [row for row in rows if command in row[3].split()]
    compiled = {f"{module}.{name}" for module, name, *_ in ours}
    told = set(Compiling(command).wanted)
    assert len(compiled & told) > 0.95 * len(compiled | told)
