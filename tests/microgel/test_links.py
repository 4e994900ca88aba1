"""Which touching pairs are linked, how the network is cut, and what removal may not do."""

import itertools

import numpy as np
import pytest
from scenes import packing_point, prepared

from shear_sim.models.interface import SimulationError
from shear_sim.models.microgel import links
from shear_sim.models.microgel.links import (
    Network,
    heights,
    make_links,
    particles,
    touching_pairs,
)
from shear_sim.models.microgel.parameters import Links
from shear_sim.streams import Streams

SEEDS = range(8)


@pytest.fixture(scope="module", params=[40, 150])
def network(request):
    d = prepared(packing_point(discs=request.param)).discs
    position = np.column_stack([d.x % 500e-6, d.y % 500e-6])
    return touching_pairs(position, d.radius, (500e-6, 500e-6))


def section(cut="cells", **more):
    if cut in ("cells", "lines"):
        more = {"avoid_height_spanning": False, "cuts": 6} | more
    if cut != "none":
        more = {"join_isolated": False} | more
    return Links(cut=cut, **more)


def components(n, pairs):
    """Labels of connected components, by scipy: independent of our union-find."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = np.asarray(pairs).reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def same_partition(a, b):
    return (
        len(set(zip(a.tolist(), b.tolist(), strict=True)))
        == len(set(a.tolist()))
        == len(set(b.tolist()))
    )


def test_touching_pairs_are_all_contacts(network):
    branch = network.branch
    d = np.hypot(*branch.T)
    reach = network.radius[network.pairs].sum(1)
    assert (d < reach).all()
    assert len(network.pairs) > 2 * len(network.radius)


@pytest.mark.parametrize("seed", SEEDS)
def test_cells_are_voronoi_cells_of_the_periodic_cell(network, seed):
    """A pair is linked if, and only if, the nearest point (any of nine images) is the same."""
    linked, _ = make_links(network, section(), Streams(seed, 0))
    points = Streams(seed, 0).generator("cut").random((6, 2)) * network.cell
    images = np.array(list(itertools.product((-1, 0, 1), repeat=2))) * network.cell
    apart = network.position[:, None, None] - points[:, None] - images
    nearest = np.hypot(*np.moveaxis(apart, -1, 0)).min(axis=2).argmin(axis=1)
    i, j = network.pairs.T
    assert np.array_equal(linked, nearest[i] == nearest[j])
    assert 0 < linked.sum() < len(linked)


@pytest.mark.parametrize("seed", SEEDS)
def test_fuzziness_acts_within_its_reach_only(network, seed):
    """Noise in [0, f r_max) on each distance: a disc far from the edge keeps its cell."""
    fuzz = 0.8
    points = Streams(seed, 0).generator("cut").random((6, 2)) * network.cell
    apart = network.position[:, None] - points
    apart -= np.rint(apart / network.cell) * network.cell
    distance = np.sort(np.hypot(apart[..., 0], apart[..., 1]), axis=1)
    sure = distance[:, 1] - distance[:, 0] >= fuzz * network.radius.max()
    sharp, _ = make_links(network, section(), Streams(seed, 0))
    fuzzy, _ = make_links(network, section(edge_fuzziness=fuzz), Streams(seed, 0))
    both = sure[network.pairs].all(axis=1)
    assert np.array_equal(sharp[both], fuzzy[both])
    assert not both.all()


@pytest.mark.parametrize("seed", SEEDS)
def test_fuzziness_is_in_units_of_the_largest_radius(network, seed):
    """One disc of twice the size, the others as they are: as twice the fuzziness."""
    one_large = network.radius.copy()
    one_large[network.radius.argmax()] *= 2
    one_small = network.radius.copy()
    one_small[network.radius.argmin()] *= 0.1

    def fuzzy(fuzz, radius):
        changed = network._replace(radius=radius)
        return make_links(changed, section(edge_fuzziness=fuzz), Streams(seed, 0))[0]

    single, double = fuzzy(2.0, network.radius), fuzzy(4.0, network.radius)
    assert (single != double).any()
    assert np.array_equal(fuzzy(2.0, one_large), double)
    assert np.array_equal(fuzzy(2.0, one_small), single)


def test_fuzziness_does_something(network):
    changed = [
        (
            make_links(network, section(), Streams(seed, 0))[0]
            != make_links(network, section(edge_fuzziness=0.8), Streams(seed, 0))[0]
        ).any()
        for seed in SEEDS
    ]
    assert any(changed)


def grid(n=40):
    """A square lattice with bonds to the right and up, none across the edge."""
    position = np.array(list(itertools.product(range(n), repeat=2)), float) + 0.5
    number = np.arange(n * n).reshape(n, n)
    pairs = np.concatenate(
        [
            np.column_stack([number[:-1].ravel(), number[1:].ravel()]),
            np.column_stack([number[:, :-1].ravel(), number[:, 1:].ravel()]),
        ]
    )
    return Network(position, np.full(n * n, 0.5), pairs, np.zeros_like(pairs), (float(n), float(n)))


def cut_angles(avoid):
    """Angle to the horizontal [degrees] of single random lines, from the bonds that they cut."""
    network, angles = grid(), []
    i, j = network.pairs.T
    middle = 0.5 * (network.position[i] + network.position[j])
    for seed in range(40):
        linked, _ = make_links(
            network, section("lines", cuts=1, avoid_angle=avoid), Streams(seed, 0)
        )
        where = middle[~linked]
        if len(where) < 30:
            continue  # a corner only: too short to measure
        where = where - where.mean(axis=0)
        direction = np.linalg.svd(where, full_matrices=False)[2][0]
        # Every cut bond lies within half a bond of one straight line.
        assert np.abs(where @ (-direction[1], direction[0])).max() < 1.0
        angles.append(np.degrees(np.arctan2(abs(direction[1]), abs(direction[0]))))
    return np.array(angles)


@pytest.mark.parametrize("avoid", [15.0, 60.0])
def test_lines_avoid_the_horizontal(avoid):
    angles = cut_angles(avoid)
    assert len(angles) > 20
    assert angles.min() > avoid - 2.0
    assert angles.max() > 80.0


def test_lines_of_any_direction():
    angles = cut_angles(0.0)
    assert angles.min() < 15.0
    assert angles.max() > 75.0


def test_pairs_across_the_edge_are_cut_from_both_ends():
    """A link through the right edge is tested at both of its ends: the line is not periodic."""
    n = 40
    position = np.array([(0.5, y + 0.5) for y in range(n)] + [(n - 0.5, y + 0.5) for y in range(n)])
    pairs = np.column_stack([np.arange(n), np.arange(n) + n])
    image = np.tile((-1, 0), (n, 1))
    network = Network(position, np.full(2 * n, 0.5), pairs, image, (float(n), float(n)))
    cuts = [
        (~make_links(network, section("lines", cuts=1), Streams(seed, 0))[0]).sum()
        for seed in range(200)
    ]
    # A line that leaves through left and right edges cuts one bond at either.
    assert max(cuts) >= 2
    assert min(cuts) == 0


def test_bulk_is_uncut_and_none_is_loose(network):
    assert make_links(network, section("bulk"), Streams(0, 0))[0].all()
    assert not make_links(network, section("none"), Streams(0, 0))[0].any()


CUTS = {"bulk": {}, "cells": {"cuts": 20}, "lines": {"cuts": 8, "avoid_angle": 0.0}}


@pytest.mark.parametrize("cut", ["bulk", "cells"])
@pytest.mark.parametrize("join", [False, True])
def test_cut_top_bottom_leaves_no_link_through_the_top(network, cut, join):
    """Nor does a disc that is left alone get one back through the edge."""
    for seed in SEEDS:
        linked, _ = make_links(
            network,
            section(cut, cut_top_bottom=True, join_isolated=join, **CUTS[cut]),
            Streams(seed, 0),
        )
        assert (network.image[linked, 1] == 0).all()
        assert (network.image[linked, 0] != 0).any()


@pytest.mark.parametrize("cut", ["cells", "lines"])
def test_no_particle_spans_the_height(network, cut):
    """Not higher than 0.9 L_y, seen in the unwrapped particle, whatever is joined afterwards."""
    for seed in SEEDS:
        linked, _ = make_links(
            network,
            section(cut, avoid_height_spanning=True, join_isolated=True, **CUTS[cut]),
            Streams(seed, 0),
        )
        assert heights(network, linked).max() <= 0.9 * network.cell[1]


def test_impossible_cut_is_a_clear_error(network, monkeypatch):
    """One line through a periodic cell leaves it connected around: say so, do not loop."""
    monkeypatch.setattr(links, "CUT_ATTEMPTS", 20)
    with pytest.raises(SimulationError, match=r"model\.links\.cuts"):
        make_links(network, section("lines", cuts=1, avoid_height_spanning=True), Streams(0, 0))


def test_height_of_particles_by_hand():
    """Unwrapped through the edge; a ring around the cell is infinitely high, a belt is not."""
    cell = (10.0, 10.0)
    y = np.array([8.0, 9.5, 1.0, 5.0])
    position = np.column_stack([np.full(4, 5.0), y])
    pairs, image = (
        np.array([(0, 1), (1, 2), (2, 3), (0, 3)]),
        np.array([(0, 0), (0, 1), (0, 0), (0, 0)]),
    )
    chain = Network(position, np.full(4, 1.0), pairs, image, cell)
    high = heights(chain, np.array([True, True, False, False]))
    assert sorted(high) == pytest.approx([2.0, 5.0])  # 8 to 11 with radii; the lone disc
    assert np.isinf(heights(chain, np.ones(4, bool))).all()
    belt = Network(
        position[:2], np.full(2, 1.0), np.array([(0, 1), (0, 1)]), np.array([(0, 0), (1, 0)]), cell
    )
    assert heights(belt, np.ones(2, bool)) == pytest.approx([3.5])


def test_particles_are_connected_components(network):
    for seed in SEEDS:
        linked, report = make_links(network, section(), Streams(seed, 0))
        ours = particles(network, linked)
        assert same_partition(ours, components(len(network.radius), network.pairs[linked]))
        assert report["particles"] == len(set(ours.tolist()))
        assert report["links"] == linked.sum()


@pytest.mark.parametrize("fraction", [0.1, 0.4, 1.0])
@pytest.mark.parametrize("cut", ["bulk", "cells"])
def test_removal_never_splits_a_particle(network, cut, fraction):
    """The partition into particles is the same before and after, and the report is honest."""
    n = len(network.radius)
    for seed in SEEDS:
        before, _ = make_links(network, section(cut), Streams(seed, 0))
        after, report = make_links(
            network, section(cut, remove_fraction=fraction), Streams(seed, 0)
        )
        assert not (after & ~before).any()
        assert same_partition(
            components(n, network.pairs[before]), components(n, network.pairs[after])
        )
        removed = before.sum() - after.sum()
        assert report["removed_links"] == removed
        assert report["removed_fraction"] == pytest.approx(removed / before.sum())
        particles_ = len(set(components(n, network.pairs[before]).tolist()))
        removable = before.sum() - (n - particles_)
        assert report["non_essential_links"] == removable
        assert removed == round(fraction * removable)
        assert report["removed_of_non_essential"] == pytest.approx(removed / removable)


def test_removal_is_reverse_delete(network):
    """One pass over a random order, each link removed if its ends stay joined: brute force."""
    n = len(network.radius)
    before, _ = make_links(network, section(), Streams(4, 0))
    after, _ = make_links(network, section(remove_fraction=0.3), Streams(4, 0))
    order = Streams(4, 0).generator("link removal").permutation(np.flatnonzero(before))
    pieces = len(set(components(n, network.pairs[before]).tolist()))
    kept, target = before.copy(), round(0.3 * (before.sum() - (n - pieces)))
    for q in order:
        if before.sum() - kept.sum() == target:
            break
        kept[q] = False
        label = components(n, network.pairs[kept])
        i, j = network.pairs[q]
        kept[q] = label[i] != label[j]
    assert np.array_equal(kept, after)


def test_more_removal_removes_more_of_the_same(network):
    """Points of a study with growing fractions are nested: they can be compared in pairs."""
    some, _ = make_links(network, section(remove_fraction=0.1), Streams(1, 0))
    more, _ = make_links(network, section(remove_fraction=0.3), Streams(1, 0))
    assert (some | ~more).all()
    assert more.sum() < some.sum()


def test_isolated_discs_are_joined(network):
    """With many cells some discs are alone: each gets one link to a disc that it touches."""
    joined_any = 0
    for seed in SEEDS:
        loose, _ = make_links(network, section(cuts=60), Streams(seed, 0))
        joined, report = make_links(network, section(cuts=60, join_isolated=True), Streams(seed, 0))
        degree = np.bincount(network.pairs[loose].ravel(), minlength=len(network.radius))
        assert (loose <= joined).all()
        now = np.bincount(network.pairs[joined].ravel(), minlength=len(network.radius))
        assert now.min() > 0
        assert report["joined_isolated"] == joined.sum() - loose.sum() <= (degree == 0).sum()
        # Only links of discs that were alone are new.
        new = network.pairs[joined & ~loose]
        assert (degree[new] == 0).any(axis=1).all()
        joined_any += len(new)
    assert joined_any > 0


def test_links_follow_their_streams(network):
    """The same seed and replicate: the same links. Another replicate: others."""
    what = section(remove_fraction=0.1, edge_fuzziness=0.5, join_isolated=True)
    first, _ = make_links(network, what, Streams(9, 0))
    again, _ = make_links(network, what, Streams(9, 0))
    other, _ = make_links(network, what, Streams(9, 1))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_open_packings_have_no_links_through_the_edge():
    """Open edges: no images, and discs may be anywhere outside the cell."""
    position = np.array([(0.05, 0.5), (0.95, 0.5), (-3.0, -7.0), (-3.1, -7.0)])
    radius = np.full(4, 0.1)
    assert touching_pairs(position[:2], radius[:2], (1.0, 1.0)).image.tolist() == [[-1, 0]]
    found = touching_pairs(position, radius, (1.0, 1.0), periodic=False)
    assert found.pairs.tolist() == [[2, 3]]
    assert found.image.tolist() == [[0, 0]]
