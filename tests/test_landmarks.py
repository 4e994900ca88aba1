"""Landmarks of curves that are known in closed form."""

import numpy as np
import pytest

from shear_sim.aggregate.columns import LANDMARKS
from shear_sim.landmarks import HALF_LOSS, ONSET, PROMINENCE, SOFTENING, landmarks

HALF_DECADES = np.array([0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0])


def of(strain, storage, loss, third=None):
    """Return the landmarks of one curve, as (strain, G', G'')."""
    columns = [np.asarray(values, dtype=float)[:, None] for values in (storage, loss)]
    third = np.full_like(columns[0], 1e-4) if third is None else np.asarray(third)[:, None]
    found = landmarks(np.asarray(strain, dtype=float), *columns, third)
    return {name: tuple(float(v[0]) for v in landmark) for name, landmark in found.items()}


def log_log(strain, ends, values):
    return np.exp(np.interp(np.log(strain), np.log(ends), np.log(values)))


def test_the_crossing_where_the_loss_angle_turns_evenly():
    """|G*| = 10/γ, δ from 0 to 90° over two decades: 45° after one."""
    strain = np.array([0.1, 0.4, 2.0, 10.0])
    angle = np.pi / 4 * np.log10(strain / 0.1)
    found = of(strain, 10 / strain * np.cos(angle), 10 / strain * np.sin(angle))
    assert found["yield"] == pytest.approx((1.0, np.sqrt(50), np.sqrt(50)), rel=1e-12)
    assert found["first_crossover"] == found["yield"]


def test_softening_and_half_loss_where_the_loss_angle_is_constant():
    """G' = 100 up to 0.1, then γ^-1 with the same tan δ: a line in both planes."""
    storage = log_log(HALF_DECADES, [0.001, 0.1, 3.0], [100, 100, 100 * 0.1 / 3.0])
    found = of(HALF_DECADES, storage, 0.5 * storage)
    assert found["softening"] == pytest.approx((0.1 / 0.9, 90, 45), rel=1e-6)
    assert found["half_loss"] == pytest.approx((0.2, 50, 25), rel=1e-6)
    assert found["low_strain_plateau"] == pytest.approx((0.001, 100.0, 50.0), rel=1e-12)


@pytest.mark.parametrize("per_decade", [2, 3, 5, 20])
def test_the_grid_does_not_change_what_landmarks_mean(per_decade):
    """Two steps: friction gives way at 0.01, the rest yields at 0.7; on any grid of amplitudes.

    The historical rules, in indices of the grid, put the soft plateau of such a curve at 0.55 where
    there are two amplitudes a decade.
    """
    strain = np.logspace(-4, 0.5, round(4.5 * per_decade) + 1)
    one, two = (strain / 0.01) ** 2, (strain / 0.7) ** 2
    storage = 1000 / (1 + one) + 500 / (1 + two)
    loss = 10 + 600 * np.sqrt(one) / (1 + one) + 700 * np.sqrt(two) / (1 + two)
    found = of(strain, storage, loss, third=0.1 * one / (1 + one))
    # In closed form: 10 % of 1500 lost; maximum of the first peak, little shifted by the second.
    assert found["softening"][0] == pytest.approx(0.01 * np.sqrt(150 / 850), rel=0.25)
    assert found["loss_peak"][0] == pytest.approx(0.01, rel=0.15)
    assert found["loss_peak"][2] == pytest.approx(320, rel=0.03)
    assert 0.04 < found["soft_plateau"][0] < 0.2
    assert found["soft_plateau"][1] == pytest.approx(510, rel=0.12)
    # 350 + ... : G' = G'' near 0.7 · (√(0.49 + ...)): solved on a fine grid.
    fine = np.logspace(-1, 0, 100_000)
    two = (fine / 0.7) ** 2
    apart = 500 / (1 + two) - 10 - 700 * np.sqrt(two) / (1 + two) - 6 / fine
    assert found["yield"][0] == pytest.approx(fine[apart > 0][-1], rel=0.1)
    assert found["nonlinearity_onset"][0] == pytest.approx(0.01 / 3, rel=0.1)


def test_the_last_crossing_is_the_yield_and_the_first_is_not():
    strain = np.array([0.01, 0.1, 1.0, 10.0, 100.0])
    found = of(strain, [10, 1, 10, 1, 0.1], [1, 10, 1, 10, 1])
    assert found["first_crossover"][0] == pytest.approx(np.sqrt(0.01 * 0.1))
    assert found["yield"][0] == pytest.approx(np.sqrt(1.0 * 10.0))


