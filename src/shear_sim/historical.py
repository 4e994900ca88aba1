r"""The historical ways to read G′ and G″ from a series, by name, for comparison with old numbers.

All of them project a stress series τ(t) on the phase of the oscillation over the whole periods
after the first,

.. math::
    G' = \frac{1}{A} \frac{Σ τ \sin θ}{Σ \sin^2 θ}, \qquad
    G'' = \frac{1}{A} \frac{Σ τ \cos θ}{Σ \cos^2 θ},

and differ in what they do to τ and θ first:

``r-compat``
    The published analysis in R. θ = 0 at the first sample of the window. Steps of more than 15 % of
    the range of the window count as jumps: each is replaced by the slope before it, and the tail is
    shifted. Drift stays in, and changes G' by −s/(π f A).
``header-compat``
    The program particleShear itself: what its output files print. θ = 2π(t f − pre_periods). A
    drift s, from the last third of the rest before to the first third of the rest after, is meant
    to be taken off and is added instead: −2s/(π f A) in G' against ``detrended``.
``no-detrend``
    The same phase, and nothing done to τ: half-way between the two.
``detrended``
    The same phase, with the drift taken off: what ``header-compat`` meant to do.

None is better than the joint fit of `shear_sim.rheology`; each has the faults of its original, on
purpose. Windows compare times with the edges as the originals do, without tolerance: the last bit
of a time decides whether a sample at an edge counts.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.rheology import jumps

FloatArray = NDArray[np.float64]

ESTIMATORS = ("r-compat", "header-compat", "no-detrend", "detrended")


@dataclass(frozen=True)
class Estimate:
    """G' and G'' of one series [Pa], and what was done to it.

    ``drift`` is the slope between the two rests [Pa/s], of which ``header-compat`` adds the line
    and ``detrended`` takes it off; None where it is not looked at. ``jumps`` counts the steps over
    the threshold and ``largest_jump`` is the largest of them [Pa], 0 without any; None where jumps
    are not looked for. ``rows`` is the number of samples of the window.
    """

    storage: float
    loss: float
    drift: float | None
    jumps: int | None
    largest_jump: float | None
    rows: int


def estimate(
    name: str, time: FloatArray, stress: FloatArray, protocol: Mapping[str, Any]
) -> Estimate:
    """Return G' and G'' of a shear stress series by one of the historical estimators.

    Parameters
    ----------
    name : str
        One of `ESTIMATORS`.
    time : (R,)
        Times of the samples, increasing, 0 at the start of the first rest [s].
    stress : (R,)
        Shear stress τ = −σ_xy [Pa].
    protocol : mapping
        The ``protocol`` block of the run's summary: ``strain_amplitude`` [-], ``periods`` and
        ``period``, ``shear_start``, ``shear_end``, ``end`` [s]. An imported run has ``frequency``
        [Hz], ``pre_periods`` and ``post_periods`` there too, as its program used them.

    Raises
    ------
    ValueError
        If there is no such estimator, if the shear is not oscillatory, if too few samples lie where
        it needs them, or if a stress is not finite.
    """
    if name not in ESTIMATORS:
        msg = f"no estimator {name!r}: one of {', '.join(ESTIMATORS)}"
        raise ValueError(msg)
    if protocol["kind"] != "oscillatory":
        msg = f"the shear is {protocol['kind']}: only an oscillation has G' and G''"
        raise ValueError(msg)
    timing = _Timing.of(protocol)
    frequency, pre_periods, periods = timing.frequency, timing.pre_periods, timing.periods
    start, end = pre_periods / frequency, (pre_periods + periods) / frequency
    # Of one and a half periods R leaves the first out; the program does so from two on.
    more = periods > 1 if name == "r-compat" else periods >= 2
    first = (pre_periods + 1) / frequency if more else start
    window = (time >= first) & (time <= end)
    if window.sum() < 3:
        msg = f"{window.sum()} samples between {first:g} and {end:g} s, where G' and G'' are read"
        raise ValueError(msg)
    if not np.isfinite(stress).all():
        msg = f"the shear stress is not finite at sample {np.argmin(np.isfinite(stress))}"
        raise ValueError(msg)
    used = stress[window]
    drift: float | None = None
    found: int | None = None
    largest: float | None = None
    if name == "r-compat":
        used, heights = without_jumps(used)
        angle = 2 * np.pi * frequency * (time[window] - time[window][0])
        found, largest = len(heights), float(np.abs(heights).max(initial=0.0))
    else:
        angle = 2 * np.pi * (time[window] * frequency - pre_periods)
        if name != "no-detrend":
            drift = _drift(time, stress, timing)
            sign = 1.0 if name == "header-compat" else -1.0
            used = used + sign * drift * (time[window] - start)
    sine, cosine = np.sin(angle), np.cos(angle)
    amplitude = protocol["strain_amplitude"]
    storage = float((used * sine).sum() / (sine**2).sum() / amplitude)
    loss = float((used * cosine).sum() / (cosine**2).sum() / amplitude)
    return Estimate(storage, loss, drift, found, largest, int(window.sum()))


def without_jumps(stress: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a series without its jumps, as the analysis in R took them out, and their heights.

    Steps over 15 % of the range are jumps. Each is replaced by the step before it (corrected
    itself, if that is a jump too) and everything after is shifted. One at the very first step
    stays.

    Parameters
    ----------
    stress : (R,)
        Shear stress of the window [Pa].

    Returns
    -------
    corrected : (R,)
        The series [Pa].
    heights : (J,)
        The steps that were found, signed, the first one included [Pa].
    """
    places, _ = jumps(stress)
    steps = np.diff(stress)
    heights = steps[places]
    shift = np.zeros(len(stress))
    for place in places.tolist():
        if place > 0:
            shift[place + 1 :] -= steps[place] - steps[place - 1]
            steps[place] = steps[place - 1]
    return stress + shift, heights


@dataclass(frozen=True)
class _Timing:
    """f [Hz] and the rest, oscillation and rest in periods: what the edges are computed from."""

    frequency: float
    pre_periods: float
    periods: float
    post_periods: float

    @classmethod
    def of(cls, protocol: Mapping[str, Any]) -> "_Timing":
        period, start = protocol["period"], protocol["shear_start"]
        rest = protocol["end"] - protocol["shear_end"]
        return cls(
            protocol.get("frequency", 1 / period),
            protocol.get("pre_periods", start / period),
            protocol["periods"],
            protocol.get("post_periods", rest / period),
        )


def _drift(time: FloatArray, stress: FloatArray, timing: _Timing) -> float:
    """Return the slope from the rest before to the rest after [Pa/s].

    Between the means over the last third of the first and the first third of the last; without a
    rest the first (last) sample takes its place.
    """
    frequency, pre, post = timing.frequency, timing.pre_periods, timing.post_periods
    before, after = np.zeros(len(time), bool), np.zeros(len(time), bool)
    if pre > 0:
        before = (time >= 2 * pre / 3 / frequency) & (time < pre / frequency)
    else:
        before[0] = True
    if post > 0:
        end = pre + timing.periods
        after = (time > end / frequency) & (time <= (end + post / 3) / frequency)
    else:
        after[-1] = True
    if not (before.any() and after.any()):
        where = "last third of the first rest" if not before.any() else "first third of the last"
        msg = f"no sample in the {where}: no drift can be read"
        raise ValueError(msg)
    rise = stress[after].mean() - stress[before].mean()
    return float(rise / (time[after].mean() - time[before].mean()))
