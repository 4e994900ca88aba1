"""What the figures show, read back from their artists; how they look is for the eye."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from figure_tables import (
    AMPLITUDE,
    AMPLITUDES,
    FRICTION,
    MODULI,
    attributed,
    features,
    harmonics,
    main_study,
    points,
    runs,
)
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex, to_rgb
from PIL import Image

from shear_sim.figures import (
    CAPTIONS,
    branches,
    contact_laws,
    curves,
    draw,
    example_run,
    flow_laws,
    landmark_parameters,
    landmarks,
    lissajous,
    moduli_with_landmarks,
    quality,
    style,
)
from shear_sim.figures.lissajous import _mean_waves
from shear_sim.figures.panels import FOOT_MARK
from shear_sim.variation import by_scene, variation


def lines(axis):
    return [line for line in axis.get_lines() if line.get_marker() not in ("None", FOOT_MARK)]


def test_a_study_is_read_from_its_table():
    """The cut tells the scenes apart, and the end of the plateau follows from the law."""
    found = variation(main_study())
    assert found.x == "shear.strain_amplitude"
    assert found.colour == "model.friction"
    assert found.branches == ("model.young_modulus", "model.contact_law.kind")
    assert found.reference["gel"]["model.young_modulus"] == 8000.0
    assert found.reference["gel"]["model.contact_law.kind"] == "divergent"


def test_without_an_amplitude_the_first_number_that_varies_is_the_axis():
    table = points(
        [{"model.contact_law.kind": k, "model.friction": f} for k in "ab" for f in (0.1, 1)]
    )
    found = variation(table)
    assert (found.x, found.colour) == ("model.friction", "model.contact_law.kind")
    assert found.branches == ()


def test_curves_have_a_panel_per_scene_and_a_line_per_friction_at_the_reference():
    figure = curves(main_study(), MODULI)
    assert len(figure.axes) == 4
    gel, loose, gel_loss, _ = figure.axes
    assert [gel.get_title(), loose.get_title()] == ["gel", "loose"]
    assert (gel.get_xscale(), gel.get_yscale()) == ("log", "log")
    assert gel_loss.get_xlabel() == "strain amplitude $\\gamma_0$"
    assert gel.get_ylabel() == "storage modulus $G'$ [Pa]"
    assert len(lines(gel)) == 3
    first = lines(gel)[0]
    assert first.get_xdata().tolist() == AMPLITUDES  # the branches' points are not among them
    assert first.get_ydata() == pytest.approx([1000 / (1 + a / 0.01) for a in AMPLITUDES])
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["0.01", "0.1", "1"]


def test_branches_have_a_panel_per_parameter_and_a_line_per_amplitude_at_which_it_varies():
    figure = branches(main_study(), MODULI)
    young, law = figure.axes[:2]
    assert [line.get_xdata().tolist() for line in lines(young)] == [[2000, 8000, 32000]] * 2
    assert figure.axes[2].get_xlabel() == "Young's modulus $E$ [Pa]"
    assert figure.axes[3].get_xlabel() == "contact law"
    assert [text.get_text() for text in figure.axes[3].get_xticklabels()] == [
        "divergent",
        "plateau",
    ]
    assert all(line.get_linestyle() == "None" for line in lines(law))  # words are not joined
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["0.01", "1"]


def test_a_mean_that_is_not_positive_is_marked_at_the_foot_and_counted():
    values = dict(zip(AMPLITUDES, (1000.0, 100.0, 10.0, -3.0), strict=True))
    table = points([{"shear.strain_amplitude": a, "storage_modulus": g} for a, g in values.items()])
    figure = curves(table, ("storage_modulus",))
    (axis,) = figure.axes
    assert axis.get_yscale() == "log"
    (mark,) = [line for line in axis.get_lines() if line.get_marker() == FOOT_MARK]
    assert mark.get_xdata().tolist() == [1.0]
    assert mark.get_ydata().tolist() == [axis.get_ylim()[0]]
    assert "arrows at the foot: 0 or below (1)" in figure.get_suptitle()


def test_an_interval_that_reaches_zero_is_a_thin_bar_down_to_the_foot():
    """As a band it would be a wedge from the neighbour's mean to the foot of the panel."""
    table = points(
        [
            {"shear.strain_amplitude": a, "storage_modulus": g, "storage_modulus_ci_low": low}
            for a, g, low in ((0.01, 100.0, 90.0), (0.1, 10.0, 9.0), (1.0, 5.0, -4.0))
        ]
    )
    (axis,) = curves(table, ("storage_modulus",)).axes
    foot = axis.get_ylim()[0]
    assert foot > 0
    (bar,) = [
        segment
        for c in axis.collections
        if isinstance(c, LineCollection)
        for segment in c.get_segments()
    ]
    high = table["storage_modulus_ci_high"].iloc[2]
    assert bar == pytest.approx(np.array([[1.0, 0.99 * foot], [1.0, high]]))
    (band,) = [c for c in axis.collections if not isinstance(c, LineCollection)]
    assert set(band.get_paths()[0].vertices[:, 0]) == {0.01, 0.1}


