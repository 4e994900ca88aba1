"""Dense suspensions of rings under oscillatory shear: how they start, and what a run measures."""

import numpy as np
import pytest
from soft_particles import finished, goes_on_to_the_same_bits, points, prepared, prepared_in_parts

from shear_sim.models import soft_particle
from shear_sim.models.interface import SimulationError
from shear_sim.models.soft_particle import scenario
from shear_sim.models.soft_particle.packs import loose_discs
from shear_sim.results import read_job
from shear_sim.runner import run_job
from shear_sim.study import Job, StudyError, read_study

PACKING = {"particles": 12, "vertices": 12, "spread": 0.1, "packing_fraction": 0.98}
MODEL = {
    "thickness": 0.2, "contact_stiffness": 10.0, "contact_damping": 0.2, "inner_damping": 0.5,
    "drag": 0.05,
}  # fmt: skip


SHEAR = {"kind": "oscillatory", "relative_frequency": 0.1, "periods": 2}
point = points(packing=PACKING, model=MODEL, shear=SHEAR)


@pytest.mark.parametrize("count", [9, 60])
def test_loose_discs_touch_nowhere_in_their_cell(count):
    cell = loose_discs(count, 0.15, 0.7, np.random.default_rng(3))
    apart = []
    for across in (cell.x, cell.y):
        step = across[:, None] - across
        apart.append(step - cell.width * np.rint(step / cell.width))
    gap = np.hypot(*apart) - cell.radius[:, None] - cell.radius
    np.fill_diagonal(gap, np.inf)
    assert gap.min() > 0.0
    assert cell.width == cell.height
    assert np.pi * (cell.radius**2).sum() / cell.width**2 == pytest.approx(0.7)


@pytest.mark.parametrize("boundary", ["lees_edwards", "plates"])
def test_what_a_run_measures(boundary, tmp_path):
    """Work of a cycle = π G″ A² V = what is lost, with yield and friction; σ_xy = σ_yx."""
    given = point(
        {"yield_moment": 0.2, "friction": 0.2, "core_ratio": 1.0}, cell={"boundary": boundary}
    )
    job = read_job(run_job(Job.create(given, seed=1, replicate=0), tmp_path))
    table, summary = job.columns, job.summary
    assert len(table["time"]) == 401
    period = summary["protocol"]["period"]
    wave = 0.2 * np.sin(2 * np.pi * table["time"] / period)
    assert table["strain"] == pytest.approx(wave, abs=1e-12)
    assert np.array_equal(table["shear_stress"], -table["stress_xy"])
    radius = 1e-3
    length = 2 * radius * np.sin(np.pi / PACKING["vertices"])
    bending = 1e6 * (MODEL["thickness"] * radius) ** 3 / 12 / length  # k_b, (SP.2)
    for name in ("stress_xx", "stress_xy", "stress_yx", "stress_yy", "shear_stress", "pressure"):
        assert table[f"{name}_per_modulus"] == pytest.approx(table[name] / 1e6)
        scaled = table[name] * radius**2 / bending
        assert table[f"{name}_per_bending"] == pytest.approx(scaled)

    measured = summary["measured"]
    shares = [measured[f"{name}_loss_share"] for name in ("yield", "friction", "damping", "drag")]
    assert sum(shares) == pytest.approx(1.0)
    assert min(shares) > 0.005
    assert measured["cycle_missing_ratio"] < 1e-4
    assert measured["energy_missing_ratio"] < 1e-4
    work = table["work"][400] - table["work"][200]
    loss = summary["moduli"]["periodic"]["loss_cycles"][1] * np.pi * 0.2**2
    assert work == pytest.approx(loss * table["box_area"][0], rel=1e-3)

    glued = summary["preparation"]["glued_particles"]
    if boundary == "plates":
        assert 2 <= glued <= 5
        assert "asymmetry_periodic" not in summary["checks"]
    else:
        assert glued == 0
        assert summary["checks"]["asymmetry_periodic"] < 1e-12


def test_a_suspension_starts_pressed_together_and_at_rest():
    given = point({"core_ratio": 100.0})
    run = prepared(given).run
    chains, system = run.system.chains, run.system
    sides = np.add.reduceat(chains.rest_length, chains.start[:-1])
    r = chains.radius
    solid = (chains.core_area + sides * r + np.pi * r**2).sum()
    assert solid / run.volume == pytest.approx(0.98)
    assert system.kinetic() < 1e-8 * sum(system.stored())
    stress = system.stress() * run.radius**2 / run.unit.hinge
    assert stress[0] == pytest.approx(stress[3], rel=0.2)
    assert stress[0] > 1.0
    assert abs(stress[1]) < 0.2 * stress[0]


def test_a_preparation_may_be_stopped_and_shared():
    """Nothing is done before it is asked for; in parts, from a file, on two threads: same bits."""
    assert prepared_in_parts(point({"friction": 0.2}, {"particles": 16})) > 2


