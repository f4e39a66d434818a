"""What is in the robot's hand is put down: in its place, in another one, or later."""

from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest

import handover
import odm as package
import sim
from odm.close_test.static import StaticTest
from odm.obstacles.shapes import Box
from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose
from roadmap.transforms import pose_of
from sim.record.people import held_told
from sim.story import cases, grasping, object_places
from sim.story.cases import other_places, setup_of
from sim.story.frame import covering_balls
from sim.story.grasping import Reaches
from sim.story.machine import PUT_DOWN, TABLES, Machine
from sim.story.object_places import Placing, checked_places
from sim.story.play import new_story
from sim.story.record import object_of, story_of
from sim.story.robot_hand import quarter_turns
from sim.story.settings import AT_PLACE, HELD_AT_PLACE

PERIOD = 0.01
PADS = ("flange",)
FAR = pose_of((3.0, 0.0, 0.0), (0.0, 0.0, 0.0))
QUICK = dict(place_s=1.0, again_s=0.3, put_down_s=20.0, blocked_s=0.3)


@pytest.fixture(scope="module")
def setup(meet_maps):
    maps = package.load_map(meet_maps[0]), handover.load_reach_map(meet_maps[1])
    return setup_of(*maps, pads=PADS)


def story_at(setup, **settings):
    """Return a story that is about to put down what it has in its hand."""
    human = handover.Human().placed(3.0, 0.0, np.pi)
    settings = sim.StorySettings(direction="receive", **{**QUICK, **settings})
    story = new_story(setup, settings, human)
    story.hand.holding, story.hand.fingers = True, "closed"
    story.planner.attach(story.hand.carried, story.hand.T_tool_object)
    story.machine = Machine(TABLES["receive"], PUT_DOWN)
    story._enter()
    return story, human


def put_down(story, human, seconds, there):
    """Play it; `there(now)`: (k, 7) what the person's capsules are. Return the place.

    The place is (3,) where the fingers opened, None where they did not.
    """
    at, opened, since = None, False, 0.0
    for k in range(int(seconds / PERIOD)):
        now = PERIOD * k
        rows = there(now)
        labels = np.zeros(len(rows), int)
        told = dict(opened=opened, holds=not opened, capsules=rows, labels=labels)
        story.update(sim.StoryFrame(now, human, None, **told))
        if story.fingers == "open" and at is None:
            T = tool_pose(story.planner.robot, story.executor.set_point.q)
            at, since = (T @ story.hand.T_tool_object)[:3, 3], now
        opened = at is not None and now > since + 0.15
        if story.ended:
            break
    return at


def rod_at(T, radius=0.05):
    """Return a capsule (1, 7) that stands in a place."""
    x, y = T[:2, 3]
    return np.array([[x, y, 0.0, x, y, 0.5, radius]])


def beside_what_it_put_down(setup, **conduct):
    """Return a story that has let go of the object in its place, and its person."""
    human = handover.Human().placed(3.0, 0.0, np.pi)
    settings = sim.StorySettings(direction="receive", **QUICK)
    story = new_story(setup, settings, human)
    story.sight.conduct = replace(story.conduct, **conduct)
    story.planner.attach(story.hand.carried, story.hand.T_tool_object)
    story.machine = Machine(TABLES["receive"], PUT_DOWN)
    story._let_go()
    return story, human


def threats_of_object(story, human, T, capsules, frames=8, at=0.0):
    """Return what is told of the object alone, in each of some frames."""
    told, labels = [], np.zeros(len(capsules(0.0)), int)
    for k in range(frames):
        now = at + PERIOD * k
        frame = sim.StoryFrame(
            now, human, T_base_object=T(now), capsules=capsules(now), labels=labels
        )
        seen = story._look(frame)
        told.append(seen.threat.of(slice(seen.people, None)))
    return told


def grows(threat, time=0.3):
    return threat.between(0.0, time)[0].capsules[:, 6].max() - threat.capsules[0, 6]


def at_hand(story):
    q = story.executor.set_point.q
    return tool_pose(story.planner.robot, q) @ story.hand.T_tool_object


