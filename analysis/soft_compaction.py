r"""Compaction of soft particles against the paper: tables, curves, and shapes at the largest load.

shear-sim sweep configs/soft_particle_compaction.yaml
.venv/bin/python analysis/soft_compaction.py results/soft_particle_compaction \
    analysis/figures/soft_compaction.png

Prints tables in Markdown (kept in analysis/soft_compaction.md). Shapes are those where the lid
turned; colours are elastic energies over the mean, from the mean up, as in figure 29 of the paper.
Curves are of both preparations; shapes of packs that fell are in soft_compaction_gravity.png.
"""

import argparse
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray
from soft_tissue import outlines

from shear_sim.figures import style
from shear_sim.models.soft_particle import derive
from shear_sim.render import Kept, read_kept

FloatArray = NDArray[np.float64]
Summary = dict[str, Any]

START = 0.22  # void ratio of the paper's packs, at first
#: What the paper says (figures 27 and 28), with the tolerances of the project. Shares of particle
#: volume are of what changed since e was `START`, as looser packs rearrange before.
GOALS = {
    "hollow": {"void_ratio_at_unit": (0.085, 0.115), "later_share_at_unit": (0.32, 0.42)},
    "soft core": {},
    "hard core": {"final_void_ratio": (0.025, 0.055), "final_later_share": (-0.01, 0.01)},
    "plastic": {"final_void_ratio": (0.0, 0.08), "final_later_share": (0.15, 0.30)},
}
KINDS = tuple(GOALS)
PREPARATIONS = ("discs", "gravity")
ELASTIC_INDEX = (0.06, 0.10)
SHOWN = {
    "start_void_ratio": "e₀", "final_strain": "ε", "final_stress_per_bending": "σ/σ*",
    "final_void_ratio": "e there", "final_solid_share": "ΔV_s/ΔV there",
    "final_later_share": f"ΔV_s/ΔV there, from e = {START}",
    "void_ratio_at_unit": "e at σ*", "solid_share_at_unit": "ΔV_s/ΔV at σ*",
    "later_share_at_unit": f"ΔV_s/ΔV at σ*, from e = {START}",
    "compressibility_index": "C", "final_circularity": "circularity there",
    "unloaded_void_ratio": "e unloaded", "lid_leaves": "lid leaves at ε",
    "energy_missing_ratio": "energy missing / work",
}  # fmt: skip
LEVELS = 12  # of the colours
LEAST = 1e-3  # σ/σ* that a lid bears on its particles; below, it does not touch them


def kind(summary: Summary) -> str:
    model = summary["parameters"]["model"]
    if model.get("yield_moment") is not None:
        return "plastic"
    ratio = model.get("core_ratio", 0.0)
    return "hollow" if ratio == 0 else "soft core" if ratio < 10 else "hard core"


def read_packs(results: Path) -> dict[tuple[str, str], Kept]:
    """Return the finished jobs of the study by preparation and kind, in the order of both."""
    jobs = {}
    for path in sorted((results / "jobs").glob("*.parquet")):
        kept = read_kept(path)
        summary = kept.table.summary
        jobs[summary["parameters"]["packing"]["preparation"], kind(summary)] = kept
    names = [(preparation, each) for preparation in PREPARATIONS for each in KINDS]
    return {name: jobs[name] for name in names if name in jobs}


def goals(name: str) -> dict[str, tuple[float, float]]:
    """Return what a kind must be between, however it was prepared."""
    return GOALS[name] | ({"compressibility_index": ELASTIC_INDEX} if name != "plastic" else {})


def borne(kept: Kept) -> FloatArray:
    """Return σ/σ* of the records."""
    return np.asarray(2.0 * kept.table.columns["stress_yy_per_bending"])


def measured(kept: Kept) -> dict[str, float]:
    """Return what a run keeps, and what its records tell besides.

    Shares of particle volume of what changed since e was `START`, where the lid turned and where
    it first bore σ*; the strain at which a lid on its way back does not bear any more.
    """
    columns, stress = kept.table.columns, borne(kept)
    strain, solid, box = (columns[name] for name in ("strain", "solid_area", "box_area"))
    top = int(strain.argmax())
    first = int(np.argmax(box / solid - 1 <= START))
    ends = {"final_later_share": top}
    if (stress[: top + 1] >= 1).any():
        ends["later_share_at_unit"] = int(np.argmax(stress >= 1))
    shares = {
        name: float((solid[first] - solid[end]) / (box[first] - box[end]))
        for name, end in ends.items()
    }
    free = np.flatnonzero(stress[top:] < LEAST)
    leaves = {"lid_leaves": float(strain[top + free[0]])} if len(free) else {}
    return kept.table.summary["measured"] | shares | leaves


def report(name: str, kept: Kept) -> list[str]:
    """Return the column of a job in the table."""
    summary = kept.table.summary
    given, found = summary["parameters"]["packing"], measured(kept)
    cells = [str(given["particles"])]
    for key in SHOWN:
        if key not in found:
            cells.append("–")
            continue
        value = found[key] * (2.0 if key == "final_stress_per_bending" else 1.0)
        text = f"{value:.1e}" if key == "energy_missing_ratio" else f"{value:.3g}"
        if key in goals(name):
            low, high = goals(name)[key]
            verdict = "holds" if low <= value <= high else "misses"
            text += f" ({verdict}: {low:g} to {high:g})"
        cells.append(text)
    seconds = summary["run"]["cpu_s"]
    vertices = given["particles"] * given["vertices"]
    cost = seconds / summary["derived"]["steps"] / vertices * 1e9
    return [*cells, f"{seconds:.0f}", f"{seconds * under_the_lid(kept):.0f}", f"{cost:.0f}"]


