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

from shear_sim.cell import wrap_count
from shear_sim.compiled import jit
from shear_sim.models.microgel.laws import Law, LawParameters, divergent
from shear_sim.models.microgel.motion import (
    accelerate,
    carry_plates,
    edge_kick,
    energy_row,
    finish_row,
    moved,
    peak_rate,
    renew_pairs,
    segment,
    strain_at,
    tally,
)
from shear_sim.models.microgel.state import (
    COULOMB,
    MOST_PIECES,
    NOT_FINITE,
    OPEN,
    RESET,
    RUNNING,
    SLIDE,
    STICK,
    TOO_STIFF,
    Clock,
    Constants,
    Discs,
    Pairs,
    Work,
)

# What the kernels are compiled for. A copy of this module (compiled.variant) has another law, or
# no tangential forces: a scene without friction pays for no rotation.
law: Law = divergent
TANGENTIAL = True
TALLY = False  # whether the energy balance is kept too

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)


@jit
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


@jit
def contact_forces(
    discs: Discs,
    work: Work,
    pairs: Pairs,
    n_links: int,
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
    n = discs.x.shape[0]
    x, y, radius, plate = discs.x, discs.y, discs.radius, discs.plate
    px, py, pspin = work.px, work.py, work.pspin
    fx, fy, torque = work.fx, work.fy, work.torque
    width, height = constants.width, constants.height
    offset = strain * height - work.turns[0] * width
    for a in range(n):
        fx[a] = 0.0
        fy[a] = 0.0
        torque[a] = 0.0
    closest_d2, closest_D2 = 1.0, 1.0
    longest2 = 1.0
    closing = 0.0
    touching_pairs = 0
    sliding_pairs = 0
    if record:
        if constants.periodic:
            wrap_count(x, y, width, height, offset, work.wx, work.wy)
        else:
            work.wx[:] = 0
            work.wy[:] = 0
    pxx = pxy = pyx = pyy = pt = 0.0
    ixx = ixy = iyx = iyy = it = 0.0
    exx = exy = eyx = eyy = 0.0
    dashpot_n = dashpot_t = lost = stored = 0.0

    for q in range(pairs.i.shape[0]):
        i, j = pairs.i[q], pairs.j[q]
        dx = x[j] - x[i] + (pairs.nx[q] * width + pairs.ny[q] * offset)
        dy = y[j] - y[i] + pairs.ny[q] * height
        D = radius[i] + radius[j]
        d2 = dx * dx + dy * dy
        touching = d2 < D * D
        link = q < n_links
        if not (touching or link):
            pairs.state[q] = OPEN
            if TANGENTIAL:
                if TALLY:
                    lost += 0.5 * constants.kt * pairs.spring[q] * pairs.spring[q]
                pairs.spring[q] = 0.0
                pairs.spring_back[q] = 0.0
            continue
        if plate[i] != 0 and plate[j] != 0:
            continue
        if link:
            k, kt, eta, etat = (
                constants.link_k, constants.link_kt, constants.link_eta, constants.link_etat,
            )  # fmt: skip
        else:
            k, kt, eta, etat = constants.k, constants.kt, constants.eta, constants.etat
        d = np.sqrt(d2)
        # Two centres that coincide have no direction: they feel no force, and do not divide.
        inverse = 1.0 / max(d, 1e-300)
        ex = dx * inverse
        ey = dy * inverse
        if touching:
            elastic = law(d, D, k, constants.law)
            touching_pairs += 1
            if d2 * closest_D2 < closest_d2 * D * D:
                closest_d2 = d2
                closest_D2 = D * D
        else:
            elastic = k * (d - D)
            longest2 = max(longest2, d2 / (D * D))
        vx = px[j] - px[i] + rate * dy
        vy = py[j] - py[i]
        vn = vx * ex + vy * ey
        if touching:
            closing = max(closing, abs(vn) * inverse)
        normal = elastic + eta * vn
        if not (constants.may_pull or link):
            normal = min(normal, 0.0)
        if TALLY:
            dashpot_n += (normal - elastic) * vn
            if touching:
                stored += stored_energy(d, D, k, constants.law)
            else:
                stored += 0.5 * k * (d - D) * (d - D)
        along = 0.0
        arm = 0.0
        if TANGENTIAL:
            ri, rj = radius[i], radius[j]
            arm = arm_v = d / D
            if not constants.contact_arms_in_torque:
                arm = 1.0
            if not constants.contact_arms_in_velocity:
                arm_v = 1.0
            vt = vy * ex - vx * ey - arm_v * (ri * pspin[i] + rj * pspin[j] - 0.5 * rate * D)
            before = pairs.state[q]
            slid = 0.0
            if before == OPEN:
                if h > 0.0 and not link:
                    slid = vt * min(h, (D - d) / max(-vn, 1e-300))
            elif h > 0.0 and not (before == SLIDE and constants.sliding == RESET):
                mean = 0.5 * (pairs.d[q] + d)
                rolled = ri * work.turn[i] + rj * work.turn[j]
                if constants.contact_arms_in_velocity:
                    rolled *= mean / D
                slid = mean * (pairs.ex[q] * ey - pairs.ey[q] * ex) - rolled
            spring = pairs.spring[q] + slid
            spring_back = pairs.spring_back[q] + slid
            state = STICK
            if link:
                along = kt * spring
                if constants.sliding == RESET:
                    along = 0.5 * kt * (spring + spring_back)
                if touching or constants.stretched_dashpot:
                    along += etat * vt
            elif constants.sliding == COULOMB:
                cap = constants.friction * abs(elastic)
                if kt > 0.0:
                    spring = min(max(spring, -cap / kt), cap / kt)
                along = kt * spring + etat * vt
                if abs(along) >= cap:
                    along = min(max(along, -cap), cap)
                    state = SLIDE
            else:
                # Two visits, each with half of the force; a slip empties both springs, and
                # the second visit may find a contact that sticks again.
                cap = constants.friction * abs(elastic)
                along = kt * spring + etat * vt
                if abs(along) > cap:
                    along = cap if along >= 0.0 else -cap
                    spring = 0.0
                    spring_back = 0.0
                second = kt * spring_back + etat * vt
                if abs(second) > cap:
                    second = cap if second >= 0.0 else -cap
                    spring = 0.0
                    spring_back = 0.0
                    state = SLIDE
                along = 0.5 * (along + second)
            if TALLY:
                # What the spring took up on its way less what it holds (trapezoidal).
                old = pairs.spring[q]
                lost += 0.5 * kt * (old + spring) * (old + slid - spring)
                stored += 0.5 * kt * spring * spring
                dashpot_t += (along - kt * spring) * vt
            pairs.spring[q] = spring
            pairs.spring_back[q] = spring_back
            pairs.ex[q], pairs.ey[q], pairs.d[q] = ex, ey, d
            pairs.state[q] = state
            if state == SLIDE:
                sliding_pairs += 1
            torque[i] += arm * ri * along
            torque[j] += arm * rj * along
        else:
            pairs.state[q] = STICK
        forcex = normal * ex - along * ey
        forcey = normal * ey + along * ex
        fx[i] += forcex
        fy[i] += forcey
        fx[j] -= forcex
        fy[j] -= forcey
        if record:
            twist = 0.5 * arm * D * along
            pxx -= forcex * dx
            pxy -= forcex * dy
            pyx -= forcey * dx
            pyy -= forcey * dy
            pt += twist
            jx = work.wx[j] - work.wx[i] + pairs.nx[q]
            jy = work.wy[j] - work.wy[i] + pairs.ny[q]
            if jx == 0 and jy == 0 and plate[i] == 0 and plate[j] == 0:
                ixx -= forcex * dx
                ixy -= forcex * dy
                iyx -= forcey * dx
                iyy -= forcey * dy
                it += twist
            else:
                if plate[i] == 0:
                    lx = x[i] - work.wx[i] * width - work.wy[i] * offset - 0.5 * width
                    ly = y[i] - work.wy[i] * height - 0.5 * height
                    exx -= forcex * lx
                    exy -= forcex * ly
                    eyx -= forcey * lx
                    eyy -= forcey * ly
                if plate[j] == 0:
                    lx = x[j] - work.wx[j] * width - work.wy[j] * offset - 0.5 * width
                    ly = y[j] - work.wy[j] * height - 0.5 * height
                    exx += forcex * lx
                    exy += forcex * ly
                    eyx += forcey * lx
                    eyy += forcey * ly

    work.closest[0] = closest_d2
    work.closest[1] = closest_D2
    work.closest[2] = longest2
    work.closest[3] = closing
    if record:
        t = work.tensors
        t[0], t[1], t[2], t[3], t[4] = pxx, pxy, pyx, pyy, pt
        t[5], t[6], t[7], t[8], t[9] = ixx, ixy, iyx, iyy, it
        t[10], t[11], t[12], t[13] = exx, exy, eyx, eyy
        work.row[0] = touching_pairs
        work.row[1] = sliding_pairs
    if TALLY:
        work.power[1], work.power[2] = dashpot_n, dashpot_t
        work.stored[0] = stored
        work.energy[5] += lost


@jit
def relax(
    discs: Discs,
    work: Work,
    pairs: Pairs,
    n_links: int,
    constants: Constants,
    tolerance: float,
    max_steps: int,
) -> tuple[Pairs, int, float]:
    """Bring a packing to its nearest friction-free equilibrium at zero strain.

    FIRE (Bitzek et al. 2006, in the semi-implicit form of Guénolé et al. 2020), with the step
    bounded by the stiffest contact of the moment. Velocities end at zero.

    Parameters
    ----------
    tolerance : float
        Largest net force on a disc that counts as rest [N/m].
    max_steps : int
        Limit of steps.

    Returns
    -------
    pairs, steps, force
        The pair list, the steps made and the largest net force reached [N/m].
    """
    n = discs.x.shape[0]
    discs.cx[:] = 0.0
    discs.cy[:] = 0.0
    work.px[:] = 0.0
    work.py[:] = 0.0
    pairs = renew_pairs(discs, work, pairs, n_links, constants, 0.0)
    mixing = 0.25
    downhill = 0
    scale = 0.1  # of the longest stable step
    largest = np.inf
    smallest_radius = discs.radius.min()
    steps = 0
    while steps < max_steps:
        steps += 1
        if not moved(discs, work, constants, 0.0) <= constants.skin:
            pairs = renew_pairs(discs, work, pairs, n_links, constants, 0.0)
        contact_forces(discs, work, pairs, n_links, constants, 0.0, 0.0, 0.0, False)
        largest2 = 0.0
        power = 0.0
        force2 = 0.0
        speed2 = 0.0
        for a in range(n):
            f2 = work.fx[a] * work.fx[a] + work.fy[a] * work.fy[a]
            largest2 = max(largest2, f2)
            force2 += f2
            speed2 += discs.cx[a] * discs.cx[a] + discs.cy[a] * discs.cy[a]
            power += work.fx[a] * discs.cx[a] + work.fy[a] * discs.cy[a]
        largest = np.sqrt(largest2)
        if largest <= tolerance:
            break
        if power > 0.0:
            downhill += 1
            if downhill > 10:
                scale = min(1.0, scale * 1.1)
                mixing *= 0.99
        else:
            downhill = 0
            scale = max(0.02, scale * 0.5)
            mixing = 0.25
            # Half a step back, as the climb began somewhere inside the last one.
            h = 0.5 * scale * substep(constants, work, 0.0)
            for a in range(n):
                discs.x[a] -= h * discs.cx[a]
                discs.y[a] -= h * discs.cy[a]
                discs.cx[a] = 0.0
                discs.cy[a] = 0.0
            speed2 = 0.0
        h = scale * substep(constants, work, 0.0)
        along = mixing * np.sqrt(speed2 / force2)
        for a in range(n):
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
    discs.cx[:] = 0.0
    discs.cy[:] = 0.0
    return pairs, steps, largest


@jit
def stable(springs: float, dashpots: float) -> float:
    """Return the longest stable step h [s] of a damped vibration, (h ω)²/4 + h γ = 1.

    Parameters
    ----------
    springs, dashpots : float
        2/ω and 1/γ [s].

    Notes
    -----
    Dashpots are the shorter limit from a relative viscosity of 0.1 on: it takes 4 to 16 times as
    many substeps at 0.3 to 1. To treat them apart does not pay. Exact exponentials, pair by pair,
    need h of 0.0175 τ for 0.5 % of the dissipation at 1 (75 % error at 0.2 τ), where (M.1) to (M.4)
    are stable to 0.03 τ. Solving for all at once takes 3 to 5 products with their matrix, each half
    as dear as the forces: half the time at 0.6 to 1, but more than now at the usual 0.1, and
    Coulomb's bound, which includes the dashpots, would have to be found in the same solution.
    """
    loss = 1.0 / dashpots
    return float(2.0 / (loss + np.sqrt(loss * loss + 4.0 / springs**2)))


@jit
def substep(constants: Constants, work: Work, rate: float) -> float:
    """Return the longest substep [s] that contacts, dashpots and flow allow at this instant."""
    # Tangent stiffness at the closest contact relative to k, from the law itself.
    d, D = np.sqrt(work.closest[0]), np.sqrt(work.closest[1])
    slope = 1.0
    if d < D:
        e = 1e-4 * D
        slope = (law(d, D, 1.0, constants.law) - law(max(d - e, 0.0), D, 1.0, constants.law)) / e
    # Half of the limit of springs alone, as collisions keep energy to (h ω)²/4.
    springs = constants.step_normal / np.sqrt(max(1.0, slope))
    h = min(0.5 * springs, stable(springs, constants.step_normal_dashpot))
    if TANGENTIAL:
        # The arms of a stretched link grow with it, and what turns the discs with their square.
        # Three quarters of the limit, where without dashpots an error would stay for ever.
        longest2 = work.closest[2]
        springs = constants.step_rolling / np.sqrt(longest2)
        rolling = stable(springs, constants.step_rolling_dashpot / longest2)
        h = min(h, 0.75 * springs, rolling)
    if rate != 0.0:
        h = min(h, constants.step_strain / abs(rate))
    return float(h)


@jit
def approach_time(constants: Constants, discs: Discs, work: Work) -> float:
    """Return how long [s] nobody comes so close that a contact is suddenly far stiffer.

    The two fastest discs could approach by half a small radius, and a contact change its length by
    a fifth: also on its way out, or the force of the clamp would act for a whole step.
    """
    fastest2 = 1e-300
    for a in range(discs.x.shape[0]):
        fastest2 = max(fastest2, discs.cx[a] * discs.cx[a] + discs.cy[a] * discs.cy[a])
    fastest = max(0.8 * np.sqrt(fastest2) / discs.radius.min(), work.closest[3])
    return float(constants.step_approach / fastest)


@jit
def run(
    discs: Discs,
    work: Work,
    pairs: Pairs,
    n_links: int,
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
    pairs, row, substeps, status
        The pair list, rows filled, substeps made, and RUNNING, NOT_FINITE or TOO_STIFF.
    """
    n = discs.x.shape[0]
    height, width = constants.height, constants.width
    filled = 0
    substeps = 0
    if first < 0:
        first = 0
        strain, rate = strain_at(clock, segment(clock, 0), 0, 0.0)
        if not constants.affine:
            edge_kick(discs, constants, rate)
        for a in range(n):
            work.px[a], work.py[a], work.pspin[a] = discs.cx[a], discs.cy[a], discs.spin[a]
        carry_plates(discs, work, constants, rate)
        pairs = renew_pairs(discs, work, pairs, n_links, constants, strain)
        contact_forces(discs, work, pairs, n_links, constants, strain, rate, 0.0, True)
        accelerate(discs, work, constants, rate)
        rows[0, 0] = 0.0
        rows[0, 1] = strain
        rows[0, 2] = rate
        offset = strain * height - work.turns[0] * width
        finish_row(discs, work, constants, offset, rate, rows[0])
        if TALLY:
            tally(discs, work, constants, rate, 0.0)
            energy_row(discs, work, rows[0])
        filled = 1
    for k in range(first, last):
        now = segment(clock, k)
        strain, rate = strain_at(clock, now, k, 0.0)
        if k > 0 and now != segment(clock, k - 1):
            # The rate jumps: forces anew, with the rate on this side of the jump.
            _, before = strain_at(clock, segment(clock, k - 1), k - 1, 1.0)
            if not constants.affine:
                edge_kick(discs, constants, rate - before)
            for a in range(n):
                work.px[a], work.py[a], work.pspin[a] = discs.cx[a], discs.cy[a], discs.spin[a]
            carry_plates(discs, work, constants, rate)
            contact_forces(discs, work, pairs, n_links, constants, strain, rate, 0.0, TALLY)
            accelerate(discs, work, constants, rate)
            if TALLY:
                tally(discs, work, constants, rate, 0.0)
        record = (k + 1) % clock.every == 0
        peak = peak_rate(clock, now)
        at = 0
        while at < MOST_PIECES:
            resolved = substep(constants, work, peak)
            longest = min(resolved, approach_time(constants, discs, work))
            part = MOST_PIECES
            # Parts are halves of halves, and each begins at a multiple of itself.
            while part > 1 and (clock.step * part > longest * MOST_PIECES or at % part != 0):
                part //= 2
            if clock.step > resolved * MOST_PIECES:
                return pairs, filled, substeps, TOO_STIFF
            h = clock.step * part / MOST_PIECES
            at += part
            strain1, rate1 = strain_at(clock, now, k, at / MOST_PIECES)
            change = strain1 - strain
            kick_rate = 0.5 * (rate1 - rate)
            if not constants.affine:
                edge_kick(discs, constants, kick_rate)
            half = 0.5 * h
            for a in range(n):
                if discs.plate[a] != 0:
                    discs.x[a] += change * discs.plate[a] * 0.5 * height
                    work.turn[a] = 0.0
                    continue
                ax, ay, aspin = work.ax[a], work.ay[a], work.aspin[a]
                kick = h if euler else half
                cx = discs.cx[a] + kick * ax
                cy = discs.cy[a] + kick * ay
                spin = discs.spin[a] + kick * aspin
                discs.cx[a] = cx
                discs.cy[a] = cy
                discs.spin[a] = spin
                middle = discs.y[a] + half * cy - 0.5 * height
                discs.x[a] += h * cx + change * middle
                discs.y[a] += h * cy
                work.turn[a] = h * spin - 0.5 * change
                if euler:
                    work.px[a], work.py[a], work.pspin[a] = cx, cy, spin
                else:
                    work.px[a] = cx + half * ax
                    work.py[a] = cy + half * ay
                    work.pspin[a] = spin + half * aspin
            strain, rate = strain1, rate1
            carry_plates(discs, work, constants, rate)
            way = moved(discs, work, constants, strain)
            if not way <= constants.skin:
                if np.isnan(way):
                    return pairs, filled, substeps, NOT_FINITE
                pairs = renew_pairs(discs, work, pairs, n_links, constants, strain)
            recording = TALLY or (record and at == MOST_PIECES)
            contact_forces(
                discs, work, pairs, n_links, constants, strain, rate, h, recording,
            )  # fmt: skip
            accelerate(discs, work, constants, rate)
            if not euler:
                for a in range(n):
                    if discs.plate[a] == 0:
                        discs.cx[a] += half * work.ax[a]
                        discs.cy[a] += half * work.ay[a]
                        discs.spin[a] += half * work.aspin[a]
            if not constants.affine:
                edge_kick(discs, constants, kick_rate)
            if TALLY:
                tally(discs, work, constants, rate, h)
            substeps += 1
        if record:
            row = rows[filled]
            row[0] = (k + 1) * clock.step
            row[1] = strain
            row[2] = rate
            offset = strain * height - work.turns[0] * width
            finish_row(discs, work, constants, offset, rate, row)
            if TALLY:
                energy_row(discs, work, row)
            filled += 1
            if not np.isfinite(row[3] + row[6] + row[19] + row[21]):
                return pairs, filled, substeps, NOT_FINITE
    return pairs, filled, substeps, RUNNING
