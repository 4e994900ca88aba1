"""Studies of any shape give figures that can be read: nothing cut, hidden, overlapping or tiny."""

import runpy
from itertools import pairwise
from pathlib import Path

import kelvin_voigt  # noqa: F401 - makes the model known
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from shear_sim.aggregate import aggregate, make_tables
from shear_sim.figures import CAPTIONS, draw, style
from shear_sim.results import Results
from shear_sim.runner import run_job
from shear_sim.study import load_study

SPRINGS = "model: {kind: kelvin_voigt, noise: 0.5}\n"
AMPLITUDES = "shear.strain_amplitude: [0.01, 0.1, 1.0]"
CURVES = {"moduli", "moduli_with_landmarks", "large_amplitude", "lissajous_elastic"}
CURVES |= {"lissajous_viscous", "quality"}
# The study file after the model, and the figures that it must give.
SHAPES = {
    "scenes, a crossed parameter and a branch": (
        f"""
scenes: {{stiff_springs: {{model.modulus: 400}}, soft: {{model.modulus: 50}}}}
sweep:
  - grid: {{{AMPLITUDES}, model.viscosity: [0.5, 5.0, 50.0]}}
  - {{name: rest, scenes: [soft], grid: {{{AMPLITUDES}, shear.pre_periods: [1.5, 2, 4]}}}}
replicates: 3
""",
        CURVES | {"moduli_branches", "landmarks", "landmarks_branches"},
    ),
    "one point": ("replicates: 2\n", {"quality"}),
    "one replicate of a curve": (f"sweep:\n  grid: {{{AMPLITUDES}}}\n", CURVES),
    "no amplitude": (
        "sweep:\n  grid: {model.modulus: [10, 1000], model.viscosity: [1, 2, 4]}\nreplicates: 2\n",
        {"moduli", "large_amplitude", "quality"},
    ),
    "words alone": (
        "sweep:\n  grid: {model.fault: [none, exit, kill]}\nreplicates: 2\n",
        {"moduli_branches", "quality"},
    ),
    "a random design": (
        """
sweep:
  sobol:
    points: 16
    ranges:
      shear.strain_amplitude: {from: 0.01, to: 1, scale: log}
      model.modulus: {from: 50, to: 5000, scale: log}
      model.viscosity: {from: 1, to: 3}
""",
        {"moduli", "moduli_branches", "large_amplitude", "quality"},
    ),
    "all varied together": (
        "sweep:\n  zip: {shear.strain_amplitude: [0.1, 0.2, 0.4], model.modulus: [10, 20, 40]}\n",
        {"moduli", "quality"},
    ),
    "many values": (
        f"""
sweep:
  grid:
    {AMPLITUDES}
    model.modulus: {{logspace: [1, 1e5, 13]}}
""",
        CURVES | {"landmarks"},
    ),
}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Return a function: results of a study of springs, with the jobs that ``keep`` wants."""

    def make(text, keep=lambda _: True):
        folder = tmp_path_factory.mktemp("study")
        file = folder / "springs.yaml"
        file.write_text(SPRINGS + text)
        planned = load_study(file)
        results = Results(folder / "results" / "springs")
        results.prepare(planned)
        for job in planned.jobs():
            if keep(job) and job.point.model.fault == "none":
                run_job(job, results.jobs)
        return results

    return make


def drawn(results, monkeypatch):
    """Return all figures of a study by name, with everything at its place but not written."""
    found = {}

    def place(figure, stem):
        FigureCanvasAgg(figure)
        figure.get_layout_engine().execute(figure)
        figure.set_layout_engine("none")
        figure.draw_without_rendering()  # legends take their places only now
        found[stem.stem] = figure
        return []

    monkeypatch.setattr(style, "save", place)
    draw(make_tables(results.folder), results.figures)
    return found


def faults(figure):
    """Return what cannot be read in a figure."""
    renderer = figure.canvas.get_renderer()
    page = figure.bbox.padded(1.0)
    texts = [
        text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()
    ]
    for axis in figure.axes:
        # Ticks outside the view are never drawn.
        for along, (low, high) in ((axis.xaxis, axis.get_xlim()), (axis.yaxis, axis.get_ylim())):
            kept = []
            for tick in along.get_major_ticks():
                inside = low <= tick.get_loc() <= high and tick.label1.get_visible()
                for label in (tick.label1, tick.label2):
                    if label in texts and not (inside and label is tick.label1):
                        texts.remove(label)
                if inside and tick.label1.get_text():
                    kept.append(tick.label1.get_window_extent(renderer))
            for one, two in pairwise(kept):
                if one.overlaps(two):
                    yield f"labels overlap on the axis {along.get_label_text()!r}"
    for text in texts:
        box = text.get_window_extent(renderer)
        if text.get_fontsize() < style.SMALL:
            yield f"{text.get_text()!r} is of {text.get_fontsize()} points"
        if not (
            page.x0 <= box.x0 and box.x1 <= page.x1 and page.y0 <= box.y0 and box.y1 <= page.y1
        ):
            yield f"{text.get_text()!r} is cut"
    for legend in figure.legends:
        box = legend.get_window_extent(renderer)
        if any(axis.get_window_extent(renderer).overlaps(box) for axis in figure.axes):
            yield "the legend is over the data"
    if figure.get_figwidth() > style.DOUBLE + 1e-9:
        yield f"{figure.get_figwidth()} inches wide: more than two columns"


@pytest.mark.parametrize("shape", SHAPES)
def test_studies_of_any_shape_give_figures_that_can_be_read(shape, study, monkeypatch):
    text, expected = SHAPES[shape]
    figures = drawn(study(text), monkeypatch)
    assert expected <= figures.keys() <= CAPTIONS.keys()
    assert {name: found for name, f in figures.items() if (found := list(faults(f)))} == {}


def test_every_figure_of_a_partial_study_says_n_of_n(study, monkeypatch):
    """Of one curve there is nothing at all, of another one point."""
    text, expected = SHAPES["scenes, a crossed parameter and a branch"]

    def keep(job):
        model, shear = job.point.model, job.point.shear
        return model.viscosity == 5.0 or (model.viscosity == 0.5 and shear.strain_amplitude < 0.05)

    results = study(text, keep)
    done = len(results.finished())
    figures = drawn(results, monkeypatch)
    assert expected - {"landmarks_branches"} <= figures.keys()
    for name, figure in figures.items():
        assert f"PARTIAL STUDY: {done} of 72 runs" in figure.get_suptitle(), name
        assert list(faults(figure)) == [], name


ANALYSIS = Path(__file__).parents[1] / "analysis"


def test_programs_that_draw_ones_own_figures(study, tmp_path, monkeypatch):
    """Those of analysis/, on the tables of a small study."""
    monkeypatch.setattr(style, "DPI", 50)
    text, _ = SHAPES["scenes, a crossed parameter and a branch"]
    results = study(text)
    aggregate(results.folder, figures=False)
    job = next(iter(results.finished()))
    arguments = {
        "fig_contact_laws": [],
        "fig_landmarks": [results.folder, "model.viscosity"],
        "fig_run": [results.job_file(job)],
        "fig_scenes": [results.folder, "soft", "tan_delta,loss_modulus"],
    }
    assert arguments.keys() == {path.stem for path in ANALYSIS.glob("fig_*.py")}
    for name, given in arguments.items():
        program = runpy.run_path(str(ANALYSIS / f"{name}.py"))
        monkeypatch.setattr("sys.argv", [name, *map(str, given), str(tmp_path / name)])
        program["main"]()
        assert (tmp_path / f"{name}.png").stat().st_size > 1000
        assert (tmp_path / f"{name}.pdf").stat().st_size > 1000
