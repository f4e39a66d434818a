"""Points of the robot's surface that an audit sends its obstacles to."""

import numpy as np

from odm.audit import _audit as kernels
from odm.exact.distances import BOX_CORNERS, ExactRobot
from roadmap.robot.robot import BOX, CYLINDER, HULL, Robot
from roadmap.transforms import flat_pose


def audit_solids(robot: Robot, rng: np.random.Generator) -> kernels.Solids:
    """Return the moving solids with points to aim at, as many on each link."""
    exact = ExactRobot(robot)
    targets, owner = [], []
    for i in np.flatnonzero(exact.body > 0):
        rows = np.concatenate([_targets(robot, i, rng), _tight(robot, i)])
        targets.append(rows)
        owner += [i] * len(rows)
    return kernels.Solids(
        parts=exact.convexes,
        body=np.asarray(exact.body, np.int64),
        pose=flat_pose(robot.solid_pose),
        used=exact.body > 0,
        targets=np.ascontiguousarray(np.concatenate(targets)),
        target_part=np.array(owner, np.int64),
    )


def _targets(robot: Robot, i: int, rng: np.random.Generator):
    """Draw surface points and outward normals of solid i, corners first, (400, 6)."""
    from scipy.spatial import ConvexHull

    kind, size, n = robot.solid_kind[i], robot.solid_size[i], 400
    if kind not in (HULL, BOX, CYLINDER):
        out = rng.normal(size=(n, 3))
        out /= np.linalg.norm(out, axis=1)[:, None]
        return np.hstack([size[0] * out, out])
    if kind == CYLINDER:
        radius, length = size[:2]
        angle = rng.uniform(0, 2 * np.pi, n)
        out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
        at = radius * out
        at[:, 2] = rng.choice([-0.5, 0.5], n) * length
        out[::2, 2] = np.sign(at[::2, 2])
        at[1::2, 2] *= rng.random(len(at[1::2]))
        return np.hstack([at, out])
    points = BOX_CORNERS * size if kind == BOX else _hull_points(robot, i)
    hull = ConvexHull(points)
    normals = hull.equations[:, :3]
    at, out = [], []
    for k in range(n):
        face = rng.integers(len(hull.simplices))
        corners = points[hull.simplices[face]]
        if k % 2:
            at.append(rng.dirichlet(np.ones(3)) @ corners)
            out.append(normals[face])
        else:
            vertex = hull.simplices[face][rng.integers(3)]
            around = normals[(hull.simplices == vertex).any(axis=1)]
            at.append(points[vertex])
            out.append(rng.dirichlet(np.ones(len(around))) @ around)
    return np.hstack([np.array(at), np.array(out)])


def _tight(robot: Robot, i: int) -> np.ndarray:
    """Return (200, 6) corners of solid i that the cover holds most tightly.

    Their normals point away from the centre of the sphere that holds them: there the
    cover gives away nothing. In the solid's frame; empty for round solids.
    """
    kind = robot.solid_kind[i]
    if kind not in (HULL, BOX):
        return np.empty((0, 6))
    box = kind == BOX
    corners = BOX_CORNERS * robot.solid_size[i] if box else _hull_points(robot, i)
    spheres = robot.spheres[robot.sphere_body == robot.link_body[robot.solid_link[i]]]
    T = robot.solid_pose[i]
    at = corners @ T[:3, :3].T + T[:3, 3]
    away = at[:, None] - spheres[None, :, :3]
    length = np.linalg.norm(away, axis=2)
    outside = length - spheres[:, 3]
    rows, nearest = np.arange(len(corners)), outside.argmin(axis=1)
    out = away[rows, nearest]
    centred = length[rows, nearest] == 0.0  # then away from the middle of the solid
    out[centred] = (at - at.mean(axis=0))[centred]
    out /= np.linalg.norm(out, axis=1)[:, None]
    order = np.argsort(-outside.min(axis=1), kind="stable")[:10]
    order = np.resize(order, 200)  # the ten tightest, each many times
    return np.hstack([corners, out @ T[:3, :3]])[order]


def _hull_points(robot, i):
    return robot.solid_points[robot.solid_ptr[i] : robot.solid_ptr[i + 1]]
