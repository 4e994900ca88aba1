"""A grid of panels: quantities in rows, panels in columns, lines told apart by colour and marker.

On a logarithmic axis a mean of 0 or below stands as an arrow at the foot of the panel, and the
figure counts them; an interval that reaches down to zero is a thin bar, cut at the foot: as a band
it would cover all others.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from shear_sim.figures import style
from shear_sim.figures.style import FloatArray

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_LINES = 12  # more values than this are told by a colour bar, not by a legend
_MOST_ACROSS = 5  # panels side by side
_WIDE = 3  # more panels than this side by side are narrower than a label
_APART = 0.075  # inches beside such panels: the labels at the ends of two axes must not read as one
_HIGH = 1.7  # inches: rows less high are shorter than a label
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
    look: "Look",
    note: str = "",
    decorate: "Callable[[Axes, Panel, str, Mapping[Any, int] | None], None] | None" = None,
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
    look : Look
        How lines are told apart.
    note : str
        What else a reader must know.
    decorate : callable, optional
        Adds to each axis, of (axis, panel, quantity, places of x where that is no number).
    """
    import pandas as pd

    shown = pd.concat([panel.points for panel in panels])
    blocks = math.ceil(len(panels) / _MOST_ACROSS)
    across = math.ceil(len(panels) / blocks)
    rows = blocks * len(quantities)
    width = style.WIDTHS.get(across, style.DOUBLE)
    high = min(1.95, max((style.PAGE - 1.0) / rows, 1.3))
    hidden = 0
    with style.figure(width, high * rows + 0.9) as figure:
        if across > _WIDE and (layout := figure.get_layout_engine()) is not None:
            layout.set(w_pad=_APART)  # type: ignore[call-arg]
        axes = figure.subplots(rows, across, squeeze=False)
        firsts = axes[: len(quantities), 0]
        own = [
            axes[block * len(quantities) : (block + 1) * len(quantities), column]
            for block in range(blocks)
            for column in range(across)
        ]
        for column in own[: len(panels)]:
            for axis, first in zip(column, firsts, strict=True):
                if axis is not column[0]:
                    axis.sharex(column[0])
                if axis is not first:
                    axis.sharey(first)
        feet = [style.scale_y(a, shown, [q]) for a, q in zip(firsts, quantities, strict=True)]
        for place, (panel, column) in enumerate(zip(panels, own, strict=False)):
            places = style.scale_x(column[0], panel.points[panel.x])
            if panel.title and len(panels) > 1:
                column[0].set_title(style.words(panel.title))
            for quantity, axis, foot in zip(quantities, column, feet, strict=True):
                axis.tick_params(labelleft=place % across == 0, labelbottom=axis is column[-1])
                if place % across == 0:
                    text = style.label(points, quantity)
                    axis.set_ylabel(text.replace(" $", "\n$") if high < _HIGH else text)
                hidden += _lines(axis, panel, quantity, look, places, foot)
                if decorate is not None:
                    decorate(axis, panel, quantity, places)
            text = style.label(points, panel.x)
            column[-1].set_xlabel(text.replace(" $", "\n$") if across > _WIDE else text)
        for column in own[len(panels) :]:
            for axis in column:
                axis.remove()  # the last block is not full
        figure.align_ylabels()
        look.explain(figure)
        style.note(
            figure,
            style.intervals_note(points, quantities),
            style.tensor_note(points),
            f"arrows at the foot: 0 or below ({hidden})" if hidden else "",
            note,
            style.partial_note(points),
        )
    return figure


class Group(NamedTuple):
    """The lines of one value of a parameter."""

    value: Any  # None: all points
    colour: Any
    marker: str
    text: str


