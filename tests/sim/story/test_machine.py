"""The table of a hand-over: whole, without traps, and drawn in the docs as it is."""

from pathlib import Path

import networkx as nx
import pytest

from roadmap.errors import BadInput
from sim.story import machine as m
from sim.story.machine import ENDS, SIGNALS, TABLES, Machine

DOC = (Path(__file__).parents[3] / "docs" / "story.md").read_text(encoding="utf-8")
BOTH = pytest.mark.parametrize("direction", list(TABLES))


def walk(direction, signals, state=None):
    """Return the states that a row of signals, one a frame, leads through."""
    machine = Machine(TABLES[direction], state or TABLES[direction][0].state)
    states = []
    for k, signal in enumerate(signals):
        machine.step({signal}, 0.1 * k)
        states.append(machine.state)
    return states, machine


@BOTH
def test_every_signal_is_known_and_every_state_leads_to_an_end(direction):
    rows = TABLES[direction]
    assert {row.signal for row in rows} <= set(SIGNALS)
    graph = nx.DiGraph([(row.state, row.then) for row in rows])
    for state in {row.state for row in rows}:
        assert any(nx.has_path(graph, state, end) for end in ENDS if end in graph)
        assert nx.has_path(graph, rows[0].state, state)


@BOTH
def test_no_state_lasts_for_ever(direction):
    timed = {row.state for row in TABLES[direction] if row.signal == "late"}
    assert timed == {row.state for row in TABLES[direction]}


def test_who_cannot_go_back_stands_and_says_so():
    states, machine = walk("receive", ["late"], m.RETREAT)
    assert states == [m.DONE] and machine.events[0].failure
    assert walk("receive", ["late_holding"], m.RETREAT)[0] == [m.KEPT]
    for direction, state in (("give", m.APPROACH), ("receive", m.CLOSE)):
        machine = Machine(TABLES[direction], state)
        row = machine.step({"hindered", "late"}, 0.0)
        assert row.failure and "slowed for the person" in machine.reason
    assert walk("give", ["late"], m.RELEASE)[0] == [m.KEPT]


def diagram(rows):
    """Return a table as a state diagram in the language of Mermaid."""
    lines = ["stateDiagram-v2", f"    [*] --> {rows[0].state}"]
    for row in rows:
        mark = " (!)" if row.failure else ""
        lines.append(f"    {row.state} --> {row.then}: {row.signal}{mark}")
    ends = [end for end in m.ENDS if any(row.then == end for row in rows)]
    return "\n".join([*lines, *(f"    {end} --> [*]" for end in ends)])


def as_markdown(rows):
    """Return a table for the docs: from, when, to, what happened."""
    lines = ["| in | when | then | what happened |", "|---|---|---|---|"]
    for row in rows:
        text = f"**{row.reason}**" if row.failure else row.reason
        lines.append(f"| {row.state} | {m.SIGNALS[row.signal]} | {row.then} | {text} |")
    return "\n".join(lines)


@BOTH
def test_the_docs_draw_this_very_table(direction):
    assert diagram(TABLES[direction]) in DOC
    assert as_markdown(TABLES[direction]) in DOC


def test_a_thing_is_given():
    signals = ["held", "arrived", "near", "pulled", "open", "away"]
    states, machine = walk("give", signals)
    wanted = [m.APPROACH, m.PRESENT, m.WAIT, m.RELEASE, m.RETREAT, m.DONE]
    assert states == wanted and machine.ended
    assert not any(event.failure for event in machine.events)


def test_a_thing_is_taken_and_put_down():
    signals = ["arrived", "steady", "free", "away_holding", "placed", "away"]
    states, machine = walk("receive", signals)
    wanted = [m.WAIT, m.CLOSE, m.RETREAT, m.PUT_DOWN, m.RETREAT, m.DONE]
    assert states == wanted and machine.ended


