"""Options of compiled loops without counted references; checks stand outside."""

# Options of loops that make no array. Numba counts the references to every array that a
# loop reads, by two locked instructions each time: left out, a reach map is built in
# two thirds of the time. A loop that does make an array is refused when it is compiled.
BARE = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "forceinline": False,
    "_nrt": False,
}

# The same, written into whatever calls it.
WITHIN = BARE | {"forceinline": True}

# Loops that do make arrays, or that call loops of other packages: what is called takes
# over the options that it leaves open, and these must not depend on who called first.
FULL = BARE | {"error_model": "python", "_nrt": True}
