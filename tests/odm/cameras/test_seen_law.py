"""Whatever is there within view is never seen free; and the points cover it."""

from dataclasses import replace

import naive_camera as naive
import numpy as np
import pytest
from forms import some
from nearest import to_nearest
from seen_scenes import (
    camera_at,
    draw_camera,
    draw_capsules,
    draw_inside,
    draw_surface,
    picture,
)

import odm
from odm.cameras.space import CELL_NAMES
from roadmap.kinematics.forward import sphere_centers

STILL = odm.SeenSettings(memory_s=0.0)
UNSEEN, FREE, SHADOW, OCCUPIED = range(4)
BEYOND = CELL_NAMES.index("out of reach")
Q = np.zeros(3)


def state_at(space, points):
    """Return what the cells of points are; out of the grid: BEYOND."""
    at = space.cell_map.grid.locate(points)
    inside = at[:, 0] >= 0
    found = np.full(len(points), BEYOND)
    found[inside] = space.cells()[tuple(at[inside].T)]
    return found


@pytest.mark.parametrize("seed", range(12))
def test_no_point_of_an_obstacle_is_ever_seen_free(small_map, seed):
    rng = np.random.default_rng(seed)
    cameras = [draw_camera(rng) for _ in range(1 + seed % 3)]
    capsules = draw_capsules(rng)
    space = odm.SeenSpace(small_map, cameras, STILL)
    seen = space.update([picture(c, capsules) for c in cameras], Q, 0.0)
    assert seen.trouble is None
    states = state_at(space, draw_inside(rng, capsules, 20000))
    assert not (states == FREE).any()
    # it is not because nothing is free
    assert space.counts()["free"] > 1000


@pytest.mark.parametrize("seed", some(range(4), 0))
@pytest.mark.parametrize("corner", [(2, 84), (64, 0), (64, 84)])
def test_a_crop_without_the_middle_sees_what_the_whole_sees(small_map, seed, corner):
    rng = np.random.default_rng(seed)
    camera, capsules = draw_camera(rng), draw_capsules(rng)
    image = picture(camera, capsules)
    v, u = corner
    part = np.s_[v : v + 56, u : u + 76]
    crop = replace(camera, width=76, height=56, cx=camera.cx - u, cy=camera.cy - v)
    assert not (0 <= crop.cx < 76 and 0 <= crop.cy < 56)
    only = np.where(inside(image, part), image, 0).astype(np.uint16)
    np.testing.assert_allclose(
        crop.points(image[part]), camera.points(only), atol=1e-12
    )
    whole, cut = (odm.SeenSpace(small_map, c, STILL) for c in (camera, crop))
    whole.update(image, Q, 0.0)
    cut.update(image[part], Q, 0.0)
    seen, found = whole.cells(), cut.cells()
    for kind in (FREE, OCCUPIED):
        assert (seen[found == kind] == kind).all()
    assert (found == FREE).any()
    own = np.zeros(image[part].shape, bool)
    slow = naive.cell_states(crop, image[part], own, small_map.grid)
    assert (slow[(found == FREE) & ~eighths_all_free(cut)] == FREE).all()


def inside(image, part):
    """Return which pixels a part of the image holds."""
    held = np.zeros(image.shape, bool)
    held[part] = True
    return held


@pytest.mark.parametrize("seed", range(4))
def test_thin_things_are_seen_down_to_the_stated_thickness(small_map, seed):
    rng = np.random.default_rng(seed)
    camera = draw_camera(rng)
    capsules = draw_capsules(rng, 6)
    eye = camera.T_base_camera[:3, 3]
    far = np.linalg.norm(capsules[:, :3] - eye, axis=1) + 0.3
    capsules[:, 6] = [0.5 * camera.thinnest(z) for z in far]
    space = odm.SeenSpace(small_map, camera, STILL)
    image = picture(camera, capsules)
    holes = naive.lone_holes(np.where(rng.random(image.shape) < 0.05, 0, image))
    for pixels in (image, np.where(holes, 0, image).astype(np.uint16)):
        space.update(pixels, Q, 0.0)
        states = state_at(space, draw_inside(rng, capsules, 20000))
        assert not (states == FREE).any()
        assert space.counts()["free"] > 500


