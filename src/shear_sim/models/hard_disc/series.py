"""Motion of a fixed contact network as a power series in the path, and its next event.

With φ = f/|r| for the force and r·r = D² for the contact, equations (HD.1) and (HD.2) are
polynomial. So the coefficients of positions and forces follow one after the other, each from one
linear system with the *same* matrix N (HD.7): one factorisation gives a whole interval, to any
order, with dense output for free.
"""

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit
from shear_sim.models.hard_disc.factor import Factor, solve
from shear_sim.models.hard_disc.pairs import Pairs

MOST_ORDERS = 16
ACCURACY = 1e-12  # last terms of velocities and forces, relative to the largest at the start
NOTHING, OPENING, COLLISION = 0, 1, 2  # kinds of event


@jit
def expand(
    k: int, shear: float, pressure: float, factor: Factor, i: Ints, j: Ints, mobility: Floats,
    drift: Floats, phi: Floats, u: Floats, r: Floats, kappa: Floats, area: Floats,
) -> None:  # fmt: skip
    """Append order ``k`` of forces and velocities, and k + 1 of separations, in place (HD.7).

    Parameters
    ----------
    k : int
        All lower orders are there.
    shear : float
        g, shear per unit of path.
    pressure : float
        p, looked at only where ``factor`` has a border.
    factor : Factor
        Of N at the start.
    i, j : (n,)
        Discs of each contact.
    mobility : (N,)
        ξ.
    drift : (2, N)
        Velocities ξF of external forces.
    phi : (K + 1, n)
        Forces f/|r|.
    u : (K + 1, 2, N)
        Velocities beside the affine flow.
    r : (K + 2, 2, n)
        Separations.
    kappa : (K + 1,)
        Compression per unit of path; without a border order 0 is given and the others are 0.
    area : (K + 2,)
        Area of the cell.
    """
    n = i.shape[0]
    free = factor.border.shape[1] > 0
    for d in range(mobility.shape[0]):
        for s in range(2):
            u[k, s, d] = drift[s, d] if k == 0 else 0.0
    compressed = False
    for m in range(k + 1):
        compressed = compressed or (kappa[m] != 0.0 and (m < k or not free))
    for s in range(2):
        for c in range(n):
            push = 0.0
            for m in range(k):
                push += r[k - m, s, c] * phi[m, c]
            u[k, s, i[c]] -= mobility[i[c]] * push
            u[k, s, j[c]] += mobility[j[c]] * push
    b = np.zeros(n)
    for s in range(2):
        for c in range(n):
            turning = 0.0
            for m in range(1, k + 1):
                turning += r[m, s, c] * r[k + 1 - m, s, c]
            speed = u[k, s, j[c]] - u[k, s, i[c]]
            if s == 0:
                speed += shear * r[k, 1, c]
            if compressed:
                for m in range(k + 1):
                    if m < k or not free:
                        speed -= kappa[m] * r[k - m, s, c]
            r[k + 1, s, c] = speed
            b[c] -= 0.5 * (k + 1) * turning + r[0, s, c] * speed
    load = 2.0 * pressure * area[k]
    kappa[k] = 0.0 if free or k > 0 else kappa[k]
    for c in range(n):
        phi[k, c] = 0.0
    # The second round solves for what round-off left of the first, where N is nearly singular;
    # of higher orders a step sees little.
    enough = 1e-14 if k == 0 else 1e-11
    for _ in range(2):
        if n > 0:
            found = solve(factor, b, load)
            if free:
                kappa[k] += found
        for c in range(n):
            phi[k, c] += b[c]
            for s in range(2):
                push = r[0, s, c] * b[c]
                u[k, s, i[c]] -= mobility[i[c]] * push
                u[k, s, j[c]] += mobility[j[c]] * push
        worst = 0.0
        largest = 0.0
        load = 2.0 * pressure * area[k]
        for c in range(n):
            b[c] = 0.0
            for s in range(2):
                turning = 0.0
                for m in range(1, k + 1):
                    turning += r[m, s, c] * r[k + 1 - m, s, c]
                speed = u[k, s, j[c]] - u[k, s, i[c]]
                if s == 0:
                    speed += shear * r[k, 1, c]
                for m in range(k + 1):
                    if kappa[m] != 0.0:
                        speed -= kappa[m] * r[k - m, s, c]
                r[k + 1, s, c] = speed / (k + 1)
                b[c] -= 0.5 * (k + 1) * turning + r[0, s, c] * speed
                load -= phi[k, c] * r[0, s, c] ** 2
                largest = max(largest, abs(speed))
            worst = max(worst, abs(b[c]))
        if worst <= enough * largest:
            break
    change = 0.0
    for m in range(k + 1):
        change -= 2.0 * kappa[m] * area[k - m]
    area[k + 1] = change / (k + 1)


