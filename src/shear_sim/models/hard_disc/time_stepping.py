"""Time stepping: one convex problem per step of strain instead of one step per event.

For many discs events are too frequent to follow one by one. Here all pairs nearby enter one problem
per step, with gaps that are linear in the step (Maury, Numer. Math. 102 (2006) 649)::

    0 ≤ φ ⊥ w + |r| gap / Δγ ≥ 0,    w = N φ + q                                             (HD.9)

Since n·(r + Δr) ≥ D implies |r + Δr| ≥ D, no step can make discs overlap, however long; forces and
positions are of first order in Δγ.
"""

import math
from dataclasses import dataclass

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.models.hard_disc.active_set import (
    Arrested,
    Instant,
    approach,
    make_factor,
    velocities,
)
from shear_sim.models.hard_disc.factor import back_substitute
from shear_sim.models.hard_disc.flow import Flow

DEPENDENT = 1e-10  # stiffness, relative to a lone contact's, under which a contact is left out
PATIENCE = 10  # rounds of block pivoting without progress before one pair at a time is changed


@dataclass
class Marching(Flow):
    """A flow at fixed area in steps of strain, see `march`.

    Attributes
    ----------
    strain_step : float
        Δγ.
    rounds : int
        Linear systems solved so far.
    """

    strain_step: float = 1e-3
    rounds: int = 0

    def march(self) -> None:
        """Make one step.

        Raises
        ------
        Arrested
            If no velocities avoid all overlaps.
        """
        strained = self._strained + abs(self.drive.shear) * self.strain_step
        if self._spent + strained * self._range > 0.7 * self.skin:
            self._find_candidates(settle=False)
        now = self.instant()
        r = np.hypot(self.rx, self.ry)
        pairs, phi = self._balance(now, r * self.gap / self.strain_step)
        contacts = now.contacts(pairs)
        u = velocities(*contacts, phi, self.mobility, self.drive.drift)
        h = self.strain_step
        self.set.pairs, self.set.phi = pairs, phi
        self.x += h * (self.drive.shear * self.y + u[0])
        self.y += h * u[1]
        self.offset += self.drive.shear * h * self.height
        self.moved += h * u
        self._spent = 2.0 * math.sqrt(2.0) * float(np.abs(self.moved).max())
        self._strained += abs(self.drive.shear) * h
        self.path += h
        self.counts.steps += 1
        self.separate()
        overlap = -float(self.gap.min(initial=np.inf)) / self.unit
        self.counts.largest_overlap = max(self.counts.largest_overlap, overlap)

    def _balance(self, now: Instant, slack: Floats) -> tuple[Ints, Floats]:
        """Solve (HD.9) by block principal pivoting (Júdice & Pires), from the last contacts on."""
        inside = np.zeros(len(now.i), bool)
        inside[self.set.pairs] = True
        fewest, patience = len(inside) + 1, PATIENCE
        for _ in range(1000):
            pairs = np.flatnonzero(inside).astype(np.int32)
            contacts = now.contacts(pairs)
            i, j, rx, ry = contacts
            factor = make_factor(*contacts, now.mobility, False)
            self.rounds += 1
            lone = (now.mobility[i] + now.mobility[j]) * (rx**2 + ry**2)
            dependent = factor.pivot < DEPENDENT * lone
            if dependent.any():
                inside[pairs[dependent]] = False
                continue
            drive = now.drive
            phi = -approach(*contacts, drive.drift, drive.shear, 0.0) - slack[pairs]
            back_substitute(factor, phi)
            u = velocities(*contacts, phi, now.mobility, drive.drift)
            w = approach(*now[:4], u, drive.shear, 0.0) + slack
            tolerance = 1e-10 + 1e-12 * float(np.abs(u).max())
            wrong = (w < -tolerance) & ~inside
            wrong[pairs] = phi < -1e-12 * np.abs(phi).max(initial=0.0)
            count = int(wrong.sum())
            if count == 0:
                return pairs, np.maximum(phi, 0.0)
            if count < fewest:
                fewest, patience = count, PATIENCE
            else:
                patience -= 1
            if patience < 0:  # Murty's rule, which always ends
                wrong[: np.flatnonzero(wrong)[-1]] = False
            inside ^= wrong
        msg = "no velocities without overlap were found"
        raise Arrested(msg)
