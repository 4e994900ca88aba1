"""Which segments are near which vertices."""

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit
from shear_sim.models.soft_particle.state import LAST, ONE_SIDED, TWO_SIDED, Cell, Chains, Lists
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
    kind = ONE_SIDED if closed[other] == 1 else TWO_SIDED if after[j] >= 0 else LAST
    if one == other and ix == 0 and iy == 0:
        # What is near along the chain is kept apart by hinges, not by contacts.
        count = start[one + 1] - start[one]
        steps = min(abs(v - s), abs(v - j))
        if closed[one] == 1:
            steps = min(steps, count - max(abs(v - s), abs(v - j)))
        if steps <= max(3, int(np.ceil(0.5 * np.pi * reach / rest_length[s]))):
            return -1
        kind = max(kind, TWO_SIDED)
    near = distance_to_segment(x[v] - sx, y[v] - sy, x[s], y[s], x[j], y[j]) < reach + skin
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
    nx: Ints,
    ny: Ints,
    size: Floats,
    strain: float,
    skin: float,
) -> tuple[Ints, Ints, Ints, Ints]:
    """Return vertex, segment, kind and image of `near_segments` from near pairs of vertices.

    ``i`` and the image ``nx``, ``ny`` of ``j`` (P,) are near each other.
    """
    vertices = x.shape[0]
    kind = np.empty((2, i.shape[0]), np.int32)
    begin = np.zeros(vertices + 1, np.int32)
    for q in range(i.shape[0]):
        for way in range(2):
            v, s = (i[q], j[q]) if way == 0 else (j[q], i[q])
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


def near_segments(chains: Chains, x: Floats, y: Floats, skin: float, cell: Cell) -> Lists:
    """Return the segments that each vertex may touch before anything has moved by ``skin``/2.

    Parameters
    ----------
    x, y : (V,)
        Positions [m].
    skin : float
        Listed are segments closer than the two radii plus this [m].
    cell : Cell
        The periodic cell, if there is one.
    """
    ahead = np.where(chains.after >= 0, chains.after, np.arange(len(x)))
    longest = float(np.hypot(x[ahead] - x, y[ahead] - y).max())
    # A segment that is near has its first vertex within its length of that.
    reach = 2.0 * float(chains.radius.max()) + longest
    half = np.full(len(x), 0.5 * reach)
    width, height = cell.size
    strain = float(cell.strain[0])
    if height > 0.0:
        row = np.floor(y / height)
        column = np.floor((x - row * strain * height) / width)
        inside = x - column * width - row * strain * height, y - row * height
        inside = np.clip(inside[0], 0.0, width), np.clip(inside[1], 0.0, height)
        _, i, j, nx, ny = find_pairs(*inside, half, skin, width, height, strain * height)
        nx = (nx + column[i] - column[j]).astype(np.int32)
        ny = (ny + row[i] - row[j]).astype(np.int32)
    else:
        x0, y0 = float(x.min()), float(y.min())
        room = 2.0 * (reach + skin)
        _, i, j, nx, ny = find_pairs(
            x - x0, y - y0, half, skin, float(np.ptp(x)) + room, float(np.ptp(y)) + room, 0.0
        )
        nx, ny = np.zeros_like(nx), np.zeros_like(ny)
    vertex, segment, kind, image = sort_by_vertex(
        chains.chain, chains.closed, chains.start, chains.after, chains.radius,
        chains.rest_length, x, y, i, j, nx, ny, cell.size, strain, skin,
    )  # fmt: skip
    touch = chains.radius[chains.chain[vertex]] + chains.radius[chains.chain[segment]]
    count = len(vertex)
    lists = Lists(
        vertex, segment, kind, touch, image, np.zeros((2, count)), np.array([strain]),
        np.array([reach + skin + longest]), x.copy(), y.copy(),
        np.empty(count, np.int32), np.empty((3 * count, 4), np.int32), np.empty((3 * count, 7)),
        np.empty(3 * count, np.int32),
    )  # fmt: skip
    shift_images(lists, cell)
    return lists


@jit
def shift_images(lists: Lists, cell: Cell) -> None:
    """Write where the images are now that the segments of all pairs belong to."""
    width, height, strain = cell.size[0], cell.size[1], cell.strain[0]
    for c in range(lists.segment.shape[0]):
        nx, ny = lists.image[0, c], lists.image[1, c]
        lists.shift[0, c] = nx * width + ny * strain * height
        lists.shift[1, c] = ny * height
