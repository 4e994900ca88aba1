"""The programs of analysis/ start, as a user would start them."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "analysis"
PROGRAMS = sorted(
    path.relative_to(FOLDER)
    for path in FOLDER.rglob("*.py")
    if '__name__ == "__main__"' in path.read_text()  # the others are modules of these
)
FOLDERS = sorted({(FOLDER / name).parent for name in PROGRAMS})
LIBRARIES = "numba, numpy, pandas, pyarrow.parquet, scipy.stats, matplotlib.pyplot, typer, yaml"

NOTER = f"""
import sys
asked = set()

class Noter:
    def find_spec(self, name, *_):
        asked.add(name)

sys.meta_path.insert(0, Noter())
import {LIBRARIES}
print(*(name for name in asked.union(sys.modules) if "." not in name))
"""
STARTER = """
import runpy, sys
folder, *programs = sys.argv[1:]
sys.path.insert(0, folder)
for program in programs:
    sys.argv = [program, "--help"]
    try:
        runpy.run_path(program, run_name="__main__")
    except SystemExit as end:
        assert not end.code, program
    else:
        raise AssertionError(f"{program} knows no --help")
"""


def test_no_program_hides_a_module_of_a_library():
    """A program's folder comes first on the path of imports: of those of all libraries, too."""
    ran = subprocess.run([sys.executable, "-c", NOTER], capture_output=True, text=True, check=True)
    imported = set(ran.stdout.split())
    assert {"numba", "secrets", "yaml"} <= imported
    assert {path.stem for folder in FOLDERS for path in folder.glob("*.py")} & imported == set()


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_program_starts(folder, tmp_path):
    """All imports are there, and ``--help`` ends it: in one process, as importing takes seconds."""
    programs = [name for name in PROGRAMS if (FOLDER / name).parent == folder]
    paths = [str(FOLDER / name) for name in programs]
    ran = subprocess.run(
        [sys.executable, "-c", STARTER, str(folder), *paths],
        capture_output=True, text=True, cwd=tmp_path,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    for name in programs:
        assert f"usage: {name.name}" in ran.stdout
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("name", PROGRAMS, ids=str)
def test_a_program_says_how_it_is_run(name):
    """Its docstring's command is its own."""
    text = ast.get_docstring(ast.parse((FOLDER / name).read_text())) or ""
    assert f".venv/bin/python analysis/{name.as_posix()}" in text
