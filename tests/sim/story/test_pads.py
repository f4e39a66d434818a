"""`--pads`: which links may touch an object, whatever their names are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from roadmap import load_robot
from roadmap.errors import BadInput
from sim.bench import view as view_bench
from sim.bench.handover import story as story_bench
from sim.people.partner import Partner
from sim.record import write_record
from sim.story.cases import StoryCase, pads_of, setup_of
from sim.story.handover import Handover
from sim.story.play import StoryPlay
from sim.story.record import StoryRecorder, play_again, same
from sim.story.request import DemoRequest

BALL = '<collision><geometry><sphere radius="0.02"/></geometry></collision>'


def test_a_robot_without_fingers_is_told_of_pads_and_of_its_links(maps):
    with pytest.raises(BadInput, match=r"--pads LINK`, of .*flange"):
        setup_of(*maps[:2])
    with pytest.raises(BadInput, match=r"--pads link9.* no such link.*flange"):
        setup_of(*maps[:2], pads=["flange", "link9"])
    setup = setup_of(*maps[:2], pads=["flange"])
    assert setup.planner().settings.finger_pads == ("flange",)


def test_a_map_used_far_from_its_urdf_is_told_before_any_reach_map(odm, maps, tmp_path):
    """The grasp of an object of one's own is found by the gripper as in its URDF."""
    recipe = maps[0].recipe
    away = replace(recipe, robot=replace(recipe.robot, source="gone/arm.urdf"))
    folder = replace(maps[0], recipe=away).save(tmp_path / "away")
    trimesh.creation.box((0.05, 0.05, 0.1)).export(tmp_path / "box.stl")
    words = ("--map", folder, "--object", tmp_path / "box.stl", "--pads", "flange")
    code, _, error = odm("demo", "handover", *words, "--reach", tmp_path / "reach")
    assert code == 2 and "gone/arm.urdf" in error and "change to the folder" in error
    assert not (tmp_path / "reach").exists()


def test_the_command_takes_pads_and_only_of_a_hand_over(odm, meet_maps, tmp_path):
    words = ("demo", "handover", "--map", meet_maps[0], "--reach", meet_maps[1])
    for pads, told in [((), "--pads LINK"), (("--pads", "nail"), "--pads nail")]:
        code, _, error = odm(*words, *pads, "--out", tmp_path)
        assert code == 2 and told in error and "flange" in error
    with pytest.raises(BadInput, match="--pads goes with `odm demo handover`"):
        DemoRequest(pads=["flange"])


def test_benches_of_a_hand_over_take_pads(maps, meet_maps, monkeypatch):
    told = dict(reach=meet_maps[1], short=True)
    for bench in (story_bench, view_bench):
        with pytest.raises(BadInput, match=r"--pads nail: .*flange"):
            bench.run(meet_maps[0], pads=["nail"], **told)
    jobs = []

    def played(play, some, processes, tell):
        jobs.extend(some)
        return []

    monkeypatch.setattr(story_bench, "play_all", played)
    monkeypatch.setattr(story_bench, "_tables", lambda played, short: {})
    found = story_bench.run(meet_maps[0], pads=["flange"], **told)
    assert found["setup"]["links that may touch an object"] == "flange"
    assert "slowest speed" in found["setup"]["slow to stop"]
    monkeypatch.setattr(story_bench, "_KEPT", {})
    monkeypatch.setattr(story_bench, "rehearse", lambda setup: None)
    given = []
    monkeypatch.setattr(
        story_bench, "StoryPlay", lambda setup, case: given.append(setup.pads)
    )
    ran = SimpleNamespace(cpu_s=[0.0])
    monkeypatch.setattr(story_bench, "play", lambda run, seconds: ran)
    monkeypatch.setattr(story_bench, "figures_of", lambda result: {})
    story_bench._played(jobs[0])
    assert given == [("flange",)]


def test_a_recording_is_played_again_with_its_own_pads(odm, maps, meet_maps, tmp_path):
    setup = setup_of(*maps[:2], pads=["flange"])
    case = StoryCase("receive", distance=1.2)
    body = case.body()
    giver = Partner(body, setup.side, setup.obj, case.traits, gives=True)
    run = StoryPlay(setup, case, partner=giver)
    recorder = StoryRecorder(run)
    for _ in range(20):
        recorder.add(run.step())
    file = write_record(recorder.record(), tmp_path / "run.npz")
    told = ("--map", meet_maps[0], "--reach", meet_maps[1])
    code, out, error = odm("replay", file, *told)
    assert code == 0 and "same: 20 frames" in out, error


class LatePlay(StoryPlay):
    """What is seen of the person is told four times, as old as it is."""

    def _frame(self, now, *told):
        if not self.index % 4:
            self.told = super()._frame(now, *told)
        return replace(self.told, now=now, stamp=self.told.now)


def test_when_the_person_was_seen_is_recorded_and_told_again(maps, monkeypatch):
    setup = setup_of(*maps[:2], pads=["flange"], place=False)
    case = StoryCase("receive", distance=1.2)
    giver = Partner(case.body(), setup.side, setup.obj, case.traits, gives=True)
    recorder = StoryRecorder(LatePlay(setup, case, partner=giver))
    for _ in range(12):
        recorder.add(recorder.run.step())
    record, told, update = recorder.record(), [], Handover.update

    def hear(story, frame):
        told.append(frame.stamp)
        return update(story, frame)

    monkeypatch.setattr(Handover, "update", hear)
    assert same(record, *play_again(record, setup))
    assert told == np.repeat([0.0, 0.04, 0.08], 4).tolist()


def robot_with(tmp_path, names):
    """Return an arm of one joint whose hand carries links of these names."""
    text = '<robot name="arm">'
    text += "".join(f'<link name="{n}">{BALL}</link>' for n in ("base", "hand", *names))
    text += """<joint name="a" type="revolute"><parent link="base"/><child link="hand"/>
        <origin xyz="0 0 0.2"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>"""
    for name in names:
        text += f"""<joint name="to {name}" type="fixed"><parent link="hand"/>
            <child link="{name}"/><origin xyz="0.1 0 0"/></joint>"""
    path = tmp_path / "arm.urdf"
    path.write_text(text + "</robot>", encoding="utf-8")
    return load_robot(path, tip="hand")


def test_fingers_thumbs_and_pads_are_known_by_their_names(tmp_path):
    robot = robot_with(tmp_path, ("RFinger11", "R_THUMB_2", "left_pad", "camera"))
    assert set(pads_of(robot)) == {"RFinger11", "R_THUMB_2", "left_pad"}
