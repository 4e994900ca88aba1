"""How far a study is, and what one job found, for people and for scripts."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from shear_sim.results import Results, flatten
from shear_sim.screen import duration, size
from shear_sim.tables import TableError

SHOWN_FAILURES = 10


def read_status(results: Results) -> dict[str, Any]:
    """Return the state of a study, JSON-ready: counts, failures, measured times [s] and bytes.

    ``planned`` and ``missing`` are None if the study was never planned in this folder; results
    that the plan does not ask for are ``orphans``. ``program`` is the one whose runs were imported,
    with no times then, or None.
    """
    finished, failures = results.finished(), results.failures()
    try:
        planned = set(results.plan()[0].column("job").to_pylist())
    except TableError:
        planned = None
    index = results.index().to_pydict() if finished else {}
    of_plan = failures if planned is None else {j: f for j, f in failures.items() if j in planned}
    return {
        "results": str(results.folder),
        "program": results.program(),
        "planned": None if planned is None else len(planned),
        "done": len(finished if planned is None else finished & planned),
        "failed": [asdict(failure) for failure in of_plan.values()],
        "missing": None if planned is None else len(planned - finished - of_plan.keys()),
        "orphans": 0 if planned is None else len(finished - planned),
        "cpu_s": sum(index.get("run.cpu_s", ())),
        "disk_bytes": sum(index.get("bytes", ())),
        "memory_mb": max(index.get("run.peak_memory_mb", ()), default=None),
        "last_started": max(index.get("run.started", ()), default=None),
    }


def describe_status(status: Mapping[str, Any]) -> str:
    """Return the status as lines for a person."""
    total = "?" if status["planned"] is None else status["planned"]
    lines = [f"{status['results']}: {status['done']} of {total} jobs done"]
    if status["missing"] is not None:
        lines[0] += f", {len(status['failed'])} failed, {status['missing']} missing"
    if status["program"]:
        lines.append(f"  runs of {status['program']}, imported; {size(status['disk_bytes'])}")
    elif status["memory_mb"] is not None:  # some result can be read
        each = status["cpu_s"] / (status["done"] + status["orphans"])
        lines.append(
            f"  {duration(status['cpu_s'])} of CPU ({each:.3g} s a job), "
            f"{size(status['disk_bytes'])}, at most {status['memory_mb']:.0f} MB a worker"
        )
        lines.append(f"  last job started {status['last_started']}")
        if status["missing"]:
            lines.append(f"  missing: about {duration(each * status['missing'])} of CPU")
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
