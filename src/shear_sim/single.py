"""One job by hand: run a job of a study now, or repeat a finished one and compare."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from shear_sim.results import Failure, Results, ResultsError, flatten, read_job_summary
from shear_sim.runner import run_job
from shear_sim.snapshots import beside, read_snapshots
from shear_sim.study import Job
from shear_sim.tables import Table, read_table
from shear_sim.workers import attempt, compile_for

if TYPE_CHECKING:
    from shear_sim.models.interface import Snapshot
    from shear_sim.study import Study


def run_one(
    study: "Study", reference: str, results: Results, tell: Callable[[], None]
) -> tuple[Path, Failure | None]:
    """Run the job of ``study`` whose id begins with ``reference``, in this process.

    ``tell`` is called if its kernels have to be compiled first.

    Returns
    -------
    path : Path
        Its result, which may have been there already.
    failure : Failure or None
        Why there is no result; recorded in ``failed/`` as well.

    Raises
    ------
    ResultsError
        If no job or more than one begins so, or if the results cannot be written.
    """
    found = [job for job in study.jobs() if job.id.startswith(reference)]
    if len(found) != 1:
        msg = f"--job {reference}: {len(found)} jobs of {study.path} have an id that begins so"
        raise ResultsError(msg)
    [job] = found
    results.prepare(study)
    compile_for([job], tell)
    ending = attempt(job, results.jobs)
    if ending.storage_full is not None:
        msg = f"{results.folder}: results cannot be written ({ending.storage_full})"
        raise ResultsError(msg)
    failure = ending.failure
    if failure is None:
        results.forget_failure(job.id)
    else:
        failure = results.record_failure(failure)
    return results.job_file(job.id), failure


def repeat(path: Path, root: Path, tell: Callable[[], None]) -> tuple[Path, list[str]]:
    """Compute the job of a result file again and compare.

    Parameters
    ----------
    path : Path
        A result file.
    root : Path
        The new result is written to ``root/repeated/jobs/``.
    tell : callable
        Called if the kernels have to be compiled first.

    Returns
    -------
    repeated : Path
        The new result file.
    differences : list of str
        What is not the same to the bit, also in snapshots; the block ``run`` (timings, machine) is
        not compared.

    Raises
    ------
    TableError
        If the file is not a result, or if its snapshots are missing or damaged.
    ResultsError
        If this version of the program would compute something else, or the run was imported.
    """
    summary = read_job_summary(path)
    if program := summary["run"].get("program"):
        msg = f"{path}: a run imported from {program}, which this program cannot repeat"
        raise ResultsError(msg)
    before, kept = read_table(path), _snapshots(path, summary)
    try:
        job = Job.from_json(
            {
                **summary["job"],
                "parameters": summary["parameters"],
                "files": summary["run"]["files"],
            }
        )
    except ValueError as error:
        msg = f"{path}: {error}"
        raise ResultsError(msg) from error
    results = Results(root / "repeated")
    results.jobs.mkdir(parents=True, exist_ok=True)
    results.job_file(job.id).unlink(missing_ok=True)
    compile_for([job], tell)
    repeated = run_job(job, results.jobs)
    after = read_table(repeated)
    found = differences(before, after)
    return repeated, found + _moved(kept, _snapshots(repeated, after.summary))


def _snapshots(path: Path, summary: dict[str, Any]) -> "list[Snapshot]":
    return read_snapshots(beside(path), path.stem) if "snapshots" in summary else []


def _moved(one: "list[Snapshot]", other: "list[Snapshot]") -> list[str]:
    """Say where snapshots are not the same to the bit; how many there are is in the summaries."""
    return [
        f"snapshot {number}: {name}"
        for number, (a, b) in enumerate(zip(one, other, strict=False))
        for name, value in a._asdict().items()
        if np.asarray(value).tobytes() != np.asarray(getattr(b, name)).tobytes()
    ]


def differences(one: Table, other: Table) -> list[str]:
    """Say where two results are not the same to the bit, the block ``run`` apart."""
    found = []
    for name in sorted(one.columns.keys() | other.columns.keys()):
        if name not in one.columns or name not in other.columns:
            found.append(f"column {name} is in one only")
        elif one.columns[name].tobytes() != other.columns[name].tobytes():
            found.append(f"column {name}")
    facts = [_facts(table.summary) for table in (one, other)]
    for key in sorted(facts[0].keys() | facts[1].keys()):
        values = [fact.get(key) for fact in facts]
        if values[0] != values[1]:
            found.append(f"summary {key}: {values[0]} and {values[1]}")
    return found


def _facts(summary: dict[str, Any]) -> dict[str, Any]:
    return flatten({key: value for key, value in summary.items() if key != "run"}, lists=True)
