"""Blended paths: straight pieces of joint space, and blends that round the corners.

A blend of half-length d replaces the corner between unit directions u and w by

    q'(x) = u + (w - u) (3 x^2 - 2 x^3),  x = s / (2 d) in [0, 1],

which starts d before the corner and ends d behind it. Direction and curvature are
continuous, and the blend is beside the corner path along w - u alone, by 3/16 d |w - u|
at most.

How long may d be? Two bounds on how far any sphere centre deviates are proved, and the
better one is taken: how far each joint deviates times the most that it can move any
centre (`joint_motion_bounds`), whatever the configuration; and what they do at the
corner's own configuration, where some of it cancels (`roadmap.kinematics._deviation`).
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from roadmap.kinematics._deviation import BLEND_DEVIATION, CoverModel, longest_blend
from roadmap.kinematics.forward import motion_per_joint
from roadmap.robot.robot import Robot

# Shares of the joints' limits in a blend: what following the curve takes at constant
# speed, and what is left for speeding up and slowing down on it.
TURN_A, ALONG_A = 0.6, 0.4  # of the acceleration
TURN_J, MIXED_J, ALONG_J = 0.4, 0.3, 0.3  # of the jerk
SHORTEST = 1e-9  # [rad or m] shorter pieces are dropped


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of a path over the arc lengths begin..end.

    Attributes:
        begin, end: Arc length of its ends [rad or m of joint space].
        origin: (dof,) configuration at arc length `anchor`.
        anchor: Arc length at which the curve starts; `begin` unless it was cut.
        u, w: (dof,) unit directions at the start and the end of the curve.
        d: Half-length of a blend; 0 for a straight piece, whose w is u.
    """

    begin: float
    end: float
    origin: np.ndarray
    anchor: float
    u: np.ndarray
    w: np.ndarray
    d: float

    def at(self, s: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, dq/ds and d2q/ds2 at arc length `s`."""
        along = s - self.anchor
        if self.d == 0.0:
            return self.origin + along * self.u, self.u, np.zeros(self.u.shape)
        x = along / (2.0 * self.d)
        turn = self.w - self.u
        q = self.origin + along * self.u + 2.0 * self.d * x**3 * (1.0 - 0.5 * x) * turn
        return (
            q,
            self.u + x * x * (3.0 - 2.0 * x) * turn,
            6.0 * x * (1.0 - x) / (2.0 * self.d) * turn,
        )

    def at_all(self, s: np.ndarray) -> np.ndarray:
        """Return what `at` does at (n,) arc lengths, (3, n, dof), to the last bit."""
        along, found = (s - self.anchor)[:, None], np.empty((3, len(s), len(self.u)))
        found[0], found[1], found[2] = self.origin + along * self.u, self.u, 0.0
        if self.d == 0.0:
            return found
        x = along / (2.0 * self.d)
        turn = self.w - self.u
        # the power of an array may be rounded otherwise than that of a number
        cube = np.array([[y**3] for y in x.ravel().tolist()])
        found[0] += 2.0 * self.d * cube * (1.0 - 0.5 * x) * turn
        found[1] += x * x * (3.0 - 2.0 * x) * turn
        found[2] = 6.0 * x * (1.0 - x) / (2.0 * self.d) * turn
        return found

    def corner(self) -> np.ndarray:
        """Return the (dof,) corner that a blend rounds."""
        return self.origin + self.d * self.u

    def cut(self, begin: float, end: float) -> "Piece":
        """Return the part of it between two arc lengths."""
        return replace(self, begin=max(self.begin, begin), end=min(self.end, end))

    @property
    def length(self) -> float:
        """Arc length."""
        return self.end - self.begin

    @cached_property
    def steepest(self) -> np.ndarray:
        """(dof,) largest |dq/ds| of each joint, a little above 0."""
        return np.maximum(np.maximum(np.abs(self.u), np.abs(self.w)), SHORTEST)

    @cached_property
    def bend(self) -> np.ndarray:
        """(dof,) largest |d2q/ds2| of each joint on a blend, a little above 0."""
        return np.maximum(np.abs(self.w - self.u), SHORTEST) * (0.75 / self.d)


@lru_cache(maxsize=8)
def joint_motion_bounds(robot: Robot) -> np.ndarray:
    """Return (dof,) how far a joint moves any centre of the cover, per rad or m."""
    bounds = motion_per_joint(robot.tree_i, robot.tree_f, robot.sphere_reach, robot.dof)
    bounds.setflags(write=False)
    return bounds


def blend_path(
    robot: Robot,
    path: np.ndarray,
    blend: float,
    before: tuple[Piece, ...] = (),
    at: float = 0.0,
    available_before: float = 0.0,
) -> tuple[tuple[Piece, ...], float]:
    """Return the pieces of a corner path, and how far they deviate from it [m].

    Args:
        robot: Whose cover it is.
        path: (k, dof) corners; with `before`, the first one is where that ends.
        blend: No centre of the cover deviates farther than this [m]; 0: no blends.
        before: Pieces that lead to the path; the last one is blended with the first
            leg of the path where it is straight.
        at: Arc length at which the path starts.
        available_before: What the first blend may take of the end of `before`.
    """
    pieces = list(before)
    if pieces:
        at = pieces[-1].end
    legs = np.diff(path, axis=0)
    lengths = np.linalg.norm(legs, axis=1).tolist()
    deviation = 0.0
    for k in range(len(legs)):
        if not lengths[k] > SHORTEST:
            continue
        u = legs[k] / lengths[k]
        straight = Piece(at, at + lengths[k], path[k], at, u, u, 0.0)
        at = straight.end
        if pieces and pieces[-1].d == 0.0 and blend > 0.0:
            # each corner may take half of the legs that meet in it
            available = 0.5 * min(pieces[-1].length, lengths[k])
            if len(pieces) == len(before):
                available = min(available_before, pieces[-1].length, 0.5 * lengths[k])
            d, off = blend_length(robot, path[k], pieces[-1].u, u, available, blend)
            if off > 0.0 and d > 10.0 * SHORTEST and u @ pieces[-1].u > -0.999:
                pieces[-1:], straight = _rounded(pieces[-1], straight, d)
                deviation = max(deviation, off)
        pieces.append(straight)
    return tuple(p for p in pieces if p.length > SHORTEST), deviation


def blend_length(
    robot: Robot,
    corner: np.ndarray,
    u: np.ndarray,
    w: np.ndarray,
    available: float,
    blend: float,
) -> tuple[float, float]:
    """Return the half-length of a corner's blend, and how far it deviates at most [m].

    `u` and `w` (dof,) are the unit directions before and behind the corner. At most
    `available` is taken [rad or m of joint space], and no centre of the robot's cover
    deviates farther than `blend` [m].
    """
    far = BLEND_DEVIATION * float(joint_motion_bounds(robot) @ np.abs(w - u))
    d = available if far * available <= blend else blend / far
    if far == 0.0:
        return d, 0.0
    cover = CoverModel(
        robot.tree_i, robot.tree_f, robot.spheres, robot.sphere_body, robot.sphere_reach
    )
    longer, deviation = longest_blend(
        cover, corner, u, w, float(available), float(blend)
    )
    if longer < d:
        return d, far * d
    return longer, min(deviation, far * longer)


def without_gaps(pieces: tuple[Piece, ...]) -> tuple[Piece, ...]:
    """Return the pieces, each from the end of the one before on.

    Between two of them a piece of no length to speak of may have been dropped.
    """
    ends = [pieces[0].begin, *(piece.end for piece in pieces[:-1])]
    return tuple(
        piece if piece.begin == end else replace(piece, begin=end)
        for piece, end in zip(pieces, ends, strict=True)
    )


def _rounded(a: Piece, b: Piece, d: float) -> tuple[list[Piece], Piece]:
    """Return ([rest of a, the blend], rest of b) with the corner rounded."""
    begin = a.end - d
    origin = a.at(begin)[0]
    blend = Piece(begin, a.end + d, origin, begin, a.u, b.u, d)
    rest = replace(b, begin=b.begin + d)
    return [replace(a, end=begin), blend], rest


def slowing_limit(piece: Piece, robot: Robot, v: float) -> float:
    """Return the acceleration with which a blend may be slowed down on, from speed v.

    In `scalar_limits` the acceleration is what turning leaves at the highest speed. A
    robot that only slows down has what turning leaves at its present one:
    |q''| v^2 + |q'| |a| within the acceleration, 3 |q''| v |a| within its share of the
    jerk.
    """
    steepest, bend = piece.steepest, piece.bend
    left = (robot.max_acceleration - v * v * bend) / steepest
    mixed = MIXED_J / (3.0 * max(v, SHORTEST)) * robot.max_jerk / bend
    return min(*left.tolist(), *mixed.tolist())


def scalar_limits(
    pieces: tuple[Piece, ...], robot: Robot, jerk_scale: float = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the arc length's limits by piece (n,): two of speed, acceleration, jerk.

    The first speed is that of the joints' velocity limits, the second that of turning
    on a blend, infinite on straight pieces. Within them every joint keeps its own
    limits on every piece:
    ddq = q'' v^2 + q' a and dddq = q''' v^3 + 3 q'' v a + q' j. Of the joints' jerk
    limits the share `jerk_scale` is used.
    """
    max_jerk = jerk_scale * robot.max_jerk
    u, w = np.array([p.u for p in pieces]), np.array([p.w for p in pieces])
    steepest = np.maximum(np.abs(u), np.abs(w))
    turn = np.abs(w - u)
    d = np.array([p.d for p in pieces])
    blends = d > 0.0
    share_a = np.where(blends, ALONG_A, 1.0)
    share_j = np.where(blends, ALONG_J, 1.0)
    with np.errstate(divide="ignore"):
        v = (robot.max_velocity / steepest).min(axis=1)
        a = share_a * (robot.max_acceleration / steepest).min(axis=1)
        j = share_j * (max_jerk / steepest).min(axis=1)
        turning = np.full(len(pieces), np.inf)
        if blends.any():
            second = 1.5 / (2.0 * d[blends, None]) * turn[blends]  # largest |q''|
            third = 6.0 / (2.0 * d[blends, None]) ** 2 * turn[blends]  # and |q'''|
            slowest = np.minimum.reduce(
                [
                    np.sqrt(TURN_A * robot.max_acceleration / second),
                    np.cbrt(TURN_J * max_jerk / third),
                ]
            ).min(axis=1)
            turning[blends] = slowest
            fastest = np.minimum(v, turning)[blends, None]
            mixed = MIXED_J * max_jerk / (3.0 * second * fastest)
            a[blends] = np.minimum(a[blends], mixed.min(axis=1))
    return v, turning, a, j
