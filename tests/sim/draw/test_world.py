"""The pybullet world agrees with exact geometry, and its absence is explained."""

import sys

import numpy as np
import pytest
from command_line import started

from handover.human.body import JOINTS, BodySizes, Part, UpperBody
from handover.human.human import Human
from odm import Box
from roadmap import load_robot, tool_pose
from sim.draw.cover_world import CoverWorld
from sim.draw.style import SKIN, SLEEVE, person_colours
from sim.draw.surroundings import all_triangles, capsule_mesh
from sim.draw.viewpoint import Camera
from sim.draw.world import SimulatorMissing, World, connected
from sim.loop.loop import exact_audit

CAMERA = Camera(width=160, height=120)
HAND = np.array([[0.5, -0.2, 0.4, 0.7, 0.0, 0.5, 0.06]])


def separation(world):
    """Return pybullet's distance of robot and person, with margins of its own [m]."""
    measure, robot = world._bullet.getClosestPoints, world._robot
    pairs = [pair for body in world._person for pair in measure(robot, body, 1.0)]
    return min([1.0, *(pair[8] for pair in pairs)])


def test_contact_of_pybullet_agrees_with_the_exact_distance(crane, crane_urdf):
    pytest.importorskip("pybullet")
    exact, rng, signs = exact_audit(crane), np.random.default_rng(0), []
    with World(crane_urdf, crane) as world:
        for _ in range(120):
            q = rng.uniform(-1, 1, 2)
            a = rng.uniform([0.35, -0.5, 0.3], [0.8, 0.5, 0.5])
            b = a + rng.uniform(-0.2, 0.2, 3)
            capsules = np.r_[a, b, rng.uniform(0.03, 0.08)][None]
            world.place(q, capsules)
            truth = exact(q, capsules)
            # pybullet keeps a margin of its own and counts the base as well
            if abs(truth) > 0.003 and np.hypot(*a[:2]) > 0.3:
                signs.append((truth > 0, separation(world) > 0))
    signs = np.array(signs)
    assert (signs[:, 0] == signs[:, 1]).all()
    assert 0.05 < signs[:, 0].mean() < 0.95


def test_distances_of_pybullet_agree_within_its_margins(crane, crane_urdf):
    pytest.importorskip("pybullet")
    exact = exact_audit(crane)
    with World(crane_urdf, crane) as world:
        for slew in np.linspace(0.4, 1.2, 9):
            world.place([slew, 0.2], HAND)
            truth = exact([slew, 0.2], HAND)
            assert separation(world) == pytest.approx(truth, abs=4e-3)


def test_locked_joints_stand_where_they_are_locked(crane_urdf):
    pytest.importorskip("pybullet")
    locked = {"luff": 0.8}
    robot = load_robot(crane_urdf, tip="jib", locked=locked)
    exact = exact_audit(robot)
    with World(crane_urdf, robot, locked) as world:
        for slew in np.linspace(0.2, 1.0, 7):
            world.place([slew], HAND)
            truth = exact(np.array([slew]), HAND)
            assert separation(world) == pytest.approx(truth, abs=4e-3)
    low = HAND - [0, 0, 0.3, 0, 0, 0.3, 0]
    with World(crane_urdf, robot) as world:  # at 0 the jib is elsewhere
        world.place([-0.1], low)
        assert abs(separation(world) - exact(np.array([-0.1]), low)) > 0.02


def test_fingers_are_shown_within_their_travel(rng):
    """Both pads stand where a known robot has them: the map's hulls hold them."""
    pytest.importorskip("pybullet")
    robot = load_robot("rail_arm", cover_excess=0.05)
    assert "held over the whole travel of left_finger" in robot.notes
    exact, nearer = exact_audit(robot), []
    opened = exact_audit(load_robot("rail_arm", cover_excess=0.05, travel=()))
    with World("rail_arm", robot) as world:
        for _ in range(150):
            q = rng.uniform(robot.lower, robot.upper)
            tool = tool_pose(robot, q)[:3, 3] + rng.uniform(-0.1, 0.1, 3)
            hand = np.r_[tool, tool + rng.uniform(-0.1, 0.1, 3), 0.02][None]
            world.place(q, hand)
            gap, truth = separation(world), exact(q, hand)
            # pybullet counts the base as well: stay above it
            if truth > 0.005 and min(hand[0, 2], hand[0, 5]) > 0.3:
                assert gap == pytest.approx(opened(q, hand), abs=4e-3)
                nearer.append(gap - truth)
    assert len(nearer) > 20 and min(nearer) > -4e-3 and max(nearer) > 0.01


