"""Tables with a row per point: ``curves`` (oscillatory shear) and ``steady``, with intervals."""

import math
from collections.abc import Callable, Collection, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.aggregate import columns as tables
from shear_sim.aggregate.ensemble import Ensemble, Replicates
from shear_sim.aggregate.frame import frame
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
    return _points_table(
        planned,
        runs,
        parameters,
        tables.CURVE_QUANTITIES,
        own,
        values,
        facts,
        MAY_BE_LOGARITHMIC,
        curve_quantities,
        failed=failed,
        seed=seed,
    )


def steady_table(
    planned: "pd.DataFrame",
    runs: "pd.DataFrame",
    parameters: Sequence[Column],
    *,
    failed: Collection[str] = (),
    seed: int,
) -> "pd.DataFrame":
    """Return one row per point of the plan in steady shear: means over the runs, with intervals.

    Parameters are those of `curves_table`.
    """
    own = [column.name for column in STEADY_QUANTITIES]
    return _points_table(
        planned,
        runs,
        parameters,
        STEADY_QUANTITIES,
        own,
        _values(runs, own),
        (),
        np.ones(len(own), dtype=bool),
        lambda means: means.values,
        failed=failed,
        seed=seed,
    )


def _points_table(
    planned: "pd.DataFrame",
    runs: "pd.DataFrame",
    parameters: Sequence[Column],
    quantities: Sequence[Column],
    own_names: Sequence[str],
    values: FloatArray,
    facts: Sequence[FloatArray],
    logarithmic: NDArray[np.bool_],
    derive: Quantities,
    *,
    failed: Collection[str],
    seed: int,
) -> "pd.DataFrame":
    """Return one row per point.

    ``own_names`` are the columns of ``runs`` with the runs' own quantities; ``values`` (R, C) is
    what is averaged, and ``facts`` what is needed beside it, of each row of ``runs``. Where
    ``logarithmic`` (Q,), the logarithm of a quantity may be taken if all its own are positive.
    """
    points = planned.drop_duplicates("point").reset_index(drop=True)
    failures = planned["job"].isin(set(failed)).groupby(planned["point"]).sum()
    counts = planned["point"].value_counts()
    known = np.isfinite(values[:, 0])
    groups = _groups(runs, np.ones(len(runs), dtype=bool))
    usable = _groups(runs, known)
    data: dict[str, Any] = {
        "replicates": [len(groups.get(p, ())) for p in points["point"]],
        "planned": points["point"].map(counts),
        "failed": points["point"].map(failures),
        "flagged": points["point"]
        .map(runs.groupby("point")["flagged"].sum())
        .fillna(0)
        .astype(int),
        "n": [len(usable.get(p, ())) for p in points["point"]],
    }
    own = _values(runs, own_names)
    found = _intervals(usable, values, facts, own, logarithmic, derive, seed)
    nothing = [Interval(math.nan, math.nan, math.nan, "none", 0, None)] * len(quantities)
    rows = [usable.get(point, np.empty(0, dtype=np.intp)) for point in points["point"]]
    each = [found.get(point, nothing) for point in points["point"]]
    for q, column in enumerate(quantities):
        own_values = [own[r, q][np.isfinite(own[r, q])] for r in rows]
        data |= {
            f"{column.name}_mean": [i[q].estimate for i in each],
            f"{column.name}_median": [np.median(v) if len(v) else math.nan for v in own_values],
            f"{column.name}_sd": [v.std(ddof=1) if len(v) > 1 else math.nan for v in own_values],
            f"{column.name}_ci_low": [i[q].low for i in each],
            f"{column.name}_ci_high": [i[q].high for i in each],
            f"{column.name}_ci_method": [i[q].method for i in each],
            f"{column.name}_ci_flag": [i[q].flag or "" for i in each],
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
    return frame(points.assign(**data), names, keys)


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
    """Return the intervals of each point; points of as many runs share one bootstrap."""
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
