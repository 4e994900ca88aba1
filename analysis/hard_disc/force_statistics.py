"""Statistics of forces and collisions of hard discs sheared at fixed pressure.

.venv/bin/python analysis/hard_disc/force_statistics.py       # 1 minute of one core

256 discs at p ξ₀/γ̇ = 10 and 100: the distribution of forces over their mean, of the strain between
collisions over its mean (dashed: collisions at random), of the jumps of the stress at collisions,
and of the life of contacts. Draws analysis/figures/hard_disc_statistics.png.
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shear_sim.figures import style
from shear_sim.models.hard_disc.active_set import Drive
from shear_sim.models.hard_disc.flow import Flow, contacts_at
from shear_sim.models.hard_disc.packing import make_start
from shear_sim.models.hard_disc.parameters import HardDisc, HardDiscPacking
from shear_sim.models.hard_disc.stress import stress
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]

DISCS, TRANSIENT, STRAIN = 256, 0.2, 0.3
PRESSURES = (10.0, 100.0)
SAMPLE = 0.002  # of strain between two looks at all forces


def measure(pressure: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return forces / mean, waits / mean, jumps of σ / mean σ, lives of contacts [strain]."""
    packing = HardDiscPacking(discs=DISCS, packing_fraction=0.79)
    start = make_start(packing, HardDisc(), Streams(1, 0))
    drive = Drive(1.0, 10.0, pressure, np.zeros((2, DISCS)))
    flow = Flow(start.x, start.y, start.radius, start.mobility, start.width, start.height, drive)
    flow.advance(TRANSIENT)
    forces: list[FloatArray] = []
    waits: list[float] = []
    jumps: list[float] = []
    lives: list[float] = []
    stresses: list[float] = []
    born: dict[tuple[int, int], float] = {}
    last, sampled = flow.path, flow.path
    while flow.path < TRANSIENT + STRAIN:
        collisions = flow.counts.collisions
        before: list[float] = []

        def look(motion, _, step):
            before.append(-stress(contacts_at(motion, step))[1])  # noqa: B023

        flow.step(TRANSIENT + STRAIN, look)
        contacts = flow.contacts()
        now = set(zip(contacts.i.tolist(), contacts.j.tolist(), strict=True))
        lives += [flow.path - born.pop(pair) for pair in [p for p in born if p not in now]]
        if flow.counts.collisions > collisions:
            waits.append(flow.path - last)
            last = flow.path
            jumps.append(-stress(contacts)[1] - before[-1])
            born |= dict.fromkeys(now - born.keys(), flow.path) if len(waits) > 1 else {}
        if flow.path > sampled + SAMPLE:
            force = contacts.phi * np.hypot(contacts.rx, contacts.ry)
            forces.append(force / force.mean())
            stresses.append(-stress(contacts)[1])
            sampled = flow.path
    return (
        np.concatenate(forces), np.array(waits) / np.mean(waits),
        np.array(jumps) / np.mean(stresses), np.array(lives),
    )  # fmt: skip


def density(values: FloatArray, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return middles of bins and the density there, where any value is."""
    count, _ = np.histogram(values, edges)
    middle = np.sqrt(edges[1:] * edges[:-1])
    kept = count > 0
    return middle[kept], (count / np.diff(edges) / len(values))[kept]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=Path("analysis/figures"), help="of figures")
    given = parser.parse_args()
    labels = (
        (r"force $f/\langle f\rangle$", 1e-2, 1e1),
        ("strain between collisions / mean", 1e-3, 2e1),
        (r"jump of the stress $\Delta\sigma/\langle\sigma\rangle$", 1e-5, 1e0),
        ("life of a contact [strain]", 1e-6, 1e0),
    )
    with style.figure(style.DOUBLE, 4.4) as figure:
        axes = figure.subplots(2, 2).flatten()
        for turn, pressure in enumerate(PRESSURES):
            found = measure(pressure)
            force, wait, jump, life = found
            print(
                f"p = {pressure:g}: {len(force)} forces, ⟨f²⟩/⟨f⟩² = {(force**2).mean():.2f},",
                end=" ",
            )
            print(f"{(force < 0.1).mean():.1%} under a tenth, {(force > 3).mean():.1%} over 3")
            print(f"  {len(wait)} collisions; waits: standard deviation / mean {wait.std():.2f}")
            print(f"  jumps: {(jump > 1e-6).mean():.1%} up by over 1e-6,", end=" ")
            print(f"{(jump < -1e-6).mean():.1%} down, largest {jump.max():.2f}")
            print(f"  {len(life)} lives: median {np.median(life):.1e} of strain")
            for axis, values, (label, low, high) in zip(axes, found, labels, strict=True):
                at, dense = density(values[values > 0], np.geomspace(low, high, 31))
                axis.loglog(
                    at, dense, color=style.UNORDERED[turn], marker=style.MARKERS[turn],
                    linewidth=0.7, markersize=3, label=rf"$p\,\xi_0/\dot\gamma = {pressure:g}$",
                )  # fmt: skip
                axis.set(xlabel=label, ylabel="density")
        at = np.geomspace(1e-3, 8, 50)
        axes[1].plot(at, np.exp(-at), color="0.4", linestyle="--", linewidth=0.8)
        axes[0].legend()
        print(*style.save(figure, given.folder / "hard_disc_statistics")[:1])


if __name__ == "__main__":
    main()
