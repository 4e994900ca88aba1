"""Tables as data frames that know their units, and the files they are kept in."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from shear_sim.models.interface import Column
from shear_sim.results import FORMAT
from shear_sim.tables import TableError, read_arrow, read_summary, write_arrow, write_whole

if TYPE_CHECKING:
    import pandas as pd


def frame(
    data: "pd.DataFrame | Mapping[str, Any]", columns: Sequence[Column], sort: Sequence[str] = ()
) -> "pd.DataFrame":
    """Return the named columns of ``data``, sorted, with what they are in ``attrs``.

    Parameters
    ----------
    data : DataFrame or mapping
        Holds all of ``columns``, and maybe others.
    columns : sequence of Column
        The columns of the table, in order.
    sort : sequence of str
        Columns to sort by, the first one first; equal rows keep their order.

    Returns
    -------
    DataFrame
        ``attrs["units"]`` and ``attrs["descriptions"]`` hold those of each column.
    """
    import pandas as pd

    table = pd.DataFrame(data)
    if sort:
        table = table.sort_values(list(sort), kind="stable", ignore_index=True)
    table = table[[column.name for column in columns]]
    # A column of words that holds none yet would have no type, and another one tomorrow.
    words = [name for name in table if table[name].dtype.kind == "O"]
    table = table.astype(dict.fromkeys(words, "str"))
    table.attrs = {
        "units": {column.name: column.unit for column in columns},
        "descriptions": {column.name: column.description for column in columns},
    }
    return table


def beside(table: "pd.DataFrame", data: Mapping[str, Any]) -> "pd.DataFrame":
    """Return ``table`` with the columns of ``data`` added, or put in place of those of its own.

    All at once: a frame that grows column by column is slow, and pandas says so from a hundred on.
    """
    import pandas as pd

    new = pd.DataFrame(dict(data), index=table.index)
    kept = [name for name in table if name not in new]
    return pd.concat([table[kept], new], axis=1)


def describe_parameter(sections: Sequence[Any], key: str) -> Column:
    """Return a parameter as a column: unit (in brackets there) and words from its schema.

    The unit of plain numbers is 1, that of words is empty.
    """
    for name in key.split("."):
        fields = [s.model_fields[name] for s in sections if name in s.model_fields]
        options = [o for f in fields for o in (f.annotation, *get_args(f.annotation))]
        sections = [option for option in options if hasattr(option, "model_fields")]
        text = (fields[0].description if fields else None) or ""
    unit = text.partition("[")[2].partition("]")[0]
    if unit in {"", "-"}:
        unit = "1" if any(option in {int, float} for option in options) else ""
    return Column(key, unit, text)


def save(table: "pd.DataFrame", stem: Path) -> None:
    """Write ``<stem>.parquet`` (unit and description in each field's metadata) and ``<stem>.csv``.

    In the CSV, names carry the unit: ``storage_modulus_mean_Pa``.
    """
    import pyarrow as pa

    attrs = table.attrs
    arrays = [pa.array(table[name], from_pandas=True) for name in table]
    fields = [
        pa.field(
            name,
            array.type,
            metadata={"unit": attrs["units"][name], "description": attrs["descriptions"][name]},
        )
        for name, array in zip(table, arrays, strict=True)
    ]
    about = {str(key): attrs[key] for key in attrs if key not in {"units", "descriptions"}}
    whole = pa.Table.from_arrays(arrays, schema=pa.schema(fields))
    write_arrow(stem.with_suffix(".parquet"), whole, {"format": FORMAT, **about})
    names = {name: _with_unit(str(name), attrs["units"][name]) for name in table}
    text = table.rename(columns=names).to_csv(index=False, lineterminator="\n")
    write_whole(stem.with_suffix(".csv"), text.encode())


def _with_unit(name: str, unit: str) -> str:
    spelled = unit.replace("1/", "per_").replace("/", "_per_").replace(" ", "_").replace("^", "")
    return name if unit in {"", "1"} else f"{name}_{spelled}"


def load(path: Path) -> "pd.DataFrame":
    """Read a table that `save` wrote, with its units, as `shear_sim.aggregate` returned it.

    Raises
    ------
    TableError
        If it is missing or damaged.
    """
    try:
        table = read_arrow(path)
    except TableError as error:
        msg = f"{error}: `shear-sim aggregate RESULTS` makes it again"
        raise TableError(msg) from error
    frame: pd.DataFrame = table.to_pandas()
    about = {key: value for key, value in read_summary(path).items() if key != "format"}
    metadata = {field.name: field.metadata or {} for field in table.schema}
    frame.attrs = about | {
        "units": {name: m.get(b"unit", b"").decode() for name, m in metadata.items()},
        "descriptions": {name: m.get(b"description", b"").decode() for name, m in metadata.items()},
    }
    return frame
