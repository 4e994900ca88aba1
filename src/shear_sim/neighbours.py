"""Neighbour pairs in a sheared periodic cell, every image of every pair."""

import numpy as np
from numpy.typing import NDArray

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit

Flags = NDArray[np.bool_]
Whole = int | np.int64


@jit(inner=True)
def _search(
    x: Floats, y: Floats, radius: Floats, skin: float, width: float, height: float, offset: float,
    begin: Whole, end: Whole, some: bool | np.bool_, wanted: Flags, columns: int, rows: int,
    higher: int, reach: float, first: Ints, row_of: Ints, member: Ints, sx: Floats, sy: Floats,
    sr: Floats, found: Ints,
) -> int:  # fmt: skip
    """Write the pairs of `find_pairs`, in the order of their search; return how many, −1: no room.

    A function of its own, because arrays that never change are read faster.
    """
    cell_width, count = width / columns, 0
    for a in range(x.shape[0]):
        before, other = count, some and not begin <= a < end
        for up in range(higher + 1):
            # Whole numbers are divided by subtraction: the quotient is 0 or 1 but in tiny cells.
            row, ny = row_of[a] + up, 0
            while row >= rows:
                row -= rows
                ny += 1
            if other and not wanted[row]:
                continue
            shift = ny * offset
            x0, y0 = x[a] - shift, y[a] - ny * height
            # In its own row a disc looks to the right, and every pair is seen once.
            left = int(np.floor((x0 - (reach if up else 0.0)) / cell_width))
            right = int(np.floor((x0 + reach) / cell_width))
            nx = 0
            while left < 0:
                left += columns
                right += columns
                nx -= 1
            while left >= columns:
                left -= columns
                right -= columns
                nx += 1
            while right >= 0:
                low = first[row * columns + max(left, 0)]
                high = first[row * columns + min(right, columns - 1) + 1]
                xn = x0 - nx * width
                if count + high - low > found.shape[1]:
                    return -1
                # Half of the candidates are near, in no order: to write all of them and to go on
                # only where one is near costs less than to guess wrongly.
                for m in range(low, high):
                    dx, dy = sx[m] - xn, sy[m] - y0
                    near = radius[a] + sr[m] + skin
                    b = member[m]
                    once = (up > 0) | (dx > 0.0) | ((dx == 0.0) & (b > a))
                    found[0, count], found[1, count] = a, b
                    found[2, count], found[3, count] = nx, ny
                    count += (dx * dx + dy * dy < near * near) & once & (a != b)
                left -= columns
                right -= columns
                nx += 1
        if other:
            to = before
            for q in range(before, count):
                if begin <= found[1, q] < end:
                    for p in range(4):
                        found[p, to] = found[p, q]
                    to += 1
            count = to
    return count


@jit(nogil=True)
def find_pairs(
    x: Floats, y: Floats, radius: Floats, skin: float, width: float, height: float, offset: float,
    begin: Whole = 0, end: Whole = -1,
) -> tuple[Ints, Ints, Ints, Ints, Ints]:  # fmt: skip
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
    begin, end : int
        Only pairs of which one disc at least is among those from ``begin`` to before ``end``, in
        the order that they have among all pairs; all pairs if ``end`` is negative.

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
    # Low, narrow cells hold few discs out of reach; more cells than discs only cost memory.
    most = max(1, int(4.0 * np.sqrt(float(n))))
    columns = min(max(1, int(4.0 * width / reach)), most)
    rows = min(max(1, int(2.0 * height / reach)), most)
    cell_width = width / columns
    cell_height = height / rows
    higher = int(np.ceil(reach / cell_height))  # rows above a disc's own that it reaches

    cell = np.empty(n, np.int32)
    row_of = np.empty(n, np.int32)
    first = np.zeros(columns * rows + 1, np.int32)
    for a in range(n):
        row = min(int(y[a] / cell_height), rows - 1)
        row_of[a] = row
        cell[a] = row * columns + min(int(x[a] / cell_width), columns - 1)
        first[cell[a] + 1] += 1
    for c in range(columns * rows):
        first[c + 1] += first[c]
    # Discs sorted by cell: those of neighbouring columns follow each other in memory.
    fill = first[:-1].copy()
    member = np.empty(n, np.int32)
    sx, sy, sr = np.empty(n), np.empty(n), np.empty(n)
    for a in range(n):
        to = fill[cell[a]]
        fill[cell[a]] += 1
        member[to], sx[to], sy[to], sr[to] = a, x[a], y[a], radius[a]
    end = n if end < 0 else end
    some = begin > 0 or end < n
    wanted = np.zeros(rows, np.bool_)  # rows that hold discs of which all pairs are asked for
    if some:
        for a in range(begin, end):
            wanted[row_of[a]] = True

    capacity, count = 8 * n + 64, -1
    found = np.empty((4, 0), np.int32)
    while count < 0:
        found = np.empty((4, capacity), np.int32)
        count = _search(
            x, y, radius, skin, width, height, offset, begin, end, some, wanted, columns, rows,
            higher, reach, first, row_of, member, sx, sy, sr, found,
        )  # fmt: skip
        capacity *= 2

    per_disc = np.zeros(n + 1, np.int32)
    for q in range(count):
        a, b = found[0, q], found[1, q]
        if a > b:
            found[0, q], found[1, q] = b, a
            found[2, q], found[3, q] = -found[2, q], -found[3, q]
        per_disc[min(a, b) + 1] += 1
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
