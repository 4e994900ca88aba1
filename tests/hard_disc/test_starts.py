"""What runs start from, and what drives them in stages or by a weight."""

import json
import math

import numpy as np
import pytest
from hard_discs import finished, overlap, point

from shear_sim.models import hard_disc
from shear_sim.models.hard_disc.packing import make_start, template, wall_places
from shear_sim.models.hard_disc.parameters import HardDisc, HardDiscPacking, HardDiscWalls
from shear_sim.models.interface import SimulationError
from shear_sim.streams import Streams
from shear_sim.study import StudyError, read_study


@pytest.mark.parametrize(
    ("body", "bonds"), [("triangle", 48), ("chain", 32)], ids=["triangle", "chain"]
)
def test_bodies_touch_within_and_not_one_another(body, bonds):
    """The packing fraction is as asked for, bonds are closed and nothing overlaps."""
    start = make_start(
        HardDiscPacking(discs=48, packing_fraction=0.6, body=body), HardDisc(), Streams(2, 0)
    )
    area = math.pi * (start.radius**2).sum()
    assert area / (start.width * start.height) == pytest.approx(0.6, rel=1e-12)
    i, j = start.bonds.T
    assert len(i) == bonds
    dx, dy = start.x[j] - start.x[i], start.y[j] - start.y[i]
    dy -= start.height * np.rint(dy / start.height)
    dx -= start.width * np.rint(dx / start.width)
    assert np.hypot(dx, dy) == pytest.approx(start.radius[i] + start.radius[j], abs=1e-12)
    assert (start.radius[:24].min(), start.radius[24:].max()) == pytest.approx(
        (0.7, 0.5), rel=0.0301
    )


def test_the_template_of_a_triangle_has_its_sides():
    radius = np.array([0.5, 0.6, 0.75])
    place, bonds = template(radius, "triangle")
    for a, b in bonds:
        assert np.hypot(*(place[a] - place[b])) == pytest.approx(radius[a] + radius[b], rel=1e-15)
    assert place.mean(axis=0) == pytest.approx([0, 0], abs=1e-15)


@pytest.mark.parametrize("body", ["triangle", "chain"])
def test_a_suspension_of_bodies_flows(body):
    run = finished(
        point(
            packing={"discs": 24, "packing_fraction": 0.55, "body": body},
            shear={"kind": "steady", "strain": 0.3},
            record={"rows": 100},
        )
    )
    checks = run.summary()["checks"]
    assert checks["largest_overlap"] < 1e-12
    assert checks["largest_gap_in_records"] < 1e-12
    assert checks["power_residual"] < 1e-10
    assert checks["least_force"] >= -1e-9  # of what may only push; bonds pull
    assert overlap(run.flow) < 1e-12


def test_a_floor_bears_the_weight_of_what_lies_on_it():
    """At rest Σ f_y on the floor = Σ (2a)², the weight in units of a mean small disc's."""
    run = finished(
        point(
            packing={
                "discs": 16, "packing_fraction": 0.3, "aspect_ratio": 2.0,
                "walls": {"kind": "floor"},
            },
            shear={"kind": "body_force", "duration": 40.0},
            record={"rows": 20},
        )
    )  # fmt: skip
    f = run.flow
    assert np.abs(f.set.velocities(f.instant())).max() < 1e-9
    c = f.contacts()
    up = np.where(f.mobility[c.i] == 0, c.phi * c.ry, 0.0)
    up -= np.where(f.mobility[c.j] == 0, c.phi * c.ry, 0.0)
    assert up.sum() == pytest.approx(((2 * f.radius[f.mobility > 0]) ** 2).sum(), rel=1e-9)
    assert run.summary()["checks"]["largest_overlap"] < 1e-12
    assert run.summary()["checks"]["power_residual"] < 1e-10  # although nothing moves any more


def test_down_a_plane_and_through_a_hopper():
    """A lone disc falls at ξF: n = 1 makes ξ = 1/2a, the weight is (2a)². A hopper slows it."""
    alone = point(
        packing={"discs": 2, "packing_fraction": 0.02},
        model={"mobility_exponent": 1.0},
        shear={"kind": "body_force", "inclination": 30.0, "duration": 2.0},
    )
    run = finished(alone)
    speed = (2 * run.flow.radius).mean()
    columns = run.columns()
    assert columns["mean_velocity_x"] == pytest.approx(0.5 * speed, rel=1e-12)
    assert columns["mean_velocity_y"] == pytest.approx(-math.sqrt(0.75) * speed, rel=1e-12)
    hopper = point(
        packing={
            "discs": 40, "packing_fraction": 0.3, "aspect_ratio": 2.0,
            "walls": {"kind": "hopper", "orifice": 3.0},
        },
        shear={"kind": "body_force", "duration": 10.0},
    )  # fmt: skip
    run = finished(hopper)
    walls = run.flow.mobility == 0
    before = make_start(hopper.packing, hopper.model, Streams(3, 0))
    assert np.array_equal(run.flow.y[walls] % run.flow.height, before.y[walls] % before.height)
    free = ((2 * run.flow.radius[~walls]) ** 2).mean()
    assert -free < run.summary()["measured"]["mean_velocity_y"] < -0.1 * free
    assert run.summary()["checks"]["largest_overlap"] < 1e-12
    assert overlap_of_mobile(run.flow) < 1e-12


