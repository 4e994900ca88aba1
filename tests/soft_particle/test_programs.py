"""What programs of analysis/ work out themselves for tables and figures, from records by hand."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from shear_sim.render import Kept
from shear_sim.tables import Table

ANALYSIS = Path(__file__).parents[2] / "analysis"


@pytest.fixture
def program(monkeypatch):
    monkeypatch.syspath_prepend(str(ANALYSIS))
    return importlib.import_module


def test_volume_is_shared_from_the_void_ratio_of_the_paper_on(program):
    """A loose pack: 10 of pores alone, then 12 of which 6 are of particles; σ* is half way."""
    columns = {
        "strain": np.array([0.0, 0.1, 0.15, 0.2, 0.1, 0.05, 0.0]),
        "box_area": np.array([131.0, 121.0, 117.0, 109.0, 121.0, 126.0, 131.0]),
        "solid_area": np.array([100.0, 100.0, 99.0, 94.0, 100.0, 100.0, 100.0]),
        "stress_yy_per_bending": np.array([0.0, 0.1, 0.55, 0.8, 0.2, 0.0, 0.0]),
    }
    found = program("soft_compaction").measured(
        Kept(Path("hand"), Table(columns, {"measured": {"start_void_ratio": 0.31}}), [])
    )
    assert found == pytest.approx(
        {
            "start_void_ratio": 0.31, "final_later_share": 6 / 12, "later_share_at_unit": 1 / 4,
            "lid_leaves": 0.05,
        }
    )  # fmt: skip
    columns["stress_yy_per_bending"] *= 0.5  # never σ*
    found = program("soft_compaction").measured(
        Kept(Path("hand"), Table(columns, {"measured": {}}), [])
    )
    assert "later_share_at_unit" not in found


def test_a_profile_is_zero_beside_what_touches(program):
    """Two vertices touch at each end of a contact; the three records are of 0.1, 0.2 and 0.1."""
    rings = program("soft_diametral")
    segment = 2 * np.sin(np.pi / rings.VERTICES)
    ends = np.array([-3.0, -2.0, 2.0, 3.0]) * segment
    none = [np.zeros(0)] * 2
    run = rings.Run(
        {"compression": np.array([0.0, 0.1, 0.2, 0.1])},
        [np.zeros(1), ends, np.zeros(1)], [np.ones(1), np.array([2.0, 1.0, 1.0, 2.0]), np.ones(1)],
        none,
    )  # fmt: skip
    x, p = rings.profile(run, 0.3)
    assert x / segment == pytest.approx([-4, -3, -2, -1, 1, 2, 3, 4])
    assert p == pytest.approx([0, 2, 1, 0, 0, 1, 2, 0])


def test_share_of_the_load_at_the_ends(program):
    """Of seven vertices the outer three of each end bear six sevenths."""
    rings, figures = program("soft_diametral"), program("soft_paper_figures")
    place = np.arange(-3.0, 4.0) * figures.SEGMENT
    run = rings.Run({}, [place], [np.ones(7)], [])
    assert figures.at_ends(run, 0) == pytest.approx(6 / 7)


def test_a_tissue_that_does_not_rupture_meets_no_goal_of_rupture(program, monkeypatch):
    """Open, and with a rupture in the end 0.403/0.12; the elastic one dips at ε = 0.06 too."""
    tissue = program("soft_tissue")
    monkeypatch.setattr(tissue, "crack", lambda _: (0.9, 1.0))

    def job(strain, stress):
        lid, floor = np.array(stress) + 0.3, np.array(stress) - 0.3
        columns = {
            "strain": strain, "stress_yy_per_bending": -lid, "stress_floor_per_bending": -floor,
        }  # fmt: skip
        summary = {"measured": {"energy_missing_ratio": 1e-5, "breaking_error": 1e-3}}
        return Kept(Path("hand"), Table(columns, summary), [])

    elastic = job(0.02 * np.arange(8), [0.01, 0.5, 1, 0.1, 0.6, 0.8, 0.1, 0.05])
    stress = [0.01, 1, 0.9, 1, 0.8, 1, 0.7, 0.9, 0.6, 0.8, 0.5, 0.6, 0.4, 0.3]
    for end, found, holds in (
        (0.25, "no rupture: plastic", None), (0.1, "0.4/0.12 = 3.4", True),
    ):  # fmt: skip
        plastic = job(0.031 * np.arange(14), [*stress[:-1], end])
        rows = list(tissue.goals({"elastic": elastic, "plastic": plastic}))
        [row] = [row for row in rows if row[0].startswith("rupture strain")]
        assert row[2:] == (found, holds)
    elastic = job(0.031 * np.arange(14), stress)
    first, *_ = tissue.goals({"elastic": elastic, "plastic": plastic})
    assert first[2:] == ("no rupture", False)
