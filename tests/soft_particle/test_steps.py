"""Steps that dashpots make unstable are refused: in a study, of its particles, and from Python."""

import re

import numpy as np
import pytest
from soft_particles import chain, points, ring, squared_frequencies, system

from shear_sim.document import StudyError
from shear_sim.models import soft_particle
from shear_sim.models.interface import SimulationError
from shear_sim.models.soft_particle.bodies import Core
from shear_sim.models.soft_particle.parameters import SoftParticle
from shear_sim.models.soft_particle.simulation import SoftParticleSimulation
from shear_sim.models.soft_particle.stability import longest_share
from shear_sim.models.soft_particle.walls import Wall
from shear_sim.streams import Streams
from shear_sim.study import load_study

FREE = points(packing={}, model={}, shear={"kind": "vibration"})


@pytest.mark.parametrize("vertices", [12, 100])
@pytest.mark.parametrize(
    "law",
    [
        {"damping": 0.0, "drag": 2.0},
        {"damping": 0.3, "inner_damping": 2.0, "drag": 0.0},
        {"damping": 1.0, "thickness": 0.15, "contact_stiffness": 100.0},
        {"damping": 0.5, "core": "elastic", "core_ratio": 1000.0, "poisson_ratio": 0.4},
        {"damping": 0.5, "core": "gas", "core_pressure": 0.8},
        {"damping": 0.5, "core": "log", "core_ratio": 10.0, "core_pressure": 0.8},
    ],
)
def test_the_bound_of_a_study_is_that_of_its_ring(vertices, law):
    given = FREE(model=law, packing={"vertices": vertices}, integrator={"step": 0.01})
    found = longest_share(given.model, vertices)
    s = SoftParticleSimulation(given, Streams(1, 0)).run.system
    assert found == pytest.approx(s.longest_step() / s.stable_step, rel=1e-9)
    assert found < 0.9 or law["damping"] == 0.0


def test_a_step_over_the_bound_of_a_study(tmp_path):
    """The error names the file, the keys and a value that is right."""
    study = tmp_path / "fast.yaml"
    text = "model: {{kind: soft_particle, damping: 0.6}}\nintegrator: {{step: {}}}\n"
    study.write_text(text.format(0.3))
    with pytest.raises(StudyError, match=r"fast\.yaml:2: integrator\.step = 0\.3: ") as error:
        load_study(study)
    found = float(re.search(r"integrator\.step = ([\d.]+) at most", str(error.value))[1])
    assert 0.99 * found < longest_share(SoftParticle(damping=0.6), 100) < 1.01 * found
    study.write_text(text.format(found))
    load_study(study)
    study.write_text(text.format(1.02 * found))
    with pytest.raises(StudyError, match="at most"):
        load_study(study)


def test_a_step_over_the_bound_of_the_particles():
    """The smallest ring of a box is stiffer than the mean one that the study was checked with."""
    given = points(
        packing={"particles": 16, "vertices": 24, "spread": 0.3},
        model={"damping": 0.3, "thickness": 0.2}, shear={"kind": "compaction"},
    )  # fmt: skip
    of_study = longest_share(given().model, 24)
    with pytest.raises(SimulationError, match=r"integrator\.step = .* at most 0\.\d+, or") as error:
        soft_particle.start(given(integrator={"step": 0.99 * of_study}), Streams(0, 0))
    found = float(re.search(r"at most (0\.\d+)", str(error.value))[1])
    assert found < 0.9 * of_study
    soft_particle.start(given(integrator={"step": found}), Streams(0, 0))


LOSSES = {
    "stretch": ({"stretch_damping": 1.5}, {}),
    "bend": ({"bend_damping": 1.5}, {}),
    "inner": ({"inner_damping": 6.0}, {}),
    "drag": ({}, {"drag": 6.0}),
}


