"""Self-collision of very many configurations of a chain.

Links are carried along in the frames of the chain's rows, which inverse kinematics
has placed already. A robot also has pairs of links that are always near each other,
and whose place depends on one or two joints only: the solids of a wrist. Their distance
is looked up: cells of a table over these joints that are proved clear as a whole, by
the distance in the middle and the most that the links can move inside the cell.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from roadmap.compiling.jit_options import BARE_INNER, FULL, FULL_INNER, WITHIN_INNER
from roadmap.geometry._gjk import Shell, separation
from roadmap.geometry._self_collision import pair_clearance
from roadmap.kinematics._forward import body_frames

TABLE = 64  # cells along a joint
MARGIN = 1e-4  # [m] that links keep from each other
LANES = 8  # points of a shell are looked at so many at a time


class Touch(NamedTuple):
    """Tables of the self-collision test; without pairs nothing is tested."""

    # (n_pairs, 5) int32 two shells, table or -1, the one or two joints of the chain
    # that it is over, -1 for none
    pair: np.ndarray
    # (n_pairs,) square of the distance of the balls' centres at which the pair is clear
    # [m^2]
    apart: np.ndarray
    # (n_shells, 5) int32 row of the chain that carries it, -1 for the base; its first
    # and end row of `points`; its first and end column of `lanes`
    shell: np.ndarray
    balls: np.ndarray  # (n_shells, 4) around the shells, in the row's frame [m]
    points: np.ndarray  # (n, 3) in the row's frame [m]
    # (3, m) the same, filled up to full lanes with points there already
    lanes: np.ndarray
    clear: np.ndarray  # (n_tables, TABLE, TABLE) True where a cell is proved clear
    # (dof, 2) lower limit of each joint, and cells of a table per unit
    spans: np.ndarray
    # (n_pairs, 3) of one thread: separating direction of the last call, in the frame of
    # the first shell's row, where it changes least
    axes: np.ndarray
    direction: np.ndarray  # (3,) of one thread: the same, seen from the base
    places: np.ndarray  # (n_shells, 3) of one thread: centres of the balls
    simplex: np.ndarray  # (16, 3) working memory of one thread
    still: np.ndarray  # (12,) pose of what the base carries
    # of the robot where a link follows no row of the chain, such as one with a joint
    # that mimics; else empty; then a shell's row is a body
    tree_i: np.ndarray
    tree_f: np.ndarray
    # (robot dof,) of one thread: configuration; the chain's joints are overwritten
    whole: np.ndarray
    rows: np.ndarray  # (dof,) index of each chain joint in it
    frames: np.ndarray  # (n_bodies, 12) working memory of one thread


@njit(**BARE_INNER)
def touches_itself(touch, q, frames):
    """Say if a configuration is not proved free of self-collision.

    q: (dof,) of the chain. frames: (n + 1, 12) its rows there, see `forward`.
    """
    if touch.pair.shape[0] == 0:
        return False
    if touch.tree_i.shape[0] == 0:
        return _touches(touch, q, frames)
    _place_bodies(touch, q)
    return _touches(touch, q, touch.frames)


@njit(**FULL_INNER)
def _place_bodies(touch, q):
    for j in range(q.shape[0]):
        touch.whole[touch.rows[j]] = q[j]
    body_frames(touch.tree_i, touch.tree_f, touch.whole, touch.frames)


@njit(**BARE_INNER)
def _touches(touch, q, frames):
    pair, apart, shell, balls = touch.pair, touch.apart, touch.shell, touch.balls
    places, axes, lanes, clear = touch.places, touch.axes, touch.lanes, touch.clear
    spans, direction = touch.spans, touch.direction
    for s in range(shell.shape[0]):
        _carry(frames, shell[s, 0], balls, s, places)
    for p in range(pair.shape[0]):
        a, b = pair[p, 0], pair[p, 1]
        dx = places[a, 0] - places[b, 0]
        dy = places[a, 1] - places[b, 1]
        dz = places[a, 2] - places[b, 2]
        if dx * dx + dy * dy + dz * dz >= apart[p]:
            continue
        t = pair[p, 2]
        if t >= 0:
            i, j = pair[p, 3], pair[p, 4]
            u, v = int((q[i] - spans[i, 0]) * spans[i, 1]), 0
            if j >= 0:
                v = int((q[j] - spans[j, 0]) * spans[j, 1])
            if clear[t, min(max(u, 0), TABLE - 1), min(max(v, 0), TABLE - 1)]:
                continue
        # the direction of last time, then that of the balls; GJK where neither will do
        if axes[p, 0] != 0.0 or axes[p, 1] != 0.0 or axes[p, 2] != 0.0:
            _to_world(frames, shell[a, 0], axes, p, direction)
            if _parted(frames, shell, a, b, lanes, direction):
                continue
        direction[0], direction[1], direction[2] = dx, dy, dz
        if _parted(frames, shell, a, b, lanes, direction):
            _to_row(frames, shell[a, 0], direction, axes, p)
            continue
        if _near(touch, frames, p):
            return True
    return False


@njit(**WITHIN_INNER)
def _carry(frames, row, balls, s, places):
    """Write the centre of ball s, carried by a row, to places."""
    x, y, z = balls[s, 0], balls[s, 1], balls[s, 2]
    if row < 0:
        places[s, 0], places[s, 1], places[s, 2] = x, y, z
        return
    for k in range(3):
        places[s, k] = (
            frames[row, 3 * k] * x
            + frames[row, 3 * k + 1] * y
            + frames[row, 3 * k + 2] * z
            + frames[row, 9 + k]
        )


@njit(**WITHIN_INNER)
def _least(frames, shell, s, lanes, x, y, z):
    """Return the least of v . p over the points p of shell s, v = (x, y, z)."""
    row, offset = shell[s, 0], 0.0
    if row >= 0:
        offset = x * frames[row, 9] + y * frames[row, 10] + z * frames[row, 11]
        x, y, z = (
            x * frames[row, 0] + y * frames[row, 3] + z * frames[row, 6],
            x * frames[row, 1] + y * frames[row, 4] + z * frames[row, 7],
            x * frames[row, 2] + y * frames[row, 5] + z * frames[row, 8],
        )
    a = b = c = d = e = f = g = h = 1e300
    for i in range(shell[s, 3], shell[s, 4], LANES):
        a = min(a, x * lanes[0, i] + y * lanes[1, i] + z * lanes[2, i])
        b = min(b, x * lanes[0, i + 1] + y * lanes[1, i + 1] + z * lanes[2, i + 1])
        c = min(c, x * lanes[0, i + 2] + y * lanes[1, i + 2] + z * lanes[2, i + 2])
        d = min(d, x * lanes[0, i + 3] + y * lanes[1, i + 3] + z * lanes[2, i + 3])
        e = min(e, x * lanes[0, i + 4] + y * lanes[1, i + 4] + z * lanes[2, i + 4])
        f = min(f, x * lanes[0, i + 5] + y * lanes[1, i + 5] + z * lanes[2, i + 5])
        g = min(g, x * lanes[0, i + 6] + y * lanes[1, i + 6] + z * lanes[2, i + 6])
        h = min(h, x * lanes[0, i + 7] + y * lanes[1, i + 7] + z * lanes[2, i + 7])
    return offset + min(min(min(a, b), min(c, d)), min(min(e, f), min(g, h)))


@njit(**WITHIN_INNER)
def _parted(frames, shell, a, b, lanes, direction):
    """Say if a direction from shell b to shell a proves them apart."""
    x, y, z = direction[0], direction[1], direction[2]
    gap = _least(frames, shell, a, lanes, x, y, z)
    gap += _least(frames, shell, b, lanes, -x, -y, -z)
    return gap > 0.0 and gap * gap >= MARGIN * MARGIN * (x * x + y * y + z * z)


@njit(**FULL_INNER)
def _near(touch, frames, p):
    """Say if a pair is not proved apart, by GJK from `direction`."""
    shell, a, b = touch.shell, touch.pair[p, 0], touch.pair[p, 1]
    frame_a = frames[shell[a, 0]] if shell[a, 0] >= 0 else touch.still
    frame_b = frames[shell[b, 0]] if shell[b, 0] >= 0 else touch.still
    lower, _ = separation(
        touch.points,
        Shell(shell[a, 1], shell[a, 2], frame_a),
        Shell(shell[b, 1], shell[b, 2], frame_b),
        touch.direction,
        MARGIN,
        touch.simplex,
    )
    _to_row(frames, shell[a, 0], touch.direction, touch.axes, p)
    return lower < MARGIN


@njit(**WITHIN_INNER)
def _to_world(frames, row, axes, p, direction):
    """Write axes[p], of a row's frame, as seen from the base, to `direction`."""
    x, y, z = axes[p, 0], axes[p, 1], axes[p, 2]
    if row >= 0:
        f = frames[row]
        x, y, z = (
            f[0] * x + f[1] * y + f[2] * z,
            f[3] * x + f[4] * y + f[5] * z,
            f[6] * x + f[7] * y + f[8] * z,
        )
    direction[0], direction[1], direction[2] = x, y, z


