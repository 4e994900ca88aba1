r"""Tensile fracture of a tissue of soft cells: goals with what is measured, curves and snapshots.

shear-sim sweep configs/soft_tissue.yaml
.venv/bin/python analysis/soft_tissue.py results/soft_tissue analysis/figures/soft_tissue.png

Prints tables in Markdown (kept in analysis/soft_tissue.md). The figure is beside figures 30 to 34
of the paper. Links at their break are those of a tissue of 30 cells, pulled here (ten seconds).
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from numpy.typing import NDArray

from shear_sim.figures import style
from shear_sim.figures.shells import Shells
from shear_sim.models.interface import COHESIVE, Snapshot
from shear_sim.models.soft_particle.parameters import SoftParticlePoint
from shear_sim.models.soft_particle.simulation import SoftParticleSimulation
from shear_sim.models.soft_particle.tension import cracks, pulled, ruptured
from shear_sim.render import Kept, read_kept
from shear_sim.streams import Streams

FloatArray = NDArray[np.float64]

KINDS = ("elastic", "plastic")
CELLS = 30  # of the small tissue
HIGH = 0.7  # of the largest stress: on the plateau
LOW = 0.3  # of the largest stress: where a tissue is still elastic
DROP = 0.02  # of the largest stress: what counts as a fall of it
VERDICTS = {True: "holds", False: "**misses**", None: "open"}
FULL = {"elastic": 4.0, "plastic": 0.8}  # W/W₀ at the end of the colours
LEVELS = 16  # of the colours


class Curve(NamedTuple):
    """Tensile stress against strain."""

    strain: FloatArray
    stress: FloatArray  # mean of both grips
    measured: dict[str, float]

    @property
    def peak(self) -> int:
        """Record of the largest stress."""
        return int(self.stress.argmax())

    @property
    def rupture(self) -> float | None:
        """Strain where the stress falls under a fifth of its peak for the last time, if it does."""
        torn = ruptured(self.stress)
        return None if torn is None else float(self.strain[torn])

    def initial(self) -> float:
        """Slope of the line through what is before `LOW` of the peak."""
        end = int(np.argmax(self.stress > LOW * self.stress[self.peak]))
        part = slice(0, max(end, 3))
        return float(np.polyfit(self.strain[part], self.stress[part], 1)[0])

    def plateau(self) -> tuple[float, float, float]:
        """First and last strain of `HIGH` of the peak, and the slope of the line between."""
        high = np.flatnonzero(self.stress > HIGH * self.stress[self.peak])
        part = slice(high[0], high[-1] + 1)
        slope = float(np.polyfit(self.strain[part], self.stress[part], 1)[0])
        return float(self.strain[high[0]]), float(self.strain[high[-1]]), slope

    def drops(self) -> tuple[FloatArray, FloatArray]:
        """Falls of the stress, each from a maximum to the next minimum.

        Over the largest stress, and over the stress that each begins at.
        """
        turns = np.flatnonzero(np.diff(np.sign(np.diff(self.stress)))) + 1
        levels = self.stress[np.concatenate([[0], turns, [len(self.stress) - 1]])]
        levels = levels / self.stress[self.peak]
        falls = -np.diff(levels)
        large = (falls > DROP) & (levels[:-1] > DROP)
        return falls[large], (falls / levels[:-1])[large]


def curve(kept: Kept) -> Curve:
    columns = kept.table.columns
    measured = kept.table.summary["measured"]
    return Curve(columns["strain"], pulled(columns), measured)


def goals(jobs: dict[str, Kept]) -> Iterator[tuple[str, str, str, bool | None]]:
    """Yield what is asked for, the goal, what is measured, and whether that holds (None: open)."""
    curves = {name: curve(kept) for name, kept in jobs.items()}
    elastic, plastic = curves["elastic"], curves["plastic"]
    late = None
    if elastic.rupture is not None:
        late = elastic.rupture / float(elastic.strain[elastic.peak]) - 1
    yield ("elastic tissue: further strain until a fifth of the stress is left", "25 %",
           "no rupture" if late is None else f"{100 * late:.0f} % of that at the peak",
           late is not None and late <= 0.25)  # fmt: skip
    share, span = crack(jobs["elastic"])
    yield ("elastic tissue: broken links that are of the largest crack", "70 %",
           f"{100 * share:.0f} %", share > 0.7)  # fmt: skip
    yield "elastic tissue: its span / width", "1", f"{span:.2f}", span > 0.95
    what = "rupture strain of a plastic / an elastic tissue"
    if elastic.rupture is None or plastic.rupture is None:
        found = " and ".join(name for name, each in curves.items() if each.rupture is None)
        yield what, "3", f"no rupture: {found}", None
    else:
        ratio = plastic.rupture / elastic.rupture
        found = f"{plastic.rupture:.2g}/{elastic.rupture:.2g} = {ratio:.2g}"
        yield what, "3", found, ratio >= 3
    first, last, slope = plastic.plateau()
    flat = abs(slope) / plastic.initial()
    yield (f"plastic tissue: slope for ε = {first:.2g} to {last:.2g} / at the start", "10 %",
           f"{100 * flat:.1f} %", flat < 0.1)  # fmt: skip
    for drops, of in zip(plastic.drops(), ("the peak", "the stress before"), strict=True):
        early, later = drops[: len(drops) // 2].mean(), drops[len(drops) // 2 :].mean()
        yield (f"plastic tissue: mean fall over {of}, earlier and later half of falls", "grow",
               f"{100 * early:.0f} %, {100 * later:.0f} %", later > early)  # fmt: skip
    for name, each in curves.items():
        missing = each.measured["energy_missing_ratio"]
        yield f"{name} tissue: energy missing / work", "1e-4", f"{missing:.1e}", missing < 1e-4
        error = each.measured["breaking_error"]
        yield (f"{name} tissue: energy lost with links against that of their criterion", "1e-2",
               f"{error:.1e}", error < 1e-2)  # fmt: skip


def report(jobs: dict[str, Kept]) -> None:
    made = jobs["elastic"].table.summary["preparation"]
    print(
        f"{made['vertices']:.0f} vertices, {made['sides']:.0f} sides between two cells, "
        f"{made['links']:.0f} links.\n"
    )
    heads = ("", "σ R²/k_b, largest", "at ε", "W/W₀ there: mean, largest", "links broken then",
             "in the end", "work done / W₀", "CPU s")  # fmt: skip
    print("| " + " | ".join(heads) + " |")
    print("| --- " * len(heads) + "|")
    for name, kept in jobs.items():
        table, unit = kept.table.columns, made["link_energy"]
        shape = curve(kept)
        peak = shape.peak
        cells = [
            name, f"{shape.stress[peak]:.3g}", f"{shape.strain[peak]:.3g}",
            f"{table['mean_cell_energy'][peak]:.2g}, {table['largest_cell_energy'][peak]:.2g}",
            f"{table['links_broken'][peak]:.0f}", f"{shape.measured['links_broken']:.0f}",
            f"{table['work'][-1] / unit:.0f}", f"{kept.table.summary['run']['cpu_s']:.0f}",
        ]  # fmt: skip
        print("| " + " | ".join(cells) + " |")
    print("\n| what | goal | measured | |")
    print("| --- | --- | --- | --- |")
    for what, goal, found, holds in goals(jobs):
        print(f"| {what} | {goal} | {found} | {VERDICTS[holds]} |")


def outlines(s: Snapshot) -> tuple[list[FloatArray], FloatArray]:
    """Return the corners and the energy of each cell."""
    cells = Shells(s)
    discs = cells.as_discs(s)
    assert discs.energy is not None
    around = zip(discs.position, cells.outlines(s), strict=True)
    return [middle + outline for middle, outline in around], discs.energy


def crack(kept: Kept) -> tuple[float, float]:
    """Return the share of broken links that are of the largest crack, and its span / width."""
    first, last = kept.snapshots[0], kept.snapshots[-1]
    cell = Shells(first).number
    held = first.kind == COHESIVE
    ends = list(zip(first.i[held].tolist(), first.j[held].tolist(), strict=True))
    left = links(last)
    broken = np.array([pair not in left for pair in ends])
    one, other = cell[np.array(ends)].T
    number = cracks(one, other, broken, cell.max() + 1)
    largest = broken & (number == np.bincount(number[broken]).argmax())
    along = np.isin(cell, [*one[largest], *other[largest]])
    return float(largest.sum() / broken.sum()), float(np.ptp(last.position[along, 0]) / first.width)


def links(s: Snapshot) -> set[tuple[int, int]]:
    held = s.kind == COHESIVE
    return set(zip(s.i[held].tolist(), s.j[held].tolist(), strict=True))


def draw_cells(axis: Axes, kept: Kept, number: int, name: str, height: float) -> PolyCollection:
    s, unit = kept.snapshots[number], kept.table.summary["preparation"]["link_energy"]
    polygons, energy = outlines(s)
    drawn = PolyCollection(
        polygons, array=energy / unit, cmap=mpl.colormaps["YlOrRd"].resampled(LEVELS),
        edgecolors="0.25", linewidths=0.25,
    )  # fmt: skip
    drawn.set_clim(0.0, FULL[name])
    axis.add_collection(drawn)
    gone = np.array(sorted(links(kept.snapshots[0]) - links(s)), int).reshape(-1, 2)
    radius = kept.table.summary["parameters"]["packing"]["radius"]
    near = np.hypot(*(s.position[gone[:, 0]] - s.position[gone[:, 1]]).T) < 0.5 * radius
    axis.add_collection(LineCollection(list(s.position[gone[near]]), colors="C0", linewidths=0.9))
    for nx, ny, position in s.walls:
        assert nx == 0
        axis.plot([0, s.width], 2 * [ny * position], color="0.1", lw=1.5)
    strain = kept.strain[number]
    axis.set_title(f"{name}, ε = {strain:.3f}" if strain else f"{name}, at the start")
    axis.set(xlim=(-0.04 * s.width, 1.04 * s.width), ylim=(-0.02 * height, 1.02 * height))
    axis.set(aspect="equal")
    axis.set_axis_off()
    return drawn


def breaking_forces(kept: Kept) -> tuple[FloatArray, FloatArray]:
    """Return the forces (n, 2) / strengths of links at their break, and of whole ones at last."""
    given: dict[str, Any] = {
        key: dict(value) for key, value in kept.table.summary["parameters"].items()
        if key != "record"
    }  # fmt: skip
    given["packing"] |= {"particles": CELLS}
    given["shear"] |= {"strain": 0.05, "relative_rate": 0.002}
    run = SoftParticleSimulation(SoftParticlePoint.model_validate(given), Streams(1, 0))
    run.advance(100_000)
    made = run.run.system.links
    forces = np.column_stack([made.pull / made.law[2], made.shear / made.law[3]])
    return forces[made.intact == 0], forces[made.intact == 1]


def draw(path: Path, jobs: dict[str, Kept]) -> None:
    with style.figure(style.DOUBLE, 7.4) as figure:
        above, below = figure.subfigures(2, 1, height_ratios=(2.4, 1))
        axes = above.subplots(2, 3)
        for line, (name, kept) in zip(axes, jobs.items(), strict=True):
            shape = curve(kept)
            strain = kept.strain
            shown = (
                int(np.abs(strain - 0.95 * shape.strain[shape.peak]).argmin()),
                int(np.abs(strain - (shape.rupture or strain[-1])).argmin()),
                len(strain) - 1,
            )
            height = float(kept.snapshots[-1].walls[:, 2].min()) * -1
            for axis, number in zip(line, shown, strict=True):
                drawn = draw_cells(axis, kept, number, name, height)
            bar = above.colorbar(drawn, ax=line, shrink=0.8, aspect=25, pad=0.02)
            bar.set_label("elastic energy of a cell / $W_0$")
        left, right = below.subplots(1, 2)
        for colour, (name, kept) in zip(style.UNORDERED, jobs.items(), strict=False):
            shape = curve(kept)
            left.plot(shape.strain, shape.stress / shape.stress.max(), color=colour, label=name)
        left.set(xlabel="strain $ε$", ylabel="tensile stress / largest")
        left.legend()
        broken, whole = breaking_forces(jobs["elastic"])
        along = np.linspace(-1, 1, 200)
        right.plot(along, 1 - along**2, color=style.GREY, lw=0.8, label="criterion")
        right.plot(whole[:, 1], whole[:, 0], ".", color="0.6", ms=2.5, label="whole")
        right.plot(broken[:, 1], broken[:, 0], "o", color=style.UNORDERED[1], mfc="none",
                   label="at its break")  # fmt: skip
        right.set(xlabel="shear $f_t/f_t^0$", ylabel="pull $f_n/f_n^0$", ylim=(-0.05, 1.3))
        right.legend(loc="upper center", ncols=3, handletextpad=0.3, columnspacing=1.0)
        style.save_as(figure, path, dpi=150, colours=128)


def read_tissues(results: Path) -> dict[str, Kept]:
    """Return the jobs of the study by `KINDS`."""
    jobs = {}
    for path in sorted((results / "jobs").glob("*.parquet")):
        kept = read_kept(path)
        plastic = kept.table.summary["parameters"]["model"].get("yield_moment") is not None
        jobs[KINDS[plastic]] = kept
    return {name: jobs[name] for name in KINDS}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="results folder of the study")
    parser.add_argument("figure", type=Path, help="path of the figure")
    given = parser.parse_args()
    jobs = read_tissues(given.results)
    report(jobs)
    draw(given.figure, jobs)


if __name__ == "__main__":
    main()
