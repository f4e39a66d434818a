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
from functools import partial, reduce
from itertools import chain
from typing import Any

from llvmlite import ir
from llvmlite.ir import instructions
from numba import types
from numba.core import callconv, cgutils
from numba.core import ir as numba_ir
from numba.core.analysis import must_use_alloca
from numba.core.base import BaseContext
from numba.core.callconv import CPUCallConv, TryStatus, excinfo_t
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.cpu import CPUContext
from numba.core.datamodel import ArgPacker
from numba.core.imputils import impl_ret_borrowed
from numba.core.lowering import Lower
from numba.core.runtime.context import NRTContext
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
    fields["nitems"] = reduce(partial(builder.mul, flags=["nsw"]), shape)
    value = ir.Constant(whole, None)
    for name, one in fields.items():
        value = builder.insert_value(value, one, model.get_field_position(name))
    for name, row in (("shape", shape), ("strides", strides)):
        at = model.get_field_position(name)
        for axis, one in enumerate(row):
            value = builder.insert_value(value, one, [at, axis])
    return value


def part(builder: ir.IRBuilder, value: ir.Value, *path: int) -> ir.Value:
    """Return a member of a value, taken once, where the value is made.

    Args:
        builder: At the end of its block.
        value: An array, a tuple or a structure.
        path: Places in the value, in its member there, and so on.
    """
    while path:
        at = tuple(getattr(value, "indices", ()))
        if isinstance(value, instructions.ExtractValue):
            value, path = value.operands[0], at + path
        elif isinstance(value, instructions.InsertValue):
            shared = min(len(at), len(path))
            if path[:shared] != at[:shared]:
                value = value.operands[0]
            elif shared == len(at):
                value, path = value.operands[1], path[shared:]
            else:
                break
        else:
            break
    if not path:
        return value
    if not isinstance(value, ir.Instruction) or isinstance(value, ir.PhiInstr):
        return builder.extract_value(value, path)
    parts = vars(value).setdefault("parts", {})
    if path not in parts:
        here = ir.IRBuilder(value.parent)
        here.position_after(value)
        if isinstance(value, ir.LoadInstr) and _lies_at(value) is value.operands[0]:
            place = cgutils.gep_inbounds(here, value.lies_at, 0, *path)
            parts[path] = value_at(here, place)
        else:
            parts[path] = here.extract_value(value, path)
        if builder.block is value.parent:
            builder.position_at_end(builder.block)
    return parts[path]


class _Given:
    """The numbers of an array that is there by value; see numba's array structure."""

    def __init__(
        self, context: BaseContext, builder: ir.IRBuilder, typ: types.Array, value: Any
    ) -> None:
        self._builder, self._value, self._rank = builder, value, typ.ndim
        self._at = context.data_model_manager[typ].get_field_position

    def __getattr__(self, name: str) -> ir.Value:
        return part(self._builder, self._value, self._at(name))

    def row(self, name: str) -> list[ir.Value]:
        """Return the numbers of `shape` or `strides`."""
        at = self._at(name)
        return [part(self._builder, self._value, at, k) for k in range(self._rank)]


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
        if key is range or key in _OF_RANGES and isinstance(sig.args[0], _RANGES):
            return _Bound(_OF_RANGES[key], self, sig)
        return super().get_function(fn, sig, _firstcall)

    def pair_first(self, builder: ir.IRBuilder, val: ir.Value, ty: types.Type) -> Any:
        """Return the first of two."""
        return part(builder, val, 0)

    def pair_second(self, builder: ir.IRBuilder, val: ir.Value, ty: types.Type) -> Any:
        """Return the second of two."""
        return part(builder, val, 1)

    @property
    def nrt(self) -> NRTContext:
        """How references are counted."""
        return _Counts(self, self.enable_nrt)

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


class _Status:
    """What came of a call; what is asked for of it is worked out there."""

    _tests = {
        "is_python_exc": ("==", callconv.RETCODE_EXC),
        "is_stop_iteration": ("==", callconv.RETCODE_STOPIT),
        "is_user_exc": (">=", callconv.RETCODE_USEREXC),
        "is_none": ("==", callconv.RETCODE_NONE),
    }

    def __init__(self, builder: ir.IRBuilder, code: ir.Value, error: ir.Value) -> None:
        self._builder, self.code, self.excinfoptr = builder, code, error
        plain = builder.icmp_signed("==", code, callconv.RETCODE_OK)
        self.is_ok = builder.or_(plain, self.is_none)
        self.is_error = builder.not_(self.is_ok)

    def __getattr__(self, name: str) -> ir.Value:
        test, code = self._tests[name]
        return self._builder.icmp_signed(test, self.code, code)


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
        place = cgutils.alloca_once(builder, self.get_return_type(resty).pointee)
        exc = cgutils.alloca_once(builder, ir.PointerType(excinfo_t))
        given = self._get_arg_packer(argtys).as_arguments(builder, args)
        code = builder.call(callee, [place, exc, *given], attrs=attrs or ())
        status = _Status(builder, code, builder.load(exc))
        if _lies_as_it_is(self.context, resty):
            return status, value_at(builder, place)
        value = builder.load(place)
        return status, self.context.get_returned_value(builder, resty, value)

    def set_try_status(self, builder: ir.IRBuilder) -> None:
        """Note that a part of the loop is tried."""
        builder.function.tries = True
        super().set_try_status(builder)

    def check_try_status(self, builder: ir.IRBuilder) -> TryStatus:
        """Return whether an error would be caught here: in few loops any is."""
        if hasattr(builder.function, "tries"):
            return super().check_try_status(builder)
        error = builder.load(self._get_excinfo_argument(builder.function))
        return TryStatus(in_try=cgutils.false_bit, excinfo=error)

    def return_status_propagate(self, builder: ir.IRBuilder, status: Any) -> None:
        """Return with the error of a call."""
        if hasattr(builder.function, "tries"):
            super().return_status_propagate(builder, status)
            return
        error = self._get_excinfo_argument(builder.function)
        builder.store(status.excinfoptr, error)
        self._return_errcode_raw(builder, status.code)


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


