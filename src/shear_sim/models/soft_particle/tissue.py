"""Tissues: cells that fill a box, each with half a shell to spare, and where their vertices are.

The cell of disc i in a Laguerre–Voronoi tessellation (power diagram) is the part of the box with

    |x − x_i|² − r_i² ≤ |x − x_j|² − r_j²  for all j                                        (SP.11)

Each of these is a half-plane. Moved in by half the thickness of a shell, it bounds the mid-line of
the ring that fills the cell: straight sides of neighbours then touch all along, without a gap.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

LEFT, RIGHT, FLOOR, LID = -1, -2, -3, -4  # what a side faces that faces no cell
SHORTEST = 0.5  # side of a cell / length of a segment, below which it is a corner


class Cell(NamedTuple):
    """A convex polygon, counter-clockwise."""

    corners: FloatArray  # (n, 2)
    facing: IndexArray  # (n,) cell beyond the side from corner k to the next, or LEFT to LID


def _clip(cell: Cell, normal: FloatArray, position: float, facing: int) -> Cell:
    """Return the part of ``cell`` with ``normal``·x ≤ ``position``; the cut faces ``facing``."""
    height = cell.corners @ normal - position
    inside = height <= 0.0
    if inside.all():
        return cell
    if not inside.any():
        return Cell(np.zeros((0, 2)), np.zeros(0, np.int64))
    n = len(inside)
    last = int(np.flatnonzero(inside & ~np.roll(inside, -1))[0])
    first = int(np.flatnonzero(inside & ~np.roll(inside, 1))[0])
    kept = (first + np.arange((last - first) % n + 1)) % n

    def crossing(k: int) -> FloatArray:
        after = (k + 1) % n
        share = height[k] / (height[k] - height[after])
        there = cell.corners[k] + share * (cell.corners[after] - cell.corners[k])
        return np.asarray(there)

    before = (first - 1) % n
    corners = np.vstack([cell.corners[kept], crossing(last), crossing(before)])
    return Cell(corners, np.append(cell.facing[kept], [facing, cell.facing[before]]))


def tessellation(
    x: FloatArray, y: FloatArray, radius: FloatArray, width: float, height: float, inset: float
) -> list[Cell]:
    """Return the cells (SP.11) of discs in a box, with all sides moved in by ``inset``.

    Parameters
    ----------
    x, y, radius : (N,)
        Discs [m]; the box has its corner at the origin.
    width, height, inset : float
        [m].

    Raises
    ------
    ValueError
        If nothing is left of a cell; says which.
    """
    box = np.array([[inset, inset], [width - inset, inset], [width - inset, height - inset],
                    [inset, height - inset]])  # fmt: skip
    cells = []
    for i in range(len(x)):
        away = np.column_stack([x - x[i], y - y[i]])
        distance = np.hypot(*away.T)
        distance[i] = np.inf
        # From x_i to the side towards j.
        reach = 0.5 * (distance + (radius[i] ** 2 - radius**2) / distance) - inset
        reach[i] = np.inf
        cell = Cell(box, np.array([FLOOR, RIGHT, LID, LEFT]))
        for j in map(int, np.argsort(reach)):
            corners = cell.corners - [x[i], y[i]]
            if len(corners) == 0 or reach[j] > np.hypot(*corners.T).max():
                break
            normal = away[j] / distance[j]
            cell = _clip(cell, normal, float(normal @ [x[i], y[i]] + reach[j]), j)
        if len(cell.corners) == 0:
            msg = (
                f"nothing is left of cell {i} within its shell: a thinner shell, or a smaller "
                "spread of sizes"
            )
            raise ValueError(msg)
        cells.append(cell)
    return cells


def outline(cell: Cell, segment: float) -> FloatArray:
    """Return the vertices (n, 2) of a ring along a cell, about a ``segment`` [m] apart.

    Sides shorter than half of that are left out; the corner that stays of their ends is that of the
    shorter neighbouring side, so that the longer one bends off at its end.

    Raises
    ------
    ValueError
        If all sides are shorter.
    """
    length = np.hypot(*(np.roll(cell.corners, -1, axis=0) - cell.corners).T)
    long = np.flatnonzero(length >= SHORTEST * segment)
    if len(long) < 3:
        msg = f"a cell has fewer than 3 sides of {SHORTEST * segment:g} m: shorter segments"
        raise ValueError(msg)
    n = len(length)
    points = []
    for before, side in zip(np.roll(long, 1), long, strict=True):
        kept = before + 1 if length[before] <= length[side] else side
        parts = max(1, round(float(length[side] / segment)))
        start, end = cell.corners[side], cell.corners[(side + 1) % n]
        points.append(cell.corners[kept % n][None])
        points.append(start + np.arange(1, parts)[:, None] / parts * (end - start))
    return np.concatenate(points)
