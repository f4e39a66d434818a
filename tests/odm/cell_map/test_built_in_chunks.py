"""A build in chunks: on a cluster, or gone on with, it is the same map."""

import errno
from dataclasses import replace

import numpy as np
import pytest
from small import small_recipe

import odm
import roadmap.builds.chunks
from odm.cell_map import chunk_work
from odm.cell_map.recipe import PayloadRecipe
from roadmap.builds.chunks import ChunkFailed, ChunkStore, Threads
from roadmap.builds.cluster import Cluster
from roadmap.errors import BuildRefused


def assert_same(mine, its):
    for part in ("arm_cells", "roadmap"):
        for name, array in getattr(mine, part).arrays().items():
            other = getattr(its, part).arrays()[name]
            assert array.dtype == other.dtype and np.array_equal(array, other), name


def built(small_map, workers):
    return odm.build_map(small_recipe(), robot=small_map.robot, workers=workers)


@pytest.fixture
def address():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as cluster:
        yield cluster.scheduler_address


def test_a_map_from_a_cluster_has_the_bytes_of_one_from_threads(small_map, address):
    with Cluster(scheduler=address) as cluster:
        assert_same(small_map, built(small_map, cluster))


def test_a_build_that_met_a_full_disk_goes_on(small_map, tmp_path, monkeypatch):
    store, put = ChunkStore(tmp_path / "chunks"), roadmap.builds.chunks.put_file

    def filling(path, data):
        if len(list(store.folder.glob("*"))) == 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        put(path, data)

    monkeypatch.setattr(roadmap.builds.chunks, "put_file", filling)
    with pytest.raises(BuildRefused, match="the disk is full"):
        built(small_map, Threads(1, store))
    monkeypatch.setattr(roadmap.builds.chunks, "put_file", put)
    assert_same(small_map, built(small_map, Threads(1, store)))
    assert 1 <= store.found <= 3  # of those drawn ahead, some are never asked for


def test_another_recipe_takes_no_chunk_of_this_one(small_map, tmp_path):
    store = ChunkStore(tmp_path / "chunks")
    built(small_map, Threads(1, store))
    recipe = small_recipe(user=0.02)
    other = odm.build_map(recipe, robot=small_map.robot, workers=Threads(1, store))
    assert_same(odm.build_map(recipe, threads=1, robot=small_map.robot), other)


def test_an_edge_that_raises_is_named(small_map, monkeypatch):
    sweep = chunk_work.sweep.sweep_edges
    ends = small_map.roadmap.edges[5]
    bad = small_map.roadmap.nodes[ends[0]]

    def failing(swept, q, dq, *rest):
        if dq.any() and (q == bad).all(axis=1).any():
            raise FloatingPointError("a bad edge")
        return sweep(swept, q, dq, *rest)

    monkeypatch.setattr(chunk_work.sweep, "sweep_edges", failing)
    first = np.flatnonzero(
        (small_map.roadmap.nodes[small_map.roadmap.edges[:, 0]] == bad).all(axis=1)
    )[0]
    with pytest.raises(ChunkFailed, match=rf"edge {first} failed: Float.*a bad edge"):
        built(small_map, Threads(1))


def test_the_payload_is_swept_by_the_same_workers(small_map, tmp_path):
    recipe = replace(small_recipe(), payload=PayloadRecipe(radius=0.05))
    store = ChunkStore(tmp_path / "chunks")
    one, other = (
        odm.build_map(recipe, robot=small_map.robot, workers=Threads(2, store)).payload
        for _ in range(2)
    )
    assert one.cells.n_entries and store.found
    for name, array in one.arrays().items():
        assert np.array_equal(array, other.arrays()[name]), name
