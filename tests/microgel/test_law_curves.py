"""Contact laws of a study as a table and a figure: curves against the equations of the manual."""

import math

import numpy as np
import pandas as pd
import pytest
from legacy_runs import REAL

from shear_sim.aggregate import aggregate, load
from shear_sim.figures import contact_laws as draw_contact_laws
from shear_sim.legacy.importing import import_legacy
from shear_sim.models.microgel import contact_laws

YOUNG_MODULUS, SMALL, LARGE = 8000.0, 10e-6, 14e-6
D, K = SMALL + LARGE, math.pi * YOUNG_MODULUS / 8
EQUATIONS = {
    "linear": lambda x: K * x,  # S1-5a
    "divergent": lambda x: K * x / (1 - x / D),  # S1-5b
    "hertz": lambda x: 1.1 * YOUNG_MODULUS * (D / 2) ** -0.5 * x**1.5,  # S1-13
}


def index(laws, modulus=YOUNG_MODULUS):
    """Return the index of a run of each law."""
    return pd.DataFrame(
        {"model.young_modulus": modulus, "derived.small_radius": SMALL,
         "derived.large_radius": LARGE}
        | {f"model.contact_law.{key}": value for key, value in law.items()}
        for law in laws
    )  # fmt: skip


def curve(table, law):
    of_law = table[table["law"] == law]
    return of_law["compression"].to_numpy(), of_law["force"].to_numpy()


@pytest.mark.parametrize("law", EQUATIONS)
def test_curves_are_the_equations(law):
    table, _ = contact_laws(index([{"kind": "divergent"}]))
    compression, force = curve(table, law)
    for at in (0.1, 0.5, 0.9):
        expected = EQUATIONS[law](at * D)
        assert np.interp(at * D, compression, force) == pytest.approx(expected, rel=1e-12)
    assert compression[[0, -1]] == pytest.approx([0, D])


def test_laws_of_the_study_come_first_and_the_others_once():
    runs = index([{"kind": "plateau", "slope": 0.2}, {"kind": "linear"}, {"kind": "plateau",
                  "slope": 0.2}, {"kind": "divergent", "repulsion": 0.5}])  # fmt: skip
    table, note = contact_laws(runs)
    own = table.drop_duplicates("law").set_index("law")["of_study"]
    assert own.to_dict() == {
        "plateau, 0.3 to 0.8 D, slope 0.2": True, "linear": True, "divergent, κ = 0.5": True,
        "divergent": False, "hertz": False,
    }  # fmt: skip
    assert note == "E = 8000 Pa; a disc of radius 10 µm and one of 14 µm"
    # Half of S1-5b and half of S1-5a.
    compression, force = curve(table, "divergent, κ = 0.5")
    expected = K * D / 4 * (1 + 1 / (1 - 0.5))
    assert np.interp(D / 2, compression, force) == pytest.approx(expected)


def test_most_runs_give_the_discs_and_custom_laws_are_left_out():
    one, other = (index([{"kind": "custom"}] * n, e) for n, e in ((2, 2000.0), (1, 8000.0)))
    table, note = contact_laws(pd.concat([other, one]))
    assert note.startswith("E = 2000 Pa")
    assert note.endswith(", as in most runs; custom laws are left out")
    assert not table["of_study"].any()
    assert curve(table, "linear")[1][-1] == pytest.approx(math.pi * 2000 / 8 * D)


def test_a_study_is_aggregated_with_its_contact_laws(tmp_path):
    folder = import_legacy([REAL], tmp_path / "old").folder
    drawn = aggregate(folder)["contact_laws"]
    for ending in ("png", "pdf"):
        assert (folder / "figures" / f"contact_laws.{ending}").stat().st_size > 1000
    pd.testing.assert_frame_equal(load(folder / "tables" / "contact_laws.parquet"), drawn)
    runs = pd.read_parquet(folder / "index.parquet").iloc[0]
    distance = runs["derived.small_radius"] + runs["derived.large_radius"]
    k = math.pi * runs["model.young_modulus"] / 8
    (law,) = drawn.loc[drawn["of_study"], "law"].unique()
    assert law == runs["model.contact_law.kind"] == "divergent"
    (axis,) = draw_contact_laws(drawn).axes
    line = axis.get_lines()[0]
    assert line.get_label() == law
    for at in (0.1, 0.4, 0.8):
        expected = k * at * distance / (1 - at) * 1e3
        shown = np.interp(at * distance * 1e6, line.get_xdata(), line.get_ydata())
        assert shown == pytest.approx(expected, rel=1e-12)
