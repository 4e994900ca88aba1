"""The JSON Schema of study files, for editors that complete and check: from the models themselves.

A section is held against the kind that it names itself, and may lack what scenes and sweep bring;
which keys and kinds go together at the points that these make, only the program says.
"""

from collections.abc import Iterator, Sequence
from typing import Any, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic.json_schema import GenerateJsonSchema, models_json_schema

from shear_sim import models
from shear_sim.config import fields_of, sections_of
from shear_sim.design import Block, Design, Range, Sobol
from shear_sim.schema import FILLED_IN

Schema = dict[str, Any]
Sections = tuple[type[BaseModel], ...]


def json_schema(kind: str | None = None) -> Schema:
    """Return the JSON Schema of the study files of one model, or of all, chosen by ``model.kind``.

    Parameters
    ----------
    kind : str, optional
        Name of the model; by default any.
    """
    kinds = models.KINDS if kind is None else (kind,)
    points = {each: models.model(each).POINT for each in kinds}
    writer = _Writer((*points.values(), Design, Block, Range, Sobol))
    made: Schema = {
        "$schema": GenerateJsonSchema.schema_dialect,
        "title": f"Study file of shear-sim, {f'model {kind}' if kind else 'of any model'}",
    }
    if kind is not None:
        return made | writer.study((points[kind],)) | {"$defs": writer.definitions}
    every = tuple(points.values())
    default = writer.study((points.pop(models.DEFAULT_KIND),))
    chosen = writer.define(f"study of {models.DEFAULT_KIND}", default)
    for name, point in points.items():
        chosen = {
            "if": _needs("model", _needs("kind", {"const": name})),
            "then": writer.define(f"study of {name}", writer.study((point,))),
            "else": chosen,
        }
    # Scenes may name models of their own: then the sections above them belong to any.
    several = writer.define("study of several models", writer.study(every))
    return made | {
        "type": "object",
        "properties": {"model": {"properties": {"kind": {"enum": list(models.KINDS)}}}},
        "if": _needs("model", {"required": ["kind"]}),
        "then": chosen,
        "else": {"if": _names_models(), "then": several, "else": chosen},
        "$defs": writer.definitions,
    }


def _needs(key: str, schema: Schema) -> Schema:
    return {"required": [key], "properties": {key: schema}}


def _names_models() -> Schema:
    """Return the schema of a study whose scenes or sweep name a model."""
    kind: Schema = {"type": "object", "required": ["kind"]}
    by_key: Schema = {
        "type": "object",
        "anyOf": [{"required": ["model.kind"]}, _needs("model", kind)],
    }
    by_values: Schema = {
        "anyOf": [{"required": ["model.kind"]}, _needs("model", {"contains": kind})],
    }
    block: Schema = {
        "type": "object",
        "anyOf": [
            _needs("set", by_key),
            _needs("list", {"contains": by_key}),
            _needs("grid", by_values),
            _needs("zip", by_values),
        ],
    }
    none: Schema = {"additionalProperties": {"not": by_key}}
    blocks: Schema = {"anyOf": [block, {"type": "array", "contains": block}]}
    return {"anyOf": [_needs("scenes", {"not": none}), _needs("sweep", blocks)]}


