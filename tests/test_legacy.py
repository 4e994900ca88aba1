"""Reading output files of particleShear: every trap of them, and what is wrong with bad ones."""

import gzip
import re
import sys

import numpy as np
import pytest
from legacy_runs import REAL, analytic_text, header_and_table, real_text, split, write_rda

from shear_sim import models
from shear_sim.legacy.headers import LegacyError, find_runs, read_header
from shear_sim.legacy.series import DEPENDENT, STORED, TABLE, read_series


def written(folder, text, name="run.txt"):
    path = folder / name
    path.write_bytes(text.encode())
    return path


def read(path):
    return read_series(read_header(path))


def problems(*paths):
    return [str(problem) for problem in find_runs(paths)[1]]


@pytest.fixture(scope="module")
def rdata():
    return pytest.importorskip("rdata", reason="files of R need the package rdata")


def test_a_real_table_to_the_bit():
    """Stored columns are the file's; the others are given back by the derived ones."""
    _, names, table = header_and_table(real_text())
    assert tuple(names) == TABLE
    columns = read(REAL)
    assert columns.keys() == STORED.keys()
    for name, source in STORED.items():
        assert np.array_equal(columns[name], table[:, names.index(source)])
    derived = models.model("microgel").derive(columns)
    left = {"index", *STORED.values(), *DEPENDENT.values()}
    assert left == set(TABLE)
    for name, source in DEPENDENT.items():
        assert derived[name] == pytest.approx(table[:, names.index(source)], abs=1e-9)
    assert set(STORED) <= {column.name for column in models.model("microgel").COLUMNS}


def test_the_traps_of_a_real_header():
    values = read_header(REAL).values
    assert values["post_periods"] == 1  # printed as 2, that of the rest before
    assert values["pre_periods"] == 2
    assert values["amplitude"] == 0.2  # printed in percent too
    assert values["large_radius"] / values["bimodal_factor"] == pytest.approx(36.66352, rel=1e-6)
    assert values["cut_lines"] == 5  # seed points, without any links
    assert values["do_permanent_links"] is False
    assert values["density"] == 50
    assert values["frequency"] == 2506.6282746310003


def test_the_large_radius_gives_the_packing_fraction():
    """Half of the discs large, half small by the size ratio: N π (R² + r²)/2 = φ L²."""
    values = read_header(REAL).values
    large = values["large_radius"]
    small = large / values["bimodal_factor"]
    area = values["N"] * np.pi * (large**2 + small**2) / 2
    fraction = area / (values["width"] * values["height"])
    assert fraction == pytest.approx(values["packing_fraction"], rel=1e-12)


def test_exponents_are_numbers(tmp_path):
    """The regular expressions of the R scripts read a friction of 1e-05 as 1."""
    text = analytic_text(mu="1e-05", amplitude="5e-05", Young_modulus_spheres="8e+03")
    values = read_header(written(tmp_path, text)).values
    assert values["mu"] == 1e-5
    assert values["amplitude"] == 5e-5
    assert values["Young_modulus_spheres"] == 8000


def test_a_folder_that_looks_like_arguments_changes_nothing(tmp_path):
    text = analytic_text(root_folder="out,mu=7,N=3,amplitude=2/cut_lines=1")
    values = read_header(written(tmp_path, text)).values
    assert (values["mu"], values["N"], values["amplitude"]) == (0.01, 60, 0.2)


def test_old_versions_did_what_they_do_not_print(tmp_path):
    text = analytic_text().replace("cut_top_bottom=False,doCutByTriangulation=True,", "")
    header = read_header(written(tmp_path, text))
    assert header.values["cut_top_bottom"] is True
    assert header.values["doCutByTriangulation"] is False
    assert header.assumed == ("cut_top_bottom", "doCutByTriangulation")
    text = "\n".join(line for line in text.split("\n") if "surface force" not in line)
    assert "G'(by surface force)" not in read_header(written(tmp_path, text)).values


