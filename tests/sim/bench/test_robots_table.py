"""The tables of docs/robots.md: from the commands' JSON, into the file's section."""

import json
import sys
from pathlib import Path

import pytest

from odm.cell_map.recipe import recipe_names
from roadmap.errors import BadInput
from sim.bench import robots_table

DOCS = Path(__file__).parents[3] / "docs/robots.md"


@pytest.fixture
def folder(tmp_path):
    """Return a folder with what the commands write for one robot, cut down."""
    link = {"link": "jib", "spheres": 12, "excess": 0.021, "protrusion": 0.012}
    base = {"link": "foot", "spheres": 3, "excess": 0.9, "protrusion": 0.9}
    overhead = {"edges, cells": {"mean": 0.0834}, "edges, close test": {"mean": None}}
    cpu = {"p50": 2.31e-5, "p99": 4.512e-4}
    parts = {
        "build": {
            "nodes": 500, "edges": 3000, "seconds": 4.4,
            "bytes_per_edge": {"edge_major": 612.3},
        },
        "info": {
            "robot": {"joints": ["a", "b"], "moving_spheres": 12},
            "cover": [link | {"moving": True}, base | {"moving": False}],
            "clearance_overhead": overhead,
        },
        "audit": {"violations": 0, "pairs": 200000},
        "run": {
            "run": {"contacts": 0, "timing": {"latency_s": {"cpu": cpu}}},
            "setting": {"cpu": "Some CPU", "numba": "0.1"},
        },
    }  # fmt: skip
    for part, data in parts.items():
        (tmp_path / f"crane.{part}.json").write_text(json.dumps(data))
    return tmp_path


def test_a_robot_is_a_line_and_each_moving_link_another(folder):
    text = robots_table.markdown(robots_table.read_results(folder))
    rows = [line for line in text.splitlines() if line.startswith("| crane")]
    assert rows == [
        "| crane | 2 | 12 | 21.0 mm | 12.0 mm | 8.3 cm | - | 500 | 3000 | 4 s | 612 | "
        "0 of 200000 | 0 | 23 us | 451 us |",
        "| crane | jib | 12 | 21.0 mm | 12.0 mm |",
    ]
    assert "cpu Some CPU, numba 0.1." in text


def test_the_section_of_a_file_is_filled(folder, monkeypatch):
    file = folder / "robots.md"
    sides = "<!-- odm bench robots: begin -->\nold\n<!-- odm bench robots: end -->\n"
    file.write_text(f"before\n{sides}after\n")
    monkeypatch.setattr(sys, "argv", ["robots_table", str(folder), str(file)])
    robots_table.main()
    text = file.read_text()
    assert text.startswith("before") and text.endswith("after\n")
    assert "| crane |" in text and "old" not in text


def test_a_missing_file_is_named(folder):
    (folder / "crane.audit.json").unlink()
    with pytest.raises(BadInput, match="crane.audit.json is missing"):
        robots_table.read_results(folder)


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(BadInput, match="no NAME.build.json"):
        robots_table.read_results(tmp_path)


def test_the_docs_list_every_robot_and_have_the_markers():
    text = DOCS.read_text()
    for name in set(recipe_names()) - {"demo", "panda", "panda_carry", "story"}:
        assert f"| {name} |" in text
    assert text.count("<!-- odm bench robots: ") == 2
