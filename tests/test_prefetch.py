import numba
import numpy as np

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
