"""Motions that a pencil can follow."""

import numpy as np
import pytest
from hard_discs import dense, flow, forces, overlap, packed_flow
from scipy.optimize import nnls


def angle(f):
    """Angle of the only candidate pair."""
    return np.arctan2(f.ry[0], f.rx[0])


@pytest.mark.parametrize("start", [2.0, 2.5, 3.0])
def test_a_pair_in_shear(start):
    """cot θ = cot θ₀ + γ, f = −½ r cos θ sin θ (ξ₀ = γ̇ = 1), and they part at θ = π/2."""
    f = flow([(10, 10), (10 + np.cos(start), 10 + np.sin(start))], 0.5, shear=1)
    opening = -1 / np.tan(start)
    while len(f.set.pairs):
        expected = np.arctan2(1.0, 1 / np.tan(start) + f.path)
        assert angle(f) == pytest.approx(expected, abs=1e-12)
        assert f.set.phi[0] == pytest.approx(-0.5 * np.cos(expected) * np.sin(expected), abs=1e-12)
        f.step(opening + 1)
    assert f.path == pytest.approx(opening, abs=1e-9)
    f.advance(opening + 0.2)
    assert f.rx[0] == pytest.approx(0.2, abs=1e-9)  # and drift apart with the flow, one row up
    assert f.counts.openings == 1


def test_a_pair_across_the_sheared_edge():
    """The same pair, one disc below the lower edge of a cell that is sheared through its image."""
    start, side = 3.0, 4.0
    second = (2 + np.cos(start), 3.95 + np.sin(start) - side)
    f = flow([(2, 3.95), (second[0] - 1.7, second[1])], 0.5, side, offset=1.7, shear=1)
    while len(f.set.pairs):
        expected = np.arctan2(1.0, 1 / np.tan(start) + f.path)
        c = f.set.pairs[0]
        turned = np.arctan2(f.ry[c], f.rx[c])
        assert np.sin(turned - expected) == pytest.approx(0.0, abs=1e-12)
        f.step(50.0)
    assert f.path == pytest.approx(-1 / np.tan(start), abs=1e-9)
    assert f.counts.rebuilds > 3  # the cell was brought back several times on the way


def test_a_pushed_row_of_three_with_unequal_mobilities():
    """One speed for all, F / Σ(1/ξ); each contact pushes what lies before it."""
    xi = np.array([0.5, 1.0, 3.0])
    force = 2.0
    f = flow(
        [(5, 5), (6, 5), (7.2, 5)], [0.5, 0.5, 0.7], mobility=xi,
        velocity=[(xi[0] * force, 0), (0, 0), (0, 0)],
    )  # fmt: skip
    speed = force / (1 / xi).sum()
    f.advance(1.0)
    assert f.x == pytest.approx(np.array([5, 6, 7.2]) + speed, abs=1e-12)
    contact = f.set.phi * np.hypot(f.rx[f.set.pairs], f.ry[f.set.pairs])
    assert sorted(contact) == pytest.approx(sorted([speed * (1 / xi[1:]).sum(), speed / xi[2]]))


def test_head_on():
    """Two discs pushed against each other meet, stop, and press with the force of both."""
    f = flow([(5, 5), (7, 5)], 0.5, velocity=[(1, 0), (-1, 0)])
    f.advance(2.0)
    assert f.counts.collisions == 1
    assert f.x == pytest.approx([5.5, 6.5], abs=1e-12)
    assert f.set.phi == pytest.approx([1.0], abs=1e-12)


def test_a_contact_opens_and_forms_again_at_once():
    """Pulled apart and pushed together at one instant, it bears what it bore, and nobody moved."""
    f = flow([(5, 5), (6, 5)], 0.5, velocity=[(1, 0), (-1, 0)])
    together = f.drive
    f.steer(together._replace(drift=-together.drift))
    assert len(f.set.pairs) == 0
    f.steer(together)
    assert f.set.phi == pytest.approx([1.0], abs=1e-15)
    f.advance(1.0)
    assert f.x == pytest.approx([5, 6], abs=1e-13)


def test_an_immobile_disc_stops_a_row():
    f = flow([(5, 5), (6.5, 5), (8, 5)], 0.5, mobility=[1, 1, 0], velocity=[(1, 0), (0, 0), (0, 0)])
    f.advance(3.0)
    assert f.x == pytest.approx([6, 7, 8], abs=1e-12)
    assert f.set.phi == pytest.approx([1.0, 1.0], abs=1e-12)


def test_three_meet_at_once():
    """Two discs reach a third from both sides at the same instant: one event or two, one result."""
    f = flow([(5, 5), (7, 5), (9, 5)], 0.5, velocity=[(1, 0), (0, 0), (-1, 0)])
    f.advance(3.0)
    assert f.x == pytest.approx([6, 7, 8], abs=1e-12)
    assert f.set.phi == pytest.approx([1.0, 1.0], abs=1e-12)


