"""Where the roadmap has no path: a search by certified motions, kept within bounds."""

import numpy as np
import pytest
from small import AWAY, HOME, ball_at, draw_valid

import odm
from odm import PlannerSettings, Sphere, surface_of
from odm.exact.distances import ExactRobot, obstacles_of
from odm.exact.fcl_robot import FclRobot
from odm.planner import decision
from odm.planner.attaching import CELLS, COSTS
from odm.planner.saved_memory import differences
from odm.search._attach import WAITS, free_first
from odm.search._bound import NO_EXIT_SIDE, START_SIDE
from odm.search._cost_to_go import lower_costs
from odm.search._items import FREE
from odm.search._state import NO_ITEM
from roadmap.kinematics.forward import tool_pose

FINE = 0.01  # [m] covering radius of the balls' samples
OFF = PlannerSettings(search=0)


class Scene:
    """Balls in the plane that the small arm moves in, and two ends that are free."""

    def __init__(self, planner, rng):
        self.ends = []
        while len(self.ends) < 2:
            self.balls = [
                Sphere(rng.uniform(0.03, 0.06), odm_pose(at))
                for at in rng.uniform([-0.7, -0.05, 0.3], [0.7, 0.05, 1.0], (6, 3))
            ]
            self.points = points_of(self.balls)
            planner.step(self.points, q=HOME, covering_radius=FINE)
            drawn = [draw_valid(planner, rng) for _ in range(20)]
            self.ends = [q for q in drawn if planner.stands_clear(q)][:2]

    def ask(self, planner):
        return planner.step(
            self.points, q=self.ends[0], covering_radius=FINE, closed=True
        )


def odm_pose(at):
    T = np.eye(4)
    T[:3, 3] = at
    return T


def points_of(balls):
    return np.concatenate([surface_of(ball, FINE).points for ball in balls])


def solved(planner, scene, calls=8):
    """Ask, and go on between frames, until there is a path or no budget left."""
    planner.reset()
    planner.set_goals([scene.ends[1]])
    answer = scene.ask(planner)
    while answer.status == "holding" and calls:
        calls -= 1
        if planner.improve(8):
            answer = scene.ask(planner)
    return answer


def assert_free(cell_map, path, balls, m=0.0):
    """Measure exact solids along a path; they share nothing with the search."""
    exact, fcl = ExactRobot(cell_map.robot), FclRobot(cell_map.robot)
    obstacles = obstacles_of(balls)
    fcl.set_obstacles(balls)
    for a, b in zip(path[:-1], path[1:], strict=True):
        for t in np.linspace(0.0, 1.0, 2 + int(np.abs(b - a).max() / 0.03)):
            q = a + t * (b - a)
            assert not fcl.collides(q)
            assert exact.distance(q, obstacles, cap=0.1).distance >= m
            within = (cell_map.robot.lower - 1e-9 <= q) & (
                q <= cell_map.robot.upper + 1e-9
            )
            assert (within | cell_map.robot.continuous).all()
            assert exact.self_distance(q).distance > 0.0


@pytest.fixture(scope="module")
def scenes(small_map):
    rng = np.random.default_rng(4)
    planner = odm.ReactivePlanner(small_map, settings=OFF)
    return [Scene(planner, rng) for _ in range(60)]


@pytest.fixture(scope="module")
def hard(small_map, scenes):
    """Scenes for which the roadmap has no path, but there is one."""
    bare = odm.ReactivePlanner(small_map, settings=OFF)
    full = odm.ReactivePlanner(small_map)
    found = [
        scene
        for scene in scenes
        if solved(bare, scene, 0).status == "holding"
        and solved(full, scene).status != "holding"
    ]
    assert len(found) >= 5
    return found


