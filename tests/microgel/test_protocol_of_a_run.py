"""Records, whole steps, and blocks: what is imposed, and that nobody's block size changes it."""

import math
import re

import numpy as np
import pytest
from scenes import finish, packing_point, prepared, scene, steady

from shear_sim.models.interface import SimulationError
from shear_sim.models.microgel.parameters import Links
from shear_sim.models.microgel.state import ROW
from shear_sim.protocol import OscillatoryShear


def table(simulation, *blocks):
    for rows in blocks:
        simulation.advance(rows)
    columns = simulation.columns()
    return np.array([columns[name] for name in ROW])


def point(shear=None, every=1, **more):
    shear = shear or OscillatoryShear(
        strain_amplitude=0.2, pre_periods=0.2, periods=1.5, post_periods=0.3
    )
    return packing_point(
        discs=16, links=Links(cut="cells"), shear=shear, every=every, friction=0.2,
        packing={"packing_fraction": 1.0}, **more,
    )  # fmt: skip


def test_strain_is_exactly_a_sine():
    """γ = A sin 2π(t − t₀)/T at every record; the historical Riemann sum lags by half a step."""
    shear = OscillatoryShear(
        strain_amplitude=0.2, relative_frequency=0.05, pre_periods=0.3, periods=2.25,
        post_periods=0.4,
    )  # fmt: skip
    simulation = prepared(point(shear))
    c = finish(simulation)
    protocol = simulation.summary()["protocol"]
    t0, period = protocol["shear_start"], protocol["period"]
    t1 = protocol["shear_end"]
    t = c["time"]
    during = (t > t0 * (1 + 1e-12)) & (t <= t1 * (1 + 1e-12))
    phase = 2 * np.pi * (t[during] - t0) / period
    assert np.abs(c["strain"][during] - 0.2 * np.sin(phase)).max() < 1e-14
    rate = 0.2 * 2 * np.pi / period
    assert np.abs(c["strain_rate"][during] - rate * np.cos(phase)).max() < 1e-12 * rate
    assert (c["strain"][t <= t0] == 0).all()
    assert (c["strain_rate"][t <= t0] == 0).all()
    # Stopped at a quarter of a period: the strain stays at A.
    assert np.abs(c["strain"][t > t1] - 0.2).max() < 1e-15
    assert (c["strain_rate"][t > t1 * (1 + 1e-12)] == 0).all()


def test_records_sit_at_whole_steps_and_at_both_ends():
    simulation = prepared(point())
    c = finish(simulation)
    protocol = simulation.summary()["protocol"]
    steps = protocol["steps_per_period"] * 2
    assert simulation.rows == len(c["time"]) == steps + 1
    assert c["time"][0] == 0
    assert np.array_equal(c["time"], np.arange(steps + 1) * protocol["time_step"])
    assert protocol["end"] == c["time"][-1]
    assert protocol["period"] == pytest.approx(
        protocol["time_step"] * protocol["steps_per_period"], rel=1e-15
    )
    assert protocol["shear_start"] == pytest.approx(0.2 * protocol["period"])
    assert protocol["shear_end"] == pytest.approx(1.7 * protocol["period"])


@pytest.mark.parametrize("sign", [1, -1])
def test_steady_shear_starts_at_once_and_stops_at_the_strain(sign):
    shear = steady(0.7, rate=0.01 * sign, pre_periods=0.1, post_periods=0.2)
    simulation = prepared(point(shear))
    c = finish(simulation)
    p = simulation.summary()["protocol"]
    begin, end = (round(p[name] / p["time_step"]) for name in ("shear_start", "shear_end"))
    assert (c["strain"][: begin + 1] == 0).all()
    assert (c["strain_rate"][: begin + 1] == 0).all()
    ramp = np.arange(end - begin + 1) / (end - begin) * 0.7 * sign
    assert np.abs(c["strain"][begin : end + 1] - ramp).max() < 1e-14
    rate = c["strain_rate"][begin + 1 : end + 1]
    assert (rate == rate[0]).all()
    assert rate[0] == pytest.approx(p["strain_rate"], rel=1e-14)
    tau = simulation.summary()["derived"]["time_constant"]
    # Whole steps: the rate is the one asked for to half a step of the ramp.
    assert rate[0] * tau == pytest.approx(0.01 * sign, rel=0.6 / (end - begin))
    assert (c["strain"][end:] == c["strain"][end]).all()
    assert (c["strain_rate"][end + 1 :] == 0).all()


def test_no_rest_before_the_shear():
    shear = OscillatoryShear(pre_periods=0, periods=0.5, post_periods=0)
    c = finish(prepared(point(shear)))
    assert c["strain"][0] == 0
    assert c["strain"][1] > 0


