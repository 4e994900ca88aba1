"""Contacts and links are keyed by disc, disc and image, and no list ever misses one."""

import numpy as np
import pytest
from scenes import evaluate, finish, packing_point, prepared, scene, steady

from shear_sim.models.microgel import motion
from shear_sim.models.microgel.parameters import Links
from shear_sim.models.microgel.state import NX, column, listed, set_column
from shear_sim.packing import Cell
from shear_sim.protocol import OscillatoryShear


def touching(simulation, strain):
    """All touching pairs (i, j, n_x, n_y) by brute force over images, in the list's own frame."""
    d, c = simulation.discs, simulation.constants
    offset = strain * c.height - simulation.work.turns[0] * c.width
    i, j = np.triu_indices(len(d.x), 1)
    nx, ny = (n.ravel()[:, None] for n in np.mgrid[-4:5, -3:4])
    dx = d.x[j] - d.x[i] + nx * c.width + ny * offset
    dy = d.y[j] - d.y[i] + ny * c.height
    image, pair = np.nonzero(np.hypot(dx, dy) < d.radius[i] + d.radius[j])
    columns = (i[pair], j[pair], nx[image, 0], ny[image, 0])
    return set(zip(*(a.tolist() for a in columns), strict=True))


@pytest.mark.parametrize("rate", [0.02, -0.3])
@pytest.mark.parametrize("cut", ["none", "cells"])
def test_no_contact_is_ever_missed(rate, cut):
    """Steady shear to a strain of 4, slow and fast, in a rectangular cell.

    After every block each touching pair of a brute-force search is in the list once. A skin that
    forgets the flow across one contact, or the affine part of the motion, misses some.
    """
    simulation = prepared(
        packing_point(
            discs=24, links=Links(cut=cut), cell=Cell(width=400e-6, height=500e-6), friction=0.2,
            shear=steady(4.0, rate=rate), steps_per_period=200,
        )
    )  # fmt: skip
    simulation.advance(1)
    seen = 0
    while simulation.done < simulation.rows:
        simulation.advance(7)
        p = simulation.pairs
        strain = simulation._table[simulation.done - 1, 1]
        listed = list(zip(*(a.tolist() for a in (p.i, p.j, p.nx, p.ny)), strict=True))
        assert len(listed) == len(set(listed))
        there = touching(simulation, strain)
        assert there <= set(listed)
        seen += len(there)
        coordination = simulation._table[simulation.done - 1, 22]
        assert coordination == pytest.approx(2 * len(there) / 24)
    assert seen > 100
    assert abs(simulation.work.turns[0]) == 5


def test_a_huge_skin_gives_the_same_run():
    """The list is a matter of speed: with a skin as wide as the cell allows, nothing changes."""
    runs = []
    for skin in (None, 1.2):
        s = prepared(packing_point(discs=60, friction=0.2, shear=steady(0.3, rate=0.01)))
        if skin:
            s.constants = s.constants._replace(skin=skin * s.discs.radius.mean())
        runs.append(finish(s))
    scale = np.abs(runs[0]["pressure"]).max()
    assert np.abs(runs[0]["shear_stress"] - runs[1]["shear_stress"]).max() < 1e-8 * scale


