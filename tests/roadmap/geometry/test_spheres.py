"""The sphere cover contains the solids, surface and volume, on any robot."""

import numpy as np
import pytest
from forms import size
from hypothesis import given, settings
from hypothesis import strategies as st
from nearest import out_of_spheres

from roadmap import load_robot
from roadmap.errors import BadRobot
from roadmap.geometry import _spheres as kernels
from roadmap.geometry import polytope, spheres
from roadmap.geometry.polytope import MAX_SHELL_VERTICES, depth, shell, support
from roadmap.geometry.solid_samples import grid, surface
from roadmap.geometry.solids import Solid
from roadmap.geometry.spheres import (
    MAX_SPHERES_PER_LINK,
    _near_together,
    _protrusion,
    _rows,
    _Sampled,
    cover_excess,
    cover_report,
    cover_solids,
    robot_solids,
)
from roadmap.robot.robot import BOX, CYLINDER, HULL, SPHERE

laws = settings(deadline=None, max_examples=8)
NO_POINTS = np.empty((0, 3))


def rotation(rng):
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))


def make_solid(kind, rng):
    """Return a random solid 2 to 40 cm large, anywhere near the origin."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation(rng), rng.uniform(-0.3, 0.3, 3)
    a, b, c = rng.uniform(0.02, 0.2, 3)
    if kind == HULL:
        points = rng.normal(size=(int(rng.integers(5, 60)), 3)) * (a, b, c)
        return Solid(HULL, 0, T, (0.0, 0.0, 0.0), points / 2)
    size = {BOX: (2 * a, 2 * b, 2 * c), CYLINDER: (a / 2, 2 * b, 0), SPHERE: (a, 0, 0)}
    return Solid(kind, 0, T, tuple(map(float, size[kind])), NO_POINTS)


def inner_points(solid, n, rng):
    """Return points of the volume and of the surface, body frame, (m, 3)."""
    if solid.kind == HULL:
        weights = rng.dirichlet(np.full(len(solid.points), 0.15), n)
        local = np.vstack([weights @ solid.points, solid.points])
    elif solid.kind == BOX:
        local = rng.uniform(-0.5, 0.5, (n, 3))
        local[::2, 0] = np.sign(local[::2, 0]) / 2
        local[::6, 1:] = np.sign(local[::6, 1:]) / 2
        local = local * solid.size
    elif solid.kind == CYLINDER:
        angle, away = rng.uniform(0, 2 * np.pi, n), np.sqrt(rng.uniform(size=n))
        away[::2] = 1
        z = rng.uniform(-0.5, 0.5, n)
        z[::4] = np.sign(z[::4]) / 2
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        local = np.hstack([circle * away[:, None] * solid.size[0], z[:, None]])
        local[:, 2] *= solid.size[1]
    else:
        local = rng.normal(size=(n, 3))
        local /= np.linalg.norm(local, axis=1, keepdims=True)
        local[::2] *= rng.uniform(size=(len(local[::2]), 1)) ** (1 / 3)
        local *= solid.size[0]
    return local @ solid.T_body_solid[:3, :3].T + solid.T_body_solid[:3, 3]


def uncovered(points, spheres):
    """Return how far points lie outside of the union of spheres, at most [m]."""
    return out_of_spheres(points, spheres).max()


@pytest.mark.parametrize("kind", [HULL, BOX, CYLINDER, SPHERE])
@laws
@given(seed=st.integers(0, 2**32 - 1))
def test_a_cover_contains_surface_and_volume(kind, seed):
    rng = np.random.default_rng(seed)
    solid = make_solid(kind, rng)
    spheres = cover_solids([solid], 0.02)
    assert uncovered(inner_points(solid, 3000, rng), spheres) <= 0
    assert len(spheres) <= MAX_SPHERES_PER_LINK


def test_a_sphere_is_its_own_cover(rng):
    solid = make_solid(SPHERE, rng)
    spheres = cover_solids([solid], 0.01)
    assert np.allclose(spheres, [[*solid.T_body_solid[:3, 3], solid.size[0]]])
    assert spheres[0, 3] >= solid.size[0]


def test_several_solids_of_a_link_share_their_spheres(rng):
    bar = Solid(CYLINDER, 0, np.eye(4), (0.05, 0.3, 0.0), NO_POINTS)
    caps = []
    for z in (-0.15, 0.15):
        T = np.eye(4)
        T[2, 3] = z
        caps.append(Solid(SPHERE, 0, T, (0.05, 0.0, 0.0), NO_POINTS))
    spheres = cover_solids([bar, *caps], 0.02)
    assert len(spheres) <= 6
    for solid in (bar, *caps):
        assert uncovered(inner_points(solid, 3000, rng), spheres) <= 0


def test_a_ball_apart_from_the_rest_of_its_link_needs_no_search(rng, monkeypatch):
    bar = Solid(BOX, 0, np.eye(4), (0.1, 0.08, 0.2), NO_POINTS)
    T = np.eye(4)
    T[2, 3] = 0.3
    ball = Solid(SPHERE, 0, T, (0.05, 0.0, 0.0), NO_POINTS)
    searched, search = [], kernels.worst_power

    def told(region, *rest):
        searched.append(len(region[0]))  # a ball has no faces; it would take minutes
        return search(region, *rest) if searched[-1] else -1.0

    monkeypatch.setattr(kernels, "worst_power", told)
    spheres = cover_solids([bar, ball], 0.015)
    assert set(searched) == {6}
    for solid in (bar, ball):
        assert uncovered(inner_points(solid, 3000, rng), spheres) <= 0


def test_a_long_link_is_covered_as_closely_as_was_asked(rng):
    # with the samples of a short one, holes between them grew every sphere to 26 mm
    beam = Solid(BOX, 0, np.eye(4), (0.1, 0.1, 0.4), NO_POINTS)
    at_once, spheres = (
        cover_solids([beam], 0.02, closely) for closely in (False, True)
    )
    assert len(spheres) <= MAX_SPHERES_PER_LINK
    assert cover_excess(spheres, [beam]) <= 0.024 < cover_excess(at_once, [beam])
    assert uncovered(inner_points(beam, 3000, rng), spheres) <= 0


def test_a_thin_plate_is_covered_on_both_sides(rng):
    plate = Solid(BOX, 0, np.eye(4), (0.2, 0.15, 0.0005), NO_POINTS)
    spheres = cover_solids([plate], 0.02)
    assert uncovered(inner_points(plate, 3000, rng), spheres) <= 0
    assert cover_excess(spheres, [plate]) <= 0.022


def test_what_lies_inside_another_solid_does_not_count_as_surface():
    outer = Solid(BOX, 0, np.eye(4), (0.2, 0.15, 0.1), NO_POINTS)
    inner = Solid(CYLINDER, 0, np.eye(4), (0.03, 0.08, 0.0), NO_POINTS)
    spheres = cover_solids([outer, inner], 0.02)
    alone = pytest.approx(_protrusion(spheres, [outer]))
    assert _protrusion(spheres, [outer, inner]) == alone
    # two that are the same are the surface of each other
    twins = [outer, Solid(BOX, 0, np.eye(4), (0.2, 0.15, 0.1), NO_POINTS)]
    assert _protrusion(spheres, twins) == alone


def test_the_panda_s_cover_contains_its_links(panda, rng):
    for solid in robot_solids(panda):
        spheres = panda.spheres[panda.sphere_link == solid.link]
        assert uncovered(inner_points(solid, 5000, rng), spheres) <= 0


def test_the_panda_needs_few_spheres_and_keeps_the_excess(panda):
    rows = cover_report(panda)
    assert sum(row.spheres for row in rows) == len(panda.spheres) <= 135
    assert max(row.excess for row in rows if row.moving) <= 1.15 * 0.015
    assert all(0 < row.protrusion <= row.excess for row in rows)


def test_the_same_robot_gives_the_same_bytes(urdf, link, joint):
    body = link("base") + link("arm", '<box size="0.3 0.1 0.08"/>', "0.1 0 0")
    path = urdf(body + joint("turn", "revolute", "base", "arm"))
    first, second = load_robot(path), load_robot(path)
    assert first.spheres.tobytes() == second.spheres.tobytes()
    assert first.fingerprint() == second.fingerprint()


def test_every_sphere_of_a_cover_is_needed():
    box = Solid(BOX, 0, np.eye(4), (0.3, 0.1, 0.1), NO_POINTS)
    spheres = cover_solids([box], 0.02)
    assert proof(box, spheres) <= 1e-6
    for i in range(len(spheres)):
        assert proof(box, np.delete(spheres, i, axis=0)) > 1e-6


def naive_worst(solid, spheres):
    """Return the largest power over many points: a bound from below."""
    points = np.vstack([surface(solid, 20_000)[0], grid(solid, 20_000)[0]])
    points = points[depth(solid, points) > -1e-9]
    square = ((points[:, None] - spheres[None, :, :3]) ** 2).sum(axis=2)
    return (square - spheres[:, 3] ** 2).min(axis=1).max()


def proof(solid, spheres, tol=1e-6):
    from roadmap.geometry.spheres import _region

    stack, where = np.empty((50_000, 6)), np.empty(3)
    squares = spheres[:, 3] ** 2
    return kernels.worst_power(_region(solid), spheres, squares, tol, stack, where)


@pytest.mark.parametrize("kind", [HULL, BOX, CYLINDER, SPHERE])
def test_the_proved_bound_is_true_and_tight(kind, rng):
    for _ in range(size(2, 4)):
        solid = make_solid(kind, rng)
        points = inner_points(solid, 12, rng)
        spheres = np.hstack([points, rng.uniform(0.01, 0.1, (len(points), 1))])
        below, above = naive_worst(solid, spheres), proof(solid, spheres, 1e-5)
        assert below <= above
        # circumscribed corners and sparse samples explain what lies between
        assert above <= max(below, 0) + 0.15 * max(below, 0.005)


def test_the_bound_is_not_below_what_a_corner_lacks(rng):
    """The worst place is a corner, which is the middle of no box that is looked at."""
    lacks = 3 * 0.1**2 - 0.15**2
    for tol in (1e-5, 1e-4, 1e-4, 1e-4):
        T = np.eye(4)
        T[:3, :3] = rotation(rng)
        cube = Solid(BOX, 0, T, (0.2, 0.2, 0.2), NO_POINTS)
        above = proof(cube, np.array([[0.0, 0.0, 0.0, 0.15]]), tol)
        assert lacks <= above <= lacks + 2 * tol


def test_a_search_without_the_room_to_end_proves_nothing(monkeypatch):
    cube = Solid(BOX, 0, np.eye(4), (0.2, 0.2, 0.2), NO_POINTS)
    sphere, where = np.array([[0.0, 0.0, 0.0, 0.15]]), np.empty(3)
    region, squares = spheres._region(cube), sphere[:, 3] ** 2
    for room in (1, 4):
        stack = np.empty((room, 6))
        args = region, sphere, squares, 1e-6, stack, where
        assert kernels.worst_power(*args) == -1.0
    monkeypatch.setattr(kernels, "worst_power", lambda *_: -1.0)
    with pytest.raises(BadRobot, match="cannot be proved"):
        cover_solids([cube], 0.05)


def test_spheres_grow_by_what_the_worst_held_of_several_solids_lacks(rng):
    T = np.eye(4)
    T[0, 3] = 0.5
    cubes = [Solid(BOX, 0, pose, (0.2, 0.2, 0.2), NO_POINTS) for pose in (np.eye(4), T)]
    given = np.array([[0.0, 0.0, 0.0, 0.15], [0.5, 0.0, 0.0, 0.2]])
    for order in (cubes, cubes[::-1]):
        grown, worst = spheres._proved(given, order)
        assert len(worst) == 1
        for cube in cubes:
            assert uncovered(inner_points(cube, 3000, rng), grown) <= 0


@pytest.mark.parametrize("kind", [HULL, BOX, CYLINDER, SPHERE])
def test_a_shell_contains_its_solid_and_sticks_out_little(kind, rng):
    for _ in range(20):
        solid = make_solid(kind, rng)
        vertices = shell(solid)
        directions = rng.normal(size=(500, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        over = (vertices @ directions.T).max(axis=0) - support(solid, directions)
        assert over.min() >= 0
        assert over.max() <= (0.08 * solid.size[0] if kind == SPHERE else 0.015)
        assert len(vertices) <= MAX_SHELL_VERTICES


def test_a_link_of_many_solids_is_held_by_no_more_samples(monkeypatch):
    asked = []

    class Counted(_Sampled):
        def __init__(self, points, *rest):
            asked.append(len(points))
            super().__init__(points, *rest)

    monkeypatch.setattr(spheres, "_Sampled", Counted)
    monkeypatch.setattr(spheres, "_ROUNDS", 100)  # fewer spheres are not looked for
    for n in (32, 128):
        poses = np.tile(np.eye(4), (n, 1, 1))
        poses[:, :2, 3] = [(0.02 * (k % 8), 0.02 * (k // 8)) for k in range(n)]
        cubes = [Solid(BOX, 0, T, (0.02, 0.02, 0.02)) for T in poses]
        cover = cover_solids(cubes, 0.05)
        corners = poses[:, :3, 3] + np.array([0.01, 0.01, -0.01])
        assert out_of_spheres(corners, cover).max() <= 0
    assert asked[1] < 1.5 * asked[0]


def test_a_fine_hull_is_measured_in_parts(rng, monkeypatch):
    solid, directions = make_solid(HULL, rng), rng.normal(size=(50, 3))
    whole = support(solid, directions)
    monkeypatch.setattr(polytope, "_MOST", 7 * len(solid.points))
    np.testing.assert_allclose(support(solid, directions), whole, rtol=1e-12)
    monkeypatch.setattr(polytope, "_MOST", 1)
    np.testing.assert_allclose(support(solid, directions), whole, rtol=1e-12)


def test_a_box_is_its_own_shell():
    solid = Solid(BOX, 0, np.eye(4), (0.3, 0.2, 0.1), NO_POINTS)
    corners = np.array(np.meshgrid([-0.15, 0.15], [-0.1, 0.1], [-0.05, 0.05]))
    corners = corners.reshape(3, -1).T
    vertices = shell(solid)
    assert len(vertices) == 8
    away = np.linalg.norm(vertices[:, None] - corners[None], axis=2)
    assert away.min(axis=1).max() < 1e-5


def test_depth_is_the_distance_to_the_surface(rng):
    for kind in (HULL, BOX, CYLINDER, SPHERE):
        solid = make_solid(kind, rng)
        center = inner_points(solid, 500, rng)
        inside = depth(solid, center)
        directions = rng.normal(size=(200, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        gap = support(solid, directions)[None] - center @ directions.T
        assert (inside <= gap.min(axis=1) + 1e-6).all()
        assert inside.min() > -1e-6


def test_a_silly_excess_is_refused():
    solid = Solid(BOX, 0, np.eye(4), (0.3, 0.2, 0.1), NO_POINTS)
    for excess in (0.0, -1.0, 5.0, np.nan):
        with pytest.raises(BadRobot, match="excess of"):
            cover_solids([solid], excess)


def held(spheres, points):
    """Return which sphere holds which point, by the definition (m, n)."""
    far = np.linalg.norm(points - spheres[:, None, :3], axis=2)
    return far <= spheres[:, 3:]


def as_bits(rows, n):
    return np.unpackbits(rows.view(np.uint8), axis=1, bitorder="little")[:, :n] > 0


@pytest.mark.parametrize("n", [1, 63, 64, 65, 300, 5000])  # 5000: more than 64 words
def test_rows_and_what_greed_takes_agree_with_their_twins(n, rng):
    points = rng.uniform(-1, 1, (n, 3))
    points = points[_near_together(points, np.arange(n))]
    assert len(np.unique(points, axis=0)) == n
    pool = np.column_stack([rng.uniform(-1, 1, (400, 3)), rng.uniform(0.1, 0.6, 400)])
    rows, inside = _rows(pool, points), held(pool, points)
    assert (as_bits(rows, n) == inside).all()
    start = [7, 3]
    wanted, left = list(start), inside.any(axis=0) & ~inside[start].any(axis=0)
    while left.any():
        wanted.append(
            int(np.argmax(inside[:, left].sum(axis=1)))
        )  # the first of equals
        left &= ~inside[wanted[-1]]
    chosen = np.zeros(n + 70, np.int64)
    chosen[:2] = start
    count = kernels.choose(rows, chosen, 2, 0, pool, 100, 1)
    assert chosen[:count].tolist() == wanted
    better = kernels.choose(rows, chosen, count, n + 2, pool, 300, 1)
    assert better <= count
    assert (inside[chosen[:better]].any(axis=0) == inside.any(axis=0)).all()


def test_samples_that_come_later_are_held_as_if_all_had_come_at_once(rng):
    box = Solid(BOX, 0, np.eye(4), (0.2, 0.1, 0.1), NO_POINTS)
    points = rng.uniform(-0.5, 0.5, (500, 3)) * (0.2, 0.1, 0.1)
    pool = np.column_stack([points[:5], np.full(5, 0.03)])
    sampled = _Sampled(points[:333], [box], 0.02)
    more, rows = sampled.with_more(points[333:], *sampled.able(pool))
    assert (as_bits(rows, 500) == held(more, sampled.points)).all()
    assert as_bits(rows, 500).any(axis=0).all() and (more[:5] == pool).all()
    assert {*map(tuple, points)} == {*map(tuple, sampled.points)}


@pytest.mark.parametrize("radius", [5e-5, 2e-4])
def test_a_wire_is_sampled_all_over_by_no_more_points_than_another_rod(radius):
    wire = Solid(CYLINDER, 0, np.eye(4), (radius, 2.0, 0.0))
    points, normals = surface(wire, 3000)
    assert len(points) < 30_000 and len(normals) == len(points)
    step = np.sqrt(2 * 2.0 * 2.0 * np.pi * radius / 3000)
    across = np.hypot(points[:, 0], points[:, 1])
    assert (across > 0.9 * radius).mean() > 0.9 and across.max() < 1.3 * radius
    heights = np.sort(points[:, 2])
    assert heights[0] == pytest.approx(-1.0, abs=1e-6)
    assert heights[-1] == pytest.approx(1.0, abs=1e-6)
    assert np.diff(heights).max() < 2 * step
