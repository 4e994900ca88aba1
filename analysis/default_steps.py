"""Hold the default steps against 0.5 % error of |G*| and G″ over the published range.

.venv/bin/python analysis/default_steps.py [--points 256] [--pairs 1000] [FOLDER]

Points spread evenly (a scrambled Sobol sequence) over strain amplitude 0.001 to 2, friction 0 and
0.001 to 1, packing fraction 1 to 2, relative viscosity 0.01 to 1 and three ways of linking, each
with a packing of its own. (Young's modulus is no part of it: it scales every stress, to the bit.)

Jobs that converge with the step are run with whole steps of several lengths, all of them recorded,
times several limits of the substeps: `STEP_ENERGY`, the longest substep in units of the stable one
where springs act alone, from 0.35 to 1, and others of the limits one by one. (What stability with
dashpots asks for stays: no limit can be coarser.) Errors are against limits and steps 32 times
finer with 960 records per period, so that what the records lose is part of them. The cost is the
substeps per period, which no clock disturbs, and CPU time. The cheapest pair of steps and limit
that keeps the target in 95 % of the jobs may be the default.

The others are judged by the mean paired difference between the default and four times finer steps,
over --pairs packings in each of three classes: loose discs at amplitudes of 0.2 and more, linked
ones from 1 on (32 points of their own each), and whatever else of the points does not converge.
Every pair is a packing of its own; its difference is relative to the mean of its point. Writes a
table and a figure into FOLDER.
"""

import argparse
import copy
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy.stats import beta, qmc

from shear_sim import accuracy
from shear_sim.accuracy_report import TARGET, describe_pairs
from shear_sim.aggregate import save
from shear_sim.figures import style
from shear_sim.models.interface import SimulationError
from shear_sim.models.microgel.parameters import Links, Microgel, MicrogelPoint
from shear_sim.models.microgel.preparation import Start, make_start
from shear_sim.models.microgel.simulation import (
    STEP_ENERGY,
    MicrogelSimulation,
    kernels_of,
    make_clock,
    refined,
)
from shear_sim.packing import Packing
from shear_sim.protocol import OscillatoryShear
from shear_sim.rheology import Moduli
from shear_sim.study import Job

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CUTS = ("cells", "bulk", "none")
AMPLITUDES = (1e-3, 2.0)
CHAOTIC = {  # ways of linking and amplitudes at which single runs are not expected to converge
    "loose, amplitude 0.2 to 2": (("none",), (0.2, 2.0)),
    "linked, amplitude 1 to 2": (("cells", "bulk"), (1.0, 2.0)),
}
CLASS_POINTS = 32
REFERENCE, RECORDS = 32, 960  # times the default steps and limits; records per period
STEPS = (25, 50, 75, 100, 150)  # % of the default ones
LIMITS = (0.35, STEP_ENERGY, 0.75, 1.0)
OTHER_LIMITS = {  # times the default ones
    "step_rolling": (2 / 3, 4 / 3),
    "step_approach": (0.5, 2.0),
    "step_strain": (0.5, 2.0),
}
FINER = (2, 4)  # steps and limits, as by integrator.steps_per_period
VARIED = (
    "shear.strain_amplitude", "model.links.cut", "model.friction", "packing.packing_fraction",
    "model.relative_viscosity",
)  # fmt: skip
SEED = 3


def jobs(
    points: int,
    discs: int,
    *,
    frequency: float = 0.025,
    cuts: Sequence[str] = CUTS,
    amplitudes: tuple[float, float] = AMPLITUDES,
    seed: int = SEED,
) -> list[Job]:
    """Return one job per point of a range, each with packings of its own."""
    unit = qmc.Sobol(5, rng=np.random.default_rng(seed)).random(points)
    low, high = np.log10(amplitudes)
    made = []
    for number, (amplitude, cut, friction, fraction, viscosity) in enumerate(unit):
        # A sixth of the points has no friction at all, which is another kernel.
        mu = 0.0 if friction < 1 / 6 else 10 ** (-3 + 3 * (friction - 1 / 6) / (5 / 6))
        point = MicrogelPoint(
            packing=Packing(discs=discs, packing_fraction=1 + fraction),
            model=Microgel(
                friction=mu,
                relative_viscosity=10 ** (-2 + 2 * viscosity),
                links=Links(cut=cuts[int(len(cuts) * cut)]),
            ),
            shear=OscillatoryShear(
                strain_amplitude=10 ** (low + amplitude * (high - low)),
                relative_frequency=frequency,
            ),
        )
        made.append(Job.create(point, seed + number, 0))
    return made


