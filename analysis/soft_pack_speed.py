r"""How slow a lid must be: boxes of soft particles under lids of several speeds.

shear-sim sweep configs/soft_pack_speed.yaml
.venv/bin/python analysis/soft_pack_speed.py results/soft_pack_speed

Prints a table in Markdown (kept in analysis/soft_compaction.md).
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from soft_compaction import kind

from shear_sim.models.soft_particle import derive
from shear_sim.results import read_job
from shear_sim.tables import Table

SLIGHT = (0.01, 0.04)  # ε in which a lid that sent a front ahead would bear far more than the floor
BEFORE = 0.18  # ε, where the paper's numbers belong
HEADS = (
    "", "particles", "ε̇ T₁", "step", "σ/σ*", "e", "ΔV_s/ΔV", f"e at ε = {BEFORE}",
    f"ΔV_s/ΔV at ε = {BEFORE}", "floor / lid at first", "energy missing / work",
)  # fmt: skip


def order(job: Table) -> tuple[Any, ...]:
    given = job.summary["parameters"]
    number, step = given["packing"]["particles"], given["integrator"]["step"]
    return kind(job.summary), -number, -step, -given["shear"]["relative_rate"]


def cells(job: Table) -> list[str]:
    """Return the row of a job."""
    given, found = (job.summary[name] for name in ("parameters", "measured"))
    columns = job.columns | derive(job.columns)
    before = int(np.abs(columns["strain"] - BEFORE).argmin())
    slight = (columns["strain"] >= SLIGHT[0]) & (columns["strain"] <= SLIGHT[1])
    lid, floor = (columns[name][slight].mean() for name in ("stress_yy", "stress_floor"))
    return [
        kind(job.summary), str(given["packing"]["particles"]),
        f"{given['shear']['relative_rate']:g}", f"{given['integrator']['step']:g}",
        f"{2 * found['final_stress_per_bending']:.2g}", f"{found['final_void_ratio']:.4f}",
        f"{found['final_solid_share']:.3f}", f"{columns['void_ratio'][before]:.4f}",
        f"{columns['solid_share'][before]:.3f}", f"{floor / lid:.2f}",
        f"{found['energy_missing_ratio']:.1e}",
    ]  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path, help="results folder of the study")
    jobs = (parser.parse_args().results / "jobs").glob("*.parquet")
    for line in (HEADS, ["---"] * len(HEADS), *map(cells, sorted(map(read_job, jobs), key=order))):
        print("| " + " | ".join(line) + " |")


if __name__ == "__main__":
    main()
