"""A ring between two plates: how it is set up, how the plates move, and what is measured."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.soft_particle.bodies import Body, Core, Shell, ring_points
from shear_sim.models.soft_particle.kernels import core_pressure
from shear_sim.models.soft_particle.parameters import SoftParticle, SoftParticlePoint
from shear_sim.models.soft_particle.state import HOLLOW
from shear_sim.models.soft_particle.system import System, Wall

FloatArray = NDArray[np.float64]

RAMP = 0.05  # part of a stroke in which the plates come to their speed, and to rest
PIECES = 50  # of a record, in each of which the plates keep their speed
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


def scales(model: SoftParticle, vertices: int, radius: float) -> Scales:
    """Return the scales of a ring."""
    shell = Shell.of_material(model.young_modulus, model.thickness * radius, model.poisson_ratio)
    segment = 2.0 * radius * math.sin(math.pi / vertices)
    modulus = shell.stretch / segment * math.tan(math.pi / vertices)
    mass = model.density * math.pi * radius**2 / vertices
    per_length = mass * vertices / (2.0 * math.pi * radius)
    return Scales(
        shell.bend,
        segment,
        shell.bend / segment,
        modulus,
        model.core_ratio * modulus,
        mass,
        math.sqrt(SLOWEST * shell.bend / per_length) / radius**2,
    )


def ring_body(model: SoftParticle, vertices: int, radius: float) -> Body:
    """Return a ring of a study at rest around the origin."""
    unit = scales(model, vertices, radius)
    elastic = Shell.of_material(model.young_modulus, model.thickness * radius, model.poisson_ratio)
    moment, force = model.yield_moment, model.yield_force
    shell = Shell(
        elastic.stretch,
        elastic.bend,
        math.inf if force is None else force * elastic.stretch,
        math.inf if moment is None else moment * unit.bending / radius,
        model.damping,
        model.damping,
    )
    core = Core() if model.core_ratio == 0.0 else Core(model.core, unit.core_modulus)
    points = ring_points(vertices, radius)
    return Body(points, True, 0.5 * model.thickness * radius, unit.mass, shell, core)


class Diametral:
    """The run: plates that touch the ring at the start, approach each other, and part again."""

    def __init__(self, point: SoftParticlePoint) -> None:
        model, packing, shear = point.model, point.packing, point.shear
        self.unit = scales(model, packing.vertices, packing.radius)
        body = ring_body(model, packing.vertices, packing.radius)
        self.radius, self.modulus = packing.radius, model.young_modulus
        self.half = packing.radius * math.cos(math.pi / packing.vertices)  # b₀/2
        place = -(self.half + body.radius)
        self.system = System(
            [body],
            [Wall(0.0, 1.0, place), Wall(0.0, -1.0, place)],
            stiffness=model.contact_stiffness * self.unit.hinge / self.unit.segment**2,
            friction=model.friction,
            drag=model.drag * self.unit.mass * self.unit.frequency,
        )
        rows = point.resolved().record.rows or 0
        period = 2.0 * math.pi / self.unit.frequency
        self.strokes = 2 if shear.unload else 1
        # A stroke of plates that start and stop smoothly takes 1/(1 − RAMP) times as long.
        stroke = shear.compression / (shear.relative_rate / period) / (1.0 - RAMP)
        self.speed = shear.compression * self.half / (stroke * (1.0 - RAMP))
        piece = stroke * self.strokes / (rows * PIECES)
        longest = point.integrator.step * self.system.stable_step
        self.steps = math.ceil(piece / longest * (1.0 - 1e-9))  # of a piece
        self.system.rules = self.system.rules._replace(step=piece / self.steps)
        self.pieces = rows * PIECES
        self.piece = 0
        self.system.begin()
        self._at = self._of_the_plates()

    def go_on(self) -> None:
        """Make the steps from one record to the next."""
        for _ in range(PIECES):
            share = (self.piece + 0.5) / self.pieces * self.strokes
            stroke = int(share)
            share -= stroke
            ramp = min(1.0, share / RAMP, (1.0 - share) / RAMP)
            self.system.walls.velocity[:] = self.speed * ramp * (1 if stroke == 0 else -1)
            self.system.advance(self.steps)
            self.piece += 1

    def _of_the_plates(self) -> tuple[float, float]:
        walls = self.system.walls
        return float(walls.work.sum()), float(walls.position.sum())

    def record(self) -> dict[str, float]:
        """Return one record, see ``columns``."""
        system, unit = self.system, self.unit
        chains, motion, walls = system.chains, system.motion, system.walls
        radius = float(chains.radius[0])
        before, self._at = self._at, self._of_the_plates()
        moved = self._at[1] - before[1]
        force = float(walls.push.mean())
        # Work per way is the mean over the way, where the plates did not turn on it.
        longest = 2.0 * self.speed * PIECES * self.steps * system.rules.step
        one_way = abs(moved) > 1e-3 * longest
        gap = -float(walls.position.sum()) - 2.0 * radius
        overlap = motion.y + walls.position[1] + radius
        touching = overlap > 0.0
        top, load = motion.x[touching], overlap[touching]
        apart = 2.0 * float((load * np.abs(top)).sum() / load.sum()) if len(top) else 0.0
        energy = system.budget()
        area = system.area(0)
        diameter = 2.0 * self.half
        pressure = 0.0
        if chains.core_law[0] != HOLLOW:
            pressure = core_pressure(
                chains.core_law[0], chains.core_stiffness[0], 0.0, chains.core_area[0], area
            )
        return {
            "time": system.time,
            "compression": 1.0 - gap / diameter,
            "force": force,
            "mean_force": (self._at[0] - before[0]) / moved if one_way else force,
            "stress_yy": force / diameter,
            "scaled_force": force * self.radius**2 / unit.bending,
            "stress_yy_per_modulus": force / diameter / self.modulus,
            "stress_yy_per_bending": force / diameter * self.radius**2 / unit.hinge,
            "core_pressure": pressure,
            "area_ratio": area / float(chains.core_area[0]),
            "width_ratio": float(np.ptp(motion.x)) / diameter,
            "contact_ratio": float(np.ptp(top)) / diameter if len(top) else 0.0,
            "load_ratio": apart / diameter,
            "energy_stretch": energy.stretch,
            "energy_bend": energy.bend,
            "energy_core": energy.core,
            "energy_contact": energy.normal + energy.tangential,
            "energy_kinetic": energy.kinetic,
            "work": energy.by_walls,
            "lost_by_yield": energy.stretch_yield + energy.bend_yield,
            "lost_by_friction": energy.sliding + energy.separation,
            "lost_by_damping": energy.damping,
            "lost_by_drag": energy.drag,
            "energy_missing": energy.missing,
        }
