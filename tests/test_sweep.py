"""Sweeps end to end: real processes, real files, a model that a pencil can check."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace

import pytest
from tools import (
    FakeSlurm,
    assert_same,
    assert_same_but_for_the_wait,
    processes,
    run,
    start,
    wait_until,
    write_study,
)

import shear_sim
from shear_sim import sweep
from shear_sim.aggregate import make_tables
from shear_sim.plan import Costs, PlanError, default_cores, make_plan
from shear_sim.results import Failure, Results, ResultsError
from shear_sim.screen import Screen
from shear_sim.single import differences
from shear_sim.status import describe_status, read_status
from shear_sim.study import load_study
from shear_sim.tables import TableError, read_table
from shear_sim.workers import Died, Ending, Outcome, Ready


def make(study_file, root, **options):
    """Run a sweep in this process, silently."""
    study = load_study(study_file)
    results = Results(root / study.name)
    plan = make_plan(study, results, **options)
    return plan, sweep.run_plan(plan, Screen()), results


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The results of the study that the tests below disturb: one worker, no interruption."""
    folder = tmp_path_factory.mktemp("undisturbed")
    plan, report, results = make(write_study(folder), folder, jobs=1)
    assert (len(plan.run), report.done, report.exit_code) == (12, 12, 0)
    return results


def test_workers_do_not_change_a_bit(undisturbed, tmp_path):
    _, report, results = make(write_study(tmp_path), tmp_path, jobs=3)
    assert report.exit_code == 0
    assert_same(undisturbed, results)


def test_shards_cover_the_study_once_and_change_no_bit(undisturbed, tmp_path):
    study = write_study(tmp_path)
    counts = []
    for index in (2, 0, 1):
        plan, report, results = make(study, tmp_path, shard=(index, 3), jobs=1)
        counts.append((plan.total, report.done))
    assert counts == [(4, 4)] * 3
    assert_same(undisturbed, results)
    ids = sorted(path.stem for path in results.jobs.iterdir())
    plan = make_plan(load_study(study), Results(tmp_path / "other"), shard=(1, 3))
    assert [job.id for job in plan.run] == ids[1::3]


def test_any_shard_keeps_the_study_and_its_plan_where_they_are_missing(tmp_path):
    """So that what a part has computed can be aggregated, and a deleted plan comes back."""
    study = write_study(tmp_path)
    *_, results = make(study, tmp_path, shard=(1, 3), jobs=1)
    plan = results.plan()[0]
    assert plan.num_rows == 12
    assert results.study_file.read_text() == study.read_text()
    results.plan_file.unlink()
    with pytest.raises(TableError, match=r"no such file: `shear-sim sweep STUDY\.yaml` makes it"):
        results.plan()
    make(study, tmp_path, shard=(2, 3), jobs=1)
    assert results.plan()[0].equals(plan)


def test_a_damaged_plan_or_study_file_is_said_and_made_again_by_a_sweep(undisturbed, tmp_path):
    study = write_study(tmp_path)
    results = Results(shutil.copytree(undisturbed.folder, tmp_path / "study"))
    plan = results.plan()[0]
    results.plan_file.write_bytes(results.plan_file.read_bytes()[:-9])
    problem = rf"{results.plan_file}: damaged: .*: `shear-sim sweep STUDY\.yaml` makes"
    with pytest.raises(TableError, match=problem):
        make_tables(results.folder)
    status = read_status(results)
    assert (status["planned"], status["missing"]) == (None, None)
    assert re.search(f"12 of [?] jobs done\n  {problem}", describe_status(status))
    make(study, tmp_path)
    assert results.plan()[0].equals(plan)
    for harm in (results.study_file.unlink, lambda: results.study_file.write_bytes(b"\xff")):
        harm()
        with pytest.raises(ResultsError, match=r"cannot be read .*STUDY\.yaml` writes it again"):
            make_tables(results.folder)
        make(study, tmp_path)
        assert make_tables(results.folder)["runs"].attrs["done"] == 12