def test_a_point_without_an_interval_has_no_band():
    """One replicate among points of many: no interval is invented for it."""
    table = points(
        [
            {
                "shear.strain_amplitude": a,
                "storage_modulus": 100.0 / a,
                "storage_modulus_ci_low": np.nan if a == 0.1 else 90.0 / a,
                "storage_modulus_ci_high": np.nan if a == 0.1 else 110.0 / a,
            }
            for a in (0.001, 0.01, 0.1, 1.0)
        ]
    )
    (axis,) = curves(table, ("storage_modulus",)).axes
    band, bars = axis.collections
    assert {x for path in band.get_paths() for x in path.vertices[:, 0]} == {0.001, 0.01}
    assert [path.vertices[0, 0] for path in bars.get_paths()] == [1.0]  # it has no neighbour


def test_mostly_negative_quantities_are_drawn_on_a_linear_axis():
    table = points(
        [{"shear.strain_amplitude": a, "storage_modulus": -100.0 * a} for a in AMPLITUDES]
    )
    (axis,) = curves(table, ("storage_modulus",)).axes
    assert axis.get_yscale() == "linear"
    assert lines(axis)[0].get_ydata().tolist() == [-100.0 * a for a in AMPLITUDES]


@pytest.mark.parametrize("make", [curves, branches])
def test_a_partial_study_says_n_of_n(make):
    table = main_study()
    total = table.attrs["done"]
    table.attrs["done"] -= 7
    note = f"PARTIAL STUDY: {total - 7} of {total} runs"
    assert note in make(table, MODULI).get_suptitle()
    assert "PARTIAL" not in make(main_study(), MODULI).get_suptitle()


@pytest.mark.parametrize("make", [curves, branches])
def test_moduli_that_are_not_of_all_contacts_are_called_so(make):
    table = main_study()
    assert "tensor" not in make(table, MODULI).get_suptitle()
    table.attrs["tensor"] = "internal"
    assert "moduli of the internal tensor" in make(table, MODULI).get_suptitle()


def test_a_random_design_is_drawn_as_points():
    rng = np.random.default_rng(1)
    keys = ("shear.strain_amplitude", "model.friction", "model.young_modulus")
    table = points([dict(zip(keys, rng.uniform(0.1, 1, 3), strict=True)) for _ in range(20)])
    (axis,) = curves(table, ("storage_modulus",)).axes
    assert not lines(axis)
    assert len(axis.collections[0].get_offsets()) == 20
    friction, young, _bar = branches(table, ("storage_modulus",)).axes
    assert len(friction.collections[0].get_offsets()) == 20
    assert len(young.collections[0].get_offsets()) == 20


