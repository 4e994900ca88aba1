"""Which segments are near which vertices."""

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit
from shear_sim.models.soft_particle.state import (
    LAST,
    ONE_SIDED,
    TWO_SIDED,
    Cell,
    Chains,
    Lists,
    Strips,
)
from shear_sim.neighbours import find_pairs
from shear_sim.threads import new_meeting, together


@jit
def is_near(x: float, y: float, x0: float, y0: float, x1: float, y1: float, reach: float) -> bool:
    """Tell whether a point is within ``reach`` [m] of a segment, ends included."""
    ex, ey, qx, qy = x1 - x0, y1 - y0, x - x0, y - y0
    along, square = qx * ex + qy * ey, ex * ex + ey * ey
    limit = reach * reach
    across = qx * ey - qy * ex
    # Without branches: which way they go is hard to guess.
    near = (along > 0.0) & (along < square) & (across * across < limit * square)
    near |= (qx * qx + qy * qy < limit) | ((qx - ex) ** 2 + (qy - ey) ** 2 < limit)
    return bool(near)


@jit(inner=True)
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
    ix: int,
    iy: int,
    sx: float,
    sy: float,
    skin: float,
) -> int:
    """Return the kind of the contact that vertex ``v`` may have with segment ``s``, or −1.

    The segment is that of image ``ix``, ``iy``, which is displaced by ``sx``, ``sy`` [m].
    """
    j = after[s]
    if j < 0 or ((s == v or j == v) and ix == 0 and iy == 0):
        return -1
    one, other = chain[v], chain[s]
    reach = radius[one] + radius[other]
    if not is_near(x[v] - sx, y[v] - sy, x[s], y[s], x[j], y[j], reach + skin):
        return -1
    kind = ONE_SIDED if closed[other] == 1 else TWO_SIDED if after[j] >= 0 else LAST
    if one == other and ix == 0 and iy == 0:
        # What is near along the chain is kept apart by hinges, not by contacts.
        count = start[one + 1] - start[one]
        steps = min(abs(v - s), abs(v - j))
        if closed[one] == 1:
            steps = min(steps, count - max(abs(v - s), abs(v - j)))
        if steps <= 3 or (steps - 1) * rest_length[s] < 0.5 * np.pi * reach:
            return -1
        kind = max(kind, TWO_SIDED)
    return kind


@jit(nogil=True)
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
    nx: Ints,
    ny: Ints,
    size: Floats,
    strain: float,
    skin: float,
    first: int,
    end: int,
) -> tuple[Ints, Ints, Ints, Ints]:
    """Return vertex, segment, kind and image of `near_segments` from near pairs of vertices.

    ``i`` and the image ``nx``, ``ny`` of ``j`` (P,) are near each other. Listed are segments near
    the vertices from ``first`` to before ``end``.
    """
    vertices = x.shape[0]
    kind = np.empty((2, i.shape[0]), np.int32)
    begin = np.zeros(vertices + 1, np.int32)
    for q in range(i.shape[0]):
        for way in range(2):
            v, s = (i[q], j[q]) if way == 0 else (j[q], i[q])
            if not first <= v < end:
                kind[way, q] = -1
                continue
            sign = 1 if way == 0 else -1
            ix, iy = sign * nx[q], sign * ny[q]
            kind[way, q] = contact_kind(
                chain, closed, start, after, radius, rest_length, x, y, v, s, ix, iy,
                ix * size[0] + iy * strain * size[1], iy * size[1], skin,
            )  # fmt: skip
            if kind[way, q] >= 0:
                begin[v + 1] += 1
    for v in range(vertices):
        begin[v + 1] += begin[v]
    segment = np.empty(begin[vertices], np.int32)
    kinds = np.empty(begin[vertices], np.int32)
    image = np.empty((2, begin[vertices]), np.int32)
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
                image[0, at], image[1, at] = image[0, at - 1], image[1, at - 1]
                at -= 1
            segment[at], kinds[at] = s, kind[way, q]
            sign = 1 if way == 0 else -1
            image[0, at], image[1, at] = sign * nx[q], sign * ny[q]
            vertex[begin[v] + filled[v]] = v
            filled[v] += 1
    return vertex, segment, kinds, image


def near_segments(
    chains: Chains, x: Floats, y: Floats, skin: float, cell: Cell, strips: Strips, threads: int
) -> Lists:
    """Return the segments that each vertex may touch before anything has moved by ``skin``/2.

    Parameters
    ----------
    x, y : (V,)
        Positions [m].
    skin : float
        Listed are segments closer than the two radii plus this [m].
    cell : Cell
        The periodic cell, if there is one.
    strips : Strips
        How the vertices are divided.
    threads : int
        How many share the work, each of which has some strips.
    """
    ahead = np.where(chains.after >= 0, chains.after, np.arange(len(x)))
    longest = float(np.hypot(x[ahead] - x, y[ahead] - y).max())
    # A segment that is near has its first vertex within its length of that.
    reach = 2.0 * float(chains.radius.max()) + longest
    half = np.full(len(x), 0.5 * reach)
    width, height = cell.size
    strain = float(cell.strain[0])
    if height > 0.0:
        row = np.floor(y / height).astype(np.int32)
        column = np.floor((x - row * strain * height) / width).astype(np.int32)
        inside_x = np.clip(x - column * width - row * strain * height, 0.0, width)
        inside_y = np.clip(y - row * height, 0.0, height)
        offset = strain * height
    else:
        row = column = np.zeros(len(x), np.int32)
        inside_x, inside_y, offset = x - x.min(), y - y.min(), 0.0
        room = 2.0 * (reach + skin)  # so that no image is near
        width, height = np.ptp(x) + room, np.ptp(y) + room

    strip_count = len(strips.vertex) - 1
    parts = min(threads, strip_count)
    found = {}

    def search(part: int) -> None:
        first = int(strips.vertex[strip_count * part // parts])
        end = int(strips.vertex[strip_count * (part + 1) // parts])
        _, i, j, nx, ny = find_pairs(
            inside_x, inside_y, half, skin, float(width), float(height), float(offset), first, end
        )
        found[part] = sort_by_vertex(
            chains.chain, chains.closed, chains.start, chains.after, chains.radius,
            chains.rest_length, x, y, i, j, nx + column[i] - column[j], ny + row[i] - row[j],
            cell.size, strain, skin, first, end,
        )  # fmt: skip

    together(parts, new_meeting(), search)
    vertex, segment, kind, image = (
        np.concatenate([found[part][what] for part in range(parts)], axis=-1) for what in range(4)
    )
    touch = chains.radius[chains.chain[vertex]] + chains.radius[chains.chain[segment]]
    pairs = len(vertex)
    lists = Lists(
        vertex, segment, kind, touch, tuple(image), tuple(np.zeros((2, pairs))), np.array([strain]),
        np.array([reach + skin + longest]), x.copy(), y.copy(),
        np.empty(pairs, np.int32), np.empty((3 * pairs, 4), np.int32), np.empty((3 * pairs, 7)),
        np.empty(3 * pairs, np.int32), np.searchsorted(vertex, strips.vertex).astype(np.int32),
    )  # fmt: skip
    shift_images(lists, cell)
    return lists


@jit
def shift_images(lists: Lists, cell: Cell) -> None:
    """Write where the images are now that the segments of all pairs belong to."""
    width, height, strain = cell.size[0], cell.size[1], cell.strain[0]
    for c in range(lists.segment.shape[0]):
        nx, ny = lists.image[0][c], lists.image[1][c]
        lists.shift[0][c] = nx * width + ny * strain * height
        lists.shift[1][c] = ny * height
