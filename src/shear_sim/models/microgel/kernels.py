"""The microgel's equations of motion, compiled: forces, stress tensors, steps.

State. Positions (x, y) lie in the sheared cell; velocities are peculiar, c = u − γ̇ (y − L_y/2) e_x,
and so are spins, s = ω + γ̇/2. With them SLLOD needs no kicks when the rate jumps:

    x' = c_x + γ̇ (y − L_y/2),  y' = c_y,
    c_x' = F_x/m − γ̇ c_y − λ c_x,  c_y' = F_y/m − λ c_y,  s' = T/I − λ (s − s₀),          (M.1)

where s₀ is 0 (spins damped towards the flow) or γ̇/2 (towards ω = 0). Pair geometry: n from i to j,
t = (−n_y, n_x), d the distance of i to the image of j. A scalar normal force acts on i along n,
a tangential one along t, and their opposites on j:

    F_n = law(d) + η v_n,             v_n = v_rel · n                                      (M.2)
    F_t = k_T ξ + η_T v_t,            v_t = v_rel · t − a_i ω_i − a_j ω_j,  ξ' = v_t       (M.3)
    |F_t| ≤ μ |law(d)| in contacts; T_i = b_i F_t, T_j = b_j F_t                           (M.4)

with v_rel = c_j − c_i + γ̇ Δy e_x, which holds for every image. Lever arms a (velocity) and b
(torque) are r d/(r_i + r_j) or r; only b = r d/(r_i + r_j), eq. S1-3, conserves angular momentum.
"""

import numpy as np
from numpy.typing import NDArray

from shear_sim.cell import Floats
from shear_sim.compiled import jit
from shear_sim.models.microgel.laws import Law, LawParameters, divergent
from shear_sim.models.microgel.motion import (
    CLOSEST_OF,
    CLOSING_OF,
    FASTEST,
    LONGEST_OF,
    accelerate,
    add_scaled,
    carry_plates,
    drift,
    edge_kick,
    energy_row,
    finish_row,
    kick,
    moved,
    peak_rate,
    places,
    renew_contacts,
    segment,
    strain_at,
    tally,
)
from shear_sim.models.microgel.rows import (
    AWAY,
    BEFORE,
    CACHED_ROWS,
    CLOSEST,
    CLOSING,
    CX,
    CY,
    DX,
    DY,
    ELASTIC,
    FX,
    FY,
    LONGEST,
    LX,
    LY,
    RIMS,
    ROLLED,
    SLID,
    TWIST,
    UX,
    UY,
    VN,
    VT,
    empty_rows,
    gather,
    read_rows,
    scatter,
    write_rows,
)
from shear_sim.models.microgel.state import (
    COUNT,
    DISTANCE,
    EX,
    EY,
    FIRST,
    LANES,
    MOST_PIECES,
    NOT_FINITE,
    NX,
    NY,
    OPEN,
    PAIR_ROWS,
    PER_SUM,
    RUNNING,
    SLIDE,
    SPRING,
    SPRING_BACK,
    STATE,
    STICK,
    SUM,
    SUMS,
    TOO_STIFF,
    Clock,
    Constants,
    Discs,
    Pairs,
    Springs,
    Work,
)
from shear_sim.threads import Meeting, add_up, bits, largest_of, meet, number

# What the kernels are compiled for. A copy of this module (compiled.variant) has another law, or
# no tangential forces: a scene without friction pays for no rotation.
law: Law = divergent
TANGENTIAL = True
TALLY = False  # whether the energy balance is kept too
RESET = False  # whether a slip empties the spring, as in the historical program

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)


@jit(_nrt=False)
def stored_energy(d: float, D: float, k: float, p: LawParameters) -> float:
    """Return the elastic energy ∫_d^D −law dr of a contact [J/m].

    Quadrature between kinks, and between distances that halve: the divergent law is steep there.
    """
    total = 0.0
    upper = D
    for kink in (p[2] * D, p[1] * D, 0.0):
        lower = min(max(kink, d), upper)
        while upper > lower:
            between = max(lower, 0.5 * upper) if upper > 1e-4 * D else lower
            half = 0.5 * (upper - between)
            for n in range(NODES.shape[0]):
                r = between + half * (1.0 + NODES[n])
                total -= WEIGHTS[n] * half * law(r, D, k, p)
            upper = between
    return total


