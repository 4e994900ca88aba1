"""Substeps: how long a step may be before it has to be cut."""

import math

import numpy as np
import pytest
from scenes import finish, packing_point, prepared, scene

from shear_sim.models.microgel.parameters import Integrator, Links, Microgel, MicrogelPoint
from shear_sim.models.microgel.preparation import prepare
from shear_sim.models.microgel.simulation import kernels_for, laws
from shear_sim.packing import Packing
from shear_sim.protocol import OscillatoryShear, SteadyShear
from shear_sim.streams import Streams

STABLE = kernels_for(laws.divergent, True).stable


def ringing(step, omega, gamma):
    """Return how far two linked discs are from rest after 4000 steps, of 1e-6 at the beginning."""
    x = np.array([(100.0, 100.0), (102.0 + 1e-6, 100.0)])
    s = scene(
        x, 1.0, links=[(0, 1)], k=0.5 * omega**2, eta=0.5 * gamma, step=step, steps=4000,
    )  # fmt: skip
    s.advance(s.rows)
    return abs(s.discs.x[1] - s.discs.x[0] - 2.0)


@pytest.mark.parametrize(("omega", "gamma"), [(2.0, 0.0), (2.0, 0.1), (1.0, 1.0), (0.3, 3.0)])
def test_where_a_step_becomes_unstable(omega, gamma):
    """(h ω)²/4 + h γ = 1: an error decays on this side of it (or stays) and grows on the other."""
    inverse = gamma / 2
    limit = 1 / (inverse + math.sqrt(inverse**2 + omega**2 / 4))
    assert (limit * omega) ** 2 / 4 + limit * gamma == pytest.approx(1)
    assert ringing(0.98 * limit, omega, gamma) < 1e-5
    assert ringing(1.02 * limit, omega, gamma) > 1e-4
    assert STABLE(2 / omega, 1 / gamma if gamma else math.inf) == pytest.approx(limit)


@pytest.mark.parametrize("viscosity", [0.0, 0.1, 0.16, 0.18, 0.2, 0.4, 0.8])
def test_rolling_of_a_crystal_is_stable(viscosity):
    """All discs turn at once against six neighbours that hardly overlap: ω² = 24 k_T/m.

    Springs and dashpots that were judged one by one let spins grow here, at 0.18, 0.2 and 0.4.
    """
    point = MicrogelPoint(
        packing=Packing(
            start="hexagonal", discs=64, columns=8, packing_fraction=0.91, size_ratio=1
        ),
        model=Microgel(links=Links(cut="bulk"), relative_viscosity=viscosity),
        shear=OscillatoryShear(strain_amplitude=1e-9, pre_periods=2, periods=1, post_periods=0),
    )  # fmt: skip
    s = prepare(point, Streams(0, 0))
    s.discs.spin[:] = 1e-6 / s.clock.step * np.random.default_rng(0).normal(size=64)
    before = (s.discs.spin**2).sum()
    s.advance(200)
    assert (s.discs.spin**2).sum() < before


def test_rolling_with_nominal_arms_is_stable_at_any_packing_fraction():
    """There contacts get more numerous and arms do not get shorter."""
    shear = OscillatoryShear(strain_amplitude=0.01, pre_periods=0, periods=1, post_periods=0)
    spin = []
    for steps in (None, 800):
        point = packing_point(
            discs=100, links=Links(cut="bulk"), packing={"packing_fraction": 2.0}, shear=shear,
            lever_arms="otsuki2017", steps_per_period=steps,
        )  # fmt: skip
        s = prepared(point)
        finish(s)
        spin.append(np.sqrt((s.discs.spin**2).mean()))
    assert spin[0] == pytest.approx(spin[1], rel=0.01)


def substeps(steps, **model):
    shear = OscillatoryShear(strain_amplitude=0.01, pre_periods=0, periods=1, post_periods=0)
    s = prepared(
        packing_point(links=Links(cut="bulk"), shear=shear, steps_per_period=steps, **model)
    )
    finish(s)
    return s.substeps / s.steps