def test_a_shard_is_cut_before_finished_jobs_are_skipped(undisturbed, tmp_path):
    study = load_study(write_study(tmp_path))
    results = Results(tmp_path / "results")
    empty = make_plan(study, results, shard=(0, 2))
    results.jobs.mkdir(parents=True)
    done = empty.run[0].id
    results.job_file(done).write_bytes(undisturbed.job_file(done).read_bytes())
    later = make_plan(study, results, shard=(0, 2))
    assert [job.id for job in later.run] == [job.id for job in empty.run[1:]]


def test_limit_and_growth_keep_old_jobs(undisturbed, tmp_path):
    study = write_study(tmp_path, replicates=2)
    plan, report, results = make(study, tmp_path, limit=4)
    assert (report.done, report.left, plan.left_out, report.exit_code) == (4, 2, 2, 0)
    first = {path: path.stat().st_mtime_ns for path in results.jobs.iterdir()}
    plan, report, results = make(write_study(tmp_path), tmp_path)
    assert (plan.done, report.done) == (4, 8)
    assert all(path.stat().st_mtime_ns == time for path, time in first.items())
    assert_same(undisturbed, results)
    smaller = make_plan(load_study(write_study(tmp_path, replicates=1)), results)
    assert (smaller.done, smaller.run, smaller.orphans) == (3, [], 9)


def test_a_failing_job_does_not_touch_the_others(undisturbed, tmp_path, monkeypatch):
    study = write_study(tmp_path, "[none, physics, bug, exit, kill]", replicates=1)
    _, report, results = make(study, tmp_path, jobs=2)
    assert (report.done, len(report.failed), report.exit_code) == (3, 12, 1)
    failures = {job.id: results.failures().get(job.id) for job in load_study(study).jobs()}
    by_fault = {}
    for job in load_study(study).jobs():
        by_fault.setdefault(job.point.model.fault, []).append(failures[job.id])
    assert by_fault["none"] == [None] * 3
    assert {failure.kind for failure in by_fault["physics"]} == {"physics"}
    assert "the spring broke at t = 3 s" in by_fault["physics"][0].reason
    bug = by_fault["bug"][0]
    assert bug.kind == "error"
    assert re.fullmatch(
        r"ZeroDivisionError: a bug in the model \(kelvin_voigt.py, line \d+\)", bug.reason
    )
    assert any("kelvin_voigt.py" in line for line in bug.traceback)
    assert {(f.kind, f.exit_code, f.signal) for f in by_fault["exit"]} == {("crash", 7, None)}
    assert {(f.kind, f.exit_code, f.signal) for f in by_fault["kill"]} == {
        ("crash", None, "SIGKILL")
    }
    for job in results.finished():
        name = f"{job}.parquet"
        assert differences(*(read_table(r.jobs / name) for r in (undisturbed, results))) == []

    plan, report, _ = make(study, tmp_path)
    assert (len(plan.waiting), len(plan.again), report.exit_code) == (3, 9, 1)
    assert {failure.tries for failure in report.failed.values()} == {2}
    assert "tried again only with --retry-failed" in str(plan)

    monkeypatch.setenv("HEALED", "1")
    plan, report, _ = make(study, tmp_path)
    assert (report.done, report.waiting, report.exit_code) == (9, 3, 1)
    assert {failure.kind for failure in results.failures().values()} == {"physics"}
    plan, report, _ = make(study, tmp_path, retry_failed=True)
    assert (report.done, report.exit_code) == (3, 0)
    assert list(results.failed.iterdir()) == []


def test_a_full_disk_stops_the_sweep_and_is_no_jobs_failure(tmp_path, environment):
    study = write_study(tmp_path, "[full]")
    code, output = run(environment, "sweep", study, "--results", tmp_path / "results")
    assert code == 1
    assert "results cannot be written" in output
    assert "No space left on device" in output
    assert "Traceback" not in output
    assert list((tmp_path / "results/study/failed").iterdir()) == []


def test_results_that_cannot_be_written_are_bad_input(tmp_path, environment):
    (tmp_path / "file").write_text("")
    study = write_study(tmp_path)
    code, output = run(environment, "sweep", study, "--results", tmp_path / "file")
    assert code == 2
    assert f"{tmp_path / 'file/study'}: results cannot be written" in output
    assert "Traceback" not in output


