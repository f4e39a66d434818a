"""Our planner and VAMP on the same frames: who is asked what, and what is told."""

from types import SimpleNamespace

import numpy as np
import pytest
from small import AWAY, HOME

from sim.bench.frames import Pair
from sim.bench.rivals import beside_vamp as beside
from sim.bench.rivals.peer_vamp import VampMissing

FRAMES = 4


def pairs(n):
    rods = np.array(
        [[0.5, 0.4, 0.9, 0.5, 0.5, 1.1, 0.05], [0.5, 0.5, 1.1, 1, 1, 1, 0.04]]
    )
    capsules = np.stack([rods + 0.001 * k for k in range(FRAMES)])
    return [Pair(HOME, AWAY, capsules, "sweep")] * n


def test_everyone_has_the_same_frames_and_only_the_first_set_is_asked(
    small_map, monkeypatch
):
    asked = []

    class Fake:
        def __init__(self, robot, simplified):
            self.simplified = simplified

        def begin(self, case):
            np.testing.assert_array_equal(case.q_goal, AWAY)
            asked.append((self.simplified, "begin"))

        def path(self, frame):
            return np.stack([HOME, AWAY])

        def world(self, frame):
            return frame.rods

        def planned(self, world):
            asked.append((self.simplified, "plan"))
            # free but in the pair's third frame
            return SimpleNamespace(validate=lambda rods: rods[0, 0] != 0.502)

    monkeypatch.setattr(beside, "Vamp", Fake)
    rows = beside.beside_vamp(small_map, pairs(2), pairs(1))
    first, second = rows[: len(rows) // 2], rows[len(rows) // 2 :]
    sets = (first, 2, "these frames"), (second, 1, "straight motion blocked")
    for part, n, what in sets:
        timed = [row for row in part if "wall" in row]
        assert [row["n"] for row in timed] == [n * FRAMES] * 5
        assert timed[0]["name"] == f"beside VAMP, {what}: every frame replanned"
    lengths = [row for row in rows if "path length" in row["name"]]
    straight = np.linalg.norm(AWAY - HOME)
    assert [row["value"] for row in lengths[2::4]] == pytest.approx([straight] * 2)
    assert lengths[1]["value"] / straight == pytest.approx(lengths[3]["value"])
    assert [row["asked"].get("most") for row in lengths] == [None] * 3 + [1.0] + [
        None
    ] * 4
    ratios = [row for row in rows if "times faster" in row["name"]]
    assert all(row["value"] > 0.0 for row in ratios)
    least = [row["asked"].get("least") for row in ratios]
    assert least == [5.0, 2.5, 1.0, 1.0, 1.0, 1.0, 1.0] + [None] * 7
    assert "times faster than VAMP simplified, p50" in ratios[0]["name"]
    passes = beside.PASSES * 3
    # one to begin with and one a frame; of a kept path one where it is not free
    assert asked.count((False, "plan")) == passes * (1 + FRAMES)
    assert asked.count((True, "plan")) == passes * (1 + FRAMES + 1 + 1)
    looked = 3  # frames whose paths' lengths are compared, one of each pair
    begun = asked.count((True, "begin")) - looked
    assert begun == 2 * asked.count((False, "begin"))


def test_the_least_of_all_passes_counts():
    passes = iter([[5_000, 9_000], [7_000, 2_000], [6_000, 3_000]])

    def run(pair, clock):
        clock.wall.extend(next(passes))
        return [True, len(clock.wall) and clock.wall[1] != 2_000]

    told = beside._least({"one": run}, [0])
    assert told.times["one"].tolist() == [5.0, 2.0]
    assert told.solved["one"].tolist() == [True, False]


def test_who_has_no_path_is_told_and_not_taken_for_fast():
    names = beside._OURS, beside._SIMPLIFIED, beside._RAW
    names += beside._OURS_KEPT, beside._CHECK
    times = {name: np.array([10.0, 10.0, 10.0, 10.0]) for name in names}
    solved = {name: np.array([True, True, True, True]) for name in names}
    times[beside._OURS][:2], solved[beside._OURS][:2] = 0.1, False  # it gives up
    times[beside._RAW][3], solved[beside._RAW][3] = 1e6, False
    rows = beside._rows("these frames", beside.Told(times, solved), asks=True)
    by_name = {row["name"]: row.get("value") for row in rows}
    assert by_name[f"... frames with a path: {beside._OURS}"] == 50.0
    assert by_name[f"... frames with a path: {beside._RAW}"] == 75.0
    for share in (50, 99):
        for theirs in (beside._SIMPLIFIED, beside._RAW):
            name = f"... {beside._OURS}: times faster than {theirs}, p{share}"
            assert by_name[name] == 1.0


def test_without_vamp_one_row_says_so(small_map, monkeypatch):
    def missing(*_):
        raise VampMissing("not installed")

    monkeypatch.setattr(beside, "Vamp", missing)
    (row,) = beside.beside_vamp(small_map, pairs(1), pairs(1))
    assert row["value"] is None and "not installed" in row["name"]
