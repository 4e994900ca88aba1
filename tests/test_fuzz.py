"""Whatever a user types gives a valid plan or a clear error: no traceback, no hang, no rest."""

import contextlib
import io
import re
import signal
import sys
import tempfile
import time
from pathlib import Path
from unittest import mock

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from shear_sim import cli

ROOT = Path(__file__).parents[1]
STUDIES = [path.read_text() for path in sorted((ROOT / "configs").rglob("*.yaml"))]
SECONDS = 20.0  # far more than any plan takes
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.])")
ODD = (
    "0",
    "-1",
    "1e400",
    "-0.0",
    "1e-320",
    ".nan",
    "-.inf",
    "1000000000",
    "99999999999999999999999",
    "'0.1'",
    "true",
    "null",
    "~",
    "[]",
    "{}",
    "[1, [2]]",
    "{kind: x}",
    "x",
    "''",
    "*a",
    "&a 1",
    "!!int 3",
    "0x10",
    "1_000",
    "12:30",
    "2026-01-01",
    "|",
    "'",
    '"',
    "{",
    "}",
    "\t",
    "\x00",
    "\ud83d",
    "é",
    "\u2028",
)


def shear_sim(*arguments):
    """Run the command line in this process; return its exit code, output and errors."""
    shown, errors = io.StringIO(), io.StringIO()
    with (
        mock.patch.object(sys, "argv", ["shear-sim", *arguments]),
        mock.patch.object(signal, "signal"),
        contextlib.redirect_stdout(shown),
        contextlib.redirect_stderr(errors),
        pytest.raises(SystemExit) as ended,
    ):
        cli.main()
    return ended.value.code, shown.getvalue(), errors.getvalue()


def check(folder, *arguments):
    """Run a command beside ``folder`` and check how it ends; return its exit code."""
    before, began = sorted(folder.rglob("*")), time.monotonic()
    code, shown, errors = shear_sim(*arguments)
    assert code in (0, 2), errors
    assert "Traceback" not in shown + errors
    assert "error of the program" not in errors
    assert time.monotonic() - began < SECONDS
    assert sorted(folder.rglob("*")) == before  # looking changes nothing
    if code:
        assert len(errors) > 20, "an error says what is wrong"
        assert arguments[0] != "plan" or " jobs: " not in shown, "half a plan"
    return code


@st.composite
def mutations(draw):
    """Return a shipped study with a few edits as people and editors make them."""
    text = draw(st.sampled_from(STUDIES))
    for _ in range(draw(st.integers(0, 3))):
        lines = text.splitlines() or [""]
        line = draw(st.integers(0, len(lines) - 1))
        odd = draw(st.sampled_from(ODD))
        edit = draw(
            st.sampled_from(
                ["number", "number", "value", "key", "delete", "double", "indent", "cut"]
            )
        )
        if edit == "number" and (numbers := list(NUMBER.finditer(text))):
            one = draw(st.sampled_from(numbers))
            text = text[: one.start()] + odd + text[one.end() :]
            continue
        if edit == "cut":
            text = text[: draw(st.integers(0, len(text)))]
            continue
        words = re.findall(r"[a-z_.]+", lines[line]) or [""]
        word = draw(st.sampled_from(words))
        lines[line : line + 1] = {
            "value": [lines[line].partition(":")[0] + ": " + odd],
            "key": [
                lines[line].replace(word, draw(st.sampled_from([word[1:], word + "x", odd])), 1)
            ],
            "delete": [],
            "double": [lines[line], lines[line]],
            "indent": [" " + lines[line]],
        }.get(edit, [lines[line]])
        text = "\n".join(lines) + "\n"
    return text


@settings(max_examples=60)
@given(mutations())
@example("replicates: 1000000000\n")
@example("replicates: 99999999999999999999999\n")
@example("sweep: {grid: {model.friction: {linspace: [0, 1, 1000000000]}}}\n")
@example("sweep: {sobol: {points: 1000000000, ranges: {model.friction: {from: 0, to: 1}}}}\n")
@example("packing: {discs: 1000000000000}\n")
@example("&a [*a]")
def test_an_edited_study_is_planned_or_refused(text):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "study.yaml").write_bytes(text.encode("utf-8", "surrogatepass"))
        check(folder, "plan", str(folder / "study.yaml"), "--results", str(folder / "results"))


COMMANDS = (
    "plan",
    "sweep",
    "submit",
    "compile",
    "run",
    "status",
    "show",
    "verify",
    "aggregate",
    "report",
    "accuracy",
    "import-legacy",
    "schema",
)
WORDS = st.sampled_from(
    [
        "study.yaml",
        "broken.yaml",
        "empty",
        "missing",
        "results",
        "results/study",
        ".",
        "/",
        "-",
        "--",
        "--results",
        "--shard",
        "0/1",
        "1/1",
        "-1/2",
        "0/0",
        "a/b",
        "--jobs",
        "0",
        "-5",
        "1e3",
        "--limit",
        "--retry-failed",
        "--json",
        "--time",
        "--max-tasks",
        "--mem",
        "--job",
        "abc",
        "--out",
        "--tensor",
        "internal",
        "--no-figures",
        "--help",
        "--version",
        "--debugx",
        "--points",
        "é",
        "",
        " ",
        "\ud83d",
        "a" * 5000,
        "x.parquet",
        "*.txt",
        "--partition",
        "--account",
        "--remove",
        "--replicates",
    ]
)


@settings(max_examples=80)
@given(st.sampled_from(COMMANDS), st.lists(WORDS, max_size=5))
@example("status", ["study.yaml", "--results", "broken.yaml"])
@example("aggregate", ["broken.yaml"])
@example("import-legacy", ["broken.yaml", "--out", "x"])
@example("show", ["empty"])
@example("run", ["x.parquet"])
def test_any_command_line_is_obeyed_or_refused(command, words):
    """Commands that would simulate only look: ``--limit 0``, ``--dry-run``."""
    only_look = {"sweep": ["--dry-run"], "submit": ["--dry-run"]}.get(command, [])
    with tempfile.TemporaryDirectory() as name, contextlib.chdir(name):
        folder = Path(name)
        (folder / "study.yaml").write_text("sweep: {grid: {model.friction: [0, 1]}}\n")
        (folder / "broken.yaml").write_text("shear: {strain_amplitude: -1}\n")
        (folder / "empty").write_bytes(b"")
        (folder / "x.parquet").write_bytes(b"PAR1")
        if command in ("compile", "accuracy") and "study.yaml" in words:
            words = [word for word in words if word != "study.yaml"]
        check(folder, command, *only_look, *words)
