"""Headers of the output files of particleShear, and the files that make up a run.

What a header says in a misleading way, and how it is read: the rest after the shear is taken from
the script's line, since the block of results prints the one before; amplitudes from the function
call, since the block prints percent; the small radius from the large one and the size ratio, since
the printed one has another ratio. Numbers may have exponents. What old versions did not print has
the value that they used (`DEFAULTS`).
"""

import contextlib
import gzip
import hashlib
import math
import re
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from shear_sim.document import NOTHING, Problem

HEAD_BYTES = 65_536  # headers have about 4,000
HEAD_LINES = 200
MARKER = re.compile(r"Detailed[ \w].*data")

#: What runs of versions without these arguments did.
DEFAULTS: dict[str, Any] = {
    "avoid_horizontal_angle_degree": 0.0,
    "relative_transversal_link_strength": 1.0,
    "interface_reenforcement_central": 1.0,
    "interface_reenforcement_tangential": 1.0,
    "cut_top_bottom": True,
    "doCutByTriangulation": False,
    "remove_link_fraction": 0.0,
    "edge_fuzziness": 0.0,
    "avoid_height_spanning_particles": False,
}
_ARGUMENTS: dict[str, type] = {
    "do_permanent_links": bool,
    "cut_lines": int,
    "N": int,
    "packing_fraction": float,
    "bimodal_factor": float,
    "amplitude": float,
    "Young_modulus_spheres": float,
    "density": float,
    "mu": float,
    "relative_viscosity": float,
    "relative_frequency": float,
    "relative_transversal_link_strength": float,
    "central_repulsion_coefficient": float,
    "avoid_horizontal_angle_degree": float,
    "avoid_height_spanning_particles": bool,
    "interface_reenforcement_central": float,
    "interface_reenforcement_tangential": float,
    "keep_viscosity_coefficients_constant": bool,
    "cut_top_bottom": bool,
    "doCutByTriangulation": bool,
    "remove_link_fraction": float,
    "edge_fuzziness": float,
}
#: Other lines: pattern of the value, its type, and whether it may be missing.
_LINES: dict[str, tuple[str, type, bool]] = {
    "pre_periods": (r"baseline_pre_periods = (.*)", float, False),
    "post_periods": (r"baseline_post_periods = (.*)", float, False),
    "periods": (r"runSimulation\(periods=([^,)]*)", float, False),
    "cool_factor": (r"runSimulation\(.*cool_factor=([^,)]*)", float, False),
    "width": (r"size_x =(.*)micrometers", float, False),
    "height": (r"size_y =(.*)micrometers", float, False),
    "large_radius": (r"\br1=.*r2=(.*)", float, False),
    "removed_fraction": (r"Actual fraction of randomly removed .* = (.*)\[-\]", float, True),
    "time_step": (r"Time step = (.*)s", float, False),
    "frequency": (r"Frequency = (.*)Hz", float, False),
    "G'": (r"G'=(.*)Pa", float, False),
    "G''": (r"G''=(.*)Pa", float, False),
    "G'(by surface force)": (r"G'\(by surface force\)=(.*)Pa", float, True),
    "G''(by surface force)": (r"G''\(by surface force\)=(.*)Pa", float, True),
}
_POSITIVE = {"time_step", "frequency"}  # what the sections of our studies do not check


class LegacyError(Exception):
    """Files that are no whole runs of particleShear: all problems at once."""

    def __init__(self, problems: Iterable[Problem], note: str = "") -> None:
        self.problems = tuple(problems)
        number = len(self.problems)
        title = f"{number} problem{'s' if number != 1 else ''} with the files to import"
        super().__init__("\n".join([title, *(f"  {p}" for p in self.problems), note]).rstrip())


class Source(NamedTuple):
    """Where one run lies: its header and its table, which may be one file."""

    header: Path
    table: Path


@dataclass(frozen=True)
class Header:
    """The header of one run.

    Attributes
    ----------
    source : Source
        Its files.
    values : dict
        The arguments of the program by their names there, and what else it says, in its units.
    lines : dict
        Where they stand, from 1.
    end : int
        The last line of the header.
    identity : str
        16 hexadecimal digits of the SHA-256 of the header, blank space apart. A header ends with
        results of 16 digits, from a packing drawn anew at every run, so no two runs share one.
    assumed : tuple of str
        Arguments that it does not print; see `DEFAULTS`.
    """

    source: Source
    values: dict[str, Any] = field(repr=False)
    lines: dict[str, int] = field(repr=False)
    end: int
    identity: str
    assumed: tuple[str, ...] = ()


def find_runs(files: Iterable[Path]) -> tuple[list[Header], list[Problem]]:
    """Return the headers of all runs in ``files``, and what is wrong with the other files.

    Parameters
    ----------
    files : iterable of Path
        Text files (also ``.txt.gz``), split ones (header, table or both), or folders, which stand
        for all such files in them.
    """
    headers: dict[str, Header] = {}
    problems: list[Problem] = []
    seen: set[Path] = set()
    for path in _expanded(files, problems):
        start = _header_of(path)
        if start in seen:
            continue  # both halves of a split run are given
        seen.add(start)
        try:
            header = read_header(start)
        except LegacyError as error:
            problems += error.problems
            continue
        first = headers.setdefault(header.identity, header)
        if first is not header:
            message = f"the same run as {first.source.header} (equal headers): give one of them"
            problems.append(Problem(start, None, "", NOTHING, message))
    return list(headers.values()), problems


