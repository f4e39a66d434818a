"""Words and strips: what is told, and that nobody's name becomes a script."""

import numpy as np
import pytest

from sim.view import cards, theme
from sim.view.moment import (
    CONTACT,
    HOLDING,
    NEW_PATH,
    ON_THE_WAY,
    WORDS,
    Event,
    Moment,
    state_of,
)

Q = np.zeros(2)


@pytest.mark.parametrize(
    "status, pace, gap, word",
    [
        ("following", "moving", 0.2, "on its way"),
        ("replanned", "slowed", 0.2, "slowed for the person"),
        ("following", "braked", 0.2, "braked for the person"),
        ("holding", "standing", 0.2, "holding"),
        ("holding", "retreating", 0.2, "backing off"),
        ("holding", "retreating", 0.0, "contact"),
        ("", "", np.inf, "on its way"),
    ],
)
def test_every_state_has_its_words(status, pace, gap, word):
    assert WORDS[state_of(status, pace, gap)] == word


def test_a_card_tells_state_reason_separation_and_time():
    moment = Moment(1.25, Q, state=HOLDING, reason="jib near.", separation=0.123)
    card = cards.status_card(moment, [], 9.0)
    for told in ("Holding", "jib near", "12.3 cm", "1.25 / 9.00 s"):
        assert told in card
    assert theme.STATE_COLOURS[HOLDING] in card


def test_a_map_alone_tells_its_size_and_no_states_of_a_run():
    told = cards.roadmap_line(1200, 4000, 500)
    assert "1,200 nodes, 4,000 edges" in told and "<b>500</b> (12%)" in told
    assert "blocks" not in cards.roadmap_line(1200, 4000, None)
    alone, run = (cards.legend(True, False, runs) for runs in (False, True))
    for word in (WORDS[HOLDING], "path of the tool", "the goal"):
        assert word in run and word not in alone
    assert "edge that is blocked" in alone
    recorded = cards.legend(True, False, lacks=frozenset({"before"}))
    assert (
        "before it" in run
        and "before it" not in recorded
        and "path of the tool" in recorded
    )


def test_a_new_path_is_told_for_a_while():
    event = [Event(1.0, NEW_PATH, "new path")]
    assert "New path" in cards.status_card(Moment(1.1, Q, state=ON_THE_WAY), event, 9)
    late = cards.status_card(Moment(1.9, Q, state=ON_THE_WAY), event, 9)
    assert "On its way" in late


def test_names_out_of_files_are_text():
    evil = "<script>alert(1)</script>"
    moment = Moment(1.0, Q, state=HOLDING, reason=evil)
    events = [Event(0.5, HOLDING, f"holding: {evil}\" onclick='x'")]
    shown = [
        cards.status_card(moment, events, 2.0),
        cards.time_line(np.zeros((1, 5)), events, (0.0, 2.0), 1.0),
        cards.note([evil]),
    ]
    for html in shown:
        assert "<script" not in html and "\" onclick='" not in html
        assert "&lt;script&gt;" in html


def rows(times, gap=0.2, took=1e-3, state=ON_THE_WAY):
    table = np.zeros((len(times), 5))
    table[:, 0], table[:, 1], table[:, 2], table[:, 3] = times, gap, took, state
    return table


def test_the_gravest_state_of_a_column_is_seen():
    table = rows(np.arange(100_000) / 100)
    table[50_000, 3] = CONTACT  # 10 ms of 17 minutes
    line = cards.time_line(table, [], (0.0, 1000.0), 0.0)
    assert theme.STATE_COLOURS[CONTACT] in line


def test_strips_tell_percentiles_and_the_nearest_of_the_last_seconds():
    table = rows(np.arange(2000) / 100)
    table[-1, 2] = 7e-3
    table[-5, 1] = 0.034
    table[0, 1] = 0.001  # 20 s ago
    shown = cards.strips(table, 19.99)
    assert "3.4 cm at the least" in shown
    assert "p50 1.00" in shown and "most 7.00 ms" in shown
    assert "Latency" not in cards.strips(table, 19.99, latency=False)
    assert "nobody" in cards.strips(rows([0.0], np.inf), 0.0)
    assert "last 10 s, 0 to 30 cm, dashed: 10 cm" in shown  # of both axes
    assert 'aria-label="Separation, last 10 s: 3.4 cm at the least"' in shown
    inside = cards.strips(rows([0.0], -0.05), 0.0)  # as the card above it tells it
    assert "0.0 cm at the least" in inside and "-5" not in inside
    table[-1, 2] = 0.4474  # more digits would break the line
    assert "most 447 ms" in cards.strips(table, 19.99)


def test_quality_colours_rise_in_lightness():
    colours = theme.quality_colours(np.linspace(0, 1, 40)).astype(float)
    light = colours @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(light) > 0).all()
    none = theme.quality_colours([np.nan])[0]
    assert tuple(none) == theme.GOAL


# the window to the page [px], and pixels of the screen for one of these
@pytest.mark.parametrize(
    "window, scale",
    [
        *(((1600, 800), 1), ((800, 600), 1), ((390, 844), 1)),
        *(((360, 640), 2), ((430, 932), 2), ((1440, 900), 2), ((1536, 864), 1.25)),
    ],
)
def test_the_camera_sees_robot_and_person_beside_the_panel(window, scale):
    size = tuple(round(scale * pixels) for pixels in window)
    rng = np.random.default_rng(0)
    robot = rng.uniform([-0.2, -0.3, 0], [0.5, 0.3, 0.9], (20, 3))
    person = rng.uniform([0.6, -0.3, 0.2], [1.2, 0.3, 0.8], (10, 3))
    eye, target = theme.eye_on(robot, person, size)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    off = np.vstack([robot, person]) - eye
    depth = off @ forward
    assert (depth > 0).all()
    high = np.abs(off @ up) / depth
    wide = off @ right / depth / np.tan(theme.FOV / 2) * size[1] / 2  # px
    assert high.max() < np.tan(theme.FOV / 2)
    assert wide.min() > -size[0] / 2
    panel = scale * theme.PANEL if window[0] > 576 else 0
    assert wide.max() < size[0] / 2 - panel
    if not panel:  # it is at the foot, six tenths of the window high
        assert (off @ up / depth).min() > 0.2 * np.tan(theme.FOV / 2)
    across = (robot.mean(axis=0) - person.mean(axis=0)) @ right
    assert abs(across) > 0.5  # side by side, not one behind the other
