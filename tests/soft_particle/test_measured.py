"""Scales by hand, and what is kept of runs, from tables that are made up."""

import numpy as np
import pytest
from soft_particles import points, prepared

from shear_sim.models.soft_particle.columns import COLUMNS, DERIVED
from shear_sim.models.soft_particle.parameters import SoftParticle
from shear_sim.models.soft_particle.rings import scales


def made_up(rows, **columns):
    """A table of which all columns but the given ones are of no use."""
    return {column.name: np.full(rows, np.nan) for column in COLUMNS} | columns


def test_every_stress_is_also_in_units_of_the_shell():
    names = [column.name for column in COLUMNS + DERIVED]
    stresses = [column.name for column in COLUMNS + DERIVED if column.unit == "Pa"]
    assert len(stresses) > 8
    for name in stresses:
        assert {f"{name}_per_modulus", f"{name}_per_bending"} <= set(names)


def test_scales_by_hand():
    """(SP.1), (SP.2) with E h³/12 (1 − ν²), masses of π R², ω₁² = 36 EI/5 ρ_l R⁴."""
    young, poisson, thick, radius, density, n = 2e5, 0.3, 0.08, 3e-3, 700.0, 20
    model = SoftParticle(
        young_modulus=young, poisson_ratio=poisson, thickness=thick, density=density,
        core_ratio=5.0, contact_stiffness=12.0,
    )  # fmt: skip
    unit = scales(model, n, radius)
    h = thick * radius
    bending = young * h**3 / (12 * 0.91)
    segment = 2 * radius * np.sin(np.pi / n)
    shell = young * h / (0.91 * segment) * np.tan(np.pi / n)
    per_length = density * np.pi * radius**2 / (2 * np.pi * radius)
    frequency = np.sqrt(7.2 * bending / per_length) / radius**2
    expected = (
        bending, segment, bending / segment, shell, 5 * shell, density * np.pi * radius**2 / n,
        frequency, 12 * bending / segment**3,
    )  # fmt: skip
    assert tuple(unit) == pytest.approx(expected)
    assert unit.period == pytest.approx(2 * np.pi / frequency)


def test_what_is_kept_of_a_compaction():
    """e = a − C log₁₀ σ/σ*, σ* = k_b/2R²; there and back, with losses and works that are known."""
    run = prepared(
        points(packing={"particles": 9, "vertices": 16}, model={"thickness": 0.15},
               shear={"kind": "compaction"}, record={"rows": 40})()
    ).run  # fmt: skip
    strain = np.concatenate([np.linspace(0, 0.3, 21), np.linspace(0.285, 0, 20)])
    stress = 10 ** (8 * strain - 2)  # σ/σ*: 0.01 to 2.5, 1 at ε = 1/4
    void = 0.2 - 0.07 * np.log10(stress)
    solid = 5.0 - 2.0 * strain
    work = np.concatenate([np.linspace(0, 8, 21), np.linspace(7, 1, 20)])
    table = made_up(
        41, strain=strain, stress_yy_per_bending=0.5 * stress, solid_area=solid,
        box_area=(1 + void) * solid, work=work, circularity=1 - strain,
        energy_kinetic=np.where(strain > 0.0, 1e-3 * stress, 1.0),
        energy_stretch=0.1 * stress, energy_bend=0.2 * stress, energy_core=0.3 * stress,
        energy_contact=0.4 * stress, energy_missing=np.where(strain == 0.3, -4e-4, 0.0),
        lost_by_drag=np.linspace(0, 1, 41),
    )  # fmt: skip
    share = (5.0 - solid[20]) / (table["box_area"][0] - table["box_area"][20])
    at_unit = 0.5 / (table["box_area"][0] - 1.2 * 4.5)
    found = run.measured(table)
    expected = {
        "start_void_ratio": 0.34, "final_strain": 0.3, "final_stress_per_bending": 0.5 * 10**0.4,
        "final_void_ratio": 0.2 - 0.07 * 0.4, "final_solid_share": share, "final_circularity": 0.7,
        "energy_missing_ratio": 5e-5, "drag_ratio": 0.5 / 8, "kinetic_ratio": 1e-3 * 10**0.4 / 8,
        "compressibility_index": 0.07, "void_ratio_at_unit": 0.2, "solid_share_at_unit": at_unit,
        "unloaded_void_ratio": void[-1],
    }  # fmt: skip
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=1e-3), name


