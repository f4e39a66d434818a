"""What the screen says, at every size; figures so far; the pace of the wall clock."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.keyboard.key_motion import KeyboardArm
from sim.keyboard.picture import painted, picture
from sim.keyboard.session import Pacer
from sim.keyboard.shown import View, plain_line
from sim.keyboard.stats import Histogram, Stats
from sim.loop.loop import Frame

REASON = (
    "goal 0 is blocked: point 30 would be -6.3 cm from panda_link5 there, closer than "
    "2.7 cm; move it 9.0 cm away, or give another goal, or wait until it has moved"
)


def frame(index, status="following", place=1, separation=0.123, reason=REASON):
    answer = SimpleNamespace(status=status, reason=reason)
    capsules = np.zeros((2, 7))
    latency = 50e-6 if index % 50 else 4e-3
    return Frame(
        index, np.zeros(7), capsules, answer, place, separation, 0.2, 0.31, latency,
        latency, 0.0,
    )  # fmt: skip


def stats_of(statuses, **values):
    stats = Stats(100.0)
    for index, status in enumerate(statuses):
        stats.take(frame(index, status, **values))
    return stats


def view_of(stats, **values):
    arm = KeyboardArm()
    return View("panda", 100.0, stats, arm.state, arm.limits, **values)


def shown(view, width=80, height=24):
    return "\n".join(line.plain for line in picture(view, width, height))


HELD = ["following"] * 200 + ["holding"] * 50


@given(st.integers(1, 200), st.integers(1, 60), st.booleans())
def test_the_picture_fits_whatever_the_size(width, height, explains):
    view = view_of(stats_of(HELD[195:205]), blocked=0.5, edges=10, help=explains)
    lines = picture(view, width, height)
    assert 1 <= len(lines) <= height
    assert all(line.cell_len <= width for line in lines)
    rows = painted(lines, width)
    assert [full for _, full in rows] == [line.cell_len == width for line in lines]


@pytest.mark.parametrize("size", [(80, 24), (72, 20), (120, 50), (40, 12)])
def test_all_that_matters_is_on_the_screen(size):
    view = view_of(stats_of(HELD), blocked=0.34, edges=76912, late=3, slipped_s=0.1)
    text = shown(view, *size)
    for words in ("holding for 0.5 s", "0:02", "goal 0 is blocked", "panda_link5"):
        assert words in text
    for words in ("12.3 cm, smallest 12.3 cm", "p50 50 µs, p99 4.0 ms", "34 %"):
        assert words in text
    for words in ("3 of 250", "flexion", "-35°", "25°", "95°", "5 cm 8°", "q end"):
        assert words in text
    assert all(key in text for key in "↑↓←→ujwsedrftghp?")


def test_a_long_reason_takes_two_lines_and_says_that_there_is_more():
    lines = shown(view_of(stats_of(HELD)), 40, 12).splitlines()
    assert lines[1].startswith("  goal 0") and lines[2].endswith("…")
    assert lines[3].startswith("separation")


def test_on_few_lines_state_and_keys_stay():
    lines = shown(view_of(stats_of(HELD)), 40, 5).splitlines()
    assert lines[0].startswith("● holding") and lines[-1].startswith("+-")


def test_the_help_names_every_key_also_on_a_small_screen():
    text = shown(view_of(stats_of(HELD), help=True), 40, 12)
    for words in ("elbow", "arm out, in", "nudge", "home", "pause", "back"):
        assert words in text


def test_a_terminal_without_pictures_gets_the_same_in_one_line():
    line = plain_line(view_of(stats_of(HELD), blocked=0.34, late=3))
    assert "\n" not in line and REASON in line
    for words in ("holding", "smallest 12.3 cm", "p50 50 µs", "34 %", "late frames 3"):
        assert words in line


def test_before_the_first_frame_there_is_a_picture_too():
    text = shown(view_of(Stats(100.0), paused=True))
    assert "paused" in text and "p50 -, p99 -" in text


def test_the_last_hold_stays_on_the_screen_after_it():
    stats = stats_of([*HELD, *["following"] * 100])
    assert stats.held is None and stats.last_hold == (1.0, 0.5)
    assert "held 0.5 s, 1 s ago: goal 0" in shown(view_of(stats))
    assert "no hold so far" in shown(view_of(stats_of(["following"])))


def test_a_new_path_of_one_frame_is_seen_for_half_a_second():
    stats = stats_of(["following", "replanned", *["following"] * 30])
    assert "● replanned" in shown(view_of(stats)) and stats.new_paths == 1
    stats = stats_of(["following", "replanned", *["following"] * 60])
    assert "● following" in shown(view_of(stats))


def test_trips_are_counted_and_the_path_to_a_new_place_is_no_new_one():
    stats = Stats(100.0)
    for index in range(40):
        place = index // 10 % 2
        status = "following" if index % 10 else "replanned"
        stats.take(frame(index, status, place))
    assert stats.trips == 3 and stats.new_paths == 0


def test_a_changed_reason_of_a_long_hold_is_shown():
    stats = stats_of(["holding", "holding"])
    stats.take(frame(2, "holding", reason="start in contact"))
    assert stats.hold_reason == REASON
    stats.explain()
    assert stats.hold_reason == "start in contact"


def test_the_smallest_separation_stays():
    stats = Stats(100.0)
    for index, separation in enumerate((0.5, 0.031, math.inf)):
        stats.take(frame(index, separation=separation))
    assert view_of(stats).separation == "-, smallest 3.1 cm"


@given(st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=200))
def test_percentiles_are_right_to_two_percent(times):
    histogram = Histogram()
    for seconds in times:
        histogram.add(seconds)
    for share in (0.5, 0.99, 1.0):
        exact = sorted(times)[math.ceil(share * len(times)) - 1]
        assert histogram.percentile(share) == pytest.approx(exact, rel=0.021)


class Clock:
    """Time that passes only by sleeping and working."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


def paced(works, period=0.01):
    clock = Clock()
    pacer = Pacer(period, clock, clock.sleep)
    begins = []
    for seconds in works:
        begins.append(clock.now)
        clock.now += seconds
        pacer.wait()
    return np.diff([*begins, clock.now]), pacer


def test_turns_begin_a_period_apart():
    gaps, pacer = paced([0.001, 0.009, 0.0, 0.004])
    np.testing.assert_allclose(gaps, 0.01)
    assert pacer.late == 0 and pacer.slipped_s == 0.0


def test_a_late_turn_slips_and_is_counted_and_no_burst_follows():
    gaps, pacer = paced([0.001, 0.035, 0.001, 0.001, 0.015, 0.0])
    np.testing.assert_allclose(gaps, [0.01, 0.035, 0.01, 0.01, 0.015, 0.01])
    assert pacer.late == 2 and pacer.slipped_s == pytest.approx(0.03)


def test_a_pause_is_no_delay():
    clock = Clock()
    pacer = Pacer(0.01, clock, clock.sleep)
    clock.now += 60.0
    pacer.restart()
    pacer.wait()
    assert pacer.late == 0 and clock.now == pytest.approx(160.01)


def test_at_a_low_rate_a_wish_to_stop_is_soon_heeded():
    clock = Clock()
    pacer = Pacer(10.0, clock, clock.sleep)
    pacer.wait(lambda: clock.now > 101.0)
    assert clock.now < 101.2
