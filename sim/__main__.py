"""The `odm` command from its first line on: Ctrl-C is heard before anything heavy."""

import gc
import os
import sys

from sim.terminal import interrupt

# Compiling makes many small objects that stay: looked through less often, a tenth of
# its time is saved, for a tenth more memory.
COLLECT = (200_000, 20, 100)
# With AVX-512, matrix products and sines end in other last digits: what numpy and its
# OpenBLAS are told, so that all x86 processors with AVX2 compute the same.
ALIKE = {
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512F AVX512CD AVX512_SKX AVX512_CLX "
    "AVX512_CNL AVX512_ICL AVX512_SPR",
}


def main() -> None:
    """Run the command line, see `sim.cli.main.main`."""
    interrupt.listen()
    _mend_streams()
    compute_alike()
    gc.set_threshold(*COLLECT)
    from sim.cli.main import main as run

    run()


def compute_alike(cpu: str = "/proc/cpuinfo") -> None:
    """Let maps and runs be the same bytes on other processors; before numpy is there.

    What the user has set stays, and processors that are none of these are left alone.
    """
    try:
        with open(cpu, encoding="ascii", errors="replace") as file:
            flags = file.read(8192).split()
    except OSError:  # not Linux
        return
    if "avx2" in flags and "fma" in flags:
        for name, value in ALIKE.items():
            os.environ.setdefault(name, value)


def _mend_streams() -> None:
    """Let output go nowhere where it was closed, and as "?" what it cannot encode."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
        elif getattr(sys, name).errors in ("strict", "surrogateescape"):  # LC_ALL=C
            getattr(sys, name).reconfigure(errors="replace")


if __name__ == "__main__":
    main()
