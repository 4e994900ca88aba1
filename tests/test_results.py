import os
import time

import numpy as np
import pyarrow as pa
import pytest
from kelvin_voigt import COLUMNS
from tools import write_study

from shear_sim import results as module
from shear_sim.plan import make_plan
from shear_sim.results import Failure, Results, ResultsError, find_job
from shear_sim.study import load_study
from shear_sim.tables import write_arrow, write_table


@pytest.fixture
def results(tmp_path, monkeypatch):
    """An empty results folder on a disk that never fails, so that writing is fast."""
    monkeypatch.setattr(os, "fsync", lambda _: None)
    made = Results(tmp_path / "results/study")
    for folder in (made.jobs, made.failed):
        folder.mkdir(parents=True)
    return made


def write_job(results, job, storage=1.0, **more):
    summary = {
        "format": 1,
        "job": {"id": job, "point": job[:8], "replicate": 0, "seed": 3, "physics_version": 1},
        "parameters": {"shear": {"strain_amplitude": 0.1}, "height": None},
        "moduli": {"periodic": {"storage": storage, "storage_n": [1, 2.5]}},
        "steps": [1, 2, 3],
        "run": {"cpu_s": 0.5},
        **more,
    }
    columns = {column.name: np.zeros(3) for column in COLUMNS}
    write_table(results.job_file(job), columns, COLUMNS, summary)


def ids(count):
    return [f"{number:016x}" for number in range(count)]


def test_the_index_has_one_row_a_job_and_keeps_types(results):
    write_job(results, "b" * 16, storage=2)  # an integer where the other has a float
    write_job(results, "a" * 16, storage=1.5, flags={"noisy": True})
    table = results.index()
    assert table.column("job").to_pylist() == ["a" * 16, "b" * 16]
    assert table.column("moduli.periodic.storage").to_pylist() == [1.5, 2.0]
    assert table.column("shear.strain_amplitude").to_pylist() == [0.1, 0.1]
    assert table.column("flags.noisy").to_pylist() == [True, None]
    assert table.column("bytes").to_pylist()[0] == results.job_file("a" * 16).stat().st_size
    assert table.column("moduli.periodic.storage_n").to_pylist() == [[1.0, 2.5]] * 2
    assert "steps" not in table.column_names  # other lists are left to the job's own file


def test_only_new_results_are_read_and_deleted_ones_go(results, monkeypatch):
    read = []
    original = module.read_summary
    monkeypatch.setattr(module, "read_summary", lambda path: read.append(path) or original(path))
    names = ids(4)
    for job in names[:3]:
        write_job(results, job)
    assert results.index().column("job").to_pylist() == names[:3]
    results.job_file(names[0]).unlink()
    write_job(results, names[3])
    read.clear()
    assert results.index().column("job").to_pylist() == names[1:]
    assert read == [results.index_file, results.job_file(names[3])]
    for path in results.jobs.iterdir():
        path.unlink()
    assert results.index().num_rows == 0


@pytest.mark.parametrize("change", ["size", "time"])
def test_a_replaced_result_is_read_again(results, monkeypatch, change):
    """Another size or another time of change is enough."""
    write_job(results, "a" * 16)
    write_job(results, "b" * 16)
    path = results.job_file("a" * 16)
    before = path.stat()
    assert results.index().column("moduli.periodic.storage").to_pylist() == [1.0, 1.0]
    if change == "size":
        write_job(results, "a" * 16, storage=2.0, flags={"noisy": True})
        os.utime(path, ns=(before.st_mtime_ns, before.st_mtime_ns))
        assert path.stat().st_size != before.st_size
    else:
        write_job(results, "a" * 16, storage=2.0)
        os.utime(path, ns=(before.st_mtime_ns, before.st_mtime_ns + 1000))
        assert path.stat().st_size == before.st_size
    read = []
    original = module.read_summary
    monkeypatch.setattr(module, "read_summary", lambda path: read.append(path) or original(path))
    for _ in range(2):
        table = results.index()
        assert table.column("job").to_pylist() == ["a" * 16, "b" * 16]
        assert table.column("moduli.periodic.storage").to_pylist() == [2.0, 1.0]
        assert table.column("bytes").to_pylist()[0] == path.stat().st_size
    assert read == [results.index_file, path, results.index_file]


def test_an_index_of_an_older_format_is_made_again_silently(results):
    write_job(results, "a" * 16)
    old = pa.table({"job": ["a" * 16], "bytes": [1], "moduli.periodic.storage": [7.0]})
    write_arrow(results.index_file, old, {"format": 1})
    assert results.index().column("moduli.periodic.storage").to_pylist() == [1.0]


def test_an_index_made_in_pieces_is_the_same(results, monkeypatch):
    for job in ids(5):
        write_job(results, job, storage=1 if job == ids(5)[0] else 2.5)
    whole = results.index()
    results.index_file.unlink()
    monkeypatch.setattr(module, "_ROWS_AT_ONCE", 2)
    assert results.index().equals(whole)


