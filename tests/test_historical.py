"""The historical estimators: against signals known from paper and pencil, faults included."""

import numpy as np
import pytest

from shear_sim.historical import ESTIMATORS, estimate, without_jumps

FREQUENCY, AMPLITUDE = 80.0, 0.1
STORAGE, LOSS = 1000.0, 200.0
ROWS = 2000  # per period
PROTOCOL = {
    "kind": "oscillatory",
    "strain_amplitude": AMPLITUDE,
    "frequency": FREQUENCY,
    "period": 1 / FREQUENCY,
    "pre_periods": 2,
    "periods": 3,
    "post_periods": 1,
    "shear_start": 2 / FREQUENCY,
    "shear_end": 5 / FREQUENCY,
    "end": 6 / FREQUENCY,
}


def signal():
    """A linear response between two rests; windows begin and end between two samples."""
    # Half a sample early, no comparison at an edge depends on rounding.
    time = (np.arange(6 * ROWS) + 0.5) / (ROWS * FREQUENCY)
    angle = 2 * np.pi * (time * FREQUENCY - 2)
    moving = (time > 2 / FREQUENCY) & (time < 5 / FREQUENCY)
    stress = AMPLITUDE * (STORAGE * np.sin(angle) + LOSS * np.cos(angle))
    return time, np.where(moving, stress, 0.0)


def both(name, time, stress, protocol=PROTOCOL):
    found = estimate(name, time, stress, protocol)
    return found.storage, found.loss


@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_linear_response_is_read_as_it_is(name):
    """R takes its first sample, here half a sample after phase 0, for phase 0."""
    late = np.pi / ROWS if name == "r-compat" else 0.0
    turned = (STORAGE + 1j * LOSS) * np.exp(1j * late)  # G* seen with the phase late by this
    storage, loss = both(name, *signal())
    assert storage == pytest.approx(turned.real, rel=1e-12)
    assert loss == pytest.approx(turned.imag, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "times"), [("no-detrend", 1), ("r-compat", 1), ("header-compat", 2), ("detrended", 0)]
)
@pytest.mark.parametrize("periods", [2, 3, 6])
def test_drift_errs_as_in_the_original(name, times, periods):
    """A drift of s Pa/s takes s/(π f A) off G', whatever the number of periods; twice it, where
    the sign of the correction is wrong; G'' is left alone."""
    slope = 4000.0
    protocol = PROTOCOL | {"periods": periods, "shear_end": (2 + periods) / FREQUENCY}
    protocol["end"] = protocol["shear_end"] + 1 / FREQUENCY
    time = (np.arange(round(protocol["end"] * FREQUENCY) * ROWS) + 0.5) / (ROWS * FREQUENCY)
    drift = slope * (time - 2 / FREQUENCY)
    zero = both(name, time, np.zeros_like(time), protocol)
    storage, loss = np.subtract(both(name, time, drift, protocol), zero)
    error = -times * slope / (np.pi * FREQUENCY * AMPLITUDE)
    assert storage == pytest.approx(error, abs=1e-5 * slope)
    assert loss == pytest.approx(0.0, abs=1e-4 * slope if name == "r-compat" else 1e-7)
    if name in {"header-compat", "detrended"}:
        assert estimate(name, time, drift, protocol).drift == pytest.approx(slope, rel=1e-9)


# A step of 60 Pa at phase θ of the window of two periods: raw moduli h (cos θ − 1)/(2 π A) and
# −h sin θ/(2 π A) off.
@pytest.mark.parametrize("turns", [0.25, 0.5, 0.75, 1.25])
def test_a_jump_is_taken_out(turns):
    time, stress = signal()
    height = 60.0
    jumped = stress + height * (time * FREQUENCY > 3 + turns)
    storage, loss = both("no-detrend", time, jumped)
    angle = 2 * np.pi * turns
    expected = height * np.array([np.cos(angle) - 1, -np.sin(angle)]) / (2 * np.pi * AMPLITUDE)
    assert [storage - STORAGE, loss - LOSS] == pytest.approx(expected, abs=0.06)
    found = estimate("r-compat", time, jumped, PROTOCOL)
    clean = estimate("r-compat", time, stress, PROTOCOL)
    assert found.storage == pytest.approx(clean.storage, rel=2e-6)
    assert found.loss == pytest.approx(clean.loss, rel=2e-5)
    assert (found.jumps, clean.jumps) == (1, 0)
    slope = np.hypot(STORAGE, LOSS) * AMPLITUDE * 2 * np.pi / ROWS
    assert found.largest_jump == pytest.approx(height, abs=slope)
    assert clean.largest_jump == 0.0


def test_a_jump_takes_the_slope_before_it():
    series = np.array([0.0, 1.0, 2.0, 52.0, 53.0, 54.0, 4.0, 5.0])
    cleaned, heights = without_jumps(series)
    assert heights.tolist() == [50.0, -50.0]
    assert cleaned.tolist() == list(range(8))


def test_of_two_jumps_in_a_row_the_second_takes_the_slope_that_the_first_was_given():
    cleaned, heights = without_jumps(np.array([0.0, 1.0, 51.0, 101.0, 102.0, 103.0]))
    assert heights.tolist() == [50.0, 50.0]
    assert cleaned.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


def test_a_jump_at_the_first_step_stays():
    series = np.array([0.0, 50.0, 51.0, 52.0])
    cleaned, heights = without_jumps(series)
    assert heights.tolist() == [50.0]
    assert cleaned.tolist() == series.tolist()


def test_one_period_is_read_whole_and_a_fraction_more_as_each_original_does():
    time, _ = signal()
    ones = np.ones_like(time)
    for periods, r_rows, header_rows in [(1, 1, 1), (1.5, 0.5, 1.5), (2, 1, 1), (3, 2, 2)]:
        end = {"shear_end": (2 + periods) / FREQUENCY}
        protocol = PROTOCOL | {"periods": periods} | end
        rows = [estimate(name, time, ones, protocol).rows for name in ESTIMATORS]
        assert rows == [r_rows * ROWS] + 3 * [header_rows * ROWS]


def test_without_rests_the_first_and_last_samples_stand_in():
    time = (np.arange(3 * ROWS) + 0.5) / (ROWS * FREQUENCY)
    slope = 1234.0
    protocol = PROTOCOL | {"pre_periods": 0, "post_periods": 0}
    assert estimate("detrended", time, slope * time, protocol).drift == pytest.approx(slope)


def test_a_run_of_ours_needs_no_header():
    """Frequency and rests follow from the protocol block of any run."""
    time, stress = signal()
    ours = {k: v for k, v in PROTOCOL.items() if k not in {"frequency", "pre_periods"}}
    del ours["post_periods"]
    for name in ESTIMATORS:
        assert both(name, time, stress, ours) == pytest.approx(both(name, time, stress), rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "steady"}, "only an oscillation"),
        ({"pre_periods": 90}, "0 samples between"),
        ({"post_periods": 1e-6}, "first third of the last: no drift"),
    ],
)
def test_what_cannot_be_read_says_why(change, message):
    with pytest.raises(ValueError, match=message):
        estimate("header-compat", *signal(), PROTOCOL | change)


def test_unknown_names_and_broken_series_are_refused():
    time, stress = signal()
    with pytest.raises(ValueError, match="no estimator 'modern': one of r-compat, header-compat"):
        estimate("modern", time, stress, PROTOCOL)
    stress[17] = np.nan
    with pytest.raises(ValueError, match="not finite at sample 17"):
        estimate("r-compat", time, stress, PROTOCOL)