@jit(_nrt=False)
def pair_forces(
    block: Floats,
    table: Floats,
    m: int,
    springs: Springs,
    constants: Constants,
    offset: float,
    rate: float,
    h: float,
) -> None:
    """Work out the forces (M.2) to (M.4) of a block of ``m`` pairs, a row of ``Pairs.table``.

    There is no branch and no sum over pairs in the loops, so that the compiler takes as many pairs
    at once as the processor can. Two loops: what follows from the distance waits for a root and a
    division, and a processor sees more of the next pairs meanwhile where a loop does less.
    """
    k, kt, eta, etat = springs.k, springs.kt, springs.eta, springs.etat
    far_etat, reach, grip, pull = springs.far_etat, springs.reach, springs.grip, springs.pull
    softness = 1.0 / kt if kt > 0.0 else 1e300
    friction = constants.friction
    width, height = constants.width, constants.height
    moving = 1.0 if h > 0.0 else 0.0
    for s in range(m):
        D = table[SUM + s]
        dx = block[DX + s] + (table[NX + s] * width + table[NY + s] * offset)
        dy = block[DY + s] + table[NY + s] * height
        d = np.sqrt(dx * dx + dy * dy)
        # Two centres that coincide have no direction: they feel no force, and do not divide.
        inverse = 1.0 / max(d, 1e-300)
        ex = dx * inverse
        ey = dy * inverse
        vx = block[CX + s] + rate * dy
        vy = block[CY + s]
        vn = vx * ex + vy * ey
        ratio = d * table[PER_SUM + s]
        block[DX + s] = dx
        block[DY + s] = dy
        block[AWAY + s] = d
        block[UX + s] = ex
        block[UY + s] = ey
        block[VN + s] = vn
        if TANGENTIAL:
            block[VT + s] = vy * ex - vx * ey
        block[CLOSEST + s] = min(block[CLOSEST + s], ratio)
        block[LONGEST + s] = max(block[LONGEST + s], ratio if d < max(D, reach) else 1.0)
        closing = abs(vn) * inverse
        block[CLOSING + s] = max(block[CLOSING + s], closing if d < D else 0.0)
    for s in range(m):
        D = table[SUM + s]
        d = block[AWAY + s]
        ex = block[UX + s]
        ey = block[UY + s]
        vn = block[VN + s]
        touching = d < D
        acts = d < max(D, reach)
        # A law is asked within contact only; a selection costs less than a branch.
        within = law(min(d, D), D, k, constants.law)
        elastic = within if touching else k * (d - D)
        normal = min(elastic + eta * vn, pull)
        normal = normal if acts else 0.0
        along = 0.0
        if TANGENTIAL:
            ratio = d * table[PER_SUM + s]
            arm = ratio if constants.contact_arms_in_torque else 1.0
            arm_v = ratio if constants.contact_arms_in_velocity else 1.0
            vt = block[VT + s] - arm_v * (block[RIMS + s] - 0.5 * rate * D)
            mean = 0.5 * (table[DISTANCE + s] + d)
            arm_v = mean * table[PER_SUM + s] if constants.contact_arms_in_velocity else 1.0
            turned = mean * (table[EX + s] * ey - table[EY + s] * ex)
            slid = moving * (turned - arm_v * block[ROLLED + s])
            before = table[STATE + s]
            onset = vt * min(h, (D - d) / max(-vn, 1e-300))
            slid = onset if before == OPEN else slid
            cap = friction * abs(elastic) + grip
            dashpot = (etat if touching else far_etat) * vt
            if TALLY:
                block[BEFORE + s] = table[SPRING + s]
            if RESET:
                # Two visits, each with half of the force; a slip empties both springs, and the
                # second visit may find a contact that sticks again.
                slid = 0.0 if before == SLIDE else slid
                spring = table[SPRING + s] + slid
                back = table[SPRING_BACK + s] + slid
                first = kt * spring + dashpot
                slips = abs(first) > cap
                first = min(max(first, -cap), cap)
                spring = 0.0 if slips else spring
                back = 0.0 if slips else back
                second = kt * back + dashpot
                slides = abs(second) > cap
                second = min(max(second, -cap), cap)
                spring = 0.0 if slides else spring
                back = 0.0 if slides else back
                along = 0.5 * (first + second)
                table[SPRING_BACK + s] = back if acts else 0.0
            else:
                spring = table[SPRING + s] + slid
                longest = cap * softness
                spring = min(max(spring, -longest), longest)
                along = kt * spring + dashpot
                slides = abs(along) >= cap > 0.0
                along = min(max(along, -cap), cap)
            along = along if acts else 0.0
            state = SLIDE if slides else STICK
            table[SPRING + s] = spring if acts else 0.0
            table[EX + s] = ex
            table[EY + s] = ey
            table[DISTANCE + s] = d
            table[STATE + s] = state if acts else OPEN
            block[TWIST + s] = arm * along
            if TALLY:
                block[VT + s] = vt
                block[SLID + s] = slid
        else:
            table[STATE + s] = STICK if acts else OPEN
        block[FX + s] = normal * ex - along * ey
        block[FY + s] = normal * ey + along * ex
        if TALLY:
            block[ELASTIC + s] = elastic