@jit
def first_crossing(p: Floats, last: int, end: float, level: float, close: float) -> float:
    """Return where polynomial ``p`` first falls to −level in [0, end], else infinity.

    It is found where p is less than ``close`` above −level.

    Newton steps to the root of a parabola that lies below the polynomial all the way to the end: no
    root is ever stepped over, and simple ones are approached quadratically.
    """
    bend = 1e-300
    power = 1.0
    for k in range(2, last + 1):
        bend += k * (k - 1) * abs(p[k]) * power
        power *= end
    t = 0.0
    for _ in range(100):
        value = p[last]
        slope = 0.0
        for k in range(last - 1, -1, -1):
            slope = slope * t + value
            value = value * t + p[k]
        value += level
        if value <= close:
            return t
        root = np.sqrt(slope * slope + 2.0 * bend * value)
        if slope <= 0.0:
            t += 2.0 * value / (root - slope)
        else:  # the same root, without its cancellation
            t += (root + slope) / bend
        if t > end:
            return np.inf
    return t


@jit
def next_opening(
    phi: Floats, last: int, end: float, level: float, permanent: Ints
) -> tuple[float, int]:
    """Return when and which temporary contact first carries no force in [0, end]."""
    first = np.inf
    which = -1
    p = np.empty(last + 1)
    for c in range(phi.shape[1]):
        if permanent[c]:
            continue
        least = phi[0, c]
        power = 1.0
        for k in range(1, last + 1):
            power *= end
            p[k] = phi[k, c]
            least -= abs(p[k]) * power
        if least > -level:
            continue
        p[0] = phi[0, c]
        t = first_crossing(p, last, end, level, 0.1 * level)
        if t < first:
            first = t
            which = c
            end = t
    return first, which


@jit
def next_collision(
    pairs: Pairs, open_pairs: Ints, rx: Floats, ry: Floats, gap: Floats, shear: float,
    u: Floats, kappa: Floats, last: int, end: float, level: float,
) -> tuple[float, int]:  # fmt: skip
    """Return when and which of the pairs without contact first touches in [0, end].

    Parameters
    ----------
    pairs : Pairs
        Candidates (P,).
    open_pairs : (P,)
        1 where there is no contact.
    rx, ry, gap : (P,)
        Separations and gaps at the start.
    shear, u, kappa
        See `expand`.
    last : int
        Order of the series.
    level : float
        Overlap at which a pair collides.
    """
    first = np.inf
    which = -1
    fastest = np.zeros(last + 1)
    for k in range(last + 1):
        for d in range(u.shape[2]):
            fastest[k] = max(fastest[k], np.hypot(u[k, 0, d], u[k, 1, d]))
    x = np.zeros(last + 2)
    y = np.zeros(last + 2)
    square = np.zeros(2 * last + 3)
    stretch, reach = _reach(fastest, kappa, shear, last, end)
    for c in range(gap.shape[0]):
        d = pairs.distance[c]
        if not open_pairs[c] or gap[c] > stretch * (d + gap[c]) + reach:
            continue
        i, j = pairs.i[c], pairs.j[c]
        x[0] = rx[c]
        y[0] = ry[c]
        for k in range(last + 1):
            vx = shear * y[k] + u[k, 0, j] - u[k, 0, i]
            vy = u[k, 1, j] - u[k, 1, i]
            for m in range(k + 1):
                if kappa[m] != 0.0:
                    vx -= kappa[m] * x[k - m]
                    vy -= kappa[m] * y[k - m]
            x[k + 1] = vx / (k + 1)
            y[k + 1] = vy / (k + 1)
        for k in range(2 * last + 3):  # as a gap: (r² − D²) / 2D
            square[k] = 0.0
        for k in range(last + 2):
            for m in range(last + 2):
                square[k + m] += (x[k] * x[m] + y[k] * y[m]) / (2.0 * d)
        square[0] = gap[c] * (1.0 + 0.5 * gap[c] / d)
        # A pair that overlaps by round-off has been seen to part: it collides where it comes back.
        lower = level + max(0.0, -gap[c])
        t = first_crossing(square, 2 * last + 2, end, lower, 0.1 * level)
        if t < first:
            first = t
            which = c
            end = t
            stretch, reach = _reach(fastest, kappa, shear, last, end)
    return first, which


