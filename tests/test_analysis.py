"""The programs of analysis/ start, as a user would start them."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "analysis"
PROGRAMS = sorted(path.relative_to(FOLDER) for path in FOLDER.rglob("*.py"))
LIBRARIES = "numba, numpy, pandas, pyarrow.parquet, scipy.stats, matplotlib.pyplot, typer, yaml"


@pytest.mark.parametrize("folder", sorted({(FOLDER / name).parent for name in PROGRAMS}))
def test_no_program_hides_a_module_of_a_library(folder):
    """A program's folder comes first on the path of imports: of those of all libraries, too."""
    command = f"import sys; sys.path.insert(0, {str(folder)!r}); import {LIBRARIES}"
    ran = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.parametrize("name", PROGRAMS, ids=str)
def test_a_program_says_how_it_is_run(name):
    """Its docstring's command is its own."""
    text = ast.get_docstring(ast.parse((FOLDER / name).read_text())) or ""
    assert f".venv/bin/python analysis/{name.as_posix()}" in text
