"""Rings in a box whose lid comes down and goes up: how they start, and what is measured."""

import math

import numpy as np

from shear_sim.models.interface import Columns
from shear_sim.models.soft_particle.balance import ledger
from shear_sim.models.soft_particle.driving import Compaction
from shear_sim.models.soft_particle.packs import scattered_discs, touching_discs
from shear_sim.models.soft_particle.parameters import SoftParticlePoint
from shear_sim.models.soft_particle.rings import disc_radius, rings_in_discs, scales, shapes
from shear_sim.models.soft_particle.scenario import Rest, Scenario
from shear_sim.models.soft_particle.system import System
from shear_sim.models.soft_particle.walls import Wall
from shear_sim.streams import Streams

UNIT = 0.5  # σ* = k_b/2R² (paper (37)) / (k_b/R²)
FEWEST = 5  # records of a line
LOWEST = 0.03  # σ/σ* under which the pack has not set yet
WEIGHT = 0.1  # weight of all rings / width / σ*, where they fall
PIECES = 10  # of a record, in each of which a load stays
LEFT, RIGHT, FLOOR, LID = range(4)


class Compactor(Scenario):
    """The run: a lid at a constant speed or under a load, at first where it touches."""

    def __init__(self, point: SoftParticlePoint, shear: Compaction, streams: Streams) -> None:
        model, packing = point.model, point.packing
        self.point, self.shear = point, shear
        self.unit = scales(model, packing.vertices, packing.radius)
        self.radius, self.modulus = packing.radius, model.young_modulus
        falling = packing.preparation == "gravity"
        discs = scattered_discs if falling else touching_discs
        box = discs(packing.particles, packing.spread, streams.generator("discs"))
        bodies = rings_in_discs(
            model, packing, box.x, box.y, box.radius, streams.generator("turns")
        )
        self.width = box.width * disc_radius(model) * packing.radius
        top = max(float(body.points[:, 1].max()) + body.radius for body in bodies)
        self.loaded = shear.control == "load"
        self.row = self.unit.mass * packing.vertices * math.sqrt(packing.particles)
        self.system = System(
            bodies,
            [
                Wall(1.0, 0.0, 0.0), Wall(-1.0, 0.0, -self.width), Wall(0.0, 1.0, 0.0),
                Wall(0.0, -1.0, -top),
            ],
            stiffness=self.unit.stiffness,
            friction=model.friction,
            tangential=model.tangential_ratio * self.unit.stiffness,
            contact_damping=model.contact_damping,
            drag=model.drag * self.unit.mass * self.unit.frequency,
        )  # fmt: skip
        rigid = round(packing.rigid_share * packing.particles)
        picked = streams.generator("rigid").permutation(packing.particles)[:rigid]
        self.rigid = np.sort(picked)
        self.system.make_rigid(self.rigid)
        self.limit = math.inf if shear.largest_stress is None else shear.largest_stress
        self.strokes = shear.strokes
        self.planned = self.one_way = max(1, (point.resolved().record.rows or 0) // self.strokes)
        self.rows = self.strokes * self.one_way + 1
        self.made = 0
        self.settling = 0.0
        self.weights = [1.0, -1.0] if falling else []  # put on, each until the rings are at rest
        self.rest: Rest | None = None
        # Rings that fall do not yield: their weight is more than plastic ones bear.
        chains = self.system.chains
        self.yields = chains.stretch_yield.copy(), chains.bend_yield.copy()
        if falling:
            chains.stretch_yield[:] = chains.bend_yield[:] = math.inf
        self.ready = False

    def prepare(self, periods: int) -> bool:
        """Let the rings fall, come to rest, and lose their weight."""
        for _ in range(periods):
            if not self.weights:
                break
            if self.rest is None:
                self._weigh(self.weights[0])
                self.rest = Rest(quenched=True)
            if self.rest.go_on(self.system, self.unit):
                self.rest = None
                del self.weights[0]
        if not self.weights and not self.ready:
            self.settling = self.system.time
            self._set_out()
        return self.ready

    def _weigh(self, weight: float) -> None:
        """Let a weight act from the next forces on: a pack that falls has no energy balance yet."""
        vertices = len(self.system.motion.x)
        unit = WEIGHT * UNIT * self.unit.hinge / self.radius**2 * self.width / vertices
        self.system.motion.gy[:] -= weight * unit

    def _set_out(self) -> None:
        """Bring the lid to where it touches, and start from there."""
        system, shear, walls = self.system, self.shear, self.system.walls
        system.chains.stretch_yield[:], system.chains.bend_yield[:] = self.yields
        self.first = system.steps
        top = self.start = float(system.motion.y.max()) + float(system.chains.radius[0])
        walls.position[LID] = -top
        self.frame = (0.0, 0.0, self.width, top)
        self.speed = shear.relative_rate * top / self.unit.period
        way = top * (1.0 - math.exp(-shear.strain)) / self.one_way
        each = way / self.speed
        if self.loaded:
            each = self.unit.period / shear.relative_rate / (self.one_way * PIECES)
            walls.mass[LID] = self.row
        self.steps = self.divide(each, self.point.integrator.step)
        if not self.loaded:
            # All of the pack sets out at once: no front runs through it from the lid.
            system.motion.vy[:] = -self.speed * system.motion.y / top
            system.make_rigid(self.rigid)
        system.begin()
        self.ready = True

    def go_on(self) -> None:
        """Make the steps from one record to the next."""
        down = self.made < self.one_way
        if self.loaded:
            for piece in range(PIECES):
                self._bear(self.made + (piece + 0.5) / PIECES)
                self.system.advance(self.steps)
        else:
            self.system.walls.velocity[LID] = self.speed if down else -self.speed
            self.system.advance(self.steps)
        self.made += 1
        if down and self._far_enough():
            self.one_way = self.made
            self.rows = self.strokes * self.one_way + 1

    def _bear(self, record: float) -> None:
        """Put on the lid what it bears at a record; between two of them there is a part of it."""
        share = min(record, 2.0 * self.one_way - record) / self.planned
        stress = share * self.limit * self.unit.hinge / self.radius**2
        self.system.walls.load[LID] = stress * self.width

    def _far_enough(self) -> bool:
        """Tell whether the lid is to turn before its time."""
        if self.loaded:
            return math.log(self.start / self._height()) >= self.shear.strain
        bearing = self._stress(LID, self.width)
        return bearing >= self.limit * self.unit.hinge / self.radius**2

    def _height(self) -> float:
        return -float(self.system.walls.position[LID])

    def _stress(self, wall: int, length: float) -> float:
        return float(self.system.walls.push[wall]) / length

    def record(self) -> dict[str, float]:
        """Return one record, see ``columns``."""
        system, width = self.system, self.width
        height = self._height()
        stress = self._stress(LID, width)
        floor = self._stress(FLOOR, width)
        sides = 0.5 * (self._stress(LEFT, height) + self._stress(RIGHT, height))
        solid, circularity = shapes(system.chains, system.motion)
        imposed = {}
        if self.loaded:
            load = float(system.walls.load[LID]) / width
            imposed = {
                "imposed_stress": load,
                "imposed_stress_per_modulus": load / self.modulus,
                "imposed_stress_per_bending": load * self.radius**2 / self.unit.hinge,
            }
        return {
            "time": (system.steps - self.first) * system.rules.step,
            "strain": math.log(self.start / height),
            "stress_yy": stress,
            "stress_xx": sides,
            "stress_floor": floor,
            "stress_yy_per_modulus": stress / self.modulus,
            "stress_yy_per_bending": stress * self.radius**2 / self.unit.hinge,
            "stress_xx_per_modulus": sides / self.modulus,
            "stress_xx_per_bending": sides * self.radius**2 / self.unit.hinge,
            "stress_floor_per_modulus": floor / self.modulus,
            "stress_floor_per_bending": floor * self.radius**2 / self.unit.hinge,
            "box_area": width * height,
            "solid_area": solid,
            "circularity": circularity,
            **imposed,
        } | ledger(system.budget())

    def preparation(self) -> dict[str, float]:
        """Return what is to be said of the start."""
        return {"width": self.width, "height": self.start, "settling_time": self.settling}

    def measured(self, table: Columns) -> dict[str, float]:
        """Return what is kept of a whole run."""
        top = int(table["strain"].argmax())
        work = float(np.abs(table["work"]).max())
        stress = table["stress_yy_per_bending"] / UNIT
        void = table["box_area"] / table["solid_area"] - 1.0
        change = table["box_area"][0] - table["box_area"][1:]
        share = np.append(0.0, (table["solid_area"][0] - table["solid_area"][1:])
                          / np.where(change > 0.0, change, np.nan))  # fmt: skip
        found = {
            "start_void_ratio": void[0],
            "final_strain": table["strain"][top],
            "final_stress_per_bending": table["stress_yy_per_bending"][top],
            "final_void_ratio": void[top],
            "final_solid_share": share[top],
            "final_circularity": table["circularity"][top],
            "energy_missing_ratio": np.abs(table["energy_missing"]).max() / work,
            "drag_ratio": table["lost_by_drag"][top] / work,
            "kinetic_ratio": table["energy_kinetic"][top] / work,
        }
        loading = np.arange(len(stress)) <= top
        set_ = loading & (stress > LOWEST)
        if set_.sum() >= FEWEST:
            slope = np.polyfit(np.log10(stress[set_]), void[set_], 1)[0]
            found["compressibility_index"] = -slope
        above = np.flatnonzero(loading & (stress >= 1.0))
        if len(above) and above[0] > 0:
            pair = slice(above[0] - 1, above[0] + 1)
            at = np.log(np.maximum(stress[pair], 1e-12))
            found["void_ratio_at_unit"] = np.interp(0.0, at, void[pair])
            found["solid_share_at_unit"] = np.interp(0.0, at, share[pair])
        if self.strokes == 2:
            found["unloaded_void_ratio"] = void[-1]
        return {name: float(value) for name, value in found.items()}
