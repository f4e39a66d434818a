"""The bench of peers: cases, judge, adapters; and that its table has every figure."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from small import AWAY, HOME, small_recipe

import odm
from odm import Box
from sim.bench.frames import MORE_MOTIONS, arm_frames
from sim.bench.rivals import peers
from sim.bench.rivals.peer_cases import Case, Frame
from sim.bench.rivals.peer_planners import OUR_MODES, BruteForce, Ours, StopOnly
from sim.bench.rivals.peer_vamp import Vamp, VampMissing, _euler_xyz
from sim.bench.rivals.peers import CLOUD, STEP, Asked, Judge

NO_RODS = np.zeros((0, 7))


@pytest.fixture(scope="module")
def cell_map(small_folder):
    return odm.load_map(small_folder)


@pytest.fixture(scope="module")
def small_folder(tmp_path_factory):
    return odm.build_map(small_recipe()).save(tmp_path_factory.mktemp("peers") / "map")


def case(*frames):
    return Case("sweep", HOME, AWAY, frames, tuple(range(len(frames))))


@pytest.mark.parametrize("motion", MORE_MOTIONS)
def test_the_arms_of_a_motion_are_whole_and_as_fast_as_it_says(motion):
    rods = arm_frames(motion, 200, np.random.default_rng(1))
    assert rods.shape == (200, 4 if motion == "crowding" else 2, 7)
    lengths = np.linalg.norm(rods[..., 3:6] - rods[..., :3], axis=-1)
    assert np.ptp(lengths, axis=0).max() < 1e-9
    speed = 100.0 * np.linalg.norm(np.diff(rods[:, -1, 3:6], axis=0), axis=1).max()
    low, high = {"hover": (0.03, 0.16), "intrusion": (0.9, 2.1)}.get(motion, (0.3, 1.1))
    assert low < speed < high


def test_the_judge_sees_contact_and_tells_the_smallest_distance(cell_map):
    judge, path = Judge(cell_map), np.stack([HOME, AWAY])
    tool = judge.exact.frames(0.5 * (HOME + AWAY))
    far = Frame(np.array([[0.0, 0.0, 3.0, 0.0, 0.1, 3.0, 0.05]]))
    touches, near = judge.look(path, far)
    assert not touches and near == peers.FAR and judge.checks < 20
    box = Frame(NO_RODS, (Box([0.05] * 3, _at(judge, path)),))
    touches, near = judge.look(path, box)
    assert touches and near == 0.0 and len(tool)
    beside = np.array([[0.0, 0.0, 1.02, 0.0, 0.1, 1.02, 0.05]])
    touches, near = judge.look(path, Frame(beside))
    dense = min(
        judge.exact.distance(q, Frame(beside).solids()).distance
        for q in np.linspace(HOME, AWAY, 400)
    )
    assert not touches and 0.02 < dense < 0.1
    assert abs(near - dense) <= STEP


def _at(judge, path):
    """Return a pose in the middle of what the last link passes through."""
    from roadmap.kinematics.forward import tool_pose

    T = np.eye(4)
    T[:3, 3] = tool_pose(judge.exact.robot, 0.5 * (path[0] + path[1]))[:3, 3]
    return T


def test_who_stops_only_knows_one_path_and_brute_force_finds_another(cell_map):
    judge = Judge(cell_map)
    free = Frame(np.array([[0.0, 0.0, 3.0, 0.0, 0.1, 3.0, 0.05]]))
    blocked = Frame(NO_RODS, (Box([0.05] * 3, _at(judge, np.stack([HOME, AWAY]))),))
    asked = case(free, blocked)
    stop, brute = StopOnly(cell_map), BruteForce(cell_map)
    for peer in (stop, brute):
        peer.begin(asked)
        first = peer.path(free)
        assert np.array_equal(first[[0, -1]], np.stack([HOME, AWAY]))
    assert stop.path(blocked) is None
    round_it = brute.path(blocked)
    assert round_it is not None and not judge.look(round_it, blocked)[0]


def test_a_cloud_is_seen_by_all_who_are_there(cell_map):
    judge = Judge(cell_map)
    place = _at(judge, np.stack([HOME, AWAY]))[:3, 3]
    cloud = place + np.random.default_rng(0).uniform(-0.02, 0.02, (200, 3))
    seen = Frame(np.array([[*place, *place + 0.01, 0.02]]), cloud=cloud)
    asked = case(seen)
    stop = StopOnly(cell_map)
    stop.begin(asked)
    assert stop.path(seen) is None
    for mode in OUR_MODES:
        ours = Ours(cell_map, mode)
        ours.begin(asked)
        path = ours.path(seen)
        assert path is None or not judge.look(path, seen)[0]


class EndlessPath:
    """As VAMP's paths: what is read past the last row is no error."""

    def __init__(self, rows):
        self.rows = np.array(rows, np.float32)

    def __getitem__(self, k):
        assert k < len(self.rows), "read past the last row"
        return self.rows[k]

    def numpy(self):
        return self.rows


