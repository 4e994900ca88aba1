"""A tissue between two grips: how it starts, what a run measures, and its energy balance."""

import pickle

import numpy as np
import pytest
from soft_particles import finished, forces, points

from shear_sim.models import soft_particle
from shear_sim.models.interface import COHESIVE
from shear_sim.models.soft_particle.tension import pulled, ruptured
from shear_sim.results import read_job
from shear_sim.runner import run_job
from shear_sim.snapshots import read_snapshots
from shear_sim.streams import Streams
from shear_sim.study import Job, StudyError, read_study

PACK = {"particles": 30, "vertices": 16, "spread": 0.15, "preparation": "tissue"}
MODEL = {
    "thickness": 0.15, "contact_stiffness": 10.0, "contact_damping": 0.3, "inner_damping": 1.0,
    "friction": 0.3, "drag": 0.0, "links": {"strength": 1.0},
}  # fmt: skip


SHEAR = {"kind": "tension", "strain": 0.1, "relative_rate": 0.005}
point = points(packing=PACK, model=MODEL, shear=SHEAR, record={"rows": 100})


@pytest.fixture(scope="module")
def elastic():
    return finished(point(shear={"strain": 0.12}, record={"rows": 120}))


def test_a_tissue_starts_whole_and_without_stress():
    run = soft_particle.start(point(), Streams(0, 0)).run
    system, made = run.system, run.preparation()
    assert np.abs(forces(system)).max() < 1e-9 * run.unit.bending / run.radius**2
    assert made["width"] * made["height"] == pytest.approx(
        30 * np.pi * (1.075e-3) ** 2, rel=0.03
    )  # to the mid-lines of the grips
    assert 2 * 0.9 * made["sides"] < made["links"] <= 2 * made["sides"]
    assert set(run.pieces()) == {0}
    held = (system.motion.free_x == 0) & (system.motion.free_y == 0)
    assert np.array_equal(np.flatnonzero(held), np.sort([*run.floor, *run.lid]))
    assert np.ptp(system.motion.y[run.lid]) < 1e-15
    assert np.ptp(system.motion.x[run.lid]) > 0.8 * made["width"]


def test_what_a_tension_measures(elastic):
    """Work is the force of the grip over its way; both grips bear the same until it tears."""
    table, made = elastic.columns(), elastic.summary()["preparation"]
    assert table["strain"][-1] == pytest.approx(0.12)
    height = made["height"] * np.exp(table["strain"])
    force = -table["stress_yy"] * made["width"]
    work = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(height))])
    peak = int(force.argmax())
    assert work[peak] == pytest.approx(table["work"][peak], rel=0.05)
    floor, lid = table["stress_floor"][:peak].mean(), table["stress_yy"][:peak].mean()
    assert floor == pytest.approx(lid, rel=0.05)
    unit = elastic.run.unit
    for way in ("yy", "floor"):
        scaled = table[f"stress_{way}"] * 1e-6 / unit.hinge
        assert table[f"stress_{way}_per_bending"] == pytest.approx(scaled)
        assert table[f"stress_{way}_per_modulus"] == pytest.approx(table[f"stress_{way}"] / 1e6)
    assert table["mean_cell_energy"] * 30 * made["link_energy"] == pytest.approx(
        table["energy_stretch"] + table["energy_bend"] + table["energy_core"], rel=1e-9
    )


def test_an_elastic_tissue_breaks(elastic):
    measured = elastic.summary()["measured"]
    assert 0.005 < measured["peak_strain"] < 0.04
    assert measured["peak_strain"] < measured["rupture_strain"] < 0.1  # a strand bears on
    assert 0.3 < measured["crack_share"] <= 1.0