# Sums may be taken in any order that the compiler finds fast: the same one for the same processor.
@jit(inner=True, fastmath={"reassoc"})
def stress_of(block: Floats, table: Floats, m: int, elsewhere: float, sums: Floats) -> None:
    """Add a block to the sums of a record.

    ``sums``: −Σ F_a l_b (xx, xy, yx, yy) and Σ ½ (T_i + T_j) of all pairs, the same of those
    inside the cell, and the forces of the others as outside forces on the discs of the cell, at
    their places (Table S2-3). Such are pairs across an edge, and those of a glued disc: their
    places are not as far apart as their discs, by more than ``elsewhere``. Then the numbers of
    touching and of sliding pairs.
    """
    xx = xy = yx = yy = twist = touching = sliding = 0.0
    oxx = oxy = oyx = oyy = ot = 0.0
    exx = exy = eyx = eyy = 0.0
    for s in range(m):
        dx, dy, fx, fy = block[DX + s], block[DY + s], block[FX + s], block[FY + s]
        lx, ly = block[LX + s], block[LY + s]
        D = table[SUM + s]
        outside = abs(lx - dx) + abs(ly - dy) > elsewhere
        ofx = fx if outside else 0.0
        ofy = fy if outside else 0.0
        xx -= fx * dx
        xy -= fx * dy
        yx -= fy * dx
        yy -= fy * dy
        oxx -= ofx * dx
        oxy -= ofx * dy
        oyx -= ofy * dx
        oyy -= ofy * dy
        exx += ofx * lx
        exy += ofx * ly
        eyx += ofy * lx
        eyy += ofy * ly
        if TANGENTIAL:
            both = 0.5 * block[TWIST + s] * D
            twist += both
            ot += both if outside else 0.0
            sliding += 1.0 if table[STATE + s] == SLIDE else 0.0
        touching += 1.0 if dx * dx + dy * dy < D * D else 0.0
    sums[0] += xx
    sums[1] += xy
    sums[2] += yx
    sums[3] += yy
    sums[4] += twist
    sums[5] += xx - oxx
    sums[6] += xy - oxy
    sums[7] += yx - oyx
    sums[8] += yy - oyy
    sums[9] += twist - ot
    sums[10] += exx
    sums[11] += exy
    sums[12] += eyx
    sums[13] += eyy
    sums[14] += touching
    sums[15] += sliding


