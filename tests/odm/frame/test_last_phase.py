"""The last phase: what may touch the receiving hand, and what the object to grasp."""

import numpy as np
import pytest

import odm
from odm.cell_map.recipe import PayloadRecipe, Recipe, RobotRecipe
from odm.close_test.safety import Safety
from odm.exact.distances import ExactRobot, obstacles_of
from odm.frame.last_phase import LastPhase
from odm.obstacles.obstacles import SolidRoom
from roadmap.errors import BadInput
from roadmap.graph.connecting import RoadmapSettings
from roadmap.kinematics.forward import difference, tool_pose
from roadmap.loading.held_link import PAYLOAD, with_payload

URDF = """<robot name="pincer">
<link name="base"><collision><geometry><sphere radius="0.04"/></geometry></collision>
</link>
<link name="upper"><collision><origin xyz="0.2 0 0"/><geometry>
<box size="0.4 0.06 0.06"/></geometry></collision></link>
<link name="fore"><collision><origin xyz="0.13 0 0"/><geometry>
<box size="0.3 0.05 0.05"/></geometry></collision></link>
<link name="palm"><collision><geometry><box size="0.04 0.14 0.04"/></geometry>
</collision></link>
<link name="left"><collision><origin xyz="0.05 0 0"/><geometry>
<box size="0.06 0.02 0.02"/></geometry></collision></link>
<link name="right"><collision><origin xyz="0.05 0 0"/><geometry>
<box size="0.06 0.02 0.02"/></geometry></collision></link>
<link name="tool"/>
<joint name="swing" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="bend" type="revolute"><parent link="upper"/><child link="fore"/>
<origin xyz="0.42 0 0"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
<joint name="wrist" type="revolute"><parent link="fore"/><child link="palm"/>
<origin xyz="0.32 0 0"/><axis xyz="0 0 1"/>
<limit lower="-1.2" upper="1.2" velocity="1" effort="1"/></joint>
<joint name="l" type="fixed"><parent link="palm"/><child link="left"/>
<origin xyz="0 0.05 0"/></joint>
<joint name="r" type="fixed"><parent link="palm"/><child link="right"/>
<origin xyz="0 -0.05 0"/></joint>
<joint name="t" type="fixed"><parent link="palm"/><child link="tool"/>
<origin xyz="0.1 0 0" rpy="0 1.5707963 0"/></joint>
</robot>
"""
PADS = ("left", "right")
HELD = np.array([[0.0, 0.0, 0.02, 0.04]])  # between the fingers and beyond
Q, STILL = np.zeros(3), np.zeros(3)
SPACING = 0.004


@pytest.fixture(scope="module")
def cell_map(tmp_path_factory):
    urdf = tmp_path_factory.mktemp("pincer") / "pincer.urdf"
    urdf.write_text(URDF)
    return odm.build_map(
        Recipe(
            "pincer",
            RobotRecipe(str(urdf), tip="tool"),
            RoadmapSettings(nodes=80, neighbors=6),
            Safety(h=0.05),
            payload=PayloadRecipe(radius=0.07, position=(0.0, 0.0, 0.02)),
        )
    )


@pytest.fixture
def planner(cell_map):
    return odm.ReactivePlanner(cell_map, settings=odm.PlannerSettings(finger_pads=PADS))


def look_at(planner, shapes, classes, q=Q):
    """Show shapes to the planner, each of one class."""
    parts = [odm.surface_of(shape, SPACING).points for shape in shapes]
    kinds = [np.full(len(p), c) for p, c in zip(parts, classes, strict=True)]
    planner.step(
        np.concatenate(parts), q, covering_radius=SPACING,
        classes=np.concatenate(kinds),
    )  # fmt: skip


def ball(planner, forward, side=0.0, radius=0.02, q=Q):
    """Return a ball at a place before the tool at q [m]."""
    T = tool_pose(planner.robot, q)
    p = T[:3, 3] + forward * T[:3, 2] + side * T[:3, 1]
    return odm.Sphere(radius, _at(p))


