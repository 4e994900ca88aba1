"""The energy balance: what the flow puts in is stored, or lost in one of five ways.

A wrong force, torque, stress, spring rule or energy leaves a residual that does not vanish with
the step; a scheme of lower order one that vanishes more slowly than its square.
"""

import pytest

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
from shear_sim.models.microgel.prepared import energy_residual
from shear_sim.models.microgel.simulation import prepare
from shear_sim.packing import Cell, Packing
from shear_sim.protocol import OscillatoryShear, SteadyShear
from shear_sim.streams import Streams


def residual(steps, *, shear=None, boundary="lees_edwards", scheme="velocity_verlet", **model):
    """Largest residual of the balance during a run, relative to all that is lost."""
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
    """Closed to 0.2 % of the loss at 400 steps per period, and four times better at 800."""
    coarse, fine = (residual(steps, **scene) for steps in (400, 800))
    assert coarse < 2e-3
    assert fine < coarse / 3


@pytest.mark.parametrize(
    "law", [PlateauLaw(kind="plateau"), DivergentLaw(repulsion=0.5), LinearLaw(kind="linear")]
)
def test_energy_balance_closes_for_every_law(law):
    assert residual(800, contact_law=law) < 5e-4


def test_only_conjugate_arms_conserve_energy():
    """Torque and rolling velocity with different arms do work that nobody accounts for."""
    assert residual(800, lever_arms="particleshear") > 0.01
    assert residual(800, lever_arms="otsuki2017", friction=1.0) < 5e-3  # conjugate too
