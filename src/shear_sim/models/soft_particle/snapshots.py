"""What a system of soft particles looks like now: vertices, bars, and what touches what."""

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import BAR, COHESIVE, CONTACT, SLIDING, Snapshot
from shear_sim.models.soft_particle.contacts import corner, side
from shear_sim.models.soft_particle.kernels import core_pressure, ring_area
from shear_sim.models.soft_particle.state import HOLLOW, LAST
from shear_sim.models.soft_particle.system import System

FloatArray = NDArray[np.float64]

STICKS = 1.0 - 1e-9  # of Coulomb's bound: what a sliding contact reaches


class _Contact(NamedTuple):
    """A contact as in :class:`shear_sim.models.interface.Snapshot`."""

    i: int
    j: int
    dx: float
    dy: float
    normal: float
    tangential: float
    kind: int


def take(
    system: System,
    row: int,
    frame: tuple[float, float, float, float],
    planes: FloatArray | None = None,
) -> Snapshot:
    """Return the snapshot of record ``row``.

    Bars bear their tension and the shear force of their moments. Forces are those of
    springs, without dashpots. The contacts of a vertex with a chain are with the vertices that end
    the segments which it faces, their separation ends at the nearest points of these; friction goes
    with the segment that its spring is kept at. A cohesive link is with the nearer end of its
    segment. What they sum to is said in :class:`shear_sim.models.interface.Snapshot`.

    Parameters
    ----------
    system : System
    row : int
        Number of the record.
    frame : (left, bottom, width, height)
        What a picture shows [m].
    planes : (W, 3), optional
        Walls to draw: unit normals and positions; by default those of ``system``.
    """
    chains, motion, walls = system.chains, system.motion, system.walls
    found = (_bars(system), _links(system), _between_chains(system), _with_walls(system))
    rows = np.array([*itertools.chain(*found)])
    i, j, dx, dy, normal, tangential, kind = rows.reshape(-1, len(_Contact._fields)).T
    left, bottom, width, height = frame
    if planes is None:
        planes = np.column_stack([walls.nx, walls.ny, walls.position])
    planes = planes - np.outer(planes[:, :2] @ [left, bottom], [0.0, 0.0, 1.0])
    rigid = np.isin(chains.chain, system.rigid.chain)
    periodic = bool(system.cell.size[1] > 0.0)
    offset = float(system.cell.strain[0] * system.cell.size[1])
    return Snapshot(
        row=row, width=width, height=height, offset=offset, periodic=periodic,
        position=np.column_stack([motion.x - left, motion.y - bottom]),
        velocity=np.column_stack([motion.vx, motion.vy]),
        spin=np.zeros(len(motion.x)),
        radius=chains.radius[chains.chain],
        fixed=(motion.free_x == 0.0) & (motion.free_y == 0.0) & ~rigid,
        i=i.astype(np.int32), j=j.astype(np.int32), separation=np.column_stack([dx, dy]),
        normal=normal.copy(), tangential=tangential.copy(), kind=kind.astype(np.int8),
        walls=planes,
        energy=system.particle_energies()[chains.chain], core=_cores(system),
        mass=chains.mass.copy(),
    )  # fmt: skip


def _cores(system: System) -> FloatArray:
    """Return p A of the core of each ring, shared by its vertices (V,) [N]: Σ f x = Σ f y = p A."""
    chains, motion = system.chains, system.motion
    count = np.diff(chains.start)
    shared = np.zeros(len(count))
    for p in np.flatnonzero(chains.core_law != HOLLOW).tolist():
        area = ring_area(motion.x, motion.y, int(chains.start[p]), int(chains.start[p + 1]))
        pressure = core_pressure(
            int(chains.core_law[p]), float(chains.core_stiffness[p]),
            float(chains.core_pressure[p]), float(chains.core_area[p]), area,
        )  # fmt: skip
        shared[p] = pressure * area / count[p]
    return np.asarray(shared[chains.chain])