def test_without_vamp_it_says_so_and_with_it_the_world_is_built(monkeypatch):
    monkeypatch.setitem(sys.modules, "vamp", None)
    with pytest.raises(VampMissing, match="not installed"):
        Vamp("panda", True)
    seen = []

    class World:
        def add_capsule(self, capsule):
            seen.append(capsule)

        def add_cuboid(self, cuboid):
            seen.append(cuboid)

    found = SimpleNamespace(solved=True, path=EndlessPath([[0.0] * 7, [1.0] * 7]))
    robot = SimpleNamespace(
        halton=lambda: SimpleNamespace(reset=lambda: None),
        rrtc=lambda *args: found,
        simplify=lambda *args: found,
    )
    fake = SimpleNamespace(
        panda=robot,
        configure_robot_and_planner_with_kwargs=lambda *args: (
            robot, None, SimpleNamespace(), SimpleNamespace()
        ),
        Environment=World,
        Cylinder=lambda *args: ("capsule", *args),
        Cuboid=lambda *args: ("box", *args),
    )  # fmt: skip
    monkeypatch.setitem(sys.modules, "vamp", fake)
    with pytest.raises(VampMissing, match="no robot jaco"):
        Vamp("jaco", True)
    vamp = Vamp("panda", True)
    assert vamp.plan.max_samples == 10_000
    vamp.begin(Case("sweep", np.zeros(7), np.ones(7), (), ()))
    rods = np.random.default_rng(0).uniform(-1, 1, (5, 7))
    path = vamp.path(Frame(rods, (Box([0.1, 0.2, 0.4]),)))
    assert path.shape == (2, 7) and path.dtype == float and len(seen) == 6
    for (_, middle, (x, y, z), radius, length), rod in zip(seen, rods, strict=False):
        # Ry(y) Rx(x) turns z onto the axis
        axis = [np.sin(y) * np.cos(x), -np.sin(x), np.cos(y) * np.cos(x)]
        ends = np.array(middle) + np.outer([-0.5, 0.5], length * np.array(axis))
        np.testing.assert_allclose(ends, [rod[:3], rod[3:6]], atol=1e-9)
        assert radius == rod[6] and z == 0.0
    assert seen[-1][-1] == [0.05, 0.1, 0.2]


def test_angles_give_the_rotation_back():
    from scipy.spatial.transform import Rotation

    R = Rotation.random(20, random_state=1)
    for one in R:
        again = Rotation.from_euler("xyz", _euler_xyz(one.as_matrix()))  # Rz Ry Rx
        assert (again * one.inv()).magnitude() < 1e-9


