"""Starts: sizes, counts, crystals and random positions."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shear_sim.packing import Cell, Packing, radii, start_discs
from shear_sim.streams import Streams


@given(
    n=st.integers(1, 300), fraction=st.floats(0.1, 2.5), ratio=st.floats(1.0, 5.0),
    area=st.floats(1e-12, 1e3),
)  # fmt: skip
@settings(deadline=None)
def test_packing_fraction_is_exact_for_the_real_counts(n, fraction, ratio, area):
    """φ = Σ π r_i² / A (S1-14) also for odd N; the historical fair coin misses it by 3 %."""
    r = radii(Packing(discs=n, packing_fraction=fraction, size_ratio=ratio), area)
    assert (np.pi * r**2).sum() / area == pytest.approx(fraction, rel=1e-13)
    large = math.ceil(n / 2)
    assert (r[:large] == r[0]).all()
    assert (r[large:] == r[-1]).all()
    if n > 1:
        assert r[0] / r[-1] == pytest.approx(ratio, rel=1e-13)


def test_random_positions_fill_the_cell_and_follow_their_stream():
    cell = Cell(width=4e-4, height=6e-4)
    packing = Packing(discs=400)
    a = start_discs(packing, cell, Streams(3, 1))
    assert (a.width, a.height) == (4e-4, 6e-4)
    assert a.position.shape == (400, 2)
    assert ((a.position >= 0) & (a.position < (4e-4, 6e-4))).all()
    # Uniform: means within five standard errors.
    error = np.array((4e-4, 6e-4)) / math.sqrt(12 * 400)
    assert (np.abs(a.position.mean(axis=0) - (2e-4, 3e-4)) < 5 * error).all()
    assert np.array_equal(a.position, start_discs(packing, cell, Streams(3, 1)).position)
    for other in (Streams(3, 0), Streams(4, 1)):
        assert not np.array_equal(a.position, start_discs(packing, cell, other).position)


def test_positions_do_not_depend_on_physics():
    """Replicate r starts from the same numbers at every φ, so points compare in pairs."""
    cell = Cell()
    a = start_discs(Packing(discs=50, packing_fraction=1.0), cell, Streams(1, 0))
    b = start_discs(Packing(discs=50, packing_fraction=1.6), cell, Streams(1, 0))
    assert np.array_equal(a.position, b.position)


def test_coincident_positions_are_drawn_again(monkeypatch):
    """A generator that repeats itself at first: no two discs are left in one place.

    In one place means through the edge too: x = 0 is x = L_x.
    """

    class Repeating:
        def __init__(self):
            self.good = np.random.default_rng(0)
            self.first = True

        def random(self, shape):
            values = self.good.random(shape)
            if self.first:
                values[1] = values[0]
                values[2] = (1e-12, 0.25)
                values[3] = (1 - 1e-12, 0.25)
                self.first = False
            return values

    monkeypatch.setattr(Streams, "generator", lambda _self, _purpose: Repeating())
    start = start_discs(Packing(discs=10), Cell(), Streams(0, 0))
    for i in range(10):
        for j in range(i):
            apart = start.position[i] - start.position[j]
            apart -= np.rint(apart / 5e-4) * 5e-4
            assert np.hypot(*apart) > 1e-6 * start.radius.min()


def test_hexagonal_start():
    """Six neighbours at one spacing, the cell L_x x rows √3/2 spacings high."""
    start = start_discs(
        Packing(start="hexagonal", discs=24, columns=6, size_ratio=1.0), Cell(width=6.0),
        Streams(0, 0),
    )  # fmt: skip
    assert start.height == pytest.approx(4 * math.sqrt(3) / 2)
    for i in range(24):
        apart = start.position - start.position[i]
        apart -= np.rint(apart / (start.width, start.height)) * (start.width, start.height)
        distance = np.sort(np.hypot(*apart.T))
        assert distance[1:7] == pytest.approx(np.ones(6))
        assert distance[7] > 1.7


def test_streams_are_independent_by_purpose_replicate_and_seed():
    """[1] and [1, 0] are one entropy to NumPy: replicate 0 must not be a seed of its own."""
    draws = {
        (seed, replicate, purpose): tuple(Streams(seed, replicate).generator(purpose).random(4))
        for seed in (0, 1, 2)
        for replicate in (0, 1, 2)
        for purpose in ("positions", "cut", "link removal", "isolated discs")
    }
    assert len(set(draws.values())) == len(draws)
    again = Streams(1, 2).generator("cut").random(4)
    assert tuple(again) == draws[1, 2, "cut"]
