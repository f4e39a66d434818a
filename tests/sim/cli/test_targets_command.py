"""`odm run --targets meet`: to the best reachable target of a moving person."""

import json
from dataclasses import replace
from itertools import groupby

import numpy as np
import pytest
from mocap_files import person, write_csv
from rows import each

from handover import ReachSettings, build_reach_map, chain_of
from handover.targets.live_targets import THERE, WITHDRAWN
from handover.targets.settings import LiveSettings
from handover.targets.target_goals import TargetGoals
from odm import Obstacles, load_map
from roadmap.errors import BuildRefused
from roadmap.kinematics.forward import difference, tool_pose
from sim.loop.loop import LoopSettings, run_frames
from sim.run.meet import MeetTask, reach_map_of
from sim.run.meet_audit import RANKED, TargetAudit, Verdict, shares
from sim.run.meet_loop import MeetLoop
from sim.run.request import RunRequest
from sim.run.runner import run


@pytest.fixture(scope="module")
def built(meet_maps):
    return meet_maps


def request(built, motion="reach", **more):
    asked = {"seconds": 4.0, "seed": 1, "rate": 50.0, "between": (0.9, 0.9)}
    asked |= {"targets": "meet", "reach": built[1], "json": "-"}
    return RunRequest(built[0], motion, **(asked | more))


@pytest.fixture(scope="module")
def data(built):
    return run(request(built, audit_s=0.5))


def test_a_run_tells_what_became_of_the_targets(data):
    told, run = data["targets"], data["run"]
    assert run["frames"] == 200 and run["contacts"] == told["contacts"] == 0
    assert sum(told["share_of_time"].values()) == pytest.approx(1.0, abs=1e-3)
    going = told["share_of_time"]
    assert going.get("there", 0.0) + going.get("on the way", 0.0) > 0.5
    assert told["audit"]["judged"] == 7
    parts = ("within_margin", "worse", "none")
    assert sum(told["audit"][p] for p in parts) == pytest.approx(1.0, abs=1e-3)
    for name in ("loop_wall_s", "loop_cpu_s"):
        assert 0 < told[name]["p50"] <= told[name]["p99"] <= told[name]["max"]
    json.dumps(data, allow_nan=False)


def test_the_same_seed_gives_the_same_run(built, data):
    again = run(request(built, audit_s=0))
    assert again["run"]["trajectory_sha256"] == data["run"]["trajectory_sha256"]
    assert again["targets"]["audit"]["judged"] == 0


def test_the_loop_pursues_what_it_says(built):
    task = MeetTask(request(built, "jitter", seed=0))
    task.open(lambda *a: None)
    someone = task.person()
    live = task.setup.live(someone.human(0.0), task.side)
    loop = MeetLoop(live, task.setup.rest, someone)
    for _ in range(150):
        frame = loop.frame()
        pursuit = loop.pursuits[-1]
        assert len(loop.pursuits) == frame.index + 1
        assert frame.place == (-1 if pursuit.key is None else pursuit.key)
        if pursuit.key is None:
            continue
        goals = [g.q for g in live.goals]
        np.testing.assert_array_equal(live.planner.goals, goals)
        # the path ends at the goal that is said to be pursued
        at = frame.answer.goal
        assert live.goals[at].key == pursuit.key
        np.testing.assert_allclose(frame.answer.path[-1], goals[at], atol=1e-9)


def test_beside_a_hand_that_trembles_it_stays_on_its_path_and_at_its_target(built):
    """It was driven off each time, or took another path on the way."""
    told = run(request(built, "tremble", seconds=5.0, rate=100.0, audit_s=0))
    assert told["run"]["path_changes"] == 0  # the first path to a target is none
    assert told["targets"]["arrivals"] == 1
    assert told["targets"]["target_changes_per_minute"] == 0.0