def test_what_the_roadmap_cannot_answer_is_searched_and_never_touches(
    small_map, scenes, hard
):
    planner = odm.ReactivePlanner(small_map)
    bare = odm.ReactivePlanner(small_map, settings=OFF)
    for scene in scenes:
        answer = solved(planner, scene)
        if answer.status == "holding":
            assert solved(bare, scene, 0).status == "holding"
            assert answer.stage is None
            continue
        assert np.array_equal(answer.path[0], scene.ends[0])
        assert answer.goal == 0 and answer.certified == "whole surface"
        assert_free(small_map, answer.path, scene.balls, small_map.safety.m)
        for a, b in zip(answer.path[:-1], answer.path[1:], strict=True):
            assert planner.is_free(a, b)
        if scene in hard:
            assert answer.stage == "search"
        else:
            assert answer.stage in ("roadmap", "straight")
        follows = scene.ask(planner)
        assert follows.status == "following" and follows.stage == "path in use"


def test_the_same_input_gives_the_same_bytes(small_map, hard):
    def told(scene):
        planner = odm.ReactivePlanner(small_map, settings=PlannerSettings(search=60))
        answer = solved(planner, scene, 40)
        return answer.status, answer.path.tobytes(), str(answer.work)

    for scene in hard[:4]:
        assert told(scene) == told(scene)


def test_a_frame_spends_its_budget_and_little_more(small_map, hard):
    """An eighth until all is spent; from then on a sixteenth in every eighth frame."""
    planner = odm.ReactivePlanner(small_map, settings=PlannerSettings(search=640))
    held = joined = 0
    for scene in hard:
        planner.reset()
        planner.set_goals([scene.ends[1]])
        before = 0
        for _ in range(24):
            budget = min(80, max(40, 640 - before))
            answer = scene.ask(planner)
            spent = planner.connector.looked - before
            if answer.status != "holding":
                break
            if (
                before >= 640
                and planner.frame_number % planner.connector.settings.search_every
            ):
                assert spent == 0  # all is spent: the next search waits
                continue
            if planner.joined and spent == 0 and not planner.connector.is_new:
                joined += 1  # more nodes instead: one costly job in a frame
                continue
            # one motion more than the budget: no motion takes so many
            assert budget <= spent < budget + 300
            before += spent
            held += budget == 40
    assert held >= 2 and joined >= 1


def test_a_robot_on_its_way_is_not_searched_for_long(small_map, hard):
    planner = odm.ReactivePlanner(small_map, settings=PlannerSettings(search=1600))
    looked = []
    for scene in hard:
        planner.reset()
        planner.set_goals([scene.ends[1]])
        begin = scene.ends[0]
        planner.step(odm.Obstacles(spheres=np.array([[0, 0, 9, 0.1]])), q=begin + 0.01)
        answer = scene.ask(planner)
        if answer.status == "holding":
            looked.append(planner.connector.looked)
    assert looked and max(looked) < 100 + 300


def test_what_is_left_is_searched_between_frames(small_map, hard):
    planner = odm.ReactivePlanner(small_map, settings=PlannerSettings(search=20))
    went_on = 0
    for scene in hard:
        planner.reset()
        planner.set_goals([scene.ends[1]])
        answer = scene.ask(planner)
        calls = 0
        while answer.status == "holding" and calls < 30:
            before = planner.memory.trees.drawn.item()
            found = planner.improve(4)
            assert found in (0, 1)
            if found:
                answer = scene.ask(planner)
                assert answer.stage == "search"
                went_on += 1
            elif planner.memory.trees.count.all():
                assert planner.memory.trees.drawn.item() > before
            calls += 1
        assert planner.improve(0) == 0
    assert went_on >= 3


def test_nothing_is_searched_where_that_is_switched_off(small_map, hard):
    planner = odm.ReactivePlanner(small_map, settings=OFF)
    answer = solved(planner, hard[0], 5)
    assert answer.status == "holding"
    assert planner.memory.trees.drawn.item() == 0
    assert "search" not in answer.reason


def test_an_unsolved_frame_says_how_far_the_search_has_come(small_map):
    planner = odm.ReactivePlanner(small_map)
    low = np.array([[0.0, 0.0, 0.57, 0.0, 0.0, 1.3, 0.05]])  # the elbow cannot pass
    wall = odm.sample_capsules(low, 0.03)
    planner.set_goals([AWAY])
    answer = planner.step(wall, q=HOME)
    assert answer.status == "holding" and answer.stage is None
    assert "search beyond the roadmap looked at 1" in answer.reason
    # the roadmap has none, which is no proof that there is none
    assert answer.reason.startswith("no free path to goal 0 was found: on the roadmap")
    planner.improve(8)
    again = planner.step(wall, q=HOME)
    assert "search beyond the roadmap looked at " in again.reason
    assert again.reason != answer.reason