def overlap_of_mobile(f):
    return -min(f.gap.min(), 0.0) / f.unit


def test_the_orifice_is_as_wide_as_asked_for():
    x, y = wall_places(HardDiscWalls(kind="hopper", orifice=3.0, angle=30.0), 12.0, 20.0)
    lowest = np.sort(x[y < y.min() + 1e-9])
    assert np.diff(lowest) - 1 == pytest.approx(3.0)
    step = np.hypot(np.diff(x), np.diff(y))[: len(x) // 2]
    assert step.max() <= 1 + 1e-12  # nothing falls through the rows
    with pytest.raises(SimulationError, match=r"packing.walls.orifice = 3 does not fit"):
        wall_places(HardDiscWalls(kind="hopper", orifice=3.0), 3.5, 20.0)


def test_stages_stop_restart_and_reverse():
    """A stop changes nothing but the time, forces are back after it, and reversal is at once."""
    steady = finished(point(shear={"kind": "steady", "strain": 0.6}, record={"rows": 60}))
    stages = [{"shear": 1, "length": 0.4}, {"length": 0.1}, {"shear": 1, "length": 0.2}]
    run = finished(
        point(
            shear={"kind": "stages", "stages": [*stages, {"shear": -1, "length": 0.1}]},
            record={"rows": 80},
        )
    )
    columns, straight = run.columns(), steady.columns()
    assert columns["strain"][[40, 50, 70, 80]] == pytest.approx([0.4, 0.4, 0.6, 0.5])
    assert (columns["scaled_pressure"][41:51] == 0).all()
    assert straight["scaled_pressure"][40] > 1
    assert columns["scaled_shear_stress"][:41] == pytest.approx(
        straight["scaled_shear_stress"][:41]
    )
    late = slice(52, 71)
    assert columns["scaled_shear_stress"][late] == pytest.approx(
        straight["scaled_shear_stress"][42:61], rel=1e-8
    )
    assert columns["strain_rate"][75] == -1
    assert columns["stress_xy"][75] > 0  # resists the reversed shear
    assert run.summary()["checks"]["power_residual"] < 1e-10


def test_bodies_stop_and_go_on():
    """The bonds of resting bodies are contacts without force, and no power is put in."""
    stages = [{"shear": 1, "length": 0.05}, {"length": 0.05}, {"shear": -1, "length": 0.05}]
    run = finished(
        point(
            packing={"discs": 24, "packing_fraction": 0.55, "body": "triangle"},
            shear={"kind": "stages", "stages": stages},
        )
    )
    columns, checks = run.columns(), run.summary()["checks"]
    assert (columns["scaled_pressure"][51:101] == 0).all()
    assert (columns["contact_number"][51:101] == 2.0).all()
    assert columns["nonaffine_speed"][120] > 0
    assert checks["power_residual"] < 1e-10


def test_compression_and_then_shear():
    stages = [
        {"compression": 1.0, "length": 0.01},
        {"shear": 1, "compression": -0.1, "length": 0.2},
    ]
    run = finished(point(shear={"kind": "stages", "stages": stages}))
    columns = run.columns()
    assert columns["packing_fraction"][10] == pytest.approx(0.8 * np.exp(0.02), rel=1e-12)
    assert columns["packing_fraction"][-1] == pytest.approx(0.8 * np.exp(0.02 - 0.04), rel=1e-12)


def study(tmp_path, state, shear=None, more=""):
    (tmp_path / "state.json").write_text(json.dumps(state))
    text = (
        "model: {kind: hard_disc}\npacking: {start: file, file: state.json}\n"
        f"shear: {json.dumps(shear or {'kind': 'steady', 'strain': 0.1})}\nrecord: {{rows: 100}}\n"
        f"{more}"
    )
    return read_study(text.encode(), tmp_path / "study.yaml").jobs()[0]


def test_a_run_goes_on_from_the_state_that_another_kept(tmp_path):
    """Strain 0.3 + 0.1 by way of a file: the same stress as in one run of 0.4."""
    shear = {"kind": "steady", "strain": 0.3}
    first = finished(point(shear=shear, record={"rows": 300, "state": True}))
    whole = finished(point(shear=shear | {"strain": 0.4}, record={"rows": 400})).columns()
    job = study(tmp_path, first.summary()["state"])
    run = hard_disc.start(job.point, job.streams)
    run.advance(run.rows)
    columns = run.columns()
    for name in ("scaled_shear_stress", "contact_number", "packing_fraction"):
        assert columns[name] == pytest.approx(whole[name][300:], rel=1e-8), name


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": [1.0]}, "lists of one length"),
        ({"width": 1.0}, "smaller than four of its largest radii"),
        ({"mobility": [0.0] * 32}, "mobility is zero everywhere"),
        ({"radius": "big"}, "is no state of hard discs"),
        ({"bonds": [[0, 99]]}, "bonds name discs beyond the 32"),
        ({"bonds": [[0, 1], [1, 0]]}, "bonds name a pair of discs twice"),
        ({"bonds": [[3, 3]]}, "a bond joins a disc with itself"),
        ({"width": math.nan}, "all numbers must be finite"),
        ({"offset": math.inf}, "all numbers must be finite"),
        ({"mobility": [math.inf] * 32}, "all numbers must be finite"),
    ],
)
def test_bad_start_files_say_what_is_wrong(change, message, tmp_path):
    state = finished(
        point(shear={"kind": "steady", "strain": 0.01}, record={"rows": 20, "state": True})
    ).summary()["state"]
    with pytest.raises(StudyError, match=message):
        study(tmp_path, state | change)