@jit
def _reach(
    fastest: Floats, kappa: Floats, shear: float, last: int, end: float
) -> tuple[float, float]:
    """Bound how a pair may approach within [0, end]: relative to its distance, and beside that."""
    stretch = abs(shear) * end
    reach = 0.0
    power = end
    for k in range(last + 1):
        stretch += abs(kappa[k]) * power
        reach += 2.2 * fastest[k] * power / (k + 1)
        power *= end
    return 1.1 * stretch, reach


@jit
def _largest_force(phi: Floats, k: int) -> float:
    most = 0.0
    for c in range(phi.shape[1]):
        most = max(most, abs(phi[k, c]))
    return most


@jit
def _largest_velocity(u: Floats, k: int) -> float:
    most = 0.0
    for s in range(2):
        for d in range(u.shape[2]):
            most = max(most, abs(u[k, s, d]))
    return most


@jit
def look_ahead(
    shear: float, pressure: float, load_kappa: float, cap: float, accuracy: float, factor: Factor,
    active: Ints, permanent: Ints, mobility: Floats, drift: Floats, pairs: Pairs,
    open_pairs: Ints, rx: Floats, ry: Floats, gap: Floats, cell_area: float, touch: float,
) -> tuple[int, float, int, int, float, float, Floats, Floats, Floats, Floats]:  # fmt: skip
    """Expand the motion from here as far as the next event needs, and find that event.

    Parameters
    ----------
    shear, pressure, factor, mobility, drift
        See `expand`.
    load_kappa : float
        Imposed compression, where the pressure is not.
    cap : float
        Longest step.
    accuracy : float
        See `ACCURACY`.
    active, permanent : (n,)
        Which pairs are in contact, in order, and which of them never open.
    pairs, open_pairs, rx, ry, gap
        See `next_collision`.
    cell_area : float
        Ω now.
    touch : float
        See ``level`` of `next_collision`.

    Returns
    -------
    order : int
        Of the series.
    step : float
        To the event, or as far as the series is accurate.
    kind, which : int
        Of the event; ``which`` counts contacts (opening) or pairs (collision).
    reach : float
        Bound of what any pair approaches on the way, beside the affine flow.
    error : float
        Size of the last term of the positions at the end of the step.
    phi, u, kappa, area
        See `expand`.
    """
    n = active.shape[0]
    i = np.empty(n, np.int32)
    j = np.empty(n, np.int32)
    phi = np.zeros((MOST_ORDERS + 1, n))
    u = np.zeros((MOST_ORDERS + 1, 2, mobility.shape[0]))
    r = np.zeros((MOST_ORDERS + 2, 2, n))
    kappa = np.zeros(MOST_ORDERS + 1)
    area = np.zeros(MOST_ORDERS + 2)
    for c in range(n):
        i[c] = pairs.i[active[c]]
        j[c] = pairs.j[active[c]]
        r[0, 0, c] = rx[active[c]]
        r[0, 1, c] = ry[active[c]]
    kappa[0] = load_kappa
    area[0] = cell_area
    wanted = cap
    step = cap
    force = 0.0
    speed = 0.0
    before = 0.0
    affine = np.sqrt(cell_area)
    for k in range(MOST_ORDERS + 1):
        expand(
            k, shear, pressure, factor, i, j, mobility, drift, phi, u, r, kappa, area
        )  # fmt: skip
        if k == 0:
            force = max(_largest_force(phi, k), 1e-300)
            speed = max(_largest_velocity(u, k), 1e-300)
            total = 0.0
            for c in range(n):
                total += abs(phi[0, c])
            level = 1e-12 * total / max(n, 1)
        tail = max(_largest_force(phi, k) / force, _largest_velocity(u, k) / speed)
        if kappa[0] != 0.0:  # without compression the affine motion is a finite series
            affine *= (abs(shear) + abs(kappa[0])) / (k + 1)
            tail = max(tail, affine)
        if k == 3:  # a first guess of the next event: there is no use in looking far beyond it
            largest = max(tail, before)
            far = min(cap, (0.05 / largest) ** (1.0 / 3.0)) if largest > 0.0 else cap
            opening, _ = next_opening(phi, k, far, level, permanent)
            collision, _ = next_collision(
                pairs, open_pairs, rx, ry, gap, shear, u, kappa, k, far, touch
            )
            wanted = min(cap, 1.02 * min(opening, collision))
        elif k > 3:
            step = cap
            if tail > 0.0:
                step = min(step, (accuracy / tail) ** (1.0 / k))
            if before > 0.0:
                step = min(step, (accuracy / before) ** (1.0 / (k - 1)))
            if step >= wanted:
                break
        before = tail
    opening, contact = next_opening(phi, k, step, level, permanent)
    kind, which = NOTHING, -1
    if opening <= step:
        step, kind, which = opening, OPENING, contact
    collision, pair = next_collision(
        pairs, open_pairs, rx, ry, gap, shear, u, kappa, k, step, touch
    )
    if collision <= step:
        step, kind, which = collision, COLLISION, pair
    reach = 0.0
    for m in range(k + 1):
        reach += 3.0 * _largest_velocity(u, m) * step ** (m + 1) / (m + 1)
    error = _largest_velocity(u, k) * step ** (k + 1) / (k + 1)
    end = k + 1
    return k, step, kind, which, reach, error, phi[:end], u[:end], kappa[:end], area[:end]


