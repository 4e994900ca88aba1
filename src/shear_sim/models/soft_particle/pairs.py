"""Which segments are near which vertices."""

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit
from shear_sim.models.soft_particle.state import LAST, ONE_SIDED, TWO_SIDED, Chains, Lists
from shear_sim.neighbours import find_pairs


@jit
def distance_to_segment(x: float, y: float, x0: float, y0: float, x1: float, y1: float) -> float:
    """Return the distance [m] of a point from a segment, ends included."""
    ex, ey = x1 - x0, y1 - y0
    along = ((x - x0) * ex + (y - y0) * ey) / (ex * ex + ey * ey)
    along = min(1.0, max(0.0, along))
    return float(np.hypot(x - x0 - along * ex, y - y0 - along * ey))


@jit
def contact_kind(
    chain: Ints,
    closed: Ints,
    start: Ints,
    after: Ints,
    radius: Floats,
    rest_length: Floats,
    x: Floats,
    y: Floats,
    v: int,
    s: int,
    skin: float,
) -> int:
    """Return the kind of the contact that vertex ``v`` may have with segment ``s``, or −1."""
    j = after[s]
    if j < 0 or s == v or j == v:
        return -1
    one, other = chain[v], chain[s]
    reach = radius[one] + radius[other]
    kind = ONE_SIDED if closed[other] == 1 else TWO_SIDED if after[j] >= 0 else LAST
    if one == other:
        # What is near along the chain is kept apart by hinges, not by contacts.
        count = start[one + 1] - start[one]
        steps = min(abs(v - s), abs(v - j))
        if closed[one] == 1:
            steps = min(steps, count - max(abs(v - s), abs(v - j)))
        if steps <= max(3, int(np.ceil(0.5 * np.pi * reach / rest_length[s]))):
            return -1
        kind = max(kind, TWO_SIDED)
    near = distance_to_segment(x[v], y[v], x[s], y[s], x[j], y[j]) < reach + skin
    return kind if near else -1


@jit
def sort_by_vertex(
    chain: Ints,
    closed: Ints,
    start: Ints,
    after: Ints,
    radius: Floats,
    rest_length: Floats,
    x: Floats,
    y: Floats,
    i: Ints,
    j: Ints,
    skin: float,
) -> tuple[Ints, Ints, Ints]:
    """Return vertex, segment and kind of `near_segments` from pairs ``i``, ``j`` of vertices."""
    vertices = x.shape[0]
    kind = np.empty((2, i.shape[0]), np.int32)
    begin = np.zeros(vertices + 1, np.int32)
    for q in range(i.shape[0]):
        for way in range(2):
            v, s = (i[q], j[q]) if way == 0 else (j[q], i[q])
            kind[way, q] = contact_kind(
                chain, closed, start, after, radius, rest_length, x, y, v, s, skin
            )
            if kind[way, q] >= 0:
                begin[v + 1] += 1
    for v in range(vertices):
        begin[v + 1] += begin[v]
    segment = np.empty(begin[vertices], np.int32)
    kinds = np.empty(begin[vertices], np.int32)
    vertex = np.empty(begin[vertices], np.int32)
    filled = np.zeros(vertices, np.int32)
    for q in range(i.shape[0]):
        for way in range(2):
            if kind[way, q] < 0:
                continue
            v, s = (i[q], j[q]) if way == 0 else (j[q], i[q])
            # In the order of segments, whatever cells the vertices lie in: sums keep their order.
            at = begin[v] + filled[v]
            while at > begin[v] and segment[at - 1] > s:
                segment[at], kinds[at] = segment[at - 1], kinds[at - 1]
                at -= 1
            segment[at], kinds[at] = s, kind[way, q]
            vertex[begin[v] + filled[v]] = v
            filled[v] += 1
    return vertex, segment, kinds


def near_segments(chains: Chains, x: Floats, y: Floats, skin: float) -> Lists:
    """Return the segments that each vertex may touch before anything has moved by ``skin``/2.

    Parameters
    ----------
    x, y : (V,)
        Positions [m].
    skin : float
        Listed are segments closer than the two radii plus this [m].
    """
    ahead = np.where(chains.after >= 0, chains.after, np.arange(len(x)))
    longest = float(np.hypot(x[ahead] - x, y[ahead] - y).max())
    # A segment that is near has its first vertex within its length of that.
    reach = 2.0 * float(chains.radius.max()) + longest
    x0, y0 = float(x.min()), float(y.min())
    width = float(x.max()) - x0 + 2.0 * (reach + skin)
    height = float(y.max()) - y0 + 2.0 * (reach + skin)
    half = np.full(len(x), 0.5 * reach)
    _, i, j, _, _ = find_pairs(x - x0, y - y0, half, skin, width, height, 0.0)
    vertex, segment, kind = sort_by_vertex(
        chains.chain, chains.closed, chains.start, chains.after, chains.radius,
        chains.rest_length, x, y, i, j, skin,
    )  # fmt: skip
    touch = chains.radius[chains.chain[vertex]] + chains.radius[chains.chain[segment]]
    count = len(vertex)
    return Lists(
        vertex, segment, kind, touch, x.copy(), y.copy(),
        np.empty(count, np.int32), np.empty((3 * count, 4), np.int32), np.empty((3 * count, 5)),
        np.empty(3 * count, np.int32),
    )  # fmt: skip
