"""The quality of every run: each measure against the strain amplitude, with its limits."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from shear_sim.figures import style
from shear_sim.figures.style import FloatArray
from shear_sim.rheology import JUMP, LIMITS
from shear_sim.variation import AMPLITUDE, by_scene

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Columns of table ``runs`` that are drawn, with their titles.
MEASURES = {
    "surface_internal_ratio": "$|G^*|$ of the surface / internal",
    "cycle_change": "change of $|G^*|$ over the last period",
    "drift_ratio": "drift over a period / stress amplitude",
    "baseline_noise": "noise at rest / stress amplitude",
    "largest_jump": "largest jump / range of the stress",
    "asymmetry": "asymmetry of the stress tensor",
}
_LIMITS = LIMITS | {"largest_jump": (0.0, JUMP)}
_AROUND_ONE = "surface_internal_ratio"  # on a linear axis
_FEW = 200  # runs of a scene, below which their points are larger
_LEAST = 1e-17  # where zeros stand on a logarithmic axis


def has_quality(runs: "pd.DataFrame") -> bool:
    """Whether any run has a value of any measure."""
    return any(name in runs and runs[name].notna().any() for name in MEASURES)


def quality(runs: "pd.DataFrame") -> "Figure":
    """Draw quality measures of all runs, a panel each, against the strain amplitude.

    Where the strain amplitude does not vary, the runs stand side by side in a column per scene.
    Beyond the limits panels are shaded, and their titles count the runs there.

    Parameters
    ----------
    runs : DataFrame
        Table ``runs`` of a study.

    Raises
    ------
    ValueError
        If no run has a value of any measure.
    """
    measures = [name for name in MEASURES if name in runs and runs[name].notna().any()]
    if not measures:
        msg = "no run has a value of any measure of quality"
        raise ValueError(msg)
    table = by_scene(runs)
    scenes = list(dict.fromkeys(table["scene"]))
    along = AMPLITUDE in runs and runs[AMPLITUDE].nunique() > 1
    rows = math.ceil(len(measures) / 3)
    across = math.ceil(len(measures) / rows)
    with style.figure(style.WIDTHS.get(across, style.DOUBLE), 1.85 * rows + 0.9) as figure:
        axes = figure.subplots(rows, across, squeeze=False, sharex=True).flatten()
        for spare in axes[len(measures) :]:
            spare.remove()
        if along:
            style.scale_x(axes[0], runs[AMPLITUDE])
        else:
            axes[0].set_xticks([])
        for place, (axis, name) in enumerate(zip(axes, measures, strict=False)):
            for turn, scene in enumerate(scenes):
                of_scene = table[table["scene"] == scene]
                at = _places(of_scene, turn, len(scenes), along=along)
                _points(axis, at, of_scene[name].to_numpy(np.float64), turn)
            _scale(axis, runs[name], _LIMITS[name])
            count = _count(runs[name], _LIMITS[name])
            axis.set_title(f"{MEASURES[name]}\n{count}", fontsize=style.SMALL + 0.5)
            axis.tick_params(labelbottom=along and place + across >= len(measures))
            if along and place + across >= len(measures):
                axis.set_xlabel(style.label(runs, AMPLITUDE))
        _explain(figure, scenes)
        style.note(figure, f"{len(runs):,} runs, a point each", style.partial_note(runs))
    return figure


def _places(runs: "pd.DataFrame", turn: int, turns: int, *, along: bool) -> FloatArray:
    """Return where runs stand on the axis: scenes beside one another, replicates apart."""
    spread = runs["replicate"].to_numpy(np.float64)
    spread = spread / (spread.max() + 1.0) - 0.5 if len(spread) else spread
    if not along:
        return turn + 0.8 * spread
    # A tenth of a decade for all scenes: no amplitudes of a study are nearer than that.
    aside = 0.1 * ((turn + 0.5 + 0.7 * spread) / turns - 0.5)
    return np.asarray(runs[AMPLITUDE].to_numpy(np.float64) * 10.0**aside)


def _points(axis: "Axes", at: FloatArray, values: FloatArray, turn: int) -> None:
    axis.plot(
        at, np.where(values == 0.0, _LEAST, values), linestyle="none",
        markersize=3.5 if len(values) < _FEW else 1.8,
        marker=style.MARKERS[turn % len(style.MARKERS)], markeredgewidth=0,
        color=style.UNORDERED[turn % len(style.UNORDERED)], alpha=0.55, rasterized=True,
    )  # fmt: skip


def _scale(axis: "Axes", values: "pd.Series[Any]", limits: tuple[float, float]) -> None:
    """Scale the axis and shade what is beyond the limits."""
    wide = values.name != _AROUND_ONE
    ends = [float(values.min()), float(values.max())]
    finite = [end for end in limits if end > 0 or not wide]
    low, high = min(ends + finite), max(ends + finite)
    if wide:
        axis.set_yscale("log")
        low, high = max(low, _LEAST) / 3, 3 * max(high, _LEAST)
        style.log_ticks(axis.yaxis, low, high)
    else:
        room = 0.1 * (high - low) or 0.1
        low, high = low - room, high + room
    for end in finite:
        beyond = high if end == limits[1] else low
        axis.axhspan(end, beyond, color="0.93", zorder=0, linewidth=0)
        axis.axhline(end, color="0.4", linewidth=0.7, linestyle="--", zorder=1)
    axis.set_ylim(low, high)


def _count(values: "pd.Series[Any]", limits: tuple[float, float]) -> str:
    """Return how many runs are beyond the limits."""
    known = values.dropna()
    beyond = int(((known < limits[0]) | (known > limits[1])).sum())
    return f"{beyond:,} of {len(known):,} runs beyond the limit"


def _explain(figure: "Figure", scenes: "list[Any]") -> None:
    from matplotlib.lines import Line2D

    if len(scenes) == 1:
        return
    handles = [
        Line2D(
            [], [], linestyle="none", label=style.words(str(scene)),
            marker=style.MARKERS[turn % len(style.MARKERS)],
            color=style.UNORDERED[turn % len(style.UNORDERED)],
        )
        for turn, scene in enumerate(scenes)
    ]  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(scenes), 6))
