"""A camera's points are moved, cropped and thinned; nothing is lost uncounted."""

import re

import numpy as np
import pytest
from nearest import to_nearest
from rows import each

import odm
from odm.obstacles.point_cloud import thinned
from roadmap.errors import BadInput
from roadmap.transforms import pose_of


def wall(n=60):
    """A wall of n x n points, 1 cm apart, in the x-y plane of the camera."""
    x, y = np.meshgrid(np.arange(n) * 0.01, np.arange(n) * 0.01)
    return np.stack([x, y, np.full_like(x, 1.0)], -1)


@pytest.mark.parametrize("gap", [0.003, 0.02, 0.2, 3.0])
def test_every_point_stays_near_to_one_that_is_kept(rng, gap):
    points = rng.uniform(-1.0, 1.0, (3000, 3)) * [1.0, 1.0, 0.2]
    kept, far = thinned(points, gap)
    apart = to_nearest(points, points[kept])
    assert apart.max() <= far <= gap
    assert (np.diff(kept) > 0).all() and (len(kept) < len(points) or gap < 0.01)


def test_thinning_keeps_the_covering_radius_that_it_says():
    points = wall()
    cloud = odm.PointCloud(points, covering_radius=0.03, spacing=0.0071)
    assert cloud.covering_radius <= 0.03 and 20 < len(cloud) < 2500
    assert cloud.thinned == 3600 - len(cloud)
    # the surface between the points, not the points alone
    x = np.random.default_rng(1).uniform(0.0, 0.59, (2000, 2))
    surface = np.column_stack([x, np.ones(len(x))])
    apart = to_nearest(surface, cloud.points)
    assert apart.max() <= cloud.covering_radius


def test_points_are_moved_into_the_world_before_the_crop():
    T = pose_of([0.0, 0.0, 2.0], [np.pi, 0.0, 0.0])  # a camera that looks down
    cloud = odm.PointCloud(wall(), T, crop=((-1.0, -0.2, 0.0), (1.0, 1.0, 3.0)))
    assert np.allclose(cloud.points[:, 2], 1.0) and cloud.points[:, 1].min() >= -0.2
    assert cloud.cropped == 3600 - len(cloud) > 0 and cloud.thinned == 0
    assert cloud.covering_radius == 0.005


def test_nan_is_counted_and_left_out():
    points = wall()
    points[3:5, 7] = np.nan
    points[9, 9, 1] = np.inf
    cloud = odm.PointCloud(points)
    assert cloud.nan == 3 and len(cloud) == 3597 and np.isfinite(cloud.points).all()
    assert "3 NaN" in repr(cloud)
    nothing = odm.PointCloud(np.full((4, 3), np.nan), covering_radius=0.02)
    assert len(nothing) == 0 and nothing.nan == 4 and nothing.trouble
    assert len(odm.PointCloud(np.zeros((0, 3)))) == 0


def test_a_crop_to_the_robot_leaves_out_what_no_motion_reaches(planner, rng):
    points = rng.uniform(-4.0, 4.0, (4000, 3))
    for T_world_base in (np.eye(4), pose_of([1.0, 0.5, 0.0], [0.0, 0.0, 1.0])):
        planner.set_base(T_world_base)
        cloud = odm.PointCloud(points, crop=planner, spacing=0.0)
        q = np.array([1.2, 0.6, 0.0])
        planner.step(points[:0], q=q)
        planner.step(points, q=q)
        counted = planner.memory.cloud.counts[1]  # inside the grid
        planner.step(cloud, q=q)
        assert planner.memory.cloud.counts[1] == counted and cloud.cropped > 3000
    inside = odm.PointCloud(points, crop=planner.cell_map, spacing=0.0)
    assert 0 < len(inside) < 1000


@pytest.mark.parametrize("extra", [0.0, 0.1])
def test_a_cloud_that_was_cropped_for_another_base_or_clearance_says_nothing(
    planner, rng, extra
):
    cell_map, q = planner.cell_map, np.array([1.2, 0.6, 0.0])
    points = rng.uniform(-4.0, 4.0, (4000, 3)) + [0.0, 0.0, 9.0]  # far over the robot
    points[0] = cell_map.grid.origin - 0.02  # what more clearance counts
    now, loaded = odm.ReactivePlanner(cell_map), odm.ReactivePlanner(cell_map)
    for crop in (now, cell_map):
        cloud = odm.PointCloud(points, crop=crop)
        now.step(cloud, q=q)
        assert now.is_free(q, q) and cloud.cropped == 4000
    loaded.load_memory(now.save_memory())
    for one in (now, loaded):
        if extra:
            one.set_extra_clearance(extra)
        else:
            one.set_base(pose_of([0.0, 0.0, 9.0], [0.0, 0.0, 0.0]))
        assert "show a frame" in one.is_free(q, q).reason
        assert one.separation(q) == -np.inf and one.blocked_leg(q[None]) == 0
        with pytest.raises(BadInput, match="crop it with this planner"):
            one.step(cloud, q=q)
        assert one.step(odm.PointCloud(points, crop=one), q=q).frame and not one.trouble
        assert len(one.points) > 0


