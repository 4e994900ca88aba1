"""Long motions: what must hold at every step, and what must not matter."""

import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from hard_discs import flow, overlap, packed_flow

from shear_sim.models.hard_disc.factor import Factor, back_substitute, factorise, triangularise
from shear_sim.models.hard_disc.flow import contacts_at
from shear_sim.models.hard_disc.series import first_crossing, travel


def distance(one, other):
    """The largest distance of a disc from its twin, which may be in another image."""
    dx, dy = one.x - other.x, one.y - other.y
    up = np.rint(dy / one.height)
    dy -= up * one.height
    dx -= up * one.offset
    dx -= np.rint(dx / one.width) * one.width
    return np.hypot(dx, dy).max()


def power(f):
    """Σ u²/ξ and Ω (g σ + 2 κ p), (HD.6)."""
    c = f.set.pairs
    u = f.set.velocities(f.instant())
    phi, rx, ry = f.set.phi, f.rx[c], f.ry[c]
    shear = -(phi * f.drive.shear * rx * ry).sum()
    compression = (phi * f.set.kappa * (rx**2 + ry**2)).sum()
    return (u**2 / f.mobility).sum(), shear + compression, abs(shear) + abs(compression)


@pytest.mark.parametrize("pressure", [0.0, 10.0, 1000.0])
def test_every_step_is_free_of_overlap_and_balances_power(pressure):
    f = packed_flow(shear=1, compression=10.0 if pressure else 0.0, pressure=pressure)
    for _ in range(400):
        f.step(5.0)
        assert f.gap.min() > -1e-12 * f.unit
        lost, put_in, scale = power(f)
        assert lost == pytest.approx(put_in, abs=1e-10 * scale)
        assert f.set.phi.min(initial=0.0) >= -1e-9 * np.abs(f.set.phi).mean()
        if pressure and len(f.set.pairs):
            c = f.set.pairs
            p = (f.set.phi * (f.rx[c] ** 2 + f.ry[c] ** 2)).sum() / (2 * f.area)
            assert p == pytest.approx(pressure, rel=1e-10)
    assert overlap(f) < 1e-12  # by all pairs and images, not by the list of candidates
    assert f.counts.collisions > 100
    assert f.counts.rebuilds > 2


@pytest.mark.parametrize("pressure", [0.0, 30.0])
def test_a_step_closes_the_gaps_of_contacts(pressure):
    """All discs put off by 1e-11: their contacts are closed again after one step (eq. 28)."""
    f = packed_flow(shear=1, compression=10.0 if pressure else 0.0, pressure=pressure)
    f.advance(0.4)
    f.x += 1e-11 * np.random.default_rng(0).normal(size=32)
    f.separate()
    assert np.abs(f.gap[f.set.pairs]).max() > 1e-12
    f.step(5.0)
    assert len(f.set.pairs) > 20
    assert np.abs(f.gap[f.set.pairs]).max() < 1e-13


@pytest.mark.parametrize("pressure", [0.0, 10.0])
def test_positions_do_not_depend_on_the_step(pressure):
    """The step bound cut by 5 and by 125 moves no disc by more than 1e-10 in 0.1 strain."""
    ends = []
    for divisor in (1, 5, 125):
        f = packed_flow(shear=1, compression=10.0 if pressure else 0.0, pressure=pressure)
        f.longest_step /= divisor
        f.advance(0.3)
        f.advance(0.4)
        ends.append(f)
    assert distance(ends[0], ends[1]) < 1e-10
    assert distance(ends[0], ends[2]) < 1e-10
    assert ends[2].counts.steps > 2 * ends[0].counts.steps


def test_the_integration_error_is_far_below_a_millionth():
    """N = 64, φ = 0.80, six packings: the step bound cut by five, over 0.1 strain of the flow."""
    worst = []
    for seed in range(6):
        f = packed_flow(64, 0.8, seed, shear=1)
        f.advance(0.1)
        again = pickle.loads(pickle.dumps(f))  # noqa: S301
        again.longest_step /= 5
        for one in (f, again):
            one.advance(0.2)
        worst.append(distance(f, again))
        assert 0.0 < f.counts.error < 1e-9
    assert np.median(worst) < 1e-10
    assert max(worst) < 1e-8


@pytest.mark.parametrize("accuracy", [1e-5, 1e-7, 1e-9])
def test_the_reported_error_bounds_that_of_a_pair_in_shear(accuracy):
    """cot θ = cot θ₀ + γ, followed loosely: the sum of last terms is above the error, not far."""
    start = 3.0
    f = flow([(10, 10), (10 + np.cos(start), 10 + np.sin(start))], 0.5, shear=1)
    f.accuracy, f.longest_step = accuracy, 1.0
    f.advance(4.0)
    error = abs(np.arctan2(f.ry[0], f.rx[0]) - np.arctan2(1.0, 1 / np.tan(start) + f.path))
    assert error < f.counts.error < 1000 * error


def test_an_overlap_is_counted():
    """Two discs put 1e-8 into each other by hand; nothing drives them."""
    f = flow([(5, 5), (6.05, 5)], 0.5)
    f.x[1] = 6 - 1e-8
    f.separate()
    f.advance(0.1)
    assert f.counts.largest_overlap == pytest.approx(1e-8, rel=1e-6)


NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


