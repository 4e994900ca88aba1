"""Snapshots: what is kept of particles and contacts, and what others read of it."""

import copy
import hashlib
import shutil
from pathlib import Path

import gsd.hoomd
import numpy as np
import pyarrow.parquet as pq
import pytest
from soft_particles import chain, finished, points, prepared, ring, system
from tools import differences, read_table

from shear_sim import models, runner, snapshots
from shear_sim.accuracy import finish
from shear_sim.models.interface import BAR, CONTACT_KINDS, LINK, SLIDING
from shear_sim.models.soft_particle.snapshots import take
from shear_sim.plan import make_plan
from shear_sim.protocol import snapshot_rows
from shear_sim.render import read_kept
from shear_sim.results import Results
from shear_sim.runner import Stopped, run_job
from shear_sim.single import repeat
from shear_sim.snapshots import (
    clusters,
    damage,
    in_cell,
    paths,
    read_snapshots,
    write_snapshots,
)
from shear_sim.status import read_status
from shear_sim.streams import Streams
from shear_sim.study import Job, StudyError, load_study, read_study
from shear_sim.tables import TableError

MICROGEL = {"packing": {"discs": 40, "packing_fraction": 1.5}, "shear": {"strain_amplitude": 0.5}}
HARD = {"packing": {"discs": 24, "packing_fraction": 0.8}, "model": {"kind": "hard_disc"}}
STEADY = {"kind": "steady", "strain": 0.5}
POINTS = {
    "microgel: friction and links": {**MICROGEL, "model": {"friction": 0.1}},
    "microgel: loose, plates": {
        **MICROGEL,
        "model": {"links": {"cut": "none"}},
        "cell": {"boundary": "plates"},
    },
    "microgel: steady, backwards": {
        **MICROGEL,
        "shear": {"kind": "steady", "relative_rate": -0.05, "strain": 1.0},
    },
    "hard discs: steady": {**HARD, "shear": STEADY},
    "hard discs: fixed pressure": {**HARD, "shear": {**STEADY, "scaled_pressure": 10.0}},
    "hard discs: oscillatory": {**HARD, "shear": {"kind": "oscillatory", "periods": 1}},
    "hard discs: triangles": {
        **HARD,
        "packing": {"discs": 24, "packing_fraction": 0.7, "body": "triangle"},
        "shear": STEADY,
    },
    "soft particle: ring with friction": {
        "packing": {"vertices": 24},
        "model": {"kind": "soft_particle", "friction": 1e-5},
        "shear": {"kind": "diametral_compression", "compression": 0.3, "relative_rate": 0.03},
        "record": {"rows": 40},
    },
}
NAMES = sorted(POINTS)
KEPT = [name for name in NAMES if name.endswith(("links", "triangles", "friction"))]  # in files
SOFT = {
    "kind": "soft_particle",
    "thickness": 0.1,
    "contact_stiffness": 33.0,
    "contact_damping": 0.3,
    "inner_damping": 0.3,
    "drag": 0.03,
    "core_ratio": 10.0,
}
SUSPENSION = points(
    packing={"particles": 6, "vertices": 16, "packing_fraction": 0.95},
    model=SOFT,
    shear={"kind": "oscillatory", "relative_frequency": 0.05, "periods": 1},
    record={"rows": 40, "snapshots": 40},
)
TISSUE = points(
    packing={"particles": 6, "vertices": 16, "preparation": "tissue"},
    model=SOFT | {"links": {"strength": 1.0}},
    shear={"kind": "tension", "strain": 0.1, "relative_rate": 0.01},
    record={"rows": 20, "snapshots": [0]},
)
BOX = points(
    packing={"particles": 6, "vertices": 16, "spread": 0.15},
    model=SOFT | {"inner_damping": 1.0, "drag": 0.0},
    shear={"kind": "compaction", "strain": 0.25, "relative_rate": 0.003, "unload": False},
    record={"rows": 40, "snapshots": [0, 0.6, 0.8, 1]},
)


def make_job(name, snapshots=None, shear=None):
    data = POINTS[name] | ({"shear": shear} if shear else {})
    kind = data.get("model", {}).get("kind", "microgel")
    data = data | {"record": data.get("record", {}) | {"snapshots": snapshots}}
    return Job.create(models.model(kind).POINT.model_validate(data), seed=3, replicate=1)


