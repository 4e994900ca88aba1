"""Draw strain and stress of any one run against time, and one against the other.

.venv/bin/python analysis/fig_run.py results/main/jobs/3f9c21d07be4a815.parquet run
"""

import argparse
from pathlib import Path

from shear_sim.figures import example_run, style
from shear_sim.results import read_job
from shear_sim.rheology import TENSORS


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("job_file", type=Path, help="table of one job")
    parser.add_argument("stem", type=Path, help="path of the figure, without its ending")
    given = parser.parse_args()
    columns, summary = read_job(given.job_file)
    # An imported run has no periodic tensor: the first that it has.
    tensor = next(name for name, series in TENSORS.items() if series in columns)
    columns["shear_stress"] = columns[TENSORS[tensor]]
    moduli = summary.get("moduli", {}).get(tensor)
    title = f"job {summary['job']['id']}, replicate {summary['job']['replicate']}, {tensor} tensor"
    print(*style.save(example_run(columns, summary["protocol"], moduli, title), given.stem))


if __name__ == "__main__":
    main()
