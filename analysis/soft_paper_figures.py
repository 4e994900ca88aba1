r"""Figures 10, 15 to 18, 23 and 24 of the paper: what they show, and what rings of the model do.

.venv/bin/python analysis/soft_paper_figures.py analysis/figures

Draws soft_shapes.png and soft_paper_figures.png into this folder and prints the table of
analysis/soft_paper_figures.md, which says why they differ. The rings are run here (some minutes):
100 vertices, h = 0.05 R, plastic ones with M^Y = 0.02 M*, so slowly that their force is that of
hinges to 3 % (analysis/soft_diametral.md).
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from soft_diametral import ONSET, VERTICES, YIELD, Run, compress, head, profile, row, stadium

from shear_sim.figures import style

FloatArray = NDArray[np.float64]

SEGMENT = 2 * np.sin(np.pi / VERTICES)  # ℓ/R
ROWS = 200
HOLLOW, CORED = (0.5, 0.0025), (0.35, 0.01)  # largest ε, ε̇ T₁: a core makes short steps
ETA = 100.0
PARTS = (0.0, 1 / 3, 2 / 3, 1.0)  # of the largest ε, of the shapes that are drawn
RINGS = {
    "elastic, η = 100\n(figure 10 a)": {"core_ratio": ETA},
    "plastic, η = 100\n(figure 10 b)": {"core_ratio": ETA, "yield_moment": YIELD},
    "elastic, hollow": {},
    "plastic, hollow": {"yield_moment": YIELD},
}
ENDS = 3  # outermost vertices at each end of a contact
BEYOND = 0.32  # ε from which the contact of an elastic ring is long against a segment
NEAR = 0.01  # of ε, over which the force of a plastic ring is averaged to either side


def top(run: Run) -> int:
    """Return the record of the largest compression."""
    return int(run.table["compression"].argmax())


def shapes(path: Path, runs: dict[str, Run]) -> None:
    """Draw each ring on its way there and back: figure 10."""
    number = 2 * len(PARTS) - 1
    with style.figure(style.DOUBLE, 3.6) as figure:
        axes = figure.subplots(len(runs), number)
        for line, (name, run) in zip(axes, runs.items(), strict=True):
            e, last = run.table["compression"], top(run)
            at = [int(np.abs(e[1 : last + 1] - part * e[last]).argmin()) for part in PARTS]
            at += [last + int(np.abs(e[last + 1:] - part * e[last]).argmin())
                   for part in PARTS[-2::-1]]  # fmt: skip
            for axis, k in zip(line, at, strict=True):
                shape = run.outline[k]
                axis.fill(*shape.T, fc="0.9", ec=style.UNORDERED[0], lw=1.0)
                plate = 1 - e[k + 1]
                for side in (-plate, plate):
                    axis.plot([-1.4, 1.4], 2 * [side], color="black", lw=1.2)
                axis.set(xlim=(-1.45, 1.45), ylim=(-1.15, 1.15), aspect="equal")
                axis.set_axis_off()
                axis.set_title(f"ε = {abs(e[k + 1]):.2f}", fontsize=style.SMALL, pad=1)
            line[0].text(-1.6, 0, name, ha="right", va="center", fontsize=style.SMALL)
        style.save_as(figure, path, dpi=200)


def lengths(run: Run, name: str) -> FloatArray:
    """Return a contact length of loading over ℓ."""
    t = run.table
    part = slice(1, top(run) + 1)
    return np.asarray((t[name] * t["diameter"] / t["radius"])[part] / SEGMENT)


def forces(run: Run, moment: float = 1.0) -> FloatArray:
    """Return F of loading over ``moment`` EI/Rℓ: F*, or F** of a yield moment [EI/R]."""
    return np.asarray(run.table["scaled_force"][1 : top(run) + 1] * SEGMENT / moment)


def pressures(
    axis: Axes, run: Run, strains: tuple[float, ...], claim: str, moment: float = 1.0
) -> None:
    """Draw the pressure of the upper plate over p* or p**."""
    for colour, strain in zip(style.UNORDERED, strains, strict=False):
        x, p = profile(run, strain)
        axis.plot(x, p * SEGMENT**2 / moment, ".-", color=colour, ms=2.5, lw=0.9,
                  label=f"ε = {strain:g}")  # fmt: skip
    axis.set(xlabel="$x/R$", ylim=(0, 1.6 * axis.get_ylim()[1]))
    axis.legend(loc="upper center", ncols=2, title=f"claim: {claim}", fontsize=style.SMALL,
                title_fontsize=style.SMALL, handlelength=1.2)  # fmt: skip


def against_claims(path: Path, runs: dict[str, Run]) -> None:
    """Draw forces and pressures of figures 15 to 18, 23 and 24."""
    cored, _, elastic, plastic = runs.values()
    model, law = {"color": style.UNORDERED[0]}, {"color": "black", "ls": ":", "lw": 1.2}
    claim = {"color": style.UNORDERED[1], "ls": "--", "lw": 1.0}
    with style.figure(style.DOUBLE, 5.6) as figure:
        axes = figure.subplots(2, 3)
        along = np.linspace(1, 17)
        axis = axes[0, 0]
        axis.plot(along, along, label="claim (31)", **claim)
        axis.plot(lengths(elastic, "load_ratio"), forces(elastic), label="model", **model)
        e = np.linspace(ONSET + 0.01, HOLLOW[0])
        flat = 2.188 * (e - ONSET) * 2 / SEGMENT
        axis.plot(flat, 1.43554 / (1 - e) ** 2 * SEGMENT, label="elastica", **law)
        axis.set(ylabel="$F/F^*$", title="elastic, hollow (figure 15)")
        axis = axes[1, 0]
        axis.plot(along, along, label="claim (34)", **claim)
        axis.plot(lengths(plastic, "contact_ratio"), forces(plastic, YIELD), label="model", **model)
        e = np.linspace(0.01, HOLLOW[0])
        flat = 2 * np.arcsin(e) / SEGMENT
        axis.plot(flat, 4 * SEGMENT / np.sqrt(1 - e**2), label="plastic hinges", **law)
        axis.set(ylabel="$F/F^{**}$", title="plastic, hollow (figure 17)")
        axis = axes[0, 2]
        length, t = lengths(cored, "contact_ratio"), cored.table
        pressure = inner(cored)
        claimed = (1 + pressure) * length
        axis.plot(length, claimed, label="claim (35)", **claim)
        axis.plot(length, forces(cored), label="model, η = 100", **model)
        e = np.linspace(0.05, CORED[0])
        bears = 2 * stadium(ETA, e)[0] / SEGMENT
        inside = np.interp(e, t["compression"][1 : top(cored) + 1], pressure)
        axis.plot(bears, inside * bears, label="$p L_c$, stadium", **law)
        axis.plot(lengths(elastic, "load_ratio"), forces(elastic), color=style.UNORDERED[2],
                  label="model, η = 0")  # fmt: skip
        axis.set(ylabel="$F/F^*$", title="η = 0 and 100 (figure 23)")
        for axis, high in ((axes[0, 0], 30), (axes[1, 0], 30), (axes[0, 2], 3000)):
            axis.set(yscale="log", xlabel="$L_c/ℓ$", ylim=(0.1, high))
            axis.legend(fontsize=style.SMALL, handlelength=1.6)
        pressures(axes[0, 1], elastic, (0.1, 0.2, 0.35, 0.49), "a plateau at 1")
        axes[0, 1].set(ylabel="$p/p^*$", title="elastic, hollow (figure 16)")
        pressures(axes[1, 1], plastic, (0.1, 0.2, 0.35, 0.49), "a plateau at 1", YIELD)
        axes[1, 1].set(ylabel="$p/p^{**}$", title="plastic, hollow (figure 18)")
        pressures(axes[1, 2], cored, (0.05, 0.15, 0.25, 0.35), "a plateau at 1 + $p_{core}$")
        axes[1, 2].set(ylabel="$p/p^*$", title="η = 100 (figure 24)")
        style.save_as(figure, path, dpi=200)


def table(runs: dict[str, Run]) -> None:
    """Print what the paper claims, what the model does, and what mechanics says."""
    cored, _, elastic, plastic = runs.values()
    head("", "claim", "model", "mechanics")
    e = 0.49
    force = float(np.interp(e, elastic.table["compression"][1 : top(elastic) + 1], forces(elastic)))
    flat = float(elastic.loading("load_ratio", np.array([e]))[0]) * per_segment(elastic)
    law = 1.43554 / (1 - e) ** 2 * SEGMENT
    row(f"elastic, ε = {e:g}: F/F*", f"L_c/ℓ = {flat:.1f}", f"{force:.3f}", f"{law:.3f}")
    strain, apart = elastic.table["compression"], elastic.table["load_ratio"]
    use = (np.arange(len(strain)) <= top(elastic)) & (strain > BEYOND)
    slope, offset = np.polyfit(strain[use], apart[use], 1)
    row("elastic: onset; slope of the distance between its loads / b₀", "–; π/2",
        f"{-offset / slope:.4f}; {slope:.3f}", f"{ONSET}; 2.188")  # fmt: skip
    share = min(at_ends(elastic, k) for k in np.flatnonzero(use) - 1)
    row(f"elastic, ε > {BEYOND:g}: share of the load on the {ENDS} outermost vertices of each end",
        f"{2 * ENDS / (1 + flat):.2f} at ε = {e:g}", f"{share:.3f}", "1")  # fmt: skip
    e = 0.4
    near = np.abs(plastic.table["compression"] - e) < NEAR
    near &= np.arange(len(near)) <= top(plastic)
    unit = YIELD / SEGMENT * plastic.table["bending"][0] / plastic.table["radius"][0] ** 2  # F**
    force = float(plastic.table["mean_force"][near].mean() / unit)
    flat = float(plastic.loading("contact_ratio", np.array([e]))[0]) * per_segment(plastic)
    law = 4 * SEGMENT / np.sqrt(1 - e**2)
    row(f"plastic, ε = {e:g}: F/F**", f"L_c/ℓ = {flat:.1f}", f"{force:.3f}", f"{law:.3f}")
    share = at_ends(plastic, int(np.flatnonzero(near)[0]) - 1)
    row("plastic, there: share of its load on those vertices", f"{2 * ENDS / (1 + flat):.2f}",
        f"{share:.3f}", "1")  # fmt: skip
    k = top(cored)
    e = float(cored.table["compression"][k])
    pressure = float(inner(cored)[-1])
    middle = np.abs(cored.place[k - 1]) < 0.5 * np.abs(cored.place[k - 1]).max()
    plateau = float(cored.pressure[k - 1][middle].mean()) * SEGMENT**2
    flat, force = lengths(cored, "contact_ratio")[-1], forces(cored)[-1]
    row(f"η = {ETA:g}, ε = {e:.2f}: pressure of the plate in the middle, p/p*",
        f"{1 + pressure:.1f}", f"{plateau:.1f}", f"{pressure:.1f}, that of the core")  # fmt: skip
    bears = pressure * 2 * float(stadium(ETA, np.array(e))[0]) / SEGMENT
    row(f"η = {ETA:g}, there: F/F*", f"{(1 + pressure) * flat:.0f}", f"{force:.0f}",
        f"p L_c = {bears:.0f}")  # fmt: skip
    print("\nLet go, residual ε / the largest:")
    for name, run in runs.items():
        left = (1 - float(run.table["height"][0])) / float(run.table["compression"].max())
        print(f"- {name.splitlines()[0]}: {left:.3f}")


def per_segment(run: Run) -> float:
    """Return b₀/ℓ."""
    return float(run.table["diameter"][0] / run.table["radius"][0]) / SEGMENT


def inner(run: Run) -> FloatArray:
    """Return the pressure of the core of loading over p*."""
    t = run.table
    pressure = t["core_pressure"] * t["radius"] ** 3 / t["bending"] * SEGMENT**2
    return np.asarray(pressure[1 : top(run) + 1])


def at_ends(run: Run, k: int) -> float:
    """Return the share of the load that the outermost vertices of both ends bear."""
    x, p = run.place[k], run.pressure[k]
    return float(p[np.abs(x) > np.abs(x).max() - (ENDS - 0.5) * SEGMENT].sum() / p.sum())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of the figures")
    folder = parser.parse_args().folder
    runs = {
        name: compress(*(CORED if "core_ratio" in given else HOLLOW), ROWS, unload=True, **given)
        for name, given in RINGS.items()
    }
    table(runs)
    shapes(folder / "soft_shapes.png", runs)
    against_claims(folder / "soft_paper_figures.png", runs)


if __name__ == "__main__":
    main()
