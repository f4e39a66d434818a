"""Fingers over their whole travel: the hulls and the cover hold every position."""

import numpy as np
import pytest
from nearest import out_of_spheres

import odm
from odm.cell_map.recipe import Recipe, RobotRecipe, parse_recipe, recipe_of_map
from odm.close_test.safety import Safety
from odm.exact.distances import ExactRobot, obstacles_of
from roadmap import load_robot
from roadmap.errors import BadRecipe, BadRobot
from roadmap.graph.connecting import RoadmapSettings
from roadmap.kinematics.forward import difference

URDF = """<robot name="claw">
<link name="base"><collision><geometry><sphere radius="0.04"/></geometry></collision>
</link>
<link name="arm"><collision><origin xyz="0.15 0 0"/><geometry>
<box size="0.24 0.05 0.05"/></geometry></collision></link>
<link name="slider"><collision><origin xyz="0.03 0.01 0" rpy="0.2 0.3 0.4"/><geometry>
<box size="0.06 0.02 0.03"/></geometry></collision></link>
<link name="hook"><collision><origin xyz="0.05 0 0" rpy="0 1.5707963 0"/><geometry>
<cylinder radius="0.01" length="0.1"/></geometry></collision></link>
<link name="nail"><collision><origin xyz="0.01 0 0"/><geometry>
<sphere radius="0.012"/></geometry></collision></link>
<link name="tool"/>
<joint name="swing" type="revolute"><parent link="base"/><child link="arm"/>
<axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="slider"/>
<origin xyz="0.27 0.03 0" rpy="0 0.3 0.2"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.05" velocity="1" effort="1"/></joint>
<joint name="turn" type="revolute"><parent link="arm"/><child link="hook"/>
<origin xyz="0.27 -0.03 0"/><axis xyz="0 0 1"/>
<limit lower="-0.9" upper="0.4" velocity="1" effort="1"/></joint>
<joint name="end" type="fixed"><parent link="hook"/><child link="nail"/>
<origin xyz="0.1 0 0.01"/></joint>
<joint name="t" type="fixed"><parent link="arm"/><child link="tool"/>
<origin xyz="0.32 0 0"/></joint>
</robot>
"""
FINGERS = ("slider", "hook", "nail")
TRAVEL = ("slide", "turn")


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    path = tmp_path_factory.mktemp("claw") / "claw.urdf"
    path.write_text(URDF)
    return path


@pytest.fixture(scope="module")
def robot(urdf):
    return load_robot(urdf, tip="tool", travel=TRAVEL)


def at(urdf, slide, turn):
    return load_robot(urdf, tip="tool", locked={"slide": slide, "turn": turn})


def solid_points(robot, rng, n=40):
    """Return points inside the solids of the fingers at their values, body frame."""
    from roadmap.robot.robot import BOX, CYLINDER, SPHERE

    found = []
    for i, kind in enumerate(robot.solid_kind):
        if robot.link_names[robot.solid_link[i]] not in FINGERS:
            continue
        u = rng.uniform(-1, 1, (n, 3))
        size = robot.solid_size[i]
        if kind == BOX:
            p = 0.5 * u * size
        elif kind == CYLINDER:
            wide = np.linalg.norm(u[:, :2], axis=1)
            around = u[:, :2] / np.maximum(1.0, wide)[:, None]
            p = np.column_stack([size[0] * around, 0.5 * size[1] * u[:, 2]])
        else:
            assert kind == SPHERE
            p = size[0] * u / np.maximum(1.0, np.linalg.norm(u, axis=1))[:, None]
        T = robot.solid_pose[i]
        found.append(p @ T[:3, :3].T + T[:3, 3])
    return np.concatenate(found)


def test_hulls_and_cover_hold_the_fingers_wherever_they_are(urdf, robot, rng):
    from scipy.spatial import ConvexHull

    hulls = [
        ConvexHull(robot.solid_points[a:b]).equations
        for a, b in zip(robot.solid_ptr, robot.solid_ptr[1:], strict=False)
        if b > a
    ]
    assert len(hulls) >= 2 + 2 * 2  # of an arc several
    for _ in range(12):
        value = rng.uniform([0.0, -0.9], [0.05, 0.4])
        points = solid_points(at(urdf, *value), rng)
        inside = np.min(
            [(points @ e[:, :3].T + e[:, 3]).max(axis=1) for e in hulls], axis=0
        )
        assert inside.max() <= 1e-9
        spheres = robot.spheres[robot.sphere_body > 0]
        assert out_of_spheres(points, spheres).max() <= 1e-9


