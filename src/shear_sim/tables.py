"""Files that exist only whole, and Parquet tables that carry units and a summary.

Each column's field metadata holds its ``unit`` and ``description``; the file's metadata holds,
under ``shear_sim``, one JSON document: the summary of what the table is about. Under
``shear_sim_sha256`` it holds the checksum of the whole file (with zeros in the place of it), which
every reading verifies: other programs see one more word.
"""

import contextlib
import hashlib
import json
import os
import platform
import secrets
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pyarrow

SUMMARY_KEY = "shear_sim"
CHECKSUM_KEY = "shear_sim_sha256"
ABANDONED_SECONDS = 86_400.0  # age at which a partial file of another host is nobody's any more

_HOST = platform.node()
_NO_CHECKSUM = b"0" * 64


class TableError(Exception):
    """A file is not a whole table of shear-sim; says which file and what is wrong with it."""


class Table(NamedTuple):
    """One table in memory: its columns, each of shape (rows,), and its summary."""

    columns: dict[str, NDArray[Any]]
    summary: dict[str, Any]


def write_whole(path: Path, data: bytes) -> None:
    """Write a file under a temporary name, then rename it: ``path`` is whole or absent.

    Safe against kill -9, power loss and two processes that write the same path at once (the last
    one wins; both wrote the same).

    Raises
    ------
    OSError
        If the folder is missing, full or read-only; nothing is left behind then.
    """
    partial = path.with_name(f".{path.name}~{_HOST}~{os.getpid()}~{secrets.token_hex(4)}.partial")
    descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        with open(descriptor, "wb") as file:  # noqa: PTH123 - a descriptor, not a path
            file.write(data)
            file.flush()
            os.fsync(descriptor)
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise
    _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """Make a rename survive a power loss."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        # Some network filesystems refuse to sync a folder; the file itself is synced already.
        with contextlib.suppress(OSError):
            os.fsync(descriptor)
    finally:
        os.close(descriptor)


def remove_partial(folder: Path) -> int:
    """Remove what killed writers left in ``folder``; return how many files.

    Only files of dead processes of this host, and any that are older than a day, go.
    """
    removed = 0
    for path in folder.glob(".*~*~*~*.partial"):
        _, host, pid, _ = path.name.rsplit("~", 3)
        try:
            dead = host == _HOST and not _alive(int(pid))
            if dead or path.stat().st_mtime < time.time() - ABANDONED_SECONDS:
                path.unlink()
                removed += 1
        except FileNotFoundError:  # its writer has finished, or another sweep cleans too
            continue
    return removed


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # it lives and belongs to somebody else
        return True
    return True


def to_json(value: Any) -> str:
    """Return compact JSON; NumPy scalars and arrays become numbers and lists.

    Raises
    ------
    ValueError
        For NaN and infinities, which JSON does not have: say null instead.
    """
    return json.dumps(value, default=_plain, allow_nan=False, separators=(",", ":"))


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    msg = f"{value!r} is not JSON"
    raise TypeError(msg)


def write_table(
    path: Path,
    columns: Mapping[str, Any],
    fields: Iterable[tuple[str, str, str]],
    summary: Mapping[str, Any],
) -> None:
    """Write a Parquet table whole, with units in its fields and the summary in its metadata.

    The same columns and summary give the same bytes.

    Parameters
    ----------
    columns : mapping of (rows,) arrays
        Written in their own type: float64 stays float64 to the bit.
    fields : iterable of (name, unit, description)
        What the columns are; those not in ``columns`` are left out, the order is kept.
    summary : mapping
        JSON-ready.

    Raises
    ------
    KeyError
        If a column has no field.
    """
    import pyarrow as pa

    described = [field for field in fields if field[0] in columns]
    if unknown := set(columns) - {name for name, _, _ in described}:
        msg = f"no unit and description for column(s) {', '.join(sorted(unknown))}"
        raise KeyError(msg)
    arrays = [_arrow(columns[name]) for name, _, _ in described]
    schema = pa.schema(
        [
            pa.field(name, array.type, metadata={"unit": unit, "description": text})
            for (name, unit, text), array in zip(described, arrays, strict=True)
        ]
    )
    write_arrow(path, pa.Table.from_arrays(arrays, schema=schema), summary)


def _arrow(values: Any) -> "pyarrow.Array":
    import pyarrow as pa

    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        # As it lies in memory: pyarrow.array would import pandas, in each worker, to look at it.
        series = np.ascontiguousarray(values)
        return pa.Array.from_buffers(pa.float64(), len(series), [None, pa.py_buffer(series)])
    return pa.array(values)


def write_arrow(path: Path, table: "pyarrow.Table", summary: Mapping[str, Any]) -> None:
    """Write an Arrow table whole, with the summary in the file's metadata."""
    import pyarrow as pa
    from pyarrow import parquet

    sink = pa.BufferOutputStream()
    # Measured series hardly ever repeat a value: a dictionary costs time and saves nothing. Their
    # first bytes are alike, though: sorted by byte, LZ4 makes them as small as Zstandard would
    # unsorted, and writes and reads them in half the time.
    words = [field.name for field in table.schema if pa.types.is_string(field.type)]
    numbers = [field.name for field in table.schema if pa.types.is_floating(field.type)]
    with parquet.ParquetWriter(
        sink,
        table.schema,
        compression="lz4",
        use_dictionary=words,
        use_byte_stream_split=numbers,
    ) as writer:
        writer.write_table(table)
        # Not in the schema's metadata, of which the file would hold a second copy.
        writer.add_key_value_metadata(
            {SUMMARY_KEY: to_json(summary), CHECKSUM_KEY: _NO_CHECKSUM.decode()}
        )
    content = sink.getvalue().to_pybytes()
    head, _, tail = _parted(content)
    write_whole(path, head + hashlib.sha256(content).hexdigest().encode() + tail)