def test_kernels_that_do_not_compile_end_the_sweep_with_the_reason(tmp_path, environment):
    study = write_study(tmp_path, "[uncompilable]")
    arguments = ("sweep", study, "--results", tmp_path / "results")
    code, output = run(environment, *arguments)
    assert code == 1
    assert "the kernels cannot be prepared: TypeError: contact law: no such function" in output
    assert "Traceback" not in output
    code, output = run(environment, "--debug", *arguments)
    assert "Traceback" in output
    assert 'kelvin_voigt.py", line' in output


def test_the_first_line_comes_at_once_and_compilation_is_said_once(tmp_path, environment):
    environment["SHEAR_SIM_CACHE"] = str(tmp_path / "cache")
    arguments = ("sweep", write_study(tmp_path, compiled=True), "--results", tmp_path / "results")
    process = start(environment, *arguments, "--limit", 2)
    assert process.stdout.readline().startswith("reading ")
    output, _ = process.communicate(timeout=120)
    assert "compiling the kernels: once" in output
    assert "next: shear-sim aggregate" in output
    code, output = run(environment, *arguments)
    assert code == 0
    assert "compiling" not in output
    assert re.search(r"from 2 measured jobs", output)


def test_an_unwritable_code_cache_is_said_and_compiled_once(tmp_path, environment):
    (tmp_path / "file").write_text("")
    environment["SHEAR_SIM_CACHE"] = str(tmp_path / "file/cache")
    study = write_study(tmp_path, compiled=True)
    code, output = run(environment, "sweep", study, "--results", tmp_path / "results", "-j", 3)
    assert code == 0
    assert output.count("compiled code cannot be kept") == 1
    assert output.count("compiling the kernels") == 1


def test_kill_9_of_the_sweep_loses_nothing_and_leaves_no_process(
    undisturbed, tmp_path, environment
):
    study = write_study(tmp_path, seconds=0.1)
    results = Results(tmp_path / "results/study")
    arguments = ("sweep", study, "--results", tmp_path / "results", "--jobs", 2)
    for _ in range(2):
        before = len(results.finished())
        process = start(environment, *arguments)
        wait_until(lambda before=before: len(results.finished()) > before + 1)
        process.kill()
        process.communicate()
        wait_until(lambda: not processes(environment), 5)
    assert len(results.finished()) < 12
    code, _ = run(environment, *arguments)
    assert code == 0
    assert [path for path in results.jobs.iterdir() if path.suffix != ".parquet"] == []
    assert_same_but_for_the_wait(undisturbed, results)


def test_kill_9_of_workers_and_server_loses_their_jobs_only(undisturbed, tmp_path, environment):
    study = write_study(tmp_path, seconds=1)
    results = Results(tmp_path / "results/study")
    arguments = ("sweep", study, "--results", tmp_path / "results", "--jobs", 2)
    process = start(environment, *arguments)
    wait_until(lambda: len(results.finished()) > 1)
    time.sleep(0.5)  # each worker is in the middle of its next job
    supervisor, server, *workers = processes(environment)
    assert supervisor == process.pid
    os.kill(workers[0], signal.SIGKILL)
    wait_until(lambda: len(results.failures()) == 1)
    time.sleep(0.5)
    os.kill(server, signal.SIGKILL)
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 1, output
    assert {failure.signal for failure in results.failures().values()} == {"SIGKILL"}
    assert len(results.finished()) + len(results.failures()) == 12
    assert 2 <= len(results.failures()) <= 3  # one worker, then the server with its two
    code, output = run(environment, *arguments)
    assert code == 0, output
    assert_same_but_for_the_wait(undisturbed, results)


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), (signal.SIGTERM, 75), (signal.SIGUSR1, 75), (signal.SIGHUP, 75)],
)
def test_signals_stop_the_sweep_with_their_exit_code(number, code, tmp_path, environment):
    study = write_study(tmp_path, seconds=0.3)
    results = Results(tmp_path / "results/study")
    process = start(environment, "sweep", study, "--results", tmp_path / "results", "-j", 2)
    wait_until(lambda: len(results.finished()) > 1)
    process.send_signal(number)
    output, _ = process.communicate(timeout=10)
    assert process.returncode == code, output
    assert f"stopped by {number.name}" in output
    assert "next: the same command again" in output
    assert "Traceback" not in output
    assert results.failures() == {}
    wait_until(lambda: not processes(environment), 5)
    assert {path.suffix for path in results.jobs.iterdir()} == {".parquet"}


