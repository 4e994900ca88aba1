"""Table ``historical``: the moduli of every run as the historical programs would have read them."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from shear_sim.aggregate import columns as tables
from shear_sim.aggregate.frame import frame
from shear_sim.historical import ESTIMATORS, estimate
from shear_sim.results import Results, read_job
from shear_sim.rheology import TENSORS

if TYPE_CHECKING:
    import pandas as pd


def historical_table(results: Results, runs: "pd.DataFrame") -> "pd.DataFrame":
    """Return one row per run in oscillatory shear, tensor and historical estimator.

    The only table for which the series are read, run by run: some milliseconds each.

    Parameters
    ----------
    results : Results
        Where the runs are.
    runs : DataFrame
        Table ``runs``.
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for job, point, replicate in zip(runs["job"], runs["point"], runs["replicate"], strict=True):
        columns, summary = read_job(results.job_file(job))
        if summary["protocol"]["kind"] != "oscillatory":
            continue
        for tensor, series in TENSORS.items():
            if series not in columns:
                continue
            about = {"job": job, "point": point, "replicate": replicate, "tensor": tensor}
            for name in ESTIMATORS:
                row = {**about, "estimator": name, "no_moduli": ""}
                try:
                    found = estimate(name, columns["time"], columns[series], summary["protocol"])
                    rows.append(row | asdict(found))
                except ValueError as error:
                    rows.append(row | {"no_moduli": str(error)})
    own = {"storage_modulus": "storage", "loss_modulus": "loss"}
    names = [column.name for column in tables.HISTORICAL]
    records = [[row.get(own.get(name, name)) for name in names] for row in rows]
    types = {"Pa": "float64", "Pa/s": "float64", "1": "Int64", "": "str"}
    kinds = {column.name: types[column.unit] for column in tables.HISTORICAL}
    return frame(pd.DataFrame(records, columns=names).astype(kinds), tables.HISTORICAL)
