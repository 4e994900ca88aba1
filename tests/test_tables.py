import json
import os
import subprocess
import sys

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow.parquet as pq
import pytest

from shear_sim import tables

FIELDS = [
    ("time", "s", "time from the start"),
    ("stress", "Pa", "shear stress"),
    ("z", "1", "not recorded"),
]
SUMMARY = {"job": {"id": "ab"}, "moduli": {"storage": 0.1 + 0.2, "loss": None}, "n": [1, 2]}


@pytest.fixture
def columns():
    rng = np.random.default_rng(1)
    return {"time": np.arange(50) * 1e-3, "stress": rng.normal(size=50) * 1e3}


def test_a_table_comes_back_to_the_bit(tmp_path, columns):
    path = tmp_path / "a.parquet"
    columns["stress"][3] = np.nan
    tables.write_table(path, columns, FIELDS, SUMMARY)
    back = tables.read_table(path)
    assert list(back.columns) == ["time", "stress"]
    for name, values in columns.items():
        assert back.columns[name].tobytes() == values.tobytes()
    assert back.summary == tables.read_summary(path) == SUMMARY
    assert list(tables.read_table(path, ["stress"]).columns) == ["stress"]


def test_units_and_summary_lie_where_other_programs_find_them(tmp_path, columns):
    path = tmp_path / "a.parquet"
    tables.write_table(path, columns, FIELDS, SUMMARY)
    field = pq.read_schema(path).field("stress")
    assert field.metadata[b"unit"] == b"Pa"
    assert field.metadata[b"description"] == b"shear stress"
    assert json.loads(pq.read_metadata(path).metadata[b"shear_sim"]) == SUMMARY
    expected = columns["stress"]
    assert np.array_equal(pd.read_parquet(path)["stress"], expected)
    assert np.array_equal(pl.read_parquet(path)["stress"].to_numpy(), expected)
    found = duckdb.sql(f"select stress from '{path}'").fetchnumpy()["stress"]  # noqa: S608
    assert np.array_equal(found, expected)


def test_the_same_table_has_the_same_bytes(tmp_path, columns):
    for name in "ab":
        tables.write_table(tmp_path / name, columns, FIELDS, SUMMARY)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_a_column_without_a_unit_is_refused(tmp_path, columns):
    with pytest.raises(KeyError, match="stress"):
        tables.write_table(tmp_path / "a", columns, FIELDS[:1], {})
    assert list(tmp_path.iterdir()) == []


def test_numbers_that_json_lacks_are_refused(tmp_path, columns):
    with pytest.raises(ValueError, match="not JSON compliant"):
        tables.write_table(tmp_path / "a", columns, FIELDS, {"x": float("nan")})
    assert json.loads(tables.to_json({"x": np.float64(0.1), "y": np.arange(2)})) == {
        "x": 0.1,
        "y": [0, 1],
    }


@pytest.mark.parametrize("keep", [0, 10, 0.5, 0.99])
def test_a_truncated_table_is_an_error_with_its_name(tmp_path, columns, keep):
    path = tmp_path / "a.parquet"
    tables.write_table(path, columns, FIELDS, SUMMARY)
    data = path.read_bytes()
    path.write_bytes(data[: int(keep if keep >= 1 else keep * len(data))])
    with pytest.raises(tables.TableError, match=r"a\.parquet"):
        tables.read_table(path)
    with pytest.raises(tables.TableError, match=r"a\.parquet"):
        tables.read_summary(path)


def test_a_foreign_or_missing_table_is_an_error_with_its_name(tmp_path, columns):
    pd.DataFrame(columns).to_parquet(tmp_path / "foreign.parquet")
    with pytest.raises(tables.TableError, match=r"foreign\.parquet.*or of another program"):
        tables.read_summary(tmp_path / "foreign.parquet")
    with pytest.raises(tables.TableError, match="no such file"):
        tables.read_table(tmp_path / "missing.parquet")
    tables.write_table(tmp_path / "ours.parquet", columns, FIELDS, SUMMARY)
    with pytest.raises(tables.TableError, match="no column density"):
        tables.read_table(tmp_path / "ours.parquet", ["density"])


def test_a_failed_write_leaves_nothing(tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    (tmp_path / "a").write_bytes(b"before")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        tables.write_whole(tmp_path / "a", b"after")
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
    assert (tmp_path / "a").read_bytes() == b"before"


def test_partial_files_of_the_dead_are_removed_and_of_the_living_kept(tmp_path):
    code = (
        "import os, sys; from pathlib import Path; from shear_sim import tables\n"
        "os.fsync = lambda descriptor: os._exit(9)\n"
        "tables.write_whole(Path(sys.argv[1]), b'half')"
    )
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", code, tmp_path / "a"], env=env, check=False)
    [killed] = tmp_path.iterdir()
    assert killed.name.endswith(".partial")
    living = tmp_path / f".b~{tables._HOST}~{os.getpid()}~00000000.partial"
    foreign = tmp_path / ".c~elsewhere~1~00000000.partial"
    old = tmp_path / ".d~elsewhere~1~00000000.partial"
    for path in (living, foreign, old, tmp_path / "whole"):
        path.write_bytes(b"x")
    os.utime(old, (0, 0))
    assert tables.remove_partial(tmp_path) == 2
    assert sorted(tmp_path.iterdir()) == sorted([living, foreign, tmp_path / "whole"])


def test_every_bit_of_a_table_is_under_its_checksum(tmp_path):
    """Each flipped bit is found, wherever it is: one in every byte of a small table.

    And all of those in the name of the checksum and around it.
    """
    path = tmp_path / "a.parquet"
    tables.write_table(path, {"time": np.arange(3.0)}, [("time", "s", "time")], {"answer": 42})
    whole = path.read_bytes()
    name = whole.rfind(b"shear_sim_sha256")
    around = range(name - 4, name + len(b"shear_sim_sha256") + 4)
    flips = {(place, place % 8) for place in range(len(whole))}
    flips |= {(place, bit) for place in around for bit in range(8)}
    missed = []
    for place, bit in sorted(flips):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << bit
        path.write_bytes(damaged)
        try:
            tables.read_table(path)
        except tables.TableError:
            continue
        missed.append((place, bit))
    assert missed == []
    path.write_bytes(whole)
    assert tables.read_table(path).summary == {"answer": 42}