@pytest.mark.parametrize("kind", LOSSES)
def test_a_step_over_the_bound_from_python(kind):
    """And the one that is asked for instead is stable, as is the default."""
    law, given = LOSSES[kind]
    free = system(ring(thickness=0.3)).stable_step
    with pytest.raises(ValueError, match=r"^step = .* s is none, or not stable with") as error:
        system(ring(thickness=0.3, **law), step=0.8 * free, **given)
    found = float(re.search(r"at most ([\d.]+)$", str(error.value))[1])
    rng = np.random.default_rng(1)
    for step in (found, None):
        s = system(ring(thickness=0.3, **law), step=step, **given)
        s.motion.vx[:], s.motion.vy[:] = 1e-4 * rng.standard_normal((2, 24))
        s.begin()
        stirred = s.kinetic()
        s.advance(2000)
        assert s.kinetic() < 0.3 * stirred
    s.rules = s.rules._replace(step=1.6 * found)
    s.motion.vx[:], s.motion.vy[:] = 1e-4 * rng.standard_normal((2, 24))
    with pytest.raises(SimulationError, match=r"with these dashpots a step is surely stable up to"):
        s.advance(20_000)


@pytest.mark.parametrize("time", [1.0, 0.0, -1.0, np.nan, np.inf])
@pytest.mark.parametrize("share", [0.5, 0.91, 5.0, 0.0, -1.0, np.nan])
def test_a_time_is_divided_into_stable_steps_only(time, share):
    s = system(ring(), step=0.1)
    if (time, share) == (1.0, 0.5):
        steps = s.divide(time, share)
        assert steps * s.rules.step == pytest.approx(time)
        assert s.rules.step <= share * s.stable_step
        return
    with pytest.raises(ValueError, match=r"^(time|share) = .* finite and over 0|not stable"):
        s.divide(time, share)
    assert s.rules.step == 0.1


def test_a_time_is_divided_into_steps_that_dashpots_leave_stable():
    s = system(ring(thickness=0.3, bend_damping=1.5))
    share = 1.05 * s.longest_step() / s.stable_step
    assert share < 0.9
    with pytest.raises(ValueError, match="not stable with these springs and dashpots"):
        s.divide(1.0, share)


def test_the_advice_of_a_guard_is_a_step_that_a_study_may_have():
    s = system(ring(), drag=1e-9)
    s.rules = s.rules._replace(step=4.0 * s.stable_step)
    s.motion.vx[0] = 1e-6
    with pytest.raises(SimulationError, match="surely stable up to") as error:
        s.advance(20_000)
    assert float(re.search(r"step = ([\d.]+):", str(error.value))[1]) <= 0.9


def squeezed(damping, share):
    """A vertex between two bars that overlap it by 0.7 of the distance of touching."""
    bars = [chain([(-1, y), (1, y)], thickness=0.2) for y in (-0.06, 0.06)]
    away = chain([(0, 0), (0.9, 0)], thickness=0.2, stretch=1e-12)
    s = system(*bars, away, stiffness=1.0, contact_damping=damping)
    s.hold(np.array([0, 1, 2, 3, 5]))
    s.chains.after[4] = -1  # its own segment touches nothing
    s.begin()
    s.motion.vy[4] = 1e-4
    s.rules = s.rules._replace(step=share * s.stable_step)
    return s


@pytest.mark.parametrize(
    ("share", "problem"), [(0.55, "went through a segment"), (0.9, "moves by more than half")]
)
def test_dashpots_of_deep_contacts(share, problem):
    """They grow with the overlap, so nothing is refused beforehand; the guard speaks of them."""
    for damping, stable in ((0.0, 0.9), (1.0, 0.4)):
        squeezed(damping, stable).advance(2000)
    advice = r".* stable up to integrator\.step = 0\.\d+: that, or less damping"
    with pytest.raises(SimulationError, match=problem + advice):
        squeezed(1.0, share).advance(2000)


