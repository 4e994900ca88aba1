"""The scenes that are timed: a default job, and loose discs that LAMMPS can run too."""

from functools import cache

from shear_sim.models.microgel.parameters import (
    Integrator,
    LinearLaw,
    Links,
    Microgel,
    MicrogelPoint,
)
from shear_sim.models.microgel.preparation import Start, make_start
from shear_sim.models.microgel.simulation import MicrogelSimulation, kernels_of, make_clock
from shear_sim.packing import Equilibration, Packing
from shear_sim.protocol import OscillatoryShear
from shear_sim.streams import Streams

# 0.04 τ is what LAMMPS needs; our default is 0.17 τ, halved where a contact needs it.
STEP = 0.04  # τ
PERIOD = 200.0  # τ
AMPLITUDE = 0.1


def common_point(discs: int, packing_fraction: float) -> MicrogelPoint:
    """Loose discs with friction and a linear law: what both programs have."""
    return MicrogelPoint(
        packing=Packing(
            discs=discs,
            packing_fraction=packing_fraction,
            equilibration=Equilibration(force_tolerance=1e-4, energy_tolerance=1e-9),
        ),
        model=Microgel(
            contact_law=LinearLaw(kind="linear"),
            friction=0.5,
            tangential_ratio=2 / 7,
            links=Links(cut="none"),
        ),
        shear=OscillatoryShear(
            strain_amplitude=AMPLITUDE, relative_frequency=1 / PERIOD, pre_periods=0, post_periods=0
        ),
        integrator=Integrator(steps_per_period=round(PERIOD / STEP)),
    )


@cache
def _start(discs: int, packing_fraction: float) -> Start:
    return make_start(common_point(discs, packing_fraction), Streams(1, 0))


def common(discs: int, packing_fraction: float) -> MicrogelSimulation:
    """Return a fresh simulation of `common_point`: one force evaluation and one record a step."""
    point = common_point(discs, packing_fraction)
    start = _start(discs, packing_fraction)
    d, links, contacts = (
        type(state)(*(array.copy() for array in state))
        for state in (start.discs, start.links, start.contacts)
    )
    clock = make_clock(point.shear, start.period, point.steps_per_period, 1)
    # Steps ten times finer than ours would also halve ten times more often.
    return MicrogelSimulation(
        point, kernels_of(point), d, links, contacts, start.constants, clock, start.preparation
    )
