"""A simulation of soft particles: prepared once, then asked for its records."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from shear_sim.models.interface import Columns, Snapshot
from shear_sim.models.soft_particle import snapshots
from shear_sim.models.soft_particle.columns import COLUMNS
from shear_sim.models.soft_particle.diametral import Diametral
from shear_sim.models.soft_particle.parameters import (
    DiametralCompression,
    SoftParticle,
    SoftParticlePacking,
    SoftParticlePoint,
    SoftParticleRecord,
)
from shear_sim.protocol import snapshot_rows

PICTURE = 3.2  # side of what a snapshot shows, in radii of the ring
FEWEST_TOUCHING = 2.5  # segments between the loads on a plate, for a contact length


class SoftParticleSimulation:
    """One prepared simulation; see :class:`shear_sim.models.interface.Simulation`."""

    def __init__(self, point: SoftParticlePoint) -> None:
        self.point = point.resolved()
        self.run = Diametral(self.point)
        self.rows = (self.point.record.rows or 0) + 1
        self.done = 0
        self._table = np.empty((len(COLUMNS), self.rows))
        self.snapshots: list[Snapshot] = []
        strokes = self.run.strokes
        clock = np.linspace(0.0, strokes, self.rows)
        self._kept = snapshot_rows(self.point.record.snapshots, clock, strokes)

    def advance(self, rows: int) -> None:
        """Make the next ``rows`` records (fewer at the end of the protocol)."""
        for _ in range(min(rows, self.rows - self.done)):
            if self.done > 0:
                self.run.go_on()
            record = self.run.record()
            self._table[:, self.done] = [record[column.name] for column in COLUMNS]
            if self.done in self._kept:
                side = PICTURE * self.point.packing.radius
                self.snapshots.append(snapshots.take(self.run.system, self.done, side))
            self.done += 1

    def columns(self) -> Columns:
        """Return the records made so far."""
        return {column.name: self._table[k, : self.done].copy() for k, column in enumerate(COLUMNS)}

    def summary(self) -> dict[str, Any]:
        """Return JSON-ready facts."""
        system, unit = self.run.system, self.run.unit
        time = float(self._table[0, self.done - 1])
        return {
            "derived": {
                "segment_length": unit.segment,
                "stretch_stiffness": float(system.chains.stretch_stiffness[0]),
                "bend_stiffness": unit.hinge,
                "shell_modulus": unit.shell_modulus,
                "core_modulus": unit.core_modulus,
                "slowest_period": 2.0 * np.pi / unit.frequency,
                "time_step": system.rules.step,
                "longest_stable_step": system.stable_step,
                "steps": system.steps,
            },
            "protocol": {
                "kind": self.point.shear.kind,
                "tensors": [],
                "shear_start": 0.0,
                "shear_end": time,
                "end": time,
            },
            "preparation": {},
            "status": "completed",
            "measured": self._measured() if self.done == self.rows else None,
            "checks": {"closest_approach": float(system.work.closest[0])}
            if np.isfinite(system.work.closest[0])
            else {},
            "flags": {},
        }

    def _measured(self) -> dict[str, float]:
        """Return what is kept of a whole run."""
        table = self.columns()
        top = int(table["compression"].argmax())
        work = float(table["work"][top])
        found = {
            "final_force": table["force"][top],
            "final_scaled_force": table["scaled_force"][top],
            "final_area_ratio": table["area_ratio"][top],
            "final_contact_ratio": table["contact_ratio"][top],
            "energy_missing_ratio": np.abs(table["energy_missing"]).max() / work,
            "drag_ratio": table["lost_by_drag"][top] / work,
        }
        found |= self._contact_line(table, top)
        if self.point.shear.unload:
            motion = self.run.system.motion
            height = float(np.ptp(motion.y))
            found["residual_compression"] = 1.0 - height / (2.0 * self.run.half)
            found["recovered_work"] = 1.0 - float(table["work"][-1]) / work
        return {name: float(value) for name, value in found.items()}

    def _contact_line(self, table: Columns, top: int) -> dict[str, float]:
        """Fit a line to the contact length of loading, where it is long against a segment.

        A flat contact of a hollow ring bears at its two ends, so its length is how far the loads
        are apart; unlike the vertices that touch, that does not come in whole segments.
        """
        ratio, strain = table["load_ratio"][: top + 1], table["compression"][: top + 1]
        segment = self.run.unit.segment / (2.0 * self.run.half)
        use = ratio > FEWEST_TOUCHING * segment
        if self.point.model.core_ratio > 0.0 or use.sum() < 10:
            return {}
        slope, offset = np.polyfit(strain[use], ratio[use], 1)
        return {"contact_onset": -offset / slope, "contact_slope": slope}


def compile_kernels(points: Sequence[SoftParticlePoint]) -> None:  # noqa: ARG001 - same for all
    """Compile every kernel: a little compression of a small ring."""
    point = SoftParticlePoint(
        packing=SoftParticlePacking(vertices=8),
        model=SoftParticle(thickness=0.3),
        shear=DiametralCompression(compression=0.01, relative_rate=0.05, unload=False),
        record=SoftParticleRecord(rows=10, snapshots=1),
    )
    SoftParticleSimulation(point).advance(2)
