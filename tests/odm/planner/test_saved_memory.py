"""Memory is saved, loaded and compared; a planner that loads it answers alike."""

import numpy as np
import pytest
from carrying import BALLS, SHIFT
from forms import some
from small import AWAY, HOME, NOBODY, ball_at, draw_valid, small_recipe

import odm
from odm._groups import GOAL
from odm.planner.saved_memory import NOT_SAVED, _digest, differences
from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose

FRAMES = 90


@pytest.fixture(scope="module")
def arm3():
    return odm.build_map(small_recipe(), threads=1)


class Life:
    """A robot that follows its planner beside balls that come and go."""

    def __init__(self, planner, seed):
        self.planner, self.rng = planner, np.random.default_rng(seed)
        self.q, self.ball, self.answer = HOME.copy(), NOBODY, None

    def frame(self, k):
        """Live one frame; return all that was said in it, as bytes."""
        planner, rng = self.planner, self.rng
        said = []
        if k % 30 == 0:
            goals = [draw_valid(planner, rng) for _ in range(2)]
            planner.set_goals([*goals, AWAY], [0.3, 0.1, 0.2] if k % 60 else None)
        if k % 12 == 0:
            path = [self.q] if self.answer is None else [*self.answer.path, self.q]
            at = tool_pose(planner.robot, np.array(path[rng.integers(len(path))]))
            self.ball = ball_at(at[:3, 3] + rng.normal(0.0, 0.1, 3), 0.05)
        points = NOBODY if k % 12 > 8 else self.ball + 0.02 * np.sin(k)
        stamp = 0.01 * k
        self.answer = planner.step(points, q=self.q, stamp=stamp, now=stamp)
        said += [self.answer.status, self.answer.goal, self.answer.frame]
        said += [self.answer.work, self.answer.path.tobytes()]
        if k % 5 == 0:
            said += [self.answer.reason, str(self.answer.retreat)]
            said += [planner.separation(self.q), planner.invalid_edges().tobytes()]
            said += [planner.is_free(self.q, AWAY).reason]
        said.append(planner.improve(6))
        if k == 50:
            planner.prepare_goal(draw_valid(planner, rng))
        if len(self.answer.path) > 1 and k % 7:
            leg = self.answer.path[1] - self.q
            self.q = self.q + leg * min(1.0, 0.05 / max(np.abs(leg).max(), 1e-9))
        return said

    def goes_on_with(self, planner):
        """Return the same life, with another planner."""
        other = Life(planner, 0)
        other.rng.bit_generator.state = self.rng.bit_generator.state
        other.q, other.ball, other.answer = self.q.copy(), self.ball, self.answer
        return other


SETTINGS = [
    odm.PlannerSettings(),
    odm.PlannerSettings(history_s=0.0),
    odm.PlannerSettings(cached_goals=3, persistence_frames=4),
]


@pytest.mark.parametrize("settings", SETTINGS, ids=["default", "no history", "kept"])
@pytest.mark.parametrize("at", some([1, 17, 31, 47], 1, 3))
def test_a_fresh_planner_with_the_memory_answers_byte_for_byte(
    arm3, tmp_path, settings, at
):
    life = Life(odm.ReactivePlanner(arm3, settings=settings), seed=at)
    for k in range(at):
        life.frame(k)
    np.savez(tmp_path / "memory.npz", **life.planner.save_memory())
    fresh = odm.ReactivePlanner(arm3, settings=settings)
    with np.load(tmp_path / "memory.npz") as saved:
        fresh.load_memory(saved)
    assert not differences(fresh.save_memory(), life.planner.save_memory())
    other = life.goes_on_with(fresh)
    statuses = set()
    for k in range(at, at + FRAMES):
        assert life.frame(k) == other.frame(k), k
        statuses.add(life.answer.status)
        if k % 10 == 0:
            mine, its = life.planner.save_memory(), fresh.save_memory()
            assert not differences(mine, its), k
    assert {"following", "replanned"} <= statuses


def test_a_planner_that_lived_goes_back_to_what_it_remembered(arm3):
    life = Life(odm.ReactivePlanner(arm3), seed=5)
    for k in range(20):
        life.frame(k)
    saved = life.planner.save_memory()
    again = life.goes_on_with(life.planner)
    first = [life.frame(k) for k in range(20, 60)]
    life.planner.load_memory(saved)
    assert not differences(life.planner.save_memory(), saved)
    again.planner = life.planner
    assert [again.frame(k) for k in range(20, 60)] == first


