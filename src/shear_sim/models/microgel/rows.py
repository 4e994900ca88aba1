"""What pairs ask of discs, and what they give them.

Loops over pairs and loops over discs are vectors each, but the discs of the next pair are elsewhere
in memory. So what pairs ask of a disc is written to a row of eight numbers, one cache line, and the
forces of pairs are added up in rows of four; eight rows at a time are turned into columns between
registers (`quads`). Pairs are taken a block at a time, LANES of them: a small table in the cache.
"""

from typing import Any

import numpy as np

from shear_sim.cell import Floats
from shear_sim.compiled import jit
from shear_sim.models.microgel.state import BLOCK_ROWS, LANES, PAIR_ROWS, Discs, Unsigned, Work
from shear_sim.prefetch import prefetch
from shear_sim.quads import (
    add,
    load,
    load_eight,
    multiply,
    row_of,
    store,
    transpose,
    transpose_eight,
)

# Rows of Work.block. Between discs: position, peculiar velocity, velocity and displacement of the
# rims, place in the cell; then distance, direction and relative velocity along and across it; then
# force on i and torque / r; then extremes over all blocks; then what TALLY asks for.
(
    DX, DY, CX, CY, RIMS, ROLLED, LX, LY, AWAY, UX, UY, VN, VT, FX, FY, TWIST,
    CLOSEST, LONGEST, CLOSING, ELASTIC, BEFORE, SLID,
) = range(0, BLOCK_ROWS * LANES, LANES)  # fmt: skip

ONE, TWO, THREE, FOUR = np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4)
FIVE, SIX, SEVEN, EIGHT = np.uint64(5), np.uint64(6), np.uint64(7), np.uint64(8)


#: So many rows of Pairs.table lie in the cache anyway: half a megabyte.
CACHED_ROWS = 50
#: Lines of the next one that are asked for with each octet of pairs, in `gather` and in `scatter`:
#: all of them at once would be more than a processor can have on its way, and it would wait.
LINES = PAIR_ROWS // 2
#: So many numbers in rows of discs lie in the cache of one processor core: a megabyte.
CACHED_NUMBERS = 2**17
AHEAD = np.uint64(128)  # discs


