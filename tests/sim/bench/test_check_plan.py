"""The independent checker finds what is put into a plan, and reads nothing of ours."""

import ast
import copy
from pathlib import Path

import numpy as np
import pytest

from handover.scenes import plan_file
from roadmap.errors import BadInput
from sim.bench.handover import check

ARM = """<robot name="slide">
  <link name="base"><collision><origin xyz="0 0 -0.2"/><geometry>
    <box size="0.1 0.1 0.1"/></geometry></collision></link>
  <link name="car"><collision><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <link name="pin"><collision><geometry>
    <cylinder radius="0.01" length="0.2"/></geometry></collision></link>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="car"/>
    <axis xyz="1 0 0"/><limit lower="-1" upper="1" velocity="0.5" effort="1"/></joint>
  <joint name="turn" type="revolute"><parent link="car"/><child link="pin"/>
    <origin xyz="0 0 0.16"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
</robot>"""


def at(x=0.0, y=0.0, z=0.0):
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T.tolist()


def cube(size):
    import trimesh

    mesh = trimesh.creation.box((size,) * 3)
    return {
        "type": "mesh", "vertices": mesh.vertices.tolist(),
        "faces": mesh.faces.tolist(), "pose": at(),
    }  # fmt: skip


@pytest.fixture
def plan(tmp_path):
    """A giver that carries a cube 0.4 m to a receiver, which keeps it."""
    urdf = tmp_path / "slide.urdf"
    urdf.write_text(ARM)
    joints = {"slide": 0.0, "turn": 0.0}
    agent = {"name": "slide", "urdf": str(urdf), "joints": joints, "arms": ["right"]}
    held = {"touching": ["car"], "link": "car"}
    return {
        "format": plan_file.FORMAT,
        "version": plan_file.VERSION,
        "giver": {**agent, "T_world_base": at()},
        "receiver": {**agent, "T_world_base": at(0.52)},
        "object": {
            "parts": [cube(0.02)], "T_world_start": at(0.06), "T_world_goal": at(0.46)
        },
        "scenery": [{"name": "wall", "type": "box", "size": [0.1, 0.1, 0.1],
                     "pose": at(0.2, 0.12)}],
        "motions": [{"name": "carry", "who": "giver", "joints": ["slide"],
                     "times": [0.0, 1.0], "positions": [[0.0], [0.4]]}],
        "holds": [
            {"who": "giver", **held, "T_link_object": at(0.06), "begin": 0.0,
             "end": 1.0},
            {"who": "receiver", **held, "T_link_object": at(-0.06), "begin": 1.0,
             "end": None},
        ],
    }  # fmt: skip


def test_a_free_plan_is_free_and_distances_are_right(plan):
    found = check.check_plan(plan)
    assert found["ok"], found
    # the wall's face is at y = 0.07, the car a ball of 0.05 about y = 0
    near = found["distances"]
    assert near["giver - scenery"]["distance_m"] == pytest.approx(0.02, abs=1e-3)
    assert near["giver - receiver"]["distance_m"] == pytest.approx(0.02, abs=1e-6)


def test_a_wall_in_the_way_is_found(plan):
    plan["scenery"][0]["pose"] = at(0.2, 0.095)
    found = check.check_plan(plan)
    assert [pair[1:] for pair in found["collisions"]] == [["giver/car", "scenery/wall"]]
    assert not found["ok"]


def test_the_carried_object_meets_a_wall_that_the_arm_does_not(plan):
    plan["scenery"][0] |= {"size": [0.002, 0.002, 0.002], "pose": at(0.47, 0.0, 0.0)}
    met = check.check_plan(plan)["collisions"]
    assert ["object/object 0", "scenery/wall"] in [pair[1:] for pair in met]


def test_the_object_may_touch_the_holding_hand_only(plan):
    plan["holds"][0]["T_link_object"] = at(0.054)  # 6 mm inside the car
    plan["object"]["T_world_start"] = at(0.054)
    plan["motions"][0]["positions"] = [[0.0], [0.406]]
    assert not check.check_plan(plan)["collisions"]
    plan["holds"][0]["touching"] = []
    met = check.check_plan(plan)["collisions"]
    assert [pair[1:] for pair in met] == [["object/object 0", "giver/car"]]


