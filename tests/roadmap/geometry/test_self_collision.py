"""Self-collision against python-fcl; certificates hold on dense samples."""

import numpy as np
import pytest
from robot_asked import motion_free
from scipy.optimize import nnls
from scipy.spatial import ConvexHull
from wrappers import with_wrapper

from roadmap import load_robot
from roadmap.errors import BadConfiguration
from roadmap.geometry import _self_collision as kernels
from roadmap.geometry._gjk import Shell, separation
from roadmap.geometry.self_collision import MARGIN, configuration_free, self_collision
from roadmap.kinematics.forward import body_frames, difference

separation = with_wrapper(separation)

EYE = np.array([1.0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0])


class FclLinks:
    """The exact hulls of a robot's links as python-fcl sees them."""

    def __init__(self, robot):
        fcl = pytest.importorskip("fcl", reason="python-fcl is not installed")
        self.fcl, self.robot, self.hulls = fcl, robot, []
        for i in range(len(robot.solid_kind)):
            points = robot.solid_points[robot.solid_ptr[i] : robot.solid_ptr[i + 1]]
            pose = robot.solid_pose[i]
            hull = ConvexHull(points @ pose[:3, :3].T + pose[:3, 3])
            faces = outward(hull)
            flat = np.hstack([np.full((len(faces), 1), 3), faces]).ravel()
            self.hulls.append(fcl.Convex(hull.points, len(faces), flat))

    def distances(self, q):
        """Return {(link, link): distance [m]} of the tested pairs; <= 0 in contact."""
        fcl, robot, frames = self.fcl, self.robot, body_frames(self.robot, q)
        objects = []
        for hull, link in zip(self.hulls, robot.solid_link, strict=True):
            T = frames[robot.link_body[link]]
            objects.append(
                fcl.CollisionObject(hull, fcl.Transform(T[:3, :3], T[:3, 3]))
            )
        result = {}
        for i, j in robot.self_pairs:
            a, b = objects[i], objects[j]
            if fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()):
                result[i, j] = 0.0
            else:
                answer = fcl.DistanceResult()
                result[i, j] = fcl.distance(a, b, fcl.DistanceRequest(), answer)
        return result


def outward(hull):
    """Return the hull's triangles turned so that their normals point outward."""
    a, b, c = (hull.points[hull.simplices[:, k]] for k in range(3))
    turned = (np.cross(b - a, c - a) * hull.equations[:, :3]).sum(axis=1) < 0
    faces = hull.simplices.copy()
    faces[turned] = faces[turned][:, ::-1]
    return faces


@pytest.fixture(scope="module")
def exact(panda):
    return FclLinks(panda)


def poses(robot, n, rng):
    return rng.uniform(robot.lower, robot.upper, (n, robot.dof))


def test_a_colliding_configuration_is_never_called_free(panda, exact, rng):
    colliding, alarms = 0, 0
    for q in poses(panda, 400, rng):
        nearest = min(exact.distances(q).values())
        free, _ = configuration_free(panda, q)
        colliding += nearest <= 0
        assert not (free and nearest <= 0)
        if not free:
            alarms += 1
            assert nearest < 3e-3
    assert colliding > 20 and alarms < 600


def test_a_free_motion_is_free_at_every_sample(panda, exact, rng):
    proved = 0
    for q in poses(panda, 60, rng):
        target = q + rng.normal(size=panda.dof) * 0.3
        free, _ = motion_free(panda, q, target)
        if not free:
            continue
        proved += 1
        for t in np.linspace(0, 1, 9):
            assert min(exact.distances(q + t * (target - q)).values()) > 0
    assert proved > 20


def test_a_blocked_motion_comes_near_contact(panda, rng):
    """Whatever stops a proof is a pair within a few millimetres somewhere."""
    tested = self_collision(panda)
    blocked = 0
    for q in poses(panda, 300, rng):
        dq = rng.normal(size=panda.dof) * 0.4
        scratch = tested.scratch()
        pair, t = kernels.motion_clear(tested.model, q, dq, MARGIN, 1e-3, 1e-3, scratch)
        if pair < 0:
            continue
        blocked += 1
        at = q + t * dq
        assert not proved_apart(panda, tested, pair, at, MARGIN + 2e-3)
    assert blocked > 20