@dataclass(frozen=True)
class Look:
    """How lines are told apart, and whether points are joined by lines.

    ``key`` is the column that colour and marker tell, ``groups`` its values; with a colour ``bar``
    points that are not joined are one group. ``styles`` of lines tell the scenes where several
    share a panel. Intervals are ``bands`` (bars where a point has no neighbour), or bars.
    """

    key: str | None
    groups: Sequence[Group]
    styles: Mapping[str, Any]
    joined: bool
    bands: bool = True
    bar: Any = None
    title: str | None = None

    @classmethod
    def by(cls, key: str | None, panels: Sequence[Panel], points: Any, *, joined: bool) -> "Look":
        """Tell the values of ``key`` apart: by a colour map where they have an order."""
        import matplotlib as mpl
        import pandas as pd
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import LogNorm, Normalize

        shown = pd.concat([panel.points for panel in panels])
        styles: dict[str, Any] = {}
        if any(panel.points["scene"].nunique() > 1 for panel in panels):
            names = list(dict.fromkeys(shown["scene"]))
            styles = dict(zip(names, _SCENES * len(names), strict=False))
        everything = [Group(None, style.UNORDERED[0], style.MARKERS[0], "")]
        if key is None:
            return cls(None, everything, styles, joined)
        ordered = shown[key].dtype.kind in "if"
        values = sorted(shown[key].dropna().unique()) if ordered else list(shown[key].unique())
        if ordered and len(values) > _MOST_LINES:
            norm = LogNorm if values[0] > 0 and style.is_wide(shown[key]) else Normalize
            bar = ScalarMappable(norm(values[0], values[-1]), mpl.colormaps["viridis"])
            if joined:
                everything = [Group(v, bar.to_rgba(v), style.MARKERS[0], "") for v in values]
            return cls(key, everything, styles, joined, bar=bar, title=style.label(points, key))
        colours: Sequence[Any] = style.UNORDERED * len(values)
        if ordered and len(values) > 1:
            colours = style.shades(len(values))
        groups = [
            Group(value, colour, marker, style.value_text(value))
            for value, colour, marker in zip(
                values, colours, style.MARKERS * len(values), strict=False
            )
        ]
        return cls(key, groups, styles, joined, title=style.label(points, key))

    def explain(self, figure: "Figure") -> None:
        """Add the legend or the colour bar."""
        from matplotlib.colors import LogNorm
        from matplotlib.lines import Line2D

        if self.bar is not None:
            bar = figure.colorbar(self.bar, ax=figure.axes, label=self.title)
            if isinstance(self.bar.norm, LogNorm):
                style.log_ticks(bar.ax.yaxis, *self.bar.get_clim())
        handles = [
            Line2D(
                [], [], label=group.text,
                **style.marker_style("", group.colour, group.marker)
                | ({} if self.joined else {"linestyle": "none"}),
            )
            for group in self.groups if group.text
        ]  # fmt: skip
        title = self.title if handles else None
        handles += [
            Line2D([], [], color=style.GREY, linestyle=line, label=style.words(scene))
            for scene, line in self.styles.items()
        ]
        if handles:
            letters = max(len(str(handle.get_label())) for handle in handles)
            columns = int(figure.get_figwidth() / (0.5 + 0.065 * letters))
            figure.legend(
                handles=handles,
                title=title,
                loc="outside lower center",
                ncols=max(1, min(len(handles), columns)),
            )


def _lines(
    axis: "Axes",
    panel: Panel,
    quantity: str,
    look: Look,
    places: "Mapping[Any, int] | None",
    foot: float | None,
) -> int:
    """Draw all lines of one panel; return how many means are marked at its foot."""
    hidden = 0
    for scene, of_scene in panel.points.groupby("scene", sort=False, observed=True):
        for turn, (value, colour, marker, _) in enumerate(look.groups):
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
            drawn = style.marker_style(quantity, colour, marker)
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
    look: Look,
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
        apart = drawn["linestyle"] == "none" or not look.bands
        if foot is not None and not apart:
            below = low < foot
            _thin_bars(axis, at[below], low[below], high[below], drawn["color"], aside)
            low = np.where(below, np.nan, low)
        bands(axis, at, low, high, drawn["color"], apart=apart)
        axis.plot(at, mean if foot is None else np.where(mean > 0, mean, np.nan), **drawn)
    else:
        seen = np.ones(len(mean), dtype=bool) if foot is None else mean > 0
        colour = drawn["color"]
        if look.bar is not None:
            drawn["color"] = "k"  # of the arrows at the foot
            colour = look.bar.to_rgba(line[look.key].to_numpy(dtype=np.float64))
        axis.scatter(
            at[seen], mean[seen], color=colour if look.bar is None else colour[seen], s=12,
            marker=drawn["marker"], linewidths=0,
        )  # fmt: skip
        axis.vlines(at, low, high, color=colour, alpha=0.4, linewidth=1)
    if foot is None:
        return 0
    return _mark_foot(axis, at[mean <= 0], foot, drawn["color"], aside)


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


def _thin_bars(
    axis: "Axes", at: FloatArray, low: FloatArray, high: FloatArray, colour: Any, aside: float
) -> None:
    """Draw intervals as thin bars, those of different lines beside one another."""
    from matplotlib.transforms import ScaledTranslation

    figure = axis.get_figure(root=True)
    if figure is not None and len(at):
        shift = ScaledTranslation(1.5 * aside / 72, 0, figure.dpi_scale_trans)
        axis.vlines(
            at, low, high, color=colour, alpha=0.5, linewidth=0.7, zorder=1,
            transform=axis.transData + shift,
        )  # fmt: skip


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
