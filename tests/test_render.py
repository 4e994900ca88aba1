"""Pictures and films: geometry, colours, what commands write and refuse."""

import errno
import math
from types import SimpleNamespace

import gsd.hoomd
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from typer.testing import CliRunner

from shear_sim import cli, models, render
from shear_sim.cli import app
from shear_sim.figures.geometry import (
    displacement,
    in_rectangle,
    interfaces,
    outlines,
    particle_pressure,
    particle_tints,
)
from shear_sim.figures.scene import Scene, view
from shear_sim.models.interface import CONTACT, LINK, SLIDING, Snapshot
from shear_sim.neighbours import find_pairs
from shear_sim.results import ResultsError
from shear_sim.runner import run_job
from shear_sim.snapshots import read_snapshots, write_snapshots
from shear_sim.study import load_study

STUDY = """
packing: {discs: 24, packing_fraction: 0.8}
model: {kind: hard_disc}
shear: {kind: steady, strain: 0.2}
record: {snapshots: [0, 0.05, 0.1, 0.15, 0.2]}
scenes: {kept: {}, none: {record.snapshots: null}}
seed: 1
"""

BOX = """
packing: {vertices: 24, radius: 1e-3, particles: 4}
model: {kind: soft_particle, thickness: 0.2}
shear: {kind: compaction, strain: 0.05, relative_rate: 0.05}
record: {rows: 10, snapshots: 1}
seed: 1
"""


BEAM = """
packing: {vertices: 8}
model: {kind: soft_particle, damping: 0, drag: 0}
shear: {kind: bending, force: 1e-3}
record: {snapshots: [1]}
seed: 1
"""


def snapshot(position, radius, pairs=(), separation=None, side=10.0, offset=0.0, kind=CONTACT):
    """Discs placed by hand, in contacts of unit force."""
    position = np.asarray(position, float)
    n, pairs = len(position), np.asarray(pairs, np.int32).reshape(-1, 2)
    radius = np.broadcast_to(radius, n).astype(float)
    i, j = pairs.T
    separation = position[j] - position[i] if separation is None else separation
    return Snapshot(
        row=0, width=side, height=side, offset=offset, periodic=True, position=position,
        velocity=np.zeros((n, 2)), spin=np.zeros(n), radius=radius,
        fixed=np.zeros(n, bool), i=i, j=j, separation=separation, normal=np.ones(len(i)),
        tangential=np.zeros(len(i)), kind=np.full(len(i), kind, np.int8), walls=np.zeros((0, 3)),
    )  # fmt: skip


def many(count, seed=1):
    """A random dense packing in a sheared cell, with all of its contacts."""
    rng = np.random.default_rng(seed)
    side = math.sqrt(count)
    x, y = rng.random((2, count)) * side
    radius = np.where(np.arange(count) % 2, 0.7, 0.5)
    offset = 0.3 * side
    i, j, nx, ny = find_pairs(x, y, radius, 0.0, side, side, offset)[1:]
    r = np.column_stack([x[j] - x[i] + nx * side + ny * offset, y[j] - y[i] + ny * side])
    pairs = np.column_stack([i, j])
    return snapshot(np.column_stack([x, y]), radius, pairs, r, side, offset)


def area(polygon):
    x, y = polygon.T
    return 0.5 * abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())


def scene(snapshots, inches=4.0, **look):
    axis = Figure(figsize=(inches, inches)).add_axes((0, 0, 1, 1))
    return Scene(axis, snapshots, np.tile(np.eye(2), (len(snapshots), 1, 1)), **look)


# --- Geometry ------------------------------------------------------------------------------------


def test_overlapping_discs_fill_the_union_of_their_circles():
    """Two circles of radii 1 and 0.7, 1.2 apart: the areas of both outlines are the union's."""
    ri, rj, d = 1.0, 0.7, 1.2
    s = snapshot([[3, 3], [3 + d, 3]], [ri, rj], [(0, 1)])
    a = (d**2 + ri**2 - rj**2) / (2 * d)
    segments = [
        r * r * math.acos(c / r) - c * math.sqrt(r * r - c * c) for r, c in ((ri, a), (rj, d - a))
    ]
    union = math.pi * (ri**2 + rj**2) - sum(segments)
    found = [area(polygon) for polygon in outlines(s, 2000)]
    assert sum(found) == pytest.approx(union, rel=1e-4)
    assert found[0] == pytest.approx(math.pi * ri**2 - segments[0], rel=1e-4)


def test_an_interface_is_the_chord_of_both_circles():
    s = snapshot([[3, 3], [3.6, 3.9]], [0.8, 0.6], [(0, 1)])
    ends = interfaces(s)[0] + s.position[0]
    for end in ends:
        assert np.hypot(*(end - s.position[0])) == pytest.approx(0.8)
        assert np.hypot(*(end - s.position[1])) == pytest.approx(0.6)


def test_three_interfaces_end_where_they_meet():
    """Equal discs in a triangle: each chord ends where two circles cross, and in the middle."""
    angle = 2 * np.pi * np.arange(3) / 3
    place = 5 + 0.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    s = snapshot(place, 1.0, [(0, 1), (1, 2), (2, 0)])
    for contact, ends in enumerate(interfaces(s)):
        from_middle = np.sort(np.hypot(*(ends + place[s.i[contact]] - 5).T))
        half = math.sqrt(1 - 0.75 / 4)  # of the whole chord, 1/4 from the middle of the triangle
        assert from_middle == pytest.approx([0.0, half + 0.25], abs=1e-12)


