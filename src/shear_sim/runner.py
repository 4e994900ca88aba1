"""The main path: one job, from its parameters to its result file. Start reading here."""

import os
import platform
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shear_sim import models
from shear_sim.checkpoints import Progress, read_checkpoint, write_checkpoint
from shear_sim.compiled import processor
from shear_sim.models.interface import SimulationError
from shear_sim.results import FORMAT
from shear_sim.rheology import summarise
from shear_sim.snapshots import write_snapshots
from shear_sim.tables import write_table

if TYPE_CHECKING:
    from shear_sim.models.interface import Simulation
    from shear_sim.study import Job

FIRST_BLOCK = 16  # records until the first look at the outside world; never changes results
BLOCK_SECONDS = 1.0  # between later looks, about
CHECKPOINT_SECONDS = 600.0  # of a long job that a dead node can cost


class Stopped(Exception):  # noqa: N818 - obeyed, not a fault
    """A job has been asked to stop, and is kept as a checkpoint from which it goes on.

    ``anew``: it had one before, which this run could not use.
    """

    def __init__(self, *, anew: bool) -> None:
        super().__init__()
        self.anew = anew


def run_job(job: "Job", folder: Path, stop: Callable[[], bool] = lambda: False) -> Path:
    """Simulate one job and write its result file; return the file's path.

    A job whose file exists is complete (files are written whole or not at all), so running a study
    again only does what is missing. Everything in the file except the block ``run`` is the same to
    the bit wherever, whenever and beside whatever the job runs, in one piece or from checkpoints,
    on one type of processor and one set of versions.

    Parameters
    ----------
    job : Job
        Parameters, seed and replicate.
    folder : Path
        The ``jobs`` folder of the study's results; checkpoints go to ``checkpoints`` beside it.
    stop : callable
        Asked about every second whether the job shall stop.

    Raises
    ------
    SimulationError
        If the physics cannot go on; nothing is written then.
    Stopped
        If ``stop`` said so; a checkpoint is written then.
    """
    path = folder / f"{job.id}.parquet"
    if path.exists():
        return path
    checkpoint = folder.with_name("checkpoints") / f"{job.id}.pickle"
    clock = _Clock()
    model = models.model(job.point.kind)
    old = checkpoint.exists()
    progress = read_checkpoint(checkpoint) or Progress(model.start(job.point, job.streams))
    simulation, kept = progress.simulation, time.monotonic()
    simulation.threads = job.threads
    try:
        for _ in _blocks(simulation):
            stopping = stop()
            if stopping or time.monotonic() > kept + CHECKPOINT_SECONDS:
                write_checkpoint(checkpoint, clock.added_to(progress))
                kept = time.monotonic()
            if stopping:
                raise Stopped(anew=old and not progress.resumed)
    except SimulationError:
        checkpoint.unlink(missing_ok=True)  # from there it would fail again
        raise
    columns = simulation.columns()
    what = job.to_json()
    identity = {key: what[key] for key in ("id", "replicate", "seed", "model", "physics_version")}
    summary = {
        "format": FORMAT,
        "job": {**identity, "point": job.point_id},
        "parameters": what["parameters"],
        **simulation.summary(),
    }
    everything = {**columns, **model.derive(columns)}
    measured = summarise(everything, summary["protocol"])
    summary |= measured | {"flags": {**summary["flags"], **measured["flags"]}}
    summary["run"] = {
        **clock.read(progress), **environment(), "threads": job.threads, "files": what["files"]
    }  # fmt: skip
    if simulation.snapshots:
        # First: a job whose table is there is done.
        write_snapshots(
            folder.with_name("snapshots"), job.id, simulation.snapshots, everything,
            model.SNAPSHOT_UNITS,
        )  # fmt: skip
        summary["snapshots"] = {"count": len(simulation.snapshots)}
    chosen = job.point.recorded or tuple(columns)
    write_table(path, {name: columns[name] for name in chosen}, model.COLUMNS, summary)
    checkpoint.unlink(missing_ok=True)
    return path


def _blocks(simulation: "Simulation") -> Iterator[None]:
    """Advance to the end, pausing about every second."""
    rows = FIRST_BLOCK
    while simulation.done < simulation.rows:
        began = time.monotonic()
        simulation.advance(rows)
        if simulation.done < simulation.rows:
            yield
        seconds = time.monotonic() - began
        rows = 4 * rows if seconds < BLOCK_SECONDS / 4 else rows
        rows = max(1, rows // 4) if seconds > BLOCK_SECONDS else rows


class _Clock:
    """Wall time and CPU time of one job in this process."""

    def __init__(self) -> None:
        self.started = datetime.now(UTC)
        self.wall, self.cpu = time.perf_counter(), time.process_time()

    def added_to(self, before: Progress) -> Progress:
        """Return the progress with what this process has spent on it so far."""
        wall, cpu = time.perf_counter() - self.wall, time.process_time() - self.cpu
        return replace(before, wall_s=before.wall_s + wall, cpu_s=before.cpu_s + cpu)

    def read(self, before: Progress) -> dict[str, Any]:
        """Return the timings so far; the memory is the largest that this process has had."""
        unit = 1024 if sys.platform == "darwin" else 1  # bytes there, kilobytes elsewhere
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit / 1024
        now = self.added_to(before)
        return {
            "started": self.started.isoformat(timespec="milliseconds"),
            "wall_s": round(now.wall_s, 6),
            "cpu_s": round(now.cpu_s, 6),
            "resumed": now.resumed,
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
