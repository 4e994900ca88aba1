"""What `aggregate` says on the screen: how much is there, and the tables in short."""

import math
from collections.abc import Mapping, Sequence
from itertools import compress
from typing import TYPE_CHECKING, Any

from shear_sim.landmarks import SOFTENING
from shear_sim.rheology import LIMITS
from shear_sim.statistics import FEWEST, SMALLEST_BOOTSTRAP
from shear_sim.variation import Variation, by_scene, short_name, variation

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

#: Tables with more points than this are shown by the ends of their curves.
MOST_ROWS = 30
WORDS = {"scene", "with", "what", "of"}  # headings of columns that hold no numbers
_PLAIN_WIDTH = 240  # of a line where the output is no terminal: it is cut by nobody
#: Tables with a row per point, and what of them is shown.
_NAMED = 5  # damaged results
_SHOWN = {
    "curves": {"storage_modulus": "G′", "loss_modulus": "G″"},
    "steady": {"shear_stress": "τ", "viscosity": "η"},
    "compression": {"final_packing_fraction": "φ"},
    "self_propelled": {"nonaffine_speed": "speed", "contact_number": "z"},
    "body_force": {"mean_velocity_x": "u_x", "mean_velocity_y": "u_y"},
    "stages": {"final_packing_fraction": "φ"},
    "diametral_compression": {"final_scaled_force": "F R²/EI", "final_area_ratio": "V/V₀"},
    "compaction": {"final_stress_per_bending": "σ R²/k_b", "final_void_ratio": "e"},
    "bending": {"final_deflection_ratio": "δ/δ_th"},
    "pressure": {"bulk_modulus_ratio": "K/K_th", "buckling_pressure_ratio": "p R³/EI"},
    "vibration": {"frequency_ratio": "ω/ω₁", "energy_drift": "drift"},
    "tension": {"peak_stress_per_bending": "σ R²/k_b", "rupture_strain": "ε"},
}
#: Of features and contrasts: (landmark, quantity) and heading.
_LANDMARKS = {
    ("low_strain_plateau", "storage_modulus"): "plateau G′",
    ("softening", "strain"): "softening",
    ("soft_plateau", "storage_modulus"): "soft plateau G′",
    ("yield", "strain"): "yield",
    ("yield", "total_stress"): "yield stress",
}
_SIGNIFICANT = 0.05
#: What is wrong with runs that have a flag, to be said after their number.
FLAGGED = {
    "baseline_noise": "whose stress at rest is over {limit:.0%} of its amplitude",
    "surface_internal_ratio": "whose |G*| at the surface / inside is not {low:g} to {limit:g}",
    "cycle_change": "whose |G*| changes by over {limit:.0%} in the last period",
    "drift_ratio": "whose mean stress drifts by over {limit:.0%} of the amplitude in a period",
    "jumps": "whose stress jumps",
    "asymmetry": "whose stress tensor is not symmetric",
    "not_at_rest": "that did not come to rest before the shear",
    "stopped_early": "that stopped before their end",
    "deep_overlap": "whose discs overlap deeply",
    "forces_nonunique": "whose forces are one of many sets",
    "energy_missing": "whose energy is not all accounted for",
    "inertia": "so fast that inertia counts",
    "drag": "whose drag bears a part of the load",
    "coarse": "whose folds are of so few segments that forces are some percent off",
    "sunk": "that sink into soft contacts so far that forces are some percent off",
}

InShort = tuple[str, list[str], list[list[str]]]  # title, headings, rows


def print_summary(tables: "Mapping[str, pd.DataFrame]", console: "Console | None" = None) -> None:
    """Print the tables of `shear_sim.aggregate.aggregate` in short.

    One line per point, or, where there are many, the two ends of each curve; one per curve with
    landmarks; one per comparison. Rules on a terminal, plain columns elsewhere.
    """
    from rich.console import Console

    console = console or Console()
    if not console.is_terminal:
        console = Console(file=console.file, width=_PLAIN_WIDTH, color_system=None, soft_wrap=True)
    for title, headings, rows in in_short(tables):
        console.print(_grid(title, headings, rows, plain=not console.is_terminal))
    for line in notes(tables):
        console.print(line, highlight=False)


def in_short(tables: "Mapping[str, pd.DataFrame]") -> list[InShort]:
    """Return what a reader wants first of the tables: title, headings and rows of each.

    Columns that are empty throughout are left out.
    """
    found = [_points(tables[name], name) for name in _SHOWN if name in tables]
    if len(tables.get("features", ())):
        found.append(_features(tables["features"], tables["curves"]))
    if len(tables.get("contrasts", ())):
        found.append(_contrasts(tables["contrasts"]))
    shown = []
    for title, headings, rows in found:
        if rows:
            used = [any(column) for column in zip(*rows, strict=True)]
            kept = [list(compress(row, used)) for row in rows]
            shown.append((title, list(compress(headings, used)), kept))
    return shown