def test_what_is_kept_of_a_tension():
    """A stress that falls under a fifth of its peak twice, for good at row 9; a wave on the lid."""
    run = prepared(
        points(packing={"particles": 16, "vertices": 16, "preparation": "tissue"},
               model={"thickness": 0.15, "links": {"strength": 1}}, shear={"kind": "tension"},
               record={"rows": 12})()
    ).run  # fmt: skip
    pull = np.array([0, 1, 2, 3, 4, 5, 4, 0.5, 1.1, 0.9, 0.4, 0.2, 0.1])
    wave = np.array([0, 1, -1, 3, -1, 0, 1, -1, -1, 1, -1, 1, -1])
    strain = np.linspace(0, 0.12, 13)
    table = made_up(
        13, strain=strain, stress_yy_per_bending=-0.1 * (pull + wave),
        stress_floor_per_bending=-0.1 * (pull - wave),
        work=np.linspace(0, 6, 13), links_broken=np.zeros(13), lost_by_drag=np.linspace(0, 0.3, 13),
        energy_kinetic=np.full(13, 0.02), energy_missing=np.linspace(0, -6e-5, 13),
        energy_stretch=pull, energy_bend=pull, energy_core=pull, energy_contact=pull,
        energy_links=pull,
    )  # fmt: skip
    assert run.measured(table) == pytest.approx(
        {
            "peak_stress_per_bending": 0.5, "peak_strain": 0.05, "links_broken": 0.0,
            "energy_missing_ratio": 1e-5, "drag_ratio": 0.05, "kinetic_ratio": 0.02 / 2.5,
            "rupture_strain": 0.09,
        }
    )  # fmt: skip
    table["stress_floor_per_bending"][-1] = -0.5
    assert "rupture_strain" not in run.measured(table)


def test_links_of_a_study_are_as_strong_as_it_says():
    """f_n⁰ of EI/R², k of links of that of contacts, G_c of EI/R²; W₀ by hand."""

    def made(**links):
        packing = {"particles": 9, "vertices": 16, "preparation": "tissue"}
        model = {"thickness": 0.2, "contact_stiffness": 20.0, "links": links}
        return prepared(points(packing=packing, model=model, shear={"kind": "tension"})()).run

    bending = 1e6 * (0.2e-3) ** 3 / 12
    force = bending / 1e-6
    contact = 20 * bending / (2e-3 * np.sin(np.pi / 16)) ** 3
    run = made(strength=3.0, shear_strength=0.5, exponent=1.5, tangential_stiffness=0.2)
    law = (0.1 * contact, 0.2 * contact, 3 * force, 1.5 * force, 1.5, 0.0)
    assert run.system.links.law == pytest.approx(law)
    assert run.link_energy == pytest.approx(0.5 * (3 * force) ** 2 / (0.1 * contact))
    run = made(strength=None, toughness=0.04, stiffness=0.3)
    assert run.system.links.law[[0, 5]] == pytest.approx((0.3 * contact, 0.04 * force))
    length = run.system.links.length.mean()
    assert run.link_energy == pytest.approx(0.5 * 0.04 * force * length)


@pytest.mark.parametrize(
    ("shear", "packing"),
    [
        ("diametral_compression", {}),
        ("compaction", {"particles": 9}),
        ("tension", {"particles": 9, "preparation": "tissue"}),
        ("oscillatory", {"particles": 12, "packing_fraction": 0.8}),
    ],
)
def test_contacts_of_a_study_are_as_stiff_as_it_says(shear, packing):
    """k_n in k_b/ℓ², k_t in k_n, β = ζ √(m/k_n)/r, whatever is done to the particles."""
    model = {
        "thickness": 0.2, "contact_stiffness": 15.0, "tangential_ratio": 0.4, "friction": 0.25,
        "contact_damping": 0.1, "drag": 0.3,
    }  # fmt: skip
    if shear == "tension":
        model["links"] = {}
    packing = {"vertices": 16} | packing
    rules = prepared(points(packing=packing, model=model, shear={"kind": shear})()).run.system.rules
    unit = scales(SoftParticle(**model), 16, 1e-3)
    expected = (
        unit.stiffness, 0.4 * unit.stiffness, 0.25,
        0.1 * np.sqrt(unit.mass / unit.stiffness) / 1e-4, 0.3 * unit.mass * unit.frequency,
    )  # fmt: skip
    assert tuple(rules)[:5] == pytest.approx(expected)