@jit(inner=True)
def tally_pairs(work: Work, table: Floats, m: int, springs: Springs, constants: Constants) -> None:
    """Add the energies and powers of a block to ``work``: stored, lost in dashpots, by friction."""
    block = work.block
    k, kt = springs.k, springs.kt
    for s in range(m):
        D = table[SUM + s]
        d = np.sqrt(block[DX + s] ** 2 + block[DY + s] ** 2)
        old = block[BEFORE + s]
        if table[STATE + s] == OPEN:
            if TANGENTIAL:
                work.energy[5] += 0.5 * kt * old * old
            continue
        inverse = 1.0 / max(d, 1e-300)
        fx, fy = block[FX + s], block[FY + s]
        ex, ey = block[DX + s] * inverse, block[DY + s] * inverse
        normal = fx * ex + fy * ey
        work.power[1] += (normal - block[ELASTIC + s]) * block[VN + s]
        if d < D:
            work.stored[0] += stored_energy(d, D, k, constants.law)
        else:
            work.stored[0] += 0.5 * k * (d - D) * (d - D)
        if TANGENTIAL:
            # What the spring took up on its way less what it holds (trapezoidal).
            along = fy * ex - fx * ey
            spring = table[SPRING + s]
            work.energy[5] += 0.5 * kt * (old + spring) * (old + block[SLID + s] - spring)
            work.stored[0] += 0.5 * kt * spring * spring
            work.power[2] += (along - kt * spring) * block[VT + s]


@jit(_nrt=False)
def contact_forces(
    discs: Discs,
    work: Work,
    links: Pairs,
    contacts: Pairs,
    constants: Constants,
    strain: float,
    rate: float,
    h: float,
    record: bool,
) -> None:
    """Sum forces and torques of all pairs, (M.2) to (M.4); springs are advanced first.

    ξ grows by the tangential displacement of the step of ``h`` seconds that ends now: the mean
    distance times the angle by which the contact has turned, less the rolling of both discs
    (second order, and as stable as velocity Verlet; a velocity predicted for the end of the step
    would feed energy to the springs). A contact that is new began inside the step, when its
    overlap was zero. With ``record`` the sums of the stress tensors are left in ``work.tensors``.
    """
    c = constants
    offset = strain * c.height - work.turns[0] * c.width
    block = work.block
    empty_rows(work)
    block[CLOSEST:CLOSING] = 1.0
    block[CLOSING : CLOSING + LANES] = 0.0
    if record:
        places(discs, work, c, offset)
    write_rows(discs, work)
    if record:
        for s in range(work.lower, work.upper):
            for q in range(SUMS):
                work.pair_sums[s, q] = 0.0
    meet(work.meeting, work.threads)
    if TALLY:
        work.power[1] = work.power[2] = work.stored[0] = 0.0
    free = np.inf
    link = Springs(
        c.link_k, c.link_kt, c.link_eta, c.link_etat,
        c.link_etat if c.stretched_dashpot else 0.0, free, free, free,
    )  # fmt: skip
    contact = Springs(c.k, c.kt, c.eta, c.etat, 0.0, 0.0, 0.0, free if c.may_pull else 0.0)
    elsewhere = 0.1 * min(c.width, c.height)
    for pairs, springs in ((links, link), (contacts, contact)):
        for strip in range(pairs.strips.shape[0]):
            begin = pairs.strips[strip, FIRST]
            end = begin + pairs.strips[strip, COUNT]
            for first in range(begin, end, LANES):
                m = int(min(LANES, end - first))
                row = first // LANES
                table = pairs.table[row]
                # As long as there is a whole block more.
                fetching = first + 2 * LANES <= pairs.i.shape[0] > CACHED_ROWS * LANES
                ahead = pairs.table[row + 1 if fetching else row][: PAIR_ROWS * LANES * fetching]
                gather(
                    work.disc_rows, pairs.i, pairs.j, first, m, block, TANGENTIAL, record, ahead
                )  # fmt: skip
                pair_forces(block, table, m, springs, c, offset, rate, h)
                # What falls on discs of another thread is never read.
                scatter(work.force_rows, pairs.i, pairs.j, first, m, block, TANGENTIAL, ahead)
                if record and work.lower <= strip < work.upper:
                    stress_of(block, table, m, elsewhere, work.pair_sums[strip])
                if TALLY:
                    tally_pairs(work, table, m, springs, c)
    read_rows(discs, work, TANGENTIAL)
    fold_extremes(block, work.closest)
    all_extremes(work.closest, work.extremes, work.thread, work.threads, work.meeting)
    work.closest[3] = min(work.closest[3], work.closest[0])
    if record:
        add_up(work.pair_sums, work.tensors)


