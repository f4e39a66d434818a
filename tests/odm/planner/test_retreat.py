"""An evasion keeps most distance of those to the near nodes: as a slow search says."""

import numpy as np
import pytest
from forms import size
from naive_cells import centers
from scipy.spatial.distance import cdist
from shapes_drawn import draw_shapes, solids_of
from small import ball_at, draw_arm, draw_valid
from wrappers import with_wrapper

import odm
from odm.obstacles._solids import solid_distance
from odm.obstacles.obstacles import together
from odm.planner.retreat import Retreat
from odm.planner.settings import RetreatSettings
from roadmap.kinematics.forward import difference, tool_pose
from roadmap.transforms import pose_of

solid_distance = with_wrapper(solid_distance)

TIMES = (0.12, 0.24, 0.36, 0.48)
_S = RetreatSettings()
REACTION, WORTH = _S.reaction_s, _S.min_evasion_gain
AMPLE, DIRECTIONS = _S.ample_margin, _S.directions


def slow_gap(planner, q, there, enough):
    """Return the least distance of the cover at q from shapes and points [m].

    One that is at most `enough` is told as soon as it is found, not the least.
    """
    solids, n_shapes, points = there
    arm = planner.memory.arm
    at, radii = centers(arm, planner.robot, q), arm.spheres[:, 3]
    best = np.inf
    if len(points):
        best = (cdist(at, points) - radii[:, None]).min()
    for place, radius in zip(at, radii, strict=True):
        for k in range(n_shapes):
            if best <= enough:
                return best
            best = min(best, solid_distance(solids, k, *place, np.inf) - radius)
    return best


def slow_evasion(planner, q, coming, scale):
    """Return the (2, dof) evasion from its definition, or None, and what it gains."""
    frame, robot = planner.frame, planner.robot
    times = [max(0.0, t - REACTION) for t, _ in coming]
    ample = planner.keep + AMPLE

    def duration(dq):
        return max(np.abs(dq / (scale * robot.max_velocity)).max(), 1e-9)

    def least(dq, enough=-np.inf):
        gap = ample
        for t, (_, there) in zip(times, coming, strict=True):
            at = q + min(1.0, t / duration(dq)) * dq
            gap = min(gap, slow_gap(planner, at, there, enough))
            if gap <= enough:
                break
        return gap

    stays = least(np.zeros_like(q))
    best, found = stays + WORTH, None
    if best >= ample:
        return None, stays
    escape = planner.separation(q) < planner.keep
    nodes = planner.cell_map.roadmap.nodes
    for node in planner.attacher.nearest(q, DIRECTIONS):
        dq = difference(robot, q, nodes[node])
        dq = min(1.0, max(times) / duration(dq)) * dq
        gap = least(dq, best)
        if gap <= best:
            continue
        frame.close_test.anchor(q)
        if not frame.motion_clear(q, np.ascontiguousarray(dq), escape=escape):
            continue
        if planner.static.motion_free(q, dq):
            best, found = gap, np.stack([q, q + dq])
            if best >= ample:
                break
    return found, stays


def draw_coming(rng, kind, hand):
    """Draw who is expected near a hand at each time: shapes, points (n, 3), or both."""
    shapes, points = [], np.zeros((0, 3))
    if kind != "points":
        shapes = draw_shapes(rng, 3, middle=hand, spread=0.25)
    if kind != "shapes":
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        points = points - points.mean(axis=0) + hand + rng.uniform(-0.2, 0.2, 3)
    return shapes, np.ascontiguousarray(points)


@pytest.mark.parametrize("kind", ["shapes", "points", "both"])
def test_an_evasion_is_the_best_of_those_to_the_near_nodes(planner, rng, kind):
    found = none = 0
    for _ in range(size(26, 40)):
        q = draw_valid(planner, rng)
        hand = centers(planner.memory.arm, planner.robot, q)[-1]
        now = draw_shapes(rng, 1, middle=hand, spread=0.4)
        planner.step(odm.Obstacles.of(now), q=q)
        there = [draw_coming(rng, kind, hand) for _ in TIMES]
        coming = [
            (t, odm.Obstacles.of(shapes, points))
            for t, (shapes, points) in zip(TIMES, there, strict=True)
        ]
        there = [(solids_of(s), len(s), points) for s, points in there]
        slow, stays = slow_evasion(
            planner, q, list(zip(TIMES, there, strict=True)), 0.5
        )
        quick = planner.evasion(q, coming, 0.5)
        assert (slow is None) == (quick is None), stays
        if slow is None:
            none += 1
        else:
            assert quick.tobytes() == slow.tobytes()
            found += 1
    assert found > 3 and none > 3


def test_who_stays_away_is_not_evaded(planner, rng):
    q = draw_valid(planner, rng)
    planner.step(np.zeros((0, 3)), q=q)
    far = odm.Obstacles(spheres=np.array([[0.0, 0.0, 9.0, 0.1]]))
    assert planner.evasion(q, [(0.3, far)], 0.5) is None
    assert planner.evasion(q, [], 0.5) is None


def test_shapes_of_several_moments_keep_their_places_and_faces(rng):
    groups = [draw_shapes(rng, n) for n in (4, 0, 3, 6)]
    given = [solids_of(shapes) for shapes in groups]
    both, ptr = together(given)
    assert ptr.tolist() == [0, 4, 4, 7, 13] and both.count[0] == 13
    for solids, first in zip(given, ptr[:-1].tolist(), strict=True):
        for k in range(solids.count.item()):
            for place in rng.uniform(-1.0, 1.0, (10, 3)):
                d = solid_distance(solids, k, *place, np.inf)
                assert solid_distance(both, first + k, *place, np.inf) == d


def test_the_settings_say_what_is_near_and_what_a_retreat_must_gain(planner, rng):
    """With others the robot stays where it would have backed off."""
    backed = 0
    others = RetreatSettings(near=0.0), RetreatSettings(min_gain=10.0)
    for _ in range(20):
        q = draw_valid(planner, rng)
        planner.step(odm.sample_capsules(draw_arm(rng), 0.03), q=q)
        backed += Retreat(planner.frame, planner.attacher).back_off(q) is not None
        for settings in others:
            stays = Retreat(planner.frame, planner.attacher, settings)
            assert stays.back_off(q) is None or planner.separation(q) < 0.0
        few = Retreat(planner.frame, planner.attacher, RetreatSettings(shares=(0.1,)))
        short = few.back_off(q)
        ends = planner.cell_map.roadmap.nodes
        if short is not None:
            way = difference(planner.robot, short[0], short[1])
            there = [difference(planner.robot, q, node) for node in ends]
            assert np.abs(np.array(there) - 10.0 * way).max(axis=1).min() < 1e-9
    assert backed


def test_no_way_out_leads_through_what_stands_still(planner, rng):
    told = 0
    planner.scene.add("wall", odm.Box((0.1, 0.6, 0.3)), pose_of([0.0, 0.0, 0.95]))
    for _ in range(30):
        q = draw_valid(planner, rng)
        ball = ball_at(tool_pose(planner.robot, q)[:3, 3] + rng.normal(0.0, 0.08, 3))
        planner.step(ball, q=q)
        coming = [(0.5, ball), (1.0, ball)]
        for way in (planner._retreat.back_off(q), planner.evasion(q, coming, 1.0)):
            if way is not None:
                told += 1
                assert planner.static.motion_free(way[0], way[1] - way[0])
    assert told > 20
