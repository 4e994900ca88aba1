"""Intervals over replicates: what they are, when they flag, and how often they cover."""

import math

import numpy as np
import pytest
from scipy import stats

from shear_sim.statistics import interval


def rng(seed=1):
    return np.random.default_rng(seed)


def test_ten_replicates_or_more_are_bootstrapped_by_scipy():
    values = rng(3).lognormal(size=12)
    found = interval(values, resamples=2000, rng=rng())
    expected = stats.bootstrap(
        (values,), np.mean, n_resamples=2000, method="BCa", rng=rng()
    ).confidence_interval
    assert (found.low, found.high) == (expected.low, expected.high)
    assert (found.method, found.n, found.flag) == ("BCa", 12, None)


def test_fewer_are_student_on_logarithms_where_all_are_positive():
    values = np.array([1.0, 2.0, 4.0, 8.0])
    found = interval(values, rng=rng())
    half = stats.t.ppf(0.975, 3) * np.log(values).std(ddof=1) / 2
    middle = np.log(np.sqrt(8))  # of the logarithms of 1, 2, 4, 8
    assert found.low == pytest.approx(np.exp(middle - half), rel=1e-12)
    assert found.high == pytest.approx(np.exp(middle + half), rel=1e-12)
    assert found.method == "t_log"
    assert found.flag == "fewer than 10 replicates"


@pytest.mark.parametrize("lowest", [-1.0, 0.0])
def test_fewer_are_plain_student_where_one_is_not_positive(lowest):
    values = np.array([lowest, 2.0, 4.0, 8.0, 9.0])
    found = interval(values, level=0.9, rng=rng())
    expected = stats.ttest_1samp(values, 0.0).confidence_interval(0.9)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high), rel=1e-12)
    assert found.method == "t"


def test_median():
    values = rng(3).normal(size=15)
    found = interval(values, statistic="median", rng=rng())
    assert found.method == "percentile"
    assert found.low < np.median(values) < found.high
    assert {found.low, found.high} <= set(values)  # odd n: medians are values of the sample


@pytest.mark.parametrize("values", [[], [3.0]])
def test_one_replicate_bounds_nothing(values):
    found = interval(values, rng=rng())
    assert math.isnan(found.low)
    assert math.isnan(found.high)
    assert (found.method, found.n) == ("none", len(values))
    assert found.flag == "fewer than two replicates"


@pytest.mark.parametrize("n", [2, 9, 10, 30])
def test_equal_replicates_give_zero_width_and_a_flag_and_no_warning(n):
    found = interval([-2.5] * n, rng=rng())
    assert (found.low, found.high, found.method) == (-2.5, -2.5, "equal")
    assert found.flag == "all replicates are equal"


@pytest.mark.parametrize("last", [1 + 2e-16, 1 + 1e-14, 2.0])
def test_eleven_equal_replicates_and_one_other_give_an_interval_without_a_warning(last):
    """Rounding leaves BCa undefined; the method then says so."""
    found = interval([1.0] * 11 + [last], rng=rng())
    assert 1.0 <= found.low <= found.high <= last
    assert (found.flag is None) == (found.method == "BCa")


@pytest.mark.parametrize("values", [[1.0, math.nan], [1.0, math.inf], [[1.0, 2.0]]])
def test_values_that_are_none_are_refused(values):
    with pytest.raises(ValueError, match="one finite value per replicate"):
        interval(values, rng=rng())


@pytest.mark.parametrize("level", [0.0, 1.0, 95.0])
def test_a_level_in_percent_is_refused(level):
    with pytest.raises(ValueError, match=r"between 0 and 1, as in 0\.95"):
        interval([1.0, 2.0], level=level, rng=rng())


def test_the_same_seed_gives_the_same_interval():
    values = rng(3).normal(size=20)
    assert interval(values, rng=rng(5)) == interval(values, rng=rng(5))
    assert interval(values, rng=rng(5)) != interval(values, rng=rng(6))


def test_student_intervals_cover_as_often_as_they_say():
    """Exact for normal and (on logarithms) lognormal values: 2000 draws of 6, binomial.

    The limits are the quantiles at 1e-6: that is how often another seed would fail a right one.
    """
    draws = 2000
    low, high = stats.binom.ppf([1e-6, 1 - 1e-6], draws, 0.95)
    source = rng(11)
    plain = [interval(x, rng=source) for x in source.normal(size=(draws, 6))]
    logs = [interval(x, rng=source) for x in source.lognormal(sigma=0.4, size=(draws, 6))]
    assert {i.method for i in logs} == {"t_log"}
    assert low <= sum(i.low <= 0 <= i.high for i in plain) <= high
    assert low <= sum(i.low <= 1 <= i.high for i in logs) <= high  # the geometric mean


def test_bootstrap_intervals_cover_little_less_than_they_say():
    """BCa at n = 12: 0.91 of normal means are covered (measured with 4000 draws), not 0.95.

    The limits are binomial around 0.91 at 1e-6; below 0.81 or so the interval is broken.
    """
    draws = 400
    low, high = stats.binom.ppf([1e-6, 1 - 1e-6], draws, 0.91)
    source = rng(12)
    found = [interval(x, resamples=499, rng=source) for x in source.normal(size=(draws, 12))]
    assert {i.method for i in found} == {"BCa"}
    assert low <= sum(i.low <= 0 <= i.high for i in found) <= high