def test_a_start_or_goal_in_contact_is_not_searched(small_map):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    for q in (HOME, AWAY):
        points = ball_at(tool_pose(small_map.robot, q)[:3, 3])  # in the hand
        assert planner.step(points, q=HOME).status == "holding"
        assert planner.improve(8) == 0
    assert planner.memory.trees.drawn.item() == 0


def test_an_obstacle_on_a_found_path_ends_it_and_its_leaving_brings_it_back(
    small_map, hard
):
    blocked = 0
    settings = PlannerSettings(persistence_frames=0, history_s=0.0)
    for scene in hard:
        planner = odm.ReactivePlanner(small_map, settings=settings)
        answer = solved(planner, scene)
        middle = 0.5 * (answer.path[0] + answer.path[1])
        hand = tool_pose(small_map.robot, middle)[:3, 3]
        more = [*scene.balls, Sphere(0.05, odm_pose(hand))]
        points = points_of(more)
        for _ in range(3):
            now = planner.step(
                points, q=scene.ends[0], covering_radius=FINE, closed=True
            )
            planner.improve(8)
            if now.status != "holding":
                assert_free(small_map, now.path, more, small_map.safety.m)
            else:
                blocked += 1
        drawn = planner.memory.trees.drawn.item()
        back = scene.ask(planner)
        assert back.status != "holding"
        assert planner.memory.trees.drawn.item() == drawn  # it was remembered
    assert blocked


def test_while_balls_move_every_answer_is_free_in_its_own_frame(small_map, hard):
    rng = np.random.default_rng(1)
    answers = set()
    settings = PlannerSettings(persistence_frames=0, history_s=0.0, search=200)
    for scene in hard[:6]:
        planner = odm.ReactivePlanner(small_map, settings=settings)
        planner.set_goals([scene.ends[1]])
        drift = rng.normal(0.0, 0.02, (6, 3)) * [1, 0, 1]
        for k in range(25):
            s = np.sin(0.4 * k)
            balls = [
                ball.moved(odm_pose(s * d))
                for ball, d in zip(scene.balls, drift, strict=True)
            ]
            answer = planner.step(
                points_of(balls), q=scene.ends[0], covering_radius=FINE, closed=True
            )
            answers.add(answer.stage)
            if answer.status != "holding":
                assert_free(small_map, answer.path, balls, small_map.safety.m)
            planner.improve(3)
            if k % 8 == 7:  # on a found path it will be blocked by what moves
                planner.path.drop()
    assert {"search", "path in use"} <= answers


def test_memory_stays_bounded_over_many_scenes(small_map, scenes):
    planner = odm.ReactivePlanner(small_map)
    sizes = {n: a.shape for n, a in planner.memory.arrays("goal").items()}
    for _ in range(3):
        for scene in scenes:
            solved(planner, scene, 6)
            trees, found = planner.memory.trees, planner.memory.found
            assert trees.count.max() <= trees.parent.shape[1]
            assert found.count.max() <= found.vertex.shape[1]
    assert {n: a.shape for n, a in planner.memory.arrays("goal").items()} == sizes
    items, entries = planner.memory.pool.used
    assert items < len(planner.memory.pool.begin)
    assert entries < len(planner.memory.pool.block)


def test_trees_that_are_full_begin_anew(small_map, hard):
    planner = odm.ReactivePlanner(small_map)
    solved(planner, hard[0])
    trees = planner.memory.trees
    trees.count[0] = trees.parent.shape[1]
    planner.path.drop()
    planner.memory.found.count[:] = 0
    for _ in range(40):
        answer = hard[0].ask(planner)
        planner.improve(8)
    assert answer.status == "following"
    assert trees.count.max() < trees.parent.shape[1]


