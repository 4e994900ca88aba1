"""Moves of eight numbers at once, against the same one by one."""

import numba
import numpy as np

from shear_sim.models.microgel.octets import SIGNS, add_to_both, between, to_rows
from shear_sim.models.microgel.state import LANES

RNG = np.random.default_rng(1)
N = 40


@numba.njit
def rows_of(columns, a, rows):
    to_rows(columns, a, rows)


@numba.njit
def between_of(rows, i, j, first, block, at):
    between(rows, i, j, first, block, at)


@numba.njit
def add(block, at, i, j, first, sums):
    add_to_both(block, at, i, j, first, sums)


def test_columns_to_rows():
    columns = tuple(RNG.random((8, N)))
    rows = np.zeros((N, 8))
    rows_of(columns, 16, rows)
    assert np.array_equal(rows[16:24], np.column_stack(columns)[16:24])
    assert not rows[:16].any()
    assert not rows[24:].any()


def test_what_lies_between_discs():
    """Discs that occur twice, and one pair of a disc with itself; to the bit."""
    rows = RNG.normal(size=(N, 8))
    i, j = RNG.integers(0, N, (2, 24)).astype(np.uint32)
    j[9] = i[9]
    block = np.zeros(8 * LANES)
    between_of(rows, i, j, 8, block, 16)
    found = block.reshape(8, LANES)
    signs = np.array(SIGNS)
    assert np.array_equal(found[:, 16:24], (rows[j[8:16]] + signs * rows[i[8:16]]).T)
    assert np.count_nonzero(found) == np.count_nonzero(found[:, 16:24])


def test_forces_on_both_discs():
    """In the order of the pairs, to the bit: several meet the same disc."""
    block = RNG.normal(size=3 * LANES)
    i, j = RNG.integers(0, 6, (2, 16)).astype(np.uint32)
    sums = RNG.normal(size=(6, 4))
    expected = sums.copy()
    for s in range(8):
        fx, fy, twist = block[8 + s :: LANES]
        expected[i[8 + s], :3] += (fx, fy, twist)
        expected[j[8 + s], :3] += (-fx, -fy, twist)
    add(block, 8, i, j, 8, sums)
    assert np.array_equal(sums[:, :3], expected[:, :3])
