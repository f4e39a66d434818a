"""A cycle of tools: who stands where, what follows what, and its recording."""

import gc
import weakref
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import odm
from handover import (
    InteractionWorkspace,
    MeetSettings,
    human_from_joints,
    load_reach_map,
)
from handover.targets.node_index import NodeIndex
from roadmap.errors import BadInput
from roadmap.geometry.gaps import least_gap, moved_rods
from sim.maintenance import play as cycle_play
from sim.maintenance import tell as cycle_tell
from sim.maintenance.cases import (
    BESIDE_PANDA,
    SIZES,
    LadderCase,
    ToolSetup,
    case_in_reach,
    tools_of,
    upright,
    wrench_of,
)
from sim.maintenance.play import CycleSettings, MaintenancePlay, play_cycle, trouble_of
from sim.maintenance.record import PARTS, CycleRecorder, is_same_again, parts_of
from sim.people.partner import Partner, RecordedPartner
from sim.people.whole_person import BASE_HEIGHT
from sim.record import read_record, write_record
from sim.story import tell as story_tell
from sim.story.handover import Handover
from sim.story.play import StoryPlay, StoryResult, new_story
from sim.story.record import StoryRecorder, play_again, same
from sim.story.request import DemoRequest
from sim.story.robot_hand import held_farther_out
from sim.story.settings import StorySettings

SHORT = CycleSettings(uses_s=0.03)


class Coarse(ToolSetup):
    """One whose workspace is made at once."""

    def meet(self, human):
        grid = MeetSettings(cell=0.2, rotations=72)
        return InteractionWorkspace(self.reach, human, self.obj, 4, grid)


@pytest.fixture(scope="module")
def setups(meet_maps):
    cell_map = odm.load_map(meet_maps[0])
    index = NodeIndex(cell_map.robot, cell_map.roadmap.nodes)
    rest = np.array(index.nodes[0])
    shared = (index, rest, "right", ("flange",), None)
    reach = load_reach_map(meet_maps[1])
    settings = odm.PlannerSettings(finger_pads=("flange",))
    planner = odm.ReactivePlanner(cell_map, settings=settings)
    tools = [held_farther_out(planner, wrench_of(s), index.nodes) for s in SIZES[:2]]
    return tuple(Coarse(cell_map, reach, tool, *shared) for tool in tools)


def test_the_person_stands_on_a_ladder_and_tools_stand_apart_on_the_table():
    case = LadderCase.drawn_at(3)
    assert case == LadderCase.drawn_at(3) != LadderCase.drawn_at(3, 1)
    rows = case.body().capsules()
    feet = float((rows[:, [2, 5]] - rows[:, 6:7]).min()) + BASE_HEIGHT
    assert 0.5 < feet < 0.6  # the step is at 0.56 m
    tools = [wrench_of(size) for size in SIZES]
    standing = [
        moved_rods(tool.capsules, upright(tool, xy))
        for tool, xy in zip(tools, BESIDE_PANDA.places_xy, strict=True)
    ]
    for k, rows in enumerate(standing):
        assert 0.0 < (rows[:, [2, 5]].min() - rows[:, 6].max()) < 0.02
        for others in standing[:k]:
            assert least_gap(rows, others) > 0.10
    for tool, size in zip(tools, SIZES, strict=True):
        end = tool.T_tool_object[2, 3] - 0.11 * size
        assert np.isclose(end, 0.02)  # the fingers hold the very tip


def test_other_tools_are_scenery_and_one_s_own_is_not(setups):
    tool = wrench_of(0.9)
    T = upright(tool, BESIDE_PANDA.places_xy[1])
    one = ToolSetup(
        *(getattr(setups[0], name) for name in ("cell_map", "reach", "obj", "index")),
        setups[0].rest,
        pads=("flange",),
        others=((tool, T),),
    )
    names = [name for name in one.planner().scene]
    assert names == ["holder 2", "tool 2"]
    assert [name for name in setups[0].planner().scene] == []


def test_each_tool_has_its_own_place_and_the_others_stand_about(meet_maps):
    maps = odm.load_map(meet_maps[0]), load_reach_map(meet_maps[1])
    setups = tools_of(*maps, ("flange",))
    assert len(setups) == len(SIZES)
    for k, setup in enumerate(setups):
        own = upright(setup.obj, BESIDE_PANDA.places_xy[k])
        assert np.array_equal(setup.places(), own[None])
        assert [tool for tool, _ in setup.others] == [
            other.obj for other in setups if other is not setup
        ]
        human = LadderCase.drawn_at(0).body()
        story = new_story(setup, StorySettings(direction="receive"), human)
        assert np.array_equal(story.placing.T_places, own[None])