def _grid(
    title: str, headings: Sequence[str], rows: Sequence[Sequence[str]], *, plain: bool
) -> Any:
    """Return a table to print."""
    from rich import box
    from rich.table import Table

    grid = Table(
        title=title,
        title_justify="left",
        title_style="",
        box=None if plain else box.SIMPLE_HEAD,
        pad_edge=False,
    )
    for heading in headings:
        words = heading in WORDS
        grid.add_column(heading, justify="left" if words else "right", no_wrap=not words)
    for row in rows:
        grid.add_row(*row)
    return grid


def _points(points: "pd.DataFrame", name: str) -> InShort:
    """Return what is shown of a table with a row per point: title, headings, rows."""
    plan = variation(points)
    table = by_scene(points)
    quantities = _SHOWN[name]
    axes = [key for key in (plan.colour, plan.x) if key is not None]
    units = points.attrs["units"]
    headings = ["scene", "with", *[short_name(key) for key in axes], "runs"]
    headings += [f"{symbol} [{units[f'{q}_mean']}]" for q, symbol in quantities.items()]
    level = float(points["ci_level"].iloc[0])
    table["_with"] = [_difference(row, plan) for _, row in table.iterrows()]
    curve = ["scene", "_with", *([plan.colour] if plan.colour else [])]
    curves = [lines for _, lines in table.groupby(curve, sort=False, dropna=False)]
    # The curves at the reference first, in the order of the scenes; then key by key.
    curves.sort(key=lambda lines: _rank(lines.iloc[0], plan))
    rows = []
    for lines in curves:
        shown = lines.sort_values(plan.x) if plan.x else lines
        if len(table) > MOST_ROWS and len(shown) > 2:
            shown = shown.iloc[[0, -1]]
        for _, row in shown.iterrows():
            rows.append(
                [
                    *_scene(row, table),
                    row["_with"],
                    *[_value(row[key]) for key in axes],
                    f"{row['replicates']} of {row['planned']}",
                    *[_estimate(row, f"{quantity}_mean", quantity) for quantity in quantities],
                ]
            )
    return f"mean response [{level:.0%} interval over replicates]", headings, rows


def _scene(row: Any, table: "pd.DataFrame") -> list[str]:
    return [str(row["scene"]) if table["scene"].nunique() > 1 else ""]


def _features(features: "pd.DataFrame", curves: "pd.DataFrame") -> InShort:
    """Return what is shown of the landmarks: a line per curve."""
    plan = variation(curves)
    table = by_scene(features)
    table["_with"] = [_difference(row, plan) for _, row in table.iterrows()]
    axes = [plan.colour] if plan.colour is not None else []
    units = features.attrs["units"]
    headings = ["scene", "with", *[short_name(key) for key in axes], "runs"]
    headings += [
        heading if units[quantity] == "1" else f"{heading} [{units[quantity]}]"
        for (_, quantity), heading in _LANDMARKS.items()
    ]
    of_curves = [lines for _, lines in table.groupby(["scene", "curve"], sort=False)]
    of_curves.sort(key=lambda lines: _rank(lines.iloc[0], plan))
    rows = []
    for lines in of_curves:
        first, found = lines.iloc[0], lines.set_index("landmark")
        rows.append(
            [
                *_scene(first, table),
                first["_with"],
                *[_value(first[key]) for key in axes],
                f"{first['replicates']} of {first['planned']}",
                *[_landmark(found.loc[name], quantity) for name, quantity in _LANDMARKS],
            ]
        )
    return "landmarks of the curves", headings, rows


def _landmark(row: Any, quantity: str) -> str:
    """Return an estimate, or on which side of the amplitudes it lies."""
    if row["censored"] in {"above", "below"} and quantity == "strain":
        return f"{'>' if row['censored'] == 'above' else '<'} {_value(row['strain_limit'])}"
    return _estimate(row, quantity, quantity)


def _contrasts(contrasts: "pd.DataFrame") -> InShort:
    """Return what is shown of the contrasts: a line per comparison, of landmarks alone."""
    table = contrasts[contrasts["landmark"] != ""]
    keys = [str(key) for key in contrasts if "." in str(key)]
    headings = ["what", "of", "with", *_LANDMARKS.values()]
    rows = []
    groups = table.groupby(["parameter", "scene", "against", "effect"], sort=False, observed=True)
    for _, group in groups:
        parameter, scene, effect = (
            str(group[name].iloc[0]) for name in ("parameter", "scene", "effect")
        )
        held = [key for key in keys if group[key].nunique(dropna=False) > 1]
        for _, lines in group.groupby(["values", *held], sort=False, dropna=False):
            first = lines.iloc[0]
            found = {(row["landmark"], row["quantity"]): row for _, row in lines.iterrows()}
            what = f"{effect} in {short_name(parameter)} ({first['values']})"
            if effect == "ratio":
                what = " / ".join(first["values"].split("; "))
            rows.append(
                [
                    what,
                    "" if parameter == "scene" else scene,
                    ", ".join(f"{short_name(key)} {_value(first[key])}" for key in held),
                    *[_effect(found.get(key)) for key in _LANDMARKS],
                ]
            )
    title = f"contrasts of landmarks (* p < {_SIGNIFICANT:g} after Holm's correction)"
    return title, headings, rows


