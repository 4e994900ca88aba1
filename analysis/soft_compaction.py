r"""Compaction of soft particles against the paper: a table, curves, and shapes at the largest load.

shear-sim sweep configs/soft_particle_compaction.yaml
.venv/bin/python analysis/soft_compaction.py results/soft_particle_compaction \
    analysis/figures/soft_compaction.png

Prints a table in Markdown (kept in analysis/soft_compaction.md). Shapes are those where the lid
turned; colours are elastic energies over the mean, from the mean up, as in figure 29 of the paper.
"""

import argparse
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from soft_tissue import outlines

from shear_sim.models.soft_particle import derive
from shear_sim.render import Kept, read_kept

Summary = dict[str, Any]

KINDS = ("hollow", "soft core", "hard core", "plastic", "fallen")
DRAWN = KINDS[:4]  # shapes of
#: What the paper says (figures 27 and 28), with the tolerances of the project.
GOALS = {
    "hollow": {"void_ratio_at_unit": (0.085, 0.115), "solid_share_at_unit": (0.32, 0.42)},
    "soft core": {},
    "hard core": {"final_void_ratio": (0.025, 0.055), "final_solid_share": (-0.01, 0.01)},
    "plastic": {"final_void_ratio": (0.0, 0.08), "final_solid_share": (0.15, 0.30)},
    "fallen": {"void_ratio_at_unit": (0.085, 0.115)},
}
ELASTIC_INDEX = (0.06, 0.10)
SHOWN = {
    "start_void_ratio": "e₀", "final_strain": "ε", "final_stress_per_bending": "σ/σ*",
    "final_void_ratio": "e there", "final_solid_share": "ΔV_s/ΔV there",
    "void_ratio_at_unit": "e at σ*", "solid_share_at_unit": "ΔV_s/ΔV at σ*",
    "compressibility_index": "C", "final_circularity": "circularity there",
    "unloaded_void_ratio": "e unloaded", "energy_missing_ratio": "energy missing / work",
}  # fmt: skip


def kind(summary: Summary) -> str:
    model = summary["parameters"]["model"]
    if summary["parameters"]["packing"].get("preparation") == "gravity":
        return "fallen"
    if model.get("yield_moment") is not None:
        return "plastic"
    ratio = model.get("core_ratio", 0.0)
    return "hollow" if ratio == 0 else "soft core" if ratio < 10 else "hard core"


def read_packs(results: Path) -> dict[str, Kept]:
    """Return the finished jobs of the study by `KINDS`."""
    found = [read_kept(path) for path in sorted((results / "jobs").glob("*.parquet"))]
    jobs = {kind(kept.table.summary): kept for kept in found}
    return {name: jobs[name] for name in KINDS if name in jobs}


def report(name: str, summary: Summary) -> list[str]:
    """Return the column of a job in the table."""
    given, measured = summary["parameters"]["packing"], summary["measured"]
    cells = [str(given["particles"])]
    goals = GOALS[name]
    if name != "plastic":
        goals = goals | {"compressibility_index": ELASTIC_INDEX}
    for key in SHOWN:
        if key not in measured:
            cells.append("–")
            continue
        value = measured[key] * (2.0 if key == "final_stress_per_bending" else 1.0)
        text = f"{value:.1e}" if key == "energy_missing_ratio" else f"{value:.3g}"
        if key in goals:
            low, high = goals[key]
            verdict = "holds" if low <= value <= high else "misses"
            text += f" ({verdict}: {low:g} to {high:g})"
        cells.append(text)
    seconds = summary["run"]["cpu_s"]
    vertices = given["particles"] * given["vertices"]
    cost = seconds / summary["derived"]["steps"] / vertices * 1e9
    return [*cells, f"{seconds:.0f}", f"{cost:.0f}"]


