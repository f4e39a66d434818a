"""The cells of a block, 4 x 4 x 4 of them, compared all at once."""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


@intrinsic
def cells_near(typingctx, x, y, z, cx, cy, cz, r2):  # noqa: ANN001, ANN201
    """Return the word of a block: its cells that come near a point.

    Lengths are in cells. The block begins at x, y, z; the square of a cell's distance
    from cx, cy, cz is at most `r2`. All cells are compared by one vector operation,
    which LLVM takes apart as the processor needs it.
    """
    given = (x, y, z, cx, cy, cz, r2)
    if not all(isinstance(kind, types.Float) for kind in given):
        return None
    real, number = ir.DoubleType(), ir.IntType(32)

    def codegen(context, builder, signature, args):  # noqa: ANN001, ANN202
        def spread(value, places):  # noqa: ANN001, ANN202
            kind, order = ir.VectorType(number, len(places)), list(places)
            unused = ir.Constant(value.type, ir.Undefined)
            return builder.shuffle_vector(value, unused, ir.Constant(kind, order))

        def copies(value, count):  # noqa: ANN001, ANN202
            none = ir.Constant(ir.VectorType(real, 1), ir.Undefined)
            one = builder.insert_element(none, value, number(0))
            return spread(one, [0] * count)

        def four(*values):  # noqa: ANN002, ANN202
            return ir.Constant(ir.VectorType(real, 4), [*values])

        def larger(a, b):  # noqa: ANN001, ANN202
            return builder.select(builder.fcmp_ordered(">", a, b), a, b)

        def gaps2(first, at):  # noqa: ANN001, ANN202
            """Return the squares of the gaps along an axis, cell by cell."""
            low = builder.fadd(copies(first, 4), four(0.0, 1.0, 2.0, 3.0))
            high, at = builder.fadd(low, four(1.0, 1.0, 1.0, 1.0)), copies(at, 4)
            over = larger(builder.fsub(low, at), builder.fsub(at, high))
            apart = larger(over, four(0.0, 0.0, 0.0, 0.0))
            return builder.fmul(apart, apart)

        first, at, most = args[:3], args[3:6], args[6]
        ux, uy, uz = map(gaps2, first, at)
        left = builder.fsub(copies(most, 64), spread(ux, [c >> 4 for c in range(64)]))
        left = builder.fsub(left, spread(uy, [c >> 2 & 3 for c in range(64)]))
        near = builder.fcmp_ordered("<=", spread(uz, [c & 3 for c in range(64)]), left)
        return builder.bitcast(near, ir.IntType(64))

    return types.uint64(*[types.float64] * len(given)), codegen
