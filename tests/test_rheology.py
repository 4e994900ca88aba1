"""Moduli against signals whose moduli are known from paper and pencil."""

import json

import numpy as np
import pytest

from shear_sim.rheology import jumps, moduli, steady_shear, summarise

PERIOD, START, AMPLITUDE = 0.0125, 0.025, 0.3
PROTOCOL = {
    "kind": "oscillatory",
    "strain_amplitude": AMPLITUDE,
    "period": PERIOD,
    "shear_start": START,
    "periods": 3.0,
    "shear_end": START + 3 * PERIOD,
    "end": START + 4 * PERIOD,
}


def grid(rows_per_period=200, periods=3.0, post=1.0):
    """Records of two periods of rest, the oscillation, and a rest."""
    steps = round((2 + periods + post) * rows_per_period)
    return np.arange(steps + 1) * (PERIOD / rows_per_period)


def phase(time):
    return 2 * np.pi * (time - START) / PERIOD


def fit(time, stress, periods=3.0, **keys):
    return moduli(
        time,
        stress,
        strain_amplitude=AMPLITUDE,
        period=PERIOD,
        shear_start=START,
        periods=periods,
        **keys,
    )


def test_pure_first_harmonic():
    time = grid()
    found = fit(time, AMPLITUDE * (1000 * np.sin(phase(time)) + 200 * np.cos(phase(time))))
    assert found.storage == pytest.approx(1000, rel=1e-13)
    assert found.loss == pytest.approx(200, rel=1e-12)
    assert found.in_phase == pytest.approx(300, rel=1e-13)
    assert found.out_of_phase == pytest.approx(60, rel=1e-12)
    assert found.total == pytest.approx(np.hypot(300, 60), rel=1e-13)
    assert found.magnitude == pytest.approx(np.hypot(1000, 200), rel=1e-13)
    assert found.residual < 1e-10
    assert found.fitted_periods == 2
    assert found.rows == 400


def test_every_harmonic_is_found_where_it_is():
    time = grid()
    storage = [1000, 20, -300, 5, 40, -3, 11, 2, -7]
    loss = [-50, 30, 70, 0, 8, 9, -10, 1, 6]
    stress = AMPLITUDE * sum(
        s * np.sin(n * phase(time)) + c * np.cos(n * phase(time))
        for n, (s, c) in enumerate(zip(storage, loss, strict=True), start=1)
    )
    found = fit(time, stress)
    assert found.storage_n == pytest.approx(storage, abs=1e-9)
    assert found.loss_n == pytest.approx(loss, abs=1e-9)


def test_constant_and_drift_do_not_reach_the_moduli():
    """A line of slope s biases a bare projection by −s T/(π A), and not the joint fit."""
    time = grid()
    slope = 4000.0
    pure = AMPLITUDE * (10 * np.sin(phase(time)) + 2 * np.cos(phase(time)))
    found = fit(time, 5e4 + slope * (time - START) + pure)
    assert found.storage == pytest.approx(10, abs=1e-8)
    assert found.loss == pytest.approx(2, abs=1e-8)
    assert found.drift == pytest.approx(slope, rel=1e-9)
    middle = START + 2 * PERIOD + 0.5 * PERIOD / 200  # of the records of periods 2 and 3
    assert found.offset == pytest.approx(5e4 + slope * (middle - START), rel=1e-12)
    assert found.storage_cycles == pytest.approx([10] * 3, abs=1e-7)


@pytest.mark.parametrize("periods", [1.0, 2.0])
def test_drift_is_not_fitted_over_a_single_period(periods):
    """Its bias is then the one of the projection, −s T/(π A), up to the other harmonics."""
    time = grid(2000, periods)
    slope = 4000.0
    found = fit(time, slope * (time - START), periods, harmonics=1)
    assert found.drift == 0.0
    assert found.fitted_periods == 1
    assert found.storage == pytest.approx(-slope * PERIOD / (np.pi * AMPLITUDE), rel=1e-3)


def test_first_period_is_left_out_unless_it_is_the_only_one():
    time = grid()
    stress = np.where(time < START + PERIOD * (1 - 1e-9), 700.0, 300.0) * np.sin(phase(time))
    assert fit(time, stress).storage == pytest.approx(1000, rel=1e-12)
    assert fit(time, stress).storage_cycles == pytest.approx([700 / 0.3, 1000, 1000], rel=1e-12)
    assert fit(time, stress, periods=1.0).storage == pytest.approx(700 / 0.3, rel=1e-12)


def test_a_last_part_of_a_period_is_not_used():
    """Nor is anything before the second period or after the last whole one."""
    time = grid(periods=3.6)
    pure = 300 * np.sin(phase(time))
    edge = 1e-9 * PERIOD
    used = (time > START + edge) & (time <= START + 3 * PERIOD + edge)
    broken = np.where(used, pure, np.nan)
    assert fit(time, broken, periods=3.6) == fit(time, pure, periods=3.0)


