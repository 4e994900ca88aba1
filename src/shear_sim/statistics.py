"""Intervals over replicates, of means and of whatever is computed from means.

The unit of replication is the simulation, one packing with one seed. Records and cycles of one run
are correlated: they are reduced to a few numbers first, and only the runs are resampled.

A resample is how often each replicate was drawn. A statistic gets these counts and returns its
values, for thousands of resamples at once; a mean is one matrix product. Groups of replicates are
resampled independently of each other (a stratified bootstrap). Replicates that belong together over
many points, because they start from the same packing, are one group: they are drawn or left out
with all their points (a cluster bootstrap).
"""

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
#: From the counts (K, n) of each group to the values (Q, K) of Q quantities in K resamples. A
#: value may be ±inf (beyond what was measured) or nan (does not exist).
Statistic = Callable[[Sequence[FloatArray]], FloatArray]

LEVEL = 0.95
RESAMPLES = 2999  # 2,000 or more keep the noise of the bounds at 3 % of their distance

#: Below this no bootstrap knows the tails: at 6 replicates of a lognormal it covers 85 % for 95 %.
SMALLEST_BOOTSTRAP = 10

#: Below this not even Student's t bounds much: its quantiles are 12.7 and 4.3, against 2.0.
FEWEST = 4

_ROUNDING = 1e-12  # relative spread of resamples that is rounding, not scatter


@dataclass(frozen=True)
class Interval:
    """An estimate, its confidence interval, and how that was made.

    ``method`` is ``BCa`` (bias-corrected and accelerated bootstrap), ``percentile`` (bootstrap),
    ``t`` (Student, with the jackknife's standard error: for a mean, the usual one), ``t_log`` (the
    same for the logarithm of the estimate), ``equal`` (no resample differs: no width) or ``none``
    (bounds are nan). ``n`` is the number of replicates, the smallest of all groups. ``flag`` says
    what weakens the interval, or is None. ``undefined`` is the fraction of resamples in which the
    value does not exist or lies beyond what was measured. ``error`` is the standard error: the
    jackknife's, or the scatter of the resamples where that is larger.
    """

    estimate: float
    low: float
    high: float
    method: str
    n: int
    flag: str | None
    undefined: float = 0.0
    error: float = math.nan

    def p_value(self, null: float = 0.0) -> float:
        """Return the two-sided p-value of ``null`` by Student's t with the standard error.

        Not by turning the bootstrap round: a dozen replicates say nothing of its far tails, and
        those are what a correction for many tests asks for. The degrees of freedom are those of the
        smallest group: an effective number for all groups together (Welch's) is too large where
        the value hangs on few of them. Replicates without any scatter allow no test: nan, or 1
        where they are the null.
        """
        from scipy.special import stdtr

        if not math.isfinite(self.error):
            return math.nan
        if self.error == 0.0:
            return 1.0 if self.estimate == null else math.nan
        return float(2.0 * stdtr(self.n - 1, -abs(self.estimate - null) / self.error))


def interval(
    values: ArrayLike,
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
    seed: int,
) -> Interval:
    """Return the interval of the mean of one group of values; see `intervals`.

    Parameters
    ----------
    values : (n,)
        One value per replicate.
    level, resamples, seed
        As in `intervals`.

    Raises
    ------
    ValueError
        If a value is not finite, or the level is not between 0 and 1.
    """
    sample = np.asarray(values, dtype=np.float64)
    if sample.ndim != 1 or not np.isfinite(sample).all():
        msg = f"an interval needs one finite value per replicate, got {sample}"
        raise ValueError(msg)
    if len(sample) == 0:
        return Interval(math.nan, math.nan, math.nan, "none", 0, "fewer than two replicates")
    [found] = intervals(
        lambda counts: sample[None] @ counts[0].T / counts[0].sum(axis=1),
        [len(sample)],
        positive=np.array([(sample > 0).all()]),
        level=level,
        resamples=resamples,
        seed=seed,
    )
    return found