def test_agents_that_meet_are_found(plan):
    plan["receiver"]["T_world_base"] = at(0.49)
    plan["holds"][1]["T_link_object"] = at(-0.03)
    plan["scenery"] = []
    met = [pair[1:] for pair in check.check_plan(plan)["collisions"]]
    assert ["giver/car", "receiver/car"] in met


def test_self_collision_is_found_and_neighbours_are_left_out(plan):
    plan["giver"]["joints"]["turn"] = 0.0
    plan["motions"].append(
        {"name": "fold", "who": "giver", "joints": ["slide", "turn"],
         "times": [1.0, 3.0], "positions": [[0.4, 0.0], [0.4, 2.9]]}
    )  # fmt: skip
    assert not check.check_plan(plan)["collisions"]  # pin and car are neighbours
    urdf = Path(plan["giver"]["urdf"])
    longer = ARM.replace('length="0.2"', 'length="0.7"')
    urdf.write_text(longer)
    met = [pair[1:] for pair in check.check_plan(plan)["collisions"]]
    assert ["giver/base", "giver/pin"] in met


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            lambda p: p["motions"][0].update(positions=[[0.0], [1.4]]),
            "leaves its limits",
        ),
        (lambda p: p["motions"][0].update(times=[0.0, 0.5]), "exceeds 0.5"),
        (lambda p: p["holds"][1].update(T_link_object=at(-0.065)), "slips 5.00 mm"),
        (lambda p: p["object"].update(T_world_goal=at(0.4)), "60.00 mm"),
    ],
)
def test_faults_are_told(plan, change, told):
    change(plan)
    assert any(told in fault for fault in check.check_plan(plan)["faults"])


def test_a_graze_between_two_moments_is_found(plan):
    # moments lie 4 mm apart; the ball cuts the edge for 0.5 mm of its way only
    times = check._Check(plan, check.STEP).at.times
    x = np.interp(times, [0.0, 1.0], [0.0, 0.4])
    k = int(np.searchsorted(x, 0.2))
    at_x, deep = 0.5 * (x[k] + x[k + 1]), 0.05 - np.sqrt(0.05**2 - 0.00025**2)
    plan["scenery"][0] |= {"size": [1e-5, 0.01, 0.01]}
    for depth, met in ((deep, True), (-2e-5, False)):
        plan["scenery"][0]["pose"] = at(at_x, 0.055 - depth)
        found = check.check_plan(plan)
        assert bool(found["collisions"]) == met
    near = found["distances"]["giver - scenery"]
    assert near["proved_m"] == 0.0 < near["distance_m"] < 2e-4


def test_no_bound_hides_what_python_fcl_tells_at_all_moments(plan, rng):
    """Both agents and the cube on random ways: nearest pairs as without any bound."""
    for who, begin in (("giver", 0.0), ("receiver", 1.0)):
        plan["motions"].append(
            {"name": "wave", "who": who, "joints": ["turn"],
             "times": [begin + 0.5 * k for k in range(4)],
             "positions": [[0.0], *rng.uniform(-2.5, 2.5, (3, 1)).tolist()]}
        )  # fmt: skip
    plan["scenery"] += [
        {"name": f"post {k}", "type": "box", "size": [0.02, 0.02, 0.02],
         "pose": at(*rng.uniform([-0.1, 0.06, -0.3], [0.6, 0.2, 0.3]))}
        for k in range(6)
    ]  # fmt: skip
    asked = check._Check(plan, check.STEP)
    found, world, now = asked.run(), asked.world, asked.at
    kinds = {kind: f"{kind[0]} - {kind[1]}" for kind in check._KINDS[:3]}
    assert found["tests"] < 0.2 * len(now.times) * sum(
        len(world.pairs(kind)[0]) for kind in kinds
    )
    checked = 0
    for kind, name in kinds.items():
        least = check.CAP
        for a, b in zip(*world.pairs(kind), strict=True):
            R, p = now.relative(a, b, np.arange(len(now.times)))
            tests = check._Tests(world)
            for k in range(len(now.times)):
                least = min(least, tests.distance(kind, a, b, R[k], p[k], 0.0))
        got = found["distances"].get(name, {"distance_m": check.CAP})["distance_m"]
        assert got <= least + 5e-4  # round solids: python-fcl errs by that much
        assert got >= least - check.STEP
        checked += least < check.CAP
    assert checked >= 2


