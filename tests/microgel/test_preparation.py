"""Packings brought to rest, and contact laws of the user's own."""

import os
import pickle
import subprocess
import sys
import traceback

import numpy as np
import pytest
from scenes import evaluate, finish, packing_point, prepared

from shear_sim.models.interface import SimulationError
from shear_sim.models.microgel import laws, preparation
from shear_sim.models.microgel.parameters import CustomLaw, LinearLaw, Links
from shear_sim.models.microgel.simulation import kernels_for, time_scale
from shear_sim.models.microgel.state import listed
from shear_sim.packing import Cell, Equilibration
from shear_sim.protocol import OscillatoryShear
from shear_sim.streams import Streams

CUSTOM = """
from shear_sim.models.microgel import laws
from shear_sim.models.microgel.parameters import MicrogelPoint
from shear_sim.models.microgel.simulation import (
    kernels_for, make_constants, make_discs, make_work,
)
import numpy as np
law = laws.custom("def contact_force(d, D, k, repulsion):\\n    return -4 * k * (D - d)\\n")
discs = make_discs(np.zeros((2, 2)), np.ones(2), density=1.0)
constants = make_constants(MicrogelPoint(), discs, 9.0, 9.0, 1.0)._replace(
    step_normal_dashpot=np.inf, step_rolling=1e9, step_rolling_dashpot=1e9
)
work = make_work(2)
work.closest[0] = 0.5
print(kernels_for(law, True).substep(constants, work, 2.0, 0.0) / constants.step_energy)
"""