def started(name, snapshots=None, shear=None):
    job = make_job(name, snapshots, shear)
    return models.model(job.point.kind).start(job.point, job.streams)


@pytest.fixture(scope="module")
def runs():
    """Every point run to the end, with snapshots, by its name."""
    made = {}

    def get(name):
        if name not in made:
            made[name] = started(name, 10)
            finish(made[name])
        return made[name]

    return get


def forces(snapshot):
    """What each contact does to its second particle (C, 2)."""
    normal = snapshot.separation / np.hypot(*snapshot.separation.T)[:, None]
    along = np.column_stack([-normal[:, 1], normal[:, 0]])
    return snapshot.normal[:, None] * normal + snapshot.tangential[:, None] * along


def stress(snapshot):
    area = snapshot.width * snapshot.height
    return np.einsum("ca,cb->ab", forces(snapshot), snapshot.separation) / area


# --- What is kept --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_snapshots_do_not_change_a_bit(name, runs):
    plain = started(name)
    while plain.done < plain.rows:
        plain.advance(37)  # also in other blocks
    kept = runs(name).columns()
    for column, values in plain.columns().items():
        assert values.tobytes() == kept[column].tobytes(), column
    assert len(plain.snapshots) == 0
    assert len(runs(name).snapshots) > 4


@pytest.mark.parametrize("name", [n for n in NAMES if n.startswith("microgel")])
def test_forces_of_the_contacts_sum_to_the_recorded_stress(name, runs):
    """σ = Σ f r / V of all contacts and links, of a periodic cell and of one with plates."""
    columns, sliding = runs(name).columns(), 0
    for snapshot in runs(name).snapshots:
        recorded = [
            [columns[f"periodic_love_weber_{a}{b}"][snapshot.row] for b in "xy"] for a in "xy"
        ]
        assert stress(snapshot) == pytest.approx(np.array(recorded), rel=1e-12, abs=1e-9)
        touching = np.hypot(*snapshot.separation.T) < snapshot.radius[
            np.column_stack([snapshot.i, snapshot.j])
        ].sum(axis=1)
        discs = len(snapshot.radius)
        assert 2 * touching.sum() / discs == columns["coordination"][snapshot.row]
        sliding += (snapshot.kind == SLIDING).sum()
    assert sliding > 0
    assert any((s.kind == LINK).any() for s in runs(name).snapshots) == ("loose" not in name)


@pytest.mark.parametrize("name", [n for n in NAMES if n.startswith("hard")])
def test_forces_of_hard_discs_sum_to_the_recorded_stress(name, runs):
    columns = runs(name).columns()
    loaded = 0
    for snapshot in runs(name).snapshots:
        found, row = stress(snapshot), snapshot.row
        loaded += len(snapshot.i) > 0
        shear, pressure = columns["scaled_shear_stress"][row], columns["scaled_pressure"][row]
        assert abs(found[0, 1]) == pytest.approx(abs(shear), rel=1e-12)
        assert np.trace(found) / 2 == pytest.approx(pressure, rel=1e-12)
        gap = np.hypot(*snapshot.separation.T)
        gap -= snapshot.radius[snapshot.i] + snapshot.radius[snapshot.j]
        assert np.abs(gap).max(initial=0) < 1e-12
    assert loaded > 2


def test_contacts_of_a_ring_are_the_forces_on_its_vertices(runs):
    """Bars, hinges and plates: what they do to each vertex, and to the plates in sum."""
    name = "soft particle: ring with friction"
    run, columns = runs(name), runs(name).columns()
    last, motion = run.snapshots[-1], run.run.system.motion
    assert last.row == run.rows - 1
    force = forces(last)
    total = np.zeros((24, 2))
    np.add.at(total, last.i, -force)
    np.add.at(total, last.j[last.j >= 0], force[last.j >= 0])
    scale = np.abs(force).max()
    assert np.abs(total - np.column_stack([motion.fx, motion.fy])).max() < 1e-12 * scale
    for snapshot in run.snapshots:
        plates = snapshot.j < 0
        push = snapshot.normal[plates].sum() / 2
        assert push == pytest.approx(columns["force"][snapshot.row], rel=1e-12)
    assert any((s.kind == SLIDING).any() for s in run.snapshots)


