"""Tables for testing many configurations of a chain for self-collision, made once."""

from functools import lru_cache

import numpy as np

from handover.chain import Chain
from handover.reach._reach_touch import LANES, MARGIN, TABLE, Touch, fill_tables
from roadmap.arrays import frozen
from roadmap.geometry._self_collision import SelfModel, pair_clearance
from roadmap.geometry.self_collision import self_collision
from roadmap.kinematics._chain import forward
from roadmap.kinematics._forward import body_frames
from roadmap.transforms import pose_of_flat

_LOOKS = 12  # configurations at which a link must stand alike to follow a row
_ALIKE = 1e-9  # [m, or of a rotation's entries]


def touch_of(chain: Chain) -> Touch:
    """Return the tables of the self-collision test with scratch for one thread."""
    tables = _tables(chain)
    scratch = ("axes", "direction", "places", "simplex", "whole", "frames")
    return tables._replace(**{name: getattr(tables, name).copy() for name in scratch})


@lru_cache(maxsize=8)
def _tables(chain: Chain) -> Touch:
    """Return the tables of a chain, filled once and shared by all threads."""
    robot = chain.robot
    if robot is None:
        return _touch(chain)
    rows = list(chain.rows)
    model = self_collision(robot).model
    tree_i, tree_f, pair_i = model.tree_i, model.tree_f, model.pairs
    reach, balls, points = model.reach, model.balls, model.points
    whole = chain.full(chain.limits.mean(axis=1))
    kept = _moving_or_near(model, rows, whole)
    row, carried = _carriers(chain, robot.link_body[robot.shell_link])
    follows = carried is not None
    if follows:
        turn, place = carried[:, :3, :3], carried[:, :3, 3]
        balls = np.array(balls)
        balls[:, :3] = np.einsum("sij,sj->si", turn, balls[:, :3]) + place
    shells, lanes, moved = np.zeros((len(row), 5), np.int32), [], np.array(points)
    for s, (first, end) in enumerate(zip(robot.shell_ptr[:-1], robot.shell_ptr[1:])):
        if follows:
            moved[first:end] = points[first:end] @ turn[s].T + place[s]
        full = np.concatenate([moved[first:end], moved[end - 1 :][:1].repeat(7, 0)])
        full = full[: len(full) // LANES * LANES]
        at = sum(map(len, lanes))
        shells[s] = row[s], first, end, at, at + len(full)
        lanes.append(full)
    limits = np.stack([robot.lower, robot.upper], axis=1)
    spans = np.stack([limits[:, 0], np.ptp(limits, axis=1)], axis=1)
    tabled, joints = _tabled(kept, reach, rows)
    clear = np.zeros((max(len(tabled), 1), TABLE, TABLE), np.bool_)
    fill_tables(model, tabled, joints, spans, whole, clear)
    pairs = np.full((len(kept), 5), -1, np.int32)
    pairs[:, :2] = pair_i[kept, :2]
    for t, (p, both) in enumerate(zip(tabled, joints)):
        at = kept.index(p)
        pairs[at, 2] = t
        pairs[at, 3:] = [rows.index(j) if j >= 0 else -1 for j in both]
    apart = balls[pairs[:, 0], 3] + balls[pairs[:, 1], 3] + MARGIN
    return _touch(
        chain,
        pair=pairs,
        apart=apart**2,
        shell=shells,
        balls=balls,
        points=moved,
        lanes=np.concatenate(lanes).T,
        clear=clear,
        tree=None if follows else (tree_i, tree_f),
        whole=whole,
    )


def _touch(chain: Chain, tree: tuple | None = None, **known: np.ndarray) -> Touch:
    """Return a Touch of the right types, of no pair of links where none is given."""
    shapes = {
        "pair": ((0, 5), np.int32),
        "apart": ((0,), float),
        "shell": ((0, 5), np.int32),
        "balls": ((0, 4), float),
        "points": ((0, 3), float),
        "lanes": ((3, 0), float),
        "clear": ((1, TABLE, TABLE), np.bool_),
    }
    shared = {
        name: frozen(known.get(name, np.zeros(shape, kind)), kind)
        for name, (shape, kind) in shapes.items()
    }
    tree_i, tree_f = tree or (np.zeros((0, 3), np.int32), np.zeros((0, 17)))
    span = np.ptp(chain.limits, axis=1)
    return Touch(
        **shared,
        spans=frozen(np.stack([chain.limits[:, 0], TABLE / span], axis=1), float),
        axes=np.zeros((len(shared["pair"]), 3)),
        direction=np.zeros(3),
        places=np.zeros((len(shared["shell"]), 3)),
        simplex=np.zeros((16, 3)),
        still=np.r_[np.eye(3).ravel(), np.zeros(3)],
        tree_i=frozen(tree_i, np.int32),
        tree_f=frozen(tree_f, float),
        whole=known.get("whole", np.zeros(chain.dof)),
        rows=frozen(np.array(chain.rows or range(chain.dof)), np.int64),
        frames=np.zeros((len(tree_i), 12)),
    )


def _moving_or_near(model: SelfModel, rows: list[int], whole: np.ndarray) -> list[int]:
    """Return the pairs that a joint of the chain moves, or that touch as they are."""
    frames = np.zeros((len(model.tree_i), 12))
    body_frames(model.tree_i, model.tree_f, whole, frames)
    kept = []
    for p in range(len(model.pairs)):
        if not model.reach[p, rows].any():
            rest = MARGIN, np.zeros(3), np.zeros((16, 3))
            lower, _ = pair_clearance(model, p, frames, *rest)
            if lower >= MARGIN:
                continue
        kept.append(p)
    return kept


def _tabled(
    kept: list[int], reach: np.ndarray, rows: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs that one or two joints of the chain move, and these joints."""
    tabled, joints = [], []
    for p in kept:
        moved = [j for j in rows if reach[p, j] > 0]
        if 1 <= len(moved) <= 2:
            tabled.append(p)
            joints.append([*moved, -1][:2])
    return np.array(tabled, np.int64), np.array(joints, np.int64).reshape(-1, 2)


def _carriers(chain: Chain, bodies: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the row that carries each shell, -1: the base, and its pose in that row.

    Looked for by comparing poses at random configurations. Where one follows no row,
    the bodies themselves and None.
    """
    robot, rng = chain.robot, np.random.default_rng(0)
    n_rows, n_links = len(chain.kind) + 1, len(robot.tree_i)
    rows, links = np.empty((_LOOKS, n_rows, 4, 4)), np.empty((_LOOKS, n_links, 4, 4))
    for k in range(_LOOKS):
        q = rng.uniform(*chain.limits.T)
        ours, theirs = np.zeros((n_rows, 12)), np.zeros((n_links, 12))
        forward(chain.arrays, q, ours)
        body_frames(robot.tree_i, robot.tree_f, chain.full(q), theirs)
        rows[k], links[k] = pose_of_flat(ours), pose_of_flat(theirs)
    row, carried = [], []
    for body in bodies:
        for r in range(len(chain.kind) - 1, -2, -1):
            base = np.linalg.inv(rows[:, r]) if r >= 0 else np.eye(4)
            found = base @ links[:, body]
            if np.abs(found - found[0]).max() < _ALIKE:
                row.append(r)
                carried.append(found[0])
                break
        else:
            return np.asarray(bodies), None
    return np.array(row), np.array(carried).reshape(-1, 4, 4)