@jit(inner=True)
def fold_extremes(block: Floats, closest: Floats) -> None:
    """Leave the extremes of all lanes in ``closest``: halves on halves, which are vectors."""
    width = LANES // 2
    while width >= 1:
        for s in range(width):
            block[CLOSEST + s] = min(block[CLOSEST + s], block[CLOSEST + width + s])
            block[LONGEST + s] = max(block[LONGEST + s], block[LONGEST + width + s])
            block[CLOSING + s] = max(block[CLOSING + s], block[CLOSING + width + s])
        width //= 2
    closest[0], closest[1], closest[2] = block[CLOSEST], block[LONGEST], block[CLOSING]


@jit(inner=True)
def all_extremes(
    closest: Floats, extremes: Floats, thread: int, threads: int, meeting: Meeting
) -> None:
    """Let every thread know the extremes of all; what they have added up may then be read.

    All take them in one order: also what is not a number is the same to all.
    """
    if threads == 1:
        return
    extremes[thread, CLOSEST_OF] = closest[0]
    extremes[thread, LONGEST_OF] = closest[1]
    extremes[thread, CLOSING_OF] = closest[2]
    meet(meeting, threads)
    closest[0], closest[1] = extremes[0, CLOSEST_OF], extremes[0, LONGEST_OF]
    closest[2] = extremes[0, CLOSING_OF]
    for other in range(1, threads):
        closest[0] = min(closest[0], extremes[other, CLOSEST_OF])
        closest[1] = max(closest[1], extremes[other, LONGEST_OF])
        closest[2] = max(closest[2], extremes[other, CLOSING_OF])


@jit(inner=True)
def fire_sums(discs: Discs, work: Work) -> None:
    """Leave largest F², Σ F·c, Σ F² and Σ c² of all discs in ``work.totals``."""
    for s in range(work.lower, work.upper):
        largest2 = power = force2 = speed2 = 0.0
        for a in range(np.uint64(work.edges[s]), np.uint64(work.edges[s + 1])):
            f2 = work.fx[a] * work.fx[a] + work.fy[a] * work.fy[a]
            largest2 = max(largest2, f2)
            force2 += f2
            speed2 += discs.cx[a] * discs.cx[a] + discs.cy[a] * discs.cy[a]
            power += work.fx[a] * discs.cx[a] + work.fy[a] * discs.cy[a]
        sums = work.disc_sums[s]
        sums[0], sums[1], sums[2], sums[3] = largest2, power, force2, speed2
    meet(work.meeting, work.threads)
    add_up(work.disc_sums, work.totals)
    for s in range(work.disc_sums.shape[0]):
        work.totals[0] = max(work.totals[0] if s else 0.0, work.disc_sums[s, 0])


