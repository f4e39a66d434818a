"""Cells that are not seen keep their content, growing, until the policy takes over."""

import naive_camera as naive
import numpy as np
import pytest
from seen_scenes import camera_at, draw_camera, draw_capsules, picture

import odm
from odm.cameras import _remember as remember
from odm.cameras.space import CELL_NAMES
from roadmap.kinematics.forward import tool_pose

UNSEEN, FREE, SHADOW, OCCUPIED, REMEMBERED, UNKNOWN, BEYOND = range(7)
HAND = np.array([[0.25, 0.0, 0.5, 0.25, 0.1, 0.5, 0.05]])
Q = np.zeros(3)


@pytest.fixture
def camera():
    return camera_at([1.3, 0, 0.5])


def hidden(image, rows=slice(20, 100), columns=slice(40, 120)):
    """Return the image without readings in a part of it."""
    image = image.copy()
    image[rows, columns] = 0
    return image


def state_of(space, p):
    cell = space.cell_map.grid.locate(np.array(p)[None])[0]
    return CELL_NAMES[space.cells()[tuple(cell)]]


def after(small_map, camera, age, **settings):
    """Return a space that saw a hand, and then nothing there `age` later."""
    space = odm.SeenSpace(small_map, camera, odm.SeenSettings(**settings))
    space.update(picture(camera, HAND), Q, 5.0)
    space.update(hidden(picture(camera, HAND)), Q, 5.0 + age)
    return space


HAND_AT, FREE_AT = [0.29, 0.05, 0.5], [0.6, 0.0, 0.5]


@pytest.mark.parametrize(
    "policy, hand, free",
    [
        ("free", "unseen", "unseen"),
        ("occupied", "unknown", "unknown"),
        ("keep", "remembered", "unseen"),
    ],
)
def test_memory_expires_as_the_policy_says(small_map, camera, policy, hand, free):
    options = {"memory_s": 0.2, "speed": 0.0, "policy": policy}
    young = after(small_map, camera, 0.19, **options)
    assert (state_of(young, HAND_AT), state_of(young, FREE_AT)) == (
        "remembered", "unseen",
    )  # fmt: skip
    old = after(small_map, camera, 0.21, **options)
    assert (state_of(old, HAND_AT), state_of(old, FREE_AT)) == (hand, free)


def test_what_was_never_seen_is_the_policys(small_map, camera):
    for policy, name in (("free", "unseen"), ("occupied", "unknown")):
        space = odm.SeenSpace(small_map, camera, odm.SeenSettings(policy=policy))
        space.update(picture(camera), Q, 0.0)
        assert state_of(space, [0.55, 0.56, 0.3]) == name  # out of view


def test_unknown_cells_block_motions_but_not_the_place_the_robot_is_at(small_map):
    camera, q = camera_at([1.3, 0, 0.5]), np.array([0.0, 0.3, 0.0])
    settings = odm.SeenSettings(policy="occupied", d_self=0.01)
    space = odm.SeenSpace(small_map, camera, settings)
    seen = space.update(picture(camera, [], small_map.robot, q), q, 0.0)
    planner = odm.ReactivePlanner(small_map)
    planner.step(seen.points, q=q, covering_radius=seen.covering_radius)
    assert planner.is_free(q, q)
    behind = np.array([-1.2, 0.3, 0.0])  # never seen: the robot hides it
    assert planner.is_free(q, behind).failed == "frame"


def test_a_remembered_cell_blocks_the_planner_and_an_expired_one_does_not(
    small_map, camera
):
    near = np.array(HAND_AT)
    for age, blocked in ((0.1, True), (0.3, False)):
        space = after(small_map, camera, age, memory_s=0.2, speed=0.0)
        seen = space.update(hidden(picture(camera, HAND)), Q, 5.0 + age)
        gap = np.linalg.norm(seen.points - near, axis=1).min(initial=np.inf)
        # inner cells are given by their centres alone
        assert bool(gap <= 2.0 * seen.covering_radius) == blocked


def test_what_is_remembered_grows_with_its_age(small_map, camera):
    h, speed = small_map.grid.h, 1.6
    for age in (0.0, 0.02, 0.05, 0.11):
        space = after(small_map, camera, age, memory_s=0.3, speed=speed)
        cells = space.cells()
        first = odm.SeenSpace(small_map, camera)
        first.update(picture(camera, HAND), Q, 0.0)
        before = first.cells()
        unseen = np.isin(cells, (UNSEEN, REMEMBERED))
        source = unseen & np.isin(before, (SHADOW, OCCUPIED))
        steps = int(np.ceil(speed * age / h - 1e-9))
        expected = naive.grown(source, steps) & unseen
        assert expected.any()
        assert ((cells == REMEMBERED) == expected).all()


