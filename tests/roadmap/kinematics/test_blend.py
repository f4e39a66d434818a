"""How far blends stray is proved: for every robot, corner and place on them."""

import numpy as np
import pytest
from corners import ROBOTS, cancelling, draw_corner, draw_tricky, legs_at
from forms import size
from robot_asked import motion_bounds
from wrappers import with_wrapper

from roadmap.kinematics import _deviation as kernels
from roadmap.kinematics.forward import body_frames, sphere_centers
from roadmap.motion.blending import (
    BLEND_DEVIATION,
    blend_length,
    blend_path,
    joint_motion_bounds,
)

open_legs_deviation = with_wrapper(kernels.legs_deviation)
highest = with_wrapper(kernels.highest)


@pytest.fixture(params=ROBOTS)
def robot(request):
    """Return one robot after the other."""
    return request.getfixturevalue(request.param)


def beside(x, d):
    """How far a blend is from the corner path, in w - u."""
    y = np.minimum(x, 1.0 - x)
    return 2.0 * d * y**3 * (1.0 - 0.5 * y)


def farthest(robot, piece, *places):
    """Return how far centres at places x of a blend are off the corner path, at most.

    All of it but the kinematics is worked out for all places at once.
    """
    x = np.array(places)[:, None]
    q = np.array([piece.at(piece.begin + 2.0 * piece.d * y)[0] for y in places])
    along = 2.0 * piece.d * x - piece.d
    on = piece.corner() + along * np.where(along < 0.0, piece.u, piece.w)
    off = q - on - beside(x, piece.d) * (piece.w - piece.u)
    assert np.abs(off).max() < 1e-9  # it is off along w - u alone, by what is said
    here, there = (
        np.array([sphere_centers(robot, a) for a in rows]) for rows in (q, on)
    )
    return np.linalg.norm(here - there, axis=2).max()


@pytest.mark.parametrize("blend", [0.001, 0.01, 0.15])
@pytest.mark.parametrize("kind", ["sharp", "shallow", "tricky"])
def test_no_centre_strays_farther_than_is_said(robot, rng, blend, kind):
    for _ in range(60):
        if kind == "tricky":
            q, u, w = draw_tricky(robot, rng)
        else:
            q, u, w = draw_corner(robot, rng, kind == "sharp")
        size = rng.choice([0.02, 0.3, 3.0])
        pieces, stray = blend_path(robot, legs_at(q, u, w, size), blend)
        assert stray <= blend * (1.0 + 1e-12)
        blends = [p for p in pieces if p.d > 0.0]
        for piece in blends:
            assert farthest(robot, piece, *np.linspace(0.0, 1.0, 61)) <= stray + 1e-9
        assert blends or u @ w < -0.99 or np.array_equal(u, w)


def test_the_bound_is_near_the_truth(robot, rng):
    shares = []
    for _ in range(60):
        q, u, w = draw_corner(robot, rng, True)
        pieces, stray = blend_path(robot, legs_at(q, u, w), 0.004)
        blends = [p for p in pieces if p.d > 0.0]
        shares += [farthest(robot, p, 0.5) / stray for p in blends]
    assert np.median(shares) > 0.9


def test_a_blend_is_never_shorter_than_the_sum_over_joints_allows(robot, rng):
    gains = []
    for _ in range(200):
        q, u, w = draw_corner(robot, rng, True)
        far = BLEND_DEVIATION * float(joint_motion_bounds(robot) @ np.abs(w - u))
        d, stray = blend_length(robot, q, u, w, 5.0, 0.004)
        if far > 0.0:
            assert d >= 0.004 / far * (1 - 1e-12) and stray <= far * d * (1 + 1e-12)
            gains.append(d * far / 0.004)
    assert np.median(gains) > (2.0 if robot.dof > 3 else 1.1)


# --- the kernel's twin, in plain numpy -------------------------------------------


def velocities(robot, q, dq):
    """Return |J dq| of every centre, body by body up to the base."""
    poses = body_frames(robot, q)
    centers = sphere_centers(robot, q)
    result, body = np.zeros((len(centers), 3)), robot.sphere_body.copy()
    while (body > 0).any():
        for k in set(body[body > 0].tolist()):  # for all centres that it carries
            joint, kind = robot.tree_i[k, 1:]
            if kind:
                axis = poses[k, :3, :3] @ robot.tree_f[k, 12:15]
                rate = robot.tree_f[k, 15] * dq[joint]
                lever = centers[body == k] - poses[k, :3, 3]
                result[body == k] += rate * (
                    np.cross(axis, lever) if kind == 1 else axis
                )
        body = np.where(body > 0, robot.tree_i[body, 0], body)
    return np.linalg.norm(result, axis=1)


