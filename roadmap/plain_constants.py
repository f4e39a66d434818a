"""Constants are handed to a loop as the numbers they are, not as types of their own.

To numba a constant in a call, as in `pop(heap, 0)`, is of a type that says its value,
and a loop is compiled anew for each of these. Nothing in our loops asks for it.
"""

import numpy as np
from numba.core import ir
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.dispatcher import Dispatcher


@register_pass(mutates_CFG=False, analysis_only=False)
class PlainConstants(FunctionPass):
    """Replace whole numbers and truth values in calls of loops by numpy's."""

    _name = "plain_constants"

    def __init__(self) -> None:
        """Keep nothing."""
        FunctionPass.__init__(self)

    def run_pass(self, state: CompilerBase) -> bool:
        """Return whether anything was replaced."""
        blocks = state.func_ir.blocks.values()
        values = _assigned(state.func_ir)
        changed = False
        for block in blocks:
            body = []
            for statement in block.body:
                call = statement.value if isinstance(statement, ir.Assign) else None
                if isinstance(call, ir.Expr) and _calls_loop(call, values):
                    made = _plain_arguments(call, values, block.scope)
                    changed |= bool(made)
                    body += made
                body.append(statement)
            block.body = body
        return changed


def _assigned(func_ir: ir.FunctionIR) -> dict[str, list]:
    """Return what is assigned to each variable."""
    values: dict[str, list] = {}
    for block in func_ir.blocks.values():
        for one in block.find_insts(ir.Assign):
            values.setdefault(one.target.name, []).append(one.value)
    return values


def _source(name: str, values: dict[str, list]) -> object:
    """Return the one thing that a variable is, through copies; else None."""
    while True:
        found = values.get(name, [])
        if len(found) != 1:
            return None
        if not isinstance(found[0], ir.Var):
            return found[0]
        name = found[0].name


def _calls_loop(call: ir.Expr, values: dict[str, list]) -> bool:
    if call.op != "call":
        return False
    what = _source(call.func.name, values)
    if not isinstance(what, (ir.Global, ir.FreeVar)):
        return False
    return isinstance(what.value, Dispatcher)


def _plain_arguments(call: ir.Expr, values: dict[str, list], scope: ir.Scope) -> list:
    """Put plain numbers in the place of a call's constants; return their statements."""
    made = []

    def plain(given: ir.Var) -> ir.Var:
        what = _source(given.name, values)
        if not isinstance(what, (ir.Const, ir.Global, ir.FreeVar)):
            return given
        value = what.value
        if type(value) not in (int, bool) or not -(2**63) <= value < 2**63:
            return given
        number = np.bool_(value) if type(value) is bool else np.int64(value)
        target = scope.redefine("$plain", call.loc)
        made.append(ir.Assign(ir.Const(number, call.loc), target, call.loc))
        return target

    call.args = [plain(one) for one in call.args]
    call.kws = [(name, plain(one)) for name, one in call.kws]
    return made
