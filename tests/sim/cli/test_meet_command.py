"""`odm workspace meet`: counts, targets, a picture; nothing shared is no error."""

import json

import numpy as np
import pytest
from command_line import one_sentence
from rows import each

from handover import (
    Human,
    InteractionWorkspace,
    MeetSettings,
    ReachSettings,
    build_reach_map,
    chain_of,
    load_reach_map,
    wrench,
)
from roadmap import load_robot
from roadmap.kinematics.forward import tool_pose
from sim.draw import meet_cut
from sim.loop.loop import exact_audit

ROBOT = "kawasaki_fs003n"
COARSE = ("--cell", "0.2", "--k", "4")


@pytest.fixture(scope="module")
def robot():
    return load_robot(ROBOT, cover_excess=0.1)


@pytest.fixture(scope="module")
def reach_dir(robot, tmp_path_factory):
    """A coarse reach map of a robot of six joints."""
    folder = tmp_path_factory.mktemp("reach") / "kawasaki"
    settings = ReachSettings(cell=0.2, rotations=72, samples=20_000, seed=3)
    chain = chain_of(robot, self_collisions=False)
    build_reach_map(chain, settings, threads=1).save(folder)
    return folder


@pytest.fixture(scope="module")
def reach(reach_dir):
    return load_reach_map(reach_dir)


@pytest.fixture(scope="module")
def meet(reach):
    T = np.eye(4)
    T[2, 3] = 0.75
    human = Human(1.75).placed(0.9, 0.0, np.pi)
    settings = MeetSettings(T_world_base=T, cell=0.2)
    return InteractionWorkspace(reach, human, wrench(), settings=settings)


@pytest.fixture(scope="module")
def meeting(meet, robot):
    return meet_cut.find_meeting(meet, robot, 0.9, 4)


def run(odm, reach_dir, *words):
    return odm("workspace", "meet", "--robot", ROBOT, "--reach", reach_dir, *words)


def test_it_tells_what_the_workspace_holds(odm, reach_dir, meet):
    code, out, _ = run(odm, reach_dir, *COARSE, "--json", "-")
    facts = json.loads(out)
    row = facts["workspaces"][0]
    value = meet.build()
    assert code == 0 and facts["base_height_m"] == 0.75 and row["distance_m"] == 0.9
    assert row["targets"] == (value >= 0).sum() == len(meet) > 50
    assert row["reached_cells"] == len(value) and row["missing_m"] == 0.0
    told = [target["quality"] for target in row["best"]]
    assert told == sorted(told, reverse=True) and len(told) == 4
    assert told == [round(t.quality, 4) for t in meet.best(4)]
    assert set(row["best"][0]["parts"]) == {
        "joint", "spatial", "visibility", "safety", "effort",
    }  # fmt: skip


def test_the_table_has_a_line_for_each_target(odm, reach_dir):
    code, out, _ = run(odm, reach_dir, *COARSE)
    lines = [line.split() for line in out.splitlines()]
    ranks = [line[0] for line in lines if line and line[0] in "1 2 3 4".split()]
    assert code == 0 and ranks == ["1", "2", "3", "4"]
    assert "are targets" in out and "dextrous" in out


def test_the_robots_joints_put_the_tool_at_the_target(meeting, robot):
    T = meeting.meet.settings.T_world_base
    solved = [
        (target, q)
        for target, q in zip(meeting.best, meeting.robot_q, strict=True)
        if q is not None
    ]
    assert solved
    for target, q in solved:
        assert np.abs(T @ tool_pose(robot, q) - target.T_world_tool).max() < 1e-5


def test_the_drawn_robot_keeps_clear_of_the_person(meeting, robot):
    assert meeting.drawn is not None
    side, target = "right", meeting.best[meeting.drawn]
    T = np.linalg.inv(meeting.meet.settings.T_world_base)
    rods = meet_cut._in_the_way(meeting.meet, target, T)
    gap = exact_audit(robot)(meeting.robot_q[meeting.drawn], rods)
    assert gap >= meet_cut.NEAR
    grip = meeting.taking.T_world_hand(side)
    np.testing.assert_allclose(grip, target.T_world_hand, atol=1e-6)


