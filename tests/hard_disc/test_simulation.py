"""One job of hard discs: its records, its summary, and what must not change them."""

import numpy as np
import pytest
from hard_discs import finished, point

from shear_sim.models import hard_disc
from shear_sim.models.hard_disc.flow import contacts_at
from shear_sim.models.interface import SimulationError
from shear_sim.results import read_job
from shear_sim.rheology import summarise
from shear_sim.runner import run_job
from shear_sim.streams import Streams
from shear_sim.study import Job, StudyError, read_study

STEADY = {"kind": "steady", "strain": 0.4}


def test_stress_scales_with_rate_and_mobility_and_the_motion_does_not_notice():
    """σ = (γ̇/ξ₀) × what strain alone decides (section II D), to the bit."""
    one = finished(point(shear=STEADY)).columns()
    other = finished(point(shear=STEADY | {"strain_rate": 4.0}, model={"mobility": 0.5})).columns()
    for name in ("strain", "scaled_shear_stress", "contact_number", "events", "nonaffine_speed"):
        assert np.array_equal(one[name], other[name])
    assert np.array_equal(other["stress_xy"], 8 * one["stress_xy"])
    assert other["time"] == pytest.approx(one["time"] / 4)
    assert np.array_equal(-one["stress_xy"], one["scaled_shear_stress"])
    assert one["scaled_shear_stress"].max() > 0.5


def test_records_and_blocks_never_change_the_motion():
    """50 records or 1,000, asked for one by one or at once: the same bits where they meet."""
    many = finished(point(shear=STEADY, record={"rows": 1000})).columns()
    few = finished(point(shear=STEADY, record={"rows": 50}), block=1).columns()
    for name, values in few.items():
        assert np.array_equal(values, many[name][::20]), name


@pytest.mark.parametrize("exponent", [0.0, 1.0])
def test_checks_of_a_run(exponent):
    for pressure in (None, 30.0):
        shear = STEADY | {"scaled_pressure": pressure}
        run = finished(point(shear=shear, model={"mobility_exponent": exponent}))
        summary, columns = run.summary(), run.columns()
        checks = summary["checks"]
        assert checks["largest_overlap"] < 1e-12
        assert checks["power_residual"] < 1e-10
        assert checks["least_force"] > -1e-9
        assert checks["area_residual"] < 1e-12
        assert summary["status"] == "flowing"
        assert summary["events"]["collisions"] > 50
        if pressure:
            pressed = columns["scaled_pressure"][columns["contact_number"] > 0]
            assert pressed == pytest.approx(30.0, rel=1e-10)
            change = np.log(columns["packing_fraction"] / columns["packing_fraction"][0]) / 2
            assert columns["compression"] == pytest.approx(change, abs=1e-8)


def test_the_checks_of_a_run_find_faults(monkeypatch):
    """A force that pulls, contacts that are open, a cell that is too large: each is reported."""

    def faulty(motion, t):
        now = contacts_at(motion, t)
        phi = now.phi.copy()
        phi[:1] = -0.1 * np.abs(phi[1:]).mean() if len(phi) > 1 else phi
        return now._replace(phi=phi, gap=now.gap + 1e-6)

    monkeypatch.setattr("shear_sim.models.hard_disc.simulation.contacts_at", faulty)
    run = finished(point(shear=STEADY))
    run.start_fraction *= np.exp(-2e-6)
    checks = run.summary()["checks"]
    assert checks["power_residual"] > 1e-3
    assert -0.2 < checks["least_force"] < -0.05
    assert checks["largest_gap_in_records"] == pytest.approx(1e-6 / run.flow.unit, rel=1e-6)
    assert checks["area_residual"] == pytest.approx(1e-6, rel=1e-6)


