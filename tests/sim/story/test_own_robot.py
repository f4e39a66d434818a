"""Hand-overs of a robot of your own, on small maps: the example, and what fails."""

import re
import runpy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from forms import some
from own_story import BELIEVED, PERIOD, at_a_place, pulled, story_of

import handover
import odm
import sim
from handover.human.body import ARM_LABELS, Part
from odm.execution.executor import BRAKED, MOVING, RETREATING, Executor
from odm.execution.stop_test import BrakingTest, slowest_stop
from odm.execution.threat import Threat, ThreatSettings, Watcher
from odm.frame.carrying import Carrier
from odm.obstacles.scenery import parse_scenery
from roadmap.errors import BadInput
from roadmap.geometry.gaps import ball_gaps, moved_rods
from roadmap.kinematics.forward import cover_balls, tool_pose
from roadmap.motion.motion import time_path
from roadmap.transforms import pose_of
from sim.loop.loop import exact_audit
from sim.people.whole_person import BASE_HEIGHT
from sim.story import robot_hand as hand_module
from sim.story.cases import (
    LIVE,
    StoryCase,
    grasp_spare,
    setup_of,
    slow_to_stop,
    story_wrench,
)
from sim.story.grasping import Reach, Reaches, straight_back
from sim.story.machine import FETCH, PUT_DOWN, RELEASE, TABLES, WAIT, Machine, Step
from sim.story.play import new_story
from sim.story.robot_hand import check_grasps, held_farther_out, quarter_turns, too_near
from sim.story.settings import PARTNER, GraspingSettings
from sim.story.tell import said_before

FOLDER = Path(__file__).resolve().parents[3] / "docs" / "examples"
HOLDS = dict(status="holding", path=np.zeros((0, 0)), retreat=None, reason="")
FAR = pose_of((3.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def tell(story, seconds, look, until=None):
    """Run a story; `look(story, now, opened, closed)` returns the frame.

    It ends with the story, after so many seconds, or once it is in the state `until`.
    """
    since, fingers = 0.0, story.fingers
    for k in range(int(seconds / PERIOD)):
        now = PERIOD * k
        if story.fingers != fingers:
            since, fingers = now, story.fingers
        done = now - since >= 0.15 or not k
        opened, closed = done and fingers == "open", done and fingers == "closed"
        story.update(look(story, now, opened, closed))
        if story.ended or story.state == until:
            break
    return [event.state for event in story.events]


def test_a_robot_of_your_own_hands_over(maps, capsys):
    (file,) = FOLDER.glob("07_*.py")
    story = runpy.run_path(str(file))["main"](*maps[:2])
    assert story.outcome == "handed over"
    states = [event.state for event in story.events]
    assert states[-1] == "done" and "release" in states
    assert not any(event.failure for event in story.events)
    assert not story.holding and story.planner.attached is None
    assert "the pull lasted" in capsys.readouterr().out


def test_what_is_dropped_on_the_way_ends_at_rest_and_is_told(maps):
    story, human = story_of(maps)

    def look(story, now, opened, closed):
        return sim.StoryFrame(now, human, pulled(0.0), opened, holds=now < 0.5)

    assert tell(story, 8.0, look) == ["retreat", "done"]
    assert story.outcome == "the object was dropped on the way"
    assert story.planner.attached is None and not story.holding


@pytest.mark.parametrize("seen", [False, True])
def test_fingers_that_seem_empty_for_a_moment_hold_on(maps, seen):
    """They opened at once, and dropped what they held where nobody was."""
    story, human = story_of(maps)

    def look(story, now, opened, closed):
        T = story.hand.T_base_tool() @ story.T_tool_object if seen else None
        holds = not 0.5 < now < 0.8  # told of one that holds it all the time
        assert story.fingers == "closed" and story.planner.attached is not None
        assert story.view.offered == 0  # what is seen in the hand is nothing beside it
        return sim.StoryFrame(now, human, pulled(0.0), False, holds, T)

    assert tell(story, 3.0, look) == ["retreat", "approach"]
    lost, found = story.events
    assert (lost.signal, found.signal) == ("lost", "found") and story.holding
    assert 0.02 < lost.time_s - 0.5 < 0.06 and 0.02 < found.time_s - 0.8 < 0.06


def test_fingers_that_seem_empty_beside_somebody_open(maps):
    """Else they would drag along who has taken it."""
    story, human = story_of(maps)
    tool = story.hand.T_base_tool()[:3, 3]
    for away, fingers in ((1.0, "closed"), (0.1, "open")):
        rows = np.array([[*tool, *tool, 0.03]])
        rows[0, [0, 3]] += away
        story, _ = story_of(maps)
        for k in range(80):
            told = {"capsules": rows, "labels": np.array([int(Part.RIGHT_FOREARM)])}
            story.update(sim.StoryFrame(0.01 * k, human, opened=False, **told))
        assert story.fingers == fingers
        assert [e.signal for e in story.events] == ["lost", "away"]
        lost, away = (event.time_s for event in story.events)
        assert (away - lost > 0.4) == (fingers == "closed")  # they may hold it yet


@pytest.mark.parametrize("lifted, side, armless", some([
    ({"left": 60}, "left", ""), ({"left": 60}, "left", "right"), ({}, "right", "left"),
    ({"right": 60}, "right", ""), ({"left": 60, "right": 60}, "right", ""),
    ({"right": -40}, "right", ""),
], 0, 2, 4))  # fmt: skip
def test_the_hand_that_is_held_out_instead_is_the_one_that_takes(
    maps, lifted, side, armless
):
    story, human = story_of(maps, conduct=BELIEVED)
    reaching = human
    for one, angle in lifted.items():
        elbow = max(angle, 0)
        reaching = reaching.with_arm(one, np.radians([angle, 0, 0, elbow, 0, 0, 0]))

    kept = ~np.isin(human.labels, ARM_LABELS.get(armless, ()))

    def look(story, now, opened, closed):
        who = human if now < 2.3 else reaching  # it is there by then
        rows = who.capsules()[kept]
        rows = rows if now else np.nan * rows  # the tracker knows nobody at first
        told = dict(holds=True, capsules=rows, labels=human.labels[kept])
        return sim.StoryFrame(now, who, pulled(0.0), opened, **told)

    tell(story, 3.4, look)
    told = [e for e in story.events if e.signal == "other_hand"]
    assert story.events[0].state == "present" and story.events[0].time_s < 2.3
    assert len(told) == (side == "left") and story.sight.side == side
    assert story.targets.meet.settings.side == side
    arm = story.sight.parts(human.labels)[1]
    assert set(human.labels[arm]) == set(ARM_LABELS[side])
    assert [e.time_s for e in told] == pytest.approx([2.8] * len(told), abs=0.05)


def test_who_gives_something_is_not_asked_for_the_other_hand(maps):
    story, human = story_of(maps, "receive")
    reaching = human.with_arm("left", np.radians([60, 0, 0, 60, 0, 0, 0]))
    frames = [sim.StoryFrame(0.1 * k, who) for k, who in enumerate((human, reaching))]
    assert [story.sight.look(frame, 0.1).instead for frame in frames] == [0.0, 0.0]


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 2.0), (np.pi, 0.0, 0.3), (0.0, -1.57, 0)])
def test_the_person_is_where_a_base_that_is_turned_or_hangs_sees_them(maps, rpy):
    T = pose_of((0.4, -1.0, 1.1), rpy)
    story, human = story_of(maps, T_world_base=T)
    human = human.looking(np.array([1.0, 0.0, 0.0]))
    rods = []
    story.planner.expect = lambda there: rods.append(there.capsules)
    story.update(sim.StoryFrame(0.0, human, pulled(0.0), False, True))
    np.testing.assert_allclose(
        story.view.person, human.obstacles(T).capsules, atol=1e-12
    )
    behind = T[:3, :3] @ rods[0][-1].reshape(-1)[:6].reshape(2, 3).T + T[:3, 3:]
    assert np.allclose(behind[:2, 0], behind[:2, 1])  # upright in the world
    head = human.capsules()[human.labels == Part.HEAD, :6].reshape(-1, 3)
    assert np.isclose(behind[0, 0], head.mean(axis=0)[0] - 0.35)


def test_a_planner_that_was_told_in_the_world_is_refused(maps):
    story, _ = story_of(maps)
    story.planner.detach()
    story.planner.set_base(pose_of((0.0, 0.0, 1.0), (np.pi, 0.0, 0.0)))
    with pytest.raises(BadInput, match="MeetSettings.T_world_base"):
        sim.Handover(story.planner, story.targets, story.executor)


def test_what_was_received_is_given_back_as_it_is_held(maps):
    """By the same planner and executor; held as no story took it, it is refused."""
    story, states = receive(maps, lambda story: True)
    assert states[-1] == "kept" and story.outcome == "handed over"
    meet = story.targets.meet
    obj = meet.obj.held_by(story.T_tool_object)
    meet = handover.InteractionWorkspace(maps[1], meet.human, obj, 4, meet.settings)
    targets = handover.LiveTargets(story.planner, meet, None, maps[2])
    back = sim.Handover(story.planner, targets, story.executor)
    assert back.holding and back.state == "approach"
    away = pose_of((0.0, 0.0, 0.1), (0.0, 0.0, 0.0)) @ story.T_tool_object
    meet = handover.InteractionWorkspace(
        maps[1], meet.human, obj.held_by(away), 4, meet.settings
    )
    targets = handover.LiveTargets(story.planner, meet, None, maps[2])
    with pytest.raises(BadInput, match="10 cm .*obj.held_by.story.T_tool_object"):
        sim.Handover(story.planner, targets, story.executor)


def test_who_is_driven_off_while_the_fingers_close_fetches_anew(maps, monkeypatch):
    story, human = story_of(maps)
    story.machine = Machine(TABLES["give"], FETCH)  # as with a T_base_place
    story.hand.holding, story.hand.fingers = False, "open"
    above = story.executor.set_point.q
    story._steps = [Step("goal", [above]), Step("line", above), Step("grip", "closed")]

    def update(now):
        story.update(sim.StoryFrame(now, human, pulled(0.0), True, False))

    for k in range(8):
        update(PERIOD * k)
    assert story.fingers == "closed" and story._at == 2
    story.executor.state = RETREATING
    monkeypatch.setattr(Executor, "at_rest", property(lambda self: False))
    update(0.08)
    assert story.fingers == "open" and story._at == 0


