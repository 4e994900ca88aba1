"""Kinematics: the imposed strain, the cell, neighbour lists, plates and records.

Nothing here knows the contact law; :mod:`kernels` does. Equation numbers are those of kernels.
"""

import numpy as np
from numpy.typing import NDArray

from shear_sim.cell import Floats, Ints, image_of, turns_of
from shear_sim.compiled import jit
from shear_sim.models.microgel.state import (
    ALL,
    COUNT,
    EX,
    FIRST,
    LANES,
    NEAR,
    NX,
    NY,
    OPEN,
    OSCILLATION,
    PAIR_ROWS,
    PER_SUM,
    PERIOD,
    REST,
    STATE,
    STEADY,
    SUM,
    WITHIN,
    Clock,
    Constants,
    Discs,
    Pairs,
    Work,
)
from shear_sim.neighbours import find_pairs
from shear_sim.threads import add_up, bits, largest_of, meet, number

# Columns of Work.extremes
FARTHEST, FASTEST, CLOSEST_OF, LONGEST_OF, CLOSING_OF = range(5)


@jit(_nrt=False)
def segment(clock: Clock, k: int) -> int:
    """Return the segment that the step from k to k + 1 belongs to."""
    if k < clock.begin or k >= clock.end:
        return REST
    return clock.kind


@jit(_nrt=False)
def strain_at(clock: Clock, kind: int, k: int, fraction: float) -> tuple[float, float]:
    """Return γ and γ̇ at step k + fraction of a step that lies in a segment of this kind.

    The phase is reduced in whole steps, so γ = A sin(2π t/T) is exact however long the run, and a
    step ends exactly where the next one begins.
    """
    whole = int(fraction)
    k, fraction = k + whole, fraction - whole
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


@jit(_nrt=False)
def peak_rate(clock: Clock, kind: int) -> float:
    """Return the largest |γ̇| of a segment [1/s]."""
    if kind == OSCILLATION:
        return clock.amplitude * 2.0 * np.pi / (clock.per_period * clock.step)
    if kind == STEADY:
        return abs(clock.amplitude) / clock.step
    return 0.0


@jit
def whole_list(n: int) -> NDArray[np.int64]:
    """Return ``Pairs.strips`` of ``n`` pairs that all belong to one strip and all may act."""
    strips = np.zeros((1, ALL + 1), np.int64)
    for c in range(COUNT, ALL + 1):
        strips[0, c] = n
    return strips


