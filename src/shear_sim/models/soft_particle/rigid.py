"""Rigid particles: chains whose vertices move as one body.

Centre and angle are integrated like vertices are; the velocity of a vertex at half a step is its
way in the step / δt, so friction, dashpots and works see what happens.
"""

import numpy as np

from shear_sim.cell import Ints
from shear_sim.compiled import jit
from shear_sim.models.soft_particle.state import Chains, Motion, Rigid


@jit(inner=True)
def kick(
    rigid: Rigid, start: Ints, motion: Motion, drag: float, half: float, lower: int, upper: int
) -> None:
    """Change the velocities of rigid bodies by half a step ``half`` [s] of their forces.

    Here and below: of those that are chains from ``lower`` to before ``upper``.
    """
    for b in range(rigid.chain.shape[0]):
        p = rigid.chain[b]
        if not lower <= p < upper:
            continue
        fx = fy = torque = 0.0
        for k in range(start[p], start[p + 1]):
            gx = motion.fx[k] + motion.dx[k] - drag * motion.px[k]
            gy = motion.fy[k] + motion.dy[k] - drag * motion.py[k]
            fx += gx
            fy += gy
            torque += (motion.x[k] - rigid.x[b]) * gy - (motion.y[k] - rigid.y[b]) * gx
        rigid.vx[b] += half * fx / rigid.mass[b]
        rigid.vy[b] += half * fy / rigid.mass[b]
        rigid.spin[b] += half * torque / rigid.inertia[b]


@jit(inner=True)
def drift(rigid: Rigid, start: Ints, motion: Motion, dt: float, lower: int, upper: int) -> float:
    """Move rigid bodies by a step; return the largest square of a velocity [m²/s²]."""
    fastest = 0.0
    for b in range(rigid.chain.shape[0]):
        p = rigid.chain[b]
        if not lower <= p < upper:
            continue
        rigid.x[b] += dt * rigid.vx[b]
        rigid.y[b] += dt * rigid.vy[b]
        rigid.angle[b] += dt * rigid.spin[b]
        c, s = np.cos(rigid.angle[b]), np.sin(rigid.angle[b])
        for k in range(start[p], start[p + 1]):
            x = rigid.x[b] + c * rigid.armx[k] - s * rigid.army[k]
            y = rigid.y[b] + s * rigid.armx[k] + c * rigid.army[k]
            # ``motion.drift`` has moved the vertex by its velocity of the step's begin already.
            motion.vx[k] += (x - motion.x[k]) / dt
            motion.vy[k] += (y - motion.y[k]) / dt
            motion.x[k], motion.y[k] = x, y
            fastest = max(fastest, motion.vx[k] ** 2 + motion.vy[k] ** 2)
    return fastest


@jit
def carry(rigid: Rigid, start: Ints, motion: Motion, lower: int, upper: int) -> None:
    """Give the vertices of rigid bodies the velocities of the present instant."""
    for b in range(rigid.chain.shape[0]):
        p = rigid.chain[b]
        if not lower <= p < upper:
            continue
        for k in range(start[p], start[p + 1]):
            motion.vx[k] = rigid.vx[b] - rigid.spin[b] * (motion.y[k] - rigid.y[b])
            motion.vy[k] = rigid.vy[b] + rigid.spin[b] * (motion.x[k] - rigid.x[b])


def freeze_shapes(chains: Chains, motion: Motion, rigid: Ints) -> Rigid:
    """Return the rigid bodies made of the chains ``rigid`` (B,), which are held from now on.

    Velocities are those of the rigid motion with the same momenta.
    """
    count = len(rigid)
    body = Rigid(np.asarray(rigid, np.int32), *np.zeros((8, count)), *np.zeros((2, len(motion.x))))
    for b, p in enumerate(rigid):
        part = slice(int(chains.start[p]), int(chains.start[p + 1]))
        m, x, y = chains.mass[part], motion.x[part], motion.y[part]
        vx, vy = motion.vx[part], motion.vy[part]
        body.mass[b] = m.sum()
        body.x[b], body.y[b] = (m * x).sum() / m.sum(), (m * y).sum() / m.sum()
        body.vx[b], body.vy[b] = (m * vx).sum() / m.sum(), (m * vy).sum() / m.sum()
        body.armx[part], body.army[part] = x - body.x[b], y - body.y[b]
        body.inertia[b] = (m * (body.armx[part] ** 2 + body.army[part] ** 2)).sum()
        spin = (m * (body.armx[part] * vy - body.army[part] * vx)).sum()
        body.spin[b] = spin / body.inertia[b]
        motion.free_x[part] = motion.free_y[part] = 0.0
    carry(body, chains.start, motion, 0, len(chains.closed))
    return body