def test_a_search_goes_on_alike_from_a_saved_memory(small_map, hard):
    settings = PlannerSettings(search=20)
    for scene in hard[:4]:
        one = odm.ReactivePlanner(small_map, settings=settings)
        one.set_goals([scene.ends[1]])
        scene.ask(one)
        one.improve(1)
        other = odm.ReactivePlanner(small_map, settings=settings)
        saved = one.save_memory()
        other.load_memory(saved)
        assert not differences(other.save_memory(), saved)
        for _ in range(12):
            assert one.improve(2) == other.improve(2)
            a, b = scene.ask(one), scene.ask(other)
            assert (a.status, a.stage) == (b.status, b.stage)
            assert a.path.tobytes() == b.path.tobytes()
            assert not differences(one.save_memory(), other.save_memory())


def test_a_found_path_is_joined_from_beside_its_start(small_map, hard):
    planner = odm.ReactivePlanner(
        small_map, settings=PlannerSettings(persistence_frames=0, history_s=0.0)
    )
    joined = 0
    for scene in hard:
        solved(planner, scene)
        drawn = planner.memory.trees.drawn.item()
        planner.path.drop()
        for j in range(3):
            q = scene.ends[0].copy()
            q[j] += 0.02 if q[j] < 0 else -0.02
            answer = planner.step(scene.points, q=q, covering_radius=FINE, closed=True)
            if answer.stage == "search":
                assert np.array_equal(answer.path[0], q)
                assert_free(small_map, answer.path, scene.balls, small_map.safety.m)
                joined += planner.memory.trees.drawn.item() == drawn
            planner.path.drop()
    assert joined


def test_no_found_path_is_joined_where_it_began_outside_the_limits(small_map, hard):
    planner = odm.ReactivePlanner(
        small_map, settings=PlannerSettings(persistence_frames=0, history_s=0.0)
    )
    robot, joined = planner.robot, 0
    for scene in hard:
        end = scene.ends[0].copy()
        for j in np.flatnonzero(~robot.continuous):
            scene.ends[0] = end.copy()
            scene.ends[0][j] = robot.upper[j] + 9e-4  # as an encoder may tell it
            if solved(planner, scene).stage != "search":
                continue
            planner.path.drop()
            q = scene.ends[0].copy()
            q[j] -= 2e-3
            answer = planner.step(scene.points, q=q, covering_radius=FINE, closed=True)
            joined += answer.stage == "search"
            within = answer.path <= robot.upper
            assert (within | robot.continuous).all()
        scene.ends[0] = end
    assert joined


def test_in_contact_nothing_is_grown_and_nothing_joined(planner, monkeypatch):
    planner.always_replan = False
    planner.set_goals([AWAY])
    at_goal = ball_at(tool_pose(planner.robot, AWAY)[:3, 3], 0.05)
    assert planner.step(at_goal, q=HOME).status == "holding"
    looked = []
    for owner, name in ((planner.static, "still"), (planner.attacher, "attach_start")):
        monkeypatch.setattr(owner, name, lambda *_a, **_k: looked.append(1))
    for _ in range(5):  # also where it lingers
        assert planner.step(at_goal, q=HOME).status == "holding"
        assert not looked
    monkeypatch.undo()
    away = ball_at(np.array([0.0, 0.0, 3.0]), 0.05)
    assert planner.step(away[:0], q=HOME).status != "holding"


