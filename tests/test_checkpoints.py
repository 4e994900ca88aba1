"""A job that is stopped goes on from its checkpoint, to the same bits."""

import hashlib
import pickle
from importlib.metadata import version
from pathlib import Path

import pytest
from tools import write_study

from shear_sim import checkpoints, models, runner
from shear_sim.checkpoints import Progress, read_checkpoint, write_checkpoint
from shear_sim.compiled import build_key
from shear_sim.models.interface import SimulationError
from shear_sim.results import Results
from shear_sim.runner import Stopped, run_job
from shear_sim.single import differences
from shear_sim.study import Job, load_study
from shear_sim.tables import read_table
from shear_sim.workers import attempt

STEADY = {"kind": "steady", "strain": 0.5}
POINTS = {
    "microgel: friction, links, energy": {
        "packing": {"discs": 40, "packing_fraction": 1.5},
        "model": {"friction": 0.1, "links": {"cut": "cells"}},
        "shear": {"strain_amplitude": 1.0, "relative_frequency": 0.1},
        "record": {"energy": True},
    },
    "microgel: plates, steady": {
        "packing": {"discs": 40, "packing_fraction": 1.2},
        "model": {"friction": 0.1, "links": {"cut": "none"}},
        "cell": {"boundary": "plates"},
        "shear": {"kind": "steady", "relative_rate": 0.05, "strain": 1.0},
    },
    "hard discs: steady": {"shear": STEADY},
    "hard discs: fixed stress": {"shear": {**STEADY, "scaled_pressure": 30.0}},
    "hard discs: oscillatory": {"shear": {"kind": "oscillatory", "strain_amplitude": 0.2}},
    "hard discs: self-propelled": {"shear": {"kind": "self_propelled", "duration": 1.0}},
    "hard discs: until jammed": {"shear": {"kind": "compression", "compression": 0.1}},
    "hard discs: through a jam": {
        "shear": {
            "kind": "stages",
            "stages": [
                {"compression": 1.0, "length": 0.1},
                {"compression": -1.0, "length": 0.02},
                {"shear": -1, "length": 0.1},
            ],
        }
    },
    "hard discs: time steps": {
        "shear": STEADY,
        "integrator": {"scheme": "time_steps", "strain_step": 0.005},
    },
    "soft particle: plastic ring": {
        "packing": {"vertices": 24},
        "model": {"kind": "soft_particle", "yield_moment": 0.02},
        "shear": {"kind": "diametral_compression", "compression": 0.2, "relative_rate": 0.01},
    },
}
HARD = {"packing": {"discs": 24, "packing_fraction": 0.76}, "model": {"kind": "hard_disc"}}


def make_job(name="hard discs: steady"):
    data = {**HARD, **POINTS[name]} if name.startswith("hard") else POINTS[name]
    kind = data["model"].get("kind", "microgel")
    point = models.model(kind).POINT.model_validate(data)
    return Job.create(point, seed=3, replicate=1)


def folder(path: Path, name: str) -> Path:
    made = path / name / "jobs"
    made.mkdir(parents=True)
    return made


