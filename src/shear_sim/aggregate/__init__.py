"""From the results of a study to tables; `columns` says what each of them holds.

Only the jobs of the study's plan count. A point without a finished run keeps its row, with
``replicates`` 0 of ``planned``, so that a partial study is never taken for a complete one.

The numbers come from the summaries that the runs wrote, by way of the index of the results: no
series is read again, and only runs that are new since the last call are looked at. Reading order:
`runs` (what single runs say), `curves` (means over replicates), `features` (landmarks of curves),
`contrasts` (differences between curves).
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from shear_sim import models
from shear_sim.aggregate.columns import CONTACT_LAWS, OF_TENSOR, POINT_TABLES, TABLES, TENSORS
from shear_sim.aggregate.contrasts import contrasts_table
from shear_sim.aggregate.curves import STEADY_QUANTITIES, curves_table, means_table
from shear_sim.aggregate.estimators import historical_table
from shear_sim.aggregate.features import features_table, find_curves
from shear_sim.aggregate.frame import describe_parameter, frame, load, save
from shear_sim.aggregate.runs import Waves, cycles_table, harmonics_table, labelled, runs_table
from shear_sim.results import Results, ResultsError, read_job, remove
from shear_sim.rheology import TENSORS as SHEAR_STRESS

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow

__all__ = ["aggregate", "describe_parameter", "load", "make_tables", "save", "write"]


def aggregate(
    folder: Path | str,
    *,
    figures: bool = True,
    tensor: str | None = None,
    historical: bool = False,
) -> "dict[str, pd.DataFrame]":
    """Turn the results of a study, complete or not, into tables and figures.

    Parameters
    ----------
    folder : Path or str
        ``results/<study>``.
    figures : bool
        Whether to draw the figures as well.
    tensor, historical
        See `make_tables`.

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
    tables = make_tables(folder, tensor=tensor, historical=historical)
    write(folder, tables, figures=figures)
    return tables


def write(folder: Path | str, tables: "Mapping[str, pd.DataFrame]", *, figures: bool) -> list[Path]:
    """Write ``tables`` as Parquet and CSV into ``tables/`` (see `save`), and draw the figures.

    Tables and figures that an earlier call has written and this one does not are removed: they
    would be of other runs. Files of other names are left alone.

    Returns
    -------
    list of Path
        The folders with what was written: not that of figures, if the tables allow none.

    Raises
    ------
    ResultsError
        If the results folder cannot be written.
    """
    results = Results.existing(Path(folder))
    drawn: list[Path] = []
    try:
        results.tables.mkdir(exist_ok=True)
        for name, table in tables.items():
            save(table, results.tables / name)
        remove(results.tables, TABLES - tables.keys(), (".parquet", ".csv"))
        if figures:
            from shear_sim.figures import draw

            drawn = draw(tables, results.figures, _example(results, tables))
        else:
            from shear_sim.figures import CAPTIONS

            remove(results.figures, CAPTIONS.keys(), (".png", ".pdf"))
    except OSError as error:
        msg = (
            f"{folder}: the tables and figures cannot be written ({error}): make the folder "
            "writable, or copy it to a place of your own and aggregate the copy"
        )
        raise ResultsError(msg) from error
    return [results.tables, results.figures] if drawn else [results.tables]


