"""Steps in time: velocity Verlet, with the work of every force as it is done.

With v at half steps and x, F at whole ones, K_n = ½ Σ m v_{n−½}·v_{n+½} obeys

    K_{n+1} − K_n = Σ ½ (F_n + F_{n+1})·(x_{n+1} − x_n)                                    (SP.9)

to round-off. So every force that stores nothing has its work summed by this same rule, half at each
end of a step, and what is missing from the sum of all energies is the error of that rule for
the conservative ones alone: of second order in δt, and not growing with time.
"""

import numpy as np

from shear_sim.compiled import jit
from shear_sim.models.soft_particle.contacts import contact_forces, wall_forces
from shear_sim.models.soft_particle.kernels import shell_forces
from shear_sim.models.soft_particle.state import (
    DAMPING,
    DRAG,
    IMPOSED,
    LISTS_USED_UP,
    NOT_FINITE,
    RUNNING,
    TOO_FAST,
    Chains,
    Lists,
    Motion,
    Rules,
    Springs,
    Walls,
    Work,
)


@jit
def apply_forces(
    chains: Chains,
    lists: Lists,
    rules: Rules,
    motion: Motion,
    springs: Springs,
    walls: Walls,
    work: Work,
    damped: bool,
) -> int:
    """Write all forces of the present positions; return a status."""
    shell_forces(
        chains, motion.x, motion.y, motion.px, motion.py, motion.fx, motion.fy, motion.dx,
        motion.dy, work.energy, work.scratch, damped,
    )  # fmt: skip
    for k in range(motion.x.shape[0]):
        motion.fx[k] += motion.gx[k]
        motion.fy[k] += motion.gy[k]
        if not damped:
            motion.dx[k] = 0.0
            motion.dy[k] = 0.0
    status = contact_forces(chains, lists, rules, motion, springs, work)
    wall_forces(chains, rules, motion, springs, walls, work)
    return status


@jit
def march(
    chains: Chains,
    lists: Lists,
    rules: Rules,
    motion: Motion,
    springs: Springs,
    walls: Walls,
    work: Work,
    steps: int,
    room: float,
    leap: float,
    damped: bool,
) -> tuple[int, int]:
    """Make ``steps`` steps, or as many as the lists are good for.

    Parameters
    ----------
    room : float
        Displacement of any vertex that the lists allow for [m].
    leap : float
        Longest way of a vertex in one step, beyond which it could pass a segment unseen [m].
    damped : bool
        Whether chains have dashpots.

    Returns
    -------
    done, status : int
        Whole steps made, after each of which positions, velocities and forces are of one time.
    """
    x, y, vx, vy = motion.x, motion.y, motion.vx, motion.vy
    fx, fy, dx, dy = motion.fx, motion.fy, motion.dx, motion.dy
    mass = chains.mass
    vertices = x.shape[0]
    planes = walls.nx.shape[0]
    dt, drag = rules.step, rules.drag
    half = 0.5 * dt
    lossy = damped or rules.dashpot > 0.0 or drag > 0.0
    energy = work.energy
    for step in range(steps):
        if 2.0 * work.travelled[0] > room:
            return step, LISTS_USED_UP
        fastest = 0.0
        for k in range(vertices):
            ax = (fx[k] + dx[k] - drag * motion.px[k]) / mass[k] * motion.free_x[k]
            ay = (fy[k] + dy[k] - drag * motion.py[k]) / mass[k] * motion.free_y[k]
            vx[k] += half * ax
            vy[k] += half * ay
            x[k] += dt * vx[k]
            y[k] += dt * vy[k]
            fastest = max(fastest, vx[k] * vx[k] + vy[k] * vy[k])
            if lossy:
                energy[DAMPING] -= half * (dx[k] * vx[k] + dy[k] * vy[k])
                energy[DRAG] += half * drag * (motion.px[k] * vx[k] + motion.py[k] * vy[k])
            if motion.free_x[k] == 0.0:
                energy[IMPOSED] -= half * (fx[k] + dx[k] - drag * motion.px[k]) * vx[k]
            if motion.free_y[k] == 0.0:
                energy[IMPOSED] -= half * (fy[k] + dy[k] - drag * motion.py[k]) * vy[k]
            motion.px[k] = vx[k] + half * ax
            motion.py[k] = vy[k] + half * ay
        if not np.isfinite(fastest):
            return step, NOT_FINITE
        if fastest * dt * dt > leap * leap:
            return step, TOO_FAST
        work.travelled[0] += dt * np.sqrt(fastest)
        for w in range(planes):
            if walls.mass[w] > 0.0:
                net = walls.load[w] - walls.push[w] - walls.damping[w] * walls.velocity[w]
                walls.velocity[w] += half * net / walls.mass[w]
            walls.position[w] += dt * walls.velocity[w]
            power = walls.push[w] * walls.velocity[w] + walls.drive[w] * walls.slide[w]
            walls.work[w] += half * power

        status = apply_forces(chains, lists, rules, motion, springs, walls, work, damped)

        for k in range(vertices):
            gx = fx[k] + dx[k] - drag * motion.px[k]
            gy = fy[k] + dy[k] - drag * motion.py[k]
            if lossy:
                energy[DAMPING] -= half * (dx[k] * vx[k] + dy[k] * vy[k])
                energy[DRAG] += half * drag * (motion.px[k] * vx[k] + motion.py[k] * vy[k])
            if motion.free_x[k] == 0.0:
                energy[IMPOSED] -= half * gx * vx[k]
            if motion.free_y[k] == 0.0:
                energy[IMPOSED] -= half * gy * vy[k]
            vx[k] += half * gx / mass[k] * motion.free_x[k]
            vy[k] += half * gy / mass[k] * motion.free_y[k]
        for w in range(planes):
            power = walls.push[w] * walls.velocity[w] + walls.drive[w] * walls.slide[w]
            walls.work[w] += half * power
            if walls.mass[w] > 0.0:
                net = walls.load[w] - walls.push[w] - walls.damping[w] * walls.velocity[w]
                walls.velocity[w] += half * net / walls.mass[w]
        if status != RUNNING:
            return step + 1, status
    return steps, RUNNING
