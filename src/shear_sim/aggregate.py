"""From the results of a study to tables: one row per run, and one per point with intervals.

Only the jobs of the study's plan count. A point without a finished run keeps its row, with
``replicates`` 0 of ``planned``, so that a partial study is never taken for a complete one. Varied
parameters have their dotted keys of the study file as names; no other column has a dot.

The numbers come from the summaries that the runs wrote, by way of the index of the results: no
series is read again, and only runs that are new since the last call are looked at.
"""

import json
import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from shear_sim import models
from shear_sim.models.interface import Column
from shear_sim.results import FORMAT, Results, ResultsError, read_job
from shear_sim.statistics import LEVEL, RESAMPLES, interval
from shear_sim.tables import read_arrow, read_summary, write_arrow, write_whole

if TYPE_CHECKING:
    import pandas as pd

#: Joins the names of scenes (or blocks) where a point belongs to several.
SEPARATOR = "; "
#: Per kind of shear the table with a row per point, and the columns of ``runs`` it summarises.
POINT_TABLES = {
    "oscillatory": ("moduli", ("storage_modulus", "loss_modulus", "complex_modulus", "tan_delta")),
    "steady": ("steady", ("shear_stress", "viscosity", "stress_ratio")),
    "compression": ("compression", ()),
    "self_propelled": ("self_propelled", ()),
}
_TENSORS = {"periodic": "", "internal": "_internal", "external": "_external"}

_LABELS = (
    Column("point", "", "id of the point, the same for all its replicates"),
    Column("scene", "", "scene of the study"),
    Column("block", "", "block of the study's sweep"),
)
_MODULI = tuple(
    Column(f"{name}{suffix}", unit, f"{text} of the {tensor} tensor")
    for tensor, suffix in _TENSORS.items()
    for name, unit, text in (
        ("storage_modulus", "Pa", "G'"),
        ("loss_modulus", "Pa", "G''"),
        ("complex_modulus", "Pa", "|G*| = sqrt(G'^2 + G''^2)"),
        ("tan_delta", "1", "G''/G'"),
    )
)
# Each with its key in the index of the results.
_OSCILLATORY = (
    (Column("in_phase_stress", "Pa", "G' A, Table S2-2"), "moduli.periodic.in_phase"),
    (Column("out_of_phase_stress", "Pa", "G'' A, Table S2-2"), "moduli.periodic.out_of_phase"),
    (Column("total_stress", "Pa", "|G*| A, Table S2-2"), "moduli.periodic.total"),
    (Column("mean_stress", "Pa", "constant part of the stress fit"), "moduli.periodic.offset"),
    (Column("drift", "Pa/s", "linear part of the stress fit"), "moduli.periodic.drift"),
    (Column("residual_stress", "Pa", "root mean square beside it"), "moduli.periodic.residual"),
    (
        Column("baseline_noise", "1", "peak-to-peak stress at rest / stress amplitude"),
        "quality.baseline_noise",
    ),
    (
        Column("surface_internal_ratio", "1", "|G*| of the external / of the internal tensor"),
        "quality.surface_internal_ratio",
    ),
    (
        Column("cycle_change", "1", "relative change of |G*| between the last two periods"),
        "quality.cycle_change",
    ),
    (Column("baseline_noisy", "", "baseline_noise over 10 %"), "flags.baseline_noisy"),
    (
        Column("surface_internal_differ", "", "surface_internal_ratio more than 30 % from 1"),
        "flags.surface_internal_differ",
    ),
    (Column("not_at_rest", "", "the packing moved when its rest began"), "flags.not_at_rest"),
    (Column("no_moduli", "", "why something could not be fitted"), "flags.no_moduli"),
)
_STEADY = (
    (Column("shear_stress", "Pa", "mean over the late half of the strain"), "steady.shear_stress"),
    (
        Column("shear_stress_error", "Pa", "its standard error, from block means"),
        "steady.shear_stress_error",
    ),
    (Column("viscosity", "Pa s", "mean shear stress / strain rate"), "steady.viscosity"),
    (
        Column("viscosity_error", "Pa s", "its standard error, from block means"),
        "steady.viscosity_error",
    ),
    (Column("pressure", "Pa", "mean over the late half of the strain"), "steady.pressure"),
    (Column("stress_ratio", "1", "|shear stress| / pressure"), "steady.stress_ratio"),
    (Column("not_at_rest", "", "the packing moved when its rest began"), "flags.not_at_rest"),
    (Column("no_steady", "", "why nothing could be averaged"), "flags.no_steady"),
)
_FLAGGED = Column("flagged", "", "outside a quality limit, or without a result")
_UNITS = {c.name: c for c in (*_MODULI, *(c for c, _ in (*_OSCILLATORY, *_STEADY)))}