def make_tables(
    folder: Path | str, *, tensor: str | None = None, historical: bool = False
) -> "dict[str, pd.DataFrame]":
    """Return the tables of a study from its results, complete or not; nothing is written.

    Parameters
    ----------
    folder : Path or str
        ``results/<study>``.
    tensor : {"periodic", "internal", "external"}, optional
        The stress tensor whose harmonics make all tables but ``runs``, which has the moduli of all.
        Default: periodic; internal for imported runs, which have no periodic one.
    historical : bool
        Add table ``historical``, for which all series are read.

    Returns
    -------
    dict of DataFrame
        By the names in `columns`: those of an oscillatory study, or of the other kinds of shear.
        In ``attrs``: ``units`` and ``descriptions`` of the columns, ``study``, ``done`` and
        ``planned`` jobs, ``orphans`` (results of jobs outside the plan, not counted), ``damaged``
        (jobs whose results cannot be read), ``tensor``, ``paired``, ``program`` (that made the
        runs).

    Raises
    ------
    ResultsError
        If ``folder`` is not a results folder.
    TableError
        If its plan is missing or damaged.
    ValueError
        If there is no such tensor.
    """
    results = Results.existing(Path(folder))
    plan, study = results.plan()
    tensor = tensor or str(study.get("tensor", "periodic"))
    if tensor not in TENSORS:
        msg = f"tensor = {tensor!r}: give one of {', '.join(TENSORS)}"
        raise ValueError(msg)
    index = results.index()
    # Where a plan does not say otherwise, replicate r draws the same numbers at every point.
    seed, paired = int(study["seed"]), bool(study.get("paired", True))
    points = [models.model(kind).POINT for kind in study["models"]]
    parameters = [describe_parameter(points, key) for key in study["varied"]]
    planned = labelled(plan.to_pandas(), _scene_order(results))
    waves, facts = Waves(index, tensor), _without_lists(index)
    measured = [item for kind in study["models"] for item in models.model(kind).MEASURED]
    runs = runs_table(planned, facts, parameters, waves, tensor, measured)
    tables = {"runs": runs}
    kinds = _kinds_of_shear(planned, facts)
    failed = results.failures().keys()
    oscillatory = planned[kinds == "oscillatory"]
    if len(oscillatory):
        curves = find_curves(oscillatory, runs, waves)
        tables["cycles"] = cycles_table(runs, waves)
        tables["harmonics"] = harmonics_table(runs, waves)
        tables["curves"] = curves_table(
            oscillatory, runs, parameters, waves, tensor=tensor, failed=failed, seed=seed
        )
        for name, table in (("features", features_table), ("contrasts", contrasts_table)):
            tables[name] = table(oscillatory, parameters, curves, paired=paired, seed=seed)
    numbers = tuple(column for column, _ in measured if column.unit)
    for kind, name in POINT_TABLES.items():
        of_kind = planned[kinds == kind]
        if len(of_kind) and kind != "oscillatory":
            quantities = (*STEADY_QUANTITIES, *numbers) if kind == "steady" else numbers
            tables[name] = means_table(
                of_kind, runs, parameters, quantities, failed=failed, seed=seed
            )
    if historical:
        tables["historical"] = historical_table(results, runs)
    counted = facts[facts["job"].isin(runs["job"])]
    if (laws := _contact_laws(study["models"], counted)) is not None:
        tables["contact_laws"] = laws
    about = {
        "study": study["study"],
        "program": study.get("program", "shear-sim"),
        "done": len(runs),
        "planned": len(planned),
        "orphans": index.num_rows - len(runs),
        "damaged": sorted(set(planned["job"]) & results.finished() - set(facts["job"])),
        "tensor": tensor,
        "paired": paired,
    }
    for name, one in tables.items():
        if name in OF_TENSOR:
            tables[name] = one = one.copy()  # one block: pandas complains of columns one by one
            one["tensor"] = tensor
            one.attrs["units"]["tensor"] = ""
            one.attrs["descriptions"]["tensor"] = "stress tensor that the moduli are of"
        one.attrs |= about
    return tables


def _contact_laws(kinds: "list[str]", runs: "pd.DataFrame") -> "pd.DataFrame | None":
    """Return the contact laws of the first model that has such laws and finished runs."""
    for kind in kinds:
        curves = getattr(models.model(kind), "contact_laws", None)
        if curves is None:
            continue
        of_kind = runs[runs["model.kind"] == kind]
        if len(of_kind):
            data, note = curves(of_kind)
            table = frame(data, CONTACT_LAWS)
            table.attrs["note"] = note
            return table
    return None


def _scene_order(results: Results) -> list[str]:
    """Return the scenes in the order of the study file: the one that its author thinks in."""
    from shear_sim.document import read_yaml

    text = results.study_text().encode()
    scenes = read_yaml(text, results.study_file).data.get("scenes") or {}
    return list(scenes)


def _without_lists(index: "pyarrow.Table") -> "pd.DataFrame":
    import pyarrow as pa

    names = [field.name for field in index.schema if not pa.types.is_list(field.type)]
    frame: pd.DataFrame = index.select(names).to_pandas()
    return frame


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


def _example(results: Results, tables: "Mapping[str, pd.DataFrame]") -> dict[str, Any] | None:
    """Return what `figures.example_run` draws: the run nearest to the middle of the study.

    Of the scene that comes first: at the middle of the amplitudes, there at the middle of the
    values of each other parameter in turn. The first finished replicate that is not flagged (of
    all, where all are).
    """
    from shear_sim.variation import AMPLITUDE

    runs = tables["runs"]
    kept = runs[~runs["flagged"]]
    kept = runs if kept.empty else kept
    if kept.empty:
        return None
    kept = kept[kept["scene"] == kept["scene"].iloc[0]]
    numbers = [str(key) for key in kept if "." in key and kept[key].dtype.kind in "if"]
    for key in sorted(numbers, key=lambda key: key != AMPLITUDE):
        values = np.sort(kept[key].unique())
        if np.isfinite(values).all():  # not a parameter that only some of the runs have
            kept = kept[kept[key] == values[len(values) // 2]]
    first = kept.iloc[0]
    series = read_job(results.job_file(str(first["job"])))
    tensor = runs.attrs["tensor"]
    if not {"time", "strain", SHEAR_STRESS[tensor]} <= series.columns.keys():
        return None  # not recorded
    units = runs.attrs["units"]
    facts = [str(first["scene"])] + [
        f"{key.rpartition('.')[2].replace('_', ' ')} {first[key]:g}"
        + (f" {units[key]}" if units[key] not in {"", "1"} else "")
        for key in numbers
        if math.isfinite(first[key])
    ]
    summary = series.summary
    return {
        "columns": {**series.columns, "shear_stress": series.columns[SHEAR_STRESS[tensor]]},
        "protocol": summary["protocol"],
        "moduli": summary.get("moduli", {}).get(tensor),
        "title": f"job {first['job']}: {', '.join(facts)}",
    }
