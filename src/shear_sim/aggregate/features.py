"""Table ``features``: the landmarks of every curve, recomputed in every resample."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.aggregate import columns as tables
from shear_sim.aggregate.ensemble import Ensemble, Replicates
from shear_sim.aggregate.frame import frame
from shear_sim.aggregate.response import (
    OF_LANDMARKS,
    Means,
    contributions,
    third_harmonic_ratio,
)
from shear_sim.aggregate.runs import Waves
from shear_sim.landmarks import Landmark, landmarks
from shear_sim.models.interface import Column
from shear_sim.statistics import LEVEL, RESAMPLES, Interval, intervals
from shear_sim.variation import AMPLITUDE

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

FEWEST_AMPLITUDES = 3  # of a curve with landmarks
#: Landmarks that hang on G' at the smallest amplitude.
OF_PLATEAU = ("low_strain_plateau", "softening", "half_loss")


class Curve(NamedTuple):
    """The runs of a curve, by strain amplitude."""

    amplitudes: FloatArray  # (P,), increasing
    points: list[Replicates]  # each with the contributions `OF_LANDMARKS`
    planned: int  # runs at each amplitude, by the plan


def find_curves(planned: "pd.DataFrame", runs: "pd.DataFrame", waves: Waves) -> dict[str, Curve]:
    """Return the curves of a study that have runs, by id.

    Parameters
    ----------
    planned, runs, waves
        The plan, `shear_sim.aggregate.runs.runs_table` of it, and their harmonics.
    """
    rows = waves.rows(runs["job"])
    values = contributions(waves.storage_n[rows], waves.loss_n[rows], waves.peak_stress[rows])
    values = values[:, OF_LANDMARKS]
    known = np.isfinite(values[:, 0])
    if AMPLITUDE not in runs:
        return {}
    each = planned.groupby(["curve", "point"]).size().groupby(level="curve").max()
    groups: dict[str, dict[float, list[int]]] = {}
    columns = runs["curve"].to_list(), runs[AMPLITUDE].to_list()
    for row, (curve, amplitude) in enumerate(zip(*columns, strict=True)):
        if known[row]:
            groups.setdefault(curve, {}).setdefault(amplitude, []).append(row)
    number = runs["replicate"].to_numpy()
    return {
        curve: Curve(
            np.array(sorted(of)),
            [Replicates(number[of[a]], values[of[a]]) for a in sorted(of)],
            int(each[curve]),
        )
        for curve, of in groups.items()
    }


def of_means(amplitudes: FloatArray, means: Means) -> dict[str, Landmark]:
    """Return the landmarks of the means of what each run contributes, at `OF_LANDMARKS`."""
    storage, loss = means.values[:, 0], means.values[:, 1]
    return landmarks(amplitudes, storage, loss, third_harmonic_ratio(means))


def quantities(landmark: Landmark) -> dict[str, FloatArray]:
    """Return `FEATURE_QUANTITIES` of a landmark, each (K,)."""
    with np.errstate(invalid="ignore"):
        stress = np.hypot(landmark.storage, landmark.loss) * landmark.strain
    return {
        "strain": landmark.strain,
        "storage_modulus": landmark.storage,
        "loss_modulus": landmark.loss,
        "total_stress": stress,
    }


def features_table(
    planned: "pd.DataFrame",
    parameters: Sequence[Column],
    curves: Mapping[str, Curve],
    *,
    paired: bool,
    seed: int,
) -> "pd.DataFrame":
    """Return one row per curve of three amplitudes or more and landmark.

    Parameters
    ----------
    planned, parameters
        The plan and its varied parameters.
    curves : mapping
        See `find_curves`.
    paired : bool
        See `Ensemble`.
    seed : int
        Of the bootstrap.
    """
    import pandas as pd

    kept = [parameter for parameter in parameters if parameter.name != AMPLITUDE]
    identity = planned.drop_duplicates("curve").set_index("curve", drop=False)
    rows: list[dict[str, Any]] = []
    for curve in identity.index:
        found = curves.get(curve)
        if found is None or len(found.amplitudes) < FEWEST_AMPLITUDES:
            continue
        ensemble = Ensemble(found.points, paired=paired)
        about = {name: identity.loc[curve, name] for name in ("curve", "scene")} | {
            parameter.name: identity.loc[curve, parameter.name] for parameter in kept
        }
        about |= {
            "replicates": ensemble.n,
            "planned": found.planned,
            "amplitudes": len(found.amplitudes),
        }
        of_curve = landmark_intervals(found, ensemble, seed=seed)
        about |= {"ci_level": LEVEL, "ci_resamples": RESAMPLES, "ci_seed": seed}
        late = late_plateau(float(found.amplitudes[0]), curves)
        rows += [about | _row(name, found, of_curve, late) for name in tables.LANDMARKS]
    columns = [
        *tables.FEATURES[:2],
        *kept,
        *tables.FEATURES[2:6],
        *[c for quantity in tables.FEATURE_QUANTITIES for c in _columns(quantity)],
        *tables.FEATURES[6:],
    ]
    names = [column.name for column in columns]
    data = pd.DataFrame(rows, columns=names).astype({"scene": planned["scene"].dtype})
    if not rows:  # types do not depend on whether there is anything yet
        types = {c.name: "float64" if c.unit else "str" for c in columns if c.name != "scene"}
        data = data.astype(types)
    return frame(data, columns, ["scene", *[parameter.name for parameter in kept]])


def landmark_intervals(
    curve: Curve, ensemble: Ensemble, *, seed: int, resamples: int = RESAMPLES
) -> dict[str, dict[str, Interval]]:
    """Return the interval of each quantity of each landmark of a curve.

    Parameters
    ----------
    curve : Curve
        Three amplitudes or more.
    ensemble : Ensemble
        Of the points of the curve.
    seed, resamples : int
        Of the bootstrap.

    Returns
    -------
    dict of dict
        By landmark, then by `FEATURE_QUANTITIES`; strains beyond the amplitudes are infinite.
    """
    keys = [(name, c.name) for name in tables.LANDMARKS for c in tables.FEATURE_QUANTITIES]

    def statistic(counts: Sequence[FloatArray]) -> FloatArray:
        found = of_means(curve.amplitudes, ensemble.means(counts))
        values = {name: quantities(landmark) for name, landmark in found.items()}
        return np.array([values[name][quantity] for name, quantity in keys])

    found = intervals(statistic, ensemble.sizes, n=ensemble.n, resamples=resamples, seed=seed)
    nested: dict[str, dict[str, Interval]] = {name: {} for name in tables.LANDMARKS}
    for (name, quantity), one in zip(keys, found, strict=True):
        nested[name][quantity] = one
    return nested


def late_plateau(begin: float, curves: Mapping[str, Curve]) -> str:
    """Return the flag of a plateau read at a larger amplitude than those of other curves, or ""."""
    least = min(float(curve.amplitudes[0]) for curve in curves.values())
    return f"plateau read at {begin:g}, others from {least:g} on" if begin > least else ""


def _row(
    name: str, curve: Curve, of: Mapping[str, Mapping[str, Interval]], late: str = ""
) -> dict[str, Any]:
    """Return what ``features`` says of one landmark."""
    found, strain = of[name], of[name]["strain"]
    smallest, largest = float(curve.amplitudes[0]), float(curve.amplitudes[-1])
    censored, limit = "", math.nan
    if math.isnan(strain.estimate):
        censored = "absent"
    elif math.isinf(strain.estimate):
        above = strain.estimate > 0
        censored, limit = ("above", largest) if above else ("below", smallest)
    row: dict[str, Any] = {
        "landmark": name,
        "censored": censored,
        "strain_limit": limit,
        "censored_resamples": strain.undefined,
        "strain_before": math.nan,
        "strain_after": math.nan,
    }
    if not censored:
        after = int(np.searchsorted(curve.amplitudes, strain.estimate, side="right"))
        row["strain_before"] = float(curve.amplitudes[after - 1])
        row["strain_after"] = float(curve.amplitudes[min(after, len(curve.amplitudes) - 1)])
    for quantity, one in found.items():
        row |= {
            quantity: one.estimate if math.isfinite(one.estimate) else math.nan,
            f"{quantity}_ci_low": one.low,
            f"{quantity}_ci_high": one.high,
            f"{quantity}_ci_method": one.method,
            f"{quantity}_ci_flag": one.flag or "",
        }
    if name in OF_PLATEAU and of["softening"]["strain"].estimate < curve.amplitudes[1]:
        for quantity in found:
            flags = [row[f"{quantity}_ci_flag"], "no plateau: G' softens before the 2nd amplitude"]
            row[f"{quantity}_ci_flag"] = "; ".join(filter(None, flags))
    if name in OF_PLATEAU and late:
        for quantity in found:
            flags = [row[f"{quantity}_ci_flag"], late]
            row[f"{quantity}_ci_flag"] = "; ".join(filter(None, flags))
    # An end beyond the amplitudes is known to lie there, and no better.
    low, high = row["strain_ci_low"], row["strain_ci_high"]
    if not censored and strain.method in {"t", "t_log"}:
        beyond = [low < smallest, high > largest]
        if any(beyond):
            flags = [row["strain_ci_flag"], "cut at the smallest or largest amplitude"]
            row["strain_ci_flag"] = "; ".join(filter(None, flags))
        low, high = max(low, smallest), min(high, largest)
    row["strain_ci_low"] = {math.inf: largest, -math.inf: 0.0}.get(low, low)
    row["strain_ci_high"] = {-math.inf: smallest}.get(high, high)
    return row


def _columns(quantity: Column) -> list[Column]:
    name, unit, text = quantity
    return [
        quantity,
        Column(f"{name}_ci_low", unit, f"lower bound of the interval of: {text}"),
        Column(f"{name}_ci_high", unit, f"upper bound of the interval of: {text}"),
        Column(f"{name}_ci_method", "", "BCa, percentile, t, t_log, equal or none"),
        Column(f"{name}_ci_flag", "", "what weakens the interval; empty: nothing"),
    ]
