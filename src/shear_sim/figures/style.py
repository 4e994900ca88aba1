"""What all figures have in common: sizes, type, colours, symbols, the words on axes, scales.

Figures are drawn at the size at which they are printed (one column of a journal or two), with no
letter below 7 points. Lines are told apart by colour and by marker; G' has filled markers and
solid lines, G'' open markers and dashed lines.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shear_sim.tables import write_whole
from shear_sim.variation import AMPLITUDE, FRICTION, short_name

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from PIL.Image import Image as Picture

FloatArray = NDArray[np.float64]

DPI = 300
SINGLE, DOUBLE, PAGE = 3.5, 7.2, 9.4  # inches: one column, two columns, the height of a page
WIDTHS = {1: SINGLE, 2: 5.2}  # by panels side by side; DOUBLE for more
SMALL = 7.0  # points: the smallest letters
GREY = "0.3"

_RC: dict[Any, Any] = {
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.titley": 1.0,  # where it is anyway; looking for a better place costs a lot
    "axes.labelsize": 8.5,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 8,
    "legend.title_fontsize": 8,
    "legend.frameon": False,
    "figure.titlesize": 7.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.minor.width": 0.4,
    "ytick.minor.width": 0.4,
    "axes.grid": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.8,
    "lines.markeredgewidth": 0.9,
}
MARKERS = "osD^vPX<>ph*"
_LARGER = "*|"  # markers of little area
# Okabe & Ito: told apart with any colour vision. For values without an order.
UNORDERED = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STORAGE, LOSS = UNORDERED[:2]  # where G' and G'' share a panel
#: Quantities with open markers and dashed lines.
OPEN = frozenset({"loss_modulus", "viscosity"})
_SIGNED = frozenset({"stiffening_ratio", "thickening_ratio"})  # 0 is in the middle of their axes
_ALIKE = 10  # difference of two colours, of 255
_WIDE = 8  # largest / smallest value from which an axis of a parameter is logarithmic
_FEW = 5  # values of a parameter that are labelled themselves
_NEAR = 0.15  # of the axis: values nearer to one another have no room for their labels
_DIGITS = 6  # letters of a number that is written in full
_LONG, _SHORT_PARTS, _SHORT_DECADES = 1e5, 1e-3, 0.1  # plain numbers on a logarithmic axis
_LETTERS = 20  # of all names on an axis, from which they are turned
_METHODS = {"t": "Student's t", "t_log": "Student's t on logarithms"}
_SYMBOLS = {
    AMPLITUDE: "strain amplitude $\\gamma_0$",
    "shear.relative_frequency": "relative frequency $f\\tau$",
    "shear.relative_rate": "relative strain rate $\\dot\\gamma\\tau$",
    FRICTION: "friction $\\mu$",
    "model.young_modulus": "Young's modulus $E$",
    "model.contact_law.kind": "contact law",
    "model.links.cuts": "cuts",
    "model.links.remove_fraction": "removed links",
    "packing.packing_fraction": "packing fraction $\\phi$",
    "packing.discs": "discs $N$",
    "storage_modulus": "storage modulus $G'$",
    "loss_modulus": "loss modulus $G''$",
    "shear_stress": "shear stress $\\tau$",
    "viscosity": "viscosity $\\eta$",
    "strain": "strain amplitude $\\gamma_0$",
    "total_stress": "stress $|G^*|\\gamma_0$",
    "complex_modulus": "complex modulus $|G^*|$",
    "tan_delta": "loss tangent $\\tan\\delta$",
    "third_harmonic_ratio": "$I_3/I_1$",
    "stiffening_ratio": "stiffening $S$",
    "thickening_ratio": "thickening $T$",
}


@contextmanager
def figure(width: float, height: float) -> "Iterator[Figure]":
    """Give a figure of this size [inch] to draw on, in the common style."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_RC):
        # Figure, not pyplot: no window, no backend, nothing global that keeps it alive.
        yield Figure(figsize=(width, height), layout="constrained")


@contextmanager
def small_multiples(
    count: int, across: int, height: float = 1.7
) -> "Iterator[tuple[Figure, list[Axes]]]":
    """Give a figure with ``count`` panels that share both axes, ``across`` side by side.

    Rows are ``height`` [inch] high, or as high as fits a page, but no less than an inch. Axes are
    labelled where no panel follows below or on the left.
    """
    rows = math.ceil(count / across)
    height = min(height, max((PAGE - 1.1) / rows, 1.0))  # longer than a page rather than flat
    with figure(WIDTHS.get(across, DOUBLE), rows * height + 1.1) as drawn:
        axes = drawn.subplots(rows, across, squeeze=False, sharex=True, sharey=True).flatten()
        for spare in axes[count:]:
            spare.remove()
        for place, axis in enumerate(axes[:count]):
            axis.tick_params(labelbottom=place + across >= count, labelleft=place % across == 0)
        yield drawn, list(axes[:count])


