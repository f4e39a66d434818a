"""How much is still to be compiled before a command can begin, and about how long.

Numba compiles a loop when it is first called and keeps it beside its source, so a
command's first run takes minutes and every other one none. Which loops a command needs
and what each cost once is in `compile_costs.json` (see `sim/bench/compile_costs.py`);
which are still missing is seen from the files. Both are told while somebody waits. A
loop that is not in the table, or no longer there, only makes the estimate worse.
"""

import json
import os
import time
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TABLE = Path(__file__).with_name("compile_costs.json")
TRUSTED_S = 10.0  # of the table's seconds: from so many on the pace seen here counts
WORTH_TELLING_S = 2.0


@cache
def table() -> dict[str, tuple[float, frozenset[str]]]:
    """Return the cost of each loop [s], and the commands that need it."""
    rows = json.loads(TABLE.read_text(encoding="utf-8"))
    return {name: (cost, frozenset(by.split())) for name, (cost, by) in rows.items()}


def commands() -> list[str]:
    """Return the commands that the table knows."""
    return sorted(frozenset().union(*(by for _, by in table().values())))


class Compiling:
    """What a command has still to compile; nothing if it is not in the table."""

    def __init__(self, command: str, root: Path = ROOT) -> None:
        self.root, self._command = root, command
        self._begun: float | None = None
        self._first_s = 0.0
        self._wanted: dict[str, float] | None = None

    @property
    def wanted(self) -> dict[str, float]:
        """Cost of every loop of the command that is there [s]."""
        if self._wanted is None:
            texts: dict[Path, str] = {}
            self._wanted = {}
            for name, (cost, by) in table().items():
                if self._command not in by:
                    continue
                module, _, loop = name.rpartition(".")
                file = self.root / f"{module.replace('.', '/')}.py"
                if file not in texts:
                    texts[file] = file.read_text() if file.is_file() else ""
                if f"def {loop}(" in texts[file]:
                    self._wanted[name] = cost
        return self._wanted

    def missing(self) -> dict[str, float]:
        """Return the cost of every loop that is not compiled [s]."""
        there = compiled(self.root, self.wanted)
        return {name: cost for name, cost in self.wanted.items() if name not in there}

    def progress(self) -> tuple[int, int, float] | None:
        """Return (loops done, of how many, about so many seconds left).

        None: nothing worth telling is missing.
        """
        missing = self.missing()
        left_s, now = sum(missing.values()), time.monotonic()
        if self._begun is None or left_s >= self._first_s:
            # nothing was compiled yet, or a stale one was just dropped
            self._begun, self._first_s = now, left_s
        if self._first_s < WORTH_TELLING_S or not missing:
            return None
        done_s, pace = self._first_s - left_s, 1.0
        if done_s > 0.0:  # the first loops tell little of a machine's pace
            seen, trust = (now - self._begun) / done_s, min(1.0, done_s / TRUSTED_S)
            pace += trust * (seen - pace)
        return len(self.wanted) - len(missing), len(self.wanted), pace * left_s


def compiled(root: Path, names: dict[str, float]) -> set[str]:
    """Return those of the loops that lie compiled where numba looks for them.

    With NUMBA_CACHE_DIR that is there alone.
    """
    from roadmap.compiling.kernel_cache import kept_in  # not where nothing is compiled

    first = 1 if os.environ.get("NUMBA_CACHE_DIR") else 0
    by_folder: dict[Path, set[str]] = {}
    found = set()
    for name in names:
        module, _, loop = name.rpartition(".")
        file = root / module.replace(".", "/")
        folder = file.parent
        if folder not in by_folder:
            files = [f for p in kept_in(folder)[first:] for f in p.glob("*.nbi")]
            # "_close.motion_clear" of "_close.motion_clear-352.py311.nbi"
            by_folder[folder] = {file.name.partition("-")[0] for file in files}
        if f"{file.name}.{loop}" in by_folder[folder]:
            found.add(name)
    return found
