"""A beam under a force: how it is set up, how it comes to rest, and what is measured."""

import math
from dataclasses import replace

import numpy as np

from shear_sim.models.interface import Columns
from shear_sim.models.soft_particle.balance import ledger
from shear_sim.models.soft_particle.bodies import Core
from shear_sim.models.soft_particle.driving import Bending
from shear_sim.models.soft_particle.parameters import SoftParticlePoint
from shear_sim.models.soft_particle.rings import ring_body, scales
from shear_sim.models.soft_particle.scenario import Scenario
from shear_sim.models.soft_particle.system import System

#: Of both supports: ω L² √(ρ_l/EI) of the slowest vibration, and F L³/EI δ under the force.
SLOWEST = {"free end": 3.5160, "ends": math.pi**2}
COMPLIANCE = {"free end": 3.0, "ends": 48.0}
AT_REST = 40.0  # time constants of the slowest vibration until a run ends


class Beam(Scenario):
    """The run: the force is hung on at once, and a critical drag brings the beam to rest."""

    def __init__(self, point: SoftParticlePoint, shear: Bending) -> None:
        model, packing = point.model, point.packing
        self.unit = unit = scales(model, packing.vertices, packing.radius)
        count = packing.vertices  # segments
        length = count * unit.segment
        clamped = shear.support != "ends"
        held = "free end" if clamped else "ends"
        # A clamp holds one more segment, so that there is a hinge where the beam begins.
        x = unit.segment * np.arange(-1 if clamped else 0, count + 1)
        weight = np.ones(len(x))
        if shear.support == "half_clamped":
            weight[1] = 2.0
        straight = replace(
            ring_body(model, packing.vertices, packing.radius),
            points=np.column_stack([x, np.zeros_like(x)]), closed=False, core=Core(),
            bend_weight=weight,
        )  # fmt: skip
        slowest = SLOWEST[held] * math.sqrt(unit.bending * unit.segment / unit.mass) / length**2
        drag = model.drag * unit.frequency + 2.0 * slowest  # / m
        self.system = System([straight], stiffness=unit.stiffness, drag=drag * unit.mass)
        if clamped:
            self.system.hold(np.array([0, 1]))
            self.loaded = len(x) - 1
        else:
            self.system.hold(np.array([0]))
            self.system.hold(np.array([count]), vx=None)
            self.loaded = count // 2
        force = shear.force * unit.bending / length**2
        self.system.load(np.array([self.loaded]), fy=force)
        self.theory = force * length**3 / (COMPLIANCE[held] * unit.bending)
        rows = point.resolved().record.rows or 0
        self.rows, self.strokes = rows + 1, 1
        self.frame = (-0.1 * length, -0.5 * length, 1.2 * length, length)
        slow = 0.5 * drag - math.sqrt(max(0.0, 0.25 * drag**2 - slowest**2))
        between = AT_REST / slow / rows
        self.steps = self.divide(between, point.integrator.step)
        self.system.begin()

    def go_on(self) -> None:
        """Make the steps from one record to the next."""
        self.system.advance(self.steps)

    def record(self) -> dict[str, float]:
        """Return one record, see ``columns``."""
        budget = self.system.budget()
        deflection = float(self.system.motion.y[self.loaded])
        return ledger(budget) | {
            "time": self.system.time,
            "deflection": deflection,
            "deflection_ratio": deflection / self.theory,
            "work": budget.by_forces,
        }

    def measured(self, table: Columns) -> dict[str, float]:
        """Return what is kept of a whole run."""
        missing = np.abs(table["energy_missing"]).max() / np.abs(table["work"]).max()
        return {
            "final_deflection_ratio": float(table["deflection_ratio"][-1]),
            "energy_missing_ratio": float(missing),
        }
