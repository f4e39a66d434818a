"""How our loops become LLVM's instructions: few for an element, none for a variable.

For each element that a loop reads or writes numba writes the array's numbers, nine of
a matrix, to the stack and reads back the few that it needs; so it does for a shape.
Here the few are taken where they are. The arithmetic is numba's own, and so is
everything but plain numbers in plain arrays.

And it keeps a variable that more than one part of a loop uses on the stack, and reads
all of it for each use: of a group of arrays a hundred numbers for one. Taking them
apart again was a fifth of LLVM's work. Here a variable that is assigned once is that
value.

And it hands a group of arrays on number by number: two hundred for a few arrays, which
the caller writes to the stack, of which most loops read a dozen. Here a loop is handed
the address of a group, and so is what that loop calls. A group lies in the planner's
table, or where it was put together, and nobody writes there while it is used.
"""

import operator
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core import ir as numba_ir
from numba.core.analysis import (
    compute_cfg_from_blocks,
    compute_use_defs,
    must_use_alloca,
)
from numba.core.base import BaseContext
from numba.core.callconv import CPUCallConv, excinfo_t
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.cpu import CPUContext
from numba.core.datamodel import ArgPacker
from numba.core.imputils import impl_ret_borrowed
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering
from numba.core.typing import Signature
from numba.np import arrayobj

_NUMBERS = (types.Number, types.Boolean)
_WITH_CONSTANTS = ("static_getitem", "static_setitem")  # numba has none for arrays
SEVERAL = 3  # arrays of a named tuple, at least, that is handed on by its address
_sizes: dict[str, int] = {}
_alignments: dict[str, int] = {}


def reach_elements_directly(context: BaseContext) -> None:
    """Let a context of one compilation reach elements as here."""
    if type(context) is CPUContext:
        context.__class__ = _LoopContext


def array_value(
    context: BaseContext, builder: ir.IRBuilder, typ: types.Array, **fields: Any
) -> ir.Value:
    """Return an array by value.

    Args:
        context: Numba's.
        builder: Where to.
        typ: Its type.
        fields: data, itemsize, and the lists shape and strides; meminfo and parent are
            null if they are not given.
    """
    shape, strides = fields.pop("shape"), fields.pop("strides")
    model = context.data_model_manager[typ]
    whole = model.get_value_type()
    numbers = ir.Constant(ir.IntType(64), 1)
    for length in shape:
        numbers = builder.mul(numbers, length, flags=["nsw"])
    fields["nitems"] = numbers
    value = ir.Constant(whole, None)
    for name, one in fields.items():
        value = builder.insert_value(value, one, model.get_field_position(name))
    for name, row in (("shape", shape), ("strides", strides)):
        at = model.get_field_position(name)
        for axis, one in enumerate(row):
            value = builder.insert_value(value, one, [at, axis])
    return value


class _Given:
    """The numbers of an array that is there by value; see numba's array structure."""

    def __init__(
        self, context: BaseContext, builder: ir.IRBuilder, typ: types.Array, value: Any
    ) -> None:
        self._builder, self._value = builder, value
        self._at = context.data_model_manager[typ].get_field_position

    def __getattr__(self, name: str) -> ir.Value:
        return self._builder.extract_value(self._value, self._at(name))


class _LoopContext(CPUContext):
    """Numba's own, but for elements and shapes of plain arrays."""

    def get_function(self, fn: Any, sig: Signature, _firstcall: bool = True) -> Any:
        """Return what makes the code of a call."""
        key = getattr(fn, "typing_key", fn)
        if key in _WITH_CONSTANTS and _is_of_numbers(sig.args[0]):
            raise NotImplementedError  # what asks takes `operator.getitem` then
        if key is operator.getitem and _is_plain(sig.args):
            return _Bound(_read, self, sig)
        if key is operator.setitem and _is_plain(sig.args[:2]):
            array, index, value = sig.args
            if _rank(index) == array.ndim and isinstance(value, _NUMBERS):
                return _Bound(_write, self, sig)
        return super().get_function(fn, sig, _firstcall)

    def get_getattr(self, typ: types.Type, attr: str) -> Any:
        """Return what makes the code that reads an attribute."""
        if attr == "shape" and type(typ) is types.Array:
            return _shape
        if isinstance(typ, types.BaseNamedTuple) and _is_group(typ):
            return _member
        return super().get_getattr(typ, attr)

    @property
    def call_conv(self) -> CPUCallConv:
        """How loops call each other."""
        return _CallConv(self)

    def get_arg_packer(self, fe_args: tuple) -> ArgPacker:
        """Return how arguments are handed on."""
        return _Packer(self, fe_args)

    def get_abi_sizeof(self, ty: ir.Type) -> int:
        """Return how many bytes a value takes; LLVM reads a whole module to tell."""
        key = str(ty)
        if key not in _sizes:
            _sizes[key] = super().get_abi_sizeof(ty)
        return _sizes[key]

    def get_abi_alignment(self, ty: ir.Type) -> int:
        """Return to how many bytes a value is aligned."""
        key = str(ty)
        if key not in _alignments:
            _alignments[key] = super().get_abi_alignment(ty)
        return _alignments[key]


