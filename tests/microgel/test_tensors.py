"""Derived columns follow from the stored ones as Table S2-3 defines them."""

import numpy as np
import pytest

from shear_sim.models.microgel import COLUMNS, DERIVED, derive


def stored():
    """Unequal numbers in every stored column."""
    return {c.name: np.array([2.0**n, -3.0 * n]) for n, c in enumerate(COLUMNS, start=1)}


def test_shear_stresses_are_minus_the_xy_components():
    """S1-25: the force component is x, the lever y; yx would be another number here."""
    columns = stored()
    found = derive(columns)
    assert found["shear_stress_external"] == pytest.approx(-columns["external_xy"])
    internal = columns["love_weber_xy"] - columns["internal_torque_yx"]
    assert found["shear_stress_internal"] == pytest.approx(-internal)
    periodic = columns["periodic_love_weber_xy"] - columns["periodic_torque_yx"]
    assert found["shear_stress"] == pytest.approx(-periodic)


def test_identities():
    columns = stored()
    found = derive(columns)
    assert [c.name for c in DERIVED] == list(found)
    for ab in ("xx", "xy", "yx", "yy"):
        acceleration = columns[f"love_weber_{ab}"] - columns[f"external_{ab}"]
        assert found[f"linear_acceleration_{ab}"] == pytest.approx(acceleration)
        assert found[f"unbalanced_force_{ab}"] == pytest.approx(acceleration)
        parts = columns[f"love_weber_{ab}"] + found[f"internal_torque_{ab}"]
        assert found[f"overall_{ab}"] == pytest.approx(parts + found[f"centrifugal_{ab}"])
    assert found["centrifugal_yy"] == pytest.approx(columns["centrifugal_xx"])
    trace = found["periodic_overall_xx"] + found["periodic_overall_yy"]
    assert found["pressure"] == pytest.approx(0.5 * trace)


def test_only_what_is_stored_is_derived():
    columns = stored()
    few = {name: columns[name] for name in ("time", "external_xy")}
    assert list(derive(few)) == ["shear_stress_external"]