def test_the_record_at_the_start_of_the_shear_is_left_out():
    """It holds the stress before the rate jumps, and its phase stands again a period later."""
    time = grid()
    stress = np.sin(phase(time))
    assert fit(time, stress).rows == 2 * 200
    jump = np.where(np.abs(time - START) < 1e-9 * PERIOD, 1e6, stress)
    assert fit(time, jump, periods=1.0) == fit(time, stress, periods=1.0)
    assert fit(time, jump) == fit(time, stress)


@pytest.mark.parametrize("every", [7, 9, 11])
def test_records_that_do_not_divide_the_period(every):
    """The joint fit needs no equal number of records per period; projections do."""
    time = grid(300)[::every]
    stress = (
        5000 + 300 * np.sin(phase(time)) + 60 * np.cos(phase(time)) + 9 * np.sin(3 * phase(time))
    )
    found = fit(time, stress)
    assert found.storage == pytest.approx(1000, rel=1e-11)
    assert found.loss == pytest.approx(200, rel=1e-10)


def test_nineteen_records_per_period_resolve_nine_harmonics_and_eighteen_do_not():
    time = grid(19)
    stress = 300 * np.sin(phase(time)) + 30 * np.cos(9 * phase(time))
    found = fit(time, stress)
    assert found.storage == pytest.approx(1000, rel=1e-10)
    assert found.loss_n[8] == pytest.approx(100, rel=1e-9)
    time = grid(18)
    with pytest.raises(ValueError, match=r"period 1 .* holds 18 records.* need 19 .*record.every"):
        fit(time, np.sin(phase(time)))


def test_a_harmonic_beyond_the_fit_aliases_only_as_sampling_theory_says():
    """With 200 records per period, 11 θ is orthogonal to 1 ... 9 θ, and 199 θ is −θ."""
    time = grid(200)
    found = fit(time, 300 * np.sin(phase(time)) + 50 * np.cos(11 * phase(time)), periods=2.0)
    assert found.storage == pytest.approx(1000, rel=1e-12)
    assert found.residual == pytest.approx(50 / np.sqrt(2), rel=1e-4)
    aliased = fit(time, 300 * np.sin(199 * phase(time)), periods=2.0)
    assert aliased.storage == pytest.approx(-1000, rel=1e-9)


def test_white_noise_reaches_the_moduli_as_least_squares_says():
    """Var G' = 2 σ²/(A² R) for R evenly spread rows; 400 draws give that to 15 % (4 sigma)."""
    time = grid(400)
    rng = np.random.default_rng(7)
    noise = 3.0
    draws = [fit(time, rng.normal(0, noise, len(time)), harmonics=3) for _ in range(400)]
    expected = np.sqrt(2 / 800) * noise / AMPLITUDE
    # The drift column makes sin θ a little dearer, hence loss only.
    assert np.std([d.loss for d in draws]) == pytest.approx(expected, rel=0.15)
    assert np.mean([d.loss for d in draws]) == pytest.approx(0, abs=4 * expected / 20)
    assert np.mean([d.residual for d in draws]) == pytest.approx(noise, rel=0.02)


def test_kelvin_voigt():
    """τ = G γ + η γ̇: G' = G, G'' = ω η."""
    time = grid()
    omega = 2 * np.pi / PERIOD
    stress = 1200 * AMPLITUDE * np.sin(phase(time)) + 0.4 * AMPLITUDE * omega * np.cos(phase(time))
    found = fit(time, stress)
    assert found.storage == pytest.approx(1200, rel=1e-12)
    assert found.loss == pytest.approx(0.4 * omega, rel=1e-12)


def test_maxwell():
    """τ̇ = G γ̇ − τ/λ from rest, its start-up included: G' = G x²/(1+x²), G'' = G x/(1+x²), x = ω λ.

    The transient decays as exp(−t/λ), to exp(−20) before the second period.
    """
    relaxation, modulus = PERIOD / 20, 900.0
    time = grid()
    x = 2 * np.pi / PERIOD * relaxation
    angle = phase(time)
    start_up = -x / (1 + x**2) * np.exp(-np.clip(time - START, 0, None) / relaxation)
    wave = (x**2 * np.sin(angle) + x * np.cos(angle)) / (1 + x**2)
    stress = np.where(time < START, 0.0, modulus * AMPLITUDE * (wave + start_up))
    found = fit(time, stress)
    assert found.storage == pytest.approx(modulus * x**2 / (1 + x**2), rel=1e-7)
    assert found.loss == pytest.approx(modulus * x / (1 + x**2), rel=1e-7)
    assert abs(found.storage_cycles[0] / found.storage - 1) > 1e-2  # the start-up shows there


