import math
import subprocess
import sys

import kelvin_voigt
import numpy as np
import pytest

from shear_sim import runner
from shear_sim.models.interface import SimulationError
from shear_sim.results import read_job
from shear_sim.single import differences
from shear_sim.study import Job
from shear_sim.tables import read_summary, read_table


def make_job(fault="none", noise=0.0, replicate=0):
    point = kelvin_voigt.KelvinVoigtPoint.model_validate(
        {
            "model": {"kind": "kelvin_voigt", "modulus": 120.0, "noise": noise, "fault": fault},
            "shear": {"strain_amplitude": 0.05, "relative_frequency": 0.025},
        }
    )
    return Job.create(point, seed=7, replicate=replicate)


def test_kelvin_voigt_gives_back_its_spring_and_its_dashpot(tmp_path):
    """G' = G and G'' = ω η, from parameters through the file to the moduli."""
    path = runner.run_job(make_job(), tmp_path)
    assert path == tmp_path / f"{make_job().id}.parquet"
    omega = 2 * math.pi * 0.025
    fitted = read_summary(path)["moduli"]["periodic"]
    assert fitted["storage"] == pytest.approx(120.0, rel=1e-9)
    assert fitted["loss"] == pytest.approx(omega * 5.0, rel=1e-9)
    assert fitted["total"] == pytest.approx(0.05 * math.hypot(120.0, omega * 5.0), rel=1e-9)


def test_a_result_holds_what_describes_it(tmp_path):
    job = make_job()
    summary = read_summary(runner.run_job(job, tmp_path))
    assert summary["job"] == {
        "id": job.id,
        "point": job.point_id,
        "replicate": 0,
        "seed": 7,
        "model": "kelvin_voigt",
        "physics_version": 1,
    }
    assert summary["parameters"] == job.parameters
    assert summary["derived"] == {"omega": 2 * math.pi * 0.025}
    run = summary["run"]
    assert run["wall_s"] > 0
    assert run["cpu_s"] > 0
    assert run["threads"] == 1
    assert 1 < run["peak_memory_mb"] < 10_000
    assert {"version", "git_commit", "python", "numpy", "numba", "host", "processor"} < run.keys()


def test_stored_columns_are_independent_and_the_others_follow(tmp_path):
    path = runner.run_job(make_job(), tmp_path)
    stored, full = read_table(path).columns, read_job(path).columns
    assert list(stored) == [column.name for column in kelvin_voigt.COLUMNS]
    assert np.array_equal(full["shear_stress"], -stored["periodic_overall_xy"])


def test_a_job_does_without_pandas(tmp_path, environment):
    """It takes longer to import than a small job takes to run, once in every worker."""
    code = (
        "import sys; from pathlib import Path; from test_runner import make_job, runner;"
        "runner.run_job(make_job(), Path(sys.argv[1])); print('pandas' in sys.modules)"
    )
    command = [sys.executable, "-c", code, tmp_path]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_a_finished_job_is_not_run_again(tmp_path):
    job = make_job()
    path = runner.run_job(job, tmp_path)
    before = path.stat()
    assert runner.run_job(job, tmp_path) == path
    assert path.stat() == before


def test_blocks_do_not_change_a_bit(tmp_path, monkeypatch):
    job = make_job(noise=1.0)
    whole = read_table(runner.run_job(job, tmp_path))
    monkeypatch.setattr(runner, "FIRST_BLOCK", 7)
    monkeypatch.setattr(runner, "BLOCK_SECONDS", 0.0)
    (tmp_path / "again").mkdir()
    again = read_table(runner.run_job(job, tmp_path / "again"))
    assert differences(whole, again) == []


def test_replicates_differ(tmp_path):
    pair = [read_table(runner.run_job(make_job("none", 1.0, r), tmp_path)) for r in (0, 1)]
    assert any("periodic_overall_xy" in line for line in differences(*pair))
    assert any(line.startswith("summary job.replicate: 0 and 1") for line in differences(*pair))


def test_a_job_that_fails_leaves_no_file(tmp_path):
    with pytest.raises(SimulationError, match="the spring broke at t = 3 s"):
        runner.run_job(make_job("physics"), tmp_path)
    assert list(tmp_path.iterdir()) == []