@njit(**WITHIN_INNER)
def _to_row(frames, row, direction, axes, p):
    """Write `direction`, of the base's frame, as seen from a row, to axes[p]."""
    x, y, z = direction[0], direction[1], direction[2]
    if row >= 0:
        f = frames[row]
        x, y, z = (
            f[0] * x + f[3] * y + f[6] * z,
            f[1] * x + f[4] * y + f[7] * z,
            f[2] * x + f[5] * y + f[8] * z,
        )
    axes[p, 0], axes[p, 1], axes[p, 2] = x, y, z


@njit(**FULL)
def fill_tables(model, tabled, joints, spans, whole, clear):
    """Fill the tables of the pairs `tabled` (n_tables,) of links of the model.

    `joints` (n_tables, 2) are one or two joints of the robot, -1 for none; `spans`
    (robot dof, 2) their lower limit and range; the others stand as in `whole`. `clear`
    (n_tables, TABLE, TABLE) gets where a cell is proved clear.
    """
    tree_i, tree_f, pair_reach = model.tree_i, model.tree_f, model.reach
    frames, simplex = np.zeros((tree_i.shape[0], 12)), np.zeros((16, 3))
    for t in range(tabled.shape[0]):
        p, i, j = tabled[t], joints[t, 0], joints[t, 1]
        q = whole.copy()
        half = pair_reach[p, i] * 0.5 * spans[i, 1] / TABLE
        if j >= 0:
            half += pair_reach[p, j] * 0.5 * spans[j, 1] / TABLE
        need = MARGIN + half + 1e-9
        axis = np.zeros(3)
        for u in range(TABLE):
            q[i] = spans[i, 0] + (u + 0.5) * spans[i, 1] / TABLE
            for v in range(TABLE if j >= 0 else 1):
                if j >= 0:
                    q[j] = spans[j, 0] + (v + 0.5) * spans[j, 1] / TABLE
                body_frames(tree_i, tree_f, q, frames)
                lower, _ = pair_clearance(model, p, frames, need, axis, simplex)
                clear[t, u, v] = lower >= need
