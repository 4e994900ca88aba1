"""Steps in time: velocity Verlet, with the work of every force as it is done.

With v at half steps and x, F at whole ones, K_n = ½ Σ m v_{n−½}·v_{n+½} obeys

    K_{n+1} − K_n = Σ ½ (F_n + F_{n+1})·(x_{n+1} − x_n)                                    (SP.9)

to round-off. So every force that stores nothing has its work summed by this same rule, half at each
end of a step, and what is missing from the sum of all energies is the error of that rule for
the conservative ones alone: of second order in δt, and not growing with time.
"""

import numpy as np

from shear_sim.cell import Floats, Ints
from shear_sim.compiled import jit
from shear_sim.models.soft_particle import rigid as bodies
from shear_sim.models.soft_particle.contacts import contact_forces, wall_forces
from shear_sim.models.soft_particle.kernels import shell_forces
from shear_sim.models.soft_particle.links import link_forces
from shear_sim.models.soft_particle.pairs import shift_images
from shear_sim.models.soft_particle.state import (
    DAMPING,
    DRAG,
    IMPOSED,
    LISTS_USED_UP,
    NOT_FINITE,
    RUNNING,
    SHEARING,
    TOO_FAST,
    Cell,
    Chains,
    Links,
    Lists,
    Mail,
    Motion,
    Rigid,
    Rules,
    Springs,
    Strips,
    Walls,
    Work,
)
from shear_sim.models.soft_particle.strips import (
    chains_of,
    lists_of,
    motion_of,
    rows_of,
    take_in,
)
from shear_sim.threads import meet

ENOUGH = 0.8  # of the room of the lists: beyond, new ones cost less than to look again and again


@jit(inner=True)
def own_forces(
    chains: Chains, motion: Motion, cell: Cell, work: Work, strips: Strips, strip: int, damped: bool
) -> None:
    """Write what a strip does to itself: the forces of shells and cores, and imposed ones."""
    own, vertices, scratch = chains, motion, work.scratch
    if strips.vertex.shape[0] > 2:
        own, vertices = chains_of(chains, strips, strip), motion_of(motion, strips, strip)
        scratch = rows_of(work.scratch, strips, strip)
    fx, fy, dx, dy = vertices.fx, vertices.fy, vertices.dx, vertices.dy
    shell_forces(
        own, vertices.x, vertices.y, vertices.px, vertices.py, fx, fy, dx, dy, work.ledger[strip],
        scratch, damped,
    )  # fmt: skip
    for k in range(fx.shape[0]):
        fx[k] += vertices.gx[k]
        fy[k] += vertices.gy[k]
        if not damped:
            dx[k] = 0.0
            dy[k] = 0.0
    if cell.size[1] > 0.0:  # the velocities that friction sees
        flow = scratch[3]
        for k in range(fx.shape[0]):
            flow[k] = vertices.vx[k] + cell.strain[2] * vertices.free_x[k] * vertices.y[k]


@jit(inner=True)
def pair_forces(
    chains: Chains,
    lists: Lists,
    rules: Rules,
    motion: Motion,
    springs: Springs,
    links: Links,
    walls: Walls,
    cell: Cell,
    work: Work,
    strips: Strips,
    strip: int,
    mail: Mail,
) -> None:
    """Add the forces of links, contacts and walls that a strip finds."""
    own, vertices, pairs = chains, motion, lists
    if strips.vertex.shape[0] > 2:
        own, vertices = chains_of(chains, strips, strip), motion_of(motion, strips, strip)
        pairs = lists_of(lists, strip)
    mail.sent[strip, 0] = 0
    if cell.size[1] > 0.0:
        shift_images(pairs, cell)
    link_forces(
        links, motion.x, motion.y, chains.after, motion.fx, motion.fy, work.ledger[strip], strips,
        strip, mail,
    )  # fmt: skip
    strips.status[strip] = contact_forces(
        chains, pairs, rules, motion, springs, cell, work, strips, strip, mail
    )
    wall_forces(own, rules, vertices, springs, walls, work, strips, strip)