def proved_apart(robot, tested, pair, q, need):
    """Say if a pair's shells are proved to be `need` apart at q."""
    T = body_frames(robot, q)
    flat = np.hstack([T[:, :3, :3].reshape(-1, 9), T[:, :3, 3]])
    v, s = np.zeros(3), np.zeros((16, 3))
    lower, _ = kernels.pair_clearance(tested.model, pair, flat, need, v, s)
    return lower >= need


def test_the_motion_test_agrees_with_a_naive_scan(gantry, rng):
    """Free motions have no colliding sample; colliding samples are never free."""
    for q in poses(gantry, 100, rng):
        target = rng.uniform(gantry.lower, gantry.upper)
        dq = difference(gantry, q, target)
        samples = [configuration_free_no_limits(gantry, q + t * dq) for t in TIMES]
        free, _ = motion_free(gantry, q, target)
        assert not free or all(samples)


TIMES = np.linspace(0, 1, 101)
NAMES = "pairs", "reach", "points"


def configuration_free_no_limits(robot, q):
    tested = self_collision(robot)
    scratch = tested.scratch()
    return kernels.configuration_clear(tested.model, q, 1e-9, scratch) < 0


def test_the_relative_displacement_bound_holds(panda, rng):
    tested = self_collision(panda)
    pair_i, reach, points = (getattr(tested.model, n) for n in NAMES)
    for q in poses(panda, 50, rng):
        dq = rng.normal(size=panda.dof) * 0.2
        start, end = body_frames(panda, q), body_frames(panda, q + dq)
        for p, row in enumerate(pair_i):
            a, b = points[row[4]], points[row[6]]
            before, after = (
                np.linalg.inv(T[row[2]]) @ T[row[3]] @ [*b, 1] - [*a, 1]
                for T in (start, end)
            )
            assert np.linalg.norm(after - before) <= reach[p] @ np.abs(dq) + 1e-9


def bounds(points, n, need):
    """Return (lower, upper) for two clouds of n points each, started anew."""
    v, s = np.zeros(3), np.zeros((16, 3))
    return separation(points, Shell(0, n, EYE), Shell(n, 2 * n, EYE), v, need, s)


def exact_distance(a, b, scale):
    """Return the distance of two hulls by a quadratic programme over A - B."""
    differences = (a[:, None] - b[None]).reshape(-1, 3).T / scale
    table = np.vstack([differences, np.full(differences.shape[1], 1e3)])
    weights = nnls(table, [0, 0, 0, 1e3], maxiter=10_000)[0]
    return scale * np.linalg.norm(differences @ weights / weights.sum())


@pytest.mark.parametrize("scale", [0.02, 1.0])
def test_a_distance_just_below_the_exact_one_is_proved_and_no_more(scale, rng):
    gaps, little = 0, 2e-6 * scale
    for _ in range(200):
        a = rng.normal(size=(12, 3)) * scale * rng.uniform(0.05, 1, 3)
        b = a[::-1] * [1, -1, 1] + rng.normal(size=3) * 2 * scale
        points, exact = np.vstack([a, b]), exact_distance(a, b, scale)
        assert bounds(points, 12, exact + little)[0] < exact + little
        if exact > little:
            gaps += 1
            assert bounds(points, 12, exact - little)[0] >= exact - little
            assert bounds(points, 12, exact + little)[1] <= exact + little
    assert gaps > 100


@pytest.mark.parametrize("gap", [0.0, 1e-7, 1e-3])
def test_parallel_faces_and_flat_simplices_do_not_confuse_the_bound(gap):
    """Boxes face to face, edge to edge: all simplices of GJK degenerate."""
    corners = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
    for shift in ([1 + gap, 0, 0], [1 + gap, 1, 0], [1 + gap, 0.3, 0.2]):
        points = np.vstack([corners, corners + shift])
        assert bounds(points, 8, gap + 1e-9)[0] < gap + 1e-9
        if gap > 0:
            assert bounds(points, 8, 0.99 * gap)[0] >= 0.99 * gap