def class_of(job: Job) -> str | None:
    """Return the class of `CHAOTIC` that a job belongs to."""
    cut, amplitude = job.point.model.links.cut, job.point.shear.strain_amplitude
    for name, (cuts, (low, high)) in CHAOTIC.items():
        if cut in cuts and low <= amplitude <= high:
            return name
    return None


def share(within: "Sequence[bool] | pd.Series[bool]") -> str:
    """Return a share with its 95 % interval (Clopper and Pearson)."""
    n, k = len(within), int(np.sum(within))
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    part = 100 * k / n if n else np.nan
    return f"{k} of {n}: {part:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


@dataclass(frozen=True)
class Way:
    """One way to step: % of the default steps, limit of the substeps, one other limit changed."""

    percent: int = 100
    limit: float = STEP_ENERGY
    changed: str = ""
    times: float = 1.0
    finer: int = 1
    scheme: str = "velocity_verlet"

    @property
    def name(self) -> str:
        """What differs from the default, but for the whole steps."""
        names = [f"{self.changed} × {self.times:.2g}"] if self.changed else []
        names += [f"all limits / {self.finer}"] if self.finer > 1 else []
        return ", ".join(names) or f"limit {self.limit:g}"


WAYS = (
    *(Way(percent, limit) for limit in LIMITS for percent in STEPS),
    *(Way(changed=name, times=times) for name, many in OTHER_LIMITS.items() for times in many),
    *(Way(100 * finer, finer=finer) for finer in FINER),
    *(Way(100 * finer, finer=finer, scheme="semi_implicit_euler") for finer in (1, *FINER)),
)
DEFAULT = Way()


def run(job: Job, start: Start, way: Way, every: int = 1) -> tuple[Moduli, float, float]:
    """Return the moduli of a run, and its substeps and CPU seconds per period."""
    point, steps = job.point, job.point.steps_per_period * way.percent // 100
    update = {"scheme": way.scheme, "steps_per_period": steps}
    point = point.model_copy(update={"integrator": point.integrator.model_copy(update=update)})
    constants = refined(start.constants, way.finer)
    changes = {"step_energy": way.limit / STEP_ENERGY}
    if way.changed:
        changes[way.changed] = way.times
    constants = constants._replace(
        **{name: times * getattr(constants, name) for name, times in changes.items()}
    )
    discs, links, contacts = copy.deepcopy((start.discs, start.links, start.contacts))
    simulation = MicrogelSimulation(
        point, kernels_of(point), discs, links, contacts, constants,
        make_clock(point.shear, start.period, steps, every), start.preparation,
    )  # fmt: skip
    began = process_time()
    simulation.advance(simulation.rows)
    cpu = process_time() - began
    periods = simulation.steps / steps
    return accuracy.response(job, simulation)[0], simulation.substeps / periods, cpu / periods


def scan(job: Job) -> list[dict[str, Any]]:
    """Return one row per way to step: its cost and its errors against the reference."""
    start = make_start(job.point, job.streams)
    finest = Way(100 * REFERENCE, finer=REFERENCE)
    every = job.point.steps_per_period * REFERENCE // RECORDS
    reference, _, _ = run(job, start, finest, every)
    rows = []
    for way in WAYS:
        row: dict[str, Any] = {"way": way.name} | vars(way)
        row["steps_per_period"] = job.point.steps_per_period * way.percent // 100
        row["magnitude_error"] = row["loss_error"] = np.inf
        try:
            found, row["substeps"], row["cpu"] = run(job, start, way)
        except SimulationError as error:
            rows.append(row | {"failed": str(error)})
            continue
        row["magnitude_error"] = abs(found.magnitude / reference.magnitude - 1)
        row["loss_error"] = abs(found.loss / reference.loss - 1)
        rows.append(row)
    return rows