def test_velocities_of_snapshots_at_fixed_pressure_keep_contacts_closed():
    """r·(v_j − v_i) = 0, where the images move with the cell: γ̇ upwards, −κ along the lattice."""
    run = finished(point(shear=STEADY | {"scaled_pressure": 30.0}, record={"snapshots": 20}))
    kappa, compared = run.columns()["compression_ratio"], 0
    for s in run.snapshots[1:]:
        lattice = s.separation - s.position[s.j] + s.position[s.i]
        relative = s.velocity[s.j] - s.velocity[s.i] - kappa[s.row] * lattice
        relative[:, 0] += lattice[:, 1]
        assert np.abs((relative * s.separation).sum(axis=1)).max() < 1e-9
        compared += len(lattice)
    assert compared > 200
    assert np.abs(kappa).max() > 0.1


def test_oscillation_turns_at_its_amplitude():
    """Within a half period only the strain counts, so records of equal strain scale with the rate.

    The stress answers the rate at once: in phase with γ̇, and at the turning points none.
    """
    given = point(shear={"kind": "oscillatory", "strain_amplitude": 0.1, "periods": 2})
    run = finished(given)
    columns = run.columns()
    time, strain = columns["time"], columns["strain"]
    assert strain == pytest.approx(0.1 * np.sin(2 * np.pi * time), abs=1e-15)
    assert columns["strain_rate"] == pytest.approx(
        0.2 * np.pi * np.cos(2 * np.pi * time), abs=1e-14
    )
    assert run.flow.path == pytest.approx(0.8)
    sheared = columns["contact_number"] > 0
    assert (columns["scaled_shear_stress"][sheared] > 0).all()
    stress = hard_disc.derive(columns)["shear_stress"]
    assert stress == pytest.approx(
        columns["scaled_shear_stress"] * columns["strain_rate"], rel=1e-12, abs=1e-12
    )
    moduli = summarise(columns | hard_disc.derive(columns), run.summary()["protocol"])
    assert moduli["flags"]["no_moduli"] is None
    # Collisions are no fault of a run of hard discs.
    assert moduli["quality"]["jumps"] is moduli["quality"]["largest_jump"] is None
    assert moduli["quality"]["cycle_change"] > 0
    assert moduli["moduli"]["periodic"]["loss"] > abs(moduli["moduli"]["periodic"]["storage"])


def test_a_small_oscillation_without_contacts_is_reversible():
    given = point(
        packing={"packing_fraction": 0.5},
        shear={"kind": "oscillatory", "strain_amplitude": 1e-4, "periods": 1},
    )
    run = hard_disc.start(given, Streams(0, 0))
    x = run.flow.x.copy()
    run.advance(run.rows)
    assert run.flow.counts.collisions == 0
    assert run.flow.x == pytest.approx(x, abs=1e-14)


def test_a_job_through_the_runner(tmp_path):
    job = Job.create(point(shear=STEADY), seed=1, replicate=0)
    result = read_job(run_job(job, tmp_path))
    assert len(result.columns["time"]) == 401
    assert result.summary["steady"]["shear_stress"] > 0.1
    measured = result.summary["measured"]
    late = result.columns["strain"] >= 0.3 * 0.4
    assert measured["scaled_shear_stress"] == pytest.approx(
        result.columns["scaled_shear_stress"][late].mean()
    )
    assert measured["friction_coefficient"] == pytest.approx(
        measured["scaled_shear_stress"] / measured["scaled_pressure"]
    )
    assert measured["viscous_number"] * measured["scaled_pressure"] == pytest.approx(1)
    events = result.columns["events"]
    per_disc = (events[-1] - events[120]) / (32 * 0.28)
    assert measured["events_per_disc_path"] == pytest.approx(per_disc)


@pytest.mark.parametrize(
    "shear", [{"kind": "steady", "strain": 0.05}, {"kind": "body_force", "duration": 2.0}]
)
def test_discs_that_never_meet_are_a_result_too(shear, tmp_path):
    """No pressure to divide by: the ratios are absent, and the run is kept."""
    given = point(packing={"discs": 4, "packing_fraction": 0.02}, shear=shear)
    measured = read_job(run_job(Job.create(given, 1, 0), tmp_path)).summary["measured"]
    assert measured["scaled_pressure"] == 0
    assert measured["friction_coefficient"] is measured["viscous_number"] is None
    assert measured["mean_packing_fraction"] == pytest.approx(0.02)