def test_a_worker_that_is_asked_to_end_stops_the_sweep(tmp_path, environment):
    """Slurm asks all processes at once. Jobs are left, and the exit code says so."""
    study = write_study(tmp_path, seconds=4)
    results = Results(tmp_path / "results/study")
    process = start(environment, "sweep", study, "--results", tmp_path / "results", "--jobs", 1)
    wait_until(results.finished, 100)
    time.sleep(1)  # the worker is in the middle of its next job
    os.kill(processes(environment)[-1], signal.SIGTERM)
    output, _ = process.communicate(timeout=30)
    assert process.returncode == 75, output
    assert "stopped by SIGTERM" in output
    assert "1 job(s) will go on from checkpoints" in output
    assert len(list(results.checkpoints.iterdir())) == 1


@pytest.mark.parametrize("number", [signal.SIGUSR1, signal.SIGINT])
def test_a_stopped_job_goes_on_from_its_checkpoint(number, undisturbed, tmp_path, environment):
    """Two jobs of 4 s do not end before the signal."""
    study = write_study(tmp_path, seconds=4)
    results = Results(tmp_path / "results/study")
    arguments = ("sweep", study, "--results", tmp_path / "results", "--jobs", 2, "--limit", 2)
    process = start(environment, *arguments)
    wait_until(lambda: len(processes(environment)) == 4)
    time.sleep(1.5)
    process.send_signal(number)
    output, _ = process.communicate(timeout=10)
    assert "2 job(s) will go on from checkpoints" in output
    assert len(list(results.checkpoints.iterdir())) == 2
    code, output = run(environment, *arguments)
    assert code == 0, output
    for path in results.jobs.iterdir():
        assert read_table(path).summary["run"]["resumed"] == 1
    assert list(results.checkpoints.iterdir()) == []


def test_neither_a_crash_nor_a_job_begun_anew_is_progress(tmp_path):
    """A task without progress is requeued three times at most."""
    study = write_study(tmp_path, "[exit, none]", replicates=1)
    crashed = make_plan(load_study(study), Results(tmp_path / "study"))
    exits = {job.id for job in crashed.run if job.point.model.fault == "exit"}
    report = sweep.run_plan(
        replace(crashed, run=[j for j in crashed.run if j.id in exits]), Screen()
    )
    assert (len(report.failed), report.progress) == (3, False)
    for anew in (True, False):
        stopped = sweep._Sweep(crashed, Screen())
        stopped.busy = {1: 0}
        stopped._end(Outcome(1, 0, Ending(stopped=True, anew=anew), 1.0))
        assert (stopped.stopped, stopped.advanced) == (1, not anew)
    assert replace(report, stopped=1, advanced=1).progress
    assert replace(report, done=1).progress
    assert not replace(report, stopped=1).progress


def test_a_warning_before_the_first_job_has_the_task_requeued(tmp_path, environment):
    fake = FakeSlurm(tmp_path / "slurm")
    fake.answers("scontrol", "kill $PPID")  # as Slurm ends a task that it requeues
    environment |= {"PATH": f"{fake.folder}:/usr/bin:/bin", "SLURM_JOB_ID": "14"}
    process = start(environment, "sweep", write_study(tmp_path), "--results", tmp_path / "results")
    assert process.stdout.readline().startswith("reading")
    process.send_signal(signal.SIGUSR1)
    output, _ = process.communicate(timeout=60)
    assert "task 14 asks to be requeued" in output
    assert process.returncode == 75
    assert fake.calls("scontrol") == ["requeue 14"]
    assert Results(tmp_path / "results/study").finished() == set()


def test_a_signal_while_compiling_stops_at_once(tmp_path, environment):
    environment["SHEAR_SIM_CACHE"] = str(tmp_path / "cache")
    study = write_study(tmp_path, compiled=True)
    process = start(environment, "sweep", study, "--results", tmp_path / "results")
    for line in process.stdout:
        if line.startswith("compiling"):
            break
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=3)
    assert process.returncode == 75


