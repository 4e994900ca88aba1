"""Section: the base of everything that a study file may hold."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

FILLED_IN = ("source", "file_digest")  # by the program, see `Section`


class Section(BaseModel):
    """One section of a study file: frozen, validated as written, unknown keys are errors.

    A field ``file`` is a path beside the study. It never enters a job id: its neighbour ``source``
    (the text) or ``file_digest`` (SHA-256 of the bytes), filled in when a study is read, does.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class Impossible(ValueError):  # noqa: N818 - read as "raise Impossible", a verdict on parameters
    """Values that are right one by one and impossible together.

    Parameters
    ----------
    problems : iterable of (keys, message)
        ``keys`` are dotted, relative to the section that raises; the report shows the line of
        the one that the study changes last.
    """

    def __init__(self, problems: Iterable[tuple[tuple[str, ...], str]]) -> None:
        self.problems = tuple(problems)
        super().__init__("; ".join(message for _, message in self.problems))


@dataclass(frozen=True)
class UnitMistake:
    """A likely mistake behind a value beyond the limit, named in the error message."""

    factor: float  # value as written times factor = value meant
    right: str
    above: float = 0.0  # smaller values are no such mistake


PERCENT = UnitMistake(0.01, "a fraction, not percent", above=1.0)
MICROMETRES = UnitMistake(1e-6, "in metres, not micrometres")


def default_kind(kind: str) -> BeforeValidator:
    """Return a validator for a union of sections that names the member if the file does not."""

    def name_it(value: object) -> object:
        return {"kind": kind} | value if isinstance(value, dict) else value

    return BeforeValidator(name_it)


Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Fraction = Annotated[float, Field(ge=0, le=1), PERCENT]
