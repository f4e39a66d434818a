"""Compiled loops of the roadmap package; bare on purpose, checks stand outside.

numba's cache looks at the file of a function only, not at what the function calls in
other files or at their constants. Stale machine code is a safety matter, so compiled
files are thrown away here whenever the text of any kernel file has changed.
"""

import hashlib
from pathlib import Path

_FOLDERS = ("roadmap/_kernels", "odm/_kernels", "handover/_kernels")


def drop_stale_code() -> bool:
    """Delete compiled kernels that do not belong to the present sources.

    Returns:
        True where something was stale. Folders that cannot be written are left alone.
    """
    root = Path(__file__).parents[2]
    digest = hashlib.sha256()
    for folder in _FOLDERS:
        for file in sorted((root / folder).glob("*.py")):
            digest.update(file.name.encode() + file.read_bytes())
    stamp = root / _FOLDERS[0] / "__pycache__" / "sources.sha256"
    try:
        if stamp.is_file() and stamp.read_text() == digest.hexdigest():
            return False
        for folder in _FOLDERS:
            for file in (root / folder / "__pycache__").glob("*.nb[ic]"):
                file.unlink(missing_ok=True)
        stamp.parent.mkdir(exist_ok=True)
        stamp.write_text(digest.hexdigest())
    except OSError:
        return False
    return True


drop_stale_code()
