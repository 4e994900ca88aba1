"""From the results of a study to tables: one row per run, and one per point with intervals.

Only the jobs of the study's plan count. A point without a finished run keeps its row, with
``replicates`` 0 of ``planned``, so that a partial study is never taken for a complete one. The
names of varied parameters are their dotted keys in the study file; no other column has a dot.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from shear_sim.models.interface import Column
from shear_sim.statistics import LEVEL, RESAMPLES, interval, seed_for

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from shear_sim.study import Job

#: Joins the names of scenes (or blocks) where one job belongs to several.
SEPARATOR = "; "

_TENSORS = {"": "periodic", "_internal": "internal", "_external": "external"}
_RUN_MODULI = tuple(
    Column(f"{name}{suffix}", unit, f"{text} of the {tensor} tensor")
    for suffix, tensor in _TENSORS.items()
    for name, unit, text in (
        ("storage_modulus", "Pa", "G'"),
        ("loss_modulus", "Pa", "G''"),
        ("complex_modulus", "Pa", "|G*| = sqrt(G'^2 + G''^2)"),
        ("tan_delta", "-", "G'' / G'"),
    )
)
_RUN_STRESS = (
    Column("in_phase_stress", "Pa", "G' A, Table S2-2"),
    Column("out_of_phase_stress", "Pa", "G'' A, Table S2-2"),
    Column("total_stress", "Pa", "|G*| A, Table S2-2"),
    Column("mean_stress", "Pa", "constant part of the fitted shear stress"),
    Column("drift", "Pa/s", "linear drift of the fitted shear stress"),
    Column("residual_stress", "Pa", "root mean square of what the fit leaves"),
)
_RUN_STEADY = (
    Column("shear_stress", "Pa", "mean over the second half of the strain"),
    Column("shear_stress_error", "Pa", "its standard error from the scatter of block means"),
    Column("viscosity", "Pa s", "mean shear stress / strain rate"),
    Column("viscosity_error", "Pa s", "its standard error from the scatter of block means"),
    Column("pressure", "Pa", "mean over the second half of the strain"),
    Column("stress_ratio", "-", "|shear stress| / pressure"),
)
_RUN_QUALITY = (
    Column("baseline_noise", "-", "peak-to-peak stress at rest / stress amplitude"),
    Column("surface_internal_ratio", "-", "|G*| of the external / of the internal tensor"),
    Column("cycle_change", "-", "relative change of |G*| between the last two periods"),
    Column("baseline_noisy", "", "baseline_noise over 10 %"),
    Column("surface_internal_differ", "", "surface_internal_ratio more than 30 % from 1"),
    Column("flagged", "", "one of the two, or nothing could be fitted"),
    Column("no_moduli", "", "why something could not be fitted"),
)
#: What a point is summarised by: per table, the columns of ``runs`` that get intervals.
POINT_TABLES = {
    "moduli": ("storage_modulus", "loss_modulus", "complex_modulus", "tan_delta"),
    "steady": ("shear_stress", "viscosity", "stress_ratio"),
}
_ALL_RUN = {c.name: c for c in (*_RUN_MODULI, *_RUN_STRESS, *_RUN_STEADY, *_RUN_QUALITY)}
_LABELS = (
    Column("job_id", "", "name of the run's file in jobs/"),
    Column("point_id", "", "the same for all replicates of a point"),
    Column("scene", "", "scene of the study"),
    Column("block", "", "block of the study"),
)


def runs_table(
    jobs: "Sequence[Job]", summaries: Mapping[str, Mapping[str, Any]], varied: Sequence[str]
) -> "pd.DataFrame":
    """Return one row per finished job of the plan.

    Parameters
    ----------
    jobs : sequence of Job
        The plan.
    summaries : mapping
        Job id to the summary in its result file, for finished jobs. Those of other jobs are not
        looked at.
    varied : sequence of str
        Dotted keys of the parameters that vary; they become columns.
    """
    rows = []
    for job in jobs:
        if job.id not in summaries:
            continue
        row = _label_row(job, varied) | {"replicate": job.replicate}
        rows.append(row | _run_values(summaries[job.id]))
    quantities = _present(rows)
    columns = [
        *_LABELS,
        *_parameters(jobs, varied),
        Column("replicate", "", "number of the replicate, from 0"),
        *quantities,
    ]
    return _frame(rows, columns, sort=("scene", *varied, "replicate"))


def _present(rows: Sequence[Mapping[str, Any]]) -> list[Column]:
    """Return the quantities that the rows hold, in the order of the tables above."""
    held = {name for row in rows for name in row}
    return [column for name, column in _ALL_RUN.items() if name in held]


def _label_row(job: "Job", varied: Sequence[str]) -> dict[str, Any]:
    point = _resolved(job)
    return {
        "job_id": job.id,
        "point_id": f"{seed_for(point):012x}",
        "scene": SEPARATOR.join(dict.fromkeys(scene for _, scene in job.labels)),
        "block": SEPARATOR.join(dict.fromkeys(block for block, _ in job.labels)),
    } | {key: _at(point, key) for key in varied}


def _resolved(job: "Job") -> dict[str, Any]:
    """Return every resolved parameter but paths: what a file says matters, not where it lies."""

    def without_paths(section: dict[str, Any]) -> dict[str, Any]:
        return {
            key: without_paths(value) if isinstance(value, dict) else value
            for key, value in section.items()
            if key != "file"
        }

    return without_paths(job.point.model_dump(mode="json"))


def _at(point: Mapping[str, Any], key: str) -> Any:
    """Return the value at a dotted key, None where this point has no such key."""
    value: Any = point
    for part in key.split("."):
        if not isinstance(value, Mapping) or part not in value:
            return None
        value = value[part]
    return json.dumps(value) if isinstance(value, dict | list) else value


def _run_values(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return the quantities of one run, None where the run has none."""
    flags = summary["flags"]
    if "steady" in summary:
        steady = summary["steady"] or {}
        return {column.name: steady.get(column.name) for column in _RUN_STEADY} | {
            "flagged": summary["steady"] is None,
            "no_moduli": flags.get("no_steady"),
        }
    values: dict[str, Any] = {}
    for suffix, tensor in _TENSORS.items():
        fit = summary["moduli"][tensor] or {}
        storage, loss = fit.get("storage"), fit.get("loss")
        values[f"storage_modulus{suffix}"] = storage
        values[f"loss_modulus{suffix}"] = loss
        known = storage is not None and loss is not None
        values[f"complex_modulus{suffix}"] = math.hypot(storage, loss) if known else None
        values[f"tan_delta{suffix}"] = loss / storage if known and storage != 0.0 else None
    fit = summary["moduli"]["periodic"] or {}
    keys = ("in_phase", "out_of_phase", "total", "offset", "drift", "residual")
    values |= {c.name: fit.get(key) for c, key in zip(_RUN_STRESS, keys, strict=True)}
    values |= dict(summary["quality"])
    limits = {name: flags[name] for name in ("baseline_noisy", "surface_internal_differ")}
    missing = summary["moduli"]["periodic"] is None
    return (
        values
        | limits
        | {"flagged": missing or any(limits.values()), "no_moduli": flags["no_moduli"]}
    )


