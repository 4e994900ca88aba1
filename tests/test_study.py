"""Studies: which jobs a file asks for, what names them, and every way to get it wrong."""

import contextlib
import hashlib
import json
import pickle
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from shear_sim import design, models
from shear_sim.models.microgel.parameters import MicrogelPoint
from shear_sim.packing import content_digest
from shear_sim.study import Job, Study, StudyError, load_study, read_study

CONFIGS = Path(__file__).parents[1] / "configs"
LAW = "def contact_force(distance, contact_distance, stiffness, repulsion):\n    return 0.0\n"


def study(text: str, name: str = "study.yaml") -> Study:
    return read_study(text.encode(), Path(name))


def ids(text: str) -> set[str]:
    return {job.id for job in study(text).jobs()}


def report(text: str) -> str:
    with pytest.raises(StudyError) as caught:
        study(text)
    return str(caught.value)


# --- Jobs ----------------------------------------------------------------------------------------


def test_a_study_without_a_sweep_is_its_base():
    (job,) = study("model: {friction: 0.1}\nseed: 7\n").jobs()
    assert job.point.model.friction == 0.1
    assert (job.seed, job.replicate, job.labels) == (7, 0, (("base", "base"),))


def test_scenes_grid_and_replicates_multiply():
    jobs = study("""
scenes: {crosslinked: {}, bulk: {model.links.cut: bulk}}
sweep:
  name: amplitude
  grid: {shear.strain_amplitude: [0.01, 0.1, 1], model.friction: [0, 1]}
replicates: 4
""").jobs()
    assert len(jobs) == len({job.id for job in jobs}) == 2 * 3 * 2 * 4
    assert [job.id for job in jobs] == sorted(job.id for job in jobs)
    assert {job.labels for job in jobs} == {
        (("amplitude", "crosslinked"),),
        (("amplitude", "bulk"),),
    }
    assert {job.point.model.links.cut for job in jobs} == {"cells", "bulk"}


def test_zip_pairs_and_list_names_points():
    paired = study("""
sweep: {zip: {packing.packing_fraction: [1, 1.2, 1.5], cell.width: [1e-4, 2e-4, 3e-4]}}
""")
    pairs = {(p.point.packing.packing_fraction, p.point.cell.width) for p in paired.points}
    assert pairs == {(1.0, 1e-4), (1.2, 2e-4), (1.5, 3e-4)}
    listed = study("""
sweep: {list: [{model.friction: 1, packing.discs: 60}, {model: {links: {cut: none}}}]}
""")
    points = {
        (p.point.model.friction, p.point.packing.discs, p.point.model.links.cut)
        for p in listed.points
    }
    assert points == {(1.0, 60, "cells"), (0.01, 150, "none")}


def test_spaced_values_end_where_they_say():
    points = study("sweep: {grid: {model.friction: {logspace: [1e-3, 1, 4]}}}").points
    assert sorted(p.point.model.friction for p in points) == [0.001, 0.01, 0.1, 1.0]
    # NumPy's linspace gives 0.8300000000000001 here: another job than 0.83.
    points = study("sweep: {grid: {packing.packing_fraction: {linspace: [0.8, 0.9, 11]}}}").points
    assert 0.83 in {p.point.packing.packing_fraction for p in points}
    points = study("sweep: {grid: {packing.discs: {linspace: [50, 150, 3]}}}").points
    assert sorted(p.point.packing.discs for p in points) == [50, 100, 150]


def test_jobs_that_two_blocks_want_run_once_and_know_both():
    points = study("""
sweep:
  - {name: amplitude, grid: {shear.strain_amplitude: [0.1, 0.2]}}
  - {name: friction, grid: {model.friction: [0.01, 1]}}
""").points
    assert len(points) == 3
    assert sorted(len(p.labels) for p in points) == [1, 1, 2]
    assert (("amplitude", "base"), ("friction", "base")) in {p.labels for p in points}


def test_a_section_changes_the_keys_it_names_and_starts_afresh_with_a_kind():
    base = "model: {contact_law: {kind: plateau, slope: 0.5}, links: {cuts: 3}}\n"
    (point,) = study(base + "sweep: {set: {model.contact_law: {begin: 0.2}}}").points
    assert (point.point.model.contact_law.begin, point.point.model.contact_law.slope) == (0.2, 0.5)
    (point,) = study(base + "sweep: {set: {model.contact_law: {kind: plateau}}}").points
    assert point.point.model.contact_law.slope == 0.1
    (point,) = study(base + "sweep: {set: {model: {links: {remove_fraction: 0.5}}}}").points
    assert point.point.model.links.cuts == 3
    two = "scenes: {soft: {model.contact_law: {kind: plateau}}}\n"
    points = study(two + "sweep: {grid: {model.contact_law.slope: [0.1, 0.2]}}").points
    assert {p.point.model.contact_law.slope for p in points} == {0.1, 0.2}


