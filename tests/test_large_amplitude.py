"""Large-amplitude measures of signals whose measures a pencil can find."""

import numpy as np
import pytest

from shear_sim.large_amplitude import lissajous, measures
from shear_sim.rheology import moduli

AMPLITUDE, OMEGA, ROWS = 0.4, 50.0, 2000
PERIOD = 2 * np.pi / OMEGA


def response(stress):
    """Fit three periods of a stress τ(γ, γ̇) and return its measures, and the fit."""
    time = np.arange(3 * ROWS + 1) * (PERIOD / ROWS)
    theta = OMEGA * time
    strain, rate = AMPLITUDE * np.sin(theta), AMPLITUDE * OMEGA * np.cos(theta)
    fit = moduli(
        time,
        stress(strain, rate),
        strain_amplitude=AMPLITUDE,
        period=PERIOD,
        shear_start=0.0,
        periods=3.0,
    )
    found = measures(
        np.array(fit.storage_n),
        np.array(fit.loss_n),
        strain_amplitude=AMPLITUDE,
        angular_frequency=OMEGA,
        peak_stress=fit.peak,
    )
    return {name: float(value) for name, value in found.items()}, fit


def test_a_cubic_spring():
    """τ = a γ + b γ³: tangent a at zero, secant a + b A² at A; sin³ = (3 sin θ − sin 3θ)/4."""
    a, b = 100.0, 300.0
    found, _ = response(lambda strain, _: a * strain + b * strain**3)
    secant = a + b * AMPLITUDE**2
    assert found["minimum_strain_modulus"] == pytest.approx(a, rel=1e-9)
    assert found["large_strain_modulus"] == pytest.approx(secant, rel=1e-9)
    assert found["stiffening_ratio"] == pytest.approx(1 - a / secant, rel=1e-9)
    third = b * AMPLITUDE**2 / 4
    assert found["third_harmonic_ratio"] == pytest.approx(third / (a + 3 * third), rel=1e-9)
    assert found["dissipated_energy"] == pytest.approx(0, abs=1e-9)
    assert found["plastic_ratio"] == pytest.approx(0, abs=1e-9)
    assert found["even_harmonic_ratio"] == pytest.approx(0, abs=1e-9)


def test_a_quintic_spring_reaches_the_fifth_harmonic():
    """Signs of G'_5 in both sums: tangent 0, secant b A⁴."""
    found, _ = response(lambda strain, _: 7.0 * strain**5)
    assert found["minimum_strain_modulus"] == pytest.approx(0, abs=1e-9)
    assert found["large_strain_modulus"] == pytest.approx(7.0 * AMPLITUDE**4, rel=1e-9)


@pytest.mark.parametrize("power", [3, 5])
def test_a_dashpot_that_thickens(power):
    """τ = a γ̇ + b γ̇ⁿ: tangent viscosity a at zero rate, secant a + b (A ω)ⁿ⁻¹ at the largest."""
    a, b = 2.0, 3.0 / (AMPLITUDE * OMEGA) ** (power - 1)
    found, fit = response(lambda _, rate: a * rate + b * rate**power)
    assert found["minimum_rate_viscosity"] == pytest.approx(2.0, rel=1e-9)
    assert found["large_rate_viscosity"] == pytest.approx(5.0, rel=1e-9)
    assert found["thickening_ratio"] == pytest.approx(0.6, rel=1e-9)
    assert found["minimum_strain_modulus"] == pytest.approx(0, abs=1e-9)
    assert found["dissipated_energy"] == pytest.approx(np.pi * AMPLITUDE**2 * fit.loss, rel=1e-12)


def test_dissipated_energy_is_the_area_of_the_loop():
    """∮ τ dγ of a stress with harmonics of both kinds, by the trapezium rule over one period."""
    theta = np.linspace(0, 2 * np.pi, 20001)
    strain, rate = AMPLITUDE * np.sin(theta), AMPLITUDE * OMEGA * np.cos(theta)

    def stress(strain, rate):
        return 900 * strain - 2000 * strain**3 + 4 * rate + 0.02 * rate**3 + 5 * strain * rate

    area = np.trapezoid(stress(strain, rate), strain)
    found, _ = response(stress)
    assert found["dissipated_energy"] == pytest.approx(area, rel=1e-7)


