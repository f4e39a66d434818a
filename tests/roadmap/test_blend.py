"""How far blends stray is proved: for every robot, corner and place on them."""

from dataclasses import replace

import numpy as np
import pytest

import roadmap
from roadmap._kernels import stray as kernels
from roadmap.blend import STRAY, blend_length, joint_sway, lay_way
from roadmap.kinematics import body_frames, motion_bounds, sphere_centers

ROBOTS = ("panda", "gantry", "crane")


@pytest.fixture
def crane(urdf, link, joint):
    """Return a robot whose slides come before, between and behind turning joints."""
    slow = '<limit lower="-3" upper="3" velocity="0.7" effort="1"/>'
    rail = '<limit lower="0" upper="1.2" velocity="0.5" effort="1"/>'
    rod = '<limit lower="-0.1" upper="0.5" velocity="0.3" effort="1"/>'
    box = '<box size="0.6 0.08 0.08"/>'
    body = link("base", '<box size="0.2 0.2 0.2"/>') + link("cart", box)
    body += link("boom", box, "0.3 0 0") + link("mast", box, "0 0.2 0")
    body += link("rod", '<cylinder radius="0.04" length="0.5"/>', "0 0 -0.25")
    body += link("hook", '<sphere radius="0.07"/>', "0.1 0 0") + link("tool")
    body += joint("rail", "prismatic", "base", "cart", "0 0 0.5", "0 1 0", rail)
    body += joint("slew", "continuous", "cart", "boom", "0 0 0.1")
    body += joint("luff", "revolute", "boom", "mast", "0.6 0 0", "0 0.6 0.8", slow)
    body += joint("lift", "prismatic", "mast", "rod", "0 0.4 0", "0 0 1", rod)
    body += joint("spin", "continuous", "rod", "hook", "0 0 -0.5", "0.6 0 0.8")
    body += joint("mount", "fixed", "hook", "tool", "0.2 0 0")
    return roadmap.load_robot(urdf(body, "crane.urdf"), cover_excess=0.05)


@pytest.fixture(params=ROBOTS)
def robot(request):
    """Return one robot after the other."""
    return request.getfixturevalue(request.param)


def draw_corner(robot, rng, sharp):
    """Return a corner and unit directions before and behind it."""
    q = robot.lower + rng.random(robot.dof) * (robot.upper - robot.lower)
    u = rng.normal(size=robot.dof)
    w = rng.normal(size=robot.dof) if sharp else u + 0.1 * rng.normal(size=robot.dof)
    if rng.random() < 0.3:  # some joints stand still
        u[rng.integers(robot.dof)] = w[rng.integers(robot.dof)] = 0.0
    return q, u / np.linalg.norm(u), w / np.linalg.norm(w)


def legs_at(q, u, w, size=3.0):
    return np.array([q - size * u, q, q + size * w])


def beside(x, d):
    """How far a blend is from the corner path, in w - u."""
    y = np.minimum(x, 1.0 - x)
    return 2.0 * d * y**3 * (1.0 - 0.5 * y)


def farthest(robot, piece, x):
    """Return how far the centres at a place x of a blend are off the corner path."""
    s = piece.begin + 2.0 * piece.d * x
    q = piece.at(s)[0]
    along = 2.0 * piece.d * x - piece.d
    on = piece.corner() + along * (piece.u if along < 0.0 else piece.w)
    off = q - on - beside(x, piece.d) * (piece.w - piece.u)
    assert np.abs(off).max() < 1e-9  # it is off along w - u alone, by what is said
    moved = sphere_centers(robot, q) - sphere_centers(robot, on)
    return np.linalg.norm(moved, axis=1).max()


@pytest.mark.parametrize("blend", [0.001, 0.01, 0.15])
@pytest.mark.parametrize("sharp", [True, False])
def test_no_centre_strays_farther_than_is_said(robot, rng, blend, sharp):
    for _ in range(60):
        q, u, w = draw_corner(robot, rng, sharp)
        size = rng.choice([0.02, 0.3, 3.0])
        pieces, stray = lay_way(robot, legs_at(q, u, w, size), blend)
        assert stray <= blend * (1.0 + 1e-12)
        blends = [p for p in pieces if p.d > 0.0]
        for piece in blends:
            xs = np.linspace(0.0, 1.0, 61)
            far = max(farthest(robot, piece, x) for x in xs)
            assert far <= stray + 1e-9
        assert blends or u @ w < -0.99 or np.array_equal(u, w)


def test_the_bound_is_near_the_truth(robot, rng):
    shares = []
    for _ in range(60):
        q, u, w = draw_corner(robot, rng, True)
        pieces, stray = lay_way(robot, legs_at(q, u, w), 0.004)
        blends = [p for p in pieces if p.d > 0.0]
        shares += [farthest(robot, p, 0.5) / stray for p in blends]
    assert np.median(shares) > 0.9


