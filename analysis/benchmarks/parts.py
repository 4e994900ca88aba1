"""Where the time of a step goes: every loop of a recorded step, timed inside compiled code.

.venv/bin/python analysis/benchmarks/parts.py [--discs 1024 16384 100000] [--fraction 1.5]

Prints the time of each loop in ns a disc, of the fastest of several runs: a step takes them in this
order. They are the loops of the program, called in the order of `kernels.run`; that the discs are
moved to the same bits is checked. Few discs take more steps than many, in which more pairs come
near, as no list is made: they are given per disc, to compare loops over pairs by.
"""

import argparse
import time
from types import ModuleType
from typing import Any

import numba
import numpy as np
import scenes
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from shear_sim.models.microgel import motion, rows
from shear_sim.models.microgel.state import (
    COUNT,
    FIRST,
    LANES,
    OSCILLATION,
    PAIR_ROWS,
    Springs,
)
from shear_sim.threads import add_up

DISC_STEPS = 500_000  # of one run, but ten steps at least, and at most so many that no list is made
MOST_STEPS = 400
RUNS = 5
LOOPS = (
    "approach_time", "kick", "drift", "moved", "empty_rows", "places", "write_rows",
    "gather", "pair_forces", "scatter", "stress_of",
    "read_rows", "accelerate", "add_scaled", "finish_row",
)  # fmt: skip
(
    APPROACH, KICK, DRIFT, MOVED, EMPTY, PLACES, WRITE, GATHER, FORCES, SCATTER, STRESS, READ,
    ACCELERATE, SECOND_KICK, FINISH,
) = range(len(LOOPS))  # fmt: skip


