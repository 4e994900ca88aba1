"""Forces of shells and cores on their vertices. Equation numbers are those of the package."""

import numpy as np

from shear_sim.cell import Floats
from shear_sim.compiled import jit
from shear_sim.models.soft_particle.state import (
    BEND_YIELD,
    DRAINED,
    ELASTIC,
    GAS,
    HOLLOW,
    STRETCH_YIELD,
    Chains,
)


@jit
def core_pressure(law: int, stiffness: float, rest: float, area0: float, area: float) -> float:
    """Return the pressure [Pa] of a core of ``area`` [m²], Eq. (SP.5)."""
    if law == ELASTIC:
        return rest - stiffness * (area - area0) / area0
    if law == DRAINED:
        return rest
    if law == GAS:
        return rest * area0 / area
    return float(rest - stiffness * np.log(area / area0))


@jit
def core_energy(law: int, stiffness: float, rest: float, area0: float, area: float) -> float:
    """Return the energy [J/m] of a core: −∫p dA from ``area0`` to ``area``."""
    change = area - area0
    if law == ELASTIC:
        return 0.5 * stiffness * change * change / area0 - rest * change
    if law == DRAINED:
        return -rest * change
    if law == GAS:
        return float(-rest * area0 * np.log(area / area0))
    return float(stiffness * (area * np.log(area / area0) - change) - rest * change)


@jit
def ring_area(x: Floats, y: Floats, first: int, end: int) -> float:
    """Return the area [m²] inside the ring of the vertices first:end, counter-clockwise."""
    # Relative to one vertex, so that a ring far from the origin loses no digits.
    x0, y0 = x[first], y[first]
    twice = 0.0
    for k in range(first + 1, end - 1):
        twice += (x[k] - x0) * (y[k + 1] - y0) - (x[k + 1] - x0) * (y[k] - y0)
    return 0.5 * twice


