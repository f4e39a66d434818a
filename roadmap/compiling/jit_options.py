"""Options of compiled loops: counted references, divisions by zero, who calls them.

Numba counts the references to every array that a loop takes out of a tuple or looks
at, by two locked instructions each time. A loop that makes no array needs none of it,
since its caller holds the arrays, and numba refuses to compile one that makes an array
after all. And it compiles two more functions beside each loop: a wrapper through which
Python calls it, and one for C, which nobody uses.

Every set says all options: numba hands those that a loop leaves open down from what
calls it, and the machine code that is kept must not depend on who called first.
"""

from roadmap.compiling.linking import LoopCompiler

# Makes no array; called from Python. A division by zero is an error.
LEAN = {
    "cache": True,
    "nogil": True,
    "error_model": "python",
    "forceinline": False,
    "_nrt": False,
    "no_cfunc_wrapper": True,
    "no_cpython_wrapper": False,
    "pipeline_class": LoopCompiler,
}

# The same for a call of microseconds, which keeps Python's lock: a thread that computes
# would take the lock meanwhile, and keep it for 5 ms.
BRIEF = LEAN | {"nogil": False}

# As `LEAN` without a wrapper: called by other loops alone. Python must never call it.
INNER = LEAN | {"no_cpython_wrapper": True}

# As `LEAN` and `INNER`, and a division by zero gives infinity, as in C.
BARE = LEAN | {"error_model": "numpy"}
BARE_INNER = BARE | {"no_cpython_wrapper": True}

# As `BARE`, and written into whatever calls it.
WITHIN = BARE | {"forceinline": True}
WITHIN_INNER = WITHIN | {"no_cpython_wrapper": True}

# Makes arrays, so references are counted.
FULL = LEAN | {"_nrt": True}
FULL_INNER = FULL | {"no_cpython_wrapper": True}