def _effect(row: Any) -> str:
    if row is None or math.isnan(row["estimate"]):
        return "-"
    star = "*" if row["p_holm"] < _SIGNIFICANT else " "
    return _estimate(row, "estimate", "") + star


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


def _estimate(row: Any, value: str, quantity: str) -> str:
    """Return ``mean [low, high]``; the bounds are in columns that begin with ``quantity``."""
    mean = float(row[value])
    low, high = (float(row[f"{quantity}_{end}".strip("_")]) for end in ("ci_low", "ci_high"))
    if math.isnan(mean):
        return "-"
    if math.isnan(low):
        return _three_digits(mean)
    return f"{_three_digits(mean)} [{_three_digits(low)}, {_three_digits(high)}]"


def _three_digits(value: float) -> str:
    """Return a number with three significant digits; 1970, not 1.97e+03."""
    rounded = float(f"{value:.3g}")
    return f"{rounded:.0f}" if 1000 <= abs(rounded) < 1e6 else f"{value:.3g}"


def _flagged(name: str) -> str:
    low, limit = LIMITS.get(name, (0, 0))
    return FLAGGED[name].format(low=low, limit=limit)


def notes(tables: "Mapping[str, pd.DataFrame]") -> list[str]:
    """Return what a reader of the numbers must know."""
    found = [tables[name] for name in _SHOWN if name in tables]
    done, planned, failed, flagged = (
        sum(int(points[name].sum()) for points in found)
        for name in ("replicates", "planned", "failed", "flagged")
    )
    about = tables["runs"].attrs
    damaged = about["damaged"]
    missing = planned - done - failed - len(damaged)
    lines = [f"{done:,} of {planned:,} runs"]
    if done < planned:
        lines[0] = f"PARTIAL STUDY: {lines[0]} ({failed:,} failed, {missing:,} not yet run)"
    if damaged:
        first = ", ".join(damaged[:_NAMED]) + (", ..." if len(damaged) > _NAMED else "")
        lines.append(
            f"{len(damaged):,} results are damaged and left out ({first}): `shear-sim verify` says "
            "how, and can have them run again"
        )
    if about.get("program", "shear-sim") != "shear-sim":
        lines.append(
            f"imported from {about['program']}; G′ and G″ are of the {about['tensor']} tensor"
        )
    elif about["tensor"] != "periodic" and "curves" in tables:
        lines.append(f"G′, G″ and all that follows are of the {about['tensor']} tensor alone")
    if "historical" in tables:
        lines.append(
            f"historical estimates of {tables['historical']['job'].nunique():,} runs are in "
            "tables/historical"
        )
    if flagged:
        flags = tables["runs"]["flags"].str.split("; ").explode()
        named = [
            f"{count:,} {_flagged(str(name))} ({name})"
            for name, count in flags[flags != ""].value_counts().items()
        ]
        are = "run is" if flagged == 1 else "runs are"
        lines.append(
            f"{flagged:,} {are} flagged, and counted all the same (columns flags and flagged of "
            f"tables/runs): {', '.join(named) or 'no result'}"
        )
    features = tables.get("features")
    if features is not None and len(features):
        of = features[features["landmark"] == "low_strain_plateau"]
        if steep := int(of["storage_modulus_ci_flag"].str.contains("no plateau").sum()):
            lines.append(
                f"{steep:,} of {len(of):,} curves show no plateau, as their G′ is under "
                f"{SOFTENING:.0%} of its first value before the second amplitude: `plateau G′` is "
                "that first value, and smaller amplitudes would tell whether it is one"
            )
        if late := int(of["storage_modulus_ci_flag"].str.contains("plateau read at").sum()):
            lines.append(
                f"{late:,} of {len(of):,} curves begin at a larger amplitude than others: their "
                "plateau and softening, and contrasts of these, are not those of a first plateau"
            )
    if orphans := tables["runs"].attrs.get("orphans", 0):
        lines.append(f"{orphans:,} results are of jobs outside the plan; they are not counted")
    weak = sum(
        int(((points[f"{quantity}_ci_flag"] != "") & (points["n"] > 1)).sum())
        for name, points in zip([name for name in _SHOWN if name in tables], found, strict=True)
        for quantity in _SHOWN[name]
    )
    single = sum(int((points["n"] == 1).sum()) for points in found)
    if single:
        lines.append(f"{single:,} points have one replicate, and no intervals")
    if guessed := sum(int(points["n"].between(2, FEWEST - 1).sum()) for points in found):
        lines.append(
            f"{guessed:,} points have fewer than {FEWEST} replicates: their intervals are no more "
            "than guesses"
        )
    if weak:
        few = (
            f", most as they are of fewer than {SMALLEST_BOOTSTRAP} replicates"
            if any((points["n"] < SMALLEST_BOOTSTRAP).any() for points in found)
            else ""
        )
        lines.append(
            f"{weak:,} intervals of means may miss the truth more often than they say{few}; why, "
            "one by one: the columns whose names end with _ci_flag"
        )
    return lines
