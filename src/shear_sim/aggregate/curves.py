"""Tables with a row per point, with intervals: ``curves`` (oscillatory shear), and plain means."""

from collections.abc import Callable, Collection, Mapping, Sequence
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.aggregate import columns as tables
from shear_sim.aggregate.ensemble import Ensemble, Replicates
from shear_sim.aggregate.frame import beside, frame
from shear_sim.aggregate.response import MAY_BE_LOGARITHMIC, contributions, curve_quantities
from shear_sim.aggregate.runs import Waves
from shear_sim.models.interface import Column
from shear_sim.statistics import LEVEL, RESAMPLES, Interval, intervals

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]
#: From the means of what each run contributes, and facts (P,) that are the same for all
#: runs of a point, to the quantities (P, Q, K) of P points.
Quantities = Callable[..., FloatArray]

STEADY_QUANTITIES = (tables.STEADY[0][0], tables.STEADY[2][0], tables.STEADY[5][0])
_TOGETHER = 16  # points resampled in one call: 5,000 resamples of 19 means take 12 MB


def curves_table(
    planned: "pd.DataFrame",
    runs: "pd.DataFrame",
    parameters: Sequence[Column],
    waves: Waves,
    *,
    tensor: str = "periodic",
    failed: Collection[str] = (),
    seed: int,
) -> "pd.DataFrame":
    """Return one row per point of the plan: the mean response, with intervals.

    Parameters
    ----------
    planned, runs, parameters, waves, tensor
        The plan, `shear_sim.aggregate.runs.runs_table` of it, and what that was made of.
    failed : collection of str
        Ids of the jobs that failed.
    seed : int
        Of the bootstrap.
    """
    rows = waves.rows(runs["job"])
    values = contributions(waves.storage_n[rows], waves.loss_n[rows], waves.peak_stress[rows])
    facts = waves.strain_amplitude[rows], waves.angular_frequency[rows]
    moduli = {column.name for column in tables.MODULI}
    own = [
        name if (name := f"{column.name}{tables.TENSORS[tensor]}") in moduli else column.name
        for column in tables.CURVE_QUANTITIES
    ]
    usable, quantities = _groups(runs, np.isfinite(values[:, 0])), tables.CURVE_QUANTITIES
    found = _intervals(
        usable, values, facts, _values(runs, own), MAY_BE_LOGARITHMIC, curve_quantities, seed
    )
    estimates = [
        {point: (usable[point], each[q]) for point, each in found.items()}
        for q in range(len(quantities))
    ]
    return _points_table(
        planned, runs, parameters, quantities, own, estimates, failed=failed, seed=seed
    )


def means_table(
    planned: "pd.DataFrame",
    runs: "pd.DataFrame",
    parameters: Sequence[Column],
    quantities: Sequence[Column],
    *,
    failed: Collection[str] = (),
    seed: int,
) -> "pd.DataFrame":
    """Return one row per point of the plan: means over the runs, with intervals.

    Parameters
    ----------
    planned, runs, parameters, failed, seed
        See `curves_table`.
    quantities : sequence of Column
        Columns of ``runs`` to average, each over the runs that have a value: one that jams has no
        mean flow, and one that does not jam has no rattlers.
    """
    own = [column.name for column in quantities]
    estimates = []
    for value in _values(runs, own).T[:, :, None]:
        usable = _groups(runs, np.isfinite(value[:, 0]))
        found = _intervals(
            usable, value, (), value, np.ones(1, dtype=bool), lambda means: means.values, seed
        )
        estimates.append({point: (usable[point], each[0]) for point, each in found.items()})
    return _points_table(
        planned, runs, parameters, quantities, own, estimates, failed=failed, seed=seed
    )


