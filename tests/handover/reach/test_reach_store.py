"""Reach maps in files: the same when loaded, refused when they are not theirs."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from reach_chains import naive_cell, some_poses

from handover import load_reach_map
from handover.reach import _reach_build as kernels
from handover.reach.reach_map import ReachMap
from roadmap.builds.store import _manifest_hash
from roadmap.errors import BadMap


def test_a_stored_map_is_the_same_by_memory_map(arm_map, tmp_path, rng):
    arm_map.save(tmp_path / "arm")
    loaded = load_reach_map(tmp_path / "arm", verify=True, robot=arm_map.chain)
    for name, array in loaded.packed._asdict().items():
        np.testing.assert_array_equal(array, getattr(arm_map.packed, name))
        assert not array.flags.writeable
    poses = some_poses(arm_map, 200, rng)
    np.testing.assert_array_equal(loaded.quality(poses), arm_map.quality(poses))
    cell = int(loaded.marked_cells()[100])
    np.testing.assert_array_equal(loaded.witness_of(cell), arm_map.witness_of(cell))
    assert loaded.hash and loaded.chain.unit == "arm length"
    # as the map of a robot, whose joints are found again without its URDF
    assert (
        load_reach_map(tmp_path / "arm").chain.fingerprint()
        == arm_map.chain.fingerprint()
    )


def test_a_file_is_compact(robot_map, tmp_path):
    folder = robot_map.save(tmp_path / "robot")
    size = sum(f.stat().st_size for f in folder.iterdir())
    assert size < 5 * robot_map.n_marked + 20_000


@pytest.fixture
def stored(arm_map, tmp_path):
    return arm_map.save(tmp_path / "arm")


def test_a_map_of_another_robot_is_refused(stored, robot, arm_map):
    limits = np.array(arm_map.chain.limits)
    limits[0, 0] += 0.01
    for other in (robot, replace(arm_map.chain, limits=limits)):
        with pytest.raises(BadMap, match="another robot"):
            load_reach_map(stored, robot=other)


def test_a_truncated_array_is_refused_even_unverified(stored):
    file = stored / "quality.npy"
    file.write_bytes(file.read_bytes()[:-500])
    with pytest.raises(BadMap, match="truncated"):
        load_reach_map(stored, verify=False)


def test_an_altered_array_is_refused_when_verified(stored):
    file = stored / "way.npy"
    data = bytearray(file.read_bytes())
    data[-100] ^= 1
    file.write_bytes(bytes(data))
    with pytest.raises(BadMap, match="altered"):
        load_reach_map(stored, verify=True)


def test_a_witness_that_contradicts_the_map_is_an_error_not_a_wrong_answer(arm_map):
    roots = np.array(arm_map.packed.roots)
    roots[:] = roots[::-1]
    wrong = ReachMap(
        arm_map.chain, arm_map.grid, arm_map.packed._replace(roots=roots), 1.0
    )
    pushed = arm_map.marked_cells()[arm_map.packed.predecessor != kernels.ROOT]
    refused = 0
    for cell in pushed[:200]:
        try:
            q = wrong.witness_of(int(cell))
        except BadMap:
            refused += 1
        else:
            assert naive_cell(wrong.grid, wrong.chain.tool_pose(q)) == cell
    assert refused > 100


def test_a_foreign_version_another_kind_and_no_map_are_refused(stored, tmp_path):
    manifest = stored / "manifest.json"
    text = manifest.read_text()
    manifest.write_text(text.replace('"format": 1', '"format": 99'))
    with pytest.raises(BadMap, match="version 99"):
        load_reach_map(stored)
    manifest.write_text(text.replace('"kind": "reach map"', '"kind": "cell map"'))
    with pytest.raises(BadMap):
        load_reach_map(stored)
    shutil.rmtree(stored)
    with pytest.raises(BadMap, match="workspace build"):
        load_reach_map(stored)


def test_a_loaded_map_is_not_changed_by_its_files(stored, arm_map, rng):
    loaded, poses = load_reach_map(stored), some_poses(arm_map, 200, rng)
    for file in stored.glob("*.npy"):
        with open(file, "r+b") as stream:
            stream.truncate(64)  # touched by a map of the file this ends in SIGBUS
    np.testing.assert_array_equal(loaded.quality(poses), arm_map.quality(poses))


@pytest.mark.parametrize("key", ["grid", "joint_names", "robot_rows", "reference"])
@pytest.mark.parametrize("wrong", [3, None, "gone"])
def test_fields_of_a_wrong_type_are_refused(stored, key, wrong):
    file = stored / "manifest.json"
    manifest = json.loads(file.read_text())
    manifest[key] = wrong
    if wrong == "gone" or key == "reference":
        del manifest[key]
    manifest["hash"] = _manifest_hash(manifest)
    file.write_text(json.dumps(manifest))
    with pytest.raises(BadMap, match="build the map again"):
        load_reach_map(stored)