class _CallConv(CPUCallConv):
    """Numba's own, but for groups that are returned: they lie where they were put."""

    def call_function(
        self,
        builder: ir.IRBuilder,
        callee: ir.Function,
        resty: types.Type,
        argtys: Any,
        args: Any,
        attrs: Any = None,
    ) -> tuple:
        """Call a loop; return what came of it, and its result."""
        if not _lies_as_it_is(self.context, resty):
            return super().call_function(builder, callee, resty, argtys, args, attrs)
        place = cgutils.alloca_once(builder, self.get_return_type(resty).pointee)
        exc = cgutils.alloca_once(builder, ir.PointerType(excinfo_t))
        given = self._get_arg_packer(argtys).as_arguments(builder, args)
        code = builder.call(callee, [place, exc, *given], attrs=attrs or ())
        status = self._get_return_status(builder, code, builder.load(exc))
        return status, value_at(builder, place)


class _Packer(ArgPacker):
    """Numba's own, but for groups of arrays: they are handed on by where they lie."""

    def __init__(self, context: BaseContext, kinds: tuple) -> None:
        self._large = [k for k, kind in enumerate(kinds) if _is_group(kind)]
        self._kinds = [context.get_value_type(kinds[k]) for k in self._large]
        given = list(kinds)
        for k in self._large:
            given[k] = types.voidptr
        super().__init__(context.data_model_manager, tuple(given))

    def as_arguments(self, builder: ir.IRBuilder, values: Any) -> tuple:
        """Return what a call is handed."""
        values = list(values)
        for k in self._large:
            place = _place_of(builder, values[k])
            values[k] = builder.bitcast(place, cgutils.voidptr_t)
        return super().as_arguments(builder, values)

    def from_arguments(self, builder: ir.IRBuilder, args: Any) -> list:
        """Return the arguments of a call."""
        values = super().from_arguments(builder, args)
        for k, kind in zip(self._large, self._kinds, strict=True):
            place = builder.bitcast(values[k], kind.as_pointer())
            values[k] = value_at(builder, place)
        return values


def value_at(builder: ir.IRBuilder, place: ir.Value) -> ir.Value:
    """Return what lies at a place that nothing writes to while it is used."""
    value = builder.load(place)
    value.lies_at = place
    return value


