"""Sphere cover: spheres in body frames whose union contains a link's solids, proved.

How the cover is found does not matter for safety; what counts is the proof at its
end. For a convex solid inside a region R and spheres (c_i, r_i), let the power of a
point be p(x) = min_i |x - c_i|^2 - r_i^2. `worst_power` returns a bound P on the
largest p over R, by branch and bound over boxes: the maximum of |x - c_i|^2 over a box
stands at a corner and is computed, not estimated. Adding P to every r_i^2 lowers p by
P everywhere, so that p <= 0 on R: each point of the solid, inside as well as on the
surface, then lies in a sphere.

The search: candidate centres inside the solids, each with the largest radius that the
excess allows; few of them that hold all sample points (greedy, then neighbours are
taken out and replaced); points that are found uncovered join the samples.
"""

from dataclasses import dataclass

import numpy as np

from roadmap.errors import BadRobot
from roadmap.geometry import _spheres as kernels
from roadmap.geometry.polytope import depth, polytope, support
from roadmap.geometry.solid_samples import grid, surface
from roadmap.geometry.solids import Solid
from roadmap.robot.robot import SPHERE, Robot

MAX_SPHERES_PER_LINK = 60
_CANDIDATES = 5000
_SURFACE_SAMPLES = 1000
_VOLUME_SAMPLES = 200
# A cover that sticks out by more than this times what was asked had too few samples ...
_TOO_FAR = 1.05
_MORE = 4  # ... and is looked for again with so many times as many
# Spheres are chosen this much smaller, for what the proof adds at the end [m].
_SLACK = 4e-4
_ROUNDS = 1500
_REPAIRS = 16
_SEED = 88172645463325252
# Offsets tried around a good centre, in grid pitches.
_LATTICE = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 5)] * 3), -1).reshape(-1, 3)
# Accuracy of the proof: grows a sphere of 0.05 m by 0.02 mm [m^2].
_POWER_TOLERANCE = 2e-6
# A point of the surface this deep in another solid is not on the outside [m].
_INSIDE = 1e-6
# For rounding: added to every radius at the end [m].
_ROUNDING = 1e-7


@dataclass(frozen=True)
class CoverRow:
    """What the cover of one link costs, for `odm info`.

    Attributes:
        link: Name of the link.
        spheres: Number of spheres.
        excess: How far a sphere sticks out of the link's solids, the largest [m].
        protrusion: How far the cover reaches beyond the surface, on average [m].
        moving: False for a link of the base.
    """

    link: str
    spheres: int
    excess: float
    protrusion: float
    moving: bool


def cover_solids(
    solids: list[Solid], excess: float, closely: bool = False
) -> np.ndarray:
    """Return spheres (n, 4) in the body frame that contain the solids of one link.

    Args:
        solids: Convex solids of one link, at least one.
        excess: How far a sphere may stick out of the solids [m]. It is enlarged where
            more than MAX_SPHERES_PER_LINK spheres would be needed.
        closely: Where the first cover sticks out farther, look for others, and return
            the one that does so least: up to four times the time, once for a robot.

    Raises:
        BadRobot: `excess` is out of range, or the proof does not come to an end.
    """
    if not 1e-3 <= excess <= 1.0:
        raise BadRobot(
            f"a sphere cover cannot have an excess of {excess} m; choose 0.001 to 1"
        )
    if len(solids) == 1 and solids[0].kind == SPHERE:
        center, radius = solids[0].T_body_solid[:3, 3], solids[0].size[0]
        return np.array([[*center, radius + _ROUNDING]])
    best, least = None, np.inf
    while best is None or (closely and excess < least):
        for more in (1, _MORE) if closely else (1,):
            spheres = _search(solids, excess, more)
            over = cover_excess(spheres, solids)
            if len(spheres) <= MAX_SPHERES_PER_LINK and over < least:
                best, least = spheres, over
            if over <= _TOO_FAR * excess:
                break
        excess *= 1.2
    return best


def cover_excess(spheres: np.ndarray, solids: list[Solid]) -> float:
    """Return how far a sphere sticks out of the union of the solids, at most [m]."""
    inside = np.max([depth(s, spheres[:, :3]) for s in solids], axis=0)
    return float(np.maximum(spheres[:, 3] - inside, 0.0).max())


def cover_report(robot: Robot) -> list[CoverRow]:
    """Return how the cover of each link fits, in the order of `robot.link_names`."""
    rows = []
    solids = robot_solids(robot)
    for link, name in enumerate(robot.link_names):
        spheres = robot.spheres[robot.sphere_link == link]
        of_link = [s for s in solids if s.link == link]
        moving = bool(robot.link_body[link] > 0)
        fit = cover_excess(spheres, of_link), _protrusion(spheres, of_link)
        rows.append(CoverRow(name, len(spheres), *fit, moving))
    return rows


def robot_solids(robot: Robot) -> list[Solid]:
    """Return the exact solids of a robot, as they were when its URDF was read."""
    solids = []
    for i, kind in enumerate(robot.solid_kind):
        points = robot.solid_points[robot.solid_ptr[i] : robot.solid_ptr[i + 1]]
        size = tuple(float(s) for s in robot.solid_size[i])
        link = int(robot.solid_link[i])
        solids.append(Solid(int(kind), link, robot.solid_pose[i], size, points))
    return solids


