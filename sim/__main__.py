"""The `odm` command from its first line on: Ctrl-C is heard before anything heavy."""

import gc
import os
import sys

from sim.terminal import interrupt

# Compiling makes many small objects that stay: looked through less often, a tenth of
# its time is saved, for a tenth more memory.
COLLECT = (200_000, 20, 100)


def main() -> None:
    """Run the command line, see `sim.cli.main.main`."""
    interrupt.listen()
    _mend_streams()
    gc.set_threshold(*COLLECT)
    from sim.cli.main import main as run

    run()


def _mend_streams() -> None:
    """Let output go nowhere where it was closed, and as "?" what it cannot encode."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
        elif getattr(sys, name).errors in ("strict", "surrogateescape"):  # LC_ALL=C
            getattr(sys, name).reconfigure(errors="replace")


if __name__ == "__main__":
    main()
