"""Tables of the output files of particleShear: what is kept of them, and that all of it is right.

A table has 42 columns and a row per step. What is kept are the stored columns of model `microgel`;
the others follow from them, as its derived columns do, and are checked.
"""

import gzip
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shear_sim import models
from shear_sim.legacy.headers import Header, complaining, fault

FloatArray = NDArray[np.float64]

MODEL = "microgel"  # of ours: the one that does what the program did

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
        raise fault(path, _line(header, -1), message)
    _check_rows(header, table)
    columns = {name: table[source] for name, source in STORED.items()}
    _check_sums(header, table, columns)
    return columns


def derive(columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the derived columns of a run, which may have blown up: inf − inf is no news."""
    with np.errstate(invalid="ignore"):
        return models.model(MODEL).derive(columns)


def _line(header: Header, row: int) -> int | None:
    """Return the line of a row of the table (from 0; -1: its names); None in a table of R."""
    return None if header.source.table.suffix == ".rda" else header.end + 2 + row


def _text(path: Path, skipped: int) -> dict[str, FloatArray]:
    """Return the table of a text file, after so many lines."""
    import pyarrow as pa
    from pyarrow import csv

    with complaining(path):
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
        raise fault(path, skipped + row, message) from None
    columns = {name: table.column(name) for name in table.column_names}
    for name, column in columns.items():
        if column.null_count:
            row = column.is_null().to_numpy().argmax()
            raise fault(path, skipped + 2 + int(row), f"no number in column {name}")
    return {name: column.to_numpy() for name, column in columns.items()}


def _rda(path: Path) -> dict[str, FloatArray]:
    """Return the table of a file of R."""
    try:
        import rdata
    except ImportError:
        message = "files of R need the package rdata: pip install rdata"
        raise fault(path, None, message) from None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # on encodings and suffixes
        try:
            frame = rdata.read_rda(path)["stress_data"]
            return {str(name): frame[name].to_numpy(np.float64) for name in frame}
        except KeyError:
            message = "no object stress_data in this file of R"
        except Exception as error:  # rdata has no errors of its own
            message = f"cannot be read as a file of R ({error})"
    raise fault(path, None, message)


def _check_rows(header: Header, table: Mapping[str, FloatArray]) -> None:
    """Check that the rows of a table are all that the header promises, in their order."""
    path, values = header.source.table, header.values
    index, rows = table["index"], len(table["index"])
    if (wrong := np.flatnonzero(index != np.arange(rows))).size:
        row = int(wrong[0])
        message = f"row {row} of the table has index {index[row]:g}: lines are missing or doubled"
        raise fault(path, _line(header, row), message)
    step, frequency = values["time_step"], values["frequency"]
    periods = values["periods"] + values["pre_periods"] + values["post_periods"]
    expected = int(periods / frequency / step)
    # The division is the program's own, but for the last bit of what the header prints.
    if abs(rows - expected) > 1:
        message = (
            f"the table ends after {rows:,} rows of {expected:,}: the run did not end, or the file "
            "is cut"
        )
        raise fault(path, _line(header, rows - 1), message)
    late = np.abs(table["t"] - index * step) > 1e-6 * step * (index + 1)
    if late.any():
        row = int(late.argmax())
        message = (
            f"t = {table['t'][row]:g} s after {row} steps of {step:g} s: not the table of this "
            "header"
        )
        raise fault(path, _line(header, row), message)


def _check_sums(
    header: Header, table: Mapping[str, FloatArray], columns: Mapping[str, FloatArray]
) -> None:
    """Check that the columns that are not kept follow from those that are."""
    stresses = [columns[name] for name in columns if name not in {"time", "strain", "strain_rate"}]
    scale = max(float(np.nanmax(np.abs(stress))) for stress in stresses)
    derived = derive(columns)
    for name, source in DEPENDENT.items():
        with np.errstate(invalid="ignore"):
            wrong = np.abs(derived[name] - table[source]) > SUM_TOLERANCE * scale
        if wrong.any():
            row = int(wrong.argmax())
            found, expected = table[source][row], derived[name][row]
            message = (
                f"row {row} of the table: {source} = {found:.8g} is not the sum of the other "
                f"columns, {expected:.8g}"
            )
            raise fault(header.source.table, _line(header, row), message)
