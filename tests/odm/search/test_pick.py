"""The close test of a motion with only the points that lie in the motion's cells."""

import numpy as np
from scipy.spatial.distance import cdist
from small import draw_arm, draw_valid
from wrappers import with_wrapper

import odm
from odm.obstacles import _occupancy as occupancy
from odm.obstacles._cloud import (
    ARE_REACHED,
    AS_GIVEN,
    LAYOUT,
    LINKED,
    N_INSIDE,
    N_LISTED,
    N_LOOKED,
    SORTED,
)
from odm.search import _judge as judge
from odm.search._state import EDGE_BASE
from odm.search.state import reach_on
from roadmap.kinematics.forward import difference, sphere_centers

part_free = with_wrapper(judge.part_free)
stands_free = with_wrapper(judge.stands_free)


def clear_of(planner, q, dq, points):
    """Test the motion densely, without cells and without bounds: the naive twin."""
    radii = planner.frame.radii
    spheres = np.flatnonzero(planner.robot.moving)
    order = spheres[np.argsort(planner.robot.sphere_body[spheres], kind="stable")]
    for t in np.linspace(0.0, 1.0, 200):
        centers = sphere_centers(planner.robot, q + t * dq)[order]
        gaps = cdist(points, centers) - radii
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
        free = part_free(table, EDGE_BASE - edge, begin, rest)
        assert not free or clear_of(planner, begin, rest, points)
        whole = judge.close_free(table, begin, rest)
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
        free = part_free(planner.memory.table, ref, q, dq)
        assert not free or clear_of(planner, q, dq, points)
        seen += 1
    assert seen > 10


def test_a_sorted_cloud_gives_the_points_that_all_points_give(small_map, planner, rng):
    """The same ones in the same order, so that not even what is told depends on it."""
    roadmap, robot = small_map.roadmap, small_map.robot
    nodes, picked = roadmap.nodes, []
    for _ in range(60):
        arm = draw_arm(rng)
        frame = odm.Obstacles(capsules=2, points=odm.sample_capsules(arm, 0.02))
        frame.capsules[:] = draw_arm(rng)  # whose samples are no points of the test
        planner.step(frame, q=np.zeros(robot.dof))
        memory, points = planner.memory, planner.points
        edge = int(rng.integers(roadmap.n_edges))
        a, b = nodes[roadmap.edges[edge]]
        ask = (memory.table, EDGE_BASE - edge, a, difference(robot, a, b))
        memory.cloud.counts[LAYOUT] = AS_GIVEN
        frees, found = [], []
        for layout in (LINKED, SORTED):
            if layout == SORTED:
                occupancy.sort_points(points, memory.cloud)
            frees.append(part_free(*ask))
            assert memory.cloud.counts[LAYOUT] in (layout, AS_GIVEN)
            pick = memory.picked
            k = int(pick.counts[N_LISTED])
            end = int(pick.start[k]) if k else 0
            rows = (pick.order[:end], pick.xyz[:end], pick.start[: k + 1], pick.box[:k])
            found.append([pick.counts.copy(), *(row.copy() for row in rows)])
        assert frees[0] == frees[1]
        assert all(map(np.array_equal, *found))
        picked.append(end)
    assert sum(n > 0 for n in picked) > 10


def test_points_near_a_motion_say_what_all_points_say(small_map, planner, rng):
    """Also which sphere and point are in the way, and where."""
    robot, said, looked_up = small_map.robot, [], 0
    nodes, memory = small_map.roadmap.nodes, planner.memory
    for _ in range(250):
        points = rng.uniform([-1.0, -1.0, 0.0], [1.0, 1.0, 1.5], (60, 3))
        planner.step(points, q=np.zeros(robot.dof))
        for length in (0.0, 0.1, 0.5, 1.0, 1.0, 1.0):
            a, b = nodes[rng.integers(len(nodes), size=2)]
            dq = length * difference(robot, a, b)
            told = []
            for layout in (AS_GIVEN, LINKED, SORTED):
                # of AS_GIVEN the loop makes LINKED, and of SORTED nothing else
                if layout != LINKED:
                    memory.cloud.counts[LAYOUT] = layout
                memory.cloud.counts[[N_LOOKED, ARE_REACHED]] = 0
                if layout == SORTED:
                    occupancy.sort_points(planner.points, memory.cloud)
                free = judge.close_free(memory.table, a, dq)
                assert length > 0.0 or free == stands_free(memory.table, a)
                made = SORTED if layout == SORTED else LINKED
                assert memory.cloud.counts[LAYOUT] == made
                blocker = memory.work.found[:2].tolist() + memory.work.value.tolist()
                told.append((free, None if free else blocker))
            assert told[0] == told[1] == told[2]
            said.append(told[0][0])
            looked_up += memory.reached.counts[N_INSIDE] < len(points)
    assert 100 < sum(said) < 1400
    assert looked_up > 20


