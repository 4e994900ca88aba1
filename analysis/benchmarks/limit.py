"""What a step can cost at least on this machine, from what the machine was measured to do.

.venv/bin/python analysis/benchmarks/limit.py

Per pair: divisions and roots (8 at once with AVX-512), other vector operations, and rows of
eight numbers whose differences are taken, and of four that are added to, where pairs meet discs. A
processor can do these three at the same time: the longest of them is the least time. One after the
other is what loops of their own, as ours, take if they never wait. Per disc: every array once
through memory; our loops over discs, which `parts.py` times, go through it more often. Counts are
those of our method, without records; another method has others.
"""

import argparse
import time
from collections.abc import Callable
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from shear_sim.quads import add, load, load_eight, multiply, row_of, store, zeros_in_lines

FloatArray = NDArray[np.float64]

# Of the force on a pair, counted in the machine code of `pair_forces`: sums, products and extremes,
# then comparisons, selections and signs; and what turns rows into columns, 22 operations on eight
# numbers for eight pairs, and back, 3 on four numbers a pair.
DIVISIONS, ROOTS, OPERATIONS = 3, 1, 73 + 17 + 22 + 12
# Rows of a pair and its discs: differences, and rows that a force is added to.
DIFFERENCES, SUMS = 1, 2
# Bytes that a step goes through: of a pair its table (10 numbers, one of which comes along unused)
# and two indices, of a disc 35 numbers. What is written goes both ways: 5 of the table, 27 of a
# disc.
PAIR_BYTES, PAIR_WRITTEN, DISC_BYTES, DISC_WRITTEN = 8 * 10 + 8, 8 * 5, 8 * 35, 8 * 27
REPEATS = 15


class Machine(NamedTuple):
    """Measured times [s]: of one number each, as part of a vector or not, and of a row."""

    division: float
    root: float
    operation: float
    store: float  # by itself: soft particles do that
    difference: float
    sum: float
    sizes: FloatArray  # of what is read and written again and again [bytes]
    byte: FloatArray  # time of one byte at these sizes


@numba.njit(error_model="numpy")
def _divide(a: FloatArray, b: FloatArray) -> None:
    for i in range(a.shape[0]):
        b[i] = 1.3 / a[i]


@numba.njit
def _root(a: FloatArray, b: FloatArray) -> None:
    for i in range(a.shape[0]):
        b[i] = np.sqrt(a[i])


@numba.njit
def _multiply_and_add(a: FloatArray, b: FloatArray) -> None:
    # 16 operations a number, in four independent chains
    for i in range(a.shape[0]):
        x = a[i]
        p, q, r, s = x * 1.1, x + 1.1, x * 1.2, x + 1.2
        p, q, r, s = p + 0.1, q * 0.9, r + 0.2, s * 0.8
        p, q, r, s = p * 1.1, q + 1.1, r * 1.2, s + 1.2
        b[i] = (p + q) * (r + s) + x


@numba.njit
def _difference(index: NDArray[np.uint32], rows: FloatArray, between: FloatArray) -> None:
    sign = row_of((-1.0, -1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0))
    for i in range(index.shape[0] // 2):
        one, other = load_eight(rows, 2 * index[2 * i]), load_eight(rows, 2 * index[2 * i + 1])
        store(between, 8 * (i % 64), add(other, multiply(sign, one)))


@numba.njit
def _scatter(index: NDArray[np.uint32], a: FloatArray, b: FloatArray) -> None:
    for i in range(index.shape[0]):
        b[index[i]] += a[i]


@numba.njit
def _sum(index: NDArray[np.uint32], rows: FloatArray, force: FloatArray) -> None:
    one = load(force, 0)
    for i in range(index.shape[0]):
        store(rows, index[i], add(load(rows, index[i]), one))


@numba.njit
def _stream(a: FloatArray, b: FloatArray) -> None:
    for i in range(a.shape[0]):
        b[i] += 1.1 * a[i]


def _fastest(call: Callable[[], object], repeats: int = REPEATS) -> float:
    call()
    times = []
    for _ in range(repeats):
        began = time.process_time()
        call()
        times.append(time.process_time() - began)
    return min(times)


@numba.njit
def _again(kernel: Callable[..., None], times: int, a: FloatArray, b: FloatArray) -> None:
    for _ in range(times):
        kernel(a, b)


def measure() -> Machine:
    """Measure this machine, in some seconds."""
    n, times = 512, 4000
    a, b = np.linspace(1, 2, n), np.zeros(n)

    def each(kernel: Callable[..., None]) -> float:
        return _fastest(lambda: _again(kernel, times, a, b)) / (times * n)

    rng = np.random.default_rng(0)
    index = 4 * np.concatenate([rng.permutation(n) for _ in range(2000)]).astype(np.uint32)
    values = rng.random(len(index))
    rows, four = zeros_in_lines(8 * n), np.ones(4)
    between = zeros_in_lines(512)
    sizes = 2.0 ** np.arange(14, 28)
    per_byte = []
    for size in sizes:
        c, d = np.ones(int(size / 16)), np.ones(int(size / 16))
        loops = max(1, int(2e7 / size))
        spent = _fastest(lambda c=c, d=d, k=loops: _again(_stream, k, c, d), 5)  # type: ignore[misc]
        per_byte.append(spent / loops / (24 * len(c)))  # two are read, one is written
    return Machine(
        division=each(_divide),
        root=each(_root),
        operation=each(_multiply_and_add) / 16,
        store=_fastest(lambda: _scatter(index, values, rows)) / len(index),
        difference=_fastest(lambda: _difference(index, rows, between)) / (len(index) // 2),
        sum=_fastest(lambda: _sum(index, rows, four)) / len(index),
        sizes=sizes,
        byte=np.array(per_byte),
    )


def step_limit(machine: Machine, discs: float, pairs: float) -> tuple[float, float, float]:
    """Return times of a step per disc [s]: the least one, one thing after the other, and memory's.

    Parameters
    ----------
    pairs : float
        Pairs per disc whose forces are worked out.
    """
    parts = (
        DIVISIONS * machine.division + ROOTS * machine.root,
        OPERATIONS * machine.operation,
        DIFFERENCES * machine.difference + SUMS * machine.sum,
    )
    size = discs * (PAIR_BYTES * pairs + DISC_BYTES)
    byte = float(np.interp(np.log(size), np.log(machine.sizes), machine.byte))
    moved = (PAIR_BYTES + PAIR_WRITTEN) * pairs + DISC_BYTES + DISC_WRITTEN
    return pairs * max(parts), pairs * sum(parts), moved * byte


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    found = measure()
    for name in ("division", "root", "operation", "store", "difference", "sum"):
        print(f"{name:10s} {getattr(found, name) * 1e9:6.3f} ns")
    for size, byte in zip(found.sizes, found.byte, strict=True):
        print(f"{size / 2**20:8.3f} MB {1e-9 / byte:6.1f} GB/s")
    whole = {}
    for discs in (150, 1024, 16384, 100_000):
        least, in_turn, memory = (1e9 * t for t in step_limit(found, discs, 3.3))
        whole[discs] = in_turn, memory
        print(
            f"{discs:7d} discs {least:5.1f} ns a disc, one after the other {in_turn:5.1f} ns, "
            f"memory {memory:5.1f} ns"
        )
    for discs in (16384, 100_000):
        after, at_once = (
            1 + np.log(kind(whole[discs]) / kind(whole[1024])) / np.log(discs / 1024)
            for kind in (sum, max)
        )
        print(
            f"growth from 1,024 to {discs:,}: {after:.2f} if memory comes after all that, "
            f"{at_once:.2f} if at the same time"
        )
