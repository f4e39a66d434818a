"""Proved paths of an arm: bounds, searches from several places, straight lines."""

from dataclasses import replace

import numpy as np
import pytest
from wrappers import with_wrapper

import handover
from handover.grasps.grasp_build import GraspSettings
from handover.plans import _space
from handover.plans.choose import Pair
from handover.plans.limb import limb_of
from handover.plans.motions import MotionPlanner, home_of
from handover.plans.mover import Mover
from handover.plans.paths import Blocked, OutOfTime, Paths
from handover.plans.planner import plan_handover
from handover.plans.settings import PlanSettings, ProofSettings
from odm.obstacles.shapes import Sphere
from roadmap.transforms import pose_of
from sim.bench.handover.whole_choice import prune_grasps

MARGIN = ProofSettings().margin

place = with_wrapper(_space.place)
pair_apart = with_wrapper(_space.pair_apart)
parts_apart = with_wrapper(_space.parts_apart)
move_of = with_wrapper(_space.move_of)
motion_clear = with_wrapper(_space.motion_clear)

FEW = GraspSettings(samples=5, rolls=2)


class _Endless:
    over = False


class _Over:
    over = True


@pytest.fixture(scope="module")
def scene():
    scene = handover.load_scene("kneeling", 0)
    giver = replace(scene.giver, arms=("left",))
    return replace(scene, giver=giver, receiver=replace(scene.receiver, arms=("left",)))


@pytest.fixture(scope="module")
def movers(scene):
    giver, receiver = (
        limb_of(getattr(scene, who).agent, "left") for who in ("giver", "receiver")
    )
    return (
        Mover(scene, scene.giver, giver, scene.receiver, receiver),
        Mover(scene, scene.receiver, receiver, scene.giver, giver),
    )


@pytest.fixture(scope="module")
def grasps(scene):
    hands = ("sdh_left", "hubo_left")
    return {hand: handover.build_grasps(scene.obj, hand, FEW) for hand in hands}


def draws(mover, n, rng):
    """Return joints (n, dof), the hand open."""
    limb = mover.limb
    q = rng.uniform(limb.lower, limb.upper, (n, limb.dof))
    q[:, limb.n_arm :] = np.clip(0.0, limb.lower, limb.upper)[limb.n_arm :]
    return q


def points_at(mover, group, q):
    """Return the corners of a group's parts at joints q, world frame."""
    space, scratch = mover.space, mover.scratch
    place(space, np.ascontiguousarray(q), scratch)
    found = []
    for i in range(*space.group_span[group]):
        f = scratch.frames[space.part_body[i]]
        points = space.points[slice(*space.part_span[i])]
        found.append(points @ f[:9].reshape(3, 3).T + f[9:])
    return np.concatenate(found)


# --- proofs ---------------------------------------------------------------------


@pytest.mark.parametrize("who", [0, 1])
def test_no_point_moves_farther_than_its_bound(movers, scene, who):
    mover, rng = movers[who], np.random.default_rng(who)
    mover.put_object(scene.T_world_start)
    space, tight = mover.space, 0
    still = space.pairs[:, 1] > space.thing
    rows = np.flatnonzero(still & (space.pairs[:, 0] < space.thing))
    for q, to in zip(draws(mover, 12, rng), draws(mover, 12, rng), strict=True):
        dq, half = to - q, float(rng.uniform(0.01, 0.1))
        for group in (2, mover.hand_group):
            p = int(rows[space.pairs[rows, 0] == group][0])
            place(space, q, mover.scratch)
            bound = move_of(space, p, dq, half, mover.scratch)
            whole = half * space.reach[p] @ np.abs(dq)
            tight += bound < 0.9 * whole
            here = points_at(mover, group, q)
            for t in np.linspace(-half, half, 9):
                there = points_at(mover, group, q + t * dq)
                moved = np.linalg.norm(there - here, axis=1).max()
                assert moved <= bound + 1e-9 <= whole + 2e-9
    assert tight > 2  # it is worth its price


def test_what_is_proved_is_free_everywhere_and_of_what_came_before(movers, scene):
    mover, rng = movers[0], np.random.default_rng(3)
    mover.put_object(scene.T_world_start)
    n, proved, refused = len(mover.space.pairs), 0, 0
    q = [x for x in draws(mover, 60, rng) if mover.why(x)[1] is None]
    for a, b in zip(q[:-1], q[1:], strict=True):
        args = mover.space, a, b - a, mover.proof.tolerance, mover.scratch
        mover.scratch.stale[0] = True
        fresh = motion_clear(*args)
        assert motion_clear(*args) == fresh  # the axes of last time
        if fresh[0] >= 0:
            refused += 1
            continue
        proved += 1
        for t in np.linspace(0.0, 1.0, 40):
            mover.scratch.stale[0] = True
            at = a + t * (b - a)
            assert _space.stands_clear(mover.space, at, 0, n, mover.scratch) < 0
    assert proved > 3
    assert refused > 3


