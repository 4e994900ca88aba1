"""A system of soft particles that is asked to go on: what is between the kernels and a scenario."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.models.interface import SimulationError
from shear_sim.models.soft_particle.balance import Budget
from shear_sim.models.soft_particle.bodies import Body, assemble
from shear_sim.models.soft_particle.bounds import (
    free_walls,
    frequency_of,
    highest_damping,
    highest_frequency,
    wall_step,
)
from shear_sim.models.soft_particle.checks import finite, not_negative, places, positive, whole
from shear_sim.models.soft_particle.contacts import DEEPEST, contact_energy
from shear_sim.models.soft_particle.guards import misshapen, unstable_bar, unstable_wall
from shear_sim.models.soft_particle.kernels import ring_area, shell_energy
from shear_sim.models.soft_particle.links import glue, link_energy, no_links
from shear_sim.models.soft_particle.motion import march
from shear_sim.models.soft_particle.pairs import near_segments
from shear_sim.models.soft_particle.rigid import freeze_shapes
from shear_sim.models.soft_particle.stability import LARGEST, at_most, damped_share
from shear_sim.models.soft_particle.state import (
    BEND_YIELD,
    BROKEN,
    DAMPING,
    DRAG,
    GAS,
    HOLLOW,
    IMPOSED,
    LISTS_USED_UP,
    NOT_FINITE,
    RUNNING,
    SEPARATION,
    SHEARING,
    SLIDING,
    STRETCH_YIELD,
    TOO_FAST,
    Rules,
    Walls,
    springs,
    work,
)
from shear_sim.models.soft_particle.state import cell as no_cell
from shear_sim.models.soft_particle.strips import divide, in_threads, mail, sort_links
from shear_sim.models.soft_particle.walls import Wall, check_walls

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]
Integers = NDArray[np.integer[Any]]

FRACTION = 0.2  # of the longest stable step
SHORTER = "a smaller integrator.step, or slower walls (relative_rate)"
NO_IMAGES = "a sheared cell has no links or rigid particles: hold vertices instead"
#: Of a two-sided contact, distance / distance of touching: in one step, in which two vertices move
#: by a quarter of that each, nothing goes through unseen.
NEAREST = 0.25
SKIN, WIDEST = 2.0, 6.0  # room of the lists at first, and at most / least half thickness
SHORT, LONG = 50, 200  # steps that lists last, under which the next have more room, over which less


class System:
    """Bodies and walls in motion.

    Parameters
    ----------
    bodies : sequence of Body
    walls : sequence of Wall
    stiffness : float
        k_n of contacts between chains [N/m²].
    tangential : float, optional
        k_t; default k_n.
    friction : float
        Coulomb's μ.
    contact_damping : float
        Fraction of critical of a contact of full overlap.
    drag : float
        Force of a vertex per velocity [N s/m²].
    step : float, optional
        δt [s]; default a fifth of the longest stable one.
    cell : (float, float), optional
        Width and height of a periodic cell [m], see ``shear``; no walls then.

    Raises
    ------
    BodyError
        If a body is none, or where another one is.
    ValueError
        If a number or a wall means nothing, a body is behind one, or the step is not stable.
    SimulationError
        If a wall is too light for the step and for what touches it, here or later.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        walls: Sequence[Wall] = (),
        *,
        stiffness: float,
        tangential: float | None = None,
        friction: float = 0.0,
        contact_damping: float = 0.0,
        drag: float = 0.0,
        step: float | None = None,
        cell: tuple[float, float] | None = None,
    ) -> None:
        positive(stiffness=stiffness)
        if tangential is not None:
            positive(tangential=tangential)
        not_negative(friction=friction, contact_damping=contact_damping, drag=drag)
        if cell is not None:
            positive(cell=cell)
        self.chains, self.motion = assemble(bodies, cell)
        if walls and cell is not None:
            msg = "a cell has no walls: leave one of both out, or hold vertices instead"
            raise ValueError(msg)
        check_walls(walls, self.chains.chain, self.motion.x, self.motion.y)
        self._first_length = self.chains.rest_length.copy()
        self.stable_step = 2.0 / highest_frequency(
            self.chains, self.motion.x, self.motion.y, stiffness
        )
        vertices = len(self.motion.x)
        thin = float(self.chains.radius.min())
        mass = float(self.chains.mass.min())
        self.rules = Rules(
            stiffness,
            stiffness if tangential is None else tangential,
            friction,
            contact_damping * math.sqrt(mass / stiffness) / thin,
            drag,
            0.0,
        )
        table = np.array([tuple(wall) for wall in walls], float).reshape(-1, 8)
        self.walls = Walls(*table.T.copy(), *np.zeros((4, len(table))))
        if step is None:
            step = min(FRACTION * self.stable_step, LARGEST * self.longest_step())
            for w in free_walls(self.walls):
                longest = wall_step(self.chains, self.motion, self.walls, stiffness, w)
                step = min(step, LARGEST * longest)
        self._check_step(step, self.stable_step)
        self.rules = self.rules._replace(step=step)
        self.springs = springs(vertices, len(table))
        self.strips = divide(self.chains, len(table))
        strips = len(self.strips.status)
        self.work = work(vertices, strips)
        self.cell = no_cell(strips) if cell is None else no_cell(strips, *cell)
        self.links = no_links()
        self.rigid = freeze_shapes(self.chains, self.motion, np.zeros(0, np.int32))
        self.held = np.zeros(0, np.int32)
        self.threads = 1
        self.skin = SKIN * thin
        self._listed = 0
        self.leap = 0.5 * thin
        self.steps = 0
        chains = self.chains
        dashpots = (chains.stretch_damping, chains.bend_damping, chains.inner_damping)
        self.damped = any(bool(of_chain.any()) for of_chain in dashpots)
        self.begin()

    def begin(self) -> None:
        """Take the present state as the start of the energy balance."""
        self._list()
        at_once = self.rules._replace(step=0.0)  # so that no spring is stretched by it
        self._forces(at_once)
        self.work.energy[:] = 0.0
        self.work.ledger[:] = 0.0
        self.walls.work[:] = 0.0
        self._by_forces = self._by_pressure = 0.0
        self._x0, self._y0 = self.motion.x.copy(), self.motion.y.copy()
        self._at_start = 0.0
        self._at_start = self._stored_and_kinetic()

    def _forces(self, rules: Rules) -> None:
        flow = self.cell.strain[1] * self.motion.free_x * self.motion.y
        self.motion.px[:] = self.motion.vx + flow
        self.motion.py[:] = self.motion.vy
        _, status = self._march(rules, 0)
        self._guard(status)

    def _march(self, rules: Rules, steps: int) -> tuple[int, int]:
        return in_threads(
            self.threads, self.strips, self.walls, self.cell, self.work,
            lambda strips, walls, cell, work: march(
                self.chains, self.lists, rules, self.motion, self.springs, self.links, self.rigid,
                self.held, walls, cell, work, strips, self.mail, steps, self.skin, self.leap,
                self.damped,
            ),
        )  # fmt: skip

    def _list(self) -> None:
        self.lists = near_segments(
            self.chains, self.motion.x, self.motion.y, self.skin, self.cell, self.strips,
            self.threads,
        )  # fmt: skip
        self.mail = mail(self.lists, self.strips)
        if len(self.held):  # which the flow of the cell leaves behind
            self.lists.span[0] += np.abs(self.motion.y[self.held]).max()
        self.work.travelled[0] = 0.0

    def _tune(self) -> None:
        """Change the room of the next lists, which changes no result, so that they last."""
        lasted, self._listed = self.steps - self._listed, self.steps
        thin = float(self.chains.radius.min())
        if self.cell.size[1] > 0.0:  # whose images must not come too near
            return
        if lasted < SHORT:
            self.skin = min(1.5 * self.skin, WIDEST * thin)
        elif lasted > LONG:
            self.skin = max(self.skin / 1.5, SKIN * thin)

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self.steps * self.rules.step

    def advance(self, steps: int) -> None:
        """Make ``steps`` steps.

        Raises
        ------
        ValueError
            If that is no whole number from 0 on.
        SimulationError
            If a guard stops the run; says which particle and what to do.
        """
        whole(steps=steps)
        target = self.steps + int(steps)
        while self.steps < target:
            done, status = self._march(self.rules, target - self.steps)
            self.steps += done
            if status == LISTS_USED_UP:
                status = RUNNING
                self._tune()
                self._list()
            self._guard(status)

    def shear(self, amplitude: float, frequency: float) -> None:
        """Shear the cell from now on by γ(t) = ``amplitude`` sin ωt, ω = 2π ``frequency`` [1/s].

        Held vertices stay where they are, as a plate at y = 0 that has its image at y = H.

        Raises
        ------
        ValueError
            If there is no cell, or links or rigid particles, which know no images.
        """
        finite(amplitude=amplitude)
        positive(frequency=frequency)
        if not self.cell.size.all():
            msg = "there is no cell to be sheared: cell = (width, height)"
            raise ValueError(msg)
        if len(self.links.vertex) or len(self.rigid.chain):
            raise ValueError(NO_IMAGES)
        self.cell.wave[:] = amplitude, 2.0 * math.pi * frequency
        self.cell.steps[0] = 0
        self.cell.strain[:] = 0.0, amplitude * self.cell.wave[1], 0.0
        self.begin()

    def stress(self) -> FloatArray:
        """Return σ_xx, σ_xy, σ_yx, σ_yy [Pa] of the cell, compression positive, dashpots included.

        Forces on held vertices act at the line y = 0: σ_xy and σ_yy are those on a plate / width.
        """
        m, mass = self.motion, self.chains.mass
        fx, fy, lever = m.fx + m.dx, m.fy + m.dy, m.free_y * m.y
        sums = np.array(
            [
                (fx * m.x + mass * m.vx * m.vx).sum(), (fx * lever + mass * m.vx * m.vy).sum(),
                (fy * m.x + mass * m.vy * m.vx).sum(), (fy * lever + mass * m.vy * m.vy).sum(),
            ]
        )  # fmt: skip
        images = self.cell.images.sum(axis=0).sum(axis=0)
        return np.asarray((sums - images) / self.cell.size.prod())

    def shrink(self, factor: float) -> None:
        """Bring chains nearer to each other, and the edges of the cell, without a change of shape.

        Parameters
        ----------
        factor : float
            All distances of their centres are multiplied by this.
        """
        positive(factor=factor)
        chains, motion = self.chains, self.motion
        count = np.diff(chains.start)
        for place in (motion.x, motion.y):
            centre = np.add.reduceat(place, chains.start[:-1]) / count
            place += np.repeat((factor - 1.0) * centre, count)
        self.cell.size[:] *= factor
        self._list()
        self._forces(self.rules._replace(step=0.0))

    def hold(self, vertices: IndexArray, vx: float | None = 0.0, vy: float | None = 0.0) -> None:
        """Impose the velocity [m/s] of ``vertices``, in x, y or both (None: free).

        Call ``begin`` afterwards, if an energy balance is wanted.

        Raises
        ------
        ValueError
            If there is no such vertex, it is of a rigid particle, or a velocity is not finite.
        """
        motion = self.motion
        places(len(motion.x), vertices=vertices)
        imposed = {"vx": vx, "vy": vy}
        finite(**{name: value for name, value in imposed.items() if value is not None})
        self._not_both(np.asarray(vertices), self.rigid.chain)
        for free, speeds, value in ((motion.free_x, motion.vx, vx), (motion.free_y, motion.vy, vy)):
            free[vertices] = 0.0 if value is not None else 1.0
            if value is not None:
                speeds[vertices] = value
        moved = (motion.free_x == 0.0) | (motion.free_y == 0.0)
        moved &= ~np.isin(self.chains.chain, self.rigid.chain)
        self.held = np.flatnonzero(moved).astype(np.int32)
        first = np.searchsorted(self.held, self.strips.vertex).astype(np.int32)
        self.strips = self.strips._replace(held=first)

    def make_rigid(self, particles: IndexArray) -> None:
        """Let ``particles`` move as rigid bodies from now on; see ``hold`` for ``begin``.

        Those that are rigid already stay so; all take up the present velocities of their vertices.

        Raises
        ------
        ValueError
            If there is no such particle, one is named twice, or one has held vertices, or the
            cell is sheared.
        """
        places(len(self.chains.closed), particles=particles)
        self._not_sheared()
        more = np.asarray(particles, np.int32)
        named, times = np.unique(more, return_counts=True)
        if (times > 1).any():
            msg = f"particles names {named[times > 1][0]} more than once: name each once"
            raise ValueError(msg)
        self._not_both(self.held, more)
        rigid = self.rigid.chain
        both = np.concatenate([rigid, more[~np.isin(more, rigid)]])
        self.rigid = freeze_shapes(self.chains, self.motion, both)

    def _not_both(self, held: Integers, rigid: Integers) -> None:
        """Refuse vertices that would be ``held``, and of one of the particles ``rigid``."""
        both = held[np.isin(self.chains.chain[held], rigid)] if held.size else held
        if both.size:
            k = int(both.flat[0])
            msg = (
                f"vertex {k} of particle {self.chains.chain[k]} cannot be held where the particle "
                "is rigid: hold all its vertices instead of make_rigid, or load them"
            )
            raise ValueError(msg)

    def _not_sheared(self) -> None:
        if self.cell.wave[1] > 0.0:
            raise ValueError(NO_IMAGES)

    def glue(self, reach: float, **law: Any) -> None:
        """Link the particles within ``reach`` [m], see ``links.glue``; see ``hold`` for ``begin``.

        Raises
        ------
        ValueError
            If none are, or two that are to be linked are not, or the step is too long with links,
            or there are links already, or the cell is sheared.
        """
        self._not_sheared()
        if len(self.links.vertex):
            msg = "there are links already: glue all at once, with a larger reach or more between"
            raise ValueError(msg)
        links = glue(self.chains, self.motion.x, self.motion.y, reach, **law)
        highest = (2.0 / self.stable_step) ** 2
        # Two links at a vertex or segment, with at most 2 k each.
        highest += 4.0 * float(links.law[:2].max()) / float(self.chains.mass.min())
        stable_step = 2.0 / math.sqrt(highest)
        self._check_step(self.rules.step, stable_step)
        self.stable_step = stable_step
        self.links, self.strips = sort_links(links, self.strips)
        self.mail = mail(self.lists, self.strips)

    def load(self, vertices: IndexArray, fx: float = 0.0, fy: float = 0.0) -> None:
        """Add a constant force [N/m] to each of ``vertices`` from now on.

        The energy balance goes on: the work of each load is counted from its own start.

        Raises
        ------
        ValueError
            If there is no such vertex, or a force is not finite.
        """
        motion = self.motion
        places(len(motion.x), vertices=vertices)
        finite(fx=fx, fy=fy)
        kinetic = self.kinetic()
        self._by_forces = self._work_of_forces()
        self._x0, self._y0 = motion.x.copy(), motion.y.copy()
        for imposed, force, added in ((motion.gx, motion.fx, fx), (motion.gy, motion.fy, fy)):
            imposed[vertices] += added
            force[vertices] += added
        self._at_start += self.kinetic() - kinetic  # as that of (SP.9) is one of forces too

    def _work_of_forces(self) -> float:
        """Return the work [J/m] of imposed forces since ``begin``."""
        m = self.motion
        return self._by_forces + float((m.gx * (m.x - self._x0) + m.gy * (m.y - self._y0)).sum())

    def press(self, p: int, pressure: float) -> None:
        """Set the pressure p₀ [Pa] of the core of ring ``p`` from now on.

        What the core stores more or less by that at once is work ``by_pressure`` of the budget.

        Raises
        ------
        ValueError
            If it has no core: that of one without stiffness is ``Core("drained")``; or if the step
            is not stable with this pressure.
        """
        self._closed(p)
        (positive if self.chains.core_law[p] == GAS else finite)(pressure=pressure)
        if self.chains.core_law[p] == HOLLOW:
            msg = f"particle {p} has no core to be pressed: Core('drained'), say"
            raise ValueError(msg)
        before, stored = float(self.chains.core_pressure[p]), self._core_energy(p)
        self.chains.core_pressure[p] = pressure
        # A step may be nine tenths of the longest, and the bound changes a little with the shape.
        m, chains, stiffness = self.motion, self.chains, self.rules.stiffness
        stable = 2.0 / frequency_of(chains, p, m.x, m.y, stiffness)
        longest = self.longest_step(stable) / LARGEST
        if self.rules.step > longest:
            self.chains.core_pressure[p] = before
            msg = (
                f"pressure = {pressure:g} Pa makes the step of {self.rules.step:g} s unstable: "
                f"steps of {at_most(longest)} s at most"
            )
            raise ValueError(msg)
        self._by_pressure += self._core_energy(p) - stored
        kinetic = self.kinetic()
        self._forces(self.rules._replace(step=0.0))
        self._at_start += self.kinetic() - kinetic  # as that of (SP.9) is one of forces too

    def _core_energy(self, p: int) -> float:
        return float(shell_energy(self.chains, self.motion.x, self.motion.y, p)[2])

    def area(self, p: int) -> float:
        """Return the area [m²] inside ring ``p``, to the mid-line."""
        self._closed(p)
        first, end = self.chains.start[p : p + 2]
        return float(ring_area(self.motion.x, self.motion.y, first, end))

    def _closed(self, p: int) -> None:
        places(len(self.chains.closed), p=p)
        if self.chains.closed[p] == 0:
            msg = f"particle {p} is open: only a ring has an inside"
            raise ValueError(msg)

    def damped_step(self, deepest: float = 0.0) -> float:
        """Return a step [s] that is stable with the dashpots too, whatever moves, Eq. (SP.10).

        ``deepest``: of all contacts [m], as their dashpots grow with their overlaps.
        """
        return self.stable_step * self._damped_share(self.stable_step, deepest)

    def _damped_share(self, stable_step: float, deepest: float = 0.0) -> float:
        contact = self.rules.stiffness * self.rules.dashpot * deepest
        rate = highest_damping(self.chains, self.rules.drag, contact)
        return damped_share((2.0 / stable_step) ** 2, rate)

    def longest_step(self, stable_step: float | None = None) -> float:
        """Return the longest step [s] that is accepted: contacts do not touch yet.

        ``stable_step``: without dashpots, by default that of now.
        """
        stable = self.stable_step if stable_step is None else stable_step
        return stable * min(LARGEST, self._damped_share(stable))

    def _check_step(self, step: float, stable_step: float) -> None:
        longest = self.longest_step(stable_step)
        if not 0.0 < step <= longest:
            msg = (
                f"step = {step:g} s is none, or not stable with these springs and dashpots: at "
                f"most {at_most(longest)}"
            )
            raise ValueError(msg)

    def divide(self, time: float, share: float) -> int:
        """Let a whole number of steps, which is returned, make ``time`` [s].

        ``share``: of the longest one that is stable without dashpots, at most.

        Raises
        ------
        ValueError
            If one is not over 0, or the step is not stable.
        """
        positive(time=time, share=share)
        self._check_step(share * self.stable_step, self.stable_step)
        steps = math.ceil(time / (share * self.stable_step) * (1.0 - 1e-9))
        self.rules = self.rules._replace(step=time / steps)
        return steps

    def _guard(self, status: int) -> None:
        """Stop if the state means nothing any more."""
        problem, m = "", self.motion
        if status == NOT_FINITE or not np.isfinite(m.x.sum() + m.y.sum()):
            lost = ~np.isfinite(m.x + m.y + m.vx + m.vy)
            where = self._vertex(int(lost.argmax())) if lost.any() else "a vertex"
            problem = f"the position of {where} is not finite: {SHORTER}{self._damped()}"
        elif status == TOO_FAST:
            problem = (
                f"{self._vertex(int((m.vx**2 + m.vy**2).argmax()))} moves by more than half its "
                f"radius in one step: {SHORTER}, or less load{self._damped()}"
            )
        elif status != RUNNING:
            problem = (
                f"{self._vertex(int(self.work.held.argmax()))} touches too many segments: larger "
                "segments, or thinner shells"
            )
        elif self.work.closest[0] < 0.5 * DEEPEST or self.work.closest[1] < NEAREST:
            which = 0 if self.work.closest[0] < 0.5 * DEEPEST else 1
            problem = (
                f"{self._vertex(int(self.work.near[which]))} went through a segment or a wall: a "
                f"larger model.contact_stiffness, {SHORTER}{self._damped()}"
            )
        else:
            problem = (
                unstable_wall(self.chains, m, self.walls, self.rules)
                or misshapen(self.chains, self._first_length, m.x, m.y)
                or unstable_bar(self.chains, self._first_length, m, self.rules, self.stable_step)
            )
        if problem:
            msg = f"stopped at t = {self.time:.6g} s (step {self.steps}): {problem}"
            raise SimulationError(msg)

    def _damped(self) -> str:
        """Return what to do where dashpots may be what makes the step unstable."""
        deepest = max(0.0, 1.0 - float(self.work.closest.min())) * 2.0 * self.chains.radius.max()
        stable = self.damped_step(deepest)
        if self.rules.step <= stable:
            return ""
        share = min(LARGEST, stable / self.stable_step)
        return (
            "; with these dashpots a step is surely stable up to integrator.step = "
            f"{at_most(share)}: that, or less damping or contact_damping"
        )

    def _vertex(self, k: int) -> str:
        return f"a vertex of particle {self.chains.chain[k]}"

    def stop(self) -> None:
        """Set all velocities to zero."""
        self.motion.vx[:] = self.motion.vy[:] = 0.0
        body = self.rigid
        body.vx[:] = body.vy[:] = body.spin[:] = 0.0

    def kinetic(self) -> float:
        """Return ½ Σ m v_{n−½}·v_{n+½} [J/m], the kinetic energy that (SP.9) balances."""
        m, mass, dt = self.motion, self.chains.mass, self.rules.step
        drag = self.rules.drag
        body = self.rigid
        rigid = 0.5 * float(
            (body.mass * (body.vx**2 + body.vy**2) + body.inertia * body.spin**2).sum()
        )
        loose = ~np.isin(self.chains.chain, body.chain)
        against = m.px - self.cell.strain[1] * m.y
        ax = m.free_x * (m.fx + m.dx - drag * against) / mass
        ay = m.free_y * (m.fy + m.dy - drag * m.py) / mass
        square = m.vx**2 + m.vy**2 - 0.25 * dt**2 * (ax**2 + ay**2)
        return rigid + 0.5 * float((mass * square)[loose].sum())

    def particle_energies(self) -> FloatArray:
        """Return the energy (N,) [J/m] stored in bars, hinges and core of each particle."""
        return np.asarray(self._shell_energies().sum(axis=1))

    def _shell_energies(self) -> FloatArray:
        return np.array(
            [
                shell_energy(self.chains, self.motion.x, self.motion.y, p)
                for p in range(len(self.chains.closed))
            ]
        )

    def stored(self) -> tuple[float, ...]:
        """Return the energies [J/m] of bars, hinges, cores, normal, tangential springs, links."""
        parts = self._shell_energies().sum(axis=0)
        contact = contact_energy(
            self.chains, self.lists, self.rules, self.motion, self.springs, self.walls
        )
        link = link_energy(self.links, self.motion.x, self.motion.y, self.chains.after)
        return (*map(float, parts), *contact, link)

    def _stored_and_kinetic(self) -> float:
        return sum(self.stored()) + self.kinetic()

    def budget(self) -> Budget:
        """Return the energy balance since the start."""
        energy = self.work.energy
        forces = self._work_of_forces()
        walls, imposed = float(self.walls.work.sum()), float(energy[IMPOSED])
        shear = float(energy[SHEARING])
        lost = (
            energy[STRETCH_YIELD], energy[BEND_YIELD], energy[SLIDING], energy[SEPARATION],
            energy[DAMPING], energy[DRAG], energy[BROKEN],
        )  # fmt: skip
        kinetic, stored = self.kinetic(), self.stored()
        work = (walls, forces, imposed, shear, self._by_pressure)
        missing = sum(work) - sum(lost) - kinetic - sum(stored) + self._at_start
        return Budget(*map(float, (kinetic, *stored, *work, *lost, missing)))
