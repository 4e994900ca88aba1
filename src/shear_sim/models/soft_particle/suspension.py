"""A dense suspension of rings in a sheared cell: how it starts, and what is measured."""

import math
from typing import Any

import numpy as np

from shear_sim.models.interface import Columns, SimulationError
from shear_sim.models.soft_particle.balance import ledger
from shear_sim.models.soft_particle.driving import SoftParticleOscillatoryShear
from shear_sim.models.soft_particle.packs import loose_discs
from shear_sim.models.soft_particle.parameters import SoftParticlePoint
from shear_sim.models.soft_particle.rings import disc_radius, rings_in_discs, scales, shapes
from shear_sim.models.soft_particle.scenario import Rest, Scenario, more_drag
from shear_sim.models.soft_particle.system import System
from shear_sim.streams import Streams

LOOSE = 0.7  # packing fraction of the discs that rings start from
STRIDE = 0.002  # by which the cell shrinks at once, on the way to its size
PAUSE = 0.1  # after that [T₁]
LOSSES = ("yield", "friction", "damping", "drag")


class Suspension(Scenario):
    """The run: rings pressed together in a cell, at rest, then sheared to and fro."""

    def __init__(
        self, point: SoftParticlePoint, shear: SoftParticleOscillatoryShear, streams: Streams
    ) -> None:
        model, packing = point.model, point.packing
        self.unit = scales(model, packing.vertices, packing.radius)
        self.radius, self.modulus = packing.radius, model.young_modulus
        discs = loose_discs(packing.particles, packing.spread, LOOSE, streams.generator("discs"))
        side = discs.width * disc_radius(model) * packing.radius
        bodies = rings_in_discs(
            model, packing, discs.x, discs.y, discs.radius, streams.generator("turns")
        )
        self.system = System(
            bodies,
            stiffness=self.unit.stiffness,
            friction=model.friction,
            tangential=model.tangential_ratio * self.unit.stiffness,
            contact_damping=model.contact_damping,
            drag=model.drag * self.unit.mass * self.unit.frequency,
            cell=(side, side),
        )
        self.point, self.shear = point, shear
        solid, _ = shapes(self.system.chains, self.system.motion)
        self.side = math.sqrt(solid / (packing.packing_fraction or 1.0))
        way = math.log(self.side / float(self.system.cell.size[0]))
        self.strides = max(1, math.ceil(abs(way) / STRIDE))
        self.factor = math.exp(way / self.strides)
        self.rest: Rest | None = Rest()
        self.settling = 0.0
        self.glued = 0
        self.strokes = shear.periods
        rows = point.resolved().record.rows or 0
        self.rows = rows + 1
        self.period = self.unit.period / shear.relative_frequency

    def prepare(self, periods: int) -> bool:
        """Press the rings together until the cell has its size, and let them come to rest."""
        system, unit = self.system, self.unit
        pause = math.ceil(PAUSE * unit.period / system.rules.step)
        for _ in range(periods):
            if self.rest is None:
                break
            over = False
            with more_drag(system, unit):
                if self.strides > 0:
                    system.shrink(self.factor)
                    system.advance(pause)
                    self.strides -= 1
                else:
                    over = self.rest.go_on(system, unit)
            if over:
                self.rest = None
                self._set_out()
        return self.rest is None

    def _set_out(self) -> None:
        """Glue what is to be glued, and shear the cell from now on."""
        system, shear, rows = self.system, self.shear, self.rows - 1
        self.settling = system.time
        if self.point.cell.boundary == "plates":
            self.glued = self._glue()
        between = self.period * shear.periods / rows
        self.steps = self.divide(between, self.point.integrator.step)
        self.first = system.steps
        system.shear(shear.strain_amplitude, 1.0 / self.period)
        width, height = map(float, system.cell.size)
        self.volume = width * height
        self.frame = (0.0, 0.0, width, height)

    def _glue(self) -> int:
        """Hold all rings that cross the edge y = 0, which is the plate; return how many do."""
        system = self.system
        chains, motion = system.chains, system.motion
        height = float(system.cell.size[1])
        glued = []
        for first, end in zip(chains.start[:-1], chains.start[1:], strict=True):
            part = slice(first, end)
            y = motion.y[part] - height * np.rint(motion.y[part].mean() / height)
            if y.min() < 0.0 < y.max():
                motion.y[part] = y
                glued.append(np.arange(first, end))
        if not glued:
            msg = "no ring crosses the edge of the cell, to be glued to the plate: another seed"
            raise SimulationError(msg)
        system.hold(np.concatenate(glued))
        return len(glued)

    def go_on(self) -> None:
        """Make the steps from one record to the next."""
        self.system.advance(self.steps)

    def record(self) -> dict[str, float]:
        """Return one record, see ``columns``."""
        system, bending = self.system, self.unit.hinge / self.radius**2
        names = ("stress_xx", "stress_xy", "stress_yx", "stress_yy")
        stress = dict(zip(names, map(float, system.stress()), strict=True))
        solid, circularity = shapes(system.chains, system.motion)
        return {
            "time": (system.steps - self.first) * system.rules.step,
            "strain": float(system.cell.strain[0]),
            **stress,
            **{f"{name}_per_modulus": value / self.modulus for name, value in stress.items()},
            **{f"{name}_per_bending": value / bending for name, value in stress.items()},
            "box_area": self.volume,
            "solid_area": solid,
            "circularity": circularity,
        } | ledger(system.budget())

    def protocol(self) -> dict[str, Any]:
        """Return how the cell is sheared."""
        return {
            "tensors": ["periodic"],
            "strain_amplitude": self.shear.strain_amplitude,
            "period": self.period,
            "periods": self.shear.periods,
        }

    def preparation(self) -> dict[str, float]:
        """Return what is to be said of the start."""
        width, height = map(float, self.system.cell.size)
        return {
            "width": width,
            "height": height,
            "settling_time": self.settling,
            "glued_particles": self.glued,
        }

    def measured(self, table: Columns) -> dict[str, float]:
        """Return what is kept of a whole run."""
        last = slice(-1 - (self.rows - 1) // self.strokes, None)
        lost = {name: float(np.ptp(table[f"lost_by_{name}"][last])) for name in LOSSES}
        total = sum(lost.values())
        missing = table["energy_missing"]
        found = {
            "start_stress_per_bending": table["stress_yy_per_bending"][0],
            "energy_missing_ratio": np.abs(missing).max() / table["work"].max(),
            "cycle_missing_ratio": abs(missing[-1] - missing[last][0]) / total,
        }
        found |= {f"{name}_loss_share": lost[name] / total for name in LOSSES}
        return {name: float(value) for name, value in found.items()}

    def checks(self, table: Columns) -> dict[str, float]:
        """Return what must be small: |σ_xy − σ_yx| / trace; forces on plates are another matter."""
        if self.glued:
            return {}
        apart = np.abs(table["stress_xy"] - table["stress_yx"])
        trace = np.abs(table["stress_xx"] + table["stress_yy"]).max()
        return {"asymmetry_periodic": float(apart.max() / trace)} if trace > 0.0 else {}
