"""A small part of analysis/interval_coverage.py: how often intervals and p-values are right."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

PROGRAM = runpy.run_path(str(Path(__file__).parents[1] / "analysis" / "interval_coverage.py"))
STUDIES = 25
#: Coverage found by the program, for t (6 replicates) and BCa (12).
FOUND = {6: 0.95, 12: 0.90}


@pytest.fixture(scope="module")
def true():
    return PROGRAM["truth"](chunks=4)


def test_the_truth_is_what_the_packings_were_made_of(true):
    """Yield strains are proportional to x^0.2 but for what friction has left there."""
    assert true["contrasts: exponents", "strain at yield"] == pytest.approx(0.2, abs=0.02)
    assert true["contrasts: ratios of equal curves", "strain at yield"] == 1.0
    plateau = true["landmarks: moduli there", "storage_modulus at low_strain_plateau"]
    width, noise = PROGRAM["WIDTH"], PROGRAM["NOISE"]
    assert plateau == pytest.approx(1000 * np.exp((width**2 + noise**2) / 2) * 0.99, rel=0.01)


@pytest.mark.parametrize(("n", "paired"), [(6, True), (6, False), (12, True)])
def test_intervals_cover_as_often_as_the_readme_says(true, n, paired):
    """Binomial at 1e-6 for single intervals: one in a million seeds would fail a right one."""
    outcomes, p_values = PROGRAM["simulate"](true, n, paired=paired, studies=STUDIES, resamples=500)
    low, _ = stats.binom.ppf([1e-6, 1 - 1e-6], STUDIES, FOUND[n])
    for key in (
        ("means: G', G'' and other moduli", "storage_modulus at 0.001"),
        ("means: G', G'' and other moduli", "loss_modulus at 0.1"),
        ("means: ratios", "tan_delta at 0.3"),
        ("landmarks: strains", "strain at yield"),
        ("landmarks: strains", "strain at softening"),
        ("landmarks: moduli there", "total_stress at yield"),
        ("contrasts: exponents", "strain at yield"),
        ("contrasts: ratios", "storage_modulus at 0.1"),
    ):
        assert sum(c is True for c in outcomes[key]) >= low, key
    # All at once: their errors go together, but 25 studies cannot be far off in all of them.
    everything = [PROGRAM["rate"](covers) for covers in outcomes.values()]
    assert FOUND[n] - 0.08 < np.nanmean(everything) < 0.99
    p = np.concatenate(p_values)
    assert np.mean(p[np.isfinite(p)] < 0.05) < 0.15