def test_one_position_would_not_do(urdf, robot, rng):
    fixed = at(urdf, 0.0, 0.0)
    points = solid_points(at(urdf, 0.05, -0.9), rng)
    spheres = fixed.spheres[fixed.sphere_body > 0]
    assert out_of_spheres(points, spheres).max() > 0.02


def test_a_free_edge_keeps_every_opening_off_an_obstacle(urdf, rng):
    recipe = Recipe(
        "claw",
        RobotRecipe(str(urdf), tip="tool", travel=TRAVEL),
        RoadmapSettings(nodes=30, neighbors=4),
        Safety(h=0.04),
    )
    cell_map = odm.build_map(recipe)
    planner, roadmap = odm.ReactivePlanner(cell_map), cell_map.roadmap
    opened = [ExactRobot(at(urdf, *v)) for v in ((0, -0.9), (0.05, 0.4), (0.02, 0.0))]
    ends, near = roadmap.nodes[roadmap.edges], 0
    for _ in range(60):
        angle = rng.uniform(-2, 2)
        p = rng.uniform(0.3, 0.45) * np.array([np.cos(angle), np.sin(angle), 0.0])
        ball = odm.Sphere(0.02, _at(p))
        planner.step(odm.surface_of(ball, 0.03).points, np.zeros(1))
        open_ = np.setdiff1d(np.arange(roadmap.n_edges), planner.invalid_edges())
        for edge in rng.permutation(open_)[:10]:
            q = ends[edge, 0] + rng.random() * difference(cell_map.robot, *ends[edge])
            for exact in opened:
                gap = exact.distance(q, obstacles_of([ball])).distance
                assert gap >= cell_map.safety.m
                near += gap < 0.15
    assert near > 30


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"travel": ("grip",)}, "no joint 'grip' to travel"),
        ({"travel": ("swing",)}, "'swing' moves the tool"),
        ({"travel": ("slide",), "locked": {"slide": 0.0}}, "is locked and travels"),
        ({"travel": ("turn",), "tip": "nail", "locked": {"turn": 0.0}}, "choose one"),
    ],
)
def test_a_travel_that_cannot_be_is_refused(urdf, options, words):
    with pytest.raises(BadRobot, match=words):
        load_robot(urdf, **{"tip": "tool", **options})


def test_a_follower_is_named_by_its_driver():
    with pytest.raises(BadRobot, match="mimics 'left_finger'; name 'left_finger'"):
        load_robot("rail_arm", travel=("right_finger",))


def test_the_recipe_keeps_it_and_old_recipes_are_as_they_were():
    table = {"robot": {"source": "rail_arm", "travel": ["left_finger"]}}
    recipe = parse_recipe(table, "rail")
    assert recipe.robot.travel == ("left_finger",)
    assert parse_recipe(recipe.as_dict(), "rail") == recipe
    auto = parse_recipe({}, "plain")
    assert auto.robot.travel is None and auto.as_dict()["robot"]["travel"] == "auto"
    for asked in (recipe, auto, parse_recipe({"robot": {"travel": []}}, "still")):
        assert parse_recipe(asked.as_dict(), "x") == asked
        assert recipe_of_map(asked.for_map()) == asked
    # an old map says nothing of travel: its fingers stand still
    old = recipe_of_map({"name": "old", "robot": {"source": "rail_arm"}})
    assert old.robot.travel == () and "travel" not in old.for_map()["robot"]
    with pytest.raises(BadRecipe, match="robot.travel is 'left_finger'"):
        parse_recipe({"robot": {"travel": "left_finger"}}, "rail")


def test_both_pads_of_a_known_gripper_travel():
    robot = load_robot("rail_arm", travel=("left_finger",))
    assert "held over the whole travel of left_finger" in robot.notes
    own = [robot.link_names.index(n) for n in ("left_pad", "right_pad")]
    for link, far in zip(own, (0.04, -0.04), strict=True):
        spheres = robot.spheres[robot.sphere_link == link]
        reach = spheres[:, 1] + np.sign(far) * spheres[:, 3]
        assert np.sign(far) * reach.max() >= far if far > 0 else reach.min() <= far


def _at(p):
    T = np.eye(4)
    T[:3, 3] = p
    return T
