"""Signs of life in a file or pipe, and what is still to be compiled."""

import json
import re
import sys
import time

import pytest

from roadmap.compiling.kernel_cache import kept_in
from sim.terminal import compiling, progress
from sim.terminal.checks import Limits
from sim.terminal.compiling import Compiling
from sim.terminal.progress import Bars, pulse, silence, time_text, times_text


def compute(seconds):
    """Compute for so long [s]: a busy machine has its other threads wait no less."""
    begun = time.process_time()
    while time.process_time() - begun < seconds:
        sum(range(100))


@pytest.fixture
def quick(monkeypatch):
    """Make lines come 40 times as often."""
    monkeypatch.setattr(progress, "FIRST_S", 0.02)
    monkeypatch.setattr(progress, "EVERY_S", 0.06)
    monkeypatch.setattr(progress, "_TICK_S", 0.01)


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """Return a folder with three loops, and a table that knows them and one more."""
    folder = tmp_path / "odm" / "search"
    (folder / "__pycache__").mkdir(parents=True)
    text = "\n".join(f"def {loop}(x):\n    pass" for loop in ("one", "two", "three"))
    (folder / "_step.py").write_text(text)
    rows = {f"odm.search._step.{n}": [10.0, "run"] for n in ("one", "two", "gone")}
    rows["odm.search._step.three"] = [70.0, "audit"]
    table = tmp_path / "table.json"
    table.write_text(json.dumps(rows))
    monkeypatch.setattr(compiling, "TABLE", table)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    compiling.table.cache_clear()
    yield tmp_path
    compiling.table.cache_clear()


def compiled(root, loop):
    name = f"_step.{loop}-12.py311.nbi"
    (root / "odm" / "search" / "__pycache__" / name).write_text("")


def test_lines_come_from_the_first_moment_and_say_how_far_it_is(quick, capsys):
    with pulse("doctor"):
        compute(0.3)
        with Bars("reading") as tell:
            tell("frames", 25, 100)
            compute(0.3)
        compute(0.3)
    lines = capsys.readouterr().err.splitlines()
    assert "loading" in lines[0] and len(lines) >= 3
    assert any(re.match(r"frames: 25 of 100", line) for line in lines)
    assert not any("\x1b" in line or "\r" in line for line in lines)


def test_nothing_is_imported_from_a_second_thread(quick, monkeypatch):
    monkeypatch.delitem(sys.modules, "roadmap.compiling.kernel_cache")
    with pulse("run"):
        compute(0.15)
    assert "roadmap.compiling.kernel_cache" not in sys.modules


def test_nothing_is_said_of_what_takes_no_time(capsys):
    with pulse("run"), Bars("reading") as tell:
        tell("frames", 1, 100)
    assert capsys.readouterr().err == ""


def test_a_screen_of_somebody_else_is_left_alone(quick, capsys):
    with pulse("run"):
        silence()
        compute(0.15)
    assert capsys.readouterr().err == ""


def test_a_command_within_another_tells_once(quick, capsys):
    with pulse("demo") as outer, pulse("build") as inner:
        assert inner is outer
    compute(0.1)
    assert capsys.readouterr().err == ""


def test_what_is_missing_is_counted_from_the_files(packages):
    run = Compiling("run", packages)
    assert set(run.wanted) == {"odm.search._step.one", "odm.search._step.two"}
    assert run.progress() == (0, 2, 20.0)
    compiled(packages, "one")
    done, total, left = run.progress()
    assert (done, total) == (1, 2) and left < 1.0  # half of it took no time here
    compiled(packages, "two")
    assert run.progress() is None


def test_a_command_that_needs_nothing_says_nothing(packages):
    assert Compiling("doctor", packages).progress() is None
    compiled(packages, "one")
    compiled(packages, "two")
    assert Compiling("run", packages).progress() is None
    assert Compiling("audit", packages).progress() == (0, 1, 70.0)


def test_a_cache_elsewhere_is_looked_into(packages, monkeypatch, tmp_path):
    compiled(packages, "two")  # beside the source, where numba does not look then
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    other = kept_in(packages / "odm" / "search")[1]
    other.mkdir(parents=True)
    (other / "_step.one-1.py311.nbi").write_text("")
    assert Compiling("run", packages).progress()[0] == 1


