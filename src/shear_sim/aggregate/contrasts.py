"""Table ``contrasts``: what differs between curves, by how much, and how surely.

Of scenes, the first of the study file is compared with each other one. Of parameters that vary
within a scene, numbers give slopes, and words are compared with the scene's most frequent one. All
else is equal in a comparison; curves are compared over the strain amplitudes that all of them have,
with landmarks found anew on those.

Every effect is a difference of logarithms, so that it has no unit: a ratio, an exponent
d ln y/d ln x (of x > 0 over a wide range, or with a unit) or a slope d ln y/d x. Slopes weigh all
values of x equally; their intervals say how well they are known over the packings, not how straight
the line is. In a random design no two points differ in one thing alone, and nothing is compared.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim.aggregate import columns as tables
from shear_sim.aggregate.ensemble import Ensemble
from shear_sim.aggregate.features import (
    FEWEST_AMPLITUDES,
    OF_PLATEAU,
    Curve,
    late_plateau,
    of_means,
    quantities,
)
from shear_sim.aggregate.frame import frame
from shear_sim.aggregate.response import Means
from shear_sim.models.interface import Column
from shear_sim.statistics import LEVEL, RESAMPLES, Interval, holm, intervals
from shear_sim.variation import AMPLITUDE, by_scene, variation

if TYPE_CHECKING:
    import pandas as pd

FloatArray = NDArray[np.float64]

#: What is compared of each landmark.
COMPARED = {
    "low_strain_plateau": ("storage_modulus", "loss_modulus"),
    "softening": ("strain",),
    "half_loss": ("strain",),
    "loss_peak": ("strain", "loss_modulus"),
    "soft_plateau": ("strain", "storage_modulus"),
    "yield": ("strain", "storage_modulus", "total_stress"),
    "nonlinearity_onset": ("strain",),
}
_MODULI = ("storage_modulus", "loss_modulus")
_ROUNDING = 1e-9  # relative differences below are rounding, whatever their interval
# Largest / smallest value from which a parameter is taken by its logarithm; zeros are left out.
_WIDE, _WIDE_WITHOUT_ZERO = 8.0, 100.0


class Comparison(NamedTuple):
    """Curves that differ in one thing."""

    parameter: str
    scene: str
    curves: tuple[str, ...]
    held: dict[str, Any]  # the other varied parameters
    against: str
    values: str
    effect: str
    weights: FloatArray  # (curves,): the effect is the sum of weights times ln y


def contrasts_table(
    planned: "pd.DataFrame",
    parameters: Sequence[Column],
    curves: Mapping[str, Curve],
    *,
    paired: bool,
    seed: int,
) -> "pd.DataFrame":
    """Return one row per comparison and quantity.

    Parameters are those of `shear_sim.aggregate.features.features_table`.
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for comparison in find_comparisons(planned, parameters):
        if all(curve in curves for curve in comparison.curves):
            of = [curves[curve] for curve in comparison.curves]
            found = compare(comparison, of, paired=paired, seed=seed)
            common = set.intersection(*[set(curve.amplitudes.tolist()) for curve in of])
            late = late_plateau(min(common, default=0.0), curves)
            for row in found:
                if late and row["landmark"] in OF_PLATEAU:
                    row["ci_flag"] = "; ".join(filter(None, (row["ci_flag"], late)))
            rows += found
    columns = [*tables.CONTRASTS[:2], *parameters, *tables.CONTRASTS[2:]]
    names = [column.name for column in columns]
    data = pd.DataFrame(rows, columns=names)
    if rows:
        data["p_holm"] = data.groupby("family")["p"].transform(lambda p: holm(p.to_numpy()))
    types = {c.name: "float64" if c.unit else "str" for c in columns}
    whole = ("replicates", "planned", "ci_resamples", "ci_seed")
    data = data.astype(types | dict.fromkeys(whole, "int64"))
    return frame(data, columns)


