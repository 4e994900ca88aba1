"""Landmarks of the curves over the strain amplitude, against friction and other parameters.

As Figs. 2f and 2g of Braschler et al.: where a suspension softens and yields, and how stiff it is
there, against the friction between its particles.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from shear_sim.figures import style
from shear_sim.figures.curves import at_reference
from shear_sim.figures.panels import Group, Look, Panel, grid
from shear_sim.variation import FRICTION, Variation, by_scene, variation

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BLUE, _ORANGE, _GREEN, _PURPLE, _, _SKY, _BLACK = style.UNORDERED
#: Landmarks drawn: the modulus that they are marked on, colour, marker, name.
LANDMARKS = {
    "low_strain_plateau": ("storage_modulus", _SKY, "o", "low-strain plateau"),
    "nonlinearity_onset": ("storage_modulus", _PURPLE, "|", "onset of $I_3/I_1$"),
    "softening": ("storage_modulus", _BLUE, "v", "softening"),
    "loss_peak": ("loss_modulus", _ORANGE, "^", "peak of $G''$"),
    "soft_plateau": ("storage_modulus", _GREEN, "D", "soft plateau"),
    "yield": ("loss_modulus", _BLACK, "*", "yield, $G'=G''$"),
}
#: What is drawn of them: softening and peak have no modulus worth a line of their own.
_SHOWN = {
    "strain": ("nonlinearity_onset", "softening", "loss_peak", "soft_plateau", "yield"),
    "storage_modulus": ("low_strain_plateau", "soft_plateau", "yield"),
    "total_stress": ("softening", "yield"),
}
_ARROWS = {"above": r"$\uparrow$", "below": r"$\downarrow$"}


def landmark_parameters(features: "pd.DataFrame") -> list[str]:
    """Return the parameters that landmarks can be drawn against: friction first."""
    table, plan = _table(features)
    keys = [key for key in table.columns if "." in key and _panels(table, plan, key)]
    return sorted(keys, key=lambda key: key != FRICTION)


def landmarks(features: "pd.DataFrame", parameters: Sequence[str]) -> "Figure":
    """Draw the strain, G' and stress of landmarks against parameters: a column per scene of each.

    All other parameters stand at their reference; curves of less than half as many amplitudes as
    the others of their scene are left out. Where a landmark lies beyond the amplitudes of
    the study, an arrow stands at the last one.

    Parameters
    ----------
    features : DataFrame
        Table ``features`` of a study.
    parameters : sequence of str
        Keys of the study, some of `landmark_parameters`.

    Raises
    ------
    ValueError
        If no curves differ in any of the parameters alone.
    """
    table, plan = _table(features)
    panels = [panel for key in parameters for panel in _panels(table, plan, key)]
    if not panels:
        msg = f"no two curves differ in one of {', '.join(parameters) or 'no parameters'} alone"
        raise ValueError(msg)
    arrows = any(panel.points["censored"].isin(_ARROWS).any() for panel in panels)
    quantities = [q for q in _SHOWN if any(p.points[f"{q}_mean"].notna().any() for p in panels)]
    if arrows and "strain" not in quantities:
        quantities.insert(0, "strain")
    seen = set()
    for panel in panels:
        found = panel.points["strain_mean"].notna() | panel.points["storage_modulus_mean"].notna()
        seen |= set(panel.points.loc[found | panel.points["censored"].isin(_ARROWS), "landmark"])
    groups = [
        Group(name, colour, marker, text)
        for name, (_, colour, marker, text) in LANDMARKS.items()
        if name in seen
    ]
    notes = []
    if arrows:
        notes.append("arrows: beyond the amplitudes")
    if FRICTION in parameters:
        notes.append(r"dotted: $\gamma_0=\mu$")
    look = Look("landmark", groups, {}, joined=True, bands=False)
    return grid(features, quantities, panels, look, "; ".join(notes), _beyond)


def _table(features: "pd.DataFrame") -> "tuple[pd.DataFrame, Variation]":
    """Return the landmarks that are drawn, in the columns of a table of points."""
    table = by_scene(features[features["landmark"].isin(LANDMARKS)])
    table = table.rename(columns={quantity: f"{quantity}_mean" for quantity in _SHOWN})
    for quantity, shown in _SHOWN.items():
        hidden = ~table["landmark"].isin(shown)
        parts = [f"{quantity}_{part}" for part in ("mean", "ci_low", "ci_high")]
        table.loc[hidden, parts] = np.nan
    return table, variation(table)


def _panels(table: "pd.DataFrame", plan: Variation, key: str) -> list[Panel]:
    """Return a panel for each scene in which ``key`` varies at the reference of all others."""
    others = [other for other in (plan.x, plan.colour, *plan.branches) if other not in {None, key}]
    part = at_reference(table, plan, [other for other in others if other is not None])
    several = table["scene"].nunique() > 1
    # Landmarks of curves of far fewer amplitudes are coarser, and differ by that alone.
    part = part[2 * part["amplitudes"] > part.groupby("scene")["amplitudes"].transform("max")]
    return [
        Panel(str(scene) if several else "", of_scene, key)
        for scene, of_scene in part.groupby("scene", sort=False, observed=True)
        if of_scene[key].nunique() > 1
    ]


def _beyond(axis: "Axes", panel: Panel, quantity: str, places: "Mapping[Any, int] | None") -> None:
    """Mark landmarks beyond the amplitudes by arrows at the last one, and draw γ₀ = μ."""
    if quantity != "strain":
        return
    from matplotlib.transforms import ScaledTranslation

    points = panel.points[panel.points["landmark"].isin(_SHOWN["strain"])]
    figure = axis.get_figure(root=True)
    for (name, where), found in points.groupby(["landmark", "censored"], observed=True):
        if where not in _ARROWS or figure is None:
            continue
        at = found[panel.x] if places is None else found[panel.x].map(places)
        # Beside one another: several landmarks have the same limit.
        aside = _SHOWN["strain"].index(str(name)) - (len(_SHOWN["strain"]) - 1) / 2
        shift = ScaledTranslation(4 * aside / 72, 0, figure.dpi_scale_trans)
        axis.plot(
            at, found["strain_limit"], color=LANDMARKS[str(name)][1], linestyle="none",
            marker=_ARROWS[str(where)], markersize=6, clip_on=False,
            transform=axis.transData + shift,
        )  # fmt: skip
        least, most = found["strain_limit"].min(), found["strain_limit"].max()
        low, high = axis.get_ylim() if axis.get_yscale() == "log" else (least, most)
        axis.set_yscale("log")
        axis.set_ylim(min(low, least / 1.5), max(high, 1.5 * most))
        style.log_ticks(axis.yaxis, *axis.get_ylim())
    if panel.x == FRICTION:
        friction = points.loc[points[FRICTION] > 0, FRICTION]
        axis.plot(friction, friction, color="0.6", linestyle=":", linewidth=0.9, zorder=1)