def test_nothing_to_draw_against_is_an_error():
    table = points([{"model.contact_law.kind": kind} for kind in "ab"])
    with pytest.raises(ValueError, match="no numeric parameter varies"):
        curves(table, MODULI)
    with pytest.raises(ValueError, match="no branches"):
        branches(points([{"shear.strain_amplitude": a} for a in AMPLITUDES]), MODULI)


def oscillation():
    time = np.linspace(0.0, 6.0, 1201)
    sheared = (time >= 2) & (time <= 5)
    strain = np.where(sheared, 0.1 * np.sin(2 * np.pi * (time - 2)), 0.0)
    columns = {"time": time, "strain": strain, "shear_stress": 1000.0 * strain}
    protocol = {
        "kind": "oscillatory",
        "strain_amplitude": 0.1,
        "period": 1.0,
        "shear_start": 2.0,
        "shear_end": 5.0,
        "periods": 3.0,
    }
    return columns, protocol


def test_example_run_with_the_ellipse_of_its_moduli():
    columns, protocol = oscillation()
    moduli = {"in_phase": 100.0, "out_of_phase": 0.0, "offset": 0.0}
    figure = example_run(columns, protocol, moduli, "one run")
    loops = figure.axes[1]
    *_, last, ellipse = loops.get_lines()
    assert last.get_ydata() == pytest.approx(1000 * last.get_xdata(), abs=1e-9)
    assert len(last.get_xdata()) == 201
    assert ellipse.get_ydata() == pytest.approx(1000 * ellipse.get_xdata(), abs=1e-9)


def test_a_long_title_stays_on_the_page():
    title = "job 0123456789abcdef: crosslinked, " + ", ".join(["packing fraction 1.23456"] * 12)
    figure = example_run(*oscillation(), None, title)
    FigureCanvasAgg(figure).draw()
    box = figure._suptitle.get_window_extent()
    assert " ".join(figure._suptitle.get_text().split()) == title
    assert box.x0 > 0
    assert box.x1 < figure.bbox.width


def test_a_point_with_values_of_its_own_is_drawn_without_a_complaint(caplog):
    """Matplotlib takes one colour of three or four numbers for a list of values, and says so."""
    rng = np.random.default_rng(2)
    keys = ("shear.strain_amplitude", "model.friction", "model.young_modulus")
    table = points([dict(zip(keys, rng.uniform(0.1, 1, 3), strict=True)) for _ in range(8)])
    assert variation(table).reference == {"gel": {}}
    branches(table, MODULI)
    curves(table, MODULI)
    assert caplog.records == []


def test_example_of_a_steady_shear():
    columns, _ = oscillation()
    columns["strain"] = np.clip(columns["time"] - 2, 0, 3)
    protocol = {"kind": "steady", "shear_start": 2.0, "shear_end": 5.0}
    figure = example_run(columns, protocol, None, "one run")
    (loop,) = figure.axes[1].get_lines()
    assert loop.get_xdata()[-1] == pytest.approx(3.0)


def softening_at_friction(name, point):
    """Softening at μ and yield at 10 μ + 0.1; the peak of G'' only where μ < 1; no plateau."""
    friction = point[FRICTION]
    if name == "low_strain_plateau":
        return AMPLITUDES[0]
    peak = np.inf if friction == 1.0 else 2 * friction
    return {"softening": friction, "loss_peak": peak, "yield": 0.1 + 10 * friction}[name]


