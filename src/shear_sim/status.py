"""How far a study is, and what one job found, for people and for scripts."""

import json
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from shear_sim import slurm
from shear_sim.results import Results, flatten
from shear_sim.screen import duration, size
from shear_sim.tables import TableError

SHOWN_FAILURES = 10
SAMPLE = 200  # results that are opened to learn what a job costs; ids are random, so any will do
RECENT_SECONDS = 3600.0  # over which the throughput is measured
WATCH_SECONDS = 10.0
_OF_A_PLAN = ("job", "point", "replicate", "labels")  # its columns; the others are what varies


def read_status(results: Results) -> dict[str, Any]:
    """Return the state of a study, JSON-ready, from one listing and one question to Slurm.

    ``problems`` are the plan or records of submissions that are missing or damaged, with what to
    do; without a plan ``planned`` and ``missing`` are None. Results that the plan does not ask for
    are ``orphans``. ``cpu_s`` and ``memory_mb`` are those of up to 200 jobs, ``measured_jobs``,
    scaled up. ``jobs_per_hour`` is that of the last hour, and ``seconds_left`` follows from it.
    ``tasks`` are those of Slurm: None if it does not answer. ``program`` is the one whose runs were
    imported, with no times then, or None.
    """
    stamps = results.stamps()
    failures = results.failures(stamps.keys())
    submitted, problems = slurm.submissions(results)
    planned = None
    try:
        planned = set(results.plan()[0].column("job").to_pylist())
    except TableError as error:
        problems.append(str(error))
    finished = stamps.keys() if planned is None else stamps.keys() & planned
    of_plan = failures if planned is None else {j: f for j, f in failures.items() if j in planned}
    missing = None if planned is None else len(planned) - len(finished) - len(of_plan)
    measured = _measured(results, sorted(stamps)[:: len(stamps) // SAMPLE + 1])
    each = sum(run["cpu_s"] for run in measured) / len(measured) if measured else 0.0
    changed = [when / 1e9 for _, when in stamps.values()]
    rate = _rate(changed, time.time())
    return {
        "results": str(results.folder),
        "problems": problems,
        "program": results.program(),
        "planned": None if planned is None else len(planned),
        "done": len(finished),
        "failed": [asdict(failure) for failure in of_plan.values()],
        "missing": missing,
        "orphans": 0 if planned is None else len(stamps.keys() - planned),
        "checkpoints": sum(1 for _ in results.checkpoints.glob("*.pickle")),
        "measured_jobs": len(measured),
        "cpu_s": each * len(stamps),
        "disk_bytes": sum(count for count, _ in stamps.values()) + results.snapshot_bytes(),
        "memory_mb": max((run["peak_memory_mb"] for run in measured), default=None),
        "last_finished": max(changed, default=None),
        "jobs_per_hour": rate,
        "seconds_left": 3600 * missing / rate if rate and missing else None,
        "tasks": _tasks(submitted, unfinished=missing != 0),
    }


def _measured(results: Results, jobs: list[str]) -> list[dict[str, Any]]:
    """Return what these jobs have cost; damaged results are left out with a warning."""
    return [s["run"] for s in results.summaries(jobs) if "cpu_s" in s["run"]]


def _rate(changed: list[float], now: float) -> float | None:
    """Return finished jobs per hour, over the last hour; None if none has ended in it."""
    recent = [when for when in changed if when > now - RECENT_SECONDS]
    if not recent:
        return None
    return 3600 * len(recent) / max(now - min(recent), 1.0)


def _tasks(
    submitted: Sequence[slurm.Submission], *, unfinished: bool
) -> list[dict[str, Any]] | None:
    """Return the job numbers of Slurm, the oldest first, with the states of their tasks."""
    queue = slurm.queue() if submitted else []
    if queue is None:
        return None
    accounts = slurm.ended(each.job for each in submitted) if submitted and unfinished else {}
    found = []
    for each in submitted:
        live = [task for task in queue if task.job == each.job]
        gone = max(len(each.tasks), 1) - len(live)
        states = Counter(
            f"waiting ({task.reason})" if task.state == "PENDING" else task.state.lower()
            for task in live
        )
        how = accounts.get(each.job) or {"ended": gone}
        states.update({state.lower(): count for state, count in how.items() if count})
        found.append({"job": each.job, "kind": each.kind, "tasks": dict(states)})
    return found


def describe_status(status: Mapping[str, Any]) -> str:
    """Return the status as lines for a person."""
    total = "?" if status["planned"] is None else status["planned"]
    lines = [f"{status['results']}: {status['done']} of {total} jobs done"]
    if status["missing"] is not None:
        lines[0] += f", {len(status['failed'])} failed, {status['missing']} missing"
    lines += [f"  {problem}" for problem in status["problems"]]
    if status["program"]:
        lines.append(f"  runs of {status['program']}, imported; {size(status['disk_bytes'])}")
    elif status["measured_jobs"]:
        each = status["cpu_s"] / (status["done"] + status["orphans"])
        lines.append(
            f"  {duration(status['cpu_s'])} of CPU ({each:.3g} s a job), "
            f"{size(status['disk_bytes'])}, at most {status['memory_mb']:.0f} MB a worker"
        )
        if status["missing"]:
            lines.append(f"  missing: about {duration(each * status['missing'])} of CPU")
    if status["checkpoints"]:
        lines.append(f"  {status['checkpoints']} jobs will go on from checkpoints")
    if status["tasks"] is None:
        lines.append("  Slurm: squeue does not answer: what waits and runs is not known")
    for each in status["tasks"] or ():
        states = ", ".join(f"{count} {state}" for state, count in each["tasks"].items())
        lines.append(f"  Slurm: {each['kind']} {each['job']}: {states}")
    if status["missing"] and status["jobs_per_hour"]:
        lines.append(
            f"  {status['jobs_per_hour']:.3g} jobs per hour in the last hour: "
            f"about {duration(status['seconds_left'])} left at that rate"
        )
    if status["orphans"]:
        lines.append(f"  {status['orphans']} results are not of the study file (any more)")
    for failure in status["failed"][:SHOWN_FAILURES]:
        what = f"{failure['kind']}, tried {failure['tries']} x"
        lines.append(f"  failed: {failure['job']} ({what}): {failure['reason']}")
    if len(status["failed"]) > SHOWN_FAILURES:
        lines.append(f"  ... and {len(status['failed']) - SHOWN_FAILURES} more, in failed/")
    if any(failure["kind"] == "physics" for failure in status["failed"]):
        lines.append("  failures by physics are tried again only with --retry-failed")
    if status["done"]:
        lines.append(f"next: shear-sim aggregate {status['results']}")
    return "\n".join(lines)


def read_jobs(results: Results) -> list[dict[str, Any]]:
    """Return the jobs of a study as last planned: scene, what varies, replicate and state each.

    Sorted by these, so that what belongs together stands together.

    Raises
    ------
    TableError
        If there is no plan, or it is damaged.
    """
    finished = results.finished()
    failed = results.failures(finished)
    found = []
    for row in results.plan()[0].to_pylist():
        scenes = dict.fromkeys(scene for _, scene in json.loads(row["labels"]))
        state = (
            "done" if row["job"] in finished else "failed" if row["job"] in failed else "missing"
        )
        varied = {name: value for name, value in row.items() if name not in _OF_A_PLAN}
        ends = {"replicate": row["replicate"], "state": state}
        found.append({"job": row["job"], "scene": "; ".join(scenes), **varied, **ends})
    return sorted(found, key=_place_of_job)


def _place_of_job(job: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Return what a job is sorted by: all but its id; values of a key may be of several types."""
    _, *values = job.values()
    return [("", "") if value is None else (type(value).__name__, value) for value in values]


def describe_jobs(jobs: Sequence[Mapping[str, Any]]) -> str:
    """Return the jobs of a study as lines for a person, one each."""
    rows = [list(jobs[0]) if jobs else [], *([_shown(v) for v in job.values()] for job in jobs)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


def watch(results: Results, show: Callable[[str], None]) -> None:
    """Show the status again and again until no job is missing."""
    while True:
        status = read_status(results)
        show(describe_status(status))
        if status["missing"] == 0:
            return
        time.sleep(WATCH_SECONDS)


def describe_job(summary: Mapping[str, Any]) -> str:
    """Return the summary of a job as lines for a person; long lists are cut (not in JSON)."""
    lines = []
    for block, content in summary.items():
        if not isinstance(content, Mapping):
            lines.append(f"{block}: {_shown(content)}")
            continue
        facts = flatten(content, lists=True)
        width = max(map(len, facts), default=0)
        lines.append(f"{block}:")
        lines += [f"  {name:{width}}  {_shown(value)}" for name, value in facts.items()]
    return "\n".join(lines)


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple):
        text = ", ".join(_shown(item) for item in value[:4])
        return f"[{text}{', ...' if len(value) > 4 else ''}]"
    if isinstance(value, float):
        return f"{value:.8g}"
    return "-" if value is None else str(value)