def test_what_was_put_down_does_not_start_off_where_nobody_can_get_to_it(setup):
    story, human = beside_what_it_put_down(setup)
    T = at_hand(story)
    told = threats_of_object(story, human, lambda now: T, lambda now: AWAY)
    assert grows(told[0]) > 0.1 and told[-1].known.all()
    assert grows(told[-1]) < 0.01  # by the noise alone
    assert grows(told[-1], 1.2) > 0.1  # by then somebody may have come
    near = T[:3, 3] + [0.25, 0.0, 0.0]
    near = np.array([[*near, *near, 0.05]])
    (now,) = threats_of_object(story, human, lambda now: T, lambda now: near, 1, 1.0)
    assert grows(now) > 0.1  # at once


def test_where_nobody_is_seen_what_was_put_down_stays(setup):
    story, human = beside_what_it_put_down(setup)
    T, nobody = at_hand(story), np.zeros((0, 7))
    told = threats_of_object(story, human, lambda now: T, lambda now: nobody)
    assert grows(told[-1]) < 0.01


@pytest.mark.parametrize("why", ["moves", "elsewhere", "taken", "not asked for"])
def test_anything_else_may_start_off_at_once(setup, why):
    times = {"untouched": (1e-6,)} if why == "not asked for" else {}
    story, human = beside_what_it_put_down(setup, **times)
    T = at_hand(story)
    if why == "taken":
        story._take()
        story.planner.detach()
        story.hand.holding = False

    def seen(now):
        x = 0.3 * now if why == "moves" else 0.05 if why == "elsewhere" else 0.0
        return pose_of((x, 0.0, 0.0), (0.0, 0.0, 0.0)) @ T

    told = threats_of_object(story, human, seen, lambda now: AWAY)
    assert all(grows(threat) > 0.1 for threat in told)


def test_the_balls_that_stand_for_an_object_hold_it(rng):
    rods = rng.uniform(-0.3, 0.3, (5, 7))
    rods[:, 6] = rng.uniform(0.005, 0.05, 5)
    balls = covering_balls(rods)
    for k, row in enumerate(rods):
        along = row[:3] + rng.uniform(0, 1, (400, 1)) * (row[3:6] - row[:3])
        away = rng.normal(size=(400, 3))
        points = along + row[6] * away / np.linalg.norm(away, axis=1)[:, None]
        mine = balls[k :: len(rods)]
        off = np.linalg.norm(points[:, None] - mine[None, :, :3], axis=2) - mine[:, 3]
        assert off.min(axis=1).max() <= 1e-9


AWAY = np.array([[3.0, 0.0, 0.0, 3.0, 0.0, 0.5, 0.1]])


def test_an_object_is_put_into_its_own_place_where_that_is_free(setup):
    story, human = story_at(setup)
    at = put_down(story, human, 15.0, lambda now: AWAY)
    assert [e.signal for e in story.events] == ["placed", "away"]
    assert np.linalg.norm(at - setup.T_place[:3, 3]) < 0.005


def test_where_somebody_stands_in_its_place_it_is_put_down_in_another_one(setup):
    story, human = story_at(setup)
    taken = rod_at(setup.T_place)
    at = put_down(story, human, 18.0, lambda now: taken)
    assert [e.signal for e in story.events] == ["placed_elsewhere", "away"]
    assert "its place was not free" in story.events[0].reason
    off = np.linalg.norm(setup.T_others[:, :3, 3] - at, axis=1)
    assert off.min() < 0.005 and np.linalg.norm(at - taken[0, :3]) > cases._APART
    assert not story.holding and story.planner.attached is None


def test_where_all_places_are_taken_it_waits_and_tries_again(setup):
    story, human = story_at(setup)
    taken = np.concatenate([rod_at(T) for T in setup.places()])
    at = put_down(story, human, 18.0, lambda now: AWAY if now > 5.0 else taken)
    assert [e.signal for e in story.events] == ["placed", "away"]
    assert story.events[0].time_s > 5.0
    assert np.linalg.norm(at - setup.T_place[:3, 3]) < 0.005


