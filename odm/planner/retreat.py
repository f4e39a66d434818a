"""Backing off and escape: a motion to offer while no path to a goal is free."""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from odm.checks import check_numbers, check_points
from odm.close_test import _close as close
from odm.close_test.close_test import NO_SOLIDS
from odm.close_test.sorted_clouds import SortedCloud
from odm.frame.frame import Frame
from odm.frame.link_test import LinkTest
from odm.obstacles._cloud import N_OCCUPIED
from odm.obstacles._solids import CAPSULE, Solids
from odm.obstacles.obstacles import Obstacles, SolidRoom, some_of, together
from odm.planner._retreat import Coming, next_better
from odm.planner.attaching import Attacher
from odm.planner.settings import RetreatSettings
from roadmap.errors import BadInput
from roadmap.geometry.gaps import ball_gaps, moved_rods
from roadmap.motion.blended_path import check_scale
from roadmap.ranges import check_kind, is_between

_LONGEST_S = 1e9  # from now until somebody comes
_WITHIN = 1e-6  # what sticks out of a capsule by less is in it [m]


class Retreat:
    """Finds motions away from the frame's points, or from what comes."""

    def __init__(
        self,
        frame: Frame,
        attacher: Attacher,
        settings: RetreatSettings = RetreatSettings(),
    ) -> None:
        self.frame, self.attacher, self.settings = frame, attacher, settings
        self.links = LinkTest(frame)
        self._rooms: list[tuple[SortedCloud, SolidRoom]] = []
        self._others = SortedCloud(frame.cell_map.grid)

    def back_off(self, q: np.ndarray) -> np.ndarray | None:
        """Return a (2, dof) motion from q that gets away from the frame's points.

        Where no sphere is nearer than its radius + rho + m, the motion is free as any
        other (back off). Where one is, the motion is one along which no sphere comes
        nearer to any such point than it is now (escape), and no link either, by its
        shell (`Shells.leave`). It is also free of limits, self-collision and scenery.
        None where nothing is near or nothing helps.
        """
        frame, s = self.frame, self.settings
        if frame.memory.cloud.counts[N_OCCUPIED] == 0:
            return None
        now = frame.separation(q)
        if now > s.near:
            return None
        best, found = now + s.min_gain, None
        escape, leave = self._place_anchor(q), None
        for node in self.attacher.nearest(q, s.tried):
            dq = frame.difference(q, frame.cell_map.roadmap.nodes[node])
            for share in s.shares:
                end = q + share * dq
                gap = frame.separation(end)
                if gap <= best:
                    continue
                if not self._is_clear(q, share * dq, escape):
                    continue
                if escape and leave is None:
                    leave = self._links_leave(q)
                if leave is None or leave(share * dq):
                    best, found = gap, np.stack([q, end])
                    break
        return found

    def evasion(
        self,
        q: np.ndarray,
        coming: Sequence[tuple[float, np.ndarray | Obstacles]],
        speed_scale: float,
    ) -> np.ndarray | None:
        """Return a (2, dof) motion from q away from obstacles that come, or None.

        It is free of what is in the frame, or no sphere comes nearer to it than now. Of
        the motions to near nodes it keeps most distance: at each of the given times the
        robot, as far as it has come, is compared with the obstacles of that time. The
        first motion that keeps plenty is taken; it must gain clearly over standing
        still. None, too, where the last frame could not be used or one of `coming` is
        not finite.

        Args:
            q: (dof,) where the robot stands.
            coming: Times from now [s], each with the shapes, or the points (n, 3)
                float64, that are expected then [m].
            speed_scale: Share of the joints' speed limits that it will use, (0, 1].

        Raises:
            BadInput: Wrong shape, dtype or length, a q or a time that is not finite, or
                a share outside (0, 1].
        """
        check_scale(speed_scale)
        frame, s = self.frame, self.settings
        q = check_numbers(frame.robot, q)
        _check_coming(coming)
        there = self._laid_out([what for _, what in coming])
        if frame.trouble is not None or there is None:
            return None
        times = np.array([max(0.0, t - s.reaction_s) for t, _ in coming])
        fastest = speed_scale * frame.robot.max_velocity
        ample = frame.keep + s.ample_margin
        expected = _Expected(frame, *there, times, fastest, ample)
        stays = expected.better(q, np.zeros((1, len(q))), 0, -np.inf)
        best, found = stays[1] + s.min_evasion_gain, None
        if best >= ample:
            return None
        escape = self._place_anchor(q)
        nodes = self.attacher.nearest(q, s.directions)
        dq = frame.difference(q, frame.cell_map.roadmap.nodes[nodes])
        # no farther than it gets by then
        longest = times.max(initial=0.0)
        dq *= np.minimum(1.0, longest / expected.durations(dq))[:, None]
        k = -1
        while True:
            k, gap = expected.better(q, dq, k + 1, best)
            if k == len(dq):
                return found
            if self._is_clear(q, dq[k], escape):
                best, found = gap, np.stack([q, q + dq[k]])
                if best >= ample:
                    return found

    def clear_of_others(self, path: np.ndarray, extra: float, rods: np.ndarray) -> bool:
        """Whether a motion away is clear of what the frame holds beside some capsules.

        See `ReactivePlanner.clear_of_others`.
        """
        frame = self.frame
        if frame.trouble is not None or not np.isfinite(path).all():
            return False
        if not math.isfinite(extra):
            return False
        self._place_anchor(path[0])
        legs = [(q, frame.difference(q, to)) for q, to in pairwise(path)]
        legs = legs or [(path[0], np.zeros_like(path[0]))]
        if all(frame.motion_clear(*leg, more=extra, escape=True) for leg in legs):
            return True  # mostly nothing is near
        rods, points = moved_rods(rods, frame.base_world), frame.points[: frame.n_given]
        rods = rods[np.isfinite(rods).all(axis=1)]
        cloud, bad = self._others.of_all(points[~_points_within(points, rods)])
        solids = some_of(frame.solids, ~_solids_within(frame.solids, rods))
        test = frame.close_test_with(extra)
        return not bad and all(test.clear(*leg, cloud, True, solids) for leg in legs)

    def _laid_out(
        self, sets: Sequence[np.ndarray | Obstacles]
    ) -> tuple[list[object], Solids, np.ndarray] | None:
        """Return sets as clouds and solids, and whose those are; None: one is nowhere.

        They are not in the room of the frame's, which stay as they are.
        """
        frame, points, solids = self.frame, [], []
        while len(self._rooms) < len(sets):
            self._rooms.append((SortedCloud(frame.cell_map.grid), SolidRoom()))
        for given, (_, room) in zip(sets, self._rooms, strict=False):
            shapes = NO_SOLIDS
            if isinstance(given, Obstacles):
                shapes = room.of(given, frame.base_world)
                given = given.points
            given = check_points(given, None, None, frame.rho)
            if shapes is None or not np.isfinite(given).all():
                return None
            points.append(frame.world_ahead.points(given).copy())
            solids.append(shapes)
        pairs = zip(self._rooms, points, strict=False) if any(map(len, points)) else ()
        return [cloud.of(own) for (cloud, _), own in pairs], *together(solids)

    def _place_anchor(self, q: np.ndarray) -> bool:
        """Remember where the spheres are at q; return whether a point is too near."""
        m = self.frame.memory
        close.place_anchor(m.arm, q, m.work)
        return bool(self.frame.separation(q) < self.frame.keep)

    def _links_leave(self, q: np.ndarray) -> Callable[[np.ndarray], bool]:
        """Return a test of motions dq from q: no link comes nearer than it must."""
        frame, links = self.frame, self.links
        # from farther points no sphere is nearer than it must be anyway
        links.show_near(q, frame.radii + close.ESCAPE_SLACK)
        shells = links.shells
        needs = shells.needs(q, frame.keep_from_shapes)
        return lambda dq: shells.leave(q, dq, needs)

    def _is_clear(self, q: np.ndarray, dq: np.ndarray, escape: bool) -> bool:
        dq = np.ascontiguousarray(dq)
        clear = self.frame.motion_clear(q, dq, escape=escape)
        return clear and self.frame.static.motion_free(q, dq)