@jit(nogil=True)
def relax(
    discs: Discs,
    work: Work,
    links: Pairs,
    contacts: Pairs,
    constants: Constants,
    tolerance: float,
    first: int,
    last: int,
    fire: Floats,
) -> tuple[Pairs, int, float]:
    """Bring a packing nearer to its nearest friction-free equilibrium at zero strain.

    FIRE (Bitzek et al. 2006, in the semi-implicit form of Guénolé et al. 2020), with the step
    bounded by the stiffest contact of the moment. It may be called in pieces, to the same bits.

    Parameters
    ----------
    tolerance : float
        Largest net force on a disc that counts as rest [N/m].
    first, last : int
        Steps made before, and at most after, this call; 0 begins, with no velocity.
    fire : (3,) array
        Kept between calls: mixing, steps downhill, and the step by the longest stable one.

    Returns
    -------
    contacts, steps, force
        The list of contacts, the steps made so far and the largest net force reached [N/m].
    """
    if first == 0:
        for a in range(work.begin, work.end):
            discs.cx[a] = discs.cy[a] = work.px[a] = work.py[a] = 0.0
        contacts = renew_contacts(discs, work, links, contacts, constants, 0.0)
        fire[0], fire[1], fire[2] = 0.25, 0.0, 0.1
    mixing, downhill, scale = fire[0], fire[1], fire[2]
    largest = np.inf
    smallest_radius = discs.radius.min()
    size = 2.0 * discs.radius.mean()
    steps = first
    while steps < last:
        steps += 1
        if not moved(discs, work, contacts, constants, 0.0) <= constants.skin:
            contacts = renew_contacts(discs, work, links, contacts, constants, 0.0)
        contact_forces(discs, work, links, contacts, constants, 0.0, 0.0, 0.0, False)
        fire_sums(discs, work)
        largest2, power = work.totals[0], work.totals[1]
        force2, speed2 = work.totals[2], work.totals[3]
        largest = np.sqrt(largest2)
        if not np.isfinite(force2):
            return contacts, steps, np.nan
        if largest <= tolerance:
            break
        if power > 0.0:
            downhill += 1.0
            if downhill > 10.0:
                scale = min(1.0, scale * 1.1)
                mixing *= 0.99
        else:
            downhill = 0.0
            scale = max(0.02, scale * 0.5)
            mixing = 0.25
            # Half a step back, as the climb began somewhere inside the last one.
            h = 0.5 * scale * substep(constants, work, size, 0.0)
            for a in range(work.begin, work.end):
                discs.x[a] -= h * discs.cx[a]
                discs.y[a] -= h * discs.cy[a]
                discs.cx[a] = 0.0
                discs.cy[a] = 0.0
            speed2 = 0.0
        h = scale * substep(constants, work, size, 0.0)
        along = mixing * np.sqrt(speed2 / force2)
        for a in range(work.begin, work.end):
            cx = discs.cx[a] + h * work.fx[a] / discs.mass[a]
            cy = discs.cy[a] + h * work.fy[a] / discs.mass[a]
            if power > 0.0:
                cx = (1.0 - mixing) * cx + along * work.fx[a]
                cy = (1.0 - mixing) * cy + along * work.fy[a]
            # Random starts overlap deeply: nobody jumps over a neighbour.
            jump = h * np.sqrt(cx * cx + cy * cy)
            if jump > 0.1 * smallest_radius:
                cx *= 0.1 * smallest_radius / jump
                cy *= 0.1 * smallest_radius / jump
            discs.cx[a] = cx
            discs.cy[a] = cy
            discs.x[a] += h * cx
            discs.y[a] += h * cy
    fire[0], fire[1], fire[2] = mixing, downhill, scale
    return contacts, steps, largest


@jit(_nrt=False)
def stable(springs: float, dashpots: float) -> float:
    """Return the longest stable step h [s] of a damped vibration, (h ω)²/4 + h γ = 1.

    Parameters
    ----------
    springs, dashpots : float
        2/ω and 1/γ [s].

    Notes
    -----
    Dashpots are the shorter limit from a relative viscosity of 0.1 on: it takes 4 to 16 times as
    many substeps at 0.3 to 1. They could be treated apart. Exact exponentials, pair by pair, split
    what many contacts do to one disc at once, and so need steps about as short for the same
    dissipation. Solving for all at once takes several products with their matrix in each step:
    less time at 0.6 to 1, perhaps, but more than now at the usual 0.1, and Coulomb's bound, which
    includes the dashpots, would have to be found in the same solution.
    """
    loss = 1.0 / dashpots
    return float(2.0 / (loss + np.sqrt(loss * loss + 4.0 / springs**2)))