def all_apart(space, scratch, p, need):
    """Return whether each part of one group is `need` from each of the other."""
    for i in range(*space.group_span[space.pairs[p, 0]]):
        for j in range(*space.group_span[space.pairs[p, 1]]):
            row = space.axis_row[p]
            scratch.axes[row] = 0.0
            low, _ = parts_apart(space, i, j, need, scratch, row)
            scratch.axes[row] = 0.0
            if low < need - 1e-9:
                return False
    return True


def test_a_pair_is_as_far_apart_as_all_its_parts(movers, scene):
    mover, rng = movers[0], np.random.default_rng(4)
    mover.put_object(scene.T_world_start)
    space, scratch, near, proved = mover.space, mover.scratch, 0, 0
    for q in draws(mover, 12, rng):
        place(space, q, scratch)
        for p in np.flatnonzero(space.margin >= 0.0).tolist():
            free, _ = pair_apart(space, p, MARGIN, scratch)
            assert (free >= MARGIN) == all_apart(space, scratch, p, MARGIN)
            near += free < MARGIN
            for need in (0.03, 0.3):
                if pair_apart(space, p, need, scratch)[0] >= need:
                    assert all_apart(space, scratch, p, need)
                    proved += 1
    assert near > 3
    assert proved > 500


# --- searches ---------------------------------------------------------------------


def paths_of(scene, mover, clock=_Endless):
    return Paths(mover, home_of(scene.giver, mover.limb), PlanSettings(), clock())


def test_a_search_joins_the_nearest_of_several_ends(movers, scene):
    mover = movers[0]
    mover.put_object(scene.T_world_start)
    paths = paths_of(scene, mover)
    home = paths.home
    near, far = home.copy(), home.copy()
    near[0], far[0] = home[0] + 0.05, home[0] + 0.2
    blocked = home.copy()
    blocked[1] = mover.limb.upper[1] + 1.0
    path, first, last = paths.between(
        home[None], np.array([blocked, far, near]), "a try", 100
    )
    assert (first, last) == (0, 2)
    assert np.array_equal(path, [home, near])
    with pytest.raises(Blocked, match="an end of it is blocked"):
        paths.between(home[None], blocked[None], "a try", 100)


def test_roots_of_both_trees_are_told(movers, scene):
    mover, rng = movers[0], np.random.default_rng(6)
    mover.put_object(scene.T_world_start)
    paths = paths_of(scene, mover)
    free = np.array([x for x in draws(mover, 60, rng) if mover.why(x)[1] is None])
    winding = 0
    for goal in free[:8]:
        behind = [x for x in free if mover.path_blocked(np.array([x, goal]))[1]]
        if len(behind) < 2:
            continue
        starts = np.array(behind[:2])
        path, i, j = paths.between(starts, goal[None], "a try", 3000)
        assert len(path) > 2
        assert j == 0
        assert np.array_equal(path[0], starts[i])
        assert np.array_equal(path[-1], goal)
        assert mover.path_blocked(path)[1] is None
        winding += 1
    assert winding > 1


def test_a_small_budget_is_told_from_no_way(movers, scene):
    mover, rng = movers[0], np.random.default_rng(6)
    mover.put_object(scene.T_world_start)
    paths = paths_of(scene, mover)
    free = [x for x in draws(mover, 60, rng) if mover.why(x)[1] is None]
    pairs = zip(free[:-1], free[1:], strict=True)
    ends = next(
        ends for ends in pairs if mover.path_blocked(np.array(ends))[1] is not None
    )
    with pytest.raises(Blocked, match="no path within 1 motions") as told:
        paths.between(ends[0][None], ends[1][None], "a try", 1)
    assert told.value.searched
    late = paths_of(scene, mover, _Over)
    with pytest.raises(OutOfTime, match="a try"):
        late.between(ends[0][None], ends[1][None], "a try", 1)