def test_a_robot_hindered_on_its_way_back_plans_it_with_room_for_the_person(maps):
    """It had crept to 1.2 cm of a trunk by a way that was free, and stood there."""
    story, human = story_of(maps)

    def look(story, now, opened, closed):
        return sim.StoryFrame(now, human, pulled(0.0), opened, holds=now < 0.1)

    tell(story, 0.2, look)
    assert story.state == "retreat" and story._berth.room < story.settings.room
    story._hindered_s = 0.5
    story.update(sim.StoryFrame(0.2, human, pulled(0.0), True, False))
    assert story._berth.room == story.settings.room


@pytest.mark.parametrize("room", [0.0, 0.02])
def test_what_is_held_out_is_passed_with_the_berth_of_who_holds_it(
    maps, monkeypatch, room
):
    """At 20 and 30 Hz a way led so near to it that nobody was let on along it."""
    story, human = story_of(maps, direction="receive")
    story._berth.room, told, step = room, [], story.planner.step

    def heard(there, **given):
        told.append(there.capsules[:, 6])
        return step(there, **given)

    monkeypatch.setattr(story.planner, "step", heard)
    seen = dict(opened=True, T_base_object=pose_of((0.6, 0.0, 0.4), (0.0, 0.0, 0.0)))
    story.update(sim.StoryFrame(0.0, human, pulled(0.0), **seen))
    rods = story.targets.meet.obj.capsules
    assert np.allclose(told[0][-len(rods) :], rods[:, 6] + room)


@pytest.mark.parametrize(("away", "told"), [(0.4, False), (0.0, True)])
def test_who_walks_into_a_robot_that_waits_for_their_hand_is_told(maps, away, told):
    """It said for as long as they stood there that a hand was near."""
    story, human = story_of(maps)
    story.machine = Machine(TABLES["give"], "wait")
    story._enter()
    tip = tool_pose(story.planner.robot, story.executor.set_point.q)[:3, 3]
    T = human.T_world_pelvis.copy()
    T[:3, 3] = tip + [away + 0.1, 0.0, -0.2]
    human = human.moved(T)
    rows, labels = human.capsules(), human.labels
    seen = np.flatnonzero(labels == Part.TORSO)
    parts = dict(capsules=rows[seen], labels=labels[seen])
    story.update(sim.StoryFrame(0.0, human, pulled(0.0), False, True, **parts))
    assert ("torso is at the robot" in story.reason) == told


@pytest.mark.parametrize(("period", "told"), [(0.01, False), (0.1, True)])
def test_frames_too_rare_to_close_on_what_is_held_out_are_told(maps, period, told):
    story, _ = story_of(maps, direction="receive", period=period)
    wanted = r"frame every 100 ms.* \d+\.\d cm.*limit 2.5 cm.*at least \d+ frames"
    assert bool(re.search(wanted, story.reason)) == told  # before it sets off
    story.machine.step({"arrived"}, 0.0), story.machine.step({"steady"}, 0.0)
    story.machine.step({"free"}, 0.0)
    assert "a frame every" not in story.reason


def test_frames_whose_noise_is_the_matter_are_told_once_it_was_tried(maps):
    noisy = replace(PARTNER, noise=0.02)
    story, _ = story_of(maps, direction="receive", threat=noisy)
    assert "a frame every" not in story.reason
    story.machine.step({"arrived"}, 0.0), story.machine.step({"steady"}, 0.0)
    story.machine.step({"blocked"}, 0.0)
    assert "give frames more often" in story.reason


def test_frames_of_a_slow_sensor_may_do_more(maps):
    story, human = story_of(maps, period=0.02)
    story.update(sim.StoryFrame(0.0, human, pulled(0.0), False, True))
    assert story._allowance.units == 3000


@pytest.mark.parametrize(("period", "looks"), [(0.01, 1), (0.02, 2), (0.05, 5)])
def test_what_goes_on_by_frames_does_not_take_a_slow_sensor_longer(
    maps, monkeypatch, period, looks
):
    """At 20 Hz no configuration was found and joined within the robot's patience."""
    story, human = story_of(maps, period=period)
    targets, done = story.targets, []
    look = type(targets).look

    def counted(self, *told):
        before = self.counts["set_goals"]
        look(self, *told)
        done[-1].append(self.counts["set_goals"] - before)

    monkeypatch.setattr(type(targets), "look", counted)
    for k in range(round(3.0 / period)):
        done.append([])
        told = dict(opened=False, holds=True, wrench=pulled(0.0))
        story.update(sim.StoryFrame(period * k, human, **told))
        if story.state != "approach":
            break
    whole = [d for d in done if len(d) == looks]
    assert len(whole) > 0.5 * len(done) and max(map(len, done)) == looks
    # after goals were set the planner answers before the next look
    assert all(not any(d[:-1]) for d in done)
    assert story.events[0].state == "present"


@pytest.mark.parametrize("beside", [True, False])
def test_who_was_driven_off_against_the_object_backs_out_first(
    maps, monkeypatch, beside
):
    """No path begins there: it stood until the time was out."""
    index = maps[2]
    story, human = story_of(maps)
    back = story.settings.back
    low = next(
        k
        for k, (T, q) in enumerate(zip(index.T_base_tool, index.nodes, strict=True))
        if straight_back(story.planner, T, q, back) is not None
    )
    story, human = story_of(maps, node=low, before=0.0, blocked_s=0.05)
    story.machine = Machine(TABLES["give"], FETCH)
    story.hand.holding, story.hand.fingers = False, "open"
    q = story.executor.set_point.q
    T = tool_pose(story.planner.robot, q) @ story.hand.T_tool_object
    if not beside:
        T = pose_of((0.0, 0.0, 2.0), (0.0, 0.0, 0.0)) @ T
    story._steps = [Step("goal", [q + 0.1]), Step("line", q), Step("grip", "closed")]
    monkeypatch.setattr(type(story), "_is_blocked", lambda self: self._at == 0)
    monkeypatch.setattr(story, "_reach_otherwise", lambda: False)
    kinds = []
    for k in range(12):
        seen = dict(wrench=pulled(0.0), opened=True, T_base_object=T)
        story.update(sim.StoryFrame(PERIOD * k, human, **seen))
        kinds.append([step.kind for step in story._steps])
    assert kinds[0] == ["goal", "line", "grip"]
    assert (kinds[-1] == ["back", "goal", "line", "grip"]) == beside


def test_a_blocked_place_is_gone_to_by_another_grasp_or_arm(maps, monkeypatch):
    story, human = story_of(maps, blocked_s=0.05)
    index = story.targets.finder.index
    near = np.abs(index.T_base_tool[:, :3, 3] - [0.3, 0.2, 0.5]).sum(axis=1).argmin()
    story.placing.T_places = (index.T_base_tool[near] @ story.hand.T_tool_object)[None]
    story.hand.holding, story.hand.fingers = False, "open"
    story.machine = Machine(TABLES["give"], FETCH)
    story._enter()
    first = story._steps[0].value[0]
    monkeypatch.setattr(type(story), "_is_blocked", lambda self: self._at == 0)
    gone_to = []
    for k in range(60):
        story.update(sim.StoryFrame(PERIOD * k, human, pulled(0.0), True, False))
        goal = story._steps[0].value[0]
        if not any(goal is q for q in gone_to):
            gone_to.append(goal)
    assert gone_to[0] is first and len(gone_to) > 1
    assert [step.kind for step in story._steps[:3]] == ["goal", "line", "grip"]
    assert np.abs(gone_to[1] - first).max() > 0.1
    assert story._goals[0] is story._steps[0].value[0]


def test_a_hand_that_hangs_beside_the_object_is_told_to_come_once_it_does(maps):
    story, human = story_of(maps, comes=0.05, conduct=BELIEVED)
    labels, rows = human.labels, human.capsules()
    hand, since, gaps = labels == Part.RIGHT_HAND, [], {}

    def look(story, now, opened, closed):
        seen = np.array(rows)
        if story.state in ("present", "wait"):
            since.append(now)
            far = 0.2 - 0.1 * min(1.0, max(0.0, now - since[0] - 1.0))
            T = tool_pose(story.planner.robot, story.executor.set_point.q)
            place = (T @ story.hand.T_tool_object)[:3, 3] + [0.0, far + 0.1, 0.0]
            seen[hand, :3] = seen[hand, 3:6] = place
        if story._last is not None:
            gaps.setdefault(story.state, []).append(story._last.hand_gap)
        told = dict(opened=opened, holds=not opened, capsules=seen, labels=labels)
        return sim.StoryFrame(now, human, pulled(0.0), **told)

    tell(story, 4.2, look)
    assert [event.state for event in story.events] == ["present", "wait"]
    assert story.events[1].signal == "near" and "near" in story.events[1].reason
    assert story.events[1].time_s > since[0] + 1.2  # not while it hangs there
    assert 0.10 < min(gaps["present"]) < max(gaps["present"][2:]) < story.settings.near
    assert gaps["wait"][0] < max(gaps["present"][2:]) - 0.9 * story.settings.comes


@pytest.mark.parametrize("direction", ["give", "receive"])
def test_what_the_fingers_hold_is_in_the_map_from_the_first_frame_to_the_last(
    maps, direction
):
    state = FETCH if direction == "give" else PUT_DOWN
    story, human = at_a_place(maps, direction, state)
    felt = []

    def look(story, now, opened, closed):
        holds = closed if state == FETCH else not opened
        felt.append((story.state, holds, story.planner.attached is not None))
        return sim.StoryFrame(now, human, None, opened, holds)

    tell(story, 12.0, look, until="approach" if state == FETCH else "retreat")
    assert story.events[0].signal == ("held" if state == FETCH else "placed")
    held = [attached for where, holds, attached in felt if where == state and holds]
    # one frame tells the story that they hold it; from then on the map has it
    assert len(held) > 20 and all(held[1:])
    free = [attached for where, holds, attached in felt if where == state and not holds]
    assert len(free) > 5 and not any(free[1:])


def test_an_object_at_its_place_may_touch_what_it_stands_on_and_nobody(maps):
    story, human = at_a_place(maps, "receive", PUT_DOWN)
    view, planner, robot = story.view, story.planner, story.planner.robot
    look = story.placing.look_for_grasps()
    reach = look.first(story.placing.T_places[0], story.executor.set_point.q)[0]
    T, held = tool_pose(robot, reach.q), planner.attached
    low = T[:3, :3] @ held[held[:, 2].argmax(), :3] + T[:3, 3]  # the end in front
    ball = np.array([[*low, *low, 0.01]])
    there = odm.Obstacles(capsules=ball)
    view.classes, view.phase, view.offered = np.zeros(1, np.int8), "receive", 0
    way = reach.q_before, reach.q
    far = odm.Obstacles(capsules=ball + [2.0, 0, 0, 2.0, 0, 0, 0])
    assert view.line_free(*way, far)
    planner.scene.add("table", odm.Sphere(0.01, pose_of(low, (0.0, 0.0, 0.0))))
    assert not view.line_free(*way, far)  # on any other motion it keeps off
    view.at_place = True
    assert view.line_free(*way, far)
    assert not view.line_free(*way, there)  # somebody's hand is under the object
    planner.detach()
    assert view.line_free(*way, there)  # which the robot alone would not touch


