"""`plan_handover` end to end: a plan that is one, and failures that say why."""

from dataclasses import replace

import numpy as np
import pytest

import handover
from handover.grasps.grasp_build import GraspSettings
from handover.grasps.hands import hand_spec
from handover.plans import grasps as grasp_sets
from handover.plans.limb import limb_of
from handover.plans.motions import home_of
from handover.plans.plan_record import record_of
from handover.plans.planner import plan_handover
from handover.plans.settings import PlanSettings
from handover.scenes.plan_file import object_at
from roadmap.errors import BadInput
from roadmap.transforms import pose_of

QUICK = PlanSettings(tuples=1, shorten=20)
FEW = GraspSettings(samples=6, rolls=3)


@pytest.fixture(scope="module")
def plan(scene, grasps):
    return plan_handover(scene, 600.0, grasps=grasps, settings=QUICK)


def test_a_plan_has_every_motion_in_order(plan):
    assert plan.found, plan.reason
    names = [motion.name for motion in plan.motions]
    order = ["reach", "pick", "lift", "carry", "offer", "approach", "take"]
    assert names == [*order, "release", "retreat", "place"]
    for one, after in zip(plan.motions[:-1], plan.motions[1:], strict=True):
        assert after.begin == pytest.approx(one.end)


def test_a_hand_of_ones_own_plans_as_the_known_one_that_it_is(scene, grasps, plan):
    """`hand = {...}`, as docs/plans.md has it, ended each plan: "there is no hand"."""
    known = scene.giver.agent.arms["left"]
    own = replace(known, hand=replace(known.spec, name="mine"))
    agent = replace(scene.giver.agent, arms=scene.giver.agent.arms | {"left": own})
    mine = replace(scene, giver=replace(scene.giver, agent=agent))
    sets = grasps | {"mine": replace(grasps["sdh_left"], hand="mine")}
    found = plan_handover(mine, 600.0, grasps=sets, settings=QUICK)
    assert found.found, found.reason
    assert found.grasp_giver == plan.grasp_giver
    assert [m.end for m in found.motions] == [m.end for m in plan.motions]


def test_hands_of_one_name_have_sets_of_their_own(tmp_path, monkeypatch):
    """A set that is stored for one URDF's hand is not taken for another's."""
    made_by = []

    def few(thing, hand, progress=None):
        made_by.append(hand)
        return handover.build_grasps(thing, hand, FEW)

    monkeypatch.setattr(grasp_sets, "build_grasps", few)
    jar, spec = handover.load_object("food_jar"), hand_spec("sdh_left")
    farther = pose_of((0.0, 0.0, 0.01), (0.0, 0.0, 0.0))
    one = replace(spec, name="mine")
    other = replace(one, T_link_palm=spec.T_link_palm @ farther)
    sets = [grasp_sets.grasps_for(jar, hand, tmp_path) for hand in (one, other)]
    assert len(list(tmp_path.iterdir())) == len(made_by) == 2
    assert not np.array_equal(sets[0].T_object_palm, sets[1].T_object_palm)
    again = grasp_sets.grasps_for(jar, replace(one), tmp_path)
    assert len(made_by) == 2
    assert np.array_equal(again.T_object_palm, sets[0].T_object_palm)
    clear = [
        grasp_sets.line_clear(hand, again, g, 0.05)
        for hand in (one, spec)
        for g in range(len(again))
    ]
    assert clear[: len(again)] == clear[len(again) :]


def test_motions_begin_where_the_last_one_ended_and_keep_limits(plan):
    at = {}
    for motion in plan.motions:
        q = motion.motion.at(0.0).q
        if motion.who in at:
            assert np.abs(q - at[motion.who]).max() < 1e-9
        at[motion.who] = motion.motion.q_end
        limb = limb_of(getattr(plan.scene, motion.who).agent, "left")
        states = motion.motion.sample(np.linspace(0.0, motion.motion.duration, 60))
        assert (np.abs(states.dq) <= limb.max_velocity * (1 + 1e-6)).all()
        assert (states.q >= limb.lower - 1e-9).all()
        assert (states.q <= limb.upper + 1e-9).all()


def test_the_record_brings_the_object_from_start_to_goal(plan):
    record = record_of(plan)
    scene, end = plan.scene, record["motions"][-1]["times"][-1]
    assert np.abs(object_at(record, scene, 0.0) - scene.T_world_start).max() < 1e-12
    assert np.abs(object_at(record, scene, end) - scene.T_world_goal).max() < 1e-6
    # it does not jump where it changes hands
    for hold in record["holds"][1:]:
        before = object_at(record, scene, hold["begin"] - 1e-6)
        after = object_at(record, scene, hold["begin"] + 1e-6)
        assert np.abs(after - before).max() < 1e-4