@pytest.mark.parametrize("seed", range(6))
def test_what_comes_near_to_an_obstacle_in_view_comes_near_to_a_point(small_map, seed):
    """The law of the planner: balls near a blocked place have a point within reach."""
    rng = np.random.default_rng(100 + seed)
    cameras = [draw_camera(rng) for _ in range(1 + seed % 2)]
    capsules = draw_capsules(rng)
    space = odm.SeenSpace(small_map, cameras, STILL)
    seen = space.update([picture(c, capsules) for c in cameras], Q, 0.0)
    surface, normal = draw_surface(rng, capsules, 4000)
    blocked = np.isin(state_at(space, surface), (SHADOW, OCCUPIED))
    arm, m = small_map.arm.spheres, small_map.safety.m
    radius = rng.choice(arm[:, 3], len(surface))
    reach = (radius + m) * rng.choice([0.2, 0.7, 0.9999], len(surface))
    balls = surface + reach[:, None] * normal
    near = blocked & in_reach(small_map, balls)
    assert near.sum() > 200
    gaps = to_nearest(balls[near], seen.points)
    assert (gaps <= radius[near] + m + seen.covering_radius).all()


def test_only_cells_whose_neighbours_are_full_are_given_by_their_centres(small_map):
    rng = np.random.default_rng(3)
    camera = draw_camera(rng)
    space = odm.SeenSpace(small_map, camera, STILL)
    space.update(picture(camera, draw_capsules(rng)), Q, 0.0)
    room = space._buffers
    blocked, closed = room.unpack(room.blocked), room.unpack(room.closed)
    full = closed | (blocked & (room.eighths == 255)) | room.unpack(room.beyond)
    inner = room.unpack(room.inner)
    assert inner.sum() > 500 and (closed & ~inner).any()
    for axis in range(3):
        for step in (-1, 1):
            assert np.roll(full, step, axis)[inner].all()


def in_reach(cell_map, points):
    """Return which points a centre of the robot's spheres can be at."""
    from odm.obstacles.grid import bounding_ball

    center, radius = bounding_ball(cell_map.robot)
    largest = cell_map.arm.spheres[:, 3].max()
    return np.linalg.norm(points - center, axis=1) <= radius - largest


@pytest.mark.parametrize("seed", some(range(3), 0))
def test_the_compiled_loops_agree_with_their_slow_twin(small_map, seed):
    rng = np.random.default_rng(200 + seed)
    camera = draw_camera(rng, size=(100, 75), focal=110.0)
    q = rng.uniform(-0.5, 0.5, 3)
    image = picture(camera, draw_capsules(rng), small_map.robot, q)
    image[rng.random(image.shape) < 0.01] = 0
    space = odm.SeenSpace(small_map, camera, odm.SeenSettings(memory_s=0, d_self=0.01))
    seen = space.update(image, q, 0.0)
    robot = small_map.robot
    radii = robot.spheres[:, 3] + 0.01
    own = naive.own_readings(camera, image, sphere_centers(robot, q), radii)
    assert seen.readings["own"] == own.sum() > 0
    assert seen.readings["valid"] == naive.is_valid(image).sum()
    cells = space.cells()
    twin = np.where(
        cells == BEYOND, BEYOND, naive.cell_states(camera, image, own, small_map.grid)
    )
    # squares of readings are a little larger than needed, eighths a little smaller
    freed = eighths_all_free(space)
    assert (twin[(cells == FREE) & ~freed] == FREE).all()
    assert np.isin(cells[twin == SHADOW], (SHADOW, FREE)).all()
    assert (cells[twin == OCCUPIED] == OCCUPIED).all()
    assert (cells[twin == BEYOND] == BEYOND).all()
    both = ((cells == FREE) & (twin == FREE)).sum()
    assert both > 0.7 * (twin == FREE).sum()


def eighths_all_free(space):
    """Return the cells that became free since all their eighths are."""
    room = space._buffers
    blocked_at_first = room.unpack(room.closed | room.blocked) | (room.eighths == 0)
    return blocked_at_first & (space.cells() == FREE)


