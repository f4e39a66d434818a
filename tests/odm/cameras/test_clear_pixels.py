"""Pixels of 65535 free what is known to be empty, where the camera says how far."""

import naive_camera as naive
import numpy as np
import pytest
from forms import some
from rows import each
from seen_scenes import camera_at, draw_camera, draw_capsules, draw_inside, picture
from small import AWAY, HOME, POST

import odm
from odm.cameras.space import CELL_NAMES
from roadmap.errors import BadInput

STILL = odm.SeenSettings(memory_s=0.0)
UNSEEN, FREE, SHADOW, OCCUPIED = range(4)
BEYOND = CELL_NAMES.index("out of reach")
Q = np.zeros(3)
CLEAR = 65535


def state_at(space, points):
    """Return what the cells of points are; out of the grid: BEYOND."""
    at = space.cell_map.grid.locate(points)
    inside = at[:, 0] >= 0
    found = np.full(len(points), BEYOND)
    found[inside] = space.cells()[tuple(at[inside].T)]
    return found


def emptied(camera, capsules=(), most=np.inf):
    """Return the image of things with nothing behind; 65535 from `most` m on."""
    image = picture(camera, capsules, room=False)
    return np.where((image == 0) | (image * camera.scale > most), CLEAR, image).astype(
        np.uint16
    )


@pytest.mark.parametrize("policy", ["free", "occupied", "keep"])
def test_who_left_an_empty_room_is_gone_in_that_frame(small_map, policy):
    hand = np.array([[0.2, 0.0, 0.5, 0.2, 0.1, 0.5, 0.05]])
    spot = np.array([[0.2, 0.05, 0.5]])
    found = []
    for clear_m in (None, 3.0):
        camera = camera_at([1.3, 0, 0.5], clear_m=clear_m)
        space = odm.SeenSpace(small_map, camera, odm.SeenSettings(policy=policy))
        space.update(emptied(camera, hand), Q, 0.0)
        assert state_at(space, spot) in (SHADOW, OCCUPIED)
        seen = space.update(emptied(camera), Q, 0.03)
        found.append((seen.trouble, state_at(space, spot)))
        again = space.update(emptied(camera, hand), Q, 0.06)
        assert again.trouble is None and state_at(space, spot) in (SHADOW, OCCUPIED)
    (trouble, before), (none, now) = found
    assert "clear_m" in trouble and before in (SHADOW, OCCUPIED)
    assert none is None and now == FREE
    assert seen.readings == dict(valid=0, own=0, flying=0, outside=0, clear=160 * 120)


def test_the_robot_goes_on_once_somebody_left_an_empty_room(small_map):
    """Else what was seen is kept by the policy, for ever."""
    status = []
    for clear_m in (None, 3.0):
        camera = camera_at([1.6, 0, 0.9], size=(320, 240), focal=180.0, clear_m=clear_m)
        space = odm.SeenSpace(small_map, camera, odm.SeenSettings(policy="keep"))
        planner = odm.ReactivePlanner(small_map)
        planner.set_goals([AWAY])
        far = [2.0, 0.9, 0.1, 2.0, 0.9, 0.2, 0.02]  # something that is always there
        for k in range(30):
            there = [*far, *POST[0]] if k < 3 else far
            seen = space.update(emptied(camera, there), HOME, 0.1 * k)
            radius = seen.covering_radius
            answer = planner.step(seen.points, q=HOME, covering_radius=radius)
        status.append(answer.status)
        assert planner.is_free(HOME, AWAY) or clear_m is None
    assert status[0] == "holding" and status[1] != "holding"


@pytest.mark.parametrize("seed", range(8))
def test_no_point_of_an_obstacle_is_free_by_clear_pixels(small_map, seed):
    """Some things stand beyond what the camera sees: to it nothing is there."""
    rng = np.random.default_rng(seed)
    most = rng.uniform(1.0, 1.8)
    cameras = [draw_camera(rng, clear_m=most) for _ in range(1 + seed % 2)]
    capsules = draw_capsules(rng, 6)
    space = odm.SeenSpace(small_map, cameras, STILL)
    space.update([emptied(c, capsules, most) for c in cameras], Q, 0.0)
    states = state_at(space, draw_inside(rng, capsules, 20000))
    assert not (states == FREE).any()
    assert space.counts()["free"] > 1000


@pytest.mark.parametrize("seed", some(range(2), 0))
def test_clear_pixels_free_what_their_slow_twin_frees(small_map, seed):
    rng = np.random.default_rng(60 + seed)
    camera = draw_camera(rng, size=(100, 75), focal=110.0, clear_m=1.9)
    image = emptied(camera, draw_capsules(rng))
    image[rng.random(image.shape) < 0.005] = 0
    space = odm.SeenSpace(small_map, camera, STILL)
    seen = space.update(image, Q, 0.0)
    assert seen.readings["clear"] == (image == CLEAR).sum() > 1000
    own = np.zeros(image.shape, bool)
    twin = naive.cell_states(camera, image, own, small_map.grid)
    cells = space.cells()
    twin[cells == BEYOND] = BEYOND
    room = space._buffers  # cells that became free since all their eighths are
    by_eighths = room.unpack(room.closed | room.blocked) | (room.eighths == 0)
    assert (twin[(cells == FREE) & ~by_eighths] == FREE).all()
    assert ((cells == FREE) & (twin == FREE)).sum() > 0.7 * (twin == FREE).sum() > 500


