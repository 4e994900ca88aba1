"""A simulation of soft particles: prepared once, then asked for its records."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from shear_sim.models.interface import Columns, Snapshot
from shear_sim.models.soft_particle import snapshots
from shear_sim.models.soft_particle.beam import Beam
from shear_sim.models.soft_particle.columns import COLUMNS
from shear_sim.models.soft_particle.compaction import Compactor
from shear_sim.models.soft_particle.diametral import Diametral
from shear_sim.models.soft_particle.driving import (
    Bending,
    Compaction,
    DiametralCompression,
    OuterPressure,
    SoftParticleOscillatoryShear,
    Tension,
    Vibration,
)
from shear_sim.models.soft_particle.free_ring import Pressed, Vibrating
from shear_sim.models.soft_particle.parameters import (
    FINE,
    SoftParticle,
    SoftParticlePacking,
    SoftParticlePoint,
    SoftParticleRecord,
)
from shear_sim.models.soft_particle.scenario import Scenario
from shear_sim.models.soft_particle.suspension import Suspension
from shear_sim.models.soft_particle.tension import Puller
from shear_sim.protocol import snapshot_rows
from shear_sim.streams import Streams

#: Flags of a run: what is measured of it, and what is too much. Runs that are to be slow have
#: inertia and drag: an inertial stress of 3 % of that of a box, and forces that are some percent
#: too large. Those of coarse rings, and of rings that sink into plates, are as much too small.
FLAGS = {
    "energy_missing": ("energy_missing_ratio", 1e-4),
    "inertia": ("kinetic_ratio", 0.02),
    "drag": ("drag_ratio", 0.01),
    "coarse": ("fold_ratio", FINE),
    "sunk": ("sink_ratio", 0.01),
}
MISSING_ALONE = 1e-6  # energy_missing_ratio of a single chain that is too much


class SoftParticleSimulation:
    """One prepared simulation; see :class:`shear_sim.models.interface.Simulation`."""

    def __init__(self, point: SoftParticlePoint, streams: Streams) -> None:
        self.point = point.resolved()
        shear = self.point.shear
        self.run: Scenario
        if isinstance(shear, Compaction):
            self.run = Compactor(self.point, shear, streams)
        elif isinstance(shear, Tension):
            self.run = Puller(self.point, shear, streams)
        elif isinstance(shear, SoftParticleOscillatoryShear):
            self.run = Suspension(self.point, shear, streams)
        elif isinstance(shear, Bending):
            self.run = Beam(self.point, shear)
        elif isinstance(shear, OuterPressure):
            self.run = Pressed(self.point, shear)
        elif isinstance(shear, Vibration):
            self.run = Vibrating(self.point, shear)
        else:
            self.run = Diametral(self.point, shear)
        self.run.refuse_unstable(self.point.integrator.step)  # those that divide later, too
        self.done = 0
        self._records: list[dict[str, float]] = []
        self.snapshots: list[Snapshot] = []

    @property
    def threads(self) -> int:
        """Cores that it may use; the bits are the same with any."""
        return self.run.system.threads

    @threads.setter
    def threads(self, threads: int) -> None:
        self.run.system.threads = threads

    @property
    def rows(self) -> int:
        """Number of records; a lid that turns at a stress makes fewer than planned."""
        return self.run.rows

    def advance(self, rows: int) -> None:
        """Make the next ``rows`` records (fewer at the end), or a part of the preparation.

        A record of most studies is about T₁, as what is made of a preparation for each.
        """
        if self.done == 0 and not self.run.prepare(rows):
            return
        for _ in range(rows):
            if self.done == self.rows:
                return
            if self.done > 0:
                self.run.go_on()
            self._records.append(self.run.record())
            if self.done in self._kept():
                run = self.run
                taken = snapshots.take(run.system, self.done, run.frame, run.planes())
                self.snapshots.append(taken)
            self.done += 1

    def _kept(self) -> tuple[int, ...]:
        """Return the records of which a snapshot is kept, by the number of records as it is now."""
        clock = np.linspace(0.0, self.run.strokes, self.rows)
        return snapshot_rows(self.point.record.snapshots, clock, self.run.strokes)

    def columns(self) -> Columns:
        """Return the records made so far, with what this run measures."""
        return {
            column.name: np.array([record[column.name] for record in self._records], np.float64)
            for column in COLUMNS
            if not self._records or column.name in self._records[0]
        }

    def summary(self) -> dict[str, Any]:
        """Return JSON-ready facts."""
        system, unit = self.run.system, self.run.unit
        time = self._records[-1]["time"]
        protocol: dict[str, Any] = {
            "kind": self.point.shear.kind,
            "tensors": [],
            "shear_start": 0.0,
            "shear_end": time,
            "end": time,
        } | self.run.protocol()
        checks: dict[str, float] = {}
        if np.isfinite(system.work.closest).any():
            checks["closest_approach"] = float(system.work.closest.min())
        checks |= self.run.checks(self.columns())
        measured = self.run.measured(self.columns()) if self.done == self.rows else None
        return {
            "derived": {
                "segment_length": unit.segment,
                "stretch_stiffness": float(system.chains.stretch_stiffness[0]),
                "bend_stiffness": unit.hinge,
                "shell_modulus": unit.shell_modulus,
                "core_modulus": unit.core_modulus,
                "contact_stiffness": unit.stiffness,
                "slowest_period": unit.period,
                "time_step": system.rules.step,
                "longest_stable_step": system.stable_step,
                "steps": system.steps,
            },
            "protocol": protocol,
            "preparation": self.run.preparation(),
            "status": "completed",
            "measured": measured,
            "checks": checks,
            "flags": flags_of(measured or {}, alone=len(system.chains.closed) == 1),
        }


def flags_of(measured: dict[str, float], *, alone: bool) -> dict[str, bool]:
    """Return the flags of what is ``measured``; a chain that is ``alone`` may miss less energy."""
    limits = {flag: limit for flag, (_, limit) in FLAGS.items()}
    if alone:
        limits["energy_missing"] = MISSING_ALONE
    return {
        flag: not measured[name] <= limits[flag]
        for flag, (name, _) in FLAGS.items()
        if name in measured
    }


def compile_kernels(points: Sequence[SoftParticlePoint]) -> None:  # noqa: ARG001 - same for all
    """Compile every kernel: a little compression of a small ring."""
    point = SoftParticlePoint(
        packing=SoftParticlePacking(vertices=8),
        model=SoftParticle(thickness=0.3),
        shear=DiametralCompression(compression=0.01, relative_rate=0.05, unload=False),
        record=SoftParticleRecord(rows=10, snapshots=1),
    )
    SoftParticleSimulation(point, Streams(0, 0)).advance(2)
