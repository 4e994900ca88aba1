"""The order of each integrator on smooth problems, and what events leave of it.

Smooth: nothing begins or ceases to touch, to stick or to slide. There velocity Verlet is of order 2
in every position, velocity and spin, dashpots, friction and drag included, and the semi-implicit
Euler of order 1; found within 0.04 and 0.05 of it from 80 steps on, which is 0.15 of √(m/k) each.

Events leave this, as the slope of the root mean square error over starts that put the events at
other places in the step:

=====================================  ======  =====
order found                            Verlet  Euler
=====================================  ======  =====
sticks and slides, no dashpots         2.1     1.1
opens and closes, no dashpots          2.0     1.0
opens and closes, with dashpots        1.2     1.1
=====================================  ======  =====

What starts from zero, as springs and Coulomb's limit do, only bends where the event is: that costs
no order. A dashpot jumps to η v_n where discs touch, anywhere in the step: this alone is of first
order. In packings it is small: the stress error falls at order 2.0 where no contact opens, and at
1.4 for loose discs at amplitudes of 0.1 to 0.3, from errors that are far below 0.5 % already
(analysis/default_steps.py prints both), so that a scheme which finds the instant of every contact
would buy nothing. The slip of a new contact is counted from where in the step it began to touch.
"""

import functools

import numpy as np
import pytest
from scenes import scene

from shear_sim.models.microgel.parameters import Integrator, Links, Microgel, MicrogelPoint
from shear_sim.models.microgel.preparation import prepare
from shear_sim.packing import Packing
from shear_sim.protocol import OscillatoryShear
from shear_sim.streams import Streams

DIVERGENT = (1.0, 1.0, 1.0, 1.0)
SPRINGS = {"k": 1.0, "kt": 0.7}
DASHPOTS = {"eta": 0.05, "etat": 0.035}


def path(simulation, states=None):
    """Return positions, velocities and spins ten times on the way; note the states of the pairs."""
    found = []
    simulation.advance(1)
    block = (simulation.rows - 1) // 10
    while simulation.done < simulation.rows:
        for _ in range(block if states is not None else 1):
            simulation.advance(1 if states is not None else block)
            if states is not None:
                states.append(simulation.pairs.state.copy())
        d = simulation.discs
        found.append([d.x.copy(), d.y.copy(), d.cx.copy(), d.cy.copy(), d.spin.copy()])
    assert simulation.substeps % simulation.steps == 0  # all of one length
    return np.array(found)


def cluster(steps, euler, states=None):
    """Four discs with five links, set free: they ring and tumble, with drag on all motion."""
    s = scene(
        [(100.0, 100.0), (101.8, 100.1), (100.8, 101.7), (102.6, 101.75)],
        1.0,
        links=[(0, 1), (0, 2), (1, 2), (1, 3), (2, 3)],
        velocity=np.array([(0.1, -0.2), (0.05, 0.1), (-0.2, 0.05), (0.1, 0.12)]),
        spin=np.array([0.3, -0.2, 0.1, 0.0]),
        step=12.0 / steps, steps=steps, euler=euler, damping=0.02, spin_damping=0.02,
        **SPRINGS, **DASHPOTS,
    )  # fmt: skip
    s.constants = s.constants._replace(law=DIVERGENT)
    return path(s, states)


def contact(steps, euler, states=None, *, gap=0.0, off=0.3, start=0.0, speed=0.1, **more):
    """A disc that oscillates between two discs of plates that move apart sideways."""
    height = 5.6 + gap
    values = {"friction": 100.0, "strain_rate": 0.004, **SPRINGS, **DASHPOTS} | more
    s = scene(
        [(100.0, 1.0), (100.0 + off, 0.5 * height + start), (100.0, height - 1.0)],
        1.0,
        velocity=np.array([(0.0, 0.0), (0.0, speed), (0.0, 0.0)]),
        spin=np.array([0.0, 0.2, 0.0]),
        step=12.0 / steps, steps=steps, euler=euler, plates=True, height=height,
        **values,
    )  # fmt: skip
    s.constants = s.constants._replace(law=DIVERGENT)
    return path(s, states)


def crystal(steps, euler, states=None):
    """A crystal in oscillatory shear, frictional contacts that stick, discs that also shiver."""
    point = MicrogelPoint(
        packing=Packing(
            start="hexagonal", discs=24, columns=4, packing_fraction=1.3, size_ratio=1
        ),
        model=Microgel(friction=10.0, links=Links(cut="none")),
        shear=OscillatoryShear(
            strain_amplitude=0.01, pre_periods=0, periods=0.5, post_periods=0
        ),
        integrator=Integrator(
            steps_per_period=10 * steps,
            scheme="semi_implicit_euler" if euler else "velocity_verlet",
        ),
    )  # fmt: skip
    s = prepare(point, Streams(0, 0))
    radius = s.discs.radius.mean()
    tau = point.shear.relative_frequency * s.clock.step * s.clock.per_period
    shiver = np.random.default_rng(0).normal(size=(24, 2)) * 0.02 * radius / tau
    s.discs.cx[:], s.discs.cy[:] = (shiver - shiver.mean(axis=0)).T
    units = np.array([radius, radius, radius / tau, radius / tau, 1 / tau])
    return path(s, states) / units[:, None]


@functools.cache
def reference(problem):
    return problem(64 * 40, euler=False)


@pytest.mark.parametrize("problem", [cluster, contact, crystal])
@pytest.mark.parametrize(("euler", "order"), [(False, 2), (True, 1)])
def test_order_on_smooth_problems(problem, euler, order):
    """Both schemes, to the limit of the better one: they solve the same equations."""
    states = []
    errors = [np.linalg.norm(problem(n, euler) - reference(problem)) for n in (160, 320)]
    problem(160, euler, states)
    assert (np.diff(np.array(states), axis=0) == 0).all()  # smooth indeed
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)


SLIPPING = {"off": 0.0, "speed": 0.0, "friction": 0.05, "eta": 0.0, "etat": 0.0}
BOUNCING = {"gap": 0.6, "speed": 0.3, "friction": 0.0, "kt": 0.0, "etat": 0.0, "strain_rate": 0.0}


@pytest.mark.parametrize(
    ("events", "verlet", "euler"),
    [(SLIPPING, 2.05, 1.1), (BOUNCING | {"eta": 0.0}, 2.05, 1.0), (BOUNCING, 1.2, 1.05)],
    ids=["sticks and slides", "opens and closes", "the same with dashpots"],
)
def test_what_events_leave_of_the_order(events, verlet, euler):
    """Slope of the root mean square error over 24 starts, from 40 to 1280 steps."""
    starts = 0.002 * np.arange(24)
    states = []
    contact(640, False, states, **events)
    assert (np.diff(np.array(states), axis=0) != 0).any()
    exact = np.array([contact(256 * 40, False, start=start, **events) for start in starts])
    steps = 40 * 2 ** np.arange(6)
    for scheme, order in ((False, verlet), (True, euler)):
        error = []
        for n in steps:
            ends = np.array([contact(n, scheme, start=start, **events) for start in starts])
            error.append(np.sqrt(np.mean((ends - exact) ** 2)))
        slope = np.polyfit(np.log(steps), np.log(error), 1)[0]
        assert -slope == pytest.approx(order, abs=0.15)