def begin_again(memory):
    """Let nothing be laid out of the frame's points."""
    memory.cloud.counts[[LAYOUT, N_LOOKED, ARE_REACHED]] = AS_GIVEN, 0, 0


def test_motions_and_later_places_share_what_the_robot_can_reach(
    small_map, planner, rng
):
    memory, q = planner.memory, np.zeros(small_map.robot.dof)
    planner.step(odm.sample_capsules(draw_arm(rng), 0.02), q=q)
    counts = memory.cloud.counts
    begin_again(memory)
    for k in range(judge.FEW + 1):
        stands_free(memory.table, q)
        assert counts[LAYOUT] == LINKED and counts[ARE_REACHED] == (k == judge.FEW)
    begin_again(memory)
    judge.close_free(memory.table, q, 0.1 + q)
    assert counts[LAYOUT] == LINKED and counts[ARE_REACHED] == 1
    planner.step(odm.sample_capsules(draw_arm(rng), 0.02), q=q)
    begin_again(memory)
    planner.set_extra_clearance(0.05)  # then points count beside their blocks, too
    begin_again(memory)
    judge.close_free(memory.table, q, 0.1 + q)
    assert counts[LAYOUT] == SORTED and counts[ARE_REACHED] == 0


def test_what_is_taken_into_the_hand_reaches_farther(small_map, planner, rng):
    memory, q = planner.memory, np.zeros(small_map.robot.dof)
    planner.step(rng.uniform(-1.0, 1.0, (500, 3)), q=q)
    reached = []
    for take in (None, np.array([[0.0, 0.0, 0.3, 0.02], [0.0, 0.0, 0.6, 0.02]])):
        if take is None:
            begin_again(memory)
        else:
            planner.attach(take)
        judge.close_free(memory.table, q, 0.1 + q)
        assert memory.cloud.counts[ARE_REACHED] == 1
        reached.append(memory.reached.counts[N_INSIDE])
    assert reached[1] > reached[0] > 0


def test_blocks_that_are_not_reached_are_in_no_spheres_way(small_map, planner, rng):
    """By brute force: no sphere is as near to them, in any place."""
    robot, grid, memory = small_map.robot, small_map.grid, planner.memory
    reach, radii, arm = memory.reach, planner.frame.radii, memory.arm
    far = (arm.reach[:, reach.body[0]] + radii).max()
    away = np.flatnonzero(reach.away >= far)
    assert len(away) > 100  # the corners of the grid
    at = np.stack(np.unravel_index(away, grid.blocks), axis=1)
    low = grid.origin + 4 * grid.h * at
    nearest = np.inf
    for _ in range(300):
        q = rng.uniform(robot.lower, robot.upper)
        spheres = np.flatnonzero(robot.moving)
        order = spheres[np.argsort(robot.sphere_body[spheres], kind="stable")]
        c = sphere_centers(robot, q)[order][:, None]
        over = np.maximum(low - c, c - (low + 4 * grid.h))
        gaps = np.linalg.norm(np.maximum(over, 0.0), axis=2) - radii[:, None]
        nearest = min(nearest, gaps.min())
    assert 0.0 < nearest < 0.15  # and not much is left out in vain


def test_a_robot_that_does_not_turn_about_one_axis_reaches_everywhere(
    small_map, planner, rng
):
    arm, grid = small_map.arm, small_map.grid
    assert reach_on(arm, grid).body[0] == 1
    slides = arm.tree_i.copy()
    slides[1, 2] = 2
    beside = arm.tree_i.copy()
    beside[2, 0] = 0
    apart = beside.copy()
    apart[2, 2] = 2  # one that slides on the base, beside one that turns
    for tree in (slides, beside, apart):
        assert reach_on(arm._replace(tree_i=tree), grid).body[0] == -1
    memory, q = planner.memory, np.zeros(small_map.robot.dof)
    planner.step(rng.uniform(-1.0, 1.0, (60, 3)), q=q)
    memory.reach.body[0] = -1
    begin_again(memory)
    judge.close_free(memory.table, q, 0.1 + q)
    assert memory.cloud.counts[LAYOUT] == SORTED


def test_what_is_not_finite_is_not_free_wherever_the_points_are(small_map, planner):
    memory, q = planner.memory, np.zeros(small_map.robot.dof)
    corner = small_map.grid.origin + 0.5 * small_map.grid.h  # nowhere near
    planner.step(corner[None], q=q)
    assert memory.cloud.counts[N_LISTED] == 1
    for bad in (np.nan, np.inf):
        begin_again(memory)
        assert judge.close_free(memory.table, q, q)
        assert not judge.close_free(memory.table, q, q + bad)
        assert not judge.close_free(memory.table, q + bad, q)
    radii = memory.robot_state.radii.copy()
    for bad in (np.nan, np.inf):
        memory.robot_state.radii[-1] = bad
        for dq in (q, 0.1 + q):
            begin_again(memory)
            assert not judge.close_free(memory.table, q, dq)
    memory.robot_state.radii[:] = radii
