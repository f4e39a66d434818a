"""A reach map: what is marked was reached, and what is reachable is marked."""

import json
from dataclasses import replace

import numpy as np
import pytest
from reach_chains import naive_cell, slow_dexterity, some_poses
from rows import each
from scipy.spatial.transform import Rotation

import handover
from handover import ReachSettings, build_reach_map, chain_of
from handover.reach import _reach_build as kernels
from handover.reach import extremes, reach_build
from handover.reach.extremes import best_dexterity, work_of
from handover.reach.reach_build import MAX_BYTES
from handover.reach.reach_grid import reach_grid
from handover.reach.reach_map import ReachMap
from handover.reach.reach_recall import (
    center_rate,
    measure_recall,
    random_poses,
    witness_precision,
)
from handover.reach.reach_touch import touch_of
from roadmap import load_robot
from roadmap.errors import BadInput, BuildRefused
from roadmap.geometry.self_collision import configuration_free
from roadmap.kinematics._chain import dexterity, forward, from_lattice, jacobian
from roadmap.transforms import pose_of


@pytest.mark.parametrize("name", ["arm_map", "robot_map"])
def test_every_witness_is_in_its_cell_within_limits_and_as_good_as_it_says(
    name, request
):
    reach = request.getfixturevalue(name)
    chain, reference = reach.chain, reach.reference
    cells = reach.marked_cells()
    assert len(cells) == reach.n_marked > 5000
    work, (low, high), some = work_of(chain), chain.limits.T, cells[::7]
    witnesses = np.array([reach.witness_of(int(cell)) for cell in some])
    assert (witnesses >= low).all() and (witnesses <= high).all()
    jacobians = np.empty((len(some), *work.jac.shape))
    for k, (cell, q) in enumerate(zip(some, witnesses, strict=True)):
        assert naive_cell(reach.grid, chain.tool_pose(q)) == cell
        forward(chain.arrays, q, work.frames)
        jacobian(chain.arrays, work.frames, work.jac)
        jacobians[k] = work.jac
    w = slow_dexterity(chain, witnesses, jacobians) / reference
    told = reach.qualities(some)
    assert (np.abs(1 + 254 * np.minimum(w, 1.0) - told) < 1.01).all()


def test_no_witness_of_a_robot_touches_itself(robot, robot_map):
    for cell in robot_map.marked_cells()[::5]:
        assert configuration_free(robot, robot_map.witness_of(int(cell)))[0]


@pytest.fixture(scope="module")
def loose(robot):
    """A map that was built without looking at self-collision."""
    settings = ReachSettings(cell=0.1, rotations=72, samples=20_000)
    return build_reach_map(chain_of(robot, self_collisions=False), settings, threads=1)


def test_self_collision_may_be_left_in(robot, loose):
    cells = loose.marked_cells()[::5]
    free = (configuration_free(robot, loose.witness_of(int(c)))[0] for c in cells)
    assert not all(free)


@pytest.mark.parametrize("name", ["arm_map", "robot_map"])
def test_look_ups_agree_with_a_dictionary(name, request, rng):
    reach = request.getfixturevalue(name)
    known = dict(zip(reach.marked_cells().tolist(), reach.packed.quality, strict=True))
    poses = some_poses(reach, 4000, rng)
    slow = [known.get(naive_cell(reach.grid, T), 0) for T in poses]
    np.testing.assert_array_equal(np.rint(reach.quality(poses) * 255), slow)
    assert 0.02 < np.mean(np.array(slow) > 0) < 0.9
    assert reach.quality(poses[0]) == slow[0] / 255
    dense = reach.dense()
    assert np.count_nonzero(dense) == reach.n_marked
    np.testing.assert_array_equal(np.flatnonzero(dense), reach.marked_cells())


def test_a_pose_out_of_reach_has_no_quality_and_no_witness(arm_map):
    far = pose_of([5.0, 0.0, 0.0])
    assert arm_map.quality(far) == 0.0 and arm_map.witness(far) is None


