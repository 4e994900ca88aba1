"""Draw the time per disc and step against the number of discs, with the computed limit.

.venv/bin/python analysis/benchmarks/fig_growth.py results/benchmarks analysis/figures/growth

Reads growth.csv of speed.py; measures the machine for the limit (see limit.py).
"""

import argparse
from pathlib import Path

import limit
import numpy as np
import pandas as pd

from shear_sim.figures import style

PROGRAMS = {"granular": "LAMMPS granular", "hooke": "LAMMPS hooke/history", "ours": "shear-sim"}
MARKERS = dict(zip(PROGRAMS, "s^o", strict=True))


def draw(table: pd.DataFrame, machine: limit.Machine, stem: Path) -> None:
    """Write one panel per packing fraction."""
    fractions = sorted(table["packing_fraction"].unique(), reverse=True)
    with style.small_multiples(len(fractions), len(fractions), 2.4) as (figure, panels):
        for panel, fraction in zip(panels, fractions, strict=True):
            rows = table[table["packing_fraction"] == fraction].groupby("discs")
            middle = rows.median()
            discs = middle.index.to_numpy(float)
            for (name, label), colour in zip(PROGRAMS.items(), style.UNORDERED, strict=False):
                times = middle[name] / discs * 1e9
                panel.plot(discs, times, color=colour, marker=MARKERS[name], label=label)
                low, high = (getattr(rows[name], what)() / discs * 1e9 for what in ("min", "max"))
                panel.vlines(discs, low, high, color=colour)
            grid = np.geomspace(discs[0], discs[-1], 60)
            pairs = np.interp(np.log(grid), np.log(discs), middle["pairs"])
            least = 1e9 * np.array(
                [limit.step_limit(machine, n, p) for n, p in zip(grid, pairs, strict=True)]
            )
            panel.plot(grid, least[:, 0], color="k", label="least: instructions of forces")
            panel.plot(grid, least[:, 1], color="k", linestyle="--", label="one after the other")
            panel.plot(grid, least[:, 2], color="k", linestyle=":", label="least: memory")
            panel.set(xscale="log", yscale="log", xlabel="discs $N$", ylim=(1, None))
            panel.set_title(f"packing fraction {fraction:g}")
            panel.set_yticks([3, 10, 30, 100, 300, 1000], ["3", "10", "30", "100", "300", "1000"])
            panel.minorticks_off()
        panels[0].set_ylabel("CPU time per disc and step [ns]")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        style.note(
            figure,
            "one core; medians of rounds, lines from the fastest to the slowest; both programs "
            "record their stress at every step of 0.04 τ",
        )
        style.save(figure, stem)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="folder that growth.csv is in")
    parser.add_argument("stem", type=Path, help="path of the figure, without its ending")
    given = parser.parse_args()
    draw(pd.read_csv(given.results / "growth.csv"), limit.measure(), given.stem)