def test_the_same_scene_gives_the_same_bytes(plan, scene, grasps):
    again = plan_handover(scene, 600.0, grasps=grasps, settings=QUICK)
    assert record_of(again) == record_of(plan)


def test_motions_are_free_by_other_means(plan):
    """Poses between the proved ones, by exact distances of `odm.audit`."""
    from handover.scenes.start_check import start_distances

    record, scene = record_of(plan), plan.scene
    from handover.scenes.plan_file import WHO, joints_at

    for motion in plan.motions[:7]:
        t = 0.5 * (motion.begin + motion.end)
        placed = {who: replace(getattr(scene, who), joints=joints_at(record, who, t))
                  for who in WHO}  # fmt: skip
        now = replace(scene, **placed, T_world_start=object_at(record, scene, t))
        hands = ("hand", "palm", "finger", "thumb")
        for distance, one, other in start_distances(now):
            held = "food_jar" in (one, other) and any(h in one + other for h in hands)
            if not held:
                assert distance > 0.0, (motion.name, one, other)


# --- failures -------------------------------------------------------------------


def test_no_time_is_said(scene, grasps):
    plan = plan_handover(scene, 0.0, grasps=grasps)
    assert not plan and "time limit of 0 s" in plan.reason


@pytest.mark.parametrize("limit", [-1.0, np.nan, np.inf, "soon"])
def test_a_time_limit_that_is_none_is_refused(scene, grasps, limit):
    with pytest.raises(BadInput, match="time_limit_s"):
        plan_handover(scene, limit, grasps=grasps)


def test_an_object_out_of_reach_of_both_arms(scene, grasps):
    far = replace(scene, T_world_start=pose_of((3.0, 0.0, 0.8)))
    plan = plan_handover(far, 60.0, grasps=grasps)
    assert not plan
    assert "choice of an arm ended the plan" in plan.reason
    assert "bring the food_jar nearer" in plan.reason


def test_a_goal_out_of_the_receivers_reach(scene, grasps):
    far = replace(scene, T_world_goal=pose_of((3.0, 3.0, 0.8)))
    plan = plan_handover(far, 60.0, grasps=grasps)
    assert not plan and "goal ended the plan" in plan.reason


def test_a_goal_inside_the_receiver_is_told_before_any_grasp(scene, grasps):
    torso = scene.receiver.link_pose("torso")
    inside = replace(scene, T_world_goal=torso)
    plan = plan_handover(inside, 60.0, grasps=grasps)
    assert not plan and plan.report.poses[0] == 0
    assert "goal ended the plan: there the food_jar would touch" in plan.reason
    assert "drchubo's" in plan.reason and "move the goal" in plan.reason


def test_no_grasp_survives_at_the_start(scene, grasps):
    from odm.obstacles.shapes import Box

    at = pose_of(scene.T_world_start[:3, 3] + (0.0, 0.0, 0.06))
    cage = handover.Fixture("cage", Box((0.14, 0.14, 0.14), at))
    shut = replace(scene, scenery=(*scene.scenery, cage))
    plan = plan_handover(shut, 60.0, grasps=grasps)
    assert not plan and "pruning at the start ended the plan" in plan.reason
    assert "none is left" in plan.reason


def test_a_mesh_that_counts_as_its_hull_is_named(scene, grasps):
    import trimesh

    from odm.obstacles.shapes import Mesh

    at = scene.T_world_start.copy()
    at[2, 3] += 0.06
    sides = [trimesh.creation.box((0.02, 0.3, 0.3)) for _ in range(2)]
    for side, x in zip(sides, (-0.3, 0.3), strict=True):
        side.apply_translation((x, 0.0, 0.0))
    bin_mesh = trimesh.util.concatenate(sides)
    shelf = handover.Fixture("shelf", Mesh(bin_mesh.vertices, bin_mesh.faces, at))
    plan = plan_handover(
        replace(scene, scenery=(*scene.scenery, shelf)), 60.0, grasps=grasps
    )
    assert not plan and "shelf counts as its hull: give it as convex" in plan.reason
    far = replace(scene, T_world_start=pose_of((3.0, 0.0, 0.8)))
    assert "hull" not in plan_handover(far, 60.0, grasps=grasps).reason


def test_a_start_in_collision(scene, grasps):
    from odm.obstacles.shapes import Box

    giver = limb_of(scene.giver.agent, "left")
    at = scene.giver.link_pose("left_palm")
    block = handover.Fixture("block", Box((0.1, 0.1, 0.1), at))
    shut = replace(scene, scenery=(*scene.scenery, block))
    plan = plan_handover(shut, 60.0, grasps=grasps)
    assert home_of(scene.giver, giver).shape == (giver.dof,)
    assert not plan and "start ended the plan" in plan.reason
    assert "would touch block" in plan.reason
