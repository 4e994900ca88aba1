"""Kinematics: the imposed strain, the cell, neighbour lists, plates and records.

Nothing here knows the contact law; :mod:`kernels` does. Equation numbers are those of kernels.
"""

import numpy as np

from shear_sim.cell import Floats, turns_of, wrap_count
from shear_sim.compiled import jit
from shear_sim.models.microgel.state import (
    OPEN,
    OSCILLATION,
    REST,
    STEADY,
    Clock,
    Constants,
    Discs,
    Pairs,
    Work,
)
from shear_sim.neighbours import find_pairs


@jit
def segment(clock: Clock, k: int) -> int:
    """Return the segment that the step from k to k + 1 belongs to."""
    if k < clock.begin or k >= clock.end:
        return REST
    return clock.kind


@jit
def strain_at(clock: Clock, kind: int, k: int, fraction: float) -> tuple[float, float]:
    """Return γ and γ̇ at step k + fraction of a step that lies in a segment of this kind.

    The phase is reduced in whole steps, so γ = A sin(2π t/T) is exact however long the run.
    """
    if kind == OSCILLATION:
        phase = 2.0 * np.pi * (((k - clock.begin) % clock.per_period) + fraction) / clock.per_period
        rate = clock.amplitude * 2.0 * np.pi / (clock.per_period * clock.step)
        return clock.amplitude * np.sin(phase), rate * np.cos(phase)
    if kind == STEADY:
        strain = clock.amplitude * ((k - clock.begin) + fraction)
        return strain, clock.amplitude / clock.step
    if k < clock.end:
        return 0.0, 0.0
    # The rest after the shear keeps the strain that the shear has left.
    span = clock.end - clock.begin
    if clock.kind == OSCILLATION:
        left = clock.amplitude * np.sin(2.0 * np.pi * (span % clock.per_period) / clock.per_period)
        return left, 0.0
    return clock.amplitude * span, 0.0


@jit
def peak_rate(clock: Clock, kind: int) -> float:
    """Return the largest |γ̇| of a segment [1/s]."""
    if kind == OSCILLATION:
        return clock.amplitude * 2.0 * np.pi / (clock.per_period * clock.step)
    if kind == STEADY:
        return abs(clock.amplitude) / clock.step
    return 0.0


@jit
def empty_pairs(n: int) -> Pairs:
    """Return ``n`` pairs without discs and without history."""
    return Pairs(
        i=np.empty(n, np.int32), j=np.empty(n, np.int32),
        nx=np.empty(n, np.int32), ny=np.empty(n, np.int32),
        spring=np.zeros(n), spring_back=np.zeros(n),
        ex=np.zeros(n), ey=np.zeros(n), d=np.zeros(n), state=np.zeros(n, np.int32),
    )  # fmt: skip


