"""Hard discs that flow from event to event: positions, contacts and cell, along a path.

The path is the strain (its length, whichever way it goes) or, without shear, the compression or the
time. One call of `look_ahead` gives the motion up to the next event; the discs move there, the
event changes the contacts, and the gaps of the contacts are set to zero again.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.cell import Floats, Ints, wrap_count
from shear_sim.models.hard_disc.active_set import ActiveSet, Arrested, Drive, Instant, velocities
from shear_sim.models.hard_disc.factor import solve
from shear_sim.models.hard_disc.pairs import Pairs, elimination_order, separations
from shear_sim.models.hard_disc.series import (
    ACCURACY,
    COLLISION,
    OPENING,
    look_ahead,
    travel,
)
from shear_sim.neighbours import find_pairs

SKIN = 0.3  # of the mean radius: candidates reach this much beyond contact
TOUCH = 1e-13  # of the mean diameter: pairs with smaller gaps touch, and collide at minus this
CLOSED = 2e-14  # largest gap of a contact [mean diameter] that needs no correction
MOST_DRIFT = 1e-9  # of the gaps of contacts within a step [mean diameter]
LONGEST_STEP = 0.05  # of path, whatever the accuracy
STALLED = 1e-14  # of path, and of the mean diameter: steps shorter than both make no progress ...
MOST_STALLED = 2000  # ... and so many of them in a row are arrest


class Dense(NamedTuple):
    """The motion from the start of a step, as series in the path (see `series.expand`)."""

    x: Floats
    y: Floats
    width: float
    height: float
    offset: float
    squeezed: float
    shear: float
    pairs: Pairs  # in contact
    phi: Floats
    u: Floats
    kappa: Floats
    area: Floats


class Contacts(NamedTuple):
    """The contacts (n,) at one instant, and the cell with its discs."""

    i: Ints
    j: Ints
    rx: Floats
    ry: Floats
    gap: Floats
    phi: Floats  # forces f/|r|
    kappa: float
    area: float
    squeezed: float
    x: Floats  # (N,)
    y: Floats
    width: float
    height: float
    offset: float


def contacts_at(motion: Dense, t: float) -> Contacts:
    """Return the contacts at ``t`` along a step (dense output)."""
    x, y = motion.x.copy(), motion.y.copy()
    nowhere = np.zeros((2, len(x)))
    squeeze, _ = travel(x, y, nowhere, motion.u, motion.kappa, motion.shear, t)
    area = float(evaluate(motion.area, t))
    scale = math.sqrt(area / motion.area[0])
    offset = (motion.offset + motion.shear * t * motion.height) * scale
    rx, ry, gap = np.empty((3, len(motion.pairs.i)))
    width, height = motion.width * scale, motion.height * scale
    separations(x, y, width, height, offset, *motion.pairs, rx, ry, gap)
    return Contacts(
        motion.pairs.i, motion.pairs.j, rx, ry, gap, evaluate(motion.phi, t),
        float(evaluate(motion.kappa, t)), area, motion.squeezed + squeeze,
        x, y, width, height, offset,
    )  # fmt: skip


Look = Callable[[Dense, float, float], None]


@dataclass
class Counts:
    """What happened so far."""

    steps: int = 0
    collisions: int = 0
    openings: int = 0
    rebuilds: int = 0
    orders: int = 0
    largest_overlap: float = 0.0  # after any step [mean diameter]
    largest_drift: float = 0.0  # gap of a contact before its correction [mean diameter]
    error: float = 0.0  # sum of the last terms of the positions [length]


@dataclass
class Flow:
    """State of N hard discs in a sheared periodic cell.

    Attributes
    ----------
    x, y, radius, mobility : (N,)
        Positions, radii a, mobilities ξ.
    width, height, offset : float
        Cell edges, and displacement of the upper image in x.
    drive : Drive
        Change it with `turn` or `steer`.
    bonds : (B, 2) int
        Pairs of discs in permanent contact: the beads of composite particles, rigid or floppy.
    path : float
        Length of path so far.
    squeezed : float
        ∫κ over the path.

    Raises
    ------
    ValueError
        If discs overlap at the start (immobile ones may), a bond's two do not touch, or nothing can
        move.
    Jammed
        If no forces stop them there.
    """

    x: Floats
    y: Floats
    radius: Floats
    mobility: Floats
    width: float
    height: float
    drive: Drive
    offset: float = 0.0
    bonds: Ints = field(default_factory=lambda: np.zeros((0, 2), np.int32))
    accuracy: float = ACCURACY
    longest_step: float = LONGEST_STEP
    path: float = 0.0
    squeezed: float = 0.0
    counts: Counts = field(default_factory=Counts)
    pairs: Pairs = field(init=False)  # candidates (P,), with their separations and gaps:
    rx: Floats = field(init=False)
    ry: Floats = field(init=False)
    gap: Floats = field(init=False)
    permanent: Ints = field(init=False)
    moved: Floats = field(init=False)  # (2, N) ∫u since the candidates were found
    _spent: float = field(init=False, default=0.0)  # of the skin
    _strained: float = field(init=False, default=0.0)
    _range: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        if not (self.mobility > 0).any():
            msg = "the mobility is zero everywhere: nothing could move"
            raise ValueError(msg)
        self.unit = 2.0 * float(self.radius.mean())
        self.touch = TOUCH * self.unit
        self.skin = SKIN * 0.5 * self.unit
        self.disc_area = math.pi * float((self.radius[self.mobility > 0] ** 2).sum())
        self.set = ActiveSet(0)
        self._stalled = 0
        self._find_candidates()
        if loose := len(self.bonds) - int(self.permanent.sum()):
            msg = f"{loose} bonds join discs that do not touch"
            raise ValueError(msg)
        overlap = -float(self.gap.min(initial=0.0))
        if overlap > 1e-12 * self.unit:
            c = int(self.gap.argmin())
            msg = (
                f"discs {self.pairs.i[c]} and {self.pairs.j[c]} overlap by "
                f"{overlap / self.unit:.3g} mean diameters at the start"
            )
            raise ValueError(msg)
        self.set.start(self.instant(), self.touch)

    @property
    def area(self) -> float:
        """Ω of the cell."""
        return self.width * self.height

    @property
    def packing_fraction(self) -> float:
        """φ of the discs that can move."""
        return self.disc_area / self.area

    def instant(self) -> Instant:
        """Return what the forces depend on now."""
        p = self.pairs
        return Instant(
            p.i, p.j, self.rx, self.ry, self.gap, self.permanent, self.mobility, self.area,
            self.drive,
        )  # fmt: skip

    def contacts(self) -> Contacts:
        """Return the contacts now."""
        c = self.set.pairs
        return Contacts(
            self.pairs.i[c], self.pairs.j[c], self.rx[c], self.ry[c], self.gap[c], self.set.phi,
            self.set.kappa, self.area, self.squeezed,
            self.x, self.y, self.width, self.height, self.offset,
        )  # fmt: skip

    def turn(self, drive: Drive) -> None:
        """Change the drive at once: all forces are new.

        Raises
        ------
        Jammed
            If no forces stop the discs.
        """
        self.drive = drive
        self.set.start(self.instant(), self.touch)

    def steer(self, drive: Drive) -> None:
        """Change the drive a little: most contacts stay.

        Raises
        ------
        Jammed
            If no forces stop the discs.
        """
        self.drive = drive
        self.set.settle(self.instant(), self.touch)

    def advance(self, end: float, look: Look | None = None) -> None:
        """Go on to ``path`` = ``end``.

        Parameters
        ----------
        end : float
            Where to stop; never changes a step, but the last is done in part.
        look : callable, optional
            Called after every step with the motion, the path of its start and its length.

        Raises
        ------
        Jammed
            Where no forces stop the discs; everything is as it was then.
        Arrested
            Where events leave no room for motion.
        """
        while self.path < end:
            self.step(end, look)

    def step(self, end: float, look: Look | None = None) -> None:
        """Go on to the next event, or as far as the series is accurate, but not beyond ``end``."""
        now = self.set
        cap = min(self.longest_step, end - self.path)
        while True:
            order, step, kind, which, reach, error, phi, u, kappa, area = look_ahead(
                self.drive.shear, self.drive.pressure, now.kappa, cap, self.accuracy, now.factor,
                now.pairs, self.permanent[now.pairs], self.mobility, self.drive.drift, self.pairs,
                now.open_pairs, self.rx, self.ry, self.gap, self.area, self.touch,
            )  # fmt: skip
            squeeze = sum(abs(c) * step ** (k + 1) / (k + 1) for k, c in enumerate(kappa.tolist()))
            strained = self._strained + abs(self.drive.shear) * step + squeeze
            approach = (self._spent + reach) * (1.0 + strained) + math.expm1(strained) * self._range
            if approach <= self.skin:
                break
            if self._strained or self._spent:
                self._find_candidates()
            else:
                cap = 0.5 * step
        if look is not None:
            contacts = self.pairs.take(now.pairs)
            motion = Dense(
                self.x.copy(), self.y.copy(), self.width, self.height, self.offset, self.squeezed,
                self.drive.shear, contacts, phi, u, kappa, area,
            )  # fmt: skip
            look(motion, self.path, step)
        self._move(step, u, kappa, area)
        self._strained = strained
        now.phi, now.kappa = evaluate(phi, step), float(evaluate(kappa, step))
        self._count(step, order, kind, error, reach)
        opened = -1
        if kind == OPENING:
            opened = int(now.pairs[which])
            now.drop(which)
        now.settle(
            self.instant(), self.touch,
            solved=kind == COLLISION, opened=opened, stalled=self._stalled,
        )  # fmt: skip
        self._close_gaps()

    def _move(self, step: float, u: Floats, kappa: Floats, area: Floats) -> None:
        """Move discs and cell along the series."""
        squeeze, moved = travel(self.x, self.y, self.moved, u, kappa, self.drive.shear, step)
        self.squeezed += squeeze
        self.path += step
        self._spent = 2.0 * math.sqrt(2.0) * moved
        self.offset += self.drive.shear * step * self.height
        if squeeze:
            self._scale(math.sqrt(float(evaluate(area, step)) / self.area))
        self.separate()

    def _scale(self, factor: float) -> None:
        self.width *= factor
        self.height *= factor
        self.offset *= factor

    def _count(self, step: float, order: int, kind: int, error: float, reach: float) -> None:
        """Keep the books, and give up where nothing moves any more."""
        counts = self.counts
        counts.steps += 1
        counts.orders += order
        counts.collisions += kind == COLLISION
        counts.openings += kind == OPENING
        counts.error += error
        drift = float(np.abs(self.gap[self.set.pairs]).max(initial=0.0)) / self.unit
        counts.largest_drift = max(counts.largest_drift, drift)
        if not drift < MOST_DRIFT:
            msg = f"contacts opened by {drift:.3g} mean diameters within a step"
            raise Arrested(msg)
        if not np.isfinite(self.x).all():
            msg = "the velocities are not finite"
            raise Arrested(msg)
        stalled = max(step, reach / self.unit) < STALLED
        self._stalled = self._stalled + 1 if stalled else 0
        if self._stalled > MOST_STALLED:
            msg = f"{MOST_STALLED} events in a row without motion"
            raise Arrested(msg)

    def _close_gaps(self) -> None:
        """Move discs so that every contact has gap 0 again (Newton on the gaps; paper, eq. 28).

        Close to jamming a tiny gap closes by a long way, over which other discs may overlap: such a
        correction is taken back.
        """
        now = self.set
        for _ in range(3):
            gap = self.gap[now.pairs]
            drift = float(np.abs(gap).max(initial=0.0))
            if drift <= CLOSED * self.unit:
                break
            before = self.x, self.y, float(self.gap.min())
            i, j, rx, ry = self.instant().contacts(now.pairs)
            push = -gap * np.hypot(rx, ry)
            squeeze = solve(now.factor, push, 0.0)
            nothing = np.zeros_like(self.drive.drift)
            move = velocities(i, j, rx, ry, push, self.mobility, nothing)
            self.x = self.x + move[0] - squeeze * self.x
            self.y = self.y + move[1] - squeeze * self.y
            self._scale(1.0 - squeeze)
            self.separate()
            if float(self.gap.min()) < min(before[2], -self.touch) and drift < 5 * self.touch:
                self.x, self.y, _ = before
                self._scale(1.0 / (1.0 - squeeze))
                self.separate()
                break
            self.squeezed += squeeze
        overlap = -float(self.gap.min(initial=np.inf)) / self.unit
        self.counts.largest_overlap = max(self.counts.largest_overlap, overlap)

    def separate(self) -> None:
        """Bring separations and gaps of the candidates up to date."""
        separations(
            self.x, self.y, self.width, self.height, self.offset, *self.pairs,
            self.rx, self.ry, self.gap,
        )  # fmt: skip

    def _find_candidates(self, *, settle: bool = True) -> None:
        """Bring discs back into the cell, and find who is near whom; make forces anew."""
        largest = 2.0 * float(self.radius[self.mobility > 0].max())
        if min(self.width, self.height) < largest + self.skin:
            msg = (
                f"the cell has come to {self.width:.3g} × {self.height:.3g}: its largest disc, of "
                f"diameter {largest:.3g}, could touch its own image"
            )
            raise Arrested(msg)
        turns = round(self.offset / self.width)
        self.offset -= turns * self.width
        wx, wy = np.zeros((2, len(self.x)), np.int32)
        wrap_count(self.x, self.y, self.width, self.height, self.offset, wx, wy)
        self.x -= wx * self.width + wy * self.offset
        self.y -= wy * self.height
        found = find_pairs(
            self.x, self.y, self.radius, self.skin, self.width, self.height, self.offset
        )[1:]
        moving = (self.mobility[found[0]] > 0) | (self.mobility[found[1]] > 0)
        found = found[0][moving], found[1][moving], found[2][moving], found[3][moving]
        order = elimination_order(self.x, self.y, found[0], found[1])
        i, j, nx, ny = (a[order] for a in found)
        contacts = self.set.pairs
        place = np.zeros(0, np.int64)
        if len(contacts):
            old = self.pairs
            a, b = old.i[contacts], old.j[contacts]
            up = old.ny[contacts]
            across = old.nx[contacts] + turns * up + wx[b] - wx[a]
            up = up + wy[b] - wy[a]
            keys = _key(i, j, nx, ny, len(self.x))
            order = np.argsort(keys)
            place = order[np.searchsorted(keys[order], _key(a, b, across, up, len(self.x)))]
        self.pairs = Pairs(i, j, nx, ny, self.radius[i] + self.radius[j])
        self.rx, self.ry, self.gap = np.empty((3, len(i)))
        self.moved = np.zeros((2, len(self.x)))
        self._spent = self._strained = 0.0
        # A pair that comes to touch was at most this far apart, but for some strain of it.
        self._range = 2.0 * float(self.radius.max()) + self.skin
        self.counts.rebuilds += 1
        self.separate()
        ends = np.sort(self.bonds, axis=1)
        bonds = _key(ends[:, 0], ends[:, 1], 0, 0, len(self.x))
        bonded = np.isin(_key(i, j, 0, 0, len(self.x)), bonds)
        self.permanent = (bonded & (self.gap < 1e-9 * self.unit)).astype(np.int32)
        self.set.renumber(place.astype(np.int32), len(i))
        if len(place) and settle:
            self.set.settle(self.instant(), self.touch)


def evaluate(series: Floats, t: float) -> Floats:
    """Return Σ c_k t^k of a series (K + 1, ...)."""
    total: Floats = series[-1]
    for coefficient in series[-2::-1]:
        total = total * t + coefficient
    return total


def _key(i: Ints, j: Ints, nx: Ints | int, ny: Ints | int, n: int) -> NDArray[np.int64]:
    """Return one number for each image of each pair."""
    return ((i.astype(np.int64) * n + j) * 64 + (nx + 32)) * 64 + (ny + 32)
