"""Shells in pictures: outlines that are whole across the edges, and forces between them."""

import math

import numpy as np
import pytest
from matplotlib.figure import Figure
from soft_particles import ring, system

from shear_sim.figures.scene import Scene, view
from shear_sim.figures.shells import Shells, is_shells
from shear_sim.models.interface import BAR, COHESIVE, CONTACT, LINK, SLIDING, Snapshot
from shear_sim.models.soft_particle.bodies import Core
from shear_sim.models.soft_particle.snapshots import take

SIDE, OFFSET, HALF = 10.0, 2.3, 0.1  # of the cell, its upper image, and half a thickness
LATTICE = np.array([[SIDE, 0.0], [OFFSET, SIDE]])
CORNERS = 16


def shells(centres, radius=1.0, contacts=(), scatter=True, **changes):
    """Polygons of unit mass, whose vertices are each in another image of the cell.

    ``contacts`` are (vertex, vertex, separation, normal force, tangential force, kind).
    """
    rng = np.random.default_rng(1)
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    around = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    whole = np.concatenate([np.add(centre, around) for centre in centres])
    n = len(whole)
    images = rng.integers(-1, 2, (n, 2)) if scatter else np.zeros((n, 2))
    i = np.arange(n)
    j = i - i % CORNERS + (i + 1) % CORNERS
    order = rng.permutation(n)  # bars in no order
    rows = [(a, b, *r, f, t, kind) for a, b, r, f, t, kind in contacts]
    more = np.array(rows).reshape(-1, 7).T
    made = Snapshot(
        row=0, width=SIDE, height=SIDE, offset=OFFSET, periodic=True,
        position=whole + images @ LATTICE, velocity=np.zeros((n, 2)), spin=np.zeros(n),
        radius=np.full(n, HALF), fixed=np.zeros(n, bool),
        i=np.concatenate([i[order], more[0]]).astype(np.int32),
        j=np.concatenate([j[order], more[1]]).astype(np.int32),
        separation=np.concatenate([(whole[j] - whole[i])[order], more[2:4].T]),
        normal=np.concatenate([np.full(n, 99.0), more[4]]),
        tangential=np.concatenate([np.full(n, 99.0), more[5]]),
        kind=np.concatenate([np.full(n, BAR), more[6]]).astype(np.int8),
        walls=np.zeros((0, 3)), energy=np.repeat(np.arange(len(centres), dtype=float), CORNERS),
    )  # fmt: skip
    return made._replace(**changes)


def area(polygon):
    x, y = polygon.T
    return 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()


POLYGON = CORNERS / 2 * math.sin(2 * math.pi / CORNERS)  # area, of radius 1
GIRTH = 2 * CORNERS * math.sin(math.pi / CORNERS)


def off_lattice(vectors):
    """How far vectors (n, 2) are from those of the lattice, in cells."""
    steps = np.linalg.solve(LATTICE.T, np.asarray(vectors).T)
    return np.abs(steps - np.rint(steps)).max()


def drawn(s, **look):
    axis = Figure(figsize=(4, 4)).add_axes((0, 0, 1, 1))
    scene = Scene(axis, [s], np.eye(2)[None], **look)
    scene.show(0)
    return scene


def polygons(scene):
    return [np.asarray(path.vertices)[:CORNERS] for path in scene.artists[0].get_paths()]


# --- Outlines ------------------------------------------------------------------------------------


def test_outlines_are_whole_wherever_vertices_are():
    """Regular polygons at a corner, an upper edge and in the middle of the sheared cell."""
    centres = np.array([[0.0, 0.0], [4.0, 9.8], [5.0, 5.0]])
    s = shells(centres)
    found = Shells(s)
    discs = found.as_discs(s)
    assert len(found) == 3
    assert off_lattice(discs.position - centres) < 1e-12
    for outline in found.outlines(s):
        assert np.hypot(*outline.T) == pytest.approx(np.ones(CORNERS))
        assert area(outline) == pytest.approx(POLYGON)  # in order, counter-clockwise
    solid = POLYGON + HALF * GIRTH + math.pi * HALF**2
    assert math.pi * discs.radius**2 == pytest.approx(np.full(3, solid))
    assert discs.energy.tolist() == [0.0, 1.0, 2.0]


