"""Cores under pressure, and bars that yield, of particles as a study describes them."""

import numpy as np
import pytest
from soft_particles import finished, points

from shear_sim.models import soft_particle
from shear_sim.streams import Streams
from shear_sim.study import StudyError, read_study

ring = points(
    packing={"vertices": 32},
    model={"thickness": 0.1},
    shear={"kind": "diametral_compression", "compression": 0.3, "relative_rate": 0.02},
    record={"rows": 30},
)
CORES = {
    "elastic": {"core_ratio": 1.0}, "drained": {}, "gas": {}, "log": {"core_ratio": 1.0},
}  # fmt: skip


def shell_modulus(vertices, thickness):
    """K_∂Ω = k_s tan(π/N) [Pa] of E = 1 MPa and R = 1 mm, in units of neither."""
    segment = 2 * np.sin(np.pi / vertices)
    return 1e6 * thickness / segment * np.tan(np.pi / vertices)


@pytest.mark.parametrize("law", CORES)
def test_a_ring_is_at_rest_under_the_pressure_inside(law):
    """Tension p₀ ℓ/2 tan(π/N) in its bars, and so no force on any vertex; rings of all sizes."""
    box = points(
        packing={"particles": 9, "vertices": 16, "spread": 0.2},
        model={"thickness": 0.1}, shear={"kind": "compaction"}, record={"rows": 30},
    )  # fmt: skip
    core = {"core": law, "core_pressure": 0.3} | CORES[law]
    system = soft_particle.start(box(core), Streams(0, 0)).run.system
    chains, motion = system.chains, system.motion
    pressure = 0.3 * shell_modulus(16, 0.1)
    assert chains.core_pressure == pytest.approx(pressure)
    length = np.hypot(motion.x[chains.after] - motion.x, motion.y[chains.after] - motion.y)
    assert chains.tension == pytest.approx(0.5 * pressure * length / np.tan(np.pi / 16))
    motion.x[:] += 10.0 * 1e-3 * chains.chain  # apart from each other
    motion.vx[:] = motion.vy[:] = 0.0
    system.walls.position[:] = -1.0
    system.begin()
    force = np.hypot(motion.fx, motion.fy)
    assert force.max() < 1e-9 * pressure * length.min()


@pytest.mark.parametrize("law", ["drained", "gas"])
def test_pressure_inside_raises_the_frequency(law):
    """(ω/ω₁)² = 1 + p R³/3EI: what a pressure outside takes from it until it buckles at 3 EI/R³."""
    given = ring(
        {"damping": 0, "drag": 0, "core": law, "core_pressure": 0.005},
        {"vertices": 64}, record={"rows": 100},
    ).model_dump()  # fmt: skip
    given["shear"] = {"kind": "vibration", "periods": 5, "amplitude": 1e-3}
    run = finished(type(ring()).model_validate(given))
    measured = run.summary()["measured"]
    pressure = 0.005 * shell_modulus(64, 0.1) / (1e6 * 0.1**3 / 12)  # p R³/EI
    assert 2 < pressure < 4
    expected = np.sqrt(1 + pressure / 3)
    assert measured["frequency_ratio"] == pytest.approx(expected, rel=0.01)
    assert measured["energy_missing_ratio"] < 1e-6


@pytest.mark.parametrize("law", ["drained", "gas"])
def test_a_ring_full_of_gas_or_fluid_between_plates(law):
    """p = p₀, or p₀ A₀/A; the plates bear it on a flat contact, as in a membrane of one length.

    F = p (π/2) ε b₀, as bending and stretching take little of it.
    """
    given = ring({"thickness": 0.05, "core": law, "core_pressure": 0.05}, shear={"unload": False})
    run = finished(given)
    table, measured = run.columns(), run.summary()["measured"]
    rest = 0.05 * shell_modulus(32, 0.05)
    gas = law == "gas"
    above = rest * (1 / table["area_ratio"] - 1) if gas else np.zeros(31)
    assert table["core_pressure"] == pytest.approx(above, abs=1e-6 * rest)
    assert table["area_ratio"][-1] < 0.93
    contact = 0.5 * np.pi * table["compression"][-1] * 2 * run.run.half
    assert table["force"][-1] == pytest.approx((rest + above[-1]) * contact, rel=0.01)
    assert measured["energy_missing_ratio"] < 1e-6
    assert run.summary()["derived"]["core_modulus"] == pytest.approx(rest if gas else 0.0)
    change = table["area_ratio"] - 1
    area = float(run.run.system.chains.core_area[0])
    stored = -rest * area * (np.log1p(change) if gas else change)
    assert table["energy_core"] == pytest.approx(stored, abs=1e-9 * rest * area)


def test_bars_yield_under_a_pressure():
    """Hoop forces stop at F^Y: the shell bears 2 F^Y tan(π/N)/ℓ, and only the core the rest."""
    thickness, share, poisson = 0.2, 0.0025, 0.3
    given = ring(
        {
            "thickness": thickness, "core": "elastic", "core_ratio": 1.0, "yield_force": share,
            "poisson_ratio": poisson,
        },
        {"vertices": 16}, record={"rows": 100},
    ).model_dump()  # fmt: skip
    given["shear"] = {"kind": "pressure", "pressure": 3.0, "relative_rate": 0.02}
    run = finished(type(ring()).model_validate(given))
    table = run.columns()
    modulus = shell_modulus(16, thickness) / (1 - poisson**2)  # and K_Ω, as η = 1
    shell = table["outer_pressure"] - modulus * (1 - table["area_ratio"])
    free = table["outer_pressure"] < 0.9 * 4 * share * modulus
    assert shell[free] == pytest.approx(0.5 * table["outer_pressure"][free], rel=0.01, abs=1.0)
    beyond = table["outer_pressure"] > 1.2 * 4 * share * modulus
    assert beyond.sum() > 5
    assert shell[beyond] == pytest.approx(2 * share * modulus, rel=0.02)
    assert table["lost_by_yield"][-1] > 0.1 * table["work"][-1]
    assert np.abs(table["energy_missing"]).max() < 1e-6 * table["work"][-1]


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("core: gas", "a gas core is nothing without its pressure"),
        ("core: drained, core_ratio: 1", "a drained core has no stiffness"),
        ("core: gas, core_ratio: 1, core_pressure: 0.1", "that of a gas is its pressure"),
        ("core_pressure: 0.1", "core: drained; or give a core_ratio"),
        ("core: none, core_pressure: 0.1", "has no core_pressure: leave one of both out"),
        ("core: gas, core_pressure: 2", "must be at most 1"),
        ("core: gas, core_pressure: 0.1, yield_force: 0.04", "yield_force over 0.05"),
    ],
)
def test_impossible_cores(model, message, tmp_path):
    with pytest.raises(StudyError, match=message):
        read_study(f"model: {{kind: soft_particle, {model}}}".encode(), tmp_path / "study.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("shear: {kind: pressure}", "only what is inside less what is outside counts"),
        ("shear: {kind: bending}", "a beam is open and has no core"),
        (
            "shear: {kind: tension}\npacking: {particles: 30, preparation: tissue}",
            "cells with corners are not at rest under a pressure",
        ),
    ],
)
def test_no_pressure_in_what_cannot_have_any(text, message, tmp_path):
    model = "kind: soft_particle, core: drained, core_pressure: 0.1"
    model += ", links: {strength: 1}" if "tension" in text else ""
    with pytest.raises(StudyError, match=message):
        read_study(f"model: {{{model}}}\n{text}".encode(), tmp_path / "study.yaml")