def soft_stress(snapshot, held=False):
    """σ of springs and cores; ``held``: forces on fixed vertices act at the line y = 0."""
    separation = snapshot.separation.copy()
    if held:
        y, fixed, real = snapshot.position[:, 1], snapshot.fixed, snapshot.j >= 0
        i, j = snapshot.i[real], snapshot.j[real]
        point = y[i] + separation[real, 1]
        line = snapshot.height * np.rint((point - y[j]) / snapshot.height)
        end = np.where(fixed[j], line, point)
        separation[real, 1] = end - np.where(fixed[i], 0.0, y[i])
    total = np.einsum("ca,cb->ab", forces(snapshot), separation)
    free = ~snapshot.fixed if held else slice(None)
    total += np.diag([snapshot.core.sum(), snapshot.core[free].sum()])
    return total / (snapshot.width * snapshot.height)


def at_rest(system):
    """The stress of a cell by its vertices, without dashpots and inertia."""
    motion, images = system.motion, system.cell.images.copy()
    images[:, 1] = 0.0
    still = {name: np.zeros_like(motion.x) for name in ("dx", "dy", "vx", "vy")}
    bare = copy.copy(system)
    bare.motion, bare.cell = motion._replace(**still), system.cell._replace(images=images)
    return bare.stress().reshape(2, 2)


@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize("boundary", ["lees_edwards", "plates"])
def test_stress_of_a_suspension_is_that_of_its_contacts_and_cores(boundary, friction):
    """Without friction to round-off of the forces; recorded: with dashpots, most at the begin."""
    given = SUSPENSION(model={"friction": friction}, cell={"boundary": boundary})
    simulation = prepared(given, 3)
    plates, away = boundary == "plates", []
    for row in range(simulation.rows):
        simulation.advance(1)
        snapshot = simulation.snapshots[-1]
        assert snapshot.row == row
        found, expected = soft_stress(snapshot, plates), at_rest(simulation.run.system)
        pressure = np.trace(expected) / 2
        assert np.abs(found - expected).max() < (1e-2 if friction else 1e-9) * pressure
        record = {name: values[-1] for name, values in simulation.columns().items()}
        recorded = np.array([[record[f"stress_{a}{b}"] for b in "xy"] for a in "xy"])
        assert np.abs(recorded - expected).max() < (0.02 if row else 0.04) * pressure
        assert snapshot.core.sum() > 0.5 * pressure * snapshot.width * snapshot.height
        away.append(np.abs(soft_stress(snapshot) - recorded).max() / pressure)
    assert (max(away) > 0.06) == plates


def test_stress_of_a_box_is_that_of_its_contacts_and_cores():
    """Of springs, over the box as it is now: the mean of floor and lid, and of the sides."""
    simulation = finished(BOX())
    columns = simulation.columns()
    assert len(simulation.snapshots) == 4
    for snapshot in simulation.snapshots[1:]:
        row = snapshot.row
        found = soft_stress(snapshot) * snapshot.width * snapshot.height / columns["box_area"][row]
        assert found[1, 1] == pytest.approx(
            0.5 * (columns["stress_yy"][row] + columns["stress_floor"][row]), rel=0.01
        )
        assert found[0, 0] == pytest.approx(columns["stress_xx"][row], rel=0.02)
        assert snapshot.core.sum() / columns["box_area"][row] > 0.1 * found[1, 1]


@pytest.mark.parametrize("closed", [True, False])
def test_contacts_of_two_chains_are_the_forces_on_each(closed):
    """Sliding by a ring: the sum over each chain, of normal forces and friction (bars cancel)."""
    other = ring(12, x=2.05) if closed else chain([(1.03, -2), (1.03, 0.1), (1.03, 2)])
    s = system(ring(12), other, friction=0.3)
    s.motion.vx[:12], s.motion.vy[:12] = 0.02, 0.05
    s.advance(round(1 / s.rules.step))
    snapshot = take(s, 0, (-4.0, -4.0, 8.0, 8.0))
    touching = snapshot.kind != BAR
    force = forces(snapshot)
    total = np.zeros((len(s.motion.x), 2))
    np.add.at(total, snapshot.i, -force)
    np.add.at(total, snapshot.j, force)
    assert touching.sum() > 0
    assert np.abs(snapshot.tangential[touching]).max() > 0.01 * snapshot.normal[touching].max()
    for part in (slice(0, 12), slice(12, None)):
        on_chain = np.array([s.motion.fx[part].sum(), s.motion.fy[part].sum()])
        assert total[part].sum(axis=0) == pytest.approx(on_chain, rel=1e-9)
        assert np.hypot(*on_chain) > 0