@pytest.mark.parametrize("nothing", [0, 65535])
def test_behind_holes_and_beside_the_picture_nothing_is_seen_free(small_map, nothing):
    """As if each pixel without a reading told of something right at the lens."""
    rng = np.random.default_rng(6)  # there are cells in view at all four edges
    camera = draw_camera(rng)
    image = picture(camera, draw_capsules(rng))
    holes = np.zeros(image.shape, bool)
    holes[40:60, 64:96] = True  # wide enough for four pixels to be read as one
    # single ones, whose neighbours beyond the edge are not known
    holes[0, ::4] = holes[-1, 2::4] = holes[::4, 0] = holes[2::4, -1] = True
    found = []
    for reading in (nothing, 1):
        space = odm.SeenSpace(small_map, camera, STILL)
        space.update(np.where(holes, reading, image).astype(np.uint16), Q, 0.0)
        found.append(space.cells() == FREE)
    assert found[0].sum() > 500
    assert not (found[0] & ~found[1]).any()


def corners_in(camera, grid, cells):
    """Return where the corners of cells (n, 3) are seen: u, v, depth, (n, 8) each."""
    corners = grid.origin + grid.h * (cells[:, None] + naive.CORNERS)
    T = np.linalg.inv(camera.T_base_camera)
    x, y, z = np.moveaxis(corners @ T[:3, :3].T + T[:3, 3], -1, 0)
    with np.errstate(divide="ignore"):
        return camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy, z


def test_what_reaches_out_of_the_picture_is_never_seen_free(small_map):
    """As if right beside each edge of it somebody stood before the lens."""
    camera = camera_at([1.1, 0.1, 0.5], focal=240.0, scale=1e-4)
    space = odm.SeenSpace(small_map, camera, STILL)
    space.update(np.full((120, 160), 65534, np.uint16), Q, 0.0)
    cells = np.argwhere(space.cells() != BEYOND)
    free = space.cells()[tuple(cells.T)] == FREE
    u, v, _ = corners_in(camera, small_map.grid, cells)
    for out in (u < 0, u > 159, v < 0, v > 119):
        cut = out.any(axis=1) & ~out.all(axis=1)
        assert cut.sum() > 50 and not free[cut].any()
    assert free.sum() > 500


def test_what_is_farther_than_any_reading_is_never_seen_free(small_map):
    camera = camera_at([1.1, 0.1, 0.5], scale=1.0 / 65534)  # 1 m at the most
    space = odm.SeenSpace(small_map, camera, STILL)
    space.update(np.full((120, 160), 65534, np.uint16), Q, 0.0)
    cells = np.argwhere(space.cells() == FREE)
    assert len(cells) > 500
    assert corners_in(camera, small_map.grid, cells)[2].max() < 1.0


def test_a_camera_in_the_midst_of_the_cells_knows_what_it_cannot_see(small_map):
    """Blocks of cells that reach behind it are looked at cell by cell."""
    camera = camera_at([0.5, 0.1, 0.5])
    space = odm.SeenSpace(small_map, camera, STILL)
    space.update(np.full((120, 160), 1, np.uint16), Q, 0.0)  # covered by a hand
    cells = np.argwhere(space.cells() != BEYOND)
    u, v, z = corners_in(camera, small_map.grid, cells)
    inside = (z > 0.02) & (u > 0) & (u < 159) & (v > 0) & (v < 119)
    cells = cells[inside.all(axis=1)]
    blocks, grid = cells // 4 * 4, small_map.grid
    ends = [corners_in(camera, grid, blocks + 4 * c)[2][:, 0] for c in naive.CORNERS]
    assert (np.min(ends, axis=0) < 0.0).sum() >= 5  # cells of blocks behind it
    assert np.isin(space.cells()[tuple(cells.T)], (SHADOW, OCCUPIED)).all()