def test_after_its_dwell_it_goes_back_and_comes_again(built):
    asked = request(built, "hover", seconds=9.0, dwell=0.4, audit_s=0.5)
    task = MeetTask(asked)
    task.open(lambda *a: None)
    loop = task.loop(task.person(), LoopSettings(duration_s=9.0, rate_hz=50.0))
    result = run_frames(loop, task.hear)
    told = task.figures(loop, result)["targets"]
    states = [p.state for p in loop.pursuits]
    stays = [len(list(run)) for state, run in groupby(states) if state == THERE]
    assert stays.count(20) == told["handovers"] >= 2
    assert told["arrivals"] >= told["handovers"] and told["dwell_s"] == 0.4
    off = np.abs(difference(loop.robot, np.array(result.q), loop.places[0]))
    home = (off.max(axis=1) < 1e-6).astype(int)
    assert (np.diff(home) == 1).sum() >= told["handovers"] - 1  # it was back
    assert WITHDRAWN in states and result.contacts == 0


def test_a_recording_is_taken_with_the_hand_it_shows(built, tmp_path):
    joints = {n: p for n, p in person(120).items() if not n.startswith("left_elbow")}
    clip = write_csv(tmp_path / "clip.csv", joints)
    asked = request(built, "mocap", file=clip, seconds=1.0, between=None)
    task = MeetTask(asked)
    assert task.person().sides == ("right",) and task.side == "right"
    assert run(asked)["run"]["frames"] == 50


def test_the_command_runs_and_writes_what_was_asked(odm, built, tmp_path):
    words = ["run", "--map", built[0], "--targets", "meet", "--reach", built[1]]
    words += ["--motion", "reach", "--seconds", "1.1", "--rate", "50"]
    words += ["--between", "0.8", "1.0", "--object", "mallet", "--out", tmp_path / "o"]
    code, out, err = odm(*words)
    assert code == 0, err
    assert "top-ranked" in out and "target changes per minute" in out
    assert sorted(p.name for p in (tmp_path / "o").iterdir()) == [
        "reach.gif",
        "reach.json",
        "reach_latency.png",
    ]


def test_the_audit_counts_nodes_and_none_that_stands_in_the_person(built, monkeypatch):
    """What only a node serves was out of reach, though the run may be there."""
    monkeypatch.setattr(TargetAudit, "_solutions", lambda self, T_base_tool: [])
    task = MeetTask(request(built))
    task.open(lambda *a: None)
    human = task.person().human(0.0)
    _, audit = task.setup.loop(task.person(), task.side, LoopSettings())
    few = LiveSettings(node_tolerance_m=0.3, node_tolerance_rad=1.5)  # of 250
    nodes = audit._nodes = TargetGoals(audit.planner, audit.meet, task.setup.index, few)
    rest, nobody = task.setup.rest, np.array([[3.0, 0.0, 0.0, 3.0, 0.0, 1.0, 0.1]])
    found = audit.look(human, Obstacles(capsules=nobody), rest, None, 0.0)
    assert found.top is not None
    served = {t.key: nodes.near_node(t) for t in audit.meet.best(RANKED)}
    assert served[found.top] is not None
    # somebody's hand is where the tool would be, by each of the nodes
    places = [tool_pose(task.cell_map.robot, g.q)[:3, 3] for g in served.values() if g]
    hands = np.array([[*p, *p, 0.05] for p in places])
    found = audit.look(human, Obstacles(capsules=hands), rest, None, 0.0)
    assert found.top is None and found.rank == len(served)


@each(
    ("words", "told"),
    [
        (["--targets", "moon"], "choose places or meet"),
        (["--reach", "x"], "--reach goes with --targets meet"),
        (["--between", "0.6", "1"], "--between goes with --targets meet"),
        (["--object", "wrench"], "--object goes with --targets meet"),
        (["--side", "left"], "--side goes with --targets meet"),
        (["--dwell", "1"], "--dwell goes with --targets meet"),
        (["--targets", "meet", "--dwell", "-1"], "--dwell"),
        (["--targets", "meet", "--object", "cup"], "choose wrench or mallet"),
        (["--targets", "meet", "--side", "third"], "choose right or left"),
        (["--targets", "meet", "--side", "left"], "right arm only"),
        (["--targets", "meet", "--motion", "crowding"], "4 capsules"),
        (["--targets", "meet", "--motion", "dance"], "--motion is 'dance'"),
        (["--targets", "meet", "--between", "2", "1"], "smaller one first"),
        (["--targets", "meet", "--motion", "mocap"], "--file"),
        (
            ["--targets", "meet", "--motion", "mocap", "--file", __file__]
            + ["--between", "0.6", "1"],
            "--between goes with a scripted person; leave it out; --stand says",
        ),
        (["--targets", "meet", "--reach", "nowhere"], "no reach map"),
    ],
)
def test_options_that_do_not_go_together_are_refused(odm, built, words, told):
    code, _, err = odm("run", "--map", built[0], "--seconds", "1", *words)
    assert code == 2 and told in err and err.count("odm: ") == 1