def test_separations_join_images_of_the_particles(runs):
    """Separation − (position of j − position of i) is a vector of the lattice."""
    for name in ("microgel: steady, backwards", "hard discs: steady"):
        for s in runs(name).snapshots:
            x, y = (s.separation - s.position[s.j] + s.position[s.i]).T
            up = y / s.height
            across = (x - np.rint(up) * s.offset) / s.width
            assert np.abs(up - np.rint(up)).max(initial=0) < 1e-12
            assert np.abs(across - np.rint(across)).max(initial=0) < 1e-12


def test_velocities_are_those_of_the_flow_and_beside_it(runs):
    """Hard discs that touch do not approach: r·(v_j − v_i) = 0, images with the cell's velocity."""
    compared = 0
    for s in runs("hard discs: steady").snapshots:
        up = np.rint((s.separation - s.position[s.j] + s.position[s.i])[:, 1] / s.height)
        relative = s.velocity[s.j] - s.velocity[s.i]
        relative[:, 0] += up * s.height  # of strain 1
        assert np.abs((relative * s.separation).sum(axis=1)).max(initial=0) < 1e-9
        compared += len(up)
    assert compared > 50


# --- When ----------------------------------------------------------------------------------------


def test_a_number_counts_in_units_of_the_protocol():
    clock = np.linspace(-2, 4, 601)  # periods; the shear ends at 3
    assert [round(clock[row], 9) for row in snapshot_rows(2, clock, 3.0)] == [
        0, 0.5, 1, 1.5, 2, 2.5, 3,
    ]  # fmt: skip
    assert len(snapshot_rows(100, clock, 3.0)) == 301
    assert snapshot_rows(2, clock[::50], 3.0) == (4, 5, 6, 7, 8, 9, 10)


@pytest.mark.parametrize(
    ("name", "shear"),
    [
        ("hard discs: steady", {"kind": "steady", "strain": 0.3}),
        ("hard discs: steady", {"kind": "compression", "compression": -0.1}),
        ("microgel: loose, plates", {"strain_amplitude": 0.1, "periods": 0.7}),
        (
            "microgel: steady, backwards",
            {"kind": "steady", "relative_rate": -0.05, "strain": 0.3, "post_periods": 0},
        ),
    ],
)
def test_a_number_keeps_the_end_of_the_shear(name, shear):
    """Where it does not divide the shear: the last picture shows what this has come to."""
    simulation = started(name, 5, shear)
    finish(simulation)
    columns, protocol = simulation.columns(), simulation.summary()["protocol"]
    kept = columns["time"][[snapshot.row for snapshot in simulation.snapshots]]
    assert kept[-1] == pytest.approx(protocol["shear_end"], rel=1e-2)
    assert len(kept) > 1
    assert (np.diff(kept) > 0).all()


def test_moments_are_those_of_the_nearest_records():
    clock = np.linspace(0, 1, 11)
    assert snapshot_rows((0.0, 0.32, 0.31, 0.97), clock, 1.0) == (0, 3, 10)
    assert snapshot_rows(None, clock, 1.0) == ()


def test_a_number_of_an_oscillation_begins_with_the_shear():
    simulation = started("microgel: friction and links", 4)
    finish(simulation)
    columns = simulation.columns()
    rows = [snapshot.row for snapshot in simulation.snapshots]
    assert rows == list(range(480, 1201, 60))  # two periods of rest, three of shear
    assert columns["strain"][rows[1]] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("record: {snapshots: 0}", "record.snapshots = 0: must be a number of snapshots"),
        ("record: {snapshots: [a]}", "must be a number of snapshots"),
        ("record: {snapshots: []}", "or a list of moments"),
        (
            "record: {snapshots: 241}",
            "there are 240 records: at most that many, or more records by record.every or integr",
        ),
        (
            "model: {kind: soft_particle}\nrecord: {snapshots: 20}\nscenes: {a: {record.rows: 20}}",
            "20 snapshots (record.snapshots) in a unit",
        ),
        ("record: {snapshots: [0, 9]}", "9 is not within the run, from -2 to 4"),
        (
            "{model: {kind: hard_disc}, shear: {kind: steady}, record: {snapshots: [-0.1]}}",
            "-0.1 is not within the run, from 0 to",
        ),
        ("model: {kind: soft_particle}\nrecord: {snapshots: [2.1]}", "from 0 to 2"),
    ],
)
def test_what_cannot_be_kept_is_said_with_its_line(text, message, tmp_path):
    with pytest.raises(StudyError, match="1 problem") as caught:
        read_study(text.encode(), tmp_path / "study.yaml")
    assert message in str(caught.value)


