"""The audit's ground truth agrees with a quadratic programme and with python-fcl."""

import itertools

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation
from wrappers import with_wrapper

import roadmap
from odm.exact import _distances as kernels
from odm.exact.distances import ExactRobot, capsule_obstacles, gather, obstacles_of
from odm.exact.fcl_robot import FclRobot, geometry_of
from odm.obstacles import shapes
from roadmap.errors import BadInput
from roadmap.transforms import flat_pose

reduce_simplex = with_wrapper(kernels.reduce_simplex)

seeds = st.integers(0, 2**32 - 1)
laws = settings(deadline=None, max_examples=150)
KINDS = ("sphere", "capsule", "cylinder", "box", "hull")
_HERE = flat_pose(np.eye(4))


@pytest.fixture(scope="module")
def panda():
    return roadmap.load_robot("panda")


def random_pose(rng, reach=0.2, center=(0, 0, 0)):
    T = np.eye(4)
    T[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    T[:3, 3] = rng.uniform(-reach, reach, 3) + center
    return T


def random_shape(kind, rng, T):
    small, long = 10 ** rng.uniform(-2.5, -1), 10 ** rng.uniform(-2, -0.3)
    if kind == "sphere":
        return shapes.Sphere(small, T)
    if kind == "capsule":
        return shapes.Capsule(small, long * rng.integers(0, 2), T)
    if kind == "cylinder":
        return shapes.Cylinder(small, long, T)
    if kind == "box":
        return shapes.Box(10 ** rng.uniform(-2.5, -0.3, 3), T)
    cloud = rng.normal(size=(rng.integers(8, 60), 3)) * rng.uniform(0.02, 0.1, 3)
    hull = trimesh.convex.convex_hull(cloud)
    return shapes.Mesh(hull.vertices, hull.faces, T)


def bounds(one, other):
    """Return lower and upper bound on the distance of two convex shapes."""
    a, b = obstacles_of([one]), obstacles_of([other])
    low, high = kernels.core_distance(
        a.convexes, 0, a.frames[0], b.convexes, 0, b.frames[0], np.inf
    )
    margin = a.convexes.margin[0] + b.convexes.margin[0]
    return low - margin, high - margin


def distance_by_least_squares(one, other):
    """Return the distance of two polytopes with margins by non-negative fitting."""
    clouds, margin = [], 0.0
    for shape in (one, other):
        parts = obstacles_of([shape])
        R, p = parts.frames[0, :9].reshape(3, 3), parts.frames[0, 9:]
        clouds.append(parts.convexes.points @ R.T + p)
        margin += parts.convexes.margin[0]
    a, b = clouds
    n, k = len(a), len(b)
    weight = 1e3  # of the two rows that make the multipliers sum to 1
    rows = np.block(
        [
            [a.T, -b.T],
            [weight * np.ones((1, n)), np.zeros((1, k))],
            [np.zeros((1, n)), weight * np.ones((1, k))],
        ]
    )
    x, _ = nnls(rows, np.array([0, 0, 0, weight, weight]), maxiter=10_000)
    left, right = x[:n] / x[:n].sum(), x[n:] / x[n:].sum()
    return np.linalg.norm(left @ a - right @ b) - margin


@laws
@given(st.sampled_from(KINDS), st.sampled_from(KINDS), seeds)
def test_the_two_bounds_meet(one, other, seed):
    rng = np.random.default_rng(seed)
    low, high = bounds(
        random_shape(one, rng, random_pose(rng)),
        random_shape(other, rng, random_pose(rng)),
    )
    assert -1e-12 <= high - low <= 1e-8


@laws
@given(
    st.sampled_from([k for k in KINDS if k != "cylinder"]),
    st.sampled_from([k for k in KINDS if k != "cylinder"]),
    seeds,
)
def test_the_distance_is_that_of_the_quadratic_programme(one, other, seed):
    rng = np.random.default_rng(seed)
    a = random_shape(one, rng, random_pose(rng))
    b = random_shape(other, rng, random_pose(rng))
    low, _ = bounds(a, b)
    if low > 1e-4:
        assert low == pytest.approx(distance_by_least_squares(a, b), abs=1e-9)


@laws
@given(st.sampled_from(KINDS), st.sampled_from(KINDS), seeds)
def test_contact_is_that_of_fcl_and_distance_never_above_its(one, other, seed):
    import fcl

    rng = np.random.default_rng(seed)
    a = random_shape(one, rng, random_pose(rng))
    b = random_shape(other, rng, random_pose(rng))
    low, _ = bounds(a, b)
    items = [
        fcl.CollisionObject(
            geometry_of(s), fcl.Transform(s.T_base_shape[:3, :3], s.T_base_shape[:3, 3])
        )
        for s in (a, b)
    ]
    touch = fcl.collide(*items, fcl.CollisionRequest(), fcl.CollisionResult())
    if abs(low) > 1e-6:
        assert (low <= 0.0) == bool(touch)
    if low > 1e-6:  # that it is not too small says the test of the two bounds: fcl's
        # own may be 1.5 mm too large, of a capsule beside a cylinder
        far = fcl.distance(*items, fcl.DistanceRequest(), fcl.DistanceResult())
        assert far >= low - 1e-9


def test_known_distances_are_exact():
    box = shapes.Box(np.array([0.2, 0.2, 0.2]))
    up = np.eye(4)
    for z, size in itertools.product((0.11, 0.2, 0.5), (1e-3, 5e-3)):
        up[2, 3] = z + size
        assert bounds(box, shapes.Sphere(size, up))[0] == pytest.approx(z - 0.1)
    corner = np.eye(4)
    corner[:3, 3] = 0.2
    assert bounds(box, shapes.Sphere(0.01, corner))[0] == pytest.approx(
        np.sqrt(0.03) - 0.01
    )
    tall = shapes.Cylinder(0.05, 0.4, corner)
    assert bounds(box, tall)[0] == pytest.approx(np.sqrt(0.02) - 0.05, abs=1e-9)


def test_a_solid_inside_another_is_in_contact():
    big = shapes.Box(np.array([1.0, 1.0, 1.0]))
    for kind in KINDS:
        small = random_shape(kind, np.random.default_rng(1), np.eye(4))
        assert bounds(big, small)[0] <= 0.0
        assert bounds(small, big)[0] <= 0.0


def random_scene(rng, n=4):
    kinds = rng.choice(KINDS, n)
    return [random_shape(k, rng, random_pose(rng, 0.35, (0, 0, 0.4))) for k in kinds]


def test_the_robot_agrees_with_fcl_about_contact(panda):
    rng = np.random.default_rng(7)
    exact, other = ExactRobot(panda), FclRobot(panda)
    contacts = 0
    for _ in range(300):
        q, scene = rng.uniform(panda.lower, panda.upper), random_scene(rng)
        other.set_obstacles(scene)
        near = exact.distance(q, scene)
        assert (near.distance <= 0.0) == other.collides(q)
        assert exact.collides(q, scene) == (near.distance <= 0.0)
        contacts += near.distance <= 0.0
        if near.distance > 0.0:
            assert -1e-9 <= other.distance(q) - near.distance <= 1e-3
            assert near.link in panda.link_names and near.other in range(4)
    assert 30 < contacts < 270


def test_a_cap_changes_nothing_below_it(panda):
    rng = np.random.default_rng(8)
    exact = ExactRobot(panda)
    for _ in range(100):
        q, scene = rng.uniform(panda.lower, panda.upper), random_scene(rng)
        full = exact.distance(q, scene)
        near = exact.distance(q, scene, cap=0.05)
        assert near.distance == pytest.approx(min(full.distance, 0.05), abs=1e-9)


def test_where_nothing_is_the_distance_is_the_cap(panda):
    exact, q, found = ExactRobot(panda), np.zeros(7), np.empty(2, np.int64)
    none, use = obstacles_of([]), np.ones(len(exact.body), bool)
    for cap in (0.1, np.inf):
        slow = kernels.nearest_pair(
            exact.convexes, use, exact.frames(q), none.convexes, none.frames, cap, found
        )
        near = exact.distance(q, none, cap)
        assert (near.distance, near.gap) == slow == (cap, 0.0)
        assert near.link == "" and near.other is None
        assert not exact.collides(q, [])


def test_the_links_are_points_of_the_solids_moved_by_the_kinematics(panda):
    """A vertex of the tool's hull is at distance radius from a ball around it."""
    exact, q = ExactRobot(panda), np.array([0.3, 0.2, -0.4, -1.8, 0.1, 1.9, 0.5])
    frames = exact.frames(q)
    i = panda.link_names.index("panda_leftfinger")
    tip = panda.solid_points[panda.solid_ptr[i] : panda.solid_ptr[i + 1]]
    R, p = frames[i, :9].reshape(3, 3), frames[i, 9:]
    away = R @ (tip - tip.mean(axis=0)).T
    k = int(np.linalg.norm(away, axis=0).argmax())
    T = np.eye(4)
    T[:3, 3] = R @ tip[k] + p
    assert exact.distance(q, [shapes.Sphere(1e-3, T)]).distance <= -1e-3 + 1e-9


def test_the_base_counts_only_when_asked_for(panda):
    q = np.array([0, 0, 0, -1.5, 0, 1.5, 0])
    T = np.eye(4)
    T[:3, 3] = (-0.05, 0, 0.05)
    ball = [shapes.Sphere(0.01, T)]
    assert ExactRobot(panda, base=True).distance(q, ball).distance <= 0
    assert ExactRobot(panda).distance(q, ball).distance > 0


def test_self_distance_is_the_smallest_of_its_pairs(panda):
    exact, rng = ExactRobot(panda, base=True), np.random.default_rng(9)
    pairs = np.array([[0, 5], [2, 7], [1, 8]])
    for _ in range(20):
        q = rng.uniform(panda.lower, panda.upper)
        each = [exact.self_distance(q, pairs[k : k + 1]).distance for k in range(3)]
        assert exact.self_distance(q, pairs).distance == pytest.approx(min(each))


def test_a_mesh_that_is_not_convex_is_a_solid_with_its_hole(panda):
    exact = ExactRobot(panda)
    q = np.array([0, 0, 0, -1.5, 0, 1.5, 0])
    frames = exact.frames(q)
    ring = trimesh.creation.torus(0.25, 0.02, major_sections=12, minor_sections=6)
    around = np.eye(4)
    around[:3, 3] = frames[panda.link_names.index("panda_link3"), 9:]
    hole = shapes.Mesh(ring.vertices, ring.faces, around)
    assert exact.distance(q, [hole]).distance > 0
    hull = shapes.Mesh(ring.convex_hull.vertices, ring.convex_hull.faces, around)
    assert exact.distance(q, [hull]).distance <= 0
    # a notched block so large that its facets are far from every link
    block = trimesh.creation.box((9, 9, 9)).subdivide()
    bent = block.vertices.copy()
    bent[np.linalg.norm(block.vertices - [4.5, 0, 0], axis=1).argmin()] -= [0.5, 0, 0]
    near = exact.distance(q, [shapes.Mesh(bent, block.faces)])
    assert near.distance == 0.0 and near.other == 0


def test_rows_of_capsules_are_the_same_bytes_as_capsules_one_by_one(rng):
    for n in [0, 1, *rng.integers(2, 20, 60)]:
        rows = rng.normal(0.0, 0.5, (n, 7))
        rows[:, 6] = rng.uniform(0.01, 0.3, n)
        for columns in (slice(3, 6), slice(4, 6), slice(3, 5)):  # points, along an axis
            some = rng.random(n) < 0.1
            rows[some, columns] = rows[some, columns.start - 3 : columns.stop - 3]
        one_by_one = [shapes.Capsule.between(r[:3], r[3:6], r[6]) for r in rows]
        known, found = obstacles_of(one_by_one), capsule_obstacles(rows)
        pairs = [(known.frames, found.frames)]
        pairs += zip(known.convexes, found.convexes, strict=True)
        for a, b in pairs:
            assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
        assert not found.hollow and not found.hollow_shape


@pytest.mark.parametrize(("at", "value"), [(2, np.nan), (4, np.inf), (6, 0.0), (6, -1)])
def test_a_row_that_is_no_capsule_is_refused_as_the_capsule_is(at, value):
    rows = np.array([[0.0, 0, 0, 0, 0, 1, 0.1], [0.0, 0, 0, 0, 1, 0, 0.1]])
    rows[1, at] = value
    with pytest.raises(BadInput):
        capsule_obstacles(rows)


def test_poses_become_rows():
    T = random_pose(np.random.default_rng(0))
    row = flat_pose(T)
    assert np.array_equal(row[:9].reshape(3, 3), T[:3, :3])
    assert np.array_equal(row[9:], T[:3, 3])


def cores(*clouds):
    """Return each cloud of points as the core of one convex, and where it stands."""
    none = np.zeros(1, np.int64)
    return [gather([(np.asarray(c, float), 0.0, 0.0, 0.0)], none) for c in clouds]


def core_bounds(one, other):
    a, b = cores(one, other)
    return kernels.core_distance(a, 0, _HERE, b, 0, _HERE, np.inf)


def bounds_of_least_squares(a, b):
    """Return how far two clouds are apart along a plane, and two of their points."""
    n, k, weight = len(a), len(b), 1e3
    ones = np.vstack([np.r_[np.ones(n), np.zeros(k)], np.r_[np.zeros(n), np.ones(k)]])
    rows = np.vstack([np.hstack([a.T, -b.T]), weight * ones])
    x, _ = nnls(rows, np.array([0, 0, 0, weight, weight]), maxiter=10_000)
    v = x[:n] / x[:n].sum() @ a - x[n:] / x[n:].sum() @ b
    far = np.linalg.norm(v)
    return ((a @ v).min() - (b @ v).max()) / far, far


# Two edges make a flat tetrahedron. Each pair was told to be in contact.
APART = {
    "edges": (
        [[-6.701, -2.697, -4.534], [-6.715, -2.715, -4.512]],
        [[-10.137, -3.225, -11.035], [-1.019, -1.715, 6.411]],
    ),
    "longer edges": (
        [[-14.7, -5.74, 9.02], [-14.72, -5.74, 8.99]],
        [[-6.23, -7.63, -10.18], [-23.8, -3.76, 29.58]],
    ),
    "triangle and edge": (
        [[1.28, -5.83, 2.76], [1.29, -5.83, 2.71], [1.26, -5.84, 2.72]],
        [[2.01, -9.09, 2.28], [-1.04, 4.53, 4.02]],
    ),
    "tetrahedron and edge": (
        [
            [5.22, 7.41, -0.69],
            [5.17, 7.47, -0.75],
            [5.21, 7.43, -0.72],
            [5.2, 7.39, -0.73],
        ],
        [[6.85, 12.05, -1.5], [2.32, -0.68, 0.51]],
    ),
}


@pytest.mark.parametrize("name", APART)
def test_edges_that_are_apart_are_not_in_contact(name):
    a, b = (np.array(cloud) for cloud in APART[name])
    low, high = core_bounds(a, b)
    assert low <= high <= low + 1e-9
    assert low == pytest.approx(bounds_of_least_squares(a, b)[1], abs=1e-8)
    # the nearest points lie within two edges: so far are the lines of one such pair
    across = [np.cross(q - p, b[1] - b[0]) for p, q in itertools.combinations(a, 2)]
    from_ = [p for p, _ in itertools.combinations(a, 2)]
    lines = [
        abs((b[0] - p) @ n) / np.linalg.norm(n)
        for p, n in zip(from_, across, strict=True)
    ]
    assert np.abs(np.array(lines) - low).min() < 1e-9 and low > 0.01


def test_no_flat_tetrahedron_holds_a_point_beside_its_plane():
    """Corners of a parallelogram, rounded: how two edges come to the simplex."""
    rng, v = np.random.default_rng(11), np.empty(3)
    for _ in range(2000):
        p, q = rng.normal(size=(2, 3)) * 10 ** rng.uniform(-3, 0, (2, 1))
        n = np.cross(p, q) / np.linalg.norm(np.cross(p, q))
        far = 10 ** rng.uniform(-6, 0)
        corner = far * n - rng.uniform(0, 1) * p - rng.uniform(0, 1) * q
        w = corner + np.array([np.zeros(3), p, q, p + q])
        assert reduce_simplex(w, 4, v) > 0
        assert np.linalg.norm(v) == pytest.approx(far, rel=1e-3)


def test_a_tetrahedron_that_holds_0_says_so_however_flat_it_is():
    """Where rounding hides it, what is left is no farther than the thing is thick."""
    rng, v, proved = np.random.default_rng(12), np.empty(3), 0
    for _ in range(2000):
        thick = 10 ** rng.uniform(-12, 0)
        w = rng.normal(size=(4, 3)) * [1.0, 1.0, thick]
        w -= rng.dirichlet(np.ones(4)) @ w
        w = w @ Rotation.random(random_state=rng).as_matrix()
        if reduce_simplex(w, 4, v) == 0:
            proved += 1
        else:
            assert np.linalg.norm(v) <= 4.0 * min(thick, 1e-4)
    assert proved > 1000


def test_small_solids_beside_the_edge_of_a_long_slab_lie_within_bounds():
    """A plane between two solids says how far at least, two points how far at most."""
    rng, apart = np.random.default_rng(13), 0
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    for _ in range(1500):
        turn = Rotation.from_euler("z", rng.uniform(0, 6)).as_matrix()
        b = corners * [*10 ** rng.uniform(-1, 1, 2), 0.02] @ turn.T
        one, other = b[rng.integers(8, size=2)]
        t, off = rng.random(), rng.normal(size=3) * 10 ** rng.uniform(-4, -1)
        a = rng.normal(size=(rng.integers(2, 20), 3)) * rng.uniform(0.005, 0.05, 3)
        a += t * one + (1 - t) * other + off
        least, most = bounds_of_least_squares(a, b)
        low, high = core_bounds(a, b)
        assert low <= most + 1e-9 and high >= least - 1e-9
        if least > 1e-6:
            apart += 1
            assert low >= least - 1e-9 and high - low <= 1e-8
    assert apart > 200
