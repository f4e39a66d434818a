"""The table of what is compiled ahead: `python -m sim.bench.compile_jobs run FOLDER`.

FOLDER is a NUMBA_CACHE_DIR that was empty and in which the command (here `odm run`) was
then run on one core (`taskset -c 0`): on two, all that this very table names would be
compiled ahead, also what nobody asks for any more. The types in numba's index files are
written into the table of `sim.terminal.ahead`, by that command's name.
"""

import json
import pickle
import sys
from pathlib import Path

from sim.bench.compile_costs import OURS
from sim.terminal.ahead import TABLE


def _loops() -> dict[str, tuple[str, str]]:
    """Return module and name of every loop by folder, file and name."""
    import importlib
    import pkgutil

    from numba.core.dispatcher import Dispatcher

    found = {}
    for package in map(importlib.import_module, OURS):
        for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            stem = info.name.rpartition(".")[2]
            if not stem.startswith("_") or stem.startswith("__"):
                continue
            module = importlib.import_module(info.name)
            for name, value in vars(module).items():
                if isinstance(value, Dispatcher):
                    at = Path(module.__file__).parent.name
                    found[f"{at}/{stem}.{name}"] = (info.name, name)
    return found


class Types:
    """The rows of the types, each once and after those it is made of."""

    def __init__(self, rows: list) -> None:
        """Go on with these rows."""
        self.rows = rows
        self._at = {json.dumps(row): k for k, row in enumerate(rows)}

    def add(self, one: object) -> int:
        """Return the index of a type.

        Raises:
            TypeError: One that the table does not know.
        """
        from numba import types

        if isinstance(one, types.Array):
            row = ["array", self.add(one.dtype), one.ndim, one.layout]
            row += [not one.mutable, one.aligned]
        elif isinstance(one, types.BaseTuple):
            named = getattr(one, "instance_class", None)
            at = (named.__module__, named.__qualname__) if named else (None, None)
            row = ["tuple", *at, [self.add(member) for member in one]]
        elif isinstance(one, types.Literal):
            row = ["literal", one.literal_value]
        elif isinstance(one, (types.Number, types.Boolean, types.NoneType)):
            row = ["plain", str(one) if str(one) != "bool" else "boolean"]
        else:
            raise TypeError(str(one))
        key = json.dumps(row)
        if key not in self._at:
            self._at[key] = len(self.rows)
            self.rows.append(row)
        return self._at[key]


def main() -> None:
    """Read a cache and write its types into the table."""
    _, command, folder = sys.argv
    loops = _loops()
    table = {"types": [], "jobs": []}
    if TABLE.is_file():
        table = json.loads(TABLE.read_text(encoding="utf-8"))
    types = Types(table["types"])
    jobs = {(m, n, tuple(t)): set(by.split()) for m, n, t, by in table["jobs"]}
    for by in jobs.values():
        by.discard(command)
    for file in sorted(Path(folder).rglob("*.nbi")):
        at = file.parent.name.rpartition("_")[0] + "/" + file.name.partition("-")[0]
        if at not in loops:
            continue
        with file.open("rb") as index:
            pickle.load(index)
            _, overloads = pickle.loads(index.read())
        for key in overloads:
            try:
                given = tuple(types.add(one) for one in key[0])
            except TypeError as error:
                print(f"left out: {at} with {error}")
                continue
            jobs.setdefault((*loops[at], given), set()).add(command)
    # those that no command asks for any more are left out
    needed = (
        (*loop, list(t), " ".join(sorted(b))) for (*loop, t), b in jobs.items() if b
    )
    rows = sorted(needed)
    lines = [",\n".join(map(json.dumps, part)) for part in (types.rows, rows)]
    TABLE.write_text(f'{{"types": [\n{lines[0]}\n],\n"jobs": [\n{lines[1]}\n]}}\n')


if __name__ == "__main__":
    main()