def test_a_study_without_snapshots_keeps_its_job_ids():
    """Results made before there were snapshots stay: the key is left out where there are none."""
    parameters = make_job("hard discs: steady").parameters
    assert "snapshots" not in parameters["record"]
    one, other = make_job("hard discs: steady", 2), make_job("hard discs: steady", 3)
    assert one.parameters["record"]["snapshots"] == 2
    assert len({one.id, other.id, make_job("hard discs: steady").id}) == 3
    assert Job.from_json(one.to_json()) == one


# --- Files ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A results folder with one finished job of each model."""
    results = Results(tmp_path_factory.mktemp("study"))
    results.jobs.mkdir()
    for name in KEPT:
        run_job(make_job(name, 5), results.jobs)
    return results


@pytest.mark.parametrize("name", KEPT)
def test_files_give_the_snapshots_back(name, study):
    simulation = started(name, 5)
    finish(simulation)
    found = read_snapshots(study.snapshots, make_job(name, 5).id)
    assert [s.row for s in found] == [s.row for s in simulation.snapshots]
    for back, snapshot in zip(found, simulation.snapshots, strict=True):
        for field in ("i", "j", "separation", "normal", "tangential", "kind", "fixed", "periodic"):
            assert np.array_equal(getattr(back, field), getattr(snapshot, field)), field
        assert np.array_equal(back.spin, snapshot.spin)
        assert np.array_equal(back.core, snapshot.core)
        side = snapshot.width
        assert back.walls == pytest.approx(snapshot.walls, abs=1e-6 * side)
        for field in ("velocity", "radius", "mass", "width", "height"):
            value = np.asarray(getattr(snapshot, field))
            scale = np.abs(value).max() + 1e-300
            assert np.abs(getattr(back, field) - value).max() < 1e-6 * scale, field
        away = in_cell(back) - in_cell(snapshot)
        if snapshot.periodic:  # rounding may bring a particle to the other side
            away[:, 0] -= np.rint(away[:, 1] / snapshot.height) * snapshot.offset
            away -= np.rint(away / side) * side
        assert np.abs(away).max() < 1e-6 * side


def test_what_others_read(study):
    """The 2D box, diameters, bonds and bodies of GSD's own reader; strain and stress in the log."""
    job = make_job("microgel: friction and links", 5)
    table = read_table(study.job_file(job.id))
    assert table.summary["snapshots"] == {"count": 16}
    gsd_file, _ = paths(study.snapshots, job.id)
    with gsd.hoomd.open(gsd_file) as file:
        for frame, snapshot in zip(file, read_snapshots(study.snapshots, job.id), strict=True):
            box, row = frame.configuration.box, frame.configuration.step
            metres = frame.log["unit_of_length"][0]
            assert box[0] * metres == pytest.approx(job.point.cell.width, rel=1e-6)
            assert frame.particles.velocity[:, :2] * metres == pytest.approx(
                snapshot.velocity, rel=1e-6
            )
            mass = job.point.packing.density * np.pi * snapshot.radius**2
            assert frame.particles.mass == pytest.approx(mass, rel=1e-5)
            strain = table.columns["strain"][row]
            assert frame.configuration.dimensions == 2
            assert box[2] == 0
            assert box[3] * box[1] / box[0] == pytest.approx(strain - np.rint(strain), abs=1e-6)
            assert frame.log["strain"] == [strain]
            assert frame.log["shear_stress"] == [-table_shear(table, row)]
            # In the box: |fractional coordinates| ≤ 1/2.
            y = frame.particles.position[:, 1] / box[1]
            x = (frame.particles.position[:, 0] - box[3] * box[1] * y) / box[0]
            assert max(np.abs(x).max(), np.abs(y).max()) <= 0.5 + 1e-6
            assert (frame.particles.diameter**2).sum() * np.pi / 4 == pytest.approx(
                1.5 * box[0] * box[1], rel=1e-5
            )
            links = {frozenset(pair) for pair in frame.bonds.group.tolist()}
            ends = np.column_stack([snapshot.i, snapshot.j])[snapshot.kind == LINK]
            assert links == {frozenset(pair) for pair in ends.tolist()}
            body = frame.particles.body
            assert (body[frame.bonds.group[:, 0]] == body[frame.bonds.group[:, 1]]).all()
            assert len(np.unique(body[body >= 0])) == table.summary["preparation"]["particles"]


