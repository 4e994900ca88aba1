"""Single chains against closed forms of mechanics: beams, rings under pressure, vibrations."""

import numpy as np
import pytest
from scipy.optimize import brentq
from soft_particles import (
    angular_momentum,
    chain,
    forces,
    momentum,
    polygon,
    ring,
    squared_frequencies,
    system,
)

from shear_sim.models.soft_particle.bodies import Core, ring_points

EI = 1e-4
FORCE = 1e-7  # F L²/EI = 1e-3


def at_rest(s, slowest, tolerance=1e-6):
    """Bring a beam to rest by a drag that is critical for its slowest vibration."""
    s.rules = s.rules._replace(drag=2.0 * slowest, step=0.7 * s.stable_step)
    s.begin()
    for _ in range(1000):
        s.advance(2000)
        m = s.motion
        net = np.hypot(m.free_x * m.fx, m.free_y * m.fy).max()
        if net < tolerance * FORCE and np.hypot(m.vx, m.vy).max() * slowest < tolerance * FORCE:
            return s
    raise AssertionError(net)


def cantilever(n, weight):
    """Deflection of n segments of total length 1 under a force at the end, clamped at x = 0."""
    x = np.arange(-1, n + 1) / n
    bend_weight = np.ones(n + 2)
    bend_weight[1] = weight
    s = system(
        chain(np.column_stack([x, 0 * x]), bend=EI, bend_weight=bend_weight, thickness=1e-3),
        stiffness=1e-300,
    )
    s.hold(np.array([0, 1]))
    s.load(np.array([n + 1]), fy=FORCE)
    at_rest(s, 3.516 * np.sqrt(EI * n))  # ω₁² = 3.516² EI/(ρ L⁴), unit masses
    return s.motion.x[1:], s.motion.y[1:]


@pytest.mark.parametrize("n", [8, 20])
@pytest.mark.parametrize("clamp", ["full", "half"])
def test_cantilever(n, clamp):
    """Discrete hinges: (1 + 1/n)(1 + 1/2n) of F L³/3EI, or 1 + 1/2n² if the clamp is half a hinge.

    So the error of the paper's clamp is 1.5/n, as in its figure 8, and that of the right one 1/2n².
    """
    x, y = cantilever(n, 1.0 if clamp == "full" else 2.0)
    theory = FORCE / (3 * EI)
    factor = (1 + 1 / n) * (1 + 0.5 / n) if clamp == "full" else 1 + 0.5 / n**2
    assert y[-1] / theory == pytest.approx(factor, abs=1e-4)
    shape = 0.5 * x**2 * (3 - x)
    if clamp == "half":
        assert y / y[-1] == pytest.approx(shape, abs=0.01)


