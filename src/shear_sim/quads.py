"""Four numbers at once: rows of small tables that kernels read and write by index.

A compiler makes vectors of loops over consecutive numbers. Where a loop goes from pairs to discs
and back, the discs of the next pair are elsewhere: so each disc has a row of numbers, moved whole,
and four rows are turned into four columns, or back, between registers.

Numba sees a tuple of four numbers, the compiler a vector: no such tuple is ever in memory.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from shear_sim.cell import Floats

Quad = tuple[float, float, float, float]

_packed: Any = cgutils.pack_array
_tuple_of: Any = types.UniTuple
QUAD = _tuple_of(types.float64, 4)
LINE = 64  # bytes that a processor moves at once
_NUMBER, _PLACE = ir.DoubleType(), ir.IntType(32)
_VECTOR = ir.VectorType(_NUMBER, 4)


def zeros_in_lines(n: int, period: int = LINE, phase: int = 0) -> Floats:
    """Return ``n`` zeros that begin where a cache line does: no aligned row lies in two lines.

    They begin at a multiple of ``period``, and ``phase`` more [bytes].
    """
    raw = np.zeros(n + period // 8)
    first = (phase - raw.ctypes.data) % period // 8
    return raw[first : first + n]


def _mask(*lanes: int) -> Any:
    return ir.Constant(ir.VectorType(_PLACE, 4), [_PLACE(lane) for lane in lanes])


def _vector(builder: Any, quad: Any) -> Any:
    vector = ir.Constant(_VECTOR, ir.Undefined)
    for n in range(4):
        vector = builder.insert_element(vector, builder.extract_value(quad, n), _PLACE(n))
    return vector


def _quad(builder: Any, vector: Any) -> Any:
    return _packed(builder, [builder.extract_element(vector, _PLACE(n)) for n in range(4)])


def _address(context: Any, builder: Any, kind: Any, array: Any, index: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), _VECTOR.as_pointer())


def _load(_typing: Any, array: Any, index: Any) -> Any:
    """Return ``array[index]`` to ``array[index + 3]``; ``array`` is contiguous."""

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        vector = builder.load(_address(context, builder, signature.args[0], *arguments))
        vector.align = 8
        return _quad(builder, vector)

    return QUAD(array, index), emit


def _store(_typing: Any, array: Any, index: Any, quad: Any) -> Any:
    """Write a quad to ``array[index]`` to ``array[index + 3]``; ``array`` is contiguous."""

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = _address(context, builder, signature.args[0], *arguments[:2])
        builder.store(_vector(builder, arguments[2]), address).align = 8
        return context.get_dummy_value()

    return types.void(array, index, quad), emit


def _of_two(operation: str, what: str) -> Callable[..., Any]:
    def typed(_typing: Any, one: Any, other: Any) -> Any:
        def emit(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            vectors = [_vector(builder, quad) for quad in arguments]
            return _quad(builder, getattr(builder, operation)(*vectors))

        return QUAD(one, other), emit

    typed.__doc__ = f"Return the {what} of two quads, number by number."
    return typed


def _transpose(_typing: Any, one: Any, two: Any, three: Any, four: Any) -> Any:
    """Return the four columns of four rows."""

    def emit(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        a, b, c, d = (_vector(builder, quad) for quad in arguments)
        shuffle = builder.shuffle_vector
        even, odd = _mask(0, 4, 2, 6), _mask(1, 5, 3, 7)
        low, high = _mask(0, 1, 4, 5), _mask(2, 3, 6, 7)
        ab, ba = shuffle(a, b, even), shuffle(a, b, odd)
        cd, dc = shuffle(c, d, even), shuffle(c, d, odd)
        columns = (
            shuffle(ab, cd, low), shuffle(ba, dc, low), shuffle(ab, cd, high), shuffle(ba, dc, high)
        )  # fmt: skip
        return _packed(builder, [_quad(builder, column) for column in columns])

    return _tuple_of(QUAD, 4)(one, two, three, four), emit


load: Any = intrinsic(_load)
store: Any = intrinsic(_store)
add: Any = intrinsic(_of_two("fadd", "sums"))
subtract: Any = intrinsic(_of_two("fsub", "differences"))
multiply: Any = intrinsic(_of_two("fmul", "products"))
transpose: Any = intrinsic(_transpose)
