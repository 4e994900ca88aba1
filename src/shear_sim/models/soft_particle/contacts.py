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
from shear_sim.models.soft_particle.friction import add_virial, friction_forces
from shear_sim.models.soft_particle.state import (
    LAST,
    ONE_SIDED,
    RUNNING,
    SEPARATION,
    SLIDING,
    Cell,
    Chains,
    Lists,
    Mail,
    Motion,
    Rules,
    Springs,
    Strips,
    Walls,
    Work,
)
from shear_sim.models.soft_particle.strips import add, add_loss

EDGE = 1e-9  # of a segment
DEEPEST = -0.5  # signed distance / (r + r) behind which a ring is not touched from outside


@jit
def side(
    x: Floats, y: Floats, ux: float, uy: float, s: int, j: int, reach: float, kind: int
) -> tuple[float, float, float, float]:
    """Return overlap [m], normal and share of j where a vertex is beside the segment s–j.

    The vertex is at ``ux``, ``uy`` (its image near s–j), and ``reach`` is the distance of touching
    [m]; without contact the overlap is 0.
    """
    qx, qy = ux - x[s], uy - y[s]
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
    x: Floats, y: Floats, ux: float, uy: float, i: int, s: int, j: int, reach: float, kind: int
) -> tuple[float, float, float, float]:
    """Return coefficient, overlap [m] and normal of a vertex at vertex s between i and j.

    The vertex is at ``ux``, ``uy``. i or j may be −1, at the end of an open chain. Without contact
    the coefficient is 0. Whether it is beyond the end of a segment is asked just as in ``side``, so
    that rounding cannot count it twice, or never.
    """
    qx, qy = ux - x[s], uy - y[s]
    near = qx * qx + qy * qy
    if near >= reach * reach:
        return 0.0, 0.0, 0.0, 0.0
    coefficient = -1.0 if i >= 0 and j >= 0 else 0.0
    ax = ay = ex = ey = 0.0
    if i >= 0:
        ax, ay = x[s] - x[i], y[s] - y[i]
        along = (ux - x[i]) * ax + (uy - y[i]) * ay
        coefficient += 0.0 if along < ax * ax + ay * ay else 1.0
    if j >= 0:
        ex, ey = x[j] - x[s], y[j] - y[s]
        coefficient += 0.0 if qx * ex + qy * ey > 0.0 else 1.0
    distance = np.sqrt(near)
    toward = 1.0
    if kind == ONE_SIDED and coefficient * (ax * ey - ay * ex) < 0.0:
        toward = -1.0  # inside a convex corner, or behind a concave one
        if distance >= -DEEPEST * reach:
            return 0.0, 0.0, 0.0, 0.0
    scale = toward / distance
    return coefficient, reach - toward * distance, scale * qx, scale * qy


@jit
def find_touching(
    x: Floats, y: Floats, ex: Floats, ey: Floats, vertex: Ints, segment: Ints, kind: Ints,
    reach: Floats, sx: Floats, sy: Floats, touching: Ints,
) -> int:  # fmt: skip
    """Write which of the listed pairs of vertex and segment touch; return how many.

    Few of them do, and which is hard to guess: so all are measured without a branch, and only the
    found ones are looked at again.
    """
    count = 0
    for c in range(segment.shape[0]):
        v, s = vertex[c], segment[c]
        qx, qy = x[v] - sx[c] - x[s], y[v] - sy[c] - y[s]
        bx, by = ex[s], ey[s]
        limit = reach[c] * reach[c]
        square = bx * bx + by * by
        along = qx * bx + qy * by
        across = by * qx - bx * qy
        # Rounding may be other than where it is looked at again: that decides.
        near = (along > -EDGE * square) & (along < (1.0 + EDGE) * square)
        near &= across * across < square * limit
        near |= qx * qx + qy * qy < limit
        qx -= bx
        qy -= by
        near |= (kind[c] == LAST) & (qx * qx + qy * qy < limit)
        touching[count] = c
        count += near
    return count


