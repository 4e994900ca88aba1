"""Pairs of discs that may touch: who is near whom, and in which order contacts are eliminated."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit


class Pairs(NamedTuple):
    """Candidate contacts, in the order of elimination; arrays of shape (P,)."""

    i: Ints
    j: Ints
    nx: Ints  # image of j that is near i
    ny: Ints
    distance: Floats  # D = a_i + a_j

    def take(self, which: Ints) -> "Pairs":
        """Return some of the pairs, in the order given."""
        return Pairs(
            self.i[which], self.j[which], self.nx[which], self.ny[which], self.distance[which]
        )


@jit
def separations(
    x: Floats, y: Floats, width: float, height: float, offset: float, i: Ints, j: Ints, nx: Ints,
    ny: Ints, distance: Floats, rx: Floats, ry: Floats, gap: Floats,
) -> float:  # fmt: skip
    """Write the separations ``rx``, ``ry`` and gaps |r| − D of pairs (P,); return the least gap.

    Parameters
    ----------
    x, y : (N,)
        Positions.
    width, height, offset : float
        Cell edges, and displacement of the upper image in x.
    i, j, nx, ny, distance : (P,)
        See `Pairs`.
    """
    least = np.inf
    for c in range(i.shape[0]):
        dx = x[j[c]] - x[i[c]] + nx[c] * width + ny[c] * offset
        dy = y[j[c]] - y[i[c]] + ny[c] * height
        d = distance[c]
        rx[c] = dx
        ry[c] = dy
        # Not |r| − D itself: near contact that loses digits.
        gap[c] = (dx * dx + dy * dy - d * d) / (np.sqrt(dx * dx + dy * dy) + d)
        least = min(least, gap[c])
    return least


def elimination_order(
    x: NDArray[np.float64], y: NDArray[np.float64], i: NDArray[np.int32], j: NDArray[np.int32]
) -> NDArray[np.int64]:
    """Return the order of pairs (P,) in which the contact matrix fills in least.

    Geometric nested dissection: the discs are halved again and again across their longer side. Two
    pairs are coupled only if they share a disc, so the pairs that join the halves part those within
    one half from those within the other, and come last. Any subset of the pairs keeps this order.
    """
    n = len(x)
    depth = max(1, int(np.ceil(np.log2(max(n, 2)))))
    code = np.zeros(n, np.int64)  # of each disc: left 0, right 1 at every halving
    for _ in range(depth):
        first = np.flatnonzero(np.diff(np.sort(code), prepend=-1))
        members = np.argsort(code, kind="stable")
        group = np.repeat(np.arange(len(first)), np.diff(first, append=n))
        extent = [
            np.maximum.reduceat(z[members], first) - np.minimum.reduceat(z[members], first)
            for z in (x, y)
        ]
        across = np.where((extent[0] >= extent[1])[group], x[members], y[members])
        members = members[np.lexsort((across, group))]
        place = np.arange(n) - first[group]
        size = np.diff(first, append=n)[group]
        code[members] = 2 * code[members] + (2 * place >= size)
    # Digits: 0 left, 1 right, 2 between, the rest 0: sorted, halves come before what joins them.
    key = np.zeros(len(i), np.int64)
    joined = np.zeros(len(i), bool)
    for level in range(depth - 1, -1, -1):
        left, right = (code[i] >> level) & 1, (code[j] >> level) & 1
        digit = np.where(joined, 0, np.where(left != right, 2, left))
        joined |= left != right
        key = 3 * key + digit
    return np.argsort(key, kind="stable")
