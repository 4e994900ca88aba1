"""Cost of a step of soft particles, part by part, in a dense packing: ns per vertex, one core.

.venv/bin/python analysis/soft_speed.py

506 rings of 24 vertices, hexagonal and pressed together by 1.5 %, each turned at random, with
cores, dashpots and four walls: three vertices of ten touch another ring at the start, one of seven
when they are timed. Times are of the CPU, the least of five of 300 steps each; with and without
friction and links side by side. The limit is what the divisions, roots, vector operations, single
stores and memory of our method take at least, where nothing waits for anything, as
`analysis/benchmarks/limit.py` measures this machine.

Then the wall time of one and of two threads, for which two cores must be idle.
"""

import argparse
import copy
import os
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from benchmarks.limit import Machine, measure

from shear_sim.models.soft_particle import motion as steps
from shear_sim.models.soft_particle import strips
from shear_sim.models.soft_particle.bodies import Body, Core, Shell, ring_points
from shear_sim.models.soft_particle.contacts import contact_forces, find_touching, wall_forces
from shear_sim.models.soft_particle.kernels import shell_forces
from shear_sim.models.soft_particle.links import link_forces
from shear_sim.models.soft_particle.system import System
from shear_sim.models.soft_particle.walls import Wall

COLUMNS, ROWS, VERTICES, THICKNESS = 22, 23, 24, 0.1
STEPS, ROUNDS = 300, 5
#: Steps that are timed at once, and how often in a row with each number of threads; how often all.
BLOCK, TURNS, PASSES = 100, 3, 5

#: The packings: with friction, links, dashpots.
PACKINGS = {
    "elastic": (0.0, False, False),
    "with dashpots and drag": (0.0, False, True),
    "and friction": (0.3, False, True),
    "and links": (0.3, True, True),
}


class Count(NamedTuple):
    """What is to be done once, counted in the code of the kernels."""

    divisions: int
    roots: int
    operations: int  # others, of vectors
    stores: int  # of single numbers
    numbers: int  # read from memory or written to it


#: Of a vertex: bars, hinges and core; two kicks and a move; four walls. Of its dashpots.
VERTEX, DASHPOTS = Count(6, 1, 85 + 38 + 20, 0, 56), Count(1, 0, 72, 0, 6)
#: Of a listed pair of vertex and segment; of one that touches, and of friction there; of a link.
LISTED, TOUCHING = Count(0, 0, 30, 1, 5), Count(3, 2, 55, 6, 0)
FRICTION, LINK = Count(3, 1, 110, 23, 0), Count(8, 3, 90, 12, 12)


def limit(system: System, machine: Machine) -> float:
    """Return the least time of a step [ns per vertex]."""
    vertices = len(system.motion.x)
    listed = len(system.lists.vertex) / vertices
    touching = find_touching(
        system.motion.x, system.motion.y, system.work.scratch[0], system.work.scratch[1],
        system.lists.vertex, system.lists.segment, system.lists.kind, system.lists.reach,
        system.lists.shift[0], system.lists.shift[1], system.lists.touching,
    ) / vertices  # fmt: skip
    counts = [(1.0, VERTEX), (listed, LISTED), (touching, TOUCHING)]
    counts += [(1.0, DASHPOTS)] if system.damped else []
    counts += [(touching, FRICTION)] if system.rules.friction > 0.0 else []
    counts += [(len(system.links.vertex) / vertices, LINK)]
    numbers = sum(share * count.numbers for share, count in counts)
    size = np.log(8.0 * numbers * vertices)
    memory = 8.0 * numbers * float(np.interp(size, np.log(machine.sizes), machine.byte))
    work = sum(
        share
        * (
            count.divisions * machine.division
            + count.roots * machine.root
            + count.operations * machine.operation
            + count.stores * machine.store
        )
        for share, count in counts
    )
    return 1e9 * max(work, memory)


def packed(friction: float, linked: bool, damped: bool = True) -> System:
    rng = np.random.default_rng(0)
    elastic = Shell.of_material(1.0, THICKNESS)
    loss = 0.2 if damped else 0.0
    shell = Shell(elastic.stretch, elastic.bend, stretch_damping=loss, bend_damping=loss)
    spacing = (2.0 + THICKNESS) * 0.985
    height = spacing * np.sqrt(3) / 2
    bodies = []
    for row in range(ROWS):
        for column in range(COLUMNS):
            turn = rng.uniform(0, 2 * np.pi)
            matrix = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
            centre = np.array([(column + 0.5 * (row % 2)) * spacing, row * height])
            points = ring_points(VERTICES, 1.0) @ matrix + centre
            bodies.append(Body(points, True, THICKNESS / 2, 1.0, shell, Core("log", 0.05)))
    edge = 1.0 + THICKNESS / 2
    walls = [
        Wall(1, 0, -edge), Wall(-1, 0, -((COLUMNS - 0.5) * spacing + edge)), Wall(0, 1, -edge),
        Wall(0, -1, -((ROWS - 1) * height + edge)),
    ]  # fmt: skip
    system = System(
        bodies, walls, stiffness=0.4 * shell.stretch / (2 * np.sin(np.pi / VERTICES)),
        friction=friction, contact_damping=0.3 if damped else 0.0, drag=0.003 if damped else 0.0,
    )  # fmt: skip
    if linked:
        system.glue(0.1, normal=0.01, tangential=0.01)
        system.begin()
    return system


