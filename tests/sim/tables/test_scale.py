"""What sizes bring: the nearest measured one is told, the smallest good one chosen."""

from dataclasses import dataclass

import pytest

from sim.tables import scale
from sim.tables.scale import choice, gain_of


@dataclass(frozen=True)
class Row:
    """Costs of one size."""

    nodes: int
    h: float
    map_bytes: int

    @property
    def memory_bytes(self):
        """As much as the folder takes."""
        return self.map_bytes


def size(nodes, h, clutter, crossing=95.0):
    figures = {"crossing": crossing, "clutter": clutter, "clutter_p95_ms": 9.0}
    return {"nodes": nodes, "h": h} | figures


@pytest.fixture
def measured(monkeypatch):
    sizes = [
        size(1000, 0.04, 80.0), size(3000, 0.04, 95.0), size(10000, 0.04, 95.6),
        size(10000, 0.03, 99.0), size(3000, 0.05, 60.0),
    ]  # fmt: skip
    monkeypatch.setattr(scale, "_measured", lambda: sizes)


def test_the_nearest_size_is_told(measured):
    assert gain_of(2900, 0.04).clutter == 95.0
    assert gain_of(30_000, 0.031).clutter == 99.0
    assert gain_of(1000, 0.05).clutter == 60.0, "a cell size counts more than nodes"


def test_the_smallest_that_does_as_well_is_chosen_of_those_that_fit(measured):
    rows = [
        Row(1000, 0.04, 15), Row(3000, 0.04, 40), Row(10_000, 0.04, 120),
        Row(10_000, 0.03, 220),
    ]  # fmt: skip
    assert choice(rows, 10_000) == rows[3]
    assert choice(rows, 6 * 120) == rows[1], "10 000 nodes are hardly better"
    assert choice(rows, 6 * 39) == rows[0]
    assert choice(rows, 60) is None


def test_one_that_is_much_sooner_is_worth_its_bytes(monkeypatch):
    slow, quick = size(3000, 0.04, 95.0), size(10_000, 0.04, 95.0)
    monkeypatch.setattr(scale, "_measured", lambda: [slow, quick])
    rows = [Row(3000, 0.04, 40), Row(10_000, 0.04, 120)]
    assert choice(rows, 10_000) == rows[0]
    slow["clutter_p95_ms"] = 2 * quick["clutter_p95_ms"]
    assert choice(rows, 10_000) == rows[1]


def test_the_figures_that_come_along_are_whole():
    sizes = scale._measured.__wrapped__()
    assert len(sizes) >= 3
    for one in sizes:
        gain = gain_of(one["nodes"], one["h"])
        assert 50 < gain.crossing <= 100 and 0 < one["frame_p50_us"] < 1000