def _search(solids: list[Solid], excess: float, more: int = 1) -> np.ndarray:
    """Find a proved cover, coarse then refined, by `more` times the usual samples."""
    # of 32 to 400 solids, as of a mesh cut into convex parts, no more in all
    share = max(min(1.0, 32 / len(solids)) / min(len(solids), 8), 0.01)
    samples = np.vstack([_samples(s, more * share) for s in solids])
    n = int(share * _CANDIDATES)
    grids, pitches = zip(*[grid(s, n) for s in solids], strict=True)
    pool = np.vstack([_exact(solids), _candidates(np.vstack(grids), solids, excess)])
    sampled = _Sampled(samples, solids, excess)
    pool, rows = sampled.able(pool)
    picked = _pick(pool, rows, np.empty(0, np.int64), _ROUNDS)
    if len(picked) > MAX_SPHERES_PER_LINK:
        return pool[picked]
    near = pool[picked, None, :3] + min(pitches) * _LATTICE
    near = _candidates(near.reshape(-1, 3), solids, excess)
    pool, rows = sampled.able(np.vstack([pool[picked], _exact(solids), near]))
    picked, rounds, best = np.arange(len(picked)), _ROUNDS, None
    for _ in range(_REPAIRS):
        picked = _pick(pool, rows, picked, rounds)
        missed = [_holes(pool[picked], s, excess) for s in solids]
        if not any(map(len, missed)):
            spheres, worst = _proved(pool[picked], solids)
            over = cover_excess(spheres, solids)
            if best is None or over < best[0]:
                best = over, spheres
            if over <= 1.02 * excess or len(worst) == 0:
                break
            missed = [worst]
        pool, rows = sampled.with_more(np.vstack(missed), pool, rows)
        rounds = _ROUNDS // 40
    spheres = best[1] if best else _proved(pool[picked], solids)[0]
    return _needed(spheres, solids, sampled.points)


def _samples(solid: Solid, share: float) -> np.ndarray:
    skin = surface(solid, int(share * _SURFACE_SAMPLES))[0]
    volume = grid(solid, int(share * _VOLUME_SAMPLES))[0]
    return np.vstack([skin, volume[depth(solid, volume) > 0]])


def _exact(solids: list[Solid]) -> np.ndarray:
    """Return the solids that are spheres as candidates, a rounding larger (n, 4)."""
    spheres = [s for s in solids if s.kind == SPHERE]
    rows = [(*s.T_body_solid[:3, 3], s.size[0] + _ROUNDING) for s in spheres]
    return np.array(rows).reshape(-1, 4)


def _candidates(centers, solids: list[Solid], excess: float) -> np.ndarray:
    """Return the largest spheres allowed at those centres that lie inside (n, 4)."""
    inside = np.max([depth(s, centers) for s in solids], axis=0)
    radii = inside + excess - _SLACK
    return np.hstack([centers, radii[:, None]])[inside > -1e-6]


