"""Studies on a real cluster: submission, requeue, dead nodes; the same bits as without Slurm."""

import os
import re
import shutil
import sys
import time
from pathlib import Path

import pytest
from tools import (
    assert_same,
    assert_same_but_for_the_wait,
    new_environment,
    run,
    wait_until,
    write_study,
)

from shear_sim import slurm
from shear_sim.results import Results
from shear_sim.tables import read_table

ROOT = Path(__file__).parents[2]
SBATCH = ("sbatch", "--parsable")
SECONDS = 300.0  # a busy machine is no reason to fail


@pytest.fixture(scope="session")
def quick(tmp_path_factory):
    """The results of ``configs/quick.yaml`` without Slurm."""
    return local(shutil.copy(ROOT / "configs/quick.yaml", tmp_path_factory.mktemp("quick")))


def local(study):
    """Return the results of a study without Slurm."""
    study = Path(study)
    code, output = run(new_environment(), "sweep", study, "--results", study.parent)
    assert code == 0, output
    return Results(study.parent / study.stem)


@pytest.fixture(scope="session")
def fast(tmp_path_factory):
    """The jobs of the slow studies below without any wait."""
    return local(write_study(tmp_path_factory.mktemp("fast"), replicates=1))


@pytest.fixture(scope="session")
def fast_many(tmp_path_factory):
    return local(write_study(tmp_path_factory.mktemp("fast"), replicates=10))


@pytest.fixture(scope="session")
def user(cluster, tmp_path_factory):
    """What a user has who calls shear-sim on the login node; tasks know the stand-in model too."""
    folder = tmp_path_factory.mktemp("site")
    (folder / "sitecustomize.py").write_text("import kelvin_voigt\n")
    path = os.pathsep.join([str(folder), *sys.path])
    return {**new_environment(), **cluster.environment, "PYTHONPATH": path}


@pytest.fixture(autouse=True)
def undisturbed(cluster):
    """Leave the cluster as it was, also where a test fails."""
    yield
    cluster.revive()
    cluster.start_jobs("main", may=True)


def write_one_job(folder, seconds):
    study = write_study(folder, seconds=seconds, replicates=1)
    study.write_text(study.read_text().replace("[0.01, 0.1, 1.0]", "[0.1]"))
    return study


@pytest.fixture(scope="session")
def one(tmp_path_factory):
    return local(write_one_job(tmp_path_factory.mktemp("one"), 0))


@pytest.fixture(scope="session", autouse=True)
def limited(cluster, user, tmp_path_factory):
    """One job of 40 s under a time limit of a minute, of which a warning takes the half.

    Submitted by hand: `submit` takes no limit as short as that. It runs beside the other tests, on
    the node apart.
    """
    folder = clone(tmp_path_factory.mktemp("limited"), user)
    write_one_job(folder, seconds=40)
    given = ("--array=0", "--time=1", "--signal=B:USR1@40", "--partition=apart")
    array = cluster.ask(*SBATCH, *given, "slurm/sweep.sbatch", "study.yaml", cwd=folder)
    return array, Results(folder / "results/study")


def clone(folder, user):
    """Make a clone of the project, whose .venv is not active."""
    for name in ("slurm", "configs"):
        shutil.copytree(ROOT / name, folder / name)
    command = folder / ".venv/bin/shear-sim"
    command.parent.mkdir(parents=True)
    path = user["PYTHONPATH"]
    command.write_text(f'#!/bin/sh\nPYTHONPATH={path} exec {sys.executable} -m shear_sim "$@"\n')
    command.chmod(0o755)
    return folder


def tasks(folder):
    return [each for each in slurm.submissions(Results(folder))[0] if each.kind == "array"]


def test_an_array_by_hand_finds_its_environment_and_changes_no_bit(cluster, user, tmp_path, quick):
    """As a user types it in a clone whose .venv is not active."""
    clone(tmp_path, user)
    script = ("slurm/sweep.sbatch", "configs/quick.yaml")
    array = cluster.ask(*SBATCH, "--array=0-1", *script, cwd=tmp_path)
    wait_until(lambda: cluster.ended(array), SECONDS)
    logs = sorted(tmp_path.glob(f"shear-sim-{array}_*.log"))
    assert [path.read_text().count("20 of 20 jobs done (20 now") for path in logs] == [1] * 2
    results = Results(tmp_path / "results/quick")
    assert_same(quick, results)
    for job in sorted(results.finished())[1::2]:
        results.job_file(job).unlink()
    again = cluster.ask(*SBATCH, "--array=1", *script, "2", cwd=tmp_path)
    wait_until(lambda: cluster.ended(again), SECONDS)
    assert "20 of 20 jobs done (20 now" in (tmp_path / f"shear-sim-{again}_1.log").read_text()
    assert_same(quick, results)