@jit
def empty_pairs(n: int) -> Pairs:
    """Return ``n`` pairs of one strip, without discs and without history."""
    blocks = (n + LANES - 1) // LANES
    numbers = blocks * PAIR_ROWS * LANES
    raw = np.zeros(numbers + PERIOD // 8)
    first = -raw.ctypes.data % PERIOD // 8
    table = raw[first : first + numbers].reshape((blocks, PAIR_ROWS * LANES))
    return Pairs(np.zeros(n, np.uint32), np.zeros(n, np.uint32), table, whole_list(n))


@jit(inner=True)
def add_scaled(to: Floats, factor: float, values: Floats, begin: np.uint64, end: np.uint64) -> None:
    """Add ``factor`` × ``values`` to ``to``, of discs ``begin`` to before ``end``; arrays (N,)."""
    for a in range(begin, end):
        to[a] += factor * values[a]


@jit(inner=True)
def kick(
    velocity: Floats, predicted: Floats, acceleration: Floats, h: float, lead: float,
    begin: np.uint64, end: np.uint64,
) -> None:  # fmt: skip
    """Kick velocities for ``h`` seconds and predict them ``lead`` seconds later; arrays (N,)."""
    for a in range(begin, end):
        velocity[a] += h * acceleration[a]
        predicted[a] = velocity[a] + lead * acceleration[a]


@jit(inner=True)
def drift(
    discs: Discs, work: Work, constants: Constants, h: float, change: float, rate: float
) -> None:
    """Move discs by ``h`` seconds, in which the strain changes by ``change`` and ends at ``rate``.

    Loops that write one array, or two, are the ones that the compiler turns into vectors.
    """
    x, y, cx, cy, turn, spin = discs.x, discs.y, discs.cx, discs.cy, work.turn, discs.spin
    height = constants.height
    for a in range(work.begin, work.end):
        x[a] += h * cx[a] + change * (y[a] + 0.5 * h * cy[a] - 0.5 * height)
    if constants.plates:
        for a in range(work.begin, work.end):
            if discs.plate[a] != 0.0:  # goes with its plate instead
                x[a] += change * (discs.plate[a] * 0.5 * height - (y[a] - 0.5 * height))
                x[a] -= h * cx[a]
    for a in range(work.begin, work.end):
        y[a] += h * cy[a]
        turn[a] = h * spin[a] - 0.5 * change
    carry_plates(discs, work, constants, rate)


@jit(inner=True)
def find_in(start: Ints, j: Ints, nx: Ints, ny: Ints, pairs: Pairs, q: int) -> int:
    """Return the place of pair ``q`` in the list of `find_pairs`, or −1."""
    table, lane = pairs.table[q // LANES], q % LANES
    a = pairs.i[q]
    for c in range(start[a], start[a + 1]):
        if j[c] == pairs.j[q] and nx[c] == table[NX + lane] and ny[c] == table[NY + lane]:
            return c
    return -1


@jit(inner=True)
def shift_images(pairs: Pairs, work: Work, turns: int) -> None:
    """Rename the images of pairs after a re-gridding by ``turns`` and the return of discs."""
    for q in range(pairs.i.shape[0]):
        table, lane = pairs.table[q // LANES], q % LANES
        i, j = pairs.i[q], pairs.j[q]
        ny = table[NY + lane]
        table[NX + lane] += ny * turns + (work.wx[j] - work.wx[i])
        table[NY + lane] = ny + (work.wy[j] - work.wy[i])


@jit
def renew_contacts(
    discs: Discs, work: Work, links: Pairs, contacts: Pairs, constants: Constants, strain: float
) -> Pairs:
    """Bring discs back into the cell and return a new list of contacts that keeps their springs."""
    x, y, radius, plate = discs.x, discs.y, discs.radius, discs.plate
    width, height, skin = constants.width, constants.height, constants.skin
    begin, end = np.int64(work.begin), np.int64(work.end)
    offset, change = 0.0, 0
    if constants.periodic:
        turns = turns_of(strain, width, height)
        offset = strain * height - turns * width
        change = turns - work.turns[0]
        work.turns[0] = turns
        for a in range(work.begin, work.end):
            work.wx[a], work.wy[a] = image_of(x[a], y[a], width, height, offset)
            x[a] -= work.wx[a] * width + work.wy[a] * offset
            y[a] -= work.wy[a] * height
    for a in range(work.begin, work.end):
        work.x0[a], work.y0[a] = x[a], y[a]
    work.strain0[0] = strain
    work.largest[0] = radius.max()
    meet(work.meeting, work.threads)
    if constants.periodic:
        shift_images(links, work, change)
        shift_images(contacts, work, change)
        start, i, j, nx, ny = find_pairs(
            x, y, radius, skin, width, height, offset, begin, end,
        )  # fmt: skip
    else:
        # A cell so large that no image is near anybody.
        left, low = x.min(), y.min()
        reach = 2.0 * (2.0 * radius.max() + skin)
        start, i, j, nx, ny = find_pairs(
            x - left, y - low, radius, skin, x.max() - left + reach, y.max() - low + reach, 0.0,
            begin, end,
        )  # fmt: skip

    # Linked pairs are not contacts too (through another image they may be), nor are glued discs.
    # The rest keep their history; ``source`` is the old number of each new pair, or −1. They are
    # ordered by the strip of their first disc, and then by how far they must move to touch.
    source = np.full(i.shape[0], -1, np.int32)
    group = np.empty(i.shape[0], np.int32)
    for c in range(i.shape[0]):
        dx = x[j[c]] - x[i[c]] + (nx[c] * width + ny[c] * offset)
        dy = y[j[c]] - y[i[c]] + ny[c] * height
        gap = np.sqrt(dx * dx + dy * dy) - (radius[i[c]] + radius[j[c]])
        group[c] = min(max(int(NEAR * gap / skin), 0), NEAR - 1)
        if plate[i[c]] != 0.0 and plate[j[c]] != 0.0:
            group[c] = NEAR
    for q in range(links.i.shape[0]):
        if links.i[q] == links.j[q]:
            continue  # between two strips
        block, lane = q // LANES, q % LANES
        reach = radius[links.i[q]] + radius[links.j[q]]
        links.table[block, SUM + lane], links.table[block, PER_SUM + lane] = reach, 1.0 / reach
        c = find_in(start, j, nx, ny, links, q)
        if c >= 0:
            group[c] = NEAR
    for q in range(contacts.i.shape[0]):
        if contacts.table[q // LANES, STATE + q % LANES] != OPEN:
            c = find_in(start, j, nx, ny, contacts, q)
            if c >= 0:
                source[c] = q
    edges = work.edges
    strips = np.zeros((edges.shape[0] - 1, ALL + 1), np.int64)
    fill = np.zeros((edges.shape[0] - 1, NEAR), np.int64)
    first = total = 0
    for s in range(strips.shape[0]):
        for c in range(start[edges[s]], start[edges[s + 1]]):
            if group[c] < NEAR:
                strips[s, WITHIN + group[c]] += 1
        for g in range(1, NEAR):
            fill[s, g] = strips[s, WITHIN + g - 1]
            strips[s, WITHIN + g] += strips[s, WITHIN + g - 1]
        for g in range(NEAR):
            fill[s, g] += first
        strips[s, FIRST], strips[s, COUNT] = first, strips[s, WITHIN]
        if strips[s, ALL] > 0:
            total = first + strips[s, ALL]
            first = (total + LANES - 1) // LANES * LANES
    pairs = empty_pairs(total)
    table = pairs.table
    s = 0
    for c in range(i.shape[0]):
        while i[c] >= edges[s + 1]:
            s += 1
        if group[c] == NEAR:
            continue
        q = fill[s, group[c]]
        fill[s, group[c]] += 1
        block, lane = q // LANES, q % LANES  # a view of a block would count who uses the table
        pairs.i[q], pairs.j[q] = i[c], j[c]
        if source[c] >= 0:
            old, from_lane = source[c] // LANES, source[c] % LANES
            for row in range(EX, PAIR_ROWS * LANES, LANES):
                table[block, row + lane] = contacts.table[old, row + from_lane]
        table[block, NX + lane], table[block, NY + lane] = nx[c], ny[c]
        table[block, SUM + lane] = radius[i[c]] + radius[j[c]]
        table[block, PER_SUM + lane] = 1.0 / (radius[i[c]] + radius[j[c]])
    return Pairs(pairs.i, pairs.j, table, strips)


@jit(inner=True)
def moved(discs: Discs, work: Work, contacts: Pairs, constants: Constants, strain: float) -> float:
    """Return by how much two discs may have approached since the contact list was made [m].

    What counts is the displacement u relative to the affine flow, and the flow across one contact:
    a pair Δ₀ apart is A (Δ₀ + Δu) apart now, with A the shear, so it touches only if |Δ₀| is below
    D s + 2 |u|, s the larger singular value of A.
    The list holds all touching pairs while this is at most the skin, and the first COUNT of a
    strip are enough, which this function sets. Not a number, or more than 1000 cells, says that the
    motion has exploded.
    """
    change = strain - work.strain0[0]
    middle = 0.5 * constants.height
    x, y, x0, y0 = discs.x, discs.y, work.x0, work.y0
    farthest = np.uint64(0)
    for a in range(work.begin, work.end):
        dx = x[a] - x0[a] - change * (y[a] - middle)
        dy = y[a] - y0[a]
        farthest = max(farthest, bits(dx * dx + dy * dy))
    farthest2 = number(
        largest_of(farthest, work.extremes, FARTHEST, work.thread, work.threads, work.meeting)
    )
    if not farthest2 < (1000.0 * constants.width) ** 2:
        return np.nan
    # Shear brings discs from D (1 + stretch) to contact at most: the larger of its singular values.
    stretch = 0.5 * abs(change) + np.sqrt(1.0 + 0.25 * change * change) - 1.0
    way = 2.0 * np.sqrt(farthest2) + stretch * 2.0 * work.largest[0]
    if way <= constants.skin:
        # A pair that has touched since stays in, so that its history is not lost. Whole octets, as
        # far as pairs are listed, take less time than a few pairs by themselves.
        within = WITHIN + min(int(NEAR * way / constants.skin), NEAR - 1)
        for s in range(contacts.strips.shape[0]):
            count = max(contacts.strips[s, COUNT], contacts.strips[s, within])
            contacts.strips[s, COUNT] = min((count + 7) // 8 * 8, contacts.strips[s, ALL])
    return float(way)


@jit(inner=True)
def places(discs: Discs, work: Work, constants: Constants, offset: float) -> None:
    """Find where each disc is in the cell, from its centre; glued discs are no part of it."""
    x, y, plate, lx, ly = discs.x, discs.y, discs.plate, work.lx, work.ly
    width, height = constants.width, constants.height
    images = 1.0 if constants.periodic else 0.0
    for a in range(work.begin, work.end):
        up = images * np.floor(y[a] / height)
        ly[a] = (1.0 - abs(plate[a])) * (y[a] - up * height - 0.5 * height)
        lx[a] = x[a] - up * offset
    for a in range(work.begin, work.end):
        right = images * np.floor(lx[a] / width)
        lx[a] = (1.0 - abs(plate[a])) * (lx[a] - right * width - 0.5 * width)


@jit(inner=True)
def accelerate(discs: Discs, work: Work, constants: Constants, rate: float) -> None:
    """Accelerations (M.1) from forces and predicted velocities; glued discs have none."""
    damping, spin_damping = constants.damping, constants.spin_damping
    target = constants.spin_target * rate
    mass, inertia, plate = discs.mass, discs.inertia, discs.plate
    px, py, pspin = work.px, work.py, work.pspin
    fx, fy, torque = work.fx, work.fy, work.torque
    ax, ay, aspin = work.ax, work.ay, work.aspin
    for a in range(work.begin, work.end):
        free = 1.0 - abs(plate[a])
        ax[a] = free * (fx[a] / mass[a] - damping * px[a] - rate * py[a])
    for a in range(work.begin, work.end):
        free = 1.0 - abs(plate[a])
        ay[a] = free * (fy[a] / mass[a] - damping * py[a])
    for a in range(work.begin, work.end):
        free = 1.0 - abs(plate[a])
        aspin[a] = free * (torque[a] / inertia[a] - spin_damping * (pspin[a] - target))


@jit(inner=True)
def carry_plates(discs: Discs, work: Work, constants: Constants, rate: float) -> None:
    """Give glued discs the velocity of their plate, ±γ̇ L_y/2, and no rotation."""
    if not constants.plates:
        return
    for a in range(work.begin, work.end):
        if discs.plate[a] != 0.0:
            half = 0.5 * constants.height
            discs.cx[a] = rate * (discs.plate[a] * half - (discs.y[a] - half))
            discs.cy[a] = 0.0
            discs.spin[a] = 0.5 * rate
            work.px[a] = discs.cx[a]
            work.py[a] = 0.0
            work.pspin[a] = discs.spin[a]
            work.turn[a] = 0.0


@jit(inner=True)
def edge_kick(discs: Discs, work: Work, constants: Constants, change: float) -> None:
    """Take back the affine kick of a rate change: inertia alone, for a cell driven at its edges."""
    for a in range(work.begin, work.end):
        if discs.plate[a] == 0:
            y = discs.y[a]
            if constants.periodic:
                y -= np.floor(y / constants.height) * constants.height
            discs.cx[a] -= change * (y - 0.5 * constants.height)
            discs.spin[a] += 0.5 * change


# Sums in whatever order is fast: the same one for the same processor.
@jit(inner=True, fastmath={"reassoc"})
def disc_sums(
    discs: Discs, work: Work, rate: float, begin: np.uint64, end: np.uint64
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Return sums over free discs: torque, spin energy, m c c (xx, xy, yy), F (x − L/2)."""
    torque = kinetic = xx = xy = yy = uxx = uxy = uyx = uyy = 0.0
    for a in range(begin, end):
        free = 1.0 - abs(discs.plate[a])
        torque += free * work.torque[a]
        omega = discs.spin[a] - 0.5 * rate
        kinetic += free * (0.5 * discs.inertia[a] * omega * omega)
        m, cx, cy = free * discs.mass[a], discs.cx[a], discs.cy[a]
        xx += m * cx * cx
        xy += m * cx * cy
        yy += m * cy * cy
        lx, ly, fx, fy = work.lx[a], work.ly[a], work.fx[a], work.fy[a]
        uxx += fx * lx
        uxy += fx * ly
        uyx += fy * lx
        uyy += fy * ly
    return torque, kinetic, xx, xy, yy, uxx, uxy, uyx, uyy


@jit(_nrt=False)
def finish_row(discs: Discs, work: Work, constants: Constants, rate: float, row: Floats) -> None:
    """Fill a record from the sums of ``contact_forces`` and the velocities of this instant."""
    volume = constants.width * constants.height
    tensors = work.tensors
    for c in range(14):
        row[3 + c] = tensors[c] / volume
    # Σ F (x − L/2) over free discs: with the external tensor it makes up Love and Weber's (S1-19).
    for s in range(work.lower, work.upper):
        sums = disc_sums(discs, work, rate, np.uint64(work.edges[s]), np.uint64(work.edges[s + 1]))
        for c in range(9):
            work.disc_sums[s, c] = sums[c]
    meet(work.meeting, work.threads)
    add_up(work.disc_sums, work.totals)
    t = work.totals
    torque, kinetic, xx, xy, yy, uxx, uxy, uyx, uyy = (
        t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8],
    )  # fmt: skip
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
    row[22] = 2.0 * tensors[14] / discs.x.shape[0]
    row[23] = tensors[15] / max(tensors[14], 1.0)


@jit(inner=True)
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


@jit(inner=True)
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
