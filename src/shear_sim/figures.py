"""Figures of a study, drawn from its tables alone.

Whatever parameters vary, the first figure has the strain amplitude on its axis (else the first
parameter that is a number), one panel per scene and one colour per friction (else another
parameter crossed with it). Parameters varied beside those each get a panel in the second figure.
Every figure of a partial study says how much of it is there.

On a logarithmic axis a mean that is not positive stands as an open triangle at the foot of the
panel, and the figure counts them; an interval that reaches zero is cut at the foot.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from shear_sim.variation import AMPLITUDE, FRICTION, Variation, by_scene, short_name, variation

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

DPI = 300

_WIDTH = 7.2  # inches: two columns of a journal
_STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.8,
}
_MARKERS = "osD^vPX<>ph*"
# Okabe & Ito: told apart with any colour vision. For values without an order.
_UNORDERED = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_WIDE = 8  # largest / smallest value from which an axis of a parameter is logarithmic
_FEW = 5  # values of a logarithmic axis that are labelled themselves
_MOST_LINES = 12  # more values than this are told by a colour bar, not by a legend
_SYMBOLS = {
    AMPLITUDE: "strain amplitude $\\gamma_0$",
    "shear.relative_frequency": "relative frequency $f\\tau$",
    "shear.relative_rate": "relative strain rate $\\dot\\gamma\\tau$",
    FRICTION: "friction $\\mu$",
    "model.young_modulus": "Young's modulus $E$",
    "model.contact_law.kind": "contact law",
    "model.links.cuts": "cuts",
    "model.links.remove_fraction": "removed fraction of links",
    "packing.packing_fraction": "packing fraction $\\phi$",
    "packing.discs": "discs $N$",
    "storage_modulus": "storage modulus $G'$",
    "loss_modulus": "loss modulus $G''$",
    "shear_stress": "shear stress $\\tau$",
    "viscosity": "viscosity $\\eta$",
}


def draw(
    tables: "Mapping[str, pd.DataFrame]", folder: Path, example: Mapping[str, Any] | None = None
) -> list[Path]:
    """Draw all figures that ``tables`` allow into ``folder``; return their paths.

    Parameters
    ----------
    tables : mapping
        ``moduli`` or ``steady``, as `shear_sim.aggregate.aggregate` returns them.
    folder : Path
        Made where it does not exist.
    example : mapping, optional
        The arguments of `example_run`.
    """
    figures: dict[str, Figure] = {}
    for name, quantities in (
        ("moduli", ("storage_modulus", "loss_modulus")),
        ("steady", ("shear_stress", "viscosity")),
    ):
        if name not in tables:
            continue
        points = tables[name]
        if not points["replicates"].any():
            continue
        plan = variation(points)
        if plan.x is not None:
            figures[name] = curves(points, quantities)
        if plan.branches:
            figures[f"{name}_branches"] = branches(points, quantities)
    if example is not None:
        figures["example"] = example_run(**example)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, figure in figures.items():
        paths.append(folder / f"{name}.png")
        # Without the library's version in it, the same figure is the same file.
        figure.savefig(paths[-1], dpi=DPI, metadata={"Software": None})
    return paths


def curves(points: "pd.DataFrame", quantities: Sequence[str]) -> "Figure":
    """Draw quantities against the table's x: a row for each, a column per scene.

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
    line = _at_reference(table, plan, plan.branches)
    joined = bool(line[x].nunique() > 1)
    table = line if joined else table
    scenes = list(dict.fromkeys(table["scene"]))
    panels = [(scene, table[table["scene"] == scene], x) for scene in scenes]
    return _figure(points, quantities, panels, plan.colour, joined=joined)


