"""Ask the processor for a row of a table before it is needed."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

__all__ = ["prefetch"]

_LINE = 64


@intrinsic  # type: ignore[untyped-decorator]
def prefetch(typingctx: Any, table: Any, row: Any) -> Any:
    """prefetch(table, row): fetch row ``row`` of a contiguous 2-D array of rows of 72 bytes.

    For compiled code. The processor goes on at once; where triangles lie scattered in memory, those
    of the next rays come while it works on this one's. Nothing else happens.
    """
    if not isinstance(table, types.Array) or table.ndim != 2 or not isinstance(row, types.Integer):
        return None

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        index = context.cast(builder, arguments[1], signature.args[1], types.intp)
        zero = context.get_constant(types.intp, 0)
        place = cgutils.get_item_pointer(
            context, builder, signature.args[0], array, [index, zero], wraparound=False
        )
        start = builder.ptrtoint(place, ir.IntType(64))
        pointer, word = ir.IntType(8).as_pointer(), ir.IntType(32)
        function = cgutils.get_or_insert_function(
            builder.module,
            ir.FunctionType(ir.VoidType(), [pointer, word, word, word]),
            "llvm.prefetch.p0i8",
        )
        for offset in (0, _LINE):
            line = builder.inttoptr(builder.add(start, ir.IntType(64)(offset)), pointer)
            # For reading, to stay in all caches, data
            builder.call(function, [line, word(0), word(3), word(1)])
        return context.get_dummy_value()

    return types.void(table, row), generate
