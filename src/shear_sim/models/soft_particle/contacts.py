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
def features(
    after: Ints,
    before: Ints,
    x: Floats,
    y: Floats,
    reach: float,
    v: int,
    s: int,
    kind: int,
    found: Floats,
    base: int,
) -> int:
    """Write the features of vertex ``v`` at segment ``s`` and its ends to ``found`` (·, 7).

    A row is: coefficient, overlap [m], normal (from the chain to v), the two vertices that carry
    the force and the share of the second. ``reach`` is the distance of touching [m], ``base`` the
    first row to be written. Returns the number of rows that are written now, ``base`` included.
    """
    j = after[s]
    qx, qy = x[v] - x[s], y[v] - y[s]
    ex, ey = x[j] - x[s], y[j] - y[s]
    square = ex * ex + ey * ey
    along = qx * ex + qy * ey
    if 0.0 < along < square:
        length = np.sqrt(square)
        distance = (ey * qx - ex * qy) / length
        nx, ny = ey / length, -ex / length
        if kind != ONE_SIDED and distance < 0.0:
            distance, nx, ny = -distance, -nx, -ny
        if DEEPEST * reach < distance < reach:
            found[base, 0], found[base, 1] = 1.0, reach - distance
            found[base, 2], found[base, 3] = nx, ny
            found[base, 4], found[base, 5], found[base, 6] = s, j, along / square
            base += 1
    near = qx * qx + qy * qy
    if near < reach * reach:
        i = before[s]
        coefficient = 1.0 if along <= 0.0 else 0.0
        side = 1.0
        if i >= 0:
            ax, ay = x[s] - x[i], y[s] - y[i]
            coefficient += (1.0 if qx * ax + qy * ay >= 0.0 else 0.0) - 1.0
            if kind == ONE_SIDED and coefficient * (ax * ey - ay * ex) < 0.0:
                side = -1.0  # inside a convex corner, or behind a concave one
        distance = np.sqrt(near)
        if coefficient != 0.0 and (side > 0.0 or distance < -DEEPEST * reach):
            found[base, 0], found[base, 1] = coefficient, reach - side * distance
            found[base, 2], found[base, 3] = side * qx / distance, side * qy / distance
            found[base, 4], found[base, 5], found[base, 6] = s, s, 0.0
            base += 1
    if along >= square and after[j] < 0:  # the open end of a chain
        qx, qy = x[v] - x[j], y[v] - y[j]
        near = qx * qx + qy * qy
        if near < reach * reach:
            distance = np.sqrt(near)
            found[base, 0], found[base, 1] = 1.0, reach - distance
            found[base, 2], found[base, 3] = qx / distance, qy / distance
            found[base, 4], found[base, 5], found[base, 6] = j, j, 0.0
            base += 1
    return base


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
    closest = work.closest[0]
    frictional = rules.friction > 0.0
    for v in range(x.shape[0]):
        count = 0
        for c in range(lists.start[v], lists.start[v + 1]):
            s = lists.segment[c]
            reach = radius[chain[v]] + radius[chain[s]]
            first = count
            count = features(
                chains.after, chains.before, x, y, reach, v, s, lists.kind[c], found, first
            )
            if count + 3 > FEATURES:
                return TOO_MANY_RUNS
            for q in range(first, count):
                owner[q] = s
                closest = min(closest, 1.0 - found[q, 1] / reach)
                force = found[q, 0] * rules.stiffness * found[q, 1]
                a, b, w = int(found[q, 4]), int(found[q, 5]), found[q, 6]
                nx, ny = found[q, 2], found[q, 3]
                fx[v] += force * nx
                fy[v] += force * ny
                fx[a] -= (1.0 - w) * force * nx
                fy[a] -= (1.0 - w) * force * ny
                fx[b] -= w * force * nx
                fy[b] -= w * force * ny
                if rules.dashpot > 0.0:
                    ux = px[v] - (1.0 - w) * px[a] - w * px[b]
                    uy = py[v] - (1.0 - w) * py[a] - w * py[b]
                    loss = -force * min(1.0, rules.dashpot * (ux * nx + uy * ny))
                    dx[v] += loss * nx
                    dy[v] += loss * ny
                    dx[a] -= (1.0 - w) * loss * nx
                    dy[a] -= (1.0 - w) * loss * ny
                    dx[b] -= w * loss * nx
                    dy[b] -= w * loss * ny
        if frictional and (count > 0 or work.held[v] > 0):
            work.held[v] = count
            status = friction(
                v, count, found, owner, work.run, chains.before, chains.after, rules, x, y,
                motion.vx, motion.vy, fx, fy, springs.segment, springs.force, work.energy,
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
        Vertex, and number of rows of ``found`` and ``owner``, see ``features``.
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
        total = np.hypot(sx, sy)
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
            for side in range(2):
                k = _bar(before, after, a, b, side)
                j = after[k]
                ex, ey = x[j] - x[k], y[j] - y[k]
                cross = ex * (vy[j] - vy[k]) - ey * (vx[j] - vx[k])
                turn += 0.5 * share * cross / (ex * ex + ey * ey)
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
            for side in range(2):
                k = _bar(before, after, a, b, side)
                j = after[k]
                ex, ey = x[j] - x[k], y[j] - y[k]
                couple = -0.5 * share * force * lever / (ex * ex + ey * ey)
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
def _bar(before: Ints, after: Ints, a: int, b: int, side: int) -> int:
    """Return a segment that takes half the couple of a feature: its own, or those beside a = b."""
    if a != b:
        return a
    if side == 0 and before[a] >= 0:
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
    for w in range(walls.nx.shape[0]):
        nx, ny, at = walls.nx[w], walls.ny[w], walls.position[w]
        tx, ty = -ny, nx
        push = drive = 0.0
        for p in range(chains.start.shape[0] - 1):
            r = chains.radius[p]
            for v in range(chains.start[p], chains.start[p + 1]):
                overlap = r - (motion.x[v] * nx + motion.y[v] * ny - at)
                if overlap <= 0.0:
                    if springs.wall[w, v] != 0.0:
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
                if rules.friction > 0.0:
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
    x, y = motion.x, motion.y
    normal = tangential = 0.0
    found = np.empty((4, 7))
    for v in range(x.shape[0]):
        r = chains.radius[chains.chain[v]]
        for c in range(lists.start[v], lists.start[v + 1]):
            s = lists.segment[c]
            count = features(
                chains.after, chains.before, x, y, r + chains.radius[chains.chain[s]], v, s,
                lists.kind[c], found, 0,
            )  # fmt: skip
            for q in range(count):
                normal += 0.5 * found[q, 0] * rules.stiffness * found[q, 1] ** 2
        for m in range(springs.segment.shape[1]):
            if springs.segment[v, m] >= 0:
                tangential += 0.5 * springs.force[v, m] ** 2 / rules.tangential
        for w in range(walls.nx.shape[0]):
            overlap = r + walls.position[w] - (x[v] * walls.nx[w] + y[v] * walls.ny[w])
            if overlap > 0.0:
                normal += rules.stiffness * overlap**2
            tangential += 0.5 * springs.wall[w, v] ** 2 / rules.tangential
    return normal, tangential
