"""Study files: YAML 1.2 with the line of every key, and the report on what is wrong with one."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

Key = tuple[str | int, ...]

MAX_VALUES = 200_000  # of one file, aliases counted at every use

NOTHING = object()  # a problem about no value in particular


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong with a study file, and what would be right."""

    path: Path
    line: int | None
    key: str
    value: object
    message: str

    def __str__(self) -> str:
        """Return ``file:line: key = value: message``."""
        place = f"{self.path}:{self.line}" if self.line else f"{self.path}"
        if not self.key:
            return f"{place}: {self.message}"
        value = "" if self.value is NOTHING else f" = {shown(self.value)}"
        return f"{place}: {self.key}{value}: {self.message}"


class StudyError(Exception):
    """A study that cannot be run as written: all its problems at once.

    Attributes
    ----------
    path : Path
        The study file.
    problems : tuple of Problem
        In the order of the file.
    """

    def __init__(self, path: Path, problems: Iterable[Problem]) -> None:
        self.path = path
        self.problems = tuple(sorted(problems, key=lambda problem: problem.line or 0))
        super().__init__(path, self.problems)

    def __str__(self) -> str:
        """Return the whole report, one line for each problem."""
        number = len(self.problems)
        title = f"{self.path}: {number} problem{'s' if number != 1 else ''}"
        return "\n".join([title, *(f"  {problem}" for problem in self.problems)])


@dataclass(frozen=True)
class Document:
    """A YAML file as plain values, with the line of every key and list item.

    Attributes
    ----------
    data : dict
        Plain values; floats rounded to 12 significant digits.
    lines : dict
        Key path, from the top, to its line (from 1).
    """

    path: Path
    data: dict[str, Any]
    lines: dict[Key, int] = field(repr=False)

    def line(self, key: Key) -> int | None:
        """Return the line of ``key``, or of the innermost section around it."""
        while key and key not in self.lines:
            key = key[:-1]
        return self.lines.get(key)


def dotted(key: Key) -> str:
    """Return a key path as it is written in messages: ``sweep[0].grid.model.friction``."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def round12(value: float) -> float:
    """Return ``value`` rounded to 12 significant digits, and −0 as 0.

    ``linspace(0.8, 0.9, 11)[3]`` is 0.8300000000000001: without rounding, another job than 0.83.
    """
    return float(f"{value:.12g}") + 0.0


_INT = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(
    r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)"
)
_CONSTANTS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL")),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
}


def _scalar(text: str) -> object:
    """Return the value of a plain (unquoted) scalar in the core schema of YAML 1.2."""
    if text in _CONSTANTS:
        return _CONSTANTS[text]
    if _INT.fullmatch(text):
        return int(text, 0) if text[:2] in {"0o", "0x"} else int(text)
    if _FLOAT.fullmatch(text):
        if text[-1] in "fFnN":
            return float(text.replace(".", ""))
        return round12(float(text))
    return text


class _Loader(yaml.SafeLoader):
    """PyYAML's parser without the types of YAML 1.1: it only says which scalars are quoted."""

    def resolve(self, kind: type[yaml.Node], value: str | None, implicit: Any) -> str:  # noqa: ARG002
        if kind is yaml.ScalarNode:
            return "plain" if implicit[0] else "quoted"
        return "mapping" if kind is yaml.MappingNode else "sequence"


