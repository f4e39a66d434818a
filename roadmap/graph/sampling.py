"""Draw configurations: uniform, Halton, deterministic grid, biased to a region."""

import itertools
import math
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
    """Yield the numbers of `scipy.stats.qmc.Halton(dof, rng=rng)`, to the last bit.

    Each digit is permuted: 'A randomized Halton algorithm in R', Owen 2017. To import
    scipy.stats takes longer than to draw all nodes of a map.
    """
    (rng,) = rng.spawn(1)
    digits = [_permutations(base, rng) for base in _primes(dof)]
    for start in itertools.count(0, _CHUNK):
        numbers = np.arange(start, start + _CHUNK)
        yield np.stack([_van_der_corput(numbers, each) for each in digits], axis=1)


def _primes(n: int) -> list[int]:
    found: list[int] = []
    for number in itertools.count(2):
        if len(found) == n:
            return found
        if all(number % prime for prime in found):
            found.append(number)
    return found


def _permutations(base: int, rng: np.random.Generator) -> np.ndarray:
    """Return a permutation of 0 to base - 1 for each digit that a float can hold."""
    count = math.ceil(54 / math.log2(base)) - 1
    digits = np.repeat(np.arange(base)[None], count, axis=0)
    for row in digits:
        rng.shuffle(row)
    return digits


def _van_der_corput(numbers: np.ndarray, digits: np.ndarray) -> np.ndarray:
    """Return numbers mirrored at the point in base `digits.shape[1]`, permuted."""
    base = digits.shape[1]
    mirrored, left, unit = np.zeros(len(numbers)), numbers, 1.0 / base
    for row in digits:
        mirrored += row[left % base] * unit
        left, unit = left // base, unit / base
    return mirrored


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
