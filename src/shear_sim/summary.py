"""What `aggregate` says on the screen: how much is there, and the moduli in short."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from shear_sim.aggregate import POINT_TABLES
from shear_sim.variation import Variation, by_scene, short_name, variation

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

#: Tables with more points than this are shown by the ends of their curves.
MOST_ROWS = 30
_PLAIN_WIDTH = 200  # of a line where the output is no terminal: it is cut by nobody
_SHOWN = {
    "moduli": {"storage_modulus": "G′", "loss_modulus": "G″"},
    "steady": {"shear_stress": "τ", "viscosity": "η"},
    "compression": {"final_packing_fraction": "φ"},
    "self_propelled": {"nonaffine_speed": "speed", "contact_number": "z"},
}


def print_summary(tables: "Mapping[str, pd.DataFrame]", console: "Console | None" = None) -> None:
    """Print the tables of `shear_sim.aggregate.aggregate` in short.

    One line per point, or, where there are many, the two ends of each curve. Rules on a terminal,
    plain columns elsewhere.
    """
    from rich.console import Console

    console = console or Console()
    if not console.is_terminal:
        console = Console(file=console.file, width=_PLAIN_WIDTH, color_system=None, soft_wrap=True)
    for name, _ in POINT_TABLES.values():
        if name in tables:
            console.print(_grid(tables[name], name, plain=not console.is_terminal))
    for line in _notes(tables):
        console.print(line, highlight=False)


def _grid(points: "pd.DataFrame", name: str, *, plain: bool) -> Any:
    """Return the table to print."""
    from rich import box
    from rich.table import Table

    plan = variation(points)
    table = by_scene(points)
    quantities = _SHOWN[name]
    axes = [key for key in (plan.colour, plan.x) if key is not None]
    scenes = ["scene"] if table["scene"].nunique() > 1 else []
    headings = [*scenes, *[short_name(key) for key in axes], "runs"]
    if plan.branches:
        headings.insert(len(scenes), "with")
    headings += [
        f"{symbol} [{points.attrs['units'][f'{q}_mean']}]" for q, symbol in quantities.items()
    ]
    level = float(points["ci_level"].iloc[0])
    grid = Table(
        title=f"mean [{level:.0%} interval] over replicates",
        title_justify="left",
        title_style="",
        box=None if plain else box.SIMPLE_HEAD,
        pad_edge=False,
    )
    for heading in headings:
        text = heading in {"scene", "with"}
        grid.add_column(heading, justify="left" if text else "right", no_wrap=not text)
    table["_with"] = [_difference(row, plan) for _, row in table.iterrows()]
    curve = ["scene", "_with", *([plan.colour] if plan.colour else [])]
    curves = [lines for _, lines in table.groupby(curve, sort=False, dropna=False)]
    # The curves at the reference first, in the order of the scenes; then key by key.
    curves.sort(key=lambda lines: _rank(lines.iloc[0], plan))
    for lines in curves:
        shown = lines.sort_values(plan.x) if plan.x else lines
        if len(table) > MOST_ROWS and len(shown) > 2:
            shown = shown.iloc[[0, -1]]
        for _, row in shown.iterrows():
            cells = [str(row[key]) for key in [*scenes, *(["_with"] if plan.branches else [])]]
            cells += [_value(row[key]) for key in axes]
            cells.append(f"{row['replicates']} of {row['planned']}")
            grid.add_row(*cells, *[_estimate(row, quantity) for quantity in quantities])
    return grid


def _differences(row: Any, plan: Variation) -> list[str]:
    """Return the keys, other than the axes, in which a point is off its scene's reference."""
    reference = plan.reference[row["scene"]]
    return [
        key
        for key in plan.branches
        if key not in reference or _value(row[key]) != _value(reference[key])
    ]


def _difference(row: Any, plan: Variation) -> str:
    return ", ".join(f"{short_name(key)} {_value(row[key])}" for key in _differences(row, plan))


def _rank(row: Any, plan: Variation) -> tuple[Any, ...]:
    """Return what sorts curves: those at the reference first, then by key and value."""
    return tuple((plan.branches.index(key), row[key]) for key in _differences(row, plan))


def _value(value: Any) -> str:
    if value is None or value != value:  # nan
        return "-"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _estimate(row: Any, quantity: str) -> str:
    """Return ``mean [low, high]``."""
    mean, low, high = (float(row[f"{quantity}_{part}"]) for part in ("mean", "ci_low", "ci_high"))
    if math.isnan(mean):
        return "-"
    if math.isnan(low):
        return _three_digits(mean)
    return f"{_three_digits(mean)} [{_three_digits(low)}, {_three_digits(high)}]"


def _three_digits(value: float) -> str:
    """Return a number with three significant digits; 1970, not 1.97e+03."""
    if 1000 <= abs(value) < 1e6:
        return f"{float(f'{value:.3g}'):.0f}"
    return f"{value:.3g}"


def _notes(tables: "Mapping[str, pd.DataFrame]") -> list[str]:
    """Return what a reader of the numbers must know."""
    found = [tables[name] for name, _ in POINT_TABLES.values() if name in tables]
    done, planned, failed, flagged = (
        sum(int(points[name].sum()) for points in found)
        for name in ("replicates", "planned", "failed", "flagged")
    )
    missing = planned - done - failed
    lines = [f"{done:,} of {planned:,} runs"]
    if done < planned:
        lines[0] = f"PARTIAL STUDY: {lines[0]} ({failed:,} failed, {missing:,} not yet run)"
    if flagged:
        lines.append(f"{flagged:,} runs are flagged (column flagged of tables/runs); they count in")
    if orphans := tables["runs"].attrs.get("orphans", 0):
        lines.append(f"{orphans:,} results are of jobs outside the plan; they are not counted")
    few = sum(
        int((points[f"{quantity}_ci_flag"].notna() & (points["replicates"] > 0)).sum())
        for points in found
        for quantity in list(_SHOWN["moduli"] | _SHOWN["steady"])[:4]
        if f"{quantity}_ci_flag" in points
    )
    if few:
        lines.append(f"{few:,} intervals are weak (columns ..._ci_flag), most by few replicates")
    return lines
