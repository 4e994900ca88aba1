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
    ONE_SIDED,
    SEPARATION,
    SLIDING,
    SLOTS,
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
FEATURES = 64  # of one vertex at once


@jit(inline="always")
def features(
    chains: Chains, x: Floats, y: Floats, v: int, s: int, kind: int, found: Floats
) -> int:
    """Write the features of vertex ``v`` at segment ``s`` and its ends to ``found`` (·, 7).

    A row is: coefficient, overlap [m], normal (from the chain to v), the two vertices that carry
    the force and the share of the second. Returns the number of rows.
    """
    j = chains.after[s]
    reach = chains.radius[chains.chain[v]] + chains.radius[chains.chain[s]]
    qx, qy = x[v] - x[s], y[v] - y[s]
    ex, ey = x[j] - x[s], y[j] - y[s]
    square = ex * ex + ey * ey
    share = (qx * ex + qy * ey) / square
    count = 0
    if 0.0 < share < 1.0:
        length = np.sqrt(square)
        distance = (ey * qx - ex * qy) / length
        nx, ny = ey / length, -ex / length
        if kind != ONE_SIDED and distance < 0.0:
            distance, nx, ny = -distance, -nx, -ny
        if DEEPEST * reach < distance < reach:
            found[0, 0], found[0, 1] = 1.0, reach - distance
            found[0, 2], found[0, 3] = nx, ny
            found[0, 4], found[0, 5], found[0, 6] = s, j, share
            count = 1
    near = qx * qx + qy * qy
    if near < reach * reach:
        i = chains.before[s]
        coefficient = 1.0 if share <= 0.0 else 0.0
        side = 1.0
        if i >= 0:
            ax, ay = x[s] - x[i], y[s] - y[i]
            coefficient += (1.0 if qx * ax + qy * ay >= 0.0 else 0.0) - 1.0
            if kind == ONE_SIDED and coefficient * (ax * ey - ay * ex) < 0.0:
                side = -1.0  # inside a convex corner, or behind a concave one
        if coefficient != 0.0:
            distance = np.sqrt(near)
            if side > 0.0 or distance < -DEEPEST * reach:
                found[count, 0], found[count, 1] = coefficient, reach - side * distance
                found[count, 2], found[count, 3] = side * qx / distance, side * qy / distance
                found[count, 4], found[count, 5], found[count, 6] = s, s, 0.0
                count += 1
    if share >= 1.0 and chains.after[j] < 0:  # the open end of a chain
        qx, qy = x[v] - x[j], y[v] - y[j]
        near = qx * qx + qy * qy
        if near < reach * reach:
            distance = np.sqrt(near)
            found[count, 0], found[count, 1] = 1.0, reach - distance
            found[count, 2], found[count, 3] = qx / distance, qy / distance
            found[count, 4], found[count, 5], found[count, 6] = j, j, 0.0
            count += 1
    return count