def test_moduli_of_each_curve_with_their_landmarks():
    table = main_study()
    figure = moduli_with_landmarks(table, features(table, softening_at_friction))
    titles = [axis.get_title() for axis in figure.axes]
    expected = [f"{s}, $\\mu$ = {f:g}" for s in ("gel", "loose") for f in (0.01, 0.1, 1)]
    assert titles == expected
    first = figure.axes[0]
    storage, loss = lines(first)[:2]
    assert storage.get_ydata() == pytest.approx([1000 / (1 + a / 0.01) for a in AMPLITUDES])
    assert storage.get_markerfacecolor() == storage.get_color()
    assert loss.get_markerfacecolor() == "white"
    marks = {line.get_label(): line.get_xdata()[0] for line in lines(first)[2:]}
    assert marks == {"softening": 0.01, "peak of $G''$": 0.02, "yield, $G'=G''$": 0.2}
    bars = [c.get_segments() for c in first.collections if isinstance(c, LineCollection)]
    ends = sorted(tuple(bar[0][:, 0]) for bar in bars if len(bar) == 1)
    assert ends == [pytest.approx((0.9 * x, 1.1 * x)) for x in (0.01, 0.02, 0.2)]
    # Each bar at a height of its own: they could be told apart even if all had the same ends.
    single = [
        c for c in first.collections if isinstance(c, LineCollection) and len(c.get_segments()) == 1
    ]
    heights = {round(c.get_transform().transform((0.1, 0))[1], 3) for c in single}
    assert len(heights) == 3
    # Beyond the amplitudes at μ = 1: no mark.
    assert "peak of $G''$" not in {line.get_label() for line in figure.axes[2].get_lines()}


def test_methods_of_the_intervals_of_landmarks_are_those_of_the_marks_drawn():
    table = main_study()
    found = features(table, softening_at_friction)
    found["strain_ci_method"] = np.where(found["landmark"] == "yield", "percentile", "BCa")
    found.loc[found["censored"] != "", "strain_ci_method"] = "t"  # not drawn
    heading = " ".join(moduli_with_landmarks(table, found).get_suptitle().split())
    assert "intervals of the strain of landmarks (BCa, percentile)" in heading


def test_too_many_curves_for_a_page_are_thinned_and_counted():
    frictions = np.logspace(-3, 0, 40)
    table = points([{AMPLITUDE: a, FRICTION: f} for a in AMPLITUDES for f in frictions])
    figure = moduli_with_landmarks(table)
    assert len(figure.axes) == 30
    titles = [axis.get_title() for axis in figure.axes]
    assert (titles[0], titles[-1]) == ("$\\mu$ = 0.001", "$\\mu$ = 1")
    assert "30 of 40 values of $\\mu$ are drawn" in figure.get_suptitle()


@pytest.mark.parametrize("draw_curves", [moduli_with_landmarks, lissajous])
def test_points_that_form_no_curves_are_refused(draw_curves):
    table = points([{FRICTION: friction} for friction in (0.1, 1.0)])
    more = [] if draw_curves is moduli_with_landmarks else [harmonics(table, [1], [1]), "elastic"]
    with pytest.raises(ValueError, match="no curves over shear"):
        draw_curves(table, *more)


def test_landmarks_against_friction():
    table = main_study()
    found = features(table, softening_at_friction)
    assert landmark_parameters(found)[0] == FRICTION
    figure = landmarks(found, [FRICTION])
    assert [axis.get_title() for axis in figure.axes[:2]] == ["gel", "loose"]
    gel = figure.axes[0]
    by_marker = {line.get_marker(): line for line in gel.get_lines()}
    assert by_marker["v"].get_xdata().tolist() == [0.01, 0.1, 1.0]
    assert by_marker["v"].get_ydata().tolist() == [0.01, 0.1, 1.0]
    assert by_marker["*"].get_ydata() == pytest.approx([0.2, 1.1, 10.1])
    assert by_marker["^"].get_ydata() == pytest.approx([0.02, 0.2])
    # The peak at μ = 1 lies beyond the amplitudes: an arrow at the largest of them.
    arrow = by_marker["$\\uparrow$"]
    assert (arrow.get_xdata().tolist(), arrow.get_ydata().tolist()) == ([1.0], [1.0])
    assert arrow.get_color() == by_marker["^"].get_color()
    assert by_marker["None"].get_xdata().tolist() == by_marker["None"].get_ydata().tolist()
    assert "dotted: $\\gamma_0=\\mu$" in figure.get_suptitle()
    stress = figure.axes[4]
    assert stress.get_ylabel() == "stress $|G^*|\\gamma_0$ [Pa]"
    assert {line.get_marker() for line in stress.get_lines()} == {"v", "*"}


