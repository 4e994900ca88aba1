"""What a microgel simulation looks like at the record that it made last."""

import math
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import CONTACT, LINK, SLIDING, Snapshot
from shear_sim.models.microgel import rows
from shear_sim.models.microgel.state import (
    ALL,
    BLOCK_ROWS,
    COUNT,
    FIRST,
    LANES,
    OPEN,
    SLIDE,
    STATE,
    Constants,
    Discs,
    Pairs,
    Springs,
    Work,
)

FloatArray = NDArray[np.float64]


def take(
    row: int,
    strain: float,
    rate: float,
    kernels: ModuleType,
    discs: Discs,
    work: Work,
    links: Pairs,
    contacts: Pairs,
    constants: Constants,
) -> Snapshot:
    """Return the snapshot of record ``row``, made at ``strain`` and strain rate ``rate`` [1/s].

    Forces are those that the stress tensors of the record were summed from, worked out again by
    the same kernel on copies. Only those of contacts that slide by the rule ``sliding: reset`` are
    what the slip has left of them.
    """
    c = constants
    offset = strain * c.height - work.turns[0] * c.width
    free = math.inf
    link = Springs(
        c.link_k, c.link_kt, c.link_eta, c.link_etat,
        c.link_etat if c.stretched_dashpot else 0.0, free, free, free,
    )  # fmt: skip
    contact = Springs(c.k, c.kt, c.eta, c.etat, 0.0, 0.0, 0.0, free if c.may_pull else 0.0)
    parts = [
        _forces(kernels, work, links, ALL, link, c, offset, rate, LINK),
        _forces(kernels, work, contacts, COUNT, contact, c, offset, rate, None),
    ]
    i, j, kind, dx, dy, fx, fy = (np.concatenate(both) for both in zip(*parts, strict=True))
    distance = np.maximum(np.hypot(dx, dy), 1e-300)
    ex, ey = dx / distance, dy / distance
    return Snapshot(
        row=row, width=c.width, height=c.height, offset=float(offset), periodic=c.periodic,
        position=np.column_stack([discs.x, discs.y]),
        velocity=np.column_stack([discs.cx + rate * (discs.y - 0.5 * c.height), discs.cy]),
        spin=discs.spin - 0.5 * rate,
        radius=discs.radius.copy(),
        fixed=discs.plate != 0,
        i=i, j=j, separation=np.column_stack([dx, dy]),
        # The kernel's forces act on i, and positive ones pull.
        normal=-(fx * ex + fy * ey), tangential=-(fy * ex - fx * ey),
        kind=kind, walls=np.zeros((0, 3)), mass=discs.mass.copy(),
    )  # fmt: skip


def _forces(
    kernels: ModuleType,
    work: Work,
    pairs: Pairs,
    count: int,
    springs: Springs,
    constants: Constants,
    offset: float,
    rate: float,
    kind: int | None,
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int8], *tuple[FloatArray, ...]]:
    """Return i, j, kind, separation and force on i of the pairs that act.

    Of each strip the first ``count`` pairs, a column of ``pairs.strips``, are worked out.
    """
    found = np.empty((4, len(pairs.i)))
    acting = np.full(len(pairs.i), OPEN)
    block = np.zeros(BLOCK_ROWS * LANES)
    blocks = [
        (first, min(LANES, end - first))
        for begin, n in pairs.strips[:, [FIRST, count]].tolist()
        for end in (begin + n,)
        for first in range(begin, end, LANES)
    ]
    for first, m in blocks:
        table = pairs.table[first // LANES].copy()
        rows.gather(
            work.disc_rows, pairs.i, pairs.j, first, m, block, kernels.TANGENTIAL, False,
            np.empty(0),
        )  # fmt: skip
        # A step of no length moves no spring.
        kernels.pair_forces(block, table, m, springs, constants, offset, rate, 0.0)
        for row, at in zip(found, (rows.DX, rows.DY, rows.FX, rows.FY), strict=True):
            row[first : first + m] = block[at : at + m]
        acting[first : first + m] = table[STATE : STATE + m]
    use = acting != OPEN
    kinds = (
        np.where(acting == SLIDE, SLIDING, CONTACT) if kind is None else np.full(len(acting), kind)
    )
    i, j = (ends[use].astype(np.int32) for ends in (pairs.i, pairs.j))
    return i, j, kinds[use].astype(np.int8), *(row[use] for row in found)