@jit
def renew_pairs(
    discs: Discs, work: Work, pairs: Pairs, n_links: int, constants: Constants, strain: float
) -> Pairs:
    """Bring discs back into the cell and return a new pair list that keeps links and springs."""
    n = discs.x.shape[0]
    width, height = constants.width, constants.height
    if constants.periodic:
        turns = turns_of(strain, width, height)
        for q in range(pairs.i.shape[0]):
            pairs.nx[q] += pairs.ny[q] * (turns - work.turns[0])
        work.turns[0] = turns
        offset = strain * height - turns * width
        wrap_count(discs.x, discs.y, width, height, offset, work.wx, work.wy)
        for a in range(n):
            discs.x[a] -= work.wx[a] * width + work.wy[a] * offset
            discs.y[a] -= work.wy[a] * height
        for q in range(pairs.i.shape[0]):
            pairs.nx[q] += work.wx[pairs.j[q]] - work.wx[pairs.i[q]]
            pairs.ny[q] += work.wy[pairs.j[q]] - work.wy[pairs.i[q]]
        start, i, j, nx, ny = find_pairs(
            discs.x, discs.y, discs.radius, constants.skin, width, height, offset
        )
    else:
        # A cell so large that no image is near anybody.
        left, low = discs.x.min(), discs.y.min()
        reach = 2.0 * (2.0 * discs.radius.max() + constants.skin)
        start, i, j, nx, ny = find_pairs(
            discs.x - left, discs.y - low, discs.radius, constants.skin,
            discs.x.max() - left + reach, discs.y.max() - low + reach, 0.0,
        )  # fmt: skip
    for a in range(n):
        work.x0[a] = discs.x[a]
        work.y0[a] = discs.y[a]
    work.strain0[0] = strain

    # Linked pairs are not contacts too (through another image they may be). The rest keep their
    # history, found by discs and image; ``source`` is the old number of each new pair, or −1.
    old_j, old_nx, old_ny = pairs.j, pairs.nx, pairs.ny
    source = np.full(i.shape[0], -1, np.int32)
    kept = i.shape[0]
    for q in range(pairs.i.shape[0]):
        if q >= n_links and pairs.state[q] == OPEN:
            continue
        for c in range(start[pairs.i[q]], start[pairs.i[q] + 1]):
            if j[c] == old_j[q] and nx[c] == old_nx[q] and ny[c] == old_ny[q]:
                source[c] = q
                if q < n_links:
                    kept -= 1
                break
    new = empty_pairs(n_links + kept)
    fill = n_links
    for c in range(-n_links, i.shape[0]):
        if c < 0:  # the links come first, in their order
            q = c + n_links
            to = q
        else:
            q = source[c]
            if 0 <= q < n_links:
                continue
            to = fill
            fill += 1
        if q >= 0:
            new.i[to], new.j[to], new.nx[to], new.ny[to] = (
                pairs.i[q],
                old_j[q],
                old_nx[q],
                old_ny[q],
            )
            new.spring[to], new.spring_back[to] = pairs.spring[q], pairs.spring_back[q]
            new.ex[to], new.ey[to], new.d[to] = pairs.ex[q], pairs.ey[q], pairs.d[q]
            new.state[to] = pairs.state[q]
        else:
            new.i[to], new.j[to], new.nx[to], new.ny[to] = i[c], j[c], nx[c], ny[c]
    return new


@jit
def moved(discs: Discs, work: Work, constants: Constants, strain: float) -> float:
    """Return by how much two discs may have approached since the pair list was made [m].

    What counts is the displacement relative to the affine flow, and the flow across one contact.
    The list holds all touching pairs while this is at most the skin. Not a number, or more than
    1000 cells, says that the motion has exploded.
    """
    change = strain - work.strain0[0]
    farthest = 0.0
    total = 0.0
    for a in range(discs.x.shape[0]):
        y = discs.y[a]
        dx = discs.x[a] - work.x0[a] - change * (y - 0.5 * constants.height)
        dy = y - work.y0[a]
        r2 = dx * dx + dy * dy
        farthest = max(farthest, r2)
        total += r2  # max() may lose a NaN
    if not total < (1000.0 * constants.width) ** 2:
        return np.nan
    return float(2.0 * np.sqrt(farthest) + abs(change) * 2.0 * discs.radius.max())


@jit
def accelerate(discs: Discs, work: Work, constants: Constants, rate: float) -> None:
    """Accelerations (M.1) from forces and predicted velocities; glued discs have none."""
    damping = constants.damping
    target = constants.spin_target * rate
    for a in range(discs.x.shape[0]):
        if discs.plate[a] != 0:
            work.ax[a] = 0.0
            work.ay[a] = 0.0
            work.aspin[a] = 0.0
            continue
        work.ax[a] = work.fx[a] / discs.mass[a] - rate * work.py[a] - damping * work.px[a]
        work.ay[a] = work.fy[a] / discs.mass[a] - damping * work.py[a]
        work.aspin[a] = work.torque[a] / discs.inertia[a] - constants.spin_damping * (
            work.pspin[a] - target
        )


@jit
def carry_plates(discs: Discs, work: Work, constants: Constants, rate: float) -> None:
    """Give glued discs the velocity of their plate, ±γ̇ L_y/2, and no rotation."""
    for a in range(discs.x.shape[0]):
        if discs.plate[a] != 0:
            half = 0.5 * constants.height
            discs.cx[a] = rate * (discs.plate[a] * half - (discs.y[a] - half))
            discs.cy[a] = 0.0
            discs.spin[a] = 0.5 * rate
            work.px[a] = discs.cx[a]
            work.py[a] = 0.0
            work.pspin[a] = discs.spin[a]


@jit
def edge_kick(discs: Discs, constants: Constants, change: float) -> None:
    """Take back the affine kick of a rate change: inertia alone, for a cell driven at its edges."""
    for a in range(discs.x.shape[0]):
        if discs.plate[a] == 0:
            y = discs.y[a]
            if constants.periodic:
                y -= np.floor(y / constants.height) * constants.height
            discs.cx[a] -= change * (y - 0.5 * constants.height)
            discs.spin[a] += 0.5 * change


