"""Dashpots and friction of walls against closed forms: energy balances do not see their size."""

import math
from dataclasses import replace

import numpy as np
import pytest
from soft_particles import HOUSE, chain, finished, momentum, points, probe, ring, system

from shear_sim.models.interface import SimulationError
from shear_sim.models.soft_particle.bodies import Shell
from shear_sim.models.soft_particle.simulation import SoftParticleSimulation
from shear_sim.models.soft_particle.walls import Wall
from shear_sim.streams import Streams


def decay(s, displacement, period):
    """How much smaller the largest displacement is in the third period than in the first."""
    steps = math.ceil(period / s.rules.step / 40)
    s.rules = s.rules._replace(step=period / 40 / steps)
    found = []
    for _ in range(120):
        s.advance(steps)
        found.append(abs(displacement(s.motion)))
    return max(found[80:]) / max(found[:40])


def test_a_bar_is_damped_by_a_fraction_of_critical():
    """Two masses on a spring, ω² = 2 k_s/m: amplitudes fall as exp(−ζ ω t)."""
    zeta = 0.04
    bar = chain([(0, 0), (1, 0)], mass=0.5)
    bar = replace(bar, shell=Shell(0.1, 1e-4, stretch_damping=zeta))
    s = system(bar)
    frequency = np.sqrt(2 * 0.1 / 0.5)
    s.motion.vx[:] = -1e-3, 1e-3
    s.begin()
    got = decay(s, lambda m: m.x[1] - m.x[0] - 1.0, 2 * np.pi / frequency)
    assert got == pytest.approx(np.exp(-4 * np.pi * zeta), rel=0.02)


def test_a_hinge_is_damped_by_a_fraction_of_critical():
    """Critical is 2 √(k_b m ℓ²/3), of one bar on a hinge; three masses have ½ I θ̇², I = m ℓ²/6."""
    zeta, bend = 0.03, 1e-3
    three = chain([(0, 0), (1, 0), (2, 0)], mass=0.5)
    three = replace(three, shell=Shell(0.1, bend, bend_damping=zeta))
    s = system(three)
    inertia = 0.5 / 6
    frequency = np.sqrt(bend / inertia)
    s.motion.vy[:] = np.array([1.0, -2.0, 1.0]) * 1e-5
    s.begin()
    got = decay(s, lambda m: m.y[0] - m.y[1], 2 * np.pi / frequency)
    rate = 2 * zeta * np.sqrt(bend * 0.5 / 3) / (2 * inertia)
    assert got == pytest.approx(np.exp(-rate * 4 * np.pi / frequency), rel=0.02)


@pytest.mark.parametrize("damping", [0.1, 0.4, 1.0])
def test_the_damped_step_is_stable(damping):
    """A ring that is stirred comes to rest at this step, and explodes at 1.4 times of it."""
    model = {"damping": damping, "drag": 0, "inner_damping": 0}
    shear = {"kind": "vibration", "periods": 4, "amplitude": 1e-3}
    given = points(packing={"vertices": 24}, model=model, shear=shear)(integrator={"step": 0.1})
    s = SoftParticleSimulation(given, Streams(1, 0)).run.system
    rng = np.random.default_rng(1)
    s.motion.vx[:], s.motion.vy[:] = 1e-6 * rng.standard_normal((2, 24))
    s.rules = s.rules._replace(step=0.98 * s.damped_step())
    s.begin()
    stirred = s.kinetic()
    s.advance(2000)
    assert s.kinetic() < 0.3 * stirred  # it drifts and turns as a whole
    s.rules = s.rules._replace(step=1.4 * s.damped_step())
    with pytest.raises(
        SimulationError, match=r"surely stable up to integrator\.step = 0\.\d+: that, or less dam"
    ):
        s.advance(20000)