def _points_within(points: np.ndarray, rods: np.ndarray) -> np.ndarray:
    """Return (n,) which points (n, 3) a capsule of rods (k, 7) holds."""
    within = np.zeros(len(points), bool)
    if len(rods):
        grown = rods[:, 6:] + _WITHIN
        low = (np.minimum(rods[:, :3], rods[:, 3:6]) - grown).min(axis=0)
        high = (np.maximum(rods[:, :3], rods[:, 3:6]) + grown).max(axis=0)
        # of a camera's points most are elsewhere
        (some,) = ((points >= low) & (points <= high)).all(axis=1).nonzero()
        balls = np.c_[points[some], np.zeros(len(some))]
        within[some] = (ball_gaps(balls, rods) <= _WITHIN).any(axis=1)
    return within


def _solids_within(solids: Solids, rods: np.ndarray) -> np.ndarray:
    """Return (n,) which solids are capsules that one of rods (k, 7) holds wholly.

    It does if it holds the balls at both ends: then all between them, too.
    """
    n = int(solids.count[0])
    rows, round_ = solids.rows[:n], solids.kind[:n] == CAPSULE
    a, radius = rows[:, :3], rows[:, 6:7]
    ends = np.c_[a, radius], np.c_[a + rows[:, 3:6], radius]
    held = [ball_gaps(end, rods) <= _WITHIN - 2.0 * radius for end in ends]
    return round_ & (held[0] & held[1]).any(axis=1)


