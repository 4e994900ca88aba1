"""Strips of discs: how threads share a simulation, to the same bits whatever their number.

Discs are numbered by rows of the cell, so consecutive ones lie in a strip. The number of strips
follows from that of discs alone, and every sum is made strip by strip. A thread has consecutive
strips and lists every pair of which one disc is its own: a pair between two threads is worked out
by both, from the same numbers, so nobody needs a force from another. The pairs of a disc come in
the order of the strip of their first disc, in all lists: forces are added in one and the same
order.
"""

from collections.abc import Callable
from typing import TypeVarTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.microgel.state import (
    ALL,
    BLOCK_ROWS,
    COUNT,
    FIRST,
    LANES,
    PAIR_ROWS,
    PERIOD,
    PHASE,
    Pairs,
    Work,
)  # fmt: skip
from shear_sim.quads import zeros_in_lines
from shear_sim.threads import new_meeting, together

Rest = TypeVarTuple("Rest")

STRIP = 1024  # discs in a strip, at least: few of their pairs have a disc in another
MOST = 64  # strips


def edges_of(n: int) -> NDArray[np.int64]:
    """Return the first disc of each strip of ``n`` discs, and ``n``; one strip below 2 STRIP."""
    strips = max(1, min(MOST, n // STRIP))
    return np.arange(strips + 1) * n // strips


def shared_by(work: Work, threads: int) -> list[Work]:
    """Return the Work of each of the threads that are to share a simulation.

    What is summed or found for itself each has for itself; the first has that of ``work``.
    """
    n, strips = len(work.px), len(work.edges) - 1
    meeting, extremes = new_meeting(), np.zeros((threads, 8))
    works = []
    for t in range(threads):
        lower, upper = strips * t // threads, strips * (t + 1) // threads
        own = work._replace(
            thread=t, threads=threads, meeting=meeting, extremes=extremes, lower=lower, upper=upper,
            begin=np.uint64(work.edges[lower]), end=np.uint64(work.edges[upper]),
        )  # fmt: skip
        if t:
            private = (
                "turns", "strain0", "largest", "closest", "stopped", "check", "tensors", "totals",
                "stored", "power", "energy",
            )  # fmt: skip
            own = own._replace(
                force_rows=zeros_in_lines(4 * n),
                block=zeros_in_lines(BLOCK_ROWS * LANES, PERIOD, PHASE),
                **{name: getattr(work, name).copy() for name in private},
            )  # fmt: skip
        works.append(own)
    return works


def in_strips(pairs: Pairs, edges: NDArray[np.int64]) -> Pairs:
    """Return a list of one strip as a list of those that ``edges`` divide the discs into."""
    if len(edges) == 2:
        return pairs
    n = int(pairs.strips[0, ALL])
    strip = np.searchsorted(edges, pairs.i[:n], side="right") - 1
    return _taken(pairs, [(0, np.flatnonzero(strip == s)) for s in range(len(edges) - 1)])


def share(pairs: Pairs, work: Work) -> Pairs:
    """Return the pairs that the thread of ``work`` has: one of their discs is its own."""
    parts = []
    for s, (first, total) in enumerate(pairs.strips[:, [FIRST, ALL]]):
        numbers = np.arange(total)
        if not work.lower <= s < work.upper:
            j = pairs.j[first : first + total]
            numbers = numbers[(j >= work.begin) & (j < work.end)]
        parts.append((s, numbers))
    return _taken(pairs, parts)


def joined(lists: list[Pairs], works: list[Work]) -> Pairs:
    """Return the one list of which threads have had their shares."""
    owner = [t for t, work in enumerate(works) for _ in range(work.lower, work.upper)]
    strips = np.array([lists[t].strips[s] for s, t in enumerate(owner)])
    old = strips[:, FIRST].copy()
    _place(strips)
    new = _zeros(strips)
    for s, t in enumerate(owner):
        _copy(lists[t], int(old[s]), new, int(strips[s, FIRST]), int(strips[s, ALL]))
    return new


def in_threads(
    threads: int,
    work: Work,
    links: Pairs,
    contacts: Pairs,
    kernel: Callable[[Work, Pairs, Pairs], tuple[Pairs, *Rest]],
) -> tuple[Pairs, *Rest]:
    """Have threads share a kernel, at most one for each strip; return what it returns."""
    threads = max(1, min(threads, len(work.edges) - 1))
    if threads == 1:
        return kernel(work, links, contacts)
    works = shared_by(work, threads)
    own_links = [share(links, own) for own in works]
    lists = [share(contacts, own) for own in works]

    def call(t: int) -> tuple[Pairs, *Rest]:
        result = kernel(works[t], own_links[t], lists[t])
        lists[t] = result[0]
        return result

    result = together(threads, works[0].meeting, call)
    links.table[:] = joined(own_links, works).table
    return joined(lists, works), *result[1:]


def _place(strips: NDArray[np.int64]) -> None:
    """Let every strip begin at a whole row of the table."""
    rows = -(-strips[:, ALL] // LANES)
    strips[:, FIRST] = LANES * (np.cumsum(rows) - rows)


def _zeros(strips: NDArray[np.int64]) -> Pairs:
    n = int((strips[:, FIRST] + strips[:, ALL])[strips[:, ALL] > 0].max(initial=0))
    table = zeros_in_lines(-(-n // LANES) * PAIR_ROWS * LANES, PERIOD)
    i, j = np.zeros(n, np.uint32), np.zeros(n, np.uint32)
    return Pairs(i, j, table.reshape(-1, PAIR_ROWS * LANES), strips)


def _copy(pairs: Pairs, first: int, new: Pairs, to: int, n: int) -> None:
    """Copy a strip whole."""
    new.i[to : to + n], new.j[to : to + n] = pairs.i[first : first + n], pairs.j[first : first + n]
    rows = -(-n // LANES)
    old = pairs.table[first // LANES : first // LANES + rows]
    new.table[to // LANES : to // LANES + rows] = old


def _taken(pairs: Pairs, parts: list[tuple[int, NDArray[np.int64]]]) -> Pairs:
    """Return a list whose strips are pairs ``numbers`` of a strip of ``pairs`` each."""
    strips = np.zeros((len(parts), ALL + 1), np.int64)
    for s, (source, numbers) in enumerate(parts):
        strips[s, COUNT:] = [np.count_nonzero(numbers < n) for n in pairs.strips[source, COUNT:]]
    _place(strips)
    new = _zeros(strips)
    from_table = pairs.table.reshape(-1, PAIR_ROWS, LANES)
    to_table = new.table.reshape(-1, PAIR_ROWS, LANES)
    for s, (source, numbers) in enumerate(parts):
        first, n = pairs.strips[source, FIRST], len(numbers)
        if n == pairs.strips[source, ALL]:
            _copy(pairs, int(first), new, int(strips[s, FIRST]), n)
            continue
        old, to = first + numbers, strips[s, FIRST] + np.arange(n)
        new.i[to], new.j[to] = pairs.i[old], pairs.j[old]
        to_table[to // LANES, :, to % LANES] = from_table[old // LANES, :, old % LANES]
    return new
