"""A study on one HTML page that refers to nothing outside itself, to be mailed to a co-author."""

import base64
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shear_sim.aggregate import aggregate
from shear_sim.aggregate.columns import LANDMARKS, POINT_TABLES
from shear_sim.figures import CAPTIONS, style
from shear_sim.results import Failure, Results, ResultsError
from shear_sim.rheology import HARMONICS, LIMITS
from shear_sim.screen import duration
from shear_sim.statistics import SMALLEST_BOOTSTRAP
from shear_sim.summary import WORDS, in_short, notes
from shear_sim.tables import write_whole
from shear_sim.variation import by_scene, short_name

if TYPE_CHECKING:
    import pandas as pd

#: More points with flagged runs, or failures, than this are counted, not listed.
MOST_LISTED = 40
_LINE = 50  # letters of a cell that is not broken into lines
_SECTIONS = {
    "figures": "Figures",
    "numbers": "Numbers",
    "quality": "Quality",
    "methods": "How the numbers were made",
    "study": "What was run",
}
_METHODS = {
    "BCa": "bias-corrected and accelerated bootstrap",
    "percentile": "percentiles of the bootstrap, where BCa is undefined",
    "t": "Student's t with the jackknife's error",
    "t_log": "the same for the logarithm of a positive quantity",
    "equal": "all replicates are equal: no width",
}
_WORDS = WORDS | {
    "job", "kind", "reason", "why", "parameter", "unit", "values", "version", "git commit",
    "python", "numpy", "numba", "processor",
}  # fmt: skip
_RUN_BY = ("program", "version", "git_commit", "python", "numpy", "numba", "processor")


def write_report(folder: Path | str, *, tensor: str | None = None) -> Path:
    """Aggregate the results of a study, complete or not, and write ``report.html``.

    Parameters
    ----------
    folder : Path or str
        ``results/<study>``.
    tensor : {"periodic", "internal", "external"}, optional
        See `shear_sim.aggregate.make_tables`.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    ResultsError
        If ``folder`` is not a results folder, or cannot be written.
    TableError
        If its plan is missing or damaged.
    """
    results = Results.existing(Path(folder))
    known = results.fingerprint()  # first: results that come meanwhile may not be on the page
    tables = aggregate(results.folder, tensor=tensor)
    path = results.report_file
    try:
        text = f"{page(results, tables)}<!-- {known} -->\n"
        write_whole(path, text.encode(errors="replace"))  # a file's name may be in any encoding
    except OSError as error:
        msg = f"{path}: the report cannot be written ({error})"
        raise ResultsError(msg) from error
    return path


def page(results: Results, tables: "Mapping[str, pd.DataFrame]") -> str:
    """Return the page of a study whose figures have been drawn.

    Parameters
    ----------
    results : Results
        Its folder: the figures, the study file, the failures and the index of the runs.
    tables : mapping
        As `shear_sim.aggregate.make_tables` returns them.
    """
    runs = tables["runs"]
    made = _how_runs_were_made(results, runs)
    body = {
        "figures": _figures(results.figures),
        "numbers": _numbers(tables),
        "quality": _quality(tables, results.failures()),
        "methods": _methods(tables),
        "study": _study(results, tables, made),
    }
    sections = "".join(
        f'<section id="{name}"><h2>{_SECTIONS[name]}</h2>\n{"".join(parts)}</section>\n'
        for name, parts in body.items()
    )
    links = "".join(f'<a href="#{name}">{title}</a>' for name, title in _SECTIONS.items())
    lede = " · ".join(["report of a study", *_when(made)])
    done = ' class="partial"' if style.partial_note(runs) else ""
    name = escape(str(runs.attrs["study"]))
    css = Path(__file__).with_suffix(".css").read_text("utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{name}: report of a study</title>\n<style>\n{css}</style></head>\n<body>\n"
        f'<header><h1>{name}</h1><p class="lede">{lede}</p>\n'
        f"<div{done}>{_list(notes(tables))}</div><nav>{links}</nav></header>\n"
        f"<main>{sections}</main>\n</body></html>\n"
    )