def _check_coming(coming: Sequence[tuple[float, object]]) -> None:
    check_kind("coming", coming, Sequence, "give [(seconds, shapes or points)]")
    for one in coming:
        if not (isinstance(one, Sequence) and len(one) == 2):
            raise BadInput(f"coming holds {one!r}; give (seconds, obstacles)")
        if not is_between(one[0], -_LONGEST_S, _LONGEST_S):
            raise BadInput(
                f"{one[0]!r} in coming is no time, or a time that is not finite; "
                "give seconds from now"
            )


class _Expected(NamedTuple):
    """What is expected where, and how fast the robot may evade it."""

    frame: Frame
    clouds: list[object]  # points at each of the times; none: nowhere are any
    solids: Solids  # at all of them
    ptr: np.ndarray  # (times + 1,) which are there at a time
    times: np.ndarray  # from now [s]
    fastest: np.ndarray  # (dof,) speed of the joints [rad or m per s]
    ample: float  # more distance is no better [m]

    def durations(self, dq: np.ndarray) -> np.ndarray:
        """Return (k,) how long motions (k, dof) take [s]."""
        return np.maximum(np.abs(dq / self.fastest).max(axis=1), 1e-9)

    def better(
        self, q: np.ndarray, dq: np.ndarray, first: int, best: float
    ) -> tuple[int, float]:
        """Return the first motion of (k, dof) that keeps more than `best` [m].

        And how much; from number `first` on; k where none does.
        """
        memory, needed = self.frame.memory, self.durations(dq)
        coming = Coming(self.solids, self.ptr, self.times)
        while True:
            bounds = np.array([first, best, self.ample])
            arguments = (memory.arm, coming, q, dq, needed, bounds, memory.work)
            k, gap = next_better(*arguments)
            if k == len(dq) or not self.clouds:
                return k, gap
            gap = self._from_points(q, dq[k], needed[k], gap, best)
            if gap > best:
                return k, gap
            first = k + 1

    def _from_points(
        self, q: np.ndarray, dq: np.ndarray, needed: float, gap: float, least: float
    ) -> float:
        """Return the least distance from points, at most `gap`, or one below `least`.

        As of solids, those of the last moment first.
        """
        test = self.frame.close_test
        for t, cloud in zip(self.times[::-1], self.clouds[::-1], strict=True):
            at = q + min(1.0, t / needed) * dq
            gap = min(gap, test.separation(at, cloud, gap))
            if gap <= least:
                break
        return gap
