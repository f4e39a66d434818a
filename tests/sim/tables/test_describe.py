"""What `odm info` says of robots with many links is still a page."""

from dataclasses import replace

import numpy as np
import pytest

from roadmap.errors import BadInput
from roadmap.graph.roadmap import Roadmap
from sim.tables.describe import MOST_PAIRS, facts, folded, pair_lines


def test_many_pairs_of_one_reason_are_one_line():
    few = [["a", "b", "joined by a joint"], ["b", "c", "joined by a joint"]]
    many = [[f"m{k}", "n", "fixed to each other"] for k in range(MOST_PAIRS + 1)]
    lines = pair_lines([*few, *many])
    assert lines[:2] == ["a and b, joined by a joint", "b and c, joined by a joint"]
    told = f"{MOST_PAIRS + 1} pairs such as m0 and n (--json lists them all)"
    assert lines[2:] == [f"{told}, fixed to each other"]
    assert len(pair_lines(many[1:])) == MOST_PAIRS


def test_what_is_said_of_many_links_or_joints_is_said_once():
    notes = ["one: visual hull used", "locked joints: a = 0", "two: visual hull used"]
    hull, locked = folded(notes)
    assert hull == "one, two: visual hull used"
    assert locked == "locked joints: a = 0"
    assert folded(notes[:1]) == notes[:1] and folded(["no mark"]) == ["no mark"]


def test_a_map_without_edges_is_described(small_map):
    nodes, none = small_map.roadmap.nodes[:1], np.zeros((0, 2), int)
    alone = Roadmap(nodes, none, np.zeros(0), np.ones(3), np.zeros((1, 0)))
    cell_map = replace(small_map, roadmap=alone)
    told = facts(cell_map, with_overhead=False)["roadmap"]
    assert (told["nodes"], told["edges"], told["edge_length_max"]) == (1, 0, 0.0)
    with pytest.raises(BadInput, match="no edges"):
        facts(cell_map)
