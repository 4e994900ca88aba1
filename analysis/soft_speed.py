"""Cost of a step of soft particles, part by part, in a dense packing: ns per vertex, one core.

.venv/bin/python analysis/soft_speed.py

506 rings of 24 vertices, hexagonal and pressed together by 1.5 %, each turned at random, with
cores, dashpots and four walls: half of the vertices touch another ring. Times are of the CPU, the
least of five of 300 steps each; with and without friction and links side by side.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from shear_sim.models.soft_particle import motion as steps
from shear_sim.models.soft_particle.bodies import Body, Core, Shell, ring_points
from shear_sim.models.soft_particle.contacts import contact_forces, wall_forces
from shear_sim.models.soft_particle.kernels import shell_forces
from shear_sim.models.soft_particle.links import link_forces
from shear_sim.models.soft_particle.system import System, Wall

COLUMNS, ROWS, VERTICES, THICKNESS = 22, 23, 24, 0.1
STEPS, ROUNDS = 300, 5


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


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    print("| | step, all in all | shells | contacts | walls | links | kicks and moves | lists |")
    print("| --- " * 8 + "|")
    for name, friction, linked, damped in (
        ("elastic", 0.0, False, False),
        ("with dashpots and drag", 0.0, False, True),
        ("and friction", 0.3, False, True),
        ("and links", 0.3, True, True),
    ):
        s = packed(friction, linked, damped)
        m, n, e = s.motion, len(s.motion.x), s.work.energy
        s.advance(STEPS)
        whole = least(lambda s=s: s.advance(STEPS), n, STEPS)
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
                    s.chains, s.lists, s.rules, m, s.springs, s.cell, s.work
                ),
                n,
            ),
            least(
                lambda s=s, m=m: wall_forces(s.chains, s.rules, m, s.springs, s.walls, s.work), n
            ),
            least(
                lambda s=s, m=m: link_forces(
                    s.links, m.x, m.y, s.chains.after, m.fx, m.fy, s.work.energy
                ),
                n,
            ),
            2 * least(
                lambda s=s, m=m, e=e: steps.kick(m, s.chains.mass, s.held, 0.0, 0.0, 0.0, e), n
            )
            + least(lambda m=m: steps.drift(m, 0.0), n)
            + (2 * least(lambda m=m, e=e: steps.spend(m, 0.003, 0.0, 0.0, e), n) if damped else 0.0)
            + (least(lambda s=s, m=m: steps.predict(m, s.chains.mass, 0.0, 0.0, 0.0, 0.0), n)
               if damped else 0.0),
            least(s._list, n),  # once in some hundred steps
        )  # fmt: skip
        print(
            f"| {name} | {whole:.0f} | " + " | ".join(f"{p:.1f}" for p in parts) + " |", flush=True
        )


if __name__ == "__main__":
    main()