def test_a_position_shows_the_best_of_its_rotations(meet):
    quality = meet_cut.quality_by_position(meet)
    grid, best = meet.grid, meet.best(1)[0]
    index = np.unravel_index(best.key // grid.rotations.n_cells, grid.shape)
    assert quality[index] == pytest.approx(np.nanmax(quality))
    value = meet.build()
    for i in np.random.default_rng(0).choice(np.flatnonzero(value >= 0), 20):
        at = np.unravel_index(meet.keys[i] // grid.rotations.n_cells, grid.shape)
        assert quality[at] >= value[i]
    shared = np.unique(meet.keys[value >= 0] // grid.rotations.n_cells)
    assert np.isfinite(quality).sum() == len(shared)


def test_a_layer_holds_its_height_in_the_world(meet):
    for axis in (1, 2):
        for at in (0.07, 0.52) if axis == 1 else (0.41, 0.9):
            layer = meet_cut.layer_at(meet, axis, at)
            grid, T = meet.grid, meet.settings.T_world_base
            low = grid.origin[axis] + layer * grid.cell + T[axis, 3]
            assert low <= at < low + grid.cell


@pytest.mark.parametrize("far", [("0.8",), ("0.7", "1.1", "3.0")])
def test_it_draws_one_meeting_or_several(odm, reach_dir, tmp_path, far):
    picture = tmp_path / "cut.png"
    words = [word for d in far for word in ("--distance", d)]
    code, out, _ = run(odm, reach_dir, *COARSE, *words, "--plot", picture)
    assert code == 0 and f"plot: {picture}" in out
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert [f.name for f in tmp_path.iterdir()] == ["cut.png"]


def test_a_person_out_of_reach_gives_an_empty_table_and_what_is_missing(
    odm, reach_dir, tmp_path
):
    file, picture = tmp_path / "far.json", tmp_path / "far.png"
    words = ("--distance", "3", *COARSE, "--json", file, "--plot", picture)
    code, out, _ = run(odm, reach_dir, *words)
    row = json.loads(file.read_text())["workspaces"][0]
    assert code == 0 and row["targets"] == 0 and row["best"] == []
    assert 0.5 < row["missing_m"] < 2.5
    assert f"{100 * row['missing_m']:.0f} cm too far away" in out and picture.exists()
    # standing nearer by that, lengths are no hindrance any more
    nearer = str(3.0 - row["missing_m"] - 0.25)
    code, out, _ = run(odm, reach_dir, "--distance", nearer, *COARSE, "--json", "-")
    assert json.loads(out)["workspaces"][0]["targets"] > 0


def test_turning_away_and_lying_down_changes_what_is_shared(odm, reach_dir):
    counts = []
    for words in ((), ("--turn", "180"), ("--posture", "lying", "--turn", "90")):
        code, out, _ = run(odm, reach_dir, *COARSE, *words, "--json", "-")
        facts = json.loads(out)
        assert code == 0
        counts.append(facts["workspaces"][0]["targets"])
    assert counts[0] > 2 * counts[1] and counts[2] != counts[0]


def test_a_robot_with_a_tall_base_stands_on_the_floor(robot):
    assert meet_cut.base_height(robot) == meet_cut.TABLE
    armar = load_robot("armar3", cover_excess=0.1)
    assert meet_cut.base_height(armar) == 0.0


@each(
    ("words", "said"),
    [
        (("--object", "hammer"), "--object is 'hammer': choose wrench or mallet"),
        (("--height", "3"), "--height is 3: give a number from 1.2 to 2.2 m"),
        (("--side", "up"), "choose right or left"),
        (("--posture", "flying"), "--posture is 'flying'"),
        (("--cell", "0.01"), "are finer than the"),
        (("--rotations", "5"), "no grid has 5 rotations"),
        (("--distance", "nan"), "--distance is nan"),
        (("--distance", "0.9", "--distance", "0"), "deep in the robot's base; give"),
        (("--human-reach", "MAP", *COARSE), "a map of kawasaki"),
        (("--robot", "plain_arm"), "was built for another robot"),
        (("--tip", "no_link"), "there is no link 'no_link'"),
        (("--lock", "no_joint=1"), "no_joint"),
    ],
)
def test_bad_input_is_one_sentence(odm, reach_dir, tmp_path, words, said):
    words = [str(reach_dir) if word == "MAP" else word for word in words]
    picture = tmp_path / "cut.png"
    code, _, err = run(odm, reach_dir, *words, "--plot", picture)
    assert code == 2 and one_sentence(err) and said in err, err
    assert not picture.exists()


def test_a_missing_map_says_how_to_build_it(odm, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = odm("workspace", "meet", "--robot", ROBOT)
    assert code == 2 and "odm workspace build" in err and one_sentence(err)