def test_what_is_kept_of_a_vibration():
    """Frequency from zeros, drift from a line: per 1,000 periods, over the energy at the start."""
    run = prepared(points(packing={"vertices": 12}, model={"thickness": 0.2},
                          shear={"kind": "vibration", "periods": 10})()).run  # fmt: skip
    rows = run.rows
    periods = np.linspace(0, 10, rows)
    missing = run.energy * (3e-6 * periods + 1e-7 * np.sin(40 * periods))
    found = run.measured(
        made_up(rows, time=periods * run.unit.period, energy_missing=missing,
                ovality=np.sin(2 * np.pi * 0.97 * periods))
    )  # fmt: skip
    assert found["frequency_ratio"] == pytest.approx(0.97, rel=1e-3)
    assert found["energy_drift"] == pytest.approx(3e-3, rel=0.02)
    assert found["energy_missing_ratio"] == pytest.approx(3e-5, rel=0.01)


@pytest.mark.parametrize("yields", [{}, {"yield_moment": 0.05}, {"yield_force": 0.05}])
def test_what_is_kept_of_a_compression(yields):
    """The line where loads are 2.5 segments apart, if nothing yields; what drag takes."""
    model = {"thickness": 0.1} | yields
    run = prepared(
        points(packing={"vertices": 40}, model=model,
               shear={"kind": "diametral_compression"}, record={"rows": 60})()
    ).run  # fmt: skip
    strain = np.concatenate([np.linspace(0, 0.5, 31), np.linspace(0.49, 0, 30)])
    apart = np.where(strain > 0.3, 2.0 * (strain - 0.25), 0.01)
    work = np.concatenate([np.linspace(0, 5, 31), np.linspace(4.9, 2, 30)])
    last = strain[28]  # of 30 records, as plates brake in the last twentieth of their way
    number = np.arange(61)
    fast = 0.01 * work * np.where((number >= 6) & (number <= 28), 1.0, 9.0)
    fast[10] *= 1.5
    table = made_up(
        61, compression=strain, load_ratio=apart, work=work, force=10 * strain,
        scaled_force=7 * strain, area_ratio=1 - strain, contact_ratio=strain / 2,
        energy_missing=-1e-6 * strain, lost_by_drag=np.linspace(0, 0.2, 61),
        energy_kinetic=fast, energy_contact=1e-5 * strain,
    )  # fmt: skip
    found = run.measured(table)
    sunk = 1e-6 / (run.radius * np.cos(np.pi / 40) * (1 - last))
    expected = {
        "sink_ratio": sunk,
        "final_compression": last, "final_force": 10 * last, "final_scaled_force": 7 * last,
        "final_area_ratio": 1 - last, "final_contact_ratio": last / 2, "kinetic_ratio": 0.015,
        "energy_missing_ratio": 1e-7, "drag_ratio": 0.02,
        "residual_compression": 0.0,
        "recovered_work": 0.6, "fold_ratio": 2 * np.tan(np.pi / 40) / (1 - 0.4),
    }  # fmt: skip
    line = {} if yields else {"contact_onset": 0.25, "contact_slope": 2.0}
    assert found == pytest.approx(expected | line, abs=1e-9)


def test_what_is_kept_of_a_suspension():
    """Shares of what is lost in the last period, and what is missing of that."""
    run = prepared(
        points(packing={"particles": 12, "vertices": 12, "packing_fraction": 0.9},
               model={"thickness": 0.2},
               shear={"kind": "oscillatory", "periods": 2})()
    ).run  # fmt: skip
    period = np.linspace(0, 2, 401)
    table = made_up(
        401, stress_yy_per_bending=3 + period, work=50 * period, lost_by_yield=4 * period**2,
        lost_by_friction=2 * period**2, lost_by_damping=period**2, lost_by_drag=3 * period**2,
        energy_missing=-1e-3 * period,
    )  # fmt: skip
    assert run.measured(table) == pytest.approx(
        {
            "start_stress_per_bending": 3.0, "energy_missing_ratio": 2e-5,
            "cycle_missing_ratio": 1e-3 / 30, "yield_loss_share": 0.4, "friction_loss_share": 0.2,
            "damping_loss_share": 0.1, "drag_loss_share": 0.3,
        }
    )  # fmt: skip
