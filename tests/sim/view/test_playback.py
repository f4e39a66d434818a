"""Play, pause, scrub, follow: where the page is, without any network."""

import math

import pytest

from roadmap.errors import BadInput
from sim.view.playback import Playback


def test_a_recording_begins_at_its_beginning_and_stands():
    playback = Playback(0.0, 10.0)
    playback.advance(1.0)
    assert playback.at == 0.0 and not playback.playing


def test_playing_goes_on_with_the_clock_and_stops_at_the_end():
    playback = Playback(0.0, 10.0)
    playback.play()
    playback.advance(1.5)
    assert playback.at == pytest.approx(1.5)
    playback.set_speed(4.0)
    playback.advance(1.0)
    assert playback.at == pytest.approx(5.5)
    playback.advance(100.0)
    assert playback.at == 10.0 and not playback.playing
    playback.play()
    assert playback.at == 0.0 and playback.playing


@pytest.mark.parametrize(
    "asked, there", [(3.0, 3.0), (-1.0, 0.0), (99.0, 10.0), (math.inf, 10.0)]
)
def test_scrubbing_goes_to_the_nearest_moment(asked, there):
    playback = Playback(0.0, 10.0)
    playback.seek(asked)
    assert playback.at == there


def test_scrubbing_to_no_number_changes_nothing():
    playback = Playback(0.0, 10.0)
    playback.seek(4.0)
    playback.seek(math.nan)
    assert playback.at == 4.0


def test_a_live_run_is_followed_until_somebody_scrubs():
    playback = Playback(0.0, 0.0, live=True)
    playback.span(0.0, 5.0)
    assert playback.at == 5.0
    playback.seek(2.0)
    playback.span(0.0, 6.0)
    assert playback.at == 2.0
    playback.advance(0.5)
    assert playback.at == 2.5  # it plays on, behind the run
    playback.advance(60.0)
    playback.span(0.0, 9.0)
    assert playback.at == 9.0  # it has caught up


def test_a_live_run_goes_on_while_the_page_pauses():
    playback = Playback(0.0, 1.0, live=True)
    playback.pause()
    playback.span(0.0, 5.0)
    playback.advance(1.0)
    assert playback.at == 1.0
    playback.follow()
    assert playback.at == 5.0 and playback.following


def test_what_is_no_longer_kept_is_left():
    playback = Playback(0.0, 10.0, live=True)
    playback.pause()
    playback.seek(1.0)
    playback.span(4.0, 12.0)
    assert playback.at == 4.0


def test_jumps_go_from_event_to_event():
    playback = Playback(0.0, 10.0)
    playback.play()
    for there in (2.0, 5.0, 10.0, 10.0):
        playback.jump([2.0, 5.0], 1)
        assert playback.at == there and not playback.playing
    for there in (5.0, 2.0, 0.0):
        playback.jump([2.0, 5.0], -1)
        assert playback.at == there


@pytest.mark.parametrize("speed", [0.0, -1.0, 3.0, math.nan, math.inf])
def test_a_speed_that_is_no_choice_is_refused(speed):
    with pytest.raises(BadInput, match="choose one of 0.25"):
        Playback(0.0, 1.0).set_speed(speed)
