"""Geometry of pictures of discs: where they lie, outlines, interfaces, and what colours show."""

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import Snapshot

FloatArray = NDArray[np.float64]

# Tints that letters and lines are seen on; neighbours get different ones.
_TINTS = ("#a6cee3", "#fdd7a5", "#b8dfb1", "#d9c3e4", "#f6bcbc", "#e9e29c", "#b5ddd8", "#dcc4ad")
_LARGE, _SMALL = "#a9c9e2", "#f6d3a8"  # discs that no link holds
_ALIKE = 1.2  # ratio of radii under which they count as equal
_TOUCHING = 1 + 1e-6  # of the sum of two radii, which files keep in 4 bytes


def in_rectangle(s: Snapshot) -> FloatArray:
    """Return the positions (N, 2) within the rectangle, whose upper images are displaced."""
    if not s.periodic:
        return s.position
    x, y = s.position.T
    up = np.floor(y / s.height)
    x, y = x - up * s.offset, y - up * s.height
    return np.column_stack([x - np.floor(x / s.width) * s.width, y])


def interfaces(s: Snapshot) -> FloatArray:
    """Return the ends (C, 2, 2) of all interfaces, from particle i.

    An interface is the chord that two circles share, as far as no third disc has a part in it (a
    face of the power diagram); discs that only touch have a short one, to be seen. Where there is
    none both ends are the same.
    """
    distance = np.hypot(*s.separation.T)
    normal = s.separation / distance[:, None]
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    both = s.j >= 0
    ri = s.radius[s.i]
    rj = np.where(both, s.radius[s.j], 0.0)
    along = np.where(both, (distance**2 + ri**2 - rj**2) / (2 * distance), distance)
    least = 0.2 * np.minimum(ri, np.where(both, rj, ri))
    half = np.maximum(np.sqrt(np.maximum(ri**2 - along**2, 0.0)), least)
    half[both & (distance > _TOUCHING * (ri + rj))] = 0.0
    low, high = -half, half.copy()
    # Both discs of a contact see their other contacts as half-planes that cut the chord.
    ends = np.concatenate([s.i, s.j])
    contact = np.tile(np.arange(len(s.i)), 2)
    face = np.concatenate([normal, -normal])
    reach = np.concatenate([along, distance - along])
    order = np.argsort(ends, kind="stable")
    first = np.searchsorted(ends[order], ends)
    count = np.searchsorted(ends[order], ends, side="right") - first
    one = np.repeat(np.arange(len(ends)), count)
    other = order[
        np.repeat(first, count) + np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
    ]
    use = (contact[one] != contact[other]) & (ends[one] >= 0)
    one, other = one[use], other[use]
    slope = (tangent[contact[one]] * face[other]).sum(axis=1)
    room = reach[other] - reach[one] * (face[one] * face[other]).sum(axis=1)
    slope = np.where(np.abs(slope) > 1e-12, slope, 1e-12)  # parallel faces cut all or nothing
    limit = room / slope
    up = slope > 0
    np.minimum.at(high, contact[one[up]], limit[up])
    np.maximum.at(low, contact[one[~up]], limit[~up])
    low, high = np.minimum(low, high), np.where(low < high, high, np.minimum(low, high))
    middle = normal * along[:, None]
    return np.stack([middle + low[:, None] * tangent, middle + high[:, None] * tangent], axis=1)


def outlines(s: Snapshot, corners: int) -> FloatArray:
    """Return the outlines (N, corners, 2) of discs around their centres, flat at interfaces.

    Two discs that overlap share the chord of their circles.
    """
    angle = 2 * np.pi * np.arange(corners) / corners
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    reach = np.repeat(s.radius[:, None], corners, axis=1)
    distance = np.hypot(*s.separation.T)
    both = s.j >= 0
    deep = both & (distance < 0.9999 * (s.radius[s.i] + np.where(both, s.radius[s.j], 0)))
    i, j, r, d = s.i[deep], s.j[deep], s.separation[deep], distance[deep]
    for one, other, sign in ((i, j, 1.0), (j, i, -1.0)):
        chord = (d**2 + s.radius[one] ** 2 - s.radius[other] ** 2) / (2 * d)
        toward = sign * (r / d[:, None]) @ ray.T
        limit = np.where(toward > 1e-9, chord[:, None] / np.maximum(toward, 1e-9), np.inf)
        np.minimum.at(reach, one, np.maximum(limit, 0.0))
    shaped: FloatArray = reach[:, :, None] * ray
    return shaped


def particle_pressure(s: Snapshot) -> FloatArray:
    """Return the pressure (N,) of each particle: half the trace of its own virial over its area.

    The virial of a contact is shared as its length is, in parts r_i and r_j, so that the areas
    times the pressures sum to the pressure of all contacts times the area of the cell.
    """
    both = s.j >= 0
    ri, rj = s.radius[s.i], np.where(both, s.radius[s.j], 0.0)
    virial = 0.5 * s.normal * np.hypot(*s.separation.T)
    total = np.bincount(s.i, virial * ri / (ri + rj), len(s.radius))
    total += np.bincount(s.j[both], (virial * rj / (ri + rj))[both], len(s.radius))
    pressure: FloatArray = total / (np.pi * s.radius**2)
    return pressure


def displacement(now: Snapshot, first: Snapshot, gradient: FloatArray) -> FloatArray:
    """Return how far each particle (N, 2) is from the affine image of its place in ``first``.

    To the nearest image, and beside the mean of all: where the flow stands still is no matter of
    the particles. ``gradient`` (2, 2) is what was imposed in between: x goes to gradient · x.
    """
    away: FloatArray = now.position - first.position @ gradient.T
    if now.periodic:
        # All but a few have moved alike: about their circular mean no image is far.
        turn = 2 * np.pi * (away[:, 0] - away[:, 1] * now.offset / now.height) / now.width
        away[:, 0] -= np.angle(np.exp(1j * turn).mean()) * now.width / (2 * np.pi)
        up = np.rint(away[:, 1] / now.height)
        away -= np.column_stack([up * now.offset, up * now.height])
        away[:, 0] -= np.rint(away[:, 0] / now.width) * now.width
    away -= away.mean(axis=0)
    return away


def particle_tints(s: Snapshot, body: NDArray[np.int64]) -> NDArray[np.str_]:
    """Return tints (N,) of particles: no two bodies that touch have the same, where possible.

    ``body`` (N,) says which each is of; −1: of none, its tint shows whether it is large or small.
    """
    alone = body < 0
    middle = 0.5 * float(s.radius.min() + s.radius.max())
    large = (s.radius > middle) | (s.radius.max() < _ALIKE * s.radius.min())
    tints = np.where(large, _LARGE, _SMALL)
    numbers, body = np.unique(body, return_inverse=True)
    touching: list[set[int]] = [set() for _ in numbers]
    both = s.j >= 0
    for a, b in zip(body[s.i[both]].tolist(), body[s.j[both]].tolist(), strict=True):
        if a != b:
            touching[a].add(b)
            touching[b].add(a)
    chosen = [-1] * len(numbers)
    used = dict.fromkeys(range(len(_TINTS)), 0)  # how often
    for number in range(len(numbers)):
        taken = {chosen[other] for other in touching[number]}
        free = [k for k in used if k not in taken] or list(used)
        chosen[number] = min(free, key=used.__getitem__)
        used[chosen[number]] += 1
    return np.where(alone, tints, np.array(_TINTS)[chosen][body])
