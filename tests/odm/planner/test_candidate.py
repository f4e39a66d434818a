"""What improving finds is a candidate: tested by the next frame before it is taken."""

import numpy as np
import pytest
from small import HOME, on_its_way

import odm
from roadmap.kinematics.forward import sphere_centers


def improved(cell_map, seed):
    """Return a planner whose candidate waits, its points, and its answer."""
    planner, points, answer = on_its_way(cell_map, seed)
    for _ in range(20):
        before = planner.path.q[: len(planner.path)].copy()
        planner.improve(8)
        assert np.array_equal(planner.path.q[: len(planner.path)], before)
        if planner.memory.numbers.candidate[0]:
            return planner, points, answer
        answer = planner.step(points, q=HOME)
    pytest.skip("nothing betters this path")


def is_free(planner, path):
    return all(planner.is_free(a, b) for a, b in zip(path, path[1:], strict=False))


def corners(path):
    return path.q[: len(path)].copy()


@pytest.mark.parametrize("seed", [0, 2, 3, 4])
def test_a_candidate_that_is_free_is_taken_by_the_next_frame(small_map, seed):
    planner, points, _ = improved(small_map, seed)
    better = corners(planner.candidate)
    answer = planner.step(points, q=HOME)
    assert answer.status != "holding"
    assert np.array_equal(corners(planner.path), better)
    assert not planner.memory.numbers.candidate[0]
    for a, b in zip(answer.path, answer.path[1:], strict=False):
        assert planner.is_free(a, b)


def test_where_it_is_blocked_the_frame_goes_on_as_before(small_map):
    # in most places what blocks the one blocks the other
    assert sum(went_on(small_map, seed) for seed in (0, 2, 3, 4, 5, 6)) > 2


def went_on(small_map, seed):
    """Block candidates but not paths; return in how many frames the path was kept."""
    planner, points, before = improved(small_map, seed)
    used, better = corners(planner.path), corners(planner.candidate)
    robot, rng, kept = small_map.robot, np.random.default_rng(seed), 0
    saved, fresh = planner.save_memory(), odm.ReactivePlanner(small_map)
    for _ in range(400):
        k = rng.integers(len(better) - 1)
        q = better[k] + rng.random() * (better[k + 1] - better[k])
        centers = sphere_centers(robot, q)[robot.moving]
        off = 0.08 * rng.normal(size=3)
        blocked = np.vstack([points, centers[-1 - rng.integers(9)] + off])
        fresh.step(blocked, q=HOME)
        if is_free(fresh, better) or not is_free(fresh, used):
            continue
        planner.load_memory(saved)
        answer = planner.step(blocked, q=HOME)
        assert answer.status == "following" and answer.work.searches == 0
        assert np.array_equal(corners(planner.path), used)
        assert not planner.memory.numbers.candidate[0]
        kept += 1
    return kept


def test_a_robot_that_is_somewhere_else_takes_none(small_map):
    planner, points, _ = improved(small_map, 0)
    planner.step(points, q=HOME + [0.05, -0.1, 0.1])
    assert not planner.memory.numbers.candidate[0]


def test_what_improves_the_path_keeps_its_cells_when_old_ones_are_thrown_away(
    small_map,
):
    """The pool is tidied while a candidate waits; its items are renumbered with it."""
    planner, _, _ = improved(small_map, 2)
    memory, candidate = planner.memory, planner.candidate

    def cells():
        pool, found = memory.pool, []
        for item in candidate.items().tolist():
            if item >= 0:
                part = slice(int(pool.begin[item]), int(pool.end[item]))
                found.append((pool.block[part].tobytes(), pool.mask[part].tobytes()))
        return found

    before = cells()
    assert before
    memory.pool.used[0] = len(memory.pool.begin) - 1  # as if it were full
    planner.attacher.tidy()
    assert memory.pool.used[0] < 200
    assert cells() == before
    assert candidate.items().max() < memory.pool.used[0]


def test_straight_to_the_goal_leaves_out_every_vertex_between(small_map):
    """The new leg is tested to the goal itself, so it must end there."""
    planner, goal = odm.ReactivePlanner(small_map), -HOME
    planner.set_goals([goal])
    planner.step(np.zeros((0, 3)), q=HOME)
    between = [HOME + [0.3, 0.0, 0.9], HOME + [-0.4, 0.1, 1.2], HOME + [-1.0, 0.0, 1.0]]
    detour = np.array([HOME, *between, goal])
    numbers = np.array([planner.attacher.new_vertex() for _ in detour])
    numbers[-1] = planner.memory.goals.vertex[0]
    first = planner.attacher.sweep(detour[:-1], np.diff(detour, axis=0))
    items = list(range(first, first + len(detour) - 1))
    planner.path.lead(0, numbers, detour, items)
    planner.path.followed = True
    planner.candidate.begin()
    assert planner.smoother.go_straight() == 1
    found = corners(planner.candidate)
    assert np.array_equal(found[-1], goal)
    assert not any(np.array_equal(q, v) for q in found[1:-1] for v in between)
    made = planner.memory.candidate_certificates
    assert np.array_equal(made.end[len(found) - 2], goal)
