"""Jamming: a certificate that can be checked by hand, or no verdict."""

import numpy as np
import pytest
from hard_discs import drive, flow, packed_flow, packing

from shear_sim.models import hard_disc
from shear_sim.models.hard_disc.active_set import Arrested, Jammed
from shear_sim.models.hard_disc.certificate import certify, constrained, is_proof
from shear_sim.models.hard_disc.parameters import HardDiscPoint
from shear_sim.streams import Streams


def jam(f, most=2.0):
    with pytest.raises(Jammed) as jammed:
        f.advance(most)
    return certify(f.instant(), jammed.value, f.path)


@pytest.mark.parametrize("seed", range(4))
def test_compression_ends_with_an_isostatic_certificate(seed):
    f = packed_flow(32, 0.75, seed, compression=1)
    found = jam(f)
    assert found["isostatic"]
    assert found["contacts"] == 2 * found["discs"] - 1
    assert found["discs"] + len(found["rattlers"]) == 32
    assert found["least_force"] > 0
    assert found["unbalanced_force"] < 1e-12
    assert found["smallest_singular_value"] < 1e-12
    assert found["second_singular_value"] > 1e-3
    assert found["load"] < 0
    assert 0.78 < f.packing_fraction < 0.87
    assert f.gap.min() > -1e-12


def test_contacts_that_nearly_bear_themselves_let_go():
    """Replicate 8 of the scene of configs/hard_disc.yaml: a collision there leaves 122 contacts
    with a least singular value of 8e-6. Forces are 1e12 times the load and nothing is jammed, until
    one more contact closes.
    """
    point = HardDiscPoint.model_validate(
        {
            "packing": {"discs": 64, "packing_fraction": 0.78},
            "shear": {"kind": "compression", "compression": 0.1},
        }
    )
    run = hard_disc.start(point, Streams(1, 8))
    run.advance(run.rows)
    assert run.status == "jammed"
    found = run.certificate
    assert found["contacts"] == 2 * found["discs"] - 1 == 123
    assert found["unbalanced_force"] < 1e-12
    assert found["second_singular_value"] > 1e-3


def test_a_jammed_packing_stays_jammed_and_decompression_frees_it():
    f = packed_flow(32, 0.75, 1, compression=1)
    jam(f)
    with pytest.raises(Jammed):
        f.turn(drive(32, compression=1))
    before = f.packing_fraction
    f.turn(drive(32, compression=-1))
    f.advance(f.path + 0.01)
    assert f.packing_fraction == pytest.approx(before * np.exp(-0.02), rel=1e-12)
    assert len(f.set.pairs) == 0


def test_shear_jams_a_dense_packing():
    """Certified against the shear: the same forces would not resist its reversal."""
    f = packed_flow(32, 0.83, 2, shear=1)
    found = jam(f)
    assert found["isostatic"]
    assert found["load"] < 0


def test_a_square_of_four_jams_where_geometry_says():
    """A 2 × 2 square lattice in a square cell is jammed when its rows touch: side = 2 diameters.

    It has eight contacts where four discs need seven: more than one state bears itself, and the
    certificate is one of them.
    """
    f = flow([(1, 1), (3.2, 1), (1, 3.2), (3.2, 3.2)], 0.5, side=4.4, compression=1)
    found = jam(f)
    assert f.width == pytest.approx(2.0, rel=1e-12)
    assert found["load"] < 0
    assert found["unbalanced_force"] < 1e-12


def test_a_disc_never_passes_its_own_image():
    """Two discs, one small enough to lie between the other's images: no pair of discs stops them.

    Without a word they went on to φ = 1.1.
    """
    f = flow([(2, 2), (4.5, 4.5)], [1.0, 0.2], side=5, compression=1)
    with pytest.raises(Arrested, match=r"of diameter 2, could touch its own image"):
        f.advance(2.0)
    assert 2.0 < f.width < 2.5


