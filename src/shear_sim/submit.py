"""A study for Slurm: how many tasks, how long, the scripts, and their submission."""

import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from math import ceil
from pathlib import Path

from shear_sim import slurm
from shear_sim.division import deal, divide, file_name, read_division, write_division
from shear_sim.plan import Plan, PlanError
from shear_sim.results import Results, ResultsError
from shear_sim.screen import duration
from shear_sim.slurm import SlurmError, Submission, Task, index_list

TASK_SECONDS = 1800.0  # aimed at: starting a task takes seconds, and queues like short ones
WARNING_SECONDS = 120  # before the time limit; Slurm was 60 s early to 13 s late
SHORTEST_MINUTES = 5  # of a time limit, so that most of it is left before the warning
START_SECONDS = 300.0  # kept for starting, compilation and the warning
SAFETY = 1.5  # time limit over expected duration
LONGEST_MINUTES = 1440  # of a task, where the user gives no limit
MOST_TASKS = 1000  # the same
LEAST_MEMORY_MB = 1000
AGGREGATION_MINUTES = 120


@dataclass(frozen=True)
class Limits:
    """What the user allows; None: what is usual."""

    minutes: int | None = None
    max_tasks: int | None = None
    memory_mb: int | None = None
    partition: str | None = None
    account: str | None = None


@dataclass(frozen=True)
class Layout:
    """The jobs that no task has yet, in shares: one for each task of the arrays to be."""

    shares: list[list[str]]
    seconds: float | None  # expected of the longest task; None: nothing is measured
    minutes: int  # time limit of a task
    cores: int
    memory_mb: int

    def arrays(self, size: int) -> list[range]:
        """Return the shares of each array, so many that indices stay below ``size``."""
        count = len(self.shares)
        return [range(start, min(start + size, count)) for start in range(0, count, size)]


def held(results: Results, submitted: list[Submission], queue: list[Task]) -> set[str]:
    """Return the ids of the jobs of the tasks that wait or run.

    Raises
    ------
    SlurmError
        If the file that says so cannot be read.
    """
    arrays = {each.job: each for each in submitted if each.kind == "array"}
    live = [task for task in queue if task.index is not None and task.job in arrays]
    divisions: dict[str, list[list[str]]] = {}
    found: set[str] = set()
    for name in {arrays[task.job].division for task in live}:
        path = results.submissions / name
        try:
            divisions[name] = read_division(path)
        except (OSError, ValueError) as error:
            msg = f"{path}: cannot be read ({error}): wait until the tasks that it is of have ended"
            raise SlurmError(msg) from error
    for task in live:
        array = arrays[task.job]
        share = array.offset + (task.index or 0)
        found.update(*divisions[array.division][share : share + 1])
    return found


