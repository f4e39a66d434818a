"""Bad cameras and images: one sentence each; bad values hold, wrong types raise."""

import numpy as np
import pytest
from rows import each
from seen_scenes import camera_at, picture
from small import AWAY, HOME

import odm
from odm.cameras import look_at
from roadmap.errors import BadInput

Q = np.zeros(3)


@pytest.fixture
def camera():
    return camera_at([1.3, 0, 0.5])


@pytest.fixture
def space(small_map, camera):
    return odm.SeenSpace(small_map, camera, odm.SeenSettings(d_self=0.005))


def refused(match, function, *args, **options):
    with pytest.raises(BadInput, match=match) as caught:
        function(*args, **options)
    text = str(caught.value)
    assert "\n" not in text and len(text) < 240


def test_an_image_of_another_size_is_refused_with_both_sizes(space):
    refused("is 80 x 60, but .* 160 x 120", space.update, np.ones((60, 80), np.uint16),
            Q, 0.0)  # fmt: skip


@pytest.mark.parametrize("image", [np.ones((120, 160)), [[1, 2]], None, "a.png"])
def test_an_image_of_another_type_is_refused(space, image):
    refused("give uint16", space.update, [image], Q, 0.0)
    refused("give uint16|images were given", space.update, image, Q, 0.0)


def test_cells_beyond_the_largest_reading_are_not_all_in_shadow(small_map):
    near = camera_at([1.3, 0, 0.5], scale=0.00001)  # pixels end at 0.65 m
    space = odm.SeenSpace(small_map, near, odm.SeenSettings(memory_s=0.0))
    image = np.zeros((120, 160), np.uint16)
    image[:20, :20] = 60000
    space.update(image, Q, 0.0)
    counts = space.counts()
    assert 0 < counts["shadow"] < 0.2 * counts["unseen"]


def test_focal_lengths_that_are_no_pixels_are_refused():
    for focal in (1.0, 0.74, 1e-300):  # in image widths, say
        refused("fx .* above 2 pixels", camera_at, [1.3, 0, 0.5], focal=focal)


def test_what_is_masked_is_no_reading(space, camera):
    mask = np.zeros((120, 160), bool)
    mask[:60] = True
    depth = np.ma.masked_array(np.ones((120, 160)), mask)
    pixels = camera.from_metres(depth)
    assert (pixels[mask] == 0).all() and (pixels[~mask] > 0).all()
    image = np.ma.masked_array(np.full((120, 160), 2000, np.uint16), mask)
    assert space.update(image, Q, 0.0).readings["valid"] == 60 * 160


def test_depths_and_places_beyond_all_numbers_tell_nothing(camera):
    with np.errstate(all="raise"):
        assert (camera.from_metres(np.full((120, 160), 1.7e308)) == 0).all()
        refused("eye is", look_at, [0, 0, 1e300], [0, 0, 0])
        T = np.array(camera.T_base_camera)
        T[0, 3] = 1e300
        refused("the place of camera", camera.moved, T)


def test_the_number_of_images_counts(space, camera):
    image = picture(camera)
    refused("2 images .* 1 cameras", space.update, [image, image], Q, 0.0)


def test_a_wrong_configuration_raises_and_a_bad_one_holds(space, camera):
    refused("q has shape", space.update, picture(camera), np.zeros(4), 0.0)
    assert "NaN" in space.update(picture(camera), np.full(3, np.nan), 0.0).trouble


def test_an_image_without_readings_holds_the_robot(small_map, space):
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    for value in (0, 65535):
        blind = np.full((120, 160), value, np.uint16)
        seen = space.update(blind, HOME, 0.0)
        assert "sees nothing" in seen.trouble and seen.stamp is None
        answer = planner.step(seen.points, q=HOME, covering_radius=seen.covering_radius)
        assert answer.status == "holding"


def test_a_stamp_that_is_no_time_holds(space, camera):
    assert "nan" in space.update(picture(camera), Q, np.nan).trouble
    assert space.update(picture(camera), Q, 1.0).trouble is None


@pytest.mark.parametrize(
    "spoil",
    [
        lambda T: T[:3],
        lambda T: T * 2.0,
        lambda T: T @ np.diag([1.0, 1.0, -1.0, 1.0]),
        lambda T: np.where(T == 1.0, np.nan, T),
    ],
)
def test_a_pose_that_is_not_rigid_is_refused(camera, spoil):
    bad = spoil(np.array(camera.T_base_camera))
    refused("T_base_camera of camera", camera.moved, bad)


@each(
    "name, value",
    [("width", 0), ("height", 2.5), ("fx", 0.0), ("fy", -3.0), ("scale", np.nan),
     ("cx", np.inf), ("cx", 20000.0), ("cy", np.nan), ("cy", -17000.0),
     ("width", np.nan), ("cx", None), ("fx", "wide")],
)  # fmt: skip
def test_bad_intrinsics_are_named(camera, name, value):
    from dataclasses import replace

    refused(f"{name} .*{value}", replace, camera, **{name: value})


def test_a_camera_inside_the_base_is_refused(small_map):
    pose = look_at([0.0, 0.0, 0.05], [1.0, 0.0, 0.05])
    refused("is inside base", odm.SeenSpace, small_map,
            camera_at([1.0, 0, 0.5]).moved(pose))  # fmt: skip


def test_a_camera_inside_a_moving_link_holds(small_map, camera):
    space = odm.SeenSpace(small_map, camera.moved(look_at([0, 0, 0.3], [1, 0, 0.3])))
    seen = space.update(picture(camera), Q, 0.0)
    assert "inside upper" in seen.trouble and np.isnan(seen.points).all()