def test_only_contact_points_may_touch_the_payload_and_only_in_a_give(planner):
    planner.attach(HELD)
    hand = ball(planner, 0.07)  # 1 cm into the payload
    for kind, phase, want in [
        (odm.CONTACT, "give", True),
        (odm.CONTACT, None, False),
        (odm.AVOID, "give", False),
        (odm.OBJECT, "give", False),
        (odm.CONTACT, "receive", False),
    ]:
        look_at(planner, [hand], [kind])
        freedom = planner.is_free(Q, Q, phase=phase)
        assert bool(freedom) == want, (kind, phase)
        assert want or "payload" in freedom.reason
        blocked = planner.blocked_leg(Q[None], phase=phase)
        assert (blocked is None) == want


def test_only_object_points_may_touch_the_pads_and_only_in_a_receive(planner):
    thing = ball(planner, 0.0, 0.05)  # at a finger's tip
    for kind, phase, want in [
        (odm.OBJECT, "receive", True),
        (odm.OBJECT, None, False),
        (odm.AVOID, "receive", False),
        (odm.CONTACT, "receive", False),
    ]:
        look_at(planner, [thing], [kind])
        freedom = planner.is_free(Q, Q, phase=phase)
        assert bool(freedom) == want, (kind, phase)
        assert want or any(pad in freedom.reason for pad in PADS)
    # the palm is no pad
    look_at(planner, [ball(planner, -0.07)], [odm.OBJECT])
    assert "palm" in planner.is_free(Q, Q, phase="receive").reason


@pytest.mark.parametrize(("phase", "kind"), [("give", 1), ("receive", 2)])
def test_all_others_keep_their_distance_by_exact_geometry(cell_map, rng, phase, kind):
    """Free motions: arm m, gripper 1 cm, and only what may touch does."""
    settings = odm.PlannerSettings(finger_pads=PADS, extra_clearance=0.01)
    planner = odm.ReactivePlanner(cell_map, settings=settings)
    robot = cell_map.robot
    if phase == "give":
        planner.attach(HELD)
        robot = with_payload(robot, HELD)
    exact, names = ExactRobot(robot), robot.link_names
    links = np.array([names[k] for k in robot.solid_link])
    may = np.isin(links, [PAYLOAD] if phase == "give" else PADS)
    gripper = np.isin(links, ["palm", *PADS]) & ~may
    arm = np.isin(links, ["upper", "fore"])
    touched = freed = 0
    for _ in range(300):
        q = rng.uniform(-0.5, 0.5, 3)
        end = q + rng.normal(size=3) * 0.03
        thing = ball(
            planner, rng.uniform(-0.1, 0.12), rng.uniform(-0.1, 0.1), 0.02, end
        )
        look_at(planner, [thing], [kind], q)
        if not planner.is_free(q, end, phase=phase):
            continue
        freed += 1
        obstacle = obstacles_of([thing])
        for t in (0.0, 0.5, 1.0):
            at = q + t * difference(robot, q, end)
            assert exact.distance_of(gripper, at, obstacle).distance >= 0.01
            need = cell_map.safety.m + 0.01
            assert exact.distance_of(arm, at, obstacle).distance >= need
            touched += exact.distance_of(may, at, obstacle).distance <= 0.0
    assert freed > 30 and touched > 10


def test_the_arm_heeds_every_point_in_every_phase(planner):
    planner.attach(HELD)
    elbow = odm.Sphere(0.02, _at([0.5, 0.05, 0.0]))
    for kind in (odm.AVOID, odm.CONTACT, odm.OBJECT):
        look_at(planner, [elbow], [kind])
        for phase in (None, "give", "receive"):
            assert "fore" in planner.is_free(Q, Q, phase=phase).reason
            assert planner.blocked_leg(Q[None], phase=phase) == 0


def test_the_gripper_keeps_a_centimetre_whatever_the_clearance(cell_map):
    """1 cm from the palm's front is free, 0.5 cm is not; both with a large extra."""
    settings = odm.PlannerSettings(finger_pads=PADS, extra_clearance=0.05)
    planner = odm.ReactivePlanner(cell_map, settings=settings)
    palm = np.array([0.74, 0.0, 0.0])  # its middle at Q
    for gap, want in ((0.05, True), (0.005, False)):
        thing = odm.Box([0.02, 0.02, 0.02], _at(palm + [0.02 + gap + 0.01, 0, 0]))
        look_at(planner, [thing], [odm.OBJECT])
        freedom = planner.is_free(Q, Q, phase="receive")
        assert bool(freedom) == want, freedom.reason
        assert not planner.is_free(Q, Q)


