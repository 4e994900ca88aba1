"""Validation errors in the words of the study file: key path, value, and what would be right."""

import difflib
import itertools
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from shear_sim.document import Key, dotted, round12
from shear_sim.schema import Impossible, UnitMistake


@dataclass(frozen=True)
class Complaint:
    """What a section says about one value (or, by a cross-check, about several)."""

    keys: tuple[Key, ...]  # the message stands alone: any of them may be shown
    message: str
    about: Literal["value", "key", "whole"] = "value"  # whole: what is lacking, or does not fit


def complaints(
    error: ValidationError, model: type[BaseModel], top_level: tuple[str, ...] = ()
) -> Iterator[Complaint]:
    """Yield what is wrong, by key path of the file, with what would be right.

    Parameters
    ----------
    error : ValidationError
        From validating ``model``.
    model : type
        The section at the top.
    top_level : tuple of str
        Keys that the file may also have at its top, which ``model`` does not know.
    """
    for entry in error.errors(include_url=False):
        context = entry.get("ctx", {})
        place = _locate(model, entry["loc"])
        cause = context.get("error")
        if isinstance(cause, Impossible):
            for keys, message in cause.problems:
                paths = tuple((*place.key, *key.split(".")) for key in keys)
                yield Complaint(paths, message, "whole" if len(paths) > 1 else "value")
        elif entry["type"] == "extra_forbidden":
            known = tuple(fields_of(place.parent)) if place.parent else ()
            if place.parent is model:
                known += top_level
            message = _unknown(place.key, known, model, top_level)
            of_another_kind = dotted(place.key) in _dotted_keys(model)
            yield Complaint((place.key,), message, "whole" if of_another_kind else "key")
        elif entry["type"] == "missing":
            # The section may stand nowhere in the file but through its kind.
            kind = (*place.key[:-1], "kind")
            message = f"{place.key[-1]} is required{_meaning(place.info)}"
            yield Complaint((place.key, kind), message, "whole")
        elif entry["type"] == "union_tag_invalid":
            known = tuple(re.findall(r"'([^']*)'", context["expected_tags"]))
            message = one_of(entry["input"]["kind"], known)
            yield Complaint(((*place.key, "kind"),), message)
        else:
            yield Complaint((place.key,), _wrong(entry, place.info))


def all_complaints(
    error: ValidationError,
    model: type[BaseModel],
    data: dict[str, Any],
    top_level: tuple[str, ...] = (),
) -> list[Complaint]:
    """Return all complaints, also those that hide behind others.

    A section is checked as a whole only if each of its values is right. So the values complained
    of are taken out, which gives them their defaults, and the rest is checked again; complaints
    that touch them say nothing then.
    """
    found: list[Complaint] = []
    removed: set[Key] = set()
    while True:
        new = [c for c in complaints(error, model, top_level) if not touches(c, removed)]
        if not new:
            return found
        found += new
        for complaint in new:
            for key in complaint.keys:
                # Without its kind, a section's other keys mean nothing; nor does half a list.
                section = key[:-1] if key[1:] and key[-1] == "kind" else key
                removed.add(tuple(itertools.takewhile(lambda k: isinstance(k, str), section)))
        for key in removed:
            data = without(data, key)
        try:
            model.model_validate(data)
        except ValidationError as next_error:
            error = next_error
        else:
            return found


def touches(complaint: Complaint, keys: Collection[Key]) -> bool:
    """Whether ``complaint`` is about any of ``keys`` or about something inside them."""
    return any(key[:n] in keys for key in complaint.keys for n in range(len(key) + 1))


def without(data: Any, key: Key) -> Any:
    """Return ``data`` without what stands at ``key``; ``{}`` takes the place of a list's item."""
    if not key:
        return {}
    first, rest = key[0], key[1:]
    if isinstance(data, list) and isinstance(first, int) and first < len(data):
        return [*data[:first], without(data[first], rest), *data[first + 1 :]]
    if not isinstance(data, dict) or first not in data:
        return data
    if not rest:
        return {name: value for name, value in data.items() if name != first}
    return {**data, first: without(data[first], rest)}


@dataclass(frozen=True)
class _Place:
    key: Key
    info: FieldInfo | None  # of the last part
    parent: type[BaseModel] | None  # section that holds the last part


