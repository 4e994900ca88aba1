"""Invariances: translation, boosts, numbering, image choice, re-gridding, reflection, units."""

import numpy as np
import pytest
from scenes import (
    UNDAMPED,
    evaluate,
    finish,
    packing_point,
    prepared,
    scene,
    steady,
)

from shear_sim.models.microgel import motion
from shear_sim.models.microgel.parameters import Links
from shear_sim.models.microgel.simulation import MicrogelSimulation, make_pairs
from shear_sim.models.microgel.state import NX, NY, column, listed, set_column
from shear_sim.packing import Cell
from shear_sim.protocol import OscillatoryShear

PERIODIC = [f"periodic_overall_{ab}" for ab in ("xx", "xy", "yx", "yy")]
CELL = Cell(width=500e-6, height=400e-6)


def base(cut="cells", shear=None, **more):
    """30 discs, friction and links, in a rectangular cell."""
    more.setdefault("friction", 0.3)
    return prepared(
        packing_point(
            discs=30, links=Links(cut=cut), cell=CELL, shear=shear or steady(0.3, rate=0.01), **more
        )
    )


def copy(simulation, *, order=None, discs=None, images=None, constants=None, clock=None):
    """Return a simulation of the same instant with something changed; ``order`` renumbers."""
    s = simulation
    d = s.discs if discs is None else discs
    order = np.arange(len(d.x)) if order is None else order
    new = np.argsort(order)
    given = listed(s.links)
    links = new[np.column_stack([given.i, given.j])]
    shift = np.column_stack([given.nx, given.ny]) if images is None else images
    return MicrogelSimulation(
        s.point, s.kernels, type(d)(*(a[order].copy() for a in d)), make_pairs(links, shift),
        make_pairs(), constants or s.constants, clock or s.clock, {},
    )  # fmt: skip


def agree(a, b, names=PERIODIC, tolerance=1e-9):
    """Compare series relative to the pressure; round-off grows along a run of sliding contacts."""
    scale = np.abs(a["periodic_overall_xx"]).max()
    for name in names:
        assert np.abs(a[name] - b[name]).max() < tolerance * scale, name


@pytest.mark.parametrize("cut", ["none", "cells"])
@pytest.mark.parametrize("shift", [(123e-6, 0.0), (0.0, 57e-6), (-333e-6, 211e-6)])
def test_translation(cut, shift):
    """Shift all discs by any vector: the periodic tensor stays, although edges cut other pairs.

    A shift in y comes with its affine velocity, γ̇ b for every disc: peculiar velocities stay.
    The tensors of the cell's inside and outside do change, which is why they are not the stress.
    """
    here = base(cut)
    d = here.discs
    there = copy(here, discs=d._replace(x=d.x + shift[0], y=d.y + shift[1]))
    a, b = finish(copy(here)), finish(there)
    agree(a, b)
    change = np.abs(a["overall_xx"] - b["overall_xx"]).max()
    assert change > 1e-3 * np.abs(a["overall_xx"]).max()


def test_translation_in_the_lab_frame():
    """The affine velocity that goes with a shift in y is the lab's u += γ̇ b, seen as positions.

    Lab velocity = Δx/Δt of a step. A disc that is brought back through the top also loses γ̇ L_y.
    """
    here = base("none")
    b = 57e-6
    d = here.discs
    velocity = []
    for s in (copy(here), copy(here, discs=d._replace(y=d.y + b))):
        s.advance(1)
        before = s.discs.x.copy(), s.discs.y.copy()
        s.advance(1)
        velocity.append((s.discs.x - before[0], s.discs.y - before[1]) / np.array(s.clock.step))
    rate = here.clock.amplitude / here.clock.step
    across = rate * CELL.height
    du, dv = velocity[1] - velocity[0]
    assert np.abs(np.remainder(du - rate * b + across / 2, across) - across / 2).max() < (
        1e-9 * across
    )
    assert np.abs(dv).max() < 1e-9 * across


@pytest.mark.parametrize("boost", [(1.0, 0.0), (0.0, 1.0), (-0.7, 0.4)])
def test_galilean_boost(boost):
    """A common velocity changes nothing but the flux tensor, if nothing drags (C = 1).

    In the sheared cell a boost in y wanders through the flow: c_x changes by −γ̇ c_y t for all.
    """
    here = base("cells", damping=UNDAMPED)
    d = here.discs
    speed = 1e-2 * CELL.width / (here.clock.step * here.clock.per_period)
    d2 = d._replace(cx=d.cx + boost[0] * speed, cy=d.cy + boost[1] * speed)
    a, b = finish(copy(here)), finish(copy(here, discs=d2))
    agree(a, b)
    assert np.abs(a["peculiar_xx"] - b["peculiar_xx"]).max() > 0


