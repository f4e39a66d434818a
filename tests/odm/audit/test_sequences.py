"""A planner that lives long answers what one that was just made would allow."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule
from scipy.spatial import cKDTree
from small import AWAY, HOME, small_recipe

from odm.answer import HOLDING, IN_USE, ROADMAP, SEARCH, STRAIGHT
from odm.audit.sequence_audit import SequenceReport, audit_sequences, run_sequence
from odm.audit.sequence_judge import Judge, World, solid_of
from odm.audit.sequences import EVENTS, KINDS, Sequence, _drawn_inside
from odm.cell_map.build import build_map
from odm.cell_map.recipe import PayloadRecipe
from odm.obstacles.surfaces import sample_capsules
from odm.planner.planner import ReactivePlanner
from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose

ORDINARY = sorted(set(EVENTS) - {"grow"})


@pytest.fixture(scope="module")
def judge(carrying_map):
    return Judge(carrying_map)


def machine_on(cell_map, judge):
    """Return a machine whose rules are what may happen between two frames."""

    class Life(RuleBasedStateMachine):
        @initialize(seed=st.integers(0, 10_000))
        def begin(self, seed):
            self.life = Sequence(cell_map, seed, judge)

        @rule(names=st.lists(st.sampled_from(ORDINARY), max_size=3))
        def some_frames_after(self, names):
            for name in names:
                getattr(self.life, name)()
            self.judged()

        @rule(n=st.integers(1, 12))
        def it_follows(self, n):
            for _ in range(n):
                self.life.follow()
                self.judged()

        @rule(n=st.integers(1, 30))
        def it_is_pushed_on(self, n):
            self.life.push()
            for _ in range(n):
                self.judged()

        def judged(self):
            verdict = self.life.frame().verdict
            assert verdict is None or not verdict.wrong, verdict.wrong

    return Life


def test_no_order_of_events_makes_it_answer_what_is_not_free(carrying_map, judge):
    few = settings(
        max_examples=12,
        stateful_step_count=25,
        deadline=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
        database=None,
    )
    case = machine_on(carrying_map, judge).TestCase
    case.settings = few
    case().runTest()


@pytest.fixture(scope="module")
def report(carrying_map, judge):
    """What twelve sequences found together."""
    found = SequenceReport()
    for seed in range(10, 22):
        found.add(run_sequence(carrying_map, judge, seed, 150))
    return found


def test_every_event_happens_and_most_frames_are_answered(report):
    assert not report.first_faults
    assert report.answered >= 0.5 * report.steps == 900
    assert report.near  # some come near to what they must keep
    assert report.smallest > 0.0


def test_every_kind_of_answer_is_attacked_and_measured(report):
    assert set(report.kinds) == set(KINDS)
    for name, (answers, measured) in report.kinds.items():
        assert 0 < measured <= answers <= report.answered, name
    found_by = STRAIGHT, ROADMAP, SEARCH, IN_USE
    assert sum(report.kinds[name][0] for name in found_by) == report.answered
    assert report.ways_out > 10


def test_a_way_out_that_leads_into_something_is_told(small_map):
    judge, world = Judge(small_map), World(mode="shapes")
    world.capsules = np.array([[0.55, -0.3, 0.4, 0.55, 0.3, 0.4, 0.05]])
    planner = ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    ways = 0
    for node in small_map.roadmap.nodes[::3]:
        q = node.copy()
        answer = planner.step(world.given(), q=q)
        if answer.status != HOLDING or answer.retreat is None:
            continue
        ways += 1
        out = judge.judge_way_out(world, world.given(), q, answer.retreat)
        assert out.exact and not out.wrong
        back = 2.0 * q - answer.retreat[1]  # the opposite direction
        path = np.stack(
            [q, np.clip(back, small_map.robot.lower, small_map.robot.upper)]
        )
        assert judge.judge_way_out(world, world.given(), q, path).wrong
        elsewhere = judge.judge_way_out(world, world.given(), q + 0.1, answer.retreat)
        assert "begins at" in elsewhere.wrong[0]
    assert ways


def test_what_the_hand_holds_is_measured_as_solids(carrying_map):
    judge, world = Judge(carrying_map), World(mode="shapes")
    world.held = _drawn_inside(carrying_map.payload.recipe, np.random.default_rng(0))
    x, y, z, r = world.held[0]
    T = tool_pose(carrying_map.robot, HOME)
    middle = T[:3, :3] @ [x, y, z] + T[:3, 3]
    # just beside the ball in the hand, on the side away from the robot
    out = T[:3, :3] @ [0.0, 0.0, 1.0]
    near = middle + (r + 0.02) * out
    world.capsules = np.array([[*near, *near, 0.015]])
    judge.changed()
    with_it = judge.judge(world, world.given(), HOME, np.stack([HOME, HOME]), True)
    assert with_it.distance == pytest.approx(0.005, abs=1e-6)
    assert any("payload" in fault for fault in with_it.wrong)


def test_each_event_can_happen_at_any_time(carrying_map, judge):
    life = Sequence(carrying_map, 3, judge)
    rng = np.random.default_rng(3)
    for name in rng.permutation(ORDINARY * 3).tolist() + ["come", "grow"]:
        getattr(life, name)()
        verdict = life.frame().verdict
        assert verdict is None or not verdict.wrong, (name, verdict.wrong)


def test_what_is_carried_fits_a_box_shaped_envelope_that_is_thin(carrying_map):
    layer = carrying_map.payload
    thin = PayloadRecipe(size=(0.03, 0.15, 0.03), position=layer.recipe.position)
    thin_map = replace(carrying_map, payload=replace(layer, recipe=thin))
    judge = Judge(thin_map)
    for seed in range(8):
        life = Sequence(thin_map, seed, judge)
        life.hand()
        verdict = life.frame().verdict
        assert life.world.held is not None
        assert verdict is None or not verdict.wrong, verdict.wrong


def test_the_same_seed_gives_the_same_report(carrying_map, judge):
    one, two = (run_sequence(carrying_map, judge, 5, 80) for _ in range(2))
    assert one == two


def test_a_wrong_answer_is_told(carrying_map, judge):
    life = Sequence(carrying_map, 1, judge)
    q = life.q
    world, points = life.world, life.world.points()
    world.capsules = life.draw_arm(np.array([0.0, 0.0, 0.8]))
    points = world.points()
    to = life.draw_valid()
    shares = np.linspace(0.0, 1.0, 4)[:, None]
    path = q + shares * (to - q)
    verdicts = [
        judge.judge(world, points, q, np.array([q, at]), True)
        for at in life.cell_map.roadmap.nodes[::4]
    ]
    assert any(v.wrong for v in verdicts)
    assert not all(v.wrong for v in verdicts)
    elsewhere = judge.judge(world, points, q + 0.1, path, False)
    assert "begins at" in elsewhere.wrong[0]


def test_only_a_first_leg_from_beside_may_be_nearer_to_what_stands_still(small_map):
    """Decision 0102: such a leg is measured exactly, too."""
    judge, world = Judge(small_map), World()
    places = HOME + np.arange(0.0, 2.0, 1e-3)[:, None] * [0.0, 1.0, 1.0]
    free = judge.oracle.static.motions_free(places, np.zeros_like(places))
    q = places[free.argmin()]  # at the floor
    assert free[0] and not free.all()
    back, there = np.stack([q, HOME]), np.stack([HOME, HOME, q])
    first = judge.judge(world, world.given(), q, back, False, beside=True)
    assert first.exact and not first.wrong
    assert judge.judge(world, world.given(), q, back, False).wrong
    assert judge.judge(world, world.given(), HOME, there, False, beside=True).wrong


def test_obstacles_are_sampled_as_densely_as_the_map_asks():
    fine = build_map(small_recipe(rho=0.008), threads=1)
    life = Sequence(fine, 0, Judge(fine))
    life.world.capsules = rods = np.array([[0.5, 0.0, 0.4, 0.6, 0.1, 0.5, 0.04]])
    surface = cKDTree(sample_capsules(rods, 0.001))
    for mode in ("rho", "round", "dense", "both"):
        life.world.mode = mode
        apart = cKDTree(life.world.points()).query(surface.data)[0].max()
        assert 0.006 < apart <= 0.008
        verdict = life.frame().verdict  # none is refused
        assert verdict is None or not verdict.wrong


def test_a_half_space_is_a_box_whose_side_lies_in_its_plane():
    row = np.zeros(16)
    row[1:4], row[4] = [0.0, 0.6, 0.8], 0.3
    box = solid_of(row, np.zeros((0, 13)))
    middle = box.T_base_shape[:3, 3] + 10.0 * box.T_base_shape[:3, 2]
    assert np.isclose(middle @ row[1:4], 0.3)
    assert np.allclose(box.T_base_shape[:3, 2], row[1:4])


def test_the_audit_sums_up_and_its_own_audit_fails(carrying_map, tmp_path):
    carrying_map.save(tmp_path / "map")
    options = {"processes": 1, "steps": 120}
    report = audit_sequences(tmp_path / "map", **options)
    assert report.passed
    assert report.steps == 120
    assert json.loads(json.dumps(report.as_dict()))["passed"]
    found = audit_sequences(
        tmp_path / "map", steps=20_000, processes=1, sabotage="certificate"
    )
    assert found.wrong
    assert not found.passed
    with pytest.raises(BadInput, match="certificate"):
        audit_sequences(tmp_path / "map", sabotage="rho")


def test_an_audit_that_was_ended_by_hand_has_not_failed():
    ended = SequenceReport(seed=0, sabotage=None, complete=False)
    assert "was interrupted" in str(ended) and not ended.passed
    ended.wrong = 1
    assert "FAILED" in str(ended)
