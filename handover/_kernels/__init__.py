"""Compiled loops of the handover package; bare on purpose, checks stand outside."""

# Options of loops that make no array. Numba counts the references to every array that
# such a loop only reads, by two locked instructions each time; left out, a reach map
# is built in 4/5 of the time. A loop that does make an array is refused when compiled.
BARE = {"cache": True, "nogil": True, "error_model": "numpy", "_nrt": False}