class Run:
    """Stands for a hand-over that ends after some frames."""

    def __init__(self, setup, case, wrist=None, fetch=False):
        self.setup, self.case, self.fetches, self.index = setup, case, fetch, 0
        self.partner = SimpleNamespace(arm=np.zeros(7))
        self.planner = SimpleNamespace(robot=setup.cell_map.robot)
        placed = SimpleNamespace(signal="placed")
        executor = SimpleNamespace(set_point=SimpleNamespace(q=np.array(setup.rest)))
        self.story = SimpleNamespace(
            ended=False, reason="it said why", events=[placed], executor=executor
        )
        self.result = StoryResult(case, True, handed_s=1.0)

    def step(self):
        self.index += 1
        self.story.ended = self.index >= 5
        return self.index


@pytest.fixture
def bare(monkeypatch):
    monkeypatch.setattr(cycle_play, "StoryPlay", Run)


def test_each_tool_is_given_and_taken_back_in_turn(setups, bare):
    cycle = MaintenancePlay(setups, LadderCase.drawn_at(0), settings=SHORT)
    played, kept = [], []

    def hear(run, moment):
        told = run.setup, run.case.direction, run.fetches
        if not played or played[-1] != told:
            played.append(told)
            kept.append(weakref.ref(run))

    result = play_cycle(cycle, hear)
    assert result.whole and not result.reason and result.contacts == 0
    assert [run[0] for run in played] == [setups[k] for k in (0, 0, 1, 1)]
    assert [run[1] for run in played] == ["give", "receive"] * 2
    assert [run[2] for run in played] == [True, False] * 2
    gc.collect()  # those that are over take their planners along
    assert [run() is not None for run in kept] == [False, False, False, True]
    assert np.allclose(np.diff(cycle.begun), 0.07) and np.isclose(cycle.now, 0.28)


@pytest.mark.parametrize("how", ["not handed", "elsewhere", "not placed", "for ever"])
def test_what_goes_wrong_ends_the_cycle_with_a_reason(setups, bare, monkeypatch, how):
    settings = replace(SHORT, limit_s=0.2)
    cycle = MaintenancePlay(setups, LadderCase.drawn_at(0), settings=settings)
    while cycle.run.case.direction == "give":
        cycle.step()
    story = cycle.run.story
    if how == "not handed":
        cycle.run.result.handed_s = None
    elif how == "elsewhere":
        story.executor.set_point.q += 0.1
    elif how == "not placed":
        story.events.clear()
    else:
        cycle.run.step = lambda: setattr(cycle.run, "index", cycle.run.index + 1)
        story.ended = False
    result = play_cycle(cycle)
    told = "not over" if how == "for ever" else "it said why"
    assert not result.whole and told in result.reason
    assert "taking back the wrench of 25 cm" in result.reason
    assert len(cycle.begun) == 2
    if how != "for ever":
        assert trouble_of(cycle.run) == "it said why"


@pytest.mark.parametrize("json", [None, "-"])
def test_a_robot_that_takes_long_to_stop_says_so_before_the_cycle(
    setups, monkeypatch, capsys, json
):
    said = []

    def played(*told):
        said.append(capsys.readouterr().out)
        raise BadInput("it is played elsewhere")

    rehearsed = []
    monkeypatch.setattr(cycle_tell, "rehearse", rehearsed.append)
    monkeypatch.setattr(cycle_tell, "_played", played)
    request = DemoRequest("maintenance", pads=["flange"], json=json)
    with pytest.raises(BadInput, match="elsewhere"):
        cycle_tell.tell_cycles(request, setups[0].cell_map, setups[0].reach)
    assert ("to stop even from its slowest speed" in said[0]) == (json is None)
    assert len(rehearsed) == 1  # else the first cycle compiled in its frames


def test_a_ladder_out_of_reach_is_refused_before_the_run(setups, monkeypatch):
    monkeypatch.setattr("sim.maintenance.cases.in_reach", lambda *_: None)
    with pytest.raises(BadInput, match="longer arm"):
        case_in_reach(setups, 0)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"robot": "crane"}, "choose panda or armar3"),
        ({"direction": "give"}, "--direction"),
    ],
)
def test_a_cycle_that_cannot_be_is_refused_in_a_sentence(given, told):
    with pytest.raises(BadInput, match=told):
        DemoRequest("maintenance", **given)
    with pytest.raises(BadInput, match="--cycles goes with"):
        DemoRequest("handover", cycles=2)


def test_a_recording_of_nothing_is_refused():
    with pytest.raises(BadInput, match="nothing to record"):
        CycleRecorder().record()