def test_how_far_points_may_be_apart_counts_for_the_gripper_too(planner):
    """A point 3.5 cm beside the palm, of a surface sampled densely, or within rho."""
    planner.attach(HELD)
    point = np.array([[0.72, 0.105, 0.0]])
    for radius, free in ((SPACING, True), (None, False), (SPACING, True)):
        planner.step(point, Q, covering_radius=radius, classes=[odm.CONTACT])
        freedom = planner.is_free(Q, Q, phase="give")
        assert bool(freedom) == free
        assert free or "palm" in freedom.reason


def test_what_is_nowhere_blocks_in_a_phase_too(planner):
    planner.attach(HELD)
    planner.step(np.zeros((0, 3)), Q)
    far, nowhere = np.array([[0.0, 0.0, 2.0]]), np.full((1, 3), np.nan)
    wrong = odm.Obstacles(capsules=np.full((1, 7), np.nan), points=far)
    for points, leg in ((far, None), (nowhere, 0), (wrong, 0)):
        assert planner.blocked_leg(Q[None], points=points, phase="give") == leg


def test_what_is_too_near_may_be_left_and_not_approached(planner):
    """With `escape` the palm leaves an object that touches it; else it may not move."""
    q, bend = np.array([0.4, -0.8, 0.4]), np.array([0.1, -0.2, 0.1])
    shapes = odm.Obstacles.of([ball(planner, -0.07, q=q)])
    shapes.shape_classes = np.full(1, odm.OBJECT, np.int8)
    free = [
        planner.blocked_leg(
            np.array([q, q + way]), 0.0, shapes, "receive", None, escape
        )
        is None
        for way in (bend, -bend)
        for escape in (False, True)
    ]
    assert free == [False, True, False, False]


def test_a_path_is_blocked_at_the_first_of_its_legs_that_is(planner, rng):
    test, cover, found = LastPhase(planner.frame), planner.cover(), []
    for _ in range(60):
        path = np.cumsum([rng.uniform(-0.5, 0.5, 3), *rng.normal(0, 0.1, (4, 3))], 0)
        balls = [ball(planner, *rng.uniform(-0.15, 0.1, 2), q=path[0]) for _ in "12"]
        shapes = odm.Obstacles.of(balls, np.array([balls[0].T_base_shape[:3, 3]]))
        kinds = rng.choice([odm.AVOID, odm.OBJECT], 3).astype(np.int8)
        solids = SolidRoom().of(shapes, np.eye(4))
        test.look("receive", shapes.points, kinds[:1], solids, kinds[1:])
        for escape in (False, True):
            legs = zip(path, np.diff(path, axis=0), strict=False)
            hits = [test.hit(cover, q, dq, -0.01, escape) for q, dq in legs]
            first = next((k for k, hit in enumerate(hits) if hit is not None), None)
            assert test.first_hit(cover, path, -0.01, escape) == first
            found.append(first)
    stays, escapes = found[::2], found[1::2]
    assert {None, 0} < set(stays) and {None, 0} < set(escapes)
    assert stays != escapes


def test_the_search_heeds_all_classes(planner):
    """Classes change no answer of a frame: only the last centimetres are exempt."""
    goal = np.array([0.8, -0.3, 0.2])
    shape = odm.Sphere(0.05, _at([0.6, 0.3, 0.0]))
    points = odm.surface_of(shape, 0.02).points
    found = []
    for classes in (None, np.full(len(points), odm.CONTACT)):
        other = odm.ReactivePlanner(planner.cell_map)
        other.set_goals([goal])
        answer = other.step(points, -goal, classes=classes)
        found.append((answer.status, answer.path.tobytes()))
    assert found[0] == found[1]


@pytest.mark.parametrize("fine", [False, True])
def test_an_approach_ends_at_the_hand_only_in_a_give(cell_map, fine):
    from odm.approach.approach import Approacher, ApproachSettings

    planner = odm.ReactivePlanner(cell_map)
    planner.attach(HELD)
    approacher = Approacher(planner.frame, ApproachSettings(use_fine_cover=fine))
    bend = np.array([-0.6, 1.2, 0.0])
    end = np.array([-0.55, 1.1, 0.0])
    T = tool_pose(cell_map.robot, end)
    hand = ball(planner, 0.075, q=end)
    look_at(planner, [hand], [odm.CONTACT], bend)
    q = _behind(cell_map.robot, end, 0.04)
    closed = approacher.run(T, q)
    open_ = approacher.run(T, q, phase="give")
    assert not closed and "payload" in closed.reason
    assert open_, open_.reason
    look_at(planner, [hand], [odm.AVOID], bend)
    assert not approacher.run(T, q, phase="give")