def mixed(robot, a, b):
    """Bound |p''[a, b]| of every centre: pairs of joints, none of them skipped."""
    tree = robot.tree_i
    rate_a, rate_b = (
        np.array(
            [
                abs(f[15] * d[j]) if k else 0
                for (_, j, k), f in zip(tree, robot.tree_f, strict=True)
            ]
        )
        for d in (a, b)
    )
    total = np.zeros(len(robot.spheres))
    for k in range(len(tree)):
        before, j = set(), tree[k, 0]
        while j > 0:
            before |= {j} if tree[j, 2] == 1 else set()
            j = tree[j, 0]
        pairs = sum(rate_a[j] * rate_b[k] + rate_b[j] * rate_a[k] for j in before)
        pairs += rate_a[k] * rate_b[k] if tree[k, 2] == 1 else 0.0
        total += pairs * robot.sphere_reach[:, k]
    return total


def bound_of(robot, q, u, w, d):
    """The bound of the docstring of `longest_blend`."""
    turn, e = w - u, BLEND_DEVIATION * d
    v = velocities(robot, q, turn)
    along = np.maximum(mixed(robot, u, turn), mixed(robot, w, turn))
    first = e * np.maximum(v, 0.375 * along * d)
    return (first + 0.5 * mixed(robot, turn, turn) * e * e).max()


def cover_of(robot):
    return kernels.CoverModel(
        robot.tree_i, robot.tree_f, robot.spheres, robot.sphere_body, robot.sphere_reach
    )


def longest(robot, q, u, w, room, most):
    return kernels.longest_blend(cover_of(robot), q, u, w, room, most)


def test_the_kernel_agrees_with_its_twin_and_leaves_nothing(robot, rng):
    for most in (0.002, 0.05):
        for _ in range(size(15, 40)):
            q, u, w = draw_corner(robot, rng, rng.random() < 0.5)
            room = float(rng.choice([0.01, 50.0]))
            d, stray = longest(robot, q, u, w, room, most)
            assert np.isclose(stray, bound_of(robot, q, u, w, d), rtol=1e-9)
            assert stray <= most
            longer = bound_of(robot, q, u, w, 1.001 * d)
            assert d == room or longer > most


def test_mixed_bends_of_one_direction_are_the_bends_of_a_motion(robot, rng):
    dq = rng.normal(size=robot.dof)
    assert np.allclose(mixed(robot, dq, dq), motion_bounds(robot, dq)[1])


def test_the_blend_is_off_most_in_the_corner_even_with_the_way_to_it():
    x = np.linspace(0.0, 1.0, 100001)
    weighed = beside(x, 1.0) * (1.0 + 8.0 / 3.0 * np.abs(1.0 - 2.0 * x))
    assert weighed.max() <= BLEND_DEVIATION + 1e-12
    assert np.isclose(weighed[50000], BLEND_DEVIATION)


# --- motions from beside a leg -----------------------------------------------


def legs_deviation(robot, q, leg, share, off):
    n, bodies = len(robot.spheres), len(robot.tree_i)
    frames, twist = np.empty((2, bodies, 12))
    work = kernels.DeviationWork(frames, twist, *np.empty((3, bodies)), np.empty(n))
    return open_legs_deviation(cover_of(robot), q, leg, share, off, work)


@pytest.mark.parametrize("size", [0.003, 0.05])
def test_motions_from_beside_a_leg_stay_as_near_as_is_said(robot, rng, size):
    shares = []
    for _ in range(60):
        q, leg, off = draw_corner(robot, rng, True)
        leg, off = rng.uniform(0.05, 2.0) * leg, size * off
        share = rng.random()
        said = legs_deviation(robot, q, leg, share, off)
        assert said <= np.abs(off) @ joint_motion_bounds(robot) + 1e-12
        far = 0.0
        for end in ((1.0 - share) * leg, -share * leg):
            for t in np.linspace(0.0, 1.0, 25):
                on = q + t * end
                moved = sphere_centers(robot, on + (1.0 - t) * off)
                moved = np.linalg.norm(moved - sphere_centers(robot, on), axis=1).max()
                far = max(far, moved)
        assert far <= said + 1e-9
        shares.append(far / said)
    assert np.median(shares) > 0.6


def test_joints_that_cancel_beside_a_leg_need_not_cancel_along_it(robot, rng):
    grown = 0
    for _ in range(40):
        q, leg, _ = draw_corner(robot, rng, True)
        off = 0.003 * cancelling(robot, q)
        said = legs_deviation(robot, q, 2.5 * leg, 0.0, off)
        far = []
        for t in np.linspace(0.0, 1.0, 25):
            on = q + 2.5 * t * leg
            moved = sphere_centers(robot, on + (1.0 - t) * off)
            moved = np.linalg.norm(moved - sphere_centers(robot, on), axis=1)
            far.append(moved.max())
        assert max(far) <= said + 1e-9
        grown += max(far) > 1.1 * far[0]
    assert grown > 3 or robot.dof < 7


def test_the_highest_place_of_the_bound_is_found(rng):
    t = np.linspace(0.0, 1.0, 20001)
    for begin, slope, most in rng.uniform(0.0, 3.0, (300, 3)):
        seen = ((1.0 - t) * np.minimum(most, begin + t * slope)).max()
        assert np.isclose(highest(begin, slope, most), seen, atol=1e-3)
        assert highest(begin, slope, most) >= seen - 1e-12