def note(figure: "Figure", *notes: str) -> None:
    """Write small above a figure what it shows and how much of a partial study is there.

    Each note begins a line, broken to the width of the figure; empty ones are left out.
    """
    import textwrap

    letters = int(figure.get_figwidth() * 15)
    lines = [line for note in notes for line in textwrap.wrap(note, letters)]
    figure.suptitle("\n".join(lines), color=GREY)


def save(figure: "Figure", stem: Path) -> list[Path]:
    """Write ``<stem>.png`` and ``<stem>.pdf``; the same figure gives the same files.

    Returns
    -------
    list of Path
        The files written.
    """
    paths = [stem.with_suffix(".png"), stem.with_suffix(".pdf")]
    for path in paths:
        save_as(figure, path)
    return paths


def save_as(figure: "Figure", path: Path, *, dpi: int = DPI, colours: int | None = None) -> None:
    """Write a figure as PNG or PDF, by the ending of ``path``, whole; see `save`.

    A PNG has at most so many ``colours``: by default 256, or all where there is a bar of them.
    """
    import matplotlib as mpl
    from PIL import Image

    with mpl.rc_context(_RC):
        figure.set_dpi(dpi)
        # Finding places for everything costs more than drawing it: once, for all files.
        if (layout := figure.get_layout_engine()) is not None:
            layout.execute(figure)
            figure.set_layout_engine("none")
        if path.suffix == ".pdf":
            # Without the library's version and the time in it, the same figure is the same file.
            nothing = dict.fromkeys(("Creator", "Producer", "CreationDate"))
            made = BytesIO()
            figure.savefig(made, format="pdf", dpi=dpi, metadata=nothing)
            write_whole(path, made.getvalue())
            return
        drawn = BytesIO()
        figure.savefig(drawn, format="rgba", dpi=dpi)
        size = int(figure.bbox.width), int(figure.bbox.height)
        whole = Image.frombytes("RGBA", size, drawn.getvalue()).convert("RGB")
        if colours is None and not any(a.get_label() == "<colorbar>" for a in figure.axes):
            # Without a gradient, a palette of 256 makes a third of the file, and looks the same.
            colours = 256
        if colours is not None:
            whole = whole.quantize(palette=palette([whole], colours), dither=Image.Dither.NONE)
        made = BytesIO()
        whole.save(made, "png", dpi=(dpi, dpi))
        write_whole(path, made.getvalue())


def palette(pictures: "Sequence[Picture]", count: int = 256) -> "Picture":
    """Return one set of at most ``count`` colours for pictures (RGB) of one width.

    Areas and lines keep exactly their colours: those are few and frequent. What lies between them,
    at edges, is near enough.
    """
    from PIL import Image

    sheet = Image.new("RGB", (pictures[0].width, sum(each.height for each in pictures)))
    top = 0
    for each in pictures:
        sheet.paste(each, (0, top))
        top += each.height
    exact = count * 3 // 8
    found = sorted(sheet.getcolors(1 << 24) or [], reverse=True)
    often = np.array([colour for _, colour in found[: 4 * exact]], np.int64)
    rest = sheet.quantize(
        count - exact, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
    )
    between = np.array(rest.getpalette(), np.int64).reshape(-1, 3)
    chosen = np.zeros((0, 3), np.int64)
    for most, candidates in ((exact, often), (count, between)):
        for colour in candidates:
            # Pillow may take either of two that are near one another.
            if len(chosen) < most and (np.abs(chosen - colour).max(axis=1) >= _ALIKE).all():
                chosen = np.vstack([chosen, colour])
    made = Image.new("P", (1, 1))
    made.putpalette(chosen.ravel().tolist())
    return made


def shades(count: int) -> "list[Any]":
    """Return colours for ``count`` values in order, dark to light."""
    import matplotlib as mpl

    # Up to 0.85: the yellow end is not seen on paper.
    return list(mpl.colormaps["viridis"](np.linspace(0.0, 0.85, count)))