def points_table(
    jobs: "Sequence[Job]",
    runs: "pd.DataFrame",
    varied: Sequence[str],
    *,
    quantities: Sequence[str],
    failed: Iterable[str] = (),
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> "pd.DataFrame":
    """Return one row per point of the plan: mean, median and interval over replicates.

    Parameters
    ----------
    jobs, runs, varied
        The plan, and `runs_table` of it.
    quantities : sequence of str
        Columns of ``runs`` to summarise; each gives ``_mean``, ``_median``, ``_ci_low``,
        ``_ci_high``, ``_ci_method`` and ``_ci_flag``.
    failed : iterable of str
        Ids of the jobs that failed.
    level : float
        Confidence level.
    resamples : int
        Of the bootstrap, seeded from the point alone (``ci_seed``): the same resamples of
        replicates for all quantities of a point, and the same at every aggregation.
    """
    failed = set(failed)
    points: dict[str, dict[str, Any]] = {}
    for job in jobs:
        labels = _label_row(job, varied)
        row = points.setdefault(labels["point_id"], labels | {"planned": 0, "failed": 0})
        row["planned"] += 1
        row["failed"] += job.id in failed
    groups = {point_id: group for point_id, group in runs.groupby("point_id")} if len(runs) else {}
    rows = []
    for point_id, row in points.items():
        row.pop("job_id")
        group = groups.get(point_id)
        row["replicates"] = 0 if group is None else len(group)
        row["flagged"] = 0 if group is None else int(group["flagged"].sum())
        row["ci_level"], row["ci_seed"] = level, int(point_id, 16)
        for name in quantities:
            values = np.array([]) if group is None else group[name].to_numpy(dtype=np.float64)
            row |= _statistics(name, values[np.isfinite(values)], row["ci_seed"], level, resamples)
        rows.append(row)
    columns = [
        *_LABELS[1:],
        *_parameters(jobs, varied),
        Column("replicates", "", "finished runs"),
        Column("planned", "", "runs of the plan"),
        Column("failed", "", "runs that failed"),
        Column("flagged", "", "finished runs outside a quality limit; they are counted in"),
        *[c for name in quantities for c in _statistics_columns(_ALL_RUN[name])],
        Column("ci_level", "-", "confidence level of the intervals"),
        Column("ci_seed", "", "seed of their bootstrap"),
    ]
    return _frame(rows, columns, sort=("scene", *varied))


def _statistics(
    name: str, values: "np.ndarray[Any, Any]", seed: int, level: float, resamples: int
) -> dict[str, Any]:
    found = interval(values, level=level, resamples=resamples, rng=np.random.default_rng(seed))
    return {
        f"{name}_mean": float(values.mean()) if len(values) else math.nan,
        f"{name}_median": float(np.median(values)) if len(values) else math.nan,
        f"{name}_ci_low": found.low,
        f"{name}_ci_high": found.high,
        f"{name}_ci_method": found.method,
        f"{name}_ci_flag": found.flag,
        f"{name}_n": found.n,
    }


def _statistics_columns(quantity: Column) -> list[Column]:
    name, unit, text = quantity
    return [
        Column(f"{name}_mean", unit, f"mean over replicates of {text}"),
        Column(f"{name}_median", unit, f"median over replicates of {text}"),
        Column(f"{name}_ci_low", unit, "lower bound of the interval of the mean"),
        Column(f"{name}_ci_high", unit, "upper bound of the interval of the mean"),
        Column(f"{name}_ci_method", "", "how: BCa, t, t_log (of the geometric mean), equal, none"),
        Column(f"{name}_ci_flag", "", "what weakens the interval"),
        Column(f"{name}_n", "", "runs that have a value"),
    ]


def _parameters(jobs: "Sequence[Job]", varied: Sequence[str]) -> list[Column]:
    """Return the varied parameters as columns, their units read from the schema."""
    points = {type(job.point) for job in jobs}
    return [
        next(
            (c for point in points if (c := _describe(point, key)) is not None),
            Column(key, "", ""),
        )
        for key in varied
    ]


def _describe(section: Any, key: str) -> Column | None:
    """Return the field at a dotted key of a section or union of sections; unit in brackets."""
    names = key.split(".")
    sections = [section]
    for depth, name in enumerate(names):
        fields = [s.model_fields[name] for s in sections if name in s.model_fields]
        if not fields:
            return None
        if depth == len(names) - 1:
            text = fields[0].description or ""
            unit = text.partition("[")[2].partition("]")[0] if "[" in text else ""
            return Column(key, unit, text)
        kinds = [field.annotation for field in fields]
        options = [o for kind in kinds for o in (get_args(kind) or (kind,))]
        sections = [option for option in options if hasattr(option, "model_fields")]
    return None


def _frame(
    rows: Sequence[Mapping[str, Any]], columns: Sequence[Column], sort: Sequence[str]
) -> "pd.DataFrame":
    """Return a sorted table that knows its units: ``attrs["units"]``, ``attrs["descriptions"]``."""
    import pandas as pd

    data = {c.name: _series([row.get(c.name) for row in rows]) for c in columns}
    frame = pd.DataFrame(data)
    frame = frame.sort_values(list(sort), kind="stable", ignore_index=True)
    frame.attrs["units"] = {c.name: c.unit for c in columns}
    frame.attrs["descriptions"] = {c.name: c.description for c in columns}
    return frame


def _series(values: Sequence[Any]) -> "pd.Series[Any]":
    """Return a column of one type: float, int, boolean or text; missing stays missing."""
    import pandas as pd

    given = [value for value in values if value is not None]
    if given and all(isinstance(value, bool) for value in given):
        return pd.Series(values, dtype="boolean")
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in given):
        whole = given and len(given) == len(values) and all(isinstance(v, int) for v in given)
        return pd.Series(values, dtype="int64" if whole else "float64")
    return pd.Series([None if v is None else str(v) for v in values], dtype="str")