@pytest.mark.parametrize("periods", [0.0, 0.1, 0.999])
def test_less_than_one_period_is_refused(periods):
    time = grid()
    with pytest.raises(ValueError, match=r"shear\.periods = .* at least one whole period"):
        fit(time, np.sin(phase(time)), periods=periods)


def test_a_series_that_stops_early_is_refused():
    time = grid()
    time = time[time < START + 1.5 * PERIOD]
    with pytest.raises(ValueError, match="period 3 of the oscillation holds 0 records"):
        fit(time, np.sin(phase(time)))


def test_crowded_records_are_refused():
    """Enough of them, but all in one corner of the period."""
    time = START + PERIOD * np.linspace(0.0, 0.01, 300)
    with pytest.raises(ValueError, match="evenly enough"):
        fit(time, np.sin(phase(time)), periods=1.0)


def test_a_stress_that_is_not_finite_is_refused_with_its_row():
    time = grid()
    stress = np.sin(phase(time))
    stress[650] = np.nan
    with pytest.raises(ValueError, match=r"not a finite number at t = .* \(row 650\)"):
        fit(time, stress)


def test_columns_of_different_length_are_refused():
    time = grid()
    with pytest.raises(ValueError, match="two columns of one length"):
        fit(time, np.zeros(len(time) - 1))


def test_the_same_bits_from_any_memory_layout():
    time = grid()
    stress = 300 * np.sin(phase(time)) + np.random.default_rng(1).normal(size=len(time))
    strided = np.empty((len(time), 3))
    strided[:, 1] = stress
    assert fit(time, strided[:, 1]) == fit(time.copy(), stress)


def oscillation(noise=0.0, external=1.0):
    time = grid()
    inside = (time >= START) & (time <= START + 3 * PERIOD)
    wave = np.where(inside, 300 * np.sin(phase(time)) + 60 * np.cos(phase(time)), 0.0)
    # A rest whose first two thirds are loud: only the last third counts.
    rest = np.where(time < START * 2 / 3 - 1e-9, 500.0, noise) * np.cos(20 * phase(time))
    wave = np.where(time < START, rest, wave)
    return {
        "time": time,
        "shear_stress": wave,
        "shear_stress_internal": 0.9 * wave,
        "shear_stress_external": 0.9 * external * wave,
    }


def test_summary_of_an_oscillation():
    summary = summarise(oscillation(), PROTOCOL)
    assert summary["moduli"]["periodic"]["storage"] == pytest.approx(1000, rel=1e-12)
    assert summary["moduli"]["internal"]["storage"] == pytest.approx(900, rel=1e-12)
    assert summary["quality"]["surface_internal_ratio"] == pytest.approx(1, rel=1e-12)
    assert summary["quality"]["cycle_change"] == pytest.approx(0, abs=1e-12)
    assert summary["flags"] == {
        "baseline_noisy": False,
        "surface_internal_differ": False,
        "no_moduli": None,
    }
    assert json.loads(json.dumps(summary)) == summary


@pytest.mark.parametrize(("factor", "flag"), [(0.9, False), (1.1, True)])
def test_baseline_flag_at_ten_percent_of_the_stress_amplitude(factor, flag):
    """A wave of height h is 2 h from peak to peak."""
    height = factor * 0.05 * np.hypot(300, 60)
    summary = summarise(oscillation(noise=height), PROTOCOL)
    assert summary["quality"]["baseline_noise"] == pytest.approx(0.1 * factor, rel=1e-6)
    assert summary["flags"]["baseline_noisy"] is flag


@pytest.mark.parametrize(
    ("ratio", "flag"), [(0.69, True), (0.71, False), (1.29, False), (1.31, True)]
)
def test_surface_flag_at_thirty_percent(ratio, flag):
    summary = summarise(oscillation(external=ratio), PROTOCOL)
    assert summary["flags"]["surface_internal_differ"] is flag


def test_drift_is_told_in_stress_amplitudes_per_period():
    columns = oscillation()
    columns["shear_stress"] = columns["shear_stress"] + 4000.0 * (columns["time"] - START)
    quality = summarise(columns, PROTOCOL)["quality"]
    assert quality["drift_ratio"] == pytest.approx(4000 * PERIOD / np.hypot(300, 60), rel=1e-9)
    one = summarise(columns, PROTOCOL | {"periods": 1.0, "shear_end": START + PERIOD})["quality"]
    assert one["drift_ratio"] is None  # over one period no drift is fitted


