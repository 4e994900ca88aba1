"""A ring between two plates: the elastica, plastic hinges, the membrane; one job of a study."""

import pickle

import numpy as np
import pytest

from shear_sim.models import soft_particle
from shear_sim.models.interface import SimulationError
from shear_sim.models.soft_particle.parameters import SoftParticlePoint
from shear_sim.results import read_job
from shear_sim.runner import run_job
from shear_sim.streams import Streams
from shear_sim.study import Job, StudyError, read_study

#: ε, F R²/EI and V/V₀ of an elastic ring between plates, from the elastica with a shooting method.
ELASTICA = np.array(
    [
        (0.05, 0.6254, 0.9967), (0.10, 1.1743, 0.9875), (0.15, 1.6663, 0.9730),
        (0.20, 2.1153, 0.9540), (0.25, 2.5316, 0.9308), (0.28, 2.7691, 0.9151),
    ]
)  # fmt: skip


def point(vertices=40, **sections):
    model = {"thickness": 0.1} | sections.pop("model", {})
    return SoftParticlePoint.model_validate(
        {"packing": {"vertices": vertices}, "model": model, **sections}
    )


def finished(given):
    simulation = soft_particle.start(given, Streams(0, 0))
    simulation.advance(10_000)
    return simulation


@pytest.fixture(scope="module")
def elastic():
    return finished(
        point(60, shear={"compression": 0.45, "relative_rate": 0.01}, record={"rows": 180})
    )


def test_an_elastic_ring_follows_the_elastica(elastic):
    """Force within 1.5 %, area within 0.002; beyond ε = 0.2822 the contact is flat.

    There F R²/EI = 1.43554/β² and V/V₀ = 2β − 1.01253 β², β = 1 − ε.
    """
    table = elastic.columns()
    top = table["compression"].argmax()
    loading = {name: values[: top + 1] for name, values in table.items()}
    force = np.interp(ELASTICA[:, 0], loading["compression"], loading["scaled_force"])
    assert force == pytest.approx(ELASTICA[:, 1], rel=0.015)
    area = np.interp(ELASTICA[:, 0], loading["compression"], loading["area_ratio"])
    assert area == pytest.approx(ELASTICA[:, 2], abs=0.002)
    flat = loading["compression"] > 0.30
    beta = 1 - loading["compression"][flat]
    assert loading["scaled_force"][flat] == pytest.approx(1.43554 / beta**2, rel=0.03)
    assert loading["area_ratio"][flat] == pytest.approx(2 * beta - 1.01253 * beta**2, abs=0.002)
    # Between stadium and ellipse of the same perimeter, paper (27), (26); at first as a thin ring
    # under two forces does, by (2/π − 1/2)/(π/4 − 2/π) of the way of the plates.
    e, width = loading["compression"], loading["width_ratio"]
    small = np.interp(0.02, e, width) - 1
    assert small / 0.02 == pytest.approx((2 / np.pi - 0.5) / (np.pi / 4 - 2 / np.pi), rel=0.03)
    later = e > 0.02
    e, width = e[later], width[later]
    ellipse = 3 * (width + 1 - e) - np.sqrt((width + 3 * (1 - e)) * (3 * width + 1 - e))
    assert np.all(ellipse < 2)
    assert np.all(width > 1 + (np.pi / 2 - 1) * e)
    measured = elastic.summary()["measured"]
    assert measured["contact_onset"] == pytest.approx(0.2822, abs=0.01)
    assert measured["contact_slope"] == pytest.approx(2.188, abs=0.1)
    assert soft_particle.derive(table)["stretch_share"][top] < 4e-3  # as h²: 5e-4 at h = 0.05 R


def test_an_elastic_ring_forgets(elastic):
    """Back to the start: shape, force on the way, and no energy missing."""
    measured = elastic.summary()["measured"]
    assert abs(measured["residual_compression"]) < 1e-3
    assert measured["recovered_work"] == pytest.approx(1.0, abs=0.02)
    assert measured["energy_missing_ratio"] < 1e-6
    table = elastic.columns()
    middle = len(table["time"]) // 2
    down, up = table["scaled_force"][1:middle], table["scaled_force"][-2:middle:-1]
    assert up[20:] == pytest.approx(down[20:], abs=0.03)


def test_a_plastic_ring_follows_derunt_and_hodge():
    """F R/4M^Y = 1/√(1 − ε²) (two plastic hinges at each end of both diameters), within 5 %.

    At the speed of a test; `analysis/soft_diametral.py` goes slower.
    """
    run = finished(
        point(
            40, model={"yield_moment": 0.05},
            shear={"compression": 0.45, "relative_rate": 0.004}, record={"rows": 90},
        )
    )  # fmt: skip
    table, unit = run.columns(), run.run.unit
    top = table["compression"].argmax()
    e = table["compression"][:top]
    moment = 0.05 * unit.bending / 1e-3
    law = table["mean_force"][:top] * 1e-3 / (4 * moment) * np.sqrt(1 - e**2)
    for low, high in ((0.1, 0.2), (0.2, 0.3), (0.3, 0.4)):
        assert law[(e > low) & (e < high)].mean() == pytest.approx(1.0, abs=0.05)
    at = e > 0.1
    phi = np.arcsin(e[at])
    area = 4 / np.pi * (phi * (1 - e[at]) + 0.5 * (np.pi / 2 - phi)
                        - 0.5 * e[at] * np.sqrt(1 - e[at] ** 2))  # fmt: skip
    assert table["area_ratio"][:top][at] == pytest.approx(area, abs=0.006)
    measured = run.summary()["measured"]
    assert measured["residual_compression"] > 0.9 * 0.45
    assert measured["energy_missing_ratio"] < 1e-6


