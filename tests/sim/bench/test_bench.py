"""The benches run and say true things; how fast they are is not tested."""

import json
import sys

import numpy as np
import pytest
from small import DATA, small_recipe

import odm
from roadmap.errors import BadInput
from sim.bench import frames
from sim.bench.clock import Clock, time_row
from sim.bench.command import markdown_of
from sim.bench.core import build, camera, frame_rows, latency, map_rows, walled
from sim.bench.core.camera_scene import person_at
from sim.bench.rivals import baselines, lengths, ompl
from sim.bench.rivals.compiled_search import CompiledSearch
from sim.bench.rivals.fcl_search import FclSearch
from sim.bench.rivals.query import query_of
from sim.tables.table import print_bench, value_row


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    """A saved map of the small arm."""
    return odm.build_map(small_recipe()).save(tmp_path_factory.mktemp("bench") / "arm3")


@pytest.fixture(scope="module")
def saved(map_dir):
    """The same map, loaded."""
    return odm.load_map(map_dir)


@pytest.fixture(scope="module")
def pairs(saved):
    """A few pairs with a sweeping, reaching and trembling arm."""
    return frames.make_pairs(saved, pairs=6, frames=10, seed=2)


def test_the_same_seed_draws_the_same_frames(saved, pairs):
    again = frames.make_pairs(saved, pairs=6, frames=10, seed=2)
    for one, other in zip(pairs, again, strict=True):
        assert np.array_equal(one.capsules, other.capsules)
        assert np.array_equal(one.q_start, other.q_start)
        assert np.array_equal(one.q_goal, other.q_goal)


@pytest.mark.parametrize("motion", frames.MOTIONS)
def test_no_point_of_the_arm_is_faster_than_said(motion, rng):
    for _ in range(5):
        rods = frames.arm_frames(motion, 400, rng)
        ends = np.concatenate([rods[:, :, :3], rods[:, :, 3:6]], axis=1)
        speed = np.linalg.norm(np.diff(ends, axis=0), axis=2) * frames.RATE_HZ
        assert speed.max() <= frames.TOP_SPEED * 1.01
        assert speed.max() >= 0.2


@pytest.mark.parametrize("motion", frames.MOTIONS)
def test_the_arm_keeps_its_lengths(motion, rng):
    rods = frames.arm_frames(motion, 50, rng)
    length = np.linalg.norm(rods[:, :, 3:6] - rods[:, :, :3], axis=2)
    assert np.allclose(length, frames.LENGTHS, atol=1e-9)
    assert np.allclose(rods[:, 0, 3:6], rods[:, 1, :3])


@pytest.mark.parametrize("condition", frames.CONDITIONS)
def test_start_and_goal_are_as_free_as_the_condition_says(saved, condition):
    drawn = frames.make_pairs(saved, 2, 6, seed=4, condition=condition)
    planner = odm.ReactivePlanner(saved)
    exact = frames.ExactRobot(saved.robot)
    keep = saved.safety.rho + saved.safety.m
    for pair in drawn:
        counted_capsules = pair.capsules[:1] if condition == "first" else pair.capsules
        for rods in counted_capsules:
            planner.step(frames.sample_capsules(rods, frames.SPACING), q=pair.q_start)
            for q in (pair.q_start, pair.q_goal):
                # what the cover calls clear is clear for the exact solids
                assert not exact.collides(q, frames.shapes(rods), saved.safety.m)
                if condition == "clear":
                    assert planner.separation(q) > keep


def test_the_arm_is_across_the_straight_motion_where_that_is_asked(saved):
    planner, shares = odm.ReactivePlanner(saved), []
    for blocked in (0.0, 0.6):
        drawn = frames.make_pairs(saved, 2, 4, 4, "first", blocked=blocked)
        hit = []
        for pair in drawn:
            for ask in pair.asked():
                ask(planner, pair.q_start)
                hit.append(not planner.is_free(pair.q_start, pair.q_goal))
        shares.append(np.mean(hit))
    assert shares[0] < 0.6 <= shares[1]


def test_lengths_are_compared_after_so_much_improving(saved, pairs, monkeypatch):
    class Straight:  # no path is shorter, so that no ratio is below 1
        def __init__(self, cell_map, seed):
            pass

        def solve(self, pair, rods, limit_s):
            return np.stack([pair.q_start, pair.q_goal])

    monkeypatch.setattr(lengths, "OmplPlanner", Straight)
    rows = {row["name"]: row for row in lengths.compared(saved, pairs[:2], seed=1)}
    name = "path length, median ratio to OMPL simplified, "
    first, better = rows[name + "first answer"], rows[name + "improved"]
    assert first["value"] >= better["value"] >= 1.0
    assert first["met"] == (first["value"] <= lengths.FIRST)
    assert rows["... frames compared"]["value"] <= 6