def test_more_steps_make_finer_substeps_and_fewer_do_not_make_coarser_ones():
    """Default 240, n times as many: the longest substep n times shorter. 60: as by default."""
    assert MicrogelPoint().steps_per_period == 240
    assert MicrogelPoint(integrator=Integrator(steps_per_period=60)).refinement == 1
    assert MicrogelPoint(integrator=Integrator(steps_per_period=720)).refinement == 3
    default = substeps(None, relative_viscosity=0.5)
    assert default > 1
    assert substeps(480, relative_viscosity=0.5) == default
    assert substeps(1920, relative_viscosity=0.5) == default
    assert substeps(60, relative_viscosity=0.5) == 4 * default


@pytest.mark.parametrize(("frequency", "steps"), [(1, 240), (0.025, 240), (0.001, 2500)])
def test_default_steps_are_as_short_as_the_period_or_the_discs_need(frequency, steps):
    point = MicrogelPoint(shear=OscillatoryShear(relative_frequency=frequency))
    assert point.steps_per_period == steps
    assert point.refinement == 1


RATIO = math.sqrt(6)  # ω √(m/k) of discs with six touching neighbours; their rolling: twice that


@pytest.mark.parametrize(
    ("friction", "viscosity", "limit"),
    [
        (0.0, 0.0, 1 / RATIO),
        (1.0, 0.0, 0.75 / RATIO),
        (0.0, 1.0, 2 / (8 + math.sqrt(8**2 + 4 * RATIO**2 / 4))),
        (1.0, 1.0, 2 / (24 + math.sqrt(24**2 + 4 * RATIO**2))),
    ],
    ids=["springs", "rolling", "dashpots", "dashpots of rolling"],
)
def test_the_longest_substep_of_springs_and_dashpots(friction, viscosity, limit):
    """In τ: half and three quarters of the stable step of springs, all of that with dashpots.

    ω² = 6 k/m and 24 k_T/m, γ = 6 η/m + 2 η_T/m and 24 η_T/m; stable is (h ω)²/4 + h γ = 1.
    """
    for part, pieces in ((0.99, 1), (1.01, 2)):
        frequency = 1 / (50 * part * limit)  # 50 whole steps per period of this length
        shear = OscillatoryShear(strain_amplitude=1e-9, relative_frequency=frequency)
        assert first_step(shear, friction, viscosity, steps=50).substeps == pieces


@pytest.mark.parametrize(("change", "pieces"), [(0.0297, 1), (0.0303, 2)])
def test_the_longest_substep_in_strain(change, pieces):
    """3 % of strain."""
    shear = SteadyShear(
        kind="steady", relative_rate=10 * change, strain=1, relative_frequency=0.1, pre_periods=0
    )
    assert first_step(shear, steps=100).substeps == pieces  # in steps of 0.1 τ


@pytest.mark.parametrize(("part", "pieces"), [(0.98, 1), (1.02, 2)])
@pytest.mark.parametrize("touching", [False, True])
def test_the_longest_substep_of_an_approach(touching, part, pieces):
    """Two fast discs approach by half a radius; a contact changes its length by a fifth."""
    s = first_step(OscillatoryShear(strain_amplitude=1e-9), advance=False)
    d, size = s.discs, 2 * float(s.discs.radius[0])
    distance = (0.9 if touching else 1.5) * size
    d.x[:2], d.y[:2] = (0.0, distance), 0.0
    d.x[2:], d.y[2:] = (0.0, distance), 0.5 * s.constants.height
    way = 0.2 * distance / 2 if touching else 0.25 * size / 2
    d.cx[0], d.cx[1] = (sign * part * way / s.clock.step * 2 for sign in (1, -1))
    s.constants = s.constants._replace(step_normal=1e9, step_energy=1e9)
    s.clock = s.clock._replace(step=0.5 * s.clock.step)
    s.advance(2)
    assert s.substeps == pieces


def first_step(shear, friction=0.0, viscosity=0.0, *, steps=None, advance=True):
    """Return a simulation of four equal discs, far apart, after its first step."""
    s = prepared(
        packing_point(
            discs=4, packing={"packing_fraction": 0.1, "size_ratio": 1.0}, shear=shear,
            steps_per_period=steps, friction=friction, relative_viscosity=viscosity,
        )
    )  # fmt: skip
    if advance:
        s.advance(2)
    return s