@pytest.mark.parametrize("eta", [1.0, 100.0])
def test_a_ring_with_a_core_is_a_membrane_stadium(eta):
    """A perimeter of elastic membrane around an elastic area, of the shape of a stadium.

    l = [(1 − β) + ½ηβ(1 − β²)]/(1 + ηβ²), V/V₀ = β² + 2βl, F = p (π/2) l b₀.
    40 vertices are coarse; `analysis/soft_diametral.py` has 100 and half the tolerance.
    """
    run = finished(
        point(
            40, model={"thickness": 0.05, "core": "elastic", "core_ratio": eta},
            shear={"compression": 0.35, "relative_rate": 0.04, "unload": False},
            record={"rows": 50},
        )
    )  # fmt: skip
    table = run.columns()
    last = {name: values[-1] for name, values in table.items()}
    beta = 1 - last["compression"]
    length = ((1 - beta) + 0.5 * eta * beta * (1 - beta**2)) / (1 + eta * beta**2)
    assert last["area_ratio"] == pytest.approx(beta**2 + 2 * beta * length, abs=0.003)
    contact = 0.5 * np.pi * length * 2 * run.run.half
    force = last["core_pressure"] * contact
    young, radius = run.point.model.young_modulus, run.point.packing.radius
    assert last["core_pressure_per_modulus"] == pytest.approx(last["core_pressure"] / young)
    bending = young * (0.05 * radius) ** 3 / 12 / (2 * radius * np.sin(np.pi / 40))  # k_b, (SP.2)
    scaled = last["core_pressure"] * radius**2 / bending
    assert last["core_pressure_per_bending"] == pytest.approx(scaled)
    assert last["force"] == pytest.approx(force, rel=0.05)
    assert last["contact_ratio"] == pytest.approx(0.5 * np.pi * length, abs=0.09)


@pytest.mark.parametrize(
    ("vertices", "strain", "coarse"), [(24, 0.6, True), (48, 0.6, False), (8, 0.28, False)]
)
def test_a_mesh_that_is_coarse_for_its_folds_is_flagged(vertices, strain, coarse):
    """Where the force is off by over 4 %: ℓ over 0.4 of half the gap, of a ring that folds."""
    shear = {"compression": strain, "relative_rate": 0.02, "unload": False}
    run = finished(point(vertices, shear=shear, record={"rows": 80}))
    table, summary = run.columns(), run.summary()
    e, force = table["compression"], table["scaled_force"]
    folds = e > 0.29
    error = np.append(
        np.interp(ELASTICA[:, 0], e, force) / ELASTICA[:, 1] - 1,
        force[folds] * (1 - e[folds]) ** 2 / 1.43554 - 1,
    )
    assert (np.abs(error).max() > 0.04) == coarse == summary["flags"]["coarse"]
    half_gap = (1 - strain) * np.cos(np.pi / vertices)
    ratio = 2 * np.sin(np.pi / vertices) / half_gap if strain > 0.2822 else 0.0
    assert summary["measured"]["fold_ratio"] == pytest.approx(ratio)


def test_a_mesh_that_is_too_coarse_for_its_folds(tmp_path):
    """It is refused with the fewest vertices that are enough, and these are."""
    text = "model: {{kind: soft_particle}}\npacking: {{vertices: {}}}\nshear: {{compression: 0.8}}"
    path = tmp_path / "study.yaml"
    with pytest.raises(StudyError, match=r"half a gap of 0\.5 segments.* = 32 at least \(80 for"):
        read_study(text.format(16).encode(), path)
    with pytest.raises(StudyError, match=r"half a gap of 0\.89 segments"):
        read_study(text.format(28).encode(), path)
    read_study(text.format(32).encode(), path)
    assert point(80, shear={"compression": 0.8}).shear.fold_ratio(80) < 0.4
    assert point(8, shear={"compression": 0.28}).shear.fold_ratio(8) == 0.0