def test_a_crack_by_hand():
    """Everything between a lower and an upper half is broken, and one link far from it."""
    run = soft_particle.start(point(), Streams(0, 0)).run
    links, chains, y = run.system.links, run.system.chains, run.system.motion.y
    middle = np.add.reduceat(y, chains.start[:-1]) / np.diff(chains.start)
    low = (middle < 0.5 * run.start)[chains.chain]
    apart = low[links.vertex] != low[links.segment]
    links.intact[apart] = 0
    assert run.crack() == pytest.approx((1.0, 1.0), abs=0.03)
    assert set(run.pieces()) == {0, 1}
    one, other = chains.chain[links.vertex], chains.chain[links.segment]
    near = np.isin(np.arange(30), [*one[apart], *other[apart]])
    beside = near.copy()
    np.logical_or.at(beside, one, near[other])
    np.logical_or.at(beside, other, near[one])
    away = ~beside[one] & ~beside[other]  # not even linked to a cell of the crack
    links.intact[np.flatnonzero(away)[0]] = 0
    assert run.crack()[0] == pytest.approx(apart.sum() / (apart.sum() + 1))
    assert set(run.pieces()) == {0, 1}


def test_broken_links_lose_what_their_criterion_says(elastic):
    """Σ over links; each is overtaken by less than a step, before or beyond."""
    table, links = elastic.columns(), elastic.run.system.links
    assert table["links_broken"][-1] == (links.intact == 0).sum() > 10
    assert links.lost.sum() == pytest.approx(table["lost_by_breaking"][-1], rel=1e-12)
    assert elastic.summary()["measured"]["breaking_error"] < 2e-3
    # With a + b² = 1 of both, (a² + b²) W₀: from W₀ over 3/4 of it to W₀.
    each = links.lost[links.intact == 0] / elastic.run.link_energy
    assert 0.74 < each.min() < 0.9
    assert 0.97 < each.max() < 1.02


def test_energy_missing_falls_as_the_square_of_the_step():
    """With yield, friction, all dashpots and broken links; 1e-4 of the work is the goal."""
    missing = []
    for step in (0.4, 0.2):
        given = point({"yield_moment": 0.2}, shear={"strain": 0.06}, integrator={"step": step})
        run = finished(given)
        table = run.columns()
        assert table["lost_by_yield"][-1] > 1e-2 * table["work"].max()
        assert table["lost_by_breaking"][-1] > 1e-2 * table["work"].max()
        missing.append(run.summary()["measured"]["energy_missing_ratio"])
    assert missing[1] < 1e-4
    assert missing[1] < 0.5 * missing[0]


def test_a_rupture_is_the_last_fall_of_the_stress():
    """Under a fifth of the largest; not the first dip, and none where the end bears more."""
    stress = np.array([0.0, 1.0, 0.1, 0.5, 0.19, 0.1])
    assert ruptured(stress) == 4
    assert ruptured(stress[:4]) is None


def test_plastic_cells_stretch_before_they_part(elastic):
    run = finished(point({"yield_moment": 0.05}, shear={"strain": 0.2}))
    measured, other = run.summary()["measured"], elastic.summary()["measured"]
    assert measured.get("rupture_strain", 0.2) > 2 * other["rupture_strain"]  # or none yet
    table = run.columns()
    assert table["lost_by_yield"][-1] > 0.3 * table["work"][-1]
    assert table["circularity"][-1] < table["circularity"][0] - 0.02


def test_a_plastic_tissue_bears_less(elastic):
    """The stress of the elastic one, to the bit, until a hinge yields; less after, still unbroken.

    Its energy balance holds, with most of the work lost by yielding, to 1e-4 of the work.
    """
    run = finished(point({"yield_moment": 0.05}, shear={"strain": 0.12}, record={"rows": 120}))
    table, other = run.columns(), elastic.columns()
    stress, larger = pulled(table), pulled(other)
    first = int((table["lost_by_yield"] > 0.0).argmax())
    broken = int((table["links_broken"] + other["links_broken"] > 0.0).argmax())
    assert 3 < first < broken - 10
    assert np.array_equal(stress[:first], larger[:first])
    yielded = slice(first + 3, broken)
    assert np.all(stress[yielded] < larger[yielded])
    assert stress[broken - 1] < 0.85 * larger[broken - 1]
    assert table["lost_by_yield"][-1] > 0.5 * table["work"][-1]
    assert run.summary()["measured"]["energy_missing_ratio"] < 1e-4


