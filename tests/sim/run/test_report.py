"""Tables and JSON say what happened."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from odm.execution.stop_test import stop_time
from sim.loop.loop import Loop, LoopSettings, run_frames, run_loop
from sim.loop.run_result import Hold, RunResult, kind_of, percentiles
from sim.run.report import print_report, setting, setting_line
from sim.run.request import RunRequest
from sim.run.runner import notes_of, slow_stop, touched_in
from sim.tables.header import processor

SHORT = LoopSettings(duration_s=3.0, speed_scale=1.0)


def result_of(separation, joint_speed, status=None, holds=()):
    n = len(separation)
    return RunResult(
        motion="sweep",
        seed=0,
        rate_hz=100.0,
        trips=3,
        path_changes=1,
        holds=tuple(holds),
        q=np.zeros((n, 2)),
        capsules=np.zeros((n, 1, 7)),
        separation=separation,
        joint_speed=joint_speed,
        point_speed=np.array(joint_speed) / 2,
        status=np.zeros(n) if status is None else status,
        place=np.zeros(n),
        wall_s=np.full(n, 1e-5),
        cpu_s=np.full(n, 1e-5),
        improve_s=np.zeros(n),
        stages={"search": np.full(n, 4e-6)},
    )


def text_of(*args):
    console = Console(width=140, record=True, file=open("/dev/null", "w"))
    print_report(*args, console=console)
    return console.export_text()


def test_a_touch_counts_once_however_long_and_only_if_the_robot_moved_in_it():
    gaps = [0.1, -0.01, -0.02, 0.1, -0.01, 0.1, 0.0]
    speed = [1.0, 0.0, 0.50, 1.0, 0.00, 1.0, 0.02]
    result = result_of(gaps, speed)
    assert result.contacts == 2
    assert result.summary()["contact_frames"] == 2


def test_a_run_of_one_frame_is_told_as_such():
    text = text_of(result_of([0.1], [0.0]))
    assert "Latency of 1 frame, motion sweep" in text
    assert re.search(r"simulated +0\.01 s", text)


def test_a_run_that_begins_with_the_robot_in_the_person_says_so():
    apart = text_of(result_of([0.1, -0.073], [0.0, 0.0]))
    inside = text_of(result_of([-0.073, 0.1], [0.0, 0.0]))
    assert "inside each other" not in apart
    assert "begin 7.3 cm inside each other, so sweep shows little" in inside


def test_who_came_to_a_standing_robot_is_counted_apart():
    gaps = [0.1, -0.01, -0.02, 0.1, -0.01, 0.1, 0.0]
    result = result_of(gaps, [1.0, 0.0, 0.50, 1.0, 0.00, 1.0, 0.02])
    assert result.contacts == 2 and result.standing_contacts == 1
    assert result.summary()["standing_contacts"] == 1
    assert "the person came to it standing" in text_of(result)


def test_time_slowed_for_the_person_is_told_apart_from_holding():
    result = replace(result_of([0.3] * 4, [1.0] * 4), slowed_s=0.03)
    row = [s for s in text_of(result).splitlines() if "slowed or braked" in s]
    assert row[0].split()[-2:] == ["75", "%"]
    assert result.summary()["slowed_s"] == 0.03
    kinematic = result_of([0.3], [1.0])
    assert "slowed_s" not in kinematic.summary()


def test_tables_fit_a_narrow_terminal_and_no_number_is_broken():
    file = open("/dev/null", "w")
    console = Console(width=80, record=True, file=file)
    print_report(result_of([0.3, 0.1], [1.0, 0.0]), console=console)
    lines = console.export_text().splitlines()
    assert max(map(len, lines)) <= 80
    assert any(line.split()[:2] == ["step,", "CPU"] for line in lines)


def test_creeping_below_the_limit_is_no_motion():
    assert result_of([-0.1, -0.1], [0.009, 0.01]).contacts == 0


def test_the_smallest_separation_is_told_with_the_speed_at_it():
    result = result_of([0.3, 0.1, 0.2], [1.0, 0.0, 0.4])
    assert result.summary()["closest"]["joint_speed"] == 0.0
    moment = result.summary()["closest_while_moving"]
    assert moment["separation_m"] == 0.2 and moment["point_speed_m_s"] == 0.2


def test_reasons_group_without_their_numbers_longest_first():
    holds = [
        Hold(0.0, 0.1, "goal blocked by 3 cells", False),
        Hold(0.2, 0.3, "goal blocked by 12 cells", False),
        Hold(0.4, 1.0, "no connection from here", False),
    ]
    reasons = result_of([1.0], [0.0], holds=holds).hold_reasons()
    assert reasons[0] == ("no connection from here", 1, pytest.approx(0.6))
    assert reasons[1][:2] == ("goal blocked by 3 cells", 2)
    assert kind_of("panda_hand, 17 at 0.3 m") == "# # at # m"


def test_json_has_no_infinity_and_reads_back():
    result = result_of([np.inf, np.inf], [0.0, 1.0])
    data = json.loads(result.to_json())
    assert data["closest"] is None and data["trips"] == 3
    assert data["timing"]["latency_s"]["search"]["p50"] == pytest.approx(4e-6)


def test_the_report_shows_every_figure(straight, crane, places, statue):
    result = run_loop(straight, crane, places, statue, SHORT)
    alone = run_loop(straight, crane, places, None, SHORT)
    text = text_of(result, alone, "0123456789abcdef")
    for words in (
        "contacts while moving",
        "smallest separation",
        "speed at it",
        "of those with nobody",
        "100 %",
        "p50",
        "p99",
        "over 10 ms",
        "step, CPU",
        "map 0123456789ab",
        "statue",
    ):
        assert words in text
    assert "…" not in text


def test_a_report_of_one_run_alone_needs_no_person(straight, crane, places):
    result = run_loop(straight, crane, places, None, SHORT)
    assert "none" in text_of(result)


def test_the_setting_names_processor_and_versions():
    assert processor() and processor() in setting_line()
    assert setting()["numpy"] == np.__version__


def test_percentiles_of_nothing_are_zero():
    assert percentiles(np.array([])) == {"p50": 0.0, "p99": 0.0, "max": 0.0}


def test_a_result_is_frozen():
    result = result_of([0.1], [0.0])
    with pytest.raises(ValueError, match="read-only"):
        result.q[0] = 1.0


def test_a_touch_on_the_way_is_told_with_what_the_person_did_more_than_assumed():
    result = result_of([0.1] * 20, [0.1] * 20)
    assert touched_in(result, False) == []
    still = result_of([0.1] * 19 + [0.0], [0.1] * 19 + [0.0])
    assert touched_in(still, False) == []  # they came to a robot that stood
    touched = result_of([0.1] * 19 + [0.0], [0.1] * 20)
    x = np.zeros((20, 1, 7))
    x[10:, 0, 0] = 0.5 * 15.0 * (0.01 * np.arange(10)) ** 2
    touched = replace(touched, capsules=x, rate_hz=100.0)
    (told,), (quick,) = touched_in(touched, False), touched_in(touched, True)
    assert "in 1 frame:" in told and "up to 15 m/s2; assumed are 4, and 80" in told
    assert "assumed are 4 (ThreatSettings)" in quick and "[robot]" not in quick


def test_a_robot_that_takes_long_to_stop_says_how_far_a_person_comes_meanwhile(crane):
    quick = replace(crane, max_acceleration=np.full(2, 1e3), max_jerk=np.full(2, 1e6))
    ((told,), (less,)) = (slow_stop(robot, 0.5, 0.01) for robot in (crane, quick))
    ms, cm = (float(re.search(rf"([0-9]+) {unit}\b", told)[1]) for unit in ("ms", "cm"))
    assert ms == pytest.approx(1e3 * stop_time(crane, 0.5, 0.01), abs=0.5)
    assert cm >= 100 * 0.5 * 4.0 * (1e-3 * ms) ** 2 - 0.5  # 4 m/s2, and more
    assert "(odm info)" in told and "[robot]" in told
    assert float(re.search(r"([0-9]+) cm", less)[1]) < cm


@pytest.mark.parametrize("slowed_s", [None, 0.004, 0.02])
def test_a_run_in_which_a_robot_slow_to_stop_was_slowed_says_why(
    careful, crane, places, statue, slowed_s
):
    settings = LoopSettings(duration_s=0.05, execution="timed")
    loop = Loop(careful, crane, places, statue, settings)
    result = replace(run_frames(loop), slowed_s=slowed_s)
    notes = notes_of(RunRequest(map_dir=Path("any"), execution="timed"), loop, result)
    told = any("near people it is slow" in note for note in notes)
    assert told == (slowed_s == 0.02)