@jit
def finish_row(
    discs: Discs, work: Work, constants: Constants, offset: float, rate: float, row: Floats
) -> None:
    """Fill a record from the sums of ``contact_forces`` and the velocities of this instant."""
    volume = constants.width * constants.height
    tensors = work.tensors
    for c in range(14):
        row[3 + c] = tensors[c] / volume
    torque = 0.0
    kinetic = 0.0
    xx = xy = yy = 0.0
    # Σ F (x − L/2) over free discs: with the external tensor it makes up Love and Weber's (S1-19).
    uxx = uxy = uyx = uyy = 0.0
    for a in range(discs.x.shape[0]):
        if discs.plate[a] != 0:
            continue
        torque += work.torque[a]
        omega = discs.spin[a] - 0.5 * rate
        kinetic += 0.5 * discs.inertia[a] * omega * omega
        m, cx, cy = discs.mass[a], discs.cx[a], discs.cy[a]
        xx += m * cx * cx
        xy += m * cx * cy
        yy += m * cy * cy
        lx = discs.x[a] - work.wx[a] * constants.width - work.wy[a] * offset - 0.5 * constants.width
        ly = discs.y[a] - work.wy[a] * constants.height - 0.5 * constants.height
        uxx += work.fx[a] * lx
        uxy += work.fx[a] * ly
        uyx += work.fy[a] * lx
        uyy += work.fy[a] * ly
    error = max(
        abs(tensors[5] - tensors[10] - uxx), abs(tensors[6] - tensors[11] - uxy),
        abs(tensors[7] - tensors[12] - uyx), abs(tensors[8] - tensors[13] - uyy),
    )  # fmt: skip
    scale = abs(tensors[5]) + abs(tensors[8]) + abs(tensors[10]) + abs(tensors[13])
    if scale > 0.0:
        work.check[0] = max(work.check[0], error / scale)
    row[17] = 0.5 * torque / volume
    row[18] = -kinetic / volume
    row[19] = xx / volume
    row[20] = xy / volume
    row[21] = yy / volume
    row[22] = 2.0 * work.row[0] / discs.x.shape[0]
    row[23] = work.row[1] / max(work.row[0], 1.0)


@jit
def tally(discs: Discs, work: Work, constants: Constants, rate: float, h: float) -> None:
    """Add the last ``h`` seconds to the energy balance (trapezoidal).

    Power put in by the imposed flow: −γ̇ V (σ_xy of the periodic Love–Weber and torque tensors plus
    Σ m c_x c_y / V), less what it does on glued discs. Power lost: in dashpots, by drag on
    velocities and on spins; friction is summed where springs slide.
    """
    tensors, power, energy = work.tensors, work.power, work.energy
    drag = 0.0
    spin_drag = 0.0
    flow = tensors[1] - tensors[4]
    put_in = 0.0
    for a in range(discs.x.shape[0]):
        cx, cy, spin = discs.cx[a], discs.cy[a], discs.spin[a]
        if discs.plate[a] != 0:
            put_in -= work.fx[a] * cx + work.torque[a] * spin
            continue
        m = discs.mass[a]
        flow += m * cx * cy
        drag += constants.damping * m * (cx * cx + cy * cy)
        target = constants.spin_target * rate
        spin_drag += constants.spin_damping * discs.inertia[a] * spin * (spin - target)
    put_in -= rate * flow
    now = (put_in, power[1], power[2], drag, spin_drag)
    before = (power[0], power[5], power[6], power[3], power[4])
    for c in range(5):
        energy[c] += 0.5 * h * (before[c] + now[c])
    power[0], power[3], power[4] = put_in, drag, spin_drag
    power[5], power[6] = power[1], power[2]


@jit
def energy_row(discs: Discs, work: Work, row: Floats) -> None:
    """Append energies per metre of depth [J/m] to a record: kinetic, elastic, then the balance."""
    kinetic = 0.0
    for a in range(discs.x.shape[0]):
        if discs.plate[a] == 0:
            cx, cy, spin = discs.cx[a], discs.cy[a], discs.spin[a]
            kinetic += 0.5 * (discs.mass[a] * (cx * cx + cy * cy) + discs.inertia[a] * spin * spin)
    row[24] = kinetic
    row[25] = work.stored[0]
    for c in range(6):
        row[26 + c] = work.energy[c]