def marker_style(quantity: str, colour: Any, marker: str) -> dict[str, Any]:
    """Return how a quantity's markers and lines are drawn: filled and solid, or open and dashed."""
    drawn: dict[str, Any] = {"color": colour, "marker": marker, "linestyle": "-"}
    if marker in _LARGER:
        drawn |= {"markersize": 7, "markeredgewidth": 1.4 if marker == "|" else 0.4}
    if quantity in OPEN:
        drawn |= {"markerfacecolor": "white", "linestyle": (0, (4, 1.6))}
    return drawn


def mark_style(marker: str) -> dict[str, Any]:
    """Return how a mark on a line is drawn: black, with a white edge where it has an area."""
    if marker == "|":
        return {"marker": marker, "markersize": 8, "markeredgewidth": 1.5, "color": "k"}
    size = 8.5 if marker == "*" else 5.5
    return {
        "marker": marker, "markersize": size, "markeredgewidth": 0.4, "markeredgecolor": "w",
        "color": "k",
    }  # fmt: skip


def label(points: "pd.DataFrame", name: str) -> str:
    """Return the axis label of a column (a quantity's without ``_mean``), with its unit."""
    units = points.attrs.get("units", {})
    unit = units.get(name, units.get(f"{name}_mean", ""))
    text = title(name)
    return f"{text} [{unit}]" if unit and unit != "1" else text


def title(name: str) -> str:
    """Return the name of a parameter or quantity with its symbol."""
    return _SYMBOLS.get(name, short_name(name))


def symbol(key: str) -> str:
    """Return the symbol of a parameter or quantity, its short name where it has none."""
    _, dollar, rest = _SYMBOLS.get(key, "").partition("$")
    return dollar + rest if dollar else short_name(key)


def words(name: str) -> str:
    """Return a name of the study file as it is read aloud."""
    return name.replace("_", " ")


def value_text(value: Any) -> str:
    """Return a value of a parameter in short; numbers of many digits are cut to three."""
    if value is None or value != value:  # nan
        return "none"
    if not isinstance(value, int | float) or isinstance(value, bool):
        return words(str(value))
    text = f"{value:g}"
    return text if len(text) <= _DIGITS else f"{float(f'{value:.3g}'):g}"


def partial_note(table: "pd.DataFrame") -> str:
    """Return "PARTIAL STUDY: n of N runs", or nothing where all are there."""
    done, planned = table.attrs["done"], table.attrs["planned"]
    return "" if done == planned else f"PARTIAL STUDY: {done:,} of {planned:,} runs"


def left_out_note(key: str | None, shown: Sequence[Any], values: Sequence[Any]) -> str:
    """Return how many values of a parameter are drawn, or nothing where all are."""
    if key is None or len(shown) == len(values):
        return ""
    return f"{len(shown)} of {len(values)} values of {symbol(key)} are drawn"


def tensor_note(table: "pd.DataFrame") -> str:
    """Return whose moduli a table holds, or nothing where they are of all contacts."""
    tensor = table.attrs["tensor"]
    return "" if tensor == "periodic" else f"moduli of the {tensor} tensor"


def intervals_note(points: "pd.DataFrame", quantities: Sequence[str]) -> str:
    """Return in words how many replicates and which intervals a figure shows."""
    counts = points.loc[points["replicates"] > 0, "replicates"]
    few, many = int(counts.min()), int(counts.max())
    number = f"{few} replicate{'' if few == many == 1 else 's'}"
    if few < many:
        number = f"{few} to {many} replicates"
    how = methods(points, quantities)
    if not how:
        return f"{number}, no intervals"
    level = float(points["ci_level"].iloc[0])
    return f"{number}; {level:.0%} intervals ({how})"


def methods(points: "pd.DataFrame", quantities: Sequence[str]) -> str:
    """Return the methods of the intervals of some quantities in words, nothing without any."""
    found = {m for q in quantities for m in points[f"{q}_ci_method"].dropna().unique()}
    return ", ".join(_METHODS.get(m, m) for m in sorted(found - {"", "none", "equal"}))


def is_wide(values: "pd.Series[Any]") -> bool:
    """Whether numbers span so much that a logarithmic axis suits them."""
    positive = values[values > 0]
    wide = len(positive) > 0 and float(positive.max()) / float(positive.min()) >= _WIDE
    return wide or values.name == AMPLITUDE


