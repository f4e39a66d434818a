"""The wrapper through which Python calls a loop: arrays are taken by one function.

Numba writes out how an array is taken from Python, and how a tuple is put together,
once for each array. Our groups of arrays have dozens of them, and LLVM then spends
more on this wrapper than on the loop. Here one function of the wrapper takes an array
and writes where it lies into the group; the wrapper calls it for each.
"""

from collections.abc import Callable
from types import MethodType
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.callwrapper import PyCallWrapper
from numba.core.pythonapi import NativeValue, PythonAPI
from numba.np.numpy_support import as_dtype

from roadmap.compiling.lowering import value_at

_TAKE = "roadmap.take_array"
_WORDS = (
    "can't unbox array from PyObject into native value.  "
    "The object maybe of a different type"  # numba's own
)
_ITEMSIZE = 3  # its place in an array, after two addresses and the number of items
_MEMBERS = (types.Number, types.Boolean, types.Array)


def use_small_wrappers(context: BaseContext) -> None:
    """Let a context of one compilation make its wrappers here."""
    context.create_cpython_wrapper = MethodType(_create, context)


def without_lookup(loop: Any, *given: object) -> Callable:  # noqa: ANN401
    """Return what calls a loop's machine code for arguments of these very types.

    Numba looks at the type of each argument in each call, which takes 0.1 us. Who calls
    what is returned must see to it that the types stay the same, with the order of an
    array's numbers and whether they may be written.
    """
    if not hasattr(loop, "compile"):  # as NUMBA_DISABLE_JIT has it
        return loop
    return loop.compile(tuple(map(loop.typeof_pyval, given)))


def _create(
    context: BaseContext,
    library: Any,
    fndesc: Any,
    env: object,
    call_helper: object,
    release_gil: bool = False,
) -> None:
    """Write the wrapper of a loop into its library, as numba's own context does."""
    module = context.create_module("wrapper")
    kind = context.call_conv.get_function_type(fndesc.restype, fndesc.argtypes)
    callee = ir.Function(module, kind, fndesc.llvm_func_name)
    _Wrapper(context, module, callee, fndesc, env, call_helper, release_gil).build()
    library.add_ir_module(module)


class _Wrapper(PyCallWrapper):
    """Numba's own, but for how arrays are taken."""

    def build_wrapper(
        self, api: PythonAPI, builder: ir.IRBuilder, *given: ir.Value
    ) -> None:
        """Write the body of the wrapper."""
        super().build_wrapper(_Taking(self.context, builder), builder, *given)


class _Taking(PythonAPI):
    """Numba's calls of Python; arrays, and tuples of them, are written in place."""

    def to_native_value(self, typ: types.Type, obj: ir.Value) -> NativeValue:
        """Take an argument from Python."""
        if not _is_plain(typ) or isinstance(typ, (types.Number, types.Boolean)):
            return super().to_native_value(typ, obj)
        kind = self.context.get_value_type(typ)
        place = cgutils.alloca_once(self.builder, kind)
        failed = self._write(typ, obj, place)
        return NativeValue(value_at(self.builder, place), is_error=failed)

    def _write(self, typ: types.Type, obj: ir.Value, place: ir.Value) -> ir.Value:
        """Write an argument to its place; return whether that failed."""
        builder = self.builder
        if isinstance(typ, types.Array):
            size = ir.Constant(self.py_ssize_t, as_dtype(typ.dtype).itemsize)
            there = builder.bitcast(place, self.voidptr)
            return builder.call(self._take(), (obj, there, size))
        if not isinstance(typ, types.BaseTuple):
            native = super().to_native_value(typ, obj)
            builder.store(native.value, place)
            return native.is_error
        n = ir.Constant(self.py_ssize_t, len(typ))
        failed = builder.icmp_signed("!=", self.tuple_size(obj), n)
        with builder.if_then(failed, likely=False):
            words = f"size mismatch for tuple, expected {len(typ)} element(s)"
            self.err_set_string("PyExc_ValueError", words)
        for k, member in enumerate(typ):
            there = cgutils.gep_inbounds(builder, place, 0, k)
            bad = self._write(member, self.tuple_getitem(obj, k), there)
            failed = builder.or_(failed, bad)
        return failed

    def _take(self) -> ir.Function:
        """Return the function that takes an array: 1 if it is none, or another's."""
        found = self.module.globals.get(_TAKE)
        if found is not None:
            return found
        flag = ir.IntType(1)
        kind = ir.FunctionType(flag, [self.pyobj, self.voidptr, self.py_ssize_t])
        function = ir.Function(self.module, kind, _TAKE)
        function.linkage = "internal"
        function.attributes.add("noinline")
        obj, place, size = function.args
        builder = ir.IRBuilder(function.append_basic_block("entry"))
        api = PythonAPI(self.context, builder)
        adapt = api.numba_array_adaptor
        if self.context.enable_nrt:
            adapt = api.nrt_adapt_ndarray_from_python
        with builder.if_then(cgutils.is_null(builder, obj), likely=False):
            builder.ret(flag(1))
        wrong = cgutils.is_not_null(builder, adapt(obj, place))
        words = builder.bitcast(place, self.py_ssize_t.as_pointer())
        at = builder.gep(words, [ir.IntType(32)(_ITEMSIZE)])
        wrong = builder.or_(wrong, builder.icmp_signed("!=", builder.load(at), size))
        with builder.if_then(wrong, likely=False):
            api.err_set_string("PyExc_TypeError", _WORDS)
        builder.ret(wrong)
        return function


def _is_plain(typ: types.Type) -> bool:
    """Return True for arrays and numbers, and tuples of them: nothing to tidy up."""
    if isinstance(typ, types.BaseTuple):
        return all(map(_is_plain, typ))
    return isinstance(typ, _MEMBERS)