def test_varied_names_what_differs_between_points():
    assert study("model: {friction: 1}").varied == ()
    assert study("""
scenes: {crosslinked: {}, bulk: {model.links.cut: bulk}}
sweep: {grid: {shear.strain_amplitude: [0.1, 1], model.friction: [0.01]}}
""").varied == ("model.links.cut", "shear.strain_amplitude")
    kinds = study("sweep: {grid: {model.contact_law: [{kind: plateau}, {kind: linear}]}}")
    assert set(kinds.varied) >= {"model.contact_law.kind", "model.contact_law.slope"}


def test_groups_hold_the_replicates_of_each_point():
    it = study("sweep: {grid: {model.friction: [0, 1]}}\nreplicates: 3\n")
    groups = it.groups()
    assert [p.id for p in it.points] == list(groups)
    for key, jobs in groups.items():
        assert [job.replicate for job in jobs] == [0, 1, 2]
        assert {job.point_id for job in jobs} == {key}


# --- Identity ------------------------------------------------------------------------------------


def test_two_ids_are_pinned():
    """Changing these ids orphans every result that exists.

    They change only with the physics version, a parameter added or a default changed: then the
    numbers of a job, or what is known of them, changed too.
    """
    default = Job.create(MicrogelPoint(), seed=20240611, replicate=0)
    assert default.id == "92d7b22b006483be"
    (job,) = study("""
packing: {discs: 60}
scenes: {loose: {model.links.cut: none}}
sweep: {grid: {shear.strain_amplitude: [0.1]}, set: {model.friction: 1}}
seed: 1
""").jobs()
    assert job.id == "6577ea34f21461a9"


def test_the_id_is_the_hash_of_canonical_json():
    job = Job.create(MicrogelPoint(), seed=3, replicate=2)
    hashed = {
        "kind": "microgel",
        "physics_version": job.to_json()["physics_version"],
        "point": job.parameters,
        "seed": 3,
        "replicate": 2,
    }
    text = json.dumps(hashed, sort_keys=True, separators=(",", ":"))
    assert job.id == hashlib.sha256(text.encode()).hexdigest()[:16]


def test_equal_numbers_are_equal_jobs():
    assert ids("packing: {packing_fraction: 1}") == ids("packing: {packing_fraction: 1.0}")
    assert ids("packing: {packing_fraction: 0.83}") == ids(
        "packing: {packing_fraction: 0.8300000000000001}"
    )
    assert ids("model: {friction: 0}") == ids("model: {friction: -0.0}")
    point = MicrogelPoint.model_validate({"packing": {"packing_fraction": 0.1 + 0.2}})
    same = MicrogelPoint.model_validate({"packing": {"packing_fraction": 0.3}})
    assert Job.create(point, 0, 0) == Job.create(same, 0, 0)


def test_defaults_are_hashed_as_if_written():
    written = ids("model: {friction: 0.01}\ncell: {boundary: lees_edwards}\nreplicates: 1")
    assert written == ids("seed: 0")


def test_threads_are_no_part_of_a_job():
    """They change no number, so results made with any number of cores are the same results."""
    large = "packing: {discs: 4000}\n"
    assert ids(f"{large}threads: 3") == ids(large)
    assert {job.threads for job in study(f"{large}threads: 3\nreplicates: 2").jobs()} == {3}
    assert {job.threads for job in study(f"{large}replicates: 2").jobs()} == {1}


HARD = "model: {kind: hard_disc}\nshear: {kind: steady}\n"
RING = "model: {kind: soft_particle}\n"


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        (HARD, "hard_disc: one"),
        ("packing: {discs: 2047}\n", "microgel: one for each 1,024 discs, and a single one with"),
        ("packing: {discs: 9000}\nrecord: {energy: true}\n", "a single one with record.energy"),
        (RING, "soft_particle: one for each 2,000 vertices"),
    ],
)
def test_threads_that_no_job_could_use_are_refused(text, rule):
    told = report(f"threads: 2\n{text}")
    assert "study.yaml:1: threads = 2: every job of this study can use 1 core only" in told
    assert f"({rule}" in told or f", and {rule}" in told
    assert "leave threads out" in told


BOXES = "packing: {particles: 9}\nshear: {kind: compaction}\n"


