"""What a frame comes to is a table: complete, drawn in the docs, and true."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from small import AWAY, HOME, NOBODY, ball_at

from odm.planner import decision
from odm.planner.decision import (
    BETTER_GOAL,
    FEW,
    JOIN,
    JUMPED,
    LINGERS,
    MANY,
    MOVES,
    NEW_GOALS,
    NO_PATH,
    NOT_JOINED,
    NOTHING,
    STANDS,
)
from roadmap.kinematics.forward import tool_pose

DOC = Path(__file__).resolve().parents[3] / "docs" / "planner.md"
CASES = (NEW_GOALS, LINGERS, NOT_JOINED, NO_PATH, BETTER_GOAL)


def test_the_page_draws_the_table_row_by_row():
    rows = [" | ".join((*key, value)) for key, value in JOIN.items()]
    drawn = [
        line.strip("| ")
        for line in DOC.read_text(encoding="utf-8").splitlines()
        if line.startswith("|") and line.split("|")[1].strip() in CASES
    ]
    assert drawn == rows


def test_rows_name_what_there_is_and_join_more_or_anew():
    known = set(product(CASES, (STANDS, MOVES, JUMPED), (NOTHING, FEW)))
    assert set(JOIN) <= known and set(JOIN.values()) == {FEW, MANY}
    again = {key for key, value in JOIN.items() if key[2] == value}
    assert again == {(NEW_GOALS, STANDS, FEW)}  # towards the new goals


@pytest.fixture
def joined(planner, monkeypatch):
    """(case, robot, joined to, now) of every look at the table."""
    planner.always_replan = False
    seen, attach = [], planner.attacher.attach_start

    class Table(dict):
        def get(self, key):
            seen.append((*key, dict.get(self, key)))
            return seen[-1][-1]

    monkeypatch.setattr(decision, "JOIN", Table(JOIN))
    monkeypatch.setattr(
        planner.attacher,
        "attach_start",
        lambda q, without_cells, passes: (
            seen.append(FEW if without_cells else MANY),
            attach(q, without_cells, passes),
        )[1],
    )
    return seen


def test_what_the_table_says_is_done(planner, joined):
    planner.set_goals([AWAY])
    planner.step(NOBODY, q=HOME)
    assert joined == [(NOT_JOINED, JUMPED, NOTHING, MANY), MANY]
    joined.clear()
    planner.set_goals([AWAY + 0.1])
    planner.step(NOBODY, q=HOME)
    assert joined == []  # many motions are there already
    planner.reset()
    planner.step(NOBODY, q=HOME + 0.01)
    assert joined == [(NOT_JOINED, MOVES, NOTHING, FEW), FEW]
    joined.clear()
    planner.set_goals([AWAY])
    planner.step(NOBODY, q=HOME + 0.01)
    assert joined == [(NEW_GOALS, STANDS, FEW, FEW), FEW]
    joined.clear()
    for _ in range(12):
        planner.step(NOBODY, q=HOME + 0.01)
    assert joined == []  # it has a path: that can wait until there is time
    planner.improve(1)
    assert joined == [(LINGERS, STANDS, FEW, MANY), MANY]


def test_a_blocked_robot_looks_around_thoroughly_once(planner, joined):
    ball = ball_at(tool_pose(planner.robot, AWAY)[:3, 3], 0.1)
    planner.set_goals([AWAY])
    for _ in range(5):
        assert planner.step(ball, q=HOME).status == "holding"
    assert joined == [(NOT_JOINED, JUMPED, NOTHING, MANY), MANY]
    joined.clear()
    q = HOME + 0.01
    for _ in range(5):
        planner.step(ball, q=q)
    done = [row for row in joined if isinstance(row, tuple) and row[3]]
    # more motions are no help while the goal is in contact: joined where it lingers
    assert done == [(NOT_JOINED, MOVES, NOTHING, FEW), (LINGERS, STANDS, FEW, MANY)]
    planner.step(ball, q=np.full(3, np.nan))
    assert joined[-1] == MANY  # nothing is joined to what is no configuration