def test_a_linked_pair_also_touches_through_another_image():
    """A link stretched across a small cell, and a contact of the same two discs: both act.

    Cell of 4 large radii: the link is 2.5 long, the other image 1.5 away.
    """
    s = scene(
        [(0.5, 2.0), (3.0, 2.0)], 1.0, width=4.0, height=4.0, periodic=True, links=[(0, 1)],
        k=1.0, skin=0.2, step=0.1, steps=1,
    )  # fmt: skip
    s.advance(1)
    e = evaluate(s)
    assert len(s.pairs.i) == 2
    assert (s.pairs.nx.tolist(), s.pairs.ny.tolist()) == ([0, -1], [0, 0])
    # Link pulls 0.5 to the right; the contact, on the left, pushes 0.5 to the right too.
    assert e.force[0] == pytest.approx((1.0, 0.0))
    # The link's own image is not a contact on top of it, even when it is compressed.
    s = scene(
        [(0.5, 2.0), (2.0, 2.0)], 1.0, width=4.0, height=4.0, periodic=True, links=[(0, 1)],
        k=1.0, skin=0.2, step=0.1, steps=1,
    )  # fmt: skip
    s.advance(1)
    assert evaluate(s).force[0] == pytest.approx((-0.5, 0.0))


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.8, -0.6)])
def test_a_link_stretched_by_cells_never_flips(direction):
    """Pulled apart over three cells: the force is k (d − D), linear, along the link, all the way.

    By the nearest image it would jump back at half a cell and pull the other way. (Contacts, which
    the two discs make on the way through other images, have no stiffness here.)
    """
    direction = np.array(direction)
    speed = 1.0
    s = scene(
        [(5.0, 5.0), 5.0 + 2.0 * direction], 1.0, width=10.0, height=9.0, periodic=True,
        velocity=np.array([(0, 0), speed * direction]), mass=[1e12, 1e12], links=[(0, 1)],
        link_k=1.0, skin=0.5, step=0.1, steps=350,
    )  # fmt: skip
    s.advance(1)
    stretch, pull = [], []
    for _ in range(350):
        s.advance(1)
        stretch.append(speed * 0.1 * (s.done - 1))
        pull.append((s.work.fx[0], s.work.fy[0]))
    stretch, pull = np.array(stretch), np.array(pull)
    assert np.abs(pull - stretch[:, None] * direction).max() < 1e-6
    assert stretch[-1] > 3 * 10


def test_a_link_under_flow_follows_the_lattice():
    """Two discs linked through the top edge, held at affine places: d of that image, at any γ.

    Over more than one re-gridding (γ L_y/L_x from 0 to 2.7).
    """
    s = scene(
        [(5.0, 8.5), (5.0, 0.4)], 1.0, width=10.0, height=9.0, periodic=True, mass=[1e12, 1e12],
        links=[(0, 1)], images=[(0, 1)], link_k=1.0, skin=0.5, strain_rate=0.1, step=0.1, steps=300,
    )  # fmt: skip
    s.advance(1)
    for row in range(1, 301):
        s.advance(1)
        strain = 0.01 * row
        branch = np.array([strain * 0.9, 0.9])
        d = np.hypot(*branch)
        expected = (d - 2.0) * branch / d
        k = 0
        p = s.pairs
        assert (p.i[k], p.j[k]) == (0, 1)
        got = np.array([p.ex[k], p.ey[k]]) * (p.distance[k] - 2.0)
        assert got == pytest.approx(expected, abs=1e-6)
    assert s.work.turns[0] >= 2


def test_springs_survive_renewal_and_stay_with_their_image():
    """A new list, discs renumbered by image or not: every spring is where it was."""
    s = prepared(
        packing_point(
            discs=40, links=Links(cut="cells"), friction=0.5,
            shear=OscillatoryShear(pre_periods=0, periods=0.3, post_periods=0),
        )
    )  # fmt: skip
    s.advance(40)
    strain = s._table[s.done - 1, 1]

    def keyed(pairs):
        p = listed(pairs)
        keys = zip(*(a.tolist() for a in (p.i, p.j, p.nx, p.ny)), strict=True)
        return {k: (v, t) for k, v, t in zip(keys, p.spring, p.state, strict=True) if v != 0}

    before, c = evaluate(s, strain, 0.0), s.constants
    renewed = (s.discs, s.work, s.links, s.contacts, c, strain)
    first = keyed(motion.renew_contacts(*renewed)), keyed(s.links)
    assert all(first)
    # Discs in other images of the cell, and every pair named accordingly.
    wx = np.random.default_rng(0).integers(-1, 2, 40)
    s.contacts = motion.renew_contacts(*renewed)
    s.discs.x[:] += wx * c.width
    for pairs in (s.links, s.contacts):
        set_column(pairs, NX, column(pairs, NX) - (wx[pairs.j] - wx[pairs.i]))
    s.contacts = motion.renew_contacts(s.discs, s.work, s.links, s.contacts, c, strain)
    assert (keyed(s.contacts), keyed(s.links)) == first
    after = evaluate(s, strain, 0.0)
    assert np.abs(before.force - after.force).max() < 1e-11 * np.abs(before.force).max()
