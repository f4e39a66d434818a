"""From image to path: what the planner calls free keeps its distance, exactly."""

import numpy as np
import pytest
from seen_scenes import camera_at, draw_capsules, draw_inside, picture
from small import AWAY, HOME, draw_valid

import odm
from odm.exact.distances import ExactRobot
from odm.obstacles.grid import bounding_ball

EYES = ([1.4, 0.3, 0.9], [-1.3, -0.4, 0.8])


@pytest.mark.parametrize("seed", range(6))
def test_paths_keep_m_from_everything_in_view(small_map, seed):
    rng = np.random.default_rng(300 + seed)
    cameras = [camera_at(eye) for eye in EYES]
    space = odm.SeenSpace(small_map, cameras, odm.SeenSettings(memory_s=0.0))
    planner = odm.ReactivePlanner(
        small_map, settings=odm.PlannerSettings(history_s=0.0)
    )
    exact, m = ExactRobot(small_map.robot), small_map.safety.m
    paths = 0
    for k in range(12):
        capsules = in_view(space, cameras, draw_capsules(rng, 3), rng)
        if not len(capsules):
            continue
        images = [picture(camera, capsules) for camera in cameras]
        start, goal = draw_valid(planner, rng), draw_valid(planner, rng)
        seen = space.update(images, start, 0.1 * k)
        planner.reset()
        planner.set_goals([goal])
        answer = planner.step(
            seen.points, q=start, covering_radius=seen.covering_radius
        )
        shapes = [odm.Capsule.between(c[:3], c[3:6], c[6]) for c in capsules]
        for a, b in zip(answer.path[:-1], answer.path[1:], strict=True):
            paths += 1
            for t in np.linspace(0.0, 1.0, 8):
                near = exact.distance(a + t * (b - a), shapes)
                assert near.distance + near.gap >= m
    assert paths > 2


def in_view(space, cameras, capsules, rng):
    """Return the capsules all of which some camera has in its picture."""
    center, radius = bounding_ball(space.robot)
    kept = []
    for capsule in capsules:
        points = draw_inside(rng, capsule[None], 300)
        shown = np.zeros(len(points), bool)
        for camera in cameras:
            T = np.linalg.inv(camera.T_base_camera)
            p = points @ T[:3, :3].T + T[:3, 3]
            u = camera.fx * p[:, 0] / p[:, 2] + camera.cx
            v = camera.fy * p[:, 1] / p[:, 2] + camera.cy
            inside = (u > 9) & (v > 9) & (u < 150) & (v < 110)
            shown |= inside & (p[:, 2] > 0.3)
        # what lies farther off than the robot reaches need not be in view
        shown |= np.linalg.norm(points - center, axis=1) > radius + 0.1
        if shown.all():
            kept.append(capsule)
    return np.array(kept).reshape(-1, 7)


def test_a_hand_in_the_way_is_gone_round_and_freed_when_it_leaves(small_map):
    # pixels a centimetre wide would let the floor's shadow reach the arm
    cameras = [camera_at(eye, size=(320, 240), focal=240.0) for eye in EYES]
    robot, planner = small_map.robot, odm.ReactivePlanner(small_map)
    space = odm.SeenSpace(small_map, cameras, odm.SeenSettings(d_self=0.01))
    planner.set_goals([AWAY])
    straight = planner_answer(space, planner, cameras, [], robot, 0.0)
    assert straight.status != "holding" and len(straight.path) == 2
    assert straight.certified == "visible surface"
    hand = [0.0, 0.0, 0.78, 0.0, 0.0, 0.9, 0.05]
    other = planner_answer(space, planner, cameras, hand, robot, 0.03)
    assert other.status == "holding" or len(other.path) > 2
    again = planner_answer(space, planner, cameras, [], robot, 0.06)
    assert again.status != "holding"
    assert planner.is_free(HOME, AWAY)


def planner_answer(space, planner, cameras, capsules, robot, stamp):
    images = [picture(camera, capsules, robot, HOME) for camera in cameras]
    seen = space.update(images, HOME, stamp)
    assert seen.trouble is None and sum(seen.removed.values()) > 100
    return planner.step(
        seen.points, q=HOME, covering_radius=seen.covering_radius, stamp=seen.stamp,
        now=stamp + 0.01,
    )  # fmt: skip