def test_replicates_of_what_is_not_random_are_refused():
    """A single ring would be pressed in the same way again and again; boxes are of other rings."""
    words = "nothing is random at {} points, whose replicates would be the same"
    told = report(f"replicates: 3\n{RING}")
    assert f"study.yaml:1: replicates = 3: {words.format('1 of 1')}" in told
    both = "scenes: {ring: {}, box: {packing.particles: 9, shear: {kind: compaction}}}\n"
    assert words.format("1 of 2") in report(f"{RING}{both}replicates: 2\n")
    assert len(study(f"{RING}replicates: 1\n").jobs()) == 1
    assert len(study(f"{RING}{BOXES}replicates: 3\n").jobs()) == 3


def test_threads_are_the_most_that_a_job_uses(tmp_path):
    """A job that has work for fewer has fewer, so that nobody pays for cores that are idle."""
    rows = [f"{4e-6 * (n % 50):g},{4e-6 * (n // 50):g},2e-6" for n in range(2100)]
    (tmp_path / "start.csv").write_text("\n".join(["x,y,radius", *rows]))
    text = """
threads: 8
scenes:
  small: {packing.discs: 2047}
  medium: {packing.discs: 3072}
  balanced: {packing.discs: 16384, record.energy: true}
  large: {packing.discs: 16384}
  from_a_file: {packing: {start: file, file: start.csv}}
  rigid: {model: {kind: hard_disc}, packing: {discs: 16384}, shear: {kind: steady}}
  ring: {model: {kind: soft_particle}, shear: {kind: diametral_compression}}
  box: {model: {kind: soft_particle}, packing: {particles: 500, vertices: 24},
    shear: {kind: compaction}}
"""
    path = tmp_path / "study.yaml"
    path.write_text(text)
    found = {job.labels[0][1]: job.threads for job in load_study(path).jobs()}
    assert found == {
        "small": 1, "medium": 3, "balanced": 1, "large": 8, "from_a_file": 2, "rigid": 1,
        "ring": 1, "box": 4,
    }  # fmt: skip


@given(st.data())
def test_the_order_of_keys_cannot_matter(data):
    def shuffled(value: Any) -> Any:
        if isinstance(value, dict):
            names = data.draw(st.permutations(sorted(value)))
            return {name: shuffled(value[name]) for name in names}
        return value

    whole = {
        "packing": {"discs": 80, "packing_fraction": 1.2},
        "model": {"friction": 0.5, "young_modulus": 5000, "links": {"cuts": 4, "normal_factor": 2}},
        "scenes": {"a": {}, "b": {"model.links": {"cuts": 7, "remove_fraction": 0.1}}},
        "sweep": {
            "grid": {"shear.strain_amplitude": [0.1, 0.2], "record.every": [1, 2]},
            "set": {"shear.periods": 4},
        },
        "replicates": 2,
    }
    assert ids(json.dumps(shuffled(whole))) == ids(json.dumps(whole))


@pytest.mark.parametrize(
    ("small", "large"),
    [
        ("[0.1, 1]", "[0.03, 0.1, 0.3, 1]"),
        ("{linspace: [0.1, 0.3, 3]}", "{linspace: [0.1, 0.3, 5]}"),
    ],
)
def test_a_study_that_grows_keeps_its_jobs(small, large):
    base = "sweep: {grid: {shear.strain_amplitude: %s}}\nreplicates: %d\n"
    assert ids(base % (small, 2)) < ids(base % (large, 3))


def test_a_sobol_design_that_grows_keeps_its_points():
    base = """
sweep:
  sobol:
    points: %d
    ranges:
      model.friction: {from: 1e-3, to: 1, scale: log}
      model.links.cuts: {from: 2, to: 9, scale: integer}
      packing.packing_fraction: {from: 1, to: 2}
seed: 5
"""
    few, more = study(base % 6), study(base % 37)
    assert {p.id for p in few.points} < {p.id for p in more.points}
    assert len(more.points) == 37
    for point in (p.point for p in more.points):
        assert 1e-3 <= point.model.friction <= 1
        assert 2 <= point.model.links.cuts <= 9
        assert 1 <= point.packing.packing_fraction <= 2
    # A balanced design: half of 64 points in each half of each range, on its own scale.
    balanced = [p.point for p in study(base % 64).points]
    assert sum(point.model.friction < 10**-1.5 for point in balanced) == 32
    assert sum(point.packing.packing_fraction < 1.5 for point in balanced) == 32
    assert sum(point.model.links.cuts <= 5 for point in balanced) == 32
    reordered = """
sweep:
  - name: before
    sobol: {points: 4, ranges: {model.young_modulus: {from: 100, to: 9000}}}
  - name: mine
    sobol:
      ranges:
        packing.packing_fraction: {to: 2, from: 1}
        model.links.cuts: {from: 2, to: 9, scale: integer}
        model.friction: {from: 1e-3, to: 1, scale: log}
      points: 6
seed: 5
"""
    assert {p.id for p in few.points} < {p.id for p in study(reordered).points}