@jit
def travel(
    x: Floats, y: Floats, moved: Floats, u: Floats, kappa: Floats, shear: float, t: float
) -> tuple[float, float]:
    """Move discs along the series by ``t``, in place; return ∫κ and whether it mattered.

    Parameters
    ----------
    x, y : (N,)
        Positions at the start; overwritten.
    moved : (2, N)
        ∫u is added.
    u, kappa, shear
        See `expand`.
    t : float
        Where to, from the start of the series.

    Returns
    -------
    squeeze : float
        ∫κ: lengths of the cell shrink by exp(−squeeze).
    largest : float
        Largest component of ``moved``.
    """
    orders = u.shape[0]
    px = np.zeros(orders + 1)
    py = np.zeros(orders + 1)
    compressed = False
    squeeze = 0.0
    for k in range(orders - 1, -1, -1):
        squeeze = (squeeze + kappa[k] / (k + 1)) * t
        compressed = compressed or kappa[k] != 0.0
    largest = 0.0
    for d in range(x.shape[0]):
        px[0] = x[d]
        py[0] = y[d]
        for k in range(orders):
            vx = shear * py[k] + u[k, 0, d]
            vy = u[k, 1, d]
            if compressed:
                for m in range(k + 1):
                    vx -= kappa[m] * px[k - m]
                    vy -= kappa[m] * py[k - m]
            px[k + 1] = vx / (k + 1)
            py[k + 1] = vy / (k + 1)
        to_x = px[orders]
        to_y = py[orders]
        free_x = 0.0
        free_y = 0.0
        for k in range(orders - 1, -1, -1):
            to_x = to_x * t + px[k]
            to_y = to_y * t + py[k]
            free_x = (free_x + u[k, 0, d] / (k + 1)) * t
            free_y = (free_y + u[k, 1, d] / (k + 1)) * t
        x[d] = to_x
        y[d] = to_y
        moved[0, d] += free_x
        moved[1, d] += free_y
        largest = max(largest, abs(moved[0, d]), abs(moved[1, d]))
    return squeeze, largest