def branches(points: "pd.DataFrame", quantities: Sequence[str]) -> "Figure":
    """Draw quantities against each parameter of the branches: a row each, a column per parameter.

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
        part = _at_reference(table, plan, others)
        cell = part.groupby(["scene", plan.x] if plan.x else ["scene"])[key]
        part = part[cell.transform("nunique") > 1]
        joined = joined or len(part) > 0
        panels.append(("", part if len(part) else table, key))
    return _figure(points, quantities, panels, plan.x, joined=joined)


def _at_reference(table: "pd.DataFrame", plan: Variation, keys: Sequence[str]) -> "pd.DataFrame":
    """Return the points whose ``keys`` have the reference values of their scene."""
    keep = np.ones(len(table), dtype=bool)
    for key in keys:
        wanted = table["scene"].map(
            {scene: values[key] for scene, values in plan.reference.items()}
        )
        keep &= ((table[key] == wanted) | (table[key].isna() & wanted.isna())).to_numpy(dtype=bool)
    return table[keep]


def _figure(
    points: "pd.DataFrame",
    quantities: Sequence[str],
    panels: "Sequence[tuple[str, pd.DataFrame, str]]",
    colour: str | None,
    *,
    joined: bool,
) -> "Figure":
    """Draw a grid: a row per quantity, a column per panel (title, points, parameter on x)."""
    import matplotlib as mpl
    import pandas as pd
    from matplotlib.figure import Figure

    shown = pd.concat([part for _, part, _ in panels])
    look = _Look.of(shown, colour, joined=joined)
    rows, columns = len(quantities), len(panels)
    with mpl.rc_context(_STYLE):
        # Figure, not pyplot: no window, no backend, nothing global that keeps it alive.
        size = (max(_WIDTH, 1.8 * columns) if columns > 1 else 4.5, 2.1 * rows + 0.9)
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False, sharex="col", sharey="row")
        hidden = 0
        for quantity, across in zip(quantities, axes, strict=True):
            foot = _scale_y(across[0], shown, quantity)
            for (title, part, x), axis in zip(panels, across, strict=True):
                place = _scale_x(axis, part[x])
                hidden += _lines(axis, part, x, quantity, look, place, foot)
                if quantity == quantities[0] and title and columns > 1:
                    axis.set_title(_words(title))
                if quantity == quantities[-1]:
                    axis.set_xlabel(_label(points, x))
            across[0].set_ylabel(_label(points, quantity))
        figure.align_ylabels()
        look.explain(figure, axes, points)
        notes = [_intervals_in_words(points, quantities)]
        if hidden:
            notes.append(f"open triangles: mean not positive ({hidden})")
        if partial := partial_note(points):
            notes.append(partial)
        figure.suptitle("; ".join(notes), fontsize=7.5, color="0.3")
    return figure


@dataclass(frozen=True)
class _Look:
    """How the values of one parameter, and the scenes of one panel, are told apart."""

    key: str | None
    colours: dict[Any, Any]  # empty: by the colour map of ``bar``
    bar: Any
    styles: dict[str, Any]
    joined: bool

    @classmethod
    def of(cls, shown: "pd.DataFrame", key: str | None, *, joined: bool) -> "_Look":
        import matplotlib as mpl
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import LogNorm, Normalize

        scenes = list(dict.fromkeys(shown["scene"]))
        styles = dict(zip(scenes, ("-", "--", ":", "-.") * len(scenes), strict=False))
        if key is None:
            return cls(None, {}, None, styles, joined)
        ordered = shown[key].dtype.kind in "if"
        values = sorted(shown[key].dropna().unique()) if ordered else list(shown[key].unique())
        if not ordered or len(values) == 1:
            cycle = _UNORDERED * (1 + len(values) // len(_UNORDERED))
            return cls(key, dict(zip(values, cycle, strict=False)), None, styles, joined)
        viridis = mpl.colormaps["viridis"]
        if len(values) <= _MOST_LINES:
            # Up to 0.85: the yellow end is not seen on paper.
            shades = viridis(np.linspace(0.0, 0.85, len(values)))
            return cls(key, dict(zip(values, shades, strict=True)), None, styles, joined)
        wide = values[0] > 0 and values[-1] / values[0] >= _WIDE
        norm = LogNorm if wide else Normalize
        return cls(key, {}, ScalarMappable(norm(values[0], values[-1]), viridis), styles, joined)

    def explain(self, figure: "Figure", axes: Any, points: "pd.DataFrame") -> None:
        """Add the legend or the colour bar."""
        from matplotlib.lines import Line2D

        if self.bar is not None:
            bar = figure.colorbar(self.bar, ax=axes, label=_label(points, str(self.key)))
            low, high = self.bar.get_clim()
            if low > 0 and high / low >= _WIDE:
                _log_ticks(bar.ax.yaxis, low, high)
        handles = [
            Line2D([], [], color=colour, marker=marker, label=_value(value))
            for (value, colour), marker in zip(self.colours.items(), self.markers(), strict=False)
        ]
        title = _label(points, self.key) if handles and self.key is not None else None
        single_scene_panels = len(axes[0]) == len(self.styles) > 1 and axes[0][0].get_title()
        if len(self.styles) > 1 and not single_scene_panels:
            handles += [
                Line2D([], [], color="0.3", linestyle=style, label=_words(scene))
                for scene, style in self.styles.items()
            ]
        if handles:
            columns = min(len(handles), 6)
            figure.legend(
                handles=handles,
                title=title,
                loc="outside lower center",
                ncols=columns,
                frameon=False,
            )

    def markers(self) -> str:
        return _MARKERS * (1 + len(self.colours) // len(_MARKERS))


def _lines(
    axis: "Axes",
    part: "pd.DataFrame",
    x: str,
    quantity: str,
    look: _Look,
    place: "Mapping[Any, int] | None",
    foot: float | None,
) -> int:
    """Draw all lines of one panel; return how many means are marked at its foot."""
    titled = part["scene"].nunique() == 1
    hidden = 0
    for scene, of_scene in part.groupby("scene", sort=False):
        style = "-" if titled else look.styles[str(scene)]
        groups = (
            [(None, of_scene)]
            if look.key is None or not look.colours
            else [(value, of_scene[of_scene[look.key] == value]) for value in look.colours]
        )
        for turn, ((value, line), marker) in enumerate(zip(groups, look.markers(), strict=False)):
            known = line[line[f"{quantity}_mean"].notna()]
            aside = turn - (len(groups) - 1) / 2
            if place is None:
                known = known.sort_values(x)
                at = known[x].to_numpy(dtype=np.float64)
            else:
                # Words have no order to join by a line: points side by side.
                at = known[x].map(place).to_numpy(dtype=np.float64) + 0.5 * aside / len(groups)
            if not len(known):
                continue
            colour = look.colours.get(value, _UNORDERED[0])
            if look.bar is not None and look.key is not None:
                colour = look.bar.to_rgba(known[look.key].to_numpy(dtype=np.float64))
            line_style = style if place is None else "none"
            hidden += _line(
                axis, at, known, quantity, colour, marker, line_style, look, foot, aside
            )
    return hidden


def _line(
    axis: "Axes",
    at: "np.ndarray[Any, Any]",
    line: "pd.DataFrame",
    quantity: str,
    colour: Any,
    marker: str,
    style: str,
    look: _Look,
    foot: float | None,
    aside: float,
) -> int:
    """Draw one line with its intervals; return how many means are marked at the foot."""
    from matplotlib.transforms import ScaledTranslation

    mean, low, high = (
        line[f"{quantity}_{part}"].to_numpy(dtype=np.float64)
        for part in ("mean", "ci_low", "ci_high")
    )
    if foot is not None:
        # A logarithmic axis has no room below its foot: intervals are cut there, not left out.
        low, high = (np.where(end <= foot, foot * 0.99, end) for end in (low, high))
    if not look.joined:
        seen = np.ones(len(mean), dtype=bool) if foot is None else mean > 0
        colours = colour if look.bar is None else colour[seen]
        axis.scatter(at[seen], mean[seen], c=colours, s=12, marker=marker, linewidths=0)
        axis.vlines(at, low, high, color=colour, alpha=0.4, linewidth=1)
    else:
        shown = mean if foot is None else np.where(mean > 0, mean, np.nan)
        axis.plot(at, shown, linestyle=style, marker=marker, color=colour)
        known = np.isfinite(low)
        beside = np.zeros(len(at) + 2, dtype=bool)
        beside[1:-1] = known
        alone = known & ~(beside[:-2] | beside[2:])
        if style == "none":
            alone = known
        axis.fill_between(
            at, low, high, where=(known & ~alone).tolist(), color=colour, alpha=0.2, linewidth=0
        )
        # A band needs two neighbours.
        axis.vlines(at[alone], low[alone], high[alone], color=colour, alpha=0.4, linewidth=3)
    if foot is None:
        return 0
    below = mean <= 0
    if (figure := axis.get_figure(root=True)) is not None and below.any():
        # Beside one another: all lines have the same foot.
        shift = ScaledTranslation(5 * aside / 72, 0, figure.dpi_scale_trans)
        axis.plot(
            at[below], np.full(below.sum(), foot), linestyle="none", marker="v", markersize=5,
            markerfacecolor="white", color="k" if look.bar is not None else colour, clip_on=False,
            zorder=5, transform=axis.transData + shift,
        )  # fmt: skip
    return int(below.sum())


def _scale_x(axis: "Axes", values: "pd.Series[Any]") -> dict[Any, int] | None:
    """Scale the axis for these values; return the places of values that are no numbers."""
    if values.dtype.kind not in "if":
        names = sorted(values.unique(), key=str)
        axis.set_xticks(range(len(names)), [_value(name) for name in names])
        axis.set_xlim(-0.5, len(names) - 0.5)
        return {name: place for place, name in enumerate(names)}
    from matplotlib.ticker import FixedFormatter, FixedLocator, NullFormatter

    positive = values[values > 0]
    wide = len(positive) > 0 and positive.max() / positive.min() >= _WIDE
    wide = wide or values.name == AMPLITUDE
    if wide and len(positive) == len(values):
        axis.set_xscale("log")
        few = sorted(values.unique())
        if len(few) <= _FEW:  # label the values themselves
            axis.xaxis.set_major_locator(FixedLocator(few))
            axis.xaxis.set_major_formatter(FixedFormatter([_value(v) for v in few]))
            axis.xaxis.set_minor_formatter(NullFormatter())
        else:
            _log_ticks(axis.xaxis, float(values.min()), float(values.max()))
    elif wide and (values >= 0).all():
        axis.set_xscale("symlog", linthresh=float(positive.min()))
    return None


def _scale_y(axis: "Axes", shown: "pd.DataFrame", quantity: str) -> float | None:
    """Scale a row of panels; return the foot of a logarithmic axis, None for a linear one."""
    mean = shown[f"{quantity}_mean"].dropna()
    positive = mean[mean > 0]
    # Mostly negative (a stress under negative shear) is better read on a linear axis; so is a
    # quantity that hardly changes.
    if len(positive) * 2 < len(mean) or positive.max() / positive.min() < 5:
        return None
    least, most = float(positive.min()), float(positive.max())
    low, high = shown[f"{quantity}_ci_low"], shown[f"{quantity}_ci_high"]
    # Intervals count up to a decade beyond the means: one wild band must not flatten all curves.
    foot = max(float(low[low > 0].min()), least / 10) if (low > 0).any() else least
    top = min(float(high.max()), most * 10) if high.notna().any() else most
    foot, top = min(foot, least) / 1.3, max(top, most) * 1.3
    axis.set_yscale("log")
    axis.set_ylim(foot, top)
    _log_ticks(axis.yaxis, foot, top)
    return foot


def _log_ticks(axis: "Axis", low: float, high: float) -> None:
    """Label each decade; over less than two decades 1, 2 and 5 of each, as plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    if high / low < 100:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    else:
        axis.set_major_locator(LogLocator(numticks=12))
    axis.set_minor_formatter(NullFormatter())


