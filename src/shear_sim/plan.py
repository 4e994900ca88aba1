"""The plan of a sweep: what is done, what is missing, and what that is expected to cost."""

import os
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shear_sim.division import read_division
from shear_sim.results import Failure, Results
from shear_sim.screen import duration, size

if TYPE_CHECKING:
    from shear_sim.study import Job, Study

SHOWN_FAILURES = 10


class PlanError(Exception):
    """The environment asks for what no plan can do; says what and what to do."""


class Costs:
    """Mean measured cost of a job: at its own point where known, else over all jobs."""

    def __init__(self) -> None:
        self._sum: dict[str | None, float] = defaultdict(float)
        self._count: Counter[str | None] = Counter()

    def add(self, point: str, cost: float) -> None:
        """Take one measurement."""
        for key in (point, None):
            self._sum[key] += cost
            self._count[key] += 1

    @property
    def measured(self) -> int:
        """Number of measurements."""
        return self._count[None]

    def total(self, jobs: Mapping[str, float]) -> float | None:
        """Return the expected cost of so many jobs of each point; None if nothing is measured."""
        if not self.measured:
            return None
        return sum(count * (self.mean(point) or 0.0) for point, count in jobs.items())

    def mean(self, point: str) -> float | None:
        """Return the expected cost of a job of this point; None if nothing is measured."""
        key = point if point in self._count else None
        return self._sum[key] / self._count[key] if self.measured else None


