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
from numba.core.typing import BaseContext, Signature

# Types whose look-up costs little; a literal is of its own class, and not among them.
_PLAIN = {types.Integer, types.Float, types.Boolean, types.Array}

_signatures: dict[tuple, Signature] = {}


class LookupContext:
    """Numba's typing context; it remembers operators, and hands loops no constants."""

    def __init__(self, context: BaseContext) -> None:
        self._context = context

    def __getattr__(self, name: str) -> object:
        """Return what numba's own has."""
        return getattr(self._context, name)

    def resolve_function_type(
        self, func: object, args: tuple, kws: dict
    ) -> Signature | None:
        """Return the types of a call; None if no such function is known."""
        if isinstance(func, types.Dispatcher):
            args = tuple(_number(a) for a in args)
            kws = {name: _number(a) for name, a in dict(kws).items()}
            return self._context.resolve_function_type(func, args, kws)
        plain = not kws and not {type(a) for a in args} - _PLAIN
        if not (isinstance(func, types.Function) and plain):
            return self._context.resolve_function_type(func, args, kws)
        key = func, args
        signature = _signatures.get(key)
        if signature is None:
            signature = self._context.resolve_function_type(func, args, kws)
            # one that numba compiles depends on the options, and is asked for anew
            if signature and func.get_impl_key(signature) is func.typing_key:
                _signatures[key] = signature
        return signature


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
        """Return what numba's own has."""
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
