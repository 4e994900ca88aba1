"""Contacts of vertices with the segments of other chains, with themselves and with walls.

The potential of vertex v and chain B is

    U = Σ_segments ½ k_n h_s² − Σ_vertices between two segments ½ k_n h_k²                (SP.6)

with h = max(0, r_v + r_B − d) and d the distance from the segment, ends included, or the vertex. So
whatever v faces counts once: off the end of a segment its term is the same as that of the vertex
there. Each term, and so U, is once continuously differentiable, also in concave corners.

Here the sum is taken apart the other way: v next to the inside of segment s is one *feature*, of
coefficient c = 1; vertex k is another, with c = (segments that v is beyond the end of at k) − 1,
which is +1 off a convex corner, −1 in a concave one and 0 else. Rings are seen from outside:
d < 0 behind them, so that a vertex which has crossed the mid-line is still pushed back out.
"""

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit
from shear_sim.models.soft_particle.state import (
    FEATURES,
    ONE_SIDED,
    SEPARATION,
    SLIDING,
    TOO_MANY_RUNS,
    Chains,
    Lists,
    Motion,
    Rules,
    Springs,
    Walls,
    Work,
)

DEEPEST = -0.5  # signed distance / (r + r) behind which a ring is not touched from outside


@jit
def side(
    x: Floats, y: Floats, v: int, s: int, j: int, reach: float, kind: int
) -> tuple[float, float, float, float]:
    """Return overlap [m], normal and share of j where vertex ``v`` is beside the segment s–j.

    ``reach`` is the distance of touching [m]; without contact the overlap is 0.
    """
    qx, qy = x[v] - x[s], y[v] - y[s]
    ex, ey = x[j] - x[s], y[j] - y[s]
    square = ex * ex + ey * ey
    along = qx * ex + qy * ey
    if not 0.0 < along < square:
        return 0.0, 0.0, 0.0, 0.0
    across = ey * qx - ex * qy
    if across * across >= square * reach * reach:
        return 0.0, 0.0, 0.0, 0.0
    over = 1.0 / np.sqrt(square)
    distance = across * over
    nx, ny = ey * over, -ex * over
    if distance < 0.0 and kind != ONE_SIDED:
        distance, nx, ny = -distance, -nx, -ny
    if distance <= DEEPEST * reach:
        return 0.0, 0.0, 0.0, 0.0
    return reach - distance, nx, ny, along / square


@jit
def corner(
    x: Floats, y: Floats, v: int, i: int, s: int, j: int, reach: float, kind: int
) -> tuple[float, float, float, float]:
    """Return coefficient, overlap [m] and normal of vertex ``v`` at vertex s between i and j.

    i or j may be −1, at the end of an open chain. Without contact the coefficient is 0.
    """
    qx, qy = x[v] - x[s], y[v] - y[s]
    near = qx * qx + qy * qy
    if near >= reach * reach:
        return 0.0, 0.0, 0.0, 0.0
    coefficient = -1.0 if i >= 0 and j >= 0 else 0.0
    ax = ay = ex = ey = 0.0
    if i >= 0:
        ax, ay = x[s] - x[i], y[s] - y[i]
        coefficient += 1.0 if qx * ax + qy * ay >= 0.0 else 0.0
    if j >= 0:
        ex, ey = x[j] - x[s], y[j] - y[s]
        coefficient += 1.0 if qx * ex + qy * ey <= 0.0 else 0.0
    distance = np.sqrt(near)
    toward = 1.0
    if kind == ONE_SIDED and coefficient * (ax * ey - ay * ex) < 0.0:
        toward = -1.0  # inside a convex corner, or behind a concave one
        if distance >= -DEEPEST * reach:
            return 0.0, 0.0, 0.0, 0.0
    scale = toward / distance
    return coefficient, reach - toward * distance, scale * qx, scale * qy


