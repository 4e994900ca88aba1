import numba
import numpy as np

from shear_sim.models.microgel import rows
from shear_sim.models.microgel.state import LANES, PAIR_ROWS
from shear_sim.prefetch import prefetch


def test_a_kernel_asks_for_memory_and_computes_the_same():
    """Also beyond the end of the array: a hint reads nothing."""

    @numba.njit
    def total(values):
        found = 0.0
        for i in range(len(values)):
            prefetch(values, i + 8)
            found += values[i]
        return found

    assert total(np.arange(10.0)) == 45
    assert "call void @llvm.prefetch" in total.inspect_llvm(total.signatures[0])


def test_all_that_the_next_block_of_pairs_needs_is_asked_for_once(monkeypatch):
    """Every line of its row of the table, and the rows of its second discs: no bits tell."""
    asked = []
    monkeypatch.setattr(rows, "prefetch", lambda array, n: asked.append((array is ahead, int(n))))
    ahead, discs = np.zeros(PAIR_ROWS * LANES), np.zeros(8 * 2 * LANES)
    j = np.arange(2 * LANES, dtype=np.uint32)
    for half, width in ((0, rows.EIGHT), (1, rows.FOUR)):
        before = len(asked)
        for lane in range(0, LANES, 8):
            rows.fetch.py_func(ahead, half, lane, discs, width, j, np.uint64(lane))
        second = [n for of_table, n in asked[before:] if not of_table]
        assert second == [n * int(width) for n in range(LANES, 2 * LANES)]
    assert sorted(n for of_table, n in asked if of_table) == list(range(0, len(ahead), 8))