def light_wall(vertices, *, mass=1e-3, damping=0.0, low=0.0):
    """A wall at rest on held vertices, of which those at the ends are lower; k = 2 for each."""
    height = np.zeros(vertices)
    height[[0, -1]] -= low
    bed = chain(np.column_stack([np.arange(vertices), height]), thickness=0.2)
    wall = Wall(0.0, -1.0, -0.09, mass=mass, load=0.02 * vertices, damping=damping)
    s = system(bed, walls=[wall], stiffness=1.0)
    s.hold(np.arange(vertices))
    return s


def swing(s, share, bound, steps):
    """The largest way of the wall from where it is at rest, / that of a spring, v/ω."""
    s.rules = s.rules._replace(step=share * bound)
    s.begin()
    rest, most = float(s.walls.position[0]), 0.0
    s.walls.velocity[0] = 1e-12
    for _ in range(steps):
        s.advance(1)
        most = max(most, abs(float(s.walls.position[0]) - rest))
    return most / 1e-12


@pytest.mark.parametrize("n", [2, 4])
def test_a_light_wall_is_in_the_bound(n):
    """ω² = 2 k_n n/M on held vertices; bound: 3 k_n n/M. A swing is v/ω √(1 − (ω δt)²/4)⁻¹."""
    omega = np.sqrt(2.0 * n / 1e-3)
    bound = 2.0 / np.sqrt(1.5) / omega
    assert light_wall(n).rules.step == pytest.approx(0.9 * bound)
    exact = 1.0 / omega / np.sqrt(1.0 - 0.98**2 / 1.5)
    assert swing(light_wall(n), 0.98, bound, 500) == pytest.approx(exact, rel=0.01)
    with pytest.raises(SimulationError, match=f"wall 0 is too light .* with {n} vertices") as error:
        swing(light_wall(n), 1.3, bound, 1)
    found = float(re.search(r"steps of ([\d.]+) s at most", str(error.value))[1])
    assert 0.99 * bound < found < bound
    unguarded = light_wall(n)
    unguarded._guard = lambda _: None
    assert swing(unguarded, 1.3, bound, 20) > 1e3 / omega


def test_a_light_wall_that_comes_to_touch_more():
    """It is stable with the middle one of three, and not with all."""
    bound = 2.0 / np.sqrt(3.0 / 1e-3)
    swing(light_wall(3, low=0.2), 0.98, bound, 10)
    s = light_wall(3, low=0.02)
    with pytest.raises(SimulationError, match="with 3 vertices at it: a larger mass"):
        swing(s, 0.98, bound, 100)
    assert s.steps > 0


def test_a_damped_light_wall_comes_to_rest():
    """Its dashpot is in the bound: at that of the spring alone the wall is thrown off."""
    free = 2.0 / np.sqrt(6.0 / 1e-3)
    s = light_wall(2, damping=0.2)
    step = s.rules.step / 0.9
    assert step < 0.2 * free
    swing(s, 0.98, step, 2000)
    assert abs(float(s.walls.velocity[0])) < 1e-14
    with pytest.raises(SimulationError, match="too light"):
        swing(light_wall(2, damping=0.2), 0.98, free, 1)


def test_a_pressure_over_the_bound():
    """|p₀| is a part of ω² m; what doubles it is refused at 0.9 · 2/ω, a fifth of it is not."""
    s = system(ring(core=Core("drained")), stiffness=1e-3)
    s.rules = s.rules._replace(step=0.9 * s.stable_step)
    squared = (2.0 / s.stable_step) ** 2  # of unit masses
    s.press(0, 0.2 * squared)
    with pytest.raises(ValueError, match=r"^pressure = .* Pa makes the step of .* s unstable"):
        s.press(0, squared)
    assert s.chains.core_pressure[0] == 0.2 * squared
    s.chains.core_pressure[0] = 4.0 * squared
    assert squared_frequencies(s).max() > (2.0 / s.rules.step) ** 2
