"""Lissajous–Bowditch curves of every point: amplitudes from left to right, frictions upwards.

Each cell holds one cycle of the mean response, stress against strain (elastic) or against strain
rate (viscous), both divided by their largest value. Dashed is the ellipse of the first harmonic;
where the loop leaves it, the response is not linear.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from shear_sim.figures import style
from shear_sim.figures.curves import curve_table, evenly, in_order
from shear_sim.figures.style import FloatArray
from shear_sim.large_amplitude import lissajous as loop
from shear_sim.variation import AMPLITUDE

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Kind = Literal["elastic", "viscous"]

_LOOKS = {
    "elastic": ("strain", style.STORAGE, r"stress $\tau$ against strain $\gamma$"),
    "viscous": ("rate", style.LOSS, r"stress $\tau$ against strain rate $\dot\gamma$"),
}
_MOST_ACROSS, _MOST_ROWS = 14, 12
_LARGEST_CELL = 0.9  # inches
_ROWS = 145  # corners of a loop: 2.5° each
_HALF = 0.39  # of a cell, from its centre to the ends of the loop


def lissajous(points: "pd.DataFrame", harmonics: "pd.DataFrame", kind: Kind) -> "Figure":
    """Draw the cycles of all points in a grid per scene.

    Columns are strain amplitudes, rows the friction (or the parameter that takes its place, see
    `shear_sim.variation.variation`); all other parameters stand at their reference. Where there
    are more than a page has room for, some are left out, evenly.

    Parameters
    ----------
    points, harmonics : DataFrame
        Tables ``curves`` and ``harmonics`` of a study.
    kind : {"elastic", "viscous"}
        Against the strain, with the elastic part of the stress as a line, or against the strain
        rate, with the viscous part.

    Raises
    ------
    ValueError
        If the points form no curves over the strain amplitude.
    """
    table, key = curve_table(points)
    waves = _mean_waves(harmonics)
    table = table[table["point"].isin(list(waves))]
    scenes = list(dict.fromkeys(table["scene"]))
    amplitudes, values = in_order(table[AMPLITUDE]), [None]
    if key is not None:
        values = in_order(table[key])
    columns = evenly(amplitudes, _MOST_ACROSS)
    rows = evenly(values, max(1, _MOST_ROWS // len(scenes)))
    cell = min(_LARGEST_CELL, (style.DOUBLE - 0.75) / len(columns))
    cell = min(cell, (style.PAGE - 1.3) / (len(scenes) * len(rows)) - 0.05)
    width = max(style.SINGLE, cell * len(columns) + 0.75)
    height = cell * len(rows) * len(scenes) + 0.2 * len(scenes) + 1.1
    with style.figure(width, height) as figure:
        axes = figure.subplots(len(scenes), 1, squeeze=False, sharex=True)[:, 0]
        for axis, scene in zip(axes, scenes, strict=True):
            _frame(axis, columns, rows)
            axis.set_ylabel(style.label(points, key) if key is not None else "")
            axis.set_title(style.words(str(scene)))
            cycles = [
                _cycle((columns.index(amplitude), rows.index(value)), waves[name], amplitude, kind)
                for name, amplitude, value in _cells(table[table["scene"] == scene], key)
                if amplitude in columns and value in rows
            ]
            _draw(axis, cycles, kind)
        axes[-1].set_xlabel(style.label(points, AMPLITUDE))
        _explain(figure, kind)
        style.note(
            figure,
            f"{_LOOKS[kind][2]}, each over its largest value; mean response",
            style.tensor_note(points),
            style.left_out_note(AMPLITUDE, columns, amplitudes),
            style.left_out_note(key, rows, values),
            style.partial_note(points),
        )
    return figure


def _frame(axis: "Axes", columns: "list[Any]", rows: "list[Any]") -> None:
    """Make a grid of square cells, labelled by the values of its columns and rows."""
    axis.set_xlim(-0.5, len(columns) - 0.5)
    axis.set_ylim(-0.5, len(rows) - 0.5)
    axis.set_aspect("equal")
    axis.grid(visible=False)
    for side in axis.spines.values():
        side.set_visible(False)
    axis.tick_params(length=0)
    axis.set_xticks(range(len(columns)), [style.value_text(value) for value in columns])
    texts = [] if rows == [None] else [style.value_text(value) for value in rows]
    axis.set_yticks(range(len(texts)), texts)
    lines: dict[str, Any] = {"color": "0.88", "linewidth": 0.5, "zorder": 0}
    axis.hlines(np.arange(len(rows) + 1) - 0.5, -0.5, len(columns) - 0.5, **lines)
    axis.vlines(np.arange(len(columns) + 1) - 0.5, -0.5, len(rows) - 0.5, **lines)


def _cells(points: "pd.DataFrame", key: str | None) -> "Iterator[tuple[str, float, Any]]":
    """Yield the id, the amplitude and the row of each point."""
    for name, amplitude, value in zip(
        points["point"], points[AMPLITUDE], points["point"] if key is None else points[key],
        strict=True,
    ):  # fmt: skip
        yield name, amplitude, None if key is None else value


def _mean_waves(harmonics: "pd.DataFrame") -> "dict[str, tuple[FloatArray, FloatArray]]":
    """Return G'_n and G''_n of each point, (H,) each: means over its replicates."""
    mean = harmonics.groupby(["point", "harmonic"])[["storage_modulus", "loss_modulus"]].mean()
    storage, loss = (mean[name].unstack("harmonic") for name in mean)
    waves = zip(storage.to_numpy(), loss.to_numpy(), strict=True)
    return dict(zip(storage.index.astype(str), waves, strict=True))