@pytest.mark.parametrize("policy", ["free", "keep", "occupied"])
def test_many_frames_are_remembered_as_by_the_slow_twin(small_map, policy):
    rng = np.random.default_rng(7)
    camera = draw_camera(rng)
    memory_s, speed, h = 0.25, 0.9, small_map.grid.h
    settings = odm.SeenSettings(memory_s=memory_s, speed=speed, policy=policy)
    space = odm.SeenSpace(small_map, camera, settings)
    alone = odm.SeenSpace(small_map, camera, odm.SeenSettings(memory_s=0.0))
    shape = tuple(4 * small_map.grid.blocks)
    content, since = np.zeros(shape, int), np.zeros(shape)
    before, then, now = np.zeros(shape, int), 0.0, 0.0
    capsules = draw_capsules(rng)
    for _ in range(25):
        now += rng.uniform(0.0, 0.08)
        capsules[:, :6] += np.tile(rng.normal(scale=0.03, size=(4, 3)), 2)
        corner = rng.integers(0, 100, 2)
        size = rng.integers(10, 100, 2)
        image = hidden(
            picture(camera, capsules),
            slice(corner[0], corner[0] + size[0]),
            slice(corner[1], corner[1] + size[1]),
        )
        space.update(image, Q, now)
        alone.reset()
        alone.update(image, Q, 0.0)
        state = alone.cells().astype(int)
        lost = (state == UNSEEN) & (before != UNSEEN)
        content[lost] = np.where(before[lost] == FREE, 1, 2)
        since[lost] = then
        content[state != UNSEEN] = 0
        age = now - since
        fresh = age <= memory_s
        live = (content == 2) & (fresh | (policy == "keep"))
        expected = np.zeros(shape, bool)
        steps = np.ceil(speed * np.minimum(age, memory_s) / h - 1e-9).astype(int)
        for k in np.unique(steps[live]):
            expected |= naive.grown(live & (steps == k), k)
        expected &= state == UNSEEN
        if policy == "free":
            content[(content == 2) & ~fresh] = 0
        cells = space.cells()
        shown = (cells == REMEMBERED) | (cells == UNKNOWN)
        if policy != "occupied":
            assert (shown == expected).all()
        else:
            unknown = (state == UNSEEN) & ((content == 0) | ~fresh)
            assert (shown | ~expected).all()
            # but for the cells round the robot itself
            assert ((expected | unknown) | ~shown).all()
            assert shown.sum() > 0.9 * (expected | unknown).sum()
        before, then = state, now


def test_what_is_remembered_grows_from_one_word_of_cells_into_the_next():
    shape, most, rng = np.array([7, 6, 72]), 3, np.random.default_rng(2)
    for z in ([63], [64], [62, 65], [0, 71]):
        steps = rng.integers(0, most + 1, len(z))
        steps[0] = 2
        at = np.column_stack([rng.integers(0, shape[:2], (len(z), 2)), z])
        order = np.argsort(-steps)
        ptr = np.searchsorted(-steps[order], np.arange(-most - 1, 1), side="right")
        cells = np.ravel_multi_index(at[order].T, shape)
        bits, spare = np.zeros((2, shape[0], 2 * shape[1]), np.uint64)
        remember.grow_sources(cells, ptr, shape, bits, spare)
        expected = np.zeros(shape, bool)
        for cell, k in zip(at, steps, strict=True):
            one = np.zeros(shape, bool)
            one[tuple(cell)] = True
            expected |= naive.grown(one, k)
        found = np.unpackbits(bits.view(np.uint8), axis=1, bitorder="little")
        found = found.reshape(shape[0], shape[1], 128)[:, :, : shape[2]]
        assert (found == expected).all()


def test_behind_the_robot_the_last_content_is_kept(small_map):
    camera = camera_at([1.3, 0, 0.5])
    robot = small_map.robot
    hand = np.array([[-0.15, 0.0, 0.6, -0.15, 0.0, 0.6, 0.04]])
    away, before_it = np.array([1.4, 0.5, 0.0]), np.array([0.0, 0.0, 0.0])
    settings = odm.SeenSettings(memory_s=1.0, speed=0.0, d_self=0.01)
    space = odm.SeenSpace(small_map, camera, settings)
    spot = [-0.115, 0.0, 0.6]
    space.update(picture(camera, hand, robot, away), away, 0.0)
    assert state_of(space, spot) == "occupied"
    seen = space.update(picture(camera, hand, robot, before_it), before_it, 0.1)
    assert seen.removed and state_of(space, spot) == "remembered"
    space.update(picture(camera, None or [], robot, away), away, 0.2)
    assert state_of(space, spot) == "free"
    # the robot comes back before what was seen free: that is kept, too
    space.update(picture(camera, [], robot, before_it), before_it, 0.3)
    assert state_of(space, spot) == "unseen"