def test_hidden_and_parted_interfaces_are_none():
    covered = snapshot([[3, 3], [4, 3], [3.5, 3.05]], [0.52, 0.52, 0.5], [(0, 1), (0, 2), (1, 2)])
    assert np.ptp(interfaces(covered)[0], axis=0) == pytest.approx([0, 0])
    link = snapshot([[3, 3], [6, 3]], 1.0, [(0, 1)], kind=LINK)  # stretched
    assert np.ptp(interfaces(link)[0], axis=0) == pytest.approx([0, 0])


def test_discs_that_only_touch_have_an_interface_after_they_were_kept(tmp_path):
    """Radii come back in 4 bytes, and so a little smaller or larger."""
    radius = np.linspace(0.3, 0.9, 50)
    place = np.cumsum(radius + np.append(0.0, radius[:-1]))
    pairs = np.column_stack([np.arange(49), np.arange(1, 50)])
    s = snapshot(np.column_stack([place, np.full(50, 5.0)]), radius, pairs, side=70.0)
    write_snapshots(tmp_path, "touching", [s], {}, models.model("microgel").SNAPSHOT_UNITS)
    [kept] = read_snapshots(tmp_path, "touching")
    gap = kept.separation[:, 0] - kept.radius[kept.i] - kept.radius[kept.j]
    assert (gap > 0).sum() > 10
    assert np.ptp(interfaces(kept), axis=1).any(axis=1).all()


def test_pressures_of_particles_sum_to_that_of_the_cell():
    s = many(200)
    virial = 0.5 * (s.normal * np.hypot(*s.separation.T)).sum()
    assert (particle_pressure(s) * np.pi * s.radius**2).sum() == pytest.approx(virial)


@pytest.mark.parametrize("still", [0.0, 0.5])
def test_an_affine_deformation_displaces_nothing(still):
    """Shear by 1.3 and compression by a tenth, in other images and a cell of less offset.

    The flow stands still at the foot of the cell, or halfway, as that of all models does.
    """
    first = many(50)._replace(offset=0.0)
    x, y = 0.9 * first.position.T
    side, strain = 0.9 * first.width, 1.3
    offset = (strain - 1) * side
    away = np.zeros((50, 2))
    away[7] = 0.3, -0.2
    now = first._replace(
        position=np.column_stack([x + strain * (y - still * side), y]) + away
        + [2 * side - offset, -side],
        width=side, height=side, offset=offset,
    )  # fmt: skip
    expected = away - away.mean(axis=0)
    gradient = 0.9 * np.array([[1.0, strain], [0.0, 1.0]])
    assert displacement(now, first, gradient) == pytest.approx(expected, abs=1e-9)


def test_particles_lie_in_the_rectangle_and_are_images_of_themselves():
    s = many(100)
    moved = s._replace(position=s.position + np.array([3 * s.width + s.offset, s.height]))
    assert in_rectangle(moved) == pytest.approx(in_rectangle(s), abs=1e-9)
    assert in_rectangle(s).min() >= 0
    assert in_rectangle(s).max() < s.width