def test_landmarks_of_much_coarser_curves_are_not_compared():
    """The branches of the study have two amplitudes, where the curves have four."""
    found = features(main_study(), softening_at_friction)
    assert landmark_parameters(found) == [FRICTION]
    with pytest.raises(ValueError, match="no two curves differ in one of"):
        landmarks(found, ["model.young_modulus"])
    # As fine as the others, they are.
    even = features(main_study(), softening_at_friction)
    even["amplitudes"] = 4
    names = [FRICTION, "model.young_modulus", "model.contact_law.kind"]
    assert sorted(landmark_parameters(even)) == sorted(names)
    law = landmarks(even, ["model.contact_law.kind"]).axes[-1]
    assert [text.get_text() for text in law.get_xticklabels()] == ["divergent", "plateau"]


def corners(collection):
    return [path.vertices for path in collection.get_paths()]


@pytest.mark.parametrize("kind", ["elastic", "viscous"])
def test_lissajous_curves_of_a_spring_and_a_dashpot_are_ellipses(kind):
    """τ = A (G' sin θ + G'' cos θ), over √(G'² + G''²) A."""
    storage, loss = 3.0, 4.0
    table = points([{AMPLITUDE: a, FRICTION: f} for a in (0.1, 1.0) for f in (0.0, 0.5, 1.0)])
    figure = lissajous(table, harmonics(table, [storage], [loss]), kind)
    (axis,) = figure.axes
    filled, loops, parts, firsts = (corners(c) for c in axis.collections[2:])
    assert len(loops) == len(parts) == len(firsts) == len(filled) == 6
    # The mean over the replicates, (0.5 + 1.5)/2 = 1 times these moduli, at A = 1 and μ = 1.
    theta = np.linspace(0, 2 * np.pi, len(loops[0]))
    abscissa = np.sin(theta) if kind == "elastic" else np.cos(theta)
    stress = (storage * np.sin(theta) + loss * np.cos(theta)) / 5.0
    slope = {"elastic": 0.6, "viscous": 0.8}[kind]
    loop = next(c for c in loops if c[:, 0].min() > 0.5 and c[:, 1].min() > 1.5)
    part = next(c for c in parts if c[:, 0].min() > 0.5 and c[:, 1].min() > 1.5)
    half = (loop[:, 0].max() - loop[:, 0].min()) / 2
    assert (loop - [1, 2]) / half == pytest.approx(np.column_stack([abscissa, stress]), abs=1e-3)
    assert (part - [1, 2])[:, 1] == pytest.approx(slope * (part - [1, 2])[:, 0], abs=1e-4)
    assert np.array(firsts) == pytest.approx(np.array(loops))
    assert [t.get_text() for t in axis.get_xticklabels()] == ["0.1", "1"]
    assert [t.get_text() for t in axis.get_yticklabels()] == ["0", "0.5", "1"]


def test_higher_harmonics_change_the_loop_but_not_its_area():
    """The work of a cycle is π A² G''₁, whatever the other harmonics."""
    table = points([{AMPLITUDE: a} for a in (0.1, 1.0)])
    figure = lissajous(table, harmonics(table, [3.0, 0.0, -1.0], [2.0, 0.0, 0.7]), "elastic")
    loop, ellipse = (corners(c)[0] for c in (figure.axes[0].collections[i] for i in (3, 5)))

    def area(polygon):
        x, y = polygon.T
        return abs(np.sum(x[:-1] * np.diff(y) - y[:-1] * np.diff(x))) / 2

    assert area(loop) == pytest.approx(area(ellipse), rel=1e-3)
    assert np.abs(loop - ellipse).max() > 0.05