def test_beside_shapes_a_found_path_gets_its_cells_between_frames(small_map, hard):
    """The close test decides till then: cells of a leg take longer than its frames."""
    planner, seen = odm.ReactivePlanner(small_map), 0
    pool, found, connector = (
        planner.memory.pool,
        planner.memory.found,
        planner.connector,
    )
    for scene in hard:
        balls = [[*ball.T_base_shape[:3, 3], ball.radius] for ball in scene.balls]
        obstacles = odm.Obstacles(spheres=np.array(balls))
        planner.reset()
        planner.set_goals([scene.ends[1]])
        answer = planner.step(obstacles, q=scene.ends[0])
        for _ in range(8):
            if answer.status != "holding":
                break
            planner.improve(8)
            answer = planner.step(obstacles, q=scene.ends[0])
        if answer.stage != "search":
            continue
        seen, k = seen + 1, (found.next.item() - 1) % len(found.count)
        n = found.count.item(k)
        assert connector.lacks_cells and (found.ref[k, : n - 1] == NO_ITEM).all()
        assert (planner.path.items() == NO_ITEM).all()
        assert 0 < connector.sweep_cells(1) <= 1
        calls = 0
        while connector.lacks_cells:
            planner.improve(8)
            calls += 1
            assert calls < 20
        corners = found.q[k, :n]
        first = planner.attacher.sweep(corners[:-1], np.diff(corners, axis=0))
        for i, item in enumerate(found.ref[k, : n - 1].tolist()):
            mine, again = (slice(pool.begin[j], pool.end[j]) for j in (item, first + i))
            assert item >= 0 and np.array_equal(pool.block[mine], pool.block[again])
            assert np.array_equal(pool.mask[mine], pool.mask[again])
        assert planner.step(obstacles, q=scene.ends[0]).status != "holding"
    assert seen > 1


def reached(planner, nodes):
    """Walk over what the frame leaves free from some nodes; plain, by sets."""
    roadmap = planner.cell_map.roadmap
    bad_nodes = set(planner.invalid_nodes().tolist())
    bad_edges = set(planner.invalid_edges().tolist())
    beside = {}
    for e, (a, b) in enumerate(roadmap.edges.tolist()):
        if e not in bad_edges and a not in bad_nodes and b not in bad_nodes:
            beside.setdefault(a, []).append(b)
            beside.setdefault(b, []).append(a)
    seen, queue = set(), [n for n in nodes if n not in bad_nodes]
    while queue:
        node = queue.pop()
        if node not in seen:
            seen.add(node)
            queue += beside.get(node, [])
    return seen


def looked_at(planner, nodes, vertex):
    """Return (k,) which nodes a frame without a path looks at, to join a vertex."""
    ordered, found = np.empty((2, len(nodes)), np.int64)
    q, most = planner.frame.q, len(nodes)
    free_first(planner.memory.table, q, nodes, vertex, most, ordered, found)
    assert sorted(ordered.tolist()) == nodes.tolist()
    return found != WAITS


def test_a_motion_leads_on_where_it_joins_what_a_search_reached_with_what_not(
    small_map, scenes
):
    planner = odm.ReactivePlanner(small_map, True, settings=OFF)
    m = planner.memory
    every, told = np.arange(small_map.roadmap.n_nodes), 0
    shut = 0
    bad = np.zeros(len(every), np.bool_)
    for scene in scenes:
        if solved(planner, scene, 0).status != "holding":
            continue
        if not m.numbers.exhausted.item():
            continue  # no search began, or it ended for another reason
        run, frame = m.numbers.run.item(), m.numbers.frame.item()
        bad[:] = False
        bad[planner.invalid_nodes()] = True
        if m.numbers.exhausted.item() == NO_EXIT_SIDE:  # the start alone is looked at
            vertices = m.goals.count.item(1), m.goals.vertex.item(0)
            of_start, of_goal = (looked_at(planner, every, v) for v in vertices)
            assert of_start.all() and not of_goal.any()
            shut += 1
            continue
        if m.numbers.exhausted.item() == START_SIDE:
            memo = m.start_connections.memo[: m.start_connections.count[0]]
            nodes = m.start_connections.node[: len(memo)][memo == 4 * frame + FREE]
            near, far = m.goals.count.item(1), m.goals.vertex.item(0)
            known = m.search.done[: len(every)] == run
        else:
            n = m.goals.number.item(0)
            nodes = m.goals.node[0, :n]
            near, far = m.goals.vertex.item(0), m.goals.count.item(1)
            known = m.search.flood[: len(every)] == run
        by_walk = np.isin(every, list(reached(planner, nodes.tolist())))
        if m.numbers.exhausted.item() == START_SIDE:
            assert np.array_equal(by_walk, known & ~bad)
        leads_on, opposite = (
            looked_at(planner, every, near),
            looked_at(planner, every, far),
        )
        assert not (leads_on & known).any() and (leads_on | known).all()
        assert np.array_equal(opposite, known)
        told += 1
    assert told >= 3 and shut