def test_drag_against_the_own_particle():
    """Of c m ω₁, on a vibration: ζ = c/2, as for a drag against everything."""
    model = {"damping": 0, "drag": 0, "inner_damping": 0.1}
    shear = {"kind": "vibration", "periods": 4, "amplitude": 1e-3}
    oval = finished(points(packing={"vertices": 24}, model=model, shear=shear)()).columns()
    oval = np.abs(oval["ovality"])
    expected = np.exp(-2 * np.pi * 0.05 * 3)
    assert oval[60:].max() / oval[:20].max() == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("speed", [0.3, -0.3, 40.0])
def test_dashpots_of_contacts(speed):
    """f = k_n h (1 − β ḣ⁻) with β = ζ √(m/k_n)/r, and never a pull: of chains and of walls."""
    zeta, stiffness = 0.25, 0.5
    s, v = probe(HOUSE, (1.0, -0.15), tail=(0.0, -5.0), stiffness=stiffness, contact_damping=zeta)
    s.motion.vy[v] = -speed  # away from the flat side above
    s._forces(s.rules._replace(step=0.0))
    beta = zeta * np.sqrt(1.0 / stiffness) / 0.1
    elastic = -stiffness * 0.05
    assert s.motion.fy[v] == pytest.approx(elastic)
    assert s.motion.dy[v] == pytest.approx(-elastic * min(1.0, beta * speed))
    assert s.motion.dy.sum() == pytest.approx(0.0, abs=1e-15)

    wall = Wall(0.0, 1.0, -0.95, velocity=0.1)
    s = system(ring(8, thickness=0.2), walls=[wall], stiffness=stiffness, contact_damping=zeta)
    s.motion.vy[:] = speed
    s._forces(s.rules._replace(step=0.0))
    low = np.flatnonzero(s.motion.y < -0.85)
    push = 2 * stiffness * (0.1 - (s.motion.y[low] + 0.95))
    loss = -push * min(1.0, beta * (speed - 0.1))
    assert s.motion.dy[low] == pytest.approx(loss)
    assert s.walls.push[0] == pytest.approx((push + loss).sum())


def test_a_wall_is_pushed_by_what_it_gives():
    """m Δv of a free ring that it throws back = Σ push δt; its dashpots have a part in both."""
    wall = Wall(0.0, 1.0, -1.16)
    s = system(ring(thickness=0.3), walls=[wall], contact_damping=20.0)
    s.motion.vy[:] = -0.01
    s.begin()
    start = momentum(s)
    given = lost = 0.0
    for _ in range(4000):
        s.advance(1)
        given += float(s.walls.push[0]) * s.rules.step
        lost += float(s.motion.dy.sum()) * s.rules.step
    assert s.walls.push[0] == 0.0
    assert abs(lost) > 1e-4 * given  # as none of them pulls
    gained = momentum(s) - start
    assert gained[1] > 0.1
    assert given == pytest.approx(gained[1], rel=1e-9)


def test_friction_of_a_wall():
    """k_t times the way while it sticks, μ f_n where it slides; a pair of forces, wall and ring."""
    friction, tangential = 0.3, 0.7
    walls = [Wall(0.0, 1.0, -0.95, slide=-0.01)]  # the tangent is (−1, 0): to the right
    s = system(
        ring(8, thickness=0.2, stretch=50.0, mass=50.0), walls=walls, stiffness=0.5,
        tangential=tangential, friction=friction,
    )  # fmt: skip
    low = np.flatnonzero(s.motion.y < -0.85)
    s.hold(np.arange(8))
    s.begin()
    push = 2 * 0.5 * (0.1 - (s.motion.y[low] + 0.95))
    s.rules = s.rules._replace(step=0.01)
    s.advance(100)
    way = 0.01 * s.time
    assert s.motion.fx[low] == pytest.approx(tangential * way)
    assert s.walls.drive[0] == pytest.approx(-2 * tangential * way)
    s.advance(20_000)
    assert tangential * 0.01 * s.time > 2 * friction * push.max()
    assert s.motion.fx[low] == pytest.approx(friction * push)
    way = 0.01 * s.time - friction * push / tangential
    assert s.budget().sliding == pytest.approx((friction * push * way).sum(), rel=1e-6)
