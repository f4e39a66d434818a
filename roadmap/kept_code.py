"""Machine code that numba keeps of compiled loops, loaded before a first call."""

from collections.abc import Iterable
from contextlib import suppress

from numba.core.caching import CompileResultCacheImpl, IndexDataCacheFile
from numba.core.dispatcher import Dispatcher


class KeptTypes(IndexDataCacheFile):
    """The types of arguments for which code of a compiled loop is kept."""

    def __init__(self, loop: Dispatcher) -> None:
        kept = CompileResultCacheImpl(loop.py_func)
        place = kept.locator
        super().__init__(
            place.get_cache_path(), kept.filename_base, place.get_source_stamp()
        )

    def on(self, machine: tuple) -> list[tuple]:
        """Return the types of code that was made for this kind of processor."""
        return [types for types, kind, _ in self._load_index() if kind == machine]


def load_kept(loops: Iterable[Dispatcher]) -> int:
    """Load what is kept of compiled loops; return for how many types of arguments.

    A start ahead and no more: what cannot be loaded is left to the first call.
    """
    loaded = 0
    for loop in loops:
        with suppress(Exception):  # other versions of numba keep it in another way
            machine = loop.targetctx.codegen().magic_tuple()
            for types in KeptTypes(loop).on(machine):
                loop.compile(types)
                loaded += 1
    return loaded