@pytest.mark.parametrize(("height", "count"), [(0.14, 0), (0.17, 1)])
def test_a_step_over_15_percent_of_the_range_is_a_jump(height, count):
    """On a sine of 200 records, whose own steps are 1.6 % at most; the step is at its top."""
    columns = oscillation()
    wave = np.sin(phase(columns["time"]))
    place = int(np.argmin(abs(columns["time"] - START - 1.25 * PERIOD)))
    wave[place + 1 :] -= 2 * height  # of a range that grows by about as much as the step
    spread = np.ptp(wave)
    rows, largest = jumps(wave, limit=0.15 * 2 / spread)
    assert rows.tolist() == [place] * count
    assert largest == pytest.approx(2 * height / spread, rel=1e-2)
    columns["shear_stress"] = np.where(columns["time"] < START, 1e9, wave)  # the rest is not seen
    assert summarise(columns, PROTOCOL)["quality"]["largest_jump"] == pytest.approx(largest)


def test_no_jumps_in_a_sine_of_21_records_nor_in_a_constant():
    assert jumps(np.sin(2 * np.pi * np.arange(63) / 21))[0].tolist() == []
    rows, largest = jumps(np.full(10, 3.0))
    assert (rows.tolist(), largest) == ([], 0.0)


def test_a_stress_that_was_not_recorded_has_no_jumps():
    columns = oscillation()
    del columns["shear_stress"]
    quality = summarise(columns, PROTOCOL)["quality"]
    assert (quality["jumps"], quality["largest_jump"]) == (None, None)


def test_without_a_rest_there_is_no_baseline():
    columns = {name: values[400:] for name, values in oscillation().items()}
    columns["time"] = columns["time"] - START
    summary = summarise(columns, PROTOCOL | {"shear_start": 0.0})
    assert summary["quality"]["baseline_noise"] is None
    assert summary["flags"]["baseline_noisy"] is None
    assert summary["moduli"]["periodic"]["storage"] == pytest.approx(1000, rel=1e-9)


def test_no_whole_period_gives_null_moduli_and_the_reason():
    summary = summarise(oscillation(), PROTOCOL | {"periods": 0.5})
    assert summary["moduli"] == {"periodic": None, "internal": None, "external": None}
    assert "at least one whole period" in summary["flags"]["no_moduli"]
    assert summary["flags"]["baseline_noisy"] is None


def test_a_tensor_that_was_not_recorded_is_null():
    columns = oscillation()
    del columns["shear_stress_external"]
    summary = summarise(columns, PROTOCOL)
    assert summary["moduli"]["external"] is None
    assert summary["moduli"]["periodic"] is not None
    assert summary["flags"]["surface_internal_differ"] is None
    assert "shear_stress_external" in summary["flags"]["no_moduli"]


def steady_series(rate):
    time = np.linspace(0.0, 4.0, 4001)  # shear from 1 to 3 s
    stress = np.where(time < 2.0, 1e6, rate * 5.0 + 0.3 * np.sin(40 * np.pi * time))
    stress[time >= 3.0] = -1e6
    return time, stress


@pytest.mark.parametrize("rate", [2.0, -2.0])
def test_steady_viscosity_is_read_from_the_second_half_of_the_strain(rate):
    time, stress = steady_series(rate)
    columns = {"time": time, "shear_stress": stress, "pressure": np.full(len(time), 50.0)}
    protocol = {"kind": "steady", "strain_rate": rate, "shear_start": 1.0, "shear_end": 3.0}
    summary = summarise(columns, protocol)["steady"]
    assert summary["shear_stress"] == pytest.approx(5 * rate, rel=1e-9)
    assert summary["viscosity"] == pytest.approx(5.0, rel=1e-9)
    assert summary["stress_ratio"] == pytest.approx(0.2, rel=1e-9)
    assert summary["rows"] == 1000
    assert summary["shear_stress_error"] < 1e-9  # blocks of two whole waves do not scatter


def test_block_scatter_of_correlated_noise():
    """Blocks longer than the correlation give σ/√(independent pieces), here 100 of 10 rows."""
    rng = np.random.default_rng(3)
    time = np.arange(2000) * 1e-3
    errors = [
        steady_shear(
            time,
            np.repeat(rng.normal(size=200), 10),
            strain_rate=1.0,
            shear_start=0.0,
            shear_end=2.0,
        )["shear_stress_error"]
        for _ in range(200)
    ]
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(0.1, rel=0.1)


def test_steady_shear_with_too_few_records_says_so():
    columns = {"time": np.linspace(0, 4, 21), "shear_stress": np.ones(21)}
    protocol = {"kind": "steady", "strain_rate": 1.0, "shear_start": 1.0, "shear_end": 3.0}
    summary = summarise(columns, protocol)
    assert summary["steady"] is None
    assert "record.every" in summary["flags"]["no_steady"]


def test_what_is_no_shear_has_no_rheology():
    assert summarise({}, {"kind": "creep"}) == {"flags": {}}
