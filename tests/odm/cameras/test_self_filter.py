"""The self filter takes the robot's own points only, and tells which."""

import naive_camera as naive
import numpy as np
import pytest
from seen_scenes import camera_at, draw_camera, draw_capsules, picture

import odm
from odm.cameras.space import CELL_NAMES
from roadmap.kinematics.forward import body_frames, sphere_centers, tool_pose

Q = np.array([0.4, 0.7, 0.0])
D_SELF = 0.006


def names_of(robot, balls):
    return {robot.link_names[robot.sphere_link[k]] for k in balls}


@pytest.mark.parametrize("seed", range(4))
def test_just_the_points_within_d_self_of_the_cover_go(small_map, seed):
    rng = np.random.default_rng(seed)
    robot, camera = small_map.robot, draw_camera(rng)
    q = rng.uniform(robot.lower, robot.upper)
    image = picture(camera, draw_capsules(rng), robot, q)
    settings = odm.SeenSettings(memory_s=0.0, d_self=D_SELF)
    seen = odm.SeenSpace(small_map, camera, settings).update(image, q, 0.0)
    centers = sphere_centers(robot, q)
    own = naive.own_readings(camera, image, centers, robot.spheres[:, 3] + D_SELF)
    assert seen.readings["own"] == own.sum() == sum(seen.removed.values())
    # the robot is seen, and all of it is gone
    bare = picture(camera, [], robot, q, room=False)
    assert own[(bare > 0) & (bare == image)].all() and (bare > 0).sum() > 100


def test_removals_are_counted_by_link_base_and_payload_included(small_map):
    robot, camera = small_map.robot, camera_at([1.1, 0.2, 0.6])
    settings = odm.SeenSettings(memory_s=0.0, d_self=D_SELF)
    space = odm.SeenSpace(small_map, camera, settings)
    T = tool_pose(robot, Q)
    held = np.array([[0.0, 0.0, 0.06, 0.04]])
    center = T[:3, :3] @ held[0, :3] + T[:3, 3]
    image = picture(camera, np.r_[center, center, 0.04], robot, Q)
    seen = space.update(image, Q, 0.0, payload=held)
    assert set(seen.removed) == {"base", "upper", "lower", "hand", "payload"}
    without = space.update(image, Q, 0.1)
    assert "payload" not in without.removed
    assert without.readings["own"] < seen.readings["own"]
    assert CELL_NAMES[space.cells()[tuple(small_map.grid.locate(center))]] in (
        "occupied", "shadow",
    )  # fmt: skip


def test_the_filter_is_off_by_default(small_map):
    camera = camera_at([1.1, 0.2, 0.6])
    image = picture(camera, [], small_map.robot, Q)
    seen = odm.SeenSpace(small_map, camera).update(image, Q, 0.0)
    assert seen.readings["own"] == 0 and not seen.removed
    gap = np.linalg.norm(seen.points - sphere_centers(small_map.robot, Q)[-1], axis=1)
    assert gap.min() < 0.1  # its own hand is in its way


def test_flying_pixels_go_where_asked_and_nothing_is_free_behind_them(small_map):
    camera = camera_at([1.3, 0, 0.5])
    hand = np.array([[0.2, 0.0, 0.5, 0.2, 0.0, 0.5, 0.06]])
    image = picture(camera, hand)
    spot = np.argwhere(np.diff(image.astype(int), axis=1) > 1000)[5]
    v, u = int(spot[0]), int(spot[1])
    image[v, u] = (int(image[v, u - 1]) + int(image[v, u + 1])) // 2
    plain = odm.SeenSpace(small_map, camera, odm.SeenSettings(memory_s=0.0))
    assert plain.update(image, Q, 0.0).readings["flying"] == 0
    settings = odm.SeenSettings(memory_s=0.0, flying_m=0.05)
    space = odm.SeenSpace(small_map, camera, settings)
    seen = space.update(image, Q, 0.0)
    assert seen.readings["flying"] == flying_twin(image, 100) > 0
    # the hand itself stays
    front = np.array([0.26, 0.0, 0.5])
    assert np.linalg.norm(seen.points - front, axis=1).min() < 0.03
    # no ray through the gap says that the cells along it are free
    image[v, u] = 0
    other = odm.SeenSpace(small_map, camera, odm.SeenSettings(memory_s=0.0))
    other.update(image, Q, 0.0)
    assert space.counts()["free"] <= other.counts()["free"]


