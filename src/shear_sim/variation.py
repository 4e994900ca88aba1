"""What a table of points varies: what belongs on an axis, what in a colour, what in panels."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd

AMPLITUDE, FRICTION = "shear.strain_amplitude", "model.friction"


@dataclass(frozen=True)
class Variation:
    """What a table of points varies, and how it is best drawn.

    ``x`` is the parameter on the axis, ``colour`` the one told by colour, ``branches`` all others
    that vary within a scene; None or empty where nothing is left. ``reference`` holds, for each
    scene, the value of each parameter at which the others are varied: its most frequent one. A
    parameter that never has a value twice (in a random design) has no reference.
    """

    x: str | None
    colour: str | None
    branches: tuple[str, ...]
    reference: dict[str, dict[str, Any]]


def by_scene(points: "pd.DataFrame") -> "pd.DataFrame":
    """Return ``points`` without attrs, a row for each scene: a point may belong to several."""
    points = points.copy()  # deep: tables made column by column are slow, and pandas says so
    points.attrs = {}  # pandas copies them whole at every later step: half of what a figure costs
    if not points["scene"].str.contains("; ").any():
        return points.assign(scene=points["scene"].astype("str")).reset_index(drop=True)
    return points.assign(scene=points["scene"].str.split("; ")).explode("scene", ignore_index=True)


def variation(points: "pd.DataFrame") -> Variation:
    """Find what ``points`` (a table with one row per point) varies."""
    table = by_scene(points)
    # A parameter that only tells the scenes apart is told by the panels already.
    within = [
        key
        for key in table.columns
        if "." in key and table.groupby("scene")[key].nunique(dropna=False).max() > 1
    ]
    free = _independent(table, within)
    numeric = [key for key in free if table[key].dtype.kind in "if"]
    x = AMPLITUDE if AMPLITUDE in numeric else next(iter(numeric), None)
    others = [key for key in free if key != x]
    crossed = [key for key in others if x is not None and _is_crossed(table, x, key)]
    colour = FRICTION if FRICTION in crossed else next(iter(crossed), None)
    reference = {
        str(scene): {key: _most_frequent(part[key]) for key in free if _is_repeated(part[key])}
        for scene, part in table.groupby("scene")
    }
    return Variation(x, colour, tuple(key for key in others if key != colour), reference)


def _independent(table: "pd.DataFrame", keys: Sequence[str]) -> list[str]:
    """Leave out keys that follow from another one (a plateau's ends exist for one law only)."""

    def follows(key: str, other: str) -> bool:
        return bool(table.groupby(other, dropna=False)[key].nunique(dropna=False).max() == 1)

    kept: list[str] = []
    # Keys that every point has come first: of two that follow from one another they stay.
    for key in sorted(keys, key=lambda key: bool(table[key].isna().any())):
        # A key that never repeats (a random design) is followed by all others: by accident.
        others = [other for other in kept if table[other].duplicated().any()]
        if not any(follows(key, other) for other in others):
            kept.append(key)
    return [key for key in keys if key in kept]


def _is_repeated(values: "pd.Series[Any]") -> bool:
    return bool(values.nunique(dropna=False) == 1 or values.duplicated().any())


def _most_frequent(values: "pd.Series[Any]") -> Any:
    counts = values.value_counts(dropna=False)
    return min(counts[counts == counts.max()].index, key=str)


def _is_crossed(table: "pd.DataFrame", x: str, key: str) -> bool:
    """Whether two values of ``key`` or more are seen over at least half the values of ``x``."""
    seen = table.groupby(key, dropna=False)[x].nunique()
    return bool((seen * 2 >= table[x].nunique()).sum() > 1)


def short_name(key: str) -> str:
    """Return the last word of a dotted key, or the one before where that is only "kind"."""
    *section, last = key.split(".")
    return (section[-1] if section and last == "kind" else last).replace("_", " ")
