"""The bench of cluttered scenes: what it draws, and that its table has every figure."""

import json

import numpy as np
import pytest

import odm as planner
from odm.cell_map.recipe import Recipe, RobotRecipe
from odm.close_test.safety import Safety
from odm.exact.distances import ExactRobot
from roadmap.graph.connecting import RoadmapSettings
from roadmap.kinematics.forward import tool_pose
from sim.bench.core import clutter, clutter_scenes
from sim.bench.core.clutter_scenes import APART, CLEAR, KINDS, make_scenes


@pytest.fixture(autouse=True)
def few_to_choose_from(monkeypatch):
    """Draw the ends of scenes from fewer configurations: those are as good."""
    monkeypatch.setattr(clutter_scenes, "_POOL", 20_000)


@pytest.fixture(scope="module")
def map_dir(tmp_path_factory):
    """A map of a large arm with hardly a roadmap."""
    floor = {"type": "plane", "name": "floor"}
    recipe = Recipe(
        "panda",
        RobotRecipe(source="panda", cover_excess=0.02),
        RoadmapSettings(nodes=40, neighbors=4, seed=1),
        Safety(h=0.08),
        (floor,),
    )
    return planner.build_map(recipe).save(tmp_path_factory.mktemp("clutter") / "panda")


def test_both_ends_keep_their_distance_and_the_same_seed_draws_the_same(map_dir):
    cell_map = planner.load_map(map_dir)
    scenes, again = make_scenes(cell_map, 5, 3), make_scenes(cell_map, 2, 3)
    exact, still = ExactRobot(cell_map.robot), np.zeros(cell_map.robot.dof)
    static = planner.ReactivePlanner(cell_map).static
    assert [s.kind for s in scenes] == list(KINDS)
    for scene, same in zip(scenes, again, strict=False):
        assert scene.q_start.tobytes() == same.q_start.tobytes()
        assert scene.q_goal.tobytes() == same.q_goal.tobytes()
        assert len(scene.boxes) == len(same.boxes)
    for scene in scenes:
        assert np.linalg.norm(scene.q_start - scene.q_goal) >= APART
        for q in (scene.q_start, scene.q_goal):
            near = exact.distance(q, list(scene.boxes), cap=0.1)
            assert near.distance >= CLEAR
            assert static.motion_free(q, still)
    other = make_scenes(cell_map, 1, 4)[0]
    assert other.q_start.tobytes() != scenes[0].q_start.tobytes()


def test_an_end_of_a_shelf_scene_has_its_tool_between_the_boards(map_dir):
    cell_map = planner.load_map(map_dir)
    for scene in make_scenes(cell_map, 11, 5)[::5]:
        assert scene.kind == "shelf"
        back = scene.boxes[0].T_base_shape  # its x leads into the shelf
        inside = 0
        for q in (scene.q_start, scene.q_goal):
            p = tool_pose(cell_map.robot, q)[:3, 3] - back[:3, 3]
            inside += -0.36 < p @ back[:3, 0] < 0.0
        assert inside >= 1


def test_the_short_bench_reports_every_figure_as_plain_data(
    odm, map_dir, tmp_path, monkeypatch
):
    monkeypatch.setattr(clutter, "LIMIT_S", 0.05)  # how long OMPL takes is not tested
    monkeypatch.setattr(clutter, "STEP", 0.03)  # more than 1000 looks again, still
    file = tmp_path / "clutter.json"
    code, out, _ = odm("bench", "clutter", "--map", map_dir, "--short", "--json", file)
    result = json.loads(file.read_text())
    assert code == 0 and result["bench"] == "clutter"
    assert result["setup"]["scenes"] == 10
    rows = {row["name"]: row for row in result["rows"]}
    assert rows["... in contact"]["value"] == 0
    least = rows["... exact distance from the boxes, least"]
    assert least["value"] >= least["asked"]["least"] > 0.9
    assert rows["configurations of our paths checked"]["value"] > 1000
    answered = sum(rows[f"answered by: {s}"]["value"] for s in
                   ("straight", "roadmap", "search"))  # fmt: skip
    solved = [rows[f"solved: {kind}"]["value"] for kind in KINDS]
    assert answered == pytest.approx(10 * np.mean(solved) / 100)
    assert rows["answered by: search"]["value"] >= 3
    assert rows["obstacles to path"]["n"] == answered
    asked = {"p50": 1e3 * clutter.P50_MS, "p95": 1e3 * clutter.P95_MS}
    assert rows["obstacles to path"]["asked"] == asked
    assert "OMPL" in out
