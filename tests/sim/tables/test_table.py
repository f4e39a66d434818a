"""Tables of benches in a terminal of any width."""

import io

import pytest
from rich.console import Console

from sim.tables.table import print_bench

HEADER = {"processor": "one", "cores": 2, "load_average": [0.0], "python": "3.11"}
HEADER["versions"] = {"numpy": "2"}
NAMES = ("sweep", "PickPlaceCloseHuman_5")


def printed(width, head, rows):
    told = {"bench": "some", "rows": [], "header": HEADER}
    told["tables"] = [{"title": "Trips [%]", "head": head, "rows": rows}]
    out = io.StringIO()
    print_bench(told, Console(file=out, width=width))
    return out.getvalue().splitlines()


@pytest.mark.parametrize(("width", "parts"), [(60, 3), (80, 2), (200, 1)])
def test_a_table_that_is_too_wide_goes_on_below_with_its_names(width, parts):
    head = ["beside", *(f"column {k}" for k in range(11))]
    rows = [[name, *(str(10 * k) for k in range(11))] for name in NAMES]
    lines = printed(width, head, rows)
    assert max(map(len, lines)) <= width
    for name in NAMES:
        own = [line.split() for line in lines if line.startswith(name)]
        assert len(own) == parts
        assert [n for line in own for n in line[1:]] == rows[NAMES.index(name)][1:]
    told = " ".join(lines)
    assert all(one in told for one in head)


def test_text_is_broken_and_not_cut():
    words = "the hand that took it let go too early, so that it fell on the floor"
    lines = printed(60, ["case", "outcome", "contacts"], [["dropped", words, "0"]])
    assert all(word in " ".join(lines) for word in words.split())
    (row,) = [line for line in lines if line.startswith("dropped")]
    assert row.split()[-1] == "0"


def test_a_table_without_rows_says_so():
    assert "Trips [%]: none" in printed(80, ["case", "outcome"], [])


def test_no_number_beside_a_long_name_is_cut():
    row = ["a word or some more " * 2, "123456789", "987654321"]
    assert set(row[1:]) <= set(" ".join(printed(40, ["case", "a", "b"], [row])).split())