@jit
def contact_forces(
    chains: Chains, lists: Lists, rules: Rules, motion: Motion, springs: Springs, work: Work
) -> int:
    """Add the contact forces of all vertices and segments; return a status.

    Dashpots multiply the force of a feature by 1 − β ḣ⁻ (Hunt & Crossley), so that they keep the
    sums of (SP.6) and never pull.
    """
    x, y, px, py = motion.x, motion.y, motion.px, motion.py
    fx, fy, dx, dy = motion.fx, motion.fy, motion.dx, motion.dy
    chain, radius, found, owner = chains.chain, chains.radius, work.found, work.owner
    after, before = chains.after, chains.before
    closest = work.closest[0]
    frictional = rules.friction > 0.0
    for v in range(x.shape[0]):
        count = 0
        for c in range(lists.start[v], lists.start[v + 1]):
            s, kind = lists.segment[c], lists.kind[c]
            j = after[s]
            reach = radius[chain[v]] + radius[chain[s]]
            # Beside the segment, at its first vertex, and at its second where the chain ends.
            for place in range(3 if after[j] < 0 else 2):
                if place == 0:
                    overlap, nx, ny, w = side(x, y, v, s, j, reach, kind)
                    coefficient, a, b = 1.0, s, j
                elif place == 1:
                    coefficient, overlap, nx, ny = corner(x, y, v, before[s], s, j, reach, kind)
                    w, a, b = 0.0, s, s
                else:
                    coefficient, overlap, nx, ny = corner(x, y, v, s, j, -1, reach, kind)
                    w, a, b = 0.0, j, j
                if overlap <= 0.0 or coefficient == 0.0:
                    continue
                closest = min(closest, 1.0 - overlap / reach)
                force = coefficient * rules.stiffness * overlap
                u = 1.0 - w
                fx[v] += force * nx
                fy[v] += force * ny
                fx[a] -= u * force * nx
                fy[a] -= u * force * ny
                fx[b] -= w * force * nx
                fy[b] -= w * force * ny
                if rules.dashpot > 0.0:
                    speed = (px[v] - u * px[a] - w * px[b]) * nx
                    speed += (py[v] - u * py[a] - w * py[b]) * ny
                    loss = -force * min(1.0, rules.dashpot * speed)
                    dx[v] += loss * nx
                    dy[v] += loss * ny
                    dx[a] -= u * loss * nx
                    dy[a] -= u * loss * ny
                    dx[b] -= w * loss * nx
                    dy[b] -= w * loss * ny
                if frictional:
                    if count == FEATURES:
                        return TOO_MANY_RUNS
                    found[count, 0], found[count, 1] = coefficient, overlap
                    found[count, 2], found[count, 3] = nx, ny
                    found[count, 4], found[count, 5], found[count, 6] = a, b, w
                    owner[count] = s
                    count += 1
        if frictional and (count > 0 or work.held[v] > 0):
            work.held[v] = count
            status = friction(
                v, count, found, owner, work.run, before, after, rules, x, y, motion.vx,
                motion.vy, fx, fy, springs.segment, springs.force, work.energy,
            )  # fmt: skip
            if status != 0:
                return status
    work.closest[0] = closest
    return 0


