"""What the links sweep, by their shells: for what comes nearer than the cover allows.

The spheres of the cover stick out of the links by one or two centimetres. The shells
(`Robot.shell_points`) are convex, contain the links, and stick out of them by a
millimetre; a link that is a ball is tested as one.

What a link sweeps while q goes straight from q0 to q1: a vertex goes from p0 to p1, and
is never farther from the straight line between the two than |p''| / 8, with p'' bounded
over the whole piece (`motion_bounds`). So the link is within that of the convex hull of
its vertices at q0 and at q1. The distance of two hulls is bounded from below by GJK.
"""

import math
from typing import NamedTuple

import numpy as np

from odm.close_test._close import ESCAPE_SLACK
from odm.close_test._shells import hulls_apart
from odm.obstacles._solids import BOX, CAPSULE, CYLINDER, Solids
from roadmap.arrays import writable
from roadmap.kinematics import _forward as kernels
from roadmap.robot.robot import SPHERE, Robot

TOUCH = 1e-4  # [m] what is nearer than this to a shell counts as touching it
_BASE = np.array([1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0, 0, 0, 0])
_SIDES = 64  # of the prism around a cylinder


class Hulls(NamedTuple):
    """Convex obstacles: each is a hull, and all that is within a radius of it."""

    points: np.ndarray  # (n, 3) vertices, one obstacle after the other [m]
    sizes: np.ndarray  # (j,) how many each has
    radii: np.ndarray  # (j,) [m]

    @classmethod
    def of_rods(cls, capsules: np.ndarray) -> "Hulls":
        """Return what capsules (j, 7) are [m]."""
        j = len(capsules)
        return cls(capsules[:, :6].reshape(-1, 3), np.full(j, 2), capsules[:, 6])

    @classmethod
    def of(cls, points: np.ndarray, solids: Solids) -> "Hulls":
        """Return what points (n, 3) [m] and solids are, in this order.

        A cylinder is the prism around it, which sticks out by 1.2 mm for each metre of
        its radius.
        """
        corners, radii = [np.asarray(points)], [0.0] * len(points)
        for k in range(int(solids.count[0])):
            row, kind = solids.rows[k], solids.kind[k]
            corners.append(_corners(row, kind, solids.faces))
            radii.append(row[6] if kind == CAPSULE else 0.0)
        sizes = [1] * len(points) + [len(c) for c in corners[1:]]
        return cls(np.concatenate(corners), np.array(sizes, int), np.array(radii))


def _corners(row: np.ndarray, kind: int, faces: np.ndarray) -> np.ndarray:
    """Return vertices (n, 3) of a polytope around a solid; of a capsule, its ends."""
    if kind == CAPSULE:
        return row[:3] + np.outer([0.0, 1.0], row[3:6])
    if kind == BOX:
        signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
        return row[:3] + (signs * row[12:15]) @ row[3:12].reshape(3, 3).T
    if kind == CYLINDER:
        axis = row[3:6]
        across = np.linalg.svd(axis[None])[2][1:]  # two unit vectors
        turn = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
        rim = row[6] / math.cos(np.pi / _SIDES) * np.c_[np.cos(turn), np.sin(turn)]
        ends = row[:3] + np.outer([-row[7], row[7]], axis)
        return (ends[:, None] + rim @ across).reshape(-1, 3)
    own = faces[int(row[12]) : int(row[13]), 4:13].reshape(-1, 3)
    return row[:3] + np.unique(own, axis=0) @ row[3:12].reshape(3, 3).T