@pytest.mark.parametrize(
    ("classes", "words"),
    [
        (np.zeros(3, int), "for 24 points"),
        (np.zeros(24), "dtype float64"),
        (np.full(24, 3), "a point has class 3"),
        (np.full(24, -1), "a point has class -1"),
    ],
)
def test_bad_classes_are_refused(planner, classes, words):
    points = np.random.default_rng(0).uniform(2, 3, (24, 3))
    with pytest.raises(BadInput, match=words):
        planner.step(points, Q, classes=classes)
    planner.step(points, Q, classes=np.ones(24, np.uint8))


def test_a_frame_that_was_refused_leaves_the_classes_of_the_last_one(planner):
    planner.attach(HELD)
    row = np.array([[*ball(planner, 0.07).T_base_shape[:3, 3], 0.03]])
    corners = 30.0 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    wall = odm.Mesh.hull_of(corners, np.eye(4))  # too large to be sampled
    told = {"classes": {"spheres": [odm.CONTACT]}}
    planner.step(odm.Obstacles(spheres=row), Q)
    for bad, rounding in [
        (odm.Obstacles(spheres=row, **told), -1.0),
        (odm.Obstacles(spheres=row, meshes=[wall], **told), None),
    ]:
        with pytest.raises(BadInput, match="rounding|mesh"):
            planner.step(bad, Q, rounding=rounding)
        assert not planner.is_free(Q, Q, phase="give")
    points = odm.surface_of(ball(planner, 0.07), SPACING).points
    planner.step(points, Q)
    with pytest.raises(BadInput, match="rounding"):
        planner.step(points[:2], Q, rounding=-1.0, classes=np.full(2, odm.CONTACT))
    assert not planner.is_free(Q, Q, phase="give")


@pytest.mark.parametrize("take", ["step", "step again", "see", "load"])
def test_classes_that_are_written_for_the_next_frame_change_no_question(planner, take):
    thing = odm.Obstacles.of([ball(planner, 0.0, 0.05)])  # at a finger's tip

    def may_touch():
        free = bool(planner.is_free(Q, Q, phase="receive"))
        assert (planner.blocked_leg(Q[None], phase="receive") is None) == free
        return free

    for told in (odm.AVOID, odm.OBJECT):
        thing.shape_classes[:] = odm.OBJECT - told
        planner.step(thing, q=Q)
        thing.shape_classes[:] = told
        for _ in range(2 if take == "step again" else 1):
            planner.see(thing, q=Q) if take == "see" else planner.step(thing, q=Q)
        if take == "load":
            saved = planner.save_memory()
            planner.step(thing, q=Q, stamp=0.0, now=9.0)
            planner.load_memory(saved)
        assert may_touch() == (told == odm.OBJECT)
        thing.shape_classes[:] = odm.OBJECT - told
        assert may_touch() == (told == odm.OBJECT)


def test_a_phase_that_cannot_be_is_refused(cell_map, planner):
    with pytest.raises(BadInput, match="choose 'give' or 'receive'"):
        planner.is_free(Q, Q, phase="take")
    with pytest.raises(BadInput, match=r"no phase \['give'\]; choose"):
        planner.is_free(Q, Q, ["give"])
    with pytest.raises(BadInput, match="nothing is attached"):
        planner.blocked_leg(Q[None], phase="give")
    bare = odm.ReactivePlanner(cell_map)
    with pytest.raises(BadInput, match=r"left, palm, right; name them in Planner"):
        bare.approach(np.eye(4), q=Q, phase="receive")
    wrong = odm.PlannerSettings(finger_pads=("thumb",))
    with pytest.raises(BadInput, match="thumb"):
        odm.ReactivePlanner(cell_map, settings=wrong).is_free(Q, Q, phase="receive")


