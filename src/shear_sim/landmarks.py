r"""Landmarks of an amplitude sweep: plateau, softening, peak of G'', yield and what lies between.

Between two strain amplitudes a sweep is taken for a power law in \|G*\| and for linear in the loss
angle δ = atan2(G'', G'), both against ln A. Wherever tan δ stays the same these are straight lines
in a log-log plot of G' and G''; and they go on where G' falls through zero, where such a plot ends.
Slopes and peaks are fitted to points within a fixed part of a decade, so that a finer grid of
amplitudes does not change what they mean.

All functions take many curves at once, one per column, since a bootstrap asks for thousands.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SOFTENING, HALF_LOSS = 0.9, 0.5  # of the low-strain plateau of G'
ONSET = 0.01  # of I3/I1
PROMINENCE = 0.1  # by which a peak must stand above what follows
STEEPEST_FLAT = 0.05  # −d ln G'/d ln A that still counts as flat
WINDOW = 0.25  # half-width of the fits of slopes and peaks [decades]

_FLOOR = 1e-9  # of the plateau: what ln G' is cut at
_BISECTIONS = 12  # of a segment between two amplitudes


class Landmark(NamedTuple):
    """Where a landmark lies on each of K curves, each of shape (K,).

    ``strain`` is inf where it lies above all amplitudes measured, −inf where below, and nan where
    the curve has none; then the others are nan.
    """

    strain: FloatArray
    storage: FloatArray
    loss: FloatArray


def landmarks(
    strain: FloatArray, storage: FloatArray, loss: FloatArray, third: FloatArray
) -> dict[str, Landmark]:
    """Return the landmarks of many curves over the same strain amplitudes.

    Parameters
    ----------
    strain : (P,)
        Strain amplitudes, increasing, three or more [-].
    storage, loss : (P, K)
        G' and G'' [Pa].
    third : (P, K)
        I3/I1 [-].

    Returns
    -------
    dict
        ``low_strain_plateau``: the smallest amplitude. ``softening``, ``half_loss``: where G' first
        falls to 90 and 50 % of its value there. ``loss_peak``: the first maximum of G'' from which
        it falls by a tenth or more. ``soft_plateau``: the least steep decline of ln G' after a
        steeper one by a tenth of that one or more, before it becomes so steep again.
        ``first_crossover``, ``yield``: where G'' first and last rises above G'.
        ``nonlinearity_onset``: where I3/I1 first exceeds 1 %.

    Raises
    ------
    ValueError
        With fewer than three amplitudes, or amplitudes that do not increase.
    """
    if len(strain) < 3 or not (np.diff(strain) > 0).all():
        msg = f"landmarks need three or more increasing strain amplitudes, got {strain}"
        raise ValueError(msg)
    curves = _Curves(strain, storage, loss)
    plateau = storage[0]
    found = {
        "low_strain_plateau": Landmark(np.full(plateau.shape, strain[0]), plateau, loss[0]),
        "softening": curves.storage_falls_to(SOFTENING * plateau),
        "half_loss": curves.storage_falls_to(HALF_LOSS * plateau),
        "loss_peak": curves.loss_peak(),
        "soft_plateau": curves.soft_plateau(),
        "first_crossover": curves.crossover(last=False),
        "yield": curves.crossover(last=True),
        "nonlinearity_onset": curves.onset(third),
    }
    # A curve that lacks an amplitude has no landmarks at all.
    known = np.isfinite(storage).all(axis=0) & np.isfinite(loss).all(axis=0)
    return {
        name: Landmark(*(np.where(known, values, np.nan) for values in landmark))
        for name, landmark in found.items()
    }


class _Curves:
    """K curves of P amplitudes, as they run between the amplitudes."""

    def __init__(self, strain: FloatArray, storage: FloatArray, loss: FloatArray) -> None:
        self.x = np.log(strain)
        self.storage, self.loss = storage, loss
        with np.errstate(divide="ignore"):
            self.log_size = np.log(np.hypot(storage, loss))
        angle = np.arctan2(loss, storage)
        # Below −90° a noisy G'' of a G' < 0 is meant, not a half turn back.
        self.angle = np.where(angle < -np.pi / 2, angle + 2 * np.pi, angle)
        self.all = np.arange(storage.shape[1])

    def between(self, segment: NDArray[np.intp], part: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return G' and G'' of each curve at a part (0 to 1) of one of its segments."""
        size, angle = (before + part * (after - before) for before, after in self.ends(segment))
        return np.exp(size) * np.cos(angle), np.exp(size) * np.sin(angle)

    def ends(self, segment: NDArray[np.intp]) -> list[tuple[FloatArray, FloatArray]]:
        """Return ln |G*| and δ of each curve at the two ends of one of its segments."""
        return [
            (values[segment, self.all], values[segment + 1, self.all])
            for values in (self.log_size, self.angle)
        ]

    def at(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return G' and G'' of each curve at ln A."""
        segment = np.clip(np.searchsorted(self.x, x, side="right") - 1, 0, len(self.x) - 2)
        return self.between(segment, (x - self.x[segment]) / np.diff(self.x)[segment])

    def first(self, above: NDArray[np.bool_], *, last: bool = False) -> "_Step":
        """Return the first (or last) segment over which a condition (P, K) becomes true."""
        rises = ~above[:-1] & above[1:]
        segment = len(rises) - 1 - rises[::-1].argmax(0) if last else rises.argmax(0)
        outside = np.where(above[0], -np.inf, np.inf)
        if last:
            # True at the end means that it came true for good; only then is there a last time.
            outside = np.where(above[-1], -np.inf, np.inf)
            exists = rises.any(axis=0) & above[-1]
        else:
            exists = rises.any(axis=0) & ~above[0]
        return _Step(segment, exists, outside)

    def place(self, step: "_Step", part: FloatArray) -> Landmark:
        """Return the landmark at a part of the segments of ``step``."""
        part = np.where(step.exists, part, 0.0)
        x = self.x[step.segment] + part * np.diff(self.x)[step.segment]
        storage, loss = self.between(step.segment, part)
        return _where(step.exists, Landmark(np.exp(x), storage, loss), step.outside)

    def storage_falls_to(self, limit: FloatArray) -> Landmark:
        """Return where G' first falls to ``limit`` (K,); without a plateau of G' > 0, nowhere."""
        step = self.first(self.storage <= limit)
        (size, next_size), (angle, next_angle) = self.ends(step.segment)

        def storage(part: FloatArray) -> FloatArray:
            turned: FloatArray = np.cos(angle + part * (next_angle - angle))
            return np.exp(size + part * (next_size - size)) * turned

        part, width = np.zeros(len(limit)), 1.0
        for _ in range(_BISECTIONS):
            width /= 2
            part = np.where(storage(part + width) <= limit, part, part + width)
        with np.errstate(invalid="ignore", divide="ignore"):  # the rest is straight
            before, after = storage(part), storage(part + width)
            part += width * np.where(before > after, (before - limit) / (before - after), 0.0)
        found = self.place(step, part)
        return _where(limit > 0, found, np.full(len(limit), np.nan))

    def crossover(self, *, last: bool) -> Landmark:
        """Return where G'' first (or last) rises above G'."""
        step = self.first(self.angle >= np.pi / 4, last=last)
        before, after = (self.angle[step.segment + k, self.all] for k in (0, 1))
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.place(step, (np.pi / 4 - before) / (after - before))

    def onset(self, third: FloatArray) -> Landmark:
        """Return where I3/I1 first exceeds its limit, on log-log axes."""
        step = self.first(third >= ONSET)
        log = np.log(np.maximum(third, _FLOOR * ONSET))
        before, after = (log[step.segment + k, self.all] for k in (0, 1))
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.place(step, (np.log(ONSET) - before) / (after - before))

    def loss_peak(self) -> Landmark:
        """Return the first prominent maximum of G''."""
        highest = np.maximum.accumulate(self.loss, axis=0)
        peak, fallen = _first_peak(self.loss, PROMINENCE * np.abs(highest))
        exists = fallen & (peak > 0)
        outside = np.where(fallen, -np.inf, np.inf)
        log = np.log(np.maximum(self.loss, _FLOOR * np.abs(highest[-1])))
        x, top = _tops(self.x, log, np.where(exists, peak, 1))
        storage, _ = self.at(x)
        return _where(exists, Landmark(np.exp(x), storage, np.exp(top)), outside)

    def soft_plateau(self) -> Landmark:
        """Return the least steep decline of ln G' after a steeper one."""
        middle, steepness = self._steepness()
        steepness = np.where(steepness < STEEPEST_FLAT, 0.0, steepness)
        margin = PROMINENCE * np.maximum.accumulate(steepness, axis=0)
        peak, exists = _first_peak(steepness, margin)
        # From the fall on, the lowest steepness until it has risen again by as much.
        after = np.arange(len(middle))[:, None] > peak
        valley, risen = _first_peak(
            np.where(after, -steepness, -np.inf), margin[peak, self.all][None]
        )
        exists &= risen
        x, _ = _tops(middle, -steepness, np.where(exists, valley, 1))
        storage, loss = self.at(x)
        return _where(exists, Landmark(np.exp(x), storage, loss), np.full(len(x), np.nan))

    def _steepness(self) -> tuple[FloatArray, FloatArray]:
        """Return the middles (P − 1,) of the segments, and −d ln G'/d ln A there (P − 1, K).

        Slopes of straight lines through all points within the window, or through the two ends of
        a segment that is wider.
        """
        middle = (self.x[1:] + self.x[:-1]) / 2
        log = np.log(np.maximum(self.storage, _FLOOR * np.abs(self.storage[0])))
        slopes = np.zeros((len(middle), len(self.x)))
        for segment, centre in enumerate(middle.tolist()):
            near = np.abs(self.x - centre) <= WINDOW * np.log(10)
            near[segment : segment + 2] = True
            aside = self.x[near] - self.x[near].mean()
            slopes[segment, near] = aside / (aside**2).sum()
        return middle, -np.einsum("sp,pk->sk", slopes, log)


class _Step(NamedTuple):
    """The segments (K,) over which something becomes true, and where it never does."""

    segment: NDArray[np.intp]
    exists: NDArray[np.bool_]
    outside: FloatArray  # the strain that says why not


def _where(known: NDArray[np.bool_], landmark: Landmark, strain: FloatArray) -> Landmark:
    """Return the landmark where it is known, else nan at ``strain``."""
    return Landmark(
        np.where(known, landmark.strain, strain),
        np.where(known, landmark.storage, np.nan),
        np.where(known, landmark.loss, np.nan),
    )


def _tops(
    x: FloatArray, values: FloatArray, nodes: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Return place and height (K,) of the top of a parabola through (P, K) values near ``nodes``.

    Through all points within the window, or the two neighbours of the node.
    """
    place, height = np.empty(len(nodes)), np.empty(len(nodes))
    for node in np.unique(nodes).tolist():
        here = nodes == node
        near = np.abs(x - x[node]) <= WINDOW * np.log(10)
        near[max(node - 1, 0) : node + 2] = True
        aside = x[near] - x[node]
        fit = np.linalg.pinv(np.vander(aside, 3))
        bend, slope, level = np.einsum("cp,pk->ck", fit, values[near][:, here])
        # The parabola of a noisy top may open upwards, or top out beyond what it was fitted to.
        with np.errstate(invalid="ignore", divide="ignore"):
            top = np.where(bend < 0, -slope / (2 * bend), np.nan)
            inside = (top >= aside[0]) & (top <= aside[-1])
        top = np.where(inside, top, 0.0)
        place[here] = x[node] + top
        height[here] = np.where(inside, level + slope * top + bend * top**2, values[node, here])
    return place, height


def _first_peak(
    values: FloatArray, margin: FloatArray
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the first maximum (K,) of (P, K) values from which they fall by ``margin``.

    And whether they do; where not, it is the maximum of all.
    """
    highest = np.maximum.accumulate(values, axis=0)
    with np.errstate(invalid="ignore"):  # −inf − −inf, before there is anything
        fallen = highest - values > margin
    found: NDArray[np.bool_] = np.asarray(fallen.any(axis=0))
    end = np.where(found, fallen.argmax(axis=0), len(values))
    before = np.arange(len(values))[:, None] < end
    return np.where(before, values, -np.inf).argmax(axis=0), found
