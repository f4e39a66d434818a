"""A table that the terminal is too narrow for is told row by row, nothing cut."""

import io

import pytest
from rich.console import Console
from rich.table import Table
from rich.text import Text

from sim.tables.fitted import Fitted


def told(table, width):
    console = Console(file=io.StringIO(), width=width)
    console.print(Fitted(table))
    return console.file.getvalue()


@pytest.fixture
def table():
    table = Table(title="Joints", title_justify="left")
    table.add_column("joint", no_wrap=True)
    for head in ("lower", "upper", "velocity\n\\[rad/s]"):
        table.add_column(head, justify="right")
    table.add_row("shoulder_pan", "-3.1416", "", "2.175")
    return table


def test_a_table_that_fits_is_drawn_as_it_is(table):
    plain = Console(file=io.StringIO(), width=80)
    plain.print(table)
    assert told(table, 80) == plain.file.getvalue()


def test_one_that_does_not_fit_is_told_by_rows(table):
    rows = [line.rstrip() for line in told(table, 30).splitlines()]
    assert rows == [
        "Joints", "shoulder_pan", "  lower: -3.1416", "  velocity [rad/s]: 2.175",
    ]  # fmt: skip


def test_without_heads_the_cells_stand_in_one_line():
    table = Table(box=None, show_header=False)
    for _ in range(3):
        table.add_column(overflow="fold")
    table.add_row("missing", "sphinx", "not installed")
    table.add_row("", "", Text("-> pip install 'odm-planner[docs]'"))
    rows = [line.rstrip() for line in told(table, 36).splitlines()]
    assert rows == [
        "missing  sphinx  not installed",
        "  -> pip install 'odm-planner[docs]'",
    ]