@dataclass(frozen=True)
class Plan:
    """What a sweep would do, and what that is expected to cost.

    Attributes
    ----------
    shard : (i, n)
        Which part of the study this is; all counts are of this part.
    run : list of Job
        New jobs, and failed ones that are tried again.
    left_out : int
        Jobs that would run but for ``--limit``.
    again, waiting : dict of Failure, by job id
        Failed jobs that are tried again, and those that failed by physics, which are not.
    orphans : int
        Results that the study does not ask for (any more); they are never deleted.
    cores, workers : int
        Most cores that all running jobs use together, and most jobs that run at once.
    points : dict
        Job id to the id of its point.
    """

    study: "Study"
    results: Results
    shard: tuple[int, int]
    total: int
    done: int
    run: "list[Job]" = field(repr=False)
    left_out: int
    again: dict[str, Failure] = field(repr=False)
    waiting: dict[str, Failure] = field(repr=False)
    orphans: int
    cores: int
    workers: int
    points: dict[str, str] = field(repr=False)
    cpu_s: Costs = field(repr=False)
    wall_s: Costs = field(repr=False)
    job_bytes: float | None
    memory_mb: float | None

    @cached_property
    def _at_once(self) -> dict[str, int]:
        """Of each point, how many jobs there is room for."""
        return {
            point.id: max(1, min(self.workers, self.cores // point.threads))
            for point in self.study.points
        }

    def time(self, wall_s: Costs, jobs: Mapping[str, int]) -> float | None:
        """Return how long so many jobs of each point take together [s], see `Costs.total`."""
        return wall_s.total({point: count / self._at_once[point] for point, count in jobs.items()})

    def to_json(self) -> dict[str, Any]:
        """Return the plan for a script; times in s, memory of one worker in MB."""
        to_run = Counter(self.points[job.id] for job in self.run)
        return {
            "study": self.study.name,
            "results": str(self.results.folder),
            "shard": list(self.shard),
            "jobs": self.total,
            "done": self.done,
            "new": len(self.run) - len(self.again),
            "left_out": self.left_out,
            "again": [asdict(failure) for failure in self.again.values()],
            "waiting": [asdict(failure) for failure in self.waiting.values()],
            "orphans": self.orphans,
            "cores": self.cores,
            "workers": self.workers,
            "estimate": {
                "measured_jobs": self.cpu_s.measured,
                "cpu_s": self.cpu_s.total(to_run),
                "wall_s": self.time(self.wall_s, to_run),
                "disk_bytes": None if self.job_bytes is None else self.job_bytes * len(self.run),
                "memory_mb": self.memory_mb,
            },
        }

    def __str__(self) -> str:
        facts = self.to_json()
        estimate = facts["estimate"]
        part = "" if self.shard == (0, 1) else f" (shard {self.shard[0]}/{self.shard[1]})"
        failed = len(self.again) + len(self.waiting)
        counts = f"{facts['new']} new, {self.done} done, {failed} failed"
        several = self.study.threads > 1
        cores = f"{self.cores} cores, at most " if several else ""
        lines = [f"{self.study.name}{part}: {self.total} jobs: {counts}, in {self.results.folder}"]
        lines += failure_lines(self.again, "runs again")
        lines += failure_lines(self.waiting, "by physics, left alone")
        if self.waiting:
            lines.append("  failures by physics are tried again only with --retry-failed")
        if self.left_out:
            lines.append(f"  {self.left_out} more jobs are left for later by --limit")
        if self.orphans:
            lines.append(f"  {self.orphans} results are not of this study file (any more); kept")
        if several and (uses := Counter(job.threads for job in self.run)):
            each = ", ".join(f"{uses[n]} job(s) use {n}" for n in sorted(uses, reverse=True))
            lines.append(f"  threads: {self.study.threads}, as far as jobs have use for it: {each}")
            if max(uses) > (here := default_cores()):
                lines.append(
                    f"  there are {here} core(s) here: threads that share one wait for each other, "
                    f"and take longer than one; threads: {here}, or a task of more cores (submit)"
                )
        if self.run and estimate["cpu_s"] is not None:
            lines.append(
                f"  to run: about {duration(estimate['cpu_s'])} of CPU, "
                f"{duration(estimate['wall_s'])} on {cores}{self.workers} worker(s) of "
                f"{self.memory_mb:.0f} MB, {size(estimate['disk_bytes'])} of disk; from "
                f"{estimate['measured_jobs']} measured jobs"
            )
        elif self.run:
            lines.append(f"  to run: no job is measured yet; {self.workers} worker(s)")
        return "\n".join(lines)


def default_cores() -> int:
    """Return how many cores a sweep may use: what Slurm gave, else those of this process.

    Raises
    ------
    PlanError
        If Slurm's variable holds no number above 0.
    """
    if given := os.environ.get("SLURM_CPUS_PER_TASK"):
        if not given.isdecimal() or int(given) == 0:
            msg = (
                f"SLURM_CPUS_PER_TASK={given}: must be a whole number above 0; "
                "correct or unset it, or give --jobs"
            )
            raise PlanError(msg)
        return int(given)
    if "SLURM_JOB_ID" in os.environ:
        return 1  # Slurm's own default; the other cores of the node are somebody else's
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def make_plan(
    study: "Study",
    results: Results,
    *,
    shard: tuple[int, int] = (0, 1),
    division: Path | None = None,
    limit: int | None = None,
    retry_failed: bool = False,
    jobs: int | None = None,
    measure: bool = True,
) -> Plan:
    """Compare a study with its results.

    Parameters
    ----------
    shard : (i, n)
        Every n-th job of the whole study sorted by id, from the i-th (from 0). Finished jobs are
        skipped after that, so shards never overlap, whenever each is planned.
    division : Path, optional
        File that says which jobs the i-th of n shards has instead, see `shear_sim.division`; jobs
        in it that the study does not ask for (any more) are left out.
    limit : int, optional
        Run at most so many jobs.
    retry_failed : bool
        Also run jobs that failed by physics.
    jobs : int, optional
        Number of workers, at least 1; default: as many as `default_cores` have room for.
    measure : bool
        Also read what finished jobs have cost. Tasks of an array leave that alone: it would have
        all of them read all results, and write the same index.

    Raises
    ------
    PlanError
        If ``jobs`` is no number above 0, or Slurm's variable holds none; if ``division`` cannot be
        read or is of another number of shards.
    ResultsError
        If the results are imported ones, or of a newer version of the program.
    """
    if jobs is not None and jobs < 1:
        msg = f"jobs={jobs}: must be a whole number above 0; None is as many as there are cores"
        raise PlanError(msg)
    results.refuse_others()
    points = {job.id: point for point, of in study.groups().items() for job in of}
    part = study.jobs()
    part = part[shard[0] :: shard[1]] if division is None else _share(part, shard, division)
    finished, failures = results.finished(), results.failures()
    missing = [job for job in part if job.id not in finished]
    waiting = {
        job.id: failures[job.id]
        for job in missing
        if job.id in failures and failures[job.id].kind == "physics" and not retry_failed
    }
    run = [job for job in missing if job.id not in waiting]
    run.sort(key=lambda job: job.id in failures)  # what failed before must not keep back the others
    chosen = run[:limit]
    threads = [job.threads for job in chosen]
    cores = jobs * max(threads, default=1) if jobs else default_cores()
    workers = jobs or max(1, cores // min(threads, default=1))
    cpu_s, wall_s, job_bytes, memory_mb = _measured(results, points, measure and bool(finished))
    return Plan(
        study=study,
        results=results,
        shard=shard,
        total=len(part),
        done=len(part) - len(missing),
        run=chosen,
        left_out=len(run) - len(chosen),
        again={job.id: failures[job.id] for job in chosen if job.id in failures},
        waiting=waiting,
        orphans=len(finished.difference(points)),
        cores=cores,
        workers=min(workers, len(chosen)),
        points=points,
        cpu_s=cpu_s,
        wall_s=wall_s,
        job_bytes=job_bytes,
        memory_mb=memory_mb,
    )


def _share(jobs: "list[Job]", shard: tuple[int, int], path: Path) -> "list[Job]":
    """Return the jobs that a division gives to this shard."""
    try:
        shares = read_division(path)
    except (OSError, ValueError) as error:
        msg = f"{path}: cannot be read ({error}): submit the study again"
        raise PlanError(msg) from error
    if len(shares) != shard[1]:
        msg = f"{path}: {len(shares)} shares, one a line, but --shard is {shard[0]}/{shard[1]}"
        raise PlanError(msg)
    known = {job.id: job for job in jobs}
    return [known[job] for job in shares[shard[0]] if job in known]


def _measured(
    results: Results, points: dict[str, str], any_finished: bool
) -> tuple[Costs, Costs, float | None, float | None]:
    """Return CPU and wall time, mean bytes and largest memory [MB] of the finished jobs."""
    cpu_s, wall_s = Costs(), Costs()
    if not any_finished:
        return cpu_s, wall_s, None, None
    index = results.index()
    if not index.num_rows:  # all damaged
        return cpu_s, wall_s, None, None
    names = ["job", "run.cpu_s", "run.wall_s", "bytes", "run.peak_memory_mb"]
    rows = index.select(names).to_pydict()
    for job, cpu, wall in zip(rows["job"], rows["run.cpu_s"], rows["run.wall_s"], strict=True):
        if job in points:
            cpu_s.add(points[job], cpu)
            wall_s.add(points[job], wall)
    size_sum = sum(rows["bytes"]) + results.snapshot_bytes()
    return cpu_s, wall_s, size_sum / len(rows["bytes"]), max(rows["run.peak_memory_mb"])


def failure_lines(failures: dict[str, Failure], what: str) -> list[str]:
    """Return a line for each failure, but not for hundreds."""
    lines = [
        f"  failed ({what}): {job} ({failure.kind}, tried {failure.tries} x): {failure.reason}"
        for job, failure in list(failures.items())[:SHOWN_FAILURES]
    ]
    if len(failures) > SHOWN_FAILURES:
        lines.append(f"  ... and {len(failures) - SHOWN_FAILURES} more such jobs, in failed/")
    return lines