def _points_table(
    planned: "pd.DataFrame",
    runs: "pd.DataFrame",
    parameters: Sequence[Column],
    quantities: Sequence[Column],
    own_names: Sequence[str],
    estimates: Sequence[Mapping[str, tuple[NDArray[np.intp], Interval]]],
    *,
    failed: Collection[str],
    seed: int,
) -> "pd.DataFrame":
    """Return one row per point.

    ``own_names`` are the columns of ``runs`` with the runs' own quantities; ``estimates`` holds, of
    each quantity and by point, the rows of ``runs`` with a value and what follows from them.
    """
    points = planned.drop_duplicates("point").reset_index(drop=True)
    failures = planned["job"].isin(set(failed)).groupby(planned["point"]).sum()
    counts = planned["point"].value_counts()
    groups = _groups(runs, np.ones(len(runs), dtype=bool))
    no_rows, nothing = np.empty(0, dtype=np.intp), Interval(nan, nan, nan, "none", 0, None)
    known = [[each.get(p, (no_rows, nothing)) for p in points["point"]] for each in estimates]
    n = [
        len(np.unique(np.concatenate([no_rows, *[rows for rows, _ in of_point]])))
        for of_point in zip(*known, strict=True)
    ]
    data: dict[str, Any] = {
        "replicates": [len(groups.get(p, ())) for p in points["point"]],
        "planned": points["point"].map(counts),
        "failed": points["point"].map(failures),
        "flagged": points["point"]
        .map(runs.groupby("point")["flagged"].sum())
        .fillna(0)
        .astype(int),
        "n": n,
    }
    own = _values(runs, own_names)
    for q, (column, of_quantity) in enumerate(zip(quantities, known, strict=True)):
        own_values = [own[rows, q][np.isfinite(own[rows, q])] for rows, _ in of_quantity]
        each = [interval for _, interval in of_quantity]
        data |= {
            f"{column.name}_mean": [i.estimate for i in each],
            f"{column.name}_median": [np.median(v) if len(v) else nan for v in own_values],
            f"{column.name}_sd": [v.std(ddof=1) if len(v) > 1 else nan for v in own_values],
            f"{column.name}_ci_low": [i.low for i in each],
            f"{column.name}_ci_high": [i.high for i in each],
            f"{column.name}_ci_method": [i.method for i in each],
            f"{column.name}_ci_flag": [
                _flag(i, len(rows), of) for (rows, i), of in zip(of_quantity, n, strict=True)
            ],
        }
    data |= {"ci_level": LEVEL, "ci_resamples": RESAMPLES, "ci_seed": seed}
    names = [
        *tables.LABELS,
        *parameters,
        *tables.COUNTS,
        *[column for quantity in quantities for column in tables.statistics_of(quantity)],
        *tables.INTERVALS,
    ]
    keys = ["scene", *[parameter.name for parameter in parameters]]
    return frame(beside(points, data), names, keys)


def _flag(interval: Interval, count: int, n: int) -> str:
    """Return what weakens an interval over ``count`` of the ``n`` runs that have any result."""
    few = f"only {count} of {n} runs have a value" if 0 < count < n else None
    return "; ".join(filter(None, (few, interval.flag)))


def _values(runs: "pd.DataFrame", names: Sequence[str]) -> FloatArray:
    """Return columns (R, len(names)); nan where there is no such column."""
    known = [runs[name] if name in runs else np.full(len(runs), np.nan) for name in names]
    return np.column_stack(known).astype(np.float64)


def _groups(runs: "pd.DataFrame", which: NDArray[np.bool_]) -> dict[str, NDArray[np.intp]]:
    """Return the rows of each point, by replicate: equal draws are then equal packings."""
    order = np.flatnonzero(which)[np.argsort(runs["replicate"].to_numpy()[which], kind="stable")]
    points = runs["point"].to_numpy()[order]
    groups: dict[str, list[int]] = {}
    for row, point in zip(order.tolist(), points.tolist(), strict=True):
        groups.setdefault(point, []).append(row)
    return {point: np.array(rows, dtype=np.intp) for point, rows in groups.items()}


def _intervals(
    groups: dict[str, NDArray[np.intp]],
    values: FloatArray,
    facts: Sequence[FloatArray],
    own: FloatArray,
    logarithmic: NDArray[np.bool_],
    derive: Quantities,
    seed: int,
) -> dict[str, list[Interval]]:
    """Return the intervals of each point; points of as many runs share one bootstrap.

    ``values`` (R, C) is what is averaged, and ``facts`` what is needed beside it, of each row of
    ``runs``. Where ``logarithmic`` (Q,), the logarithm of a quantity may be taken if all its
    ``own`` (R, Q) are positive.
    """
    quantities = len(logarithmic)
    by_size: dict[int, list[str]] = {}
    for point, rows in groups.items():
        by_size.setdefault(len(rows), []).append(point)
    found = {}
    for size, points in by_size.items():
        for start in range(0, len(points), _TOGETHER):
            some = points[start : start + _TOGETHER]
            rows = np.array([groups[point] for point in some])
            replicates = [Replicates(np.arange(size), values[r]) for r in rows]
            ensemble, first = Ensemble(replicates, paired=True), [f[rows[:, 0]] for f in facts]

            def statistic(
                counts: Sequence[FloatArray],
                ensemble: Ensemble = ensemble,
                first: Sequence[FloatArray] = first,
            ) -> FloatArray:
                derived = derive(ensemble.means(counts), *first)
                return derived.reshape(-1, derived.shape[-1])

            # Nan where a run has no value of its own: its logarithm is not taken either.
            positive = ((own[rows] > 0).all(axis=1) & logarithmic).ravel()
            flat = intervals(statistic, ensemble.sizes, positive=positive, seed=seed)
            for place, point in enumerate(some):
                found[point] = flat[place * quantities : (place + 1) * quantities]
    return found