def test_a_camera_that_sees_no_cell_is_refused(small_map, camera):
    pose = look_at([2.0, 0, 0.5], [4.0, 0, 0.5])
    refused("no cell of the map is in view", odm.SeenSpace, small_map,
            camera.moved(pose))  # fmt: skip


def test_pixels_too_wide_for_the_map_are_refused(small_map):
    camera = camera_at([1.3, 0, 0.5], size=(32, 24), focal=24.0)
    refused("too wide", odm.SeenSpace, small_map, camera)


def test_cells_too_large_for_rho_are_refused(small_map, camera):
    from dataclasses import replace

    recipe = small_map.recipe
    coarse = replace(recipe, safety=replace(recipe.safety, rho=0.02))
    refused("more than rho", odm.SeenSpace, replace(small_map, recipe=coarse), camera)


def test_no_camera_is_refused(small_map):
    refused("no camera", odm.SeenSpace, small_map, [])


@each(
    "options",
    [{"d_self": 0.02}, {"d_self": -1.0}, {"memory_s": -0.1}, {"speed": np.nan},
     {"policy": "hope"}, {"policy": ["free"]}, {"flying_m": 0.0}, {"noise_m": 1.0}],
)  # fmt: skip
def test_settings_out_of_range_are_named(options):
    (name,) = options
    refused(name, odm.SeenSettings, **options)


@pytest.mark.parametrize(
    "payload",
    [np.zeros(4), np.full((1, 4), np.nan), "x", [[1.0], [1.0, 2.0]], np.zeros((64, 4)),
     [[0.0, 0.0, 0.1, -1.0]], [[0.0, 0.0, 1e300, 0.1]]],
)  # fmt: skip
def test_a_bad_payload_is_refused(space, camera, payload):
    refused("payload", space.update, picture(camera), Q, 0.0, payload)


def test_too_many_balls_of_a_payload_are_refused(space, camera):
    refused("at most 64", space.update, picture(camera), Q, 0.0, np.ones((65, 4)))


def test_a_refused_frame_changes_nothing(space, camera):
    image = picture(camera)
    space.update(image, Q, 0.0)
    before = space.cells()
    for bad in (np.zeros_like(image), image[:, :80]):
        try:
            space.update(bad, Q, 0.1)
        except BadInput:
            pass
        assert (space.cells() == before).all() and space.stamp == 0.0


def test_depths_in_metres_never_move_away(camera):
    depth = np.full((120, 160), 0.7)
    depth[0, :5] = [np.nan, np.inf, -1.0, 0.0, 99.0]
    pixels = camera.from_metres(depth)
    assert pixels[0, :5].tolist() == [0] * 5
    assert pixels[1, 0] * camera.scale == pytest.approx(0.7)
    odd = np.random.default_rng(0).uniform(0.1, 3.0, (120, 160))
    assert (camera.from_metres(odd) * camera.scale <= odd + 1e-6).all()


def test_a_read_only_image_compiles_nothing_new(space, camera):
    from odm.cameras import _depth as depth

    image = picture(camera)
    space.update(image, Q, 0.0)
    known = len(depth.read_image.signatures)
    image.flags.writeable = False
    space.update(image, Q, 0.1)
    space.update(np.asfortranarray(image), Q, 0.2)
    assert len(depth.read_image.signatures) == known


def test_a_camera_cannot_look_along_up():
    refused("cannot look", look_at, [0, 0, 1], [0, 0, 2])


@pytest.mark.parametrize("eye", [[0.0, 1.0], None, "above"])
def test_a_camera_stands_at_three_numbers(eye):
    refused("eye is .*; give three numbers", look_at, eye, [0, 0, 2])


def test_what_is_no_camera_is_refused(small_map):
    told = "a camera is 'cam' .str.; give DepthCamera"
    refused(told, odm.SeenSpace, small_map, ["cam"])


@pytest.mark.parametrize(
    ("scale", "words"), [(1.0, "1 m per unit: the middle one"), (1e-6, "the farthest")]
)
def test_a_wrong_scale_is_trouble_that_names_it(small_map, camera, scale, words):
    wrong = camera_at([1.3, 0, 0.5], scale=scale)
    space = odm.SeenSpace(small_map, wrong)
    image = picture(camera)
    image[image == 0] = 1200
    seen = space.update(image, Q, 0.0)
    assert words in seen.trouble and np.isnan(seen.points).all()
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    radius = seen.covering_radius
    answer = planner.step(seen.points, q=HOME, covering_radius=radius)
    assert answer.status == "holding"


@pytest.mark.parametrize("away", [1.0, 4.0, 15.0])
def test_a_camera_that_sees_far_walls_alone_is_no_trouble(small_map, away):
    camera = camera_at([1.3, 0, 0.5])
    space = odm.SeenSpace(small_map, camera)
    image = np.full((camera.height, camera.width), round(2000 * away), np.uint16)
    assert space.update(image, Q, 0.0).trouble is None


def test_metres_taken_for_millimetres_hold_without_a_seen_space(small_map, camera):
    wrong = camera_at([1.3, 0, 0.5], scale=1.0)
    planner = odm.ReactivePlanner(small_map)
    planner.set_goals([AWAY])
    image = np.full((camera.height, camera.width), 1200, np.uint16)
    answer = planner.step(wrong.points(image), q=HOME, covering_radius=0.03)
    assert answer.status == "holding" and "millimetres" in answer.reason
