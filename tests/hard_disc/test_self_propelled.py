"""Discs with forces of their own."""

import numpy as np
import pytest
from hard_discs import finished, flow, packing, point

from shear_sim.models.hard_disc.driving import SelfPropelled
from shear_sim.models.hard_disc.parameters import HardDiscSelfPropulsion
from shear_sim.streams import Streams

SECTION = {"kind": "self_propelled", "duration": 3.0, "persistence": 2.0}


def test_forces_have_mean_square_one_and_any_direction():
    for force in ("uniform", "fixed"):
        section = HardDiscSelfPropulsion(kind="self_propelled", force=force)
        drift = SelfPropelled(section, np.ones(20_000), Streams(0, 0)).drive.drift
        # Standard errors over 20,000 discs: under 0.007 and 0.005.
        assert (drift**2).sum(axis=0).mean() == pytest.approx(1.0, abs=0.03)
        assert np.abs(drift.mean(axis=1)).max() < 0.025


class Nobody:
    """In place of a flow: takes each new drive, and nothing moves."""

    def steer(self, drive):
        self.drive = drive


def test_forces_last_for_half_the_persistence_on_average_and_move_by_mobility():
    """Uniform times of mean ½ and variance 1/12: of 200 discs 200 (20 − ⅓) turns in ten of them.

    The renewal theorem; its standard deviation here is 36.
    """
    section = HardDiscSelfPropulsion(kind="self_propelled", persistence=3.0, force="fixed")
    mobility = np.linspace(0.5, 2.0, 200)
    driving, turns = SelfPropelled(section, mobility, Streams(0, 0)), 0
    while driving.until < 30.0:
        driving.change(Nobody())
        turns += 1
    assert turns == pytest.approx(200 * (20 - 1 / 3), abs=5 * 36)
    assert np.hypot(*driving.drive.drift) == pytest.approx(mobility, rel=1e-12)


def test_contacts_change_no_momentum():
    """Σ V = ξ Σ F at every instant (equal mobilities), whoever pushes whom."""
    position, radius, side = packing(40, 0.5, 3)
    driving = SelfPropelled(HardDiscSelfPropulsion(**SECTION), np.ones(40), Streams(1, 0))
    f = flow(position, radius, side)
    f.steer(driving.drive)
    for _ in range(150):
        if f.path < driving.until:
            f.step(driving.until)
        else:
            driving.change(f)
        u = f.set.velocities(f.instant())
        assert u.sum(axis=1) == pytest.approx(f.drive.drift.sum(axis=1), abs=1e-12 * 40)
        assert f.gap.min() > -1e-12
        assert f.set.phi.min(initial=0.0) >= -1e-9 * np.abs(f.set.phi).sum()
    assert f.counts.collisions > 20


def test_a_run_of_self_propelled_discs():
    run = finished(point(packing={"discs": 40, "packing_fraction": 0.5}, shear=SECTION))
    summary = run.summary()
    assert summary["checks"]["power_residual"] < 1e-10
    assert summary["checks"]["largest_overlap"] < 1e-12
    # Contacts only slow discs down: Σ u² ≤ Σ (ξF)², as u is the nearest velocity without overlap.
    assert 0.2 < summary["measured"]["nonaffine_speed"] < 1.0
    assert summary["measured"]["contact_number"] > 0
