"""Arrays of ``slurm/sweep.sbatch`` on a real cluster, as a user types them."""

import shutil
import sys
from pathlib import Path

import pytest
from tools import assert_same, new_environment, run, wait_until

from shear_sim.results import Results

ROOT = Path(__file__).parents[2]
SECONDS = 60.0


@pytest.fixture(scope="module")
def local(tmp_path_factory):
    """The results of ``configs/quick.yaml`` without Slurm."""
    folder = tmp_path_factory.mktemp("local")
    code, output = run(new_environment(), "sweep", ROOT / "configs/quick.yaml", "--results", folder)
    assert code == 0, output
    return Results(folder / "quick")


@pytest.fixture
def clone(tmp_path):
    """A folder as a user has it: a clone with a ``.venv``, which is not active."""
    for name in ("slurm", "configs"):
        shutil.copytree(ROOT / name, tmp_path / name)
    command = tmp_path / ".venv/bin/shear-sim"
    command.parent.mkdir(parents=True)
    path = ":".join(sys.path)
    command.write_text(f'#!/bin/sh\nPYTHONPATH={path} exec {sys.executable} -m shear_sim "$@"\n')
    command.chmod(0o755)
    return tmp_path


def test_an_array_by_hand_finds_its_environment_and_changes_no_bit(cluster, clone, local):
    submit = ("sbatch", "--parsable", f"--chdir={clone}")
    array = cluster.ask(
        *submit, "--array=0-3", "slurm/sweep.sbatch", "configs/quick.yaml", cwd=clone
    )
    wait_until(lambda: cluster.ended(array), SECONDS)
    logs = sorted(clone.glob(f"shear-sim-{array}_*.log"))
    assert [path.read_text().count("10 of 10 jobs done (10 now") for path in logs] == [1] * 4
    results = Results(clone / "results/quick")
    assert_same(local, results)
    lost = sorted(results.finished())[1::4]
    for job in lost:
        results.job_file(job).unlink()
    again = cluster.ask(
        *submit, "--array=1,3", "slurm/sweep.sbatch", "configs/quick.yaml", "4", cwd=clone
    )
    wait_until(lambda: cluster.ended(again), SECONDS)
    log = (clone / f"shear-sim-{again}_1.log").read_text()
    assert "10 of 10 jobs done (10 now" in log
    assert_same(local, results)