def test_every_image_of_a_shell_is_drawn_once_and_whole():
    """A ring about the corner of the cell: at all four corners, one of them not dimmed."""
    s = shells([[0.0, 0.0], [5.0, 5.0]])
    scene = drawn(s)
    found = polygons(scene)
    assert [area(polygon) for polygon in found] == pytest.approx([POLYGON] * len(found))
    centres = np.array([polygon.mean(axis=0) for polygon in found])
    corners = np.array([[0, 0], [SIDE, 0], [OFFSET, SIDE], [OFFSET + SIDE, SIDE],
                        [OFFSET - SIDE, SIDE], [-OFFSET, -SIDE]])  # fmt: skip
    left, bottom, width, height = view([s])
    low, high = np.array([left, bottom]) - 1, np.array([left + width, bottom + height]) + 1
    seen = [c for c in corners if (c > low).all() and (c < high).all()]
    for corner in seen:
        assert np.isclose(centres, corner).all(axis=1).sum() == 1
    assert len(seen) == 4
    faces = scene.artists[0].get_facecolor()
    full = faces[:, :3].min(axis=1) < np.sort(faces[:, :3].min(axis=1))[2]
    assert full.sum() == 2
    assert ((centres[full] > -1e-9) & (centres[full] < SIDE)).all()
    edges = scene.artists[0].get_edgecolor()
    assert edges[~full].min() > edges[full].min()
    assert scene.artists[0].get_linewidth()[0] == pytest.approx(2 * HALF * scene.point)


def test_a_picture_of_shells_has_a_rim_for_the_largest():
    left, bottom, width, height = view([shells([[5.0, 5.0]])])
    radius = math.sqrt((POLYGON + HALF * GIRTH + math.pi * HALF**2) / math.pi)
    assert (left, bottom) == pytest.approx((-1.4 * radius, -1.4 * radius))
    assert (width, height) == pytest.approx((SIDE + 2.8 * radius, SIDE + 2.8 * radius))