def test_a_lift_goes_straight_up(movers, scene, grasps):
    giver = movers[0]
    plan = plan_handover(scene, 600.0, grasps=grasps)
    assert plan.found, plan.reason
    q = (
        next(m for m in plan.motions if m.name == "lift")
        .motion.sample(np.linspace(0.0, 1.0, 3))
        .q[0]
    )
    giver.put_other(home_of(scene.receiver, movers[1].limb))
    giver.hold(np.linalg.inv(grasps["sdh_left"].T_object_palm[plan.grasp_giver]))
    line = paths_of(scene, giver).lift(q)
    begin, palms = giver.palm(q), [giver.palm(x) for x in line]
    assert len(line) > 2
    for T in palms:
        assert np.abs(T[:3, :3] - begin[:3, :3]).max() < 1e-6
        assert np.abs(T[:2, 3] - begin[:2, 3]).max() < 1e-6
    heights = [T[2, 3] - begin[2, 3] for T in palms]
    assert np.allclose(np.diff(heights), 0.01, atol=1e-6)


def test_a_hand_leaves_to_the_side_where_it_cannot_go_back(movers, scene, grasps):
    giver, some = movers[0], grasps["sdh_left"]
    T, n = scene.T_world_start, giver.limb.n_arm
    giver.put_other(home_of(scene.receiver, movers[1].limb))
    giver.put_object(T)
    giver.let_touch()
    found = prune_grasps(giver, some, T)
    args = found.q[0].copy(), "a try", (some, int(found.grasp[0]))
    args[0][n:] = some.preshape[found.grasp[0]]
    giver.put_object(T)
    _, line = paths_of(scene, giver).line_to(*args)
    # a ball where the arm is on its way back, and is not while it grasps
    groups = range(giver.hand_group + 1)
    here = np.concatenate([points_at(giver, g, args[0]) for g in groups])
    there = np.concatenate([points_at(giver, g, line[-4]) for g in groups])
    away = np.linalg.norm(there[:, None] - here, axis=2).min(axis=1)
    ball = Sphere(0.005, pose_of(there[int(away.argmax())]))
    shut = replace(scene, scenery=(*scene.scenery, handover.Fixture("ball", ball)))
    mover = Mover(shut, shut.giver, giver.limb, shut.receiver, movers[1].limb)
    mover.put_other(home_of(scene.receiver, movers[1].limb))
    mover.put_object(T)
    paths = paths_of(shut, mover)
    with pytest.raises(Blocked, match="would touch ball"):
        paths.line_to(*args)
    mover.put_object(T)
    pre, line = paths.line_to(*args, slanted=True)
    assert np.array_equal(line[0], pre) and np.array_equal(line[-1], args[0])
    begin = mover.palm(args[0])
    ways = np.array([mover.palm(x)[:3, 3] for x in line]) - begin[:3, 3]
    far = np.linalg.norm(ways[0])
    assert 0.02 < far < PlanSettings().back + 1e-6
    assert np.linalg.norm(np.cross(ways, ways[0] / far), axis=1).max() < 1e-4
    assert -begin[:3, 2] @ ways[0] / far < 0.9  # not straight back
    mover.put_object(T)
    mover.let_touch()
    assert mover.path_blocked(line)[1] is None


# --- what is done once, and what is put off -----------------------------------------


def test_a_path_is_searched_once_and_again_only_with_more_budget(scene, movers, grasps):
    pair = Pair(*movers, grasps["sdh_left"], grasps["hubo_left"])
    planner = MotionPlanner(scene, pair, PlanSettings(), _Endless())
    asked = []

    def fails():
        asked.append("fails")
        raise Blocked("no", searched=True)

    def works():
        asked.append("works")
        return np.zeros((2, 3))

    for budget, work, known in ((10, fails, 1), (10, fails, 1), (20, works, 2)):
        try:
            planner._searched(("a",), budget, work)
        except Blocked:
            assert work is fails
        assert len(asked) == known
    assert planner._searched(("a",), 5, fails) is not None
    assert asked == ["fails", "works"]


def test_other_tuples_are_looked_for_when_they_are_asked_for(scene, grasps):
    plan = plan_handover(scene, 600.0, grasps=grasps, settings=PlanSettings(tuples=3))
    looked = plan.report.poses[0]
    others = plan.alternatives
    assert len(others) == 2
    assert plan.report.poses[0] > looked
    assert plan.alternatives is others
    assert all(other.dexterity <= plan.chosen.dexterity for other in others)


def test_the_time_limit_names_the_step_that_it_ended(scene, grasps):
    plan = plan_handover(scene, 1e-9, grasps=grasps)
    assert not plan
    assert "ended the plan in the choice of grasps and pose" in plan.reason
    assert "give more time" in plan.reason
