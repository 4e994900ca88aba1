"""Friction where vertices touch segments: one spring for each place that a vertex touches."""

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit
from shear_sim.models.soft_particle.state import (
    RUNNING,
    SEPARATION,
    SLIDING,
    TOO_MANY_RUNS,
    Mail,
    Rules,
    Strips,
)
from shear_sim.models.soft_particle.strips import add


@jit(inner=True)
def friction_forces(
    before: Ints,
    after: Ints,
    rules: Rules,
    x: Floats,
    y: Floats,
    vx: Floats,
    vy: Floats,
    fx: Floats,
    fy: Floats,
    bars: tuple[Floats, ...],
    count: int,
    place: Ints,
    found: Floats,
    run: Ints,
    features: Ints,
    held: Ints,
    spring: Floats,
    rate: float,
    images: Floats,
    energy: Floats,
    strips: Strips,
    strip: int,
    letters: Mail,
) -> int:
    """Let each contact of every vertex of a strip stick or slide; return a status.

    What a vertex touches of one stretch of a chain is one contact: its normal is that of the sum
    of its features' forces, the reaction is shared out as they are, and one spring resists sliding,

        δf_t = −k_t δu_t,   |f_t| ≤ μ f_n                                               (SP.7)

    carried along from segment to segment. Friction acts on the mid-lines; its moment is given back
    to the segments as a couple, and u_t is the displacement that does its work: zero where chain
    and vertex turn together, so that it is objective as well.

    All vertices are in one call: handing over so many arrays costs more than a contact does.

    Parameters
    ----------
    bars : 3 or more of (V,)
        Vectors of all bars [m], and one over their lengths [1/m].
    count : int
        Number of features, those of one vertex after each other, vertices in order.
    place : (≥ count, 4)
        Of each: its vertex, the segment it was found at, and the two vertices that bear its
        reaction.
    found : (≥ count, 7)
        Of each: coefficient times overlap [m], normal (from the chain to the vertex), the share of
        the second vertex; room; and the displacement of the image that it is with [m].
    run : (≥ count,)
        Room.
    features : (V,)
        Number of features of every vertex in the step before, replaced by that of now.
    held, spring : (V, SLOTS)
        Springs of the step before, replaced by those of now.
    rate : float
        Mean γ̇ of the step, of a sheared cell [1/s].
    images : (2, 4)
        Added to, see ``Cell``.
    energy : (ENERGIES,)
        Added to [J/m].
    """
    ex, ey, over = bars[0], bars[1], bars[2]
    slots = held.shape[1]
    first, last = strips.vertex[strip], strips.vertex[strip + 1]
    end = 0
    for v in range(first, last):
        begin = end
        while end < count and place[end, 0] == v:
            end += 1
        if end == begin and features[v] == 0:
            continue
        features[v] = end - begin
        runs = 0
        for q in range(begin, end):
            run[q] = -1
            for p in range(begin, q):
                if _neighbours(after, place[p, 1], place[q, 1]):
                    if run[q] < 0:
                        run[q] = run[p]
                    elif run[p] != run[q]:  # the first and the last segments of a ring
                        gone = run[p]
                        for m in range(begin, q):
                            if run[m] == gone:
                                run[m] = run[q]
            if run[q] < 0:
                run[q] = runs
                runs += 1
        for m in range(slots):
            if held[v, m] >= 0:
                held[v, m] = -2 - held[v, m]  # of the step before, not seen yet
        for r in range(runs):
            sx = sy = most = 0.0
            main = -1
            for q in range(begin, end):
                if run[q] == r:
                    sx += found[q, 0] * found[q, 1]
                    sy += found[q, 0] * found[q, 2]
                    if main < 0 or np.abs(found[q, 0]) > most:
                        main, most = place[q, 1], np.abs(found[q, 0])
            total = np.sqrt(sx * sx + sy * sy)
            if total == 0.0:
                continue
            nx, ny = sx / total, sy / total
            tx, ty = -ny, nx

            slot, old = -1, 0.0
            for m in range(slots):
                if held[v, m] < -1 and _neighbours(after, -2 - held[v, m], main):
                    slot, old = m, spring[v, m]
                    break
            if slot < 0:
                for m in range(slots):
                    if held[v, m] == -1:
                        slot = m
                        break
            if slot < 0:
                return TOO_MANY_RUNS

            # Displacement of v against the chain, and the lever that is left to the couple.
            ux, uy = vx[v], vy[v]
            cx = cy = turn = 0.0
            for q in range(begin, end):
                if run[q] != r:
                    continue
                a, b, w = place[q, 2], place[q, 3], found[q, 3]
                share = found[q, 0] * (found[q, 1] * nx + found[q, 2] * ny) / total
                found[q, 4] = share
                sx, sy = found[q, 5], found[q, 6]
                ux -= share * ((1.0 - w) * vx[a] + w * vx[b] + rate * sy)
                uy -= share * ((1.0 - w) * vy[a] + w * vy[b])
                cx += share * ((1.0 - w) * x[a] + w * x[b] + sx)
                cy += share * ((1.0 - w) * y[a] + w * y[b] + sy)
                for at in range(1 if a != b else 2):
                    k = _bar(before, after, a, b, at)
                    j = after[k]
                    part = share if a != b else 0.5 * share
                    cross = ex[k] * (vy[j] - vy[k]) - ey[k] * (vx[j] - vx[k])
                    turn += part * cross * over[k] * over[k]
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
            for q in range(begin, end):
                if run[q] != r:
                    continue
                a, b, w, share = place[q, 2], place[q, 3], found[q, 3], found[q, 4]
                own = first <= a < last
                if found[q, 5] != 0.0 or found[q, 6] != 0.0:
                    add_virial(
                        images[0], share * force * tx, share * force * ty, found[q, 5], found[q, 6]
                    )
                pull = -(1.0 - w) * share * force
                add(own, fx, fy, a, pull * tx, pull * ty, letters, strip)
                pull = -w * share * force
                add(own, fx, fy, b, pull * tx, pull * ty, letters, strip)
                for at in range(1 if a != b else 2):
                    k = _bar(before, after, a, b, at)
                    j = after[k]
                    part = share if a != b else 0.5 * share
                    couple = -part * force * lever * over[k] * over[k]
                    add(own, fx, fy, j, -couple * ey[k], couple * ex[k], letters, strip)
                    add(own, fx, fy, k, couple * ey[k], -couple * ex[k], letters, strip)
        for m in range(slots):
            if held[v, m] < -1:
                energy[SEPARATION] += 0.5 * spring[v, m] * spring[v, m] / rules.tangential
                held[v, m] = -1
    return RUNNING


@jit(inner=True)
def add_virial(virial: Floats, fx: float, fy: float, sx: float, sy: float) -> None:
    """Add f_x s_x, f_x s_y, f_y s_x, f_y s_y to ``virial`` (4,) [N]."""
    virial[0] += fx * sx
    virial[1] += fx * sy
    virial[2] += fy * sx
    virial[3] += fy * sy


@jit(inner=True)
def _neighbours(after: Ints, one: int, other: int) -> bool:
    """Tell whether two segments are the same or follow each other."""
    return bool(one == other or after[one] == other or after[other] == one)


@jit(inner=True)
def _bar(before: Ints, after: Ints, a: int, b: int, at: int) -> int:
    """Return a segment that takes the couple of a feature: its own, or those beside a = b."""
    if a != b:
        return a
    if at == 0 and before[a] >= 0:
        return int(before[a])
    return a if after[a] >= 0 else int(before[a])
