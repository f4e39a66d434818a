"""The loop: what counts as a contact, a hold, a trip; limits; the same bytes twice."""

import json
import time
from types import SimpleNamespace

import numpy as np
import pytest

from roadmap.errors import BadInput
from sim.loop.loop import LoopSettings, run_loop
from sim.loop.run_result import STATUS, kind_of

SHORT = LoopSettings(duration_s=4.0, speed_scale=1.0)


def test_a_planner_that_drives_into_the_arm_is_counted_as_a_contact(
    straight, crane, places, statue
):
    result = run_loop(straight, crane, places, statue, SHORT)
    assert result.contacts >= 1
    assert result.separation.min() <= 0.0
    moment = result.summary()["closest_while_moving"]
    assert moment["separation_m"] <= 0.0 and moment["joint_speed"] > 0.01


def test_an_arm_that_walks_into_a_robot_at_rest_is_no_contact_of_the_robot(
    crane, statue
):
    there = np.array([[0.0, 0.0], [0.0, 0.5]])
    still = run_loop(_Still(), crane, there, statue, SHORT)
    assert still.separation.max() <= 0.0
    assert still.contacts == 0 and still.trips == 0


class _Still:
    def set_goals(self, goals, costs=None):
        pass

    def separation(self, q):
        return 0.0

    def step(self, points, q, dq=None, stamp=None, now=None, **told):
        return SimpleNamespace(
            status="holding", path=np.zeros((0, 2)), reason="asleep", latency_s={}
        )


def test_one_long_touch_is_one_contact_and_two_touches_are_two(
    straight, crane, places, statue
):
    longer = LoopSettings(duration_s=8.0, speed_scale=1.0)
    result = run_loop(straight, crane, places, statue, longer)
    touching = result.separation <= 0.0
    starts = np.sum(np.diff(touching.astype(int)) == 1)
    assert starts == result.contacts >= 2


def test_a_planner_that_holds_stops_the_robot(careful, crane, places, passing_by):
    result = run_loop(careful, crane, places, passing_by, SHORT)
    held = result.status == STATUS.index("holding")
    assert held.any() and not held.all()
    resting = result.joint_speed[1:][held[:-1]]
    np.testing.assert_array_equal(resting, 0.0)
    assert result.contacts == 0


def test_holds_are_listed_with_their_reason_and_add_up(
    careful, crane, places, passing_by
):
    result = run_loop(careful, crane, places, passing_by, SHORT)
    held = result.summary()["held_s"]
    assert held == pytest.approx(sum(h.end_s - h.start_s for h in result.holds))
    assert all("jib within" in hold.reason for hold in result.holds)
    ((reason, times, seconds),) = result.hold_reasons()
    assert reason == result.holds[0].reason
    assert times == len(result.holds) and seconds == pytest.approx(held)


def test_the_robot_backs_off_slowly_where_the_planner_offers_it(
    retreating, crane, places, statue
):
    start = np.array([[0.5, 0.0], [-0.9, 0.3]])
    result = run_loop(retreating, crane, start, statue, SHORT)
    held = result.status == STATUS.index("holding")
    backing = result.joint_speed[1:][held[:-1]]
    limit = SHORT.retreat_scale * crane.max_velocity.max()
    assert 0.0 < backing.max() <= limit * (1 + 1e-9)
    assert any(hold.retreating for hold in result.holds)


def test_a_robot_about_to_be_touched_stands_still_even_if_it_could_back_off(
    retreating, crane, statue
):
    start = np.array([[0.3, 0.0], [-0.9, 0.3]])
    settings = LoopSettings(duration_s=1.0, min_retreat_separation=0.15)
    result = run_loop(retreating, crane, start, statue, settings)
    held = result.status == STATUS.index("holding")
    assert held.any() and not any(hold.retreating for hold in result.holds)
    np.testing.assert_array_equal(result.joint_speed[1:][held[:-1]], 0.0)