@pytest.mark.parametrize("seed", range(2))
def test_an_eighth_of_a_cell_is_freed_as_a_cell_of_its_size_is(small_map, seed):
    rng = np.random.default_rng(seed)
    camera = draw_camera(rng)
    image = picture(camera, draw_capsules(rng))
    space = odm.SeenSpace(small_map, camera, STILL)
    space.update(image, Q, 0.0)
    room, grid = space._buffers, small_map.grid
    looked_at = room.unpack(room.blocked) & ~room.unpack(room.closed)
    cells = np.argwhere(looked_at & ~room.unpack(room.beyond) & (room.eighths != 255))
    left = room.eighths[tuple(cells.T)]
    freed = [
        grid.origin + grid.h * (cell + 0.5 * corner + 0.5 * naive.CORNERS)
        for cell, mask in zip(cells, left, strict=True)
        for k, corner in enumerate(naive.CORNERS)
        if not (mask >> k) & 1
    ]
    assert len(freed) > 200
    assert naive.are_seen_free(camera, image, np.array(freed)).all()


def test_a_camera_more_never_frees_what_another_sees_occupied(small_map, rng):
    for _ in range(6):
        cameras = [draw_camera(rng) for _ in range(3)]
        images = [picture(c, draw_capsules(rng)) for c in cameras]
        # three different scenes: they contradict each other
        alone = []
        for camera, image in zip(cameras, images, strict=True):
            space = odm.SeenSpace(small_map, camera, STILL)
            space.update(image, Q, 0.0)
            alone.append(space.cells().copy())
        space = odm.SeenSpace(small_map, cameras, STILL)
        space.update(images, Q, 0.0)
        together = space.cells()
        occupied = np.any([a == OCCUPIED for a in alone], axis=0)
        assert occupied.sum() > 100
        assert (together[occupied] == OCCUPIED).all()
        free = np.any([a == FREE for a in alone], axis=0)
        # a cell freed by its eighths alone need not be looked at so closely again
        states = together[free & ~occupied]
        assert np.isin(states, (FREE, SHADOW)).all()
        assert (states == FREE).mean() > 0.95


def test_a_second_camera_frees_the_shadow_of_the_first(small_map):
    wall = np.array([[0.25, -0.2, 0.4, 0.25, 0.2, 0.4, 0.1]])
    one, other = camera_at([1.3, 0, 0.5]), camera_at([-1.3, 0.1, 0.5])
    alone = odm.SeenSpace(small_map, one, STILL)
    alone.update(picture(one, wall), Q, 0.0)
    both = odm.SeenSpace(small_map, [one, other], STILL)
    both.update([picture(c, wall) for c in (one, other)], Q, 0.0)
    behind = np.array([[0.0, 0.0, 0.4]])
    assert state_at(alone, behind) == SHADOW
    assert state_at(both, behind) == FREE


def test_without_shadow_only_points_block(small_map):
    wall = np.array([[0.25, -0.2, 0.4, 0.25, 0.2, 0.4, 0.1]])
    camera = camera_at([1.3, 0, 0.5])
    settings = odm.SeenSettings(memory_s=0.0, shadow=False)
    space = odm.SeenSpace(small_map, camera, settings)
    image = picture(camera, wall, room=False)
    seen = space.update(image, Q, 0.0)
    assert space.counts()["shadow"] == 0
    raw = camera.points(image)
    gap = np.linalg.norm(seen.points[:, None] - raw[None], axis=2)
    assert gap.min(axis=1).max() <= seen.covering_radius  # no point without a reading
    near = small_map.grid.locate(raw)[:, 0] >= 0
    assert gap.min(axis=0)[near].max() <= seen.covering_radius  # all readings covered


def test_what_a_ray_went_through_is_free_in_the_same_frame(small_map):
    camera = camera_at([1.3, 0, 0.5])
    hand = np.array([[0.2, 0.0, 0.5, 0.2, 0.0, 0.5, 0.05]])
    space = odm.SeenSpace(small_map, camera)
    space.update(picture(camera, hand), Q, 0.0)
    there = hand[:, :3] + [0.03, 0.0, 0.0]
    assert state_at(space, there) == OCCUPIED
    space.update(picture(camera), Q, 0.01)
    assert state_at(space, there) == FREE