def test_nodes_that_the_frame_blocks_are_not_joined_but_wait(small_map, scenes):
    planner = odm.ReactivePlanner(small_map, True, settings=OFF)
    attacher, tried = planner.attacher, 0
    for scene in scenes:
        if solved(planner, scene, 0).status != "holding" or not attacher.lacks_nodes:
            continue
        waiting = {v: set(nodes.tolist()) for v, nodes in attacher._later.items()}
        joined = attacher.attach_free(2)
        left = {v: set(nodes.tolist()) for v, nodes in attacher._later.items()}
        gone = sum(len(waiting[v] - left.get(v, set())) for v in waiting)
        assert joined <= 2 and gone >= joined
        goals, n = planner.memory.goals, planner.memory.goals.number.item(0)
        for node in goals.node[0, n - joined : n] if not attacher.start_waits else ():
            assert node not in planner.invalid_nodes()
        tried += 1
    assert tried >= 3


def as_a_fresh_one(small_map, scene, planner):
    """Return the next answer, which a fresh planner with the memory gives, too."""
    fresh = odm.ReactivePlanner(small_map, True, settings=OFF)
    fresh.load_memory(planner.save_memory())
    again = scene.ask(planner)
    assert again.path.tobytes() == scene.ask(fresh).path.tobytes()
    assert not differences(planner.save_memory(), fresh.save_memory())
    return again


def test_what_a_frame_joins_to_a_shut_goal_gets_costs_and_cells_later(
    small_map, scenes
):
    """That frame uses the motion by its close test, and later ones as any other."""
    planner = odm.ReactivePlanner(small_map, True, settings=OFF)
    m, attacher, paid, answered = planner.memory, planner.attacher, 0, 0
    for scene in scenes:
        planner.reset()
        planner.set_goals([scene.ends[1]])
        for _ in range(12):
            answer = scene.ask(planner)
            n = m.goals.number.item(0)
            if attacher.owes == COSTS:
                break
        if attacher.owes != COSTS:
            continue
        assert m.goals.ref[0, n - 1] == NO_ITEM
        if answer.status != "holding":
            assert_free(small_map, answer.path, scene.balls)
        again = as_a_fresh_one(small_map, scene, planner)
        assert answer.status == "holding" or again.status != "holding"
        h, lengths = np.full_like(m.goals.h[0], np.inf), m.graph.adj_length
        ends, n = (lengths.min(), lengths.max()), m.goals.number.item(0)
        if attacher.owes == COSTS:  # it has joined another one since
            continue
        joins = m.goals.node[0, :n], m.goals.length[0, :n]
        lower_costs(m.graph, *joins, m.search, h, *ends)
        assert np.array_equal(h, m.goals.h[0])
        planner.improve(8)  # a new start's path comes first
        planner.improve(8)
        refs, n = m.goals.ref[0], m.goals.number.item(0)
        assert attacher.owes == 0 and (refs[:n] >= 0).all()
        q = small_map.roadmap.nodes[m.goals.node[0, :n]]
        begun = np.ascontiguousarray(q), planner.frame.difference(q, m.goals.q[0])
        first = attacher.sweep(*begun)
        for two in zip(refs[:n], range(first, first + n), strict=True):
            cells = [slice(m.pool.begin[i], m.pool.end[i]) for i in two]
            assert np.array_equal(*(m.pool.mask[part] for part in cells))
        answered += answer.status != "holding"
        paid += 1
    assert paid >= 3 and answered >= 1


@pytest.mark.parametrize("many", [True, False])
def test_cells_of_a_goals_motions_wait_for_improve_beside_few_points(
    small_map, scenes, monkeypatch, many
):
    if many:
        monkeypatch.setattr(decision, "MANY_POINTS", 0)
    planner = odm.ReactivePlanner(small_map, True, settings=OFF)
    attacher, seen = planner.attacher, 0
    for scene in scenes:
        planner.reset()
        planner.set_goals([scene.ends[1]])
        answers = [scene.ask(planner).status for _ in range(12)]
        if "holding" not in answers or answers[-4:] != ["following"] * 4:
            continue  # a goal was not joined by the frame, or not long ago
        owed = attacher.owes
        assert owed in ((0,) if many else (0, CELLS))
        n = planner.memory.goals.number.item(0)
        bare = (planner.memory.goals.ref[0, :n] == NO_ITEM).any()
        assert bare == (owed == CELLS)
        seen += 1 if many else owed == CELLS
    assert seen >= 1


