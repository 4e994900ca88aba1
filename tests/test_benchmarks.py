"""The programs that compare speeds: both sides do the same work."""

import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[1] / "analysis/benchmarks"


@pytest.fixture
def benchmarks(monkeypatch):
    """Return the modules of the LAMMPS runs, of the scenes and of the loops of a step."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    names = ("lammps", "scenes", "parts")
    for name in names:  # other tests have scenes of their own
        monkeypatch.delitem(sys.modules, name, raising=False)
    import lammps
    import parts
    import scenes

    yield lammps, scenes, parts
    for name in names:
        del sys.modules[name]


@pytest.mark.parametrize("style", ["hooke", "granular"])
def test_both_programs_have_the_same_stress(benchmarks, style, tmp_path):
    """For 300 steps of loose discs with friction, sliding and sticking, to 0.1 % of the largest."""
    lammps, scenes, _ = benchmarks
    if lammps.shutil.which("lmp") is None:
        pytest.skip("needs LAMMPS")
    simulation = scenes.common(150, 1.5)
    lammps.write(tmp_path, simulation)
    lammps.run(tmp_path, simulation, style, 300)
    theirs = lammps.stresses(tmp_path)
    simulation.advance(simulation.rows)
    columns, k = simulation.columns(), simulation.constants.k
    at = theirs[:, 0].astype(int)
    for column, name in ((1, "xx"), (2, "yy"), (3, "xy")):
        ours = columns[f"periodic_love_weber_{name}"][at] / k
        error = np.abs(ours - theirs[:, column]).max() / np.abs(theirs[:, 1]).max()
        assert error < 1e-3, f"{name}: {error:.1e}"


def test_the_loops_that_are_timed_are_those_of_a_step(benchmarks):
    """`loops_of` compares the discs, bit for bit, and counts every loop."""
    *_, parts = benchmarks
    times, pairs = parts.loops_of(150, 1.5, 20)
    assert (times > 0).all()
    assert 3 < pairs < 4