def test_the_table_of_this_checkout_names_loops_that_are_there():
    compiling.table.cache_clear()
    run = Compiling("run")
    assert len(run.wanted) > 150
    assert sum(run.wanted.values()) > 60.0
    there = sum(len(Compiling(c).wanted) for c in compiling.commands())
    named = sum(len(by) for _, by in compiling.table().values())
    assert there > 0.7 * named  # older names are of no harm, but not most of them


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.2, "1 s"), (89.4, "89 s"), (130.0, "2 min 10 s")]
)
def test_times_are_told_as_people_do(seconds, text):
    assert time_text(seconds) == text


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (Limits(), "a finite number"),
        (Limits(0.0, above=True), "a number above 0"),
        (Limits(0.0, 9.0, "s", above=True), "a number above 0, up to 9 s"),
        (Limits(2, 5, "m"), "a number from 2 to 5 m"),
        (Limits(2), "a number of at least 2"),
    ],
)
def test_limits_are_told_in_words(limits, words):
    assert limits.words() == words


@pytest.mark.parametrize(
    ("passed", "left", "text"),
    [(12.2, 3.0, "12 s, about 3 s left"), (130, None, "2 min 10 s"), (None, 9, "")],
)
def test_a_time_says_which_it_is(passed, left, text):
    assert times_text(passed, left) == text


def test_what_is_left_never_grows_while_nothing_is_told(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    tell = Bars()
    for now[0], done, line in (
        (0.0, 0, "nodes: 0 of 100"),
        (10.0, 20, "nodes: 20 of 100, about 40 s left"),
        (25.0, None, "nodes: 20 of 100, about 25 s left"),
        (90.0, None, "nodes: 20 of 100"),
        (100.0, 40, "nodes: 40 of 100, about 2 min 30 s left"),
    ):
        if done is not None:
            tell("nodes", done, 100)
        assert tell.line() == line


def test_a_stage_that_begins_again_is_timed_anew(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    tell = Bars()
    for now[0], done in ((0.0, 0), (90.0, 90), (91.0, 1), (100.0, 10)):
        tell("hands", done, 90)
    assert tell.line() == "hands: 10 of 90, about 72 s left"


def test_a_bar_of_a_stage_that_begins_again_is_reset(monkeypatch):
    monkeypatch.setattr(progress, "_is_terminal", lambda: True)
    with Bars() as tell:
        tell("hands", 90, 90)
        tell("hands", 1, 90)
        assert not tell._bars.tasks[0].finished


def test_the_pace_seen_here_counts_little_at_first(packages, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(compiling.time, "monotonic", lambda: now[0])
    rows = json.loads(compiling.TABLE.read_text())
    rows["odm.search._step.one"], rows["odm.search._step.three"] = (
        [5.0, "run"],
        [70.0, "run"],
    )
    compiling.TABLE.write_text(json.dumps(rows))
    compiling.table.cache_clear()
    run = Compiling("run", packages)
    for now[0] in (0.0, 40.0):  # what goes by before the first loop is no pace
        assert run.progress() == (0, 3, 85.0)
    compiled(packages, "one")
    now[0] = 65.0  # five times as long as the table says
    assert run.progress()[2] == pytest.approx(80.0 * 3.0)
    compiled(packages, "two")
    now[0] = 115.0
    assert run.progress()[2] == pytest.approx(70.0 * 5.0)


def test_a_bar_says_what_passed_and_what_is_left(monkeypatch, capsys):
    monkeypatch.setattr(progress, "_is_terminal", lambda: True)
    monkeypatch.setenv("COLUMNS", "100")
    with Bars() as tell:
        tell("frames", 1, 4)
        tell.compile((3, 9, 42.0))
    told = capsys.readouterr().err
    assert "frames" in told and "1/4" in told and "0:00" not in told
    with Bars() as tell:
        tell("frames", 1, 4)
        compute(0.02)
        tell("frames", 3, 4)
    assert re.search(r"3/4 1 s, about 1 s left", capsys.readouterr().err)


@pytest.mark.parametrize("columns", [40, 60, 100, 200])
def test_a_bar_is_a_whole_line_in_any_terminal(monkeypatch, capsys, columns):
    monkeypatch.setattr(progress, "_is_terminal", lambda: True)
    monkeypatch.setenv("COLUMNS", str(columns))
    with Bars() as tell:
        tell("the same with nobody", 1, 2000)
        compute(0.02)
        tell("the same with nobody", 2, 2000)
    told = capsys.readouterr().err
    assert "…" not in told and "2/2000" in told and " left" in told
