"""Draw configurations: uniform, Halton, deterministic grid, biased to a region."""

from collections.abc import Iterator

import numpy as np

from roadmap.errors import BadInput
from roadmap.kinematics.forward import tool_pose
from roadmap.robot.robot import Robot

SAMPLERS = ("uniform", "halton", "grid")
_CHUNK = 1024


def draw(
    robot: Robot, sampling: str, seed: int, n_nodes: int, region: np.ndarray | None
) -> Iterator[np.ndarray]:
    """Yield chunks (k, dof) of configurations within limits, without end.

    Args:
        robot: The robot.
        sampling: "uniform", "halton" or "grid" (a lattice of `n_nodes` cells,
            visited in a seeded order; ends once, then goes on uniformly).
        seed: Seed of the random generator or of Halton's scrambling.
        n_nodes: How many will be asked for; sets the pitch of the grid.
        region: (2, 3) lower and upper corner [m] of a box in the base frame; where
            given, configurations with the tool outside are thinned to one in eight.

    Raises:
        BadInput: An unknown sampler; names the known ones.
    """
    if sampling not in SAMPLERS:
        known = ", ".join(SAMPLERS)
        raise BadInput(f"sampling {sampling!r} is unknown; choose one of {known}")
    rng = np.random.default_rng(seed)
    chunks = {"uniform": _uniform, "halton": _halton, "grid": _grid}[sampling]
    for unit in chunks(robot.dof, rng, n_nodes):
        q = robot.lower + unit * (robot.upper - robot.lower)
        yield q if region is None else q[_keep(robot, q, region, rng)]


def _uniform(dof: int, rng: np.random.Generator, _n: int) -> Iterator[np.ndarray]:
    while True:
        yield rng.random((_CHUNK, dof))


def _halton(dof: int, rng: np.random.Generator, _n: int) -> Iterator[np.ndarray]:
    from scipy.stats import qmc  # takes half a second to import

    sequence = qmc.Halton(dof, seed=rng)  # scrambled
    while True:
        yield sequence.random(_CHUNK)


def _grid(dof: int, rng: np.random.Generator, n_nodes: int) -> Iterator[np.ndarray]:
    # about twice as many lattice points as nodes: some of them are in collision
    per_axis = max(2, int(np.ceil((2.0 * n_nodes) ** (1.0 / dof))))
    total = per_axis**dof
    order = rng.permutation(total)
    for start in range(0, total, _CHUNK):
        ids = np.unravel_index(order[start : start + _CHUNK], (per_axis,) * dof)
        yield (np.stack(ids, axis=1) + 0.5) / per_axis
    yield from _uniform(dof, rng, n_nodes)


def _keep(
    robot: Robot, q: np.ndarray, region: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    tools = np.array([tool_pose(robot, row)[:3, 3] for row in q])
    inside = ((tools >= region[0]) & (tools <= region[1])).all(axis=1)
    return inside | (rng.random(len(q)) < 0.125)