def test_a_start_file_in_metres_is_refused(tmp_path):
    """Tolerances are those of lengths near 1: a state in micrometres was followed for ever."""
    state = {"width": 8e-6, "height": 8e-6, "x": [1e-6, 4e-6], "y": [1e-6, 4e-6]}
    with pytest.raises(StudyError, match="mean diameter is 1e-06, but lengths are in mean"):
        study(tmp_path, state | {"radius": [5e-7] * 2})


def test_bonds_of_a_start_file_need_events(tmp_path):
    """Time steps only push: triangles came apart by 0.4 diameters in a strain of 0.3."""
    state = {"width": 8, "height": 8, "x": [1, 2, 5], "y": [1, 1, 5], "radius": [0.5] * 3}
    steps = "integrator: {scheme: time_steps, strain_step: 0.001}\n"
    study(tmp_path, state, more=steps)
    study(tmp_path, state | {"bonds": [[0, 1]]})
    with pytest.raises(StudyError, match="it has 1 bonds, which time_steps would open"):
        study(tmp_path, state | {"bonds": [[0, 1]]}, more=steps)


@pytest.mark.parametrize("upward", [0.0, 1.0, -7.3])
def test_an_overlapping_start_file_is_refused(tmp_path, upward):
    """Wherever the two are: across the edges of the sheared cell, too."""
    apart, y = 0.8, 5.9
    state = {
        "width": 6.0, "height": 6.0, "offset": 2.5, "radius": [0.5] * 3, "y": [y, y + apart - 6, 3],
        "x": [1.0, 1.0 - 2.5, 3.0],
    }  # fmt: skip
    state["y"] = [one + upward for one in state["y"]]
    with pytest.raises(StudyError, match=r"discs \d and \d overlap by 0.2 mean diameters: move"):
        study(tmp_path, state)
    study(tmp_path, state | {"radius": [0.4] * 3})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("packing: {body: triangle}", "64 discs are no whole bodies of 3"),
        ("packing: {discs: 60, beads: 4}", "only a chain has a number of beads"),
        ("packing: {walls: {kind: floor}}", "walls stand still"),
        ("packing: {walls: {kind: floor, orifice: 3}}", "only a hopper has one"),
        ("packing: {start: file}", "start: file needs the name of a file"),
        (
            (
                "packing: {discs: 24, packing_fraction: 0.5, body: triangle}\n"
                "integrator: {scheme: time_steps, strain_step: 0.001}"
            ),
            "time_steps are for single discs",
        ),
        ("shear: {kind: stages, stages: [{shear: 2, length: 1}]}", "must be at most 1"),
    ],
)
def test_impossible_starts(text, message, tmp_path):
    content = f"model: {{kind: hard_disc}}\n{text}"
    with pytest.raises(StudyError, match=message):
        read_study(content.encode(), tmp_path / "study.yaml")


