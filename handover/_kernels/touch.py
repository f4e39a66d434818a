"""Self-collision of very many configurations: tables for pairs of one or two joints.

A robot has pairs of links that are always near each other, and whose place depends on
one or two joints only: the solids of a wrist. Their distance is looked up: cells of a
table over these joints that are proved clear as a whole, by the distance in the middle
and the most that the links can move inside the cell.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap._kernels.gjk import separation
from roadmap._kernels.kinematics import body_frames
from roadmap._kernels.self_collision import pair_clearance

TABLE = 64  # cells along a joint
MARGIN = 1e-4  # [m] that links keep from each other


class Touch(NamedTuple):
    """What self-collision is tested with; no pairs: not at all.

    Attributes:
        model: as in `roadmap.self_collision.SelfCollision`.
        frames: (n_bodies, 12) work space.
        axes: (n_pairs, 3) separating direction of the last call.
        simplex: (16, 3) work space.
        places: (n_shells, 3) work space, centres of the balls.
        shell_body: (n_shells,) body of each shell.
        whole: (robot dof,) configuration; the chain's joints are overwritten.
        rows: (dof,) index of each chain joint in it.
        joints: (n_pairs, 2) the robot's joints that a table is over, -1 for none.
        clear: (n_pairs or 1, TABLE, TABLE) True where a cell is proved clear.
        spans: (robot dof, 2) lower limit and range of each joint.
    """

    model: tuple
    frames: np.ndarray
    axes: np.ndarray
    simplex: np.ndarray
    places: np.ndarray
    shell_body: np.ndarray
    whole: np.ndarray
    rows: np.ndarray
    joints: np.ndarray
    clear: np.ndarray
    spans: np.ndarray


@njit(cache=True, nogil=True)
def touches_itself(touch, q):
    """Say if a configuration (of the chain) is not proved free of self-collision."""
    tree_i, tree_f, pair_i, _, balls, points = touch.model
    if pair_i.shape[0] == 0:
        return False
    whole, frames, places = touch.whole, touch.frames, touch.places
    for j in range(q.shape[0]):
        whole[touch.rows[j]] = q[j]
    body_frames(tree_i, tree_f, whole, frames)
    for s in range(balls.shape[0]):
        b = touch.shell_body[s]
        for k in range(3):
            places[s, k] = (
                frames[b, 3 * k] * balls[s, 0]
                + frames[b, 3 * k + 1] * balls[s, 1]
                + frames[b, 3 * k + 2] * balls[s, 2]
                + frames[b, 9 + k]
            )
    for p in range(pair_i.shape[0]):
        a, b = pair_i[p, 0], pair_i[p, 1]
        x = places[a, 0] - places[b, 0]
        y = places[a, 1] - places[b, 1]
        z = places[a, 2] - places[b, 2]
        apart = balls[a, 3] + balls[b, 3] + MARGIN
        if x * x + y * y + z * z >= apart * apart:
            continue
        if touch.joints[p, 0] >= 0 and _in_table(touch, p):
            continue
        axis = touch.axes[p]
        if axis[0] == 0.0 and axis[1] == 0.0 and axis[2] == 0.0:
            axis[0], axis[1], axis[2] = x, y, z
        lower, _ = separation(
            points,
            (pair_i[p, 4], pair_i[p, 5]),
            (pair_i[p, 6], pair_i[p, 7]),
            frames[pair_i[p, 2]],
            frames[pair_i[p, 3]],
            axis,
            MARGIN,
            touch.simplex,
        )
        if lower < MARGIN:
            return True
    return False


@njit(cache=True, nogil=True)
def _in_table(touch, p):
    at = 0, 0
    i, j = touch.joints[p, 0], touch.joints[p, 1]
    u = int((touch.whole[i] - touch.spans[i, 0]) / touch.spans[i, 1] * TABLE)
    v = 0
    if j >= 0:
        v = int((touch.whole[j] - touch.spans[j, 0]) / touch.spans[j, 1] * TABLE)
        v = min(max(v, 0), TABLE - 1)
    at = min(max(u, 0), TABLE - 1), v
    return touch.clear[p, at[0], at[1]]


@njit(cache=True, nogil=True)
def fill_tables(touch, whole):
    """Fill `touch.clear` for all pairs that have a table.

    whole: (robot dof,) any configuration; the other joints do not matter.
    """
    tree_i, tree_f, pair_i, pair_reach, balls, points = touch.model
    for p in range(pair_i.shape[0]):
        i, j = touch.joints[p, 0], touch.joints[p, 1]
        if i < 0:
            continue
        q = whole.copy()
        half = pair_reach[p, i] * 0.5 * touch.spans[i, 1] / TABLE
        if j >= 0:
            half += pair_reach[p, j] * 0.5 * touch.spans[j, 1] / TABLE
        need = MARGIN + half + 1e-9
        axis = np.zeros(3)
        for u in range(TABLE):
            q[i] = touch.spans[i, 0] + (u + 0.5) * touch.spans[i, 1] / TABLE
            for v in range(TABLE if j >= 0 else 1):
                if j >= 0:
                    q[j] = touch.spans[j, 0] + (v + 0.5) * touch.spans[j, 1] / TABLE
                body_frames(tree_i, tree_f, q, touch.frames)
                lower, _ = pair_clearance(
                    pair_i, balls, points, p, touch.frames, need, axis, touch.simplex
                )
                touch.clear[p, u, v] = lower >= need