def test_a_robot_that_gives_an_object_back_moves_once_its_fingers_are_open(maps):
    story, human = story_of(maps)
    story.machine.state = "retreat"
    story._enter("late")
    assert [step.kind for step in story._steps][:2] == ["grip", "let"]
    q = story.executor.set_point.q
    for k in range(20):
        opened = k >= 15
        story.update(sim.StoryFrame(PERIOD * k, human, None, opened, not opened))
        assert opened or story.planner.attached is not None
        assert opened or np.array_equal(story.executor.set_point.q, q)
    assert story.fingers == "open" and story.planner.attached is None


def test_a_place_is_looked_for_one_start_a_frame_and_then_gone_to(maps, monkeypatch):
    story, human = at_a_place(maps, "receive", PUT_DOWN)
    starts, tries = [], Reaches._try

    def counted(self, grasp, seed):
        starts[-1] += 1
        return tries(self, grasp, seed) and sum(starts) > 2

    monkeypatch.setattr(Reaches, "_try", counted)
    while story._steps[0].kind == "place":
        starts.append(0)
        frame = sim.StoryFrame(PERIOD * len(starts), human, None, False, True)
        story.update(frame)
        assert starts[-1] <= 1 and len(starts) < 60
    assert 0 < sum(starts) < len(starts)
    kinds = [step.kind for step in story._steps]
    assert (
        kinds == ["goal", "line", "grip", "let", "line"] and not story.placing.placeless
    )


def test_an_object_that_moves_is_followed_by_one_start_a_frame(maps, monkeypatch):
    """Until it is known where it is grasped now, the robot goes on to where it was."""
    story, human = story_of(maps, "receive")
    index = story.targets.finder.index
    near = np.abs(index.T_base_tool[:, :3, 3] - [0.3, 0.2, 0.5]).sum(axis=1).argmin()
    T = index.T_base_tool[near] @ story.targets.meet.obj.T_tool_object
    rest, starts, tries, goals = story._rest, [], Reaches._try, []

    def counted(self, grasp, seed):
        starts[-1] += 1
        return tries(self, grasp, seed)

    monkeypatch.setattr(Reaches, "_try", counted)
    for k in range(120):
        starts.append(0)
        if k >= 60:
            T = pose_of((0.0, 0.001, 0.0), (0.0, 0.0, 0.0)) @ T  # 10 cm/s
        frame = sim.StoryFrame(PERIOD * k, human, None, T_base_object=T)
        story.update(frame)
        goals.append([q is rest for q in story._goals])
    assert max(starts) == 1 and len(story.offer.reaches.found)
    first = goals.index([False])
    assert first < 60 and not any(any(g) for g in goals[first:])


def test_who_is_meant_to_come_is_no_reason_to_look_for_an_evasion(maps):
    story, human = story_of(maps)
    view, q = story.view, story.executor.set_point.q
    at = tool_pose(story.planner.robot, q)[:3, 3]
    near, far = [*at, *at, 0.05], [*(at + 2.0), *(at + 2.0), 0.05]
    for rows, meant, phase, met in [
        ([near, far], [0], None, True),
        ([near, far], [0], "give", False),
        ([far, near], [0], "give", True),
    ]:
        view.classes, view.meant = np.zeros(2, np.int8), np.array(meant)
        view.phase = phase
        twice = odm.Obstacles(capsules=np.array(rows + rows))  # at two moments
        assert view.is_met(q[None], 0.0, twice) == met


def test_a_robot_that_stands_tries_one_speed_of_an_evasion_in_a_frame(
    maps, monkeypatch
):
    story, human = story_of(maps)
    executor, tried, asked = story.executor, [], []
    q = executor.set_point.q
    path = np.array([q, q + 0.1])

    def evasion(*told):
        asked.append(len(tried))
        return path

    def free(motion, t, threat):
        tried.append(motion.speed_scale)
        return len(tried) == 6

    monkeypatch.setattr(executor._lookout, "evasion", evasion)
    monkeypatch.setattr(executor, "_evasion_free", free)
    threat = Watcher().look(human.capsules(), 0.0)
    begun = [executor._evades(threat) for _ in range(6)]
    assert begun == [False] * 5 + [True] and asked == [0, 3]
    assert np.allclose(tried, [1.0, 0.4, 0.15] * 2)
    assert executor.state == RETREATING


def test_a_goal_that_braking_keeps_it_from_counts_as_blocked(maps):
    story, _ = story_of(maps)
    story.answer = SimpleNamespace(status="following")
    for kind, state, blocked in [
        ("goal", BRAKED, True), ("goal", MOVING, False), ("stand", BRAKED, False)
    ]:  # fmt: skip
        story._steps, story.executor.state = [Step(kind)], state
        assert story.executor.at_rest and story._is_blocked() == blocked


