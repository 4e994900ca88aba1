"""Boxes of rings under a lid: how they start, what a run measures, and its energy balance."""

import numpy as np
import pytest
from soft_particles import (
    angular_momentum,
    finished,
    goes_on_to_the_same_bits,
    momentum,
    points,
    prepared,
    prepared_in_parts,
    ring,
    system,
)

from shear_sim.models import soft_particle
from shear_sim.models.soft_particle.packs import scattered_discs, touching_discs
from shear_sim.results import read_job
from shear_sim.runner import run_job
from shear_sim.study import Job, StudyError, read_study

PACK = {"particles": 9, "vertices": 16, "spread": 0.15}
MODEL = {
    "thickness": 0.15, "contact_stiffness": 10.0, "contact_damping": 0.3, "inner_damping": 1.0,
    "drag": 0.0,
}  # fmt: skip


SHEAR = {"kind": "compaction", "strain": 0.25, "relative_rate": 0.01}
point = points(packing=PACK, model=MODEL, shear=SHEAR, record={"rows": 40})


@pytest.mark.parametrize("count", [9, 60])
def test_discs_that_just_touch(count):
    """Nothing overlaps by more than a thousandth, and none but rattlers could be pushed."""
    box = touching_discs(count, 0.15, np.random.default_rng(1))
    apart = np.hypot(box.x[:, None] - box.x, box.y[:, None] - box.y)
    gap = apart - box.radius[:, None] - box.radius
    np.fill_diagonal(gap, np.inf)
    assert gap.min() > -1.1e-3
    sides = np.stack([box.x, box.width - box.x, box.y, box.height - box.y]) - box.radius
    assert sides.min() > -1.1e-3
    touching = (gap < 2e-3).sum(axis=1) + (sides < 2e-3).sum(axis=0)
    assert (touching >= 2).mean() > 0.7
    assert box.radius.mean() == pytest.approx(1.0)
    solid = np.pi * (box.radius**2).sum() / (box.width * box.height)
    assert 0.72 < solid < 0.86  # 0.84 without walls


def test_scattered_discs_touch_nowhere():
    box = scattered_discs(30, 0.15, np.random.default_rng(2))
    apart = np.hypot(box.x[:, None] - box.x, box.y[:, None] - box.y)
    gap = apart - box.radius[:, None] - box.radius
    np.fill_diagonal(gap, np.inf)
    assert gap.min() > 0.0
    assert (box.x - box.radius).min() > 0.0
    assert (box.x + box.radius).max() < box.width


@pytest.fixture(scope="module")
def elastic():
    return finished(point(shear={"strain": 0.4}))


def test_what_a_compaction_measures(elastic):
    """Work is ∫σ dV of the lid; floor and lid bear the same; the way back leads to the start."""
    table = elastic.columns()
    top = int(table["strain"].argmax())
    assert table["strain"][top] == pytest.approx(0.4)
    assert table["strain"][-1] == pytest.approx(0.0, abs=1e-9)
    box, stress = table["box_area"], table["stress_yy"]
    assert np.log(box[0] / box) == pytest.approx(table["strain"], abs=1e-12)
    work = -np.concatenate([[0.0], np.cumsum(0.5 * (stress[1:] + stress[:-1]) * np.diff(box))])
    assert work[top] == pytest.approx(table["work"][top], rel=0.03)
    pressed = table["strain"] > 0.15
    assert table["stress_floor"][pressed] == pytest.approx(stress[pressed], rel=0.2)
    unit = elastic.run.unit
    for way in ("xx", "yy", "floor"):
        scaled = table[f"stress_{way}"] * 1e-6 / unit.hinge
        assert table[f"stress_{way}_per_bending"] == pytest.approx(scaled)
        assert table[f"stress_{way}_per_modulus"] == pytest.approx(table[f"stress_{way}"] / 1e6)
    derived = soft_particle.derive(table)
    assert derived["void_ratio"][top] < 0.2 < derived["void_ratio"][0] < 0.6
    measured = elastic.summary()["measured"]
    assert measured["unloaded_void_ratio"] == pytest.approx(measured["start_void_ratio"], abs=0.02)
    assert measured["solid_share_at_unit"] > 0.1
    assert 0.05 < measured["compressibility_index"] < 0.2


