"""The bench of many sizes: what it fits, and that its table has every figure."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small import AWAY, HOME, small_recipe

import odm
from odm.cell_map import estimate
from roadmap.errors import BadInput
from sim.bench.frames import Pair
from sim.bench.scale import limited, scale


def test_exponents_are_those_of_the_figures():
    sizes = [
        scale.Size(n, 7 * n, 0.04, 1e-3 * n, 1, 1, 1, n**1.5, 5.0, 2.0 * n, 10.0,
                   n**0.5, 100, 1, np.nan, np.nan, 1, 1)
        for n in (100, 1000, 5000)
    ]  # fmt: skip
    found = scale._exponents(sizes)
    assert found["edges"] == 1 and found["build_cpu_s"] == 1.5
    assert found["load_ms"] == 0 and found["frame_p99_us"] == 0.5
    assert scale._exponents(sizes[:1]) == {}


@pytest.mark.parametrize("text", ["", "ten", "1", "10,nan", "100,,200"])
def test_numbers_that_are_none_are_refused(text):
    with pytest.raises(BadInput, match="--nodes is .* with commas"):
        scale._numbers("--nodes", text, 2, 5e6)


def test_maps_are_built_once_asked_and_drawn(tmp_path, monkeypatch):
    robot = odm.load_recipe  # restored by monkeypatch
    monkeypatch.setattr(scale, "load_recipe", lambda name: small_recipe())
    q = np.random.default_rng(0).uniform(0.4, 0.6, (4, 1, 7))
    pair = Pair(HOME, AWAY, q, "sweep")
    monkeypatch.setattr(scale, "_drawn", lambda *args: ([pair], []))
    limited = {"answers": 3.0, "times": 1.1, "fits": False, "note": "n"}
    monkeypatch.setattr(scale, "answered_within", lambda *args: limited)
    given = {"node_counts": "60,120", "out": tmp_path, "plot": tmp_path / "s.png"}
    result = scale.run(**given)
    json.dumps(result)
    assert [s["edges"] for s in result["sizes"]] == sorted(
        s["edges"] for s in result["sizes"]
    )
    assert 0.8 < result["exponents"]["edges"] < 1.6
    names = [row["name"] for row in result["rows"]]
    assert "exponent of bytes over nodes" in names
    assert names[-1] == "... p99 against no limit" and result["rows"][-1]["met"]
    assert (tmp_path / "s.png").stat().st_size > 10_000 and robot

    def never(*args, **options):
        raise AssertionError("it lies there")

    monkeypatch.setattr(scale, "build_map", never)
    again = scale.run(**given)
    assert again["sizes"][0]["edges"] == result["sizes"][0]["edges"]
    with pytest.raises(AssertionError, match="lies there"):
        scale.run(**given | {"node_counts": "70"})


def test_a_large_map_is_judged_by_what_is_asked():
    small = scale.Size(
        9900, 7, 0.04, 100, 1, 1, 50, 90, 5, 9, 10, 100, 99, 1, 99, 2, 1, 1
    )
    large = replace(small, megabytes=450, frame_p50_us=19, frame_p99_us=210)
    rows = {r["name"]: r for r in scale._rows([small, large], [10_000, 100_000])}
    assert rows["... folder"]["met"] and rows["... load, unverified"]["met"]
    assert rows["... frame p50 against 10,000 nodes"]["met"]
    assert rows["... p99"]["met"] is False


def test_a_process_that_has_no_room_is_told_with_its_last_word(tmp_path, monkeypatch):
    rods = np.tile([0.3, 0.3, 1.2, 0.3, 0.4, 1.3, 0.05], (3, 1, 1))
    pair = Pair(HOME, AWAY, rods, "sweep")
    ends = {"returncode": 1, "stderr": "Traceback\nMemoryError: 8 MB", "stdout": ""}
    monkeypatch.setattr(
        limited.subprocess, "run", lambda *a, **k: SimpleNamespace(**ends)
    )
    found = limited.answered_within(tmp_path, pair, 0.5)
    assert found["answers"] == 0 and "it failed: MemoryError: 8 MB" in found["note"]
    row = scale._limit_rows(found)[0]
    assert row["met"] is False
    ends |= {"returncode": 0, "stdout": "[[1e-5, 2e-5], [3e-5, 6e-5], 3, false]"}
    found = limited.answered_within(tmp_path, pair, 0.5)
    assert found["times"] == pytest.approx(3.0) and "does not fit" in found["note"]


def test_free_memory_heeds_the_limit_of_the_process(monkeypatch):
    whole, taken = estimate.free_memory(), estimate.taken_memory()
    assert whole > 1e8 and 1e7 < taken < 1e11
    monkeypatch.setattr(
        estimate.resource, "getrlimit", lambda _: (taken + 5_000_000, -1)
    )
    assert 0 <= estimate.free_memory() <= 6_000_000
