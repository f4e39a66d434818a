"""What never moves is heeded: the robot itself, the recipe's scenery, this place's."""

import threading

import numpy as np
import pytest
from shapes_drawn import smallest_solid_gap
from small import AWAY, HOME, NOBODY, small_recipe

import odm
from odm.cell_map.recipe import Recipe, RobotRecipe
from odm.close_test.safety import Safety
from odm.exact.distances import ExactRobot
from roadmap.errors import BadInput
from roadmap.graph.connecting import RoadmapSettings
from roadmap.transforms import pose_of

# the fore arm turns without limit: half way round, the hand would pass through
# the upper arm
FOLDING = """<robot name="folding">
<link name="base"><collision><geometry><sphere radius="0.04"/></geometry></collision>
</link>
<link name="upper"><collision><origin xyz="0.2 0 0"/><geometry>
<box size="0.4 0.06 0.06"/></geometry></collision></link>
<link name="fore"><collision><origin xyz="0.15 0 0.08"/><geometry>
<box size="0.2 0.04 0.04"/></geometry></collision></link>
<link name="hand"><collision><geometry><sphere radius="0.05"/></geometry></collision>
</link>
<joint name="swing" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="bend" type="continuous"><parent link="upper"/><child link="fore"/>
<origin xyz="0.4 0 0"/><axis xyz="0 0 1"/><limit velocity="1" effort="1"/></joint>
<joint name="end" type="fixed"><parent link="fore"/><child link="hand"/>
<origin xyz="0.28 0 0"/></joint>
</robot>
"""
LEFT, RIGHT = np.array([0.0, 2.6]), np.array([0.0, -2.6])
SHUT = np.array([0.0, 3.1])


@pytest.fixture(scope="module")
def folding(tmp_path_factory):
    urdf = tmp_path_factory.mktemp("folding") / "folding.urdf"
    urdf.write_text(FOLDING)
    settings = RoadmapSettings(nodes=80, neighbors=6)
    recipe = Recipe("folding", RobotRecipe(str(urdf)), settings, Safety(h=0.05))
    return odm.ReactivePlanner(odm.build_map(recipe), always_replan=True)


def test_a_motion_through_the_robot_itself_is_not_free(folding):
    assert folding.is_free(LEFT, LEFT) and folding.is_free(RIGHT, RIGHT)
    assert folding.is_free(LEFT, np.zeros(2))
    through = folding.is_free(LEFT, RIGHT)  # the short way round
    assert through.failed == "self-collision"
    assert "upper would touch hand" in through.reason


def test_no_path_leads_through_the_robot_itself(folding):
    exact = ExactRobot(folding.robot, base=True)
    for start, goal in ((LEFT, RIGHT), (RIGHT, LEFT), (LEFT + [0.5, 0], RIGHT)):
        folding.set_goals([goal])
        answer = folding.step(NOBODY, q=start)
        assert answer.status == "replanned"
        for a, b in zip(answer.path, answer.path[1:], strict=False):
            for t in np.linspace(0, 1, 30):
                assert exact.self_distance(a + t * (b - a)).distance > 0.0


def test_a_start_in_self_collision_holds_and_a_goal_is_refused(folding):
    folding.set_goals([LEFT])
    answer = folding.step(NOBODY, q=SHUT)
    assert answer.status == "holding"
    assert "start is not free: upper would touch hand" in answer.reason
    with pytest.raises(BadInput, match="goal 0 is not free: upper would touch hand"):
        folding.set_goals([SHUT])


@pytest.fixture(scope="module")
def beside_a_mesh(tmp_path_factory):
    """A map of the small arm with a beam over its base, given as a mesh."""
    from dataclasses import replace

    import trimesh

    file = tmp_path_factory.mktemp("mesh") / "beam.obj"
    trimesh.creation.box((0.1, 0.6, 0.3)).export(file)
    beam = {"type": "mesh", "file": str(file), "position": [0.0, 0.0, 0.95]}
    beam["covering_radius"] = 0.03
    recipe = small_recipe()
    return odm.build_map(replace(recipe, scenery=(*recipe.scenery, beam)))


