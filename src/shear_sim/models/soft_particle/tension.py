"""A tissue between two grips that part: how it is set up, pulled, and what is measured."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.cell import Ints
from shear_sim.models.interface import Columns, SimulationError
from shear_sim.models.soft_particle.balance import ledger
from shear_sim.models.soft_particle.bodies import Body
from shear_sim.models.soft_particle.driving import Tension
from shear_sim.models.soft_particle.links import energy_at_criterion
from shear_sim.models.soft_particle.packs import touching_discs
from shear_sim.models.soft_particle.parameters import SoftLinks, SoftParticlePoint
from shear_sim.models.soft_particle.rings import body, in_rows, scales, shapes
from shear_sim.models.soft_particle.scenario import Scenario
from shear_sim.models.soft_particle.system import System
from shear_sim.models.soft_particle.tissue import outline, tessellation
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]

NO_GAP = 1e-6  # half thicknesses: a gap that is only rounding
BROKEN_STRESS = 0.2  # of the largest stress: below, the tissue counts as ruptured


class Tissue(NamedTuple):
    """Cells as they are made, in a box with its corner at the origin."""

    bodies: list[Body]
    width: float  # [m]
    height: float
    sides: int  # between two cells


def tissue(point: SoftParticlePoint, rng: np.random.Generator) -> Tissue:
    """Return the cells of discs that just touch; their mean area is that of the mean ring.

    Raises
    ------
    SimulationError
        If there is no room for the shell in a cell.
    """
    model, packing = point.model, point.packing
    box = touching_discs(packing.particles, packing.spread, rng)
    outside = packing.radius * (1.0 + 0.5 * model.thickness)
    scale = outside * math.sqrt(math.pi * packing.particles / (box.width * box.height))
    width, height = scale * box.width, scale * box.height
    inset = 0.5 * model.thickness * packing.radius
    segment = scales(model, packing.vertices, packing.radius).segment
    try:
        cells = tessellation(scale * box.x, scale * box.y, scale * box.radius, width, height, inset)
        outlines = [outline(cell, segment) for cell in cells]
    except ValueError as error:
        raise SimulationError(str(error)) from error
    bodies = [body(model, packing.vertices, packing.radius, points) for points in outlines]
    sides = sum(int((cell.facing >= 0).sum()) for cell in cells) // 2
    return Tissue(in_rows(bodies), width, height, sides)


class Puller(Scenario):
    """The run: the vertices at the floor are held, those at the lid go up at a constant speed."""

    def __init__(self, point: SoftParticlePoint, shear: Tension, streams: Streams) -> None:
        model, packing, links = point.model, point.packing, point.model.links
        assert links is not None  # noqa: S101 - of a tissue, see the validators of the point
        self.unit = scales(model, packing.vertices, packing.radius)
        self.radius, self.modulus = packing.radius, model.young_modulus
        made = tissue(point, streams.generator("discs"))
        self.width, self.sides = made.width, made.sides
        self.system = System(
            made.bodies,
            stiffness=self.unit.stiffness,
            friction=model.friction,
            tangential=model.tangential_ratio * self.unit.stiffness,
            contact_damping=model.contact_damping,
            drag=model.drag * self.unit.mass * self.unit.frequency,
        )
        half = made.bodies[0].radius
        self._link(links, NO_GAP * half)
        motion = self.system.motion
        self.floor = np.flatnonzero(motion.y < half * (1.0 + NO_GAP))
        self.lid = np.flatnonzero(motion.y > made.height - half * (1.0 + NO_GAP))
        self.start = made.height - 2.0 * half
        self.low = half
        rows = point.resolved().record.rows or 0
        self.rows, self.strokes = rows + 1, 1
        way = self.start * math.expm1(shear.strain)
        self.speed = shear.relative_rate * self.start / self.unit.period
        each = way / self.speed / rows
        self.steps = self.divide(each, point.integrator.step)
        self.frame = (0.0, 0.0, self.width, made.height + way)
        # All of it sets out at once: no front runs through the tissue.
        motion.vy[:] = self.speed * (motion.y - self.low) / self.start
        self.system.hold(self.floor, vx=0.0, vy=0.0)
        self.system.hold(self.lid, vx=0.0, vy=self.speed)
        self.system.begin()

    def _link(self, links: SoftLinks, reach: float) -> None:
        unit = self.unit
        force = unit.bending / self.radius**2
        pull = (links.strength or 0.0) * force
        self.system.glue(
            reach,
            normal=links.stiffness * unit.stiffness,
            tangential=links.tangential_stiffness * unit.stiffness,
            strength=(pull, links.shear_strength * pull),
            exponent=links.exponent,
            toughness=(links.toughness or 0.0) * force,
        )
        made = self.system.links
        #: W₀ of a link [J/m]: pulled alone; by the criterion of energies, half of an interface's.
        self.link_energy = (
            0.5 * pull**2 / float(made.law[0])
            if links.toughness is None
            else 0.5 * float(made.law[5]) * float(made.length.mean())
        )

    def go_on(self) -> None:
        """Make the steps from one record to the next."""
        self.system.advance(self.steps)

    def _height(self) -> float:
        return float(self.system.motion.y[self.lid[0]]) - self.low

    def _bears(self, grip: IndexArray) -> float:
        """Return the force [N/m] of what is held by ``grip`` on it, upwards."""
        motion, drag = self.system.motion, self.system.rules.drag
        return float((motion.fy + motion.dy - drag * motion.py)[grip].sum())

    def record(self) -> dict[str, float]:
        """Return one record, see ``columns``."""
        system, links = self.system, self.system.links
        stress = self._bears(self.lid) / self.width
        floor = -self._bears(self.floor) / self.width
        budget = system.budget()
        cells = system.particle_energies()
        _, circularity = shapes(system.chains, system.motion)
        return ledger(budget) | {
            "time": system.time,
            "strain": math.log(self._height() / self.start),
            "stress_yy": stress,
            "stress_floor": floor,
            "stress_yy_per_modulus": stress / self.modulus,
            "stress_yy_per_bending": stress * self.radius**2 / self.unit.hinge,
            "stress_floor_per_modulus": floor / self.modulus,
            "stress_floor_per_bending": floor * self.radius**2 / self.unit.hinge,
            "circularity": circularity,
            "links_broken": float((links.intact == 0).sum()),
            "mean_cell_energy": float(cells.mean()) / self.link_energy,
            "largest_cell_energy": float(cells.max()) / self.link_energy,
            "energy_links": budget.links,
            "work": budget.by_velocities,
            "lost_by_breaking": budget.broken,
            "criterion_energy": float(energy_at_criterion(links).sum()),
        }

    def planes(self) -> FloatArray:
        """Return the grips (2, 3) as walls of a picture."""
        return np.array([[0.0, 1.0, 0.0], [0.0, -1.0, -(self._height() + 2.0 * self.low)]])

    def preparation(self) -> dict[str, float]:
        """Return what is to be said of the start."""
        return {
            "width": self.width,
            "height": self.start,
            "vertices": len(self.system.motion.x),
            "sides": self.sides,
            "links": len(self.system.links.vertex),
            "link_energy": self.link_energy,
        }

    def measured(self, table: Columns) -> dict[str, float]:
        """Return what is kept of a whole run.

        The stress is the mean of both grips, as waves between them push one and pull the other. A
        tissue ruptures where it falls under ``BROKEN_STRESS`` of the largest for the last time; one
        that bears more at the end has no ``rupture_strain``.
        """
        strain, scaled = table["strain"], pulled(table)
        peak = int(scaled.argmax())
        work = float(table["work"].max())
        found = {
            "peak_stress_per_bending": scaled[peak],
            "peak_strain": strain[peak],
            "links_broken": table["links_broken"][-1],
            "energy_missing_ratio": np.abs(table["energy_missing"]).max() / work,
            "drag_ratio": table["lost_by_drag"][-1] / work,
            "kinetic_ratio": table["energy_kinetic"][peak] / table["work"][peak],
        }
        if (torn := ruptured(scaled)) is not None:
            found["rupture_strain"] = strain[torn]
        if table["links_broken"][-1] > 0:
            balance = table["lost_by_breaking"][-1] / table["criterion_energy"][-1]
            found["breaking_error"] = abs(balance - 1.0)
            found["crack_share"], found["crack_span"] = self.crack()
        return {name: float(value) for name, value in found.items()}

    def pieces(self) -> IndexArray:
        """Return the number of the piece, held together by links, of each cell (N,)."""
        links, chain = self.system.links, self.system.chains.chain
        whole = links.intact == 1
        cells = len(self.system.chains.closed)
        return _connected(chain[links.vertex[whole]], chain[links.segment[whole]], cells)

    def crack(self) -> tuple[float, float]:
        """Return the share of the broken links that are of the largest crack, and its span.

        The span is that of the cells along it in x, over the width of the tissue.
        """
        links, chains = self.system.links, self.system.chains
        broken = links.intact == 0
        one, other = chains.chain[links.vertex], chains.chain[links.segment]
        crack = cracks(one, other, broken, len(chains.closed))
        largest = crack == np.bincount(crack[broken]).argmax()
        along = np.isin(chains.chain, [*one[broken & largest], *other[broken & largest]])
        x = self.system.motion.x[along]
        return float(largest[broken].mean()), float(np.ptp(x)) / self.width


def pulled(table: Columns) -> FloatArray:
    """Return the tensile stress σ R²/k_b of each record, the mean of both grips."""
    return -0.5 * (table["stress_yy_per_bending"] + table["stress_floor_per_bending"])


def ruptured(stress: FloatArray) -> int | None:
    """Return the record that a tissue ruptures at, see ``Puller.measured``; None: it does not."""
    bears = np.flatnonzero(stress >= BROKEN_STRESS * stress.max())
    first = int(bears[-1]) + 1 if len(bears) else len(stress)
    return first if first < len(stress) else None


def cracks(one: Ints, other: Ints, broken: NDArray[np.bool_], cells: int) -> IndexArray:
    """Return the number of the crack (L,) that each broken link is of; of others it means nothing.

    Cells that have lost a link, and were linked to each other, are along one crack.

    Parameters
    ----------
    one, other : (L,)
        The two cells of each link.
    broken : (L,)
    cells : int
        Number of all cells.
    """
    torn = np.zeros(cells, np.bool_)
    torn[one[broken]] = torn[other[broken]] = True
    along = torn[one] & torn[other]
    return _connected(one[along], other[along], cells)[one]


def _connected(one: Ints, other: Ints, count: int) -> IndexArray:
    """Return the number of the cluster (N,) of each of ``count`` nodes that edges connect."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(one)), (one, other)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)
