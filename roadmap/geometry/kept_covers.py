"""Sphere covers that were found before, by what they cover: to find one takes seconds.

A cover is proved for its solids when it is found. Its file is named by a SHA-256 over
these very solids, the excess asked for and the text of all code that takes part; so
another solid, or another way to find or prove covers, has another name. What is read
must have the hash and the name it was written with; anything else is found anew.

Files lie in ODM_CACHE, else in `odm` of XDG_CACHE_HOME or ~/.cache; with an empty
ODM_CACHE none are kept.
"""

import hashlib
import os
import platform
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

from roadmap.chunks import ChunkStore
from roadmap.errors import BuildRefused
from roadmap.geometry.solids import Solid
from roadmap.geometry.spheres import cover_solids
from roadmap.kernel_cache import Sources


def kept_cover(solids: list[Solid], excess: float, closely: bool = True) -> np.ndarray:
    """Return `cover_solids(...)` (n, 4), from a file where there is one [m]."""
    folder = cache_folder()
    if folder is None or not solids:
        return cover_solids(solids, excess, closely)
    store, name = ChunkStore(folder / "covers"), _name(solids, excess, closely)
    kept = store.get(name)
    if kept is not None and kept[0] == name:
        return kept[1]
    found = cover_solids(solids, excess, closely)
    with suppress(BuildRefused):  # a full disk or a folder of others: not kept
        store.put(name, (np.array(name), found))
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


def _name(solids: list[Solid], excess: float, closely: bool) -> str:
    digest = hashlib.sha256(_code().encode())
    digest.update(np.float64(excess).tobytes() + bytes([closely]))
    for solid in solids:
        for part in (solid.kind, *solid.size, solid.T_body_solid, solid.points):
            array = np.ascontiguousarray(part, np.float64)
            digest.update(f"{array.shape}".encode() + array.tobytes())
    return digest.hexdigest()


@cache
def _code() -> str:
    """Return a hash of all that takes part in finding and proving a cover."""
    root = Path(__file__).parents[2]
    text = Sources(root).digest(root / "roadmap" / "geometry" / "spheres.py")
    # matrix products end in other last digits: see docs/decisions/0118
    core = os.environ.get("OPENBLAS_CORETYPE", "")
    return f"{text} numpy {np.__version__} {platform.machine()} {core}"