def intervals(
    statistic: Statistic,
    sizes: Sequence[int],
    *,
    n: int | None = None,
    positive: NDArray[np.bool_] | None = None,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
    seed: int,
) -> list[Interval]:
    """Return the intervals of all quantities of a statistic.

    Ten replicates or more: `scipy.stats.bootstrap`, BCa (Efron, J. Am. Stat. Assoc. 82, 171
    (1987)); percentiles where BCa is undefined or some resamples have no finite value. Fewer:
    Student's t with the jackknife's standard error, on the logarithm where values are positive.

    Parameters
    ----------
    statistic : Statistic
        From counts (K, n) per group to values (Q, K).
    sizes : sequence of int
        Replicates of each group.
    n : int, optional
        Replicates that count, where fewer than ``sizes`` say hold values; default: the smallest
        size.
    positive : (Q,) of bool, optional
        Quantities whose logarithm may be taken; default: where all leave-one-out values are
        positive.
    level : float
        Confidence level.
    resamples : int
        Of the bootstrap.
    seed : int
        Of the bootstrap. The same seed draws the same replicates for all statistics of groups of
        the same sizes, and gives them the same intervals at every call.

    Raises
    ------
    ValueError
        If the level is not between 0 and 1.
    """
    if not 0 < level < 1:
        msg = f"level = {level:g} must be between 0 and 1, as in 0.95"
        raise ValueError(msg)
    counted = min(sizes, default=0) if n is None else n
    estimate, one_out = _jackknife(statistic, sizes)
    if counted < 2:
        few = "fewer than two replicates"
        return [Interval(float(e), math.nan, math.nan, "none", counted, few) for e in estimate]
    errors = _jackknife_error(one_out, sizes)
    if counted < SMALLEST_BOOTSTRAP:
        found = _student(estimate, one_out, sizes, counted, positive, level)
    else:
        found, scatter = _bootstrap(statistic, sizes, counted, estimate, level, resamples, seed)
        # Leaving one out is too small a step to see a landmark jump from one amplitude to another.
        errors = np.maximum(errors, scatter)
    return [
        # Equal replicates differ by rounding at most, and that is no error.
        Interval(*f, error=0.0 if f[3] == "equal" else float(e))
        for f, e in zip(found, errors, strict=True)
    ]


_Found = tuple[float, float, float, str, int, "str | None", float]


def _jackknife(statistic: Statistic, sizes: Sequence[int]) -> tuple[FloatArray, list[FloatArray]]:
    """Return the values (Q,), and those (Q, n) of each group with each replicate left out."""
    ends = np.cumsum([1, *sizes])
    counts = [np.ones((ends[-1], size)) for size in sizes]
    for drawn, start, end in zip(counts, ends[:-1], ends[1:], strict=True):
        drawn[start:end] -= np.eye(end - start)
    with np.errstate(invalid="ignore", divide="ignore"):  # a group of one, without it
        values = statistic(counts)
    return values[:, 0], np.split(values[:, 1:], ends[1:-1] - 1, axis=1)