def test_the_area_follows_the_compression():
    """½ ln(φ_end/φ_start) = ∫κ, of the run and by quadrature of the κ that records show."""
    f = packed_flow(packing_fraction=0.79, shear=1, compression=10, pressure=10)
    start = f.packing_fraction
    squeezed = 0.0

    def look(motion, path, step):
        nonlocal squeezed
        at = 0.5 * step * (1 + NODES)
        kappa = [contacts_at(motion, t).kappa for t in at]
        squeezed += 0.5 * step * (WEIGHTS @ kappa)

    f.advance(0.5, look)
    change = 0.5 * np.log(f.packing_fraction / start)
    assert change == pytest.approx(f.squeezed, abs=1e-12)
    assert change == pytest.approx(squeezed, abs=1e-8)
    assert abs(change) > 1e-3


@pytest.mark.parametrize("pressure", [0.0, 100.0])
def test_nothing_overlaps_inside_a_step(pressure):
    """At four places within each step; the promise is 1e-9 mean diameters."""
    f = packed_flow(shear=1, compression=10.0 if pressure else 0.0, pressure=pressure)
    worst = []

    def look(motion, path, step):
        for t in step * np.array([0.2, 0.5, 0.8, 0.95]):
            x, y = motion.x.copy(), motion.y.copy()
            travel(x, y, np.zeros((2, len(x))), motion.u, motion.kappa, motion.shear, t)
            now = contacts_at(motion, t)
            shrink = np.sqrt(now.area / motion.area[0])
            offset = (motion.offset + motion.shear * t * motion.height) * shrink
            cell = {"width": motion.width * shrink, "height": motion.height * shrink}
            place = {"x": x, "y": y, "radius": f.radius, "unit": f.unit, "offset": offset}
            worst.append(overlap(SimpleNamespace(**place, **cell)))
            worst.append(np.abs(now.gap).max(initial=0.0) / f.unit)

    f.advance(0.25)
    f.advance(0.35, look)
    assert len(worst) >= 200
    assert max(worst) < 1e-12


def test_contacts_across_a_new_neighbour_list_stay():
    f = packed_flow(shear=1)
    f.advance(0.4)
    before, contacts = f.set.phi.sum(), len(f.set.pairs)
    f._find_candidates()
    assert len(f.set.pairs) == contacts
    assert f.set.phi.sum() == pytest.approx(before, rel=1e-10)


def test_factor_of_a_contact_matrix():
    """LDLᵀ solves the contact matrix, which NumPy builds from S."""
    f = packed_flow(64, shear=1)
    f.advance(0.3)
    now = f.instant()
    i, j, rx, ry = now.contacts(f.set.pairs)
    n = len(i)
    s = np.zeros((n, 2 * 64))
    rows = np.arange(n)
    for at, sign in ((i, -1), (j, 1)):
        s[rows, at] += sign * rx
        s[rows, 64 + at] += sign * ry
    xi = np.linspace(0.5, 2, 64)
    begin, row, value, pivot = factorise(n, i, j, rx, ry, xi)
    b = np.arange(1.0, n + 1)
    x = b.copy()
    factor = Factor(begin, row, value, pivot, np.zeros((4, 0)), np.zeros(3))
    back_substitute(factor, x)
    assert s @ (np.tile(xi, 2) * (s.T @ x)) == pytest.approx(b, rel=1e-9)
    again = triangularise(begin, row, i, j, rx, ry, xi)
    assert again[0] == pytest.approx(value, abs=1e-9)
    assert again[1] == pytest.approx(pivot, rel=1e-9)
    assert len(row) < n * n / 6  # in the order of nested dissection it stays sparse


@pytest.mark.parametrize(
    ("coefficients", "end", "expected"),
    [
        ((1.0, -2.0), 1.0, 0.5),
        ((0.25 - 1e-6, -1.0, 1.0), 2.0, 0.499),  # grazes: two roots 0.002 apart
        ((0.25 + 1e-6, -1.0, 1.0), 2.0, np.inf),  # and just misses
        ((1e-12, 0.0, 1.0), 1.0, np.inf),  # a pair that has just parted
        ((0.0, 1.0, -1.0), 2.0, 1.0),  # starts at 0, comes back
        ((1.0, 0.0, 0.0, -8.0), 0.4, np.inf),
        ((1.0, 0.0, 0.0, -8.0), 0.6, 0.5),
    ],
)
def test_first_crossing(coefficients, end, expected):
    """No root is stepped over, not even two close together."""
    p = np.array(coefficients)
    found = first_crossing(p, len(p) - 1, end, 1e-13, 1e-14)
    assert found == pytest.approx(expected, abs=2e-7 if expected != 0.5 else 1e-10)


@pytest.mark.parametrize("pressure", [0.0, 30.0])
def test_a_split_run_equals_a_whole_run_to_the_bit(pressure):
    """The state that a checkpoint holds is all that the motion depends on."""
    whole = packed_flow(shear=1, compression=10.0 if pressure else 0.0, pressure=pressure)
    for step in range(240):
        if step == 120:
            kept = pickle.dumps(whole)
        whole.step(5.0)
    again = pickle.loads(kept)  # noqa: S301
    for _ in range(120):
        again.step(5.0)
    for one, other in ((whole, again), (whole.set, again.set)):
        assert vars(one).keys() == vars(other).keys()
        for name, value in vars(one).items():
            if isinstance(value, np.ndarray):
                assert value.tobytes() == getattr(other, name).tobytes(), name
    assert (whole.path, whole.counts) == (again.path, again.counts)
    assert whole.counts.rebuilds > 3
