"""Moduli of hexagonal crystals, which follow from paper and pencil.

Every disc of the crystal is a centre of symmetry, so that it deforms affinely. With spacing a and
contact distance D = s a: of the three bond directions, shear stretches two and turns all.
"""

import math

import numpy as np
import pytest

from shear_sim.models.microgel import derive
from shear_sim.models.microgel.links import touching_pairs
from shear_sim.models.microgel.parameters import (
    DivergentLaw,
    LinearLaw,
    Links,
    Microgel,
    MicrogelPoint,
)
from shear_sim.models.microgel.preparation import prepare
from shear_sim.models.microgel.simulation import (
    MicrogelSimulation,
    kernels_for,
    laws,
    make_clock,
    make_constants,
    make_discs,
    make_pairs,
    time_scale,
)
from shear_sim.packing import Packing, start_discs
from shear_sim.protocol import OscillatoryShear
from shear_sim.rheology import moduli
from shear_sim.streams import Streams

TOUCHING = math.pi / (2 * math.sqrt(3))  # packing fraction of discs that just touch
K = math.pi * 8000 / 8


def crystal(packing_fraction, law, amplitude, friction=0.0, *, links="none", periods=2):
    return MicrogelPoint(
        packing=Packing(
            start="hexagonal", discs=24, columns=4, packing_fraction=packing_fraction, size_ratio=1
        ),
        model=Microgel(
            contact_law=law, friction=friction, relative_viscosity=0.01, links=Links(cut=links)
        ),
        shear=OscillatoryShear(
            strain_amplitude=amplitude,
            relative_frequency=0.0025,
            pre_periods=0,
            periods=periods,
            post_periods=0,
        ),
    )


def measure(simulation):
    simulation.advance(simulation.rows)
    columns, protocol = simulation.columns(), simulation.summary()["protocol"]
    result = moduli(
        columns["time"],
        derive(columns)["shear_stress"],
        strain_amplitude=protocol["strain_amplitude"],
        period=protocol["period"],
        shear_start=protocol["shear_start"],
        periods=protocol["periods"],
    )
    omega = 2 * math.pi / protocol["period"]
    return result, omega * simulation.constants.eta


@pytest.mark.parametrize(
    ("law", "amplitude", "periods"),
    [
        (LinearLaw(kind="linear"), 1e-3, 2),
        (DivergentLaw(), 1e-6, 2),
        (LinearLaw(kind="linear"), 1e-3, 1),
    ],
)
def test_bonded_crystal(law, amplitude, periods):
    """G′ = (√3/4)(k + k_T) and G″ = ω (√3/4)(η + η_T) of an unstressed network of links."""
    point = crystal(TOUCHING, law, amplitude, links="bulk", periods=periods)
    start = start_discs(point.packing, point.cell, Streams(0, 0))
    discs = make_discs(start.position, start.radius, density=1000.0)
    network = touching_pairs(start.position, start.radius * 1.001, (start.width, start.height))
    _, tau = time_scale(point.model, discs.mass)
    period = tau / point.shear.relative_frequency
    simulation = MicrogelSimulation(
        point, kernels_for(laws.divergent, tangential=True), discs,
        make_pairs(network.pairs, network.image), make_pairs(),
        make_constants(point, discs, start.width, start.height, period),
        make_clock(point.shear, period, point.steps_per_period, 1), {},
    )  # fmt: skip
    assert len(network.pairs) == 3 * 24
    result, loss = measure(simulation)
    assert result.storage == pytest.approx(math.sqrt(3) / 4 * 2 * K, rel=1e-6)
    assert result.loss == pytest.approx(math.sqrt(3) / 4 * 2 * loss, rel=1e-5)


@pytest.mark.parametrize("packing_fraction", [1.0, 1.5])
@pytest.mark.parametrize("x", [2.0, 0.5, 0.2])
def test_frictional_crystal(packing_fraction, x):
    """Compressed crystal whose contacts stick (x > 1) or slide (x < 1), x = γ_c/A.

    G_n = (√3/4) k [s² − 3 s (s − 1)]; contacts slide beyond γ_c = 2 μ s (s − 1) k/k_T; below, the
    tangential springs add (√3/4) k_T and above the moduli of an elastoplastic loop.
    """
    mu = 1e-3
    s = math.sqrt(packing_fraction / TOUCHING)
    gamma_c = 2 * mu * s * (s - 1)
    unit = math.sqrt(3) / 4 * K
    storage = unit * (s**2 - 3 * s * (s - 1))
    loss = 0.0
    if x < 1:
        loop = math.acos(1 - 2 * x) - 2 * (1 - 2 * x) * math.sqrt(x - x**2)
        storage += unit / math.pi * loop
        loss = unit * 4 / math.pi * x * (1 - x)
    else:
        storage += unit
    point = crystal(packing_fraction, DivergentLaw(), gamma_c / x, mu)
    result, _ = measure(prepare(point, Streams(0, 0)))
    assert result.storage == pytest.approx(storage, rel=0.01)
    # The dashpots add 2·10⁻⁴ of the storage modulus.
    assert result.loss == pytest.approx(loss, rel=0.01, abs=1e-3 * storage)


@pytest.mark.parametrize("compression", [1e-3, 0.1, 0.25])
@pytest.mark.parametrize("law", [LinearLaw(kind="linear"), DivergentLaw()], ids=lambda x: x.kind)
def test_prestress_softens_the_frictionless_crystal(law, compression):
    """G_n = (√3/4) k [1 − 3(s − 1)] (linear) or (√3/4) k [s² − 3 s (s − 1)] (divergent)."""
    s = 1 + compression
    expected = 1 - 3 * (s - 1) if law.kind == "linear" else s**2 - 3 * s * (s - 1)
    point = crystal(TOUCHING * s**2, law, 1e-5)
    result, _ = measure(prepare(point, Streams(0, 0)))
    assert result.storage == pytest.approx(math.sqrt(3) / 4 * K * expected, rel=1e-5)


def test_historical_sums_miss_contacts_across_the_edges():
    """The internal tensor leaves out contacts across the edges; the periodic one has them all.

    The crystal's pressure is 3 F/(√3 a) = √3 k D (D − a)/a² exactly (six contacts, one force).
    """
    s = 1.1
    point = crystal(TOUCHING * s**2, DivergentLaw(), 1e-6)
    simulation = prepare(point, Streams(0, 0))
    simulation.advance(1)
    derived = derive(simulation.columns())
    spacing = simulation.constants.width / 4
    force = K * s * spacing * (s - 1)
    assert derived["pressure"][0] == pytest.approx(math.sqrt(3) * force / spacing, rel=1e-12)
    internal = 0.5 * (derived["overall_xx"][0] + derived["overall_yy"][0])
    assert internal < 0.9 * derived["pressure"][0]
    assert np.isfinite(internal)
