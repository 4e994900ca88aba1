r"""G′ and G″ of dense suspensions of soft particles against amplitude, core and plasticity.

shear-sim sweep configs/soft_suspension.yaml && shear-sim aggregate results/soft_suspension
.venv/bin/python analysis/soft_suspension.py results/soft_suspension \
    analysis/figures/soft_suspension.png

Draws table ``curves`` in units of k_b/R², single packings as dots, and prints two tables in
Markdown (kept in analysis/soft_suspension.md): moduli with what their work went into, and what must
hold of all runs.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes

from shear_sim.aggregate import load
from shear_sim.figures import style
from shear_sim.results import read_job

AMPLITUDE, CORE = "shear.strain_amplitude", "model.core_ratio"
#: Rows of panels: what shears, and the scenes of particles that never yield and that do.
ROWS = {
    "periodic cell": ("elastic", "plastic"),
    "rough plates": ("elastic_plates", "plastic_plates"),
}
KINDS = ("elastic", "plastic")
MODULI = {"storage_modulus": "$G'$", "loss_modulus": "$G''$"}
ROOM = 2.0  # that panels leave for intervals
SHARES = ("yield", "damping", "drag")


def of_a_panel(
    axis: Axes, curves: pd.DataFrame, runs: pd.DataFrame, scenes: tuple[str, ...], unit: float
) -> None:
    for kind, scene, colour, marker in zip(KINDS, scenes, style.UNORDERED, "os", strict=False):
        part = curves[curves["scene"] == scene].sort_values(AMPLITUDE)
        for name, symbol in MODULI.items():
            mean = part[f"{name}_mean"] / unit
            look = style.marker_style(name, colour, marker)
            axis.plot(part[AMPLITUDE], mean, label=f"{symbol}, {kind}", **look)
            own = runs[runs["point"].isin(part["point"])]
            axis.plot(own[AMPLITUDE], own[name] / unit, ".", color=colour, ms=2.5, alpha=0.6)


def draw(path: Path, curves: pd.DataFrame, runs: pd.DataFrame, unit: float) -> None:
    cores = sorted(curves[CORE].unique())
    with style.figure(style.DOUBLE, 4.3) as figure:
        axes = figure.subplots(len(ROWS), len(cores), sharex=True, sharey="col", squeeze=False)
        for row, (what, scenes) in zip(axes, ROWS.items(), strict=True):
            for axis, core in zip(row, cores, strict=True):
                of_a_panel(axis, curves[curves[CORE] == core], runs, scenes, unit)
                axis.set(xscale="log", yscale="log")
            row[0].set_ylabel(f"{what}\n$G'$, $G''$ / ($k_b/R^2$)")
        for axis, core in zip(axes[0], cores, strict=True):
            axis.set_title(f"core $\\eta$ = {core:g}")
            means = curves.loc[curves[CORE] == core, [f"{name}_mean" for name in MODULI]] / unit
            axis.set_ylim(means.min().min() / ROOM, means.max().max() * ROOM)
        for axis in axes[-1]:
            axis.set_xlabel("strain amplitude $\\gamma_0$")
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
        style.save_as(figure, path)


def moduli(curves: pd.DataFrame, runs: pd.DataFrame, unit: float) -> None:
    heads = ["scene", "η", "γ₀", "G′ R²/k_b", "G″ R²/k_b", "tan δ", "I₃/I₁"]
    heads += [f"lost by {name}" for name in SHARES]
    print("| " + " | ".join([*heads, "runs"]) + " |")
    print("| --- " * (len(heads) + 1) + "|")
    for _, point in curves.iterrows():
        cells = [str(point["scene"]), f"{point[CORE]:g}", f"{point[AMPLITUDE]:g}"]
        cells += [f"{point[f'{name}_mean'] / unit:.3g}" for name in MODULI]
        cells += [f"{point[f'{name}_mean']:.2g}" for name in ("tan_delta", "third_harmonic_ratio")]
        own = runs[runs["point"] == point["point"]]
        cells += [f"{100 * own[f'{name}_loss_share'].mean():.0f} %" for name in SHARES]
        print("| " + " | ".join([*cells, f"{point['n']} of {point['planned']}"]) + " |")


def gates(runs: pd.DataFrame) -> Iterator[tuple[str, str, str, bool]]:
    """Yield what must be small in all runs, below what, the largest, and whether that holds."""
    for what, name, limit in (
        ("∮τ dγ less losses and what is stored / losses, last period", "cycle_missing_ratio", 1e-4),
        ("energy missing / work, any record", "energy_missing_ratio", 1e-4),
        ("asymmetry of the stress / trace (periodic cell)", "asymmetry", 1e-9),
    ):
        yield what, f"{limit:g}", f"{runs[name].max():.1e}", bool(runs[name].max() < limit)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="folder of the aggregated study")
    parser.add_argument("figure", type=Path, help="path of the figure")
    given = parser.parse_args()
    curves, runs = (load(given.results / f"tables/{name}.parquet") for name in ("curves", "runs"))
    summary = read_job(given.results / "jobs" / f"{runs['job'].iloc[0]}.parquet").summary
    unit = summary["derived"]["bend_stiffness"] / summary["parameters"]["packing"]["radius"] ** 2
    print(f"# Suspensions of soft particles, {len(runs)} of {curves['planned'].sum()} runs\n")
    print(f"k_b/R² = {unit:.4g} Pa; means over packings.\n")
    moduli(curves, runs, unit)
    print("\n| of all runs | must be below | largest | |")
    print("| --- | --- | --- | --- |")
    for what, limit, found, holds in gates(runs):
        print(f"| {what} | {limit} | {found} | {'holds' if holds else '**misses**'} |")
    draw(given.figure, curves, runs, unit)


if __name__ == "__main__":
    main()