@pytest.mark.parametrize("name", KEPT)
def test_lengths_of_a_file_are_of_order_one(name, study):
    """In metres freud's Voronoi cells of microgels are wrong by 2 to 11 % of the box, so 2e-9."""
    job = make_job(name, 5)
    gsd_file, _ = paths(study.snapshots, job.id)
    kept = read_snapshots(study.snapshots, job.id)
    with gsd.hoomd.open(gsd_file) as file:
        units = {frame.log["unit_of_length"][0] for frame in file}
        assert 0.3 < np.mean([frame.particles.diameter.mean() for frame in file]) < 3.2
    assert len(units) == 1
    unit = units.pop()
    assert np.log10(unit) % 1 == 0
    assert 0.3 < 2 * kept[0].radius.mean() / unit < 3.2
    assert (unit == 1) == ("hard" in name)  # in λ, of their own


def test_files_in_metres_are_read_too(study, tmp_path, monkeypatch):
    """Those written before there was a unit of length."""

    def before(snapshot, log, unit):
        made = whole(snapshot, log, 1.0)
        del made.log["unit_of_length"]
        return made

    whole, job = snapshots.frame, make_job("microgel: friction and links", 5)
    kept = read_snapshots(study.snapshots, job.id)
    monkeypatch.setattr(snapshots, "frame", before)
    units = models.model("microgel").SNAPSHOT_UNITS
    write_snapshots(tmp_path, job.id, kept, {}, units)
    for one, other in zip(read_snapshots(tmp_path, job.id), kept, strict=True):
        assert one.position == pytest.approx(other.position, abs=1e-6 * other.width)
        assert one.radius == pytest.approx(other.radius, rel=1e-6)


@pytest.mark.parametrize("name", KEPT)
def test_a_contact_table_says_its_units_and_what_it_adds_up_to(name, study):
    """By the files alone: units multiply to those of a stress, and the sum is in the log."""
    job = make_job(name, 5)
    gsd_file, table = paths(study.snapshots, job.id)
    fields = {field.name: field.metadata for field in pq.read_schema(table)}
    length, force = (fields[key][b"unit"].decode() for key in ("x", "normal"))
    hard = "hard" in name
    assert (length, force) == (("λ", "λ path rate/ξ₀") if hard else ("m", "N/m"))
    assert [fields[key][b"unit"] for key in ("y", "tangential")] == [
        each.encode() for each in (length, force)
    ]
    text = fields["normal"][b"description"].decode()
    values = read_table(table).columns
    with gsd.hoomd.open(gsd_file) as file:
        for number, frame in enumerate(file):
            if "soft" in name:  # what a suspension and a box add up to are tests above
                assert "plus, on the diagonal, the sum of particles/core of the GSD file" in text
                assert len(frame.log["particles/core"]) == frame.particles.N
                continue
            mine = values["snapshot"] == number
            x, y, push, along = (values[k][mine] for k in ("x", "y", "normal", "tangential"))
            distance = np.hypot(x, y)
            on_j = (push * [x, y] + along * [-y, x]) / distance
            side = frame.configuration.box[:2] * frame.log["unit_of_length"][0]
            found = np.einsum("ac,bc->ab", on_j, [x, y]) / side.prod()
            if hard:
                assert "half its trace is scaled_pressure" in text
                pressure = frame.log["scaled_pressure"][0]
                assert np.trace(found) / 2 == pytest.approx(pressure, rel=1e-6)
                continue
            assert "periodic_love_weber of the result" in text
            logged = [[frame.log[f"periodic_love_weber_{a}{b}"][0] for b in "xy"] for a in "xy"]
            assert found == pytest.approx(np.array(logged), rel=1e-6, abs=1e-6)


def test_walls_are_in_the_frame_of_the_positions(study):
    """In the file itself vertices are as far from a plate as the contacts with it say."""
    job = make_job("soft particle: ring with friction", 5)
    gsd_file, _ = paths(study.snapshots, job.id)
    kept = read_snapshots(study.snapshots, job.id)
    with gsd.hoomd.open(gsd_file) as file:
        for frame, snapshot in zip(file, kept, strict=True):
            for w, wall in enumerate(frame.log["walls"]):
                touching = snapshot.j == -1 - w
                gap = frame.particles.position[snapshot.i[touching], :2] @ wall[:2] - wall[2]
                gap *= frame.log["unit_of_length"][0]
                away = np.hypot(*snapshot.separation[touching].T)
                assert gap == pytest.approx(away, abs=1e-6 * snapshot.width)
        assert touching.sum() > 0


