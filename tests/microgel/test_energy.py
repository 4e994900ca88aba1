"""The energy balance: what the flow puts in is stored, or lost in one of five ways.

A wrong force, torque, stress, spring rule or energy leaves a residual that does not vanish with
the step; a scheme of lower order one that vanishes more slowly than its square.
"""

import numpy as np
import pytest
from scenes import scene
from scipy.integrate import quad

from shear_sim.models.microgel import laws
from shear_sim.models.microgel.parameters import (
    Damping,
    DivergentLaw,
    Integrator,
    LinearLaw,
    Links,
    Microgel,
    MicrogelPoint,
    PlateauLaw,
    Record,
)
from shear_sim.models.microgel.preparation import prepare
from shear_sim.models.microgel.prepared import energy_residual
from shear_sim.models.microgel.simulation import kernels_for
from shear_sim.packing import Cell, Packing
from shear_sim.protocol import OscillatoryShear, SteadyShear
from shear_sim.streams import Streams


def residual(
    steps, *, shear=None, boundary="lees_edwards", scheme="velocity_verlet", law=None, **model
):
    """Largest residual of the balance during a run, relative to all that is lost.

    Another ``law`` acts from the first record on, in a packing that was at rest by the usual one.
    """
    point = MicrogelPoint(
        cell=Cell(boundary=boundary),
        packing=Packing(discs=40),
        model=Microgel(**{"friction": 0.3, "links": Links(cuts=3)} | model),
        shear=shear
        or OscillatoryShear(strain_amplitude=0.2, pre_periods=0.1, periods=1, post_periods=0.1),
        integrator=Integrator(steps_per_period=steps, scheme=scheme),
        record=Record(energy=True),
    )
    simulation = prepare(point, Streams(1, 1))
    if law is not None:
        function, parameters = laws.law_of(law)
        simulation.kernels = kernels_for(function, tangential=True, tally=True)
        simulation.constants = simulation.constants._replace(law=parameters)
    simulation.advance(simulation.rows)
    return energy_residual(simulation.columns())


@pytest.mark.parametrize(
    "scene",
    [
        {},
        {"links": Links(cut="none")},
        {"boundary": "plates"},
        {"damping": Damping(spin="zero")},
        {"dashpot": "no_attraction"},
        {"shear": SteadyShear(kind="steady", relative_rate=-0.05, strain=0.5, pre_periods=0)},
    ],
    ids=["links", "friction", "plates", "spins to zero", "no attraction", "steady"],
)
def test_energy_balance_closes(scene):
    """Closed to 0.1 % of the loss by default, and four times better with twice the steps."""
    coarse, fine = (residual(steps, **scene) for steps in (None, 480))
    assert coarse < 1e-3
    assert fine < coarse / 3.8


@pytest.mark.parametrize(
    "law", [PlateauLaw(kind="plateau"), DivergentLaw(repulsion=0.5), LinearLaw(kind="linear")]
)
def test_energy_balance_closes_for_every_law(law):
    assert residual(800, law=law) < 5e-4


def test_only_conjugate_arms_conserve_energy():
    """Torque and rolling velocity with different arms do work that nobody accounts for."""
    assert residual(800, lever_arms="particleshear") > 0.01
    assert residual(800, lever_arms="otsuki2017", friction=1.0) < 5e-3  # conjugate too


@pytest.mark.parametrize(("energy", "way"), [(3.0, -1), (5.5, -1), (20.0, 1)])
def test_a_fast_collision_is_resolved(energy, way):
    """Two discs that meet with an energy in units of k D², in steps of 0.35 D, without losses.

    They come back, or beyond 6 k D² (the height of the clamped law) go through each other; either
    way the contact gets 300 times stiffer or more within a step, and as soft again. Steps that are
    chosen once, or from contacts that close only, miss a third of the energy.
    """
    speed = 2.0 * np.sqrt(energy)
    s = scene(
        [(100.0, 100.0), (102.2, 100.0)], 1.0, velocity=np.array([(speed, 0.0), (-speed, 0.0)]),
        k=1.0, step_normal=2 / np.sqrt(6), step=0.2, steps=10,
    )  # fmt: skip
    s.constants = s.constants._replace(law=(1.0, 1.0, 1.0, 1.0))  # divergent
    s.advance(s.rows)
    assert s.substeps > s.steps
    assert s.discs.x[0] - s.discs.x[1] > 2.0 if way > 0 else s.discs.x[1] - s.discs.x[0] > 2.0
    assert s.discs.cx == pytest.approx([way * speed, -way * speed], rel=0.01)


@pytest.mark.parametrize(("energy", "deep"), [(1.3, False), (1.5, True)])
def test_the_deepest_overlap_of_a_run_is_kept(energy, deep):
    """It takes ln(D/d) − 1 + d/D in units of k D²: 1.4 at a tenth of the contact distance."""
    speed = 2.0 * np.sqrt(energy)
    s = scene(
        [(100.0, 100.0), (102.2, 100.0)], 1.0, velocity=np.array([(speed, 0.0), (-speed, 0.0)]),
        k=1.0, step_normal=2 / np.sqrt(6), step=0.01, steps=200,
        strain_rate=1e-9,
    )  # fmt: skip
    s.constants = s.constants._replace(law=(1.0, 1.0, 1.0, 1.0))  # divergent
    s.advance(s.rows)
    assert s.work.closest[0] == 1  # apart again
    summary = s.summary()
    d = summary["checks"]["closest"]
    assert np.log(1 / d) - 1 + d == pytest.approx(energy, rel=2e-3)
    assert summary["flags"]["deep_overlap"] is deep


@pytest.mark.parametrize("law", [DivergentLaw(), PlateauLaw(kind="plateau")])
def test_the_energy_of_a_compressed_contact(law):
    """The kernels' quadrature against an adaptive one, down to a fiftieth of the contact distance.

    The divergent law grows as 1/d: one Gauss rule over all of the overlap errs by 1e-4 there.
    """
    function, p = laws.law_of(law)
    stored_energy = kernels_for(function, True, True).stored_energy
    for d in (0.9, 0.3, 0.1, 0.02):
        kinks = [kink for kink in p[1:3] if d < kink < 1]
        work, _ = quad(
            lambda r: -function(r, 1.0, 1.0, p), d, 1.0, points=kinks or None, epsrel=1e-12
        )
        assert stored_energy(d, 1.0, 1.0, p) == pytest.approx(work, rel=1e-10)
