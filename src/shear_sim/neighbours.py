"""Neighbour pairs in a sheared periodic cell, every image of every pair."""

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit


@jit
def find_pairs(
    x: Floats, y: Floats, radius: Floats, skin: float, width: float, height: float, offset: float
) -> tuple[Ints, Ints, Ints, Ints, Ints]:
    """Return all pairs of discs closer than the sum of their radii plus ``skin``.

    Parameters
    ----------
    x, y : (N,)
        Positions inside the cell, 0 ≤ y < height, 0 ≤ x < width [m].
    radius : (N,)
        Radii [m].
    skin : float
        Added to every contact distance [m].
    width, height, offset : float
        Cell edges and displacement of the upper image in x [m].

    Returns
    -------
    start : (N + 1,)
        Pairs start[i]:start[i + 1] belong to disc i.
    i, j : (P,)
        Discs of each pair, i < j, sorted by i.
    nx, ny : (P,)
        The image of j that is near i.
    """
    n = x.shape[0]
    reach = 2.0 * radius.max() + skin
    columns = max(1, int(width / reach))
    rows = max(1, int(height / reach))
    # More cells than discs only cost memory.
    columns = min(columns, max(1, int(np.sqrt(float(n)) * 2.0) + 1))
    rows = min(rows, max(1, int(np.sqrt(float(n)) * 2.0) + 1))
    cell_width = width / columns
    cell_height = height / rows

    column = np.empty(n, np.int32)
    row = np.empty(n, np.int32)
    first = np.zeros(columns * rows + 1, np.int32)
    for a in range(n):
        column[a] = min(int(x[a] / cell_width), columns - 1)
        row[a] = min(int(y[a] / cell_height), rows - 1)
        first[row[a] * columns + column[a] + 1] += 1
    for c in range(columns * rows):
        first[c + 1] += first[c]
    fill = first[:-1].copy()
    member = np.empty(n, np.int32)
    for a in range(n):
        c = row[a] * columns + column[a]
        member[fill[c]] = a
        fill[c] += 1

    capacity = 8 * n + 64
    found = np.empty((4, capacity), np.int32)
    count = 0
    per_disc = np.zeros(n + 1, np.int32)
    for a in range(n):
        for up in range(2):
            ny = 0
            r = row[a] + up
            if r == rows:
                r = 0
                ny = 1
            shift = ny * offset
            left = int(np.floor((x[a] - reach - shift) / cell_width))
            right = int(np.floor((x[a] + reach - shift) / cell_width))
            for c in range(left, right + 1):
                nx = c // columns
                cc = r * columns + c - nx * columns
                for m in range(first[cc], first[cc + 1]):
                    b = member[m]
                    # In its own row a pair is seen from both sides, and once is enough.
                    if a == b or (up == 0 and (nx < 0 or (nx == 0 and b < a))):
                        continue
                    dx = x[b] - x[a] + nx * width + shift
                    dy = y[b] - y[a] + ny * height
                    near = radius[a] + radius[b] + skin
                    if dx * dx + dy * dy >= near * near:
                        continue
                    if count == capacity:
                        capacity *= 2
                        larger = np.empty((4, capacity), np.int32)
                        for q in range(4):  # a slice takes seconds to compile
                            for old in range(count):
                                larger[q, old] = found[q, old]
                        found = larger
                    if a < b:
                        found[0, count] = a
                        found[1, count] = b
                        found[2, count] = nx
                        found[3, count] = ny
                    else:
                        found[0, count] = b
                        found[1, count] = a
                        found[2, count] = -nx
                        found[3, count] = -ny
                    per_disc[found[0, count] + 1] += 1
                    count += 1

    for a in range(n):
        per_disc[a + 1] += per_disc[a]
    fill = per_disc[:-1].copy()
    i = np.empty(count, np.int32)
    j = np.empty(count, np.int32)
    image_x = np.empty(count, np.int32)
    image_y = np.empty(count, np.int32)
    for q in range(count):
        to = fill[found[0, q]]
        fill[found[0, q]] += 1
        i[to] = found[0, q]
        j[to] = found[1, q]
        image_x[to] = found[2, q]
        image_y[to] = found[3, q]
    return per_disc, i, j, image_x, image_y