def test_the_id_knows_seed_replicate_record_and_every_parameter():
    job = Job.create(MicrogelPoint(), 0, 0)
    others = [
        Job.create(MicrogelPoint(), 1, 0),
        Job.create(MicrogelPoint(), 0, 1),
        Job.create(MicrogelPoint.model_validate({"record": {"every": 2}}), 0, 0),
        Job.create(MicrogelPoint.model_validate({"cell": {"boundary": "plates"}}), 0, 0),
        Job.create(MicrogelPoint.model_validate({"integrator": {"steps_per_period": 500}}), 0, 0),
    ]
    assert len({job.id, *(other.id for other in others)}) == 6


def test_the_physics_version_is_part_of_every_id(monkeypatch):
    before = Job.create(MicrogelPoint(), 0, 0)
    monkeypatch.setattr("shear_sim.models.microgel.PHYSICS_VERSION", 1_000_000)
    assert Job.create(MicrogelPoint(), 0, 0).id != before.id
    with pytest.raises(ValueError, match="this is version 1000000 and would give other numbers"):
        Job.from_json({**before.to_json(), "physics_version": 1})


def test_jobs_travel_as_pickle_and_json():
    for job in study("""
scenes: {a: {}, b: {model.contact_law: {kind: plateau}, record.columns: [time, strain]}}
replicates: 2
""").jobs():
        assert pickle.loads(pickle.dumps(job)) == job  # noqa: S301 - our own
        assert Job.from_json(json.loads(json.dumps(job.to_json()))) == job


def test_a_job_that_was_tampered_with_is_refused():
    data = Job.create(MicrogelPoint(), 0, 0).to_json()
    data["parameters"]["model"]["friction"] = 0.5
    with pytest.raises(ValueError, match=r"parameters of job .* were changed"):
        Job.from_json(data)


# --- Files beside the study ----------------------------------------------------------------------


def with_law(folder: Path, source: str | bytes = LAW, name: str = "law.py") -> Path:
    folder.mkdir(exist_ok=True)
    (folder / name).write_bytes(source.encode() if isinstance(source, str) else source)
    path = folder / "study.yaml"
    path.write_text(f"model: {{contact_law: {{kind: custom, file: {name}}}}}\n")
    return path


def test_a_users_law_is_hashed_by_its_text_not_its_path(tmp_path):
    one = load_study(with_law(tmp_path / "a")).jobs()[0]
    moved = load_study(with_law(tmp_path / "b", name="other.py")).jobs()[0]
    windows = load_study(with_law(tmp_path / "c", LAW.replace("\n", "\r\n"))).jobs()[0]
    edited = load_study(with_law(tmp_path / "d", LAW.replace("0.0", "1.0"))).jobs()[0]
    assert one.id == moved.id == windows.id != edited.id
    assert one.point.model.contact_law.source == LAW
    assert one.point.model.contact_law.file == tmp_path / "a" / "law.py"
    assert str(tmp_path) not in json.dumps(one.parameters)
    assert Job.from_json(one.to_json()) == one
    without_the_file = {k: v for k, v in one.to_json().items() if k != "files"}
    assert Job.from_json(without_the_file).id == one.id


def test_a_start_file_is_hashed_by_its_bytes(tmp_path):
    found = {}
    one = b"x,y,radius\n1e-4,3e-4,2e-5\n"
    for name, content in {"a": one, "b": one, "c": one.replace(b"1e-4", b"2e-4")}.items():
        folder = tmp_path / name
        (folder / "starts").mkdir(parents=True)
        (folder / "starts" / f"{name}.csv").write_bytes(content)
        path = folder / "study.yaml"
        path.write_text(f"packing: {{start: file, file: starts/{name}.csv}}\n")
        it = load_study(path)
        found[name] = it.jobs()[0]
        assert it.files == (Path("starts") / f"{name}.csv",)
    assert found["a"].id == found["b"].id != found["c"].id
    packing = found["a"].point.packing
    assert packing.file_digest == content_digest(Path("a.csv"), one)
    assert packing.file == tmp_path / "a" / "starts" / "a.csv"
    data = found["a"].to_json()
    assert Job.from_json(data) == found["a"]
    with pytest.raises(ValueError, match=r"starts from a file: name it in files\[packing\.file\]"):
        Job.from_json({**data, "files": {}})


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("def force(a, b, c, d): return 0\n", "must define `def contact_force"),
        ("def contact_force(a):\n", "line 1 is not Python"),
        (b"\xff", "cannot be read beside the study"),
    ],
)
def test_a_wrong_law_is_refused_where_the_study_names_it(tmp_path, source, message):
    with pytest.raises(StudyError, match=rf"study\.yaml:1: model\.contact_law\.file = .*{message}"):
        load_study(with_law(tmp_path, source))