def test_a_clock_that_goes_back_holds_one_frame_and_forgets_nothing(small_map, camera):
    space = after(small_map, camera, 0.1, memory_s=0.2, speed=0.0)
    image = hidden(picture(camera, HAND))
    seen = space.update(image, Q, 4.0)
    assert np.isnan(seen.points).all() and "before the last" in seen.trouble
    assert seen.stamp == 5.1
    assert space.update(image, Q, 4.05).trouble is None
    assert state_of(space, HAND_AT) == "remembered"  # 0.15 s old by now
    space.update(image, Q, 4.15)
    assert state_of(space, HAND_AT) == "unseen"  # 0.25 s old


def test_images_that_come_late_age_nothing(small_map, camera):
    space = after(small_map, camera, 0.1, memory_s=0.2, speed=0.0)
    image = hidden(picture(camera, HAND))
    for late in (4.0, 3.9):
        assert "before the last" in space.update(image, Q, late).trouble
    assert space.update(image, Q, 5.15).trouble is None
    assert state_of(space, HAND_AT) == "remembered"  # 0.15 s old by now
    space.update(image, Q, 5.25)
    assert state_of(space, HAND_AT) == "unseen"


def test_several_images_that_come_late_in_order_age_nothing(small_map, camera):
    space = after(small_map, camera, 0.05, memory_s=0.2, speed=0.0)
    image = hidden(picture(camera, HAND))
    for late in (4.9, 4.96, 5.02):  # two of them are in order again
        assert "before the last" in space.update(image, Q, late).trouble
    assert space.update(image, Q, 5.15).trouble is None
    assert state_of(space, HAND_AT) == "remembered"  # 0.15 s old by now
    space.update(image, Q, 5.25)
    assert state_of(space, HAND_AT) == "unseen"


@pytest.mark.parametrize("memory_s", [0.0, 0.3])
def test_an_older_image_frees_nothing_that_a_newer_one_saw(small_map, camera, memory_s):
    """Of several late ones in order the second was taken for what is there now."""
    space = odm.SeenSpace(small_map, camera, odm.SeenSettings(memory_s=memory_s))
    space.update(picture(camera, HAND), Q, 5.05)
    for late in (4.9, 4.96, 5.02):
        seen = space.update(picture(camera), Q, late)  # before the hand came
        assert "before the last" in seen.trouble and np.isnan(seen.points).all()
        assert seen.stamp == 5.05 and state_of(space, HAND_AT) == "occupied"
    assert space.update(picture(camera), Q, 5.1).trouble is None
    assert state_of(space, HAND_AT) == "free"


def test_time_that_passes_in_unfit_frames_counts(small_map, camera):
    space = after(small_map, camera, 0.05, memory_s=0.2, speed=0.0)
    blind = np.zeros((camera.height, camera.width), np.uint16)
    assert space.update(blind, Q, 5.2).trouble is not None
    space.update(hidden(picture(camera, HAND)), Q, 5.25)
    assert state_of(space, HAND_AT) == "unseen"


def test_the_same_images_give_the_same_points(small_map, camera):
    found = []
    for _ in range(2):
        space = after(small_map, camera, 0.1)
        found.append(space.update(picture(camera, HAND), Q, 5.2).points.copy())
    assert found[0].tobytes() == found[1].tobytes()


def test_what_is_carried_without_a_layer_is_looked_out_for(small_map, camera):
    """Cells that the bare robot cannot come near count once something reaches there."""
    grid, robot = small_map.grid, small_map.robot
    settings = odm.SeenSettings(policy="occupied", memory_s=0.0)
    space = odm.SeenSpace(small_map, camera, settings)
    nothing, held = np.zeros_like(picture(camera, [])), np.array([[0, 0, 0.6, 0.1]])
    nothing[:2, :2] = 5000
    bare = space.update(nothing, Q, 0.0)
    out = space.cells() == BEYOND
    ends = np.array(np.meshgrid(*np.linspace(robot.lower, robot.upper, 12).T))
    places = [tool_pose(robot, q)[:3] @ [0, 0, 0.6, 1.0] for q in ends.reshape(3, -1).T]
    cells = grid.locate(np.array(places))
    x, y, z = cells[(cells >= 0).all(axis=1)].T
    assert out[x, y, z].sum() > 10
    seen = space.update(nothing, Q, 0.1, payload=held)
    assert not (space.cells() == BEYOND)[x, y, z].any()
    assert len(seen.points) > len(bare.points)
    assert len(space.update(nothing, Q, 0.2).points) == len(seen.points)  # let go of
    again = odm.SeenSpace(small_map, camera, settings)
    again.update(nothing, Q, 0.0, payload=held)
    assert (again.cells() == space.cells()).all()
