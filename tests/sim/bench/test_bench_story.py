"""Frames of `odm bench story`: late ones are counted, and played again."""

from types import SimpleNamespace

import pytest

from sim.bench.handover import story as bench
from sim.story.cases import StoryCase


@pytest.mark.parametrize(
    ("turns", "repeats", "again", "counts"),
    [
        ([[1, 2, 3]], 1, 0, [1, 2, 3]),
        ([[1, 70, 3], [1, 2, 3]], 1, 0, [1, 70, 3]),
        ([[1, 70, 30], [80, 2, 12]], 1, 1, [1, 70, 30]),
        ([[1, 70, 12], [80, 2, 12], [80, 3, 11]], 3, 1, [1, 2, 11]),
    ],
)
def test_a_late_frame_is_played_again(monkeypatch, turns, repeats, again, counts):
    """What is late each time is the program's; what is late once may be anyone's."""
    left = [SimpleNamespace(cpu_s=[1e-3 * c for c in turn]) for turn in turns]
    monkeypatch.setitem(bench._KEPT, "setup", None)
    monkeypatch.setattr(bench, "StoryPlay", lambda setup, case: case)
    monkeypatch.setattr(bench, "play", lambda run, seconds: left.pop(0))
    monkeypatch.setattr(bench, "figures_of", lambda result: {"direction": "give"})
    case = StoryCase("give")
    told = bench._played(("map", None, ("jaw",), "", case, 20.0, repeats))
    assert not left
    assert told["cpu_ms"] == counts and told["late_again"] == again


def test_frames_are_judged_as_they_were_first():
    runs = [
        {"cpu_ms": [1.0] * 90 + [3.0] * 9 + [50.0], "late_again": 0},
        {"cpu_ms": [1.0] * 100, "late_again": 0},
    ]
    rows = {row["name"]: row for row in bench._frames(runs)}
    missed = next(row for name, row in rows.items() if name.startswith("deadlines"))
    assert missed["value"] == 1.0 and not missed["met"]
    assert rows["... late again, the same run repeated"]["value"] == 0.0
    assert rows["frame, CPU: p50"]["value"] == 1.0 and rows["frame, CPU: p50"]["met"]
