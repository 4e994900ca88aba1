"""Threads inside compiled code: they meet, and one that fails leaves nobody waiting."""

import numba
import numpy as np
import pytest

from shear_sim.threads import meet, new_meeting, together


@numba.njit(nogil=True)
def count_together(thread, threads, meeting, seen, rounds):
    """Every thread writes, meets, and reads what all have written in this round."""
    wrong = 0
    for n in range(rounds):
        seen[thread] = n
        meet(meeting, threads)
        for other in range(threads):
            wrong += seen[other] != n
        meet(meeting, threads)
    return wrong


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_nobody_passes_before_all_have_come(threads):
    meeting, seen, wrong = new_meeting(), np.zeros(threads, np.int64), np.zeros(threads)

    def call(thread):
        wrong[thread] = count_together(thread, threads, meeting, seen, 300)
        return thread

    assert together(threads, meeting, call) == 0
    assert (seen == 299).all()
    assert not wrong.any()


@pytest.mark.parametrize("failing", [0, 1, 2])
def test_a_failure_ends_all(failing):
    """Whoever fails, the others stop waiting, and the first error is what the caller gets."""
    meeting, seen = new_meeting(), np.zeros(3, np.int64)

    def call(thread):
        if thread == failing:
            msg = "of this thread"
            raise OSError(msg)
        return count_together(thread, 3, meeting, seen, 10)

    with pytest.raises(OSError, match="of this thread"):
        together(3, meeting, call)
