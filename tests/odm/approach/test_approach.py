"""The last centimetres: straight tool motions on a table, a shelf, a hand, in a bin."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rows import each

import odm
from odm.approach.approach import Approacher
from odm.approach.approach_answer import ApproachSettings
from odm.approach.tool_line import Line, ToolKinematics
from odm.exact.distances import ExactRobot, obstacles_of
from odm.obstacles.surfaces import box_faces, rounded_covering
from roadmap.errors import BadInput
from roadmap.geometry.spheres import cover_excess, robot_solids
from roadmap.kinematics.forward import difference, tool_pose
from roadmap.transforms import pose_of
from sim.bench.core.approach import bin_around

NOBODY = np.zeros((0, 3))
DOWN = pose_of([0.5, 0.1, 0.25], [np.pi, 0.0, 0.3])
FORWARD = pose_of([0.55, 0.0, 0.55], [0.0, np.pi / 2, 0.0])
DENSE = 0.01  # [m]


@pytest.fixture(scope="module")
def cell_map():
    recipe = odm.load_recipe("panda")
    few = replace(recipe.roadmap, nodes=300, neighbors=2)
    return odm.build_map(replace(recipe, roadmap=few))


@pytest.fixture(scope="module")
def shared(cell_map):
    planner = odm.ReactivePlanner(cell_map)
    planner.step(NOBODY, cell_map.roadmap.nodes[0])
    return planner


@pytest.fixture
def planner(shared):
    yield shared
    shared.reset()
    shared.set_static(NOBODY)


def box(size, position):
    return odm.Box(np.array(size), pose_of(position))


def see(planner, shapes):
    """Show shapes to the planner: boxes by their faces, others by their surfaces."""
    parts = [
        box_faces(s, DENSE) if isinstance(s, odm.Box) else odm.surface_of(s, DENSE)
        for s in shapes
    ]
    points = np.concatenate([NOBODY, *(p.points for p in parts)])
    boxes = all(isinstance(s, odm.Box) for s in shapes)
    q = planner.cell_map.roadmap.nodes[0]
    rounding = np.inf if boxes else None
    planner.step(points, q, covering_radius=DENSE, rounding=rounding)


def samples(answer, n=25):
    legs = zip(answer.path[:-1], answer.path[1:], strict=True)
    return np.concatenate([np.linspace(a, b, n) for a, b in legs])


def hold(planner, answer, shapes, T, way):
    """Check an approach without the code that made it."""
    assert answer, answer.reason
    robot = planner.robot
    np.testing.assert_allclose(tool_pose(robot, answer.q_end), T, atol=1e-4)
    start = T.copy()
    start[:3, 3] -= way * T[:3, 2]
    np.testing.assert_allclose(tool_pose(robot, answer.q_pre), start, atol=1e-4)
    assert answer.error_m <= 1e-3 and answer.error_rad <= 0.01
    exact, ready = ExactRobot(robot), obstacles_of(shapes)
    m, off, turned = planner.cell_map.safety.m, 0.0, 0.0
    for q in samples(answer):
        tool = tool_pose(robot, q)
        away = tool[:3, 3] - start[:3, 3]
        along = np.clip(away @ T[:3, 2], 0.0, way)
        off = max(off, np.linalg.norm(away - along * T[:3, 2]))
        cosine = 0.5 * (np.trace(tool[:3, :3].T @ T[:3, :3]) - 1.0)
        turned = max(turned, np.arccos(min(1.0, cosine)))
        assert exact.distance(q, ready, cap=0.05).distance >= m
        assert exact.self_distance(q).distance > 0.0
        assert (q >= robot.lower).all() and (q <= robot.upper).all()
    assert 0.0 < off <= answer.error_m and turned <= answer.error_rad
    if not answer.fine:
        legs = zip(answer.path[:-1], answer.path[1:], strict=True)
        assert all(planner.is_free(a, b) for a, b in legs)


def test_down_to_a_table(planner):
    table = box([0.6, 0.8, 0.04], [0.6, 0.0, 0.16])
    see(planner, [table])
    answer = planner.approach(DOWN)
    hold(planner, answer, [table], DOWN, 0.15)
    planner.set_goals([answer.q_pre])  # the pre-pose is a goal like any other


def test_down_to_a_table_that_stands_there_for_good(planner):
    table = box([0.6, 0.8, 0.04], [0.6, 0.0, 0.12])
    see(planner, [])
    planner.set_static(table)
    hold(planner, planner.approach(DOWN), [table], DOWN, 0.15)
    planner.set_static(box([0.6, 0.8, 0.04], [0.6, 0.0, 0.24]))
    answer = planner.approach(DOWN)
    assert not answer and answer.blocker.failed == "scenery"
    assert "the scenery set by set_static" in answer.reason


def test_into_a_shelf(planner):
    boards = [
        box([0.3, 0.6, 0.02], [0.65, 0.0, 0.37]),
        box([0.3, 0.6, 0.02], [0.65, 0.0, 0.73]),
        box([0.02, 0.6, 0.38], [0.81, 0.0, 0.55]),
    ]
    see(planner, boards)
    hold(planner, planner.approach(FORWARD), boards, FORWARD, 0.15)


def test_to_a_persons_open_hand(planner):
    """The palm under the tool: 8 cm below it, with fingers, thumb and forearm."""
    x, y, z = DOWN[:3, 3] + [0.0, 0.0, -0.08]
    rods = [
        ([x + 0.3, y, z - 0.05], [x + 0.07, y, z], 0.035),
        *([[x + 0.02, y + w, z], [x - 0.09, y + w, z], 0.009]
          for w in (-0.03, -0.01, 0.01, 0.03)),
        ([x + 0.03, y - 0.03, z], [x + 0.03, y + 0.03, z], 0.014),
        ([x + 0.03, y + 0.04, z], [x - 0.02, y + 0.07, z + 0.01], 0.01),
    ]  # fmt: skip
    hand = [odm.Capsule.between(a, b, radius) for a, b, radius in rods]
    see(planner, hand)
    hold(planner, planner.approach(DOWN), hand, DOWN, 0.15)


def test_into_a_bin_with_2_cm_to_spare(planner):
    """Exact geometry allows 2 cm at the pose; the cover of the map alone is too fat."""
    boards = bin_around(planner.robot, DOWN, 0.02)
    see(planner, boards)
    answer = planner.approach(DOWN)
    hold(planner, answer, boards, DOWN, 0.15)
    gap = ExactRobot(planner.robot).distance(answer.q_end, obstacles_of(boards))
    assert gap.distance <= 0.021
    assert answer.fine
    legs = zip(answer.path[:-1], answer.path[1:], strict=True)
    assert not all(planner.is_free(a, b) for a, b in legs)
    coarse = Approacher(planner.frame, ApproachSettings(use_fine_cover=False)).run(DOWN)
    assert not coarse and "panda_" in coarse.reason


def test_a_bin_with_half_a_centimetre_to_spare_is_refused(planner):
    see(planner, bin_around(planner.robot, DOWN, 0.005))
    answer = planner.approach(DOWN)
    assert not answer and answer.path.shape == (0, 7) and answer.q_pre is None
    what = answer.blocker
    assert what.failed == "frame" and what.link in answer.reason
    assert 0.0 < what.missing_m < 0.03 and f"point {what.point}" in answer.reason


@pytest.mark.parametrize("stands", [False, True])
def test_with_more_clearance_a_bin_has_none_to_spare(cell_map, stands):
    planner, boards = (
        odm.ReactivePlanner(cell_map),
        bin_around(cell_map.robot, DOWN, 0.02),
    )
    see(planner, [] if stands else boards)
    for k, board in enumerate(boards if stands else ()):
        planner.scene.add(f"board {k}", board)
    found = planner.approach(DOWN)
    assert found.fine
    for extra in (0.02, 0.0):
        planner.set_extra_clearance(extra)
        answer = planner.approach(DOWN, q=found.q_pre)
        assert bool(answer) == (extra == 0.0)
        assert answer or answer.blocker.failed == ("scenery" if stands else "frame")


def test_sparse_points_of_a_bin_leave_none_to_spare(planner):
    """The same points, of which is not told that they are dense."""
    see(planner, bin_around(planner.robot, DOWN, 0.02))
    found, points = planner.approach(DOWN), planner.points.copy()
    assert found.fine
    planner.step(points, planner.cell_map.roadmap.nodes[0])
    assert not planner.approach(DOWN, q=found.q_pre)


def test_what_is_held_is_kept_off_the_table_too(cell_map):
    """The finer cover knows it, and forgets it again."""
    planner = odm.ReactivePlanner(cell_map)
    see(planner, [box([0.6, 0.8, 0.04], [0.6, 0.0, 0.16])])
    for _ in range(2):
        found = planner.approach(DOWN)
        assert found
        planner.attach(np.array([[0.0, 0.0, 0.06, 0.03]]))
        answer = planner.approach(DOWN, q=found.q_pre)
        assert not answer and answer.blocker.link == "payload"
        planner.detach()


def test_a_blocked_line_names_link_point_and_leg(planner):
    see(planner, [])
    q = planner.approach(DOWN).q_pre
    rod = odm.Capsule.between([0.5, -0.4, 0.27], [0.5, 0.6, 0.27], 0.01)
    see(planner, [rod])
    answer = planner.approach(DOWN, q=q)
    what = answer.blocker
    assert not answer and what.failed == "frame"
    assert what.link in ("panda_leftfinger", "panda_rightfinger", "panda_hand")
    p = planner.points[what.point]
    assert abs(np.linalg.norm(p[[0, 2]] - [0.5, 0.27]) - 0.01) < 1e-6
    assert 0 <= what.leg < what.legs
    assert f"leg {what.leg} of {what.legs} is blocked" in answer.reason
    assert "move it" in answer.reason


def test_from_where_the_robot_stands_the_tool_may_turn_on_the_way(planner):
    see(planner, [])
    q = planner.approach(DOWN).q_pre
    T = DOWN @ pose_of([0.0, 0.0, 0.0], [0.0, 0.0, 0.4])
    answer = planner.approach(T, q=q)
    assert answer, answer.reason
    np.testing.assert_array_equal(answer.path[0], q)
    np.testing.assert_allclose(tool_pose(planner.robot, answer.q_end), T, atol=1e-4)
    steps = difference(planner.robot, answer.path[:-1], answer.path[1:])
    assert np.abs(steps).max() < 0.4  # no jump to another branch


def test_the_stated_deviation_holds_between_the_samples(planner, rng):
    robot = planner.robot
    tool = ToolKinematics(robot)
    for _ in range(20):
        q = rng.uniform(robot.lower, robot.upper)
        dq = rng.uniform(-0.2, 0.2, robot.dof)
        line = Line.between(tool_pose(robot, q), tool_pose(robot, q + dq))
        off, turned = tool.leg_error(line, 0.0, 1.0, q, q + dq)
        t = np.linspace(0.0, 1.0, 200)
        real = tool.tools(q + t[:, None] * dq)
        ideal = np.array([line.pose(s) for s in t])
        worst = np.linalg.norm(real[:, 9:] - ideal[:, 9:], axis=1).max()
        cosine = 0.5 * ((real[:, :9] * ideal[:, :9]).sum(axis=1) - 1.0)
        assert worst <= off <= worst + 0.01
        assert np.arccos(np.clip(cosine, -1, 1)).max() <= turned + 1e-7


def test_the_finer_cover_holds_the_solids_and_sticks_out_less(planner, rng):
    see(planner, [])
    planner.approach(DOWN)
    robot, finer = planner._approacher.legs.fine.robot, set()
    for link, name in enumerate(robot.link_names):
        own = [s for s in robot_solids(planner.robot) if s.link == link]
        coarse = planner.robot.spheres[planner.robot.sphere_link == link]
        spheres = robot.spheres[robot.sphere_link == link]
        if np.array_equal(spheres, coarse):
            continue
        finer.add(name)
        assert cover_excess(spheres, own) < 0.6 * cover_excess(coarse, own)
        for s in own:  # hulls: any mean of corners is a point of the volume
            weights = rng.dirichlet(np.full(len(s.points), 0.1), 500)
            T = s.T_body_solid
            points = weights @ s.points @ T[:3, :3].T + T[:3, 3]
            gaps = np.linalg.norm(points[:, None] - spheres[:, :3], axis=2)
            assert (gaps <= spheres[:, 3]).any(axis=1).all()
    assert finer >= {"panda_hand", "panda_leftfinger"}


def test_samples_by_face_need_no_more_than_what_is_taken_for_them(rng):
    size, rho = np.array([0.2, 0.13, 0.07]), 0.02
    points = box_faces(odm.Box(size), rho).points
    assert np.abs(points).max(axis=0) == pytest.approx(size / 2)
    for ball in (0.02, 0.05):
        needed = rounded_covering(rho, np.inf, ball)
        assert needed < 0.6 * rho
        outside = rng.uniform(-0.2, 0.2, (20000, 3))
        nearest = np.clip(outside, -size / 2, size / 2)
        gap = np.linalg.norm(outside - nearest, axis=1)
        touched = outside[(gap > 0) & (gap <= ball)]
        assert len(touched) > 300
        far = np.linalg.norm(touched[:, None] - points, axis=2).min(axis=1)
        assert (far <= ball + needed).all()


def test_the_same_input_gives_the_same_bytes(planner, cell_map):
    boards = bin_around(planner.robot, DOWN, 0.025)
    found = []
    for one in (planner, odm.ReactivePlanner(cell_map)):
        see(one, boards)
        found += [one.approach(DOWN), one.approach(DOWN)]
    assert all(found)
    assert len({a.path.tobytes() for a in found}) == 1
    assert len({(a.error_m, a.descents, a.motions) for a in found}) == 1


def test_a_pose_out_of_reach_says_how_far_it_is(planner):
    see(planner, [])
    answer = planner.approach(pose_of([1.6, 0.0, 0.3]))
    assert not answer and answer.blocker is None
    assert "no configuration within limits has the tool at the pose" in answer.reason
    far = float(answer.reason.split("found is ")[1].split(" cm")[0])
    assert 40 < far < 120


def test_a_line_that_leaves_the_reach_says_where(planner):
    see(planner, [])
    answer = planner.approach(DOWN, distance=1.2)
    assert not answer and "the arm cannot follow the line" in answer.reason
    assert "cm before its end" in answer.reason


def test_points_that_are_nowhere_allow_no_approach(planner):
    q = planner.cell_map.roadmap.nodes[0]
    planner.step(np.array([[2.0, 0.0, 0.0], [np.nan, 0.0, 0.0]]), q)
    answer = planner.approach(DOWN)
    assert not answer and "1 obstacle points are NaN" in answer.reason


def test_a_small_budget_is_kept(planner):
    see(planner, [])
    tight = Approacher(planner.frame, ApproachSettings(max_tests=3)).run(DOWN)
    assert not tight and tight.motions == 3 and "budget of 3 motions" in tight.reason


@each(
    ("change", "text"),
    [
        ({"T_base_tool": np.diag([1.0, 1.0, 2.0, 1.0])}, "rigid"),
        ({"T_base_tool": np.full((4, 4), np.nan)}, "finite"),
        ({"T_base_tool": np.eye(3)}, "shape"),
        ({"distance": 0.0}, "distance of 0.0 m"),
        ({"distance": np.nan}, "distance of nan m"),
        ({"direction": np.zeros(3)}, "direction"),
        ({"direction": np.ones(2)}, "direction"),
        ({"q": np.zeros(3)}, "7 moving joints"),
        ({"q": np.full(7, np.nan)}, "NaN"),
        ({"q": np.zeros(7), "direction": np.ones(3)}, "leave direction out"),
    ],
)
def test_bad_input_is_refused(planner, change, text):
    with pytest.raises(BadInput, match=text):
        planner.approach(**({"T_base_tool": DOWN} | change))


def test_the_example_of_the_docs_runs(planner, cell_map, capsys):
    text = (Path(odm.__file__).parents[1] / "docs" / "approach.md").read_text()
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL).group(1)
    assert len(code.strip().splitlines()) <= 6
    points, q_now = NOBODY, cell_map.roadmap.nodes[0].copy()
    names = {"planner": planner, "points": points, "q_now": q_now, "T_base_tool": DOWN}
    exec(code, names)
    assert names["found"] and "mm of the line" in capsys.readouterr().out
    assert np.array_equal(planner.goals, [names["found"].q_pre])