@jit(_nrt=False)
def contact_forces(
    chains: Chains, lists: Lists, rules: Rules, motion: Motion, springs: Springs, cell: Cell,
    work: Work, strips: Strips, strip: int, letters: Mail,
) -> int:  # fmt: skip
    """Add the forces of the contacts that vertices of a strip have; return a status.

    Dashpots multiply the force of a feature by 1 − β ḣ⁻ (Hunt & Crossley), so that they keep the
    sums of (SP.6) and never pull. Bars are those that ``shell_forces`` left in ``work.scratch``,
    ``lists`` those of the strip.
    """
    x, y, px, py = motion.x, motion.y, motion.px, motion.py
    fx, fy, dx, dy = motion.fx, motion.fy, motion.dx, motion.dy
    after, before = chains.after, chains.before
    closest, nearest = work.closest[0], work.closest[1]
    frictional = rules.friction > 0.0
    images = cell.images[strip]
    images[:] = 0.0
    first, end = strips.vertex[strip], strips.vertex[strip + 1]
    touching = find_touching(
        x, y, work.scratch[0], work.scratch[1], lists.vertex, lists.segment, lists.kind,
        lists.reach, lists.shift[0], lists.shift[1], lists.touching,
    )  # fmt: skip
    count = 0
    for hit in range(touching):
        c = lists.touching[hit]
        v, s, kind, reach = lists.vertex[c], lists.segment[c], lists.kind[c], lists.reach[c]
        j = after[s]
        own = first <= s < end
        sx, sy = lists.shift[0][c], lists.shift[1][c]
        far = sx != 0.0 or sy != 0.0
        ux, uy = x[v] - sx, y[v] - sy
        # Beside the segment, at its first vertex, and at its second where the chain ends.
        for place in range(3 if kind == LAST else 2):
            if place == 0:
                overlap, nx, ny, w = side(x, y, ux, uy, s, j, reach, kind)
                coefficient, a, b = 1.0, s, j
            elif place == 1:
                coefficient, overlap, nx, ny = corner(x, y, ux, uy, before[s], s, j, reach, kind)
                w, a, b = 0.0, s, s
            else:
                coefficient, overlap, nx, ny = corner(x, y, ux, uy, s, j, -1, reach, kind)
                w, a, b = 0.0, j, j
            if overlap <= 0.0 or coefficient == 0.0:
                continue
            apart = 1.0 - overlap / reach
            if kind == ONE_SIDED:
                if apart < closest:
                    closest, work.near[0] = apart, v
            elif apart < nearest:
                nearest, work.near[1] = apart, v
            force = coefficient * rules.stiffness * overlap
            u = 1.0 - w
            fx[v] += force * nx
            fy[v] += force * ny
            add(own, fx, fy, a, -u * force * nx, -u * force * ny, letters, strip)
            add(own, fx, fy, b, -w * force * nx, -w * force * ny, letters, strip)
            if far:
                add_virial(images[0], force * nx, force * ny, sx, sy)
            if rules.dashpot > 0.0:
                speed = (px[v] - u * px[a] - w * px[b] - cell.strain[1] * sy) * nx
                speed += (py[v] - u * py[a] - w * py[b]) * ny
                loss = -force * min(1.0, rules.dashpot * speed)
                dx[v] += loss * nx
                dy[v] += loss * ny
                add_loss(own, dx, dy, a, -u * loss * nx, -u * loss * ny, letters, strip)
                add_loss(own, dx, dy, b, -w * loss * nx, -w * loss * ny, letters, strip)
                if far:
                    add_virial(images[1], loss * nx, loss * ny, sx, sy)
            if frictional:
                lists.place[count, 0], lists.place[count, 1] = v, s
                lists.place[count, 2], lists.place[count, 3] = a, b
                lists.found[count, 0] = coefficient * overlap
                lists.found[count, 1], lists.found[count, 2] = nx, ny
                lists.found[count, 3] = w
                lists.found[count, 5], lists.found[count, 6] = sx, sy
                count += 1
    work.closest[0], work.closest[1] = closest, nearest
    if not frictional:
        return RUNNING
    vx, vy = motion.vx, motion.vy
    if cell.size[1] > 0.0:
        vx = work.scratch[3]
    return friction_forces(
        before, after, rules, x, y, vx, vy, fx, fy, work.scratch, count, lists.place,
        lists.found, lists.run, work.held, springs.segment, springs.force, cell.strain[2],
        images, work.ledger[strip], strips, strip, letters,
    )  # fmt: skip


