"""The path of a motion: its pieces, and the limits of the arc length on each."""

from bisect import bisect_right
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from roadmap.arrays import brief
from roadmap.errors import BadInput
from roadmap.kinematics.forward import unwrapped
from roadmap.motion.blending import (
    Piece,
    blend_path,
    scalar_limits,
    slowing_limit,
    without_gaps,
)
from roadmap.motion.timing import State
from roadmap.ranges import is_between
from roadmap.robot.joint_values import check_values
from roadmap.robot.robot import Robot

SAME = 1e-9
NEAR = 1e-7  # rounding of profiles [rad or m of joint space]


class Corner(NamedTuple):
    """A corner of a path: its arc length, where its blend begins, and its (dof,) q."""

    s: float
    begin: float
    q: np.ndarray


@dataclass(frozen=True, eq=False)
class BlendedPath:
    """Pieces with the limits of the arc length on them.

    Attributes:
        robot: Whose limits they are.
        pieces: In order, each from the end of the one before.
        joint_speed: (n,) highest speed by the joints' velocities [rad/s or m/s].
        turning_speed: (n,) the same by what turning on a blend takes; infinite on
            straight pieces.
        a, j: (n,) acceleration and jerk.
        deviation: No centre of the cover is farther from the corner path [m].
        home: (dof,) where a path without pieces stands.
    """

    robot: Robot
    pieces: tuple[Piece, ...]
    joint_speed: np.ndarray
    turning_speed: np.ndarray
    a: np.ndarray
    j: np.ndarray
    deviation: float
    home: np.ndarray

    __repr__ = brief

    @classmethod
    def of(
        cls, robot: Robot, pieces: tuple[Piece, ...], deviation: float, home: np.ndarray
    ) -> "BlendedPath":
        """Return the path over some pieces, with the limits of a robot."""
        if not pieces:
            none = np.zeros(0)
            return cls(robot, (), none, none, none, none, 0.0, home)
        pieces = without_gaps(pieces)
        return cls(robot, pieces, *scalar_limits(pieces, robot), deviation, home)

    def gentler(self, jerk_scale: float) -> "BlendedPath":
        """Return the same path with a share of the joints' jerk limits, in (0, 1]."""
        if not self.pieces:
            return self
        speed, turning, a, j = scalar_limits(self.pieces, self.robot, jerk_scale)
        return replace(self, joint_speed=speed, turning_speed=turning, a=a, j=j)

    def index(self, s: float) -> int:
        """Return the piece that holds arc length `s`."""
        return max(0, bisect_right(self._begins, s) - 1)

    @cached_property
    def _begins(self) -> list[float]:
        return [p.begin for p in self.pieces]

    def index_of(self, state: State) -> int:
        """Return the piece a state is on; without acceleration, a next one counts."""
        slack = NEAR if abs(state.a) < NEAR else 0.0
        return self.index(state.s + slack)

    def at(self, s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, dq/ds and d2q/ds2 (dof,) at arc length `s`."""
        if not self.pieces:
            none = np.zeros_like(self.home)
            return self.home, none, none
        return self.pieces[self.index(s)].at(s)

    def at_all(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what `at` does at (n,) arc lengths, (n, dof) each."""
        found = np.zeros((3, len(s), len(self.home)))
        if not self.pieces:
            found[0] = self.home
            return found[0], found[1], found[2]
        index = np.maximum(0, np.searchsorted(self._begins, s, side="right") - 1)
        for k in np.unique(index):
            here = np.flatnonzero(index == k)
            found[:, here] = self.pieces[k].at_all(s[here])
        return found[0], found[1], found[2]

    def behind_blend(self, s: float, end: float) -> float:
        """Return the first arc length from `s` on at which another path may well begin.

        Not on a blend, where it would lead off at an angle, but far enough behind one
        for a corner there to be rounded; at most `end`.
        """
        for k in range(self.index(s), len(self.pieces)):
            piece = self.pieces[k]
            if piece.d == 0.0:
                lead = self.pieces[k - 1].d if k else 0.0
                return min(max(s, piece.begin + min(lead, piece.length)), end)
        return min(s, end)

    @cached_property
    def corners(self) -> list[Corner]:
        """The corners of the path, the end as the last one."""
        corners = []
        for k, p in enumerate(self.pieces):
            if p.d > 0.0:
                corners.append(Corner(p.anchor + p.d, p.anchor, p.corner()))
            elif k and self.pieces[k - 1].d == 0.0:
                corners.append(Corner(p.begin, p.begin, p.at(p.begin)[0]))
        if self.pieces:
            end = self.pieces[-1].end
            corners.append(Corner(end, end, self.at(end)[0]))
        return corners

    def along(self, s: float, path: np.ndarray) -> "tuple[int, float]":
        """Return how far a corner path keeps to this one.

        Args:
            s: Arc length of its first corner.
            path: (k, dof) corners [rad or m].

        Returns:
            Index of the last corner to which this path leads over the same corners and
            where a blend, if any, begins behind `s`; and its arc length. (0, s): none.
        """
        ahead = [corner for corner in self.corners if corner.s > s + NEAR]
        first = 1
        while first < len(path) and np.abs(path[first] - path[0]).max() <= NEAR:
            first += 1
        begun = 0  # corners whose blend has begun: of two that nearly are one, both
        while begun < len(ahead) and ahead[begun].begin < s - NEAR:
            begun += 1
        for skip in range(begun + 1):  # the path may leave such corners out
            kept = _common(ahead[skip:], path[first:])
            if kept > begun - skip:
                return first + kept - 1, ahead[skip + kept - 1].s
        return 0, s

    def to_corner(self, begin: float, s: float) -> "BlendedPath":
        """Return the part from `begin` to the corner at arc length `s`, not rounded."""
        kept = [p for p in self.pieces if p.end > begin + SAME and p.begin < s - SAME]
        if kept and kept[-1].d > 0.0 and kept[-1].anchor + kept[-1].d > s - NEAR:
            kept.pop()
        if kept and kept[-1].d > 0.0:  # no straight piece is between two blends
            last = kept[-1]
            at = last.at(last.end)[0]
            kept.append(Piece(last.end, s, at, last.end, last.w, last.w, 0.0))
        pieces = tuple(p.cut(begin, s) for p in kept[:-1])
        pieces += tuple(replace(p.cut(begin, s), end=s) for p in kept[-1:])
        return BlendedPath.of(self.robot, pieces, self.deviation, self.home)

    def slowing(self, k: int, v: float) -> float:
        """Return the acceleration for slowing down on piece k from speed v or less.

        It counts on piece k being entered within its own speeds.
        """
        piece, a = self.pieces[k], self.a.item(k)
        if piece.d == 0.0:
            return a
        v = min(v, self.fastest(k))
        return max(a, slowing_limit(piece, self.robot, v))

    def fastest(self, k: int) -> float:
        """Return the highest speed on piece k."""
        return min(self.joint_speed.item(k), self.turning_speed.item(k))

    def steady_speed(self, state: State) -> float:
        """Return the speed once the acceleration of a state has ended."""
        return state.v + state.a * abs(state.a) / (2.0 * self.j[self.index_of(state)])

    @cached_property
    def stops(self) -> np.ndarray:
        """Which ends of the pieces (n + 1,) must be passed at rest."""
        sharp = [
            bool(np.abs(a.w - b.u).max() > SAME)
            for a, b in zip(self.pieces, self.pieces[1:], strict=False)
        ]
        return np.array([False, *sharp, True])

    def joined(
        self, path: np.ndarray, s: float, blend: float, available: float
    ) -> "BlendedPath":
        """Return this path followed by a corner path.

        Args:
            path: (k, dof) corners; the first one is the end of this path.
            s: Arc length of the first one.
            blend: No centre of the cover gets farther from the corner path [m].
            available: Length of this path that the blend of the first corner may take;
                0: it stays sharp.
        """
        pieces, off = blend_path(self.robot, path, blend, self.pieces, s, available)
        return BlendedPath.of(self.robot, pieces, max(off, self.deviation), path[0])

    def part(self, begin: float, end: float) -> "BlendedPath":
        """Return the part between two arc lengths; its limits stay."""
        kept = [
            k
            for k, p in enumerate(self.pieces)
            if p.end > begin + SAME and p.begin < end - SAME
        ]
        return BlendedPath(
            self.robot,
            tuple(self.pieces[k].cut(begin, end) for k in kept),
            self.joint_speed[kept],
            self.turning_speed[kept],
            self.a[kept],
            self.j[kept],
            self.deviation,
            self.at(end)[0],
        )


def _common(corners: list[Corner], path: np.ndarray) -> int:
    """Return how many of the first corners are the same."""
    kept = 0
    for corner, q in zip(corners, path, strict=False):
        if np.abs(corner.q - q).max() > NEAR:
            break
        kept += 1
    return kept


def unwound(robot: Robot, path: np.ndarray) -> np.ndarray:
    """Return a path (k, dof) checked, continuous joints going the short way.

    Corners that are no farther apart than rounding count as one: shorter legs have
    limits that a profile cannot keep.
    """
    try:
        path = np.array(path, float)
    except (TypeError, ValueError, OverflowError) as error:
        raise BadInput(
            f"what was given as a path ({type(path).__name__}) holds no numbers; give "
            f"(k, {robot.dof}) corners, such as answer.path"
        ) from error
    if path.ndim != 2 or len(path) < 1 or path.shape[1] != robot.dof:
        raise BadInput(
            f"a path has the shape {path.shape}; give (k, {robot.dof}) corners, k >= 1"
        )
    check_values(robot, path, "the path")
    return _apart(unwrapped(robot, path))


def _apart(path: np.ndarray) -> np.ndarray:
    """Return the corners (k, dof) less those beside the one before; both ends stay."""
    if (np.linalg.norm(np.diff(path, axis=0), axis=1) > NEAR).all():
        return path
    kept, last = [0], len(path) - 1
    for k in range(1, last):
        if np.linalg.norm(path[k] - path[kept[-1]]) > NEAR:
            kept.append(k)
    while len(kept) > 1 and np.linalg.norm(path[last] - path[kept[-1]]) <= NEAR:
        kept.pop()
    return path[[*kept, last]]


def check_scale(scale: float, of: str = "speed") -> None:
    """Refuse what is no share of the velocity limits, or those that `of` names."""
    if not (is_between(scale, 0.0, 1.0) and scale > 0.0):
        raise BadInput(f"a {of} scale of {scale} is no share; give (0, 1]")