def flying_twin(image, jump):
    count, a = 0, image.astype(int)
    for v, u in np.ndindex(image.shape):
        if not naive.is_valid(image)[v, u]:
            continue
        for dv, du in ((0, 1), (1, 0)):
            if not (dv <= v < a.shape[0] - dv and du <= u < a.shape[1] - du):
                continue
            low, high = sorted((a[v - dv, u - du], a[v + dv, u + du]))
            if low > 0 and low + jump < a[v, u] < high - jump:
                count += 1
                break
    return count


@pytest.fixture(scope="module")
def panda_map():
    """A Panda with a few nodes: the close test needs no more."""
    from dataclasses import replace

    recipe = odm.load_recipe("panda")
    few = replace(recipe.roadmap, nodes=12, neighbors=2)
    return odm.build_map(replace(recipe, roadmap=few))


def test_a_hand_2_cm_from_link_5_stays_visible_and_blocks_the_motion_into_it(panda_map):
    """The figure of the issue, with the exact robot in the image."""
    robot = panda_map.robot
    q = np.array([0.0, -0.4, 0.0, -2.0, 0.0, 1.6, 0.8])
    hand, side = hand_beside(panda_map, q, "panda_link5", 0.02)
    camera = camera_at(
        hand[:3] + 0.8 * side + [0.3, 0, 0.3], hand[:3], (640, 480), 476.0, scale=0.001
    )
    image = picture(camera, hand, robot, q)
    settings = odm.SeenSettings(d_self=0.005)
    seen = odm.SeenSpace(panda_map, camera, settings).update(image, q, 0.0)
    assert seen.trouble is None and seen.removed["panda_link5"] > 100
    alone = picture(camera, hand, room=False)
    visible = (alone > 0) & (alone == image)
    radii = robot.spheres[:, 3] + settings.d_self
    lost = naive.own_readings(camera, image, sphere_centers(robot, q), radii)
    assert visible.sum() > 1000
    assert (lost & visible).sum() < 0.25 * visible.sum()
    planner = odm.ReactivePlanner(panda_map)
    planner.step(seen.points, q=q, covering_radius=seen.covering_radius)
    into, clear = motions(robot, q, hand, "panda_link5")
    assert not planner.is_free(q, into)
    assert planner.is_free(q, into).failed == "frame"
    # without the hand the very same motion is free, with the filter on
    empty = odm.SeenSpace(panda_map, camera, settings).update(
        picture(camera, [], robot, q), q, 0.0
    )
    planner.step(empty.points, q=q, covering_radius=empty.covering_radius)
    assert planner.is_free(q, into), planner.is_free(q, into).reason


def hand_beside(cell_map, q, link, gap):
    """Return an upright capsule (7,) `gap` from a link's solids, and the way to it."""
    from odm.exact.distances import ExactRobot

    robot = cell_map.robot
    body = robot.link_body[robot.link_names.index(link)]
    middle = body_frames(robot, q)[body][:3, 3]
    exact, radius = ExactRobot(robot), 0.04
    side = np.array([0.0, 1.0, 0.0])
    low, high = 0.0, 0.6
    for _ in range(40):
        far = 0.5 * (low + high)
        p = middle + far * side
        shape = odm.Capsule.between(p - [0, 0, 0.08], p + [0, 0, 0.08], radius)
        near = exact.distance(q, [shape])
        low, high = (far, high) if near.distance < gap else (low, far)
    p = middle + high * side
    assert near.link == link
    return np.r_[p - [0, 0, 0.08], p + [0, 0, 0.08], radius], side


def motions(robot, q, hand, link):
    """Return the nearest q to both sides whose link is moved towards and away."""
    middle = 0.5 * (hand[:3] + hand[3:6])
    body = robot.link_body[robot.link_names.index(link)]
    best = None
    for step in (-0.15, 0.15):
        other = q.copy()
        other[0] += step
        p = body_frames(robot, other)[body][:3, 3]
        gap = np.linalg.norm((p - middle)[:2])
        if best is None or gap < best[0]:
            best = gap, other, q - (other - q)
    return best[1], best[2]
