"""What the figures show, read back from their artists; how they look is for the eye."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from shear_sim.figures import branches, curves, draw, example_run
from shear_sim.figures.panels import FOOT_MARK
from shear_sim.variation import variation

AMPLITUDES = [0.001, 0.01, 0.1, 1.0]
QUANTITIES = ("storage_modulus", "loss_modulus")


def points(cells, replicates=12, planned=12):
    """Return a table of points as `aggregate` makes it; a cell is its parameters and moduli."""
    rows = []
    for cell in cells:
        row = {"scene": "gel", "block": "main", "replicates": replicates, "planned": planned}
        row |= {"ci_level": 0.95} | cell
        for name in QUANTITIES:
            mean = row.pop(name, 100.0)
            row[f"{name}_mean"] = mean
            row[f"{name}_ci_low"] = row.get(f"{name}_ci_low", mean - 0.1 * abs(mean))
            row[f"{name}_ci_high"] = row.get(f"{name}_ci_high", mean + 0.1 * abs(mean))
            row[f"{name}_ci_method"] = "BCa"
        rows.append(row)
    table = pd.DataFrame(rows)
    table.attrs["units"] = {f"{name}_mean": "Pa" for name in QUANTITIES}
    table.attrs["units"] |= {"model.young_modulus": "Pa"}
    return table


def main_study():
    """Return a study like configs/main.yaml, in small: two scenes, friction, and two branches."""
    base = {
        "model.friction": 0.01,
        "model.links.cut": "cells",
        "model.young_modulus": 8000.0,
        "model.contact_law.kind": "divergent",
        "model.contact_law.begin": np.nan,
    }
    cells = [
        base
        | {
            "scene": scene,
            "model.links.cut": cut,
            "model.friction": friction,
            "shear.strain_amplitude": amplitude,
            "storage_modulus": 1000.0 / (1 + amplitude / friction),
        }
        for scene, cut in (("gel", "cells"), ("loose", "none"))
        for friction in (0.01, 0.1, 1.0)
        for amplitude in AMPLITUDES
    ]
    for amplitude in (0.01, 1.0):
        strain = {"shear.strain_amplitude": amplitude}
        cells += [base | strain | {"model.young_modulus": e} for e in (2000.0, 32000.0)]
        law = {"model.contact_law.kind": "plateau", "model.contact_law.begin": 0.3}
        cells.append(base | strain | law)
    return points(cells)


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
    figure = curves(main_study(), QUANTITIES)
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
    figure = branches(main_study(), QUANTITIES)
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
    assert "arrows at the foot: mean not positive (1)" in figure.get_suptitle()


def test_an_interval_that_reaches_zero_is_cut_at_the_foot():
    table = points(
        [
            {"shear.strain_amplitude": a, "storage_modulus": g, "storage_modulus_ci_low": low}
            for a, g, low in ((0.01, 100.0, 90.0), (0.1, 10.0, 9.0), (1.0, 5.0, -4.0))
        ]
    )
    (axis,) = curves(table, ("storage_modulus",)).axes
    (band,) = axis.collections[:1]
    corners = band.get_paths()[0].vertices
    foot = axis.get_ylim()[0]
    assert corners[corners[:, 0] == 1.0][:, 1].min() == pytest.approx(0.99 * foot)
    assert foot > 0


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
    table.loc[0, "replicates"] = 5
    total = 12 * len(table)
    note = f"PARTIAL STUDY: {total - 7} of {total} runs"
    assert note in make(table, QUANTITIES).get_suptitle()
    assert "PARTIAL" not in make(main_study(), QUANTITIES).get_suptitle()


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
        curves(table, QUANTITIES)
    with pytest.raises(ValueError, match="no branches"):
        branches(points([{"shear.strain_amplitude": a} for a in AMPLITUDES]), QUANTITIES)


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
    branches(table, QUANTITIES)
    curves(table, QUANTITIES)
    assert caplog.records == []


def test_example_of_a_steady_shear():
    columns, _ = oscillation()
    columns["strain"] = np.clip(columns["time"] - 2, 0, 3)
    protocol = {"kind": "steady", "shear_start": 2.0, "shear_end": 5.0}
    figure = example_run(columns, protocol, None, "one run")
    (loop,) = figure.axes[1].get_lines()
    assert loop.get_xdata()[-1] == pytest.approx(3.0)


def test_figures_are_files_of_print_quality_and_the_same_bits_each_time(tmp_path):
    tables = {"moduli": main_study()}
    paths = draw(tables, tmp_path / "figures")
    names = [f"{name}.{kind}" for name in ("moduli", "moduli_branches") for kind in ("png", "pdf")]
    assert [path.name for path in paths] == names
    again = draw(tables, tmp_path / "again")
    for one, two in zip(paths, again, strict=True):
        assert one.read_bytes() == two.read_bytes()
        assert one.stat().st_size < 1_000_000
    assert int.from_bytes(paths[0].read_bytes()[16:20]) == 5.2 * 300


def test_a_study_without_results_has_no_figures(tmp_path):
    table = main_study().assign(replicates=0)
    assert draw({"moduli": table}, tmp_path) == []