@jit
def friction(
    v: int,
    count: int,
    found: Floats,
    owner: Ints,
    run: Ints,
    before: Ints,
    after: Ints,
    rules: Rules,
    x: Floats,
    y: Floats,
    vx: Floats,
    vy: Floats,
    fx: Floats,
    fy: Floats,
    held: Ints,
    spring: Floats,
    energy: Floats,
) -> int:
    """Let each contact of vertex ``v`` stick or slide; return a status.

    What a vertex touches of one stretch of a chain is one contact: its normal is that of the sum
    of its features' forces, the reaction is shared out as they are, and one spring resists sliding,

        δf_t = −k_t δu_t,   |f_t| ≤ μ f_n                                               (SP.7)

    carried along from segment to segment. Friction acts on the mid-lines; its moment is given back
    to the segments as a couple, and u_t is the displacement that does its work: zero where chain
    and vertex turn together, so that it is objective as well.

    Parameters
    ----------
    v, count : int
        Vertex, and number of its features.
    found : (FEATURES, 7)
        Of each: coefficient, overlap [m], normal (from the chain to v), the two vertices that bear
        its reaction, and the share of the second.
    owner : (FEATURES,)
        The segment it was found at.
    run : (FEATURES,)
        Room.
    held, spring : (V, SLOTS)
        Springs of the step before, replaced by those of now.
    energy : (ENERGIES,)
        Added to [J/m].
    """
    runs = 0
    for q in range(count):
        run[q] = -1
        for p in range(q):
            if _neighbours(after, owner[p], owner[q]):
                if run[q] < 0:
                    run[q] = run[p]
                elif run[p] != run[q]:  # the first and the last segments of a ring
                    gone = run[p]
                    for m in range(q):
                        if run[m] == gone:
                            run[m] = run[q]
        if run[q] < 0:
            run[q] = runs
            runs += 1
    most_slots = held.shape[1]
    for m in range(most_slots):
        if held[v, m] >= 0:
            held[v, m] = -2 - held[v, m]  # of the step before, not seen yet
    for r in range(runs):
        sx = sy = most = 0.0
        main = -1
        for q in range(count):
            if run[q] == r:
                sx += found[q, 0] * found[q, 1] * found[q, 2]
                sy += found[q, 0] * found[q, 1] * found[q, 3]
                if found[q, 1] > most:
                    main, most = owner[q], found[q, 1]
        total = np.sqrt(sx * sx + sy * sy)
        if total == 0.0:
            continue
        nx, ny = sx / total, sy / total
        tx, ty = -ny, nx

        slot, old = -1, 0.0
        for m in range(most_slots):
            if held[v, m] < -1 and _neighbours(after, -2 - held[v, m], main):
                slot, old = m, spring[v, m]
                break
        if slot < 0:
            for m in range(most_slots):
                if held[v, m] == -1:
                    slot = m
                    break
        if slot < 0:
            return TOO_MANY_RUNS

        # Displacement of v against the chain, and the lever that is left to the couple.
        ux, uy = vx[v], vy[v]
        cx = cy = turn = 0.0
        for q in range(count):
            if run[q] != r:
                continue
            share = found[q, 0] * found[q, 1] * (found[q, 2] * nx + found[q, 3] * ny) / total
            a, b, w = int(found[q, 4]), int(found[q, 5]), found[q, 6]
            ux -= share * ((1.0 - w) * vx[a] + w * vx[b])
            uy -= share * ((1.0 - w) * vy[a] + w * vy[b])
            cx += share * ((1.0 - w) * x[a] + w * x[b])
            cy += share * ((1.0 - w) * y[a] + w * y[b])
            for at in range(1 if a != b else 2):
                k = _bar(before, after, a, b, at)
                j = after[k]
                ex, ey = x[j] - x[k], y[j] - y[k]
                part = share if a != b else 0.5 * share
                cross = ex * (vy[j] - vy[k]) - ey * (vx[j] - vx[k])
                turn += part * cross / (ex * ex + ey * ey)
        lever = (x[v] - cx) * ty - (y[v] - cy) * tx
        slip = (ux * tx + uy * ty - lever * turn) * rules.step
        force = old - rules.tangential * slip
        limit = rules.friction * rules.stiffness * total
        if np.abs(force) > limit:
            force = limit if force > 0.0 else -limit
            slid = slip + (force - old) / rules.tangential
            energy[SLIDING] -= 0.5 * (old + force) * slid
        held[v, slot] = main
        spring[v, slot] = force

        fx[v] += force * tx
        fy[v] += force * ty
        for q in range(count):
            if run[q] != r:
                continue
            share = found[q, 0] * found[q, 1] * (found[q, 2] * nx + found[q, 3] * ny) / total
            a, b, w = int(found[q, 4]), int(found[q, 5]), found[q, 6]
            fx[a] -= (1.0 - w) * share * force * tx
            fy[a] -= (1.0 - w) * share * force * ty
            fx[b] -= w * share * force * tx
            fy[b] -= w * share * force * ty
            for at in range(1 if a != b else 2):
                k = _bar(before, after, a, b, at)
                j = after[k]
                ex, ey = x[j] - x[k], y[j] - y[k]
                part = share if a != b else 0.5 * share
                couple = -part * force * lever / (ex * ex + ey * ey)
                fx[j] -= couple * ey
                fy[j] += couple * ex
                fx[k] += couple * ey
                fy[k] -= couple * ex
    for m in range(most_slots):
        if held[v, m] < -1:
            energy[SEPARATION] += 0.5 * spring[v, m] * spring[v, m] / rules.tangential
            held[v, m] = -1
    return 0


@jit
def _neighbours(after: Ints, one: int, other: int) -> bool:
    """Tell whether two segments are the same or follow each other."""
    return bool(one == other or after[one] == other or after[other] == one)