def _how_runs_were_made(results: Results, runs: "pd.DataFrame") -> "pd.DataFrame":
    """Return the ``run`` block of the summaries of these runs, a row each."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the tables were made of the same index, with its warnings
        index = results.index()
    names = [name for name in index.column_names if name.startswith("run.")]
    made: pd.DataFrame = index.select(["job", *names]).to_pandas()
    made = made[made["job"].isin(runs["job"])].drop(columns="job")
    return made.rename(columns=lambda name: str(name).removeprefix("run."))


def _when(made: "pd.DataFrame") -> Iterator[str]:
    """Yield with what the runs were made, and when."""
    if "version" in made and made["version"].notna().any():
        yield escape(f"shear-sim {', '.join(sorted(made['version'].dropna().unique()))}")
    if "started" in made and made["started"].notna().any():
        days = made["started"].dropna().str[:10]
        first, last = days.min(), days.max()
        yield escape(first if first == last else f"{first} to {last}")


def _figures(folder: Path) -> Iterator[str]:
    """Yield all figures, embedded, at the size at which they are printed."""
    from PIL import Image

    shown = [name for name in CAPTIONS if (folder / f"{name}.png").exists()]
    for number, name in enumerate(shown, start=1):
        path = folder / f"{name}.png"
        with Image.open(path) as image:
            width, height = image.size
        data = base64.b64encode(path.read_bytes()).decode()
        caption = escape(CAPTIONS[name])
        yield (
            f'<figure id="{name}"><div class="scroll"><img alt="{caption}" width="{width}" '
            f'height="{height}" style="width:{width / style.DPI:.2f}in" '
            f'src="data:image/png;base64,{data}"></div>'
            f"<figcaption><strong>Figure {number}.</strong> {caption}</figcaption></figure>\n"
        )
    if not shown:
        yield "<p>There is nothing to draw yet.</p>"


def _numbers(tables: "Mapping[str, pd.DataFrame]") -> Iterator[str]:
    for title, headings, rows in in_short(tables):
        yield _table(title, headings, rows)
    names = ", ".join(f"<code>{name}</code>" for name in tables)
    yield (
        f'<p class="small">All columns of all rows, with their units, are in the folder '
        f"<code>tables</code> of the study, as Parquet and CSV: {names}.</p>"
    )


def _quality(
    tables: "Mapping[str, pd.DataFrame]", failures: Mapping[str, Failure]
) -> Iterator[str]:
    ranges = [
        f"{name.replace('_', ' ')} {'at most' if low == 0 else f'{low:g} to'} {high:g}"
        for name, (low, high) in LIMITS.items()
    ]
    yield (
        "<p>A run is flagged unless it begins at rest and comes to its end, with "
        f"{escape('; '.join(ranges))}.</p>"
    )
    runs = tables["runs"]
    flagged = runs[runs["flagged"]]
    if len(flagged):
        keys = [key for key in map(str, flagged) if "." in key and flagged[key].nunique() > 1]
        done = runs["point"].value_counts()
        rows = []
        for point, of_point in flagged.groupby("point", sort=False):
            first = of_point.iloc[0]
            why = Counter(word for run in of_point.to_dict("records") for word in _reasons(run))
            count = f"{len(of_point)} of {done[point]}"
            words = "; ".join(f"{word} {times}" for word, times in why.most_common())
            rows.append([first["scene"], *[first[key] for key in keys], count, words])
        headings = ["scene", *map(short_name, keys), "flagged", "why"]
        title = f"points with flagged runs{_cut(len(rows))}"
        yield _table(title, headings, rows[:MOST_LISTED])
    if failures:
        lines = [[one.job, one.kind, one.reason] for one in failures.values()]
        title = f"failed jobs{_cut(len(lines))}"
        yield _table(title, ["job", "kind", "reason"], lines[:MOST_LISTED])


def _reasons(run: Mapping[Any, Any]) -> list[str]:
    """Return why a run is flagged."""
    found = [run.get(name) for name in ("flags", "no_moduli", "no_steady")]
    return [
        word for words in found if isinstance(words, str) and words for word in words.split("; ")
    ]


def _cut(count: int) -> str:
    return f": {MOST_LISTED} of {count:,}" if count > MOST_LISTED else ""


def _methods(tables: "Mapping[str, pd.DataFrame]") -> Iterator[str]:
    """Yield how moduli, intervals, landmarks and contrasts were made: what holds for these."""
    if "curves" in tables:
        yield (
            "<p>G′ and G″ of a run are the first harmonics of a joint least-squares fit of "
            f"{HARMONICS} harmonics, a constant and a drift to the shear stress of the "
            f"{escape(tables['curves'].attrs['tensor'])} tensor, over whole periods after the "
            "first. The mean response of a point is that of the harmonics averaged over its "
            "replicates; tan δ, I₃/I₁ and other ratios are formed after.</p>"
        )
    if "steady" in tables:
        yield (
            "<p>Shear stress and viscosity in steady shear are means over the late half of the "
            "strain.</p>"
        )
    if tables.keys() & {*POINT_TABLES.values()} - {"curves", "steady"}:
        yield (
            "<p>Quantities in other tables with a row per point are means over replicates of what "
            "the model measures in each run.</p>"
        )
    points = next(tables[name] for name in POINT_TABLES.values() if name in tables)
    level, resamples, seed = (
        points[f"ci_{what}"].iloc[0] for what in ("level", "resamples", "seed")
    )
    paired = (
        "Replicate r starts from the same packing at every point, and is drawn or left out with "
        "all its points."
        if points.attrs["paired"]
        else "Every run has a packing of its own, and points are resampled each by itself."
    )
    yield (
        f"<p>Intervals are of {level:.0%} confidence and over replicates: the unit is the "
        "independent packing, never the sample or the cycle. They come from "
        f"{resamples:,} resamples (seed {seed}); landmarks and contrasts are computed anew in "
        f"each. {paired} With fewer than {SMALLEST_BOOTSTRAP} replicates they are Student's t. "
        "Used here:</p>"
    )
    counts: dict[str, int] = {}
    for table in tables.values():
        for name in table:
            if str(name).endswith("ci_method"):
                for method, count in table[name].value_counts().items():
                    counts[str(method)] = counts.get(str(method), 0) + int(count)
    used = [f"{m}, {counts[m]:,} times: {text}" for m, text in _METHODS.items() if m in counts]
    yield _list(used or ["no interval: each needs two replicates or more"])
    if len(tables.get("features", ())):
        found = set(tables["features"]["landmark"])
        yield "<p>Landmarks of a curve over the strain amplitude:</p>"
        yield _list([f"{n.replace('_', ' ')}: {t}" for n, t in LANDMARKS.items() if n in found])
        yield (
            "<p>Where a landmark lies beyond the amplitudes of the study the tables say so "
            "(“> 2”), and how many resamples do.</p>"
        )
    if len(tables.get("contrasts", ())):
        yield (
            "<p>Contrasts are ratios between two scenes or values, exponents d ln y/d ln x or "
            "slopes d ln y/dx. Their p-values are Student's t with the standard error, "
            "corrected by Holm's method within each family of comparisons. A bootstrap's interval "
            "may exclude no effect where p is 0.05 or more: its ends are not those of Student's "
            "t; p is then the one to go by.</p>"
        )


def _study(
    results: Results, tables: "Mapping[str, pd.DataFrame]", made: "pd.DataFrame"
) -> Iterator[str]:
    points = [tables[name] for name in POINT_TABLES.values() if name in tables]
    rows: list[list[Any]] = []
    varied: dict[str, list[str]] = {}
    for table in points:
        for key in map(str, table):
            if "." in key:
                values = [*dict.fromkeys(map(_text, table[key].dropna().sort_values()))]
                unit = table.attrs["units"][key]
                varied[key] = [unit if unit != "1" else "", ", ".join(values)]
    if varied:
        rows = [[key, *words] for key, words in varied.items()]
        yield _table("parameters that vary", ["parameter", "unit", "values"], rows)
    rows = []
    for table in points:
        for scene, of_scene in by_scene(table).groupby("scene", sort=False, observed=True):
            sums = [int(of_scene[name].sum()) for name in ("failed", "flagged")]
            runs = f"{of_scene['replicates'].sum():,} of {of_scene['planned'].sum():,}"
            rows.append([scene, len(of_scene), runs, *sums])
    yield _table("runs", ["scene", "points", "runs", "failed", "flagged"], rows)
    columns = [name for name in _RUN_BY if name in made]
    if columns:
        groups = made.groupby(columns, dropna=False)
        rows = [[*group, len(of_group)] for group, of_group in groups]
        yield _table("made with", [*(name.replace("_", " ") for name in columns), "runs"], rows)
    if "cpu_s" in made:
        yield f'<p class="small">{duration(float(made["cpu_s"].sum()))} of CPU in all.</p>'
    yield f"<h3>The study file</h3><pre>{escape(results.study_text())}</pre>"


def _list(lines: Sequence[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>\n"


def _text(cell: Any) -> str:
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)


def _table(title: str, headings: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """Return a table; columns of words are flush left, those of numbers right."""
    texts = [[_text(cell) for cell in row] for row in rows]
    kinds = []
    for place, heading in enumerate(headings):
        long = any(len(row[place]) > _LINE for row in texts)
        kinds.append((' class="long"' if long else ' class="words"') * (heading in _WORDS))
    head = "".join(f"<th{k}>{escape(h)}</th>" for k, h in zip(kinds, headings, strict=True))
    body = "".join(
        f"<tr>{''.join(f'<td{k}>{escape(t)}</td>' for k, t in zip(kinds, row, strict=True))}</tr>\n"
        for row in texts
    )
    title = escape(title[:1].upper() + title[1:])
    return (
        f'<div class="scroll table"><table><caption>{title}</caption>'
        f"<thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table></div>\n"
    )