def _bars(system: System) -> Iterator[_Contact]:
    chains, motion = system.chains, system.motion
    for k, j in enumerate(chains.after.tolist()):
        if j >= 0:
            dx, dy = float(motion.x[j] - motion.x[k]), float(motion.y[j] - motion.y[k])
            # A bar takes the difference of the moments at its ends as a couple.
            couple = float(chains.moment[k] - chains.moment[j]) / float(np.hypot(dx, dy))
            yield _Contact(k, j, dx, dy, -float(chains.tension[k]), -couple, BAR)


def _links(system: System) -> Iterator[_Contact]:
    chains, motion, links = system.chains, system.motion, system.links
    for q in np.flatnonzero(links.intact).tolist():
        v, k = int(links.vertex[q]), int(links.segment[q])
        after = int(chains.after[k])
        tx, ty = float(motion.x[after] - motion.x[k]), float(motion.y[after] - motion.y[k])
        pull, shear = float(links.pull[q]), float(links.shear[q])
        # On the point of the segment; its own normal and tangent are not those of the end.
        fx, fy = pull * ty + shear * tx, -pull * tx + shear * ty
        j = after if links.share[q] > 0.5 else k
        dx, dy = float(motion.x[j] - motion.x[v]), float(motion.y[j] - motion.y[v])
        over = 1.0 / (math.hypot(tx, ty) * math.hypot(dx, dy))
        normal, along = (fx * dx + fy * dy) * over, (fy * dx - fx * dy) * over
        yield _Contact(v, j, dx, dy, normal, along, COHESIVE)


def _between_chains(system: System) -> Iterator[_Contact]:
    """Yield the contacts of vertices with segments, see (SP.6)."""
    chains, motion, lists, rules = system.chains, system.motion, system.lists, system.rules
    x, y, before, after = motion.x, motion.y, chains.before, chains.after
    springs = system.springs
    listed = (lists.vertex, lists.segment, lists.kind, lists.reach)
    shifts = np.transpose(lists.shift).tolist()
    for v, s, kind, reach, shift in zip(*(each.tolist() for each in listed), shifts, strict=True):
        j = int(after[s])
        at = float(x[v]) - shift[0], float(y[v]) - shift[1]
        overlap, nx, ny, share = side(x, y, *at, s, j, reach, kind)
        found = [(1.0, overlap, nx, ny, j if share > 0.5 else s)]
        found.append((*corner(x, y, *at, int(before[s]), s, j, reach, kind), s))
        if kind == LAST:
            found.append((*corner(x, y, *at, s, j, -1, reach, kind), j))
        # On v, along its tangent, which points against that to j.
        along = float(springs.force[v][springs.segment[v] == s].sum())
        for coefficient, overlap, nx, ny, end in found:
            if coefficient == 0.0 or overlap <= 0.0:
                continue
            push = coefficient * rules.stiffness * overlap
            slides = 0.0 < STICKS * rules.friction * abs(push) <= abs(along)
            away = reach - overlap
            which = SLIDING if slides else CONTACT
            yield _Contact(v, end, -nx * away, -ny * away, push, along, which)
            along = 0.0


def _with_walls(system: System) -> Iterator[_Contact]:
    chains, motion, walls, rules = system.chains, system.motion, system.walls, system.rules
    radius = chains.radius[chains.chain]
    for w in range(len(walls.nx)):
        nx, ny = float(walls.nx[w]), float(walls.ny[w])
        gap = motion.x * nx + motion.y * ny - walls.position[w]
        for v in np.flatnonzero(gap < radius).tolist():
            push = 2.0 * rules.stiffness * float(radius[v] - gap[v])
            along = float(system.springs.wall[w, v])
            slides = 0.0 < STICKS * rules.friction * push <= abs(along)
            away = float(gap[v])
            yield _Contact(
                v, -1 - w, -nx * away, -ny * away, push, along, SLIDING if slides else CONTACT
            )
