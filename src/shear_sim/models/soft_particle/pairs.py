"""Which segments are near which vertices."""

import numpy as np

from shear_sim.cell import Floats
from shear_sim.compiled import jit
from shear_sim.models.soft_particle.state import ONE_SIDED, TWO_SIDED, Chains, Lists
from shear_sim.neighbours import find_pairs


@jit
def distance_to_segment(
    x: float, y: float, x0: float, y0: float, x1: float, y1: float
) -> float:
    """Return the distance [m] of a point from a segment, ends included."""
    ex, ey = x1 - x0, y1 - y0
    along = ((x - x0) * ex + (y - y0) * ey) / (ex * ex + ey * ey)
    along = min(1.0, max(0.0, along))
    return float(np.hypot(x - x0 - along * ex, y - y0 - along * ey))


@jit
def _listed(chains: Chains, x: Floats, y: Floats, v: int, s: int, skin: float) -> int:
    """Return the kind of the contact that vertex ``v`` may have with segment ``s``, or −1."""
    j = chains.after[s]
    if j < 0 or s == v or j == v:
        return -1
    one, other = chains.chain[v], chains.chain[s]
    reach = chains.radius[one] + chains.radius[other]
    kind = ONE_SIDED if chains.closed[other] == 1 else TWO_SIDED
    if one == other:
        # What is near along the chain is kept apart by hinges, not by contacts.
        first = chains.start[one]
        count = chains.start[one + 1] - first
        steps = min(abs(v - s), abs(v - j))
        if chains.closed[one] == 1:
            steps = min(steps, count - max(abs(v - s), abs(v - j)))
        if steps <= max(3, int(np.ceil(0.5 * np.pi * reach / chains.rest_length[s]))):
            return -1
        kind = TWO_SIDED
    near = distance_to_segment(x[v], y[v], x[s], y[s], x[j], y[j]) < reach + skin
    return kind if near else -1


@jit
def near_segments(chains: Chains, x: Floats, y: Floats, skin: float) -> Lists:
    """Return the segments that each vertex may touch before anything has moved by ``skin``/2.

    Parameters
    ----------
    x, y : (V,)
        Positions [m].
    skin : float
        Listed are segments closer than the two radii plus this [m].
    """
    vertices = x.shape[0]
    longest = 0.0
    for k in range(vertices):
        j = chains.after[k]
        if j >= 0:
            longest = max(longest, np.hypot(x[j] - x[k], y[j] - y[k]))
    # A segment that is near has its first vertex within its length of that.
    reach = 2.0 * chains.radius.max() + longest
    half = np.full(vertices, 0.5 * reach)
    x0, y0 = x.min(), y.min()
    width = x.max() - x0 + 2.0 * (reach + skin)
    height = y.max() - y0 + 2.0 * (reach + skin)
    _, i, j, _, _ = find_pairs(x - x0, y - y0, half, skin, width, height, 0.0)

    start = np.zeros(vertices + 1, np.int32)
    for q in range(i.shape[0]):
        start[i[q] + 1] += 1 if _listed(chains, x, y, i[q], j[q], skin) >= 0 else 0
        start[j[q] + 1] += 1 if _listed(chains, x, y, j[q], i[q], skin) >= 0 else 0
    for v in range(vertices):
        start[v + 1] += start[v]
    segment = np.empty(start[vertices], np.int32)
    kinds = np.empty(start[vertices], np.int32)
    fill = start[:-1].copy()
    for q in range(i.shape[0]):
        for v, s in ((i[q], j[q]), (j[q], i[q])):
            kind = _listed(chains, x, y, v, s, skin)
            if kind >= 0:
                segment[fill[v]] = s
                kinds[fill[v]] = kind
                fill[v] += 1
    # In the order of segments, whatever cells the vertices lie in: sums keep their order.
    for v in range(vertices):
        for a in range(start[v] + 1, start[v + 1]):
            s, kind, b = segment[a], kinds[a], a
            while b > start[v] and segment[b - 1] > s:
                segment[b], kinds[b] = segment[b - 1], kinds[b - 1]
                b -= 1
            segment[b], kinds[b] = s, kind
    return Lists(start, segment, kinds)