def print_ways(table: pd.DataFrame) -> None:
    """Print what each way to step costs, and which share of the jobs keeps the target."""
    titles = (
        "integrator, limits", "steps per period", "\\|G*\\| and G″ within 0.5 %",
        "\\|G*\\|: 95 % below, worst", "G″: 95 % below, worst", "substeps: mean", "median",
        "CPU time",
    )  # fmt: skip
    print(f"| {' | '.join(titles)} |\n{'| --- ' * len(titles)}|")
    own = table.loc[of_way(table, DEFAULT), "cpu"].sum()
    for way in WAYS:
        part = table[of_way(table, way)]
        good = (part["magnitude_error"] <= TARGET) & (part["loss_error"] <= TARGET)
        errors = " | ".join(
            f"{100 * part[key].quantile(0.95):.2g} %, {100 * part[key].max():.2g} %"
            for key in ("magnitude_error", "loss_error")
        )
        name = way.name if way.scheme == DEFAULT.scheme else f"{way.scheme}, {way.name}"
        print(
            f"| {name} | {part['steps_per_period'].iloc[0]} | {share(good)} | {errors} "
            f"| {part['substeps'].mean():.0f} | {part['substeps'].median():.0f} "
            f"| {part['cpu'].sum() / own:.2f} |"
        )


def of_way(table: pd.DataFrame, way: Way) -> "pd.Series[bool]":
    """Tell which rows are of a way to step."""
    same = [table[name] == value for name, value in vars(way).items()]
    return pd.concat(same, axis=1).all(axis=1)


def draw(table: pd.DataFrame, left: str) -> "Figure":
    """Draw the 95 % quantile of both errors against the substeps per period.

    Parameters
    ----------
    table : DataFrame
        Rows of `scan` of the jobs that converge.
    left : str
        What is said of the others.
    """
    families = {
        f"limit {limit:g}": [
            w for w in WAYS if w.name == f"limit {limit:g}" and w.scheme == DEFAULT.scheme
        ]
        for limit in LIMITS
    }
    families["default, all n times finer"] = [
        DEFAULT,
        *(w for w in WAYS if w.finer > 1 and w.scheme == DEFAULT.scheme),
    ]
    families["semi-implicit Euler, the same"] = [w for w in WAYS if w.scheme != DEFAULT.scheme]
    families["other limits"] = [w for w in WAYS if w.changed]
    with style.figure(style.DOUBLE, 3.4) as figure:
        panels = figure.subplots(1, 2, sharex=True)
        keys = {"magnitude_error": "$|G^*|$", "loss_error": "$G''$"}
        for axis, (key, symbol) in zip(panels, keys.items(), strict=True):
            for number, (name, ways) in enumerate(families.items()):
                parts = [table[of_way(table, way)] for way in ways]
                x = np.array([part["substeps"].mean() for part in parts])
                y = np.array([part[key].quantile(0.95) for part in parts])
                line = "none" if name == "other limits" else "-"
                colour = style.UNORDERED[number]
                axis.loglog(
                    x, y, marker=style.MARKERS[number], linestyle=line, color=colour, label=name,
                    markersize=3, linewidth=0.9, zorder=3 + 0.1 * number,
                )  # fmt: skip
                if number == 0 and key == "loss_error":  # else one is upon another
                    for at, part in zip(zip(x, y, strict=True), parts, strict=True):
                        axis.annotate(
                            f"{part['steps_per_period'].iloc[0]}", at, fontsize=6, color=colour,
                            xytext=(-5 if at[0] < x[0] else 5, 0), textcoords="offset points",
                            ha="right" if at[0] < x[0] else "left", va="center",
                        )  # fmt: skip
            own = table[of_way(table, DEFAULT)]
            axis.plot(
                own["substeps"].mean(), own[key].quantile(0.95), "*", color="black", markersize=9,
                markerfacecolor="#F0E442", linestyle="none", label="default", zorder=5,
            )  # fmt: skip
            axis.axhline(TARGET, color="0.4", linewidth=0.8, linestyle=":", label="0.5 %")
            axis.set_ylabel(f"relative error of {symbol}: 95 % are below")
            axis.set_xlabel("substeps per period $T$, mean")
            style.log_ticks(axis.xaxis, float(axis.get_xlim()[0]), float(axis.get_xlim()[1]))
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)
        style.note(
            figure,
            f"{table['number'].nunique()} jobs that converge with the step ({left}); numbers: "
            "whole steps per period, all recorded",
        )  # fmt: skip
    return figure


