"""Four or eight numbers at once: rows of small tables that kernels read and write by index.

A compiler makes vectors of loops over consecutive numbers. Where a loop goes from pairs to discs
and back, the discs of the next pair are elsewhere: so each disc has a row of numbers, moved whole,
and four rows of four are turned into four columns, or eight of eight, between registers.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, models, register_model

from shear_sim.cell import Floats

LINE = 64  # bytes that a processor moves at once
_NUMBER, _PLACE = ir.DoubleType(), ir.IntType(32)
_packed: Any = cgutils.pack_array
_tuple_of: Any = types.UniTuple


class Row(types.Type):
    """A vector of ``count`` numbers, to the compiler too."""

    def __init__(self, count: int) -> None:
        self.count = count
        super().__init__(name=f"Row({count})")


@register_model(Row)
class _RowModel(models.PrimitiveModel):
    def __init__(self, manager: Any, row: Row) -> None:
        vector = ir.VectorType(_NUMBER, row.count)
        super().__init__(manager, row, vector)  # type: ignore[no-untyped-call]


QUAD, OCTET = Row(4), Row(8)


def zeros_in_lines(n: int, period: int = LINE, phase: int = 0) -> Floats:
    """Return ``n`` zeros that begin where a cache line does: no aligned row lies in two lines.

    They begin at a multiple of ``period``, and ``phase`` more [bytes].
    """
    raw = np.zeros(n + period // 8)
    first = (phase - raw.ctypes.data) % period // 8
    return raw[first : first + n]


def _shuffled(builder: Any, one: Any, other: Any, *lanes: int) -> Any:
    """Return these lanes of two vectors, those of the other after those of the one."""
    mask = ir.Constant(ir.VectorType(_PLACE, len(lanes)), [_PLACE(lane) for lane in lanes])
    return builder.shuffle_vector(one, other, mask)


def _address(context: Any, builder: Any, signature: Any, arguments: Any, row: Row) -> Any:
    array, index = arguments[:2]
    data = context.make_array(signature.args[0])(context, builder, array).data
    vector = ir.VectorType(_NUMBER, row.count)
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def _load_of(row: Row) -> Callable[..., Any]:
    def typed(_typing: Any, array: Any, index: Any) -> Any:
        def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            vector = builder.load(_address(context, builder, signature, arguments, row))
            vector.align = 8
            return vector

        return row(array, index), emit

    typed.__doc__ = f"Return {row.count} numbers from ``array[index]`` on; it is contiguous."
    return typed


def _store(_typing: Any, array: Any, index: Any, row: Any) -> Any:
    """Write a quad or octet from ``array[index]`` on; ``array`` is contiguous."""

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address = _address(context, builder, signature, arguments, row)
        builder.store(arguments[2], address).align = 8
        return context.get_dummy_value()

    return types.void(array, index, row), emit


def _row(_typing: Any, numbers: Any) -> Any:
    """Return the quad or octet of a tuple of numbers."""
    row = Row(len(numbers))

    def emit(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        vector = ir.Constant(ir.VectorType(_NUMBER, row.count), ir.Undefined)
        for n in range(row.count):
            number = builder.extract_value(arguments[0], n)
            vector = builder.insert_element(vector, number, _PLACE(n))
        return vector

    return row(numbers), emit


def _of_two(operation: str, what: str) -> Callable[..., Any]:
    def typed(_typing: Any, one: Any, other: Any) -> Any:
        def emit(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            return getattr(builder, operation)(*arguments)

        return one(one, other), emit

    typed.__doc__ = f"Return the {what} of two quads or octets, number by number."
    return typed


def _transpose(_typing: Any, one: Any, two: Any, three: Any, four: Any) -> Any:
    """Return the four columns of four quads."""

    def emit(_context: Any, builder: Any, _signature: Any, rows: Any) -> Any:
        a, b, c, d = rows
        even, odd = (0, 4, 2, 6), (1, 5, 3, 7)
        low, high = (0, 1, 4, 5), (2, 3, 6, 7)
        twos = [
            (_shuffled(builder, a, b, *lanes), _shuffled(builder, c, d, *lanes))
            for lanes in (even, odd)
        ]
        return _packed(
            builder, [_shuffled(builder, *two, *lanes) for lanes in (low, high) for two in twos]
        )

    return _tuple_of(QUAD, 4)(one, two, three, four), emit


def _transpose_eight(
    _typing: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any
) -> Any:
    """Return the eight columns of eight octets."""

    def emit(_context: Any, builder: Any, _signature: Any, rows: Any) -> Any:
        # Columns of two rows, then of four, then of eight: column n is where n + 4 is, till then.
        even, odd = (0, 8, 2, 10, 4, 12, 6, 14), (1, 9, 3, 11, 5, 13, 7, 15)
        near, far = (0, 1, 4, 5, 8, 9, 12, 13), (2, 3, 6, 7, 10, 11, 14, 15)
        columns: list[Any] = [None] * 8
        for parity, lanes in enumerate((even, odd)):
            twos = [_shuffled(builder, rows[n], rows[n + 1], *lanes) for n in (0, 2, 4, 6)]
            for half, which in enumerate((near, far)):
                fours = [_shuffled(builder, twos[n], twos[n + 1], *which) for n in (0, 2)]
                first = parity + 2 * half
                columns[first] = _shuffled(builder, *fours, *near)
                columns[first + 4] = _shuffled(builder, *fours, *far)
        return _packed(builder, columns)

    return _tuple_of(OCTET, 8)(a, b, c, d, e, f, g, h), emit


load: Any = intrinsic(_load_of(QUAD))
load_eight: Any = intrinsic(_load_of(OCTET))
store: Any = intrinsic(_store)
row_of: Any = intrinsic(_row)
add: Any = intrinsic(_of_two("fadd", "sums"))
multiply: Any = intrinsic(_of_two("fmul", "products"))
transpose: Any = intrinsic(_transpose)
transpose_eight: Any = intrinsic(_transpose_eight)
