"""How many records per period lose nothing of the moduli and harmonics that are made of them.

.venv/bin/python analysis/record_rate.py [--replicates 12]

Jobs over the published range (particles, uncut gel and loose discs; amplitudes 0.001 to 2;
frictions 0 to 1) run with 4,800 steps per period, all of which are recorded. The fit of nine
harmonics is then made of every record, of every fifth, and so on: the same motion, so that the
difference is what the records lose. Two things are lost. What has a frequency above half of that of
the records appears in them as a slower one: with R records per period, harmonic n of the stress
adds to R − n. And the internal and the external tensor jump when a contact crosses the edge of the
cell, at a moment known to 1/R of a period only, so that their errors fall no faster than 1/R.

Prints, for each number of records per period and each tensor, the 95th percentile and the largest
of the difference in |G*|, in G″ (relative to itself) and in the worst of G′ₙ, G″ₙ, n ≤ 9, relative
to |G*|, and the size of a table with as many records.
"""

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from shear_sim.models import microgel
from shear_sim.models.microgel.parameters import Integrator, Links, Microgel, MicrogelPoint
from shear_sim.models.microgel.preparation import prepare
from shear_sim.protocol import OscillatoryShear
from shear_sim.rheology import TENSORS, Moduli, moduli
from shear_sim.study import Job
from shear_sim.tables import write_table

FloatArray = NDArray[np.float64]

STEPS = 4800
EVERY = (6, 12, 16, 20, 24, 48, 192)  # STEPS / EVERY records per period; nine harmonics need 19
CUTS: tuple[Literal["cells", "bulk", "none"], ...] = ("cells", "bulk", "none")
AMPLITUDES = (0.001, 0.01, 0.1, 0.5, 2.0)
FRICTIONS = (0.0, 0.01, 0.1, 1.0)
QUANTITIES = ("|G*|", "G″", "worst harmonic")


def run(point: MicrogelPoint, replicate: int) -> tuple[dict[str, FloatArray], dict[str, Any]]:
    """Return all columns and the protocol of one job."""
    simulation = prepare(point, Job.create(point, 1, replicate).streams)
    simulation.advance(simulation.rows)
    columns = simulation.columns()
    return columns, simulation.summary()["protocol"]


def fit(columns: dict[str, FloatArray], protocol: dict[str, Any], every: int) -> dict[str, Moduli]:
    """Return the moduli of the three tensors, made of each ``every``-th record."""
    derived = {**columns, **microgel.derive(columns)}
    keys = ("strain_amplitude", "period", "shear_start", "periods")
    return {
        tensor: moduli(
            derived["time"][::every],
            derived[name][::every],
            **{key: protocol[key] for key in keys},
        )
        for tensor, name in TENSORS.items()
    }


def differences(full: Moduli, less: Moduli) -> tuple[float, float, float]:
    """Return the relative differences in |G*| and G″, and of the worst harmonic / |G*|."""
    harmonics = np.array([*full.storage_n, *full.loss_n]) - [*less.storage_n, *less.loss_n]
    return (
        abs(less.magnitude / full.magnitude - 1),
        abs(less.loss / full.loss - 1),
        float(np.abs(harmonics).max()) / full.magnitude,
    )


def main() -> int:
    """Run the jobs and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--replicates", type=int, default=12)
    replicates = parser.parse_args().replicates
    found: dict[tuple[int, str], list[tuple[float, float, float]]] = {
        (every, tensor): [] for every in EVERY for tensor in TENSORS
    }
    sizes: dict[int, int] = {}
    for cut in CUTS:
        for amplitude in AMPLITUDES:
            for friction in FRICTIONS:
                point = MicrogelPoint(
                    model=Microgel(friction=friction, links=Links(cut=cut)),
                    shear=OscillatoryShear(strain_amplitude=amplitude),
                    integrator=Integrator(steps_per_period=STEPS),
                )
                for replicate in range(replicates):
                    columns, protocol = run(point, replicate)
                    full = fit(columns, protocol, 1)
                    for every in EVERY:
                        less = fit(columns, protocol, every)
                        for name in full:
                            found[every, name].append(differences(full[name], less[name]))
        for every in EVERY:
            sizes.setdefault(every, size(columns, every))
    jobs = len(CUTS) * len(AMPLITUDES) * len(FRICTIONS) * replicates
    print(f"{jobs} jobs against {STEPS} records per period: 95 % below, worst\n")
    print("| records per period | tensor | " + " | ".join(QUANTITIES) + " | table |")
    print("| --- " * (len(QUANTITIES) + 3) + "|")
    for (every, name), values in found.items():
        quantiles = 100 * np.quantile(np.array(values), (0.95, 1), axis=0)
        cells = " | ".join(f"{most:.2g} %, {worst:.2g} %" for most, worst in quantiles.T)
        print(f"| {STEPS // every} | {name} | {cells} | {sizes[every] / 1e6:.2f} MB |")
    return 0


def size(columns: dict[str, FloatArray], every: int) -> int:
    """Return the bytes of a table with each ``every``-th record."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.parquet"
        kept = {name: np.ascontiguousarray(column[::every]) for name, column in columns.items()}
        write_table(path, kept, microgel.COLUMNS, {})
        return path.stat().st_size


if __name__ == "__main__":
    sys.exit(main())
