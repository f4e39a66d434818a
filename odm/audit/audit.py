"""Try to falsify a map: exact geometry against what the map calls free."""

import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from odm.audit import _audit as kernels
from odm.audit.audit_library import (
    FAMILIES,
    SHARP,
    Specimen,
    as_frames_sample,
    draw_specimens,
    library_of,
)
from odm.audit.audit_report import AuditReport, Case
from odm.audit.audit_targets import audit_solids
from odm.cell_map.cell_map import CellMap
from odm.close_test._arm import make_work
from odm.close_test.close_test import NO_SOLIDS
from roadmap.builds.chunks import Progress
from roadmap.kinematics.forward import difference
from roadmap.transforms import pose_of_flat

CHUNK = 2000  # pairs of one unit of work; results do not depend on the threads
# the last two fifths of a chunk: children of its nearest pairs, in generations
PARENTS, CHILDREN, GENERATIONS = 8, 5, 20
N_WORST = 8  # cases of a report
EXACT_GAP = 1e-7  # [m] bounds nearer than this count as resolved
CAP = 0.1  # [m] larger separations are not resolved, where m is less than half of it


@dataclass(frozen=True, eq=False)
class Auditor:
    """Audits one map with one library of obstacles; see `audit`."""

    cell_map: CellMap
    seed: int
    close: bool
    specimens: tuple[Specimen, ...] = field(repr=False)

    @cached_property
    def library(self) -> kernels.Library:
        """The obstacles, laid out."""
        return library_of(self.specimens)

    @cached_property
    def sharp(self) -> np.ndarray:
        """(n,) True for obstacles whose samples lie rho behind the point that meets."""
        return np.array([s.family in SHARP for s in self.specimens])

    @cached_property
    def solids(self) -> kernels.Solids:
        """The robot's solids, with points to aim at."""
        return audit_solids(self.cell_map.robot, np.random.default_rng([self.seed, 2]))

    @cached_property
    def asked(self) -> kernels.Asked:
        """The map's arrays."""
        cell_map, roadmap = self.cell_map, self.cell_map.roadmap
        ends = np.asarray(roadmap.edges, np.int64)
        dq = difference(
            cell_map.robot, roadmap.nodes[ends[:, 0]], roadmap.nodes[ends[:, 1]]
        )
        cells = cell_map.arm_cells.by_item
        return kernels.Asked(
            cells.ptr, cells.block, cells.mask, roadmap.nodes, ends, dq, self.close,
            cell_map.motion_tolerance, cell_map.swept_radii(),
        )  # fmt: skip

    def draw(self, chunk: int, n: int) -> kernels.Pairs:
        """Return the random choices of a chunk; the same for the same seed."""
        rng = np.random.default_rng([self.seed, 3, chunk])
        roadmap = self.cell_map.roadmap
        motion = rng.integers(0, roadmap.n_edges, n) if roadmap.n_edges else None
        node = -1 - rng.integers(0, roadmap.n_nodes, n)
        motion = node if motion is None else np.where(rng.random(n) < 0.1, node, motion)
        obstacle = rng.integers(0, len(self.specimens), n)
        if self.sharp.any():
            chosen = rng.choice(np.flatnonzero(self.sharp), n)
            obstacle = np.where(rng.random(n) < 0.3, chosen, obstacle)
        ptr = self.library.aim_ptr
        aim = rng.integers(ptr[obstacle], ptr[obstacle + 1])
        wobble = rng.normal(size=(n, 6)) * _wobble_size(rng, n)[:, None]
        return kernels.Pairs(
            motion=motion,
            t=_places(rng, n),
            obstacle=obstacle,
            aim=aim,
            target=rng.integers(0, len(self.solids.targets), n),
            wobble=wobble,
            spin=rng.uniform(0, 2 * np.pi, n),
            shift=np.zeros((n, 3)),
            # a third of the rest begins in contact, to see that the map notices
            start=np.where(rng.random(n) < 0.55, np.nan, rng.uniform(-0.03, 0.3, n)),
        )

    def run_chunk(self, chunk: int, n: int) -> tuple[kernels.Pairs, kernels.Found]:
        """Ask and measure the pairs of a chunk, its nearest ones driven further in."""
        bred = PARENTS * CHILDREN
        generations = min(GENERATIONS, 2 * n // (5 * bred))
        pairs = self.draw(chunk, n - generations * bred)
        found = self.measure(pairs)
        rng = np.random.default_rng([self.seed, 4, chunk])
        for _ in range(generations):
            rows = _nearest_boundary_pairs(pairs, found, self.sharp)
            if len(rows) == 0:
                break
            children = mutated(pairs, np.resize(rows, bred), rng, self.cell_map)
            new = self.measure(children)
            pairs, found = _joined(pairs, children), _joined(found, new)
        return pairs, found

    def measure(self, pairs: kernels.Pairs) -> kernels.Found:
        """Ask the map about pairs, and measure those it calls free."""
        cell_map, n = self.cell_map, len(pairs.motion)
        found = kernels.Found(
            np.zeros(n, bool), np.zeros(n, bool), np.empty(n), np.empty(n),
            np.zeros(n, np.int64), np.empty((n, 12)),
        )  # fmt: skip
        cloud = cell_map.grid.new_cloud(int(np.diff(self.library.point_ptr).max()))
        work = make_work(cell_map.arm, cell_map.robot.dof)
        audited = kernels.Audited(self.asked, cell_map.arm, cloud, work, NO_SOLIDS)
        cap = max(CAP, 2.0 * cell_map.safety.m)
        kernels.audit_pairs(audited, self.solids, self.library, pairs, cap, found)
        return found

    def case(self, pairs: kernels.Pairs, found: kernels.Found, k: int) -> Case:
        """Return pair k of a chunk for a report."""
        motion, t = int(pairs.motion[k]), float(pairs.t[k])
        if motion < 0:
            q = self.asked.nodes[-1 - motion]
        else:
            start = self.asked.nodes[self.asked.edges[motion, 0]]
            q = start + t * self.asked.dq[motion]
        T = pose_of_flat(found.frame[k])
        robot, part = self.cell_map.robot, int(found.part[k])
        link = robot.link_names[robot.solid_link[part]] if part >= 0 else "no link"
        which = int(pairs.obstacle[k])
        family = self.specimens[which].family
        return Case(motion, t, q, family, which, T, link, float(found.distance[k]))


class Totals:
    """Sums chunks up, in their order."""

    def __init__(self, auditor: Auditor) -> None:
        self.auditor = auditor
        self.m = auditor.cell_map.safety.m
        self.complete = True
        self.count = dict.fromkeys(
            ("pairs", "free", "boundary", "violations", "unresolved"), 0
        )
        self.worst: list[Case] = []
        self.families = {name: [0, 0, 0, np.inf] for name in FAMILIES}

    def add(self, pairs: kernels.Pairs, found: kernels.Found) -> None:
        """Count a chunk."""
        low = np.where(found.free, found.distance, np.inf)
        bad = low + found.gap < self.m
        unsure = (low < self.m) & ~bad & (found.gap > EXACT_GAP)
        bad |= (low < self.m) & ~unsure
        count = self.count
        count["pairs"] += len(low)
        count["free"] += int(found.free.sum())
        count["boundary"] += int(found.boundary.sum())
        count["violations"] += int(bad.sum())
        count["unresolved"] += int(unsure.sum())
        self._keep_worst(pairs, found, low)
        names = np.array([FAMILIES.index(s.family) for s in self.auditor.specimens])
        for i, name in enumerate(FAMILIES):
            of_obstacle = names[pairs.obstacle] == i
            row = self.families[name]
            row[0] += int(of_obstacle.sum())
            row[1] += int(found.free[of_obstacle].sum())
            row[2] += int(bad[of_obstacle].sum())
            row[3] = min(row[3], float(low[of_obstacle].min(initial=np.inf)))

    def _keep_worst(self, pairs, found, low):
        """Keep the nearest pair of each of the nearest motions."""
        order = np.argsort(low, kind="stable")[: 50 * N_WORST]
        order = order[np.isfinite(low[order])]
        _, first = np.unique(pairs.motion[order], return_index=True)
        for k in order[np.sort(first)[:N_WORST]]:
            self.worst.append(self.auditor.case(pairs, found, int(k)))
        nearest = {}
        for case in sorted(self.worst, key=lambda c: c.distance):
            nearest.setdefault(case.motion, case)
        self.worst = list(nearest.values())[:N_WORST]

    def report(self, sabotage: str | None, seconds: float) -> AuditReport:
        """Return the sums."""
        auditor = self.auditor
        return AuditReport(
            asked="close test" if auditor.close else "cells",
            **self.count,
            smallest=self.worst[0].distance if self.worst else np.inf,
            m=self.m,
            worst=tuple(self.worst),
            families={k: tuple(v) for k, v in self.families.items()},
            seed=auditor.seed,
            seconds=seconds,
            sabotage=sabotage,
            complete=self.complete,
        )


def audit(
    cell_map: CellMap,
    *,
    pairs: int = 1_000_000,
    seed: int = 0,
    close: bool = False,
    threads: int = 0,
    sabotage: str | None = None,
    progress: Progress | None = None,
) -> AuditReport:
    """Compare what the map calls free with exact geometry.

    A pair is a configuration on a random edge or node, and a closed obstacle sampled
    with covering radius rho: an arm, needles, rods, plates, boxes, cylinders, balls
    down to 5 mm, meshes; it comes in towards a random point of a random link. About
    half of the obstacles are moved by bisection until the map just calls the motion
    free; there the true separation of the solids must be at least m. Where cells are
    asked, every other obstacle has the samples that a frame makes of shapes.

    Args:
        cell_map: The map.
        pairs: Number of pairs.
        seed: Same seed, same audit, for any number of threads.
        close: Ask the close test (what `is_free` uses) instead of the cells.
        threads: Worker threads; 0 means one per core.
        sabotage: "rho", "mu" or "sphere": spoil a small copy of the map and audit
            that instead; the audit must then fail.
        progress: Called with (stage, done, total).

    Returns:
        The report; after Ctrl-C that of the pairs done so far, not `complete`.
    """
    begun = time.perf_counter()
    tell = progress or (lambda stage, done, total: None)
    if sabotage is not None:
        from odm.audit.sabotage import spoiled

        cell_map = spoiled(cell_map, sabotage)
    tell("obstacles", 0, 1)
    n_specimens = int(np.clip(pairs // 500, 3 * len(FAMILIES), 30 * len(FAMILIES)))
    rng = np.random.default_rng([seed, 1])
    specimens = draw_specimens(n_specimens, cell_map.safety.rho, rng)
    if not close:  # every other one as shapes
        shapes = as_frames_sample(specimens[1::2], cell_map)
        specimens = tuple(
            shapes[k // 2] if k % 2 else one for k, one in enumerate(specimens)
        )
    auditor = Auditor(cell_map, seed, close, specimens)
    totals = Totals(auditor)
    try:
        _run(auditor, totals, pairs, threads, tell)
    except KeyboardInterrupt:
        totals.complete = False
    return totals.report(sabotage, time.perf_counter() - begun)


def _run(auditor, totals, pairs, threads, tell):
    from concurrent.futures import ThreadPoolExecutor

    sizes = [min(CHUNK, pairs - at) for at in range(0, pairs, CHUNK)]
    # made once, before the threads
    _ = auditor.library, auditor.solids, auditor.asked, auditor.sharp
    done = 0
    with ThreadPoolExecutor(threads or None) as pool:
        try:
            jobs = pool.map(auditor.run_chunk, range(len(sizes)), sizes)
            for size, result in zip(sizes, jobs, strict=True):
                totals.add(*result)
                done += size
                tell("pairs", done, pairs)
        except KeyboardInterrupt:
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def _joined(rows, more):
    return type(rows)(*map(np.concatenate, zip(rows, more, strict=True)))


def mutated(
    pairs: kernels.Pairs, rows: np.ndarray, rng: np.random.Generator, cell_map: CellMap
) -> kernels.Pairs:
    """Return pairs like `rows`, changed a little: place, point met, direction."""
    n = len(rows)
    scale = 10.0 ** rng.uniform(-2.0, 0.0, n)
    some = rng.random((3, n)) < 0.6
    child = kernels.Pairs(*(column[rows] for column in pairs))
    moved = child.t + 0.1 * scale * some[0] * rng.normal(size=n)
    step = (cell_map.safety.h * scale * some[1])[:, None]
    turned = (0.5 * scale * some[2])[:, None]
    return child._replace(
        t=np.clip(moved, 0.0, 1.0),
        shift=child.shift + step * rng.normal(size=(n, 3)),
        wobble=child.wobble + turned * rng.normal(size=(n, 6)),
        spin=child.spin + scale * rng.normal(size=n),
    )


def _nearest_boundary_pairs(
    pairs: kernels.Pairs, found: kernels.Found, sharp: np.ndarray
) -> np.ndarray:
    """Return the nearest boundary pair of each of the nearest motions.

    Half of the parents lie inside an edge: only there the motion bound is at stake. A
    quarter are of obstacles that are not sharp, which would never win otherwise.
    """
    rows = np.flatnonzero(found.boundary)
    rows = rows[np.argsort(found.distance[rows], kind="stable")]
    _, first = np.unique(pairs.motion[rows], return_index=True)
    rows = rows[np.sort(first)]
    inside = (pairs.motion[rows] >= 0) & (np.abs(pairs.t[rows] - 0.5) < 0.48)
    blunt = ~sharp[pairs.obstacle[rows]]
    quarter = PARENTS // 4
    parts = rows[inside][: 2 * quarter], rows[blunt][:quarter], rows[:quarter]
    return np.concatenate(parts)


def _places(rng, n):
    """Draw places on an edge: ends, middles of dyadic pieces, anywhere."""
    level = rng.integers(0, 7, n)
    middles = (2 * rng.integers(0, 2**level) + 1) / 2.0 ** (level + 1)
    kind = rng.random(n)
    t = np.where(kind < 0.6, middles, rng.random(n))
    return np.where(kind > 0.9, rng.integers(0, 2, n), t)


def _wobble_size(rng, n):
    """Half of the approaches are almost straight, the others anyhow."""
    return np.where(rng.random(n) < 0.5, 0.03, rng.choice([0.2, 1.0], n))