def test_who_never_moves_off_leaves_it_in_the_hand_and_that_is_told(setup):
    story, human = story_at(setup, put_down_s=5.0)
    taken = np.concatenate([rod_at(T) for T in setup.places()])
    assert put_down(story, human, 8.0, lambda now: taken) is None
    (event,) = story.events
    assert (event.state, event.signal) == ("kept", "beset") and event.failure
    assert "the person is in the way to each place" in story.reason
    assert event.time_s == pytest.approx(5.0, abs=0.1) and story.holding


def test_places_out_of_reach_are_told_at_once(setup):
    far = replace(setup, T_place=FAR @ setup.T_place, T_others=FAR @ setup.T_others)
    story, human = story_at(far)
    assert put_down(story, human, 12.0, lambda now: AWAY) is None
    assert [e.signal for e in story.events] == ["unreached"]
    assert "within reach" in story.reason and story.events[0].time_s < 11.0


def test_who_creeps_beside_the_person_goes_to_another_place(setup):
    story, human = story_at(setup)
    story.update(sim.StoryFrame(0.0, human, None, False, True))
    while story._step.kind == "place":
        story.update(sim.StoryFrame(story._now + PERIOD, human, None, False, True))
    assert story.placing.places.now == 0
    for k in range(120):
        story._hindered_s += PERIOD  # slowed in each frame
        story.update(sim.StoryFrame(story._now + PERIOD, human, None, False, True))
    assert story.placing.places.now not in (0, None)


def test_the_other_places_carry_the_object_and_nothing_else_is_there(setup):
    assert len(setup.T_others) >= 2
    xy = setup.places()[:, :2, 3]
    gaps = np.linalg.norm(xy[:, None] - xy[None], axis=2) + np.eye(len(xy))
    assert gaps.min() >= cases._APART
    assert np.allclose(setup.T_others[:, 2, 3], setup.T_place[2, 3])
    x, y = setup.T_others[0][:2, 3]
    plate = Box((0.1, 0.1, 0.016), pose_of((x, y, 0.008), (0.0, 0.0, 0.0)))
    with_plate = SimpleNamespace(**vars(setup))
    with_plate.planner = lambda: planner
    planner = setup.planner()
    planner.scene.add("plate", plate)  # low, but the object would be put onto it
    kept = other_places(with_plate)
    off = np.linalg.norm(kept[:, :2, 3] - (x, y), axis=1)
    assert off.min() > 0.05


def test_a_place_that_another_surface_carries_is_none(setup, monkeypatch):
    beyond = lambda scenery, rods, T: 5 if T[0, 3] < 0.0 else None  # noqa: E731
    monkeypatch.setattr(cases, "carries", beyond)
    kept = other_places(setup)
    assert (setup.T_others[:, 0, 3] < 0.0).any() and (kept[:, 0, 3] >= 0.0).all()


@pytest.mark.parametrize("settings", [AT_PLACE, replace(AT_PLACE, shares=(1.0,))])
def test_a_shorter_way_back_is_taken_where_no_longer_one_leads(
    setup, monkeypatch, settings
):
    back = grasping.straight_back
    short = lambda planner, T, q, far, own: (  # noqa: E731
        back(planner, T, q, far, own) if far < 0.08 else None
    )
    monkeypatch.setattr(grasping, "straight_back", short)
    told = setup.planner(), setup.index, quarter_turns(setup.obj.T_tool_object), 0.1
    reaches = Reaches(*told, settings=settings)
    found = reaches.first(setup.T_place, setup.rest)
    assert bool(found) == (len(settings.shares) > 1)


def test_the_hand_keeps_clear_of_what_the_object_is_put_onto(setup, monkeypatch):
    story, _ = story_at(setup)
    planner, grasps = setup.planner(), quarter_turns(setup.obj.T_tool_object)

    def found():  # on solid 0
        told = planner, setup.index, grasps, 0.1, story.hand.carried, None, 0.0, 0
        reaches = Reaches(*told, AT_PLACE)
        reaches.begin(setup.T_others[0], setup.rest)
        while not reaches.over and not reaches.found:
            reaches.work()
        return bool(reaches.found)

    assert found()
    bare, stands = planner.carrier.bare, StaticTest.motion_free

    def blocked(test, q, dq):
        return stands(test, q, dq) and not (test is bare and dq.any())

    monkeypatch.setattr(StaticTest, "motion_free", blocked)
    assert not found()


