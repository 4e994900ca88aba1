"""The hard cases of analysis/hard_cases.py that run in seconds."""

import runpy
from dataclasses import replace
from pathlib import Path

import pytest

PROGRAM = runpy.run_path(str(Path(__file__).parents[2] / "analysis" / "hard_cases.py"))
SLOW = {"relative viscosity 10", "relative frequency 0.001"}


@pytest.mark.parametrize("name", [name for name in PROGRAM["CASES"] if name not in SLOW])
def test_what_must_hold_holds(name):
    """Finite, energy balance, symmetry, momentum, nobody passes; or refused with the reason.

    Beyond the height of the clamped law, 6 k D², discs do pass; the linear law is lower.
    """
    case = PROGRAM["CASES"][name]
    found = PROGRAM["run"](case)
    assert PROGRAM["faults"](case, found) == []
    assert (found.passing > 0) == (case.passing is None)


def test_a_fault_is_found():
    """The same limits, runs that break them."""
    case = PROGRAM["CASES"]["μ = 10"]
    model = case.sections["model"] | {"lever_arms": "otsuki2017"}
    wrong = replace(case, sections=case.sections | {"model": model})
    assert any("asymmetry" in fault for fault in PROGRAM["faults"](case, PROGRAM["run"](wrong)))
    through = PROGRAM["CASES"]["head-on, 20 kD² (through)"]
    found = PROGRAM["faults"](replace(through, passing=0), PROGRAM["run"](through))
    assert found == ["1 passed through"]