@jit(_nrt=False)
def substep(constants: Constants, work: Work, size: float, rate: float) -> float:
    """Return the longest substep [s] that contacts, dashpots and flow allow at this instant.

    ``size`` is the contact distance at which the law's tangent is read [m].
    """
    closest, longest = work.closest[0], work.closest[1]
    softer = 1.0
    if closest < 1.0:
        # Tangent stiffness at the closest contact, from the law itself.
        stiffest = max(constants.k, constants.link_k)
        steepest = stiffest
        d, e = closest * size, 1e-4 * size
        for k in (constants.k, constants.link_k):
            nearer = law(max(d - e, 0.0), size, k, constants.law)
            steepest = max(steepest, (law(d, size, k, constants.law) - nearer) / e)
        softer = np.sqrt(stiffest / steepest)
    springs = constants.step_normal * softer
    # Collisions keep energy to (h ω)²/4.
    h = min(constants.step_energy * softer, stable(springs, constants.step_normal_dashpot))
    if TANGENTIAL:
        # The arms of a stretched link grow with it, and what turns the discs with their square.
        # Three quarters of the limit, where without dashpots an error would stay for ever.
        springs = constants.step_rolling / longest
        rolling = stable(springs, constants.step_rolling_dashpot / (longest * longest))
        h = min(h, 0.75 * springs, rolling)
    if rate != 0.0:
        h = min(h, constants.step_strain / abs(rate))
    return float(h)


@jit(inner=True)
def approach_time(constants: Constants, discs: Discs, work: Work, smallest_radius: float) -> float:
    """Return how long [s] nobody comes so close that a contact is suddenly far stiffer.

    The two fastest discs could approach by half a small radius, and a contact change its length by
    a fifth: also on its way out, or the force of the clamp would act for a whole step.
    """
    largest = np.uint64(0)
    for a in range(work.begin, work.end):
        cx, cy = discs.cx[a], discs.cy[a]
        largest = max(largest, bits(cx * cx + cy * cy))
    largest = largest_of(largest, work.extremes, FASTEST, work.thread, work.threads, work.meeting)
    fastest = max(0.8 * np.sqrt(number(largest)) / smallest_radius, work.closest[2], 1e-150)
    return float(constants.step_approach / fastest)


