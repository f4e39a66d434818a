"""The paper's experiment: cells, contacts and rules are what they are said to be."""

import itertools
import json

import numpy as np
import pytest

from odm import Box, ReactivePlanner
from odm.exact.distances import ExactRobot, obstacles_of
from odm.exact.fcl_robot import FclRobot
from roadmap.errors import BadInput
from sim.bench.command import bench_modules, markdown_of, run_bench
from sim.bench.frames import arm_frames, make_pairs
from sim.bench.paper import odm_paper, paper_edges
from sim.bench.paper.paper_arm import (
    Contacts,
    CylinderPair,
    Region,
    cells_of,
    centers_of,
    cylinders,
    paper_points,
)
from sim.bench.paper.paper_rows import PaperFcl, audit
from sim.bench.rivals.query import query_of
from sim.tables.table import print_bench

# an arm across the small robot's workspace
UP = np.array([0.0, 0.0, 0.6])
ROD = np.array([[0.3, -0.3, 0.4, 0.35, 0.1, 0.5, 0.05]])


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    plot = tmp_path_factory.mktemp("paper") / "made" / "odm_paper.png"
    return odm_paper.run(short=True, plot=plot), plot


@pytest.fixture(scope="module")
def arms():
    rng = np.random.default_rng(3)
    rods = np.concatenate([arm_frames(m, 4, rng) for m in ("sweep", "reach")])
    rods[:, :, [0, 3]] -= 0.35  # the small robot reaches less far
    return rods


def region_of(arm, grid):
    region = Region(grid)
    job = region.prepare(arm)
    count = region.expand(job)
    return region, job, count


def by_brute_force(arm, grid):
    """Return the cells that meet the arm, asked one by one with python-fcl."""
    import fcl

    ends = arm[:, :6].reshape(-1, 3)
    low = np.floor((ends.min(axis=0) - 0.1 - grid.origin) / grid.h).astype(int)
    high = np.ceil((ends.max(axis=0) + 0.1 - grid.origin) / grid.h).astype(int)
    rods = []
    for rod in cylinders(arm):
        T = rod.T_base_shape
        pose = fcl.Transform(T[:3, :3], T[:3, 3])
        rods.append(fcl.CollisionObject(fcl.Cylinder(rod.radius, rod.length), pose))
    cube, met = fcl.Box(*[grid.h] * 3), set()
    for cell in itertools.product(*map(range, low, high)):
        center = grid.origin + (np.array(cell) + 0.5) * grid.h
        item = fcl.CollisionObject(cube, fcl.Transform(center))
        asked = fcl.CollisionRequest(), fcl.CollisionResult()
        if any(fcl.collide(item, rod, *asked) for rod in rods):
            met.add(cell)
    return met


def test_region_expansion_finds_every_cell_the_arm_meets(small_map, arms):
    grid = small_map.grid
    for arm in (arms[0], arms[5], ROD):
        region, job, count = region_of(arm, grid)
        found = {tuple(c) for c in cells_of(region.centers(job), grid)}
        assert len(found) == count
        assert by_brute_force(arm, grid) == found


def test_the_surface_is_part_of_the_whole(small_map, arms):
    grid = small_map.grid
    for arm in arms:
        region, job, _ = region_of(arm, grid)
        whole = {tuple(c) for c in cells_of(region.centers(job), grid)}
        surface = {tuple(c) for c in cells_of(paper_points(arm, 0.02), grid)}
        assert surface <= whole and len(surface) < len(whole)


def test_points_are_as_far_apart_as_said(arms):
    from scipy.spatial import cKDTree

    fine = paper_points(arms[0], 0.004)
    for apart in (0.02, 0.05):
        points = paper_points(arms[0], apart)
        far, _ = cKDTree(points).query(fine)
        assert far.max() <= apart / np.sqrt(2.0) + 1e-9


def test_the_audit_misses_nothing_and_counts_as_it_should(small_map, arms):
    found = audit(small_map, arms, (0.005, 0.3), n_edges=200, seed=1)
    assert found.contacts > 20 and found.on_nodes > 5
    assert found.missed == 0 and found.near_missed == 0
    assert found.near >= found.contacts
    nodes, edges = np.array(found.nodes), np.array(found.edges)
    assert (nodes[:, 0] >= nodes[:, 1]).all() and (edges[:, 0] >= edges[:, 1]).all()
    # dense points miss next to nothing, points 30 cm apart a good part
    assert found.uninflated[0.005] == 0
    assert found.uninflated[0.3] > 0


def test_an_arm_without_half_its_points_is_found_out(small_map, arms, monkeypatch):
    whole = CylinderPair.points
    monkeypatch.setattr(
        CylinderPair, "points", lambda pair: [p[:4] for p in whole(pair)]
    )
    found = audit(small_map, arms, (), n_edges=200, seed=1)
    assert found.missed > 0


