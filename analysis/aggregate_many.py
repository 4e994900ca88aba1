"""How long `shear-sim aggregate` takes over many jobs, and how much memory.

.venv/bin/python analysis/aggregate_many.py results/main 12

Makes a study of 12 times as many jobs out of the summaries of a finished one: copies whose discs
differ in size ratio. Then aggregates it twice, without and with the index of the results.
"""

import argparse
import hashlib
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pyarrow as pa

from shear_sim.results import Results, read_job_summary
from shear_sim.tables import write_arrow, write_table

KEY = "packing.size_ratio"


def multiply(one: Results, many: Results, copies: int) -> int:
    """Write ``copies`` times the jobs of a study, with records cut short; return how many."""
    plan, study = one.plan()
    many.jobs.mkdir(parents=True)
    shutil.copy(one.study_file, many.study_file)
    table = plan.to_pandas()
    summaries = {job: read_job_summary(one.job_file(job)) for job in table["job"]}
    plans = []
    for copy in range(copies):
        ratio = 1.4 + 0.01 * copy
        names = {key: [renamed(name, copy) for name in table[key]] for key in ("job", "point")}
        new = table.assign(**names, **{KEY: ratio})
        plans.append(pa.Table.from_pandas(new, preserve_index=False))
        for job, summary in summaries.items():
            found = json.loads(json.dumps(summary))
            found["job"] |= {key: renamed(found["job"][key], copy) for key in ("id", "point")}
            found["parameters"]["packing"]["size_ratio"] = ratio
            path = many.job_file(renamed(job, copy))
            write_table(path, {"time": [0.0]}, [("time", "s", "time")], found)
    about = study | {"varied": [*study["varied"], KEY]}
    write_arrow(many.plan_file, pa.concat_tables(plans), about)
    return copies * len(table)


def renamed(name: str, copy: int) -> str:
    return hashlib.sha256(f"{name} {copy}".encode()).hexdigest()[:16]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("copies", type=int)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        many = Results(Path(folder) / "many")
        jobs = multiply(Results.existing(chosen.results), many, chosen.copies)
        for index in ("without an index", "with it"):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            start = time.monotonic()
            program = "from shear_sim.cli import main; main()"
            command = [sys.executable, "-c", program, "aggregate", str(many.folder), "--no-figures"]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            print(
                f"{jobs:,} jobs, {index}: {time.monotonic() - start:.0f} s, {cpu:.0f} s of CPU, "
                f"{after.ru_maxrss / 1024:.0f} MB"
            )


if __name__ == "__main__":
    main()