def find_comparisons(planned: "pd.DataFrame", parameters: Sequence[Column]) -> Iterator[Comparison]:
    """Yield what a study allows to compare: scenes first, then parameter by parameter."""
    keys = [parameter.name for parameter in parameters if parameter.name != AMPLITUDE]
    points = planned.drop_duplicates("point").sort_values(["scene", *keys], kind="stable")
    reference = variation(points).reference
    table = by_scene(points.drop_duplicates("curve"))[["curve", "scene", *keys]]
    table = table.astype(object).where(table.notna(), None)  # None is equal to itself, nan is not
    of: dict[str, list[dict[str, Any]]] = {}
    for values in table.itertuples(index=False, name=None):
        row = dict(zip(["curve", "scene", *keys], values, strict=True))
        of.setdefault(row["scene"], []).append(row)
    scenes = list(of)
    for other in scenes[1:]:
        yield from _scenes(scenes[0], other, of, keys, reference[scenes[0]])
    for parameter in parameters:
        if parameter.name == AMPLITUDE:
            continue
        for scene in scenes:
            if len({row[parameter.name] for row in of[scene]} - {None}) < 2:
                continue
            others = [key for key in keys if key != parameter.name]
            if points[parameter.name].dtype.kind in "if":
                yield from _slopes(scene, of[scene], parameter, others)
            else:
                usual = reference[scene].get(parameter.name)
                yield from _words(scene, of[scene], parameter.name, others, usual)


def _scenes(
    first: str,
    other: str,
    of: Mapping[str, Sequence[Mapping[str, Any]]],
    keys: Sequence[str],
    reference: Mapping[str, Any],
) -> Iterator[Comparison]:
    """Compare a scene with another: curves equal in all but what tells the scenes apart."""
    values = [{key: {row[key] for row in of[scene]} for key in keys} for scene in (first, other)]
    apart = [key for key in keys if not values[0][key] & values[1][key]]
    equal = [key for key in keys if key not in apart]
    matches: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in of[other]:
        matches.setdefault(tuple(row[key] for key in equal), []).append(row)
    for row in of[first]:
        if any(row[key] != reference.get(key, row[key]) for key in apart):
            continue
        for match in matches.get(tuple(row[key] for key in equal), []):
            if row["curve"] != match["curve"]:
                yield Comparison(
                    "scene",
                    first,
                    (row["curve"], match["curve"]),
                    {key: row[key] for key in equal},
                    other,
                    f"{first}; {other}",
                    "ratio",
                    np.array([1.0, -1.0]),
                )


def _slopes(
    scene: str, rows: Sequence[Mapping[str, Any]], parameter: Column, others: Sequence[str]
) -> Iterator[Comparison]:
    """Fit lines to curves that differ in a parameter that is a number."""
    key = parameter.name
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        if row[key] is not None:
            groups.setdefault(tuple(row[other] for other in others), []).append(row)
    for found in groups.values():
        group = sorted(found, key=lambda row: float(row[key]))
        x = np.array([float(row[key]) for row in group])
        positive = x[x > 0]
        span = positive[-1] / positive[0] if len(positive) else 1.0
        wide = span >= (_WIDE if x[0] > 0 else _WIDE_WITHOUT_ZERO)
        logarithmic = x[0] >= 0 and len(positive) > 1 and (wide or parameter.unit != "1")
        if logarithmic:
            group, x = group[-len(positive) :], np.log(positive)
        if len(x) < 2:
            continue
        aside = x - x.mean()
        yield Comparison(
            key,
            scene,
            tuple(row["curve"] for row in group),
            {other: group[0][other] for other in others},
            "",
            "; ".join(f"{row[key]:g}" for row in group),
            "exponent" if logarithmic else "slope",
            aside / (aside**2).sum(),
        )


def _words(
    scene: str,
    rows: Sequence[Mapping[str, Any]],
    key: str,
    others: Sequence[str],
    usual: Any,
) -> Iterator[Comparison]:
    """Compare curves that differ in a parameter that is a word with those of the usual word."""
    for row in rows:
        for match in rows:
            if row[key] == usual or match[key] != usual:
                continue
            # A parameter that one of the two does not have (a plateau's ends) cannot differ.
            pairs = [(row[other], match[other]) for other in others]
            if all(a == b or a is None or b is None for a, b in pairs):
                yield Comparison(
                    key,
                    scene,
                    (row["curve"], match["curve"]),
                    {other: row[other] for other in others},
                    str(usual),
                    f"{row[key]}; {usual}",
                    "ratio",
                    np.array([1.0, -1.0]),
                )


