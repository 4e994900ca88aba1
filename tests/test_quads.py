"""Rows of four numbers in kernels: what they are, and that the compiler makes vectors of them."""

import numpy as np

from shear_sim.cell import Floats
from shear_sim.compiled import jit
from shear_sim.quads import (
    LINE,
    add,
    load,
    multiply,
    store,
    subtract,
    transpose,
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
def combined(one: Floats, other: Floats, results: Floats) -> None:
    """Write sums, differences and products."""
    p, q = load(one, 1), load(other, 2)
    store(results, 0, add(p, q))
    store(results, 4, subtract(p, q))
    store(results, 8, multiply(p, (-1.0, 2.0, -3.0, 4.0)))


def test_four_rows_become_four_columns_from_any_place_on() -> None:
    rows, columns = np.arange(20.0), np.zeros(20)
    turned(rows, 3, columns)
    assert (columns[:16].reshape(4, 4) == rows[3:19].reshape(4, 4).T).all()
    assert (columns[16:] == 0.0).all()


def test_quads_are_combined_number_by_number() -> None:
    rng = np.random.default_rng(1)
    one, other, results = rng.random(5), rng.random(6), np.zeros(12)
    combined(one, other, results)
    p, q = one[1:5], other[2:6]
    assert (results[:4] == p + q).all()
    assert (results[4:8] == p - q).all()
    assert (results[8:] == p * [-1.0, 2.0, -3.0, 4.0]).all()


def test_no_number_of_a_quad_goes_through_memory_by_itself() -> None:
    turned(np.zeros(16), 0, np.zeros(16))
    code = turned.inspect_llvm(turned.signatures[0])
    assert code.count("load <4 x double>") == 4
    assert code.count("store <4 x double>") == 4
    assert "load double" not in code


def test_rows_begin_where_a_cache_line_does() -> None:
    for n in (1, 7, 64, 1000):
        rows = zeros_in_lines(n)
        assert rows.shape == (n,)
        assert rows.ctypes.data % LINE == 0
        assert not rows.any()
        assert zeros_in_lines(n, 512, 256).ctypes.data % 512 == 256
