"""Put the flow laws of several studies of hard discs into one table and one figure.

.venv/bin/shear-sim sweep configs/hard_disc/rheology_64.yaml      (and _256, _1024, _1024_dense)
.venv/bin/python analysis/hard_disc/rheology.py results/rheology_64 results/rheology_256

writes analysis/hard_disc/rheology.md and analysis/figures/hard_disc_rheology.png. Means and 95 %
intervals over replicates are those of `shear-sim aggregate`; points without a finished run are left
out, and the table says how many runs there are of how many; of a point that two studies have, the
one with more runs counts. Where an independent prototype of the
same method measured the same (64 discs, six packings, strain 1.5), the last column gives the
difference in standard errors of both.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.ticker import NullLocator

from shear_sim.aggregate import make_tables
from shear_sim.figures import style
from shear_sim.results import Results

#: Shear stress and its standard error by packing fraction, and by pressure (below 1: fractions).
PROTOTYPE = {
    0.76: (0.351, 0.034), 0.78: (0.573, 0.035), 0.80: (1.19, 0.07), 0.81: (2.32, 0.29),
    1.0: (0.367, 0.020), 3.0: (0.954, 0.009), 10.0: (2.56, 0.07), 30.0: (6.04, 0.28),
}  # fmt: skip
QUANTITIES = {
    "scaled_shear_stress": "σ ξ₀/γ̇",
    "scaled_pressure": "p ξ₀/γ̇",
    "friction_coefficient": "μ",
    "mean_packing_fraction": "φ",
    "contact_number": "2N_c/N",
}


def points(folder: Path) -> pd.DataFrame:
    """Return the points of a study that have runs, with their number of discs and state."""
    tables = make_tables(folder)
    steady = tables["steady"].copy()
    discs = int(Results.existing(folder).index().column("packing.discs")[0].as_py())
    if "shear.scaled_pressure" not in steady:
        message = f"{folder}: shear.scaled_pressure does not vary in this study"
        raise SystemExit(message)
    return steady[steady["replicates"] > 0].assign(discs=discs)


def text(row: pd.Series, name: str) -> str:
    mean, low, high = (row[f"{name}_{part}"] for part in ("mean", "ci_low", "ci_high"))
    digits = 4 if name == "mean_packing_fraction" else 3
    if not np.isfinite(low) or high - low < 1e-6 * abs(mean):
        return f"{mean:.{digits}g}"
    return f"{mean:.{digits}g} [{low:.{digits}g}, {high:.{digits}g}]"


def line(row: pd.Series) -> str:
    """Return a row of the table."""
    pressure = row["shear.scaled_pressure"]
    fixed = f"p = {pressure:g}"
    state = pressure
    if not np.isfinite(pressure):
        state = row["packing.packing_fraction"]
        fixed = f"φ = {state:g}"
    cells = [f"{row['discs']:,}", fixed, f"{row['replicates']} of {row['planned']}"]
    cells += [text(row, name) for name in QUANTITIES]
    difference = ""
    if row["discs"] == 64 and state in PROTOTYPE:
        mean, error = PROTOTYPE[state]
        own = row["scaled_shear_stress_sd"] / np.sqrt(row["replicates"])
        off = (row["scaled_shear_stress_mean"] - mean) / np.hypot(own, error)
        difference = f"{off:+.1f}"
    return "| " + " | ".join([*cells, difference]) + " |"


def both_ways(table: pd.DataFrame) -> list[str]:
    """Return φ at the pressures that runs at fixed area reach, by those and at fixed pressure."""
    lines = []
    for discs, part in table.groupby("discs"):
        area = part[part["shear.scaled_pressure"].isna()].sort_values("scaled_pressure_mean")
        if len(area) < 2:
            continue
        known = np.log(area["scaled_pressure_mean"].to_numpy(float))
        phi = area["packing.packing_fraction"].to_numpy(float)
        for _, row in part[part["shear.scaled_pressure"].notna()].iterrows():
            at = float(np.log(row["shear.scaled_pressure"]))
            if known[0] <= at <= known[-1]:
                lines.append(
                    f"N = {discs}, p = {row['shear.scaled_pressure']:g}: φ = "
                    f"{np.interp(at, known, phi):.4f} between runs at fixed φ, "
                    f"{text(row, 'mean_packing_fraction')} at fixed p."
                )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, nargs="+", help="results folders of the studies")
    parser.add_argument("--table", type=Path, default=Path("analysis/hard_disc/rheology.md"))
    parser.add_argument("--folder", type=Path, default=Path("analysis/figures"), help="of figures")
    given = parser.parse_args()
    table = pd.concat([points(folder) for folder in given.results], ignore_index=True)
    states = ["discs", "shear.scaled_pressure", "packing.packing_fraction"]
    table = table.reindex(columns=[*table.columns.union(states)])
    table = table.sort_values("replicates").drop_duplicates(states, keep="last")
    table = table.sort_values(states, na_position="first")
    titles = ["N", "fixed", "runs", *QUANTITIES.values(), "off prototype"]
    rows = ["| " + " | ".join(titles) + " |", "|" + " --- |" * len(titles)]
    rows += [line(row) for _, row in table.iterrows()]
    command = (
        f"`analysis/hard_disc/rheology.py {' '.join(dict.fromkeys(f.name for f in given.results))}`"
    )
    about = f"Flow laws of hard discs, by {command}; 95 % intervals over packings.\n\n"
    alike = "".join(f"\n{line}\n" for line in both_ways(table))
    given.table.write_text(about + "\n".join(rows) + "\n" + alike)
    panels = (
        ("friction_coefficient", r"stress ratio $\mu$"),
        ("mean_packing_fraction", r"packing fraction $\phi$"),
        ("contact_number", "contacts per disc $2N_c/N$"),
    )  # fmt: skip
    with style.figure(style.DOUBLE, 2.8) as figure:
        axes = figure.subplots(1, len(panels))
        groups = table.groupby(["discs", table["shear.scaled_pressure"].isna()])
        for turn, ((discs, area), part) in enumerate(groups):
            label = f"$N = {discs}$, fixed {'area' if area else 'pressure'}"
            for axis, (name, words) in zip(axes, panels, strict=True):
                ordered = part.sort_values("viscous_number_mean")
                at = ordered["viscous_number_mean"].to_numpy(float)
                mean, low, high = (
                    ordered[f"{name}_{end}"].to_numpy(float)
                    for end in ("mean", "ci_low", "ci_high")
                )
                colour = style.UNORDERED[turn]
                axis.vlines(at, low, high, color=colour, alpha=0.5, linewidth=2)
                axis.plot(
                    at, mean, color=colour, marker=style.MARKERS[turn], linewidth=0.6,
                    linestyle="none" if area else "-", label=label,
                )  # fmt: skip
                axis.set(xscale="log", xlabel=r"$J = \dot\gamma/(\xi_0 p)$", ylabel=words)
        axes[0].set_yscale("log")
        axes[0].set_yticks([0.1, 0.2, 0.3, 0.4], ["0.1", "0.2", "0.3", "0.4"])
        axes[0].yaxis.set_minor_locator(NullLocator())
        axes[2].axhline(4.0, color="0.4", linewidth=0.7, linestyle="--")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
        print(*style.save(figure, given.folder / "hard_disc_rheology")[:1])
    print(given.table.read_text())


if __name__ == "__main__":
    main()
