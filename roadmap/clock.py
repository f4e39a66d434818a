"""The clock of `time.perf_counter_ns`, read inside a compiled loop."""

import time

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.typing import Context, Signature
from numba.extending import intrinsic

# macOS counts what `perf_counter` does by a clock of its own
CLOCK = getattr(time, "CLOCK_UPTIME_RAW", time.CLOCK_MONOTONIC)


@intrinsic
def clock_ns(typing: Context) -> tuple[Signature, object]:
    """Return the time [ns], by C's `clock_gettime`."""

    def write(
        context: BaseContext,
        builder: ir.IRBuilder,
        signature: Signature,
        given: tuple[ir.Value, ...],
    ) -> ir.Value:
        number, whole = ir.IntType(32), ir.IntType(64)
        spec = cgutils.alloca_once(builder, ir.ArrayType(whole, 2))
        kind = ir.FunctionType(number, [number, spec.type])
        read = cgutils.get_or_insert_function(builder.module, kind, "clock_gettime")
        builder.call(read, [number(CLOCK), spec])
        seconds, rest = (
            builder.load(cgutils.gep_inbounds(builder, spec, 0, k)) for k in (0, 1)
        )
        return builder.add(builder.mul(seconds, whole(10**9)), rest)

    return types.int64(), write