def test_stresses_of_a_box_are_what_its_walls_push():
    """Without dashpots 2 k_n Σ overlap of the vertices at each wall / its length."""
    given = point({"contact_damping": 0.0}, shear={"strain": 0.3, "unload": False})
    simulation = prepared(given)
    simulation.advance(35)
    table, s = simulation.columns(), simulation.run.system
    r, unit = s.chains.radius[0], 2.0 * s.rules.stiffness
    width, height = simulation.run.width, -s.walls.position[3]

    def push(away):
        overlap = np.maximum(r - away, 0.0)
        assert (overlap > 0.0).any()
        return unit * float(overlap.sum())

    sides = push(s.motion.x) + push(width - s.motion.x)
    assert table["stress_xx"][-1] == pytest.approx(0.5 * sides / height, rel=1e-9)
    assert table["stress_yy"][-1] == pytest.approx(push(height - s.motion.y) / width, rel=1e-9)
    assert table["stress_floor"][-1] == pytest.approx(push(s.motion.y) / width, rel=1e-9)


def test_a_lid_sends_no_front_through_the_pack():
    """Particles that barely touch bear the same at lid and floor from the first, some 1e-2 σ*.

    If the lid alone set out, it would push ρ V² over their slack, 0.05 σ*, and the floor nothing.
    """
    run = finished(
        point(
            packing={"particles": 30}, record={"rows": 20},
            shear={"strain": 0.02, "relative_rate": 0.01, "unload": False},
        )
    )  # fmt: skip
    table = run.columns()
    unit = 0.5 * run.run.unit.hinge / run.run.radius**2
    lid, floor = table["stress_yy"].mean() / unit, table["stress_floor"].mean() / unit
    assert 0.0 < lid < 0.03
    assert 0.0 < floor < 0.03


def test_area_of_particles_is_that_of_their_outlines(elastic):
    """V_s = A + P r + π r² of every ring; regular polygons at the start."""
    chains = elastic.run.system.chains
    r = chains.radius[0]
    sides = np.add.reduceat(chains.rest_length, chains.start[:-1])
    expected = (chains.core_area + sides * r + np.pi * r**2).sum()
    table = elastic.columns()
    assert table["solid_area"][0] == pytest.approx(expected)
    n = PACK["vertices"]
    assert table["circularity"][0] == pytest.approx(np.pi / n / np.tan(np.pi / n))
    assert table["circularity"].min() < table["circularity"][0] - 0.02


def test_energy_missing_falls_as_the_square_of_the_step():
    """With yield, friction and all dashpots; 1e-4 of the work is the goal."""
    missing = []
    for step in (0.4, 0.2):
        given = point(
            {"yield_moment": 0.3, "friction": 0.2, "core_ratio": 1.0},
            shear={"strain": 0.15, "relative_rate": 0.02}, integrator={"step": step},
        )  # fmt: skip
        run = finished(given)
        measured = run.summary()["measured"]
        table = run.columns()
        assert table["lost_by_yield"][-1] > 1e-3 * table["work"].max()
        assert table["lost_by_friction"][-1] > 1e-3 * table["work"].max()
        missing.append(measured["energy_missing_ratio"])
    assert missing[1] < 1e-5
    assert missing[1] < 0.35 * missing[0]


def test_rings_that_cannot_be_compressed_fill_the_pores():
    """With a hard core V_s stays: e = (1 + e₀) exp(−ε) − 1; the lid turns at its stress."""
    run = finished(point({"core_ratio": 100.0}, shear={"largest_stress": 2.0, "strain": 0.4}))
    table = run.columns()
    void = soft_particle.derive(table)["void_ratio"]
    assert void == pytest.approx((1 + void[0]) * np.exp(-table["strain"]) - 1, abs=0.006)
    measured = run.summary()["measured"]
    assert 2.0 <= measured["final_stress_per_bending"] < 4.0
    assert measured["final_strain"] < 0.39
    assert run.done == run.rows < 41
    assert table["strain"][-1] == pytest.approx(0.0, abs=1e-9)


def test_a_lid_turns_at_the_first_record_of_its_stress():
    """So the stress is passed by what a record adds: with four times as many by far less."""
    passed = []
    for rows in (20, 80):
        shear = {"largest_stress": 1.0, "strain": 0.4, "unload": False}
        run = finished(point({"core_ratio": 100.0}, shear=shear, record={"rows": rows}))
        *before, top = run.columns()["stress_yy_per_bending"]
        assert run.done == run.rows < rows
        assert max(before) < 1.0 <= top
        passed.append((top - 1.0, top - before[-1]))
    assert passed[0][0] < passed[0][1]
    assert passed[1][0] < passed[1][1] < 0.5 * passed[0][1]