def test_two_sweeps_at_once_are_harmless(undisturbed, tmp_path, environment):
    study = write_study(tmp_path)
    both = [start(environment, "sweep", study, "--results", tmp_path / "results") for _ in "ab"]
    for process in both:
        output, _ = process.communicate(timeout=60)
        assert process.returncode == 0, output
    assert_same(undisturbed, Results(tmp_path / "results/study"))


def test_the_python_api_needs_no_main_guard(undisturbed, tmp_path, environment):
    """multiprocessing would import the script again in every worker, and start sweeps there."""
    script = tmp_path / "script.py"
    script.write_text(
        "import sys, kelvin_voigt, shear_sim\n"
        "study = shear_sim.load_study(sys.argv[1])\n"
        "runs = shear_sim.run_study(study, results=sys.argv[2], jobs=2)\n"
        "print(len(runs), runs['moduli.periodic.storage'].round().unique())\n"
    )
    command = [sys.executable, script, write_study(tmp_path), tmp_path / "results"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1].startswith("12 [")
    assert_same(undisturbed, Results(tmp_path / "results/study"))


def test_the_api_returns_the_finished_jobs_of_the_study_only(tmp_path, capsys):
    write_study(tmp_path, replicates=2)
    assert len(shear_sim.run_study(tmp_path / "study.yaml", tmp_path)) == 6
    runs = shear_sim.run_study(write_study(tmp_path, "[none, physics]", replicates=1), tmp_path)
    assert len(runs) == 3
    assert runs["model.fault"].unique().tolist() == ["none"]
    assert "the spring broke" in capsys.readouterr().out


def test_cores_come_from_slurm_or_from_the_affinity(monkeypatch):
    for name in ("SLURM_JOB_ID", "SLURM_CPUS_PER_TASK"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 3, 5})
    assert default_cores() == 3
    monkeypatch.setenv("SLURM_JOB_ID", "17")
    assert default_cores() == 1
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", "4")
    assert default_cores() == 4


@pytest.mark.parametrize(("cores", "workers"), [(1, 1), (2, 1), (5, 2), (9, 4)])
def test_workers_leave_each_job_its_threads(cores, workers, monkeypatch, tmp_path):
    study = shared(tmp_path, "[2]", threads=2)
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", str(cores))
    results = Results(tmp_path / "results")
    assert make_plan(study, results).workers == workers
    assert make_plan(study, results, jobs=3).workers == 3


class Clockwork:
    """Workers that take no time: the job that ends first is the next event; all is noted."""

    def __init__(self, plan, seconds):
        self.run, self.seconds = plan.run, seconds
        self.now, self.count, self.events_before = 0.0, 0, [Ready()]
        self.running, self.begun = {}, []

    def add(self):
        self.count += 1
        return self.count

    def give(self, worker, number):
        assert worker not in self.running
        job = self.run[number]
        self.running[worker] = (self.now + self.seconds[job.threads], number)
        self.begun.append((self.now, job.threads, sum(self.cores())))

    def cores(self):
        return [self.run[number].threads for _, number in self.running.values()]

    def events(self, _timeout):
        if self.events_before:
            yield self.events_before.pop()
            return
        worker = min(self.running, key=self.running.get)
        self.now, number = self.running.pop(worker)
        yield Outcome(worker, number, Ending(), 1.0)

    def close(self):
        pass

    kill = close


def shared(folder, strips, threads=8, replicates=4):
    """A study of the stand-in model whose jobs could be shared by ``strips`` threads."""
    path = write_study(folder, replicates=replicates)
    path.write_text(path.read_text() + f"threads: {threads}\n")
    path.write_text(path.read_text().replace("model.fault: [none]", f"model.strips: {strips}"))
    return load_study(path)


def scheduled(plan, seconds, monkeypatch):
    """Return the Clockwork that has run a plan whose jobs of n threads take ``seconds[n]``."""
    clockwork = Clockwork(plan, seconds)
    monkeypatch.setattr(sweep._Sweep, "_new_workers", lambda _: clockwork)
    assert sweep.run_plan(plan, Screen()).done == len(plan.run)
    return clockwork