def _parted(content: bytes) -> tuple[bytes, bytes, bytes]:
    """Return what is before the checksum of a table, the checksum (or nothing) and the rest."""
    key = CHECKSUM_KEY.encode()
    found = content.rfind(key)
    if found < 0:
        return content, b"", b""
    begin = found + len(key) + 2  # type and length of the value
    end = begin + len(_NO_CHECKSUM)
    return content[:begin], content[begin:end], content[end:]


def _content(path: Path) -> bytes:
    """Return the bytes of a table whose checksum is right.

    Raises
    ------
    TableError
        If the file cannot be read, is of another program, or any bit is not what was written.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise _damaged(path, error) from error
    head, checksum, tail = _parted(content)
    if not checksum:
        msg = f"{path}: cannot be read as a table of shear-sim: damaged, or of another program"
        raise TableError(msg)
    if checksum != hashlib.sha256(head + _NO_CHECKSUM + tail).hexdigest().encode():
        msg = f"{path}: damaged: its checksum is wrong"
        raise TableError(msg)
    return content


def read_table(path: Path, names: Iterable[str] | None = None) -> Table:
    """Read a table of :func:`write_table`, or only its columns ``names``.

    Raises
    ------
    TableError
        If the file is damaged, is not a table of shear-sim or lacks a column.
    """
    content = _content(path)
    table = _arrow_of(content, path, names)
    columns = {name: table.column(name).to_numpy() for name in table.column_names}
    return Table(columns, _summary_of(content, path))


def read_arrow(path: Path, names: Iterable[str] | None = None) -> "pyarrow.Table":
    """Read the columns of a table as Arrow; see :func:`read_table`."""
    return _arrow_of(_content(path), path, names)


def _arrow_of(content: bytes, path: Path, names: Iterable[str] | None) -> "pyarrow.Table":
    import pyarrow as pa
    from pyarrow import parquet

    wanted = None if names is None else list(names)
    try:
        with parquet.ParquetFile(pa.BufferReader(content)) as file:
            if missing := set(wanted or ()) - set(file.schema_arrow.names):
                msg = f"{path}: no column {', '.join(sorted(missing))}"
                raise TableError(msg)
            # One core per job and per command: threads would also keep a fork from being safe.
            return file.read(wanted, use_threads=False)
    except (pa.ArrowException, OSError) as error:
        raise _damaged(path, error) from error


def read_summary(path: Path) -> dict[str, Any]:
    """Read only the summary of a table.

    Raises
    ------
    TableError
        If the file is damaged or is not a table of shear-sim.
    """
    return _summary_of(_content(path), path)


def _summary_of(content: bytes, path: Path) -> dict[str, Any]:
    import pyarrow as pa
    from pyarrow import parquet

    try:
        metadata = parquet.read_metadata(pa.BufferReader(content)).metadata
        summary: dict[str, Any] = json.loads(metadata[SUMMARY_KEY.encode()])
    except (pa.ArrowException, OSError) as error:
        raise _damaged(path, error) from error
    return summary


def _damaged(path: Path, error: Exception) -> TableError:
    if isinstance(error, FileNotFoundError):
        return TableError(f"{path}: no such file")
    return TableError(f"{path}: cannot be read as a table ({error})")