@jit
def shell_forces(
    chains: Chains,
    x: Floats,
    y: Floats,
    px: Floats,
    py: Floats,
    fx: Floats,
    fy: Floats,
    dx: Floats,
    dy: Floats,
    energy: Floats,
    scratch: Floats,
    damped: bool,
) -> None:
    """Write the forces of bars, hinges and cores to ``fx``, ``fy``, of dashpots to ``dx``, ``dy``.

    Lengths and angles beyond the yield values move the rest length and rest angle (return mapping,
    Eqs. (SP.3), (SP.4)); the energy lost by it is added to ``energy``. Tension and moment of the
    step before are read from ``chains``, and those of this instant written there.

    Parameters
    ----------
    x, y, px, py : (V,)
        Positions [m] and predicted velocities [m/s].
    scratch : (6, V)
        Room.
    damped : bool
        Whether any chain has dashpots; else ``dx``, ``dy`` are not touched.
    """
    ex, ey, over = scratch[0], scratch[1], scratch[2]
    turning, stretch_rate, extra = scratch[3], scratch[4], scratch[5]
    for p in range(chains.start.shape[0] - 1):
        first, end = chains.start[p], chains.start[p + 1]
        closed = chains.closed[p] == 1
        bars = end if closed else end - 1  # bars are first:bars
        pressure = 0.0
        if chains.core_law[p] != HOLLOW:
            area = ring_area(x, y, first, end)
            pressure = core_pressure(
                chains.core_law[p], chains.core_stiffness[p], chains.core_pressure[p],
                chains.core_area[p], area,
            )  # fmt: skip

        limit = chains.stretch_yield[p]
        for k in range(first, bars):
            j = k + 1 if k + 1 < end else first
            ex[k] = x[j] - x[k]
            ey[k] = y[j] - y[k]
            square = ex[k] * ex[k] + ey[k] * ey[k]
            length = np.sqrt(square)
            over[k] = 1.0 / length
            tension = chains.stretch_stiffness[k] * (length - chains.rest_length[k])
            if np.abs(tension) > limit:
                flow = (np.abs(tension) - limit) / chains.stretch_stiffness[k]
                if tension < 0.0:
                    flow = -flow
                tension = limit if tension > 0.0 else -limit
                energy[STRETCH_YIELD] += 0.5 * (chains.tension[k] + tension) * flow
                chains.rest_length[k] += flow
            chains.tension[k] = tension

        hinges_from = first if closed else first + 1
        hinges_to = end if closed else end - 1
        limit = chains.bend_yield[p]
        for k in range(hinges_from, hinges_to):
            i = k - 1 if k > first else end - 1
            across = ex[i] * ey[k] - ey[i] * ex[k]
            along = ex[i] * ex[k] + ey[i] * ey[k]
            angle = np.arctan2(across, along)
            moment = chains.bend_stiffness[k] * (angle - chains.rest_angle[k])
            if np.abs(moment) > limit:
                flow = (np.abs(moment) - limit) / chains.bend_stiffness[k]
                if moment < 0.0:
                    flow = -flow
                moment = limit if moment > 0.0 else -limit
                energy[BEND_YIELD] += 0.5 * (chains.moment[k] + moment) * flow
                chains.rest_angle[k] += flow
            chains.moment[k] = moment

        # A bar pulls its ends together and takes the difference of the moments at its ends as a
        # couple: S = T e/ℓ + (M_k − M_j) (−e_y, e_x)/ℓ² on vertex k, −S on vertex j.
        half = 0.5 * pressure
        sx = sy = 0.0  # of the bar before
        if closed:
            k = end - 1
            twist = (chains.moment[k] - chains.moment[first]) * over[k]
            sx = (chains.tension[k] * ex[k] - twist * ey[k]) * over[k] - half * ey[k]
            sy = (chains.tension[k] * ey[k] + twist * ex[k]) * over[k] + half * ex[k]
            for k in range(first, end):
                j = k + 1 if k + 1 < end else first
                twist = (chains.moment[k] - chains.moment[j]) * over[k]
                bx = (chains.tension[k] * ex[k] - twist * ey[k]) * over[k]
                by = (chains.tension[k] * ey[k] + twist * ex[k]) * over[k]
                fx[k] = bx + half * ey[k] - sx
                fy[k] = by - half * ex[k] - sy
                sx = bx - half * ey[k]
                sy = by + half * ex[k]
        else:
            for k in range(first, end - 1):
                twist = (chains.moment[k] - chains.moment[k + 1]) * over[k]
                bx = (chains.tension[k] * ex[k] - twist * ey[k]) * over[k]
                by = (chains.tension[k] * ey[k] + twist * ex[k]) * over[k]
                fx[k] = bx - sx
                fy[k] = by - sy
                sx, sy = bx, by
            fx[end - 1] = -sx
            fy[end - 1] = -sy

        if not damped:
            continue
        for k in range(first, bars):
            j = k + 1 if k + 1 < end else first
            ux, uy = px[j] - px[k], py[j] - py[k]
            turning[k] = (ex[k] * uy - ey[k] * ux) * over[k] * over[k]
            stretch_rate[k] = (ex[k] * ux + ey[k] * uy) * over[k]
        for k in range(first, end):
            extra[k] = 0.0
        for k in range(hinges_from, hinges_to):
            i = k - 1 if k > first else end - 1
            extra[k] = chains.bend_damping[p] * (turning[k] - turning[i])
        for k in range(first, end):
            dx[k] = 0.0
            dy[k] = 0.0
        for k in range(first, bars):
            j = k + 1 if k + 1 < end else first
            pull = chains.stretch_damping[p] * stretch_rate[k]
            twist = (extra[k] - extra[j]) * over[k]
            bx = (pull * ex[k] - twist * ey[k]) * over[k]
            by = (pull * ey[k] + twist * ex[k]) * over[k]
            dx[k] += bx
            dy[k] += by
            dx[j] -= bx
            dy[j] -= by


@jit
def shell_energy(chains: Chains, x: Floats, y: Floats, p: int) -> tuple[float, float, float]:
    """Return the energies [J/m] stored in bars, hinges and core of chain ``p``."""
    first, end = chains.start[p], chains.start[p + 1]
    stretch = bend = core = 0.0
    for k in range(first, end):
        j = chains.after[k]
        i = chains.before[k]
        if j >= 0:
            length = np.hypot(x[j] - x[k], y[j] - y[k])
            stretch += 0.5 * chains.stretch_stiffness[k] * (length - chains.rest_length[k]) ** 2
        if i >= 0 and j >= 0:
            ax, ay, bx, by = x[k] - x[i], y[k] - y[i], x[j] - x[k], y[j] - y[k]
            angle = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
            bend += 0.5 * chains.bend_stiffness[k] * (angle - chains.rest_angle[k]) ** 2
    if chains.core_law[p] != HOLLOW:
        core = core_energy(
            chains.core_law[p], chains.core_stiffness[p], chains.core_pressure[p],
            chains.core_area[p], ring_area(x, y, first, end),
        )  # fmt: skip
    return stretch, bend, core