def test_jobs_of_few_threads_run_beside_those_of_many(tmp_path, monkeypatch):
    """12 jobs each of 8, 2 and 1 threads on 12 cores: all cores are used, and never more."""
    study = shared(tmp_path, "[1, 2, 30]")
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", "12")
    plan = make_plan(study, Results(tmp_path / "study"))
    assert Counter(job.threads for job in plan.run) == {8: 12, 2: 12, 1: 12}
    assert (plan.cores, plan.workers) == (12, 12)
    assert "threads: 8, as far as jobs have use for it: 12 job(s) use 8, 12 job(s) use 2" in str(
        plan
    )
    assert "there are 12 core(s)" not in str(plan)
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", "4")
    assert "there are 4 core(s) here: threads that share one wait" in str(plan)
    small_first = sorted(plan.run, key=lambda job: job.threads)
    done = scheduled(replace(plan, run=small_first), {8: 10.0, 2: 9.0, 1: 8.0}, monkeypatch)
    assert max(cores for *_, cores in done.begun) == 12
    large = [time for time, threads, _ in done.begun if threads == 8]
    assert large == [10.0 * n for n in range(12)]
    assert done.now == 120.0  # so the others took no time of their own
    assert done.count <= 1 + 4  # processes


def test_what_failed_before_runs_last_however_many_threads_it_has(tmp_path, monkeypatch):
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", "8")
    plan = make_plan(shared(tmp_path, "[1, 30]", replicates=1), Results(tmp_path / "study"))
    failed = {job.id: Failure(job.id, "crash", "") for job in plan.run if job.threads == 8}
    done = scheduled(replace(plan, again=failed), {8: 1.0, 1: 1.0}, monkeypatch)
    assert [threads for _, threads, _ in done.begun] == [1, 1, 1, 8, 8, 8]


def test_jobs_of_more_threads_than_cores_run_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", "3")
    plan = make_plan(shared(tmp_path, "[1, 30]"), Results(tmp_path / "study"))
    done = scheduled(plan, {8: 1.0, 1: 1.0}, monkeypatch)
    assert [cores for *_, cores in done.begun if cores > 3] == [8] * 12
    assert done.now == 12 + 12 / 3
    jobs = make_plan(plan.study, Results(tmp_path / "study2"), jobs=2)
    assert (jobs.cores, jobs.workers) == (16, 2)
    assert scheduled(jobs, {8: 1.0, 1: 1.0}, monkeypatch).now == 24 / 2


def test_what_jobs_take_together_is_estimated_by_their_threads(tmp_path, monkeypatch):
    """On 12 cores one job of 8 threads runs at once, or 6 of 2, or 12 of 1."""
    monkeypatch.setenv("SLURM_CPUS_PER_TASK", "12")
    plan = make_plan(shared(tmp_path, "[1, 2, 30]"), Results(tmp_path / "study"))
    for job in plan.run:
        plan.wall_s.add(plan.points[job.id], {8: 10.0, 2: 3.0, 1: 1.0}[job.threads])
    estimate = plan.to_json()["estimate"]
    assert estimate["wall_s"] == pytest.approx(12 * (10 + 3 / 6 + 1 / 12))


def test_a_worker_that_dies_idle_is_given_nothing(tmp_path):
    plan = make_plan(load_study(write_study(tmp_path)), Results(tmp_path / "study"))
    stopped = sweep._Sweep(plan, Screen())
    stopped.idle = [1, 2]
    stopped._take(Died(1, -9))
    assert (stopped.idle, stopped.failed) == ([2], {})


@pytest.mark.parametrize("jobs", [0, -3])
def test_no_worker_at_all_is_refused(jobs, tmp_path):
    with pytest.raises(PlanError, match=f"jobs={jobs}: must be a whole number above 0"):
        shear_sim.run_study(write_study(tmp_path), tmp_path, jobs=jobs)


def test_costs_use_the_point_where_it_is_measured():
    costs = Costs()
    todo = Counter({"slow": 2, "fast": 1, "unknown": 1})
    assert costs.total(todo) is None
    for point, cost in [("slow", 9.0), ("slow", 11.0), ("fast", 1.0)]:
        costs.add(point, cost)
    assert costs.total(todo) == pytest.approx(2 * 10 + 1 + 7)
