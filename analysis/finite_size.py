"""What 150 discs and a relative frequency of 0.025 cost in accuracy: G′ and G″ against both.

.venv/bin/python analysis/finite_size.py [--jobs 1] [--figure FILE.png] [folder]

Three scenes (one uncut gel, particles of 30 discs, loose discs) at a small and a large strain
amplitude, with 45 to 2,400 discs, and with 150 discs at relative frequencies 0.003 to 0.2. The cell
and the number of cuts grow with the discs, so that discs, particles and packing fraction stay what
they are and only the periodic images move away. Every number of discs is a study of its own in the
folder (default: results/finite_size), all frequencies are another one: run again, the program does
what is missing. Large packings have fewer replicates, as each is an average of its own.

Everything is compared with the largest packing and with the slowest shear; a fit G = G∞ + c/N says
what the largest packing still lacks. It does not hold where inertia matters: transverse waves of
speed √(G′/ρ) cross the cell in one period when

    N = N₁ = G′ / (k f²),   f the relative frequency, k = πE/8,

and the packing resonates there, and at N₁/n² with the n-th harmonic of its response (f₁ in the
figure: the frequency at which N₁ is 150). Tables (Parquet and CSV) and the figure go to the folder.
"""

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.stats import chi2

import shear_sim
from shear_sim.aggregate import save
from shear_sim.figures import style
from shear_sim.models.microgel.parameters import MicrogelPoint
from shear_sim.statistics import LEVEL, RESAMPLES, interval
from shear_sim.study import Study, read_study

FloatArray = NDArray[np.float64]

SIZES = (45, 90, 150, 300, 600, 1200, 2400)
RATES = (0.003, 0.006, 0.0125, 0.025, 0.05, 0.07, 0.1, 0.2)
AMPLITUDES = (0.01, 0.5)
PUBLISHED = MicrogelPoint()
DISCS, RATE = PUBLISHED.packing.discs, PUBLISHED.shear.relative_frequency
PER_PARTICLE = DISCS // PUBLISHED.model.links.cuts
SCENES = {"bulk": "bulk", "crosslinked": "cells", "uncrosslinked": "none"}  # name: links.cut
WORK = 57_600  # discs × replicates of each point
MOST = 400  # replicates
RATE_REPLICATES = 80
SEED = 1

CUT, AMPLITUDE = "model.links.cut", "shear.strain_amplitude"
N, F = "packing.discs", "shear.relative_frequency"
QUANTITIES = {"storage_modulus": "moduli.periodic.storage", "loss_modulus": "moduli.periodic.loss"}
SYMBOLS = {"storage_modulus": "G′", "loss_modulus": "G″"}
_LABELS = {N: "discs $N$", F: "relative frequency $f\\tau$"}
_TICKS = (45, 150, 600, 2400)
_GUIDES = {"scatter": "$\\propto N^{-1/2}$", "rate": "$\\propto f$"}
COLUMNS = {  # unit and meaning
    "scene": ("", "scene of the study"),
    AMPLITUDE: ("1", "A [-]"),
    N: ("1", "N"),
    F: ("1", "f τ"),
    "quantity": ("", "storage_modulus (G') or loss_modulus (G'')"),
    "replicates": ("1", "packings"),
    "mean": ("Pa", "mean over replicates"),
    "scatter": ("1", "standard deviation of the replicates / mean"),
    "deviation": ("1", "mean / mean of the largest packing (of the slowest shear) - 1"),
    "exponent": ("1", "d ln mean / d ln f between this frequency and the one before"),
    "limit": ("Pa", "intercept of the fit mean = limit + c / N"),
    "limit_deviation": ("1", "limit / mean of the largest packing - 1"),
    "misfit": ("1", "probability of a chi^2 as large as that of this fit"),
    "scatter_exponent": ("1", "slope of ln scatter against ln N"),
}


