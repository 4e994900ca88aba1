"""Threads that share the work of one kernel, all of them inside compiled code.

`together` starts them; each runs the whole kernel on its own part of the data, and they wait for
each other in `meet`, wherever one needs what another has computed. So a step of a simulation costs
no call of Python and no lock: two threads that run meet within a microsecond.
"""

import threading
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from shear_sim.cell import Floats
from shear_sim.compiled import jit

Result = TypeVar("Result")
Meeting = NDArray[np.int64]

ARRIVALS, BROKEN = 0, 8  # places in a Meeting, each in a cache line of its own
PATIENCE = 2000  # looks, some microseconds; then whoever else wants the core may have it


def new_meeting() -> Meeting:
    """Return what `meet` counts in."""
    return np.zeros(16, np.int64)


def together(threads: int, meeting: Meeting, call: Callable[[int], Result]) -> Result:
    """Return ``call(0)``, while ``call(1)`` and so on run in threads of their own.

    Parameters
    ----------
    threads : int
        How many in all.
    meeting : array
        Of `new_meeting`, which the calls pass to `meet`. When one fails the others do not wait
        for it: they raise there, and the first error is raised here.
    call : callable
        Mostly a kernel without the interpreter's lock (``nogil=True``).
    """
    errors: list[BaseException] = []

    def attempt(thread: int) -> Result | None:
        try:
            return call(thread)
        except BaseException as error:
            errors.append(error)
            meeting[BROKEN] = 1
            return None

    helpers = [threading.Thread(target=attempt, args=(t,)) for t in range(1, threads)]
    started = []
    try:
        for helper in helpers:
            helper.start()
            started.append(helper)
    except RuntimeError:  # the system has no more threads
        meeting[BROKEN] = 1
        for helper in started:
            helper.join()
        raise
    result = attempt(0)
    for helper in helpers:
        helper.join()
    if errors:
        raise errors[0]
    return result  # type: ignore[return-value]


def _arrive(_typing: Any, meeting: Any) -> Any:
    """Count one more arrival and return how many came before."""

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.atomic_rmw("add", data, ir.IntType(64)(1), "seq_cst")

    return types.int64(meeting), emit


def _look(_typing: Any, meeting: Any, place: Any) -> Any:
    """Return ``meeting[place]`` as it is now, and see all that was written before it."""

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.load_atomic(builder.gep(data, [arguments[1]]), "acquire", 8)

    return types.int64(meeting, place), emit


def _give_way(_typing: Any) -> Any:
    """Let another thread have this core, if one wants it."""

    def emit(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(32), [])
        function = builder.module.globals.get("sched_yield")
        if function is None:
            function = ir.Function(builder.module, kind, "sched_yield")
        builder.call(function, [])
        return context.get_dummy_value()

    return types.void(), emit


arrive: Any = intrinsic(_arrive)
look: Any = intrinsic(_look)
give_way: Any = intrinsic(_give_way)


@jit(inner=True)
def meet(meeting: Meeting, threads: int) -> None:
    """Wait for all threads of a kernel: what they wrote before, all may read after.

    Raises
    ------
    RuntimeError
        If one of them has failed and will not come.
    """
    if threads == 1:
        return
    goal = (arrive(meeting) // threads + 1) * threads
    looks = 0
    while look(meeting, ARRIVALS) < goal:
        if look(meeting, BROKEN) != 0:
            raise RuntimeError("another thread of this kernel has failed")  # noqa: EM101
        looks += 1
        if looks > PATIENCE:
            give_way()


@jit(inner=True)
def add_up(sums: Floats, totals: Floats) -> None:
    """Add up the ``sums`` (S, C) that all threads have made, in their order; write (C,) totals.

    Each of S parts of the data has sums of its own: so their bits depend on the parts, not on how
    many threads share these.
    """
    for c in range(totals.shape[0]):
        totals[c] = sums[0, c]
    for s in range(1, sums.shape[0]):
        for c in range(totals.shape[0]):
            totals[c] += sums[s, c]


@jit(inner=True)
def largest_of(
    value: np.uint64, extremes: Floats, column: int, thread: int, threads: int, meeting: Meeting
) -> np.uint64:
    """Return the largest of what each thread has found, see `bits`; all wait for each other.

    ``extremes`` (threads, C) has a column for each such question: between two answers to the same
    one all must meet once more.
    """
    if threads == 1:
        return value
    extremes[thread, column] = number(value)
    meet(meeting, threads)
    for other in range(threads):
        value = max(value, bits(extremes[other, column]))
    return value


@jit(inner=True)
def bits(value: float) -> np.uint64:
    """Return a number that is as large as another the larger ``value``, which is not negative, is.

    The compiler takes maxima of whole numbers by vectors, and what is not a number is the largest.
    """
    return np.float64(value).view(np.uint64)


@jit(inner=True)
def number(value: np.uint64) -> float:
    """Return what `bits` was made of."""
    return float(np.uint64(value).view(np.float64))