@pytest.mark.parametrize("tracked", [False, True])
def test_beside_a_recorded_person_it_is_recorded_and_the_same_again(
    setups, tmp_path, tracked
):
    case = LadderCase.drawn_at(0)
    places = case.body().places  # measured anew in each frame, and no gaze

    def human(t):
        return human_from_joints(places * (1.0 + t) + [0.0, 0.0, t])

    def guess(t):
        return human(t).capsules()

    def capsules(t):  # not seen, and grown
        return guess(t) + np.r_[np.zeros(6), 0.01 + t]

    labels = human(0.0).labels
    person = SimpleNamespace(human=human, labels=labels)
    if tracked:
        person.guess, person.capsules = guess, capsules
    partner = RecordedPartner(person, "right", setups[0].obj, case.traits)
    run = StoryPlay(setups[0], case.of("give"), partner=partner)
    recorder = StoryRecorder(run)
    for _ in range(4):
        recorder.add(run.step())
    seen = [moment.capsules for moment in recorder.moments]
    record = read_record(write_record(recorder.record(), tmp_path / "run.npz"))
    seen_again, told_again = [], []
    update = Handover.update

    def spy(story, frame):
        seen_again.append(frame.human.capsules())
        told_again.append(frame.capsules)
        return update(story, frame)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Handover, "update", spy)
        assert same(record, *play_again(record, setups[0]))
    assert np.array_equal(seen, seen_again) and not np.array_equal(seen[0], seen[3])
    told = [capsules(0.01 * k) if tracked else None for k in range(4)]
    for one, again in zip(told, told_again, strict=True):
        assert np.array_equal(one, again) if tracked else again is None


@pytest.mark.parametrize("story", ["handover", "maintenance"])
def test_what_was_played_until_ctrl_c_is_recorded(
    story, setups, tmp_path, monkeypatch, capsys
):
    """As it is of `odm run --record`: 4 frames were played, and can be again."""
    path, case = tmp_path / "run.npz", LadderCase.drawn_at(0)
    partner = Partner(case.body(), "right", setups[0].obj, case.traits)
    run = StoryPlay(setups[0], case.of("give"), partner=partner)

    def played(setups, at, seed, recorder, say):
        for _ in range(4):
            recorder.add(run, run.step())
        raise KeyboardInterrupt

    def play(run, seconds, hear):
        for _ in range(4):
            hear(run.step())
        raise KeyboardInterrupt

    for module in (cycle_tell, story_tell):
        monkeypatch.setattr(module, "rehearse", lambda setup: None)
    monkeypatch.setattr(cycle_tell, "_played", played)
    monkeypatch.setattr(story_tell, "play", play)
    monkeypatch.setattr(story_tell, "setup_of", lambda *_, pads: setups[0])
    monkeypatch.setattr(story_tell, "_run_of", lambda *_: run)
    tell = {"handover": story_tell.tell_story, "maintenance": cycle_tell.tell_cycles}
    request = DemoRequest(story, pads=["flange"], record=path)
    with pytest.raises(KeyboardInterrupt):
        tell[story](request, setups[0].cell_map, setups[0].reach)
    assert f"4 frames in {path}" in capsys.readouterr().err
    record = read_record(path)
    parts = parts_of(record) if story == "maintenance" else [record]
    assert [part.frames for part in parts] == [4]
    assert same(parts[0], *play_again(parts[0], setups[0]))


def test_a_recorded_cycle_falls_into_its_hand_overs(setups, tmp_path, monkeypatch):
    recorder, case = CycleRecorder(), LadderCase.drawn_at(0)
    ways = ("give", "receive")
    for way in ways:
        gives = way == "receive"  # the person
        partner = Partner(case.body(), "right", setups[0].obj, case.traits, gives)
        run = StoryPlay(setups[0], case.of(way), partner=partner)
        for _ in range(4):
            recorder.add(run, run.step())
    record = recorder.record()
    assert record.frames == 8 and np.allclose(np.diff(record.arrays["time_s"]), 0.01)
    parts = parts_of(record)
    assert [part.frames for part in parts] == [4, 4]
    assert tuple(part.head["story"]["direction"] for part in parts) == ways
    states = record.head["story"]["states"]
    for k, part in zip((0, 4), parts, strict=True):
        mine = part.head["story"]["states"]
        told = [mine[s] for s in part.arrays["story.state"]]
        assert told == [states[s] for s in record.arrays["story.state"][k : k + 4]]
        assert np.array_equal(part.arrays["q"], record.arrays["q"][k : k + 4])
    again = read_record(write_record(record, tmp_path / "cycle.npz"))
    again.head[PARTS].pop()  # one is enough to see whether it is the same
    assert is_same_again(again, setups[:1])
    off = (parts[0].arrays["q"] + 1e-9, states[:1] * 4)
    monkeypatch.setattr("sim.maintenance.record.play_again", lambda *_: off)
    assert not is_same_again(again, setups[:1])
