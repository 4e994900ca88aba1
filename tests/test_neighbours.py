"""Neighbour pairs in a sheared cell against brute force over all images."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from shear_sim.cell import turns_of, wrap_count
from shear_sim.neighbours import find_pairs


def brute_force(x, y, radius, skin, width, height, offset):
    """All (i, j, n_x, n_y) with i < j closer than r_i + r_j + skin, images up to ±3."""
    found = set()
    n = len(x)
    for i in range(n):
        for j in range(i + 1, n):
            for nx in range(-3, 4):
                for ny in range(-3, 4):
                    dx = x[j] - x[i] + nx * width + ny * offset
                    dy = y[j] - y[i] + ny * height
                    if dx * dx + dy * dy < (radius[i] + radius[j] + skin) ** 2:
                        found.add((i, j, nx, ny))
    return found


def ours(*arguments):
    start, i, j, nx, ny = find_pairs(*arguments)
    assert len(start) == len(arguments[0]) + 1
    assert (np.diff(start) >= 0).all()
    assert start[0] == 0
    assert start[-1] == len(i)
    for a in range(len(arguments[0])):
        assert (i[start[a] : start[a + 1]] == a).all()
    assert (i < j).all()
    pairs = list(zip(i.tolist(), j.tolist(), nx.tolist(), ny.tolist(), strict=True))
    assert len(pairs) == len(set(pairs))  # each once
    return set(pairs)


@settings(max_examples=300, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 24),
    aspect=st.floats(0.3, 3.0),
    shift=st.floats(-0.5, 0.5),
    ratio=st.floats(1.0, 3.0),
    size=st.floats(0.02, 1.0),
    skin=st.floats(0.0, 0.3),
)
@example(seed=1, n=2, aspect=1.0, shift=0.5, ratio=1.0, size=1.0, skin=0.0)
@example(seed=2, n=5, aspect=1.0, shift=-0.5, ratio=3.0, size=1.0, skin=0.3)
@example(seed=3, n=24, aspect=3.0, shift=0.25, ratio=3.0, size=0.3, skin=0.1)
def test_pairs_are_those_of_brute_force(seed, n, aspect, shift, ratio, size, skin):
    """Any sheared rectangle, down to the smallest cell allowed: four large radii, few discs.

    A cell list that looks one row too few, or at one image of a pair only, misses some.
    """
    rng = np.random.default_rng(seed)
    width, height = 1.0, aspect
    largest = size * min(width, height) / 4 / (1 + skin)
    radius = largest * np.where(rng.random(n) < 0.5, 1.0, 1.0 / ratio)
    radius[0] = largest
    x, y = rng.random(n) * width, rng.random(n) * height
    arguments = (x, y, radius, skin * largest, width, height, shift * width)
    assert ours(*arguments) == brute_force(*arguments)


@pytest.mark.parametrize("edge", [0.0, np.nextafter(1.0, 0), 1.0])
def test_discs_on_the_edge_of_the_cell(edge):
    """Bringing a disc back can leave it on the upper edge itself, by rounding."""
    x = np.array([edge, 0.3, 0.7, edge])
    y = np.array([0.2, edge, edge, 0.6])
    arguments = (x, y, np.full(4, 0.2), 0.05, 1.0, 1.0, 0.3)
    assert ours(*arguments) == brute_force(*arguments)


@settings(max_examples=200, deadline=None)
@given(data=st.data(), seed=st.integers(0, 2**32 - 1), n=st.integers(1, 200))
def test_pairs_of_some_discs(data, seed, n):
    """Those among all pairs of which one disc at least is asked for, in the same order."""
    rng = np.random.default_rng(seed)
    radius = rng.uniform(0.02, 0.08, n)
    order = np.argsort(rng.random(n))
    arguments = (*rng.random((2, n)), radius[order], 0.02, 1.0, 1.0, rng.uniform(-0.5, 0.5))
    begin = data.draw(st.integers(0, n))
    end = data.draw(st.integers(begin, n))
    _, *everything = find_pairs(*arguments)
    asked = ((np.array(everything[:2]) >= begin) & (np.array(everything[:2]) < end)).any(axis=0)
    start, *some = find_pairs(*arguments, begin, end)
    for whole, chosen in zip(everything, some, strict=True):
        assert np.array_equal(whole[asked], chosen)
    assert np.array_equal(start, np.searchsorted(some[0], np.arange(n + 1)))


def test_dense_cells_grow_the_list():
    """More pairs than the list was made for: all discs in reach of each other."""
    rng = np.random.default_rng(0)
    n = 60
    x, y = 0.5 + 0.05 * rng.random((2, n))
    arguments = (x, y, np.full(n, 0.05), 0.0, 1.0, 1.0, 0.1)
    assert len(ours(*arguments)) == n * (n - 1) // 2


@given(
    x=st.floats(-50, 50), y=st.floats(-50, 50), offset=st.floats(-0.5, 0.5),
    height=st.floats(0.5, 2.0),
)  # fmt: skip
@settings(max_examples=200, deadline=None)
def test_wrapping_brings_a_disc_into_the_cell(x, y, offset, height):
    wx, wy = np.zeros(1, np.int32), np.zeros(1, np.int32)
    wrap_count(np.array([x]), np.array([y]), 1.0, height, offset, wx, wy)
    assert -1e-12 <= y - wy[0] * height <= height
    assert -1e-12 <= x - wx[0] - wy[0] * offset <= 1 + 1e-12


@given(strain=st.floats(-30, 30), width=st.floats(0.3, 3.0))
@settings(max_examples=200, deadline=None)
def test_regridding_keeps_the_offset_within_half_a_width(strain, width):
    """|γ L_y − turns L_x| ≤ L_x/2: no image drifts away, however large the strain."""
    offset = strain * 1.0 - turns_of(strain, width, 1.0) * width
    assert abs(offset) <= 0.5 * width * (1 + 1e-9)
