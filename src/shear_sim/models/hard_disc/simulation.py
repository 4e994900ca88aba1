"""A simulation of hard discs: prepared once, then asked for its records."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.hard_disc.active_set import Arrested, Jammed, velocities
from shear_sim.models.hard_disc.certificate import certify, is_proof
from shear_sim.models.hard_disc.columns import COLUMNS
from shear_sim.models.hard_disc.driving import make_driving, make_records
from shear_sim.models.hard_disc.flow import Contacts, Dense, Flow, contacts_at
from shear_sim.models.hard_disc.overlap_free import INFLATION, push_apart
from shear_sim.models.hard_disc.parameters import (
    HardDisc,
    HardDiscCompression,
    HardDiscOscillatoryShear,
    HardDiscPacking,
    HardDiscPoint,
    HardDiscRecord,
    HardDiscSteadyShear,
)
from shear_sim.models.hard_disc.stress import duration, slowness, stress
from shear_sim.models.hard_disc.time_stepping import Marching
from shear_sim.models.interface import Columns, SimulationError
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]

MOST_START_STEPS = 20_000  # of one attempt at a start without overlap


class Packed:
    """Discs without overlap in a square cell, lengths in mean diameters of small discs."""

    def __init__(self, packing: HardDiscPacking, streams: Streams) -> None:
        n = packing.discs
        mean = np.where(np.arange(n) < math.ceil(n / 2), 0.5 * packing.size_ratio, 0.5)
        spread = packing.polydispersity * streams.generator("radii").uniform(-1, 1, n)
        self.radius: FloatArray = mean * (1 + spread)
        self.side = math.sqrt(math.pi * float((self.radius**2).sum()) / packing.packing_fraction)
        positions = streams.generator("positions")
        for attempt in range(packing.attempts):
            x, y = positions.random((2, n)) * self.side
            steps, overlap = push_apart(x, y, self.radius, self.side, self.side, MOST_START_STEPS)
            if overlap < 0.4 * INFLATION:
                self.x, self.y = x, y
                self.attempts, self.steps = attempt + 1, steps
                return
        msg = (
            f"no overlap-free start after {packing.attempts} attempts at packing_fraction = "
            f"{packing.packing_fraction:g} with {n} discs: lower it, or raise packing.attempts"
        )
        raise SimulationError(msg)


class HardDiscSimulation:
    """One prepared simulation; see :class:`shear_sim.models.interface.Simulation`."""

    def __init__(self, point: HardDiscPoint, streams: Streams) -> None:
        self.point = point.resolved()
        shear = self.point.shear
        packed = Packed(point.packing, streams)
        self.preparation = {"attempts": packed.attempts, "start_steps": packed.steps}
        assert self.point.record.rows is not None  # noqa: S101 - by resolved()
        self.records = make_records(shear, self.point.record.rows)
        self.path = self.records.path
        self.driving = make_driving(shear, point.packing.discs, streams)
        by_steps = point.integrator.scheme == "time_steps"
        self.flow: Flow = (Marching if by_steps else Flow)(
            packed.x, packed.y, packed.radius, np.ones_like(packed.x), packed.side, packed.side,
            self.driving.drive,
        )  # fmt: skip
        self.start_fraction = self.flow.packing_fraction
        self.done = 0
        self.status = "flowing"
        self.certificate: dict[str, Any] | None = None
        self.stopped: str | None = None
        self._made = 0
        self._table = np.empty((len(COLUMNS), len(self.path)))
        self.power_residual = self.least_force = self.largest_gap = 0.0
        self._seconds = 0.0  # of a flow at fixed stress, whose clock follows the stress
        self._imposed = self._fastest = 0.0
        if isinstance(shear, HardDiscSteadyShear) and shear.shear_stress is not None:
            self._imposed = shear.shear_stress * point.model.mobility
            self._fastest = shear.highest_rate * self._imposed

    @property
    def rows(self) -> int:
        """Number of records of the whole protocol; of what there was, if it could not go on."""
        return len(self.path) if self.stopped is None else self._made

    def advance(self, rows: int) -> None:
        """Make the next ``rows`` records (fewer at the end of the protocol)."""
        wanted = min(self.done + rows, len(self.path))
        try:
            while self._made < wanted:
                if self._made == 0:
                    self._first()
                elif isinstance(self.flow, Marching):
                    self._march(self.flow)
                elif self.flow.path < min(self.driving.until, self.path[-1]):
                    self.flow.step(min(self.driving.until, float(self.path[-1])), self._look)
                elif self.driving.until < self.path[-1]:
                    self.driving.change(self.flow)
                else:  # the last record is the end of the path, to round-off
                    self._first()
        except Jammed as jam:
            self.certificate = certify(self.flow.instant(), jam, self.flow.path)
            self.status = "jammed" if is_proof(self.certificate) else "arrested"
            self.stopped = f"{self.status} at path {self.flow.path:.9g}"
            if self.status == "arrested":
                self.stopped += ": the forces found do not balance, so nothing is proved jammed"
        except Arrested as arrest:
            self.status = "arrested"
            self.stopped = f"arrested at path {self.flow.path:.9g}: {arrest}"
        self.done = min(wanted, self._made)

    def _first(self) -> None:
        """Record the present instant."""
        self._record(self.flow.contacts())

    def _march(self, flow: Marching) -> None:
        """Go on to the next record in equal steps."""
        longest = self.point.integrator.strain_step or math.inf
        strain = float(self.path[self._made] - self.path[self._made - 1])
        steps = math.ceil(strain / longest * (1 - 1e-9))
        flow.strain_step = strain / steps
        for _ in range(steps):
            flow.march()
        self._record(flow.contacts())

    def _look(self, motion: Dense, path: float, step: float) -> None:
        """Make the records that fall within a step, by dense output."""
        done = 0.0  # of the step, by the clock
        while self._made < len(self.path) and self.path[self._made] <= path + step:
            t = float(self.path[self._made]) - path
            self._let_pass(motion, done, t)
            self._record(contacts_at(motion, t))
            done = t
        self._let_pass(motion, done, step)

    def _let_pass(self, motion: Dense, begin: float, end: float) -> None:
        """Let the clock of a flow at fixed stress go on."""
        if self._imposed and end > begin:
            self._seconds += duration(motion, begin, end, self._imposed, self._fastest)

    def _record(self, contacts: Contacts) -> None:
        """Append a record."""
        flow, row = self.flow, self._made
        drive = flow.drive
        i, j, rx, ry, gap, phi, kappa, area, squeezed = contacts
        xx, xy, yy = stress(contacts)
        u = velocities(i, j, rx, ry, phi, flow.mobility, drive.drift)
        moving = flow.mobility > 0.0
        force = drive.drift[:, moving] / flow.mobility[moving]
        power = float((u[:, moving] ** 2 / flow.mobility[moving]).sum())
        put_in = (
            -area * drive.shear * xy, area * kappa * (xx + yy), float((u[:, moving] * force).sum()),
        )  # fmt: skip
        if len(phi) and not isinstance(flow, Marching):  # whose contacts close within a step
            residual = abs(power - sum(put_in)) / sum(map(abs, put_in))
            self.power_residual = max(self.power_residual, residual)
            self.least_force = min(self.least_force, float(phi.min() / phi.mean()))
            self.largest_gap = max(self.largest_gap, float(np.abs(gap).max()) / flow.unit)
        _, time, strain, strain_rate, path_rate = (float(a[row]) for a in self.records)
        if self._imposed:
            time = self._seconds
            strain_rate = 1.0 / slowness(-xy, self._imposed, self._fastest)
            path_rate = strain_rate
        pascal = path_rate / self.point.model.mobility
        counts = flow.counts
        discs = len(flow.x)
        self._table[:, row] = (
            time, strain, strain_rate, xx * pascal, xy * pascal, yy * pascal,
            -xy * (drive.shear or 1.0), 0.5 * (xx + yy), 2 * len(phi) / discs,
            math.pi * float((flow.radius**2).sum()) / area, kappa, squeezed,
            math.sqrt(float((u**2).sum()) / discs), counts.collisions + counts.openings,
        )  # fmt: skip
        self._made += 1

    def columns(self) -> Columns:
        """Return the records made so far."""
        return {column.name: self._table[k, : self.done].copy() for k, column in enumerate(COLUMNS)}

    def summary(self) -> dict[str, Any]:
        """Return JSON-ready facts."""
        shear, flow, counts = self.point.shear, self.flow, self.flow.counts
        protocol: dict[str, Any] = {
            "kind": shear.kind,
            "tensors": ["periodic"],
            "impulsive": True,
            "shear_start": 0.0,
            "shear_end": float(self.records.time[-1]),
            "end": float(self.records.time[-1]),
        }
        if self._imposed and self._seconds > 0.0:
            time, strain = self._table[:2, : self.done]
            middle = float(np.interp(0.5 * time[-1], time, strain))
            protocol["strain_rate"] = (strain[-1] - middle) / (0.5 * time[-1])
            protocol["shear_end"] = protocol["end"] = float(time[-1])
        elif isinstance(shear, HardDiscSteadyShear):
            protocol["strain_rate"] = shear.strain_rate
        elif isinstance(shear, HardDiscOscillatoryShear):
            protocol |= {
                "strain_amplitude": shear.strain_amplitude,
                "period": shear.period,
                "periods": shear.periods,
            }
        return {
            "derived": {"cell_side": flow.width, "packing_fraction": flow.packing_fraction},
            "protocol": protocol,
            "preparation": self.preparation,
            "status": self.status,
            "stopped": self.stopped,
            "certificate": self.certificate,
            "measured": self._measured(),
            "events": {
                "collisions": counts.collisions,
                "openings": counts.openings,
                "steps": counts.steps,
                "factorisations": flow.set.factorisations,
                "neighbour_lists": counts.rebuilds,
                "mean_order": counts.orders / max(1, counts.steps),
            },
            "checks": {
                "largest_overlap": counts.largest_overlap,
                "largest_drift": counts.largest_drift,
                "largest_gap_in_records": self.largest_gap,
                "integration_error": counts.error,
                "power_residual": self.power_residual,
                "least_force": self.least_force,
                "area_residual": abs(
                    0.5 * math.log(flow.packing_fraction / self.start_fraction) - flow.squeezed
                ),
            },
            "flags": {
                "not_at_rest": False,
                "stopped_early": self.stopped is not None
                and not (self.status == "jammed" and isinstance(shear, HardDiscCompression)),
            },
        }

    def _measured(self) -> dict[str, float] | None:
        """Return means after the transient; None if the run did not come to its end."""
        shear = self.point.shear
        if isinstance(shear, HardDiscCompression):
            found = {"final_packing_fraction": self.flow.packing_fraction}
            if self.certificate:
                found["rattler_fraction"] = len(self.certificate["rattlers"]) / len(self.flow.x)
            return found
        if self.done < len(self.path) or isinstance(shear, HardDiscOscillatoryShear):
            return None
        columns = self.columns()
        late = self.path >= shear.transient * self.path[-1]
        mean = {name: float(values[late].mean()) for name, values in columns.items()}
        return {
            "scaled_shear_stress": mean["scaled_shear_stress"],
            "scaled_pressure": mean["scaled_pressure"],
            "friction_coefficient": mean["scaled_shear_stress"]
            / (mean["scaled_pressure"] or math.nan),
            "viscous_number": 1.0 / (mean["scaled_pressure"] or math.nan),
            "contact_number": mean["contact_number"],
            "mean_packing_fraction": mean["packing_fraction"],
            "compression_ratio": mean["compression_ratio"],
            "nonaffine_speed": mean["nonaffine_speed"],
            "events_per_disc_path": float(np.ptp(columns["events"][late]))
            / (float(np.ptp(self.path[late])) * self.point.packing.discs),
        }


def compile_kernels(points: Sequence[HardDiscPoint]) -> None:  # noqa: ARG001 - the same for all
    """Compile every kernel: a little shear of a few discs."""
    point = HardDiscPoint(
        packing=HardDiscPacking(discs=8, packing_fraction=0.6),
        model=HardDisc(kind="hard_disc"),
        shear=HardDiscSteadyShear(kind="steady", strain=0.5),
        record=HardDiscRecord(rows=20),
    )
    HardDiscSimulation(point, Streams(0, 0)).advance(21)