@pytest.mark.parametrize("of", ["rods", "boxes"])
def test_vamp_where_it_is_there_has_obstacles_where_they_are(of):
    pytest.importorskip("vamp")
    from scipy.spatial.transform import Rotation

    vamp, rng, touched = Vamp("panda", False), np.random.default_rng(0), 0
    vamp_limits = vamp.robot.lower_bounds(), vamp.robot.upper_bounds()
    for _ in range(1000):
        q = rng.uniform(*vamp_limits).tolist()
        spheres = [(s.x, s.y, s.z, s.r) for s in vamp.robot.fk(q)]
        centers, radii = np.split(np.array(spheres), [3], axis=1)
        T, half = np.eye(4), rng.uniform(0.05, 0.25, 3)
        T[:3, :3] = Rotation.random(random_state=rng).as_matrix()
        T[:3, 3] = rng.uniform(-0.6, 0.6, 3)
        local = (centers - T[:3, 3]) @ T[:3, :3]
        if of == "rods":  # along z of T
            along = np.clip(local[:, 2], -half[2], half[2])
            away = np.linalg.norm(local - along[:, None] * [0, 0, 1], axis=1) - 0.05
            ends = [T[:3, 3] + s * half[2] * T[:3, 2] for s in (-1, 1)]
            frame = Frame(np.r_[ends[0], ends[1], 0.05][None])
        else:
            away = np.linalg.norm(np.maximum(np.abs(local) - half, 0.0), axis=1)
            frame = Frame(NO_RODS, (Box((2 * half).tolist(), T),))
        near = (away - radii[:, 0]).min()
        if vamp.robot.validate(q) and abs(near) > 1e-3:
            assert vamp.robot.validate(q, vamp.world(frame)) == (near > 0)
            touched += near < 0
    assert touched > 20


def test_the_bench_tells_every_figure(small_folder, tmp_path, monkeypatch):
    def few(cell_map, *_):
        rods = np.array([[0.5, 0.4, 0.9, 0.5, 0.5, 1.1, 0.05]])
        frames = tuple(Frame(rods + 0.001 * k) for k in range(4))
        yield Case("sweep", HOME, AWAY, frames, (1, 2))
        yield Case(peers.CLUTTER, HOME, AWAY, (Frame(NO_RODS, (_far(),)),), (0,))

    monkeypatch.setattr(peers, "make_cases", few)
    monkeypatch.setattr(
        peers,
        "_peers",
        lambda m, s: ([Ours(m, OUR_MODES[0]), StopOnly(m)], {"X": "no"}),
    )
    plot = tmp_path / "peers.png"
    result = peers.run(small_folder, short=True, plot=plot)
    json.dumps(result)
    rows = {row["name"]: row for row in result["rows"]}
    assert rows["our paths in exact collision"]["value"] == 0
    assert rows["configurations checked by exact geometry"]["value"] > 4
    shapes, cloud, *kinds = result["tables"]
    assert [row[0] for row in shapes["rows"]] == [
        "odm, replanned",
        "stop-only fcl",
        "X",
    ]
    assert shapes["rows"][0][1] == "3" and shapes["rows"][0][5] == "100 %"
    assert CLOUD in cloud["title"] and len(kinds) == 7
    assert plot.stat().st_size > 10_000


def _far():
    T = np.eye(4)
    T[:3, 3] = 0.0, 0.0, 3.0
    return Box([0.1] * 3, T)


def test_a_peer_without_a_path_has_a_row_without_a_length():
    one = Asked("who", "sweep", "shapes")
    one.wall, one.solved = [1.0, 3.0], [False, False]
    row = peers._row(one)
    assert row[1] == "2" and row[5] == "0 %" and row[6] == "-" and row[8] == "0/0"


def test_who_gives_up_at_once_is_not_taken_for_fast():
    mine, other = (
        Asked(name, "sweep", "shapes")
        for name in ("odm, replanned", "OMPL RRT-Connect")
    )
    for one in (mine, other):
        one.asked, one.lengths = [(0, 1), (0, 2), (0, 3)], [1.0]
    mine.cpu, mine.solved = [0.1, 0.1, 10.0], [False, False, True]
    other.cpu, other.solved = [1e4, 1e4, 1e4], [True, True, True]
    rows = peers._rows([mine, other], SimpleNamespace(checks=0))
    (ratio,) = (row for row in rows if "times faster" in row["name"])
    assert ratio["value"] == pytest.approx(1e3)


@pytest.mark.parametrize("collides", [False, True])
def test_a_contact_that_nothing_beside_it_bears_out_is_none(collides):
    q = np.array([0.3, -0.2])
    judge = object.__new__(Judge)
    judge.motion = np.ones(2)
    judge.fcl = SimpleNamespace(collides=lambda q: collides)

    def distance(at, obstacles, cap):
        return SimpleNamespace(distance=0.0 if np.array_equal(at, q) else 0.03)

    judge.exact = SimpleNamespace(distance=distance)
    assert judge._distance(q, []) == pytest.approx(0.0 if collides else 0.03, abs=1e-6)
