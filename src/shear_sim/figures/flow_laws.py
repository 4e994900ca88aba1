"""Flow laws of dense suspensions: stress ratio, packing fraction and viscosity of steady shear.

Both ensembles, at fixed packing fraction and at fixed pressure, fall on the same lines where a
system has one flow law: μ(J) and φ(J) of the viscous number J = γ̇/(ξ₀ p) (Boyer, Guazzelli &
Pouliquen, Phys. Rev. Lett. 107 (2011) 188301).
"""

from typing import TYPE_CHECKING

import numpy as np

from shear_sim.figures import style
from shear_sim.variation import by_scene

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STRESS_RATIO, NUMBER = "friction_coefficient", "viscous_number"
PHI, VISCOSITY, PRESSURE = "mean_packing_fraction", "scaled_shear_stress", "scaled_pressure"
CONTACTS = "contact_number"
#: Panels: what is drawn against what.
PANELS = (
    (NUMBER, STRESS_RATIO),
    (NUMBER, PHI),
    (NUMBER, CONTACTS),
    (PHI, VISCOSITY),
    (PHI, PRESSURE),
    (PRESSURE, VISCOSITY),
)
_LOGARITHMIC = frozenset({STRESS_RATIO, NUMBER, VISCOSITY, PRESSURE})
_LABELS = {
    STRESS_RATIO: r"stress ratio $\mu = \sigma/p$",
    NUMBER: r"viscous number $J = \dot\gamma/(\xi_0 p)$",
    PHI: r"packing fraction $\phi$",
    VISCOSITY: r"viscosity $\sigma\xi_0/\dot\gamma$",
    PRESSURE: r"pressure $p\,\xi_0/\dot\gamma$",
    CONTACTS: r"contacts per disc $2N_c/N$",
}
_SIZE = "packing.discs"


def has_flow_laws(points: "pd.DataFrame") -> bool:
    """Whether two points or more have a viscous number."""
    return f"{NUMBER}_mean" in points and int(points[f"{NUMBER}_mean"].notna().sum()) > 1


def flow_laws(points: "pd.DataFrame") -> "Figure":
    """Draw the flow laws of all points: a colour and marker per scene and number of discs.

    Parameters
    ----------
    points : DataFrame
        Table ``steady`` of a study whose model measures the viscous number.

    Raises
    ------
    ValueError
        If fewer than two points have a viscous number.
    """
    if not has_flow_laws(points):
        msg = "fewer than two points have a viscous number: there is no law to draw"
        raise ValueError(msg)
    table = by_scene(points)
    table = table[table[f"{NUMBER}_mean"].notna()]
    keys = ["scene"] + ([_SIZE] if _SIZE in table and table[_SIZE].nunique() > 1 else [])
    groups = list(table.groupby(keys, sort=False))
    names = []
    with style.figure(style.DOUBLE, 4.6) as figure:
        axes = figure.subplots(2, 3).flatten()
        for turn, (name, part) in enumerate(groups):
            names.append(
                ", ".join(_word(key, value) for key, value in zip(keys, name, strict=True))
            )
            for axis, (x, y) in zip(axes, PANELS, strict=True):
                _points(axis, part.sort_values(f"{x}_mean"), x, y, turn)
        for axis, (x, y) in zip(axes, PANELS, strict=True):
            _scale(axis, table, x, y)
        if len(groups) > 1:
            handles = axes[0].get_legend_handles_labels()[0]
            figure.legend(handles, names, loc="outside lower center", ncols=min(len(names), 4))
        style.note(
            figure, style.intervals_note(points, [y for _, y in PANELS]), style.partial_note(points)
        )
    return figure


def _word(key: str, value: object) -> str:
    return f"N = {value:,}" if key == _SIZE else style.words(str(value))


def _points(axis: "Axes", part: "pd.DataFrame", x: str, y: str, turn: int) -> None:
    colour = style.UNORDERED[turn % len(style.UNORDERED)]
    at, mean = (part[f"{name}_mean"].to_numpy(np.float64) for name in (x, y))
    low, high = (part[f"{y}_ci_{end}"].to_numpy(np.float64) for end in ("low", "high"))
    before, after = (part[f"{x}_ci_{end}"].to_numpy(np.float64) for end in ("low", "high"))
    axis.vlines(at, low, high, color=colour, alpha=0.4, linewidth=2)
    axis.hlines(mean, before, after, color=colour, alpha=0.4, linewidth=2)
    axis.plot(
        at, mean, color=colour, marker=style.MARKERS[turn % len(style.MARKERS)], linewidth=0.6,
        label=str(turn),
    )  # fmt: skip


def _scale(axis: "Axes", table: "pd.DataFrame", x: str, y: str) -> None:
    for name, one in ((x, axis.xaxis), (y, axis.yaxis)):
        if name in _LOGARITHMIC:
            values = table[f"{name}_mean"].to_numpy(np.float64)
            low, high = float(values.min()) / 1.3, 1.3 * float(values.max())
            (axis.set_xscale if one is axis.xaxis else axis.set_yscale)("log")
            (axis.set_xlim if one is axis.xaxis else axis.set_ylim)(low, high)
            style.log_ticks(one, low, high)
    if y == CONTACTS:  # without rattlers 2 N_c/N is 4 where discs jam
        axis.axhline(4.0, color="0.4", linewidth=0.7, linestyle="--")
    axis.set_xlabel(_LABELS[x])
    axis.set_ylabel(_LABELS[y])
