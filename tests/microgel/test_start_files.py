"""Explicit initial states: what a state file may not hold is refused, not simulated."""

import numpy as np
import pytest
from scenes import evaluate, finish, prepared, scene

from shear_sim.models.interface import SimulationError
from shear_sim.models.microgel.parameters import Links, Microgel, MicrogelPoint
from shear_sim.models.microgel.simulation import make_pairs
from shear_sim.packing import Packing
from shear_sim.protocol import OscillatoryShear

STATE = {
    "x": np.array([1e-4, 1.5e-4, 2.0e-4]),
    "y": np.array([1e-4, 1.1e-4, 1.0e-4]),
    "radius": np.full(3, 3e-5),
    "link_i": np.array([0, 1]),
    "link_j": np.array([1, 2]),
}


def start(tmp_path, **changes):
    path = tmp_path / "state.npz"
    np.savez(path, **(STATE | changes))
    return prepared(
        MicrogelPoint(
            packing=Packing(start="file", file=path),
            model=Microgel(links=Links(cut="file")),
            shear=OscillatoryShear(pre_periods=0, periods=0.1, post_periods=0),
        )
    )


def test_links_of_a_state_file(tmp_path):
    simulation = start(tmp_path)
    assert simulation.n_links == 2
    assert np.isfinite(finish(simulation)["shear_stress"]).all()


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"link_i": np.array([0, 0]), "link_j": np.array([1, 1])}, "twice"),
        ({"link_i": np.array([0, 1]), "link_j": np.array([1, 0])}, "twice"),
        ({"link_i": np.array([0, 2]), "link_j": np.array([1, 2])}, "itself"),
        ({"link_i": np.array([0, -1]), "link_j": np.array([1, 2])}, "disc -1"),
        ({"link_i": np.array([0, 1]), "link_j": np.array([1, 3])}, "disc 3"),
        ({"contact_i": np.array([0]), "contact_j": np.array([1])}, "twice"),
        ({"x": np.array([1e-4, 1e-4, 2e-4]), "y": np.full(3, 1e-4)}, "one place"),
    ],
    ids=["twice", "reversed", "itself", "negative", "beyond", "link-and-contact", "coincident"],
)
def test_impossible_pairs_are_refused(tmp_path, changes, word):
    """A pair listed twice would act twice, and overrun the new pair list at its next renewal."""
    with pytest.raises(SimulationError, match=word):
        start(tmp_path, **changes)


def test_order_of_a_pair_does_not_matter():
    """A link given as (1, 0) is one link, not a link and a contact on top of it."""
    position = [(0.0, 0.0), (1.8, 0.3)]
    one = scene(position, 1.0, links=[(0, 1)], k=1.0, step=0.1, steps=1)
    other = scene(position, 1.0, links=[(1, 0)], k=1.0, step=0.1, steps=1)
    for s in (one, other):
        s.advance(1)
        assert len(s.pairs.i) == 1
    assert np.array_equal(evaluate(one).force, evaluate(other).force)
    pairs = make_pairs(np.array([(2, 1)]), np.array([(1, -1)]))
    assert (pairs.i[0], pairs.j[0], pairs.nx[0], pairs.ny[0]) == (1, 2, -1, 1)


@pytest.mark.parametrize("speed", [1e13, -1e13])
def test_a_disc_shot_across_billions_of_cells_stops_the_run(speed):
    """Its image number does not fit any integer: go on, and it acts from outside the cell."""
    simulation = scene(
        [(100.0, 100.0), (180.0, 100.0)], 60.0, velocity=np.array([(speed, 0), (0, 0)]), k=1.0,
        periodic=True, step=1.0, steps=3,
    )  # fmt: skip
    with pytest.raises(SimulationError, match="disc 0"):
        simulation.advance(4)