def _jackknife_error(one_out: Sequence[FloatArray], sizes: Sequence[int]) -> FloatArray:
    """Return the standard errors (Q,)."""
    with np.errstate(invalid="ignore"):
        variances = [
            (size - 1) / size * ((values - values.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
            for values, size in zip(one_out, sizes, strict=True)
        ]
        error: FloatArray = np.sqrt(np.sum(variances, axis=0))
        return error


def _student(
    estimate: FloatArray,
    one_out: Sequence[FloatArray],
    sizes: Sequence[int],
    counted: int,
    positive: NDArray[np.bool_] | None,
    level: float,
) -> list[_Found]:
    from scipy.special import stdtrit  # far quicker to import than scipy.stats

    everything = np.concatenate([estimate[:, None], *one_out], axis=1)
    finite = np.isfinite(everything).all(axis=1)
    undefined = 1.0 - np.isfinite(everything[:, 1:]).mean(axis=1)
    allowed = (everything > 0).all(axis=1)
    logs = finite & allowed & (True if positive is None else positive)
    # Taken one by one: in a sum of logarithms a single value that is not positive spoils the rest.
    usable = np.where(logs[:, None], everything, 1.0)
    errors = _jackknife_error(one_out, sizes)
    splits = np.cumsum([1, *[values.shape[1] for values in one_out]])[:-1]
    log_errors = _jackknife_error(np.split(np.log(usable), splits, axis=1)[1:], sizes)
    quantile = float(stdtrit(counted - 1, 0.5 + level / 2))
    few = f"fewer than {SMALLEST_BOOTSTRAP} replicates"
    if counted < FEWEST:
        few = f"fewer than {FEWEST} replicates: no more than a guess"
    found: list[_Found] = []
    for q, value in enumerate(estimate.tolist()):
        if not finite[q]:
            why = f"{few}, and undefined without some of them"
            found.append((value, math.nan, math.nan, "none", counted, why, float(undefined[q])))
            continue
        spread = float(np.ptp(everything[q]))
        if spread <= _ROUNDING * float(np.abs(everything[q]).max()):
            found.append((value, value, value, "equal", counted, "all replicates are equal", 0.0))
        elif logs[q]:
            half = quantile * float(log_errors[q])
            # np.exp, unlike math.exp, may overflow: values decades apart do bound nothing above.
            with np.errstate(over="ignore"):
                low, high = float(value * np.exp(-half)), float(value * np.exp(half))
            found.append((value, low, high, "t_log", counted, few, 0.0))
        else:
            half = quantile * float(errors[q])
            found.append((value, value - half, value + half, "t", counted, few, 0.0))
    return found


def _bootstrap(
    statistic: Statistic,
    sizes: Sequence[int],
    counted: int,
    estimate: FloatArray,
    level: float,
    resamples: int,
    seed: int,
) -> tuple[list[_Found], FloatArray]:
    """Return what is found, and the standard deviations (Q,) of the finite resampled values."""
    from scipy import stats

    def of_picks(*picks: NDArray[np.intp], axis: int) -> FloatArray:
        assert axis == -1  # noqa: S101 - scipy moves the replicates there before it calls
        values = statistic([_counts(p, size) for p, size in zip(picks, sizes, strict=True)])
        return values[:, 0] if picks[0].ndim == 1 else values

    # Where BCa is 0/0 (values equal but for rounding, or infinite) its bounds are nan.
    with warnings.catch_warnings(), np.errstate(invalid="ignore", divide="ignore"):
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)
        result = stats.bootstrap(
            [np.arange(size) for size in sizes],
            of_picks,
            n_resamples=resamples,
            vectorized=True,
            confidence_level=level,
            method="BCa",
            rng=np.random.default_rng(seed),
        )
    lows, highs = (np.asarray(b, dtype=np.float64) for b in result.confidence_interval)
    drawn: FloatArray = result.bootstrap_distribution
    finite = np.isfinite(drawn)
    found: list[_Found] = []
    for q, value in enumerate(estimate.tolist()):
        undefined = 1.0 - float(finite[q].mean())
        if math.isnan(value):
            found.append((value, math.nan, math.nan, "none", counted, "no estimate", undefined))
            continue
        if undefined == 0.0 and math.isfinite(value):
            spread, scale = float(np.ptp(drawn[q])), float(np.abs(drawn[q]).max())
            if spread <= _ROUNDING * scale:
                equal = "all replicates are equal"
                found.append((value, value, value, "equal", counted, equal, 0.0))
                continue
            if math.isfinite(lows[q]) and math.isfinite(highs[q]):
                low, high = float(lows[q]), float(highs[q])
                found.append((value, low, high, "BCa", counted, None, 0.0))
                continue
            why = "BCa is undefined for these replicates"
        else:
            share = "under 1 %" if undefined < 0.01 else f"{100 * undefined:.0f} %"
            why = f"{share} of the resamples have no finite value"
        # Sorted with the infinite ones at the ends, not interpolated with them.
        known = drawn[q][~np.isnan(drawn[q])]
        if len(known) == 0:
            found.append((value, math.nan, math.nan, "none", counted, why, undefined))
            continue
        ends = [(1 - level) / 2, (1 + level) / 2]
        low, high = np.quantile(known, ends, method="inverted_cdf").tolist()
        found.append((value, low, high, "percentile", counted, why, undefined))
    return found, _scatter(drawn, finite)


def _scatter(drawn: FloatArray, finite: NDArray[np.bool_]) -> FloatArray:
    """Return the standard deviations (Q,) of the finite ones of (Q, K) resampled values."""
    count = np.maximum(finite.sum(axis=1, keepdims=True), 1)
    values = np.where(finite, drawn, 0.0)
    aside = np.where(finite, values - values.sum(axis=1, keepdims=True) / count, 0.0)
    scatter: FloatArray = np.sqrt((aside**2).sum(axis=1) / count[:, 0])
    return scatter


def _counts(picks: NDArray[np.intp], size: int) -> FloatArray:
    """Return how often each of ``size`` replicates is among the picks (..., m)."""
    rows = picks.reshape(-1, picks.shape[-1])
    places = rows + size * np.arange(len(rows))[:, None]
    counts = np.bincount(places.ravel(), minlength=size * len(rows))
    return counts.reshape(len(rows), size).astype(np.float64)


def holm(p_values: ArrayLike) -> FloatArray:
    """Return p-values corrected for their number: Holm, Scand. J. Stat. 6, 65 (1979).

    The chance of one or more false findings among them stays below any limit set on the result.
    Tests without a p-value (nan) do not count.

    Parameters
    ----------
    p_values : (m,)
        Of one family of tests.
    """
    raw = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(raw)[: np.isfinite(raw).sum()]  # nan last
    steps = raw[order] * np.arange(len(order), 0, -1)
    corrected = np.full(len(raw), math.nan)
    corrected[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return corrected