def test_a_robot_advances_at_its_joint_speed_limits():
    path = np.array([[0.0, 0.0], [1.0, 0.5], [1.0, 2.5]])
    fast = np.array([2.0, 1.0])
    assert np.allclose(frame_rows.advance(path, fast, 0.25), [0.5, 0.25])
    assert np.allclose(frame_rows.advance(path, fast, 1.5), [1.0, 1.5])
    assert np.allclose(frame_rows.advance(path, fast, 9.0), path[-1])


def test_both_ways_to_the_direct_map_agree(saved, pairs):
    rows = map_rows.direct_map(saved, pairs)
    assert rows[-1]["value"] == 1.0 and rows[-1]["met"]


def test_the_direct_map_agrees_with_that_of_a_fresh_planner(saved, pairs):
    planner = odm.ReactivePlanner(saved)
    for points in pairs[0].points()[::3]:
        planner.step(points, q=pairs[0].q_start)
        fresh = odm.ReactivePlanner(saved)
        fresh.step(points, q=pairs[0].q_start)
        assert np.array_equal(planner.invalid_nodes(), fresh.invalid_nodes())
        assert np.array_equal(planner.invalid_edges(), fresh.invalid_edges())


def test_paths_of_the_planner_touch_nothing_by_fcl(saved, pairs):
    found = baselines.compare(saved, pairs, fcl_frames=12, compiled_frames=30)
    for name in ("fcl", "compiled"):
        about = found[name]
        assert about["fcl_contacts_on_our_paths"] == 0
        assert about["frames"] > 0 and about["found_by_both"] > 0


def test_a_competitor_gets_all_motions_of_both_ends(saved, pairs):
    # the planner itself joins the start when the straight motion is blocked, not before
    planner = odm.ReactivePlanner(saved)
    for pair in pairs:
        query = query_of(planner, pair)
        starts, goals = len(query.start_nodes), len(query.goal_nodes)
        assert starts == planner.settings.start_connections
        assert goals == planner.settings.goal_connections


def test_the_compiled_competitor_finds_what_the_planner_finds(saved, pairs):
    # it keeps less distance (no cells, no covering radius), on the same graph
    found = baselines.compare(saved, pairs, fcl_frames=1, compiled_frames=60)
    assert found["compiled"]["found_by_planner_only"] == 0
    assert found["compiled"]["median_length_ratio"] >= 1.0 - 1e-9


def test_paths_of_the_compiled_competitor_touch_nothing_by_fcl(saved, pairs):
    other, fcl = CompiledSearch(saved), FclSearch(saved)
    planner = odm.ReactivePlanner(saved, always_replan=True)
    found = 0
    for pair in pairs:
        other.set_query(query_of(planner, pair))
        for rods in pair.capsules[::3]:
            path = other.search(rods)
            found += path is not None
            assert path is None or fcl.path_free(path, rods)
    assert found


def test_walls_leave_start_and_goal_free_but_cut_off(saved, pairs):
    planner = odm.ReactivePlanner(saved, True, odm.PlannerSettings(search=0))
    rng, keep = np.random.default_rng(1), saved.safety.rho + saved.safety.m
    walls = 0
    for pair in pairs:
        for place in ("goal", "start"):
            points, n_arms = walled.wall(planner, pair, place, rng, frames=6)
            if points is None:
                continue
            walls += 1
            assert n_arms >= 1
            fresh = odm.ReactivePlanner(saved, True, odm.PlannerSettings(search=0))
            fresh.set_goals([pair.q_goal])
            for _ in range(6):  # in which it joins more motions to both ends
                answer = fresh.step(points, q=pair.q_start, rounding=frames.ROUND)
                assert answer.status == "holding"
            assert planner.separation(pair.q_start) > keep
            assert planner.separation(pair.q_goal) > keep
    assert walls


def test_all_frames_of_what_is_walled_in_hold(saved, pairs):
    rows = walled.walled_in(saved, pairs, seed=1, repeats=6)
    shares = [row for row in rows if row["name"] == "... frames that hold"]
    assert [row["value"] for row in shares] == [100.0, 100.0]
    assert all(row["n"] for row in rows if "wall" in row)


