"""Eight pairs or discs at once between rows and columns, for kernels.

What a pair asks of a disc lies in one row, so one read brings all of it where eight columns take
eight reads; the arithmetic wants columns. Compilers do such a transposition one number at a time.
Numbers are moved, subtracted and added as they would be one by one, to the same bits.
"""

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from shear_sim.models.microgel.state import LANES

OCTET = 8
#: Factor of the row of i where a pair takes it together with that of j: for x, y, px, py, rim,
#: rolled, lx and ly. What turns adds up.
SIGNS = (-1.0, -1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0)

# An intrinsic is given the types of all of its arguments; some are of one type only (ARG001 below).
_OCTET, _QUARTET = ir.VectorType(ir.DoubleType(), OCTET), ir.VectorType(ir.DoubleType(), 4)


class _Code:
    """Writes the code of one kernel; arrays are known by the address of their first number."""

    def __init__(self, context: Any, builder: Any, signature: Any, arguments: Any) -> None:
        self.context, self.builder = context, builder
        self.values = [
            self.address(kind, value) for kind, value in zip(signature.args, arguments, strict=True)
        ]

    def address(self, kind: Any, value: Any) -> Any:
        """Return the address of an array, or of each of a tuple; numbers are what they are."""
        if isinstance(kind, types.UniTuple):
            each = range(kind.count)
            return [self.address(kind.dtype, self.builder.extract_value(value, q)) for q in each]
        if isinstance(kind, types.Array):
            return self.context.make_array(kind)(self.context, self.builder, value).data
        return value

    def plus(self, index: Any, number: int) -> Any:
        """Return ``index`` + ``number``."""
        return self.builder.add(index, index.type(number))

    def row(self, which: Any, number: Any, width: int) -> Any:
        """Return where the row of the disc ``which[number]`` begins."""
        disc = self.builder.load(self.builder.gep(which, [number]))
        return self.builder.mul(self.builder.zext(disc, number.type), number.type(width))

    def load(self, base: Any, index: Any, kind: Any = _OCTET) -> Any:
        """Return the numbers from ``base[index]`` on."""
        return self.builder.load(self._place(base, index, kind), align=8)

    def store(self, vector: Any, base: Any, index: Any) -> None:
        """Write ``vector`` to ``base[index]`` and on."""
        self.builder.store(vector, self._place(base, index, vector.type), align=8)

    def _place(self, base: Any, index: Any, kind: Any) -> Any:
        return self.builder.bitcast(self.builder.gep(base, [index]), kind.as_pointer())

    def pick(self, one: Any, other: Any, lanes: list[int]) -> Any:
        """Return these lanes of two vectors; those of the second are numbered from 8 on."""
        mask = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes)
        return self.builder.shuffle_vector(one, other, mask)

    def transposed(self, rows: list[Any]) -> list[Any]:
        """Return the columns of eight rows of eight: they exchange single numbers, pairs, fours."""
        rows = list(rows)
        for bit in (1, 2, 4):
            low = [k if not k & bit else OCTET + k - bit for k in range(OCTET)]
            high = [k + bit if not k & bit else OCTET + k for k in range(OCTET)]
            for r in range(OCTET):
                if not r & bit:
                    one, other = rows[r], rows[r + bit]
                    rows[r], rows[r + bit] = self.pick(one, other, low), self.pick(one, other, high)
        return rows


def _to_rows(_typing: Any, columns: Any, a: Any, rows: Any) -> Any:  # noqa: ARG001
    """Write the numbers ``a`` to ``a`` + 7 of a tuple of eight columns to eight rows (N, 8)."""

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        code = _Code(context, builder, signature, arguments)
        columns, a, rows = code.values
        found = [code.load(column, a) for column in columns]
        for s, row in enumerate(code.transposed(found)):
            code.store(row, rows, builder.mul(code.plus(a, s), a.type(OCTET)))
        return context.get_dummy_value()

    return types.void(columns, types.int64, rows), emit


def _between(_typing: Any, rows: Any, i: Any, j: Any, first: Any, block: Any, at: Any) -> Any:  # noqa: ARG001
    """Write what lies between the discs of eight pairs to eight columns of ``block``.

    ``rows``: (N, 8); ``i``, ``j``: discs of the pairs, from number ``first`` on; the columns begin
    at ``at``, ``at`` + LANES and so on.
    """

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        code = _Code(context, builder, signature, arguments)
        rows, i, j, first, block, at = code.values
        signs = ir.Constant(_OCTET, list(SIGNS))
        found = []
        for s in range(OCTET):
            one, other = (
                code.load(rows, code.row(which, code.plus(first, s), OCTET)) for which in (i, j)
            )
            found.append(builder.fadd(other, builder.fmul(signs, one)))
        for q, column in enumerate(code.transposed(found)):
            code.store(column, block, code.plus(at, q * LANES))
        return context.get_dummy_value()

    return types.void(rows, i, j, types.int64, block, types.int64), emit


def _add_to_both(_typing: Any, block: Any, at: Any, i: Any, j: Any, first: Any, sums: Any) -> Any:  # noqa: ARG001
    """Add the forces of eight pairs to the sums (N, 4) of their discs: f_x, f_y, torque / r.

    They are three columns of ``block`` from ``at`` on. Forces on j are those on i reversed; what
    turns i turns j the same way.
    """

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        code = _Code(context, builder, signature, arguments)
        block, at, i, j, first, sums = code.values
        fx, fy, twist = (code.load(block, code.plus(at, q * LANES)) for q in range(3))
        reverse = ir.Constant(_QUARTET, [-1.0, -1.0, 1.0, 0.0])
        both = [[k // 2 * 2 + k % 2 * OCTET + odd for k in range(OCTET)] for odd in (0, 1)]
        forces = [code.pick(fx, fy, lanes) for lanes in both]
        for s in range(OCTET):
            even, turning = s - s % 2, OCTET + s
            on_i = code.pick(forces[s % 2], twist, [even, even + 1, turning, turning])
            for which, force in ((i, on_i), (j, builder.fmul(on_i, reverse))):
                place = code.row(which, code.plus(first, s), 4)
                code.store(builder.fadd(code.load(sums, place, _QUARTET), force), sums, place)
        return context.get_dummy_value()

    return types.void(block, types.int64, i, j, types.int64, sums), emit


to_rows: Any = intrinsic(_to_rows)
between: Any = intrinsic(_between)
add_to_both: Any = intrinsic(_add_to_both)
