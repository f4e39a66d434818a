"""From an open hand above a surface to closed fingers, without ever overlapping."""

from dataclasses import dataclass

import numpy as np

from handover.grasps import _closing as kernels
from handover.grasps.hand import Hand
from handover.grasps.objects import GraspObject
from handover.grasps.settings import HOLD
from odm.exact.distances import gather
from roadmap.geometry._winding import winding

_CHUNK = 16  # triangles with one ball around them
_LONGEST = 0.05  # [m] edge of a triangle


@dataclass(frozen=True, eq=False)
class Target:
    """An object ready for the kernels; see `target_of`."""

    # all its triangles, those that parts hide of each other too: nobody who stands
    # outside is nearer to these than to the union's surface
    mesh: kernels.MeshArrays
    parts: tuple[np.ndarray, ...]  # triangles (m, 3, 3) of each closed part [m]


def target_of(thing: GraspObject) -> Target:
    """Return an object's triangles in chunks of neighbours."""
    parts = thing.triangles()
    corners = _cut(np.concatenate(parts))
    rows = _chunks(corners.mean(axis=1), np.arange(len(corners)))
    order = np.concatenate(rows)
    balls = []
    for row in rows:
        points = corners[row].reshape(-1, 3)
        center = 0.5 * (points.min(axis=0) + points.max(axis=0))
        balls.append((*center, np.linalg.norm(points - center, axis=1).max() + 1e-12))
    facets = [(np.ascontiguousarray(corners[k]), 0.0, 0.0, 0.0) for k in order]
    mesh = kernels.MeshArrays(
        faces=gather(facets, order),
        first=np.cumsum([0, *map(len, rows)]),
        ball=np.array(balls),
    )
    return Target(mesh, tuple(np.ascontiguousarray(p) for p in parts))


def _cut(corners: np.ndarray) -> np.ndarray:
    """Return the triangles halved until they are short: a long one has a large ball."""
    done = []
    while len(corners):
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        long = edges.max(axis=1) > _LONGEST
        done.append(corners[~long])
        corners, first = corners[long], edges[long].argmax(axis=1)
        rows = np.arange(len(corners))
        p, q, r = (corners[rows, (first + k) % 3] for k in range(3))
        middle = 0.5 * (p + q)
        corners = np.concatenate(
            [np.stack([p, middle, r], axis=1), np.stack([middle, q, r], axis=1)]
        )
    return np.concatenate(done)


def _chunks(centers: np.ndarray, rows: np.ndarray) -> list[np.ndarray]:
    """Halve rows across their longest side until all are small."""
    if len(rows) <= _CHUNK:
        return [rows]
    axis = int(np.ptp(centers[rows], axis=0).argmax())
    rows = rows[np.argsort(centers[rows, axis], kind="stable")]
    half = len(rows) // 2
    return _chunks(centers, rows[:half]) + _chunks(centers, rows[half:])


def is_outside(
    hand: Hand, state: kernels.HandState, target: Target, gap: float
) -> bool:
    """Return whether the whole hand is outside of the object by `gap` [m]."""
    arrays, found = hand.arrays, np.full(2, -1)
    use = np.ones(len(arrays.local), bool)
    if kernels.clearance(arrays, state, use, target.mesh, gap, found) < gap:
        return False
    # no solid cuts the surface, so one of its points tells where it is
    ball, f = arrays.solids.ball, state.frames
    R = f[:, :9].reshape(-1, 3, 3)
    middles = np.einsum("mij,mj->mi", R, ball[:, :3]) + f[:, 9:]
    return not any(
        abs(winding(part, *middle)) > 0.5 for part in target.parts for middle in middles
    )


def close(
    hand: Hand, target: Target, T_object_palm: np.ndarray, shape: int, tolerance: float
) -> kernels.HandState | None:
    """Close a hand from a preshape: each finger to its first contact.

    A finger's joints close one after the other, base first, each until a link that it
    moves touches the object: what the first joint brings near, the next wraps around. A
    finger that touches nothing opens again. The hand of a gripper, both jaws on one
    joint, gives way until both touch.

    Args:
        hand: The hand.
        target: The object.
        T_object_palm: Where the palm is, (4, 4).
        shape: Which of its preshapes.
        tolerance: What counts as contact: at most this far, never overlapping [m].

    Returns:
        The closed hand, None where the open one is in the object, nothing is touched or
        the hand meets itself.
    """
    T = np.array(T_object_palm, float)
    for _ in range(HOLD.centred):
        state = hand.state(T, hand.preshapes[shape])
        if not is_outside(hand, state, target, tolerance):
            return None
        for finger in hand.fingers:
            _close_finger(hand, state, target, finger, shape, tolerance)
        shift = _shift(hand, state, target, tolerance)
        if shift is None:
            break
        T[:3, 3] += shift
    kernels.place(hand.arrays, state)
    if (state.touched < 0).all():
        return None
    found = np.empty(2, np.int64)
    return (
        None if kernels.meets_itself(hand.arrays, state, hand.pairs, found) else state
    )


def _close_finger(
    hand: Hand,
    state: kernels.HandState,
    target: Target,
    finger: tuple[int, ...],
    shape: int,
    tolerance: float,
) -> None:
    touched = False
    for d in finger:
        touched |= kernels.close_joint(
            hand.arrays, state, d, hand.closed[d], target.mesh, tolerance
        )
    if not touched:
        state.values[list(finger)] = hand.preshapes[shape, list(finger)]
        kernels.place(hand.arrays, state)


def _shift(
    hand: Hand, state: kernels.HandState, target: Target, tolerance: float
) -> np.ndarray | None:
    """Return how far a gripper gives way towards the jaw that touches, object frame.

    None: there is nothing to do, the joint slides no two links or both touch.
    """
    arrays = hand.arrays
    for d in np.flatnonzero(state.touched >= 0):
        jaws = np.flatnonzero((arrays.driver == d) & (arrays.kind == kernels.SLIDES))
        if len(jaws) != 2:
            continue
        gaps = []
        for jaw in jaws:
            use, found = arrays.solids.owner == jaw, np.full(2, -1)
            gaps.append(kernels.clearance(arrays, state, use, target.mesh, 0.2, found))
        near = int(np.argmin(gaps))
        if abs(gaps[0] - gaps[1]) <= tolerance:
            return None
        jaw = jaws[near]
        R = state.links[jaw, :9].reshape(3, 3)
        sign = np.sign(hand.closed[d] - hand.preshapes[0, d]) * arrays.scale[jaw, 0]
        closing = sign * (R @ arrays.axis[jaw])
        return -0.5 * abs(gaps[0] - gaps[1]) * closing
    return None