def test_the_quick_study_survives_a_dead_node_and_is_reported(cluster, user, tmp_path, quick):
    """More tasks than an array may have, a node killed with all its jobs, one report after all."""
    study = tmp_path / "a folder/quick.yaml"
    study.parent.mkdir()
    shutil.copy(ROOT / "configs/quick.yaml", study)
    root = tmp_path / "results"
    given = ("submit", study, "--results", root, "--time", 10, "--max-tasks", 4)
    cluster.start_jobs("main", may=False)  # or some may have ended before their node is killed
    code, output = run(user, *given)
    assert code == 0, output
    results = Results(root / "quick")
    first, second = tasks(results.folder)
    assert (first.tasks, first.offset) == ((0, 1, 2), 0)
    assert (second.tasks, second.offset) == ((3,), 3)
    before = cluster.requeued()
    cluster.start_jobs("main", may=True)
    node = wait_until(lambda: cluster.kill_node_of(first.job), SECONDS)
    code, output = run(user, *given)
    assert (code, "nothing to submit" in output) == (0, True), output
    wait_until(lambda: cluster.requeued() > before, SECONDS)
    cluster.start_node(node)
    wait_until(lambda: all_ended(cluster, results), SECONDS)
    assert (results.folder / "report.html").exists()
    assert_same(quick, results)


def all_ended(cluster, results):
    """Tell whether nothing of what was submitted for these results waits or runs."""
    return all(cluster.ended(str(each.job)) for each in slurm.submissions(results)[0])


def working_on(cluster, node):
    """Tell whether a sweep has its workers on a node: script, supervisor, server and worker."""
    return len(cluster.processes(node)) > 3


def test_warned_and_cancelled_tasks_lose_nothing(cluster, user, tmp_path, fast):
    """A warning has the task requeued, which goes on; of a cancelled one submit takes the rest."""
    folder = tmp_path / "a folder%A"  # no pattern: the log lies in it
    folder.mkdir()
    study = write_study(folder, seconds=4, replicates=1)
    given = ("submit", study, "--results", folder, "--time", 10, "--max-tasks", 1)
    assert run(user, *given)[0] == 0
    results = Results(folder / "study")
    [array] = tasks(results.folder)
    task = f"{array.job}_0"
    wait_until(results.finished, SECONDS)
    time.sleep(1.5)  # the next job is under way
    cluster.ask("scancel", "--signal=USR1", "--batch", task)
    wait_until(lambda: "PENDING" in cluster.queue().get(task, ""), SECONDS)
    code, output = run(user, "status", results.folder)
    assert code == 0
    assert re.search(f"Slurm: array {array.job}: 1 (waiting|running|configuring)", output), output
    log = results.logs / f"slurm-{array.job}_0.log"
    assert f"task {task} asks to be requeued" in log.read_text()
    assert "1 job(s) will go on from checkpoints" in log.read_text()
    wait_until(lambda: len(results.finished()) == 2, SECONDS)
    cluster.ask("scancel", task)
    wait_until(lambda: cluster.ended(str(array.job)), SECONDS)
    assert len(results.finished()) == 2
    assert run(user, *given)[0] == 0
    assert len(tasks(results.folder)) == 2
    wait_until(lambda: all_ended(cluster, results), SECONDS)
    assert_same_but_for_the_wait(fast, results)
    resumed = [
        read_table(path).summary["run"]["resumed"] for path in results.jobs.glob("*.parquet")
    ]
    assert sum(resumed) >= 1


def test_orphans_of_a_dead_daemon_do_no_harm(cluster, user, tmp_path, fast_many):
    """The daemon of a node dies, its task goes on unseen, and Slurm runs it a second time."""
    study, held = write_study(tmp_path, replicates=10), tmp_path / "held"
    held.touch()
    given = ("submit", study, "--results", tmp_path, "--time", 10, "--max-tasks", 1)
    assert run({**user, "HELD_BY": str(held)}, *given)[0] == 0
    results = Results(tmp_path / "study")
    [array] = tasks(results.folder)
    node = wait_until(lambda: cluster.running(array.job), SECONDS)
    wait_until(lambda: working_on(cluster, node), SECONDS)
    before = cluster.requeued()
    cluster.kill_node(node)
    cluster.give_up(node)
    wait_until(lambda: cluster.requeued() > before, SECONDS)
    other = wait_until(lambda: cluster.running(array.job), SECONDS)
    assert other != node
    wait_until(lambda: working_on(cluster, other), SECONDS)
    assert working_on(cluster, node)  # two live runs of one task
    held.unlink()
    cluster.start_node(node)
    wait_until(lambda: all_ended(cluster, results) and not cluster.processes(node), SECONDS)
    assert_same(fast_many, results)


def test_a_job_longer_than_its_time_limit_goes_on_to_the_same_bits(cluster, limited, one):
    """Warned by Slurm itself, and requeued as often as it takes."""
    array, results = limited
    wait_until(lambda: cluster.ended(array), SECONDS)
    [job] = results.finished()
    assert read_table(results.job_file(job)).summary["run"]["resumed"] >= 1
    assert_same_but_for_the_wait(one, results)