def test_a_witness_is_where_the_pose_is(arm_map, rng):
    poses = some_poses(arm_map, 300, rng)
    reached = poses[arm_map.quality(poses) > 0]
    assert len(reached) > 10
    for T in reached:
        tool = arm_map.chain.tool_pose(arm_map.witness(T))
        assert naive_cell(arm_map.grid, tool) == naive_cell(arm_map.grid, T)


def test_the_same_bytes_for_any_number_of_threads(arm, robot, monkeypatch):
    monkeypatch.setattr(reach_build, "_CHUNK", 1 << 11)  # ten pieces, in two rounds
    settings = ReachSettings(cell=0.2, rotations=72, samples=20_000, seed=9)
    for chain in (chain_of(robot), arm):
        one, three = (build_reach_map(chain, settings, threads=k) for k in (1, 3))
        for a, b in zip(one.packed, three.packed, strict=True):
            np.testing.assert_array_equal(a, b)
    other = build_reach_map(arm, replace(settings, seed=10), threads=1)
    assert (
        other.packed.roots.shape != one.packed.roots.shape
        or (other.packed.roots != one.packed.roots).any()
    )


def test_the_best_sample_of_a_cell_stays_whatever_the_split(arm, rng):
    grid = reach_grid(arm, 0.2, 72)
    where = rng.integers(-1, 300, 4000).astype(np.int32)
    value = rng.integers(1, 20, 4000).astype(np.uint8)
    best = {}
    for i, (c, v) in enumerate(zip(where.tolist(), value.tolist(), strict=True)):
        if c >= 0 and v > best.get(c, (0, 0))[0]:
            best[c] = (v, 500 + i)
    for parts in (1, 3):
        cells = handover.reach.reach_chunks.empty_cells(grid.n_cells, 7)
        for part in range(parts):
            kernels.keep_best(part, parts, 72, 500, where, value, cells)
        found = np.flatnonzero(cells.sample)
        pairs = zip(cells.sample[found].tolist(), cells.source[found].tolist())
        assert dict(zip(found.tolist(), pairs, strict=True)) == best


def test_pushes_find_what_samples_missed(arm):
    settings = ReachSettings(cell=0.2, rotations=72, samples=5000, seed=1)
    reach = build_reach_map(arm, settings, threads=1)
    work, hit = work_of(arm), set()
    for k in range(settings.samples):
        kernels.draw_code(settings.seed, k, work.code)
        from_lattice(arm.arrays, work.code, work.q)
        forward(arm.arrays, work.q, work.frames)
        hit.add(kernels.cell_of(reach.grid.arrays, work.frames[-1]))
    marked = set(reach.marked_cells().tolist())
    assert hit <= marked and len(marked) > 1.5 * len(hit)
    # and none of them only by accident: they are witnessed, and hold random poses
    assert measure_recall(reach, poses=600).recall > 0.9


def test_the_recall_is_that_of_poses_solved_elsewhere(robot, robot_map, rng):
    chain = chain_of(robot)
    found = measure_recall(robot_map, chain, poses=400, seed=4)
    assert found.solvable > 60 and found.recall > 0.88
    assert found.margin < 0.1
    # the same poses, solved by the robot's own inverse kinematics
    from handover.reach.extremes import reachable_box

    flat = random_poses(reachable_box(chain), 400, np.random.default_rng(4))
    solvable = marked = 0
    for row in flat:
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = row[:9].reshape(3, 3), row[9:]
        if any(configuration_free(robot, s.q)[0] for s in robot.ik(T, attempts=24)):
            solvable += 1
            marked += robot_map.quality(T) > 0
    assert abs(solvable - found.solvable) <= 3
    assert abs(marked - found.marked) <= 3