def shapes(axis: Axes, kept: Kept, height: float) -> PolyCollection:
    """Draw all particles where the lid turned, in a panel of this ``height`` [m]."""
    snapshot = kept.snapshots[0]
    polygons, energy = outlines(snapshot)
    drawn = PolyCollection(
        polygons, array=np.maximum(energy / energy.mean(), 1.0), cmap="Reds",
        edgecolors="black", linewidths=0.3,
    )  # fmt: skip
    drawn.set_clim(1.0, 4.0)
    axis.add_collection(drawn)
    right, lid = -snapshot.walls[1, 2], -snapshot.walls[3, 2]
    axis.plot([0, right], [lid, lid], color="black", lw=0.8)
    axis.set(xlim=(0, right), ylim=(0, height), aspect="equal", xticks=[], yticks=[])
    axis.spines["top"].set_visible(False)
    return drawn


def draw(path: str, jobs: dict[str, Kept]) -> None:
    figure = plt.figure(figsize=(7.2, 7.6), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=(2.6, 1))
    places = above.subplots(2, 2).ravel()
    shown = {name: job for name, job in jobs.items() if name in DRAWN}
    height = 1.01 * max(-job.snapshots[0].walls[3, 2] for job in shown.values())
    for axis, (name, job) in zip(places, shown.items(), strict=False):
        drawn = shapes(axis, job, height)
        strain = float(job.table.columns["strain"].max())
        axis.set_title(f"{name}, ε = {strain:.2f}", fontsize=8)
    for axis in places[len(shown) :]:
        axis.set_axis_off()
    bar = above.colorbar(drawn, ax=places, shrink=0.6, aspect=30, pad=0.02)
    bar.set_label("elastic energy of a particle / mean", fontsize=7)
    bar.ax.tick_params(labelsize=6)
    axes = below.subplots(1, 4)
    for number, (name, job) in enumerate(jobs.items()):
        t = job.table.columns | derive(job.table.columns)
        top = int(t["strain"].argmax()) + 1
        stress = np.where(t["stress_yy_per_bending"] > 5e-4, 2 * t["stress_yy_per_bending"], np.nan)
        whole = t["solid_area"] / t["solid_area"][0]
        for part, style in ((slice(1, top), "-"), (slice(top - 1, None), "--")):
            look = {"linestyle": style, "color": f"C{number}", "lw": 1.0}
            label = name if style == "-" else None
            axes[0].plot(t["strain"][part], stress[part], label=label, **look)
            axes[1].plot(stress[part], t["void_ratio"][part], **look)
            axes[2].plot(stress[part], t["solid_share"][part], **look)
            axes[3].plot(t["strain"][part], whole[part], **look)
    axes[0].set(yscale="log", xlabel="ε = ln(H₀/H)", ylabel="σ/σ*")
    axes[1].set(xscale="log", xlabel="σ/σ*", ylabel="void ratio e")
    axes[2].set(xscale="log", xlabel="σ/σ*", ylabel="ΔV$_s$/ΔV", ylim=(-0.02, 0.6))
    axes[3].set(xlabel="ε", ylabel="V$_s$/V$_s$(0)")
    handles, labels = axes[0].get_legend_handles_labels()
    below.legend(handles, labels, loc="outside lower center", ncols=len(KINDS), frameon=False,
                 fontsize=7)  # fmt: skip
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
        axis.tick_params(labelsize=6)
        axis.xaxis.label.set_size(7)
        axis.yaxis.label.set_size(7)
    figure.savefig(path, dpi=120)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="results folder of the study")
    parser.add_argument("figure", help="path of the figure")
    given = parser.parse_args()
    jobs = read_packs(given.results)
    print(f"# Compaction of soft particles, {len(jobs)} of {len(KINDS)} kinds\n")
    print("| | " + " | ".join(jobs) + " |")
    print("| --- " * (len(jobs) + 1) + "|")
    columns = [report(name, job.table.summary) for name, job in jobs.items()]
    heads = ["particles", *SHOWN.values(), "CPU s", "ns per vertex and step"]
    for head, *cells in zip(heads, *columns, strict=True):
        print("| " + " | ".join([head, *cells]) + " |")
    draw(given.figure, jobs)


if __name__ == "__main__":
    main()