def test_quality_counts_the_runs_beyond_the_limits():
    table = runs(main_study())
    half = len(table) // 2
    figure = quality(table)
    titles = {axis.get_title().partition("\n")[0]: axis for axis in figure.axes}
    assert len(titles) == 3  # nothing is known of the asymmetry
    ratio = titles["$|G^*|$ of the surface / internal"]
    assert f"{half} of {2 * half} runs beyond the limit" in ratio.get_title()
    assert sorted({y for line in lines(ratio) for y in line.get_ydata()}) == [1.01, 1.5]
    noise = titles["noise at rest / stress amplitude"]
    assert f"0 of {2 * half} runs beyond the limit" in noise.get_title()
    assert noise.get_yscale() == "log"  # zeros too are somewhere on it
    assert all((line.get_ydata() > 0).all() for line in lines(noise))
    at = np.concatenate([line.get_xdata() for line in lines(ratio)])
    near = np.array(AMPLITUDES)[np.abs(np.log10(at[:, None] / AMPLITUDES)).argmin(axis=1)]
    assert np.abs(np.log10(at / near)).max() < 0.06


def test_quality_without_any_measure_is_refused():
    with pytest.raises(ValueError, match="no run has a value"):
        quality(attributed(pd.DataFrame({"scene": ["gel"], "cycle_change": [np.nan]})))


def test_contact_laws_in_micrometres_and_millinewtons():
    compression = np.linspace(0, 2e-5, 5)
    table = pd.concat(
        pd.DataFrame(
            {"law": law, "of_study": own, "compression": compression, "force": k * compression}
        )
        for law, k, own in (("soft", 1e3, True), ("hard", 4e3, False))
    )
    (axis,) = contact_laws(table).axes
    soft, hard = axis.get_lines()
    assert soft.get_xdata() == pytest.approx([0, 5, 10, 15, 20])
    assert hard.get_ydata() == pytest.approx([0, 20, 40, 60, 80])
    assert soft.get_linewidth() > 2 * hard.get_linewidth()
    assert axis.get_xlabel() == r"compression $\Delta x$ [µm]"
    assert axis.get_ylabel() == "force per depth $F/L$ [mN/m]"


# Machado, Oliveira & Fernandes, IEEE Trans. Vis. Comput. Graph. 15, 1291 (2009), severity 1.
BLINDNESS = {
    "none": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                   [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                     [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                   [0.004733, 0.691367, 0.303900]],
}  # fmt: skip


def lab(colour, blindness):
    """Return CIELAB (D65) of a colour as it is seen with one kind of blindness."""
    rgb = np.array(to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(BLINDNESS[blindness]) @ linear, 0, 1)
    xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    ) @ seen / [0.9505, 1.0, 1.089]  # fmt: skip
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("blindness", BLINDNESS)
@pytest.mark.parametrize(
    ("palette", "least"),
    [
        (style.UNORDERED, 10),  # each has a marker of its own, too
        ((style.STORAGE, style.LOSS), 40),
        (style.shades(4), 20),
        (style.shades(8), 8),
    ],
    ids=["unordered", "moduli", "four", "eight"],
)
def test_colours_are_told_apart_with_any_colour_vision(blindness, palette, least):
    """A difference ΔE of 2.3 is just noticeable side by side; lines stand apart."""
    seen = [lab(colour, blindness) for colour in palette]
    differences = {
        (to_hex(a), to_hex(b)): np.linalg.norm(seen[i] - seen[j])
        for i, a in enumerate(palette)
        for j, b in enumerate(palette[:i])
    }
    assert min(differences.values()) > least, differences
    # On white paper, none fades away.
    assert max(colour[0] for colour in seen) < 83


