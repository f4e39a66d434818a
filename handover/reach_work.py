"""Working memory of the reach kernels, and the yardstick of the dexterity."""

from functools import lru_cache

import numpy as np

from handover._kernels.chain import (
    dexterity,
    draw_code,
    forward,
    from_lattice,
    jacobian,
)
from handover._kernels.reach import Work
from handover._kernels.touch import TABLE, Touch, fill_tables
from handover.chain import Chain
from roadmap.arrays import frozen
from roadmap.self_collision import self_collision

_YARDSTICK = 20_000  # configurations drawn
_CLIMB = 6_000  # steps up from the best of them


def work_of(chain: Chain) -> Work:
    """Return working memory for one thread."""
    dof = chain.dof
    return Work(
        frames=np.zeros((len(chain.kind) + 1, 12)),
        jac=np.zeros((6, dof)),
        weighted=np.zeros((dof, 6)),
        gram=np.zeros((7, 6)),
        q=np.zeros(dof),
        dq=np.zeros(dof),
        active=np.ones(dof),
        error=np.zeros(6),
        code=np.zeros(dof, np.uint16),
        target=np.zeros(12),
    )


def touch_of(chain: Chain) -> Touch:
    """Return what self-collision is tested with, for one thread."""
    tables = _tables(chain)
    own = {
        name: np.zeros_like(getattr(tables, name))
        for name in ("frames", "axes", "simplex", "places")
    }
    return tables._replace(**own, whole=chain.full(np.zeros(chain.dof)))


@lru_cache(maxsize=8)
def _tables(chain: Chain) -> Touch:
    """Return the tables of a chain, filled once and shared by all threads."""
    rows = np.array(chain.rows or range(chain.dof), np.int64)
    if chain.robot is None:
        robot_dof, model, body = chain.dof, _nothing(), np.zeros(0, np.int32)
        limits = chain.limits
    else:
        robot_dof = chain.robot.dof
        model = self_collision(chain.robot).model
        body = chain.robot.link_body[chain.robot.shell_link]
        limits = np.stack([chain.robot.lower, chain.robot.upper], axis=1)
    n_pairs = len(model[2])
    joints = np.full((n_pairs, 2), -1, np.int64)
    for p, reach in enumerate(model[3]):
        moved = np.flatnonzero(reach)
        if 1 <= len(moved) <= 2:
            joints[p, : len(moved)] = moved
    touch = Touch(
        model=model,
        frames=np.zeros((len(model[0]), 12)),
        axes=np.zeros((n_pairs, 3)),
        simplex=np.zeros((16, 3)),
        places=np.zeros((len(model[4]), 3)),
        shell_body=frozen(body, np.int32),
        whole=np.zeros(robot_dof),
        rows=frozen(rows, np.int64),
        joints=frozen(joints, np.int64),
        clear=np.zeros((n_pairs, TABLE, TABLE), np.bool_),
        spans=frozen(np.stack([limits[:, 0], np.ptp(limits, axis=1)], axis=1), float),
    )
    fill_tables(touch, limits.mean(axis=1))
    return touch


def best_dexterity(chain: Chain, seed: int) -> float:
    """Return the dexterity that counts as quality 1.

    The best of a fixed set of configurations, then of small steps from there.
    """
    work, best = work_of(chain), 0.0
    for k in range(_YARDSTICK):
        draw_code(seed + 1, k, work.code)
        from_lattice(chain.arrays, work.code, work.q)
        value = _dexterity(chain, work)
        if value > best:
            best, q_best = value, work.q.copy()
    if best == 0.0:
        return 1e-12
    rng, span = np.random.default_rng(seed), np.ptp(chain.limits, axis=1)
    for width in np.geomspace(0.1, 0.002, _CLIMB):
        work.q[:] = q_best + width * span * rng.normal(size=chain.dof)
        np.clip(work.q, *chain.limits.T, out=work.q)
        value = _dexterity(chain, work)
        if value > best:
            best, q_best = value, work.q.copy()
    return best


def _dexterity(chain: Chain, work: Work) -> float:
    forward(chain.arrays, work.q, work.frames)
    jacobian(chain.arrays, work.frames, work.jac)
    return dexterity(chain.arrays, work.q, work.jac, work.weighted, work.gram)


@lru_cache(maxsize=1)
def _nothing() -> tuple:
    """Return a model of the right types without any pair of links."""
    arrays = [
        np.zeros((1, 3), np.int32),
        np.zeros((1, 17)),
        np.zeros((0, 8), np.int32),
        np.zeros((0, 1)),
        np.zeros((0, 4)),
        np.zeros((0, 3)),
    ]
    for array in arrays:
        array.flags.writeable = False
    return tuple(arrays)