def study(name: str, discs: int, rates: Sequence[float], replicates: int) -> Study:
    """Return the study of one number of discs, the cell as large as they need."""
    scenes = {"bulk": {CUT: "bulk"}, "uncrosslinked": {CUT: "none"}}
    if discs % PER_PARTICLE == 0:
        scenes["crosslinked"] = {CUT: "cells", "model.links.cuts": discs // PER_PARTICLE}
    text = yaml.safe_dump(
        {
            "cell": {"width": PUBLISHED.cell.width * math.sqrt(discs / DISCS)},
            "packing": {"discs": discs},
            "scenes": scenes,
            "sweep": {"grid": {AMPLITUDE: list(AMPLITUDES), F: list(rates)}},
            "record": {  # what the moduli are read from, and no more
                "every": 4,
                "columns": ["periodic_love_weber_xy", "periodic_torque_yx", "centrifugal_xx"],
            },
            "replicates": replicates,
            "seed": SEED,
        },
        sort_keys=False,
    )
    return read_study(text.encode(), Path(f"{name}.yaml"))


def studies() -> list[Study]:
    """Return a study for each number of discs, and that of all frequencies."""
    sizes = [study(f"discs_{n}", n, [RATE], min(MOST, WORK // n)) for n in SIZES]
    return [*sizes, study("rates", DISCS, RATES, RATE_REPLICATES)]


def resample(
    samples: Sequence[FloatArray], rng: np.random.Generator, *, paired: bool
) -> tuple[FloatArray, FloatArray]:
    """Return means and standard deviations of samples, and of bootstrap samples of them.

    Parameters
    ----------
    samples : sequence of (n_i,) arrays
        One value per replicate.
    paired : bool
        Whether value r of all samples comes from one packing: then packings are drawn, for all
        samples the same ones.

    Returns
    -------
    means, deviations : (1 + RESAMPLES, K)
        Row 0 is of the samples themselves.
    """
    means, deviations, picks = [], [], np.empty((0, 0), int)
    for sample in samples:
        n = len(sample)
        if not paired or not picks.size:
            picks = np.vstack([np.arange(n), rng.integers(n, size=(RESAMPLES, n))])
        drawn = sample[picks]
        means.append(drawn.mean(axis=1))
        deviations.append(drawn.std(axis=1, ddof=1))
    return np.column_stack(means), np.column_stack(deviations)


def estimate(name: str, values: FloatArray) -> dict[str, float]:
    """Return the value in row 0 and the percentile interval of all other rows."""
    low, high = np.quantile(values[1:], [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return {name: float(values[0]), f"{name}_ci_low": float(low), f"{name}_ci_high": float(high)}


def extrapolate(
    means: FloatArray, errors: FloatArray, sizes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Fit G = G∞ + c/N by weighted least squares.

    Parameters
    ----------
    means : (..., K)
        Mean moduli [Pa].
    errors, sizes : (K,)
        Their standard errors [Pa]; N.

    Returns
    -------
    limit, chi_square : (...)
        G∞ [Pa], and the weighted sum of squares that the fit leaves.
    """
    weight, x = errors**-2, 1 / sizes
    x = x - (weight * x).sum() / weight.sum()
    slope = (means * weight * x).sum(axis=-1) / (weight * x**2).sum()
    centre = (means * weight).sum(axis=-1) / weight.sum()
    left = (means - centre[..., None] - slope[..., None] * x) / errors
    return centre + slope * (x - 1 / sizes)[0], (left**2).sum(axis=-1)


def samples_of(runs: pd.DataFrame, by: str, quantity: str) -> tuple[FloatArray, list[FloatArray]]:
    """Return the values of ``by`` in ``runs`` and the sample at each, in order of replicates."""
    groups = runs.sort_values("replicate").groupby(by)[QUANTITIES[quantity]]
    return np.array(list(groups.groups), float), [group.to_numpy(float) for _, group in groups]


def reduce(
    runs: pd.DataFrame, by: str, *, paired: bool
) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    """Return rows of points, and of trends, of all scenes, amplitudes and moduli.

    Parameters
    ----------
    runs : DataFrame
        As `shear_sim.run_study` returns it.
    by : str
        What the moduli are given against: ``packing.discs``, compared with the largest, or
        ``shear.relative_frequency``, compared with the lowest.
    paired : bool
        See `resample`.
    """
    rng = np.random.default_rng(SEED)
    points, trends = [], []
    for scene, cut in SCENES.items():
        for amplitude in AMPLITUDES:
            part = runs[(runs[CUT] == cut) & (runs[AMPLITUDE] == amplitude)]
            for quantity in QUANTITIES:
                x, samples = samples_of(part, by, quantity)
                means, deviations = resample(samples, rng, paired=paired)
                reference = means[:, -1 if by == N else 0]
                what = {"scene": scene, AMPLITUDE: amplitude, "quantity": quantity}
                for i, sample in enumerate(samples):
                    found = interval(sample, seed=SEED)
                    row = what | {
                        by: x[i],
                        "replicates": len(sample),
                        "mean": float(means[0, i]),
                        "mean_ci_low": found.low,
                        "mean_ci_high": found.high,
                        **estimate("scatter", deviations[:, i] / means[:, i]),
                        **estimate("deviation", means[:, i] / reference - 1),
                    }
                    if by == F and i > 0:
                        ratio = means[:, i] / means[:, i - 1]
                        row |= estimate("exponent", np.log(ratio) / np.log(x[i] / x[i - 1]))
                    points.append(row)
                if by == N:
                    trends.append(what | size_trends(x, samples, means, deviations))
    return points, trends


def size_trends(
    sizes: FloatArray, samples: Sequence[FloatArray], means: FloatArray, deviations: FloatArray
) -> dict[str, float]:
    """Return the limit N → ∞ and how the scatter of packings falls with N."""
    counts = np.array([len(sample) for sample in samples])
    limit, chi_square = extrapolate(means, deviations[0] / np.sqrt(counts), sizes)
    scatter = np.log(deviations / means)
    x = np.log(sizes)
    x = x - np.average(x, weights=counts)
    # The error of a ln s is 1/√(2n): counts are the weights.
    slope = (scatter * counts * x).sum(axis=1) / (counts * x**2).sum()
    return {
        **estimate("limit", limit),
        **estimate("limit_deviation", limit / means[:, -1] - 1),
        "misfit": float(chi2.sf(chi_square[0], len(sizes) - 2)),
        **estimate("scatter_exponent", slope),
    }


def tables_of(sizes: pd.DataFrame, rates: pd.DataFrame) -> dict[str, pd.DataFrame]:
    """Return all tables from the runs of both scans."""
    by_size, trends = reduce(sizes, N, paired=False)
    by_rate, _ = reduce(rates, F, paired=True)
    return {
        "finite_size": _table(by_size),
        "finite_size_limits": _table(trends),
        "finite_rate": _table(by_rate),
    }


def _table(rows: Sequence[Mapping[str, object]]) -> pd.DataFrame:
    table = pd.DataFrame(rows)
    if N in table:
        table[N] = table[N].astype(int)
    units, texts = {}, {}
    for name in table:
        stem, _, bound = str(name).partition("_ci_")
        units[name] = COLUMNS[stem][0]
        texts[name] = f"{bound} bound of {stem}" if bound else COLUMNS[stem][1]
    table.attrs = {"units": units, "descriptions": texts}
    return table


def describe(tables: Mapping[str, pd.DataFrame]) -> str:
    """Return two Markdown tables: deviations against N, and moduli against the frequency.

    Intervals stand where the published values are; those of all others are in the files.
    """
    keys = ["scene", AMPLITUDE, "quantity"]
    limits = tables["finite_size_limits"].set_index(keys)
    sizes = [f"{n:,}: Δ [%]" for n in SIZES[:-1]]
    heads = ["scene", "A", "", *sizes, "N → ∞: Δ [%]", "p", f"scatter at {DISCS}", "∝ N to the"]
    lines = _heading(f"Δ: deviation from {SIZES[-1]:,} discs", heads)
    for case, points in tables["finite_size"].groupby(keys, sort=False):
        rows, limit = points.set_index(N), limits.loc[case]
        cells = [
            _cell(rows.loc[n], "deviation", 100, bounds=n == DISCS) if n in rows.index else ""
            for n in SIZES[:-1]
        ]
        cells += [_cell(limit, "limit_deviation", 100), f"{limit['misfit']:.2g}"]
        cells += [f"{100 * rows.loc[DISCS, 'scatter']:.2g} %", _cell(limit, "scatter_exponent")]
        lines.append(_line([case[0], f"{case[1]:g}", SYMBOLS[case[2]], *cells]))
    rates = [f"{f:g}: [Pa]" for f in RATES]
    heads = ["scene", "A", "", *rates, f"{RATE:g}: Δ [%]", "∝ f to the"]
    lines += ["", *_heading(f"Δ: deviation from relative frequency {RATES[0]:g}", heads)]
    for case, points in tables["finite_rate"].groupby(keys, sort=False):
        rows = points.set_index(F)
        cells = [f"{rows.loc[f, 'mean']:.4g}" for f in RATES]
        cells += [_cell(rows.loc[RATE], "deviation", 100), _cell(rows.loc[RATE], "exponent")]
        lines.append(_line([case[0], f"{case[1]:g}", SYMBOLS[case[2]], *cells]))
    return "\n".join(lines)


def _heading(caption: str, heads: Sequence[str]) -> list[str]:
    return [f"{caption}\n", _line(heads), _line(["---"] * len(heads))]


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cell(row: "pd.Series[float]", name: str, scale: float = 1, *, bounds: bool = True) -> str:
    text = f"{scale * row[name]:.2f}"
    if bounds:
        low, high = (scale * row[f"{name}_ci_{end}"] for end in ("low", "high"))
        text += f" [{low:.2f}, {high:.2f}]"
    return text


def resonance(storage: float) -> float:
    """Return N₁ f², G′/k: where waves cross the cell in one period (see above).

    The wave speed is √(G′/ρ), the period √(m/k)/f, and N m = ρ L².
    """
    return storage / (math.pi * PUBLISHED.model.young_modulus / 8)


def draw(tables: Mapping[str, pd.DataFrame], path: Path) -> None:
    """Write the figure: deviation and scatter against N, moduli against frequency."""
    sizes, rates = tables["finite_size"], tables["finite_rate"]
    with style.figure(style.DOUBLE, 6.6) as figure:
        panels = figure.subplots(3, len(SCENES), sharex="row")
        for scene, (top, middle, bottom) in zip(SCENES, panels.T, strict=True):
            part = sizes[sizes["scene"] == scene]
            _curves(part, "deviation", top, 100)
            _curves(part, "scatter", middle, 100)
            _curves(rates[rates["scene"] == scene], "mean", bottom, 1)
            top.set_title(scene)
            top.axhline(0, color="k", lw=0.6, zorder=1)
            n = np.array([SIZES[0], SIZES[-1]])
            middle.plot(n, 20 / np.sqrt(n), color="0.5", lw=0.8, ls=":", label=_GUIDES["scatter"])
            f = np.array([RATES[0], RATES[-1]])
            bottom.plot(f, 1200 * f, color="0.5", lw=0.8, ls="-.", label=_GUIDES["rate"])
            for axes, published in ((top, DISCS), (middle, DISCS), (bottom, RATE)):
                axes.axvline(published, color="0.8", lw=4, zorder=0)
            for axes in (top, middle):
                axes.set(xscale="log", xlabel=_LABELS[N])
                axes.set_xticks(SIZES, [f"{n:,}" if n in _TICKS else "" for n in SIZES])
                axes.set_xticks([], minor=True)
            middle.set(yscale="log", ylim=(0.2, 60))
            bottom.set(xscale="log", yscale="log", xlabel=_LABELS[F], ylim=(3, 4000))
        _mark_waves(panels[:, 0], sizes)
        panels[0, 0].set_ylabel(f"deviation from N = {SIZES[-1]:,} [%]")
        panels[1, 0].set_ylabel("scatter of packings [%]")
        panels[2, 0].set_ylabel("modulus [Pa]")
        handles = {
            label: handle
            for axes in (panels[0, 0], panels[1, 0], panels[2, 0])
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        figure.legend(
            list(handles.values()), list(handles), loc="outside upper center", ncols=3,
            frameon=False,
        )  # fmt: skip
        figure.savefig(path, dpi=150, metadata={"Software": None})


def _mark_waves(panels: Sequence[Axes], sizes: pd.DataFrame) -> None:
    """Mark where waves resonate in the uncut gel, whose G′ hardly changes."""
    gel = sizes[(sizes["scene"] == "bulk") & (sizes["quantity"] == "storage_modulus")]
    product = resonance(float(gel["mean"].iloc[-1]))
    first = product / RATE**2
    for axes in panels[:2]:
        _mark(axes, first, "$N_1$", 0.94)
        _mark(axes, first / 4, "$N_1/4$", 0.94)
    _mark(panels[2], math.sqrt(product / DISCS), "$f_1$", 0.75)


def _mark(axes: Axes, x: float, text: str, height: float) -> None:
    axes.axvline(x, color="k", lw=0.6, ls=(0, (4, 3)), zorder=1)
    axes.text(x, height, f" {text}", transform=axes.get_xaxis_transform(), fontsize=7)


def _curves(table: pd.DataFrame, name: str, axes: Axes, scale: float) -> None:
    """Draw G′ and G″ with bands of their intervals, a colour for each amplitude."""
    x = N if N in table else F
    for amplitude, colour in zip(AMPLITUDES, style.UNORDERED, strict=False):
        for quantity, line in (("storage_modulus", "-o"), ("loss_modulus", "--s")):
            rows = table[(table[AMPLITUDE] == amplitude) & (table["quantity"] == quantity)]
            low, high = (scale * rows[f"{name}_ci_{end}"] for end in ("low", "high"))
            axes.plot(
                rows[x], scale * rows[name], line, color=colour,
                markerfacecolor=colour if quantity == "storage_modulus" else "white",
                label=f"{SYMBOLS[quantity]}, A = {amplitude:g}",
            )  # fmt: skip
            axes.fill_between(rows[x], low, high, color=colour, alpha=0.2, lw=0)


def main() -> None:
    """Run what is missing; print, write and draw."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("results/finite_size"))
    parser.add_argument("--jobs", type=int, help="worker processes; default: all cores")
    parser.add_argument("--figure", type=Path, help="default: finite_size.png in the folder")
    options = parser.parse_args()
    runs = []
    for each in studies():
        runs.append(shear_sim.run_study(each, options.folder, jobs=options.jobs))
        if (missing := len(each.jobs()) - len(runs[-1])) > 0:
            sys.exit(f"{missing} jobs have no result: see {options.folder / each.name / 'failed'}")
    tables = tables_of(pd.concat(runs[:-1]), runs[-1])
    print(describe(tables))
    for name, table in tables.items():
        save(table, options.folder / name)
    draw(tables, options.figure or options.folder / "finite_size.png")


if __name__ == "__main__":
    main()
