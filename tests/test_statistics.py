"""Intervals over replicates: what they are, when they flag, and how often they cover."""

import math

import numpy as np
import pytest
from scipy import stats

from shear_sim.statistics import RESAMPLES, holm, interval, intervals


def rng(seed=1):
    return np.random.default_rng(seed)


def mean(values):
    return lambda counts: values[None] @ counts[0].T / counts[0].sum(axis=1)


def test_ten_replicates_or_more_are_bootstrapped_by_scipy():
    values = rng(3).lognormal(size=12)
    found = interval(values, resamples=2000, seed=7)
    expected = stats.bootstrap(
        (values,), np.mean, n_resamples=2000, method="BCa", rng=rng(7)
    ).confidence_interval
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), rel=1e-12)
    assert found.estimate == pytest.approx(values.mean(), rel=1e-15)
    assert (found.method, found.n, found.flag) == ("BCa", 12, None)


def test_groups_are_resampled_by_themselves():
    """A stratified bootstrap: scipy's own for several samples, of any statistic."""
    one, two = rng(3).lognormal(size=12), rng(4).lognormal(size=15)

    def ratio(a, b, axis):
        return np.log(a.mean(axis) / b.mean(axis))

    def ratio_of_counts(counts):
        return np.log(mean(one)(counts[:1]) / mean(two)(counts[1:]))

    [found] = intervals(ratio_of_counts, [12, 15], seed=5)
    expected = stats.bootstrap(
        (one, two), ratio, n_resamples=RESAMPLES, rng=rng(5)
    ).confidence_interval
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), rel=1e-9)


def test_many_quantities_share_their_resamples():
    values = rng(3).lognormal(size=(5, 12))
    together = intervals(lambda c: values @ c[0].T / c[0].sum(axis=1), [12], seed=2)
    for one, row in zip(together, values, strict=True):
        alone = interval(row, seed=2)
        assert (one.low, one.high) == pytest.approx((alone.low, alone.high), rel=1e-12)


def test_fewer_are_student_with_the_jackknife_on_the_logarithm_where_all_are_positive():
    """The delta method: ln of the mean, with the standard error of the mean / the mean.

    The jackknife agrees with it to first order in the scatter.
    """
    values = 1000.0 + np.array([-3.0, 1.0, 2.0, -1.0, 1.0])
    found = interval(values, seed=1)
    half = stats.t.ppf(0.975, 4) * values.std(ddof=1) / np.sqrt(5) / values.mean()
    assert found.low == pytest.approx(values.mean() * np.exp(-half), rel=1e-6)
    assert found.high == pytest.approx(values.mean() * np.exp(half), rel=1e-6)
    assert found.method == "t_log"
    assert found.flag == "fewer than 10 replicates"


@pytest.mark.parametrize("lowest", [-1.0, 0.0])
def test_fewer_with_values_that_are_not_positive_are_student_as_they_are(lowest):
    """Although every mean of all but one is positive."""
    values = [lowest, 4.0, 5.0]
    found = interval(values, level=0.9, seed=1)
    expected = stats.ttest_1samp(values, 0.0).confidence_interval(0.9)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), rel=1e-12)
    assert found.method == "t"


@pytest.mark.parametrize("values", [[], [3.0]])
def test_one_replicate_bounds_nothing(values):
    found = interval(values, seed=1)
    assert math.isnan(found.low)
    assert math.isnan(found.high)
    assert (found.method, found.n) == ("none", len(values))
    assert found.flag == "fewer than two replicates"


@pytest.mark.parametrize("value", [-2.5, 0.1, 0.0])
@pytest.mark.parametrize("n", [2, 9, 10, 30])
def test_equal_replicates_give_zero_width_and_a_flag_and_no_warning(n, value):
    """0.1 is no binary fraction: means of it differ in the last bit."""
    found = interval([value] * n, seed=1)
    assert found.low == found.high == found.estimate == pytest.approx(value, rel=1e-15)
    assert (found.method, found.flag) == ("equal", "all replicates are equal")
    assert math.isnan(found.p_value(null=1.0))  # nothing scatters: there is no test
    assert found.p_value(null=found.estimate) == 1.0


@pytest.mark.parametrize("last", [1 + 1e-9, 2.0])
def test_eleven_equal_replicates_and_one_other_give_an_interval_without_a_warning(last):
    found = interval([1.0] * 11 + [last], seed=1)
    assert 1.0 <= found.low <= found.high <= last
    assert (found.flag is None) == (found.method == "BCa")


