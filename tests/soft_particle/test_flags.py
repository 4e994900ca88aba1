"""Flags: runs that are too fast, or whose steps are too long, say so."""

import numpy as np
import pytest
from soft_particles import finished, points

from shear_sim.models.soft_particle.simulation import FLAGS, MISSING_ALONE, flags_of


@pytest.mark.parametrize("flag", FLAGS)
def test_a_flag_is_up_beyond_its_limit(flag):
    """And where the number means nothing; what a run does not measure has no flag."""
    shear = {"kind": "vibration", "periods": 2}
    simulation = finished(points(packing={"vertices": 12}, model={}, shear=shear)())
    name, limit = FLAGS[flag]
    limit = MISSING_ALONE if flag == "energy_missing" else limit
    for value, up in ((0.99 * limit, False), (1.01 * limit, True), (np.nan, True)):
        simulation.run.measured = lambda _, value=value: {name: value, "final_strain": 9.0}
        assert simulation.summary()["flags"] == {flag: up}
    simulation.done -= 1  # not at its end yet
    assert simulation.summary()["flags"] == {}


def test_a_pack_may_miss_more_energy_than_a_single_chain():
    """1e-4 of the work, and 1e-6."""
    for missing, alone, up in ((9e-7, True, False), (2e-6, True, True), (2e-6, False, False)):
        flags = flags_of({"energy_missing_ratio": missing}, alone=alone)
        assert flags == {"energy_missing": up}


PLATES = points(
    packing={"vertices": 40}, model={"yield_moment": 0.02},
    shear={"kind": "diametral_compression", "compression": 0.3, "unload": False},
    integrator={"step": 0.4},
)  # fmt: skip
SUNK = points(
    packing={"vertices": 40}, model={"core_ratio": 10.0},
    shear={"kind": "diametral_compression", "compression": 0.35, "relative_rate": 0.01,
           "unload": False},
    integrator={"step": 0.4},
)  # fmt: skip
BOX = points(
    packing={"particles": 9, "vertices": 24, "spread": 0.1},
    model={"thickness": 0.1, "contact_stiffness": 33, "inner_damping": 1.0, "drag": 0},
    shear={"kind": "compaction", "strain": 0.2, "unload": False, "relative_rate": 0.002},
    integrator={"step": 0.4}, record={"rows": 40},
)  # fmt: skip


@pytest.mark.parametrize(
    ("given", "up"),
    [
        (PLATES(shear={"relative_rate": 0.001}), []),
        (PLATES(shear={"relative_rate": 0.05}), ["inertia", "drag"]),
        (PLATES({"drag": 0.0}, shear={"relative_rate": 0.05}), ["inertia"]),
        (PLATES(packing={"vertices": 20}, shear={"relative_rate": 0.001}), ["coarse"]),
        (SUNK(), ["sunk"]),
        (SUNK({"contact_stiffness": 100.0}), []),
        (BOX(), []),
        (BOX(shear={"relative_rate": 0.05}), ["inertia"]),
        (BOX(model={"drag": 0.1}), ["drag"]),
        (
            BOX(model={"contact_stiffness": 1000, "damping": 0.0}, integrator={"step": 0.89}),
            ["energy_missing"],
        ),
    ],
)
def test_flags_of_runs(given, up):
    """A ring and a box that are pressed slowly have none, and each fault its own."""
    flags = finished(given).summary()["flags"]
    plates = given.shear.kind == "diametral_compression"
    names = [name for name in FLAGS if name not in ("coarse", "sunk") or plates]
    assert flags == {name: name in up for name in names}


def test_the_force_between_plates_is_that_before_they_brake():
    """Of hinges that yield, F R = 4 M^Y/√(1 − ε²); in braking a fast ring loses most of it."""
    run = finished(PLATES({"drag": 0.0}, shear={"relative_rate": 0.05}))
    table, measured = run.columns(), run.summary()["measured"]
    assert table["scaled_force"][-1] < 0.7 * measured["final_scaled_force"]
    law = 4.0 * 0.02 / np.sqrt(1.0 - measured["final_compression"] ** 2)
    assert measured["final_scaled_force"] == pytest.approx(law, rel=0.15)