def test_arrest_says_where_and_why_and_keeps_its_records(monkeypatch):
    """No step is accurate enough here: what was recorded before stays, and is no verdict."""
    run = hard_disc.start(point(shear=STEADY), Streams(3, 0))
    run.advance(100)
    monkeypatch.setattr("shear_sim.models.hard_disc.flow.MOST_DRIFT", 0.0)
    run.advance(1000)
    summary = run.summary()
    assert summary["status"] == "arrested"
    assert summary["stopped"].startswith("arrested at path 0.")
    assert "contacts opened by" in summary["stopped"]
    assert summary["flags"]["stopped_early"]
    assert 100 <= run.done == run.rows < 401
    assert len(run.columns()["time"]) == run.done


def test_events_without_motion_are_arrest(monkeypatch):
    run = hard_disc.start(point(shear=STEADY), Streams(3, 0))
    run.advance(100)
    monkeypatch.setattr("shear_sim.models.hard_disc.flow.STALLED", np.inf)
    monkeypatch.setattr("shear_sim.models.hard_disc.flow.MOST_STALLED", 5)
    run.advance(1000)
    assert run.status == "arrested"
    assert "5 events in a row without motion" in run.stopped


@pytest.mark.parametrize("pressure", [1.0, 30.0, 1000.0])
def test_the_pressure_of_stored_positions_and_forces(pressure):
    """p = Σ f r / 2Ω from the state in the summary, with the distances of its positions."""
    shear = STEADY | {"scaled_pressure": pressure}
    state = finished(point(shear=shear, record={"rows": 20, "state": True})).summary()["state"]
    i, j = state["contact_i"], state["contact_j"]
    x, y = np.array(state["x"]), np.array(state["y"])
    dy = y[j] - y[i]
    up = np.rint(dy / state["height"])
    dx = x[j] - x[i] - up * state["offset"]
    dx -= state["width"] * np.rint(dx / state["width"])
    distance = np.hypot(dx, dy - up * state["height"])
    assert distance == pytest.approx(np.array(state["radius"])[i] + np.array(state["radius"])[j])
    area = state["width"] * state["height"]
    assert distance @ state["contact_force"] / (2 * area) == pytest.approx(pressure, rel=1e-10)


def test_too_dense_a_start_says_so():
    given = point(packing={"packing_fraction": 0.9, "attempts": 2})
    with pytest.raises(SimulationError, match="no overlap-free start after 2 attempts"):
        hard_disc.start(given, Streams(0, 0))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("packing: {packing_fraction: 0.95}", "must be at most 0.907"),
        ("packing: {packing_fraction: 84}", "not percent"),
        ("packing: {packing_fraction: 0.92}", r"must be at most 0.907 \(φ = "),
        ("packing: {discs: 4}", "two discs could touch twice: packing.discs at least"),
        ("model: {mobility: 0}", "must be greater than 0"),
        ("shear: {kind: steady, scaled_pressure: -1}", "must be greater than 0"),
        ("integrator: {scheme: time_steps}", "needs strain_step"),
        ("shear: {kind: steady, scaled_pressure: 3, shear_stress: 2}", "not both"),
        (
            "shear: {kind: compression}\nintegrator: {scheme: time_steps, strain_step: 0.001}",
            "steady shear at fixed area",
        ),
        ("shear: {kind: oscillatory, periods: 9}\nrecord: {rows: 100}", "at least 180"),
    ],
)
def test_impossible_studies(text, message, tmp_path):
    content = text if "model:" in text else f"model: {{kind: hard_disc}}\n{text}"
    content = content.replace("model: {mobility", "model: {kind: hard_disc, mobility")
    with pytest.raises(StudyError, match=message):
        read_study(content.encode(), tmp_path / "study.yaml")
