"""The scene by name: what stands there is heeded, from the call on until it goes."""

import numpy as np
import pytest
from shapes_drawn import KINDS, draw_pose, draw_shape, draw_shapes, smallest_solid_gap
from small import AWAY, HOME, NOBODY, POST, draw_valid, on_its_way

import odm
from odm.frame import place
from odm.obstacles.shapes import Mesh
from odm.planner.saved_memory import differences
from roadmap.errors import BadInput
from roadmap.kinematics.forward import difference, tool_pose
from roadmap.transforms import pose_of

WALL = odm.Box((0.1, 0.6, 0.3))
OVER = pose_of([0.0, 0.0, 0.95], np.zeros(3))  # the base: HOME to AWAY leads through


def legs(robot, path):
    return [(a, difference(robot, a, b)) for a, b in zip(path, path[1:], strict=False)]


def placed(scene):
    return [part for _, part in scene.shapes()]


def closed_exactly(planner):
    """Return what the very shapes close, item by item, without any cells."""
    static, roadmap = planner.static, planner.cell_map.roadmap
    still, nodes = np.zeros(planner.robot.dof), roadmap.nodes
    node = np.array([not static.clear_of_place(q, still) for q in nodes])
    a, b = roadmap.edges.T
    dq = difference(planner.robot, nodes[a], nodes[b])
    edge = [not static.clear_of_place(q, d) for q, d in zip(nodes[a], dq, strict=True)]
    return np.concatenate([node, np.array(edge) | node[a] | node[b]])


def bent_mesh():
    import trimesh

    parts = [
        trimesh.creation.box((0.4, 0.1, 0.1)),
        trimesh.creation.box((0.1, 0.1, 0.4)),
    ]
    both = trimesh.util.concatenate(parts)
    return Mesh(both.vertices, both.faces)


def around_all(radius):
    """Return a ball of many faces with a dent, which holds the whole robot."""
    import trimesh

    ball = trimesh.creation.icosphere(3, radius)
    vertices = np.array(ball.vertices)
    vertices[vertices[:, 2].argmax()] *= 0.9
    return Mesh(vertices, ball.faces)


@pytest.mark.parametrize("moved", ["add", "move", "base"])
def test_a_mesh_around_the_whole_robot_blocks(planner, moved):
    """Its surface is near no link; what it holds was free."""
    far = pose_of([9.0, 0.0, 0.0], np.zeros(3))
    place = np.eye(4) if moved == "add" else far
    planner.set_goals([AWAY])
    planner.scene.add("ball", around_all(1.6), place)
    if moved == "move":
        planner.scene.move("ball", np.eye(4))
    elif moved == "base":
        planner.set_base(far)
    answer = planner.step(NOBODY, q=HOME)
    assert answer.status == "holding" and "would touch ball" in answer.reason
    assert not planner.is_free(HOME, AWAY) and planner.memory.graph.closed.all()
    planner.scene.move("ball", pose_of([0.0, 30.0, 0.0], np.zeros(3)))
    assert planner.step(NOBODY, q=HOME).status != "holding"


def test_a_change_closes_just_what_its_shapes_touch(planner, rng):
    """Cells at first, in the end what the close test finds, whatever came before."""
    scene, closed = planner.scene, planner.memory.graph.closed
    shapes = {f"thing {k}": s for k, s in enumerate(draw_shapes(rng, 6))}
    shapes["bent"] = bent_mesh()
    several = closed_for_cells = 0
    for k, (name, shape) in enumerate(shapes.items()):
        scene.add(name, shape, draw_pose(rng, (0, 0, 0.2), 0.4))
        if k % 3 == 2:
            scene.move(f"thing {k - 1}", draw_pose(rng, (0, 0, 0.3), 0.4))
        if k % 3 == 1:
            scene.remove(f"thing {k - 1}")
        truth = closed_exactly(planner)
        assert not (truth & ~closed).any()  # nothing is open that is not free
        closed_for_cells += int((closed & ~truth).sum())
        while scene.test_waiting(40):
            assert not (truth & ~closed).any()
        assert np.array_equal(closed, truth)
        several += truth.sum() > 20
    assert several > 3 and closed_for_cells > 100
    scene.clear()
    assert not closed.any() and len(scene) == 0


