"""Bounds on frequencies and steps of chains and walls as they are now, see ``stability``."""

import itertools
import math

import numpy as np

from shear_sim.cell import Floats
from shear_sim.models.soft_particle.stability import (
    damped_share,
    damping_rate,
    squared_frequency,
    squared_wall_frequency,
)
from shear_sim.models.soft_particle.state import DRAINED, GAS, HOLLOW, Chains, Motion, Walls


def highest_frequency(chains: Chains, x: Floats, y: Floats, stiffness: float) -> float:
    """Return a bound ω [1/s] on all frequencies, the largest of all chains, see ``stability``."""
    every = range(len(chains.closed))
    return max(frequency_of(chains, p, x, y, stiffness) for p in every)


def frequency_of(chains: Chains, p: int, x: Floats, y: Floats, stiffness: float) -> float:
    """Return the bound ω [1/s] of chain ``p``."""
    part = slice(chains.start[p], chains.start[p + 1])
    core = 0.0
    if chains.core_law[p] != HOLLOW:
        px, py = x[part], y[part]
        slope = 0.25 * (
            (np.roll(px, -1) - np.roll(px, 1)) ** 2 + (np.roll(py, -1) - np.roll(py, 1)) ** 2
        )
        rest = abs(float(chains.core_pressure[p]))
        if chains.core_law[p] == GAS:
            modulus = rest
        elif chains.core_law[p] == DRAINED:
            modulus = 0.0
        else:
            modulus = float(chains.core_stiffness[p])
        core = modulus / float(chains.core_area[p]) * float(slope.sum()) + rest
    squared = squared_frequency(
        float(chains.stretch_stiffness[part].max()), float(chains.bend_stiffness[part].max()),
        float(chains.rest_length[part].min()), stiffness, core, float(chains.mass[part].min()),
    )  # fmt: skip
    return math.sqrt(squared)


def highest_damping(chains: Chains, drag: float, contact: float) -> float:
    """Return a bound Γ [1/s] on the rates of all dashpots, the largest of all chains.

    ``contact``: k_n β h of the deepest contact [N s/m²].
    """
    return max(
        damping_rate(
            float(chains.stretch_damping[p]), float(chains.bend_damping[p]),
            float(chains.rest_length[first:end].min()), contact,
            drag + float(chains.inner_damping[p]), float(chains.mass[first:end].min()),
        )
        for p, (first, end) in enumerate(itertools.pairwise(chains.start))
    )  # fmt: skip


def free_walls(walls: Walls) -> list[int]:
    """Return the walls that move by themselves."""
    return list(map(int, np.flatnonzero(walls.mass)))


def touching(chains: Chains, m: Motion, walls: Walls, w: int) -> int:
    """Return how many vertices touch wall ``w`` now."""
    height = m.x * walls.nx[w] + m.y * walls.ny[w] - walls.position[w]
    return int((height < chains.radius[chains.chain]).sum())


def wall_step(chains: Chains, m: Motion, walls: Walls, stiffness: float, w: int) -> float:
    """Return the longest step [s] that is stable with wall ``w`` and what touches it now."""
    mass = float(walls.mass[w])
    squared = squared_wall_frequency(stiffness, max(1, touching(chains, m, walls, w)), mass)
    rate = float(walls.damping[w]) / mass
    return 2.0 / math.sqrt(squared) * damped_share(squared, rate)