def test_plastic_rings_stay_crushed():
    run = finished(point({"yield_moment": 0.02}, shear={"strain": 0.2}))
    measured = run.summary()["measured"]
    table = run.columns()
    top = int(table["strain"].argmax())
    assert table["lost_by_yield"][top] > 0.5 * table["work"][top]
    assert table["work"][-1] > 0.95 * table["work"][top]  # nothing is given back
    assert measured["final_circularity"] < table["circularity"][0] - 0.02


def test_damping_inside_slows_no_particle():
    """Moving and turning as a whole costs nothing; a change of shape does, at no net force."""
    s = system(ring(12, inner_damping=0.5))
    x, y = s.motion.x, s.motion.y
    s.motion.vx[:], s.motion.vy[:] = 3e-3 - 2e-4 * y, -1e-3 + 2e-4 * x
    s._forces(s.rules)
    assert np.abs([s.motion.dx, s.motion.dy]).max() < 1e-17
    rng = np.random.default_rng(4)
    s.motion.vx[:] += rng.normal(0.0, 1e-4, 12)
    s.motion.vy[:] += rng.normal(0.0, 1e-4, 12)
    s._forces(s.rules)
    force = np.array([s.motion.dx, s.motion.dy])
    assert np.abs(force).max() > 1e-5
    assert force.sum(axis=1) == pytest.approx([0.0, 0.0], abs=1e-16)
    assert (x * force[1] - y * force[0]).sum() == pytest.approx(0.0, abs=1e-16)
    before = momentum(s), angular_momentum(s)
    s.begin()
    s.advance(200)
    assert momentum(s) == pytest.approx(before[0], rel=1e-12)
    assert angular_momentum(s) == pytest.approx(before[1], rel=1e-11)
    assert s.budget().damping > 1e-8
    assert abs(s.budget().missing) < 1e-3 * s.budget().damping


def test_rings_that_fell(tmp_path):
    """At rest but for what the lid gives them, without weight; the job's table is whole."""
    given = point(packing={"preparation": "gravity"}, shear={"strain": 0.1, "unload": False})
    simulation = prepared(given, 3)
    run, system_ = simulation.run, simulation.run.system
    motion = system_.motion
    given_by_lid = -run.speed * motion.y / run.start
    assert motion.vy == pytest.approx(given_by_lid, abs=1e-12 * run.speed)
    assert np.abs(motion.vx).max() < 0.01 * run.speed
    assert np.abs(motion.gy).max() == 0.0
    assert system_.rules.drag == 0.0
    result = read_job(run_job(Job.create(given, seed=3, replicate=0), tmp_path))
    assert result.columns["time"][0] == 0.0
    assert len(result.columns["time"]) == 41
    assert result.columns["strain"][-1] == pytest.approx(0.1)
    assert result.summary["preparation"]["settling_time"] > 0
    assert result.summary["measured"]["start_void_ratio"] < 0.9


def test_rings_that_fall_yield_under_the_lid_only():
    """Under their weight, 0.1 σ*, rings that yield at 0.05 σ* would be flat before they start."""
    given = point({"yield_moment": 0.02}, {"preparation": "gravity"}, {"strain": 0.1})
    plastic = prepared(given, 3)
    elastic = prepared(point(packing={"preparation": "gravity"}, shear={"strain": 0.1}), 3)
    assert (plastic.run.system.motion.x == elastic.run.system.motion.x).all()
    assert (plastic.run.system.chains.moment == elastic.run.system.chains.moment).all()
    plastic.advance(10)
    assert plastic.columns()["lost_by_yield"][-1] > 0.0


def test_a_fall_may_be_stopped_and_shared():
    """Nothing falls before it is asked to; in parts, from a file, on two threads: same bits."""
    assert prepared_in_parts(point(packing={"preparation": "gravity", "rigid_share": 0.3})) > 2


def test_rigid_particles_keep_their_shape():
    """To round-off, while the others give way more; nothing is stored in them."""
    soft = finished(point(shear={"strain": 0.1, "unload": False}))
    given = point(
        {"friction": 0.2}, {"rigid_share": 0.5}, shear={"strain": 0.1, "unload": False},
        record={"rows": 40, "snapshots": [1]},
    )  # fmt: skip
    run = finished(given)
    system_, rigid = run.run.system, run.run.rigid
    assert len(rigid) == 4  # of 9
    chains, motion = system_.chains, system_.motion
    length = np.hypot(motion.x[chains.after] - motion.x, motion.y[chains.after] - motion.y)
    strain = np.abs(length / chains.rest_length - 1)
    held = np.isin(chains.chain, rigid)
    assert strain[held].max() < 1e-11
    assert strain[~held].max() > 1e-5
    energies = system_.particle_energies()
    assert energies[rigid].max() < 1e-12 * energies.max()
    turned = np.abs(system_.rigid.angle)
    assert turned.max() > 1e-3
    measured = run.summary()["measured"]
    assert measured["energy_missing_ratio"] < 1e-4
    assert run.columns()["stress_yy"][-1] > 1.5 * soft.columns()["stress_yy"][-1]
    assert not run.snapshots[-1].fixed.any()  # they do move
    more = prepared(point(packing={"rigid_share": 0.8})).run.rigid
    assert set(rigid) < set(more)  # so that studies of the share compare in pairs


