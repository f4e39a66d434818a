"""The scripted person: reaches, keeps off the robot, pulls, draws back."""

from types import SimpleNamespace

import numpy as np
import pytest
from rows import each

from handover import Human, wrench
from handover.human.body import LEG_LABELS
from roadmap.errors import BadInput
from roadmap.geometry.gaps import ball_gaps, least_gap, moved_rods
from roadmap.transforms import pose_of
from sim.people.partner import Partner, PartnerTraits, RecordedPartner
from sim.story import tell
from sim.story.cases import StorySetup
from sim.story.play import StoryResult
from sim.story.request import DemoRequest
from sim.story.tell import summary_of

OBJ = wrench()


def partner(**traits):
    body = Human().placed(0.8, 0.0, np.pi)
    return Partner(body, "right", OBJ, PartnerTraits(**traits))


def held_out(person):
    """Return a pose of the object at which the person can take it."""
    grip = person.body.with_arm("right", np.radians([60, 20, 0, 60, 0, 0, 0]))
    return grip.T_world_hand("right") @ np.linalg.inv(OBJ.hand_grasps[0])


def play(person, T, seconds, offered=True, fingers="closed", held=True):
    return [
        person.step(0.01 * k, T, offered, fingers, held).T_world_hand("right")[:3, 3]
        for k in range(int(100 * seconds))
    ]


def test_the_hand_gets_to_what_is_held_out_no_faster_than_it_may():
    person = partner(hand_speed=0.7, tremble=0.0)
    places = np.array(play(person, held_out(person), 6.0))
    assert person.holds and person.pull > 5.0
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1).max() / 0.01
    assert 0.3 < speed < 1.05 * 0.7
    off = person.T_world_object[:3, 3] - held_out(person)[:3, 3]
    assert np.linalg.norm(off) < 0.01


def test_nobody_reaches_for_what_is_not_held_out_and_some_withdraw_once():
    person = partner(tremble=0.0)
    places = play(person, held_out(person), 2.0, offered=False)
    places = np.array(places)
    assert np.abs(places - places[0]).max() < 1e-9 and not person.holds
    shy = partner(withdraws_at=0.5, withdrawn_s=0.5)
    play(shy, held_out(shy), 1.5)
    assert not shy.holds
    play(shy, held_out(shy), 8.0)
    assert shy.traits.withdraws_at == 0.0


@pytest.mark.parametrize("rate", [10, 30, 100])
def test_who_walks_off_is_as_quick_at_every_rate_of_the_frames(rate):
    person, T, places = partner(leaves_s=0.2), np.eye(4), {}
    for k in range(2 * rate + 1):
        human = person.step(k / rate, T, False, "closed", True)
        places[k / rate] = human.T_world_pelvis[:3, 3]
    assert np.isclose(np.linalg.norm(places[2.0] - places[1.0]), 0.6)


def test_the_arm_does_not_hang_in_what_it_gave_until_that_is_gone():
    """Nobody lets a hand hang in a wrench: it waits, drawn back."""
    body = Human().placed(0.8, 0.0, np.pi)
    rest = np.array(body.arms["right"])
    traits = PartnerTraits(tremble=0.0, delay_s=0.2)
    person = Partner(body, "right", OBJ, traits, True, rest + np.radians(5.0))
    play(person, np.eye(4), 2.0, held=False)
    T = person.T_world_object

    def gap():
        return least_gap(person._arm_at(person.arm), moved_rods(OBJ.capsules, T))

    held = person.arm.copy()
    assert gap() < -0.02 and person.holds
    for k in range(500):
        person.step(2.0 + 0.01 * k, T, False, "closed", True)
    assert not person.holds and gap() >= 0.03
    drawn = person.arm.copy()
    assert np.abs(drawn - held).max() > 0.3
    for k in range(40):  # the robot takes it away: the hand waits meanwhile
        T = pose_of((-0.01, 0.0, 0.01), (0.0, 0.0, 0.0)) @ T
        person.step(7.0 + 0.01 * k, T, False, "closed", True)
    assert np.array_equal(person.arm, drawn) and gap() > 0.1
    for k in range(300):
        person.step(7.4 + 0.01 * k, T, False, "closed", True)
    assert np.allclose(person.arm, rest)


def test_an_arm_that_would_run_into_the_robot_stays():
    person = partner(tremble=0.0)
    T = held_out(person)
    person.balls = np.array([[*T[:3, 3], 0.5]])  # a robot all around it
    play(person, T, 2.0)
    assert not person.holds


def test_distances_of_capsules_are_those_of_dense_points():
    rng = np.random.default_rng(5)
    for _ in range(20):
        one, other = rng.uniform(-1, 1, (2, 7))
        one[6], other[6] = 0.05, 0.1
        s = np.linspace(0, 1, 300)[:, None]
        a = one[:3] + s * (one[3:6] - one[:3])
        b = other[:3] + s * (other[3:6] - other[:3])
        dense = np.linalg.norm(a[:, None] - b, axis=2).min() - 0.15
        assert dense - 0.01 < least_gap(one[None], other[None]) <= dense + 1e-9
        ball = np.array([[*one[:3], 0.05]])
        gap = np.linalg.norm(one[:3] - b, axis=1).min() - 0.15
        gaps = ball_gaps(ball, np.array([one, other]))
        assert gaps == pytest.approx(np.array([[-0.1, gap]]), abs=0.01)