def _ticks(_typing: Any) -> Any:
    """Return the count of the processor's clock."""

    def emit(_context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        kind, name = ir.FunctionType(ir.IntType(64), []), "llvm.readcyclecounter"
        function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
        return builder.call(function, [])

    return types.uint64(), emit


ticks: Any = intrinsic(_ticks)


@numba.njit
def charge(spent: NDArray[np.int64], loop: int, since: int) -> int:
    """Add the time since ``since`` to a loop; return the time."""
    now = ticks()
    spent[loop] += now - since
    return now  # type: ignore[no-any-return]


def timed_steps(kernels: ModuleType) -> Any:
    """Return the compiled steps of a scene without links, whose loops are timed."""
    substep, approach_time = kernels.substep, kernels.approach_time
    pair_forces, stress_of, fold_extremes = (
        kernels.pair_forces, kernels.stress_of, kernels.fold_extremes,
    )  # fmt: skip
    kick, drift, moved, places = motion.kick, motion.drift, motion.moved, motion.places
    accelerate, add_scaled, finish_row = motion.accelerate, motion.add_scaled, motion.finish_row
    strain_at = motion.strain_at
    empty_rows, write_rows, read_rows = rows.empty_rows, rows.write_rows, rows.read_rows
    gather, scatter = rows.gather, rows.scatter
    closest, closing, cached = rows.CLOSEST, rows.CLOSING, rows.CACHED_ROWS * LANES

    @numba.njit(error_model="numpy")
    def steps(  # type: ignore[no-untyped-def]
        discs, work, contacts, c, clock, first, last, spent, row
    ):
        begin, end, block, h = work.begin, work.end, work.block, clock.step
        size, smallest = 2.0 * discs.radius.mean(), discs.radius.min()
        contact = Springs(c.k, c.kt, c.eta, c.etat, 0.0, 0.0, 0.0, np.inf if c.may_pull else 0.0)
        strain, rate = strain_at(clock, OSCILLATION, first, 0.0)
        way = 0.0
        for n in range(first, last):
            t = ticks()
            substep(c, work, size, 0.0)
            approach_time(c, discs, work, smallest)
            t = charge(spent, APPROACH, t)
            before = strain
            strain, rate = strain_at(clock, OSCILLATION, n, 1.0)
            kick(discs.cx, work.px, work.ax, 0.5 * h, 0.5 * h, begin, end)
            kick(discs.cy, work.py, work.ay, 0.5 * h, 0.5 * h, begin, end)
            kick(discs.spin, work.pspin, work.aspin, 0.5 * h, 0.5 * h, begin, end)
            t = charge(spent, KICK, t)
            drift(discs, work, c, h, strain - before, rate)
            t = charge(spent, DRIFT, t)
            way = max(way, moved(discs, work, contacts, c, strain))
            t = charge(spent, MOVED, t)
            empty_rows(work)
            t = charge(spent, EMPTY, t)
            offset = strain * c.height - work.turns[0] * c.width
            places(discs, work, c, offset)
            t = charge(spent, PLACES, t)
            write_rows(discs, work)
            t = charge(spent, WRITE, t)
            block[closest:closing] = 1.0
            block[closing : closing + LANES] = 0.0
            work.pair_sums[:] = 0.0
            for strip in range(contacts.strips.shape[0]):
                low = contacts.strips[strip, FIRST]
                high = low + contacts.strips[strip, COUNT]
                for at in range(low, high, LANES):
                    m = int(min(LANES, high - at))
                    r = at // LANES
                    table = contacts.table[r]
                    more = at + 2 * LANES <= contacts.i.shape[0] > cached
                    ahead = contacts.table[r + 1 if more else r][: PAIR_ROWS * LANES * more]
                    t = ticks()
                    i, j = contacts.i, contacts.j
                    gather(work.disc_rows, i, j, at, m, block, True, True, ahead)
                    t = charge(spent, GATHER, t)
                    pair_forces(block, table, m, contact, c, offset, rate, h)
                    t = charge(spent, FORCES, t)
                    scatter(work.force_rows, i, j, at, m, block, True, ahead)
                    t = charge(spent, SCATTER, t)
                    stress_of(block, table, m, 0.1 * c.width, work.pair_sums[strip])
                    t = charge(spent, STRESS, t)
            t = ticks()
            read_rows(discs, work, True)
            t = charge(spent, READ, t)
            accelerate(discs, work, c, rate)
            t = charge(spent, ACCELERATE, t)
            add_scaled(discs.cx, 0.5 * h, work.ax, begin, end)
            add_scaled(discs.cy, 0.5 * h, work.ay, begin, end)
            add_scaled(discs.spin, 0.5 * h, work.aspin, begin, end)
            t = charge(spent, SECOND_KICK, t)
            fold_extremes(block, work.closest)
            add_up(work.pair_sums, work.tensors)
            finish_row(discs, work, c, rate, row)
            t = charge(spent, FINISH, t)
        return way

    return steps


def loops_of(discs: int, fraction: float, steps: int) -> tuple[NDArray[np.float64], float]:
    """Return the time of every loop [ns a disc and step], and pairs per disc.

    Raises
    ------
    ValueError
        If these are not the steps of the program.
    """
    s, whole = scenes.common(discs, fraction), scenes.common(discs, fraction)
    s.advance(1)
    whole.advance(1 + steps)
    kernel = timed_steps(s.kernels)
    row, runs = np.zeros(len(s.names)), []
    for first in range(0, RUNS * steps + 1, steps):  # the first run compiles
        spent = np.zeros(len(LOOPS), np.int64)
        since = time.perf_counter_ns()
        last = first + steps
        way = kernel(s.discs, s.work, s.contacts, s.constants, s.clock, first, last, spent, row)
        wall = (time.perf_counter_ns() - since) / steps / discs
        if way > s.constants.skin:
            msg = "a new list of contacts would have been made: fewer steps"
            raise ValueError(msg)
        if first == 0 and not all(map(np.array_equal, s.discs, whole.discs)):
            msg = "these are not the steps of the program any more"
            raise ValueError(msg)
        if first:
            runs.append(spent / spent.sum() * wall)
    return min(runs, key=np.sum), s.contacts.strips[:, COUNT].sum() / discs


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--discs", type=int, nargs="+", default=[1024, 16_384, 100_000])
    parser.add_argument("--fraction", type=float, default=1.5, help="packing fraction")
    options = parser.parse_args()
    found = [
        loops_of(discs, options.fraction, min(MOST_STEPS, max(10, DISC_STEPS // discs)))
        for discs in options.discs
    ]
    print("| loop | " + " | ".join(f"N = {discs:,}" for discs in options.discs) + " |")
    print("| --- " * (1 + len(found)) + "|")
    for n, loop in enumerate(LOOPS):
        print(f"| {loop} | " + " | ".join(f"{times[n]:.2f}" for times, _ in found) + " |")
    print("| all, ns a disc | " + " | ".join(f"{times.sum():.1f}" for times, _ in found) + " |")
    print("| pairs a disc | " + " | ".join(f"{pairs:.2f}" for _, pairs in found) + " |")
