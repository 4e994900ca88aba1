"""The start of a microgel run: a packing made, brought to rest, linked, and at rest again."""

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import Columns, SimulationError, Snapshot
from shear_sim.models.microgel import laws, motion
from shear_sim.models.microgel.links import make_links, touching_pairs
from shear_sim.models.microgel.parameters import Links, Microgel, MicrogelPoint, Record
from shear_sim.models.microgel.simulation import (
    FloatArray,
    MicrogelSimulation,
    contact_law,
    kernels_for,
    kernels_of,
    last_step,
    make_clock,
    make_constants,
    make_discs,
    make_pairs,
    make_work,
    needs_tangential,
    refined,
    time_scale,
)
from shear_sim.models.microgel.startfile import read_start
from shear_sim.models.microgel.state import (
    ENERGIES,
    OSCILLATION,
    ROW,
    RUNNING,
    Clock,
    Constants,
    Discs,
    Pairs,
)
from shear_sim.models.microgel.strips import in_strips, in_threads
from shear_sim.packing import Equilibration, Packing, cell_height, start_discs
from shear_sim.protocol import OscillatoryShear
from shear_sim.streams import Streams

REST_DAMPING = 0.5  # 1/τ, while a packing comes to rest
SETTLING_BLOCK = 50  # steps between looks whether it has
CACHED = 1000  # so many discs lie in the cache however they are numbered


class Start(NamedTuple):
    """A packing at rest, linked and ready to be sheared: where runs of a point start from."""

    discs: Discs
    links: Pairs
    contacts: Pairs
    constants: Constants
    period: float  # T [s]
    preparation: dict[str, Any]


def prepare(point: MicrogelPoint, streams: Streams) -> MicrogelSimulation:
    """Prepare the simulation of a point, see :func:`make_start`."""
    return _prepared(point, make_start(point, streams))


def _prepared(point: MicrogelPoint, start: Start) -> MicrogelSimulation:
    clock = make_clock(point.shear, start.period, point.steps_per_period, point.record.every)
    return MicrogelSimulation(
        point, kernels_of(point), start.discs, start.links, start.contacts,
        refined(start.constants, point.refinement), clock, start.preparation,
    )  # fmt: skip


class MicrogelRun:
    """A run from its packing on; see :class:`shear_sim.models.interface.Simulation`.

    The preparation is the larger part of a run of many discs, so it goes in blocks too.
    """

    simulation: MicrogelSimulation  # once it is prepared
    threads = 1

    def __init__(self, point: MicrogelPoint, streams: Streams) -> None:
        self.point = point
        self.preparation: Preparation | None = Preparation(point, streams)
        period, every = self.preparation.period, point.record.every
        clock = make_clock(point.shear, period, point.steps_per_period, every)
        self.rows = last_step(clock, point.shear) // every + 1

    @property
    def snapshots(self) -> Sequence[Snapshot]:
        """Those made so far."""
        return () if self.preparation else self.simulation.snapshots

    @property
    def done(self) -> int:
        """Number of records made so far."""
        return 0 if self.preparation else self.simulation.done

    def advance(self, rows: int) -> None:
        """Make the next records, or as many steps of the preparation as they take."""
        if self.preparation is None:
            self.simulation.threads = self.threads
            self.simulation.advance(rows)
        elif start := self.preparation.advance(rows * self.point.record.every, self.threads):
            self.simulation = _prepared(self.point, start)
            self.preparation = None

    def columns(self) -> Columns:
        """Return the stored columns of the records made so far."""
        return self.simulation.columns()

    def summary(self) -> dict[str, Any]:
        """Return derived constants, protocol, preparation, self-checks and flags."""
        return self.simulation.summary()


def make_start(point: MicrogelPoint, streams: Streams) -> Start:
    """Make the packing of a point, bring it to rest, link it, and bring it to rest again."""
    preparation = Preparation(point, streams)
    while (start := preparation.advance(1000)) is None:
        pass
    return start


class Preparation:
    """A start on its way, some steps at a time; a pickled copy goes on to the same bits."""

    def __init__(self, point: MicrogelPoint, streams: Streams) -> None:
        self.point, self.streams = point, streams
        self.discs, self.links, self.contacts, width, height = _start(point, streams)
        _, self.tau = time_scale(point.model, self.discs.mass)
        self.period = self.tau / point.shear.relative_frequency
        self.constants = make_constants(point, self.discs, width, height, self.period)
        self.report: dict[str, Any] = {}
        self.stage: Relaxation | Settling = Relaxation(point, self.discs, self.constants)

    def advance(self, steps: int, threads: int = 1) -> Start | None:
        """Make about so many steps; return the start when it is there.

        Raises
        ------
        SimulationError
            If the packing explodes, or the user's contact law does not work.
        """
        report = self.stage.advance(steps, threads)
        if report is None:
            return None
        self.report |= report
        point, discs, constants = self.point, self.discs, self.constants
        if isinstance(self.stage, Relaxation):
            if point.model.links.cut not in ("none", "file"):
                self.links, report = _link(point.model.links, self.streams, discs, constants)
                self.report |= report
            self.stage = Settling(point, discs, self.links, self.contacts, constants, self.tau)
            return None
        if point.cell.boundary == "plates":
            glue(discs, constants.height)
            self.report["glued_discs"] = int((discs.plate != 0).sum())
        return Start(discs, self.links, self.stage.contacts, constants, self.period, self.report)