def _expanded(files: Iterable[Path], problems: list[Problem]) -> Iterator[Path]:
    """Yield the files, those of a folder for the folder."""
    for path in files:
        if not path.is_dir():
            yield path
            continue
        inside = sorted(p for p in path.iterdir() if p.name.endswith((".txt", ".txt.gz", ".rda")))
        if not inside:
            message = "no .txt, .txt.gz or .rda file in this folder"
            problems.append(Problem(path, None, "", NOTHING, message))
        yield from inside


def _header_of(path: Path) -> Path:
    """Return the file with the header of the run that ``path`` belongs to."""
    if path.suffix == ".rda":
        return path.with_name(f"header_{path.stem.removeprefix('stress_')}.txt")
    return path


def read_header(path: Path) -> Header:
    """Read the header of a run.

    Raises
    ------
    LegacyError
        If the file is no output of particleShear, was written by a run that did not end, or lacks
        the table; with all keys that are missing or no numbers.
    """
    with complaining(path), (gzip.open if path.suffix == ".gz" else open)(path, "rb") as file:
        text = file.read(HEAD_BYTES).decode(errors="replace")
    lines = text.split("\n")
    end = next((n for n, line in enumerate(lines[:HEAD_LINES]) if MARKER.search(line)), None)
    if end is None:
        message = (
            f"no line `Detailed stress tensor data` in the first {HEAD_LINES} lines: not an output "
            "of particleShear, or of a run that did not end"
        )
        raise fault(path, None, message)
    values, where, assumed, problems = _parse(path, lines[:end])
    table = path
    if not any(line.strip() for line in lines[end + 1 :]):
        table = path.with_name(f"stress_{path.stem.removeprefix('header_')}.rda")
        if not table.is_file():
            message = (
                f"nothing follows: saved without the table, or split by R without {table.name} "
                "beside it"
            )
            problems.append(Problem(path, end + 1, "", NOTHING, message))
    if problems:
        raise LegacyError(problems)
    kept = "\n".join(line.strip() for line in lines[: end + 1] if line.strip())
    identity = hashlib.sha256(b"particleShear\n" + kept.encode()).hexdigest()[:16]
    return Header(Source(path, table), values, where, end + 1, identity, assumed)


def _parse(
    path: Path, lines: Sequence[str]
) -> tuple[dict[str, Any], dict[str, int], tuple[str, ...], list[Problem]]:
    """Return the values of a header, their lines, what is assumed and what is wrong."""
    values: dict[str, Any] = {}
    where: dict[str, int] = {}
    assumed: list[str] = []
    problems: list[Problem] = []
    call = next((n for n, line in enumerate(lines) if re.search(r"\w\(.*\bmu=", line)), None)
    # The folder of the run comes first and may hold anything: the last mention counts.
    given = {} if call is None else dict(re.findall(r"[(,](\w+)=([^,)]*)", lines[call]))
    found: dict[str, tuple[str, int]] = {}
    if call is not None:
        found = {name: (text, call + 1) for name, text in given.items() if name in _ARGUMENTS}
    for name, (pattern, _, _) in _LINES.items():
        for number, line in enumerate(lines, 1):
            if (match := re.search(rf"(?<![\w']){pattern}", line)) is not None:
                found[name] = (match[1], number)
                break
    kinds = _ARGUMENTS | {name: kind for name, (_, kind, _) in _LINES.items()}
    for name, kind in kinds.items():
        if name in found:
            text, where[name] = found[name]
            try:
                values[name] = _value(name, text.strip(), kind)
            except ValueError as error:
                shown: object = text.strip()
                with contextlib.suppress(ValueError):
                    shown = float(text)
                problems.append(Problem(path, where[name], name, shown, str(error)))
        elif name in DEFAULTS:
            values[name] = DEFAULTS[name]
            assumed.append(name)
        elif name not in _LINES or not _LINES[name][2]:
            at, place = ("the header", None) if call is None else ("the function call", call + 1)
            if name in _LINES:
                at, place = "the header", None
            problems.append(Problem(path, place, name, NOTHING, f"{at} does not hold it"))
    return values, where, tuple(assumed), problems


def _value(name: str, text: str, kind: type) -> Any:
    """Return a value of its type; the moduli of a run that blew up are not finite."""
    if kind is bool:
        if text not in {"True", "False"}:
            msg = "must be True or False"
            raise ValueError(msg)
        return text == "True"
    msg = f"must be a {'whole' if kind is int else 'finite'} number"
    try:
        value = float(text)
    except ValueError:
        raise ValueError(msg) from None
    if not math.isfinite(value):
        if name.startswith("G"):
            return value
        raise ValueError(msg)
    if kind is int and not value.is_integer():
        raise ValueError(msg)
    if name in _POSITIVE and value <= 0:
        msg = "must be above 0"
        raise ValueError(msg)
    return kind(value)


def fault(path: Path, line: int | None, message: str) -> LegacyError:
    """Return the one problem with a file as an error."""
    return LegacyError([Problem(path, line, "", NOTHING, message)])


@contextlib.contextmanager
def complaining(path: Path) -> Iterator[None]:
    """Turn what the system says about a file into a problem with it."""
    try:
        yield
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or error
        raise fault(path, None, f"cannot be read ({reason})") from None
