"""The main path: one job, from its parameters to its result file. Start reading here."""

import os
import platform
import resource
import subprocess
import sys
import time
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shear_sim import models
from shear_sim.compiled import processor
from shear_sim.results import FORMAT
from shear_sim.rheology import summarise
from shear_sim.tables import write_table

if TYPE_CHECKING:
    from shear_sim.study import Job

BLOCK = 256  # records between two looks at the outside world (Ctrl-C); does not change results


def run_job(job: "Job", folder: Path) -> Path:
    """Simulate one job and write its result file; return the file's path.

    A job whose file exists is complete (files are written whole or not at all), so running a study
    again only does what is missing. Everything in the file except the block ``run`` is the same to
    the bit wherever, whenever and beside whatever the job runs, on one type of processor and one
    set of versions.

    Parameters
    ----------
    job : Job
        Parameters, seed and replicate.
    folder : Path
        The ``jobs`` folder of the study's results.

    Raises
    ------
    SimulationError
        If the physics cannot go on; nothing is written then.
    """
    path = folder / f"{job.id}.parquet"
    if path.exists():
        return path
    clock = _Clock()
    model = models.model(job.point.kind)
    simulation = model.start(job.point, job.streams)
    while simulation.done < simulation.rows:
        simulation.advance(BLOCK)
    columns = simulation.columns()
    what = job.to_json()
    identity = {key: what[key] for key in ("id", "replicate", "seed", "model", "physics_version")}
    summary = {
        "format": FORMAT,
        "job": {**identity, "point": job.point_id},
        "parameters": what["parameters"],
        **simulation.summary(),
    }
    measured = summarise({**columns, **model.derive(columns)}, summary["protocol"])
    summary |= measured | {"flags": {**summary["flags"], **measured["flags"]}}
    summary["run"] = {**clock.read(), **environment(), "files": what["files"]}
    chosen = job.point.recorded or tuple(columns)
    write_table(path, {name: columns[name] for name in chosen}, model.COLUMNS, summary)
    return path


class _Clock:
    """Wall time and CPU time of one job in this process."""

    def __init__(self) -> None:
        self.started = datetime.now(UTC)
        self.wall, self.cpu = time.perf_counter(), time.process_time()

    def read(self) -> dict[str, Any]:
        """Return the timings so far; the memory is the largest that this process has had."""
        unit = 1024 if sys.platform == "darwin" else 1  # bytes there, kilobytes elsewhere
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit / 1024
        return {
            "started": self.started.isoformat(timespec="milliseconds"),
            "wall_s": round(time.perf_counter() - self.wall, 6),
            "cpu_s": round(time.process_time() - self.cpu, 6),
            "peak_memory_mb": round(peak, 1),
        }


@cache
def environment() -> dict[str, Any]:
    """Return what computed the job: versions, commit and machine; the same for all of a process."""
    return {
        "version": version("shear-sim"),
        "git_commit": _git_commit(),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "numba": version("numba"),
        "host": platform.node(),
        "processor": processor().split()[0],
        "slurm_job": os.environ.get("SLURM_JOB_ID"),
    }


def _git_commit() -> str | None:
    """Return the commit of the package's sources, with ``-dirty`` if they were edited since.

    None where the package is installed rather than run from a clone of its repository.
    """
    package = Path(__file__).parent
    git = ["git", "-C", str(package)]
    try:
        # An installed package may lie inside somebody else's repository, but untracked.
        subprocess.run(  # noqa: S603
            [*git, "ls-files", "--error-unmatch", "runner.py"], capture_output=True, check=True
        )
        described = subprocess.run(  # noqa: S603
            [*git, "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"],
            capture_output=True,
            check=True,
            text=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return described.stdout.strip()