@jit(inner=True)
def fetch(
    ahead: Floats, half: int, lane: int, rows: Floats, width: np.uint64, j: Unsigned, q: np.uint64
) -> None:
    """Have some of what the next block asks for brought near, with the octet from ``lane`` on.

    ``half``, 0 or 1, of its row ``ahead`` of ``Pairs.table``, and the ``rows`` of ``width`` numbers
    of its second discs; ``q`` is the octet's first pair. First discs have been second ones before.
    Where all that does not fit in the cache, to wait for it takes longer than to work on it.
    """
    if ahead.shape[0] > 0:
        first = half * (ahead.shape[0] // 2) + lane * LINES
        for n in range(LINES):
            prefetch(ahead, first + 8 * n)
        for n in range(8):
            prefetch(rows, j[q + np.uint64(LANES + n)] * width)


@jit(inner=True)
def write_rows(discs: Discs, work: Work) -> None:
    """Write to ``work.disc_rows`` what pairs ask of this thread's discs, eight numbers each.

    Position [m] and predicted velocity [m/s]; then velocity of the rim [m/s], its displacement in
    the step that ends now [m], and the place in the cell, of the last record [m].
    """
    rows, begin, end = work.disc_rows, work.begin, work.end
    whole = end - (end - begin) % EIGHT
    for a in range(begin, whole, EIGHT):
        radius = load_eight(discs.radius, a)
        octets = transpose_eight(
            load_eight(discs.x, a), load_eight(discs.y, a),
            load_eight(work.px, a), load_eight(work.py, a),
            multiply(radius, load_eight(work.pspin, a)), multiply(radius, load_eight(work.turn, a)),
            load_eight(work.lx, a), load_eight(work.ly, a),
        )  # fmt: skip
        if rows.shape[0] > CACHED_NUMBERS:  # or what is written would have to be read first
            for n in range(8):
                prefetch(rows, (a + AHEAD + np.uint64(n)) * EIGHT)
        for n in range(8):
            store(rows, (a + np.uint64(n)) * EIGHT, octets[n])
    for a in range(whole, end):
        row = (
            discs.x[a], discs.y[a], work.px[a], work.py[a],
            discs.radius[a] * work.pspin[a], discs.radius[a] * work.turn[a],
            work.lx[a], work.ly[a],
        )  # fmt: skip
        for n in range(8):
            rows[a * EIGHT + np.uint64(n)] = row[n]


@jit(inner=True)
def between(rows: Floats, i: Unsigned, j: Unsigned, q: np.uint64) -> Any:
    """Return what lies between the discs of pair ``q``: differences, but sums of what rims do."""
    sign = row_of((-1.0, -1.0, -1.0, -1.0, 1.0, 1.0, -1.0, -1.0))
    return add(load_eight(rows, j[q] * EIGHT), multiply(sign, load_eight(rows, i[q] * EIGHT)))


@jit(_nrt=False)
def gather(
    rows: Floats, i: Unsigned, j: Unsigned, first: int, m: int, block: Floats, turning: bool,
    record: bool, ahead: Floats,
) -> None:  # fmt: skip
    """Write to ``block`` what lies between the discs of pairs ``first`` to ``first`` + ``m``.

    ``rows``: what `write_rows` wrote. What rims do matters to ``turning`` discs only, and places in
    the cell to a ``record``. ``ahead``: the next block's row, to `fetch` meanwhile, or nothing.
    """
    at = np.uint64(first)
    whole = m - m % 8
    for s in range(0, whole, 8):
        q = at + np.uint64(s)
        dx, dy, cx, cy, rims, rolled, lx, ly = transpose_eight(
            between(rows, i, j, q), between(rows, i, j, q + ONE),
            between(rows, i, j, q + TWO), between(rows, i, j, q + THREE),
            between(rows, i, j, q + FOUR), between(rows, i, j, q + FIVE),
            between(rows, i, j, q + SIX), between(rows, i, j, q + SEVEN),
        )  # fmt: skip
        store(block, DX + s, dx)
        store(block, DY + s, dy)
        store(block, CX + s, cx)
        store(block, CY + s, cy)
        fetch(ahead, 0, s, rows, EIGHT, j, q)
        if turning:
            store(block, RIMS + s, rims)
            store(block, ROLLED + s, rolled)
        if record:
            store(block, LX + s, lx)
            store(block, LY + s, ly)
    for s in range(whole, m):
        a, b = i[at + np.uint64(s)] * EIGHT, j[at + np.uint64(s)] * EIGHT
        for n in range(8):
            one, other = rows[a + np.uint64(n)], rows[b + np.uint64(n)]
            block[n * LANES + s] = other + one if 4 <= n < 6 else other - one


@jit(inner=True)
def empty_rows(work: Work) -> None:
    """Let no force act on this thread's discs."""
    for a in range(work.begin * FOUR, work.end * FOUR):
        work.force_rows[a] = 0.0


@jit(inner=True)
def push(rows: Floats, i: int, j: int, force: Any) -> None:
    """Add a force and its torque to the row of disc ``i``, and what they do to ``j``."""
    a, b = i * FOUR, j * FOUR
    store(rows, a, add(load(rows, a), force))
    store(rows, b, add(load(rows, b), multiply(row_of((-1.0, -1.0, 1.0, 1.0)), force)))


@jit(inner=True)
def scatter(
    rows: Floats, i: Unsigned, j: Unsigned, first: int, m: int, block: Floats, turning: bool,
    ahead: Floats,
) -> None:  # fmt: skip
    """Add the forces of a block to the rows of its discs: force, and torque by radius."""
    at = np.uint64(first)
    whole = m - m % 4
    none = row_of((0.0, 0.0, 0.0, 0.0))
    for s in range(0, whole, 4):
        q = at + np.uint64(s)
        twist = load(block, TWIST + s) if turning else none
        f, g, h, k = transpose(load(block, FX + s), load(block, FY + s), twist, none)
        if s % 8 == 0:
            fetch(ahead, 1, s, rows, FOUR, j, q)
        push(rows, i[q], j[q], f)
        push(rows, i[q + ONE], j[q + ONE], g)
        push(rows, i[q + TWO], j[q + TWO], h)
        push(rows, i[q + THREE], j[q + THREE], k)
    for s in range(whole, m):
        a, b = i[at + np.uint64(s)] * FOUR, j[at + np.uint64(s)] * FOUR
        rows[a] += block[FX + s]
        rows[a + ONE] += block[FY + s]
        rows[b] -= block[FX + s]
        rows[b + ONE] -= block[FY + s]
        if turning:
            rows[a + TWO] += block[TWIST + s]
            rows[b + TWO] += block[TWIST + s]


@jit(inner=True)
def read_rows(discs: Discs, work: Work, turning: bool) -> None:
    """Take forces and torques of this thread's discs from the rows that pairs have added to."""
    rows, begin, end = work.force_rows, work.begin, work.end
    fx, fy, torque = work.fx, work.fy, work.torque
    whole = end - (end - begin) % FOUR
    for a in range(begin, whole, FOUR):
        x, y, twist, _ = transpose(
            load(rows, a * FOUR), load(rows, (a + ONE) * FOUR),
            load(rows, (a + TWO) * FOUR), load(rows, (a + THREE) * FOUR),
        )  # fmt: skip
        store(fx, a, x)
        store(fy, a, y)
        if turning:
            store(torque, a, multiply(twist, load(discs.radius, a)))
    for a in range(whole, end):
        fx[a], fy[a] = rows[a * FOUR], rows[a * FOUR + ONE]
        torque[a] = rows[a * FOUR + TWO] * discs.radius[a]
