"""What shapes of particles mean nothing any more."""

import math

import numpy as np

from shear_sim.cell import Floats
from shear_sim.models.soft_particle.state import Chains

SHARPEST = 0.95 * math.pi  # turning angle of a hinge that counts as folded
SHRUNK, STRETCHED, EMPTY = 0.2, 5.0, 0.02  # lengths / rest length, area / area at the start


def misshapen(chains: Chains, x: Floats, y: Floats) -> str:
    """Return what is wrong with the first particle that is no ring or chain, or nothing."""
    ahead = np.where(chains.after >= 0, chains.after, np.arange(len(x)))
    ex, ey = x[ahead] - x, y[ahead] - y
    long = np.hypot(ex, ey)
    length = long / chains.rest_length
    bars = chains.after >= 0
    wrong = np.flatnonzero(bars & ((length < SHRUNK) | (length > STRETCHED)))
    if len(wrong):
        k = int(wrong[0])
        return (
            f"particle {chains.chain[k]}: a segment has {length[k]:.3g} of its rest length: "
            "a larger stretch stiffness, or less load"
        )
    hinges = bars & (chains.before >= 0)
    back = np.where(hinges, chains.before, 0)
    ax, ay = ex[back], ey[back]
    along = ax * ex + ay * ey
    wrong = np.flatnonzero(hinges & (along < math.cos(SHARPEST) * long[back] * long))
    if len(wrong):
        k = int(wrong[0])
        turn = abs(math.atan2(ax[k] * ey[k] - ay[k] * ex[k], along[k]))
        return (
            f"particle {chains.chain[k]} is folded by {math.degrees(turn):.0f} degrees at a "
            "vertex: more vertices, a larger bending stiffness or bend_yield, or less load"
        )
    first = chains.start[:-1]
    x0, y0 = x[first][chains.chain], y[first][chains.chain]
    twice = np.add.reduceat((x - x0) * (y[ahead] - y0) - (x[ahead] - x0) * (y - y0), first)
    wrong = np.flatnonzero((chains.closed == 1) & (0.5 * twice < EMPTY * chains.core_area))
    if len(wrong):
        p = int(wrong[0])
        share = 0.5 * twice[p] / chains.core_area[p]
        return (
            f"particle {p} has {share:.3g} of its area: a core, a larger bending "
            "stiffness, or less load"
        )
    return ""
