"""The force laws of shells and cores: from energies, without net force or torque, and yielding."""

import numpy as np
import pytest
from soft_particles import chain, forces, polygon, ring, slope, squared_frequencies, system

from shear_sim.models.soft_particle.bodies import Core, Shell, ring_points
from shear_sim.models.soft_particle.bounds import highest_frequency
from shear_sim.models.soft_particle.kernels import (
    core_energy,
    core_pressure,
    hinge_angle,
    shell_forces,
)
from shear_sim.models.soft_particle.state import BEND_YIELD, CORE_LAWS, STRETCH_YIELD

LAWS = {
    "stretch": {"bend": 0.0},
    "bend": {"stretch": 1e-12},
    "elastic": {"stretch": 1e-12, "bend": 0.0, "core": Core("elastic", 2.0, 0.3)},
    "drained": {"stretch": 1e-12, "bend": 0.0, "core": Core("drained", 0.0, 0.3)},
    "gas": {"stretch": 1e-12, "bend": 0.0, "core": Core("gas", 0.0, 0.3)},
    "log": {"stretch": 1e-12, "bend": 0.0, "core": Core("log", 2.0, 0.3)},
    "all": {"core": Core("log", 2.0, 0.3)},
}


def deformed(seed=0, **law):
    """A ring far from its rest shape."""
    rng = np.random.default_rng(seed)
    s = system(ring(points=polygon(rng), **law))
    s.motion.x[:] += rng.normal(0, 0.08, 9) + 0.1 * s.motion.x
    s.motion.y[:] += rng.normal(0, 0.08, 9)
    return s


@pytest.mark.parametrize("law", LAWS)
def test_force_is_the_slope_of_the_energy(law):
    s = deformed(**LAWS[law])
    found, expected = forces(s), slope(s)
    assert np.abs(expected).max() > 1e-6
    assert found == pytest.approx(expected, abs=1e-8 * max(1.0, np.abs(expected).max()))


def test_open_chain_force_is_the_slope_of_the_energy():
    s = system(chain([(0, 0), (1, 0.2), (2, 0), (3, 0.5), (4, 0.1)], bend=0.02))
    s.motion.y[:] += [0.1, -0.2, 0.3, 0.1, 0]
    assert forces(s) == pytest.approx(slope(s), abs=1e-9)


def test_angles_of_hinges():
    """As good as the arc tangent of the library, up to the angle where that takes over."""
    angle = np.linspace(-2.69, 2.69, 20_001)
    found = np.array([hinge_angle(np.sin(a), np.cos(a)) for a in angle])
    assert found == pytest.approx(np.arctan2(np.sin(angle), np.cos(angle)), abs=2e-15)


@pytest.mark.parametrize("angle", [-3.0, -2.6, 0.0, 1e-9, 2.7])
def test_moment_of_any_angle(angle):
    s = system(chain([(0, 0), (1, 0), (2, 0)], bend=0.5), chain([(0, 9), (1, 9), (2, 9)]))
    s.motion.x[2], s.motion.y[2] = 1 + np.cos(angle), np.sin(angle)
    shell_forces(s.chains, *s.motion[:2], *s.motion[4:10], s.work.energy, s.work.scratch, False)
    assert s.chains.moment == pytest.approx([0, 0.5 * angle, 0, 0, 0, 0], abs=1e-15)


@pytest.mark.parametrize("law", LAWS)
def test_no_net_force_and_no_net_torque(law):
    s = deformed(seed=1, **LAWS[law])
    s.motion.x[:] += 3.0  # so that an arm about the origin is there
    f = forces(s)
    size = np.abs(f).sum()
    assert np.abs(f.sum(axis=0)).max() < 1e-14 * max(size, 1)
    torque = (s.motion.x * f[:, 1] - s.motion.y * f[:, 0]).sum()
    assert abs(torque) < 1e-13 * max(size, 1)


def test_forces_turn_with_the_ring():
    s = deformed(seed=2, core=Core("elastic", 2.0))
    f = forces(s)
    c, si = np.cos(0.9), np.sin(0.9)
    x, y = s.motion.x.copy(), s.motion.y.copy()
    s.motion.x[:], s.motion.y[:] = c * x - si * y + 5.0, si * x + c * y - 2.0
    turned = forces(s)
    assert turned[:, 0] == pytest.approx(c * f[:, 0] - si * f[:, 1], abs=1e-13)
    assert turned[:, 1] == pytest.approx(si * f[:, 0] + c * f[:, 1], abs=1e-13)


def test_opposite_couples_of_a_hinge():
    """A moment M bends two equal bars by forces M/ℓ, not M/2ℓ (paper (8), (9))."""
    s = system(chain([(0, 0), (2, 0), (4, 0)], bend=0.5, stretch=1e-12))
    s.motion.x[:] = [0, 2, 2 + 2 * np.cos(0.1)]
    s.motion.y[:] = [0, 0, 2 * np.sin(0.1)]
    f = forces(s)
    moment = 0.5 / 2.0 * 0.1  # k_b = EI/ℓ
    assert np.hypot(*f[0]) == pytest.approx(moment / 2.0, rel=1e-9)
    assert np.hypot(*f[2]) == pytest.approx(moment / 2.0, rel=1e-9)


