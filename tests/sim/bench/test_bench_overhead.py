"""`odm bench overhead` says what a map gives away, by term, beside what is asked."""

import json

import pytest
from small import small_recipe

import odm as planner
from odm.audit.clearance import TERMS, ClearanceOverhead
from sim.bench.command import markdown_of
from sim.bench.core import overhead


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    folder = tmp_path_factory.mktemp("overhead")
    return planner.build_map(small_recipe()).save(folder / "arm3")


WAYS = [
    f"{a}, {b} of {c}"
    for a in ("nodes", "edges")
    for b in ("cells", "close test")
    for c in ("points", "shapes")
]


def rows_of(result):
    return {row["name"]: row for row in result["rows"]}


def test_the_table_shows_every_way_to_ask_and_every_term(odm, map_dir, tmp_path):
    file = tmp_path / "overhead.json"
    code, out, _ = odm("bench", "overhead", "--map", map_dir, "--short", "--json", file)
    result = json.loads(file.read_text())
    assert code == 0
    assert result["header"]["map"]["hash"] == planner.load_map(map_dir).hash
    assert 0 < result["setup"]["approaches to edges"] <= 20
    rows = rows_of(result)
    assert len(rows) == 2 * (len(WAYS) + len(TERMS)) == 24
    for name in WAYS:
        mean, high = rows[f"{name}: mean"], rows[f"{name}: p95"]
        assert mean["unit"] == "cm" and 0 < mean["value"] <= high["value"] < 20
        assert name in out
    for term in TERMS:
        assert f"term {term}: mean" in rows and f"term {term}: p95" in rows
    lines = markdown_of(result).splitlines()
    assert lines[:2] == ["| what | asked | measured | met? |", "|---|---|---|---|"]
    assert lines[2].startswith("| nodes, cells of points: mean | <= 9 cm |")


def test_the_same_seed_gives_the_same_overhead(map_dir):
    first, again = (overhead.run(map_dir, short=True, seed=4)["rows"] for _ in range(2))
    assert first == again
    assert first != overhead.run(map_dir, short=True, seed=5)["rows"]


@pytest.mark.parametrize(("cells", "close", "met"), [(0.08, 0.04, 1), (0.1, 0.06, 0)])
def test_the_means_are_held_against_9_and_5_cm(cells, close, met, map_dir, monkeypatch):
    whole = ((cells, 0.0, 0.2), (close, 0.0, 0.2)) * 2
    whole += ((0.02, 0.0, 0.2),) * 2 + ((0.061, 0.0, 0.2), (0.059, 0.0, 0.2))
    terms = {name: (0.01, 0.01, 0.02) for name in TERMS}
    known = ClearanceOverhead(terms, *whole, m=0.01, lines=9, edge_lines=3)
    monkeypatch.setattr(overhead, "clearance_overhead", lambda *args: known)
    rows = rows_of(overhead.run(map_dir))
    assert rows["edges, cells of points: mean"]["value"] == pytest.approx(100 * cells)
    assert rows["term mu: p95"]["value"] == pytest.approx(2.0)
    for name in [way for way in WAYS if "shapes" not in way]:
        assert rows[f"{name}: mean"]["met"] is bool(met)
        assert rows[f"{name}: p95"]["met"] is None
    assert not rows["edges, close test of shapes: mean"]["met"]  # 2 cm, asked 1.6
    assert not rows["nodes, cells of shapes: mean"]["met"]  # 6.1 cm, asked 6
    assert rows["edges, cells of shapes: mean"]["met"]