def aggregate(folder: Path | str, *, figures: bool = True) -> "dict[str, pd.DataFrame]":
    """Turn the results of a study, complete or not, into tables and figures.

    Parameters
    ----------
    folder : Path or str
        ``results/<study>``.
    figures : bool
        Whether to draw the figures as well.

    Returns
    -------
    dict of DataFrame
        See `make_tables`.

    Raises
    ------
    ResultsError
        If ``folder`` is not a results folder, or cannot be written.
    TableError
        If its plan is missing or damaged.
    """
    tables = make_tables(folder)
    write(folder, tables, figures=figures)
    return tables


def write(folder: Path | str, tables: "Mapping[str, pd.DataFrame]", *, figures: bool) -> None:
    """Write ``tables`` as Parquet and CSV into ``tables/`` (see `save`), and draw the figures.

    Raises
    ------
    ResultsError
        If the results folder cannot be written.
    """
    results = Results.existing(Path(folder))
    try:
        results.tables.mkdir(exist_ok=True)
        for name, table in tables.items():
            save(table, results.tables / name)
        if figures:
            from shear_sim.figures import draw

            draw(tables, results.figures, _example(results, tables))
    except OSError as error:
        msg = (
            f"{folder}: the tables and figures cannot be written ({error}): make the folder "
            "writable, or copy it to a place of your own and aggregate the copy"
        )
        raise ResultsError(msg) from error


def make_tables(folder: Path | str) -> "dict[str, pd.DataFrame]":
    """Return the tables of a study from its results, complete or not; nothing is written.

    Parameters
    ----------
    folder : Path or str
        ``results/<study>``.

    Returns
    -------
    dict of DataFrame
        ``runs``, one row per finished run; ``moduli`` (oscillatory shear) and ``steady``, one row
        per point of the plan. The units are in ``attrs["units"]``, the number of orphans (results
        of jobs outside the plan, not counted) in ``attrs["orphans"]``.

    Raises
    ------
    ResultsError
        If ``folder`` is not a results folder.
    TableError
        If its plan is missing or damaged.
    """
    results = Results.existing(Path(folder))
    plan, study = results.plan()
    planned, index = plan.to_pandas(), results.index().to_pandas()
    points = [models.model(kind).POINT for kind in study["models"]]
    parameters = [describe_parameter(points, key) for key in study["varied"]]
    planned = _labelled(planned, _scene_order(results.study_file))
    orphans = int((~index["job"].isin(planned["job"])).sum())
    measured = [item for kind in study["models"] for item in models.model(kind).MEASURED]
    own = tuple(column.name for column, _ in measured if column.unit)
    runs = runs_table(planned, index, parameters, measured)
    tables = {"runs": runs}
    shear = _kinds_of_shear(planned, index)
    failed = results.failures().keys()
    for kind, (name, quantities) in POINT_TABLES.items():
        of_kind = planned[shear == kind]
        if len(of_kind):
            tables[name] = points_table(
                of_kind, runs, parameters, (*quantities, *own), measured=measured, failed=failed
            )
    for table in tables.values():
        table.attrs |= {"study": study["study"], "orphans": orphans}
    return tables


def _scene_order(study_file: Path) -> list[str]:
    """Return the scenes in the order of the study file: the one that its author thinks in."""
    from shear_sim.document import read_yaml

    scenes = read_yaml(study_file.read_bytes(), study_file).data.get("scenes") or {}
    return list(scenes)