def partial_note(points: "pd.DataFrame") -> str:
    """Return "partial study: n of N runs", or nothing where all are there."""
    done, planned = int(points["replicates"].sum()), int(points["planned"].sum())
    return "" if done == planned else f"PARTIAL STUDY: {done:,} of {planned:,} runs"


def _intervals_in_words(points: "pd.DataFrame", quantities: Sequence[str]) -> str:
    counts = points.loc[points["replicates"] > 0, "replicates"]
    few, many = int(counts.min()), int(counts.max())
    number = f"{few}" if few == many else f"{few} to {many}"
    methods = {m for q in quantities for m in points[f"{q}_ci_method"].unique()} - {"none", "equal"}
    if not methods:
        return f"means of {number} replicate(s), without intervals"
    level = float(points["ci_level"].iloc[0])
    return f"means of {number} replicates, {level:.0%} intervals ({', '.join(sorted(methods))})"


def _label(points: "pd.DataFrame", name: str) -> str:
    """Return the axis label of a column (a quantity's without ``_mean``), with its unit."""
    units = points.attrs.get("units", {})
    unit = units.get(name, units.get(f"{name}_mean", ""))
    words = _SYMBOLS.get(name, short_name(name))
    return f"{words} [{unit}]" if unit and unit != "-" else words


