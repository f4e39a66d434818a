"""A tracker that shows somebody no more: they stay where they were, for a while."""

import numpy as np
import pytest
from own_story import PERIOD, at_a_place, pulled, story_of

import sim
from handover.human.body import ARM_LABELS
from roadmap.geometry.gaps import ball_gaps
from roadmap.kinematics.forward import cover_balls, tool_pose
from sim.story.machine import FETCH

HAND = ARM_LABELS["right"][0]
NOBODY = dict(capsules=np.zeros((0, 7)), labels=np.zeros(0, int))


def drive(story, human, seconds, shown):
    """Run a story; `shown(k)` is who is seen in a frame. Return all q (n, dof)."""
    path = []
    for k in range(int(seconds / PERIOD)):
        frame = sim.StoryFrame(PERIOD * k, human, pulled(0.0), True, False, **shown(k))
        path.append(story.update(frame).q)
    return np.array(path)


@pytest.mark.parametrize("lost_s", [0.3, 1.5])
def test_the_robot_does_not_go_to_where_somebody_was_seen_last(maps, lost_s):
    story, human = at_a_place(maps, "give", FETCH)
    alone = drive(story, human, 0.8, lambda k: NOBODY)
    robot = story.planner.robot
    begin, end = (tool_pose(robot, q)[:3, 3] for q in (alone[0], alone[-1]))
    assert np.linalg.norm(end - begin) > 0.3  # it goes to the place
    hand = np.array([[*end, *end, 0.05]])
    there = dict(capsules=hand, labels=np.array([HAND]))
    seen = 10

    def shown(k):  # seen for 0.1 s, then hidden, again and again
        return there if k % (seen + round(lost_s / PERIOD)) < seen else NOBODY

    story, human = at_a_place(maps, "give", FETCH)
    path = drive(story, human, 8.0, shown)
    moves = np.abs(np.diff(path, axis=0)).max(axis=1) > 1e-6
    for q in path[1:][moves]:
        assert ball_gaps(cover_balls(robot, q), hand).min() > 0.0


def test_who_is_not_seen_is_looked_for_and_then_gone(maps):
    story, human = story_of(maps)
    look, conduct = story.sight.look, story.conduct
    rows, labels = human.capsules(), np.array(human.labels)
    hand = labels == HAND
    for k in range(5):
        seen = look(sim.StoryFrame(0.01 * k, human), 0.01)
    before = seen.hands
    no_hand = dict(capsules=rows[~hand], labels=labels[~hand])
    widths = []
    for now in (0.09, 0.2, 1.0, 2.03):
        seen = look(sim.StoryFrame(now, human, **no_hand), 0.1)
        assert np.array_equal(seen.hands, before) and seen.dt > 0.0
        reach, more = seen.threat.between(0.0, 0.0)
        widths.append(float(reach.capsules[: seen.people][seen.hand, 6].max()))
        fresh = now - 0.04 <= story.planner.settings.max_age_s
        told = seen.there.labels["capsules"][int(seen.hand[0])]
        assert told.startswith("unseen ") != fresh and (seen.stamp == now) != fresh
        assert sum("unseen" in word for word in seen.there.labels["capsules"]) < 2
    assert np.all(np.diff(widths) > 0.0)
    passed = 2.03 - 0.04
    assert widths[-1] >= before[0, 6] + story.settings.threat.speed * passed - 1e-9
    seen = look(sim.StoryFrame(0.04 + conduct.missing_s + 0.01, human, **no_hand), 0.1)
    assert not len(seen.hands) and len(seen.person) == int((~hand).sum())


def test_a_pull_may_be_of_a_hand_that_is_not_seen(maps):
    """It was far from the object when it was seen last, and may have come since."""
    story, human = story_of(maps, before=0.0)
    T = tool_pose(story.planner.robot, story.executor.set_point.q)
    T = T @ story.hand.T_tool_object
    place = T[:3, 3] + [0.0, 0.6, 0.0]
    rows = np.array([[*place, *place, 0.05]])
    parts = dict(capsules=rows, labels=np.array([HAND]), T_base_object=T, holds=True)
    seen = story.sight.look(sim.StoryFrame(0.0, human, **parts), 0.01)
    assert story._is_far(seen)
    parts |= NOBODY
    assert story._is_far(story.sight.look(sim.StoryFrame(0.05, human, **parts), 0.01))
    seen = story.sight.look(sim.StoryFrame(0.4, human, **parts), 0.01)
    assert len(seen.hands) == 1 and not story._is_far(seen)
