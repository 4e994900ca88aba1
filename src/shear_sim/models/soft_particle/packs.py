"""Boxes of discs that just touch, and cells of discs that do not: where the rings of packs start.

Lengths are in mean radii.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit
from shear_sim.models.interface import SimulationError
from shear_sim.neighbours import find_pairs

FloatArray = NDArray[np.float64]

TAIL = 2.5  # standard deviations, beyond which no radius lies
DENSE = 0.90  # packing fraction that discs are quenched at before the lid goes up
LOOSE = 1.05  # width of the place of a scattered disc / the largest diameter
SKIN = 0.4
DEEPEST = 1e-3  # overlap of discs that just touch
GENTLE = 1e-6  # largest net force of discs at rest, of a contact of overlap 1
MOST_STEPS = 200_000
STEP = 0.2  # of the relaxation, for springs and masses of 1
STREAK = 5  # steps downhill before a relaxation goes faster
GAP = 0.01  # of two discs in a cell / the sum of their radii


class Box(NamedTuple):
    """Discs in a box of rigid walls, or in a periodic cell, its corner at the origin."""

    x: FloatArray  # (N,)
    y: FloatArray  # (N,)
    radius: FloatArray  # (N,)
    width: float
    height: float


@jit
def _disc_forces(
    x: Floats, y: Floats, radius: Floats, i: Ints, j: Ints, width: float, height: float,
    fx: Floats, fy: Floats,
) -> float:  # fmt: skip
    """Write the forces of springs between discs and at the walls; return the largest overlap."""
    deepest = 0.0
    for k in range(x.shape[0]):
        left, right = max(0.0, radius[k] - x[k]), max(0.0, x[k] + radius[k] - width)
        low, high = max(0.0, radius[k] - y[k]), max(0.0, y[k] + radius[k] - height)
        fx[k], fy[k] = left - right, low - high
        deepest = max(deepest, max(max(left, right), max(low, high)))
    for q in range(i.shape[0]):
        a, b = i[q], j[q]
        dx, dy = x[a] - x[b], y[a] - y[b]
        touch = radius[a] + radius[b]
        square = dx * dx + dy * dy
        if square < touch * touch:
            distance = np.sqrt(square)
            overlap = touch - distance
            deepest = max(deepest, overlap)
            scale = overlap / distance
            fx[a] += scale * dx
            fy[a] += scale * dy
            fx[b] -= scale * dx
            fy[b] -= scale * dy
    return deepest


@jit
def _relax(
    x: Floats, y: Floats, radius: Floats, i: Ints, j: Ints, width: float, height: float,
    vx: Floats, vy: Floats, pace: Floats, room: float, steps: int,
) -> tuple[int, float, float]:  # fmt: skip
    """Move discs downhill (FIRE: Bitzek et al., PRL 97, 170201 (2006)).

    Ends after ``steps``, at rest, or when a disc may have moved by ``room``. ``pace`` (3,) holds
    the step, the mixing of velocities, and the number of steps downhill.

    Returns
    -------
    steps, force, overlap : int, float, float
        Steps made, the largest net force, and the largest overlap.
    """
    n = x.shape[0]
    fx, fy = np.empty(n), np.empty(n)
    moved, largest, deepest = 0.0, 0.0, 0.0
    for step in range(steps):
        deepest = _disc_forces(x, y, radius, i, j, width, height, fx, fy)
        power = force = speed = largest = 0.0
        for k in range(n):
            power += fx[k] * vx[k] + fy[k] * vy[k]
            square = fx[k] * fx[k] + fy[k] * fy[k]
            force += square
            largest = max(largest, square)
            speed += vx[k] * vx[k] + vy[k] * vy[k]
        largest = np.sqrt(largest)
        if largest < GENTLE or moved > room:
            return step, largest, deepest
        if power > 0.0:
            mix = pace[1] * np.sqrt(speed / force)
            for k in range(n):
                vx[k] = (1.0 - pace[1]) * vx[k] + mix * fx[k]
                vy[k] = (1.0 - pace[1]) * vy[k] + mix * fy[k]
            pace[2] += 1.0
            if pace[2] > STREAK:
                pace[0] = min(1.1 * pace[0], 4.0 * STEP)
                pace[1] *= 0.99
        else:
            vx[:] = 0.0
            vy[:] = 0.0
            pace[0], pace[1], pace[2] = 0.5 * pace[0], 0.1, 0.0
        fastest = 0.0
        for k in range(n):
            vx[k] += pace[0] * fx[k]
            vy[k] += pace[0] * fy[k]
            x[k] += pace[0] * vx[k]
            y[k] += pace[0] * vy[k]
            fastest = max(fastest, vx[k] * vx[k] + vy[k] * vy[k])
        moved += pace[0] * np.sqrt(fastest)
    return steps, largest, deepest


def at_rest(x: FloatArray, y: FloatArray, radius: FloatArray, width: float, height: float) -> float:
    """Let discs push each other apart until they are at rest; return the largest overlap.

    Raises
    ------
    SimulationError
        If they never are.
    """
    vx, vy = np.zeros_like(x), np.zeros_like(y)
    pace = np.array([STEP, 0.1, 0.0])
    done = 0
    while done < MOST_STEPS:
        reach = 2.0 * float(radius.max()) + SKIN
        low, left = float(y.min()), float(x.min())
        _, i, j, _, _ = find_pairs(
            x - left, y - low, radius, SKIN, float(np.ptp(x)) + 2 * reach,
            float(np.ptp(y)) + 2 * reach, 0.0, 0, len(x),
        )  # fmt: skip
        steps, force, overlap = _relax(
            x, y, radius, i, j, width, height, vx, vy, pace, 0.5 * SKIN, MOST_STEPS - done
        )
        done += steps
        if force < GENTLE:
            return float(overlap)
    msg = f"{len(x)} discs in a box are not at rest after {done} steps: another seed"
    raise SimulationError(msg)


def _radii(count: int, spread: float, rng: np.random.Generator) -> FloatArray:
    radius = 1.0 + np.clip(rng.normal(0.0, spread, count), -TAIL * spread, TAIL * spread)
    return np.asarray(radius / radius.mean())


def scattered_discs(count: int, spread: float, rng: np.random.Generator) -> Box:
    """Return discs that touch nowhere, in rows, each at random in its place; see `touching_discs`.

    They have the box of `touching_discs`, but a higher one.
    """
    radius = _radii(count, spread, rng)
    width = 2.0 * math.sqrt(count)
    place = 2.0 * float(radius.max()) * LOOSE
    columns = int(width / place)
    row, column = np.divmod(np.arange(count), columns)
    room = np.array([[width / columns], [place]])
    free = 0.5 * (room - 2.0 * radius)
    middle = room * (np.vstack([column, row]) + 0.5)
    x, y = middle + free * rng.uniform(-1.0, 1.0, (2, count))
    return Box(x, y, radius, width, float((y + radius).max()))


def touching_discs(count: int, spread: float, rng: np.random.Generator) -> Box:
    """Return discs at random that just touch, in a box whose width is that of a square one.

    Their radii are normal with standard deviation ``spread``, cut at 2.5 of these, of mean 1. They
    are quenched from random places in a box so low that they overlap, and its lid then goes up
    until they do not any more: so they are as dense as discs without friction get.

    Raises
    ------
    SimulationError
        If the discs do not come to rest.
    """
    radius = _radii(count, spread, rng)
    width = 2.0 * math.sqrt(count)
    height = math.pi * float((radius**2).sum()) / width / DENSE
    x, y = rng.random((2, count)) * np.array([[width], [height]])
    overlap = at_rest(x, y, radius, width, height)
    while overlap > DEEPEST:
        # Overlaps of some layers add up, so a part of each at a time: no step is too far.
        higher = height + max(overlap, 2e-3) * 0.25
        y *= higher / height
        height = higher
        overlap = at_rest(x, y, radius, width, height)
    return Box(x, y, radius, width, float((y + radius).max()))


def loose_discs(count: int, spread: float, fraction: float, rng: np.random.Generator) -> Box:
    """Return discs at random that touch nowhere, in a square periodic cell.

    Parameters
    ----------
    count, spread
        N, and the standard deviation of radii, see `touching_discs`.
    fraction : float
        Packing fraction, well below the densest of a random packing.

    Raises
    ------
    SimulationError
        If no such places are found.
    """
    radius = _radii(count, spread, rng)
    side = math.sqrt(math.pi * float((radius**2).sum()) / fraction)
    swollen = (1.0 + GAP) * radius
    x, y = rng.random((2, count)) * side
    for _ in range(MOST_STEPS):
        x %= side
        y %= side
        _, i, j, nx, ny = find_pairs(x, y, swollen, 0.0, side, side, 0.0, 0, count)
        dx, dy = x[j] - x[i] + side * nx, y[j] - y[i] + side * ny
        distance = np.hypot(dx, dy)
        touch = swollen[i] + swollen[j]
        if (distance > touch / (1.0 + GAP)).all():
            return Box(x, y, radius, side, side)
        push = 0.3 * (touch / distance - 1.0)  # some push a disc at once: not all of it
        for place, apart in ((x, dx), (y, dy)):
            np.add.at(place, j, push * apart)
            np.add.at(place, i, -push * apart)
    msg = f"{count} discs in a cell still overlap after {MOST_STEPS} steps: another seed"
    raise SimulationError(msg)