def _labelled(planned: "pd.DataFrame", scene_order: Sequence[str]) -> "pd.DataFrame":
    """Add ``scene`` (sorted as in the study file) and ``block`` to the jobs of the plan."""
    import pandas as pd

    pairs = planned["labels"].map(json.loads)
    scenes = pairs.map(lambda labels: SEPARATOR.join(dict.fromkeys(scene for _, scene in labels)))
    blocks = pairs.map(lambda labels: SEPARATOR.join(dict.fromkeys(block for block, _ in labels)))
    known = {scene: place for place, scene in enumerate(scene_order)}
    order = sorted(scenes.unique(), key=lambda s: (known.get(s.split(SEPARATOR)[0], len(known)), s))
    scene = pd.Categorical(scenes, categories=order, ordered=True)
    return planned.drop(columns="labels").assign(scene=scene, block=blocks)


def _kinds_of_shear(planned: "pd.DataFrame", index: "pd.DataFrame") -> "pd.Series[str]":
    """Return the kind of shear of each job of the plan: a column of it, or the same for all."""
    import pandas as pd

    if "shear.kind" in planned:
        return planned["shear.kind"]
    kind = "oscillatory"
    if "shear.kind" in index:
        known = index.loc[index["job"].isin(planned["job"]), "shear.kind"]
        kind = known.iloc[0] if len(known) else kind
    return pd.Series(kind, index=planned.index)


def runs_table(
    planned: "pd.DataFrame",
    index: "pd.DataFrame",
    parameters: Sequence[Column],
    measured: Sequence[tuple[Column, str]] = (),
) -> "pd.DataFrame":
    """Return one row per finished job of the plan.

    Parameters
    ----------
    planned : DataFrame
        The plan: ``job``, ``point``, ``replicate``, ``scene``, ``block``, varied parameters.
    index : DataFrame
        The index of the results; jobs outside the plan are not looked at.
    parameters : sequence of Column
        The varied parameters.
    measured : sequence of (Column, key)
        What the models measure themselves, see `shear_sim.models.interface.Model`.
    """
    import pandas as pd

    units = _UNITS | {column.name: column for column, _ in measured}
    found = planned.merge(
        index.drop(columns=[c for c in planned.columns if c != "job" and c in index]), on="job"
    )
    data: dict[str, Any] = {}
    for tensor, suffix in _TENSORS.items():
        if f"moduli.{tensor}.storage" in found:
            storage, loss = (
                pd.to_numeric(found[f"moduli.{tensor}.{name}"]) for name in ("storage", "loss")
            )
            data[f"storage_modulus{suffix}"] = storage
            data[f"loss_modulus{suffix}"] = loss
            data[f"complex_modulus{suffix}"] = np.hypot(storage, loss)
            data[f"tan_delta{suffix}"] = loss / storage.where(storage != 0.0)
    for column, key in (*_OSCILLATORY, *_STEADY, *measured):
        if key in found:
            data[column.name] = _typed(found[key], column)
    nothing = pd.Series(data=True, index=found.index)
    for name in ("storage_modulus", "shear_stress", *[c.name for c, _ in measured if c.unit]):
        if name in data:
            nothing &= data[name].isna()
    flags = [data[n].fillna(value=False) for n in data if n in _FLAG_NAMES]
    data["flagged"] = np.logical_or.reduce([nothing, *flags]).astype(bool)
    columns = [
        Column("job", "", "name of the run's file in jobs/"),
        *_LABELS,
        *parameters,
        Column("replicate", "1", "number of the replicate, from 0"),
        *[units[name] for name in data if name != "flagged"],
        _FLAGGED,
    ]
    return _table(found.assign(**data), columns, sort=["replicate"], parameters=parameters)


_FLAG_NAMES = ("baseline_noisy", "surface_internal_differ", "not_at_rest", "stopped_early")


def _typed(values: "pd.Series[Any]", column: Column) -> "pd.Series[Any]":
    """Return values of the type of their column; those of an index of few runs may have none."""
    import pandas as pd

    if column.name in _FLAG_NAMES:
        return values.astype("boolean")
    return pd.to_numeric(values) if column.unit else values.astype("str")