def scale_x(axis: "Axes", values: "pd.Series[Any]") -> "Mapping[Any, int] | None":
    """Scale the axis for these values; return the places of values that are no numbers."""
    if values.dtype.kind not in "if":
        names = sorted(values.unique(), key=str)
        texts = [value_text(name) for name in names]
        axis.set_xticks(range(len(names)), texts)
        if sum(map(len, texts)) > _LETTERS:
            axis.tick_params("x", rotation=35)
        axis.set_xlim(-0.5, len(names) - 0.5)
        return {name: place for place, name in enumerate(names)}
    from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

    few = np.unique(values.dropna().to_numpy(dtype=np.float64))
    positive = few[few > 0]
    places = few
    if is_wide(values) and len(positive) == len(few):
        axis.set_xscale("log")
        places = np.log(few)
        if len(few) > _FEW:
            log_ticks(axis.xaxis, float(few[0]), float(few[-1]))
    elif is_wide(values) and few[0] >= 0:
        axis.set_xscale("symlog", linthresh=positive[0], linscale=0.5)
        axis.set_xlim(-0.3 * positive[0], 1.4 * positive[-1])
        places = np.log(np.maximum(few, positive[0] / 3))
    crowded = len(few) > 1 and np.diff(places).min() < _NEAR * np.ptp(places)
    if 1 < len(few) <= _FEW and not crowded:  # label the values themselves
        axis.xaxis.set_major_locator(FixedLocator(few.tolist()))
        axis.xaxis.set_major_formatter(FixedFormatter([value_text(v) for v in few.tolist()]))
    axis.xaxis.set_minor_locator(NullLocator())
    return None


def scale_y(axis: "Axes", shown: "pd.DataFrame", quantities: Sequence[str]) -> float | None:
    """Scale an axis of quantities; return the foot of a logarithmic one, None for a linear one."""

    def values(part: str) -> FloatArray:
        columns = [shown[f"{quantity}_{part}"].to_numpy(np.float64) for quantity in quantities]
        found: FloatArray = np.concatenate(columns)
        return np.asarray(found[np.isfinite(found)])

    mean, low, high = values("mean"), values("ci_low"), values("ci_high")
    positive = mean[mean > 0]
    if len(mean) == 0:
        return None
    # Mostly negative (a stress under negative shear) is better read on a linear axis; so is a
    # quantity that hardly changes.
    few = 2 * len(positive) < len(mean)
    if _SIGNED.issuperset(quantities) or few or positive.max() / positive.min() < 5:
        # A wild interval is cut: it must not flatten all curves.
        span = float(max(np.ptp(mean), np.abs(mean).max())) or 1.0
        least, most = float(mean.min()) - 0.5 * span, float(mean.max()) + 0.5 * span
        bottom = max(least, min(float(low.min(initial=np.inf)), float(mean.min())))
        top = min(most, max(float(high.max(initial=-np.inf)), float(mean.max())))
        axis.set_ylim(bottom - 0.05 * span, top + 0.05 * span)
        return None
    least, most = float(positive.min()), float(positive.max())
    # Intervals count up to a decade beyond the means: one wild band must not flatten all curves.
    foot = max(float(low[low > 0].min()), least / 10) if (low > 0).any() else least
    top = min(float(high.max()), most * 10) if len(high) else most
    foot, top = min(foot, least) / 1.3, max(top, most) * 1.3
    axis.set_yscale("log")
    axis.set_ylim(foot, top)
    log_ticks(axis.yaxis, foot, top)
    return foot


def log_ticks(axis: "Axis", low: float, high: float) -> None:
    """Label each decade; over less than two 1, 2 and 5, or 1 and 3.

    Numbers are plain where they are short at both ends, so that G' over three decades and G'' over
    one are labelled alike; else powers of ten.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    few = high / low < 100
    if few:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 20 else (1.0, 3.0)))
    else:
        decades = math.ceil(math.log10(high / low))
        axis.set_major_locator(LogLocator(numticks=max(4, min(decades + 2, 8))))
    plain = high < _LONG and low >= (_SHORT_PARTS if few else _SHORT_DECADES)
    axis.set_major_formatter(
        FuncFormatter(lambda value, _: f"{value:g}" if plain else _power(value))
    )
    # Ticks between are most of what a figure of many panels costs, and no one counts them.
    axis.set_minor_locator(NullLocator())


def _power(value: float) -> str:
    """Return 3·10⁻³ in letters: the mathematics of a label costs ten times as much to set."""
    mantissa, _, exponent = f"{value:e}".partition("e")
    power = "10" + str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return power if float(mantissa) == 1 else f"{float(mantissa):g}·{power}"