@pytest.mark.parametrize(
    ("given", "names"),
    [
        (BOX(record={"rows": 10, "snapshots": [0]}), {"strain", "stress_yy", "stress_xx"}),
        (TISSUE(), {"strain", "stress_yy"}),
        (SUSPENSION(), {"strain", "stress_xy", "stress_yy", "shear_stress", "pressure"}),
        (make_job("hard discs: steady", 5).point, {"strain", "stress_xy", "scaled_pressure"}),
        (make_job("microgel: loose, plates", 5).point, {"strain", "shear_stress", "pressure"}),
    ],
    ids=["box", "tissue", "suspension", "hard discs", "microgel"],
)
def test_strain_and_stress_of_every_scene_are_in_the_log(given, names, tmp_path):
    model = models.model(given.kind)
    simulation = model.start(given, Streams(3, 0))
    while not simulation.snapshots:
        simulation.advance(1)
    columns = simulation.columns()
    columns |= model.derive(columns)
    kept = simulation.snapshots[:1]
    write_snapshots(tmp_path / "snapshots", "some", kept, columns, model.SNAPSHOT_UNITS)
    row = simulation.snapshots[0].row
    with gsd.hoomd.open(paths(tmp_path / "snapshots", "some")[0]) as file:
        for name in names:
            assert file[0].log[name] == [columns[name][row]]


def test_snapshots_of_another_job_are_told(study, tmp_path):
    """Both files copied over those of a job are whole, but not its own."""
    mine, other = (make_job(name, 5).id for name in NAMES if name.endswith(("links", "triangles")))
    results = Results(tmp_path)
    shutil.copytree(study.folder, tmp_path, dirs_exist_ok=True)
    assert results.damaged() == {}
    for source, path in zip(
        paths(results.snapshots, other), paths(results.snapshots, mine), strict=True
    ):
        shutil.copyfile(source, path)
    assert list(results.damaged()) == [mine]
    with pytest.raises(TableError, match=f"snapshots of another job, {other}"):
        read_kept(results.job_file(mine))


@pytest.mark.parametrize("wanted", [1, [0.0]])
def test_a_run_that_jams_keeps_its_last_state(wanted):
    simulation = models.model("hard_disc").start(
        jamming(wanted),
        Streams(1, 0),
    )
    finish(simulation)
    assert simulation.status == "jammed"
    rows = [snapshot.row for snapshot in simulation.snapshots]
    assert rows[-1] == simulation.rows - 1
    assert len(set(rows)) == len(rows) > 1
    columns = simulation.columns()
    found = np.trace(stress(simulation.snapshots[-1])) / 2
    assert found == pytest.approx(columns["scaled_pressure"][-1], rel=1e-12)
    plain = models.model("hard_disc").start(jamming(None), Streams(1, 0))
    finish(plain)
    assert len(plain.snapshots) == 0


def jamming(snapshots):
    """A compression that ends before its time."""
    data = HARD | {
        "shear": {"kind": "compression", "compression": 0.2},
        "record": {"snapshots": snapshots},
    }
    return models.model("hard_disc").POINT.model_validate(data).resolved()


def table_shear(table, row):
    return table.columns["periodic_love_weber_xy"][row] - table.columns["periodic_torque_yx"][row]


def test_particles_that_are_linked_to_none_have_no_body(study):
    job = make_job("hard discs: triangles", 5)
    (first, *_) = read_snapshots(study.snapshots, job.id)
    assert np.bincount(clusters(first)).tolist() == [3] * 8
    loose = first._replace(kind=np.full(len(first.kind), 1, np.int8))
    assert (clusters(loose) == -1).all()


def test_kinds_are_words_in_the_table(study):
    job = make_job("microgel: friction and links", 5)
    kinds = read_table(paths(study.snapshots, job.id)[1]).columns["kind"]
    assert set(kinds) == set(CONTACT_KINDS) - {"cohesive", "bar"}  # of soft shells only