def test_files_that_are_missing_or_elsewhere_are_refused(tmp_path):
    path = tmp_path / "study.yaml"
    for name, message in {
        "nowhere.py": "No such file",
        "../law.py": "relative to the study's folder",
        "/law.py": "relative to the study's folder",
        '"a\\0b"': "cannot be read",
    }.items():
        path.write_text(f"model:\n  contact_law: {{kind: custom, file: {name}}}\n")
        with pytest.raises(StudyError, match=f"study.yaml:2: .*{message}"):
            load_study(path)
    with pytest.raises(StudyError, match=r"cannot be read \(No such file"):
        load_study(tmp_path / "missing.yaml")
    with pytest.raises(StudyError, match=r"a folder: give the study file"):
        load_study(tmp_path)


def test_code_and_digests_cannot_be_written_into_a_study():
    assert "source is filled in when the study is read: write file: instead" in report(
        "model: {contact_law: {kind: custom, source: 'def contact_force(a, b, c, d): return 0'}}"
    )
    assert "file_digest is filled in" in report("packing: {start: file, file_digest: abc}")


# --- Errors --------------------------------------------------------------------------------------

GRID_OVER_SLOPE = "sweep: {grid: {model.contact_law.slope: [0.1]}}"
MILLION = """
sweep:
  grid: {model.friction: {linspace: [0, 1, 1000]}, cell.width: {linspace: [1, 2, 1000]}}
"""
WRONG = """\
packing: {packing_fraction: 84, dics: 60}
model:
  young_modulus: 8 kPa
  friction: on
  links: {cuts: 2.0, cut: cels}
  contact_law: {kind: plateau, begin: 0.9}
friction: 1
scenes:
  a: {}
  b: {model.links.remove_fraction: 50}
sweep:
  - name: amplitude
    grid:
      shear.strain_amplitude: [0.01, 20]
      shear.kind: [steady]
  - grid: {cell.width: 500}
replicates: 0
"""


def test_all_problems_come_at_once_with_line_key_value_and_remedy():
    text = report(WRONG.replace("width: 500", "width: [500]").replace("s: 0", "s: 1"))
    for line in (
        "1: packing.packing_fraction = 84: must be at most 2.5 (a fraction, not percent: 0.84?)",
        "1: packing.dics = 60: unknown key: did you mean discs?",
        "3: model.young_modulus = 8 kPa: must be a number (E [Pa]",
        "4: model.friction = on: must be a number",
        "5: model.links.cuts = 2.0: must be a whole number",
        "5: model.links.cut = cels: must be one of cells, lines, bulk, none, file",
        "6: model.contact_law.begin = 0.9: begin 0.9 is above end 0.8",
        "7: friction = 1: unknown key: did you mean model.friction?",
        "10: model.links.remove_fraction = 50: must be at most 1 (a fraction, not percent: 0.5?)",
        "14: shear.strain_amplitude = 0.01: is no key of this kind of shear: known are kind",
        "15: shear.kind = steady: relative_rate is required (strain rate",
        "16: cell.width = 500: must be at most 100 (in metres, not micrometres: 0.0005?)",
    ):
        assert f"  study.yaml:{line}" in text
    design = report(WRONG)
    assert "study.yaml:16: sweep[1].grid.cell.width = 500: must be a list of values" in design
    assert "study.yaml:17: replicates = 0: must be at least 1" in design
    assert "study.yaml:3: model.young_modulus" in design


EVERYWHERE = """\
record: {columns: [foo, bar]}
shear: {kind: steady, relative_rate: 0, strain: -1}
scenes: {a: 3, b: {model.contact_law: {kind: plateau}}}
replicates: x
sweep:
  - scenes: [b, c]
    grid: {model.friction: [0.1, -1, abc, null], model.contact_law.slope: [-2]}
    zip: {cell.width: [1, 500], packing.discs: [x]}
  - list: [3, {model.young_modulus: -1}]
    set: {model.links.cuts: 1.5}
  - sobol: {ranges: {model.friction: {from: 1, to: 0}}}
    grid: {record.every: 2, integrator.steps_per_period: [0.5]}
"""


