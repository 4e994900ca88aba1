"""The mean response of the replicates of some points, also of resampled ones."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.aggregate.response import Means

FloatArray = NDArray[np.float64]


class Replicates(NamedTuple):
    """The runs of one point: their replicate numbers (n,), and C values of each (n, C)."""

    number: NDArray[np.int64]
    values: FloatArray


class Ensemble:
    """Points whose replicates are resampled together, or each by itself.

    Where replicate r starts from the same random numbers at every point, it is drawn or left out
    at all points at once (``paired``): differences between points are then as sharp as they really
    are. Where every run has a packing of its own, the replicates of each point are drawn by
    themselves.

    Parameters
    ----------
    points : sequence of Replicates
        One or more runs of each point. A paired replicate may be missing at some of them: a mean is
        over those that are there.
    paired : bool
        Which of the two.

    Attributes
    ----------
    sizes : list of int
        Replicates of each group that is resampled, for `shear_sim.statistics.intervals`.
    n : int
        Runs of the point that has the fewest.
    """

    def __init__(self, points: Sequence[Replicates], *, paired: bool) -> None:
        self.n = min(len(point.number) for point in points)
        self._points = points
        self._paired = paired
        if not paired:
            self.sizes = [len(point.number) for point in points]
            return
        numbers = np.unique(np.concatenate([point.number for point in points]))
        self.sizes = [len(numbers)]
        self._sums = np.zeros((len(points), points[0].values.shape[1], len(numbers)))
        self._there = np.zeros((len(points), len(numbers)))
        for place, point in enumerate(points):
            columns = np.searchsorted(numbers, point.number)
            self._sums[place][:, columns] = point.values.T
            self._there[place, columns] = 1.0

    def means(self, counts: Sequence[FloatArray]) -> Means:
        """Return the mean values of P points in K resamples.

        Parameters
        ----------
        counts : sequence of (K, n)
            How often each replicate of each group was drawn. A point none of whose replicates was
            drawn has the mean nan.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            if not self._paired:
                drawn = np.array([each.sum(axis=1) for each in counts])
                pairs = zip(self._points, counts, strict=True)
                sums = np.array([_sums(point.values.T, each) for point, each in pairs])
                return Means(sums / drawn[:, None], drawn)
            [each] = counts
            points, contributions, n = self._sums.shape
            sums = _sums(self._sums.reshape(-1, n), each).reshape(points, contributions, -1)
            drawn = _sums(self._there, each)
            return Means(sums / drawn[:, None], drawn)


def _sums(values: FloatArray, drawn: FloatArray) -> FloatArray:
    """Return the sums (C, K) of values (C, n) that were drawn so often (K, n).

    Written with einsum, not as a matrix product: that goes through BLAS, whose last bits depend on
    the number of threads, and whose threads wait for each other on a busy machine.
    """
    found: FloatArray = np.einsum("cn,nk->ck", values, np.ascontiguousarray(drawn.T))
    return found