@pytest.mark.parametrize("name", ["run.txt", "run.txt.gz"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_every_kind_of_text(tmp_path, name, end):
    text = analytic_text().replace("\n", end)
    content = text.encode()
    path = tmp_path / name
    path.write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    plain = written(tmp_path, analytic_text(), "plain.txt")
    assert read_header(path).identity == read_header(plain).identity
    for name, series in read(plain).items():
        assert np.array_equal(read(path)[name], series)


def test_names_as_r_writes_them(tmp_path):
    text = analytic_text().replace("internal_stress-tensor", "internal_stress.tensor")
    assert len(read(written(tmp_path, text))["time"]) == 480


def test_split_files_are_the_same_run(tmp_path, rdata):
    text = analytic_text()
    split(text, tmp_path, "a")
    whole = written(tmp_path, text, "whole.txt")
    halves = tmp_path / "header_a.txt", tmp_path / "stress_a.rda"
    for given in (halves[:1], halves[1:], halves):
        headers, wrong = find_runs(given)
        assert not wrong
        [header] = headers
        assert header.source == halves
        assert header.identity == read_header(whole).identity
        for name, series in read(whole).items():
            assert np.array_equal(read_series(header)[name], series)


def test_a_folder_stands_for_its_files(tmp_path):
    written(tmp_path, analytic_text(mu=0.1), "a.txt")
    written(tmp_path, analytic_text(mu=0.2), "b.txt")
    written(tmp_path, "nothing of ours", "notes.md")
    headers, wrong = find_runs([tmp_path])
    assert [header.values["mu"] for header in headers] == [0.1, 0.2]
    assert not wrong
    (tmp_path / "empty").mkdir()
    assert problems(tmp_path / "empty")[0].endswith("no .txt, .txt.gz or .rda file in this folder")


def test_the_same_run_twice_is_told(tmp_path):
    one, other = (written(tmp_path, analytic_text(), name) for name in ("a.txt", "b.txt"))
    assert problems(one, other) == [
        f"{other}: the same run as {one} (equal headers): give one of them"
    ]
    assert problems(one, one) == []  # named twice by two patterns of a shell


def changed(old, new, count=1):
    text = analytic_text()
    assert old in text
    return text.replace(old, new, count)


def test_headers_without_a_key_name_it_and_all_others(tmp_path):
    text = changed("Frequency = ", "Freq = ").replace(",bimodal_factor=1.4", "")
    text = re.sub("Time step = .*s", "Time step = 0s", text)
    path = written(tmp_path, text.replace("mu=0.01,", "mu=rough,").replace("N=60,", "N=6.5,"))
    lines = text.split("\n")
    call, step = (
        next(number for number, line in enumerate(lines, 1) if word in line)
        for word in ("root_folder", "Time step")
    )
    assert problems(path) == [
        f"{path}:{call}: N = 6.5: must be a whole number",
        f"{path}:{call}: bimodal_factor: the function call does not hold it",
        f"{path}:{call}: mu = rough: must be a finite number",
        f"{path}:{step}: time_step = 0.0: must be above 0",
        f"{path}: frequency: the header does not hold it",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not an output of particleShear, or of a run that did not end"),
        ("x y\n1 2\n" * 300, "not an output of particleShear, or of a run that did not end"),
        ("\n".join(header_and_table(real_text())[0]), "saved without the table, or split by R"),
    ],
)
def test_files_of_another_kind(tmp_path, text, message):
    [problem] = problems(written(tmp_path, text))
    assert problem.startswith(str(tmp_path / "run.txt"))
    assert message in problem


def test_files_that_cannot_be_read(tmp_path):
    missing = tmp_path / "missing.txt"
    assert problems(missing) == [f"{missing}: cannot be read (No such file or directory)"]
    torn = tmp_path / "torn.txt.gz"
    torn.write_bytes(REAL.read_bytes()[:900])
    assert "cannot be read (Compressed file ended" in problems(torn)[0]
    torn.write_bytes(b"no gzip")
    assert "cannot be read (Not a gzipped file" in problems(torn)[0]


def number_of_line(text, row):
    return len(header_and_table(text)[0]) + 2 + row


@pytest.mark.parametrize(
    ("damage", "row", "message"),
    [
        (lambda t: t[: t.rindex("\t")], 479, "the table is torn off in this line"),
        (lambda t: t[: t.rindex("\n")], 478, None),  # one row is the program's own rounding
        (
            lambda t: "\n".join(t.split("\n")[:-5]),
            474,
            "ends after 475 rows of 480: the run did not",
        ),
        (lambda t: t[:-12], 479, "stress_tensor_overall_11 = 1309.3 is not the sum of the other"),
        (lambda t: t.replace("\n100\t", "\n1OO\t"), 100, "invalid value '1OO'"),
        (lambda t: t.replace("\n100\t", "\n\t"), 100, "no number in column index"),
        (lambda t: t.replace("\n100\t", "\n101\t"), 100, "row 100 of the table has index 101"),
        (
            lambda t: t.replace("stress_tensor_overall_00", "x"),
            -1,
            "lacks stress_tensor_overall_00",
        ),
    ],
)
def test_damaged_tables_say_where(tmp_path, damage, row, message):
    whole = analytic_text()
    text = damage(whole)
    assert text != whole
    path = written(tmp_path, text)
    if message is None:
        assert len(read(path)["time"]) == row + 1
        return
    with pytest.raises(LegacyError, match="1 problem with the files") as caught:
        read(path)
    [problem] = caught.value.problems
    assert message in str(problem)
    assert problem.path == path
    assert problem.line == number_of_line(whole, row)


def test_the_table_of_another_run_is_refused(tmp_path):
    step = next(li for li in analytic_text().split("\n") if li.startswith("Time step"))
    double = f"Time step = {2 * float(step[12:-1])!r}s"
    path = written(
        tmp_path, analytic_text().replace(step, double).replace("periods=3,", "periods=9,")
    )
    with pytest.raises(LegacyError, match=r"after 1 steps of 9\.97.*not the table of this header"):
        read(path)


def test_a_run_that_blew_up_is_read(tmp_path):
    columns = read(written(tmp_path, analytic_text(blown_up=True)))
    assert np.isnan(columns["love_weber_xy"][-199:]).all()
    assert np.isfinite(columns["love_weber_xy"][:-200]).all()


def test_bad_files_of_r(tmp_path, rdata):
    split(analytic_text(), tmp_path, "a")
    table = tmp_path / "stress_a.rda"
    whole = table.read_bytes()
    for content in (whole[:2000], b"nothing"):
        table.write_bytes(content)
        with pytest.raises(LegacyError, match=f"{table}: cannot be read as a file of R"):
            read_series(read_header(tmp_path / "header_a.txt"))
    _, names, rows = header_and_table(analytic_text())
    write_rda(table, names, rows[:400])
    with pytest.raises(LegacyError, match=f"{table}: the table ends after 400 rows of 480"):
        read_series(read_header(tmp_path / "header_a.txt"))
    write_rda(table, names[:-1], rows[:, :-1])
    with pytest.raises(LegacyError, match=f"{table}: the table lacks stress_tensor_overall_11"):
        read_series(read_header(tmp_path / "header_a.txt"))
    table.unlink()
    assert "split by R without stress_a.rda beside it" in problems(tmp_path / "header_a.txt")[0]
    (tmp_path / "header_a.txt").unlink()
    assert problems(table)[0].startswith(
        f"{tmp_path / 'header_a.txt'}: cannot be read (No such file"
    )


def test_without_rdata_files_of_r_say_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rdata", None)
    head = "\n".join(header_and_table(analytic_text())[0])
    written(tmp_path, head, "header_a.txt")
    table = written(tmp_path, "", "stress_a.rda")
    [header], _ = find_runs([table])
    with pytest.raises(LegacyError, match=r"pip install rdata"):
        read_series(header)