def test_a_cage_of_immobile_discs_jams_the_one_inside():
    """Three that go with the flow close on one: jammed at distance 1, N_c = 2 N̄ + 1 = 3."""
    angles = np.array([0.3, 2.1, 4.4])
    cage = 10 + 1.3 * np.column_stack([np.cos(angles), np.sin(angles)])
    f = flow([(10, 10), *cage], 0.5, mobility=[1, 0, 0, 0], compression=1)
    found = jam(f)
    assert is_proof(found)
    assert found["isostatic"]
    assert (found["contacts"], found["discs"], found["rattlers"]) == (3, 1, [])
    assert f.path == pytest.approx(np.log(1.3), rel=1e-12)


@pytest.mark.parametrize(("seed", "bears"), [(0, True), (7, False)])
def test_an_immobile_disc_pins_a_packing_only_where_it_bears(seed, bears):
    """N_c = 2 N̄ + 1 with it among those that bear force, 2 N̄ − 1 where it is a rattler."""
    position, radius, side = packing(32, 0.75, seed)
    mobility = np.ones(32)
    mobility[20] = 0.0
    found = jam(flow(position, radius, side, mobility=mobility, compression=1))
    assert is_proof(found)
    assert found["isostatic"]
    assert found["contacts"] == 2 * found["discs"] + (1 if bears else -1)


def test_a_disc_on_two_contacts_is_a_rattler():
    """Beside the caged disc another one lies in the notch of two of the cage, pushed into it."""
    angles = np.array([-np.pi / 2, np.pi / 6, 5 * np.pi / 6])
    cage = 10 + 1.02 * np.column_stack([np.cos(angles), np.sin(angles)])
    f = flow(
        [(10, 10), *cage, (10, 11.75)], [0.5, 0.5, 0.5, 0.5, 0.6], mobility=[1, 0, 0, 0, 1],
        compression=1, velocity=[(0, 0)] * 4 + [(0, -50)],
    )  # fmt: skip
    found = jam(f)
    assert is_proof(found)
    assert (found["contacts"], found["discs"], found["rattlers"]) == (3, 1, [4])
    c = f.contacts()
    assert ((c.i == 4) | (c.j == 4)).sum() == 2


def test_discs_with_fewer_than_three_contacts_do_not_count():
    """A chain hangs on a tetrahedron's graph: pruned one by one."""
    i = np.array([0, 0, 0, 1, 1, 2, 3, 4])
    j = np.array([1, 2, 3, 2, 3, 3, 4, 5])
    assert constrained(i, j, np.zeros(7, bool)).tolist() == [True] * 4 + [False] * 3


def test_an_overlapping_start_is_refused():
    position, radius, side = packing(16, 0.6)
    position[1] = position[0] + 0.1
    with pytest.raises(ValueError, match="discs 0 and 1 overlap by"):
        flow(position, radius, side, shear=1)


def test_a_jammed_run_says_so_and_keeps_its_records():
    point = HardDiscPoint.model_validate(
        {
            "packing": {"discs": 32, "packing_fraction": 0.78},
            "model": {"kind": "hard_disc"},
            "shear": {"kind": "compression", "compression": 0.2},
        }
    )
    run = hard_disc.start(point, Streams(0, 0))
    while run.done < run.rows:
        run.advance(10)
    summary, columns = run.summary(), run.columns()
    assert summary["status"] == "jammed"
    assert not summary["flags"]["stopped_early"]  # that is what compression is for
    assert summary["certificate"]["isostatic"]
    assert 0 < run.done < 201
    assert columns["compression"] == pytest.approx(columns["time"], abs=1e-12)
    assert (columns["packing_fraction"] <= summary["measured"]["final_packing_fraction"]).all()
    assert columns["scaled_pressure"][-1] > 10
    rattlers = 32 - summary["certificate"]["discs"]
    assert summary["measured"]["rattler_fraction"] == pytest.approx(rattlers / 32)


@pytest.mark.parametrize(
    "fault", [{"least_force": -1e-3}, {"unbalanced_force": 2.5e-3}, {"load": 1.0}]
)
def test_forces_that_pull_or_do_not_balance_or_help_prove_nothing(fault):
    certificate = jam(packed_flow(32, 0.75, 0, compression=1))
    assert is_proof(certificate)
    assert not is_proof(certificate | fault)