def test_a_job_in_pieces_keeps_the_same_snapshots(tmp_path, monkeypatch):
    """Killed between blocks it goes on from its checkpoint, with what it had kept."""
    job = make_job("microgel: friction and links", 5)
    files = []
    for name, stop in (("whole", lambda: False), ("pieces", lambda: True)):
        jobs = tmp_path / name / "jobs"
        jobs.mkdir(parents=True)
        monkeypatch.setattr(runner, "FIRST_BLOCK", 150)
        if stop():
            for _ in range(3):
                with pytest.raises(Stopped):
                    run_job(job, jobs, stop=stop)
            assert not (tmp_path / name / "snapshots").exists()
        path = run_job(job, jobs)
        files.append([p.read_bytes() for p in paths(tmp_path / name / "snapshots", job.id)])
        files[-1].append(path)
    assert files[0][:2] == files[1][:2]
    assert differences(read_table(files[0][2]), read_table(files[1][2])) == []


def test_a_repeated_job_is_compared_in_its_snapshots_too(tmp_path, monkeypatch):
    results = Results(tmp_path / "study")
    results.jobs.mkdir(parents=True)
    job = make_job("hard discs: steady", 5)
    path = run_job(job, results.jobs)
    monkeypatch.chdir(results.jobs)  # a name alone is a result file too
    assert repeat(Path(path.name), tmp_path, lambda: None)[1] == []
    kept, columns = read_snapshots(results.snapshots, job.id), read_table(path).columns
    force, moved = kept[-1].normal * (1 + 1e-15), kept[1].position + 1e-3
    kept[1], kept[-1] = kept[1]._replace(position=moved), kept[-1]._replace(normal=force)
    units = models.model("hard_disc").SNAPSHOT_UNITS
    write_snapshots(results.snapshots, job.id, kept, columns, units)
    assert repeat(path, tmp_path, lambda: None)[1] == [
        "snapshot 1: position",
        f"snapshot {len(kept) - 1}: normal",
    ]
    paths(results.snapshots, job.id)[0].unlink()
    with pytest.raises(TableError, match=rf"{job.id}\.gsd: cannot be read"):
        repeat(path, tmp_path, lambda: None)


def test_the_disk_that_snapshots_take_is_counted(tmp_path):
    """By the status, and by the plan of the jobs that are missing."""
    (tmp_path / "study.yaml").write_text(
        "packing: {discs: 24, packing_fraction: 0.7}\nmodel: {kind: hard_disc}\n"
        "shear: {kind: steady, strain: 0.1}\nrecord: {snapshots: 20}\nreplicates: 2\nseed: 1\n"
    )
    study, results = load_study(tmp_path / "study.yaml"), Results(tmp_path / "study")
    results.jobs.mkdir(parents=True)
    run_job(study.jobs()[0], results.jobs)
    files = [f for f in results.folder.glob("*/*") if f.parent.name in {"jobs", "snapshots"}]
    assert len(files) == 3
    size = sum(file.stat().st_size for file in files)
    assert size > 1.5 * results.job_file(study.jobs()[0].id).stat().st_size
    assert read_status(results)["disk_bytes"] == size
    assert make_plan(study, results).to_json()["estimate"]["disk_bytes"] == size


def test_damage_is_found_and_the_job_can_run_again(tmp_path):
    results = Results(tmp_path)
    results.jobs.mkdir()
    job = make_job("hard discs: steady", 5)
    run_job(job, results.jobs)
    gsd_file, table = paths(results.snapshots, job.id)
    whole = gsd_file.read_bytes(), hashlib.sha256(table.read_bytes()).digest()
    assert results.damaged() == {}
    for path, harm in (
        (gsd_file, lambda: gsd_file.write_bytes(whole[0][:500] + b"!" + whole[0][501:])),
        (table, lambda: table.write_bytes(table.read_bytes()[:-9])),
        (gsd_file, lambda: gsd_file.unlink()),
    ):
        harm()
        assert str(path) in damage(results.snapshots, job.id)
        assert list(results.damaged()) == [job.id]
        with pytest.raises(TableError, match=path.name):
            read_snapshots(results.snapshots, job.id)
        with pytest.raises(TableError, match=f"`shear-sim verify {tmp_path} --remove` sets it"):
            read_kept(results.job_file(job.id))
        results.set_aside(job.id)
        run_job(job, results.jobs)
        assert results.damaged() == {}
        assert (gsd_file.read_bytes(), hashlib.sha256(table.read_bytes()).digest()) == whole
