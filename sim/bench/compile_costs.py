"""The table of what commands compile: `python -m sim.bench.compile_costs run run ...`.

The first word is the entry of the table, the others are a command line of `odm`. It is
run in this process; the loops it used are written down, and for those that were
compiled meanwhile (all, with an empty NUMBA_CACHE_DIR) what they cost on this core.
See `sim.terminal.compiling`. Without a command line (`... warmup`) it compiles what the
table of types has for that entry, the same loops that `sim.terminal.ahead` compiles.
"""

import json
import sys
import time
from collections import defaultdict
from contextlib import suppress

from numba.core.event import Event, Listener

from roadmap.builds.unfinished import temporary_folder
from sim.terminal.ahead import compile_all
from sim.terminal.compiling import TABLE

OURS = ("roadmap", "odm", "handover", "sim")


class Costs(Listener):
    """Processor time of each loop while it is compiled, what it calls left out [s]."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.seconds: dict[str, float] = defaultdict(float)
        self._open: list[list[float]] = []

    def on_start(self, happened: Event) -> None:
        """Hear of a compilation that begins."""
        self._open.append([time.process_time(), 0.0])

    def on_end(self, happened: Event) -> None:
        """Hear of a compilation that ends."""
        begun, inside = self._open.pop()
        spent = time.process_time() - begun
        self.seconds[name_of(happened.data["dispatcher"])] += spent - inside
        if self._open:
            self._open[-1][1] += spent


def name_of(dispatcher: object) -> str:
    """Return "odm.search._step.step" of a compiled loop."""
    function = dispatcher.py_func
    return f"{function.__module__}.{function.__qualname__}"


def used() -> list[str]:
    """Return the loops that were called or compiled here, and all that they call."""
    from numba.core.dispatcher import Dispatcher

    modules = [m for n, m in sys.modules.items() if n.partition(".")[0] in OURS]
    every = [v for m in modules for v in vars(m).values() if isinstance(v, Dispatcher)]
    todo, found = [d for d in every if d.overloads], set()
    while todo:
        one = todo.pop()
        if name_of(one) in found:
            continue
        found.add(name_of(one))
        scope = one.py_func.__globals__
        called = (scope.get(name) for name in one.py_func.__code__.co_names)
        todo += [c for c in called if isinstance(c, Dispatcher)]
    return sorted(name for name in found if name.partition(".")[0] in OURS)


def main() -> None:
    """Run a command and write what it compiled into the table."""
    from numba.core import event

    from sim.cli.main import main as odm

    _, entry, *sys.argv[1:] = sys.argv
    costs = Costs()
    event.register("numba:compile", costs)
    if sys.argv[1:]:
        with suppress(SystemExit):
            odm()
        needed = set(used())
    else:
        with temporary_folder() as folder:
            needed = {name_of(loop) for loop in compile_all(entry, folder)}
    rows = json.loads(TABLE.read_text())
    for name in sorted(set(rows) | needed):
        cost, by = rows.get(name, (0.3, ""))
        cost = round(costs.seconds.get(name, cost), 2)
        words = set(by.split()) - {entry} | ({entry} if name in needed else set())
        rows[name] = [cost, " ".join(sorted(words))]
    lines = [f"{json.dumps(k)}: {json.dumps(v)}" for k, v in sorted(rows.items())]
    TABLE.write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