def test_joint_speed_limits_are_respected_in_every_frame(
    careful, crane, places, passing_by
):
    settings = LoopSettings(duration_s=6.0, speed_scale=0.8)
    result = run_loop(careful, crane, places, passing_by, settings)
    speed = np.abs(np.diff(result.q, axis=0)) * settings.rate_hz
    assert (speed <= 0.8 * crane.max_velocity * (1 + 1e-9)).all()
    assert speed.max() > 0.79 * crane.max_velocity.min()


def test_arriving_is_a_trip_and_the_places_swap(straight, crane, places):
    result = run_loop(straight, crane, places, None, SHORT)
    assert result.trips == 2
    for frame in np.flatnonzero(np.diff(result.place)):
        reached = result.place[frame]
        np.testing.assert_array_equal(result.q[frame + 1], places[reached])


def test_without_a_person_nothing_is_near(straight, crane, places):
    result = run_loop(straight, crane, places, None, SHORT)
    assert result.motion == "none" and np.isinf(result.separation).all()
    assert result.summary()["closest"] is None and result.contacts == 0


def test_the_same_input_gives_the_same_bytes_but_for_the_clock(
    careful, crane, places, passing_by
):
    runs = []
    for _ in range(2):
        careful.held = False
        runs.append(run_loop(careful, crane, places, passing_by, SHORT))
    one, two = (run.to_json(timing=False) for run in runs)
    assert one == two
    assert "timing" in json.loads(runs[0].to_json())


def test_a_late_step_is_listed_as_missed_by_wall_and_not_by_cpu(
    straight, crane, places
):
    step, calls = straight.step, []

    def sleepy(*args, **kwargs):
        calls.append(1)
        if len(calls) == 7:
            time.sleep(0.02)
        return step(*args, **kwargs)

    straight.step = sleepy
    result = run_loop(straight, crane, places, None, LoopSettings(duration_s=0.2))
    assert 6 in result.misses("wall")
    assert 6 not in result.misses("cpu")
    assert 6 in [late["frame"] for late in result.timing()["missed_by_wall"]]


def test_paths_are_kept_for_pictures_on_demand(straight, crane, places, statue):
    settings = LoopSettings(duration_s=0.5, keep_paths=10)
    result = run_loop(straight, crane, places, statue, settings)
    assert sorted(result.paths) == [0, 10, 20, 30, 40]
    assert not run_loop(straight, crane, places, statue, SHORT).paths


def test_new_paths_on_the_way_are_path_changes(careful, crane, places, passing_by):
    result = run_loop(careful, crane, places, passing_by, SHORT)
    assert result.path_changes == np.sum(result.status == STATUS.index("replanned"))
    assert result.path_changes >= 1


def test_every_frame_is_shown_to_a_listener(straight, crane, places, statue):
    seen = []
    settings = LoopSettings(duration_s=0.3)
    run_loop(straight, crane, places, statue, settings, on_frame=seen.append)
    assert [frame.index for frame in seen] == list(range(30))


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"rate_hz": 0}, "rate_hz is 0"),
        ({"duration_s": float("nan")}, "duration_s is nan"),
        ({"speed_scale": 1.5}, "speed_scale is 1.5"),
    ],
)
def test_settings_that_make_no_loop_are_refused(values, words):
    with pytest.raises(BadInput, match=words):
        LoopSettings(**values)


def test_a_single_work_place_is_refused(straight, crane):
    with pytest.raises(BadInput, match="at least two"):
        run_loop(straight, crane, np.zeros((1, 2)), None, SHORT)


def test_reasons_of_a_kind_group_wherever_in_the_cover_it_is():
    start = "the start is in contact: "
    inside = "sphere 90 (elbow of the other robot) is 8.4 cm inside the cover of arm_2"
    outside = "sphere 7 (tool of the other robot) is 0.4 cm from the cover of arm_2"
    told = [
        kind_of(f"{start}{inside}, not 1.0 cm outside; move it 9.4 cm away"),
        kind_of(f"{start}{outside}, closer than 1.0 cm; move it 0.6 cm away"),
    ]
    assert told[0] == told[1] and "closer than # cm" in told[0]
    person = f"{start}capsule 1 (torso) is 0.4 cm from the cover of hand, closer"
    assert kind_of(person) != kind_of(person.replace("torso", "left hand"))