CRYSTAL = {"discs": 64, "size_ratio": 1.0, "polydispersity": 0.0, "attempts": 200}


@pytest.mark.parametrize(
    ("packing_fraction", "pressure", "strain", "seed"),
    [
        (0.83, None, 0.3, (6, 0)),
        (0.79, 30.0, 0.3, (6, 0)),
        (0.79, 100.0, 0.08, (1, 0)),  # a contact that depends on all others, and its border too
        (0.79, 100.0, 0.165, (1, 3)),  # eight rows, each closed around the cell
    ],
)
def test_crystal_patches_flow(packing_fraction, pressure, strain, seed):
    """Equal discs crystallise: contacts depend on each other, and velocities are unique still."""
    given = point(
        packing=CRYSTAL | {"packing_fraction": packing_fraction},
        shear={"kind": "steady", "strain": strain, "scaled_pressure": pressure},
        record={"rows": 50},
    )
    run = hard_disc.start(given, Streams(*seed))
    run.advance(run.rows)
    summary = run.summary()
    assert summary["status"] == "flowing"
    assert summary["flags"]["forces_nonunique"]
    assert summary["checks"]["largest_overlap"] < 1e-12
    assert summary["checks"]["power_residual"] < 1e-10
    assert summary["checks"]["least_force"] >= -1e-9


def test_crystals_jam_and_who_bears_no_force_is_a_rattler():
    """Replicate 3 of seed 1: a contact without force whose discs do not part came back for ever.

    Discs of a straight row bear force on two contacts only, and are no rattlers.
    """
    given = point(
        packing=CRYSTAL | {"packing_fraction": 0.78},
        shear={"kind": "compression", "compression": 0.12},
    )
    run = hard_disc.start(given, Streams(1, 3))
    run.advance(run.rows)
    assert run.status == "jammed"
    found = run.certificate
    assert found["discs"] + len(found["rattlers"]) == 64
    assert found["contacts"] >= 1.9 * found["discs"]
    assert run.flow.counts.largest_overlap < 1e-12


JAM = {"compression": 1.0, "length": 0.1}


def test_stages_go_on_after_a_jam():
    """Jammed discs rest; decompressed, or sheared back from a jam by shear, they move again."""
    stages = [JAM, JAM, {"compression": -1.0, "length": 0.02}, {"shear": 1, "length": 0.02}]
    run = finished(
        point(packing={"packing_fraction": 0.78}, shear={"kind": "stages", "stages": stages})
    )
    assert run.status == "flowing"
    first, again = run.summary()["jams"]
    assert 0 < first["path"] < 0.1
    assert again["path"] == 0.1
    assert first["isostatic"]
    columns = run.columns()
    jammed = first["path"]
    assert columns["compression"][[99, 150, 200]] == pytest.approx([jammed] * 3, abs=1e-12)
    assert (columns["contact_number"][110:200] == 0).all()  # nothing drives them
    assert columns["compression"][220] == pytest.approx(jammed - 0.02, abs=1e-12)
    assert columns["strain"][[200, 240]] == pytest.approx([0, 0.02], abs=1e-12)


def test_shear_goes_back_from_a_jam():
    """The strain stands still from the jam to the end of its stage."""
    stages = [{"shear": 1, "length": 1.0}, {"shear": -1, "length": 0.05}]
    given = point(
        packing={"packing_fraction": 0.83, "attempts": 200},
        shear={"kind": "stages", "stages": stages},
    )
    run = finished(given)
    (jam,) = run.summary()["jams"]
    assert jam["load"] < 0
    columns = run.columns()
    late = columns["time"] > jam["path"]
    assert columns["strain"][late][0] == pytest.approx(jam["path"], abs=1e-12)
    assert columns["strain"][[1000, -1]] == pytest.approx([jam["path"], jam["path"] - 0.05])
    assert columns["strain_rate"][[990, 1040]].tolist() == [0, -1]
    assert columns["stress_xy"][1001] > 0
    assert run.status == "flowing"


def test_a_jammed_start_says_so_at_once(tmp_path):
    compression = {"kind": "compression", "compression": 0.2}
    first = finished(
        point(packing={"packing_fraction": 0.78}, shear=compression, record={"state": True})
    )
    job = study(tmp_path, first.summary()["state"], shear=compression)
    run = hard_disc.start(job.point, job.streams)
    run.advance(run.rows)
    assert (run.status, run.rows, run.done) == ("jammed", 0, 0)
    assert run.certificate["path"] == 0
    assert run.certificate["contacts"] == first.certificate["contacts"]