def _place_of(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    """Return where a value lies; it is written there as soon as it is known."""
    place = getattr(value, "lies_at", None)
    if place is None:
        place = cgutils.alloca_once(builder, value.type)
        here = builder
        if isinstance(value, ir.Instruction):
            value.lies_at = place
            if value.parent is not builder.block:
                here = ir.IRBuilder(value.parent)
                here.position_before(value.parent.terminator)
        here.store(value, place)
    return place


def _is_group(kind: types.Type) -> bool:
    """Return True for named tuples of several arrays; numba's own loops take none."""
    return isinstance(kind, types.BaseNamedTuple) and _arrays(kind) >= SEVERAL


def _arrays(kind: types.Type) -> int:
    """Return how many plain arrays there are in a tuple, and in those that it holds."""
    if isinstance(kind, types.BaseTuple):
        return sum(_arrays(one) for one in kind)
    return 1 if type(kind) is types.Array else 0


def _lies_as_it_is(context: BaseContext, kind: types.Type) -> bool:
    """Return True for a group that is returned as it is used: all but single bits."""
    return _is_group(kind) and context.get_data_type(kind) == context.get_value_type(
        kind
    )


class _Bound:
    """A way to make code, with the types of a call."""

    libs = ()

    def __init__(self, make: Any, context: BaseContext, sig: Signature) -> None:
        self._make, self._context, self._sig = make, context, sig

    def __call__(self, builder: ir.IRBuilder, args: tuple, loc: Any = None) -> ir.Value:
        return self._make(self._context, builder, self._sig, args)


def _rank(index: types.Type) -> int:
    """Return how many whole numbers an index is; -1 if it is anything else."""
    if isinstance(index, types.Integer):
        return 1
    if isinstance(index, types.BaseTuple):
        if all(isinstance(one, types.Integer) for one in index):
            return len(index)
    return -1


def _is_plain(args: tuple) -> bool:
    """Return True for a plain array of numbers, and whole numbers as its index."""
    array, index = args
    return _is_of_numbers(array) and 1 <= _rank(index) <= array.ndim


def _is_of_numbers(array: types.Type) -> bool:
    return type(array) is types.Array and isinstance(array.dtype, _NUMBERS)


def _place(
    context: BaseContext, builder: ir.IRBuilder, sig: Signature, args: tuple
) -> tuple:
    """Return the array, where its element or part begins, and that part's extent."""
    typ, index = sig.args[:2]
    array = _Given(context, builder, typ, args[0])
    kinds, numbers = (index,), (args[1],)
    if isinstance(index, types.BaseTuple):
        kinds, numbers = tuple(index), cgutils.unpack_tuple(builder, args[1])
    checked = context.enable_boundscheck
    return array, *arrayobj.basic_indexing(
        context, builder, typ, array, kinds, numbers, boundscheck=checked
    )


def _read(
    context: BaseContext, builder: ir.IRBuilder, sig: Signature, args: tuple
) -> ir.Value:
    typ, result = sig.args[0], sig.return_type
    array, data, shape, strides = _place(context, builder, sig, args)
    if not isinstance(result, types.Array):
        return arrayobj.load_item(context, builder, typ, data)
    fields = {name: getattr(array, name) for name in ("meminfo", "parent", "itemsize")}
    value = array_value(
        context, builder, result, data=data, shape=shape, strides=strides, **fields
    )
    return impl_ret_borrowed(context, builder, result, value)


def _write(
    context: BaseContext, builder: ir.IRBuilder, sig: Signature, args: tuple
) -> None:
    typ, _, kind = sig.args
    _, data, _, _ = _place(context, builder, sig, args)
    value = context.cast(builder, args[2], kind, typ.dtype)
    arrayobj.store_item(context, builder, typ, value, data)


def _shape(
    context: BaseContext, builder: ir.IRBuilder, typ: Any, value: Any, attr: str
) -> ir.Value:
    return _Given(context, builder, typ, value).shape


def _member(
    context: BaseContext, builder: ir.IRBuilder, typ: Any, value: Any, attr: str
) -> ir.Value:
    k = typ.fields.index(attr)
    member = builder.extract_value(value, k)
    place = getattr(value, "lies_at", None)
    if place is not None and _is_group(typ[k]):
        member.lies_at = cgutils.gep_inbounds(builder, place, 0, k)
    return impl_ret_borrowed(context, builder, typ[k], member)


class _Lower(Lower):
    """Numba's own, but for variables that are assigned once."""

    def _find_singly_assigned_variable(self) -> None:
        """Find variables that are values: assigned once, before every use."""
        if self.func_ir.func_id.is_generator or self.context.enable_nrt:
            super()._find_singly_assigned_variable()  # deleted twice, counted twice
            return
        blocks = self.blocks
        places = must_use_alloca(blocks)
        sets = compute_use_defs(blocks)
        dominators = compute_cfg_from_blocks(blocks).dominators()
        assigned: dict[str, list[int]] = {}
        used: dict[str, set[int]] = {}
        for at, block in blocks.items():
            for name in sets.usemap[at]:
                used.setdefault(name, set()).add(at)
            for statement in block.body:
                if isinstance(statement, numba_ir.Assign):
                    assigned.setdefault(statement.target.name, []).append(at)
                elif isinstance(statement, numba_ir.Del):
                    used.setdefault(statement.value, set()).add(at)
        self._singly_assigned_vars = set()
        self._blk_local_varmap: dict[str, ir.Value] = {}
        for name, [begin, *again] in assigned.items():
            if again or name in places or begin not in dominators:
                continue
            if name not in sets.defmap[begin] or name in sets.usemap[begin]:
                continue  # of the round before
            others = used.get(name, set()) - {begin}
            if all(at > begin and begin in dominators.get(at, ()) for at in others):
                self._singly_assigned_vars.add(name)


@register_pass(mutates_CFG=True, analysis_only=False)
class _LoopLowering(NativeLowering):
    """Numba's pass, with the above."""

    _name = "roadmap_loop_lowering"

    @property
    def lowering_class(self) -> type[Lower]:
        """The class that writes the code."""
        return _Lower


def keep_values(passes: PassManager) -> None:
    """Let passes lower variables as here."""
    passes.passes = [
        (_LoopLowering if one is NativeLowering else one, told)
        for one, told in passes.passes
    ]
    passes.finalize()
