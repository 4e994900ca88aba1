"""Output files of the historical program particleShear, read as they are.

A run is one text file: a header, the line ``Detailed stress tensor data`` and a table of 42
columns with a row per step. The analysis in R split it into ``header_<name>.txt``, which ends with
that line, and ``stress_<name>.rda``, which holds the table. Both kinds are read here, into the
stored columns of model ``microgel`` (its derived ones are those of the table, which is checked).

What the header says in a misleading way, and how it is read: the rest after the shear is taken from
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
import warnings
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shear_sim import models
from shear_sim.document import NOTHING, Problem

FloatArray = NDArray[np.float64]

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

_TENSORS = (
    "Love_Weber",
    "peculiar_acceleration_otsuki",
    "from_external_forces",
    "linear_acceleration",
    "unbalanced_linear_forces",
    "tangential_torque",
    "internal_tangential_torque",
    "centrifugal",
    "overall",
)
_SURFACE, _INTERNAL = "stress_measured_at_surface", "shear_stress_internal_stress-tensor"
#: Columns of the table, in its order.
TABLE = (
    "index",
    "t",
    "strain",
    "strain_rate",
    _SURFACE,
    _INTERNAL,
    *(f"stress_tensor_{tensor}_{ab}" for tensor in _TENSORS for ab in ("00", "01", "10", "11")),
)
_XY = {"00": "xx", "01": "xy", "10": "yx", "11": "yy"}
#: Our stored columns, and where they stand in the table.
STORED = {
    "time": "t",
    "strain": "strain",
    "strain_rate": "strain_rate",
    **{f"love_weber_{xy}": f"stress_tensor_Love_Weber_{ab}" for ab, xy in _XY.items()},
    "internal_torque_yx": "stress_tensor_internal_tangential_torque_10",
    **{f"external_{xy}": f"stress_tensor_from_external_forces_{ab}" for ab, xy in _XY.items()},
    "torque_yx": "stress_tensor_tangential_torque_10",
    "centrifugal_xx": "stress_tensor_centrifugal_00",
    **{
        f"peculiar_{_XY[ab]}": f"stress_tensor_peculiar_acceleration_otsuki_{ab}"
        for ab in ("00", "01", "11")
    },
}
#: Columns of the table that follow from those: our name, and where they stand.
DEPENDENT = {
    "shear_stress_internal": _INTERNAL,
    "shear_stress_external": _SURFACE,
    "peculiar_yx": "stress_tensor_peculiar_acceleration_otsuki_10",
    **{
        f"{name}_{xy}": f"stress_tensor_{tensor}_{ab}"
        for name, tensor in (
            ("linear_acceleration", "linear_acceleration"),
            ("unbalanced_force", "unbalanced_linear_forces"),
            ("torque", "tangential_torque"),
            ("internal_torque", "internal_tangential_torque"),
            ("centrifugal", "centrifugal"),
            ("overall", "overall"),
        )
        for ab, xy in _XY.items()
        if f"{name}_{xy}" not in STORED
    },
}
#: Largest difference of a dependent column from its sum, relative to the largest stress. The
#: program adds in another order than we do; a digit lost is far more.
SUM_TOLERANCE = 1e-9


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
    with _complaining(path), (gzip.open if path.suffix == ".gz" else open)(path, "rb") as file:
        text = file.read(HEAD_BYTES).decode(errors="replace")
    lines = text.split("\n")
    end = next((n for n, line in enumerate(lines[:HEAD_LINES]) if MARKER.search(line)), None)
    if end is None:
        message = (
            f"no line `Detailed stress tensor data` in the first {HEAD_LINES} lines: not an output "
            "of particleShear, or of a run that did not end"
        )
        raise _error(path, None, message)
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


def _error(path: Path, line: int | None, message: str) -> LegacyError:
    return LegacyError([Problem(path, line, "", NOTHING, message)])


@contextlib.contextmanager
def _complaining(path: Path) -> Iterator[None]:
    """Turn what the system says about a file into a problem with it."""
    try:
        yield
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or error
        raise _error(path, None, f"cannot be read ({reason})") from None


def read_series(header: Header) -> dict[str, FloatArray]:
    """Read the table of a run.

    Returns
    -------
    dict of (R,) arrays
        The stored columns of model ``microgel`` that the table has (`STORED`), in SI units: all
        but those of the periodic tensor, which the program did not compute. The dependent columns
        of the table are those that `derive` gives back, to `SUM_TOLERANCE`.

    Raises
    ------
    LegacyError
        If the table is damaged, lacks columns or rows, or is not that of the header.
    """
    path = header.source.table
    table = _rda(path) if path.suffix == ".rda" else _text(path, header.end)
    # R makes names of its own kind.
    table = {name.replace("stress.tensor", "stress-tensor"): table[name] for name in table}
    if missing := [name for name in TABLE if name not in table]:
        message = f"the table lacks {', '.join(missing)}"
        raise _error(path, _line(header, -1), message)
    _check_rows(header, table)
    columns = {name: table[source] for name, source in STORED.items()}
    _check_sums(header, table, columns)
    return columns


def _line(header: Header, row: int) -> int | None:
    """Return the line of a row of the table (from 0; -1: its names); None in a table of R."""
    return None if header.source.table.suffix == ".rda" else header.end + 2 + row


def _text(path: Path, skipped: int) -> dict[str, FloatArray]:
    """Return the table of a text file, after so many lines."""
    import pyarrow as pa
    from pyarrow import csv

    with _complaining(path):
        content = path.read_bytes()
        content = gzip.decompress(content) if path.suffix == ".gz" else content
    start = 0
    for _ in range(skipped):
        start = content.index(b"\n", start) + 1
    torn: list[int] = []

    def refuse(row: Any) -> str:
        torn.append(row.number)
        return "error"

    body = pa.BufferReader(pa.py_buffer(content)[start:] if start else content)
    try:
        table = csv.read_csv(
            body,
            read_options=csv.ReadOptions(use_threads=False),
            parse_options=csv.ParseOptions(
                delimiter="\t", quote_char=False, invalid_row_handler=refuse
            ),
            # Without it 0 in the first rows would make whole numbers of a column.
            convert_options=csv.ConvertOptions(
                column_types=dict.fromkeys((*TABLE, _INTERNAL.replace("-", ".")), pa.float64()),
                null_values=[""],
            ),
        )
    except pa.ArrowInvalid as error:
        row = torn[0] if torn else int((re.search(r"Row #(\d+)", str(error)) or [0, 0])[1])
        message = "the table is torn off in this line" if torn else f"the table is damaged: {error}"
        raise _error(path, skipped + row, message) from None
    columns = {name: table.column(name) for name in table.column_names}
    for name, column in columns.items():
        if column.null_count:
            row = column.is_null().to_numpy().argmax()
            raise _error(path, skipped + 2 + int(row), f"no number in column {name}")
    return {name: column.to_numpy() for name, column in columns.items()}


def _rda(path: Path) -> dict[str, FloatArray]:
    """Return the table of a file of R."""
    try:
        import rdata
    except ImportError:
        message = "files of R need the package rdata: pip install 'shear-sim[legacy]'"
        raise _error(path, None, message) from None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # on encodings and suffixes
        try:
            frame = rdata.read_rda(path)["stress_data"]
            return {str(name): frame[name].to_numpy(np.float64) for name in frame}
        except KeyError:
            message = "no object stress_data in this file of R"
        except Exception as error:  # rdata has no errors of its own
            message = f"cannot be read as a file of R ({error})"
    raise _error(path, None, message)


def _check_rows(header: Header, table: Mapping[str, FloatArray]) -> None:
    """Check that the rows of a table are all that the header promises, in their order."""
    path, values = header.source.table, header.values
    index, rows = table["index"], len(table["index"])
    if (wrong := np.flatnonzero(index != np.arange(rows))).size:
        row = int(wrong[0])
        message = f"row {row} of the table has index {index[row]:g}: lines are missing or doubled"
        raise _error(path, _line(header, row), message)
    step, frequency = values["time_step"], values["frequency"]
    periods = values["periods"] + values["pre_periods"] + values["post_periods"]
    expected = int(periods / frequency / step)
    # The division is the program's own, but for the last bit of what the header prints.
    if abs(rows - expected) > 1:
        message = (
            f"the table ends after {rows:,} rows of {expected:,}: the run did not end, or the file "
            "is cut"
        )
        raise _error(path, _line(header, rows - 1), message)
    late = np.abs(table["t"] - index * step) > 1e-6 * step * (index + 1)
    if late.any():
        row = int(late.argmax())
        message = (
            f"t = {table['t'][row]:g} s after {row} steps of {step:g} s: not the table of this "
            "header"
        )
        raise _error(path, _line(header, row), message)


def _check_sums(
    header: Header, table: Mapping[str, FloatArray], columns: Mapping[str, FloatArray]
) -> None:
    """Check that the columns that are not kept follow from those that are."""
    derived = models.model("microgel").derive(columns)
    with np.errstate(invalid="ignore"):  # a run that blew up: inf - inf
        scale = max(float(np.nanmax(np.abs(values))) for values in columns.values())
    for name, source in DEPENDENT.items():
        difference = np.abs(derived[name] - table[source])
        if (wrong := difference > SUM_TOLERANCE * scale).any():
            row = int(wrong.argmax())
            found, expected = table[source][row], derived[name][row]
            message = (
                f"row {row} of the table: {source} = {found:.8g} is not the sum of the other "
                f"columns, {expected:.8g}"
            )
            raise _error(header.source.table, _line(header, row), message)