def _cycle(
    place: tuple[int, int], wave: tuple[FloatArray, FloatArray], amplitude: float, kind: Kind
) -> dict[str, FloatArray]:
    """Return the corners (rows, 2) of a loop, of its elastic or viscous part and of its ellipse."""
    storage, loss = wave
    cycle = loop(storage, loss, strain_amplitude=amplitude, rows=_ROWS)
    first = loop(storage[:1], loss[:1], strain_amplitude=amplitude, rows=_ROWS)
    largest = np.abs(cycle["stress"]).max() or 1.0  # no stress at all: a line at zero
    x = place[0] + _HALF * cycle[_LOOKS[kind][0]] / amplitude
    stresses = {"loop": cycle["stress"], "part": cycle[kind], "first": first["stress"]}
    return {
        name: np.column_stack([x, place[1] + _HALF * stress / largest])
        for name, stress in stresses.items()
    }


def _draw(axis: "Axes", cycles: "Sequence[dict[str, FloatArray]]", kind: Kind) -> None:
    from matplotlib.collections import LineCollection, PolyCollection

    # One artist for all cells: a hundred panels would take ten times as long.
    loops = [cycle["loop"] for cycle in cycles]
    axis.add_collection(PolyCollection(loops, color=_LOOKS[kind][1], alpha=0.15, linewidth=0))
    for name, drawn in _lines(kind).items():
        axis.add_collection(LineCollection([cycle[name] for cycle in cycles], **drawn))


def _lines(kind: Kind) -> dict[str, dict[str, Any]]:
    """Return how the lines are drawn, with the names that a legend gives them."""
    return {
        "loop": {"color": _LOOKS[kind][1], "linewidth": 1.0, "label": "harmonics 1, 3 … 9"},
        "part": {"color": "k", "linewidth": 0.7, "label": f"{kind} part"},
        "first": {
            "color": "0.4", "linewidth": 0.6, "linestyle": (0, (3, 2)), "label": "first harmonic",
        },
    }  # fmt: skip


def _explain(figure: "Figure", kind: Kind) -> None:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], **drawn) for drawn in _lines(kind).values()]
    columns = 3 if figure.get_figwidth() > 1.2 * style.SINGLE else 2
    figure.legend(handles=handles, loc="outside lower center", ncols=columns)
