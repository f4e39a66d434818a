"""Covers that were found before, by what they cover: to find spheres takes seconds.

Spheres and shells are proved for their solids when they are found. Their file is named
by these very solids, what was asked for and the code that takes part, see `kept`.
"""

import hashlib
from collections.abc import Sequence

import numpy as np

from roadmap.builds.chunks import Arrays
from roadmap.builds.kept import code_of, kept
from roadmap.geometry.polytope import shell
from roadmap.geometry.solids import Solid
from roadmap.geometry.spheres import cover_excess, cover_solids

_CODE = "roadmap/geometry/spheres.py"  # which imports what makes the shells


def kept_cover(solids: list[Solid], excess: float, closely: bool = True) -> np.ndarray:
    """Return `cover_solids(...)` (n, 4), from a file where there is one [m]."""
    name = _name("cover", solids, np.float64(excess).tobytes() + bytes([closely]))
    (cover,) = kept("covers", name, lambda: (cover_solids(solids, excess, closely),))
    return cover


def kept_excess(spheres: np.ndarray, solids: list[Solid]) -> float:
    """Return `cover_excess(...)` of (n, 4), from a file where there is one [m]."""
    name = _name("excess", solids, spheres.tobytes())
    (excess,) = kept("covers", name, lambda: (np.array(cover_excess(spheres, solids)),))
    return excess.item()


def kept_shells(solids: Sequence[Solid]) -> list[np.ndarray]:
    """Return the `shell` (n, 3) of each solid, from a file where there is one [m]."""

    def find() -> Arrays:
        shells = [shell(solid) for solid in solids]
        ends = np.cumsum([len(points) for points in shells], dtype=np.int64)
        return np.vstack([np.empty((0, 3)), *shells]), ends

    points, ends = kept("covers", _name("shells", solids), find)
    return np.split(points, ends)[:-1]


def _name(what: str, solids: Sequence[Solid], asked: bytes = b"") -> str:
    digest = hashlib.sha256(f"{code_of(_CODE)} {what} ".encode() + asked)
    for solid in solids:
        for part in (solid.kind, *solid.size, solid.T_body_solid, solid.points):
            array = np.ascontiguousarray(part, np.float64)
            digest.update(f"{array.shape}".encode() + array.tobytes())
    return digest.hexdigest()