def test_a_mesh_of_the_recipe_is_heeded_by_nodes_edges_paths_and_questions(
    beside_a_mesh,
):
    planner = odm.ReactivePlanner(beside_a_mesh, always_replan=True)
    beam = [odm.Box((0.1, 0.6, 0.3), pose_of([0.0, 0.0, 0.95], np.zeros(3)))]
    keep = beside_a_mesh.safety.m - 1e-6
    assert not len(beside_a_mesh.scenery.points)  # it is convex: held exactly
    through = planner.is_free(HOME, AWAY)
    assert through.failed == "scenery" and "mesh" in through.reason
    roadmap = beside_a_mesh.roadmap
    for a, b in roadmap.edges[::29]:
        q, dq = roadmap.nodes[a], planner.frame.difference(*roadmap.nodes[[a, b]])
        assert smallest_solid_gap(beside_a_mesh, q, dq, beam, 5) >= keep
    planner.set_goals([AWAY])
    answer = planner.step(NOBODY, q=HOME)
    for a, b in zip(answer.path, answer.path[1:], strict=False):
        assert smallest_solid_gap(beside_a_mesh, a, b - a, beam, 20) >= keep


def test_scenery_of_the_place_must_be_dense_enough(small_map, planner):
    box = odm.Box((0.1, 0.6, 0.3), np.eye(4))
    with pytest.raises(BadInput, match="0.05 m of 'box' is larger than the map's rho"):
        planner.set_static(odm.surface_of(box, 0.05))


def test_scenery_points_outside_the_grid_are_counted(planner):
    planner.set_static(np.array([[9.0, 0, 0], [0, 0, 0.9], [0, -50.0, 0]]))
    assert planner.scene.outside == 2


def test_both_ends_of_a_question_are_checked(planner):
    far = np.array([9.0, 0.0, 0.0])
    for ends, name in (((far, HOME), "q_a"), ((HOME, far), "q_b")):
        verdict = planner.is_free(*ends)
        assert verdict.failed == "limits" and verdict.reason.startswith(name)
    nowhere = np.array([0.0, np.nan, 0.0])
    for ends, name in (((nowhere, HOME), "q_a"), ((HOME, nowhere), "q_b")):
        with pytest.raises(BadInput, match=f"{name} holds NaN"):
            planner.is_free(*ends)


def test_a_motion_only_just_not_free_of_a_solid_is_told_with_that_solid(small_map):
    """Not in contact, but not proved to keep clear: the question must not fail."""
    static = odm.ReactivePlanner(small_map).static
    told = 0
    for k in range(12):
        q = np.array([0.1 * k, 0.6, 0.0])
        dq = np.array([0.3, 1.3, 0.2])
        low, high = 0.0, 1.0
        if static.why(q, high * dq) is None or static.why(q, low * dq) is not None:
            continue
        for _ in range(40):
            middle = 0.5 * (low + high)
            free = static.why(q, middle * dq) is None
            low, high = (middle, high) if free else (low, middle)
        static.work.found[:2] = 10**6  # what another test left there
        told += "floor" in static.why(q, high * dq)
    assert told


def arrays(work, itself):
    """Return all arrays of the scratch of one thread."""
    *own, chords = itself
    return *work, *own, *chords


def test_each_thread_tests_with_scratch_of_its_own(planner):
    static, seen = planner.static, []

    def look():
        seen.append((static.still().scenery.work, static.scratch()))

    look()
    look()
    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    (work, itself), again, other = seen
    assert again[0] is work and again[1] is itself  # nothing is made anew
    for one, two in zip(arrays(work, itself), arrays(*other), strict=True):
        assert not np.shares_memory(one, two)
    loaded = static.carrying(static.robot)
    assert loaded.still().scenery.work is not work
