r"""G′ and G″ of the three methods in one figure and one table.

shear-sim sweep configs/three_methods.yaml && shear-sim aggregate results/three_methods
.venv/bin/python analysis/three_methods.py results/three_methods \
    analysis/figures/three_methods.png

All numbers are of table ``curves`` of one study. Prints a table in Markdown (kept in
analysis/three_methods.md) with the landmarks of table ``features``.
"""

import argparse
from pathlib import Path

import pandas as pd

from shear_sim.aggregate import load
from shear_sim.figures import style

AMPLITUDE = "shear.strain_amplitude"
METHODS = {"microgel": "microgel, loose discs", "hard_disc": "hard discs",
           "soft_particle": "soft particles"}  # fmt: skip
MODULI = {"storage_modulus": "$G'$", "loss_modulus": "$G''$"}
ROOM = 2.5  # that panels leave for intervals
LANDMARKS = {"softening": "softens at", "yield": "yields at"}


def draw(path: Path, curves: pd.DataFrame) -> None:
    with style.figure(style.DOUBLE, 2.7) as figure:
        axes = figure.subplots(1, 3)
        for axis, scene, colour, marker in zip(axes, METHODS, style.UNORDERED, "os^", strict=False):
            part = curves[curves["scene"] == scene].sort_values(AMPLITUDE)
            for name, symbol in MODULI.items():
                look = style.marker_style(name, colour, marker)
                axis.plot(part[AMPLITUDE], part[f"{name}_mean"], label=symbol, **look)
                low, high = part[f"{name}_ci_low"], part[f"{name}_ci_high"]
                axis.fill_between(part[AMPLITUDE], low, high, color=colour, alpha=0.15, lw=0)
            means = part[[f"{name}_mean" for name in MODULI]]
            shown = means.min().min() / ROOM, means.max().max() * ROOM
            axis.set(xscale="log", yscale="log", ylim=shown, title=METHODS[scene])
            axis.set_xlabel("strain amplitude $\\gamma_0$")
            axis.legend()
        axes[0].set_ylabel("$G'$, $G''$ [Pa]")
        style.save_as(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="folder of the aggregated study")
    parser.add_argument("figure", type=Path, help="path of the figure")
    given = parser.parse_args()
    tables = given.results / "tables"
    curves, features = (load(tables / f"{name}.parquet") for name in ("curves", "features"))
    done, planned = curves["replicates"].sum(), curves["planned"].sum()
    print(f"# The three methods in one table, {done} of {planned} runs\n")
    heads = ["method", "γ₀", "G′ [Pa]", "G″ [Pa]", "tan δ", "I₃/I₁", "runs"]
    print("| " + " | ".join(heads) + " |")
    print("| --- " * len(heads) + "|")
    for _, point in curves.iterrows():
        cells = [METHODS[point["scene"]], f"{point[AMPLITUDE]:g}"]
        for name in MODULI:
            mean, low, high = (
                f"{point[f'{name}_{part}']:.3g}" for part in ("mean", "ci_low", "ci_high")
            )
            cells.append(f"{mean} [{low}, {high}]")
        cells += [f"{point[f'{name}_mean']:.2g}" for name in ("tan_delta", "third_harmonic_ratio")]
        print("| " + " | ".join([*cells, f"{point['n']} of {point['planned']}"]) + " |")
    print()
    for scene, name in METHODS.items():
        own = features[features["scene"] == scene].set_index("landmark")
        found = [
            f"{text} {own.loc[key, 'strain']:.2g} [{own.loc[key, 'strain_ci_low']:.2g}, "
            f"{own.loc[key, 'strain_ci_high']:.2g}]"
            for key, text in LANDMARKS.items()
            if key in own.index and pd.notna(own.loc[key, "strain"])
        ]
        if found:
            print(f"- {name}: {', '.join(found)}")
    draw(given.figure, curves)


if __name__ == "__main__":
    main()
