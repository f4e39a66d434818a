"""How the types in our loops are found: looked up once, and without constants.

For each sum of two numbers numba asks some twenty templates, of strings, lists and
sets, too, whether it is theirs, and each of them compares all options that the loop
is compiled with. Both answers stay the same: equal options are one object here, and
what an operator makes of plain numbers and arrays is looked up once.

To numba a constant in a call, as in `pop(heap, 0)`, is of a type that says its value,
and a loop is compiled anew for each of these. Nothing in our loops asks for it: they
are handed the numbers.
"""

from numba import types
from numba.core.compiler import Flags
from numba.core.compiler_machinery import PassManager
from numba.core.targetconfig import ConfigStack
from numba.core.types.functions import BaseFunction
from numba.core.typing import BaseContext, Signature

# Types whose look-up costs little, also as an index, a constant or a range.
_PLAIN = {
    types.Integer, types.Float, types.Boolean, types.Array, types.UniTuple, types.Tuple,
    types.IntegerLiteral, types.BooleanLiteral, types.RangeType, types.NumberClass,
}  # fmt: skip

_signatures: dict[tuple, Signature] = {}
_looked_up = BaseFunction.get_call_type  # numba's own


def call_type(
    self: BaseFunction, context: BaseContext, args: tuple, kws: dict
) -> Signature:
    """Return the types of a call of a function of numba's, looked up once."""
    if kws or not _PLAIN.issuperset(map(type, args)):
        return _looked_up(self, context, args, kws)
    key = self, tuple(args)
    signature = _signatures.get(key)
    if signature is None:
        signature = _looked_up(self, context, args, kws)
        # one that numba compiles depends on the options, and is asked for anew
        if self.get_impl_key(signature) is self.typing_key:
            _signatures[key] = signature
    return signature


class LookupContext:
    """Numba's typing context; it hands loops no constants."""

    def __init__(self, context: BaseContext) -> None:
        self._context = context

    def __getattr__(self, name: str) -> object:
        return getattr(self._context, name)

    def resolve_function_type(
        self, func: object, args: tuple, kws: dict
    ) -> Signature | None:
        """Return the types of a call; None if no such function is known."""
        if isinstance(func, types.Dispatcher):
            args = tuple(_number(a) for a in args)
            kws = {name: _number(a) for name, a in dict(kws).items()}
        return self._context.resolve_function_type(func, args, kws)


def _number(one: types.Type) -> types.Type:
    """Return the type of a number that a loop is handed: without its value, of 64 bits.

    Numba adds and multiplies signed numbers of fewer bits as such of 64 in any case.
    Those without a sign stay as they are: with one they would become floats elsewhere.
    """
    if isinstance(one, (types.IntegerLiteral, types.BooleanLiteral)):
        one = types.unliteral(one)
    is_short = isinstance(one, types.Integer) and one.signed and one.bitwidth < 64
    return types.int64 if is_short else one


class _SharedFlags(Flags):
    """Options under which a loop is compiled; equal ones are the same object."""

    __slots__ = ()
    _hash = hash(Flags())

    def copy(self) -> Flags:
        """Return options that may be changed."""
        return Flags(self)

    def __hash__(self) -> int:
        """Return numba's number, the same for all of them."""
        return self._hash

    def __eq__(self, other: object) -> bool:
        """Compare by value with numba's own only."""
        return self is other if type(other) is _SharedFlags else super().__eq__(other)


_shared: list[_SharedFlags] = []  # as many as there are sets of options


class SharedFlagsPasses:
    """Numba's passes; what they look up by the loop's options is found at once."""

    def __init__(self, passes: PassManager) -> None:
        self._passes = passes

    def __getattr__(self, name: str) -> object:
        return getattr(self._passes, name)

    def run(self, state: object) -> None:
        """Compile a loop."""
        given = ConfigStack().top()
        shared = next((flags for flags in _shared if flags == given), None)
        if shared is None:
            shared = _SharedFlags(given)
            _shared.append(shared)
        with ConfigStack().enter(shared):
            self._passes.run(state)
