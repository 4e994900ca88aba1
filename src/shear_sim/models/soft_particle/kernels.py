"""Forces of shells and cores on their vertices. Equation numbers are those of the package."""

import numpy as np

from shear_sim.cell import Floats, Ints
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


# The loops below run over all vertices of all chains at once, and put the ends of chains right
# afterwards; each touches few arrays. So the compiler turns them into vector instructions.


@jit
def hinge_angle(sine: float, cosine: float) -> float:
    """Return the angle of a sine and cosine, to round-off for a cosine over −0.9.

    θ = 2 atan(sin θ/(1 + cos θ)), with the rational approximation of the arc tangent of the Cephes
    library (|u| < 0.66) and atan t = π/4 + atan((t − 1)/(t + 1)) beyond: no branches.
    """
    t = np.abs(sine) / (1.0 + cosine)
    far = t > 0.66
    u = (t - 1.0) / (t + 1.0) if far else t
    z = u * u
    top = -8.750608600031904122785e-1
    top = top * z - 1.615753718733365076637e1
    top = top * z - 7.500855792314704667340e1
    top = top * z - 1.228866684490136173410e2
    top = top * z - 6.485021904942025371773e1
    low = z + 2.485846490142306297962e1
    low = low * z + 1.650270098316988542046e2
    low = low * z + 4.328810604912902668951e2
    low = low * z + 4.853903996359136964868e2
    low = low * z + 1.945506571482613964425e2
    half = u + u * z * top / low + (0.25 * np.pi if far else 0.0)
    return float(2.0 * half if sine >= 0.0 else -2.0 * half)


@jit
def _differences(start: Ints, closed: Ints, x: Floats, y: Floats, ex: Floats, ey: Floats) -> None:
    """Write the vectors of all bars; those that are none, after open chains, are (1, 0)."""
    for k in range(x.shape[0] - 1):
        ex[k] = x[k + 1] - x[k]
        ey[k] = y[k + 1] - y[k]
    for p in range(closed.shape[0]):
        first, last = start[p], start[p + 1] - 1
        ex[last] = x[first] - x[last] if closed[p] == 1 else 1.0
        ey[last] = y[first] - y[last] if closed[p] == 1 else 0.0


@jit
def _hinge_angles(
    start: Ints, ex: Floats, ey: Floats, over: Floats, sine: Floats, cosine: Floats
) -> None:
    """Write the angles of all hinges to ``sine``; at the ends of open chains it means nothing."""
    for k in range(1, ex.shape[0]):
        scale = over[k - 1] * over[k]
        sine[k] = (ex[k - 1] * ey[k] - ey[k - 1] * ex[k]) * scale
        cosine[k] = (ex[k - 1] * ex[k] + ey[k - 1] * ey[k]) * scale
    for p in range(start.shape[0] - 1):
        k, i = start[p], start[p + 1] - 1
        scale = over[i] * over[k]
        sine[k] = (ex[i] * ey[k] - ey[i] * ex[k]) * scale
        cosine[k] = (ex[i] * ex[k] + ey[i] * ey[k]) * scale
    folded = 0
    for k in range(ex.shape[0]):
        folded += 1 if cosine[k] < -0.9 else 0
    if folded > 0:
        for k in range(ex.shape[0]):
            if cosine[k] < -0.9:
                sine[k] = np.arctan2(sine[k], cosine[k])
            else:
                sine[k] = hinge_angle(sine[k], cosine[k])
    else:
        for k in range(ex.shape[0]):
            sine[k] = hinge_angle(sine[k], cosine[k])


@jit
def _yield(
    start: Ints, limits: Floats, stiffness: Floats, rest: Floats, before: Floats, now: Floats
) -> float:
    """Bring forces or moments ``now`` (V,) back to the limits of their chains; return the loss.

    Rest lengths or angles move; the loss is the mean of the force before and after, times that.
    """
    loss = 0.0
    for p in range(limits.shape[0]):
        limit = limits[p]
        for k in range(start[p], start[p + 1]):
            if np.abs(now[k]) > limit:
                bound = limit if now[k] > 0.0 else -limit
                flow = (now[k] - bound) / stiffness[k]
                loss += 0.5 * (before[k] + bound) * flow
                rest[k] += flow
                now[k] = bound
    return loss