def test_no_fault_hides_another():
    text = report(EVERYWHERE)
    for line in (
        "1: record.columns[0] = foo: foo is no stored column",
        "1: record.columns[1] = bar: bar is no stored column",
        "2: shear.relative_rate = 0: must not be 0",
        "2: shear.strain = -1: must be greater than 0",
        "3: scenes.a = 3: must be a section",
        "4: replicates = x: must be a whole number",
        "6: sweep[0].scenes[1] = c: is no scene",
        "7: model.friction = -1: must be at least 0",
        "7: model.friction = abc: must be a number",
        "7: model.friction = null: must be a number",
        "7: model.contact_law.slope = -2: must be",
        "8: sweep[0].zip = {cell.width: [1, 500], packing.discs: [x]}: needs lists of one length",
        "8: cell.width = 500: must be at most 100",
        "8: packing.discs = x: must be a whole number",
        "9: sweep[1].list[0] = 3: must be a section",
        "9: model.young_modulus = -1: must be greater than 0",
        "10: model.links.cuts = 1.5: must be a whole number",
        "11: sweep[2].sobol.points: points is required",
        "11: sweep[2].sobol.ranges.model.friction.to = 0: must be above from",
        "12: sweep[2].grid.record.every = 2: must be a list of values",
        "12: integrator.steps_per_period = 0.5: must be a whole number",
    ):
        assert f"  study.yaml:{line}" in text, line
    assert len(text.splitlines()) == 22


@pytest.mark.parametrize(
    "text",
    [
        # What is left out is not missed: the law, the scenes and the kinds are there, but wrong.
        "scenes: [a]\nsweep: {scenes: [a]}",
        "model: {contact_law: {slope: 0.2}}\nsweep: {grid: {model.contact_law.kind: plateau}}",
        "scenes: {a: 3}\nsweep: {scenes: [a], grid: {model.contact_law.slope: [0.2]}}",
        "seed: x\nmodel.contact_law: 3\nsweep: {grid: {model.contact_law: [{kind: plateau}]}}",
    ],
)
def test_a_fault_makes_no_others(text):
    number = 2 if "seed: x" in text else 1
    assert len(report(text).splitlines()) == 1 + number


def test_a_fault_of_many_points_is_reported_once():
    text = report("""
model: {friction: -1}
sweep: {grid: {shear.strain_amplitude: {linspace: [0.1, 1, 50]}, packing.discs: [3, 80]}}
""")
    assert text.count("model.friction") == 1
    assert text.count("four large radii") == 1
    assert text.splitlines()[0] == "study.yaml: 2 problems"


