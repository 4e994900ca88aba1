"""Hold the default steps against 0.5 % error of |G*| and G″ over the published range.

.venv/bin/python analysis/default_steps.py [--points 48] [--packings 24] [--steps N] [folder]

Points spread evenly (a scrambled Sobol sequence) over strain amplitude 0.001 to 2, friction 0 and
0.001 to 1, packing fraction 1 to 2, relative viscosity 0.01 to 1 and three ways of linking, each
run with its own packing. What converges with the step is held against the target of 0.5 % in 95 %
of the jobs; all else by the mean paired difference between the default and four times finer steps,
over --packings packings of each such point and over all of them together. Writes default_steps.csv
and .parquet into the folder.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import beta, qmc

from shear_sim import accuracy
from shear_sim.accuracy_report import TARGET, describe_pairs
from shear_sim.aggregate import save
from shear_sim.models.microgel.parameters import Integrator, Links, Microgel, MicrogelPoint
from shear_sim.packing import Packing
from shear_sim.protocol import OscillatoryShear
from shear_sim.study import Job

CUTS = ("cells", "bulk", "none")
VARIED = (
    "shear.strain_amplitude", "model.links.cut", "model.friction", "packing.packing_fraction",
    "model.relative_viscosity",
)  # fmt: skip
SEED = 3


def jobs(points: int, discs: int, steps: int | None) -> list[Job]:
    """Return one job per point of the published range, each with packings of its own."""
    unit = qmc.Sobol(5, rng=np.random.default_rng(SEED)).random(points)
    made = []
    for number, (amplitude, cut, friction, fraction, viscosity) in enumerate(unit):
        # A sixth of the points has no friction at all, which is another kernel.
        mu = 0.0 if friction < 1 / 6 else 10 ** (-3 + 3 * (friction - 1 / 6) / (5 / 6))
        point = MicrogelPoint(
            packing=Packing(discs=discs, packing_fraction=1 + fraction),
            model=Microgel(
                friction=mu,
                relative_viscosity=10 ** (-2 + 2 * viscosity),
                links=Links(cut=CUTS[int(3 * cut)]),
            ),
            shear=OscillatoryShear(strain_amplitude=10 ** (-3 + amplitude * np.log10(2000))),
            integrator=Integrator(steps_per_period=steps),
        )
        made.append(Job.create(point, SEED + number, 0))
    return made


def share(within: "Sequence[bool] | pd.Series[bool]") -> str:
    """Return a share with its 95 % interval (Clopper and Pearson)."""
    n, k = len(within), int(np.sum(within))
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    part = 100 * k / n if n else np.nan
    return f"{k} of {n}: {part:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("results/default_steps"))
    parser.add_argument("--points", type=int, default=48)
    parser.add_argument("--discs", type=int, default=60)
    parser.add_argument("--packings", type=int, default=24)
    parser.add_argument("--steps", type=int, help="steps per period, instead of the default")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)

    one = (accuracy.LADDER[0] ** 0,)
    measured, pairs = [], []
    for job in jobs(options.points, options.discs, options.steps):
        found = accuracy.measure(job, one, [job.point.integrator.scheme], energy=False)
        measured.append(found)
        what = accuracy.describe_point(job, VARIED)
        if found.verdict is None:
            print(f"{what}: failed, {found.failure}", flush=True)
            continue
        [run] = found.runs
        print(
            f"{what}: {found.verdict.verdict}, |G*| {100 * run['magnitude_error']:.2g} %, "
            f"G″ {100 * run['loss_error']:.2g} %, stress {100 * run['stress_error']:.2g} %, "
            f"{run['substeps_per_step']:.2f} substeps, {1e3 * run['cpu_per_period']:.3g} ms per T",
            flush=True,
        )
        if options.packings and found.verdict.verdict != "convergent":
            pairs.append(accuracy.paired_differences(job, options.packings))
            print(f"    {describe_pairs(accuracy.summarise_pairs(*pairs[-1], seed=SEED))}")

    table = accuracy.runs_table(measured, VARIED)
    save(table, options.folder / "default_steps")
    together = table["verdict"].isin(["convergent", "uneven"])
    print(f"\n{len(measured)} jobs; verdicts: {table['verdict'].value_counts().to_dict()}")
    print(f"failed: {sum(found.failure is not None for found in measured)}")
    for name, part in (
        ("convergent", table[table["verdict"] == "convergent"]),
        ("convergent or uneven (all whose twins stay together)", table[together]),
    ):
        good = (part["magnitude_error"] <= TARGET) & (part["loss_error"] <= TARGET)
        print(f"{name}: |G*| and G″ within {TARGET:.1%} in {share(good)}")
        for key in ("magnitude_error", "loss_error", "stress_error"):
            median, high = part[key].quantile([0.5, 0.95])
            print(
                f"  {key}: median {median:.1e}, 95 % below {high:.1e}, worst {part[key].max():.1e}"
            )
        for _, bad in part[~good].iterrows():
            facts = ", ".join(f"{key.rpartition('.')[2]} {bad[key]}" for key in VARIED)
            print(f"  over: {facts}: {bad['magnitude_error']:.1e}, {bad['loss_error']:.1e}")
    if pairs:
        differences, failed = zip(*pairs, strict=True)
        pooled = accuracy.summarise_pairs(np.concatenate(differences), sum(failed), seed=SEED)
        print(f"not convergent, mean paired difference: {describe_pairs(pooled)}")


if __name__ == "__main__":
    sys.exit(main())