@jit
def _bar_forces(
    start: Ints,
    closed: Ints,
    pull: Floats,
    moment: Floats,
    ex: Floats,
    ey: Floats,
    over: Floats,
    bx: Floats,
    by: Floats,
    fx: Floats,
    fy: Floats,
) -> None:
    """Write what bars do to their ends, given their pulls and the moments of hinges, to ``f``.

    A bar takes the difference of the moments at its ends as a couple:
    S = T e/ℓ + (M_k − M_j) (−e_y, e_x)/ℓ² on vertex k, −S on vertex j.
    """
    vertices = ex.shape[0]
    for k in range(vertices - 1):
        bx[k] = (pull[k] * ex[k] - (moment[k] - moment[k + 1]) * over[k] * ey[k]) * over[k]
    for k in range(vertices - 1):
        by[k] = (pull[k] * ey[k] + (moment[k] - moment[k + 1]) * over[k] * ex[k]) * over[k]
    for p in range(closed.shape[0]):
        first, k = start[p], start[p + 1] - 1
        twist = (moment[k] - moment[first]) * over[k]
        bx[k] = (pull[k] * ex[k] - twist * ey[k]) * over[k] if closed[p] == 1 else 0.0
        by[k] = (pull[k] * ey[k] + twist * ex[k]) * over[k] if closed[p] == 1 else 0.0
    for k in range(1, vertices):
        fx[k] = bx[k] - bx[k - 1]
        fy[k] = by[k] - by[k - 1]
    for p in range(closed.shape[0]):
        first, last = start[p], start[p + 1] - 1
        fx[first] = bx[first] - bx[last]
        fy[first] = by[first] - by[last]


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
    scratch: tuple[Floats, ...],
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
    scratch : 8 of (V,)
        Room.
    damped : bool
        Whether any chain has dashpots; else ``dx``, ``dy`` are not touched.
    """
    start, closed = chains.start, chains.closed
    ex, ey, over, bx, by = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    one, other, new = scratch[5], scratch[6], scratch[7]
    vertices = x.shape[0]
    stiffness, rest = chains.stretch_stiffness, chains.rest_length
    _differences(start, closed, x, y, ex, ey)
    for k in range(vertices):
        over[k] = 1.0 / np.sqrt(ex[k] * ex[k] + ey[k] * ey[k])
    for k in range(vertices):
        new[k] = stiffness[k] * ((ex[k] * ex[k] + ey[k] * ey[k]) * over[k] - rest[k])
    energy[STRETCH_YIELD] += _yield(
        start, chains.stretch_yield, stiffness, rest, chains.tension, new
    )
    for k in range(vertices):
        chains.tension[k] = new[k]

    stiffness, rest = chains.bend_stiffness, chains.rest_angle
    _hinge_angles(start, ex, ey, over, one, other)
    for k in range(vertices):
        new[k] = stiffness[k] * (one[k] - rest[k])
    energy[BEND_YIELD] += _yield(start, chains.bend_yield, stiffness, rest, chains.moment, new)
    for k in range(vertices):
        chains.moment[k] = new[k]
    _bar_forces(start, closed, chains.tension, chains.moment, ex, ey, over, bx, by, fx, fy)

    for p in range(closed.shape[0]):
        if chains.core_law[p] == HOLLOW:
            continue
        first, end = start[p], start[p + 1]
        area = ring_area(x, y, first, end)
        half = 0.5 * core_pressure(
            chains.core_law[p], chains.core_stiffness[p], chains.core_pressure[p],
            chains.core_area[p], area,
        )  # fmt: skip
        fx[first] += half * (ey[first] + ey[end - 1])
        fy[first] -= half * (ex[first] + ex[end - 1])
        for k in range(first + 1, end):
            fx[k] += half * (ey[k] + ey[k - 1])
            fy[k] -= half * (ex[k] + ex[k - 1])

    if not damped:
        return
    _differences(start, closed, px, py, bx, by)
    for k in range(vertices):
        one[k] = (ex[k] * by[k] - ey[k] * bx[k]) * over[k] * over[k]  # rate of turning
    for k in range(vertices):
        other[k] = (ex[k] * bx[k] + ey[k] * by[k]) * over[k]  # rate of length
    for p in range(closed.shape[0]):
        first, last = start[p], start[p + 1] - 1
        bend, stretch = chains.bend_damping[p], chains.stretch_damping[p]
        new[first] = bend * (one[first] - one[last])
        for k in range(first + 1, last + 1):
            new[k] = bend * (one[k] - one[k - 1])
        for k in range(first, last + 1):
            other[k] *= stretch
        if closed[p] == 0:
            new[first] = new[last] = other[last] = 0.0
    _bar_forces(start, closed, other, new, ex, ey, over, bx, by, dx, dy)
    for p in range(closed.shape[0]):
        if chains.inner_damping[p] > 0.0:
            _damp_inside(chains.inner_damping[p], start[p], start[p + 1], x, y, px, py, dx, dy)


@jit
def _damp_inside(
    damping: float,
    first: int,
    end: int,
    x: Floats,
    y: Floats,
    px: Floats,
    py: Floats,
    dx: Floats,
    dy: Floats,
) -> None:
    """Add a drag on what the vertices first:end move against the rigid motion of all of them.

    So a change of shape is damped, but not a particle that moves or turns: no net force, no torque.
    """
    scale = 1.0 / (end - first)
    mx = my = ux = uy = 0.0
    for k in range(first, end):
        mx += x[k] * scale
        my += y[k] * scale
        ux += px[k] * scale
        uy += py[k] * scale
    turn = square = 0.0
    for k in range(first, end):
        turn += (x[k] - mx) * (py[k] - uy) - (y[k] - my) * (px[k] - ux)
        square += (x[k] - mx) ** 2 + (y[k] - my) ** 2
    spin = turn / square
    for k in range(first, end):
        dx[k] -= damping * (px[k] - ux + spin * (y[k] - my))
        dy[k] -= damping * (py[k] - uy - spin * (x[k] - mx))


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
