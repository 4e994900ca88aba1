"""A simulation of hard discs: prepared once, then asked for its records."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.hard_disc.active_set import Arrested, Drive, Jammed, velocities
from shear_sim.models.hard_disc.certificate import certify, is_proof
from shear_sim.models.hard_disc.columns import COLUMNS
from shear_sim.models.hard_disc.driving import (
    ROUNDING,
    Staged,
    make_driving,
    make_records,
    rest,
)
from shear_sim.models.hard_disc.flow import Contacts, Dense, Flow, contacts_at
from shear_sim.models.hard_disc.packing import make_start
from shear_sim.models.hard_disc.parameters import (
    HardDisc,
    HardDiscCompression,
    HardDiscOscillatoryShear,
    HardDiscPacking,
    HardDiscPoint,
    HardDiscRecord,
    HardDiscStages,
    HardDiscSteadyShear,
)
from shear_sim.models.hard_disc.stress import duration, slowness, stress
from shear_sim.models.hard_disc.time_stepping import Marching
from shear_sim.models.interface import CONTACT, LINK, Columns, SimulationError, Snapshot
from shear_sim.protocol import snapshot_rows
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]


class HardDiscSimulation:
    """One prepared simulation; see :class:`shear_sim.models.interface.Simulation`."""

    threads = 1

    def __init__(self, point: HardDiscPoint, streams: Streams) -> None:
        self.point = point.resolved()
        shear = self.point.shear
        start = make_start(point.packing, point.model, streams)
        self.preparation = start.facts
        assert self.point.record.rows is not None  # noqa: S101 - by resolved()
        self.records = make_records(shear, self.point.record.rows)
        self.path = self.records.path
        self.driving = make_driving(shear, start.radius, start.mobility, streams)
        by_steps = point.integrator.scheme == "time_steps"
        still = Drive(0.0, 0.0, 0.0, np.zeros((2, len(start.x))))  # until the first record
        try:
            self.flow: Flow = (Marching if by_steps else Flow)(
                start.x, start.y, start.radius, start.mobility, start.width, start.height,
                still, offset=start.offset, bonds=start.bonds,
            )  # fmt: skip
        except ValueError as error:  # what the user's file holds
            raise SimulationError(str(error)) from None
        self.mobile = int((start.mobility > 0).sum())
        self.start_fraction = self.flow.packing_fraction
        self.done = 0
        self.status = "flowing"
        self.certificate: dict[str, Any] | None = None
        self.jams: list[dict[str, Any]] = []  # certificates of stages that another one follows
        self.stopped: str | None = None
        self._begun = False
        self._made = 0
        self.snapshots: list[Snapshot] = []
        self._latest: Snapshot | None = None  # of the last record, if any are kept
        clock = self.path
        if isinstance(shear, HardDiscOscillatoryShear):
            clock = self.records.time / shear.period
        self._kept = snapshot_rows(self.point.record.snapshots, clock, float(clock[-1]))
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
        while self._made < wanted and self.stopped is None:
            try:
                self._go_on()
            except Jammed as jam:
                self._jam(certify(self.flow.instant(), jam, self.flow.path))
            except Arrested as arrest:
                self.status = "arrested"
                self.stopped = f"arrested at path {self.flow.path:.9g}: {arrest}"
        self.done = min(wanted, self._made)
        if self.stopped is not None and self._latest is not None:
            if self._latest.row not in [snapshot.row for snapshot in self.snapshots]:
                self.snapshots.append(self._latest)
            self._latest = None

    def _go_on(self) -> None:
        """Do one thing: make a record, go to an event, or change the drive."""
        driving = self.driving
        if not self._begun:
            self._begun = True
            self.flow.turn(driving.drive)
        elif self._made == 0:
            self._first()
        elif isinstance(self.flow, Marching):
            self._march(self.flow)
        elif self.flow.path < min(driving.until, self.path[-1]):
            self.flow.step(min(driving.until, float(self.path[-1])), self._look)
        elif driving.until < self.path[-1]:
            if self.path[self._made] <= driving.until * (1.0 + ROUNDING):
                self._first()  # a record of the change is of the drive that ends
            else:
                driving.change(self.flow)
        else:  # the last record is the end of the path, to round-off
            self._first()

    def _jam(self, certificate: dict[str, Any]) -> None:
        """End the run, or rest until the next stage where there is one."""
        flow = self.flow
        if not is_proof(certificate):
            self.certificate = certificate
            self.status = "arrested"
            self.stopped = (
                f"arrested at path {flow.path:.9g}: the forces found do not balance, so nothing is "
                "proved jammed"
            )
        elif isinstance(self.driving, Staged) and math.isfinite(self.driving.until):
            self.jams.append(certificate)
            rest(self.records, flow.path, self.driving.until, flow.drive.shear)
            flow.turn(flow.drive._replace(shear=0.0, compression=0.0))
        else:
            self.certificate = certificate
            self.status = "jammed"
            self.stopped = f"jammed at path {flow.path:.9g}"

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
        i, j, rx, ry, gap, phi, kappa, area, squeezed, *_ = contacts
        xx, xy, yy = stress(contacts)
        u = velocities(i, j, rx, ry, phi, flow.mobility, drive.drift)
        moving = flow.mobility > 0.0
        force = drive.drift[:, moving] / flow.mobility[moving]
        power = float((u[:, moving] ** 2 / flow.mobility[moving]).sum())
        put_in = (
            -area * drive.shear * xy, area * kappa * (xx + yy), float((u[:, moving] * force).sum()),
        )  # fmt: skip
        if len(phi) and not isinstance(flow, Marching):  # whose contacts close within a step
            # At rest on a floor ⟨u|F⟩ is round-off: what counts is what F could do to free discs.
            free = float((flow.mobility[moving] * force**2).sum())
            scale = abs(put_in[0]) + abs(put_in[1]) + free
            if scale > 0.0:
                residual = abs(power - sum(put_in)) / scale
                self.power_residual = max(self.power_residual, residual)
            pushing = phi[flow.permanent[flow.set.pairs] == 0]
            if pushing.min(initial=0.0) < 0.0:
                least = float(pushing.min() / np.abs(phi).mean())
                self.least_force = min(self.least_force, least)
            self.largest_gap = max(self.largest_gap, float(np.abs(gap).max()) / flow.unit)
        _, time, strain, strain_rate, path_rate = (float(a[row]) for a in self.records)
        if self._imposed:
            time = self._seconds
            strain_rate = 1.0 / slowness(-xy, self._imposed, self._fastest)
            path_rate = strain_rate
        pascal = path_rate / self.point.model.mobility
        counts = flow.counts
        discs = self.mobile
        self._table[:, row] = (
            time, strain, strain_rate, xx * pascal, xy * pascal, yy * pascal,
            -xy * (drive.shear or 1.0), 0.5 * (xx + yy), 2 * len(phi) / discs,
            flow.disc_area / area, kappa, squeezed,
            math.sqrt(float((u**2).sum()) / discs), counts.collisions + counts.openings,
            float(u[0].sum()) / discs, float(u[1].sum()) / discs,
        )  # fmt: skip
        if self._kept:
            self._latest = self._snapshot(contacts, u)
            if row in self._kept:
                self.snapshots.append(self._latest)
        self._made += 1

    def _snapshot(self, now: Contacts, u: FloatArray) -> Snapshot:
        """Return the snapshot of the record that is being made, in units of paths, see `stress`."""
        shear, flow = self.flow.drive.shear, self.flow
        r = np.column_stack([now.rx, now.ry])
        bonded = flow.permanent[flow.set.pairs] != 0
        vx = u[0] + shear * (now.y - 0.5 * now.height) - now.kappa * (now.x - 0.5 * now.width)
        vy = u[1] - now.kappa * (now.y - 0.5 * now.height)
        return Snapshot(
            row=self._made, width=now.width, height=now.height, offset=now.offset, periodic=True,
            position=np.column_stack([now.x, now.y]), velocity=np.column_stack([vx, vy]),
            spin=np.zeros(len(now.x)), radius=flow.radius.copy(), fixed=flow.mobility == 0,
            i=now.i.copy(), j=now.j.copy(), separation=r, normal=now.phi * np.hypot(*r.T),
            tangential=np.zeros(len(r)),
            kind=np.where(bonded, LINK, CONTACT).astype(np.int8), walls=np.zeros((0, 3)),
            mass=np.ones(len(now.x)),
        )  # fmt: skip

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
        if self._imposed and self.stopped is not None:
            protocol["strain_rate"] = 0.0  # whatever it was before: there is no steady flow
        elif self._imposed and self.done > 1:
            time, strain = self._table[:2, : self.done]
            middle = float(np.interp(0.5 * time[-1], time, strain))
            protocol["strain_rate"] = float((strain[-1] - middle) / (0.5 * time[-1]))
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
            **({"jams": self.jams} if isinstance(shear, HardDiscStages) else {}),
            **({"state": self._state()} if self.point.record.state else {}),
            "measured": self._measured(),
            "events": {
                "collisions": counts.collisions,
                "openings": counts.openings,
                "steps": counts.steps,
                "factorisations": flow.set.factorisations,
                "dependent_contacts": flow.set.dependent,
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
                "forces_nonunique": flow.set.dependent > 0,
                "stopped_early": self.stopped is not None
                and not (self.status == "jammed" and isinstance(shear, HardDiscCompression)),
            },
        }

    def _state(self) -> dict[str, Any]:
        """Return discs and contacts as they are: what ``packing.file`` may hold."""
        flow, c = self.flow, self.flow.set.pairs
        lists: dict[str, NDArray[Any]] = {
            "x": flow.x, "y": flow.y, "radius": flow.radius, "mobility": flow.mobility,
            "bonds": flow.bonds, "contact_i": flow.pairs.i[c], "contact_j": flow.pairs.j[c],
            "contact_rx": flow.rx[c], "contact_ry": flow.ry[c],
            "contact_force": flow.set.phi * np.hypot(flow.rx[c], flow.ry[c]),
        }  # fmt: skip
        cell = {"width": flow.width, "height": flow.height, "offset": flow.offset}
        return cell | {name: values.tolist() for name, values in lists.items()}

    def _measured(self) -> dict[str, float | None] | None:
        """Return means after the transient; None if the run did not come to its end."""
        found: dict[str, float | None]
        shear = self.point.shear
        if isinstance(shear, HardDiscCompression | HardDiscStages):
            found = {"final_packing_fraction": self.flow.packing_fraction}
            if self.certificate:
                found["rattler_fraction"] = len(self.certificate["rattlers"]) / self.mobile
            return found
        if self.done < len(self.path) or isinstance(shear, HardDiscOscillatoryShear):
            return None
        columns = self.columns()
        late = self.path >= shear.transient * self.path[-1]
        mean = {name: float(values[late].mean()) for name, values in columns.items()}
        stress, pressure = mean["scaled_shear_stress"], mean["scaled_pressure"]
        return {
            "scaled_shear_stress": stress,
            "scaled_pressure": pressure,
            # Discs that never met have no pressure to divide by.
            "friction_coefficient": stress / pressure if pressure else None,
            "viscous_number": 1.0 / pressure if pressure else None,
            "contact_number": mean["contact_number"],
            "mean_packing_fraction": mean["packing_fraction"],
            "compression_ratio": mean["compression_ratio"],
            "nonaffine_speed": mean["nonaffine_speed"],
            "events_per_disc_path": float(np.ptp(columns["events"][late]))
            / (float(np.ptp(self.path[late])) * self.mobile),
            "mean_velocity_x": mean["mean_velocity_x"],
            "mean_velocity_y": mean["mean_velocity_y"],
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
