"""G' and G'' against the strain amplitude, each curve in its own panel with its landmarks."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from shear_sim.figures import style
from shear_sim.figures.curves import curve_table, evenly, in_order
from shear_sim.figures.landmarks import LANDMARKS
from shear_sim.figures.panels import bands
from shear_sim.variation import AMPLITUDE

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MODULI = {"storage_modulus": (style.STORAGE, "o"), "loss_modulus": (style.LOSS, "s")}
_MOST_ACROSS, _MOST_ROWS = 5, 6
# The line begins at the low-strain plateau anyway.
_MARKED = [name for name in LANDMARKS if name != "low_strain_plateau"]
_LOWEST_BAR, _NEXT_BAR = 4.0, 4.5  # points above the foot of the panel: intervals of landmarks


def moduli_with_landmarks(
    points: "pd.DataFrame", features: "pd.DataFrame | None" = None
) -> "Figure":
    """Draw G' and G'' against the strain amplitude: a panel per scene and friction.

    Lines are means over replicates, bands their intervals; black marks are landmarks, with the
    intervals of their strain at the foot, each in the colour of the modulus it is marked on. All
    parameters beside the strain amplitude and the friction (or the parameter that takes its place,
    see `shear_sim.variation.variation`) stand at their reference. Where there are more values than
    a page has room for, some are left out, evenly.

    Parameters
    ----------
    points : DataFrame
        Table ``curves`` of a study.
    features : DataFrame, optional
        Table ``features`` of the same study.

    Raises
    ------
    ValueError
        If the points form no curves over the strain amplitude (see `has_curves`).
    """
    import pandas as pd

    table, key = curve_table(points)
    scenes = list(dict.fromkeys(table["scene"]))
    values: list[Any] = [None] if key is None else in_order(table[key])
    across = min(len(values), _MOST_ACROSS) if len(values) > 1 else min(len(scenes), 3)
    shown = evenly(values, max(1, _MOST_ROWS // len(scenes)) * across)
    if len(shown) > across:  # as many in each row
        across = math.ceil(len(shown) / math.ceil(len(shown) / across))
    parts = [
        (scene, value, part)
        for scene in scenes
        for value in shown
        if len(part := _part(table, scene, key, value))
    ]
    marks = _by_curve(features)
    drawn = [found for of_curve in marks.values() for found in of_curve]
    how = style.methods(pd.DataFrame(drawn), ["strain"]) if drawn else ""
    with style.small_multiples(len(parts), across) as (figure, axes):
        style.scale_x(axes[0], table[AMPLITUDE])
        foot = style.scale_y(axes[0], table, list(_MODULI))
        for place, (axis, (scene, value, part)) in enumerate(zip(axes, parts, strict=True)):
            title = _title(scene if len(scenes) > 1 else "", key, value)
            axis.set_title(title, fontsize=style.SMALL + 0.5)
            _curve(axis, part.sort_values(AMPLITUDE), foot)
            for curve in part["curve"].unique():
                for found in marks.get(curve, ()):
                    _landmark(axis, found)
            if place + across >= len(parts):
                axis.set_xlabel(style.label(points, AMPLITUDE))
            if place % across == 0:
                axis.set_ylabel("$G'$, $G''$ [Pa]")
        _explain(figure, axes)
        style.note(
            figure,
            style.intervals_note(points, list(_MODULI)),
            f"at the foot: intervals of the strain of landmarks ({how})" if how else "",
            style.tensor_note(points),
            style.left_out_note(key, shown, values),
            style.partial_note(points),
        )
    return figure


def _part(table: "pd.DataFrame", scene: str, key: str | None, value: Any) -> "pd.DataFrame":
    of_scene = table[table["scene"] == scene]
    return of_scene if key is None else of_scene[of_scene[key] == value]


def _title(scene: str, key: str | None, value: Any) -> str:
    words = [style.words(scene)] if scene else []
    if key is not None:
        words.append(f"{style.symbol(key)} = {style.value_text(value)}")
    return ", ".join(words)


def _curve(axis: "Axes", line: "pd.DataFrame", foot: float | None) -> None:
    """Draw G' and G'' with their bands."""
    at = line[AMPLITUDE].to_numpy(dtype=np.float64)
    for quantity, (colour, marker) in _MODULI.items():
        mean, low, high = (
            line[f"{quantity}_{part}"].to_numpy(dtype=np.float64)
            for part in ("mean", "ci_low", "ci_high")
        )
        if foot is not None:
            mean = np.where(mean > 0, mean, np.nan)
            low, high = (np.where(end <= foot, foot * 0.99, end) for end in (low, high))
        bands(axis, at, low, high, colour, apart=False)
        drawn = style.marker_style(quantity, colour, marker)
        axis.plot(at, mean, **drawn, label=style.title(quantity))


def _by_curve(features: "pd.DataFrame | None") -> dict[str, list[Mapping[Any, Any]]]:
    """Return the landmarks inside the range of the amplitudes, by curve."""
    found: dict[str, list[Mapping[Any, Any]]] = {}
    if features is not None:
        kept = features[(features["censored"] == "") & features["landmark"].isin(_MARKED)]
        for row in kept.to_dict("records"):
            found.setdefault(row["curve"], []).append(row)
    return found


def _landmark(axis: "Axes", found: Mapping[Any, Any]) -> None:
    """Mark a landmark on its curve, and the interval of its strain at the foot of the panel."""
    from matplotlib.transforms import ScaledTranslation

    quantity, _, marker, text = LANDMARKS[found["landmark"]]
    figure = axis.get_figure(root=True)
    if not found[quantity] > 0 or figure is None:
        return
    axis.plot(
        found["strain"], found[quantity], linestyle="none", zorder=5, label=text,
        **style.mark_style(marker),
    )  # fmt: skip
    # On the curve, bars of several landmarks would lie on one another and on the curve itself.
    height = _LOWEST_BAR + _NEXT_BAR * _MARKED.index(found["landmark"])
    shift = ScaledTranslation(0, height / 72, figure.dpi_scale_trans)
    foot = axis.get_xaxis_transform() + shift
    axis.hlines(
        0.0, found["strain_ci_low"], found["strain_ci_high"], color=_MODULI[quantity][0],
        linewidth=1.6, zorder=4, transform=foot,
    )  # fmt: skip
    axis.scatter(
        found["strain"], 0.0, s=14 if marker == "*" else 7, color="k", marker=marker,
        linewidths=1.0 if marker == "|" else 0.0, zorder=5, transform=foot,
    )  # fmt: skip


def _explain(figure: "Figure", axes: "Sequence[Axes]") -> None:
    """Add a legend of what is drawn anywhere, in the same order always."""
    found: dict[str, Any] = {}
    for axis in axes:
        for handle, text in zip(*axis.get_legend_handles_labels(), strict=True):
            found.setdefault(text, handle)
    order = [text for *_, text in LANDMARKS.values()]
    texts = sorted(found, key=lambda text: order.index(text) if text in order else -1)
    columns = min(len(texts), int(figure.get_figwidth() / 1.5))
    figure.legend([found[text] for text in texts], texts, loc="outside lower center", ncols=columns)
