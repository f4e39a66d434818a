"""The receiver of a plan as capsules: all of it is inside, nothing is faster."""

import numpy as np
import pytest
from planned import plan_by_hand

import handover
from handover.plans.limb import agent_model
from handover.scenes.agent_body import agent_body
from roadmap.errors import BadInput
from sim.people.receiver import PlannedReceiver, capsules_of, elsewhere


@pytest.fixture(scope="module")
def record():
    return plan_by_hand()


def outside(points, row):
    """Return how far points are outside a capsule [m]."""
    a, d = row[:3], row[3:6] - row[:3]
    t = np.clip((points - a) @ d / max(d @ d, 1e-12), 0.0, 1.0)
    return np.linalg.norm(points - a - t[:, None] * d, axis=1) - row[6]


@pytest.mark.parametrize("source", ["person", "drchubo", "crichton"])
def test_every_part_lies_in_its_capsule(source):
    model = agent_model(str(agent_body(handover.load_agent(source).source).file))
    a, b, radius = capsules_of(model)
    hulls = 0
    for k, part in enumerate(model.parts):
        row = np.r_[a[k], b[k], radius[k] - part.radius]
        assert outside(part.points, row).max() < 1e-9
        hulls += len(part.points) > 2
    assert hulls > 1


def test_it_stands_until_it_reaches_and_waits_when_it_is_there(record):
    person = PlannedReceiver(record, early_s=2.0)
    assert person.reach_s == (3.0, 4.0)  # planned 5 s after the carry begins
    at = [person.capsules(t) for t in (0.0, 3.0, 3.5, 4.0, 9.0)]
    assert np.array_equal(at[0], at[1]) and np.array_equal(at[3], at[4])
    assert np.abs(at[2] - at[0]).max() > 0.1 < np.abs(at[3] - at[2]).max()
    assert person.notes == ("the receiver reaches 2 s sooner than planned",)


def test_its_links_are_where_the_plan_has_them(record):
    """By the kinematics of scenes: each solid's middle is in a capsule of its link."""
    receiver, name = record["receiver"], "right_shoulder_flexion"
    body, T = agent_body(receiver["urdf"]), np.array(receiver["T_world_base"])
    links = np.array([part.link for part in agent_model(receiver["urdf"]).parts])
    person = PlannedReceiver(record)
    begin = receiver["joints"][name]
    for t, value in ((0.0, begin), (5.5, 0.5 * (begin + 1.57)), (8.0, 1.57)):
        rows, solids = person.capsules(t), body.shapes(
            receiver["joints"] | {name: value}, T
        )  # fmt: skip
        assert len(solids) > 50
        for link, solid in solids:
            middle = solid.T_base_shape[None, :3, 3]
            assert min(outside(middle, row)[0] for row in rows[links == link]) < 1e-6


def test_no_point_is_faster_than_it_says(record):
    person = PlannedReceiver(record, early_s=5.0)
    times = np.linspace(0.0, 1.2, 777)
    rows = np.array([person.capsules(t)[:, :6] for t in times])
    far = np.linalg.norm(np.diff(rows.reshape(777, -1, 3), axis=0), axis=2)
    speed = far.max() / (times[1] - times[0])
    assert 0.9 * person.max_speed < speed <= person.max_speed


def test_elsewhere_is_near_level_and_drawn_by_the_seed(record):
    T, drawn = np.array(record["receiver"]["T_world_base"]), []
    for seed in range(8):
        there = elsewhere(T, 0.1, seed)
        assert np.array_equal(there, elsewhere(T, 0.1, seed))
        assert np.abs(there[:2, 3] - T[:2, 3]).max() <= 0.1 and there[2, 3] == T[2, 3]
        turn = there[:3, :3] @ T[:3, :3].T
        assert abs(turn[2, 2] - 1.0) < 1e-12
        assert abs(np.arctan2(turn[1, 0], turn[0, 0])) <= np.radians(10.0)
        drawn.append(there[0, 3])
    assert len(set(drawn)) == 8
    assert np.array_equal(elsewhere(T, 0.0, 3), T)
    moved = PlannedReceiver(record, aside=0.1, seed=1)
    assert "stands" in moved.notes[0] and "cm from where" in moved.notes[0]


def test_a_plan_whose_receiver_does_not_reach_is_refused(record):
    motions = [m for m in record["motions"] if m["name"] != "approach"]
    with pytest.raises(BadInput, match="receiver has no motion 'approach', only none"):
        PlannedReceiver(record | {"motions": motions})
