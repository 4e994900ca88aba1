"""Draw where hard discs are at the end of runs, and the forces between them.

Figures 5, 8 and 9 of Lerner, Düring & Wyart (2013), a jammed packing, an inclined plane, a hopper:

.venv/bin/shear-sim sweep configs/hard_disc/snapshots.yaml
.venv/bin/python analysis/hard_disc/snapshots.py results/snapshots

draws a picture of each scene into analysis/figures (or the folder given second).
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import EllipseCollection, LineCollection
from runs import by_scene

from shear_sim.figures import style

LARGE, SMALL, WALL = "#9ecae1", "#fdd0a2", "0.45"


def snapshot(state: dict[str, Any], stem: Path) -> None:
    """Draw discs with their images, contacts the thicker the larger √force, bonds in black."""
    x, y, radius, mobility = (np.array(state[k]) for k in ("x", "y", "radius", "mobility"))
    width, height, offset = state["width"], state["height"], state["offset"]
    i, j = (np.array(state[f"contact_{end}"], int) for end in "ij")
    r = np.column_stack([state["contact_rx"], state["contact_ry"]]).reshape(-1, 2)
    force = np.array(state["contact_force"])
    # Into the cell, whose upper edge is displaced by offset.
    up = np.floor(y / height)
    x, y = x - up * offset, y - up * height
    x -= np.floor(x / width) * width
    place = np.column_stack([x, y])
    images = np.array(
        [(a * width + b * offset, b * height) for a in (-2, -1, 0, 1, 2) for b in (-1, 0, 1)]
    )
    everywhere = (place[:, None] + images).reshape(-1, 2)
    times = len(images)
    colour = np.where(radius > 0.6, LARGE, SMALL).astype("U7")
    colour[mobility == 0] = WALL
    with style.figure(style.SINGLE, style.SINGLE * height / width + 0.1) as figure:
        axis = figure.subplots()
        axis.add_collection(
            EllipseCollection(
                np.repeat(2 * radius, times), np.repeat(2 * radius, times), 0, units="x",
                offsets=everywhere, transOffset=axis.transData, linewidths=0.3, edgecolors="0.4",
                facecolors=np.repeat(colour, times),
            )
        )  # fmt: skip
        ends = place[i][:, None] + images
        lines = np.stack([ends, ends + r[:, None]], axis=2).reshape(-1, 2, 2)
        bonded = {frozenset(pair) for pair in np.array(state["bonds"]).reshape(-1, 2).tolist()}
        bond = np.array(
            [frozenset(pair) in bonded for pair in zip(i.tolist(), j.tolist(), strict=True)], bool
        )
        push = force[~bond]
        if len(push):
            thick = 2.6 * np.sqrt(np.repeat(push / push.max(), times))
            axis.add_collection(
                LineCollection(
                    lines[np.repeat(~bond, times)],
                    linewidths=thick,
                    colors="#b30000",
                    capstyle="round",
                )
            )
        axis.add_collection(
            LineCollection(lines[np.repeat(bond, times)], linewidths=1.1, colors="k")
        )
        axis.set(xlim=(0, width), ylim=(0, height), aspect="equal", xticks=[], yticks=[])
        axis.grid(visible=False)
        for side in axis.spines.values():
            side.set_visible(True)
        print(*style.save(figure, stem)[:1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="results folder of the study")
    parser.add_argument("--folder", type=Path, default=Path("analysis/figures"), help="of figures")
    given = parser.parse_args()
    for scene, _, summary in by_scene(given.results):
        print(
            f"{scene}: {summary['status']}, {len(summary['state']['contact_i'])} contacts,", end=" "
        )
        print(f"largest overlap {summary['checks']['largest_overlap']:.1e}:", end=" ")
        snapshot(summary["state"], given.folder / f"hard_disc_{scene}")


if __name__ == "__main__":
    main()