@jit(nogil=True)
def run(
    discs: Discs,
    work: Work,
    links: Pairs,
    contacts: Pairs,
    constants: Constants,
    clock: Clock,
    first: int,
    last: int,
    euler: bool,
    rows: NDArray[np.float64],
) -> tuple[Pairs, int, int, int]:
    """Step from whole step ``first`` to ``last`` and fill one row per record.

    ``first`` < 0 starts the run: its first instant is recorded before step 0.

    Velocity Verlet in which dashpots see velocities predicted for the end of the step: second
    order also with velocity-dependent forces. It is stable for a vibration of frequency ω that is
    damped at the rate γ while (h ω)²/4 + h γ ≤ 1; there a root of its cubic passes −1. ``euler``:
    the semi-implicit Euler of the historical program, first order. A step is halved, more than
    once if need be, where contacts, dashpots and the flow are not resolved.

    Returns
    -------
    contacts, row, substeps, status
        The list of contacts, rows filled, substeps made, and RUNNING, NOT_FINITE or TOO_STIFF.
    """
    smallest = discs.radius.min()
    size = 2.0 * discs.radius.mean()
    begin, end = work.begin, work.end
    filled = 0
    substeps = 0
    strain = rate = 0.0
    for k in range(max(first, -1), last):
        start = k < 0  # what comes before step 0
        now = segment(clock, max(k, 0))
        jumps = k > 0 and now != segment(clock, k - 1)
        if k <= first or jumps:
            strain, rate = strain_at(clock, now, max(k, 0), 0.0)
        if start or jumps:
            # The rate jumps: forces anew, with the rate on this side of the jump.
            before = 0.0 if start else strain_at(clock, segment(clock, k - 1), k - 1, 1.0)[1]
            if not constants.affine:
                edge_kick(discs, work, constants, rate - before)
            if start:
                contacts = renew_contacts(discs, work, links, contacts, constants, strain)
            kick(discs.cx, work.px, work.ax, 0.0, 0.0, begin, end)
            kick(discs.cy, work.py, work.ay, 0.0, 0.0, begin, end)
            kick(discs.spin, work.pspin, work.aspin, 0.0, 0.0, begin, end)
            carry_plates(discs, work, constants, rate)
            contact_forces(
                discs, work, links, contacts, constants, strain, rate, 0.0, start or TALLY,
            )  # fmt: skip
            accelerate(discs, work, constants, rate)
            if TALLY:
                tally(discs, work, constants, rate, 0.0)
        if start:
            finish_row(discs, work, constants, rate, rows[0])
            rows[0, 0], rows[0, 1], rows[0, 2] = 0.0, strain, rate
            if TALLY:
                energy_row(discs, work, rows[0])
            filled = 1
            continue
        record = (k + 1) % clock.every == 0
        peak = peak_rate(clock, now)
        at = 0
        while at < MOST_PIECES:
            resolved = substep(constants, work, size, peak)
            longest = min(resolved, approach_time(constants, discs, work, smallest))
            part = MOST_PIECES
            # Parts are halves of halves, and each begins at a multiple of itself.
            while part > 1 and (clock.step * part > longest * MOST_PIECES or at % part != 0):
                part //= 2
            if clock.step > resolved * MOST_PIECES:
                work.stopped[0], work.stopped[1] = (k + at / MOST_PIECES) * clock.step, strain
                return contacts, filled, substeps, TOO_STIFF
            h = clock.step * part / MOST_PIECES
            at += part
            strain1, rate1 = strain_at(clock, now, k, at / MOST_PIECES)
            kick_rate = 0.5 * (rate1 - rate)
            if not constants.affine:
                edge_kick(discs, work, constants, kick_rate)
            # Half of the kick and a prediction, or all of it at once.
            now_h, lead = (h, 0.0) if euler else (0.5 * h, 0.5 * h)
            kick(discs.cx, work.px, work.ax, now_h, lead, begin, end)
            kick(discs.cy, work.py, work.ay, now_h, lead, begin, end)
            kick(discs.spin, work.pspin, work.aspin, now_h, lead, begin, end)
            drift(discs, work, constants, h, strain1 - strain, rate1)
            strain, rate = strain1, rate1
            way = moved(discs, work, contacts, constants, strain)
            if not way <= constants.skin:
                if np.isnan(way):
                    work.stopped[0], work.stopped[1] = (k + at / MOST_PIECES) * clock.step, strain
                    return contacts, filled, substeps, NOT_FINITE
                contacts = renew_contacts(discs, work, links, contacts, constants, strain)
            recording = TALLY or (record and at == MOST_PIECES)
            contact_forces(
                discs, work, links, contacts, constants, strain, rate, h, recording,
            )  # fmt: skip
            accelerate(discs, work, constants, rate)
            if not euler:
                # Glued discs, whose velocity is their plate's, have no acceleration.
                add_scaled(discs.cx, 0.5 * h, work.ax, begin, end)
                add_scaled(discs.cy, 0.5 * h, work.ay, begin, end)
                add_scaled(discs.spin, 0.5 * h, work.aspin, begin, end)
            if not constants.affine:
                edge_kick(discs, work, constants, kick_rate)
            if TALLY:
                tally(discs, work, constants, rate, h)
            substeps += 1
        if record:
            row = rows[filled]
            row[0], row[1], row[2] = (k + 1) * clock.step, strain, rate
            finish_row(discs, work, constants, rate, row)
            if TALLY:
                energy_row(discs, work, row)
            filled += 1
            if not np.isfinite(row[3] + row[6] + row[19] + row[21]):
                work.stopped[0], work.stopped[1] = row[0], strain
                return contacts, filled, substeps, NOT_FINITE
    return contacts, filled, substeps, RUNNING
