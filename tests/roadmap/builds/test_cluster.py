"""Builds on Dask: the same bytes, whatever dies meanwhile; foreign workers refused."""

import os
import signal
import sys
import threading
import time

import numpy as np
import pytest
from chunk_jobs import chunks, job

import roadmap.builds.cluster
from roadmap.builds.chunks import ChunkFailed, ChunkStore, ForeignWorker, about
from roadmap.builds.cluster import Cluster, refuse_foreign, work
from roadmap.errors import BadInput, BuildRefused

distributed = pytest.importorskip("distributed")
SQUARES = np.arange(40.0) ** 2


def made_here(port=0):
    """Return a cluster of two workers that are threads of this process."""
    return distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=False,
        dashboard_address=":0",
        scheduler_port=port,
        protocol="tcp://",
    )


@pytest.fixture(scope="module")
def address():
    with made_here() as cluster:
        yield cluster.scheduler_address


def joined(found):
    return np.concatenate([arrays[0] for arrays in found])


@pytest.mark.parametrize("shared", [False, True])
def test_results_come_over_the_network_or_as_files(address, tmp_path, shared):
    store = ChunkStore(tmp_path / "chunks")
    folder = store.folder if shared else None
    with Cluster(scheduler=address, store=store, shared=folder) as cluster:
        found = joined(cluster.map(job("squares"), chunks()))
        assert np.array_equal(found, SQUARES) and store.found == 0
        # results are kept, what was given to workers is not
        assert len(list(store.folder.iterdir())) == 10
        list(cluster.map(job("squares"), chunks()))
    assert store.found == 10


def test_a_worker_that_does_not_see_the_shared_folder_is_told(tmp_path):
    name = "ab" * 32
    with pytest.raises(BuildRefused, match=f"what it was given in {tmp_path}; give a"):
        work(job("squares"), "key", chunks()[0], name, about(), tmp_path)


def test_an_item_that_raises_on_a_worker_is_named(address):
    with Cluster(scheduler=address) as cluster:
        with pytest.raises(ChunkFailed, match="number 7 failed"):
            list(cluster.map(job("not_seven"), chunks()))


def test_a_worker_with_another_program_is_refused_before_work(address, monkeypatch):
    other = about() | {"numpy": "1.26.0"}
    with pytest.raises(ForeignWorker, match=f"worker tcp.*numpy {np.__version__} inst"):
        monkeypatch.setattr(roadmap.builds.cluster, "about", lambda: other)
        refuse_foreign({"tcp://there:1": about()})
    with pytest.raises(ForeignWorker, match="cannot load this program"):
        refuse_foreign({"tcp://there:1": ModuleNotFoundError("no module roadmap")})
    with pytest.raises(ForeignWorker, match="1.26.0"):
        Cluster(scheduler=address)


def test_a_scheduler_that_comes_back_is_given_what_is_left(tmp_path):
    first, there = made_here(), []
    port = int(first.scheduler_address.rpartition(":")[2])

    def restart():
        time.sleep(0.25)
        first.close()
        there.append(made_here(port))

    store = ChunkStore(tmp_path / "chunks")
    with Cluster(scheduler=first.scheduler_address, store=store) as cluster:
        thread = threading.Thread(target=restart)
        thread.start()
        found = joined(cluster.map(job("squares", 0.1), chunks()))
        thread.join()
        assert np.array_equal(found, SQUARES)
    there[0].close()


def test_a_scheduler_that_stays_away_is_told(tmp_path):
    gone = made_here()
    gone.close()
    with pytest.raises(BuildRefused, match="no scheduler with workers answers at tcp"):
        Cluster(scheduler=gone.scheduler_address, patience=0.1)


def test_an_address_that_is_none_is_refused_before_a_client_begins(monkeypatch):
    monkeypatch.setattr("distributed.Client", None)
    for address in ("foo", "tcp://foo", "foo://host:8786"):
        with pytest.raises(BadInput, match="give one such as tcp://host:8786"):
            Cluster(scheduler=address)


def test_workers_may_be_killed_in_mid_chunk(tmp_path):
    with Cluster(workers=2) as cluster:
        cluster.ready()
        killed = []

        def kill():
            for _ in range(2):
                time.sleep(0.3)
                pids = [w.pid for w in cluster._local.workers.values() if w.pid]
                killed.append(pids[0])
                os.kill(pids[0], signal.SIGKILL)

        thread = threading.Thread(target=kill)
        thread.start()
        found = joined(cluster.map(job("squares", 0.1), chunks(40)))
        thread.join()
    assert len(killed) == 2 and np.array_equal(found, SQUARES)


def test_without_the_extra_it_is_said_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BuildRefused, match=r"pip install 'odm-planner\[cluster\]'"):
        Cluster(workers=2)
