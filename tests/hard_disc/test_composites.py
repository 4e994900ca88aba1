"""Composite particles: beads in permanent contact, which may pull as well as push."""

import numpy as np
import pytest
from hard_discs import flow, overlap

from shear_sim.models.hard_disc.active_set import Jammed
from shear_sim.models.hard_disc.certificate import certify, is_proof

TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, np.sqrt(0.75)]])
EDGES = np.array([[0, 1], [1, 2], [0, 2]])


def triples(bodies, side, seed=0):
    """Rigid triples of touching beads (radius 0.5) at random places, turned at random."""
    rng = np.random.default_rng(seed)
    beads = np.zeros((0, 2))
    while len(beads) < 3 * bodies:
        angle = rng.uniform(0, 2 * np.pi)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        new = TRIANGLE @ turn.T + rng.random(2) * side
        apart = new[:, None] - beads
        apart -= side * np.rint(apart / side)
        if (np.hypot(apart[..., 0], apart[..., 1]) > 1.01).all():
            beads = np.vstack([beads, new])
    bonds = (3 * np.arange(bodies)[:, None, None] + EDGES).reshape(-1, 2)
    return beads, bonds


def bond_lengths(f):
    permanent = f.permanent == 1
    return np.hypot(f.rx[permanent], f.ry[permanent])


def test_bonds_pull_and_push():
    """A row of three bonded discs, pulled at one end: the other two follow at the same speed."""
    f = flow(
        [(5, 5), (6, 5), (7, 5)], 0.5, bonds=[(0, 1), (1, 2)], velocity=[(-3, 0), (0, 0), (0, 0)]
    )
    f.advance(2.0)
    assert f.x == pytest.approx([3, 4, 5], abs=1e-12)
    assert sorted(f.set.phi) == pytest.approx([-2.0, -1.0])


def test_a_chain_folds_until_it_touches_itself():
    """Its ends pushed together, it ends as an equilateral triangle at rest."""
    f = flow(
        [(5 - np.cos(0.1), 5 + np.sin(0.1)), (5, 5), (5 + np.cos(0.1), 5 + np.sin(0.1))],
        0.5, bonds=[(0, 1), (1, 2)], velocity=[(1, 0), (0, 0), (-1, 0)],
    )  # fmt: skip
    f.advance(20.0)
    assert f.x[2] - f.x[0] == pytest.approx(1.0, abs=1e-12)
    assert f.y[0] - f.y[1] == pytest.approx(np.sqrt(0.75), abs=1e-11)
    assert f.counts.collisions == 1
    assert len(f.set.pairs) == 3
    assert np.abs(f.set.velocities(f.instant())).max() < 1e-9


def test_a_rigid_triple_turns_with_the_flow():
    """In simple shear a body of equal beads at the corners of a triangle turns by −γ/2.

    Its drag is isotropic: torque-free rotation at the vorticity of the flow, and no net force.
    """
    f = flow(TRIANGLE + 5, 0.5, bonds=EDGES, shear=1)
    centre = np.array([f.x.mean(), f.y.mean()])
    f.advance(1.0)
    dx, dy = f.x[1] - f.x[0], f.y[1] - f.y[0]
    dx -= f.width * np.rint(dx / f.width)
    assert np.arctan2(dy, dx) == pytest.approx(-0.5, abs=1e-11)
    assert bond_lengths(f) == pytest.approx(np.ones(3), abs=1e-12)
    moved = np.array([f.x.mean(), f.y.mean()]) - centre
    assert moved[1] == pytest.approx(0.0, abs=1e-12)