@pytest.mark.parametrize("name", POINTS)
def test_a_job_in_pieces_equals_the_whole_to_the_bit(name, tmp_path, monkeypatch):
    job = make_job(name)
    whole = read_table(run_job(job, folder(tmp_path, "whole")))
    jobs = folder(tmp_path, "pieces")
    checkpoint = jobs.parent / f"checkpoints/{job.id}.pickle"
    monkeypatch.setattr(runner, "FIRST_BLOCK", len(whole.columns["time"]) // 5)
    for _ in range(4):
        with pytest.raises(Stopped):
            run_job(job, jobs, stop=lambda: True)
        assert checkpoint.exists()
        assert list(jobs.iterdir()) == []
    pieces = read_table(run_job(job, jobs))
    assert differences(whole, pieces) == []
    assert pieces.summary["run"]["resumed"] == 4
    assert whole.summary["run"]["resumed"] == 0
    assert list(checkpoint.parent.iterdir()) == []


def test_a_job_goes_on_from_the_midst_of_its_preparation(tmp_path, monkeypatch):
    """Which is the larger part of a job of many discs, and longer than a time limit may be."""
    job = make_job("microgel: friction, links, energy")
    monkeypatch.setattr(runner, "FIRST_BLOCK", 1)
    monkeypatch.setattr(runner, "BLOCK_SECONDS", 0.0)
    whole = read_table(run_job(job, folder(tmp_path, "whole")))
    jobs = folder(tmp_path, "pieces")
    checkpoint, done = jobs.parent / f"checkpoints/{job.id}.pickle", []
    for _ in range(3):
        with pytest.raises(Stopped):
            run_job(job, jobs, stop=lambda: True)
        done.append(read_checkpoint(checkpoint).simulation)
    assert [simulation.done for simulation in done] == [0, 0, 0]
    assert len({pickle.dumps(simulation) for simulation in done}) == 3  # it gets on
    monkeypatch.setattr(runner, "FIRST_BLOCK", 1000)
    pieces = read_table(run_job(job, jobs))
    assert differences(whole, pieces) == []
    assert pieces.summary["run"]["resumed"] == 3


def test_the_cost_of_all_pieces_is_counted(tmp_path, monkeypatch):
    job, jobs = make_job(), folder(tmp_path, "study")
    monkeypatch.setattr(runner, "FIRST_BLOCK", 100)
    with pytest.raises(Stopped):
        run_job(job, jobs, stop=lambda: True)
    checkpoint = jobs.parent / f"checkpoints/{job.id}.pickle"
    first = read_checkpoint(checkpoint)
    write_checkpoint(checkpoint, Progress(first.simulation, first.wall_s + 1000, first.cpu_s + 500))
    run = read_table(run_job(job, jobs)).summary["run"]
    assert run["wall_s"] == pytest.approx(1000, abs=100)
    assert run["cpu_s"] == pytest.approx(500, abs=100)


def test_a_long_job_keeps_checkpoints_without_being_asked(tmp_path, monkeypatch):
    """So that a dead node costs minutes, not the job."""
    job, jobs = make_job(), folder(tmp_path, "study")
    monkeypatch.setattr(runner, "CHECKPOINT_SECONDS", 0.0)
    monkeypatch.setattr(runner, "FIRST_BLOCK", 50)
    kept = []
    monkeypatch.setattr(runner, "write_checkpoint", lambda _, now: kept.append(now.simulation.done))
    run_job(job, jobs)
    assert kept[0] == 50
    assert kept == sorted(set(kept))


def test_a_job_that_begins_anew_is_no_further(tmp_path, monkeypatch):
    """As on a processor of another type at each run of a task: such requeues must be capped."""
    job, jobs = make_job(), folder(tmp_path, "study")
    monkeypatch.setattr(runner, "FIRST_BLOCK", 50)
    said = []
    for key in ("a", "a", "b", "a", "a"):
        monkeypatch.setattr("shear_sim.checkpoints.build_key", lambda key=key: key)
        said.append(attempt(job, jobs, stop=lambda: True))
    assert [ending.stopped for ending in said] == [True] * 5
    assert [ending.anew for ending in said] == [False, False, True, True, False]


class Unreadable:
    """What raises an error of its own kind where it is read."""

    def __reduce__(self):
        return divmod, (1, 0)


@pytest.mark.parametrize(
    "damage",
    ["truncated", "a bit", "other code", "pydantic", "no pickle", "no class", "error", "nothing"],
)
def test_only_a_whole_checkpoint_of_this_code_is_taken_up(damage, tmp_path, monkeypatch, capfd):
    job, jobs = make_job(), folder(tmp_path, "study")
    monkeypatch.setattr(runner, "FIRST_BLOCK", 100)
    with pytest.raises(Stopped):
        run_job(job, jobs, stop=lambda: True)
    checkpoint = jobs.parent / f"checkpoints/{job.id}.pickle"
    content = bytearray(checkpoint.read_bytes())
    if damage == "truncated":
        del content[-1:]
    elif damage == "a bit":
        content[len(content) // 2] ^= 4
    elif damage == "other code":
        monkeypatch.setattr("shear_sim.checkpoints.build_key", lambda: build_key()[::-1])
    elif damage == "pydantic":
        versions = {damage: "1.0", "scipy": version("scipy")}
        monkeypatch.setattr("shear_sim.checkpoints.version", versions.get)
    elif damage != "nothing":
        pickles = {
            "no pickle": b"",
            "no class": b"cshear_sim.nowhere\nNothing\n.",
            "error": pickle.dumps(Unreadable()),
        }
        data = checkpoints._header(checkpoint) + pickles[damage]
        content = hashlib.sha256(data).digest() + data
    checkpoint.write_bytes(content)
    run = read_table(run_job(job, jobs)).summary["run"]
    said = capfd.readouterr().err
    assert run["resumed"] == (damage == "nothing")
    assert ("the job begins anew" in said) == (damage != "nothing")
    assert not checkpoint.exists()


def test_a_checkpoint_of_another_job_is_not_taken_up(tmp_path, monkeypatch, capfd):
    """Copied or renamed by hand: a result under the wrong id would look whole."""
    job, other = make_job(), make_job("hard discs: oscillatory")
    undisturbed = read_table(run_job(other, folder(tmp_path, "undisturbed")))
    jobs = folder(tmp_path, "study")
    with monkeypatch.context() as patched:
        patched.setattr(runner, "FIRST_BLOCK", 100)
        with pytest.raises(Stopped):
            run_job(job, jobs, stop=lambda: True)
    checkpoint = jobs.parent / f"checkpoints/{job.id}.pickle"
    checkpoint.rename(checkpoint.with_name(f"{other.id}.pickle"))
    result = read_table(run_job(other, jobs))
    assert "of another job" in capfd.readouterr().err
    assert result.summary["run"]["resumed"] == 0
    assert differences(undisturbed, result) == []


def test_a_folder_in_the_place_of_a_checkpoint_says_what_to_do(tmp_path):
    job, jobs = make_job(), folder(tmp_path, "study")
    (jobs.parent / f"checkpoints/{job.id}.pickle").mkdir(parents=True)
    with pytest.raises(IsADirectoryError, match=rf"move it away.*{job.id}.pickle"):
        run_job(job, jobs)


def test_a_folder_in_the_place_of_a_checkpoint_of_a_finished_job_does_no_harm(tmp_path):
    study = load_study(write_study(tmp_path, replicates=1))
    results = Results(tmp_path / "results/study")
    results.prepare(study)
    one, other, _ = study.jobs()
    for job in (one, other):
        results.job_file(job.id).touch()
    in_the_way = results.checkpoints / f"{one.id}.pickle"
    in_the_way.mkdir()
    (results.checkpoints / f"{other.id}.pickle").touch()
    results.prepare(study)
    assert list(results.checkpoints.iterdir()) == [in_the_way]


def test_a_job_that_fails_by_physics_leaves_no_checkpoint(tmp_path, monkeypatch):
    job, jobs = make_job(), folder(tmp_path, "study")
    monkeypatch.setattr(runner, "FIRST_BLOCK", 100)
    with pytest.raises(Stopped):
        run_job(job, jobs, stop=lambda: True)

    def fail(*_):
        msg = "the physics cannot go on"
        raise SimulationError(msg)

    with monkeypatch.context() as patched:
        patched.setattr("shear_sim.models.hard_disc.simulation.HardDiscSimulation.advance", fail)
        with pytest.raises(SimulationError):
            run_job(job, jobs)
    assert list((jobs.parent / "checkpoints").iterdir()) == []


def test_a_checkpoint_is_no_larger_than_what_it_holds(tmp_path):
    """Positions, contacts and records; no caches, no code."""
    simulation = models.model("hard_disc").start(make_job().point, make_job().streams)
    assert len(pickle.dumps(simulation)) < 300_000