@jit(inner=True)
def add_up(motion: Motion, walls: Walls, strips: Strips, mail: Mail) -> int:
    """Take in the mail, and write the forces of all strips on ``walls``; return the status."""
    take_in(motion, strips, mail)
    status = RUNNING
    for strip in range(strips.status.shape[0]):
        status = max(status, strips.status[strip])
    for w in range(walls.nx.shape[0]):
        walls.push[w] = walls.loss[w] = walls.drive[w] = 0.0
        for strip in range(strips.status.shape[0]):
            walls.push[w] += strips.walls[strip, 0, w]
            walls.loss[w] += strips.walls[strip, 1, w]
            walls.drive[w] += strips.walls[strip, 2, w]
    return status


@jit
def kick(motion: Motion, mass: Floats, drag: float, rate: float, half: float) -> None:
    """Change velocities by half a step ``half`` [s] of the forces.

    ``rate`` is γ̇ [1/s] of the flow that the predicted velocities contain and drag is against.
    """
    vx, vy, px, py = motion.vx, motion.vy, motion.px, motion.py
    fx, fy, dx, dy = motion.fx, motion.fy, motion.dx, motion.dy
    for k in range(vx.shape[0]):
        scale = half / mass[k]
        vx[k] += scale * motion.free_x[k] * (fx[k] + dx[k] - drag * (px[k] - rate * motion.y[k]))
        vy[k] += scale * motion.free_y[k] * (fy[k] + dy[k] - drag * py[k])


@jit(inner=True)
def impose(
    motion: Motion, held: Ints, begin: int, end: int, drag: float, half: float, energy: Floats
) -> None:
    """Add half a step of the work of imposed velocities, of ``held`` from ``begin`` to ``end``."""
    for q in range(begin, end):
        k = held[q]
        if motion.free_x[k] == 0.0:
            force = motion.fx[k] + motion.dx[k] - drag * motion.px[k]
            energy[IMPOSED] -= half * force * motion.vx[k]
        if motion.free_y[k] == 0.0:
            force = motion.fy[k] + motion.dy[k] - drag * motion.py[k]
            energy[IMPOSED] -= half * force * motion.vy[k]


@jit
def spend(motion: Motion, drag: float, rate: float, half: float, energy: Floats) -> None:
    """Add half a step of what dashpots and drag take at the present half-step velocity."""
    vx, vy, px, py, dx, dy = motion.vx, motion.vy, motion.px, motion.py, motion.dx, motion.dy
    even = odd = 0.0  # two chains of sums: each addition waits for the one before
    for k in range(0, vx.shape[0] - 1, 2):
        even += dx[k] * vx[k] + dy[k] * vy[k]
        odd += dx[k + 1] * vx[k + 1] + dy[k + 1] * vy[k + 1]
    if vx.shape[0] % 2 == 1:
        k = vx.shape[0] - 1
        even += dx[k] * vx[k] + dy[k] * vy[k]
    energy[DAMPING] -= half * (even + odd)
    if drag > 0.0:
        even = 0.0
        for k in range(vx.shape[0]):
            even += (px[k] - rate * motion.y[k]) * vx[k] + py[k] * vy[k]
        energy[DRAG] += half * drag * even


@jit
def drift(motion: Motion, dt: float) -> float:
    """Move all vertices by a step; return the largest square of a velocity [m²/s²].

    Those of rigid bodies are put in their places afterwards, by ``rigid.drift``.
    """
    x, y, vx, vy = motion.x, motion.y, motion.vx, motion.vy
    fastest = 0.0
    for k in range(x.shape[0]):
        x[k] += dt * vx[k]
        y[k] += dt * vy[k]
        fastest = max(fastest, vx[k] * vx[k] + vy[k] * vy[k])
    return fastest


@jit
def predict(
    motion: Motion, mass: Floats, drag: float, before: float, rate: float, half: float
) -> None:
    """Predict velocities of the end of the step, for dashpots, with the accelerations before it.

    They contain the flow of a sheared cell, whose rate was ``before`` and is ``rate`` now [1/s].
    """
    vx, vy, px, py = motion.vx, motion.vy, motion.px, motion.py
    fx, fy, dx, dy = motion.fx, motion.fy, motion.dx, motion.dy
    for k in range(vx.shape[0]):
        scale = half / mass[k]
        flow = rate * motion.free_x[k] * motion.y[k]
        pull = fx[k] + dx[k] - drag * (px[k] - before * motion.y[k])
        px[k] = vx[k] + scale * motion.free_x[k] * pull + flow
        py[k] = vy[k] + scale * motion.free_y[k] * (fy[k] + dy[k] - drag * py[k])


