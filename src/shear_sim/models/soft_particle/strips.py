"""Strips of chains: how threads share a system, to the same bits whatever their number.

The number of strips follows from that of vertices alone, and every sum is made strip by strip. A
strip finds the contacts of its own vertices. What these do to vertices of other strips goes into
its mail; when all have written theirs, everyone takes in what is for him, in the order in which it
was written. So each pair is worked out once, and forces are added in one and the same order.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from shear_sim.cell import Floats
from shear_sim.compiled import jit
from shear_sim.models.soft_particle.state import (
    LINE,
    Cell,
    Chains,
    Links,
    Lists,
    Mail,
    Motion,
    Strips,
    Walls,
    Work,
)
from shear_sim.threads import new_meeting, together

STRIP = 2000  # vertices in a strip, at least: few of their contacts are with others
MOST = 16  # strips
LETTERS = 30  # most forces on others that a pair of vertex and segment has: 3 features with 10 each
LETTERS_OF_LINK = 5


def strip_count(vertices: int, chains: int) -> int:
    """Return how many strips there are, about: one below 2 STRIP vertices.

    A power of two, so that as many threads have strips alike.
    """
    return 1 << (max(1, min(MOST, vertices // STRIP, chains)).bit_length() - 1)


def divide(chains: Chains, walls: int) -> Strips:
    """Return the strips of a system with ``walls`` walls."""
    vertices, count = int(chains.start[-1]), len(chains.closed)
    strips = strip_count(vertices, count)
    goals = vertices * np.arange(1, strips) // strips
    edges = np.unique(np.concatenate([[0], np.searchsorted(chains.start, goals), [count]]))
    strips = len(edges) - 1
    start = [chains.start[a : b + 1] - chains.start[a] for a, b in pairwise(edges)]
    return Strips(
        0, 1, 0, strips, new_meeting(), edges.astype(np.int32), chains.start[edges],
        np.concatenate(start), np.zeros(strips + 1, np.int32), np.zeros(strips + 1, np.int32),
        np.zeros(strips), np.zeros(strips), np.zeros(strips, np.int32),
        np.zeros((strips, 3, walls)),
    )  # fmt: skip


def strip_of(strips: Strips) -> NDArray[np.int64]:
    """Return the strip (V,) of every vertex."""
    return np.repeat(np.arange(len(strips.vertex) - 1), np.diff(strips.vertex))


def sort_links(links: Links, strips: Strips) -> tuple[Links, Strips]:
    """Return links in the order of strips; both of an interface belong to one strip.

    That of the vertex of the first: whether one breaks is decided with the other.
    """
    count = len(links.vertex)
    owner = strip_of(strips)[links.vertex[np.minimum(np.arange(count), links.brother)]]
    order = np.argsort(owner, kind="stable")
    place = np.empty(count, np.int32)
    place[order] = np.arange(count)
    parts = {name: getattr(links, name)[order] for name in Links._fields if name != "law"}
    parts["brother"] = place[parts["brother"]]
    first = np.searchsorted(owner[order], np.arange(len(strips.vertex)))
    return links._replace(**parts), strips._replace(link=first.astype(np.int32))


def mail(lists: Lists, strips: Strips) -> Mail:
    """Return room for what any strip may have for others, while the lists are good."""
    count = len(strips.vertex) - 1
    strip = strip_of(strips)
    finder = strip[lists.vertex]
    room = LETTERS * np.bincount(finder[finder != strip[lists.segment]], minlength=count)
    room += LETTERS_OF_LINK * np.diff(strips.link) * (count > 1)
    first = np.concatenate([[0], np.cumsum(room)])
    return Mail(
        first.astype(np.int32), np.zeros((count, LINE), np.int32), np.empty(first[-1], np.int32),
        np.empty((first[-1], 2)),
    )  # fmt: skip


def in_threads(
    threads: int,
    strips: Strips,
    walls: Walls,
    cell: Cell,
    work: Work,
    kernel: Callable[[Strips, Walls, Cell, Work], tuple[int, int]],
) -> tuple[int, int]:
    """Have threads share a kernel, at most one for each strip; return what it returns.

    Walls and the strain of the cell all of them move, each his own, by the same sums.
    """
    count = len(strips.vertex) - 1
    threads = max(1, min(threads, count))
    strips = strips._replace(threads=threads, meeting=new_meeting())
    shares = []
    for t in range(threads):
        own = strips._replace(
            thread=t, lower=count * t // threads, upper=count * (t + 1) // threads
        )
        if t == 0:
            shares.append((own, walls, cell, work))
            continue
        shares.append(
            (
                own,
                Walls(*(values.copy() for values in walls)),
                cell._replace(strain=cell.strain.copy(), steps=cell.steps.copy()),
                work._replace(
                    travelled=work.travelled.copy(),
                    closest=work.closest.copy(),
                    near=work.near.copy(),
                ),
            )
        )
    result = together(threads, strips.meeting, lambda t: kernel(*shares[t]))
    for _, _, _, other in shares[1:]:
        nearer = other.closest < work.closest
        work.near[nearer] = other.near[nearer]
        work.closest[nearer] = other.closest[nearer]
    work.energy[:] = work.ledger.sum(axis=0)[: len(work.energy)]
    return result


@jit(inner=True)
def chains_of(chains: Chains, strips: Strips, strip: int) -> Chains:
    """Return the chains of a strip, their vertices counted from its first."""
    p, q = strips.chain[strip], strips.chain[strip + 1]
    a, b = strips.vertex[strip], strips.vertex[strip + 1]
    return Chains(
        strips.start[p + strip : q + strip + 1],
        chains.closed[p:q],
        chains.radius[p:q],
        chains.stretch_yield[p:q],
        chains.bend_yield[p:q],
        chains.stretch_damping[p:q],
        chains.bend_damping[p:q],
        chains.inner_damping[p:q],
        chains.core_law[p:q],
        chains.core_stiffness[p:q],
        chains.core_pressure[p:q],
        chains.core_area[p:q],
        chains.chain[a:b],
        chains.before[a:b],
        chains.after[a:b],
        chains.mass[a:b],
        chains.stretch_stiffness[a:b],
        chains.bend_stiffness[a:b],
        chains.rest_length[a:b],
        chains.rest_angle[a:b],
        chains.tension[a:b],
        chains.moment[a:b],
    )


@jit(inner=True)
def motion_of(motion: Motion, strips: Strips, strip: int) -> Motion:
    """Return the vertices of a strip."""
    a, b = strips.vertex[strip], strips.vertex[strip + 1]
    return Motion(
        motion.x[a:b],
        motion.y[a:b],
        motion.vx[a:b],
        motion.vy[a:b],
        motion.px[a:b],
        motion.py[a:b],
        motion.fx[a:b],
        motion.fy[a:b],
        motion.dx[a:b],
        motion.dy[a:b],
        motion.gx[a:b],
        motion.gy[a:b],
        motion.free_x[a:b],
        motion.free_y[a:b],
    )


@jit(inner=True)
def lists_of(lists: Lists, strip: int) -> Lists:
    """Return the pairs that vertices of a strip have."""
    a, b = lists.first[strip], lists.first[strip + 1]
    return Lists(
        lists.vertex[a:b],
        lists.segment[a:b],
        lists.kind[a:b],
        lists.reach[a:b],
        (lists.image[0][a:b], lists.image[1][a:b]),
        (lists.shift[0][a:b], lists.shift[1][a:b]),
        lists.strain,
        lists.span,
        lists.x,
        lists.y,
        lists.touching[a:b],
        lists.place[3 * a : 3 * b],
        lists.found[3 * a : 3 * b],
        lists.run[3 * a : 3 * b],
        lists.first,
    )


@jit(inner=True)
def rows_of(rows: tuple[Floats, ...], strips: Strips, strip: int) -> tuple[Floats, ...]:
    """Return 8 rows of one number a vertex, of the vertices of a strip."""
    a, b = strips.vertex[strip], strips.vertex[strip + 1]
    return (
        rows[0][a:b], rows[1][a:b], rows[2][a:b], rows[3][a:b],
        rows[4][a:b], rows[5][a:b], rows[6][a:b], rows[7][a:b],
    )  # fmt: skip


@jit(inner=True)
def add(
    own: bool, fx: Floats, fy: Floats, k: int, gx: float, gy: float, letters: Mail, strip: int
) -> None:
    """Add a force [N/m] on vertex ``k``: its own, or left in the mail of ``strip``."""
    if own:
        fx[k] += gx
        fy[k] += gy
    else:
        leave(letters, strip, k, gx, gy)


@jit(inner=True)
def add_loss(
    own: bool, dx: Floats, dy: Floats, k: int, gx: float, gy: float, letters: Mail, strip: int
) -> None:
    """Do the same with the force of a dashpot."""
    if own:
        dx[k] += gx
        dy[k] += gy
    else:
        leave(letters, strip, -1 - k, gx, gy)


@jit(inner=True)
def leave(letters: Mail, strip: int, k: int, gx: float, gy: float) -> None:
    """Leave a force [N/m] in the mail of ``strip``, if any; ``k``, see ``Mail.vertex``."""
    if gx == 0.0 and gy == 0.0:
        return
    to = letters.first[strip] + letters.sent[strip, 0]
    letters.sent[strip, 0] += 1
    letters.vertex[to] = k
    letters.force[to, 0] = gx
    letters.force[to, 1] = gy


@jit(inner=True)
def take_in(motion: Motion, strips: Strips, letters: Mail) -> None:
    """Add what all strips have written for the vertices of this thread."""
    first, end = strips.vertex[strips.lower], strips.vertex[strips.upper]
    for s in range(letters.sent.shape[0]):
        begin = letters.first[s]
        for m in range(begin, begin + letters.sent[s, 0]):
            k = letters.vertex[m]
            if first <= k < end:
                motion.fx[k] += letters.force[m, 0]
                motion.fy[k] += letters.force[m, 1]
            elif first <= -1 - k < end:
                motion.dx[-1 - k] += letters.force[m, 0]
                motion.dy[-1 - k] += letters.force[m, 1]
