"""A study for Slurm: how many tasks, how long, the scripts, and their submission."""

import shlex
import sys
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from math import ceil
from pathlib import Path

from shear_sim import slurm
from shear_sim.plan import Plan, PlanError
from shear_sim.screen import duration
from shear_sim.slurm import SlurmError, Submission, Task, index_list

TASK_SECONDS = 1800.0  # aimed at: starting a task takes seconds, and queues like short ones
START_SECONDS = 300.0  # kept for starting, compilation and the warning before the end
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
    """A study divided into shards, and those that array tasks shall run."""

    shards: int
    tasks: tuple[int, ...]  # shards with something to do that no other task does
    jobs: int  # in them
    seconds: float | None  # expected of the longest task; None: nothing is measured
    minutes: int  # time limit of a task
    memory_mb: int

    def arrays(self, size: int) -> list[tuple[int, list[int]]]:
        """Return (offset, indices) of arrays whose indices stay below ``size``."""
        parts: dict[int, list[int]] = {}
        for task in self.tasks:
            parts.setdefault(task // size * size, []).append(task % size)
        return list(parts.items())


def alive(submissions: list[Submission], queue: list[Task]) -> dict[int, set[int]]:
    """Return the shards whose tasks wait or run, by the number of shards they are of."""
    found: dict[int, set[int]] = {}
    arrays = {each.job: each for each in submissions if each.kind == "array"}
    for task in queue:
        if task.index is not None and (array := arrays.get(task.job)):
            found.setdefault(array.shards, set()).add(task.index + array.offset)
    return found


def lay_out(plan: Plan, limits: Limits, busy: dict[int, set[int]]) -> Layout:
    """Decide into how many tasks the missing jobs of a study go, and what a task may take.

    Shards that wait or run (``busy``, see `alive`) keep their jobs. As long as there are any, the
    study stays divided as it is; else it is divided anew, by the measured cost of what is missing,
    so that a task takes about half an hour and none longer than the limit.

    Raises
    ------
    PlanError
        If nothing is measured and the user does not say what to take.
    """
    longest = limits.minutes or LONGEST_MINUTES
    most_tasks = limits.max_tasks or MOST_TASKS
    usable = max((60 * longest - START_SECONDS) / SAFETY, 60.0)
    wanted = {job.id for job in plan.run}
    cost = {}  # of the jobs to submit, by their place in the study
    for place, job in enumerate(plan.study.jobs()):
        if job.id in wanted and not any(place % n in tasks for n, tasks in busy.items()):
            cost[place] = plan.wall_s.mean(plan.points[job.id])
    if None in cost.values():
        if limits.minutes is None or limits.max_tasks is None:
            msg = (
                f"{plan.study.path}: no job is measured yet: run a few first (shear-sim sweep "
                f"{plan.study.path} --limit 3), or give both --time and --max-tasks"
            )
            raise PlanError(msg)
        shards, seconds = max(busy, default=min(most_tasks, len(cost))), None
    else:
        known = {place: each for place, each in cost.items() if each is not None}
        shards = max(busy, default=0) or _divide(known, most_tasks, min(TASK_SECONDS, usable))
        seconds = max(_loads(known, shards), default=0.0)
        longest = min(longest, 5 * ceil((SAFETY * seconds + START_SECONDS) / 300))
    return Layout(
        shards=shards,
        tasks=tuple(sorted({place % shards for place in cost})),
        jobs=len(cost),
        seconds=seconds,
        minutes=longest,
        memory_mb=limits.memory_mb or max(LEAST_MEMORY_MB, round(3 * (plan.memory_mb or 0))),
    )


def _divide(cost: dict[int, float], most: int, seconds: float) -> int:
    """Return how many shards keep the longest below ``seconds``, as far as ``most`` allows."""
    most = min(most, len(cost)) or 1
    shards = min(most, ceil(sum(cost.values()) / seconds) or 1)
    while shards < most and max(_loads(cost, shards)) > seconds:
        shards = min(most, ceil(1.1 * shards))
        if max(cost.values()) > seconds:  # one job alone takes longer: it will go on
            break
    return shards


def _loads(cost: dict[int, float], shards: int) -> list[float]:
    """Return the cost of every shard."""
    loads = [0.0] * shards
    for place, each in cost.items():
        loads[place % shards] += each
    return loads


def array_script(
    plan: Plan, layout: Layout, limits: Limits, offset: int, indices: list[int]
) -> str:
    """Return the batch script of one array: resources, and one line as in slurm/sweep.sbatch."""
    resources = {
        "array": index_list(indices),
        "time": layout.minutes,
        "mem": f"{layout.memory_mb}M",
        # The warning before the time limit: Slurm may be a minute early, and was 13 s late.
        "signal": f"B:USR1@{min(120, 40 * layout.minutes)}",
        "output": plan.results.logs.absolute() / "slurm-%A_%a.log",
    }
    index = f"$((SLURM_ARRAY_TASK_ID + {offset}))" if offset else "$SLURM_ARRAY_TASK_ID"
    command = _command("sweep", plan.study.path.absolute(), "--results", _root(plan))
    more = " --retry-failed" if any(f.kind == "physics" for f in plan.again.values()) else ""
    return _script(plan, limits, resources, f'{command} --shard "{index}/{layout.shards}"{more}')


def aggregation_script(plan: Plan, limits: Limits, after: list[str]) -> str:
    """Return the batch script of the aggregation, which runs after arrays, however they end."""
    resources: dict[str, object] = {
        "time": min(AGGREGATION_MINUTES, limits.minutes or AGGREGATION_MINUTES),
        "mem": f"{max(LEAST_MEMORY_MB, limits.memory_mb or 0) + plan.total // 25}M",
        "output": plan.results.logs.absolute() / "slurm-%j.log",
    }
    if after:
        resources["dependency"] = f"afterany:{':'.join(after)}"
    return _script(plan, limits, resources, _command("report", plan.results.folder.absolute()))


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
        If Slurm does not answer or refuses a script; says what is queued already.
    ResultsError
        If the results cannot be written.
    """
    before = slurm.submissions(plan.results)
    queue = slurm.queue()
    if queue is None and before and not dry_run:
        msg = "squeue does not answer, so what is queued already is not known: try again later"
        raise SlurmError(msg)
    busy = alive(before, queue or [])
    layout = lay_out(plan, limits, busy)
    for count, live in busy.items():
        say(f"  {len(live)} of {count} tasks wait or run already, and keep their jobs")
    arrays = layout.arrays(slurm.max_array_size()) if layout.tasks else []
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
        for offset, indices in arrays:
            say(f"\n{array_script(plan, layout, limits, offset, indices)}")
        names = [*map(str, after), *(f"<array {k}>" for k in range(len(arrays)))]
        say(f"\n{aggregation_script(plan, limits, names)}")
        return []
    plan.results.prepare(plan.study)
    numbers: list[int] = []
    try:
        for offset, indices in arrays:
            number = slurm.submit(array_script(plan, layout, limits, offset, indices))
            numbers.append(number)
            tasks = tuple(index + offset for index in indices)
            now = datetime.now(UTC).isoformat(timespec="seconds")
            slurm.record(
                plan.results, Submission(number, "array", now, layout.shards, tasks, offset)
            )
            say(f"array {number}: tasks {index_list(tasks)} of {layout.shards}")
        names = [str(job) for job in (*after, *numbers)]
        number = slurm.submit(aggregation_script(plan, limits, names))
        now = datetime.now(UTC).isoformat(timespec="seconds")
        slurm.record(plan.results, Submission(number, "aggregation", now))
    except SlurmError as error:
        so_far = f"queued: {', '.join(map(str, numbers))}" if numbers else "nothing is queued"
        msg = f"{error}; {so_far}; the same command again submits what is missing"
        raise SlurmError(msg) from error
    how = f"after {', '.join(names)}, however they end" if names else "at once"
    say(f"aggregation {number}: {how}")
    return [*numbers, number]


def _report_is_old(plan: Plan) -> bool:
    """Tell whether there are results that the report does not know."""
    changed = max((when for _, when in plan.results.stamps().values()), default=0)
    report = plan.results.report_file
    return changed > (report.stat().st_mtime_ns if report.exists() else 0)


def describe(layout: Layout, arrays: int) -> str:
    """Return in one line what will be submitted."""
    expected = "not measured" if layout.seconds is None else f"at most {duration(layout.seconds)}"
    line = (
        f"  {len(layout.tasks)} task(s) in {arrays} array(s) for {layout.jobs} jobs: {expected}, "
        f"limit {duration(60 * layout.minutes)}, {layout.memory_mb} MB each"
    )
    if layout.seconds is not None and layout.seconds > 60 * layout.minutes - START_SECONDS:
        line += "; longer than the limit: tasks will be requeued and go on"
    return line
