"""Studies of beams, of rings under pressure and of vibrating rings, against closed forms."""

import numpy as np
import pytest
from soft_particles import finished, goes_on_to_the_same_bits, points

from shear_sim.models import soft_particle
from shear_sim.render import read_kept
from shear_sim.runner import run_job
from shear_sim.streams import Streams
from shear_sim.study import Job, StudyError, read_study

beam = points(
    packing={"vertices": 8},
    model={"damping": 0, "drag": 0},
    shear={"kind": "bending"},
    integrator={"step": 0.7},
    record={"rows": 10},
)
ring = points(
    packing={"vertices": 12},
    model={"thickness": 0.2},
    shear={"kind": "pressure", "pressure": 1, "relative_rate": 0.02},
    record={"rows": 200},
)


@pytest.mark.parametrize("drag", [0, 0.3])
@pytest.mark.parametrize(
    ("support", "factor"),
    [
        ("clamped", (1 + 1 / 8) * (1 + 1 / 16)),
        ("half_clamped", 1 + 1 / 128),
        ("ends", 1 + 2 / 64),
    ],
)
def test_beams_bend_as_their_hinges_do(support, factor, drag):
    """Of F L³/3EI and F L³/48EI; whatever the drag, the beam is at rest in the end."""
    run = finished(beam(shear={"support": support}, model={"drag": drag}))
    measured = run.summary()["measured"]
    assert measured["final_deflection_ratio"] == pytest.approx(factor, abs=1e-4)
    assert measured["energy_missing_ratio"] < 1e-6
    table = run.columns()
    assert table["energy_kinetic"][-1] < 1e-9 * table["work"][-1]
    # A force hung on at once does twice the work that is stored.
    assert table["energy_bend"][-1] == pytest.approx(0.5 * table["work"][-1], rel=1e-3)


def test_twice_the_force_bends_twice_as_much():
    one, two = (finished(beam(shear={"force": force})).columns() for force in (5e-4, 1e-3))
    assert two["deflection"][-1] == pytest.approx(2 * one["deflection"][-1], rel=1e-4)
    assert two["deflection_ratio"][-1] == pytest.approx(one["deflection_ratio"][-1], rel=1e-4)


@pytest.mark.parametrize("eta", [0, 3])
@pytest.mark.parametrize("law", ["elastic", "log"])
def test_bulk_modulus_of_a_pressed_ring(eta, law):
    """K_Ω + k_s tan(π/N), paper (18) and (22), to 1e-3."""
    given = ring(model={"core_ratio": eta, "core": law, "thickness": 0.05})
    run = finished(given)
    assert run.summary()["measured"]["bulk_modulus_ratio"] == pytest.approx(1, abs=1e-3)
    table = run.columns()
    # The pressure grows at a constant rate, so its work is half of its last value times the way.
    change = -float(run.run.system.chains.core_area[0]) * (table["area_ratio"][-1] - 1)
    assert table["work"][-1] == pytest.approx(0.5 * table["outer_pressure"][-1] * change, rel=0.01)
    assert np.abs(table["energy_missing"]).max() < 1e-6 * table["work"][-1]
    last, young = table["outer_pressure"][-1], given.model.young_modulus
    assert table["outer_pressure_per_modulus"][-1] == pytest.approx(last / young)
    scaled = table["outer_pressure_ratio"][-1] * run.run.unit.bending / given.packing.radius
    assert table["outer_pressure_per_bending"][-1] == pytest.approx(scaled / run.run.unit.hinge)


def test_a_ring_buckles_at_three_times_its_stiffness():
    """p R³/EI = 3, by the growth of an imperfection; beyond, the ring collapses."""
    shear = {"pressure": 3.5, "relative_rate": 0.05, "imperfection": 1e-3}
    run = finished(ring(packing={"vertices": 32}, shear=shear))
    measured, table = run.summary()["measured"], run.columns()
    assert measured["buckling_pressure_ratio"] == pytest.approx(3, rel=0.02)
    assert measured["energy_missing_ratio"] < 1e-6
    before = table["outer_pressure_ratio"] < 2.5
    assert table["ovality"][before].max() < 0.01
    assert table["ovality"][-1] > 0.1
    assert table["area_ratio"][before].min() > 0.95
    assert table["area_ratio"][-1] < 0.95


def test_a_core_bears_its_share_of_the_pressure():
    """The shell buckles where it bears 3 EI/R³, which is 1/(1 + η) of the pressure."""
    shear = {"pressure": 2.9, "relative_rate": 0.05, "imperfection": 1e-4}
    given = ring(packing={"vertices": 32}, shear=shear, model={"core_ratio": 1})
    found = finished(given).summary()["measured"]["buckling_pressure_ratio"]
    assert found == pytest.approx(6, rel=0.02)


