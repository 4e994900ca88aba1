"""A hint to the processor for kernels that go through more memory than the caches hold."""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic


def _prefetch(_typing: Any, array: Any, index: Any) -> Any:
    """Have the cache line of ``array[index]`` brought to the first-level cache, in kernels only.

    Nothing waits for it and no number depends on it. Processors guess what is read next only where
    it lies in one piece of some kilobytes.
    """

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        base = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        address = builder.bitcast(builder.gep(base, [arguments[1]]), cgutils.voidptr_t)
        number = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [cgutils.voidptr_t, number, number, number])
        hint = builder.module.declare_intrinsic("llvm.prefetch", [cgutils.voidptr_t], kind)
        to_read, first_level, data = number(0), number(3), number(1)
        builder.call(hint, [address, to_read, first_level, data])
        return context.get_dummy_value()

    return types.void(array, index), emit


prefetch: Any = intrinsic(_prefetch)