class _Builder:
    """Turns the nodes of one file into plain values and keeps the line of every key."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines: dict[Key, int] = {}
        self.problems: list[Problem] = []
        self._values = 0
        self._open: set[int] = set()  # nodes being built: an alias inside its own anchor

    def build(self, node: yaml.Node, key: Key) -> Any:
        """Return the value of ``node``, which stands at ``key``."""
        self._values += 1
        if self._values > MAX_VALUES:
            message = f"more than {MAX_VALUES:,} values, aliases counted at every use"
            raise StudyError(self.path, [Problem(self.path, None, "", NOTHING, message)])
        self.lines.setdefault(key, node.start_mark.line + 1)
        if node.tag not in {"plain", "quoted", "mapping", "sequence"}:
            self._complain(node, key, f"the tag {node.tag} has no meaning in a study: leave it out")
            return None
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node, key)
        if id(node) in self._open:
            self._complain(node, key, "an alias inside its own anchor has no end")
            return None
        self._open.add(id(node))
        value = (
            self._mapping(node, key)
            if isinstance(node, yaml.MappingNode)
            else [self.build(item, (*key, i)) for i, item in enumerate(node.value)]
        )
        self._open.remove(id(node))
        return value

    def _mapping(self, node: yaml.MappingNode, key: Key) -> dict[str, Any]:
        values: dict[str, Any] = {}
        first: dict[str, int] = {}
        for name_node, value_node in node.value:
            line = name_node.start_mark.line + 1
            plain = isinstance(name_node, yaml.ScalarNode) and name_node.tag in {"plain", "quoted"}
            name = self._scalar(name_node, key) if plain else None
            if not isinstance(name, str):
                shown = f"`{name_node.value}`" if isinstance(name_node, yaml.ScalarNode) else "this"
                self._complain(name_node, key, f"{shown} is not a word, so it cannot be a key")
            elif name in values:
                message = f"given twice, in lines {first[name]} and {line}: keep one"
                self._complain(name_node, (*key, name), message)
            else:
                first[name] = line
                self.lines.setdefault((*key, name), line)
                values[name] = self.build(value_node, (*key, name))
        return values

    def _scalar(self, node: yaml.ScalarNode, key: Key) -> object:
        try:
            # "\ud83d\ude00" is one character, as in JSON; half of one could not even be printed.
            text = node.value.encode("utf-16-le", "surrogatepass").decode("utf-16-le")
            return _scalar(text) if node.tag == "plain" else text
        except ValueError as error:  # or an integer of more than 4300 digits
            self._complain(node, key, f"cannot be read ({error})")
            return None

    def _complain(self, node: yaml.Node, key: Key, message: str) -> None:
        line = node.start_mark.line + 1
        self.problems.append(Problem(self.path, line, dotted(key), NOTHING, message))


def read_yaml(content: bytes, path: Path) -> Document:
    """Read a YAML 1.2 file whose top level is a mapping.

    Numbers and booleans follow the core schema: ``1e-3`` is a number, ``017`` is 17, ``12:30``,
    ``on`` and ``yes`` are strings. Anchors and aliases work; tags and merge keys do not.

    Parameters
    ----------
    content : bytes
        The file, UTF-8.
    path : Path
        Its name, for messages.

    Raises
    ------
    StudyError
        If it is not such a file, or a key is given twice.
    """
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        message = f"byte 0x{content[error.start]:02x} is not UTF-8: save the file as UTF-8"
        raise StudyError(path, [Problem(path, line, "", NOTHING, message)]) from None
    builder = _Builder(path)
    try:
        node = yaml.compose(text, Loader=_Loader)
        data = builder.build(node, ()) if node is not None else None
    except yaml.YAMLError as error:
        raise StudyError(path, [_syntax_problem(error, path)]) from None
    except (ValueError, OverflowError) as error:  # PyYAML on "\U99999999"
        message = f"not YAML: {error}"
        raise StudyError(path, [Problem(path, None, "", NOTHING, message)]) from None
    except RecursionError:
        message = "nested too deeply for a study"
        raise StudyError(path, [Problem(path, None, "", NOTHING, message)]) from None
    if builder.problems:
        raise StudyError(path, builder.problems)
    if not isinstance(data, dict):
        what = "is empty" if data is None else f"starts with {shown(data)}"
        message = f"{what}: a study is a mapping, for example `model: {{friction: 0.1}}`"
        raise StudyError(path, [Problem(path, 1, "", NOTHING, message)])
    return Document(path, data, builder.lines)


def _syntax_problem(error: yaml.YAMLError, path: Path) -> Problem:
    line, message = None, str(error)
    if isinstance(error, yaml.MarkedYAMLError):
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else None
        message = ", ".join(part for part in (error.context, error.problem) if part)
        if "'\\t'" in message:
            message += " (indent with spaces, not tabs)"
    return Problem(path, line, "", NOTHING, f"not YAML: {' '.join(message.split())}")


def shown(value: object) -> str:
    """Return ``value`` as the file might hold it, short."""
    if isinstance(value, Mapping):
        text = "{" + ", ".join(f"{key}: {shown(item)}" for key, item in value.items()) + "}"
    elif isinstance(value, list | tuple):
        text = "[" + ", ".join(shown(item) for item in value) + "]"
    elif isinstance(value, bool) or value is None:
        text = {True: "true", False: "false", None: "null"}[value]
    elif isinstance(value, float):
        text = f"{value:.12g}"
        text += ".0" if _INT.fullmatch(text) else ""  # 2.0 is not 2 where a whole number must be
    else:
        try:
            text = " ".join(str(value).split())
            if isinstance(value, str) and not isinstance(_scalar(text), str):
                text = f'"{text}"'  # "0.1" is not 0.1
        except ValueError:  # an integer of more than 4300 digits
            text = "a huge number"
    return text if len(text) <= 60 else text[:57] + "..."