def test_shells_that_touch_have_different_colours_and_held_ones_are_grey():
    centres = [[1.1 + 2.2 * k, 5.0] for k in range(4)]
    contacts = [
        (CORNERS * k, CORNERS * (k + 1) + CORNERS // 2, (0.2, 0.0), 1.0, 0.0, CONTACT)
        for k in range(3)
    ]
    held = np.repeat([False, False, False, True], CORNERS)
    held[0] = True  # one vertex does not hold a shell
    s = shells(centres, contacts=contacts, fixed=held)
    assert Shells(s).as_discs(s).fixed.tolist() == [False, False, False, True]
    scene = drawn(s, contacts="none")
    middle = {}
    for polygon, face in zip(polygons(scene), scene.artists[0].get_facecolor(), strict=True):
        x, y = polygon.mean(axis=0)
        if 0 < x < SIDE and 0 < y < SIDE:
            middle[int(x / 2.2)] = tuple(face)
    assert len(middle) == 4
    assert middle[0] != middle[1] != middle[2]
    assert np.ptp(middle[3][:3]) == pytest.approx(0.0, abs=1e-12)


def test_what_is_linked_without_bars_is_no_shell():
    """Discs in threes have two links each, as vertices have two bars."""
    s = shells([[5.0, 5.0]])
    assert is_shells(s)
    assert not is_shells(s._replace(kind=np.full(CORNERS, LINK, np.int8)))
    chain = s._replace(**{n: getattr(s, n)[1:] for n in ("i", "j", "separation", "kind")})
    assert not is_shells(chain)
    with pytest.raises(ValueError, match="one bar before and one after"):
        Shells(chain)


# --- Motion and forces ---------------------------------------------------------------------------


def test_shells_move_and_turn_as_their_vertices_do():
    """v = v₀ + ω × r of each, also across edges."""
    s = shells([[0.0, 0.0], [5.0, 5.0]])
    around = np.concatenate(Shells(s).outlines(s))
    speed, turn = np.array([[0.3, -0.2], [0.1, 0.5]]), np.array([2.0, -0.7])
    per_vertex = np.repeat(turn, CORNERS)[:, None] * np.column_stack([-around[:, 1], around[:, 0]])
    moved = s._replace(velocity=np.repeat(speed, CORNERS, axis=0) + per_vertex)
    discs = Shells(moved).as_discs(moved)
    assert discs.velocity == pytest.approx(speed)
    assert discs.spin == pytest.approx(turn)


def test_forces_between_shells_are_sums_for_each_image():
    """Two touch across the right edge by two vertices, and across the upper one by another.

    One of the contacts is told from the other shell. Another is of a shell with itself.
    """
    right = [(0, CORNERS + 8, (0.2, 0.0), 1.0, 0.5, CONTACT),
             (CORNERS + 9, 1, (-0.2, 0.0), 2.0, 0.0, SLIDING)]  # fmt: skip
    up = [(4, CORNERS + 12, (0.0, 0.2), 4.0, 0.0, COHESIVE)]
    own = [(2, 7, (0.2, 0.0), 8.0, 0.0, CONTACT)]
    first, right_of = np.array([8.9, 9.0]), np.array([2.2, 0.0])
    second = first + right_of - LATTICE[0]
    s = shells([first, second], contacts=[*right, *own])
    discs = Shells(s).as_discs(s)
    assert (discs.i.tolist(), discs.j.tolist()) == ([0], [1])
    assert discs.separation == pytest.approx(np.array([[2.2, 0.0]]))
    assert (discs.normal, discs.tangential) == (pytest.approx([3.0]), pytest.approx([0.5]))
    # The second one moved so that its image above the first touches it, too.
    tall = shells([first, first + right_of], contacts=[*right, *up], scatter=False)
    tall = tall._replace(height=2.2, offset=-2.2)
    discs = Shells(tall).as_discs(tall)
    assert (discs.i.tolist(), discs.j.tolist()) == ([0, 0], [1, 1])
    order = np.argsort(discs.separation[:, 1])
    assert discs.separation[order] == pytest.approx(np.array([[2.2, 0.0], [0.0, 2.2]]))
    assert discs.normal[order] == pytest.approx([3.0, 4.0])


def test_a_shell_meets_its_own_image_and_a_wall():
    wide = [(0, CORNERS // 2, (0.2, 0.0), 3.0, 0.0, CONTACT)]
    s = shells([[5.0, 5.0]], contacts=wide, scatter=False)._replace(width=2.2, offset=0.0)
    discs = Shells(s).as_discs(s)
    assert discs.separation == pytest.approx(np.array([[2.2, 0.0]]))
    floor = [(11, -4, (0.0, -0.3), 1.0, 0.0, CONTACT), (13, -4, (0.0, -0.3), 3.0, 0.0, CONTACT)]
    s = shells([[5.0, 5.0]], contacts=floor, scatter=False)._replace(periodic=False)
    discs = Shells(s).as_discs(s)
    angle = 2 * np.pi * np.array([11, 13]) / CORNERS
    at = [0.25 * math.cos(angle[0]) + 0.75 * math.cos(angle[1]), math.sin(angle[0]) - 0.3]
    assert discs.separation == pytest.approx(np.array([at]))
    assert discs.j.tolist() == [-4]
    force = 4.0 * np.array([0.0, -1.0])
    normal = np.array(at) / math.hypot(*at)
    assert discs.normal == pytest.approx([force @ normal])
    assert discs.tangential == pytest.approx([force @ [-normal[1], normal[0]]])


def test_stress_of_shells_at_rest_is_that_of_their_contacts():
    """Σ f r / area over pairs of shells = the stress from all vertices, bars and cores.

    Two rows of rings with friction in a sheared cell, as vertices come to rest.
    """
    side, height, strain = 4.12, 4.12 * math.sqrt(3) / 2, 0.12
    bodies = [
        ring(12, thickness=0.2, core=Core("log", 0.05), y=row * height / 2 + 0.02 * column,
             x=2.06 * (column + 0.5 * row) + row * strain * height / 2 + 0.1,
             bend_damping=0.2, stretch_damping=0.2)
        for row in range(2) for column in range(2)
    ]  # fmt: skip
    s = system(*bodies, stiffness=0.3, friction=0.5, drag=0.3, cell=(side, height))
    s.cell.strain[0] = strain
    s.advance(6000)
    assert s.kinetic() < 1e-12 * s.stored()[0]
    kept = take(s, 0, (0.0, 0.0, side, height))
    discs = Shells(kept).as_discs(kept)
    normal = discs.separation / np.hypot(*discs.separation.T)[:, None]
    along = np.column_stack([-normal[:, 1], normal[:, 0]])
    force = discs.normal[:, None] * normal + discs.tangential[:, None] * along
    found = np.einsum("ca,cb->ab", force, discs.separation) / (side * height)
    assert found.ravel() == pytest.approx(s.stress(), rel=1e-8)
    assert abs(found[0, 1]) > 0.01 * found[1, 1] > 0.0


def test_lines_of_forces_run_across_the_edges():
    """One contact over the right edge: a line at each side, both from what is in the cell."""
    contact = [(0, CORNERS + 8, (0.2, 0.0), 1.0, 0.0, CONTACT)]
    s = shells([[8.0, 5.0], [10.2, 5.0]], contacts=contact)
    forces = drawn(s).artists[3]
    lines = {round(float(np.asarray(p.vertices)[0, 0]), 6): c
             for p, c in zip(forces.get_paths(), forces.get_colors(), strict=True)}  # fmt: skip
    assert sorted(lines) == [-2.0, 8.0]
    assert tuple(lines[-2.0]) == tuple(lines[8.0])


@pytest.mark.parametrize(("kind", "holds"), [(CONTACT, True), (SLIDING, False)])
def test_interfaces_of_shells_are_red_where_they_hold_and_green_where_they_slide(kind, holds):
    contact = [(0, CORNERS + 8, (0.2, 0.0), 1.0, 0.0, kind)]
    s = shells([[3.0, 5.0], [5.2, 5.0]], contacts=contact)
    shown = drawn(s, contacts="state").artists[2]
    (segment,) = (np.asarray(path.vertices) for path in shown.get_paths())
    side = GIRTH / CORNERS
    assert np.sort(segment, axis=0) == pytest.approx(
        np.array([[4.1, 5.0 - side / 2], [4.1, 5.0 + side / 2]])
    )
    red, green, _ = shown.get_colors()[0][:3]
    assert (red > green) == holds


def test_a_picture_without_side_walls_shows_what_leaves_the_cell():
    first = shells([[5.0, 5.0]], scatter=False)._replace(periodic=False)
    later = shells([[10.5, 5.0]], scatter=False)._replace(periodic=False)
    for snapshots in ([first, later], [later, first]):
        left, _, width, _ = view(snapshots)
        assert left < 0
        assert 11.5 + HALF < left + width < 12


def test_forces_of_walls_on_a_single_shell_reach_into_it_where_they_act():
    """Two contacts with the floor, one three times as strong: lines up from it, as long."""
    floor = [(11, -1, (0.0, -0.3), 1.0, 0.0, CONTACT), (13, -1, (0.0, -0.3), 3.0, 0.0, CONTACT)]
    s = shells([[5.0, 5.0]], contacts=floor, scatter=False)
    s = s._replace(periodic=False, walls=np.array([[0.0, 1.0, 0.0]]))
    left, _, width, _ = view([s])
    assert left < 0 < SIDE < left + width  # no shell is cut by the edge of the picture
    lines = [np.asarray(path.vertices) for path in drawn(s).artists[3].get_paths()]
    angle = 2 * np.pi * np.array([11, 13]) / CORNERS
    for line, a in zip(lines, angle, strict=True):
        assert line[1] == pytest.approx([5 + math.cos(a), 4.7 + math.sin(a)])
        assert line[0, 0] == pytest.approx(line[1, 0])
    up = [line[0, 1] - line[1, 1] for line in lines]
    assert up[1] == pytest.approx(3 * up[0])
    assert up[0] > 0
    # A third of the force in another snapshot is a third of the length.
    both = [s, s._replace(normal=s.normal / 3)]
    scene = Scene(Figure().add_axes((0, 0, 1, 1)), both, np.tile(np.eye(2), (2, 1, 1)))
    scene.show(1)
    later = [np.asarray(path.vertices)[:, 1] for path in scene.artists[3].get_paths()]
    assert [line[0] - line[1] for line in later] == pytest.approx(np.array(up) / 3)
    said = scene.legend(scene.axis)
    assert [text.get_text() for text in said.get_texts()] == ["push; length as force"]
    unloaded = drawn(s._replace(normal=0.0 * s.normal))
    assert unloaded.legend(unloaded.axis) is None
