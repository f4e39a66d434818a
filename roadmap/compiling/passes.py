"""Which of numba's passes a loop of ours goes through: those that change something.

Numba works out anew which variables live where after each of its passes, nine times a
loop, though what it forgets where is asked for once, in the end, and by a generator.
It puts the forgetting in and takes it out again for passes that look for what loops
like ours hold none of, and writes out what it found for whoever wants to read it.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import reduce
from typing import Any

from numba.core import event, ir, ir_utils, postproc, rewrites, transforms
from numba.core.compiler_machinery import PassManager
from numba.core.typed_passes import (
    AnnotateTypes,
    DumpParforDiagnostics,
    NopythonRewrites,
)
from numba.core.types.functions import BaseFunction
from numba.core.untyped_passes import InlineClosureLikes
from numba.stencils.stencil import StencilFunc

from roadmap.compiling.type_lookup import call_type

_INLINED = {"make_function", "build_list"}  # of what numba writes into a loop
_process_at_once = postproc.PostProcessor.run


def _process(self: Any, emit_dels: bool = False, **more: Any) -> None:
    """Do what numba does after a pass; what is live is worked out when it is asked."""
    if self.func_ir.is_generator or any(more.values()):
        _process_at_once(self, emit_dels, **more)
        return
    function = self.func_ir
    function.blocks = transforms.canonicalize_cfg(function.blocks)
    function.variable_lifetime = postproc.VariableLifetime(function.blocks)
    function.generator_info = None
    if emit_dels:
        self._insert_var_dels()


def _of_expression(self: ir.Expr) -> list[ir.Var]:
    return _variables(self._kws.values())


def _of_statement(self: ir.Stmt) -> list[ir.Var]:
    return _variables(vars(self).values())


def _variables(parts: Iterable) -> list[ir.Var]:
    """Return the variables that the parts of an instruction name."""
    found = []
    for one in parts:
        kind = type(one)
        if kind is ir.Var:
            found.append(one)
        elif kind is list or kind is tuple:
            found += _variables(one)
        elif kind is dict:
            found += _variables(one.values())
        elif isinstance(one, ir.Inst):
            found += one.list_vars()
    return found


_QUICK: tuple = (
    (ir.Expr, "list_vars", _of_expression),
    (ir.Stmt, "list_vars", _of_statement),
    (postproc.PostProcessor, "run", _process),
    (BaseFunction, "get_call_type", call_type),
    (event, "start_event", lambda *given, **more: None),
    (event, "end_event", lambda *given, **more: None),
)


@contextmanager
def quick(*more: tuple) -> Iterator[None]:
    """Let numba compile in here as in this file, and tell nobody of each step.

    Args:
        more: Further (owner, name, what to take instead).
    """
    wanted = _QUICK + more
    kept = [getattr(owner, name) for owner, name, _ in wanted]
    for owner, name, ours in wanted:
        setattr(owner, name, ours)
    try:
        yield
    finally:
        for (owner, name, _), plain in zip(wanted, kept, strict=True):
            setattr(owner, name, plain)


class _InlineClosures(InlineClosureLikes):
    """Numba's, where there is anything to write into the loop."""

    def run_pass(self, state: Any) -> bool:
        """Write functions that the loop makes, and lists, into it."""
        if any(map(_may_inline, state.func_ir.blocks.values())):
            return super().run_pass(state)
        ir_utils.fixup_var_define_in_scope(state.func_ir.blocks)
        return False


def _may_inline(block: ir.Block) -> bool:
    for one in block.find_insts(ir.Assign):
        value = one.value
        if isinstance(value, ir.Expr):
            if value.op in _INLINED:
                return True
        elif isinstance(value, (ir.Global, ir.FreeVar)):
            if value.value is reduce or isinstance(value.value, StencilFunc):
                return True
    return False


class _Rewrites(NopythonRewrites):
    """Numba's; only sums of arrays, which nobody has without counts, need more."""

    def run_pass(self, state: Any) -> bool:
        """Rewrite what is known by its types."""
        if state.flags.nrt:
            return super().run_pass(state)
        rewrites.rewrite_registry.apply("after-inference", state)
        return True


_OURS: dict = {InlineClosureLikes: _InlineClosures, NopythonRewrites: _Rewrites}
_LEFT_OUT = (AnnotateTypes, DumpParforDiagnostics)


class LoopPasses:
    """Numba's passes without what nobody reads: times, events, checks of each other.

    Args:
        passes: Numba's, finished.
    """

    def __init__(self, passes: PassManager) -> None:
        self.pipeline_name = passes.pipeline_name
        self.exec_times: dict = {}  # of each pass, which nobody takes
        kinds = [kind for kind, _ in passes.passes if kind not in _LEFT_OUT]
        self._all = [_OURS.get(kind, kind)() for kind in kinds]
        needed = passes.dependency_analysis()
        for one in self._all:
            one.analysis = needed

    def run(self, state: Any) -> None:
        """Compile a loop."""
        for one in self._all:
            one.run_pass(state)
