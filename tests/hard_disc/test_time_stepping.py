"""Time steps against events: first order, and never an overlap."""

import numpy as np
import pytest
from hard_discs import drive, finished, overlap, packed_flow, packing, point

from shear_sim.models.hard_disc.time_stepping import Marching


def marched(strain_step, strain, discs=32):
    position, radius, side = packing(discs, 0.8)
    x, y = position.T.copy()
    f = Marching(x, y, radius, np.ones(discs), side, side, drive(discs, shear=1))
    f.strain_step = strain_step
    for _ in range(round(strain / strain_step)):
        f.march()
        assert f.gap.min() > -1e-13
    assert overlap(f) < 1e-12
    return f


def test_positions_converge_with_the_first_order_to_those_of_events():
    exact = packed_flow(shear=1)
    exact.advance(0.1)
    errors = []
    for step in (1e-3, 5e-4, 2.5e-4):
        f = marched(step, 0.1)
        dx, dy = f.x - exact.x, f.y - exact.y
        up = np.rint(dy / f.height)
        dx -= up * f.offset
        dx -= f.width * np.rint(dx / f.width)
        errors.append(np.median(np.hypot(dx, dy - up * f.height)))
    assert errors[0] < 2e-3
    assert errors[0] / errors[2] == pytest.approx(4.0, rel=0.5)


def test_long_steps_make_no_overlap_either():
    marched(0.01, 0.5)


def test_a_run_in_time_steps():
    shear = {"kind": "steady", "strain": 0.3}
    steps = {"scheme": "time_steps", "strain_step": 0.0003}
    run = finished(point(shear=shear, integrator=steps))
    exact = finished(point(shear=shear)).columns()
    assert run.flow.counts.steps == 4 * 300
    mean = [c["scaled_shear_stress"].mean() for c in (run.columns(), exact)]
    assert mean[0] == pytest.approx(mean[1], rel=0.02)
    assert run.summary()["checks"]["largest_overlap"] < 1e-12