def test_all_that_is_measured_scales():
    """Twice the size, thrice the modulus: the same numbers where they have no unit."""
    shear = {"compression": 0.05, "relative_rate": 0.05, "unload": False}
    one = finished(point(16, shear=shear, record={"rows": 10})).columns()
    other = point(16, model={"young_modulus": 3e6, "density": 10.0}, shear=shear,
                  record={"rows": 10})  # fmt: skip
    other = other.model_copy(update={"packing": other.packing.model_copy(update={"radius": 2e-3})})
    other = finished(other).columns()
    for name in ("compression", "scaled_force", "area_ratio", "stress_yy_per_modulus",
                 "stress_yy_per_bending"):  # fmt: skip
        assert other[name] == pytest.approx(one[name], rel=1e-6, abs=1e-12)
    assert other["stress_yy"] == pytest.approx(3 * one["stress_yy"], rel=1e-6)
    assert other["force"] == pytest.approx(6 * one["force"], rel=1e-6)
    assert one["stress_yy_per_modulus"][-1] > 0


def test_stop_and_go_on_to_the_same_bits(tmp_path):
    """A run kept in a file between two records and taken up again is the same run."""
    given = point(16, model={"yield_moment": 0.01, "friction": 0.3, "core_ratio": 1.0},
                  shear={"compression": 0.3, "relative_rate": 0.05},
                  record={"rows": 12})  # fmt: skip
    whole = soft_particle.start(given, Streams(0, 0))
    whole.advance(6)
    (tmp_path / "state.pickle").write_bytes(pickle.dumps(whole))
    again = pickle.loads((tmp_path / "state.pickle").read_bytes())  # noqa: S301
    whole.advance(7)
    again.advance(7)
    assert whole.done == again.done == 13
    for name, values in whole.columns().items():
        assert np.array_equal(values, again.columns()[name]), name
    assert whole.summary() == again.summary()


def test_blocks_do_not_change_a_run():
    given = point(12, model={"thickness": 0.3}, shear={"compression": 0.1, "relative_rate": 0.05},
                  record={"rows": 10})  # fmt: skip
    whole = finished(given).columns()
    simulation = soft_particle.start(given, Streams(0, 0))
    while simulation.done < simulation.rows:
        simulation.advance(1)
    for name, values in simulation.columns().items():
        assert np.array_equal(values, whole[name]), name


def test_a_job_through_the_runner(tmp_path):
    given = point(12, model={"thickness": 0.3}, shear={"compression": 0.1, "relative_rate": 0.05},
                  record={"rows": 20})  # fmt: skip
    result = read_job(run_job(Job.create(given, seed=1, replicate=0), tmp_path))
    assert len(result.columns["time"]) == 21
    assert result.columns["compression"].max() == pytest.approx(0.1)
    assert result.columns["compression"][-1] == pytest.approx(0.0, abs=1e-12)
    assert result.summary["measured"]["final_force"] > 0
    assert result.summary["status"] == "completed"


def test_plates_that_are_too_soft_stop_the_run(tmp_path):
    """And a run that was stopped has no result."""
    given = point(24, model={"thickness": 0.02, "contact_stiffness": 0.001},
                  shear={"compression": 0.7, "relative_rate": 0.05})  # fmt: skip
    with pytest.raises(
        SimulationError, match=r"stopped at t = .* s \(step \d+\): .* 0 .* or a wall: a"
    ):
        run_job(Job.create(given, seed=0, replicate=0), tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("packing: {vertices: 4}", "must be at least 8"),
        ("packing: {vertices: 10}", "must be a multiple of 4: 8 or 12"),
        ("packing: {vertices: 6}", r"must be a multiple of 4: 8 \("),
        ("packing: {vertices: -3}", r"must be a multiple of 4: 8 \("),
        ("packing: {vertices: 2001}", r"must be a multiple of 4: 2000 \("),
        ("packing: {vertices: 400}", "more than three times as thick"),
        ("shear: {compression: 35}", "not percent"),
        ("integrator: {step: 1.0}", "must be at most 0.9"),
        ("model: {core: none, core_ratio: 1}", "leave one of both out"),
        ("model: {poisson_ratio: 0.6}", "must be less than 0.5"),
    ],
)
def test_impossible_studies(text, message, tmp_path):
    content = text if "model:" in text else f"model: {{}}\n{text}"
    content = content.replace("model: {", "model: {kind: soft_particle, ").replace(", }", "}")
    with pytest.raises(StudyError, match=message):
        read_study(content.encode(), tmp_path / "study.yaml")


@pytest.mark.parametrize(
    ("damping", "message"),
    [(0.2, "yielded to 0.4.* of its length at .* needs steps of .* at most"), (0.0, "has 0.[12]")],
)
def test_bars_that_yield_too_far_stop_a_run(damping, message):
    """A short bar is stiff against its hinges, 16 k_b/ℓ²: steps that were stable explode."""
    simulation = soft_particle.start(
        point(
            vertices=48,
            model={"thickness": 0.05, "yield_force": 2e-4, "damping": damping},
            shear={"compression": 0.5, "relative_rate": 0.02},
            record={"rows": 50},
        ),
        Streams(0, 0),
    )
    with pytest.raises(SimulationError, match=message):
        simulation.advance(100)
    table = simulation.columns()
    assert table["compression"][-1] > 0.15  # after the first yield
    assert np.abs(table["energy_missing"]).max() < 1e-6 * table["work"].max()