@pytest.mark.parametrize("cached", [False, True])
def test_a_users_law_can_be_loaded_from_the_cache(tmp_path_factory, cached):
    """Compiled kernels name the module of the user's function, which the next process must know.

    The stiffness of 4 k halves the longest substep.
    """
    folder = tmp_path_factory.getbasetemp() / "law_cache"
    for _ in range(2 if cached else 1):
        done = subprocess.run(
            [sys.executable, "-c", CUSTOM], capture_output=True, text=True, check=False,
            env={**os.environ, "SHEAR_SIM_CACHE": str(folder)},
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[-500:]
        assert float(done.stdout) == pytest.approx(1 / 2, rel=1e-3)


@pytest.mark.parametrize("discs", [20, 61])
@pytest.mark.parametrize("links", ["none", "cells"])
def test_a_packing_is_at_rest(discs, links):
    """The criterion of the study file, checked from forces and velocities, not from its report."""
    rest = Equilibration(force_tolerance=1e-10, energy_tolerance=1e-20)
    s = prepared(
        packing_point(
            discs=discs, links=Links(cut=links), friction=0.3, packing={"equilibration": rest}
        )
    )
    s.advance(1)
    e = evaluate(s)
    k, d = s.constants.k, s.discs
    unit = k * 2 * d.radius.mean()
    assert np.abs(e.force).max() < 3e-10 * unit
    assert np.abs(e.torque / d.radius).max() < 3e-10 * unit
    kinetic = 0.5 * (d.mass * (d.cx**2 + d.cy**2) + d.inertia * d.spin**2).mean()
    assert kinetic <= 1e-20 * unit * 2 * d.radius.mean()
    report = s.summary()["preparation"]
    assert report["at_rest"]
    assert report["unbalanced_force"] == pytest.approx(
        max(np.hypot(*e.force.T).max(), np.abs(e.torque / d.radius).max()) / unit, rel=1e-6
    )
    assert abs((d.mass * d.cx).sum()) <= 1e-12 * (d.mass * np.abs(d.cx)).sum()
    area = np.pi * (d.radius**2).sum() / (s.constants.width * s.constants.height)
    assert area == pytest.approx(1.5, rel=1e-14)


def test_a_step_limit_is_reported():
    """Not at rest within the limit: the run goes on, and the summary says what was reached."""
    rest = Equilibration(force_tolerance=1e-12, max_steps=60)
    s = prepared(packing_point(discs=60, packing={"equilibration": rest}))
    report = s.preparation
    assert report["at_rest"] is False
    assert report["unbalanced_force"] > 1e-12


def test_a_rested_packing_stays_where_it_is():
    """Without shear nothing moves in the rest before it, friction and links or not."""
    s = prepared(
        packing_point(
            discs=40, links=Links(cut="cells"), friction=0.3,
            shear=OscillatoryShear(
                strain_amplitude=1e-9, pre_periods=2, periods=0.05, post_periods=0
            ),
        )
    )  # fmt: skip
    x, y = s.discs.x.copy(), s.discs.y.copy()
    c = finish(s)
    before = c["strain_rate"] == 0
    assert np.ptp(c["pressure"][before]) < 1e-6 * c["pressure"][0]
    assert np.abs((s.discs.y - y + 250e-6) % 500e-6 - 250e-6).max() < 1e-6 * s.discs.radius.max()
    assert np.abs((s.discs.x - x + 250e-6) % 500e-6 - 250e-6).max() < 1e-6 * s.discs.radius.max()


@pytest.mark.parametrize("law", [LinearLaw(kind="linear"), None])
def test_a_crystal_is_in_equilibrium(law):
    """Every disc of the hexagonal start is a centre of symmetry: no net force, whatever the law.

    A cell of the wrong height, or rows shifted by another half, would leave net forces.
    """
    s = prepared(
        packing_point(
            cell=Cell(width=400e-6), discs=30, links=Links(cut="bulk"),
            packing={"start": "hexagonal", "columns": 5, "size_ratio": 1.0,
                     "packing_fraction": 1.1},
            **({"contact_law": law} if law else {}),
        )
    )  # fmt: skip
    assert s.preparation["relaxation_steps"] <= 2
    s.advance(1)
    e = evaluate(s)
    assert np.abs(e.force).max() < 1e-12 * s.constants.k * s.discs.radius[0]
    assert len(s.links.i) == 3 * 30
    spacing = listed(s.links).distance
    assert np.abs(spacing / (400e-6 / 5) - 1).max() < 1e-12


BUILT_IN = """
def contact_force(d, D, k, repulsion):
    if repulsion < 1:
        raise ValueError("not measured there")
    force = k * (D - d) * (1.0 - repulsion + repulsion * D / max(d, 1e-6 * D))
    return -min(force, 1000.0 * k * D)
"""


def test_a_users_law_is_as_good_as_a_built_in_one():
    """The same formula gives the same bits in a whole run."""
    shear = OscillatoryShear(pre_periods=0, periods=0.5, post_periods=0)

    def run(**law):
        s = prepared(
            packing_point(discs=30, friction=0.3, links=Links(cut="cells"), shear=shear, **law)
        )
        return finish(s)

    ours = run()
    theirs = run(contact_law=CustomLaw(kind="custom", source=BUILT_IN))
    for name, values in ours.items():
        assert np.array_equal(values, theirs[name]), name


def test_a_users_file_without_the_function_is_a_clear_error():
    with pytest.raises(ValueError, match="must define"):
        laws.custom("def force(d):\n    return 0.0\n")


def test_kernels_of_a_law_are_compiled_once():
    assert kernels_for(laws.divergent, True) is kernels_for(laws.divergent, True)
    assert laws.custom(BUILT_IN) is laws.custom(BUILT_IN)


def test_an_unstable_run_is_a_simulation_error():
    """What is no longer a number stops the job, with what to do about it."""
    s = prepared(packing_point(discs=30))
    s.discs.cx[0] = np.nan
    with pytest.raises(SimulationError, match="steps_per_period"):
        finish(s)


@pytest.mark.parametrize("steps", [1, 7])
def test_a_preparation_in_pieces_equals_the_whole_to_the_bit(steps):
    """It is the larger part of a run of many discs: stopped and taken up again after any step."""
    rest = Equilibration(max_steps=300, force_tolerance=1e-16)  # never: all stages are long
    point = packing_point(
        discs=20, links=Links(cut="cells"), friction=0.1, packing={"equilibration": rest}
    )
    whole, pieces = preparation.make_start(point, Streams(5, 2)), 0
    going = preparation.Preparation(point, Streams(5, 2))
    while (start := going.advance(steps)) is None:
        going = pickle.loads(pickle.dumps(going))  # noqa: S301 - our own
        pieces += 1
    made = whole.preparation["relaxation_steps"], whole.preparation["settling_steps"]
    assert made[0] > 300
    assert made[1] >= 300
    assert pieces > made[0] / steps
    assert start.preparation == whole.preparation
    for one, other in ((whole.discs, start.discs), (whole.links, start.links)):
        assert [a.tobytes() for a in one] == [a.tobytes() for a in other]
    one, other = listed(whole.contacts), listed(start.contacts)
    assert [a.tobytes() for a in one] == [a.tobytes() for a in other]


def test_a_packing_that_moves_is_not_at_rest():
    """No net force, but a velocity, a spin: it settles until both have gone."""
    point = packing_point(discs=20)
    simulation = prepared(point)
    discs = simulation.discs
    _, tau = time_scale(point.model, discs.mass)
    for array, value in ((discs.cx, 1e-3), (discs.spin, 10.0)):
        array[0] = value
        report = preparation.Settling(
            point, discs, simulation.links, simulation.contacts, simulation.constants, tau
        ).advance(100_000)
        assert report["settling_steps"] > 0
        assert report["at_rest"]
        assert report["kinetic_energy"] <= point.packing.equilibration.energy_tolerance


def test_a_law_that_raises_fails_its_own_jobs_only():
    """It works with the repulsion with which laws are tried, but not with that of the study."""
    law = CustomLaw(kind="custom", source=BUILT_IN, repulsion=0.5)
    point = packing_point(discs=20, contact_law=law)
    preparation.compile_kernels([point])
    with pytest.raises(ValueError, match="not measured there") as caught:
        prepared(point)
    where = traceback.extract_tb(caught.value.__traceback__)[-1]
    assert (where.filename, where.lineno) == (laws.LAW_FILE, 4)


def test_compiling_never_waits_for_a_law_to_let_a_packing_rest(monkeypatch):
    """The steps that compile a user's kernels are few, whatever the law does."""
    limits = []

    def note(point, _streams):
        limits.append(point.packing.equilibration.max_steps)
        raise SimulationError

    monkeypatch.setattr(preparation, "prepare", note)
    preparation.compile_kernels([packing_point(discs=20)])
    assert len(limits) == 1
    assert limits[0] <= 100


def test_a_law_that_does_not_work_fails_its_own_jobs_only():
    """The kernels of the others are compiled all the same."""
    broken = CustomLaw(kind="custom", source="def contact_force(a, b, c, d):\n    return open(a)\n")
    points = [packing_point(discs=20, contact_law=broken), packing_point(discs=20)]
    preparation.compile_kernels(points)
    with pytest.raises(SimulationError, match=r"contact law .*: line 2: cannot be compiled"):
        prepared(points[0])
