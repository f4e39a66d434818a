"""A reach map in chunks has the bytes of one that threads fill in place."""

import numpy as np
import pytest

from handover import ReachSettings, build_reach_map, chain_of
from handover.reach.reach_chunks import ReachSpec, mark_chunk
from roadmap.builds.chunks import ChunkFailed, ChunkStore, Threads

SETTINGS = ReachSettings(cell=0.1, rotations=72, samples=60_000, seed=3)


@pytest.fixture(scope="module")
def chain(robot):
    return chain_of(robot)


def assert_same(one, other):
    for name in one.packed._fields:
        mine, its = getattr(one.packed, name), getattr(other.packed, name)
        assert mine.dtype == its.dtype and np.array_equal(mine, its), name


def test_chunks_give_the_same_bytes_and_are_gone_on_with(chain, robot_map, tmp_path):
    store = ChunkStore(tmp_path / "chunks")
    for threads, found in ((2, 0), (1, 10)):
        store.found = 0
        workers = Threads(threads, store)
        assert_same(robot_map, build_reach_map(chain, SETTINGS, 1, None, workers))
        assert store.found >= found


def test_a_cluster_gives_the_same_bytes(chain, tmp_path):
    few = ReachSettings(cell=0.4, rotations=72, samples=1_000, seed=3)
    distributed = pytest.importorskip("distributed")
    from roadmap.builds.cluster import Cluster

    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=False,
        dashboard_address=":0",
        protocol="tcp://",
    ) as local:
        store, there = ChunkStore(tmp_path / "chunks"), local.scheduler_address
        with Cluster(scheduler=there, store=store) as workers:
            found = build_reach_map(chain, few, 1, None, workers)
        done = {len(worker.state.log) > 0 for worker in local.workers.values()}
    assert done == {True} and len(list(store.folder.iterdir())) >= 10
    assert_same(build_reach_map(chain, few, 1), found)


def test_a_position_that_raises_is_named(chain, monkeypatch):
    import handover.reach.reach_chunks as chunks

    def failing(maker, positions, *rest):
        if len(positions) == 1 or (positions > 50).any():
            raise FloatingPointError("a bad place")
        return mark_chunk(maker, positions, *rest)

    monkeypatch.setattr(chunks, "mark_chunk", failing)
    with pytest.raises(ChunkFailed, match=r"position \d+ failed: Float.*a bad place"):
        build_reach_map(chain, SETTINGS, 1, None, Threads(1))


def test_the_spec_of_a_chain_has_a_key_of_its_content(chain, arm):
    def key(chain, cell=0.2):
        from roadmap.builds.chunks import Job

        spec = ReachSpec(chain, cell, 72)
        return Job("a:b", "a:c", spec, "position", 1).key()

    assert key(chain) == key(chain)
    assert len({key(chain), key(arm), key(chain, 0.1)}) == 3