@pytest.mark.parametrize("every", [2, 4, 5])
def test_fewer_records_have_the_same_bits(every):
    """`record.every` decides what is written, never what is computed."""
    full, sparse = prepared(point()), prepared(point(every=every))
    all_rows = table(full, full.rows)
    rows = table(sparse, sparse.rows)
    assert rows.shape[1] == full.steps // every + 1
    assert np.array_equal(rows, all_rows[:, ::every])


@pytest.mark.parametrize("blocks", [[1] * 481, [7] * 69, [0, 1, 0, 1, 500], [480, 1], [2, 479]])
@pytest.mark.parametrize("every", [1, 4])
def test_blocks_have_the_same_bits(blocks, every):
    """The runner asks for rows in blocks that suit its progress bar: the physics must not care."""
    whole, parts = prepared(point(every=every)), prepared(point(every=every))
    expected = table(whole, whole.rows)
    for rows in blocks:
        before = parts.done
        parts.advance(rows)
        assert parts.done == min(before + rows, parts.rows)
    assert np.array_equal(table(parts), expected)


def test_advancing_beyond_the_end_makes_no_more_records():
    simulation = prepared(point())
    simulation.advance(10 * simulation.rows)
    simulation.advance(3)
    assert simulation.done == simulation.rows


def test_halved_steps_converge_at_second_order():
    """A force from the wrong instant, or a first-order spring, would show as order one."""
    shear = OscillatoryShear(strain_amplitude=0.02, pre_periods=0.0, periods=0.5, post_periods=0)

    def end(steps):
        s = prepared(
            packing_point(discs=16, links=Links(cut="cells"), shear=shear, friction=0.2,
                          steps_per_period=steps)
        )  # fmt: skip
        return finish(s)["shear_stress"][:: steps // 200]

    coarse, middle, fine = (end(n) for n in (800, 1600, 3200))
    ratio = np.abs(coarse - middle).max() / np.abs(middle - fine).max()
    assert 3.5 < ratio < 4.6


def test_a_steady_rate_is_exact_and_a_shear_of_few_steps_is_refused():
    point = packing_point(shear=steady(0.333, rate=0.05), discs=20, steps_per_period=200)
    simulation = prepared(point)
    columns = finish(simulation)
    tau = simulation.summary()["derived"]["time_constant"]
    assert columns["strain_rate"][-1] == pytest.approx(0.05 / tau, rel=1e-12)
    assert columns["strain"][-1] == pytest.approx(0.333, rel=0.01)
    with pytest.raises(ValueError, match=r"the shear takes 3\.3 steps: at least 3637"):
        packing_point(shear=steady(0.55, rate=1.0))


def test_a_step_that_cannot_be_cut_small_enough_is_said():
    """With the limit and the reason, before anything is recorded but the start."""
    simulation = prepared(packing_point(discs=20, relative_viscosity=1e6))
    with pytest.raises(
        SimulationError,
        match=r"the dashpots need substeps of at most \S+ s at t = 0 s.*1/4096.*lower",
    ):
        finish(simulation)
    assert simulation.done == 1
    simulation = prepared(packing_point(discs=20))
    stiff = simulation.constants.step_energy / 1e5
    simulation.constants = simulation.constants._replace(step_energy=stiff)
    with pytest.raises(
        SimulationError, match=r"discs \d+ and \d+, at 0\.\d+ of their contact distance, need"
    ):
        finish(simulation)


def test_the_discs_that_stop_a_run_are_named_where_they_are():
    """Two discs across an edge of the cell, in the middle of a step when they are too close.

    The image of disc 1 is 1.2 higher and 0.9 − 1.2 γ to the left: 0.72 of it at 0.7 of the contact
    distance of 2, in the second step of 0.12 of strain, which moves the image by 2.4 in the cell.
    """
    s = scene(
        [(10.0, 19.4), (9.1, 0.6)], 1.0, step=1.0, steps=4, strain_rate=0.12, width=20.0,
        height=20.0, periodic=True, skin=0.5, k=1e-9, step_energy=1 / (0.7 * 4096),
    )  # fmt: skip
    s.constants = s.constants._replace(law=(1.0, 1.0, 1.0, 1.0))  # its tangent grows as (D/d)²
    strain = (0.9 - math.sqrt(1.4**2 - 1.2**2)) / 1.2
    with pytest.raises(SimulationError) as failure:
        s.advance(s.rows)
    said = re.search(
        r"discs (\d+) and (\d+), at (\S+) of .* at t = (\S+) s \(strain (\S+)\)",
        str(failure.value),
    )
    assert said.group(1, 2) == ("0", "1")
    found = [float(text) for text in said.group(3, 4, 5)]
    assert found == pytest.approx([0.7, strain / 0.12, strain], rel=2e-3)