def under_the_lid(kept: Kept) -> float:
    """Return the share of the steps that were made under the lid; the others are the fall."""
    derived = kept.table.summary["derived"]
    return float(kept.table.columns["time"][-1] / derived["time_step"] / derived["steps"])


def table(jobs: dict[str, Kept]) -> None:
    """Print the table of the packs of one preparation, by kind."""
    print("\n| | " + " | ".join(jobs) + " |")
    print("| --- " * (len(jobs) + 1) + "|")
    columns = [report(name, job) for name, job in jobs.items()]
    heads = [
        "particles",
        *SHOWN.values(),
        "CPU s",
        "load and unload, by their steps",
        "ns per vertex and step",
    ]
    for head, *cells in zip(heads, *columns, strict=True):
        print("| " + " | ".join([head, *cells]) + " |")


def shapes(axis: Axes, kept: Kept, height: float) -> PolyCollection:
    """Draw all particles where the lid turned, in a panel of this ``height`` [m]."""
    snapshot = kept.snapshots[0]
    polygons, energy = outlines(snapshot)
    drawn = PolyCollection(
        polygons, array=np.maximum(energy / energy.mean(), 1.0),
        cmap=mpl.colormaps["Reds"].resampled(LEVELS), edgecolors="black", linewidths=0.3,
    )  # fmt: skip
    drawn.set_clim(1.0, 4.0)
    axis.add_collection(drawn)
    right, lid = -snapshot.walls[1, 2], -snapshot.walls[3, 2]
    axis.plot([0, right], [lid, lid], color="black", lw=0.8)
    axis.set(xlim=(0, right), ylim=(0, height), aspect="equal", xticks=[], yticks=[])
    axis.grid(visible=False)
    axis.spines["right"].set_visible(True)
    return drawn


def curves(axes: list[Axes], kept: Kept, name: str, colour: str) -> None:
    """Draw stress, void ratio, share of particle volume and volume: full there, dashed back."""
    t = kept.table.columns | derive(kept.table.columns)
    top = int(t["strain"].argmax()) + 1
    stress = np.where(borne(kept) > LEAST, borne(kept), np.nan)
    whole = t["solid_area"] / t["solid_area"][0]
    for part, line in ((slice(1, top), "-"), (slice(top - 1, None), "--")):
        look = {"linestyle": line, "color": colour, "lw": 1.0}
        axes[0].plot(t["strain"][part], stress[part], label=name if line == "-" else None, **look)
        axes[1].plot(stress[part], t["void_ratio"][part], **look)
        axes[2].plot(stress[part], t["solid_share"][part], **look)
        axes[3].plot(t["strain"][part], whole[part], **look)


def pictures(figure: SubFigure | Figure, jobs: dict[str, Kept], preparation: str) -> None:
    """Draw the packs of one preparation where their lids turned."""
    places = figure.subplots(2, 2).ravel()
    height = 1.01 * max(-job.snapshots[0].walls[3, 2] for job in jobs.values())
    for axis, (name, job) in zip(places, jobs.items(), strict=False):
        drawn = shapes(axis, job, height)
        strain = float(job.table.columns["strain"].max())
        axis.set_title(f"{name}, {preparation}, ε = {strain:.2f}")
    for axis in places[len(jobs) :]:
        axis.set_axis_off()
    bar = figure.colorbar(drawn, ax=places, shrink=0.6, aspect=30, pad=0.02)
    bar.set_label("elastic energy of a particle / mean")


def draw(path: Path, packs: dict[str, dict[str, Kept]]) -> None:
    first, *others = packs
    for preparation in others:
        with style.figure(style.DOUBLE, 5.1) as figure:
            pictures(figure, packs[preparation], preparation)
            style.save_as(figure, path.with_stem(f"{path.stem}_{preparation}"), dpi=150, colours=64)
    with style.figure(style.DOUBLE, 8.6) as figure:
        above, below = figure.subfigures(2, 1, height_ratios=(1.45, 1))
        pictures(above, packs[first], first)
        axes = below.subplots(2, 4, sharex="col", sharey="col")
        for line, (preparation, jobs) in zip(axes, packs.items(), strict=True):
            for name, job in jobs.items():
                curves(line, job, name, style.UNORDERED[KINDS.index(name)])
            line[0].set(yscale="log", ylabel=f"by {preparation}\nσ/σ*")
            line[1].set(xscale="log", ylabel="void ratio e")
            line[2].set(xscale="log", ylabel="ΔV$_s$/ΔV", ylim=(-0.02, 0.6))
            line[3].set(ylabel="V$_s$/V$_s$(0)")
        for axis, label in zip(axes[-1], ("ε = ln(H₀/H)", "σ/σ*", "σ/σ*", "ε"), strict=True):
            axis.set_xlabel(label)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        below.legend(handles, labels, loc="outside lower center", ncols=len(KINDS))
        style.save_as(figure, path, dpi=150, colours=64)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="results folder of the study")
    parser.add_argument("figure", type=Path, help="path of the figure; packs that fell: beside")
    given = parser.parse_args()
    found = read_packs(given.results)
    number = len(PREPARATIONS) * len(KINDS)
    print(f"# Compaction of soft particles, {len(found)} of {number} packs")
    packs: dict[str, dict[str, Kept]] = {}
    for (preparation, name), kept in found.items():
        packs.setdefault(preparation, {})[name] = kept
    for preparation, jobs in packs.items():
        print(f"\n## Prepared by {preparation}")
        table(jobs)
    draw(given.figure, packs)


if __name__ == "__main__":
    main()