def test_a_camera_cloud_has_the_points_it_is_said_to_have(pairs, rng):
    cloud = map_rows.camera_cloud(pairs[0].capsules[0], rng)
    assert cloud.shape == (map_rows.CLOUD, 3) and np.isfinite(cloud).all()


def test_the_robot_before_a_camera_stands_clear_of_the_person(saved):
    q, goal = camera.free_places(saved, 1.0, seed=0)
    exact = frames.ExactRobot(saved.robot)
    phase = np.random.default_rng(0).uniform(0, 2 * np.pi, 3)
    for k in range(12):
        about = frames.shapes(person_at(1.0, 2 * np.pi * k / 12 + phase))
        for place in (q, goal):
            assert not exact.collides(place, about, 0.99 * camera.CLEAR)
    assert not np.array_equal(q, goal)


def test_the_short_bench_reports_every_row_as_plain_data(map_dir):
    result = json.loads(json.dumps(latency.run(map_dir, short=True)))
    assert result["header"]["map"]["hash"] == odm.load_map(map_dir).hash
    assert len(result["header"]["load_average"]) == 3
    names = [row["name"] for row in result["rows"]]
    for part in ("path out", "straight motion blocked ->", "path length",
                 "follows", "never seen", "set_goals", "goal walled",
                 "start walled", "direct map", "20 000", "bytes", "load", "process",
                 "python-fcl", "compiled"):  # fmt: skip
        assert any(part in name for name in names), part
    text = markdown_of(result)
    assert all(name in text for name in names)
    print_bench(result)


def test_ompl_is_compared_on_a_few_frames(map_dir):
    pytest.importorskip("ompl")
    result = ompl.run(map_dir, pairs=2, frames=6, each=2, seed=2, limit_s=0.5)
    rows = {row["name"]: row for row in json.loads(json.dumps(result))["rows"]}
    assert result["setup"]["frames compared"] == 4
    assert 0 <= rows["frames OMPL finds a path in"]["value"] <= 100
    assert "OMPL" in markdown_of(result)


def test_a_missing_ompl_is_one_clear_sentence(map_dir, monkeypatch):
    monkeypatch.setitem(sys.modules, "ompl", None)
    with pytest.raises(ompl.OmplMissing, match="pip install"):
        ompl.run(map_dir, pairs=1, frames=2)


def test_a_recipe_builds_to_the_same_bytes_by_threads_and_processes(
    tmp_path, monkeypatch
):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)  # as a user's build
    recipe = tmp_path / "tiny.toml"
    recipe.write_text(
        f'[robot]\nsource = "{DATA / "arm3.urdf"}"\ntip = "tool"\n'
        "[roadmap]\nnodes = 60\nneighbors = 5\n[safety]\nh = 0.05\n"
    )
    pytest.importorskip("distributed")
    rows = build.run((str(recipe),), workers=1)["rows"]
    same = next(row for row in rows if "same bytes" in row["name"])
    assert same["met"]
    names = [row["name"] for row in rows]
    first = names.index(f"{recipe}, 1 workers: all")
    clock, cpu, alone, ahead, chunks = (r["value"] for r in rows[first : first + 5])
    assert 0 < chunks < cpu and 0 < alone < cpu and 0 <= ahead < cpu and clock > 0
    assert rows[first + 6]["name"] == "... speed-up on free cores"
    whole = next(r["value"] for r in rows if r["name"] == "... all, CPU time")
    free = max(alone, ahead) + chunks
    assert rows[first + 6]["value"] == pytest.approx(whole / free)


@pytest.mark.parametrize(("nodes", "workers"), [("3000", None), ("many", 2), ("1", 2)])
def test_numbers_of_nodes_need_workers_that_build_them(nodes, workers):
    with pytest.raises(BadInput, match="give numbers of nodes with commas"):
        build.run(workers=workers, node_counts=nodes)


def test_a_row_is_met_where_all_its_limits_are():
    times = np.arange(101.0)
    row = time_row("t", "", times, times * 2, p50=60, p99=99)
    assert row["met"] and not row["met_cpu"]
    assert time_row("t", "", times[:0], None, p50=1)["met"] is None
    assert value_row("v", 3.0, "", least=2.0)["met"]
    assert not value_row("v", 3.0, "", most=2.0)["met"]
    assert value_row("v", np.nan, "", most=2.0)["met"] is None


def test_a_clock_returns_what_it_timed():
    clock = Clock()
    assert clock(max, 1, 2) == 2
    assert len(clock.wall) == len(clock.cpu) == 1