def test_a_planner_that_marked_points_anew_joins_goals_as_any_other(small_map, scenes):
    """Frames and what was marked are counted apart: verdicts are of the latter."""
    plain = odm.ReactivePlanner(small_map, True, settings=OFF)
    again, owed = odm.ReactivePlanner(small_map, True, settings=OFF), 0
    for planner in (plain, again):
        planner.step(scenes[0].points, q=HOME)
    again.set_extra_clearance(0.0)
    assert again.memory.numbers.frame.item() > again.frame.number
    for scene in scenes:
        for planner in (plain, again):
            planner.reset()
            planner.set_goals([scene.ends[1]])
        for _ in range(8):
            one, other = scene.ask(plain), scene.ask(again)
            assert one.path.tobytes() == other.path.tobytes()
            assert str(one.work) == str(other.work)
            assert plain.attacher.owes == again.attacher.owes
            owed += plain.attacher.owes > 0
    assert owed > 5


def test_what_frames_join_to_a_start_gets_its_cells_when_no_more_is_joined(
    small_map, scenes
):
    """Those frames use the motions as their close tests have freed them."""
    planner = odm.ReactivePlanner(small_map, True, settings=OFF)
    m, attacher, paid, used = planner.memory, planner.attacher, 0, 0
    starts, pool = m.start_connections, m.pool
    for scene in scenes:
        planner.reset()
        planner.set_goals([scene.ends[1]])
        for _ in range(4):
            answer = scene.ask(planner)
            if attacher.owes_start:
                break
        if not attacher.owes_start:
            continue
        n = starts.count.item(0)
        bare = np.flatnonzero(starts.ref[:n] == NO_ITEM)
        assert attacher.is_bare and len(bare)
        now = 4 * m.numbers.frame.item()
        for k in bare.tolist():
            dq = planner.frame.difference(
                planner.frame.q, small_map.roadmap.nodes[starts.node[k]]
            )
            assert starts.memo[k] == now + FREE
            assert planner.frame.motion_clear(planner.frame.q, dq)
        if answer.status != "holding":
            assert_free(small_map, answer.path, scene.balls)
            used += 1
        for _ in range(40):  # a frame that joins nothing sweeps one
            owed = np.count_nonzero(starts.ref[: starts.count.item(0)] == NO_ITEM)
            joins = planner.decision.joined
            again = as_a_fresh_one(small_map, scene, planner)
            assert answer.status == "holding" or again.status != "holding"
            left = np.count_nonzero(starts.ref[: starts.count.item(0)] == NO_ITEM)
            assert left == owed - 1 or joins or planner.decision.joined
            if not attacher.owes_start:
                break
        n = starts.count.item(0)
        refs = starts.ref[:n]
        assert not attacher.is_bare and (refs >= 0).all()
        nodes = small_map.roadmap.nodes[starts.node[:n]]
        here = np.repeat(planner.frame.q[None], n, axis=0)
        first = attacher.sweep(here, planner.frame.difference(here, nodes))
        for two in zip(refs, range(first, first + n), strict=True):
            cells = [slice(pool.begin[i], pool.end[i]) for i in two]
            assert np.array_equal(*(pool.mask[part] for part in cells))
        paid += 1
    assert paid >= 3 and used >= 1


def test_a_path_that_was_found_is_taken_before_more_nodes_are_joined(small_map, hard):
    planner, again = odm.ReactivePlanner(small_map, True), 0
    for scene in hard:
        if solved(planner, scene).stage != "search":
            continue
        planner.attacher.attach_free = None  # a call would end in an error
        answer = scene.ask(planner)
        del planner.attacher.attach_free
        assert answer.stage == "search" and not planner.joined
        again += 1
    assert again >= 3
