"""What `odm warmup` compiles is all that a robot's loop asks for.

A loop is compiled again for each new type of an argument: an array that is read-only or
in another layout is enough, and a frame would wait for it.
"""

import os
import subprocess
import sys

_CODE = """
import importlib, json, pkgutil, sys
import handover, odm, roadmap
from numba.core.dispatcher import Dispatcher
from sim.cli import main as cli
from sim.terminal.ahead import TABLE, decoded

map_dir, reach = sys.argv[1:]
at = ["--map", map_dir, "--seconds", "0.2"]  # after a rehearsal of 3 s
for words in (
    ["--motion", "sweep", "--execution", "timed"],
    ["--targets", "meet", "--reach", reach],
):
    sys.argv = ["odm", "run", *at, *words]
    try:
        cli.main()
    except SystemExit as stop:
        if stop.code:
            sys.exit(f"odm run ended with {stop.code}")
table = json.loads(TABLE.read_text(encoding="utf-8"))
types = decoded(table["types"])
known = {}
for module, name, given, commands in table["jobs"]:
    if "warmup" in commands.split():
        known.setdefault((module, name), set()).add(tuple(types[i] for i in given))
missing, asked = set(), 0
for package in (handover, odm, roadmap):
    for info in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        module = sys.modules.get(info.name)
        for name, loop in vars(module).items() if module else ():
            if isinstance(loop, Dispatcher) and loop.__module__ == info.name:
                asked += len(loop.signatures)
                for types_of_call in loop.signatures:
                    if types_of_call not in known.get((info.name, name), ()):
                        missing.add(f"{info.name}.{name}{types_of_call}"[:400])
print(asked, "asked for")
sys.exit("\\n".join(sorted(missing)) if missing or asked < 30 else 0)
"""


def test_a_run_of_a_real_robot_asks_for_no_loop_that_the_warm_up_left_out(meet_maps):
    paths = os.pathsep.join(p for p in sys.path if p)
    done = subprocess.run(
        [sys.executable, "-c", _CODE, *map(str, meet_maps)],
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-3000:]