def test_a_disc_runs_into_a_notch():
    """Pushed between two fixed discs it comes to rest on both: f = F / (2 cos 30°)."""
    f = flow(
        [(10, 10.5), (10, 9.5), (7, 10.2)], 0.5, mobility=[0, 0, 1],
        velocity=[(0, 0), (0, 0), (1, 0)],
    )  # fmt: skip
    f.advance(20.0)
    assert (f.x[2], f.y[2]) == pytest.approx((10 - np.sqrt(0.75), 10), abs=1e-11)
    assert f.set.phi == pytest.approx([1 / np.sqrt(3)] * 2, rel=1e-9)


@pytest.mark.parametrize("angle", [1e-3, 1e-5, 1e-7, 1e-9])
def test_a_disc_on_two_nearly_opposite_ones(angle):
    """f = F / (2 sin α), although λ_min = 2 sin² α of N is under its round-off from 1e-8 on."""
    ends = [(10 - np.cos(angle), 10), (10 + np.cos(angle), 10), (10, 10 + np.sin(angle))]
    f = flow(ends, 0.5, mobility=[0, 0, 1], velocity=[(0, 0), (0, 0), (0, -3)])
    assert f.set.phi == pytest.approx([1.5 / np.sin(angle)] * 2, rel=1e-15 / angle + 1e-12)
    assert np.abs(f.set.velocities(f.instant())).max() < 1e-14


def test_a_crystal_patch_turns_and_shrinks_as_a_block():
    """Seven equal discs, twelve contacts: one more than a rigid body needs (hyperstatic).

    Compressed, the patch stays rigid: u = κ (R − R_c), whatever its forces are.
    """
    angles = np.arange(6) * np.pi / 3 + 0.2
    position = np.vstack([[10, 10], np.column_stack([np.cos(angles), np.sin(angles)]) + 10])
    f = flow(position, 0.5, compression=1.0)
    u = f.set.velocities(f.instant())
    assert np.abs(u.T - (position - 10)).max() < 1e-9
    f.advance(0.3)
    assert overlap(f) < 1e-12
    assert (np.hypot(f.x[1:] - f.x[0], f.y[1:] - f.y[0])) == pytest.approx(np.ones(6), abs=1e-12)


def test_free_discs_follow_the_flow():
    f = flow([(5, 5), (9, 9)], 0.5, shear=1, compression=0.5)
    f.advance(0.3)
    shrink = np.exp(-0.5 * 0.3)
    assert (f.x[1] - f.x[0], f.y[1] - f.y[0]) == pytest.approx(
        (shrink * (4 + 4 * 0.3), shrink * 4), abs=1e-13
    )
    assert f.width == pytest.approx(20 * shrink, rel=1e-14)


def test_stop_and_restart():
    """Forces vanish when the flow stops; the same network and forces are back when it restarts."""
    f = packed_flow(shear=1)
    f.advance(0.4)
    pairs, phi = f.set.pairs, f.set.phi
    going = f.drive
    f.turn(going._replace(shear=0.0))
    assert len(f.set.pairs) == 0
    x = f.x.copy()
    f.advance(0.5)
    assert np.array_equal(x, f.x)
    f.turn(going)
    assert np.array_equal(pairs, f.set.pairs)
    assert f.set.phi == pytest.approx(phi, rel=1e-12, abs=1e-12 * phi.max())


@pytest.mark.parametrize(("discs", "strain"), [(32, 0.4), (256, 0.1)])
def test_reversal_gives_the_forces_of_the_reversed_problem_at_once(discs, strain):
    f = packed_flow(discs, shear=1)
    f.advance(strain)
    touching = np.flatnonzero(f.gap < f.touch)
    f.turn(f.drive._replace(shear=-1.0))
    now = f.instant()
    n, q, _, _ = dense(now)
    low = np.linalg.cholesky(n[np.ix_(touching, touching)])
    other, _ = nnls(low.T, -np.linalg.solve(low, q[touching]))
    assert forces(f.set, now)[touching] == pytest.approx(other, abs=1e-9 * max(1, other.max()))


def test_trajectories_do_not_depend_on_the_scale_of_forces():
    """Four times the force: the same path in a quarter of the time, to the bit."""
    rng = np.random.default_rng(4)
    velocity = rng.normal(size=(32, 2))
    one = packed_flow(packing_fraction=0.6, velocity=velocity)
    four = packed_flow(packing_fraction=0.6, velocity=4 * velocity)
    one.longest_step, four.longest_step = 0.04, 0.01
    one.advance(0.8)
    four.advance(0.2)
    assert one.counts.collisions > 10
    assert np.abs(one.x - four.x).max() < 1e-12
