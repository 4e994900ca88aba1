"""Geometry of pictures of shells: their outlines, whole across the edges, and what they feel."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import BAR, CONTACT, Snapshot

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]


class Touches(NamedTuple):
    """The contacts of vertices with what is not their own shell: other shells and walls."""

    shell: IndexArray  # (T,) of the vertex
    at: FloatArray  # (T, 2) place of the vertex, from the centre of its shell
    separation: FloatArray  # (T, 2) from there
    normal: FloatArray  # (T,) force
    kind: NDArray[np.int8]  # (T,) of CONTACT_KINDS


class Shells:
    """The shells of a job, whose vertices are the particles of its snapshots.

    Parameters
    ----------
    first : Snapshot
        Any of the job: bars stay.

    Raises
    ------
    ValueError
        If its bars are not closed shells of all vertices.
    """

    def __init__(self, first: Snapshot) -> None:
        if not is_shells(first):
            msg = "not every vertex has one bar before and one after it"
            raise ValueError(msg)
        bars = first.kind == BAR
        after = dict(zip(first.i[bars].tolist(), first.j[bars].tolist(), strict=True))
        order, start = [], [0]
        for vertex in range(len(first.radius)):
            while vertex in after:
                order.append(vertex)
                vertex = after.pop(vertex)
            if len(order) > start[-1]:
                start.append(len(order))
        self._order, self._start = np.array(order), np.array(start)
        #: Shell (V,) of each vertex.
        self.number = np.empty(len(order), np.int64)
        self.number[self._order] = np.repeat(np.arange(len(start) - 1), np.diff(start))

    def __len__(self) -> int:
        return len(self._start) - 1

    def _places(self, s: Snapshot) -> FloatArray:
        """Return where the vertices (V, 2) are, each shell whole: from bar to bar."""
        bars = s.kind == BAR
        step = np.zeros_like(s.position)
        step[s.i[bars]] = s.separation[bars]
        along = np.cumsum(step[self._order], axis=0) - step[self._order]
        begin = np.repeat(self._start[:-1], np.diff(self._start))
        place = np.empty_like(s.position)
        place[self._order] = s.position[self._order[begin]] + along - along[begin]
        return place

    def _centres(self, place: FloatArray) -> FloatArray:
        return self._sums(place) / np.diff(self._start)[:, None]

    def _sums(self, values: FloatArray) -> FloatArray:
        return _sums(self.number, values, len(self))

    def outlines(self, s: Snapshot) -> list[FloatArray]:
        """Return the vertices (n, 2) of each shell in order, around its centre."""
        place = self._places(s)
        around = (place - self._centres(place)[self.number])[self._order]
        return np.split(around, self._start[1:-1])

    def touches(self, s: Snapshot) -> Touches:
        """Return all contacts of vertices."""
        place, use = self._places(s), s.kind != BAR
        around = place - self._centres(place)[self.number]
        i = s.i[use]
        return Touches(self.number[i], around[i], s.separation[use], s.normal[use], s.kind[use])

    def interfaces(self, s: Snapshot) -> tuple[IndexArray, FloatArray, NDArray[np.int8]]:
        """Return the interfaces of all contacts of vertices: shell, ends around its centre, kind.

        They lie halfway across the gap, and are as long as bars in the mean.
        """
        touches = self.touches(s)
        half = 0.5 * float(np.hypot(*s.separation[s.kind == BAR].T).mean())
        r = touches.separation
        along = half * np.column_stack([-r[:, 1], r[:, 0]]) / np.hypot(*r.T)[:, None]
        middle = touches.at + 0.5 * r
        return touches.shell, np.stack([middle - along, middle + along], axis=1), touches.kind

    def as_discs(self, s: Snapshot) -> Snapshot:
        """Return shells as discs of the same area and motion, with all that is between each two.

        The centre of a disc is the mean of the vertices of its shell, its area has the thickness
        of the shell. The force between two of them is the sum over the contacts of their vertices,
        and its line goes through both centres: so Σ f r / area is the stress of shells in
        equilibrium. What a wall does acts in one place, the mean of its contacts weighted by their
        forces. Contacts of a shell with itself are left out.
        """
        place = self._places(s)
        centre = self._centres(place)
        around = place - centre[self.number]
        size = np.diff(self._start)
        velocity = self._sums(s.velocity) / size[:, None]
        apart = s.velocity - velocity[self.number]
        turning = around[:, 0] * apart[:, 1] - around[:, 1] * apart[:, 0]
        spin = self._sums(turning[:, None]) / self._sums((around**2).sum(axis=1)[:, None])
        half = s.radius[self._order[self._start[:-1]]]
        rings = [around[part] for part in np.split(self._order, self._start[1:-1])]
        area = np.array([_area(*ring.T) for ring in rings])
        girth = np.array([np.hypot(*(np.roll(ring, -1, 0) - ring).T).sum() for ring in rings])
        area += half * girth + np.pi * half**2
        found = self._between(s, place)
        i, j, force = found.i, found.j, found.force
        wall = (j < 0)[:, None]
        to = np.where(wall, found.at, centre[np.maximum(j, 0)] + found.shift)
        separation = to - centre[i]
        normal = separation / np.hypot(*separation.T)[:, None]
        return s._replace(
            position=centre, velocity=velocity, spin=spin[:, 0], radius=np.sqrt(area / np.pi),
            fixed=np.bincount(self.number, s.fixed) == size,
            i=i.astype(np.int32), j=j.astype(np.int32), separation=separation,
            normal=(force * normal).sum(axis=1),
            tangential=force[:, 1] * normal[:, 0] - force[:, 0] * normal[:, 1],
            kind=np.full(len(i), CONTACT, np.int8),
            energy=None if s.energy is None else s.energy[self._order[self._start[:-1]]],
        )  # fmt: skip

    def _between(self, s: Snapshot, place: FloatArray) -> "_Between":
        """Return the sums of forces between each two shells, or a shell and a wall."""
        use = s.kind != BAR
        i, j = self.number[s.i[use]], np.where(s.j[use] >= 0, self.number[s.j[use]], s.j[use])
        meets = place[s.i[use]] + s.separation[use]
        normal = s.separation[use] / np.hypot(*s.separation[use].T)[:, None]
        along = np.column_stack([-normal[:, 1], normal[:, 0]])
        force = s.normal[use, None] * normal + s.tangential[use, None] * along
        image = np.zeros((len(i), 2), np.int64)
        if s.periodic:
            # A contact is with a point of a bar, which is nearer to its vertices than any image.
            away = meets - place[np.maximum(s.j[use], 0)]
            up = np.rint(away[:, 1] / s.height)
            across = np.rint((away[:, 0] - up * s.offset) / s.width)
            image = np.column_stack([across, up]).astype(np.int64)
        back = (image[:, 1] < 0) | ((image[:, 1] == 0) & (image[:, 0] < 0))
        swap = (j >= 0) & ((j < i) | ((j == i) & back))
        sign = np.where(swap, -1, 1)[:, None]
        key = np.column_stack([np.where(swap, j, i), np.where(swap, i, j), sign * image])
        other = (i != j) | image.any(axis=1)
        key, which = np.unique(key[other], axis=0, return_inverse=True)
        which = which.ravel()
        weight = np.maximum(np.hypot(*force[other].T), 1e-300)[:, None]
        at = _sums(which, weight * meets[other], len(key)) / _sums(which, weight, len(key))
        across, up = key[:, 2], key[:, 3]
        shift = np.column_stack([across * s.width + up * s.offset, up * s.height])
        total = _sums(which, (sign * force)[other], len(key))
        return _Between(key[:, 0], key[:, 1], shift, total, at)


class _Between(NamedTuple):
    i: IndexArray  # (C,) shell
    j: IndexArray  # (C,) the same, not smaller, or −1 − w: wall w
    shift: FloatArray  # (C, 2) of the image of j
    force: FloatArray  # (C, 2) on j
    at: FloatArray  # (C, 2) where they touch in the mean


def is_shells(s: Snapshot) -> bool:
    """Whether particles are the vertices of closed shells."""
    bars, count = s.kind == BAR, len(s.radius)
    leave, arrive = (np.bincount(ends[bars], minlength=count) for ends in (s.i, s.j))
    return bool((leave == 1).all() and (arrive == 1).all())


def _sums(which: IndexArray, values: FloatArray, count: int) -> FloatArray:
    """Return the sums (count, d) of the rows of ``values`` (n, d) that have the same number."""
    return np.column_stack([np.bincount(which, column, count) for column in values.T])


def _area(x: FloatArray, y: FloatArray) -> float:
    return 0.5 * abs(float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum()))
