"""Combinations of parameters that cannot be: refused, with what would be right."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from shear_sim.models.microgel.parameters import MicrogelPoint, fault_of_law
from shear_sim.packing import Cell, Packing, cell_height, radii

LAW = "def contact_force(distance, contact_distance, stiffness, repulsion):\n    return 0.0\n"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"packing": {"start": "hexagonal", "columns": 10}}, "write packing.size_ratio: 1"),
        ({"packing": {"start": "hexagonal", "size_ratio": 1}}, "needs packing.columns"),
        (
            {"packing": {"start": "hexagonal", "size_ratio": 1, "columns": 11}},
            "150 discs do not fill rows of 11: packing.discs: 154",
        ),
        (
            {"packing": {"start": "hexagonal", "size_ratio": 1, "columns": 10}},
            "150 discs make 15 rows.*packing.discs: 160",
        ),
        ({"packing": {"columns": 10}}, "only a hexagonal start has columns"),
        ({"packing": {"start": "file"}}, "start: file needs packing.file"),
        ({"packing": {"file": "a.csv"}}, "is read with start: file only"),
        (
            {"packing": {"start": "file", "file": "a.csv", "discs": 20}},
            "takes discs from the file: leave discs out",
        ),
        ({"model": {"contact_law": {"kind": "plateau", "begin": 0.9}}}, "begin 0.9 is above end"),
        ({"model": {"contact_law": {"kind": "custom"}}}, "kind: custom needs file"),
        ({"model": {"links": {"cut": "bulk", "cuts": 3}}}, "cuts: 3 has no effect with cut: bulk"),
        (
            {"model": {"links": {"cut": "none", "remove_fraction": 0.5}}},
            "remove_fraction: 0.5 has no effect with cut: none",
        ),
        ({"model": {"links": {"cut": "file"}}}, "cut: file needs start: file"),
        ({"model": {"links": {"cut": "file", "cuts": 3}}}, "cuts: 3 has no effect"),
        ({"model": {"links": {"avoid_angle": 20}}}, "avoid_angle: 20.0 has no effect"),
        ({"model": {"links": {"cut": "lines", "edge_fuzziness": 1}}}, "edge_fuzziness"),
        ({"shear": {"kind": "steady", "relative_rate": 0, "strain": 1}}, "must not be 0"),
        ({"record": {"every": 13}}, "one record every 13 of 240 steps.*at most 12"),
        (
            {"packing": {"start": "hexagonal", "size_ratio": 1, "columns": 10, "discs": 160}}
            | {"cell": {"height": 1e-3}},
            "leave cell.height out",
        ),
        (
            {"integrator": {"steps_per_period": 400}, "record": {"every": 21}},
            "one record every 21 of 400 steps.*at most 20",
        ),
    ],
)
def test_impossible_combinations_are_refused(data, message):
    with pytest.raises(ValidationError, match=message):
        MicrogelPoint.model_validate(data)


@pytest.mark.parametrize(
    "data",
    [
        {},
        {"packing": {"start": "hexagonal", "size_ratio": 1, "columns": 10, "discs": 160}},
        {
            "packing": {"start": "hexagonal", "size_ratio": 1, "columns": 3, "discs": 3},
            "cell": {"boundary": "open"},
        },
        {"model": {"contact_law": {"repulsion": 0.5}}},
        {"shear": {"strain_amplitude": 0.1}},
        {"shear": {"kind": "steady", "relative_rate": -0.01, "strain": 2}},
        {"model": {"links": {"cut": "lines", "avoid_angle": 20}}},
        {"integrator": {"steps_per_period": 200}, "record": {"every": 10}},
        {"record": {"columns": ["time", "strain"]}},
        {"packing": {"start": "file", "file": "a.npz"}, "model": {"links": {"cut": "file"}}},
    ],
)
def test_possible_combinations_survive_a_round_trip(data):
    point = MicrogelPoint.model_validate(data)
    assert MicrogelPoint.model_validate(point.model_dump()) == point
    assert MicrogelPoint.model_validate(point.model_dump(mode="json")) == point


@given(
    discs=st.integers(1, 400),
    fraction=st.floats(0.1, 2.5),
    ratio=st.floats(1, 5),
    height=st.floats(1e-5, 1e-2),
)
def test_radii_fill_the_packing_fraction_exactly(discs, fraction, ratio, height):
    """Eq. S1-14 with the real counts: Σ π r² = φ L_x L_y, also for an odd number of discs."""
    packing = Packing(discs=discs, packing_fraction=fraction, size_ratio=ratio)
    radius = radii(packing, 1e-3 * height)
    assert len(radius) == discs
    assert math.pi * (radius**2).sum() == pytest.approx(fraction * 1e-3 * height, rel=1e-12)
    large = math.ceil(discs / 2)
    assert radius[:large] == pytest.approx(radius[0], rel=0)
    assert radius[large:] * ratio == pytest.approx(radius[0], rel=1e-12)


@given(
    discs=st.integers(1, 60),
    fraction=st.floats(0.5, 2.5),
    ratio=st.floats(1, 3),
    height=st.floats(2e-5, 2e-3),
)
def test_a_cell_is_refused_if_and_only_if_it_is_under_four_large_radii(
    discs, fraction, ratio, height
):
    """And the advice is right: with the number of discs it names, the cell is accepted."""
    packing = {"discs": discs, "packing_fraction": fraction, "size_ratio": ratio}
    cell = Cell(width=500e-6, height=height)
    large = radii(Packing(**packing), 500e-6 * height)[0]
    data = {"cell": cell.model_dump(), "packing": packing}
    if min(500e-6, height) >= 4 * large:
        MicrogelPoint.model_validate(data)
        return
    with pytest.raises(ValidationError, match="under four large radii") as caught:
        MicrogelPoint.model_validate(data)
    advice = str(caught.value).split("packing.discs at least ")[1].split(",")[0]
    MicrogelPoint.model_validate({**data, "packing": {**packing, "discs": int(advice)}})
    with pytest.raises(ValidationError):
        MicrogelPoint.model_validate({**data, "packing": {**packing, "discs": int(advice) - 2}})


def test_crystal_height_is_that_of_its_rows():
    packing = Packing(start="hexagonal", size_ratio=1.0, columns=10, discs=120)
    assert cell_height(packing, Cell(width=1e-3)) == pytest.approx(12 * 1e-4 * math.sqrt(3) / 2)


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        (LAW, None),
        ("from math import sqrt\nSCALE = 2\n" + LAW, None),
        ("def force(a, b, c, d):\n    return 0.0\n", "must define `def contact_force"),
        ("contact_force = 3\n", "must define"),
        ("\n\ndef contact_force(d, D, k):\n    return 0.0\n", "line 3: must be"),
        ("def contact_force(*all):\n    return 0.0\n", "four arguments"),
        ("def contact_force(a, b, c, d, *, e):\n    return 0.0\n", "four arguments"),
        ("def contact_force(:\n", "line 1 is not Python"),
        ("\0", "is not Python"),
        ("(" * 5000, "is not Python"),
    ],
)
def test_a_users_law_is_checked_without_running_it(source, fault):
    found = fault_of_law(source)
    assert (found is None) if fault is None else (fault in found)