@jit
def contact_forces(
    chains: Chains,
    lists: Lists,
    rules: Rules,
    motion: Motion,
    springs: Springs,
    work: Work,
) -> int:
    """Add the contact forces of all vertices and segments; return a status.

    With friction, what a vertex touches of one stretch of a chain is one contact: the normal is
    that of the sum of its features' forces, the reaction is shared out as they are, and one spring
    resists the sliding,

        δf_t = −k_t δu_t,   |f_t| ≤ μ f_n                                               (SP.7)

    It is carried along with the contact from segment to segment. Friction acts on the mid-lines; its
    moment is given back to the segments as a couple, and u_t is the displacement that does its
    work: zero where chain and vertex turn together.
    """
    x, y = motion.x, motion.y
    found = np.empty((FEATURES, 7))
    owner = np.empty(FEATURES, np.int32)
    frictional = rules.friction > 0.0
    closest = work.closest[0]
    for v in range(x.shape[0]):
        count = 0
        for c in range(lists.start[v], lists.start[v + 1]):
            if count + 2 > FEATURES:
                return TOO_MANY_RUNS
            s = lists.segment[c]
            more = features(chains, x, y, v, s, lists.kind[c], found[count:])
            for q in range(count, count + more):
                owner[q] = s
                reach = chains.radius[chains.chain[v]] + chains.radius[chains.chain[s]]
                closest = min(closest, 1.0 - found[q, 1] / reach)
                force = found[q, 0] * rules.stiffness * found[q, 1]
                a, b, w = int(found[q, 4]), int(found[q, 5]), found[q, 6]
                nx, ny = found[q, 2], found[q, 3]
                motion.fx[v] += force * nx
                motion.fy[v] += force * ny
                motion.fx[a] -= (1.0 - w) * force * nx
                motion.fy[a] -= (1.0 - w) * force * ny
                motion.fx[b] -= w * force * nx
                motion.fy[b] -= w * force * ny
                if rules.dashpot > 0.0:
                    ux = motion.px[v] - (1.0 - w) * motion.px[a] - w * motion.px[b]
                    uy = motion.py[v] - (1.0 - w) * motion.py[a] - w * motion.py[b]
                    # Never so fast that the contact would pull.
                    loss = -force * min(1.0, rules.dashpot * (ux * nx + uy * ny))
                    motion.dx[v] += loss * nx
                    motion.dy[v] += loss * ny
                    motion.dx[a] -= (1.0 - w) * loss * nx
                    motion.dy[a] -= (1.0 - w) * loss * ny
                    motion.dx[b] -= w * loss * nx
                    motion.dy[b] -= w * loss * ny
            count += more
        if frictional:
            status = _friction(chains, rules, motion, springs, work, v, found, owner, count)
            if status != 0:
                return status
    work.closest[0] = closest
    return 0


@jit
def _friction(
    chains: Chains,
    rules: Rules,
    motion: Motion,
    springs: Springs,
    work: Work,
    v: int,
    found: Floats,
    owner: Ints,
    count: int,
) -> int:
    """Gather the features of vertex ``v`` into contacts and let each slide or stick."""
    run = np.full(FEATURES, -1, np.int32)
    runs = 0
    for q in range(count):
        for p in range(q):
            if run[q] < 0 and _neighbours(chains, owner[p], owner[q]):
                run[q] = run[p]
            elif run[q] >= 0 and run[p] != run[q] and _neighbours(chains, owner[p], owner[q]):
                gone = run[p]  # the first and the last segment of a ring
                for m in range(q):
                    if run[m] == gone:
                        run[m] = run[q]
        if run[q] < 0:
            run[q] = runs
            runs += 1
    old_segment = springs.segment[v].copy()
    old_force = springs.force[v].copy()
    springs.segment[v, :] = -1
    slot = 0
    for r in range(runs):
        sx = sy = 0.0
        main, most = -1, 0.0
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

        before = 0.0
        for m in range(SLOTS):
            if old_segment[m] >= 0 and _neighbours(chains, old_segment[m], main):
                before = old_force[m]
                old_segment[m] = -1
                break

        # Displacement of v against the chain, and the lever that is left to the couple.
        ux, uy = motion.vx[v], motion.vy[v]
        cx = cy = turn = 0.0
        for q in range(count):
            if run[q] != r:
                continue
            share = found[q, 0] * found[q, 1] * (found[q, 2] * nx + found[q, 3] * ny) / total
            a, b, w = int(found[q, 4]), int(found[q, 5]), found[q, 6]
            ux -= share * ((1.0 - w) * motion.vx[a] + w * motion.vx[b])
            uy -= share * ((1.0 - w) * motion.vy[a] + w * motion.vy[b])
            cx += share * ((1.0 - w) * motion.x[a] + w * motion.x[b])
            cy += share * ((1.0 - w) * motion.y[a] + w * motion.y[b])
            turn += share * _turning(chains, motion, a, b)
        lever = (motion.x[v] - cx) * ty - (motion.y[v] - cy) * tx
        slip = (ux * tx + uy * ty - lever * turn) * rules.step
        force = before - rules.tangential * slip
        limit = rules.friction * rules.stiffness * total
        if np.abs(force) > limit:
            force = limit if force > 0.0 else -limit
            slid = slip + (force - before) / rules.tangential
            work.energy[SLIDING] -= 0.5 * (before + force) * slid
        if slot == SLOTS:
            return TOO_MANY_RUNS
        springs.segment[v, slot] = main
        springs.force[v, slot] = force
        slot += 1

        motion.fx[v] += force * tx
        motion.fy[v] += force * ty
        for q in range(count):
            if run[q] != r:
                continue
            share = found[q, 0] * found[q, 1] * (found[q, 2] * nx + found[q, 3] * ny) / total
            a, b, w = int(found[q, 4]), int(found[q, 5]), found[q, 6]
            motion.fx[a] -= (1.0 - w) * share * force * tx
            motion.fy[a] -= (1.0 - w) * share * force * ty
            motion.fx[b] -= w * share * force * tx
            motion.fy[b] -= w * share * force * ty
            _couple(chains, motion, a, b, -share * force * lever)
    for m in range(SLOTS):
        if old_segment[m] >= 0:
            work.energy[SEPARATION] += 0.5 * old_force[m] * old_force[m] / rules.tangential
    return 0