def test_followers_move_with_what_they_follow(tmp_path):
    """A bar that is pushed down by one joint and turned up again by its follower."""
    pytest.importorskip("pybullet")
    path = tmp_path / "bars.urdf"
    path.write_text(FOLLOWER)
    robot = load_robot(path, tip="tool", cover_excess=0.1)
    exact = exact_audit(robot)
    hand = np.array([[0.5, 0.0, 0.3, 0.7, 0.0, 0.3, 0.03]])
    with World(path, robot) as world:
        for q in np.linspace(-0.8, 0.8, 7):
            world.place([q], hand)
            assert separation(world) == pytest.approx(exact([q], hand), abs=4e-3)


FOLLOWER = """<robot name="bars">
<link name="base"/>
<link name="upper"><collision><origin xyz="0.15 0 0"/><geometry>
<box size="0.3 0.04 0.04"/></geometry></collision></link>
<link name="fore"><collision><origin xyz="0.15 0 0"/><geometry>
<box size="0.3 0.04 0.04"/></geometry></collision></link>
<link name="tool"/>
<joint name="down" type="revolute"><parent link="base"/><child link="upper"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="up" type="revolute"><parent link="upper"/><child link="fore"/>
<origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="1" effort="1"/>
<mimic joint="down" multiplier="-1.5" offset="0.1"/></joint>
<joint name="t" type="fixed"><parent link="fore"/><child link="tool"/>
<origin xyz="0.3 0 0"/></joint>
</robot>
"""


def test_a_connected_library_says_nothing(capfd):
    """Its `argv[0]=` stood before the JSON of `--json -`."""
    assert connected().getNumBodies() == 0
    assert capfd.readouterr() == ("", "")