def test_a_criterion_of_energies_breaks_interfaces():
    links = {"strength": None, "toughness": 0.02}
    run = finished(point({"links": links}, shear={"strain": 0.05}))
    broken = run.run.system.links.intact == 0
    assert broken.sum() > 10
    assert np.array_equal(broken, broken[run.run.system.links.brother])
    assert run.summary()["measured"]["breaking_error"] < 5e-3


def test_snapshots_hold_links_and_energies(tmp_path):
    """Pairs of forces, summed, are the stress of the grips where nothing moves much."""
    given = point(shear={"strain": 0.01}, record={"rows": 20, "snapshots": [0.9]})
    (tmp_path / "jobs").mkdir()
    result = read_job(run_job(Job.create(given, seed=0, replicate=0), tmp_path / "jobs"))
    [path] = (tmp_path / "jobs").glob("*.parquet")
    [snapshot] = read_snapshots(tmp_path / "snapshots", path.stem)
    made = result.summary["preparation"]
    linked = snapshot.kind == COHESIVE
    assert linked.sum() == made["links"] - result.columns["links_broken"][18]
    assert (snapshot.normal[linked] < 0).mean() > 0.5
    away = snapshot.separation
    distance = np.hypot(*away.T)
    normal, tangential = snapshot.normal / distance, snapshot.tangential / distance
    along = normal * away[:, 1] + tangential * away[:, 0]
    area = made["width"] * made["height"] * np.exp(result.columns["strain"][18])
    assert (along * away[:, 1]).sum() / area == pytest.approx(
        result.columns["stress_yy"][18], rel=0.1
    )
    cells = snapshot.energy.reshape(-1)[np.unique(snapshot.energy, return_index=True)[1]]
    mean = result.columns["mean_cell_energy"][18] * made["link_energy"]
    assert cells.sum() == pytest.approx(30 * mean)
    assert len(snapshot.walls) == 2
    assert snapshot.fixed.sum() > 10


def test_stop_and_go_on_to_the_same_bits():
    given = point({"yield_moment": 0.1}, shear={"strain": 0.05})
    whole = soft_particle.start(given, Streams(0, 0))
    whole.advance(35)
    again = pickle.loads(pickle.dumps(whole))  # noqa: S301
    whole.advance(1000)
    for _ in range(70):
        again.advance(1)
    assert whole.columns()["links_broken"][-1] > whole.columns()["links_broken"][34]
    for name, values in whole.columns().items():
        assert np.array_equal(values, again.columns()[name]), name
    assert whole.summary() == again.summary()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("shear: {kind: tension}", "a tension needs the cells of a tissue"),
        ("packing: {particles: 9}\nshear: {kind: tension}", "only a tissue can be pulled"),
        ("packing: {particles: 9, preparation: tissue}\nshear: {kind: compaction}",
         "a tissue needs shear.kind: tension"),
        ("packing: {particles: 9, preparation: tissue}\nshear: {kind: tension}",
         "without links falls apart"),
        ("packing: {preparation: tissue}", "no effect on a single ring"),
    ],
)  # fmt: skip
def test_impossible_studies(text, message, tmp_path):
    content = f"model: {{kind: soft_particle}}\n{text}"
    with pytest.raises(StudyError, match=message):
        read_study(content.encode(), tmp_path / "study.yaml")


def test_links_that_cannot_be(tmp_path):
    for links, message in (
        ("{strength: 1, toughness: 1}", "give one, and null for the other"),
        ("{strength: null, toughness: 1, exponent: 3}", "exponent has no effect on links that"),
        ("{strength: null, toughness: 1, shear_strength: 2}", "shear_strength has no effect on"),
        ("{}", "only a tissue has links"),
        ("{strength: -1}", "greater than 0"),
    ):
        content = f"model: {{kind: soft_particle, links: {links}}}"
        with pytest.raises(StudyError, match=message):
            read_study(content.encode(), tmp_path / "study.yaml")