def test_nothing_is_clear_beyond_the_depth_that_was_told(small_map):
    camera = camera_at([1.1, 0.1, 0.5], clear_m=1.0)
    space = odm.SeenSpace(small_map, camera, STILL)
    space.update(np.full((120, 160), CLEAR, np.uint16), Q, 0.0)
    free = np.argwhere(space.cells() == FREE)
    assert len(free) > 500
    corners = small_map.grid.origin + small_map.grid.h * (free[:, None] + naive.CORNERS)
    T = np.linalg.inv(camera.T_base_camera)
    depth = corners @ T[2, :3] + T[2, 3]
    assert 0.9 < depth.max() < 1.0


@pytest.mark.parametrize("value", [0, CLEAR])
def test_without_a_reading_nothing_is_clear(small_map, value):
    """0 never says that nothing is there, whatever 65535 does."""
    rng = np.random.default_rng(6)
    camera = draw_camera(rng, clear_m=3.0 if value == 0 else None)
    image = emptied(camera, draw_capsules(rng))
    image[image == CLEAR] = value
    space = odm.SeenSpace(small_map, camera, STILL)
    seen = space.update(image, Q, 0.0)
    none = space.counts()["free"]
    image[(image == 0) | (image == CLEAR)] = 1  # something right at the lens
    space.update(image, Q, 0.0)
    assert seen.readings["clear"] == 0 and none <= space.counts()["free"]


def test_an_image_of_zeros_is_no_empty_room(small_map):
    camera = camera_at([1.3, 0, 0.5], clear_m=3.0)
    space = odm.SeenSpace(small_map, camera)
    seen = space.update(np.zeros((120, 160), np.uint16), Q, 0.0)
    assert "sees nothing" in seen.trouble and np.isnan(seen.points).all()


def test_single_wrong_clear_pixels_free_nothing(small_map):
    rng = np.random.default_rng(3)
    camera, capsules = draw_camera(rng, clear_m=5.0), draw_capsules(rng)
    image = picture(camera, capsules)
    lone = naive.lone_holes(np.where(rng.random(image.shape) < 0.05, 0, image))
    image[lone] = CLEAR
    space = odm.SeenSpace(small_map, camera, STILL)
    seen = space.update(image, Q, 0.0)
    assert seen.readings["clear"] == lone.sum() > 300
    states = state_at(space, draw_inside(rng, capsules, 20000))
    assert not (states == FREE).any()


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_clear_pixel_says_nothing_of_the_one_beside_it(small_map, axis, first):
    """Images are looked at by halves: of two pixels the nearer counts."""
    camera = camera_at([1.3, 0, 0.5], clear_m=3.0)
    image = np.full((120, 160), 200, np.uint16)  # 0.1 m from the lens
    np.moveaxis(image, axis, 0)[first::2] = CLEAR
    space = odm.SeenSpace(small_map, camera, STILL)
    space.update(image, Q, 0.0)
    assert space.counts()["free"] == 0


def test_a_lone_hole_among_clear_pixels_hides_nothing(small_map):
    camera = camera_at([1.3, 0, 0.5], clear_m=3.0)
    found = []
    for hole in (False, True):
        image = emptied(camera)
        if hole:
            image[20:100:3, 20:140:3] = 0
        space = odm.SeenSpace(small_map, camera, STILL)
        space.update(image, Q, 0.0)
        found.append(space.counts()["free"])
    assert found[0] == found[1] > 1000


def test_a_flying_pixel_may_lie_between_a_hand_and_nothing(small_map):
    """Where 65535 tells nothing it is no neighbour that a reading flies before."""
    image = np.full((120, 160), 2400, np.uint16)
    image[40:80, 60:90] = 1600
    image[40:80, 90] = 2000
    image[40:80, 91:] = CLEAR
    settings = odm.SeenSettings(memory_s=0.0, flying_m=0.05)
    flying = []
    for clear_m in (None, 3.0):
        camera = camera_at([1.3, 0, 0.5], clear_m=clear_m)
        space = odm.SeenSpace(small_map, camera, settings)
        flying.append(space.update(image, Q, 0.0).readings["flying"])
    assert flying == [0, 40]


def test_metres_that_are_infinite_are_clear_and_no_others():
    depth = np.full((120, 160), 0.7)
    depth[0, :8] = [np.inf, 99.0, 1.7e308, 32.7675, 32.7669, np.nan, -np.inf, 0.0]
    pixels = camera_at([1.3, 0, 0.5], clear_m=3.0).from_metres(depth)
    assert pixels[0, :8].tolist() == [CLEAR] * 4 + [65533, 0, 0, 0]
    assert (pixels[1:] == 1400).all()
    plain = camera_at([1.3, 0, 0.5]).from_metres(depth)
    assert plain[0, :8].tolist() == [0] * 4 + [65533, 0, 0, 0]
    mask = np.zeros(depth.shape, bool)
    mask[0, 0] = True
    masked = np.ma.masked_array(depth, mask)
    assert camera_at([1.3, 0, 0.5], clear_m=3.0).from_metres(masked)[0, 0] == 0


@each("value", [0.0, -1.0, np.nan, np.inf, 32.768, "far", [1.0], True])
def test_a_depth_that_is_none_to_be_clear_to_is_refused(value):
    with pytest.raises(
        BadInput, match="clear_m .* of camera .* up to 32.767 m"
    ) as told:
        camera_at([1.3, 0, 0.5], clear_m=value)
    assert str(value) in str(told.value) and "\n" not in str(told.value)
