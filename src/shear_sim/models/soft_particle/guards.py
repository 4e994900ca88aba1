"""What shapes of particles mean nothing any more, and what makes steps unstable on the way."""

import math

import numpy as np

from shear_sim.cell import Floats
from shear_sim.models.soft_particle.bounds import free_walls, highest_damping, touching, wall_step
from shear_sim.models.soft_particle.stability import at_most, damped_share
from shear_sim.models.soft_particle.state import Chains, Motion, Rules, Walls

SHARPEST = 0.95 * math.pi  # turning angle of a hinge that counts as folded
SHRUNK, STRETCHED, EMPTY = 0.2, 5.0, 0.02  # lengths and area / those at the start


def differences(chains: Chains, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Return where the next vertex of each chain is from each, (V,) [m]; 0 after the last."""
    ahead = np.where(chains.after >= 0, chains.after, np.arange(len(x)))
    return x[ahead] - x, y[ahead] - y


def misshapen(chains: Chains, first_length: Floats, x: Floats, y: Floats) -> str:
    """Return what is wrong with the first particle that is no ring or chain, or nothing.

    ``first_length`` (V,): rest lengths [m] at the start. Those of now move where bars yield.
    """
    ahead = np.where(chains.after >= 0, chains.after, np.arange(len(x)))
    ex, ey = differences(chains, x, y)
    long = np.hypot(ex, ey)
    length = long / first_length
    bars = chains.after >= 0
    wrong = np.flatnonzero(bars & ((length < SHRUNK) | (length > STRETCHED)))
    if len(wrong):
        k = int(wrong[0])
        stronger = (
            "larger yield_force" if np.isfinite(chains.stretch_yield[chains.chain[k]])
            else "larger stretch stiffness"
        )  # fmt: skip
        return (
            f"particle {chains.chain[k]}: a segment has {length[k]:.3g} of its rest length at the "
            f"start: a {stronger}, or less load"
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


def unstable_wall(chains: Chains, motion: Motion, walls: Walls, rules: Rules) -> str:
    """Return what is wrong where a wall is too light for what touches it."""
    for w in free_walls(walls):
        stable = wall_step(chains, motion, walls, rules.stiffness, w)
        if rules.step > stable:
            return (
                f"wall {w} is too light to move by itself with "
                f"{touching(chains, motion, walls, w)} vertices at it: a larger mass, or steps of "
                f"{at_most(stable)} s at most"
            )
    return ""


def unstable_bar(
    chains: Chains, first: Floats, motion: Motion, rules: Rules, stable_step: float
) -> str:
    """Return what is wrong where a bar that has yielded is too short for the step.

    Hinges and their dashpots pull the harder at its ends, as 1/ℓ², see ``stability``. ``first``
    (V,): rest lengths [m] at the start; ``stable_step``: the longest then, without dashpots.
    """
    bars = np.isfinite(chains.stretch_yield[chains.chain]) & (chains.after >= 0)
    k = np.flatnonzero(bars)
    if not k.size:
        return ""
    length = np.hypot(*differences(chains, motion.x, motion.y))[k]
    harder = 16.0 * np.maximum(1.0 / length**2 - 1.0 / first[k] ** 2, 0.0) / chains.mass[k]
    hinges = np.maximum(chains.bend_stiffness[k], chains.bend_stiffness[chains.after[k]])
    squared = (2.0 / stable_step) ** 2 + float((harder * hinges).max())
    rate = highest_damping(chains, rules.drag, 0.0)
    rate += float((harder * chains.bend_damping[chains.chain[k]]).max())
    longest = 2.0 / math.sqrt(squared) * damped_share(squared, rate)
    if rules.step <= longest:
        return ""
    worst = int((harder * hinges).argmax())
    share = length[worst] / first[k[worst]]
    return (
        f"particle {chains.chain[k[worst]]}: a segment that has yielded to {share:.3g} of its "
        f"length at the start needs steps of {at_most(longest)} s at most: a larger "
        "yield_force, less load, or such steps"
    )