def test_figures_are_files_of_print_quality_and_the_same_bits_each_time(tmp_path):
    tables = {"steady": points([{"shear.relative_rate": r} for r in (0.1, 1.0)])}
    tables["steady"] = attributed(tables["steady"].rename(columns=as_steady))
    tables["runs"] = attributed(pd.DataFrame({"scene": []}))
    paths = draw(tables, tmp_path / "figures")
    assert [path.name for path in paths] == ["steady.png", "steady.pdf"]
    again = draw(tables, tmp_path / "again")
    for one, two in zip(paths, again, strict=True):
        assert one.read_bytes() == two.read_bytes()
    picture, page = (path.read_bytes() for path in paths)
    assert int.from_bytes(picture[16:20]) == 3.5 * 300
    assert page.startswith(b"%PDF")
    assert len(picture) + len(page) < 200_000


def as_steady(name):
    return name.replace("storage_modulus", "shear_stress").replace("loss_modulus", "viscosity")


def test_flow_laws_show_both_ensembles_where_they_are():
    """μ(J), φ(J), contacts, viscosity and pressure: a line per scene, intervals in both ways."""
    quantities = {
        "friction_coefficient": (0.4, 0.2),
        "viscous_number": (1.0, 0.1),
        "mean_packing_fraction": (0.76, 0.81),
        "contact_number": (2.7, 3.5),
        "scaled_shear_stress": (0.4, 2.0),
        "scaled_pressure": (1.0, 10.0),
    }
    cells = []
    for turn, scene in enumerate(("area", "pressure")):
        for place in range(2):
            cell = {"scene": scene}
            for name, values in quantities.items():
                mean = values[place] * (1 + 0.1 * turn)
                cell |= {f"{name}_mean": mean, f"{name}_ci_method": "BCa"}
                cell |= {f"{name}_ci_low": 0.9 * mean, f"{name}_ci_high": 1.1 * mean}
            cells.append(cell)
    figure = flow_laws(points(cells))
    first, *_, last = figure.axes
    assert first.get_xlabel().startswith("viscous number")
    assert first.get_ylabel().startswith("stress ratio")
    for turn, line in enumerate(first.get_lines()):
        assert line.get_xdata() == pytest.approx(np.array([0.1, 1.0]) * (1 + 0.1 * turn))
        assert line.get_ydata() == pytest.approx(np.array([0.2, 0.4]) * (1 + 0.1 * turn))
    assert len(first.collections) == 4  # intervals of both scenes, up and across
    assert last.get_xlabel().startswith("pressure")
    assert [t.get_text() for t in figure.legends[0].get_texts()] == ["area", "pressure"]
    with pytest.raises(ValueError, match="no law to draw"):
        flow_laws(points(cells[:1]))


def test_a_palette_keeps_white_and_faint_shades(tmp_path):
    picture, _ = style.save(example_run(*oscillation(), None, "one run"), tmp_path / "run")
    with Image.open(picture) as image:
        assert image.mode == "P"
        colours = {colour: count for count, colour in image.convert("RGB").getcolors(256)}
    white, shade = sorted(colours, key=colours.get, reverse=True)[:2]
    assert (white, shade) == ((255, 255, 255), (245, 245, 245))


def test_figures_that_a_study_does_not_allow_any_more_are_removed(tmp_path):
    (tmp_path / "landmarks.png").touch()
    (tmp_path / "my_own.png").touch()
    assert draw({"runs": attributed(pd.DataFrame({"scene": []}))}, tmp_path) == []
    assert [path.name for path in tmp_path.iterdir()] == ["my_own.png"]
    assert "landmarks" in CAPTIONS


def test_a_study_without_results_has_no_figures(tmp_path):
    table = main_study().assign(replicates=0)
    nothing = attributed(pd.DataFrame({"scene": []}))
    assert draw({"curves": table, "runs": nothing}, tmp_path) == []


