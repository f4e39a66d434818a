"""Compiled loops of the roadmap package; bare on purpose, checks stand outside.

numba's cache looks at the file of a function only, not at what the function calls in
other files or at their constants. Stale machine code is a safety matter, so compiled
files are thrown away here whenever the text of any kernel file has changed.
"""

import hashlib
from pathlib import Path

# each calls those before it only, as the packages import each other
_FOLDERS = (
    "roadmap/_kernels",
    "odm/_kernels",
    "handover/_kernels",
    "sim/_kernels",
    "sim/bench",
)


def drop_stale_code() -> bool:
    """Delete compiled kernels that do not belong to the present sources.

    Returns:
        True where something was stale. Folders that cannot be written are left alone.
    """
    root = Path(__file__).parents[2]
    digest, stale = hashlib.sha256(), False
    for folder in _FOLDERS:
        for file in sorted((root / folder).glob("*.py")):
            digest.update(file.name.encode() + file.read_bytes())
        stale |= _drop_stale(root / folder / "__pycache__", digest.hexdigest())
    return stale


def _drop_stale(cache: Path, digest: str) -> bool:
    """Delete what is compiled in a folder unless it belongs to this digest."""
    stamp = cache / "sources.sha256"
    try:
        if not cache.parent.is_dir() or _says(stamp, digest):
            return False
        for file in cache.glob("*.nb[ic]"):
            file.unlink(missing_ok=True)
        cache.mkdir(exist_ok=True)
        stamp.write_text(digest)
    except OSError:
        return False
    return True


def _says(stamp: Path, digest: str) -> bool:
    return stamp.is_file() and stamp.read_text() == digest


drop_stale_code()