def test_the_recall_sees_what_is_missing(arm_map):
    whole = measure_recall(arm_map, poses=1000)
    cut = arm_map.packed.row_of.copy()
    cut[::2] = -1
    half = ReachMap(
        arm_map.chain, arm_map.grid, arm_map.packed._replace(row_of=cut), 1.0
    )
    assert measure_recall(half, poses=1000).recall < 0.6 * whole.recall


def test_random_poses_are_rotations_all_over(rng):
    flat = random_poses(np.array([[0, 0, 0], [1, 2, 3.0]]), 5000, rng)
    R = flat[:, :9].reshape(-1, 3, 3)
    np.testing.assert_allclose(
        R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (5000, 1, 1)), atol=1e-9
    )
    angles = Rotation.from_matrix(R).magnitude()
    # the mean angle of a uniformly random rotation is pi / 2 + 2 / pi
    assert abs(angles.mean() - (np.pi / 2 + 2 / np.pi)) < 0.03


def test_some_centres_are_out_of_reach_though_their_cells_are_not(arm_map):
    assert 0.05 < center_rate(arm_map, cells=200) < 1.0


def test_the_precision_sees_witnesses_that_prove_nothing(
    arm_map, robot, robot_map, loose
):
    assert witness_precision(arm_map, cells=300) == 1.0
    assert witness_precision(robot_map, chain_of(robot), cells=300) == 1.0
    roots = np.array(arm_map.packed.roots)
    roots[::2] = roots[0]
    packed = arm_map.packed._replace(roots=roots)
    wrong = ReachMap(arm_map.chain, arm_map.grid, packed, 1.0)
    assert 0.2 < witness_precision(wrong, cells=300) < 0.8
    assert witness_precision(loose, cells=300) == 1.0
    assert witness_precision(loose, chain_of(robot), cells=300) < 1.0


def test_a_rail_an_endless_joint_and_fewer_than_six_joints_have_a_map_too():
    robot = load_robot("rail_arm", cover_excess=0.2)
    chain = chain_of(robot)
    settings = ReachSettings(cell=0.1, rotations=72, samples=30_000)
    reach = build_reach_map(chain, settings, threads=1)
    for cell in reach.marked_cells()[::40]:
        q = reach.witness_of(int(cell))
        assert naive_cell(reach.grid, chain.tool_pose(q)) == cell
        assert configuration_free(robot, q)[0]
    assert measure_recall(reach, chain, poses=50).recall is None


def test_a_locked_joint_is_not_part_of_the_map():
    robot = load_robot("kawasaki_fs003n", locked={"joint1": 0.5}, cover_excess=0.2)
    reach = build_reach_map(
        chain_of(robot), ReachSettings(cell=0.1, rotations=72, samples=5000), threads=1
    )
    assert reach.chain.dof == 5 and "joint1" not in reach.chain.joint_names
    assert 500 < reach.n_marked < 40_000


def test_a_build_that_is_interrupted_leaves_nothing_running(arm):
    seen = []

    def stop(stage, done, total):
        seen.append(stage)
        if stage.startswith("marking") and done > 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        build_reach_map(
            arm, ReachSettings(cell=0.1, rotations=72, samples=20_000), 2, stop
        )
    assert "packing" not in seen


def test_progress_names_every_stage_and_ends_full(arm):
    last = {}
    settings = ReachSettings(cell=0.3, rotations=72, samples=5000)
    build_reach_map(arm, settings, 1, lambda stage, k, n: last.update({stage: k / n}))
    assert {"drawing samples", "marking cells, pass 1", "packing"} <= set(last)
    assert set(last.values()) == {1.0}


def test_a_time_limit_ends_with_a_map_that_says_so(arm):
    settings = ReachSettings(cell=0.2, rotations=72, samples=50_000_000, seconds=0.5)
    reach = build_reach_map(arm, settings, threads=1)
    assert reach.built["stopped_early"]
    assert reach.built["samples_drawn"] < settings.samples
    assert json.dumps(reach.built)


