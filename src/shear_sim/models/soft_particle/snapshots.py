"""What a system of soft particles looks like now: vertices, bars, and what touches what."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from shear_sim.models.interface import CONTACT, LINK, SLIDING, Snapshot
from shear_sim.models.soft_particle.contacts import corner, side
from shear_sim.models.soft_particle.system import System

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


def take(system: System, row: int, picture: tuple[float, float, float, float]) -> Snapshot:
    """Return the snapshot of record ``row``.

    Bars are links with their tension and the shear force of their moments. Forces are those of
    springs, without dashpots. The contacts of a vertex with a chain are with the vertices that end
    the segments which it faces; friction goes with the deepest of them.

    Parameters
    ----------
    system : System
    row : int
        Number of the record.
    picture : (float, float, float, float)
        Lower left corner, width and height of what a picture shows [m].
    """
    chains, motion, walls = system.chains, system.motion, system.walls
    rows = np.array([*_bars(system), *_between_chains(system), *_with_walls(system)])
    i, j, dx, dy, normal, tangential, kind = rows.reshape(-1, len(_Contact._fields)).T
    left, low, width, height = picture
    planes = np.column_stack(
        [walls.nx, walls.ny, walls.position - left * walls.nx - low * walls.ny]
    )
    return Snapshot(
        row=row, width=width, height=height, offset=0.0, periodic=False,
        position=np.column_stack([motion.x - left, motion.y - low]),
        velocity=np.column_stack([motion.vx, motion.vy]),
        spin=np.zeros(len(motion.x)),
        radius=chains.radius[chains.chain],
        fixed=(motion.free_x == 0.0) & (motion.free_y == 0.0),
        i=i.astype(np.int32), j=j.astype(np.int32), separation=np.column_stack([dx, dy]),
        normal=normal.copy(), tangential=tangential.copy(), kind=kind.astype(np.int8),
        walls=planes,
    )  # fmt: skip


def _bars(system: System) -> Iterator[_Contact]:
    chains, motion = system.chains, system.motion
    for k, j in enumerate(chains.after.tolist()):
        if j >= 0:
            dx, dy = float(motion.x[j] - motion.x[k]), float(motion.y[j] - motion.y[k])
            # A bar takes the difference of the moments at its ends as a couple.
            couple = float(chains.moment[k] - chains.moment[j]) / float(np.hypot(dx, dy))
            yield _Contact(k, j, dx, dy, -float(chains.tension[k]), -couple, LINK)


def _between_chains(system: System) -> Iterator[_Contact]:
    """Yield the contacts of vertices with segments, see (SP.6)."""
    chains, motion, lists, rules = system.chains, system.motion, system.lists, system.rules
    x, y, before, after = motion.x, motion.y, chains.before, chains.after
    start = np.searchsorted(lists.vertex, np.arange(len(x) + 1))
    for v in range(len(x)):
        found = []
        for c in range(start[v], start[v + 1]):
            s, kind = int(lists.segment[c]), int(lists.kind[c])
            j = int(after[s])
            reach = float(chains.radius[chains.chain[v]] + chains.radius[chains.chain[s]])
            overlap, nx, ny, share = side(x, y, v, s, j, reach, kind)
            found.append((1.0, overlap, nx, ny, j if share > 0.5 else s, reach))
            coefficient, overlap, nx, ny = corner(x, y, v, int(before[s]), s, j, reach, kind)
            found.append((coefficient, overlap, nx, ny, s, reach))
            if after[j] < 0:
                coefficient, overlap, nx, ny = corner(x, y, v, s, j, -1, reach, kind)
                found.append((coefficient, overlap, nx, ny, j, reach))
        found = [f for f in found if f[0] * f[1] != 0.0]
        held = system.springs.force[v][system.springs.segment[v] >= 0]
        friction = float(held.sum())  # on v, along its tangent, which points against that to j
        deepest = max(range(len(found)), key=lambda k: found[k][1], default=0)
        for k, (coefficient, overlap, nx, ny, j, reach) in enumerate(found):
            push = coefficient * rules.stiffness * overlap
            along = friction if k == deepest else 0.0
            slides = 0.0 < STICKS * rules.friction * abs(push) <= abs(along)
            away = reach - overlap
            yield _Contact(
                v, j, -nx * away, -ny * away, push, along, SLIDING if slides else CONTACT
            )


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
