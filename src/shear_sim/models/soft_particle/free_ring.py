"""A ring that touches nothing: under a pressure from outside, and in its slowest vibration."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import Columns
from shear_sim.models.soft_particle.balance import ledger
from shear_sim.models.soft_particle.bodies import Core
from shear_sim.models.soft_particle.driving import OuterPressure, Vibration
from shear_sim.models.soft_particle.parameters import SoftParticlePoint
from shear_sim.models.soft_particle.rings import ring_body, scales
from shear_sim.models.soft_particle.scenario import Scenario
from shear_sim.models.soft_particle.system import System

FloatArray = NDArray[np.float64]

PICTURE = 3.2  # side of what a snapshot shows, in radii of the ring
LOW, HIGH = 1.0, 2.8  # p R³/EI up to which a ring is round, and up to which its growth is a line
PIECES = 10  # of a record, in each of which the pressure stays


class _FreeRing(Scenario):
    """A ring around the origin."""

    def _set_up(self, point: SoftParticlePoint, imperfection: float = 0.0) -> None:
        model, packing = point.model, point.packing
        self.unit = scales(model, packing.vertices, packing.radius)
        self.radius = packing.radius
        body = ring_body(model, packing.vertices, packing.radius)
        x, y = body.points.T
        self.angle = np.arctan2(y, x)
        oval = 1.0 + imperfection * np.cos(2.0 * self.angle)
        hollow = Core("drained")  # at zero pressure, until there is one
        core = hollow if body.core.law == "none" else body.core
        body = replace(body, points=body.points * oval[:, None], core=core)
        self.system = System(
            [body],
            stiffness=self.unit.stiffness,
            drag=model.drag * self.unit.mass * self.unit.frequency,
        )
        side = PICTURE * packing.radius
        self.frame = (-0.5 * side, -0.5 * side, side, side)

    def _ovality(self) -> float:
        """Return a/R of the part a cos 2φ of the distances of the vertices from the centre."""
        motion = self.system.motion
        out = motion.x * np.cos(self.angle) + motion.y * np.sin(self.angle)
        return float(2.0 * (out * np.cos(2.0 * self.angle)).mean()) / self.radius

    def _shape(self) -> dict[str, float]:
        area = self.system.area(0) / float(self.system.chains.core_area[0])
        return {"time": self.system.time, "area_ratio": area, "ovality": self._ovality()}


class Pressed(_FreeRing):
    """The run: a pressure from outside that grows at a constant rate."""

    def __init__(self, point: SoftParticlePoint, shear: OuterPressure) -> None:
        self._set_up(point, shear.imperfection)
        unit = self.unit
        rows = point.resolved().record.rows or 0
        self.rows, self.strokes = rows + 1, 1
        self.scale = unit.bending / self.radius**3
        self.young_modulus = point.model.young_modulus
        self.growth = shear.pressure / (rows * PIECES) * self.scale
        between = shear.pressure / shear.relative_rate * unit.period / (rows * PIECES)
        self.steps = self.divide(between, point.integrator.step)
        self.modulus = unit.shell_modulus + unit.core_modulus
        self.pressure = self.work = 0.0
        self.system.begin()

    def go_on(self) -> None:
        """Make the steps from one record to the next."""
        for _ in range(PIECES):
            self.pressure += self.growth
            # A pressure inside that is lower by as much is the same.
            self.system.press(0, -self.pressure)
            area = self.system.area(0)
            self.system.advance(self.steps)
            self.work -= self.pressure * (self.system.area(0) - area)

    def record(self) -> dict[str, float]:
        """Return one record, see ``columns``."""
        budget = self.system.budget()
        # What the pressure stores as a part of the core is of outside; its changes have their work.
        change = self.system.area(0) - float(self.system.chains.core_area[0])
        return ledger(budget) | self._shape() | {
            "outer_pressure": self.pressure,
            "outer_pressure_per_modulus": self.pressure / self.young_modulus,
            "outer_pressure_per_bending": self.pressure * self.radius**2 / self.unit.hinge,
            "outer_pressure_ratio": self.pressure / self.scale,
            "work": self.work,
            "energy_core": budget.core - self.pressure * change,
        }  # fmt: skip

    def measured(self, table: Columns) -> dict[str, float]:
        """Return what is kept of a whole run.

        The pressure p_c that buckles it is of Southwell's plot: an imperfection grows as
        p/(p_c − p), so growth / p is a line over the growth, of slope 1/p_c.
        """
        pressure, ratio = table["outer_pressure"], table["outer_pressure_ratio"]
        found = {
            "energy_missing_ratio": np.abs(table["energy_missing"]).max() / table["work"].max()
        }
        low = ratio <= LOW
        if low.sum() > 2:
            slope = np.polyfit(1.0 - table["area_ratio"][low], pressure[low], 1)[0]
            found["bulk_modulus_ratio"] = slope / self.modulus
        near = (ratio > LOW) & (ratio < HIGH)
        if ratio[-1] > HIGH and near.sum() > 2:
            growth = table["ovality"][near] - table["ovality"][0]
            slope = np.polyfit(growth, growth / ratio[near], 1)[0]
            found["buckling_pressure_ratio"] = 1.0 / slope
        return {name: float(value) for name, value in found.items()}


class Vibrating(_FreeRing):
    """The run: a ring that starts with the velocities of its slowest vibration."""

    def __init__(self, point: SoftParticlePoint, shear: Vibration) -> None:
        self._set_up(point)
        unit, motion = self.unit, self.system.motion
        rows = point.resolved().record.rows or 0
        self.rows, self.strokes = rows + 1, shear.periods
        self.steps = self.divide(unit.period * shear.periods / rows, point.integrator.step)
        # Without a change of length: u_r = a cos 2φ, u_φ = −(a/2) sin 2φ.
        speed = shear.amplitude * self.radius * unit.frequency
        outwards = speed * np.cos(2.0 * self.angle)
        along = -0.5 * speed * np.sin(2.0 * self.angle)
        motion.vx[:] = outwards * np.cos(self.angle) - along * np.sin(self.angle)
        motion.vy[:] = outwards * np.sin(self.angle) + along * np.cos(self.angle)
        self.system.begin()
        self.energy = self.system.kinetic()

    def go_on(self) -> None:
        """Make the steps from one record to the next."""
        self.system.advance(self.steps)

    def record(self) -> dict[str, float]:
        """Return one record, see ``columns``."""
        return ledger(self.system.budget()) | self._shape()

    def measured(self, table: Columns) -> dict[str, float]:
        """Return what is kept of a whole run."""
        periods, missing = table["time"] / self.unit.period, table["energy_missing"] / self.energy
        crossings = _zeros(periods, table["ovality"])
        found = {
            "energy_missing_ratio": np.abs(missing).max(),
            "energy_drift": 1000.0 * np.polyfit(periods, missing, 1)[0],
        }
        if len(crossings) > 1:
            half = (crossings[-1] - crossings[0]) / (len(crossings) - 1)
            found["frequency_ratio"] = 0.5 / half
        return {name: float(value) for name, value in found.items()}


def _zeros(time: FloatArray, values: FloatArray) -> FloatArray:
    """Return the times at which ``values`` change their sign, on lines between records."""
    before = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    share = values[before] / (values[before] - values[before + 1])
    return np.asarray(time[before] + share * (time[before + 1] - time[before]))