def _lies_at(value: ir.Value) -> ir.Value | None:
    return getattr(value, "lies_at", None)


def _place_of(builder: ir.IRBuilder, value: ir.Value) -> ir.Value:
    """Return where a value lies; it is written there as soon as it is known."""
    place = _lies_at(value)
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
    kinds, numbers = (index,), [args[1]]
    if isinstance(index, types.BaseTuple):
        kinds = tuple(index)
        numbers = [part(builder, args[1], k) for k in range(len(kinds))]
    if typ.layout != "C" or context.enable_boundscheck:
        return array, *arrayobj.basic_indexing(
            context, builder, typ, array, kinds, numbers,
            boundscheck=context.enable_boundscheck,
        )  # fmt: skip
    shape = array.row("shape")
    offset = None
    for axis, (kind, number) in enumerate(zip(kinds, numbers, strict=True)):
        if not isinstance(number, ir.Constant) or number.constant < 0:
            number = arrayobj.fix_integer_index(
                context, builder, kind, number, shape[axis]
            )
        if axis + 1 < typ.ndim:
            number = builder.mul(number, reduce(builder.mul, shape[axis + 1 :]))
        offset = number if offset is None else builder.add(offset, number)
    n = len(kinds)
    place = builder.gep(array.data, [offset])
    return array, place, shape[n:], array.row("strides")[n:]


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
    member = part(builder, value, k)
    return impl_ret_borrowed(context, builder, typ[k], member)


def _structure(context: BaseContext, builder: Any, kind: Any, *members: Any) -> Any:
    value = ir.Constant(context.get_value_type(kind), ir.Undefined)
    for k, one in enumerate(members):
        value = builder.insert_value(value, one, k)
    return value


def _range(
    context: BaseContext, builder: ir.IRBuilder, sig: Signature, args: tuple
) -> ir.Value:
    whole = args[0].type
    first, last, *step = args if len(args) > 1 else (whole(0), *args)
    kind = sig.return_type
    return _structure(context, builder, kind, first, last, *step or [whole(1)])


def _begin_range(
    context: BaseContext, builder: ir.IRBuilder, sig: Signature, args: tuple
) -> ir.Value:
    """Return where a range is: the next number, and how many are left."""
    first, last, step = (part(builder, args[0], k) for k in range(3))
    if not (isinstance(step, ir.Constant) and step.constant == 1):
        plain = super(_LoopContext, context).get_function("getiter", sig)
        return plain(builder, args)
    number, left = (cgutils.alloca_once(builder, first.type) for _ in range(2))
    builder.store(first, number)
    length = builder.sub(last, first)
    some = builder.icmp_signed(">", length, length.type(0))
    builder.store(builder.select(some, length, length.type(0)), left)
    return _structure(context, builder, sig.return_type, number, last, step, left)


def _next_of_range(
    context: BaseContext, builder: ir.IRBuilder, sig: Signature, args: tuple
) -> ir.Value:
    """Return the next number, and whether there is one."""
    at, step, count = (part(builder, args[0], k) for k in (0, 2, 3))
    number, left = builder.load(at), builder.load(count)
    some = builder.icmp_signed(">", left, left.type(0))
    builder.store(builder.add(number, step), at)
    builder.store(builder.sub(left, left.type(1)), count)
    return _structure(context, builder, sig.return_type, number, some)


_RANGES = (types.RangeType, types.RangeIteratorType)
_OF_RANGES = {range: _range, "getiter": _begin_range, "iternext": _next_of_range}


class _Counts(NRTContext):
    """Numba's own, but for arrays in tuples: what is counted is taken at once."""

    def get_meminfos(
        self, builder: ir.IRBuilder, ty: types.Type, val: ir.Value, *path: int
    ) -> list:
        """Return the arrays of a value, and where their references are counted."""
        if isinstance(ty, types.BaseTuple):
            each = (
                self.get_meminfos(builder, kind, val, *path, k)
                for k, kind in enumerate(ty)
            )
            return list(chain.from_iterable(each))
        if type(ty) is types.Array:
            return [(ty, part(builder, val, *path, 0))]
        if isinstance(ty, _NUMBERS):
            return []
        return super().get_meminfos(builder, ty, part(builder, val, *path))


class _Lower(Lower):
    """Numba's own, but for variables that are assigned once."""

    def delvar(self, name: str) -> None:
        """Forget a variable, which is nothing where nothing is counted."""
        if self.context.enable_nrt:
            super().delvar(name)

    def _find_singly_assigned_variable(self) -> None:
        """Find variables that are values: assigned once, before every use."""
        if self.func_ir.func_id.is_generator or self.context.enable_nrt:
            super()._find_singly_assigned_variable()  # deleted twice, counted twice
            return
        blocks = self.blocks
        places = must_use_alloca(blocks)
        lifetime = self.func_ir.variable_lifetime
        sets, dominators = lifetime.usedefs, lifetime.cfg.dominators()
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