def test_a_damaged_index_is_made_again(results):
    write_job(results, "a" * 16)
    results.index()
    results.index_file.write_bytes(b"PAR1 nonsense")
    assert results.index().num_rows == 1
    results.index_file.unlink()
    assert results.index().num_rows == 1


def test_damaged_results_are_named_and_left_out(results):
    write_job(results, "a" * 16)
    write_job(results, "b" * 16)
    results.job_file("c" * 16).write_bytes(results.job_file("a" * 16).read_bytes()[:-5])
    results.job_file("d" * 16).write_bytes(results.job_file("b" * 16).read_bytes())
    with pytest.warns(RuntimeWarning, match="2 damaged result.*cccccccccccccccc"):
        assert results.index().num_rows == 2


def test_results_of_a_newer_version_say_so_and_are_not_touched(results, tmp_path):
    write_job(results, "a" * 16, format=2)
    message = r"made by a newer version of shear-sim \(format 2; this one reads 1\)"
    with pytest.raises(ResultsError, match=message):
        results.index()
    study = load_study(write_study(tmp_path))
    write_arrow(results.plan_file, pa.table({"job": []}), {"format": 2})
    for use in (
        lambda: Results.existing(results.folder),
        lambda: make_plan(study, results),
        lambda: results.prepare(study),
    ):
        with pytest.raises(ResultsError, match=message):
            use()
    assert not results.study_file.exists()


@pytest.mark.parametrize("place", [0.001, 0.2, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("damage", ["flipped bit", "truncated"])
def test_any_damage_is_found_by_the_checksum_and_set_aside_when_told(results, damage, place):
    for job in ids(3):
        write_job(results, job)
    assert results.damaged() == {}
    path = results.job_file(ids(3)[1])
    content = bytearray(path.read_bytes())
    at = int(place * len(content))
    if damage == "truncated":
        del content[at:]
    else:
        content[at] ^= 16
    path.write_bytes(content)
    damaged = results.damaged()
    assert list(damaged) == [path.stem]
    assert str(path) in damaged[path.stem]
    with pytest.warns(RuntimeWarning, match="1 damaged result"):
        assert results.index().num_rows == 2
    assert path.read_bytes() == content
    assert results.set_aside(path.stem).read_bytes() == content
    assert results.damaged() == {}
    assert results.finished() == {ids(3)[0], ids(3)[2]}


def test_a_flipped_bit_in_the_index_changes_no_table(results):
    write_job(results, "a" * 16, storage=1.5)
    results.index()
    content = bytearray(results.index_file.read_bytes())
    content[len(content) // 3] ^= 1
    results.index_file.write_bytes(content)
    assert results.index().column("moduli.periodic.storage").to_pylist() == [1.5]


def test_a_thousand_results_are_indexed_in_seconds(results):
    """Measured: 0.5 ms a result the first time, 5 ms for all of them later."""
    for job in ids(1000):
        write_job(results, job)
    start = time.process_time()
    results.index()
    first = time.process_time() - start
    assert results.index().num_rows == 1000
    assert first < 3.0
    assert time.process_time() - start - first < 0.3


def test_failures_come_back_and_those_of_finished_jobs_do_not_count(results):
    failure = Failure("a" * 16, "crash", "killed – by γ", 2, None, "SIGKILL", ("line 1", "line 2"))
    results.record_failure(failure)
    results.record_failure(Failure("b" * 16, "physics", "unstable"))
    write_job(results, "b" * 16)
    assert results.failures() == {"a" * 16: failure}
    results.forget_failure("a" * 16)
    results.forget_failure("a" * 16)
    assert results.failures() == {}


def test_a_damaged_failure_counts_as_an_error_that_runs_again(results):
    (results.failed / "abc.json").write_text("{")
    assert results.failures()["abc"].kind == "error"


def test_jobs_are_found_by_file_or_unique_prefix(results, tmp_path):
    root = tmp_path / "results"
    write_job(results, "ab" * 8)
    write_job(results, "ac" * 8)
    results.record_failure(Failure("f" * 16, "physics", "unstable"))
    expected = results.job_file("ab" * 8)
    assert find_job("ab", root) == expected
    assert find_job(str(expected), root) == expected
    assert find_job("f", root) == results.failed / f"{'f' * 16}.json"
    with pytest.raises(ResultsError, match=rf"2 jobs .* begin so \({'ab' * 8}, {'ac' * 8}\);"):
        find_job("a", root)
    for third in "345":
        write_job(results, f"a{third}" * 8)
    with pytest.raises(ResultsError, match=r"5 jobs .* begin so \((\w{16}, ){4}\.\.\.\);"):
        find_job("a", root)
    for wrong in ("0", "", "*", "xyz", "no/such/file.parquet"):
        with pytest.raises(ResultsError, match="no such file"):
            find_job(wrong, root)
    with pytest.raises(ResultsError, match="a folder, not a job: `shear-sim show "):
        find_job(str(root), root)


def test_another_folder_is_not_taken_for_results(tmp_path):
    with pytest.raises(ResultsError, match="not a results folder"):
        Results.existing(tmp_path)
