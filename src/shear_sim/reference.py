"""The study-file reference: every key with its default, unit, limits and source, from the models.

It is itself a study file, one job with all defaults, so that it can be copied from and cannot be
wrong: what is not default, such as the other contact laws, stands beside it in comments.
"""

import re
import textwrap
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

import annotated_types as limits
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from shear_sim import models
from shear_sim.config import fields_of, kind_of, sections_of
from shear_sim.schema import FILLED_IN

WIDTH, COLUMN = 100, 36  # of a line, of its comment
_FIXED = "\N{NO-BREAK SPACE}"  # textwrap does not break lines there
DESIGN = """\
# The study: scenes and sweep change the sections above, by dotted keys.
scenes: {}                          # {name: {key: value}}: sets of changes, side by side
replicates: 1                       # jobs of each point, at least 1
seed: 0                             # of all random numbers, at least 0
"""
SWEEP = """\
# sweep:                            # a block or a list of blocks, added up; each may have
#   name: amplitude
#   scenes: [crosslinked]           # default: all
#   set: {key: value}               # for the whole block
#   grid: {key: [values]}           # every combination of all keys
#   zip: {key: [values]}            # first with first, second with second, ...
#   list: [{key: value}]            # these points
#   sobol: {points: 64, ranges: {key: {from: 1, to: 2, scale: linear}}}   # or log, integer
# values: a list, {linspace: [first, last, number]} or {logspace: [first, last, number]}
"""


def study_reference(kind: str) -> str:
    """Return the reference of one model's study files, as a study file with all defaults."""
    package = models.model(kind)
    point = package.POINT
    lines = [*_header(kind, package.__doc__ or ""), ""]
    for name, info in fields_of(point).items():
        lines += [*_key(name, info, ""), ""]
    meaning = f"most cores of one job, neither in its id nor in its bits. {kind}: {package.THREADS}"
    threads = "\n".join(_commented("threads: 1", meaning))
    return "\n".join(lines) + f"\n{DESIGN}{threads}\n{SWEEP}"


def _header(kind: str, docstring: str) -> list[str]:
    """Return the lines that say where the sources are, from the package's own words on them."""
    sources = " ".join(docstring.partition("Source: ")[2].partition("\n\n")[0].split())
    text = (
        f"Study file of model {kind}: every key with its default, its meaning and unit, its source "
        "(ours: only this program has it) and its limits. Numbers without a unit in brackets are "
        f"pure. {sources}"
    )
    if re.search(r"\([A-Z]{2}\.1\)", docstring):
        text += f" Equations with a dot are in the docstring of shear_sim.models.{kind}."
    return [f"# {line}" for line in textwrap.wrap(text, WIDTH - 2)]


def _key(name: str, info: FieldInfo, indent: str) -> Iterator[str]:
    """Yield the lines of one key, or of the section that it holds."""
    options = sections_of(info.annotation)
    if not options:
        yield from _commented(f"{indent}{name}: {_value(info)}", _meaning(info))
        return
    if get_origin(info.annotation) is tuple:
        yield from _list(name, options[0], indent)
        return
    value = info.get_default(call_default_factory=True)
    default = options[0] if value is PydanticUndefined else type(value)
    if value is None:
        yield from _commented(f"{indent}{name}: null", _meaning(info))
    else:
        yield from _section(name, default, indent, info)
    for option in options:
        if option is not default:
            for line in _section(name, option, indent):
                yield f"# {line}".rstrip()


def _section(
    name: str, section: type[BaseModel], indent: str, info: FieldInfo | None = None
) -> Iterator[str]:
    text = (info.description if info else None) or (section.__doc__ or "").partition("\n")[0]
    yield from _commented(f"{indent}{name}:", text.removesuffix("."))
    for key, each in fields_of(section).items():
        if key not in FILLED_IN:
            if key == "kind" and len(_words(each.annotation)) == 1:
                yield f"{indent}  kind: {kind_of(section)}"
            else:
                yield from _key(key, each, f"{indent}  ")


def _list(name: str, section: type[BaseModel], indent: str) -> Iterator[str]:
    """Yield the lines of a list with one item."""
    yield f"{indent}{name}:"
    first, *rest = _section("-", section, f"{indent}  ")
    yield first.replace("-:", "- ", 1)
    yield from rest


def _commented(text: str, comment: str) -> Iterator[str]:
    """Yield ``text`` and its comment, in a column of its own and as many lines as it needs."""
    if not comment:
        yield text
        return
    first, *rest = textwrap.wrap(comment, WIDTH - COLUMN - 2)
    first, rest = first.replace(_FIXED, " "), [line.replace(_FIXED, " ") for line in rest]
    yield f"{text:<{COLUMN - 1}} # {first}"
    for line in rest:
        yield f"{'':<{COLUMN}}# {line}"


def _value(info: FieldInfo) -> str:
    value = info.get_default(call_default_factory=True)
    if value is PydanticUndefined:
        return "<required>"
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(str(each) for each in value)}]"
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def _meaning(info: FieldInfo) -> str:
    """Return what a comment says: meaning, then what values there may be."""
    text = (info.description or "").removesuffix(".")
    words = _words(info.annotation)
    if not all(word in text for word in words):
        text = "; ".join(part for part in (text, " | ".join(words)) if part)
    return text + (f" ({found})" if (found := _limits(info)) else "")


def _words(annotation: Any) -> list[str]:
    if get_origin(annotation) is Literal:
        return [str(value) for value in get_args(annotation)]
    return [word for part in get_args(annotation) for word in _words(part)]


def _limits(info: FieldInfo) -> str:
    names = {limits.Gt: ("gt", ">"), limits.Ge: ("ge", "≥"), limits.Lt: ("lt", "<"),
             limits.Le: ("le", "≤"), limits.MultipleOf: ("multiple_of", "multiple of")}  # fmt: skip
    return f",{_FIXED}".join(
        f"{sign.replace(' ', _FIXED)}{_FIXED}{getattr(item, name):.12g}"
        for item in _flat(info)
        for kind, (name, sign) in names.items()
        if isinstance(item, kind)
    )


def _flat(info: FieldInfo) -> Iterator[Any]:
    """Yield the limits of a field, also those of the members of a union (``int | None``)."""
    yield from info.metadata
    for part in get_args(info.annotation):
        yield from getattr(part, "__metadata__", ())