def test_a_suspension_of_rigid_triples():
    """Bonds keep their length over strain 1, and drag balances force and torque of every body."""
    position, bonds = triples(16, 9.2)
    f = flow(position, 0.5, side=9.2, bonds=bonds, compression=1)
    f.advance(0.13)  # from φ = 0.45 to 0.58
    f.turn(f.drive._replace(shear=1.0, compression=0.0))
    start = f.path
    while f.path < start + 1:
        f.step(start + 1)
        assert np.abs(bond_lengths(f) - 1).max() < 1e-12
        assert f.gap.min() > -1e-12
    assert overlap(f) < 1e-12
    assert f.counts.collisions > 30
    # Forces within a body cancel: those from outside and the drag of its beads balance.
    c = f.set.pairs
    inside = f.permanent[c] == 1
    assert inside.sum() == len(bonds)
    assert (f.set.phi[~inside] >= -1e-9 * np.abs(f.set.phi).mean()).all()
    outside = c[~inside]
    phi = f.set.phi[~inside]
    push = np.zeros((2, 48))
    for component, r in zip(push, (f.rx[outside], f.ry[outside]), strict=True):
        np.add.at(component, f.pairs.i[outside], -phi * r)
        np.add.at(component, f.pairs.j[outside], phi * r)
    u = f.set.velocities(f.instant())
    unbalanced = (push - u).reshape(2, 16, 3)
    assert np.abs(unbalanced.sum(axis=2)).max() < 1e-10 * max(1, np.abs(phi).max())
    arm = np.array([f.x, f.y]).reshape(2, 16, 3)
    arm = arm - arm[:, :, :1]  # from the first bead, by its nearest image
    up = np.rint(arm[1] / f.height)
    arm[1] -= up * f.height
    arm[0] -= up * f.offset
    arm[0] -= np.rint(arm[0] / f.width) * f.width
    assert np.hypot(*arm).max() < 1.0 + 1e-12
    torque = (arm[0] * unbalanced[1] - arm[1] * unbalanced[0]).sum(axis=1)
    assert np.abs(torque).max() < 1e-10 * max(1, np.abs(phi).max())


@pytest.mark.parametrize("seed", range(3))
def test_compressed_bodies_jam_with_all_beads_counted(seed):
    """N_c = 2 N − 1 with the bonds among the contacts, of the beads that are held at all.

    The bodies are triples of unequal beads: equal ones interlock as crystals do.
    """
    bodies, side = 12, 9.0
    rng = np.random.default_rng(seed)
    beads, radius = np.zeros((0, 2)), np.zeros(0)
    while len(beads) < 3 * bodies:
        a, b, c = rng.uniform(0.35, 0.55, 3)
        # Corners of the triangle with sides a + b, b + c, c + a.
        x = ((a + b) ** 2 + (a + c) ** 2 - (b + c) ** 2) / (2 * (a + b))
        corners = np.array([[0, 0], [a + b, 0], [x, np.sqrt((a + c) ** 2 - x**2)]])
        new = corners + rng.random(2) * side
        apart = new[:, None] - beads
        apart -= side * np.rint(apart / side)
        far = np.array([[a], [b], [c]]) + radius + 0.01
        if (np.hypot(apart[..., 0], apart[..., 1]) > far).all():
            beads, radius = np.vstack([beads, new]), np.concatenate([radius, [a, b, c]])
    bonds = (3 * np.arange(bodies)[:, None, None] + EDGES).reshape(-1, 2)
    f = flow(beads, radius, side, bonds=bonds, compression=1)
    with pytest.raises(Jammed) as jam:
        f.advance(2.0)
    found = certify(f.instant(), jam.value, f.path)
    assert is_proof(found)
    assert found["isostatic"]
    pairs, force = jam.value.pairs, jam.value.force
    i, j, rx, ry = f.instant().contacts(pairs)
    push = np.zeros((2, len(radius)))
    for component, r in zip(push, (rx, ry), strict=True):
        np.add.at(component, i, -force * r)
        np.add.at(component, j, force * r)
    assert np.abs(push).max() < 1e-7 * np.abs(force).max()
    temporary = f.permanent[pairs] == 0
    assert (force[temporary] > 0).all()
    held = len(np.unique(np.concatenate([i, j]) // 3))
    assert temporary.sum() + 3 * held == 2 * 3 * held - 1
    assert found["discs"] == 3 * held


def test_bonds_must_touch():
    with pytest.raises(ValueError, match="1 bonds join discs that do not touch"):
        flow([(5, 5), (7, 5)], 0.5, bonds=[(0, 1)])
