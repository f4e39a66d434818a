"""Who builds: two crews at once are refused; chunks go when all is done."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from chunk_jobs import chunks, job

import sim.run.crew
from roadmap.builds.chunks import ChunkStore
from roadmap.errors import BadInput, BuildRefused, NothingFree
from sim.run.crew import Place, begin_ahead, chunk_folder, crew

ROOT = Path(__file__).resolve().parents[3]


def test_chunks_are_kept_until_the_target_is_there(tmp_path, capsys):
    target = tmp_path / "map"
    folder = chunk_folder(target)
    assert folder.parent == tmp_path and folder.name.startswith(".map")
    with pytest.raises(MemoryError):
        with crew(target, 1, Place()) as workers:
            stream = workers.map(job("squares"), chunks())
            next(stream)
            stream.close()
            raise MemoryError
    kept = len(list(folder.iterdir()))
    assert kept
    with crew(target, 1, Place()) as workers:
        assert len(list(workers.map(job("squares"), chunks()))) == 10
    assert not folder.exists()
    assert f"went on from {kept} stored chunks" in capsys.readouterr().err


def test_ctrl_c_leaves_no_chunks_even_of_threads_still_at_work(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        with crew(tmp_path / "map", 2, Place()) as workers:
            stream = workers.map(job("squares", 0.02), chunks())
            next(stream)
            raise KeyboardInterrupt
    stream.close()
    assert not list(tmp_path.iterdir())


def test_where_nothing_is_free_no_chunks_are_kept_for_another_try(tmp_path):
    with pytest.raises(NothingFree):
        with crew(tmp_path / "map", 1, Place()) as workers:
            assert len(list(workers.map(job("squares"), chunks()))) == 10
            raise NothingFree
    assert not list(tmp_path.iterdir())


def test_ctrl_c_while_chunks_are_removed_leaves_none(tmp_path, monkeypatch):
    clear, calls = ChunkStore.clear, []

    def cut_in_two(store):
        calls.append(store)
        if len(calls) == 1:
            raise KeyboardInterrupt
        clear(store)

    monkeypatch.setattr(ChunkStore, "clear", cut_in_two)
    with pytest.raises(KeyboardInterrupt):
        with crew(tmp_path / "map", 1, Place()) as workers:
            assert len(list(workers.map(job("squares"), chunks()))) == 10
    assert not list(tmp_path.iterdir())


def test_two_clusters_or_a_shared_folder_without_one_are_refused(tmp_path):
    both = Place(workers=2, scheduler="tcp://there:1")
    for place, told in ((both, "leave one"), (Place(shared=tmp_path), "--shared is")):
        with pytest.raises(BadInput, match=told):
            with crew(tmp_path / "map", 1, place):
                pass


def test_without_dask_a_build_is_refused_in_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(BuildRefused, match="or build with --threads instead"):
        with crew(tmp_path / "map", 1, Place(workers=2)):
            pass
    assert not list(tmp_path.iterdir())


def test_workers_are_forked_from_a_process_that_loads_what_they_need(monkeypatch):
    began = []
    threads = os.environ.get("OMP_NUM_THREADS")
    monkeypatch.setattr(
        sim.run.crew, "ensure_running", lambda: began.append(dict(os.environ))
    )
    begin_ahead(Place(), "chunk_jobs")
    begin_ahead(Place(scheduler="tcp://there:1"), "chunk_jobs")
    assert not began
    pytest.importorskip("distributed")
    begin_ahead(Place(workers=2), "chunk_jobs")
    assert [env["OMP_NUM_THREADS"] for env in began] == ["1"]
    assert os.environ.get("OMP_NUM_THREADS") == threads
    monkeypatch.setitem(sys.modules, "distributed", None)
    begin_ahead(Place(workers=2), "chunk_jobs")
    assert len(began) == 1


def test_a_build_that_is_killed_goes_on(tmp_path):
    script = (
        "import sys; from pathlib import Path; sys.path[:0] = sys.argv[2:]\n"
        "from chunk_jobs import job, chunks; from sim.run.crew import HERE, crew\n"
        "with crew(Path(sys.argv[1]), 1, HERE) as workers:\n"
        "    for k, _ in enumerate(workers.map(job('squares', 0.05), chunks())):\n"
        "        print(k, flush=True)\n"
    )
    target = tmp_path / "map"
    words = [sys.executable, "-c", script, target, ROOT, ROOT / "tests"]
    with subprocess.Popen(list(map(str, words)), stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"0\n"
        os.kill(process.pid, signal.SIGKILL)
    kept = len([p for p in chunk_folder(target).iterdir() if p.name[0] != "."])
    assert 1 <= kept < 10
    with crew(target, 1, Place()) as workers:
        assert len(list(workers.map(job("squares", 0.05), chunks()))) == 10
        assert workers.store.found == kept