def test_contacts_are_those_of_the_exact_robot(small_map, arms, rng):
    exact = ExactRobot(small_map.robot)
    contacts, nodes = Contacts(exact), small_map.roadmap.nodes[:60]
    for arm in arms[:3]:
        near = contacts.distances(nodes, obstacles_of(cylinders(arm)), 0.2)
        for q, d in zip(nodes, near, strict=True):
            true = exact.distance(q, cylinders(arm), cap=0.2).distance
            assert np.isclose(d, true, atol=1e-9)


def test_cells_are_met_where_the_exact_solids_meet_their_cubes(small_map, rng):
    exact, grid = ExactRobot(small_map.robot), small_map.grid
    contacts, region = Contacts(exact), Region(small_map.grid)
    centers = centers_of(cells_of(rng.uniform(-0.4, 0.4, (6, 3)) + UP, grid), grid)
    nodes = small_map.roadmap.nodes[:40]
    found = contacts.meet_cells(nodes, region, centers)
    boxes = []
    for center in centers:
        T = np.eye(4)
        T[:3, 3] = center
        boxes.append(Box(np.full(3, grid.h), T))
    true = [exact.collides(q, boxes) for q in nodes]
    assert found.tolist() == true and 0 < sum(true) < len(true)


def test_the_rule_stops_where_a_middle_adds_nothing():
    # cells 0 and 1 at the ends, 2 a quarter on: the middle adds nothing
    words = np.array([[1], [4], [1], [2], [2]], np.uint64)
    found, looked = paper_edges.by_rule(words)
    assert looked == 1 and found.tolist() == [3]
    # a middle that adds a cell is gone on from
    words = np.array([[1], [4], [8], [2], [2]], np.uint64)
    found, looked = paper_edges.by_rule(words)
    assert looked == 3 and found.tolist() == [15]


def test_the_motion_bound_misses_no_cell_of_an_edge(small_map, arms):
    grid, occupied = small_map.grid, []
    for arm in arms:
        region, job, _ = region_of(arm, grid)
        cells = cells_of(region.centers(job), grid)
        occupied.append(paper_edges.words_of(cells, small_map))
    rule = paper_edges.edge_rule(small_map, np.array(occupied), 60, seed=2)
    assert rule.edges == 60 and rule.cells > 1000
    assert rule.bound_missed == 0
    assert rule.bound_cells >= rule.cells
    assert 0 < rule.short <= rule.edges and 0 < rule.missed < rule.cells
    assert 0 < rule.asked and rule.passed <= rule.asked


def test_words_hold_the_cells_inside_the_grid(small_map, rng):
    n = 4 * small_map.grid.blocks
    cells = np.unique(rng.integers(-2, n + 2, (300, 3)), axis=0)
    words = paper_edges.words_of(cells, small_map)
    inside = ((cells >= 0) & (cells < n)).all(axis=1).sum()
    assert np.bitwise_count(words).sum() == inside < len(cells)


def test_the_competitor_sees_cylinders_not_capsules(small_map, arms):
    pair = CylinderPair.of(make_pairs(small_map, 1, 4, seed=5)[0], 0.03)
    search, planner = PaperFcl(small_map), ReactivePlanner(small_map, True)
    search.set_query(query_of(planner, pair))
    other = FclRobot(small_map.robot)
    for arm in arms:
        search.checker.set_obstacles(arm)
        other.set_obstacles(cylinders(arm))
        for q in small_map.roadmap.nodes[:50]:
            assert search.checker.free(q) == (not other.collides(q))


def test_the_short_bench_is_plain_data_with_all_tables(result):
    data, plot = result
    data = json.loads(json.dumps(data))
    assert len(data["sweep"]) == 2 and len(data["tables"]) == 4
    assert {r["sampling"] for r in data["sweep"]} == {"random", "grid"}
    for row in data["sweep"]:
        assert row["contacts_missed"] == 0 and row["within_m_missed"] == 0
        assert row["nodes_whole"] >= row["nodes_surface"]
        assert row["cells_whole"] > row["cells_surface"]
        assert row["fcl_contacts_on_our_paths"] == 0
    names = " ".join(row["name"] for row in data["rows"])
    for part in ("points to path", "python-fcl", "across the arm", "missed"):
        assert part in names
    text = markdown_of(data)
    assert all(t["title"] in text for t in data["tables"])
    print_bench(data)
    assert plot.read_bytes()[:4] == b"\x89PNG"


def test_the_bench_is_known_by_its_name_and_takes_no_map(tmp_path):
    names = bench_modules()
    assert "odm-paper" in names and "odm_paper" not in names
    with pytest.raises(BadInput, match="no option --map"):
        run_bench("odm-paper", {"map_dir": tmp_path}, None, None)
