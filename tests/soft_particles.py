"""Small scenes of soft particles."""

import pickle

import numpy as np

from shear_sim.models import soft_particle
from shear_sim.models.soft_particle.bodies import Body, Core, Shell, ring_points
from shear_sim.models.soft_particle.parameters import SoftParticlePoint
from shear_sim.models.soft_particle.system import System
from shear_sim.streams import Streams


def points(**usual):
    """Return a function that makes points of a study: the ``usual`` sections, with changes."""

    def point(model=None, packing=None, shear=None, **sections):
        changes = {"model": model or {}, "packing": packing or {}, "shear": shear or {}}
        changed = {name: usual[name] | change for name, change in changes.items()}
        return SoftParticlePoint.model_validate(usual | changed | sections)

    return point


def prepared(given, seed=0):
    """The simulation of a point, before its first record."""
    simulation = soft_particle.start(given, Streams(seed, 0))
    while not simulation.run.prepare(1000):
        pass
    return simulation


def finished(given, seed=0):
    """The simulation of a point, run to its end."""
    simulation = prepared(given, seed)
    simulation.advance(10_000)
    return simulation


def prepared_in_parts(given):
    """Prepare in one piece, and in parts of which each is kept in a file; return their number."""
    whole = prepared(given)
    simulation = soft_particle.start(given, Streams(0, 0))
    assert simulation.run.system.steps == 0
    parts = 0
    while not simulation.run.prepare(20):
        parts += 1
        simulation = pickle.loads(pickle.dumps(simulation))  # noqa: S301 - our own
        simulation.threads = 1 + parts % 2
        assert simulation.done == 0 < simulation.run.system.steps
    for name in ("x", "y", "vx", "vy"):
        one, other = (getattr(s.run.system.motion, name) for s in (whole, simulation))
        assert np.array_equal(one, other), name
    assert whole.run.preparation() == simulation.run.preparation()
    return parts


def goes_on_to_the_same_bits(given, rows):
    """Run a point whole, and again from what was kept of it after ``rows`` records."""
    whole = prepared(given)
    whole.advance(rows)
    again = pickle.loads(pickle.dumps(whole))  # noqa: S301 - our own
    whole.advance(10_000)
    again.advance(10_000)
    for name, values in whole.columns().items():
        assert np.array_equal(values, again.columns()[name]), name
    assert whole.summary() == again.summary()


def polygon(rng, vertices=9, radius=1.0, x=0.0, y=0.0):
    """A wobbly ring, convex and concave corners."""
    points = ring_points(vertices, radius) * rng.uniform(0.8, 1.2, (vertices, 1))
    return points + np.array([x, y])


def ring(
    vertices=24, radius=1.0, x=0.0, y=0.0, *, thickness=0.1, mass=1.0, core=None, points=None, **law
):
    """A ring of E = 1 with ``law`` over its shell."""
    shell = Shell.of_material(1.0, thickness)
    shell = Shell(**{"stretch": shell.stretch, "bend": shell.bend} | law)
    points = ring_points(vertices, radius, x, y) if points is None else points
    return Body(points, True, 0.5 * thickness, mass, shell, core or Core())


def chain(points, *, thickness=0.1, mass=1.0, stretch=0.1, bend=1e-4, **given):
    """An open chain."""
    shell = Shell(stretch, bend)
    return Body(np.asarray(points, float), False, 0.5 * thickness, mass, shell, **given)


def forces(system):
    """The forces (V, 2) of the present positions."""
    system._list()
    system._forces(system.rules._replace(step=0.0))
    return np.column_stack([system.motion.fx, system.motion.fy])


def slope(system, at=None, step=1e-6):
    """−∂(stored energy)/∂(position) (V, 2) by central differences, of vertices ``at``."""
    out = np.zeros((len(system.motion.x), 2))
    for axis, values in enumerate((system.motion.x, system.motion.y)):
        for k in range(len(values)) if at is None else at:
            here = values[k]
            values[k] = here + step
            system._list()
            up = sum(system.stored())
            values[k] = here - step
            system._list()
            out[k, axis] = -(up - sum(system.stored())) / (2 * step)
            values[k] = here
    system._list()
    return out


def squared_frequencies(system, step=1e-6):
    """The squares ω² (2 V,) of all frequencies of unit masses, the lowest first.

    They are the eigenvalues of the Hessian, of central differences of forces.
    """
    vertices = len(system.motion.x)
    hessian = np.zeros((2 * vertices, 2 * vertices))
    for column in range(2 * vertices):
        values, k = (system.motion.x if column < vertices else system.motion.y), column % vertices
        here, pair = values[k], []
        for sign in (1, -1):
            values[k] = here + sign * step
            pair.append(forces(system).T.ravel())
        values[k] = here
        hessian[:, column] = -(pair[0] - pair[1]) / (2 * step)
    return np.linalg.eigvalsh(0.5 * (hessian + hessian.T))


def system(*bodies, stiffness=1.0, **given):
    return System(list(bodies), stiffness=stiffness, **given)


HOUSE = [(0, 0), (2, 0), (4, 0), (4, 2), (2, 0.8), (0, 2)]  # a concave corner at (2, 0.8)


def probe(points, at, closed=True, thickness=0.2, stiffness=1.0, **given):
    """A fixed chain and one free vertex; a chain of no stiffness, so its other end is far away."""
    at = np.array(at, float)
    body = (ring(points=np.array(points, float), thickness=thickness) if closed
            else chain(points, thickness=thickness))  # fmt: skip
    away = chain([at, at + given.pop("tail", (0.0, 5.0))], thickness=thickness, stretch=1e-12)
    s = system(body, away, stiffness=stiffness, **given)
    n = len(points)
    s.hold(np.arange(n))
    s.hold(np.array([n + 1]))
    s.chains.after[n] = -1  # its own segment touches nothing
    s.begin()
    return s, n


def angular_momentum(s):
    m = s.motion
    return float((s.chains.mass * (m.x * m.vy - m.y * m.vx)).sum())


def momentum(s):
    m = s.motion
    return np.array([(s.chains.mass * m.vx).sum(), (s.chains.mass * m.vy).sum()])
