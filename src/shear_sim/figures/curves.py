"""Quantities of all points: against the table's x, and against each parameter beside it.

Whatever parameters vary, `curves` has the strain amplitude on its axis (else the first parameter
that is a number), one panel per scene and one colour per friction (else another parameter crossed
with it). Parameters varied beside those each get a panel of `branches`.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from shear_sim.figures.panels import Look, Panel, grid
from shear_sim.variation import AMPLITUDE, Variation, by_scene, variation

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_NOWHERE = object()  # the reference of a parameter that has none: no point stands there


def curves(points: "pd.DataFrame", quantities: Sequence[str]) -> "Figure":
    """Draw quantities against the table's x: a row each, a column per scene.

    Lines are means over replicates, bands their intervals. Only points at the reference of all
    branches are drawn; where the design has no such line (a random one), all points.

    Raises
    ------
    ValueError
        If no parameter that is a number varies.
    """
    plan = variation(points)
    x = plan.x
    if x is None:
        msg = "no numeric parameter varies in these points: there is nothing to draw against"
        raise ValueError(msg)
    table = by_scene(points)
    line = at_reference(table, plan, plan.branches)
    joined = bool(line[x].nunique() > 1)
    table = line if joined else table
    scenes = list(dict.fromkeys(table["scene"]))
    panels = [Panel(scene, table[table["scene"] == scene], x) for scene in scenes]
    return grid(points, quantities, panels, Look.by(plan.colour, panels, points, joined=joined))


def branches(points: "pd.DataFrame", quantities: Sequence[str]) -> "Figure":
    """Draw quantities against each parameter of the branches: a column per parameter.

    All other parameters stand at their reference, but for the table's x (the strain amplitude),
    told by colour, and the scene, told by the style of the line. Only the scenes and amplitudes
    at which a parameter really varies are drawn; where there are none (a random design), all.

    Raises
    ------
    ValueError
        If the design has no branches.
    """
    plan = variation(points)
    if not plan.branches:
        msg = "no parameter varies beside the curves: there are no branches to draw"
        raise ValueError(msg)
    table = by_scene(points)
    panels, joined = [], False
    for key in plan.branches:
        others = [k for k in (*plan.branches, plan.colour) if k is not None and k != key]
        part = at_reference(table, plan, others)
        cell = part.groupby(["scene", plan.x] if plan.x else ["scene"])[key]
        part = part[cell.transform("nunique") > 1]
        joined = joined or len(part) > 0
        panels.append(Panel("", part if len(part) else table, key))
    return grid(points, quantities, panels, Look.by(plan.x, panels, points, joined=joined))


def at_reference(table: "pd.DataFrame", plan: Variation, keys: Sequence[str]) -> "pd.DataFrame":
    """Return the rows whose ``keys`` have the reference values of their scene."""
    keep = np.ones(len(table), dtype=bool)
    for key in keys:
        wanted = table["scene"].map(
            {scene: values.get(key, _NOWHERE) for scene, values in plan.reference.items()}
        )
        keep &= ((table[key] == wanted) | (table[key].isna() & wanted.isna())).to_numpy(dtype=bool)
    return table[keep]


def curve_table(points: "pd.DataFrame") -> "tuple[pd.DataFrame, str | None]":
    """Return the points of curves over the strain amplitude, and the parameter told by colour.

    All other parameters stand at their reference; there is a row for each scene of a point.

    Raises
    ------
    ValueError
        If the points form no curves over the strain amplitude (see `has_curves`).
    """
    plan = variation(points)
    line = at_reference(by_scene(points), plan, plan.branches)
    if plan.x != AMPLITUDE or line.loc[line["replicates"] > 0, AMPLITUDE].nunique() < 2:
        msg = f"no curves over {AMPLITUDE} in these points"
        raise ValueError(msg)
    return line, plan.colour


def has_curves(points: "pd.DataFrame") -> bool:
    """Whether some points differ in the strain amplitude alone, with results at two or more."""
    try:
        curve_table(points)
    except ValueError:
        return False
    return True


def evenly(values: Sequence[Any], most: int) -> list[Any]:
    """Return at most so many of the values, evenly chosen, both ends included."""
    places = np.linspace(0, len(values) - 1, min(most, len(values))).round().astype(int)
    return [values[place] for place in places]


def in_order(values: "pd.Series[Any]") -> list[Any]:
    """Return the different values of a parameter: numbers by size, words by the alphabet."""
    found = list(values.dropna().unique())
    return sorted(found, key=None if values.dtype.kind in "if" else str)
