"""Cells of a tissue: the tessellation, and the rings that fill them."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from shear_sim.models.soft_particle.packs import touching_discs
from shear_sim.models.soft_particle.tissue import (
    FLOOR,
    LEFT,
    LID,
    RIGHT,
    Cell,
    outline,
    tessellation,
)


@pytest.fixture(scope="module")
def discs():
    return touching_discs(40, 0.15, np.random.default_rng(3))


def cells(box, inset=0.0):
    return tessellation(box.x, box.y, box.radius, box.width, box.height, inset)


def area(points):
    x, y = points.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def lengths(points):
    return np.hypot(*(np.roll(points, -1, axis=0) - points).T)


def test_every_point_is_in_the_cell_of_the_least_power_distance(discs):
    """Discs of other sizes than they touch at, so that it is not the tessellation of centres."""
    box = discs._replace(radius=discs.radius * np.random.default_rng(1).uniform(0.6, 1.1, 40))
    made = cells(box)
    assert sum(area(cell.corners) for cell in made) == pytest.approx(box.width * box.height)
    points = np.random.default_rng(2).random((2000, 2)) * [box.width, box.height]
    power = ((points[:, None] - np.column_stack([box.x, box.y])) ** 2).sum(axis=2) - box.radius**2
    for point, owner in zip(points, power.argmin(axis=1), strict=True):
        corners = made[owner].corners
        ahead = np.roll(corners, -1, axis=0) - corners
        away = point - corners
        assert (ahead[:, 0] * away[:, 1] - ahead[:, 1] * away[:, 0]).min() > -1e-12


def test_sides_are_those_of_the_lifted_convex_hull(discs):
    """The lower hull of (x, y, x² + y² − r²), here with images in the walls."""
    x, y, r = discs.x, discs.y, discs.radius
    images = [(x, y), (-x, y), (2 * discs.width - x, y), (x, -y), (x, 2 * discs.height - y)]
    points = np.concatenate([np.column_stack(each) for each in images])
    height = (points**2).sum(axis=1) - np.tile(r**2, 5)
    hull = ConvexHull(np.column_stack([points, height]))
    lower = hull.simplices[hull.equations[:, 2] < 0]
    pairs = {(int(a), int(b)) for three in lower for a in three for b in three if a != b}
    found = {(i, int(j)) for i, cell in enumerate(cells(discs)) for j in cell.facing if j >= 0}
    assert found == {(i, j) for i, j in pairs if i < 40 and j < 40}
    assert found == {(j, i) for i, j in found}


def test_walls_bound_the_outer_cells(discs):
    facing = np.concatenate([cell.facing for cell in cells(discs)])
    for wall in (LEFT, RIGHT, FLOOR, LID):
        assert 4 <= (facing == wall).sum() <= 9


def test_moved_in_sides_face_each_other_at_the_thickness_of_two_half_shells(discs):
    made = cells(discs, 0.1)
    for i, cell in enumerate(made):
        for k, j in enumerate(cell.facing):
            if j < 0 or i not in made[j].facing:
                continue
            start, end = cell.corners[k], np.roll(cell.corners, -1, axis=0)[k]
            along = (end - start) / np.hypot(*(end - start))
            other = int(np.flatnonzero(made[j].facing == i)[0])
            away = made[j].corners[[other, (other + 1) % len(made[j].corners)]] - start
            across = away @ [along[1], -along[0]]
            assert across == pytest.approx([0.2, 0.2], abs=1e-12)


def test_no_room_for_a_shell():
    with pytest.raises(ValueError, match="nothing is left of cell 0"):
        tessellation(np.array([0.2, 1.0]), np.ones(2), np.array([0.1, 1.0]), 2.0, 2.0, 0.5)


def test_vertices_lie_on_the_sides(discs):
    for cell in cells(discs, 0.05):
        points = outline(cell, 0.3)
        length = lengths(points)
        assert 0.13 < length.min() < length.max() < 0.47
        assert area(points) == pytest.approx(area(cell.corners), rel=0.01)
        assert area(points) <= area(cell.corners) * (1 + 1e-12)


def test_a_short_side_becomes_a_corner():
    """Of a rectangle whose corner is cut off by 0.1: the longer side bends, not the other."""
    corners = np.array([(0, 0), (2, 0), (2, 1.5), (1.9, 1.6), (0, 1.6)])
    points = outline(Cell(corners, np.arange(5)), 0.5)
    assert (points == [2.0, 1.5]).all(axis=1).any()
    assert not (points == [1.9, 1.6]).all(axis=1).any()
    assert np.isclose(points[:, 1], 1.6).sum() == 4  # 0, 0.475, 0.95, 1.425 of 1.9
    assert lengths(points).min() > 0.25


def test_a_cell_that_is_too_small():
    corners = np.array([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)])
    with pytest.raises(ValueError, match="fewer than 3 sides"):
        outline(Cell(corners, np.arange(4)), 0.5)
