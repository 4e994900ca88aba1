"""Studies of the stand-in model and the processes that run them."""

import io
import os
import signal
import subprocess
import sys
import time
import uuid
import warnings
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import kelvin_voigt  # noqa: F401 - makes the model known
import pytest

from shear_sim import cli
from shear_sim.single import differences
from shear_sim.tables import read_table

COMMAND = "import kelvin_voigt; from shear_sim.cli import main; main()"
STUDY = """
model: {{kind: kelvin_voigt, noise: 0.3, seconds: {seconds}}}
sweep:
  grid:
    shear.strain_amplitude: [0.01, 0.1, 1.0]
    model.fault: {faults}
replicates: {replicates}
seed: 5
"""


def write_study(folder, faults="[none]", seconds=0.0, replicates=4, *, compiled=False):
    path = folder / "study.yaml"
    text = STUDY.format(faults=faults, seconds=seconds, replicates=replicates)
    path.write_text(text.replace("noise: 0.3", "noise: 0.3, compiled: true") if compiled else text)
    return path


def new_environment():
    """Return the environment of the processes of one test, by which all of them can be found."""
    env = {name: value for name, value in os.environ.items() if not name.startswith("SLURM")}
    return {**env, "PYTHONPATH": os.pathsep.join(sys.path), "TEST_MARK": uuid.uuid4().hex}


def start(environment, *arguments):
    return subprocess.Popen(
        [sys.executable, "-c", COMMAND, *map(str, arguments)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def run(environment, *arguments):
    process = start(environment, *arguments)
    output, _ = process.communicate(timeout=300)
    return process.returncode, output


def here(*arguments):
    """Return exit code and output of a command in this process, which has its libraries loaded."""

    def show_warning(*warning):
        shown.write(warnings.formatwarning(*warning[:4]))

    shown = io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patched,
        redirect_stdout(shown),
        redirect_stderr(shown),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("default")
        patched.setattr(warnings, "showwarning", show_warning)
        patched.setattr(warnings, "formatwarning", warnings.formatwarning)
        patched.setattr(signal, "signal", lambda *_: None)
        patched.setattr(sys, "argv", ["shear-sim", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
    return ended.value.code, shown.getvalue()


def processes(environment):
    """Return the process ids of this test's children, oldest first."""
    mark = f"TEST_MARK={environment['TEST_MARK']}".encode()
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if mark in (folder / "environ").read_bytes():
                found.append(int(folder.name))
        except (FileNotFoundError, ProcessLookupError, PermissionError):
            continue
    return sorted(found)


def wait_until(condition, seconds=30.0):
    end = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)
    return value


def tables_of(results):
    """Return the result files by name; what a killed writer left goes with the next sweep."""
    return {path.name: path for path in sorted(results.jobs.glob("*.parquet"))}


def assert_same(one, other):
    """Two results folders hold the same jobs, the same to the bit."""
    mine, theirs = tables_of(one), tables_of(other)
    assert list(mine) == list(theirs), (list(mine), list(theirs))
    for name in mine:
        assert differences(read_table(mine[name]), read_table(theirs[name])) == [], name


def assert_same_but_for_the_wait(undisturbed, slow):
    """Compare columns and moduli: the slow study differs in ``model.seconds``, hence in ids."""

    def facts(results):
        tables = [read_table(path) for path in tables_of(results).values()]
        return sorted(
            (
                [values.tobytes() for values in table.columns.values()],
                str(table.summary["moduli"]),
            )
            for table in tables
        )

    assert facts(slow) == facts(undisturbed)


# A stand-in writes down how it was called and answers as told by a file beside it.
STAND_IN = """#!/bin/sh
echo "$@" >> {folder}/{name}.calls
[ "$1" = --parsable ] && cat > {folder}/script-$(wc -l < {folder}/{name}.calls)
. {folder}/{name}.answer
"""


class FakeSlurm:
    """A folder with stand-ins for Slurm's commands."""

    def __init__(self, folder):
        self.folder = folder
        folder.mkdir()
        self.answers("squeue", "")
        self.answers("scontrol", "echo 'MaxArraySize            = 4'")
        self.answers("sbatch", f"echo $((100 + $(wc -l < {folder}/sbatch.calls)))")

    def on(self, monkeypatch):
        """Let them be found before all others, and those alone of Slurm's."""
        monkeypatch.setenv("PATH", f"{self.folder}:/usr/bin:/bin")

    def answers(self, name, shell):
        path = self.folder / name
        path.write_text(STAND_IN.format(folder=self.folder, name=name))
        path.chmod(0o755)
        (self.folder / f"{name}.answer").write_text(shell + "\n")

    def calls(self, name):
        path = self.folder / f"{name}.calls"
        return path.read_text().splitlines() if path.exists() else []