@jit
def _neighbours(chains: Chains, one: int, other: int) -> bool:
    """Tell whether two segments are the same or follow each other."""
    return one == other or chains.after[one] == other or chains.after[other] == one


@jit
def _bars(chains: Chains, a: int, b: int) -> tuple[int, int]:
    """Return the bars that take the couple of a feature: a–b, or those on both sides of a = b."""
    if a != b:
        return a, a
    i, j = chains.before[a], chains.after[a]
    if i < 0:
        return a, a
    if j < 0:
        return i, i
    return i, a


@jit
def _bar_turning(chains: Chains, motion: Motion, k: int) -> float:
    """Return the rate of turning [1/s] of segment ``k``."""
    j = chains.after[k]
    ex, ey = motion.x[j] - motion.x[k], motion.y[j] - motion.y[k]
    ux, uy = motion.vx[j] - motion.vx[k], motion.vy[j] - motion.vy[k]
    return float((ex * uy - ey * ux) / (ex * ex + ey * ey))


@jit
def _turning(chains: Chains, motion: Motion, a: int, b: int) -> float:
    """Return the rate of turning [1/s] of the chain at a feature, see ``_bars``."""
    one, other = _bars(chains, a, b)
    return 0.5 * (_bar_turning(chains, motion, one) + _bar_turning(chains, motion, other))


@jit
def _couple(chains: Chains, motion: Motion, a: int, b: int, moment: float) -> None:
    """Add a couple [N] to the chain at a feature, half to each of ``_bars``."""
    for k in _bars(chains, a, b):
        j = chains.after[k]
        ex, ey = motion.x[j] - motion.x[k], motion.y[j] - motion.y[k]
        per_length = 0.5 * moment / (ex * ex + ey * ey)
        motion.fx[j] -= per_length * ey
        motion.fy[j] += per_length * ex
        motion.fx[k] += per_length * ey
        motion.fy[k] -= per_length * ex


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
    normal = tangential = 0.0
    found = np.empty((4, 7))
    for v in range(motion.x.shape[0]):
        for c in range(lists.start[v], lists.start[v + 1]):
            count = features(
                chains, motion.x, motion.y, v, lists.segment[c], lists.kind[c], found
            )
            for q in range(count):
                normal += 0.5 * found[q, 0] * rules.stiffness * found[q, 1] ** 2
        for m in range(SLOTS):
            if springs.segment[v, m] >= 0:
                tangential += 0.5 * springs.force[v, m] ** 2 / rules.tangential
        for w in range(walls.nx.shape[0]):
            overlap = (
                chains.radius[chains.chain[v]]
                + walls.position[w]
                - (motion.x[v] * walls.nx[w] + motion.y[v] * walls.ny[w])
            )
            if overlap > 0.0:
                normal += rules.stiffness * overlap**2
            if springs.wall[w, v] != 0.0:
                tangential += 0.5 * springs.wall[w, v] ** 2 / rules.tangential
    return normal, tangential