def test_particles_that_touch_have_different_tints():
    """Bodies of two in a row, 0–1, 2–3, …, each touching the next."""
    place = np.column_stack([0.9 * np.arange(10) + 0.5, np.full(10, 5.0)])
    pairs = np.column_stack([np.arange(9), np.arange(1, 10)])
    s = snapshot(place, 0.5, pairs)
    tints = particle_tints(s, np.arange(10) // 2)
    assert (tints[::2] == tints[1::2]).all()
    assert (tints[1:-1:2] != tints[2::2]).all()
    mixed = s._replace(radius=np.where(np.arange(10) % 2, 0.7, 0.5))
    alone = particle_tints(mixed, np.full(10, -1))
    assert len(set(alone)) == 2  # large and small


# --- Drawing -------------------------------------------------------------------------------------


def test_the_cell_is_drawn_with_its_images():
    s = many(60)
    drawn = scene([s])
    drawn.show(0)
    discs, faces = drawn.artists[0].get_paths(), drawn.artists[0].get_facecolor()
    centres = np.array([path.vertices.mean(axis=0) for path in discs])
    own = ((centres > 0) & (centres < s.width)).all(axis=1)
    assert 0.8 * 60 < own.sum() < 1.2 * 60
    assert (~own).sum() > 20
    assert faces[~own].min() > faces[own].min()  # dimmed


@pytest.mark.parametrize(
    ("count", "edges", "linked", "contacts"),
    [(150, True, True, "state"), (10_000, False, True, "none"), (10_000, False, False, "force")],
)
def test_few_and_many_discs_are_legible(count, edges, linked, contacts):
    """Edges and states of contacts where discs are 7 points and more across.

    Else the colours of linked particles, or forces above their mean where there are none. There
    the cell is seen with two rows of its images and more.
    """
    s = many(count)
    s = s._replace(normal=np.linspace(0, 2, len(s.i)))
    assert view([s])[0] < -(1.4 * 0.7 if edges else 4 * 0.7) + 1e-9
    if linked:
        s = s._replace(kind=np.where(np.arange(len(s.i)) % 2, LINK, CONTACT).astype(np.int8))
    drawn = scene([s])
    drawn.show(0)
    assert (drawn.diameter > 7) == edges
    assert (drawn.artists[0].get_linewidth()[0] > 0) == edges
    assert drawn.contacts == contacts
    widths = np.asarray(drawn.artists[3 if contacts == "force" else 2].get_linewidth())
    assert widths.max() < 0.5 * max(drawn.diameter, 3)
    lines = sum(len(artist.get_paths()) for artist in drawn.artists[1:4])
    if contacts == "none":
        assert lines == 0
    elif contacts == "force":
        assert 0.45 * len(s.i) < lines < 0.65 * len(s.i)  # with those of images


@pytest.mark.parametrize(
    ("colour", "kind", "contacts"),
    [("particle", LINK, "state"), ("spin", LINK, "none"), ("spin", SLIDING, "state")],
)
def test_links_are_not_drawn_over_colours_with_a_scale(colour, kind, contacts):
    s = many(150)
    s = s._replace(spin=np.linspace(-1, 1, 150), kind=np.full(len(s.i), kind, np.int8))
    assert scene([s], colour=colour).contacts == contacts


def test_lines_are_as_wide_as_forces_are_strong():
    place = [[2, 2], [3, 2], [4, 2], [5, 2]]
    s = snapshot(place, 0.5, [(0, 1), (1, 2), (2, 3)])._replace(normal=np.array([1.0, 2.0, -1.0]))
    drawn = scene([s], contacts="force")
    drawn.show(0)
    forces = drawn.artists[3]
    widths = np.asarray(forces.get_linewidth())
    ends = np.array([np.asarray(path.vertices)[0] for path in forces.get_paths()])
    by_place = {round(float(x)): w for (x, _), w in zip(ends, widths, strict=True)}
    assert by_place[3] == pytest.approx(2 * by_place[2])
    assert len({tuple(c) for c in forces.get_color()}) == 2  # it pushes, or it pulls


def test_widths_of_a_film_go_by_its_usual_load():
    """The same width is the same force in all snapshots but those of more than twice the load.

    One with a millionth of the load has no chains, and no part in what is usual; where discs jam
    the chains of a thousand times the load are to be told apart.
    """
    place = [[2, 2], [3, 2], [4, 2]]
    usual = snapshot(place, 0.5, [(0, 1), (1, 2)])._replace(normal=np.array([0.4, 1.2]))
    loads = [1.0, 1.0, 0.5, 1.5, 10.0, 1e-6]
    film = [usual._replace(normal=load * usual.normal) for load in loads]

    def widths(drawn, number):
        drawn.show(number)
        return np.sort(drawn.artists[3].get_linewidth())

    drawn = scene(film, contacts="force")
    first = widths(drawn, 0)
    assert first[1] == pytest.approx(3 * first[0])
    for number in (1, 2, 3):
        assert widths(drawn, number) == pytest.approx(loads[number] * first)
    assert widths(drawn, 4)[0] == pytest.approx(2 * first[0])  # the other is as wide as any gets
    assert widths(drawn, 4)[0] < widths(drawn, 4)[1]
    drawn.show(5)
    assert len(drawn.artists[3].get_paths()) == 0
    # Alone, each has the widths of its own forces.
    for number in range(6):
        alone = scene(film, contacts="force", only=number)
        assert widths(alone, number) == pytest.approx(first)


def test_colours_of_one_snapshot_are_scaled_by_it_alone():
    """Displacements are from the first snapshot all the same."""
    s = many(80)
    spin = np.linspace(-1, 1, 80)
    film = [s._replace(spin=spin), s._replace(spin=1e-3 * spin)]
    film[1] = film[1]._replace(position=s.position + np.linspace(0, 0.5, 80)[:, None])
    (low, high), _ = ends(film, colour="spin")
    assert -low == high > 0.9
    (low, high), _ = ends(film, colour="spin", only=1)
    assert -low == high == pytest.approx(1e-3, rel=0.05)
    (_, all_of_it), _ = ends(film, colour="displacement")
    (_, high), _ = ends(film, colour="displacement", only=1)
    assert high == pytest.approx(all_of_it, rel=0.1)
    assert high > 0.1


@pytest.mark.parametrize(("every", "share"), [(4, 1.0), (1, 0.5)])
def test_forces_are_all_drawn_where_each_has_room(every, share):
    """Discs of the same size in the picture, with few contacts and with four times as many."""
    s = many(4500)
    s = s._replace(normal=np.linspace(1, 2, len(s.i)))
    for name in ("i", "j", "separation", "normal", "tangential", "kind"):
        s = s._replace(**{name: getattr(s, name)[::every]})
    drawn = scene([s], contacts="force")
    drawn.show(0)
    lines = len(drawn.artists[3].get_paths())
    assert share <= lines / len(s.i) < 1.45 * share  # with those of images


def legend(drawn):
    found = drawn.legend(drawn.axis)
    return [text.get_text() for text in found.get_texts()] if found else []


def test_many_forces_are_drawn_above_their_mean():
    """By as much as they are: half as far above it, half as wide."""
    s = many(4500)
    forces = np.resize([0.5, 1.25, 1.5, 0.5, 1.25], len(s.i))  # their mean is 1
    drawn = scene([s._replace(normal=forces)], contacts="force")
    drawn.show(0)
    widths = np.unique(np.round(drawn.artists[3].get_linewidth(), 9))
    assert len(widths) == 2
    assert widths[1] / widths[0] == pytest.approx(2, rel=0.02)
    assert legend(drawn) == ["push; width as force\nabove the mean"]


def test_the_legend_says_what_is_drawn():
    """Pushes and pulls as far as there are lines of them: weak ones may have none."""
    place = [[2, 2], [3, 2], [4, 2], [5, 2]]
    s = snapshot(place, 0.5, [(0, 1), (1, 2), (2, 3)])
    for forces, expected in [
        ([1.0, 1.0, -1.0], ["push; width as force", "pull"]),
        ([1.0, 1.0, -1e-6], ["push; width as force"]),
        ([-1.0, -1.0, -1.0], ["pull; width as force"]),
        ([0.0, 0.0, 0.0], []),
    ]:
        drawn = scene([s._replace(normal=np.array(forces))], contacts="force")
        assert legend(drawn) == expected


def ends(snapshots, **look):
    """The colour scale, and at which ends it is pointed."""
    drawn = scene(snapshots, contacts="none", **look)
    axis = Figure().add_axes((0, 0, 1, 0.1))
    drawn.colours.bar(axis, "")
    return drawn.colours._scale, axis._colorbar.extend


@pytest.mark.parametrize(
    ("energy", "expected"),
    [(6.6e-9, (0.0, 6.6e-9)), (-2.0, (-2.0, 0.0)), (0.0, (0.0, 1.0))],
)
def test_a_scale_of_equal_values_is_from_zero_to_them(energy, expected):
    s = many(80)
    film = [s._replace(energy=np.full(80, energy * factor)) for factor in (1.0, 1.0 + 1e-12)]
    scale, _ = ends(film, colour="energy")
    assert scale == pytest.approx(expected, rel=1e-9, abs=0.0)


def test_an_impulsive_start_is_beyond_the_scale():
    """A first snapshot ten times as fast as all others; one that is twice as fast counts."""
    s = many(100)
    speed = np.linspace([0, 0], [3, 4], 100)
    for factor, expected in [(10.0, 5.0), (2.0, 10.0)]:
        start, *more = (s._replace(velocity=speed * f) for f in (factor, 1.0, 1.0))
        (low, high), beyond = ends([start, *more], colour="speed")
        assert low == 0
        assert 0.8 * expected < high < expected
        assert beyond == "max"
    # Two of them are no start and what comes after.
    (_, high), _ = ends([s._replace(velocity=f * speed) for f in (10.0, 1.0)], colour="speed")
    assert high > 40


def test_scales_are_pointed_where_values_lie_beyond():
    s = many(100)
    spin = np.append(np.full(98, 0.5), [-9.0, 9.0])
    assert ends([s._replace(spin=spin)], colour="spin")[1] == "both"
    even = np.where(np.arange(100) % 2, 0.5, -0.5)
    assert ends([s._replace(spin=even)], colour="spin")[1] == "neither"


@pytest.mark.parametrize("look", [{"colour": "presure"}, {"contacts": "forces"}])
def test_words_that_are_none_of_a_look_are_refused(look):
    with pytest.raises(ValueError, match=r"'presure' is not|'forces' is not"):
        scene([many(20)], **look)


@pytest.mark.parametrize("colour", ["pressure", "spin", "speed", "displacement"])
def test_colours_follow_the_numbers(colour):
    s = many(80)
    s = s._replace(spin=np.linspace(-1, 1, 80), velocity=np.linspace([0, 0], [3, 4], 80))
    later = s._replace(position=s.position + np.linspace(0, 0.5, 80)[:, None])
    drawn = scene([s, later], colour=colour, contacts="none")
    drawn.show(0)
    before = drawn.artists[0].get_facecolor().copy()
    drawn.show(1)
    after = drawn.artists[0].get_facecolor()
    assert len(np.unique(after, axis=0)) > 20
    # Before anything has moved all have one colour, in the cell and dimmed in its images.
    assert (len(np.unique(before, axis=0)) == 2) == (colour == "displacement")


# --- Commands ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def jobs(tmp_path_factory):
    """The results of a study: a job with snapshots and one without."""
    folder = tmp_path_factory.mktemp("render")
    (folder / "study.yaml").write_text(STUDY)
    jobs = folder / "results/study/jobs"
    jobs.mkdir(parents=True)
    found = {job.labels[0][1]: job for job in load_study(folder / "study.yaml").jobs()}
    return {scene: run_job(job, jobs) for scene, job in found.items()}


def call(jobs, *arguments):
    root = str(jobs["kept"].parents[2])
    return CliRunner().invoke(app, ["render", *map(str, arguments), "--results", root])


def test_a_picture_is_written(jobs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shown = call(jobs, jobs["kept"].stem[:8])
    said = f"written: {jobs['kept'].stem}.png (snapshot 4, t = {when(jobs, 4)} s)\n"
    assert (shown.exit_code, shown.output) == (0, said)
    shown = call(jobs, jobs["kept"], "--time", when(jobs, 3), "--out", "three.png")
    assert shown.output == f"written: three.png (snapshot 3, t = {when(jobs, 3)} s)\n"
    with Image.open(f"{jobs['kept'].stem}.png") as image:
        assert image.size[0] > 1500
        assert len(image.convert("RGB").getcolors(1 << 24)) > 20
    assert call(jobs, jobs["kept"], "--snapshot", 2, "--out", "two.pdf").exit_code == 0
    assert (tmp_path / "two.pdf").read_bytes().startswith(b"%PDF")


def when(jobs, number):
    """Time of a snapshot, as a command says it."""
    kept = render.read_kept(jobs["kept"])
    return f"{kept.table.columns['time'][kept.snapshots[number].row]:.4g}"


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    """A job of four soft particles under a lid, with its snapshots."""
    folder = tmp_path_factory.mktemp("box")
    (folder / "study.yaml").write_text(BOX)
    (folder / "jobs").mkdir()
    [job] = load_study(folder / "study.yaml").jobs()
    return render.read_kept(run_job(job, folder / "jobs"))


def test_a_box_of_soft_particles_is_drawn_with_the_stress_on_its_lid(box, tmp_path):
    kept = box
    render.write_picture(kept, tmp_path / "box.png", -1)
    with Image.open(tmp_path / "box.png") as image:
        assert image.size[0] > 1500
    [(stress, label)], (against, strain) = render._curves(kept)
    assert (label, against) == ("stress on the lid [Pa]", "strain")
    assert np.array_equal(stress, kept.table.columns["stress_yy"])
    assert strain.max() == pytest.approx(0.05)


TISSUE = """
packing: {vertices: 16, particles: 9, preparation: tissue}
model: {kind: soft_particle, thickness: 0.15, links: {strength: 1}}
shear: {kind: tension, strain: 0.02, relative_rate: 0.02}
record: {rows: 20, snapshots: [0, 1]}
seed: 1
"""


@pytest.fixture(scope="module")
def tissue(tmp_path_factory):
    """A job of a torn tissue of nine cells, with its snapshots."""
    folder = tmp_path_factory.mktemp("tissue")
    (folder / "study.yaml").write_text(TISSUE)
    (folder / "jobs").mkdir()
    [job] = load_study(folder / "study.yaml").jobs()
    return render.read_kept(run_job(job, folder / "jobs"))


def test_a_tissue_is_drawn_by_the_energies_of_its_cells(tissue, tmp_path):
    kept = tissue
    render.write_picture(kept, tmp_path / "tissue.png", -1, "energy")
    with Image.open(tmp_path / "tissue.png") as image:
        assert image.size[0] > 1500
    drawn = scene(kept.snapshots, colour="energy")
    assert drawn.contacts == "none"
    drawn.show(1)
    assert len(drawn.artists[0].get_paths()) == 9
    assert len(np.unique(drawn.artists[0].get_facecolor(), axis=0)) > 5
    [(stress, label), (broken, _)], (against, strain) = render._curves(kept)
    assert (label, against) == ("tensile stress [Pa]", "strain")
    assert np.array_equal(stress, -kept.table.columns["stress_yy"])
    assert np.array_equal(broken, kept.table.columns["links_broken"])
    assert strain[-1] == pytest.approx(0.02)


def lid(s):
    """Where the lowest wall is that lies above the particles."""
    return max(-position for nx, ny, position in s.walls if ny < 0)


@pytest.mark.parametrize("which", ["box", "tissue"])
def test_what_moves_as_a_lid_or_grips_do_is_not_displaced(which, request):
    """Vertices at the same share of the height at all times; how high is known from the walls."""
    kept = request.getfixturevalue(which)
    first = kept.snapshots[0]
    height = kept.table.summary["preparation"]["height"] if which == "tissue" else lid(first)
    moved = []
    for s in kept.snapshots:
        ratio = 1 + (lid(s) - lid(first)) / height
        moved.append(s._replace(position=first.position * [1.0, ratio]))
    assert max(abs(lid(s) / lid(first) - 1) for s in kept.snapshots) > 0.01
    for s, gradient in zip(moved, kept.gradient, strict=True):
        away = displacement(s, first, gradient)
        assert np.abs(away).max() < 1e-5 * height  # positions are kept in 4 bytes


def test_a_cell_that_shrinks_has_a_gradient_of_both(jobs):
    """Shear by γ and the same ratio of both sides, which those of the cell show."""
    kept = render.read_kept(jobs["kept"])
    smaller = [s._replace(height=s.height * 0.9**k) for k, s in enumerate(kept.snapshots)]
    found = kept._replace(snapshots=smaller).gradient
    strain = kept.table.columns["strain"][[s.row for s in smaller]]
    assert strain[-1] == pytest.approx(0.2)
    for k, gradient in enumerate(found):
        assert gradient == pytest.approx(0.9**k * np.array([[1.0, strain[k]], [0.0, 1.0]]))


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """A job of a clamped beam of eight segments, with the snapshot of the end."""
    folder = tmp_path_factory.mktemp("beam")
    (folder / "study.yaml").write_text(BEAM)
    (folder / "jobs").mkdir()
    [job] = load_study(folder / "study.yaml").jobs()
    return render.read_kept(run_job(job, folder / "jobs"))


def test_a_single_body_has_no_displacements(beam, tmp_path):
    with pytest.raises(ResultsError, match="a single body, beside which nothing is displaced"):
        render.write_picture(beam, tmp_path / "beam.png", -1, "displacement")


def test_an_open_chain_is_drawn_by_its_bars(beam):
    """Lines from vertex to vertex, as thick as the beam; the clamp is grey; no forces in bars."""
    with render._stage(beam, "particle", None) as stage:
        stage.show(0)
        found = boxes(stage.figure)
        height, drawn = stage.figure.bbox.height, stage.scene
        bars, forces = drawn.artists[6], drawn.artists[3]
    assert found[:, 1].min() > 0
    assert found[:, 3].max() < height
    s = beam.snapshots[0]
    order = np.argsort(s.position[:, 0])
    at = np.array(sorted(np.asarray(path.vertices).tolist() for path in bars.get_paths()))
    assert at[:, 0] == pytest.approx(s.position[order[:-1]], abs=1e-6 * s.width)
    assert at[:, 1] == pytest.approx(s.position[order[1:]], abs=1e-6 * s.width)
    assert len(at) == 9  # one of them in the clamp
    assert bars.get_linewidth()[0] == pytest.approx(2 * drawn.point * s.radius[0])
    assert len(np.unique(bars.get_color(), axis=0)) == 2
    assert len(forces.get_paths()) == 0


def test_walls_are_drawn_along_the_sides_of_what_they_enclose(box):
    """A floor and a lid as long as the box is wide, sides as long as it is high."""
    s = box.snapshots[0]._replace(height=1.7 * box.snapshots[0].width)
    drawn = scene([s])
    drawn.show(0)
    lines = np.array([path.vertices for path in drawn.artists[5].get_paths()])
    assert len(lines) == len(s.walls) == 4
    for (nx, ny, position), (a, b) in zip(s.walls, lines, strict=True):
        assert a @ [nx, ny] == pytest.approx(position, abs=1e-9)
        sides = sorted([a.tolist(), b.tolist()])
        low = [sides[0][0 if ny else 1], sides[1][0 if ny else 1]]
        assert low == pytest.approx([0, s.width if ny else s.height], abs=1e-9)


def test_only_soft_particles_have_energies(jobs, tmp_path):
    for way in ([], ["--film"]):
        shown = call(jobs, jobs["kept"], "--colour", "energy", *way)
        assert isinstance(shown.exception, ResultsError)  # which `main` says, with exit code 2
        assert "no energies of its particles" in str(shown.exception)


def test_a_file_that_is_no_result_is_told_from_a_job_that_failed(tmp_path):
    for name, what in (
        ("a1.gsd", "no result of a job: give its id, a1, or its file in jobs/"),
        ("a1.json", "a job that failed: there is nothing to draw"),
    ):
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(ResultsError, match=what):
            render.read_kept(tmp_path / name)


def test_what_does_not_turn_is_not_coloured_by_spin(jobs, box, tmp_path):
    shown = call(jobs, jobs["kept"], "--colour", "spin", "--out", tmp_path / "spin.png")
    assert isinstance(shown.exception, ResultsError)
    assert "nothing turns its particles" in str(shown.exception)
    # The vertices of soft particles have no spin, the particles do.
    render.write_picture(box, tmp_path / "box.png", -1, "spin")
    assert (tmp_path / "box.png").exists()


def boxes(figure):
    """What is written on a figure beside its particles, as (left, bottom, right, top) [pixels]."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure).draw()
    writer = figure.canvas.get_renderer()
    found = []
    for axis in figure.axes[1:]:
        texts = [axis.xaxis.label, axis.yaxis.label]
        for side in (axis.xaxis, axis.yaxis):
            low, high = sorted(side.get_view_interval())
            texts += [tick.label1 for tick in side.majorTicks if low <= tick.get_loc() <= high]
        legend = axis.get_legend()
        texts += legend.get_texts() if legend else []
        extents = [t.get_window_extent(writer) for t in texts if t.get_visible() and t.get_text()]
        found += [(b.x0, b.y0, b.x1, b.y1) for b in extents if b.height > 0]
    return np.array(found)


@pytest.mark.parametrize(
    ("large", "colour"),
    [(1.0, "displacement"), (1e4, "displacement"), (1.0, "pressure"), (1.0, "speed")],
)
def test_no_letters_lie_on_others_or_on_the_particles(jobs, large, colour):
    """Of a gel with all four kinds of contacts, the title of whose scale has two lines."""
    kept = render.read_kept(jobs["kept"])
    kinds = np.arange(len(kept.snapshots[1].i)) % 3
    mixed = [s._replace(kind=np.resize(kinds, len(s.i)).astype(np.int8)) for s in kept.snapshots]
    table = kept.table
    columns = {name: -large * values if "stress" in name else values
               for name, values in table.columns.items()}  # fmt: skip
    kept = kept._replace(snapshots=mixed, table=table._replace(columns=columns))
    with render._stage(kept, colour, "state") as stage:
        stage.show(1)
        found = boxes(stage.figure)
        room = stage.scene.axis.get_window_extent().x1
        width = stage.figure.bbox.width
    left, bottom, right, top = found.T
    assert left.min() > room
    assert right.max() < width
    apart = (right[:, None] <= left) | (left[:, None] >= right)
    apart |= (top[:, None] <= bottom) | (bottom[:, None] >= top)
    assert apart[~np.eye(len(found), dtype=bool)].all()


def test_a_picture_shows_what_is_between_the_walls(box):
    """From the floor to where the lid was highest, and the side walls; of a cell also its rim."""
    left, bottom, width, height = view(box.snapshots)
    first = box.snapshots[0]
    lid = max(-wall[2] for s in box.snapshots for wall in s.walls if wall[1] < 0)
    assert (left < 0, bottom < 0) == (True, True)
    assert lid < bottom + height < 1.1 * lid
    assert first.width < left + width < 1.1 * first.width
    pressed = max(box.snapshots, key=lambda s: wall_force(s))
    assert view([pressed])[3] < height
    cell = many(60)
    left, bottom, width, height = view([cell])
    assert (left, bottom) == (pytest.approx(-1.4 * 0.7), left)
    assert width == height == pytest.approx(cell.width - 2 * left)


def test_an_open_cell_is_drawn_and_kept_with_all_that_has_left_it(tmp_path):
    """Its box of the file does not tilt, and holds all discs; the cell comes back as it was."""
    s = snapshot([[5, 5], [-40, 3], [12, 25], [4, -7]], 1.5, offset=4.0)._replace(periodic=False)
    write_snapshots(tmp_path, "open", [s], {}, models.model("microgel").SNAPSHOT_UNITS)
    [kept] = read_snapshots(tmp_path, "open")
    left, bottom, width, height = view([kept])
    for (x, y), radius in zip(kept.position, kept.radius, strict=True):
        assert left < x - radius < x + radius < left + width
        assert bottom < y - radius < y + radius < bottom + height
    assert kept.position == pytest.approx(s.position, abs=1e-5)
    assert (kept.width, kept.height, kept.offset) == (10, 10, 0)
    with gsd.hoomd.open(tmp_path / "open.gsd") as file:
        across, up, _, tilt, *_ = file[0].configuration.box
        x, y, _ = np.abs(file[0].particles.position).max(axis=0)
    assert tilt == 0
    assert x + 1.5 <= across / 2
    assert y + 1.5 <= up / 2


@pytest.mark.parametrize("gone", [(False, True, False), (True, False)])
def test_an_open_cell_comes_back_whether_or_not_something_has_left_it(tmp_path, gone):
    """GSD takes what a frame lacks from the first one, which may lack it too."""
    made = [
        snapshot([[5, 5], [-40 if away else 2, 3]], 1.0)._replace(periodic=False, row=row)
        for row, away in enumerate(gone)
    ]
    write_snapshots(tmp_path, "open", made, {}, models.model("microgel").SNAPSHOT_UNITS)
    for kept, s in zip(read_snapshots(tmp_path, "open"), made, strict=True):
        assert (kept.width, kept.height) == (s.width, s.height)
        assert kept.position == pytest.approx(s.position, abs=1e-5)


def wall_force(s):
    return s.normal[s.j < 0].sum()


def test_a_film_has_a_frame_for_each_snapshot(jobs, tmp_path):
    path = tmp_path / "film.gif"
    shown = call(jobs, jobs["kept"], "--film", "--colour", "pressure", "--out", path)
    assert shown.exit_code == 0, shown.output
    with Image.open(path) as image:
        assert image.n_frames == 5
        assert image.info["duration"] == render.FRAME_MS
        first = np.asarray(image.convert("RGB"), int)
        image.seek(4)
        last = np.asarray(image.convert("RGB"), int)
    moved = np.abs(first - last).max(axis=2) > 60
    assert 0.02 < moved.mean() < 0.6  # the particles, and not the axes


def test_a_frame_shows_what_a_picture_shows(jobs, tmp_path):
    """Blitting leaves nothing behind: the last frame is as where it is drawn first."""
    kept = render.read_kept(jobs["kept"])
    render.write_film(kept, tmp_path / "film.gif")
    render.write_film(kept._replace(snapshots=kept.snapshots[::-1]), tmp_path / "back.gif")
    frames = []
    for name, number in (("film", 4), ("back", 0)):
        with Image.open(tmp_path / f"{name}.gif") as image:
            image.seek(number)
            frames.append(np.asarray(image.convert("RGB"), int))
    assert (np.abs(frames[0] - frames[1]).max(axis=2) > 60).mean() < 1e-3


@pytest.mark.parametrize("name", ["kept.png", "kept.pdf", "kept.gif"])
def test_what_cannot_be_written_leaves_what_was_there(jobs, tmp_path, monkeypatch, name):
    """A disc that is full: the file is named, the old one whole, and nothing else is left."""
    path = tmp_path / name
    path.write_text("old")

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    shown = call(jobs, jobs["kept"], "--out", path, *(["--film"] if name.endswith("gif") else []))
    assert isinstance(shown.exception, OSError)
    assert str(shown.exception) == f"{path}: cannot be written (No space left on device)"
    assert [each.name for each in tmp_path.iterdir()] == [name]
    assert path.read_text() == "old"


def test_a_folder_is_no_picture(jobs, tmp_path):
    (tmp_path / "kept.png").mkdir()
    for folder in (tmp_path, tmp_path / "kept.png"):
        shown = call(jobs, jobs["kept"], "--out", folder)
        assert shown.exit_code == 2
        assert "this is a folder" in " ".join(shown.stderr.replace("│", " ").split())


def test_no_way_to_write_there_is_bad_input(jobs, tmp_path, monkeypatch):
    def refused(descriptor):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("os.fsync", refused)
    for name in ("kept.png", "kept.gif"):
        film = ["--film"] if name.endswith("gif") else []
        shown = call(jobs, jobs["kept"], "--out", tmp_path / name, *film)
        assert isinstance(shown.exception, ResultsError)  # which `main` says, with exit code 2
        assert "cannot be written there (Permission denied): another --out" in str(shown.exception)


def test_the_shell_completes_jobs_that_can_be_drawn(jobs, tmp_path):
    """Not the one that has kept no snapshots."""
    context = SimpleNamespace(params={"results": jobs["kept"].parents[2]})
    assert cli._jobs_with_snapshots(context, "") == [jobs["kept"].stem]
    assert len(cli._known_jobs(context, "")) == 2
    assert cli._jobs_with_snapshots(context, "no") == []


def test_a_film_of_ten_thousand_discs_is_drawn_larger(jobs, tmp_path):
    """Seven pixels a disc, or twice as large as a film of few; with their colours, not edges."""
    kept = render.read_kept(jobs["kept"])
    large = [many(10_000)._replace(row=0), many(10_000)._replace(row=1)]
    sizes, pixels = [], []
    for name, film in (("few", kept), ("many", kept._replace(snapshots=large))):
        render.write_film(film, tmp_path / f"{name}.gif", contacts="none")
        with Image.open(tmp_path / f"{name}.gif") as image:
            sizes.append(image.width)
        with render._stage(film, "particle", None) as stage:
            scale = sizes[-1] / stage.figure.get_size_inches()[0] / 72
            pixels.append(stage.scene.diameter * scale)
    assert pixels[0] > 7
    assert sizes[1] > 1.4 * sizes[0]
    assert pixels[1] > 6


def test_what_falls_has_an_arrow_of_its_weight():
    """As it is driven: by sin α along x, cos α downwards; within the cell."""
    s = many(60)
    drawn = scene([s])
    before = len(drawn.artists)
    drawn.draw_weight(30.0)
    ground, arrow, letter = drawn.artists[before:]
    start, end = arrow._posA_posB
    assert (end - start) / np.hypot(*(end - start)) == pytest.approx([0.5, -math.sqrt(0.75)])
    for at in (start, end, ground.center, letter.get_position()):
        assert 0 < at[0] < s.width
        assert 0 < at[1] < s.height


@pytest.mark.parametrize("largest", [16.0, 25.0])
def test_a_peak_does_not_flatten_all_else(largest):
    """An axis is logarithmic where the largest value is more than twenty times the median."""
    axis = Figure().add_axes((0, 0, 1, 1))
    render._bring_near(axis, np.array([0.0, 1.0, -1.0, 1.0, largest]))
    assert axis.get_yscale() == ("symlog" if largest > 20 else "linear")


def test_stages_are_drawn_against_time(jobs):
    """Their strain goes back, or stands still."""
    kept = render.read_kept(jobs["kept"])
    summary = kept.table.summary
    stages = summary | {"protocol": summary["protocol"] | {"kind": "stages"}}
    kept = kept._replace(table=kept.table._replace(summary=stages))
    curves, (label, against) = render._curves(kept)
    assert label == "time [s]"
    assert np.array_equal(against, kept.table.columns["time"])
    assert curves[0][1] == "strain"
    assert np.array_equal(curves[0][0], kept.table.columns["strain"])


def test_a_moment_is_said_as_on_the_axis(jobs):
    kept = render.read_kept(jobs["kept"])
    summary = kept.table.summary
    protocol = summary["protocol"] | {"period": 0.1, "shear_start": 0.05}
    swinging = kept._replace(table=kept.table._replace(summary=summary | {"protocol": protocol}))
    assert render.moment(kept, 4) == "t = 0.2 s"
    assert render.moment(swinging, 4) == "t = 0.2 s, t / period = 1.5"


def test_the_snapshot_nearest_to_a_time(jobs):
    kept = render.read_kept(jobs["kept"])
    assert [render.nearest(kept, time) for time in (0, 0.06, 0.09, 0.2)] == [0, 1, 2, 4]
    assert render.nearest(kept, float(when(jobs, 4))) == 4  # as said, in four digits


@pytest.mark.parametrize("time", [float("nan"), float("inf"), -0.01, 0.21, 1e9])
def test_a_time_outside_of_the_run_is_refused(jobs, time):
    kept = render.read_kept(jobs["kept"])
    with pytest.raises(ResultsError, match=r"no time .* s: the run is from 0 to 0\.2 s"):
        render.nearest(kept, time)
    protocol = kept.table.summary["protocol"] | {"period": 0.1}
    summary = kept.table.summary | {"protocol": protocol}
    swinging = kept._replace(table=kept.table._replace(summary=summary))
    with pytest.raises(ResultsError, match=r"to 0\.2 s, a period of it 0\.1 s"):
        render.nearest(swinging, time)


@pytest.mark.parametrize(
    ("scene", "options", "message"),
    [
        ("kept", ["--time", "nan"], "no time nan s: the run is from 0 to 0.2 s"),
        ("none", [], "has kept no snapshots: add `record: {snapshots: 20}`"),
        ("kept", ["--snapshot", 5], "no snapshot 5: there are 5, from 0 to 4"),
        ("kept", ["--snapshot", 1, "--film"], "give one of them"),
        ("kept", ["--out", "x.gif"], "must end with .png or .pdf, or .gif with --film"),
        ("kept", ["--film", "--out", "x.png"], "must end with .gif with --film, and with .png or"),
        ("kept", ["--film", "--out", "none/x.gif"], "there is no folder none: make it first"),
    ],
)
def test_what_cannot_be_drawn_is_said(jobs, scene, options, message):
    shown = call(jobs, jobs[scene], *options)
    if isinstance(shown.exception, ResultsError):  # which `main` says, with exit code 2
        assert message in str(shown.exception)
    else:
        assert shown.exit_code == 2
        assert message in " ".join(shown.stderr.replace("│", " ").split())