@each(
    "change",
    [
        {"cell": 0.0},
        {"cell": np.nan},
        {"samples": 10},
        {"seed": -1},
        {"sweeps": 0},
        {"keep": 1.5},
        {"seconds": 0.0},
        {"rotations": 500},
    ],
)
def test_a_setting_out_of_range_is_refused(change):
    with pytest.raises(BadInput, match="change it|choose"):
        ReachSettings(**change)


def test_a_grid_that_would_not_fit_in_memory_is_refused(arm):
    with pytest.raises(BuildRefused, match="larger"):
        build_reach_map(arm, ReachSettings(cell=0.005, rotations=576, samples=1000))
    assert MAX_BYTES < 1e10


def test_poses_that_are_none_are_refused(arm_map):
    for bad, word in (
        (np.full((4, 4), np.nan), "NaN"),
        (np.diag([2.0, 1, 1, 1]), "rigid"),
        (np.diag([1.0, 1, -1, 1]), "rigid"),
        (np.eye(3), "shape"),
        (np.zeros((0, 3, 4)), "shape"),
    ):
        with pytest.raises(BadInput, match=word):
            arm_map.quality(bad)
    with pytest.raises(BadInput, match="cells go"):
        arm_map.qualities(np.array([arm_map.grid.n_cells]))
    with pytest.raises(BadInput, match=r"cells are \[0.5\]; give .n,. whole numbers"):
        arm_map.qualities([0.5])
    with pytest.raises(BadInput, match="cells must be an array of real"):
        arm_map.qualities("all")
    for wrong in (None, "first", 10**400):
        with pytest.raises(BadInput, match="a cell is .*; give the whole number"):
            arm_map.witness_of(wrong)
    assert len(arm_map.quality(np.empty((0, 4, 4)))) == 0


def test_a_recall_of_another_chain_is_refused(arm_map, robot):
    with pytest.raises(BadInput, match="is not what the map"):
        measure_recall(arm_map, chain_of(robot))


def test_the_yardstick_is_the_best_of_samples_and_of_steps_from_the_best(
    arm, monkeypatch
):
    monkeypatch.setattr(extremes, "_YARDSTICK", 200)
    monkeypatch.setattr(extremes, "_CLIMB", 300)
    work, rng, most = work_of(arm), np.random.default_rng(4), [0.0, 0.0]

    def tried(q, kind):
        forward(arm.arrays, q, work.frames)
        jacobian(arm.arrays, work.frames, work.jac)
        value = slow_dexterity(arm, q, work.jac)
        better = value > max(most)
        most[kind] = max(value, most[kind])
        return q.copy() if better else best

    best = None
    for k in range(200):
        kernels.draw_code(5, k, work.code)
        from_lattice(arm.arrays, work.code, work.q)
        best = tried(work.q, 0)
    low, high = arm.limits.T
    for width in np.geomspace(0.1, 0.002, 300):
        step = width * (high - low) * rng.normal(size=arm.dof)
        best = tried(np.clip(best + step, low, high), 1)
    assert most[1] > 1.1 * most[0]
    assert best_dexterity(arm, 4) == pytest.approx(max(most), rel=1e-9)


def test_the_yardstick_and_the_work_are_those_of_the_chain(arm):
    work, best = work_of(arm), best_dexterity(arm, 1)
    for k in range(30_000):
        kernels.draw_code(8, k, work.code)
        from_lattice(arm.arrays, work.code, work.q)
        forward(arm.arrays, work.q, work.frames)
        jacobian(arm.arrays, work.frames, work.jac)
        assert (
            dexterity(arm.arrays, work.q, work.jac, work.weighted, work.gram)
            <= 1.0001 * best
        )
    assert best_dexterity(arm, 2) == pytest.approx(best, rel=0.05)
    assert len(touch_of(arm).pair) == 0