def _start(point: MicrogelPoint, streams: Streams) -> tuple[Discs, Pairs, Pairs, float, float]:
    """Return discs, links and contacts that are given, and the cell's width and height [m]."""
    packing = point.packing
    if packing.start != "file":
        start = start_discs(packing, point.cell, streams)
        order = by_rows(start.position, start.radius)
        discs = make_discs(start.position[order], start.radius[order], density=packing.density)
        return discs, make_pairs(), make_pairs(), start.width, start.height
    try:
        given = read_start(packing, point.cell)
    except ValueError as error:
        msg = f"start file {packing.file}: {error}"
        raise SimulationError(msg) from None
    discs = make_discs(
        given.position,
        given.radius,
        density=packing.density,
        mass=given.mass,
        inertia=given.inertia,
        velocity=given.velocity,
        spin=given.spin,
    )
    links, contacts = (
        make_pairs(
            np.column_stack([pairs.i, pairs.j]).astype(np.int64),
            np.column_stack([pairs.nx, pairs.ny]).astype(np.int64),
            pairs.spring,
            pairs.spring_back,
        )
        for pairs in (given.links, given.contacts)
    )
    return discs, links, contacts, point.cell.width, cell_height(packing, point.cell)


def by_rows(position: FloatArray, radius: FloatArray) -> NDArray[np.int64]:
    """Return the order (N,) of many discs by rows of four mean radii, and by x in each.

    Neighbours then lie near each other in memory, also after any strain, which shifts whole rows.
    A few discs keep their order.
    """
    if len(radius) <= CACHED:
        return np.arange(len(radius))
    return np.lexsort((position[:, 0], position[:, 1] // (4 * radius.mean())))


class Relaxation:
    """A packing on its way to friction-free rest: the equilibration before friction and links.

    Random starts overlap deeply, so the bounded linear law comes first, then the study's own.
    """

    def __init__(self, point: MicrogelPoint, discs: Discs, constants: Constants) -> None:
        self.point, self.discs = point, discs
        self.unit = force_unit(constants, discs)
        longest = 3 * math.sqrt(discs.mass.min() / (6 * constants.k))
        # What only moving discs feel stays out of it: scenes that differ there share packings.
        self.constants = constants._replace(
            step_normal=longest,
            step_energy=0.5 * longest,  # energy may err
            step_normal_dashpot=math.inf,
        )
        self.work = make_work(len(discs.x))
        self.contacts = self.links = in_strips(make_pairs(), self.work.edges)
        self.linear = True
        self.fire = np.zeros(3)
        self.steps = self.steps_before = 0

    def advance(self, steps: int, threads: int = 1) -> dict[str, Any] | None:
        """Make at most so many steps; return the report when the packing is at rest."""
        rest, constants = self.point.packing.equilibration, self.constants
        if rest.max_steps == 0:
            return {}
        law, tolerance = contact_law(self.point.model), 0.5 * rest.force_tolerance
        # Half of it, as settling adds its own rounding.
        if self.linear:
            law, tolerance = laws.divergent, 1e-3
            constants = constants._replace(law=(0.0, *constants.law[1:]))
        tolerance *= self.unit
        relax = kernels_for(law, tangential=False).relax
        fire, first = self.fire.copy(), self.steps
        last = min(first + steps, rest.max_steps)
        self.contacts, self.steps, force = in_threads(
            threads, self.work, self.links, self.contacts,
            lambda work, links, contacts: relax(
                self.discs, work, links, contacts, constants, tolerance, first, last,
                self.fire if work.thread == 0 else fire.copy(),
            ),
        )  # fmt: skip
        if not math.isfinite(force):
            msg = "the contact law gave a force that is not a number while the packing was made"
            raise SimulationError(msg)
        if force > tolerance and self.steps < rest.max_steps:
            return None
        self.steps_before, self.steps = self.steps_before + self.steps, 0
        if self.linear:
            self.linear = False
            return None
        self.discs.cx[:] = self.discs.cy[:] = 0.0
        return {"relaxation_steps": self.steps_before, "relaxed_force": force / self.unit}


def _link(
    section: Links, streams: Streams, discs: Discs, constants: Constants
) -> tuple[Pairs, dict[str, Any]]:
    """Link touching discs and cut the network into particles."""
    motion.renew_contacts(
        discs, make_work(len(discs.x)), make_pairs(), make_pairs(), constants, 0.0
    )
    network = touching_pairs(
        np.column_stack([discs.x, discs.y]),
        discs.radius,
        (constants.width, constants.height),
        constants.periodic,
    )
    linked, report = make_links(network, section, streams)
    return make_pairs(network.pairs[linked], network.image[linked]), report


def force_unit(constants: Constants, discs: Discs) -> float:
    """Return k⟨D⟩ of the contacts [N/m], the unit of forces that remain at rest."""
    return constants.k * 2 * float(discs.radius.mean())


def glue(discs: Discs, height: float) -> None:
    """Glue discs that touch the top or bottom edge to the rigid plate there."""
    y = discs.y % height  # a disc may be outside the cell until its next renewal
    discs.plate[y <= discs.radius] = -1
    discs.plate[y >= height - discs.radius] = 1
    for array in (discs.cx, discs.cy, discs.spin):
        array[discs.plate != 0] = 0.0


class Settling:
    """A linked, frictional packing on its way to rest at zero strain, in damped dynamics."""

    def __init__(
        self,
        point: MicrogelPoint,
        discs: Discs,
        links: Pairs,
        contacts: Pairs,
        constants: Constants,
        tau: float,
    ) -> None:
        self.point, self.discs = point, discs
        self.constants = constants._replace(
            damping=REST_DAMPING / tau, spin_damping=REST_DAMPING / tau, spin_target=0.0
        )
        self.work = make_work(len(discs.x))
        self.links, self.contacts = (in_strips(p, self.work.edges) for p in (links, contacts))
        self.clock = Clock(0.2 * tau, 0, 0, OSCILLATION, 100, 0.0, SETTLING_BLOCK)
        self.steps = 0

    def advance(self, steps: int, threads: int = 1) -> dict[str, Any] | None:
        """Make about so many steps; return the report when the packing is at rest."""
        rest, discs, work = self.point.packing.equilibration, self.discs, self.work
        unit = force_unit(self.constants, discs)
        energy_unit = unit * 2 * float(discs.radius.mean())
        until = self.steps + steps
        while True:
            self._run(0, 1)  # to share one instant takes longer than to work it out
            force = float(np.hypot(work.fx, work.fy).max()) / unit
            turning = float((np.abs(work.torque) / discs.radius).max()) / unit
            speed2 = discs.cx**2 + discs.cy**2
            energy = 0.5 * (discs.mass * speed2 + discs.inertia * discs.spin**2).mean()
            energy /= energy_unit
            at_rest = max(force, turning) <= rest.force_tolerance
            at_rest = at_rest and energy <= rest.energy_tolerance
            if at_rest or self.steps >= rest.max_steps:
                break
            substeps, status = self._run(SETTLING_BLOCK, threads)
            if status != RUNNING:
                msg = "the packing exploded while it came to rest"
                raise SimulationError(msg)
            self.steps += substeps
            if self.steps >= until:
                return None
        if self.steps:  # a drift of the whole packing is not motion of the packing
            for velocity in (discs.cx, discs.cy):
                velocity -= (discs.mass * velocity).sum() / discs.mass.sum()
        return {
            "settling_steps": self.steps,
            "unbalanced_force": max(force, turning),
            "kinetic_energy": float(energy),
            "at_rest": bool(at_rest),
        }

    def _run(self, last: int, threads: int) -> tuple[int, int]:
        """Run to step ``last``, from rest forces on; return substeps and status."""
        rows = np.empty((2, len(ROW + ENERGIES)))
        point = self.point
        self.contacts, _, substeps, status = in_threads(
            1 if point.record.energy else threads, self.work, self.links, self.contacts,
            lambda work, links, contacts: kernels_of(point).run(
                self.discs, work, links, contacts, self.constants, self.clock, -1, last, False,
                rows if work.thread == 0 else np.empty_like(rows),
            ),
        )  # fmt: skip
        return substeps, status


def compile_kernels(points: Sequence[MicrogelPoint]) -> None:
    """Compile every kernel that ``points`` need: a few steps of a small packing of each kind."""
    # A user's law may never let a packing come to rest.
    rest = Equilibration(max_steps=50)
    small = Packing(discs=20, packing_fraction=1.0, equilibration=rest)
    brief = OscillatoryShear(pre_periods=0, periods=0.025, post_periods=0)
    wanted = {}
    for p in points:
        law, turning = p.model.contact_law, needs_tangential(p.model)
        key = law.model_dump_json(), turning, p.record.energy, p.model.sliding
        wanted[key] = law
    for (_, turning, energy, sliding), law in wanted.items():
        links = Links(cut="bulk" if turning else "none")
        model = Microgel(contact_law=law, links=links, friction=0.0, sliding=sliding)
        record = Record(energy=energy)
        point = MicrogelPoint(model=model, packing=small, shear=brief, record=record)
        # A user's law that does not work, or raises as it likes: its own jobs say so.
        with suppress(Exception if law.kind == "custom" else SimulationError):
            prepare(point, Streams(0, 0)).advance(2)
