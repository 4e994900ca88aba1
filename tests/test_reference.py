"""The study-file reference is true: it is a study file, with everything that one may hold."""

import inspect
import json
import re
from functools import cache
from pathlib import Path

import jsonschema
import pytest
from typer.testing import CliRunner

from shear_sim import models
from shear_sim.cli import app
from shear_sim.config import fields_of, sections_of
from shear_sim.design import KEYS
from shear_sim.document import read_yaml
from shear_sim.json_schema import json_schema
from shear_sim.reference import study_reference
from shear_sim.schema import FILLED_IN
from shear_sim.study import StudyError, load_study, parameters, read_study

KINDS = [kind for kind in models.KINDS if kind != "kelvin_voigt"]  # which is of the tests
CONFIGS = sorted((Path(__file__).parents[1] / "configs").rglob("*.yaml"))


def printed(*arguments):
    return CliRunner().invoke(app, ["schema", *arguments])


def all_keys(section):
    """Yield every key of a section and of what it holds, of each kind."""
    for name, info in fields_of(section).items():
        if name not in FILLED_IN:
            yield name, info
            for option in sections_of(info.annotation):
                yield from all_keys(option)


@pytest.mark.parametrize("kind", KINDS)
def test_the_reference_is_a_study_of_one_default_job(kind, tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text(printed(kind).stdout)
    (job,) = load_study(path).jobs()
    assert job.parameters == parameters(models.model(kind).POINT().resolved())


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_of_every_kind_is_there_and_explained(kind):
    text = study_reference(kind)
    for name, info in all_keys(models.model(kind).POINT):
        assert re.search(rf"^#? *{name}:", text, re.MULTILINE), name
        if name != "kind" and not sections_of(info.annotation):
            assert info.description, f"{name} has no description"
    for name in KEYS:
        assert re.search(rf"^(# )?{name}:", text, re.MULTILINE), name
    assert max(map(len, text.splitlines())) <= 104  # a commented line has two more


def dotted(section, prefix=""):
    """Yield every key of a point that holds a value, dotted, of each kind."""
    for name, info in fields_of(section).items():
        below = sections_of(info.annotation)
        for option in below:
            yield from dotted(option, f"{prefix}{name}.")
        if not below and name not in FILLED_IN and (name, info.description) != ("kind", None):
            yield prefix + name, info


#: What the manual and the papers have: sections, and equations by number.
SOURCES = {
    "microgel": r"(eq\. )?S1-([1-9]|1\d|2[0-5])b?|S2-1|section [1-6](\.\d){0,2}",
    "hard_disc": (
        r"HD\.\d+|paper \(([1-9]|[12]\d|30)\)|"
        r"(paper,? )?(section )?(I{1,3}|IV|V)( [A-D])?"
    ),
    "soft_particle": r"SP\.\d+|paper \(([1-9]|[1-3]\d)\)|section [2-6](\.\d)?",
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_ends_with_its_source(kind):
    """An equation or section of the model's paper or manual, of its docstring, or none but ours."""
    model = models.model(kind)
    numbered = set(re.findall(r"\((HD\.\d+|SP\.\d+)\)", inspect.getdoc(model)))
    one = rf"({SOURCES[kind]})( of part \d)?"
    source = re.compile(rf"[;,] {one}(, {one})*$|\({one}(, or the same for all)?\)?$|[;,] ours$")
    for key, info in dotted(model.POINT):
        text = info.description.removesuffix(".")
        said = re.sub(r"; first order, as particleShear$|, or the same for all$", "", text)
        if key == "model.lever_arms":  # a source for each choice
            assert set(re.findall(r"eq\. (S1-\d)", text)) == {"S1-2", "S1-3"}
            continue
        assert source.search(said), f"{key}: {text}"
        assert set(re.findall(r"\b(?:HD|SP)\.\d+", text)) <= numbered, f"{key}: {text}"
    assert "(ours:" in study_reference(kind)


def test_what_cites_the_table_of_the_old_program_is_mapped_to_it():
    """And what is ours alone is not."""
    page = (Path(__file__).parents[1] / "analysis/particleshear.md").read_text()
    names = page.partition("## Names")[2].partition("\n## ")[0]
    mapped = set(re.findall(r"\b(?:model|packing|shear)\.[a-z_.]+[a-z]", names))
    mapped |= {f"shear.{name}" for name in ("pre_periods", "periods", "post_periods")}
    oscillatory = dotted(models.model("microgel").POINT)
    told = {}
    for key, info in oscillatory:
        told.setdefault(key, info.description)  # of the default kind, which comes first
    cited = {key for key, text in told.items() if "S2-1" in text}
    assert cited - mapped == {"cell.width"}  # which its caption has
    assert not [key for key in mapped & set(told) if told[key].endswith("ours")]


UNITS = {
    "microgel": {
        "cell.width": "m", "cell.height": "m", "packing.density": "kg/m³",
        "model.young_modulus": "Pa", "model.links.avoid_angle": "degrees",
    },
    "hard_disc": {
        "model.mobility": "1/(Pa s)", "packing.walls.angle": "degrees",
        "packing.walls.orifice": "mean small diameters", "shear.duration": "τ",
        "shear.inclination": "degrees", "shear.period": "s", "shear.persistence": "τ",
        "shear.rate": "1/s", "shear.shear_stress": "Pa", "shear.strain_rate": "1/s",
        "shear.time_unit": "s",
    },
    "soft_particle": {
        "packing.radius": "m", "model.young_modulus": "Pa", "model.density": "kg/m³",
    },
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_pure_number_has_its_unit(kind):
    found = {}
    for key, info in dotted(models.model(kind).POINT):
        if key != "record.snapshots":
            units = set(re.findall(r"\[([^\]]*)\]", info.description)) - {"-"}
            assert units <= {found.get(key, *units)} if units else key not in found, key
            found |= dict.fromkeys([key] if units else [], *units)
    assert found == UNITS[kind]
    assert "Numbers without a unit in brackets" in study_reference(kind)


def test_limits_and_choices_are_named():
    text = study_reference("microgel")
    assert "# μ" not in text
    assert re.search(r"decay: 0\.5 .*\s*#? *\(> 0, ≤ 1\)", text)
    assert re.search(r"steps_per_period: null(.|\n)*?\(≥ 10\)", text)
    assert "velocity_verlet | semi_implicit_euler" in text
    walls = study_reference("hard_disc").partition("walls:")[2].partition("orifice")[0]
    assert "multiple of 4" in study_reference("soft_particle")
    assert {"none", "floor", "hopper"} <= set(re.findall(r"[a-z]+", walls))
    assert "\N{NO-BREAK SPACE}" not in text


@pytest.mark.parametrize("kind", KINDS)
def test_a_kind_that_is_the_default_may_be_left_out(kind, tmp_path):
    """As the reference shows it, in the section itself and by a sweep."""
    point = models.model(kind).POINT()
    default, key = {
        "microgel": (0.2, "strain_amplitude"),
        "hard_disc": (1.0, "strain"),
        "soft_particle": (0.4, "compression"),
    }[kind]
    path = tmp_path / "study.yaml"
    path.write_text(
        f"model: {{kind: {kind}}}\nshear: {{{key}: {default}}}\n"
        f"sweep: {{grid: {{shear.{key}: [0.3, {default}]}}}}\nseed: 0\n"
    )
    found = [job.parameters for job in load_study(path).jobs()]
    assert len(found) == 2
    assert parameters(point.resolved()) in found
    path.write_text(f"model: {{kind: {kind}}}\nshear: {{{key}: 0.3}}\nseed: 0\n")
    (job,) = load_study(path).jobs()
    assert job.parameters in found
    jsonschema.validate(read_yaml(path.read_bytes(), path).data, json_schema(kind))
    assert wrong(path.read_text()) is None


@cache
def validator(*arguments):
    """The validator of what ``schema --json`` prints."""
    schema = json.loads(printed("--json", *arguments).stdout)
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def wrong(text, *arguments):
    """What an editor marks in a study file: the place, or None."""
    data = read_yaml(text.encode(), Path("study.yaml")).data
    found = jsonschema.exceptions.best_match(validator(*arguments).iter_errors(data))
    return found and list(found.absolute_path)


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.name)
def test_the_json_schema_takes_the_studies_of_configs(path):
    """One schema, which goes by the model that a study names, or its scenes; and that of it."""
    assert wrong(path.read_text()) is None
    data = read_yaml(path.read_bytes(), path).data
    if path.stem != "three_methods":
        kind = data.get("model", {}).get("kind", models.DEFAULT_KIND)
        assert wrong(path.read_text(), kind) is None
        others = [other for other in KINDS if other != kind]
        if kind != models.DEFAULT_KIND:
            assert all(wrong(path.read_text(), other) for other in others)


TAKEN = {
    "nothing": "seed: 1",
    "a section, with dots inside": "scenes: {a: {model: {links.cut: bulk, friction: 1}}}",
    "a scene without changes": "scenes: {a: , b: {}}",
    "a section that starts afresh": "scenes: {a: {model.contact_law: {kind: hertz}}}",
    "a kind and its keys apart": (
        "scenes: {a: {shear.kind: steady}}\n"
        "sweep: {set: {shear.strain: 1}, grid: {shear.relative_rate: [0.1, -0.1]}}"
    ),
    "a base that lacks what a sweep brings": (
        "shear: {kind: steady, strain: 1}\nsweep: {grid: {shear.relative_rate: [0.1, -0.1]}}"
    ),
    "sections as values": "sweep: {grid: {model.contact_law: [{kind: hertz}, {kind: linear}]}}",
    "null as a value": "sweep: {grid: {integrator.steps_per_period: [null, 200]}}",
    "whole numbers, spaced": "sweep: {grid: {packing.discs: {linspace: [20, 40, 3]}}}",
    "blocks": (
        "sweep: [{name: a, zip: {model.friction: [0, 1], packing.discs: [20, 30]}},"
        " {list: [{model.friction: 0.5}, {packing: {discs: 40}}]}]"
    ),
    "a sobol design": (
        "sweep: {sobol: {points: 4, ranges: {model.friction: {from: 0.1, to: 1, scale: log}}}}"
    ),
    "stages": (
        "model: {kind: hard_disc}\nscenes: {a: {shear: {kind: stages, stages: [{length: 1}]}}}"
    ),
    "models of scenes": (
        "packing: {particles: 9, packing_fraction: 0.95}\nshear: {kind: oscillatory}\n"
        "scenes: {a: {model: {kind: soft_particle}}, b: {model.kind: soft_particle, model.drag: 1}}"
    ),
    "models of a list": (
        "packing: {discs: 20, packing_fraction: 0.8}\nshear: {kind: oscillatory}\n"
        "sweep: {list: [{model.kind: hard_disc}, {model: {kind: microgel}}]}"
    ),
    "models of a grid": (
        "packing: {discs: 20, packing_fraction: 0.8}\nshear: {kind: oscillatory}\n"
        "sweep: {grid: {model.kind: [hard_disc, microgel], shear.strain_amplitude: [0.1, 0.2]}}"
    ),
}


@pytest.mark.parametrize("text", TAKEN.values(), ids=TAKEN)
def test_the_json_schema_takes_what_the_program_takes(text):
    assert read_study(text.encode(), Path("study.yaml")).jobs()
    assert wrong(text) is None


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("sweep: {gird: {}}", ["sweep"]),
        ("sweep: [{gird: {}}]", ["sweep", 0]),
        ("sweep: {grid: {shear.strainamp: [0.1]}}", ["sweep", "grid"]),
        ("sweep: {zip: {shear.strainamp: [0.1]}}", ["sweep", "zip"]),
        ("sweep: {set: {shear.strainamp: 0.1}}", ["sweep", "set"]),
        ("sweep: {list: [{shear: {strainamp: 0.1}}]}", ["sweep", "list", 0, "shear"]),
        (
            "sweep: {grid: {shear.strain_amplitude: [1, 7]}}",
            ["sweep", "grid", "shear.strain_amplitude", 1],
        ),
        (
            "sweep: {grid: {shear.strain_amplitude: {logspace: [1, 7, 3]}}}",
            ["sweep", "grid", "shear.strain_amplitude", "logspace", 1],
        ),
        (
            "sweep: {grid: {packing.discs: {linspace: [10, 20]}}}",
            ["sweep", "grid", "packing.discs", "linspace"],
        ),
        ("sweep: {sobol: {points: 4, ranges: {model.frict: {from: 0, to: 1}}}}", None),
        ("sweep: {sobol: {points: 4}}", None),
        ("scenes: {a: {model.frict: 1}}", ["scenes", "a"]),
        ("scenes: {a: {model: {friction: -1}}}", ["scenes", "a", "model", "friction"]),
        ("scenes: {a: {seed: 1}}", ["scenes", "a"]),
        ("model: {kind: hard_disc}\nscenes: {a: {model.friction: 1}}", ["scenes", "a"]),
        ("model: {kind: hard_disc}\npacking: {vertices: 8}", ["packing"]),
        ("model: {kind: soft_particle}\nscenes: {a: {model.drag: 7}}", None),
        ("model: {kind: sand}", ["model", "kind"]),
        ("scenes: {a: {model: {kind: sand}}}", None),
        ("packing: {disks: 9}\nscenes: {a: {model: {kind: hard_disc}}}", ["packing"]),
    ],
)
def test_the_json_schema_refuses_what_the_program_refuses(text, place):
    with pytest.raises(StudyError):
        read_study(text.encode(), Path("study.yaml"))
    found = wrong(text)
    assert found is not None
    if place is not None:
        assert found == place


