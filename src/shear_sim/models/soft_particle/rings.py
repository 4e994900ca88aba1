"""The particles of a study: what they are made of, and the scales that results are measured in."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.soft_particle.bodies import Body, Core, Shell, ring_points
from shear_sim.models.soft_particle.parameters import SoftParticle
from shear_sim.models.soft_particle.system import System

FloatArray = NDArray[np.float64]

SLOWEST = 36.0 / 5.0  # ω₁² ρ_l R⁴/EI of a ring


class Scales(NamedTuple):
    """What results are measured in, per metre of depth."""

    bending: float  # E I [N m]
    segment: float  # ℓ [m]
    hinge: float  # k_b [N]
    shell_modulus: float  # K_∂Ω = k_s tan(π/N) [Pa]
    core_modulus: float  # K_Ω [Pa]
    mass: float  # of a vertex [kg/m]
    frequency: float  # ω₁ [1/s]
    stiffness: float  # k_n of contacts [N/m²]

    @property
    def period(self) -> float:
        """T₁ [s]."""
        return 2.0 * math.pi / self.frequency


def scales(model: SoftParticle, vertices: int, radius: float) -> Scales:
    """Return the scales of a ring of ``radius`` [m]."""
    shell = Shell.of_material(model.young_modulus, model.thickness * radius, model.poisson_ratio)
    segment = 2.0 * radius * math.sin(math.pi / vertices)
    hinge = shell.bend / segment
    modulus = shell.stretch / segment * math.tan(math.pi / vertices)
    mass = model.density * math.pi * radius**2 / vertices
    per_length = mass * vertices / (2.0 * math.pi * radius)
    return Scales(
        shell.bend,
        segment,
        hinge,
        modulus,
        model.core_ratio * modulus,
        mass,
        math.sqrt(SLOWEST * shell.bend / per_length) / radius**2,
        model.contact_stiffness * hinge / segment**2,
    )


def ring_body(model: SoftParticle, vertices: int, mean: float, radius: float | None = None) -> Body:
    """Return a ring at rest around the origin; ``radius``: its own [m], by default the mean one."""
    points = ring_points(vertices, mean if radius is None else radius)
    return body(model, vertices, mean, points)


def body(model: SoftParticle, vertices: int, mean: float, points: FloatArray) -> Body:
    """Return a particle at rest in the shape of ``points``.

    Parameters
    ----------
    vertices : int
        N of the mean ring.
    mean : float
        Its radius of the mid-line [m], that the numbers of ``model`` are relative to. Shells of all
        sizes are of the same thickness and material, cores and the masses of vertices the same.
    points : (n, 2)
        Vertices [m].
    """
    unit = scales(model, vertices, mean)
    thickness = model.thickness * mean
    elastic = Shell.of_material(model.young_modulus, thickness, model.poisson_ratio)
    moment, force = model.yield_moment, model.yield_force
    shell = Shell(
        elastic.stretch,
        elastic.bend,
        math.inf if force is None else force * elastic.stretch,
        math.inf if moment is None else moment * unit.bending / mean,
        model.damping,
        model.damping,
        model.inner_damping * unit.mass * unit.frequency,
    )
    core = Core() if model.core_ratio == 0.0 else Core(model.core, unit.core_modulus)
    return Body(points, True, 0.5 * thickness, unit.mass, shell, core)


def shapes(system: System) -> tuple[float, float]:
    """Return the area of all particles [m²], with their shells, and their mean circularity."""
    chains, motion = system.chains, system.motion
    sides = np.hypot(motion.x[chains.after] - motion.x, motion.y[chains.after] - motion.y)
    perimeter = np.add.reduceat(sides, chains.start[:-1])
    area = np.array([system.area(p) for p in range(len(chains.closed))])
    r = chains.radius
    solid = float((area + perimeter * r + math.pi * r**2).sum())
    return solid, float((4.0 * math.pi * area / perimeter**2).mean())