def test_one_grasp_is_looked_for_from_as_many_nodes_as_four(setup):
    story, _ = story_at(setup)
    look = story.placing.look_for_grasps()
    look.begin(setup.T_place, setup.rest)
    four = Reaches(
        setup.planner(), setup.index, quarter_turns(setup.obj.T_tool_object), 0.1
    )
    four.begin(setup.T_place, setup.rest)
    assert len(look._starts) - 1 == len(four._starts) - 4  # q, once for each grasp
    assert HELD_AT_PLACE.seeds == 4 * AT_PLACE.seeds


def searched(reaches, setup, tried):
    """Look to the end from where the robot rests; return (grasp, start) in order."""
    order, own = [], Reaches._start

    def start(self, grasp, k):
        order.append((grasp, k if isinstance(k, int) else -1))
        return tried(self, grasp, k) if tried else own(self, grasp, k)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Reaches, "_start", start)
        reaches.begin(setup.T_place, setup.rest)
        while not reaches.over and not reaches.found:
            reaches.work()
    return order


def nowhere(reaches, grasp, k):
    return False


def test_grasps_that_come_last_are_tried_where_the_first_lead_nowhere(setup):
    told = setup.planner(), setup.index, quarter_turns(setup.obj.T_tool_object), 0.1
    reaches = Reaches(*told, settings=AT_PLACE, first=1)
    found = searched(reaches, setup, None)
    assert {grasp for grasp, _ in found} == {0} and reaches.found

    def only_third(self, grasp, k):
        self.found += ["it"] * (grasp == 2)

    order = searched(Reaches(*told, settings=AT_PLACE, first=1), setup, only_third)
    grasps = [grasp for grasp, _ in order]
    n = grasps.index(1)  # all ways of the first grasp, of any length, come before
    assert n == grasps.count(0) == 7 * len(AT_PLACE.shares)
    assert grasps[n:] == [1, 2]


def test_more_nodes_are_tried_where_the_near_ones_lead_nowhere(setup):
    told = setup.planner(), setup.index, quarter_turns(setup.obj.T_tool_object), 0.1
    own = replace(AT_PLACE, shares=(1.0,), seeds=3, most_seeds=20)
    order = searched(Reaches(*told, settings=own), setup, nowhere)
    every = [(g, k) for k in (-1, *range(20)) for g in range(4)]
    assert sorted(order) == sorted(every)  # each once
    few = replace(own, most_seeds=3)
    order = searched(Reaches(*told, settings=few), setup, nowhere)
    assert sorted(order) == sorted((g, k) for k in (-1, 0, 1, 2) for g in range(4))


def test_where_all_that_were_found_are_blocked_others_are_looked_for(setup):
    told = setup.planner(), setup.index, quarter_turns(setup.obj.T_tool_object), 0.1
    reaches = Reaches(*told, settings=replace(AT_PLACE, kept=1, shares=(1.0,)), first=1)
    searched(reaches, setup, None)
    reaches._queue = []
    reaches.drop(reaches.found[0])
    assert not reaches.over and not reaches.found
    while not reaches.over and not reaches.found:
        reaches.work()
    assert reaches.found[0].grasp != 0


def test_what_cannot_be_put_down_again_is_taken_all_the_same(setup, monkeypatch):
    """With a grasp that can be put down if one reaches; else with any that does."""
    able = np.array([False, False, True, False])
    monkeypatch.setattr(Placing, "_placeable", lambda *_: able)
    story, _ = story_at(setup)
    grasps = quarter_turns(setup.obj.T_tool_object)
    assert story.offer.reaches._first == 1
    assert np.allclose(story.offer.reaches.T_tool_object, grasps[[2, 0, 1, 3]])
    able[:] = False
    story, _ = story_at(setup)
    assert story.offer.reaches._first == 4


def test_places_are_poses_its_own_first(setup):
    human = handover.Human().placed(3.0, 0.0, np.pi)
    story = new_story(setup, sim.StorySettings(direction="receive"), human)
    assert np.allclose(story.placing.T_places[0], setup.T_place)
    assert np.allclose(story.placing.T_places[1:], setup.T_others)
    with pytest.raises(BadInput, match=r"T_base_place has shape \(3,\); give one"):
        checked_places(np.zeros(3))


