"""The bench of long runs: what grows is found, what is flat is not, late frames too."""

import json
import mmap

import numpy as np
import pytest
from small import small_recipe

import odm as planner
from roadmap.errors import BadInput
from sim.bench.core import memory


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    folder = tmp_path_factory.mktemp("memory")
    return planner.build_map(small_recipe()).save(folder / "arm3")


def test_the_short_bench_has_every_row_and_every_look(odm, map_dir, tmp_path):
    file = tmp_path / "memory.json"
    words = ("--map", map_dir, "--short", "--motion", "hover", "--json", file)
    code, out, _ = odm("bench", "memory", *words)
    result = json.loads(file.read_text())
    assert code == 0 and "memory grew" in " ".join(out.split())
    assert [row["name"].split(": ")[1] for row in result["rows"]] == [
        "memory grew",
        "its slope over an hour",
        "deadlines missed by CPU time",
        "deadlines missed by wall clock",
        "step",
    ]
    looks = np.array(result["memory"]["hover"])
    assert looks.shape == (memory.LOOKS, 2) and (np.diff(looks[:, 0]) > 0).all()
    assert looks[-1, 0] == 6.0 and (looks[:, 1] > 1.0).all()
    assert result["rows"][-1]["n"] == 600


def test_memory_that_is_used_is_seen():
    before = memory.memory_bytes()
    with mmap.mmap(-1, 64_000_000) as own:  # never from what the heap has left
        own.write(bytes(64_000_000))
        assert memory.memory_bytes() - before > 32_000_000


@pytest.mark.parametrize("grows", [True, False])
def test_a_loop_that_keeps_its_frames_is_found_out(grows, monkeypatch):
    kept = []
    # a process reuses what other tests left in its heap: here memory is what is kept
    used = lambda: 300_000_000 + 16_000 * len(kept)  # noqa: E731
    monkeypatch.setattr(memory, "memory_bytes", used)

    class Loop:
        class settings:  # noqa: N801 (as a loop has it)
            rate_hz = 100.0

        def frame(self):
            if grows:
                kept.append(self)

            class Frame:
                wall_s = cpu_s = 0.02
                improve_s = improve_cpu_s = 0.0

            return Frame

    times, looks = memory._played(Loop(), 1200)
    grown, slope = memory.growth(looks)
    assert (grown > 10.0) == grows and (slope > 1000.0) == grows
    late = memory._late(times, 0.01)
    assert len(late) == 1200 and late[0] == {"frame": 0, "wall_s": 0.02, "cpu_s": 0.02}


def test_growth_is_told_between_the_means_of_both_ends():
    looks = np.column_stack([np.arange(1.0, 61.0), np.full(60, 200.0)])
    looks[:6, 1] = 100.0  # buffers that find their size are not counted
    assert memory.growth(looks) == pytest.approx((0.0, 0.0), abs=1e-6)
    looks[:, 1] += looks[:, 0] / 3600.0  # 1 MB an hour
    grown, slope = memory.growth(looks)
    assert slope == pytest.approx(1.0) and 0.01 < grown < 0.015


def test_a_run_shorter_than_its_looks_is_refused(map_dir):
    with pytest.raises(BadInput, match="give at least 0.6 s"):
        memory.run(map_dir, seconds=0.2)


def test_frames_late_by_cpu_time_are_all_listed_and_first():
    times = np.full((200, 4), 0.001)
    times[20:120, 2] = 0.02 + 1e-4 * np.arange(100)  # kept waiting by others
    times[150:153, 2:] = 0.011
    late = memory._late(times, 0.01)
    assert [row["frame"] for row in late[:4]] == [150, 151, 152, 119]
    assert len(late) == 50
