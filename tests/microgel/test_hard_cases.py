"""The hard cases of analysis/hard_cases.py that run in seconds."""

import runpy
from pathlib import Path

import pytest

PROGRAM = runpy.run_path(str(Path(__file__).parents[2] / "analysis" / "hard_cases.py"))
SLOW = {"relative viscosity 10", "relative frequency 0.001"}


@pytest.mark.parametrize("name", [name for name in PROGRAM["CASES"] if name not in SLOW])
def test_what_must_hold_holds(name):
    """Finite, energy balance, symmetry, momentum, nobody passes; or refused with the reason."""
    case = PROGRAM["CASES"][name]
    assert PROGRAM["faults"](case, PROGRAM["run"](case)) == []


def test_discs_that_pass_through_each_other_are_counted():
    """Beyond the height of the clamped law, 6 k D², they do; the linear law is lower."""
    for name in ("a link of 1 cell, let go", "A = 2, links, φ = 2, linear law"):
        assert PROGRAM["run"](PROGRAM["CASES"][name]).passing > 0


def test_a_fault_is_found():
    """The same limits, a run that breaks them."""
    case = PROGRAM["CASES"]["A = 2, links, φ = 2"]
    coarse = PROGRAM["run"](case, model={"lever_arms": "otsuki2017"})
    assert any("asymmetry" in fault for fault in PROGRAM["faults"](case, coarse))
