"""Rings in a box whose lid comes down and goes up: how they start, and what is measured."""

import math

import numpy as np

from shear_sim.models.interface import Columns
from shear_sim.models.soft_particle.driving import Compaction
from shear_sim.models.soft_particle.packs import scattered_discs, touching_discs
from shear_sim.models.soft_particle.parameters import SoftParticlePoint
from shear_sim.models.soft_particle.rings import disc_radius, rings_in_discs, scales, shapes
from shear_sim.models.soft_particle.scenario import Scenario, come_to_rest, more_drag
from shear_sim.models.soft_particle.system import System, Wall, ledger
from shear_sim.streams import Streams

UNIT = 0.5  # σ* = k_b/2R² (paper (37)) / (k_b/R²)
FEWEST = 5  # records of a line
LOWEST = 0.03  # σ/σ* under which the pack has not set yet
WEIGHT = 0.1  # weight of all rings / width / σ*, where they fall
AIR = 0.01  # drag on vertices / (m ω₁) there
FALLEN = 1e-6  # kinetic energy of rings that have fallen / (k_b · rings)
LEFT, RIGHT, FLOOR, LID = range(4)


class Compactor(Scenario):
    """The run: a lid at a constant speed, at first where it touches, in the end there again."""

    def __init__(self, point: SoftParticlePoint, shear: Compaction, streams: Streams) -> None:
        model, packing = point.model, point.packing
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
        self.system = System(
            bodies,
            [
                Wall(1.0, 0.0, 0.0), Wall(-1.0, 0.0, -self.width), Wall(0.0, 1.0, 0.0),
                Wall(0.0, -1.0, -top),
            ],
            stiffness=self.unit.stiffness,
            friction=model.friction,
            contact_damping=model.contact_damping,
            drag=model.drag * self.unit.mass * self.unit.frequency,
        )  # fmt: skip
        self.settling = self._settle() if falling else 0.0
        self.first = self.system.steps
        top = self.start = float(self.system.motion.y.max()) + float(self.system.chains.radius[0])
        self.system.walls.position[LID] = -top
        self.frame = (0.0, 0.0, self.width, top)
        self.limit = math.inf if shear.largest_stress is None else shear.largest_stress
        strokes = shear.strokes
        self.one_way = max(1, (point.resolved().record.rows or 0) // strokes)
        self.strokes = strokes
        self.rows = strokes * self.one_way + 1
        self.made = 0
        way = top * (1.0 - math.exp(-shear.strain)) / self.one_way
        speed = shear.relative_rate * top / self.unit.period
        longest = point.integrator.step * self.system.stable_step
        self.steps = math.ceil(way / speed / longest * (1.0 - 1e-9))
        self.system.rules = self.system.rules._replace(step=way / speed / self.steps)
        self.speed = speed
        # All of the pack sets out at once: no front runs through it from the lid.
        self.system.motion.vy[:] = -speed * self.system.motion.y / top
        self.system.begin()

    def _settle(self) -> float:
        """Let the rings fall, come to rest, and lose their weight; return the time it took [s]."""
        system, unit = self.system, self.unit
        every = np.arange(len(system.motion.x))
        weight = WEIGHT * UNIT * unit.hinge / self.radius**2 * self.width / len(every)
        system.load(every, fy=-weight)
        with more_drag(system, unit, AIR):
            come_to_rest(system, unit, FALLEN)
        with more_drag(system, unit):
            come_to_rest(system, unit)
            system.load(every, fy=weight)
            come_to_rest(system, unit)
        return system.time

    def go_on(self) -> None:
        """Make the steps from one record to the next."""
        down = self.made < self.one_way
        self.system.walls.velocity[LID] = self.speed if down else -self.speed
        self.system.advance(self.steps)
        self.made += 1
        if down and self._stress(LID, self.width) >= self.limit * self.unit.hinge / self.radius**2:
            self.one_way = self.made
            self.rows = self.strokes * self.one_way + 1

    def _stress(self, wall: int, length: float) -> float:
        return float(self.system.walls.push[wall]) / length

    def record(self) -> dict[str, float]:
        """Return one record, see ``columns``."""
        system, width = self.system, self.width
        height = -float(system.walls.position[LID])
        stress = self._stress(LID, width)
        floor = self._stress(FLOOR, width)
        sides = 0.5 * (self._stress(LEFT, height) + self._stress(RIGHT, height))
        solid, circularity = shapes(system.chains, system.motion)
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
        stored = np.zeros(len(stress))
        for name in ("stretch", "bend", "core", "contact"):
            stored += table[f"energy_{name}"]
        found = {
            "start_void_ratio": void[0],
            "final_strain": table["strain"][top],
            "final_stress_per_bending": table["stress_yy_per_bending"][top],
            "final_void_ratio": void[top],
            "final_solid_share": share[top],
            "final_circularity": table["circularity"][top],
            "energy_missing_ratio": np.abs(table["energy_missing"]).max() / work,
            "drag_ratio": table["lost_by_drag"][top] / work,
        }
        loading = np.arange(len(stress)) <= top
        set_ = loading & (stress > LOWEST)
        if set_.any():
            found["inertia_ratio"] = (table["energy_kinetic"][set_] / stored[set_]).max()
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