def test_the_least_distance_of_some_capsules_is_that_of_the_nearest_two():
    rows = np.random.default_rng(6).uniform(0.1, 1, (7, 7))
    rods, others = rows[:3], rows[3:]
    pairs = [least_gap(a[None], b[None]) for a in rods for b in others]
    assert least_gap(rods, others) == min(pairs) < max(pairs)
    assert least_gap(rods, others[:0]) == np.inf
    rods[1, 4] = np.nan
    assert np.isnan(least_gap(rods, others))


def test_still_capsules_of_no_length_have_a_distance():
    ball = pose_of((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))[:3, 3]
    one = np.array([*ball, *ball, 0.1])
    other = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.2])
    assert least_gap(one[None], other[None]) == pytest.approx(0.7)


@each(
    ("options", "told"),
    [
        ({"story": "dance"}, "choose work, handover or maintenance"),
        ({"direction": "give"}, "--direction goes with `odm demo handover`"),
        ({"story": "handover", "direction": "up"}, "choose give or receive"),
        ({"story": "handover", "human": "mocap"}, "--file F go together"),
        ({"story": "handover", "human": "puppet"}, "scripted, mocap or keyboard"),
        (
            {"story": "handover", "human": "keyboard", "direction": "receive"},
            "takes, and cannot give",
        ),
        ({"story": "work", "view": True}, "--view goes with `odm demo handover`"),
        ({"story": "handover", "port": 9}, "--port goes with --view"),
        ({"story": "handover", "accept_defects": True}, "--accept-defects goes with"),
        ({"story": "work", "accept_defects": True}, "--accept-defects goes with"),
    ],
)
def test_options_that_do_not_go_together_are_refused(options, told):
    with pytest.raises(BadInput, match=told):
        DemoRequest(**options)


@pytest.mark.parametrize("legs", [False, True])
def test_who_was_recorded_without_legs_has_them_for_the_robot_all_the_same(legs):
    body = Human().placed(0.8, 0.0, np.pi)
    there = ~np.isin(body.labels, LEG_LABELS) | legs

    def capsules(t):
        return body.capsules()[there] + np.r_[np.zeros(6), t]  # unseen, and grown

    recorded = SimpleNamespace(
        human=lambda t: body,
        labels=body.labels[there],
        capsules=capsules,
        guess=lambda t: body.capsules()[there],
    )
    person = RecordedPartner(recorded, "right", OBJ, PartnerTraits())
    person.step(0.02, np.eye(4), False, "closed", False)
    rows, labels = person.tracked(0.02)
    assert sorted(labels) == sorted(body.labels) and len(rows) == len(labels)
    grown = 0.02 * (~np.isin(labels, LEG_LABELS) | legs)
    for part in set(body.labels):
        mine = body.capsules()[body.labels == part]
        mine[:, 6] += grown[labels == part]
        assert np.allclose(rows[labels == part], mine)


@pytest.mark.parametrize("side, near", [("left", 0.08), ("right", 0.08), ("right", 3)])
def test_either_hand_of_who_was_recorded_takes_what_it_comes_near_to(
    monkeypatch, side, near
):
    monkeypatch.setattr(RecordedPartner, "NEAR", near)  # 3 m: both are, one is expected
    body = Human().placed(0.8, 0.0, np.pi)
    body = body.with_arm(side, np.radians([60, 20, 0, 60, 0, 0, 0]))
    person = RecordedPartner(
        SimpleNamespace(human=lambda t: body), "right", OBJ, PartnerTraits()
    )
    T = body.T_world_hand(side)
    person.step(0.0, T, True, "closed", True)
    assert person.holds and person.side == side
    assert np.allclose(person.T_world_object, T)


@pytest.mark.parametrize(
    "sides, side", [(("left",), "left"), (("right", "left"), "right")]
)
def test_who_has_one_arm_only_is_expected_to_take_with_that(monkeypatch, sides, side):
    told = []
    monkeypatch.setattr(tell, "setup_of", lambda *_, **__: StorySetup(*5 * [None]))
    monkeypatch.setattr(tell, "wrist_of", lambda setup: 1 / told.append(setup.side))
    with pytest.raises(TypeError):  # no further
        person = SimpleNamespace(sides=sides)
        tell.tell_story(DemoRequest("handover"), None, None, person=person)
    assert told == [side]


def test_a_summary_tells_of_an_object_that_touched_somebody():
    result = StoryResult(None, True, "done", cpu_s=[0.001], closest=0.1)
    assert "of the object" not in summary_of(result)
    result.object_contacts = 26
    assert "26 of the object with others than the arm that takes" in summary_of(result)


def test_a_summary_tells_that_the_time_was_up_before_the_end():
    result = StoryResult(None, True, "approach", cpu_s=[0.001], closest=0.1)
    assert "it ends in approach, before the story is over" in summary_of(result)
    result.handed_s = 12.34
    assert "handed over after 12.3 s, but it ends in approach" in summary_of(result)
    result.outcome = "handed over"
    assert summary_of(result).startswith("handed over after 12.3 s; 0 contacts")