def test_a_narrow_cell_is_refused_with_numbers_and_what_to_change():
    text = report("packing: {discs: 4}\n")
    assert (
        "study.yaml:1: packing.discs = 4: the shorter side of the cell (its width, 0.0005 m)"
        in text
    )
    assert "packing.discs at least 11, or packing.packing_fraction at most" in text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sweep: {scenes: [a]}", "sweep.scenes[0] = a: is no scene: must be one of base"),
        (
            "scenes: {bulk: {}}\nsweep: [{scenes: [bulk, bluk]}]",
            "study.yaml:2: sweep[0].scenes[1] = bluk: is no scene: must be one of bulk; did you",
        ),
        ("scenes: {a: {}}\nsweep: {scenes: [a, a]}", "sweep.scenes[1] = a: is listed twice"),
        ("sweep: [{name: a}, {name: a}]", "names two blocks"),
        ("sweep: {name: a/b}", "names are letters, digits"),
        ("scenes: {a b: {}}", "scenes.a b = {}: names are letters"),
        ("sweep: {grid: {model.friction: []}}", "must be a list of values"),
        ("sweep: {grid: {model.friction: 1}}", "must be a list of values"),
        (
            "sweep: {grid: {model.friction: {linspace: [1, 2]}}}",
            "linspace takes [first, last, number]",
        ),
        ("sweep: {grid: {model.friction: {linspace: [1, 2, 1]}}}", "at least 2"),
        ("sweep: {grid: {model.friction: {logspace: [-3, 0, 4]}}}", "not their exponents"),
        (
            "sweep: {grid: {model.friction: {linspace: [true, 2, 3]}}}",
            "linspace takes [first, last, number]: two numbers",
        ),
        (
            "sweep: {grid: {packing.discs: {linspace: [60, 101, 3]}}}",
            "1 problem\n  study.yaml:1: packing.discs = 80.5: must be a whole number",
        ),
        ("sweep: hello", "sweep = hello: must be a section, `{grid: ...}`, or a list of sections"),
        ("sweep:", "sweep = null: must be a section"),
        ("replicates: 2.0", "replicates = 2.0: must be a whole number"),
        ("model: {friction: '0.1'}", 'model.friction = "0.1": must be a number'),
        ("model: {friction: 'null'}", 'model.friction = "null": must be a number'),
        ("seed: ''", 'seed = "": must be a whole number'),
        ("sweep: {zip: {model.friction: [1, 2], cell.width: [1]}}", "needs lists of one length"),
        ("sweep: {sobol: {points: 4, ranges: {}}}", "sweep.sobol.ranges = {}"),
        (
            "sweep: {sobol: {points: 4, ranges: {model.friction: {from: 1, to: 0}}}}",
            "sweep.sobol.ranges.model.friction.to = 0: must be above from, 1",
        ),
        (
            "sweep: {sobol: {points: 4, ranges: {model.friction: {from: 0, to: 1, scale: log}}}}",
            "scale: log needs values above 0",
        ),
        (
            "sweep: {sobol: {points: 4, ranges: {cell.width: {from: 0.5, to: 8, scale: integer}}}}",
            "scale: integer needs whole numbers",
        ),
        ("sweep: {set: {seed: 4}}", "seed = 4: belongs to the whole study"),
        ("sweep: {grid: {replicates: [4]}}", "replicates = 4: belongs to the whole study"),
        ("sweep: {grids: {model.friction: [4]}}", "did you mean grid?"),
        ("sweep: {model.friction: [1, 2]}", "put it under grid"),
        ("model.friction: 1", "write it as a section: `model: {friction: ...}`"),
        (
            "sweep: {grid: {model.friction: [1]}, set: {model.friction: 1}}",
            "model.friction is changed by `set` already: once only",
        ),
        (
            "sweep: {grid: {model.friction: [1]}, zip: {model: [{friction: 1}]}}",
            "model.friction is changed by `grid` already",
        ),
        (
            "scenes: {a: {model.links.cut: bulk}}\nsweep: {grid: {model.links.cut: [none]}}",
            "model.links.cut is changed by scene a already",
        ),
        (
            "scenes: {a: {model.contact_law: {kind: plateau, slope: 0.2}}}\n" + GRID_OVER_SLOPE,
            "model.contact_law.slope is changed by scene a already",
        ),
        (
            "sweep: {set: {model.friction: 1, model: {friction: 2}}}",
            "changes model.friction twice at one point",
        ),
        (
            MILLION,
            "makes 1,000,000 points, more than 100,000: split the study",
        ),
        ("seed: 1.5", "seed = 1.5: must be a whole number"),
        ("replicates: true", "replicates = true: must be a whole number"),
        ("model: {kind: microgell}", "model.kind = microgell: must be one of microgel"),
        ("model: {kind: [1]}", "model.kind = [1]: must be one of"),
        ("model:", "model = null: must be a section"),
        ("model: 3", "model = 3: must be a section"),
        (
            "scenes: {a: {model.frixion: 1}, b: {}}\nsweep: {scenes: [b]}",
            "did you mean friction?",
        ),
        ("shear: {kind: steady}", "shear.kind = steady: strain is required (total strain"),
        ("shear: {kind: stedy}", "shear.kind = stedy: must be one of oscillatory, steady; did you"),
        ("model: {young_modulus: .inf}", "must be a finite number"),
        ("model: {young_modulus: 1" + "0" * 400 + "}", "must be a number"),
        ("packing: {young_modulus: 3}", "did you mean model.young_modulus?"),
        ("model: {kind: hard_disc, friction: 0.1}", "friction = 0.1: unknown key: known are kind,"),
        (
            "record: {columns: [time, strain, time]}",
            "record.columns[2] = time: time is named twice",
        ),
        (
            "record: {columns: [time, sigma]}",
            "record.columns[1] = sigma: sigma is no stored column",
        ),
    ],
)
def test_every_mistake_has_its_message(text, message):
    assert message in report(text)


def test_problems_are_data_too():
    with pytest.raises(StudyError) as caught:
        study("packing: {packing_fraction: 84}")
    (problem,) = caught.value.problems
    assert (problem.line, problem.key, problem.value) == (1, "packing.packing_fraction", 84)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)  # noqa: S301


# What study files are made of, right and wrong.
_SCALARS = (
    st.none()
    | st.booleans()
    | st.integers(-3, 300)
    | st.integers()
    | st.floats()
    | st.sampled_from(["bulk", "none", "plateau", "custom", "steady", "hexagonal", "file", "x"])
)
_WORDS = """
model packing cell shear record integrator kind links cut cuts contact_law begin slope
friction model.friction model.links.cut shear.kind shear.strain_amplitude packing.start
discs columns file scenes sweep grid zip list set sobol points ranges from to scale name
linspace replicates seed x
"""
_KEYS = st.sampled_from(_WORDS.split())
_TREES = st.recursive(
    _SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_KEYS, inner, max_size=4),
    max_leaves=15,
)