def fields_of(section: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a section under their names in a study file."""
    return {info.alias or name: info for name, info in section.model_fields.items()}


def sections_of(annotation: Any) -> list[type[BaseModel]]:
    """Return the sections named anywhere in a type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [section for part in get_args(annotation) for section in sections_of(part)]


def kind_of(section: type[BaseModel]) -> str | None:
    """Return the tag of a member of a union of sections, if it has one."""
    if "kind" not in section.model_fields:
        return None
    tag: str = get_args(section.model_fields["kind"].annotation)[0]
    return tag


def _locate(model: type[BaseModel], loc: Key) -> _Place:
    """Return the place of pydantic's ``loc``, which names union members too, in the file."""
    key: Key = ()
    section: type[BaseModel] | None = model
    parent = info = None
    members: dict[str | int, type[BaseModel]] = {}
    mapping = False  # the next part is a free name, as in {name: section}
    for part in loc:
        if part == "[key]":
            continue  # pydantic's mark for a fault of the key itself
        if part in members:
            section, members = members[part], {}
            continue
        key = (*key, part)
        if isinstance(part, int) or mapping:
            mapping = False
            continue
        parent = section
        info = fields_of(section).get(part) if section else None
        options = sections_of(info.annotation) if info else []
        mapping = info is not None and get_origin(info.annotation) is dict
        section = options[0] if len(options) == 1 else None
        members = {kind: option for option in options if (kind := kind_of(option)) is not None}
        if len(options) == 1:
            members = {}
    return _Place(key, info, parent)


def _unknown(
    key: Key, known: tuple[str, ...], model: type[BaseModel], top_level: tuple[str, ...]
) -> str:
    name = str(key[-1])
    if len(key) == 1 and name in top_level:
        return "belongs to the whole study, so no scene or sweep can change it"
    if "." in name.strip(".") and "grid" in known:
        return f"put it under grid: `grid: {{{name}: ...}}`"
    if "." in name.strip("."):
        return f"write it as a section: `{name.split('.')[0]}: {{{name.split('.', 1)[1]}: ...}}`"
    every = _dotted_keys(model)
    if dotted(key) in every:  # of another member of the union
        return f"is no key of this kind of {key[-2]}: known are {', '.join(known)}"
    if close := difflib.get_close_matches(name, known, n=1):
        return f"unknown key: did you mean {close[0]}?"
    elsewhere = [path for path in every if path.rsplit(".", 1)[-1] == name]
    if not elsewhere:
        last = {path.rsplit(".", 1)[-1]: path for path in every}
        elsewhere = [last[m] for m in difflib.get_close_matches(name, last, n=1, cutoff=_LIKE)]
    if elsewhere:
        return f"unknown key: did you mean {' or '.join(dict.fromkeys(elsewhere))}?"
    if not known:
        return "unknown key: there are no keys below this one"
    return f"unknown key: known are {', '.join(known)}"


@cache
def _dotted_keys(section: type[BaseModel], prefix: str = "") -> tuple[str, ...]:
    found: dict[str, None] = {}
    for name, info in fields_of(section).items():
        found[prefix + name] = None
        for option in sections_of(info.annotation):
            found |= dict.fromkeys(_dotted_keys(option, f"{prefix}{name}."))
    return tuple(found)


def one_of(value: object, known: Sequence[str]) -> str:
    """Return the message on a word that is not one of the ``known`` ones."""
    close = difflib.get_close_matches(str(value), known, n=1)
    return f"must be one of {', '.join(known)}" + (f"; did you mean {close[0]}?" if close else "")


_LIKE = 0.7  # how alike keys of two sections must be, 1 for the same, to take one for the other

_MUST_BE = {
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "bool_type": "must be true or false",
    "string_type": "must be a text",
    "path_type": "must be a file name",
    "tuple_type": "must be a list",
    "dict_type": "must be a section of `key: value`",
    "model_type": "must be a section of `key: value`",
    "model_attributes_type": "must be a section of `key: value`",
    "finite_number": "must be a finite number",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
}


def _wrong(entry: Any, info: FieldInfo | None) -> str:
    context = entry.get("ctx", {})
    if entry["type"] == "literal_error" and info is not None:
        return one_of(entry["input"], tuple(str(value) for value in _literals(info.annotation)))
    if entry["type"] == "multiple_of":
        step = context["multiple_of"]
        near = _multiples(entry["input"], step, info)
        return f"must be a multiple of {step:g}: {near}{_meaning(info)}"
    if entry["type"] not in _MUST_BE:
        return str(context.get("error") or entry["msg"])
    message = _MUST_BE[entry["type"]].format(**context)
    mistakes = [item for item in info.metadata if isinstance(item, UnitMistake)] if info else []
    limit = context.get("le", context.get("lt"))
    if mistakes and limit is not None and entry["input"] > mistakes[0].above:
        meant = round12(entry["input"] * mistakes[0].factor)
        again = f": {meant:g}?" if meant <= limit else ""
        return f"{message} ({mistakes[0].right}{again})"
    return message + _meaning(info)


def _multiples(value: float, step: float, info: FieldInfo | None) -> str:
    """Return the multiples of ``step`` beside ``value``, or the nearest that is allowed."""
    below = value // step * step
    found = [below, below + step]
    for item in info.metadata if info is not None else ():
        if (least := getattr(item, "ge", None)) is not None:
            found = [max(each, -(-least // step) * step) for each in found]
        if (most := getattr(item, "le", None)) is not None:
            found = [min(each, most // step * step) for each in found]
    return " or ".join(dict.fromkeys(f"{each:g}" for each in found))


def _literals(annotation: Any) -> list[object]:
    if get_origin(annotation) is Literal:
        return list(get_args(annotation))
    return [value for part in get_args(annotation) for value in _literals(part)]


def _meaning(info: FieldInfo | None) -> str:
    return f" ({info.description})" if info is not None and info.description else ""
