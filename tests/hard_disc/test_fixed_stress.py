"""Shear at fixed stress: the same path, by another clock."""

import numpy as np
import pytest
from hard_discs import finished, flow, point

from shear_sim.models.hard_disc.stress import duration, slowness
from shear_sim.results import read_job
from shear_sim.runner import run_job
from shear_sim.study import Job


def test_a_pair_parts_when_its_clock_says():
    """σ₁ = (cos θ sin θ)²/2Ω at unit rate, and dγ = −dθ/sin²θ: t = [θ + sin θ cos θ]/(4 Ω σ ξ₀).

    The antiderivative of cos²θ is (θ + sin θ cos θ)/2, taken from θ = π/2 to θ₀.
    """
    start, imposed = 2.6, 0.01
    f = flow([(10, 10), (10 + np.cos(start), 10 + np.sin(start))], 0.5, shear=1)
    seconds = 0.0

    def look(motion, path, step):
        nonlocal seconds
        seconds += duration(motion, 0.0, step, imposed, 1e9)

    f.advance(-1 / np.tan(start), look)
    # The angle from π/2 to θ₀; cos² is even about π/2, so the integral is positive.
    expected = (start - np.pi / 2 + np.sin(start) * np.cos(start)) / (4 * 400 * imposed)
    assert seconds == pytest.approx(expected, rel=1e-9)


def test_without_contacts_the_rate_is_the_highest():
    assert slowness(0.0, 2.0, 50.0) == 1 / 50


def test_the_stress_is_fixed_and_the_path_is_that_of_a_fixed_rate():
    fixed_rate = finished(point(shear={"kind": "steady", "strain": 0.4})).columns()
    run = finished(point(shear={"kind": "steady", "strain": 0.4, "shear_stress": 3.0}))
    columns = run.columns()
    for name in ("strain", "scaled_shear_stress", "contact_number", "events"):
        assert np.array_equal(columns[name], fixed_rate[name])
    resisted = columns["scaled_shear_stress"] > 0.01
    assert -columns["stress_xy"][resisted] == pytest.approx(3.0, rel=1e-12)
    assert columns["strain_rate"].max() == pytest.approx(300.0)
    # ∫γ̇ dt = γ, by the trapezoid over the records, which are coarse where collisions jump.
    passed = np.trapezoid(1 / columns["strain_rate"], columns["strain"])
    assert columns["time"][-1] == pytest.approx(passed, rel=0.02)
    protocol = run.summary()["protocol"]
    assert protocol["strain_rate"] == pytest.approx(
        3.0 / columns["scaled_shear_stress"][200:].mean(), rel=0.5
    )


def test_a_run_that_jams_before_its_first_record_is_kept(tmp_path):
    """Its rate is that of what stands still, not 0/0, and no viscosity is made of its start."""
    shear = {"kind": "steady", "strain": 1.0, "shear_stress": 3.0}
    packing = {"packing_fraction": 0.845, "attempts": 200}
    given = point(packing=packing, shear=shear, record={"rows": 20})
    result = read_job(run_job(Job.create(given, seed=0, replicate=0), tmp_path))
    assert result.summary["status"] == "jammed"
    assert len(result.columns["time"]) == 1
    assert result.summary["steady"] is None
    assert "strain_rate = 0" in result.summary["flags"]["no_steady"]