def paired(name: str, points: Sequence[Job], pairs: int) -> None:
    """Print the mean paired difference over packings of some points."""
    if not points:
        return
    packings = -(-pairs // len(points))
    found = [accuracy.paired_differences(job, packings) for job in points]
    differences, failed = zip(*found, strict=True)
    pooled = accuracy.summarise_pairs(np.concatenate(differences), sum(failed), seed=SEED)
    spread = 100 * np.concatenate(differences).std(axis=0)
    print(
        f"{name}: {describe_pairs(pooled)}; {len(points)} points × {packings} packings, "
        f"standard deviation {spread[0]:.2g} % and {spread[1]:.2g} %",
        flush=True,
    )


def scan_all(points: Sequence[Job], folder: Path) -> list[Job]:
    """Scan the points, write the table and the figure; return those that do not converge."""
    measured, rows = [], []
    for number, job in enumerate(points):
        own = accuracy.measure(
            job, (Fraction(1),), (DEFAULT.scheme,), reference=REFERENCE // 2, energy=False
        )
        measured.append(own)
        said = own.failure or own.verdict
        print(f"{number} {accuracy.describe_point(job, VARIED)}: {said}", flush=True)
        if own.verdict is not None:
            facts = {"number": number, "verdict": own.verdict.verdict}
            facts |= {key: value for key, value in own.runs[0].items() if key == "stress_error"}
            facts["halved_error"] = own.verdict.halved_error
            facts |= {key: _value(job, key) for key in VARIED}
            rows += [facts | row for row in scan(job)]
    table = pd.DataFrame(rows)
    names = list(table)
    table.attrs = {"units": dict.fromkeys(names, ""), "descriptions": dict.fromkeys(names, "")}
    save(table, folder / "default_steps")

    verdicts = [found.verdict.verdict for found in measured if found.verdict is not None]
    counts = [f"{verdicts.count(name)} {name}" for name in ("convergent", "chaotic", "uneven")]
    print(f"\n{len(measured)} jobs: {', '.join(counts)}, {len(measured) - len(verdicts)} failed\n")
    convergent = table[table["verdict"] == "convergent"]
    style.save(draw(convergent, f"{counts[1]}, {counts[2]}"), folder / "default_steps")
    print_ways(convergent)
    own_rows = convergent[of_way(convergent, DEFAULT)]
    print_orders(own_rows)
    print("\nthe default where it converges, over 0.5 %:")
    over = own_rows[["magnitude_error", "loss_error"]].max(axis=1) > TARGET
    for _, bad in own_rows[over].iterrows():
        facts = ", ".join(f"{key.rpartition('.')[2]} {bad[key]}" for key in VARIED)
        print(f"  {facts}: {bad['magnitude_error']:.1e}, {bad['loss_error']:.1e}")
    return [found.job for found in accuracy.representative(measured)]


def _value(job: Job, key: str) -> Any:
    section, _, name = key.partition(".")
    value = getattr(job.point, section)
    for part in name.split("."):
        value = getattr(value, part)
    return value


def print_orders(table: pd.DataFrame) -> None:
    """Print the order at which the stress error of the default falls when steps are halved."""
    amplitude = pd.cut(table["shear.strain_amplitude"], [0, 0.01, 0.1, 0.3, 2])
    order = -np.log2(table["halved_error"])
    print("\n| links | amplitude | jobs | order: quartiles | stress error: median |")
    print("| --- " * 5 + "|")
    for (cut, bin_), rows in table.groupby(
        ["model.links.cut", amplitude], observed=True
    ).groups.items():
        low, middle, high = order[rows].quantile([0.25, 0.5, 0.75])
        error = table.loc[rows, "stress_error"].median()
        print(
            f"| {cut} | {bin_.left:g} to {bin_.right:g} | {len(rows)} "
            f"| {low:.1f}, {middle:.1f}, {high:.1f} | {error:.1e} |"
        )


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("results/default_steps"))
    parser.add_argument("--points", type=int, default=128)
    parser.add_argument("--discs", type=int, default=60)
    parser.add_argument("--pairs", type=int, default=400, help="at least, per class; 0: none")
    parser.add_argument("--frequency", type=float, default=0.025, help="relative frequency")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)

    scanned = jobs(options.points, options.discs, frequency=options.frequency)
    undecided = scan_all(scanned, options.folder)
    if options.pairs:
        print(f"\nmean paired differences to {accuracy.PAIRED} times finer steps")
        for number, (name, (cuts, amplitudes)) in enumerate(CHAOTIC.items(), 1):
            chosen = jobs(
                CLASS_POINTS, options.discs, frequency=options.frequency, cuts=cuts,
                amplitudes=amplitudes, seed=SEED + 1000 * number,
            )  # fmt: skip
            paired(name, chosen, options.pairs)
        others = [job for job in undecided if class_of(job) is None]
        paired("other points that do not converge", others, options.pairs)


if __name__ == "__main__":
    sys.exit(main())