def test_lissajous_curves_are_of_the_mean_over_replicates():
    """Of two replicates, 0.5 and 1.5 times these moduli, neither is the mean."""
    table = points([{AMPLITUDE: 0.1}])
    waves = _mean_waves(harmonics(table, [3.0, 1.0], [4.0, 2.0]))
    (storage, loss) = waves[table["point"].iloc[0]]
    assert (storage.tolist(), loss.tolist()) == ([3.0, 1.0], [4.0, 2.0])


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (5, 4000, ["10", "100", "1000"]),
        (40, 1200, ["100", "300", "1000"]),
        (1e-3, 2, ["10⁻³", "10⁻²", "10⁻¹", "10⁰"]),
        (2e5, 4e6, ["3·10⁵", "10⁶", "3·10⁶"]),
    ],
)
def test_moduli_over_one_decade_and_over_three_are_labelled_alike(low, high, expected):
    with style.figure(3, 3) as figure:
        axis = figure.subplots()
        axis.set_yscale("log")
        axis.set_ylim(low, high)
        style.log_ticks(axis.yaxis, low, high)
        FigureCanvasAgg(figure).draw()
        shown = [tick for tick in axis.yaxis.get_major_ticks() if low <= tick.get_loc() <= high]
    assert [tick.label1.get_text() for tick in shown] == expected


def test_panels_side_by_side_leave_room_between_the_labels_of_their_axes():
    """The last label of one axis and the first of the next must not read as one number."""
    frictions, fractions, modulus = (0.1, 0.2), (1.0, 1.25, 1.5, 1.75, 2.0), (2000, 8000, 32000)
    base = {"packing.packing_fraction": 1.5, "model.young_modulus": 8000, "model.links.cuts": 5}
    base |= {"model.links.remove_fraction": 0.0}
    varied = {
        "packing.packing_fraction": fractions,
        "model.young_modulus": modulus,
        "model.links.cuts": (3, 5, 10),
        "model.links.remove_fraction": (0.0, 0.25, 0.5),
    }
    rows = [base | {AMPLITUDE: a, FRICTION: f} for a in AMPLITUDES for f in frictions]
    rows += [
        base | {AMPLITUDE: a, FRICTION: 0.1, key: value}
        for key, values in varied.items()
        for value in values
        if value != base[key]
        for a in AMPLITUDES[:2]
    ]
    figure = branches(points(rows), MODULI)
    FigureCanvasAgg(figure).draw()
    lowest = figure.axes[4:8]
    ends = []
    for axis in lowest:
        low, high = axis.get_xlim()
        boxes = [
            tick.label1.get_window_extent()
            for tick in axis.xaxis.get_major_ticks()
            if low <= tick.get_loc() <= high
        ]
        ends.append((min(box.x0 for box in boxes), max(box.x1 for box in boxes)))
    gaps = [(right[0] - left[1]) / figure.dpi for left, right in pairwise(ends)]
    assert min(gaps) > 0.16  # inches: three digits


def test_areas_keep_their_colours_exactly():
    """A few flat colours, beside hundreds that are near one another, as edges are."""
    sheet = np.zeros((90, 90, 3), np.uint8)
    sheet[:30], sheet[30:60] = (0xFF, 0xFF, 0xFF), (0xC8, 0x10, 0x2E)
    sheet[60:65] = (0xFC, 0xFD, 0xFB)  # nearly white: the more frequent one is kept
    sheet[65:] = np.arange(25 * 90)[:, None].reshape(25, 90, 1) % [251, 241, 239]
    picture = Image.fromarray(sheet)
    shown = picture.quantize(palette=style.palette([picture], 128), dither=Image.Dither.NONE)
    assert (np.asarray(shown.convert("RGB"))[:60] == sheet[:60]).all()


def test_a_table_made_column_by_column_can_grow():
    """pandas warns of a column beyond a hundred that is put in by itself: a user sees that."""
    points = pd.DataFrame({"scene": ["one"]})
    for column in range(50):
        points[str(column)] = 1.0
    points = pd.concat([points, points.iloc[:, 1:].add_prefix("_")], axis=1)
    table = by_scene(points)
    table["one more"] = 2.0
    assert table.shape == (1, 102)
