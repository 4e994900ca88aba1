"""Rows of four and eight numbers in kernels: what they are, and that they are vectors."""

import numpy as np

from shear_sim.cell import Floats
from shear_sim.compiled import jit
from shear_sim.quads import (
    LINE,
    add,
    load,
    load_eight,
    multiply,
    row_of,
    store,
    transpose,
    transpose_eight,
    zeros_in_lines,
)


@jit
def turned(rows: Floats, i: int, columns: Floats) -> None:
    """Write the transpose of the four rows from ``i`` on."""
    p, q, r, s = transpose(load(rows, i), load(rows, i + 4), load(rows, i + 8), load(rows, i + 12))
    store(columns, 0, p)
    store(columns, 4, q)
    store(columns, 8, r)
    store(columns, 12, s)


@jit
def turned_eight(rows: Floats, i: int, columns: Floats) -> None:
    """Write the transpose of the eight rows from ``i`` on."""
    octets = transpose_eight(
        load_eight(rows, i), load_eight(rows, i + 8), load_eight(rows, i + 16),
        load_eight(rows, i + 24), load_eight(rows, i + 32), load_eight(rows, i + 40),
        load_eight(rows, i + 48), load_eight(rows, i + 56),
    )  # fmt: skip
    for n in range(8):
        store(columns, 8 * n, octets[n])


@jit
def combined(one: Floats, other: Floats, results: Floats) -> None:
    """Write sums and products."""
    p, q = load(one, 1), load(other, 2)
    store(results, 0, add(p, q))
    store(results, 4, multiply(p, row_of((-1.0, 2.0, -3.0, 4.0))))


def test_four_rows_become_four_columns_from_any_place_on() -> None:
    rows, columns = np.arange(20.0), np.zeros(20)
    turned(rows, 3, columns)
    assert (columns[:16].reshape(4, 4) == rows[3:19].reshape(4, 4).T).all()
    assert (columns[16:] == 0.0).all()


def test_eight_rows_become_eight_columns_from_any_place_on() -> None:
    rows, columns = np.arange(70.0), np.zeros(70)
    turned_eight(rows, 3, columns)
    assert (columns[:64].reshape(8, 8) == rows[3:67].reshape(8, 8).T).all()
    assert (columns[64:] == 0.0).all()


def test_quads_are_combined_number_by_number() -> None:
    rng = np.random.default_rng(1)
    one, other, results = rng.random(5), rng.random(6), np.zeros(8)
    combined(one, other, results)
    p, q = one[1:5], other[2:6]
    assert (results[:4] == p + q).all()
    assert (results[4:] == p * [-1.0, 2.0, -3.0, 4.0]).all()


def test_no_number_of_a_quad_goes_through_memory_by_itself() -> None:
    for kernel, count in ((turned, 4), (turned_eight, 8)):
        kernel(np.zeros(count * count), 0, np.zeros(count * count))
        code = kernel.inspect_llvm(kernel.signatures[0])
        assert code.count(f"load <{count} x double>") == count
        assert code.count(f"store <{count} x double>") == count
        assert "load double" not in code


def test_rows_begin_where_a_cache_line_does() -> None:
    for n in (1, 7, 64, 1000):
        rows = zeros_in_lines(n)
        assert rows.shape == (n,)
        assert rows.ctypes.data % LINE == 0
        assert not rows.any()
        assert zeros_in_lines(n, 512, 256).ctypes.data % 512 == 256
