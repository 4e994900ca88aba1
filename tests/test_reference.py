"""The study-file reference is true: it is a study file, with everything that one may hold."""

import inspect
import json
import re
from pathlib import Path

import jsonschema
import pytest
from typer.testing import CliRunner

from shear_sim import models
from shear_sim.cli import app
from shear_sim.config import fields_of, sections_of
from shear_sim.design import KEYS
from shear_sim.document import read_yaml
from shear_sim.reference import FILLED_IN, json_schema, study_reference
from shear_sim.study import load_study, parameters

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


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_has_a_source(kind):
    """An equation or section of the model's paper or manual, of its docstring, or none but ours."""
    source = re.compile(r"paper|[Ss]ection \d|S[12]-\d|(HD|SP)\.\d|\bours\b")
    numbered = set(re.findall(r"\((HD\.\d+|SP\.\d+)\)", inspect.getdoc(models.model(kind))))
    for section, info in fields_of(models.model(kind).POINT).items():
        for option in sections_of(info.annotation):
            for name, each in all_keys(option):
                if sections_of(each.annotation) or (name, each.description) == ("kind", None):
                    continue
                assert source.search(each.description), f"{section}.{name}: {each.description}"
                cited = set(re.findall(r"\b(?:HD|SP)\.\d+", each.description))
                assert cited <= numbered, f"{section}.{name}: {cited}"
    assert "(ours:" in study_reference(kind)


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


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.name)
def test_the_json_schema_takes_the_studies_of_configs(path):
    data = read_yaml(path.read_bytes(), path).data
    kind = data.get("model", {}).get("kind", models.DEFAULT_KIND)
    jsonschema.validate(data, json_schema(kind))


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