def test_a_frame_of_more_points_than_there_is_room_for_is_loaded_as_it_was(arm3):
    little = odm.PlannerSettings(point_capacity=1)
    one, other = (odm.ReactivePlanner(arm3, settings=little) for _ in range(2))
    one.set_goals([AWAY])
    for _ in range(2):
        one.step(ball_at([0.5, 0.2, 0.4], 0.05), q=HOME)
    saved = one.save_memory()
    other.load_memory(saved)
    assert not differences(other.save_memory(), saved)


def test_an_object_of_the_same_spheres_and_another_hull_is_another_hand(carrying_map):
    one, other = (odm.ReactivePlanner(carrying_map) for _ in range(2))
    one.attach(odm.Box([0.02, 0.02, 0.04]), SHIFT)
    one.set_goals([AWAY])
    one.step(NOBODY, q=HOME)
    other.attach(one.attached)  # its self-collision is tested with a larger hull
    with pytest.raises(BadInput, match="another hand"):
        other.load_memory(one.save_memory())


def test_with_something_in_the_hand_too(carrying_map):
    planners = [odm.ReactivePlanner(carrying_map) for _ in range(2)]
    for planner in planners:
        planner.set_extra_clearance(0.01)
        planner.attach(BALLS)
    one, other = planners
    one.set_goals([AWAY])
    for _ in range(5):
        one.step(NOBODY, q=HOME)
    other.load_memory(one.save_memory())
    ball = ball_at(tool_pose(one.robot, 0.5 * (HOME + AWAY))[:3, 3], 0.05)
    saved = one.save_memory()
    one.detach()
    with pytest.raises(BadInput, match="another hand"):
        one.load_memory(saved)
    one.attach(BALLS)
    one.load_memory(saved)
    for points in (ball, NOBODY, ball):
        a, b = one.step(points, q=HOME), other.step(points, q=HOME)
        assert (a.status, a.reason) == (b.status, b.reason)
        assert a.path.tobytes() == b.path.tobytes()
        assert one.improve(4) == other.improve(4)


def test_a_frame_that_could_not_be_used_still_answers_no(arm3):
    planner, other = odm.ReactivePlanner(arm3), odm.ReactivePlanner(arm3)
    planner.set_goals([AWAY])
    planner.step(NOBODY, q=HOME, stamp=1.0, now=1.0)
    assert planner.step(np.full((1, 3), np.nan), q=HOME).status == "holding"
    other.load_memory(planner.save_memory())
    assert other.trouble == planner.trouble and other.separation(HOME) == -np.inf
    assert not other.is_free(HOME, HOME)
    late = other.step(NOBODY, q=HOME, stamp=0.5, now=1.0)
    assert late.status == "holding" and "ms" in late.reason


@pytest.mark.parametrize("meshes", [False, True])
@pytest.mark.parametrize("change", ["base", "clearance"])
def test_shapes_of_a_loaded_frame_are_not_known_elsewhere(arm3, change, meshes):
    """Far shapes have no samples, and those of a mesh cannot be made any more."""
    planner, other = odm.ReactivePlanner(arm3), odm.ReactivePlanner(arm3)
    far = np.eye(4)
    far[0, 3] = 5.0
    shape = odm.Box([0.2, 0.2, 0.2], far)
    if meshes:
        shape = odm.Mesh.hull_of(odm.surface_of(shape).points, np.eye(4))
    obstacles = odm.Obstacles.of([shape], points=np.array([[0.4, 0.0, 0.5]]))
    planner.step(obstacles, q=HOME)
    other.load_memory(planner.save_memory())
    assert other.is_free(HOME, HOME) and other.separation(HOME) > 0.0
    near = np.eye(4)
    near[0, 3] = 4.5
    for one in (planner, other):
        if change == "base":
            one.set_base(near)
        else:
            one.set_extra_clearance(0.05)
    assert planner.trouble is None
    freedom = other.is_free(HOME, HOME)
    assert not freedom and "loaded" in freedom.reason and not other.stands_clear(HOME)
    assert other.separation(HOME) == -np.inf
    assert len(other.invalid_edges()) == other.direct.n_edges and not other.improve()
    for one in (planner, other):
        one.step(obstacles, q=HOME)
    assert other.trouble is None and other.separation(HOME) == planner.separation(HOME)
    assert np.array_equal(other.invalid_edges(), planner.invalid_edges())


