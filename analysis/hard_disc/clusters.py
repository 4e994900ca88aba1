"""Measure the clusters of self-propelled hard discs (figure 8 of Lerner, Düring & Wyart, 2013).

.venv/bin/python analysis/hard_disc/clusters.py       # 3 minutes of one core

400 discs at φ = 0.1, 0.3 and 0.5, diameters 1 ± 3 %, forces that last up to 10 τ: how many clusters
of n discs in contact there are per disc, and how fast discs move relative to free ones. Draws
analysis/figures/hard_disc_clusters.png.
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shear_sim.figures import style
from shear_sim.models.hard_disc.certificate import bodies
from shear_sim.models.hard_disc.driving import SelfPropelled
from shear_sim.models.hard_disc.flow import Flow
from shear_sim.models.hard_disc.packing import make_start
from shear_sim.models.hard_disc.parameters import (
    HardDisc,
    HardDiscPacking,
    HardDiscSelfPropulsion,
)
from shear_sim.streams import Streams

PACKING_FRACTIONS = (0.1, 0.3, 0.5)
SAMPLE = 0.5  # τ between two looks


def measure(
    discs: int, packing_fraction: float, transient: float, duration: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the sizes of all clusters seen, and mean square velocities / (ξ₀ f)²."""
    streams = Streams(1, 0)
    packing = HardDiscPacking(discs=discs, packing_fraction=packing_fraction, size_ratio=1.0)
    start = make_start(packing, HardDisc(), streams)
    section = HardDiscSelfPropulsion(kind="self_propelled", duration=transient + duration)
    driving = SelfPropelled(section, start.mobility, streams)
    flow = Flow(
        start.x, start.y, start.radius, start.mobility, start.width, start.height, driving.drive
    )
    sizes, squares = [], []
    for look in transient + np.arange(0.0, duration, SAMPLE):
        while driving.until < look:
            flow.advance(driving.until)
            driving.change(flow)
        flow.advance(look)
        contacts = flow.contacts()
        sizes.append(np.bincount(bodies(contacts.i, contacts.j, discs)))
        free = (flow.drive.drift**2).sum()
        squares.append((flow.set.velocities(flow.instant()) ** 2).sum() / free)
    return np.concatenate(sizes), np.array(squares)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--discs", type=int, default=400)
    parser.add_argument("--duration", type=float, default=50.0, help="after 10 τ [τ]")
    parser.add_argument("--folder", type=Path, default=Path("analysis/figures"), help="of figures")
    given = parser.parse_args()
    with style.figure(style.SINGLE, 2.6) as figure:
        axis = figure.subplots()
        for turn, packing_fraction in enumerate(PACKING_FRACTIONS):
            sizes, squares = measure(given.discs, packing_fraction, 10.0, given.duration)
            per_disc = 1.0 / sizes.sum()
            mean = (sizes**2).sum() * per_disc
            print(
                f"φ = {packing_fraction}: {(sizes == 1).sum() * per_disc:.0%} of discs alone,",
                end=" ",
            )
            print(
                f"a disc is in a cluster of {mean:.1f} on average, largest {sizes.max()};", end=" "
            )
            print(f"speed {np.sqrt(squares.mean()):.2f} of that of free discs", flush=True)
            edges = np.unique(np.round(np.geomspace(1, sizes.max() + 1, 20)))
            count, _ = np.histogram(sizes, edges)
            kept = count > 0
            middle = np.sqrt(edges[:-1] * (edges[1:] - 1))
            density = count * per_disc / np.diff(edges)
            axis.loglog(
                middle[kept], density[kept], color=style.UNORDERED[turn],
                marker=style.MARKERS[turn], linestyle="none", markersize=3,
                label=rf"$\phi = {packing_fraction}$",
            )  # fmt: skip
        axis.set(xlabel="discs in a cluster $n$", ylabel="clusters of $n$ discs, per disc")
        axis.legend()
        print(*style.save(figure, given.folder / "hard_disc_clusters")[:1])


if __name__ == "__main__":
    main()