def test_rings_that_never_rest_are_refused(monkeypatch):
    monkeypatch.setattr(scenario, "LONGEST_REST", 2)
    with pytest.raises(SimulationError, match="not at rest 2 periods"):
        prepared(point())


def test_core_and_yield_change_the_moduli():
    """A hard core is stiffer; what yields is softer, and loses its work there."""

    def last(**model):
        run = finished(point(model, shear={"strain_amplitude": 0.05}))
        tau, strain = soft_particle.derive(run.columns())["shear_stress"], run.columns()["strain"]
        storage = (tau[200:400] * strain[200:400]).sum() / (strain[200:400] ** 2).sum()
        return storage, run.summary()["measured"]

    hollow, soft = last()
    hard, _ = last(core_ratio=100.0)
    plastic, yielding = last(yield_moment=0.05)
    assert hard > 3 * hollow > 0
    assert plastic < 0.8 * hollow
    assert soft["yield_loss_share"] == 0.0
    assert yielding["yield_loss_share"] > 0.01


def test_plates_stand_still_and_their_images_move():
    """Glued rings keep their places, which takes no work; the others are sheared."""
    simulation = prepared(point(cell={"boundary": "plates"}))
    motion, held = simulation.run.system.motion, simulation.run.system.held
    place = motion.x[held].copy(), motion.y[held].copy()
    free = np.setdiff1d(np.arange(len(motion.x)), held)
    before = motion.x[free].copy()
    simulation.advance(30)
    assert np.array_equal(motion.x[held], place[0])
    assert np.array_equal(motion.y[held], place[1])
    assert np.abs(motion.x[free] - before).max() > 0.05 * simulation.run.radius
    assert simulation.run.system.budget().by_velocities == 0.0


def test_all_that_is_measured_scales():
    """Twice the size, thrice the modulus: the same numbers where they have no unit."""
    one = finished(point()).columns()
    other = finished(point({"young_modulus": 3e6, "density": 10.0}, {"radius": 2e-3})).columns()
    for name in ("strain", "stress_xy_per_modulus", "stress_xy_per_bending", "circularity"):
        assert other[name] == pytest.approx(one[name], rel=1e-5, abs=1e-9)
    assert other["stress_xy"] == pytest.approx(3 * one["stress_xy"], rel=1e-5, abs=1e-6)


def test_a_snapshot_holds_the_stress():
    """Σ f_a r_b over bars and contacts is the stress of hollow rings that move slowly."""
    still = {"damping": 0.0, "contact_damping": 0.0, "inner_damping": 0.0, "drag": 0.5}
    run = finished(point(still, shear={"relative_frequency": 0.02, "strain_amplitude": 0.1,
                                       "periods": 1}, record={"snapshots": (0.25,)}))  # fmt: skip
    snapshot, table = run.snapshots[0], run.columns()
    assert snapshot.periodic
    assert snapshot.offset == pytest.approx(0.1 * snapshot.height)
    along = snapshot.separation / np.hypot(*snapshot.separation.T)[:, None]
    across = np.column_stack([-along[:, 1], along[:, 0]])
    force = snapshot.normal[:, None] * along + snapshot.tangential[:, None] * across
    stress = np.einsum("ca,cb->ab", force, snapshot.separation) / run.run.volume
    row = snapshot.row
    names = np.array([["stress_xx", "stress_xy"], ["stress_yx", "stress_yy"]])
    expected = np.array([[table[name][row] for name in pair] for pair in names])
    assert stress == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("boundary", ["lees_edwards", "plates"])
def test_stop_and_go_on_to_the_same_bits(boundary):
    given = point({"yield_moment": 0.1, "friction": 0.3}, cell={"boundary": boundary},
                  shear={"periods": 1}, record={"rows": 40})  # fmt: skip
    goes_on_to_the_same_bits(given, 15)


SHEAR = "shear: {kind: oscillatory}"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SHEAR, "a suspension needs rings"),
        (f"{SHEAR}\npacking: {{particles: 4}}", "could touch its own image: at least 5"),
        (f"{SHEAR}\npacking: {{particles: 20, packing_fraction: 95}}", "not percent"),
        (f"{SHEAR}\npacking: {{particles: 20, packing_fraction: 0.6}}", "greater than 0.7"),
        (f"{SHEAR}\npacking: {{particles: 20, preparation: gravity}}", "no effect on a suspension"),
        (f"{SHEAR}\npacking: {{particles: 20}}\nrecord: {{rows: 50}}", "50 records of 3 periods"),
        ("packing: {packing_fraction: 0.9}", "is for a suspension"),
        ("cell: {boundary: plates}", "is for a suspension"),
        ("shear: {kind: oscillatory, strain_amplitude: 20}", "not percent"),
    ],
)
def test_impossible_studies(text, message, tmp_path):
    content = f"model: {{kind: soft_particle}}\n{text}"
    with pytest.raises(StudyError, match=message):
        read_study(content.encode(), tmp_path / "study.yaml")