def test_a_blend_is_never_shorter_than_the_sum_over_joints_allows(robot, rng):
    gains = []
    for _ in range(200):
        q, u, w = draw_corner(robot, rng, True)
        far = STRAY * float(joint_sway(robot) @ np.abs(w - u))
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
    result = np.zeros((len(centers), 3))
    for i, body in enumerate(robot.sphere_body):
        while body > 0:
            parent, joint, kind = robot.tree_i[body]
            if kind:
                axis = poses[body, :3, :3] @ robot.tree_f[body, 12:15]
                rate = robot.tree_f[body, 15] * dq[joint]
                lever = centers[i] - poses[body, :3, 3]
                result[i] += rate * (np.cross(axis, lever) if kind == 1 else axis)
            body = parent
    return np.linalg.norm(result, axis=1)


def mixed(robot, a, b):
    """Bound |p''[a, b]| of every centre: pairs of joints, none of them skipped."""
    tree = robot.tree_i
    rate_a, rate_b = (
        np.array(
            [abs(f[15] * d[j]) if k else 0 for (_, j, k), f in
             zip(tree, robot.tree_f, strict=True)]
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
    turn, e = w - u, STRAY * d
    v = velocities(robot, q, turn)
    along = np.maximum(mixed(robot, u, turn), mixed(robot, w, turn))
    first = e * np.maximum(v, 0.375 * along * d)
    return (first + 0.5 * mixed(robot, turn, turn) * e * e).max()


def longest(robot, q, u, w, room, most):
    return kernels.longest_blend(
        robot.tree_i, robot.tree_f, robot.spheres, robot.sphere_body,
        robot.sphere_reach, q, u, w, room, most,
    )


def test_the_kernel_agrees_with_its_twin_and_leaves_nothing(robot, rng):
    for most in (0.002, 0.05):
        for _ in range(40):
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
    assert weighed.max() <= STRAY + 1e-12 and np.isclose(weighed[50000], STRAY)


# --- what is left of a motion, as chords -------------------------------------


def test_chords_of_any_part_of_a_blend_are_nearer_to_it_than_the_corner_path(
    robot, rng
):
    for _ in range(15):
        q, u, w = draw_corner(robot, rng, True)
        pieces, stray = lay_way(robot, legs_at(q, u, w), 0.02)
        for piece in (p for p in pieces if p.d > 0.0):
            a, b = np.sort(rng.random(2)) if rng.random() < 0.7 else (0.0, 1.0)
            ends = piece.begin + 2.0 * piece.d * np.array([a, 0.5 * (a + b), b])
            for begin, end in zip(ends, ends[1:], strict=False):
                first, last = piece.at(begin)[0], piece.at(end)[0]
                for t in np.linspace(0.0, 1.0, 21):
                    on = piece.at(begin + t * (end - begin))[0]
                    chord = first + t * (last - first)
                    moved = sphere_centers(robot, on) - sphere_centers(robot, chord)
                    assert np.linalg.norm(moved, axis=1).max() <= stray + 1e-9


def chord_weight(a, b, x):
    """How far a chord over [a, b] is from the blend, weighed as the corner path is."""
    def curve(y):  # in w - u, beside the straight line through the first leg
        return 2.0 * y**3 * (1.0 - 0.5 * y)

    chord = curve(a) + (x - a) / max(b - a, 1e-12) * (curve(b) - curve(a))
    return np.abs(chord - curve(x)) * (1.0 + 8.0 / 3.0 * np.abs(1.0 - 2.0 * x))


def test_the_weighed_distance_of_chords_is_less_than_that_of_the_corner_path():
    # a part of a blend stands as two chords, so that none is longer than half of it
    for a in np.linspace(0.0, 1.0, 41):
        for b in np.linspace(a, min(1.0, a + 0.5), 21):
            x = np.linspace(a, b, 101)
            assert chord_weight(a, b, x).max() < 0.9 * STRAY


# --- motions from beside a leg -----------------------------------------------


def legs_stray(robot, q, leg, share, off):
    n, bodies = len(robot.spheres), len(robot.tree_i)
    return kernels.legs_stray(
        robot.tree_i, robot.tree_f, robot.spheres, robot.sphere_body,
        robot.sphere_reach, q, leg, share, off, np.empty((bodies, 12)),
        np.empty((bodies, 12)), *np.empty((3, bodies)), np.empty(n),
    )


@pytest.mark.parametrize("size", [0.003, 0.05])
def test_motions_from_beside_a_leg_stay_as_near_as_is_said(robot, rng, size):
    shares = []
    for _ in range(60):
        q, leg, off = draw_corner(robot, rng, True)
        leg, off = rng.uniform(0.05, 2.0) * leg, size * off
        share = rng.random()
        said = legs_stray(robot, q, leg, share, off)
        assert said <= np.abs(off) @ joint_sway(robot) + 1e-12
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


def test_the_highest_place_of_the_bound_is_found(rng):
    t = np.linspace(0.0, 1.0, 20001)
    for begin, slope, most in rng.uniform(0.0, 3.0, (300, 3)):
        seen = ((1.0 - t) * np.minimum(most, begin + t * slope)).max()
        assert np.isclose(kernels.highest(begin, slope, most), seen, atol=1e-3)
        assert kernels.highest(begin, slope, most) >= seen - 1e-12


# --- motions over blends -----------------------------------------------------


def test_all_limits_hold_on_longer_blends_and_through_joins(robot, rng):
    middle, half = 0.5 * (robot.upper + robot.lower), 0.3 * (robot.upper - robot.lower)

    def draw(n, first=None):
        path = middle + half * rng.uniform(-1, 1, (n, robot.dof))
        return path if first is None else np.vstack([first, path])

    for _ in range(5):
        motion = roadmap.time_path(robot, draw(5), blend=0.01)
        for _ in range(3):
            check_limits(robot, motion)
            assert motion.deviation <= 0.01 + 1e-12
            t = rng.uniform(0.0, 0.8 * motion.duration)
            commit = motion.commit(t, 0.05)
            motion = motion.join(t, commit, draw(3, commit.q), blend=0.01)


@pytest.mark.parametrize("jerk", [15.0, 500.0])
def test_stops_on_blends_brake_harder_and_keep_all_limits(robot, rng, jerk):
    quick = 7.0 * robot.max_velocity
    robot = replace(robot, max_acceleration=quick, max_jerk=jerk * quick)
    middle, half = 0.5 * (robot.upper + robot.lower), 0.3 * (robot.upper - robot.lower)
    harder = 0
    for _ in range(8):
        legs = rng.uniform(-1, 1, robot.dof) + rng.uniform(-1, 1, (5, robot.dof))
        path = middle + 0.1 * half * np.cumsum(legs, axis=0)
        scale = rng.uniform(0.1, 1.0)
        motion = roadmap.time_path(robot, path, blend=0.01, speed_scale=scale)
        for t in rng.choice(_times_on_blends(motion), 6):
            stop = motion.stop(t)
            check_limits(robot, stop)
            way = stop._way
            for phase in stop._phases:
                k = way.index(phase.s)
                harder += -phase.a > 1.05 * way.a[k] and way.pieces[k].d > 0.0
            # taken back before it stands, and left for another path
            on = stop.rescaled(rng.uniform(0.0, stop.duration), scale)
            check_limits(robot, on)
            assert np.allclose(on.q_end, motion.q_end)
            t = rng.uniform(0.0, stop.duration)
            commit = stop.commit(t, 0.02)
            new = middle + half * rng.uniform(-1, 1, (2, robot.dof))
            check_limits(robot, stop.join(t, commit, np.vstack([commit.q, new])))
    assert harder > 5


def _times_on_blends(motion):
    way, times = motion._way, np.linspace(0.0, motion.duration, 200)
    return [t for t in times if way.pieces[way.index(motion.place(t))].d > 0.0]


def check_limits(robot, motion, dt=1e-3):
    q, dq, ddq = motion.sample(np.arange(0.0, motion.duration + 2 * dt, dt))
    slack = 1.0 + 1e-6
    assert (np.abs(dq) <= slack * robot.max_velocity).all()
    assert (np.abs(ddq) <= slack * robot.max_acceleration).all()
    jerk = np.diff(ddq, axis=0) / dt
    assert (np.abs(jerk) <= 1.001 * robot.max_jerk + 1e-6).all()
    assert np.allclose(np.diff(q, axis=0) / dt, 0.5 * (dq[1:] + dq[:-1]), atol=2e-3)


def test_a_motion_may_be_left_behind_its_blends_and_goes_straight_on(panda, rng):
    through = 0
    for _ in range(8):
        path = rng.uniform(-1.0, 1.0, (4, 7)) + [0, 0, 0, -1.5, 0, 1.5, 0]
        motion = roadmap.time_path(panda, path, blend=0.01, speed_scale=0.5)
        for t in np.linspace(0.0, motion.duration, 40):
            stands = motion.commit(t, 0.05).s
            commit = motion.commit(t, 0.05, through_blends=True)
            piece = motion._way.pieces[motion._way.index(commit.s)]
            assert piece.d == 0.0 or commit.s >= piece.end - 1e-9
            if commit.s <= stands + 1e-6:
                continue
            through += 1
            ahead = [p.corner() for p in motion._way.pieces
                     if p.d > 0.0 and p.begin >= commit.s - 1e-9]
            rest = np.vstack([commit.q, *ahead, path[-1]])
            joined = motion.join(t, commit, rest, blend=0.01, speed_scale=0.5)
            assert joined.duration < 1.02 * (motion.duration - t) + 0.01
            assert not joined._way.corners[1:-1].any()  # it stops nowhere
    assert through > 5
