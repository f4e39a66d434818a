"""The side that a film is seen from."""

import numpy as np

from sim.draw.viewpoint import Camera, _between, above_words, clearest, framed

CAMERA = Camera(eye=(0.0, -2.0, 1.0), target=(0.0, 0.0, 0.5))


def ball(x, y, z=0.5, r=0.1):
    return np.array([[x, y, z, r]])


def wall(y):
    """Return balls that stand side by side in a plane across the view."""
    x, z = np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(0.1, 1.0, 9))
    return np.column_stack([x.ravel(), np.full(81, y), z.ravel(), np.full(81, 0.1)])


def test_nothing_in_the_way_leaves_the_camera_where_it_was_put():
    assert clearest(CAMERA, []) == CAMERA
    assert clearest(CAMERA, [(ball(0, 0), np.zeros((0, 4)))]) == CAMERA
    apart = clearest(CAMERA, [(ball(-0.3, 0), ball(0.3, 0))])
    np.testing.assert_allclose(apart.eye, CAMERA.eye)


def test_a_back_that_hides_the_robot_is_gone_round():
    found = clearest(CAMERA, [(ball(0.0, 0.3), wall(-0.3))])
    sight = np.array(found.eye) - [0.0, 0.3, 0.5]
    toward = np.array(found.eye) - CAMERA.target
    assert abs(np.linalg.norm(toward) - np.linalg.norm([0, 2.0, 0.5])) < 1e-9
    # the line of sight to the robot misses the wall
    t = (-0.3 - 0.3) / sight[1]
    crossing = np.array([0.0, 0.3, 0.5]) + t * sight
    assert not 0 < t < 1 or abs(crossing[0]) > 0.5


def test_the_one_that_is_seen_worse_counts():
    hidden = [(wall(-0.3), ball(0.0, 0.3))]
    assert clearest(CAMERA, hidden).eye != CAMERA.eye


def test_a_body_too_large_for_the_picture_is_seen_from_farther_away():
    small = np.vstack([ball(0, 0, z) for z in (0.3, 0.5, 0.7)])
    assert framed(CAMERA, small) is CAMERA and framed(CAMERA, small[:0]) is CAMERA
    large = np.vstack([ball(x, 0, z) for x in (-1.0, 1.0) for z in (0.0, 1.6)])
    found = framed(CAMERA, large)
    pixels, distance = found.project(large[:, :3])
    assert (pixels > 0).all() and (pixels < [found.width, found.height]).all()
    assert (distance < found.far).all()
    away = np.subtract(found.eye, found.target)
    assert np.linalg.norm(away) > np.linalg.norm([0.0, 2.0, 0.5])
    assert abs(np.cross(away, np.subtract(CAMERA.eye, CAMERA.target))).max() < 1e-9


def test_words_at_the_bottom_hide_nobody_below_the_robot():
    robot, person = ball(0, 0, 0.5), ball(0.2, 0.1, -0.4)
    assert above_words(CAMERA, robot, 0.1) is CAMERA
    found = above_words(CAMERA, person, 0.1)
    pixels = found.project(np.vstack([robot, person])[:, :3])[0]
    assert (pixels > 0).all() and (pixels < [found.width, 0.9 * found.height]).all()


def test_a_tool_that_is_out_of_the_picture_moves_the_camera_though_the_body_fits():
    body = np.vstack([ball(x, 0) for x in np.linspace(-0.3, 0.3, 30)])
    tool = ball(0.0, 0.0, 2.0)
    assert framed(CAMERA, np.vstack([body, tool])) is CAMERA
    found = framed(CAMERA, np.vstack([body, tool]), tool=tool)
    pixels, _ = found.project(tool[:, :3])
    assert (pixels > 0).all() and (pixels < [found.width, found.height]).all()
    assert framed(CAMERA, body, tool=body[:0]) is CAMERA


def test_what_is_out_of_the_cone_hides_nothing():
    """The answer is that of all balls, and of a floor few are asked."""
    rng, eye = np.random.default_rng(5), np.array([2.0, 1.0, 1.5])
    for grain in (0.02, 0.4):
        rays = rng.normal(0.0, 0.5, (60, 3)) - eye
        others = np.c_[rng.normal(0.0, 3.0, (800, 3)), rng.uniform(0.01, grain, 800)]
        far = np.linalg.norm(rays, axis=1)
        along = rays / far[:, None]
        to = others[:, :3] - eye
        depth = along @ to.T
        off = np.linalg.norm(to - depth[..., None] * along[:, None], axis=2)
        hides = (off < others[:, 3]) & (depth > 0) & (depth < far[:, None])
        kept = _between(eye, rays, others)
        assert {tuple(b) for b in others[hides.any(axis=0)]} <= set(map(tuple, kept))
        assert len(kept) < len(others)
