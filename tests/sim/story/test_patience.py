"""A slow robot may take longer; a quick one is told what it was told before."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from odm import load_map
from odm.execution.threat import ThreatSettings
from sim.story import settings as own
from sim.story.play import StoryPlay, StoryResult
from sim.story.request import LASTS_S, DemoRequest
from sim.story.settings import PARTNER, StorySettings, patience_with


@pytest.fixture(scope="module")
def robot(meet_maps):
    return load_map(meet_maps[0]).robot


def slowed(robot, speed):
    return replace(robot, max_velocity=np.full(robot.dof, speed))


def test_a_quick_robot_has_the_usual_patience(robot):
    assert patience_with(robot) == patience_with(slowed(robot, own.QUICK_TURN)) == 1.0
    assert StorySettings.for_robot(robot) == StorySettings()


@pytest.mark.parametrize(("speed", "times"), [(1.0, 2.0), (0.8, 2.5), (0.1, 4.0)])
def test_a_slow_one_gets_so_much_longer(robot, speed, times):
    slow, usual = slowed(robot, speed), StorySettings()
    assert patience_with(slow) == pytest.approx(times)
    found = StorySettings.for_robot(slow, direction="receive", fetch_s=7.0)
    assert found.wait_s == pytest.approx(times * usual.wait_s)
    assert found.place_s == pytest.approx(times * usual.place_s)
    assert found.put_down_s == pytest.approx(times * usual.put_down_s)
    assert found.fetch_s == 7.0 and found.direction == "receive"
    assert found.again_s == usual.again_s and found.grip_s == usual.grip_s


def test_one_slow_joint_of_many_makes_no_slow_robot(robot):
    speeds = robot.max_velocity.copy()
    speeds[0] = 0.1
    assert patience_with(replace(robot, max_velocity=speeds)) == 1.0


def test_a_demo_lasts_so_much_longer_where_no_time_was_asked_for():
    assert DemoRequest("handover").lasts(2.5) == 2.5 * LASTS_S
    assert DemoRequest("handover", seconds=8.0).lasts(2.5) == 8.0


def test_a_story_is_played_with_the_patience_of_its_robot(monkeypatch):
    asked = []

    class Stop(Exception):
        pass

    def settings(robot, **more):
        asked.append((robot, more))
        raise Stop

    monkeypatch.setattr(StorySettings, "for_robot", settings)
    from sim.story.play import StoryCase as Case

    setup = type("Setup", (), {})()
    setup.cell_map = type("Map", (), {"robot": "slow"})()
    with pytest.raises(Stop):
        StoryPlay(setup, Case("receive"))
    with pytest.raises(Stop):  # of a recorded person nobody knows that they are calm
        StoryPlay(setup, Case("give"), partner=object())
    told = [{"direction": "receive", "threat": PARTNER}]
    told += [{"direction": "give", "threat": ThreatSettings()}]
    assert asked == [("slow", one) for one in told] and PARTNER != ThreatSettings()


def test_a_step_of_the_velocity_is_beyond_the_limits(robot):
    """Twice the limit in the mean of a frame, of which no told acceleration says."""
    run = StoryPlay.__new__(StoryPlay)
    run.planner, run.result = SimpleNamespace(robot=robot), StoryResult(None, True)
    still = run._dq = run._ddq = np.zeros(robot.dof)
    run._note_limits(SimpleNamespace(dq=0.009 * robot.max_acceleration, ddq=still))
    assert run.result.beyond == 0 and run.result.acceleration == pytest.approx(0.9)
    run._note_limits(SimpleNamespace(dq=0.029 * robot.max_acceleration, ddq=still))
    assert run.result.beyond == 1 and run.result.acceleration == pytest.approx(2.0)