@settings(deadline=None)
@given(st.dictionaries(_KEYS, _TREES, max_size=5))
def test_any_mapping_is_a_study_or_a_clear_error(data):
    with contextlib.suppress(StudyError):
        assert study(json.dumps(data)).points


# --- Models --------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [kind for kind in models.KINDS if kind != "kelvin_voigt"])
def test_every_model_exports_what_the_runner_knows(kind):
    package = models.model(kind)
    assert package.POINT().kind == kind
    assert package.PHYSICS_VERSION >= 1
    for columns in (package.COLUMNS, package.DERIVED):
        names = [column.name for column in columns]
        assert len(set(names)) == len(names)
    assert package.COLUMNS[0].name == "time"


def test_the_check_of_many_scenes_takes_no_square_of_their_number():
    names = tuple(f"scene_{number}" for number in range(30_000))
    began = time.process_time()
    assert list(design._bad_scenes(names, names, ("scenes",))) == []
    assert time.process_time() - began < 1.0


def test_an_unknown_model_is_refused():
    with pytest.raises(KeyError, match="no model 'foam': one of microgel"):
        models.model("foam")


def test_reading_a_study_is_light():
    """Planning must not wait for what only simulations and designs need."""
    code = (
        "import sys; from shear_sim.study import load_study; load_study(sys.argv[1]).jobs();"
        "sys.exit(str({'numba', 'scipy', 'pandas', 'pyarrow'} & {*sys.modules} or 0))"
    )
    command = [sys.executable, "-c", code, str(CONFIGS / "quick.yaml")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stderr.strip() == "0"


# --- Study files that come with the package ------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("quick", 20, 60),
        ("main", 1500, 1800),
        ("full", 20_000, 30_000),
        ("hard_disc", 40, 60),
        ("soft_particle_ring", 5, 5),
        ("soft_particle_compaction", 8, 8),
        ("soft_pack_speed", 13, 13),
        ("soft_plastic_ring", 6, 6),
        ("soft_beam", 15, 15),
        ("soft_free_ring", 16, 16),
        ("soft_suspension", 72, 72),
        ("three_methods", 60, 60),
        ("soft_tissue", 2, 2),
        ("film", 2, 2),
        ("particleshear", 840, 840),
    ],
)
def test_configs_load_and_have_their_size(name, least, most):
    it = load_study(CONFIGS / f"{name}.yaml")
    assert it.name == name
    jobs = it.jobs()
    assert least <= len(jobs) <= most
    assert len({job.id for job in jobs}) == len(jobs)


@pytest.mark.parametrize(
    ("name", "jobs"),
    [
        ("jamming", 80), ("rheology_64", 132), ("rheology_256", 42), ("rheology_1024", 20),
        ("rheology_1024_dense", 2), ("signals", 2), ("snapshots", 7), ("crystals", 48),
    ],
)  # fmt: skip
def test_longer_studies_of_hard_discs_load_and_have_their_size(name, jobs):
    assert len(load_study(CONFIGS / "hard_disc" / f"{name}.yaml").jobs()) == jobs


def test_every_config_file_is_tested():
    longer = {"jamming", "rheology_64", "rheology_256", "rheology_1024", "rheology_1024_dense"}
    longer |= {"crystals", "signals", "snapshots"}
    assert {path.stem for path in (CONFIGS / "hard_disc").glob("*.yaml")} == longer
    assert {path.stem for path in CONFIGS.glob("*.yaml")} == {
        "quick",
        "film",
        "main",
        "full",
        "hard_disc",
        "soft_particle_ring",
        "soft_particle_compaction",
        "soft_pack_speed",
        "soft_plastic_ring",
        "soft_beam",
        "soft_free_ring",
        "soft_suspension",
        "three_methods",
        "soft_tissue",
        "particleshear",
    }


def test_the_main_study_is_the_published_one_in_small():
    points = load_study(CONFIGS / "main.yaml").points
    main = [p.point for p in points if "amplitude" in dict(p.labels)]
    amplitudes = {point.shear.strain_amplitude for point in main}
    assert len(amplitudes) >= 9
    assert (min(amplitudes), max(amplitudes)) == (0.001, 2)
    assert len({point.model.friction for point in main}) == 4
    assert {point.model.links.cut for point in main} == {"cells", "bulk", "none"}
    for block in ("packing_fraction", "young_modulus", "cut", "link_removal", "plateau_law"):
        branch = [p for p in points if block in dict(p.labels)]
        assert {p.point.shear.strain_amplitude for p in branch} == {0.01, 0.2, 1}
        assert sum(len(p.labels) > 1 for p in branch) == 3  # joined to the main block at its base