def test_answers_keep_m_from_the_scene_and_from_the_frame(small_map, rng):
    planner = odm.ReactivePlanner(small_map, always_replan=True)
    m, answered = small_map.safety.m, 0
    drawn = [draw_valid(planner, rng) for _ in range(12)]
    for _ in range(14):
        planner.scene.clear()
        for k, shape in enumerate(draw_shapes(rng, 2, middle=(0, 0, 0.6))):
            planner.scene.add(f"{k}", shape)
        ends = [q for q in drawn if planner.static.motion_free(q, np.zeros_like(q))]
        if len(ends) < 2:
            continue
        planner.set_goals([ends[0]])
        answer = planner.step(NOBODY, q=ends[1])
        for a, dq in legs(planner.robot, answer.path):
            gap = smallest_solid_gap(small_map, a, dq, placed(planner.scene), 15)
            assert gap >= m - 1e-7
            answered += 1
    assert answered > 8


def test_a_shape_costs_no_covering_radius(small_map, planner):
    """1.2 cm from the cover a box is clear; its samples would need 4 cm."""
    q, m = HOME, small_map.safety.m
    box = odm.Box((0.02, 0.02, 0.02))
    tool = tool_pose(planner.robot, q)[:3, 3]
    outward = tool * [1.0, 1.0, 0.0] / np.linalg.norm(tool[:2])
    low, high, still = 0.0, 0.6, np.zeros_like(q)  # how far out it just touches
    for _ in range(30):
        x = 0.5 * (low + high)
        planner.scene.add("box", box, pose_of(tool + x * outward, np.zeros(3)))
        low, high = (low, x) if planner.static.clear_of_place(q, still) else (x, high)
        planner.scene.remove("box")
    T = pose_of(tool + high * outward, np.zeros(3))
    planner.scene.add("box", box, T)
    assert planner.is_free(q, q)
    gap = smallest_solid_gap(small_map, q, still, placed(planner.scene), 1)
    assert m - 1e-9 <= gap < m + 0.002
    planner.scene.remove("box")
    planner.set_static(box.moved(T))  # by its samples
    assert not planner.is_free(q, q)