@jit
def shear_positions(motion: Motion, mass: Floats, strain: float) -> float:
    """Shear all vertices by ``strain``, and what they move against the flow; return the work [J/m].

    It is the change of kinetic energy; the work of forces follows from the stress. Held vertices
    stay with the line y = 0 of the cell.
    """
    x, y, vx, vy = motion.x, motion.y, motion.vx, motion.vy
    work = 0.0
    for k in range(x.shape[0]):
        x[k] += strain * motion.free_x[k] * y[k]
        after = vx[k] - strain * vy[k]
        work += 0.5 * mass[k] * (after * after - vx[k] * vx[k])
        vx[k] = after
    return work


@jit
def virial(motion: Motion, images: Floats) -> tuple[float, float]:
    """Return Σ f_x y over all pairs that act on each other [N], of forces and of dashpots.

    Forces on held vertices act at the line y = 0.
    """
    forces, dashpots = -images[0, 1], -images[1, 1]
    for k in range(motion.y.shape[0]):
        lever = motion.free_x[k] * motion.y[k]
        forces += motion.fx[k] * lever
        dashpots += motion.dx[k] * lever
    return forces, dashpots


@jit
def farthest(x: Floats, y: Floats, x0: Floats, y0: Floats, strain: float) -> float:
    """Return the largest distance [m] of all vertices from where they were, but for ``strain``."""
    most = 0.0
    for k in range(x.shape[0]):
        most = max(most, (x[k] - x0[k] - strain * y0[k]) ** 2 + (y[k] - y0[k]) ** 2)
    return float(np.sqrt(most))


