"""The start of a microgel run: a packing made, brought to rest, linked, and at rest again."""

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import SimulationError
from shear_sim.models.microgel import laws, motion
from shear_sim.models.microgel.links import make_links, touching_pairs
from shear_sim.models.microgel.parameters import Links, Microgel, MicrogelPoint, Record
from shear_sim.models.microgel.simulation import (
    FloatArray,
    MicrogelSimulation,
    contact_law,
    kernels_for,
    kernels_of,
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
from shear_sim.packing import Equilibration, Packing, cell_height, start_discs
from shear_sim.protocol import OscillatoryShear
from shear_sim.streams import Streams

REST_DAMPING = 0.5  # 1/τ, while a packing comes to rest
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
    start = make_start(point, streams)
    clock = make_clock(point.shear, start.period, point.steps_per_period, point.record.every)
    return MicrogelSimulation(
        point, kernels_of(point), start.discs, start.links, start.contacts,
        refined(start.constants, point.refinement), clock, start.preparation,
    )  # fmt: skip


def make_start(point: MicrogelPoint, streams: Streams) -> Start:
    """Make the packing of a point, bring it to rest, link it, and bring it to rest again."""
    model = point.model
    discs, links, contacts, width, height = _start(point, streams)
    _, tau = time_scale(model, discs.mass)
    period = tau / point.shear.relative_frequency
    constants = make_constants(point, discs, width, height, period)
    law = contact_law(model)

    preparation = _relax(point, law, discs, constants)
    if model.links.cut not in ("none", "file"):
        links, report = _link(model.links, streams, discs, constants)
        preparation |= report
    contacts, settled = _settle(point, discs, links, contacts, constants, tau)
    preparation |= settled
    if point.cell.boundary == "plates":
        glue(discs, height)
        preparation["glued_discs"] = int((discs.plate != 0).sum())
    return Start(discs, links, contacts, constants, period, preparation)


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


def _relax(
    point: MicrogelPoint, law: laws.Law, discs: Discs, constants: Constants
) -> dict[str, Any]:
    """Bring a packing to friction-free rest: the equilibration before friction and links.

    Random starts overlap deeply, so the bounded linear law comes first, then the study's own.
    """
    rest = point.packing.equilibration
    if rest.max_steps == 0:
        return {}
    unit = force_unit(constants, discs)
    longest = 3 * math.sqrt(discs.mass.min() / (6 * constants.k))
    # What only moving discs feel stays out of it: scenes that differ there share their packings.
    at_rest = constants._replace(
        step_normal=longest,
        step_energy=0.5 * longest,  # energy may err
        step_normal_dashpot=math.inf,
    )
    linear = at_rest._replace(law=(0.0, *constants.law[1:]))
    work, contacts, steps, force = make_work(len(discs.x)), make_pairs(), 0, 0.0
    for stage_law, stage, tolerance in (
        (laws.divergent, linear, 1e-3),
        (law, at_rest, 0.5 * rest.force_tolerance),  # half, as settling adds its own rounding
    ):
        kernels = kernels_for(stage_law, tangential=False)
        contacts, made, force = kernels.relax(
            discs, work, make_pairs(), contacts, stage, tolerance * unit, rest.max_steps
        )
        steps += made
        if not math.isfinite(force):
            msg = "the contact law gave a force that is not a number while the packing was made"
            raise SimulationError(msg)
    return {"relaxation_steps": steps, "relaxed_force": force / unit}


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


def _settle(
    point: MicrogelPoint,
    discs: Discs,
    links: Pairs,
    contacts: Pairs,
    constants: Constants,
    tau: float,
) -> tuple[Pairs, dict[str, Any]]:
    """Let a linked, frictional packing come to rest at zero strain, in damped dynamics."""
    rest = point.packing.equilibration
    kernels = kernels_of(point)
    unit = force_unit(constants, discs)
    energy_unit = unit * 2 * float(discs.radius.mean())
    damped = constants._replace(
        damping=REST_DAMPING / tau, spin_damping=REST_DAMPING / tau, spin_target=0.0
    )
    work = make_work(len(discs.x))
    block = 50
    clock = Clock(0.2 * tau, 0, 0, OSCILLATION, 100, 0.0, block)
    rows = np.empty((2, len(ROW + ENERGIES)))
    steps = 0
    while True:
        contacts, *_ = kernels.run(discs, work, links, contacts, damped, clock, -1, 0, False, rows)
        force = float(np.hypot(work.fx, work.fy).max()) / unit
        turning = float((np.abs(work.torque) / discs.radius).max()) / unit
        speed2 = discs.cx**2 + discs.cy**2
        energy = 0.5 * (discs.mass * speed2 + discs.inertia * discs.spin**2).mean() / energy_unit
        at_rest = max(force, turning) <= rest.force_tolerance and energy <= rest.energy_tolerance
        if at_rest or steps >= rest.max_steps:
            break
        contacts, _, substeps, status = kernels.run(
            discs, work, links, contacts, damped, clock, -1, block, False, rows
        )
        if status != RUNNING:
            msg = "the packing exploded while it came to rest"
            raise SimulationError(msg)
        steps += substeps
    if steps:  # a drift of the whole packing is not motion of the packing
        for velocity in (discs.cx, discs.cy):
            velocity -= (discs.mass * velocity).sum() / discs.mass.sum()
    return contacts, {
        "settling_steps": steps,
        "unbalanced_force": max(force, turning),
        "kinetic_energy": float(energy),
        "at_rest": bool(at_rest),
    }


def compile_kernels(points: Sequence[MicrogelPoint]) -> None:
    """Compile every kernel that ``points`` need: a few steps of a small packing of each kind."""
    # A user's law may never let a packing come to rest.
    rest = Equilibration(max_steps=50)
    small = Packing(discs=20, packing_fraction=1.0, equilibration=rest)
    brief = OscillatoryShear(pre_periods=0, periods=0.02, post_periods=0)
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
