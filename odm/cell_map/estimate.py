"""What a build will cost, known before it is begun."""

import resource
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from odm.cell_map.recipe import Recipe
from odm.obstacles.grid import bounding_ball, grid_for
from roadmap.errors import BuildRefused
from roadmap.robot.robot import Robot

_SHARE = 0.5  # of the memory that is there
_EDGE_FACTOR = 0.62  # measured: edges per node and neighbour, twins and blocked gone
_PACKED = 6.2  # bytes of an entry on disk; measured: Panda, 4 cm
_BUILDING = 66  # of an entry while it is made: chunks, all of them as one, packed


@dataclass(frozen=True)
class Estimate:
    """Rough size of a map: edges, its bytes on disk, the largest memory of a build."""

    n_edges: int
    map_bytes: int
    build_bytes: int


def estimate(robot: Robot, recipe: Recipe) -> Estimate:
    """Estimate bytes from the robot's size, cell size and node count."""
    h, settings = recipe.safety.h, recipe.roadmap
    _, radius = bounding_ball(robot)
    side = 2 * (radius + recipe.safety.rho + recipe.safety.m + h)
    n_blocks = np.ceil(side / (4 * h)) ** 3
    n_edges = int(_EDGE_FACTOR * settings.nodes * settings.neighbors)
    # an arm of this reach is a tube; an edge sweeps its mantle about once
    thick = 2 * (0.06 + recipe.safety.rho + recipe.safety.m)
    blocks = 1.3 * radius * (thick + 4 * h) ** 2 / (4 * h) ** 3
    entries = blocks * (1.6 * n_edges + settings.nodes)
    map_bytes = int(entries * _PACKED)
    return Estimate(n_edges, map_bytes, int(entries * _BUILDING + 16 * n_blocks))


def check_size(robot: Robot, recipe: Recipe) -> None:
    """Refuse a build that would not fit in memory; say what to change."""
    size = estimate(robot, recipe)
    room = free_memory()
    if size.build_bytes > _SHARE * room:
        raise BuildRefused(
            f"building {recipe.roadmap.nodes} nodes with cells of {recipe.safety.h} m "
            f"would take about {size.build_bytes / 1e9:.3g} GB, more than half of the "
            f"{room / 1e9:.3g} GB of free memory; take larger cells or fewer nodes"
        )
    grid_for(robot, recipe.safety.h, recipe.safety.rho + recipe.safety.m)


def free_memory() -> int:
    """Return the bytes of memory that this process may still take."""
    free = _kibibytes("/proc/meminfo", "MemAvailable:") or 8_000_000_000
    limit = resource.getrlimit(resource.RLIMIT_DATA)[0]
    if limit == resource.RLIM_INFINITY:
        return free
    return max(0, min(free, limit - taken_memory()))


def taken_memory() -> int:
    """Return the bytes that count against RLIMIT_DATA."""
    return _kibibytes("/proc/self/status", "VmData:") or 0


def _kibibytes(file: str, name: str) -> int | None:
    """Return a row of a file of the kernel, in bytes; None where there is none."""
    try:
        rows = Path(file).read_text().splitlines()
        return next(1024 * int(r.split()[1]) for r in rows if r.startswith(name))
    except (OSError, StopIteration, ValueError):
        return None
