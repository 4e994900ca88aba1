"""Small scenes of hard discs, placed by hand or at random."""

import numpy as np

from shear_sim.models import hard_disc
from shear_sim.models.hard_disc.active_set import Drive, Instant
from shear_sim.models.hard_disc.flow import Flow
from shear_sim.models.hard_disc.overlap_free import push_apart
from shear_sim.models.hard_disc.parameters import HardDiscPoint
from shear_sim.streams import Streams


def drive(discs, shear=0.0, compression=0.0, pressure=0.0, velocity=None):
    """``velocity`` (N, 2): ξF of external forces."""
    drift = np.zeros((2, discs)) if velocity is None else np.array(velocity, float).T.copy()
    return Drive(float(shear), float(compression), float(pressure), drift)


def flow(position, radius, side=20.0, mobility=None, offset=0.0, bonds=(), **driven):
    """A flow of discs placed by hand in a square cell."""
    x, y = np.array(position, float).T.copy()
    n = len(x)
    radius = np.broadcast_to(np.asarray(radius, float), n).copy()
    mobility = np.ones(n) if mobility is None else np.asarray(mobility, float)
    bonds = np.asarray(bonds, np.int32).reshape(-1, 2)
    side = float(side)  # for a whole number everything would be compiled again
    return Flow(x, y, radius, mobility, side, side, drive(n, **driven), offset=offset, bonds=bonds)


def packing(discs, packing_fraction, seed=0):
    """Positions (N, 2), radii and side of a random bidisperse packing without overlap."""
    rng = np.random.default_rng(seed)
    mean = np.where(np.arange(discs) < discs // 2, 0.7, 0.5)
    radius = mean * (1 + 0.03 * rng.uniform(-1, 1, discs))
    side = float(np.sqrt(np.pi * (radius**2).sum() / packing_fraction))
    x, y = rng.random((2, discs)) * side
    push_apart(x, y, radius, np.ones(discs, np.int32), side, side, 100_000)
    return np.column_stack([x, y]), radius, side


def packed_flow(discs=32, packing_fraction=0.8, seed=0, **driven):
    position, radius, side = packing(discs, packing_fraction, seed)
    return flow(position, radius, side, **driven)


def overlap(f):
    """The largest overlap of any two discs and images, over the mean diameter."""
    worst = -np.inf
    for a in range(len(f.x)):
        for up in (-1, 0, 1):
            dy = f.y - f.y[a] + up * f.height
            dx = f.x - f.x[a] + up * f.offset
            dx -= np.rint(dx / f.width) * f.width
            d = np.hypot(dx, dy)
            if up == 0:
                d[a] = np.inf
            worst = max(worst, (f.radius + f.radius[a] - d).max())
    return worst / f.unit


def instant(i, j, rx, ry, mobility, drive, permanent=None, area=1.0):
    permanent = np.zeros(len(i), np.int32) if permanent is None else permanent
    return Instant(i, j, rx, ry, np.zeros(len(i)), permanent, mobility, area, drive)


def matrix(now):
    """S (n, 2N): rows −r at i, +r at j."""
    n = len(now.mobility)
    s = np.zeros((len(now.i), 2 * n))
    rows = np.arange(len(now.i))
    for at, sign in ((now.i, -1), (now.j, 1)):
        s[rows, at] += sign * now.rx
        s[rows, n + at] += sign * now.ry
    return s


def dense(now):
    """N and q, written out."""
    s = matrix(now)
    xi = np.tile(now.mobility, 2)
    d = now.drive
    q = d.shear * now.rx * now.ry - d.compression * (now.rx**2 + now.ry**2) + s @ d.drift.ravel()
    return s @ (xi[:, None] * s.T), q, s, xi


def forces(found, now):
    """The forces of an active set on all pairs."""
    phi = np.zeros(len(now.i))
    phi[found.pairs] = found.phi
    return phi


def point(**sections):
    packing = {"discs": 32, "packing_fraction": 0.8} | sections.pop("packing", {})
    model = {"kind": "hard_disc"} | sections.pop("model", {})
    return HardDiscPoint.model_validate({"packing": packing, "model": model, **sections})


def finished(given, block=10_000, seed=3):
    simulation = hard_disc.start(given, Streams(seed, 0))
    while simulation.done < simulation.rows:
        simulation.advance(block)
    return simulation