def test_a_lid_under_a_load():
    """Lid and floor bear what is imposed, and it does the same work and strain as a slow lid."""
    slow = {"relative_rate": 0.01}
    driven = finished(point(shear=slow | {"strain": 0.6, "largest_stress": 1.0}))
    run = finished(point(shear=slow | {"control": "load", "strain": 0.6, "largest_stress": 1.0}))
    table = run.columns()
    assert len(table["time"]) == 41
    top = 20
    assert int(table["strain"].argmax()) in (top - 1, top, top + 1)
    period = run.run.unit.period
    ramp = np.interp(table["time"], np.array([0, 100, 200]) * period, [0, 1, 0])
    imposed = table["imposed_stress_per_bending"]
    assert imposed[1:] == pytest.approx(ramp[1:], abs=0.5 / 20 / 10 * 1.01)
    unit = run.run.unit.hinge / run.run.radius**2
    assert table["imposed_stress"] == pytest.approx(imposed * unit)
    assert table["imposed_stress_per_modulus"] == pytest.approx(imposed * unit / 1e6)
    assert table["stress_yy_per_bending"][3:-2] == pytest.approx(imposed[3:-2], abs=0.03)
    assert table["stress_floor_per_bending"][3:-2] == pytest.approx(imposed[3:-2], abs=0.08)
    work = np.trapezoid(table["imposed_stress"][: top + 1], -table["box_area"][: top + 1])
    assert table["work"][top] == pytest.approx(work, rel=0.03)
    loading = driven.columns()
    there = int(loading["strain"].argmax())
    strain = np.interp(
        [0.2, 0.5, 0.9],
        loading["stress_yy_per_bending"][: there + 1],
        loading["strain"][: there + 1],
    )
    found = np.interp([0.2, 0.5, 0.9], imposed[: top + 1], table["strain"][: top + 1])
    assert found == pytest.approx(strain, abs=0.02)
    assert run.summary()["measured"]["energy_missing_ratio"] < 1e-4


def test_a_loaded_lid_turns_at_its_strain():
    shear = {"control": "load", "strain": 0.1, "largest_stress": 1.0, "relative_rate": 0.02}
    run = finished(point(shear=shear))
    table = run.columns()
    assert run.done == run.rows < 41
    top = (run.rows - 1) // 2
    assert table["strain"][top] >= 0.1 > table["strain"][top - 1]
    imposed = table["imposed_stress"]
    assert 0.0 < imposed[-1] < 0.1 * imposed[1]
    assert imposed.max() < 0.9 * run.run.unit.hinge / run.run.radius**2


@pytest.mark.parametrize(
    "given",
    [
        point({"yield_moment": 0.1, "friction": 0.3}, shear={"strain": 0.1}),
        point(
            {"friction": 0.3}, {"rigid_share": 0.4},
            shear={"control": "load", "largest_stress": 0.3, "relative_rate": 0.02},
        ),
    ],
)  # fmt: skip
def test_stop_and_go_on_to_the_same_bits(given):
    goes_on_to_the_same_bits(given, 15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("packing: {particles: 9}", "needs shear.kind: compaction"),
        ("shear: {kind: compaction}", "needs a box of rings"),
        ("packing: {spread: 0.1}", "no effect on a single ring"),
        ("packing: {preparation: gravity}", "no effect on a single ring"),
        ("packing: {rigid_share: 0.1}", "no effect on a single ring"),
        (
            "shear: {kind: oscillatory}\npacking: {particles: 30, rigid_share: 0.1}",
            "rigid particles are for a box under a lid",
        ),
        ("shear: {kind: compaction, control: load}\npacking: {particles: 9}", "needs the stress"),
        ("shear: {kind: compaction, compression: 0.2}\npacking: {particles: 9}", "compression"),
    ],
)
def test_impossible_studies(text, message, tmp_path):
    content = f"model: {{kind: soft_particle}}\n{text}"
    with pytest.raises(StudyError, match=message):
        read_study(content.encode(), tmp_path / "study.yaml")