def test_the_reach_map_of_another_robot_is_refused(odm, built, tmp_path):
    from roadmap import load_robot

    chain = chain_of(load_robot("panda", cover_excess=0.2), False)
    settings = ReachSettings(cell=0.3, rotations=72, samples=2000)
    other = build_reach_map(chain, settings, threads=1).save(tmp_path / "panda")
    words = ["--targets", "meet", "--reach", other, "--seconds", "1"]
    code, _, err = odm("run", "--map", built[0], *words)
    assert code == 2 and "panda" in err


def test_a_missing_reach_map_is_built_and_said(odm, built, tmp_path, monkeypatch):
    from sim.run import meet

    monkeypatch.chdir(tmp_path)
    few = ReachSettings(cell=0.15, rotations=72, samples=2000)

    def quick(chain, progress):
        return build_reach_map(chain, few, progress=progress)

    monkeypatch.setattr(meet, "build_reach_map", quick)
    words = ["run", "--map", built[0], "--targets", "meet", "--seconds", "0.5"]
    words += ["--json"]
    code, out, err = odm(*words)
    assert code == 0, err
    assert "building it into" in err and json.loads(out)
    assert (tmp_path / "maps/built/reach/kawasaki_fs003n/manifest.json").is_file()
    code, _, err = odm(*words)
    assert code == 0 and "building" not in err


def test_robots_of_one_name_each_get_a_reach_map(built, tmp_path, monkeypatch):
    from sim.run import meet

    robot = load_map(built[0]).robot

    monkeypatch.chdir(tmp_path)
    few = ReachSettings(cell=0.3, rotations=72, samples=2000)
    made = []

    def quick(chain, progress):
        made.append(chain)
        return build_reach_map(chain, few, progress=progress)

    monkeypatch.setattr(meet, "build_reach_map", quick)
    robots = [robot]
    for length in (0.1, 0.2):
        T_body_tip = robot.T_body_tip.copy()
        T_body_tip[2, 3] += length
        robots.append(replace(robot, T_body_tip=T_body_tip))
    for _ in range(2):
        for one in robots:
            reach = meet.reach_map_of(one, None, lambda *progress: None)
            meet.check_same_robot(reach, one)
    assert len(made) == 3 == len(list((tmp_path / "maps/built/reach").iterdir()))


def test_a_robot_too_large_for_a_reach_map_is_told_how(built, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("handover.reach.reach_build.MAX_BYTES", 1)
    with pytest.raises(BuildRefused, match="workspace build URDF --tip .* --cell 0.1"):
        reach_map_of(load_map(built[0]).robot, None, lambda *progress: None)


def test_shares_count_each_verdict_once():
    def verdict(pursued, quality, top, top_quality, rank=0):
        return Verdict(0.0, pursued, quality, top, top_quality, rank)

    told = shares(
        [
            verdict(1, 0.6, 1, 0.6),  # the top one
            verdict(3, 0.6 - 1e-9, 1, 0.6),  # its mirror image
            verdict(2, 0.58, 1, 0.6, rank=2),  # within the margin
            verdict(2, 0.5, 1, 0.6),  # worse
            verdict(None, 0.0, 1, 0.6),  # none
            verdict(None, 0.0, None, 0.0),  # nothing can be reached
        ],
        margin=0.03,
    )
    assert told == {
        "judged": 6,
        "out_of_reach": 1,
        "top": 0.4,
        "within_margin": 0.6,
        "worse": 0.2,
        "none": 0.2,
        "first_ranked_reachable": 0.8,
    }