def points_table(
    planned: "pd.DataFrame",
    runs: "pd.DataFrame",
    parameters: Sequence[Column],
    quantities: Sequence[str],
    *,
    measured: Sequence[tuple[Column, str]] = (),
    failed: Collection[str] = (),
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> "pd.DataFrame":
    """Return one row per point of the plan: mean, median and interval over replicates.

    Parameters
    ----------
    planned, runs, parameters
        The plan, `runs_table` of it, and the varied parameters.
    quantities : sequence of str
        Columns of ``runs`` to summarise; each gives ``_mean``, ``_median``, ``_ci_low``,
        ``_ci_high``, ``_ci_method``, ``_ci_flag`` (see `shear_sim.statistics.Interval`) and
        ``_n``, the runs that have a value.
    measured : sequence of (Column, key)
        See `runs_table`.
    failed : collection of str
        Ids of the jobs that failed.
    level : float
        Confidence level.
    resamples : int
        Of the bootstrap. Its seed (``ci_seed``) comes from the point's id: the same resamples of
        replicates for all quantities of a point, the same intervals at every aggregation, and
        those of old points stay when a study grows.
    """
    units = _UNITS | {column.name: column for column, _ in measured}
    points = planned.drop_duplicates("point").set_index("point", drop=False)
    failures = planned["job"].isin(set(failed)).groupby(planned["point"]).sum()
    counts = planned["point"].value_counts()
    groups = dict(iter(runs.groupby("point")))
    rows: list[dict[str, Any]] = []
    for point in points.index:
        group = groups.get(point, runs.iloc[:0])
        seed = int(point[:12], 16)
        row: dict[str, Any] = {
            "replicates": len(group),
            "planned": counts[point],
            "failed": failures[point],
            "flagged": group["flagged"].sum(),
        }
        for name in quantities:
            values = group[name].to_numpy(np.float64) if name in group else np.empty(0)
            finite = values[np.isfinite(values)]
            rng = np.random.default_rng(seed)
            found = interval(finite, level=level, resamples=resamples, rng=rng)
            row |= {
                f"{name}_mean": finite.mean() if found.n else math.nan,
                f"{name}_median": np.median(finite) if found.n else math.nan,
                f"{name}_ci_low": found.low,
                f"{name}_ci_high": found.high,
                f"{name}_ci_method": found.method,
                f"{name}_ci_flag": found.flag,
                f"{name}_n": found.n,
            }
        rows.append(row | {"ci_level": level, "ci_seed": seed})
    columns = [
        *_LABELS,
        *parameters,
        Column("replicates", "1", "finished runs"),
        Column("planned", "1", "runs of the plan"),
        Column("failed", "1", "runs that failed"),
        Column("flagged", "1", "finished runs outside a quality limit; they are counted in"),
        *[column for name in quantities for column in _statistics_of(units[name])],
        Column("ci_level", "1", "confidence level of the intervals"),
        Column("ci_seed", "1", "seed of their bootstrap"),
    ]
    data = {key: [row[key] for row in rows] for key in rows[0]}
    return _table(points.reset_index(drop=True).assign(**data), columns, [], parameters)


def _statistics_of(quantity: Column) -> list[Column]:
    name, unit, text = quantity
    return [
        Column(f"{name}_mean", unit, f"mean over replicates of {text}"),
        Column(f"{name}_median", unit, f"median over replicates of {text}"),
        Column(f"{name}_ci_low", unit, "lower bound of the interval of the mean"),
        Column(f"{name}_ci_high", unit, "upper bound of the interval of the mean"),
        Column(f"{name}_ci_method", "", "BCa, percentile, t, t_log (geometric mean), equal, none"),
        Column(f"{name}_ci_flag", "", "what weakens the interval"),
        Column(f"{name}_n", "1", "runs that have a value"),
    ]


def describe_parameter(sections: Sequence[Any], key: str) -> Column:
    """Return a parameter as a column: unit (in brackets there) and words from its schema.

    The unit of plain numbers is 1, that of words is empty.
    """
    for name in key.split("."):
        fields = [s.model_fields[name] for s in sections if name in s.model_fields]
        options = [o for f in fields for o in (f.annotation, *get_args(f.annotation))]
        sections = [option for option in options if hasattr(option, "model_fields")]
        text = (fields[0].description if fields else None) or ""
    unit = text.partition("[")[2].partition("]")[0]
    if unit in {"", "-"}:
        unit = "1" if any(option in {int, float} for option in options) else ""
    return Column(key, unit, text)


def _table(
    data: "pd.DataFrame",
    columns: Sequence[Column],
    sort: Sequence[str],
    parameters: Sequence[Column],
) -> "pd.DataFrame":
    """Return the named columns, sorted by scene and parameters, and what they mean."""
    keys = ["scene", *[parameter.name for parameter in parameters], *sort]
    data = data.sort_values(keys, kind="stable", ignore_index=True)
    data = data[[column.name for column in columns]]
    # A column of words that holds none yet would have no type, and another one tomorrow.
    words = [name for name in data if data[name].dtype.kind == "O" and name not in _FLAG_NAMES]
    data = data.astype(dict.fromkeys(words, "str"))
    data.attrs = {
        "units": {column.name: column.unit for column in columns},
        "descriptions": {column.name: column.description for column in columns},
    }
    return data


def save(table: "pd.DataFrame", stem: Path) -> None:
    """Write ``<stem>.parquet`` (unit and description in each field's metadata) and ``<stem>.csv``.

    In the CSV, names carry the unit: ``storage_modulus_mean_Pa``.
    """
    import pyarrow as pa

    attrs = table.attrs
    arrays = [pa.array(table[name], from_pandas=True) for name in table]
    fields = [
        pa.field(
            name,
            array.type,
            metadata={"unit": attrs["units"][name], "description": attrs["descriptions"][name]},
        )
        for name, array in zip(table, arrays, strict=True)
    ]
    about = {str(key): attrs[key] for key in attrs if key not in {"units", "descriptions"}}
    whole = pa.Table.from_arrays(arrays, schema=pa.schema(fields))
    write_arrow(stem.with_suffix(".parquet"), whole, {"format": FORMAT, **about})
    names = {name: _with_unit(str(name), attrs["units"][name]) for name in table}
    text = table.rename(columns=names).to_csv(index=False, lineterminator="\n")
    write_whole(stem.with_suffix(".csv"), text.encode())


def _with_unit(name: str, unit: str) -> str:
    spelled = unit.replace("1/", "per_").replace("/", "_per_").replace(" ", "_")
    return name if unit in {"", "1"} else f"{name}_{spelled}"


def load(path: Path) -> "pd.DataFrame":
    """Read a table that `save` wrote, with its units, as `aggregate` returned it.

    Raises
    ------
    TableError
        If it is missing or damaged.
    """
    table = read_arrow(path)
    frame: pd.DataFrame = table.to_pandas()
    frame = frame.astype(dict.fromkeys([name for name in _FLAG_NAMES if name in frame], "boolean"))
    about = {key: value for key, value in read_summary(path).items() if key != "format"}
    metadata = {field.name: field.metadata or {} for field in table.schema}
    frame.attrs = about | {
        "units": {name: m.get(b"unit", b"").decode() for name, m in metadata.items()},
        "descriptions": {name: m.get(b"description", b"").decode() for name, m in metadata.items()},
    }
    return frame


def _example(results: Results, tables: "Mapping[str, pd.DataFrame]") -> dict[str, Any] | None:
    """Return what `figures.example_run` draws: the run nearest to the middle of the study.

    Of the scene that comes first, at the middle of the amplitudes, the first finished replicate
    that is not flagged (of all, where all are).
    """
    from shear_sim.variation import AMPLITUDE

    runs = tables["runs"]
    kept = runs[~runs["flagged"]]
    kept = runs if kept.empty else kept
    if kept.empty:
        return None
    kept = kept[kept["scene"] == kept["scene"].iloc[0]]
    if AMPLITUDE in kept:
        values = np.sort(kept[AMPLITUDE].dropna().unique())
        kept = kept[kept[AMPLITUDE] == values[len(values) // 2]]
    first = kept.iloc[0]
    series = read_job(results.job_file(str(first["job"])))
    if not {"time", "strain", "shear_stress"} <= series.columns.keys():
        return None  # not recorded
    facts = [str(first["scene"])] + [
        f"{key.rpartition('.')[2].replace('_', ' ')} {first[key]:g}"
        for key in kept
        if "." in key and kept[key].dtype.kind in "if" and math.isfinite(first[key])
    ]
    summary = series.summary
    return {
        "columns": series.columns,
        "protocol": summary["protocol"],
        "moduli": summary.get("moduli", {}).get("periodic"),
        "title": f"job {first['job']}: {', '.join(facts)}",
    }