class _Sampled:
    """The sample points of a search, and which spheres of a pool hold them.

    What a search finds does not depend on their order; it is quicker where those of a
    word lie near together.
    """

    def __init__(self, points: np.ndarray, solids: list[Solid], excess: float) -> None:
        self._order = _near_together(points, np.arange(len(points)))
        self.points, self._limits = points[self._order], (solids, excess)

    def able(self, pool: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Add a sphere at each sample that no candidate covers; return pool, rows."""
        return self._able(pool, np.empty((len(pool), 0), np.uint64))

    def with_more(self, points, pool, rows) -> tuple[np.ndarray, np.ndarray]:
        """Add samples (n, 3), and to pool and rows what they ask for."""
        whole = len(self.points) // 64  # words that stay as they are
        self._order = np.append(self._order, len(self.points) + np.arange(len(points)))
        self.points = np.vstack([self.points, points])
        return self._able(pool, rows[:, :whole])

    def _able(self, pool, rows) -> tuple[np.ndarray, np.ndarray]:
        rest = 64 * rows.shape[1]
        rows = np.hstack([rows, _rows(pool, self.points[rest:])])
        bits = np.bitwise_or.reduce(rows, axis=0).astype("<u8").view(np.uint8)
        held = np.unpackbits(bits, bitorder="little")[: len(self.points)]
        left = np.flatnonzero(held == 0)
        left = left[np.argsort(self._order[left])]
        added = _candidates(self.points[left], *self._limits)
        return np.vstack([pool, added]), np.vstack([rows, _rows(added, self.points)])


def _near_together(points: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Return ids of points in an order in which each 64 in turn lie near together."""
    if len(ids) <= 64:
        return ids
    axis = np.ptp(points[ids], axis=0).argmax()
    ids = ids[np.argsort(points[ids, axis], kind="stable")]
    half = 64 * ((len(ids) + 127) // 128)
    return np.concatenate(
        [_near_together(points, part) for part in (ids[:half], ids[half:])]
    )


def _rows(pool: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Return which sphere covers which sample, as bits (n_pool, words) uint64."""
    rows = np.empty((len(pool), (len(samples) + 63) // 64), np.uint64)
    centers, radii = np.array(pool[:, :3], order="C"), np.array(pool[:, 3])
    points, around = np.ascontiguousarray(samples.T), np.empty((rows.shape[1], 4))
    kernels.coverage(centers, radii, points, around, rows)
    return rows


def _pick(pool, rows, start: np.ndarray, rounds: int) -> np.ndarray:
    """Return indices of few spheres of the pool that cover all samples."""
    chosen = np.zeros(64 * rows.shape[1] + len(start) + 2, np.int64)
    chosen[: len(start)] = start
    few = 3 * MAX_SPHERES_PER_LINK // 2
    n = kernels.choose(rows, chosen, len(start), few, pool, rounds, _SEED)
    return chosen[:n]


def _holes(spheres, solid: Solid, excess: float) -> np.ndarray:
    """Return points of the solid that are well outside the spheres, (n, 3)."""
    found, stack = np.empty((64, 3)), np.empty((2000, 6))
    rule = np.array([2 * excess * _SLACK, excess / 12, excess / 3])
    squares = spheres[:, 3] ** 2
    n = kernels.holes(_region(solid), spheres, squares, rule, stack, found)
    return found[:n]


def _proved(spheres: np.ndarray, solids: list[Solid]) -> tuple[np.ndarray, np.ndarray]:
    """Return spheres grown until they hold the solids, and worst points."""
    stack, where, worst = np.empty((50_000, 6)), np.empty(3), [np.empty((0, 3))]
    squares, bound = spheres[:, 3] ** 2, 0.0
    for solid in solids:
        if _is_held(solid, spheres):
            continue
        power = kernels.worst_power(
            _region(solid), spheres, squares, _POWER_TOLERANCE, stack, where
        )
        if power < 0:
            raise BadRobot(
                "the sphere cover of a link cannot be proved; its collision geometry "
                "is too thin or too large: simplify it or give a larger cover_excess"
            )
        if power > _POWER_TOLERANCE:
            worst.append(where[None].copy())
        bound = max(bound, power)
    radii = np.sqrt(squares + bound) + _ROUNDING
    return np.hstack([spheres[:, :3], radii[:, None]]), np.vstack(worst)


def _is_held(solid: Solid, spheres: np.ndarray) -> bool:
    """Return True if a solid is a sphere that lies in one of the spheres.

    Boxes would have to be cut down to the tolerance all over its surface.
    """
    if solid.kind != SPHERE:
        return False
    far = np.linalg.norm(spheres[:, :3] - solid.T_body_solid[:3, 3], axis=1)
    return bool((far + solid.size[0] <= spheres[:, 3]).any())


def _needed(spheres, solids: list[Solid], samples: np.ndarray) -> np.ndarray:
    """Drop spheres that the others, as they have grown, make redundant; proved."""
    rows = _rows(spheres, samples)
    for i in range(len(spheres) - 1, -1, -1):
        others = np.bitwise_or.reduce(np.delete(rows, i, axis=0))
        if len(spheres) > 1 and (others == np.bitwise_or.reduce(rows)).all():
            grown, worst = _proved(np.delete(spheres, i, axis=0), solids)
            if len(worst) == 0:
                spheres, rows = grown, _rows(grown, samples)
    return spheres


def _region(solid: Solid) -> tuple[np.ndarray, ...]:
    """Return what the kernels take for a solid: half-spaces, ball and box."""
    outer = polytope(solid)
    low, high = -support(solid, -np.eye(3)) - 1e-6, support(solid, np.eye(3)) + 1e-6
    box = np.concatenate([(low + high) / 2, (high - low) / 2])
    if solid.kind != SPHERE:
        normals = np.ascontiguousarray(outer.normals)
        return normals, outer.offsets, np.array([0.0, 0.0, 0.0, 1e6]), box
    ball = np.array([*solid.T_body_solid[:3, 3], solid.size[0]])
    return np.empty((0, 3)), np.empty(0), ball, box


def _protrusion(spheres: np.ndarray, solids: list[Solid]) -> float:
    """Return the mean distance along the normal from the surface out of the cover [m].

    The surface is that of the union: what lies inside another solid does not count.
    """
    distances = []
    for solid in solids:
        points, normals = surface(solid, _SURFACE_SAMPLES)
        inside = [depth(s, points) > _INSIDE for s in solids if s is not solid]
        outer = ~np.any(inside, axis=0) if inside else np.ones(len(points), bool)
        points, normals = points[outer], normals[outer]
        rel = points[:, None, :] - spheres[None, :, :3]
        along = np.einsum("nsk,nk->ns", rel, normals)
        power = (rel**2).sum(axis=2) - spheres[:, 3] ** 2
        out = np.sqrt(np.maximum(along**2 - power, 0.0)) - along
        distances.append(np.where(power <= 0, out, 0.0).max(axis=1))
    return float(np.concatenate(distances).mean())