class _Writer:
    """Writes schemas that share definitions."""

    def __init__(self, tops: Sequence[type[BaseModel]]) -> None:
        sections = tuple(dict.fromkeys(each for top in tops for each in _all_sections(top)))
        held = {each for section in sections for each in _below((section,), None)}
        refs, schema = models_json_schema(
            [(section, "validation") for section in sections], by_alias=True
        )
        self.definitions: Schema = schema["$defs"]
        number = {"type": "number"}
        ends = {
            "type": "array",
            "prefixItems": [number, number, {"type": "integer", "minimum": 2}],
            "minItems": 3,
            "maxItems": 3,
        }
        one = _closed({"linspace": ends, "logspace": ends})
        self._spaced = self.define("spaced", one | {"minProperties": 1, "maxProperties": 1})
        self._changed: dict[Sections, Schema] = {}  # what refers to the changes of each
        self._of = {section: refs[section, "validation"]["$ref"] for section in sections}
        for section in sections:
            made = self.definitions[self._name(section)]
            for name in FILLED_IN:
                made["properties"].pop(name, None)
            if section in held:
                made["required"] = [name for name in made.get("required", []) if name == "kind"]

    def define(self, name: str, schema: Schema) -> Schema:
        """Keep a schema under a name, and return what refers to it."""
        name = name.replace(" ", "_")
        self.definitions[name] = schema
        return {"$ref": f"#/$defs/{name}"}

    def _name(self, section: type[BaseModel]) -> str:
        return str(self._of[section].rpartition("/")[2])

    def study(self, points: Sections) -> Schema:
        """Return the schema of study files whose points are of one of these kinds."""
        changes = _or_null(self._changes(points))
        block = self.define(f"block {len(self._changed)}", self._block(points))
        properties: Schema = {}
        for key in dict.fromkeys(key for point in points for key in fields_of(point)):
            having = tuple(point for point in points if key in fields_of(point))
            one = len(points) == 1
            properties[key] = self._value(having[0], key) if one else self._change(having, key)
        design = {key: self._value(Design, key) for key in fields_of(Design)}
        design["scenes"] = {"type": "object", "additionalProperties": changes}
        design["sweep"] = {"anyOf": [block, {"type": "array", "items": block, "minItems": 1}]}
        return _closed(properties | design)

    def _block(self, points: Sections) -> Schema:
        """Return the schema of a block of the sweep."""
        changes = _or_null(self._changes(points))
        values = dict(self._inside(points))
        each = {key: self._axis(value) for key, value in values.items()}
        axes = self.define(f"axes {len(self._changed)}", _closed(each))
        spans = {key: {"$ref": self._of[Range]} for key in values}
        sobol = {key: self._value(Sobol, key) for key in fields_of(Sobol)}
        sobol["ranges"] = _closed(spans) | {"minProperties": 1}
        given: Schema = {
            "grid": axes,
            "zip": axes,
            "set": changes,
            "list": {"type": "array", "items": changes},
            "sobol": _or_null(_closed(sobol) | {"required": list(sobol)}),
        }
        return _closed({key: self._value(Block, key) for key in fields_of(Block)} | given)

    def _axis(self, value: Schema) -> Schema:
        """Return the schema of the values that one key takes: a list, or ends that are such."""
        ends = {"prefixItems": [value, value]}
        return {
            "anyOf": [{"type": "array", "items": value, "minItems": 1}, self._spaced],
            "properties": {"linspace": ends, "logspace": ends},
        }

    def _changes(self, sections: Sections) -> Schema:
        """Return the schema of changes to one of ``sections``, by keys relative to it."""
        if sections not in self._changed:
            values = dict(self._dotted(sections))
            self._changed[sections] = self.define(f"changes {len(self._changed)}", _closed(values))
        return self._changed[sections]

    def _inside(self, sections: Sections) -> Iterator[tuple[str, Schema]]:
        """Yield every key of changes to ``sections``, with a reference to that of its values."""
        changes = self._changes(sections)["$ref"]
        for key in self.definitions[changes.rpartition("/")[2]]["properties"]:
            yield key, {"$ref": f"{changes}/properties/{key}"}

    def _dotted(self, sections: Sections) -> Iterator[tuple[str, Schema]]:
        """Yield every key that may be changed, dotted, with the schema of its values."""
        for key in dict.fromkeys(key for section in sections for key in fields_of(section)):
            if key in FILLED_IN:
                continue
            having = tuple(section for section in sections if key in fields_of(section))
            yield key, self._change(having, key)
            if below := _below(having, key):
                for inner, value in self._inside(below):
                    yield f"{key}.{inner}", value

    def _change(self, having: Sections, key: str) -> Schema:
        """Return the schema of what ``key`` may be changed to in one of the sections having it."""
        below = _below(having, key)
        values = [
            self._value(section, key)
            for section in having
            if not _held(fields_of(section)[key])  # a change need not be a whole section
        ]
        if below:
            values.append(self._changes(below))
            if any(_may_be_null(fields_of(section)[key]) for section in having):
                values.append({"type": "null"})
        distinct = [value for i, value in enumerate(values) if value not in values[:i]]
        return distinct[0] if len(distinct) == 1 else {"anyOf": distinct}

    def _value(self, section: type[BaseModel], key: str) -> Schema:
        return {"$ref": f"{self._of[section]}/properties/{key}"}


def _or_null(schema: Schema) -> Schema:
    return {"anyOf": [schema, {"type": "null"}]}


def _closed(properties: Schema) -> Schema:
    return {"type": "object", "properties": properties, "additionalProperties": False}


def _held(info: FieldInfo) -> Sections:
    """Return the sections that a field may hold; none of a list of them, which is one value."""
    return () if get_origin(info.annotation) is tuple else tuple(sections_of(info.annotation))


def _below(having: Sections, key: str | None) -> Sections:
    """Return the sections that ``key`` of the sections may hold, or any key of theirs."""
    fields = [fields_of(section) for section in having]
    infos = [info for each in fields for name, info in each.items() if key in {name, None}]
    return tuple(dict.fromkeys(option for info in infos for option in _held(info)))


def _may_be_null(info: FieldInfo) -> bool:
    return type(None) in getattr(info.annotation, "__args__", ())


def _all_sections(section: type[BaseModel]) -> Iterator[type[BaseModel]]:
    yield section
    for info in fields_of(section).values():
        for option in sections_of(info.annotation):
            yield from _all_sections(option)