def _behind(robot, q, length):
    """Return where the tool is `length` back along its own way [rad]."""
    T = tool_pose(robot, q)
    T[:3, 3] -= length * T[:3, 2]
    (best, *_) = sorted(robot.ik(T, q), key=lambda found: np.abs(_q(found) - q).max())
    return _q(best)


def _q(found):
    return np.asarray(getattr(found, "q", found), float)


def _at(p):
    T = np.eye(4)
    T[:3, 3] = p
    return T


def test_a_phase_that_cannot_be_is_refused_whatever_else_says_no(planner):
    far = np.full(3, 9.0)
    planner.step(np.full((1, 3), np.nan), Q)
    with pytest.raises(BadInput, match="choose 'give' or 'receive'"):
        planner.is_free(Q, Q, "bogus")
    with pytest.raises(BadInput, match="choose 'give' or 'receive'"):
        planner.is_free(far, Q, "bogus")
    for extra, points in ((0.0, None), (np.nan, None), (0.0, np.full((1, 3), np.nan))):
        with pytest.raises(BadInput, match="nothing is attached"):
            planner.blocked_leg(Q[None], extra, points, phase="give")


@pytest.mark.parametrize("phase", [None, "give", "receive"])
def test_shapes_in_one_call_block_what_each_of_them_blocks(planner, rng, phase):
    """With one far point beside them they are looked at one by one."""
    if phase == "give":
        planner.attach(HELD)
    far, found = np.array([[0.0, 0.0, 5.0]]), []
    for _ in range(120):
        path = np.cumsum([rng.uniform(-0.5, 0.5, 3), *rng.normal(0, 0.1, (3, 3))], 0)
        path = path[: rng.integers(1, 5)]
        places = [ball(planner, *rng.uniform(-0.2, 0.15, 2), q=path[0]) for _ in "123"]
        rods = np.array([[*b.T_base_shape[:3, 3]] * 2 + [0.02] for b in places])
        rods[:, 5] += 0.1
        kinds = rng.integers(0, 3, 3).astype(np.int8)
        extra, escape = (
            rng.choice([-0.01, 0.0]),
            phase is not None and rng.random() < 0.5,
        )
        legs = []
        for points in (None, far):
            shapes = odm.Obstacles(capsules=rods, points=points)
            shapes.shape_classes[:] = kinds
            legs.append(planner.blocked_leg(path, extra, shapes, phase, None, escape))
        assert legs[0] == legs[1]
        found.append(legs[0])
    assert {None, 0} < set(found)


def test_what_is_held_out_may_be_nearer_by_so_much_as_is_said(planner):
    """Shapes of the class OBJECT alone, and no more than that leaves them."""
    rod = np.array([[0.9, 0.0, 0.0, 0.9, 0.0, 0.1, 0.02]])
    shapes = [odm.Obstacles(capsules=rod) for _ in "ab"]
    shapes.append(odm.Obstacles(capsules=rod, points=np.array([[0.0, 0.0, 5.0]])))
    gap = min(
        extra
        for extra in np.linspace(-0.01, 0.3, 600)
        if planner.blocked_leg(Q[None], extra, shapes[0]) == 0
    )
    for given, kind in zip(shapes, (odm.OBJECT, odm.CONTACT, odm.OBJECT), strict=True):
        given.shape_classes[:] = kind
        legs = [
            planner.blocked_leg(Q[None], gap, given, nearer=x) for x in (0.0, 0.002)
        ]
        assert legs == [0, None if kind == odm.OBJECT else 0]
        assert planner.blocked_leg(Q[None], gap + 0.003, given, nearer=0.002) == 0
    with pytest.raises(BadInput, match="takes away more than the clearance"):
        planner.blocked_leg(Q[None], -0.009, shapes[0], nearer=0.002)


@pytest.mark.parametrize(
    "nearer", [np.nan, np.inf, -0.001, None, "1", True, np.ones(2)]
)
def test_how_much_nearer_must_be_a_number_and_in_no_phase(planner, nearer):
    with pytest.raises(BadInput, match=r"nearer \[m\]"):
        planner.blocked_leg(Q[None], 0.0, odm.Obstacles(spheres=1), nearer=nearer)
    for given in (nearer, 0.001):  # a phase tells itself what may touch
        with pytest.raises(BadInput, match="in the phase 'receive'"):
            planner.blocked_leg(Q[None], phase="receive", nearer=given)