def _words(name: str) -> str:
    return name.replace("_", " ")


def _value(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) else _words(str(value))


def example_run(
    columns: "Mapping[str, np.ndarray[Any, Any]]",
    protocol: Mapping[str, Any],
    moduli: Mapping[str, Any] | None,
    title: str,
) -> "Figure":
    """Draw strain and shear stress of one run against time, and one against the other.

    Parameters
    ----------
    columns : mapping of (R,) arrays
        ``time`` [s], ``strain`` [-] and ``shear_stress`` [Pa].
    protocol : mapping
        The ``protocol`` block of the run's summary.
    moduli : mapping, optional
        Its moduli of the periodic tensor: the ellipse of the first harmonics is drawn over the
        Lissajous curve.
    title : str
        Says which run it is.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    time, strain, stress = (columns[name] for name in ("time", "strain", "shear_stress"))
    start, end = protocol["shear_start"], protocol["shear_end"]
    oscillatory = protocol["kind"] == "oscillatory"
    unit = protocol["period"] if oscillatory else 1.0
    clock = (time - start) / unit
    blue, orange = _UNORDERED[:2]
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(_WIDTH, 3.3), layout="constrained")
        axes = figure.subplot_mosaic("ac;bc", width_ratios=[1.25, 1])
        axes["b"].sharex(axes["a"])
        axes["a"].plot(clock, strain, color=blue)
        axes["a"].set_ylabel(r"strain $\gamma$")
        axes["a"].tick_params(labelbottom=False)
        axes["b"].plot(clock, stress, color=orange, linewidth=0.8)
        axes["b"].set_ylabel(r"shear stress $\tau$ [Pa]")
        axes["b"].set_xlabel("time $(t-t_0)/T$" if oscillatory else "time $t-t_0$ [s]")
        for name in "ab":
            axes[name].axvspan(0.0, (end - start) / unit, color="0.96", zorder=0)
            axes[name].margins(x=0.0)
        loops = axes["c"]
        sheared = (clock >= 0) & (time <= end)
        if not oscillatory:
            loops.plot(strain[sheared], stress[sheared], color=orange, linewidth=0.8)
        else:
            cycles = max(1, math.floor(protocol["periods"] + 1e-6))
            for cycle in range(cycles):
                rows = sheared & (clock >= cycle) & (clock <= cycle + 1)
                last = cycle == cycles - 1
                loops.plot(
                    strain[rows], stress[rows], color=orange if last else "0.6",
                    linewidth=1.2 if last else 0.7, zorder=3 if last else 2,
                    label="last period" if last else "before" if cycle == 0 else None,
                )  # fmt: skip
        if oscillatory and moduli is not None:
            angle = np.linspace(0, 2 * np.pi, 200)
            amplitude = protocol["strain_amplitude"]
            wave = moduli["in_phase"] * np.sin(angle) + moduli["out_of_phase"] * np.cos(angle)
            ellipse = moduli["offset"] + wave
            loops.plot(
                amplitude * np.sin(angle), ellipse, "k--", linewidth=0.8, zorder=4,
                label="first harmonic",
            )  # fmt: skip
        if oscillatory:
            figure.legend(*loops.get_legend_handles_labels(), loc="outside lower right", ncols=3,
                          frameon=False)  # fmt: skip
        loops.set_xlabel(r"strain $\gamma$")
        loops.set_ylabel(r"shear stress $\tau$ [Pa]")
        figure.suptitle(title, fontsize=8)
    return figure
