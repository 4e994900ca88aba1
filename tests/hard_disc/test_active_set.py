"""The contact forces of one instant: unique, so every method must find the same (appendix A)."""

import numpy as np
import pytest
from hard_discs import dense, forces, instant
from scipy.optimize import nnls

from shear_sim.models.hard_disc.active_set import ActiveSet, Drive, Jammed

TOUCH = 1e-13


def random_network(rng, discs, contacts):
    """Discs at random places, and some of the pairs of near neighbours declared to touch."""
    x, y = rng.random((2, discs)) * np.sqrt(discs)
    i, j = np.triu_indices(discs, 1)
    near = np.argsort(np.hypot(x[j] - x[i], y[j] - y[i]))[: 3 * contacts]
    chosen = np.sort(rng.choice(near, min(contacts, len(near)), replace=False))
    i, j = i[chosen].astype(np.int32), j[chosen].astype(np.int32)
    return i, j, x[j] - x[i], y[j] - y[i]


def rewired(n, q):
    """The paper's procedure, section IV B, word by word, from all touching pairs."""
    inside = np.ones(len(q), bool)
    for _ in range(1000):
        while True:
            phi = np.zeros(len(q))
            phi[inside] = np.linalg.solve(n[np.ix_(inside, inside)], -q[inside])
            if phi.min() >= 0:
                break
            inside[np.argmin(phi)] = False
        speed = n @ phi + q
        removed = np.flatnonzero(~inside)
        if not len(removed) or speed[removed].min() >= -1e-12:
            return phi
        inside[removed[np.argmin(speed[removed])]] = True
        phi = np.zeros(len(q))
        phi[inside] = np.linalg.solve(n[np.ix_(inside, inside)], -q[inside])
    pytest.fail("rewiring does not end")


def drive(rng, discs, pressure=0.0):
    compression = 100.0 if pressure else float(rng.normal())  # until the first contact
    return Drive(1.0, compression, pressure, rng.normal(size=(2, discs)))


def test_forces_of_regular_networks_by_three_methods():
    """1,000 states: dual active set = SciPy's NNLS = the paper's rewiring."""
    rng = np.random.default_rng(1)
    made = 0
    while made < 1000:
        discs = int(rng.integers(4, 13))
        i, j, rx, ry = random_network(rng, discs, int(rng.integers(2, 2 * discs - 2)))
        now = instant(i, j, rx, ry, rng.uniform(0.5, 2, discs), drive(rng, discs))
        n, q, s, xi = dense(now)
        if np.linalg.eigvalsh(n)[0] < 1e-6 * np.trace(n):
            continue
        made += 1
        found = ActiveSet(len(i))
        found.start(now, TOUCH)
        phi = forces(found, now)
        low = np.linalg.cholesky(n)
        other, _ = nnls(low.T, -np.linalg.solve(low, q))
        literal = rewired(n, q)
        scale = max(1.0, np.abs(other).max())
        for forces_of_method in (other, literal):
            assert np.array_equal(phi > 0, forces_of_method > 1e-11 * scale)
            assert np.abs(xi * (s.T @ (phi - forces_of_method))).max() < 1e-9 * scale


def test_velocities_of_singular_networks():
    """200 states with more contacts than freedoms: velocities are unique, forces are not."""
    rng = np.random.default_rng(2)
    made = 0
    while made < 200:
        discs = int(rng.integers(4, 9))
        i, j, rx, ry = random_network(rng, discs, 2 * discs + int(rng.integers(0, 4)))
        mobility = rng.uniform(0.5, 2, discs)
        now = instant(i, j, rx, ry, mobility, Drive(0.0, 0.0, 0.0, rng.normal(size=(2, discs))))
        _, _, s, xi = dense(now)
        if np.linalg.matrix_rank(s) == len(i):
            continue
        made += 1
        found = ActiveSet(len(i))
        found.start(now, TOUCH)
        root = np.sqrt(xi)
        other, _ = nnls(root[:, None] * s.T, -now.drive.drift.ravel() / root)
        u = now.drive.drift.ravel() + xi * (s.T @ other)
        assert np.abs(found.velocities(now).ravel() - u).max() < 1e-9
        assert (s @ u).min() > -1e-9


