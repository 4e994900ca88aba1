"""Draw signals of sheared hard discs: figures 2, 4 and 7 of Lerner, Düring & Wyart (2013).

.venv/bin/shear-sim sweep configs/hard_disc/signals.yaml
.venv/bin/python analysis/hard_disc/stress_signals.py results/signals

prints what the paper says of them, measured: between events the stress falls, collisions raise it.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from shear_sim.figures import style
from shear_sim.results import Results, read_job

Columns = dict[str, NDArray[np.float64]]
WINDOW = 0.004  # of strain, in which single events are seen


def crowded(strain: NDArray[np.float64], events: NDArray[np.float64]) -> float:
    """Return where a window begins that holds the median number of events."""
    starts = np.arange(0.3 * strain[-1], strain[-1] - WINDOW, WINDOW)
    counts = np.interp(starts + WINDOW, strain, events) - np.interp(starts, strain, events)
    return float(starts[np.argsort(counts)[len(counts) // 2]])


def fixed_area(columns: Columns, stem: Path) -> None:
    """Coordination (figure 2) and stress (figure 4) against strain, far and near."""
    strain, stress, events = (columns[k] for k in ("strain", "scaled_shear_stress", "events"))
    begin = crowded(strain, events)
    near = (strain >= begin) & (strain <= begin + WINDOW)
    with style.figure(style.DOUBLE, 3.9) as figure:
        axes = figure.subplots(2, 2, sharex="col")
        for column, shown in enumerate((strain > 0, near)):
            for row, (name, label) in enumerate(
                (
                    ("scaled_shear_stress", r"stress $\sigma\xi_0/\dot\gamma$"),
                    ("contact_number", "contacts per disc $2N_c/N$"),
                )
            ):
                axes[row, column].plot(
                    strain[shown], columns[name][shown], color=style.UNORDERED[row], linewidth=0.7,
                    drawstyle="default" if row == 0 else "steps-post",
                )  # fmt: skip
                axes[row, column].set_ylabel(label)
            axes[1, column].set_xlabel(r"strain $\gamma$")
            axes[1, column].xaxis.set_major_locator(MaxNLocator(4))
        axes[0, 0].set(yscale="log", ylim=(0.3, None))
        axes[0, 0].axvspan(begin, begin + WINDOW, color="0.85", linewidth=0)
        figure.align_ylabels()
        print(*style.save(figure, stem)[:1])
    change, count = np.diff(stress), np.diff(events)
    falls = change[count == 0] < 0
    rises = count[change > 1e-3 * stress.mean()] > 0
    print(f"  {len(falls)} intervals without an event: the stress falls in {falls.mean():.2%}")
    print(f"  {len(rises)} rises over 0.1 % of the mean: {rises.mean():.2%} with an event")


def fixed_pressure(columns: Columns, stem: Path) -> None:
    """Packing fraction and compression ratio against strain (figure 7)."""
    strain = columns["strain"]
    with style.figure(style.SINGLE, 3.6) as figure:
        above, below = figure.subplots(2, sharex=True)
        above.plot(strain, columns["packing_fraction"], color=style.UNORDERED[0], linewidth=0.8)
        above.set_ylabel(r"packing fraction $\phi$")
        below.plot(strain, columns["compression_ratio"], color=style.UNORDERED[1], linewidth=0.5)
        late = columns["compression_ratio"][strain > 0.3 * strain[-1]]
        wide = 1.1 * np.abs(late).max()
        below.set(
            ylim=(-wide, wide), ylabel=r"compression ratio $\kappa$", xlabel=r"strain $\gamma$"
        )
        figure.align_ylabels()
        print(*style.save(figure, stem)[:1])
    late = strain >= 0.3 * strain[-1]
    kappa, phi = columns["compression_ratio"][late], columns["packing_fraction"][late]
    passed = columns["compression"][late]
    squeeze = passed[-1] - passed[0]
    residual = 0.5 * np.log(phi[-1] / phi[0]) - squeeze
    print(f"  mean κ {squeeze / np.ptp(strain[late]):+.2e}, root mean square {kappa.std():.3f}")
    print(f"  ½ ln(φ end/φ start) − ∫κ = {residual:.1e}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="results folder of the study")
    parser.add_argument("--folder", type=Path, default=Path("analysis/figures"), help="of figures")
    given = parser.parse_args()
    kept = Results.existing(given.results)
    plan, _ = kept.plan()
    for job, labels in zip(plan["job"].to_pylist(), plan["labels"].to_pylist(), strict=True):
        columns, summary = read_job(kept.job_file(job))
        scene = json.loads(labels)[0][1]
        print(f"{scene}: {summary['status']}, {summary['events']['collisions']} collisions")
        draw = {"fixed_area": fixed_area, "fixed_pressure": fixed_pressure}[scene]
        draw(columns, given.folder / f"hard_disc_signal_{scene}")


if __name__ == "__main__":
    main()