def test_a_perfect_plastic_loses_all_and_a_dashpot_pi_quarters():
    found, fit = response(lambda _, rate: 30.0 * np.sign(np.round(rate, 9)))
    assert fit.peak == pytest.approx(30.0, rel=1e-3)
    assert found["dissipated_energy"] == pytest.approx(4 * AMPLITUDE * 30.0, rel=1e-4)
    assert found["plastic_ratio"] == pytest.approx(1.0, rel=1e-3)
    found, _ = response(lambda _, rate: 3.0 * rate)
    assert found["plastic_ratio"] == pytest.approx(np.pi / 4, rel=1e-9)


def test_even_harmonics_are_measured_apart():
    """γ² = A² (1 − cos 2θ)/2."""
    found, fit = response(lambda strain, _: 10 * strain + 6 * strain**2)
    assert found["even_harmonic_ratio"] == pytest.approx(0.3 * AMPLITUDE, rel=1e-9)
    assert found["third_harmonic_ratio"] == pytest.approx(0, abs=1e-9)
    assert found["minimum_strain_modulus"] == pytest.approx(10, rel=1e-9)
    assert fit.peak == pytest.approx(10 * AMPLITUDE, rel=1e-9)


def test_drift_is_no_part_of_the_peak():
    """A line of 80 Pa over each of the two periods fitted would more than double it."""
    time = np.arange(3 * ROWS + 1) * (PERIOD / ROWS)
    keys = {"strain_amplitude": AMPLITUDE, "period": PERIOD, "shear_start": 0.0, "periods": 3.0}
    fit = moduli(time, 50 * np.sin(OMEGA * time) + 80 * time / PERIOD, **keys)
    assert fit.peak == pytest.approx(50, rel=1e-9)


def test_many_responses_at_once():
    rng = np.random.default_rng(1)
    storage, loss = rng.normal(size=(2, 5, 9))
    amplitude, omega, peak = rng.uniform(1, 2, size=(3, 5))
    keys = ("strain_amplitude", "angular_frequency", "peak_stress")
    together = measures(storage, loss, **dict(zip(keys, (amplitude, omega, peak), strict=True)))
    for row in range(5):
        of_row = dict(zip(keys, (amplitude[row], omega[row], peak[row]), strict=True))
        for name, value in measures(storage[row], loss[row], **of_row).items():
            assert together[name][row] == pytest.approx(value, rel=1e-12), name


def test_a_ratio_to_nothing_is_not_a_number():
    found = measures(
        np.zeros(9), np.zeros(9), strain_amplitude=1.0, angular_frequency=1.0, peak_stress=np.nan
    )
    assert np.isnan(found["third_harmonic_ratio"])
    assert np.isnan(found["stiffening_ratio"])
    assert np.isnan(found["plastic_ratio"])


def test_lissajous_gives_the_stress_back_in_its_two_parts():
    """Elastic: what changes sign with γ at a fixed γ̇. Viscous: what does with γ̇."""
    a, b, c, d = 100.0, 300.0, 2.0, 0.004
    _, fit = response(lambda g, r: a * g + b * g**3 + c * r + d * r**3)
    found = lissajous(np.array(fit.storage_n), np.array(fit.loss_n), strain_amplitude=AMPLITUDE)
    strain, rate = found["strain"], OMEGA * found["rate"]
    assert found["elastic"] == pytest.approx(a * strain + b * strain**3, abs=1e-8)
    assert found["viscous"] == pytest.approx(c * rate + d * rate**3, abs=1e-8)
    assert found["stress"] == pytest.approx(found["elastic"] + found["viscous"], rel=1e-12)
    assert (strain[0], found["stress"][0]) == pytest.approx(
        (strain[-1], found["stress"][-1]), abs=1e-9
    )
