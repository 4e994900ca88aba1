"""Geometry of pictures of particles: where they lie, their outlines, interfaces and colours."""

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import CONTACT, LINK, Snapshot
from shear_sim.snapshots import clusters

FloatArray = NDArray[np.float64]

# Tints that letters and lines are seen on; neighbours get different ones.
_TINTS = ("#a6cee3", "#fdd7a5", "#b8dfb1", "#d9c3e4", "#f6bcbc", "#e9e29c", "#b5ddd8", "#dcc4ad")
_LARGE, _SMALL = "#a9c9e2", "#f6d3a8"  # discs that no link holds
_ALIKE = 1.2  # ratio of radii under which they count as equal


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
    half[both & (distance > (ri + rj) * (1 + 1e-9))] = 0.0
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
    limit = room / np.where(np.abs(slope) > 1e-12, slope, 1e-12)
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


def displacement(now: Snapshot, first: Snapshot, strain: float) -> FloatArray:
    """Return how far each particle (N, 2) is from the affine image of its place in ``first``.

    To the nearest image, and beside the mean of all: where the flow stands still is no matter of
    the particles. ``strain`` is what was imposed in between.
    """
    scale = now.height / first.height
    x, y = (first.position * scale).T
    away: FloatArray = now.position - np.column_stack([x + strain * y, y])
    if now.periodic:
        # All but a few have moved alike: about their circular mean no image is far.
        turn = 2 * np.pi * (away[:, 0] - away[:, 1] * now.offset / now.height) / now.width
        away[:, 0] -= np.angle(np.exp(1j * turn).mean()) * now.width / (2 * np.pi)
        up = np.rint(away[:, 1] / now.height)
        away -= np.column_stack([up * now.offset, up * now.height])
        away[:, 0] -= np.rint(away[:, 0] / now.width) * now.width
    away -= away.mean(axis=0)
    return away


def particle_tints(s: Snapshot) -> NDArray[np.str_]:
    """Return tints (N,) of particles: no two clusters that touch have the same, where possible."""
    body = clusters(s)
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


def is_shell(s: Snapshot) -> bool:
    """Whether particles are the vertices of closed shells."""
    links = s.kind == LINK
    degree = np.bincount(np.concatenate([s.i[links], s.j[links]]), minlength=len(s.radius))
    return not s.periodic and bool((degree == 2).all())


def round_trips(s: Snapshot) -> list[list[int]]:
    """Return the vertices of each shell in order."""
    links = s.kind == LINK
    after = dict(zip(s.i[links].tolist(), s.j[links].tolist(), strict=True))
    trips = []
    while after:
        trip = [next(iter(after))]
        while (vertex := after.pop(trip[-1])) != trip[0]:
            trip.append(vertex)
        trips.append(trip)
    return trips


def between_shells(s: Snapshot) -> Snapshot:
    """Return shells as discs of the same area, with the sums of the forces between each two.

    A disc is where the vertices of its shell are in the mean. What a wall does to a shell acts in
    one place, the mean of its contacts weighted by their forces.
    """
    body = clusters(s)
    count = int(body.max()) + 1
    number = np.bincount(body)
    centre = np.column_stack([np.bincount(body, x) / number for x in s.position.T])
    area = np.zeros(count)
    for trip in round_trips(s):
        x, y = s.position[trip].T
        area[body[trip[0]]] = 0.5 * abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()))
    use = (s.kind != LINK) & (s.normal > 0)
    i = body[s.i[use]]
    j = np.where(s.j[use] >= 0, body[s.j[use]], s.j[use])
    swap = (j >= 0) & (j < i)
    i, j = np.where(swap, j, i), np.where(swap, i, j)
    pairs, which = np.unique(np.column_stack([i, j]), axis=0, return_inverse=True)
    which = which.ravel()
    along = s.separation[use] / np.hypot(*s.separation[use].T)[:, None]
    push = s.normal[use, None] * np.where(swap, -1.0, 1.0)[:, None] * along
    force = np.hypot(*(np.bincount(which, each, len(pairs)) for each in push.T))
    meets = s.position[s.i[use]] + s.separation[use]
    share = s.normal[use] / np.bincount(which, s.normal[use])[which]
    at = np.column_stack([np.bincount(which, share * each) for each in meets.T])
    i, j = pairs.T
    to = np.where((j >= 0)[:, None], centre[j], at)
    none = np.zeros(len(pairs))
    return s._replace(
        position=centre, velocity=np.zeros((count, 2)), spin=np.zeros(count),
        radius=np.sqrt(area / np.pi), fixed=np.zeros(count, bool), i=i, j=j,
        separation=to - centre[i], normal=force, tangential=none,
        kind=np.full(len(pairs), CONTACT, np.int8),
    )  # fmt: skip