def test_a_storage_modulus_that_falls_through_zero_still_crosses():
    """G' changes its sign where log-log lines end; the loss angle goes from 30° to 120°."""
    size, angle = 8.0, np.radians([10.0, 30.0, 120.0])
    found = of([0.1, 1.0, 10.0], size * np.cos(angle), size * np.sin(angle))
    assert found["yield"] == pytest.approx((10 ** (15 / 90), size / np.sqrt(2), size / np.sqrt(2)))


def test_what_lies_beyond_the_amplitudes_is_censored():
    """Above: a network that stays elastic. Below: a liquid at every amplitude."""
    above = of(HALF_DECADES, np.full(8, 100.0), np.full(8, 5.0))
    for name in ("softening", "half_loss", "loss_peak", "yield", "first_crossover"):
        assert above[name][0] == np.inf, name
        assert np.isnan(above[name][1:]).all()
    assert np.isnan(above["soft_plateau"][0])  # absent: there is no softening to end
    assert above["nonlinearity_onset"][0] == np.inf
    below = of(HALF_DECADES, 5 / HALF_DECADES, 100 / HALF_DECADES, third=np.full(8, 0.2))
    for name in ("loss_peak", "yield", "first_crossover", "nonlinearity_onset"):
        assert below[name][0] == -np.inf, name


def test_the_end_of_a_sweep_that_is_elastic_again_has_no_yield_below_it():
    """Only a crossing that is the last word counts; G' > G'' at the end is above."""
    found = of([0.1, 1.0, 10.0], [10, 1, 10], [1, 10, 1])
    assert found["first_crossover"][0] == pytest.approx(np.sqrt(0.1))
    assert found["yield"][0] == np.inf


def test_a_ripple_is_no_peak():
    """G'' rises and dips by 5 %, then rises on: its only prominent maximum is the last."""
    loss = [50, 60, 57, 80, 120, 200, 90, 40]
    found = of(HALF_DECADES, np.full(8, 1000.0), loss)
    assert 0.1 < found["loss_peak"][0] < 1.0
    assert found["loss_peak"][2] >= 200


def test_the_peak_of_a_parabola_is_exact():
    """ln G'' = ln 90 − 2 (ln γ − ln 0.2)²."""
    loss = 90 * np.exp(-2 * np.log(HALF_DECADES / 0.2) ** 2)
    found = of(HALF_DECADES, np.full(8, 1000.0), loss)
    assert found["loss_peak"][0] == pytest.approx(0.2, rel=1e-9)
    assert found["loss_peak"][2] == pytest.approx(90, rel=1e-9)


def test_without_a_plateau_of_a_solid_nothing_softens():
    found = of([0.1, 1.0, 10.0], [-5, -4, -3], [10, 10, 10])
    assert np.isnan(found["softening"][0])
    assert np.isnan(found["half_loss"][0])
    assert found["yield"][0] == -np.inf


def test_many_curves_at_once_and_one_that_lacks_an_amplitude():
    rng = np.random.default_rng(3)
    storage = 1000 / (1 + (HALF_DECADES / 0.1)[:, None] ** 2) * rng.lognormal(0, 0.3, (8, 50))
    loss = 300 * rng.lognormal(0, 0.3, (8, 50))
    third = rng.lognormal(-4.6, 1.0, (8, 50))
    storage[2, 7] = np.nan
    together = landmarks(HALF_DECADES, storage, loss, third)
    for column in range(50):
        if column == 7:
            assert all(np.isnan(values[column]) for v in together.values() for values in v)
            continue
        alone = of(HALF_DECADES, storage[:, column], loss[:, column], third[:, column])
        for name, values in alone.items():
            mine = [float(v[column]) for v in together[name]]
            assert mine == pytest.approx(values, rel=1e-9, nan_ok=True), name


@pytest.mark.parametrize("strain", [[0.1, 1.0], [0.1, 0.1, 1.0], [1.0, 0.1, 10.0]])
def test_amplitudes_must_be_three_and_increase(strain):
    values = np.ones((len(strain), 1))
    with pytest.raises(ValueError, match="three or more increasing"):
        landmarks(np.array(strain), values, values, values)


def test_constants_of_the_definitions_are_those_of_the_tables():
    assert "90 %" in LANDMARKS["softening"]
    assert "50 %" in LANDMARKS["half_loss"]
    assert "1 %" in LANDMARKS["nonlinearity_onset"]
    assert (SOFTENING, HALF_LOSS, ONSET, PROMINENCE) == (0.9, 0.5, 0.01, 0.1)


def test_a_loss_angle_below_minus_90_degrees_is_taken_the_short_way():
    """δ = 30°, then 190° (G' and G'' both a little below zero): it crosses 45°, once."""
    angle = np.radians([10.0, 30.0, 190.0])
    found = of([0.1, 1.0, 10.0], np.cos(angle), np.sin(angle))
    assert found["yield"][0] == pytest.approx(10 ** (15 / 160))