@pytest.mark.parametrize(
    ("points", "told"),
    [
        (1000.0 * wall(), "more than 20 m .* millimetres: divide by 1000"),
        (100.0 * wall(), "centimetres: divide by 100"),
        (np.nan * wall(), "3600 obstacle points are NaN or infinite.*check the sensor"),
    ],
)
def test_a_cloud_that_a_crop_would_empty_wrongly_holds(planner, points, told):
    q = np.array([1.2, 0.6, 0.0])
    planner.set_goals([-q])
    for crop in (planner, planner.cell_map, ([-1.0] * 3, [1.0] * 3)):
        cloud = odm.PointCloud(points, crop=crop, covering_radius=0.02)
        assert len(cloud) == 0 and "of no use" in repr(cloud)
        for _ in range(2):
            answer = planner.step(cloud, q=q)
            assert answer.status == "holding"
            assert re.search(told, answer.reason), answer.reason
        assert planner.see(cloud, q=q) == cloud.trouble
        for good in (wall() + [5.0, 0, 0], np.zeros((0, 3))):
            cloud = odm.PointCloud(good, crop=crop)
            assert len(cloud) == 0 and cloud.trouble is None
            assert planner.step(cloud, q=q).status != "holding"


def test_how_far_a_sensor_sees_is_the_planners_setting_or_told(planner):
    assert odm.PointCloud(wall() + [30.0, 0, 0], crop=planner).trouble is not None
    far = odm.PlannerSettings(max_range_m=50.0)
    planner = odm.ReactivePlanner(planner.cell_map, settings=far)
    assert odm.PointCloud(wall() + [30.0, 0, 0], crop=planner).trouble is None
    box = [29.0, -5.0, -5.0], [80.0, 5.0, 5.0]  # far from the world's origin
    assert odm.PointCloud(wall() + [30.0, 0, 0], crop=box).trouble is None
    cloud = odm.PointCloud(wall(), crop=box)
    assert "more than 20 m outside the crop" in cloud.trouble
    assert odm.PointCloud(wall(), crop=box, max_range_m=100.0).trouble is None


def test_a_cloud_brings_its_covering_radius(planner):
    q = np.array([1.2, 0.6, 0.0])
    planner.set_goals([-q])
    cloud = odm.PointCloud(wall() + [5.0, 0, 0], covering_radius=0.02, spacing=0.0071)
    planner.step(cloud, q=q)
    assert planner.frame.sampled[0] == cloud.covering_radius
    planner.step(odm.PointCloud(wall(), spacing=0.004), q=q)
    assert planner.frame.sampled[0] == 0.004
    with pytest.raises(BadInput, match="lies outside 0 to 0.03"):
        planner.step(odm.PointCloud(wall(), spacing=0.2), q=q)


@each(
    ("how", "told"),
    [
        ({"points": np.zeros((3, 2))}, r"shape \(3, 2\); give \(n, 3\)"),
        ({"points": np.zeros((3, 3), np.uint8)}, "dtype uint8, .* float64"),
        ({"max_range_m": 0.0}, "max_range_m in m is 0.0"),
        ({"points": "cloud"}, "points must be an array of real numbers"),
        ({"T_world_camera": np.ones((4, 4))}, "not a rigid"),
        ({"spacing": -0.1}, "spacing in m is -0.1"),
        ({"spacing": np.nan}, "spacing in m is nan"),
        ({"covering_radius": 0.005}, "is not above spacing 0.005 m"),
        ({"covering_radius": 30.0}, "covering_radius in m is 30.0"),
        ({"crop": 1.0}, "crop is 1.0; give"),
        ({"crop": ([1, 1, 1], [0, 0, 0])}, "the first below the second"),
        ({"crop": ([1, 1], [0, 0])}, "two corners"),
        ({"points": np.eye(3) * 1e9, "covering_radius": 0.01}, "too far apart"),
    ],
)
def test_bad_clouds_are_refused_in_a_sentence(how, told):
    with pytest.raises(BadInput, match=told):
        odm.PointCloud(**{"points": np.zeros((3, 3)), **how})