def test_isolated_cluster_is_translation_and_boost_invariant():
    """With open edges all tensors of forces stay: the lever arms' origin drops out of ΣF = 0."""
    position = np.array([(0, 0), (1.7, 0.1), (0.9, 1.5), (2.5, 1.6)])

    def tensors(shift, boost):
        velocity = np.array([(0.1, 0), (-0.2, 0.3), (0.4, 0.1), (0, -0.2)]) + boost
        c = finish(
            scene(
                position + shift, 1.0, velocity=velocity, links=[(0, 1), (1, 2)], k=5.0, kt=2.0,
                eta=0.1, etat=0.1, friction=0.4, step=0.02, steps=300, skin=0.4,
            )
        )  # fmt: skip
        return np.array([c[f"overall_{ab}"] for ab in ("xx", "xy", "yx", "yy")])

    a = tensors(0.0, 0.0)
    for shift, boost in (((70.0, -33.0), 0.0), (0.0, (1.5, -0.7)), ((9.0, 4.0), (0.3, 2.0))):
        assert np.abs(tensors(shift, boost) - a).max() < 1e-11 * np.abs(a).max()


def test_renumbering():
    """A force that is not antisymmetric, or a rule that visits discs in turn, would show."""
    here = base("cells")
    order = np.random.default_rng(5).permutation(30)
    agree(finish(copy(here)), finish(copy(here, order=order)))


def test_choice_of_image_is_irrelevant():
    """The same packing, each disc in any image of the cell, links keyed accordingly."""
    here = base("cells")
    rng = np.random.default_rng(2)
    wx, wy = rng.integers(-2, 3, (2, 30))
    d, p = here.discs, listed(here.links)
    there = d._replace(x=d.x + wx * CELL.width, y=d.y + wy * CELL.height)
    images = np.column_stack([p.nx - wx[p.j] + wx[p.i], p.ny - wy[p.j] + wy[p.i]])
    agree(finish(copy(here)), finish(copy(here, discs=there, images=images)))


def shift(simulation, turns):
    """Name the images of all pairs as after a re-gridding by ``turns`` widths."""
    for pairs in (simulation.links, simulation.contacts):
        set_column(pairs, NX, column(pairs, NX) + turns * column(pairs, NY))


def test_strain_plus_one_lattice_period_is_the_same_lattice():
    """γ and γ + L_x/L_y: forces, torques and tensors of one instant agree, links and springs too.

    Here the images of all pairs, links included, have to be renamed by n_x −= n_y.
    """
    here = copy(base("cells"))
    here.advance(20)
    strain, rate = here._table[here.done - 1, 1:3]
    a = evaluate(here, strain, rate)
    assert (listed(here.links).ny != 0).any()
    assert np.abs(here.pairs.spring).max() > 0
    shift(here, -1)  # the upper image lies a width farther now
    b = evaluate(here, strain + CELL.width / CELL.height, rate)
    shift(here, 1)
    scale = np.abs(a.force).max()
    assert np.abs(a.force - b.force).max() < 1e-11 * scale
    assert np.abs(a.torque - b.torque).max() < 1e-11 * np.abs(a.torque).max()
    assert np.abs(a.sums - b.sums).max() < 1e-11 * np.abs(a.sums).max()


@pytest.mark.parametrize("turns", [1, 3])
def test_regridding_keeps_springs_and_images(turns):
    """A new list at the same instant, with the cell re-gridded by whole widths: nothing jumps."""
    here = copy(base("cells"))
    here.advance(20)
    strain, rate = here._table[here.done - 1, 1:3]
    a = evaluate(here, strain, rate)
    # Rename as if the lattice had never been re-gridded on the way to a strain of `turns` more.
    here.work.turns[0] -= turns
    shift(here, -turns)
    springs = np.sort(here.pairs.spring[here.pairs.spring != 0])
    here.contacts = motion.renew_contacts(
        here.discs, here.work, here.links, here.contacts, here.constants, strain
    )
    assert here.work.turns[0] == round(strain * CELL.height / CELL.width)
    assert np.array_equal(np.sort(here.pairs.spring[here.pairs.spring != 0]), springs)
    b = evaluate(here, strain, rate)
    assert np.abs(a.force - b.force).max() < 1e-11 * np.abs(a.force).max()
    assert np.abs(a.sums - b.sums).max() < 1e-11 * np.abs(a.sums).max()