class Shells:
    """The shells of a robot's moving links, and what they sweep."""

    def __init__(self, robot: Robot) -> None:
        """Take the shells of a robot, with what it holds."""
        self.robot = robot
        body = robot.link_body[robot.shell_link]
        these = np.flatnonzero(body > 0)  # the base does not move
        n_bodies, corners, at = len(robot.tree_i), [np.zeros((0, 3))], [np.zeros(0)]
        self._balls = np.zeros(len(these))
        covered = robot.sphere_link[robot.moving]
        # whether there is a shell for every moving link that has spheres
        self.complete = bool(np.isin(covered, robot.shell_link[these]).all())
        for i, k in enumerate(these):
            own = robot.shell_points[slice(*robot.shell_ptr[k : k + 2])]
            if k < len(robot.solid_kind) and robot.solid_kind[k] == SPHERE:
                own = robot.solid_pose[k, None, :3, 3]
                self._balls[i] = robot.solid_size[k, 0]
            # its vertices at q0, then at q1, where bodies have other frames
            corners += [own, own]
            at.append(body[k] + n_bodies * np.repeat([0, 1], len(own)))
        self._vertices = np.concatenate(corners)
        self._body = np.concatenate(at).astype(np.int32)
        # of one type with those of the close test, so that no loop is compiled twice
        self._tree = writable(robot.tree_i), writable(robot.tree_f)
        self._reach = writable(robot.shell_reach[these])
        self._ptr = np.cumsum([len(own) for own in at])
        self._swept = np.zeros((len(self._body), 3))
        self._frames = np.zeros((2 * n_bodies, 12))
        self._rates = np.zeros((2, n_bodies))
        self._first, self._second = np.zeros(len(these)), np.zeros(len(these))
        self._room = np.zeros((17, 3))
        self.show(Hulls.of_rods(np.zeros((0, 7))))

    def __len__(self) -> int:
        """Return how many shells there are; a robot without solids has none."""
        return len(self._first)

    def show(self, there: Hulls) -> None:
        """Take the obstacles that are asked about from now on."""
        n = len(self._swept)
        self._points = np.concatenate([self._swept, there.points])
        self._swept = self._points[:n]
        ends = n + np.cumsum(there.sizes)
        self._all = np.concatenate([self._ptr, ends])
        self._radii = np.ascontiguousarray(there.radii, dtype=float)
        self._free = np.zeros((len(self), len(ends)), bool)
        self._known = bool(np.isfinite(there.points).all())
        self._known &= bool(np.isfinite(self._radii).all())

    def sweep(self, q0: np.ndarray, q1: np.ndarray) -> bool:
        """Place all vertices at both ends of a piece; return whether they are known."""
        n = len(self._rates[0])
        kernels.body_frames(*self._tree, writable(q0), self._frames[:n])
        kernels.body_frames(*self._tree, writable(q1), self._frames[n:])
        kernels.place_points(self._frames, self._body, self._vertices, self._swept)
        tree = *self._tree, self._reach
        dq = np.ascontiguousarray(q1 - q0)
        kernels.motion_bounds(*tree, dq, self._rates, self._first, self._second)
        return bool(np.isfinite(self._swept).all() and np.isfinite(self._second).all())

    def apart(self, least: float | np.ndarray) -> bool:
        """Whether what was swept keeps a distance from what is shown [m].

        `least` is for all, or for each link from each obstacle, (k, j).
        """
        if not self._known:
            return False
        asked = np.full(self._free.shape, least, float)
        slack = self._second / 8.0 + self._balls
        hulls = self._points, self._all, slack, self._radii
        return bool(hulls_apart(*hulls, asked, _BASE, self._room, self._free))

    def needs(self, q: np.ndarray, m: float) -> np.ndarray:
        """Return (k, j) what each link keeps from what is shown as it leaves q [m].

        As much as now, less ESCAPE_SLACK, but half of it at least, and `m` at most.
        What touches a link already may do what it will: less than nothing is asked.
        """
        now, step = np.zeros(self._free.shape), m
        if not (self.sweep(q, q) and self._known):
            return now + np.inf
        self.apart(TOUCH)
        touching = ~self._free
        while step > 0.5 * TOUCH:  # by halves, true from below
            self.apart(np.where(touching, -np.inf, now + step))
            now[self._free] += step
            step *= 0.5
        need = np.minimum(m, np.maximum(now - ESCAPE_SLACK, 0.5 * now))
        return np.where(touching | (now <= TOUCH), -np.inf, need)

    def leave(self, q: np.ndarray, dq: np.ndarray, needs: np.ndarray) -> bool:
        """Whether all links keep what they need on q + t dq, t in [0, 1]; proved.

        What is not proved is halved, until it bends by half of what may be lost; what
        was proved of the whole is not asked of its halves.
        """
        lost = np.min(needs, initial=ESCAPE_SLACK, where=needs > 0.0)
        return self._known and self._leave(q, dq, needs, lost)

    def _leave(
        self, q: np.ndarray, dq: np.ndarray, needs: np.ndarray, lost: float
    ) -> bool:
        if not self.sweep(q, q + dq):
            return False
        if self.apart(needs):
            return True
        if self._second.max(initial=0.0) / 8.0 <= 0.5 * lost:
            return False
        half, left = 0.5 * dq, np.where(self._free, -np.inf, needs)
        return all(self._leave(begin, half, left, lost) for begin in (q, q + half))
