"""The contact forces at one instant: an active set on the complementarity problem (HD.2).

The set A of contacts has forces φ_A ≥ 0 that keep its pairs at rest relative to each other: the
optimum with the other pairs left out. A touching pair whose discs approach each other is a violated
constraint. It joins A, and the forces go straight towards the solution of the larger set; a contact
whose force vanishes on the way leaves A, which gives a new solution to go to. This is the dual
method of Goldfarb & Idnani (Math. Program. 27 (1983) 1) and the inner loop of Lawson & Hanson's
non-negative least squares. Every move raises the dual objective, so the end is reached, and it is
the only one (appendix A of the paper). If nothing stops the force, the discs are jammed, and the
direction is the proof.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit
from shear_sim.models.hard_disc.factor import Factor, bordered, factorise, solve, triangularise

NEARLY_DEPENDENT = 1e-7  # stiffness, relative to a lone contact's, under which N has lost digits
# ... and under which a contact is dependent: squares of lengths, known to 1e-13 (gaps of contacts).
DEPENDENT = 1e-22
CORNER = 1e-10  # the same for the last contact at fixed pressure, from a difference
NO_CHANGE = 1e-7  # of the largest change of a force: less may be round-off
FORCE_TOLERANCE = 1e-12  # of the mean force: contacts with less may open
PATIENCE = (
    2  # so many times the number of contacts may join at one instant before they go in circles
)
STALLED = 200  # events in a row without motion that are a circle, too
SPEED_TOLERANCE = 1e-11  # of the fastest disc: pairs that approach slower may be contacts or not


class Drive(NamedTuple):
    """What moves the discs, per unit of path."""

    shear: float  # g
    compression: float  # κ, where no pressure is imposed
    pressure: float  # p; 0: none is imposed
    drift: Floats  # (2, N) velocities ξF of the external forces


class Jammed(Exception):  # noqa: N818 - a verdict on a state, caught by who asks for it
    """No force stops a pair: the certificate is a state of positive forces without a load.

    Attributes
    ----------
    pairs : (n,) int
        The contacts that bear the state.
    force : (n,) float
        φ₀ = f₀ / |r|, largest 1, with Sᵀφ₀ = 0 and ⟨φ₀|q⟩ < 0.
    """

    def __init__(self, pairs: Ints, force: Floats) -> None:
        super().__init__("jammed")
        self.pairs = pairs
        self.force = force


class Arrested(Exception):  # noqa: N818 - a verdict on a state, caught by who asks for it
    """The discs cannot go on, but nothing is proved jammed."""


@jit
def make_factor(
    i: Ints, j: Ints, rx: Floats, ry: Floats, mobility: Floats, with_border: bool
) -> Factor:
    """Return the factor of the contact matrix; with a border its last contact is kept out."""
    leading = i.shape[0] - 1 if with_border else i.shape[0]
    begin, row, value, pivot = factorise(leading, i, j, rx, ry, mobility)
    for a in range(leading):
        lone = (mobility[i[a]] + mobility[j[a]]) * (rx[a] * rx[a] + ry[a] * ry[a])
        if not pivot[a] > NEARLY_DEPENDENT * lone:
            value, pivot = triangularise(begin, row, i, j, rx, ry, mobility)
            break
    factor = Factor(begin, row, value, pivot, np.zeros((4, 0)), np.zeros(3))
    return bordered(factor, i, j, rx, ry, mobility) if with_border else factor


@jit
def response(
    factor: Factor, i: Ints, j: Ints, rx: Floats, ry: Floats, mobility: Floats,
) -> tuple[Floats, float]:  # fmt: skip
    """Return how the forces answer a unit force on the last pair given, which is no contact yet.

    Parameters
    ----------
    factor : Factor
        Of the first n pairs.
    i, j, rx, ry : (n + 1,)
        Contacts and the new pair.
    mobility : (N,)
        ξ.

    Returns
    -------
    change : (n,)
        dφ/dφ_c.
    stiffness : float
        dw_c/dφ_c: 0 where c depends on the contacts.
    """
    n = i.shape[0] - 1
    change = np.zeros(n + 1)
    change[n] = 1.0
    kappa = 0.0
    nothing = np.zeros((2, mobility.shape[0]))
    m = rx * rx + ry * ry
    rest = np.empty(n)
    for _ in range(3):  # each time for what round-off left
        u = velocities(i, j, rx, ry, change, mobility, nothing)
        load = 0.0
        for a in range(n):
            rest[a] = kappa * m[a]
            rest[a] -= rx[a] * (u[0, j[a]] - u[0, i[a]]) + ry[a] * (u[1, j[a]] - u[1, i[a]])
            load -= m[a] * change[a]
        if n > 0:
            kappa += solve(factor, rest, load - m[n])
            change[:n] += rest
    u = velocities(i, j, rx, ry, change, mobility, nothing)
    stiffness = 0.0  # as a sum of squares: no difference of what is nearly equal
    for d in range(mobility.shape[0]):
        if mobility[d] > 0.0:
            stiffness += (u[0, d] ** 2 + u[1, d] ** 2) / mobility[d]
    return change[:n], stiffness


@jit
def velocities(
    i: Ints, j: Ints, rx: Floats, ry: Floats, phi: Floats, mobility: Floats, drift: Floats
) -> Floats:
    """Return u (2, N), velocities beside the affine flow (HD.1)."""
    u = drift.copy()
    for c in range(i.shape[0]):
        u[0, i[c]] -= mobility[i[c]] * rx[c] * phi[c]
        u[1, i[c]] -= mobility[i[c]] * ry[c] * phi[c]
        u[0, j[c]] += mobility[j[c]] * rx[c] * phi[c]
        u[1, j[c]] += mobility[j[c]] * ry[c] * phi[c]
    return u


@jit
def most_violated(
    i: Ints, j: Ints, rx: Floats, ry: Floats, gap: Floats, open_pairs: Ints, u: Floats,
    shear: float, kappa: float, touch: float, tolerance: float, overlap: float,
) -> tuple[int, float]:  # fmt: skip
    """Return which of the touching open pairs approaches fastest (−1: none), and its w = r·ṙ.

    Pairs with a gap under ``overlap`` count when they approach at all, others when faster than
    ``tolerance``.
    """
    worst = 0.0
    which = -1
    for c in range(gap.shape[0]):
        if gap[c] > touch or not open_pairs[c]:
            continue
        w = (
            shear * rx[c] * ry[c]
            - kappa * (rx[c] * rx[c] + ry[c] * ry[c])
            + rx[c] * (u[0, j[c]] - u[0, i[c]])
            + ry[c] * (u[1, j[c]] - u[1, i[c]])
        )
        if w < worst and (gap[c] < overlap or w < -tolerance):
            worst = w
            which = c
    return which, worst


@jit
def approach(
    i: Ints, j: Ints, rx: Floats, ry: Floats, u: Floats, shear: float, kappa: float
) -> Floats:
    """Return w = r·ṙ of pairs (n,) whose discs have velocities ``u`` beside the affine flow."""
    w = np.empty(i.shape[0])
    for c in range(i.shape[0]):
        w[c] = (
            shear * rx[c] * ry[c]
            - kappa * (rx[c] * rx[c] + ry[c] * ry[c])
            + rx[c] * (u[0, j[c]] - u[0, i[c]])
            + ry[c] * (u[1, j[c]] - u[1, i[c]])
        )
    return w


class Instant(NamedTuple):
    """What the forces of one instant depend on: the candidate pairs (P,) and the drive."""

    i: Ints
    j: Ints
    rx: Floats
    ry: Floats
    gap: Floats
    permanent: Ints  # 1 where a contact never opens and may pull
    mobility: Floats  # (N,)
    area: float
    drive: Drive

    def contacts(self, pairs: Ints) -> tuple[Ints, Ints, Floats, Floats]:
        """Return i, j, rx, ry of some of the pairs, in the order given."""
        return self.i[pairs], self.j[pairs], self.rx[pairs], self.ry[pairs]


class ActiveSet:
    """Contacts and their forces.

    Attributes
    ----------
    pairs : (n,) int
        Candidates in contact: ascending (the order of elimination), but for the last one at fixed
        pressure, which may be any.
    phi : (n,) float
        Forces f/|r|.
    open_pairs : (P,) int
        1 where there is no contact.
    kappa : float
        Compression per unit of path.
    factor : Factor
        Of the contact matrix of ``pairs``.
    factorisations : int
        How many there were.
    dependent : int
        How often a pair touched and depended on the contacts: forces are then one of many.
    """

    factor: Factor

    def __init__(self, candidates: int) -> None:
        self.pairs: Ints = np.zeros(0, np.int32)
        self.phi: Floats = np.zeros(0)
        self.open_pairs: Ints = np.ones(candidates, np.int32)
        self.kappa = 0.0
        self.factorisations = 0
        self.dependent = 0

    def start(self, now: Instant, touch: float) -> None:
        """Find the forces of an instant of which nothing is known but who touches whom.

        Raises
        ------
        Jammed
            If no forces stop the discs.
        """
        q = approach(*now[:4], now.drive.drift, now.drive.shear, now.drive.compression)
        touching = (now.gap <= touch) & ((q < 0.0) | (now.permanent == 1))
        self.pairs = np.flatnonzero(touching).astype(np.int32)
        self.phi = np.zeros(len(self.pairs))
        self._mark()
        # Any set with forces of the right sign will do to begin with.
        while len(self.pairs):
            forces = self._solution(now)
            if forces is None:
                wrong = np.arange(len(self.pairs)) == self._weakest
            else:
                wrong = (forces <= 0.0) & (now.permanent[self.pairs] == 0)
                self.phi = forces
            if not wrong.any():
                break
            self._keep(~wrong)
        self.settle(now, touch)

    def settle(
        self,
        now: Instant,
        touch: float,
        *,
        solved: bool = False,
        opened: int = -1,
        stalled: int = 0,
    ) -> list[int]:
        """Make the forces those of this instant, from a set and forces near them.

        Parameters
        ----------
        now : Instant
        touch : float
            Gap up to which pairs touch.
        solved : bool
            Whether the forces are those of the set already, so that only new contacts count.
        opened : int
            Pair whose force has just vanished: it stays open unless it clearly approaches.
        stalled : int
            Events in a row without motion.

        Returns
        -------
        Pairs that came into contact and stayed.

        Raises
        ------
        Jammed
            If no forces stop the discs.
        Arrested
            If round-off hides which contacts there are.
        """
        before = self.factorisations
        if not solved:
            self._must_balance(now)
        joined: list[int] = []
        refused = self.open_pairs.copy()
        patience = PATIENCE * (len(self.pairs) + 10)
        overlap = 0.0
        gap = now.gap
        if opened >= 0:  # its gap is 0 but for round-off, and so are its force and speed
            gap = now.gap.copy()
            gap[opened] = max(0.0, gap[opened])
        for tried in range(10 * patience):
            u = self.velocities(now)
            tolerance = 1e-10 + SPEED_TOLERANCE * float(np.abs(u).max())
            circles = max(tried // patience, stalled // STALLED)
            if circles:
                # In crystals contacts depend on each other but for the round-off of their gaps,
                # and which of them bear force is nobody's: only what makes them overlap counts.
                tolerance *= 10.0**circles
                overlap = -touch
            pair, speed = most_violated(
                *now[:4], gap, refused, u, now.drive.shear, self.kappa, touch, tolerance, overlap
            )
            if pair < 0 and self.factorisations > before:
                return joined
            if pair < 0:
                self._must_balance(now)
                continue
            were_open = self.open_pairs.copy()
            if self._add(pair, speed, tolerance, now):
                joined.append(pair)
            # What left on the way may come back; what did not join, depends or does not approach.
            refused = np.where(self.open_pairs != were_open, self.open_pairs, refused)
            refused[pair] = 0
        msg = "no set of contacts keeps all pairs from approaching"
        raise Arrested(msg)

    def drop(self, contact: int) -> None:
        """Take a contact (counted in `pairs`) out of the set."""
        self._keep(np.arange(len(self.pairs)) != contact)

    def velocities(self, now: Instant) -> Floats:
        """Return u (2, N)."""
        return velocities(*now.contacts(self.pairs), self.phi, now.mobility, now.drive.drift)

    def renumber(self, new: Ints, candidates: int) -> None:
        """Take over new candidates: ``new`` (n,) are the numbers of `pairs` among them."""
        order = np.argsort(new)
        self.pairs, self.phi = new[order], self.phi[order]
        self.open_pairs = np.ones(candidates, np.int32)
        self._mark()

    def _mark(self) -> None:
        self.open_pairs[:] = 1
        self.open_pairs[self.pairs] = 0

    def _keep(self, kept: NDArray[np.bool_]) -> None:
        self.pairs, self.phi = self.pairs[kept], self.phi[kept]
        self._mark()

    def _insert(self, pair: int, force: float) -> None:
        place = int(np.searchsorted(self.pairs, pair))
        self.pairs = np.insert(self.pairs, place, pair).astype(np.int32)
        self.phi = np.insert(self.phi, place, force)
        self.open_pairs[pair] = 0

    def _factorise(self, now: Instant) -> float:
        """Factor the matrix of the set; return its least pivot, relative to a lone contact's."""
        self.factorisations += 1
        i, j, rx, ry = now.contacts(self.pairs)
        with_border = now.drive.pressure > 0.0 and len(i) > 0
        self.factor = make_factor(i, j, rx, ry, now.mobility, with_border)
        lone = (now.mobility[i] + now.mobility[j]) * (rx**2 + ry**2)
        pivot = self.factor.pivot / lone[: len(self.factor.pivot)]
        if with_border and pivot.min(initial=1.0) > DEPENDENT and len(i) > 1:
            s, e, m = self.factor.corner
            corner = (s * m + e * e) / (lone[-1] * m)
            pivot = np.append(pivot, corner if corner > CORNER else 0.0)
        if len(pivot) == 0:
            return 1.0
        self._weakest = int(np.argmin(pivot))
        return float(pivot[self._weakest])

    def _solution(self, now: Instant) -> Floats | None:
        """Return forces, of any sign, that keep the set at rest; None if its contacts depend."""
        drive = now.drive
        free = drive.pressure > 0.0 and len(self.pairs) > 0
        least = self._factorise(now)
        if free and least < NEARLY_DEPENDENT:  # with another contact kept out it may be regular
            n, last = len(self.pairs), self._weakest
            order = np.argsort(self.pairs)
            order = np.append(order[order != last], last) if n else order
            self.pairs, self.phi = self.pairs[order], self.phi[order]
            least = self._factorise(now)
        if least < DEPENDENT:
            return None
        contacts = now.contacts(self.pairs)
        self.kappa = 0.0 if free else drive.compression
        forces = np.zeros(len(self.pairs))
        if not len(forces):
            return forces
        moment = contacts[2] ** 2 + contacts[3] ** 2
        for _ in range(2):  # the second time for what round-off left, where N is nearly singular
            u = velocities(*contacts, forces, now.mobility, drive.drift)
            change = -approach(*contacts, u, drive.shear, self.kappa)
            load = 2.0 * drive.pressure * now.area - float(forces @ moment)
            self.kappa += solve(self.factor, change, load)
            forces += change
        return forces

    def _balance(self, now: Instant) -> bool:
        """Go towards the solution of the set; contacts whose force vanishes leave.

        Returns False, at once, if the contacts of the set depend on each other.
        """
        while True:
            target = self._solution(now)
            if target is None:
                return False
            floor = FORCE_TOLERANCE * np.abs(target).sum() / max(len(target), 1)
            wrong = np.flatnonzero((target < -floor) & (now.permanent[self.pairs] == 0))
            if len(wrong) == 0:
                self.phi = target
                return True
            start = np.maximum(self.phi[wrong], 0.0)
            share = start / (start - target[wrong])
            first = int(np.argmin(share))
            self.phi = self.phi + share[first] * (target - self.phi)
            self.drop(int(wrong[first]))

    def _must_balance(self, now: Instant) -> None:
        """Balance, without contacts that have come to depend on others: those hold them too."""
        while not self._balance(now):
            if now.permanent[self.pairs[self._weakest]]:
                msg = "the contacts have come to depend on each other"
                raise Arrested(msg)
            self.dependent += 1
            self.drop(self._weakest)

    def _add(self, pair: int, speed: float, tolerance: float, now: Instant) -> bool:
        """Bring a pair that approaches with w = ``speed`` into the set; tell whether it stayed."""
        pairs, phi = self.pairs, self.phi
        self._insert(pair, 0.0)
        if self._balance(now):
            return not self.open_pairs[pair]
        # The pair depends on the others (or nearly): forces move along the state that they share.
        self.pairs, self.phi = pairs, phi
        self._mark()
        raised = 0.0
        while True:
            self._solution(now)
            those = np.append(self.pairs, pair).astype(np.int32)
            change, stiffness = response(self.factor, *now.contacts(those), now.mobility)
            least = NO_CHANGE * max(1.0, float(np.abs(change).max(initial=0.0)))
            falling = np.flatnonzero((change < -least) & (now.permanent[self.pairs] == 0))
            i, j, rx, ry = now.contacts(those[-1:])
            lone = (now.mobility[i] + now.mobility[j]) * (rx**2 + ry**2)
            if stiffness > DEPENDENT * lone[0] * max(1.0, float((change**2).max(initial=0.0))):
                enough = -speed / stiffness
            elif speed >= -tolerance and raised == 0.0:
                self.dependent += 1
                return False
            else:
                enough = np.inf
            share = self.phi[falling] / -change[falling]
            if not len(falling) and enough == np.inf:
                force = np.append(np.where(np.abs(change) > least, change, 0.0), 1.0)
                raise Jammed(those[force != 0.0], force[force != 0.0])
            step = min(enough, float(share.min(initial=np.inf)))
            self.phi = self.phi + step * change
            raised += step
            speed += step * stiffness
            if step == enough:
                self._insert(pair, raised)
                self._balance(now)
                return True
            self.drop(int(falling[np.argmin(share)]))
            pairs, phi = self.pairs, self.phi
            self._insert(pair, raised)
            if self._balance(now):
                return not self.open_pairs[pair]
            self.pairs, self.phi = pairs, phi
            self._mark()
