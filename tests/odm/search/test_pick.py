"""The close test of a motion with only the points that lie in the motion's cells."""

import numpy as np
from small import draw_arm, draw_valid

import odm
from odm.search import _judge as judge
from odm.search._state import EDGE_BASE
from roadmap.kinematics.forward import difference, sphere_centers


def clear_of(planner, q, dq, points):
    """Test the motion densely, without cells and without bounds: the naive twin."""
    radii = planner.radii
    spheres = np.flatnonzero(planner.robot.moving)
    order = spheres[np.argsort(planner.robot.sphere_body[spheres], kind="stable")]
    for t in np.linspace(0.0, 1.0, 200):
        centers = sphere_centers(planner.robot, q + t * dq)[order]
        gaps = np.linalg.norm(points[:, None] - centers[None], axis=2) - radii
        if gaps.min() < 0.0:
            return False
    return True


def test_what_an_edges_points_call_free_is_free_of_all_points(small_map, planner, rng):
    roadmap, said = small_map.roadmap, []
    for _ in range(150):
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        planner.step(points, q=np.zeros(small_map.robot.dof))
        edge = int(rng.integers(roadmap.n_edges))
        a, b = roadmap.nodes[roadmap.edges[edge]]
        dq = difference(small_map.robot, a, b)
        share = rng.uniform(0.0, 0.8)
        begin, rest = a + share * dq, (1.0 - share) * dq
        table = planner.memory.table
        free = judge.part_free(table, points, EDGE_BASE - edge, begin, rest)
        assert not free or clear_of(planner, begin, rest, points)
        whole = judge.close_free(table, points, begin, rest)
        assert free or not whole  # fewer points are in the way of nothing more
        said.append((free, planner.memory.picked.counts[1] > 0))
    said = np.array(said)
    assert (said[:, 0] & said[:, 1]).sum() > 5  # free though cells were hit
    assert (~said[:, 0]).sum() > 5


def test_the_straight_motions_points_are_those_in_its_cells(small_map, planner, rng):
    seen = 0
    for _ in range(60):
        q, goal = draw_valid(planner, rng), draw_valid(planner, rng)
        planner.reset()
        planner.set_goals([goal])
        points = odm.sample_capsules(draw_arm(rng), 0.03)
        planner.step(points, q=q)
        planner.attacher.attach_start(q)
        planner.step(points, q=q)
        ref = int(planner.memory.goals.attached_ref[0])
        if ref < 0:
            continue
        dq = planner.frame.difference(q, goal)
        free = judge.part_free(planner.memory.table, points, ref, q, dq)
        assert not free or clear_of(planner, q, dq, points)
        seen += 1
    assert seen > 10