def test_the_gap_of_two_boxes_is_never_too_large(plan, rng):
    plan["scenery"] = [
        {"name": f"post {k}", "type": "box", "size": rng.uniform(0.01, 0.4, 3).tolist(),
         "pose": at()}
        for k in range(2)
    ]  # fmt: skip
    world = check._World(plan)
    tests, apart = check._Tests(world), 0
    a, b = (k for k, who in enumerate(world.whose) if who == "scenery")
    for _ in range(100):
        R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        R *= np.sign(np.linalg.det(R))
        p = rng.uniform(-0.4, 0.4, 3)
        gap = world.gap(a, b, R[None], p[None])[0]
        assert gap <= tests.distance(("scenery", "scenery"), a, b, R, p, 0.0) + 1e-6
        apart += gap > 0.0
    assert apart > 30


def test_its_links_stand_where_ours_do(rng):
    import handover
    from handover.scenes.agent_body import agent_body

    scene = handover.load_scene("kneeling", 0)
    record = plan_file.plan_record(scene, [], [plan_file.Hold(
        "world", "", scene.T_world_start, 0.0, None)])  # fmt: skip
    body = agent_body(scene.giver.agent.source)
    low, high = np.array([body.limits[name] for name in body.joints]).T
    drawn = dict(zip(body.joints, rng.uniform(low, high).tolist(), strict=True))
    record["giver"]["joints"] = drawn
    links = check._World(record).at(np.zeros(1)).links
    base = np.array(record["giver"]["T_world_base"])
    for link, T in body.frames(drawn).items():
        R, p = links["giver", link]
        np.testing.assert_allclose(R[0], (base @ T)[:3, :3], atol=1e-9)
        np.testing.assert_allclose(p[0], (base @ T)[:3, 3], atol=1e-9)


def test_it_imports_nothing_of_ours():
    tree = ast.parse(Path(check.__file__).read_text())
    names = {
        (node.module if isinstance(node, ast.ImportFrom) else alias.name).split(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    assert not names & {"roadmap", "odm", "handover", "sim"}


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda p: p.update(version=9), "make one with"),
        (lambda p: p["holds"].pop(0), "nothing holds the object from 0"),
        (lambda p: p["holds"].pop(), "nothing holds|let the last hold"),
        (lambda p: p["motions"][0].update(times=[1.0, 0.0]), "do not grow"),
        (
            lambda p: p["motions"][0].update(positions=[[0.1], [0.4]]),
            "begins with slide",
        ),
        (lambda p: p["motions"][0].update(joints=["elbow"]), "does not have"),
        (lambda p: p["motions"][0].update(positions=[[0.0]]), "a row for each time"),
    ],
)
def test_a_record_that_contradicts_itself_is_refused(plan, tmp_path, change, told):
    path = plan_file.write_plan(tmp_path / "plan.json", plan)
    assert plan_file.read_plan(path) == plan
    wrong = copy.deepcopy(plan)
    wrong["motions"].append(
        {"name": "wait", "who": "giver", "joints": ["slide"], "times": [2.0],
         "positions": [[0.4]]}
    )  # fmt: skip
    wrong["holds"][0]["end"] = 1.0
    change(wrong)
    if told.startswith("nothing holds|"):
        wrong["holds"] = wrong["holds"][:1]
    with pytest.raises(BadInput, match=told):
        plan_file.check_record(wrong)
