"""What takes seconds to find is found once on a machine, and kept in a file.

A file's name is a SHA-256 over all that it was found from, the text of the code that
takes part included (`code_of`): other input, or another way to find it, has another
name. What is read must have the hash and the name it was written with; anything else is
found anew.

Files lie in ODM_CACHE, else in `odm` of XDG_CACHE_HOME or ~/.cache; with an empty
ODM_CACHE none are kept.
"""

import os
import platform
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

from roadmap.builds.chunks import Arrays, ChunkStore
from roadmap.compiling.kernel_cache import Sources
from roadmap.errors import BuildRefused


def kept(kind: str, name: str, find: Callable[[], Arrays]) -> Arrays:
    """Return what was found under a name, found now where it was not.

    Args:
        kind: Of what is kept, a folder: "covers".
        name: SHA-256 over all that it is found from, `code_of` included.
        find: Returns it as arrays.
    """
    folder = cache_folder()
    if folder is None:
        return find()
    store = ChunkStore(folder / kind)
    there = store.get(name)
    if there is not None and there[0] == name:
        return there[1:]
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


@cache
def code_of(file: str) -> str:
    """Return what tells the code of a file of ours, and of all that it needs.

    Args:
        file: Below the folder of the packages, "roadmap/geometry/spheres.py".
    """
    sources = _sources()
    text = sources.digest(sources.root / file)
    # matrix products end in other last digits: see docs/decisions/0118
    core = os.environ.get("OPENBLAS_CORETYPE", "")
    return f"{text} numpy {np.__version__} {platform.machine()} {core}"


@cache
def _sources() -> Sources:
    return Sources(Path(__file__).parents[2])
