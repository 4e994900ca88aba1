"""How long a study of 100,000 jobs takes to plan, to look at and to aggregate, and how much memory.

.venv/bin/python analysis/scale.py --jobs 100000

One job runs for real; the results of all others are its summary with their own parameters and
scattered moduli. Each command is then a process of its own, as a user would start it.
"""

import argparse
import json
import multiprocessing
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from shear_sim.results import Results, read_job_summary
from shear_sim.runner import run_job
from shear_sim.study import load_study
from shear_sim.tables import write_table

REPLICATES = 10
STUDY = """
packing: {{discs: 20, packing_fraction: 1.5}}
model: {{friction: 0.01}}
sweep:
  grid:
    shear.strain_amplitude: {{logspace: [1e-3, 1, 100]}}
    model.friction: [0, 0.001, 0.003, 0.01, 0.03, 0.1, 0.2, 0.3, 0.5, 1]
    packing.packing_fraction: {{linspace: [1.1, 2, {fractions}]}}
replicates: 10
seed: 1
"""


def fill(file: Path, results: Results) -> None:
    """Write a result for every job of a study."""
    study = load_study(file)
    results.prepare(study)
    jobs = study.jobs()
    path = run_job(jobs[0], results.jobs)
    summary = read_job_summary(path)
    points = {point.id: json.loads(point.json) for point in study.points}
    rng = random.Random(1)
    # A power loss would only cost a synthetic result.
    os.fsync = lambda _: None  # type: ignore[assignment]
    of = {job.id: point for point, group in study.groups().items() for job in group}
    for job in jobs[1:]:
        point = of[job.id]
        factor = 1 + 0.1 * rng.gauss(0, 1)
        moduli = {
            tensor: {
                name: factor * value if isinstance(value, float) else value
                for name, value in values.items()
            }
            for tensor, values in summary["moduli"].items()
        }
        made = {
            **summary,
            "job": {**summary["job"], "id": job.id, "point": point, "replicate": job.replicate},
            "parameters": points[point],
            "moduli": moduli,
        }
        file = results.job_file(job.id)
        write_table(file, {"time": [0.0]}, [("time", "s", "time")], made)


def measure(name: str, *arguments: object) -> None:
    """Run one command and print what it took."""
    command = [sys.executable, "-m", "shear_sim", *map(str, arguments)]
    began = time.monotonic()
    with tempfile.TemporaryFile("w+") as shown:
        process = subprocess.Popen(command, stdout=shown, stderr=shown)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        shown.seek(0)
        output = shown.read()
    assert process.returncode == 0, output
    print(
        f"| {name} | {time.monotonic() - began:.1f} | {usage.ru_utime + usage.ru_stime:.1f} | "
        f"{usage.ru_maxrss / 1024:.0f} |",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=100_000)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "many.yaml"
        file.write_text(STUDY.format(fractions=max(2, chosen.jobs // (1000 * REPLICATES))))
        results = Results(Path(folder) / "results/many")
        given = (file, "--results", results.folder.parent)
        print("| command | wall time [s] | CPU time [s] | memory [MB] |\n| --- | --- | --- | --- |")
        measure("plan, nothing done", "plan", *given)
        # In a process of its own: the memory of a command would else be at least that of this one.
        filling = multiprocessing.get_context("spawn").Process(target=fill, args=(file, results))
        filling.start()
        filling.join()
        size = sum(path.stat().st_size for path in results.jobs.iterdir())
        measure("status, all done", "status", results.folder)
        measure("plan, all done, index made", "plan", *given)
        measure("plan, all done", "plan", *given)
        measure("status", "status", results.folder)
        measure("aggregate", "aggregate", results.folder, "--no-figures")
        print(f"{len(results.finished()):,} results of {size / len(results.finished()):.0f} bytes")


if __name__ == "__main__":
    main()