def test_the_path_in_use_stays_where_it_is_free_and_goes_where_it_is_not(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    first = planner.step(NOBODY, q=HOME)
    planner.scene.add("far", odm.Sphere(0.05), pose_of([0.0, 0.0, 3.0], np.zeros(3)))
    planner.scene.add("low", odm.Sphere(0.02), pose_of([0.55, 0, 0.05], np.zeros(3)))
    kept = planner.step(NOBODY, q=HOME)
    assert kept.status == "following" and np.array_equal(kept.path, first.path)
    planner.scene.add("wall", WALL, OVER)
    around = planner.step(NOBODY, q=HOME)
    assert around.status == "replanned" and len(around.path) > 2
    for a, dq in legs(planner.robot, around.path):
        assert planner.is_free(a, a + dq)
    assert "wall" in planner.is_free(HOME, AWAY).reason
    planner.scene.remove("wall")
    assert planner.is_free(HOME, AWAY)
    assert planner.step(NOBODY, q=HOME).path.size


def test_what_stands_on_the_way_behind_keeps_the_robot_from_going_back(small_map):
    """It closes no leg that is ahead, so the path stays; but not that behind."""
    planner = odm.ReactivePlanner(small_map)
    planner.scene.add("wall", WALL, OVER)
    planner.set_goals([AWAY])
    path = np.array(planner.step(NOBODY, q=HOME).path)
    late = 0.5 * (path[-3] + path[-2])
    planner.step(NOBODY, q=late)
    passed = tool_pose(planner.robot, 0.5 * (path[0] + path[1]))[:3, 3]
    planner.scene.add("ball", odm.Sphere(0.03), pose_of(passed, np.zeros(3)))
    assert planner.step(NOBODY, q=late).status == "following"
    back = planner.step(NOBODY, q=path[0])
    assert not planner.is_free(path[0], path[1])
    for a, dq in legs(planner.robot, back.path):
        assert planner.is_free(a, a + dq)


def in_way_of(planner, way, path):
    """Return where a small ball stands in one path's way, not in another's; or None."""
    clear = planner.static.motion_free
    for a, dq in legs(planner.robot, way):
        at = pose_of(tool_pose(planner.robot, a + 0.5 * dq)[:3, 3], np.zeros(3))
        planner.scene.add("ball", odm.Sphere(0.01), at)
        kept = all(clear(*leg) for leg in legs(planner.robot, path))
        planner.scene.remove("ball")
        if kept:
            return at
    return None


def test_what_betters_a_path_is_not_taken_through_a_new_object(small_map):
    """A candidate that waits, or a cut that the next search would take."""
    probe, found = odm.ReactivePlanner(small_map), 0
    for seed in range(8):
        planner, points, answer = on_its_way(small_map, seed)
        planner.improve(30)
        better, cuts = planner.memory.better, planner.memory.shortcuts
        at = in_way_of(probe, better.q[: better.count[0]].copy(), answer.path)
        if at is not None:
            found += (cuts.key >= 0).any()
            planner.scene.add("ball", odm.Sphere(0.01), at)
            assert not (cuts.key >= 0).any()
            for leg in legs(planner.robot, planner.step(points, q=HOME).path):
                assert planner.static.motion_free(*leg)
            if found:
                return
    assert found


def test_a_goal_in_the_new_object_is_not_reached_and_comes_back(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    assert planner.step(NOBODY, q=HOME).path.size
    tool = odm.ReactivePlanner(small_map)
    T = pose_of(tool_pose(tool.robot, AWAY)[:3, 3], np.zeros(3))
    planner.scene.add("ball", odm.Sphere(0.1), T)
    held = planner.step(NOBODY, q=HOME)
    assert held.status == "holding"
    assert "goal 0 is not free" in held.reason and "would touch ball" in held.reason
    with pytest.raises(BadInput, match="goal 0 is not free: .* would touch ball"):
        planner.set_goals([AWAY + 1e-3])
    planner.scene.remove("ball")
    assert planner.step(NOBODY, q=HOME).path.size


def test_improving_tests_what_waits(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    planner.scene.add("wall", WALL, OVER)
    waits = planner.scene.waiting
    planner.step(NOBODY, q=HOME)
    planner.improve(3)
    assert waits > 20 and waits - planner.scene.waiting == 12
    for _ in range(40):
        planner.improve(budget=8)
    assert planner.scene.waiting == 0


@pytest.mark.parametrize("at_once", [0, 5, 400])
def test_nodes_beyond_the_first_wait_closed_and_come_to_the_same(
    small_map, monkeypatch, at_once
):
    monkeypatch.setattr(place, "NODES_AT_ONCE", at_once)
    planner = odm.ReactivePlanner(small_map)
    planner.scene.add("wall", WALL, OVER)
    planner.scene.add("ball", odm.Sphere(0.1), pose_of([0.3, 0, 0.4], np.zeros(3)))
    closed, exact = planner.memory.graph.closed, closed_exactly(planner)
    assert (closed | ~exact).all() and not np.array_equal(closed, exact)
    waits = planner.scene.waiting
    assert planner.scene.test_waiting(7) == waits - 7 and (closed | ~exact).all()
    planner.scene.test_waiting()
    assert np.array_equal(closed, exact)
    planner.scene.clear()
    assert not closed.any()


def test_the_same_calls_give_the_same_bytes_and_a_memory_goes_on(small_map, rng):
    def begun():
        planner = odm.ReactivePlanner(small_map)
        planner.set_goals([AWAY])
        planner.scene.add("wall", WALL, OVER)
        planner.scene.add("ball", odm.Sphere(0.1), pose_of([0.3, 0, 0.4], np.zeros(3)))
        planner.scene.move("wall", OVER @ pose_of([0, 0.1, 0], np.zeros(3)))
        return planner

    one, other = begun(), begun()
    for planner in (one, other):
        planner.step(NOBODY, q=HOME)
        planner.improve(2)
    saved = one.save_memory()
    assert not differences(saved, other.save_memory())
    fresh = odm.ReactivePlanner(small_map)
    with pytest.raises(BadInput, match="saved with another place"):
        fresh.load_memory(saved)
    # the same scene by another way, and tested farther than the one that was saved
    fresh.scene.add("ball", odm.Sphere(0.1), pose_of([0.3, 0, 0.4], np.zeros(3)))
    fresh.scene.add("wall", WALL, OVER @ pose_of([0, 0.1, 0], np.zeros(3)))
    fresh.scene.test_waiting()
    fresh.load_memory(saved)
    closed = fresh.memory.graph.closed
    assert np.array_equal(closed, one.memory.graph.closed)
    for k in range(4):
        points = odm.sample_capsules(POST + 0.05 * k, 0.03)
        answers = [p.step(points, q=HOME) for p in (one, fresh)]
        assert answers[0].path.tobytes() == answers[1].path.tobytes()
        assert [p.improve(2) for p in (one, fresh)][0] >= 0
        assert not differences(one.save_memory(), fresh.save_memory())


def test_objects_stand_in_the_world(small_map):
    planner = odm.ReactivePlanner(small_map)
    moved = pose_of([2.0, -1.0, 0.0], [0.0, 0.0, 0.7])
    planner.scene.add("wall", WALL, moved @ OVER)
    assert planner.is_free(HOME, AWAY)
    planner.set_base(moved)
    assert "would touch wall" in planner.is_free(HOME, AWAY).reason
    planner.set_extra_clearance(0.05)
    assert np.array_equal(planner.memory.graph.closed, closed_exactly(planner))
    planner.set_base(np.eye(4))
    assert planner.is_free(HOME, AWAY) and not planner.memory.graph.closed.any()


def test_set_static_and_the_scene_stand_side_by_side(planner):
    planner.scene.add("ball", odm.Sphere(0.05), pose_of([0.4, 0, 0.4], np.zeros(3)))
    alone = planner.scene.test_waiting() or planner.memory.graph.closed.sum()
    planner.set_static(WALL.moved(OVER))
    assert "set_static" in planner.is_free(HOME, AWAY).reason
    planner.set_static(np.zeros((0, 3)))
    assert planner.memory.graph.closed.sum() == alone > 0


def test_a_buffer_that_is_filled_anew_changes_no_scenery(planner):
    tip = tool_pose(planner.robot, HOME)[:3, 3]
    buffer = odm.sample_capsules([[*tip, *tip, 0.05]], 0.03)
    planner.set_static(buffer)
    assert not planner.is_free(HOME, HOME)
    buffer[:] = 3.0
    planner.set_base(np.eye(4))
    assert not planner.is_free(HOME, HOME)


def test_scenery_of_no_points_is_none_to_a_memory(small_map):
    planner, fresh = odm.ReactivePlanner(small_map), odm.ReactivePlanner(small_map)
    planner.set_static(NOBODY)
    fresh.load_memory(planner.save_memory())
    assert not differences(fresh.save_memory(), planner.save_memory())


def test_a_scene_file_is_loaded_whole_or_not_at_all(planner, tmp_path):
    file = tmp_path / "cell.scene"
    file.write_text(
        "cell\n* wall\n1\nbox\n0.1 0.6 0.3\n0 0 0.95\n0 0 0 1\n0 0 0 0\n"
        "* post\n1\ncylinder\n0.05 0.2\n0 2 0\n0 0 0 1\n0 0 0 0\n.\n"
    )
    assert planner.scene.load(file) == ["wall", "post"]
    assert list(planner.scene) == ["wall", "post"] and "post" in planner.scene
    assert "would touch wall" in planner.is_free(HOME, AWAY).reason
    planner.scene.remove("wall")
    with pytest.raises(BadInput, match="has an object 'post' already"):
        planner.scene.load(file)
    assert "wall" not in planner.scene and planner.is_free(HOME, AWAY)
    file.write_text(file.read_text().replace("* post", "* wall"))
    with pytest.raises(BadInput, match="names two objects 'wall'"):
        planner.scene.load(file)
    assert list(planner.scene) == ["post"]
    file.write_text(file.read_text().replace("* wall\n1\ncyl", "* post\n1\ncyl"))
    planner.scene.load(file, pose_of([5.0, 0, 0], np.zeros(3)), prefix="b/")
    assert planner.scene["b/wall"].T_world_object[0, 3] == 5.0
    assert planner.is_free(HOME, AWAY)


def test_a_scene_that_is_saved_stands_as_it_stood(small_map, tmp_path, rng):
    one, other = (odm.ReactivePlanner(small_map) for _ in range(2))
    for k, kind in enumerate(KINDS):
        one.scene.add(f"a {kind}", draw_shape(kind, rng), draw_pose(rng, spread=0.2))
    one.scene.add("two", [odm.Sphere(0.1), WALL], OVER)
    file = one.scene.save(tmp_path / "cell.scene")
    assert other.scene.load(file) == list(one.scene)
    for planner in (one, other):
        planner.scene.test_waiting()
    assert one.memory.graph.closed.sum() > 20
    assert np.array_equal(one.memory.graph.closed, other.memory.graph.closed)
    one.scene.add("points", odm.surface_of(WALL, 0.03))
    with pytest.raises(BadInput, match="'points' holds a Surface"):
        one.scene.save(file)


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda s: s.add("", WALL), "cannot be called ''; give its name first"),
        (lambda s: s.add("a\nb", WALL), "cannot be called 'a.nb'"),
        (lambda s: s.save("scene.txt"), "give a name ending in .scene"),
        (lambda s: s.save("/none/of/these.scene"), "cannot be written"),
        (lambda s: s.add(3, WALL), "cannot be called 3"),
        (lambda s: s.add("there", WALL), "has an object 'there' already; move"),
        (lambda s: s.add("a", np.zeros((3, 3))), "holds a ndarray, which is no shape"),
        (lambda s: s.add("a", []), "has no shape; give one"),
        (lambda s: s.add("a", WALL, np.ones((4, 4))), "not a rigid"),
        (lambda s: s.add("a", WALL, np.full((4, 4), np.nan)), "T holds NaN"),
        (lambda s: s.add("a", odm.Sphere(9.0)), "is too large"),
        (
            lambda s: s.add("a", odm.surface_of(WALL, 0.05)),
            "0.05 m of 'box' is larger than the map's rho",
        ),
        (lambda s: s.add("a", Mesh(np.eye(3), [[0, 1, 2]])), "is not closed"),
        (lambda s: s.move("b", OVER), "no object 'b'; it is: 'there'"),
        (lambda s: s.move("there", np.zeros(3)), r"T has shape \(3,\)"),
        (lambda s: s.remove(["there"]), "no object"),
        (lambda s: s.load("none.scene"), "does not exist"),
        (lambda s: s.test_waiting(-1), "most is -1"),
    ],
)
def test_a_bad_call_is_told_and_changes_nothing(planner, call, told):
    planner.scene.add("there", WALL, OVER)
    before = planner.scene.identity(), planner.memory.graph.closed.tobytes()
    with pytest.raises(BadInput, match=told):
        call(planner.scene)
    assert before == (planner.scene.identity(), planner.memory.graph.closed.tobytes())
    planner.scene.move("there", np.eye(4))


def test_a_file_in_millimetres_is_refused_whole(planner, tmp_path):
    row = "1\nbox\n2 2 2\n0 0 0\n0 0 0 1\n0 0 0 0\n0\n"
    near, far = "0 0 900\n0 0 0 1\n", "900 0 0\n0 0 0 1\n"
    (tmp_path / "mm.scene").write_text(f"s\n* a\n{near}{row}* b\n{far}{row}.\n")
    with pytest.raises(BadInput, match="'a' would stand .* give its pose"):
        planner.scene.load(tmp_path / "mm.scene")
    assert not len(planner.scene)