def test_without_pybullet_one_sentence_says_what_to_do(crane, crane_urdf, monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(SimulatorMissing, match="Python 3.11 .* or go without"):
        World(crane_urdf, crane)


IMPORT = """
import os, sys
from sim.draw.world import import_pybullet
print("before")
os.write(1, b"below python\\n")
try:
    import_pybullet()
except Exception as error:
    print(repr(error), error.__cause__)
print("after")
os.write(2, b"stderr is back\\n")
"""


def import_in_a_new_process(cwd):
    with started(["-c", IMPORT], cwd, warm={"modules": ["sim.draw.world"]}) as process:
        out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    return out, err


def test_importing_pybullet_prints_nothing(tmp_path):
    pytest.importorskip("pybullet")
    out, err = import_in_a_new_process(tmp_path)
    assert sorted(out.split("\n")) == ["", "after", "before", "below python"]
    assert err == "stderr is back\n"


def test_what_a_broken_pybullet_says_is_not_lost(tmp_path):
    said = 'import os\nos.write(1, b"pybullet build time: x\\nof another numpy\\n")\n'
    broken = said + 'raise ImportError("wrong libstdc++")\n'
    (tmp_path / "pybullet.py").write_text(broken)
    out, err = import_in_a_new_process(tmp_path)
    assert "SimulatorMissing" in out and "wrong libstdc++" in out and "after" in out
    assert err == "of another numpy\nstderr is back\n"


@pytest.mark.parametrize("kind", ["pybullet", "cover"])
def test_both_worlds_draw_robot_and_person_where_the_camera_sees_them(
    crane, crane_urdf, kind
):
    if kind == "pybullet":
        pytest.importorskip("pybullet")
    made = World(crane_urdf, crane) if kind == "pybullet" else CoverWorld(crane)
    with made as world:
        world.place(np.zeros(2), HAND)
        colour, depth, empty = world.picture(CAMERA)
        far_off = HAND[0, :3] + [0.0, 0.0, 0.35]
        world.stand(all_triangles([Box((0.1, 0.1, 0.1), at(far_off))]))
        world.place(np.zeros(2), HAND)
        (pixel,), (away,) = CAMERA.project(far_off)
        column, row = pixel.astype(int)
        assert empty[row, column] and not world.picture(CAMERA)[2][row, column]
        assert world.picture(CAMERA)[1][row, column] == pytest.approx(away, abs=0.12)
    middle = (HAND[0, :3] + HAND[0, 3:6]) / 2
    (pixel,), (far,) = CAMERA.project(middle)
    column, row = pixel.astype(int)
    assert not empty[row, column] and empty[0, 0]
    assert depth[row, column] == pytest.approx(far - HAND[0, 6], abs=0.02)
    assert colour.shape == (120, 160, 3) and colour.dtype == np.uint8


@pytest.mark.parametrize("present", ["whole", "upper", "one arm", "neck", "shoulders"])
def test_hands_forearms_and_head_of_whoever_is_tracked_are_skin(present):
    arm = ("left_shoulder", "left_elbow", "left_hand")
    labels = {
        "whole": Human().labels,
        "upper": UpperBody(JOINTS, BodySizes.sized()).labels,
        "one arm": UpperBody(arm, BodySizes.sized()).labels,
        "neck": UpperBody((*arm, "neck"), BodySizes.sized()).labels,
        "shoulders": UpperBody((*arm, "right_shoulder"), BodySizes.sized()).labels,
    }[present]
    bare = [("HAND", "FOREARM", "HEAD"), ("TORSO", "UPPER_ARM", "LEG")]
    for label, colour in zip(labels, person_colours(len(labels)), strict=True):
        shown = bare[0] if tuple(colour) == SKIN else bare[1]
        assert Part(label).name.endswith(shown), Part(label)


def test_an_arm_has_a_sleeve_and_a_number_nobody_knows_one_colour():
    assert person_colours(2).tolist() == [list(SLEEVE), list(SKIN)]
    one = person_colours(15)  # people who stand, however many
    np.testing.assert_array_equal(person_colours(75), np.tile(one, (5, 1)))
    assert (person_colours(7) == SLEEVE).all() and person_colours(0).shape == (0, 3)


@pytest.mark.parametrize("kind", ["pybullet", "cover"])
def test_both_worlds_draw_a_hand_as_skin_and_the_upper_arm_as_clothes(
    crane, crane_urdf, kind
):
    if kind == "pybullet":
        pytest.importorskip("pybullet")
    made = World(crane_urdf, crane) if kind == "pybullet" else CoverWorld(crane)
    arm = np.array([HAND[0] + [0, 0, z, 0, 0, z, 0] for z in (0.0, 0.15, 0.3, 0.45)])
    with made as world:
        world.place(np.zeros(2), arm, things=1)  # hand, forearm, upper arm, an object
        colour, _, _ = world.picture(CAMERA)
    pixels, _ = CAMERA.project((arm[:, :3] + arm[:, 3:6]) / 2)
    columns, rows = pixels.astype(int).T
    red, green, blue = colour[rows, columns].astype(int).T
    assert (red[:2] > blue[:2]).all() and blue[2] > red[2] and blue[3] < 0.6 * green[3]


def at(place):
    """Return the pose of something that stands straight at a place."""
    T = np.eye(4)
    T[:3, 3] = place
    return T


def test_the_mesh_of_a_capsule_is_a_closed_capsule():
    mesh = capsule_mesh(0.3, 0.05)
    vertices, normals = mesh.vertices, mesh.vertex_normals
    axis = np.clip(vertices[:, 2], -0.15, 0.15)
    radius = np.linalg.norm(vertices - axis[:, None] * [0, 0, 1], axis=1)
    np.testing.assert_allclose(radius, 0.05, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    exact = np.pi * 0.05**2 * (0.3 + 4 / 3 * 0.05)
    assert mesh.is_watertight and mesh.volume == pytest.approx(exact, rel=0.02)


def test_the_camera_projects_its_target_to_the_middle():
    (pixel,), (far,) = CAMERA.project(CAMERA.target)
    np.testing.assert_allclose(pixel, [80, 60], atol=1e-9)
    assert far == pytest.approx(np.linalg.norm(np.subtract(CAMERA.eye, CAMERA.target)))
    P = CAMERA.projection()
    clip = P @ [0, 0, -far, 1]
    buffer = (clip[2] / clip[3] + 1) / 2
    assert CAMERA.metres(buffer) == pytest.approx(far)


@pytest.mark.parametrize("stored", ["latin-1", "utf-16"])
def test_a_urdf_in_another_encoding_is_drawn(crane_urdf, crane, stored, tmp_path):
    pytest.importorskip("pybullet")
    text = crane_urdf.read_text().replace("</robot>", "<!-- \xfc --></robot>")
    (tmp_path / "odd.urdf").write_text(text, encoding=stored)
    with World(tmp_path / "odd.urdf", crane) as world:
        world.place([0.1, 0.2], HAND)


def test_meshes_without_normals_are_not_black(tmp_path):
    pytest.importorskip("pybullet")
    import trimesh

    bare = bytearray(trimesh.creation.box((0.3, 0.3, 0.3)).export(file_type="stl"))
    for k in range(12):
        bare[84 + 50 * k : 96 + 50 * k] = bytes(12)
    (tmp_path / "box.stl").write_bytes(bare)
    solid = '<geometry><mesh filename="box.stl"/></geometry>'
    look = '<material name="w"><color rgba="1 1 1 1"/></material>'
    urdf = tmp_path / "box.urdf"
    urdf.write_text(
        f"""<robot name="box"><link name="base"/><link name="box"><visual>{solid}{look}
        </visual><collision>{solid}</collision></link><joint name="j" type="revolute">
        <parent link="base"/><child link="box"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
    )
    camera = Camera(eye=(1.0, -1.0, 1.0), target=(0, 0, 0), width=80, height=60)
    with World(urdf, load_robot(urdf, tip="box", cover_excess=0.1)) as world:
        world.place([0.1], np.zeros((0, 7)))
        colour, _, empty = world.picture(camera)
    assert (~empty).sum() > 100
    assert colour[~empty].min() > 60