@pytest.mark.parametrize("n", [8, 20])
def test_supported_beam(n):
    """1 + 2/n² of F L³/48EI: quadratic, not linear as the paper says.

    Its (16), (17) are a beam under a uniform load, and not even that by a factor.
    """
    x = np.arange(n + 1) / n
    s = system(chain(np.column_stack([x, 0 * x]), bend=EI, thickness=1e-3), stiffness=1e-300)
    s.hold(np.array([0]))
    s.hold(np.array([n]), vx=None)
    s.load(np.array([n // 2]), fy=FORCE)
    at_rest(s, np.pi**2 * np.sqrt(EI * n))
    theory = FORCE / (48 * EI)
    assert s.motion.y[n // 2] / theory == pytest.approx(1 + 2 / n**2, abs=1e-4)
    left = x <= 0.5
    expected = 3 * x[left] - 4 * x[left] ** 3
    assert s.motion.y[left] / s.motion.y[n // 2] == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("vertices", [12, 50, 200])
@pytest.mark.parametrize("eta", [0.0, 3.0])
def test_bulk_modulus_of_a_ring(vertices, eta):
    """K_e = K_Ω + k_s tan(π/N), Eq. (18) and (22) of the paper: no 2π/N for tan(π/N) as in (23)."""
    length = 2 * np.sin(np.pi / vertices)
    shell = 0.1 / length * np.tan(np.pi / vertices)
    bulk = (1 + eta) * shell
    pressure = 1e-4 * bulk

    def outward(strain):
        """Net force on a vertex of the ring, from outside pressed by ``pressure``."""
        core = Core("elastic", eta * shell, -pressure)
        s = system(ring(vertices, core=core, bend=0.0, thickness=0.1), stiffness=1e-300)
        s.motion.x[:] *= 1 + strain
        s.motion.y[:] *= 1 + strain
        f = forces(s)
        return f[0] @ [s.motion.x[0], s.motion.y[0]]

    strain = brentq(outward, -1e-3, 0.0, xtol=1e-12)
    change = (1 + strain) ** 2 - 1
    assert pressure / -change == pytest.approx(bulk, rel=2e-4)


def test_pressure_at_which_a_ring_buckles():
    """p = 3 EI/R³: there the lowest stiffness of the ring passes through zero."""
    n, bend = 48, 1e-3
    step = 2 * np.sin(np.pi / n)

    def lowest(pressure):
        # The rest length that holds the ring at radius 1 against the pressure.
        tension = -pressure * step / (2 * np.tan(np.pi / n))
        body = ring(n, bend=bend, stretch=100.0, core=Core("drained", 0.0, -pressure))
        s = system(body, stiffness=1e-300)
        s.chains.rest_length[:] = step - tension / s.chains.stretch_stiffness
        assert np.abs(forces(s)).max() < 1e-11
        found = squared_frequencies(s)
        return min(found, key=lambda value: (abs(value) < 1e-7, value))  # no rigid motion

    pressures = np.array([2.9, 3.1]) * bend
    values = [lowest(p) for p in pressures]
    critical = np.interp(0.0, values[::-1], pressures[::-1])
    assert critical == pytest.approx(3 * bend, rel=0.01)


def vibrating(n, thickness, amplitude=1e-3):
    """A ring that starts in its slowest vibration: u_r = a cos 2φ, u_φ = −(a/2) sin 2φ."""
    s = system(ring(n, thickness=thickness), stiffness=1e-300)
    phi = np.arctan2(s.motion.y, s.motion.x)
    radial, tangential = np.cos(2 * phi), -0.5 * np.sin(2 * phi)
    slowest = np.sqrt(7.2 * thickness**3 / 12 / (n / (2 * np.pi)))  # ω² = 36 EI/(5 ρ R⁴)
    speed = amplitude * slowest
    s.motion.vx[:] = speed * (radial * np.cos(phi) - tangential * np.sin(phi))
    s.motion.vy[:] = speed * (radial * np.sin(phi) + tangential * np.cos(phi))
    s.begin()
    return s, slowest, radial, phi


def test_slowest_vibration_of_a_ring():
    """ω² = (36/5) EI/(ρ_l R⁴), within 1 %."""
    s, slowest, radial, phi = vibrating(100, 0.05)
    every = max(1, int(0.05 / (slowest * s.rules.step)))
    time, amplitude = [], []
    while s.time < 4 * 2 * np.pi / slowest:
        s.advance(every)
        out = s.motion.x * np.cos(phi) + s.motion.y * np.sin(phi)
        time.append(s.time)
        amplitude.append(out @ radial)
    amplitude = np.array(amplitude)
    change = np.flatnonzero(np.diff(np.sign(amplitude)))
    zeros = [np.interp(0, amplitude[[k, k + 1]][:: 1 if amplitude[k] < 0 else -1],
                       np.array(time)[[k, k + 1]][:: 1 if amplitude[k] < 0 else -1])
             for k in change]  # fmt: skip
    found = np.pi * (len(zeros) - 1) / (zeros[-1] - zeros[0])
    assert found == pytest.approx(slowest, rel=0.01)


def test_energy_does_not_drift_in_a_thousand_periods():
    """Slope of a line through the energy, times 1,000 periods: under 1e-6 of the energy."""
    s, slowest, _, _ = vibrating(16, 0.3, 0.02)
    total = s.kinetic()
    period = 2 * np.pi / slowest
    time, missing = [], []
    while s.time < 1000 * period:
        s.advance(997)
        time.append(s.time / period)
        missing.append(s.budget().missing / total)
    drift = np.polyfit(time, missing, 1)[0] * 1000
    assert abs(drift) < 1e-6
    assert np.abs(missing).max() < 1e-3


@pytest.mark.parametrize("step", [0.2, 0.1])
def test_momenta_of_a_free_ring(step):
    """Momentum and angular momentum to round-off, whatever the shell and the core do."""
    rng = np.random.default_rng(5)
    body = ring(points=polygon(rng), core=Core("log", 0.5, 0.01), stretch_damping=0.2,
                bend_damping=0.3, bend_yield=3e-6)  # fmt: skip
    s = system(body)
    s.rules = s.rules._replace(step=step * s.stable_step)
    s.motion.vx[:], s.motion.vy[:] = rng.normal(0, 0.01, (2, 9))
    s.begin()
    p, spin = momentum(s), angular_momentum(s)
    s.advance(20_000)
    assert momentum(s) == pytest.approx(p, abs=1e-14)
    assert angular_momentum(s) == pytest.approx(spin, abs=1e-13)
    assert s.budget().bend_yield > 1e-7  # it was bent for good


def test_energy_balance_of_a_plastic_damped_ring_improves_fourfold():
    """Every loss by its own force: what is missing is under 1e-6 of it, and of second order."""
    missing = []
    for fraction in (0.2, 0.1):
        body = ring(16, thickness=0.2, stretch_damping=0.1, bend_damping=0.1, bend_yield=3e-5,
                    stretch_yield=2e-3, core=Core("elastic", 0.1))  # fmt: skip
        s = system(body, drag=1e-3)
        s.rules = s.rules._replace(step=fraction * s.stable_step)
        phi = np.arctan2(s.motion.y, s.motion.x)
        s.motion.vx[:] = 0.01 * np.cos(2 * phi) * np.cos(phi)
        s.motion.vy[:] = 0.01 * np.cos(2 * phi) * np.sin(phi)
        s.begin()
        work = s.kinetic()
        s.advance(round(200 / s.rules.step))
        b = s.budget()
        assert min(b.bend_yield, b.stretch_yield, b.damping, b.drag) > 1e-3 * work
        missing.append(abs(b.missing) / work)
    assert missing[0] < 1e-3
    assert missing[1] < missing[0] / 3


def test_a_driven_vertex_and_a_load_do_the_work_they_say():
    """A ring pulled by one vertex at a fixed speed and one constant force."""
    body = ring(12, thickness=0.2, bend_damping=0.2, stretch_damping=0.2)
    s = system(body)
    s.hold(np.array([0]), vx=0.01, vy=None)
    s.load(np.array([6]), fx=-1e-4, fy=2e-5)
    s.begin()
    s.advance(3000)
    b = s.budget()
    moved = 0.01 * s.time
    assert s.motion.x[0] == pytest.approx(ring_points(12, 1.0)[0, 0] + moved)
    work = abs(b.by_velocities) + abs(b.by_forces)
    assert min(abs(b.by_velocities), abs(b.by_forces)) > 1e-6
    assert abs(b.missing) < 1e-6 * work


@pytest.mark.parametrize("rigid", [False, True])
def test_work_of_loads_that_change_in_mid_run(rigid):
    """A straight chain pulled along itself: nothing is of second order in its balance."""
    s = system(chain([(0, 0), (1, 0), (2, 0)], stretch=1.0))
    if rigid:
        s.make_rigid(np.array([0]))
    s.load(np.array([2]), fx=2e-2)
    s.begin()
    s.advance(40)
    pulled = s.budget().by_forces
    assert pulled == pytest.approx(2e-2 * (s.motion.x[2] - 2.0))
    s.load(np.array([1]), fx=-1e-2)
    s.load(np.array([0]), fx=-1e-2)
    assert s.budget().by_forces == pulled
    s.advance(40)
    s.load(np.array([0, 2]), fx=3e-2)
    s.advance(40)
    b = s.budget()
    assert b.by_forces > 1e-4
    assert abs(b.missing) < 1e-9 * b.by_forces


@pytest.mark.parametrize("law", ["elastic", "drained", "gas", "log"])
def test_work_of_a_pressure_that_changes_in_mid_run(law):
    """What is missing is of second order in the step, as where nothing changes."""
    missing = []
    for fraction in (0.2, 0.1):
        core = Core(law, 0.0 if law == "drained" else 0.05, 0.002)
        s = system(ring(16, thickness=0.2, core=core, stretch_damping=0.1))
        s.rules = s.rules._replace(step=fraction * s.stable_step)
        s.begin()
        for pressure in (0.003, 0.001, 0.004):
            s.press(0, pressure)
            s.advance(round(20 / s.rules.step))
        b = s.budget()
        assert b.by_pressure != 0.0
        missing.append(abs(b.missing) / (abs(b.by_pressure) + b.damping))
    assert missing[0] < 1e-3
    assert missing[1] < max(missing[0] / 3, 1e-12)  # exact, if drained
