"""Covers that were found before, by what they cover: to find spheres takes seconds.

Spheres and shells are proved for their solids when they are found. Their file is named
by a SHA-256 over these very solids, what was asked for and the text of all code that
takes part; so another solid, or another way to find or prove covers, has another name.
What is read must have the hash and the name it was written with; anything else is found
anew.

Files lie in ODM_CACHE, else in `odm` of XDG_CACHE_HOME or ~/.cache; with an empty
ODM_CACHE none are kept.
"""

import hashlib
import os
import platform
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

from roadmap.builds.chunks import Arrays, ChunkStore
from roadmap.compiling.kernel_cache import Sources
from roadmap.errors import BuildRefused
from roadmap.geometry.polytope import shell
from roadmap.geometry.solids import Solid
from roadmap.geometry.spheres import cover_excess, cover_solids


def kept_cover(solids: list[Solid], excess: float, closely: bool = True) -> np.ndarray:
    """Return `cover_solids(...)` (n, 4), from a file where there is one [m]."""
    name = _name("cover", solids, np.float64(excess).tobytes() + bytes([closely]))
    (cover,) = _kept(name, lambda: (cover_solids(solids, excess, closely),))
    return cover


def kept_excess(spheres: np.ndarray, solids: list[Solid]) -> float:
    """Return `cover_excess(...)` of (n, 4), from a file where there is one [m]."""
    name = _name("excess", solids, spheres.tobytes())
    (excess,) = _kept(name, lambda: (np.array(cover_excess(spheres, solids)),))
    return excess.item()


def kept_shells(solids: Sequence[Solid]) -> list[np.ndarray]:
    """Return the `shell` (n, 3) of each solid, from a file where there is one [m]."""

    def find() -> Arrays:
        shells = [shell(solid) for solid in solids]
        ends = np.cumsum([len(points) for points in shells], dtype=np.int64)
        return np.vstack([np.empty((0, 3)), *shells]), ends

    points, ends = _kept(_name("shells", solids), find)
    return np.split(points, ends)[:-1]


def _kept(name: str, find: Callable[[], Arrays]) -> Arrays:
    """Return what was found under a name, found now where it was not."""
    folder = cache_folder()
    if folder is None:
        return find()
    store = ChunkStore(folder / "covers")
    kept = store.get(name)
    if kept is not None and kept[0] == name:
        return kept[1:]
    found = find()
    with suppress(BuildRefused):  # a full disk or a folder of others: not kept
        store.put(name, (np.array(name), *found))
    return found


def cache_folder() -> Path | None:
    """Return where files are kept, None for nowhere."""
    chosen = os.environ.get("ODM_CACHE")
    if chosen is not None:
        return Path(chosen) if chosen else None
    home = os.environ.get("XDG_CACHE_HOME")
    try:
        return Path(home) / "odm" if home else Path.home() / ".cache" / "odm"
    except RuntimeError:  # a user without a home
        return None


def _name(what: str, solids: Sequence[Solid], asked: bytes = b"") -> str:
    digest = hashlib.sha256(f"{_code()} {what} ".encode() + asked)
    for solid in solids:
        for part in (solid.kind, *solid.size, solid.T_body_solid, solid.points):
            array = np.ascontiguousarray(part, np.float64)
            digest.update(f"{array.shape}".encode() + array.tobytes())
    return digest.hexdigest()


@cache
def _code() -> str:
    """Return a hash of all that takes part in finding and proving covers."""
    root = Path(__file__).parents[2]  # spheres.py imports what makes the shells
    text = Sources(root).digest(root / "roadmap" / "geometry" / "spheres.py")
    # matrix products end in other last digits: see docs/decisions/0118
    core = os.environ.get("OPENBLAS_CORETYPE", "")
    return f"{text} numpy {np.__version__} {platform.machine()} {core}"