def test_a_value_beyond_the_range_in_some_resamples_gives_percentiles_and_says_so():
    """A mean above 5 is not measured there: as a yield strain beyond all amplitudes."""
    values = np.array([1.0] * 8 + [10.0] * 4)

    def censored(counts):
        means = mean(values)(counts)
        return np.where(means > 5.0, np.inf, means)

    [found] = intervals(censored, [12], seed=3)
    drawn = stats.binom(12, 1 / 3)
    assert found.undefined == pytest.approx(drawn.sf(5), abs=0.03)  # six tens or more of twelve
    assert found.method == "percentile"
    assert found.flag == f"{100 * found.undefined:.0f} % of the resamples have no finite value"
    assert found.low == pytest.approx(1 + 9 * drawn.ppf(0.025) / 12)
    assert found.high == math.inf


def test_a_value_that_does_not_exist_in_some_resamples_is_left_out_of_the_percentiles():
    values = np.array([1.0] * 6 + [3.0] * 6)

    def only_above_two(counts):
        means = mean(values)(counts)
        return np.where(means < 1.99, np.nan, means)

    [found] = intervals(only_above_two, [12], seed=3)
    assert found.undefined == pytest.approx(stats.binom(12, 0.5).cdf(5), abs=0.03)
    assert found.low == 2.0
    assert math.isfinite(found.high)


def test_a_value_that_hangs_on_one_of_few_replicates_has_no_interval():
    values = np.array([1.0, 1.0, 1.0, 9.0])

    def censored(counts):
        means = mean(values)(counts)
        return np.where(means < 2.0, -np.inf, means)

    [found] = intervals(censored, [4], seed=1)
    assert (found.estimate, found.method) == (3.0, "none")
    assert found.undefined == 0.25
    assert "undefined without some of them" in found.flag


@pytest.mark.parametrize("values", [[1.0, math.nan], [1.0, math.inf], [[1.0, 2.0]]])
def test_values_that_are_none_are_refused(values):
    with pytest.raises(ValueError, match="one finite value per replicate"):
        interval(values, seed=1)


@pytest.mark.parametrize("level", [0.0, 1.0, 95.0])
def test_a_level_in_percent_is_refused(level):
    with pytest.raises(ValueError, match=r"between 0 and 1, as in 0\.95"):
        interval([1.0, 2.0], level=level, seed=1)


def test_the_same_seed_gives_the_same_interval():
    values = rng(3).normal(size=20)
    assert interval(values, seed=5) == interval(values, seed=5)
    assert interval(values, seed=5) != interval(values, seed=6)


def test_p_values_are_those_of_student():
    """Paired: of the differences. Independent: Welch's error, freedom of the smaller group."""
    one, two = rng(3).normal(size=12), 1.0 + rng(4).normal(size=9)
    difference = interval(one[:9] - two, seed=1)
    assert difference.p_value() == pytest.approx(stats.ttest_rel(one[:9], two).pvalue, rel=1e-9)

    def apart(counts):
        return mean(one)(counts[:1]) - mean(two)(counts[1:])

    [found] = intervals(apart, [12, 9], seed=1)
    error = np.hypot(stats.sem(one), stats.sem(two))
    expected = stats.t(8, loc=one.mean() - two.mean(), scale=error)
    assert found.p_value() == pytest.approx(2 * min(expected.cdf(0), expected.sf(0)), rel=1e-9)
    assert found.method == "t"  # of the smaller group
    assert (found.low, found.high) == pytest.approx(expected.interval(0.95), rel=1e-9)


def test_p_values_know_of_values_that_jump():
    """1 where 12 or more of 16 coins show heads: leaving one of 8 and 8 out never decides that."""
    values = np.array([0.0] * 8 + [1.0] * 8)
    [found] = intervals(lambda c: np.where(mean(values)(c) > 0.7, 1.0, 0.0), [16], seed=1)
    share = stats.binom(16, 0.5).sf(11)
    assert found.error == pytest.approx(np.sqrt(share * (1 - share)), abs=0.03)


def test_holm():
    """By hand: 0.005 x 4, 0.01 x 3, then 0.03 x 2, and never less than the one before."""
    found = holm([0.01, 0.04, math.nan, 0.03, 0.005])
    assert found == pytest.approx([0.03, 0.06, math.nan, 0.06, 0.02], nan_ok=True)
    assert holm([0.6, 0.9]).tolist() == [1.0, 1.0]
    assert len(holm([])) == 0


def test_student_intervals_cover_as_often_as_they_say():
    """Of normal values exactly: 2000 draws of 6.

    The limits are the binomial quantiles at 1e-6: so often another seed would fail a right one.
    """
    draws = 2000
    low, high = stats.binom.ppf([1e-6, 1 - 1e-6], draws, 0.95)
    found = [interval(x, seed=1) for x in rng(11).normal(size=(draws, 6))]
    assert low <= sum(i.low <= 0 <= i.high for i in found) <= high
