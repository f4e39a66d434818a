"""Compiled loops never outlive their sources: stale machine code is dropped here.

numba's cache looks at the file of a function only, not at what the function calls in
other files or at their constants. Stale machine code is a safety matter, so whatever
was compiled from a file is thrown away whenever the text of that file, or of any file
of ours that it imports, directly or not, has changed. The files are found by what they
hold, so a new folder is protected as soon as it has a loop.

numba keeps machine code beside its source; where `NUMBA_CACHE_DIR` is set, there; and
where the sources cannot be written to, in the user's own cache (`kept_in`).
"""

import hashlib
import json
import os
import re
import sys
from functools import cache
from pathlib import Path

from roadmap.errors import PlanningError

PACKAGES = ("roadmap", "odm", "handover", "sim")
_STAMP = "kernels.json"
_IMPORT = re.compile(r"^[ \t]*from ([\w.]+) import (\([^)]*\)|.*)", re.MULTILINE)
_PLAIN = re.compile(r"^[ \t]*import ([\w., ]+)", re.MULTILINE)


class Sources:
    """The Python files of the packages in the folder `root`, and what each imports.

    A file goes by its name below `root`, "odm/search/_astar.py": each program begins
    with reading them all, and paths are slow.
    """

    def __init__(self, root: Path) -> None:
        self.root, above = root, len(os.path.join(root, ""))
        self.names = {
            os.path.join(folder, file)[above:].replace(os.sep, "/")
            for package in PACKAGES
            for folder, _, files in os.walk(root / package)
            for file in files
            if file.endswith(".py")
        }
        self.text = cache(self._text)
        self.hash = cache(lambda name: hashlib.sha256(self.text(name)).digest())
        self.imported = cache(self._imported)

    def compiled(self) -> list[Path]:
        """Return the files with loops that numba compiles."""
        found = (name for name in sorted(self.names) if b"njit" in self.text(name))
        return [self.root / name for name in found]

    def digest(self, file: Path) -> str:
        """Return a SHA-256 over a file and all files of ours that it needs."""
        first = file.relative_to(self.root).as_posix()
        seen, todo = {first}, [first]
        while todo:
            new = self.imported(todo.pop()) - seen
            seen |= new
            todo += new
        digest = hashlib.sha256()
        for name in sorted(seen):
            digest.update(name.encode() + self.hash(name))
        return digest.hexdigest()

    def _text(self, name: str) -> bytes:
        return (self.root / name).read_bytes()

    def _imported(self, name: str) -> set[str]:
        text = self.text(name).decode()
        modules = []
        for module, what in _IMPORT.findall(text):
            if module.partition(".")[0] in PACKAGES:
                modules += [f"{module}.{n}" for n in re.findall(r"\w+", what)]
                modules.append(module)
        for line in _PLAIN.findall(text):
            modules += [n.split()[0] for n in line.split(",") if n.strip()]
        return self.names.intersection(f"{m.replace('.', '/')}.py" for m in modules)


def drop_stale_code(root: Path | None = None) -> list[Path]:
    """Delete compiled loops that do not belong to the sources; return their files.

    `root` holds the packages; None: where this file lies. A folder that cannot be
    written is left alone.
    """
    sources = Sources(root or Path(__file__).parents[2])
    folders: dict[Path, dict[str, str]] = {}
    for file in sources.compiled():
        known = folders.setdefault(file.parent, {})
        known[file.stem] = sources.digest(file)
    dropped = {
        folder / f"{name}.py"
        for folder, digests in folders.items()
        for place in kept_in(folder)
        for name in _drop(place, digests)
    }
    return sorted(dropped)


def kept_in(folder: Path) -> list[Path]:
    """Return where numba may keep the machine code of a folder's loops.

    The user's own cache is one of them where it has some, or will have.
    """
    beside = folder / "__pycache__"
    above = os.path.abspath(folder)  # as numba does it: links are not followed
    name = f"{folder.name}_{hashlib.sha1(above.encode()).hexdigest()}"
    places = [beside]
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        places.append(Path(chosen) / name)
    own = _user_cache() / name
    if own.exists() or not os.access(beside if beside.exists() else folder, os.W_OK):
        places.append(own)
    return places


def check_kept(folder: Path) -> None:
    """Refuse where machine code of a folder's loops can be kept nowhere.

    Raises:
        PlanningError: Numba could not compile them.
    """
    places = kept_in(folder)
    if not any(map(_is_open, places)):
        raise PlanningError(
            "compiled loops can be kept nowhere, so that nothing can be compiled: "
            f"{', '.join(map(str, places))} cannot be written; set NUMBA_CACHE_DIR to "
            "a folder of your own that stays"
        )


def _is_open(place: Path) -> bool:
    """Return whether a folder can be written, or made where it is not there."""
    there = next(path for path in (place, *place.parents) if path.exists())
    return there.is_dir() and os.access(there, os.W_OK | os.X_OK)


def _user_cache() -> Path:
    home = Path(os.path.expanduser("~"))  # as it stands, where nobody has one
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "numba"
    return Path(os.environ.get("XDG_CACHE_HOME", home / ".cache")) / "numba"


def _drop(compiled: Path, digests: dict[str, str]) -> list[str]:
    """Delete what was compiled from other texts than these; return the files' names."""
    stamp = compiled / _STAMP
    try:
        before = _known(stamp)
        if before == digests:
            return []
        stale = [s for s in digests if before.get(s) != digests[s]]
        kept = set(digests) - set(stale)
        for file in compiled.glob("*.nb[ic]"):
            if file.name.partition(".")[0] not in kept:
                file.unlink(missing_ok=True)
        compiled.mkdir(parents=True, exist_ok=True)
        stamp.write_text(json.dumps(digests))
    except OSError:
        return []
    return stale


def _known(stamp: Path) -> dict[str, str]:
    """Return what a stamp says; a damaged one says nothing."""
    try:
        return dict(json.loads(stamp.read_text()))
    except (FileNotFoundError, ValueError, TypeError):
        return {}


check_kept(Path(__file__).parent)
drop_stale_code()