def test_a_continuous_joint_is_tested_the_short_way(urdf, link, joint):
    wall = link("wall", '<box size="0.1 0.4 0.1"/>', "-0.6 0 0")
    body = wall + link("arm", '<box size="0.6 0.05 0.05"/>', "0.3 0 0")
    path = urdf(body + joint("turn", "continuous", "wall", "arm"))
    robot = load_robot(path, cover_excess=0.05)
    # wall and arm are joined, so test them all the same
    from dataclasses import replace

    robot = replace(robot, self_pairs=np.array([[0, 1]]))
    assert motion_free(robot, [-1.0], [1.0]) == (True, None)
    assert motion_free(robot, [2.2], [-2.2]) == (False, ("wall", "arm"))


def chain(link, joint, shapes, kind="revolute"):
    names = [f"l{i}" for i in range(len(shapes))]
    body = "".join(link(n, s, "0 0 0.1") for n, s in zip(names, shapes, strict=True))
    for i, (a, b) in enumerate(zip(names, names[1:], strict=False)):
        body += joint(f"j{i}", kind, a, b, "0 0 0.2", "1 0 0")
    return body


BAR = '<box size="0.06 0.06 0.16"/>'


def test_adjacent_links_are_dropped_and_listed_also_across_bare_links(
    urdf, link, joint
):
    robot = load_robot(urdf(chain(link, joint, [BAR, "", BAR, BAR])), cover_excess=0.05)
    dropped = {frozenset(d[:2]): d[2] for d in robot.dropped_pairs}
    assert dropped == {
        frozenset(("l0", "l2")): "joined by a joint",
        frozenset(("l2", "l3")): "joined by a joint",
    }
    assert robot.self_pairs.tolist() == [[0, 2]]


def test_a_pair_always_in_contact_is_dropped_with_its_reason(urdf, link, joint):
    fat = '<box size="0.3 0.3 0.5"/>'
    robot = load_robot(urdf(chain(link, joint, [fat, BAR, fat])), cover_excess=0.1)
    reasons = {frozenset(d[:2]): d[2] for d in robot.dropped_pairs}
    assert "always in contact" in reasons[frozenset(("l0", "l2"))]


def test_a_pair_that_samples_never_saw_in_contact_is_kept(panda):
    names = panda.link_names
    kept = {frozenset((names[i], names[j])) for i, j in panda.self_pairs}
    assert frozenset(("panda_link0", "panda_link2")) in kept
    n = len(names)
    assert len(kept) + len(panda.dropped_pairs) == n * (n - 1) // 2


def test_an_srdf_s_disabled_pairs_are_dropped(urdf, link, joint, tmp_path):
    srdf = tmp_path / "robot.srdf"
    srdf.write_text(
        '<robot name="x"><disable_collisions link1="l3" link2="l0" reason="Never"/>'
        "</robot>"
    )
    path = urdf(chain(link, joint, [BAR] * 4))
    robot = load_robot(path, srdf=srdf, cover_excess=0.05)
    assert ("l0", "l3", "SRDF: Never") in robot.dropped_pairs
    assert [0, 3] not in robot.self_pairs.tolist()
    assert [0, 3] in load_robot(path, cover_excess=0.05).self_pairs.tolist()


def test_a_reason_names_the_joint_or_the_links(panda):
    q = np.array([0.0, 0, 0, -1.5, 0, 1.5, 0])
    assert configuration_free(panda, q) == (True, "")
    q[3] = 0.5
    free, reason = configuration_free(panda, q)
    assert not free and "panda_joint4" in reason and "0.0000" in reason
    q = np.array([0.0, 1.8, 0, -3.1, 0, 0.0, 0])
    free, reason = configuration_free(panda, q)
    assert not free and "panda_" in reason


@pytest.mark.parametrize("q", [[0.0] * 6, [np.nan] * 7, [[0.0] * 7], "home", None])
def test_an_unusable_configuration_raises(panda, q):
    with pytest.raises(BadConfiguration):
        configuration_free(panda, q)
    with pytest.raises(BadConfiguration):
        motion_free(panda, q, np.zeros(7))
