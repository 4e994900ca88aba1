"""A grid of panels: quantities in rows, panels in columns, lines told apart by colour and marker.

On a logarithmic axis a mean that is not positive stands as an arrow at the foot of the panel, and
the figure counts them; an interval that reaches zero is cut at the foot.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.figures import style

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]

_MOST_LINES = 12  # more values than this are told by a colour bar, not by a legend
_MOST_ACROSS = 5  # panels side by side
_WIDE = 3  # more panels than this side by side are narrower than a label
_SCENES = ("-", "--", ":", "-.")
FOOT_MARK = r"$\downarrow$"


@dataclass(frozen=True)
class Panel:
    """One panel for each quantity: its title, the points in it, the parameter on its axis."""

    title: str
    points: "pd.DataFrame"
    x: str


def grid(
    points: "pd.DataFrame",
    quantities: Sequence[str],
    panels: Sequence[Panel],
    colour: str | None,
    *,
    joined: bool,
) -> "Figure":
    """Draw quantities (rows) in panels (columns, wrapped where they are many).

    Parameters
    ----------
    points : DataFrame
        The whole table: its units, and how much of the study is there.
    quantities : sequence of str
        Columns without their ``_mean``, ``_ci_low``, ``_ci_high``, ``_ci_method``.
    panels : sequence of Panel
        With a ``scene`` in each row of their points; several in one panel are told by the style
        of the line.
    colour : str, optional
        The parameter that is told by colour and marker.
    joined : bool
        Lines with bands; otherwise points with bars (a random design).
    """
    import pandas as pd

    shown = pd.concat([panel.points for panel in panels])
    look = _Look.of(panels, colour, joined=joined)
    blocks = math.ceil(len(panels) / _MOST_ACROSS)
    across = math.ceil(len(panels) / blocks)
    rows = blocks * len(quantities)
    width = {1: style.SINGLE, 2: 5.2}.get(across, style.DOUBLE)
    height = min(1.95 * rows, max(style.PAGE - 1.0, 1.3 * rows)) + 0.9
    hidden = 0
    with style.figure(width, height) as figure:
        axes = figure.subplots(rows, across, squeeze=False)
        for place, panel in enumerate(panels):
            block, column = divmod(place, across)
            own = axes[block * len(quantities) : (block + 1) * len(quantities), column]
            if panel.title and len(panels) > 1:
                own[0].set_title(style.words(panel.title))
            for quantity, axis, first in zip(quantities, own, axes[:, 0], strict=False):
                if axis is not own[0]:
                    axis.sharex(own[0])
                if axis is not first:
                    axis.sharey(first)
                places = style.scale_x(axis, panel.points[panel.x])
                foot = style.scale_y(axis, shown, quantity)
                axis.tick_params(labelleft=column == 0, labelbottom=axis is own[-1])
                if column == 0:
                    axis.set_ylabel(style.label(points, quantity))
                hidden += _lines(axis, panel, quantity, look, places, foot)
            text = style.label(points, panel.x)
            own[-1].set_xlabel(text.replace(" $", "\n$") if across > _WIDE else text)
        for column in range(len(panels) - (blocks - 1) * across, across):
            for axis in axes[-len(quantities) :, column]:
                axis.remove()  # the last block is not full
        figure.align_ylabels()
        look.explain(figure, points)
        style.note(
            figure,
            style.intervals_note(points, quantities),
            f"arrows at the foot: mean not positive ({hidden})" if hidden else "",
            style.partial_note(points),
        )
    return figure


@dataclass(frozen=True)
class _Look:
    """How the values of one parameter, and the scenes of one panel, are told apart."""

    key: str | None
    colours: dict[Any, Any]  # empty: by the colour map of ``bar``
    bar: Any
    styles: dict[str, Any]  # of the scenes; empty where each has its own panel
    joined: bool

    @classmethod
    def of(cls, panels: Sequence[Panel], key: str | None, *, joined: bool) -> "_Look":
        import matplotlib as mpl
        import pandas as pd
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import LogNorm, Normalize

        shown = pd.concat([panel.points for panel in panels])
        styles: dict[str, Any] = {}
        if any(panel.points["scene"].nunique() > 1 for panel in panels):
            names = list(dict.fromkeys(shown["scene"]))
            styles = dict(zip(names, _SCENES * len(names), strict=False))
        if key is None:
            return cls(None, {}, None, styles, joined)
        ordered = shown[key].dtype.kind in "if"
        values = sorted(shown[key].dropna().unique()) if ordered else list(shown[key].unique())
        if not ordered or len(values) == 1:
            cycle = style.UNORDERED * (1 + len(values) // len(style.UNORDERED))
            return cls(key, dict(zip(values, cycle, strict=False)), None, styles, joined)
        if len(values) <= _MOST_LINES:
            colours = dict(zip(values, style.shades(len(values)), strict=True))
            return cls(key, colours, None, styles, joined)
        wide = values[0] > 0 and style.is_wide(shown[key])
        norm = LogNorm if wide else Normalize
        bar = ScalarMappable(norm(values[0], values[-1]), mpl.colormaps["viridis"])
        return cls(key, {}, bar, styles, joined)

    @property
    def groups(self) -> list[tuple[Any, Any, str]]:
        """Value, colour and marker of each line; one of all points where a bar tells them."""
        if not self.colours:
            return [(None, style.UNORDERED[0], style.MARKERS[0])]
        markers = style.MARKERS * (1 + len(self.colours) // len(style.MARKERS))
        return [(v, c, m) for (v, c), m in zip(self.colours.items(), markers, strict=False)]

    def explain(self, figure: "Figure", points: "pd.DataFrame") -> None:
        """Add the legend or the colour bar."""
        from matplotlib.lines import Line2D

        if self.bar is not None:
            bar = figure.colorbar(
                self.bar, ax=figure.axes, label=style.label(points, str(self.key))
            )
            low, high = self.bar.get_clim()
            if low > 0 and style.is_wide(points[self.key]):
                style.log_ticks(bar.ax.yaxis, low, high)
        handles = [
            Line2D([], [], color=colour, marker=marker, label=style.value_text(value),
                   linestyle="-" if self.joined else "none")
            for value, colour, marker in self.groups if self.colours
        ]  # fmt: skip
        title = style.label(points, self.key) if handles and self.key is not None else None
        handles += [
            Line2D([], [], color=style.GREY, linestyle=line, label=style.words(scene))
            for scene, line in self.styles.items()
        ]
        if handles:
            figure.legend(
                handles=handles,
                title=title,
                loc="outside lower center",
                ncols=min(len(handles), int(figure.get_figwidth() / 0.95)),
            )


def _lines(
    axis: "Axes",
    panel: Panel,
    quantity: str,
    look: _Look,
    places: "Mapping[Any, int] | None",
    foot: float | None,
) -> int:
    """Draw all lines of one panel; return how many means are marked at its foot."""
    hidden = 0
    for scene, of_scene in panel.points.groupby("scene", sort=False, observed=True):
        for turn, (value, colour, marker) in enumerate(look.groups):
            line = of_scene if value is None else of_scene[of_scene[look.key] == value]
            line = line[line[f"{quantity}_mean"].notna()]
            aside = turn - (len(look.groups) - 1) / 2
            if places is None:
                line = line.sort_values(panel.x)
                at = line[panel.x].to_numpy(dtype=np.float64)
            else:
                # Words have no order to join by a line: points side by side.
                at = line[panel.x].map(places).to_numpy(dtype=np.float64)
                at = at + 0.5 * aside / len(look.groups)
            if not len(line):
                continue
            drawn = style.marker_style(quantity, colour) | {"marker": marker}
            if scene in look.styles:
                drawn["linestyle"] = look.styles[str(scene)]
            if places is not None:
                drawn["linestyle"] = "none"
            hidden += _line(axis, at, line, quantity, drawn, look, foot, aside)
    return hidden


def _line(
    axis: "Axes",
    at: FloatArray,
    line: "pd.DataFrame",
    quantity: str,
    drawn: dict[str, Any],
    look: _Look,
    foot: float | None,
    aside: float,
) -> int:
    """Draw one line with its intervals; return how many means are marked at the foot."""
    mean, low, high = (
        line[f"{quantity}_{part}"].to_numpy(dtype=np.float64)
        for part in ("mean", "ci_low", "ci_high")
    )
    if foot is not None:
        # A logarithmic axis has no room below its foot: intervals are cut there, not left out.
        low, high = (np.where(end <= foot, foot * 0.99, end) for end in (low, high))
    if look.joined:
        bands(axis, at, low, high, drawn["color"], apart=drawn["linestyle"] == "none")
        axis.plot(at, mean if foot is None else np.where(mean > 0, mean, np.nan), **drawn)
    else:
        seen = np.ones(len(mean), dtype=bool) if foot is None else mean > 0
        colour = drawn["color"]
        if look.bar is not None:
            colour = look.bar.to_rgba(line[look.key].to_numpy(dtype=np.float64))
        axis.scatter(
            at[seen], mean[seen], color=colour if look.bar is None else colour[seen], s=12,
            marker=drawn["marker"], linewidths=0,
        )  # fmt: skip
        axis.vlines(at, low, high, color=colour, alpha=0.4, linewidth=1)
    if foot is None:
        return 0
    return _mark_foot(axis, at[mean <= 0], foot, "k" if look.bar else drawn["color"], aside)


def bands(
    axis: "Axes", at: FloatArray, low: FloatArray, high: FloatArray, colour: Any, *, apart: bool
) -> None:
    """Draw intervals as a band; as bars where points are ``apart`` or have no neighbour."""
    known = np.isfinite(low) & np.isfinite(high)
    beside = np.zeros(len(at) + 2, dtype=bool)
    beside[1:-1] = known
    alone = known & ~(beside[:-2] | beside[2:])
    if apart:
        alone = known
    axis.fill_between(
        at, low, high, where=(known & ~alone).tolist(), color=colour, alpha=0.2, linewidth=0
    )
    axis.vlines(at[alone], low[alone], high[alone], color=colour, alpha=0.4, linewidth=3)


def _mark_foot(axis: "Axes", at: FloatArray, foot: float, colour: Any, aside: float) -> int:
    """Mark points below a logarithmic axis by arrows at its foot; return how many."""
    from matplotlib.transforms import ScaledTranslation

    figure = axis.get_figure(root=True)
    if figure is not None and len(at):
        # Beside one another: all lines have the same foot.
        shift = ScaledTranslation(4 * aside / 72, 3 / 72, figure.dpi_scale_trans)
        axis.plot(
            at, np.full(len(at), foot), linestyle="none", marker=FOOT_MARK, markersize=5,
            color=colour, clip_on=False, zorder=5, transform=axis.transData + shift,
        )  # fmt: skip
    return len(at)