def pressure_of(now, kappa):
    """Σ φ r² at an imposed compression, by NNLS."""
    n, q, _, _ = dense(now._replace(drive=now.drive._replace(compression=kappa)))
    low = np.linalg.cholesky(n)
    phi, _ = nnls(low.T, -np.linalg.solve(low, q))
    return phi @ (now.rx**2 + now.ry**2), phi


def test_forces_at_fixed_pressure():
    """200 states: the bordered active set = NNLS at the κ that bisection finds for the pressure."""
    rng = np.random.default_rng(3)
    made = 0
    while made < 200:
        discs = int(rng.integers(4, 13))
        i, j, rx, ry = random_network(rng, discs, int(rng.integers(2, 2 * discs - 2)))
        pressure = float(rng.uniform(0.1, 10))
        area = float(discs)
        now = instant(
            i, j, rx, ry, rng.uniform(0.5, 2, discs), drive(rng, discs, pressure), area=area
        )
        n, _, s, xi = dense(now)
        if np.linalg.eigvalsh(n)[0] < 1e-5 * np.trace(n):
            continue
        made += 1
        found = ActiveSet(len(i))
        found.start(now, TOUCH)
        phi = forces(found, now)
        assert phi @ (rx**2 + ry**2) == pytest.approx(2 * pressure * area, rel=1e-11)
        low, high = -1e4, 1e4
        for _ in range(100):
            middle = 0.5 * (low + high)
            load, other = pressure_of(now, middle)
            low, high = (middle, high) if load < 2 * pressure * area else (low, middle)
        scale = max(1.0, np.abs(other).max())
        assert found.kappa == pytest.approx(middle, abs=1e-8 * scale)
        assert np.abs(xi * (s.T @ (phi - other))).max() < 1e-8 * scale


def test_a_self_stress_stops_nothing_at_fixed_pressure():
    """A ring of three touching discs around the cell bears itself: N is singular, the flow is not.

    By symmetry all forces are equal, φ = 2pΩ / Σr², and the ring pushes no disc.
    """
    i = np.array([0, 1, 0], np.int32)
    j = np.array([1, 2, 2], np.int32)
    rx, ry = np.array([1.0, 1.0, -1.0]), np.zeros(3)
    now = instant(i, j, rx, ry, np.ones(3), Drive(1.0, 1.0, 5.0, np.zeros((2, 3))), area=9.0)
    n, _, _, _ = dense(now)
    assert np.linalg.eigvalsh(n)[0] < 1e-15
    found = ActiveSet(3)
    found.start(now, TOUCH)
    assert forces(found, now) == pytest.approx(np.full(3, 2 * 5.0 * 9.0 / 3), rel=1e-12)
    assert found.kappa == pytest.approx(0.0, abs=1e-12)
    assert np.abs(found.velocities(now)).max() < 1e-10


def test_the_same_ring_is_jammed_by_compression():
    i = np.array([0, 1, 0], np.int32)
    j = np.array([1, 2, 2], np.int32)
    rx, ry = np.array([1.0, 1.0, -1.0]), np.zeros(3)
    now = instant(i, j, rx, ry, np.ones(3), Drive(0.0, 1.0, 0.0, np.zeros((2, 3))))
    with pytest.raises(Jammed) as jam:
        ActiveSet(3).start(now, TOUCH)
    assert sorted(jam.value.pairs) == [0, 1, 2]
    assert jam.value.force == pytest.approx(np.ones(3), rel=1e-9)


def test_permanent_contacts_pull():
    """Two discs that are held together and driven apart: the contact pulls with half of both."""
    force = np.array([[-1.0, 1.0], [0.0, 0.0]])
    i, j = np.array([0], np.int32), np.array([1], np.int32)
    now = instant(
        i, j, np.ones(1), np.zeros(1), np.ones(2), Drive(0.0, 0.0, 0.0, force),
        permanent=np.ones(1, np.int32),
    )  # fmt: skip
    found = ActiveSet(1)
    found.start(now, TOUCH)
    assert found.phi == pytest.approx([-1.0])
    assert np.abs(found.velocities(now)).max() < 1e-15
