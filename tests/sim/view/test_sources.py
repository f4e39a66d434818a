"""Moments of a recording, and of a live run's letters."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from sim.loop.run_result import STATUS
from sim.record import read_record
from sim.view.mailbox import Mailbox
from sim.view.moment import HOLDING, NEW_PATH, SLOW, STILL, Event, Happenings, Moment
from sim.view.robot_shapes import solid_parts
from sim.view.sources import Letters, Recorded


@pytest.fixture(scope="module")
def found(view_file):
    return Recorded(read_record(view_file))


def test_a_recording_shows_every_frame_as_it_was(found):
    record = found.record
    assert found.span() == (0.0, pytest.approx(2.49))
    for i in (0, 1, 57, 249):
        moment = found.at(i / 100)
        np.testing.assert_array_equal(moment.q, record.arrays["q"][i])
        np.testing.assert_array_equal(moment.capsules, record.arrays["capsules"][i])
        assert moment.separation == record.arrays["separation"][i]
    assert found.at(-1.0).time_s == 0.0 and found.at(1e9).time_s == 2.49


def test_the_floor_is_where_the_lowest_stands_in_the_whole_run(found):
    record = found.record
    parts = solid_parts(found.robot)
    assert found.lowest(parts) == pytest.approx(-0.05)  # the crane's own foot
    rows = np.array(record.arrays["capsules"])
    rows[100, 0] = [0.5, 0.0, -0.7, 0.5, 0.0, 0.0, 0.05]
    rows[120, 1] = [0.5, 0.0, -0.6, 0.5, 0.0, 0.0, 0.6]  # not seen for long
    rows[140, 1] = [0.0, 0.0, -5.0, 0.0, 0.0, -5.0, 0.001]  # gone
    low = Recorded(replace(record, arrays=record.arrays | {"capsules": rows}))
    assert low.lowest(parts) == pytest.approx(-0.75)


def test_its_path_is_where_the_robot_went_until_the_next_goal(found):
    place = found.record.arrays["place"]
    moment = found.at(0.0)
    end = int(np.flatnonzero(place == place[0])[-1])
    np.testing.assert_array_equal(moment.path[0], moment.q)
    np.testing.assert_array_equal(moment.path[-1], found.record.arrays["q"][end])


def test_a_hold_is_told_with_its_reason(found):
    hold = found.record.holds[0]
    middle = found.at(0.5 * (hold["start_s"] + hold["end_s"]))
    assert hold["reason"] == middle.reason
    events = [e for e in found.events if abs(e.time_s - hold["start_s"]) < 0.02]
    assert any(hold["reason"] in e.text for e in events)


def test_a_hold_that_begins_in_contact_is_told_with_its_reason(found):
    record, hold = found.record, found.record.holds[0]
    begin, end = (round(100 * hold[k]) for k in ("start_s", "end_s"))
    middle = (begin + end) // 2
    gaps = np.array(record.arrays["separation"])
    gaps[begin - 1 : middle] = -0.01
    arrays = record.arrays | {"separation": gaps}
    events = Recorded(replace(record, arrays=arrays)).events
    (told,) = [e for e in events if abs(e.time_s - middle / 100) < 0.005]
    assert told.text.endswith(f": {hold['reason']}")


def moment(time_s, rows, events=()):
    table = np.zeros((len(rows), 5))
    table[:, 0] = rows
    return Moment(time_s, np.zeros(2), rows=table, events=events)


@pytest.fixture
def box():
    made = Mailbox()
    yield made
    made.close()


def test_letters_that_were_missed_leave_no_gap_in_rows_and_events(box):
    # one process stands for two: the box that is read has its own count
    import os

    reader = Mailbox(os.dup(box.descriptor))
    letters = Letters(reader)
    assert letters.at(0.0) is None and not letters.poll()
    new, hold = Event(0.02, NEW_PATH, "new path"), Event(0.03, HOLDING, "holding")
    box.put(pickle.dumps(moment(0.01, [0.0, 0.01])))
    assert letters.poll()
    box.put(pickle.dumps(moment(0.02, [0.0, 0.01, 0.02], (new,))))  # never seen
    box.put(pickle.dumps(moment(0.03, [0.01, 0.02, 0.03], (new, hold))))
    assert letters.poll() and not letters.poll()
    np.testing.assert_array_equal(letters.rows()[:, 0], [0.0, 0.01, 0.02, 0.03])
    assert letters.events == [new, hold]
    assert letters.at(0.025).time_s == 0.01 and letters.at(9.0).time_s == 0.03
    box.put(pickle.dumps(moment(0.0, [0.0])))  # the next run
    letters.poll()
    assert letters.span() == (0.0, 0.0) and letters.events == []
    reader.close()


def test_happenings_tell_goals_new_paths_and_states_once():
    seen = Happenings()
    seen.take(0.0, 1, 0)
    seen.take(0.1, 1, 0, new_path=True)
    seen.take(0.2, HOLDING, 0, "a hand")
    seen.take(0.3, HOLDING, 0, "a hand")
    seen.take(0.4, 1, 1, new_path=True)  # to a new goal, as it has to
    assert [(e.time_s, e.state) for e in seen.events] == [
        (0.1, NEW_PATH),
        (0.2, HOLDING),
        (0.4, STILL),
    ]
    assert seen.events[1].text == "holding: a hand"


def test_who_is_slowed_again_and_again_in_a_moment_is_slowed_once():
    seen = Happenings()
    for k in range(40):  # each third frame
        seen.take(0.01 * k, SLOW if k % 3 == 0 else 1, 0, "a stop takes 0.2 s")
    assert [(e.time_s, e.state) for e in seen.events] == [(0.0, SLOW)]
    seen.take(0.4, HOLDING, 0)
    seen.take(0.41, SLOW, 0)  # after something else
    seen.take(1.0, 1, 0)
    seen.take(1.1, SLOW, 0)  # and after a while
    assert [e.time_s for e in seen.events] == [0.0, 0.4, 0.41, 1.1]


def test_a_story_tells_its_events_and_stands_where_it_waits(view_file):
    record = read_record(view_file)
    n, k = record.arrays["capsules"].shape[:2]
    head = record.head | {
        "story": {"states": ["fetch", "wait"]},
        "outcome": record.head["outcome"]
        | {
            "story": [{"time_s": 0.5, "state": "wait", "reason": "the hand is there"}],
            "holds": [
                {"start_s": 0.5, "end_s": 1.0, "reason": "wait: the hand is there"},
                {"start_s": 1.5, "end_s": 2.0, "reason": "wait: goal 0 is blocked"},
            ],
        },
    }
    status = np.full(n, STATUS.index("following"), np.uint8)
    status[50:100] = status[150:200] = STATUS.index("holding")
    rows = np.zeros((n, 17, 7))
    rows[..., 6] = 0.05
    arrays = record.arrays | {
        "status": status,
        "pace": np.full_like(record.arrays["pace"], head["pace_names"].index("moving")),
        "separation": np.full(n, 0.3),
        "capsules": rows,
        "story.state": (np.arange(n) >= 50).astype(np.uint8),
    }
    source = Recorded(replace(record, head=head, arrays=arrays))
    states = source.rows()[:, 3]
    assert (states[50:100] == STILL).all() and (states[150:200] == HOLDING).all()
    assert any(e.text == "wait: the hand is there" for e in source.events)
    assert source.at(0.1).things == 2  # of 17 capsules 15 are the person's
    assert len(source.at(0.4).path) < 20  # to the end of the state, not of the run