@jit
def _bar(before: Ints, after: Ints, a: int, b: int, at: int) -> int:
    """Return a segment that takes the couple of a feature: its own, or those beside a = b."""
    if a != b:
        return a
    if at == 0 and before[a] >= 0:
        return int(before[a])
    return a if after[a] >= 0 else int(before[a])


@jit
def wall_forces(
    chains: Chains, rules: Rules, motion: Motion, springs: Springs, walls: Walls, work: Work
) -> None:
    """Add the forces of walls, and write the force of each to ``walls``.

    A vertex that faces another chain is seen twice on the average, once by each chain; walls see
    vertices only and are twice as stiff instead.
    """
    stiffness = 2.0 * rules.stiffness
    frictional = rules.friction > 0.0
    for w in range(walls.nx.shape[0]):
        nx, ny, at = walls.nx[w], walls.ny[w], walls.position[w]
        tx, ty = -ny, nx
        push = drive = 0.0
        for p in range(chains.start.shape[0] - 1):
            r = chains.radius[p]
            for v in range(chains.start[p], chains.start[p + 1]):
                overlap = r - (motion.x[v] * nx + motion.y[v] * ny - at)
                if overlap <= 0.0:
                    if frictional and springs.wall[w, v] != 0.0:
                        lost = springs.wall[w, v]
                        work.energy[SEPARATION] += 0.5 * lost * lost / rules.tangential
                        springs.wall[w, v] = 0.0
                    continue
                work.closest[0] = min(work.closest[0], 1.0 - overlap / r)
                force = stiffness * overlap
                push += force
                motion.fx[v] += force * nx
                motion.fy[v] += force * ny
                if rules.dashpot > 0.0:
                    speed = motion.px[v] * nx + motion.py[v] * ny - walls.velocity[w]
                    loss = -force * min(1.0, rules.dashpot * speed)
                    motion.dx[v] += loss * nx
                    motion.dy[v] += loss * ny
                    push += loss
                if frictional:
                    before = springs.wall[w, v]
                    slip = motion.vx[v] * tx + motion.vy[v] * ty - walls.slide[w]
                    slip *= rules.step
                    tangent = before - rules.tangential * slip
                    limit = rules.friction * force
                    if np.abs(tangent) > limit:
                        tangent = limit if tangent > 0.0 else -limit
                        slid = slip + (tangent - before) / rules.tangential
                        work.energy[SLIDING] -= 0.5 * (before + tangent) * slid
                    springs.wall[w, v] = tangent
                    motion.fx[v] += tangent * tx
                    motion.fy[v] += tangent * ty
                    drive += tangent
        walls.push[w] = push
        walls.drive[w] = drive


@jit
def contact_energy(
    chains: Chains, lists: Lists, rules: Rules, motion: Motion, springs: Springs, walls: Walls
) -> tuple[float, float]:
    """Return the energies [J/m] of the normal and of the tangential springs of all contacts."""
    x, y, before, after = motion.x, motion.y, chains.before, chains.after
    normal = tangential = 0.0
    for v in range(x.shape[0]):
        r = chains.radius[chains.chain[v]]
        for c in range(lists.start[v], lists.start[v + 1]):
            s, kind = lists.segment[c], lists.kind[c]
            j = after[s]
            reach = r + chains.radius[chains.chain[s]]
            overlap, _, _, _ = side(x, y, v, s, j, reach, kind)
            normal += 0.5 * rules.stiffness * overlap**2
            coefficient, overlap, _, _ = corner(x, y, v, before[s], s, j, reach, kind)
            normal += 0.5 * coefficient * rules.stiffness * overlap**2
            if after[j] < 0:
                coefficient, overlap, _, _ = corner(x, y, v, s, j, -1, reach, kind)
                normal += 0.5 * coefficient * rules.stiffness * overlap**2
        for m in range(springs.segment.shape[1]):
            if springs.segment[v, m] >= 0:
                tangential += 0.5 * springs.force[v, m] ** 2 / rules.tangential
        for w in range(walls.nx.shape[0]):
            overlap = r + walls.position[w] - (x[v] * walls.nx[w] + y[v] * walls.ny[w])
            if overlap > 0.0:
                normal += rules.stiffness * overlap**2
            tangential += 0.5 * springs.wall[w, v] ** 2 / rules.tangential
    return normal, tangential