def test_a_vibrating_ring():
    """ω₁² = 36 EI/5 ρ_l R⁴ within 1 %; nothing is lost."""
    shear = {"kind": "vibration", "periods": 5, "amplitude": 1e-3}
    given = points(packing={"vertices": 64}, model={"damping": 0, "drag": 0}, shear=shear)()
    run = finished(given)
    measured, table = run.summary()["measured"], run.columns()
    assert len(table["time"]) == 101
    assert measured["frequency_ratio"] == pytest.approx(1, rel=0.01)
    assert measured["energy_missing_ratio"] < 1e-6
    assert np.abs(table["ovality"]).max() == pytest.approx(1e-3, rel=0.02)
    assert table["ovality"][:6].max() == pytest.approx(1e-3, rel=0.02)  # a quarter of a period


def test_damping_calms_a_vibration():
    """A drag of 2 ζ ω₁ m: the amplitude of a period is exp(−2π ζ) of that before."""
    shear = {"kind": "vibration", "periods": 4, "amplitude": 1e-3}
    given = points(packing={"vertices": 24}, model={"damping": 0, "drag": 0.1}, shear=shear)()
    oval = finished(given).columns()["ovality"]
    first, last = np.abs(oval[:20]).max(), np.abs(oval[60:]).max()
    assert last / first == pytest.approx(np.exp(-2 * np.pi * 0.05 * 3), rel=0.05)


@pytest.mark.parametrize(
    "given",
    [
        beam(model={"drag": 0.1}),
        ring(model={"core_ratio": 1.0, "yield_moment": 0.01}, shear={"imperfection": 0.01}),
        points(packing={"vertices": 12}, model={"thickness": 0.2}, shear={"kind": "vibration"})(),
    ],
)
def test_stop_and_go_on_to_the_same_bits(given):
    goes_on_to_the_same_bits(given, 6)


@pytest.mark.parametrize("given", [beam(record={"rows": 10, "snapshots": [1]})])
def test_a_snapshot_of_a_beam_is_its_shape(given, tmp_path):
    """½ (x/L)² (3 − x/L), paper (14); the vertex before x = 0 is of the clamp."""
    kept = read_kept(run_job(Job.create(given, seed=1, replicate=0), tmp_path))
    x, y = kept.snapshots[0].position.T
    x, y = (x - x[1]) / np.ptp(x[1:]), y - y[1]
    assert y[1:] / y[-1] == pytest.approx(0.5 * x[1:] ** 2 * (3 - x[1:]), abs=0.01)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("model: {core_ratio: 1}\nshear: {kind: bending}", "a beam is open and has no core"),
        ("shear: {kind: bending, support: floating}", "must be one of"),
        ("shear: {kind: bending, force: 3}", "must be at most 0.1"),
        ("shear: {kind: pressure, pressure: 50}", "must be at most 5"),
        ("shear: {kind: vibration, amplitude: 5}", "not percent"),
        ("packing: {particles: 9}\nshear: {kind: vibration}", "a box of rings needs shear.kind"),
    ],
)
def test_impossible_studies(text, message, tmp_path):
    content = text if "model:" in text else f"model: {{}}\n{text}"
    content = content.replace("model: {", "model: {kind: soft_particle, ").replace(", }", "}")
    with pytest.raises(StudyError, match=message):
        read_study(content.encode(), tmp_path / "study.yaml")


@pytest.mark.parametrize("kind", ["bending", "pressure", "vibration"])
@pytest.mark.parametrize(
    "given", [{"friction": 0.3}, {"tangential_ratio": 0.5}, {"contact_damping": 0.3}]
)
def test_keys_without_effect(kind, given, tmp_path):
    """A study is refused for what its run would not use: the same numbers with the key and without.

    Its default may be written, as a scene may have to undo what all have.
    """
    (name, value), path = *given.items(), tmp_path / "study.yaml"
    text = f"model: {{{{kind: soft_particle, {name}: {{}}}}}}\nshear: {{{{kind: {kind}}}}}"
    with pytest.raises(StudyError, match=rf"{name}: {value} has no effect with shear\.kind"):
        read_study(text.format(value).encode(), path)
    read_study(text.format(1 if name == "tangential_ratio" else 0).encode(), path)
    usual = points(packing={"vertices": 8}, model={}, shear={"kind": kind}, record={"rows": 20})()
    changed = usual.model_copy(update={"model": usual.model.model_copy(update=given)})
    one, other = (soft_particle.start(each, Streams(0, 0)) for each in (usual, changed))
    for run in (one, other):
        run.advance(4)
    assert np.array_equal(one.run.system.motion.x, other.run.system.motion.x)


def test_a_scene_undoes_what_all_have(tmp_path):
    """Rings between plates with friction, and one that vibrates, of one study."""
    text = (
        "model: {kind: soft_particle, friction: 0.3}\n"
        "scenes:\n"
        "  pressed: {shear: {kind: diametral_compression}}\n"
        "  free: {shear: {kind: vibration}}\n"
    )
    with pytest.raises(StudyError, match="set it only in the scenes that need it"):
        read_study(text.encode(), tmp_path / "study.yaml")
    text = text.replace("vibration}", "vibration}, model.friction: 0")
    assert len(read_study(text.encode(), tmp_path / "study.yaml").jobs()) == 2