def least(call: Callable[[], object], vertices: int, calls: int = 1) -> float:
    """Least CPU time [ns per vertex and call] of several."""
    call()
    best = np.inf
    for _ in range(ROUNDS * (1 if calls > 1 else 8)):
        began = time.process_time()
        call()
        best = min(best, time.process_time() - began)
    return best / calls / vertices * 1e9


def of_one_strip(friction: float, linked: bool, damped: bool) -> System:
    """Return a packing whose kernels work on all of it at once."""
    most, strips.MOST = strips.MOST, 1
    system = packed(friction, linked, damped)
    strips.MOST = most
    return system


def by_threads(systems: list[System]) -> list[dict[int, float]]:
    """Return the wall times [ns per vertex and step] of each packing on one and on two threads.

    Both make the same ``STEPS`` steps in turns, in blocks; the least times of the blocks are added.
    All packings are timed again and again, as the second core of a shared machine can be slow for
    seconds.
    """
    if len(os.sched_getaffinity(0)) < 2:
        msg = "two threads need two cores: this process has one"
        raise SystemExit(msg)
    least = np.full((len(systems), 2, STEPS // BLOCK), np.inf)
    for _ in range(PASSES):
        for system, times in zip(systems, least, strict=True):
            start = system
            for block in range(STEPS // BLOCK):
                ends = set()
                for _ in range(TURNS):
                    for threads in (1, 2):
                        twin = copy.deepcopy(start)
                        twin.threads = threads
                        began = time.perf_counter()
                        twin.advance(BLOCK)
                        spent = time.perf_counter() - began
                        times[threads - 1, block] = min(times[threads - 1, block], spent)
                        ends.add(twin.motion.x.tobytes())
                if len(ends) > 1:
                    msg = "two threads end elsewhere than one"
                    raise SystemExit(msg)
                start = twin
    sums = least.sum(axis=-1) / STEPS * 1e9
    return [
        {threads: times[threads - 1] / len(system.motion.x) for threads in (1, 2)}
        for system, times in zip(systems, sums, strict=True)
    ]


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    machine = measure()
    heads = ("step, all in all", "limit", "shells", "contacts", "walls", "links", "kicks and moves")
    print("| | " + " | ".join((*heads, "lists")) + " |")
    print("| --- " * (len(heads) + 2) + "|")
    systems = []
    for name, (friction, linked, damped) in PACKINGS.items():
        s = packed(friction, linked, damped)
        n = len(s.motion.x)
        s.advance(STEPS)
        whole = least(lambda s=s: s.advance(STEPS), n, STEPS)
        bound = limit(s, machine)
        systems.append(copy.deepcopy(s))
        s = of_one_strip(friction, linked, damped)
        s.advance(STEPS)
        m, e = s.motion, s.work.energy
        parts = (
            least(
                lambda s=s, m=m: shell_forces(
                    s.chains, m.x, m.y, m.px, m.py, m.fx, m.fy, m.dx, m.dy, s.work.energy,
                    s.work.scratch, s.damped,
                ),
                n,
            ),
            least(
                lambda s=s, m=m: contact_forces(
                    s.chains, s.lists, s.rules, m, s.springs, s.cell, s.work, s.strips, 0, s.mail
                ),
                n,
            ),
            least(
                lambda s=s, m=m: wall_forces(
                    s.chains, s.rules, m, s.springs, s.walls, s.work, s.strips, 0
                ),
                n,
            ),
            least(
                lambda s=s, m=m: link_forces(
                    s.links, m.x, m.y, s.chains.after, m.fx, m.fy, s.work.energy, s.strips, 0,
                    s.mail,
                ),
                n,
            ),
            2 * least(lambda s=s, m=m: steps.kick(m, s.chains.mass, 0.0, 0.0, 0.0), n)
            + least(lambda m=m: steps.drift(m, 0.0), n)
            + (2 * least(lambda m=m, e=e: steps.spend(m, 0.003, 0.0, 0.0, e), n) if damped else 0.0)
            + (least(lambda s=s, m=m: steps.predict(m, s.chains.mass, 0.0, 0.0, 0.0, 0.0), n)
               if damped else 0.0),
            least(s._list, n),  # once in some hundred steps
        )  # fmt: skip
        cells = [f"{whole:.0f}", f"{bound:.0f}", *(f"{part:.1f}" for part in parts)]
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)
    print("\n| wall time | one thread | two threads | ratio |\n| --- | --- | --- | --- |")
    for name, times in zip(PACKINGS, by_threads(systems), strict=True):
        print(f"| {name} | {times[1]:.0f} | {times[2]:.0f} | {times[1] / times[2]:.2f} |")


if __name__ == "__main__":
    main()