def test_points_of_a_loaded_frame_are_known_at_any_base(arm3):
    planner, other = odm.ReactivePlanner(arm3), odm.ReactivePlanner(arm3)
    planner.step(ball_at((0.4, 0.0, 0.5)), q=HOME)
    other.load_memory(planner.save_memory())
    T = np.eye(4)
    T[:3, 3] = 0.1
    for one in (planner, other):
        one.set_base(T)
        one.set_extra_clearance(0.02)
    assert other.separation(HOME) == planner.separation(HOME) > -np.inf
    assert np.array_equal(other.invalid_edges(), planner.invalid_edges())


def test_a_memory_that_does_not_belong_here_is_refused_and_nothing_changes(
    arm3, carrying_map
):
    planner = odm.ReactivePlanner(arm3)
    planner.set_goals([AWAY])
    planner.step(ball_at((0.3, 0.0, 0.35)), q=HOME)
    edges = planner.invalid_edges()
    saved = planner.save_memory()
    placed = odm.ReactivePlanner(arm3)
    placed.set_static(ball_at((0.0, 0.9, 1.2), 0.05))
    moved = odm.ReactivePlanner(arm3)
    T = np.eye(4)
    T[0, 3] = 0.1
    moved.set_base(T)
    farther = odm.ReactivePlanner(arm3)
    farther.set_extra_clearance(0.02)
    others = {
        "map": odm.ReactivePlanner(carrying_map),
        "settings": odm.ReactivePlanner(
            arm3, settings=odm.PlannerSettings(history_clearance=0.0)
        ),
        "place": placed,
        "base": moved,
        "clearance": farther,
    }
    for name, other in others.items():
        with pytest.raises(BadInput, match=f"another {name};"):
            other.load_memory(saved)
        with pytest.raises(BadInput, match=f"another {name};"):
            planner.load_memory(other.save_memory())
    for name in ("state.pool.begin", "path.followed", "digest"):
        broken = {key: array for key, array in saved.items() if key != name}
        with pytest.raises(BadInput, match="damaged"):
            planner.load_memory(broken)
    looked = saved["improving.look"]
    of_other_shape = {"improving.look": looked[None], "state.looks.at": looked}
    for name, array in {"attachments.next": np.array(5), **of_other_shape}.items():
        with pytest.raises(BadInput, match="damaged"):
            planner.load_memory(saved | {name: array})
    assert not differences(planner.save_memory(), saved)
    assert np.array_equal(planner.invalid_edges(), edges)


def test_two_memories_are_compared_by_name(arm3):
    planner = odm.ReactivePlanner(arm3)
    planner.set_goals([AWAY])
    before = planner.save_memory()
    assert not differences(before, planner.save_memory())
    planner.set_goals([HOME])
    changed = differences(before, planner.save_memory())
    assert "attachments.goals" in changed and "state.way.q" not in changed


def test_every_array_that_is_declared_to_be_remembered_is_saved(arm3):
    planner = odm.ReactivePlanner(arm3)
    saved = {name.removeprefix("state.") for name in planner.save_memory()}
    remembered = set(planner.memory.arrays(GOAL))
    left_out = {name.partition(".")[0] for name in remembered - saved}
    assert left_out == set(NOT_SAVED)


def test_frames_are_counted_one_by_one(arm3):
    planner = odm.ReactivePlanner(arm3)
    planner.set_goals([AWAY])
    assert planner.frame_number == 0
    for k in range(1, 20):
        points = ball_at((0.4, 0.1, 0.4)) if k % 3 else np.full((1, 3), np.nan)
        assert planner.step(points, q=HOME).frame == k == planner.frame_number
        planner.improve(4)
        planner.set_extra_clearance(0.01 * (k % 2))  # marks the points once more


@pytest.mark.parametrize("saved", [None, 3, [np.zeros(3)]])
def test_what_is_no_memory_is_refused(planner, saved):
    with pytest.raises(BadInput, match="give what save_memory returned"):
        planner.load_memory(saved)


def test_a_memory_of_another_version_is_refused(arm3):
    """One whose numbers lie in another order: the first ones told no version."""
    planner = odm.ReactivePlanner(arm3)
    before = planner.save_memory()
    saved = {k: v for k, v in before.items() if k not in ("digest", "setting.version")}
    saved["digest"] = np.array(_digest(saved))
    with pytest.raises(BadInput, match="saved with another version"):
        planner.load_memory(saved)
    assert differences(before, planner.save_memory()) == []