@pytest.mark.parametrize(
    ("data", "path"),
    [
        ({"packing": {"disks": 150}}, ["packing"]),
        ({"model": {"friction": -1}}, ["model", "friction"]),
        ({"replicates": 0}, ["replicates"]),
        ({"swep": {}}, []),
        ({"record": {"snapshots": 0}}, ["record", "snapshots"]),
        ({"record": {"snapshots": []}}, ["record", "snapshots"]),
        ({"record": {"snapshots": [0, "a"]}}, ["record", "snapshots", 1]),
    ],
)
def test_the_json_schema_refuses_what_is_wrong(data, path):
    schema = json.loads(printed("--json").stdout)
    jsonschema.validators.validator_for(schema, default=None).check_schema(schema)
    with pytest.raises(jsonschema.ValidationError) as caught:
        jsonschema.validate(data, schema)
    assert list(caught.value.absolute_path) == path


@pytest.mark.parametrize("rate", [-0.1, 0, 0.1])
def test_a_rate_of_zero_is_refused_by_both(rate):
    data = {"shear": {"kind": "steady", "relative_rate": rate, "strain": 1.0}}
    taken = jsonschema.Draft202012Validator(json_schema("microgel")).is_valid(data)
    assert taken == (rate != 0)
    if not taken:
        with pytest.raises(ValueError, match="must not be 0"):
            models.model("microgel").POINT.model_validate(data)


def test_a_model_that_there_is_not():
    result = printed("sand")
    assert result.exit_code == 2
    assert "no model 'sand': one of microgel" in result.stderr


def test_the_help_names_the_models():
    text = " ".join(printed("--help").stdout.split())
    assert f"{KINDS[0]} (by default), {KINDS[1]} or {KINDS[2]};" in text
    assert len(KINDS) == 3