@pytest.mark.parametrize("why", ["occupied", "kept_off", "late"])
def test_what_kept_it_from_fetching_the_object_is_told(setup, why):
    human = handover.Human().placed(3.0, 0.0, np.pi)
    if why == "occupied":
        T = human.T_world_pelvis.copy()
        T[:3, 3] = setup.T_place[:3, 3]
        human = human.moved(T)
    settings = sim.StorySettings(fetch_s=0.3)
    story = new_story(setup, settings, human, fetch=True)
    assert story.state == "fetch"
    if why == "late":  # it is kept from it by something else
        story.executor.advance = lambda: None
    if why == "kept_off":  # somebody stands where its hand would be
        nowhere = dict(path=np.zeros((0, 0)), reason="blocked", goal=None, retreat=None)
        held = SimpleNamespace(status="holding", **nowhere)
        story.planner.step = lambda *_, **__: held
    for k in range(45):
        at = dict(T_base_object=setup.T_place)
        story.update(sim.StoryFrame(k / 100, human, np.zeros(6), True, False, **at))
        if story.events:
            break
    event = story.events[0]
    assert event.signal == why and event.failure
    assert ("somebody stood" in event.reason) == (why == "occupied")
    assert ("no way to the object was free" in event.reason) == (why == "kept_off")


def test_an_older_recording_knew_of_one_place_and_was_as_patient_as_for_a_fetch(setup):
    known = asdict(sim.StorySettings(direction="receive", fetch_s=12.0))
    for name in ("place_s", "again_s", "put_down_s"):
        del known[name]
    human = handover.Human().placed(3.0, 0.0, np.pi)
    story = story_of(setup, {"settings": known, "fetch": False}, human)
    assert len(story.placing.T_places) == 1
    assert story.settings.put_down_s == 12.0 < story.settings.place_s


def test_a_recording_keeps_what_is_handed_over(setup):
    thin = replace(setup.obj, turns=2, name="rod")
    told = {"story": {"held": held_told(thin)}}
    back = object_of(told)
    assert back.turns == 2 and back.name == "rod" and back.mass_kg == thin.mass_kg
    assert np.array_equal(back.capsules, thin.capsules)
    assert np.array_equal(back.T_tool_object, thin.T_tool_object)
    assert object_of({"story": {}}) is None  # an older one: a wrench
    turned = quarter_turns(thin.T_tool_object, 2)
    assert len(turned) == 2
    assert np.allclose(turned[1], quarter_turns(thin.T_tool_object)[2])


def test_configurations_that_somebody_is_in_the_way_of_are_passed_by(
    setup, monkeypatch
):
    settings = replace(HELD_AT_PLACE, kept=1)
    monkeypatch.setattr(object_places, "HELD_AT_PLACE", settings)
    story, human = story_at(setup, blocked_s=5.0)
    tried = []
    free = story.view.line_free

    def not_the_first(before, q, there):
        tried.append(before.tobytes())
        return before.tobytes() != tried[0] and free(before, q, there)

    monkeypatch.setattr(story.view, "line_free", not_the_first)
    nobody = human.capsules()
    opened = put_down(story, human, 12.0, lambda now: nobody)
    assert opened is not None and np.allclose(opened, setup.T_place[:3, 3], atol=0.01)
    assert len(set(tried)) > 1


def test_what_was_passed_by_is_what_there_is_once_all_was_tried(setup):
    told = setup.planner(), setup.index, quarter_turns(setup.obj.T_tool_object), 0.1
    look = Reaches(*told, settings=replace(AT_PLACE, kept=1))
    look.begin(setup.T_place, setup.rest)
    seen = []
    while True:
        while not look.over:
            look.work()
        seen += [reach for reach in look.found if all(reach is not r for r in seen)]
        if not look.pass_by():
            break
    assert len(seen) > 1 and len(look.found) == len(seen)
    assert {reach.q.tobytes() for reach in look.found} == {r.q.tobytes() for r in seen}