@jit(_nrt=False)
def wall_forces(
    chains: Chains, rules: Rules, motion: Motion, springs: Springs, walls: Walls, work: Work,
    strips: Strips, strip: int,
) -> None:  # fmt: skip
    """Add the forces of walls on a strip, and write that of each to ``strips``.

    ``chains`` and ``motion`` are those of the strip.

    A vertex that faces another chain is seen twice on the average, once by each chain; walls see
    vertices only and are twice as stiff instead.
    """
    stiffness = 2.0 * rules.stiffness
    frictional = rules.friction > 0.0
    energy, spring, first = work.ledger[strip], springs.wall, strips.vertex[strip]
    for w in range(walls.nx.shape[0]):
        nx, ny, at = walls.nx[w], walls.ny[w], walls.position[w]
        tx, ty = -ny, nx
        push = drive = lost_push = 0.0
        for p in range(chains.start.shape[0] - 1):
            r = chains.radius[p]
            for v in range(chains.start[p], chains.start[p + 1]):
                overlap = r - (motion.x[v] * nx + motion.y[v] * ny - at)
                if overlap <= 0.0:
                    if frictional and spring[w, first + v] != 0.0:
                        lost = spring[w, first + v]
                        energy[SEPARATION] += 0.5 * lost * lost / rules.tangential
                        spring[w, first + v] = 0.0
                    continue
                if 1.0 - overlap / r < work.closest[0]:
                    work.closest[0], work.near[0] = 1.0 - overlap / r, first + v
                force = stiffness * overlap
                push += force
                motion.fx[v] += force * nx
                motion.fy[v] += force * ny
                if rules.dashpot > 0.0:
                    speed = motion.px[v] * nx + motion.py[v] * ny - walls.velocity[w]
                    loss = -force * min(1.0, rules.dashpot * speed)
                    motion.dx[v] += loss * nx
                    motion.dy[v] += loss * ny
                    lost_push += loss
                if frictional:
                    before = spring[w, first + v]
                    slip = motion.vx[v] * tx + motion.vy[v] * ty - walls.slide[w]
                    slip *= rules.step
                    tangent = before - rules.tangential * slip
                    limit = rules.friction * force
                    if np.abs(tangent) > limit:
                        tangent = limit if tangent > 0.0 else -limit
                        slid = slip + (tangent - before) / rules.tangential
                        energy[SLIDING] -= 0.5 * (before + tangent) * slid
                    spring[w, first + v] = tangent
                    motion.fx[v] += tangent * tx
                    motion.fy[v] += tangent * ty
                    drive += tangent
        strips.walls[strip, 0, w] = push + lost_push
        strips.walls[strip, 1, w] = lost_push
        strips.walls[strip, 2, w] = drive


@jit
def contact_energy(
    chains: Chains, lists: Lists, rules: Rules, motion: Motion, springs: Springs, walls: Walls
) -> tuple[float, float]:
    """Return the energies [J/m] of the normal and of the tangential springs of all contacts."""
    x, y, before, after = motion.x, motion.y, chains.before, chains.after
    normal = tangential = 0.0
    for c in range(lists.segment.shape[0]):
        v, s, kind, reach = lists.vertex[c], lists.segment[c], lists.kind[c], lists.reach[c]
        j = after[s]
        ux, uy = x[v] - lists.shift[0][c], y[v] - lists.shift[1][c]
        overlap, _, _, _ = side(x, y, ux, uy, s, j, reach, kind)
        normal += 0.5 * rules.stiffness * overlap**2
        coefficient, overlap, _, _ = corner(x, y, ux, uy, before[s], s, j, reach, kind)
        normal += 0.5 * coefficient * rules.stiffness * overlap**2
        if kind == LAST:
            coefficient, overlap, _, _ = corner(x, y, ux, uy, s, j, -1, reach, kind)
            normal += 0.5 * coefficient * rules.stiffness * overlap**2
    for v in range(x.shape[0]):
        r = chains.radius[chains.chain[v]]
        for m in range(springs.segment.shape[1]):
            if springs.segment[v, m] >= 0:
                tangential += 0.5 * springs.force[v, m] ** 2 / rules.tangential
        for w in range(walls.nx.shape[0]):
            overlap = r + walls.position[w] - (x[v] * walls.nx[w] + y[v] * walls.ny[w])
            if overlap > 0.0:
                normal += rules.stiffness * overlap**2
            tangential += 0.5 * springs.wall[w, v] ** 2 / rules.tangential
    return normal, tangential
