"""A ring between two plates: how it is set up, how the plates move, and what is measured."""

import math

import numpy as np

from shear_sim.models.interface import Columns
from shear_sim.models.soft_particle.balance import ledger
from shear_sim.models.soft_particle.driving import DiametralCompression
from shear_sim.models.soft_particle.kernels import core_pressure
from shear_sim.models.soft_particle.parameters import SoftParticlePoint
from shear_sim.models.soft_particle.rings import ring_body, scales
from shear_sim.models.soft_particle.scenario import Scenario
from shear_sim.models.soft_particle.state import HOLLOW
from shear_sim.models.soft_particle.system import System
from shear_sim.models.soft_particle.walls import Wall

RAMP = 0.05  # part of a stroke in which the plates come to their speed, and to rest
FAST = 0.2  # part of a stroke: before, a slow ring too has little work in it
PIECES = 50  # of a record, in each of which the plates keep their speed
PICTURE = 3.2  # side of what a snapshot shows, in radii of the ring
TINY = 1e-300  # of a force: what does not touch has not sunk
FEWEST_TOUCHING = 2.5  # segments between the loads on a plate, for a contact length


class Diametral(Scenario):
    """The run: plates that touch the ring at the start, approach each other, and part again."""

    def __init__(self, point: SoftParticlePoint, shear: DiametralCompression) -> None:
        model, packing = point.model, point.packing
        self.unit = scales(model, packing.vertices, packing.radius)
        body = ring_body(model, packing.vertices, packing.radius)
        self.radius, self.modulus = packing.radius, model.young_modulus
        self.fold = shear.fold_ratio(packing.vertices)
        self.half = packing.radius * math.cos(math.pi / packing.vertices)  # b₀/2
        place = -(self.half + body.radius)
        self.system = System(
            [body],
            [Wall(0.0, 1.0, place), Wall(0.0, -1.0, place)],
            stiffness=self.unit.stiffness,
            friction=model.friction,
            tangential=model.tangential_ratio * self.unit.stiffness,
            contact_damping=model.contact_damping,
            drag=model.drag * self.unit.mass * self.unit.frequency,
        )
        rows = point.resolved().record.rows or 0
        self.rows = rows + 1
        self.hollow = self.system.chains.core_law[0] == HOLLOW
        self.plastic = model.yield_moment is not None or model.yield_force is not None
        side = PICTURE * packing.radius
        self.frame = (-0.5 * side, -0.5 * side, side, side)
        self.strokes = shear.strokes
        # A stroke of plates that start and stop smoothly takes 1/(1 − RAMP) times as long.
        stroke = shear.compression / (shear.relative_rate / self.unit.period) / (1.0 - RAMP)
        self.speed = shear.compression * self.half / (stroke * (1.0 - RAMP))
        piece = stroke * self.strokes / (rows * PIECES)
        self.steps = self.divide(piece, point.integrator.step)
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
            rest = float(chains.core_pressure[0])
            pressure = core_pressure(
                chains.core_law[0], chains.core_stiffness[0], rest, chains.core_area[0], area
            ) - rest  # fmt: skip
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
            "core_pressure_per_modulus": pressure / self.modulus,
            "core_pressure_per_bending": pressure * self.radius**2 / unit.hinge,
            "area_ratio": area / float(chains.core_area[0]),
            "width_ratio": float(np.ptp(motion.x)) / diameter,
            "contact_ratio": float(np.ptp(top)) / diameter if len(top) else 0.0,
            "load_ratio": apart / diameter,
        } | ledger(energy)

    def measured(self, table: Columns) -> dict[str, float]:
        """Return what is kept of a whole run.

        Forces and shapes are those of the last record before the plates brake: where they do, a
        ring that moves on pushes less. ``kinetic_ratio`` is the largest from ``FAST`` of the first
        stroke to there.
        """
        top = int(table["compression"].argmax())
        work = float(table["work"][top])
        stroke = (self.rows - 1) / self.strokes  # in records
        last = max(1, int((1.0 - RAMP) * stroke * (1.0 + 1e-9)))
        on_the_way = slice(min(math.ceil(FAST * stroke), last), last + 1)
        kinetic = table["energy_kinetic"][on_the_way] / table["work"][on_the_way]
        found = {
            "final_compression": table["compression"][last],
            "final_force": table["force"][last],
            "final_scaled_force": table["scaled_force"][last],
            "final_area_ratio": table["area_ratio"][last],
            "final_contact_ratio": table["contact_ratio"][last],
            "energy_missing_ratio": np.abs(table["energy_missing"]).max() / work,
            "drag_ratio": table["lost_by_drag"][top] / work,
            "kinetic_ratio": kinetic.max(),
            "fold_ratio": self.fold,
            "sink_ratio": self._sunk(table, last),
        }
        found |= self._contact_line(table, top)
        if self.strokes == 2:
            height = float(np.ptp(self.system.motion.y))
            found["residual_compression"] = 1.0 - height / (2.0 * self.half)
            found["recovered_work"] = 1.0 - float(table["work"][-1]) / work
        return {name: float(value) for name, value in found.items()}

    def _sunk(self, table: Columns, row: int) -> float:
        """Return the overlap with the plates, weighted by load / half the gap between them.

        Springs that push with 2 k_n h store k_n h²: Σ h²/Σ h is the energy of all / F of a plate.
        """
        overlap = float(table["energy_contact"][row]) / max(float(table["force"][row]), TINY)
        return overlap / (self.half * (1.0 - float(table["compression"][row])))

    def _contact_line(self, table: Columns, top: int) -> dict[str, float]:
        """Fit a line to the contact length of loading, where it is long against a segment.

        A flat contact of a hollow ring bears at its two ends, so its length is how far the loads
        are apart; unlike the vertices that touch, that does not come in whole segments. That of a
        ring that may yield is no line.
        """
        ratio, strain = table["load_ratio"][: top + 1], table["compression"][: top + 1]
        segment = self.unit.segment / (2.0 * self.half)
        use = ratio > FEWEST_TOUCHING * segment
        if not self.hollow or self.plastic or use.sum() < 10:
            return {}
        slope, offset = np.polyfit(strain[use], ratio[use], 1)
        return {"contact_onset": -offset / slope, "contact_slope": slope}
