"""Hold the default steps against 0.5 % error of |G*| and G″ over the published range.

.venv/bin/python analysis/default_steps.py [--points 128] [--pairs 400] [FOLDER]

Points spread evenly (a scrambled Sobol sequence) over strain amplitude 0.001 to 2, friction 0 and
0.001 to 1, packing fraction 1 to 2, relative viscosity 0.01 to 1 and three ways of linking, each
with a packing of its own. (Young's modulus is no part of it: it scales every stress, to the bit.)

Jobs that converge with the step are run with 20 to 800 steps per period and both integrators: the
cheapest steps that keep the target in 95 % of them may be the default. The others are judged by the
mean paired difference between the default and four times finer steps, over --pairs packings in each
of three classes: loose discs at amplitudes of 0.2 and more, linked ones from 1 on (32 points of
their own each), and whatever else of the points does not converge. Every pair is a packing of its
own; its difference is relative to the mean of its point. Writes tables and a figure into FOLDER.
"""

import argparse
import sys
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import beta, qmc

from shear_sim import accuracy
from shear_sim.accuracy_report import TARGET, describe_pairs, draw
from shear_sim.aggregate import save
from shear_sim.figures.style import DPI
from shear_sim.models.microgel.parameters import Links, Microgel, MicrogelPoint
from shear_sim.packing import Packing
from shear_sim.protocol import OscillatoryShear
from shear_sim.study import Job

CUTS = ("cells", "bulk", "none")
AMPLITUDES = (1e-3, 2.0)
CHAOTIC = {  # ways of linking and amplitudes at which single runs are not expected to converge
    "loose, amplitude 0.2 to 2": (("none",), (0.2, 2.0)),
    "linked, amplitude 1 to 2": (("cells", "bulk"), (1.0, 2.0)),
}
CLASS_POINTS = 32
LADDER = tuple(Fraction(n, 100) for n in (20, 25, 50, 100, 200, 400, 800))
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


def print_steps(table: pd.DataFrame) -> None:
    """Print what the steps of both integrators cost, and which share keeps the target."""
    titles = (
        "integrator", "steps per period", "\\|G*\\| and G″ within 0.5 %",
        "\\|G*\\|: 95 % below, worst", "G″: 95 % below, worst", "substeps", "CPU time",
    )  # fmt: skip
    print(f"| {' | '.join(titles)} |\n{'| --- ' * len(titles)}|")
    own = table.loc[table["own"].astype(bool), "cpu_per_period"].sum()
    for (scheme, steps), part in table.groupby(["scheme", "steps_per_period"], sort=False):
        good = (part["magnitude_error"] <= TARGET) & (part["loss_error"] <= TARGET)
        errors = " | ".join(
            f"{100 * part[key].quantile(0.95):.2g} %, {100 * part[key].max():.2g} %"
            for key in ("magnitude_error", "loss_error")
        )
        cost = part["cpu_per_period"].sum() / own
        substeps = (part["substeps_per_step"] * steps).mean()
        print(f"| {scheme} | {steps} | {share(good)} | {errors} | {substeps:.0f} | {cost:.2f} |")


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
    measured = []
    for number, job in enumerate(scanned):
        found = accuracy.measure(job, LADDER, energy=False)
        measured.append(found)
        verdict = found.failure or found.verdict
        print(f"{number} {accuracy.describe_point(job, VARIED)}: {verdict}", flush=True)
    table = accuracy.runs_table(measured, VARIED)
    save(table, options.folder / "default_steps")
    draw(table).savefig(options.folder / "default_steps.png", dpi=DPI, metadata={"Software": None})

    verdicts = [found.verdict.verdict for found in measured if found.verdict is not None]
    counts = {name: verdicts.count(name) for name in ("convergent", "chaotic", "uneven")}
    print(f"\n{len(measured)} jobs: {counts}, {len(measured) - len(verdicts)} failed\n")
    convergent = table[table["verdict"] == "convergent"]
    print_steps(convergent)
    own = convergent[convergent["own"].astype(bool)]
    print_orders(own)
    print("\nown steps of what converges, over 0.5 %:")
    for _, bad in own[own[["magnitude_error", "loss_error"]].max(axis=1) > TARGET].iterrows():
        facts = ", ".join(f"{key.rpartition('.')[2]} {bad[key]}" for key in VARIED)
        print(f"  {facts}: {bad['magnitude_error']:.1e}, {bad['loss_error']:.1e}")

    if options.pairs:
        print(f"\nmean paired differences to {accuracy.PAIRED} times finer steps")
        for number, (name, (cuts, amplitudes)) in enumerate(CHAOTIC.items(), 1):
            chosen = jobs(
                CLASS_POINTS, options.discs, frequency=options.frequency, cuts=cuts,
                amplitudes=amplitudes, seed=SEED + 1000 * number,
            )  # fmt: skip
            paired(name, chosen, options.pairs)
        others = [found.job for found in accuracy.representative(measured)]
        others = [job for job in others if class_of(job) is None]
        paired("other points that do not converge", others, options.pairs)


if __name__ == "__main__":
    sys.exit(main())