def test_run_across_a_regridding():
    """Steady shear through γ L_y/L_x = 1/2, where the cell is re-gridded, has no jump there.

    The same run shifted by (L_x/2, L_y/2) is wrapped and re-gridded with other pairs at the edge.
    """
    shear = steady(0.8 * CELL.width / CELL.height, rate=0.01)
    here = base("cells", shear=shear)
    d = here.discs
    there = copy(here, discs=d._replace(x=d.x + CELL.width / 2, y=d.y + CELL.height / 2))
    a = finish(here)
    assert here.work.turns[0] == 1
    agree(a, finish(there), tolerance=1e-6)
    jumps = np.abs(np.diff(a["shear_stress"]))
    at = np.searchsorted(a["strain"], 0.5 * CELL.width / CELL.height)
    assert jumps[at - 2 : at + 2].max() < 5 * np.median(jumps)


def test_reflection():
    """x → −x with γ → −γ and ω → −ω: the shear stress changes sign, the rest stays."""
    here = base("cells")
    d, p = here.discs, listed(here.links)
    mirrored = d._replace(x=CELL.width - d.x, cx=-d.cx, spin=-d.spin)
    images = np.column_stack([-p.nx, p.ny])
    back = here.clock._replace(amplitude=-here.clock.amplitude)
    a, b = finish(copy(here)), finish(copy(here, discs=mirrored, images=images, clock=back))
    for ab, sign in (("xx", 1), ("xy", -1), ("yx", -1), ("yy", 1)):
        name = f"periodic_overall_{ab}"
        assert np.abs(a[name] - sign * b[name]).max() < 1e-9 * np.abs(a["pressure"]).max()


SHORT = OscillatoryShear(strain_amplitude=0.3, pre_periods=0.1, periods=0.5, post_periods=0.1)


def series(seed=0, packing=None, **model):
    model = {"friction": 0.3} | model
    point = packing_point(discs=30, links=Links(cut="cells"), shear=SHORT, packing=packing, **model)
    return finish(prepared(point, seed))


@pytest.mark.parametrize("n", [1, 3, -2])
def test_modulus_times_a_power_of_four_scales_every_stress_to_the_bit(n):
    """k ∝ E, τ ∝ E^(−1/2): a constant with a hidden unit (a tolerance, a step) would show."""
    a, b = series(), series(young_modulus=8000.0 * 4.0**n)
    for name, values in a.items():
        factor = 1.0
        if name == "time":
            factor = 2.0**-n
        elif name == "strain_rate":
            factor = 2.0**n
        elif name not in ("strain", "coordination", "sliding_fraction"):
            factor = 4.0**n
        assert np.array_equal(b[name], values * factor), name


@pytest.mark.parametrize("factor", [3.0, 0.37])
def test_modulus_scales_stresses_to_rounding(factor):
    """From the same instant, so that round-off has no relaxation to grow in."""
    here = base("cells", shear=SHORT)
    there = base("cells", shear=SHORT, young_modulus=8000.0 * factor)
    d = here.discs
    there = copy(there, discs=there.discs._replace(x=d.x.copy(), y=d.y.copy()))
    a, b = finish(copy(here)), finish(there)
    scaled = {name: b[name] / factor for name in PERIODIC} | {
        "periodic_overall_xx": b["periodic_overall_xx"] / factor
    }
    agree(a, scaled, tolerance=1e-7)
    assert b["time"] == pytest.approx(a["time"] / np.sqrt(factor))


def test_density_changes_times_only():
    """ρ × 16 to the bit: m ∝ ρ, τ ∝ √ρ, and no stress knows of it."""
    a, b = series(), series(packing={"density": 16000.0})
    assert np.array_equal(b["time"], 4 * a["time"])
    for name in [*PERIODIC, "shear_stress_internal", "shear_stress_external", "coordination"]:
        assert np.array_equal(a[name], b[name]), name


def test_same_packing_whatever_friction_and_amplitude():
    """Points of a study can be compared in pairs: friction and shear come after the packing."""
    start = [
        prepared(
            packing_point(
                discs=30, links=Links(cut="cells"), friction=friction,
                shear=SHORT.model_copy(update={"strain_amplitude": amplitude}),
            )
        )
        for friction, amplitude in ((0.0, 0.01), (0.5, 0.01), (0.5, 1.0))
    ]  # fmt: skip
    for other in start[1:]:
        assert np.array_equal(other.discs.x, start[0].discs.x)
        assert np.array_equal(other.discs.y, start[0].discs.y)
        assert np.array_equal(other.links.i, start[0].links.i)


def test_periodic_tensor_is_continuous_where_the_internal_one_jumps():
    """A disc that crosses an edge moves contacts from inside to outside; the periodic sum stays."""
    c = finish(base("none", shear=steady(0.5, rate=0.01)))
    periodic = np.abs(np.diff(c["periodic_overall_xx"])).max()
    internal = np.abs(np.diff(c["overall_xx"])).max()
    assert internal > 5 * periodic