def compare(
    comparison: Comparison,
    curves: Sequence[Curve],
    *,
    paired: bool,
    seed: int,
    resamples: int = RESAMPLES,
) -> list[dict[str, Any]]:
    """Return the rows of one comparison: landmarks, then moduli at each common amplitude.

    Parameters
    ----------
    comparison : Comparison
        What is compared.
    curves : sequence of Curve
        Its curves.
    paired : bool
        See `Ensemble`.
    seed, resamples : int
        Of the bootstrap.
    """
    common = sorted(set.intersection(*[set(curve.amplitudes.tolist()) for curve in curves]))
    if not common:
        return []
    amplitudes = np.array(common)
    points = [
        curve.points[place]
        for curve in curves
        for place in np.searchsorted(curve.amplitudes, amplitudes).tolist()
    ]
    ensemble = Ensemble(points, paired=paired)
    named = [(n, q, math.nan) for n, compared in COMPARED.items() for q in compared]
    found = named if len(common) >= FEWEST_AMPLITUDES else []
    keys = [*found, *[("", q, a) for a in common for q in _MODULI]]

    def logarithms(counts: Sequence[FloatArray]) -> FloatArray:
        """Return ln y (curves, keys, K); nan where y is censored or not positive."""
        means = ensemble.means(counts)
        each = [slice(k, k + len(common)) for k in range(0, len(points), len(common))]
        of = [Means(means.values[which], means.drawn[which]) for which in each]
        y = np.array([_values(amplitudes, of_curve, keys) for of_curve in of])
        usable = np.isfinite(y) & (y > 0)
        return np.where(usable, np.log(np.where(usable, y, 1.0)), np.nan)

    def statistic(counts: Sequence[FloatArray]) -> FloatArray:
        effect = np.einsum("c,cqk->qk", comparison.weights, logarithms(counts))
        return np.where(np.abs(effect) < _ROUNDING, 0.0, effect)

    lost = np.isnan(logarithms([np.ones((1, size)) for size in ensemble.sizes])[..., 0])
    estimates = intervals(
        statistic,
        ensemble.sizes,
        n=ensemble.n,
        positive=np.zeros(len(keys), dtype=bool),
        resamples=resamples,
        seed=seed,
    )
    about = {
        "parameter": comparison.parameter,
        "scene": comparison.scene,
        "against": comparison.against,
        "values": comparison.values,
        "effect": comparison.effect,
        "replicates": ensemble.n,
        "planned": min(curve.planned for curve in curves),
        "ci_level": LEVEL,
        "ci_resamples": resamples,
        "ci_seed": seed,
        **comparison.held,
    }
    names = comparison.values.split("; ")
    return [
        about
        | {
            "landmark": landmark,
            "quantity": quantity,
            AMPLITUDE: amplitude,
            "family": f"{comparison.parameter}, {'landmarks' if landmark else 'amplitudes'}",
        }
        | _estimate(one, comparison.effect, [n for n, no in zip(names, gone, strict=True) if no])
        for (landmark, quantity, amplitude), one, gone in zip(keys, estimates, lost.T, strict=True)
        if not gone.all()  # a landmark that none of the curves has
    ]


def _values(
    amplitudes: FloatArray, means: Means, keys: Sequence[tuple[str, str, float]]
) -> FloatArray:
    """Return y (keys, K) of one curve."""
    found = of_means(amplitudes, means) if len(amplitudes) >= FEWEST_AMPLITUDES else {}
    of = {name: quantities(landmark) for name, landmark in found.items()}
    place = {amplitude: p for p, amplitude in enumerate(amplitudes.tolist())}
    return np.array(
        [
            of[landmark][quantity]
            if landmark
            else means.values[place[amplitude], _MODULI.index(quantity)]
            for landmark, quantity, amplitude in keys
        ]
    )


def _estimate(one: Interval, effect: str, lost: Sequence[str]) -> dict[str, Any]:
    """Return estimate, interval and p-value; ratios leave the logarithm."""
    ends = {"estimate": one.estimate, "ci_low": one.low, "ci_high": one.high}
    method, flag = one.method, one.flag
    if effect == "ratio":
        ends = {name: float(np.exp(value)) for name, value in ends.items()}
        method = "t_log" if method == "t" else method
    if lost:
        flag = f"beyond the amplitudes, absent or not positive at {', '.join(lost)}"
    return {**ends, "ci_method": method, "ci_flag": flag or "", "p": one.p_value()}
