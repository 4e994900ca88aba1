"""The program that reproduces the claim of exactness, on a smaller run."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from scenes import packing_point

from shear_sim.models.microgel.parameters import Links

PROGRAM = Path(__file__).parents[2] / "analysis" / "exactness.py"


def test_the_program_finds_what_the_manual_claims(tmp_path):
    """S1-24 is symmetric, Nicot's coefficient leaves a third; nominal arms lose L."""
    program = runpy.run_path(str(PROGRAM))
    point = packing_point(discs=40, links=Links(cuts=3), friction=0.1)
    table, curves = program["measure"](point, 2)
    program["draw"](curves, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
    rows = [line.strip("| ").split(" | ") for line in table.splitlines()]
    stress = {
        (r[0], r[1]): np.array(r[2:], float)
        for r in rows
        if len(r) == 5 and r[2][0] in "0123456789"
    }
    assert len(stress) == 8
    for tensor in ("internal", "periodic"):
        assert stress["Love–Weber alone", tensor][1] > 1e-4
        assert stress["with internal torques (S1-24)", tensor][1] < 1e-15
        left = stress["with Nicot's coefficient (2/3)", tensor][2]
        assert left == pytest.approx(1 / 3, rel=0.01)
    assert stress["with net torques (S1-23)", "internal"][1] > 1e-4
    arms = {
        r[0]: np.array(r[1:], float) for r in rows if len(r) == 3 and "e" in r[1] and "-" in r[1]
    }
    assert arms["otsuki2017"][0] > 0.01
    for name in ("conjugate", "particleshear"):
        assert arms[name].max() < 1e-13