@jit(nogil=True, _nrt=False)
def march(
    chains: Chains,
    lists: Lists,
    rules: Rules,
    motion: Motion,
    springs: Springs,
    links: Links,
    rigid: Rigid,
    held: Ints,
    walls: Walls,
    cell: Cell,
    work: Work,
    strips: Strips,
    mail: Mail,
    steps: int,
    room: float,
    leap: float,
    damped: bool,
) -> tuple[int, int]:
    """Make ``steps`` steps, or as many as the lists are good for.

    Parameters
    ----------
    steps : int
        0: only write the forces of the present positions.
    held : (H,)
        Vertices with an imposed velocity.
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
    planes = walls.nx.shape[0]
    dt, drag = rules.step, rules.drag
    half = 0.5 * dt
    periodic = cell.size[1] > 0.0
    lossy = damped or rules.dashpot > 0.0 or drag > 0.0
    lower, upper = strips.lower, strips.upper
    several = strips.vertex.shape[0] > 2
    if steps == 0:
        for s in range(lower, upper):
            own_forces(chains, motion, cell, work, strips, s, damped)
        meet(strips.meeting, strips.threads)
        for s in range(lower, upper):
            pair_forces(
                chains, lists, rules, motion, springs, links, walls, cell, work, strips, s, mail
            )
        meet(strips.meeting, strips.threads)
        return 0, add_up(motion, walls, strips, mail)
    for step in range(steps):
        if 2.0 * work.travelled[0] > room:
            # Far less than the sum of the longest steps, where particles shake.
            sheared = cell.strain[0] - lists.strain[0]
            for s in range(lower, upper):
                a, b = strips.vertex[s], strips.vertex[s + 1]
                strips.farthest[s] = farthest(
                    motion.x[a:b], motion.y[a:b], lists.x[a:b], lists.y[a:b], sheared
                )
            meet(strips.meeting, strips.threads)
            # NumPy's max needs what this kernel is compiled without, unless found compiled already.
            work.travelled[0] = 0.0
            for s in range(strips.farthest.shape[0]):
                work.travelled[0] = max(work.travelled[0], strips.farthest[s])
            work.travelled[0] += 0.5 * np.abs(sheared) * lists.span[0]
            if 2.0 * work.travelled[0] > ENOUGH * room:
                return step, LISTS_USED_UP
        rate = cell.strain[1]
        strain = 0.0
        if periodic:
            phase = cell.wave[1] * dt
            cell.steps[0] += 1
            new = cell.wave[0] * np.sin(phase * cell.steps[0])
            strain = new - cell.strain[0]
            cell.strain[0] = new
            cell.strain[1] = cell.wave[0] * cell.wave[1] * np.cos(phase * cell.steps[0])
            cell.strain[2] = strain / dt
            work.travelled[0] += 0.5 * np.abs(strain) * lists.span[0]

        for s in range(lower, upper):
            own, mass, energy = motion, chains.mass, work.ledger[s]
            if several:
                own = motion_of(motion, strips, s)
                mass = mass[strips.vertex[s] : strips.vertex[s + 1]]
            one, end = strips.chain[s], strips.chain[s + 1]
            kick(own, mass, drag, rate, half)
            impose(motion, held, strips.held[s], strips.held[s + 1], drag, half, energy)
            bodies.kick(rigid, chains.start, motion, drag, half, one, end)
            if periodic:
                pulled, lost = virial(own, cell.images[s])
                energy[SHEARING] -= 0.5 * strain * (pulled + lost)
                energy[DAMPING] -= 0.5 * strain * lost
                if lossy:
                    spend(own, drag, rate, half, energy)
                energy[SHEARING] += shear_positions(own, mass, 0.5 * strain)
            fastest = drift(own, dt)
            strips.fastest[s] = max(
                fastest, bodies.drift(rigid, chains.start, motion, dt, one, end)
            )
            if periodic:
                energy[SHEARING] += shear_positions(own, mass, 0.5 * strain)
            if lossy:
                if not periodic:
                    spend(own, drag, rate, half, energy)
                predict(own, mass, drag, rate, cell.strain[1], half)
        for s in range(lower, upper):
            own_forces(chains, motion, cell, work, strips, s, damped)
        meet(strips.meeting, strips.threads)

        fastest = 0.0
        for s in range(strips.fastest.shape[0]):
            fastest = max(fastest, strips.fastest[s])
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
        settle(walls, strips, half, work)
        for s in range(lower, upper):
            pair_forces(
                chains, lists, rules, motion, springs, links, walls, cell, work, strips, s, mail
            )
        meet(strips.meeting, strips.threads)

        status = add_up(motion, walls, strips, mail)
        for s in range(lower, upper):
            own, mass, energy = motion, chains.mass, work.ledger[s]
            if several:
                own = motion_of(motion, strips, s)
                mass = mass[strips.vertex[s] : strips.vertex[s + 1]]
            if lossy:
                spend(own, drag, cell.strain[1], half, energy)
            if periodic:
                pulled, lost = virial(own, cell.images[s])
                energy[SHEARING] -= 0.5 * strain * (pulled + lost)
                energy[DAMPING] -= 0.5 * strain * lost
            kick(own, mass, drag, cell.strain[1], half)
            impose(motion, held, strips.held[s], strips.held[s + 1], drag, half, energy)
            one, end = strips.chain[s], strips.chain[s + 1]
            bodies.kick(rigid, chains.start, motion, drag, half, one, end)
            bodies.carry(rigid, chains.start, motion, one, end)
        settle(walls, strips, half, work)
        for w in range(planes):
            if walls.mass[w] > 0.0:
                net = walls.load[w] - walls.push[w] - walls.damping[w] * walls.velocity[w]
                walls.velocity[w] += half * net / walls.mass[w]
        if status != RUNNING:
            return step + 1, status
    return steps, RUNNING


@jit(inner=True)
def settle(walls: Walls, strips: Strips, half: float, work: Work) -> None:
    """Add half a step of the work of walls, and of what their dashpots take."""
    for w in range(walls.nx.shape[0]):
        power = walls.push[w] * walls.velocity[w] + walls.drive[w] * walls.slide[w]
        walls.work[w] += half * power
        if strips.thread == 0:
            work.ledger[0, DAMPING] += half * walls.loss[w] * walls.velocity[w]