def test_a_hand_that_trembles_holds_still_and_one_that_goes_on_does_not(maps):
    story, human = story_of(maps, "receive")

    def speeds(x_of, n=60):
        for k in range(n):
            T = pose_of((x_of(PERIOD * k), 0.0, 1.0), (0.0, 0.0, 0.0))
            frame = sim.StoryFrame(PERIOD * k, human, T_base_object=T)
            yield story.sight.speed_of_object(frame)

    trembling = list(speeds(lambda t: 0.005 * np.sin(2 * np.pi * 4.0 * t)))
    assert 0.0 < max(trembling[20:]) < story.settings.still_speed
    story.sight.speed_of_object(sim.StoryFrame(0.0, human))  # out of sight
    assert list(speeds(lambda t: 0.2 * t))[-1] == pytest.approx(0.2)
    with np.errstate(all="raise"):  # at a time that is none it may be as fast as it is
        for stamp in (np.inf, np.inf, -np.inf, np.nan):
            lost = sim.StoryFrame(1.0, human, T_base_object=FAR, stamp=stamp)
            assert story.sight.speed_of_object(lost) == np.inf
    nowhere = pose_of((1e300, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert sim.StoryFrame(0.0, human, T_base_object=nowhere).T_base_object is None


@pytest.mark.parametrize("noise", [0.005, 0.01])
def test_an_object_that_is_seen_with_noise_is_gone_for_where_it_is_on_average(
    maps, noise
):
    story, human = story_of(maps, "receive", threat=replace(PARTNER, noise=noise))
    rng, T, seen = np.random.default_rng(3), pose_of((0.6, 0, 1), (0.1, 0, 0)), []
    for k in range(150):
        off = pose_of(rng.normal(0, noise / 3, 3), rng.normal(0, 0.02, 3))
        frame = sim.StoryFrame(PERIOD * k, human, T_base_object=T @ off)
        seen.append(story.sight.look(frame, PERIOD))
    aims = np.array([s.T_object for s in seen[50:]])
    assert np.abs(aims - T).max() < 0.015  # of a frame: up to 0.07
    assert np.ptp(aims[:, :3, 3], axis=0).max() < story.conduct.tracked
    assert np.allclose(aims[-1][:3, :3] @ aims[-1][:3, :3].T, np.eye(3), atol=1e-12)
    assert max(s.object_speed for s in seen[50:]) < story.settings.still_speed
    raw = seen[-1].frame.T_base_object  # what may be touched is where it is seen now
    assert np.allclose(seen[-1].obj, story.hand.capsules(raw))


def test_who_leaves_is_waited_for_and_then_the_object_is_kept(maps):
    story, human = story_of(maps, wait_s=2.5)

    def look(story, now, opened, closed):
        there = human if now < 2.4 else human.moved(FAR @ human.T_world_pelvis)
        return sim.StoryFrame(now, there, pulled(0.0), opened, holds=True)

    states = tell(story, 12.0, look)
    assert states == ["present", "approach", "put_down", "kept"]
    assert story.events[1].reason == "the person left"
    assert story.holding and story.fingers == "closed"


def test_a_pull_on_the_way_stops_the_robot_before_it_lets_go(maps):
    story, human = story_of(maps)
    speeds = {}

    def look(story, now, opened, closed):
        force = 30.0 if now > 0.6 else 0.0
        speeds[story.state] = np.abs(story.executor.set_point.dq).max()
        return sim.StoryFrame(now, human, pulled(force), opened, holds=not opened)

    states = tell(story, 8.0, look)
    assert states[:3] == ["wait", "release", "retreat"] and story.events[0].failure
    assert speeds["release"] < 1e-3
    assert story.outcome == "handed over"


def test_what_it_let_go_of_may_be_left_and_is_heeded_again_once_it_is_clear(maps):
    story, human = story_of(maps)
    q = story.executor.set_point.q
    story._let_go()
    story.machine.state = "retreat"
    story._steps, story.view.phase = [Step("goal", [q])], "receive"
    T = tool_pose(story.planner.robot, q)
    rods = len(story.targets.meet.obj.capsules)
    for k, (aside, phase) in enumerate([(0.0, "receive"), (0.6, None), (0.0, None)]):
        T_object = pose_of((0.0, aside, 0.0), (0.0, 0.0, 0.0)) @ T
        frame = sim.StoryFrame(PERIOD * k, human, T_base_object=T_object)
        seen = story._look(frame)
        assert story.view.phase == phase
        assert story.view.offered == rods == len(seen.there) - seen.people


@pytest.mark.parametrize("about", [False, True])
def test_a_pull_where_no_hand_is_about_does_not_open_the_fingers(maps, about):
    """Somebody's hip, or a thing, pushed at what it held: it let go of it."""
    gone = 2.0 if about else 0.4  # the hands hang 0.6 m away
    story, human = story_of(maps, wait_s=3.0, gone=gone)

    def look(story, now, opened, closed):
        force = 0.0 if story.state == "approach" else 12.0
        return sim.StoryFrame(now, human, pulled(force), opened, holds=not opened)

    states = tell(story, 6.0, look)
    assert ("release" in states) == about and story.holding is not about


def test_a_hand_that_lets_go_as_the_fingers_open_is_held_on_to(maps):
    story, human = story_of(maps, gone=2.0)
    tugs = []

    def look(story, now, opened, closed):
        if story.state == "release" and not tugs:
            tugs.append(now)
        slack = bool(tugs) and tugs[0] <= now < tugs[0] + 0.5
        force = 0.0 if slack or story.state == "approach" else 12.0
        opened = opened and not slack
        return sim.StoryFrame(now, human, pulled(force), opened, holds=not opened)

    states = tell(story, 8.0, look)
    assert states[1:5] == ["wait", "release", "wait", "release"]
    assert "let go too early" in story.events[3].reason
    assert story.outcome == "handed over"


def receive(maps, held_at, seconds=14.0, tug=0.0, before=0.1, aside=0.0, **settings):
    """Run a receive; `held_at(story)`: whether closed fingers hold the object."""
    index = maps[2]
    off = np.linalg.norm(index.T_base_tool[:, :3, 3] - [0.3, 0.2, 0.6], axis=1)
    node = int(off.argmin())
    story, human = story_of(maps, "receive", node=node, before=before, **settings)
    T_object = index.T_base_tool[node] @ story.targets.meet.obj.T_tool_object
    T_object[:3, 3] += aside * index.T_base_tool[node][:3, 1]

    def look(story, now, opened, closed):
        holds = closed and held_at(story)
        T = None if holds else T_object
        force = tug if holds else 0.0  # from the moment of the grasp on
        return sim.StoryFrame(now, human, pulled(force), opened, holds, T)

    return story, tell(story, seconds, look)


def test_what_is_held_out_is_taken_and_kept_where_there_is_no_place(maps):
    story, states = receive(maps, lambda story: True)
    assert states == ["wait", "close", "retreat", "put_down", "kept"]
    assert story.outcome == "handed over" and story.holding
    assert story.planner.attached is not None


def test_what_is_put_between_the_open_fingers_is_taken_without_a_motion(maps):
    story, states = receive(maps, lambda story: True, before=0.0)
    assert states == ["close", "retreat", "put_down", "kept"]
    assert story.outcome == "handed over" and story.events[0].signal == "between"


@pytest.mark.parametrize("pace", [BRAKED, MOVING])
def test_who_creeps_with_the_object_between_the_fingers_closes_them(
    maps, monkeypatch, pace
):
    """Where noise lets it go on for a frame or two at a time it crept for seconds."""
    node = int(np.abs(maps[2].T_base_tool[:, :3, 3] - [0.3, 0.2, 0.6]).sum(1).argmin())
    story, human = story_of(maps, "receive", node=node, before=0.01)
    T = maps[2].T_base_tool[node] @ story.targets.meet.obj.T_tool_object
    story.machine.state, story.offer.reaches._T = "close", T
    story._enter()
    frames = list(range(30))
    creeps = property(lambda self: len(frames) % 5 == 0)
    monkeypatch.setattr(Executor, "at_rest", creeps)
    for name in ("update", "advance"):
        monkeypatch.setattr(Executor, name, lambda *told: None)
    story.executor.state = pace
    while frames.pop():
        now = PERIOD * (30 - len(frames))
        story.update(sim.StoryFrame(now, human, None, True, False, T))
    told = [(e.state, e.signal) for e in story.events]
    assert told == [("close", "between")] * (pace == BRAKED)
    assert story.fingers == ("closed" if pace == BRAKED else "open")


@pytest.fixture
def narrow(monkeypatch):
    """Let the maps have room for an object nowhere but where a wrench is held."""
    fitting, at = Carrier.fitting, handover.wrench().T_tool_object[:3, 3] + [0, 0, 0.05]

    def within(carrier, thing, T):
        if np.abs(T[:3, 3] - at).max() > 0.005:
            raise BadInput("the object needs 0.08 m, and the envelope has 0.07 m")
        return fitting(carrier, thing, T)

    monkeypatch.setattr(Carrier, "fitting", within)
    return at


def test_what_the_map_has_no_room_for_is_not_closed_on(maps, narrow):
    """`update` raised, with the fingers closed on what a person held."""
    for aside, states in ((0.004, ["close"]), (0.008, ["wait", "close"])):
        story, told = receive(maps, lambda story: True, before=0.0, aside=aside)
        assert told[: len(states)] == states and story.outcome == "handed over"
        assert np.abs(story.hand.T_tool_object[:3, 3] - narrow).max() <= 0.005


def test_an_object_that_fits_the_map_by_no_grasp_is_refused_before_the_first_frame(
    maps, narrow
):
    narrow[2] += 0.02
    with pytest.raises(BadInput, match="the object needs 0.08 m"):
        story_of(maps, "receive")


def test_a_planner_that_could_hold_nothing_is_refused_before_the_first_frame(maps):
    """`update` raised, with the fingers closed on the object."""
    story, _ = story_of(maps, "receive")
    told = story.targets, story.executor, sim.StorySettings(direction="receive")
    story.planner.attach(np.array([[0.0, 0.0, 0.1, 0.02]]))
    with pytest.raises(BadInput, match="holds 1 spheres, .*call planner.detach"):
        sim.Handover(story.planner, *told)
    idle = odm.PlannerSettings(finger_pads=("flange",), search=0)
    planner = odm.ReactivePlanner(maps[0], settings=idle)
    with pytest.raises(BadInput, match="search is 0 .*set search to 1000"):
        sim.Handover(planner, *told)


def test_beside_who_may_hurry_the_tests_of_a_stop_know_everybody(maps, monkeypatch):
    """Of those who are not left alone, `PhasePlanner` could not tell who is who."""
    told, leg = [], sim.PhasePlanner.blocked_leg

    def asked(view, path, extra=0.0, points=None):
        told.append((len(points), len(view.classes)))
        return leg(view, path, extra, points)

    def first(test, motion, t, begin, stop, threat):
        return np.arange(len(threat.error)) == 0

    monkeypatch.setattr(sim.PhasePlanner, "blocked_leg", asked)
    monkeypatch.setattr(BrakingTest, "left_behind", first)
    story, _ = receive(maps, lambda story: True, 1.0, threat=ThreatSettings())
    assert not story.executor.quick
    assert told and all(n % k == 0 for n, k in told)


def test_it_waits_before_an_object_with_room_to_spare(maps):
    """8 mm beyond the clearance it crept before it, braked, until its time was up."""
    story, states = receive(maps, lambda story: True, back=0.006)
    assert states == ["wait", "close", "retreat", "put_down", "kept"]
    found, T = story.offer.reaches.found, story.offer.reaches._T
    assert min(reach.room for reach in found) >= story.settings.room == 0.02
    robot = story.planner.robot
    for reach in found:
        T_before = T @ np.linalg.inv(reach.T_tool_object)
        far = np.linalg.norm((T_before - tool_pose(robot, reach.q_before))[:3, 3])
        assert story.settings.back < far < 0.1  # longer, by what its room asks for
    calm = replace(PARTNER, acceleration=0.5)  # else a slow robot asks for more room
    story, _ = story_of(maps, "receive", back=0.006, room=0.0, threat=calm)
    story.offer.reaches.begin(T, found[0].q)
    assert 0.0 < story.offer.reaches.found[0].room < 0.01


def test_ways_that_lack_room_come_last_and_only_where_there_are_no_others(maps):
    story, _ = story_of(maps, "receive")
    T = story.targets.finder.index.T_base_tool[0] @ story.hand.T_tool_object
    look = story.offer.reaches
    rooms = iter([0.004, 0.001, 0.03])
    look._before = lambda T, q: (q, next(rooms, 0.002))
    look._can_come = look._can_leave = lambda *told: True
    look.first(T, story._rest)
    assert [reach.room for reach in look.found] == [0.03]
    look.begin(T, story._rest)
    while not look.over:
        look.work()
    assert look.found and {reach.room for reach in look.found} == {0.002}


def test_a_grasp_at_which_the_hand_itself_is_too_near_is_refused_with_a_remedy(maps):
    story, _ = story_of(maps, "receive")
    planner, capsules = story.planner, story.hand.obj.capsules
    nodes = story.targets.finder.index.nodes
    check_grasps(planner, story.grasps, capsules, nodes)  # the flange is the pad
    told = {"robot": planner.robot, "cover": planner.cover, "extra": 0.0}
    told |= {"settings": SimpleNamespace(finger_pads=())}
    bare = SimpleNamespace(**told, cell_map=planner.cell_map)
    into, far = np.array(story.grasps), np.array(story.grasps)
    into[:, 2, 3], far[:, 2, 3] = 0.03, 0.5
    check_grasps(bare, far, capsules, nodes)
    with pytest.raises(
        BadInput, match=r"flange is -?\d+ mm .* must keep 10 mm.*held_by"
    ):
        check_grasps(bare, into, capsules, nodes)


def test_a_grasp_at_which_the_arm_behind_the_pads_is_too_near_is_refused(maps):
    """A robot without a hand takes with its last link: who is before it is no pad."""
    story, _ = story_of(maps, "receive")
    planner, capsules = story.planner, story.hand.obj.capsules
    nodes = story.targets.finder.index.nodes
    into = np.array(story.grasps)
    into[:, 2, 3] = 0.0
    told = into, capsules, nodes
    with pytest.raises(BadInput, match=r"wrist is -?\d+ mm .* must keep 10 mm"):
        check_grasps(planner, *told)


def test_the_wrench_is_held_as_far_out_as_hand_and_arm_ask_and_no_farther(
    maps, monkeypatch
):
    cell_map, reach, index = maps
    setup = setup_of(cell_map, reach, place=False, pads=["flange"])
    planner = setup.planner()

    spare = grasp_spare(cell_map.robot)  # it takes long to stop
    assert spare > 0.01

    def near(obj, spare=spare):
        grasps = quarter_turns(obj.T_tool_object)
        return too_near(planner, grasps, obj.capsules, index.nodes, spare)

    assert near(story_wrench(), 0.0).link == "wrist" and near(setup.obj) is None
    T = np.array(setup.obj.T_tool_object)
    more = T[2, 3] - story_wrench().T_tool_object[2, 3]
    assert spare < more < 0.06 + spare
    T[2, 3] -= 0.006
    assert near(setup.obj.held_by(T)) is not None
    again = held_farther_out(planner, setup.obj, index.nodes, spare)
    assert again.T_tool_object[2, 3] == setup.obj.T_tool_object[2, 3]
    nearer = setup.obj.held_by(T)
    monkeypatch.setattr(hand_module, "_GRASPING", GraspingSettings(most_out=0.001))
    assert held_farther_out(planner, nearer, index.nodes, spare) is nearer


def test_no_grasp_is_found_whose_straight_motion_the_object_itself_blocks(maps):
    """The arm could not keep its clearance from it: no such motion is ever free."""
    story, _ = story_of(maps, "receive")
    planner, index = story.planner, story.targets.finder.index
    T, found = index.T_base_tool[0], {}
    for out in (0.0, 0.05):
        grasps = np.array(story.grasps)
        grasps[:, 2, 3] += out - 0.05
        grasps = grasps[:1]
        beside = story.hand.obj.capsules, story.settings.room
        look = Reaches(planner, index, grasps, 0.10, None, *beside)
        blind = Reaches(planner, index, grasps, 0.10)
        for one in (look, blind):
            one.begin(T @ grasps[0], story._rest)
            while not one.over:
                one.work()
        assert blind.found
        found[out] = len(look.found)
    assert not found[0.0] and found[0.05]


def test_who_is_to_grasp_is_asked_about_the_grasp_before_the_first_frame(
    maps, monkeypatch
):
    asked = []
    home = "sim.story.handover.check_grasps"
    monkeypatch.setattr(home, lambda planner, grasps, *told: asked.append(grasps))
    story_of(maps, "give")
    assert not asked
    story, _ = story_of(maps, "receive")
    assert np.array_equal(asked[0], story.grasps)
    index = story.targets.finder.index
    near = np.abs(index.T_base_tool[:, :3, 3] - [0.3, 0.2, 0.5]).sum(axis=1).argmin()
    T_place = index.T_base_tool[near] @ story.hand.T_tool_object
    told = story.planner, story.targets, story.executor, sim.StorySettings()
    assert sim.Handover(*told, T_base_place=T_place).fetches and len(asked) == 2
    assert np.array_equal(asked[1], story.grasps)


def test_beside_what_is_held_out_a_stop_keeps_off_it_but_not_by_the_whole_clearance(
    maps,
):
    story, human = story_of(maps, "receive")
    view, q = story.view, story.executor.set_point.q
    T = tool_pose(story.planner.robot, q)
    story.update(sim.StoryFrame(0.0, human, None, T_base_object=FAR @ T))
    robot, m = story.planner.robot, story.planner.cell_map.safety.m
    people, far = human.capsules(), np.array([[0.0, 0.0, 9.0, 0.0, 0.0, 9.0, 0.01]])
    balls = cover_balls(robot, q)[robot.moving]
    tip = balls[np.argmax((balls[:, :3] - T[:3, 3]) @ T[:3, 2] + balls[:, 3])]
    free = {}
    for gap in (0.5 * m - 0.001, 0.5 * m + 0.002, m + 0.005):
        at = tip[:3] + (tip[3] + 0.02 + gap) * T[:3, 2]
        rod = np.array([[*at, *at, 0.02]])
        least = ball_gaps(balls, rod).min()
        assert least == pytest.approx(gap)
        for who, rows in (("object", (people, rod)), ("person", (people, far))):
            rows = np.vstack([rows[0], np.repeat(rows[1], view.offered, axis=0)])
            if who == "person":
                rows[0] = rod
            there = odm.Obstacles(capsules=rows)
            stop = view.blocked_leg(q[None], 0.0, there) is None
            way = view.line_free(q, q, there)
            free[who, round(1e3 * gap)] = stop, way
    assert m == pytest.approx(0.01)
    assert free["object", 4] == free["person", 4] == (False, False)
    assert free["object", 7] == (True, False) and free["person", 7] == (False, False)
    assert free["object", 15] == free["person", 15] == (True, True)


def test_an_object_pushed_against_the_hand_is_left_and_never_pressed(maps):
    """Within its clearance nothing is free but what comes nearer to nothing of it."""
    story, human = story_of(maps, "receive")
    view, q = story.view, story.executor.set_point.q
    T = tool_pose(story.planner.robot, q)
    rod = np.zeros(7)
    rod[:3], rod[3:6] = T[:3, 3] + 0.02 * T[:3, 2], T[:3, 3] + 0.1 * T[:3, 2]
    rod[6] = 0.02
    T_object = T @ story.targets.meet.obj.T_tool_object
    frame = sim.StoryFrame(0.0, human, None, True, False, T_object)
    story.update(frame)  # tells the view who is there, and what is held out
    rows = np.vstack([human.capsules(), np.tile(rod, (view.offered, 1))])
    there, m = odm.Obstacles(capsules=rows), story.planner.cell_map.safety.m
    assert view.separation(q) > 0.2 > story.planner.cell_map.safety.m
    free = {}
    for name, far in (("away", -0.03), ("into it", 0.03)):
        T_end = np.array(T)
        T_end[:3, 3] += far * T[:3, 2]
        end = np.array(story.planner.robot.ik(T_end, q, attempts=1)[0].q)
        path = np.array([q, end])
        free[name] = view.blocked_leg(path, -m, there) is None
        assert view.blocked_leg(path, 0.0, there) is not None  # on any other motion
    assert free == {"away": True, "into it": False}
    rows[0, :6], rows[0, 6] = rod[:6], 0.03  # a part of the person in its place
    path = np.array([q, q])
    assert view.blocked_leg(path, -m, odm.Obstacles(capsules=rows)) == 0


def test_what_is_dropped_before_its_giver_has_let_go_is_told_at_once(maps):
    """It waited for them to let go of what nobody held, and said that they held on."""
    story, states = receive(maps, lambda story: not story.holding, tug=12.0, gone=2.0)
    assert states == ["wait", "close", "retreat", "done"]
    assert story.outcome == "the object was dropped, or taken back"
    assert story.events[2].time_s - story.events[1].time_s < 2.0


def test_a_giver_who_holds_on_gets_it_back(maps):
    def held_at(story):
        return story.fingers == "closed"

    story, states = receive(maps, held_at, wait_s=2.5, tug=12.0, gone=2.0)
    assert states == ["wait", "close", "retreat", "done"]
    assert story.outcome == "the person holds on: it lets go" and not story.holding


@pytest.mark.parametrize("turned", some([0.0, np.pi, 0.5 * np.pi], 2))
@pytest.mark.parametrize("pull", [0.0, 8.0])
def test_who_pulls_at_what_weighs_more_than_that_still_holds_on(maps, turned, pull):
    """A giver's 8 N passed for the weight of 1.5 kg, on any base."""
    index, T_base = maps[2], pose_of((0.0, 0.0, 0.0), (turned, 0.0, 0.0))
    off = np.linalg.norm(index.T_base_tool[:, :3, 3] - [0.3, 0.2, 0.6], axis=1)
    node = int(off.argmin())
    T_object = index.T_base_tool[node] @ handover.wrench().T_tool_object
    told = dict(wait_s=4.0, gone=2.0, kg=1.5, T_world_base=T_base, before=0.0)
    story, human = story_of(maps, "receive", node=node, **told)
    T_object = index.T_base_tool[node] @ story.targets.meet.obj.T_tool_object

    def look(story, now, opened, closed):
        R = (T_base @ tool_pose(story.planner.robot, story.executor.set_point.q))[
            :3, :3
        ]
        force = R.T @ [pull, 0.0, -1.5 * 9.81] if closed else np.zeros(3)
        wrench = np.concatenate([force, np.zeros(3)])
        at = None if closed else T_object
        return sim.StoryFrame(now, human, wrench, opened, closed, at)

    tell(story, 9.0, look)
    assert story.holding is not bool(pull)
    assert story.outcome == (
        "the person holds on: it lets go" if pull else "handed over"
    )


def test_what_is_heavier_than_was_told_is_kept_once_its_giver_has_gone(maps):
    """Its weight was taken for a pull, and it was let go of with nobody there."""

    def held_at(story):
        return story.fingers == "closed"

    story, states = receive(maps, held_at, wait_s=5.0, tug=12.0)
    assert states[:3] == ["wait", "close", "retreat"] and story.holding
    assert story.outcome == "handed over"


@pytest.mark.parametrize("name", ["planner", "targets", "executor", "conduct"])
def test_what_a_story_is_made_of_must_be_that(maps, name):
    story, _ = story_of(maps)
    parts = dict(planner=story.planner, targets=story.targets, executor=story.executor)
    with pytest.raises(BadInput, match=f"^{name} is 'x' .str.; give [A-Z]"):
        sim.Handover(**parts | {name: "x"})
    with pytest.raises(BadInput, match="T_base_place must be an array of real"):
        sim.Handover(**parts, T_base_place="table")
    with pytest.raises(BadInput, match="planner is 'x'"):
        sim.PhasePlanner("x")
    with pytest.raises(BadInput, match="direction is array"):
        sim.StorySettings(direction=np.zeros(2))
    with pytest.raises(BadInput, match="robot"):
        sim.StorySettings.for_robot("panda")


def test_an_object_that_is_dropped_as_it_is_lifted_is_told_at_once(maps):
    """The robot stood, its fingers closed, for the 20 s of `fetch_s`."""
    story, human = at_a_place(maps, "give", FETCH)
    closed_at = []

    def look(story, now, opened, closed):
        taken = story.holding
        closed_at[:] = closed_at or ([now] if taken else [])
        there = closed and not (taken and now > closed_at[0] + 0.1)
        return sim.StoryFrame(now, human, pulled(0.0), opened, there)

    assert tell(story, 12.0, look)[0] == "retreat"
    first = story.events[0]
    assert (first.signal, first.reason) == (
        "lost",
        "the object was dropped as it was lifted",
    )
    assert first.time_s < closed_at[0] + 0.3
    assert story.outcome == first.reason


def test_nothing_held_out_in_reach_ends_in_time(maps):
    story, human = story_of(maps, "receive", wait_s=1.0)

    def look(story, now, opened, closed):
        return sim.StoryFrame(now, human, pulled(0.0), opened)

    assert tell(story, 5.0, look) == ["retreat", "done"]
    assert "nothing was held out" in story.outcome


def test_pads_that_are_none_are_refused_with_those_that_could_be(maps):
    with pytest.raises(BadInput, match=r"finger pads are \['link9'\].*flange"):
        story_of(maps, pads=("link9",))


def test_what_the_robot_is_not_made_to_carry_is_refused_before_the_first_frame(maps):
    story_of(maps, "receive", kg=3.0)
    for direction in ("give", "receive"):
        with pytest.raises(BadInput, match="weighs 3.1 kg, but .* 3 kg at most"):
            story_of(maps, direction, kg=3.1)


def test_no_clock_makes_a_story_late_and_a_late_frame_says_nothing_of_what_lasted(maps):
    story, human = story_of(maps)
    force = [0.0]

    def update(now):
        frame = sim.StoryFrame(now, human, pulled(force[0]), holds=True)
        return story.update(frame)

    begin = 1.7e9  # a clock of seconds since 1970
    for now in (0.0, 0.01, 0.02, 500.0, 500.01, -3.0, np.nan, -2.99, -2.98):
        update(begin + now)
        assert story.state == "approach" and np.isfinite(story._clock["left"])
        leapt = now in (500.0, -3.0) or np.isnan(now)
        assert ("which does not count" in story.reason) == leapt
    force[0] = 30.0
    for now in (-2.5, -2.0, -1.5):  # one frame in half a second is no pull that lasts
        update(begin + now)
    assert 0.0 < story._pull.lasted < 0.1 and not story.events


def in_motion(human, now):
    """Return the person moved along y at 0.3 m/s, and an object that goes with them."""
    T = pose_of((0.0, 0.3 * now, 0.0), (0.0, 0.0, 0.0))
    return human.moved(T @ human.T_world_pelvis), T @ FAR


@pytest.mark.parametrize("rate", [10.0, 30.0])
def test_a_person_whose_tracker_is_slower_than_the_loop_is_followed(maps, rate):
    """Each of its frames comes late and is told several times; some are lost."""
    story, human = story_of(maps, "receive", seen_every_s=1.0 / rate)
    rng, stamps, speeds, next_at = np.random.default_rng(3), [], [], 0.0
    for k in range(150):
        now = PERIOD * k
        if now >= next_at - 1e-9:
            next_at = now + 1.0 / rate
            if not stamps or rng.uniform() > 0.15:
                stamps.append(now - rng.uniform(0.001, 0.009))
        there, T = in_motion(human, stamps[-1])
        if now - stamps[-1] > PERIOD:  # told again, so this is not looked at
            T = T @ pose_of((0.0, 0.0, 0.01), (0.0, 0.0, 0.0))
        story.update(sim.StoryFrame(now, there, T_base_object=T, stamp=stamps[-1]))
        seen, threat, late = story._last, story._last.threat, now - stamps[-1]
        assert (story.answer.status == "holding") >= (late > 0.1)
        if len(stamps) < 4:
            continue
        assert seen.stamp == stamps[-1] and threat.age == pytest.approx(late)
        assert seen.dt == (0.0 if late > 0.1 + 1e-9 else pytest.approx(PERIOD))
        assert threat.known.all() and len(threat.error) > seen.people
        np.testing.assert_allclose(threat.velocity[:, :, 1], 0.3, atol=1e-9)
        speeds.append(seen.object_speed)
    assert len(stamps) < 0.95 * 1.5 * rate
    assert speeds == pytest.approx([0.3] * len(speeds))  # never still between two


def test_what_is_older_than_before_stands_back_and_what_cannot_be_holds(maps):
    story, human = story_of(maps)
    now = 0.0

    def update(stamp, place=0.0):
        there = in_motion(human, place)[0]
        story.update(sim.StoryFrame(now, there, None, holds=True, stamp=stamp))
        return story._last.stamp, story.answer.status == "holding"

    for k in range(20):
        now = PERIOD * k
        assert update(now, now) == (now, False)
    last = now
    now += PERIOD  # an older frame that came late: what was seen last is nearer to now
    assert update(last - 0.03, last - 0.03) == (last, False)
    assert story._last.threat.known.all()
    now = last + 0.3
    for stamp, words in (
        (last, "310 ms old, more than the 100 ms"),
        (np.nan, "stamp of the obstacle data is nan"),
        (now + 1.03, "stamped 1000 ms in the future"),
    ):
        now += PERIOD
        _, held = update(stamp)
        assert held and words in story.reason
        assert story._last.dt == 0.0  # nobody knows where they are: no limit runs
        assert not np.isfinite(story._last.threat.between(0.0, 0.0)[1]) or stamp == last
    with pytest.raises(BadInput, match="stamp"):
        sim.StoryFrame(0.0, human, stamp="now")


def test_a_tracker_that_is_slow_is_given_the_room_of_a_loop_as_slow(maps):
    slow = story_of(maps, period=0.05)[0]._berth
    told = story_of(maps, seen_every_s=0.05)[0]._berth
    assert told.room == slow.room > story_of(maps)[0]._berth.room
    assert story_of(maps, seen_every_s=0.001)[0]._berth.period == PERIOD
    rare = story_of(maps, direction="receive", seen_every_s=0.1)[0]
    assert re.search(r"every 100 ms.*at least \d+ frames", rare.reason)


def test_a_hand_over_beside_a_slow_tracker_is_the_same_story(maps):
    story, human = story_of(maps, seen_every_s=0.04)

    def look(story, now, opened, closed):
        stamp = np.floor(now * 30.0) / 30.0
        force = 12.0 if story.state in ("present", "wait", "release") else 0.0
        sway = pose_of((0.0, 0.01 * np.sin(3.0 * stamp), 0.0), (0.0, 0.0, 0.0))
        there = human.moved(sway @ human.T_world_pelvis)
        if force:
            target = story.targets.meet.best(1)
            there = there.with_arm("right", target[0].arm_q) if target else there
        seen = pulled(force), opened, not opened
        return sim.StoryFrame(now, there, *seen, stamp=min(stamp, now))

    states = tell(story, 20.0, look)
    assert states[-1] == "done" and story.outcome == "handed over"
    assert not any(event.failure for event in story.events)


@pytest.mark.parametrize("wrong", ["nan", "no radius"])
def test_a_person_that_cannot_be_makes_it_stand_until_they_are_seen(maps, wrong):
    story, human = story_of(maps, wait_s=0.6)  # while they are not, no time passes
    bad = np.array(human.capsules())
    bad[3, 2 if wrong == "nan" else 6] = np.nan if wrong == "nan" else -0.1
    speeds = []
    for k in range(110):
        rows = bad if 20 <= k < 90 else human.capsules()
        frame = sim.StoryFrame(PERIOD * k, human, None, holds=True, capsules=rows)
        speeds.append(np.abs(story.update(frame).dq).max())
        age = PERIOD * (k - 19) if 20 <= k < 30 else 0.0
        assert story._last.threat.age == pytest.approx(
            age
        )  # what was seen last stands in
        assert (story.answer.status == "holding") == (30 <= k < 90)
        if k == 89:
            assert "capsule 3 (right hand" in story.reason
    assert speeds[15] > 0.05 and speeds[89] == 0.0 and speeds[-1] > 0.05
    assert not story.events


@pytest.mark.parametrize("holds", [False, True])
def test_an_object_out_of_sight_for_a_moment_counts_where_it_was_seen(maps, holds):
    story, human = story_of(maps, "receive")
    for k in range(25):
        T, closed = (FAR, False) if k < 10 else (None, holds)
        rows = np.full((len(human.labels), 7), np.nan) if closed else None
        seen = human, None, True, closed, T
        story.update(sim.StoryFrame(PERIOD * k, *seen, capsules=rows))
        lately = (
            10 <= k < 20 and not holds
        )  # what the fingers closed on is nowhere else
        assert (story._last.obj is not None) == (k < 10 or lately)
        assert holds or ("is not seen" in story.reason) == (k >= 20)


def test_a_frame_of_another_shape_is_refused_by_name_and_lists_are_arrays(maps):
    human = handover.Human()
    rows = human.capsules()
    refused = (
        ("wrench", dict(wrench=np.zeros(3))),
        ("wrench", dict(wrench="12 N")),
        ("human", dict(human=None)),
        ("now", dict(now="3")),
        ("now", dict(now=10**400)),
        ("wrench", dict(wrench=10**400)),
        ("opened is nan", dict(opened=np.nan)),  # counted as open, and as holding
        ("holds is None", dict(holds=None)),
        ("labels must be an array of real", dict(capsules=rows, labels=[[1], [1, 2]])),
        ("capsules", dict(capsules=rows[:, :6])),
        ("5 capsules and 15 labels", dict(capsules=rows[:5])),
        ("2 labels", dict(labels=[0, 1])),
        ("T_base_object", dict(T_base_object=np.eye(4)[:3])),
        ("T_base_object", dict(T_base_object=np.zeros((4, 4)))),
        ("T_base_object", dict(T_base_object=np.diag([1.0, 1.0, -1.0, 1.0]))),
    )
    for words, told in refused:
        with pytest.raises(BadInput, match=words):
            sim.StoryFrame(**(dict(now=0.0, human=human) | told))
    lists = dict(capsules=rows.tolist(), labels=human.labels.tolist(), wrench=[0] * 6)
    rounded = pose_of((0.3, 0.2, 0.1), (0.1, 0.2, 0.3)) + 1e-4 * np.eye(4, k=1)
    told = dict(T_base_object=rounded.tolist(), **lists)
    T = sim.StoryFrame(0, human, **told).T_base_object
    assert np.abs(T[:3, :3] @ T[:3, :3].T - np.eye(3)).max() < 1e-12
    assert 0.0 < np.abs(T - rounded).max() < 2e-4
    frame = sim.StoryFrame(0.0, human, T_base_object=np.full((4, 4), np.nan))
    assert frame.T_base_object is None
    story, _ = story_of(maps)
    with pytest.raises(BadInput, match="frame is None"):
        story.update(None)
    with pytest.raises(BadInput, match="measured q has shape"):
        story.update(sim.StoryFrame(0.0, human, q=np.zeros(6 + story.view.robot.dof)))


def test_who_tells_of_a_sensors_noise_sees_speeds_through_it(maps):
    known = {}
    for noise in (0.0, 0.003):
        threat = ThreatSettings(noise=noise)
        story, human = story_of(maps, "receive", threat=threat)
        rng = np.random.default_rng(1)
        for k in range(30):
            T = pose_of((0.5, 0.2, 0.4) + rng.normal(0.0, 1e-3, 3), (0.0, 0.0, 0.0))
            frame = sim.StoryFrame(PERIOD * k, human, T_base_object=T)
            story.update(frame)
        threat = story._last.threat
        known[noise] = bool(threat.known[-1])
    assert known == {0.0: False, 0.003: True}
    assert np.abs(threat.velocity[-1]).max() < 0.1


def test_while_no_place_is_known_it_says_so_and_names_no_call(maps):
    story, human = story_of(maps)
    there = odm.Obstacles(capsules=np.array(human.capsules()))
    story.answer = story.planner.step(there, q=story.executor.set_point.q)
    assert "set_goals" in story.answer.reason
    assert story.reason == "no place within reach of both is known"
    story.answer = SimpleNamespace(status="following")  # to its place of rest
    pursuit = story.targets.pursuit
    for now, words in (
        (dict(), "no place within reach of both is known"),
        (dict(missing_m=0.42), "they are 0.42 m too far away"),
        (dict(state="blocked", targets=7), "no way to a place within the person's"),
        (dict(key=3), ""),
    ):
        story.targets.pursuit = replace(pursuit, **now)
        assert words in story.reason and bool(words) == bool(story.reason)


def test_what_is_held_out_where_it_cannot_be_grasped_is_told(maps):
    story, human = story_of(maps, "receive")
    for k in range(10):
        story.update(sim.StoryFrame(PERIOD * k, human, T_base_object=FAR))
        assert story.reason.endswith("found yet")  # it is still looked for
    while not story.offer.reaches.over:
        story.offer.reaches.work()
    assert story.reason.startswith("no way to grasp what is held out")
    assert story.reason.endswith("was found")


@pytest.mark.parametrize("found", [True, False])
def test_where_no_grasp_was_found_a_small_move_is_reason_to_look_again(maps, found):
    offer = story_of(maps, "receive")[0].offer
    offer.reaches.begin(FAR, offer.view.robot.lower)
    offer.reaches._queue, offer.reaches.found = [], [None] * found
    assert not offer.moved(FAR @ pose_of((0.0, 0.003, 0.0), (0.0, 0.0, 0.0)))
    assert offer.moved(FAR @ pose_of((0.0, 0.006, 0.0), (0.0, 0.0, 0.0))) != found
    assert offer.moved(FAR @ pose_of((0.0, 0.03, 0.0), (0.0, 0.0, 0.0)))


def test_a_measured_q_that_fails_once_and_is_then_missing_holds_for_that_frame(maps):
    story, human = story_of(maps)

    def update(k, q):
        seen = sim.StoryFrame(PERIOD * k, human, pulled(0.0), False, True, q=q)
        return story.update(seen)

    at_rest = update(0, None).q
    update(1, np.full_like(at_rest, np.nan))
    assert "nobody knows where it is" in story.reason
    for k in range(2, 150):
        update(k, None)
    assert "nobody knows" not in story.reason
    assert np.abs(story.executor.set_point.q - at_rest).max() > 0.1


def test_an_object_that_no_motion_leads_to_is_given_up_after_some_tries(
    maps, monkeypatch
):
    monkeypatch.setattr(sim.PhasePlanner, "line_free", lambda *told: False)
    story, states = receive(maps, held_at=0.0, seconds=30.0, tries=2, blocked_s=0.2)
    assert states.count("close") == 2 and states[-1] == "done"
    assert story.outcome == "no way to the object is free: it gives up"
    assert not story.holding


def test_an_object_that_turned_out_of_the_straight_motion_is_looked_at_anew(
    maps, monkeypatch
):
    begin, moved_to, begun, asked = Reaches.begin, Reaches.moved_to, [], []

    def counted(reaches, T, q):
        begun.append(T)
        begin(reaches, T, q)

    def turned(reaches, reach, T):  # for what was found before
        asked.append(len(begun))
        return None if asked[-1] == asked[0] else moved_to(reaches, reach, T)

    monkeypatch.setattr(Reaches, "begin", counted)
    monkeypatch.setattr(Reaches, "moved_to", turned)
    story, states = receive(maps, lambda story: True, tries=3, blocked_s=0.2)
    assert states.count("close") == 2 and len(begun) > asked[0]
    assert story.holding and states[-1] == "kept"


def test_a_grasp_whose_motion_to_the_object_is_free_is_gone_to_first(maps, monkeypatch):
    story, _ = story_of(maps, "receive")
    q = story.executor.set_point.q
    found = [Reach(q + off, q + off, np.eye(4)) for off in (0.1, 0.6, 1.2)]
    story.offer.reaches.found, story.offer.reaches._T = found, FAR
    story.offer.reaches._queue = []
    free = [False, True, False]

    def line_free(view, begin, end, there):
        assert view.phase == "receive" and (view.classes[-1:] == odm.OBJECT).all()
        return free[[r.q is end for r in found].index(True)]

    monkeypatch.setattr(sim.PhasePlanner, "line_free", line_free)
    monkeypatch.setattr(Reaches, "is_ready", lambda self, goal: True)
    set_to = []
    monkeypatch.setattr(
        type(story), "_set_goals", lambda self, goals: set_to.append(goals)
    )
    human = handover.Human().placed(4.0, 0.0, np.pi)
    for k in range(8):  # it looks at one of them in every second frame
        if k == 7:
            free[:] = True, False, False
        seen = sim.StoryFrame(PERIOD * k, human, pulled(0.0), True, False, FAR)
        story.update(seen)
    assert set_to[0][0] is found[0].q_before
    assert set_to[6][0] is found[1].q_before and view_is_plain(story)


def test_the_arm_that_takes_is_no_reason_to_evade_but_what_evades_stops_for_it(
    maps, monkeypatch
):
    """A robot that got out of somebody's way was touched by the arm that takes."""
    story, human = story_of(maps)
    told = []

    def update(executor, answer, commit, threat):
        told.append((threat, story.view.meant, story.view.classes))

    monkeypatch.setattr(type(story.executor), "update", update)
    for state in (WAIT, RELEASE):
        story.machine.state = state
        story._enter()
        story.update(
            sim.StoryFrame(PERIOD * len(told), human, pulled(0.0), False, True)
        )
        threat, meant, classes = told[-1]
        assert story.view.phase == "give"
        assert len(threat.error) == len(classes) == len(human.labels)
        assert np.array_equal(
            human.labels[meant], human.labels[story.sight.parts(human.labels)[1]]
        )
        touchable = human.labels[classes == odm.CONTACT]
        assert set(touchable) == {handover.Part.RIGHT_HAND} and len(meant) > 1


def test_pads_evade_an_object_that_is_carried_past_but_not_one_put_between_them(maps):
    """A quick hand went through a flange, which may touch its object, into the arm."""
    story, human = story_of(maps, "receive")
    view, q = story.view, story.executor.set_point.q
    T = tool_pose(story.planner.robot, q)
    hurried = []
    for speed in (0.1, 0.3):
        for k in range(15):
            now = PERIOD * (len(hurried) * 100 + k)
            there = FAR @ pose_of((speed * PERIOD * k, 0.0, 0.0), (0.0, 0.0, 0.0))
            seen = sim.StoryFrame(now, human, pulled(0.0), True, False, there)
            story.update(seen)
        hurried.append(view.hurries)
    assert hurried == [False, True]
    n = len(view.classes)
    rows = np.tile(human.capsules()[:1], (n, 1))
    rows[:, [0, 3]] += 9.0
    tip = T[:3, 3] + 0.02 * T[:3, 2]
    rows[-view.offered :] = [*tip, *tip, 0.02]
    for hurries in (False, True):
        view.hurries = hurries
        assert view.is_met(q[None], -0.002, odm.Obstacles(capsules=rows)) == hurries


def test_a_motion_that_could_not_be_tested_leaves_the_phase_as_it_was(
    maps, monkeypatch
):
    story, human = story_of(maps, "receive")
    q = story.executor.set_point.q
    update = story.update
    update(sim.StoryFrame(0.0, human, pulled(0.0), True, False, FAR))
    classes = story.view.classes

    def line_free(view, begin, end, there):
        raise KeyboardInterrupt

    monkeypatch.setattr(sim.PhasePlanner, "line_free", line_free)
    with pytest.raises(KeyboardInterrupt):
        story.offer.look_along(story._last, [Reach(q, q, np.eye(4))])
    assert story.view.classes is classes and view_is_plain(story)


def view_is_plain(story):
    return story.view.phase is None and (story.view.classes == odm.AVOID).all()


def test_an_object_that_does_not_fit_in_where_the_robot_stands_is_refused(maps):
    story, _ = story_of(maps)
    planner, targets, executor = story.planner, story.targets, story.executor
    planner.detach()
    told = planner, targets, executor, story.settings
    rod = odm.Cylinder(0.02, 3.0, pose_of((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
    with pytest.raises(BadInput, match="does not fit in .* would touch .* another"):
        sim.Handover(*told, thing=rod)
    assert planner.attached is None
    assert sim.Handover(*told).holding


def test_what_is_held_against_a_link_does_not_keep_it_from_evading_the_person(maps):
    """The shells test the person alone: else no motion passed beside such an object."""
    story, _ = story_of(maps, "receive")
    view, executor, robot = story.view, story.executor, story.planner.robot
    q, audit = executor.set_point.q, exact_audit(robot)
    T = tool_pose(robot, q)

    def ball(gap):
        """Return a ball in front of the tool at an exact distance of its solids."""
        far = np.arange(-0.1, 0.3, 5e-4)
        places = [T[:3, 3] + f * T[:3, 2] for f in far]
        rows = [np.array([*p, *p, 0.02]) for p in places]
        gaps = np.array([audit(q, row[None]) for row in rows])
        return rows[int(np.flatnonzero(gaps < gap)[-1]) + 1]

    near, against = ball(0.012), ball(-0.01)
    balls = cover_balls(robot, q)[robot.moving]
    assert ball_gaps(balls, near[None]).min() < executor.settings.yield_gap
    T_end = np.array(T)
    T_end[:3, 3] -= 0.03 * T[:3, 2]
    path = np.array([q, robot.ik(T_end, q, attempts=1)[0].q])
    motion = time_path(robot, path, blend=0, speed_scale=0.2)
    free = {}
    for name, rows in (
        ("object", [near, against]),
        ("nobody holds it", [near, near]),
        ("person", [against, near]),
    ):
        view.classes, view.offered = np.zeros(2, np.int8), 1
        still = np.zeros((2, 2, 3)), np.zeros(2), 0.0, ThreatSettings()
        threat = Threat(np.array(rows), *still)
        free[name] = executor._evasion_free(motion, 0.0, threat)
    assert free == {"object": True, "nobody holds it": True, "person": False}
    into = time_path(robot, np.array([q, 2 * q - path[1]]), blend=0, speed_scale=0.2)
    far = np.array([*near[:6] + 5.0, 0.02])
    threat = Threat(np.array([far, against]), *still)
    assert not executor._evasion_free(into, 0.1, threat)
    assert executor._evasion_free(motion, 0.1, threat)


def test_a_robot_that_takes_long_to_stop_keeps_more_from_the_person_and_says_so(maps):
    cell_map, reach, index = maps
    robot = cell_map.robot
    quick = replace(robot, max_acceleration=20 * robot.max_acceleration)
    quick = replace(quick, max_jerk=1000 * robot.max_jerk)
    assert slow_to_stop(quick) == "" and grasp_spare(quick) == 0.0
    assert re.search(r"stop even from its slowest.*\[robot\]", slow_to_stop(robot))
    setup = setup_of(cell_map, reach, place=False, pads=["flange"])
    spare = []
    for one in (robot, quick):
        planner = setup.planner()
        planner.robot = one
        targets = setup.targets(planner, handover.Human().placed(0.9, 0.0, np.pi))
        spare.append(targets.settings.spare_m)
    assert spare[0] > 0.015 and spare[1] == LIVE.spare_m


def test_nothing_is_handed_over_below_the_table(maps):
    """Of who sits at it the best places were below, and no other was looked at."""
    setup = setup_of(*maps[:2], place=False, pads=["flange"])
    table = parse_scenery(({"type": "plane", "normal": [0, 0, 1], "offset": 0.0},))
    setup = replace(setup, cell_map=replace(maps[0], scenery=table))
    sits = StoryCase(base_height=BASE_HEIGHT + 0.4).body()
    found = setup.meet(sits).best(40)
    rods = [moved_rods(setup.obj.capsules, one.T_world_object) for one in found]
    assert found and all((r[:, [2, 5]] > r[:, 6:]).all() for r in rods)


def test_what_was_guessed_of_a_recording_is_told_before_it_is_played(maps):
    setup = setup_of(*maps[:2], place=False, pads=["flange"])
    ends = SimpleNamespace(notes=("taken as cm",), ending=lambda s: f"{s} s are more")
    story = SimpleNamespace(settings=sim.StorySettings())
    for person, told in ((ends, ["taken as cm", "30.0 s are more"]), (None, [])):
        partner = SimpleNamespace(person=person)
        run = SimpleNamespace(case=StoryCase(), partner=partner, story=story)
        said = said_before(setup, run, "forces", 30.0).splitlines()
        assert said[0].endswith("give: forces") and said[1 : 1 + len(told)] == told


def test_what_a_story_assumes_of_the_person_says_how_much_it_keeps(maps):
    cell_map, reach, _ = maps
    robot = cell_map.robot
    quick = replace(robot, max_acceleration=20 * robot.max_acceleration)
    quick = replace(quick, max_jerk=1000 * robot.max_jerk)
    setup = setup_of(cell_map, reach, place=False, pads=["flange"])
    human = handover.Human().placed(0.9, 0.0, np.pi)
    spare = []
    for threat in (
        PARTNER,
        replace(PARTNER, acceleration=9.0),
        replace(PARTNER, noise=0.003),
    ):
        story = new_story(setup, sim.StorySettings(threat=threat), human)
        spare.append(story.targets.settings.spare_m)
    assert spare[1] > 2.0 * spare[0] and spare[2] > spare[0] + 0.003
    most = sim.StorySettings(threat=ThreatSettings(acceleration=1e4))
    assert new_story(setup, most, human).targets.settings.spare_m == 1.0
    sensor = slow_to_stop(quick, replace(PARTNER, noise=0.01))
    assert re.search(r"wrong by up to 10 mm.*better sensor", sensor)
    thrust = slow_to_stop(quick, replace(PARTNER, acceleration=100.0))
    assert "sensor" not in thrust and "[robot]" in thrust


@pytest.mark.parametrize("fingers", ["open", "closed"])
def test_who_holds_on_is_told_apart_from_who_never_held_it_still(maps, fingers):
    story, human = story_of(maps, "receive", wait_s=0.2)
    story.machine.state, story.hand.fingers = "close", fingers
    story.offer.reaches._T = FAR  # it is where its grasps are for
    for k in range(30):
        story.update(sim.StoryFrame(PERIOD * k, human, None, False, True, FAR))
    assert story.events[0].signal == {"open": "ungripped", "closed": "late"}[fingers]


@pytest.mark.parametrize("pace", ["slowed", "braked", "moving"])
def test_who_was_slowed_for_the_person_until_the_time_was_over_says_so(
    maps, monkeypatch, pace
):
    story, human = story_of(maps, wait_s=0.5)
    monkeypatch.setattr(type(story.executor), "update", lambda *told: None)
    monkeypatch.setattr(story.executor, "state", pace)
    for k in range(60):
        story.update(sim.StoryFrame(PERIOD * k, human, pulled(0.0), False, True))
    event = next(e for e in story.events if e.failure)
    hindered = pace != "moving"
    assert event.signal == ("hindered" if hindered else "taken_up")
    assert ("slowed for the person" in event.reason) == hindered


def test_a_robot_slow_to_stop_passes_the_person_with_as_much_room_where_it_can(maps):
    story, human = story_of(maps)
    berth = story._berth
    how = story.executor.settings, PERIOD, PARTNER
    comes = slowest_stop(maps[0].robot, *how)
    assert berth.room == comes[1] > 0.015
    told, step = [], story.planner.step

    def stepped(there, **more):
        told.append(there.capsules[:, 6] - human.obstacles().capsules[:, 6])
        return step(there, **more)

    story.planner.step = stepped
    for k in range(3):
        story.update(sim.StoryFrame(PERIOD * k, human, pulled(0.0), False, True))
    assert np.allclose(told, berth.room)
    assert story.targets.told_larger == berth.room


def test_what_is_offered_keeps_what_it_should_once_and_not_twice(maps):
    story, human = story_of(maps)
    targets = story.targets
    targets.settings = replace(targets.settings, spare_m=0.03)
    for larger, left in ((0.0, 0.03), (0.02, 0.01), (0.05, 0.0)):
        targets.told_larger = larger
        targets._choose([], [], None)
        assert targets.offers.spare_m == pytest.approx(left)


@pytest.mark.parametrize("direction", ["give", "receive"])
def test_who_is_still_on_the_way_when_the_time_is_over_says_so(
    maps, monkeypatch, direction
):
    for moves in (True, False):
        story, human = story_of(maps, direction, wait_s=0.05)
        monkeypatch.setattr(type(story.executor), "at_rest", not moves)
        story.targets.pursuit = replace(story.targets.pursuit, key=3)
        monkeypatch.setattr(story.targets, "note", lambda *told: None)
        q = story.executor.set_point.q
        monkeypatch.setattr(story.offer, "taken", SimpleNamespace(q=q, q_before=q))
        monkeypatch.setattr(story.offer, "_far", lambda *told: 0.0)
        for name in ("update", "advance"):
            monkeypatch.setattr(type(story.executor), name, lambda *told: None)
        monkeypatch.setattr(story, "_signals_of_place", lambda *told: {})
        for k in range(8):
            give = direction == "give"
            seen = (human, pulled(0.0), not give, give)
            story.update(sim.StoryFrame(PERIOD * k, *seen))
        event = next(e for e in story.events if e.failure)
        assert event.signal == ("under_way" if moves else "late")
        assert ("its way took longer" in event.reason) == moves


@pytest.mark.parametrize("state", ["blocked", "no target"])
def test_somebody_who_is_in_reach_and_in_the_way_is_not_said_to_have_stayed_away(
    maps, monkeypatch, state
):
    story, human = story_of(maps, wait_s=0.1)
    told = replace(story.targets.pursuit, state=state, targets=state == "blocked")
    story.targets.pursuit = told
    monkeypatch.setattr(story.targets, "note", lambda *_: None)
    for k in range(20):
        seen = human, pulled(0.0), False, True
        story.update(sim.StoryFrame(PERIOD * k, *seen))
    event = next(e for e in story.events if e.failure)
    assert event.signal == ("taken_up" if state == "blocked" else "late")
    assert ("nobody came" in event.reason) == (state != "blocked")


@pytest.mark.parametrize("known", [True, False])
def test_what_was_held_out_in_reach_is_not_said_to_have_been_out_of_it(
    maps, monkeypatch, known
):
    story, human = story_of(maps, "receive", wait_s=0.1)
    monkeypatch.setattr(story, "_plan", lambda *_: SimpleNamespace(**HOLDS))
    if known:
        story.offer.reaches.found, story.offer.reaches._T = [None], FAR
    for k in range(13):
        seen = human, pulled(0.0), True, False, FAR
        story.update(sim.StoryFrame(PERIOD * k, *seen))
    event = next(e for e in story.events if e.failure)
    assert event.signal == ("taken_up" if known else "late")
    assert ("nothing was held out" in event.reason) != known


@pytest.mark.parametrize("wrench", [None, np.full(6, np.nan), np.zeros(6)])
def test_without_a_force_at_the_wrist_it_is_told_that_no_pull_could_be_felt(
    maps, wrench
):
    story, human = story_of(maps, wait_s=0.3)
    story.machine = Machine(TABLES["give"], "wait")
    story._enter()
    for k in range(40):
        told = dict(opened=False, holds=True, wrench=wrench)
        story.update(sim.StoryFrame(PERIOD * k, human, **told))
    measured = wrench is not None and np.isfinite(wrench).all()
    first = story.events[0]
    assert first.state == PUT_DOWN and first.failure
    assert first.signal == ("late" if measured else "unfelt")
    assert ("no force at the wrist" in first.reason) == (not measured)


@pytest.mark.parametrize("pull", [0.0, 8.0, 25.0])
def test_a_pull_that_is_too_weak_to_count_is_told_with_what_to_do(maps, pull):
    story, human = story_of(maps, wait_s=0.6, gone=2.0)
    said = []
    for k in range(120):
        q = story.executor.set_point.q
        weight = tool_pose(story.planner.robot, q)[2, :3] * -9.81 * 0.25
        force = weight + [0.0, pull if k else 0.0, 0.0]
        if k == 40:
            story.machine = Machine(TABLES["give"], "wait")
            story._enter()
            story.machine.since = PERIOD * k
        wrench = np.concatenate([force, np.zeros(3)])
        if k < 40:  # the robot still moves
            story._pull.feel(wrench, PERIOD, True, own=weight)
            continue
        told = dict(opened=False, holds=True, wrench=wrench)
        story.update(sim.StoryFrame(PERIOD * k, human, **told))
        said.append(story.reason)
    spoken = [s for s in said if "somebody pulls with" in s]
    assert bool(spoken) == (pull == 8.0)
    first = story.events[0]
    if pull == 8.0:
        numbers = re.search(r"pulls with (.+) N, less than the (.+) N", spoken[-1])
        felt, counts = map(float, numbers.groups())
        assert felt == pytest.approx(8.0) and counts == pytest.approx(12.0, abs=0.2)
        assert "PullSettings(force=...)" in spoken[0] and "mass_kg" in spoken[0]
        assert first.signal == "weak_pull" and "too weakly" in first.reason
    else:
        assert first.signal == ("pulled" if pull else "late")


def test_two_pulls_between_which_no_force_is_measured_are_not_one(maps):
    story, human = story_of(maps)
    story.machine = Machine(TABLES["give"], "wait")
    story._enter()
    for k in range(80):
        wrench = pulled(12.0 if k >= 20 else 0.0)
        wrench = None if 40 <= k < 65 else wrench
        told = dict(opened=False, holds=True, wrench=wrench)
        story.update(sim.StoryFrame(PERIOD * k, human, **told))
        assert k < 40 or wrench is not None or not story._pull.pulls
    assert not story.events