def lay_out(plan: Plan, limits: Limits, taken: set[str]) -> Layout:
    """Decide into how many tasks the missing jobs of a study go, and what a task may take.

    By the measured cost of the jobs, a task takes about half an hour, or less where the limit asks
    for it. It has the cores of the job that uses most, and runs as many of the others at once as
    these are enough for. Jobs that other tasks have (``taken``, see `held`) are left to them.

    Raises
    ------
    PlanError
        If nothing is measured and the user does not say what to take, or if the limit is too short.
    """
    longest = limits.minutes or LONGEST_MINUTES
    if longest < SHORTEST_MINUTES:
        msg = (
            f"--time {longest}: must be at least {SHORTEST_MINUTES} minutes: tasks are warned "
            f"{WARNING_SECONDS} s before the limit, by Slurm, which may be a minute early"
        )
        raise PlanError(msg)
    most = limits.max_tasks or MOST_TASKS
    jobs = [job for job in plan.run if job.id not in taken]
    cores = max((job.threads for job in jobs), default=1)
    at_once = {job.id: cores // job.threads for job in jobs}
    wall = {job.id: plan.wall_s.mean(plan.points[job.id]) for job in jobs}
    known = {job: each for job, each in wall.items() if each is not None}
    if len(known) < len(jobs):
        if limits.minutes is None or limits.max_tasks is None:
            msg = (
                f"{plan.study.path}: no job is measured yet: run a few first (shear-sim sweep "
                f"{plan.study.path} --limit 3), or give both --time and --max-tasks"
            )
            raise PlanError(msg)
        equal = {job: 1.0 / n for job, n in at_once.items()}
        shares, seconds = deal(equal, min(most, len(jobs))), None
    else:
        usable = (60 * longest - WARNING_SECONDS) / SAFETY
        cost = {job: each / at_once[job] for job, each in known.items()}
        shares = divide(cost, most, min(TASK_SECONDS, usable))
        sums = [sum(cost[job] for job in share) for share in shares]
        seconds = max([*sums, *known.values()], default=0.0)
        longest = min(longest, 5 * ceil((SAFETY * seconds + START_SECONDS) / 300))
    needed = 3 * (plan.memory_mb or 0) * max(at_once.values(), default=1)
    return Layout(
        shares=shares,
        seconds=seconds,
        minutes=longest,
        cores=cores,
        memory_mb=limits.memory_mb or max(LEAST_MEMORY_MB, round(needed)),
    )


def array_script(plan: Plan, layout: Layout, limits: Limits, part: range) -> str:
    """Return the batch script of one array: resources, and one line as in slurm/sweep.sbatch."""
    resources = {
        "array": index_list(range(len(part))),
        "cpus-per-task": layout.cores,
        "time": layout.minutes,
        "mem": f"{layout.memory_mb}M",
        "signal": f"B:USR1@{WARNING_SECONDS}",
        "output": _log(plan, "slurm-%A_%a.log"),
    }
    index = f"$((SLURM_ARRAY_TASK_ID + {part.start}))" if part.start else "$SLURM_ARRAY_TASK_ID"
    division = plan.results.submissions.absolute() / file_name(layout.shares)
    command = _command(
        "sweep", plan.study.path.absolute(), "--results", _root(plan), "--division", division
    )
    shard = f'--shard "{index}/{len(layout.shares)}"'
    return _script(plan, limits, resources, f"{command} {shard}")


def aggregation_script(plan: Plan, limits: Limits, after: list[str]) -> str:
    """Return the batch script of the aggregation, which runs after arrays, however they end."""
    resources: dict[str, object] = {
        "time": min(AGGREGATION_MINUTES, limits.minutes or AGGREGATION_MINUTES),
        "mem": f"{max(LEAST_MEMORY_MB, limits.memory_mb or 0) + plan.total // 25}M",
        "output": _log(plan, "slurm-%j.log"),
    }
    if after:
        resources["dependency"] = f"afterany:{':'.join(after)}"
    return _script(plan, limits, resources, _command("report", plan.results.folder.absolute()))


def _log(plan: Plan, name: str) -> str:
    """Return what a script says of its log: in a folder's name, % is no pattern.

    Raises
    ------
    PlanError
        If Slurm cannot write into a folder of that name.
    """
    folder = str(plan.results.logs.absolute())
    if "\\" in folder or "\n" in folder:
        msg = (
            f"{folder!r}: Slurm writes no logs to a folder with a backslash or a line break in its "
            "name: rename the study, or give another folder with --results"
        )
        raise PlanError(msg)
    return f"{folder.replace('%', '%%')}/{name}"


def _script(plan: Plan, limits: Limits, resources: dict[str, object], command: str) -> str:
    options = {"job-name": f"shear-sim-{plan.study.name}", "cpus-per-task": 1} | resources
    options |= {
        name: value
        for name, value in (("partition", limits.partition), ("account", limits.account))
        if value is not None
    }
    lines = [f"#SBATCH --{name}={shlex.quote(str(value))}" for name, value in options.items()]
    lines += ["#SBATCH --requeue", "#SBATCH --open-mode=append"]
    # exec: only then does the warning reach the program.
    return "\n".join(["#!/bin/bash", *lines, f"exec {command}", ""])


def _command(*arguments: object) -> str:
    return shlex.join([sys.executable, "-m", "shear_sim", *map(str, arguments)])


def _root(plan: Plan) -> Path:
    return plan.results.folder.absolute().parent


def submit(
    plan: Plan, limits: Limits, say: Callable[[str], None], *, dry_run: bool = False
) -> list[int]:
    """Submit what is missing of a study, and the aggregation after it; return the job numbers.

    Parameters
    ----------
    plan : Plan
        Of the whole study.
    say : callable
        Told every line that the user shall see.
    dry_run : bool
        Only show the scripts.

    Raises
    ------
    PlanError
        If nothing is measured and the user does not say what to take.
    SlurmError
        If Slurm does not answer or refuses a script, or if the record of an earlier submission is
        damaged; says what is queued already.
    ResultsError
        If the results cannot be written.
    """
    before, problems = slurm.submissions(plan.results)
    if problems:
        raise SlurmError(problems[0])
    queue = slurm.queue()
    if queue is None and before:
        msg = "squeue does not answer, so what is queued already is not known: try again later"
        raise SlurmError(msg)
    taken = held(plan.results, before, queue or [])
    layout = lay_out(plan, limits, taken)
    if taken:
        say(f"  tasks that wait or run already keep their {len(taken)} jobs")
    arrays = layout.arrays(slurm.max_array_size()) if layout.shares else []
    if arrays:
        say(describe(layout, len(arrays)))
    queued = [each for each in before if each.job in {task.job for task in queue or []}]
    after = [each.job for each in queued if each.kind == "array"]
    last = max((each.job for each in queued if each.kind == "aggregation"), default=0)
    covered = last > max(after, default=0)  # submitted after all of them, it waits for all
    if not arrays and (covered or not (after or _report_is_old(plan))):
        say("nothing to submit")
        return []
    if dry_run:
        for part in arrays:
            say(f"\n{array_script(plan, layout, limits, part)}")
        names = [*map(str, after), *(f"<array {k}>" for k in range(len(arrays)))]
        say(f"\n{aggregation_script(plan, limits, names)}")
        return []
    plan.results.prepare(plan.study)
    if arrays:
        _keep_division(plan.results, layout)
        # Jobs to be tried again are new to their tasks. Had these to be told so, by --retry-failed,
        # they would try again at every requeue.
        for job in plan.again.keys() & {job for share in layout.shares for job in share}:
            if plan.again[job].kind == "physics":
                plan.results.forget_failure(job)
    numbers: list[int] = []
    try:
        for part in arrays:
            number = slurm.submit(array_script(plan, layout, limits, part))
            numbers.append(number)
            division = file_name(layout.shares)
            slurm.record(
                plan.results,
                Submission(number, "array", _now(), division, tuple(part), part.start),
            )
            say(f"array {number}: tasks {index_list(part)} of {len(layout.shares)}")
        names = [str(job) for job in (*after, *numbers)]
        number = slurm.submit(aggregation_script(plan, limits, names))
        slurm.record(plan.results, Submission(number, "aggregation", _now()))
    except SlurmError as error:
        so_far = f"queued: {', '.join(map(str, numbers))}" if numbers else "nothing is queued"
        msg = f"{error}; {so_far}; the same command again submits what is missing"
        raise SlurmError(msg) from error
    how = f"after {', '.join(names)}, however they end" if names else "at once"
    say(f"aggregation {number}: {how}")
    return [*numbers, number]


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _keep_division(results: Results, layout: Layout) -> None:
    """Write which jobs the tasks will have, where their numbers will be kept as well.

    Raises
    ------
    ResultsError
        If that cannot be: then nothing may be submitted, or it would be submitted twice.
    """
    try:
        results.submissions.mkdir(exist_ok=True)
        write_division(results.submissions, layout.shares)
    except OSError as error:
        msg = f"{results.submissions}: cannot be written ({error}); nothing is submitted"
        raise ResultsError(msg) from error


def _report_is_old(plan: Plan) -> bool:
    """Tell whether there are results, or an edit of the study, that the report does not know."""
    study, report = plan.results.study_file, plan.results.report_file
    if study.exists() and study.read_bytes() != plan.study.text.encode():
        return True
    known = plan.results.fingerprint().encode()
    return plan.done > 0 and not (report.exists() and known in report.read_bytes())


def describe(layout: Layout, arrays: int) -> str:
    """Return in one line what will be submitted."""
    expected = "not measured" if layout.seconds is None else f"at most {duration(layout.seconds)}"
    line = (
        f"  {len(layout.shares)} task(s) in {arrays} array(s) for "
        f"{sum(map(len, layout.shares))} jobs: {expected}, "
        f"limit {duration(60 * layout.minutes)}, {layout.cores} core(s) and {layout.memory_mb} MB "
        "each"
    )
    if layout.seconds is not None and layout.seconds > 60 * layout.minutes - WARNING_SECONDS:
        line += "; longer than the limit: tasks will be requeued and go on"
    return line
