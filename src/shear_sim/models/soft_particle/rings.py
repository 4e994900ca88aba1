"""The particles of a study: what they are made of, and the scales that results are measured in."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.soft_particle import strips
from shear_sim.models.soft_particle.bodies import Body, Core, Shell, ring_points
from shear_sim.models.soft_particle.kernels import ring_area
from shear_sim.models.soft_particle.parameters import SoftParticle, SoftParticlePacking
from shear_sim.models.soft_particle.state import Chains, Motion

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
        modulus * (model.core_pressure if model.core == "gas" else model.core_ratio),
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
        Vertices [m]; of a regular polygon, if its core has a pressure.
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
    if model.core_ratio == model.core_pressure == 0.0:
        return Body(points, True, 0.5 * thickness, unit.mass, shell)
    pressure, rest = model.core_pressure * unit.shell_modulus, None
    if pressure > 0.0:
        # Tension p ℓ/2 tan(π/N) of a regular polygon, paper (20), (21).
        length = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
        tension = 0.5 * pressure * length / math.tan(math.pi / len(points))
        rest = length / (1.0 + tension / elastic.stretch)
    core = Core(model.core, unit.core_modulus, pressure)
    return Body(points, True, 0.5 * thickness, unit.mass, shell, core, rest)


def disc_radius(model: SoftParticle) -> float:
    """Return the radius of the disc that a ring stands for, with its thickness / its own radius."""
    return 1.0 + 0.5 * model.thickness


def rings_in_discs(
    model: SoftParticle,
    packing: SoftParticlePacking,
    x: FloatArray,
    y: FloatArray,
    size: FloatArray,
    rng: np.random.Generator,
) -> list[Body]:
    """Return a ring for each disc, turned at random, within its disc.

    Parameters
    ----------
    x, y, size : (N,)
        Centres and radii in mean radii of the discs, each of which is `disc_radius` × R.
    """
    outside = disc_radius(model)
    bodies = []
    for at_x, at_y, relative in zip(x, y, size, strict=True):
        radius = packing.radius * (relative * outside - 0.5 * model.thickness)
        ring = ring_body(model, packing.vertices, packing.radius, radius)
        turn = rng.uniform(0.0, 2.0 * math.pi)
        matrix = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
        centre = packing.radius * outside * np.array([at_x, at_y])
        bodies.append(replace(ring, points=ring.points @ matrix + centre))
    return in_rows(bodies)


def in_rows(bodies: list[Body]) -> list[Body]:
    """Return particles from the lowest to the highest, if they are more than one strip.

    Then few contacts are between strips: see ``strips``.
    """
    if sum(len(body.points) for body in bodies) < 2 * strips.STRIP:
        return bodies
    return sorted(bodies, key=lambda body: float(body.points[:, 1].mean()))


def shapes(chains: Chains, motion: Motion) -> tuple[float, float]:
    """Return the area of all rings [m²], with their thickness, and their mean circularity."""
    sides = np.hypot(motion.x[chains.after] - motion.x, motion.y[chains.after] - motion.y)
    perimeter = np.add.reduceat(sides, chains.start[:-1])
    ends = zip(chains.start[:-1], chains.start[1:], strict=True)
    area = np.array([ring_area(motion.x, motion.y, first, end) for first, end in ends])
    r = chains.radius
    solid = float((area + perimeter * r + math.pi * r**2).sum())
    return solid, float((4.0 * math.pi * area / perimeter**2).mean())