def test_what_is_put_between_the_fingers_is_taken_where_it_lies():
    for begin in (m.APPROACH, m.WAIT):
        states, machine = walk("receive", ["between", "free"], begin)
        assert states == [m.CLOSE, m.RETREAT]
        assert not any(event.failure for event in machine.events)


@pytest.mark.parametrize("away_s, since", [(0.01, 11.0), (0.7, 12.8)])
@pytest.mark.parametrize("leaps", [0.0, 10.0])
def test_who_stands_before_what_trembles_is_patient_once(away_s, since, leaps):
    """It followed each tremble, and its time began anew: it stood there for ever."""
    machine = m.Machine(TABLES["receive"], m.WAIT)
    machine.begin(11.0 - leaps)
    now = 11.0
    for signal, passed in (("moved", 0.2), ("arrived", away_s)) * 2:
        now += passed
        machine.leap(leaps if now < 11.3 and signal == "moved" else 0.0)
        machine.step({signal}, now)
    assert machine.state == m.WAIT and machine.since == pytest.approx(since)


FAILURES = [  # what goes wrong, and the way back
    ("give", m.FETCH, ["occupied", "away"], [m.RETREAT, m.DONE]),
    ("give", m.APPROACH, ["lost", "away"], [m.RETREAT, m.DONE]),
    ("give", m.WAIT, ["lost", "away"], [m.RETREAT, m.DONE]),
    ("give", m.PRESENT, ["left", "arrived"], [m.APPROACH, m.PRESENT]),
    ("give", m.APPROACH, ["pulled", "pulled", "open"], [m.WAIT, m.RELEASE, m.RETREAT]),
    ("give", m.WAIT, ["late", "placed", "away"], [m.PUT_DOWN, m.RETREAT, m.DONE]),
    ("give", m.WAIT, ["unfelt", "placed", "away"], [m.PUT_DOWN, m.RETREAT, m.DONE]),
    ("give", m.WAIT, ["weak_pull", "placed", "away"], [m.PUT_DOWN, m.RETREAT, m.DONE]),
    ("give", m.RELEASE, ["slack", "pulled"], [m.WAIT, m.RELEASE]),
    ("give", m.PUT_DOWN, ["late_holding"], [m.KEPT]),
    ("give", m.PUT_DOWN, ["beset"], [m.KEPT]),
    ("receive", m.PUT_DOWN, ["unreached"], [m.KEPT]),
    ("receive", m.PUT_DOWN, ["late", "away"], [m.RETREAT, m.DONE]),
    ("receive", m.CLOSE, ["missed", "away"], [m.RETREAT, m.DONE]),
    ("receive", m.CLOSE, ["lost", "away"], [m.RETREAT, m.DONE]),
    ("receive", m.CLOSE, ["blocked", "arrived"], [m.APPROACH, m.WAIT]),
    ("receive", m.CLOSE, ["in_vain", "away"], [m.RETREAT, m.DONE]),
    ("receive", m.CLOSE, ["late", "away"], [m.RETREAT, m.DONE]),
    ("receive", m.WAIT, ["left", "late", "away"], [m.APPROACH, m.RETREAT, m.DONE]),
    ("receive", m.PUT_DOWN, ["lost", "away"], [m.RETREAT, m.DONE]),
]


@pytest.mark.parametrize(("direction", "begin", "signals", "states"), FAILURES)
def test_what_goes_wrong_has_its_way_back(direction, begin, signals, states):
    found, machine = walk(direction, signals, begin)
    assert found == states
    first = machine.events[0]
    assert first.failure and first.reason


def test_the_first_row_that_holds_is_taken():
    machine = Machine(TABLES["give"], m.WAIT)
    machine.step({"late", "pulled", "lost"}, 1.0)  # a lost thing is not released
    assert machine.state == m.RETREAT and machine.since == 1.0
    assert machine.step(set(), 2.0) is None and machine.state == m.RETREAT


def test_a_beginning_that_is_none_is_refused_with_those_that_are():
    with pytest.raises(BadInput, match="'nap'.*choose one of fetch, approach"):
        Machine(TABLES["give"], "nap")