@pytest.mark.parametrize("name", CORE_LAWS[1:])
def test_core_laws(name):
    """p = −dU/dA; the right value and slope at the area of the start."""
    law = CORE_LAWS.index(name)
    given = (law, 2.0, 0.3, 1.7)
    for area in (0.9, 1.7, 2.5):
        expected = -(core_energy(*given, area + 1e-5) - core_energy(*given, area - 1e-5)) / 2e-5
        assert core_pressure(*given, area) == pytest.approx(expected, rel=1e-8, abs=1e-10)
    assert core_energy(*given, 1.7) == 0.0
    assert core_pressure(*given, 1.7) == pytest.approx(0.3)
    bulk = -1.7 * (core_pressure(*given, 1.7 + 1e-5) - core_pressure(*given, 1.7 - 1e-5)) / 2e-5
    expected = {"elastic": 2.0, "drained": 0.0, "gas": 0.3, "log": 2.0}[name]
    assert bulk == pytest.approx(expected, abs=1e-8)


def pulled(limit, path):
    """Force and loss of one bar of k_s = 4 whose length goes through ``path``."""
    s = system(chain([(0, 0), (1, 0)], stretch=4.0))
    s.chains.stretch_yield[:] = limit
    for extension in path:
        s.motion.x[1] = 1.0 + extension
        force = -forces(s)[1, 0]
    return force, s.work.energy[STRETCH_YIELD], s


def bent(limit, path):
    """Moment and loss of one hinge of k_b = 4 whose angle goes through ``path``."""
    s = system(chain([(-1, 0), (0, 0), (1, 0)], stretch=1e-12, bend=4.0))
    s.chains.bend_yield[:] = limit
    for angle in path:
        s.motion.x[2], s.motion.y[2] = np.cos(angle), np.sin(angle)
        forces(s)
    return s.chains.moment[1], s.work.energy[BEND_YIELD], s


@pytest.mark.parametrize("load", [pulled, bent])
def test_elastic_perfectly_plastic_cycle(load):
    """Loaded to 0.5 with yield at 0.1, unloaded, loaded backwards: pencil and paper.

    k = 4, limit 0.4: yields at 0.1; plastic part at 0.5 is 0.4; −0.4 is met again at 0.3.
    """
    steps = np.linspace(0, 0.5, 501)
    force, lost, s = load(0.4, steps)
    assert force == pytest.approx(0.4)
    assert lost == pytest.approx(0.4 * 0.4, rel=1e-9)
    back = np.linspace(0.5, 0.0, 501)
    force, lost, s = load(0.4, np.concatenate([steps, back[:201]]))
    assert force == pytest.approx(-0.4)  # at 0.3
    assert lost == pytest.approx(0.16, rel=1e-9)
    force, lost, s = load(0.4, np.concatenate([steps, back]))
    assert force == pytest.approx(-0.4)
    assert lost == pytest.approx(0.16 + 0.3 * 0.4, rel=1e-9)
    rest = s.chains.rest_length[0] - 1.0 if load is pulled else s.chains.rest_angle[1]
    assert rest == pytest.approx(0.1)


@pytest.mark.parametrize("core", [Core(), Core("elastic", 30.0), Core("gas", 0, 0.01)])
def test_bound_on_the_highest_frequency(core):
    """Over the largest eigenvalue of the Hessian, and not by more than half."""
    s = system(ring(12, core=core, thickness=0.3), stiffness=1e-300)
    exact = np.sqrt(squared_frequencies(s).max())
    bound = highest_frequency(s.chains, s.motion.x, s.motion.y, 0.0)
    assert exact < bound < 1.5 * exact


def test_material():
    """k_s = E h/ℓ(1 − ν²), k_b = E h³/12 ℓ(1 − ν²), for any depth (paper (10), (11) need s = ℓ)."""
    s = system(ring(12, points=ring_points(12, 2.0)))
    length = 4.0 * np.sin(np.pi / 12)
    shell = Shell.of_material(7.0, 0.2, 0.3)
    assert shell.stretch == pytest.approx(7.0 * 0.2 / 0.91)
    assert shell.bend == pytest.approx(7.0 * 0.008 / 12 / 0.91)
    assert s.chains.stretch_stiffness == pytest.approx(np.full(12, 0.1 / length))
    assert s.chains.bend_stiffness == pytest.approx(np.full(12, 1e-3 / 12 / length))
    assert s.chains.rest_angle == pytest.approx(np.full(12, np.pi / 6))


def test_a_step_over_the_bound_is_refused():
    """0.9 of the longest stable one, where there are no dashpots."""
    longest = 0.9 * system(ring()).stable_step
    system(ring(), step=longest)
    with pytest.raises(ValueError, match=rf"at most {0.995 * longest:.3g}$"):
        system(ring(), step=1.001 * longest)
